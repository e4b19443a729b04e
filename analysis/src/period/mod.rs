//! Periods: spectra, phase dispersion, significance, and a verdict.
//!
//! - [`lomb_scargle()`]: least squares of K harmonics and a mean at every frequency of a grid, exact;
//! - [`spectrum()`]: the Fourier spectrum of a curve that is sampled regularly, with what its gaps were taken for;
//! - [`window()`]: what the sampling alone does;
//! - [`pdm()`]: phase dispersion minimisation;
//! - [`false_alarm()`]: how often noise alone gives such a peak;
//! - [`mod@verdict`]: one period, a family, or not enough data;
//! - [`flash_train`], [`with_flashes`]: the period of short flashes, beside the harmonics;
//! - [`find_period()`]: all of it for the curves of some files.

mod alone;
mod curves;
mod fit;
mod flashes;
mod lines;
pub(crate) mod lomb_scargle;
mod pdm;
mod significance;
mod spectrum;
pub mod stats;
pub(crate) mod sums;
pub mod verdict;

pub use curves::{
    Drawn, FoundPeriod, GEOMETRY_NOT_USED, Geometry, PERIOD_CHANGES, PeriodOptions, find_period,
};
pub use fit::{HarmonicFit, fit};
pub use flashes::{FlashPhase, FlashTrain, Refusal, flash_train, with_flashes};
pub use lomb_scargle::{lomb_scargle, window};
pub use pdm::{Dispersion, dispersion_test, pdm};
pub use significance::{false_alarm, joint_gain};
pub use spectrum::{Spectrum, spectrum};
pub use verdict::{Options, Verdict, verdict};

/// Evenly spaced frequencies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrequencyGrid {
    /// The first, Hz, not below 0.
    pub first_hz: f64,
    /// The step, Hz, above 0.
    pub step_hz: f64,
    /// Number.
    pub n: usize,
}

impl FrequencyGrid {
    /// The `i`-th frequency, Hz.
    pub fn frequency_hz(&self, i: usize) -> f64 {
        self.first_hz + i as f64 * self.step_hz
    }

    /// The last frequency, Hz; the first of an empty grid.
    pub fn last_hz(&self) -> f64 {
        self.frequency_hz(self.n.saturating_sub(1))
    }

    /// Refuses what no grid can be.
    fn check(&self) -> Result<(), PeriodError> {
        let good = self.first_hz.is_finite()
            && self.first_hz >= 0.0
            && self.step_hz.is_finite()
            && self.step_hz > 0.0
            && self.n > 0;
        let (first_hz, step_hz, n) = (self.first_hz, self.step_hz, self.n);
        if good { Ok(()) } else { Err(PeriodError::Grid { first_hz, step_hz, n }) }
    }
}

/// Why nothing was computed. A verdict of *not enough data* is no error: [`verdict::Outcome::NotEnough`].
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PeriodError {
    /// Frequencies that are none.
    #[error(
        "{n} frequencies from {first_hz} Hz by {step_hz} Hz, expected at least one, from 0 up, by a step above 0"
    )]
    Grid {
        /// The first frequency, Hz.
        first_hz: f64,
        /// The step, Hz.
        step_hz: f64,
        /// Number.
        n: usize,
    },
    /// A number of harmonics that cannot be fitted.
    #[error("{0} harmonics, expected 1 to 32")]
    Harmonics(usize),
    /// Too few samples for the model.
    #[error("{name}: {samples} samples, {harmonics} harmonics and a mean need more than {}", 2 * harmonics + 1)]
    Samples {
        /// The series' name.
        name: String,
        /// Samples.
        samples: usize,
        /// The harmonics asked for.
        harmonics: usize,
    },
    /// All values are the same.
    #[error("{name}: all {samples} values are {value}: constant light has no period")]
    Constant {
        /// The series' name.
        name: String,
        /// Samples.
        samples: usize,
        /// The value.
        value: f64,
    },
    /// A number of phase bins that cannot be.
    #[error("{0} phase bins, expected 2 to 10,000")]
    Bins(usize),
    /// A period that is none.
    #[error("the period is {0} s, expected a time above 0")]
    Period(f64),
    /// A range of periods without a period.
    #[error(
        "periods from {shortest_s} s to {longest_s} s, expected the first above 0 and below the second"
    )]
    Range {
        /// The shortest period, s.
        shortest_s: f64,
        /// The longest, s.
        longest_s: f64,
    },
    /// More frequencies than anyone waits for.
    #[error(
        "{frequencies} frequencies, expected at most {most}: ask for longer periods than {shortest_s} s, or split the curve"
    )]
    TooMany {
        /// The frequencies that the range needs.
        frequencies: usize,
        /// The most.
        most: usize,
        /// The shortest period that was asked for, s.
        shortest_s: f64,
    },
}
