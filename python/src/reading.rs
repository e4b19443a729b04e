//! A curve read for its body: folded, unmixed, mapped, its spin.

use crate::product::Outcome;
use crate::sky::AirModel;
use crate::watch::{Failure, Watch, run};
use crate::workflows::{Reading, moment, needed, pass, station_for, station_or_usual, unknown};
use pyo3::prelude::*;
use std::path::PathBuf;
use sunglint_analysis::curves::{Curves, Trends};
use sunglint_analysis::fold::{FoldOptions, SpinAxis, fold_curves};
use sunglint_analysis::map::Grid;
use sunglint_analysis::samples::SampledCurve;
use sunglint_analysis::unmix::nnls::Constraint;
use sunglint_inference::attitude::{self, AnalysisOptions, Scale, Sense, Unknowns};
use sunglint_inference::bisector;
use sunglint_inference::lit_curve::LitCurve;
use sunglint_inference::map::{MapOptions, map_directions, map_samples};
use sunglint_inference::measured::joined;
use sunglint_inference::unmix::{Materials, UnmixOptions, unmix_curve};
use sunglint_report::{attitude as spin, fold as folded, map as mapped, unmix as unmixed};
use sunglint_simulator::pass::Overrides;

/// Samples of curves by their phase in a period.
#[pyfunction]
#[pyo3(signature = (curves, reading, air, period_s, period_sigma_s=None, epoch=None, scene=None, axis_deg=None, bins=50, channels=Vec::new(), station=None, keep=Vec::new()))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn fold(
    py: Python<'_>,
    curves: Vec<PathBuf>,
    reading: Reading,
    air: AirModel,
    period_s: f64,
    period_sigma_s: Option<f64>,
    epoch: Option<String>,
    scene: Option<PathBuf>,
    axis_deg: Option<(f64, f64)>,
    bins: usize,
    channels: Vec<String>,
    station: Option<String>,
    keep: Vec<String>,
) -> PyResult<Outcome> {
    run(py, None, move |_| {
        if let Some(other) = keep.iter().find(|k| !["air", "range", "phase"].contains(&k.as_str()))
        {
            return Err(unknown("keep", other, "air, range or phase"));
        }
        let keeps = |what: &str| keep.iter().any(|k| k == what);
        let mut all = Curves::read(&curves, &reading.options()?, &channels)?;
        let named = station.as_deref();
        let own = if keeps("air") { None } else { station_or_usual(named)? };
        if !keeps("air") && own.is_none() && all.has_rates() {
            all.warnings.push("the air is not removed: no station says through which air and with which channels (station=; keep=[\"air\"] to say nothing)".into());
        }
        let through = match &own {
            Some(s) => Some(air.air(s.site.geodetic().height_m, Some(s))?),
            None => None,
        };
        all.remove(&Trends {
            air: own.as_ref().zip(through.as_ref()),
            range: !keeps("range"),
            phase: !keeps("phase"),
        });
        let axis = match (&scene, axis_deg) {
            (Some(scene), Some((ra_deg, dec_deg))) if period_s.is_finite() && period_s > 0.0 => {
                let pass = pass(scene, named, Overrides::default())?;
                let bisectors = bisector::bisectors(&pass, all.zero, &all.series()?)?;
                Some(SpinAxis { ra_deg, dec_deg, bisectors })
            }
            (None, None) | (Some(_), Some(_)) => None,
            _ => return Err("axis_deg and scene go together".into()),
        };
        let options = FoldOptions {
            period_sigma_s,
            epoch: moment("epoch", epoch.as_deref())?,
            bins,
            axis,
            ..FoldOptions::new(period_s)
        };
        let found = fold_curves(&all, &options)?;
        let (product, text) = (folded::product(&found), folded::text(&found));
        Ok(Outcome::new(product, text, found.warnings))
    })
}

/// How much of a curve's light comes from which material.
#[pyfunction]
#[pyo3(signature = (curve, endmembers, air, scene=None, station=None, no_air=false, total_m2_sr=None, unweighted=false, confusion=false))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn unmix(
    py: Python<'_>,
    curve: PathBuf,
    endmembers: Vec<String>,
    air: AirModel,
    scene: Option<PathBuf>,
    station: Option<String>,
    no_air: bool,
    total_m2_sr: Option<f64>,
    unweighted: bool,
    confusion: bool,
) -> PyResult<Outcome> {
    run(py, None, move |_| {
        let constraint = match total_m2_sr {
            None => Constraint::Free,
            Some(total) if total.is_finite() && total > 0.0 => Constraint::Sum(total),
            Some(total) => {
                return Err(format!("total_m2_sr is {total}, expected an area above 0").into());
            }
        };
        let materials = Materials::read(&endmembers)?;
        let sampled = SampledCurve::read(&curve)?;
        let given = match &scene {
            Some(scene) => {
                let pass = pass(scene, station.as_deref(), Overrides::default())?;
                LitCurve::of_scene(sampled, pass, no_air)?
            }
            None => {
                let station = match sampled.needs_station(no_air) {
                    true => {
                        Some(needed("station or scene", station_or_usual(station.as_deref())?)?)
                    }
                    false => None,
                };
                let air = match &station {
                    Some(s) if !no_air => Some(air.air(s.site.geodetic().height_m, Some(s))?),
                    _ => None,
                };
                LitCurve::of_station(sampled, station, air)
            }
        };
        let options = UnmixOptions { constraint, unweighted, confusion };
        let found = unmix_curve(&given, &materials, &options)?;
        let (product, text) = (unmixed::product(&found), unmixed::text(&found));
        Ok(Outcome::new(product, text, found.warnings))
    })
}

/// Samples, or all directions, on the body's frame.
#[pyfunction]
#[pyo3(signature = (scene, curve=None, endmembers=Vec::new(), step_deg=5.0, phase_deg=None, along=false, ranges_nm=None, station=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn body_map(
    py: Python<'_>,
    scene: PathBuf,
    curve: Option<PathBuf>,
    endmembers: Vec<String>,
    step_deg: f64,
    phase_deg: Option<f64>,
    along: bool,
    ranges_nm: Option<f64>,
    station: Option<String>,
) -> PyResult<Outcome> {
    run(py, None, move |_| {
        let place = |e: Failure| Failure::from(format!("{}: {e}", scene.display()));
        if let Some(deg) = phase_deg.filter(|deg| !(0.0..180.0).contains(deg)) {
            return Err(format!("phase_deg is {deg}, expected 0 to less than 180").into());
        }
        let pass = pass(&scene, station.as_deref(), Overrides::default())?;
        if !pass.attitude_given {
            return Err(place(
                "no [attitude]: without it nobody knows how the body is turned, and nothing can stand on its frame".into(),
            ));
        }
        let materials = Materials::read(&endmembers)?;
        let grid = Grid::new(step_deg)?;
        let maps = match &curve {
            Some(curve) => map_samples(&pass, curve, &materials, grid),
            None => {
                let options = MapOptions { phase_deg, along, ranges_nm, ..MapOptions::new(grid) };
                map_directions(&pass, &materials, &options)
            }
        };
        let maps = maps.map_err(|e| place(e.into()))?;
        let (product, text) = (mapped::product(&maps)?, mapped::text(&maps));
        Ok(Outcome::new(product, text, maps.warnings))
    })
}

/// How a body of known shape spins, from its light.
#[pyfunction]
#[pyo3(name = "attitude", signature = (inputs, reading, known=Vec::new(), period_s=None, sense="both".into(), scale="none".into(), channels=Vec::new(), axes=640, direct_only=false, station=None, seed=0, progress=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn attitude_of(
    py: Python<'_>,
    inputs: Vec<PathBuf>,
    reading: Reading,
    known: Vec<String>,
    period_s: Option<(f64, f64)>,
    sense: String,
    scale: String,
    channels: Vec<String>,
    axes: usize,
    direct_only: bool,
    station: Option<String>,
    seed: u64,
    progress: Option<Py<PyAny>>,
) -> PyResult<Outcome> {
    run(py, progress, move |watch: &Watch| {
        let names = ["axis", "phase", "period"];
        if let Some(other) = known.iter().find(|k| !names.contains(&k.as_str())) {
            return Err(unknown("known", other, "axis, phase or period"));
        }
        let is_unknown = |what: &str| !known.iter().any(|k| k == what);
        let mut options = AnalysisOptions::default();
        options.unknowns = Unknowns {
            axis: is_unknown("axis"),
            phase: is_unknown("phase"),
            period: is_unknown("period"),
        };
        if let Some((low, high)) = period_s.filter(|(low, high)| !(*low > 0.0 && low < high)) {
            return Err(format!(
                "period_s is ({low}, {high}), expected seconds above 0, the first below the second"
            )
            .into());
        }
        options.period_s = period_s;
        options.sense = match sense.as_str() {
            "both" => Sense::Both,
            "right" => Sense::Right,
            "left" => Sense::Left,
            other => return Err(unknown("sense", other, "both, right or left")),
        };
        options.scale = match scale.as_str() {
            "none" => Scale::None,
            "grey" => Scale::Grey,
            "channel" => Scale::Channels,
            "material" => Scale::Materials,
            other => return Err(unknown("scale", other, "none, grey, channel or material")),
        };
        if !(12..=100_000).contains(&axes) {
            return Err(format!("axes is {axes}, expected 12 to 100000").into());
        }
        options.channels = channels;
        options.search = attitude::Options { seed, axes, all_light: !direct_only };
        let mut curves = joined(&inputs, &reading.options()?)?;
        for curve in &mut curves {
            let scene = &curve.scene;
            curve.station = station_for(scene.names_station(), &scene.path, station.as_deref())?;
        }
        let found = attitude::analyse(curves, &options, watch)?;
        let scene = found.scene.iter();
        let files =
            scene.map(|text| (format!("{}.attitude.toml", found.name), text.clone())).collect();
        let (product, text) = (spin::product(&found), spin::text(&found));
        Ok(Outcome::new(product, text, found.warnings.clone()).with_files(files))
    })
}

/// Adds the functions to the module.
pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(fold, module)?)?;
    module.add_function(wrap_pyfunction!(unmix, module)?)?;
    module.add_function(wrap_pyfunction!(body_map, module)?)?;
    module.add_function(wrap_pyfunction!(attitude_of, module)?)
}
