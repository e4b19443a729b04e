//! Triangles between points of a plane, none of whose circles through the corners holds another point (Delaunay), by the method of Bowyer and Watson (1981).

/// A part of a step by which points are moved so that no four lie on one circle.
const MOVED: f64 = 1e-7;
/// Corners of the triangle about all points lie this many times their extent away.
const FAR: f64 = 1e3;
/// A place this far outside a triangle, in parts of it, is inside.
const EDGE: f64 = 1e-9;

/// A triangulation.
pub struct Triangles {
    points: Vec<(f64, f64)>,
    all: Vec<[usize; 3]>,
    last: usize,
}

impl Triangles {
    pub fn new(given: &[(f64, f64)]) -> Self {
        let extent = given.iter().fold(1e-9_f64, |m, p| m.max(p.0.abs()).max(p.1.abs()));
        let moved = |k: usize, v: f64| {
            let number = (k as f64 * 0.618_033_988_7 + 0.3 * v).fract() - 0.5;
            MOVED * extent * number
        };
        let mut points: Vec<(f64, f64)> = given
            .iter()
            .enumerate()
            .map(|(k, p)| (p.0 + moved(2 * k, 0.0), p.1 + moved(2 * k + 1, 0.5)))
            .collect();
        let count = points.len();
        let far = FAR * extent;
        points.extend([(-far, -far), (far, -far), (0.0, far)]);
        let mut all: Vec<[usize; 3]> = vec![[count, count + 1, count + 2]];
        for k in 0..count {
            let mut edges: Vec<[usize; 2]> = Vec::new();
            all.retain(|t| {
                let is_inside = is_in_circle(t.map(|c| points[c]), points[k]);
                if is_inside {
                    let [a, b, c] = *t;
                    for edge in [[a, b], [b, c], [c, a]] {
                        // An edge of two such triangles vanishes with them.
                        match edges.iter().position(|e| e[0] == edge[1] && e[1] == edge[0]) {
                            Some(at) => drop(edges.swap_remove(at)),
                            None => edges.push(edge),
                        }
                    }
                }
                !is_inside
            });
            let turns = |e: &&[usize; 2]| cross(points[e[0]], points[e[1]], points[k]) > 0.0;
            all.extend(edges.iter().filter(turns).map(|e| [e[0], e[1], k]));
            if all.len() > 2 * (count + 3) {
                // More than a plane holds: the places are too near one another for the arithmetic.
                all.clear();
                break;
            }
        }
        all.retain(|t| t.iter().all(|k| *k < count));
        Self { points, all, last: 0 }
    }

    /// Corners with the parts that a place has of them; `None` outside.
    pub fn at(&mut self, p: (f64, f64)) -> Option<[(usize, f64); 3]> {
        // Places are asked for in order: mostly it is the same triangle again.
        let again = self.all.get(self.last).and_then(|t| self.parts(*t, p));
        if again.is_some() {
            return again;
        }
        let found = self.all.iter().enumerate().find_map(|(k, t)| Some((k, self.parts(*t, p)?)))?;
        self.last = found.0;
        Some(found.1)
    }

    fn parts(&self, corners: [usize; 3], p: (f64, f64)) -> Option<[(usize, f64); 3]> {
        let [a, b, c] = corners.map(|k| self.points[k]);
        let whole = cross(a, b, c);
        let parts = [cross(p, b, c) / whole, cross(a, p, c) / whole, cross(a, b, p) / whole];
        let inside = parts.iter().all(|v| *v >= -EDGE);
        inside.then(|| [0, 1, 2].map(|k| (corners[k], parts[k].max(0.0))))
    }
}

fn cross(a: (f64, f64), b: (f64, f64), c: (f64, f64)) -> f64 {
    (b.0 - a.0) * (c.1 - a.1) - (b.1 - a.1) * (c.0 - a.0)
}

/// Whether a point lies in the circle through three others that go counter-clockwise.
fn is_in_circle(corners: [(f64, f64); 3], p: (f64, f64)) -> bool {
    let [a, b, c] = corners.map(|q| {
        let (x, y) = (q.0 - p.0, q.1 - p.1);
        (x, y, x * x + y * y)
    });
    let minor = |u: (f64, f64, f64), v: (f64, f64, f64)| u.0 * v.1 - u.1 * v.0;
    a.2 * minor(b, c) + b.2 * minor(c, a) + c.2 * minor(a, b) > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The area of the hull of points, by Andrew's monotone chain (1979).
    fn hull(points: &[(f64, f64)]) -> f64 {
        let mut sorted = points.to_vec();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let half = |all: &mut dyn Iterator<Item = (f64, f64)>| {
            let mut chain: Vec<(f64, f64)> = Vec::new();
            for p in all {
                while let [.., a, b] = chain[..]
                    && cross(a, b, p) <= 0.0
                {
                    chain.pop();
                }
                chain.push(p);
            }
            chain.pop();
            chain
        };
        let mut chain = half(&mut sorted.iter().copied());
        chain.extend(half(&mut sorted.iter().rev().copied()));
        let next = |k: usize| chain[(k + 1) % chain.len()];
        (0..chain.len()).map(|k| 0.5 * (chain[k].0 * next(k).1 - chain[k].1 * next(k).0)).sum()
    }

    /// Truth: the area of the hull, by another method. A grid, of which four points lie on each circle; and a table at 35° of incidence in logarithms of the distance from the mirrored ray, whose
    /// distances grow from 1e-4 to 5° on a line: circles through three of these are larger than arithmetic tells apart by their middle and radius.
    #[test]
    fn a_plane_is_covered_once() {
        let grid: Vec<(f64, f64)> =
            (0..100).map(|k| (f64::from(k % 10), f64::from(k / 10))).collect();
        let mut at: Vec<(f64, f64)> = (-42..=42).map(|k| (2.0 * f64::from(k), 180.0)).collect();
        at.extend(
            (1..=8).flat_map(|k| [90.0, 150.0, 210.0, 270.0].map(|p| (10.0 * f64::from(k), p))),
        );
        at.extend((1..60).map(|k| (35.0 + 1e-4 * 1.2_f64.powi(k), 180.0)));
        let warped = |(theta, phi): &(f64, f64)| {
            let (sin, phi) = (theta.to_radians().sin(), phi.to_radians());
            let (x, y) = (sin * phi.cos() + 35_f64.to_radians().sin(), sin * phi.sin());
            let r = x.hypot(y);
            let times = 0.5 * (r / 1.72e-6).powi(2).ln_1p() / r.max(1e-12);
            (x * times, y * times)
        };
        let table: Vec<(f64, f64)> = at.iter().map(warped).collect();
        for points in [grid, table] {
            let made = Triangles::new(&points);
            let one = |t: &[usize; 3]| {
                let [a, b, c] = t.map(|k| made.points[k]);
                0.5 * cross(a, b, c)
            };
            let (found, truth) = (made.all.iter().map(one).sum::<f64>(), hull(&points));
            assert!((found - truth).abs() < 1e-3 * truth, "{found} of {truth}");
        }
    }
}
