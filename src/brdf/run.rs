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
use sunglint_drivers::device::{
    Device, InBeam, Monochromator, PowerMeter, RotationStage, Spectrometer,
};
use sunglint_formats::ecsv;
use sunglint_formats::toml::Document;
use sunglint_materials::goniometer::bench::{AXES, Bench, VIRTUAL_BENCH};
use sunglint_materials::goniometer::channels::Reads;
use sunglint_materials::goniometer::files::Folder;
use sunglint_materials::goniometer::folder::travel_of;
use sunglint_materials::goniometer::line::{BENCH, Begun, FILES, Line, Log, PLAN, VIRTUAL};
use sunglint_materials::goniometer::measure::{Detector, Devices, done_of, measure_with};
use sunglint_materials::goniometer::pose::Kinematics;
use sunglint_materials::goniometer::spectra;
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
    let nm = line.wavelength_nm.map_or(String::new(), |nm| format!(", {nm} nm"));
    (line.state == State::Kept).then(|| format!("{} {}{nm}", line.part.name(), line.number))
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
        // Channels of a spectrometer have no power in W: the brightest is told beside its integration.
        power_w: line.power_w,
        range: match line.channels.iter().copied().reduce(f64::max).filter(|most| !most.is_nan()) {
            None => line.range.clone(),
            Some(most) if most.is_infinite() => format!("{} over range", line.range),
            Some(most) => format!("{} brightest channel {most:.4e}", line.range),
        },
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
    reads: OpenedDetector,
}

/// Detector of the run.
enum OpenedDetector {
    Meter(Box<dyn PowerMeter>),
    Monochromator(Box<dyn Monochromator>, Box<dyn PowerMeter>),
    Spectrometer(Box<dyn Spectrometer>),
    Files(Box<Folder>),
}

/// Where the files come that are waited for: beside the bench's file, or where a run that goes on looked for them.
fn files_folder(args: &RunArgs, bench: &Bench, begun: Option<&Begun>) -> anyhow::Result<PathBuf> {
    let Reads::Files(plan) = &bench.reads else { return Ok(PathBuf::new()) };
    let known = begun.and_then(|begun| begun.devices["files"]["folder"].as_str());
    let folder = match (known, &args.bench) {
        (Some(known), None) => PathBuf::from(known),
        (_, path) => {
            let beside = path.as_deref().and_then(Path::parent).unwrap_or(Path::new(""));
            beside.join(&plan.folder)
        }
    };
    std::path::absolute(&folder).with_context(|| format!("files.folder {}", folder.display()))
}

/// The devices that read the light. `files` is the folder into which files come, `folder` the run's.
fn open_detector(
    bench: &Bench,
    virtual_bench: Option<&VirtualGoniometer>,
    (files, folder, before): (&Path, &Path, &[Line]),
    within: &dyn Fn() -> Deadline,
) -> anyhow::Result<OpenedDetector> {
    let meter = || -> anyhow::Result<Box<dyn PowerMeter>> {
        let mut meter: Box<dyn PowerMeter> = match virtual_bench {
            Some(virtual_bench) => Box::new(virtual_bench.meter()),
            None => rig::meter(&bench.meter.device, &bench.meter.with, within)?,
        };
        meter.set_wavelength_nm(bench.wavelength_nm, &within())?;
        if let Some(range) = &bench.meter.range {
            meter.set_range(range, &within())?;
        }
        Ok(meter)
    };
    Ok(match &bench.reads {
        Reads::Meter => OpenedDetector::Meter(meter()?),
        Reads::Monochromator(plan) => {
            let monochromator: Box<dyn Monochromator> = match virtual_bench {
                Some(virtual_bench) => Box::new(virtual_bench.monochromator()),
                None => rig::monochromator(&plan.device, &plan.with, within)?,
            };
            if let Some(range) = monochromator.range_nm()
                && let Some(nm) =
                    plan.wavelengths_nm.iter().find(|nm| !(range.low..=range.high).contains(*nm))
            {
                bail!(
                    "monochromator.wavelengths_nm: the monochromator does not reach {nm} nm; it goes from {} to {} nm",
                    range.low,
                    range.high
                );
            }
            OpenedDetector::Monochromator(monochromator, meter()?)
        }
        Reads::Spectrometer(plan) => {
            let device: Box<dyn Spectrometer> = match virtual_bench {
                Some(virtual_bench) => Box::new(virtual_bench.spectrometer()),
                None => rig::spectrometer(&plan.device, &plan.with, within)?,
            };
            spectra::check(device.as_ref(), plan, &bench.bands)?;
            OpenedDetector::Spectrometer(device)
        }
        Reads::Files(plan) => {
            let folder = Folder::new(plan, &bench.bands, files, folder, before);
            OpenedDetector::Files(Box::new(folder.context("files.folder")?))
        }
    })
}

fn open(
    bench: &Bench,
    virtual_bench: Option<&VirtualGoniometer>,
    places: (&Path, &Path, &[Line]),
    clock: &DeviceClock,
    cancel: &Cancel,
) -> anyhow::Result<Opened> {
    let within = |time| Deadline::after(clock.clock.clone(), time).with_cancel(cancel);
    let mut stages: [Option<Box<dyn RotationStage>>; 4] = [None, None, None, None];
    for (k, axis) in bench.all_axes().into_iter().enumerate() {
        let Some(axis) = axis.filter(|axis| !axis.is_by_hand()) else { continue };
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
    let reads = open_detector(bench, virtual_bench, places, &|| within(OPEN))?;
    Ok(Opened { stages, reads })
}

impl Opened {
    /// Who the devices say they are, with all their settings, and how far the stages turn.
    fn describe(&mut self, clock: &DeviceClock) -> anyhow::Result<Described> {
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
        let mut detectors = Map::new();
        let mut add = |name: &str, device: &mut dyn Device| -> anyhow::Result<()> {
            detectors.insert(name.into(), rig::describe(device, clock)?);
            Ok(())
        };
        match &mut self.reads {
            OpenedDetector::Meter(meter) => add("meter", meter.as_mut())?,
            OpenedDetector::Monochromator(monochromator, meter) => {
                add("monochromator", monochromator.as_mut())?;
                add("meter", meter.as_mut())?;
            }
            OpenedDetector::Spectrometer(device) => add("spectrometer", device.as_mut())?,
            OpenedDetector::Files(files) => {
                let path = files.path().display().to_string();
                detectors.insert("files".into(), serde_json::json!({ "folder": path }));
            }
        }
        Ok(Described { axes, detectors, travel_deg })
    }
}

#[derive(Serialize)]
struct Described {
    #[serde(flatten)]
    axes: Map<String, Value>,
    #[serde(flatten)]
    detectors: Map<String, Value>,
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
    let by_hand =
        bench.all_axes().into_iter().position(|axis| axis.is_some_and(|a| a.is_by_hand()));
    if let Some(axis) = by_hand.filter(|_| args.hands.yes) {
        bail!(Usage(format!(
            "--yes: nobody would turn the axis `{}`, which is by hand: leave it out, or name a program that turns it (--hands)",
            AXES[axis]
        )));
    }
    let files = files_folder(args, bench, begun.as_ref())?;
    let places = (files.as_path(), folder, before);
    let mut opened = open(bench, virtual_bench.as_ref(), places, &clock, &cancel)?;
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
    let table = Line::header_of(bench);
    let mut log: Log =
        rig::log_with(folder, begun.as_ref(), &files, table, clock.clone(), &devices)?;
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
    let finished = done_of(before, bench).len();
    let left = all_tasks.len().saturating_sub(finished);
    console.say(&format!(
        "{left} of {} measurements are left, about {} (settling, readings, axes)",
        all_tasks.len(),
        hours(list.estimate_s * left as f64 / all_tasks.len() as f64)
    ));
    let bar = Arc::new(Bar::new(console));
    // A monochromator ends a step at each wavelength.
    let steps = match &bench.reads {
        Reads::Monochromator(_) => bench.bands.len(),
        _ => 1,
    };
    bar.begin("run", Some((left * steps) as u64));
    let places = [(all_tasks.len() * steps) as u64, (finished * steps) as u64];
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
    let Opened { stages, reads } = &mut opened;
    let stages = stages
        .each_mut()
        .map(|stage| stage.as_mut().map(|stage| stage.as_mut() as &mut dyn RotationStage));
    let began_s = clock.clock.now().as_secs_f64();
    let detector = match reads {
        OpenedDetector::Meter(meter) => Detector::Meter(meter.as_mut()),
        OpenedDetector::Monochromator(monochromator, meter) => {
            Detector::Monochromator(monochromator.as_mut(), meter.as_mut())
        }
        OpenedDetector::Spectrometer(device) => Detector::Spectrometer(device.as_mut()),
        OpenedDetector::Files(folder) => Detector::Files(folder),
    };
    let mut devices = Devices { stages, detector, hands, clock: clock.clone(), cancel };
    let result = measure_with(&mut devices, bench, all_tasks, before, zero_s, &mut log);
    if let Some(page) = &page {
        page.end(if result.is_ok() { "done" } else { "stopped" });
    }
    bar.end();
    let kept = done_of(&log.lines, bench);
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
