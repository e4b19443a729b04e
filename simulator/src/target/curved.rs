//! Curved shapes that stand for themselves, not for triangles.

use crate::mesh::Mesh;
use glam::DVec3;
use std::f64::consts::TAU;

/// Corners around a circle where a curved shape is written as triangles.
const AROUND: u32 = 256;
/// Rings of triangles of a dish.
const RINGS: u32 = 64;

/// A curved shape in the part's own axes, about z.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Curved {
    /// A cylinder or a cone with its flat ends, about its middle: closed.
    Frustum {
        /// Radius at −height/2, m.
        bottom_radius_m: f64,
        /// Radius at +height/2, m; 0 for a cone with a tip.
        top_radius_m: f64,
        /// m.
        height_m: f64,
    },
    /// A bowl without thickness, its lowest point at the origin, open towards +z.
    Dish {
        /// Radius of its rim, m.
        radius_m: f64,
        /// Height of its rim, m.
        depth_m: f64,
        /// Surface that the dish is a part of.
        form: DishForm,
        /// Whether its inside reflects.
        inside: bool,
        /// Whether its outside reflects.
        outside: bool,
    },
}

/// Surface that a dish is a part of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DishForm {
    /// z = r²/4f with f = radius²/(4 depth).
    #[default]
    Paraboloid,
    /// A sphere of radius (radius² + depth²)/(2 depth); at most half of it.
    Sphere,
}

impl Curved {
    /// The size of its bounding box, m.
    pub fn size_m(&self) -> DVec3 {
        match *self {
            Self::Frustum { bottom_radius_m, top_radius_m, height_m } => {
                let width = 2.0 * bottom_radius_m.max(top_radius_m);
                DVec3::new(width, width, height_m)
            }
            Self::Dish { radius_m, depth_m, .. } => {
                DVec3::new(2.0 * radius_m, 2.0 * radius_m, depth_m)
            }
        }
    }

    /// The height of its middle over the part's origin, m.
    pub fn middle_m(&self) -> f64 {
        match *self {
            Self::Frustum { .. } => 0.0,
            Self::Dish { depth_m, .. } => 0.5 * depth_m,
        }
    }

    /// Fine triangles with its normals, corners on the surface: for other programs and for people to look at.
    pub fn mesh(&self) -> Mesh {
        self.faceted(AROUND, RINGS)
    }

    /// The same with so many corners around, and rings of a dish.
    pub(crate) fn faceted(&self, around: u32, rings: u32) -> Mesh {
        match *self {
            Self::Frustum { bottom_radius_m: low, top_radius_m: high, height_m } => {
                let mut mesh = Mesh::default();
                let lean = (low - high) / height_m;
                let half = 0.5 * height_m;
                strip(&mut mesh, (low, -half), (high, half), [lean, lean], true, around);
                for (radius, z, up) in [(high, half, true), (low, -half, false)] {
                    if radius > 0.0 {
                        end(&mut mesh, radius, z, up, around);
                    }
                }
                mesh
            }
            Self::Dish { radius_m, depth_m, form, inside, outside } => {
                let mut mesh = Mesh::default();
                let height = |r: f64| match form {
                    DishForm::Paraboloid => depth_m * (r / radius_m).powi(2),
                    DishForm::Sphere => {
                        let ball = cap_radius_m(radius_m, depth_m);
                        // ball − √(ball² − r²) without cancellation.
                        r * r / (ball + ((ball - r) * (ball + r)).max(0.0).sqrt())
                    }
                };
                let slope = |r: f64| match form {
                    DishForm::Paraboloid => 2.0 * depth_m * r / (radius_m * radius_m),
                    DishForm::Sphere => {
                        let ball = cap_radius_m(radius_m, depth_m);
                        r / ((ball - r) * (ball + r)).max(1e-30 * ball * ball).sqrt()
                    }
                };
                for (wanted, out) in [(inside, false), (outside, true)] {
                    for k in 0..if wanted { rings } else { 0 } {
                        let [a, b] = [k, k + 1].map(|k| radius_m * f64::from(k) / f64::from(rings));
                        // Outward is down: z falls by 1 where the radius gains the slope.
                        let lean = [a, b].map(|r| -1.0 / slope(r).max(1e-12));
                        strip(&mut mesh, (a, height(a)), (b, height(b)), lean, out, around);
                    }
                }
                mesh
            }
        }
    }
}

/// The radius of the sphere that a cap is a part of.
pub(crate) fn cap_radius_m(radius_m: f64, depth_m: f64) -> f64 {
    0.5 * (radius_m * radius_m / depth_m + depth_m)
}

/// The surface between two circles (radius, height), with what its outward normals rise by per length outward.
fn strip(
    mesh: &mut Mesh,
    low: (f64, f64),
    high: (f64, f64),
    lean: [f64; 2],
    out: bool,
    around: u32,
) {
    let first = mesh.vertices.len() as u32;
    let sign = if out { 1.0 } else { -1.0 };
    for k in 0..around {
        let (sin, cos) = (TAU * f64::from(k) / f64::from(around)).sin_cos();
        for ((radius, z), lean) in [low, high].into_iter().zip(lean) {
            mesh.vertices.push(DVec3::new(radius * cos, radius * sin, z));
            mesh.normals.push(sign * DVec3::new(cos, sin, lean).normalize());
        }
    }
    for k in 0..around {
        let [a, b] = [k, (k + 1) % around].map(|k| first + 2 * k);
        let mut push = |t: [u32; 3]| mesh.triangles.push(if out { t } else { [t[0], t[2], t[1]] });
        if low.0 > 0.0 {
            push([a, b, b + 1]);
        }
        if high.0 > 0.0 {
            push([a, b + 1, a + 1]);
        }
    }
}

/// A flat end.
fn end(mesh: &mut Mesh, radius: f64, z: f64, up: bool, around: u32) {
    let first = mesh.vertices.len() as u32;
    let normal = if up { DVec3::Z } else { DVec3::NEG_Z };
    for k in 0..around {
        let (sin, cos) = (TAU * f64::from(k) / f64::from(around)).sin_cos();
        mesh.vertices.push(DVec3::new(radius * cos, radius * sin, z));
        mesh.normals.push(normal);
    }
    for k in 1..around - 1 {
        let (a, b) = (first + k, first + k + 1);
        mesh.triangles.push(if up { [first, a, b] } else { [first, b, a] });
    }
}
