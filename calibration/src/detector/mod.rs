//! Rate that a photon counter saw, computed from its counts: dead time and other non-linearity, inverted with its uncertainty.
//!
//! A [`Linearity`] is made of the [`DeadTime`] of a station's counter. [`Linearity::linearise`] turns the counts of one bin into a rate;
//! [`Linearity::linearise_tags`] does it in bins so fine that light which changes within the bin is right; an [`IntervalHistogram`]
//! of raw tags tells the dead time itself.
//!
//! | model | inverse | variance of the counts over their mean |
//! |---|---|---|
//! | none | n = m | 1 |
//! | non-paralysable | n = m/(1−mτ) | (1−mτ)² |
//! | paralysable | n = −W₀(−mτ)/τ, the low branch | 1−2mτ |
//! | exponential recovery | the mean interval of a renewal process, solved for n | σ²/μ² of the interval |
//! | table | monotone cubic through its points | (m/n)², against its slope at zero |
//!
//! Counts are those of a stationary renewal process in a bin that is long against the dead time (Cox, Renewal Theory, 1962). Because
//! n(m) is curved, the mean of n(m̂) is not n: half the curvature times the variance of m̂ is taken off, and reported.
//!
//! A rate is [`DetectorError::Saturated`] where its counts reach the stated saturation, and where an error of 1 % in the counts is
//! one of 10 % in the rate (nτ = 9 without, 0.9 with prolonged dead time), past the end of a table, and past what the
//! law can count at all. Below that it is trusted to nτ = 3 (0.5 of a paralysable detector, which a light beyond its peak makes dim: counts alone
//! cannot tell that), and [`Linear::trusted`] is false above.
//!
//! # Rates behind counts
//!
//! ```
//! use sunglint_calibration::detector::Linearity;
//! use sunglint_radiometry::station::DeadTime;
//!
//! // 1 µs dead after each count: of 1 MHz that arrive, half are counted.
//! let law = Linearity::new(&DeadTime::NonParalysable { dead_time_s: 1e-6 })?;
//! let rate = law.linearise(500_000, 1.0)?;
//! assert!((rate.rate_hz - 1e6).abs() < 5.0);
//! # Ok::<(), sunglint_calibration::detector::DetectorError>(())
//! ```

mod fine;
pub mod fit;
mod glint;
mod intervals;
mod law;
mod recovery;
mod table;

pub use fine::{FineBins, FineLinear};
pub(crate) use glint::Counted;
pub use glint::Glints;
pub use intervals::{Afterpulses, DeadTimeEstimate, IntervalError, IntervalHistogram};

use law::Law;
use sunglint_radiometry::station::{Counter, DeadTime};

/// The rate behind the counts of a bin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Linear {
    /// Rate as counted, Hz.
    pub measured_hz: f64,
    /// The rate that the detector saw, dark counts included, Hz.
    pub rate_hz: f64,
    /// Standard uncertainty of the rate from counting, Hz. Without any count, it is that of one count.
    pub sigma_hz: f64,
    /// Bias that was subtracted because the law is curved and counts are few, Hz.
    pub bias_hz: f64,
    /// dn/d ln τ, Hz: times the relative uncertainty of the dead time, what that adds to the uncertainty. It is common to all bins.
    pub dead_time_slope_hz: f64,
    /// The part of the events that was lost, 0 to 1; against the slope of the law at zero, so that a table in photons leaves its efficiency out.
    pub lost_fraction: f64,
    /// Whether the law is trusted here.
    pub trusted: bool,
}

/// Which limit a saturated rate has reached.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Limit {
    /// The saturation that the station states.
    Stated,
    /// Limit of the dead-time law: the most that it can count, or where it no longer tells rates apart.
    Law,
    /// The last point of the table.
    TableEnd,
}

/// Why there is no rate.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DetectorError {
    /// The detector does not follow.
    #[error(
        "{measured_hz} Hz counted, where {limit_hz} Hz ({limit:?}) is the most that tells a rate: the detector is saturated, leave the sample out"
    )]
    Saturated {
        /// Rate as counted, Hz.
        measured_hz: f64,
        /// The limit that it reached, Hz.
        limit_hz: f64,
        /// Which.
        limit: Limit,
    },
    /// A bin without a length.
    #[error("a bin of {0} s: expected a length above 0 s")]
    Exposure(f64),
    /// A law that no detector can have.
    #[error("{field}: found {found}, expected {expected}")]
    Law {
        /// Which number of the law.
        field: &'static str,
        /// It.
        found: f64,
        /// Values that are allowed.
        expected: &'static str,
    },
    /// A law that has no inverse here.
    #[error(
        "no inverse is known of the law of dead time {0}: describe it by a table of measured and true rates"
    )]
    Unknown(String),
    /// Time tags that are not in the order of time or outside their bin.
    #[error("time tag {number} of the bin is at {found_ps} ps, expected {from_ps} to {to_ps} ps")]
    Tag {
        /// Which tag of the bin, from 1.
        number: usize,
        /// Time of the tag, ps.
        found_ps: i64,
        /// The earliest that it may have.
        from_ps: i64,
        /// Before this.
        to_ps: i64,
    },
}

/// How to get from counts to rates.
#[derive(Debug, Clone, PartialEq)]
pub struct Linearity {
    law: Law,
    saturation_hz: f64,
}

/// dn/dm · m/n from which on a rate is saturated, as for [`Counter::is_saturated_by`].
const MOST_AMPLIFICATION: f64 = 10.0;
/// Dead times that a bin must hold for the statistics of long bins.
const LEAST_DEAD_TIMES: f64 = 20.0;

impl Linearity {
    /// The inverse of a law, without a stated saturation.
    ///
    /// # Errors
    /// A law that no detector can have: a negative or infinite time, a table that does not increase.
    pub fn new(dead_time: &DeadTime) -> Result<Self, DetectorError> {
        Ok(Self { law: Law::new(dead_time)?, saturation_hz: f64::INFINITY })
    }

    /// The inverse of a counter's law, with its stated saturation.
    ///
    /// # Errors
    /// The errors of [`Linearity::new`]; a saturation that is not above 0.
    pub fn of(counter: &Counter) -> Result<Self, DetectorError> {
        let found = counter.saturation_hz;
        if found.is_nan() || found <= 0.0 {
            let expected = "a rate above 0 Hz";
            return Err(DetectorError::Law { field: "saturation_hz", found, expected });
        }
        Ok(Self { saturation_hz: found, ..Self::new(&counter.dead_time)? })
    }

    /// The time over which a count hinders the next, s: dead time and recovery; of a table what its loss at the end is worth; 0 without a law.
    pub fn memory_s(&self) -> f64 {
        self.law.memory_s()
    }

    /// The rate behind the counts of a bin.
    ///
    /// # Errors
    /// [`DetectorError::Saturated`], which is a sample to flag and leave out; a bin without a length.
    pub fn linearise(&self, counts: u64, exposure_s: f64) -> Result<Linear, DetectorError> {
        if !(exposure_s.is_finite() && exposure_s > 0.0) {
            return Err(DetectorError::Exposure(exposure_s));
        }
        let measured_hz = counts as f64 / exposure_s;
        if measured_hz >= self.saturation_hz {
            return Err(DetectorError::Saturated {
                measured_hz,
                limit_hz: self.saturation_hz,
                limit: Limit::Stated,
            });
        }
        self.follow(measured_hz, exposure_s)
    }

    /// Inverts the law as [`Linearity::linearise`] does, whatever saturation is stated.
    fn follow(&self, measured_hz: f64, exposure_s: f64) -> Result<Linear, DetectorError> {
        let saturated =
            |(limit_hz, limit)| DetectorError::Saturated { measured_hz, limit_hz, limit };
        let at = self.law.invert(measured_hz).map_err(saturated)?;
        if at.amplified(measured_hz) {
            return Err(saturated((self.law.most_hz(), Limit::Law)).at_most(measured_hz));
        }
        let variance_of_mean = at.fano * measured_hz / exposure_s;
        let bias_hz = 0.5 * at.curvature_s * variance_of_mean;
        // No count tells that the rate is not far above one in the exposure.
        let sigma_hz = at.slope * (at.fano * measured_hz.max(1.0 / exposure_s) / exposure_s).sqrt();
        let long = exposure_s >= LEAST_DEAD_TIMES * self.memory_s();
        let lost = |whole: f64| 1.0 - measured_hz * at.slope_at_zero / whole;
        Ok(Linear {
            measured_hz,
            rate_hz: at.rate_hz - bias_hz,
            sigma_hz,
            bias_hz,
            dead_time_slope_hz: measured_hz * at.slope - at.rate_hz,
            lost_fraction: if at.rate_hz > 0.0 { lost(at.rate_hz).max(0.0) } else { 0.0 },
            trusted: at.trusted && (long || measured_hz == 0.0),
        })
    }

    /// The bound on what unresolved light within a bin does to its rate, Hz: the rates that a mean of `measured_hz` may stand for where the light
    /// stayed between `low_hz` and `high_hz` (all as counted) are from n(m) to that much above it, the chord of the convex law.
    /// Infinite where `high_hz` saturates.
    pub fn unresolved_hz(&self, measured_hz: f64, low_hz: f64, high_hz: f64) -> f64 {
        let rate = |m: f64| self.law.invert(m).map(|at| at.rate_hz);
        if high_hz <= low_hz {
            return 0.0;
        }
        let (Ok(mean), Ok(low), Ok(high)) = (rate(measured_hz), rate(low_hz), rate(high_hz)) else {
            return f64::INFINITY;
        };
        let part = ((measured_hz - low_hz) / (high_hz - low_hz)).clamp(0.0, 1.0);
        (low + part * (high - low) - mean).abs()
    }
}

impl DetectorError {
    /// A limit that is not above the rate that reached it.
    fn at_most(self, measured_hz: f64) -> Self {
        match self {
            Self::Saturated { limit_hz, limit, .. } => {
                Self::Saturated { measured_hz, limit_hz: limit_hz.min(measured_hz), limit }
            }
            other => other,
        }
    }
}
