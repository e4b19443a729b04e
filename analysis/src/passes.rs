//! Spin of a near body over several passes: each pass measured by itself, then joined by the way of the bisector of Sun and observer.
//!
//! The light that is seen of a body that spins at f (turns per second of a frame that does not turn) has the phase φ = f t + ḟ t²/2 − λ(t), with the longitude λ (in turns) of the bisector of Sun and
//! observer about the spin axis ([`crate::synodic`]). In a pass λ bends, so that the synodic period slides. So of each pass the phase's slope, bend and twist are measured, with their covariance:
//! harmonics are fitted together with a phase that is a cubic of time, by Gauss-Newton. Over all passes these are f + ḟ τ − λ′, (ḟ − λ″)/2 and −λ‴/6, which is linear in f and ḟ for each axis of the spin. Axes over the whole
//! sphere are tried; an axis and its opposite are the two senses. Intervals are those of the profile likelihood over all axes (95 %: 3.84 above the best), widened by the scatter that the best axis leaves.
//!
//! Turns between the passes are **not counted**: a drift of 1e-3 of the period a day slips by many turns from one pass to the next.

use crate::period::PeriodError;
use crate::period::verdict::{Membership, Options, Outcome, verdict};
use crate::series::Series;
use crate::synodic::{Bisectors, Turn};
use glam::DVec3;
use nalgebra::{Cholesky, DMatrix, DVector, Matrix2, Matrix3, Vector2, Vector3};
use serde::Serialize;
use std::f64::consts::TAU;
use sunglint_numerics::measured::Interval;
use sunglint_numerics::order::median;
use sunglint_numerics::sphere::spread;

/// Periods of two passes that differ by less may be one: drift and the bisector's motion part them by a few per cent.
const SAME: f64 = 0.04;
/// Share of the passes that have to agree on a period.
const AGREE: f64 = 0.7;
/// Most periods of a family.
const MOST_MEMBERS: usize = 4;
/// Harmonics of a pass.
const HARMONICS: usize = 5;
/// Bend of the phase at the ends of a pass that is tried at first, turns.
const BENDS: [f64; 9] = [0.0, 0.03, -0.03, 0.06, -0.06, 0.1, -0.1, 0.15, -0.15];
/// Rounds of Gauss and Newton.
const ROUNDS: usize = 12;
/// Axes that are tried: 4° apart.
const AXES: usize = 2500;
/// Drift of the period that is expected, a day.
const DRIFT_PER_DAY: f64 = 1e-3;
const DAY_S: f64 = 86_400.0;
/// Quantiles of χ² at 95 % of one degree of freedom, and of the two of a direction.
const ONE_95: f64 = 3.841;
const TWO_95: f64 = 5.991;

/// A pass: what was measured in it, and how it was seen.
#[derive(Debug, Clone, PartialEq)]
pub struct Pass {
    /// Channels of the pass, on the clock of all passes.
    pub series: Vec<Series>,
    /// Way of the bisector of Sun and observer; `None` where it is not known.
    pub path: Option<Bisectors>,
}

/// Period as a pass shows it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PassPeriod {
    /// Middle of the pass, s.
    pub middle_s: f64,
    /// Synodic period at the middle, s.
    pub synodic_s: f64,
    /// Standard uncertainty, s.
    pub sigma_s: f64,
}

/// Kind of a period.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Apparent period, against the bisector of Sun and observer.
    Synodic,
    /// The spin's own period, against the stars.
    Sidereal,
}

/// Sense of the spin about the Earth's axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Sense {
    /// The spin axis points north of the equator.
    Prograde,
    /// The spin axis points south of it.
    Retrograde,
}

/// A period that the passes leave possible.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SpinPeriod {
    /// Period at the middle of all passes, s.
    pub period_s: f64,
    /// Interval that holds it in 95 %, s.
    pub interval_s: Interval,
    /// Drift of the period, s per s.
    pub drift: f64,
    /// Interval that holds the drift in 95 %.
    pub drift_interval: Interval,
    /// Sense of the spin; `None` where both fit, or without geometry.
    pub sense: Option<Sense>,
    /// Axis of the spin that fits best (right-handed, GCRS); `None` without geometry.
    pub axis: Option<[f64; 3]>,
    /// Share of the sky in which axes fit as well.
    pub sky_share: Option<f64>,
    /// Scatter of the passes about the best, in their uncertainties.
    pub scatter: f64,
    /// Passes in which this period was measured.
    pub passes: Vec<PassPeriod>,
}

/// The spin over several passes.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Spin {
    /// Kind of the periods.
    pub kind: Kind,
    /// Periods that are possible, the likeliest first; one is a single answer, none is no answer.
    pub periods: Vec<SpinPeriod>,
    /// Why there is no answer, in words.
    pub reason: Option<String>,
    /// Moment at which the periods hold, s.
    pub middle_s: f64,
    /// Passes that were given, and those that gave a period alone.
    pub passes: usize,
    /// Passes that gave a period alone.
    pub answered: usize,
}

/// Phase of a pass about its middle: slope (Hz), half the bend (Hz/s), a sixth of the twist (Hz/s²), with what they know.
#[derive(Debug, Clone)]
struct Measured {
    middle_s: f64,
    /// In units of turns at the end of the pass.
    turns: Vector3<f64>,
    information: Matrix3<f64>,
    half_s: f64,
}

/// Sum of squares, harmonics and the rest that a phase leaves.
struct Solved {
    chi2: f64,
    left: DVector<f64>,
    design: DMatrix<f64>,
}

/// Fits harmonics, a mean and a trend on a phase, with the derivatives of the phase as further columns where `full`.
fn solved(series: &Series, u: &[f64], turns: &[f64], harmonics: usize) -> Option<Solved> {
    let columns = 2 * harmonics + 2;
    let n = u.len();
    if n <= columns + 4 {
        return None;
    }
    let mut design = DMatrix::<f64>::zeros(n, columns);
    let mut values = DVector::<f64>::zeros(n);
    let mean = series.mean();
    for i in 0..n {
        let root = series.weight[i].sqrt();
        let (sin, cos) = (TAU * turns[i]).sin_cos();
        let (mut c, mut s) = (1.0, 0.0);
        design[(i, 0)] = root;
        design[(i, 1)] = root * u[i];
        for k in 0..harmonics {
            (c, s) = (c * cos - s * sin, c * sin + s * cos);
            design[(i, 2 + 2 * k)] = root * c;
            design[(i, 3 + 2 * k)] = root * s;
        }
        values[i] = root * (series.value[i] - mean);
    }
    let mut normal = design.transpose() * &design;
    let ridge = 1e-10 * normal.diagonal().max();
    for k in 0..columns {
        normal[(k, k)] += ridge;
    }
    let solution = Cholesky::new(normal)?.solve(&(design.transpose() * &values));
    let left = &values - &design * &solution;
    // The model's derivative by the phase, per turn.
    let mut slopes = DMatrix::<f64>::zeros(n, columns + 3);
    slopes.view_mut((0, 0), (n, columns)).copy_from(&design);
    for i in 0..n {
        let mut slope = 0.0;
        for k in 0..harmonics {
            let order = TAU * (k + 1) as f64;
            slope += order
                * (solution[3 + 2 * k] * design[(i, 2 + 2 * k)]
                    - solution[2 + 2 * k] * design[(i, 3 + 2 * k)]);
        }
        for (j, power) in [u[i], u[i] * u[i], u[i].powi(3)].into_iter().enumerate() {
            slopes[(i, columns + j)] = slope * power;
        }
    }
    Some(Solved { chi2: left.norm_squared(), left, design: slopes })
}

/// Measures the phase of one channel of a pass near a frequency.
fn measured(series: &Series, frequency_hz: f64) -> Option<Measured> {
    let (first, half_s) = (*series.time_s.first()?, 0.5 * series.span_s());
    if half_s <= 0.0 {
        return None;
    }
    let middle_s = first + half_s;
    let u: Vec<f64> = series.time_s.iter().map(|t| (t - middle_s) / half_s).collect();
    let steps = median(series.time_s.windows(2).map(|t| t[1] - t[0]).filter(|s| *s > 0.0))?;
    let harmonics = HARMONICS.min((0.5 / (frequency_hz * steps)).floor() as usize).max(1);
    let phase = |a: &Vector3<f64>| -> Vec<f64> {
        u.iter().map(|u| u * (a[0] + u * (a[1] + u * a[2]))).collect()
    };
    let start = frequency_hz * half_s;
    let mut best: Option<(f64, Vector3<f64>)> = None;
    for bend in BENDS {
        for k in -6..=6 {
            // A quarter of a turn over the pass between two.
            let a = Vector3::new(start + 0.125 * f64::from(k), bend, 0.0);
            let chi2 = solved(series, &u, &phase(&a), harmonics)?.chi2;
            if best.is_none_or(|(c, _)| chi2 < c) {
                best = Some((chi2, a));
            }
        }
    }
    let (mut chi2, mut a) = best?;
    for _ in 0..ROUNDS {
        let now = solved(series, &u, &phase(&a), harmonics)?;
        let columns = now.design.ncols();
        let mut normal = now.design.transpose() * &now.design;
        let ridge = 1e-10 * normal.diagonal().max();
        for k in 0..columns {
            normal[(k, k)] += ridge;
        }
        let step = Cholesky::new(normal)?.solve(&(now.design.transpose() * &now.left));
        let step = Vector3::new(step[columns - 3], step[columns - 2], step[columns - 1]);
        let mut part = 1.0;
        let mut moved = false;
        while part > 0.05 {
            let next = a + part * step;
            let there = solved(series, &u, &phase(&next), harmonics)?.chi2;
            if there < chi2 {
                moved = chi2 - there > 1e-9 * chi2;
                (chi2, a) = (there, next);
                break;
            }
            part *= 0.5;
        }
        if !moved {
            break;
        }
    }
    let last = solved(series, &u, &phase(&a), harmonics)?;
    let columns = last.design.ncols();
    let free = (series.len() as f64 - columns as f64).max(1.0);
    let left: Vec<f64> = last.left.iter().copied().collect();
    let square: f64 = left.iter().map(|r| r * r).sum();
    let next: f64 = left.windows(2).map(|r| r[0] * r[1]).sum();
    let rho = if square > 0.0 { (next / square).clamp(0.0, 0.98) } else { 0.0 };
    let mut normal = last.design.transpose() * &last.design;
    let ridge = 1e-10 * normal.diagonal().max();
    for k in 0..columns {
        normal[(k, k)] += ridge;
    }
    let covariance = Cholesky::new(normal)?.inverse() * (square / free * (1.0 + rho) / (1.0 - rho));
    let own = covariance.fixed_view::<3, 3>(columns - 3, columns - 3).into_owned();
    let information = own.try_inverse()?;
    // A phase that the light does not hold says nothing.
    let holds = own[(0, 0)].sqrt() < 0.1 && a[1].abs() < 0.5 && a[2].abs() < 0.5;
    holds.then_some(Measured { middle_s, turns: a, information, half_s })
}

/// Slope, bend and twist of a longitude about a moment, turns at the end of the pass: a cubic by least squares.
fn cubic(turn: &Turn, middle_s: f64, half_s: f64) -> Option<Vector3<f64>> {
    const POINTS: i32 = 24;
    let mut normal = DMatrix::<f64>::zeros(4, 4);
    let mut right = DVector::<f64>::zeros(4);
    for k in 0..=POINTS {
        let u = 2.0 * f64::from(k) / f64::from(POINTS) - 1.0;
        let row = DVector::from_column_slice(&[1.0, u, u * u, u * u * u]);
        normal += &row * row.transpose();
        right += turn.at(middle_s + u * half_s) * row;
    }
    let x = Cholesky::new(normal)?.solve(&right);
    Some(Vector3::new(x[1], x[2], x[3]))
}

/// Frequency and drift of all passes for what the bisector does in each.
struct Joint {
    statistic: f64,
    /// Frequency (Hz) at the middle and its drift (Hz/s).
    value: Vector2<f64>,
    covariance: Matrix2<f64>,
}

fn joint(
    measured: &[Measured],
    moved: &[Vector3<f64>],
    middle_s: f64,
    about_hz: f64,
) -> Option<Joint> {
    let mut normal = Matrix2::<f64>::zeros();
    let mut right = Vector2::<f64>::zeros();
    let mut total = 0.0;
    // The drift is expected to be no more than so much; in units of Hz/day, so that both columns are alike.
    let prior = 1.0 / (DRIFT_PER_DAY * about_hz).powi(2);
    normal[(1, 1)] += prior;
    for (m, l) in measured.iter().zip(moved) {
        let days = (m.middle_s - middle_s) / DAY_S;
        let y = m.turns + l - Vector3::new(about_hz * m.half_s, 0.0, 0.0);
        // Columns: a change of frequency by 1 Hz, a drift by 1 Hz a day.
        let bend = 0.5 * m.half_s * m.half_s / DAY_S;
        let x = nalgebra::Matrix3x2::new(m.half_s, days * m.half_s, 0.0, bend, 0.0, 0.0);
        let weighted = x.transpose() * m.information;
        normal += weighted * x;
        right += weighted * y;
        total += (y.transpose() * m.information * y)[0];
    }
    let covariance = normal.try_inverse()?;
    let value = covariance * right;
    let statistic = total - right.dot(&value);
    let scale = nalgebra::Matrix2::new(1.0, 0.0, 0.0, 1.0 / DAY_S);
    Some(Joint {
        statistic,
        value: Vector2::new(about_hz + value[0], value[1] / DAY_S),
        covariance: scale * covariance * scale,
    })
}

/// One period over the passes in which it was measured.
fn over(passes: &[(&Pass, Measured)], middle_s: f64, kind: Kind) -> Option<SpinPeriod> {
    let measured: Vec<Measured> = passes.iter().map(|p| p.1.clone()).collect();
    let about_hz = median(measured.iter().map(|m| m.turns[0] / m.half_s))?;
    let axes: Vec<Option<DVec3>> = match kind {
        Kind::Sidereal => spread(AXES, 0.0).into_iter().map(Some).collect(),
        Kind::Synodic => vec![None],
    };
    let mut found: Vec<(Option<DVec3>, Joint)> = Vec::new();
    for axis in axes {
        let moved: Option<Vec<Vector3<f64>>> = passes
            .iter()
            .map(|(pass, m)| match (axis, &pass.path) {
                (Some(axis), Some(path)) => cubic(&path.turned(axis)?, m.middle_s, m.half_s),
                // Without the geometry slope and bend are those that are seen.
                _ => Some(Vector3::zeros()),
            })
            .collect();
        let Some(moved) = moved else { continue };
        found.extend(joint(&measured, &moved, middle_s, about_hz).map(|j| (axis, j)));
    }
    let best = found.iter().min_by(|a, b| a.1.statistic.total_cmp(&b.1.statistic))?;
    let least = best.1.statistic;
    let unknowns = if kind == Kind::Sidereal { 4.0 } else { 2.0 };
    let free = (3.0 * measured.len() as f64 - unknowns).max(1.0);
    let scale = (least / free).max(1.0);
    let (mut f, mut d) = ((best.1.value[0], best.1.value[0]), (best.1.value[1], best.1.value[1]));
    for (_, j) in &found {
        let room = ONE_95 - (j.statistic - least) / scale;
        if room < 0.0 {
            continue;
        }
        let half = |k: usize| (room * scale * j.covariance[(k, k)]).sqrt();
        f = (f.0.min(j.value[0] - half(0)), f.1.max(j.value[0] + half(0)));
        d = (d.0.min(j.value[1] - half(1)), d.1.max(j.value[1] + half(1)));
    }
    let alike: Vec<DVec3> = found
        .iter()
        .filter(|(_, j)| j.statistic - least <= TWO_95 * scale)
        .filter_map(|(axis, _)| *axis)
        .collect();
    let sense = match kind {
        Kind::Sidereal if alike.iter().all(|a| a.z > 0.0) => Some(Sense::Prograde),
        Kind::Sidereal if alike.iter().all(|a| a.z < 0.0) => Some(Sense::Retrograde),
        _ => None,
    };
    if f.0 <= 0.0 {
        return None;
    }
    let period_s = 1.0 / best.1.value[0];
    let drift = |rate: f64| -rate * period_s * period_s;
    Some(SpinPeriod {
        period_s,
        interval_s: Interval::new(1.0 / f.1, 1.0 / f.0),
        drift: drift(best.1.value[1]),
        drift_interval: Interval::new(drift(d.1), drift(d.0)),
        sense,
        axis: best.0.map(|a| a.to_array()),
        sky_share: best.0.map(|_| alike.len() as f64 / found.len() as f64),
        scatter: (least / free).sqrt(),
        passes: measured
            .iter()
            .map(|m| {
                let synodic_s = m.half_s / m.turns[0];
                let sigma = m.information.try_inverse().map_or(f64::NAN, |c| c[(0, 0)].sqrt());
                PassPeriod {
                    middle_s: m.middle_s,
                    synodic_s,
                    sigma_s: synodic_s * sigma / m.turns[0],
                }
            })
            .collect(),
    })
}

/// Looks for the spin of a near body over several passes. Where all passes have their geometry the answer is sidereal, else synodic.
///
/// # Errors
/// The errors of [`verdict()`].
pub fn spin_over_passes(passes: &[Pass], options: &Options) -> Result<Spin, PeriodError> {
    let all = || passes.iter().flat_map(|p| &p.series).flat_map(|s| s.time_s.iter().copied());
    let (first, last) =
        all().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| (a.min(t), b.max(t)));
    let middle_s = if first <= last { 0.5 * (first + last) } else { 0.0 };
    let kind = match passes.iter().all(|p| p.path.is_some()) && !passes.is_empty() {
        true => Kind::Sidereal,
        false => Kind::Synodic,
    };
    let mut spin = Spin {
        kind,
        periods: Vec::new(),
        reason: None,
        middle_s,
        passes: passes.len(),
        answered: 0,
    };
    // Each pass alone: periods that it leaves possible, and whether that is its best.
    let mut alone: Vec<Vec<(f64, bool)>> = Vec::new();
    for pass in passes {
        let found = verdict(&pass.series, options)?;
        alone.push(match &found.outcome {
            Outcome::One(e) => vec![(e.period_s, true)],
            Outcome::Family(members) => members
                .iter()
                .map(|m| (m.estimate.period_s, m.membership == Membership::Best))
                .collect(),
            Outcome::NotEnough(_) => Vec::new(),
        });
    }
    spin.answered = alone.iter().filter(|a| !a.is_empty()).count();
    if spin.answered < 2 {
        spin.reason = Some(format!(
            "{} of {} passes have a period of their own, at least 2 are needed",
            spin.answered, spin.passes
        ));
        return Ok(spin);
    }
    let near = |a: f64, b: f64| (a / b - 1.0).abs() <= SAME;
    let mut candidates: Vec<f64> = alone.iter().flatten().map(|m| m.0).collect();
    candidates.sort_by(f64::total_cmp);
    let votes = |p: f64| alone.iter().filter(|a| a.iter().any(|m| near(m.0, p))).count();
    let bests = |p: f64| alone.iter().filter(|a| a.iter().any(|m| m.1 && near(m.0, p))).count();
    let wanted = (AGREE * spin.answered as f64).ceil().max(2.0) as usize;
    let mut ranked: Vec<(usize, usize, f64)> =
        candidates.iter().map(|p| (votes(*p), bests(*p), *p)).filter(|c| c.0 >= wanted).collect();
    ranked.sort_by(|a, b| (b.1, b.0).cmp(&(a.1, a.0)).then(a.2.total_cmp(&b.2)));
    let mut periods: Vec<f64> = Vec::new();
    for (_, _, p) in ranked {
        if periods.iter().all(|q| !(p / q - 1.0).abs().lt(&(2.0 * SAME))) {
            periods.push(p);
        }
    }
    if periods.is_empty() {
        spin.reason =
            Some(format!("the {} passes with a period do not agree on one", spin.answered));
        return Ok(spin);
    }
    periods.truncate(MOST_MEMBERS);
    for p in periods {
        let of_pass = |pass: &'_ Pass, own: &[(f64, bool)]| {
            let start = own.iter().map(|m| m.0).find(|m| near(*m, p))?;
            // The channel that knows the phase best.
            pass.series
                .iter()
                .filter_map(|s| measured(s, 1.0 / start))
                .max_by(|a, b| a.information[(0, 0)].total_cmp(&b.information[(0, 0)]))
        };
        let used: Vec<(&Pass, Measured)> = passes
            .iter()
            .zip(&alone)
            .filter_map(|(pass, own)| Some((pass, of_pass(pass, own)?)))
            .collect();
        if used.len() >= 2 {
            spin.periods.extend(over(&used, middle_s, kind));
        }
    }
    if spin.periods.is_empty() {
        spin.reason = Some("no pass holds the phase of a period well enough".into());
    }
    Ok(spin)
}
