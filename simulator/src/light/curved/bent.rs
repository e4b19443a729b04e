//! Triangles that are bent by the normals at their corners.
//!
//! The surface is the cubic triangle through the corners across the normals (Vlachos, Peters, Boyd and Mitchell 2001, "Curved PN triangles").
//! Normals and areas are that surface's own: ∫ w cosθ_i cosθ_o dA is taken over one surface, so that a cosine and an area never come from
//! two different ones. What other parts hide is found on the flat triangle, and taken as the share of the bent one with the same
//! coordinates.
//!
//! Near the terminator the flat triangle may look away where the bent one does not. Such a triangle of a convex body counts, since a convex
//! body hides nothing of itself; of another body half of it counts, with the other half as the error: the strip is as wide as a triangle
//! and its light falls off linearly, so that both go with the square of the triangles' size.

use crate::light::clip::{self, P2};
use crate::light::near::RULE;
use crate::light::occlude::Toward;
use crate::surface::Material;
use glam::DVec3;

/// Halvings at most.
const DEPTH: u32 = 8;

/// A bent triangle in its facet's axes.
#[derive(Debug, Clone)]
pub struct Patch {
    /// The ten control points: three of the corners, six of the edges, the middle, m.
    control: [DVec3; 10],
    corners: [P2; 3],
    /// Twice the flat area.
    twice: f64,
}

/// Integral to compute, in the facet's axes.
pub struct Task<'a> {
    /// The triangle.
    pub patch: &'a Patch,
    /// The material.
    pub material: &'a Material,
    /// Towards the Sun.
    pub sun: DVec3,
    /// The observer: a direction or a point of the facet's axes.
    pub eye: Toward,
    /// The square of the observer's distance from the body's origin, m².
    pub range_squared: f64,
    /// Absolute error, of what a white facet in the light would send, at which halving stops.
    pub tolerance: f64,
}

impl Patch {
    /// From corners in the plane z = 0 and unit normals there.
    pub fn new(corners: [P2; 3], normals: [DVec3; 3]) -> Self {
        let p = corners.map(|c| DVec3::new(c[0], c[1], 0.0));
        // Two thirds from corner k to corner l, in the plane across the normal at k.
        let edge = |k: usize, l: usize| {
            (2.0 * p[k] + p[l] - (p[l] - p[k]).dot(normals[k]) * normals[k]) / 3.0
        };
        let edges = [edge(0, 1), edge(1, 0), edge(1, 2), edge(2, 1), edge(2, 0), edge(0, 2)];
        let mean = edges.iter().sum::<DVec3>() / 6.0;
        let flat = p.iter().sum::<DVec3>() / 3.0;
        let [a, b, c, d, e, f] = edges;
        let control = [p[0], p[1], p[2], a, b, c, d, e, f, mean + 0.5 * (mean - flat)];
        Self { control, corners, twice: 2.0 * clip::area(&corners) }
    }

    /// The normal times dA per d(b) d(c), and the point, at the coordinates (1 − b − c, b, c).
    fn at(&self, b: f64, c: f64) -> (DVec3, DVec3) {
        let a = 1.0 - b - c;
        let [p0, p1, p2, e01, e10, e12, e21, e20, e02, m] = self.control;
        let point = a * a * a * p0
            + b * b * b * p1
            + c * c * c * p2
            + 3.0 * (a * a * (b * e01 + c * e02) + b * b * (a * e10 + c * e12))
            + 3.0 * c * c * (a * e20 + b * e21)
            + 6.0 * a * b * c * m;
        // A quadratic in each direction: control points less those of the first corner.
        let along = |to: [DVec3; 6]| {
            let from = [p0, e01, e02, e10, m, e20];
            let weight = [a * a, 2.0 * a * b, 2.0 * a * c, b * b, 2.0 * b * c, c * c];
            (0..6).map(|k| 3.0 * weight[k] * (to[k] - from[k])).sum::<DVec3>()
        };
        let by_b = along([e01, e10, m, p1, e12, e21]);
        let by_c = along([e02, m, e20, e12, e21, p2]);
        (by_b.cross(by_c), point)
    }

    /// Whether any of it may face a direction: by the normals at a few points, which bound those between them well enough for triangles
    /// that stand for a smooth surface.
    pub fn faces(&self, toward: Toward) -> bool {
        let third = 1.0 / 3.0;
        let points = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5)];
        points.into_iter().chain([(third, third)]).any(|(b, c)| {
            let (normal, point) = self.at(b, c);
            normal.dot(toward.from(point)) > 0.0
        })
    }

    /// b and c of a point of the plane.
    fn coordinates(&self, p: P2) -> [f64; 2] {
        let [o, x, y] = self.corners;
        let (dx, dy) = (p[0] - o[0], p[1] - o[1]);
        let (x, y) = ([x[0] - o[0], x[1] - o[1]], [y[0] - o[0], y[1] - o[1]]);
        [(dx * y[1] - dy * y[0]) / self.twice, (x[0] * dy - x[1] * dx) / self.twice]
    }
}

impl Task<'_> {
    /// Adds the integral over a convex polygon of the facet's plane; gives the error estimate of the sum.
    pub fn add(&self, polygon: &[P2], out: &mut [f64]) -> f64 {
        let corners: Vec<[f64; 2]> = polygon.iter().map(|p| self.patch.coordinates(*p)).collect();
        let mut error = 0.0;
        for pair in corners[1..].windows(2) {
            let triangle = [corners[0], pair[0], pair[1]];
            let mut coarse = vec![0.0; out.len()];
            self.rule(triangle, &mut coarse);
            error += self.refine(triangle, &coarse, 0, out);
        }
        error
    }

    fn rule(&self, [a, b, c]: [[f64; 2]; 3], out: &mut [f64]) {
        let area = clip::area(&[a, b, c]);
        for (weight, p, q) in RULE {
            let r = 1.0 - p - q;
            let at = |k: usize| p * a[k] + q * b[k] + r * c[k];
            let (normal, point) = self.patch.at(at(0), at(1));
            let length = normal.length();
            let (to, nearness) = match self.eye {
                Toward::Far(d) => (d, 1.0),
                Toward::Near(q) => {
                    let away = q - point;
                    let square = away.length_squared();
                    (away / square.sqrt(), self.range_squared / square)
                }
            };
            let normal = normal / length;
            let (cos_i, cos_o) = (normal.dot(self.sun), normal.dot(to));
            if !(cos_i > 0.0 && cos_o > 0.0) {
                continue;
            }
            // The facet's tangent, in the bent surface.
            let x = (DVec3::X - normal.x * normal).normalize_or(DVec3::X);
            let y = normal.cross(x);
            let local = |d: DVec3, cos: f64| DVec3::new(d.dot(x), d.dot(y), cos);
            let scale = weight * area * length * cos_i * cos_o * nearness;
            self.material.add_weights(local(self.sun, cos_i), local(to, cos_o), scale, out);
        }
    }

    fn refine(&self, [a, b, c]: [[f64; 2]; 3], coarse: &[f64], depth: u32, out: &mut [f64]) -> f64 {
        let middle = |p: P2, q: P2| [0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1])];
        let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
        let parts = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]];
        let mut fine = vec![0.0; 5 * coarse.len()];
        let (total, each) = fine.split_at_mut(coarse.len());
        for (part, sums) in parts.iter().zip(each.chunks_mut(coarse.len())) {
            self.rule(*part, sums);
            total.iter_mut().zip(sums).for_each(|(t, s)| *t += *s);
        }
        let apart: f64 = total.iter().zip(coarse).map(|(f, c)| (f - c).abs()).sum();
        // Coordinates have an area of a half; a part of the triangle has its part of the error.
        let share = 2.0 * clip::area(&[a, b, c]).abs();
        let white = 0.5 * self.patch.twice * std::f64::consts::FRAC_1_PI;
        if apart <= self.tolerance * white * share.sqrt() || depth == DEPTH {
            out.iter_mut().zip(total).for_each(|(o, t)| *o += *t);
            return apart;
        }
        parts
            .iter()
            .zip(each.chunks(coarse.len()))
            .map(|(part, sums)| self.refine(*part, sums, depth + 1, out))
            .sum()
    }
}
