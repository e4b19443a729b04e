//! `sunglint efficiency run`: a monochromator, a photodiode and a detector driven through a plan.

use super::open::{self, AnyMeter, Robot};
use crate::brdf::rig::{self, Live, describe};
use crate::output::{Console, OutputArgs};
use crate::progress::Bar;
use anyhow::{Context as _, anyhow, bail};
use clap::Args;
use serde::Serialize;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use sunglint_calibration::efficiency::reduce_run;
use sunglint_detectors::efficiency::{
    Begun, FILES, Line, Log, Made, PLAN, Part, RUN, Rig, RunPlan, Step, VIRTUAL_RIG, done, measure,
    visits, write,
};
use sunglint_detectors::reading::{Pace, Photodiode};
use sunglint_drivers::clock::Cancel;
use sunglint_drivers::device::{Device, FilterWheel, Monochromator, PhotonCounter};
use sunglint_formats::text::counted;
use sunglint_formats::toml::Document;
use sunglint_materials::reading::State;
use sunglint_materials::retro::measure::Hands;
use sunglint_numerics::progress::Progress as _;
use sunglint_report::efficiency as report;
use sunglint_virtual::counting::devices::VirtualCounting;
use sunglint_virtual::counting::options::Options;

/// Arguments of `sunglint efficiency run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// The plan: devices, wavelengths, and what is known of the rig (docs/lab-efficiency.md)
    #[arg(value_name = "PLAN.toml")]
    pub plan: PathBuf,
    /// Go on with the run in the folder: what is there is not measured again
    #[arg(long)]
    pub resume: bool,
    /// Measure nothing: make the efficiency of what the folder holds, with what PLAN.toml knows now of the rig
    #[arg(long, conflicts_with = "resume")]
    pub reduce: bool,
    /// Who puts things into the beam.
    #[command(flatten)]
    pub hands: rig::HandsArgs,
    /// Where the result goes: one folder, with the readings in it.
    #[command(flatten)]
    pub out: OutputArgs,
}

pub(super) fn run(args: &RunArgs, console: Console) -> anyhow::Result<()> {
    let (folder, out) = rig::folder(&args.out, "id400")?;
    let folder = folder.as_path();
    out.check()?;
    let results = ["ecsv", "csv", "png", "svg"].map(|form| format!("efficiency.{form}"));
    out.check_names(&results)?;
    let document = Document::read(&args.plan)?;
    let goes_on = args.resume || args.reduce;
    let begun: Option<Begun> =
        rig::begun(folder, goes_on, &FILES, "its wavelength is read again", console)?;
    // A run goes on with the rig that it was begun with.
    let rig_text = begun.as_ref().and_then(|begun| begun.file(VIRTUAL_RIG));
    let plan = RunPlan::new(&document, rig_text)?;
    if let Some(begun) = &begun {
        check_same(args, &plan, begun, folder, rig_text)?;
    }
    let (lines, took_s) = match begun {
        Some(begun) if args.reduce => (begun.lines, 0.0),
        begun => take(args, &plan, folder, begun, console)?,
    };
    let made = write(&plan, &lines, folder).with_context(|| folder.display().to_string())?;
    for warning in &made.warnings {
        console.warn(warning);
    }
    let planned = plan.measuring.wavelengths.len();
    let left = planned - made.steps;
    if left > 0 {
        let left = counted(left, "wavelength");
        console.warn(&format!("{left} of {planned} not measured yet: go on with --resume"));
    }
    let found = reduce_run(&folder.join(RUN))?;
    let mut product = report::product(&found);
    product.json["run"] = serde_json::to_value(RunJson {
        folder: folder.display().to_string(),
        steps: made.steps,
        steps_left: left,
        readings: lines.iter().filter(|line| line.state.is_reading()).count(),
        took_s,
        photodiode_noise: made.noise,
        light_unrest: made.unrest,
        lamp_range: made.lamp_range,
        drift: made.drift.as_ref().map(|drift| DriftJson {
            readings: drift.readings(),
            range: drift.range(),
            corrected: drift.is_corrected(),
            hidden: drift.hidden(),
            steps: drift.steps(),
        }),
        warnings: &made.warnings,
    })?;
    if let (Some(drift), Some(figure)) = (&made.drift, &mut product.figure) {
        let readings: Vec<(f64, f64, f64)> =
            drift.points().iter().map(|p| (p.time_s, p.ln, p.sigma)).collect();
        report::draw_reference(figure, &readings, &|time_s| drift.at(time_s).relative);
    }
    let mut text = report::text(&found);
    text += &reference(&made);
    super::finish(&out, &found, product, &text, console)
}

/// A run with documented keys.
#[derive(Serialize)]
struct RunJson<'a> {
    folder: String,
    steps: usize,
    steps_left: usize,
    readings: usize,
    took_s: f64,
    photodiode_noise: f64,
    light_unrest: f64,
    lamp_range: f64,
    drift: Option<DriftJson>,
    warnings: &'a [String],
}

#[derive(Serialize)]
struct DriftJson {
    readings: usize,
    range: f64,
    corrected: bool,
    hidden: f64,
    steps: Vec<Step>,
}

/// The reference as a line of the text.
fn reference(made: &Made) -> String {
    let Some(drift) = &made.drift else { return String::new() };
    let (range, lamp) = (100.0 * drift.range(), 100.0 * made.lamp_range);
    let then = match drift.is_corrected() {
        true => "a drift, which is undone".to_owned(),
        false => format!("no drift told; it may hide {:.2} %", 100.0 * drift.hidden()),
    };
    let readings = counted(drift.readings(), "reading");
    format!(
        "reference {readings}: efficiency within {range:.2} %, lamp within {lamp:.1} %; {then}\n"
    )
}

/// Refuses to go on with another plan than that with which the run was begun.
fn check_same(
    args: &RunArgs,
    plan: &RunPlan,
    begun: &Begun,
    folder: &Path,
    rig_text: Option<&str>,
) -> anyhow::Result<()> {
    let text = rig::kept(begun, PLAN, folder)?;
    // Its curves lie where the plan's do.
    let old = Document::new(args.plan.with_file_name(PLAN), text)?;
    let old = RunPlan::new(&old, rig_text)?;
    if old.measuring != plan.measuring {
        bail!(
            "{}: devices, wavelengths, filters or exposures are not those with which the run in {} was begun (its {PLAN}): go on with that file",
            args.plan.display(),
            folder.display()
        );
    }
    Ok(())
}

struct Opened {
    monochromator: Box<dyn Monochromator>,
    meter: AnyMeter,
    counter: Box<dyn PhotonCounter>,
    wheel: Option<Box<dyn FilterWheel>>,
}

fn open(
    plan: &RunPlan,
    virtual_rig: Option<&VirtualCounting>,
    pace: &Pace,
) -> anyhow::Result<Opened> {
    let measuring = &plan.measuring;
    let wheel = measuring.wheel.as_ref();
    if let Some(rig) = virtual_rig {
        return Ok(Opened {
            monochromator: Box::new(rig.monochromator()),
            meter: AnyMeter::Meter(Box::new(rig.photodiode())),
            counter: Box::new(rig.counter()),
            wheel: wheel.map(|_| Box::new(rig.wheel()) as Box<dyn FilterWheel>),
        });
    }
    let (monochromator, meter) = (&measuring.monochromator, &measuring.meter);
    Ok(Opened {
        monochromator: open::monochromator(&monochromator.device, &monochromator.with, pace)?,
        meter: open::meter(&meter.device, &meter.with, meter.unit, pace)?,
        counter: open::counter(&measuring.counter, pace)?,
        wheel: wheel.map(|wheel| open::wheel(&wheel.device, &wheel.with, pace)).transpose()?,
    })
}

impl Opened {
    /// Who the devices say they are, with all their settings.
    fn describe(&mut self, pace: &Pace) -> anyhow::Result<Devices> {
        let meter: &mut dyn Device = match &mut self.meter {
            AnyMeter::Meter(meter) => meter.as_mut(),
            AnyMeter::Power(meter) => meter.as_mut(),
        };
        let says = |device: &mut dyn Device| describe(device, &pace.clock);
        Ok(Devices {
            monochromator: says(self.monochromator.as_mut())?,
            meter: says(meter)?,
            counter: says(self.counter.as_mut())?,
            wheel: self.wheel.as_mut().map(|wheel| says(wheel.as_mut())).transpose()?,
        })
    }
}

#[derive(Serialize)]
struct Devices {
    monochromator: Value,
    meter: Value,
    counter: Value,
    #[serde(skip_serializing_if = "Option::is_none")]
    wheel: Option<Value>,
}

/// A line that ends a place, in words.
fn step(line: &Line) -> Option<String> {
    (line.state == State::Kept).then(|| match line.part {
        Part::Dark => "dark".to_owned(),
        part => format!("{} {:.2} nm", part.name(), line.wavelength_nm),
    })
}

/// Measures what is missing.
fn take(
    args: &RunArgs,
    plan: &RunPlan,
    folder: &Path,
    begun: Option<Begun>,
    console: Console,
) -> anyhow::Result<(Vec<Line>, f64)> {
    let cancel = Cancel::new();
    let asking = Arc::new(AtomicBool::new(false));
    rig::listen(&cancel, &asking, console)?;
    let before = begun.as_ref().map_or(&[][..], |begun| &begun.lines);
    let read = before.iter().filter(|line| line.state.is_reading()).count();
    let virtual_rig = match &plan.rig {
        None => None,
        Some(rig) => Some(VirtualCounting::new(Options::read(rig)?, read as u64)?),
    };
    let (clock, zero_s) = rig::clock(virtual_rig.is_some(), begun.as_ref());
    let pace = Pace { clock: clock.clone(), cancel };
    // A device that is not there leaves no run behind.
    args.hands.check(virtual_rig.is_some())?;
    let mut opened = open(plan, virtual_rig.as_ref(), &pace)?;
    let devices = opened.describe(&pace)?;
    let rig_text = plan.rig.as_ref().map(Document::source);
    let files = [(PLAN, Some(plan.source.as_str())), (VIRTUAL_RIG, rig_text)];
    let mut log: Log = rig::log(folder, begun.as_ref(), &files, clock, &devices)?;
    let places = visits(&plan.measuring);
    let finished = done(before);
    let left = places.iter().filter(|v| !finished.contains(&(v.part, v.number))).count();
    console.say(&format!(
        "{left} of {} left (dark, reference, wavelengths)",
        counted(places.len(), "place")
    ));
    let bar = Arc::new(Bar::new(console));
    bar.begin("run", Some(left as u64));
    log.watch(Box::new(Live { bar: bar.clone(), console, step }));
    let mut person = rig::Person {
        args: args.hands.clone(),
        asking,
        cancel: pace.cancel.clone(),
        console,
        words: open::words,
    };
    let mut robot = virtual_rig.map(Robot);
    let hands: &mut dyn Hands = match &mut robot {
        Some(robot) => robot,
        None => &mut person,
    };
    let began_s = pace.now_s();
    let Opened { monochromator, meter, counter, wheel } = &mut opened;
    let mut bench = Rig {
        monochromator: monochromator.as_mut(),
        photodiode: match meter {
            AnyMeter::Meter(meter) => Photodiode::Meter(meter.as_mut()),
            AnyMeter::Power(meter) => Photodiode::Power(meter.as_mut()),
        },
        counter: counter.as_mut(),
        wheel: match wheel {
            Some(wheel) => Some(wheel.as_mut()),
            None => None,
        },
        hands,
        pace: pace.clone(),
    };
    let result = measure(&mut bench, &plan.measuring, &places, before, zero_s, &mut log);
    bar.end();
    if let Err(error) = result {
        let kept = done(&log.lines);
        let steps = kept.iter().filter(|(part, _)| *part == Part::Step).count();
        let folder = folder.display();
        return Err(anyhow!(error)).with_context(|| {
            format!(
                "the run cannot go on; {steps} of {} are safe in {folder}: go on with --resume, or make the efficiency of them with --reduce",
                counted(plan.measuring.wavelengths.len(), "wavelength")
            )
        });
    }
    rig::end(&mut log)?;
    Ok((std::mem::take(&mut log.lines), pace.now_s() - began_s))
}
