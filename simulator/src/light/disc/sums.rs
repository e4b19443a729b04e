//! Sums over the disc: values before each profile, and where the light comes from.

use super::profile::{PROFILES, profiles};
use glam::DVec2;

/// Function to average: some values at a place of the disc.
pub type Integrand<'a> = dyn FnMut(DVec2, &mut [f64]) + 'a;

/// Sums over places: `values[profile * count + k]`, and the first two moments of the grey light's place.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Sums {
    /// ⟨value_k⟩ weighted by each profile.
    pub values: Vec<f64>,
    /// ⟨Σ_k |value_k|⟩ times 1, x, y, x², xy, y², grey.
    pub moments: [f64; 6],
    scratch: Vec<f64>,
}

impl Sums {
    /// Zero, for `count` values.
    pub fn clear(&mut self, count: usize) {
        self.values.clear();
        self.values.resize(PROFILES * count, 0.0);
        self.scratch.clear();
        self.scratch.resize(count, 0.0);
        self.moments = [0.0; 6];
    }

    /// Adds a place with a weight for each profile.
    pub fn add(&mut self, place: DVec2, weights: &[f64; PROFILES], of: &mut Integrand<'_>) {
        self.scratch.fill(0.0);
        of(place, &mut self.scratch);
        let count = self.scratch.len();
        for (row, weight) in self.values.chunks_exact_mut(count).zip(weights) {
            row.iter_mut().zip(&self.scratch).for_each(|(sum, v)| *sum += weight * v);
        }
        let light = weights[0] * self.scratch.iter().map(|v| v.abs()).sum::<f64>();
        let DVec2 { x, y } = place;
        let with = [1.0, x, y, x * x, x * y, y * y];
        self.moments.iter_mut().zip(with).for_each(|(m, w)| *m += light * w);
    }

    /// Adds a place at distance `r` from the middle with the same weight before every profile. `beyond` is 1 − r.
    pub fn add_dark(&mut self, place: DVec2, beyond: f64, weight: f64, of: &mut Integrand<'_>) {
        let mu = (beyond * (2.0 - beyond)).max(0.0).sqrt();
        self.add(place, &profiles(mu).map(|p| weight * p), of);
    }

    /// Adds other sums, times a factor.
    pub fn add_sums(&mut self, other: &Self, factor: f64) {
        self.values.iter_mut().zip(&other.values).for_each(|(s, v)| *s += factor * v);
        self.moments.iter_mut().zip(other.moments).for_each(|(s, v)| *s += factor * v);
    }

    /// All light before the grey profile.
    pub fn grey(&self) -> f64 {
        self.moments[0]
    }

    /// The sum of |differences| of all values.
    pub fn distance(&self, other: &Self) -> f64 {
        self.values.iter().zip(&other.values).map(|(a, b)| (a - b).abs()).sum()
    }
}
