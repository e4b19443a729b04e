//! Triangles between points of a plane, none of whose circles through the corners holds another point (Delaunay), by the method of Bowyer and Watson (1981).

/// A part of a step by which points are moved so that no four lie on one circle.
const MOVED: f64 = 1e-7;
/// Corners of the triangle about all points lie this many times their extent away.
const FAR: f64 = 1e3;
/// A place this far outside a triangle, in parts of it, is inside.
const EDGE: f64 = 1e-9;

struct Triangle {
    corners: [usize; 3],
    middle: (f64, f64),
    radius2: f64,
}

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
        let mut all: Vec<Triangle> = Vec::new();
        all.extend(triangle(&points, [count, count + 1, count + 2]));
        for k in 0..count {
            let p = points[k];
            let mut edges: Vec<[usize; 2]> = Vec::new();
            all.retain(|t| {
                let inside = (p.0 - t.middle.0).powi(2) + (p.1 - t.middle.1).powi(2) < t.radius2;
                if inside {
                    let [a, b, c] = t.corners;
                    for edge in [[a, b], [b, c], [c, a]] {
                        // An edge of two such triangles vanishes with them.
                        match edges.iter().position(|e| e[0] == edge[1] && e[1] == edge[0]) {
                            Some(at) => drop(edges.swap_remove(at)),
                            None => edges.push(edge),
                        }
                    }
                }
                !inside
            });
            all.extend(edges.iter().filter_map(|e| triangle(&points, [e[0], e[1], k])));
        }
        let inner = all.into_iter().map(|t| t.corners).filter(|t| t.iter().all(|k| *k < count));
        let all = inner.collect();
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

/// A triangle counter-clockwise; `None` of three points on a line.
fn triangle(points: &[(f64, f64)], [a, b, c]: [usize; 3]) -> Option<Triangle> {
    let turn = cross(points[a], points[b], points[c]);
    let corners = if turn < 0.0 { [a, c, b] } else { [a, b, c] };
    let (p, q, r) = (points[corners[0]], points[corners[1]], points[corners[2]]);
    let (bx, by, cx, cy) = (q.0 - p.0, q.1 - p.1, r.0 - p.0, r.1 - p.1);
    let twice = 2.0 * (bx * cy - by * cx);
    if twice.is_nan() || twice <= 0.0 {
        return None;
    }
    let (b2, c2) = (bx * bx + by * by, cx * cx + cy * cy);
    let (x, y) = ((cy * b2 - by * c2) / twice, (bx * c2 - cx * b2) / twice);
    Some(Triangle { corners, middle: (p.0 + x, p.1 + y), radius2: x * x + y * y })
}
