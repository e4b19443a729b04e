//! `sunglint brdf run`: a goniometer driven through a plan.
//!
//! The run itself is [`sunglint_materials::goniometer`]'s; here are its devices, the person at the bench, and what is shown.

use super::lab::{self, LabPage};
use super::rig::{self, HOME, Live, OPEN};
use crate::output::{Console, OutputArgs, Usage};
use crate::progress::Bar;
use anyhow::{Context as _, anyhow, bail};
use clap::Args;
use serde::Serialize;
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use sunglint_drivers::clock::{Cancel, Deadline, DeviceClock};
use sunglint_drivers::device::{InBeam, PowerMeter, RotationStage};
use sunglint_formats::ecsv;
use sunglint_formats::toml::Document;
use sunglint_materials::goniometer::bench::{AXES, Bench, VIRTUAL_BENCH};
use sunglint_materials::goniometer::folder::travel_of;
use sunglint_materials::goniometer::line::{BENCH, Begun, FILES, Line, Log, PLAN, VIRTUAL};
use sunglint_materials::goniometer::measure::{Rig, done, measure};
use sunglint_materials::goniometer::pose::Kinematics;
use sunglint_materials::goniometer::tasks::{Part, Tasks, tasks};
use sunglint_materials::plan::{Planned, planned};
use sunglint_materials::reading::State;
use sunglint_materials::retro::measure::{Hands, HandsError};
use sunglint_numerics::progress::Progress as _;
use sunglint_page::LabReading;
use sunglint_report::brdf::goniometer::{RunSummary, hours, run_text};
use sunglint_virtual::goniometer::devices::VirtualGoniometer;
use sunglint_virtual::goniometer::options::Options;

/// Arguments of `sunglint brdf run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// The plan, as `sunglint brdf plan` writes it
    #[arg(value_name = "PLAN")]
    pub plan: PathBuf,
    /// The bench: axes, meter, optics (docs/lab-run.md); it is written once, not for each run
    #[arg(long, value_name = "BENCH.toml", conflicts_with = "virtual_bench")]
    pub bench: Option<PathBuf>,
    /// A virtual goniometer with everything as usual, to try it without a bench
    #[arg(long = "virtual")]
    pub virtual_bench: bool,
    /// Go on with the run in the folder: what is there is not measured again
    #[arg(long)]
    pub resume: bool,
    /// Who puts things into the beam.
    #[command(flatten)]
    pub hands: rig::HandsArgs,
    /// Show the run in a browser, where it can be paused and stopped: prints the address [default: 127.0.0.1 and the first free port from 8650 on]
    #[arg(long, value_name = "ADDRESS:PORT", num_args = 0..=1, default_missing_value = "")]
    pub page: Option<String>,
    /// Where the run goes: one folder, with the readings in it.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// The bench that is asked for: its document, and the text of the virtual one.
fn document(args: &RunArgs, begun: Option<&Begun>, folder: &Path) -> anyhow::Result<Document> {
    let asked = match (&args.bench, args.virtual_bench) {
        (Some(path), _) => Some(Document::read(path)?),
        (None, true) => Some(Document::new(BENCH, VIRTUAL_BENCH)?),
        (None, false) => None,
    };
    let Some(begun) = begun else {
        return asked.ok_or_else(|| {
            let text = "name the bench with --bench BENCH.toml (docs/lab-run.md has one to start from), or try a run without one: --virtual";
            Usage(text.into()).into()
        });
    };
    let text = rig::kept(begun, BENCH, folder)?;
    if asked.is_some_and(|asked| asked.source() != text) {
        bail!(
            "the bench is not that with which the run in {} was begun (its {BENCH}): leave --bench out, the folder holds it",
            folder.display()
        );
    }
    Ok(Document::new(folder.join(BENCH), text)?)
}

/// The virtual goniometer's options: from the folder of the run, from the file that the bench names, or as usual.
fn virtual_text(args: &RunArgs, begun: Option<&Begun>) -> Option<String> {
    match begun {
        Some(begun) => begun.file(VIRTUAL).map(str::to_owned),
        None => args.virtual_bench.then(|| "# All as usual: docs/lab-run.md\n".to_owned()),
    }
}

pub(super) fn run(args: &RunArgs, console: Console) -> anyhow::Result<()> {
    let (folder, _) = rig::folder(&args.out, "run")?;
    let folder = folder.as_path();
    let begun: Option<Begun> =
        rig::begun(folder, args.resume, &FILES, "it is read again", console)?;
    let plan_text = sunglint_formats::read::text(&args.plan)?;
    let (all, _) = planned(&args.plan, &ecsv::read_str(&args.plan, &plan_text)?)?;
    let document = document(args, begun.as_ref(), folder)?;
    let bench = Bench::new(&document, virtual_text(args, begun.as_ref()).as_deref())?;
    let options = bench.virtual_bench.as_ref().map(Options::read).transpose()?;
    if let Some(begun) = &begun
        && begun.file(PLAN) != Some(plan_text.as_str())
    {
        bail!(
            "{} is not the plan with which the run in {} was begun (its {PLAN}): go on with that one",
            args.plan.display(),
            folder.display()
        );
    }
    let made = take(args, (&plan_text, &all), (&bench, options), folder, begun, console)?;
    console.result(&run_text(&made), &serde_json::to_value(&made)?)
}

/// A line that ends a measurement, in words.
fn step(line: &Line) -> Option<String> {
    (line.state == State::Kept).then(|| format!("{} {}", line.part.name(), line.number))
}

/// A line of the run as the page shows it.
fn reading(line: &Line) -> LabReading {
    let names = ["sample", "detector", "azimuth", "turn"].iter().zip(line.stages);
    let places: Vec<String> =
        names.filter_map(|(name, at)| Some(format!("{name} {:.2}°", at?))).collect();
    LabReading {
        part: line.part.name().to_owned(),
        angle_deg: line.stages[1].unwrap_or(0.0),
        place: places.join(", "),
        power_w: line.power_w,
        range: line.range.clone(),
        state: lab::state(line.state),
    }
}

/// What a person is asked for.
fn words(place: InBeam) -> &'static str {
    match place {
        InBeam::Blocked => "block the beam before the sample (or close the shutter)",
        InBeam::Through | InBeam::Head => {
            "open the beam, take the sample away: the beam goes on straight, to the detector behind"
        }
        InBeam::Nothing => {
            "no sample: put a trap where the beam ends, out of the way of the detector's arm"
        }
        InBeam::Sample => "open the beam, put the sample onto its mount",
        InBeam::Standard => "put the standard in the sample's place",
    }
}

/// The virtual bench's hands.
struct Robot(VirtualGoniometer);

impl Hands for Robot {
    fn put(&mut self, place: InBeam) -> Result<(), HandsError> {
        self.0.place(place);
        Ok(())
    }
}

struct Opened {
    stages: [Option<Box<dyn RotationStage>>; 4],
    meter: Box<dyn PowerMeter>,
}

fn open(
    bench: &Bench,
    virtual_bench: Option<&VirtualGoniometer>,
    clock: &DeviceClock,
    cancel: &Cancel,
) -> anyhow::Result<Opened> {
    let within = |time| Deadline::after(clock.clock.clone(), time).with_cancel(cancel);
    let mut stages: [Option<Box<dyn RotationStage>>; 4] = [None, None, None, None];
    for (k, axis) in bench.all_axes().into_iter().enumerate() {
        let Some(axis) = axis else { continue };
        let mut stage: Box<dyn RotationStage> = match virtual_bench {
            Some(virtual_bench) => Box::new(virtual_bench.stage(k)),
            None => {
                let key = format!("axis.{}.device", AXES[k]);
                rig::stage(&key, &axis.device, &axis.with, &|| within(OPEN))?
            }
        };
        if axis.home {
            let name = AXES[k];
            let homed = stage.home(&within(HOME));
            homed.with_context(|| format!("the axis `{name}` did not find its reference"))?;
        }
        stages[k] = Some(stage);
    }
    let mut meter: Box<dyn PowerMeter> = match virtual_bench {
        Some(virtual_bench) => Box::new(virtual_bench.meter()),
        None => rig::meter(&bench.meter.device, &bench.meter.with, &|| within(OPEN))?,
    };
    meter.set_wavelength_nm(bench.wavelength_nm, &within(OPEN))?;
    if let Some(range) = &bench.meter.range {
        meter.set_range(range, &within(OPEN))?;
    }
    Ok(Opened { stages, meter })
}

impl Opened {
    /// Who the devices say they are, with all their settings, and how far the stages turn.
    fn describe(&mut self, clock: &DeviceClock) -> anyhow::Result<Devices> {
        let mut axes = Map::new();
        for (name, stage) in AXES.iter().zip(&mut self.stages) {
            if let Some(stage) = stage {
                axes.insert((*name).into(), rig::describe(stage.as_mut(), clock)?);
            }
        }
        let travel_deg = self
            .stages
            .each_ref()
            .map(|s| s.as_ref().and_then(|s| s.travel_deg().map(|t| t.to_array())));
        Ok(Devices { axes, meter: rig::describe(self.meter.as_mut(), clock)?, travel_deg })
    }
}

#[derive(Serialize)]
struct Devices {
    #[serde(flatten)]
    axes: Map<String, Value>,
    meter: Value,
    travel_deg: [Option<[f64; 2]>; 4],
}

/// Measures what is missing.
fn take(
    args: &RunArgs,
    (plan_text, all): (&str, &[Planned]),
    (bench, options): (&Bench, Option<Options>),
    folder: &Path,
    begun: Option<Begun>,
    console: Console,
) -> anyhow::Result<RunSummary> {
    let cancel = Cancel::new();
    let asking = Arc::new(AtomicBool::new(false));
    rig::listen(&cancel, &asking, console)?;
    let before = begun.as_ref().map_or(&[][..], |begun| &begun.lines);
    let read = before.iter().filter(|line| line.state.is_reading()).count();
    let virtual_bench = match options {
        None => None,
        Some(options) => Some(VirtualGoniometer::new(options, read as u64)?),
    };
    let (clock, zero_s) = rig::clock(virtual_bench.is_some(), begun.as_ref());
    // A device that is not there leaves no run behind.
    args.hands.check(virtual_bench.is_some())?;
    let mut opened = open(bench, virtual_bench.as_ref(), &clock, &cancel)?;
    let devices = serde_json::to_value(opened.describe(&clock)?)?;
    let mut kinematics = Kinematics::new(bench);
    kinematics.travel_deg = travel_of(&devices);
    let list = tasks(bench, &kinematics, all);
    let Tasks { tasks: all_tasks, unreachable, missing, .. } = &list;
    let directions = all_tasks.iter().filter(|task| task.part == Part::Direction).count();
    if directions == 0 {
        bail!(
            "{}: the bench reaches none of {} directions: look at [reach] and at the axes (one without [axis.azimuth] measures in the plane of incidence alone: sunglint brdf plan --rig)",
            args.plan.display(),
            all.len()
        );
    }
    let virtual_text = bench.virtual_bench.as_ref().map(Document::source);
    let files =
        [(PLAN, Some(plan_text)), (BENCH, Some(bench.source.as_str())), (VIRTUAL, virtual_text)];
    let mut log: Log = rig::log(folder, begun.as_ref(), &files, clock.clone(), &devices)?;
    for what in missing {
        console.warn(&format!("not measured: {what}"));
    }
    if !unreachable.is_empty() {
        let first = unreachable[0];
        console.warn(&format!(
            "{} of {} directions are out of the bench's reach, the first θ_i {:.2}°, θ_o {:.2}°, φ_o {:.2}°",
            unreachable.len(),
            all.len(),
            first.theta_i_deg,
            first.theta_o_deg,
            first.phi_o_deg
        ));
    }
    let finished = done(before).len();
    let left = all_tasks.len().saturating_sub(finished);
    console.say(&format!(
        "{left} of {} measurements are left, about {} (settling, readings, axes)",
        all_tasks.len(),
        hours(list.estimate_s * left as f64 / all_tasks.len() as f64)
    ));
    let bar = Arc::new(Bar::new(console));
    bar.begin("run", Some(left as u64));
    let places = [all_tasks.len() as u64, finished as u64];
    let page =
        LabPage::start(args.page.as_deref(), folder, "angle of the detector", places, console)?;
    let live = Box::new(Live { bar: bar.clone(), console, step });
    log.watch(LabPage::watch(page.as_ref(), live, reading, &cancel));
    let mut person =
        rig::Person { args: args.hands.clone(), asking, cancel: cancel.clone(), console, words };
    let mut robot = virtual_bench.map(Robot);
    let hands: &mut dyn Hands = match &mut robot {
        Some(robot) => robot,
        None => &mut person,
    };
    let Opened { stages, meter } = &mut opened;
    let stages = stages
        .each_mut()
        .map(|stage| stage.as_mut().map(|stage| stage.as_mut() as &mut dyn RotationStage));
    let began_s = clock.clock.now().as_secs_f64();
    let mut bench_rig = Rig { stages, meter: meter.as_mut(), hands, clock: clock.clone(), cancel };
    let result = measure(&mut bench_rig, bench, all_tasks, before, zero_s, &mut log);
    if let Some(page) = &page {
        page.end(if result.is_ok() { "done" } else { "stopped" });
    }
    bar.end();
    let kept = done(&log.lines);
    let measured = kept.iter().filter(|(part, _)| *part == Part::Direction).count();
    if let Err(error) = result {
        let (folder, kept) = (folder.display(), kept.len());
        return Err(anyhow!(error)).with_context(|| {
            format!(
                "the run cannot go on; the motors are stopped, {kept} measurements ({measured} of {directions} directions) are safe in {folder}: go on with --resume"
            )
        });
    }
    rig::end(&mut log)?;
    Ok(RunSummary {
        run: folder.display().to_string(),
        directions,
        measured,
        unreachable: unreachable.len(),
        measurements: kept.len(),
        readings: log.lines.iter().filter(|line| line.state.is_reading()).count(),
        took_s: clock.clock.now().as_secs_f64() - began_s,
        estimate_s: list.estimate_s,
        moving_s: list.moving_s,
        unordered_moving_s: list.unordered_s,
        missing: missing.clone(),
    })
}
