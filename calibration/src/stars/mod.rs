//! The night's coefficient per channel from stars: predicted = κ · measured.
//!
//! The fitted quantity is y = ln(ν̂/ν) of every visit and channel, with a covariance of its own: counts (independent), scintillation (common to the channels
//! of a visit), the catalogue's magnitude (common to all that was measured of a star) and its type, the fibre's coupling and what else is a channel's own.
//! In the order in which data flow:
//!
//! - [`visit`]: the mean rate of a visit from its linear light curve, with its uncertainty; [`scintillation`] of it;
//! - `consensus`: which visits agree. Every visit is a candidate for all channels at once (a cloud, a wrong star dims them all), the candidate
//!   with the smallest truncated χ² wins and is polished; the scatter is estimated from those that agree, never below the stated floor;
//! - `gls`: generalised least squares on those; `scatter`: its components; `bootstrap`: intervals by resampling stars, studentised;
//! - [`Slope`]s against airmass and colour (the aerosol that nobody modelled), [`RatioCheck`]s of the channels (linearity), [`variation`] over nights;
//! - [`Nights`]: all of it as a file;
//! - [`read_visits`] and [`calibrate_nights`]: the whole of it, from files or sessions to calibrated nights.
//!
//! Robust consensus: Fischler and Bolles 1981; its truncated loss: Torr and Zisserman 2000 (MSAC). Components of variance by the moments of Paule and
//! Mandel 1982. Studentised bootstrap: Efron and Tibshirani 1993, 12.5.
//!
//! # A night's coefficient
//!
//! Six stars whose light arrives 2 % stronger than predicted, and a seventh behind a cloud:
//!
//! ```
//! use sunglint_calibration::stars::{Measured, Options, Visit, calibrate};
//!
//! let visit = |number: u32, transmitted: f64| Visit {
//!     star: format!("star {number}"),
//!     airmass: 1.0 + 0.1 * f64::from(number),
//!     b_minus_v_mag: Some(0.1 * f64::from(number)),
//!     scintillation: 0.002,
//!     decides: true,
//!     channels: vec![Some(Measured {
//!         predicted_hz: 1e5,
//!         measured_hz: 1.02e5 * transmitted,
//!         sigma_hz: 300.0,
//!         per_aerosol_depth: None,
//!     })],
//! };
//! let visits: Vec<Visit> =
//!     (0..6).map(|n| visit(n, 1.0)).chain([visit(6, 0.5)]).collect();
//! let night = calibrate(&visits, &Options::default())?;
//! let kappa = night.channels[0].as_ref().map_err(String::as_str)?;
//! assert!((kappa.kappa - 1.0 / 1.02).abs() < 1e-5 && kappa.stars == 6);
//! assert!(!night.visits[6].agrees);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod bootstrap;
mod checks;
mod consensus;
mod file;
mod gls;
mod night;
mod nights;
mod recorded;
mod sample;
mod scatter;
pub mod scintillation;
pub mod visit;

pub use checks::{RatioCheck, Slope, Variation, variation};
pub use file::{ChannelRow, Facts, NightFile, Nights};
pub use night::{Aerosol, ChannelKappa, Judgement, Night, calibrate};
pub use nights::{
    CalibratedNight, CalibratedNights, NightError, NightsError, NightsOptions, USUAL_EXPONENT,
    VisitError, calibrate_nights,
};
pub use recorded::{MeasuredVisit, StarVisit, night_of, read_visits};

/// One visit to a star: what was predicted and what was measured, by channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Visit {
    /// The star: visits of one star share the error of its catalogued magnitude and type.
    pub star: String,
    /// Relative air mass (Rayleigh).
    pub airmass: f64,
    /// B−V, mag, where it is known.
    pub b_minus_v_mag: Option<f64>,
    /// Relative standard deviation of the visit's mean by scintillation, common to its channels.
    pub scintillation: f64,
    /// Whether it may decide κ: not where the spectrum is a guess from the colour.
    pub decides: bool,
    /// One entry a channel, in one order for all visits; `None` where the channel did not measure it.
    pub channels: Vec<Option<Measured>>,
}

/// A visit in one channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// Rate predicted at the detector, after the air, Hz, above 0.
    pub predicted_hz: f64,
    /// Mean linear rate, Hz (ADU/s of a camera).
    pub measured_hz: f64,
    /// Standard uncertainty of the measured rate by counts, sky and reading, without scintillation, in the same unit, above 0.
    pub sigma_hz: f64,
    /// d ln(predicted)/dτ by an aerosol's optical depth, below 0; `None` where no aerosol is to be fitted.
    pub per_aerosol_depth: Option<f64>,
}

/// How a night is calibrated.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Relative scatter of catalogued magnitudes and types at least: half of its variance common to all channels, half each channel's own.
    pub floor: f64,
    /// A visit whose common offset is farther from the others than that many standard deviations is an outlier.
    pub clip_sigma: f64,
    /// Stars that must agree.
    pub fewest_stars: usize,
    /// A night whose stars scatter by more has no κ.
    pub most_scatter: f64,
    /// Coverage of the intervals.
    pub confidence: f64,
    /// Resamples of the bootstrap.
    pub resamples: u32,
    /// Seed of the bootstrap.
    pub seed: u64,
    /// Fit an aerosol's optical depth with κ.
    pub fit_aerosol: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            floor: 0.02,
            clip_sigma: 4.0,
            fewest_stars: 3,
            most_scatter: 0.15,
            confidence: 0.95,
            resamples: 2000,
            seed: 0,
            fit_aerosol: false,
        }
    }
}

/// Why a night has no calibration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StarsError {
    /// Input that cannot be: what, and where.
    #[error("visit {visit} ({star}): {what}")]
    Input {
        /// Which visit, from 1.
        visit: usize,
        /// Star of the visit.
        star: String,
        /// Description of the fault, with the number.
        what: String,
    },
    /// Options that cannot be.
    #[error("{name} is {value}, expected {expected}")]
    Option {
        /// Which.
        name: &'static str,
        /// Value of the option.
        value: f64,
        /// Values that are allowed.
        expected: &'static str,
    },
    /// Not enough stars to tell a good one from a bad one.
    #[error("{found} star(s) can decide, {needed} are needed: with fewer nothing tells a clouded or mistaken star from a good one{}", if *left_out > 0 { format!(" ({left_out} visit(s) were left out: a spectrum that is a guess, or nothing measured)") } else { String::new() })]
    TooFewStars {
        /// Stars that could decide.
        found: usize,
        /// Stars that are needed.
        needed: usize,
        /// Visits that could not decide.
        left_out: usize,
    },
    /// No group of stars agrees.
    #[error(
        "only {agreeing} of {stars} stars agree, {needed} are needed: clouds, wrong stars, or the wrong station"
    )]
    NoConsensus {
        /// The largest group, stars.
        agreeing: usize,
        /// All that could decide.
        stars: usize,
        /// How many would do.
        needed: usize,
    },
    /// Two groups agree within themselves.
    #[error(
        "two groups of stars disagree: {first} stars, and {second} that are {dimmer:.2} times as bright against their prediction; half the night was clouded, the air lacks an aerosol, or half the stars are others than they are called: fit the aerosol, split the night or leave visits out"
    )]
    Ambiguous {
        /// Stars of the first group.
        first: usize,
        /// Stars of the second.
        second: usize,
        /// How bright the second is beside the first.
        dimmer: f64,
    },
    /// Those that agree do so only roughly.
    #[error(
        "the stars scatter by {percent:.0} % about their common offset, more than the {most_percent:.0} % that a calibration stands: clouds, or the wrong stars"
    )]
    TooMuchScatter {
        /// Relative scatter, %.
        percent: f64,
        /// The most, %.
        most_percent: f64,
    },
    /// No aerosol can be fitted.
    #[error("no aerosol depth can be fitted: {why}")]
    Aerosol {
        /// The reason, with numbers.
        why: String,
    },
}
