//! The sky: stars, the air, passes of satellites.

use crate::body::target;
use crate::product::Outcome;
use crate::watch::{Failure, Watch, run};
use crate::workflows::{moment, needed, station};
use hifitime::{Epoch, Unit};
use pyo3::prelude::*;
use std::path::{Path, PathBuf};
use sunglint_ephemeris::orbit::{Orbit, TleOrbit, tle};
use sunglint_ephemeris::passes::brightness::Brightness;
use sunglint_ephemeris::passes::{Conditions, Search};
use sunglint_radiometry::air::survey::{AirGrid, AirQuestion};
use sunglint_radiometry::air::{Aerosol, AerosolModel, Air, AirOptions, Profile};
use sunglint_radiometry::light_curve::Input;
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::sky::{Catalogue, EarthOrientation, Equatorial, SkyFrames, Star};
use sunglint_radiometry::star_light::{self, StarColours, VEGA_HIP};
use sunglint_radiometry::star_track::{StarTrack, StarView};
use sunglint_radiometry::station::Station;
use sunglint_report::air::AirReport;
use sunglint_report::passes::PassesReport;
use sunglint_report::star::StarReport;
use sunglint_simulator::attitude::Attitude;
use sunglint_simulator::sightings::{
    Model, Photometer, SightingFilter, SightingLight, find, read_sets,
};

/// An aerosol: the name of a model, or optical depth at 550 nm and Ångström's exponent.
#[derive(Debug, FromPyObject)]
enum AerosolGiven {
    Named(String),
    Angstrom(f64, f64),
}

/// Known properties of the air; what is not given is the station's, or the profile's own.
#[derive(Debug, Default, FromPyObject)]
#[pyo3(from_item_all)]
pub struct AirModel {
    profile: Option<String>,
    pressure_hpa: Option<f64>,
    ozone_du: Option<f64>,
    water_mm: Option<f64>,
    co2_ppm: Option<f64>,
    aerosol: Option<AerosolGiven>,
    refraction: Option<bool>,
}

impl AirModel {
    /// The air at an altitude, as the program's options make it.
    pub fn air(&self, altitude_m: f64, station: Option<&Station>) -> Result<Air, Failure> {
        let known = match station {
            Some(station) => station.air_options()?,
            None => AirOptions::new(Profile::midlatitude_winter()),
        };
        let profile = match &self.profile {
            Some(name) => Profile::named(name)?,
            None => known.profile,
        };
        let aerosol = match &self.aerosol {
            None => known.aerosol,
            Some(AerosolGiven::Named(name)) if name == "none" => Aerosol::None,
            Some(AerosolGiven::Named(name)) => match AerosolModel::from_name(name) {
                Some(model) => Aerosol::Model(model),
                None => {
                    let names: Vec<&str> = AerosolModel::ALL.iter().map(|m| m.name()).collect();
                    return Err(format!(
                        "aerosol is `{name}`, expected none, {} or (optical depth, exponent)",
                        names.join(", ")
                    )
                    .into());
                }
            },
            Some(AerosolGiven::Angstrom(optical_depth, exponent)) => Aerosol::Angstrom {
                optical_depth: *optical_depth,
                wavelength_nm: 550.0,
                exponent: *exponent,
                scale_height_m: 1800.0,
            },
        };
        let options = AirOptions {
            profile,
            altitude_m,
            pressure_hpa: self.pressure_hpa.or(known.pressure_hpa),
            ozone_du: self.ozone_du.or(known.ozone_du),
            water_mm: self.water_mm.or(known.water_mm),
            co2_ppm: self.co2_ppm.or(known.co2_ppm),
            aerosol,
            refraction: self.refraction.unwrap_or(true),
            ..known
        };
        Ok(Air::new(&options)?)
    }
}

/// A zero point by its name, `vega=0.03` or `ab`.
pub fn zero_point(text: &str) -> Result<ZeroPoint, Failure> {
    text.parse().map_err(|e: String| format!("zero_point: {e}").into())
}

/// A number within bounds, or the error that names it.
pub fn within(name: &str, value: f64, least: f64, most: f64) -> Result<f64, Failure> {
    match (least..=most).contains(&value) {
        true => Ok(value),
        false => Err(format!("{name} is {value:e}, expected {least:e} to {most:e}").into()),
    }
}

/// More samples are a slip of the step.
const MOST_SAMPLES: f64 = 200_000.0;
/// Longer windows are a slip of the year.
const MOST_DAYS: f64 = 40.0;

fn times(at: Epoch, to: Option<Epoch>, step_s: f64) -> Result<Vec<Epoch>, Failure> {
    let Some(last) = to else { return Ok(vec![at]) };
    let count =
        ((last - at).to_seconds() / within("step_s", step_s, 1e-3, 86_400.0)? + 1e-9).floor();
    if !(1.0..=MOST_SAMPLES).contains(&count) {
        return Err(format!(
            "from at to to there are {count} steps of {step_s} s, expected 1 to {MOST_SAMPLES}"
        )
        .into());
    }
    Ok((0..=count as u32).map(|i| at + f64::from(i) * step_s * Unit::Second).collect())
}

/// A star of one's own, or better known than in the catalogue.
#[derive(Debug, Default, FromPyObject)]
#[pyo3(from_item_all)]
struct OwnStar {
    place_deg: Option<(f64, f64)>,
    v_mag: Option<f64>,
    b_minus_v_mag: Option<f64>,
    spectral_type: Option<String>,
}

impl OwnStar {
    fn star(&self, name: &str) -> Result<Star, Failure> {
        let mut star = match self.place_deg {
            Some((ra_deg, dec_deg)) => Star::at(name, Equatorial { ra_deg, dec_deg })?,
            None => Catalogue::embedded().find(name)?.clone(),
        };
        star.v_mag = self.v_mag.or(star.v_mag);
        star.bv_mag = self.b_minus_v_mag.or(star.bv_mag);
        star.spectral_type = self.spectral_type.clone().or(star.spectral_type);
        Ok(star)
    }
}

/// A star's place, airmass and expected rates.
#[pyfunction]
#[pyo3(signature = (name, at, station, own, air, to=None, step_s=60.0, exposure_s=0.1, zero_point="vega=0.03".into()))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn star(
    py: Python<'_>,
    name: String,
    at: String,
    station: String,
    own: OwnStar,
    air: AirModel,
    to: Option<String>,
    step_s: f64,
    exposure_s: f64,
    zero_point: String,
) -> PyResult<Outcome> {
    run(py, None, move |_| {
        let at = needed("at", moment("at", Some(&at))?)?;
        let to = moment("to", to.as_deref())?;
        let exposure_s = within("exposure_s", exposure_s, 1e-9, 86_400.0)?;
        let times = times(at, to, step_s)?;
        let zero = self::zero_point(&zero_point)?;
        let station = needed("station", self::station(Some(&station))?)?;
        let star = own.star(&name)?;
        let air = air.air(station.site.geodetic().height_m, Some(&station))?;
        let mut warnings = air.implausible();
        let v_mag = star.v_mag.ok_or_else(|| {
            Failure::from(format!("no magnitude of {star} is known: give v_mag="))
        })?;
        let colours = StarColours {
            v_mag,
            b_minus_v_mag: star.bv_mag,
            spectral_type: star.spectral_type.as_deref(),
            zero,
        };
        // Vega unless somebody says that it is another star.
        let is_vega = star.hip == Some(VEGA_HIP)
            && own.b_minus_v_mag.is_none()
            && own.spectral_type.is_none();
        let light = match is_vega {
            true => star_light::vega(colours)?,
            false => star_light::of(colours)?,
        };
        let view = StarView { star, light, station, air, zero, exposure_s };
        let track = StarTrack::new(view, EarthOrientation::embedded(), times)?;
        warnings.extend(track.warnings());
        let report = StarReport { track: &track, warnings: &warnings, is_night: to.is_some() };
        let (product, text) = (report.product()?, report.text());
        Ok(Outcome::new(product, text, warnings.clone()))
    })
}

/// Transmission of the air.
#[pyfunction]
#[pyo3(signature = (zenith_deg, wavelength_nm, model, mean_nm=None, station=None, altitude_m=None, apparent=false, components=false))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn air(
    py: Python<'_>,
    zenith_deg: Vec<f64>,
    wavelength_nm: Vec<f64>,
    model: AirModel,
    mean_nm: Option<f64>,
    station: Option<String>,
    altitude_m: Option<f64>,
    apparent: bool,
    components: bool,
) -> PyResult<Outcome> {
    run(py, None, move |_| {
        if zenith_deg.is_empty() || wavelength_nm.is_empty() {
            return Err("zenith_deg and wavelength_nm: expected at least one of each".into());
        }
        let station = self::station(station.as_deref())?;
        let own_m = station.as_ref().map(|s| s.site.geodetic().height_m);
        if altitude_m.is_some() && own_m.is_some() {
            return Err("altitude_m goes without station, which has one".into());
        }
        let altitude_m = needed("altitude_m or station", altitude_m.or(own_m))?;
        let air = model.air(altitude_m, station.as_ref())?;
        let warnings = air.implausible();
        let grid = AirGrid { nm: wavelength_nm, mean_nm };
        let question = AirQuestion { zenith_deg, apparent, grid, components };
        let rows = air.survey(&question, station.as_ref())?;
        let report = AirReport {
            air: &air,
            question: &question,
            own_wavelengths: true,
            rows: &rows,
            station: station.as_ref(),
        };
        let (product, text) = (report.product(true), report.text()?);
        Ok(Outcome::new(product, text, warnings))
    })
}

/// How bright a target is, and which passes are listed.
#[derive(Debug, FromPyObject)]
#[pyo3(from_item_all)]
struct Wanted {
    norad_id: Vec<String>,
    name: Vec<String>,
    min_elevation_deg: f64,
    sun_below_deg: f64,
    min_culmination_deg: f64,
    min_duration_s: f64,
    brighter_than: Option<f64>,
    limit: Option<usize>,
    diameter_m: f64,
    reflectance: f64,
    standard_magnitude: Option<f64>,
    model: Option<String>,
    attitude: String,
    tolerance: f64,
    exposure_s: f64,
    zero_point: String,
}

impl Wanted {
    fn law(&self) -> Result<Brightness, Failure> {
        if let Some(magnitude) = self.standard_magnitude {
            let magnitude = within("standard_magnitude", magnitude, -30.0, 40.0)?;
            return Ok(Brightness::Standard { magnitude });
        }
        let (diameter_m, reflectance) = (self.diameter_m, self.reflectance);
        if !(diameter_m > 0.0 && diameter_m <= 1e5) {
            return Err(format!(
                "diameter_m is {diameter_m}, expected more than 0 and at most 100000 m"
            )
            .into());
        }
        if !(reflectance > 0.0 && reflectance <= 1.0) {
            return Err(format!(
                "reflectance is {reflectance}, expected more than 0 and at most 1"
            )
            .into());
        }
        Ok(Brightness::Sphere { diameter_m, reflectance })
    }

    fn model(&self) -> Result<Option<Model>, Failure> {
        let Some(model) = &self.model else { return Ok(None) };
        let law = Path::new(&self.attitude);
        let attitude = match law.exists() {
            true => Attitude::read(law)?,
            false => Attitude::named(&self.attitude)?,
        };
        Ok(Some(Model {
            target: target(model)?,
            attitude,
            attitude_name: self.attitude.clone(),
            tolerance: within("tolerance", self.tolerance, 1e-9, 1.0)?,
        }))
    }

    fn filter(&self) -> SightingFilter {
        SightingFilter {
            min_culmination_deg: self.min_culmination_deg,
            min_duration_s: self.min_duration_s,
            brighter_than: self.brighter_than,
            limit: self.limit,
        }
    }
}

/// Passes that can be seen.
#[pyfunction]
#[pyo3(signature = (elements, start, end, station, wanted, air, progress=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn passes(
    py: Python<'_>,
    elements: Vec<PathBuf>,
    start: String,
    end: Option<String>,
    station: String,
    wanted: Wanted,
    air: AirModel,
    progress: Option<Py<PyAny>>,
) -> PyResult<Outcome> {
    run(py, progress, move |watch: &Watch| {
        let from = needed("start", moment("start", Some(&start))?)?;
        let to = moment("end", end.as_deref())?.unwrap_or(from + 1.0 * Unit::Day);
        let days = (to - from).to_unit(Unit::Day);
        if !(days > 0.0 && days <= MOST_DAYS) {
            return Err(format!(
                "from start to end are {days:.3} days, expected more than 0 and at most {MOST_DAYS}"
            )
            .into());
        }
        let station = needed("station", self::station(Some(&station))?)?;
        let zero = zero_point(&wanted.zero_point)?;
        let exposure_s = within("exposure_s", wanted.exposure_s, 1e-9, 86_400.0)?;
        let brightness = wanted.law()?;
        let source = |(path, sha256): &(PathBuf, String)| Input {
            file: path.display().to_string(),
            sha256: sha256.clone(),
        };
        let mut inputs: Vec<Input> = station.sources.iter().map(source).collect();
        let sets = read_sets(&elements)?;
        inputs.extend(sets.inputs);
        let mut failures = sets.failures;
        let tles = tle::of_objects(sets.good, &wanted.norad_id, &wanted.name, from)?;
        let orientation = EarthOrientation::embedded();
        let air = air.air(station.site.geodetic().height_m, Some(&station))?;
        let mut warnings = air.implausible();
        warnings.extend(station.warnings.clone());
        let origin = orientation.at(from)?.origin;
        if origin.is_outside() {
            warnings.push(origin.to_string());
        }
        let conditions = Conditions {
            min_altitude_deg: wanted.min_elevation_deg,
            sun_below_deg: wanted.sun_below_deg,
        };
        let search =
            Search::new(&station.site, &station.horizon, (from, to), conditions, orientation)?;
        let any = tles.iter().find_map(|tle| TleOrbit::new(tle.clone()).ok()).map(Orbit::from);
        let model = match any {
            None => None,
            Some(orbit) => wanted.model()?.map(|model| {
                let words = model.words();
                let (when, seen) = ((from, orientation), (zero, exposure_s));
                (model.pass(orbit, &station, &air, when, seen), words)
            }),
        };
        let light = match &model {
            None => SightingLight::Law(brightness),
            Some((pass, words)) => {
                let ready = pass.ready()?;
                warnings.extend(pass.warnings.clone());
                warnings.extend(ready.report().warnings.clone());
                inputs.extend(pass.target.sources.iter().map(source));
                SightingLight::Model(Box::new(ready), words.clone())
            }
        };
        let frames = SkyFrames::over(from, to, orientation)?;
        let photometer = Photometer::new(&station, &air, light, frames, zero, exposure_s)?;
        let found = find(tles, &search, &photometer, &wanted.filter(), watch)?;
        failures.extend(found.failures);
        warnings.extend(found.warnings);
        let report = PassesReport {
            search: &search,
            station: &station,
            photometer: &photometer,
            passes: &found.passes,
            counts: found.counts,
            failures: &failures,
            warnings: &warnings,
            inputs,
            orientation,
        };
        let plot = report.sky_plot();
        let pictures =
            vec![("svg".to_owned(), plot.svg()?.into_bytes()), ("png".to_owned(), plot.png()?)];
        let (product, text) = (report.product(true), report.text());
        Ok(Outcome::new(product, text, warnings.clone()).with_pictures(pictures))
    })
}

/// Adds the functions to the module.
pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(star, module)?)?;
    module.add_function(wrap_pyfunction!(air, module)?)?;
    module.add_function(wrap_pyfunction!(passes, module)?)
}
