//! From the highest peak to the smallest period that its multiples do not better.

use super::super::fit::Sampled;
use super::super::lines::{Lines, harmonics as most_harmonics};
use super::super::lomb_scargle::Centred;
use super::super::significance::joint_gain;
use super::super::{FrequencyGrid, PeriodError, lomb_scargle};
use super::outcome::{Options, Outcome, Verdict};
use super::range::{OVERSAMPLING, Range};
use crate::series::Series;
use std::ops::RangeInclusive;

/// Harmonics of the models that the search begins with.
pub const SEARCHED: [usize; 4] = [1, 2, 4, 8];
/// Chance at which the search has to go one way, between one that is a yes and one that is a no: their geometric mean.
const EITHER: f64 = 1.4e-3;
/// The same of five and seven times a period: bodies of five or seven like sides are rare.
const EITHER_RARE: f64 = 1e-7;
/// Multiples that are asked about.
const MULTIPLES: [usize; 4] = [2, 3, 5, 7];
/// A part of a period that loses more than this share of the gain is none.
const MOST_OF: f64 = 0.5;

fn either(times: usize) -> f64 {
    if times > 3 { EITHER_RARE } else { EITHER }
}

pub(super) struct Search<'a> {
    pub series: &'a [&'a Series],
    pub range: Range,
    /// Frequencies beyond these that uneven samples show.
    pub beyond: Option<Range>,
    pub centred: Vec<Centred<'a>>,
}

/// A peak of the search.
#[derive(Clone, Copy)]
struct Peak {
    frequency_hz: f64,
    harmonics: usize,
    gain: f64,
    handicap: f64,
}

/// Gains of a model along its frequencies.
pub(super) struct Gains {
    pub harmonics: usize,
    pub grid: FrequencyGrid,
    pub joint: Vec<f64>,
    /// Lead that a peak must have here: twice the logarithm of how many more frequencies there are than in the usual range. So either range is as likely before the data speak.
    pub handicap: f64,
}

impl Search<'_> {
    pub fn samples(&self) -> usize {
        self.series.iter().map(|s| s.len()).sum()
    }

    /// The joint gain at one frequency.
    pub fn gain(&self, frequency_hz: f64, harmonics: usize) -> f64 {
        self.gains_of(frequency_hz, harmonics..=harmonics)[0]
    }

    /// The joint gains at one frequency of models of several numbers of harmonics.
    fn gains_of(&self, frequency_hz: f64, wanted: RangeInclusive<usize>) -> Vec<f64> {
        let mut joint = vec![0.0; wanted.clone().count()];
        for (centred, s) in self.centred.iter().zip(self.series) {
            let borne = |harmonics: usize| harmonics.min((s.len() - 2) / 2).max(1);
            let sums = Sampled::new(centred, frequency_hz, borne(*wanted.end()));
            for (sum, harmonics) in joint.iter_mut().zip(wanted.clone().map(borne)) {
                let share = centred.share(sums.solved(harmonics).1);
                *sum += joint_gain(share, s.len(), harmonics);
            }
        }
        joint
    }

    /// The highest gain within `half_hz` of a frequency, by golden sections.
    pub fn refined(&self, frequency_hz: f64, half_hz: f64, harmonics: usize) -> f64 {
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
    pub fn order(&self, frequency_hz: f64) -> usize {
        let least =
            self.series.iter().map(|s| most_harmonics(s, frequency_hz, self.range.limit_hz)).min();
        let cost = 2.0 * self.series.len() as f64 * (self.samples() as f64).ln();
        let most = least.unwrap_or(1);
        let gains = self.gains_of(frequency_hz, 1..=most);
        let scores = (1..).zip(gains).map(|(k, gain)| (k, gain - cost * k as f64));
        // The first of those that are equal.
        scores.reduce(|best, next| if next.1 > best.1 { next } else { best }).map_or(1, |s| s.0)
    }

    /// The gains of all models over a range.
    fn gains(&self, range: Range, handicap: f64) -> Result<Vec<Gains>, PeriodError> {
        let mut all = Vec::new();
        for harmonics in SEARCHED {
            let Some(grid) = range.grid(harmonics) else { continue };
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
            all.push(Gains { harmonics, grid, joint, handicap });
        }
        Ok(all)
    }

    pub fn run(mut self, answer: &mut Verdict) -> Result<(), PeriodError> {
        let usual = self.range;
        let mut curves = self.gains(usual, 0.0)?;
        if let Some(beyond) = self.beyond {
            let handicap = 2.0 * (beyond.highest_hz / usual.highest_hz).ln();
            curves.extend(self.gains(beyond, handicap)?);
        }
        let cost = 2.0 * self.series.len() as f64 * (self.samples() as f64).ln();
        let mut best: Option<(Peak, f64)> = None;
        let mut peaks: Vec<Peak> = Vec::new();
        for Gains { harmonics, grid, joint, handicap } in &curves {
            let highest = joint.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
            let Some((i, gain)) = highest else { continue };
            let (frequency_hz, harmonics, gain) = (grid.frequency_hz(i), *harmonics, *gain);
            let peak = Peak { frequency_hz, harmonics, gain, handicap: *handicap };
            peaks.push(peak);
            let score = gain - handicap - cost * harmonics as f64;
            if best.is_none_or(|(_, s)| score > s) {
                best = Some((peak, score));
            }
        }
        for harmonics in SEARCHED {
            let own = peaks.iter().filter(|p| p.harmonics == harmonics);
            let highest =
                own.max_by(|a, b| (a.gain - a.handicap).total_cmp(&(b.gain - b.handicap)));
            answer.peaks.extend(highest.map(|p| (harmonics, 1.0 / p.frequency_hz, p.gain)));
        }
        let Some((peak, _)) = best else {
            answer.outcome = Outcome::NotEnough(Range::reason(self.series, &Options::default()));
            return Ok(());
        };
        if let Some(beyond) = self.beyond {
            // Two ranges, each of which may give half of the false alarms.
            if peak.handicap > 0.0 {
                self.range = Range { lowest_hz: usual.lowest_hz, ..beyond };
            }
            self.range.counted_hz = 2.0 * self.range.highest_hz;
        }
        let step = 1.0 / (OVERSAMPLING * peak.harmonics as f64 * self.range.span_s);
        let start = self.refined(peak.frequency_hz, step, peak.harmonics);
        // Shared noise is judged by what the first model leaves.
        let (channels, _) = self.independence(start);
        let base = self.resolve(start, channels);
        self.judge(base, &curves, peak.handicap, answer)
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

    pub fn lines(&self, channels: f64) -> Lines<'_> {
        Lines { series: self.series, highest_hz: self.range.limit_hz, independent: channels }
    }
}
