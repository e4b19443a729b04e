//! Facets that stand together: what none of them can do is found out once for all of them.

use super::Large;
use super::cast::{Ball, Cast};
use glam::{DVec3, Vec3, Vec4};
use std::array::from_fn;
use std::ops::Range;

/// Facets of a cluster at most: two registers of four.
pub(super) const MOST: usize = 4 * HALVES;
const HALVES: usize = 2;
/// Rounding error of places within a ball in single precision, as a share of the radius: more than ten roundings.
const ROUNDING: f32 = 2e-6;

/// Properties that the facets of a cluster have in common.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Kind {
    pub part: u32,
    pub material: u32,
    pub group: u32,
    /// Whether they hide with both sides.
    pub sheet: bool,
}

/// Neighbours of one kind.
#[derive(Debug, Clone)]
pub(super) struct Cluster {
    pub kind: Kind,
    /// The end of its facets; they begin where those of the cluster before end.
    end: u32,
    /// The ball that holds them.
    middle: DVec3,
    radius: f64,
    /// Their normals lie within a cone about this axis.
    axis: DVec3,
    /// The sine of its half-angle; infinite from 90° on.
    sine: f64,
}

/// A number of each facet of a cluster, side by side: all are worked on at once.
type Each = [Vec4; HALVES];

/// The facets of a cluster, each with a ball that holds it.
#[derive(Debug, Clone)]
pub(super) struct Balls {
    /// Along the three axes.
    normals: [Each; 3],
    /// In the facets' planes, from the middle of the cluster, m.
    middles: [Each; 3],
    /// No less than they are, m; below 0 where there is no facet.
    radii: Each,
}

/// The facets of a cluster as seen along a direction, each as the ellipse that a disc about it becomes.
#[derive(Debug)]
pub(super) struct Discs {
    x: Each,
    y: Each,
    normal_x: Each,
    normal_y: Each,
    /// The square of the cosine.
    cos2: Each,
    /// The square of the disc's radius times the cosine; below 0 for what shows no side that hides.
    reach2: Each,
}

impl Discs {
    /// Which of the facets may lie over a place (m, from the middle of their cluster): a bit for each, the first the lowest.
    #[inline]
    pub(super) fn over(&self, x: f32, y: f32) -> u32 {
        let mut bits = 0;
        for h in 0..HALVES {
            let (dx, dy) = (x - self.x[h], y - self.y[h]);
            // In the facet's plane this place is off by (dx, dy, −rise/cos).
            let rise = self.normal_x[h] * dx + self.normal_y[h] * dy;
            let over = (dx * dx + dy * dy) * self.cos2[h] + rise * rise;
            bits |= over.cmple(self.reach2[h]).bitmask() << (4 * h);
        }
        bits
    }
}

impl Balls {
    fn new(normals: &[DVec3], balls: &[(DVec3, f64)], centre: DVec3) -> Self {
        let each = |of: &dyn Fn(usize) -> f32| -> Each {
            from_fn(|h| Vec4::from_array(from_fn(|k| of(4 * h + k))))
        };
        let normal = |k: usize, axis: usize| normals.get(k).map_or(0.0, |n| n[axis] as f32);
        let middle =
            |k: usize, axis: usize| balls.get(k).map_or(0.0, |b| (b.0 - centre)[axis] as f32);
        Self {
            normals: from_fn(|axis| each(&|k| normal(k, axis))),
            middles: from_fn(|axis| each(&|k| middle(k, axis))),
            radii: each(&|k| balls.get(k).map_or(-1.0, |b| (b.1 as f32).next_up())),
        }
    }
}

impl Cluster {
    /// Creates a cluster of facets that end at `end`: normals, and balls that hold them, about places in their planes.
    fn new(kind: Kind, normals: &[DVec3], balls: &[(DVec3, f64)], end: usize) -> Self {
        let (mut low, mut high) = (DVec3::MAX, DVec3::MIN);
        for (place, _) in balls {
            low = low.min(*place);
            high = high.max(*place);
        }
        let middle = 0.5 * (low + high);
        let reaches = balls.iter().map(|(place, radius)| middle.distance(*place) + radius);
        let axis = normals.iter().sum::<DVec3>().normalize_or_zero();
        let cosine = normals.iter().map(|n| n.dot(axis)).fold(1.0, f64::min);
        // More than rounding, so that no facet on the cone's edge is lost.
        let sine = if cosine > 0.0 { (1.0 - cosine * cosine).sqrt() + 1e-7 } else { f64::INFINITY };
        Self {
            kind,
            end: end as u32,
            middle,
            radius: reaches.fold(0.0, f64::max) * (1.0 + 1e-9),
            axis,
            sine,
        }
    }

    /// Whether all look away from a direction in the axes of their group.
    #[inline]
    pub(super) fn faces_away(&self, toward: DVec3) -> bool {
        self.axis.dot(toward) <= -self.sine
    }

    #[inline]
    pub(super) fn ball(&self, cast: &Cast) -> Ball {
        cast.ball(self.kind.group, self.middle, self.radius)
    }

    /// The facets as seen along a cast.
    #[inline]
    pub(super) fn discs(&self, balls: &Balls, cast: &Cast) -> Discs {
        let frame = cast.axes(self.kind.group);
        let [right, up, toward] = [frame.x, frame.y, frame.z].map(|axis| axis.as_vec3());
        let dot = |v: &[Each; 3], a: Vec3| -> Each {
            from_fn(|h| v[0][h] * a.x + v[1][h] * a.y + v[2][h] * a.z)
        };
        let cos = dot(&balls.normals, toward);
        let rounding = ROUNDING * self.radius as f32;
        let least = if self.kind.sheet { f32::NEG_INFINITY } else { 0.0 };
        let reach2 = |h: usize| {
            let hides = cos[h].cmpgt(Vec4::splat(least)) & balls.radii[h].cmpge(Vec4::ZERO);
            let reach = balls.radii[h] + rounding;
            let square = (reach * cos[h]) * (reach * cos[h]) + reach * rounding;
            Vec4::select(hides, square, Vec4::NEG_ONE)
        };
        Discs {
            x: dot(&balls.middles, right),
            y: dot(&balls.middles, up),
            normal_x: dot(&balls.normals, right),
            normal_y: dot(&balls.normals, up),
            cos2: from_fn(|h| cos[h] * cos[h]),
            reach2: from_fn(reach2),
        }
    }
}

/// Parts facets, in their order, into clusters.
pub(super) fn clusters(
    kinds: &[Kind],
    normals: &[DVec3],
    balls: &[(DVec3, f64)],
) -> (Vec<Cluster>, Vec<Balls>) {
    let mut found = (Vec::new(), Vec::new());
    let mut start = 0;
    for same in kinds.chunk_by(|a, b| a == b) {
        for count in same.chunks(MOST).map(<[Kind]>::len) {
            let end = start + count;
            let (normals, balls) = (&normals[start..end], &balls[start..end]);
            let cluster = Cluster::new(same[0], normals, balls, end);
            found.1.push(Balls::new(normals, balls, cluster.middle));
            found.0.push(cluster);
            start = end;
        }
    }
    found
}

impl Large {
    /// All clusters, each with its number and its facets.
    pub(super) fn clusters(&self) -> impl Iterator<Item = (u32, &Cluster, Range<usize>)> {
        let mut start = 0;
        (0..).zip(&self.clusters).map(move |(number, cluster)| {
            let own = start..cluster.end as usize;
            start = own.end;
            (number, cluster, own)
        })
    }
}
