//! `sunglint study`: a scene simulated for many values of its keys, and for the passes of many objects.

use crate::output::{Console, Usage};
use crate::station::StationArgs;
use clap::Args;
use std::path::PathBuf;

/// Arguments of `sunglint study`.
#[derive(Debug, Args)]
pub struct StudyArgs {
    /// The study: a scene, parameters, objects, what is kept (docs/study.md)
    #[arg(value_name = "STUDY.toml")]
    pub study: PathBuf,
    /// The results' folder; what is there of the same study is kept, and the rest made [default: the study's name]
    #[arg(short, long, value_name = "FOLDER")]
    pub output: Option<PathBuf>,
    /// Only the K-th of N parts, for schedulers: 3/50
    #[arg(long, value_name = "K/N")]
    pub part: Option<String>,
    /// Say what there is to do, and do nothing
    #[arg(long, conflicts_with_all = ["part", "slurm", "slurm_script"])]
    pub check: bool,
    /// Run the parts as job arrays of Slurm, and wait for them; to end it, press Ctrl-C first, then scancel the job
    #[arg(long, conflicts_with = "part")]
    pub slurm: bool,
    /// Only write the batch script into the folder, as study.sbatch
    #[arg(long, conflicts_with_all = ["part", "slurm"])]
    pub slurm_script: bool,
    /// Tasks of the array at most, each of a minute or more; less than Slurm's MaxArraySize
    #[arg(long, value_name = "N", default_value_t = 50)]
    pub slurm_tasks: usize,
    /// Tasks that run at the same time, at most [default: as many as Slurm starts]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub slurm_at_once: Option<u32>,
    /// An option of sbatch, such as --partition=long; may be given several times
    #[arg(long, value_name = "OPTION", allow_hyphen_values = true)]
    pub slurm_option: Vec<String>,
    /// Which station, in place of the scene's.
    #[command(flatten)]
    pub station: StationArgs,
}

/// Says how to get a program with studies.
#[cfg(not(feature = "study"))]
pub fn run(_: &StudyArgs, _: Option<u16>, _: Console) -> anyhow::Result<()> {
    Err(Usage(
        "this program was built without studies: cargo build --release --features study".into(),
    )
    .into())
}

#[cfg(feature = "study")]
pub use with::run;

#[cfg(feature = "study")]
mod with {
    use super::{Console, StudyArgs, Usage};
    use crate::progress::Watched;
    use crate::station::{StationArgs, VARIABLE};
    use anyhow::Context as _;
    use serde::Serialize;
    use std::path::{Path, PathBuf};
    use std::time::Instant;
    use sunglint_formats::text::counted;
    use sunglint_radiometry::station::Station;
    use sunglint_study::run::{self, Part, Ran};
    use sunglint_study::slurm::{self, Array};
    use sunglint_study::{Stations, Study};

    /// Failed tasks that are named at most.
    const NAMED: usize = 5;

    #[derive(Serialize)]
    struct Checked<'a> {
        study: &'a str,
        points: usize,
        tasks: usize,
        shards: usize,
        parameters: &'a [String],
    }

    #[derive(Serialize)]
    struct Script {
        script: String,
        parts: usize,
    }

    /// Runs a study, or a part of it.
    pub fn run(args: &StudyArgs, threads: Option<u16>, console: Console) -> anyhow::Result<()> {
        let part = match &args.part {
            Some(text) => slurm::part(text).map_err(|e| Usage(format!("--part: {e}")))?,
            None => Part::ALL,
        };
        let stations = Stations {
            instead: args.station.station.is_some().then(|| args.station.get()).transpose()?,
            usual: args.station.find()?,
        };
        let study = Study::read(&args.study, stations)?;
        for warning in study.warnings.iter().chain(study.left_out.iter().take(NAMED)) {
            console.warn(warning);
        }
        if let Some(more) = study.left_out.len().checked_sub(NAMED).filter(|more| *more > 0) {
            console.warn(&format!("{more} more sets of elements are left out"));
        }
        let folder = args.output.clone().unwrap_or_else(|| PathBuf::from(&study.name));
        if args.check {
            let json = Checked {
                study: &study.name,
                points: study.points.len(),
                tasks: study.tasks(),
                shards: study.shards(),
                parameters: &study.parameters,
            };
            return console.result(&plan(&study, &folder), &json);
        }
        let watched = Watched::new(console)?;
        let start = Instant::now();
        if args.slurm || args.slurm_script {
            let array = array(args, threads, &folder)?;
            let at_once = args.slurm_at_once.map_or(String::new(), |n| format!("%{n}"));
            if args.slurm_script {
                let script = array.write(&study, &folder)?;
                let text = format!(
                    "{}: sbatch --array=1-{}{at_once} {0}",
                    script.display(),
                    array.parts(&study)
                );
                let script = script.display().to_string();
                let json = Script { script, parts: array.parts(&study) };
                return console.result(&text, &json);
            }
            let submitted = array.submit(&study, &folder, &watched);
            watched.bar.end();
            submitted?;
        }
        let ran = run::run(&study, &folder, part, &watched);
        watched.bar.end();
        let ran = ran?;
        console.result(&told(&ran, &folder, start.elapsed().as_secs_f64()), &ran.report)
    }

    /// The array of Slurm that makes a study: this program, with paths that every node finds.
    fn array(args: &StudyArgs, threads: Option<u16>, folder: &Path) -> anyhow::Result<Array> {
        let text = |path: &Path| -> anyhow::Result<String> {
            let whole = std::path::absolute(path).with_context(|| path.display().to_string())?;
            let shown = whole.display().to_string();
            whole.into_os_string().into_string().map_err(|_| {
                Usage(format!("{shown} is not UTF-8: a batch script cannot name it")).into()
            })
        };
        let program = std::env::current_exe().context("cannot find this program's own file")?;
        let mut command = vec![text(&program)?, "study".into(), text(&args.study)?];
        command.extend(["--quiet".into(), "-o".into(), text(folder)?]);
        let found = |name: &str| -> anyhow::Result<String> {
            let path = Path::new(name);
            let is_file = Station::built_in(name).is_none() && path.exists();
            if is_file { text(path) } else { Ok(name.to_owned()) }
        };
        if let Some(station) = &args.station.station {
            command.extend(["--station".into(), found(station)?]);
        } else if let Some(usual) = StationArgs::around() {
            // What this shell and folder say, a task's need not.
            let told = format!("{VARIABLE}={}", found(&usual)?);
            command.splice(..0, ["env".into(), told]);
        }
        Ok(Array {
            submit: "sbatch".into(),
            queue: "squeue".into(),
            command,
            threads,
            tasks: args.slurm_tasks,
            at_once: args.slurm_at_once.map(|n| n as usize),
            grace: slurm::GRACE,
            options: args.slurm_option.clone(),
        })
    }

    fn plan(study: &Study, folder: &Path) -> String {
        let objects = match &study.passes {
            Some(passes) => format!(" for {}", counted(passes.objects.len(), "object")),
            None => String::new(),
        };
        let missing = run::missing(study, folder).len();
        format!(
            "{}: {}{objects} in {}, {} to be made; the first: {}",
            study.name,
            counted(study.points.len(), "point"),
            counted(study.shards(), "shard"),
            missing,
            study.describe(0)
        )
    }

    fn told(ran: &Ran, folder: &Path, seconds: f64) -> String {
        let report = &ran.report;
        let rows: u64 = report.files.iter().map(|f| f.rows).sum();
        let bytes: u64 = report.files.iter().map(|f| f.bytes).sum();
        let mut text = format!(
            "{}: {} made in {seconds:.1} s, {} there before; {}, {:.2} MB in {}",
            report.study,
            counted(ran.made, "shard"),
            ran.found,
            counted(usize::try_from(rows).unwrap_or(usize::MAX), "row"),
            bytes as f64 / 1e6,
            folder.display()
        );
        if report.failed > 0 {
            let failed = usize::try_from(report.failed).unwrap_or(usize::MAX);
            text.push_str(&format!(
                "\n{} failed: rows with status = \"failed\" say why",
                counted(failed, "task")
            ));
        }
        match (&ran.manifest, &report.part) {
            (Some(path), _) => text.push_str(&format!("\nall is there: {}", path.display())),
            (None, Some(part)) => text.push_str(&format!(
                "\npart {part} is there; a run without --part writes the manifest"
            )),
            (None, None) => {
                text.push_str(&format!("\n{} missing", counted(report.missing, "shard")))
            }
        }
        text
    }
}
