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
        let mut search = Search { to, axes: self.axes, count, found: Vec::with_capacity(count) };
        search.within(&self.points, 0, [0.0; 4]);
        search.found
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

/// So few points are looked at one by one.
const FEW: usize = 8;

fn squared(offsets: &Point) -> f64 {
    offsets.iter().map(|d| d * d).sum()
}

/// A search that goes on: what was found so far, in order.
struct Search<'a> {
    to: &'a Point,
    axes: usize,
    count: usize,
    found: Vec<(f64, usize)>,
}

impl Search<'_> {
    /// Whether a point at this squared distance would be among the nearest.
    fn is_near(&self, distance: f64) -> bool {
        self.found.len() < self.count || self.found.last().is_some_and(|last| distance < last.0)
    }

    fn offer(&mut self, (point, number): &(Point, usize)) {
        let distance = squared(&std::array::from_fn(|k| point[k] - self.to[k]));
        if !self.is_near(distance) {
            return;
        }
        if self.found.len() == self.count {
            self.found.pop();
        }
        // From the end: most that come late belong there.
        self.found.push((distance, *number));
        let mut at = self.found.len() - 1;
        while at > 0 && (distance, *number) < self.found[at - 1] {
            self.found.swap(at - 1, at);
            at -= 1;
        }
    }

    /// Looks at points none of which is nearer than `offsets` along each axis (Arya and Mount 1993).
    fn within(&mut self, points: &[(Point, usize)], depth: usize, offsets: Point) {
        if points.len() <= FEW {
            points.iter().for_each(|point| self.offer(point));
            return;
        }
        let (axis, middle) = (depth % self.axes, points.len() / 2);
        self.offer(&points[middle]);
        let side = self.to[axis] - points[middle].0[axis];
        let (near, far) = if side < 0.0 {
            (&points[..middle], &points[middle + 1..])
        } else {
            (&points[middle + 1..], &points[..middle])
        };
        self.within(near, depth + 1, offsets);
        let mut beyond = offsets;
        beyond[axis] = side;
        if self.is_near(squared(&beyond)) {
            self.within(far, depth + 1, beyond);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the distances to all points, sorted. Points at random, on a raster (many at one distance: there the distances count, not the numbers), and in three of the four coordinates.
    #[test]
    fn the_nearest_are_those_of_all() {
        let mut state = 5_u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        for (n, axes, raster) in
            [(1, 3, 0.0), (7, 4, 0.0), (900, 3, 0.0), (900, 4, 0.0), (900, 3, 8.0)]
        {
            let mut at = || -> Point {
                std::array::from_fn(|k| match random() {
                    _ if k >= axes => 0.0,
                    x if raster > 0.0 => (x * raster).floor() / raster,
                    x => x,
                })
            };
            let points: Vec<(Point, usize)> = (0..n).map(|k| (at(), k)).collect();
            let tree = Tree::new(points.clone(), axes);
            for _ in 0..50 {
                let to = at();
                let mut all: Vec<f64> = points
                    .iter()
                    .map(|(p, _)| squared(&std::array::from_fn(|k| p[k] - to[k])))
                    .collect();
                all.sort_by(f64::total_cmp);
                all.truncate(24);
                let found = tree.nearest(&to, 24);
                assert_eq!(found.iter().map(|f| f.0).collect::<Vec<_>>(), all);
                for (distance, number) in &found {
                    let p = points[*number].0;
                    assert_eq!(*distance, squared(&std::array::from_fn(|k| p[k] - to[k])));
                }
            }
        }
    }
}
