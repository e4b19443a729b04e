//! The fit of measured passes by simulated ones.
//!
//! Rates are linear in reflectances: of each material (a component) the simulation gives the rates per channel, and how strong each is, is solved
//! as bounded least squares in closed form, whatever else is being searched for (variable projection). Roughness, attitude, size, time and
//! extinction are not linear: they are searched for over a box, from many starts, and polished.
//!
//! In the order in which data flows through it:
//!
//! - [`Data`]: a measured curve: rates, their own noise, the scintillation that couples the channels of an epoch, the calibration's covariance;
//! - [`Model`]: what is compared with it: [`Columns`] for values of the parameters that are not linear ([`StudyModel`]: simulated passes);
//! - [`fit`]: [`Fit`]: parameters with intervals, correlations, other minima, warnings, the model's curve;
//! - [`summaries`]: residuals by channel, phase angle, airmass;
//! - [`spectrum`]: a reflectance spectrum through band albedos.
//!
//! # Noise
//! The covariance of an epoch is D + v vᵀ: D each channel's own variance, v = s times the model's rates, s² the relative variance that all
//! channels share. After a first solution by the measured rates it follows the model's. Errors of calibration, the same in all samples, do not
//! enter the weights; they are carried into the covariance of the parameters. An outlier to which a loss gives the weight w has 1/w of its whole variance, all of the excess its own.
//!
//! # Priors
//! A parameter that is known from elsewhere (a [`Prior`]) counts as one more sample, (mean − value)/σ, in χ² and in the degrees of freedom.
//!
//! # Intervals
//! 95 % by the covariance, which is that of the stated noise times max(1, reduced χ²): noise that is stated too small widens them, noise that is
//! stated too large does not narrow them. With a robust loss the factor is that of an M-estimate, Σψ²/(n−p) over the square of the mean of ψ'
//! (Huber 1981). What is solved for lies between 0 and its largest value. Where one stands at a bound it has no standard uncertainty, those of the others hold while it stays there, and all intervals
//! are profiles within the bounds, so that they tell what happens when it leaves. What may be anything between its bounds (χ² rises by less than 3.84 times that factor) keeps the model's own value and is named. Within two standard uncertainties of a bound the interval is where the profile of χ² stays below 3.84 (times that factor).
//! All this takes residuals as independent. [`Fit::widen_for_correlation`] looks whether they are, and widens covariance and intervals where a model is wrong for several samples at a time.

mod common;
mod correlation;
mod data;
mod estimate;
mod normal;
mod problem;
mod residuals;
mod response;
mod run;
mod search;
pub mod spectrum;
mod study;
mod whiten;

pub use correlation::ResidualCorrelation;
pub use data::{CalibrationError, Data};
pub use problem::{Columns, Free, Linear, Model, ModelError, Prior, Search};
pub use residuals::{Summary, summaries};
pub(crate) use run::WORTH;
pub use run::{Loss, Options, Progress, Purpose, fit};
pub use study::{
    Component, Extinction, Law, Shaping, StudyModel, Unit, ZeroPoint, airmasses, band_mean,
    band_weights,
};

use ndarray::Array2;
use serde::Serialize;
use std::fmt;

/// Why there is no fit.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    /// Input that makes no sense.
    #[error("{what}: {found}")]
    Input {
        /// Input that makes no sense.
        what: String,
        /// Value found, and value expected.
        found: String,
    },
    /// No sample counts.
    #[error("{curves}: no sample is left to be fitted")]
    NothingLeft {
        /// The curves.
        curves: String,
    },
    /// Too few samples.
    #[error(
        "{samples} samples count, expected more than the {parameters} parameters that are fitted"
    )]
    TooFew {
        /// Samples that count.
        samples: usize,
        /// Parameters.
        parameters: usize,
    },
    /// The model has no rates.
    #[error("no model at {at}: {source}")]
    Model {
        /// The parameters' values.
        at: String,
        /// Why.
        source: ModelError,
    },
    /// The search cannot be made.
    #[error("the search: {why}")]
    Search {
        /// Why.
        why: String,
    },
}

/// Whether rates are proportional to a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ParameterKind {
    /// Searched for.
    Nonlinear,
    /// Solved for.
    Linear,
}

/// A side of an interval.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// The least value.
    Low,
    /// The largest value.
    High,
}

/// How an interval was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum IntervalMethod {
    /// 1.96 standard uncertainties to both sides.
    Covariance,
    /// Where the profile of χ² stays below 3.84.
    Profile,
    /// There is none: the data do not determine the parameter.
    None,
}

/// A parameter's value and what is known of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Estimate {
    /// Name of the parameter, with its unit where it has one.
    pub name: String,
    /// Whether it was searched or solved for.
    pub kind: ParameterKind,
    /// Value of the parameter.
    pub value: f64,
    /// Standard uncertainty of the value, the calibration's and the materials' parts in it; `None` where the data do not determine it.
    pub sigma: Option<f64>,
    /// The part that the calibration's errors have in it.
    pub sigma_calibration: Option<f64>,
    /// The part that the doubt of the materials has in it ([`Fit::add_materials`]); `None` where no material says how well it is known.
    pub sigma_material: Option<f64>,
    /// The ends of its 95 % interval; `None` where it is open.
    pub interval_95: [Option<f64>; 2],
    /// How that was found.
    pub interval_method: IntervalMethod,
    /// The bound at which it stands.
    pub at_bound: Option<Side>,
    /// Knowledge of it from elsewhere that was counted; `None` where there was none.
    pub prior: Option<Prior>,
}

impl Estimate {
    /// Whether a value lies in the 95 % interval.
    pub fn covers(&self, value: f64) -> bool {
        let [low, high] = self.interval_95;
        low.is_none_or(|l| l <= value) && high.is_none_or(|h| value <= h)
    }
}

/// Warning that the user should read before believing a fit.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case", tag = "what")]
#[non_exhaustive]
pub enum Warning {
    /// Some combination of these parameters changes nothing.
    Undetermined {
        /// The parameters that take part.
        names: Vec<String>,
    },
    /// Two parameters that the data hardly tell apart.
    Correlated {
        /// Which.
        names: [String; 2],
        /// Their correlation.
        correlation: f64,
    },
    /// A parameter stands at a bound.
    AtBound {
        /// Which.
        name: String,
        /// Value of the parameter.
        value: f64,
        /// Which bound.
        side: Side,
    },
    /// A parameter that is solved for stands at its upper bound: the data ask for more light.
    TooLarge {
        /// Which.
        name: String,
        /// The bound.
        most: f64,
    },
    /// Parameters that may be anything between their bounds: they are kept at the values that the model has.
    Unconstrained {
        /// Which.
        names: Vec<String>,
    },
    /// Parameters whose uncertainty is that of their prior: the data say nothing more.
    ByPrior {
        /// Which.
        names: Vec<String>,
    },
    /// Another minimum that the data do not exclude.
    OtherMinimum {
        /// Excess of this minimum's χ² over that of the best one, over the scale of the errors.
        delta_chi2: f64,
        /// The parameters there.
        at: Vec<(String, f64)>,
    },
    /// The residuals are larger than the stated noise.
    PoorFit {
        /// χ² over the degrees of freedom.
        reduced_chi2: f64,
    },
    /// Residuals hang together: the model is wrong for a time.
    Wandering {
        /// What was found.
        found: ResidualCorrelation,
    },
    /// The search ended before it was at a minimum.
    NotConverged {
        /// Description of what did not settle.
        why: String,
    },
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Undetermined { names } if names.len() == 1 => {
                write!(f, "{} changes nothing that was measured: it is not determined", names[0])
            }
            Self::Undetermined { names } => write!(
                f,
                "{} never appear apart: a combination of them is not determined; fix one, or add passes that show them differently",
                names.join(", ")
            ),
            Self::Correlated { names: [a, b], correlation } => write!(
                f,
                "{a} and {b} are hardly told apart: their correlation is {correlation:+.3}"
            ),
            Self::AtBound { name, value, side } => {
                let side = if *side == Side::Low { "lower" } else { "upper" };
                write!(f, "{name} stands at its {side} bound, {value:.6}")
            }
            Self::TooLarge { name, most } => write!(
                f,
                "{name} stands at its upper bound, {most:.6}: the data ask for more light than that; the body is larger, shinier, turned or calibrated otherwise than the file says"
            ),
            Self::Unconstrained { names } => write!(
                f,
                "not constrained by these data, and kept as the file has them: {}",
                names.join(", ")
            ),
            Self::ByPrior { names } => write!(
                f,
                "known by their priors alone, to which these data add nothing: {}",
                names.join(", ")
            ),
            Self::OtherMinimum { delta_chi2, at } => {
                let at: Vec<String> = at.iter().map(|(n, v)| format!("{n} = {v:.6}")).collect();
                write!(
                    f,
                    "another minimum lies {delta_chi2:.1} above the best in chi-square: {}",
                    at.join(", ")
                )
            }
            Self::PoorFit { reduced_chi2 } => write!(
                f,
                "the residuals are {:.2} times as large as the stated noise (reduced chi-square {reduced_chi2:.2}): intervals are widened by that, and hold only if what is missing in the model is random",
                reduced_chi2.sqrt()
            ),
            Self::Wandering { found } => write!(
                f,
                "residuals hang together over {:.3} s ({:.1} samples): the model is wrong for a time, by {:.1} % of the light{}; intervals are widened for that",
                found.time_s,
                found.samples,
                100.0 * found.model_error,
                match found.in_common {
                    part if part > 0.75 => ", in all channels alike",
                    part if part < 0.25 => ", in each channel otherwise",
                    _ => ", in part in all channels alike",
                }
            ),
            Self::NotConverged { why } => write!(f, "the fit did not converge: {why}"),
        }
    }
}

/// A minimum of the sum of squares.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Minimum {
    /// Values of the parameters that are not linear, in their order.
    pub values: Vec<f64>,
    /// χ² there.
    pub chi2: f64,
    /// χ² above that of the best, over the scale of the errors.
    pub delta_chi2: f64,
}

/// A fitted curve beside the measured one: arrays of epochs × channels, NaN where nothing was measured that counts.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedCurve {
    /// The model's rates, everywhere.
    pub model: Array2<f64>,
    /// Measured less model, over the noise of a single sample, scintillation in it.
    pub pull: Array2<f64>,
    /// How much a sample counted by the loss, 0 to 1.
    pub weight: Array2<f64>,
}

/// Result of a fit.
#[derive(Debug, Clone, Serialize)]
pub struct Fit {
    /// The parameters: those that were searched for, then those that were solved for.
    pub parameters: Vec<Estimate>,
    /// Their covariance; NaN (null in JSON) for what stands at a bound or is not determined.
    pub covariance: Vec<Vec<f64>>,
    /// Samples that count.
    pub samples: usize,
    /// χ² with the stated noise, all samples alike.
    pub chi2: f64,
    /// Samples less parameters.
    pub degrees_of_freedom: usize,
    /// χ² over the degrees of freedom.
    pub reduced_chi2: f64,
    /// Factor by which the covariance of the stated noise was multiplied.
    pub scaled_by: f64,
    /// Residuals that hang together in time, for which intervals were widened ([`Fit::widen_for_correlation`]); `None` where they do not, or nobody looked.
    pub correlation: Option<ResidualCorrelation>,
    /// The loss.
    pub loss: Loss,
    /// Whether the minimum was reached.
    pub converged: bool,
    /// The minima that were found, the best first.
    pub minima: Vec<Minimum>,
    /// How often the model was computed.
    pub evaluations: usize,
    /// Warnings for the user.
    #[serde(skip)]
    pub warnings: Vec<Warning>,
    /// The curves.
    #[serde(skip)]
    pub curves: Vec<FittedCurve>,
    /// Derivatives of the parameters by the data; `None` of a fit that gives values without uncertainties.
    #[serde(skip)]
    response: Option<response::Response>,
}

impl Fit {
    /// The parameter of that name.
    pub fn parameter(&self, name: &str) -> Option<&Estimate> {
        self.parameters.iter().find(|p| p.name == name)
    }

    /// Adds a minimum that another search found, with its warning: χ² there over that of the best, over the scale of the errors. Nothing is added that is the best one itself, but for what the data do not determine, or lies so high that the data exclude it.
    pub(crate) fn add_minimum(&mut self, free: &[Free], values: Vec<f64>, delta_chi2: f64) {
        let Some(best) = self.minima.first() else { return };
        let (known, own) = (&self.parameters, &self.warnings);
        let same = run::same_but_for_what_is_open(free, known, own, &values, &best.values);
        if same || delta_chi2 >= WORTH {
            return;
        }
        let chi2 = best.chi2 + delta_chi2 * self.scaled_by;
        let at = free.iter().map(|f| f.name.clone()).zip(values.iter().copied()).collect();
        self.warnings.push(Warning::OtherMinimum { delta_chi2, at });
        self.minima.push(Minimum { values, chi2, delta_chi2 });
        self.minima[1..].sort_by(|a, b| a.chi2.total_cmp(&b.chi2));
    }

    /// The correlation of two parameters by their numbers; `None` where one of them has no uncertainty.
    pub fn correlation(&self, i: usize, j: usize) -> Option<f64> {
        let c = &self.covariance;
        let r = c.get(i)?.get(j)? / (c[i][i] * c.get(j)?[j]).sqrt();
        r.is_finite().then_some(r)
    }
}
