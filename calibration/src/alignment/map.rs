//! The field as it was measured, cell by cell.

use super::{FieldFit, FieldPoint};
use glam::DVec2;
use std::collections::BTreeMap;

/// A cell of the map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// Middle of the cell from the frame's centre, px.
    pub offset_px: DVec2,
    /// Mean of the normalised rates in it, weighted by their uncertainties.
    pub value: f64,
    /// Standard uncertainty of the mean: the stated one, or the points' scatter where that is larger.
    pub sigma: f64,
    /// The mean less what the fit says of the same points.
    pub residual: f64,
    /// Points in it.
    pub points: usize,
}

/// The field in square cells; only those that hold points.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldMap {
    /// Side of a cell, px.
    pub cell_px: f64,
    /// The cells, row by row.
    pub cells: Vec<Cell>,
}

/// Sums over a cell's points.
#[derive(Default)]
struct Sum {
    weight: f64,
    value: f64,
    square: f64,
    residual: f64,
    points: usize,
}

impl FieldMap {
    /// The map of points, each less the background and over its star's amplitude of a fit. Points whose star has no positive amplitude there are left out,
    /// and so is all where `cell_px` is no length above 0.
    pub fn new(points: &[FieldPoint], fit: &FieldFit, cell_px: f64) -> Self {
        let mut sums: BTreeMap<[i64; 2], Sum> = BTreeMap::new();
        let amplitudes: BTreeMap<usize, f64> =
            fit.amplitudes_hz.iter().map(|(star, amplitude)| (*star, amplitude.value)).collect();
        for point in points {
            let Some(&amplitude) = amplitudes.get(&point.star).filter(|a| **a > 0.0) else {
                continue;
            };
            if !(cell_px.is_finite() && cell_px > 0.0) {
                continue;
            }
            let value = (point.rate_hz - fit.background_hz.value) / amplitude;
            let weight = (amplitude / point.sigma_hz).powi(2);
            let [column, row] = point.offset_px.to_array().map(|x| (x / cell_px).floor() as i64);
            let sum = sums.entry([row, column]).or_default();
            sum.weight += weight;
            sum.value += weight * value;
            sum.square += weight * value * value;
            sum.residual += weight * (value - fit.profile(point));
            sum.points += 1;
        }
        let cells = sums.into_iter().map(|([row, column], sum)| {
            let value = sum.value / sum.weight;
            let chi2 = (sum.square - sum.weight * value * value).max(0.0);
            let reduced = chi2 / (sum.points.max(2) - 1) as f64;
            Cell {
                offset_px: [column, row].map(|i| (i as f64 + 0.5) * cell_px).into(),
                value,
                sigma: (reduced.max(1.0) / sum.weight).sqrt(),
                residual: sum.residual / sum.weight,
                points: sum.points,
            }
        });
        Self { cell_px, cells: cells.collect() }
    }

    /// The measured field at a place: that of its cell; `None` where nothing was measured.
    pub fn at(&self, offset_px: DVec2) -> Option<&Cell> {
        let half = 0.5 * self.cell_px;
        let near = |cell: &&Cell| {
            (0..2).all(|i| {
                let from = cell.offset_px[i] - half;
                (from..from + self.cell_px).contains(&offset_px[i])
            })
        };
        self.cells.iter().find(near)
    }

    /// The cell whose residual is most σ above the fit: a ghost's place, if any is.
    pub fn strongest_residual(&self) -> Option<&Cell> {
        let sigmas = |cell: &Cell| cell.residual / cell.sigma;
        self.cells.iter().max_by(|a, b| sigmas(a).total_cmp(&sigmas(b)))
    }
}
