//! The verdict where the geometry of the pass is known: stretches of the pass, on a clock that goes with the body.
//!
//! Over a pass a body is seen from other and other directions: glints come and go, and a curve of one shape for the whole pass leaves their coming and going beside the
//! harmonics, where it looks like lines of a longer period, or drowns those that are there. So the pass is taken in **stretches**, in which the bisector of Sun and observer moves by no more than
//! 30°: one period for all, with a curve of its own in each stretch.
//!
//! And what a spinning body shows at t is set by its longitude under that bisector: its phase is t/P − λ(t)/2π, with the sidereal period P and the bisector's longitude λ about the
//! spin axis ([`crate::synodic`]). λ bends, so that phases slip against those of any even period. The axis is not known, but only some axes bend the phase as the
//! curve shows it: the one is sought on whose **clock** the stretches repeat best, and the verdict is given on that clock. The axis itself is hardly known from one pass, and is no answer.

use super::range::Range;
use super::rivals::RIVAL;
use super::search::Search;
use super::{Estimate, Member, Membership, Options, Outcome, Verdict, centred, verdict_of};
use crate::period::lomb_scargle::Centred;
use crate::period::{FrequencyGrid, PeriodError, joint_gain, lomb_scargle};
use crate::series::Series;
use crate::synodic::{Bisectors, Turn};
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::PI;
use sunglint_numerics::sphere::spread;

/// The bisector's way in a stretch at most, degrees.
const STRETCH_DEG: f64 = 30.0;
/// Turns of the period in a stretch at least: as many as the questions for its double and triple need.
const STRETCH_TURNS: f64 = 8.0;
/// Axes of the first look, evenly over the sphere: 15° apart.
const AXES: usize = 184;
/// The best of them are followed up.
const FOLLOWED: usize = 4;
/// The steps of that, degrees.
const STEPS_DEG: [f64; 4] = [8.0, 4.0, 2.0, 1.0];
/// Harmonics by which clocks are compared.
const HARMONICS: usize = 8;
/// Frequencies to either side of one, in resolutions 1/span.
const BESIDE: f64 = 1.0;
/// Frequencies to a resolution of the highest harmonic.
const OVERSAMPLING: f64 = 4.0;
/// Clocks that leave no more than this of the variance beyond what the best leaves fit as well: light is no function of the bisector's longitude alone, and differences below that mean nothing.
const UNLIKE: f64 = 0.15;
/// A period that changes by more than this share is another one, for which stretches and clock are sought anew.
const SAME: f64 = 0.02;
/// A part of the period is ruled out where phase dispersion gives it no larger chance than this.
const DOUBT: f64 = 0.02;
/// How often.
const ROUNDS: usize = 4;

/// A clock that goes with a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clock {
    /// The axis, GCRS, unit; turns are right-handed about it.
    pub axis: DVec3,
    /// The period in its time, s: that of the spin less the mean turn of the bisector.
    pub synodic_s: f64,
    /// The period of the spin about that axis, s.
    pub sidereal_s: f64,
    /// Largest departure of the phase from an even one, turns.
    pub bend_turns: f64,
    /// The joint gain of eight harmonics (fewer where the sampling has no room).
    pub gain: f64,
}

/// The verdict along a pass.
#[derive(Debug, Clone, PartialEq)]
pub struct Along {
    /// Number of stretches.
    pub stretches: usize,
    /// The bisector's way in the whole, degrees.
    pub way_deg: f64,
    /// The clock.
    pub clock: Clock,
    /// The periods of the spin about all axes whose clocks fit as well, from and to, s.
    pub sidereal_s: (f64, f64),
    /// The part of the sky in which those axes lie.
    pub alike: f64,
    /// Excess of the variance that is left in even time over that on the clock, relative.
    pub even_share: f64,
    /// The series in its time, whole.
    pub series: Vec<Series>,
    /// The verdict on their stretches, its periods those in the clock's time.
    pub in_clock: Verdict,
    /// The same verdict, its periods those of the spin: the middle over all axes whose clocks fit as well; their range, as of a uniform distribution, is in the standard uncertainty. Questions and
    /// peaks are as in the clock's time.
    pub verdict: Verdict,
}

/// Data by which clocks are compared.
struct Question<'a> {
    /// The channel of each stretch that repeats best in even time: what bends the phase is the same in all.
    pieces: Vec<Series>,
    path: &'a Bisectors,
    frequency_hz: f64,
    grid: FrequencyGrid,
    harmonics: usize,
}

impl<'a> Question<'a> {
    /// `None` where the samples are too few.
    fn new(
        stretches: &[Vec<Series>],
        path: &'a Bisectors,
        frequency_hz: f64,
        limit_hz: f64,
    ) -> Result<Option<Self>, PeriodError> {
        let below = (limit_hz / frequency_hz).floor() as usize;
        let harmonics = HARMONICS.min(below);
        let span_s = stretches.iter().flatten().map(Series::span_s).fold(0.0, f64::max);
        if harmonics == 0 || span_s <= 0.0 {
            return Ok(None);
        }
        let step_hz = 1.0 / (OVERSAMPLING * harmonics as f64 * span_s);
        let beside = (BESIDE / span_s).min(0.5 * frequency_hz);
        let n = (2.0 * beside / step_hz).ceil() as usize + 1;
        let grid = FrequencyGrid { first_hz: frequency_hz - beside, step_hz, n };
        let mut question = Self { pieces: Vec::new(), path, frequency_hz, grid, harmonics };
        for stretch in stretches {
            let gains = stretch.iter().map(|s| Ok(question.gain(std::slice::from_ref(s))?.0));
            let gains: Vec<f64> = gains.collect::<Result<_, PeriodError>>()?;
            let best = (0..stretch.len()).max_by(|a, b| gains[*a].total_cmp(&gains[*b]));
            question.pieces.extend(best.map(|k| stretch[k].clone()));
        }
        Ok(Some(question))
    }

    /// The highest gain near the frequency, and where.
    fn gain(&self, series: &[Series]) -> Result<(f64, f64), PeriodError> {
        let mut joint = vec![0.0; self.grid.n];
        for s in series {
            let power = lomb_scargle(s, &self.grid, self.harmonics)?;
            let gains = power.iter().map(|p| joint_gain(*p, s.len(), self.harmonics));
            joint.iter_mut().zip(gains).for_each(|(sum, g)| *sum += g);
        }
        let best = joint.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
        Ok(best.map_or((0.0, self.frequency_hz), |(i, g)| (*g, self.grid.frequency_hz(i))))
    }

    /// Bend of the phase about an axis, the even part of that in turns per second, and the pieces on its clock.
    fn bent(&self, axis: DVec3) -> Option<(f64, Turn, Vec<Series>)> {
        let (slope_hz, bend) = self.path.turned(axis)?.split();
        let pieces = clocked(&self.pieces, &bend, self.frequency_hz)?;
        Some((slope_hz, bend, pieces))
    }

    fn clock(&self, axis: DVec3) -> Result<Option<Clock>, PeriodError> {
        let Some((slope_hz, bend, pieces)) = self.bent(axis) else { return Ok(None) };
        let (gain, synodic_hz) = self.gain(&pieces)?;
        let sidereal_hz = synodic_hz + slope_hz;
        Ok((sidereal_hz > 0.0).then(|| Clock {
            axis,
            synodic_s: 1.0 / synodic_hz,
            sidereal_s: 1.0 / sidereal_hz,
            bend_turns: bend.most(),
            gain,
        }))
    }

    /// Clocks of axes all over the sphere, and the best that is found near the best of them.
    fn best(&self) -> Result<Option<(Clock, Vec<Clock>)>, PeriodError> {
        let tried: Vec<_> = spread(AXES, 0.0)
            .into_par_iter()
            .map(|axis| self.clock(axis))
            .collect::<Result<_, _>>()?;
        let tried: Vec<Clock> = tried.into_iter().flatten().collect();
        let mut order: Vec<usize> = (0..tried.len()).collect();
        order.sort_by(|a, b| tried[*b].gain.total_cmp(&tried[*a].gain));
        order.truncate(FOLLOWED);
        let followed: Vec<Clock> = order
            .into_par_iter()
            .map(|k| self.followed(tried[k]))
            .collect::<Result<_, PeriodError>>()?;
        let best = followed.into_iter().max_by(|a, b| a.gain.total_cmp(&b.gain));
        Ok(best.map(|best| (best, tried)))
    }

    /// Uphill from a clock.
    fn followed(&self, mut clock: Clock) -> Result<Clock, PeriodError> {
        for step in STEPS_DEG {
            for _ in 0..6 {
                let east = clock.axis.any_orthonormal_vector();
                let north = clock.axis.cross(east);
                let mut best = clock;
                for k in 0..6 {
                    let (sin, cos) = (f64::from(k) * PI / 3.0).sin_cos();
                    let (up, along) = step.to_radians().sin_cos();
                    let axis = (along * clock.axis + up * (cos * east + sin * north)).normalize();
                    best = self.clock(axis)?.filter(|c| c.gain > best.gain).unwrap_or(best);
                }
                if best.gain <= clock.gain {
                    break;
                }
                clock = best;
            }
        }
        Ok(clock)
    }
}

fn clocked(series: &[Series], bend: &Turn, frequency_hz: f64) -> Option<Vec<Series>> {
    series.iter().map(|s| bend.clocked(s, frequency_hz)).collect()
}

/// A period in the time of `best` as that of the spin, over all clocks: its middle with its uncertainty, and from where to where.
fn spin(estimate: &Estimate, best: Clock, clocks: &[Clock]) -> (Estimate, (f64, f64)) {
    let of = |c: &Clock| {
        let even = best.synodic_s / c.synodic_s / estimate.period_s;
        1.0 / (even + 1.0 / c.sidereal_s - 1.0 / c.synodic_s)
    };
    let periods = || clocks.iter().map(of).filter(|p| *p > 0.0);
    let ends = (periods().fold(f64::INFINITY, f64::min), periods().fold(0.0, f64::max));
    let period_s = 0.5 * (ends.0 + ends.1);
    let by_axis = (ends.1 - ends.0) / 12.0_f64.sqrt();
    let sigma_s = (estimate.sigma_s * (period_s / estimate.period_s).powi(2)).hypot(by_axis);
    (Estimate { period_s, sigma_s }, ends)
}

/// Relative growth of the variance that is left, where the gain in twice the logarithm of the likelihood falls by `-gain`.
fn share(gain: f64, samples: f64) -> f64 {
    (-gain / samples).exp_m1()
}

/// Removes from the family the multiples of the period that stretches are too short to rule out and that the whole rules out.
fn rule_out(found: &mut Verdict, whole: &[Series], range: Range) -> Result<(), PeriodError> {
    let (Outcome::Family(members), Some(best)) = (&found.outcome, found.best) else {
        return Ok(());
    };
    let refs: Vec<&Series> = whole.iter().collect();
    let search = Search { series: &refs, range, beyond: None, centred: centred(&refs) };
    let mut left: Vec<Member> = Vec::new();
    for member in members {
        if let Membership::Multiple(n) = member.membership {
            let double = Membership::Multiple(2);
            if n == 4 && left.iter().all(|m| m.membership != double) {
                continue;
            }
            let (open, question) = search.may_be(best.period_s, n, found.independent_samples)?;
            if !open {
                found.questions.push(question);
                continue;
            }
        }
        left.push(*member);
    }
    found.outcome = if left.len() == 1 { Outcome::One(best) } else { Outcome::Family(left) };
    Ok(())
}

/// Parts of the period that only lines rule out, and phase dispersion does not, are members of the family: glints that come and go within a stretch have light in all lines.
fn doubt(found: &mut Verdict, range: Range) {
    let Some(best) = found.best else { return };
    let mut members = match &found.outcome {
        Outcome::One(_) => {
            let turns = range.span_s / best.period_s;
            vec![Member { estimate: best, membership: Membership::Best, turns }]
        }
        Outcome::Family(members) => members.clone(),
        Outcome::NotEnough(_) | Outcome::Two(..) => return,
    };
    for q in [2, 3] {
        let (by, membership) = (q as f64, Membership::Part(q));
        let is_doubtful = found.questions.iter().any(|question| {
            let is_own = (question.longer_s / best.period_s - 1.0).abs() < 1e-6
                && (question.shorter_s * by / best.period_s - 1.0).abs() < 1e-6;
            is_own && question.dispersion_chance.is_some_and(|p| p > DOUBT)
        });
        if is_doubtful && members.iter().all(|m| m.membership != membership) {
            let (period_s, sigma_s) = (best.period_s / by, best.sigma_s / by);
            let estimate = Estimate { period_s, sigma_s };
            members.push(Member { estimate, membership, turns: range.span_s * by / best.period_s });
        }
    }
    if members.len() > 1 {
        found.outcome = Outcome::Family(members);
    }
}

/// From the first to the last sample of all, s.
fn ends(series: &[Series]) -> (f64, f64) {
    let first =
        series.iter().filter_map(|s| s.time_s.first()).copied().fold(f64::INFINITY, f64::min);
    let last =
        series.iter().filter_map(|s| s.time_s.last()).copied().fold(f64::NEG_INFINITY, f64::max);
    (first, last)
}

/// All series in `n` stretches of equal length, by stretch; what is too short for the harmonics, or constant, is left out.
fn stretches(series: &[Series], n: usize) -> Vec<Vec<Series>> {
    let (first, last) = ends(series);
    let step = (last - first) / n as f64;
    let piece = |s: &Series, k: usize| {
        let before = if k + 1 == n { f64::INFINITY } else { first + (k + 1) as f64 * step };
        s.piece(format!("{} {}/{n}", s.name, k + 1), first + k as f64 * step, before)
    };
    let is_good = |s: &Series| s.len() > 4 * HARMONICS && Centred::new(s, 1).is_ok();
    let stretch = |k: usize| series.iter().map(|s| piece(s, k)).filter(is_good).collect::<Vec<_>>();
    (0..n).map(stretch).filter(|stretch| !stretch.is_empty()).collect()
}

/// The verdict along a pass, from the period that a verdict on the whole begins with. `None` where that has none, where no clock runs, or where stretches and clock leave less of an answer than the
/// whole gives.
///
/// # Errors
/// The errors of [`super::verdict()`].
pub fn verdict_along(
    series: &[Series],
    options: &Options,
    whole: &Verdict,
    path: &Bisectors,
) -> Result<Option<Along>, PeriodError> {
    let is_used = |s: &&Series| whole.left_out.iter().all(|(name, _)| *name != s.name);
    let used: Vec<Series> = series.iter().filter(is_used).cloned().collect();
    let refs: Vec<&Series> = used.iter().collect();
    let (Some(best), Some(range)) = (whole.best, Range::new(&refs, options)?) else {
        return Ok(None);
    };
    // A turn that only the unevenness of the samples shows has no harmonics that they would compare.
    if best.period_s * range.limit_hz < 1.0 {
        return Ok(None);
    }
    let (from_s, to_s) = ends(&used);
    let way_deg = path.way_deg(from_s, to_s);
    let mut frequency_hz = 1.0 / best.period_s;
    let mut answer = None;
    for _ in 0..ROUNDS {
        let room = ((to_s - from_s) * frequency_hz / STRETCH_TURNS).floor().max(1.0);
        let wanted = (way_deg / STRETCH_DEG).ceil().clamp(1.0, room) as usize;
        let stretches = stretches(&used, wanted);
        let question = Question::new(&stretches, path, frequency_hz, range.limit_hz)?;
        let Some(question) = question else { break };
        let Some((clock, tried)) = question.best()? else { break };
        let Some((_, bend, _)) = question.bent(clock.axis) else { break };
        let on_clock = |series: &[Series]| clocked(series, &bend, frequency_hz);
        let (Some(whole), Some(bent)) = (on_clock(&used), on_clock(&stretches.concat())) else {
            break;
        };
        let mut found = verdict_of(&bent, options, false)?;
        rule_out(&mut found, &whole, range)?;
        doubt(&mut found, range);
        let next = found.best.map(|b| 1.0 / b.period_s);
        let (even_gain, _) = question.gain(&question.pieces)?;
        let samples = question.pieces.iter().map(Series::len).sum::<usize>() as f64;
        let least = clock.gain - (UNLIKE * samples).max(RIVAL / found.independent_samples);
        let alike: Vec<Clock> =
            tried.iter().chain([&clock]).filter(|c| c.gain >= least).copied().collect();
        let spin = |e: &Estimate| spin(e, clock, &alike);
        let mut of_spin = found.clone();
        let ends = found.best.as_ref().map(|b| spin(b).1);
        of_spin.best = found.best.as_ref().map(|b| spin(b).0);
        match &mut of_spin.outcome {
            Outcome::One(e) => *e = spin(e).0,
            Outcome::Family(members) => {
                members.iter_mut().for_each(|m| m.estimate = spin(&m.estimate).0);
            }
            Outcome::Two(one, other) => (*one, *other) = (spin(one).0, spin(other).0),
            Outcome::NotEnough(_) => {}
        }
        answer = Some(Along {
            stretches: stretches.len(),
            way_deg,
            clock,
            sidereal_s: ends.unwrap_or((clock.sidereal_s, clock.sidereal_s)),
            alike: (alike.len() - 1) as f64 / tried.len() as f64,
            even_share: share(even_gain - clock.gain, samples),
            series: whole,
            in_clock: found,
            verdict: of_spin,
        });
        match next {
            Some(next) if (next / frequency_hz - 1.0).abs() > SAME => frequency_hz = next,
            _ => break,
        }
    }
    // Glints that come and go along a pass may look like a second period.
    let is_answer = |v: &Verdict| matches!(v.outcome, Outcome::One(_) | Outcome::Family(_));
    Ok(answer.filter(|a| is_answer(&a.verdict) || !is_answer(whole)))
}
