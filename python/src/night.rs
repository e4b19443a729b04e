//! A virtual night, and what a recorded session becomes: linear curves, a calibration, calibrated curves.

use crate::product::Outcome;
use crate::sky::{AirModel, within, zero_point};
use crate::watch::{Failure, Watch, run};
use crate::workflows::{needed, station};
use numpy::{PyArray1, PyArray2, PyArrayMethods as _, ToPyArray as _};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::{Path, PathBuf};
use sunglint_calibration::apply::{self, PhaseLaw, PhotometryOptions};
use sunglint_calibration::reduction::frames::FrameOptions;
use sunglint_calibration::reduction::{Recipe, ReduceOptions, reduce};
use sunglint_calibration::stars::{
    NightsError, NightsOptions, Options as StarOptions, calibrate_nights, read_visits,
};
use sunglint_calibration::timing::read_timings;
use sunglint_formats::session::Session;
use sunglint_formats::time::format_utc;
use sunglint_formats::{CountRecord, Frame};
use sunglint_numerics::progress::Progress as _;
use sunglint_radiometry::station::Station;
use sunglint_rehearsal::{demo, planned};
use sunglint_report::{
    Product, apply as applied, calibrate as calibrated, observe, reduce as reduced, session,
};

/// Name and version that stand in a session.
const PROGRAM: &str = concat!("sunglint ", env!("CARGO_PKG_VERSION"));

/// The files of the demonstration's night: names and texts.
#[pyfunction]
fn demo_files(seed: u64) -> Vec<(&'static str, String)> {
    demo::files(seed)
}

/// The files of a shorter night with one satellite: names and texts.
#[pyfunction]
fn short_files(seed: u64) -> Vec<(&'static str, String)> {
    demo::short_files(seed)
}

/// Name or file of the station that a session was recorded with, its counters and its cameras.
#[pyfunction]
fn session_parts(
    py: Python<'_>,
    folder: PathBuf,
) -> PyResult<(Option<String>, Vec<String>, Vec<String>)> {
    run(py, None, move |_| {
        let session = Session::open(&folder)?;
        let file = session.file("station/station.toml");
        let name = &session.manifest().station;
        let known = Station::built_in_names().into_iter().find(|n| n.eq_ignore_ascii_case(name));
        let station = match file.to_str() {
            Some(file) if Path::new(file).is_file() => Some(file.to_owned()),
            _ => known.map(str::to_owned),
        };
        let names = |of: &mut dyn Iterator<Item = &str>| of.map(str::to_owned).collect();
        Ok((station, names(&mut session.counters()), names(&mut session.cameras())))
    })
}

/// The bins of a counter as arrays: names of the channels, starts (ns of UTC after 1970; ps of the counter's clock), lengths, counts and missed events (n, channels), flags.
#[pyfunction]
fn session_counts<'py>(
    py: Python<'py>,
    folder: PathBuf,
    counter: String,
) -> PyResult<Bound<'py, PyDict>> {
    let (channels, records) = run(py, None, move |watch| {
        let counts = Session::open(&folder)?.counts(&counter)?;
        let channels = counts.channels().to_vec();
        let mut records = Vec::new();
        for record in counts {
            if watch.is_cancelled() {
                return Err("stopped".into());
            }
            records.push(record?);
        }
        Ok((channels, records))
    })?;
    let out = PyDict::new(py);
    let shape = [records.len(), channels.len()];
    let whole = |of: fn(&CountRecord) -> i64| {
        PyArray1::from_vec(py, records.iter().map(of).collect::<Vec<i64>>())
    };
    // Before 1678 and after 2262 there are no such nanoseconds, and no counters.
    let utc_ns = |record: &CountRecord| {
        i64::try_from(record.start.to_unix_duration().total_nanoseconds()).unwrap_or(i64::MIN)
    };
    out.set_item("start_utc_ns", whole(utc_ns))?;
    out.set_item("start_ps", whole(|r| r.start_ps))?;
    out.set_item("length_ps", whole(|r| r.length_ps))?;
    out.set_item("flags", whole(|r| i64::from(r.flags.bits())))?;
    let flat = |of: fn(&CountRecord) -> &Vec<u64>| {
        PyArray1::from_vec(py, records.iter().flat_map(of).copied().collect::<Vec<u64>>())
            .reshape(shape)
    };
    out.set_item("counts", flat(|r| &r.counts)?)?;
    out.set_item("missed", flat(|r| &r.missed)?)?;
    out.set_item("channels", channels)?;
    Ok(out)
}

/// The frames of a camera: numbers and files; none is read.
#[pyfunction]
fn session_frames(
    py: Python<'_>,
    folder: PathBuf,
    camera: String,
) -> PyResult<Vec<(u64, PathBuf)>> {
    run(py, None, move |_| {
        let frames = Session::open(&folder)?.frames(&camera)?;
        Ok(frames.files.into_iter().map(|frame| (frame.sequence, frame.path)).collect())
    })
}

/// A frame of a session: its pixels, and what is known of it.
#[pyfunction]
fn read_frame<'py>(
    py: Python<'py>,
    path: PathBuf,
) -> PyResult<(Bound<'py, PyArray2<u16>>, Bound<'py, PyDict>)> {
    let frame = run(py, None, move |_| Ok(Frame::read(&path)?))?;
    let about = PyDict::new(py);
    about.set_item("start_utc", format_utc(frame.start, 9))?;
    about.set_item("exposure_s", frame.exposure_s)?;
    about.set_item("gain_e_per_adu", frame.gain_e_per_adu)?;
    about.set_item("saturation_adu", frame.saturation_adu)?;
    about.set_item("temperature_c", frame.temperature_c)?;
    about.set_item("origin_px", frame.origin)?;
    about.set_item("binning", frame.binning)?;
    about.set_item("bayer", frame.bayer.map(|bayer| bayer.name()))?;
    let text = |key: &str| frame.header.get(key).and_then(|v| v.text()).map(str::to_owned);
    about.set_item("target", text("OBJECT"))?;
    about.set_item("filter", text("FILTER"))?;
    Ok((frame.pixels.to_pyarray(py), about))
}

/// Observes a virtual night into a session's folder.
#[pyfunction]
#[pyo3(signature = (plan, output, progress=None))]
fn observe_virtual(
    py: Python<'_>,
    plan: PathBuf,
    output: PathBuf,
    progress: Option<Py<PyAny>>,
) -> PyResult<Outcome> {
    run(py, progress, move |watch: &Watch| {
        let (night, made) = planned(&plan, Some(&output), PROGRAM)?;
        if made.is_none() {
            return Err(format!(
                "{}: the plan names no virtual night; devices are driven by the program: sunglint observe {}",
                plan.display(),
                plan.display()
            )
            .into());
        }
        watch.begin("observing", None);
        let summary = night.run(watch.cancel(), &mut |_| {})?;
        summary.check()?;
        let json = observe::summary_json(&summary);
        let product = Product { name: "observed".into(), json, ..Product::default() };
        Ok(Outcome::new(product, observe::summary_text(&summary), Vec::new()))
    })
}

/// Check of what is there of a recorded session.
#[pyfunction]
fn check_session(py: Python<'_>, folder: PathBuf) -> PyResult<(Outcome, bool)> {
    run(py, None, move |_| {
        let opened = Session::open(&folder)?;
        let report = opened.check()?;
        let json = session::json(&opened, &report);
        let product = Product { name: "session".into(), json, ..Product::default() };
        let is_whole = report.is_whole();
        Ok((Outcome::new(product, session::text(&opened, &report), Vec::new()), is_whole))
    })
}

/// Reduces a session: the summary, and the products of each visit.
#[pyfunction]
#[pyo3(signature = (folder, target=None, station=None, aperture_px=None, fwhm_px=None, gate=1.0, raw=false, timing=None, progress=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn reduce_session(
    py: Python<'_>,
    folder: PathBuf,
    target: Option<String>,
    station: Option<String>,
    aperture_px: Option<f64>,
    fwhm_px: Option<f64>,
    gate: Option<f64>,
    raw: bool,
    timing: Option<PathBuf>,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Outcome, Vec<Outcome>)> {
    run(py, progress, move |watch: &Watch| {
        let session = Session::open(&folder)?;
        let station = match self::station(station.as_deref())? {
            Some(station) => station,
            None => Station::of_session(&session)?,
        };
        let mut options = ReduceOptions::for_station(&station);
        options.frames = FrameOptions::for_station(&station);
        if let (Some(frames), Some(timing)) = (&mut options.frames, &timing) {
            frames.timings = Some(read_timings(timing)?);
        }
        let recipe = Recipe {
            target,
            gate: gate.map(|q| within("gate", q, 1e-9, 1e9)).transpose()?,
            no_gate: gate.is_none(),
            aperture_px,
            fwhm_px,
            ..Recipe::default()
        };
        recipe.apply(&mut options);
        watch.begin("frames and bins", None);
        let mut night = reduce(&session, &station, &options, watch)?;
        let (mut curves, mut visits) = (Vec::new(), Vec::new());
        while let Some(visited) = night.take(&session, &station)? {
            for product in reduced::products(&visited, &station, raw)? {
                curves.push(Outcome::new(product, String::new(), Vec::new()));
            }
            visits.push(reduced::VisitLine::of(&visited));
        }
        let warnings = station.warnings.iter().chain(&night.warnings).cloned().collect();
        let name = folder.display().to_string();
        let product = reduced::product(&night, &visits, &name, &station.name);
        let text = reduced::text(&night, &visits, &name, &station.name);
        Ok((Outcome::new(product, text, warnings), curves))
    })
}

/// Calibrates channels and nights by stars.
#[pyfunction]
#[pyo3(signature = (inputs, station, air, floor=None, clip_sigma=None, confidence=None, fit_aerosol=false, scintillation=None, zero_point="vega=0.03".into(), seed=0))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn calibrate(
    py: Python<'_>,
    inputs: Vec<PathBuf>,
    station: String,
    air: AirModel,
    floor: Option<f64>,
    clip_sigma: Option<f64>,
    confidence: Option<f64>,
    fit_aerosol: bool,
    scintillation: Option<f64>,
    zero_point: String,
    seed: u64,
) -> PyResult<Outcome> {
    run(py, None, move |_| {
        let usual = StarOptions::default();
        let fit = StarOptions {
            floor: floor.unwrap_or(usual.floor),
            clip_sigma: clip_sigma.unwrap_or(usual.clip_sigma),
            confidence: confidence.unwrap_or(usual.confidence),
            fit_aerosol,
            seed,
            ..usual
        };
        let scintillation =
            scintillation.unwrap_or(sunglint_calibration::stars::scintillation::USUAL_COEFFICIENT);
        let options = NightsOptions {
            fit,
            scintillation: within("scintillation", scintillation, 0.0, 10.0)?,
            zero_point: self::zero_point(&zero_point)?,
        };
        let station = needed("station", self::station(Some(&station))?)?;
        let air = air.air(station.site.geodetic().height_m, Some(&station))?;
        let mut warnings = [station.warnings.clone(), air.implausible()].concat();
        let (visits, left_out) = read_visits(&inputs)?;
        warnings.extend(left_out);
        let found = match calibrate_nights(&visits, &station, &air, &options) {
            Ok(found) => found,
            Err(NightsError::NoNight { warnings: why, .. }) if !why.is_empty() => {
                return Err(format!("no night can be calibrated: {}", why.join("; ")).into());
            }
            Err(error) => return Err(error.into()),
        };
        warnings.extend(found.warnings.clone());
        let report =
            calibrated::CalibrationReport { found: &found, station: &station, warnings: &warnings };
        let (product, text) = (report.product(), report.text());
        Ok(Outcome::new(product, text, warnings.clone()))
    })
}

/// A linear curve times its calibration.
#[pyfunction]
#[pyo3(name = "apply", signature = (calibration, curve, station, air, night=None, spectrum=None, magnitudes=None, phase_law=None, keep_aerosol=false, zero_point="vega=0.03".into()))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn apply_calibration(
    py: Python<'_>,
    calibration: PathBuf,
    curve: PathBuf,
    station: String,
    air: AirModel,
    night: Option<String>,
    spectrum: Option<String>,
    magnitudes: Option<String>,
    phase_law: Option<String>,
    keep_aerosol: bool,
    zero_point: String,
) -> PyResult<(Outcome, Option<Outcome>)> {
    run(py, None, move |_| {
        let input = apply::read(&calibration, &curve)?;
        let station = needed("station", self::station(Some(&station))?)?;
        let mut found = apply::apply(&input, &station, night.as_deref())?;
        if magnitudes.is_some() || spectrum.is_some() {
            let usual = PhotometryOptions::default();
            let options = PhotometryOptions {
                spectrum: spectrum.unwrap_or(usual.spectrum),
                band: magnitudes.unwrap_or(usual.band),
                zero_point: self::zero_point(&zero_point)?,
                phase_law: match phase_law.as_deref() {
                    None | Some("lambert") => PhaseLaw::Lambert,
                    Some("illuminated") => PhaseLaw::Illuminated,
                    Some(other) => {
                        return Err(Failure::from(format!(
                            "phase_law is `{other}`, expected lambert or illuminated"
                        )));
                    }
                },
                keep_aerosol,
            };
            let air = air.air(station.site.geodetic().height_m, Some(&station))?;
            found.add_photometry(&station, &air, &options)?;
        }
        let report = applied::AppliedReport { found: &found, station: &station };
        let outcome = Outcome::new(report.product()?, report.text(), found.warnings.clone());
        let photometry = found.photometry.as_ref();
        let photometry = photometry
            .map(|p| Outcome::new(applied::photometry_product(p), String::new(), Vec::new()));
        Ok((outcome, photometry))
    })
}

/// Adds the functions to the module.
pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(demo_files, module)?)?;
    module.add_function(wrap_pyfunction!(short_files, module)?)?;
    module.add_function(wrap_pyfunction!(session_parts, module)?)?;
    module.add_function(wrap_pyfunction!(session_counts, module)?)?;
    module.add_function(wrap_pyfunction!(session_frames, module)?)?;
    module.add_function(wrap_pyfunction!(read_frame, module)?)?;
    module.add_function(wrap_pyfunction!(observe_virtual, module)?)?;
    module.add_function(wrap_pyfunction!(check_session, module)?)?;
    module.add_function(wrap_pyfunction!(reduce_session, module)?)?;
    module.add_function(wrap_pyfunction!(calibrate, module)?)?;
    module.add_function(wrap_pyfunction!(apply_calibration, module)?)
}
