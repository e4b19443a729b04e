//! Convex closed bodies: they hide by their outline and never their own facets.

use super::facets::Polygon;
use glam::DVec3;

/// A body with more corners than this hides facet by facet: its outline would cost more than the index of facets.
pub const MOST_CORNERS: usize = 64;

/// A convex body.
#[derive(Debug, Clone)]
pub struct Solid {
    /// Corners of the body, m.
    pub corners: Vec<DVec3>,
    /// Pairs of corners.
    pub edges: Vec<(u16, u16)>,
}

/// Shape of a closed component.
#[derive(Debug, Clone)]
pub enum Shape {
    /// Convex, few corners.
    Small(Solid),
    /// Convex, many corners.
    Large,
    /// Anything else.
    Hollow,
}

/// Looks at the facets of one closed component.
pub fn examine(facets: &[&Polygon], tolerance_m: f64) -> Shape {
    let mut corners: Vec<DVec3> = Vec::new();
    let count: usize = facets.iter().map(|f| f.corners.len()).sum();
    if volume(facets) <= tolerance_m * facets.iter().map(|f| f.area).sum::<f64>() {
        return Shape::Hollow;
    }
    if count * facets.len() > 4_000_000 {
        return if is_star_and_locally_convex(facets, tolerance_m) {
            Shape::Large
        } else {
            Shape::Hollow
        };
    }
    let below = |f: &Polygon, p: DVec3| (p - f.corners[0]).dot(f.normal) <= tolerance_m;
    let all = || facets.iter().flat_map(|f| f.corners.iter().copied());
    if !facets.iter().all(|f| all().all(|p| below(f, p))) {
        return Shape::Hollow;
    }
    // True corners lie in three planes or more of independent normals.
    for p in all() {
        if corners.iter().any(|c| c.distance(p) <= 4.0 * tolerance_m) {
            continue;
        }
        if rank(facets, tolerance_m, &[p]) == 3 {
            corners.push(p);
            if corners.len() > MOST_CORNERS {
                return Shape::Large;
            }
        }
    }
    let mut edges = Vec::new();
    for a in 0..corners.len() {
        for b in a + 1..corners.len() {
            if rank(facets, tolerance_m, &[corners[a], corners[b]]) >= 2 {
                edges.push((a as u16, b as u16));
            }
        }
    }
    if corners.len() < 4 {
        return Shape::Hollow;
    }
    Shape::Small(Solid { corners, edges })
}

/// How many independent normals the facets have that hold all these points.
fn rank(facets: &[&Polygon], tolerance_m: f64, points: &[DVec3]) -> usize {
    let holds = |f: &&&Polygon| {
        points.iter().all(|p| (*p - f.corners[0]).dot(f.normal).abs() <= 4.0 * tolerance_m)
    };
    let mut normals = facets.iter().filter(holds).map(|f| f.normal);
    let Some(first) = normals.next() else { return 0 };
    let mut cross = DVec3::ZERO;
    for normal in normals {
        if cross == DVec3::ZERO {
            let candidate = first.cross(normal);
            if candidate.length() > 1e-9 {
                cross = candidate.normalize();
            }
        } else if cross.dot(normal).abs() > 1e-9 {
            return 3;
        }
    }
    if cross == DVec3::ZERO { 1 } else { 2 }
}

/// Signed volume, m³: negative where the normals look inward.
pub fn volume(facets: &[&Polygon]) -> f64 {
    let Some(first) = facets.first() else { return 0.0 };
    let origin = first.corners[0];
    facets.iter().map(|f| (f.corners[0] - origin).dot(f.normal) * f.area).sum::<f64>() / 3.0
}

/// Convexity of large bodies: every direction from the middle meets the surface once (a star), and no edge bends inward. Both together are
/// convexity, at a cost that grows as the number of facets.
fn is_star_and_locally_convex(facets: &[&Polygon], tolerance_m: f64) -> bool {
    let area: f64 = facets.iter().map(|f| f.area).sum();
    let middle = facets.iter().map(|f| f.area * f.middle()).sum::<DVec3>() / area;
    if facets.iter().any(|f| (middle - f.corners[0]).dot(f.normal) >= -tolerance_m) {
        return false;
    }
    let solid_angle: f64 = facets
        .iter()
        .map(|f| {
            let first = f.corners[0] - middle;
            f.corners[1..]
                .windows(2)
                .map(|w| triangle_solid_angle(first, w[0] - middle, w[1] - middle))
                .sum::<f64>()
        })
        .sum();
    if (solid_angle / (4.0 * std::f64::consts::PI) - 1.0).abs() > 1e-6 {
        return false;
    }
    let points: Vec<DVec3> = facets.iter().flat_map(|f| f.corners.iter().copied()).collect();
    let (numbers, _) = super::weld::weld(&points, tolerance_m);
    let mut edges = std::collections::HashMap::new();
    let mut start = 0;
    for (k, facet) in facets.iter().enumerate() {
        let n = facet.corners.len();
        for c in 0..n {
            edges.insert((numbers[start + c], numbers[start + (c + 1) % n]), k);
        }
        start += n;
    }
    edges.iter().all(|(&(a, b), &k)| {
        let Some(&other) = edges.get(&(b, a)) else { return false };
        let below = |p: &DVec3| (*p - facets[k].corners[0]).dot(facets[k].normal) <= tolerance_m;
        facets[other].corners.iter().all(below)
    })
}

/// Van Oosterom and Strackee (1983).
fn triangle_solid_angle(a: DVec3, b: DVec3, c: DVec3) -> f64 {
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let below = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    2.0 * a.dot(b.cross(c)).atan2(below)
}
