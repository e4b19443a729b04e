//! Points on the facets that face Sun and observer, and what of them is seen.

use super::cast::Cast;
use super::cover::{Canvas, Spot};
use super::jitter::Jitter;
use super::{Large, MOST_CELLS, Receiver, Room};
use std::ops::RangeInclusive;

/// A point of a receiver.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    /// Across the line of sight and along it, m.
    pub place: [f64; 3],
    /// Cell of the point.
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

/// A depth buffer being filled.
struct Filling<'a> {
    buffer: &'a mut Buffer,
    jitter: &'a Jitter,
    points: &'a mut Vec<Point>,
    receivers: &'a mut [Receiver],
    /// The receiver at hand or the next.
    receiver: usize,
    receives: bool,
}

impl Filling<'_> {
    /// Goes on to the first receiver from a facet on.
    fn skip_to(&mut self, number: usize) {
        while let Some(receiver) = self.receivers.get_mut(self.receiver)
            && (receiver.number as usize) < number
        {
            receiver.end = self.points.len() as u32;
            self.receiver += 1;
        }
    }
}

impl Canvas for Filling<'_> {
    fn size(&self) -> [usize; 2] {
        self.buffer.size
    }

    #[inline]
    fn spots(&self, row: usize, columns: RangeInclusive<usize>, _: f64, out: &mut Vec<Spot>) {
        let first = row * self.buffer.size[0];
        out.extend(columns.map(|column| {
            let [dx, dy] = self.jitter.at(column, row);
            let (x, y) = (column as f64 + dx, row as f64 + dy);
            Spot { number: (first + column) as u32, x, y }
        }));
    }

    #[inline]
    fn next(&mut self, number: usize, front: bool) {
        self.skip_to(number);
        let next = self.receivers.get(self.receiver);
        self.receives = front && next.is_some_and(|r| r.number as usize == number);
    }

    #[inline]
    fn cover(&mut self, spot: &Spot, depth: f64) {
        let top = &mut self.buffer.depth[spot.number as usize];
        *top = top.max(depth);
        if self.receives {
            let place = [spot.x, spot.y, depth];
            self.points.push(Point { place, cell: spot.number, open: false });
        }
    }
}

impl Large {
    /// Fills the depth buffer and takes the receivers' points; `None` where the buffer would be too large.
    pub(super) fn raster(&self, cell: f64, view: &mut Cast, room: &mut Room) -> Option<()> {
        let Room { receivers, buffer, points, cover, .. } = room;
        let (low, high) = self.extent(view, receivers);
        let cells = |k: usize| ((high[k] - low[k]) / cell).ceil().max(1.0);
        if cells(0) * cells(1) > MOST_CELLS {
            return None;
        }
        buffer.size = [cells(0) as usize, cells(1) as usize];
        buffer.depth.clear();
        buffer.depth.resize(buffer.size[0] * buffer.size[1], f64::NEG_INFINITY);
        (view.low, view.per_m) = (low, 1.0 / cell);
        let jitter = &self.jitter;
        let mut filling =
            Filling { buffer, jitter, points, receivers, receiver: 0, receives: false };
        self.cover(view, &mut filling, cover);
        filling.skip_to(self.facets.len());
        for point in points.iter_mut() {
            point.place[0] = low[0] + point.place[0] * cell;
            point.place[1] = low[1] + point.place[1] * cell;
        }
        Some(())
    }

    /// The rectangle that holds the receivers, m: low and high corner. The cast is still in metres.
    fn extent(&self, view: &Cast, receivers: &[Receiver]) -> ([f64; 2], [f64; 2]) {
        let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
        for receiver in receivers {
            let cluster = &self.clusters[receiver.cluster as usize];
            let ball = cluster.ball(view);
            let within = ball.x - ball.radius >= low[0]
                && ball.y - ball.radius >= low[1]
                && ball.x + ball.radius <= high[0]
                && ball.y + ball.radius <= high[1];
            if within {
                continue;
            }
            for corner in self.outline(receiver.number as usize) {
                let p = view.place(cluster.kind.group, self.vertices[*corner as usize]);
                low = [low[0].min(p[0]), low[1].min(p[1])];
                high = [high[0].max(p[0]), high[1].max(p[1])];
            }
        }
        (low, high)
    }
}
