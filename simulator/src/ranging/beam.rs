//! The beam on its way up, and who catches what comes down.

use sunglint_radiometry::constants::HC_J_NM;
use sunglint_radiometry::station::{BeamShape, Laser};

/// A pulsed beam that leaves a point of the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beam {
    /// Wavelength, vacuum nm.
    pub wavelength_nm: f64,
    /// Line width, nm.
    pub linewidth_nm: f64,
    /// Energy of a pulse as it leaves, J.
    pub pulse_energy_j: f64,
    /// Length of a pulse, s.
    pub pulse_length_s: f64,
    /// Pulses per second.
    pub repetition_rate_hz: f64,
    /// Full angle of divergence β, radians.
    pub divergence_rad: f64,
    /// Radius R₀ at the telescope, m.
    pub radius_m: f64,
    /// Shape of the beam.
    pub shape: BeamShape,
}

impl Beam {
    /// The beam of a station's laser.
    pub fn of(laser: &Laser) -> Self {
        Self {
            wavelength_nm: laser.wavelength_nm,
            linewidth_nm: laser.linewidth_nm,
            pulse_energy_j: laser.pulse_energy_j,
            pulse_length_s: laser.pulse_length_s,
            repetition_rate_hz: laser.repetition_rate_hz,
            divergence_rad: (laser.divergence_arcsec / 3600.0).to_radians(),
            radius_m: laser.beam_radius_m,
            shape: laser.beam,
        }
    }

    /// Radius of the spot at a range, m: r tan(β/2) + R₀ (thesis eq. A.1).
    pub fn spot_radius_m(&self, range_m: f64) -> f64 {
        range_m * (0.5 * self.divergence_rad).tan() + self.radius_m
    }

    /// Energy of a pulse through a square metre across the beam, J m⁻², at a range and a distance from the axis, without the air.
    pub fn fluence_j_m2(&self, range_m: f64, off_axis_m: f64) -> f64 {
        let radius = self.spot_radius_m(range_m);
        let mean = self.pulse_energy_j / (std::f64::consts::PI * radius * radius);
        match self.shape {
            BeamShape::TopHat if off_axis_m <= radius => mean,
            BeamShape::TopHat => 0.0,
            BeamShape::Gaussian => 2.0 * mean * (-2.0 * (off_axis_m / radius).powi(2)).exp(),
        }
    }

    /// Spectral irradiance on the axis while a pulse passes, W m⁻² nm⁻¹, without the air (thesis eq. A.3).
    pub fn peak_spectral_irradiance(&self, range_m: f64) -> f64 {
        self.fluence_j_m2(range_m, 0.0) / (self.pulse_length_s * self.linewidth_nm)
    }

    /// Irradiance on the axis in the mean over pulses and pauses, W m⁻², without the air.
    pub fn mean_irradiance_w_m2(&self, range_m: f64) -> f64 {
        self.fluence_j_m2(range_m, 0.0) * self.repetition_rate_hz
    }
}

/// Who catches the light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Receiver {
    /// Collecting area, m².
    pub area_m2: f64,
    /// Counts per photon that reaches the telescope, at the laser's wavelength.
    pub efficiency: f64,
}

impl Receiver {
    /// Counts of an energy per square metre at the telescope, J m⁻², of a wavelength.
    pub fn counts(&self, fluence_j_m2: f64, wavelength_nm: f64) -> f64 {
        fluence_j_m2 * self.area_m2 * self.efficiency * wavelength_nm / HC_J_NM
    }
}

/// The probability that a shot of which `mean` photons are detected on the average yields at least one: 1 − e^{−n̄}.
pub fn detection_probability(mean: f64) -> f64 {
    -(-mean).exp_m1()
}
