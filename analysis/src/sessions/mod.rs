//! Periods over several sessions: nights of magnitudes with a zero point each, phase kept through the gaps.
//!
//! The model of a session s is m = Z_s + Σ_k (a_k cos 2πkft + b_k sin 2πkft), with one set of harmonics for all and a zero point for every session and filter. Four, six and eight
//! harmonics are fitted at every frequency, with equal weights; residuals beyond four times their robust scale are weighted down once, and all is fitted again. How much worse
//! another period is, is counted in the scatter that the best leaves, with the correlation of neighbouring residuals: Δ = (χ² − χ²_min)/s² · (1 − ρ)/(1 + ρ). A period is the only one where six
//! and eight harmonics agree on it to 0.5 % and both leave no other with Δ ≤ 25, or four and six do so and eight do not contradict.
//!
//! - [`search()`]: the verdict on sessions;
//! - [`Session`]: magnitudes that share a zero point; [`SessionPeriods`]: the verdict and what it rests on;
//! - [`of_curves`]: the sessions of the curves of some files.

mod curves;
mod scan;
mod verdict;

pub use curves::{Joined, find_over_sessions, of_curves};
pub use verdict::{
    Member, Options, Outcome, Reason, SessionFound, SessionPeriods, SessionsError, search,
};

/// Magnitudes that share one unknown zero point.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Session {
    /// Name for messages and legends: the session's, and the filter's where there are several.
    pub name: String,
    /// Times, s from a moment that all sessions share; in any order.
    pub time_s: Vec<f64>,
    /// Magnitudes.
    pub magnitude: Vec<f64>,
}
