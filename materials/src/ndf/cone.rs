//! A lobe as the meter sees it: its mean over the directions of the cone.
//!
//! The meter takes in directions o about that of the light, i, and so half-vectors about i with half their spread. What is called f̄ is the mean of f(i, o) cosθ_o/cosθ_i, which for
//! microfacets is F₀ D(h) G(i, o)/(4 cos²θ_i). Of two directions so close together the one that is lower sees no microfacet that the other does not, G = min(G₁(i), G₁(o)): the profile
//! between them is the same (Ashikhmin, Premože and Shirley, SIGGRAPH 2000). Near the peak of a lobe of α, far wider than the cone, the mean is that of a lobe of √(α² + 2 s²), where s
//! is the rms spread of half-vectors along the plane of incidence.

use super::shape::{EVERY_ALPHA, Reading, ShapeFit, fit};
use crate::table::RetroTable;
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, TAU};
use sunglint_simulator::surface::{Distribution, Lobe, Masking};

/// Directions around the ellipse that stands for the cone, and the squares of their radii: two Gauss–Legendre nodes in the area. Means of polynomials are exact to the seventh degree.
const AROUND: usize = 8;
const RADII: [f64; 2] = [0.211_324_865_405_187_1, 0.788_675_134_594_812_9];
/// A law is looked for anew until its roughness changes by less than this part, so often at most.
const SETTLED: f64 = 1e-7;
const MOST_TURNS: usize = 60;

/// Directions into the meter about the light's.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Cone {
    /// Offsets along and across the plane of incidence, radians, and their weights, of a sum of 1. One of two that lie on either side of the plane stands for both.
    offsets: Vec<(f64, f64, f64)>,
    /// The least roughness at which the lobe is told from the cone.
    least_alpha: f64,
}

impl Cone {
    /// From rms angles along and across the plane of incidence, radians: a uniform ellipse.
    fn new(along_rad: f64, across_rad: f64) -> Self {
        let mut offsets = Vec::with_capacity(AROUND);
        for square in RADII {
            for k in 0..AROUND / 2 {
                let (sin, cos) = (TAU * (k as f64 + 0.5) / AROUND as f64).sin_cos();
                let r = 2.0 * square.sqrt();
                offsets.push((r * cos * along_rad, r * sin * across_rad, 1.0 / AROUND as f64));
            }
        }
        // Half-vectors lie within half of the cone, whose edge is twice the rms angle away.
        Self { offsets, least_alpha: along_rad.max(across_rad).tan() }
    }

    /// The cone that a run's table states; none where it states none.
    pub fn of(run: &RetroTable) -> Option<Self> {
        let (along, across) = match (&run.cone_spread, run.cone_half_angle_deg) {
            (Some(spread), _) => (spread.along_deg, spread.across_deg),
            // A disc has half of its radius as rms along each axis.
            (None, Some(half)) => (0.5 * half, 0.5 * half),
            (None, None) => return None,
        };
        Some(Self::new(along.to_radians(), across.to_radians()))
    }

    /// ln of what the cone makes of a law's retro-reflection: mean over the cone, over the value without one.
    pub fn ln_blur(&self, distribution: Distribution, alpha: f64, theta_rad: f64) -> f64 {
        let Ok(lobe) = Lobe::isotropic(distribution, alpha, Masking::Separable) else {
            return f64::NAN;
        };
        // As in the law's own logarithm: nothing is seen at the horizon.
        let (sin, cos) = theta_rad.abs().min(FRAC_PI_2 - 1e-6).sin_cos();
        let i = DVec3::new(sin, 0.0, cos);
        let ln_density = |h: DVec3| {
            let cos2 = h.z * h.z;
            let t = (h.x * h.x + h.y * h.y) / (cos2 * alpha * alpha);
            let falls = match distribution {
                Distribution::Beckmann => -t,
                Distribution::Ggx => -2.0 * t.ln_1p(),
            };
            falls - 2.0 * cos2.ln()
        };
        let (ln_here, seen_here) = (ln_density(i), lobe.masking_one(i));
        let each = |(along, across, weight): &(f64, f64, f64)| {
            let o = DVec3::new(sin + along * cos, *across, cos - along * sin).normalize();
            if o.z <= 0.0 {
                return 0.0;
            }
            let h = (i + o).normalize();
            let seen = lobe.masking_one(o).min(seen_here) / seen_here;
            weight * (ln_density(h) - ln_here).exp() * seen
        };
        self.offsets.iter().map(each).sum::<f64>().ln()
    }

    /// Readings as they would be without the cone if the sample had this law.
    pub fn cleared(&self, fit: &Fitted, readings: &[Reading]) -> Vec<Reading> {
        readings.iter().map(|(x, y, w)| (*x, y - self.ln_blur_of(fit, *x), *w)).collect()
    }

    /// The same of a law that was fitted: 0 of a lobe that is not told from the cone.
    pub fn ln_blur_of(&self, fit: &Fitted, theta_rad: f64) -> f64 {
        if fit.is_told { self.ln_blur(fit.distribution, fit.alpha, theta_rad) } else { 0.0 }
    }
}

/// A law that was fitted through a cone.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fitted {
    distribution: Distribution,
    alpha: f64,
    /// Whether the lobe is told from the cone.
    is_told: bool,
}

impl Fitted {
    /// By [`fit_through`], which gives the roughness as it is seen where the lobe is not told from the cone.
    pub fn of(distribution: Distribution, fit: ShapeFit) -> Self {
        Self { distribution, alpha: fit.alpha, is_told: fit.seen_alpha != Some(fit.alpha) }
    }
}

/// The best roughness of a law that is seen through a cone: fitted to the readings less what the cone makes of it, until that is what it makes of the one that was fitted. The lobe as it is
/// seen is the result where it would be narrower than the cone's half-vectors; `near` is a roughness to begin with.
pub(super) fn fit_through(
    cone: Option<&Cone>,
    distribution: Distribution,
    readings: &[Reading],
    range: (f64, f64),
    near: Option<f64>,
) -> ShapeFit {
    let Some(cone) = cone else { return fit(distribution, readings, range) };
    let seen = |range| {
        let seen = fit(distribution, readings, range);
        ShapeFit { seen_alpha: Some(seen.alpha), ..seen }
    };
    let (mut alpha, seen_alpha, mut range) = match near {
        Some(alpha) => (alpha, None, range),
        None => {
            let seen = seen(range);
            (seen.alpha, seen.seen_alpha, range)
        }
    };
    for _ in 0..MOST_TURNS {
        if alpha < cone.least_alpha {
            break;
        }
        let cleared = cone.cleared(&Fitted { distribution, alpha, is_told: true }, readings);
        let next = fit(distribution, &cleared, range);
        let change = (next.alpha / alpha).ln().abs();
        if change < SETTLED {
            return ShapeFit { seen_alpha, ..next };
        }
        // The next change is smaller.
        let wide = (1.5 * change).min(0.7).exp();
        range = ((next.alpha / wide).max(EVERY_ALPHA.0), (next.alpha * wide).min(EVERY_ALPHA.1));
        alpha = next.alpha;
    }
    seen(EVERY_ALPHA)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ndf::shape::ln_shape;

    /// Truth: the mean of Beckmann's density over a disc by another way, rings of many points in the angles of half-vectors, which lie at half of the cone's offsets. Tolerance 1e-5: angles on
    /// a sphere are no plane (of 1e-4, the blur, a part of 0.05²), and the rule leaves the eighth power of the spread over α (0.17).
    #[test]
    fn a_disc_of_half_vectors_about_a_narrow_lobe() {
        let (alpha, half_deg) = (0.03_f64, 0.6_f64);
        let half = half_deg.to_radians();
        let cone = Cone::new(0.5 * half, 0.5 * half);
        for theta in [0.0_f64, 0.01, 0.03, 0.05] {
            let (mut sum, rings, around) = (0.0, 400, 240);
            for j in 0..rings {
                let r = 0.5 * half * ((f64::from(j) + 0.5) / f64::from(rings)).sqrt();
                for k in 0..around {
                    let (sin, cos) = (TAU * f64::from(k) / f64::from(around)).sin_cos();
                    let slope2 = |x: f64, y: f64| x.tan().powi(2) + (y.tan() / x.cos()).powi(2);
                    let (there, here) = (slope2(theta + r * cos, r * sin), slope2(theta, 0.0));
                    let area = ((1.0 + there) / (1.0 + here)).powi(2);
                    sum += ((here - there) / (alpha * alpha)).exp() * area;
                }
            }
            let expected = (sum / f64::from(rings * around)).ln();
            let found = cone.ln_blur(Distribution::Beckmann, alpha, theta);
            assert!((found - expected).abs() < 1e-5, "{theta}: {found} {expected}");
        }
    }

    /// Truth: the law itself, which the cone leaves as it is where it is 0; and a law whose readings a wide cone has blurred comes back, from any of both.
    #[test]
    fn a_law_comes_back() {
        let none = Cone::new(0.0, 0.0);
        assert!(none.ln_blur(Distribution::Ggx, 0.1, 0.4).abs() < 1e-12);
        for distribution in [Distribution::Beckmann, Distribution::Ggx] {
            for (alpha, half_deg) in [(0.02_f64, 0.5_f64), (0.05, 2.0), (0.3, 1.0)] {
                let cone = Cone::new(0.5 * half_deg.to_radians(), 0.5 * half_deg.to_radians());
                let reading = |k: i32| {
                    let theta = 0.1 * alpha * f64::from(k);
                    let blur = cone.ln_blur(distribution, alpha, theta);
                    (theta, ln_shape(distribution, alpha, theta) + blur, 1.0)
                };
                let readings: Vec<Reading> = (-20..=20).map(reading).collect();
                let found = fit_through(Some(&cone), distribution, &readings, EVERY_ALPHA, None);
                assert!((found.alpha / alpha - 1.0).abs() < 1e-6, "{distribution:?} {found:?}");
                assert!(found.seen_alpha.is_some_and(|seen| seen > alpha), "{found:?}");
            }
        }
    }
}
