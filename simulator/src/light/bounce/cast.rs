//! Rays: what a ray meets first. Boxes in a binary tree, halved at the middle of their widest axis.

use super::surfaces::{Outline, Surface};
use glam::DVec3;

/// Surfaces in a leaf at most.
const LEAF: usize = 4;
/// A polygon is met up to this far beyond its edges, of its radius: no ray slips through between neighbours.
const SLACK: f64 = 1e-12;

/// A ray from a point of a surface.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    pub from: DVec3,
    /// Unit vector.
    pub along: DVec3,
    /// The surface that it leaves, which it cannot meet again.
    pub leaves: usize,
}

/// Intersection of a ray with a surface.
#[derive(Debug, Clone, Copy)]
pub struct Hit {
    pub surface: usize,
    pub distance: f64,
    /// Whether from the front.
    pub front: bool,
}

/// Beginning of a ray inside of a closed body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Inside;

#[derive(Debug, Clone, Copy)]
struct Node {
    low: DVec3,
    high: DVec3,
    /// A leaf's first surface, or the second child (the first follows its parent).
    next: u32,
    /// How many surfaces; 0 within the tree.
    count: u32,
}

#[derive(Debug, Clone, Copy)]
struct Solid {
    /// Normal of a polygon; 0 for a sphere.
    normal: DVec3,
    origin: DVec3,
    tangent: DVec3,
    bitangent: DVec3,
    radius: f64,
    edges: (u32, u32),
    surface: u32,
}

/// Surfaces, sorted for rays.
#[derive(Debug, Clone, Default)]
pub struct Caster {
    nodes: Vec<Node>,
    solids: Vec<Solid>,
    /// Lines in the plane, positive inside.
    edges: Vec<[f64; 3]>,
    /// Nothing is met nearer than this, m.
    least: f64,
}

impl Caster {
    /// Creates an index of these surfaces for rays; surfaces nearer than `least_m` to where a ray begins are not met.
    pub fn new(surfaces: &[Surface], least_m: f64) -> Self {
        let mut caster = Self { least: least_m, ..Self::default() };
        let mut boxes = Vec::with_capacity(surfaces.len());
        for surface in surfaces {
            boxes.push(bounds(surface));
        }
        let mut order: Vec<u32> = (0..surfaces.len() as u32).collect();
        if !order.is_empty() {
            caster.split(&mut order, &boxes);
        }
        for &k in &order {
            caster.add(k, &surfaces[k as usize]);
        }
        caster
    }

    fn add(&mut self, number: u32, surface: &Surface) {
        let first = self.edges.len() as u32;
        let mut normal = DVec3::ZERO;
        if let Outline::Polygon(corners) = &surface.shape {
            normal = surface.normal;
            let slack = SLACK * surface.radius;
            for k in 0..corners.len() {
                let (a, b) = (corners[k], corners[(k + 1) % corners.len()]);
                let (x, y) = (a[1] - b[1], b[0] - a[0]);
                let length = x.hypot(y);
                if length > 0.0 {
                    let (x, y) = (x / length, y / length);
                    self.edges.push([x, y, slack - x * a[0] - y * a[1]]);
                }
            }
        }
        self.solids.push(Solid {
            normal,
            origin: surface.origin,
            tangent: surface.tangent,
            bitangent: surface.bitangent,
            radius: surface.radius,
            edges: (first, self.edges.len() as u32),
            surface: number,
        });
    }

    /// Appends the tree over `order` (that part of it which begins at the number of surfaces placed so far).
    fn split(&mut self, order: &mut [u32], boxes: &[(DVec3, DVec3)]) {
        let mut todo = vec![(0, order.len(), usize::MAX)];
        while let Some((first, end, parent)) = todo.pop() {
            let here = self.nodes.len();
            if parent != usize::MAX {
                self.nodes[parent].next = here as u32;
            }
            let part = &mut order[first..end];
            let (low, high) = part.iter().fold((DVec3::MAX, DVec3::MIN), |(l, h), k| {
                let (a, b) = boxes[*k as usize];
                (l.min(a), h.max(b))
            });
            if part.len() <= LEAF {
                let count = part.len() as u32;
                self.nodes.push(Node { low, high, next: first as u32, count });
                continue;
            }
            self.nodes.push(Node { low, high, next: 0, count: 0 });
            let size = high - low;
            let axis = (0..3).max_by(|a, b| size[*a].total_cmp(&size[*b])).unwrap_or(0);
            let middle = |k: &u32| {
                let (a, b) = boxes[*k as usize];
                a[axis] + b[axis]
            };
            let half = part.len() / 2;
            part.select_nth_unstable_by(half, |a, b| {
                middle(a).total_cmp(&middle(b)).then(a.cmp(b))
            });
            // The first child is looked at next: it follows its parent.
            todo.push((first + half, end, here));
            todo.push((first, first + half, usize::MAX));
        }
    }

    /// Returns the first surface that a ray meets.
    pub fn first(&self, ray: &Ray) -> Option<Hit> {
        let mut found: Option<Hit> = None;
        self.walk(ray, |hit| {
            if found.is_none_or(|f| hit.distance < f.distance) {
                found = Some(hit);
            }
            found.map_or(f64::INFINITY, |f| f.distance)
        });
        found
    }

    /// Whether a ray meets anything nearer than `most` (m).
    pub fn is_blocked(&self, ray: &Ray, most: f64) -> bool {
        let mut blocked = false;
        self.walk(ray, |hit| {
            blocked |= hit.distance < most;
            if blocked { f64::NEG_INFINITY } else { most }
        });
        blocked
    }

    /// Returns what [`Caster::first`] does, unless the ray leaves more closed bodies than it enters: then it began inside of one, and there is [`Inside`].
    pub fn first_outside(
        &self,
        ray: &Ray,
        closed: impl Fn(usize) -> bool,
    ) -> Result<Option<Hit>, Inside> {
        let (mut left, mut found) = (0_i64, None::<Hit>);
        self.walk(ray, |hit| {
            if closed(hit.surface) {
                left += if hit.front { -1 } else { 1 };
            }
            if found.is_none_or(|f| hit.distance < f.distance) {
                found = Some(hit);
            }
            f64::INFINITY
        });
        if left > 0 { Err(Inside) } else { Ok(found) }
    }

    /// Looks at all that may be met; `see` says up to which distance more is wanted.
    fn walk(&self, ray: &Ray, mut see: impl FnMut(Hit) -> f64) {
        if self.nodes.is_empty() {
            return;
        }
        let inverse = ray.along.recip();
        let mut most = f64::INFINITY;
        let mut stack = [0_u32; 64];
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let number = stack[depth] as usize;
            let node = &self.nodes[number];
            if !meets(node, ray.from, inverse, most) {
                continue;
            }
            if node.count == 0 {
                // Of the halves of a million surfaces there are some twenty, one within the other.
                stack[depth] = node.next;
                stack[depth + 1] = number as u32 + 1;
                depth += 2;
                continue;
            }
            for solid in &self.solids[node.next as usize..(node.next + node.count) as usize] {
                if solid.surface as usize == ray.leaves {
                    continue;
                }
                if let Some(hit) = self.meet(solid, ray, most) {
                    most = most.min(see(hit));
                    if most == f64::NEG_INFINITY {
                        return;
                    }
                }
            }
        }
    }

    fn meet(&self, solid: &Solid, ray: &Ray, most: f64) -> Option<Hit> {
        let surface = solid.surface as usize;
        let away = solid.origin - ray.from;
        if solid.normal == DVec3::ZERO {
            // The middle of the chord, then half of it.
            let along = away.dot(ray.along);
            let half2 = solid.radius * solid.radius - (away - along * ray.along).length_squared();
            if half2 < 0.0 {
                return None;
            }
            let half = half2.sqrt();
            let (near, far) = (along - half, along + half);
            let (distance, front) = if near > self.least { (near, true) } else { (far, false) };
            let hit = distance > self.least && distance < most;
            return hit.then_some(Hit { surface, distance, front });
        }
        let falls = solid.normal.dot(ray.along);
        let distance = away.dot(solid.normal) / falls;
        if !(distance > self.least && distance < most) {
            return None;
        }
        let p = distance * ray.along - away;
        let (x, y) = (p.dot(solid.tangent), p.dot(solid.bitangent));
        let edges = &self.edges[solid.edges.0 as usize..solid.edges.1 as usize];
        let inside = edges.iter().all(|e| e[0] * x + e[1] * y + e[2] >= 0.0);
        inside.then_some(Hit { surface, distance, front: falls < 0.0 })
    }
}

fn bounds(surface: &Surface) -> (DVec3, DVec3) {
    if surface.is_sphere() {
        return (surface.origin - surface.radius, surface.origin + surface.radius);
    }
    let wide = SLACK * (surface.radius + surface.origin.abs().max_element()) * 10.0;
    let (low, high) =
        surface.corners().fold((DVec3::MAX, DVec3::MIN), |(l, h), p| (l.min(p), h.max(p)));
    (low - wide, high + wide)
}

/// Whether a ray meets a box nearer than `most`. A direction along a side of the box divides by 0: what is no number then decides nothing.
fn meets(node: &Node, from: DVec3, inverse: DVec3, most: f64) -> bool {
    let (a, b) = ((node.low - from) * inverse, (node.high - from) * inverse);
    let mut enter = 0.0_f64;
    let mut leave = most;
    for k in 0..3 {
        enter = enter.max(a[k].min(b[k]));
        leave = leave.min(a[k].max(b[k]));
    }
    enter <= leave * (1.0 + 1e-15)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::Scene;
    use crate::target::Target;

    /// Truth: every surface looked at in turn, by the same meeting rule; the tree leaves nothing out.
    #[test]
    fn the_tree_finds_what_all_surfaces_hold() {
        for name in ["box_wing", "corner", "hexagon", "box_with_panels"] {
            let scene = Scene::new(&Target::built_in(name).unwrap()).unwrap();
            let surfaces = super::super::surfaces::Surfaces::new(&scene);
            let caster = Caster::new(&surfaces.list, 1e-10);
            for k in 0..4000 {
                let s = sobol_burley::sample_4d(k, 0, 1).map(f64::from);
                let t = sobol_burley::sample_4d(k, 1, 1).map(f64::from);
                let leaves = k as usize % surfaces.list.len();
                let place = surfaces.list[leaves].even(leaves, [s[0], s[1]]);
                let z = 2.0 * s[2] - 1.0;
                let (sin, cos) = (std::f64::consts::TAU * t[0]).sin_cos();
                let across = (1.0 - z * z).sqrt();
                let along = DVec3::new(across * cos, across * sin, z);
                let ray = Ray { from: place.at, along, leaves };
                let all = caster
                    .solids
                    .iter()
                    .filter(|s| s.surface as usize != leaves)
                    .filter_map(|s| caster.meet(s, &ray, f64::INFINITY))
                    .min_by(|a, b| a.distance.total_cmp(&b.distance));
                let found = caster.first(&ray);
                assert_eq!(found.map(|h| h.distance), all.map(|h| h.distance), "{name} {k}");
                assert_eq!(caster.is_blocked(&ray, f64::INFINITY), all.is_some(), "{name} {k}");
                let outside = caster.first_outside(&ray, |_| false).unwrap();
                assert_eq!(outside.map(|h| h.distance), all.map(|h| h.distance), "{name} {k}");
            }
        }
    }
}
