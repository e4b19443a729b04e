//! Error of interpolation in a table, from leaving measured values out.

use super::{SAME_DEG, Table};
use glam::DVec3;

/// Part of the errors that a doubt holds.
const HELD: f64 = 0.95;
/// Light or detector farther than this from the normal graze (cosine of 75°).
const GRAZING_COS: f64 = 0.258_819;
/// Errors that a region needs for numbers of its own.
const LEAST: usize = 12;
/// Rows of an incidence that are left out and predicted, at most.
const MOST: usize = 400;
/// ln f of a table with one incidence may be off by this at another one: nobody knows.
const UNKNOWN: f64 = 2.0;

/// How errors grow, by region: about the mirrored direction, elsewhere, at grazing angles.
#[derive(Debug, Clone, Default)]
pub(super) struct Doubts {
    /// ln f per √rad from the nearest measured incidence.
    per_root: [f64; 3],
    /// At a measured row: what reciprocity asks of it.
    met: [f64; 3],
    /// By row: how much it differs from what its neighbours say.
    bend: Vec<f64>,
    /// Whether incidences could be left out.
    measured: bool,
}

impl Doubts {
    /// Measures the errors of a table.
    pub fn of(table: &Table) -> Self {
        let n = table.theta.len();
        let mut made = Self { bend: made_bends(table), measured: n >= 2, ..Self::default() };
        // The first and the last are left out only where there is no other: they are extrapolated then.
        let left_out = if n >= 3 { 1..n - 1 } else { 0..if n == 2 { 2 } else { 0 } };
        let (mut all, mut errors) = (Vec::new(), [const { Vec::new() }; 3]);
        let mut met = [const { Vec::new() }; 3];
        let of_incidence = |j: usize| {
            let same = move |k: &usize| {
                (table.directions[*k].0.z - table.theta[j].cos()).abs()
                    < SAME_DEG.to_radians().max(1e-9)
            };
            let rows: Vec<usize> = (0..table.directions.len()).filter(same).collect();
            let step = rows.len().div_ceil(MOST).max(1);
            rows.into_iter().step_by(step)
        };
        for j in 0..n {
            for row in of_incidence(j) {
                let (i, o) = table.directions[row];
                if table.log[row * table.wavelengths] == f64::NEG_INFINITY {
                    continue;
                }
                let region = region(table, i, o);
                let error = |without| {
                    let around = table.around(i, o, without);
                    let off = |k: usize| {
                        let truth = table.log[row * table.wavelengths + k];
                        let off = (table.ln_at(&around.stencil, k) - truth).abs();
                        if off.is_finite() { off } else { 0.0 }
                    };
                    let worst = (0..table.wavelengths).map(off).fold(0.0, f64::max);
                    (worst, around.distance)
                };
                met[region].push(error(None).0);
                if left_out.contains(&j) {
                    let (off, distance) = error(Some(j));
                    let rate = off / distance.max(1e-3).sqrt();
                    errors[region].push(rate);
                    all.push(rate);
                }
            }
        }
        let everywhere = quantile(&mut all);
        for (region, (errors, met)) in errors.iter_mut().zip(&mut met).enumerate() {
            let enough = errors.len() >= LEAST;
            made.per_root[region] = if enough { quantile(errors) } else { everywhere };
            made.met[region] = quantile(met);
        }
        made
    }

    /// Half-width of the 95 % interval of ln f.
    pub fn at(&self, table: &Table, i: DVec3, o: DVec3) -> f64 {
        let around = table.around(i, o, None);
        let region = region(table, i, o);
        let between = if self.measured {
            self.per_root[region] * around.distance.sqrt()
        } else if around.distance < SAME_DEG.to_radians() {
            0.0
        } else {
            UNKNOWN
        };
        let bend = |(row, w): &(usize, f64)| w * self.bend.get(*row).copied().unwrap_or(0.0);
        let bends: f64 = around.stencil.parts().iter().map(bend).sum();
        let plane = if table.flat { out_of_plane(table, i, o) } else { 0.0 };
        between.hypot(self.met[region]).hypot(bends).hypot(plane)
    }
}

/// Two thirds of a lobe's logarithm change with the azimuth at the same tilt and difference as 1/(cosθ_i cosθ_o) does, or not at all: microfacets do, the ABg model and diffuse light do not.
fn out_of_plane(table: &Table, i: DVec3, o: DVec3) -> f64 {
    table
        .in_plane(i, o)
        .map_or(0.0, |(a, b, _)| ((a.z * b.z).max(1e-4) / (i.z * o.z).max(1e-4)).ln().abs())
}

fn region(table: &Table, i: DVec3, o: DVec3) -> usize {
    let h = i + o;
    let tilt = h.x.hypot(h.y).atan2(h.z);
    if tilt < table.width_rad.min(0.2) {
        0
    } else if i.z.min(o.z) < GRAZING_COS {
        2
    } else {
        1
    }
}

/// By row how far it is from the line between its neighbours, a quarter of that: of a smooth curve that is the error between two of them.
fn made_bends(table: &Table) -> Vec<f64> {
    let mut bend = vec![0.0_f64; table.log.len() / table.wavelengths];
    for slice in &table.slices {
        slice.beside(|row, before, after, part| {
            for k in 0..table.wavelengths {
                let ln = |row: usize| table.log[row * table.wavelengths + k];
                let off = (ln(row) - (1.0 - part) * ln(before) - part * ln(after)).abs();
                if off.is_finite() {
                    bend[row] = bend[row].max(0.25 * off);
                }
            }
        });
    }
    bend
}

fn quantile(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    values.sort_by(f64::total_cmp);
    values[(((values.len() - 1) as f64) * HELD).ceil() as usize]
}
