//! The verdict: one period, a family of which the data cannot choose, or not enough data.
//!
//! The highest peak of a periodogram is rarely the period of a turning body: two like sides give half of it, a glint a third. So the highest peak is only where the search
//! begins. From there the period is made longer as long as twice, three, five or seven times it explains lines that it does not (see the module `lines`), and shorter as long as
//! nothing is lost. What is left is the smallest period that its multiples do not better; phase dispersion is asked the same by an F test. Where an answer is neither
//! yes nor no, both periods are members of a family, with what would decide.

mod outcome;

pub use outcome::{Estimate, Member, Membership, Options, Outcome, Question, Reason, Verdict};

use super::fit::solve;
use super::lines::{Lines, harmonics as most_harmonics, residual};
use super::lomb_scargle::Centred;
use super::pdm::{Dispersion, dispersion_test};
use super::significance::{false_alarm, joint_gain};
use super::spectrum::median_step;
use super::stats::fisher;
use super::{Grid, PeriodError, lomb_scargle, pdm, window};
use crate::series::Series;

/// Harmonics of the models that the search begins with.
pub const SEARCHED: [usize; 4] = [1, 2, 4, 8];
/// Frequencies of a search to a resolution of the highest harmonic.
const OVERSAMPLING: f64 = 5.0;
/// More frequencies than that are refused.
const MOST_FREQUENCIES: usize = 20_000_000;
/// Fewer samples than that are refused.
const LEAST_SAMPLES: usize = 12;
/// Fewer turns than that show no repetition.
const LEAST_TURNS: f64 = 3.0;
/// A chance below this is a yes, above the next a no, between them neither.
const YES: f64 = 1e-4;
const NO: f64 = 0.02;
/// Between the two, where the search has to go one way: their geometric mean.
const EITHER: f64 = 1.4e-3;
/// The same of five and seven times a period: bodies of five or seven like sides are rare.
const EITHER_RARE: f64 = 1e-7;
/// Turns that may differ by more than this share of their light are not known to be alike: the body may have like sides.
const ALIKE: f64 = 0.1;
/// The same of thirds of a turn: bodies of three like sides are rarer, and have to be more alike to be taken for one.
const ALIKE_RARE: f64 = 0.5;
/// Multiples that are asked about.
const MULTIPLES: [usize; 4] = [2, 3, 5, 7];
/// A peak this much lower in twice the logarithm of the likelihood is not ruled out: once in 2,000 by chance.
const RIVAL: f64 = 12.0;
/// A window's peak this high makes aliases.
const WINDOW_PEAK: f64 = 0.3;

/// A part of a period that loses more than this share of the gain is none.
const MOST_OF: f64 = 0.5;

fn either(times: usize) -> f64 {
    if times > 3 { EITHER_RARE } else { EITHER }
}

/// Gives the verdict on all series at once: a period that they share, with curves of their own.
///
/// # Errors
/// A range of periods that is none, or needs more frequencies than can be looked at.
pub fn verdict(series: &[Series], options: &Options) -> Result<Verdict, PeriodError> {
    let mut answer = Verdict {
        outcome: Outcome::NotEnough(Reason::Constant),
        best: None,
        harmonics: 0,
        false_alarm: None,
        beside: None,
        questions: Vec::new(),
        peaks: Vec::new(),
        searched_s: None,
        window_peaks: Vec::new(),
        independent_channels: 0.0,
        independent_samples: 1.0,
        left_out: Vec::new(),
    };
    let mut used = Vec::new();
    for s in series {
        let checked = if s.len() < LEAST_SAMPLES {
            let (name, samples) = (s.name.clone(), s.len());
            Err(PeriodError::Samples { name, samples, harmonics: (LEAST_SAMPLES - 2) / 2 })
        } else {
            Centred::new(s, 1).map(|_| ())
        };
        match checked {
            Ok(()) => used.push(s),
            Err(error) => answer.left_out.push((s.name.clone(), error)),
        }
    }
    if used.is_empty() {
        let samples = series.iter().map(Series::len).max().unwrap_or(0);
        let is_short = samples < LEAST_SAMPLES;
        let least = LEAST_SAMPLES;
        answer.outcome = Outcome::NotEnough(if is_short {
            Reason::Samples { samples, least }
        } else {
            Reason::Constant
        });
        return Ok(answer);
    }
    let Some(range) = Range::new(&used, options)? else {
        answer.outcome = Outcome::NotEnough(Range::reason(&used, options));
        return Ok(answer);
    };
    answer.searched_s = Some((1.0 / range.highest_hz, 1.0 / range.lowest_hz));
    Search { series: &used, range, centred: centred(&used) }.run(&mut answer)?;
    Ok(answer)
}

fn centred<'a>(series: &[&'a Series]) -> Vec<Centred<'a>> {
    series.iter().filter_map(|s| Centred::new(s, 1).ok()).collect()
}

/// The frequencies that are looked at.
#[derive(Debug, Clone, Copy)]
struct Range {
    lowest_hz: f64,
    highest_hz: f64,
    /// What the sampling shows at most: harmonics lie below it.
    limit_hz: f64,
    span_s: f64,
}

impl Range {
    fn ends(series: &[&Series], options: &Options) -> (f64, f64, f64, f64) {
        let span_s = series.iter().map(|s| s.span_s()).fold(0.0, f64::max);
        let step_s = series.iter().filter_map(|s| median_step(s)).fold(f64::INFINITY, f64::min);
        let exposure_s = series.iter().map(|s| s.exposure_s).fold(f64::INFINITY, f64::min);
        let finest_s = 2.0 * step_s.max(exposure_s);
        (
            span_s,
            finest_s,
            options.shortest_s.unwrap_or(finest_s),
            options.longest_s.unwrap_or(0.5 * span_s),
        )
    }

    fn new(series: &[&Series], options: &Options) -> Result<Option<Self>, PeriodError> {
        let (span_s, finest_s, shortest_s, longest_s) = Self::ends(series, options);
        let is_asked = options.shortest_s.is_some() || options.longest_s.is_some();
        let good = shortest_s > 0.0 && shortest_s < longest_s && longest_s.is_finite();
        if !good && is_asked && finest_s < 0.5 * span_s {
            return Err(PeriodError::Range { shortest_s, longest_s });
        }
        if !good || span_s <= 0.0 {
            return Ok(None);
        }
        let limit_hz = 1.0 / finest_s.min(shortest_s);
        let (lowest_hz, highest_hz) = (1.0 / longest_s, 1.0 / shortest_s);
        let frequencies = (OVERSAMPLING * span_s * highest_hz) as usize;
        if frequencies > MOST_FREQUENCIES {
            return Err(PeriodError::TooMany { frequencies, most: MOST_FREQUENCIES, shortest_s });
        }
        Ok(Some(Self { lowest_hz, highest_hz, limit_hz, span_s }))
    }

    fn reason(series: &[&Series], options: &Options) -> Reason {
        let (span_s, _, shortest_s, longest_s) = Self::ends(series, options);
        let step_s = series.iter().filter_map(|s| median_step(s)).fold(f64::INFINITY, f64::min);
        let exposure_s = series.iter().map(|s| s.exposure_s).fold(f64::INFINITY, f64::min);
        Reason::Range { step_s, exposure_s, span_s, shortest_s, longest_s }
    }

    /// A grid for a model of so many harmonics; `None` where there is no room below the limit.
    fn grid(&self, harmonics: usize) -> Option<Grid> {
        let last = self.highest_hz.min(self.limit_hz / harmonics as f64);
        let step_hz = 1.0 / (OVERSAMPLING * harmonics as f64 * self.span_s);
        let n = ((last - self.lowest_hz) / step_hz).floor();
        (n >= 2.0).then(|| Grid { first_hz: self.lowest_hz, step_hz, n: n as usize + 1 })
    }
}

struct Search<'a> {
    series: &'a [&'a Series],
    range: Range,
    centred: Vec<Centred<'a>>,
}

/// A peak of the search.
#[derive(Clone, Copy)]
struct Peak {
    frequency_hz: f64,
    harmonics: usize,
    gain: f64,
}

impl Search<'_> {
    fn samples(&self) -> usize {
        self.series.iter().map(|s| s.len()).sum()
    }

    /// The joint gain at one frequency.
    fn gain(&self, frequency_hz: f64, harmonics: usize) -> f64 {
        let of = |(c, s): (&Centred, &&Series)| {
            let harmonics = harmonics.min((s.len() - 2) / 2).max(1);
            joint_gain(c.share(solve(c, frequency_hz, harmonics).1), s.len(), harmonics)
        };
        self.centred.iter().zip(self.series).map(of).sum()
    }

    /// The highest gain within `half_hz` of a frequency, by golden sections.
    fn refined(&self, frequency_hz: f64, half_hz: f64, harmonics: usize) -> f64 {
        const GOLDEN: f64 = 0.618_033_988_749_895;
        let (mut a, mut b) = (frequency_hz - half_hz, frequency_hz + half_hz);
        a = a.max(0.25 * frequency_hz);
        let (mut x, mut y) = (b - GOLDEN * (b - a), a + GOLDEN * (b - a));
        let (mut at_x, mut at_y) = (self.gain(x, harmonics), self.gain(y, harmonics));
        for _ in 0..24 {
            if at_x > at_y {
                (b, y, at_y) = (y, x, at_x);
                x = b - GOLDEN * (b - a);
                at_x = self.gain(x, harmonics);
            } else {
                (a, x, at_x) = (x, y, at_y);
                y = a + GOLDEN * (b - a);
                at_y = self.gain(y, harmonics);
            }
        }
        0.5 * (a + b)
    }

    /// Harmonics by the Bayesian information criterion at a frequency.
    fn order(&self, frequency_hz: f64) -> usize {
        let least =
            self.series.iter().map(|s| most_harmonics(s, frequency_hz, self.range.limit_hz)).min();
        let cost = 2.0 * self.series.len() as f64 * (self.samples() as f64).ln();
        let score = |k: usize| self.gain(frequency_hz, k) - cost * k as f64;
        let mut best = (1, score(1));
        for k in 2..=least.unwrap_or(1) {
            let found = score(k);
            if found > best.1 {
                best = (k, found);
            }
        }
        best.0
    }

    fn run(self, answer: &mut Verdict) -> Result<(), PeriodError> {
        let mut curves = Vec::new();
        for harmonics in SEARCHED {
            let Some(grid) = self.range.grid(harmonics) else { continue };
            if self.series.iter().any(|s| s.len() <= 4 * harmonics + 2) {
                continue;
            }
            let mut joint = vec![0.0; grid.n];
            for s in self.series {
                let power = lomb_scargle(s, &grid, harmonics)?;
                for (sum, p) in joint.iter_mut().zip(power) {
                    *sum += joint_gain(p, s.len(), harmonics);
                }
            }
            curves.push((harmonics, grid, joint));
        }
        let cost = 2.0 * self.series.len() as f64 * (self.samples() as f64).ln();
        let mut best: Option<(Peak, f64)> = None;
        for (harmonics, grid, joint) in &curves {
            let highest = joint.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
            let Some((i, gain)) = highest else { continue };
            let peak =
                Peak { frequency_hz: grid.frequency_hz(i), harmonics: *harmonics, gain: *gain };
            answer.peaks.push((*harmonics, 1.0 / peak.frequency_hz, peak.gain));
            let score = gain - cost * *harmonics as f64;
            if best.is_none_or(|(_, s)| score > s) {
                best = Some((peak, score));
            }
        }
        let Some((peak, _)) = best else {
            answer.outcome = Outcome::NotEnough(Range::reason(self.series, &Options::default()));
            return Ok(());
        };
        let step = 1.0 / (OVERSAMPLING * peak.harmonics as f64 * self.range.span_s);
        let start = self.refined(peak.frequency_hz, step, peak.harmonics);
        // Shared noise is judged by what the first model leaves.
        let (channels, _) = self.independence(start);
        let base = self.resolve(start, channels);
        self.judge(base, &curves, answer)
    }

    /// Sharpens a frequency with as many harmonics as the data ask for.
    fn sharpened(&self, frequency_hz: f64) -> f64 {
        let harmonics = self.order(frequency_hz);
        self.refined(frequency_hz, 0.4 / (harmonics as f64 * self.range.span_s), harmonics)
    }

    /// From a peak to the smallest period that its multiples do not better.
    fn resolve(&self, start_hz: f64, channels: f64) -> f64 {
        let lines = self.lines(channels);
        let mut base = self.sharpened(start_hz);
        for _ in 0..12 {
            let shorter = MULTIPLES.into_iter().find(|q| {
                let f = base * *q as f64;
                f <= self.range.highest_hz * (1.0 + 1e-9)
                    && lines.longer(f, *q, 1).is_some_and(|l| l.chance > EITHER)
                    && self.gain(f, self.order(f)) > MOST_OF * self.gain(base, self.order(base))
            });
            if let Some(q) = shorter {
                base = self.sharpened(base * q as f64);
                continue;
            }
            let longer = MULTIPLES.into_iter().find(|n| {
                base / *n as f64 >= self.range.lowest_hz * (1.0 - 1e-9)
                    && lines.longer(base, *n, 1).is_some_and(|l| l.chance < either(*n))
            });
            match longer {
                Some(n) => base = self.sharpened(base / n as f64),
                None => break,
            }
        }
        base
    }

    fn lines(&self, channels: f64) -> Lines<'_> {
        Lines { series: self.series, highest_hz: self.range.limit_hz, independent: channels }
    }

    /// The shares of channels and of samples that say something of their own, from what the harmonics leave.
    fn independence(&self, frequency_hz: f64) -> (f64, f64) {
        let mut left = Vec::new();
        let mut shares = Vec::new();
        for s in self.series {
            let harmonics = most_harmonics(s, frequency_hz, self.range.limit_hz);
            let Some(r) = residual(s, frequency_hz, harmonics, 1) else { continue };
            let square: f64 = r.iter().map(|r| r * r).sum();
            let next: f64 = r.windows(2).map(|r| r[0] * r[1]).sum();
            let rho = if square > 0.0 { (next / square).clamp(0.0, 0.99) } else { 0.0 };
            shares.push((1.0 - rho) / (1.0 + rho));
            left.push((s, r, square));
        }
        let mut sum = 0.0;
        for (s, r, square) in &left {
            for (t, q, other) in &left {
                let same = s.time_s == t.time_s && *square > 0.0 && *other > 0.0;
                let product: f64 = r.iter().zip(q).map(|(a, b)| a * b).sum();
                sum += if std::ptr::eq(*s, *t) {
                    1.0
                } else if same {
                    product * product / (square * other)
                } else {
                    0.0
                };
            }
        }
        let n = left.len() as f64;
        let channels = if n > 0.0 { n / sum.max(n / n.max(1.0)) } else { 1.0 };
        let samples = shares.iter().sum::<f64>() / (shares.len().max(1)) as f64;
        (channels.clamp(1.0 / n.max(1.0), 1.0), if shares.is_empty() { 1.0 } else { samples })
    }

    fn estimate(&self, frequency_hz: f64, harmonics: usize, independent: f64) -> Estimate {
        // A tenth of a resolution of the highest harmonic: the top of the peak is a parabola there.
        let h = 0.1 / (harmonics as f64 * self.range.span_s);
        let at = |f: f64| self.gain(f, harmonics);
        let curvature =
            (2.0 * at(frequency_hz) - at(frequency_hz - h) - at(frequency_hz + h)) / (h * h);
        let sigma_hz = (2.0 / (curvature * independent)).sqrt();
        let period_s = 1.0 / frequency_hz;
        Estimate { period_s, sigma_s: period_s * period_s * sigma_hz }
    }

    fn judge(
        &self,
        base: f64,
        curves: &[(usize, Grid, Vec<f64>)],
        answer: &mut Verdict,
    ) -> Result<(), PeriodError> {
        let (channels, samples) = self.independence(base);
        let independent = channels * samples;
        let lines = self.lines(channels);
        let harmonics = self.order(base);
        let best = self.estimate(base, harmonics, independent);
        let turns = self.range.span_s * base;
        let gain = self.gain(base, harmonics);
        let alarm = false_alarm(gain, self.series, harmonics, self.range.highest_hz, independent)?;
        let beside = lines.chance_of_noise(base);
        answer.best = Some(best);
        answer.harmonics = harmonics;
        answer.false_alarm = Some(alarm);
        answer.beside = beside;
        answer.independent_channels = channels * self.series.len() as f64;
        answer.independent_samples = samples;
        answer.window_peaks = self.window_peaks()?;
        if turns < LEAST_TURNS {
            let period_s = best.period_s;
            let (least, wanted_s) = (LEAST_TURNS, LEAST_TURNS * period_s);
            answer.outcome = Outcome::NotEnough(Reason::Turns { period_s, turns, least, wanted_s });
            return Ok(());
        }
        let chance = alarm.max(beside.unwrap_or(0.0));
        if chance > 1e-3 {
            answer.outcome = Outcome::NotEnough(Reason::Noise { period_s: best.period_s, chance });
            return Ok(());
        }
        let mut members = vec![Member { estimate: best, membership: Membership::Best, turns }];
        let scaled =
            |by: f64| Estimate { period_s: best.period_s * by, sigma_s: best.sigma_s * by };
        for n in [2, 3] {
            let question = self.question(&lines, base, n, (harmonics, samples))?;
            let undecided = question.chance.is_none_or(|p| p < NO)
                || question.unlike.is_none_or(|u| u > if n == 2 { ALIKE } else { ALIKE_RARE })
                || question.dispersion_chance.is_some_and(|p| p < YES);
            if undecided {
                let by = n as f64;
                let membership = Membership::Multiple(n);
                members.push(Member { estimate: scaled(by), membership, turns: turns / by });
            }
            answer.questions.push(question);
        }
        for q in [2, 3] {
            let by = q as f64;
            if base * by > self.range.highest_hz {
                continue;
            }
            let question = self.question(&lines, base * by, q, (harmonics.div_ceil(q), samples))?;
            if question.chance.is_none_or(|p| p > YES) {
                let membership = Membership::Part(q);
                members.push(Member { estimate: scaled(1.0 / by), membership, turns: turns * by });
            }
            answer.questions.push(question);
        }
        for f in self.rivals(base, curves, independent) {
            let estimate = self.estimate(f, self.order(f), independent);
            let turns = self.range.span_s * f;
            members.push(Member { estimate, membership: Membership::Alias, turns });
        }
        answer.outcome =
            if members.len() == 1 { Outcome::One(best) } else { Outcome::Family(members) };
        Ok(())
    }

    /// Whether `times` the period of a frequency explains more.
    fn question(
        &self,
        lines: &Lines,
        frequency_hz: f64,
        times: usize,
        (order, samples): (usize, f64),
    ) -> Result<Question, PeriodError> {
        let shorter_s = 1.0 / frequency_hz;
        let longer_s = times as f64 * shorter_s;
        let mut chances = Vec::new();
        // With fewer turns of the longer period than that, a drift along the curve looks like a difference between its turns.
        if self.range.span_s / longer_s >= LEAST_TURNS {
            for s in self.series {
                let bins = (s.len() / (8 * times)).min(20);
                if bins < 2 {
                    continue;
                }
                let coarse: Dispersion = pdm(s, &[shorter_s], bins)?[0];
                let fine = pdm(s, &[longer_s], bins * times)?[0];
                chances.extend(dispersion_test(&coarse, &fine, samples));
            }
        }
        let found = lines.longer(frequency_hz, times, order);
        Ok(Question {
            longer_s,
            shorter_s,
            chance: found.map(|l| l.chance),
            unlike: found.map(|l| l.unlike).filter(|u| u.is_finite()),
            dispersion_chance: (!chances.is_empty()).then(|| fisher(chances, lines.independent)),
        })
    }

    /// Peaks of the sampling's own spectrum, the highest first.
    fn window_peaks(&self) -> Result<Vec<(f64, f64)>, PeriodError> {
        let Some(longest) = self.series.iter().max_by(|a, b| a.span_s().total_cmp(&b.span_s()))
        else {
            return Ok(Vec::new());
        };
        let step_hz = 1.0 / (OVERSAMPLING * self.range.span_s);
        let n = (2.0 * self.range.limit_hz / step_hz) as usize + 2;
        if n > MOST_FREQUENCIES {
            return Ok(Vec::new());
        }
        let grid = Grid { first_hz: 0.0, step_hz, n };
        // The sampling's own: weights follow the light, and would bring its period in.
        let even = Series { weight: vec![1.0; longest.len()], ..(*longest).clone() };
        let power = window(&even, &grid)?;
        let mut peaks: Vec<(f64, f64)> = (1..n - 1)
            .filter(|i| {
                power[*i] > WINDOW_PEAK && power[*i] >= power[i - 1] && power[*i] >= power[i + 1]
            })
            .map(|i| (grid.frequency_hz(i), power[i]))
            .collect();
        peaks.sort_by(|a, b| b.1.total_cmp(&a.1));
        peaks.truncate(8);
        Ok(peaks)
    }

    /// Other peaks that are nearly as high as the best at their own best number of harmonics, and no multiple or part of it.
    fn rivals(&self, base: f64, curves: &[(usize, Grid, Vec<f64>)], independent: f64) -> Vec<f64> {
        let resolution = 1.0 / self.range.span_s;
        let related = |f: f64| {
            (1..=24).any(|i| {
                (1..=24).any(|j| {
                    let at = base * i as f64 / j as f64;
                    (f - at).abs() < 1.5 * resolution / j as f64
                        && (i == 1 || j == 1 || i <= 4 && j <= 4)
                })
            })
        };
        let mut rivals: Vec<f64> = Vec::new();
        let cost = 2.0 * self.series.len() as f64 * (self.samples() as f64).ln();
        let harmonics = self.order(base);
        let highest = self.gain(base, harmonics) - cost * harmonics as f64;
        for (harmonics, grid, joint) in curves {
            let floor = highest - RIVAL / independent + cost * *harmonics as f64;
            for i in 1..grid.n - 1 {
                let f = grid.frequency_hz(i);
                let is_peak = joint[i] >= joint[i - 1] && joint[i] >= joint[i + 1];
                if is_peak
                    && joint[i] > floor
                    && !related(f)
                    && rivals.iter().all(|r| (r - f).abs() > resolution)
                {
                    rivals.push(f);
                }
            }
        }
        rivals.truncate(6);
        rivals
    }
}
