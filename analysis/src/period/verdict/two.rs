//! Two periods at once: a body that tumbles, or the light of two bodies.
//!
//! Light with two frequencies that have no common period has no period. A search for one finds a long one, of which both are nearly parts, with many harmonics; or one of the two, which leaves the other; or, where the two
//! are near a small ratio, a period between. So where many harmonics stand out, or few leave a line, the light is fitted by a lattice of two free frequencies: all i f₁ + j f₂ with |i| + |j| up to 3. This is held
//! against the harmonics, with amplitudes that are constant or drift, by the Bayesian information criterion (BIC). Where the lattice does clearly better, there are two periods. Where it does better by less, or where small multiples of the
//! two frequencies are so near to one another that light of one period which changes from turn to turn would look alike, the data do not choose: the two are members of a family. Frequencies
//! that are harmonics of one are no two periods.

use super::super::fit::fit;
use super::super::lines::{Drifting, drifting};
use super::super::significance::{false_alarm, joint_gain};
use super::super::sums::turns;
use super::super::{lomb_scargle, spectrum::median_step};
use super::outcome::Estimate;
use super::search::Search;
use crate::series::Series;
use nalgebra::{Cholesky, DMatrix, DVector};
use std::f64::consts::TAU;

/// Places of the lattice: multiples of the first and the second frequency. The harmonics of each alone come first.
const LATTICE: [(i32, i32); 12] = [
    (1, 0),
    (0, 1),
    (2, 0),
    (0, 2),
    (3, 0),
    (0, 3),
    (1, 1),
    (1, -1),
    (2, 1),
    (2, -1),
    (1, 2),
    (1, -2),
];
/// Number of those that are harmonics of one of the two.
const PURE: usize = 6;
/// The highest multiple in it.
const HIGHEST: usize = 3;
/// Numbers of places, from the first, of the models that are held against one period: harmonics of both alone, with the sum and the difference, all.
const ORDERS: [usize; 5] = [2, 4, PURE, PURE + 2, LATTICE.len()];
/// Frequencies of the lattice of which two may span all of it.
const PRIMITIVE: [(i32, i32); 8] =
    [(1, 0), (0, 1), (1, 1), (1, -1), (2, 1), (2, -1), (1, 2), (1, -2)];
/// Harmonics that are a sign of two periods by themselves.
const LEAST_HARMONICS: usize = 9;
/// Multiples of both that are compared (their sum, at most), and turns over the span by which they differ: light that changes over a pass by its phase angle has lines beside its own, a turn or so away;
/// glints that are seen for a half of it, two.
const MULTIPLES: u32 = 7;
const APART: f64 = 1.5;
const WELL_APART: f64 = 2.5;
/// Beside few harmonics the same holds for a window's peak of at least such a height.
const WINDOW: f64 = 0.25;
/// Samples in all at most: more are not asked.
const MOST_SAMPLES: usize = 20_000;
/// Lines that are taken out one after the other, and pairs of them that are followed.
const LINES: usize = 4;
const FOLLOWED: usize = 3;
/// Share of what the harmonics leave that the lattice leaves at most where two periods are told as the only answer: of models that are both only nearly right, the better by less than that may be the wrong one.
const LEAVES: f64 = 0.8;
/// Frequencies whose small multiples differ by fewer turns over the span are harmonics of one.
pub(super) const COMMON: f64 = 0.1;
/// Pairs with a half or a third of a frequency that must be better by this: a strong second harmonic is found for its frequency.
const DEEPER: f64 = 20.0;
/// Most of a chance that noise would do as well.
const CHANCE: f64 = 1e-3;
/// Turns of the slower of the two at least.
const LEAST_TURNS: f64 = 3.0;

/// Explanation of a light by two frequencies.
#[derive(Debug, Clone, Copy)]
pub enum Pair {
    /// Two periods, the one with more light first.
    Two(Estimate, Estimate),
    /// Those, or one period, of light that may change within a part of the data.
    Either(Estimate, Estimate),
}

/// The share of the weighted variance of a series that places of the lattice explain; `None` where they cannot be told apart.
fn share(series: &Series, pair: [f64; 2], terms: &[(i32, i32)]) -> Option<f64> {
    let columns = 2 * terms.len() + 1;
    if series.len() <= 2 * columns {
        return None;
    }
    let middle = series.time_s[0] + 0.5 * series.span_s();
    let mean = series.mean();
    let mut normal = vec![0.0; columns * columns];
    let mut right = DVector::<f64>::zeros(columns);
    let mut row = vec![1.0; columns];
    let mut variation = 0.0;
    let times = |a: [f64; 2], b: [f64; 2]| [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]];
    for i in 0..series.len() {
        let t = series.time_s[i] - middle;
        let powers = pair.map(|f| {
            let (sin, cos) = (TAU * turns(f, t)).sin_cos();
            let mut all = [[1.0, 0.0]; HIGHEST + 1];
            for k in 1..=HIGHEST {
                all[k] = times(all[k - 1], [cos, sin]);
            }
            all
        });
        for (k, (i, j)) in terms.iter().enumerate() {
            let [c, s] = powers[1][j.unsigned_abs() as usize];
            let second = [c, if *j < 0 { -s } else { s }];
            [row[2 * k + 1], row[2 * k + 2]] = times(powers[0][i.unsigned_abs() as usize], second);
        }
        let (w, y) = (series.weight[i], series.value[i] - mean);
        for p in 0..columns {
            let by = w * row[p];
            right[p] += by * y;
            for (to, q) in normal[p * columns..=p * columns + p].iter_mut().zip(&row) {
                *to += by * q;
            }
        }
        variation += w * y * y;
    }
    let mut normal = DMatrix::from_row_slice(columns, columns, &normal);
    normal.fill_upper_triangle_with_lower_triangle();
    let ridge = 1e-10 * normal.diagonal().max();
    for k in 0..columns {
        normal[(k, k)] += ridge;
    }
    let solution = Cholesky::new(normal)?.solve(&right);
    (variation > 0.0).then(|| (right.dot(&solution) / variation).clamp(0.0, 1.0))
}

/// Returns the least by which small multiples of two frequencies differ over a span, turns; also where the times of the samples (frequencies of the window, among them that of even samples) fold them.
pub(super) fn multiples_apart(
    first_hz: f64,
    second_hz: f64,
    window_hz: &[f64],
    span_s: f64,
) -> f64 {
    let mut least = f64::INFINITY;
    for p in 1..MULTIPLES {
        for q in 1..=MULTIPLES - p {
            let (a, b) = (first_hz * f64::from(q), second_hz * f64::from(p));
            least = least.min((a - b).abs());
            for w in window_hz.iter().flat_map(|w| [*w, 2.0 * w]) {
                least = least.min((a + b - w).abs()).min(((a - b).abs() - w).abs());
            }
        }
    }
    least * span_s
}

impl Search<'_> {
    /// Whether harmonics of a base, with amplitudes that may drift, leave a line that is no noise.
    fn leaves_a_line(&self, base: f64, harmonics: usize, independent: f64) -> bool {
        let Some(grid) = self.range.grid(1) else { return false };
        let mut joint = vec![0.0; grid.n];
        for s in self.series {
            let model = (0..=2).rev().find_map(|drift| drifting(s, base, harmonics, drift));
            let Some(model) = model else { return false };
            let left = Series { value: model.left, ..(*s).clone() };
            let Ok(power) = lomb_scargle(&left, &grid, 1) else { return false };
            joint.iter_mut().zip(power).for_each(|(j, p)| *j += joint_gain(p, s.len(), 1));
        }
        let gain = joint.into_iter().fold(0.0, f64::max);
        false_alarm(gain, self.series, 1, self.range.counted_hz, independent)
            .is_ok_and(|p| p < CHANCE)
    }

    /// The cost of a number of unknowns in each series, in twice the logarithm of the likelihood (BIC).
    fn cost(&self, unknowns: usize) -> f64 {
        (unknowns * self.series.len()) as f64 * (self.samples() as f64).ln()
    }

    /// The best score of harmonics of a base whose amplitudes are constant, or drift by a line or a parabola.
    fn score_of_one(&self, base: f64, harmonics: usize) -> f64 {
        let score = |drift: usize| -> Option<f64> {
            let unknowns = Drifting::unknowns(harmonics, drift);
            let mut gain = 0.0;
            for s in self.series {
                let power = drifting(s, base, harmonics, drift)?.power;
                let free = s.len().saturating_sub(unknowns + 1) as f64;
                gain -= free * (1.0 - power).max(1e-14).ln();
            }
            Some(gain - self.cost(unknowns))
        };
        let constant = self.gain(base, harmonics) - self.cost(2 * harmonics);
        (1..=2).filter_map(score).fold(constant, f64::max)
    }

    fn gain_of_two(&self, pair: [f64; 2], terms: &[(i32, i32)]) -> Option<f64> {
        let of = |s: &&Series| Some(joint_gain(share(s, pair, terms)?, s.len(), terms.len()));
        self.series.iter().map(of).sum()
    }

    /// The strongest lines, each taken out before the next is looked for.
    fn strongest_lines(&self) -> Option<Vec<f64>> {
        let grid = self.range.grid(1)?;
        let mut left: Vec<Series> = self.series.iter().map(|s| (*s).clone()).collect();
        let mut lines = Vec::new();
        for _ in 0..LINES {
            let mut joint = vec![0.0; grid.n];
            for s in &left {
                let power = lomb_scargle(s, &grid, 1).ok()?;
                joint.iter_mut().zip(power).for_each(|(j, p)| *j += joint_gain(p, s.len(), 1));
            }
            let highest = joint.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?.0;
            let f = grid.frequency_hz(highest);
            lines.push(f);
            for s in &mut left {
                let line = fit(s, f, 1).ok()?;
                let model: Vec<f64> = s.time_s.iter().map(|t| line.at(*t)).collect();
                s.value.iter_mut().zip(model).for_each(|(v, m)| *v -= m);
            }
        }
        Some(lines)
    }

    /// Goes uphill from a pair of frequencies by halves of ever smaller steps.
    fn climb(&self, gain: f64, pair: [f64; 2]) -> (f64, [f64; 2]) {
        let resolution = 1.0 / self.range.span_s;
        let (mut at, mut pair) = (gain, pair);
        let mut step = 0.25 * resolution;
        while step > 1e-3 * resolution {
            let mut moved = false;
            for (k, by) in [(0, step), (0, -step), (1, step), (1, -step)] {
                let mut next = pair;
                next[k] += by;
                if let Some(found) = self.gain_of_two(next, &LATTICE).filter(|g| *g > at) {
                    (at, pair, moved) = (found, next, true);
                }
            }
            if !moved {
                step *= 0.5;
            }
        }
        (at, pair)
    }

    /// The pair of frequencies that explains the light best, and its gain.
    fn best_pair(&self) -> Option<(f64, [f64; 2])> {
        let lines = self.strongest_lines()?;
        let resolution = 1.0 / self.range.span_s;
        let mut pairs: Vec<(f64, [f64; 2])> = Vec::new();
        for (k, a) in lines.iter().enumerate() {
            for b in lines[k + 1..].iter().filter(|b| (a - **b).abs() > resolution) {
                pairs.push((self.gain_of_two([*a, *b], &LATTICE)?, [*a, *b]));
            }
        }
        pairs.sort_by(|a, b| b.0.total_cmp(&a.0));
        let followed = pairs.into_iter().take(FOLLOWED).map(|(gain, pair)| self.climb(gain, pair));
        let (mut gain, mut pair) = followed.max_by(|a, b| a.0.total_cmp(&b.0))?;
        for part in [[2.0, 1.0], [1.0, 2.0], [3.0, 1.0], [1.0, 3.0]] {
            let deeper = [pair[0] / part[0], pair[1] / part[1]];
            if deeper[0].min(deeper[1]) * self.range.span_s < LEAST_TURNS {
                continue;
            }
            let Some(there) = self.gain_of_two(deeper, &LATTICE) else { continue };
            let found = self.climb(there, deeper);
            if found.0 > gain + DEEPER {
                (gain, pair) = found;
            }
        }
        Some((gain, pair))
    }

    /// The best score of a pair's models.
    fn score_of_two(&self, pair: [f64; 2]) -> Option<f64> {
        // One frequency more costs one unknown of all series.
        let more = (self.samples() as f64).ln();
        let scores = ORDERS.into_iter().filter_map(|terms| {
            Some(self.gain_of_two(pair, &LATTICE[..terms])? - self.cost(2 * terms) - more)
        });
        scores.max_by(f64::total_cmp)
    }

    /// Returns the pair that spans the same lattice and whose own harmonics explain most: sums and differences of two periods have less light than these. The one with more light first.
    fn spanning(&self, pair: [f64; 2], sigma_hz: [f64; 2]) -> Option<[Estimate; 2]> {
        let [first, second] = pair;
        let hz = |(i, j): (i32, i32)| (f64::from(i) * first + f64::from(j) * second).abs();
        let sees = |f: f64| {
            f * self.range.span_s >= LEAST_TURNS && f <= self.range.highest_hz * (1.0 + 1e-9)
        };
        let mut best: Option<(f64, [(i32, i32); 2])> = None;
        for (k, a) in PRIMITIVE.iter().enumerate() {
            for b in &PRIMITIVE[k + 1..] {
                if (a.0 * b.1 - a.1 * b.0).abs() != 1 || !sees(hz(*a)) || !sees(hz(*b)) {
                    continue;
                }
                let Some(gain) = self.gain_of_two([hz(*a), hz(*b)], &LATTICE[..PURE]) else {
                    continue;
                };
                if best.is_none_or(|(most, _)| gain > most) {
                    best = Some((gain, [*a, *b]));
                }
            }
        }
        let (_, terms) = best?;
        let mut told = terms.map(|(i, j)| {
            let f = hz((i, j));
            let sigma = (f64::from(i) * sigma_hz[0]).hypot(f64::from(j) * sigma_hz[1]);
            let own = (1..=HIGHEST).map(|k| self.gain(f, k)).fold(0.0, f64::max);
            (own, Estimate { period_s: 1.0 / f, sigma_s: sigma / (f * f) })
        });
        told.sort_by(|a, b| b.0.total_cmp(&a.0));
        Some(told.map(|(_, estimate)| estimate))
    }

    /// Two frequencies that explain the light better than `harmonics` of `base` do, or about as well. `apart` are the own periods of two harmonics of it that do not keep step. `independent` is as how many samples one counts.
    pub fn two_periods(
        &self,
        base: f64,
        harmonics: usize,
        apart: &[Estimate],
        window: &[(f64, f64)],
        independent: f64,
    ) -> Option<Pair> {
        let few = harmonics < LEAST_HARMONICS;
        if self.samples() > MOST_SAMPLES {
            return None;
        }
        // Harmonics that run away from one another by less than a turn or so leave no line beside amplitudes that drift.
        let of_harmonics = match apart {
            [one, other] => {
                let pair = [1.0 / one.period_s, 1.0 / other.period_s];
                self.gain_of_two(pair, &LATTICE).map(|gain| self.climb(gain, pair))
            }
            _ => None,
        };
        let is_asked = !few || self.leaves_a_line(base, harmonics, independent);
        let of_lines = if is_asked { self.best_pair() } else { None };
        let (gain, pair, score) = [of_harmonics, of_lines]
            .into_iter()
            .flatten()
            .filter_map(|(gain, pair)| Some((gain, pair, self.score_of_two(pair)?)))
            .max_by(|a, b| a.2.total_cmp(&b.2))?;
        let [first, second] = pair;
        let span_s = self.range.span_s;
        let fastest_s =
            self.series.iter().filter_map(|s| median_step(s)).fold(f64::INFINITY, f64::min);
        let by_chance =
            false_alarm(gain, self.series, LATTICE.len(), self.range.counted_hz, independent);
        // As many second frequencies as there are first ones.
        let second_ones = self.range.highest_hz * span_s;
        let better = score - self.score_of_one(base, harmonics);
        let apart = multiples_apart(first, second, &[], span_s);
        if better < 0.0
            || apart < COMMON
            || first.min(second) * span_s < LEAST_TURNS
            || 2.0 * fastest_s * first.max(second) > 1.0
            || by_chance.is_ok_and(|p| p * second_ones > CHANCE)
        {
            return None;
        }
        let of_window: Vec<f64> =
            window.iter().filter(|(_, height)| *height >= WINDOW).map(|(at, _)| *at).collect();
        let of_gaps = |f: f64| of_window.iter().any(|w| (w - f).abs() * span_s < APART);
        let folded = || multiples_apart(first, second, &of_window, span_s) < APART;
        // Even samples fold harmonics of one period to anywhere.
        if apart >= APART && (folded() || few && (of_gaps(first) || of_gaps(second))) {
            return None;
        }
        let sigma_hz = |k: usize| {
            let h = 0.05 / span_s;
            let at = |by: f64| {
                let mut pair = pair;
                pair[k] += by;
                self.gain_of_two(pair, &LATTICE)
            };
            let curvature = (2.0 * gain - at(h)? - at(-h)?) / (h * h);
            Some((2.0 / (curvature * independent)).sqrt())
        };
        let told = self.spanning(pair, [sigma_hz(0)?, sigma_hz(1)?])?;
        let [one, other] = told.map(|e| 1.0 / e.period_s);
        let apart = apart.min(multiples_apart(one, other, &[], span_s));
        let is_clear = better > -LEAVES.ln() * self.samples() as f64;
        let [one, other] = told;
        Some(if is_clear && apart >= WELL_APART {
            Pair::Two(one, other)
        } else {
            Pair::Either(one, other)
        })
    }
}
