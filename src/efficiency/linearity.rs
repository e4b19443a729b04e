//! `sunglint efficiency linearity`: a detector's dead time from steps of light.

use super::open;
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
use sunglint_calibration::detector::fit::fit;
use sunglint_detectors::linearity::{
    Begun, FILES, LAW, LINEARITY, Line, LinearityPlan, Log, PLAN, Rig, VIRTUAL_RIG, exposures,
    law_toml, measure, places, table_csv,
};
use sunglint_detectors::reading::Pace;
use sunglint_drivers::clock::Cancel;
use sunglint_drivers::device::{Device, FilterWheel, PhotonCounter, Source};
use sunglint_formats::text::counted;
use sunglint_formats::toml::Document;
use sunglint_numerics::progress::Progress as _;
use sunglint_report::linearity as report;
use sunglint_virtual::counting::devices::VirtualCounting;
use sunglint_virtual::counting::options::Options;

/// Arguments of `sunglint efficiency linearity`.
#[derive(Debug, Args)]
pub struct LinearityArgs {
    /// The plan: counter, sources, wheel with its filters (docs/lab-efficiency.md)
    #[arg(value_name = "PLAN.toml")]
    pub plan: PathBuf,
    /// Go on with the run in the folder: what is there is not measured again
    #[arg(long)]
    pub resume: bool,
    /// Measure nothing: fit what the folder holds, with what PLAN.toml knows now of the filters
    #[arg(long, conflicts_with = "resume")]
    pub reduce: bool,
    /// Where the result goes: one folder, with the readings in it.
    #[command(flatten)]
    pub out: OutputArgs,
}

pub(super) fn run(args: &LinearityArgs, console: Console) -> anyhow::Result<()> {
    let (folder, out) = rig::folder(&args.out, "linearity")?;
    let folder = folder.as_path();
    out.check()?;
    let results = ["linearity.ecsv", "linearity.png", "linearity.svg", LAW, LINEARITY];
    out.check_names(&results)?;
    let document = Document::read(&args.plan)?;
    let goes_on = args.resume || args.reduce;
    let begun: Option<Begun> =
        rig::begun(folder, goes_on, &FILES, "it is measured again", console)?;
    let rig_text = begun.as_ref().and_then(|begun| begun.file(VIRTUAL_RIG));
    let plan = LinearityPlan::new(&document, rig_text)?;
    if let Some(begun) = &begun {
        let text = rig::kept(begun, PLAN, folder)?;
        let old = LinearityPlan::new(&Document::new(folder.join(PLAN), text)?, rig_text)?;
        if !old.same(&plan) {
            bail!(
                "{}: counter, sources, slots or exposures are not those with which the run in {} was begun (its {PLAN}): go on with that file",
                args.plan.display(),
                folder.display()
            );
        }
    }
    let lines = match begun {
        Some(begun) if args.reduce => begun.lines,
        begun => take(&plan, folder, begun, console)?,
    };
    let all = exposures(&plan, &lines);
    let choice = fit(&all, &plan.transmissions(), plan.pixels)
        .with_context(|| folder.display().to_string())?;
    let mut files = Vec::new();
    match law_toml(&choice) {
        Some(text) => {
            files.push((folder.join(LAW), text.into_bytes()));
            let table = choice.left.first().map(|k| &choice.fitted[*k]);
            if let Some(fitted) = table {
                let text = table_csv(&plan.name, &choice, fitted);
                files.push((folder.join(LINEARITY), text.into_bytes()));
            }
        }
        None => console.warn(
            "no law fits the counts: no keys for a station; look at the filters' densities, at stray light, and at whether the source holds still",
        ),
    }
    let product = report::product(&plan.name, &choice, &all);
    out.finish_with(&product, files, &report::text(&choice), console)
}

struct Opened {
    counter: Box<dyn PhotonCounter>,
    wheel: Option<Box<dyn FilterWheel>>,
    sources: Vec<Box<dyn Source>>,
}

fn open(
    plan: &LinearityPlan,
    virtual_rig: Option<&VirtualCounting>,
    pace: &Pace,
) -> anyhow::Result<Opened> {
    if let Some(rig) = virtual_rig {
        let wheel = plan.wheel.as_ref().map(|_| Box::new(rig.wheel()) as Box<dyn FilterWheel>);
        let source = |k| Box::new(rig.source(k)) as Box<dyn Source>;
        let sources = (0..plan.sources.len()).map(source).collect();
        return Ok(Opened { counter: Box::new(rig.counter()), wheel, sources });
    }
    let wheel = plan.wheel.as_ref();
    let sources = plan.sources.iter().map(|s| open::source(&s.device, &s.with, pace));
    Ok(Opened {
        counter: open::counter(&plan.counter, pace)?,
        wheel: wheel.map(|wheel| open::wheel(&wheel.device, &wheel.with, pace)).transpose()?,
        sources: sources.collect::<anyhow::Result<_>>()?,
    })
}

/// Who the devices say they are, with all their settings.
#[derive(Serialize)]
struct Devices {
    counter: Value,
    #[serde(skip_serializing_if = "Option::is_none")]
    wheel: Option<Value>,
    sources: Vec<Value>,
}

/// Measures what is missing.
fn take(
    plan: &LinearityPlan,
    folder: &Path,
    begun: Option<Begun>,
    console: Console,
) -> anyhow::Result<Vec<Line>> {
    let cancel = Cancel::new();
    rig::listen(&cancel, &Arc::new(AtomicBool::new(false)), console)?;
    let before = begun.as_ref().map_or(&[][..], |begun| &begun.lines);
    let virtual_rig = match &plan.rig {
        None => None,
        Some(rig) => Some(VirtualCounting::new(Options::read(rig)?, before.len() as u64)?),
    };
    let (clock, zero_s) = rig::clock(virtual_rig.is_some(), begun.as_ref());
    let pace = Pace { clock: clock.clone(), cancel };
    // A device that is not there leaves no run behind.
    let mut opened = open(plan, virtual_rig.as_ref(), &pace)?;
    let says = |device: &mut dyn Device| describe(device, &pace.clock);
    let devices = Devices {
        counter: says(opened.counter.as_mut())?,
        wheel: opened.wheel.as_mut().map(|wheel| says(wheel.as_mut())).transpose()?,
        sources: opened.sources.iter_mut().map(|s| says(s.as_mut())).collect::<Result<_, _>>()?,
    };
    let rig_text = plan.rig.as_ref().map(Document::source);
    let files = [(PLAN, Some(plan.source.as_str())), (VIRTUAL_RIG, rig_text)];
    let mut log: Log = rig::log(folder, begun.as_ref(), &files, clock, &devices)?;
    let all = places(plan).len() * plan.repeats as usize;
    let left = all.saturating_sub(before.len());
    console.say(&format!("{left} of {} left", counted(all, "exposure")));
    let bar = Arc::new(Bar::new(console));
    bar.begin("run", Some(left as u64));
    let step = |line: &Line| Some(format!("light {}", line.number));
    log.watch(Box::new(Live { bar: bar.clone(), console, step }));
    let Opened { counter, wheel, sources } = &mut opened;
    let mut bench = Rig {
        counter: counter.as_mut(),
        wheel: match wheel {
            Some(wheel) => Some(wheel.as_mut()),
            None => None,
        },
        sources: sources.iter_mut().map(|s| s.as_mut() as &mut dyn Source).collect(),
        pace,
    };
    let result = measure(&mut bench, plan, before, zero_s, &mut log);
    bar.end();
    if let Err(error) = result {
        let (folder, kept) = (folder.display(), log.lines.len());
        return Err(anyhow!(error)).with_context(|| {
            format!(
                "the run cannot go on; {kept} of {} are safe in {folder}: go on with --resume",
                counted(all, "exposure")
            )
        });
    }
    rig::end(&mut log)?;
    Ok(std::mem::take(&mut log.lines))
}
