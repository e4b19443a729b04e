//! Parametric lobes: how well Beckmann's and GGX say what was measured, and with which roughness.

use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::f64::consts::FRAC_PI_2;
use sunglint_simulator::surface::{Distribution, Lobe, Masking};

/// A lobe that was fitted to retro-reflection.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ShapeFit {
    /// The roughness.
    pub alpha: f64,
    /// The roughness of the lobe as it is seen through the cone of light, whose share is taken off in `alpha`; none where the run does not state its cone: `alpha` is then that.
    #[serde(default)]
    pub seen_alpha: Option<f64>,
    /// Standard deviation of the roughness, by resampling and by how well the cone is known; none where that of the readings is not known.
    pub sigma: Option<f64>,
    /// F₀ of the fit.
    pub f0: f64,
    /// Root mean square of ln f(measured)/f(fitted), weighted as the fit is.
    pub misfit: f64,
}

/// Numbers of a reading: angle from the normal (radians), ln f, weight.
pub(super) type Reading = (f64, f64, f64);

/// ln of D G₁/(4 cos²θ): retro-reflection with F₀ = 1.
pub(super) fn ln_shape(distribution: Distribution, alpha: f64, theta_rad: f64) -> f64 {
    // Beyond, Beckmann's density is less than a double holds and its logarithm is written out.
    let theta = theta_rad.abs().min(FRAC_PI_2 - 1e-6);
    let (sin, cos) = theta.sin_cos();
    let direction = DVec3::new(sin, 0.0, cos);
    let Ok(lobe) = Lobe::isotropic(distribution, alpha, Masking::Separable) else {
        return f64::NAN;
    };
    let t = (sin / cos / alpha).powi(2);
    let ln_density = match distribution {
        Distribution::Beckmann => -t,
        Distribution::Ggx => -2.0 * t.ln_1p(),
    };
    let scale = std::f64::consts::PI * alpha * alpha * cos.powi(4);
    ln_density - scale.ln() + (lobe.masking_one(direction) / (4.0 * cos * cos)).ln()
}

/// The best roughness within `range`, by least squares in ln f with F₀ free.
pub(super) fn fit(distribution: Distribution, readings: &[Reading], range: (f64, f64)) -> ShapeFit {
    let judge = |ln_alpha: f64| {
        let alpha = ln_alpha.exp();
        let (mut w, mut r, mut rr) = (0.0, 0.0, 0.0);
        for (theta, ln_f, weight) in readings {
            let left = ln_f - ln_shape(distribution, alpha, *theta);
            w += weight;
            r += weight * left;
            rr += weight * left * left;
        }
        let mean = r / w;
        ((rr / w - mean * mean).max(0.0), mean)
    };
    let (from, to) = (range.0.ln(), range.1.ln());
    let at = |k: usize| from + (to - from) * k as f64 / 24.0;
    let best = (0..=24).min_by(|a, b| judge(at(*a)).0.total_cmp(&judge(at(*b)).0)).unwrap_or(12);
    let ln_alpha = golden(at(best.saturating_sub(1)), at((best + 1).min(24)), |x| judge(x).0);
    let (square, ln_f0) = judge(ln_alpha);
    ShapeFit {
        alpha: ln_alpha.exp(),
        seen_alpha: None,
        sigma: None,
        f0: ln_f0.exp(),
        misfit: square.sqrt(),
    }
}

/// The range of roughness that a fit looks through.
pub(super) const EVERY_ALPHA: (f64, f64) = (5e-4, 2.0);

/// Where a function with one minimum between two ends has it (golden section).
pub(super) fn golden(mut from: f64, mut to: f64, f: impl Fn(f64) -> f64) -> f64 {
    const SECTION: f64 = 0.618_033_988_749_894_9;
    let mut a = to - SECTION * (to - from);
    let mut b = from + SECTION * (to - from);
    let (mut at_a, mut at_b) = (f(a), f(b));
    for _ in 0..60 {
        if at_a <= at_b {
            (to, b, at_b) = (b, a, at_a);
            a = to - SECTION * (to - from);
            at_a = f(a);
        } else {
            (from, a, at_a) = (a, b, at_b);
            b = from + SECTION * (to - from);
            at_b = f(b);
        }
        if to - from <= 1e-10 * (1.0 + from.abs()) {
            break;
        }
    }
    0.5 * (from + to)
}
