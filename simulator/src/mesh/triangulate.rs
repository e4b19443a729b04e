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

/// Turning left at every corner, and once around in all (a pentagram turns left everywhere too).
fn is_convex(flat: &[DVec2]) -> bool {
    let count = flat.len();
    let rounding = rounding(flat);
    let mut total = 0.0;
    for k in 0..count {
        let (a, b, c) = (flat[k], flat[(k + 1) % count], flat[(k + 2) % count]);
        // A corner within a straight edge would make a triangle without area.
        if turn(a, b, c) <= rounding {
            return false;
        }
        total += (b - a).angle_to(c - b);
    }
    (total - std::f64::consts::TAU).abs() < 1.0
}

fn cut_ears(flat: &[DVec2]) -> Option<Vec<[usize; 3]>> {
    let mut rest: Vec<usize> = (0..flat.len()).collect();
    let mut triangles = Vec::with_capacity(flat.len() - 2);
    let rounding = rounding(flat);
    // The next ear is mostly beside the last one.
    let mut from = 0;
    while rest.len() > 3 {
        let count = rest.len();
        // Only a corner that does not turn left can lie in an ear.
        let obstacles: Vec<DVec2> = (0..count)
            .map(|k| around(&rest, k).map(|i| flat[i]))
            .filter(|&[a, b, c]| turn(a, b, c) <= rounding)
            .map(|corners| corners[1])
            .collect();
        let ear = (0..count)
            .map(|k| (from + k) % count)
            .find(|&k| is_ear(around(&rest, k).map(|i| flat[i]), &obstacles, rounding));
        let Some(ear) = ear else {
            // What is left may be a line, there and back.
            let is_flat = is_flat(flat, &rest);
            triangles.extend((1..count - 1).map(|k| [rest[0], rest[k], rest[k + 1]]));
            return is_flat.then_some(triangles);
        };
        triangles.push(around(&rest, ear));
        rest.remove(ear);
        from = ear.saturating_sub(1);
    }
    let last = [rest[0], rest[1], rest[2]];
    triangles.push(last);
    let [a, b, c] = last.map(|i| flat[i]);
    (turn(a, b, c) >= 0.0 || is_flat(flat, &rest)).then_some(triangles)
}

/// Whether a polygon has no area beyond rounding.
fn is_flat(flat: &[DVec2], corners: &[usize]) -> bool {
    let first = flat[corners[0]];
    let fan = corners.windows(2).map(|pair| turn(first, flat[pair[0]], flat[pair[1]]));
    fan.sum::<f64>().abs() <= rounding(flat)
}

/// Twice the area that rounding may give to a line.
fn rounding(flat: &[DVec2]) -> f64 {
    1e-13 * flat.iter().map(|p| p.distance_squared(flat[0])).fold(0.0, f64::max)
}

/// A corner between its neighbours.
fn around(rest: &[usize], k: usize) -> [usize; 3] {
    let count = rest.len();
    [rest[(k + count - 1) % count], rest[k], rest[(k + 1) % count]]
}

fn is_ear([a, b, c]: [DVec2; 3], obstacles: &[DVec2], rounding: f64) -> bool {
    if turn(a, b, c) <= rounding {
        return false;
    }
    let left = |p: DVec2, q: DVec2, r: DVec2| turn(p, q, r) >= -rounding;
    let inside = |p: DVec2| left(a, b, p) && left(b, c, p) && left(c, a, p);
    // A corner at the same place as one of the ear's is no obstacle: holes are often cut in by a bridge that is walked twice.
    obstacles.iter().all(|&p| [a, b, c].contains(&p) || !inside(p))
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

    /// Truth: a tilted square of area 2, a corner more within each of its edges and two in one: no triangle may be empty.
    #[test]
    fn corners_within_straight_edges_make_no_empty_triangle() {
        let ring = [
            (0.0, 0.0),
            (0.3, 0.0),
            (0.7, 0.0),
            (1.0, 0.0),
            (1.0, 0.5),
            (1.0, 1.0),
            (0.1, 1.0),
            (0.0, 1.0),
            (0.0, 0.9),
        ];
        let (u, v) = (DVec3::new(0.6, 0.0, 0.8), DVec3::new(0.0, 2.0, 0.0));
        let corners: Vec<DVec3> = ring.iter().map(|&(x, y)| x * u + y * v).collect();
        for start in 0..corners.len() {
            let mut corners = corners.clone();
            corners.rotate_left(start);
            let triangles = triangulate(&corners).unwrap();
            let areas = triangles.iter().map(|t| super::super::area_vector(t.map(|i| corners[i])));
            let areas: Vec<f64> = areas.map(|a| a.dot(u.cross(v).normalize())).collect();
            assert!((areas.iter().sum::<f64>() - 2.0).abs() < 1e-14, "{start}");
            assert!(areas.iter().all(|a| *a > 1e-3), "{start}: {areas:?}");
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
