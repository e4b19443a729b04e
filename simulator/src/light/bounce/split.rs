//! Surfaces, cut where others stand on them or reach through them.
//!
//! A patch that lies on both sides of another surface would let light through: what falls on its one side would leave it on the other. So no
//! patch crosses such a line.

use super::surfaces::{Outline, Surface};
use crate::light::clip::{self, P2};

/// Pieces of one surface at most: beyond, its patches may lie on both sides of something.
const MOST_PIECES: usize = 40;
/// Cuts shorter than this, of the surface's radius, are not made.
const SHORTEST: f64 = 1e-6;

/// A convex part of a surface, in its axes.
#[derive(Debug, Clone)]
pub struct Piece {
    pub surface: usize,
    pub corners: Vec<P2>,
}

/// The chosen polygons in pieces; `None` where one falls into too many.
pub fn pieces(surfaces: &[Surface], chosen: &[usize], touching_m: f64) -> Option<Vec<Piece>> {
    let mut all = Vec::new();
    for &k in chosen {
        let surface = &surfaces[k];
        let Outline::Polygon(corners) = &surface.shape else { continue };
        let mut pieces = vec![corners.clone()];
        for other in surfaces.iter().enumerate().filter(|(j, _)| *j != k).map(|(_, other)| other) {
            let away = other.origin.distance(surface.origin);
            if away > surface.radius + other.radius + touching_m {
                continue;
            }
            for segment in meets(surface, other, touching_m) {
                pieces = cut(pieces, segment, SHORTEST * surface.radius);
            }
        }
        if pieces.len() > MOST_PIECES {
            return None;
        }
        all.extend(pieces.into_iter().map(|corners| Piece { surface: k, corners }));
    }
    Some(all)
}

/// Where a polygon stands on the front of a surface's plane or goes through it, in the surface's axes.
fn meets(surface: &Surface, other: &Surface, touching_m: f64) -> Vec<[P2; 2]> {
    let points: Vec<(P2, f64)> = other
        .corners()
        .map(|p| {
            let p = p - surface.origin;
            let height = p.dot(surface.normal);
            let height = if height.abs() <= touching_m { 0.0 } else { height };
            ([p.dot(surface.tangent), p.dot(surface.bitangent)], height)
        })
        .collect();
    let edges = || (0..points.len()).map(|k| (points[k], points[(k + 1) % points.len()]));
    let high = points.iter().any(|p| p.1 > 0.0);
    if points.iter().all(|p| p.1 == 0.0) {
        // It lies upon it.
        let lies = surface.normal.dot(other.normal) < 0.0;
        return if lies { edges().map(|(a, b)| [a.0, b.0]).collect() } else { Vec::new() };
    }
    if !high {
        return Vec::new();
    }
    let mut ends: Vec<P2> = Vec::new();
    for (a, b) in edges() {
        if a.1 == 0.0 {
            ends.push(a.0);
        }
        if a.1 * b.1 < 0.0 {
            let t = a.1 / (a.1 - b.1);
            ends.push([a.0[0] + t * (b.0[0] - a.0[0]), a.0[1] + t * (b.0[1] - a.0[1])]);
        }
    }
    // The two that are farthest apart: corners along one edge may be more than two.
    let mut longest: Option<([P2; 2], f64)> = None;
    for (k, a) in ends.iter().enumerate() {
        for b in &ends[k + 1..] {
            let length = (b[0] - a[0]).hypot(b[1] - a[1]);
            if longest.is_none_or(|l| length > l.1) {
                longest = Some(([*a, *b], length));
            }
        }
    }
    longest.map(|l| l.0).into_iter().collect()
}

/// Cuts those pieces along the whole line through which the segment itself goes.
fn cut(pieces: Vec<Vec<P2>>, segment: [P2; 2], shortest: f64) -> Vec<Vec<P2>> {
    let mut out = Vec::with_capacity(pieces.len() + 1);
    for piece in pieces {
        if within(&piece, segment, shortest) < shortest {
            out.push(piece);
            continue;
        }
        let line = line(segment[0], segment[1]);
        for side in [line, line.map(|x| -x)] {
            let mut part = Vec::new();
            beyond(&piece, side, &mut part);
            if part.len() >= 3 && clip::area(&part) > shortest * shortest {
                out.push(part);
            }
        }
    }
    out
}

/// The length of a segment within a convex ring, away from its edges.
fn within(ring: &[P2], [a, b]: [P2; 2], margin: f64) -> f64 {
    let (mut from, mut to) = (0.0_f64, 1.0_f64);
    for k in 0..ring.len() {
        let l = line(ring[k], ring[(k + 1) % ring.len()]);
        let height = |p: P2| l[0] * p[0] + l[1] * p[1] + l[2] - margin;
        let (h, g) = (height(a), height(b));
        if h < 0.0 && g < 0.0 {
            return 0.0;
        }
        if h < 0.0 {
            from = from.max(h / (h - g));
        } else if g < 0.0 {
            to = to.min(h / (h - g));
        }
    }
    (to - from).max(0.0) * (b[0] - a[0]).hypot(b[1] - a[1])
}

/// The line from one point to another, positive on its left.
pub fn line(a: P2, b: P2) -> [f64; 3] {
    let (x, y) = (a[1] - b[1], b[0] - a[0]);
    let length = x.hypot(y).max(1e-300);
    let (x, y) = (x / length, y / length);
    [x, y, -x * a[0] - y * a[1]]
}

/// The part of a convex ring on the positive side of a line.
pub fn beyond(ring: &[P2], line: [f64; 3], out: &mut Vec<P2>) {
    out.clear();
    let Some(&last) = ring.last() else { return };
    let height = |p: P2| line[0] * p[0] + line[1] * p[1] + line[2];
    let (mut a, mut ha) = (last, height(last));
    for &b in ring {
        let hb = height(b);
        if (ha > 0.0 && hb < 0.0) || (ha < 0.0 && hb > 0.0) {
            let t = ha / (ha - hb);
            out.push([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]);
        }
        if hb >= 0.0 {
            out.push(b);
        }
        (a, ha) = (b, hb);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::Scene;
    use crate::light::bounce::surfaces::Surfaces;
    use crate::mesh::shapes::{Side, cuboid};
    use crate::target::{Placement, Shape, Target};
    use glam::DVec3;

    /// Truth: by hand. A cube of 0.4 m that stands on the middle of a 2 m plate, and one that reaches through it, cut it into its footprint (0.16 m²) and
    /// what lies about it; the pieces' areas add up to 4 m², and none crosses an edge of the footprint.
    #[test]
    fn a_cube_on_a_plate() {
        let mut target = Target::built_in("corner").unwrap();
        target.parts.truncate(2);
        let plate = cuboid(DVec3::new(2.0, 2.0, 0.1), &Side::ALL);
        let cube = cuboid(DVec3::splat(0.4), &Side::ALL);
        for height in [0.25, 0.2, 0.1] {
            for (part, (mesh, z)) in
                target.parts.iter_mut().zip([(plate.clone(), 0.0), (cube.clone(), height)])
            {
                part.shape = Shape::Mesh(mesh);
                let offset_m = DVec3::new(0.0, 0.0, z);
                part.placement = Placement { offset_m, ..Placement::default() };
            }
            let scene = Scene::new(&target).unwrap();
            let surfaces = Surfaces::new(&scene).list;
            let top = (0..surfaces.len())
                .find(|k| surfaces[*k].normal.z > 0.9 && surfaces[*k].area > 1.0)
                .unwrap();
            let pieces = pieces(&surfaces, &[top], scene.touching_m).unwrap();
            let areas: Vec<f64> = pieces.iter().map(|p| clip::area(&p.corners)).collect();
            assert!((areas.iter().sum::<f64>() - 4.0).abs() < 1e-9, "{areas:?}");
            assert!(pieces.len() > 4, "{height}: {areas:?}");
            let footprint = pieces.iter().zip(&areas).filter(|(piece, _)| {
                let surface = &surfaces[piece.surface];
                piece.corners.iter().all(|p| {
                    let p = surface.point(*p);
                    p.x.abs() < 0.2 + 1e-9 && p.y.abs() < 0.2 + 1e-9
                })
            });
            let area: f64 = footprint.map(|p| p.1).sum();
            assert!((area - 0.16).abs() < 1e-9, "{height}: {area}");
        }
    }
}
