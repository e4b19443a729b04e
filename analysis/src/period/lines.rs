//! Test for a curve that repeats only after nP, not after P: lines between the harmonics of P, judged by what lies beside them.
//!
//! Harmonics of P, each with an amplitude that may grow or fall along the curve, are fitted and subtracted. If nP is the period, lines are left at fractions
//! j/(nP); if not, the curve's own noise is, of whatever colour: the spectrum a few resolutions beside each line says how much. A line's power over the mean of 2B
//! such places exceeds r by chance (1 + r/2B)^−2B (F of 2 and 4B degrees of freedom); the lines are put together by Fisher's sum and by their smallest.
//!
//! Where the turns are many the samples are tapered (Hann), so that what the harmonics leave does not leak into the lines. A line where a harmonic above half of the
//! sampling would be folded to is not asked, unless there is no other: then it can say no, but not yes.

use super::lomb_scargle::centred_times;
use super::stats::fisher;
use super::sums::turns;
use crate::series::Series;
use nalgebra::{Cholesky, DMatrix, DVector};
use std::f64::consts::TAU;
use sunglint_numerics::order::median;

/// The most harmonics that are subtracted.
pub(super) const MOST: usize = 16;
/// The most places on either side of a line.
const BESIDE: usize = 4;
/// A line is told apart from its neighbours beyond that many resolutions 1/span: the subtracted harmonics take some of what lies nearer.
const APART: f64 = 1.5;
/// The same of tapered samples, whose lines are twice as wide.
const APART_TAPERED: f64 = 3.0;
/// From that many resolutions between lines on, samples are tapered.
const TAPERED: f64 = 6.0;
/// Folded harmonics are looked for up to that multiple of the sampling.
const FOLDED: i32 = 3;
/// Samples of a block in which a sampling is looked at, at least, and blocks at most.
const BLOCK: usize = 48;
const BLOCKS: usize = 8;
/// A line of this share of the strongest harmonic is more than a folded one.
const STRONG: f64 = 0.25;
/// Multiples of a frequency after which phases are computed anew: until then they are products, whose roundings add up.
const FRESH: usize = 64;
/// Curves are resolved where no line of the upper half below half of the sampling has more than this share of the strongest.
const RESOLVED: f64 = 0.05;
/// Looked at for that up to this harmonic.
const FLAT_TO: usize = 64;
/// Lines that may be folded harmonics are not there if their chance to be noise is above this.
const ABSENT: f64 = 0.1;
/// Curves without noise leave roundings: no sample is better known than to this share of the light's variation.
const EXACT: f64 = 1e-9;
/// Harmonics beyond this are too weak to be seen folded: a glint of a hundredth of a turn has fallen by then.
const HIGHEST_ORDER: f64 = 64.0;

/// Harmonics of `frequency_hz` below `highest_hz`, as many as the samples bear with amplitudes that drift.
pub(super) fn harmonics(series: &Series, frequency_hz: f64, highest_hz: f64) -> usize {
    let below = (highest_hz / frequency_hz * (1.0 + 1e-9)).floor() as usize;
    below.min(MOST).min(series.len() / 16).max(1)
}

/// Harmonics whose amplitudes are polynomials in time, fitted to a series.
pub(super) struct Drifting {
    /// The rest that they leave, by sample, in units of the values.
    pub left: Vec<f64>,
    /// Share of the weighted variance that they explain, 0 to 1.
    pub power: f64,
    /// Coefficients: of the mean and of the cosine and sine of each harmonic, all by rising powers of the time, which runs from −1 to 1 along the series.
    coefficients: Vec<f64>,
    drift: usize,
}

impl Drifting {
    /// The cosine's and the sine's coefficient of a harmonic (from 1), of a power of the time.
    pub(super) fn amplitude(&self, harmonic: usize, power: usize) -> [f64; 2] {
        [2 * harmonic - 1, 2 * harmonic].map(|k| self.coefficients[(self.drift + 1) * k + power])
    }

    /// Unknowns of such a model beside the mean.
    pub fn unknowns(harmonics: usize, drift: usize) -> usize {
        (2 * harmonics + 1) * (drift + 1) - 1
    }
}

/// Returns the residual of a series after harmonics with drifting amplitudes; `None` where they cannot be told apart.
pub(super) fn residual(
    series: &Series,
    frequency_hz: f64,
    harmonics: usize,
    drift: usize,
) -> Option<Vec<f64>> {
    drifting(series, frequency_hz, harmonics, drift).map(|model| model.left)
}

/// Fits harmonics with amplitudes that are polynomials of the degree `drift` in time; `None` where they cannot be told apart.
pub(super) fn drifting(
    series: &Series,
    frequency_hz: f64,
    harmonics: usize,
    drift: usize,
) -> Option<Drifting> {
    let time = centred_times(series);
    let half = (0.5 * series.span_s()).max(f64::MIN_POSITIVE);
    let columns = Drifting::unknowns(harmonics, drift) + 1;
    if series.len() <= columns {
        return None;
    }
    let mean = series.mean();
    let mut design = DMatrix::zeros(columns, series.len());
    let mut values = DVector::zeros(series.len());
    for (i, t) in time.iter().enumerate() {
        let root = series.weight[i].sqrt();
        let (sin, cos) = (TAU * turns(frequency_hz, *t)).sin_cos();
        let (mut c, mut s) = (1.0, 0.0);
        let mut column = design.column_mut(i);
        let mut at = 0;
        let mut put = |value: f64| {
            let mut power = root * value;
            for _ in 0..=drift {
                column[at] = power;
                power *= t / half;
                at += 1;
            }
        };
        put(1.0);
        for _ in 0..harmonics {
            (c, s) = (c * cos - s * sin, c * sin + s * cos);
            put(c);
            put(s);
        }
        values[i] = root * (series.value[i] - mean);
    }
    let mut normal = &design * design.transpose();
    // A breath of ridge: columns that the sampling cannot tell apart share what they explain.
    let ridge = 1e-12 * normal.diagonal().max();
    for k in 0..columns {
        normal[(k, k)] += ridge;
    }
    let solution = Cholesky::new(normal)?.solve(&(&design * &values));
    let variation = values.norm_squared();
    let left = values - design.transpose() * &solution;
    Some(Drifting {
        power: if variation > 0.0 { 1.0 - left.norm_squared() / variation } else { 0.0 },
        left: left.iter().zip(&series.weight).map(|(r, w)| r / w.sqrt()).collect(),
        coefficients: solution.iter().copied().collect(),
        drift,
    })
}

/// Samples ready for sums at single frequencies.
struct Weighed {
    time: Vec<f64>,
    /// Weight, taper and value less the mean.
    whole: Vec<f64>,
    /// Weight, taper and what the harmonics leave.
    left: Vec<f64>,
    resolution_hz: f64,
    /// Power that samples which are known to [`EXACT`] leave anywhere.
    least: f64,
    /// Samples per second, from the fewest to the most, where the sampling is regular.
    sampling_hz: Option<[f64; 2]>,
}

impl Weighed {
    fn new(series: &Series, left: &[f64], is_tapered: bool) -> Self {
        let time = centred_times(series);
        let span = series.span_s();
        let mean = series.mean();
        let taper = |t: f64| if is_tapered { 0.5 + 0.5 * (TAU * t / span).cos() } else { 1.0 };
        let by = |value: &dyn Fn(usize) -> f64| -> Vec<f64> {
            (0..time.len()).map(|i| series.weight[i] * taper(time[i]) * value(i)).collect()
        };
        let whole = by(&|i| series.value[i] - mean);
        let squares = series.value.iter().zip(&series.weight).map(|(v, w)| w * (v - mean).powi(2));
        let variance = squares.sum::<f64>() / series.weight.iter().sum::<f64>();
        let least = EXACT * EXACT * variance * by(&|_| 1.0).iter().map(|w| w * w).sum::<f64>();
        let left = by(&|i| left[i]);
        let sampling_hz = sampling(&time);
        Self { time, whole, left, resolution_hz: 1.0 / span, least, sampling_hz }
    }

    /// Power that the harmonics leave at the first multiples of a frequency, and so many resolutions to either side of each.
    fn left_beside(&self, base_hz: f64, most: usize, places: &[f64]) -> Multiples {
        let offsets: Vec<f64> =
            places.iter().flat_map(|b| [-b, *b]).map(|b| b * self.resolution_hz).collect();
        Multiples::new(&self.time, &self.left, base_hz, most, &offsets)
    }

    /// Whether a harmonic of `base_hz` above half of the sampling is folded onto a line.
    fn is_folded(&self, line_hz: f64, base_hz: f64) -> bool {
        let Some(sampling) = self.sampling_hz else { return false };
        let near = 2.0 * self.resolution_hz / base_hz;
        (-FOLDED..=FOLDED).filter(|m| *m != 0).any(|m| {
            let [a, b] = sampling.map(|s| (line_hz + f64::from(m) * s) / base_hz);
            let (from, to) = (a.min(b) - near, a.max(b) + near);
            from.ceil() <= to && a.abs().min(b.abs()) < HIGHEST_ORDER
        })
    }
}

/// Samples per second where the sampling is regular, from the fewest to the most: on a clock that goes with a body even steps of time are no longer even, but nearly so from one to the next.
fn sampling(time: &[f64]) -> Option<[f64; 2]> {
    let blocks = (time.len() / BLOCK).clamp(1, BLOCKS);
    let found: Vec<f64> = time
        .chunks(time.len().div_ceil(blocks).max(2))
        .filter_map(|part| {
            let step_s = median(part.windows(2).map(|t| t[1] - t[0]));
            let hz = 1.0 / step_s.filter(|s| *s > 0.0)?;
            let all = part.len() as f64;
            (power(part, &vec![1.0; part.len()], hz) > 0.25 * all * all).then_some(hz)
        })
        .collect();
    let ends = |of: fn(f64, f64) -> f64, from: f64| found.iter().copied().fold(from, of);
    (2 * found.len() >= blocks).then(|| [ends(f64::min, f64::INFINITY), ends(f64::max, 0.0)])
}

/// |Σ c e^{2πift}|² at a frequency.
fn power(time: &[f64], weighted: &[f64], frequency_hz: f64) -> f64 {
    let (mut a, mut b) = (0.0, 0.0);
    for (t, r) in time.iter().zip(weighted) {
        let (sin, cos) = (TAU * turns(frequency_hz, *t)).sin_cos();
        a += r * cos;
        b += r * sin;
    }
    a * a + b * b
}

/// |Σ c e^{2πift}|² at the multiples of a frequency, and at places beside each of them.
struct Multiples {
    base_hz: f64,
    /// From a multiple to the places, Hz: first 0, the multiple itself.
    offsets_hz: Vec<f64>,
    /// By multiple, from the first, and by place.
    power: Vec<f64>,
}

impl Multiples {
    /// Multiples up to `most`. From one to the next each sample's phase is a product.
    fn new(time: &[f64], weighted: &[f64], base_hz: f64, most: usize, beside_hz: &[f64]) -> Self {
        let offsets_hz: Vec<f64> = [&[0.0], beside_hz].concat();
        let places = offsets_hz.len();
        let rotation = |f: f64, t: f64| (TAU * turns(f, t)).sin_cos();
        let (mut a, mut b) = (vec![0.0; most * places], vec![0.0; most * places]);
        let (mut c, mut s) = (vec![0.0; places], vec![0.0; places]);
        for (t, r) in time.iter().zip(weighted) {
            let (sin, cos) = rotation(base_hz, *t);
            let rows = a.chunks_exact_mut(places).zip(b.chunks_exact_mut(places));
            for (j, (a, b)) in rows.enumerate() {
                if j % FRESH == 0 {
                    for ((c, s), offset) in c.iter_mut().zip(&mut s).zip(&offsets_hz) {
                        let (sin, cos) = rotation((j + 1) as f64 * base_hz + offset, *t);
                        (*c, *s) = (r * cos, r * sin);
                    }
                } else {
                    for (c, s) in c.iter_mut().zip(&mut s) {
                        (*c, *s) = (*c * cos - *s * sin, *c * sin + *s * cos);
                    }
                }
                for (((a, b), c), s) in a.iter_mut().zip(b).zip(&c).zip(&s) {
                    *a += c;
                    *b += s;
                }
            }
        }
        let power = a.iter().zip(&b).map(|(a, b)| a * a + b * b).collect();
        Self { base_hz, offsets_hz, power }
    }

    /// The power at a multiple, from 1.
    fn power(&self, multiple: usize) -> f64 {
        self.power[(multiple - 1) * self.offsets_hz.len()]
    }

    /// Frequencies beside a multiple and the power there.
    fn beside(&self, multiple: usize) -> impl Iterator<Item = (f64, f64)> + '_ {
        let places = self.offsets_hz.len();
        let own = &self.power[(multiple - 1) * places..multiple * places];
        let line_hz = multiple as f64 * self.base_hz;
        self.offsets_hz.iter().zip(own).skip(1).map(move |(o, power)| (line_hz + o, *power))
    }
}

/// A line and what lies beside it.
#[derive(Clone, Copy)]
struct Line {
    /// The chance that it is noise.
    chance: f64,
    power: f64,
    beside: f64,
}

/// Evidence of the lines for a longer period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Longer {
    /// The chance that what the longer period explains, and the shorter does not, is noise.
    pub chance: f64,
    /// Share of their light by which successive turns may differ all the same, at about 95 %.
    pub unlike: f64,
}

/// A question put to all series at once.
pub(super) struct Lines<'a> {
    pub series: &'a [&'a Series],
    /// Nothing above it is looked at, Hz.
    pub highest_hz: f64,
    /// The share of the channels that are independent of one another, 0 to 1.
    pub independent: f64,
}

impl Lines<'_> {
    /// Whether lines are there which `times` as long a period would have, and this one has not. `order` harmonics of this one stand out: a difference between turns is
    /// looked for up to there. `None` where the turns are too few to tell lines from harmonics, or lines are seen
    /// where the sampling folds harmonics to.
    pub fn longer(&self, frequency_hz: f64, times: usize, order: usize) -> Option<Longer> {
        // A sampling in step with the period folds harmonics onto all lines: a harmonic only adds to a line, so that lines that are not there still say so.
        self.of_lines(frequency_hz, times, order, false).or_else(|| {
            self.of_lines(frequency_hz, times, order, true).filter(|l| l.chance > ABSENT)
        })
    }

    /// The same from lines where no harmonic is folded to, or from all.
    fn of_lines(
        &self,
        frequency_hz: f64,
        times: usize,
        order: usize,
        is_all: bool,
    ) -> Option<Longer> {
        let n = times as f64;
        let mut by_series = Vec::new();
        // Above what lies beside, its noise, and the light itself; by series in units of what lies beside.
        let (mut excess, mut noise, mut light) = (0.0, 0.0, 0.0);
        for series in self.series {
            let spacing = frequency_hz * series.span_s() / n;
            let is_tapered = spacing >= TAPERED;
            let apart = if is_tapered { APART_TAPERED } else { APART };
            let beside = ((spacing - apart).floor().max(0.0) as usize).min(BESIDE);
            if beside == 0 {
                continue;
            }
            let harmonics = harmonics(series, frequency_hz, self.highest_hz);
            let left = residual(series, frequency_hz, harmonics, 1)?;
            let samples = Weighed::new(series, &left, is_tapered);
            // Tapered, a neighbour one resolution away belongs to the line.
            let first = if is_tapered { 2 } else { 1 };
            let places: Vec<f64> = (first..first + beside).map(|b| b as f64).collect();
            let shown = times * ((self.highest_hz / frequency_hz) as usize).min(FLAT_TO);
            let asked = times * harmonics;
            // Light at every multiple of the long period's frequency, and what is left at them and beside.
            let base_hz = frequency_hz / n;
            let most = shown.max(asked).max(times * order);
            let whole = Multiples::new(&samples.time, &samples.whole, base_hz, most, &[]);
            let left = samples.left_beside(base_hz, asked, &places);
            let at = |j: usize| whole.power(j);
            // Flashes that are shorter than a step have all harmonics alike, and those above half of the sampling are folded onto any line, however strong.
            let upper = (shown.div_ceil(2).max(1)..=shown).map(at).fold(0.0, f64::max);
            let all = (1..=shown).map(at).fold(0.0, f64::max);
            let strong = if upper > RESOLVED * all {
                f64::INFINITY
            } else {
                STRONG * (1..=harmonics).map(|k| at(times * k)).fold(0.0, f64::max)
            };
            let lines: Vec<(usize, Line)> = (1..=asked)
                .filter(|j| j % times != 0)
                .map(|j| (j, j as f64 * base_hz))
                .map(|(j, line)| {
                    (j, line, self.line(line, left.power(j), left.beside(j), &samples))
                })
                .filter(|(_, at, line)| {
                    is_all || line.power > strong || !samples.is_folded(*at, frequency_hz)
                })
                .map(|(j, _, line)| (j, line))
                .collect();
            let near: Vec<&Line> = lines
                .iter()
                .filter(|(j, l)| *j <= times * order && l.beside > 0.0)
                .map(|(_, l)| l)
                .collect();
            let unit = near.iter().map(|l| l.beside).sum::<f64>() / near.len().max(1) as f64;
            if unit > 0.0 {
                excess += near.iter().map(|l| (l.power - l.beside) / unit).sum::<f64>();
                noise += near.iter().map(|l| (l.beside / unit).powi(2)).sum::<f64>();
                let of_light = (1..=order).map(|k| at(times * k));
                light += (of_light.sum::<f64>() / unit - order as f64).max(0.0);
            }
            by_series.push(lines.into_iter().map(|(_, line)| line.chance).collect::<Vec<_>>());
        }
        let chance = self.joined(&by_series)?;
        let noise = (noise / self.independent).sqrt();
        // A difference u between like halves makes lines of u/2 of the light's amplitude.
        let unlike = if light > 0.0 {
            2.0 * ((excess.max(0.0) + 2.0 * noise) / light).sqrt()
        } else {
            f64::INFINITY
        };
        Some(Longer { chance, unlike })
    }

    /// The chance that the harmonics of a frequency themselves are no more than what lies beside them: red noise has peaks too. `None` as above.
    pub fn chance_of_noise(&self, frequency_hz: f64) -> Option<f64> {
        let mut by_series = Vec::new();
        for series in self.series {
            let spacing = frequency_hz * series.span_s();
            if spacing < 2.5 {
                continue;
            }
            // From two resolutions on: the drift of an amplitude takes what lies nearer.
            let last = ((0.5 * spacing).floor() as usize).clamp(2, 6);
            let harmonics = harmonics(series, frequency_hz, self.highest_hz).min(8);
            let left = residual(series, frequency_hz, harmonics, 1)?;
            let samples = Weighed::new(series, &left, false);
            let places: Vec<f64> = (2..=last).map(|b| b as f64).collect();
            let whole = Multiples::new(&samples.time, &samples.whole, frequency_hz, harmonics, &[]);
            let left = samples.left_beside(frequency_hz, harmonics, &places);
            let line = |k: usize| {
                let line_hz = k as f64 * frequency_hz;
                self.line(line_hz, whole.power(k), left.beside(k), &samples).chance
            };
            by_series.push((1..=harmonics).map(line).collect());
        }
        self.joined(&by_series)
    }

    /// A line of one series with its power, and what lies beside it; its chance is 1 where nothing does.
    fn line(
        &self,
        line_hz: f64,
        power: f64,
        beside: impl Iterator<Item = (f64, f64)>,
        samples: &Weighed,
    ) -> Line {
        let least_hz = 0.5 * samples.resolution_hz;
        let near = beside.filter(|(f, _)| *f > least_hz && *f <= self.highest_hz);
        let (n, sum) = near.fold((0.0, 0.0), |(n, sum), (_, power)| (n + 1.0, sum + power));
        if n == 0.0 || line_hz > self.highest_hz {
            return Line { chance: 1.0, power: 0.0, beside: 0.0 };
        }
        let beside = (sum / n).max(samples.least);
        let chance = if beside > 0.0 { (1.0 + power / beside / n).powf(-n) } else { 1.0 };
        Line { chance, power, beside }
    }

    /// All lines of all series as one chance.
    fn joined(&self, by_series: &[Vec<f64>]) -> Option<f64> {
        let most = by_series.iter().map(Vec::len).max().filter(|n| *n > 0)?;
        let lines: Vec<f64> = (0..most)
            .map(|k| fisher(by_series.iter().filter_map(|p| p.get(k)).copied(), self.independent))
            .collect();
        let least = lines.iter().copied().fold(1.0, f64::min);
        let all = fisher(lines.iter().copied(), 1.0);
        // Two tests: twice the smaller of their chances.
        Some((2.0 * all.min(least * most as f64)).min(1.0))
    }
}
