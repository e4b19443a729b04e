//! Big meshes at a tolerance: the sum over all facets is exact, what share of them is lit and seen is sampled.
//!
//! With all facets in the open, W_k = Σ A cosθ_i cosθ_o w_k needs no sample at all. What is hidden is found at points of the body: one in each
//! cell of a grid across the line of sight, at a random place of its cell (stratified sampling). A depth buffer over these points says which
//! are seen, exactly, since it holds the surface at each point and not at the middle of a pixel. The points that are seen are sorted into
//! cells across the direction of the Sun, and every triangle that faces the Sun marks the points below it: which are lit is exact too, without
//! the bias of a shadow map (the irregular depth buffer of Johnson et al. 2005). Only *where* the points lie is a matter of chance.
//!
//! A facet of A cosθ_o across the line of sight with n points, v of them lit and seen, adds w_k cosθ_i (v h² + β (A cosθ_o − n h²)): the
//! points' own count, plus a share β of what the points missed or counted too much. β comes from the points before it (or from its own, where
//! they are many): any β gives the right mean, and where nothing is hidden (all v = n, β = 1) the result is exact.
//!
//! The variance is estimated from successive points along the surface, (v_j − v_{j−1})²/2, which is larger than the truth by what the mean
//! changes between them. The error is [`SIGMAS`] standard deviations and two points' worth of light. Where it exceeds the tolerance, points
//! are added; where that would take more than [`MOST_POINTS`] of them, the exact sum is made.
//!
//! Everything depends on the scene and the directions alone: the places in the cells are the same at every call.

mod hooks;
mod jitter;
mod lit;
mod prepare;
mod raster;
mod sums;

use prepare::why_exact;

use super::evaluate::GRAZING;
use super::geometry::Motion;
use super::scene::Scene;
use glam::DVec3;
use std::ops::Range;

/// Standard deviations in an error.
pub const SIGMAS: f64 = 3.0;
/// Facets from which on points are taken.
pub const FEWEST_FACETS: usize = 2000;
/// Points across the facets that face Sun and observer, at most; beyond them the sum is exact.
pub const MOST_POINTS: f64 = 4e6;
/// Cells of the depth buffer at most: they also cover what lies between the facets.
const MOST_CELLS: f64 = 3e7;
/// Points of the first trials.
const TRIAL_POINTS: f64 = 8192.0;

/// How a scene is sampled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampling {
    /// Relative error of ΣW that is asked for.
    pub tolerance: f64,
    /// Points on the facets that face Sun and observer with which an evaluation begins.
    pub points: f64,
}

/// A scene's triangles in an order in which neighbours stand together.
#[derive(Debug, Clone)]
pub struct Large {
    /// What is asked for.
    pub sampling: Sampling,
    /// Corners relative to `centre`, hinges at 0, m.
    vertices: Vec<DVec3>,
    /// The corners of each group that moves together (0: the body, else hinge + 1).
    groups: Vec<Range<usize>>,
    centre: DVec3,
    triangles: Vec<[u32; 3]>,
    facets: Vec<Ordered>,
    jitter: jitter::Jitter,
}

/// A facet in that order.
#[derive(Debug, Clone)]
struct Ordered {
    /// Unit normal and tangent, hinges at 0. What an evaluation needs stands here in its order, and not all over memory.
    normal: DVec3,
    tangent: DVec3,
    area: f64,
    radius: f64,
    part: u32,
    material: u32,
    group: u32,
    /// The end of its triangles; they begin where those of the facet before end.
    end: u32,
    /// Whether it hides with both sides.
    sheet: bool,
}

/// What one evaluation found.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Found {
    /// Facets that face Sun and observer.
    pub facets: usize,
    /// Of them, those with a point that is hidden or dark.
    pub shadowed: usize,
    /// Points on them.
    pub points: usize,
    /// ΣW, m² sr⁻¹.
    pub total: f64,
    /// Its error, m² sr⁻¹.
    pub error: f64,
}

/// A facet that faces Sun and observer, with its points.
#[derive(Debug, Clone, Copy)]
struct Receiver {
    /// Among the ordered facets.
    number: u32,
    cos_i: f64,
    cos_o: f64,
    /// The end of its points; they begin where those of the receiver before end.
    end: u32,
}

/// Room to work in.
#[derive(Debug, Default)]
pub struct Room {
    projected: Vec<[f64; 3]>,
    receivers: Vec<Receiver>,
    buffer: raster::Buffer,
    points: Vec<raster::Point>,
    sunny: lit::Room,
    sums: sums::Room,
}

/// Axes across a direction, and along it.
#[derive(Debug, Clone, Copy)]
struct Frame {
    x: DVec3,
    y: DVec3,
    z: DVec3,
}

impl Frame {
    fn across(direction: DVec3) -> Self {
        let (x, y) = direction.any_orthonormal_pair();
        Self { x, y, z: direction }
    }

    fn of(&self, p: DVec3) -> [f64; 3] {
        [self.x.dot(p), self.y.dot(p), self.z.dot(p)]
    }
}

/// What is asked of one evaluation.
#[derive(Debug, Clone, Copy)]
pub struct Question<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Angles of its hinges, radians.
    pub angles: &'a [f64],
    /// Towards the Sun.
    pub sun: DVec3,
    /// Towards the observer.
    pub to: DVec3,
    /// From a part's weights to the next one's.
    pub stride: usize,
}

impl Large {
    /// Adds all facets' weights to `out` and sets their errors; `None` where the tolerance would take more than [`MOST_POINTS`].
    pub fn evaluate(
        &self,
        q: &Question,
        room: &mut Room,
        out: &mut [f64],
        errors: &mut [f64],
    ) -> Option<Found> {
        let mut points = self.sampling.points;
        loop {
            out.fill(0.0);
            errors.fill(0.0);
            let found = self.with_points(q, points, room, out, errors)?;
            let excess = found.error / (self.sampling.tolerance * found.total.abs());
            // Also where nothing at all is lit and seen.
            if found.error == 0.0 || excess <= 1.0 {
                return Some(found);
            }
            points = more(points, excess)?;
        }
    }

    /// One evaluation with about as many points; `None` where the depth buffer would be too large.
    fn with_points(
        &self,
        q: &Question,
        points: f64,
        room: &mut Room,
        out: &mut [f64],
        errors: &mut [f64],
    ) -> Option<Found> {
        room.receivers.clear();
        let mut across = 0.0;
        let back = self.turned_back(q);
        for (number, ordered) in self.facets.iter().enumerate() {
            let (sun, to) = back[ordered.group as usize];
            let (cos_i, cos_o) = (ordered.normal.dot(sun), ordered.normal.dot(to));
            if cos_i > GRAZING && cos_o > GRAZING {
                across += cos_o * ordered.area;
                room.receivers.push(Receiver { number: number as u32, cos_i, cos_o, end: 0 });
            }
        }
        room.points.clear();
        if room.receivers.is_empty() || across <= 0.0 {
            return Some(Found::default());
        }
        let cell = (across / points).sqrt();
        let frame = Frame::across(q.to);
        self.project(q, &frame, &mut room.projected);
        let towards: Vec<DVec3> = back.iter().map(|b| b.1).collect();
        self.raster(cell, &towards, room)?;
        let seen = |p: &raster::Point, r: &Receiver, top: f64| {
            (top - p.place[2]) * r.cos_o <= 2.0 * q.scene.touching_m
        };
        let mut start = 0;
        for receiver in &room.receivers {
            for point in &mut room.points[start..receiver.end as usize] {
                point.open = seen(point, receiver, room.buffer.depth[point.cell as usize]);
            }
            start = receiver.end as usize;
        }
        // In opposition what is seen is what is lit.
        if q.sun != q.to {
            let sun = Frame::across(q.sun);
            self.project(q, &sun, &mut room.projected);
            let towards: Vec<DVec3> = back.iter().map(|b| b.0).collect();
            self.light(q, [&frame, &sun], &towards, room);
        }
        Some(self.add(q, &back, cell * cell, room, out, errors))
    }

    /// Sun and observer in the axes of each group before it was turned.
    fn turned_back(&self, q: &Question) -> Vec<(DVec3, DVec3)> {
        let hinges = q.scene.hinges.iter().zip(q.angles);
        let turned = hinges.map(|(hinge, angle)| {
            let back = Motion::about(hinge.point_m, hinge.axis, *angle).rotation.conjugate();
            (back * q.sun, back * q.to)
        });
        std::iter::once((q.sun, q.to)).chain(turned).collect()
    }

    /// Corners along the axes of a frame, m, depth growing towards the light.
    fn project(&self, q: &Question, frame: &Frame, out: &mut Vec<[f64; 3]>) {
        out.clear();
        for (group, range) in self.groups.iter().enumerate() {
            let vertices = &self.vertices[range.clone()];
            let (axes, shift) = if group == 0 {
                (*frame, [0.0; 3])
            } else {
                let hinge = &q.scene.hinges[group - 1];
                let motion = Motion::about(hinge.point_m, hinge.axis, q.angles[group - 1]);
                let back = motion.rotation.conjugate();
                let axes = Frame { x: back * frame.x, y: back * frame.y, z: back * frame.z };
                (axes, frame.of(motion.point(self.centre) - self.centre))
            };
            out.extend(vertices.iter().map(|v| {
                let p = axes.of(*v);
                [p[0] + shift[0], p[1] + shift[1], p[2] + shift[2]]
            }));
        }
    }
}

/// How many points are wanted where the error is so many times too large; `None` beyond [`MOST_POINTS`].
fn more(points: f64, excess: f64) -> Option<f64> {
    // Stratified points err as n^(−3/4); a little more, so that once is enough.
    let points = points * (1.2 * excess).powf(4.0 / 3.0).clamp(1.5, 100.0);
    (points <= MOST_POINTS).then_some(points)
}
