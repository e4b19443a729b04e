//! Curves with their scenes, as the fit wants them.

use super::measured::Measured;
use super::parameters::Wanted;
use super::scene::Scene;
use super::{FitArgs, FitKeys};
use crate::curve_file::Magnitudes;
use crate::output::Usage;
use crate::station::StationArgs;
use anyhow::bail;
use ndarray::Array2;
use serde::Deserialize;
use std::path::PathBuf;
use sunglint_calibration::stars::scintillation::Aperture;
use sunglint_formats::time::{format_utc, tai_nanoseconds};
use sunglint_formats::toml::Document;
use sunglint_inference::solver::{self, CalibrationError, Data};
use sunglint_radiometry::station::Station;
use sunglint_simulator::pass::{Overrides, Pass, Study};

/// The `[fit]` of a file in which other tables stand too.
#[derive(Deserialize)]
struct AnyFile {
    #[serde(default)]
    fit: FitKeys,
}

/// Curves with their scenes.
pub(crate) struct Job {
    pub measured: Measured,
    pub scene: Scene,
}

/// Curves with the scene that stands after them, and the first scene's `[fit]`.
pub(super) fn jobs(args: &FitArgs) -> anyhow::Result<(Vec<Job>, FitKeys)> {
    let jobs = joined(&args.inputs, &args.magnitudes)?;
    let keys = match jobs.first() {
        Some(job) => Document::read(&job.scene.path)?.parse::<AnyFile>()?.fit,
        None => FitKeys::default(),
    };
    Ok((jobs, keys))
}

/// Curves with the scene that stands after them: `CURVE… PASS.toml`, once or more often; at least one, all of rates or all of magnitudes.
pub(crate) fn joined(inputs: &[PathBuf], magnitudes: &Magnitudes) -> anyhow::Result<Vec<Job>> {
    let (mut jobs, mut waiting) = (Vec::<Job>::new(), Vec::new());
    for path in inputs {
        if path.extension().is_none_or(|e| !e.eq_ignore_ascii_case("toml")) {
            waiting.push(Measured::read(path, magnitudes)?);
            continue;
        }
        let scene = Scene::read(path)?;
        if waiting.is_empty() {
            return Err(Usage(format!(
                "no curve stands before the scene {}: MEASURED… PASS.toml",
                path.display()
            ))
            .into());
        }
        let own = waiting.drain(..).map(|measured| Job { measured, scene: scene.clone() });
        jobs.extend(own);
    }
    if let Some(left) = waiting.first() {
        return Err(Usage(format!(
            "no scene stands after the curve {}: MEASURED… PASS.toml",
            left.path.display()
        ))
        .into());
    }
    if jobs.is_empty() {
        return Err(Usage("neither a curve nor a scene: MEASURED… PASS.toml".into()).into());
    }
    if jobs.iter().any(|j| j.measured.magnitudes != jobs[0].measured.magnitudes) {
        bail!("rates and magnitudes cannot be fitted together: fit each on its own");
    }
    Ok(jobs)
}

pub(super) fn wanted(args: &FitArgs, keys: &FitKeys) -> anyhow::Result<Vec<Wanted>> {
    let mut all: Vec<Wanted> = Vec::new();
    for text in &keys.free {
        let want = text.parse::<Wanted>().map_err(|e| anyhow::anyhow!("[fit] free: {e}"))?;
        // What the command line says of it counts.
        if !args.free.iter().any(|w| w.name == want.name) {
            all.push(want);
        }
    }
    all.extend(args.free.iter().cloned());
    for (k, want) in all.iter().enumerate() {
        if all[..k].iter().any(|w| w.name == want.name) {
            return Err(Usage(format!("`{}` is free twice", want.name)).into());
        }
    }
    Ok(all)
}

/// The pass of a curve at its own times.
pub(crate) fn pass_of(
    job: &Job,
    from: &StationArgs,
    warnings: &mut Vec<String>,
) -> anyhow::Result<Pass> {
    let (first, last) = job.measured.ends();
    let length_s = (tai_nanoseconds(last) - tai_nanoseconds(first)) as f64 * 1e-9;
    let scene = job.scene.between(&format_utc(first, 9), &format_utc(last, 9), length_s);
    let station = if from.station.is_some() {
        Some(from.get()?)
    } else if scene.names_station() {
        None
    } else {
        let hint = format!("(or name one in [station] of {})", scene.path.display());
        Some(from.get_or(&hint)?)
    };
    let mut pass = scene.pass(Overrides { station, ..Overrides::default() })?;
    for warning in &pass.warnings {
        if !warnings.contains(warning) {
            warnings.push(warning.clone());
        }
    }
    pass.times = job.measured.times.clone();
    pass.exposure_s = job.measured.exposure_s.clone();
    Ok(pass)
}

pub(crate) fn place(station: &Station, channel: &str) -> Option<usize> {
    station.channels.iter().position(|c| c.name == channel)
}

/// The channels of the fit, in the station's order.
pub(crate) fn channels(
    jobs: &[Job],
    studies: &[Study],
    only: &[String],
) -> anyhow::Result<Vec<String>> {
    if jobs[0].measured.magnitudes {
        return Ok(vec!["V".into()]);
    }
    let station = &studies[0].pass().station;
    let mut found: Vec<String> = Vec::new();
    for (job, study) in jobs.iter().zip(studies) {
        let station = &study.pass().station;
        for name in &job.measured.channels {
            if !only.is_empty() && !only.contains(name) {
                continue;
            }
            if place(station, name).is_none() {
                let known: Vec<&str> = station.channels.iter().map(|c| c.name.as_str()).collect();
                bail!(
                    "{}: the station {} has no channel `{name}`, it has {}; --channel NAME fits some of the curve's channels alone",
                    job.measured.path.display(),
                    station.name,
                    known.join(", ")
                );
            }
            if !found.contains(name) {
                found.push(name.clone());
            }
        }
    }
    if let Some(missing) = only.iter().find(|c| !found.contains(c)) {
        bail!("no curve has the channel `{missing}` that was asked for");
    }
    found.sort_by_key(|name| place(station, name));
    Ok(found)
}

/// A curve as the fit wants it, and what was left out of it.
pub(crate) fn prepared(
    measured: &Measured,
    study: &Study,
    channels: &[String],
    coefficient: f64,
) -> anyhow::Result<(Data, Vec<(String, usize)>)> {
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
    data.used = Array2::from_shape_fn((n, channels.len()), |(i, c)| {
        from[c].is_some_and(|k| measured.used[[i, k]])
    });
    let mut left_out: Vec<(String, usize)> =
        measured.left_out.iter().map(|(why, count)| (why.clone(), *count)).collect();
    let (mut hidden, mut shaded) = (0, 0);
    let before = data.count();
    for (i, place) in study.places().iter().enumerate() {
        let count = data.used.row(i).iter().filter(|u| **u).count();
        let low = place.apparent_zenith_deg.is_none() && !measured.magnitudes;
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
        let reasons: Vec<String> = left_out.iter().map(|(why, n)| format!("{n} {why}")).collect();
        let hint = if before > 0 {
            ": do measured and simulated epochs belong to the same pass?"
        } else {
            ": every sample is flagged"
        };
        bail!(
            "{}: no sample is left to be fitted ({}){hint}",
            measured.path.display(),
            reasons.join(", ")
        );
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
