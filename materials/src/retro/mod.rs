//! From a power meter's readings to retro-reflection: the first run on a goniometer.
//!
//! A laser's beam of the power Φ_i meets the sample; what comes back through the stop of solid angle Ω_o goes by a beam splitter (reflectance R at the laser's
//! polarisation) and a lens (transmission T) to the meter:
//!
//! f̄(θ) = (Φ(θ) − Φ₀(θ)) / (Φ_i(t) Ω_o cosθ R T)
//!
//! with Φ₀ of a scan without the sample, Φ_i interpolated between the incident readings before, between and after, and θ the stage's angle less the mount's offset,
//! which is found from both sides of the normal ([`crate::ndf`]) with this very cosine. A reference run on a standard of known f takes the place of
//! Φ_i Ω_o R T where these are not known.
//!
//! - [`stop`]: the solid angle of a stop that may be tilted, and the roughness that its cone lets one see;
//! - [`spot`]: how much of the beam passes beside the sample;
//! - [`readings`]: several readings at an angle as one, safe from outliers;
//! - [`reduce`]: all of it, with uncertainties by component; [`to_table`] for the file.

pub mod log;
pub mod measure;
pub mod plan;
pub mod readings;
mod reduce;
pub mod spot;
pub mod stop;
mod table;

pub use readings::{AtAngle, Mean};
pub(crate) use reduce::walk;
pub use reduce::{reduce, smallest_alpha};
pub use spot::Spot;
pub use stop::Stop;
pub use table::to_table;

use crate::ndf::ZeroOrigin;
use crate::table::{ConeSpread, RetroFlags};
use serde::Serialize;
use std::fmt;

/// A number that is known to so much.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Known {
    /// The number.
    pub value: f64,
    /// Relative standard uncertainty of the number.
    pub relative_sigma: f64,
}

impl Known {
    /// A number that is exact.
    pub fn exact(value: f64) -> Self {
        Self { value, relative_sigma: 0.0 }
    }
}

/// Reference that turns a power into a reflectance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reference {
    /// The incident power, read in the sample's place.
    Power {
        /// Transmission of what stood in front of the meter there.
        transmission: Known,
        /// Reflectance of the beam splitter at the laser's polarisation.
        splitter: Known,
        /// Transmission of the lens.
        lens: Known,
    },
    /// Readings of a standard in the sample's place; solid angle, splitter and lens are in them.
    Standard {
        /// Retro-reflection f(ω, ω) of the standard at the angle at which it was read, sr⁻¹; ρ/π of a Lambert standard.
        f_per_sr: Known,
        /// The angle of incidence on it, degrees.
        angle_deg: f64,
    },
}

/// Setup of a rig: all that is known of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Setup {
    /// Vacuum wavelength, nm.
    pub wavelength_nm: f64,
    /// Reference that turns a power into a reflectance.
    pub reference: Reference,
    /// The stop that limits the light to the meter, and the relative standard uncertainty of its solid angle.
    pub stop: (Stop, f64),
    /// The beam on the sample, and the part of it that may miss the sample; none where the sample has no end.
    pub spot: Option<(Spot, f64)>,
    /// Standard uncertainty of an angle of the stage, degrees.
    pub angle_sigma_deg: f64,
    /// The stage's angle at normal incidence, degrees, where it is known; else it is found.
    pub zero_deg: Option<f64>,
    /// The standard uncertainty of that angle where it is given or cannot be found, degrees.
    pub zero_sigma_deg: f64,
    /// How far from the stage's zero it is looked for, degrees.
    pub most_offset_deg: f64,
}

/// Readings of a run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Measured {
    /// The incident power, or the standard: once before, once after, and between if it was.
    pub incident: Vec<AtAngle>,
    /// Without a sample; empty where that was not measured.
    pub signature: Vec<AtAngle>,
    /// The sample.
    pub sample: Vec<AtAngle>,
}

/// Uncertainties of one f by where they come from, sr⁻¹.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Components {
    /// Scatter of the readings: the meter, the laser's flicker, photons.
    pub readout_per_sr: f64,
    /// The scan without a sample: its scatter, and the laser's change since.
    pub signature_per_sr: f64,
    /// The laser between the incident readings, and their noise but for what all angles share.
    pub drift_per_sr: f64,
    /// The stage's angle and the mount's offset.
    pub angle_per_sr: f64,
}

impl Components {
    /// All together, sr⁻¹.
    pub fn total_per_sr(&self) -> f64 {
        let Self { readout_per_sr, signature_per_sr, drift_per_sr, angle_per_sr } = self;
        readout_per_sr.hypot(*signature_per_sr).hypot(drift_per_sr.hypot(*angle_per_sr))
    }
}

/// Relative standard uncertainties that all angles have in common.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Scale {
    /// The incident readings and what stood in front of the meter, or those of the standard.
    pub incident: f64,
    /// The beam splitter.
    pub splitter: f64,
    /// The lens.
    pub lens: f64,
    /// The solid angle.
    pub solid_angle: f64,
    /// The standard.
    pub standard: f64,
}

impl Scale {
    /// All together.
    pub fn total(&self) -> f64 {
        let Self { incident, splitter, lens, solid_angle, standard } = self;
        incident.hypot(*splitter).hypot(*lens).hypot(*solid_angle).hypot(*standard)
    }
}

/// Retro-reflection at one angle, and what it was made of.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// The stage's angle, degrees.
    pub angle_deg: f64,
    /// When it was read, s, from any zero common to the run.
    pub time_s: f64,
    /// f̄, sr⁻¹; not a number where the meter was over its range.
    pub f_per_sr: f64,
    /// Uncertainties of the value, by their causes.
    pub components: Components,
    /// Flags for what is wrong with the value.
    pub flags: RetroFlags,
    /// The readings.
    pub power: Mean,
    /// Power without a sample, W.
    pub signature_w: f64,
    /// The incident power at the time (of a standard: the net power from it), W.
    pub incident_w: f64,
    /// The part of the beam that passes beside the sample.
    pub spilled: f64,
}

/// Something about a run that is worth a warning.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Note {
    /// No scan without a sample.
    NoSignature,
    /// The scan without a sample does not reach so far.
    SignatureEnds {
        /// Angles beyond its ends.
        angles: usize,
    },
    /// The incident power was read on one side in time only.
    DriftUnknown {
        /// Angles that were read outside the incident readings.
        angles: usize,
    },
    /// The laser changed by much.
    Drift {
        /// Largest relative change between two incident readings in a row.
        relative: f64,
    },
    /// Over range.
    OverRange {
        /// First and last angle.
        angles_deg: (f64, f64),
        /// Their number.
        angles: usize,
    },
    /// Less light than without the sample.
    Negative {
        /// Their number.
        angles: usize,
    },
    /// Too little light to tell from none.
    BelowDetection {
        /// Their number.
        angles: usize,
    },
    /// The beam spills over the sample.
    Edge {
        /// The least angle from the normal at which it does, degrees.
        from_deg: f64,
        /// Angles that were measured beyond.
        angles: usize,
    },
    /// Readings that were left out.
    Outliers {
        /// Readings.
        readings: usize,
        /// Angles that have them.
        angles: usize,
    },
    /// The mount's offset was found by a law, since both sides do not decide it.
    ZeroByLaw {
        /// Standard uncertainty, degrees.
        sigma_deg: f64,
    },
    /// The mount's offset could not be found.
    ZeroAssumed {
        /// Why.
        reason: String,
    },
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoSignature => f.write_str(
                "there is no scan without a sample: stray light and the meter's offset are still in the readings",
            ),
            Self::SignatureEnds { angles } => write!(
                f,
                "{angles} angles lie beyond the scan without a sample: its last value was taken there"
            ),
            Self::DriftUnknown { angles } => write!(
                f,
                "{angles} angles were read before the first or after the last incident reading: the laser's drift there is not known and not in the uncertainties"
            ),
            Self::Drift { relative } => write!(
                f,
                "the incident power changed by {:.2} % between two of its readings: read it more often, or let the laser warm up",
                100.0 * relative
            ),
            Self::OverRange { angles_deg, angles } => write!(
                f,
                "the meter was over its range at {angles} angles from {:.3}° to {:.3}°: no f there",
                angles_deg.0, angles_deg.1
            ),
            Self::Negative { angles } => {
                write!(f, "at {angles} angles there was less light than without the sample")
            }
            Self::BelowDetection { angles } => {
                write!(f, "at {angles} angles the light is below 3 standard deviations")
            }
            Self::Edge { from_deg, angles } => write!(
                f,
                "from {from_deg:.2}° from the normal on the beam is wider than the sample: {angles} angles are flagged `edge`"
            ),
            Self::Outliers { readings, angles } => {
                write!(f, "{readings} readings at {angles} angles were left out as outliers")
            }
            Self::ZeroByLaw { sigma_deg } => write!(
                f,
                "the readings on both sides of the normal do not decide the mount's offset: it is that of a Beckmann or GGX lobe that meets all readings within their scatter, ± {sigma_deg:.3}°. If the sample is neither, give zero_deg"
            ),
            Self::ZeroAssumed { reason } => write!(
                f,
                "the mount's offset is not known ({reason}): the stage's zero was taken for the cosine"
            ),
        }
    }
}

/// A run as retro-reflection.
#[derive(Debug, Clone, PartialEq)]
pub struct Retro {
    /// Angles in the order in which they were measured.
    pub rows: Vec<Row>,
    /// Vacuum wavelength, nm.
    pub wavelength_nm: f64,
    /// Solid angle of the stop, sr.
    pub solid_angle_sr: f64,
    /// Half the angle of a round cone of that solid angle, degrees.
    pub cone_half_angle_deg: f64,
    /// Spread of the directions into the stop.
    pub cone_spread: ConeSpread,
    /// Uncertainties that all angles have in common.
    pub scale: Scale,
    /// The stage's angle at normal incidence, degrees; its standard uncertainty; where it came from.
    pub zero: (f64, f64, ZeroOrigin),
    /// The incident readings: time s, power W (of a standard: net), its standard uncertainty W.
    pub incident: Vec<(f64, f64, f64)>,
    /// Notes that are worth a warning.
    pub notes: Vec<Note>,
}

/// Why there is no retro-reflection.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RetroError {
    /// A number that cannot be.
    #[error("{name}: found {found}, expected {expected}")]
    Number {
        /// Name of the quantity, with its unit.
        name: &'static str,
        /// It.
        found: f64,
        /// Allowed values.
        expected: &'static str,
    },
    /// Nothing was read.
    #[error("no readings of {0}")]
    NoReadings(&'static str),
    /// The incident power is none.
    #[error(
        "the incident reading {number} is {power_w:e} W: expected more than 0 (is the shutter open, is the meter in the beam?)"
    )]
    NoLight {
        /// Which, from 1.
        number: usize,
        /// Power of the incident reading, W.
        power_w: f64,
    },
    /// The incident power is more than the meter shows.
    #[error(
        "the incident reading {number} is over the meter's range: choose a higher one, or put a filter of known transmission in front of it"
    )]
    IncidentOver {
        /// Which, from 1.
        number: usize,
    },
}
