//! A run's folder as BRDF values, with nothing else beside it.

use super::bench::{Bench, BenchError};
use super::line::{BENCH, Begun, FILES, PLAN, VIRTUAL};
use super::pose::Kinematics;
use super::reduce::{GoniometerError, Reduced, reduce};
use super::tasks::{Tasks, tasks};
use crate::log::{LogError, READINGS};
use crate::plan::planned;
use serde_json::{Value, json};
use std::path::Path;
use sunglint_formats::toml::Document;
use sunglint_formats::{FileError, ParseError, ecsv};
use sunglint_numerics::measured::Interval;
use sunglint_radiometry::light_curve::Input;

/// Why a folder has no values.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FolderError {
    /// Files that are not those of a run.
    #[error(transparent)]
    Log(#[from] LogError),
    /// A bench that cannot be used.
    #[error(transparent)]
    Bench(#[from] BenchError),
    /// A plan that cannot be read.
    #[error(transparent)]
    Parse(#[from] ParseError),
    /// A file that cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// A file that it does not hold.
    #[error("{folder}: {file} is missing; the folder of a run holds it")]
    NoFile {
        /// The folder.
        folder: String,
        /// The file.
        file: &'static str,
    },
    /// Readings that are no values.
    #[error("{folder}")]
    Reduce {
        /// The folder.
        folder: String,
        /// Why.
        source: GoniometerError,
    },
}

/// A run that was begun: its bench, its plan, what it measures, and what it has.
#[derive(Debug, Clone)]
pub struct Run {
    /// The bench.
    pub bench: Bench,
    /// The axes, with the travel of the stages where it is known.
    pub kinematics: Kinematics,
    /// All that it measures.
    pub tasks: Tasks,
    /// Whether the plan is of a quarter of the circle.
    pub quarter: bool,
    /// Readings so far.
    pub begun: Begun,
}

/// True where a folder holds the run of a goniometer.
#[must_use]
pub fn is_run(folder: &Path) -> bool {
    folder.is_dir() && folder.join(BENCH).is_file() && folder.join(READINGS).is_file()
}

/// Travel of the stages, as an event of the run says it: a list of four, each `null` or two angles.
#[must_use]
pub fn travel_of(devices: &Value) -> [Option<Interval>; 4] {
    let one = |k: usize| {
        let ends = devices["travel_deg"].get(k)?;
        Some(Interval::new(ends.get(0)?.as_f64()?, ends.get(1)?.as_f64()?))
    };
    [one(0), one(1), one(2), one(3)]
}

/// Reads a run's folder.
///
/// # Errors
/// Files that it lacks, or that are not those of a run.
pub fn read(folder: &Path) -> Result<Run, FolderError> {
    let begun = Begun::read(folder, &FILES)?;
    let lacks =
        |file: &'static str| FolderError::NoFile { folder: folder.display().to_string(), file };
    let text = begun.file(BENCH).ok_or_else(|| lacks(BENCH))?;
    let document = Document::new(folder.join(BENCH), text)?;
    let bench = Bench::new(&document, begun.file(VIRTUAL))?;
    let plan = begun.file(PLAN).ok_or_else(|| lacks(PLAN))?;
    let path = folder.join(PLAN);
    let (all, quarter) = planned(&path, &ecsv::read_str(&path, plan)?)?;
    let mut kinematics = Kinematics::new(&bench);
    kinematics.travel_deg = travel_of(&begun.devices);
    let tasks = tasks(&bench, &kinematics, &all);
    Ok(Run { bench, kinematics, tasks, quarter, begun })
}

/// Values of a run's folder, whole or not.
///
/// # Errors
/// Files that are not those of a run, readings that are no values.
pub fn ingest(folder: &Path) -> Result<(Reduced, Vec<Input>), FolderError> {
    let Run { bench, kinematics, tasks, begun, .. } = read(folder)?;
    let name = || folder.display().to_string();
    let mut reduced =
        reduce(&begun.lines, &bench, &kinematics, &tasks.tasks, &tasks.missing, &tasks.unreachable)
            .map_err(|source| FolderError::Reduce { folder: name(), source })?;
    if begun.torn_bytes > 0 {
        reduced.warnings.push(format!(
            "{}: a last line of {} bytes was cut off as it was written; it does not count",
            name(),
            begun.torn_bytes
        ));
    }
    let readings = folder.join(READINGS);
    let sha256 = sunglint_formats::sha256(&sunglint_formats::read::bytes(&readings)?);
    let inputs = vec![Input { file: readings.display().to_string(), sha256 }];
    let meta = &mut reduced.samples.meta;
    meta.insert("inputs".into(), json!(inputs));
    meta.insert("sample".into(), json!(bench.name));
    Ok((reduced, inputs))
}
