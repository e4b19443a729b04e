//! A quantity that wanders about zero: the same at a moment whenever it is asked for.
//!
//! A normally distributed process of variance 1 whose correlation falls as e^(−Δt/T) (Ornstein and Uhlenbeck), on a grid of times between which it
//! stands still: x_i = ρ x_(i−1) + √(1−ρ²) ε_i. The grid lies in blocks, each with its own stream of ε; a block is entered
//! through the whole block before it, begun at 0, so that what was before is forgotten to 1e−8. So a value depends on its time and
//! the seed alone.

use super::random::{Purpose, stream};
use rand_distr::{Distribution as _, StandardNormal};

/// Steps in a correlation time, at least and at most.
const STEPS: [f64; 2] = [16.0, 2000.0];
/// The longest step of a quick process, s.
const QUICK_S: f64 = 0.01;
/// Exponent of forgetting: what is forgotten is less than e^−18.4 = 1e−8.
const FORGOTTEN: f64 = 18.4;
/// The shortest block.
const LEAST_STEPS: usize = 4096;

/// A wandering quantity of mean 0 and variance 1.
#[derive(Debug, Clone)]
pub struct Wander {
    seed: u64,
    step_s: f64,
    /// ρ and √(1−ρ²).
    carry: [f64; 2],
    length: usize,
    /// The block that was asked for last.
    block: i64,
    values: Vec<f64>,
}

impl Wander {
    /// With a correlation time, s (above 0).
    pub fn new(seed: u64, time_s: f64) -> Self {
        let step_s = QUICK_S.clamp(time_s / STEPS[1], time_s / STEPS[0]);
        let rho = (-step_s / time_s).exp();
        let length = ((FORGOTTEN * time_s / step_s).ceil() as usize).max(LEAST_STEPS);
        let carry = [rho, (1.0 - rho * rho).sqrt()];
        Self { seed, step_s, carry, length, block: 0, values: Vec::new() }
    }

    /// The time between two values, s.
    pub fn step_s(&self) -> f64 {
        self.step_s
    }

    /// The value at a time, s.
    pub fn at(&mut self, time_s: f64) -> f64 {
        let step = (time_s / self.step_s).floor() as i64;
        let block = step.div_euclid(self.length as i64);
        if block != self.block || self.values.is_empty() {
            self.enter(block);
        }
        self.values[step.rem_euclid(self.length as i64) as usize]
    }

    fn enter(&mut self, block: i64) {
        let [rho, fresh] = self.carry;
        let mut value = 0.0;
        self.values.clear();
        for (number, kept) in [(block - 1, false), (block, true)] {
            let mut random = stream(self.seed, Purpose::Wander, number as u64);
            for _ in 0..self.length {
                let noise: f64 = StandardNormal.sample(&mut random);
                value = rho * value + fresh * noise;
                if kept {
                    self.values.push(value);
                }
            }
        }
        self.block = block;
    }
}
