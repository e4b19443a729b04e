//! Detectors event by event, for tests: photons arrive one by one, and each is counted or lost by what the detector does. No formula for a rate.
#![allow(dead_code)]

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Response of a detector to a photon.
#[derive(Debug, Clone, Copy)]
pub enum Detector {
    /// Counts all.
    Perfect,
    /// Deaf for a time after a count, s.
    NonParalysable(f64),
    /// Deaf for a time after a photon, s.
    Paralysable(f64),
    /// Deaf for a time after a count, s, then recovering with a time constant, s.
    Recovering(f64, f64),
    /// So many pixels, each deaf for a time after its count, s.
    Pixels(usize, f64),
}

/// A detector in some light.
pub struct Events {
    detector: Detector,
    random: Xoshiro256PlusPlus,
    time_s: f64,
    last_s: f64,
    pixels_s: Vec<f64>,
}

impl Events {
    pub fn new(detector: Detector, seed: u64) -> Self {
        let pixels = if let Detector::Pixels(pixels, _) = detector { pixels } else { 0 };
        Self {
            detector,
            random: Xoshiro256PlusPlus::seed_from_u64(seed),
            time_s: 0.0,
            last_s: f64::NEG_INFINITY,
            pixels_s: vec![f64::NEG_INFINITY; pixels],
        }
    }

    pub fn uniform(&mut self) -> f64 {
        self.random.random::<f64>()
    }

    /// The next count under constant light of so many photons a second; `None` where it would come after `until_s`, where the clock then stands.
    pub fn next(&mut self, rate_hz: f64, until_s: f64) -> Option<f64> {
        loop {
            let time_s = self.time_s - (1.0 - self.uniform()).ln() / rate_hz;
            if time_s >= until_s {
                self.time_s = until_s;
                return None;
            }
            self.time_s = time_s;
            if self.counts() {
                return Some(time_s);
            }
        }
    }

    /// The next count under light that is never above `most_hz`: photons of the most, thinned.
    pub fn next_of(
        &mut self,
        light_hz: &dyn Fn(f64) -> f64,
        most_hz: f64,
        until_s: f64,
    ) -> Option<f64> {
        loop {
            let time_s = self.time_s - (1.0 - self.uniform()).ln() / most_hz;
            if time_s >= until_s {
                self.time_s = until_s;
                return None;
            }
            self.time_s = time_s;
            if self.uniform() * most_hz < light_hz(time_s) && self.counts() {
                return Some(time_s);
            }
        }
    }

    /// Whether the photon that has just come is counted.
    fn counts(&mut self) -> bool {
        let since_s = self.time_s - self.last_s;
        let counted = match self.detector {
            Detector::Perfect => true,
            Detector::NonParalysable(dead_s) => since_s >= dead_s,
            Detector::Paralysable(dead_s) => {
                self.last_s = self.time_s;
                since_s >= dead_s
            }
            Detector::Recovering(dead_s, recovery_s) => {
                let chance = 1.0 - (-(since_s - dead_s) / recovery_s).exp();
                since_s >= dead_s && self.uniform() < chance
            }
            Detector::Pixels(pixels, dead_s) => {
                let pixel = (self.uniform() * pixels as f64) as usize;
                let alive = self.time_s - self.pixels_s[pixel] >= dead_s;
                if alive {
                    self.pixels_s[pixel] = self.time_s;
                }
                alive
            }
        };
        if counted {
            self.last_s = self.time_s;
        }
        counted
    }

    /// Counts in a bin of constant light.
    pub fn count(&mut self, rate_hz: f64, from_s: f64, until_s: f64) -> u64 {
        debug_assert!((self.time_s - from_s).abs() < 1e-9 * until_s.max(1.0));
        let mut counts = 0;
        while self.next(rate_hz, until_s).is_some() {
            counts += 1;
        }
        counts
    }
}
