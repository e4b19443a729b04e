//! Triangles of one plane and part become convex facets.

use super::closed::Disjoint;
use crate::target::Part;
use glam::DVec3;
use std::collections::HashMap;

/// A flat convex polygon, counter-clockwise seen from outside.
#[derive(Debug, Clone)]
pub struct Polygon {
    /// Corners in the body's axes, m.
    pub corners: Vec<DVec3>,
    /// Unit normal.
    pub normal: DVec3,
    /// Area, m².
    pub area: f64,
    /// The part that it belongs to.
    pub part: usize,
    /// The component that it belongs to.
    pub component: usize,
    /// The corners and normals of the bent triangle that it is, or a part of.
    pub bend: Option<Box<Bend>>,
}

/// A triangle with normals.
#[derive(Debug, Clone, Copy)]
pub struct Bend {
    /// Corners in the body's axes, m.
    pub corners: [DVec3; 3],
    /// Unit normals there.
    pub normals: [DVec3; 3],
}

impl Polygon {
    /// From its corners; `None` where they enclose nothing.
    pub fn new(corners: Vec<DVec3>, part: usize, component: usize) -> Option<Self> {
        let twice = vector_area_twice(&corners);
        let normal = twice.try_normalize()?;
        Some(Self { area: 0.5 * twice.length(), corners, normal, part, component, bend: None })
    }

    /// The mean of the corners.
    pub fn middle(&self) -> DVec3 {
        self.corners.iter().sum::<DVec3>() / self.corners.len() as f64
    }
}

fn vector_area_twice(corners: &[DVec3]) -> DVec3 {
    let first = corners[0];
    corners[1..].windows(2).map(|w| (w[0] - first).cross(w[1] - first)).sum()
}

/// A triangle on its way into a facet.
#[derive(Debug, Clone, Copy)]
pub struct Triangle {
    /// Numbers of places.
    pub corners: [u32; 3],
    /// The part that it belongs to.
    pub part: usize,
    /// The component that it belongs to.
    pub component: usize,
    /// Unit normals at the corners, where the triangle is bent.
    pub normals: Option<[DVec3; 3]>,
}

/// Merges triangles over shared edges as long as the union is flat (to `flat_m`) and convex. Triangles without area are left out.
pub fn merge(places: &[DVec3], triangles: &[Triangle], flat_m: f64) -> Vec<Polygon> {
    let at = |k: u32| places[k as usize];
    let normals: Vec<Option<DVec3>> = triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.corners.map(at);
            let (ab, ac, bc) = (b - a, c - a, c - b);
            let longest = ab.length().max(ac.length()).max(bc.length());
            let normal = ab.cross(ac);
            // Thinner than rounding: no plane of its own.
            (normal.length() > 1e-15 * longest * longest && normal.length() > 0.0)
                .then(|| normal.normalize())
        })
        .collect();
    let mut rings: Vec<Vec<u32>> = triangles.iter().map(|t| t.corners.to_vec()).collect();
    let mut merged = Disjoint::new(triangles.len());
    for (a, b, left, right) in flat_edges(places, triangles, &normals, flat_m) {
        let (l, r) = (merged.root(left), merged.root(right));
        if l == r {
            continue;
        }
        let normal = normals[left as usize].unwrap_or_default();
        if let Some(ring) = union(places, &rings[l as usize], &rings[r as usize], a, b, normal) {
            merged.join(l, r);
            rings[l.max(r) as usize].clear();
            rings[l.min(r) as usize] = ring;
        }
    }
    (0..triangles.len())
        .filter(|&t| normals[t].is_some() && merged.root(t as u32) == t as u32)
        .filter_map(|t| {
            let corners = straightened(places, &rings[t]);
            let polygon = Polygon::new(corners, triangles[t].part, triangles[t].component)?;
            let bend = triangles[t]
                .normals
                .map(|normals| Box::new(Bend { corners: triangles[t].corners.map(at), normals }));
            Some(Polygon { bend, ..polygon })
        })
        .collect()
}

/// Edges between two triangles of one part that lie in one plane: from, to, the triangle on the left, the one on the right. Longest first.
fn flat_edges(
    places: &[DVec3],
    triangles: &[Triangle],
    normals: &[Option<DVec3>],
    flat_m: f64,
) -> Vec<(u32, u32, u32, u32)> {
    let mut directed: HashMap<(u32, u32), Option<u32>> = HashMap::new();
    for (t, triangle) in triangles.iter().enumerate() {
        for k in 0..3 {
            let edge = (triangle.corners[k], triangle.corners[(k + 1) % 3]);
            // Two triangles on one side of an edge: ambiguous, so not merged over it.
            directed.entry(edge).and_modify(|e| *e = None).or_insert(Some(t as u32));
        }
    }
    let mut edges = Vec::new();
    for (t, triangle) in triangles.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (triangle.corners[k], triangle.corners[(k + 1) % 3]);
            if a >= b || directed.get(&(a, b)) != Some(&Some(t as u32)) {
                continue;
            }
            let Some(&Some(other)) = directed.get(&(b, a)) else { continue };
            let (Some(n), Some(m)) = (normals[t], normals[other as usize]) else { continue };
            let neighbour = &triangles[other as usize];
            let origin = places[a as usize];
            let flat = |corners: [u32; 3], n: DVec3| {
                corners.iter().all(|&c| (places[c as usize] - origin).dot(n).abs() <= flat_m)
            };
            let bent = triangle.normals.is_some() || neighbour.normals.is_some();
            let one = !bent
                && neighbour.part == triangle.part
                && neighbour.component == triangle.component;
            if one
                && n.dot(m) > 0.999_999
                && flat(neighbour.corners, n)
                && flat(triangle.corners, m)
            {
                edges.push((a, b, t as u32, other));
            }
        }
    }
    let length = |e: &(u32, u32, u32, u32)| places[e.0 as usize].distance(places[e.1 as usize]);
    edges.sort_by(|x, y| length(y).total_cmp(&length(x)).then(x.cmp(y)));
    edges
}

/// Two rings that share the edge from `a` to `b` (of `left`; from `b` to `a` in `right`), as one, if it is convex.
fn union(
    places: &[DVec3],
    left: &[u32],
    right: &[u32],
    a: u32,
    b: u32,
    normal: DVec3,
) -> Option<Vec<u32>> {
    let (l, r) = (left.len(), right.len());
    let mut from = (0..l).find(|&k| left[k] == a && left[(k + 1) % l] == b)?;
    let mut other = (0..r).find(|&k| right[k] == b && right[(k + 1) % r] == a)?;
    // The chain that both share may be longer than the edge: back to where it begins, then on to where it ends.
    let mut shared = 1;
    while shared + 1 < l.min(r) && left[(from + l - 1) % l] == right[(other + 2) % r] {
        from = (from + l - 1) % l;
        other = (other + 1) % r;
        shared += 1;
    }
    let mut end = (other + r + 1 - shared) % r;
    while shared + 1 < l.min(r) && left[(from + shared + 1) % l] == right[(end + r - 1) % r] {
        end = (end + r - 1) % r;
        shared += 1;
    }
    // Left from the chain's end round to its beginning, then right from there round to the chain's end.
    let mut ring: Vec<u32> = (0..=l - shared).map(|k| left[(from + shared + k) % l]).collect();
    ring.extend((1..r - shared).map(|k| right[(end + shared + k) % r]));
    let n = ring.len();
    let at = |k: usize| places[ring[k % n] as usize];
    let convex = n >= 3
        && (0..n).all(|k| {
            let (e, f) = (at(k + 1) - at(k), at(k + 2) - at(k + 1));
            let turn = e.cross(f).dot(normal);
            turn >= -1e-12 * e.length() * f.length() && (turn > 0.0 || e.dot(f) > 0.0)
        });
    convex.then_some(ring)
}

/// A ring's corners without those on a straight line.
fn straightened(places: &[DVec3], ring: &[u32]) -> Vec<DVec3> {
    let n = ring.len();
    let at = |k: usize| places[ring[k % n] as usize];
    let bends = |k: usize| {
        let (e, f) = (at(k) - at(k + n - 1), at(k + 1) - at(k));
        e.cross(f).length() > 1e-14 * e.length() * f.length() || e.dot(f) < 0.0
    };
    let corners: Vec<DVec3> = (0..n).filter(|&k| bends(k)).map(at).collect();
    if corners.len() < 3 { (0..n).map(at).collect() } else { corners }
}

/// A facet's tangent: the part's in the facet's plane, or the next of its axes x, y, z where that stands on the facet.
pub fn tangent(part: &Part, normal: DVec3) -> DVec3 {
    let in_plane = |axis: DVec3| {
        let axis = part.placement.rotation * axis;
        axis - axis.dot(normal) * normal
    };
    let axes = [part.tangent, DVec3::X, DVec3::Y, DVec3::Z].map(in_plane);
    let chosen = axes.into_iter().find(|a| a.length() > 1e-6).unwrap_or(axes[0]);
    (chosen - chosen.dot(normal) * normal).normalize()
}
