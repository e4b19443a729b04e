//! Curved surfaces that something shades or hides: cells, divided where it matters.
//!
//! The lit and seen part of a cell is found on a plane through it, with shadows thrown onto it as onto a facet; how much light that is of the
//! whole cell's, from the true normals. A cell that a shadow's edge crosses is then off by the edge's length times the cell's bulge, so
//! that all of them together gain a factor four when cells are halved, at twice their number. That length times the bulge, times the
//! tangent of the light's angle, is the error of a cell, or what it changed by when it came from its parent if that is more; the worst
//! cell is divided next, until the sum is below the tolerance.

use super::Light;
use super::ring::{Cell, Task};
use super::sight::{Candidates, Fate, Sight};
use super::zone::Half;
use crate::light::clip::{self, P2, Polygons, Scratch};
use crate::light::geometry::Motion;
use crate::light::occlude::{Plane, Room, Toward};
use glam::DVec3;
use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::f64::consts::TAU;

/// Cells at most, for one side of one part.
const MOST_CELLS: usize = 60_000;
/// Cells around and along to begin with.
const FIRST: [usize; 2] = [8, 4];
/// Planes that the light grazes more than this (cosine) say nothing of a cell.
const LEAST_COS: f64 = 0.02;

/// Room to work in.
#[derive(Debug, Default)]
pub struct Refiner {
    room: Room,
    scratch: Scratch,
    shadows: Polygons,
    pieces: Polygons,
    next: Polygons,
}

/// A cell that is neither free nor dark.
struct Node {
    cell: Cell,
    near: [Candidates; 2],
    kept: Vec<f64>,
    error: Vec<f64>,
    /// The sum of the errors.
    size: f64,
}

impl PartialEq for Node {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Node {}

impl PartialOrd for Node {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Node {
    fn cmp(&self, other: &Self) -> Ordering {
        self.size.total_cmp(&other.size)
    }
}

impl Refiner {
    /// Finds the occluders of other components that may stand before a ball, towards the Sun and towards the observer; `None` where it is dark.
    pub fn before(
        &mut self,
        sight: &Sight,
        component: u32,
        middle: DVec3,
        radius: f64,
        light: Light,
    ) -> Option<[Candidates; 2]> {
        let mut near = [Vec::new(), Vec::new()];
        if sight.scene.report().no_occlusion {
            return Some(near);
        }
        let occluders = &sight.scene.occluders;
        let all: Candidates = (0..occluders.len() as u32)
            .filter(|&k| occluders[k as usize].component != component)
            .collect();
        let towards = [Toward::Far(light.sun), light.eye];
        for ((side, toward), keep) in towards.into_iter().enumerate().zip(&mut near) {
            let fate = sight.sift(middle, radius, toward, side, &all, &mut self.room, keep);
            if fate == Fate::Dark {
                return None;
            }
        }
        Some(near)
    }

    /// Determines whether one point is lit and seen, to a radius.
    pub fn point(
        &mut self,
        sight: &Sight,
        point: DVec3,
        light: Light,
        near: &[Candidates; 2],
        radius: f64,
    ) -> Fate {
        let mut fate = Fate::Free;
        let mut keep = Vec::new();
        for (side, toward) in [Toward::Far(light.sun), light.eye].into_iter().enumerate() {
            let from = &near[side];
            match sight.sift(point, radius, toward, side, from, &mut self.room, &mut keep) {
                Fate::Dark => return Fate::Dark,
                Fate::Mixed => fate = Fate::Mixed,
                Fate::Free => {}
            }
        }
        fate
    }

    /// Adds what is lit and seen of one side to the weights, with the absolute errors of each.
    #[expect(clippy::too_many_arguments, reason = "the task, the scene around it, and the sums")]
    pub fn add(
        &mut self,
        sight: &Sight,
        task: &Task,
        place: &Motion,
        light: Light,
        near: &[Candidates; 2],
        tolerance: f64,
        out: &mut [f64],
        errors: &mut [f64],
    ) {
        let count = out.len();
        let (mut whole, mut quadrature) = (0.0, 0.0);
        let mut open = BinaryHeap::new();
        let zone = &task.zone;
        for i in 0..FIRST[0] {
            for j in 0..FIRST[1] {
                let part = |k: usize, n: usize| k as f64 / n as f64;
                let cell = Cell {
                    azimuth: [i, i + 1].map(|k| TAU * part(k, FIRST[0])),
                    t: [j, j + 1].map(|k| zone.from + (zone.to - zone.from) * part(k, FIRST[1])),
                };
                let mut full = vec![0.0; count];
                let found = self.cell(sight, task, place, light, &cell, near, &mut full);
                quadrature += found.quadrature;
                whole += full.iter().sum::<f64>();
                self.sort(found, &cell, None, out, &mut open);
            }
        }
        let mut left: f64 = open.iter().map(|n: &Node| n.size).sum();
        let mut cells = open.len();
        while left > tolerance * whole && cells < MOST_CELLS {
            let Some(node) = open.pop() else { break };
            left -= node.size;
            let parts = split(&node.cell, task);
            let mut full = vec![0.0; count];
            let found: Vec<Found> = parts
                .iter()
                .map(|cell| self.cell(sight, task, place, light, cell, &node.near, &mut full))
                .collect();
            quadrature += found.iter().map(|f| f.quadrature).sum::<f64>();
            let mixed = found.iter().filter(|f| f.near.is_some()).count();
            // How much the sum changed says how far it may still be off: a factor of four less is expected.
            let mut inherited: Vec<f64> = (0..count)
                .map(|k| {
                    let sum: f64 = found.iter().map(|f| f.kept[k]).sum();
                    (0.5 * (sum - node.kept[k]).abs()).max(0.1 * node.error[k])
                })
                .collect();
            inherited.iter_mut().for_each(|e| *e /= mixed.max(1) as f64);
            let before = open.len();
            for (found, cell) in found.into_iter().zip(&parts) {
                left += self.sort(found, cell, Some(&inherited), out, &mut open);
            }
            cells += open.len() - before;
        }
        for node in open {
            for k in 0..count {
                out[k] += node.kept[k];
                errors[k] += node.error[k];
            }
        }
        super::spread(quadrature, out, errors);
    }

    /// A cell that is done goes to the sums, another one to the heap; gives its error.
    fn sort(
        &self,
        found: Found,
        cell: &Cell,
        inherited: Option<&[f64]>,
        out: &mut [f64],
        open: &mut BinaryHeap<Node>,
    ) -> f64 {
        let Some(near) = found.near else {
            out.iter_mut().zip(&found.kept).for_each(|(o, k)| *o += k);
            return 0.0;
        };
        let error: Vec<f64> = match inherited {
            Some(inherited) => found.coarse.iter().zip(inherited).map(|(c, i)| c.max(*i)).collect(),
            None => found.between.iter().zip(&found.coarse).map(|(b, c)| b.max(*c)).collect(),
        };
        let size = error.iter().sum();
        open.push(Node { cell: *cell, near, kept: found.kept, error, size });
        size
    }

    /// Computes the lit and seen light of a cell; the light that it would send with nothing before it is added to `full`.
    #[expect(clippy::too_many_arguments, reason = "one use, split from its caller")]
    fn cell(
        &mut self,
        sight: &Sight,
        task: &Task,
        place: &Motion,
        light: Light,
        cell: &Cell,
        near: &[Candidates; 2],
        full: &mut [f64],
    ) -> Found {
        let count = full.len();
        let mut found = Found::dark(count);
        let (middle, radius) = ball(cell, task);
        let away = |half: &Half| half.at(middle) + half.normal.length() * radius <= 0.0;
        if task.halves.iter().any(away) {
            return found;
        }
        let mut whole = vec![0.0; count];
        let quadrature = task.cell(cell, &mut whole);
        full.iter_mut().zip(&whole).for_each(|(f, w)| *f += w);
        let towards = [Toward::Far(light.sun), light.eye];
        let mut closer = [Vec::new(), Vec::new()];
        for ((side, toward), keep) in towards.into_iter().enumerate().zip(&mut closer) {
            let from = &near[side];
            let body = place.point(middle);
            let fate = sight.sift(body, radius, toward, side, from, &mut self.room, keep);
            if fate == Fate::Dark {
                return found;
            }
        }
        found.quadrature = quadrature;
        if closer.iter().all(Vec::is_empty) || whole.iter().all(|w| *w == 0.0) {
            found.kept = whole;
            return found;
        }
        let plane = CellPlane::new(cell, task, place);
        match self.share(sight, task, &plane, towards, &closer, count) {
            Some((left, all)) => {
                for k in 0..count {
                    let share = if all[k] > 0.0 { (left[k] / all[k]).min(1.0) } else { 0.5 };
                    found.kept[k] = share * whole[k];
                    found.between[k] = found.kept[k].min(whole[k] - found.kept[k]);
                    let rule = plane.stretch * all[k];
                    let unresolved = (rule / whole[k].max(f64::MIN_POSITIVE) - 1.0).abs().min(1.0);
                    // The shadow's edge stands off by the plane's distance from the surface, in the direction of the light.
                    let displaced = (plane.lean(towards, &closer) * whole[k]).min(whole[k]);
                    found.coarse[k] = unresolved * found.between[k] + displaced;
                    // A plane on which one of both is nothing does not say what is left of thin crescents.
                    found.between[k] = found.between[k].max(0.25 * unresolved * whole[k]);
                }
            }
            None => {
                let half: Vec<f64> = whole.iter().map(|w| 0.5 * w).collect();
                (found.between, found.coarse) = (half.clone(), half.clone());
                found.kept = half;
            }
        }
        found.near = Some(closer);
        found
    }

    /// The light of what is left of a cell's plane, and that of all of it; `None` where the plane says nothing.
    fn share(
        &mut self,
        sight: &Sight,
        task: &Task,
        plane: &CellPlane,
        towards: [Toward; 2],
        near: &[Candidates; 2],
        count: usize,
    ) -> Option<(Vec<f64>, Vec<f64>)> {
        let mut region = plane.outline.clone();
        for half in &task.halves {
            let mut kept = Polygons::default();
            if !clip::keep(&region, plane.line(half), &mut kept) {
                return None;
            }
            region = kept.get(0).to_vec();
        }
        self.shadows.clear();
        for ((side, toward), near) in towards.into_iter().enumerate().zip(near) {
            if near.is_empty() {
                continue;
            }
            if toward.from(plane.body_origin).dot(plane.body_normal) < LEAST_COS {
                return None;
            }
            let axes = [plane.body_u, plane.body_v];
            let onto = Plane::at(
                plane.body_origin,
                plane.body_normal,
                axes,
                toward,
                sight.scene.touching_m,
            );
            for &k in near {
                sight.cast(k as usize, &onto, toward, side, &mut self.room, &mut self.shadows);
            }
        }
        self.pieces.clear();
        self.pieces.push(&region);
        for k in 0..self.shadows.len() {
            let hole = self.shadows.get(k);
            self.next.clear();
            for piece in self.pieces.iter() {
                let touching = 1e-14 * plane.radius;
                clip::subtract(piece, hole, touching, &mut self.next, &mut self.scratch);
            }
            std::mem::swap(&mut self.pieces, &mut self.next);
            if self.pieces.is_empty() {
                break;
            }
        }
        let (mut left, mut all) = (vec![0.0; count], vec![0.0; count]);
        self.pieces.iter().for_each(|piece| plane.light(task, piece, &mut left));
        plane.light(task, &region, &mut all);
        Some((left, all))
    }
}

/// Result for a cell.
struct Found {
    kept: Vec<f64>,
    /// The smaller of what is kept and what is lost.
    between: Vec<f64>,
    /// Error from taking the cell as a plane.
    coarse: Vec<f64>,
    quadrature: f64,
    /// Occluders that may stand before the cell; `None` where it is done.
    near: Option<[Candidates; 2]>,
}

impl Found {
    fn dark(count: usize) -> Self {
        let zero = || vec![0.0; count];
        Self { kept: zero(), between: zero(), coarse: zero(), quadrature: 0.0, near: None }
    }
}

/// A ball around a cell, in the part's axes.
fn ball(cell: &Cell, task: &Task) -> (DVec3, f64) {
    let at = |i: f64, j: f64| {
        let [a, b] = cell.azimuth;
        let [s, t] = cell.t;
        task.zone.point(s + (t - s) * j, a + (b - a) * i)
    };
    let steps = [0.0, 0.5, 1.0];
    let points = steps.map(|i| steps.map(|j| at(i, j)));
    let middle =
        0.5 * (points[1][1] + 0.25 * (points[0][0] + points[2][2] + points[0][2] + points[2][0]));
    let radius = points.iter().flatten().map(|p| p.distance(middle)).fold(0.0, f64::max);
    (middle, 1.02 * radius)
}

/// The cell's halves along its longer side, or quarters.
fn split(cell: &Cell, task: &Task) -> Vec<Cell> {
    let ([a, b], [s, t]) = (cell.azimuth, cell.t);
    let (low, high) = (task.zone.profile.at(s), task.zone.profile.at(t));
    let around = (b - a) * low.r.max(high.r);
    let along = (high.r - low.r).hypot(high.z - low.z);
    let azimuths = if 2.0 * around > along {
        vec![[a, 0.5 * (a + b)], [0.5 * (a + b), b]]
    } else {
        vec![[a, b]]
    };
    let ts = if 2.0 * along > around {
        vec![[s, 0.5 * (s + t)], [0.5 * (s + t), t]]
    } else {
        vec![[s, t]]
    };
    azimuths.iter().flat_map(|&azimuth| ts.iter().map(move |&t| Cell { azimuth, t })).collect()
}

/// The plane that stands for a cell: through its corners, moved to the mean of the surface.
struct CellPlane {
    outline: Vec<P2>,
    origin: DVec3,
    u: DVec3,
    v: DVec3,
    body_origin: DVec3,
    body_normal: DVec3,
    body_u: DVec3,
    body_v: DVec3,
    radius: f64,
    /// How far the surface stands off at most, m.
    bulge: f64,
    /// The shorter way across, m.
    width: f64,
    /// The cell's area over that of its outline.
    stretch: f64,
}

impl CellPlane {
    fn new(cell: &Cell, task: &Task, place: &Motion) -> Self {
        let ([a, b], [s, t]) = (cell.azimuth, cell.t);
        let zone = &task.zone;
        // Counter-clockwise from outside; circles of no radius give their corner twice, which does no harm.
        let mut corners =
            [(s, a), (s, b), (t, b), (t, a)].map(|(t, az)| zone.point(t, az)).to_vec();
        if !zone.outward {
            corners.reverse();
        }
        let mean = corners.iter().sum::<DVec3>() / 4.0;
        let twice = (corners[2] - corners[0]).cross(corners[3] - corners[1]);
        let normal = twice.normalize_or_zero();
        let u = normal.any_orthonormal_vector();
        let v = normal.cross(u);
        let bulge = (zone.point(0.5 * (s + t), 0.5 * (a + b)) - mean).dot(normal);
        // A parabola's mean height over its chord is two thirds of the highest.
        let origin = mean + 2.0 / 3.0 * bulge * normal;
        let outline: Vec<P2> =
            corners.iter().map(|c| [(*c - mean).dot(u), (*c - mean).dot(v)]).collect();
        let radius = outline.iter().map(|p| p[0].hypot(p[1])).fold(0.0, f64::max);
        let area = clip::area(&outline);
        let stretch = if area > 0.0 { zone.area(s, t, b - a) / area } else { 0.0 };
        Self {
            outline,
            origin,
            u,
            v,
            body_origin: place.point(origin),
            body_normal: place.vector(normal),
            body_u: place.vector(u),
            body_v: place.vector(v),
            radius,
            bulge: 2.0 / 3.0 * bulge.abs(),
            width: area / (2.0 * radius),
            stretch,
        }
    }

    /// How far a shadow's edge may stand off, of the cell's width.
    fn lean(&self, towards: [Toward; 2], near: &[Candidates; 2]) -> f64 {
        let lean = |(toward, near): (Toward, &Candidates)| {
            let cos = toward.from(self.body_origin).dot(self.body_normal).clamp(LEAST_COS, 1.0);
            if near.is_empty() { 0.0 } else { (1.0 - cos * cos).sqrt() / cos }
        };
        let most = towards.into_iter().zip(near).map(lean).fold(0.0, f64::max);
        self.bulge * most / self.width
    }

    /// Where a half-space begins on the plane.
    fn line(&self, half: &Half) -> [f64; 3] {
        [half.normal.dot(self.u), half.normal.dot(self.v), half.at(self.origin)]
    }

    /// Adds the light of a convex polygon of the plane, with the normals of the surface next to it.
    fn light(&self, task: &Task, polygon: &[P2], out: &mut [f64]) {
        let middle = |p: P2, q: P2| [0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1])];
        for pair in polygon[1..].windows(2) {
            let triangle = [polygon[0], pair[0], pair[1]];
            let area = clip::area(&triangle);
            for k in 0..3 {
                let at = middle(triangle[k], triangle[(k + 1) % 3]);
                let p = self.origin + at[0] * self.u + at[1] * self.v;
                let t = task.zone.profile.parameter(p.x.hypot(p.y), p.z);
                let t = t.clamp(task.zone.from, task.zone.to);
                task.point(&task.zone.profile.at(t), p.y.atan2(p.x), area / 3.0, out);
            }
        }
    }
}
