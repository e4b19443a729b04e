//! The surfaces of a scene as rays meet them: convex polygons and spheres, in their places at some angles of the hinges.

use crate::light::Scene;
use crate::light::clip::P2;
use crate::light::geometry::Motion;
use crate::light::occlude::Kind;
use glam::DVec3;
use std::f64::consts::PI;

/// A surface.
#[derive(Debug, Clone)]
pub struct Surface {
    /// The facet's number in the scene; for a sphere that of the sphere.
    pub number: usize,
    /// Index of the material.
    pub material: usize,
    /// The group that it moves with (0: the body, else hinge + 1).
    pub group: usize,
    /// Area of the surface, m².
    pub area: f64,
    /// A point of it (of a sphere the middle), m.
    pub origin: DVec3,
    /// Unit normal, and the material's axes in the plane.
    pub normal: DVec3,
    pub tangent: DVec3,
    pub bitangent: DVec3,
    /// Radius about the origin, m.
    pub radius: f64,
    pub shape: Outline,
    /// Whether it belongs to an open sheet: its back can be met from outside.
    pub sheet: bool,
}

/// Outline of a surface.
#[derive(Debug, Clone)]
pub enum Outline {
    /// Corners in the plane's axes.
    Polygon(Vec<P2>),
    Sphere,
}

/// A point of a surface with what lies about it.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    pub surface: usize,
    pub at: DVec3,
    pub normal: DVec3,
    tangent: DVec3,
    bitangent: DVec3,
}

impl Place {
    /// A direction in the surface's own axes.
    pub fn local(&self, d: DVec3) -> DVec3 {
        DVec3::new(d.dot(self.tangent), d.dot(self.bitangent), d.dot(self.normal))
    }

    /// A direction in the body's axes.
    pub fn body(&self, d: DVec3) -> DVec3 {
        d.x * self.tangent + d.y * self.bitangent + d.z * self.normal
    }
}

impl Surface {
    /// The corners of a polygon, m; none of a sphere.
    pub fn corners(&self) -> impl Iterator<Item = DVec3> + '_ {
        let flat: &[P2] = match &self.shape {
            Outline::Polygon(corners) => corners,
            Outline::Sphere => &[],
        };
        flat.iter().map(|p| self.point(*p))
    }

    /// A point of the plane.
    pub fn point(&self, p: P2) -> DVec3 {
        self.origin + p[0] * self.tangent + p[1] * self.bitangent
    }

    /// Whether it is round.
    pub fn is_sphere(&self) -> bool {
        matches!(self.shape, Outline::Sphere)
    }

    /// The greatest height of `other` above this surface's plane, m; above a sphere's middle plane towards it.
    pub fn highest(&self, other: &Surface) -> f64 {
        if self.is_sphere() {
            return (other.origin - self.origin).length() + other.radius - self.radius;
        }
        let height = |p: DVec3| (p - self.origin).dot(self.normal);
        if other.is_sphere() {
            return height(other.origin) + other.radius;
        }
        other.corners().map(height).fold(f64::NEG_INFINITY, f64::max)
    }

    /// Returns a point of the surface with its normal and tangents.
    pub fn place(&self, surface: usize, at: DVec3) -> Place {
        if self.is_sphere() {
            let normal = (at - self.origin).normalize_or(DVec3::Z);
            let (tangent, bitangent) = normal.any_orthonormal_pair();
            return Place { surface, at, normal, tangent, bitangent };
        }
        let (normal, tangent, bitangent) = (self.normal, self.tangent, self.bitangent);
        Place { surface, at, normal, tangent, bitangent }
    }

    /// A point spread evenly over the area by two numbers from 0 to 1.
    pub(crate) fn even(&self, surface: usize, [a, b]: [f64; 2]) -> Place {
        match &self.shape {
            Outline::Polygon(corners) => {
                self.place(surface, self.point(in_polygon(corners, self.area, a, b)))
            }
            Outline::Sphere => {
                let z = 1.0 - 2.0 * a;
                let (sin, cos) = (2.0 * PI * b).sin_cos();
                let across = (1.0 - z * z).max(0.0).sqrt();
                let out = DVec3::new(across * cos, across * sin, z);
                self.place(surface, self.origin + self.radius * out)
            }
        }
    }

    /// Returns the projected area of the surface across a direction, before anything hides it, m².
    pub fn across(&self, toward: DVec3) -> f64 {
        match self.shape {
            Outline::Polygon(_) => self.area * self.normal.dot(toward).max(0.0),
            Outline::Sphere => PI * self.radius * self.radius,
        }
    }

    /// A point spread evenly over [`Surface::across`].
    pub(crate) fn facing(&self, surface: usize, toward: DVec3, [a, b]: [f64; 2]) -> Place {
        if !self.is_sphere() {
            return self.even(surface, [a, b]);
        }
        let (x, y) = toward.any_orthonormal_pair();
        let (sin, cos) = (2.0 * PI * b).sin_cos();
        let across = a.sqrt();
        let out = across * (cos * x + sin * y) + (1.0 - a).max(0.0).sqrt() * toward;
        self.place(surface, self.origin + self.radius * out)
    }
}

/// A point of a convex polygon: the first number picks a triangle of its fan, and what is left of it the place.
pub fn in_polygon(corners: &[P2], area: f64, a: f64, b: f64) -> P2 {
    let [x, y] = corners[0];
    let mut left = a * area;
    let last = corners.len() - 2;
    for (k, w) in corners[1..].windows(2).enumerate() {
        let (e, f) = ([w[0][0] - x, w[0][1] - y], [w[1][0] - x, w[1][1] - y]);
        let part = 0.5 * (e[0] * f[1] - e[1] * f[0]);
        if left < part || k + 1 == last {
            let s = (left / part).clamp(0.0, 1.0).sqrt();
            let t = s * b;
            return [x + (s - t) * e[0] + t * f[0], y + (s - t) * e[1] + t * f[1]];
        }
        left -= part;
    }
    corners[0]
}

/// All surfaces of a scene, at some angles of the hinges.
#[derive(Debug, Clone)]
pub struct Surfaces {
    base: Vec<Surface>,
    pub list: Vec<Surface>,
    angles: Vec<f64>,
}

impl Surfaces {
    /// At angle 0.
    pub fn new(scene: &Scene) -> Self {
        let now = &scene.geometry;
        let mut base = Vec::new();
        let sheets: std::collections::HashSet<u32> = scene
            .occluders
            .iter()
            .filter(|o| matches!(o.kind, Kind::Sheet))
            .map(|o| o.component)
            .collect();
        for (i, facet) in scene.facets.iter().enumerate() {
            base.push(Surface {
                number: i,
                material: facet.material as usize,
                group: facet.group as usize,
                area: facet.area,
                origin: now.origin[i],
                normal: now.normal[i],
                tangent: now.tangent[i],
                bitangent: now.bitangent[i],
                radius: facet.radius,
                shape: Outline::Polygon(scene.outlines.get(i).to_vec()),
                sheet: sheets.contains(&facet.component),
            });
        }
        for (number, round) in scene.rounds.iter().enumerate() {
            // Other curved parts stand here as facets (see [`super::stand_in`]).
            let Some(radius) = round.sphere else { continue };
            base.push(Surface {
                number,
                material: round.material as usize,
                group: round.group,
                area: 4.0 * PI * radius * radius,
                origin: now.place[number].point(round.middle),
                normal: DVec3::Z,
                tangent: DVec3::X,
                bitangent: DVec3::Y,
                radius,
                shape: Outline::Sphere,
                sheet: false,
            });
        }
        Self { list: base.clone(), base, angles: vec![0.0; scene.hinges.len()] }
    }

    /// The materials of some surfaces, each once, increasing.
    pub fn materials(&self, of: impl Iterator<Item = usize>) -> Vec<usize> {
        let mut all: Vec<usize> = of.map(|k| self.list[k].material).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Turns hinged surfaces to the Sun; whether anything moved.
    pub fn turn(&mut self, scene: &Scene, sun: DVec3) -> bool {
        let mut moved = false;
        for (h, hinge) in scene.hinges.iter().enumerate() {
            let angle = hinge.angle_rad(sun);
            if angle == self.angles[h] {
                continue;
            }
            self.angles[h] = angle;
            moved = true;
            let motion = Motion::about(hinge.point_m, hinge.axis, angle);
            let both = self.list.iter_mut().zip(&self.base);
            for (now, base) in both.filter(|s| s.1.group == h + 1) {
                now.origin = motion.point(base.origin);
                now.normal = motion.vector(base.normal);
                now.tangent = motion.vector(base.tangent);
                now.bitangent = motion.vector(base.bitangent);
            }
        }
        moved
    }
}
