//! Virtual nights from first principles: photons counted one by one (as Poisson numbers), twinkling, catalogues that err, air by others' formulas. Nothing
//! of the crate under test is used but its types and its prior of the scintillation.

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use sunglint_calibration::stars::scintillation::Aperture;
use sunglint_calibration::stars::{Measured, Visit};

/// A channel: κ (the averages of the tables of a thesis over six nights), wavelength (nm), predicted rate of V = 0 in Hz, dark rate (Hz), and noise of the
/// reading of a camera in counts of the converter for each exposure; electrons per count.
pub struct Channel {
    pub kappa: f64,
    pub wavelength_nm: f64,
    pub zero_hz: f64,
    pub dark_hz: f64,
    pub read_adu: f64,
    pub electrons: f64,
}

pub const CHANNELS: [Channel; 6] = [
    camera(0.41, 620.0, 1.2e8),
    camera(0.45, 530.0, 2.0e8),
    camera(0.51, 450.0, 1.6e8),
    counter(546.51, 1064.0, 1.0e8, 756.0),
    counter(29.64, 700.0, 3.0e8, 825.0),
    counter(9.63, 550.0, 2.0e8, 24_737.0),
];

const fn camera(kappa: f64, wavelength_nm: f64, zero_hz: f64) -> Channel {
    Channel { kappa, wavelength_nm, zero_hz, dark_hz: 0.0, read_adu: 300.0, electrons: 0.27 }
}

const fn counter(kappa: f64, wavelength_nm: f64, zero_hz: f64, dark_hz: f64) -> Channel {
    Channel { kappa, wavelength_nm, zero_hz, dark_hz, read_adu: 0.0, electrons: 1.0 }
}

/// Conditions of a night.
#[derive(Clone, Copy)]
pub struct Conditions {
    pub stars: usize,
    pub dimmed: usize,
    /// Relative scatter of what the catalogue says, half of its variance common to the channels.
    pub scatter: f64,
    /// Aerosol depth at 550 nm that the prediction is not told of.
    pub aerosol: f64,
    /// Altitudes of the stars, degrees.
    pub altitude_deg: (f64, f64),
}

pub const USUAL: Conditions =
    Conditions { stars: 25, dimmed: 5, scatter: 0.03, aerosol: 0.0, altitude_deg: (25.0, 85.0) };

/// Exposure of a visit, s.
const EXPOSURE_S: f64 = 10.0;
const DIAMETER_M: f64 = 0.43;

pub struct VirtualNight {
    pub visits: Vec<Visit>,
    /// True for each star that is clean.
    pub clean: Vec<bool>,
    /// True variance of ln(predicted/measured) by counts, for each star and channel.
    pub counts: Vec<[f64; 6]>,
    /// True variance by scintillation, for each star.
    pub twinkle: Vec<f64>,
}

pub struct Dice(Xoshiro256PlusPlus);

impl Dice {
    pub fn new(seed: u64) -> Self {
        Self(Xoshiro256PlusPlus::seed_from_u64(seed))
    }

    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.random::<f64>()
    }

    /// Box and Muller.
    pub fn normal(&mut self) -> f64 {
        let (u, v) = (1.0 - self.0.random::<f64>(), self.0.random::<f64>());
        (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    }

    /// A Poisson number: by waiting times; of large means by the normal distribution, rounded.
    pub fn poisson(&mut self, mean: f64) -> f64 {
        if mean > 2000.0 {
            return (mean + mean.sqrt() * self.normal()).round();
        }
        let (mut time, mut events) = (0.0, -1.0);
        while time <= mean {
            time -= (1.0 - self.0.random::<f64>()).ln();
            events += 1.0;
        }
        events
    }
}

/// Kasten and Young 1989, from the altitude in degrees.
pub fn airmass(altitude_deg: f64) -> f64 {
    1.0 / (altitude_deg.to_radians().sin() + 0.505_72 * (altitude_deg + 6.079_95).powf(-1.636_4))
}

/// Photons of a black body beside those at 550 nm; Ballesteros 2012 gives the temperature of a colour.
fn colour_factor(b_minus_v: f64, nm: f64) -> f64 {
    let kelvin = 4600.0 * (1.0 / (0.92 * b_minus_v + 1.7) + 1.0 / (0.92 * b_minus_v + 0.62));
    let photons = |nm: f64| nm.powi(-4) / (1.438_777e7 / (nm * kelvin)).exp_m1();
    photons(nm) / photons(550.0)
}

/// Young's law as Dravins et al. 1998 print it: σ = 0.09 D^(−2/3) X^1.75 (2T)^(−1/2) e^(−h/8000), D in cm.
fn twinkle(airmass: f64) -> f64 {
    0.09 * (100.0 * DIAMETER_M).powf(-2.0 / 3.0) * airmass.powf(1.75) / (2.0 * EXPOSURE_S).sqrt()
}

pub fn night(seed: u64, conditions: Conditions) -> VirtualNight {
    let mut dice = Dice::new(seed);
    let mut found = VirtualNight { visits: vec![], clean: vec![], counts: vec![], twinkle: vec![] };
    // Which stars are dimmed has nothing to do with their brightness.
    let first_dimmed = conditions.stars - conditions.dimmed;
    for star in 0..conditions.stars {
        let v = dice.uniform(0.0, 7.5);
        let b_minus_v = dice.uniform(-0.2, 1.6);
        let x = airmass(dice.uniform(conditions.altitude_deg.0, conditions.altitude_deg.1));
        let half = conditions.scatter / 2.0_f64.sqrt();
        let magnitude_error = half * dice.normal();
        let sigma = twinkle(x);
        let seen = (sigma * dice.normal() - 0.5 * sigma * sigma).exp();
        let clean = star < first_dimmed;
        let cloud = if clean { 1.0 } else { 1.0 - dice.uniform(0.3, 0.8) };
        let mut counts = [0.0; 6];
        let channels = CHANNELS.iter().enumerate().map(|(c, channel)| {
            // What the catalogue and a clear sky let expect.
            let nm = channel.wavelength_nm;
            let clear = 0.1 * (550.0 / nm).powi(4) + 0.02;
            let catalogue = channel.zero_hz * 10_f64.powf(-0.4 * v) * colour_factor(b_minus_v, nm);
            let predicted_hz = catalogue * (-clear * x).exp();
            // What arrives.
            let haze = conditions.aerosol * (550.0 / nm).powf(1.3);
            let truth = predicted_hz
                * (magnitude_error + half * dice.normal() - haze * x).exp()
                * cloud
                * seen
                / channel.kappa;
            let (rate, sigma, variance) = channel.measure(truth, &mut dice);
            counts[c] = variance / truth.powi(2);
            Some(Measured {
                predicted_hz,
                measured_hz: rate,
                sigma_hz: sigma,
                per_aerosol_depth: Some(-x * (550.0 / nm).powf(1.3)),
            })
        });
        let channels = channels.collect();
        let aperture = Aperture { diameter_m: DIAMETER_M, height_m: 0.0, coefficient: 1.5 };
        found.visits.push(Visit {
            star: format!("star {star}"),
            airmass: x,
            b_minus_v_mag: Some(b_minus_v),
            scintillation: aperture.variance(EXPOSURE_S, x).sqrt(),
            decides: true,
            channels,
        });
        found.clean.push(clean);
        found.counts.push(counts);
        found.twinkle.push(sigma * sigma);
    }
    found
}

impl Channel {
    /// On target and off target, for as long: the rate, its stated uncertainty, and its true variance.
    fn measure(&self, truth: f64, dice: &mut Dice) -> (f64, f64, f64) {
        let dark = self.dark_hz * EXPOSURE_S;
        let read = 2.0 * self.read_adu.powi(2);
        let on = dice.poisson(truth * EXPOSURE_S * self.electrons + dark) / self.electrons;
        let off = dice.poisson(dark) / self.electrons;
        let counts = on - off + read.sqrt() * dice.normal();
        let stated = (on.max(1.0) / self.electrons + off + read).sqrt() / EXPOSURE_S;
        let variance = (truth * EXPOSURE_S + 2.0 * dark) / self.electrons + read;
        (counts / EXPOSURE_S, stated, variance / EXPOSURE_S.powi(2))
    }
}
