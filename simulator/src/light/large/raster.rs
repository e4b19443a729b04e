//! Points on the facets that face Sun and observer, and what of them is seen.

use super::jitter::Jitter;
use super::{Large, MOST_CELLS, Ordered, Room};
use glam::DVec3;
use std::ops::Range;

/// A point of a receiver.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    /// Across the line of sight and along it, m.
    pub place: [f64; 3],
    /// Its cell.
    pub cell: u32,
    /// Whether it is seen, then whether it is seen and lit.
    pub open: bool,
}

/// The highest surface at each cell's point.
#[derive(Debug, Default)]
pub(super) struct Buffer {
    pub depth: Vec<f64>,
    size: [usize; 2],
}

/// A triangle in cells, depth in metres.
#[derive(Debug, Clone, Copy)]
pub(super) struct Flat {
    pub a: [f64; 3],
    pub b: [f64; 3],
    pub c: [f64; 3],
    /// Twice its area, cells.
    pub twice: f64,
}

impl Flat {
    /// Counter-clockwise as seen from the light, with whether it was turned for that; `None` for an edge.
    pub fn new(a: [f64; 3], b: [f64; 3], c: [f64; 3]) -> Option<(Self, bool)> {
        let twice = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
        if twice > 0.0 {
            Some((Self { a, b, c, twice }, false))
        } else if twice < 0.0 {
            Some((Self { a, b: c, c: b, twice: -twice }, true))
        } else {
            None
        }
    }

    /// The depth at a place, if the triangle is there.
    #[inline]
    pub fn depth(&self, x: f64, y: f64) -> Option<f64> {
        let (x, y) = (x - self.a[0], y - self.a[1]);
        let (bx, by) = (self.b[0] - self.a[0], self.b[1] - self.a[1]);
        let (cx, cy) = (self.c[0] - self.a[0], self.c[1] - self.a[1]);
        let (along_b, along_c) = (x * cy - y * cx, y * bx - x * by);
        let inside = along_b >= 0.0 && along_c >= 0.0 && along_b + along_c <= self.twice;
        inside.then(|| {
            let rise = along_b * (self.b[2] - self.a[2]) + along_c * (self.c[2] - self.a[2]);
            self.a[2] + rise / self.twice
        })
    }

    /// Least and greatest coordinate along an axis.
    #[inline]
    pub fn span(&self, axis: usize) -> (f64, f64) {
        let (a, b, c) = (self.a[axis], self.b[axis], self.c[axis]);
        (a.min(b).min(c), a.max(b).max(c))
    }

    /// The part of the strip between two rows' edges that it may touch: from, to.
    pub fn strip(&self, low: f64, high: f64) -> (f64, f64) {
        let (mut from, mut to) = (f64::INFINITY, f64::NEG_INFINITY);
        let corners = [self.a, self.b, self.c];
        for k in 0..3 {
            let (p, q) = (corners[k], corners[(k + 1) % 3]);
            let rise = q[1] - p[1];
            let clamped = |y: f64| {
                let t = if rise == 0.0 { 0.0 } else { ((y - p[1]) / rise).clamp(0.0, 1.0) };
                p[0] + t * (q[0] - p[0])
            };
            let above = p[1].max(q[1]) >= low && p[1].min(q[1]) <= high;
            if above {
                // Both ends of a level edge.
                let ends = if rise == 0.0 { [p[0], q[0]] } else { [clamped(low), clamped(high)] };
                from = from.min(ends[0]).min(ends[1]);
                to = to.max(ends[0]).max(ends[1]);
            }
        }
        (from, to)
    }
}

impl Buffer {
    /// Calls `hit(cell, place, depth)` for each point under a triangle; places in cells.
    #[inline]
    fn each(&self, flat: &Flat, jitter: &Jitter, mut hit: impl FnMut(usize, [f64; 2], f64)) {
        let ((x0, x1), (y0, y1)) = (flat.span(0), flat.span(1));
        let [width, height] = self.size;
        if x1 < 0.0 || y1 < 0.0 || x0 >= width as f64 || y0 >= height as f64 {
            return;
        }
        // A float becomes 0 below 0.
        let (left, right) = (x0 as usize, (x1 as usize).min(width - 1));
        let (first, last) = (y0 as usize, (y1 as usize).min(height - 1));
        let wide = (right - left + 1) * (last - first + 1) > 64;
        for row in first..=last {
            let (mut from, mut to) = (left, right);
            if wide {
                let (low, high) = flat.strip(row as f64, row as f64 + 1.0);
                // A cell more on either side, for rounding.
                from = from.max((low - 1.0).max(0.0) as usize);
                to = to.min((high + 1.0).max(0.0) as usize);
            }
            for column in from..=to {
                let [dx, dy] = jitter.at(column, row);
                let place = [column as f64 + dx, row as f64 + dy];
                if let Some(depth) = flat.depth(place[0], place[1]) {
                    hit(row * width + column, place, depth);
                }
            }
        }
    }
}

impl Ordered {
    /// Whether it can hide nothing in the directions of the groups: it belongs to a closed body and faces the other way.
    #[inline]
    pub(super) fn looks_away(&self, towards: &[DVec3]) -> bool {
        !self.sheet && self.normal.dot(towards[self.group as usize]) <= 0.0
    }
}

impl Large {
    fn triangles_of(&self, number: usize) -> Range<usize> {
        let start = if number == 0 { 0 } else { self.facets[number - 1].end as usize };
        start..self.facets[number].end as usize
    }

    /// Fills the depth buffer and takes the receivers' points; `None` where the buffer would be too large.
    pub(super) fn raster(&self, cell: f64, towards: &[DVec3], room: &mut Room) -> Option<()> {
        let Room { projected, receivers, buffer, points, .. } = room;
        let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
        for receiver in receivers.iter() {
            let own = self.triangles_of(receiver.number as usize);
            for p in self.triangles[own].iter().flatten().map(|k| projected[*k as usize]) {
                low = [low[0].min(p[0]), low[1].min(p[1])];
                high = [high[0].max(p[0]), high[1].max(p[1])];
            }
        }
        let cells = |k: usize| ((high[k] - low[k]) / cell).ceil().max(1.0);
        if cells(0) * cells(1) > MOST_CELLS {
            return None;
        }
        buffer.size = [cells(0) as usize, cells(1) as usize];
        buffer.depth.clear();
        buffer.depth.resize(buffer.size[0] * buffer.size[1], f64::NEG_INFINITY);
        let per_cell = 1.0 / cell;
        for p in projected.iter_mut() {
            p[0] = (p[0] - low[0]) * per_cell;
            p[1] = (p[1] - low[1]) * per_cell;
        }
        let mut depth = std::mem::take(&mut buffer.depth);
        let (mut next, mut start) = (0, 0);
        for (number, ordered) in self.facets.iter().enumerate() {
            let own = start..ordered.end as usize;
            start = own.end;
            if ordered.looks_away(towards) {
                continue;
            }
            let receives = receivers.get(next).is_some_and(|r| r.number as usize == number);
            for &[a, b, c] in &self.triangles[own] {
                let at = |k: u32| projected[k as usize];
                let Some((flat, turned)) = Flat::new(at(a), at(b), at(c)) else { continue };
                if turned && !ordered.sheet {
                    continue;
                }
                buffer.each(&flat, &self.jitter, |cell, place, z| {
                    if z > depth[cell] {
                        depth[cell] = z;
                    }
                    if receives && !turned {
                        let place = [place[0], place[1], z];
                        points.push(Point { place, cell: cell as u32, open: false });
                    }
                });
            }
            if receives {
                receivers[next].end = points.len() as u32;
                next += 1;
            }
        }
        buffer.depth = depth;
        for point in points.iter_mut() {
            point.place[0] = low[0] + point.place[0] * cell;
            point.place[1] = low[1] + point.place[1] * cell;
        }
        Some(())
    }
}
