//! Obstacles between a part of a curved surface and the Sun or the observer.

use super::outline::Outline;
use crate::light::clip::{P2, Polygons};
use crate::light::geometry::Geometry;
use crate::light::occlude::{Kind, Plane, Room, Toward};
use crate::light::scene::Scene;
use glam::DVec3;

/// Numbers of occluders.
pub type Candidates = Vec<u32>;

/// A scene at one moment, with the outlines of its curved bodies towards the Sun and towards the observer.
#[derive(Debug, Clone, Copy)]
pub struct Sight<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Places of the scene's facets and occluders.
    pub now: &'a Geometry,
    /// For each curved part, towards the Sun and towards the observer.
    pub outlines: &'a [Vec<Outline>; 2],
}

/// State of the light between a ball and a direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fate {
    /// Nothing is in its way.
    Free,
    /// All of it is stopped.
    Dark,
    /// Something may be in its way.
    Mixed,
}

impl Sight<'_> {
    /// Appends the shadow of occluder `k` on a plane; `side` 0 towards the Sun, 1 towards the observer.
    pub fn cast(
        &self,
        k: usize,
        plane: &Plane,
        toward: Toward,
        side: usize,
        room: &mut Room,
        out: &mut Polygons,
    ) -> bool {
        let (scene, now) = (self.scene, self.now);
        let occluder = &scene.occluders[k];
        let corners = &now.corners[occluder.corners.clone()];
        match &occluder.kind {
            Kind::Solid(edges) => plane.shadow(corners, Some(edges), room, out),
            Kind::Sphere => plane.sphere(now.middle[k], occluder.radius, toward, room, out),
            Kind::Outline(number) => {
                let outline = &self.outlines[side][*number as usize];
                let Some(form) = &scene.rounds[*number as usize].outline else { return false };
                if plane.height(now.middle[k]) > occluder.radius && matches!(toward, Toward::Far(_))
                {
                    plane.shadow(&outline.ring, Some(&[]), room, out)
                } else {
                    plane.shadow(&outline.solid, Some(&form.edges), room, out)
                }
            }
            Kind::Leaving | Kind::Sheet => {
                let leaves = now.facing[k].dot(toward.from(corners[0]));
                let hides = match occluder.kind {
                    Kind::Leaving => leaves > 0.0,
                    _ => leaves != 0.0,
                };
                hides && plane.shadow(corners, None, room, out)
            }
        }
    }

    /// Sifts the occluders `from`: those that may stand between a ball and a direction go to `keep`.
    #[expect(
        clippy::too_many_arguments,
        reason = "a ball, a direction, and where to put what is found"
    )]
    pub fn sift(
        &self,
        middle: DVec3,
        radius: f64,
        toward: Toward,
        side: usize,
        from: &[u32],
        room: &mut Room,
        keep: &mut Candidates,
    ) -> Fate {
        keep.clear();
        let (scene, now) = (self.scene, self.now);
        let direction = toward.from(middle);
        let (u, v) = direction.any_orthonormal_pair();
        let plane = |height: f64| {
            let origin = middle + height * direction;
            Plane::at(origin, direction, [u, v], toward, scene.touching_m)
        };
        let (below, above) = (plane(-radius), plane(radius));
        // The radius at which the ball's outline meets the lower plane, seen from a point.
        let wide = match toward {
            Toward::Far(_) => radius,
            Toward::Near(q) => {
                let away = (q - middle).length();
                if away <= radius {
                    keep.extend_from_slice(from);
                    return if from.is_empty() { Fate::Free } else { Fate::Mixed };
                }
                (away + radius) * radius / (away * away - radius * radius).sqrt()
            }
        };
        let mut polygon = Polygons::default();
        for &k in from {
            let occluder = &scene.occluders[k as usize];
            if misses(now.middle[k as usize] - middle, occluder.radius, radius, toward, middle) {
                continue;
            }
            polygon.clear();
            if !self.cast(k as usize, &below, toward, side, room, &mut polygon) {
                continue;
            }
            let nearest = inside(polygon.get(0));
            if nearest <= -wide {
                continue;
            }
            if nearest >= wide {
                polygon.clear();
                let beyond = self.cast(k as usize, &above, toward, side, room, &mut polygon);
                if beyond && inside(polygon.get(0)) >= wide {
                    return Fate::Dark;
                }
            }
            keep.push(k);
        }
        if keep.is_empty() { Fate::Free } else { Fate::Mixed }
    }
}

/// How far the origin lies inside of a convex polygon; outside: minus the largest distance from an edge's line.
fn inside(polygon: &[P2]) -> f64 {
    let mut least = f64::INFINITY;
    for k in 0..polygon.len() {
        let (a, b) = (polygon[k], polygon[(k + 1) % polygon.len()]);
        let (x, y) = (a[1] - b[1], b[0] - a[0]);
        let length = x.hypot(y);
        if length > 0.0 {
            least = least.min(-(x * a[0] + y * a[1]) / length);
        }
    }
    least
}

/// Whether an occluder's ball cannot stand between another ball and where its light goes.
pub fn misses(away: DVec3, other: f64, radius: f64, toward: Toward, middle: DVec3) -> bool {
    let reach = radius + other;
    match toward {
        Toward::Far(d) => {
            let along = away.dot(d);
            along < -reach || away.length_squared() - along * along > reach * reach
        }
        Toward::Near(q) => {
            let eye = q - middle;
            let range = eye.length();
            let along = away.dot(eye / range);
            along < -reach
                || along > range + reach
                || away.length_squared() - along * along > reach * reach
        }
    }
}
