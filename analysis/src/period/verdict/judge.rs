//! Second questions to a candidate period: its double and triple, its half and third, other peaks.

use super::super::flashes::explains_both;
use super::super::lines::{Lines, harmonics as most_harmonics, residual};
use super::super::pdm::{Dispersion, dispersion_test};
use super::super::significance::false_alarm;
use super::super::stats::fisher;
use super::super::{PeriodError, pdm};
use super::outcome::{Estimate, Member, Membership, Outcome, Question, Reason, Verdict};
use super::search::{Gains, Search};
use super::two::Pair;
use crate::series::Series;

/// Fewer turns than that show no repetition.
const LEAST_TURNS: f64 = 3.0;
/// A chance below this is a yes, above the next a no, between them neither.
const YES: f64 = 1e-4;
const NO: f64 = 0.02;
/// Turns that may differ by more than this share of their light are not known to be alike: the body may have like sides.
pub(super) const ALIKE: f64 = 0.1;
/// The same of thirds of a turn: bodies of three like sides are rarer, and have to be more alike to be taken for one.
pub(super) const ALIKE_RARE: f64 = 0.5;

/// Whether a multiple is neither there nor ruled out.
fn is_open(question: &Question, n: usize) -> bool {
    let alike = if n == 3 { ALIKE_RARE } else { ALIKE };
    question.chance.is_none_or(|p| p < NO)
        || question.unlike.is_none_or(|u| u > alike)
        || question.dispersion_chance.is_some_and(|p| p < YES)
}

impl Search<'_> {
    /// The shares of channels and of samples that say something of their own, from what the harmonics leave.
    pub fn independence(&self, frequency_hz: f64) -> (f64, f64) {
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

    /// Whether that many times a period may be the period for all that these series say.
    pub fn may_be(
        &self,
        period_s: f64,
        n: usize,
        samples: f64,
    ) -> Result<(bool, Question), PeriodError> {
        let base = 1.0 / period_s;
        let (channels, _) = self.independence(base);
        let lines = self.lines(channels);
        let question = self.multiple(&lines, base, n, (self.order(base), samples))?;
        Ok((is_open(&question, n), question))
    }

    pub fn estimate(&self, frequency_hz: f64, harmonics: usize, independent: f64) -> Estimate {
        // A tenth of a resolution of the highest harmonic: the top of the peak is a parabola there.
        let h = 0.1 / (harmonics as f64 * self.range.span_s);
        let at = |f: f64| self.gain(f, harmonics);
        let curvature =
            (2.0 * at(frequency_hz) - at(frequency_hz - h) - at(frequency_hz + h)) / (h * h);
        let sigma_hz = (2.0 / (curvature * independent)).sqrt();
        let period_s = 1.0 / frequency_hz;
        Estimate { period_s, sigma_s: period_s * period_s * sigma_hz }
    }

    pub fn judge(
        &self,
        base: f64,
        curves: &[Gains],
        handicap: f64,
        answer: &mut Verdict,
    ) -> Result<(), PeriodError> {
        let (channels, samples) = self.independence(base);
        let independent = channels * samples;
        let lines = self.lines(channels);
        let harmonics = self.order(base);
        let mut best = self.estimate(base, harmonics, independent);
        let turns = self.range.span_s * base;
        let gain = self.gain(base, harmonics);
        let alarm = false_alarm(gain, self.series, harmonics, self.range.counted_hz, independent)?;
        let beside = lines.chance_of_noise(base);
        answer.best = Some(best);
        answer.harmonics = harmonics;
        answer.false_alarm = Some(alarm);
        answer.beside = beside;
        answer.independent_channels = channels * self.series.len() as f64;
        answer.independent_samples = samples;
        answer.window_peaks = self.window_peaks()?;
        let change = self.change(base, harmonics, independent);
        let peaks = &answer.window_peaks;
        let pair = self.two_periods(base, harmonics, &change.apart, peaks, independent);
        let pair = pair.or_else(|| change.running_away()).filter(|pair| {
            let (Pair::Two(a, b) | Pair::Either(a, b)) = *pair;
            let series: Vec<Series> = self.series.iter().map(|s| (*s).clone()).collect();
            !explains_both(&series, [a, b])
        });
        if let Some(Pair::Two(first, second)) = pair {
            answer.outcome = Outcome::Two(first, second);
            return Ok(());
        }
        answer.drift_turns = change.drift_turns;
        best.sigma_s = best.sigma_s.hypot(change.drift_turns * best.period_s / turns);
        answer.best = Some(best);
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
        for n in [2, 3, 4] {
            // Four like sides have the double of the double: where that is open itself, and would be seen to repeat.
            let double = Membership::Multiple(2);
            let is_asked = n != 4
                || turns >= 4.0 * LEAST_TURNS && members.iter().any(|m| m.membership == double);
            if !is_asked {
                continue;
            }
            let question = self.multiple(&lines, base, n, (harmonics, samples))?;
            if is_open(&question, n) {
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
        if let Some(Pair::Either(first, second)) = pair {
            for estimate in [first, second] {
                let turns = self.range.span_s / estimate.period_s;
                members.push(Member { estimate, membership: Membership::Second, turns });
            }
        }
        for f in self.rivals(base, curves, handicap, independent) {
            let estimate = self.estimate(f, self.order(f), independent);
            let turns = self.range.span_s * f;
            members.push(Member { estimate, membership: Membership::Alias, turns });
        }
        if let Some((folding, folded)) =
            self.folded(base, harmonics, independent, &answer.window_peaks)
        {
            for (n, f) in folded {
                let estimate =
                    Estimate { period_s: 1.0 / f, sigma_s: best.sigma_s * (base / f).powi(2) };
                let turns = self.range.span_s * f;
                members.push(Member { estimate, membership: Membership::Folded(n), turns });
            }
            answer.folding = Some(folding);
        }
        answer.outcome =
            if members.len() == 1 { Outcome::One(best) } else { Outcome::Family(members) };
        Ok(())
    }

    /// Whether that many times the best period explains more than it; of four times, more than twice.
    fn multiple(
        &self,
        lines: &Lines,
        base: f64,
        n: usize,
        (order, samples): (usize, f64),
    ) -> Result<Question, PeriodError> {
        match n {
            4 => self.question(lines, 0.5 * base, 2, (2 * order, samples)),
            n => self.question(lines, base, n, (order, samples)),
        }
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
}
