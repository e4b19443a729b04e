//! Beyond the last angle: several continuations, each fitted to the readings before it, and how far they differ.

use super::shape::{EVERY_ALPHA, Reading, fit, ln_shape};
use serde::{Deserialize, Serialize};
use sunglint_simulator::surface::Distribution;

/// How retro-reflection may go on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TailKind {
    /// Tail of a GGX lobe.
    Ggx,
    /// Tail of a Beckmann lobe.
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
pub(super) const PLAUSIBLE: f64 = 0.05;

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

    fn is_good(&self) -> bool {
        self.misfit.is_finite() && self.step.is_finite()
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

/// The continuation that follows the readings best, or the one of that kind.
pub(super) fn chosen(
    readings: &[Reading],
    (end, ln_f_end): (f64, f64),
    only: Option<TailKind>,
) -> Option<Tail> {
    let near = beyond(readings, WINDOW * end);
    let make = |kind: TailKind| Tail::fitted(kind, &near, end, ln_f_end);
    let kinds = KINDS.into_iter().filter(|kind| only.is_none_or(|only| only == *kind));
    let all = kinds.map(make).filter(Tail::is_good);
    all.min_by(|a, b| a.misfit.total_cmp(&b.misfit))
}

/// Others that the last readings do not exclude.
pub(super) fn others(readings: &[Reading], (end, ln_f_end): (f64, f64), best: &Tail) -> Vec<Tail> {
    let last = beyond(readings, LAST * end);
    let make = |kind: TailKind| Tail::fitted(kind, &last, end, ln_f_end);
    let all = OTHERS.into_iter().filter(|kind| *kind != best.kind).map(make);
    let most = PLAUSIBLE.max(3.0 * best.misfit);
    all.filter(|tail| tail.is_good() && tail.misfit <= most).collect()
}

/// The readings beyond an angle, at least the last six.
fn beyond(readings: &[Reading], from: f64) -> Vec<Reading> {
    let near: Vec<Reading> = readings.iter().copied().filter(|r| r.0.abs() >= from).collect();
    if near.len() >= 6 { near } else { readings[readings.len().saturating_sub(6)..].to_vec() }
}
