//! Combs: periods at which flashes fall together at a few phases, weighed against flashes at random times.
//!
//! At a period P, flashes fall into windows of the width w of a flash. N flashes at random times put μ = N w/P of them into a window. A tooth with n ≥ 4 flashes is worth n ln(n/μ) − (n − μ), the logarithm
//! of the likelihood ratio of two Poisson rates (Cash 1979, ApJ 228, 939), less ln(P/w) for the choice of its place and ½ ln N for its rate; a comb is worth the sum of its teeth. A multiple of a period has the same flashes on more teeth and is worth less,
//! a part of it loses where flashes of several phases do not fall together.
//!
//! The best comb of all periods is judged by those of displaced flashes: each is moved at random by up to a period either way, into times that were seen. That keeps clusters and gaps and breaks combs. Of these
//! largest values the chance is read on a Gumbel law, not below 1e-6: sixteen copies tell no less.
//!
//! A comb found at a long period may be that of a part of it, so all parts are tried down to five widths of a flash, also where a long curve makes the search begin later. Over a gap of many turns their number is a guess:
//! combs of other numbers are looked for beside the best.

use super::super::verdict::{Estimate, Options};
use super::POSSIBLE;
use super::events::Light;

/// Fewer flashes make no tooth.
const LEAST_ON_TOOTH: usize = 4;
/// Fewer turns show no repetition.
const LEAST_TURNS: f64 = 5.0;
/// A period has at least that many widths of a flash.
const LEAST_WIDTHS: f64 = 5.0;
/// Widths that are tried: flashes slip in phase where the direction of Sun and observer turns.
const WIDTHS: [f64; 3] = [1.0, 2.0, 4.0];
/// Shift over the whole span from one period to the next, in widths.
const STEP: f64 = 0.5;
/// Flashes that are folded at least and at most, the strongest: the others do not change a period.
const FOLDED: (f64, f64) = (80.0, 300.0);
/// Periods times flashes at most, all copies together; a search that needs more begins at a longer period.
const MOST_FOLDS: f64 = 1e9;
/// Displaced copies of the flashes.
const COPIES: usize = 16;
/// Combs that are looked at closely.
const LOOKED_AT: usize = 40;
/// Turns in a gap from which on their number is asked.
const GAP_TURNS: f64 = 3.0;
/// Gaps below this share of the span leave the number of turns to the light beside them.
const GAP_SHARE: f64 = 0.05;
/// Turns more or less in a gap that are tried.
const MISCOUNTED: f64 = 2.5;
/// Periods are told apart by so much of a turn over the span.
const SAME_COUNT: f64 = 0.4;
/// Added and taken off again it leaves the nearest whole number (of those below 2^51), in two sums that a processor does for several numbers at once: 1.5 × 2^52.
const NEAREST: f64 = 6_755_399_441_055_744.0;
/// The least chance that the copies can tell.
pub(super) const LEAST_CHANCE: f64 = 1e-6;

/// A tooth: its place and the flashes on it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tooth {
    /// Moment of turn 0, s from the middle of the light.
    pub time_s: f64,
    /// Turn and time of its flashes.
    pub flashes: Vec<(f64, f64)>,
}

/// A period with its teeth.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Comb {
    pub period_s: f64,
    pub width_s: f64,
    pub teeth: Vec<Tooth>,
    pub score: f64,
}

/// Combs, the best first, and the chance of the best.
pub(super) struct Found {
    pub combs: Vec<Comb>,
    pub chance: f64,
    pub searched_s: (f64, f64),
    /// The shortest period that parts of the best are tried at, s.
    pub allowed_s: f64,
    /// The shortest period that flashes of this width can show, s.
    pub least_s: f64,
}

/// Whether a period counts the same turns as that of a comb: within its width over the span, or far less than a turn (and never more than 1e-3).
pub(super) fn is_same(period_s: f64, comb: &Comb, span_s: f64) -> bool {
    let own = comb.width_s / span_s;
    let count = (SAME_COUNT * comb.period_s / span_s).min(1e-3);
    (period_s / comb.period_s - 1.0).abs() <= own.max(count)
}

/// Frequencies about that of a period at which another number of turns falls into a gap: from and to, Hz.
fn miscounted(light: &Light, period_s: f64) -> Vec<(f64, f64)> {
    let long = |g: &f64| *g > (GAP_TURNS * period_s).max(GAP_SHARE * light.span_s);
    let gaps = light.time_s.windows(2).map(|t| t[1] - t[0]).filter(long);
    let Some(shortest) = gaps.min_by(f64::total_cmp) else { return Vec::new() };
    let f = 1.0 / period_s;
    let by = MISCOUNTED / shortest;
    if by < 0.9 * f { vec![(f - by, f + by)] } else { vec![(0.1 * f, 1.9 * f)] }
}

/// The worth of a tooth with n of `all` flashes where `expected` are by chance and there are `places`.
fn worth(n: usize, expected: f64, places: f64, all: f64) -> f64 {
    if n < LEAST_ON_TOOTH {
        return 0.0;
    }
    let n = n as f64;
    (n * (n / expected).ln() - (n - expected) - places.ln() - 0.5 * all.ln()).max(0.0)
}

/// Random numbers (SplitMix64, Steele and others 2014): copies are the same every time.
struct Random(u64);

impl Random {
    /// A number from 0 to 1.
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Frequencies of one width: even in their logarithm, so that flashes at the ends slip by half a width from one to the next.
#[derive(Clone, Copy)]
struct Grid {
    lowest_hz: f64,
    step: f64,
    n: usize,
    width_s: f64,
}

impl Grid {
    fn new(width_s: f64, span_s: f64, (shortest_s, longest_s): (f64, f64)) -> Self {
        let step = STEP * width_s / span_s;
        let shortest_s = shortest_s.max(LEAST_WIDTHS * width_s);
        let n = ((longest_s / shortest_s).ln().max(0.0) / step) as usize + 1;
        Self { lowest_hz: 1.0 / longest_s, step, n, width_s }
    }

    fn frequency_hz(&self, i: usize) -> f64 {
        self.lowest_hz * (self.step * i as f64).exp()
    }

    /// The best frequencies, of neighbours within `apart` steps one; with what their combs are worth.
    fn candidates(&self, times: &[f64], apart: usize) -> Vec<(f64, f64, f64)> {
        let mut own: Vec<(f64, usize)> = Vec::new();
        self.scores(times, |i, score| {
            if score > 0.0 {
                own.push((score, i));
            }
        });
        own.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut taken: Vec<usize> = Vec::new();
        let mut found = Vec::new();
        for (score, i) in own {
            if taken.len() >= LOOKED_AT {
                break;
            }
            if taken.iter().all(|k| k.abs_diff(i) > apart) {
                taken.push(i);
                found.push((score, 1.0 / self.frequency_hz(i), self.width_s));
            }
        }
        found
    }

    /// Hands out what combs are worth at each frequency, by bins of twice the width at two offsets: flashes that fall together are whole in one of them.
    fn scores(&self, times: &[f64], mut keep: impl FnMut(usize, f64)) {
        let all = times.len() as f64;
        let most = (1.0 / (self.lowest_hz * self.width_s)) as usize + 2;
        // Counts of half bins: all 0 between frequencies.
        let mut counts = vec![0_u32; most];
        let (mut full, mut bins) = (vec![0_usize; times.len()], Vec::<u32>::new());
        for i in 0..self.n {
            let f = self.frequency_hz(i);
            let places = 1.0 / (f * self.width_s);
            let halves = (places as usize).clamp(2, most);
            bins.clear();
            bins.extend(times.iter().map(|t| {
                let turn = f * t;
                let part = turn - ((turn + NEAREST) - NEAREST);
                let part = if part < 0.0 { part + 1.0 } else { part };
                ((part * halves as f64) as i32 as u32).min(halves as u32 - 1)
            }));
            // Of the two halves of a full bin one has half of its flashes. Without branches, which nobody foresees.
            let mut filled = 0;
            for bin in &bins {
                let own = &mut counts[*bin as usize];
                *own += 1;
                full[filled] = *bin as usize;
                filled += usize::from(*own as usize == LEAST_ON_TOOTH / 2);
            }
            let best = Self::best_of(&mut full[..filled], &counts[..halves], places, all);
            for bin in &bins {
                counts[*bin as usize] = 0;
            }
            if filled > 0 {
                keep(i, best);
            }
        }
    }

    /// The worth of a comb by the counts of its half bins, of which `full` have two flashes and more: the larger of two offsets.
    fn best_of(full: &mut [usize], counts: &[u32], places: f64, all: f64) -> f64 {
        full.sort_unstable();
        let halves = counts.len();
        let expected = 2.0 * all / halves as f64;
        let around = |k: usize| if k < halves { k } else { k - halves };
        let mut best = 0.0_f64;
        for offset in 0..2 {
            let mut sum = 0.0;
            let (mut done, mut wrapped) = (usize::MAX, usize::MAX);
            for (k, at) in full.iter().enumerate() {
                // The first half of the bin that holds this one; an odd number of halves leaves one alone.
                let first = around(at + halves - offset) / 2 * 2;
                if first == done || first == wrapped || first + 1 >= halves {
                    continue;
                }
                done = first;
                // The bin across phase 0 is met at both of its ends.
                if k == 0 {
                    wrapped = first;
                }
                let of = |k: usize| counts[around(k + offset)] as usize;
                let n = of(first) + of(first + 1);
                if n >= LEAST_ON_TOOTH {
                    sum += worth(n, expected, places, all);
                }
            }
            best = best.max(sum);
        }
        best
    }
}

/// Groups flashes at a period: the fullest window first.
fn teeth(times: &[f64], period_s: f64, width_s: f64) -> (Vec<Tooth>, f64) {
    let all = times.len() as f64;
    let (expected, places) = (all * width_s / period_s, period_s / width_s);
    let mut left: Vec<(f64, f64)> = times
        .iter()
        .map(|t| {
            let turn = t / period_s;
            ((turn - turn.floor()) * period_s, *t)
        })
        .collect();
    left.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let (mut teeth, mut score) = (Vec::new(), 0.0);
    loop {
        let n = left.len();
        let after = |i: usize| left[i % n].0 + if i >= n { period_s } else { 0.0 };
        let mut best = (0, 0);
        let mut end = 0;
        for i in 0..n {
            end = end.max(i);
            while end + 1 < i + n && after(end + 1) - after(i) <= width_s {
                end += 1;
            }
            if end - i + 1 > best.1 {
                best = (i, end - i + 1);
            }
        }
        let own = worth(best.1, expected, places, all);
        if own <= 0.0 {
            break;
        }
        score += own;
        let members: Vec<(f64, f64)> =
            (best.0..best.0 + best.1).map(|i| (after(i), left[i % n].1)).collect();
        let place = members.iter().map(|m| m.0).sum::<f64>() / members.len() as f64;
        let flashes: Vec<(f64, f64)> =
            members.iter().map(|(_, t)| (((t - place) / period_s).round(), *t)).collect();
        teeth.push(Tooth { time_s: place, flashes });
        let is_taken = |i: usize| (i + n - best.0) % n < best.1;
        left = (0..n).filter(|i| !is_taken(*i)).map(|i| left[i]).collect();
        if left.is_empty() {
            break;
        }
    }
    (teeth, score)
}

impl Comb {
    fn new(times: &[f64], period_s: f64, width_s: f64) -> Self {
        let (teeth, score) = teeth(times, period_s, width_s);
        Self { period_s, width_s, teeth, score }
    }

    /// Number of flashes on its teeth.
    pub fn held(&self) -> usize {
        self.teeth.iter().map(|t| t.flashes.len()).sum()
    }

    /// Period of the least squares line through turns and times, one for all teeth; with the sum of squares of the turns and what the line leaves.
    fn line(&self) -> (f64, f64, f64) {
        let (mut square, mut product, mut total) = (0.0, 0.0, 0.0);
        for tooth in &self.teeth {
            let n = tooth.flashes.len() as f64;
            let (k, t) = tooth.flashes.iter().fold((0.0, 0.0), |s, f| (s.0 + f.0, s.1 + f.1));
            for f in &tooth.flashes {
                square += (f.0 - k / n).powi(2);
                product += (f.0 - k / n) * (f.1 - t / n);
                total += (f.1 - t / n).powi(2);
            }
        }
        let period = product / square;
        (period, square, (total - period * product).max(0.0))
    }

    /// The same flashes with their period sharpened, as long as that is worth more.
    fn sharpened(mut self, times: &[f64]) -> Self {
        for _ in 0..6 {
            let (period, square, _) = self.line();
            let moved = (period / self.period_s - 1.0).abs();
            if !(square > 0.0 && period.is_finite() && moved < 0.02) {
                break;
            }
            let next = Self::new(times, period, self.width_s);
            if next.score <= self.score {
                break;
            }
            self = next;
        }
        self
    }

    /// The period and its standard uncertainty, by what the line leaves; not below what the raster of the samples gives.
    pub fn estimate(&self, light: &Light) -> Estimate {
        let (_, square, left) = self.line();
        let freedom = self.held() as f64 - self.teeth.len() as f64 - 1.0;
        let variance = left / freedom.max(1.0);
        let raster = (light.step_s / self.held().max(1) as f64).powi(2) / 12.0;
        Estimate { period_s: self.period_s, sigma_s: (variance.max(raster) / square).sqrt() }
    }

    /// This comb at a multiple of its period: each tooth becomes several.
    pub fn times(&self, n: usize) -> Self {
        let mut teeth = Vec::new();
        for tooth in &self.teeth {
            for class in 0..n {
                let own =
                    tooth.flashes.iter().filter(|f| f.0.rem_euclid(n as f64) as usize == class);
                let flashes: Vec<(f64, f64)> =
                    own.map(|f| (((f.0 - class as f64) / n as f64).round(), f.1)).collect();
                let time_s = tooth.time_s + class as f64 * self.period_s;
                teeth.push(Tooth { time_s, flashes });
            }
        }
        Self { period_s: n as f64 * self.period_s, teeth, ..*self }
    }
}

/// Times of the strongest flashes, in order.
fn strongest(light: &Light, most: usize) -> Vec<f64> {
    let mut all = light.flashes.clone();
    // By all of its light: where in a sample a flash falls decides how it is divided.
    all.sort_by(|a, b| b.sum.total_cmp(&a.sum).then(a.time_s.total_cmp(&b.time_s)));
    all.truncate(most);
    let mut times: Vec<f64> = all.iter().map(|f| f.time_s).collect();
    times.sort_by(f64::total_cmp);
    times
}

/// The best combs, and how likely chance makes one as good. `None` where no period can be looked for.
pub(super) fn search(light: &Light, options: &Options) -> Option<Found> {
    search_within(light, options, MOST_FOLDS)
}

/// The same with a number of folds.
fn search_within(light: &Light, options: &Options, most_folds: f64) -> Option<Found> {
    let longest_s = options.longest_s.unwrap_or(f64::INFINITY).min(light.span_s / LEAST_TURNS);
    let allowed_s = options.shortest_s.unwrap_or(0.0).max(LEAST_WIDTHS * light.width_s);
    let mut shortest_s = allowed_s;
    if longest_s.is_nan() || shortest_s >= longest_s {
        return None;
    }
    // What each flash costs in all copies at all widths, for a factor e of periods.
    let widths: f64 = WIDTHS.iter().map(|w| 1.0 / w).sum();
    let by_log = (COPIES + 1) as f64 * light.span_s / (STEP * light.width_s) * widths;
    let affordable = most_folds / (by_log * (longest_s / shortest_s).ln());
    let folded = affordable.clamp(FOLDED.0, FOLDED.1);
    let times = strongest(light, folded as usize);
    let reach = most_folds / (by_log * times.len() as f64);
    shortest_s = shortest_s.max(longest_s * (-reach).exp());
    let grids = WIDTHS.map(|w| Grid::new(w * light.width_s, light.span_s, (shortest_s, longest_s)));
    // Times on the raster of the samples would fall together at all its multiples: each is moved within its sample by a part that only its number decides.
    let golden = 0.618_033_988_749_894_9_f64;
    let spread: Vec<f64> = times
        .iter()
        .enumerate()
        .map(|(i, t)| t + ((i as f64 * golden).fract() - 0.5) * light.step_s)
        .collect();
    let mut candidates: Vec<(f64, f64, f64)> =
        grids.iter().flat_map(|grid| grid.candidates(&spread, 4)).collect();
    let highest = candidates.iter().max_by(|a, b| a.0.total_cmp(&b.0)).copied()?;
    // Displaced copies: the best comb of each by the same bins.
    let mut random = Random(0x5eed);
    let mut largest = Vec::with_capacity(COPIES);
    for _ in 0..COPIES {
        let mut copy: Vec<f64> = times
            .iter()
            .map(|t| {
                // Into a gap is not seen: another try.
                let tries = (0..50).map(|_| t + (2.0 * random.next() - 1.0) * highest.1);
                let mut tries = tries.collect::<Vec<f64>>().into_iter();
                tries.find(|t| light.sees(*t)).unwrap_or(*t)
            })
            .collect();
        copy.sort_by(f64::total_cmp);
        let mut best = 0.0_f64;
        for grid in &grids {
            grid.scores(&copy, |_, score| best = best.max(score));
        }
        largest.push(best);
    }
    let n = largest.len() as f64;
    let mean = largest.iter().sum::<f64>() / n;
    let variance = largest.iter().map(|l| (l - mean).powi(2)).sum::<f64>() / (n - 1.0);
    // Not below the spread of a likelihood's largest value: copies may be all alike.
    let scale = (variance.sqrt() * 6.0_f64.sqrt() / std::f64::consts::PI).max(1.0);
    let mode = mean - 0.577_215_664_901_532_9 * scale;
    let closely = |found: &[(f64, f64, f64)]| -> Vec<Comb> {
        found.iter().map(|(_, p, w)| Comb::new(&times, *p, *w).sharpened(&times)).collect()
    };
    let mut combs = closely(&candidates);
    combs.sort_by(better);
    if let Some(best) = combs.first().cloned() {
        // Parts of the best may be enough: the search may begin above them, or a step of the grid may have missed them.
        for part in 2.. {
            let p = best.period_s / part as f64;
            if p < allowed_s {
                break;
            }
            for width_s in WIDTHS.map(|w| w * light.width_s) {
                if p < LEAST_WIDTHS * width_s {
                    continue;
                }
                let comb = Comb::new(&times, p, width_s);
                if comb.score > best.score - 2.0 * POSSIBLE {
                    combs.push(comb.sharpened(&times));
                }
            }
        }
        combs.sort_by(better);
    }
    if let Some(best) = combs.first().cloned() {
        candidates.clear();
        for (low_hz, high_hz) in miscounted(light, best.period_s) {
            for width_s in WIDTHS.map(|w| w * light.width_s) {
                let range = (1.0 / high_hz, 1.0 / low_hz);
                let grid = Grid::new(width_s, light.span_s, range);
                let apart = SAME_COUNT * best.period_s / (STEP * width_s);
                candidates.extend(grid.candidates(&spread, apart as usize));
            }
        }
        combs.extend(closely(&candidates));
        combs.sort_by(better);
    }
    let mut own: Vec<Comb> = Vec::new();
    for comb in combs {
        let apart = |o: &Comb| !is_same(o.period_s, &comb, light.span_s);
        if comb.score > 0.0 && own.iter().all(apart) {
            own.push(comb);
        }
    }
    // All flashes sharpen the best; what the strongest left out counts for whether it holds most of them.
    if let Some(best) = own.first_mut()
        && times.len() < light.flashes.len()
    {
        let every = strongest(light, usize::MAX);
        let whole = Comb::new(&every, best.period_s, best.width_s).sharpened(&every);
        *best = Comb { score: best.score, ..whole };
    }
    let beyond = (highest.0 - mode) / scale;
    let is_above = largest.iter().all(|l| highest.0 > *l);
    let chance = if is_above { -(-(-beyond).exp()).exp_m1() } else { 1.0 };
    let chance = chance.max(LEAST_CHANCE);
    let least_s = LEAST_WIDTHS * light.width_s;
    Some(Found { combs: own, chance, searched_s: (shortest_s, longest_s), allowed_s, least_s })
}

fn better(a: &Comb, b: &Comb) -> std::cmp::Ordering {
    b.score.total_cmp(&a.score).then(a.period_s.total_cmp(&b.period_s))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Flashes of bodies that turn evenly, each a sample of 40, on a raster of 10 ms.
    fn light_of(times: &[f64], span_s: f64) -> Light {
        let n = (span_s / 0.01) as usize;
        let mut value: Vec<f64> = (0..n).map(|i| 10.0 + ((i * i) % 7) as f64).collect();
        for t in times {
            if let Some(v) = value.get_mut((t / 0.01) as usize) {
                *v += 100.0;
            }
        }
        let time: Vec<f64> = (0..n).map(|i| 0.01 * i as f64).collect();
        Light::new(&[crate::series::Series::new("green", &time, &value, None).unwrap()]).unwrap()
    }

    /// Truth: every pair of halves counted anew from the definition, at phases about 0 too. Tolerance: roundings of a sum of logarithms.
    #[test]
    fn each_tooth_counts_once() {
        let mut random = Random(5);
        for first in [0.0, 0.3, 0.49, 0.7] {
            let mut times: Vec<f64> = Vec::new();
            for k in -20..20 {
                times.push((f64::from(k) + first) * 3.0 + 0.02 * (random.next() - 0.5));
                times.push((f64::from(k) + 0.4) * 3.0 + 0.01 * (random.next() - 0.5));
            }
            let grid = Grid::new(0.03, 120.0, (2.9, 3.1));
            let n = times.len() as f64;
            let mut looked_at = 0;
            grid.scores(&times, |i, found| {
                let f = grid.frequency_hz(i);
                let places = 1.0 / (f * 0.03);
                let halves = places as usize;
                let half = |t: &f64| {
                    let turn = f * t;
                    (((turn - turn.floor()) * halves as f64) as usize).min(halves - 1)
                };
                let count = |k: usize| times.iter().filter(|t| half(t) == k % halves).count();
                let of = |offset: usize| -> f64 {
                    (0..halves / 2)
                        .map(|pair| {
                            let k = 2 * pair + offset;
                            let held = count(k) + count(k + 1);
                            worth(held, 2.0 * n / halves as f64, places, n)
                        })
                        .sum()
                };
                let truth = of(0).max(of(1));
                assert!(
                    (found - truth).abs() < 1e-9 * truth.max(1.0),
                    "{first} {i}: {found} {truth}"
                );
                looked_at += 1;
            });
            assert!(looked_at > 100);
        }
    }

    /// Truth: two mirrors, 0.33 of a turn apart, and 2.137 s. A search that is cut so that it begins above three turns comes down to the turn by its parts. Tolerance: the width of a flash, two steps of 10 ms, over 400 s.
    #[test]
    fn a_search_that_begins_late_finds_the_turn() {
        let times: Vec<f64> =
            (0..180).flat_map(|k| [0.1, 0.43].map(|at| (f64::from(k) + at) * 2.137)).collect();
        let light = light_of(&times, 400.0);
        let found = search_within(&light, &Options::default(), 2.38e8).unwrap();
        assert!(found.searched_s.0 > 3.0 * 2.137, "{:?}", found.searched_s);
        let best = &found.combs[0];
        assert!((best.period_s / 2.137 - 1.0).abs() < 5e-5, "{}", best.period_s);
        assert_eq!(best.teeth.len(), 2);
    }
}
