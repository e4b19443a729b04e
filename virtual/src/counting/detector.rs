//! A counting detector, event by event.
//!
//! Photons that would be detected come as a Poisson process. A detector that is deaf for a time loses those within it. A detector of many pixels fires a random pixel with the
//! chance to which its bias has recovered since that pixel last fired; the pulses of all pixels meet at one comparator, which counts when its input rises above the level and stays
//! above it for a pulse's width after the last of them; this is the form of the law that a station takes. An MPPC has pulses that decay and add up, crosstalk and afterpulses.

use super::mppc::Mppc;
use super::options::{Kind, Sensor};
use crate::observatory::random::Random;
use rand::{RngExt as _, SeedableRng as _};

/// A detector in the light.
#[derive(Debug, Clone)]
pub struct Detector {
    kind: Kind,
    dead_s: f64,
    recovery_s: f64,
    pulse_s: f64,
    time_s: f64,
    /// End of the time in which it is deaf, or its comparator stays above the level.
    busy_s: f64,
    /// When each pixel fired last.
    pixels_s: Vec<f64>,
    mppc: Option<Mppc>,
    random: Random,
}

/// Times of its own memory that a detector is in the light before its counts are.
const SETTLED: f64 = 12.0;

impl Detector {
    /// A detector whose chance comes from a seed.
    pub fn new(sensor: &Sensor, seed: u64) -> Self {
        let pixels = if sensor.kind == Kind::Pixels { sensor.pixels as usize } else { 0 };
        Self {
            kind: sensor.kind,
            dead_s: 1e-9 * sensor.dead_time_ns,
            recovery_s: 1e-9 * sensor.recovery_ns,
            pulse_s: 1e-9 * sensor.pulse_ns,
            time_s: 0.0,
            busy_s: f64::NEG_INFINITY,
            pixels_s: vec![f64::NEG_INFINITY; pixels.max(1)],
            mppc: (sensor.kind == Kind::Mppc).then(|| Mppc::new(sensor)),
            random: Random::seed_from_u64(seed),
        }
    }

    /// Counts in an exposure under a constant light of so many detectable photons a second, dark events among them. The light was on before.
    pub fn counts(&mut self, rate_hz: f64, exposure_s: f64) -> u64 {
        if rate_hz <= 0.0 {
            return 0;
        }
        let memory_s = match &self.mppc {
            Some(mppc) => mppc.memory_s(),
            None => self.dead_s.max(self.recovery_s).max(self.pulse_s),
        };
        let begin_s = self.time_s + SETTLED * memory_s;
        let end_s = begin_s + exposure_s;
        let mut counts = 0;
        loop {
            // The next photon: an exponential interval.
            let time_s = self.time_s - (1.0 - self.random.random::<f64>()).ln() / rate_hz;
            if let Some(mppc) = &mut self.mppc {
                while let Some((at_s, is_counted)) =
                    mppc.released(time_s.min(end_s), &mut self.random)
                {
                    counts += u64::from(is_counted && at_s >= begin_s);
                }
            }
            if time_s >= end_s {
                // The process has no memory.
                self.time_s = end_s;
                return counts;
            }
            self.time_s = time_s;
            if self.event() && time_s >= begin_s {
                counts += 1;
            }
        }
    }

    /// Whether the photon that has just come is counted.
    fn event(&mut self) -> bool {
        let now_s = self.time_s;
        if let Some(mppc) = &mut self.mppc {
            return mppc.photon(now_s, &mut self.random);
        }
        let free = now_s >= self.busy_s;
        match self.kind {
            // An MPPC has been asked already.
            Kind::Perfect | Kind::Mppc => true,
            Kind::Recovery => {
                let awake_s = now_s - self.busy_s;
                let recovered = -(-awake_s / self.recovery_s).exp_m1();
                let counted = free && self.random.random::<f64>() < recovered;
                if counted {
                    self.busy_s = now_s + self.dead_s;
                }
                counted
            }
            Kind::NonParalysable => {
                if free {
                    self.busy_s = now_s + self.dead_s;
                }
                free
            }
            Kind::Paralysable => {
                self.busy_s = now_s + self.dead_s;
                free
            }
            Kind::Pixels => {
                let number = self.random.random::<f64>() * self.pixels_s.len() as f64;
                let pixel = (number as usize).min(self.pixels_s.len() - 1);
                let since_s = now_s - self.pixels_s[pixel];
                let recovered = -(-since_s / self.recovery_s).exp_m1();
                if self.random.random::<f64>() >= recovered {
                    return false;
                }
                self.pixels_s[pixel] = now_s;
                self.busy_s = now_s + self.pulse_s;
                free
            }
        }
    }
}
