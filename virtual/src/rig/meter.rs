//! Readings of a power meter: photons and noise, an offset, ranges that have to settle, and an end.

use super::options::Options;
use crate::observatory::random::{Purpose, stream};
use rand::RngExt as _;
use rand_distr::{Distribution as _, StandardNormal};

/// h c, J nm (CODATA 2018, exact).
const HC_J_NM: f64 = 1.986_445_857_148_928e-16;
/// The part of a range above which an automatic meter takes the next, and the part of the lower one below which it goes back.
const UP: f64 = 0.95;
const DOWN: f64 = 0.8;

/// Reading on the display.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shown {
    /// A power, W.
    Watts(f64),
    /// More than its range, W, holds.
    Over(f64),
}

/// A meter between two readings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Meter {
    range: usize,
    automatic: bool,
    /// When it last took another range, s.
    changed_s: f64,
}

impl Meter {
    /// A meter that chooses its range by itself, in the largest.
    pub fn new(options: &Options) -> Self {
        let range = options.meter.ranges_w.len().saturating_sub(1);
        Self { range, automatic: true, changed_s: f64::NEG_INFINITY }
    }

    /// The end of its range, W.
    pub fn range_w(&self, options: &Options) -> f64 {
        options.meter.ranges_w.get(self.range).copied().unwrap_or(f64::INFINITY)
    }

    /// Whether it chooses its range by itself.
    pub fn is_automatic(&self) -> bool {
        self.automatic
    }

    /// Takes a range by its place, or lets it choose (`None`), at a time, s. Whether there is that range.
    pub fn set_range(&mut self, options: &Options, range: Option<usize>, at_s: f64) -> bool {
        match range {
            None => self.automatic = true,
            Some(range) if range < options.meter.ranges_w.len() => {
                self.automatic = false;
                self.take(range, at_s);
            }
            Some(_) => return false,
        }
        true
    }

    fn take(&mut self, range: usize, at_s: f64) {
        if range != self.range {
            (self.range, self.changed_s) = (range, at_s);
        }
    }

    /// The `number`-th reading, of this light, W, at a time, s.
    pub fn read(&mut self, options: &Options, light_w: f64, at_s: f64, number: u64) -> Shown {
        let meter = &options.meter;
        let ends = &meter.ranges_w;
        let mut random = stream(options.seed, Purpose::Bin, number);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let laser = 1.0 + options.laser.noise * normal();
        // So many photons in a reading that their number is normally distributed.
        let photons = light_w * meter.reading_s * options.laser.wavelength_nm / HC_J_NM;
        let shot = if photons > 0.0 { normal() / photons.sqrt() } else { 0.0 };
        let readout = normal();
        let mut true_w = light_w * (laser + shot) + meter.offset_w;
        if random.random::<f64>() < meter.spike_probability {
            true_w *= meter.spike_factor;
        }
        if self.automatic {
            let mut range = self.range;
            while range + 1 < ends.len() && true_w.abs() > UP * ends[range] {
                range += 1;
            }
            while range > 0 && true_w.abs() < DOWN * ends[range - 1] {
                range -= 1;
            }
            self.take(range, at_s);
        }
        let end_w = self.range_w(options);
        let since = at_s - self.changed_s;
        let settling = if meter.settling_s > 0.0 && since.is_finite() {
            meter.settling_error * (-since.max(0.0) / meter.settling_s).exp()
        } else {
            0.0
        };
        let shown = true_w * (1.0 + settling) + readout * meter.noise_of_range * end_w;
        if shown > end_w {
            return Shown::Over(end_w);
        }
        let digit = end_w / meter.steps_of_range;
        Shown::Watts((shown / digit).round() * digit)
    }
}
