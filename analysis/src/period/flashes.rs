//! Flash trains: the period of a body whose mirrors flash, by folding the flashes alone.
//!
//! A mirror that flashes for a hundredth of a turn has its light in a hundred harmonics, each too weak to stand out of the noise. So the flashes are found first, as samples
//! above a running median of the light, and their times are folded: at the period they fall together, within the width of a flash, at a few phases. What a fold is worth is the excess of pairs of flashes
//! that share a phase, over what evenly spread times would have.
//!
//! The chance that noise puts so much into one phase bin is bounded by Chernoff and Hoeffding (1963, J. Am. Stat. Assoc. 58, 13): for N strengths of 0 to 1, of which a share q falls into a bin on
//! average, P(share ≥ x) ≤ exp(−N (x ln(x/q) + (1 − x) ln((1 − x)/(1 − q)))), times the bins and periods that were looked at.
//!
//! Whether n times a period is the period is asked of the flashes at each phase: are those of every n-th turn like the others (Kruskal and Wallis 1952, J. Am. Stat. Assoc. 47, 583)? Turns
//! without a flash count as flashes of no strength where there were samples. Ranks ask for no shape of the scatter, which is large: a flash lasts no longer than an exposure.

use super::spectrum::median_step;
use super::stats::chi2_survival;
use super::verdict::{Estimate, Member, Membership, Options, Outcome, Question, Reason, Verdict};
use crate::series::Series;
use sunglint_numerics::order::{SIGMA_PER_MAD, median};

/// Samples of the running median, and samples from one of its nodes to the next.
const WINDOW: usize = 101;
const NODE: usize = 25;
/// Samples that many standard deviations above the median are candidates; those beyond the second are flashes without doubt.
const CANDIDATE: f64 = 2.5;
const FLASH: f64 = 4.0;
/// Strengths above this do not count for more.
const FULL: f64 = 6.0;
/// Fewer flashes are no train.
const LEAST_FLASHES: usize = 8;
/// Light that is in flashes for more than this share of its samples is no train.
const MOST_LIT: f64 = 0.3;
/// Fewer turns show no repetition.
const LEAST_TURNS: f64 = 5.0;
/// Widths of a phase bin that are tried, in flashes' widths: flashes whose phase slips are folded in the wider ones.
const WIDTHS: [f64; 3] = [1.0, 2.0, 4.0];
/// Shift over the whole span between two periods that are tried, in widths.
const STEP: f64 = 0.5;
/// Periods times flashes that are looked at, at most: beyond it the weakest flashes are left out.
const MOST_FOLDS: f64 = 5e8;
/// Flashes that are kept at least, and at most.
const FLASHES: (usize, usize) = (100, 20_000);
/// Flashes with more than this share of the light's variance decide against harmonics.
const MOST_OF_LIGHT: f64 = 0.5;
/// Phases at which flashes stand, at most.
const MOST_PHASES: usize = 16;
/// Flashes of a phase are told from evenly spread ones by chances below this.
const PHASE_CHANCE: f64 = 1e-3;
/// A chance below this is a yes, above the next a no, between them neither.
const YES: f64 = 1e-4;
const NO: f64 = 0.02;
/// Turns that may differ by more than this share of their flashes are not known to be alike; the same of thirds of a turn.
const ALIKE: f64 = 0.1;
const ALIKE_RARE: f64 = 0.5;
/// Turns of each kind that a question needs.
const LEAST_OF_KIND: usize = 4;
/// Noise gives such a fold with no more than this chance.
const CHANCE: f64 = 1e-3;

/// A phase at which a body flashes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlashPhase {
    /// Phase in turns, 0 to 1, from [`FlashTrain::middle_s`].
    pub phase: f64,
    /// Turns that were seen at this phase.
    pub seen: usize,
    /// Those of them that flashed.
    pub flashed: usize,
    /// Median strength of these flashes, in standard deviations of the light between flashes.
    pub strength: f64,
}

/// The flashes of a curve and the period at which they come.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct FlashTrain {
    /// Flashes that stand out of the light.
    pub flashes: usize,
    /// Share of the samples that are in them.
    pub lit: f64,
    /// Share of the light's variance that is in them.
    pub variance_share: f64,
    /// Width within which flashes of one phase fell together, s.
    pub width_s: f64,
    /// Answer that the flashes give.
    pub outcome: Outcome,
    /// Whether this is the verdict's answer: of harmonics and flashes together ([`with_flashes`]).
    pub decides: bool,
    /// The best period, even where it is no answer.
    pub best: Option<Estimate>,
    /// Phases of the best period at which flashes stand.
    pub phases: Vec<FlashPhase>,
    /// Moment from which phases count, s on the axis of the series.
    pub middle_s: f64,
    /// Upper bound of the chance that flashes at random times fall together so well at any period that was tried.
    pub chance: Option<f64>,
    /// Questions about multiples and parts.
    pub questions: Vec<Question>,
    /// The shortest and the longest period that were looked for, s.
    pub searched_s: Option<(f64, f64)>,
}

/// A flash, or what may be one.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Flash {
    /// Middle, s from the middle of all.
    time_s: f64,
    /// The same, moved within its sample by a part that depends on its place alone: times on a raster would fall together at every multiple of it.
    spread_s: f64,
    /// Sum of its samples above the median, in standard deviations.
    sum: f64,
    /// Brightest sample of the flash.
    peak: f64,
}

impl Flash {
    /// Strength, 0 to 1.
    fn weight(&self) -> f64 {
        (self.peak / FULL).min(1.0).powi(2)
    }
}

/// Flashes of series with what was seen.
struct Train {
    flashes: Vec<Flash>,
    /// Times of the samples, s from the middle of all, increasing.
    seen: Vec<f64>,
    span_s: f64,
    step_s: f64,
    middle_s: f64,
    width_s: f64,
    strong: usize,
    lit: f64,
    variance_share: f64,
}

/// A level of the light and its scatter, at the places of a series.
fn levels(values: &[f64]) -> Vec<(f64, f64)> {
    let n = values.len();
    let half = WINDOW / 2;
    let nodes: Vec<(usize, f64, f64)> = (0..n)
        .step_by(NODE)
        .chain((n > 1).then(|| n - 1))
        .map(|i| {
            let from = i.saturating_sub(half).min(n.saturating_sub(WINDOW));
            let own = &values[from..n.min(from + WINDOW)];
            let level = median(own.iter().copied()).unwrap_or(0.0);
            let mut off: Vec<f64> = own.iter().map(|v| (v - level).abs()).collect();
            let mad = SIGMA_PER_MAD * median(off.iter().copied()).unwrap_or(0.0);
            // Counts of a few photons have a median deviation of 0 or 1: the mean of the lower nine tenths beside it.
            off.sort_by(f64::total_cmp);
            let lower = &off[..(9 * off.len()).div_ceil(10)];
            let mean = 1.2533 * lower.iter().sum::<f64>() / lower.len().max(1) as f64;
            (i, level, mad.max(mean))
        })
        .collect();
    let mut all = Vec::with_capacity(n);
    for pair in nodes.windows(2) {
        let ((a, level_a, sigma_a), (b, level_b, sigma_b)) = (pair[0], pair[1]);
        for i in a..b {
            let part = (i - a) as f64 / (b - a) as f64;
            all.push((level_a + part * (level_b - level_a), sigma_a + part * (sigma_b - sigma_a)));
        }
    }
    all.extend(nodes.last().map(|last| (last.1, last.2)));
    all.truncate(n);
    all
}

/// Golden ratio's fraction: its multiples are even over 0 to 1.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// The flashes of one series: runs of samples above the candidates' level.
fn flashes(
    series: &Series,
    step_s: f64,
    middle_s: f64,
    (runs, squares): (&mut Vec<usize>, &mut f64),
) -> Vec<Flash> {
    let levels = levels(&series.value);
    let n = series.len();
    let above = |i: usize| {
        let (level, sigma) = levels[i];
        if sigma > 0.0 { (series.value[i] - level) / sigma } else { 0.0 }
    };
    let mut all = Vec::new();
    let mut i = 0;
    while i < n {
        if above(i) <= CANDIDATE {
            i += 1;
            continue;
        }
        let from = i;
        let (mut sum, mut moment, mut peak, mut square) = (0.0, 0.0, 0.0_f64, 0.0);
        while i < n
            && above(i) > CANDIDATE
            && (i == from || series.time_s[i] - series.time_s[i - 1] <= 1.5 * step_s)
        {
            let z = above(i);
            sum += z;
            moment += z * (series.time_s[i] - middle_s);
            peak = peak.max(z);
            square += (series.value[i] - levels[i].0).powi(2);
            i += 1;
        }
        if peak >= FLASH {
            runs.push(i - from);
            *squares += square;
        }
        let time_s = moment / sum;
        let part = (all.len() as f64 * GOLDEN).fract() - 0.5;
        let spread_s = time_s + part * step_s;
        all.push(Flash { time_s, spread_s, sum, peak });
    }
    all
}

impl Train {
    /// `None` where the light has no flashes, or is in them most of the time.
    fn new(series: &[&Series]) -> Option<Self> {
        let step_s = series.iter().filter_map(|s| median_step(s)).fold(f64::INFINITY, f64::min);
        let first =
            series.iter().filter_map(|s| s.time_s.first()).copied().fold(f64::NAN, f64::min);
        let last = series.iter().filter_map(|s| s.time_s.last()).copied().fold(f64::NAN, f64::max);
        let span_s = last - first;
        if !(span_s > 0.0 && step_s.is_finite()) {
            return None;
        }
        let middle_s = first + 0.5 * span_s;
        let (mut all, mut runs): (Vec<Flash>, Vec<usize>) = (Vec::new(), Vec::new());
        let (mut seen, mut shares): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
        for s in series.iter().filter(|s| s.len() > WINDOW) {
            let mut squares = 0.0;
            all.extend(flashes(s, step_s, middle_s, (&mut runs, &mut squares)));
            let mean = s.value.iter().sum::<f64>() / s.len() as f64;
            let total: f64 = s.value.iter().map(|v| (v - mean).powi(2)).sum();
            shares.push(squares / total.max(f64::MIN_POSITIVE));
            seen.extend(s.time_s.iter().map(|t| t - middle_s));
        }
        seen.sort_by(f64::total_cmp);
        seen.dedup();
        let lit_samples: usize = runs.iter().sum();
        // Channels that flash together make one flash.
        all.sort_by(|a, b| a.time_s.total_cmp(&b.time_s).then(a.peak.total_cmp(&b.peak)));
        let mut merged: Vec<Flash> = Vec::with_capacity(all.len());
        for flash in all {
            match merged.last_mut() {
                Some(last) if series.len() > 1 && flash.time_s - last.time_s < step_s => {
                    if flash.peak > last.peak {
                        *last = flash;
                    }
                }
                _ => merged.push(flash),
            }
        }
        let strong = merged.iter().filter(|f| f.peak >= FLASH).count();
        let samples: usize = series.iter().map(|s| s.len()).sum();
        let lit = lit_samples as f64 / samples.max(1) as f64;
        if strong < LEAST_FLASHES || lit > MOST_LIT {
            return None;
        }
        let length = median(runs.iter().map(|n| *n as f64)).unwrap_or(1.0);
        let width_s = (length + 1.0) * step_s;
        let variance_share = median(shares).unwrap_or(0.0);
        Some(Self {
            flashes: merged,
            seen,
            span_s,
            step_s,
            middle_s,
            width_s,
            strong,
            lit,
            variance_share,
        })
    }

    /// The shortest and the longest period that can be looked for, s.
    fn range(&self, options: &Options) -> Option<(f64, f64)> {
        let shortest_s = options.shortest_s.unwrap_or(0.0).max(4.0 * self.step_s);
        let longest_s = self.span_s / LEAST_TURNS;
        let longest_s = options.longest_s.map_or(longest_s, |l| l.min(longest_s));
        (shortest_s < longest_s).then_some((shortest_s, longest_s))
    }

    /// Number of periods that are tried with bins of a width.
    fn periods(&self, width_s: f64, (shortest_s, longest_s): (f64, f64)) -> f64 {
        ((longest_s / shortest_s).ln() / (STEP * width_s / self.span_s).ln_1p()).ceil().max(1.0)
    }

    /// The period at which most flashes fall together, by bins of a width; its excess of pairs, and how many periods were tried.
    fn scan(&self, width_s: f64, (shortest_s, longest_s): (f64, f64)) -> (f64, f64, f64) {
        let factor = 1.0 + STEP * width_s / self.span_s;
        let tried = self.periods(width_s, (shortest_s, longest_s));
        let most = (MOST_FOLDS / tried) as usize;
        let mut used: Vec<Flash> = self.flashes.clone();
        let keep = most.clamp(FLASHES.0, FLASHES.1);
        if used.len() > keep {
            used.sort_by(|a, b| b.peak.total_cmp(&a.peak).then(a.time_s.total_cmp(&b.time_s)));
            used.truncate(keep);
        }
        let folded: Vec<(f64, f64)> = used.iter().map(|f| (f.spread_s, f.weight())).collect();
        let mut bins = Vec::new();
        let mut best = (0.0, f64::NEG_INFINITY);
        for i in 0..tried as usize {
            let period_s = shortest_s * factor.powi(i as i32);
            let excess = excess(&folded, period_s, width_s, &mut bins);
            if excess > best.1 {
                best = (period_s, excess);
            }
        }
        (best.0, best.1, tried)
    }

    /// A period sharpened: the middle flashes of each phase against the number of their turn, by least squares of one slope for all phases. Its uncertainty counts the correlation of what is left.
    fn sharpened(&self, period_s: f64, width_s: f64) -> Estimate {
        let mut estimate = Estimate { period_s, sigma_s: f64::NAN };
        for _ in 0..3 {
            let p = estimate.period_s;
            let (mut rows, mut used): (Vec<(f64, f64)>, Vec<f64>) = (Vec::new(), Vec::new());
            let phases = self.phases(p, width_s);
            for phase in &phases {
                let mut own: Vec<(f64, f64)> = Vec::new();
                for flash in self.flashes.iter().filter(|f| f.peak >= FLASH) {
                    let turn = (flash.time_s / p - phase).round();
                    let off = flash.time_s - (turn + phase) * p;
                    if off.abs() <= width_s {
                        own.push((turn, flash.time_s));
                    }
                }
                if own.len() < 3 {
                    continue;
                }
                let n = own.len() as f64;
                let mean_k = own.iter().map(|r| r.0).sum::<f64>() / n;
                let mean_t = own.iter().map(|r| r.1).sum::<f64>() / n;
                rows.extend(own.iter().map(|r| (r.0 - mean_k, r.1 - mean_t)));
                used.push(n);
            }
            let square: f64 = rows.iter().map(|r| r.0 * r.0).sum();
            if square <= 0.0 {
                break;
            }
            let slope = rows.iter().map(|r| r.0 * r.1).sum::<f64>() / square;
            // A slope that leaves the neighbourhood is of flashes that were taken for others.
            if !(slope / p - 1.0).abs().lt(&(width_s / self.span_s)) {
                break;
            }
            rows.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
            let left: Vec<f64> = rows.iter().map(|r| r.1 - slope * r.0).collect();
            let squares: f64 = left.iter().map(|r| r * r).sum();
            let next: f64 = left.windows(2).map(|r| r[0] * r[1]).sum();
            let rho = if squares > 0.0 { (next / squares).clamp(0.0, 0.98) } else { 0.0 };
            let free = (rows.len() as f64 - used.len() as f64 - 1.0).max(1.0);
            // A sample's width is known no better than by a twelfth of its square.
            let variance = (squares / free).max(self.step_s * self.step_s / 12.0);
            let sigma_s = (variance / square * (1.0 + rho) / (1.0 - rho)).sqrt();
            estimate = Estimate { period_s: slope, sigma_s };
        }
        estimate
    }

    /// Phases of a period at which flashes stand, turns from the middle.
    fn phases(&self, period_s: f64, width_s: f64) -> Vec<f64> {
        let n = self.flashes.len() as f64;
        let total: f64 = self.flashes.iter().map(Flash::weight).sum();
        let mut left: Vec<(f64, f64, f64)> = self
            .flashes
            .iter()
            .map(|f| {
                let turn = f.time_s / period_s;
                (turn - turn.floor(), f.weight(), f.spread_s)
            })
            .collect();
        let part = (width_s / period_s).min(0.5);
        let bins = (2.0 / part).ceil().max(4.0) as usize;
        let mut found = Vec::new();
        while found.len() < MOST_PHASES {
            let mut sums = vec![0.0; bins];
            for (phase, weight, _) in &left {
                sums[((phase * bins as f64) as usize).min(bins - 1)] += weight;
            }
            let pair = |b: usize| sums[b] + sums[(b + 1) % bins];
            let Some(top) = (0..bins).max_by(|a, b| pair(*a).total_cmp(&pair(*b))) else { break };
            let at = (top as f64 + 1.0) / bins as f64;
            let from = |phase: f64| phase - at - (phase - at).round();
            let (mut weights, mut moment, mut turns) = (0.0, 0.0, Vec::new());
            for (phase, weight, time) in left.iter().filter(|l| from(l.0).abs() <= 0.5 * part) {
                weights += weight;
                moment += weight * from(*phase);
                turns.push((time / period_s).floor());
            }
            turns.dedup();
            let share = self.seen_share(period_s, at, part);
            let chance = bins as f64 * bound(n, weights, total, share);
            if turns.len() < 3 || chance > PHASE_CHANCE {
                break;
            }
            let phase = at + moment / weights;
            let off = |other: f64| (other - phase - (other - phase).round()).abs();
            left.retain(|l| off(l.0) > part);
            found.push(phase - phase.floor());
        }
        found.sort_by(f64::total_cmp);
        found
    }

    /// The share of the samples that lie within a part of a turn about a phase.
    fn seen_share(&self, period_s: f64, phase: f64, part: f64) -> f64 {
        let near = |t: &&f64| {
            let off = *t / period_s - phase;
            (off - off.round()).abs() <= 0.5 * part
        };
        self.seen.iter().filter(near).count() as f64 / self.seen.len().max(1) as f64
    }

    /// Whether there was a sample about a moment.
    fn was_seen(&self, time_s: f64, width_s: f64) -> bool {
        let reach = (0.5 * width_s).max(self.step_s);
        let next = self.seen.partition_point(|t| *t < time_s - reach);
        self.seen.get(next).is_some_and(|t| *t <= time_s + reach)
    }

    /// Strength of the flash of each turn that was seen at a phase: number of the turn, and strength (0 without a flash).
    fn turns(&self, period_s: f64, phase: f64, width_s: f64) -> Vec<(i64, f64)> {
        let half = 0.5 * self.span_s;
        let (from, to) = ((-half / period_s - phase).ceil(), (half / period_s - phase).floor());
        let mut all = Vec::new();
        let mut k = from;
        while k <= to {
            let time_s = (k + phase) * period_s;
            if self.was_seen(time_s, width_s) {
                let first = self.flashes.partition_point(|f| f.time_s < time_s - width_s);
                let own = self.flashes[first..].iter().take_while(|f| f.time_s <= time_s + width_s);
                all.push((k as i64, own.map(|f| f.sum).fold(0.0, f64::max)));
            }
            k += 1.0;
        }
        all
    }

    /// Whether flashes of every n-th turn differ from the others.
    fn question(&self, period_s: f64, times: usize, width_s: f64) -> Question {
        let mut question = Question {
            longer_s: times as f64 * period_s,
            shorter_s: period_s,
            chance: None,
            unlike: None,
            dispersion_chance: None,
        };
        let (mut statistic, mut degrees, mut unlike) = (0.0, 0.0, 0.0_f64);
        for phase in self.phases(period_s, width_s) {
            let mut kinds = vec![Vec::new(); times];
            for (k, strength) in self.turns(period_s, phase, width_s) {
                kinds[k.rem_euclid(times as i64) as usize].push(strength);
            }
            if kinds.iter().any(|k| k.len() < LEAST_OF_KIND) {
                continue;
            }
            let Some(h) = kruskal_wallis(&kinds) else { continue };
            statistic += h;
            degrees += (times - 1) as f64;
            unlike = unlike.max(difference(&kinds));
        }
        if degrees > 0.0 {
            question.chance = Some(chi2_survival(statistic, degrees));
            question.unlike = Some(unlike);
        }
        question
    }
}

/// The Chernoff bound of N strengths of 0 to 1 with the sum `total`, of which each falls into a bin with the chance `share`: that `inside` or more does.
fn bound(n: f64, inside: f64, total: f64, share: f64) -> f64 {
    let (x, q) = ((inside / n).min(1.0), share * total / n);
    if !(x > q && q > 0.0) {
        return 1.0;
    }
    let rest = if x < 1.0 { (1.0 - x) * ((1.0 - x) / (1.0 - q)).ln() } else { 0.0 };
    (-n * (x * (x / q).ln() + rest)).exp()
}

/// Excess of pairs of flashes that share a phase bin or stand in neighbouring ones, in standard deviations of evenly spread flashes.
fn excess(flashes: &[(f64, f64)], period_s: f64, width_s: f64, bins: &mut Vec<f64>) -> f64 {
    let m = ((period_s / width_s) as usize).max(3);
    bins.clear();
    bins.resize(m, 0.0);
    let per_bin = m as f64;
    let per_turn = 1.0 / period_s;
    let (mut sum, mut squares) = (0.0, 0.0);
    for (time, weight) in flashes {
        let turn = time * per_turn;
        let phase = turn - turn.floor();
        bins[((phase * per_bin) as usize).min(m - 1)] += weight;
        sum += weight;
        squares += weight * weight;
    }
    let mut pairs = 0.0;
    let mut before = bins[m - 1];
    for b in bins.iter() {
        pairs += b * (b + before);
        before = *b;
    }
    let pairs = pairs - squares - 2.0 * (sum * sum - squares) / per_bin;
    pairs / (3.0 * squares * squares / per_bin).sqrt()
}

/// The statistic of Kruskal and Wallis with its correction for ties; `None` where all values are the same.
fn kruskal_wallis(kinds: &[Vec<f64>]) -> Option<f64> {
    let mut all: Vec<(f64, usize)> =
        kinds.iter().enumerate().flat_map(|(k, own)| own.iter().map(move |v| (*v, k))).collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let n = all.len() as f64;
    let mut ranks = vec![0.0; kinds.len()];
    let mut ties = 0.0;
    let mut i = 0;
    while i < all.len() {
        let end = i + all[i..].iter().take_while(|v| v.0 == all[i].0).count();
        let same = (end - i) as f64;
        let rank = 0.5 * ((i + 1) as f64 + end as f64);
        for (_, kind) in &all[i..end] {
            ranks[*kind] += rank;
        }
        ties += same * same * same - same;
        i = end;
    }
    let free = 1.0 - ties / (n * n * n - n);
    if free.is_nan() || free <= 0.0 {
        return None;
    }
    let sum: f64 = ranks.iter().zip(kinds).map(|(r, own)| r * r / own.len() as f64).sum();
    Some((12.0 / (n * (n + 1.0)) * sum - 3.0 * (n + 1.0)) / free)
}

/// Share of the mean strength by which kinds may differ at about 95 %.
fn difference(kinds: &[Vec<f64>]) -> f64 {
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let means: Vec<f64> = kinds.iter().map(|k| mean(k)).collect();
    let all = mean(&kinds.concat());
    let variance = |k: &Vec<f64>| {
        let m = mean(k);
        k.iter().map(|v| (v - m).powi(2)).sum::<f64>() / (k.len() as f64 - 1.0) / k.len() as f64
    };
    let error = 2.0 * kinds.iter().map(variance).sum::<f64>().sqrt();
    let low = means.iter().copied().fold(f64::INFINITY, f64::min);
    let high = means.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    (high - low + error) / all
}

/// Looks for the period at which flashes come. `None` where the light has no flashes that stand out, or is in them for more than 30 % of the time.
///
/// ```
/// use sunglint_analysis::period::verdict::Options;
/// use sunglint_analysis::period::flash_train;
/// use sunglint_analysis::series::Series;
///
/// // A flash of a hundredth of a second every 1.7 s, every other one half as bright: the period is 3.4 s.
/// let time: Vec<f64> = (0..10_000).map(|i| 0.01 * f64::from(i)).collect();
/// let light = |t: &f64| {
///     let turn = t / 1.7 + 0.3;
///     let flash = if turn.fract() * 1.7 < 0.01 { 40.0 - 20.0 * (turn.floor() % 2.0) } else { 0.0 };
///     10.0 + (91.7 * t * t).sin() + flash
/// };
/// let rate: Vec<f64> = time.iter().map(light).collect();
/// let series = Series::new("green", &time, &rate, None)?;
/// let train = flash_train(&[&series], &Options::default()).ok_or("no flashes")?;
/// let best = train.best.ok_or("no period")?;
/// assert!((best.period_s - 3.4).abs() < 0.01);
/// assert_eq!(train.phases.len(), 2);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn flash_train(series: &[&Series], options: &Options) -> Option<FlashTrain> {
    let train = Train::new(series)?;
    let range = train.range(options)?;
    let mut found = FlashTrain {
        flashes: train.strong,
        lit: train.lit,
        variance_share: train.variance_share,
        width_s: train.width_s,
        outcome: Outcome::NotEnough(Reason::Constant),
        decides: false,
        best: None,
        phases: Vec::new(),
        middle_s: train.middle_s,
        chance: None,
        questions: Vec::new(),
        searched_s: Some(range),
    };
    let (mut start, mut trials) = ((0.0, f64::NEG_INFINITY, train.width_s), 0.0);
    for times in WIDTHS {
        let width_s = times * train.width_s;
        if train.periods(width_s, range) * FLASHES.0 as f64 > MOST_FOLDS {
            continue;
        }
        let (period_s, excess, tried) = train.scan(width_s, range);
        trials += tried * range.1 / width_s;
        if excess > start.1 {
            start = (period_s, excess, width_s);
        }
    }
    if start.0 <= 0.0 {
        return None;
    }
    let width_s = start.2;
    found.width_s = width_s;
    let base = train.resolved(start.0, width_s, range);
    let best = train.sharpened(base, width_s);
    let p = best.period_s;
    let turns = train.span_s / p;
    found.best = Some(best);
    let phases = train.phases(p, width_s);
    found.phases = phases
        .iter()
        .map(|phase| {
            let own = train.turns(p, *phase, width_s);
            let flashed: Vec<f64> = own.iter().map(|t| t.1).filter(|s| *s > 0.0).collect();
            let strength = median(flashed.iter().copied()).unwrap_or(0.0);
            FlashPhase { phase: *phase, seen: own.len(), flashed: flashed.len(), strength }
        })
        .collect();
    let chance = train.chance(p, width_s, &phases, trials);
    found.chance = Some(chance);
    if chance > CHANCE {
        found.outcome = Outcome::NotEnough(Reason::Noise { period_s: p, chance });
        return Some(found);
    }
    if turns < LEAST_TURNS {
        let wanted_s = LEAST_TURNS * p;
        let least = LEAST_TURNS;
        found.outcome = Outcome::NotEnough(Reason::Turns { period_s: p, turns, least, wanted_s });
        return Some(found);
    }
    let scaled = |by: f64| Estimate { period_s: p * by, sigma_s: best.sigma_s * by };
    let mut members = vec![Member { estimate: best, membership: Membership::Best, turns }];
    for n in [2, 3] {
        let question = train.question(p, n, width_s);
        let by = n as f64;
        let alike = if n == 3 { ALIKE_RARE } else { ALIKE };
        // One flash a turn does not say how many faces like that the body has.
        let is_open = phases.len() == 1
            || question.chance.is_none_or(|c| c < NO)
            || question.unlike.is_none_or(|u| u > alike);
        if is_open {
            let membership = Membership::Multiple(n);
            members.push(Member { estimate: scaled(by), membership, turns: turns / by });
        }
        found.questions.push(question);
    }
    for q in [2, 3] {
        let by = q as f64;
        if p / by < range.0 {
            continue;
        }
        let question = train.question(p / by, q, width_s);
        if question.chance.is_none_or(|c| c > YES) {
            let membership = Membership::Part(q);
            members.push(Member { estimate: scaled(1.0 / by), membership, turns: turns * by });
        }
        found.questions.push(question);
    }
    found.outcome = if members.len() == 1 { Outcome::One(best) } else { Outcome::Family(members) };
    Some(found)
}

/// The verdict of the harmonics with what the flashes say beside it. Flashes answer where the harmonics do not, and where they have most of the light's variance. The train's
/// [`FlashTrain::decides`] says whether its answer is the verdict's.
pub fn with_flashes(
    series: &[Series],
    options: &Options,
    mut found: Verdict,
) -> (Verdict, Option<FlashTrain>) {
    let left_out = |s: &Series| found.left_out.iter().any(|(name, _)| *name == s.name);
    let used: Vec<&Series> = series.iter().filter(|s| !left_out(s)).collect();
    let Some(mut train) = flash_train(&used, options) else { return (found, None) };
    let is_answer = |o: &Outcome| !matches!(o, Outcome::NotEnough(_));
    train.decides = is_answer(&train.outcome)
        && (!is_answer(&found.outcome) || train.variance_share > MOST_OF_LIGHT);
    if train.decides {
        found.outcome = train.outcome.clone();
        found.best = train.best;
        found.false_alarm = train.chance;
        found.beside = None;
        found.searched_s = found.searched_s.or(train.searched_s);
    }
    (found, Some(train))
}

impl Train {
    /// From the period of a fold to the smallest one that its multiples do not better.
    fn resolved(&self, start_s: f64, width_s: f64, (shortest_s, longest_s): (f64, f64)) -> f64 {
        const FACTORS: [usize; 4] = [2, 3, 5, 7];
        let mut base = self.sharpened(start_s, width_s).period_s;
        for _ in 0..12 {
            let shorter = FACTORS.into_iter().find(|q| {
                let p = base / *q as f64;
                p >= shortest_s && self.question(p, *q, width_s).chance.is_some_and(|c| c > NO)
            });
            if let Some(q) = shorter {
                base = self.sharpened(base / q as f64, width_s).period_s;
                continue;
            }
            let longer = FACTORS.into_iter().find(|n| {
                base * *n as f64 <= longest_s
                    && self.question(base, *n, width_s).chance.is_some_and(|c| c < YES)
            });
            match longer {
                Some(n) => base = self.sharpened(base * n as f64, width_s).period_s,
                None => break,
            }
        }
        base
    }

    /// Upper bound of the chance of the fullest phase, for so many bins and periods that were looked at.
    fn chance(&self, period_s: f64, width_s: f64, phases: &[f64], trials: f64) -> f64 {
        let n = self.flashes.len() as f64;
        let total: f64 = self.flashes.iter().map(Flash::weight).sum();
        let part = (width_s / period_s).min(0.5);
        let of_phase = |phase: &f64| {
            let inside = |f: &&Flash| {
                let off = f.time_s / period_s - phase;
                (off - off.round()).abs() <= 0.5 * part
            };
            let inside: f64 = self.flashes.iter().filter(inside).map(Flash::weight).sum();
            bound(n, inside, total, self.seen_share(period_s, *phase, part))
        };
        (phases.iter().map(of_phase).fold(1.0, f64::min) * trials.max(1.0)).min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: scipy 1.17.1, `stats.kruskal([1, 2, 2, 5], [3, 4, 4, 9], [0, 1, 2, 2])`. Tolerance: rounding.
    #[test]
    fn ranks_are_those_of_the_paper() {
        let expected = 6.092_153_284_671_538_5;
        let kinds = [vec![1.0, 2.0, 2.0, 5.0], vec![3.0, 4.0, 4.0, 9.0], vec![0.0, 1.0, 2.0, 2.0]];
        let found = kruskal_wallis(&kinds).unwrap();
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        assert_eq!(kruskal_wallis(&[vec![1.0; 4], vec![1.0; 4]]), None);
    }

    /// Truth: the binomial tail itself, summed. The bound lies above it, and within a factor of 30 of it.
    #[test]
    fn the_bound_is_one() {
        let (n, p) = (200_u32, 0.02_f64);
        let mut term = (1.0 - p).powi(200);
        let mut tail = Vec::new();
        for k in 0..=n {
            tail.push(term);
            term *= f64::from(n - k) / f64::from(k + 1) * p / (1.0 - p);
        }
        for k in [10_usize, 20, 40, 73] {
            let exact: f64 = tail[k..].iter().sum();
            let found = bound(200.0, k as f64, 200.0, p);
            assert!(found >= exact && found < 30.0 * exact, "{k}: {found:e} {exact:e}");
        }
    }
}
