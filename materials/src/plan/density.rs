//! D, σ and the density of visible normals on the squares that the file holds them on.

use crate::ndf::Ndf;
use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use sunglint_simulator::surface::{Grid, Warp};

/// D and σ on nodes of the unit square, 0 and 1 among them: columns are u = √(2θ/π), rows (φ+π)/2π.
#[derive(Debug, Clone)]
pub struct Densities {
    /// D, sr⁻¹.
    pub ndf: Grid,
    /// σ.
    pub sigma: Grid,
    isotropic: bool,
}

impl Densities {
    /// On `nodes` by `nodes`.
    pub fn of(ndf: &Ndf, nodes: usize) -> Self {
        let spread = |values: &[f64]| {
            let at = |k: usize| k as f64 / (nodes - 1) as f64;
            let value = |row: usize, column: usize| {
                let theta = at(column).powi(2) * FRAC_PI_2;
                interpolated(ndf, values, theta, TAU * at(row) - PI) as f32
            };
            let row = |row: usize| (0..nodes).map(move |column| value(row, column));
            let values = if ndf.is_isotropic() {
                row(0).collect::<Vec<f32>>().repeat(nodes)
            } else {
                (0..nodes).flat_map(row).collect()
            };
            Grid { rows: nodes, columns: nodes, values }
        };
        let isotropic = ndf.is_isotropic();
        Self { ndf: spread(&ndf.density), sigma: spread(&ndf.projected_area), isotropic }
    }

    /// σ at u, mean over the azimuth.
    pub(super) fn mean_area(&self, u: f64) -> f64 {
        // The last row is the first.
        let rows = self.sigma.rows - 1;
        let at = |row: usize| self.sigma.at([u, row as f64 / rows as f64]);
        (0..rows).map(at).sum::<f64>() / rows as f64
    }

    /// The normal of a point of the square, for light from the azimuth `phi_i`.
    pub fn normal(&self, phi_i: f64, u: impl Into<DVec2>) -> DVec3 {
        let u = u.into();
        let phi = TAU * u[1] - PI + if self.isotropic { phi_i } else { 0.0 };
        direction(u[0] * u[0] * FRAC_PI_2, phi)
    }

    /// The values of the density of visible normals over the square, for light from (θ, φ), not normalised: (D + a share `wide` for all normals alike)
    /// max(0, i·m) sinθ_m u.
    pub fn visible_values(&self, theta: f64, phi: f64, wide: f64) -> Vec<f32> {
        let i = direction(theta, phi);
        // ∫ cosθ dω is π: beside ∫ D cosθ dω = 1.
        let (narrow, wide) = (1.0 - wide, wide / PI);
        let last = (self.ndf.columns - 1) as f64;
        let value = |node: usize| {
            let (row, column) = (node / self.ndf.columns, node % self.ndf.columns);
            let u = [column as f64 / last, row as f64 / (self.ndf.rows - 1) as f64];
            let m = self.normal(phi, u);
            let sine = (m.x * m.x + m.y * m.y).sqrt();
            let density = narrow * f64::from(self.ndf.values[node]) + wide;
            (density * i.dot(m).max(0.0) * sine * u[0]) as f32
        };
        (0..self.ndf.values.len()).map(value).collect()
    }

    /// The warp of that density; `None` where it is 0 everywhere.
    pub fn visible(&self, theta: f64, phi: f64, wide: f64) -> Option<Warp> {
        let values = self.visible_values(theta, phi, wide);
        Warp::new(Grid { rows: self.ndf.rows, columns: self.ndf.columns, values })
    }
}

/// A value between an NDF's nodes: its logarithm is linear in u and in the azimuth; held beyond the first and last elevation.
fn interpolated(ndf: &Ndf, values: &[f64], theta: f64, phi: f64) -> f64 {
    let n = ndf.theta_rad.len();
    let place = |t: f64| t.sqrt();
    let j = ndf.theta_rad.partition_point(|t| *t <= theta).clamp(1, n - 1) - 1;
    let (from, to) = (place(ndf.theta_rad[j]), place(ndf.theta_rad[j + 1]));
    let b = ((place(theta) - from) / (to - from)).clamp(0.0, 1.0);
    // Half a turn further it is the same.
    let np = ndf.phi_rad.len();
    let turn = phi.rem_euclid(PI) / PI * np as f64;
    let (k, c) = ((turn as usize) % np, turn.fract());
    let ln = |k: usize, j: usize| values[(k % np) * n + j].max(f64::MIN_POSITIVE).ln();
    let along = |k: usize| (1.0 - b) * ln(k, j) + b * ln(k, j + 1);
    ((1.0 - c) * along(k) + c * along(k + 1)).exp()
}

/// The direction of an elevation and an azimuth.
pub(super) fn direction(theta: f64, phi: f64) -> DVec3 {
    DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
}
