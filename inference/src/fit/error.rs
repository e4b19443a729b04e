//! Why a pass is not fitted.

use crate::measured::MeasuredError;
use crate::scene::SceneError;
use crate::solver::{FitError, ModelError};
use hifitime::Epoch;
use std::path::PathBuf;
use sunglint_formats::time::format_utc;
use sunglint_formats::{FileError, ParseError};
use sunglint_numerics::progress::Cancelled;
use sunglint_radiometry::air::AirError;
use sunglint_radiometry::spectrum::SpectrumError;
use sunglint_simulator::pass::PassError;

/// Why a pass is not fitted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PassFitError {
    /// Curves and scenes that do not go together.
    #[error(transparent)]
    Measured(#[from] MeasuredError),
    /// A scene that is none, or does not have what is to be fitted.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A file that cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// A file that is not what it should be.
    #[error(transparent)]
    Parse(#[from] ParseError),
    /// No fit.
    #[error(transparent)]
    Solver(#[from] FitError),
    /// Values for which there is no simulation.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A pass that cannot be simulated.
    #[error(transparent)]
    Pass(#[from] PassError),
    /// A spectrum that is none.
    #[error(transparent)]
    Spectrum(#[from] SpectrumError),
    /// Air that is none.
    #[error(transparent)]
    Air(#[from] AirError),
    /// Whoever watches the work ended it.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// No curve at all.
    #[error("there is no curve to fit")]
    NoCurve,
    /// A pass that cannot be simulated at the curve's times.
    #[error("{}: its samples are from {} to {}", path.display(), format_utc(ends.0, 1), format_utc(ends.1, 1))]
    Study {
        /// The curve.
        path: PathBuf,
        /// First and last moment of the curve.
        ends: (Epoch, Epoch),
        /// Why.
        source: Box<PassError>,
    },
    /// A file that was read before and now cannot be.
    #[error("{}", path.display())]
    Input {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A parameter of a scene's `[fit]` that is none.
    #[error("[fit] free: {why}")]
    FreeSyntax {
        /// Description of the error.
        why: String,
    },
    /// A name that is free twice.
    #[error("`{name}` is free twice")]
    FreeTwice {
        /// The name.
        name: String,
    },
    /// A range that is no interval.
    #[error(
        "{name}: its range is {low} to {high}, expected two finite numbers, the lower one first"
    )]
    Range {
        /// The parameter.
        name: String,
        /// The range's lower end.
        low: f64,
        /// The range's upper end.
        high: f64,
    },
    /// A largest albedo that is none.
    #[error("the largest albedo is {largest_albedo}, expected a number above 0")]
    LargestAlbedo {
        /// Value that was given.
        largest_albedo: f64,
    },
    /// Nothing that is free.
    #[error("nothing is free")]
    NothingFree,
    /// A name that should differ from pass to pass, and is not free.
    #[error("`{name}` is to differ from pass to pass, but is not free")]
    NotFree {
        /// The name.
        name: String,
    },
    /// A range of what is solved for.
    #[error(
        "{name}: what is solved for has no range of its own: it lies between 0 and the largest albedo"
    )]
    Solved {
        /// The parameter.
        name: String,
    },
    /// A normal that cannot be searched for.
    #[error("normal.{part}: {why}")]
    Normal {
        /// The part.
        part: String,
        /// Why.
        why: String,
    },
    /// Zero points of rates.
    #[error(
        "zero_point: rates of the schema have none: free `gain` (with --per-pass), or fit magnitudes"
    )]
    NoZeroPoint,
    /// Curves to leave out that are none.
    #[error("there is no curve {name} to leave out; there are {known}")]
    NotACurve {
        /// The name that was given.
        name: String,
        /// Names of all curves.
        known: String,
    },
    /// All curves left out.
    #[error("no curve is left to be fitted without {names}")]
    AllLeftOut {
        /// The curves that were to be left out.
        names: String,
    },
    /// A number that nobody gave a range.
    #[error("{name}: it starts at {start}, which says nothing of where to search")]
    NoRange {
        /// The parameter.
        name: String,
        /// Value in the scene.
        start: f64,
    },
    /// A start outside the range.
    #[error("{name}: it starts at {start}, outside of {low} to {high}")]
    Outside {
        /// The parameter.
        name: String,
        /// Value in the scene.
        start: f64,
        /// The range's lower end.
        low: f64,
        /// The range's upper end.
        high: f64,
    },
    /// Fitted values that make no valid scene.
    #[error("the scene with what was found is none: {why}")]
    FittedScene {
        /// Why.
        why: String,
    },
}
