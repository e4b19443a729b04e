//! Looking along a direction: places across it and along it.

use super::Question;
use crate::light::geometry::Motion;
use glam::DVec3;

/// Axes across a direction, and along it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    pub x: DVec3,
    pub y: DVec3,
    /// The direction.
    pub z: DVec3,
}

impl Frame {
    pub(super) fn across(direction: DVec3) -> Self {
        let (x, y) = direction.any_orthonormal_pair();
        Self { x, y, z: direction }
    }

    pub(super) fn of(&self, p: DVec3) -> [f64; 3] {
        [self.x.dot(p), self.y.dot(p), self.z.dot(p)]
    }
}

/// A frame in the axes that a group had before it was turned.
#[derive(Debug, Clone, Copy)]
struct Turned {
    frame: Frame,
    /// Shift by the turn, m.
    shift: [f64; 3],
}

/// A body's places as seen along one direction: in cells across it, in metres along it, growing towards the light.
#[derive(Debug, Clone)]
pub(super) struct Cast {
    pub frame: Frame,
    groups: Vec<Turned>,
    /// The corner of the cells, m.
    pub(crate) low: [f64; 2],
    /// Cells for each metre.
    pub per_m: f64,
}

impl Cast {
    /// In metres until cells are chosen; places are relative to `centre`.
    pub(super) fn new(q: &Question, centre: DVec3, direction: DVec3) -> Self {
        let frame = Frame::across(direction);
        let turned = q.scene.hinges.iter().zip(q.angles).map(|(hinge, angle)| {
            let motion = Motion::about(hinge.point_m, hinge.axis, *angle);
            let back = motion.rotation.conjugate();
            let shift = frame.of(motion.point(centre) - centre);
            let frame = Frame { x: back * frame.x, y: back * frame.y, z: back * frame.z };
            Turned { frame, shift }
        });
        let body = Turned { frame, shift: [0.0; 3] };
        let groups = std::iter::once(body).chain(turned).collect();
        Self { frame, groups, low: [0.0; 2], per_m: 1.0 }
    }

    /// The frame in the axes of a group: its z is the direction.
    #[inline]
    pub(super) fn axes(&self, group: u32) -> &Frame {
        &self.groups[group as usize].frame
    }

    /// A place of a group.
    #[inline]
    pub(super) fn place(&self, group: u32, p: DVec3) -> [f64; 3] {
        let turned = &self.groups[group as usize];
        let (p, shift) = (turned.frame.of(p), turned.shift);
        let across = |k: usize| (p[k] + shift[k] - self.low[k]) * self.per_m;
        [across(0), across(1), p[2] + shift[2]]
    }

    /// How a plane of a group rises along columns and rows, m for each cell.
    pub(super) fn rise(&self, group: u32, normal: DVec3) -> [f64; 2] {
        let [x, y, z] = self.groups[group as usize].frame.of(normal);
        [-x / (z * self.per_m), -y / (z * self.per_m)]
    }

    /// A ball of a group.
    #[inline]
    pub(super) fn ball(&self, group: u32, middle: DVec3, radius_m: f64) -> Ball {
        let [x, y, z] = self.place(group, middle);
        Ball { x, y, high: z + radius_m, radius: radius_m * self.per_m }
    }
}

/// Ball that holds the facets of a cluster.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ball {
    /// Across the direction, cells.
    pub x: f64,
    pub y: f64,
    /// Highest point of the ball along the direction, m.
    pub high: f64,
    /// Cells.
    pub radius: f64,
}

impl Ball {
    /// The cells that it reaches of so many columns and rows, first and last of each; `None` where there are none.
    #[inline]
    pub(super) fn cells(&self, columns: usize, rows: usize) -> Option<[usize; 4]> {
        let (x1, y1) = (self.x + self.radius, self.y + self.radius);
        let (x0, y0) = (self.x - self.radius, self.y - self.radius);
        // Also where a number is none.
        let meets = x1 >= 0.0 && y1 >= 0.0 && x0 < columns as f64 && y0 < rows as f64;
        // A float becomes 0 below 0.
        meets.then(|| {
            [x0 as usize, (x1 as usize).min(columns - 1), y0 as usize, (y1 as usize).min(rows - 1)]
        })
    }

    /// Whether it holds a place, in cells.
    #[inline]
    pub(super) fn holds(&self, x: f64, y: f64) -> bool {
        let (x, y) = (x - self.x, y - self.y);
        x * x + y * y <= self.radius * self.radius
    }
}
