//! Light that changes along the data: how far the phase of a period may have drifted.
//!
//! A period counts turns by the light of each. Where glints come and go and wander, the light of the last turn is not that of the first, and the phase drifts with it: a drift at a constant rate is in the period itself, and no scatter shows it. Two
//! things do. The harmonics of light that only repeats keep step; where each has a frequency of its own, the phase is known as well as they agree. And a change of the amplitudes is a change of
//! the light: the part of it that is out of phase, and so moves the phase, is not seen beside the period, but is as large as the part that is in phase.

use super::super::lines::drifting;
use super::super::stats::chi2_survival;
use super::outcome::Estimate;
use super::search::Search;

/// Turns over the data by which the phase drifts of a light that changes altogether, as one standard deviation: 1/2π, a change by all of the amplitude out of phase being one radian. So far the bisector of Sun and observer moves in a pass.
const DRIFT: f64 = 0.5 / std::f64::consts::PI;
/// Change, as a share of the amplitude (root mean square), from which on a light changes altogether: of a glint that comes and goes polynomials of degree two follow about that much.
const ALTOGETHER: f64 = 0.5;
/// The linear changes out of phase are more than those in phase by this factor (of squares) where harmonics run away from one another and keep their amplitudes: of light that changes anyhow, both are as large.
const OUT_OF_PHASE: f64 = 4.0;
/// Degree of the polynomials by which amplitudes change.
const DEGREE: usize = 2;
/// A change is seen where noise makes such a one with less than this probability.
const CHANCE: f64 = 1e-3;
/// Harmonics that are asked for their own frequencies stand out by this many standard deviations of their amplitudes, so that their phases are known.
const STANDS_OUT: f64 = 5.0;

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
    /// Whether they are more than noise.
    pub is_seen: bool,
    /// Drift of the phase over the data that comes with them, turns, as one standard deviation.
    pub drift_turns: f64,
    /// Periods of the two harmonics that are out of step, where some are.
    pub apart: Vec<Estimate>,
    /// Whether these run away from one another with the same amplitudes along the data, as two periods at once do.
    pub runs_away: bool,
}

impl Search<'_> {
    /// Changes of the light of `harmonics` of a base; `independent` is as how many samples one counts.
    pub fn change(&self, base: f64, harmonics: usize, independent: f64) -> Change {
        let (mut own, mut by_noise) = (Vec::new(), 0.0);
        // Squares of what changes and of what stays, and the changes in units of their noise.
        let (mut changing, mut steady, mut scaled, mut degrees) = (0.0, 0.0, 0.0, 0.0);
        let (mut in_phase, mut out_of_phase) = (0.0, 0.0);
        for s in self.series {
            let Some(model) = drifting(s, base, harmonics, DEGREE) else { continue };
            let n = s.len() as f64;
            let unknowns = super::super::lines::Drifting::unknowns(harmonics, DEGREE) as f64 + 1.0;
            let left: f64 = model.left.iter().zip(&s.weight).map(|(r, w)| w * r * r).sum();
            // Variance of the cosine's or the sine's amplitude of steady light.
            let noise = 2.0 * left / (n - unknowns) / (n * independent);
            for k in 1..=harmonics {
                let [a, b, c] = [0, 1, 2].map(|power| model.amplitude(k, power));
                // Legendre's polynomials are independent of one another on even times: u² is 1/3 + 2/3 P₂, and the squares of u and P₂ have means of 1/3 and 1/5.
                let level = [a[0] + c[0] / 3.0, a[1] + c[1] / 3.0];
                let square = |v: [f64; 2]| v[0] * v[0] + v[1] * v[1];
                let change = square(b) / 3.0 + 4.0 / 45.0 * square(c);
                (changing, steady) = (changing + change, steady + square(level));
                if noise > 0.0 {
                    scaled += change / noise;
                    degrees += 4.0;
                }
                by_noise += 4.0 * noise;
                if square(level) > STANDS_OUT * STANDS_OUT * noise && noise > 0.0 {
                    // The phase runs by this many radians from the middle to the end: the light is Re (a − ib) e^{iφ}.
                    let slope = (level[1] * b[0] - level[0] * b[1]) / square(level);
                    let grows = (level[0] * b[0] + level[1] * b[1]) / square(level);
                    in_phase += grows * grows * square(level);
                    out_of_phase += slope * slope * square(level);
                    let sigma = (3.0 * noise / square(level)).sqrt();
                    let turns = |slope: f64| slope / std::f64::consts::PI;
                    let hz = k as f64 * base + turns(slope) / s.span_s();
                    let by = self.range.span_s / s.span_s() / k as f64;
                    own.push(Own {
                        ahead: turns(slope) * by,
                        sigma: turns(sigma) * by,
                        amplitude: square(level).sqrt(),
                        estimate: Estimate {
                            period_s: 1.0 / hz,
                            sigma_s: turns(sigma) / s.span_s() / (hz * hz),
                        },
                    });
                }
            }
        }
        let is_seen = degrees > 0.0 && chi2_survival(scaled, degrees) < CHANCE;
        let changed = if is_seen { (changing - by_noise).max(0.0) } else { 0.0 };
        let share = if changed > 0.0 { (changed / steady).sqrt() / ALTOGETHER } else { 0.0 };
        let (wander, apart) = out_of_step(&own);
        let runs_away = !apart.is_empty() && out_of_phase > OUT_OF_PHASE * in_phase;
        Change { is_seen, drift_turns: (DRIFT * share.min(1.0)).hypot(wander), apart, runs_away }
    }
}

/// How far harmonics go ahead of one another, turns of the base, and the periods of the two that do so most clearly; nothing where they keep step.
fn out_of_step(own: &[Own]) -> (f64, Vec<Estimate>) {
    let total: f64 = own.iter().map(|o| o.sigma.powi(-2)).sum();
    let Some(strongest) = own.iter().max_by(|a, b| a.amplitude.total_cmp(&b.amplitude)) else {
        return (0.0, Vec::new());
    };
    let mean = own.iter().map(|o| o.ahead * o.sigma.powi(-2)).sum::<f64>() / total;
    let chi2: f64 = own.iter().map(|o| ((o.ahead - mean) / o.sigma).powi(2)).sum();
    if own.len() < 2 || chi2_survival(chi2, own.len() as f64 - 1.0) >= CHANCE {
        return (0.0, Vec::new());
    }
    // Each speaks for the period by its weight; one alone may be off by as much as they scatter.
    let wander = (chi2 / total * own.len() as f64 / (own.len() as f64 - 1.0)).sqrt();
    let off = |o: &Own| (o.ahead - strongest.ahead).abs() / o.sigma.hypot(strongest.sigma);
    // Of those that run away about as clearly, the lowest: the others may be its harmonics.
    let most = own.iter().map(off).fold(0.0, f64::max);
    let farthest = own.iter().find(|o| off(o) >= 0.5 * most);
    let apart = farthest.map(|o| vec![strongest.estimate, o.estimate]).unwrap_or_default();
    (wander, apart)
}
