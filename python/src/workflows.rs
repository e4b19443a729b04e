//! Workflows: the same calls of the libraries as the program's commands.

use crate::product::{Outcome, columns};
use crate::watch::{Error, Failure, Watch, exception, run};
use numpy::{PyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::{Path, PathBuf};
use std::time::Instant;
use sunglint_analysis::curves::{Curves, Trends};
use sunglint_analysis::period::{Options as Search, PeriodOptions, find_period};
use sunglint_analysis::sessions::{self, find_over_sessions};
use sunglint_calibration::field_stars::System;
use sunglint_calibration::photometry::field::{FieldOptions, find};
use sunglint_calibration::photometry::{
    BadPixels, Expected, FrameCalibration, FrameReducer, PhotometryOptions, PixelFault,
    PlaneMeasurement,
};
use sunglint_calibration::reduction::folder::{FolderOptions, StarsOptions, reduce_frames};
use sunglint_formats::Frame;
use sunglint_formats::fits::Header;
use sunglint_formats::photometry::{self, ColumnNames, Scale, TimeFormat};
use sunglint_inference::compare::{MeasuredPass, at_measured_times, compare};
use sunglint_inference::fit::{FitOptions, FreeParameter, fit};
use sunglint_inference::measured::joined;
use sunglint_radiometry::air::{Air, AirOptions};
use sunglint_radiometry::light_curve::published::{MagnitudeKind, MagnitudeOptions, ObjectRows};
use sunglint_radiometry::station::Station;
use sunglint_report::simulate::{Gathered, SimulationReport};
use sunglint_report::{Product, explain, folder, import, period};
use sunglint_simulator::pass::{Overrides, Pass, PassFile, Piece, Stopwatch};
use sunglint_study::run::Part;
use sunglint_study::{Stations, Study};

/// A keyword's value that is not one of those that are known.
pub fn unknown(what: &str, given: &str, known: &str) -> Failure {
    format!("{what} is `{given}`, expected {known}").into()
}

/// A value that must be given.
pub fn needed<T>(name: &str, value: Option<T>) -> Result<T, Failure> {
    value.ok_or_else(|| format!("{name} is missing").into())
}

/// The station that was named: built in, a file or its folder.
pub fn station(name: Option<&str>) -> Result<Option<Station>, Failure> {
    let Some(name) = name else { return Ok(None) };
    if let Some(station) = Station::built_in(name) {
        return Ok(Some(station?));
    }
    if Path::new(name).exists() {
        return Ok(Some(Station::read(Path::new(name))?));
    }
    let names = Station::built_in_names().join(", ");
    Err(format!(
        "there is no station `{name}`: it is neither a built-in name ({names}) nor a file or folder"
    )
    .into())
}

/// Name of the station that the surroundings say, as for the program: that of the environment, else the file in the folder where Python runs.
#[pyfunction]
pub fn usual_station() -> Option<String> {
    let told = std::env::var("SUNGLINT_STATION").ok().filter(|name| !name.is_empty());
    told.or_else(|| Path::new("station.toml").is_file().then(|| "station.toml".to_owned()))
}

/// The station that was named, else the one that the surroundings say.
pub fn station_or_usual(named: Option<&str>) -> Result<Option<Station>, Failure> {
    match named {
        Some(_) => station(named),
        None => station(usual_station().as_deref()),
    }
}

/// The station of a scene, which may have its own: the one that was named, else the scene's own (`None`), else the one that the surroundings say.
pub fn station_for(
    has_own: bool,
    path: &Path,
    named: Option<&str>,
) -> Result<Option<Station>, Failure> {
    if named.is_none() && has_own {
        return Ok(None);
    }
    match station_or_usual(named)? {
        Some(station) => Ok(Some(station)),
        None => Err(format!(
            "{}: no station: the scene names none in [station]; give station= with a built-in name ({}) or a file, set SUNGLINT_STATION, or put a station.toml here",
            path.display(),
            Station::built_in_names().join(", ")
        )
        .into()),
    }
}

/// A scene as a pass, with the station that was named, its own, or the usual one.
pub fn pass(path: &Path, named: Option<&str>, mut overrides: Overrides) -> Result<Pass, Failure> {
    let file = PassFile::read(path)?;
    overrides.station = station_for(file.names_station(), path, named)?;
    Ok(file.resolve(overrides)?)
}

/// Names of the built-in stations.
#[pyfunction]
fn built_in_stations() -> Vec<&'static str> {
    Station::built_in_names()
}

/// A moment in UTC of a text.
pub fn moment(name: &str, text: Option<&str>) -> Result<Option<hifitime::Epoch>, Failure> {
    let Some(text) = text else { return Ok(None) };
    sunglint_formats::time::parse_utc(text)
        .map(Some)
        .map_err(|e| format!("{name} is `{text}`: {e}").into())
}

fn scale(name: Option<&str>) -> Result<Option<Scale>, Failure> {
    Ok(match name {
        None => None,
        Some("utc") => Some(Scale::Utc),
        Some("tai") => Some(Scale::Tai),
        Some("tt") => Some(Scale::Tt),
        Some("tdb") => Some(Scale::Tdb),
        Some("gps") => Some(Scale::Gps),
        Some(other) => return Err(unknown("time_scale", other, "utc, tai, tt, tdb or gps")),
    })
}

/// How tables of magnitudes are read.
#[derive(Debug, Default, FromPyObject)]
#[pyo3(from_item_all)]
pub struct Reading {
    time_column: Option<String>,
    time_scale: Option<String>,
    time_format: Option<String>,
    magnitude_column: Option<String>,
    sigma_column: Option<String>,
    magnitudes_as: Option<String>,
    sigma_mag: Option<f64>,
    object: Option<String>,
}

impl Reading {
    fn names(&self) -> Result<ColumnNames, Failure> {
        let mut names = ColumnNames::default();
        names.time.clone_from(&self.time_column);
        names.scale = scale(self.time_scale.as_deref())?;
        names.format = match self.time_format.as_deref() {
            None => None,
            Some("jd") => Some(TimeFormat::Jd),
            Some("mjd") => Some(TimeFormat::Mjd),
            Some("unix") => Some(TimeFormat::Unix),
            Some("s") => Some(TimeFormat::Seconds),
            Some("d") => Some(TimeFormat::Days),
            Some("iso") => Some(TimeFormat::Iso),
            Some(other) => return Err(unknown("time_format", other, "jd, mjd, unix, s, d or iso")),
        };
        names.magnitude.clone_from(&self.magnitude_column);
        names.sigma.clone_from(&self.sigma_column);
        Ok(names)
    }

    fn kind(&self) -> Result<MagnitudeKind, Failure> {
        Ok(match self.magnitudes_as.as_deref() {
            None | Some("apparent") => MagnitudeKind::Apparent,
            Some("ground") => MagnitudeKind::Ground,
            Some("1000km") => MagnitudeKind::Range,
            Some("standard") => MagnitudeKind::Standard,
            Some(other) => {
                return Err(unknown(
                    "magnitudes_as",
                    other,
                    "apparent, ground, 1000km or standard",
                ));
            }
        })
    }

    fn rows(&self) -> ObjectRows {
        self.object.clone().map_or(ObjectRows::One, ObjectRows::Of)
    }

    /// Options of the reader.
    pub fn options(&self) -> Result<MagnitudeOptions, Failure> {
        Ok(MagnitudeOptions {
            columns: self.names()?,
            kind: self.kind()?,
            sigma_mag: self.sigma_mag,
            rows: self.rows(),
            as_written: false,
        })
    }
}

/// Simulates a pass.
#[pyfunction]
#[pyo3(signature = (scene, station=None, start=None, end=None, step_s=None, tolerance=None, budget_s=None, progress=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn simulate(
    py: Python<'_>,
    scene: PathBuf,
    station: Option<String>,
    start: Option<String>,
    end: Option<String>,
    step_s: Option<f64>,
    tolerance: Option<f64>,
    budget_s: Option<f64>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Outcome> {
    run(py, progress, move |watch| {
        if let Some(step) = step_s.filter(|s| !(s.is_finite() && *s > 0.0)) {
            return Err(format!("step_s is {step}, expected seconds above 0").into());
        }
        let overrides = Overrides {
            from: moment("start", start.as_deref())?,
            to: moment("end", end.as_deref())?,
            step_s,
            tolerance,
            budget_s,
            ..Overrides::default()
        };
        let pass = pass(&scene, station.as_deref(), overrides)?;
        let clock = Stopwatch::new(pass.times.len());
        let simulation = pass
            .simulate(&|progress| {
                clock.tell(progress);
                watch.at(progress.stage.name(), progress.done, progress.of);
            })
            .map_err(|e| format!("{}: {e}", scene.display()))?;
        let mut warnings = pass.warnings.clone();
        warnings.extend(simulation.concerns());
        warnings.extend(pass.concerns_of_times());
        let material =
            simulation.material_doubt(&|_| {}).map_err(|e| format!("{}: {e}", scene.display()))?;
        let piece = Piece { simulation: &simulation, material, polarisation: None };
        let mut gathered = Gathered::new(&pass);
        gathered.add(&piece);
        let report = SimulationReport {
            gathered: &gathered,
            polarised: false,
            bounds: simulation.bounds,
            cost: clock.cost(),
            warnings: &warnings,
        };
        let (product, text) = (report.whole_product(&piece)?, report.text());
        Ok(Outcome::new(product, text, warnings.clone()))
    })
}

/// Makes the missing shards of a study, or of a part of it, with as many threads; the report as JSON. `usual` is the station of a scene that names none.
#[pyfunction]
#[pyo3(signature = (study, output, station=None, usual=None, part=1, of=1, threads=None, progress=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn run_study(
    py: Python<'_>,
    study: PathBuf,
    output: PathBuf,
    station: Option<String>,
    usual: Option<String>,
    part: usize,
    of: usize,
    threads: Option<usize>,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    run(py, progress, move |watch| {
        let study = read_study(&study, station.as_deref(), usual.as_deref())?;
        let make = || sunglint_study::run::run(&study, &output, Part { part, of }, watch);
        let ran = match threads {
            None => make(),
            Some(threads) => {
                rayon::ThreadPoolBuilder::new().num_threads(threads).build()?.install(make)
            }
        }?;
        Ok(serde_json::to_string(&ran.report)?)
    })
}

/// Number of shards of a study, and which of them are missing in its folder, which is made where it is not there.
#[pyfunction]
#[pyo3(signature = (study, output, station=None, usual=None))]
fn missing_shards(
    py: Python<'_>,
    study: PathBuf,
    output: PathBuf,
    station: Option<String>,
    usual: Option<String>,
) -> PyResult<(usize, Vec<usize>)> {
    run(py, None, move |_| {
        let study = read_study(&study, station.as_deref(), usual.as_deref())?;
        sunglint_study::run::prepare(&study, &output)?;
        sunglint_study::run::refresh(&study, &output);
        Ok((study.shards(), sunglint_study::run::missing(&study, &output)))
    })
}

fn read_study(path: &Path, named: Option<&str>, usual: Option<&str>) -> Result<Study, Failure> {
    let usual = if usual.is_some() { station(usual)? } else { station_or_usual(None)? };
    Ok(Study::read(path, Stations { instead: station(named)?, usual })?)
}

/// Effects that a pass needs.
#[pyfunction]
#[pyo3(signature = (scene, station=None, tolerance=None))]
fn needs(
    py: Python<'_>,
    scene: PathBuf,
    station: Option<String>,
    tolerance: Option<f64>,
) -> PyResult<Outcome> {
    run(py, None, move |_| {
        let overrides = Overrides { tolerance, ..Overrides::default() };
        let pass = pass(&scene, station.as_deref(), overrides)?;
        let explanation = pass.explain()?;
        let mut warnings = pass.warnings.clone();
        warnings.extend(explanation.scene.warnings.iter().cloned());
        let product = Product {
            name: format!("{}_needs", pass.name),
            table: explain::table(&pass, &explanation),
            json: explain::document(&pass, &explanation),
            ..Product::default()
        };
        Ok(Outcome::new(product, explain::text(&pass, &explanation), warnings))
    })
}

/// A measured pass beside the simulated one.
#[pyfunction]
#[pyo3(name = "compare", signature = (measured, scene, reading, station=None, channels=Vec::new(), tolerance=None, progress=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn compare_pass(
    py: Python<'_>,
    measured: PathBuf,
    scene: PathBuf,
    reading: Reading,
    station: Option<String>,
    channels: Vec<String>,
    tolerance: Option<f64>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Outcome> {
    run(py, progress, move |watch: &Watch| {
        let overrides = Overrides { tolerance, ..Overrides::default() };
        let scene = pass(&scene, station.as_deref(), overrides)?;
        let mut measured = MeasuredPass::read(&measured, &reading.options()?, &scene)?;
        measured.keep(&channels, &scene.station)?;
        let scene = at_measured_times(scene, &measured)?;
        let compared = compare(&scene, measured, watch)?;
        let product = sunglint_report::compare::product(&compared);
        let text = sunglint_report::compare::text(&compared);
        Ok(Outcome::new(product, text, compared.warnings.clone()))
    })
}

/// Fits scenes to measured passes.
#[pyfunction]
#[pyo3(name = "fit", signature = (inputs, reading, free=Vec::new(), per_pass=Vec::new(), channels=Vec::new(), station=None, largest_albedo=None, scintillation=None, places=None, starts=None, iterations=None, seed=0, progress=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn fit_passes(
    py: Python<'_>,
    inputs: Vec<PathBuf>,
    reading: Reading,
    free: Vec<String>,
    per_pass: Vec<String>,
    channels: Vec<String>,
    station: Option<String>,
    largest_albedo: Option<f64>,
    scintillation: Option<f64>,
    places: Option<usize>,
    starts: Option<usize>,
    iterations: Option<usize>,
    seed: u64,
    progress: Option<Py<PyAny>>,
) -> PyResult<(Outcome, bool)> {
    run(py, progress, move |watch: &Watch| {
        let mut curves = joined(&inputs, &reading.options()?)?;
        let of_scene = FitOptions::of_scene(&curves[0].scene.path)?;
        let wanted: Vec<FreeParameter> =
            free.iter().map(|text| text.parse()).collect::<Result<_, _>>()?;
        let given = |name: &str| wanted.iter().any(|w| w.name == name);
        let mut options = FitOptions::default();
        options.free = of_scene.free.into_iter().filter(|w| !given(&w.name)).collect();
        options.free.extend(wanted.iter().cloned());
        options.per_pass = of_scene.per_pass;
        options.per_pass.extend(per_pass);
        options.channels = if channels.is_empty() { of_scene.channels } else { channels };
        options.largest_albedo = largest_albedo.unwrap_or(of_scene.largest_albedo);
        options.loss = of_scene.loss;
        options.scintillation = scintillation.unwrap_or(of_scene.scintillation);
        if !(0.0..=10.0).contains(&options.scintillation) {
            return Err(
                format!("scintillation is {}, expected 0 to 10", options.scintillation).into()
            );
        }
        options.places = places.unwrap_or(of_scene.places);
        options.starts = starts.unwrap_or(of_scene.starts);
        options.iterations = iterations.unwrap_or(of_scene.iterations).min(10_000);
        options.seed = seed;
        for curve in &mut curves {
            let scene = &curve.scene;
            curve.station = station_for(scene.names_station(), &scene.path, station.as_deref())?;
        }
        let answer = fit(&curves, &options, watch)?;
        let product = sunglint_report::fit::product(&answer)?;
        let text = sunglint_report::fit::text(&answer);
        let scenes = answer
            .scenes
            .iter()
            .map(|scene| (format!("{}.fitted.toml", scene.name), scene.text.clone()))
            .collect();
        let outcome = Outcome::new(product, text, answer.warnings.clone()).with_files(scenes);
        Ok((outcome, answer.fit.converged))
    })
}

/// The period of curves, all channels and files together.
#[pyfunction]
#[pyo3(name = "period", signature = (curves, reading, channels=Vec::new(), shortest_s=None, longest_s=None, gap_s=None, harmonics=1, sessions=None, station=None, progress=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn period_of(
    py: Python<'_>,
    curves: Vec<PathBuf>,
    reading: Reading,
    channels: Vec<String>,
    shortest_s: Option<f64>,
    longest_s: Option<f64>,
    gap_s: Option<f64>,
    harmonics: usize,
    sessions: Option<String>,
    station: Option<String>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Outcome> {
    run(py, progress, move |watch: &Watch| {
        for (name, value) in
            [("shortest_s", shortest_s), ("longest_s", longest_s), ("gap_s", gap_s)]
        {
            if let Some(value) = value.filter(|v| !(v.is_finite() && *v > 0.0)) {
                return Err(format!("{name} is {value}, expected seconds above 0").into());
            }
        }
        if !(1..=8).contains(&harmonics) {
            return Err(format!("harmonics is {harmonics}, expected 1 to 8").into());
        }
        let mut all = Curves::read(&curves, &reading.options()?, &channels)?;
        let is_joined = match sessions.as_deref() {
            None | Some("auto") => gap_s.is_none() && all.are_sessions(),
            Some("joined") => true,
            Some("apart") => false,
            Some(other) => return Err(unknown("sessions", other, "auto, joined or apart")),
        };
        let station = station_or_usual(station.as_deref())?;
        if station.is_none() && all.has_rates() {
            all.warnings.push(
                "the air is not removed: no station says through which air and with which channels"
                    .into(),
            );
        }
        let air = match &station {
            Some(station) => {
                let known = station.air_options()?;
                let altitude_m = station.site.geodetic().height_m;
                Some(Air::new(&AirOptions { altitude_m, refraction: true, ..known })?)
            }
            None => None,
        };
        all.remove(&Trends {
            air: station.as_ref().zip(air.as_ref()),
            range: true,
            phase: !is_joined,
        });
        if is_joined {
            let options = sessions::Options::between(shortest_s, longest_s);
            let found = find_over_sessions(all, &options, watch)?;
            let product = period::sessions::product(&found);
            let text = period::sessions::text(&found);
            return Ok(Outcome::new(product, text, found.found.warnings.clone()));
        }
        let options = PeriodOptions { search: Search { shortest_s, longest_s }, gap_s, harmonics };
        let found = find_period::<Failure>(all, &options, None, watch)?;
        Ok(Outcome::new(period::product(&found), period::text(&found), found.warnings.clone()))
    })
}

/// Samples of a file of photometry, whatever program wrote it.
#[pyfunction]
fn read_photometry<'py>(
    py: Python<'py>,
    path: PathBuf,
    reading: Reading,
) -> PyResult<Bound<'py, PyDict>> {
    let own = path.clone();
    let (read, outcome) = run(py, None, move |_| {
        let bytes = sunglint_formats::read::bytes(&own)?;
        let read = photometry::import(&own, bytes, &reading.names()?, &reading.rows())?;
        let summary = import::Summary::new(&read);
        let stem = own.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let product = summary.product(&stem, &read)?;
        let text = summary.text(&own);
        Ok((read, Outcome::new(product, text, summary.warnings.clone())))
    })?;
    let out = PyDict::new(py);
    out.set_item("format", read.format)?;
    out.set_item("target", &read.samples.target)?;
    out.set_item("is_relative", read.samples.is_relative)?;
    out.set_item("notes", &read.samples.notes)?;
    out.set_item("outcome", Py::new(py, outcome)?)?;
    Ok(out)
}

/// Points and streaks of a frame.
#[pyfunction]
#[pyo3(signature = (pixels, fwhm_px=None, point_sigma=None, streak_sigma=None, shortest_px=None, aperture_px=None, saturation_adu=None, gain_e_per_adu=None, bayer=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn detect(
    py: Python<'_>,
    pixels: PyReadonlyArray2<'_, f32>,
    fwhm_px: Option<f64>,
    point_sigma: Option<f64>,
    streak_sigma: Option<f64>,
    shortest_px: Option<f64>,
    aperture_px: Option<f64>,
    saturation_adu: Option<f64>,
    gain_e_per_adu: Option<f64>,
    bayer: Option<String>,
) -> PyResult<String> {
    let mut options = FieldOptions::default();
    options.fwhm_px = fwhm_px;
    options.point_sigmas = point_sigma.unwrap_or(options.point_sigmas);
    options.streak_sigmas = streak_sigma.unwrap_or(options.streak_sigmas);
    options.shortest_px = shortest_px.unwrap_or(options.shortest_px);
    options.aperture_px = aperture_px;
    options.saturation_adu = saturation_adu;
    options.gain_e_per_adu = gain_e_per_adu;
    // The array is the caller's, and its pages may change under another thread: one copy.
    let own = pixels.as_array().to_owned();
    run(py, None, move |_| {
        if let Some(name) = &bayer {
            let pattern = sunglint_formats::Bayer::from_name(name);
            let none = || unknown("bayer", name, "RGGB, GRBG, GBRG or BGGR");
            options.bayer = Some(pattern.ok_or_else(none)?);
        }
        Ok(serde_json::to_string(&find(own.view(), &options)?)?)
    })
}

/// Gain, e⁻/ADU, for a frame whose gain is not known: with so many electrons an ADU, light has no noise of its own, and its distribution does not lean.
const NO_PHOTON_NOISE: f64 = 1e9;

/// Light within apertures at places of a frame that are given: columns of numbers, one for each place.
#[pyfunction]
#[pyo3(signature = (pixels, places_px, radius_px=8.0, annulus_px=[12.0, 20.0], fwhm_px=4.0, exposure_s=1.0, gain_e_per_adu=None, read_noise_e=0.0, saturation_adu=None, masked=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn aperture<'py>(
    py: Python<'py>,
    pixels: PyReadonlyArray2<'py, u16>,
    places_px: PyReadonlyArray2<'py, f64>,
    radius_px: f64,
    annulus_px: [f64; 2],
    fwhm_px: f64,
    exposure_s: f64,
    gain_e_per_adu: Option<f64>,
    read_noise_e: f64,
    saturation_adu: Option<f64>,
    masked: Option<PyReadonlyArray2<'py, bool>>,
) -> PyResult<Bound<'py, PyDict>> {
    let places = places_px.as_array();
    if places.ncols() != 2 {
        let text = format!("places_px has the shape {:?}, expected (n, 2)", places.shape());
        return Err(Error::new_err(text));
    }
    let places: Vec<[f64; 2]> = places.rows().into_iter().map(|row| [row[0], row[1]]).collect();
    // The array is the caller's, and its pages may change under another thread: one copy.
    let pixels = pixels.as_array().to_owned();
    let bad = masked.map(|masked| BadPixels {
        faults: masked
            .as_array()
            .mapv(|is_masked| if is_masked { PixelFault::DEAD } else { PixelFault::empty() }),
        origin: [0, 0],
        binning: [1, 1],
        median_adu: 0.0,
        sigma_adu: 0.0,
    });
    let found = run(py, None, move |watch| {
        crate::sky::within("exposure_s", exposure_s, 1e-9, 86_400.0)?;
        if let Some(gain) = gain_e_per_adu {
            crate::sky::within("gain_e_per_adu", gain, 1e-9, 1e9)?;
        }
        let side = |axis| u32::try_from(pixels.len_of(ndarray::Axis(axis)));
        let mut options = PhotometryOptions::new([side(1)?, side(0)?], read_noise_e);
        options.aperture_radius_px = radius_px;
        options.annulus_px = annulus_px.into();
        options.fwhm_px = fwhm_px;
        let frame = Frame {
            pixels,
            origin: [0, 0],
            binning: [1, 1],
            bayer: None,
            start: hifitime::Epoch::from_gregorian_utc_at_midnight(2000, 1, 1),
            exposure_s,
            gain_e_per_adu: Some(gain_e_per_adu.unwrap_or(NO_PHOTON_NOISE)),
            temperature_c: None,
            saturation_adu,
            header: Header::default(),
        };
        let calibration = FrameCalibration { bad, ..FrameCalibration::default() };
        let mut reducer = FrameReducer::new(options, calibration)?;
        let mut rows = Vec::with_capacity(places.len());
        for (i, place) in places.iter().enumerate() {
            watch.at("apertures", i, places.len());
            if !place.iter().all(|p| p.is_finite()) {
                return Err(format!("place {i} is {place:?}, expected a column and a row").into());
            }
            let measured = reducer.measure_at(&frame, *place, &Expected::default())?;
            rows.push(*measured.planes.first().ok_or("a frame without planes")?);
        }
        Ok(rows)
    })?;
    let out = PyDict::new(py);
    let column = |of: fn(&PlaneMeasurement) -> f64| {
        PyArray1::from_vec(py, found.iter().map(of).collect::<Vec<f64>>())
    };
    out.set_item("rate_adu_per_s", column(|m| m.rate_adu_per_s))?;
    out.set_item("sigma_adu_per_s", column(|m| m.sigma.total()))?;
    out.set_item("background_adu", column(|m| m.background_adu))?;
    out.set_item("background_sigma_adu", column(|m| m.background_sigma_adu))?;
    out.set_item("area_px2", column(|m| m.area_px2))?;
    out.set_item("masked_fraction", column(|m| m.masked_fraction))?;
    let whole = |of: fn(&PlaneMeasurement) -> i64| {
        PyArray1::from_vec(py, found.iter().map(of).collect::<Vec<i64>>())
    };
    out.set_item(
        "saturated_pixels",
        whole(|m| i64::try_from(m.saturated_pixels).unwrap_or(i64::MAX)),
    )?;
    out.set_item("flags", whole(|m| i64::from(m.flags.bits())))?;
    Ok(out)
}

/// Frames of any program, reduced to a light curve.
#[pyfunction]
#[pyo3(signature = (files, place_px=None, along=1, darks=Vec::new(), flats=Vec::new(), fwhm_px=None, aperture_px=None, streak_sigma=None, catalogue=None, catalogue_mag=None, catalogue_colour=None, catalogue_system=None, near_deg=None, scale_arcsec=None, target_colour=None, colour_term=None, name=None, progress=None, gain_e_per_adu=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn reduce(
    py: Python<'_>,
    files: Vec<PathBuf>,
    place_px: Option<[f64; 2]>,
    along: usize,
    darks: Vec<PathBuf>,
    flats: Vec<PathBuf>,
    fwhm_px: Option<f64>,
    aperture_px: Option<f64>,
    streak_sigma: Option<f64>,
    catalogue: Option<PathBuf>,
    catalogue_mag: Option<String>,
    catalogue_colour: Option<[String; 2]>,
    catalogue_system: Option<String>,
    near_deg: Option<[f64; 2]>,
    scale_arcsec: Option<f64>,
    target_colour: Option<[f64; 2]>,
    colour_term: Option<f64>,
    name: Option<String>,
    progress: Option<Py<PyAny>>,
    gain_e_per_adu: Option<f64>,
) -> PyResult<Outcome> {
    run(py, progress, move |watch: &Watch| {
        let mut options = FolderOptions::default();
        options.field.gain_e_per_adu = gain_e_per_adu
            .map(|gain| crate::sky::within("gain_e_per_adu", gain, 1e-6, 1e6))
            .transpose()?;
        options.field.fwhm_px = fwhm_px;
        options.field.aperture_px = aperture_px;
        options.field.streak_sigmas = streak_sigma.unwrap_or(options.field.streak_sigmas);
        options.place_px = place_px.map(Into::into);
        options.parts = along;
        options.darks = darks;
        options.flats = flats;
        if let Some(path) = catalogue {
            let mut stars = StarsOptions::default();
            stars.list.path = path;
            stars.list.magnitude = catalogue_mag;
            stars.list.colour = catalogue_colour;
            stars.list.system = match catalogue_system.as_deref() {
                None => None,
                Some("Vega" | "vega") => Some(System::Vega),
                Some("AB" | "ab") => Some(System::AB),
                Some(other) => return Err(unknown("catalogue_system", other, "Vega or AB")),
            };
            stars.near_deg = near_deg.map(Into::into);
            stars.scale_arcsec = scale_arcsec;
            stars.target_colour = target_colour.map(Into::into);
            stars.colour_term = colour_term;
            options.stars = Some(stars);
        }
        let reduced = reduce_frames(&files, &options, watch)?;
        let name = name.unwrap_or_else(|| "frames".into());
        let product = folder::whole(&reduced, &name)?;
        let mut warnings = watch.warnings();
        warnings.extend(reduced.unreadable());
        Ok(Outcome::new(product, folder::text(&reduced, &name), warnings))
    })
}

/// A table file (ECSV, CSV) as columns.
#[pyfunction]
fn read_table<'py>(py: Python<'py>, path: PathBuf) -> PyResult<Bound<'py, PyAny>> {
    let table = sunglint_formats::ecsv::read(&path).map_err(|e| exception(py, &e))?;
    let meta = serde_json::to_string(&table.meta).map_err(|e| Error::new_err(e.to_string()))?;
    Ok((columns(py, &table)?, meta).into_pyobject(py)?.into_any())
}

/// Measures nothing but the time that a call costs; for tests of overhead.
#[pyfunction]
fn _nothing(py: Python<'_>) -> PyResult<f64> {
    let start = Instant::now();
    run(py, None, |_| Ok(()))?;
    Ok(start.elapsed().as_secs_f64())
}

/// Adds the functions to the module.
pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(simulate, module)?)?;
    module.add_function(wrap_pyfunction!(needs, module)?)?;
    module.add_function(wrap_pyfunction!(run_study, module)?)?;
    module.add_function(wrap_pyfunction!(missing_shards, module)?)?;
    module.add_function(wrap_pyfunction!(usual_station, module)?)?;
    module.add_function(wrap_pyfunction!(built_in_stations, module)?)?;
    module.add_function(wrap_pyfunction!(compare_pass, module)?)?;
    module.add_function(wrap_pyfunction!(fit_passes, module)?)?;
    module.add_function(wrap_pyfunction!(period_of, module)?)?;
    module.add_function(wrap_pyfunction!(read_photometry, module)?)?;
    module.add_function(wrap_pyfunction!(detect, module)?)?;
    module.add_function(wrap_pyfunction!(aperture, module)?)?;
    module.add_function(wrap_pyfunction!(reduce, module)?)?;
    module.add_function(wrap_pyfunction!(read_table, module)?)?;
    module.add_function(wrap_pyfunction!(_nothing, module)?)?;
    Ok(())
}
