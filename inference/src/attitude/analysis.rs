//! From curves and scenes to the attitude: what `[attitude]` of the first scene and the options ask, the search, the scene with what was found.

use super::asked::asked;
use super::kept::Kept;
use super::{Answer, AttitudeError, Measured, Options, Question, Scale, Unknowns, Verdict, find};
use crate::measured::{CurveOfScene, MeasuredError, V, channels, pass_of, place, prepared};
use crate::scene::SceneError;
use crate::solver::Unit;
use std::path::PathBuf;
use std::time::Instant;
use sunglint_formats::{FileError, ParseError};
use sunglint_numerics::progress::Progress;
use sunglint_simulator::light::engine::Switches;
use sunglint_simulator::pass::{Pass, PassError, Study};

/// The sense of a spin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Sense {
    /// Either.
    #[default]
    Both,
    /// Right-handed about the axis: positive periods.
    Right,
    /// Left-handed: negative periods.
    Left,
}

/// Options of an attitude analysis: the unknowns, and how they are searched for.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct AnalysisOptions {
    /// Numbers of the spin that the scene's attitude does not give.
    pub unknowns: Unknowns,
    /// The shortest and the longest period to look for, s; from four steps of the data, without an upper bound, where there is none.
    pub period_s: Option<(f64, f64)>,
    /// The sense in which the body turns about its axis.
    pub sense: Sense,
    /// Free factors of the brightness.
    pub scale: Scale,
    /// Only these channels; all where there is none.
    pub channels: Vec<String>,
    /// How it is searched.
    pub search: Options,
    /// A file that the first look at all axes is kept in from time to time; where it is there, the search goes on from it.
    pub checkpoint: Option<PathBuf>,
    /// Whether the search begins anew where that file is there.
    pub anew: bool,
}

impl Default for AnalysisOptions {
    fn default() -> Self {
        Self {
            unknowns: Unknowns { axis: true, phase: true, period: true },
            period_s: None,
            sense: Sense::Both,
            scale: Scale::None,
            channels: Vec::new(),
            search: Options::default(),
            checkpoint: None,
            anew: false,
        }
    }
}

/// Question and answer of an attitude analysis.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct AttitudeAnalysis {
    /// The answer.
    pub answer: Answer,
    /// The question.
    pub question: Question,
    /// The name of the first scene's file, without its extension.
    pub name: String,
    /// The channels that were compared.
    pub channels: Vec<String>,
    /// The materials of the first scene's target.
    pub materials: Vec<String>,
    /// The curves with their scenes.
    pub curves: Vec<CurveOfScene>,
    /// Samples left out of each curve: the reason, and how many.
    pub left_out: Vec<Vec<(String, usize)>>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
    /// How long it took, s.
    pub seconds: f64,
    /// The first scene with the best attitude, as text; none where nothing is determined.
    pub scene: Option<String>,
}

/// Why there is no analysis.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AnalysisError {
    /// Curves and scenes that do not go together.
    #[error(transparent)]
    Measured(#[from] MeasuredError),
    /// A scene that is none.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A file that cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// A time that is none.
    #[error(transparent)]
    Parse(#[from] ParseError),
    /// No curve at all.
    #[error("there is no curve whose attitude could be found")]
    NoCurve,
    /// A pass that cannot be simulated.
    #[error("{}", path.display())]
    Study {
        /// The curve.
        path: PathBuf,
        /// Why.
        source: Box<PassError>,
    },
    /// A scene whose attitude is no spin about a known axis of the body.
    #[error(
        "{}: [attitude] has the law {law}{}: what is looked for is a spin about a known axis of the body: law = \"spin\", axis_body = [x, y, z], and any axis_ra_dec_deg, period_s and epoch_utc",
        path.display(),
        if *spins { " without axis_body" } else { "" }
    )]
    Law {
        /// The scene.
        path: PathBuf,
        /// The law that it has.
        law: String,
        /// Whether that is a spin, but about no axis that is known.
        spins: bool,
    },
    /// An axis of the body that is none.
    #[error("{}: attitude.axis_body: expected three numbers", path.display())]
    AxisBody {
        /// The scene.
        path: PathBuf,
    },
    /// A spin without an epoch.
    #[error("{}: attitude.epoch_utc is missing", path.display())]
    NoEpoch {
        /// The scene.
        path: PathBuf,
    },
    /// An axis that is to be known, and that the scene does not say.
    #[error("{}: the axis is to be known, but [attitude] has neither axis_ra_dec_deg nor axis_gcrs", path.display())]
    NoAxis {
        /// The scene.
        path: PathBuf,
    },
    /// A phase that is to be known, and that the scene does not say.
    #[error("{}: the phase is to be known, but [attitude] has no axis_ra_dec_deg from which a phase counts", path.display())]
    NoPhase {
        /// The scene.
        path: PathBuf,
    },
    /// Nothing that is looked for.
    #[error("axis, phase and period are known: nothing is left to look for")]
    NothingUnknown,
    /// Periods to look for where the period is known.
    #[error("the period is known: neither bounds of periods nor a sense beside it")]
    PeriodKnown,
    /// A file that is no checkpoint.
    #[error("{}: this is no checkpoint of a search for an attitude", path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// Why.
        source: serde_json::Error,
    },
    /// No attitude.
    #[error("{}", path.display())]
    Search {
        /// The scene.
        path: PathBuf,
        /// Why.
        source: Box<AttitudeError>,
    },
}

impl AttitudeAnalysis {
    /// Factors of the brightness by name.
    pub fn scale_names(&self) -> Vec<String> {
        Answer::scale_names(self.question.scale, &self.channels, &self.materials)
    }
}

/// Finds how a body of known shape spins, from its light. `[attitude]` of the first scene says the axis in the body.
///
/// # Errors
/// Curves and scenes that do not go together; a scene whose attitude is no spin; a search that finds nothing ([`find`]).
pub fn analyse(
    curves: Vec<CurveOfScene>,
    options: &AnalysisOptions,
    progress: &dyn Progress,
) -> Result<AttitudeAnalysis, AnalysisError> {
    let start = Instant::now();
    let scene = &curves.first().ok_or(AnalysisError::NoCurve)?.scene;
    let mut warnings = Vec::new();
    let mut passes = Vec::new();
    for curve in &curves {
        warnings.extend(curve.measured.warnings.iter().cloned());
        passes.push(pass_of(curve, &mut warnings)?);
    }
    let study = |(pass, curve): (&Pass, &CurveOfScene)| {
        Study::new(direct(pass)).map_err(|source| AnalysisError::Study {
            path: curve.measured.path.clone(),
            source: Box::new(source),
        })
    };
    let studies = passes.iter().zip(&curves).map(study).collect::<Result<Vec<_>, _>>()?;
    let channels = channels(&curves, &studies, &options.channels)?;
    let (mut measured, mut left_out) = (Vec::new(), Vec::new());
    for ((curve, study), pass) in curves.iter().zip(&studies).zip(passes) {
        let (data, lost) = prepared(&curve.measured, study, &channels, 0.0)?;
        warnings.extend(curve.measured.silent(&channels));
        left_out.push(lost);
        let unit = match curve.measured.magnitudes {
            true => Unit::Band(V),
            false => Unit::Channels(channels.iter().map(|c| place(&pass.station, c)).collect()),
        };
        measured.push(Measured { pass, unit, data });
    }
    drop(studies);
    let question = asked(options, scene, &measured)?;
    let kept = Kept::new(options.checkpoint.clone(), options.anew, progress)?;
    let answer =
        find(&measured, &question, &options.search, &kept, kept.from()).map_err(|source| {
            AnalysisError::Search { path: scene.path.clone(), source: Box::new(source) }
        })?;
    kept.end();
    warnings.extend(answer.warnings.iter().cloned());
    let materials = measured[0].pass.target.materials.iter().map(|m| m.name.clone()).collect();
    Ok(AttitudeAnalysis {
        name: scene.name(),
        scene: with_attitude(scene, &answer)?,
        answer,
        question,
        channels,
        materials,
        left_out,
        warnings,
        seconds: start.elapsed().as_secs_f64(),
        curves,
    })
}

/// The scene with the best attitude; none where nothing is determined.
fn with_attitude(
    scene: &crate::scene::Scene,
    answer: &Answer,
) -> Result<Option<String>, SceneError> {
    if matches!(answer.verdict, Verdict::Undetermined(_)) {
        return Ok(None);
    }
    let best = &answer.minima[0];
    let mut scene = scene.clone();
    scene.set_spin(best.ra_deg, best.dec_deg, best.phase_deg, best.period_s);
    scene.remark(&format!(
        "Attitude by `sunglint analyse attitude`: {} ({} minima).",
        answer.verdict.name(),
        answer.minima.len()
    ));
    Ok(Some(scene.text()?))
}

/// The pass with direct light alone: what places and samples are asked of costs little then.
fn direct(pass: &Pass) -> Pass {
    Pass { effects: Switches::OFF, ..pass.clone() }
}
