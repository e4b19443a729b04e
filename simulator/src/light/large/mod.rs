//! Big meshes at a tolerance: the sum over all facets is exact, what share of them is lit and seen is sampled.
//!
//! With all facets in the open, W_k = Σ A cosθ_i cosθ_o w_k needs no sample at all. What is hidden is found at points of the body: one in each
//! cell of a grid across the line of sight, at a random place of its cell (stratified sampling). A depth buffer over these points says which
//! are seen, exactly, since it holds the surface at each point and not at the middle of a pixel. The points that are seen are sorted into
//! cells across the direction of the Sun, and every facet that faces the Sun marks the points below it: which are lit is exact too, without
//! the bias of a shadow map (the irregular depth buffer of Johnson et al. 2005). Only *where* the points lie is a matter of chance.
//!
//! Where facets are smaller than cells, most lie over no point. They are asked eight at a time ([`cluster`]): whether all look away, whether the
//! ball about them holds a point, and then by single precision, with what it may lose added, over which points the disc about each may lie. Only
//! what is left is projected corner by corner and asked exactly ([`cover`]): the answer is that of asking every facet, at a cost that falls with the points.
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

mod cast;
mod cluster;
mod cover;
mod hooks;
mod jitter;
mod lit;
mod prepare;
mod raster;
mod sums;

use prepare::why_exact;

use super::evaluate::GRAZING;
use super::scene::Scene;
use cast::Cast;
use glam::DVec3;

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

/// A scene's facets in an order in which neighbours stand together.
#[derive(Debug, Clone)]
pub struct Large {
    /// Requested sampling.
    pub sampling: Sampling,
    /// Relative to `centre`, hinges at 0, m.
    vertices: Vec<DVec3>,
    centre: DVec3,
    /// Corners of the facets, as indices into the vertices.
    corners: Vec<u32>,
    /// Where each facet's corners end; they begin where those of the facet before end.
    ends: Vec<u32>,
    clusters: Vec<cluster::Cluster>,
    /// Balls of each cluster.
    balls: Vec<cluster::Balls>,
    facets: Vec<Ordered>,
    looks: Vec<Look>,
    jitter: jitter::Jitter,
}

/// A facet in that order, hinges at 0: what is asked of every one at each evaluation.
#[derive(Debug, Clone)]
struct Ordered {
    /// Unit normal.
    normal: DVec3,
    area: f64,
}

/// Further data of a facet that faces Sun and observer.
#[derive(Debug, Clone)]
struct Look {
    /// Unit tangent, hinges at 0.
    tangent: DVec3,
    radius: f64,
}

/// Result of one evaluation.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Found {
    /// Facets that face Sun and observer.
    pub facets: usize,
    /// Facets among them with a point that is hidden or dark.
    pub shadowed: usize,
    /// Points on them.
    pub points: usize,
    /// ΣW, m² sr⁻¹.
    pub total: f64,
    /// Error of the total, m² sr⁻¹.
    pub error: f64,
}

/// A facet that faces Sun and observer, with its points.
#[derive(Debug, Clone, Copy)]
struct Receiver {
    /// Among the ordered facets.
    number: u32,
    cluster: u32,
    cos_i: f64,
    cos_o: f64,
    /// The end of its points; they begin where those of the receiver before end.
    end: u32,
}

/// Room to work in.
#[derive(Debug, Default)]
pub struct Room {
    receivers: Vec<Receiver>,
    buffer: raster::Buffer,
    points: Vec<raster::Point>,
    sunny: lit::Room,
    cover: cover::Room,
    sums: sums::Room,
}

/// Inputs of one evaluation.
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
        let [mut view, mut sun] = [q.to, q.sun].map(|d| Cast::new(q, self.centre, d));
        let across = self.receive([&view, &sun], room);
        room.points.clear();
        if room.receivers.is_empty() || across <= 0.0 {
            return Some(Found::default());
        }
        let cell = (across / points).sqrt();
        self.raster(cell, &mut view, room)?;
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
            self.light(q, &view, &mut sun, room);
        }
        Some(self.add(q, [&view, &sun], cell * cell, room, out, errors))
    }

    /// Finds the facets that face Sun and observer. Gives their area across the line of sight, m².
    fn receive(&self, [view, sun]: [&Cast; 2], room: &mut Room) -> f64 {
        room.receivers.clear();
        let mut across = 0.0;
        for (number, cluster, own) in self.clusters() {
            let group = cluster.kind.group;
            let (sun, to) = (sun.axes(group).z, view.axes(group).z);
            if cluster.faces_away(sun) || cluster.faces_away(to) {
                continue;
            }
            for k in own {
                let ordered = &self.facets[k];
                let (cos_i, cos_o) = (ordered.normal.dot(sun), ordered.normal.dot(to));
                if cos_i > GRAZING && cos_o > GRAZING {
                    across += cos_o * ordered.area;
                    let receiver =
                        Receiver { number: k as u32, cluster: number, cos_i, cos_o, end: 0 };
                    room.receivers.push(receiver);
                }
            }
        }
        across
    }
}

impl Large {
    /// A facet's corners, counter-clockwise about its normal, among the vertices.
    #[inline]
    fn outline(&self, number: usize) -> &[u32] {
        let start = if number == 0 { 0 } else { self.ends[number - 1] as usize };
        &self.corners[start..self.ends[number] as usize]
    }
}

/// How many points are wanted where the error is so many times too large; `None` beyond [`MOST_POINTS`].
fn more(points: f64, excess: f64) -> Option<f64> {
    // Stratified points err as n^(−3/4); a little more, so that once is enough.
    let points = points * (1.2 * excess).powf(4.0 / 3.0).clamp(1.5, 100.0);
    (points <= MOST_POINTS).then_some(points)
}
