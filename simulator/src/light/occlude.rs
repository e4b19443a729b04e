//! The shadow of an occluder on a facet's plane.

use super::View;
use super::clip::{P2, Polygons, hull};
use super::evaluate::DirectionError;
use super::geometry::Geometry;
use glam::DVec3;
use std::ops::Range;

/// Occluder: a body or face that may hide others.
#[derive(Debug, Clone)]
pub struct Occluder {
    /// Corners of the occluder in [`Geometry::corners`].
    pub corners: Range<usize>,
    /// Radius of its ball, m.
    pub radius: f64,
    /// The component that it belongs to.
    pub component: u32,
    /// The group (0: the body, else hinge + 1) that it moves with.
    pub group: usize,
    /// Which it is.
    pub kind: Kind,
}

/// Kinds of occluders.
#[derive(Debug, Clone)]
pub enum Kind {
    /// A convex body with its edges, as pairs of its corners.
    Solid(Vec<(u16, u16)>),
    /// A facet of a closed body: hides where it is left.
    Leaving,
    /// A facet of an open sheet: hides with both sides.
    Sheet,
    /// A sphere.
    Sphere,
    /// The curved part of this number, by its outline.
    Outline(u32),
}

/// Where the light goes to.
#[derive(Debug, Clone, Copy)]
pub enum Toward {
    /// A direction.
    Far(DVec3),
    /// A point, m.
    Near(DVec3),
}

impl Toward {
    /// The unit direction from a point.
    pub fn from(&self, p: DVec3) -> DVec3 {
        match self {
            Toward::Far(d) => *d,
            Toward::Near(q) => (*q - p).normalize_or_zero(),
        }
    }
}

/// A direction of length 1.
pub fn unit(what: &'static str, value: DVec3) -> Result<DVec3, DirectionError> {
    value.try_normalize().ok_or(DirectionError::NoDirection { what, value })
}

/// Where a view's light goes.
pub fn toward(view: View) -> Result<Toward, DirectionError> {
    Ok(match view {
        View::Distant(d) => Toward::Far(unit("the direction of the observer", d)?),
        View::At(q) => {
            unit("the place of the observer", q)?;
            Toward::Near(q)
        }
    })
}

/// A facet's plane and how points above it are thrown onto it.
#[derive(Debug, Clone, Copy)]
pub struct Plane {
    origin: DVec3,
    normal: DVec3,
    axes: [DVec3; 2],
    throw: Throw,
    touching: f64,
}

#[derive(Debug, Clone, Copy)]
enum Throw {
    Far([f64; 2]),
    Near([f64; 2], f64),
}

impl Plane {
    /// Creates the plane of facet `i`, for light that goes `toward`; heights below `touching` count as 0.
    pub fn new(now: &Geometry, i: usize, toward: Toward, touching: f64) -> Self {
        let axes = [now.tangent[i], now.bitangent[i]];
        Self::at(now.origin[i], now.normal[i], axes, toward, touching)
    }

    /// Creates any plane.
    pub fn at(
        origin: DVec3,
        normal: DVec3,
        axes: [DVec3; 2],
        toward: Toward,
        touching: f64,
    ) -> Self {
        let throw = match toward {
            Toward::Far(d) => {
                let cos = d.dot(normal);
                Throw::Far([d.dot(axes[0]) / cos, d.dot(axes[1]) / cos])
            }
            Toward::Near(q) => {
                let q = q - origin;
                Throw::Near([q.dot(axes[0]), q.dot(axes[1])], q.dot(normal))
            }
        };
        Self { origin, normal, axes, throw, touching }
    }

    /// How high a point stands above the plane.
    pub fn height(&self, p: DVec3) -> f64 {
        (p - self.origin).dot(self.normal)
    }

    /// The cosine of the angle at which light meets the plane, about its origin.
    pub fn cos(&self, toward: Toward) -> f64 {
        toward.from(self.origin).dot(self.normal)
    }

    /// Coordinates in the plane, and height above it.
    pub fn local(&self, p: DVec3) -> [f64; 3] {
        let p = p - self.origin;
        let height = p.dot(self.normal);
        let height = if height.abs() <= self.touching { 0.0 } else { height };
        [p.dot(self.axes[0]), p.dot(self.axes[1]), height]
    }

    /// Where a point, in these coordinates, is thrown to.
    pub fn thrown(&self, p: [f64; 3]) -> P2 {
        match self.throw {
            Throw::Far(k) => [p[0] - p[2] * k[0], p[1] - p[2] * k[1]],
            Throw::Near(q, height) => {
                let scale = height / (height - p[2]);
                [q[0] + (p[0] - q[0]) * scale, q[1] + (p[1] - q[1]) * scale]
            }
        }
    }

    /// Below this height things stand before the eye.
    fn top(&self) -> f64 {
        match self.throw {
            Throw::Far(_) => f64::INFINITY,
            // What is nearer to the eye than a millionth of its height is not looked at.
            Throw::Near(_, height) => height * (1.0 - 1e-6),
        }
    }

    /// Appends the shadow of a convex set of points, if it has any above the plane. `ring`: corners in order, else the edges.
    pub fn shadow(
        &self,
        corners: &[DVec3],
        edges: Option<&[(u16, u16)]>,
        room: &mut Room,
        out: &mut Polygons,
    ) -> bool {
        let local = &mut room.local;
        local.clear();
        local.extend(corners.iter().map(|p| self.local(*p)));
        let (low, high) = local
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), p| (a.min(p[2]), b.max(p[2])));
        let top = self.top();
        if !(high > 0.0 && low < top) {
            return false;
        }
        let points = &mut room.points;
        points.clear();
        let inside = |h: f64| (0.0..=top).contains(&h);
        let crossing = |a: [f64; 3], b: [f64; 3], at: f64| {
            let crosses = (a[2] < at && b[2] > at) || (a[2] > at && b[2] < at);
            crosses.then(|| {
                let t = (at - a[2]) / (b[2] - a[2]);
                self.thrown([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), at])
            })
        };
        let whole = low >= 0.0 && high <= top;
        match edges {
            Some(edges) => {
                if !whole {
                    for &(a, b) in edges {
                        let (a, b) = (local[a as usize], local[b as usize]);
                        points.extend(crossing(a, b, 0.0));
                        points.extend(crossing(a, b, top));
                    }
                }
                points.extend(local.iter().filter(|p| inside(p[2])).map(|p| self.thrown(*p)));
                out.push_with(|ring| hull(points, ring))
            }
            None => {
                for k in 0..local.len() {
                    let (a, b) = (local[(k + local.len() - 1) % local.len()], local[k]);
                    if !whole {
                        let (first, second) = if a[2] < b[2] { (0.0, top) } else { (top, 0.0) };
                        points.extend(crossing(a, b, first));
                        points.extend(crossing(a, b, second));
                    }
                    if inside(b[2]) {
                        points.push(self.thrown(b));
                    }
                }
                if points.len() < 3 {
                    return false;
                }
                if super::clip::area(points) < 0.0 {
                    points.reverse();
                }
                out.push(points);
                true
            }
        }
    }

    /// Appends the shadow of a sphere, as a polygon of `corners` corners of the same area as the round one.
    pub fn sphere(
        &self,
        middle: DVec3,
        radius: f64,
        toward: Toward,
        room: &mut Room,
        out: &mut Polygons,
    ) -> bool {
        const CORNERS: usize = 256;
        let height = (middle - self.origin).dot(self.normal);
        if height + radius <= self.touching {
            return false;
        }
        let turn = std::f64::consts::TAU / CORNERS as f64;
        // Inscribed polygons are too small: (turn/sin turn)^(1/2) makes their area right.
        let radius = radius * (turn / turn.sin()).sqrt();
        // The outline: a great circle seen from afar, a smaller one seen from near.
        let (axis, centre, rim) = match toward {
            Toward::Far(d) => (d, middle, radius),
            Toward::Near(q) => {
                let away = q - middle;
                let cos = (radius / away.length()).min(1.0);
                let d = away.normalize_or_zero();
                (d, middle + d * (radius * cos), radius * (1.0 - cos * cos).sqrt())
            }
        };
        let points = &mut room.points;
        points.clear();
        let top = self.top();
        let mut circle = |axis: DVec3, centre: DVec3, rim: f64, in_plane: bool| {
            let (x, y) = axis.any_orthonormal_pair();
            for k in 0..CORNERS {
                let (sin, cos) = (turn * k as f64).sin_cos();
                let mut p = self.local(centre + rim * (x * cos + y * sin));
                if in_plane {
                    p[2] = 0.0;
                }
                if p[2] >= 0.0 && p[2] <= top {
                    points.push(self.thrown(p));
                }
            }
        };
        circle(axis, centre, rim, false);
        if height.abs() < radius {
            let rim = (radius * radius - height * height).sqrt();
            circle(self.normal, middle - height * self.normal, rim, true);
        }
        out.push_with(|ring| hull(points, ring))
    }
}

/// Room for the work of [`Plane`].
#[derive(Debug, Default)]
pub struct Room {
    local: Vec<[f64; 3]>,
    points: Vec<P2>,
}
