//! From points to weights and their errors.

use super::cast::Cast;
use super::{Found, Large, Question, Room as All, SIGMAS};
use glam::DVec3;

/// Points that a share is taken from.
const SHARED: usize = 8;
/// From so many points of its own on, a facet has a share of its own.
const OWN: usize = 32;
/// The variance that one cell on a facet's edge adds to the number of points on it: that of a cell cut by a straight line at random is 1/6.
const EDGE: f64 = 0.2;

/// Room to work in.
#[derive(Debug, Default)]
pub(super) struct Room {
    base: Vec<f64>,
    variance: Vec<f64>,
    largest: Vec<f64>,
}

/// The share of a part that is lit and seen, as the points go by.
#[derive(Debug, Default)]
struct Share {
    value: f64,
    open: usize,
    points: usize,
}

impl Share {
    fn take(&mut self, open: usize, points: usize) {
        self.open += open;
        self.points += points;
        if self.points >= SHARED {
            self.value = self.open as f64 / self.points as f64;
            (self.open, self.points) = (0, 0);
        }
    }
}

impl Large {
    /// Adds all receivers to `out`, of points that stand for `area` across the line of sight (m²), and sets the errors.
    pub(super) fn add(
        &self,
        q: &Question,
        [view, sun]: [&Cast; 2],
        area: f64,
        room: &mut All,
        out: &mut [f64],
        errors: &mut [f64],
    ) -> Found {
        let All { receivers, points, sums, .. } = room;
        sums.variance.clear();
        sums.variance.resize(out.len(), 0.0);
        sums.largest.clear();
        sums.largest.resize(out.len(), 0.0);
        let mut found = Found { facets: receivers.len(), points: points.len(), ..Found::default() };
        let (mut variance, mut largest) = (0.0, 0.0_f64);
        let (mut start, mut part) = (0, u32::MAX);
        let (mut share, mut before) = (Share::default(), true);
        for (number, receiver) in receivers.iter().enumerate() {
            let own = &points[start..receiver.end as usize];
            let (facet, look) =
                (&self.facets[receiver.number as usize], &self.looks[receiver.number as usize]);
            let cluster = &self.clusters[receiver.cluster as usize];
            if cluster.kind.part != part {
                part = cluster.kind.part;
                let same = receivers[number..].iter();
                let same = same.take_while(|r| self.clusters[r.cluster as usize].kind.part == part);
                let end = same.last().map_or(start, |r| r.end as usize);
                let all = &points[start..end];
                let open = all.iter().filter(|p| p.open).count();
                let value = if all.is_empty() { 1.0 } else { open as f64 / all.len() as f64 };
                share = Share { value, ..Share::default() };
                before = own.first().is_none_or(|p| p.open);
            }
            start = receiver.end as usize;
            let open = own.iter().filter(|p| p.open).count();
            let beta = if own.len() >= OWN { open as f64 / own.len() as f64 } else { share.value };
            share.take(open, own.len());
            // What the points missed of the facet, in points.
            let missed = facet.area * receiver.cos_o / area - own.len() as f64;
            let scale = open as f64 + beta * missed;
            // Changes from point to point, and how far the share was from what was found.
            let mut noise = 0.0;
            for point in own {
                noise += if point.open == before { 0.0 } else { 0.5 };
                before = point.open;
            }
            noise += if own.len() >= OWN {
                let edge = EDGE * std::f64::consts::TAU * look.radius / area.sqrt();
                edge.min(own.len() as f64) * beta * (1.0 - beta)
            } else {
                let (open, closed) = (open as f64, (own.len() - open) as f64);
                0.25 * (open * (1.0 - beta).powi(2) + closed * beta * beta)
            };
            found.shadowed += usize::from(open < own.len());
            let material = &q.scene.materials[cluster.kind.material as usize];
            let weights = q.scene.weights_of(cluster.kind.material as usize);
            let at = cluster.kind.part as usize * q.stride + weights.start;
            let range = at..at + weights.len();
            let normal = facet.normal;
            // Any will do where none matters, and costs less than to fetch it.
            let tangent = if material.is_isotropic() {
                normal.any_orthonormal_vector()
            } else {
                look.tangent
            };
            let bitangent = normal.cross(tangent);
            let local = |d: DVec3| DVec3::new(tangent.dot(d), bitangent.dot(d), normal.dot(d));
            let group = cluster.kind.group;
            let (sun, to) = (sun.axes(group).z, view.axes(group).z);
            sums.base.clear();
            sums.base.resize(weights.len(), 0.0);
            // One point's worth of light.
            material.add_weights(local(sun), local(to), area * receiver.cos_i, &mut sums.base);
            let mut whole = 0.0;
            for (k, base) in range.zip(&sums.base) {
                out[k] += scale * base;
                sums.variance[k] += noise * base * base;
                sums.largest[k] = sums.largest[k].max(*base);
                whole += base;
            }
            found.total += scale * whole;
            variance += noise * whole * whole;
            largest = largest.max(whole);
        }
        for ((error, variance), largest) in errors.iter_mut().zip(&sums.variance).zip(&sums.largest)
        {
            *error = SIGMAS * variance.sqrt() + 2.0 * largest;
        }
        found.error = SIGMAS * variance.sqrt() + 2.0 * largest;
        found
    }
}
