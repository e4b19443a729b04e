//! Faces that lie in one plane, look the same way and overlap would count twice: the later covers the earlier.

use super::clip::{self, P2, Polygons};
use super::facets::Polygon;
use glam::DVec3;

/// Takes from every facet what later ones cover; the facet may fall into several. Gives the parts of the first pair (covered, covering)
/// and the area covered in all, m².
pub fn resolve(polygons: &mut Vec<Polygon>, touching_m: f64) -> Option<(usize, usize, f64)> {
    let reach = polygons
        .iter()
        .flat_map(|p| &p.corners)
        .map(|c| c.abs().max_element())
        .fold(1e-300, f64::max);
    // One number for each plane: facets of one plane stand together in its order.
    let plane = |p: &Polygon| {
        let across = p.corners[0].dot(p.normal) / reach;
        p.normal.dot(DVec3::new(0.543_1, 0.871_7, 1.239_3)) + 1.618_3 * across
    };
    let mut order: Vec<(f64, usize)> =
        polygons.iter().enumerate().map(|(k, p)| (plane(p), k)).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut covers: Vec<(usize, usize)> = Vec::new();
    for (at, &(key, i)) in order.iter().enumerate() {
        for &(_, j) in order[at + 1..].iter().take_while(|o| o.0 - key < 1e-9) {
            if coincide(&polygons[i], &polygons[j], touching_m) {
                covers.push((i.min(j), i.max(j)));
            }
        }
    }
    covers.sort_unstable();
    let mut covered = 0.0;
    let mut first = None;
    let mut pieces_of: Vec<(usize, Vec<Polygon>)> = Vec::new();
    for group in covers.chunk_by(|a, b| a.0 == b.0) {
        let under = &polygons[group[0].0];
        let (origin, x) = (under.corners[0], (under.corners[1] - under.corners[0]).normalize());
        let y = under.normal.cross(x);
        let flat = |p: &Polygon| -> Vec<P2> {
            p.corners.iter().map(|c| [(*c - origin).dot(x), (*c - origin).dot(y)]).collect()
        };
        let (mut pieces, mut next, mut room) =
            (Polygons::default(), Polygons::default(), clip::Scratch::default());
        pieces.push(&flat(under));
        let mut cut = false;
        for &(_, over) in group {
            next.clear();
            for piece in pieces.iter() {
                cut |=
                    clip::subtract(piece, &flat(&polygons[over]), touching_m, &mut next, &mut room);
            }
            std::mem::swap(&mut pieces, &mut next);
        }
        if !cut {
            continue;
        }
        let lost = under.area - pieces.area();
        covered += lost;
        first.get_or_insert((under.part, polygons[group[0].1].part));
        let new = pieces.iter().filter_map(|piece| {
            let corners = piece.iter().map(|p| origin + p[0] * x + p[1] * y).collect();
            // Its plane is that of the whole.
            let part = Polygon::new(corners, under.part, under.component)?;
            (part.area > touching_m * touching_m).then(|| Polygon {
                normal: under.normal,
                bend: under.bend.clone(),
                ..part
            })
        });
        pieces_of.push((group[0].0, new.collect()));
    }
    let (part, over) = first?;
    let mut kept: Vec<Vec<Polygon>> =
        std::mem::take(polygons).into_iter().map(|p| vec![p]).collect();
    for (k, pieces) in pieces_of {
        kept[k] = pieces;
    }
    *polygons = kept.into_iter().flatten().collect();
    Some((part, over, covered))
}

fn coincide(a: &Polygon, b: &Polygon, touching_m: f64) -> bool {
    let in_plane = |a: &Polygon, b: &Polygon| {
        b.corners.iter().all(|c| (*c - a.corners[0]).dot(a.normal).abs() <= touching_m)
    };
    let radius = |p: &Polygon, middle: DVec3| {
        p.corners.iter().map(|c| c.distance(middle)).fold(0.0, f64::max)
    };
    let (ma, mb) = (a.middle(), b.middle());
    a.normal.dot(b.normal) > 0.999
        && ma.distance(mb) < radius(a, ma) + radius(b, mb)
        // The plane of a sliver is known too badly to hold the other's corners.
        && if a.area > b.area { in_plane(a, b) } else { in_plane(b, a) }
}
