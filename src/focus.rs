//! `sunglint focus`: the best position of a focuser, and how it follows the temperature.

use crate::interrupt::{Hangup, listen};
use crate::output::{Console, OutputArgs, Usage};
use anyhow::{Context as _, anyhow, bail};
use clap::{Args, Subcommand, ValueEnum};
use serde_json::Value;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::catalogue::{Address, AnyDevice};
use sunglint_drivers::clock::{Cancel, Deadline, DeviceClock, VirtualClock, utc_now};
use sunglint_drivers::device::{Camera, Focuser};
use sunglint_observatory::focus::drift::{At, Drift};
use sunglint_observatory::focus::run::{Approach, FailedRun, FocusRun, RunOptions, run as go};
use sunglint_report::focus as report;
use sunglint_virtual::focus::{FocusBench, FocusOptions};

/// Word in place of a camera's and a focuser's address.
const VIRTUAL: &str = "virtual";
/// How long a device may take to be opened.
const OPEN: Duration = Duration::from_secs(30);

/// Command for the focus.
#[derive(Debug, Subcommand)]
pub enum FocusCommand {
    /// Go through the focus and to its best position: half-flux radius of the stars against position, a curve, its lowest point
    Run(FocusArgs),
    /// How the best position follows the temperature, from several runs
    Drift(DriftArgs),
}

/// Side from which positions are approached.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum Side {
    /// From lower positions
    Up,
    /// From higher positions
    Down,
}

/// Arguments of `sunglint focus run`.
#[derive(Debug, Args)]
pub struct FocusArgs {
    /// The focuser: `indi-focuser:HOST:PORT/NAME`, `alpaca-focuser:HOST:PORT/0`, or `virtual`
    #[arg(long, value_name = "ADDRESS")]
    pub focuser: String,
    /// The camera: `indi-camera:HOST:PORT/NAME`, `alpaca-camera:HOST:PORT/0`, or `virtual`
    #[arg(long, value_name = "ADDRESS")]
    pub camera: String,
    /// Distance of two positions, steps: so far that the stars' radius at the ends is two to four times the best
    #[arg(long, value_name = "STEPS")]
    pub step: i64,
    /// Positions
    #[arg(long, value_name = "N", default_value_t = 9)]
    pub points: usize,
    /// Middle of the positions, steps [default: where the focuser stands]
    #[arg(long, value_name = "STEPS", allow_negative_numbers = true)]
    pub center: Option<i64>,
    /// Exposure of a frame, s
    #[arg(long, value_name = "S", default_value_t = 2.0)]
    pub exposure_s: f64,
    /// Frames at each position
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub frames: usize,
    /// Steps by which a position is passed before it is approached, more than the play of the gears [default: two steps]
    #[arg(long, value_name = "STEPS")]
    pub overshoot: Option<i64>,
    /// Side from which all positions are approached
    #[arg(long, value_enum, default_value_t = Side::Up)]
    pub approach: Side,
    /// Gain of the camera, in its own steps [default: as it is]
    #[arg(long, value_name = "GAIN")]
    pub gain: Option<f64>,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Arguments of `sunglint focus drift`.
#[derive(Debug, Args)]
pub struct DriftArgs {
    /// Results of runs (`focus run … -o NAME.json`)
    #[arg(required = true, value_name = "RUN.json")]
    pub runs: Vec<PathBuf>,
    /// Also the best position at this temperature, °C
    #[arg(long, value_name = "CELSIUS", allow_negative_numbers = true)]
    pub at: Option<f64>,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

impl FocusCommand {
    /// Where its result goes.
    pub fn output(&self) -> &OutputArgs {
        match self {
            Self::Run(args) => &args.out,
            Self::Drift(args) => &args.out,
        }
    }
}

/// Does what is asked.
///
/// # Errors
/// No best position, a device that fails, runs that cannot be read.
pub fn run(command: &FocusCommand, console: Console, seed: u64) -> anyhow::Result<()> {
    match command {
        FocusCommand::Run(args) => focus(args, console, seed),
        FocusCommand::Drift(args) => drift(args, console),
    }
}

fn open(option: &str, text: &str) -> anyhow::Result<AnyDevice> {
    let mut address = Address::parse(text, &[])
        .map_err(|error| anyhow!("{option}: {error}; or `{VIRTUAL}` for both to try it"))?;
    let deadline = Deadline::within(OPEN);
    let line = address.connect(&deadline)?;
    Ok(address.open(line, &deadline)?)
}

fn focus(args: &FocusArgs, console: Console, seed: u64) -> anyhow::Result<()> {
    args.out.check()?;
    let options = RunOptions::new(args.step, args.exposure_s).with(|options| {
        options.center = args.center;
        options.points = args.points;
        options.frames = args.frames;
        options.overshoot = args.overshoot.unwrap_or(args.step.saturating_mul(2));
        options.approach = match args.approach {
            Side::Up => Approach::Up,
            Side::Down => Approach::Down,
        };
    });
    let is_virtual = [&args.camera, &args.focuser].map(|address| address == VIRTUAL);
    let cancel = Cancel::new();
    let (mut camera, mut focuser, clock): (Box<dyn Camera>, Box<dyn Focuser>, _) = match is_virtual
    {
        [true, true] => {
            let (clock, zero_utc) = (Arc::new(VirtualClock::new()), Some(utc_now()));
            let clock = DeviceClock { clock, zero_utc };
            let bench =
                FocusBench::new(FocusOptions::default().with(|o| o.seed = seed), clock.clone());
            (Box::new(bench.camera()), Box::new(bench.focuser()), clock)
        }
        [false, false] => {
            let camera = match open("--camera", &args.camera)? {
                AnyDevice::Camera(camera) => camera,
                other => bail!("--camera: this is a {}, no camera", other.kind()),
            };
            let focuser = match open("--focuser", &args.focuser)? {
                AnyDevice::Focuser(focuser) => focuser,
                other => bail!("--focuser: this is a {}, no focuser", other.kind()),
            };
            (camera, focuser, DeviceClock::live())
        }
        _ => {
            let text = "--camera and --focuser are both `virtual`, or neither is";
            return Err(Usage(text.to_owned()).into());
        }
    };
    if let Some(gain) = args.gain {
        camera.set_gain(gain, &Deadline::within(OPEN))?;
    }
    let token = cancel.clone();
    listen(Hangup::Ends, move || token.cancel())?;
    let done = go(camera.as_mut(), focuser.as_mut(), &clock, &cancel, options, &mut |seen| {
        console.say(&report::point_text(seen));
        ControlFlow::Continue(())
    });
    let finish = |run: &FocusRun, error: Option<&str>| {
        args.out.finish(&report::product(run, error), &report::text(run), console)
    };
    match done {
        Ok(run) => finish(&run, None),
        Err(FailedRun { run, error, returned }) => {
            let stands = match (returned, run.stands_at) {
                (true, Some(at)) => format!("the focuser stands at {at}, as before"),
                (true, None) => "the focuser was not moved".to_owned(),
                (false, Some(at)) => format!(
                    "the focuser could not be sent back to {}: it stands at {at}",
                    run.started_at
                ),
                (false, None) => format!(
                    "the focuser could not be sent back to {}, and where it stands is not known",
                    run.started_at
                ),
            };
            let error = anyhow!("{error}; {stands}");
            // Options that make no sense have seen nothing.
            if !run.points.is_empty() {
                finish(&run, Some(&error.to_string()))?;
            }
            Err(error)
        }
    }
}

/// Best position and temperature of a run's file.
fn read(path: &Path) -> anyhow::Result<At> {
    let bytes = sunglint_formats::read::bytes(path)?;
    let file = || path.display().to_string();
    let value: Value =
        serde_json::from_slice(&bytes).with_context(|| format!("{} is no JSON", file()))?;
    let number = |pointer: &str, what: &str| {
        value.pointer(pointer).and_then(Value::as_f64).ok_or_else(|| {
            anyhow!("{}: it has no {what} (`{}`): give results of `focus run -o NAME.json` that found one", file(), &pointer[1..].replace('/', "."))
        })
    };
    Ok(At {
        position: number("/curve/best", "best position")?,
        sigma: number("/curve/sigma", "uncertainty")?,
        temperature_c: number("/temperature_c", "temperature")?,
    })
}

fn drift(args: &DriftArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    let runs: Vec<At> = args.runs.iter().map(|path| read(path)).collect::<Result<_, _>>()?;
    let drift = Drift::of(&runs)?;
    args.out.finish(
        &report::drift(&drift, &runs, args.at),
        &report::drift_text(&drift, args.at),
        console,
    )
}
