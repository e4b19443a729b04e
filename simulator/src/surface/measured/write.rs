//! Writing a material as a `.bsdf` file.
//!
//! The density of microfacet normals is found from what the material throws back into the direction that the light came from, as Dupuy and Jakob find it from
//! measurements: f_r(ω, ω) cosθ = D(ω)/(4 σ(ω)), σ(ω) = ∫ D (ω·m)₊ dω_m, by power iteration. Any D that is nowhere 0 would do: the values in
//! warped coordinates make up for it; a good one makes them smooth. A floor under D gives directions that throw nothing back a part of the grid too.

use super::Layout;
use crate::surface::tensor::elevation;
use crate::surface::tensor::warp::{Blend, Grid, Warp};
use crate::surface::{Material, MaterialError, parametric::parameter};
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use sunglint_formats::bsdf::{Tensor, TensorData, TensorFile};

/// D is at least this part of its mean over the hemisphere.
const FLOOR: f64 = 1e-9;
const ITERATIONS: usize = 24;

/// How finely a material is written.
#[derive(Debug, Clone, PartialEq)]
pub struct WriteOptions {
    /// Wavelengths, vacuum nm, increasing.
    pub wavelength_nm: Vec<f64>,
    /// Number of incident elevations, 0 to 89.9°, closer together towards the horizon.
    pub elevations: usize,
    /// Number of incident azimuths over a quarter of the circle, of a material with a tangent; it must be symmetric about it.
    pub azimuths: usize,
    /// Nodes of the densities in elevation (and in azimuth).
    pub normals: usize,
    /// Side of the grid of values.
    pub side: usize,
}

impl WriteOptions {
    /// 24 elevations, 9 azimuths, 128 normals, values on 64 by 64: 0.4 MB a wavelength of an isotropic material, at the given wavelengths.
    pub fn at(wavelength_nm: Vec<f64>) -> Self {
        Self { wavelength_nm, elevations: 24, azimuths: 9, normals: 128, side: 64 }
    }
}

/// The file of a material.
///
/// # Errors
/// A mirror, wavelengths that do not increase, a grid of less than 4 nodes.
pub fn write(material: &Material, options: &WriteOptions) -> Result<TensorFile, MaterialError> {
    if material.is_mirror() {
        let expected = "a material with a density of directions".to_owned();
        let (what, found) = (material.name.clone(), "a perfect mirror".to_owned());
        return Err(MaterialError::Data { what, found, expected });
    }
    let nm = &options.wavelength_nm;
    let rising = !nm.is_empty() && nm[0] > 0.0 && nm.windows(2).all(|pair| pair[0] < pair[1]);
    if !rising {
        let first = nm.first().copied().unwrap_or(f64::NAN);
        return Err(parameter("the first wavelength (nm)", first, "above 0, and all increasing"));
    }
    let least = options.elevations.min(options.normals).min(options.side);
    if least < 4 || options.azimuths < 3 {
        return Err(parameter("the number of nodes", least as f64, "of at least 4 (azimuths 3)"));
    }
    Ok(Writer::new(material, options).file())
}

struct Writer<'a> {
    material: &'a Material,
    options: &'a WriteOptions,
    theta_i: Vec<f64>,
    phi_i: Vec<f64>,
    isotropic: bool,
    /// Rows and columns of the densities.
    rows: usize,
    columns: usize,
    ndf: Vec<f64>,
    sigma: Vec<f64>,
}

impl<'a> Writer<'a> {
    fn new(material: &'a Material, options: &'a WriteOptions) -> Self {
        let isotropic = material.is_isotropic();
        let theta_i = Layout::elevations(options.elevations);
        let quarter = |k: usize| -PI + FRAC_PI_2 * k as f64 / (options.azimuths - 1) as f64;
        let phi_i =
            if isotropic { vec![0.0] } else { (0..options.azimuths).map(quarter).collect() };
        let columns = options.normals;
        let rows = options.normals;
        let (ndf, sigma) = density(material, options, isotropic, rows, columns);
        Self { material, options, theta_i, phi_i, isotropic, rows, columns, ndf, sigma }
    }

    fn file(&self) -> TensorFile {
        let (rows, columns, side) = (self.rows, self.columns, self.options.side);
        let (nt, np, nl) = (self.theta_i.len(), self.phi_i.len(), self.options.wavelength_nm.len());
        let f32s = |values: &[f64]| values.iter().map(|v| *v as f32).collect::<Vec<f32>>();
        let (mut vndf, mut luminance) = (Vec::new(), Vec::new());
        let mut spectra = vec![0.0_f32; np * nt * nl * side * side];
        let ndf = Grid { rows, columns, values: f32s(&self.ndf) };
        let layout = Layout::new(ndf.clone(), 0.0, &self.theta_i, &self.phi_i);
        let sigma = Grid { rows, columns, values: f32s(&self.sigma) };
        for (k, phi) in self.phi_i.iter().enumerate() {
            for (j, theta) in self.theta_i.iter().enumerate() {
                let slice = layout.visible(j, k);
                let values = self.values((*theta, *phi), &layout, &slice, &ndf, &sigma);
                for (node, row) in values.iter().enumerate() {
                    luminance.push((row.iter().sum::<f64>() / nl as f64 + 1e-9) as f32);
                    for (l, value) in row.iter().enumerate() {
                        let at = ((k * nt + j) * nl + l) * side * side + node;
                        spectra[at] = *value as f32;
                    }
                }
                vndf.extend(slice);
            }
        }
        let text = format!("{}, written by sunglint", self.material.describe());
        let tensors = vec![
            Tensor::u8("description", text.into_bytes()),
            Tensor::f32("theta_i", &[nt], f32s(&self.theta_i)),
            Tensor::f32("phi_i", &[np], f32s(&self.phi_i)),
            Tensor::f32("wavelengths", &[nl], f32s(&self.options.wavelength_nm)),
            Tensor::f32("ndf", &[rows, columns], ndf.values),
            Tensor::f32("sigma", &[rows, columns], sigma.values),
            Tensor::f32("vndf", &[np, nt, rows, columns], vndf),
            Tensor::f32("luminance", &[np, nt, side, side], luminance),
            Tensor::f32("spectra", &[np, nt, nl, side, side], spectra),
            Tensor { name: "jacobian".to_owned(), shape: vec![1], data: TensorData::U8(vec![1]) },
        ];
        TensorFile { tensors }
    }

    /// f cosθ_o 4σ/D on the grid in s, for each wavelength.
    fn values(
        &self,
        (theta, phi): (f64, f64),
        layout: &Layout,
        slice: &[f32],
        ndf: &Grid,
        sigma: &Grid,
    ) -> Vec<Vec<f64>> {
        let side = self.options.side;
        let none = vec![vec![0.0; self.options.wavelength_nm.len()]; side * side];
        let grid = Grid { rows: self.rows, columns: self.columns, values: slice.to_vec() };
        let Some(warp) = Warp::new(grid) else { return none };
        let blend: Blend = [(0, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)];
        let i = spherical(theta, phi);
        let area = sigma.at([(theta * 2.0 / PI).sqrt(), (phi + PI) / TAU]);
        let mut weights = vec![0.0; self.material.spectra().len()];
        let mut value = |node: usize| {
            let last = (side - 1) as f64;
            let s = [(node % side) as f64 / last, (node / side) as f64 / last];
            let (u, _) = warp.sample(s, &blend);
            let m = layout.normal(phi, u);
            let o = Layout::above_horizon((2.0 * i.dot(m) * m - i).normalize());
            weights.fill(0.0);
            let h = (i + o).normalize();
            let turn = (h.y.atan2(h.x) - if self.isotropic { phi } else { 0.0 } + PI) / TAU;
            let u = [(elevation(h) / FRAC_PI_2).sqrt(), turn - turn.floor()];
            let scale = o.z * 4.0 * area / ndf.at(u);
            self.material.add_weights(i, o, scale, &mut weights);
            let at = |nm: &f64| self.material.times_spectra(*nm, &weights).max(0.0);
            self.options.wavelength_nm.iter().map(at).collect()
        };
        (0..side * side).map(&mut value).collect()
    }
}

fn spherical(theta: f64, phi: f64) -> DVec3 {
    DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
}

/// D and σ on the nodes of the square u, by power iteration.
fn density(
    material: &Material,
    options: &WriteOptions,
    isotropic: bool,
    rows: usize,
    columns: usize,
) -> (Vec<f64>, Vec<f64>) {
    // Of an isotropic material one azimuth stands for all; of another every fourth row and column, between which D is linear.
    let (across, up) = if isotropic { (1, columns) } else { (rows / 4 + 1, columns / 2) };
    let theta = |c: usize| {
        let u = c as f64 / (up - 1) as f64;
        u * u * FRAC_PI_2
    };
    let phi = |r: usize| TAU * r as f64 / across.max(2) as f64 - PI;
    let mut back = vec![0.0; across * up];
    let mut weights = vec![0.0; material.spectra().len()];
    for (node, value) in back.iter_mut().enumerate() {
        // At the horizon itself nothing is defined: its limit.
        let v = spherical(theta(node % up).min(1.569), phi(node / up));
        weights.fill(0.0);
        material.add_weights(v, v, 4.0 * v.z, &mut weights);
        let sum = |nm: &f64| material.times_spectra(*nm, &weights);
        *value = options.wavelength_nm.iter().map(sum).sum::<f64>().max(0.0);
    }
    let area = kernel(isotropic, across, up, &theta);
    let mut found = vec![1.0; across * up];
    let mut sigma = vec![1.0; across * up];
    for _ in 0..ITERATIONS {
        sigma = area(&found);
        let next: Vec<f64> = back.iter().zip(&sigma).map(|(b, s)| b * s).collect();
        let mean = next.iter().sum::<f64>() / next.len() as f64;
        let mean = if mean > 0.0 { mean } else { 1.0 };
        found = next.iter().map(|d| d / mean + FLOOR).collect();
    }
    let _ = sigma;
    let sigma = area(&found);
    // Onto all nodes: the same in every row of an isotropic material.
    let spread = |values: &[f64]| {
        let mut wide = Vec::with_capacity(rows * columns);
        for row in 0..rows {
            for column in 0..columns {
                let x = column as f64 / (columns - 1) as f64 * (up - 1) as f64;
                let c = (x as usize).min(up - 2);
                let t = x - c as f64;
                let along = |r: usize| values[r * up + c] * (1.0 - t) + values[r * up + c + 1] * t;
                let y = row as f64 / (rows - 1) as f64 * across as f64;
                let (r, s) = (y as usize, y.fract());
                let value = along(r % across) * (1.0 - s) + along((r + 1) % across) * s;
                wide.push(value);
            }
        }
        wide
    };
    (spread(&found), spread(&sigma))
}

/// D ↦ σ(ω) = ∫ D(m) (ω·m)₊ dω_m on the same nodes.
fn kernel(
    isotropic: bool,
    across: usize,
    up: usize,
    theta: &impl Fn(usize) -> f64,
) -> impl Fn(&[f64]) -> Vec<f64> {
    const AROUND: usize = 256;
    let turns = if isotropic { AROUND } else { across };
    // The solid angle of a ring's part, by the edges halfway between the nodes.
    let ring = |c: usize| {
        let edge = |x: f64| (x.clamp(0.0, (up - 1) as f64) / (up - 1) as f64).powi(2) * FRAC_PI_2;
        let (from, to) = (edge(c as f64 - 0.5), edge(c as f64 + 0.5));
        (from.cos() - to.cos()) * TAU / turns as f64
    };
    let angles: Vec<(f64, f64, f64)> =
        (0..up).map(|c| (theta(c).sin(), theta(c).cos(), ring(c))).collect();
    let turned: Vec<f64> = (0..turns).map(|k| (TAU * k as f64 / turns as f64).cos()).collect();
    // By elevation, elevation and difference of azimuths.
    let difference = move |a: usize, b: usize, k: usize| {
        let ((sin_a, cos_a, _), (sin_b, cos_b, ring)) = (angles[a], angles[b]);
        ring * (sin_a * sin_b * turned[k] + cos_a * cos_b).max(0.0)
    };
    let mut table = vec![0.0; up * up * if isotropic { 1 } else { across }];
    for a in 0..up {
        for b in 0..up {
            if isotropic {
                table[a * up + b] = (0..turns).map(|k| difference(a, b, k)).sum();
            } else {
                for k in 0..across {
                    table[(k * up + a) * up + b] = difference(a, b, k);
                }
            }
        }
    }
    move |values: &[f64]| {
        let mut sigma = vec![0.0; across * up];
        for (to, sigma) in sigma.chunks_mut(up).enumerate() {
            for from in 0..across {
                let k = (to + across - from) % across;
                let table = &table[k * up * up..(k + 1) * up * up];
                for (a, sigma) in sigma.iter_mut().enumerate() {
                    let row = &table[a * up..(a + 1) * up];
                    let values = &values[from * up..(from + 1) * up];
                    *sigma += row.iter().zip(values).map(|(w, d)| w * d).sum::<f64>();
                }
            }
        }
        sigma
    }
}
