//! `sunglint observe`: a night from its plan to its session's folder.
//!
//! Each device has a thread of its own (`device`, `camera`, `counter`), on a clock of its own, and waits for no other:
//! not for a target to be found, not for the display. What they have goes to the one thread that writes (`disk`); where the telescope
//! looks is a function of time (`schedule`). Where devices come from is an [`Opener`]'s: the [`Catalogue`] of drivers, a session that is
//! played back ([`Playback`]), or a virtual observatory ([`VirtualNight`]).

mod camera;
mod clock;
mod counter;
mod device;
mod disk;
mod night;
mod opener;
mod plan;
mod playback;
mod pointing;
mod schedule;
mod status;
mod tags;
mod virtual_night;

pub use night::{Night, Summary};
pub use opener::{Catalogue, DeviceClock, Opener};
pub use plan::{CameraPlan, CounterPlan, Plan};
pub use playback::Playback;
pub use schedule::{Schedule, Slot};
pub use status::{DeviceStatus, LastFrame, Snapshot, State};
pub use virtual_night::VirtualNight;

use crate::output::{Console, Usage};
use anyhow::{Context as _, bail};
use clap::Args;
use hifitime::Epoch;
use indicatif::ProgressBar;
use serde_json::{Value, json};
use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};
use sunglint_drivers::clock::Cancel;
use sunglint_formats::session::{DeviceKind, Disk, FORMAT, FileSum, Manifest, Session, What};
use sunglint_formats::time::format_utc;
use sunglint_formats::toml::Positive;

/// Arguments of `sunglint observe`.
#[derive(Debug, Args)]
pub struct ObserveArgs {
    /// The plan: station, devices, targets and when (docs/night.md)
    #[arg(value_name = "NIGHT.toml", required_unless_present = "replay")]
    pub night: Option<PathBuf>,
    /// Plays a session's frames and counts back as devices, into a new session
    #[arg(long, value_name = "SESSION", conflicts_with = "night")]
    pub replay: Option<PathBuf>,
    /// With --replay: as fast as it can instead of at speed
    #[arg(long, requires = "replay")]
    pub fast: bool,
    /// The session's folder, to be made [default: the plan's `output` and `name`, with the date]
    #[arg(short, long, value_name = "FOLDER")]
    pub output: Option<PathBuf>,
    /// Seconds between two lines that say how it goes [default: 1 on a terminal, else 10]
    #[arg(long, value_name = "S")]
    pub every: Option<f64>,
}

/// Observes.
pub fn run(args: &ObserveArgs, console: Console) -> anyhow::Result<()> {
    let every = match args.every {
        None => status::EVERY[usize::from(!std::io::stdout().is_terminal())],
        Some(s) if (0.05..=86_400.0).contains(&s) => Duration::from_secs_f64(s),
        Some(s) => return Err(Usage(format!("--every is {s}, expected 0.05 to 86400 s")).into()),
    };
    let night = match (&args.night, &args.replay) {
        (_, Some(session)) => replayed(session, args.fast, args.output.as_deref())?,
        (Some(plan), None) => planned(Plan::read(plan)?, args.output.as_deref()),
        (None, None) => return Err(Usage("give a NIGHT.toml, or --replay SESSION".into()).into()),
    };
    let cancel = Cancel::new();
    let token = cancel.clone();
    ctrlc::set_handler(move || {
        if token.is_cancelled() {
            std::process::exit(1);
        }
        console.say("ending the session (Ctrl-C again ends the program at once)");
        token.cancel();
    })
    .context("cannot listen for Ctrl-C")?;
    if args.replay.is_none() {
        console.say(&clock::text(&night.manifest.clock));
    }
    console.say(&format!("writing into {}", night.root.display()));
    let mut display = Display::new(every, night.root.clone(), console);
    let summary = night.run(&cancel, &mut |snapshot| display.show(&snapshot))?;
    display.end();
    finish(&summary, console)
}

fn program() -> String {
    format!("sunglint {}", env!("CARGO_PKG_VERSION"))
}

/// A night with the devices of the catalogue, or of a virtual observatory.
pub fn planned(plan: Plan, output: Option<&Path>) -> Night {
    let root = match output {
        Some(root) => root.to_path_buf(),
        None => free_name(&plan.output, &plan.name, plan.from),
    };
    let made_up = plan.virtual_night.is_some();
    let manifest = Manifest {
        format: FORMAT.into(),
        program: program(),
        station: plan.station.name.clone(),
        start_utc: if made_up { plan.from } else { DeviceClock::live().utc() },
        clock: if made_up { clock::exact() } else { clock::measured() },
        devices: plan.devices(),
        files: plan.sums(),
    };
    Night {
        root,
        storage: Arc::new(Disk),
        manifest,
        files: plan.files,
        station: plan.station,
        cameras: plan.cameras,
        counters: plan.counters,
        opener: match plan.virtual_night {
            Some(night) => Arc::new(night),
            None => Arc::new(Catalogue),
        },
        schedule: plan.schedule,
        end: plan.to,
        ended: None,
    }
}

/// A night that is played back: the same devices by the same names, the same configuration, targets and times.
///
/// # Errors
/// What is no session, or cannot be read.
pub fn replayed(session: &Path, fast: bool, output: Option<&Path>) -> anyhow::Result<Night> {
    let session = Session::open(session)?;
    let playback = Playback::new(&session, fast)?;
    let old = session.manifest().clone();
    let mut ended = None;
    for event in session.events()? {
        let event = event?;
        if matches!(event.what, What::End { .. }) {
            ended = Some(event.utc);
        }
    }
    let mut files = Vec::new();
    for FileSum { path, .. } in &old.files {
        files.push((path.clone(), sunglint_formats::read::bytes(session.file(path))?));
    }
    let positive = |s: f64, what: &str| {
        Positive::new(s)
            .with_context(|| format!("session.toml: {what} is {s}, expected more than 0"))
    };
    let (mut cameras, mut counters) = (Vec::new(), Vec::new());
    for device in &old.devices {
        let (name, address) = (device.name.clone(), device.address.clone());
        let exposure_s = positive(device.exposure_s, "exposure_s")?;
        match device.kind {
            DeviceKind::Camera => cameras.push(CameraPlan::plain(name, address, exposure_s)),
            DeviceKind::Counter => {
                let mut plan = CounterPlan::plain(name, address, exposure_s);
                let inputs = device.inputs.iter().filter_map(|i| u32::try_from(*i).ok());
                plan.channels = match inputs.collect::<Vec<_>>() {
                    inputs if inputs.len() == device.channels.len() => {
                        device.channels.iter().cloned().zip(inputs).collect()
                    }
                    _ => device.channels.iter().cloned().zip(1..).collect(),
                };
                plan.raw_tags = device.raw_tags;
                counters.push(plan);
            }
        }
    }
    let root = match output {
        Some(root) => root.to_path_buf(),
        None => {
            let name = session.root().file_name().unwrap_or_default().to_string_lossy();
            let beside = session.root().parent().unwrap_or(Path::new("")).to_path_buf();
            (1..)
                .map(|n| beside.join(format!("{name}_replay{n}")))
                .find(|path| !path.exists())
                .unwrap_or(beside)
        }
    };
    Ok(Night {
        root,
        storage: Arc::new(Disk),
        station: crate::station::of_session(&session)?,
        schedule: Schedule::of_session(&session)?,
        end: Some(playback.end()),
        ended,
        opener: Arc::new(playback),
        manifest: Manifest { program: program(), ..old },
        files,
        cameras,
        counters,
    })
}

/// `DATE_NAME` in a folder, or the next that is free. A night has the date of its evening in UTC.
fn free_name(folder: &Path, name: &str, from: Epoch) -> PathBuf {
    let evening = format_utc(from - hifitime::Duration::from_hours(12.0), 0);
    let date = evening.split_once('T').map_or(evening.as_str(), |(date, _)| date).to_owned();
    let first = folder.join(format!("{date}_{name}"));
    let next = |n: u32| folder.join(format!("{date}_{name}_{n}"));
    std::iter::once(first.clone())
        .chain((2..).map(next))
        .find(|path| !path.exists())
        .unwrap_or(first)
}

/// Says how it goes: a line that changes on a terminal, else a line now and then, or JSON.
struct Display {
    every: Duration,
    shown: Option<Instant>,
    root: PathBuf,
    console: Console,
    bar: Option<ProgressBar>,
}

impl Display {
    fn new(every: Duration, root: PathBuf, console: Console) -> Self {
        let terminal = std::io::stderr().is_terminal() && !console.json && !console.quiet;
        let bar = terminal.then(|| {
            let bar = ProgressBar::new_spinner();
            match indicatif::ProgressStyle::with_template("{msg}") {
                Ok(style) => bar.with_style(style),
                Err(_) => bar,
            }
        });
        Self { every, shown: None, root, console, bar }
    }

    fn show(&mut self, snapshot: &Snapshot) {
        for message in &snapshot.messages {
            match &self.bar {
                Some(bar) => bar.println(message),
                None if !self.console.json => self.console.say(message),
                None => {}
            }
        }
        let due = self.shown.is_none_or(|shown| shown.elapsed() >= self.every);
        if !due && (snapshot.messages.is_empty() || !self.console.json) {
            return;
        }
        self.shown = Some(Instant::now());
        let snapshot = Snapshot { free_bytes: free_bytes(&self.root), ..snapshot.clone() };
        match &self.bar {
            Some(bar) => bar.set_message(snapshot.text()),
            None if self.console.json => {
                // Whoever reads the pipe may have read enough; the night goes on.
                let _ = self.console.print(&line("status", snapshot.json()).to_string());
            }
            None => self.console.say(&snapshot.text()),
        }
    }

    fn end(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// A JSON line of a kind.
fn line(kind: &str, of: Value) -> Value {
    let mut line = serde_json::Map::new();
    line.insert("kind".into(), kind.into());
    if let Value::Object(fields) = of {
        line.extend(fields);
    }
    Value::Object(line)
}

/// Bytes that are free on the disk of a folder.
#[cfg(unix)]
fn free_bytes(folder: &Path) -> Option<u64> {
    let about = nix::sys::statvfs::statvfs(folder).ok()?;
    #[allow(clippy::useless_conversion)]
    Some(u64::from(about.blocks_available()).saturating_mul(u64::from(about.fragment_size())))
}

/// Bytes that are free on the disk of a folder: not known here.
#[cfg(not(unix))]
fn free_bytes(_: &Path) -> Option<u64> {
    None
}

/// Says how it went, and fails where something is missing.
fn finish(summary: &Summary, console: Console) -> anyhow::Result<()> {
    let json = line(
        "end",
        json!({
            "session": summary.root.display().to_string(),
            "utc": format_utc(summary.utc, 3),
            "reason": if summary.stopped { "stopped" } else { "done" },
            "taken": summary.taken,
            "losses": summary.losses,
            "not_written": summary.not_written,
        }),
    );
    let taken: Vec<String> = summary.taken.iter().map(|(name, n)| format!("{name} {n}")).collect();
    let text = format!("{}: {}", summary.root.display(), taken.join(", "));
    if console.json {
        console.print(&json.to_string())?;
    } else if !console.quiet {
        console.print(&text)?;
    }
    if summary.not_written > 0 {
        let why = summary.disk_error.clone().unwrap_or_else(|| "see its event log".into());
        bail!(
            "{} rows, tags or frames could not be written: {why}; what was written before is whole",
            summary.not_written
        );
    }
    if !summary.silent.is_empty() && !summary.stopped {
        bail!(
            "nothing came from {}: see events.jsonl of {}",
            summary.silent.join(", "),
            summary.root.display()
        );
    }
    Ok(())
}
