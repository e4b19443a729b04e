//! Whole curves folded: every channel by its phase, about the axis of the spin where that is known.

use super::{FoldError, Folded, Folding, fold};
use crate::curves::Curves;
use crate::map::Spin;
use crate::series::{Series, SeriesError};
use crate::synodic::{Bisectors, Turn};
use hifitime::Epoch;
use sunglint_numerics::order::median;
use sunglint_radiometry::light_curve::Input;

/// A slip of the phases by more than this smears a folded curve, turns.
const MOST_SLIP: f64 = 0.1;
/// With fewer turns nothing was seen to repeat.
const LEAST_TURNS: f64 = 2.0;

/// Why no channel was folded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FoldCurvesError {
    /// A channel that is not as long as its curve.
    #[error(transparent)]
    Series(#[from] SeriesError),
    /// A period, an uncertainty or a number of bins that cannot be.
    #[error(transparent)]
    Fold(#[from] FoldError),
    /// The way of the bisector is not known.
    #[error("the samples are too few to know how the bisector of Sun and station moves")]
    TooFew,
    /// An axis about which the bisector has no longitude.
    #[error("the axis meets the bisector of Sun and station: about it nothing turns")]
    Axis,
    /// A spin that is slower than the bisector.
    #[error(
        "about this axis the bisector of Sun and station turns faster than once in {period_s} s: the body has no phase"
    )]
    Backwards {
        /// The period, s.
        period_s: f64,
    },
    /// No channel has a sample that counts.
    #[error("there is no sample to fold: {}", warnings.join("; "))]
    NoSample {
        /// Why not, channel by channel.
        warnings: Vec<String>,
    },
}

/// Axis of a spin among the stars, and the way of the bisector of Sun and station.
#[derive(Debug, Clone, PartialEq)]
pub struct SpinAxis {
    /// Right ascension, degrees.
    pub ra_deg: f64,
    /// Declination, degrees.
    pub dec_deg: f64,
    /// The bisector along the pass, in seconds from the curves' zero; `None` where it is not known.
    pub bisectors: Option<Bisectors>,
}

/// Options of the folding of whole curves.
#[derive(Debug, Clone, PartialEq)]
pub struct FoldOptions {
    /// The period, s: that which is seen, or with an axis that of the spin (sidereal).
    pub period_s: f64,
    /// Standard uncertainty, s, where it is known.
    pub period_sigma_s: Option<f64>,
    /// The moment of phase 0; `None` for the first sample.
    pub epoch: Option<Epoch>,
    /// Stretches of phase.
    pub bins: usize,
    /// The axis of the spin: phases then count turns of the body under the bisector of Sun and station.
    pub axis: Option<SpinAxis>,
}

impl FoldOptions {
    /// Options for a period, s: 50 stretches of phase, no uncertainty, phase 0 at the first sample, no axis.
    pub fn new(period_s: f64) -> Self {
        Self { period_s, period_sigma_s: None, epoch: None, bins: 50, axis: None }
    }
}

/// A channel and its folded samples.
#[derive(Debug, Clone, PartialEq)]
pub struct FoldedChannel {
    /// The samples, on the clock of the body where there is an axis.
    pub series: Series,
    /// Their phases, and the means over stretches of phase.
    pub folded: Folded,
}

/// Folded curves.
#[derive(Debug, Clone, PartialEq)]
pub struct FoldedCurves {
    /// The channels that have a sample.
    pub channels: Vec<FoldedChannel>,
    /// The period, s.
    pub period_s: f64,
    /// Standard uncertainty, s, where it is known.
    pub period_sigma_s: Option<f64>,
    /// The moment of phase 0.
    pub epoch: Epoch,
    /// Stretches of phase.
    pub bins: usize,
    /// Right ascension and declination of the axis, degrees, where one was given.
    pub axis_deg: Option<(f64, f64)>,
    /// Warnings to the user about the result.
    pub warnings: Vec<String>,
    /// Trends that were removed from the light, in words.
    pub removed: Vec<String>,
    /// The files.
    pub inputs: Vec<Input>,
    /// Whether the light is counted rates, Hz; else it is published magnitudes as fluxes relative to that of magnitude 0.
    pub are_rates: bool,
}

/// Folds all channels of some curves.
///
/// # Errors
/// No sample; a period, an uncertainty, an axis or a number of bins that cannot be.
pub fn fold_curves(
    curves: &Curves,
    options: &FoldOptions,
) -> Result<FoldedCurves, FoldCurvesError> {
    let FoldOptions { period_s, period_sigma_s, bins, .. } = *options;
    let epoch = options.epoch.unwrap_or(curves.zero);
    let epoch_s = (epoch - curves.zero).to_seconds();
    let mut folding = Folding { period_s, period_sigma_s, epoch_s, bins };
    let mut series = curves.series()?;
    let mut warnings = curves.warnings.clone();
    if let Some(axis) = &options.axis {
        let turn = turn(axis, period_s)?;
        let clocked = |s: &Series| {
            turn.clocked(s, 1.0 / period_s).ok_or(FoldCurvesError::Backwards { period_s })
        };
        folding.epoch_s -= turn.at(folding.epoch_s) * period_s;
        series = series.iter().map(clocked).collect::<Result<_, _>>()?;
    }
    let mut channels = Vec::new();
    for series in series {
        if series.is_empty() {
            let lost = series.left_out;
            warnings.push(format!(
                "{}: left out, since no sample counts ({} with a flag that changes its rate, {} without a number)",
                series.name, lost.flagged, lost.not_finite
            ));
            continue;
        }
        let folded = fold(&series, &folding)?;
        channels.push(FoldedChannel { series, folded });
    }
    if channels.is_empty() {
        return Err(FoldCurvesError::NoSample { warnings });
    }
    warnings.extend(concerns(&channels, period_s));
    warnings.extend(blurred(curves, period_s));
    Ok(FoldedCurves {
        channels,
        period_s,
        period_sigma_s,
        epoch,
        bins,
        axis_deg: options.axis.as_ref().map(|a| (a.ra_deg, a.dec_deg)),
        warnings,
        removed: curves.removed.clone(),
        inputs: curves.inputs.clone(),
        are_rates: curves.has_rates(),
    })
}

/// The turn of the bisector about an axis.
fn turn(axis: &SpinAxis, period_s: f64) -> Result<Turn, FoldCurvesError> {
    if !(period_s.is_finite() && period_s > 0.0) {
        return Err(FoldError::Period(period_s).into());
    }
    let bisectors = axis.bisectors.as_ref().ok_or(FoldCurvesError::TooFew)?;
    let direction = Spin::of(axis.ra_deg, axis.dec_deg, period_s).axis;
    bisectors.turned(direction).ok_or(FoldCurvesError::Axis)
}

/// The warning of exposures that last a turn or longer, where the files say them.
fn blurred(curves: &Curves, period_s: f64) -> Option<String> {
    let known = curves.curves.iter().filter(|c| c.is_exposure_known);
    let exposure_s = median(known.flat_map(|c| c.curve.samples.exposure_s.iter().copied()))?;
    (period_s <= exposure_s).then(|| {
        format!(
            "the period of {period_s} s is no longer than the exposure of {exposure_s} s: each sample is a mean over {:.3} turns, so that the folded curve shows nothing of a turn",
            exposure_s / period_s
        )
    })
}

/// Reasons to doubt a folded curve: too few turns, a period that is not known well enough.
fn concerns(channels: &[FoldedChannel], period_s: f64) -> Vec<String> {
    let mut concerns = Vec::new();
    let turns = channels.iter().map(|c| c.folded.turns).fold(0.0, f64::max);
    if turns < LEAST_TURNS {
        concerns.push(format!("the data cover {turns:.2} turns of {period_s} s: a curve that repeats is seen over {LEAST_TURNS} or more"));
    }
    let slip = channels.iter().filter_map(|c| c.folded.slip).fold(0.0, f64::max);
    if slip > MOST_SLIP {
        concerns.push(format!("the period's uncertainty lets first and last phase slip by {slip:.2} of a turn: the folded curve is smeared"));
    }
    concerns
}
