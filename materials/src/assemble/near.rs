//! The nearest of many points in a few dimensions (Bentley 1975).

/// Coordinates; those that a problem has not are 0.
pub(super) type Point = [f64; 4];

/// Points, each half of them on one side of their middle.
pub(super) struct Tree {
    points: Vec<(Point, usize)>,
    /// Coordinates that the problem has: along them the points are parted in turn.
    axes: usize,
}

impl Tree {
    /// Makes a tree of points with their numbers, in the first `axes` coordinates.
    pub fn new(mut points: Vec<(Point, usize)>, axes: usize) -> Self {
        split(&mut points, axes, 0);
        Self { points, axes }
    }

    /// The squared distances and numbers of the `count` nearest, the nearest first.
    pub fn nearest(&self, to: &Point, count: usize) -> Vec<(f64, usize)> {
        let mut found = Vec::with_capacity(count + 1);
        search(&self.points, (self.axes, 0), to, count, &mut found);
        found
    }
}

fn split(points: &mut [(Point, usize)], axes: usize, depth: usize) {
    if points.len() <= 1 {
        return;
    }
    let (axis, middle) = (depth % axes, points.len() / 2);
    points.select_nth_unstable_by(middle, |a, b| {
        (a.0[axis], a.1).partial_cmp(&(b.0[axis], b.1)).unwrap_or(std::cmp::Ordering::Equal)
    });
    let (before, after) = points.split_at_mut(middle);
    split(before, axes, depth + 1);
    split(&mut after[1..], axes, depth + 1);
}

fn search(
    points: &[(Point, usize)],
    (axes, depth): (usize, usize),
    to: &Point,
    count: usize,
    found: &mut Vec<(f64, usize)>,
) {
    if points.is_empty() {
        return;
    }
    let (axis, middle) = (depth % axes, points.len() / 2);
    let (point, number) = &points[middle];
    let distance: f64 = (0..4).map(|k| (point[k] - to[k]).powi(2)).sum();
    if found.len() < count || distance < found[found.len() - 1].0 {
        let at = found.partition_point(|(d, n)| (*d, *n) < (distance, *number));
        found.insert(at, (distance, *number));
        found.truncate(count);
    }
    let side = to[axis] - point[axis];
    let (near, far) = if side < 0.0 {
        (&points[..middle], &points[middle + 1..])
    } else {
        (&points[middle + 1..], &points[..middle])
    };
    search(near, (axes, depth + 1), to, count, found);
    if found.len() < count || side * side < found[found.len() - 1].0 {
        search(far, (axes, depth + 1), to, count, found);
    }
}
