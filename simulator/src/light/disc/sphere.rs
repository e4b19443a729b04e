//! Spheres under the disc: what changes is the phase angle alone, so few of them are looked at, and the rest lies between.

use super::average::{Averager, FLOOR, LOOK, Way};
use super::cut::{Cut, Disc};
use super::profile::{PROFILES, second_moments};
use super::rings;
use glam::{DVec2, DVec3};
use std::f64::consts::PI;

/// Intervals between phase angles at which a sphere is looked at where its answer bends.
const INTERVALS: usize = 16;

impl Averager {
    /// Averages W_k of a sphere of radius 1 (m² sr⁻¹) over the phase angles of the disc's places; gives what a collimated Sun yields. `of` adds
    /// a sphere's values at a phase angle to `count` numbers and gives their relative error; beyond the phase angle `last` there is no light.
    pub fn sphere(
        &mut self,
        (count, last): (usize, f64),
        disc: &Disc,
        to: DVec3,
        earth: Option<Cut>,
        tolerance: f64,
        of: &mut dyn FnMut(f64, &mut [f64]) -> f64,
    ) -> f64 {
        self.sums.clear(count);
        (self.error, self.way) = (0.0, Way::Dark);
        // Right at all angles (Kahan), where the arc cosine is not.
        let phase_of = |sun: DVec3| (2.0 * (sun - to).length().atan2((sun + to).length())).min(PI);
        let phase = phase_of(disc.middle);
        let radius = disc.sine.asin();
        if phase - radius >= last {
            return 0.0;
        }
        let mut own = 0.0_f64;
        let mut at = |phase: f64| {
            let mut out = vec![0.0; count];
            // At 180° itself a mirror's closed form ends.
            own = own.max(of(phase.abs().min(PI - 1e-9), &mut out));
            out
        };
        let middle = at(phase);
        let step = LOOK * radius;
        let bent = (earth.is_none() && phase + radius < last).then(|| {
            self.bend(phase, step, [&at(phase - step), &middle, &at(phase + step)], tolerance)
        });
        if bent != Some(true) {
            let ends = ((phase - radius).max(0.0), (phase + radius).min(last));
            let table = Table::new(ends, &mut at);
            let mut value = |place: DVec2, out: &mut [f64]| {
                let phase = phase_of(disc.direction(place));
                if phase <= last {
                    table.add(phase, 1.0 / disc.cosine(place), out);
                }
            };
            self.way = Way::Rings;
            let cuts: Vec<Cut> = earth.into_iter().collect();
            let limits = (tolerance, FLOOR * tolerance);
            self.error = rings::average(&cuts, count, limits, &mut value, &mut self.sums);
            self.error += table.error;
        }
        self.error += own * self.sums.grey();
        middle.iter().sum()
    }

    /// The average of what is quadratic over the disc, W + ½⟨x²⟩δ² (W'' + W' cot γ + 2 W) (the last for 1/cos ψ). Whether it is quadratic.
    fn bend(
        &mut self,
        phase: f64,
        step: f64,
        [before, here, after]: [&Vec<f64>; 3],
        tolerance: f64,
    ) -> bool {
        let radius = step / LOOK;
        let (mut relative, mut all) = (0.0_f64, 0.0);
        let mut bends = Vec::with_capacity(here.len());
        let light: f64 = here.iter().map(|w| w.abs()).sum::<f64>().max(1e-300);
        for ((b, h), a) in before.iter().zip(here).zip(after) {
            let (first, second) = ((a - b) / (2.0 * step), (a - 2.0 * h + b) / (step * step));
            // At opposition both axes are alike.
            let across = if phase < step { second } else { first / phase.tan() };
            let square = radius * radius;
            bends.push(0.5 * square * (second + across + 2.0 * h));
            relative += square * (second.abs() + across.abs()) / light;
            relative += square * first * first / (light * h.abs().max(1e-300));
            all += h.abs();
        }
        if relative * relative > 4.0 * tolerance {
            return false;
        }
        self.way = Way::Look;
        let count = here.len();
        for (profile, moment) in (0..PROFILES).zip(second_moments()) {
            for (k, bend) in bends.iter().enumerate() {
                let flat = if profile == 0 { here[k] } else { 0.0 };
                self.sums.values[profile * count + k] = flat + moment * bend;
            }
        }
        self.sums.moments = [all, 0.0, 0.0, 0.0, 0.0, 0.0];
        self.error = 0.1 * relative * relative * all;
        true
    }
}

/// W_k between two phase angles: the polynomial through Chebyshev points.
struct Table {
    points: Vec<(f64, Vec<f64>)>,
    /// Estimated error of ΣW.
    error: f64,
}

impl Table {
    fn new((from, to): (f64, f64), at: &mut impl FnMut(f64) -> Vec<f64>) -> Self {
        let points: Vec<(f64, Vec<f64>)> = (0..=INTERVALS)
            .map(|j| {
                let share = (0.5 * PI * j as f64 / INTERVALS as f64).sin().powi(2);
                let phase = from + (to - from) * share;
                (phase, at(phase))
            })
            .collect();
        let half = Self { points: points.iter().step_by(2).cloned().collect(), error: 0.0 };
        // Half of the points err so at the others; all of them by much less.
        let error = points.iter().skip(1).step_by(2).map(|(phase, value)| {
            let mut found = vec![0.0; value.len()];
            half.add(*phase, 1.0, &mut found);
            found.iter().zip(value).map(|(a, b)| (a - b).abs()).sum::<f64>()
        });
        let error = 0.1 * error.fold(0.0, f64::max);
        Self { points, error }
    }

    /// Adds the polynomial, in its barycentric form (Berrut and Trefethen 2004).
    fn add(&self, phase: f64, scale: f64, out: &mut [f64]) {
        let last = self.points.len() - 1;
        let weight = |j: usize, node: f64| {
            let half = if j == 0 || j == last { 0.5 } else { 1.0 };
            half * if j.is_multiple_of(2) { 1.0 } else { -1.0 } / (phase - node)
        };
        if let Some((_, value)) = self.points.iter().find(|(node, _)| *node == phase) {
            out.iter_mut().zip(value).for_each(|(o, v)| *o += scale * v);
            return;
        }
        let all: f64 = self.points.iter().enumerate().map(|(j, (node, _))| weight(j, *node)).sum();
        for (j, (node, value)) in self.points.iter().enumerate() {
            let share = scale * weight(j, *node) / all;
            out.iter_mut().zip(value).for_each(|(o, v)| *o += share * v);
        }
    }
}
