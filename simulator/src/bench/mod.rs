//! Error against time of the light engines, on one thread.

mod cases;
mod timing;

pub use timing::Timing;

use crate::light::{DirectionError, SceneError};
use crate::pass::{Pass, PassError};
use crate::scenes::{self, BenchSceneError};
use std::ops::ControlFlow;
use std::time::Duration;
use sunglint_formats::nearest_names;
use sunglint_numerics::progress::Progress;
use sunglint_radiometry::spectrum::SpectrumError;

/// One measurement takes this long at most.
const MOST_S: f64 = 3600.0;

/// Timing and error of one engine on one scene with one grid.
#[derive(Debug, Clone, PartialEq)]
pub struct BenchRow {
    /// The scene's name.
    pub scene: String,
    /// The engine's name.
    pub engine: &'static str,
    /// Bins of the spectrum; 1 for grey light.
    pub bins: usize,
    /// Facets of the scene.
    pub facets: usize,
    /// The time that one epoch takes.
    pub timing: Timing,
    /// Time to make the scene ready, s; `None` where it is part of the time for an epoch.
    pub prepare_s: Option<f64>,
    /// Σ|E−Ê|/ΣÊ; `None` without a truth.
    pub error: Option<f64>,
    /// Where the truth comes from: `closed form`, `stored` or `none`.
    pub error_source: &'static str,
    /// The engine's own estimate of its error; `None` where it has none.
    pub estimate: Option<f64>,
}

/// Measurements of light engines.
#[derive(Debug, Clone, PartialEq)]
pub struct Benchmark {
    /// One row for each engine, scene and grid.
    pub rows: Vec<BenchRow>,
    /// Name of the processor, where the system says it.
    pub processor: String,
}

/// Scenes that are measured, and for how long.
#[derive(Debug, Clone)]
pub struct BenchOptions {
    /// Built-in scenes, as [`find_scenes`] gives them.
    pub scenes: Vec<&'static str>,
    /// Scenes of one's own: the whole way from orbit to counts, and the light engine alone.
    pub passes: Vec<Pass>,
    /// Time to spend on measuring, s, above 0, shared by all rows; making the scenes comes on top.
    pub seconds: f64,
}

impl Default for BenchOptions {
    /// All built-in scenes in 30 s.
    fn default() -> Self {
        Self { scenes: scenes::NAMES.to_vec(), passes: Vec::new(), seconds: 30.0 }
    }
}

/// A scene that is not built in.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "there is no bench scene `{wanted}`; the scenes are {}{}",
    scenes::NAMES.join(", "),
    nearest.map_or(String::new(), |near| format!("; did you mean {near}?"))
)]
pub struct UnknownSceneError {
    /// The name that was asked for.
    pub wanted: String,
    /// The most similar one.
    pub nearest: Option<&'static str>,
}

/// Why nothing was measured.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BenchError {
    /// A built-in scene that cannot be measured.
    #[error("scene {name}")]
    Scene {
        /// The scene's name.
        name: &'static str,
        /// Why not.
        source: CaseError,
    },
    /// A scene of one's own that cannot be measured.
    #[error("{name}")]
    Pass {
        /// Index of the scene in the list, from 0.
        index: usize,
        /// Name of the scene.
        name: String,
        /// Why not.
        source: CaseError,
    },
    /// The caller wanted no more rows.
    #[error("stopped")]
    Stopped,
}

/// Why one scene cannot be measured.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CaseError {
    /// A built-in scene that is not there or not whole.
    #[error(transparent)]
    Built(#[from] BenchSceneError),
    /// A target that the light engine refuses.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A spectrum that is none.
    #[error(transparent)]
    Spectrum(#[from] SpectrumError),
    /// A direction that is none.
    #[error(transparent)]
    Direction(#[from] DirectionError),
    /// A pass that cannot be simulated.
    #[error(transparent)]
    Pass(#[from] PassError),
    /// No thread to measure on.
    #[error("cannot start a thread")]
    Thread(#[from] rayon::ThreadPoolBuildError),
    /// The caller wanted no more rows.
    #[error("stopped")]
    Stopped,
}

/// Takes rows as they are measured, and says whether to go on.
pub type EachRow<'a> = &'a mut dyn FnMut(&BenchRow) -> ControlFlow<()>;

/// Finds built-in scenes by their names: in the order of [`scenes::NAMES`], each once.
///
/// # Errors
/// A name that no scene has.
pub fn find_scenes(wanted: &[String]) -> Result<Vec<&'static str>, UnknownSceneError> {
    let find = |wanted: &String| {
        scenes::NAMES.into_iter().find(|name| name == wanted).ok_or_else(|| UnknownSceneError {
            wanted: wanted.clone(),
            nearest: nearest_names(wanted, scenes::NAMES, 1).first().copied(),
        })
    };
    let mut names = wanted.iter().map(find).collect::<Result<Vec<_>, _>>()?;
    names.sort_by_key(|name| scenes::NAMES.iter().position(|known| known == name));
    names.dedup();
    Ok(names)
}

/// Measures light engines on scenes. `each` is called with every row as soon as it is measured.
///
/// # Errors
/// A scene that cannot be measured; [`BenchError::Stopped`] where `each` breaks.
pub fn bench(
    options: &BenchOptions,
    progress: &dyn Progress,
    each: EachRow<'_>,
) -> Result<Benchmark, BenchError> {
    let BenchOptions { scenes, passes, seconds } = options;
    let count: usize = scenes.iter().map(|name| cases::count(name)).sum();
    let count = count + passes.len() * cases::PASS_ROWS;
    let budget = Duration::from_secs_f64((seconds / count as f64).min(MOST_S));
    progress.begin("measuring", Some(count as u64));
    let mut rows: Vec<BenchRow> = Vec::new();
    let mut done = |row: BenchRow| -> Result<(), CaseError> {
        if each(&row).is_break() {
            return Err(CaseError::Stopped);
        }
        progress.advance(1);
        rows.push(row);
        Ok(())
    };
    for name in scenes.iter().copied() {
        progress.status(name);
        cases::built_in(name, budget, &mut done).map_err(|source| match source {
            CaseError::Stopped => BenchError::Stopped,
            source => BenchError::Scene { name, source },
        })?;
    }
    for (index, pass) in passes.iter().enumerate() {
        progress.status(&pass.name);
        cases::pass(pass, budget, &mut done).map_err(|source| match source {
            CaseError::Stopped => BenchError::Stopped,
            source => BenchError::Pass { index, name: pass.name.clone(), source },
        })?;
    }
    Ok(Benchmark { rows, processor: processor() })
}

/// Name of the processor, where the system says it.
fn processor() -> String {
    let words = std::fs::read_to_string("/proc/cpuinfo").ok().and_then(|text| {
        let line = text.lines().find(|l| l.starts_with("model name"))?;
        Some(line.split_once(':')?.1.trim().to_owned())
    });
    words.unwrap_or_else(|| format!("{} processor", std::env::consts::ARCH))
}
