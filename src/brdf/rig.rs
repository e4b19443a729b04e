//! Devices, clock and hands of a run on a lab rig: what the runs of `brdf` and `efficiency` have in common.

use crate::interrupt::{Hangup, listen as listen_for};
use crate::output::{Console, OutputArgs, Usage, tell};
use crate::progress::Bar;
use anyhow::{Context as _, bail};
use clap::Args;
use hifitime::Epoch;
use serde::Serialize;
use serde_json::Value;
use std::io::IsTerminal as _;
#[cfg(unix)]
use std::os::fd::AsFd as _;
use std::path::{MAIN_SEPARATOR, Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use sunglint_drivers::catalogue::{Address, AnyDevice};
use sunglint_drivers::clock::{Cancel, Clock as _, Deadline, DeviceClock, VirtualClock};
use sunglint_drivers::device::{
    Device, InBeam, Monochromator, PowerMeter, RotationStage, Spectrometer,
};
use sunglint_formats::Table;
use sunglint_materials::log::{Begun, Log, LogLine, Watch, refuse_begun};
use sunglint_materials::retro::measure::{Hands, HandsError};
use sunglint_numerics::progress::Progress as _;

/// How long opening a device, and finding a stage's reference, may take.
pub(crate) const OPEN: Duration = Duration::from_secs(30);
pub(crate) const HOME: Duration = Duration::from_secs(300);

/// The one folder that is asked for, whether its name ends with `/` or not, and the same as the place for results.
pub(crate) fn folder(out: &OutputArgs, example: &str) -> anyhow::Result<(PathBuf, OutputArgs)> {
    let [folder] = &out.output[..] else {
        let text = format!("give one folder for the run, such as -o {example}/");
        return Err(Usage(text).into());
    };
    let has_extension = folder.extension().is_some() && !folder.is_dir();
    let named = folder.as_os_str().to_string_lossy().ends_with(['/', MAIN_SEPARATOR]);
    if folder.as_os_str() == "-" || (has_extension && !named) {
        let text = format!(
            "-o {}: a run needs a folder for its readings, such as -o {example}/",
            folder.display()
        );
        return Err(Usage(text).into());
    }
    let out = OutputArgs { output: vec![folder.join("")], force: out.force };
    Ok((folder.clone(), out))
}

/// The run in a folder that goes on, or is only read; none where a new one is to begin. `again` says what becomes of a line that was cut off.
pub(crate) fn begun<L: LogLine>(
    folder: &Path,
    goes_on: bool,
    files: &[&'static str],
    again: &str,
    console: Console,
) -> anyhow::Result<Option<Begun<L>>> {
    if !goes_on {
        refuse_begun::<L>(folder)?;
        return Ok(None);
    }
    let begun = Begun::<L>::read(folder, files)?;
    if begun.torn_bytes > 0 {
        console.warn(&format!(
            "{}: a last line of {} bytes was cut off as it was written; {again}",
            folder.display(),
            begun.torn_bytes
        ));
    }
    Ok(Some(begun))
}

/// A file that the folder of a run must hold.
pub(crate) fn kept<'a, L>(
    begun: &'a Begun<L>,
    name: &'static str,
    folder: &Path,
) -> anyhow::Result<&'a str> {
    let text = begun.files.get(name).map(String::as_str);
    text.with_context(|| {
        format!("{}: {name} is missing; the folder of a run holds it", folder.display())
    })
}

/// The log of a run that begins, with the files that it is begun with, or goes on.
pub(crate) fn log<L: LogLine>(
    folder: &Path,
    begun: Option<&Begun<L>>,
    files: &[(&'static str, Option<&str>)],
    clock: DeviceClock,
    devices: &impl Serialize,
) -> anyhow::Result<Log<L>> {
    log_with(folder, begun, files, L::header(), clock, devices)
}

/// [`log()`] of a run whose table has the columns of `table`.
pub(crate) fn log_with<L: LogLine>(
    folder: &Path,
    begun: Option<&Begun<L>>,
    files: &[(&'static str, Option<&str>)],
    table: Table,
    clock: DeviceClock,
    devices: &impl Serialize,
) -> anyhow::Result<Log<L>> {
    let (mut log, what, lines) = match begun {
        None => {
            let files: Vec<(&'static str, &str)> =
                files.iter().filter_map(|(name, text)| Some((*name, (*text)?))).collect();
            (Log::create_with(folder, &files, table, clock)?, "begin", 0)
        }
        Some(begun) => (Log::resume(folder, begun, clock)?, "resume", begun.lines.len()),
    };
    write_lines(&mut log, what, lines)?;
    log.write_event("devices", serde_json::to_value(devices)?)?;
    Ok(log)
}

/// An event of a run's log that tells how many lines there are.
#[derive(Serialize)]
struct Lines {
    lines: usize,
}

fn write_lines<L: LogLine>(log: &mut Log<L>, what: &str, lines: usize) -> anyhow::Result<()> {
    Ok(log.write_event(what, serde_json::to_value(Lines { lines })?)?)
}

/// Writes that the run is at its end.
pub(crate) fn end<L: LogLine>(log: &mut Log<L>) -> anyhow::Result<()> {
    write_lines(log, "end", log.lines.len())
}

/// Shows how a run goes, on a bar.
pub(crate) struct Live<L> {
    pub bar: Arc<Bar>,
    pub console: Console,
    /// Words of a line that ends a step.
    pub step: fn(&L) -> Option<String>,
}

impl<L> std::fmt::Debug for Live<L> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Live")
    }
}

impl<L> Watch<L> for Live<L> {
    fn line(&mut self, line: &L) {
        if let Some(text) = (self.step)(line) {
            self.bar.status(&text);
            self.bar.advance(1);
        }
    }

    fn say(&self, text: &str) {
        self.bar.suspend(|| self.console.say(text));
    }
}

/// The clock, and where the run's zero is on it. A virtual run goes on a minute after it broke off.
pub(crate) fn clock<L: LogLine>(is_virtual: bool, begun: Option<&Begun<L>>) -> (DeviceClock, f64) {
    let last_s = begun.and_then(|begun| begun.lines.last()).map_or(0.0, LogLine::time_s);
    if is_virtual {
        let clock = VirtualClock::new();
        if begun.is_some() {
            clock.sleep(Duration::from_secs_f64((last_s + 60.0).max(0.0)));
        }
        // Any night will do, as long as the same run has the same times.
        let zero = Epoch::from_gregorian_utc_at_midnight(2026, 1, 1);
        return (DeviceClock { clock: Arc::new(clock), zero_utc: Some(zero) }, 0.0);
    }
    let clock = DeviceClock::live();
    let now_s = clock.clock.now().as_secs_f64();
    let first_utc = begun.and_then(|begun| begun.first_utc);
    let elapsed_s = first_utc.map_or(0.0, |first| (clock.utc() - first).to_seconds().max(last_s));
    (clock, now_s - elapsed_s)
}

/// Ctrl-C stops the run in good order, twice at once; while a person is asked nothing moves and nothing is unsafe.
pub(crate) fn listen(
    cancel: &Cancel,
    asking: &Arc<AtomicBool>,
    console: Console,
) -> anyhow::Result<()> {
    let (token, asking) = (cancel.clone(), asking.clone());
    listen_for(Hangup::Ends, move || {
        if token.is_cancelled() || asking.load(Ordering::SeqCst) {
            std::process::exit(1);
        }
        console.say("stopping the motors (Ctrl-C again ends the program at once)");
        token.cancel();
    })
}

/// Opens the device of an address.
pub(crate) fn device(
    address: &str,
    with: &[String],
    within: &dyn Fn() -> Deadline,
) -> anyhow::Result<AnyDevice> {
    let mut address = Address::parse(address, with)?;
    let line = address.connect(&within())?;
    Ok(address.open(line, &within())?)
}

/// Opens the rotation stage of an address; `key` names it in errors.
pub(crate) fn stage(
    key: &str,
    address: &str,
    with: &[String],
    within: &dyn Fn() -> Deadline,
) -> anyhow::Result<Box<dyn RotationStage>> {
    match device(address, with, within).with_context(|| format!("{key} = \"{address}\""))? {
        AnyDevice::RotationStage(stage) => Ok(stage),
        _ => bail!("{key}: {address} is no rotation stage"),
    }
}

/// Opens the power meter of an address.
pub(crate) fn meter(
    address: &str,
    with: &[String],
    within: &dyn Fn() -> Deadline,
) -> anyhow::Result<Box<dyn PowerMeter>> {
    let found = device(address, with, within);
    match found.with_context(|| format!("meter.device = \"{address}\""))? {
        AnyDevice::PowerMeter(meter) => Ok(meter),
        _ => bail!("meter.device: {address} is no power meter"),
    }
}

/// Opens the spectrometer of an address.
pub(crate) fn spectrometer(
    address: &str,
    with: &[String],
    within: &dyn Fn() -> Deadline,
) -> anyhow::Result<Box<dyn Spectrometer>> {
    let found = device(address, with, within);
    match found.with_context(|| format!("spectrometer.device = \"{address}\""))? {
        AnyDevice::Spectrometer(spectrometer) => Ok(spectrometer),
        _ => bail!("spectrometer.device: {address} is no spectrometer"),
    }
}

/// Opens the monochromator of an address.
pub(crate) fn monochromator(
    address: &str,
    with: &[String],
    within: &dyn Fn() -> Deadline,
) -> anyhow::Result<Box<dyn Monochromator>> {
    let found = device(address, with, within);
    match found.with_context(|| format!("monochromator.device = \"{address}\""))? {
        AnyDevice::Monochromator(monochromator) => Ok(monochromator),
        _ => bail!("monochromator.device: {address} is no monochromator"),
    }
}

/// Who a device says it is, with all its settings.
pub(crate) fn describe(device: &mut dyn Device, clock: &DeviceClock) -> anyhow::Result<Value> {
    let within = || Deadline::after(clock.clock.clone(), OPEN);
    Ok(sunglint_report::devices::described(device, &within)?)
}

/// Who puts things into the beam.
#[derive(Debug, Clone, Default, Args)]
pub struct HandsArgs {
    /// Do not ask before what needs a hand (a shutter, the sample away): something else does it
    #[arg(long)]
    pub yes: bool,
    /// Run this program for what needs a hand, and wait for its end, instead of asking. Its argument is what shall be in the beam: blocked, head (the meter), nothing, sample, standard, through; for an axis that a person turns its arguments are turn, the axis and the angle in degrees
    #[arg(long, value_name = "PROGRAM", conflicts_with = "yes")]
    pub hands: Option<PathBuf>,
}

/// Somebody at the rig.
pub(crate) struct Person {
    pub args: HandsArgs,
    pub asking: Arc<AtomicBool>,
    pub cancel: Cancel,
    pub console: Console,
    /// What is asked for, in words.
    pub words: fn(InBeam) -> &'static str,
}

impl Hands for Person {
    fn put(&mut self, place: InBeam) -> Result<(), HandsError> {
        self.ask((self.words)(place), &[place.name()]).map_err(Into::into)
    }

    fn turn(&mut self, axis: &str, deg: f64) -> Result<(), HandsError> {
        let what = match axis {
            "detector" => "the detector's arm",
            "azimuth" => "the detector's plane about the sample's normal",
            "turn" => "the sample about its normal",
            _ => "the sample",
        };
        let angle = format!("{deg:.2}");
        let text = format!("turn {what} to {angle}°");
        self.ask(&text, &["turn", axis, &angle]).map_err(Into::into)
    }

    fn record(&mut self, text: &str) {
        // With -q, too: the run waits for it.
        tell(text);
    }
}

impl Person {
    /// Asks for something in words, or calls the program with the arguments for it.
    fn ask(&mut self, what: &str, args: &[&str]) -> anyhow::Result<()> {
        if self.args.yes {
            return Ok(());
        }
        if let Some(program) = &self.args.hands {
            return self.call(program, args);
        }
        if !std::io::stdin().is_terminal() {
            bail!(
                "the run needs a hand: {what}; there is no terminal to ask on: start it on one, name a program that does it (--hands), or give --yes where something else does it"
            );
        }
        tell(&format!("{what}, then press Enter"));
        self.asking.store(true, Ordering::SeqCst);
        let mut line = String::new();
        let answered = std::io::stdin().read_line(&mut line);
        self.asking.store(false, Ordering::SeqCst);
        match answered.context("cannot read from the terminal")? {
            0 => bail!("nobody pressed Enter: {what}, and go on with --resume"),
            _ => Ok(()),
        }
    }

    /// Lets the program do it. It has a process group of its own: Ctrl-C is for the run, which ends all of the group.
    fn call(&self, program: &Path, args: &[&str]) -> anyhow::Result<()> {
        const LOOK: Duration = Duration::from_millis(5);
        const SLOW: Duration = Duration::from_secs(10);
        let (shown, name) = (program.display(), args.join(" "));
        let mut command = Command::new(program);
        command.args(args).stdin(Stdio::null());
        #[cfg(unix)]
        {
            // What it says is for the person, not for the result.
            let said = std::io::stderr().as_fd().try_clone_to_owned().context("--hands")?;
            command.stdout(Stdio::from(said));
            std::os::unix::process::CommandExt::process_group(&mut command, 0);
        }
        #[cfg(not(unix))]
        command.stdout(Stdio::null());
        let mut child =
            command.spawn().with_context(|| format!("--hands {shown}: it does not start"))?;
        let (begun, mut told) = (Instant::now(), false);
        let status = loop {
            if self.cancel.is_cancelled() {
                end_program(&mut child);
                bail!("stopped before {shown} {name} ended: go on with --resume");
            }
            if let Some(status) = child.try_wait().context("--hands")? {
                break status;
            }
            if !told && begun.elapsed() > SLOW {
                self.console.say(&format!("waiting for {shown} {name} to end"));
                told = true;
            }
            std::thread::sleep(LOOK);
        };
        if !status.success() {
            bail!("{shown} {name} ended with {status}: see to it, and go on with --resume");
        }
        Ok(())
    }
}

impl HandsArgs {
    /// Refuses a program that cannot be called, before anything moves; `is_virtual` of a bench that has its own hands.
    pub fn check(&self, is_virtual: bool) -> anyhow::Result<()> {
        let Some(program) = &self.hands else { return Ok(()) };
        let shown = program.display();
        if is_virtual {
            bail!(Usage(format!(
                "--hands {shown}: a virtual bench has hands of its own; leave it out"
            )));
        }
        let is_name = program.components().count() == 1 && !program.starts_with(".");
        if is_name && program.is_file() {
            bail!(Usage(format!("--hands {shown}: it is a file here; write ./{shown}")));
        }
        if !is_name && !program.is_file() {
            bail!(Usage(format!("--hands {shown}: there is no such program")));
        }
        Ok(())
    }
}

/// Ends a program with those that it has started: asked first, at once where it does not listen.
fn end_program(child: &mut Child) {
    const PATIENCE: Duration = Duration::from_secs(3);
    signal(child, "-TERM");
    let until = Instant::now() + PATIENCE;
    while cfg!(unix) && Instant::now() < until && matches!(child.try_wait(), Ok(None)) {
        std::thread::sleep(Duration::from_millis(20));
    }
    signal(child, "-KILL");
    let _ = child.kill();
    let _ = child.wait();
}

/// Sends a signal to a program and those that it has started.
fn signal(child: &Child, signal: &str) {
    if cfg!(unix) {
        let group = format!("-{}", child.id());
        let mut command = Command::new("kill");
        command.args([signal, "--", &group]).stdin(Stdio::null()).stdout(Stdio::null());
        let _ = command.stderr(Stdio::null()).status();
    }
}
