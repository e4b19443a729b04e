//! `sunglint brdf retro`: retro-reflection against angle, from a stage and a power meter.
//!
//! The run itself is [`sunglint_materials::retro`]'s; here are its devices, the person at the rig, and what is shown.

mod live;

use super::lab::{self, LabPage};
use super::rig::{self, HOME, OPEN};
use crate::output::{Console, OutputArgs};
use anyhow::{Context as _, anyhow, bail};
use clap::Args;
use serde::Serialize;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use sunglint_drivers::clock::{Cancel, Deadline, DeviceClock};
use sunglint_drivers::device::{InBeam, PowerMeter, RotationStage};
use sunglint_formats::text::counted;
use sunglint_formats::toml::Document;
use sunglint_materials::retro::log::{self, Begun, Log};
use sunglint_materials::retro::measure::{
    Hands, HandsError, Line, Phase, Rig, State, measure, measured,
};
use sunglint_materials::retro::plan::RunPlan;
use sunglint_materials::retro::reduce;
use sunglint_page::LabReading;
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
    /// Who puts things into the beam.
    #[command(flatten)]
    pub hands: rig::HandsArgs,
    /// Show the run in a browser, where it can be paused and stopped: prints the address [default: 127.0.0.1 and the first free port from 8650 on]
    #[arg(long, value_name = "ADDRESS:PORT", num_args = 0..=1, default_missing_value = "", conflicts_with = "reduce")]
    pub page: Option<String>,
    /// Where the result goes: one folder, with the readings in it.
    #[command(flatten)]
    pub out: OutputArgs,
}

pub(super) fn run(args: &RetroArgs, console: Console) -> anyhow::Result<()> {
    let (folder, out) = rig::folder(&args.out, "aluminium")?;
    let folder = folder.as_path();
    out.check()?;
    let names = ["retro.ecsv", "retro.png", "retro.svg"].map(str::to_owned);
    out.check_names(&names)?;
    let document = Document::read(&args.plan)?;
    let goes_on = args.resume || args.reduce;
    let files = [log::PLAN, log::RIG];
    let begun = rig::begun(folder, goes_on, &files, "its angle is read again", console)?;
    // A run goes on with the rig that it was begun with.
    let rig_text = begun.as_ref().and_then(|begun: &Begun| begun.file(log::RIG));
    let plan = RunPlan::new(&document, rig_text)?;
    let options = plan.rig.as_ref().map(Options::read).transpose()?;
    if let Some(begun) = &begun {
        let text = rig::kept(begun, log::PLAN, folder)?;
        let old = RunPlan::new(&Document::new(folder.join(log::PLAN), text)?, rig_text)?;
        let same = old.measuring == plan.measuring
            && old.rig.as_ref().map(Options::read).transpose()? == options;
        if args.resume && !same {
            bail!(
                "{}: stage, meter, scan, laser or standard are not those with which the run in {} was begun (its run.toml): go on with that file",
                args.plan.display(),
                folder.display()
            );
        }
    }
    let (lines, devices) = match begun {
        Some(begun) if args.reduce => (begun.lines, begun.devices),
        begun => take(args, (&plan, options), folder, begun, console)?,
    };
    finish(&out, &plan, folder, &lines, &devices, console)
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
    rig::listen(&cancel, &asking, console)?;
    let before = begun.as_ref().map_or(&[][..], |begun| &begun.lines);
    let read = before.iter().filter(|l| l.state.is_reading()).count();
    let virtual_rig = match options {
        None => None,
        Some(options) => Some(VirtualRig::new(options, read as u64)?),
    };
    let (clock, zero_s) = rig::clock(virtual_rig.is_some(), begun.as_ref());
    // A device that is not there leaves no run behind.
    args.hands.check(virtual_rig.is_some())?;
    let mut opened = open(plan, virtual_rig.as_ref(), &clock, &cancel)?;
    let devices = opened.describe(&clock)?;
    let rig_text = plan.rig.as_ref().map(Document::source);
    let files = [(log::PLAN, Some(plan.source.as_str())), (log::RIG, rig_text)];
    let mut log: Log = rig::log(folder, begun.as_ref(), &files, clock.clone(), &devices)?;
    let angles = plan.measuring.scan.angles().len();
    let scans = if plan.measuring.scan.signature { 2 } else { 1 };
    let done = before.iter().filter(|line| line.state == State::Kept).count();
    let places = [(scans * angles + 2) as u64, done as u64];
    let live = live::Live::new(places[0], places[1], console);
    let page = LabPage::start(args.page.as_deref(), folder, "angle of the stage", places, console)?;
    log.watch(LabPage::watch(page.as_ref(), Box::new(live), reading, &cancel));
    let mut person =
        rig::Person { args: args.hands.clone(), asking, cancel: cancel.clone(), console, words };
    let mut robot = virtual_rig.map(Robot);
    let hands: &mut dyn Hands = match &mut robot {
        Some(robot) => robot,
        None => &mut person,
    };
    let Opened { stage, meter } = &mut opened;
    let mut rig = Rig { stage: stage.as_mut(), meter: meter.as_mut(), hands, clock, cancel };
    let result = measure(&mut rig, &plan.measuring, before, args.incident, zero_s, &mut log);
    if let Some(page) = &page {
        page.end(if result.is_ok() { "done" } else { "stopped" });
    }
    if let Err(error) = result {
        let kept = log.lines.iter().filter(|line| line.state == State::Kept).count();
        let kept = counted(kept, "angle");
        let readings = log.lines.iter().filter(|l| l.state.is_reading());
        let (readings, folder) = (counted(readings.count(), "reading"), folder.display());
        // The bar goes before the error comes.
        drop(log);
        return Err(anyhow!(error)).with_context(|| {
            format!(
                "the run cannot go on; the motor is stopped, {readings} ({kept}) are safe in {folder}: go on with --resume, or make a table of them with --reduce"
            )
        });
    }
    rig::end(&mut log)?;
    let at_end = opened.describe(&log.clock)?;
    let devices = serde_json::to_value(Ends { begin: devices, end: at_end })?;
    log.write_event("devices", devices.clone())?;
    Ok((std::mem::take(&mut log.lines), devices))
}

/// A line of the run as the page shows it.
fn reading(line: &Line) -> LabReading {
    LabReading {
        part: match line.phase {
            Phase::Incident(_) => "incident",
            Phase::Signature => "no sample",
            Phase::Sample => "sample",
        }
        .to_owned(),
        angle_deg: line.angle_deg,
        place: format!("{:.3}°", line.angle_deg),
        power_w: line.power_w,
        range: line.range.clone(),
        state: lab::state(line.state),
    }
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
            let (stage, meter) = (&measuring.stage, &measuring.meter);
            let open = || within(OPEN);
            Opened {
                stage: rig::stage("stage.device", &stage.device, &stage.with, &open)?,
                meter: rig::meter(&meter.device, &meter.with, &open)?,
            }
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
    fn describe(&mut self, clock: &DeviceClock) -> anyhow::Result<Devices> {
        let stage = rig::describe(self.stage.as_mut(), clock)?;
        Ok(Devices { stage, meter: rig::describe(self.meter.as_mut(), clock)? })
    }
}

#[derive(Serialize)]
struct Devices {
    stage: Value,
    meter: Value,
}

/// Devices at the run's begin and at its end.
#[derive(Serialize)]
struct Ends {
    begin: Devices,
    end: Devices,
}

/// The virtual rig's hands.
struct Robot(VirtualRig);

impl Hands for Robot {
    fn put(&mut self, place: InBeam) -> Result<(), HandsError> {
        self.0.place(place);
        Ok(())
    }
}

/// What a person is asked for.
fn words(place: InBeam) -> &'static str {
    match place {
        InBeam::Head => "put the meter into the beam, in the sample's place",
        InBeam::Nothing | InBeam::Through => {
            "the meter behind the lens, take the sample away, let the beam go into a trap"
        }
        InBeam::Sample => "the meter behind the lens, put the sample onto its mount",
        InBeam::Standard => "the meter behind the lens, put the standard in the sample's place",
        InBeam::Blocked => "block the beam before the sample",
    }
}

fn finish(
    out: &OutputArgs,
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
    let left = show::left(plan, lines);
    if left > 0 {
        console.warn(&format!("not measured yet: {}; go on with --resume", counted(left, "angle")));
    }
    let product = show::product(&retro, plan, lines, devices, folder);
    out.finish(&product, &show::text(&retro, left), console)
}
