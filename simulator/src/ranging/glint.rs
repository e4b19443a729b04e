//! A flat mirror in a laser beam.
//!
//! The mirror shows the receiver an image of the laser behind it, at the unfolded length of the path. The receiver sees that image where the
//! line to it passes through the mirror's outline; the fluence there is the beam's at the unfolded length. The outline also spreads the
//! light by diffraction, λ/d. That is taken as a normal distribution of the point in which the line meets the mirror, of the width at which a
//! mirror much smaller than the Fresnel zone has its Fraunhofer limit on axis, H (A/λr)²; for one much larger the edge is sharp. Between the
//! two, where rings appear, it is an approximation.

use super::Beam;
use glam::DVec3;
use std::f64::consts::PI;
use sunglint_numerics::gauss;

/// Points on each half of an edge.
const POINTS: usize = 24;

/// A flat mirror: a convex outline, counter-clockwise about its normal, all in one frame.
#[derive(Debug, Clone, Copy)]
pub struct Mirror<'a> {
    /// Corners of the mirror, m.
    pub corners: &'a [DVec3],
    /// Unit normal of the mirror.
    pub normal: DVec3,
    /// The reflectance at the laser's wavelength and angle.
    pub reflectance: f64,
}

/// Returns the fluence of one pulse at the receiver by a mirror, J m⁻², without the air: the laser at one point, its axis along a unit vector, the
/// receiver at another point, in the mirror's frame, m.
pub fn fluence_j_m2(
    mirror: &Mirror,
    beam: &Beam,
    (laser, axis): (DVec3, DVec3),
    receiver: DVec3,
) -> f64 {
    let (normal, corners) = (mirror.normal, mirror.corners);
    let Some(&first) = corners.first() else { return 0.0 };
    let (up, seen) = ((laser - first).dot(normal), (receiver - first).dot(normal));
    if !(up > 0.0 && seen > 0.0) {
        return 0.0;
    }
    let image = laser - 2.0 * up * normal;
    let path = (receiver - image).length();
    // Where the line from the receiver to the image meets the plane.
    let meets = receiver + (image - receiver) * (seen / (seen + up));
    let out = meets - laser;
    let off_axis = path * out.normalize_or_zero().cross(axis).length();
    // The effective range of a lens between: of laser and receiver from the mirror, 1/(1/a + 1/b) is half of r where both are r.
    let (a, b) = (out.length(), (receiver - meets).length());
    let reduced = a * b / (a + b);
    let cos = seen / b;
    let area: f64 = 0.5
        * corners
            .windows(2)
            .skip(1)
            .map(|w| (w[0] - first).cross(w[1] - first).dot(normal))
            .sum::<f64>();
    // Across the line the mirror has A cos; in its own plane the spread is longer by 1/cos along one axis: taken as a circle of the same area.
    let spread_squared =
        (beam.wavelength_nm * 1e-9 * reduced).powi(2) / (2.0 * PI * area * cos * cos);
    mirror.reflectance
        * beam.fluence_j_m2(path, off_axis)
        * covered(corners, normal, meets, spread_squared)
}

/// The share of a normal distribution about a point of the plane, of variance σ² along each axis, that lies within a convex outline.
///
/// In polar coordinates about the point each edge bounds a triangle whose share is ∫ (1 − exp(−h²/(2σ² cos²φ))) dφ/2π over the angles that
/// it is seen under, h being the edge's distance; those on the far side count negative.
fn covered(corners: &[DVec3], normal: DVec3, about: DVec3, variance: f64) -> f64 {
    let legendre = gauss::legendre(POINTS);
    let mut sum = 0.0;
    for (k, from) in corners.iter().enumerate() {
        let to = corners[(k + 1) % corners.len()];
        let Some(along) = (to - *from).try_normalize() else { continue };
        let outward = along.cross(normal);
        let height = (*from - about).dot(outward);
        if height == 0.0 {
            continue;
        }
        let angle = |p: DVec3| (p - about).dot(along).atan2(height.abs());
        let mut part = |low: f64, high: f64| {
            let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
            for &(x, weight) in &legendre {
                let cos = (middle + half * x).cos();
                let exponent = height * height / (2.0 * variance * cos * cos);
                let within = -(-exponent).exp_m1();
                sum += height.signum() * half * weight * within / (2.0 * PI);
            }
        };
        let (low, high) = (angle(*from), angle(to));
        // The foot is where the integrand is least.
        if low < 0.0 && high > 0.0 {
            part(low, 0.0);
            part(0.0, high);
        } else {
            part(low, high);
        }
    }
    sum.max(0.0)
}
