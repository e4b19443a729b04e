//! Beyond the last angle: several continuations, each fitted to the readings before it, and how far they differ.

use super::shape::{EVERY_ALPHA, Reading, fit, ln_shape};
use serde::{Deserialize, Serialize};
use sunglint_simulator::surface::Distribution;

/// How retro-reflection may go on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TailKind {
    /// As of a GGX lobe.
    Ggx,
    /// As of a Beckmann lobe.
    Beckmann,
    /// ln f straight on.
    Exponential,
    /// f straight on, down to a millionth of the last reading.
    Linear,
}

/// All kinds.
const KINDS: [TailKind; 4] =
    [TailKind::Ggx, TailKind::Beckmann, TailKind::Exponential, TailKind::Linear];
/// The kinds that are tried beside the best one: whatever follows the last readings.
const OTHERS: [TailKind; 3] = [TailKind::Ggx, TailKind::Beckmann, TailKind::Exponential];
/// The part of the measured angles that the best is chosen by.
const WINDOW: f64 = 0.6;
/// The part of them that the others have to follow, and how well (root mean square of ln f, or three times what the best leaves).
const LAST: f64 = 0.85;
const PLAUSIBLE: f64 = 0.05;

/// A continuation.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tail {
    pub kind: TailKind,
    /// α and ln F₀, or a and b of a + b θ.
    parameters: [f64; 2],
    /// Root mean square of what it leaves of ln f.
    pub misfit: f64,
    /// Where it begins, radians, and what has to be added to ln f so that it begins where the readings end.
    from: f64,
    step: f64,
}

impl Tail {
    /// One kind, fitted to readings and joined to `ln_f` at the angle `from`.
    fn fitted(kind: TailKind, readings: &[Reading], from: f64, ln_f: f64) -> Self {
        let ggx = |d: Distribution| {
            let found = fit(d, readings, EVERY_ALPHA);
            ([found.alpha, found.f0.ln()], found.misfit)
        };
        let (parameters, misfit) = match kind {
            TailKind::Ggx => ggx(Distribution::Ggx),
            TailKind::Beckmann => ggx(Distribution::Beckmann),
            TailKind::Exponential => line(readings.iter().copied()),
            TailKind::Linear => {
                // Weights of f are those of ln f over f²; relative to the mean, so that the misfit is one of ln f.
                let scale = ln_f.exp();
                let straight = readings.iter().map(|(x, y, w)| {
                    let f = y.exp() / scale;
                    (*x, f, w / (f * f))
                });
                let (p, misfit) = line(straight);
                ([p[0] * scale, p[1] * scale], misfit)
            }
        };
        let mut tail = Self { kind, parameters, misfit, from, step: 0.0 };
        tail.step = ln_f - tail.at(from);
        tail
    }

    /// ln f at an angle, radians.
    pub fn at(&self, theta: f64) -> f64 {
        let [p, q] = self.parameters;
        let value = match self.kind {
            TailKind::Ggx => q + ln_shape(Distribution::Ggx, p, theta),
            TailKind::Beckmann => q + ln_shape(Distribution::Beckmann, p, theta),
            TailKind::Exponential => p + q * theta,
            TailKind::Linear => (p + q * theta).max(1e-6 * (p + q * self.from).abs()).ln(),
        };
        value + self.step
    }
}

/// Least squares of a straight line: its two numbers, and the weighted root mean square that is left.
fn line(readings: impl Iterator<Item = Reading> + Clone) -> ([f64; 2], f64) {
    let (mut w, mut wx, mut wy) = (0.0, 0.0, 0.0);
    for (x, y, weight) in readings.clone() {
        (w, wx, wy) = (w + weight, wx + weight * x, wy + weight * y);
    }
    let (mx, my) = (wx / w, wy / w);
    let (mut xx, mut xy) = (0.0, 0.0);
    for (x, y, weight) in readings.clone() {
        xx += weight * (x - mx).powi(2);
        xy += weight * (x - mx) * (y - my);
    }
    let slope = if xx > 0.0 { xy / xx } else { 0.0 };
    let parameters = [my - slope * mx, slope];
    let left = readings.map(|(x, y, w)| w * (y - parameters[0] - slope * x).powi(2)).sum::<f64>();
    (parameters, (left / w).sqrt())
}

/// The best continuation first, then others that the last readings do not exclude. `only` leaves the choice to the caller.
pub(super) fn tails(
    readings: &[Reading],
    end: f64,
    ln_f_end: f64,
    only: Option<TailKind>,
) -> Vec<Tail> {
    let beyond = |part: f64| {
        let near: Vec<Reading> =
            readings.iter().copied().filter(|r| r.0.abs() >= part * end).collect();
        if near.len() >= 6 { near } else { readings[readings.len().saturating_sub(6)..].to_vec() }
    };
    let wide = beyond(WINDOW);
    let make = |kind: TailKind| Tail::fitted(kind, &wide, end, ln_f_end);
    let is_good = |tail: &Tail| tail.misfit.is_finite() && tail.step.is_finite();
    let best = match only {
        Some(kind) => Some(make(kind)),
        None => {
            let all = KINDS.into_iter().map(make).filter(is_good);
            all.min_by(|a, b| a.misfit.total_cmp(&b.misfit))
        }
    };
    let Some(best) = best else { return Vec::new() };
    let last = beyond(LAST);
    let other = |kind: TailKind| Tail::fitted(kind, &last, end, ln_f_end);
    let others = OTHERS.into_iter().filter(|kind| *kind != best.kind).map(other);
    let least = PLAUSIBLE.max(3.0 * best.misfit);
    let others = others.filter(|tail| is_good(tail) && tail.misfit <= least);
    std::iter::once(best).chain(others).collect()
}
