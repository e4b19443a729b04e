//! Surfaces in cells, and how much of each cell a set of polygons fills.

use super::cast::{Caster, Hit, Ray};
use super::split::{Piece, beyond, line};
use super::surfaces::{Surfaces, in_polygon};
use crate::light::clip::{self, P2};
use glam::DVec3;
use std::ops::Range;

/// Cells smaller than this, of their surface, are left out: slivers at a slanted edge.
const SLIVER: f64 = 1e-9;

/// Pieces of a surface narrower than this, of the size of the cells, are not divided.
const NARROW: f64 = 0.35;

/// A surface, or a piece of it, in cells along its longest edge.
#[derive(Debug, Clone)]
pub struct Cells {
    /// Number of the surface.
    pub surface: usize,
    /// The edges of the piece in the surface's axes, positive inside.
    edges: Vec<[f64; 3]>,
    /// First axis of the cells, in the surface's axes.
    axis: P2,
    low: P2,
    step: P2,
    count: [usize; 2],
    /// For each cell its patch; `NONE` where it lies outside.
    patch: Vec<u32>,
}

/// A cell, cut to its surface.
#[derive(Debug, Clone)]
pub struct Patch {
    /// Number in the list of [`Cells`].
    pub cells: usize,
    pub area: f64,
    /// Corners in the surface's axes.
    corners: Vec<P2>,
    pub middle: P2,
    /// The larger patch (of two by two cells) that it belongs to.
    pub coarse: usize,
}

const NONE: u32 = u32::MAX;

/// Surfaces in patches.
#[derive(Debug, Clone, Default)]
pub struct Patches {
    pub cells: Vec<Cells>,
    pub list: Vec<Patch>,
    /// The areas of the larger patches, m².
    pub coarse_area: Vec<f64>,
    /// How many of the patches, and of the larger ones, are diffuse: they are the first.
    pub diffuse: [usize; 2],
}

impl Patch {
    /// A point spread evenly over it, in the surface's axes.
    pub fn even(&self, a: f64, b: f64) -> P2 {
        in_polygon(&self.corners, self.area, a, b)
    }
}

impl Patches {
    /// Pieces (those of one surface one after the other; first diffuse ones, then rough ones) in cells of at most `size_m`, an even number along each side
    /// that takes more than one.
    pub fn new([diffuse, rough]: [&[Piece]; 2], size_m: f64) -> Self {
        let mut patches = Self::default();
        for piece in diffuse {
            patches.add(piece.surface, &piece.corners, size_m);
        }
        patches.diffuse = [patches.list.len(), patches.coarse_area.len()];
        for piece in rough {
            patches.add(piece.surface, &piece.corners, size_m);
        }
        patches
    }

    /// The patch whose front a ray meets first, if it is one, with its surface and the place; `of_surface` are the cells of each surface.
    pub fn met(
        &self,
        surfaces: &Surfaces,
        caster: &Caster,
        of_surface: &[Range<usize>],
        ray: &Ray,
    ) -> Option<(usize, usize, DVec3)> {
        self.met_by(surfaces, of_surface, ray, caster.first(ray)?)
    }

    /// The same of the surface that a ray meets first.
    pub fn met_by(
        &self,
        surfaces: &Surfaces,
        of_surface: &[Range<usize>],
        ray: &Ray,
        hit: Hit,
    ) -> Option<(usize, usize, DVec3)> {
        if !hit.front {
            return None;
        }
        let cells = of_surface[hit.surface].clone();
        if cells.is_empty() {
            return None;
        }
        let surface = &surfaces.list[hit.surface];
        let at = ray.from + hit.distance * ray.along;
        let there = at - surface.origin;
        let there = [there.dot(surface.tangent), there.dot(surface.bitangent)];
        Some((self.at(cells, there)?, hit.surface, at))
    }

    /// The patch at a point of a surface (its axes), whose cells are these.
    pub fn at(&self, cells: Range<usize>, p: P2) -> Option<usize> {
        let cells = &self.cells[cells];
        let cells = match cells {
            [alone] => alone,
            _ => cells.iter().max_by(|a, b| a.depth(p).total_cmp(&b.depth(p)))?,
        };
        cells.at(p)
    }

    /// The lists of cells of each surface that has any.
    pub fn of_surfaces(&self) -> impl Iterator<Item = &[Cells]> {
        self.cells.chunk_by(|a, b| a.surface == b.surface)
    }

    fn add(&mut self, surface: usize, corners: &[P2], size_m: f64) {
        let edge = |k: usize| {
            let (a, b) = (corners[k], corners[(k + 1) % corners.len()]);
            [b[0] - a[0], b[1] - a[1]]
        };
        let length = |e: P2| e[0].hypot(e[1]);
        let longest = (0..corners.len())
            .max_by(|a, b| length(edge(*a)).total_cmp(&length(edge(*b))))
            .map_or([1.0, 0.0], edge);
        let axis = [longest[0] / length(longest), longest[1] / length(longest)];
        let ring: Vec<P2> = corners.iter().map(|p| turned(axis, *p)).collect();
        let bounds = clip::bounds(&ring);
        let size = [bounds[2] - bounds[0], bounds[3] - bounds[1]];
        let count = size
            .map(|s| if s <= NARROW * size_m { 1 } else { 2 * (0.5 * s / size_m).ceil() as usize });
        let step = [size[0] / count[0] as f64, size[1] / count[1] as f64];
        let number = self.cells.len();
        let mut cells = Cells {
            surface,
            edges: (0..corners.len())
                .map(|k| line(corners[k], corners[(k + 1) % corners.len()]))
                .collect(),
            axis,
            low: [bounds[0], bounds[1]],
            step,
            count,
            patch: vec![NONE; count[0] * count[1]],
        };
        let whole = clip::area(&ring);
        let mut coarse = std::collections::BTreeMap::new();
        let mut room = Room::default();
        for row in 0..count[1] {
            for column in 0..count[0] {
                let cell = cells.cut(&ring, column, row, &mut room);
                if cell.len() < 3 || clip::area(cell) < SLIVER * whole {
                    continue;
                }
                let area = clip::area(cell);
                let corners: Vec<P2> =
                    cell.iter().map(|p| turned([axis[0], -axis[1]], *p)).collect();
                let n = corners.len() as f64;
                let middle =
                    corners.iter().fold([0.0, 0.0], |m, p| [m[0] + p[0] / n, m[1] + p[1] / n]);
                let coarse = *coarse.entry((row / 2, column / 2)).or_insert_with(|| {
                    self.coarse_area.push(0.0);
                    self.coarse_area.len() - 1
                });
                self.coarse_area[coarse] += area;
                cells.patch[row * count[0] + column] = self.list.len() as u32;
                self.list.push(Patch { cells: number, area, corners, middle, coarse });
            }
        }
        self.cells.push(cells);
    }
}

/// Coordinates along `axis` and across it.
fn turned(axis: P2, p: P2) -> P2 {
    [p[0] * axis[0] + p[1] * axis[1], p[1] * axis[0] - p[0] * axis[1]]
}

/// Room for cutting.
#[derive(Debug, Default)]
pub struct Room {
    ring: Vec<P2>,
    strip: Vec<P2>,
    cell: Vec<P2>,
    spare: Vec<P2>,
}

impl Cells {
    /// How far within the piece a point of the surface (its axes) lies, m; below 0 outside.
    pub fn depth(&self, p: P2) -> f64 {
        let depth = |e: &[f64; 3]| e[0] * p[0] + e[1] * p[1] + e[2];
        self.edges.iter().map(depth).fold(f64::INFINITY, f64::min)
    }

    /// The patch at a point of the piece (the surface's axes), if there is one.
    pub fn at(&self, p: P2) -> Option<usize> {
        let p = turned(self.axis, p);
        let cell = |k: usize| {
            // A float becomes 0 below 0.
            (((p[k] - self.low[k]) / self.step[k]) as usize).min(self.count[k] - 1)
        };
        let patch = self.patch[cell(1) * self.count[0] + cell(0)];
        (patch != NONE).then_some(patch as usize)
    }

    /// All its patches.
    pub fn patches(&self) -> impl Iterator<Item = usize> + '_ {
        self.patch.iter().filter(|p| **p != NONE).map(|p| *p as usize)
    }

    fn cut<'a>(&self, ring: &[P2], column: usize, row: usize, room: &'a mut Room) -> &'a [P2] {
        room.strip.clear();
        room.strip.extend_from_slice(ring);
        self.between(0, column, &mut room.strip, &mut room.spare);
        room.cell.clear();
        room.cell.extend_from_slice(&room.strip);
        self.between(1, row, &mut room.cell, &mut room.spare);
        &room.cell
    }

    /// Cuts a convex ring to its part in one column (axis 0) or row (axis 1) of cells.
    fn between(&self, axis: usize, k: usize, ring: &mut Vec<P2>, spare: &mut Vec<P2>) {
        let from = self.low[axis] + k as f64 * self.step[axis];
        // The first and the last reach beyond: nothing is lost to rounding.
        if k > 0 {
            half(ring, axis, from, 1.0, spare);
            std::mem::swap(ring, spare);
        }
        if k + 1 < self.count[axis] {
            half(ring, axis, from + self.step[axis], -1.0, spare);
            std::mem::swap(ring, spare);
        }
    }

    /// Adds to each patch the area (m²) of a convex polygon (of the surface, in its axes) within it; `whole` where the piece is the whole surface.
    pub fn share(&self, polygon: &[P2], whole: bool, room: &mut Room, out: &mut [f64]) {
        let mut ring = std::mem::take(&mut room.ring);
        ring.clear();
        ring.extend_from_slice(polygon);
        if !whole {
            for edge in &self.edges {
                beyond(&ring, *edge, &mut room.spare);
                std::mem::swap(&mut ring, &mut room.spare);
            }
        }
        if ring.len() < 3 {
            room.ring = ring;
            return;
        }
        ring.iter_mut().for_each(|p| *p = turned(self.axis, *p));
        let bounds = clip::bounds(&ring);
        let range = |axis: usize| {
            let cell = |x: f64| {
                (((x - self.low[axis]) / self.step[axis]) as usize).min(self.count[axis] - 1)
            };
            cell(bounds[axis])..=cell(bounds[axis + 2])
        };
        for column in range(0) {
            room.strip.clear();
            room.strip.extend_from_slice(&ring);
            self.between(0, column, &mut room.strip, &mut room.spare);
            if room.strip.len() < 3 {
                continue;
            }
            for row in range(1) {
                let patch = self.patch[row * self.count[0] + column];
                if patch == NONE {
                    continue;
                }
                room.cell.clear();
                room.cell.extend_from_slice(&room.strip);
                self.between(1, row, &mut room.cell, &mut room.spare);
                if room.cell.len() >= 3 {
                    out[patch as usize] += clip::area(&room.cell);
                }
            }
        }
        room.ring = ring;
    }
}

/// The part of a convex ring where `sign`·(coordinate − at) is not negative.
fn half(ring: &[P2], axis: usize, at: f64, sign: f64, out: &mut Vec<P2>) {
    out.clear();
    let Some(&last) = ring.last() else { return };
    let mut a = last;
    let mut da = sign * (a[axis] - at);
    for &b in ring {
        let db = sign * (b[axis] - at);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::Scene;
    use crate::light::bounce::split;
    use crate::light::bounce::surfaces::{Outline, Surfaces};
    use crate::target::Target;

    /// Truth: areas add up. The cells of a surface cover it, and what they take of a smaller polygon is that polygon: 1e-12 of the surface.
    /// Points of a patch lie in it.
    #[test]
    fn cells_cover_their_surface() {
        for name in ["corner", "hexagon", "box_with_panels"] {
            let scene = Scene::new(&Target::built_in(name).unwrap()).unwrap();
            let surfaces = Surfaces::new(&scene);
            let all: Vec<usize> = (0..surfaces.list.len()).collect();
            for size in [10.0, 0.3, 0.07] {
                let pieces = split::pieces(&surfaces.list, &all, scene.touching_m).unwrap();
                let patches = Patches::new([&pieces, &[]], size);
                let mut room = Room::default();
                for list in patches.of_surfaces() {
                    let surface = &surfaces.list[list[0].surface];
                    let own = || list.iter().flat_map(|cells| cells.patches());
                    let area: f64 = own().map(|p| patches.list[p].area).sum();
                    assert!((area / surface.area - 1.0).abs() < 1e-8, "{name} {size}");
                    let Outline::Polygon(corners) = &surface.shape else { continue };
                    let small: Vec<P2> =
                        corners.iter().map(|p| [0.4 * p[0] + 0.1, 0.5 * p[1] - 0.05]).collect();
                    let mut out = vec![0.0; patches.list.len()];
                    let whole = list.len() == 1;
                    let mut share = |polygon: &[P2], out: &mut [f64]| {
                        list.iter().for_each(|cells| cells.share(polygon, whole, &mut room, out));
                    };
                    share(corners, &mut out);
                    for p in own() {
                        let cells = &patches.cells[patches.list[p].cells];
                        let truth = patches.list[p].area;
                        assert!((out[p] - truth).abs() < 1e-12 * surface.area, "{name} {size}");
                        let q = patches.list[p].even(0.37, 0.8);
                        assert_eq!(
                            cells.at(q),
                            Some(p),
                            "{name} {size} {:?} {q:?}",
                            patches.list[p]
                        );
                    }
                    if name == "corner" {
                        out.fill(0.0);
                        share(&small, &mut out);
                        let sum: f64 = out.iter().sum();
                        let inside = small.iter().all(|p| {
                            list.iter()
                                .any(|cells| cells.depth(*p) >= 0.0 && cells.at(*p).is_some())
                        });
                        let error = (sum - clip::area(&small)).abs();
                        assert!(!inside || error < 1e-12 * surface.area, "{error}");
                    }
                }
                let coarse: f64 = patches.coarse_area.iter().sum();
                let fine: f64 = patches.list.iter().map(|p| p.area).sum();
                assert!((coarse / fine - 1.0).abs() < 1e-12);
            }
        }
    }
}
