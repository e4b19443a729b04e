//! How much a law reflects in all directions, quickly: for the fit, which asks thousands of times. What is reported comes from the material's own quadrature.

use super::law::{Evaluated, Law, LobeKind, Rise};
use glam::DVec3;
use std::f64::consts::{PI, TAU};
use sunglint_simulator::surface::Shape;

/// Angles of incidence at which energy is looked at, degrees.
pub(super) const ANGLES_DEG: [f64; 12] =
    [0.0, 20.0, 40.0, 55.0, 65.0, 75.0, 80.0, 84.0, 87.0, 88.5, 89.5, 89.9];
const NODES: usize = 32;

/// ∫ f cosθ_o dω_o by angle of incidence (degrees) up to the largest that counts, to some 1e-3; of an anisotropic law the larger of both planes.
pub(super) fn quick(law: &Law, p: &[f64], rise: Option<&Rise>, to_deg: f64) -> Vec<(f64, f64)> {
    let law_with = law.with(p, rise);
    let angles = ANGLES_DEG.iter().filter(|a| **a <= to_deg + 1e-9);
    angles
        .map(|deg| {
            let (sin, cos) = deg.to_radians().sin_cos();
            let mut lobe = of_lobe(law, &law_with, DVec3::new(sin, 0.0, cos));
            if law.anisotropic {
                lobe = lobe.max(of_lobe(law, &law_with, DVec3::new(0.0, sin, cos)));
            }
            (*deg, lobe + law_with.diffuse + law_with.volume * of_volume(cos))
        })
        .collect()
}

/// 2/π ∫ cosθ_o/(cosθ_i + cosθ_o) dω_o.
fn of_volume(cos: f64) -> f64 {
    4.0 * (1.0 - cos * ((1.0 + cos) / cos).ln())
}

fn of_lobe(law: &Law, with: &Evaluated<'_>, i: DVec3) -> f64 {
    let Some((shape, strength)) = with.shape else { return 0.0 };
    match shape {
        Shape::Abg { b, g, .. } => strength * of_abg(b, g, (1.0 - i.z * i.z).max(0.0).sqrt()),
        Shape::Phong { exponent } => strength * of_phong(exponent, i),
        Shape::Ward { alpha_x, alpha_y, .. } => over_tilts(law, with, i, alpha_x.min(alpha_y)),
        Shape::FirstSurface { sigma, .. } => over_tilts(law, with, i, sigma),
        Shape::Facets(lobe) => over_tilts(law, with, i, lobe.alpha().0.min(lobe.alpha().1)),
        _ => 0.0,
    }
}

/// Over the shift x of the projected directions, of which cosθ_o dω_o is the area: a disc of radius 1 around a point at `from`.
fn of_abg(b: f64, g: f64, from: f64) -> f64 {
    let knee = b.powf(1.0 / g).clamp(1e-6, 1.0);
    let mut sum = 0.0;
    // ln-spaced beyond the knee: x = knee sinh t.
    let end = ((1.0 + from) / knee).asinh();
    for (t, w) in legendre(0.0, end, 3) {
        let x = knee * t.sinh();
        let angle = if x <= 1.0 - from {
            TAU
        } else {
            2.0 * ((x * x + from * from - 1.0) / (2.0 * x * from)).clamp(-1.0, 1.0).acos()
        };
        sum += w * knee * t.cosh() * x * angle / (b + x.powf(g));
    }
    sum
}

/// Around the mirrored direction.
fn of_phong(exponent: f64, i: DVec3) -> f64 {
    let mirrored = DVec3::new(-i.x, -i.y, i.z);
    let side = DVec3::Y;
    let up = side.cross(mirrored).normalize();
    let width = (2.0 / (exponent + 2.0)).sqrt();
    let end = (0.5 * PI).min(12.0 * width);
    let mut sum = 0.0;
    for (t, w) in legendre(0.0, end, 2) {
        let (sin, cos) = t.sin_cos();
        let value = (exponent + 2.0) / TAU * cos.max(0.0).powf(exponent);
        for (phi, v) in legendre(0.0, PI, 1) {
            let o = mirrored * cos + (up * phi.cos() + side * phi.sin()) * sin;
            sum += 2.0 * w * v * sin * value * o.z.max(0.0);
        }
    }
    sum
}

/// Over the tilts of the bisector: dω_o = 4 cosβ dω_h.
fn over_tilts(law: &Law, with: &Evaluated<'_>, i: DVec3, width: f64) -> f64 {
    // Symmetric about the plane of incidence, which is one of the law's axes.
    let folds = 2.0;
    let beta_sum = |h: DVec3, dh: f64| {
        let cos = i.dot(h);
        let o = 2.0 * cos * h - i;
        if cos > 0.0 && o.z > 0.0 { folds * dh * 4.0 * cos * o.z * with.lobe(i, o) } else { 0.0 }
    };
    let wide = matches!(law.lobe, LobeKind::MaxwellBeard | LobeKind::Ggx);
    let mut sum = 0.0;
    let end: f64 = if wide { (1e3 / width).asinh() } else { 12.0_f64.asinh() };
    let tangent = |t: f64| width * t.sinh();
    let azimuth_nodes = if law.anisotropic { 3 } else { 1 };
    for (t, w) in legendre(0.0, end, 2) {
        let tan = tangent(t);
        let cos = 1.0 / (1.0 + tan * tan).sqrt();
        let sin = tan * cos;
        let d_theta = w * width * t.cosh() * cos * cos;
        for (phi, v) in legendre(0.0, PI, azimuth_nodes) {
            // Azimuth from the plane of incidence.
            let along = DVec3::new(i.x, i.y, 0.0).normalize_or(DVec3::X);
            let across = DVec3::new(-along.y, along.x, 0.0);
            let h = (along * phi.cos() + across * phi.sin()) * sin + DVec3::Z * cos;
            sum += beta_sum(h, d_theta * v * sin);
        }
    }
    sum
}

/// Gauss–Legendre nodes and weights over panels.
fn legendre(from: f64, to: f64, panels: usize) -> impl Iterator<Item = (f64, f64)> {
    static RULE: std::sync::OnceLock<Vec<(f64, f64)>> = std::sync::OnceLock::new();
    let rule = RULE.get_or_init(|| sunglint_numerics::gauss::legendre(NODES));
    let step = (to - from) / panels as f64;
    (0..panels).flat_map(move |k| {
        let start = from + step * k as f64;
        rule.iter().map(move |(x, w)| (start + 0.5 * step * (x + 1.0), 0.5 * step * w))
    })
}
