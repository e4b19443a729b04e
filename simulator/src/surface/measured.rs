//! Materials measured over all directions and wavelengths: `.bsdf` files of Dupuy and Jakob's database, read and written.
//!
//! The material has one weight for each wavelength of the file, before a spectrum that is 1 there and falls to 0 at the neighbours: linear between
//! wavelengths, as the files are meant. Beyond the first and last wavelength the values are held and said to be; elevations beyond the file's are said by a
//! weight of their own. The values are taken as they are: they need not be reciprocal, nor conserve energy; [`Material::notes`] says so.

mod layout;
mod write;

pub use layout::Layout;
pub use write::{WriteOptions, write};

use super::sampling::{Mixture, Proposal};
use super::scatter::Scatter as _;
use super::tensor::Tensor;
use super::tensor::warp::{Grid, Warp};
use super::{Material, MaterialError, uncovered};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::path::Path;
use std::sync::Arc;
use sunglint_formats::bsdf::TensorFile;
use sunglint_formats::{FileError, ParseError};
use sunglint_radiometry::spectrum::{Reflectance, Spectrum};

/// Reads a `.bsdf` file.
///
/// # Errors
/// A [`ParseError`] with the field: no such file, an RGB file, a field that is missing or of a wrong shape, values that are no number or negative.
pub fn read(name: impl Into<String>, path: impl AsRef<Path>) -> Result<Material, FileError> {
    let file = TensorFile::read(&path)?;
    Ok(material(name, path, &file)?)
}

/// The material of a file that is in memory; `path` names it in errors.
///
/// # Errors
/// The errors of [`read`].
pub fn material(
    name: impl Into<String>,
    path: impl AsRef<Path>,
    file: &TensorFile,
) -> Result<Material, ParseError> {
    material_at(name.into(), path.as_ref(), file)
}

fn material_at(name: String, path: &Path, file: &TensorFile) -> Result<Material, ParseError> {
    if file.get("rgb").is_some() && file.get("wavelengths").is_none() {
        let error = ParseError::new(path, "an RGB file", "a file with `wavelengths` and `spectra`");
        let hint =
            "the database has each material as `_spec.bsdf` too: three colours are no spectrum";
        return Err(error.in_field("rgb").with_hint(hint));
    }
    file.check_material(path)?;
    let (tensor, wavelengths) = Fields { path, file }.tensor()?;
    let tensor = Arc::new(tensor);
    let wrong = |e: MaterialError| ParseError::new(path, e.to_string(), "a measured material");
    let mut spectra = hats(&wavelengths).map_err(wrong)?;
    if tensor.has_gaps() {
        spectra.push(uncovered().map_err(|e| wrong(e.into()))?);
    }
    let ways = vec![(0.8, Proposal::Tensor(tensor.clone())), (0.2, Proposal::Cosine)];
    let law = Arc::new(tensor.clone());
    let made = Material::of_law(name, spectra, law, Mixture::new(ways), true);
    let mut made = made.map_err(wrong)?;
    if tensor.has_gaps() {
        let (first, last) = (tensor.theta_i[0], tensor.theta_i[tensor.theta_i.len() - 1]);
        made.notes.push(format!(
            "it was measured at elevations from {:.1}° to {:.1}°; beyond, the values are held and flagged",
            first.to_degrees(),
            last.to_degrees()
        ));
    }
    Ok(made)
}

/// Directions below this height have no values in a file that one could divide by it.
const LEAST_HEIGHT: f64 = 5e-3;

/// The wavelengths of a file \[nm\], and its values at the directions of its own nodes, where light and outgoing direction are above the horizon. `path` names the file in errors.
///
/// # Errors
/// The errors of [`material`].
pub fn nodes(
    path: impl AsRef<Path>,
    file: &TensorFile,
) -> Result<(Vec<f64>, Vec<super::brdf_table::Row>), ParseError> {
    nodes_at(path.as_ref(), file)
}

fn nodes_at(
    path: &Path,
    file: &TensorFile,
) -> Result<(Vec<f64>, Vec<super::brdf_table::Row>), ParseError> {
    // Of all that a material is refused for.
    material("nodes", path, file)?;
    let (tensor, wavelengths) = Fields { path, file }.tensor()?;
    let mut rows = Vec::new();
    for (i, o, brdf_per_sr) in tensor.nodes() {
        if i.z < LEAST_HEIGHT || o.z < LEAST_HEIGHT {
            continue;
        }
        let angles = |d: glam::DVec3| {
            (super::tensor::elevation(d).to_degrees(), d.y.atan2(d.x).to_degrees())
        };
        let ((theta_i_deg, phi_i_deg), (theta_o_deg, phi_o_deg)) = (angles(i), angles(o));
        rows.push(super::brdf_table::Row {
            theta_i_deg,
            phi_i_deg,
            theta_o_deg,
            phi_o_deg,
            brdf_per_sr,
        });
    }
    Ok((wavelengths, rows))
}

/// Spectra that are 1 at one wavelength and 0 at all others.
pub(super) fn hats(nm: &[f64]) -> Result<Vec<Spectrum<Reflectance>>, MaterialError> {
    let last = nm.len() - 1;
    let hat = |k: usize| {
        let mut nodes = vec![0, k.saturating_sub(1), k, (k + 1).min(last), last];
        nodes.dedup();
        let value = nodes.iter().map(|j| f64::from(u8::from(*j == k))).collect();
        Ok(Spectrum::new(nodes.iter().map(|j| nm[*j]).collect(), value)?)
    };
    if last == 0 {
        // At one wavelength: known there, and held elsewhere.
        return Ok(vec![Spectrum::new(vec![nm[0] - 0.5, nm[0] + 0.5], vec![1.0, 1.0])?]);
    }
    (0..nm.len()).map(hat).collect()
}

struct Fields<'a> {
    path: &'a Path,
    file: &'a TensorFile,
}

impl Fields<'_> {
    fn bad(
        &self,
        field: &str,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> ParseError {
        ParseError::new(self.path, found, expected).in_field(field)
    }

    /// A field's shape and values: numbers, none negative unless `signed`.
    fn get(&self, field: &str, signed: bool) -> Result<(&[usize], &[f32]), ParseError> {
        let tensor = self.file.get(field);
        let Some((tensor, values)) = tensor.and_then(|t| Some((t, t.as_f32()?))) else {
            return Err(self.bad(field, "no such field", "a measured material"));
        };
        let wrong = |v: &f32| !v.is_finite() || (!signed && *v < 0.0);
        if let Some(at) = values.iter().position(wrong) {
            let found = format!("{} at place {at}", values[at]);
            let expected = if signed { "finite numbers" } else { "numbers of 0 or above" };
            return Err(self.bad(field, found, expected));
        }
        Ok((&tensor.shape, values))
    }

    fn shape(&self, field: &str, found: &[usize], expected: &[usize]) -> Result<(), ParseError> {
        if found == expected {
            return Ok(());
        }
        Err(self.bad(field, format!("the shape {found:?}"), format!("the shape {expected:?}")))
    }

    fn increasing(&self, field: &str, signed: bool) -> Result<Vec<f64>, ParseError> {
        let (_, values) = self.get(field, signed)?;
        if values.is_empty() {
            return Err(self.bad(field, "no value", "one or more"));
        }
        if let Some(k) = values.windows(2).position(|pair| pair[0] >= pair[1]) {
            let found = format!("{} after {} at place {}", values[k + 1], values[k], k + 1);
            return Err(self.bad(field, found, "values that increase"));
        }
        Ok(values.iter().map(|v| f64::from(*v)).collect())
    }

    fn grid(&self, field: &str) -> Result<Grid, ParseError> {
        let (shape, values) = self.get(field, false)?;
        let (rows, columns) = (shape[shape.len() - 2], shape[shape.len() - 1]);
        if rows < 2 || columns < 2 {
            return Err(self.bad(field, format!("the shape {shape:?}"), "at least 2 by 2 nodes"));
        }
        Ok(Grid { rows, columns, values: values.to_vec() })
    }

    fn warp(&self, field: &str, np: usize, nt: usize) -> Result<Warp, ParseError> {
        let grid = self.grid(field)?;
        let (shape, _) = self.get(field, false)?;
        self.shape(field, shape, &[np, nt, grid.rows, grid.columns])?;
        Warp::new(grid).ok_or_else(|| {
            self.bad(field, "a direction of incidence with nothing but 0", "a density")
        })
    }

    /// Into how many alike parts the azimuths divide the circle; 0 for an isotropic file.
    fn folds(&self, phi_i: &[f64]) -> Result<usize, ParseError> {
        if phi_i.len() <= 2 {
            return Ok(0);
        }
        let (first, last) = (phi_i[0], phi_i[phi_i.len() - 1]);
        let folds = (TAU / (last - first)).round();
        let whole = (first + PI).abs() < 0.01 && (last - (first + TAU / folds)).abs() < 0.02;
        if whole && [1.0, 2.0, 4.0].contains(&folds) {
            return Ok(folds as usize);
        }
        let found = format!("azimuths from {first:.4} to {last:.4} rad");
        Err(self.bad("phi_i", found, "azimuths from −π to −π/2, 0 or π"))
    }

    fn tensor(&self) -> Result<(Tensor, Vec<f64>), ParseError> {
        let theta_i = self.increasing("theta_i", false)?;
        let phi_i = self.increasing("phi_i", true)?;
        let wavelengths = self.increasing("wavelengths", false)?;
        let (nt, np, nl) = (theta_i.len(), phi_i.len(), wavelengths.len());
        if theta_i[nt - 1] > FRAC_PI_2 + 1e-4 {
            let found = format!("{} rad", theta_i[nt - 1]);
            return Err(self.bad("theta_i", found, "elevations up to π/2"));
        }
        if wavelengths[0] < 1.0 {
            let found = format!("{} nm", wavelengths[0]);
            return Err(self.bad("wavelengths", found, "wavelengths in nm"));
        }
        let luminance = self.grid("luminance")?;
        let side = luminance.columns;
        let (shape, values) = self.get("spectra", false)?;
        self.shape("spectra", shape, &[np, nt, nl, side, side])?;
        // Wavelength last.
        let mut spectra = vec![0.0_f32; values.len()];
        for (at, value) in values.iter().enumerate() {
            let (slice, rest) = (at / (nl * side * side), at % (nl * side * side));
            let (k, node) = (rest / (side * side), rest % (side * side));
            spectra[(slice * side * side + node) * nl + k] = *value;
        }
        let ndf = self.grid("ndf")?;
        let sigma = self.grid("sigma")?;
        if let Some(at) = sigma.values.iter().position(|v| *v <= 0.0) {
            return Err(self.bad("sigma", format!("0 at place {at}"), "areas above 0"));
        }
        let jacobian = match self.file.get("jacobian").map(|t| &t.data) {
            Some(sunglint_formats::bsdf::TensorData::U8(v)) if v.len() == 1 => v[0] != 0,
            _ => return Err(self.bad("jacobian", "another length", "one byte, 0 or 1")),
        };
        let width_rad = width(&ndf);
        let tensor = Tensor {
            folds: self.folds(&phi_i)?,
            wavelengths: nl,
            ndf,
            sigma,
            vndf: self.warp("vndf", np, nt)?,
            luminance: self.warp("luminance", np, nt)?,
            side,
            spectra,
            jacobian,
            width_rad,
            theta_i,
            phi_i,
        };
        Ok((tensor, wavelengths))
    }
}

/// Twice the smallest tilt at which the density has fallen to 1/e of what it is at the normal, both counted from the least there is: for diffuse light a file's density has a floor.
fn width(ndf: &Grid) -> f64 {
    let least = ndf.values.iter().copied().fold(f32::INFINITY, f32::min);
    let peak = ndf.values.iter().step_by(ndf.columns).copied().fold(0.0_f32, f32::max) - least;
    let far = |row: usize| {
        let values = &ndf.values[row * ndf.columns..(row + 1) * ndf.columns];
        let column = values.iter().position(|v| *v - least < peak / std::f32::consts::E);
        let u = column.unwrap_or(ndf.columns - 1) as f64 / (ndf.columns - 1) as f64;
        2.0 * FRAC_PI_2 * u * u
    };
    (0..ndf.rows).map(far).fold(FRAC_PI_2, f64::min)
}
