//! Materials: their microfacets, the laws through their samples, what they do.

use crate::product::Outcome;
use crate::watch::{Failure, Watch, run};
use crate::workflows::unknown;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Deadline, DeviceClock, VirtualClock};
use sunglint_drivers::device::{Device, InBeam, PowerMeter as _, RotationStage as _};
use sunglint_formats::toml::Document;
use sunglint_materials::assemble::files::{AssemblyFiles, assemble_files};
use sunglint_materials::fit::surface::{Cone, SurfaceOptions, fit_surface};
use sunglint_materials::fit::{FitOptions, Law, LobeKind, fit, to_toml};
use sunglint_materials::log::refuse_begun;
use sunglint_materials::look::{self, Look};
use sunglint_materials::ndf::{NdfOptions, TailKind, extract};
use sunglint_materials::plan::{PlanOptions, Rig};
use sunglint_materials::read;
use sunglint_materials::retro::log::{self, Begun};
use sunglint_materials::retro::plan::RunPlan;
use sunglint_materials::retro::{measure, reduce};
use sunglint_materials::table::RetroTable;
use sunglint_numerics::progress::Progress as _;
use sunglint_report::Product;
use sunglint_report::brdf::{
    assemble as assembled, fit as laws, ndf as normals, plan as planned, retro as retro_report,
    show, surface,
};
use sunglint_report::devices::described;
use sunglint_virtual::rig::devices::VirtualRig;
use sunglint_virtual::rig::options::Options;

/// How long a step of a device may take, and finding a stage's reference.
const OPEN: Duration = Duration::from_secs(30);
const HOME: Duration = Duration::from_secs(300);

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

/// Directions in which a sample should be measured, by its density.
#[pyfunction]
#[pyo3(signature = (ndf, theta_i=8, phi_i=9, quarter=false, side=None, normals=128, wide=0.25, most_theta_i_deg=None, rig=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn plan(
    py: Python<'_>,
    ndf: PathBuf,
    theta_i: usize,
    phi_i: usize,
    quarter: bool,
    side: Option<usize>,
    normals: usize,
    wide: f64,
    most_theta_i_deg: Option<f64>,
    rig: Option<[Option<f64>; 3]>,
) -> PyResult<Outcome> {
    run(py, None, move |_| {
        let (density, inputs) = read::density(&ndf)?;
        if quarter && density.is_isotropic() {
            return Err("quarter: the sample is isotropic, it has no azimuths".into());
        }
        let mut options = PlanOptions::default();
        if let Some([least_phase_deg, most_theta_o_deg, mark_deg]) = rig {
            let usual = Rig::default();
            options = PlanOptions::of_rig(Rig {
                least_phase_deg: least_phase_deg.unwrap_or(usual.least_phase_deg),
                most_theta_i_deg: most_theta_i_deg.unwrap_or(usual.most_theta_i_deg),
                most_theta_o_deg: most_theta_o_deg.unwrap_or(usual.most_theta_o_deg),
                mark_deg: mark_deg.unwrap_or(usual.mark_deg),
            });
        }
        options.side = side.unwrap_or(options.side);
        options.most_theta_i_deg = most_theta_i_deg.unwrap_or(options.most_theta_i_deg);
        let options = PlanOptions { theta_i, phi_i, quarter, normals, wide, ..options };
        let made = sunglint_materials::plan::plan(&density, &options)
            .map_err(|e| format!("{}: {e}", ndf.display()))?;
        let (product, text) = (planned::product(&made, &inputs), planned::text(&made));
        Ok(Outcome::new(product, text, Vec::new()))
    })
}

/// A material of measured values and their density: the result with the table of the coverage, and the bytes of the `.bsdf`.
#[pyfunction]
#[pyo3(signature = (samples, ndf, plan=None, wavelength_nm=None, theta_i=72, phi_i=17, side=None, normals=128, progress=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn assemble<'py>(
    py: Python<'py>,
    samples: PathBuf,
    ndf: PathBuf,
    plan: Option<PathBuf>,
    wavelength_nm: Option<f64>,
    theta_i: usize,
    phi_i: usize,
    side: Option<usize>,
    normals: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Outcome, Bound<'py, PyBytes>)> {
    let (outcome, bytes) = run(py, progress, move |watch: &Watch| {
        let files =
            AssemblyFiles { samples, ndf, plan, wavelength_nm, theta_i, phi_i, side, normals };
        let found = assemble_files(&files, watch)?;
        let (made, inputs) = (&found.made, &found.inputs);
        let mut others = vec![Product {
            name: "doubts".into(),
            table: assembled::doubts(made, inputs),
            ..Product::default()
        }];
        if let Some(plan) = &found.plan {
            let table = assembled::missing_table(&plan.missing, inputs);
            others.push(Product { name: "missing".into(), table, ..Product::default() });
        }
        let warnings = [watch.warnings(), made.warnings.clone()].concat();
        let product = Product {
            name: "coverage".into(),
            table: assembled::table(made, inputs),
            json: assembled::summary(&found),
            others,
            ..Product::default()
        };
        let outcome = Outcome::new(product, assembled::text(made), warnings);
        Ok((outcome, made.file.to_bytes()?))
    })?;
    Ok((outcome, PyBytes::new(py, &bytes)))
}

/// Retro-reflection against angle: a virtual rig measures what RUN.toml says into a folder, or what a folder holds is reduced.
#[pyfunction]
#[pyo3(signature = (plan, folder, reduce_only=false, progress=None))]
fn retro(
    py: Python<'_>,
    plan: PathBuf,
    folder: PathBuf,
    reduce_only: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<Outcome> {
    run(py, progress, move |watch: &Watch| {
        let document = Document::read(&plan)?;
        if !reduce_only {
            refuse_begun::<measure::Line>(&folder)?;
        }
        let begun =
            reduce_only.then(|| Begun::read(&folder, &[log::PLAN, log::RIG])).transpose()?;
        let rig = begun.as_ref().and_then(|begun| begun.file(log::RIG));
        let plan = RunPlan::new(&document, rig)?;
        let (lines, devices) = match begun {
            Some(begun) => (begun.lines, begun.devices),
            None => rehearsed_run(&plan, &folder, watch)?,
        };
        let found = reduce(&measure::measured(&lines), &plan.setup)
            .map_err(|e| format!("{}: {e}", folder.display()))?;
        let product = retro_report::product(&found, &plan, &lines, &devices, &folder);
        let mut warnings: Vec<String> = found.notes.iter().map(ToString::to_string).collect();
        let left = retro_report::left(&plan, &lines);
        if left > 0 {
            warnings.push(format!("{left} angles are not measured yet"));
        }
        Ok(Outcome::new(product, retro_report::text(&found, left), warnings))
    })
}

/// The virtual rig's hands.
struct Robot(VirtualRig);

impl measure::Hands for Robot {
    fn put(&mut self, place: InBeam) -> Result<(), measure::HandsError> {
        self.0.place(place);
        Ok(())
    }
}

/// Measures with a virtual rig into a folder: the lines, and what the devices say of themselves.
fn rehearsed_run(
    plan: &RunPlan,
    folder: &Path,
    watch: &Watch,
) -> Result<(Vec<measure::Line>, Value), Failure> {
    let Some(rig) = &plan.rig else {
        return Err(format!(
            "{} names no virtual rig; devices are driven by the program: sunglint brdf retro",
            plan.name
        )
        .into());
    };
    let virtual_rig = VirtualRig::new(Options::read(rig)?, 0)?;
    // Any night will do, as long as the same run has the same times.
    let zero = hifitime::Epoch::from_gregorian_utc_at_midnight(2026, 1, 1);
    let clock = DeviceClock { clock: Arc::new(VirtualClock::new()), zero_utc: Some(zero) };
    let cancel = watch.cancel();
    let (mut stage, mut meter) = (virtual_rig.stage(), virtual_rig.meter());
    let within = |time| Deadline::after(clock.clock.clone(), time).with_cancel(cancel);
    let measuring = &plan.measuring;
    meter.set_wavelength_nm(measuring.wavelength_nm, &within(OPEN))?;
    if let Some(range) = &measuring.meter.range {
        meter.set_range(range, &within(OPEN))?;
    }
    if measuring.stage.home {
        stage.home(&within(HOME))?;
    }
    let says =
        |device: &mut dyn Device| described(device, &|| Deadline::after(clock.clock.clone(), OPEN));
    let begin = json!({ "stage": says(&mut stage)?, "meter": says(&mut meter)? });
    let files = [(log::PLAN, plan.source.as_str()), (log::RIG, rig.source())];
    let mut log = log::Log::create(folder, &files, clock.clone())?;
    log.write_event("begin", json!({ "lines": 0 }))?;
    log.write_event("devices", begin.clone())?;
    watch.begin("angles", None);
    let mut robot = Robot(virtual_rig);
    let mut rig = measure::Rig {
        stage: &mut stage,
        meter: &mut meter,
        hands: &mut robot,
        clock: clock.clone(),
        cancel: cancel.clone(),
    };
    measure::measure(&mut rig, measuring, &[], false, 0.0, &mut log)?;
    log.write_event("end", json!({ "lines": log.lines.len() }))?;
    let end = json!({ "stage": says(&mut stage)?, "meter": says(&mut meter)? });
    let devices = json!({ "begin": begin, "end": end });
    log.write_event("devices", devices.clone())?;
    Ok((std::mem::take(&mut log.lines), devices))
}

/// A composite of lobes through measured values; with laws, one lobe of the best of them.
#[pyfunction]
#[pyo3(signature = (table, wavelength_nm=None, floor_per_sr=None, laws=Vec::new(), cone_deg=None, source_deg=None, theta_most_deg=85.0, most_lobes=3, name="fitted".into(), accept=false, progress=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn fit_material(
    py: Python<'_>,
    table: PathBuf,
    wavelength_nm: Option<f64>,
    floor_per_sr: Option<f64>,
    laws: Vec<String>,
    cone_deg: Option<f64>,
    source_deg: Option<f64>,
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
            let notes = found.notes.iter().map(ToString::to_string);
            let flaws = found.flaws.iter().map(ToString::to_string);
            return Ok(Outcome::new(product, text, notes.chain(flaws).collect())
                .with_files(vec![("material.toml".into(), toml)]));
        }
        let mut options = SurfaceOptions::of(&measured);
        let Cone { detector_deg, source_deg: source } = options.cone;
        options.cone = Cone {
            detector_deg: cone_deg.unwrap_or(detector_deg),
            source_deg: source_deg.unwrap_or(source),
        };
        for (name, deg, most) in [
            ("cone_deg", options.cone.detector_deg, 10.0),
            ("source_deg", options.cone.source_deg, 10.0),
            ("theta_most_deg", theta_most_deg, 90.0),
        ] {
            crate::sky::within(name, deg, 0.0, most)?;
        }
        if !(1..=3).contains(&most_lobes) {
            return Err(format!("most_lobes is {most_lobes}, expected 1 to 3").into());
        }
        options.wavelength_nm = wavelength_nm;
        options.floor_per_sr = floor_per_sr;
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
        let text = show::text(&read, &seen, phi_i_deg);
        Ok(Outcome::new(product, text, seen.warnings))
    })
}

/// Adds the functions to the module.
pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(ndf, module)?)?;
    module.add_function(wrap_pyfunction!(plan, module)?)?;
    module.add_function(wrap_pyfunction!(assemble, module)?)?;
    module.add_function(wrap_pyfunction!(retro, module)?)?;
    module.add_function(wrap_pyfunction!(fit_material, module)?)?;
    module.add_function(wrap_pyfunction!(show_material, module)?)
}
