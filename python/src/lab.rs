//! Materials: their microfacets, the laws through their samples, what they do.

use crate::product::Outcome;
use crate::watch::{Watch, run};
use crate::workflows::unknown;
use pyo3::prelude::*;
use std::path::PathBuf;
use sunglint_materials::fit::surface::{Cone, SurfaceOptions, fit_surface};
use sunglint_materials::fit::{FitOptions, Law, LobeKind, fit, to_toml};
use sunglint_materials::look::{self, Look};
use sunglint_materials::ndf::{NdfOptions, TailKind, extract};
use sunglint_materials::read;
use sunglint_materials::table::RetroTable;
use sunglint_report::brdf::{fit as laws, ndf as normals, show, surface};

/// The density of microfacet normals from retro-reflection.
#[pyfunction]
#[pyo3(signature = (table, zero_deg=None, most_offset_deg=5.0, median=None, tail=None, elevations=None, azimuths=None, resamplings=200, diffuse=true, seed=0))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn ndf(
    py: Python<'_>,
    table: PathBuf,
    zero_deg: Option<f64>,
    most_offset_deg: f64,
    median: Option<usize>,
    tail: Option<String>,
    elevations: Option<usize>,
    azimuths: Option<usize>,
    resamplings: usize,
    diffuse: bool,
    seed: u64,
) -> PyResult<Outcome> {
    run(py, None, move |_| {
        let tail = match tail.as_deref() {
            None => None,
            Some("ggx") => Some(TailKind::Ggx),
            Some("beckmann") => Some(TailKind::Beckmann),
            Some("exponential") => Some(TailKind::Exponential),
            Some("linear") => Some(TailKind::Linear),
            Some(other) => {
                return Err(unknown("tail", other, "ggx, beckmann, exponential or linear"));
            }
        };
        let (source, inputs) = read::table(&table)?;
        let run = RetroTable::from_table(&table, &source)?;
        let options = NdfOptions {
            elevations,
            azimuths,
            median,
            zero_deg,
            most_offset_deg,
            tail,
            diffuse,
            resamplings,
            seed,
        };
        let found = extract(&run, &options).map_err(|e| format!("{}: {e}", table.display()))?;
        let warnings: Vec<String> = found.notes.iter().map(ToString::to_string).collect();
        let product = normals::product(&found, &run, &inputs, &warnings, &options);
        let text = normals::text(&found, &run);
        Ok(Outcome::new(product, text, warnings))
    })
}

/// A composite of lobes through measured values; with laws, one lobe of the best of them.
#[pyfunction]
#[pyo3(signature = (table, wavelength_nm=None, floor_per_sr=None, laws=Vec::new(), cone_deg=0.24, source_deg=0.0, theta_most_deg=85.0, most_lobes=3, name="fitted".into(), accept=false, progress=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn fit_material(
    py: Python<'_>,
    table: PathBuf,
    wavelength_nm: Option<f64>,
    floor_per_sr: Option<f64>,
    laws: Vec<String>,
    cone_deg: f64,
    source_deg: f64,
    theta_most_deg: f64,
    most_lobes: usize,
    name: String,
    accept: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<Outcome> {
    run(py, progress, move |watch: &Watch| {
        let (measured, inputs) = read::samples(&table, wavelength_nm)?;
        if !laws.is_empty() {
            let mut asked = Vec::new();
            for law in &laws {
                asked.push(kind(law).ok_or_else(|| {
                    unknown("law", law, "lambert, phong, abg, ward, beckmann, ggx or maxwell-beard")
                })?);
            }
            let mut wanted = Law::all(measured.has_azimuths(), true, true);
            wanted.retain(|law| asked.contains(&law.lobe));
            let options = FitOptions {
                laws: wanted,
                wavelength_nm,
                floor_per_sr,
                gaussian: false,
                index: None,
            };
            let found =
                fit(&measured, &options).map_err(|e| format!("{}: {e}", table.display()))?;
            let best = found.laws.first().ok_or("no law was fitted")?;
            let product = self::laws::product(&found, best, &measured, None, &inputs);
            let toml = to_toml(&found, best, &name, None);
            let text = self::laws::text(&found, &toml);
            let warnings = found.notes.iter().map(ToString::to_string).collect();
            return Ok(Outcome::new(product, text, warnings)
                .with_files(vec![("material.toml".into(), toml)]));
        }
        for (name, deg, most) in [
            ("cone_deg", cone_deg, 10.0),
            ("source_deg", source_deg, 10.0),
            ("theta_most_deg", theta_most_deg, 90.0),
        ] {
            crate::sky::within(name, deg, 0.0, most)?;
        }
        if !(1..=3).contains(&most_lobes) {
            return Err(format!("most_lobes is {most_lobes}, expected 1 to 3").into());
        }
        let mut options = SurfaceOptions::default();
        options.wavelength_nm = wavelength_nm;
        options.floor_per_sr = floor_per_sr;
        options.cone = Cone { detector_deg: cone_deg, source_deg };
        options.theta_most_deg = theta_most_deg;
        options.most_lobes = most_lobes;
        let found = fit_surface(&measured, &options, watch)?;
        let mut warnings: Vec<String> = found.flaws.iter().map(ToString::to_string).collect();
        let product = surface::product(&found, &measured, &inputs)?;
        let toml = found.to_toml(&name);
        let text = surface::text(&found, &toml);
        let mut files = Vec::new();
        if found.is_faithful() || accept {
            files.push(("material.toml".to_owned(), toml));
        } else {
            warnings.push("there is no material.toml: peak or hemispherical reflectance are off (above); accept=True takes it as it is".into());
        }
        Ok(Outcome::new(product, text, warnings).with_files(files))
    })
}

fn kind(name: &str) -> Option<LobeKind> {
    Some(match name {
        "lambert" => LobeKind::Lambert,
        "phong" => LobeKind::Phong,
        "abg" => LobeKind::Abg,
        "ward" => LobeKind::Ward,
        "beckmann" => LobeKind::Beckmann,
        "ggx" => LobeKind::Ggx,
        "maxwell-beard" => LobeKind::MaxwellBeard,
        _ => return None,
    })
}

/// A material at a wavelength.
#[pyfunction]
#[pyo3(signature = (material, wavelength_nm, phi_i_deg=0.0))]
fn show_material(
    py: Python<'_>,
    material: String,
    wavelength_nm: f64,
    phi_i_deg: f64,
) -> PyResult<Outcome> {
    run(py, None, move |_| {
        let read = look::read(&material, wavelength_nm)?;
        let seen = Look::new(&read, &material, wavelength_nm, phi_i_deg)?;
        let product = show::product(&read, &seen, wavelength_nm, phi_i_deg);
        let text = show::text(&read, &seen);
        Ok(Outcome::new(product, text, seen.warnings))
    })
}

/// Adds the functions to the module.
pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(ndf, module)?)?;
    module.add_function(wrap_pyfunction!(fit_material, module)?)?;
    module.add_function(wrap_pyfunction!(show_material, module)?)
}
