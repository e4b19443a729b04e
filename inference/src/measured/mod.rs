//! Measured curves with the scenes that they are of, and what a fit takes of both.
//!
//! - [`MeasuredCurve`]: calibrated rates, or published magnitudes; [`CurveOfScene`]: with its scene;
//! - [`joined`]: reads both; [`pass_of`]: the pass at the curve's times;
//! - [`channels`]: which channels are fitted; [`prepared`]: the samples that are, with their noise.

mod band;
mod curve;
mod error;

pub(crate) use band::of_v;
pub use curve::MeasuredCurve;
pub use error::MeasuredError;

use crate::scene::Scene;
use crate::solver::{self, CalibrationError, Data};
use ndarray::Array2;
use std::path::Path;
use sunglint_calibration::stars::scintillation::Aperture;
use sunglint_formats::time::{format_utc, tai_nanoseconds};
use sunglint_radiometry::light_curve::published::{MagnitudeOptions, ObjectRows};
use sunglint_radiometry::station::Station;
use sunglint_simulator::pass::{BANDS, Overrides, Pass, Study};

/// The band of published magnitudes, V, among the simulated ones.
pub const V: usize = 2;
const _: () = assert!(V < BANDS.len());

/// A curve with the scene that it is of.
#[derive(Debug, Clone)]
pub struct CurveOfScene {
    /// Measured curve.
    pub measured: MeasuredCurve,
    /// The scene.
    pub scene: Scene,
    /// The station in place of the scene's; needed where the scene names none.
    pub station: Option<Station>,
}

/// Reads curves with the scene that stands after them: `CURVE… PASS.toml`, once or more often; at least one, all of rates or all of magnitudes. Rows of several objects are an error, unless
/// one is named or the scene has a place for each row (`[times] table`): then all are taken, as of bodies that are alike.
///
/// # Errors
/// Files that cannot be read; a curve without a scene, a scene without a curve; rates beside magnitudes.
pub fn joined<P: AsRef<Path>>(
    inputs: &[P],
    magnitudes: &MagnitudeOptions,
) -> Result<Vec<CurveOfScene>, MeasuredError> {
    let (mut curves, mut waiting) = (Vec::<CurveOfScene>::new(), Vec::<&Path>::new());
    for path in inputs {
        let path = path.as_ref();
        if path.extension().is_none_or(|e| !e.eq_ignore_ascii_case("toml")) {
            waiting.push(path);
            continue;
        }
        let scene = Scene::read(path)?;
        if waiting.is_empty() {
            return Err(MeasuredError::NoCurve { scene: path.to_path_buf() });
        }
        let mut options = magnitudes.clone();
        if scene.has_observations() && options.rows == ObjectRows::One {
            options.rows = ObjectRows::All;
        }
        for path in waiting.drain(..) {
            let measured = MeasuredCurve::read(path, &options)?;
            if let Some(twice) = curves.iter().find(|c| c.measured.is_same(&measured)) {
                let (path, other) = (path.to_path_buf(), twice.measured.path.clone());
                return Err(MeasuredError::Twice { path, other });
            }
            curves.push(CurveOfScene { measured, scene: scene.clone(), station: None });
        }
    }
    if let Some(left) = waiting.first() {
        return Err(MeasuredError::NoScene { curve: left.to_path_buf() });
    }
    if curves.is_empty() {
        return Err(MeasuredError::Nothing);
    }
    if curves.iter().any(|c| c.measured.magnitudes != curves[0].measured.magnitudes) {
        return Err(MeasuredError::Mixed);
    }
    Ok(curves)
}

/// Nothing farther from the zenith than this is seen, whatever the refraction, degrees.
const BELOW_DEG: f64 = 91.0;

/// The pass of a curve at its own times; adds what a person should hear of to `warnings`.
///
/// # Errors
/// A scene that is none.
pub fn pass_of(curve: &CurveOfScene, warnings: &mut Vec<String>) -> Result<Pass, MeasuredError> {
    let (first, last) = curve.measured.ends();
    let length_s = (tai_nanoseconds(last) - tai_nanoseconds(first)) as f64 * 1e-9;
    // A table of observations knows its own moments alone.
    let scene = match curve.scene.has_observations() {
        true => curve.scene.clone(),
        false => curve.scene.between(&format_utc(first, 9), &format_utc(last, 9), length_s),
    };
    let overrides = Overrides { station: curve.station.clone(), ..Overrides::default() };
    let pass = scene.pass(overrides)?;
    for warning in &pass.warnings {
        if !warnings.contains(warning) {
            warnings.push(warning.clone());
        }
    }
    let own = &curve.measured;
    let mut exposure_s = own.exposure_s.clone();
    // A table of observations has exposures of its own.
    if !own.is_exposure_known && !curve.scene.has_observations() {
        // As `compare` takes them, so that the fitted scene is what was fitted.
        match curve.scene.exposure_s() {
            Some(usual) => {
                exposure_s.fill(usual);
                warnings.push(format!(
                    "{}: no exposures: those of the scene are taken, {usual} s",
                    own.path.display()
                ));
            }
            None => warnings.push(format!(
                "{}: no exposures, in the file or the scene: the usual step is taken, {} s; say `[times] exposure_s` if they are shorter",
                own.path.display(),
                exposure_s.first().copied().unwrap_or(f64::NAN)
            )),
        }
    }
    pass.at_times(own.times.clone(), exposure_s, &own.file_rows)
        .map_err(|source| MeasuredError::Times { path: own.path.clone(), source: Box::new(source) })
}

/// The place of a channel among a station's.
pub fn place(station: &Station, channel: &str) -> Option<usize> {
    station.channels.iter().position(|c| c.name == channel)
}

/// The channels of a fit, in the station's order; all that were measured where `only` names none.
///
/// # Errors
/// A measured channel that its station lacks; one that was asked for and not measured.
pub fn channels(
    curves: &[CurveOfScene],
    studies: &[Study],
    only: &[String],
) -> Result<Vec<String>, MeasuredError> {
    if curves.first().is_some_and(|c| c.measured.magnitudes) {
        return match only.iter().find(|c| *c != "V") {
            Some(missing) => Err(MeasuredError::NotMeasured { channel: missing.clone() }),
            None => Ok(vec!["V".into()]),
        };
    }
    let mut found: Vec<String> = Vec::new();
    for (curve, study) in curves.iter().zip(studies) {
        let station = &study.pass().station;
        for name in &curve.measured.channels {
            if !only.is_empty() && !only.contains(name) {
                continue;
            }
            if place(station, name).is_none() {
                let known: Vec<&str> = station.channels.iter().map(|c| c.name.as_str()).collect();
                return Err(MeasuredError::NotOfTheStation {
                    path: curve.measured.path.clone(),
                    station: station.name.clone(),
                    channel: name.clone(),
                    known: known.join(", "),
                });
            }
            if !found.contains(name) {
                found.push(name.clone());
            }
        }
    }
    if let Some(missing) = only.iter().find(|c| !found.contains(c)) {
        return Err(MeasuredError::NotMeasured { channel: missing.clone() });
    }
    if let Some(study) = studies.first() {
        found.sort_by_key(|name| place(&study.pass().station, name));
    }
    Ok(found)
}

/// A curve as a fit takes it, and what was left out of it: why, and how many samples. `coefficient` is Young's, of the scintillation.
///
/// # Errors
/// No sample that is left.
pub fn prepared(
    measured: &MeasuredCurve,
    study: &Study,
    channels: &[String],
    coefficient: f64,
) -> Result<(Data, Vec<(String, usize)>), MeasuredError> {
    let n = measured.times.len();
    let from: Vec<Option<usize>> = match measured.magnitudes {
        true => vec![Some(0)],
        false => {
            channels.iter().map(|c| measured.channels.iter().position(|own| own == c)).collect()
        }
    };
    let pick = |values: &Array2<f64>| {
        Array2::from_shape_fn((n, channels.len()), |(i, c)| {
            from[c].map_or(f64::NAN, |k| values[[i, k]])
        })
    };
    let mut data = Data::new(measured.name(), pick(&measured.rate), pick(&measured.sigma));
    let from_start = |t: &hifitime::Epoch| {
        (tai_nanoseconds(*t) - tai_nanoseconds(measured.times[0])) as f64 * 1e-9
    };
    data.time_s = measured.times.iter().map(from_start).collect();
    data.share = measured.share.as_ref().map(pick);
    if let Some(level) = &measured.level {
        data.with_level(pick(level));
    }
    data.used = Array2::from_shape_fn((n, channels.len()), |(i, c)| {
        from[c].is_some_and(|k| measured.used[[i, k]])
    });
    let mut all = std::collections::BTreeMap::<&String, usize>::new();
    for (why, count) in measured.left_out.iter().flatten() {
        *all.entry(why).or_default() += count;
    }
    let mut left_out: Vec<(String, usize)> =
        all.into_iter().map(|(why, count)| (why.clone(), count)).collect();
    // A table of observations may have an observer of its own.
    let from_station = study.pass().observations.is_empty();
    let (mut hidden, mut shaded) = (0, 0);
    let before = data.count();
    for (i, place) in study.places().iter().enumerate() {
        let count = data.used.row(i).iter().filter(|u| **u).count();
        // Magnitudes are above the air: no refraction was looked up for them.
        let low = match measured.magnitudes {
            true => from_station && place.geometry.zenith_deg() > BELOW_DEG,
            false => place.apparent_zenith_deg.is_none(),
        };
        if low {
            hidden += count;
        } else if place.sunlit < 1.0 {
            shaded += count;
        } else {
            continue;
        }
        data.used.row_mut(i).fill(false);
    }
    let mut lost = |why: &str, count: usize| {
        if count > 0 {
            left_out.push((why.to_owned(), count));
        }
    };
    lost("below the horizon in the simulation", hidden);
    lost("in the Earth's shadow in the simulation", shaded);
    if data.count() == 0 {
        return Err(MeasuredError::NothingLeft {
            path: measured.path.clone(),
            left_out,
            flagged: before == 0,
        });
    }
    if !measured.magnitudes {
        let station = &study.pass().station;
        let aperture = Aperture {
            diameter_m: station.telescope.primary_diameter_m,
            height_m: station.site.geodetic().height_m,
            coefficient,
        };
        let airmass = solver::airmasses(study);
        data.common_variance = (measured.exposure_s.iter().zip(&airmass))
            .map(|(t, x)| if x.is_finite() { aperture.variance(*t, *x) } else { 0.0 })
            .collect();
        data.follow_photons(&measured.exposure_s);
    }
    data.calibration = measured.calibration.as_ref().map(|own| CalibrationError {
        key: own.key.clone(),
        covariance: Array2::from_shape_fn((channels.len(), channels.len()), |(i, j)| {
            match (from[i], from[j]) {
                (Some(a), Some(b)) => own.covariance[[a, b]],
                _ => 0.0,
            }
        }),
    });
    Ok((data, left_out))
}
