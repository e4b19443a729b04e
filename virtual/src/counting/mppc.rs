//! Many pixels in Geiger mode, avalanche by avalanche, and the analogue sum of their pulses at a comparator.
//!
//! A pixel's voltage comes back exponentially after an avalanche. A charge fires it with the part r of its voltage that is back, and its pulse has r of the height of a full one. Pulses
//! rise at once, decay exponentially and add up; the comparator counts when their sum rises above its level. So a pixel that is half charged may fire below the level, which costs its charge and is not
//! counted, and pulses that lie upon one another are one for longer than each of them.
//!
//! An avalanche may fire another pixel at the same moment (crosstalk), and leave a trapped charge that comes later to the same pixel (afterpulse), both in proportion to its height.

use super::options::Sensor;
use crate::observatory::random::Random;
use rand::RngExt as _;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// A trapped charge on its way.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Charge {
    time_s: f64,
    pixel: usize,
}

impl Eq for Charge {}

impl PartialOrd for Charge {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Charge {
    /// The earliest is the greatest: a heap gives that first.
    fn cmp(&self, other: &Self) -> Ordering {
        other.time_s.total_cmp(&self.time_s).then(other.pixel.cmp(&self.pixel))
    }
}

/// The pixels and their comparator.
#[derive(Debug, Clone)]
pub(super) struct Mppc {
    recovery_s: f64,
    decay_s: f64,
    level: f64,
    crosstalk: f64,
    afterpulse: f64,
    afterpulse_s: f64,
    /// When each pixel fired last.
    fired_s: Vec<f64>,
    /// Sum of the pulses, and when it was that.
    sum: f64,
    sum_s: f64,
    charges: BinaryHeap<Charge>,
}

impl Mppc {
    pub(super) fn new(sensor: &Sensor) -> Self {
        Self {
            recovery_s: 1e-9 * sensor.recovery_ns,
            decay_s: 1e-9 * sensor.pulse_ns,
            level: sensor.level,
            crosstalk: sensor.crosstalk,
            afterpulse: sensor.afterpulse,
            afterpulse_s: 1e-9 * sensor.afterpulse_ns,
            fired_s: vec![f64::NEG_INFINITY; (sensor.pixels as usize).max(1)],
            sum: 0.0,
            sum_s: 0.0,
            charges: BinaryHeap::new(),
        }
    }

    /// Time in which it forgets, s.
    pub(super) fn memory_s(&self) -> f64 {
        let trapped_s = if self.afterpulse > 0.0 { self.afterpulse_s } else { 0.0 };
        self.recovery_s.max(self.decay_s).max(trapped_s)
    }

    /// Whether the next trapped charge that comes before a moment is counted, and when it came.
    pub(super) fn released(&mut self, until_s: f64, random: &mut Random) -> Option<(f64, bool)> {
        self.charges.peek().filter(|charge| charge.time_s < until_s)?;
        let charge = self.charges.pop()?;
        Some((charge.time_s, self.charge(charge.time_s, charge.pixel, random)))
    }

    /// Whether a photon is counted.
    pub(super) fn photon(&mut self, now_s: f64, random: &mut Random) -> bool {
        let pixel = self.any(random);
        self.charge(now_s, pixel, random)
    }

    fn any(&self, random: &mut Random) -> usize {
        let number = random.random::<f64>() * self.fired_s.len() as f64;
        (number as usize).min(self.fired_s.len() - 1)
    }

    /// Whether a charge in a pixel is counted, with all that it brings about at the same moment.
    fn charge(&mut self, now_s: f64, pixel: usize, random: &mut Random) -> bool {
        let before = match self.decay_s > 0.0 {
            true => self.sum * (-(now_s - self.sum_s) / self.decay_s).exp(),
            false => 0.0,
        };
        let mut sum = before;
        let mut next = Some(pixel);
        while let Some(pixel) = next.take() {
            let height = -(-(now_s - self.fired_s[pixel]) / self.recovery_s).exp_m1();
            if random.random::<f64>() >= height {
                break;
            }
            self.fired_s[pixel] = now_s;
            sum += height;
            if self.afterpulse > 0.0 && random.random::<f64>() < self.afterpulse * height {
                let after_s = -(1.0 - random.random::<f64>()).ln() * self.afterpulse_s;
                self.charges.push(Charge { time_s: now_s + after_s, pixel });
            }
            if self.crosstalk > 0.0 && random.random::<f64>() < self.crosstalk * height {
                next = Some(self.any(random));
            }
        }
        (self.sum, self.sum_s) = (sum, now_s);
        before < self.level && sum >= self.level
    }
}

#[cfg(test)]
mod tests {
    use super::super::detector::Detector;
    use super::super::options::{Kind, Sensor};

    fn sensor() -> Sensor {
        Sensor {
            kind: Kind::Mppc,
            pixels: 1_000_000,
            recovery_ns: 50.0,
            pulse_ns: 20.0,
            level: 0.5,
            ..Sensor::default()
        }
    }

    /// Counts over photons, of 4e6 photons.
    fn counted(sensor: &Sensor, rate_hz: f64) -> f64 {
        let exposure_s = 4e6 / rate_hz;
        Detector::new(sensor, 5).counts(rate_hz, exposure_s) as f64 / 4e6
    }

    /// Truth: the sum of equal pulses that decay exponentially has, below one pulse, the distribution function e^(-γν) s^ν/Γ(1+ν) of the generalized Dickman law, ν = nτ (Penrose and Wade 2004, from memory; γ = 0.577 216);
    /// a photon is counted where the sum before it is below the level. Pixels so many that each is full. Γ(1.2) = 0.918 169, Γ(1.5) = 0.886 227, Γ(2) = 1. Tolerance: 4 standard deviations of 4e6 Poisson
    /// counts, 0.2 %.
    #[test]
    fn pulses_that_add_up_are_shot_noise() {
        for (nu, gamma) in [(0.2, 0.918_169), (0.5, 0.886_227), (1.0, 1.0)] {
            for level in [0.3, 0.5, 0.9] {
                let sensor = Sensor { level, ..sensor() };
                let truth = f64::exp(-0.577_216 * nu) * f64::powf(level, nu) / gamma;
                let found = counted(&sensor, nu / 20e-9);
                assert!(
                    (found / truth - 1.0).abs() < 2e-3 / truth.sqrt(),
                    "{nu} {level}: {found} {truth}"
                );
            }
        }
    }

    /// Truth: at 1 kHz photons are alone. One that is never missed and fires k others has k + 1 of height 1 with p^k: above a level of 1.5 are p of all, above 2.5 p². A trapped charge that comes after t fires with r = 1 − e^(−t/τ)
    /// and is above a level of half where t > τ ln 2: with a = τ/τ_ap (2^(−a) − a/(1+a) 2^(−1−a)) of all charges, the pulses over by then. Tolerance: 4 standard deviations.
    #[test]
    fn crosstalk_and_afterpulses_are_as_many_as_they_should_be() {
        for (level, truth) in [(0.5, 1.0), (1.5, 0.1), (2.5, 0.01)] {
            let sensor = Sensor { crosstalk: 0.1, level, ..sensor() };
            let found = counted(&sensor, 1e3);
            assert!((found - truth).abs() < 4.0 * (truth / 4e6_f64).sqrt(), "{level}: {found}");
        }
        let sensor = Sensor { afterpulse: 0.02, afterpulse_ns: 100.0, pulse_ns: 1.0, ..sensor() };
        let a: f64 = 0.5;
        let part = 2_f64.powf(-a) - a / (1.0 + a) * 2_f64.powf(-1.0 - a);
        // Of an afterpulse comes another one, less than 2 % of them.
        let found = (counted(&sensor, 1e3) - 1.0) / 0.02;
        assert!(
            (found / part - 1.0).abs()
                < 0.02 + 4.0 / (0.02 * part * 4e6).sqrt() + 4.0 * 5e-4 / (0.02 * part),
            "{found} {part}"
        );
    }

    /// Truth: one pixel under n = 4e5 Hz with τ = 50 ns. To the first order in nτ a photon is lost that does not fire, ∫(1 − r) dt = τ, or fires below half a pulse, ∫ r dt up to τ ln 2 = τ (ln 2 − 1/2): n (1 − 1.1931 nτ).
    /// Tolerance: the second order, (nτ)², and 4 standard deviations (0.2 %).
    #[test]
    fn a_pulse_of_a_pixel_that_is_not_charged_may_be_below_the_level() {
        let sensor = Sensor { pixels: 1, pulse_ns: 0.01, ..sensor() };
        let found = 1.0 - counted(&sensor, 4e5);
        assert!((found - 1.1931 * 0.02).abs() < 2.4e-3, "{found}");
        // Without a level to pass it would be nτ alone.
        let sensor = Sensor { level: 1e-9, ..sensor };
        let low = 1.0 - counted(&sensor, 4e5);
        assert!((low - 0.02).abs() < 2.4e-3 && found - low > 2e-3, "{low} {found}");
    }
}
