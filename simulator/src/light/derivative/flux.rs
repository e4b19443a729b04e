//! How fast the open area of a facet changes with what throws shadows on it.

use super::exposed::{self, exposed};
use crate::light::clip::P2;
use crate::light::evaluate::Evaluator;
use crate::light::occlude::{Kind, Plane, Toward};
use crate::light::scene::Facet;
use glam::DVec3;

/// The derivatives of a facet's open area.
#[derive(Debug, Default)]
pub(super) struct Flux {
    /// By the slopes d_x/d_z, d_y/d_z of the light's direction and of the observer's, in the facet's axes, m².
    pub(crate) slope: [[f64; 2]; 2],
    /// By each hinge's angle, the facet and the directions held, m².
    pub hinges: Vec<f64>,
    /// Parts of edges that were summed over.
    pub edges: usize,
    /// The sum of what went in, without signs, for rounding.
    pub size: f64,
    sources: Vec<Source>,
    corners: Vec<Corner>,
    starts: Vec<usize>,
    room: exposed::Room,
}

/// Something that throws a corner of a shadow.
#[derive(Debug, Clone, Copy)]
struct Source {
    thrown: P2,
    height: f64,
    /// The corners of the occluder between which it lies, and where.
    between: (usize, usize, f64),
}

/// A corner of a shadow.
#[derive(Debug, Clone, Copy, Default)]
struct Corner {
    height: f64,
    /// Where hinges move it: by the occluder's, by the facet's.
    turning: [P2; 2],
}

/// The hinge of a group.
fn hinge_of(group: usize) -> Option<usize> {
    group.checked_sub(1)
}

impl Flux {
    /// Finds the flux of the shadows that stand in `work` of facet `i`, seen from afar.
    pub(super) fn find(&mut self, now: &Evaluator<'_>, i: usize, sun: DVec3, eye: DVec3) {
        let (scene, facet) = (now.scene, &now.scene.facets[i]);
        (self.slope, self.edges, self.size) = ([[0.0; 2]; 2], 0, 0.0);
        self.hinges.clear();
        self.hinges.resize(scene.hinges.len(), 0.0);
        let planes = [sun, eye].map(|d| Plane::new(&now.now, i, Toward::Far(d), scene.touching_m));
        self.corners.clear();
        self.starts.clear();
        let shadows = &now.work.shadows;
        for (shadow, &(k, side)) in shadows.iter().zip(&now.work.casters) {
            self.starts.push(self.corners.len());
            let plane = &planes[usize::from(side)];
            self.sources(now, k as usize, plane);
            let turns = scene.occluders[k as usize].group != facet.group as usize;
            for p in shadow {
                let corner = self.corner(now, (i, facet), k as usize, plane, *p, turns);
                self.corners.push(corner);
            }
        }
        let mut room = std::mem::take(&mut self.room);
        let outline = scene.outlines.get(i);
        exposed(outline, shadows, &mut room, &mut |j, edge, (from, to)| {
            let ring = shadows.get(j);
            let next = (edge + 1) % ring.len();
            let (p, q) = (ring[edge], ring[next]);
            // The outward normal times the length of the part.
            let part = [(q[1] - p[1]) * (to - from), (p[0] - q[0]) * (to - from)];
            let (a, b) = (self.corners[self.starts[j] + edge], self.corners[self.starts[j] + next]);
            let middle = 0.5 * (from + to);
            let mix = |a: f64, b: f64| a + middle * (b - a);
            let height = mix(a.height, b.height);
            let (occluder, side) = now.work.casters[j];
            let slope = &mut self.slope[usize::from(side)];
            // The shadow of a point at height h moves by −h times the slope's change, and takes what it sweeps.
            slope[0] += height * part[0];
            slope[1] += height * part[1];
            self.size += height.abs() * (part[0] * part[0] + part[1] * part[1]).sqrt();
            let groups = [scene.occluders[occluder as usize].group, facet.group as usize];
            for (which, group) in groups.into_iter().enumerate() {
                if let Some(hinge) = hinge_of(group) {
                    let (u, v) = (a.turning[which], b.turning[which]);
                    self.hinges[hinge] -= part[0] * mix(u[0], v[0]) + part[1] * mix(u[1], v[1]);
                }
            }
            self.edges += 1;
        });
        self.room = room;
    }

    /// All points of an occluder that may be corners of its shadow.
    fn sources(&mut self, now: &Evaluator<'_>, k: usize, plane: &Plane) {
        let occluder = &now.scene.occluders[k];
        let corners = &now.now.corners[occluder.corners.clone()];
        self.sources.clear();
        for (c, corner) in corners.iter().enumerate() {
            let local = plane.local(*corner);
            if local[2] >= 0.0 {
                let between = (c, c, 0.0);
                let thrown = plane.thrown(local);
                self.sources.push(Source { thrown, height: local[2], between });
            }
        }
        let mut crossing = |a: usize, b: usize| {
            let (p, q) = (plane.local(corners[a]), plane.local(corners[b]));
            if (p[2] < 0.0) != (q[2] < 0.0) {
                let t = -p[2] / (q[2] - p[2]);
                let thrown = [p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])];
                self.sources.push(Source { thrown, height: 0.0, between: (a, b, t) });
            }
        };
        match &occluder.kind {
            Kind::Solid(edges) => {
                edges.iter().for_each(|(a, b)| crossing(usize::from(*a), usize::from(*b)));
            }
            _ => (0..corners.len()).for_each(|c| crossing(c, (c + 1) % corners.len())),
        }
    }

    /// Returns the motion of a corner of a shadow: its source is the one that is thrown there.
    fn corner(
        &self,
        now: &Evaluator<'_>,
        (i, facet): (usize, &Facet),
        k: usize,
        plane: &Plane,
        p: P2,
        turns: bool,
    ) -> Corner {
        let away = |s: &Source| (s.thrown[0] - p[0]).powi(2) + (s.thrown[1] - p[1]).powi(2);
        let nearest = self.sources.iter().min_by(|a, b| away(a).total_cmp(&away(b)));
        let Some(source) = nearest else { return Corner::default() };
        let mut corner = Corner { height: source.height, ..Corner::default() };
        if !turns {
            return corner;
        }
        let occluder = &now.scene.occluders[k];
        let corners = &now.now.corners[occluder.corners.clone()];
        let groups = [(occluder.group, 1.0), (facet.group as usize, -1.0)];
        for (turning, (group, sign)) in corner.turning.iter_mut().zip(groups) {
            let Some(hinge) = hinge_of(group) else { continue };
            let hinge = &now.scene.hinges[hinge];
            let velocity = |c: usize| {
                let v = sign * hinge.axis.cross(corners[c] - hinge.point_m);
                let axes = [now.now.tangent[i], now.now.bitangent[i], now.now.normal[i]];
                axes.map(|a| a.dot(v))
            };
            *turning = moved(source, velocity, corners, plane);
        }
        corner
    }
}

/// The velocity in the plane of what a source throws, by those of the corners.
fn moved(
    source: &Source,
    velocity: impl Fn(usize) -> [f64; 3],
    corners: &[DVec3],
    plane: &Plane,
) -> P2 {
    let (a, b, t) = source.between;
    let u = velocity(a);
    if a == b {
        // A point in the direction of the light, at height 1, is thrown where the slope says.
        let slope = plane.thrown([0.0, 0.0, 1.0]);
        return [u[0] + u[2] * slope[0], u[1] + u[2] * slope[1]];
    }
    // Where an edge crosses the plane: the crossing runs along the edge, too.
    let (p, q) = (plane.local(corners[a]), plane.local(corners[b]));
    let v = velocity(b);
    let mix = |k: usize| u[k] + t * (v[k] - u[k]);
    let along = -mix(2) / (q[2] - p[2]);
    [mix(0) + along * (q[0] - p[0]), mix(1) + along * (q[1] - p[1])]
}
