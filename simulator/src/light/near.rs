//! Facets seen from a point: angles and distances change over a facet, so its answer is an integral.

use super::clip::P2;
use crate::surface::Width;
use glam::DVec3;

/// Relative error of a piece's integral at which halving stops, of what is smooth: of its own, or of its share by area of the whole polygon's. A lobe's tails
/// are not worth more.
pub const TOLERANCE: f64 = 1e-10;
/// Areas of pieces are differences of the facet's coordinates: rounding in units of the facet's area. Slivers would be halved in vain.
const ROUNDING: f64 = 4e-15;
/// Light of a square metre that is worth being found to the tolerance, sr⁻¹: a lobe that has fallen to 1e-4 of white paint is not seen.
const WORTH: f64 = 1e-4 * std::f64::consts::FRAC_1_PI;
/// Halvings at most.
const DEPTH: u32 = 10;

/// Integral to compute.
pub struct Task<'a> {
    /// Adds w_k cosθ_i for a direction to the observer (the facet's axes), times a number, to a row of weights.
    pub weigh: &'a mut dyn FnMut(DVec3, f64, &mut [f64]),
    /// Relative error of a piece's integral at which halving stops.
    pub tolerance: f64,
    /// Pieces that are longer are halved in any case, m: what is narrow would be missed.
    pub longest_m: f64,
    /// Pieces no longer than this may be found at few points, m: over them nothing changes by more than a tenth or so.
    pub smooth_m: f64,
    /// The observer, in the facet's axes, m from its origin.
    pub at: DVec3,
    /// The square of the observer's distance from the body's origin, m².
    pub range_squared: f64,
    /// The area of the whole facet, m².
    pub facet_area: f64,
}

/// Tilts of normals over which a material's reflection is much the same, radians: of a lobe half its roughness.
pub fn width(width: &Width<'_>) -> f64 {
    match width {
        Width::Even => f64::INFINITY,
        Width::Lobe { lobe, .. } => 0.5 * lobe.narrowest(),
        Width::Other(width) => 0.25 * width,
        Width::Mirror(_) => 0.0,
    }
}

/// [`Task::smooth_m`] of what changes over tilts of such a width, for light from a direction and an observer at a point, in the facet's axes. The normal that mirrors one to the other
/// tilts by 1/(2 cos γ/2) of what the direction to the observer turns, γ the phase angle.
pub fn smooth_m(width: f64, sun: DVec3, at: DVec3) -> f64 {
    let range = at.length();
    let half_cos = (0.5 * (1.0 + sun.dot(at) / range)).max(0.0).sqrt();
    width * (0.2 * half_cos * range).max(f64::MIN_POSITIVE)
}

/// Room for sums, and the tolerance of flat facets.
#[derive(Debug)]
pub struct Quadrature {
    sums: Vec<f64>,
    pub tolerance: f64,
}

impl Default for Quadrature {
    fn default() -> Self {
        Self { sums: Vec::new(), tolerance: TOLERANCE }
    }
}

/// Degree 5 on a triangle with seven points (Radon 1948): weight and the point's first two coordinates of area.
const A: f64 = 0.101_286_507_323_456_33;
const B: f64 = 0.470_142_064_105_115_1;
pub(super) const RULE: [(f64, f64, f64); 7] = [
    (0.225, 1.0 / 3.0, 1.0 / 3.0),
    (0.125_939_180_544_827_14, A, A),
    (0.125_939_180_544_827_14, A, 1.0 - 2.0 * A),
    (0.125_939_180_544_827_14, 1.0 - 2.0 * A, A),
    (0.132_394_152_788_506_2, B, B),
    (0.132_394_152_788_506_2, B, 1.0 - 2.0 * B),
    (0.132_394_152_788_506_2, 1.0 - 2.0 * B, B),
];

impl Quadrature {
    /// Adds `sign` times |view|² ∫ cosθ_i cosθ_o w_k/r² dA over a convex polygon to `out`; gives the error estimate of the sum.
    pub fn add(&mut self, task: &mut Task<'_>, polygon: &[P2], sign: f64, out: &mut [f64]) -> f64 {
        let mut error = 0.0;
        for pair in polygon[1..].windows(2) {
            let triangle = [polygon[0], pair[0], pair[1]];
            if let Some(own) = self.few(task, triangle, sign, out) {
                error += own;
                continue;
            }
            self.sums.clear();
            self.sums.resize(out.len(), 0.0);
            rule(task, triangle, sign, &mut self.sums);
            let coarse = std::mem::take(&mut self.sums);
            error += refine(task, triangle, sign, (&coarse, 0.0), 0, out);
            self.sums = coarse;
        }
        error
    }

    /// Adds a piece by the values in the middles of its edges, exact to degree 2, where that in the middle of the piece, exact to degree 1, differs from them by no more than the
    /// tolerance: what is far for its size, which is nearly all that a telescope sees. Gives that difference.
    fn few(
        &mut self,
        task: &mut Task<'_>,
        triangle: [P2; 3],
        sign: f64,
        out: &mut [f64],
    ) -> Option<f64> {
        if longest_edge(triangle) > task.smooth_m {
            return None;
        }
        self.sums.clear();
        self.sums.resize(2 * out.len(), 0.0);
        let (fine, coarse) = self.sums.split_at_mut(out.len());
        const THIRD: f64 = 1.0 / 3.0;
        points(task, triangle, sign, &[(1.0, THIRD, THIRD)], coarse);
        points(
            task,
            triangle,
            sign,
            &[(THIRD, 0.5, 0.5), (THIRD, 0.5, 0.0), (THIRD, 0.0, 0.5)],
            fine,
        );
        let error: f64 = fine.iter().zip(coarse).map(|(f, c)| (f - *c).abs()).sum();
        let size: f64 = fine.iter().map(|f| f.abs()).sum();
        let area = double_area(triangle).abs() * 0.5;
        let limit = task.tolerance * size.max(WORTH * area);
        (error * area <= limit * area + ROUNDING * task.facet_area * size).then(|| {
            out.iter_mut().zip(fine).for_each(|(o, f)| *o += *f);
            error
        })
    }
}

/// Twice the area of a triangle, with the sign of its sense.
fn double_area([a, b, c]: [P2; 3]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
}

fn longest_edge([a, b, c]: [P2; 3]) -> f64 {
    let edge = |p: P2, q: P2| (p[0] - q[0]).hypot(p[1] - q[1]);
    edge(a, b).max(edge(b, c)).max(edge(c, a))
}

fn rule(task: &mut Task<'_>, triangle: [P2; 3], sign: f64, out: &mut [f64]) {
    points(task, triangle, sign, &RULE, out);
}

/// Adds a rule's points: weights and first two coordinates of area.
fn points(
    task: &mut Task<'_>,
    triangle: [P2; 3],
    sign: f64,
    rule: &[(f64, f64, f64)],
    out: &mut [f64],
) {
    let area = 0.5 * double_area(triangle);
    let [a, b, c] = triangle;
    for &(weight, p, q) in rule {
        let r = 1.0 - p - q;
        let (x, y) = (p * a[0] + q * b[0] + r * c[0], p * a[1] + q * b[1] + r * c[1]);
        let to = task.at - DVec3::new(x, y, 0.0);
        let range_squared = to.length_squared();
        let to = to / range_squared.sqrt();
        let scale = sign * weight * area * task.range_squared / range_squared;
        (task.weigh)(to, scale * to.z, out);
    }
}

fn refine(
    task: &mut Task<'_>,
    [a, b, c]: [P2; 3],
    sign: f64,
    (coarse, per_area): (&[f64], f64),
    depth: u32,
    out: &mut [f64],
) -> f64 {
    let middle = |p: P2, q: P2| [0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1])];
    let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
    let parts = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]];
    let mut fine = vec![0.0; 5 * coarse.len()];
    let (total, each) = fine.split_at_mut(coarse.len());
    for (part, sums) in parts.iter().zip(each.chunks_mut(coarse.len())) {
        rule(task, *part, sign, sums);
        total.iter_mut().zip(sums).for_each(|(t, s)| *t += *s);
    }
    let error: f64 = total.iter().zip(coarse).map(|(f, c)| (f - c).abs()).sum();
    let size: f64 = total.iter().map(|f| f.abs()).sum();
    let area = 0.5 * double_area([a, b, c]).abs();
    // The first estimate is that of the whole triangle: too small at worst, where a lobe lies between its points.
    let per_area = if depth == 0 { WORTH.max(size / area.max(1e-300)) } else { per_area };
    let worth = size.max(per_area * area);
    let limit = task.tolerance * area * worth + ROUNDING * task.facet_area * size;
    let long = parts.iter().any(|part| longest_edge(*part) > task.longest_m);
    if (error * area <= limit && !long) || depth == DEPTH {
        out.iter_mut().zip(total).for_each(|(o, t)| *o += *t);
        return error;
    }
    parts
        .iter()
        .zip(each.chunks(coarse.len()))
        .map(|(part, sums)| refine(task, *part, sign, (sums, per_area), depth + 1, out))
        .sum()
}
