//! Amplitudes of harmonics in stretches of a few turns.

use crate::period::lomb_scargle::Cholesky;
use crate::series::Series;
use nalgebra::Complex;
use std::f64::consts::TAU;

/// Stretches of a pass at most.
const MOST: usize = 48;
/// Harmonics at most, and samples of the highest one's turn at least.
pub const HARMONICS: usize = 8;
const SAMPLED: f64 = 2.5;
/// Samples for each unknown of a stretch at least.
const FOR_EACH: f64 = 1.5;
/// A gap within a stretch may be this share of it.
const GAP: f64 = 0.25;

/// Amplitudes of the harmonics of one frequency along a pass.
#[derive(Debug, Clone)]
pub struct Stretches {
    /// The middle of each, s from the middle of the pass.
    pub time_s: Vec<f64>,
    /// By harmonic and stretch: the light is Re Σ A e^{2πi h f t}, in units of the variation's root mean square.
    pub amplitudes: Vec<Vec<Complex<f64>>>,
}

impl Stretches {
    /// Fits one channel at a frequency; times from `middle_s`. `None` where it has no three stretches with enough samples.
    pub fn new(series: &Series, middle_s: f64, hz: f64) -> Option<Self> {
        let span = series.span_s();
        let turns = span * hz;
        let mut steps: Vec<f64> = series.time_s.windows(2).map(|w| w[1] - w[0]).collect();
        steps.sort_by(f64::total_cmp);
        let step = steps.get(steps.len() / 2).copied().filter(|s| *s > 0.0)?;
        let of = (turns / MOST as f64).ceil().max(1.0);
        // A stretch holds so many samples.
        let samples = of / (step * hz);
        let bears = 0.5 * (samples / FOR_EACH - 1.0);
        let harmonics = (1.0 / (SAMPLED * step * hz)).min(bears).max(0.0) as usize;
        let harmonics = harmonics.min(HARMONICS);
        if harmonics == 0 || turns < 2.5 {
            return None;
        }
        let count = (turns / of).floor() as usize;
        let length = span / count as f64;
        let level = series.mean();
        let deviation = {
            let n = series.len() as f64;
            (series.value.iter().map(|v| (v - level).powi(2)).sum::<f64>() / n).sqrt()
        };
        if deviation <= 0.0 || deviation.is_nan() {
            return None;
        }
        let first = series.time_s.first().copied()?;
        let mut found = Self { time_s: Vec::new(), amplitudes: vec![Vec::new(); harmonics] };
        let width = 2 * harmonics + 1;
        for k in 0..count {
            let (from, to) = (first + k as f64 * length, first + (k + 1) as f64 * length);
            let a = series.time_s.partition_point(|t| *t < from);
            let b = series.time_s.partition_point(|t| *t < to);
            let times = &series.time_s[a..b];
            if (times.len() as f64) < FOR_EACH * width as f64 {
                continue;
            }
            let edges = [from].into_iter().chain(times.iter().copied()).chain([to]);
            let all: Vec<f64> = edges.collect();
            if all.windows(2).any(|w| w[1] - w[0] > (GAP * length).max(1.5 * step)) {
                continue;
            }
            let (mut normal, mut right) = (Cholesky::<1>::new(width), vec![0.0; width]);
            let mut row = vec![1.0; width];
            for i in a..b {
                let phase = TAU * hz * (series.time_s[i] - middle_s);
                for h in 0..harmonics {
                    let (sin, cos) = ((h + 1) as f64 * phase).sin_cos();
                    (row[2 * h + 1], row[2 * h + 2]) = (cos, sin);
                }
                let value = (series.value[i] - level) / deviation;
                for p in 0..width {
                    right[p] += row[p] * value;
                    for q in 0..=p {
                        normal.matrix[p * width + q][0] += row[p] * row[q];
                    }
                }
            }
            normal.solve(|i| [right[i]], 1e-6 * (b - a) as f64);
            let x = normal.unknowns();
            found.time_s.push(0.5 * (from + to) - middle_s);
            for (h, row) in found.amplitudes.iter_mut().enumerate() {
                row.push(Complex::new(x[2 * h + 1], -x[2 * h + 2]));
            }
        }
        (found.time_s.len() >= 3).then_some(found)
    }
}
