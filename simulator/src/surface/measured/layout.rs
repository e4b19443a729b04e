//! Where a file's grid of values is fine and where it is coarse.
//!
//! Between its nodes a file is bilinear in warped coordinates, and linear between two incident elevations that are warped differently: it is good where the values
//! change little from node to node, and any density serves as a warp. The visible normals' own (Dupuy and Jakob 2018) has few nodes in a lobe's tails, at the
//! horizon, and where the horizon cuts through the azimuths: there files of 64 by 64 values were off by 3 to 50 %. Here, each by a share of the nodes:
//!
//! - the visible normals, and all normals alike, so that a lobe's tails have nodes;
//! - more towards the horizon of the mirrored directions, where masking bends what is seen, and none below it;
//! - where a lobe goes over into the diffuse light around it;
//! - between azimuths by how much of the light is there, evenly, and by how fast the horizon moves from one to the next.
//!
//! The shares were found with Lambert, Beckmann and GGX materials of 0.01 to 0.5 alone and over diffuse light, values in closed form on the nodes.

use crate::surface::tensor::warp::Grid;
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// The share of the grid that is spread over all normals.
const WIDE: f64 = 0.7;
/// Normals that mirror to a direction of the cosine z have 1 + 1/(z + this) times the nodes.
const HORIZON: f64 = 0.1;
/// Around the normal, to this tilt (radians), there are up to twice the nodes: at grazing incidence the values change fast there.
const POLE_RAD: f64 = 0.1;
/// The share of where a lobe goes over into diffuse light, of the fullest azimuth.
const TRANSITION: f64 = 0.4;
/// The transition is from this level of diffuse light to a hundredth of it.
const DEEP: f64 = 100.0;
/// The share of all azimuths alike.
const EVEN: f64 = 0.2;
/// The share of azimuths between which the horizon moves.
const MOVING: f64 = 0.6;
/// Nodes fall from all to none between these cosines: an edge within a cell of the warp's own grid.
const EDGE: (f64, f64) = (-0.015, 0.005);
/// The cosine of what stands for all directions at or below the horizon.
const LEAST_COSINE: f64 = 2e-3;

/// The density of a file's nodes over microfacet normals.
#[derive(Debug, Clone)]
pub struct Layout {
    /// D, normalised to ∫ D cosθ dω = 1.
    density: Grid,
    isotropic: bool,
    /// The tilt at which D has fallen to 1/e, radians; at most 0.5.
    width_rad: f64,
    /// By node, along each azimuth: where the lobe goes over into diffuse light, 1 or less in all.
    transition: Vec<f64>,
}

impl Layout {
    /// `density` is D on nodes (u = √(2θ/π) along the columns, (φ+π)/2π along the rows, both ends in it), at any scale; `floor` is what the file's D has
    /// beside it for diffuse light, on the same scale.
    #[must_use]
    pub fn new(mut density: Grid, isotropic: bool, floor: f64) -> Self {
        let (rows, columns) = (density.rows, density.columns);
        let tilt = |c: usize| (c as f64 / (columns - 1) as f64).powi(2) * FRAC_PI_2;
        let peak = f64::from(density.values.iter().copied().fold(0.0_f32, f32::max));
        let mut transition = vec![0.0; rows * columns];
        if floor > 1e-6 * peak {
            for row in 0..rows {
                let level = |c: usize| {
                    let d = f64::from(density.values[row * columns + c]);
                    ((d + floor) / (d + floor / DEEP)).ln()
                };
                let along: Vec<f64> = (0..columns)
                    .map(|c| {
                        let (before, after) = (c.saturating_sub(1), (c + 1).min(columns - 1));
                        ((level(after) - level(before)) / (after - before) as f64).abs()
                    })
                    .collect();
                // A lobe that does not fall so far has no transition worth the nodes.
                let all = along.iter().sum::<f64>().max(3.0);
                for (c, part) in along.iter().enumerate() {
                    transition[row * columns + c] = part / all;
                }
            }
        }
        let mut flux = 0.0;
        for row in 0..rows - 1 {
            for c in 0..columns {
                let (t, u) = (tilt(c), c as f64 / (columns - 1) as f64);
                let d = f64::from(density.values[row * columns + c]);
                flux += d * t.cos() * t.sin() * PI * u;
            }
        }
        flux *= TAU / ((rows - 1) * (columns - 1)) as f64;
        let falls = |row: usize| {
            let values = &density.values[row * columns..(row + 1) * columns];
            let most = f64::from(values.iter().copied().fold(0.0_f32, f32::max));
            let low = |v: &f32| f64::from(*v) < most / std::f64::consts::E;
            values.iter().position(low).map_or(0.5, |c| tilt(c).min(0.5))
        };
        let width_rad = (0..rows).map(falls).fold(0.5, f64::min);
        let scale = if flux > 0.0 { 1.0 / flux } else { 1.0 };
        density.values.iter_mut().for_each(|v| *v = (f64::from(*v) * scale) as f32);
        Self { density, isotropic, width_rad, transition }
    }

    /// Incident elevations from 0 to 89.9°, radians, twice as dense at the horizon as at the normal, as a file holds them.
    #[must_use]
    pub fn elevations(count: usize) -> Vec<f64> {
        let most = 89.9_f64.to_radians();
        let theta = |j: usize| {
            let t = j as f64 / (count - 1) as f64;
            f64::from((most * t * (1.5 - 0.5 * t)) as f32)
        };
        (0..count).map(theta).collect()
    }

    /// A unit direction, or the one nearest to it above the horizon: nodes below take its value, so that what lies above is not pulled down.
    #[must_use]
    pub fn above_horizon(o: DVec3) -> DVec3 {
        if o.z >= LEAST_COSINE {
            return o;
        }
        let across = DVec3::new(o.x, o.y, 0.0).normalize_or(DVec3::X);
        across * (1.0 - LEAST_COSINE * LEAST_COSINE).sqrt() + DVec3::Z * LEAST_COSINE
    }

    /// The normal of a point of the square, for light from the azimuth `phi_i`, radians.
    #[must_use]
    pub fn normal(&self, phi_i: f64, u: [f64; 2]) -> DVec3 {
        let phi = TAU * u[1] - PI + if self.isotropic { phi_i } else { 0.0 };
        let theta = u[0] * u[0] * FRAC_PI_2;
        DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
    }

    /// The density over the square for light from (θ, φ), radians, not normalised: rows by columns as the layout was made from. 0 everywhere where no
    /// normal mirrors the light to above the horizon.
    #[must_use]
    pub fn visible(&self, theta: f64, phi: f64) -> Vec<f32> {
        let (rows, columns) = (self.density.rows, self.density.columns);
        let i = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
        let mut values = vec![0.0; rows * columns];
        let mut above = vec![0.0; rows * columns];
        for node in 0..rows * columns {
            let u = [
                (node % columns) as f64 / (columns - 1) as f64,
                (node / columns) as f64 / (rows - 1) as f64,
            ];
            let (m, tilt) = (self.normal(phi, u), u[0] * u[0] * FRAC_PI_2);
            let cosine = i.dot(m).max(0.0);
            let z = 2.0 * i.dot(m) * m.z - i.z;
            let cut = ((z - EDGE.0) / (EDGE.1 - EDGE.0)).clamp(0.0, 1.0);
            let all = 0.5 * (1.0 + 1.0 / (z.max(0.0) + HORIZON)) / PI;
            let density = (1.0 - WIDE) * f64::from(self.density.values[node]) + WIDE * all;
            // Not the visible normals' solid angle, which is 0 at the normal: what lies around the mirrored direction would be in one cell.
            let place = (tilt.sin() + self.width_rad) * u[0] * (1.0 + (-tilt / POLE_RAD).exp());
            values[node] = density * cut * cosine * place;
            above[node] = if cosine > 0.0 { cut } else { 0.0 };
        }
        let sum = |row: &[f64]| row.iter().sum::<f64>();
        let fullest = values.chunks(columns).map(sum).fold(0.0, f64::max);
        for ((value, above), transition) in values.iter_mut().zip(&above).zip(&self.transition) {
            *value += TRANSITION * fullest * above * transition;
        }
        self.share(&mut values);
        values.into_iter().map(|v| v as f32).collect()
    }

    /// Shares the nodes among the azimuths.
    fn share(&self, values: &mut [f64]) {
        let columns = self.density.columns;
        // The last row is the first one.
        let n = self.density.rows - 1;
        let sums: Vec<f64> = values.chunks(columns).map(|row| row.iter().sum()).collect();
        let whole: f64 = sums[..n].iter().sum();
        let mean = whole / n as f64;
        if mean <= 0.0 {
            return;
        }
        let ln = |k: usize| sums[k % n].max(1e-3 * mean).ln();
        let mut moves: Vec<f64> = (0..n).map(|k| 0.5 * (ln(k + 1) - ln(k + n - 1)).abs()).collect();
        for _ in 0..3 {
            let at = |k: usize| moves[k % n];
            moves = (0..n).map(|k| 0.25 * (at(k + n - 1) + 2.0 * at(k) + at(k + 1))).collect();
        }
        let all: f64 = moves.iter().sum();
        // Where the horizon is the same all around it has no share: the shares change slowly with the incidence, as they are interpolated.
        let moving = MOVING * all / (all + 0.3);
        for (k, row) in values.chunks_mut(columns).enumerate() {
            let k = k % n;
            let part = (1.0 - EVEN - moving) * sums[k] / whole
                + EVEN / n as f64
                + moving * moves[k] / all.max(1e-9);
            let factor = part * n as f64 * mean / sums[k].max(1e-4 * mean);
            row.iter_mut().for_each(|v| *v *= factor);
        }
    }
}
