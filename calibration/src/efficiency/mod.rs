//! A detector's efficiency, from a monochromator's light on a photodiode and on the detector.
//!
//! A beam splitter sends a part of the light to a photodiode of known responsivity ζ, the rest, through neutral-density filters, to the sensor. Both stand in the light of the
//! same point, whose radiant intensity is the same for both:
//!
//! Φ_pd = U/(R ζ),  Φ_s = Φ_pd (A_s/d_s²) T_s / ((A_pd/d_pd²) T_pd),  η = ν hc/(λ Φ_s)
//!
//! with the photodiode's voltage U less its dark voltage over the load R, V A⁻¹; ζ in A W⁻¹; so that Φ is in W (of the monochromator's line) and η is a pure number. ν is the
//! sensor's rate, its dead time undone before the dark rate is subtracted.
//!
//! Each reading gives a [`Row`] or a flag that says why not; nothing is clipped: an efficiency above 1 stands there with its flag.

mod reduce;
mod run;
mod table;

pub use reduce::reduce;
pub use run::{EfficiencyRun, EfficiencyRunError, Parts, check_run, read_run, reduce_run};
pub use table::{to_curve, to_table};

use crate::detector::Linearity;
use serde::{Deserialize, Serialize};
use std::fmt;

bitflags::bitflags! {
    /// Faults of an efficiency. In files the metadata `flag_bits` names the bits.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
    pub struct EfficiencyFlags: u32 {
        /// The sensor counted more than tells a rate.
        const SATURATED = 1;
        /// The photodiode saw no light that can be told from none.
        const NO_LIGHT = 1 << 1;
        /// The sensor counted less than in the dark.
        const NEGATIVE = 1 << 2;
        /// More counts than photons.
        const ABOVE_ONE = 1 << 3;
        /// Less than 3 standard deviations above 0.
        const BELOW_DETECTION = 1 << 4;
        /// Beyond a table: responsivity, splitter or filter.
        const NOT_COVERED = 1 << 5;
        /// A reading is missing.
        const MISSING = 1 << 6;
        /// The dead time's law is not trusted at this rate.
        const UNTRUSTED = 1 << 7;
        /// Readings of this wavelength disagree by more than their uncertainties.
        const DISAGREE = 1 << 8;
        /// The responsivity is that of a stated law beyond its table.
        const EXTRAPOLATED = 1 << 9;
        /// No filter kept the grating's second order away.
        const SECOND_ORDER = 1 << 10;
        /// The rig changed suddenly about this reading.
        const DRIFT_STEP = 1 << 11;
    }
}

/// Values read at one step of the monochromator.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Reading {
    /// Vacuum wavelength, nm.
    pub wavelength_nm: f64,
    /// The photodiode's voltage, V; not a number where it is missing.
    pub photodiode_v: f64,
    /// Dark voltage of the photodiode, V.
    pub photodiode_dark_v: f64,
    /// The standard uncertainty of their difference, V.
    pub sigma_v: f64,
    /// Counts of the sensor (ADU of a camera); not a number where they are missing.
    pub counts: f64,
    /// In this time, s.
    pub exposure_s: f64,
    /// Counts (ADU) in the dark.
    pub dark_counts: f64,
    /// In this time, s.
    pub dark_exposure_s: f64,
    /// Relative change of the efficiency by a drift of the rig since its begin: it is undone.
    pub drift_relative: f64,
    /// Relative standard uncertainty of that change.
    pub sigma_drift_relative: f64,
    /// Whether the rig changed suddenly about this reading.
    pub drift_step: bool,
    /// Whether the grating's second order may be in the light.
    pub second_order: bool,
}

/// A table over wavelength, on straight lines between its points.
#[derive(Debug, Clone, PartialEq)]
pub struct Lookup {
    wavelength_nm: Vec<f64>,
    value: Vec<f64>,
}

/// A factor of the light with its relative standard uncertainty, the same at all wavelengths.
#[derive(Debug, Clone, PartialEq)]
pub struct Factor {
    /// Name of the factor, for messages.
    pub name: String,
    /// It.
    pub value: Lookup,
    /// Relative standard uncertainty.
    pub relative_sigma: f64,
}

/// An area in the light and where it stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aperture {
    /// Area of the aperture, mm².
    pub area_mm2: f64,
    /// Relative standard uncertainty of the area.
    pub area_relative_sigma: f64,
    /// Distance from the point that the light comes from, mm.
    pub distance_mm: f64,
    /// Standard uncertainty of the distance, mm.
    pub distance_sigma_mm: f64,
}

/// Law of a photodiode's responsivity beyond the ends of its table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ExtrapolationLaw {
    /// The electrons per photon of the table's end: the responsivity is proportional to the wavelength.
    ConstantQuantumEfficiency,
    /// The straight line through the last two points of the table, and 0 where that is below 0.
    Linear,
}

/// Responsivity beyond the ends of a photodiode's table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extrapolation {
    /// Law of the extrapolation.
    pub law: ExtrapolationLaw,
    /// First and last wavelength for which it is taken, nm.
    pub within_nm: (f64, f64),
    /// Relative standard uncertainty that it adds to that of the table.
    pub relative_sigma: f64,
}

/// The photodiode of a set of readings.
#[derive(Debug, Clone, PartialEq)]
pub struct Photodiode {
    /// Responsivity, A W⁻¹.
    pub responsivity: Factor,
    /// Responsivity beyond the table; none where there is none.
    pub extrapolation: Option<Extrapolation>,
    /// Load or amplifier, V A⁻¹.
    pub load_ohm: f64,
    /// Relative standard uncertainty of the value before.
    pub load_relative_sigma: f64,
    /// Aperture in front of it: area and place.
    pub aperture: Aperture,
}

/// Readings with one photodiode and one grating.
#[derive(Debug, Clone, PartialEq)]
pub struct Set {
    /// Readings, in any order.
    pub readings: Vec<Reading>,
    /// The photodiode.
    pub photodiode: Photodiode,
    /// Transmissions between the point and the photodiode.
    pub towards_photodiode: Vec<Factor>,
    /// Transmissions between the point and the sensor.
    pub towards_sensor: Vec<Factor>,
    /// Standard uncertainty of the wavelengths, nm.
    pub wavelength_sigma_nm: f64,
}

/// How the sensor's counts are its rate.
#[derive(Debug, Clone, PartialEq)]
pub enum Counting {
    /// Counts, with dead time.
    Counter {
        /// The law of the dead time.
        linearity: Linearity,
        /// Relative standard uncertainty of the dead time.
        dead_time_relative_sigma: f64,
    },
    /// ADU of so many electrons: a rate is of electrons.
    Camera {
        /// Electrons per ADU.
        gain_e_per_adu: f64,
        /// Relative standard uncertainty of the value before.
        gain_relative_sigma: f64,
        /// ADU at and above which a reading is saturated.
        saturation_adu: f64,
    },
}

/// The sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensor {
    /// How its counts are a rate.
    pub counting: Counting,
    /// Aperture in front of it: area and place.
    pub aperture: Aperture,
}

/// Uncertainties of one efficiency by where they come from.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Components {
    /// Photons counted, with light and in the dark.
    pub counts: f64,
    /// The photodiode's voltage.
    pub photodiode: f64,
    /// The monochromator's wavelength.
    pub wavelength: f64,
    /// The dead time (of a camera: its gain).
    pub linearity: f64,
    /// The responsivity.
    pub responsivity: f64,
    /// The load.
    pub load: f64,
    /// Areas and distances.
    pub geometry: f64,
    /// Splitter and filters.
    pub transmissions: f64,
    /// Change of the rig between readings of its reference wavelength.
    pub drift: f64,
}

impl Components {
    /// Returns the uncertainty that each reading has independently of the others.
    pub fn own(&self) -> f64 {
        self.counts.hypot(self.photodiode)
    }

    /// All together.
    pub fn total(&self) -> f64 {
        let Self { wavelength, linearity, responsivity, load, geometry, transmissions, .. } = self;
        let common = wavelength.hypot(*linearity).hypot(*responsivity).hypot(*load);
        self.own().hypot(common).hypot(geometry.hypot(*transmissions)).hypot(self.drift)
    }
}

/// The efficiency at a wavelength.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Vacuum wavelength, nm.
    pub wavelength_nm: f64,
    /// η; not a number only beside a flag.
    pub efficiency: f64,
    /// Uncertainties of the efficiency, by where they come from.
    pub components: Components,
    /// Photons on the sensor, Hz.
    pub photons_hz: f64,
    /// The sensor's rate without the dark, Hz (electrons of a camera).
    pub rate_hz: f64,
    /// Readings behind it.
    pub readings: usize,
    /// Faults of the efficiency at this wavelength.
    pub flags: EfficiencyFlags,
}

/// Information for a warning: a fault and the wavelengths that have it.
#[derive(Debug, Clone, PartialEq)]
pub struct Note {
    /// Fault that the warning is about.
    pub flag: EfficiencyFlags,
    /// First and last wavelength, nm.
    pub range_nm: (f64, f64),
    /// Wavelengths.
    pub count: usize,
    /// The largest efficiency among them.
    pub largest: f64,
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { flag, range_nm: (from, to), count, largest } = self;
        let at = match count {
            1 => format!("wavelength, {from} nm"),
            _ => format!("wavelengths from {from} to {to} nm"),
        };
        let what = match *flag {
            EfficiencyFlags::SATURATED => "the sensor is saturated: less light, or a denser filter",
            EfficiencyFlags::NO_LIGHT => "the photodiode saw no light: no efficiency there",
            EfficiencyFlags::NEGATIVE => "fewer counts than in the dark",
            EfficiencyFlags::ABOVE_ONE => {
                return write!(
                    f,
                    "{count} {at}: more counts than photons, η up to {largest:.4}: look at areas, distances, filters, load and responsivity; nothing is clipped"
                );
            }
            EfficiencyFlags::BELOW_DETECTION => "η is below 3 standard deviations",
            EfficiencyFlags::NOT_COVERED => "beyond the table of responsivity, splitter or filter",
            EfficiencyFlags::MISSING => "a reading is missing",
            EfficiencyFlags::UNTRUSTED => "the law of the dead time is not trusted at these rates",
            EfficiencyFlags::EXTRAPOLATED => {
                "beyond the photodiode's table its responsivity is that of the stated law"
            }
            EfficiencyFlags::DRIFT_STEP => {
                "the rig changed suddenly about these readings: half of that change is their uncertainty; read them again"
            }
            EfficiencyFlags::SECOND_ORDER => {
                "no filter kept the grating's second order away: light of half the wavelength may be in both readings"
            }
            _ => "readings of one wavelength disagree: their uncertainty was made larger by that",
        };
        write!(f, "{count} {at}: {what}")
    }
}

/// A detector's efficiency.
#[derive(Debug, Clone, PartialEq)]
pub struct Efficiency {
    /// By wavelength, increasing.
    pub rows: Vec<Row>,
    /// Information for a warning: a fault and the wavelengths that have it.
    pub notes: Vec<Note>,
}

/// Why there is none.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EfficiencyError {
    /// A number that cannot be.
    #[error("{name}: found {found}, expected {expected}")]
    Number {
        /// Name of the quantity, with its unit.
        name: String,
        /// It.
        found: f64,
        /// Values that are allowed.
        expected: &'static str,
    },
    /// A reading that cannot be.
    #[error("reading {reading} of set {set}: {name}: found {found}, expected {expected}")]
    Reading {
        /// Which set, from 1.
        set: usize,
        /// Which of its readings, from 1.
        reading: usize,
        /// Name of the wrong value in the reading.
        name: &'static str,
        /// It.
        found: f64,
        /// Values that are allowed.
        expected: &'static str,
    },
    /// No reading at all.
    #[error("no readings")]
    NoReadings,
}

impl Lookup {
    /// A table; `name` says of what in errors.
    ///
    /// # Errors
    /// Different lengths or none, wavelengths that do not increase, values that are not above 0.
    pub fn new(
        name: &str,
        wavelength_nm: Vec<f64>,
        value: Vec<f64>,
    ) -> Result<Self, EfficiencyError> {
        let bad = |found: f64, expected: &'static str| {
            Err(EfficiencyError::Number { name: name.to_owned(), found, expected })
        };
        if wavelength_nm.len() != value.len() || value.is_empty() {
            return bad(value.len() as f64, "as many values as wavelengths, one at least");
        }
        if let Some(pair) = wavelength_nm.windows(2).find(|p| p[1].is_nan() || p[1] <= p[0]) {
            return bad(pair[1], "wavelengths that increase");
        }
        if let Some(value) = value.iter().find(|v| !(v.is_finite() && **v >= 0.0)) {
            return bad(*value, "values of 0 or above");
        }
        Ok(Self { wavelength_nm, value })
    }

    /// The same at all wavelengths.
    ///
    /// # Errors
    /// A value that is not 0 or above.
    pub fn constant(name: &str, value: f64) -> Result<Self, EfficiencyError> {
        Self::new(name, vec![0.0, f64::MAX], vec![value, value])
    }

    /// Returns the value at a wavelength; none beyond the ends of the table.
    pub fn at(&self, nm: f64) -> Option<f64> {
        let (first, last) = (self.wavelength_nm.first()?, self.wavelength_nm.last()?);
        if !(*first..=*last).contains(&nm) {
            return None;
        }
        let k = self.wavelength_nm.partition_point(|x| *x < nm).max(1);
        let k = k.min(self.value.len() - 1);
        let (low, high) = (k.saturating_sub(1), k);
        let width = self.wavelength_nm[high] - self.wavelength_nm[low];
        let part = if width > 0.0 { (nm - self.wavelength_nm[low]) / width } else { 0.0 };
        Some(self.value[low] + part * (self.value[high] - self.value[low]))
    }
}

impl Lookup {
    /// Returns the value at a wavelength beyond the table by a law of it.
    fn beyond(&self, law: ExtrapolationLaw, nm: f64) -> Option<f64> {
        let last = self.value.len().checked_sub(1)?;
        // The end that is nearer, and its neighbour.
        let (end, next) = if nm < self.wavelength_nm[0] {
            (0, 1.min(last))
        } else {
            (last, last.saturating_sub(1))
        };
        let (x, y) = (self.wavelength_nm[end], self.value[end]);
        match law {
            ExtrapolationLaw::ConstantQuantumEfficiency => Some(y * nm / x),
            ExtrapolationLaw::Linear => {
                let width = self.wavelength_nm[next] - x;
                if width == 0.0 {
                    return None;
                }
                Some((y + (self.value[next] - y) / width * (nm - x)).max(0.0))
            }
        }
    }
}

impl Photodiode {
    /// Returns the responsivity at a wavelength, A W⁻¹, its relative standard uncertainty, and whether it lies beyond the table; none where nothing is known.
    pub fn responsivity_at(&self, nm: f64) -> Option<(f64, f64, bool)> {
        let sigma = self.responsivity.relative_sigma;
        if let Some(value) = self.responsivity.value.at(nm) {
            return Some((value, sigma, false));
        }
        let beyond = self.extrapolation.filter(|e| nm >= e.within_nm.0 && nm <= e.within_nm.1)?;
        let value = self.responsivity.value.beyond(beyond.law, nm)?;
        Some((value, sigma.hypot(beyond.relative_sigma), true))
    }
}

impl Factor {
    /// An exact number at all wavelengths.
    ///
    /// # Errors
    /// The errors of [`Lookup::constant`].
    pub fn constant(name: &str, value: f64, relative_sigma: f64) -> Result<Self, EfficiencyError> {
        Ok(Self { name: name.to_owned(), value: Lookup::constant(name, value)?, relative_sigma })
    }
}
