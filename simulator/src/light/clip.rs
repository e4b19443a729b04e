//! Convex polygons in a plane, and one taken from another.
//!
//! A convex polygon minus a convex polygon: each edge that crosses it cuts one convex piece off the outside; what is inside of all edges is
//! gone. Every step looks at each edge once, so it ends whatever the input.

/// A point of a plane, m.
pub(crate) type P2 = [f64; 2];

/// Convex polygons one behind the other.
#[derive(Debug, Default, Clone)]
pub struct Polygons {
    points: Vec<P2>,
    ends: Vec<usize>,
}

impl Polygons {
    /// Forgets all.
    pub fn clear(&mut self) {
        self.points.clear();
        self.ends.clear();
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }

    /// One of them.
    pub fn get(&self, k: usize) -> &[P2] {
        let start = if k == 0 { 0 } else { self.ends[k - 1] };
        &self.points[start..self.ends[k]]
    }

    /// All of them.
    pub fn iter(&self) -> impl Iterator<Item = &[P2]> {
        (0..self.len()).map(|k| self.get(k))
    }

    /// Adds one.
    pub fn push(&mut self, polygon: &[P2]) {
        self.points.extend_from_slice(polygon);
        self.ends.push(self.points.len());
    }

    /// Forgets the last.
    pub fn pop(&mut self) {
        self.ends.pop();
        self.points.truncate(self.ends.last().copied().unwrap_or(0));
    }

    /// Adds the points pushed by `fill` as one, unless they are fewer than three.
    pub fn push_with(&mut self, fill: impl FnOnce(&mut Vec<P2>)) -> bool {
        let start = self.points.len();
        fill(&mut self.points);
        if self.points.len() - start < 3 {
            self.points.truncate(start);
            return false;
        }
        self.ends.push(self.points.len());
        true
    }

    /// The area of all, m².
    pub fn area(&self) -> f64 {
        self.iter().map(area).sum()
    }
}

/// Area, positive if counter-clockwise.
pub fn area(polygon: &[P2]) -> f64 {
    let [x, y] = polygon[0];
    let twice: f64 = polygon[1..]
        .windows(2)
        .map(|w| (w[0][0] - x) * (w[1][1] - y) - (w[1][0] - x) * (w[0][1] - y))
        .sum();
    0.5 * twice
}

/// Least and greatest coordinates.
pub fn bounds(polygon: &[P2]) -> [f64; 4] {
    let start = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    polygon
        .iter()
        .fold(start, |b, p| [b[0].min(p[0]), b[1].min(p[1]), b[2].max(p[0]), b[3].max(p[1])])
}

/// Whether two boxes share more than an edge.
pub fn overlap(a: &[f64; 4], b: &[f64; 4]) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

/// The line through two points, inside on its left; `None` where they are one point.
fn line(a: P2, b: P2, touching: f64) -> Option<[f64; 3]> {
    let (x, y) = (a[1] - b[1], b[0] - a[0]);
    let length = (x * x + y * y).sqrt();
    // Not a number, or no length: no line.
    if length > touching {
        Some([x / length, y / length, -(x * a[0] + y * a[1]) / length])
    } else {
        None
    }
}

fn distance(line: &[f64; 3], p: P2) -> f64 {
    line[0] * p[0] + line[1] * p[1] + line[2]
}

/// Whether an edge of `a` has all of `b` on its outside.
fn separates(a: &[P2], b: &[P2], touching: f64) -> bool {
    (0..a.len()).any(|k| {
        line(a[k], a[(k + 1) % a.len()], touching)
            .is_some_and(|line| b.iter().all(|p| distance(&line, *p) <= touching))
    })
}

/// Room for the work of [`subtract`].
#[derive(Debug, Default)]
pub struct Scratch {
    rest: Vec<P2>,
    next: Vec<P2>,
    distances: Vec<f64>,
}

/// Appends `piece` minus `hole` to `out`; whether anything was cut. What overlaps by less than `touching` (m) does not count.
pub fn subtract(
    piece: &[P2],
    hole: &[P2],
    touching: f64,
    out: &mut Polygons,
    room: &mut Scratch,
) -> bool {
    if separates(hole, piece, touching) || separates(piece, hole, touching) {
        out.push(piece);
        return false;
    }
    room.rest.clear();
    room.rest.extend_from_slice(piece);
    for k in 0..hole.len() {
        let Some(line) = line(hole[k], hole[(k + 1) % hole.len()], touching) else { continue };
        room.distances.clear();
        room.distances.extend(room.rest.iter().map(|p| distance(&line, *p)));
        if room.distances.iter().all(|d| *d >= -touching) {
            continue;
        }
        if room.distances.iter().all(|d| *d <= touching) {
            // What is left lies outside of this edge: it stays.
            out.push(&room.rest);
            return true;
        }
        let rest = &room.rest;
        out.push_with(|points| half(rest, &room.distances, -1.0, points));
        room.next.clear();
        half(rest, &room.distances, 1.0, &mut room.next);
        std::mem::swap(&mut room.rest, &mut room.next);
        if room.rest.len() < 3 {
            break;
        }
    }
    true
}

/// The part of a convex polygon where `sign` times the distance is positive.
fn half(polygon: &[P2], distances: &[f64], sign: f64, out: &mut Vec<P2>) {
    let n = polygon.len();
    let (mut a, mut da) = (polygon[n - 1], sign * distances[n - 1]);
    for k in 0..n {
        let (b, db) = (polygon[k], sign * distances[k]);
        if (da > 0.0 && db < 0.0) || (da < 0.0 && db > 0.0) {
            let t = da / (da - db);
            out.push([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]);
        }
        if db >= 0.0 {
            out.push(b);
        }
        (a, da) = (b, db);
    }
}

/// The part of a convex polygon on one side of a coordinate.
pub fn cut(polygon: &[P2], axis: usize, at: f64, above: bool, out: &mut Polygons) -> bool {
    let distances: Vec<f64> = polygon.iter().map(|p| p[axis] - at).collect();
    out.push_with(|points| half(polygon, &distances, if above { 1.0 } else { -1.0 }, points))
}

/// The part of a convex polygon on the positive side of a line x·l₀ + y·l₁ + l₂ = 0.
pub fn keep(polygon: &[P2], line: [f64; 3], out: &mut Polygons) -> bool {
    let distances: Vec<f64> = polygon.iter().map(|p| distance(&line, *p)).collect();
    out.push_with(|points| half(polygon, &distances, 1.0, points))
}

/// The convex hull, counter-clockwise, in place (Andrew 1979).
pub fn hull(points: &mut [P2], out: &mut Vec<P2>) {
    // Without this the chains would take back points of what stands in `out` before them.
    if points.len() < 3 {
        return;
    }
    points.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let start = out.len();
    let left =
        |a: P2, b: P2, c: P2| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0;
    let mut chain = |points: &mut dyn Iterator<Item = P2>| {
        let base = out.len();
        for p in points {
            while out.len() > base + 1 && !left(out[out.len() - 2], out[out.len() - 1], p) {
                out.pop();
            }
            out.push(p);
        }
        // Its end is where the other chain begins.
        out.pop();
    };
    chain(&mut points.iter().copied());
    chain(&mut points.iter().rev().copied());
    if out.len() - start < 3 {
        out.truncate(start);
    }
}
