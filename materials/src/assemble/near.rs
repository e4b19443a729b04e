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

    /// The `count` nearest, the nearest first. `within` is a squared distance within which at least so many are known to lie: infinite where nothing is known. It makes the search short.
    pub fn nearest(&self, to: &Point, count: usize, within: f64) -> Vec<Near> {
        let found = Vec::with_capacity(count + 1);
        let mut search = Search { to, axes: self.axes, count, within, found };
        search.among(&self.points, 0, [0.0; 4]);
        search.found
    }
}

/// A point that was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Near {
    /// Its squared distance.
    pub squared: f64,
    /// Its number.
    pub number: usize,
    /// Where it lies.
    pub at: Point,
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

/// The squared distance of two points.
pub(super) fn apart(a: &Point, b: &Point) -> f64 {
    squared(&std::array::from_fn(|k| a[k] - b[k]))
}

/// A search that goes on: what was found so far, in order.
struct Search<'a> {
    to: &'a Point,
    axes: usize,
    count: usize,
    /// What is farther is not among the nearest.
    within: f64,
    found: Vec<Near>,
}

impl Search<'_> {
    fn offer(&mut self, (point, number): &(Point, usize)) {
        let near = Near { squared: apart(point, self.to), number: *number, at: *point };
        if near.squared > self.within {
            return;
        }
        // From the end: most that come late belong there.
        let before = |other: &Near| (other.squared, other.number) <= (near.squared, near.number);
        let at = self.found.iter().rposition(before).map_or(0, |k| k + 1);
        if at == self.count {
            return;
        }
        self.found.truncate(self.count - 1);
        self.found.insert(at, near);
        if self.found.len() == self.count {
            self.within = self.within.min(self.found[self.count - 1].squared);
        }
    }

    /// Looks at points none of which is nearer than `offsets` along each axis (Arya and Mount 1993).
    fn among(&mut self, points: &[(Point, usize)], depth: usize, offsets: Point) {
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
        self.among(near, depth + 1, offsets);
        let mut beyond = offsets;
        beyond[axis] = side;
        if squared(&beyond) <= self.within {
            self.among(far, depth + 1, beyond);
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
                let mut all: Vec<f64> = points.iter().map(|(p, _)| apart(p, &to)).collect();
                all.sort_by(f64::total_cmp);
                all.truncate(24);
                let farthest = all[all.len() - 1];
                // Not knowing anything, and knowing as much as can be known.
                for within in [f64::INFINITY, 2.0 * farthest, farthest] {
                    let found = tree.nearest(&to, 24, within);
                    assert_eq!(found.iter().map(|f| f.squared).collect::<Vec<_>>(), all);
                    for near in &found {
                        assert_eq!(near.at, points[near.number].0);
                        assert_eq!(near.squared, apart(&near.at, &to));
                    }
                }
            }
        }
    }
}
