//! Directions drawn at random where a material reflects much: for light that is reflected more than once.

use super::tensor::Tensor;
use super::{Distribution, Lobe, Material};
use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_1_PI, PI, TAU};
use std::sync::Arc;

/// A direction that was drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampled {
    /// Unit vector away from the surface, in its own axes.
    pub direction: DVec3,
    /// The density of its kind, sr⁻¹; infinite of a perfect mirror, which has but one direction.
    pub density_per_sr: f64,
}

/// Several ways to draw a direction, each with its share.
#[derive(Debug, Clone, Default)]
pub(super) struct Mixture {
    /// The sum of the shares up to and with each way; the last is 1.
    ways: Vec<(f64, Proposal)>,
}

/// A way to draw a direction.
#[derive(Debug, Clone)]
pub(super) enum Proposal {
    /// Directions of a Lambert surface.
    Cosine,
    /// Directions of microfacets that are perfect mirrors.
    Facets(Lobe),
    /// cosⁿ around the mirrored direction.
    Phong(f64),
    /// Around the mirrored direction in direction cosines, with the density x/(knee² + x²).
    Shift(f64),
    /// Directions that a measured material's file knows.
    Tensor(Arc<Tensor>),
}

impl Material {
    /// Draws a direction for light from `i` (unit, surface's own axes) with two random numbers from 0 to 1. `None` where the draw led below the
    /// horizon: the sample then counts as 0. The mean of w_k cosθ_o/density over all draws is the albedo's weight.
    pub fn sample(&self, i: DVec3, u: impl Into<DVec2>) -> Option<Sampled> {
        if i.z.is_nan() || i.z <= 0.0 {
            return None;
        }
        if self.is_mirror() {
            let direction = DVec3::new(-i.x, -i.y, i.z);
            return Some(Sampled { direction, density_per_sr: f64::INFINITY });
        }
        let direction = self.proposals.sample(i, u.into())?;
        Some(Sampled { direction, density_per_sr: self.proposals.density(i, direction) })
    }

    /// The density \[sr⁻¹\] with which [`Material::sample`] draws `o` for light from `i`; 0 of a mirror and below the horizon.
    pub fn sampling_density_per_sr(&self, i: DVec3, o: DVec3) -> f64 {
        if i.z > 0.0 && o.z > 0.0 { self.proposals.density(i, o) } else { 0.0 }
    }
}

impl Mixture {
    /// Ways with their shares, which need not sum to 1. What is left out of a lobe's tails is found by the cosine's share.
    pub fn new(ways: Vec<(f64, Proposal)>) -> Self {
        let all: f64 = ways.iter().map(|(share, _)| share).sum();
        let mut sum = 0.0;
        let mut made = Vec::new();
        for (share, way) in ways {
            if share > 0.0 {
                sum += share / all;
                made.push((sum, way));
            }
        }
        if let Some(last) = made.last_mut() {
            last.0 = 1.0;
        }
        Self { ways: made }
    }

    /// The values of the first random number between which the draw is smooth.
    pub fn edges(&self) -> Vec<f64> {
        std::iter::once(0.0).chain(self.ways.iter().map(|(end, _)| *end)).collect()
    }

    pub fn sample(&self, i: DVec3, u: DVec2) -> Option<DVec3> {
        let mut from = 0.0;
        for (end, way) in &self.ways {
            if u[0] < *end || *end == 1.0 {
                let first = ((u[0] - from) / (end - from)).clamp(0.0, 1.0);
                return way.sample(i, DVec2::new(first, u[1])).filter(|o| o.z > 0.0);
            }
            from = *end;
        }
        None
    }

    pub fn density(&self, i: DVec3, o: DVec3) -> f64 {
        let mut from = 0.0;
        let mut sum = 0.0;
        for (end, way) in &self.ways {
            sum += (end - from) * way.density(i, o);
            from = *end;
        }
        sum
    }
}

impl Proposal {
    fn sample(&self, i: DVec3, u: DVec2) -> Option<DVec3> {
        let turn = TAU * u[1];
        match self {
            Self::Cosine => {
                let r = u[0].sqrt();
                Some(DVec3::new(r * turn.cos(), r * turn.sin(), (1.0 - u[0]).max(0.0).sqrt()))
            }
            Self::Facets(lobe) => {
                let h = match lobe.distribution {
                    Distribution::Beckmann => beckmann_tilt(lobe, u),
                    Distribution::Ggx => ggx_visible_tilt(lobe, i, u),
                };
                reflected(i, h)
            }
            Self::Phong(n) => {
                let cos = (1.0 - u[0]).powf(1.0 / (n + 1.0));
                let sin = (1.0 - cos * cos).max(0.0).sqrt();
                let mirrored = DVec3::new(-i.x, -i.y, i.z);
                let (x, y) = mirrored.any_orthonormal_pair();
                Some((x * (sin * turn.cos()) + y * (sin * turn.sin()) + mirrored * cos).normalize())
            }
            Self::Shift(knee) => {
                // ∫x/(k²+x²) dx = ½ ln(1 + x²/k²), as far as the unit disc goes.
                let (sin, cos) = turn.sin_cos();
                let span = shift_span(i, cos, sin, *knee);
                let r = knee * (u[0] * span).exp_m1().sqrt();
                let (x, y) = (r * cos - i.x, r * sin - i.y);
                let z = 1.0 - x * x - y * y;
                (z > 0.0).then(|| DVec3::new(x, y, z.sqrt()))
            }
            Self::Tensor(tensor) => tensor.sample(i, u),
        }
    }

    fn density(&self, i: DVec3, o: DVec3) -> f64 {
        match self {
            Self::Cosine => o.z * FRAC_1_PI,
            Self::Facets(lobe) => {
                let sum = i + o;
                let h = sum.normalize();
                let tilt = lobe.density(h);
                match lobe.distribution {
                    // D cosθ_h/(4 i·h).
                    Distribution::Beckmann => tilt * h.z / (4.0 * i.dot(h)).max(f64::MIN_POSITIVE),
                    // D G₁ (i·h)/cosθ_i/(4 i·h) (Heitz 2018).
                    Distribution::Ggx => 0.25 * tilt * lobe.masking_one(i) / i.z,
                }
            }
            Self::Phong(n) => {
                let cos = (i.z * o.z - i.x * o.x - i.y * o.y).clamp(0.0, 1.0);
                (n + 1.0) / TAU * cos.powf(*n)
            }
            Self::Shift(knee) => {
                let (x, y) = (i.x + o.x, i.y + o.y);
                let x2 = x * x + y * y;
                let r = x2.sqrt();
                let (cos, sin) = if r > 0.0 { (x / r, y / r) } else { (1.0, 0.0) };
                let span = shift_span(i, cos, sin, *knee);
                o.z / (PI * span * (knee * knee + x2))
            }
            Self::Tensor(tensor) => tensor.sampling_density(i, o),
        }
    }
}

/// ln(1 + x²/knee²) of the distance x from the mirrored direction to the horizon, in direction cosines.
fn shift_span(i: DVec3, cos: f64, sin: f64, knee: f64) -> f64 {
    let along = i.x * cos + i.y * sin;
    let end = along + (along * along + i.z * i.z).sqrt();
    (end * end / (knee * knee)).ln_1p()
}

/// `i` mirrored at a plane with the normal `h`.
pub(super) fn reflected(i: DVec3, h: DVec3) -> Option<DVec3> {
    let cos = i.dot(h);
    (cos > 0.0).then(|| (2.0 * cos * h - i).normalize())
}

/// Slopes from a Gaussian.
fn beckmann_tilt(lobe: &Lobe, u: DVec2) -> DVec3 {
    let r = (-(-u[0]).ln_1p()).sqrt();
    let turn = TAU * u[1];
    DVec3::new(lobe.alpha_x * r * turn.cos(), lobe.alpha_y * r * turn.sin(), 1.0).normalize()
}

/// Among the tilts that `i` sees (Heitz 2018, JCGT 7(4)).
fn ggx_visible_tilt(lobe: &Lobe, i: DVec3, u: DVec2) -> DVec3 {
    let v = DVec3::new(lobe.alpha_x * i.x, lobe.alpha_y * i.y, i.z).normalize();
    let across = v.x * v.x + v.y * v.y;
    let x = if across > 0.0 { DVec3::new(-v.y, v.x, 0.0) / across.sqrt() } else { DVec3::X };
    let y = v.cross(x);
    let (r, turn) = (u[0].sqrt(), TAU * u[1]);
    let (t1, t2) = (r * turn.cos(), r * turn.sin());
    let s = 0.5 * (1.0 + v.z);
    let t2 = (1.0 - s) * (1.0 - t1 * t1).max(0.0).sqrt() + s * t2;
    let n = t1 * x + t2 * y + (1.0 - t1 * t1 - t2 * t2).max(0.0).sqrt() * v;
    DVec3::new(lobe.alpha_x * n.x, lobe.alpha_y * n.y, n.z.max(1e-12)).normalize()
}
