//! Spin axis, period and phase of a body of known shape from its light, by simulating every trial with its true geometry: nothing is looked up in a map.
//!
//! In the order in which data flows through it:
//!
//! - [`Measured`]: curves beside the scene that they are of; [`Forward`]: what does not hang on a trial, computed once, and the light of a trial;
//! - [`Question`], [`Unknowns`], [`Turn`]: what is looked for and what is known; [`Law`], [`State`]: a trial, and small steps from it;
//! - [`coarse`]: all axes, phases and periods at few epochs; [`descent`]: from the best of them down to minima, by the engine's derivatives;
//! - [`twins`]: attitudes that send the same light by a symmetry, which are tried too;
//! - [`analyse`]: all of it from files of curves and scenes: [`AttitudeAnalysis`];
//! - [`find()`]: [`Answer`]: a verdict, minima with their probabilities and uncertainties, the symmetry that makes one of another.
//!
//! # Noise
//! To the stated noise comes a part of the rate that brings the middle residual of the best minimum to where noise has it: what the model lacks is counted as noise, the same for all minima.
//! Residuals beyond three standard deviations count linearly.

mod analysis;
mod answer;
mod asked;
pub mod coarse;
mod compare;
pub mod descent;
mod first;
mod forward;
mod hunt;
mod kept;
mod light;
mod look;
mod minimum;
mod passes;
mod question;
mod residuals;
mod search;
mod state;
pub mod twins;

pub use analysis::{AnalysisError, AnalysisOptions, AttitudeAnalysis, Sense, analyse};
pub use answer::{Answer, Verdict, find};
pub use compare::Compared;
pub use descent::Sample;
pub use forward::{Eye, Forward, Measured, Moment};
pub use minimum::{Ellipse, Minimum};
pub use question::{Checkpoint, Options, Progress, Question, Watch};
pub use state::{Law, State, Turn, Unknowns, angle};

use glam::DVec3;
use sunglint_simulator::attitude::AttitudeError as LawError;

use sunglint_simulator::light::{DerivativeError, DirectionError, SceneError};
use sunglint_simulator::pass::PassError;

/// Epochs below which nothing is looked for: two for each of the four unknowns.
pub const LEAST_EPOCHS: usize = 8;

/// Periods of the first look at most.
pub const MOST_RATES: usize = 200_000;

/// Factors of the brightness that are free, and solved for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Nothing: materials, sizes and calibration hold.
    None,
    /// One factor for all.
    Grey,
    /// One for each channel.
    Channels,
    /// One for each material.
    Materials,
}

/// Why no attitude was found.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AttitudeError {
    /// Too little was measured.
    #[error(
        "{samples} samples at {epochs} epochs count: at least {least} epochs are needed; a longer pass, or less left out"
    )]
    Few {
        /// Samples that count.
        samples: usize,
        /// Epochs that have one.
        epochs: usize,
        /// How many are needed.
        least: usize,
    },
    /// Curve whose channels or samples do not match in number.
    #[error("{name}: {found} {what}, expected {expected}")]
    Shape {
        /// Name of the curve.
        name: String,
        /// Items that were counted.
        what: &'static str,
        /// How many.
        found: usize,
        /// How many were expected.
        expected: usize,
    },
    /// A body that cannot be evaluated.
    #[error("the body has no direct light that could be searched by: {source}")]
    Body {
        /// Why.
        source: Box<SceneError>,
    },
    /// A pass that cannot be simulated.
    #[error("{name}: {source}")]
    Pass {
        /// Which curve's.
        name: String,
        /// Why.
        source: Box<PassError>,
    },
    /// A direction that is none.
    #[error(transparent)]
    Direction(#[from] DirectionError),
    /// A derivative that is none.
    #[error(transparent)]
    Derivative(#[from] DerivativeError),
    /// An axis that is none.
    #[error("the axis of the spin in the body is ({}, {}, {}), expected finite numbers, not all 0", axis_body.x, axis_body.y, axis_body.z)]
    Axis {
        /// Given axis.
        axis_body: DVec3,
    },
    /// A spin that is none.
    #[error(transparent)]
    Law(#[from] LawError),
    /// Light that does not change.
    #[error(
        "the light changes by {:.1} % beyond what range and air do, with noise of {:.1} %: no attitude can be told from it", 100.0 * change, 100.0 * noise
    )]
    Constant {
        /// Standard deviation of the logarithm.
        change: f64,
        /// The stated noise of the same.
        noise: f64,
    },
    /// A body that looks the same from all sides.
    #[error(
        "the body sends the same light however it is turned (within {:.1e}): its attitude does not show",
        change
    )]
    Featureless {
        /// Standard deviation over attitudes, of the mean.
        change: f64,
    },
    /// More periods than anyone waits for.
    #[error(
        "{periods} periods would have to be tried, at most {most} are: give narrower bounds (--period LO..HI)"
    )]
    TooManyPeriods {
        /// How many.
        periods: usize,
        /// The most.
        most: usize,
    },
    /// A checkpoint of something else.
    #[error(
        "the checkpoint belongs to another search: other data, another scene, another question or another seed"
    )]
    Checkpoint,
    /// Nothing was found.
    #[error("no attitude that was tried has any light at the measured epochs")]
    NoMinimum,
}
