//! Densities on the unit square and the maps that they define: bilinear between nodes, linear between slices.
//!
//! A point u goes to s = (how much of its row is to the left, how much of all is below) and back; the map takes area to density. x is the last axis.

use glam::DVec2;

/// A few slices with their weights, which sum to 1.
pub type Blend = [(usize, f64); 4];

/// Slices of a density, each normalised to 1 over the square.
#[derive(Debug, Clone)]
pub struct Warp {
    grid: Grid,
    /// Per slice and row: the integral up to the row, in units of a cell's sides.
    marginal: Vec<f64>,
    /// Per slice and node: the integral along the row up to it.
    conditional: Vec<f64>,
}

/// Values on nodes from 0 to 1 inclusive in both coordinates.
#[derive(Debug, Clone)]
pub struct Grid {
    /// Nodes along y, of one slice.
    pub rows: usize,
    /// Nodes along x.
    pub columns: usize,
    /// Slice by slice, row by row.
    pub values: Vec<f32>,
}

/// A place between four nodes.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    pub row: usize,
    pub column: usize,
    pub x: f64,
    pub y: f64,
}

impl Grid {
    /// Between which nodes a point is; held at the ends.
    pub fn place(&self, u: impl Into<DVec2>) -> Place {
        let u = u.into();
        let along = |u: f64, nodes: usize| {
            let x = u.clamp(0.0, 1.0) * (nodes - 1) as f64;
            let node = (x as usize).min(nodes - 2);
            (node, x - node as f64)
        };
        let ((column, x), (row, y)) = (along(u.x, self.columns), along(u.y, self.rows));
        Place { row, column, x, y }
    }

    /// The value at a point of one slice, bilinear.
    pub fn at(&self, u: impl Into<DVec2>) -> f64 {
        let Place { row, column, x, y } = self.place(u);
        let v = |r: usize, c: usize| f64::from(self.values[(row + r) * self.columns + column + c]);
        (1.0 - y) * ((1.0 - x) * v(0, 0) + x * v(0, 1)) + y * ((1.0 - x) * v(1, 0) + x * v(1, 1))
    }
}

impl Warp {
    /// `values` slice by slice, none negative; `None` where a slice is 0 everywhere.
    pub fn new(mut grid: Grid) -> Option<Self> {
        let (rows, columns) = (grid.rows, grid.columns);
        let slices = grid.values.len() / (rows * columns);
        let mut marginal = vec![0.0; slices * rows];
        let mut conditional = vec![0.0; slices * rows * columns];
        for slice in 0..slices {
            let nodes = slice * rows * columns..(slice + 1) * rows * columns;
            let values = &mut grid.values[nodes.clone()];
            let conditional = &mut conditional[nodes];
            let marginal = &mut marginal[slice * rows..(slice + 1) * rows];
            for row in 0..rows {
                let mut sum = 0.0;
                for column in 1..columns {
                    let at = row * columns + column;
                    sum += 0.5 * (f64::from(values[at - 1]) + f64::from(values[at]));
                    conditional[at] = sum;
                }
            }
            for row in 1..rows {
                let of = |row: usize| conditional[row * columns + columns - 1];
                marginal[row] = marginal[row - 1] + 0.5 * (of(row - 1) + of(row));
            }
            let whole = marginal[rows - 1];
            if !(whole > 0.0 && whole.is_finite()) {
                return None;
            }
            values.iter_mut().for_each(|v| *v = (f64::from(*v) / whole) as f32);
            conditional.iter_mut().for_each(|v| *v /= whole);
            marginal.iter_mut().for_each(|v| *v /= whole);
        }
        Some(Self { grid, marginal, conditional })
    }

    fn value(&self, blend: &Blend, row: usize, column: usize) -> f64 {
        let at = |slice: usize| (slice * self.grid.rows + row) * self.grid.columns + column;
        blend.iter().map(|(slice, w)| w * f64::from(self.grid.values[at(*slice)])).sum()
    }

    fn along_row(&self, blend: &Blend, row: usize, column: usize) -> f64 {
        let at = |slice: usize| (slice * self.grid.rows + row) * self.grid.columns + column;
        blend.iter().map(|(slice, w)| w * self.conditional[at(*slice)]).sum()
    }

    fn up_to_row(&self, blend: &Blend, row: usize) -> f64 {
        blend.iter().map(|(slice, w)| w * self.marginal[slice * self.grid.rows + row]).sum()
    }

    /// From a point to the fractions s, with the density there.
    pub fn invert(&self, u: impl Into<DVec2>, blend: &Blend) -> (DVec2, f64) {
        let last = self.grid.columns - 1;
        let Place { row, column, x, y } = self.grid.place(u);
        let v = |r: usize, c: usize| self.value(blend, row + r, column + c);
        let left = (1.0 - y) * v(0, 0) + y * v(1, 0);
        let right = (1.0 - y) * v(0, 1) + y * v(1, 1);
        let density = (1.0 - x) * left + x * right;
        let before = |r: usize| self.along_row(blend, row + r, column);
        let whole = |r: usize| self.along_row(blend, row + r, last);
        let (r0, r1) = (whole(0), whole(1));
        let in_row = (1.0 - y) * r0 + y * r1;
        let part = x * (left + 0.5 * x * (right - left)) + (1.0 - y) * before(0) + y * before(1);
        let s = if in_row > 0.0 { (part / in_row).clamp(0.0, 1.0) } else { 0.0 };
        let below = self.up_to_row(blend, row) + y * (r0 + 0.5 * y * (r1 - r0));
        (DVec2::new(s, below.clamp(0.0, 1.0)), density * self.cells())
    }

    /// From the fractions s to the point, with the density there.
    pub fn sample(&self, s: impl Into<DVec2>, blend: &Blend) -> (DVec2, f64) {
        let s = s.into();
        let (rows, columns) = (self.grid.rows, self.grid.columns);
        let row = search(rows, |row| self.up_to_row(blend, row) <= s.y);
        let whole = |r: usize| self.along_row(blend, row + r, columns - 1);
        let y = solve(whole(0), whole(1), s.y - self.up_to_row(blend, row));
        let mixed = |column: usize| {
            (1.0 - y) * self.along_row(blend, row, column)
                + y * self.along_row(blend, row + 1, column)
        };
        let wanted = s.x * mixed(columns - 1);
        let column = search(columns, |column| mixed(column) <= wanted);
        let v = |r: usize, c: usize| self.value(blend, row + r, column + c);
        let left = (1.0 - y) * v(0, 0) + y * v(1, 0);
        let right = (1.0 - y) * v(0, 1) + y * v(1, 1);
        let x = solve(left, right, wanted - mixed(column));
        let u = [(column as f64 + x) / (columns - 1) as f64, (row as f64 + y) / (rows - 1) as f64];
        (u.into(), ((1.0 - x) * left + x * right) * self.cells())
    }

    fn cells(&self) -> f64 {
        ((self.grid.rows - 1) * (self.grid.columns - 1)) as f64
    }
}

/// The last node, but for the very last, up to which `holds`.
fn search(nodes: usize, holds: impl Fn(usize) -> bool) -> usize {
    let (mut from, mut to) = (0, nodes - 1);
    while to - from > 1 {
        let middle = usize::midpoint(from, to);
        if holds(middle) { from = middle } else { to = middle }
    }
    from
}

/// t with t (a + t (b − a)/2) = area.
fn solve(a: f64, b: f64, area: f64) -> f64 {
    let root = (a * a + 2.0 * area * (b - a)).max(0.0).sqrt();
    if a + root > 0.0 { (2.0 * area / (a + root)).clamp(0.0, 1.0) } else { 0.0 }
}
