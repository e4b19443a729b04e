//! Polygons of files as triangles.

use glam::{DVec2, DVec3};

/// More corners than any modelling program gives one face; cutting ears grows with their square.
pub(super) const MOST_CORNERS: usize = 4096;

/// Why a polygon is no sum of triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Odd {
    /// More than [`MOST_CORNERS`].
    TooManyCorners(usize),
    /// It crosses itself, or touches itself so that no corner can be cut off.
    CrossesItself,
}

/// The triangles of a simple polygon, convex or not, as indices of its corners: a fan where it is convex, else by cutting ears in the
/// plane of its mean normal (Newell). A polygon without area gives triangles without area, for the examination to find.
pub(super) fn triangulate(corners: &[DVec3]) -> Result<Vec<[usize; 3]>, Odd> {
    let count = corners.len();
    if count > MOST_CORNERS {
        return Err(Odd::TooManyCorners(count));
    }
    let fan = || (1..count - 1).map(|k| [0, k, k + 1]).collect();
    if count == 3 {
        return Ok(fan());
    }
    let origin = corners[0];
    let normal: DVec3 =
        (1..count - 1).map(|k| (corners[k] - origin).cross(corners[k + 1] - origin)).sum();
    let Some(normal) = normal.try_normalize() else { return Ok(fan()) };
    let x = normal.any_orthonormal_vector();
    let y = normal.cross(x);
    let flat: Vec<DVec2> =
        corners.iter().map(|&c| DVec2::new((c - origin).dot(x), (c - origin).dot(y))).collect();
    if is_convex(&flat) {
        return Ok(fan());
    }
    cut_ears(&flat).ok_or(Odd::CrossesItself)
}

fn turn(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    (b - a).perp_dot(c - a)
}

/// Turning left everywhere, and once around in all (a pentagram turns left everywhere too).
fn is_convex(flat: &[DVec2]) -> bool {
    let count = flat.len();
    let mut total = 0.0;
    for k in 0..count {
        let (a, b, c) = (flat[k], flat[(k + 1) % count], flat[(k + 2) % count]);
        if turn(a, b, c) < 0.0 {
            return false;
        }
        total += (b - a).angle_to(c - b);
    }
    (total - std::f64::consts::TAU).abs() < 1.0
}

fn cut_ears(flat: &[DVec2]) -> Option<Vec<[usize; 3]>> {
    let mut rest: Vec<usize> = (0..flat.len()).collect();
    let mut triangles = Vec::with_capacity(flat.len() - 2);
    while rest.len() > 3 {
        let count = rest.len();
        let ear = (0..count).find(|&k| {
            let [a, b, c] = [rest[(k + count - 1) % count], rest[k], rest[(k + 1) % count]];
            is_ear(flat, &rest, [a, b, c])
        })?;
        triangles.push([rest[(ear + count - 1) % count], rest[ear], rest[(ear + 1) % count]]);
        rest.remove(ear);
    }
    if turn(flat[rest[0]], flat[rest[1]], flat[rest[2]]) < 0.0 {
        return None;
    }
    triangles.push([rest[0], rest[1], rest[2]]);
    Some(triangles)
}

fn is_ear(flat: &[DVec2], rest: &[usize], [a, b, c]: [usize; 3]) -> bool {
    let [pa, pb, pc] = [flat[a], flat[b], flat[c]];
    if turn(pa, pb, pc) <= 0.0 {
        return false;
    }
    let inside =
        |p: DVec2| turn(pa, pb, p) >= 0.0 && turn(pb, pc, p) >= 0.0 && turn(pc, pa, p) >= 0.0;
    // A corner at the same place as one of the ear's is no obstacle: holes are often cut in by a bridge that is walked twice.
    rest.iter().all(|&i| {
        let p = flat[i];
        [a, b, c].contains(&i) || p == pa || p == pb || p == pc || !inside(p)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(corners: &[DVec3], triangles: &[[usize; 3]]) -> f64 {
        triangles.iter().map(|t| super::super::area_vector(t.map(|i| corners[i])).z).sum()
    }

    /// Truth: the areas of the figures by the shoelace formula, by hand. Each triangle must turn left, else the areas of a fan
    /// would sum to the same.
    #[test]
    fn concave_polygons_have_their_area_and_no_triangle_turns_right() {
        let flat = |xy: &[(f64, f64)]| -> Vec<DVec3> {
            xy.iter().map(|&(x, y)| DVec3::new(x, y, 0.0)).collect()
        };
        let l = flat(&[(2.0, 1.0), (2.0, 0.0), (0.0, 0.0), (0.0, 2.0), (1.0, 2.0), (1.0, 1.0)]);
        let l: Vec<DVec3> = l.into_iter().rev().collect();
        let comb = flat(&[
            (0.0, 0.0),
            (5.0, 0.0),
            (5.0, 3.0),
            (4.0, 3.0),
            (4.0, 1.0),
            (3.0, 1.0),
            (3.0, 3.0),
            (2.0, 3.0),
            (2.0, 1.0),
            (1.0, 1.0),
            (1.0, 3.0),
            (0.0, 3.0),
        ]);
        let arrow = flat(&[(0.0, 0.0), (2.0, -1.0), (1.0, 0.0), (2.0, 1.0)]);
        // A square ring, its hole joined by a bridge that is walked twice.
        let ring = flat(&[
            (0.0, 0.0),
            (3.0, 0.0),
            (3.0, 3.0),
            (0.0, 3.0),
            (0.0, 0.0),
            (1.0, 1.0),
            (1.0, 2.0),
            (2.0, 2.0),
            (2.0, 1.0),
            (1.0, 1.0),
        ]);
        for (corners, truth) in [(l, 3.0), (comb, 11.0), (arrow, 1.0), (ring, 8.0)] {
            let triangles = triangulate(&corners).unwrap();
            assert_eq!(triangles.len(), corners.len() - 2);
            for t in &triangles {
                assert!(super::super::area_vector(t.map(|i| corners[i])).z >= 0.0, "{t:?}");
            }
            assert!((area(&corners, &triangles) - truth).abs() < 1e-14);
        }
    }

    #[test]
    fn a_bow_tie_and_a_pentagram_are_refused() {
        let star = |k: usize| {
            let angle = std::f64::consts::TAU * (2 * k) as f64 / 5.0;
            DVec3::new(angle.cos(), angle.sin(), 0.0)
        };
        let pentagram: Vec<DVec3> = (0..5).map(star).collect();
        assert_eq!(triangulate(&pentagram), Err(Odd::CrossesItself));
        let tie = [(0.0, 0.0), (2.0, 2.0), (2.0, 0.0), (0.0, 1.0)];
        let tie: Vec<DVec3> = tie.iter().map(|&(x, y)| DVec3::new(x, y, 0.0)).collect();
        assert_eq!(triangulate(&tie), Err(Odd::CrossesItself));
        assert_eq!(triangulate(&vec![DVec3::ZERO; 5000]), Err(Odd::TooManyCorners(5000)));
    }
}
