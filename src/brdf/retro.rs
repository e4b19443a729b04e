//! `sunglint brdf retro`: retro-reflection against angle, from a stage and a power meter.
//!
//! The run itself is [`sunglint_materials::retro`]'s; here are its devices, the person at the rig, and what is shown.

mod live;

use crate::interrupt::{Hangup, listen as listen_for};
use crate::output::{Console, OutputArgs, Usage};
use anyhow::{Context as _, anyhow, bail};
use clap::Args;
use serde_json::{Map, Value, json};
use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use sunglint_drivers::catalogue::{Address, AnyDevice};
use sunglint_drivers::clock::{Cancel, Clock as _, Deadline, DeviceClock, VirtualClock};
use sunglint_drivers::device::{Device, InBeam, PowerMeter, RotationStage, Value as SettingValue};
use sunglint_formats::toml::Document;
use sunglint_materials::retro::log::{self, Begun, Log};
use sunglint_materials::retro::measure::{
    Hands, HandsError, Line, Phase, Rig, State, measure, measured,
};
use sunglint_materials::retro::plan::RunPlan;
use sunglint_materials::retro::{reduce, to_table};
use sunglint_report::Product;
use sunglint_report::brdf::retro as show;
use sunglint_virtual::rig::devices::VirtualRig;
use sunglint_virtual::rig::options::Options;

/// Arguments of `sunglint brdf retro`.
#[derive(Debug, Args)]
pub struct RetroArgs {
    /// The run: stage, meter, angles, and what is known of the rig (docs/lab.md)
    #[arg(value_name = "RUN.toml")]
    pub plan: PathBuf,
    /// Go on with the run in the folder: what is there is not measured again
    #[arg(long)]
    pub resume: bool,
    /// With --resume: read the incident power again first
    #[arg(long, requires = "resume")]
    pub incident: bool,
    /// Measure nothing: make the table of what the folder holds, with what RUN.toml knows now of the rig
    #[arg(long, conflicts_with = "resume")]
    pub reduce: bool,
    /// Do not ask before what needs a hand (meter into the beam, sample away): something else does it
    #[arg(long)]
    pub yes: bool,
    /// Where the result goes: one folder, with the readings in it.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// How long opening a device, and finding a stage's reference, may take.
const OPEN: Duration = Duration::from_secs(30);
const HOME: Duration = Duration::from_secs(300);

pub(super) fn run(args: &RetroArgs, console: Console) -> anyhow::Result<()> {
    let folder = folder(&args.out)?;
    args.out.check()?;
    let names = ["retro.ecsv", "retro.png", "retro.svg"].map(str::to_owned);
    args.out.check_names(&names)?;
    let document = Document::read(&args.plan)?;
    let goes_on = args.resume || args.reduce;
    if !goes_on {
        log::refuse_begun(folder)?;
    }
    let begun = goes_on.then(|| Begun::read(folder)).transpose()?;
    // A run goes on with the rig that it was begun with.
    let rig = begun.as_ref().and_then(|begun| begun.rig.as_deref());
    let plan = RunPlan::new(&document, rig)?;
    let options = plan.rig.as_ref().map(Options::read).transpose()?;
    if let Some(begun) = &begun {
        let old = Document::new(folder.join("run.toml"), begun.plan.clone())?;
        let old = RunPlan::new(&old, rig)?;
        let same = old.measuring == plan.measuring
            && old.rig.as_ref().map(Options::read).transpose()? == options;
        if args.resume && !same {
            bail!(
                "{}: stage, meter, scan, laser or standard are not those with which the run in {} was begun (its run.toml): go on with that file",
                args.plan.display(),
                folder.display()
            );
        }
        if begun.torn_bytes > 0 {
            console.warn(&format!(
                "{}: a last line of {} bytes was cut off as it was written; its angle is read again",
                folder.display(),
                begun.torn_bytes
            ));
        }
    }
    let (lines, devices) = match begun {
        Some(begun) if args.reduce => (begun.lines, begun.devices),
        begun => take(args, (&plan, options), folder, begun, console)?,
    };
    finish(args, &plan, folder, &lines, &devices, console)
}

/// The one folder that is asked for.
fn folder(out: &OutputArgs) -> anyhow::Result<&Path> {
    match out.folders().output.len() {
        1 if out.output.len() == 1 => Ok(&out.output[0]),
        _ => Err(Usage(
            "give one folder for the run, such as -o aluminium/ (its name ends with `/`)".into(),
        )
        .into()),
    }
}

/// Measures what is missing.
fn take(
    args: &RetroArgs,
    (plan, options): (&RunPlan, Option<Options>),
    folder: &Path,
    begun: Option<Begun>,
    console: Console,
) -> anyhow::Result<(Vec<Line>, Value)> {
    let cancel = Cancel::new();
    let asking = Arc::new(AtomicBool::new(false));
    listen(&cancel, &asking, console)?;
    let before = begun.as_ref().map_or(&[][..], |begun| &begun.lines);
    let read = before.iter().filter(|l| matches!(l.state, State::Read | State::Over)).count();
    let virtual_rig = match options {
        None => None,
        Some(options) => Some(VirtualRig::new(options, read as u64)?),
    };
    let last_s = before.last().map_or(0.0, |line| line.time_s);
    let (clock, zero_s) = clock(virtual_rig.is_some(), begun.as_ref(), last_s);
    // A device that is not there leaves no run behind.
    let mut opened = open(plan, virtual_rig.as_ref(), &clock, &cancel)?;
    let devices = opened.describe(&clock)?;
    let mut log = match &begun {
        None => {
            let rig = plan.rig.as_ref().map(Document::source);
            Log::create(folder, &plan.source, rig, clock.clone())?
        }
        Some(begun) => Log::resume(folder, begun, clock.clone())?,
    };
    let what = if begun.is_some() { "resume" } else { "begin" };
    log.write_event(what, json!({ "lines": before.len() }))?;
    log.write_event("devices", devices.clone())?;
    let angles = plan.measuring.scan.angles().len();
    let scans = if plan.measuring.scan.signature { 2 } else { 1 };
    let done = before.iter().filter(|line| line.state == State::Kept).count();
    let live = live::Live::new((scans * angles + 2) as u64, done as u64, console);
    log.watch(Box::new(live));
    let mut person =
        Person { yes: args.yes, asking, console, standard: plan.measuring.standard_deg };
    let mut robot = virtual_rig.map(Robot);
    let hands: &mut dyn Hands = match &mut robot {
        Some(robot) => robot,
        None => &mut person,
    };
    let Opened { stage, meter } = &mut opened;
    let mut rig = Rig { stage: stage.as_mut(), meter: meter.as_mut(), hands, clock, cancel };
    let result = measure(&mut rig, &plan.measuring, before, args.incident, zero_s, &mut log);
    if let Err(error) = result {
        let kept = log.lines.iter().filter(|line| line.state == State::Kept).count();
        let readings = log.lines.iter().filter(|l| matches!(l.state, State::Read | State::Over));
        let (readings, folder) = (readings.count(), folder.display());
        // The bar goes before the error comes.
        drop(log);
        return Err(anyhow!(error)).with_context(|| {
            format!(
                "the run cannot go on; the motor is stopped, {readings} readings ({kept} angles) are safe in {folder}: go on with --resume, or make a table of them with --reduce"
            )
        });
    }
    log.write_event("end", json!({ "lines": log.lines.len() }))?;
    let at_end = opened.describe(&log.clock)?;
    let devices = json!({ "begin": devices, "end": at_end });
    log.write_event("devices", devices.clone())?;
    Ok((std::mem::take(&mut log.lines), devices))
}

/// The clock, and where the run's zero is on it. A virtual run goes on a minute after it broke off.
fn clock(is_virtual: bool, begun: Option<&Begun>, last_s: f64) -> (DeviceClock, f64) {
    if is_virtual {
        let clock = VirtualClock::new();
        if begun.is_some() {
            clock.sleep(Duration::from_secs_f64((last_s + 60.0).max(0.0)));
        }
        // Any night will do, as long as the same run has the same times.
        let zero = hifitime::Epoch::from_gregorian_utc_at_midnight(2026, 1, 1);
        return (DeviceClock { clock: Arc::new(clock), zero_utc: Some(zero) }, 0.0);
    }
    let clock = DeviceClock::live();
    let now_s = clock.clock.now().as_secs_f64();
    let since = begun.and_then(|begun| begun.first_utc);
    let elapsed_s = since.map_or(0.0, |first| (clock.utc() - first).to_seconds().max(last_s));
    (clock, now_s - elapsed_s)
}

/// Ctrl-C stops the run in good order, twice at once; while a person is asked nothing moves and nothing is unsafe.
fn listen(cancel: &Cancel, asking: &Arc<AtomicBool>, console: Console) -> anyhow::Result<()> {
    let (token, asking) = (cancel.clone(), asking.clone());
    listen_for(Hangup::Ends, move || {
        if token.is_cancelled() || asking.load(Ordering::SeqCst) {
            std::process::exit(1);
        }
        console.say("stopping the motor (Ctrl-C again ends the program at once)");
        token.cancel();
    })
}

struct Opened {
    stage: Box<dyn RotationStage>,
    meter: Box<dyn PowerMeter>,
}

fn open(
    plan: &RunPlan,
    virtual_rig: Option<&VirtualRig>,
    clock: &DeviceClock,
    cancel: &Cancel,
) -> anyhow::Result<Opened> {
    let within = |time| Deadline::after(clock.clock.clone(), time).with_cancel(cancel);
    let measuring = &plan.measuring;
    let mut opened = match virtual_rig {
        Some(rig) => Opened { stage: Box::new(rig.stage()), meter: Box::new(rig.meter()) },
        None => {
            let device = |address: &str, with: &[String]| -> anyhow::Result<AnyDevice> {
                let mut address = Address::parse(address, with)?;
                let line = address.connect(&within(OPEN))?;
                Ok(address.open(line, &within(OPEN))?)
            };
            let (stage, meter) = (&measuring.stage, &measuring.meter);
            let AnyDevice::RotationStage(found) = device(&stage.device, &stage.with)? else {
                bail!("stage.device: {} is no rotation stage", stage.device);
            };
            let AnyDevice::PowerMeter(head) = device(&meter.device, &meter.with)? else {
                bail!("meter.device: {} is no power meter", meter.device);
            };
            Opened { stage: found, meter: head }
        }
    };
    opened.meter.set_wavelength_nm(measuring.wavelength_nm, &within(OPEN))?;
    if let Some(range) = &measuring.meter.range {
        opened.meter.set_range(range, &within(OPEN))?;
    }
    if measuring.stage.home {
        opened.stage.home(&within(HOME)).context("the stage did not find its reference")?;
    }
    Ok(opened)
}

impl Opened {
    /// Who the devices say they are, with all their settings.
    fn describe(&mut self, clock: &DeviceClock) -> anyhow::Result<Value> {
        let within = || Deadline::after(clock.clock.clone(), OPEN);
        let one = |device: &mut dyn Device| -> anyhow::Result<Value> {
            let identity = device.identity(&within())?;
            let settings = device.settings(&within())?.into_iter().map(|setting| {
                let value = match setting.value {
                    SettingValue::Number(number) => json!(number),
                    SettingValue::Integer(number) => json!(number),
                    SettingValue::Text(text) => json!(text),
                    SettingValue::Flag(flag) => json!(flag),
                };
                (setting.name.to_owned(), value)
            });
            Ok(json!({
                "vendor": identity.vendor,
                "model": identity.model,
                "serial": identity.serial,
                "firmware": identity.firmware,
                "driver": identity.driver,
                "settings": settings.collect::<Map<_, _>>(),
            }))
        };
        let stage = one(self.stage.as_mut())?;
        Ok(json!({ "stage": stage, "meter": one(self.meter.as_mut())? }))
    }
}

/// The virtual rig's hands.
struct Robot(VirtualRig);

impl Hands for Robot {
    fn put(&mut self, place: InBeam) -> Result<(), HandsError> {
        self.0.place(place);
        Ok(())
    }
}

/// Somebody at the rig.
struct Person {
    yes: bool,
    asking: Arc<AtomicBool>,
    console: Console,
    standard: Option<f64>,
}

impl Hands for Person {
    fn put(&mut self, place: InBeam) -> Result<(), HandsError> {
        self.ask(place).map_err(Into::into)
    }
}

impl Person {
    fn ask(&mut self, place: InBeam) -> anyhow::Result<()> {
        if self.yes {
            return Ok(());
        }
        let behind = "the meter behind the lens";
        let what = match (place, self.standard) {
            (InBeam::Head, _) => "put the meter into the beam, in the sample's place".to_owned(),
            (InBeam::Nothing, _) => {
                format!("{behind}, take the sample away, let the beam go into a trap")
            }
            (InBeam::Sample, _) => format!("{behind}, put the sample onto its mount"),
            (InBeam::Standard, _) => format!("{behind}, put the standard in the sample's place"),
        };
        if !std::io::stdin().is_terminal() {
            bail!(
                "the run needs a hand: {what}; there is no terminal to ask on: start it on one, or give --yes where something else does it"
            );
        }
        self.console.say(&format!("{what}, then press Enter"));
        self.asking.store(true, Ordering::SeqCst);
        let mut line = String::new();
        let answered = std::io::stdin().read_line(&mut line);
        self.asking.store(false, Ordering::SeqCst);
        match answered.context("cannot read from the terminal")? {
            0 => bail!("nobody pressed Enter: {what}, and go on with --resume"),
            _ => Ok(()),
        }
    }
}

fn finish(
    args: &RetroArgs,
    plan: &RunPlan,
    folder: &Path,
    lines: &[Line],
    devices: &Value,
    console: Console,
) -> anyhow::Result<()> {
    let retro =
        reduce(&measured(lines), &plan.setup).with_context(|| folder.display().to_string())?;
    for note in &retro.notes {
        console.warn(&note.to_string());
    }
    let kept = lines.iter().filter(|l| l.state == State::Kept && l.phase == Phase::Sample);
    let asked: std::collections::HashSet<u64> = kept.map(|l| l.asked_deg.to_bits()).collect();
    let missing = |angle: &f64| !asked.contains(&angle.to_bits());
    let left = plan.measuring.scan.angles().iter().filter(|angle| missing(angle)).count();
    if left > 0 {
        console.warn(&format!("{left} angles are not measured yet: go on with --resume"));
    }
    let mut table = to_table(&retro);
    table.meta.insert("sample".into(), json!(plan.name));
    table.meta.insert("devices".into(), devices.clone());
    table.meta.insert("program".into(), json!(format!("sunglint {}", env!("CARGO_PKG_VERSION"))));
    table.meta.insert("plan".into(), json!(plan.source));
    let product = Product {
        name: "retro".into(),
        figure: Some(show::figure(&retro, &plan.name)),
        json: show::document(&retro, &folder.display().to_string(), left),
        table,
        ..Product::default()
    };
    args.out.finish(&product, &show::text(&retro, left), console)
}
