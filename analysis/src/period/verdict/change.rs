//! Light that changes along the data: whether all of it turns alike.
//!
//! A period counts turns by the light of each. Where glints wander over the body, the light of the last turn is not that of the first, and the phase drifts with it: a drift at a constant rate is in the period itself, and no scatter shows it. What shows it is that the rest
//! of the light does not go along. So the light of each part of a turn is asked whether it grows, or goes ahead: amplitudes that only grow or fall leave all parts in step, and the period as it is known. Of light that comes and goes no part is there from the first sample to the last; then a drift is presumed.
//!
//! Harmonics are asked the same for frequencies of their own: where two of them run away from one another at the same amplitudes along the data, there may be two periods.

use super::super::lines::{Drifting, drifting};
use super::super::lomb_scargle::centred_times;
use super::super::stats::chi2_survival;
use super::super::sums::turns;
use super::outcome::Estimate;
use super::search::Search;
use super::two::{COMMON, Pair, multiples_apart};
use crate::series::Series;
use nalgebra::{Matrix4, Vector4};
use std::f64::consts::{PI, TAU};

/// The linear changes out of phase are more than those in phase by this factor (of squares) where harmonics run away from one another and keep their amplitudes: of light that changes anyhow, both are as large.
const OUT_OF_PHASE: f64 = 4.0;
/// Degree of the polynomials by which amplitudes change.
const DEGREE: usize = 2;
/// Harmonics are out of step where noise makes them so with less than this probability.
const CHANCE: f64 = 1e-3;
/// Harmonics that are asked for their own frequencies stand out by this many standard deviations of their amplitudes, so that their phases are known.
const STANDS_OUT: f64 = 5.0;
/// Parts of a turn, each half a turn long, that are asked whether they go ahead; and phases of a turn at which they are.
const PARTS: usize = 8;
const PHASES: usize = 96;
/// A part goes ahead of the others if it does so by this many standard deviations.
const AHEAD: f64 = 4.0;

/// Share of the amplitude (root mean square) by which light changes along the data from which on it comes and goes, as a glint does that is seen for a part of a pass.
const COMES_AND_GOES: f64 = 0.35;
/// Turns over the data by which the phase of such light drifts, as one standard deviation, 1/2π: a change by all of the amplitude that is out of phase is one radian, and the part of it that moves all phases alike is not seen beside the period. So far the bisector of Sun and observer moves in a pass. Less for light that changes by less than ALTOGETHER.
const DRIFT: f64 = 0.5 / PI;
const ALTOGETHER: f64 = 0.5;

/// A harmonic's own frequency.
#[derive(Clone, Copy)]
struct Own {
    /// Turns of the base over the data by which it goes ahead, and the standard uncertainty.
    ahead: f64,
    sigma: f64,
    /// Root of its light.
    amplitude: f64,
    estimate: Estimate,
}

/// Changes of the light along the data.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Change {
    /// Drift of the phase over the data that parts of a turn show which are out of step, and that of light that comes and goes, turns, as one standard deviation; 0 where all are in step and stay.
    pub drift_turns: f64,
    /// Periods of the two harmonics that are out of step, where some are.
    pub apart: Vec<Estimate>,
    /// Whether these run away from one another with the same amplitudes along the data, as two periods at once do.
    pub runs_away: bool,
}

/// A part of a turn: by how much it goes ahead, in units that all series share, and the sum of the inverse variances.
#[derive(Clone, Copy, Default)]
struct Part {
    weighted: f64,
    weight: f64,
}

impl Change {
    /// The two that run away from one another.
    pub fn running_away(&self) -> Option<Pair> {
        match self.apart.as_slice() {
            [a, b] if self.runs_away => Some(Pair::Either(*a, *b)),
            _ => None,
        }
    }
}

/// Middle of a part, rad.
fn middle(part: usize) -> f64 {
    TAU * part as f64 / PARTS as f64
}

/// Weight of a phase, rad, in a part.
fn window(phase: f64, part: usize) -> f64 {
    (phase - middle(part)).cos().max(0.0).powi(2)
}

/// The rest that a model leaves of a series in the parts of a turn, weighted and squared, in units of the mean over all.
fn left_by_part(series: &Series, model: &Drifting, base: f64) -> [f64; PARTS] {
    let mut sums = [[0.0; 2]; PARTS];
    let mut all = 0.0;
    for ((t, left), w) in centred_times(series).iter().zip(&model.left).zip(&series.weight) {
        let square = w * left * left;
        all += square;
        for (part, [sum, number]) in sums.iter_mut().enumerate() {
            let by = window(TAU * turns(base, *t), part);
            *sum += by * square;
            *number += by;
        }
    }
    sums.map(
        |[sum, number]| {
            if all * number > 0.0 { sum / number / all * series.len() as f64 } else { 1.0 }
        },
    )
}

/// Adds what a model with drifting amplitudes says about the parts of a turn: the change of the light with time, B(φ), is taken to be (g + d sin φ) A(φ) + h A′(φ) + c there, with the light A(φ) and phases from the part's middle. `variance` is that of the coefficients of the linear change, by part, `by` the turns that a radian from the middle to the end makes.
fn add_parts(
    parts: &mut [Part; PARTS],
    model: &Drifting,
    harmonics: usize,
    variance: [f64; PARTS],
    by: f64,
) {
    let phase = |p: usize| TAU * p as f64 / PHASES as f64;
    let terms = |p: usize| (1..=harmonics).map(move |k| (k, (k as f64 * phase(p)).sin_cos()));
    let (mut light, mut ahead, mut change) = ([0.0; PHASES], [0.0; PHASES], [0.0; PHASES]);
    for p in 0..PHASES {
        for (k, (sin, cos)) in terms(p) {
            let [a, b, c] = [0, 1, 2].map(|power| model.amplitude(k, power));
            let level = [a[0] + c[0] / 3.0, a[1] + c[1] / 3.0];
            light[p] += level[0] * cos + level[1] * sin;
            ahead[p] += k as f64 * (level[1] * cos - level[0] * sin);
            change[p] += b[0] * cos + b[1] * sin;
        }
    }
    let size = (light.iter().map(|l| l * l).sum::<f64>() / PHASES as f64).sqrt();
    for (j, part) in parts.iter_mut().enumerate() {
        let window = |p: usize| window(phase(p), j);
        let column = |p: usize| {
            let off = (phase(p) - middle(j)).sin();
            Vector4::new(ahead[p], size, light[p], off * light[p])
        };
        let mut normal = Matrix4::zeros();
        for p in 0..PHASES {
            normal += window(p) * column(p) * column(p).transpose();
        }
        let ridge = 1e-9 * normal.trace();
        let Some(inverse) = (normal + ridge * Matrix4::identity()).try_inverse() else { continue };
        let weights: Vec<f64> =
            (0..PHASES).map(|p| window(p) * (inverse.row(0) * column(p))[0]).collect();
        let slope: f64 = weights.iter().zip(&change).map(|(w, b)| w * b).sum();
        let mut sums = vec![[0.0; 2]; harmonics];
        for (p, w) in weights.iter().enumerate() {
            for (k, (sin, cos)) in terms(p) {
                sums[k - 1][0] += w * cos;
                sums[k - 1][1] += w * sin;
            }
        }
        let square: f64 = sums.iter().map(|[c, s]| c * c + s * s).sum();
        let weight = 1.0 / (variance[j] * square * by * by);
        if weight.is_finite() {
            part.weighted += slope * by * weight;
            part.weight += weight;
        }
    }
}

/// Returns the turns over the data by which a part of a turn is ahead of all or behind, where one is so by more than noise.
fn drift(parts: &[Part]) -> f64 {
    let known: Vec<Part> = parts.iter().filter(|p| p.weight > 0.0).copied().collect();
    let total: f64 = known.iter().map(|p| p.weight).sum();
    let mean = known.iter().map(|p| p.weighted).sum::<f64>() / total.max(f64::MIN_POSITIVE);
    let off = known.iter().map(|p| ((p.weighted / p.weight - mean).abs(), p.weight.sqrt()));
    off.filter(|(off, root)| off * root > AHEAD).map(|(off, _)| off).fold(0.0, f64::max)
}

impl Search<'_> {
    /// Changes of the light of `harmonics` of a base; `independent` is as how many samples one counts.
    pub fn change(&self, base: f64, harmonics: usize, independent: f64) -> Change {
        let mut own = Vec::new();
        let (mut in_phase, mut out_of_phase) = (0.0, 0.0);
        let (mut changing, mut steady) = (0.0, 0.0);
        let mut parts = [Part::default(); PARTS];
        for s in self.series {
            let Some(model) = drifting(s, base, harmonics, DEGREE) else { continue };
            let n = s.len() as f64;
            let unknowns = Drifting::unknowns(harmonics, DEGREE) as f64 + 1.0;
            let left: f64 = model.left.iter().zip(&s.weight).map(|(r, w)| w * r * r).sum();
            // Variance of the cosine's or the sine's amplitude of steady light.
            let noise = 2.0 * left / (n - unknowns) / (n * independent);
            if noise.is_nan() || noise <= 0.0 {
                continue;
            }
            let by = self.range.span_s / s.span_s();
            // The square of a time from −1 to 1 has a mean of a third.
            let variance = left_by_part(s, &model, base).map(|left| 3.0 * noise * left);
            add_parts(&mut parts, &model, harmonics, variance, by / PI);
            for k in 1..=harmonics {
                let [a, b, c] = [0, 1, 2].map(|power| model.amplitude(k, power));
                // Legendre's polynomials are independent of one another on even times: u² is 1/3 + 2/3 P₂.
                let level = [a[0] + c[0] / 3.0, a[1] + c[1] / 3.0];
                let square = level[0] * level[0] + level[1] * level[1];
                // The squares of u and P₂ have means of 1/3 and 1/5; noise makes four times its variance of it.
                let change =
                    (b[0] * b[0] + b[1] * b[1]) / 3.0 + (c[0] * c[0] + c[1] * c[1]) * 4.0 / 45.0;
                (changing, steady) = (changing + change - 4.0 * noise, steady + square);
                if square <= STANDS_OUT * STANDS_OUT * noise {
                    continue;
                }
                // The phase runs by this many radians from the middle to the end: the light is Re (a − ib) e^{iφ}.
                let slope = (level[1] * b[0] - level[0] * b[1]) / square;
                let grows = (level[0] * b[0] + level[1] * b[1]) / square;
                in_phase += grows * grows * square;
                out_of_phase += slope * slope * square;
                let sigma = (3.0 * noise / square).sqrt();
                let hz = k as f64 * base + slope / PI / s.span_s();
                own.push(Own {
                    ahead: slope / PI * by / k as f64,
                    sigma: sigma / PI * by / k as f64,
                    amplitude: square.sqrt(),
                    estimate: Estimate {
                        period_s: 1.0 / hz,
                        sigma_s: sigma / PI / s.span_s() / (hz * hz),
                    },
                });
            }
        }
        let apart = out_of_step(&own);
        let are_apart = match apart.as_slice() {
            [a, b] => {
                let span_s = self.range.span_s;
                multiples_apart(1.0 / a.period_s, 1.0 / b.period_s, &[], span_s) >= COMMON
            }
            _ => false,
        };
        let runs_away = are_apart && out_of_phase > OUT_OF_PHASE * in_phase;
        let share = if changing > 0.0 { (changing / steady).sqrt() } else { 0.0 };
        let comes =
            if share > COMES_AND_GOES { DRIFT * (share / ALTOGETHER).min(1.0) } else { 0.0 };
        Change { drift_turns: drift(&parts).hypot(comes), apart, runs_away }
    }
}

/// Returns the periods of the two harmonics that run away from one another most clearly; nothing where all keep step.
fn out_of_step(own: &[Own]) -> Vec<Estimate> {
    let total: f64 = own.iter().map(|o| o.sigma.powi(-2)).sum();
    let Some(strongest) = own.iter().max_by(|a, b| a.amplitude.total_cmp(&b.amplitude)) else {
        return Vec::new();
    };
    let mean = own.iter().map(|o| o.ahead * o.sigma.powi(-2)).sum::<f64>() / total;
    let chi2: f64 = own.iter().map(|o| ((o.ahead - mean) / o.sigma).powi(2)).sum();
    if own.len() < 2 || chi2_survival(chi2, own.len() as f64 - 1.0) >= CHANCE {
        return Vec::new();
    }
    let off = |o: &Own| (o.ahead - strongest.ahead).abs() / o.sigma.hypot(strongest.sigma);
    // Of those that run away about as clearly, the lowest: the others may be its harmonics.
    let most = own.iter().map(off).fold(0.0, f64::max);
    let farthest = own.iter().find(|o| off(o) >= 0.5 * most);
    farthest.map(|o| vec![strongest.estimate, o.estimate]).unwrap_or_default()
}
