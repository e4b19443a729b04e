//! The nearest of many points in a few dimensions (Bentley 1975).

use std::ops::Range;

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

    /// The `count` nearest, the nearest first.
    pub fn nearest(&self, to: &Point, count: usize) -> Vec<Near> {
        self.nearest_of(to, count, &Known::default())
    }

    /// The `count` nearest of those that are not to be left out.
    pub fn nearest_of(&self, to: &Point, count: usize, known: &Known) -> Vec<Near> {
        let found = Vec::with_capacity(count);
        let (within, beyond) = (known.within.powi(2), known.hole.powi(2));
        let without = known.without;
        let tree = self;
        let mut search = Search { tree, to, count, within, beyond, without, found };
        search.among(0..self.points.len(), 0, [0.0; 4]);
        let near = |(squared, place): (f64, u32)| {
            let (at, number) = self.points[place as usize];
            Near { squared, number, at }
        };
        search.found.into_iter().map(near).collect()
    }
}

/// Limits that are known before a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Known {
    /// A distance within which at least as many points lie as are wanted: infinite where none is known. It makes the search short.
    pub within: f64,
    /// Points of this number are left out.
    pub without: Option<usize>,
    /// Points nearer than this are left out.
    pub hole: f64,
}

impl Default for Known {
    fn default() -> Self {
        Self { within: f64::INFINITY, without: None, hole: 0.0 }
    }
}

/// A point that was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Near {
    /// The squared distance.
    pub squared: f64,
    /// The number it was given.
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

/// A search that goes on.
struct Search<'a> {
    tree: &'a Tree,
    to: &'a Point,
    count: usize,
    /// Squared; what is farther is not among the nearest.
    within: f64,
    /// Nearer ones are left out, squared.
    beyond: f64,
    without: Option<usize>,
    /// Squared distances and places in the tree of what was found so far, in order: little is moved where one comes between.
    found: Vec<(f64, u32)>,
}

impl Search<'_> {
    fn offer(&mut self, place: usize) {
        let (point, number) = &self.tree.points[place];
        let squared = apart(point, self.to);
        if squared > self.within || squared < self.beyond || self.without == Some(*number) {
            return;
        }
        // From the end: most that come late belong there.
        let before = |other: &(f64, u32)| {
            other.0 < squared
                || (other.0 == squared && self.tree.points[other.1 as usize].1 <= *number)
        };
        let at = self.found.iter().rposition(before).map_or(0, |k| k + 1);
        if at == self.count {
            return;
        }
        self.found.truncate(self.count - 1);
        self.found.insert(at, (squared, place as u32));
        if self.found.len() == self.count {
            self.within = self.within.min(self.found[self.count - 1].0);
        }
    }

    /// Looks at points none of which is nearer than `offsets` along each axis (Arya and Mount 1993).
    fn among(&mut self, points: Range<usize>, depth: usize, offsets: Point) {
        if points.len() <= FEW {
            points.for_each(|place| self.offer(place));
            return;
        }
        let (axis, middle) = (depth % self.tree.axes, points.start + points.len() / 2);
        self.offer(middle);
        let side = self.to[axis] - self.tree.points[middle].0[axis];
        let (before, after) = (points.start..middle, middle + 1..points.end);
        let (near, far) = if side < 0.0 { (before, after) } else { (after, before) };
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
                for (without, hole) in [(None, 0.0), (Some(5), 0.0), (Some(6), 0.3)] {
                    let others = points.iter().filter(|p| Some(p.1) != without);
                    let others = others.map(|(p, _)| apart(p, &to));
                    let mut all: Vec<f64> = others.filter(|d| *d >= hole * hole).collect();
                    all.sort_by(f64::total_cmp);
                    all.truncate(24);
                    // As much as can be known, and nothing.
                    let farthest = all.last().map_or(0.0, |squared| squared.sqrt() * 1.000_001);
                    for within in [f64::INFINITY, 2.0 * farthest, farthest] {
                        let known = Known { within, without, hole };
                        let found = tree.nearest_of(&to, 24, &known);
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
}
