//! Facets held over points: which of them lie under which facet.

use super::Large;
use super::cast::Cast;
use super::cluster::MOST;
use std::ops::RangeInclusive;

/// Cells over which all facets of a cluster are asked together; over more of them each facet goes through those that its outline touches.
const FEW: usize = 48;
/// Cells of an outline's rectangle from which on it is taken row by row.
const WIDE: usize = 64;

/// Points in cells across a direction, some in each or none.
pub(super) trait Canvas {
    /// Columns and rows.
    fn size(&self) -> [usize; 2];

    /// Appends the points of some cells of a row that what reaches `high` (m along the direction) may cover.
    fn spots(&self, row: usize, columns: RangeInclusive<usize>, high: f64, out: &mut Vec<Spot>);

    /// The facet of this number is next; it shows its front, or (of a sheet) its back. No facet comes twice, and their numbers grow.
    fn next(&mut self, number: usize, front: bool);

    /// The facet lies over a point at this depth, m.
    fn cover(&mut self, spot: &Spot, depth: f64);
}

/// A point of a canvas.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spot {
    /// Number of the point on the canvas.
    pub number: u32,
    /// Place of the point in cells.
    pub x: f64,
    pub y: f64,
}

/// A facet in cells, depth in metres.
#[derive(Debug, Default)]
struct Flat {
    /// Counter-clockwise as seen from the light.
    corners: Vec<[f64; 3]>,
    /// Least and greatest of each coordinate.
    low: [f64; 3],
    high: [f64; 3],
    /// How it rises along the columns and the rows, m for each cell.
    rise: [f64; 2],
}

impl Flat {
    fn set(&mut self, large: &Large, number: usize, group: u32, cast: &Cast, front: bool) {
        self.corners.clear();
        let outline = large.outline(number);
        self.corners.extend(outline.iter().map(|k| cast.place(group, large.vertices[*k as usize])));
        if !front {
            self.corners.reverse();
        }
        (self.low, self.high) = ([f64::MAX; 3], [f64::MIN; 3]);
        for corner in &self.corners {
            for (k, x) in corner.iter().enumerate() {
                self.low[k] = self.low[k].min(*x);
                self.high[k] = self.high[k].max(*x);
            }
        }
        self.rise = cast.rise(group, large.facets[number].normal);
    }

    /// The depth at a place, if the facet is there.
    #[inline]
    fn depth(&self, x: f64, y: f64) -> Option<f64> {
        let mut twice = 0.0;
        let mut p = self.corners.last()?;
        for q in &self.corners {
            let area = (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]);
            if area < 0.0 {
                return None;
            }
            twice += area;
            p = q;
        }
        // An edge-on plane rises without bound, its corners do not.
        let height = p[2] + (x - p[0]) * self.rise[0] + (y - p[1]) * self.rise[1];
        (twice > 0.0).then(|| height.max(self.low[2]).min(self.high[2]))
    }

    /// The part of the strip between two rows' edges that it may touch: from, to.
    fn strip(&self, low: f64, high: f64) -> (f64, f64) {
        let (mut from, mut to) = (f64::INFINITY, f64::NEG_INFINITY);
        for (k, p) in self.corners.iter().enumerate() {
            let q = self.corners[(k + 1) % self.corners.len()];
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

    /// Covers what lies in the cells that its outline touches.
    fn cover(&self, canvas: &mut impl Canvas, spots: &mut Vec<Spot>) {
        let [columns, rows] = canvas.size();
        let ([x0, y0, _], [x1, y1, high]) = (self.low, self.high);
        if x1 < 0.0 || y1 < 0.0 || x0 >= columns as f64 || y0 >= rows as f64 {
            return;
        }
        // A float becomes 0 below 0.
        let (left, right) = (x0 as usize, (x1 as usize).min(columns - 1));
        let (first, last) = (y0 as usize, (y1 as usize).min(rows - 1));
        let wide = (right - left + 1) * (last - first + 1) > WIDE;
        for row in first..=last {
            let (mut from, mut to) = (left, right);
            if wide {
                let (low, high) = self.strip(row as f64, row as f64 + 1.0);
                // A cell more on either side, for rounding.
                from = from.max((low - 1.0).max(0.0) as usize);
                to = to.min((high + 1.0).max(0.0) as usize);
                if from > to {
                    continue;
                }
            }
            spots.clear();
            canvas.spots(row, from..=to, high, spots);
            for spot in spots.iter() {
                if let Some(depth) = self.depth(spot.x, spot.y) {
                    canvas.cover(spot, depth);
                }
            }
        }
    }
}

/// Room to work in.
#[derive(Debug, Default)]
pub(super) struct Room {
    flat: Flat,
    spots: Vec<Spot>,
    /// Facets of the cluster at hand that may lie over each point.
    over: Vec<u32>,
}

impl Large {
    /// Holds all facets over a canvas that may hide something from light along a cast.
    pub(super) fn cover(&self, cast: &Cast, canvas: &mut impl Canvas, room: &mut Room) {
        let Room { flat, spots, over } = room;
        let [columns, rows] = canvas.size();
        let metre = 1.0 / cast.per_m;
        for (number, cluster, own) in self.clusters() {
            let (group, sheet) = (cluster.kind.group, cluster.kind.sheet);
            let toward = cast.axes(group).z;
            if !sheet && cluster.faces_away(toward) {
                continue;
            }
            let ball = cluster.ball(cast);
            let Some([left, right, first, last]) = ball.cells(columns, rows) else { continue };
            if (right - left + 1) * (last - first + 1) > FEW {
                for number in own {
                    let front = self.facets[number].normal.dot(toward) > 0.0;
                    if front || sheet {
                        canvas.next(number, front);
                        flat.set(self, number, group, cast, front);
                        flat.cover(canvas, spots);
                    }
                }
                continue;
            }
            spots.clear();
            for row in first..=last {
                canvas.spots(row, left..=right, ball.high, spots);
            }
            spots.retain(|spot| ball.holds(spot.x, spot.y));
            if spots.is_empty() {
                continue;
            }
            let discs = cluster.discs(&self.balls[number as usize], cast);
            let place = |at: f64, middle: f64| ((at - middle) * metre) as f32;
            over.clear();
            over.extend(spots.iter().map(|s| discs.over(place(s.x, ball.x), place(s.y, ball.y))));
            let any = over.iter().fold(0, |any, bits| any | bits);
            // Most facets lie over no point: their corners are not asked for.
            for k in (0..MOST).filter(|k| any >> k & 1 == 1) {
                let number = own.start + k;
                let front = self.facets[number].normal.dot(toward) > 0.0;
                // Single precision may have taken it for one that faces the light.
                if !front && !sheet {
                    continue;
                }
                canvas.next(number, front);
                flat.set(self, number, group, cast, front);
                for (spot, _) in spots.iter().zip(&*over).filter(|(_, bits)| *bits >> k & 1 == 1) {
                    if let Some(depth) = flat.depth(spot.x, spot.y) {
                        canvas.cover(spot, depth);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Question;
    use super::*;
    use crate::light::scene::Scene;
    use crate::mesh::Mesh;
    use crate::mesh::shapes::{Faceting, icosphere, plate};
    use crate::target::{Shape, Target};
    use glam::{DVec2, DVec3};

    /// A point in each cell, and the highest that lay over it.
    struct Heights {
        size: [usize; 2],
        places: Vec<[f64; 2]>,
        tops: Vec<f64>,
        last: Option<usize>,
    }

    impl Canvas for Heights {
        fn size(&self) -> [usize; 2] {
            self.size
        }

        fn spots(&self, row: usize, columns: RangeInclusive<usize>, _: f64, out: &mut Vec<Spot>) {
            out.extend(columns.map(|column| {
                let number = row * self.size[0] + column;
                let [x, y] = self.places[number];
                Spot { number: number as u32, x, y }
            }));
        }

        fn next(&mut self, number: usize, _: bool) {
            assert!(self.last.is_none_or(|last| last < number));
            self.last = Some(number);
        }

        fn cover(&mut self, spot: &Spot, depth: f64) {
            let top = &mut self.tops[spot.number as usize];
            *top = top.max(depth);
        }
    }

    /// Hills of 5,120 triangles, sheets of 1 mm to 1 m about them that show either side, slivers of 1 m × 1 µm.
    fn body() -> Mesh {
        let mut mesh = icosphere(1.0, 4, Faceting::SameArea);
        for v in &mut mesh.vertices {
            *v *= 1.0 + 0.1 * ((7.0 * v.x).sin() + (9.0 * v.y).cos() + (5.0 * v.z + v.x).sin());
        }
        for k in 0..60 {
            let size = [1e-3, 1e-2, 0.1, 1.0][k % 4];
            let shape = if k % 5 == 0 { DVec2::new(1.0, 1e-6) } else { DVec2::splat(size) };
            let mut sheet = plate(shape, true, false);
            let turn = glam::DQuat::from_rotation_x(0.7 * k as f64)
                * glam::DQuat::from_rotation_y(0.3 * k as f64);
            let place = turn * DVec3::new(0.0, 0.02 * k as f64, 1.2);
            sheet.vertices.iter_mut().for_each(|v| *v = turn * *v + place);
            mesh = Mesh::merged([&mesh, &sheet]);
        }
        mesh
    }

    /// The highest place of a mesh over a point, along a direction: the ray through it against each triangle (Möller and Trumbore 1997).
    fn top(mesh: &Mesh, point: DVec3, along: DVec3) -> f64 {
        let heights = mesh.triangles.iter().filter_map(|corners| {
            let [a, b, c] = corners.map(|k| mesh.vertices[k as usize]);
            let (ab, ac, from) = (b - a, c - a, point - a);
            let across = along.cross(ac);
            let det = ab.dot(across);
            let u = from.dot(across) / det;
            let turned = from.cross(ab);
            let v = along.dot(turned) / det;
            (u >= 0.0 && v >= 0.0 && u + v <= 1.0)
                .then(|| (point + ac.dot(turned) / det * along).dot(along))
        });
        heights.fold(f64::NEG_INFINITY, f64::max)
    }

    /// Truth: rays through the triangles of the mesh, which know no clusters and no cells. Heights agree within 1e-7 m: places are single
    /// within 1e-10 of the body (welded corners), which a plane at a cosine of 1e-3 makes 1e-7. From few points to hundreds for each facet.
    #[test]
    fn nothing_that_lies_over_a_point_is_lost() {
        let mut target = Target::built_in("lambert_sphere").unwrap();
        let mesh = body();
        target.parts[0].shape = Shape::Mesh(mesh.clone());
        let scene = Scene::with_tolerance(&target, 0.1).unwrap();
        let large = scene.large.as_ref().unwrap();
        let mut room = Room::default();
        for (trial, cells) in [20, 60, 200, 20, 60].into_iter().enumerate() {
            let (sun, to) = super::super::prepare::directions(trial);
            let q = Question { scene: &scene, angles: &[], sun, to, stride: 0 };
            let mut cast = Cast::new(&q, large.centre, to);
            (cast.low, cast.per_m) = ([-2.0; 2], f64::from(cells) / 4.0);
            let side = cells as usize;
            let jitter = super::super::jitter::Jitter::new();
            let places = (0..side * side).map(|n| {
                let [dx, dy] = jitter.at(n % side, n / side);
                [(n % side) as f64 + dx, (n / side) as f64 + dy]
            });
            let places: Vec<[f64; 2]> = places.collect();
            let tops = vec![f64::NEG_INFINITY; places.len()];
            let mut canvas = Heights { size: [side; 2], places, tops, last: None };
            large.cover(&cast, &mut canvas, &mut room);
            let frame = cast.frame;
            let (mut covered, step) = (0, 1 + side * side / 1500);
            for ([x, y], found) in canvas.places.iter().zip(&canvas.tops).step_by(step) {
                let across = |at: f64| at / cast.per_m - 2.0;
                let point = large.centre + across(*x) * frame.x + across(*y) * frame.y;
                let truth = top(&mesh, point, to);
                let found = found + large.centre.dot(to);
                let same = found == truth || (found - truth).abs() <= 1e-7;
                assert!(same, "{trial}: {found} {truth} at {x} {y}");
                covered += usize::from(truth.is_finite());
            }
            // The body covers a quarter of the square or more.
            assert!(covered * step > side * side / 5, "{covered}");
        }
    }
}
