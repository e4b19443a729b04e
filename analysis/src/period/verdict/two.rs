//! Two periods at once: a body that tumbles, or the light of two bodies.
//!
//! Light with two frequencies that have no common period has no period. A search for one finds a long one, of which both are nearly parts, with many harmonics; or one of the two, which leaves the other. So where many harmonics stand
//! out, or few leave a strong line, the light is fitted by a lattice of two free frequencies: f₁, f₂, twice each, their sum, their difference, 2f₁ − f₂ and 2f₂ − f₁. If that leaves clearly less than the
//! harmonics do, the light has two periods. Two frequencies that are harmonics of one with four turns in the data are none. Those near a small multiple of one another may be light of one period that changes
//! from turn to turn, as that of a glint which is seen for a part of a pass; then the phase of the light may drift, too. Beside few harmonics those of the gaps are none, either.

use super::super::fit::fit;
use super::super::lines::MOST as MOST_HARMONICS;
use super::super::significance::{false_alarm, joint_gain};
use super::super::sums::turns;
use super::super::{lomb_scargle, spectrum::median_step};
use super::outcome::Estimate;
use super::search::Search;
use crate::series::Series;
use nalgebra::{Cholesky, DMatrix, DVector};
use std::f64::consts::TAU;

/// Places of the lattice: multiples of the first and the second frequency.
const LATTICE: [(f64, f64); 8] = [
    (1.0, 0.0),
    (0.0, 1.0),
    (2.0, 0.0),
    (0.0, 2.0),
    (1.0, 1.0),
    (1.0, -1.0),
    (2.0, -1.0),
    (-1.0, 2.0),
];
/// Harmonics that are a sign of two periods by themselves: the lattice has as many unknowns as eight.
const LEAST_HARMONICS: usize = 9;
/// Beside fewer harmonics, the least share of the whole variance in a line that they leave; and the further gain that the lattice must have for each harmonic that is missing.
const LEFT: f64 = 0.1;
const EACH_MORE: f64 = 10.0;
/// Multiples of both that are compared (their sum, at most), and turns over the span by which they differ: light that changes over a pass by its phase angle has lines beside its own, a turn or so away;
/// glints that are seen for a half of it, two. Beside few harmonics the same holds for a window's peak of at least such a height.
const MULTIPLES: u32 = 7;
const APART: f64 = 1.5;
pub const WELL_APART: f64 = 2.5;
const WINDOW: f64 = 0.25;
/// Samples in all at most: more are not asked.
const MOST_SAMPLES: usize = 20_000;
/// Lines that are taken out one after the other, and pairs of them that are fitted.
const LINES: usize = 4;
/// Share of what the harmonics leave that the lattice may leave at most.
const LEAVES: f64 = 0.8;
/// Turns of a common period from which on it is one.
const COMMON_TURNS: f64 = 4.0;
/// Turns over the span by which each of two frequencies may miss a harmonic of a common one.
const COMMON: f64 = 0.05;
/// Pairs with a half or a third of a frequency that must be better by this: a strong second harmonic is found for its frequency.
const DEEPER: f64 = 20.0;
/// Most of a chance that noise would do as well.
const CHANCE: f64 = 1e-3;
/// Turns of the slower of the two at least.
const LEAST_TURNS: f64 = 3.0;

/// Explanation of a light by two frequencies that is better than that by one.
#[derive(Debug, Clone, Copy)]
pub enum Pair {
    /// Two periods, the one with more light first.
    Two(Estimate, Estimate),
    /// Those, or one whose light changes within a part of the data.
    Either(Estimate, Estimate),
    /// One whose light changes from turn to turn.
    Changing,
}

/// The share of the weighted variance of a series that the lattice explains; `None` where its terms cannot be told apart.
fn share(series: &Series, first_hz: f64, second_hz: f64) -> Option<f64> {
    let columns = 2 * LATTICE.len() + 1;
    if series.len() <= 2 * columns {
        return None;
    }
    let middle = series.time_s[0] + 0.5 * series.span_s();
    let mean = series.mean();
    let (mut normal, mut right) =
        (DMatrix::<f64>::zeros(columns, columns), DVector::<f64>::zeros(columns));
    let mut row = DVector::<f64>::zeros(columns);
    let mut variation = 0.0;
    for i in 0..series.len() {
        let t = series.time_s[i] - middle;
        let [(s1, c1), (s2, c2)] = [first_hz, second_hz].map(|f| (TAU * turns(f, t)).sin_cos());
        let (first, second) = ([c1, s1], [c2, s2]);
        let times =
            |a: [f64; 2], b: [f64; 2]| [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]];
        let back = |a: [f64; 2]| [a[0], -a[1]];
        let (twice_first, twice_second) = (times(first, first), times(second, second));
        let all = [
            first,
            second,
            twice_first,
            twice_second,
            times(first, second),
            times(first, back(second)),
            times(twice_first, back(second)),
            times(back(first), twice_second),
        ];
        row[0] = 1.0;
        for (k, [c, s]) in all.into_iter().enumerate() {
            row[2 * k + 1] = c;
            row[2 * k + 2] = s;
        }
        let (w, y) = (series.weight[i], series.value[i] - mean);
        normal.syger(w, &row, &row, 1.0);
        right.axpy(w * y, &row, 1.0);
        variation += w * y * y;
    }
    normal.fill_upper_triangle_with_lower_triangle();
    let ridge = 1e-10 * normal.diagonal().max();
    for k in 0..columns {
        normal[(k, k)] += ridge;
    }
    let solution = Cholesky::new(normal)?.solve(&right);
    (variation > 0.0).then(|| (right.dot(&solution) / variation).clamp(0.0, 1.0))
}

/// Whether two frequencies are harmonics of one that turns often enough in a span.
fn is_common(first_hz: f64, second_hz: f64, span_s: f64) -> bool {
    let most = MOST_HARMONICS as u32;
    (1..=most).any(|p| {
        (1..=most).any(|q| {
            let base = 0.5 * (first_hz / f64::from(p) + second_hz / f64::from(q));
            let miss = (first_hz * f64::from(q) - second_hz * f64::from(p)).abs();
            miss * span_s < COMMON * f64::from(p + q) && base * span_s >= COMMON_TURNS
        })
    })
}

/// The least by which small multiples of two frequencies differ over a span, turns; also where the times of the samples (frequencies of the window, among them that of even samples) fold them.
fn multiples_apart(first_hz: f64, second_hz: f64, window_hz: &[f64], span_s: f64) -> f64 {
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
    /// Whether harmonics of a base leave a line with a good part of the variance of some series.
    fn leaves_a_line(&self, base: f64, harmonics: usize) -> bool {
        let Some(grid) = self.range.grid(1) else { return false };
        self.series.iter().any(|s| {
            let Ok(model) = fit(s, base, harmonics) else { return false };
            let mut left: Series = (*s).clone();
            left.value.iter_mut().zip(&s.time_s).for_each(|(v, t)| *v -= model.at(*t));
            let Ok(power) = lomb_scargle(&left, &grid, 1) else { return false };
            let line = power.into_iter().fold(0.0, f64::max);
            line >= 1.0 - LEAVES && line * (1.0 - model.power) >= LEFT
        })
    }

    fn gain_of_two(&self, first_hz: f64, second_hz: f64) -> Option<f64> {
        let mut sum = 0.0;
        for s in self.series {
            sum += joint_gain(share(s, first_hz, second_hz)?, s.len(), LATTICE.len());
        }
        Some(sum)
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
                if let Some(found) = self.gain_of_two(next[0], next[1]).filter(|g| *g > at) {
                    (at, pair, moved) = (found, next, true);
                }
            }
            if !moved {
                step *= 0.5;
            }
        }
        (at, pair)
    }

    /// Two frequencies that explain the light better than `harmonics` of `base` do. `independent` is as how many samples one counts.
    pub fn two_periods(
        &self,
        base: f64,
        harmonics: usize,
        window: &[(f64, f64)],
        independent: f64,
    ) -> Option<Pair> {
        let few = harmonics < LEAST_HARMONICS;
        if self.samples() > MOST_SAMPLES || few && !self.leaves_a_line(base, harmonics) {
            return None;
        }
        let single = self.gain(base, harmonics);
        let lines = self.strongest_lines()?;
        let resolution = 1.0 / self.range.span_s;
        let mut pairs: Vec<(f64, f64, f64)> = Vec::new();
        for (k, a) in lines.iter().enumerate() {
            for b in &lines[k + 1..] {
                if (a - b).abs() > resolution {
                    pairs.push((self.gain_of_two(*a, *b)?, *a, *b));
                }
            }
        }
        pairs.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut best: Option<(f64, [f64; 2])> = None;
        for (gain, a, b) in pairs.into_iter().take(3) {
            let found = self.climb(gain, [a, b]);
            if best.is_none_or(|best| found.0 > best.0) {
                best = Some(found);
            }
        }
        let (mut gain, mut pair) = best?;
        for part in [[2.0, 1.0], [1.0, 2.0], [3.0, 1.0], [1.0, 3.0]] {
            let deeper = [pair[0] / part[0], pair[1] / part[1]];
            let slowest = deeper[0].min(deeper[1]);
            if slowest * self.range.span_s < LEAST_TURNS {
                continue;
            }
            let Some(there) = self.gain_of_two(deeper[0], deeper[1]) else { continue };
            let found = self.climb(there, deeper);
            if found.0 > gain + DEEPER {
                (gain, pair) = found;
            }
        }
        let [first, second] = pair;
        let slowest = first.min(second);
        let fastest_s =
            self.series.iter().filter_map(|s| median_step(s)).fold(f64::INFINITY, f64::min);
        let fewer = (LEAST_HARMONICS - 1).saturating_sub(harmonics) as f64;
        let better = -LEAVES.ln() * self.samples() as f64 + EACH_MORE * fewer;
        let of_window: Vec<f64> =
            window.iter().filter(|(_, height)| *height >= WINDOW).map(|(at, _)| *at).collect();
        let of_gaps = |f: f64| of_window.iter().any(|w| (w - f).abs() * self.range.span_s < APART);
        let by_chance =
            false_alarm(gain, self.series, LATTICE.len(), self.range.highest_hz, independent);
        // As many second frequencies as there are first ones.
        let second_ones = self.range.highest_hz * self.range.span_s;
        if gain < single + better
            || slowest * self.range.span_s < LEAST_TURNS
            || slowest <= 0.0
            || 2.0 * fastest_s * first.max(second) > 1.0
            || by_chance.is_ok_and(|p| p * second_ones > CHANCE)
            || is_common(first, second, self.range.span_s)
        {
            return None;
        }
        let folded = || multiples_apart(first, second, &of_window, self.range.span_s) < APART;
        let apart = multiples_apart(first, second, &[], self.range.span_s);
        if few && apart >= APART && (folded() || of_gaps(first) || of_gaps(second)) {
            return None;
        }
        let estimate = |k: usize| {
            let h = 0.05 * resolution;
            let at = |by: f64| {
                let mut pair = [first, second];
                pair[k] += by;
                self.gain_of_two(pair[0], pair[1])
            };
            let curvature = (2.0 * gain - at(h)? - at(-h)?) / (h * h);
            let f = [first, second][k];
            Some(Estimate { period_s: 1.0 / f, sigma_s: (2.0 / curvature).sqrt() / (f * f) })
        };
        let (one, other) = (estimate(0)?, estimate(1)?);
        // The same lattice has many pairs that span it: the one with most light is told.
        let sigma_hz = |e: Estimate| e.sigma_s / (e.period_s * e.period_s);
        let mut terms: Vec<(f64, (f64, f64), Estimate)> = LATTICE
            .iter()
            .filter(|(i, j)| *i != 2.0 || *j != 0.0)
            .filter(|(i, j)| *i != 0.0 || *j != 2.0)
            .map(|(i, j)| {
                let f = (i * first + j * second).abs();
                let sigma = (i * sigma_hz(one)).hypot(j * sigma_hz(other));
                let estimate = Estimate { period_s: 1.0 / f, sigma_s: sigma / (f * f) };
                let gain = if f * self.range.span_s > 1.0 { self.gain(f, 1) } else { 0.0 };
                (gain, (*i, *j), estimate)
            })
            .collect();
        terms.sort_by(|a, b| b.0.total_cmp(&a.0));
        let (_, strongest, told) = *terms.first()?;
        let spans = |(i, j): (f64, f64)| (strongest.0 * j - strongest.1 * i).abs() == 1.0;
        let (_, _, beside) = *terms.iter().find(|(_, term, _)| spans(*term))?;
        let turns = |e: Estimate| self.range.span_s / e.period_s;
        if turns(told).min(turns(beside)) < LEAST_TURNS {
            return (apart < APART).then_some(Pair::Changing);
        }
        let [one, other] = [told, beside].map(|e| 1.0 / e.period_s);
        Some(match apart.min(multiples_apart(one, other, &[], self.range.span_s)) {
            apart if apart < APART => Pair::Changing,
            apart if apart < WELL_APART => Pair::Either(told, beside),
            _ => Pair::Two(told, beside),
        })
    }
}
