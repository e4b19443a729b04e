//! Light of bodies and BRDFs on arrays of directions.

use crate::watch::{Error, Failure, refuse_fork, run};
use glam::DVec3;
use ndarray::{ArrayView1, ArrayView2, s};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, ToPyArray};
use pyo3::exceptions::PyMemoryError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use rayon::prelude::*;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};
use sunglint_formats::nearest_names;
use sunglint_materials::look;
use sunglint_report::Format;
use sunglint_report::picture::PictureReport;
use sunglint_simulator::intensity::{
    Aspect, Intensities, IntensityError, IntensityOptions, IntensityPool, IntensityWorker, Span,
};
use sunglint_simulator::pass::PassFile;
use sunglint_simulator::picture::{Aim, Blur, ModelView, Shot, ShotOptions, What};
use sunglint_simulator::surface::Material;
use sunglint_simulator::target::Target;

/// Geometries that are evaluated between two looks for Ctrl-C.
const TOGETHER: usize = 256;

/// Most geometries between two looks.
const MOST_TOGETHER: usize = 1 << 17;
/// Parts that take less are made larger,
const SHORT: Duration = Duration::from_millis(30);
/// and those that take more smaller.
const LONG: Duration = Duration::from_millis(120);

/// A body whose light is asked for: a built-in target or one of a file.
#[pyclass(frozen, module = "sunglint._core")]
pub struct Body {
    target: Arc<Target>,
}

/// A built-in target, or one of a file.
pub fn target(model: &str) -> Result<Target, Failure> {
    if let Some(target) = Target::built_in(model) {
        return Ok(target);
    }
    if Path::new(model).exists() {
        return Ok(Target::read(Path::new(model))?);
    }
    let names = Target::built_in_names();
    let near = nearest_names(model, names.iter().copied(), 1);
    let hint = near.first().map_or(String::new(), |near| format!("; did you mean {near}?"));
    Err(format!(
        "there is no target `{model}`: it is neither a built-in name ({}) nor a file{hint}",
        names.join(", ")
    )
    .into())
}

/// Refuses no wavelengths at all.
fn some_wavelengths(nm: &[f64]) -> PyResult<()> {
    match nm.is_empty() {
        true => Err(Error::new_err("wavelength_nm is empty, expected one wavelength or more")),
        false => Ok(()),
    }
}

/// Makes rows of equal values, `each` of them for each of n geometries. A broadcast array has any number of rows in a few bytes, so that there may be no memory
/// for as many results.
///
/// # Errors
/// `MemoryError`.
fn rows_of<T: Clone>(value: T, n: usize, each: usize) -> PyResult<Vec<T>> {
    let count = n.checked_mul(each);
    match count.map(|count| (Vec::<T>::new().try_reserve_exact(count), count)) {
        // Zeros that the system has ready are made when they are first written: to fill gigabytes here would take seconds in which nobody hears Ctrl-C.
        Some((Ok(()), count)) => Ok(vec![value; count]),
        _ => Err(PyMemoryError::new_err(format!(
            "no memory for the results of {n} geometries, {each} numbers each: ask in parts"
        ))),
    }
}

fn directions(of: &PyReadonlyArray2<'_, f64>, name: &str) -> PyResult<Vec<DVec3>> {
    let array = of.as_array();
    if array.ncols() != 3 {
        let text = format!("{name} has the shape {:?}, expected (n, 3)", array.shape());
        return Err(Error::new_err(text));
    }
    let mut all = rows_of(DVec3::ZERO, array.nrows(), 1)?;
    for (own, row) in all.iter_mut().zip(array.rows()) {
        *own = DVec3::new(row[0], row[1], row[2]);
    }
    Ok(all)
}

#[pymethods]
impl Body {
    #[new]
    fn new(py: Python<'_>, model: String) -> PyResult<Self> {
        let target = run(py, None, move |_| target(&model))?;
        Ok(Self { target: Arc::new(target) })
    }

    /// The body of a scene's file.
    #[staticmethod]
    fn of_scene(py: Python<'_>, scene: PathBuf) -> PyResult<Self> {
        let target = run(py, None, move |_| Ok(PassFile::read(&scene)?.target()?))?;
        Ok(Self { target: Arc::new(target) })
    }

    /// A picture of the body in its true colours under the Sun, as PNG.
    #[pyo3(signature = (size_px=320))]
    fn picture<'py>(&self, py: Python<'py>, size_px: usize) -> PyResult<Bound<'py, PyBytes>> {
        let target = Target::clone(&self.target);
        let bytes = run(py, None, move |_| {
            let aim = Aim::of_model(target, ModelView::default())?;
            let options = ShotOptions {
                what: vec![What::Rgb],
                wavelength_nm: vec![550.0],
                per_irradiance: false,
                size_px: Some(size_px),
                pixel_m: None,
                blur: Blur::None,
            };
            let shot = Shot::take(&aim, &options)?;
            Ok(PictureReport { shot: &shot }.product()?.encode(Format::Png)?)
        })?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// The light at one wavelength by the material that sent it: (n, m + 1) values and errors, the last for light that went by several; and warnings.
    #[pyo3(signature = (sun, observer, wavelength_nm, range_m=None, tolerance=None, budget_s=None, progress=None))]
    #[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
    fn light_by_material<'py>(
        &self,
        py: Python<'py>,
        sun: PyReadonlyArray2<'py, f64>,
        observer: PyReadonlyArray2<'py, f64>,
        wavelength_nm: f64,
        range_m: Option<PyReadonlyArray1<'py, f64>>,
        tolerance: Option<f64>,
        budget_s: Option<f64>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<LightErrorAndWarnings<'py>> {
        let (sun, observer) = (directions(&sun, "sun")?, directions(&observer, "observer")?);
        let n = sun.len();
        if n != observer.len() {
            let text = format!("sun has {n} rows and observer {}", observer.len());
            return Err(Error::new_err(text));
        }
        let range = range_m.as_ref().map(|r| r.as_array());
        if let Some(range) = range.as_ref().filter(|r| r.len() != n) {
            let text = format!("range_m has {} values, expected {n}", range.len());
            return Err(Error::new_err(text));
        }
        let aspect_of = |row: usize| {
            let mut aspect = Aspect::new(sun[row], observer[row]);
            aspect.range_m = range.as_ref().map(|r| r[row]).filter(|r| r.is_finite());
            aspect
        };
        let mut options = IntensityOptions::default();
        options.tolerance = tolerance.unwrap_or(options.tolerance);
        options.budget_s = budget_s.unwrap_or(options.budget_s);
        options.wavelength_nm = vec![wavelength_nm];
        let each = self.target.materials.len() + 1;
        let (light, error) = (rows_of(0.0, n, each)?, rows_of(0.0, n, each)?);
        let (light, error, warnings) = run(py, progress, move |watch| {
            let (mut light, mut error) = (light, error);
            let span = span_of(n, &aspect_of)?;
            if n == 0 {
                return Ok((light, error, Vec::new()));
            }
            let pool = IntensityPool::new(Intensities::new(&self.target, options, &span)?);
            for first in (0..n).step_by(TOGETHER) {
                watch.at("light", first, n);
                let own = first..(first + TOGETHER).min(n);
                let cells = own.start * each..own.end * each;
                let rows = light[cells.clone()].par_chunks_exact_mut(each);
                let rows = rows.zip(error[cells].par_chunks_exact_mut(each));
                own.into_par_iter().zip(rows).try_for_each_init(
                    || pool.worker(),
                    |worker, (row, (light, error))| {
                        let aspect = aspect_of(row);
                        worker
                            .with(|worker| worker.light_by_material(&aspect, 0, light, error))
                            .map(drop)
                    },
                )?;
            }
            Ok((light, error, pool.all().warnings().to_vec()))
        })?;
        let shaped = |values: Vec<f64>| PyArray1::from_vec(py, values).reshape([n, each]);
        Ok((shaped(light)?, shaped(error)?, warnings))
    }

    /// Name of the body.
    #[getter]
    fn name(&self) -> &str {
        &self.target.name
    }

    /// Names of its materials.
    #[getter]
    fn materials(&self) -> Vec<String> {
        self.target.materials.iter().map(|m| m.name.clone()).collect()
    }

    /// Warnings of its file.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.target.warnings.clone()
    }

    /// The light engine for wavelengths, made once for many calls.
    #[pyo3(signature = (wavelength_nm, range_m=None, sun_distance_au=None, tolerance=None, budget_s=None))]
    fn engine(
        &self,
        py: Python<'_>,
        wavelength_nm: Vec<f64>,
        range_m: Option<f64>,
        sun_distance_au: Option<f64>,
        tolerance: Option<f64>,
        budget_s: Option<f64>,
    ) -> PyResult<LightEngine> {
        some_wavelengths(&wavelength_nm)?;
        let target = self.target.clone();
        let mut options = IntensityOptions::default();
        options.tolerance = tolerance.unwrap_or(options.tolerance);
        options.budget_s = budget_s.unwrap_or(options.budget_s);
        options.wavelength_nm = wavelength_nm;
        run(py, None, move |_| {
            // Any phase angle may come: the one that asks for most is the largest.
            let mut farthest = Aspect::new(DVec3::X, -DVec3::X);
            farthest.range_m = range_m;
            farthest.sun_distance_au = sun_distance_au.unwrap_or(farthest.sun_distance_au);
            let mut span = Span::default();
            span.add(&farthest)?;
            let pool = IntensityPool::new(Intensities::new(&target, options, &span)?);
            Ok(LightEngine {
                pool,
                nearest_m: range_m,
                sun_distance_au: farthest.sun_distance_au,
                cost_ns: AtomicU64::new(0),
            })
        })
    }

    /// Seconds that the library alone takes for [`Body::light`] of a far observer at 550 nm; for `python/overhead`.
    fn _alone(
        &self,
        py: Python<'_>,
        sun: PyReadonlyArray2<'_, f64>,
        observer: PyReadonlyArray2<'_, f64>,
        tolerance: f64,
    ) -> PyResult<f64> {
        let (sun, observer) = (sun.as_array(), observer.as_array());
        let aspect_of = |row: usize| {
            let vector =
                |of: &ArrayView2<'_, f64>| DVec3::new(of[[row, 0]], of[[row, 1]], of[[row, 2]]);
            Aspect::new(vector(&sun), vector(&observer))
        };
        let mut options = IntensityOptions::default();
        options.tolerance = tolerance;
        refuse_fork()?;
        py.detach(|| {
            let begun = Instant::now();
            let columns = Columns::new(sun.nrows(), options.wavelength_nm.len())?;
            all_light(&self.target, options, columns, &aspect_of, &|_| {})
                .map_err(|e| Error::new_err(e.to_string()))?;
            Ok(begun.elapsed().as_secs_f64())
        })
    }

    /// The light for (n, 3) unit vectors to Sun and observer in body axes.
    #[pyo3(signature = (sun, observer, wavelength_nm, range_m=None, sun_distance_au=None, tolerance=None, budget_s=None, progress=None))]
    #[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
    fn light<'py>(
        &self,
        py: Python<'py>,
        sun: PyReadonlyArray2<'py, f64>,
        observer: PyReadonlyArray2<'py, f64>,
        wavelength_nm: Vec<f64>,
        range_m: Option<PyReadonlyArray1<'py, f64>>,
        sun_distance_au: Option<f64>,
        tolerance: Option<f64>,
        budget_s: Option<f64>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        some_wavelengths(&wavelength_nm)?;
        // The caller's arrays are read where they are: millions of rows are not copied.
        let (sun, observer) = (sun.as_array(), observer.as_array());
        for (name, array) in [("sun", &sun), ("observer", &observer)] {
            if array.ncols() != 3 {
                let text = format!("{name} has the shape {:?}, expected (n, 3)", array.shape());
                return Err(Error::new_err(text));
            }
        }
        let n = sun.nrows();
        if n != observer.nrows() {
            let text = format!("sun has {n} rows and observer {}", observer.nrows());
            return Err(Error::new_err(text));
        }
        let range = range_m.as_ref().map(|r| r.as_array());
        if let Some(range) = range.as_ref().filter(|r| r.len() != n) {
            let text = format!("range_m has {} values, expected {n}", range.len());
            return Err(Error::new_err(text));
        }
        let aspect_of = |row: usize| {
            let vector =
                |of: &ArrayView2<'_, f64>| DVec3::new(of[[row, 0]], of[[row, 1]], of[[row, 2]]);
            let mut aspect = Aspect::new(vector(&sun), vector(&observer));
            aspect.range_m = range.as_ref().map(|r| r[row]).filter(|r| r.is_finite());
            aspect.sun_distance_au = sun_distance_au.unwrap_or(aspect.sun_distance_au);
            aspect
        };
        let mut options = IntensityOptions::default();
        options.tolerance = tolerance.unwrap_or(options.tolerance);
        options.budget_s = budget_s.unwrap_or(options.budget_s);
        options.wavelength_nm = wavelength_nm;
        let wavelengths = options.wavelength_nm.len();
        let columns = Columns::new(n, wavelengths)?;
        let (columns, warnings) = run(py, progress, |watch| {
            let at = |done| watch.at("light", done, n);
            all_light(&self.target, options, columns, &aspect_of, &at)
        })?;
        let out = PyDict::new(py);
        let shaped = |values: Vec<f64>| -> PyResult<Bound<'py, PyArray2<f64>>> {
            PyArray1::from_vec(py, values).reshape([n, wavelengths])
        };
        out.set_item("per_irradiance_m2_per_sr", shaped(columns.per_irradiance)?)?;
        out.set_item("error_m2_per_sr", shaped(columns.error)?)?;
        out.set_item("intensity_w_per_sr_nm", shaped(columns.intensity)?)?;
        out.set_item("phase_deg", PyArray1::from_vec(py, columns.phase_deg))?;
        out.set_item("met", PyArray1::from_vec(py, columns.met))?;
        out.set_item("warnings", warnings)?;
        Ok(out)
    }
}

/// Most wavelengths of one geometry that are kept on the stack, and the first part of many geometries.
const FEW: usize = 64;
/// Time for which a call of an engine keeps the interpreter's lock: for less it would cost more to give it up, ns.
const HELD_NS: u64 = 200_000;
/// Time that a part of an engine's call should take at most, as Ctrl-C is heard between two, ns.
const PART_NS: u64 = 50_000_000;

/// A light engine that is kept between calls, and runs in the thread that calls.
#[pyclass(frozen, module = "sunglint._core")]
pub struct LightEngine {
    pool: IntensityPool,
    nearest_m: Option<f64>,
    sun_distance_au: f64,
    /// Time of one of the last geometries, ns; 0 before the first: `box_wing` takes microseconds, light that is scattered twice milliseconds.
    cost_ns: AtomicU64,
}

impl LightEngine {
    /// Keeps what a part of `n` geometries took; says what one takes, ns.
    fn learn(&self, begun: Instant, n: usize) -> u64 {
        let took = u64::try_from(begun.elapsed().as_nanos()).unwrap_or(u64::MAX);
        let cost = (took / n.max(1) as u64).max(1);
        self.cost_ns.store(cost, Ordering::Relaxed);
        cost
    }

    fn fill(
        &self,
        worker: &mut IntensityWorker<'_>,
        (first, sun, observer, range): (
            usize,
            ArrayView2<'_, f64>,
            ArrayView2<'_, f64>,
            Option<ArrayView1<'_, f64>>,
        ),
        (light, error): (&mut [f64], &mut [f64]),
    ) -> Result<(), String> {
        let wavelengths = self.pool.all().options().wavelength_nm.len().max(1);
        let vector = |of: ndarray::ArrayView1<'_, f64>| DVec3::new(of[0], of[1], of[2]);
        let rows = sun.rows().into_iter().zip(observer.rows());
        let out = light.chunks_exact_mut(wavelengths).zip(error.chunks_exact_mut(wavelengths));
        for (row, ((sun, observer), (light, error))) in rows.zip(out).enumerate() {
            let at = |e: String| format!("row {}: {e}", first + row);
            let mut aspect = Aspect::new(vector(sun), vector(observer));
            aspect.sun_distance_au = self.sun_distance_au;
            if let Some(range) = &range {
                let m = range[row];
                match self.nearest_m {
                    None => return Err("the engine was made without range_m".into()),
                    Some(nearest) if m < nearest => {
                        return Err(at(format!(
                            "range_m is {m}, nearer than the engine's {nearest}"
                        )));
                    }
                    Some(_) => aspect.range_m = Some(m),
                }
            }
            worker.light_into(&aspect, light, error).map_err(|e| at(e.to_string()))?;
        }
        Ok(())
    }
}

/// Light and stated error, (n, m + 1) each, and warnings.
type LightErrorAndWarnings<'py> =
    (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>, Vec<String>);
/// Light and stated error, (n, w) each.
type LightAndError<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<f64>>);

#[pymethods]
impl LightEngine {
    /// Light and stated error, m² sr⁻¹, for (n, 3) unit vectors to Sun and observer in body axes.
    #[pyo3(signature = (sun, observer, range_m=None))]
    fn light<'py>(
        &self,
        py: Python<'py>,
        sun: PyReadonlyArray2<'py, f64>,
        observer: PyReadonlyArray2<'py, f64>,
        range_m: Option<PyReadonlyArray1<'py, f64>>,
    ) -> PyResult<LightAndError<'py>> {
        let (sun, observer) = (sun.as_array(), observer.as_array());
        let n = sun.nrows();
        for (name, array) in [("sun", &sun), ("observer", &observer)] {
            if array.ncols() != 3 || array.nrows() != n {
                let text = format!("{name} has the shape {:?}, expected ({n}, 3)", array.shape());
                return Err(Error::new_err(text));
            }
        }
        let range = range_m.as_ref().map(|r| r.as_array());
        if let Some(range) = range.as_ref().filter(|r| r.len() != n) {
            let text = format!("range_m has {} values, expected {n}", range.len());
            return Err(Error::new_err(text));
        }
        let wavelengths = self.pool.all().options().wavelength_nm.len();
        let mut worker = self.pool.worker();
        // One geometry tells of an engine of which nothing is known.
        let mut cost = self.cost_ns.load(Ordering::Relaxed);
        if n == 1 && wavelengths <= FEW && cost <= HELD_NS {
            // One geometry: numbers on the stack.
            let (mut light, mut error) = ([0.0; FEW], [0.0; FEW]);
            let out = (&mut light[..wavelengths], &mut error[..wavelengths]);
            let begun = Instant::now();
            worker
                .with(|worker| self.fill(worker, (0, sun, observer, range), out))
                .map_err(Error::new_err)?;
            self.learn(begun, 1);
            let shaped = |of: &[f64; FEW]| {
                ArrayView2::from_shape((1, wavelengths), &of[..wavelengths])
                    .map(|view| view.to_pyarray(py))
                    .map_err(|e| Error::new_err(e.to_string()))
            };
            return Ok((shaped(&light)?, shaped(&error)?));
        }
        let mut light = rows_of(0.0, n, wavelengths)?;
        let mut error = rows_of(0.0, n, wavelengths)?;
        let mut first = 0;
        while first < n {
            let together = match PART_NS.checked_div(cost) {
                Some(few) => usize::try_from(few).unwrap_or(TOGETHER).clamp(1, TOGETHER),
                None => 1,
            };
            let next = (first + together).min(n);
            let part = (
                first,
                sun.slice(s![first..next, ..]),
                observer.slice(s![first..next, ..]),
                range.as_ref().map(|r| r.slice(s![first..next])),
            );
            let own = first * wavelengths..next * wavelengths;
            let out = (&mut light[own.clone()], &mut error[own]);
            let fill = || worker.with(|worker| self.fill(worker, part, out));
            let is_held = cost.saturating_mul((n - first) as u64) <= HELD_NS;
            let begun = Instant::now();
            let done = if is_held { fill() } else { py.detach(fill) };
            done.map_err(Error::new_err)?;
            cost = self.learn(begun, next - first);
            first = next;
            if first < n {
                py.check_signals()?;
            }
        }
        let shaped = |values: Vec<f64>| PyArray1::from_vec(py, values).reshape([n, wavelengths]);
        Ok((shaped(light)?, shaped(error)?))
    }

    /// Seconds that the library alone takes for the same geometries by one thread, into rows that are there; for `python/overhead`.
    fn _alone(
        &self,
        py: Python<'_>,
        sun: PyReadonlyArray2<'_, f64>,
        observer: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<f64> {
        let (sun, observer) = (sun.as_array(), observer.as_array());
        let wavelengths = self.pool.all().options().wavelength_nm.len();
        let mut columns = Columns::new(sun.nrows(), wavelengths)?;
        py.detach(|| {
            let begun = Instant::now();
            let out = (&mut columns.per_irradiance[..], &mut columns.error[..]);
            let mut worker = self.pool.worker();
            worker
                .with(|worker| self.fill(worker, (0, sun, observer, None), out))
                .map_err(Error::new_err)?;
            Ok(begun.elapsed().as_secs_f64())
        })
    }

    /// Warnings of the body for this engine.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.pool.all().warnings().to_vec()
    }
}

/// Columns of the light: a number for each geometry, or for each geometry and wavelength.
struct Columns {
    wavelengths: usize,
    per_irradiance: Vec<f64>,
    error: Vec<f64>,
    intensity: Vec<f64>,
    phase_deg: Vec<f64>,
    met: Vec<bool>,
}

impl Columns {
    fn new(n: usize, wavelengths: usize) -> PyResult<Self> {
        Ok(Self {
            wavelengths,
            per_irradiance: rows_of(0.0, n, wavelengths)?,
            error: rows_of(0.0, n, wavelengths)?,
            intensity: rows_of(0.0, n, wavelengths)?,
            phase_deg: rows_of(0.0, n, 1)?,
            met: rows_of(false, n, 1)?,
        })
    }

    /// Fills the rows of some geometries, by all threads.
    fn fill(
        &mut self,
        pool: &IntensityPool,
        rows: Range<usize>,
        aspect_of: &(impl Fn(usize) -> Aspect + Sync),
    ) -> Result<(), IntensityError> {
        let w = self.wavelengths;
        let cells = rows.start * w..rows.end * w;
        let out = (
            self.per_irradiance[cells.clone()].par_chunks_exact_mut(w),
            self.error[cells.clone()].par_chunks_exact_mut(w),
            self.intensity[cells].par_chunks_exact_mut(w),
            &mut self.phase_deg[rows.clone()],
            &mut self.met[rows.clone()],
        );
        (rows, out.0, out.1, out.2, out.3, out.4).into_par_iter().try_for_each_init(
            || pool.worker(),
            |worker, (row, light, error, intensity, phase_deg, met)| {
                let aspect = aspect_of(row);
                let lit = worker.with(|worker| worker.light_into(&aspect, light, error))?;
                (*phase_deg, *met) = (lit.phase_deg, lit.met);
                for (s, (intensity, light)) in intensity.iter_mut().zip(&*light).enumerate() {
                    *intensity = pool.all().intensity(s, &aspect, *light);
                }
                Ok(())
            },
        )
    }
}

/// The light of geometries by all threads, in columns that are there for it, with the warnings of the body; `at` hears how many are done.
fn all_light(
    target: &Target,
    options: IntensityOptions,
    mut columns: Columns,
    aspect_of: &(impl Fn(usize) -> Aspect + Sync),
    at: &dyn Fn(usize),
) -> Result<(Columns, Vec<String>), Failure> {
    let n = columns.phase_deg.len();
    let span = span_of(n, aspect_of)?;
    if n == 0 {
        return Ok((columns, Vec::new()));
    }
    let pool = IntensityPool::new(Intensities::new(target, options, &span)?);
    let (mut done, mut together) = (0, FEW);
    while done < n {
        at(done);
        let next = (done + together).min(n);
        let begun = Instant::now();
        columns.fill(&pool, done..next, aspect_of)?;
        done = next;
        // A geometry costs microseconds or milliseconds: parts that take long enough for all threads, and end soon at Ctrl-C.
        let took = begun.elapsed();
        if took < SHORT {
            together = (together * 4).min(MOST_TOGETHER);
        } else if took > LONG {
            together = (together / 2).max(8);
        }
    }
    Ok((columns, pool.all().warnings().to_vec()))
}

/// Returns the span of the geometries; an error names the first row that is none.
fn span_of(n: usize, aspect_of: &(impl Fn(usize) -> Aspect + Sync)) -> Result<Span, Failure> {
    let of_part = |part: usize| -> Result<Span, String> {
        let mut span = Span::default();
        for row in part * TOGETHER..((part + 1) * TOGETHER).min(n) {
            span.add(&aspect_of(row)).map_err(|e| format!("row {row}: {e}"))?;
        }
        Ok(span)
    };
    // In the order of the parts, so that the first error is the one that is told.
    let parts: Vec<Result<Span, String>> =
        (0..n.div_ceil(TOGETHER)).into_par_iter().map(of_part).collect();
    let mut span = Span::default();
    for part in parts {
        span.join(&part?);
    }
    Ok(span)
}

/// A material whose BRDF is asked for, as `sunglint brdf show` takes it.
#[pyclass(frozen, module = "sunglint._core")]
pub struct Brdf {
    material: Arc<Material>,
    name: String,
}

#[pymethods]
impl Brdf {
    #[new]
    #[pyo3(signature = (name, wavelength_nm=550.0))]
    fn new(py: Python<'_>, name: String, wavelength_nm: f64) -> PyResult<Self> {
        let own = name.clone();
        let material = run(py, None, move |_| Ok(look::read(&own, wavelength_nm)?))?;
        if material.is_mirror() {
            return Err(Error::new_err(format!("{name} is a mirror: it has no BRDF")));
        }
        Ok(Self { material: Arc::new(material), name })
    }

    /// The file, and the material in it.
    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    /// The BRDF, 1/sr, for (n, 3) unit vectors to light and observer; z is the normal, x the tangent.
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        wavelength_nm: f64,
        light: PyReadonlyArray2<'py, f64>,
        observer: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let (light, observer) = (directions(&light, "light")?, directions(&observer, "observer")?);
        if light.len() != observer.len() {
            let text = format!("light has {} rows and observer {}", light.len(), observer.len());
            return Err(Error::new_err(text));
        }
        let material = self.material.clone();
        let mut values = rows_of(0.0, light.len(), 1)?;
        let values = run(py, None, move |watch| {
            for (row, (i, o)) in light.iter().zip(&observer).enumerate() {
                if row % TOGETHER == 0 {
                    watch.at("brdf", row, light.len());
                }
                let is_unit = |v: &DVec3| (v.length() - 1.0).abs() < 1e-6;
                if !is_unit(i) || !is_unit(o) {
                    return Err(format!("row {row}: {i}, {o}: expected unit vectors").into());
                }
                if i.z > 0.0 && o.z > 0.0 {
                    values[row] = material.brdf(wavelength_nm, *i, *o);
                }
            }
            Ok(values)
        })?;
        Ok(PyArray1::from_vec(py, values))
    }

    /// Hemispherical reflectance for light at an angle of incidence, deg, along the tangent.
    #[pyo3(signature = (wavelength_nm, theta_i_deg=0.0))]
    fn albedo(&self, py: Python<'_>, wavelength_nm: f64, theta_i_deg: f64) -> PyResult<f64> {
        let material = self.material.clone();
        let (sin, cos) = theta_i_deg.to_radians().sin_cos();
        run(py, None, move |_| Ok(material.albedo(wavelength_nm, DVec3::new(sin, 0.0, cos))?))
    }
}
