//! Fit of a simulation: the parameters with which it looks as the measured curves.
//!
//! - [`FitOptions`]: what is free ([`FreeParameter`]) and how it is searched for, as `[fit]` of a scene says, or a caller;
//! - [`fit`]: the search, light that is computed at few epochs and few moments of each exposure where that does not matter, light between the parts that is
//!   settled round by round;
//! - [`PassFit`]: what was found, beside what was measured, and the scene with it.
//!
//! Curves come from [`crate::measured`], the mathematics is [`crate::solver`].
//!
//! ```no_run
//! use std::path::Path;
//! use sunglint_inference::fit::{FitOptions, fit};
//! use sunglint_inference::measured::joined;
//! use sunglint_numerics::progress::Silent;
//! use sunglint_radiometry::light_curve::published::MagnitudeOptions;
//!
//! let curves = joined(&["calibrated.ecsv", "pass.toml"], &MagnitudeOptions::default())?;
//! let mut options = FitOptions::of_scene(Path::new("pass.toml"))?;
//! options.free.push("attitude.phase_deg=30..50".parse()?);
//! let found = fit(&curves, &options, &Silent)?;
//! for p in &found.fit.parameters {
//!     println!("{} {} ± {:?}", p.name, p.value, p.sigma);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod answer;
mod error;
mod found;
mod materials;
mod normals;
mod options;
mod parameters;

pub use answer::{
    Bounces, CurveFit, FittedScene, LeftOut, MagnitudeTrack, MaterialSpectrum, PassFit,
    PredictedCurve, Prediction, ResidualGroups,
};
pub use error::PassFitError;
pub use options::{FitOptions, LeaveOut};
pub use parameters::FreeParameter;

use crate::measured::{CurveOfScene, V, channels, pass_of, place, prepared};
use crate::solver::{
    self, Data, Estimate, Fit, Free, Linear, Options, ParameterKind, Purpose, Search, StudyModel,
    Unit, WORTH,
};
use found::{Bouncing, OfCurve, fitted_scenes, spectra_of};
use parameters::{CurveSide, Normal, Parameters};
use std::time::Instant;
use sunglint_numerics::progress::{Cancelled, Progress};
use sunglint_radiometry::light_curve::Input;
use sunglint_simulator::light::engine::Switch;
use sunglint_simulator::pass::{Averaged, Study, Thinned};
use sunglint_simulator::target::Shape;

/// Part of the scene's tolerance that the light may err by where it is computed at some epochs and is linear in time between them.
const THINNED: f64 = 0.3;
/// Part of the best sample's uncertainty that the light of an exposure's middle may be off from the mean.
const AVERAGED_SIGMAS: f64 = 0.1;
/// Steps of a descent from a proposed normal, at most, which is for telling proposals apart.
const STEPS_OF_A_PROPOSAL: usize = 4;
/// How often such epochs, and moments within exposures, are added where a fit ended.
const REFINED: usize = 3;

/// The studies of all curves, and of which light between the parts is to be settled.
fn studies_of(
    curves: &[CurveOfScene],
    warnings: &mut Vec<String>,
) -> Result<(Vec<Study>, Vec<bool>), PassFitError> {
    let (mut studies, mut bouncing) = (Vec::new(), Vec::new());
    for curve in curves {
        warnings.extend(curve.measured.warnings.iter().cloned());
        let mut pass = pass_of(curve, warnings)?;
        // Light between parts costs too much for a search; of a lone sphere there is none.
        let lone = matches!(&pass.target.parts[..], [p] if matches!(p.shape, Shape::Sphere { .. }));
        let auto = pass.effects.inter_reflection == Switch::Auto;
        bouncing.push(auto && !lone);
        if auto {
            pass.effects.inter_reflection = Switch::Off;
        }
        let study = Study::new(pass).map_err(|source| PassFitError::Study {
            path: curve.measured.path.clone(),
            ends: curve.measured.ends(),
            source: Box::new(source),
        })?;
        studies.push(study);
    }
    Ok((studies, bouncing))
}

/// Normal of a part that another one was preferred to, with its roughness: numbers and values of the parameters.
struct Lost {
    normal: usize,
    values: Vec<(usize, f64)>,
}

impl Lost {
    fn new(number: usize, normal: &Normal, fit: &Fit) -> Self {
        let own = normal.angles.into_iter().chain(normal.roughness.iter().map(|(k, _)| *k));
        Self { normal: number, values: own.map(|k| (k, fit.parameters[k].value)).collect() }
    }
}

/// The search and what follows it: a fit again from where one ended.
struct Searching<'a> {
    curves: &'a [CurveOfScene],
    channels: &'a [String],
    data: &'a [Data],
    parameters: &'a Parameters,
    options: Options,
    /// Allowed difference between the middles of exposures and the means, by curve.
    middles: Vec<f64>,
    progress: &'a dyn Progress,
}

impl Searching<'_> {
    fn run(
        &self,
        model: &mut StudyModel,
        free: &[Free],
        options: &Options,
    ) -> Result<Fit, PassFitError> {
        self.run_with(model, free, &self.parameters.linear, options)
    }

    fn run_with(
        &self,
        model: &mut StudyModel,
        free: &[Free],
        linear: &[Linear],
        options: &Options,
    ) -> Result<Fit, PassFitError> {
        if self.progress.is_cancelled() {
            return Err(Cancelled.into());
        }
        let mut tell = |at: solver::Progress| {
            let solver::Progress { stage, evaluations, chi2 } = at;
            self.progress
                .status(&format!("{stage}: {evaluations} simulations, chi-square {chi2:.4e}"));
        };
        Ok(solver::fit(self.data, model, free, linear, options, &mut tell)?)
    }

    /// Searches for normals of parts, one after the other, and then for everything from there.
    fn with_normals(&self, model: &mut StudyModel) -> Result<Fit, PassFitError> {
        let Parameters { normals, .. } = self.parameters;
        let on_the_way = Options { purpose: Purpose::Start, shakes: 0, ..self.options.clone() };
        let mut fit = self.run_hidden(model, &self.parameters.free, normals, &on_the_way)?;
        let mut evaluations = fit.evaluations;
        let iterations = STEPS_OF_A_PROPOSAL.min(on_the_way.iterations);
        let near = Options { places: 0, starts: 0, iterations, ..on_the_way };
        // Normals that lost against another by less than the data can tell.
        let mut lost: Vec<Lost> = Vec::new();
        for (k, normal) in normals.iter().enumerate() {
            self.progress.status(&format!("normal of {}", normal.part));
            let proposals = normals::propose(
                self.curves,
                self.data,
                model,
                self.parameters,
                self.channels,
                &fit,
                normal,
            )?;
            let mut tried: Vec<(f64, Fit)> = Vec::new();
            for proposal in &proposals {
                let mut free = self.from(&fit);
                free[normal.angles[0]].start = proposal.azimuth_deg;
                free[normal.angles[1]].start = proposal.tilt_deg;
                if let (Some(rough), Some((k, _))) = (proposal.roughness, &normal.roughness) {
                    free[*k].start = rough.clamp(free[*k].low, free[*k].high);
                }
                // Nodes that were chosen without the glint would step over it.
                let there: Vec<f64> = free.iter().map(|f| f.start).collect();
                model.average(&there, &self.middles)?;
                model.thin(&there, THINNED)?;
                // The normals before stay where they are until all are there.
                let before = normals[..k]
                    .iter()
                    .flat_map(|n| n.angles.into_iter().chain(n.roughness.iter().map(|(k, _)| *k)));
                before.for_each(|k| free[k].search = Search::Nowhere);
                let found = self.run_hidden(model, &free, &normals[k + 1..], &near)?;
                evaluations += found.evaluations;
                tried.push((cost(&found), found));
            }
            tried.sort_by(|a, b| a.0.total_cmp(&b.0));
            let mut tried = tried.into_iter();
            // Where no normal helps, the part keeps that of the scene.
            fit = match tried.next() {
                Some((least, found)) => {
                    let close = tried.filter(|(cost, _)| cost - least < WORTH * found.scaled_by);
                    lost.extend(close.map(|(_, other)| Lost::new(k, normal, &other)));
                    found
                }
                None => {
                    let dark =
                        self.run_hidden(model, &self.from(&fit), &normals[k + 1..], &near)?;
                    evaluations += dark.evaluations;
                    dark
                }
            };
        }
        let last = Options { places: 0, starts: 0, shakes: 0, ..self.options.clone() };
        let mut fit = self.run(model, &self.from(&fit), &last)?;
        evaluations += fit.evaluations;
        if !lost.is_empty() {
            evaluations += self.with_the_lost(model, &mut fit, &lost, &near, &last)?;
        }
        fit.evaluations = evaluations;
        Ok(fit)
    }

    /// Goes down from a fit with each normal that lost in the place of the one that won, now that all parts have their light. What ends above the fit is kept as another minimum of it, unless
    /// the intervals of the normal hold it; the best of what ends below replaces it. Returns the simulations that it took.
    fn with_the_lost(
        &self,
        model: &mut StudyModel,
        fit: &mut Fit,
        lost: &[Lost],
        near: &Options,
        last: &Options,
    ) -> Result<usize, PassFitError> {
        let free = &self.parameters.free;
        let mut evaluations = 0;
        let mut ends: Vec<(f64, &Lost, Fit)> = Vec::new();
        for lost in lost {
            let mut there = self.from(fit);
            for (k, value) in &lost.values {
                there[*k].start = *value;
            }
            let end = self.run(model, &there, near)?;
            evaluations += end.evaluations;
            ends.push((cost(&end), lost, end));
        }
        ends.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut others: Vec<(f64, usize, Vec<f64>)> =
            ends.iter().map(|(cost, lost, end)| (*cost, lost.normal, searched(end))).collect();
        let before = cost(fit);
        if let Some((least, lost, end)) = ends.first()
            && least + 1.0 < before
        {
            let next = self.run(model, &self.from(end), last)?;
            evaluations += next.evaluations;
            if cost(&next) < before {
                others[0] = (before, lost.normal, searched(fit));
                *fit = next;
            }
        }
        let least = cost(fit);
        for (cost, normal, values) in others {
            let inside = self.parameters.normals[normal].angles.iter().all(|k| {
                let known = &fit.parameters[*k];
                let turn = free[*k].high - free[*k].low;
                let turns = match free[*k].wraps {
                    true => ((values[*k] - known.value) / turn).round(),
                    false => 0.0,
                };
                known.covers(values[*k] - turn * turns)
            });
            if !inside {
                fit.add_minimum(free, values, ((cost - least) / fit.scaled_by).max(0.0));
            }
        }
        Ok(evaluations)
    }

    /// Fits with some parts without light and their normals where they stand.
    fn run_hidden(
        &self,
        model: &mut StudyModel,
        free: &[Free],
        hidden: &[Normal],
        options: &Options,
    ) -> Result<Fit, PassFitError> {
        let (mut free, mut linear) = (free.to_vec(), self.parameters.linear.clone());
        for normal in hidden {
            let roughness = normal.roughness.iter().map(|(k, _)| *k);
            normal
                .angles
                .into_iter()
                .chain(roughness)
                .for_each(|k| free[k].search = Search::Nowhere);
            normal.linear.iter().for_each(|k| linear[*k].most = Some(0.0));
        }
        self.run_with(model, &free, &linear, options)
    }

    /// Search for a part's normal, begun where a fit ended.
    fn from(&self, fit: &Fit) -> Vec<Free> {
        (self.parameters.free.iter().zip(&fit.parameters))
            .map(|(f, p)| Free { start: p.value.clamp(f.low, f.high), ..f.clone() })
            .collect()
    }

    /// Fits again, from what a fit found.
    fn again(&self, model: &mut StudyModel, fit: &Fit) -> Result<Fit, PassFitError> {
        let again = self.from(fit);
        let shakes = usize::from(self.parameters.normals.is_empty());
        let near = Options { places: 0, starts: 0, shakes, ..self.options.clone() };
        let mut next = self.run(model, &again, &near)?;
        next.evaluations += fit.evaluations;
        // Other minima are those of the search.
        for other in fit.minima.iter().skip(1) {
            next.add_minimum(&self.parameters.free, other.values.clone(), other.delta_chi2);
        }
        Ok(next)
    }

    /// Searches, with light at as few epochs and moments as do where the search ends, too.
    fn fit(
        &self,
        model: &mut StudyModel,
    ) -> Result<(Fit, Vec<Averaged>, Vec<Thinned>), PassFitError> {
        let free = &self.parameters.free;
        let moments = |all: &[Averaged]| all.iter().map(|a| a.moments).sum::<usize>();
        let count = |all: &[Thinned]| all.iter().map(|t| t.direct + t.indirect).sum::<usize>();
        let begin: Vec<f64> = free.iter().map(|f| f.start).collect();
        let mut averaged = model.average(&begin, &self.middles)?;
        let mut nodes = model.thin(&begin, THINNED)?;
        let mut fit = match self.parameters.normals.is_empty() {
            true => self.run(model, free, &self.options)?,
            false => self.with_normals(model)?,
        };
        for _ in 0..REFINED {
            // What was smooth where the search began may not be so where it ended. What is linear moves no light.
            if free.is_empty() {
                break;
            }
            let before = moments(&averaged);
            averaged = model.average(&searched(&fit), &self.middles)?;
            let grew = moments(&averaged) > before;
            if !grew && wrong_between(model, &fit)? <= 1.0 {
                break;
            }
            let finer = model.thin(&searched(&fit), THINNED)?;
            if !grew && count(&finer) == count(&nodes) {
                break;
            }
            nodes = finer;
            fit = self.again(model, &fit)?;
        }
        Ok((fit, averaged, nodes))
    }
}

/// Fits what is free in scenes, so that their simulation looks as the curves that were measured. Results depend on `options.seed`, not on the number of
/// threads. Curves that `options.leave_out` names are predicted by further fits, of the others. A search that ends before it is at a minimum is no error: [`Fit::converged`] is false, and what was reached is there.
///
/// # Errors
/// Curves and scenes that do not go together; parameters that are none; no sample that is left; a start at which there is no model.
pub fn fit(
    curves: &[CurveOfScene],
    options: &FitOptions,
    progress: &dyn Progress,
) -> Result<PassFit, PassFitError> {
    let left_out = left_out(curves, &options.leave_out)?;
    let mut all = fit_without(curves, options, &[], progress)?;
    for (k, without) in left_out.iter().enumerate() {
        progress.status(&format!("without {} of {}", k + 1, left_out.len()));
        let others = fit_without(curves, options, without, progress)?;
        all.predicted.push(Prediction {
            curves: without.iter().map(|k| PredictedCurve::new(&others.curves[*k])).collect(),
            converged: others.fit.converged,
            reduced_chi2: others.fit.reduced_chi2,
            seconds: others.seconds,
        });
    }
    Ok(all)
}

/// Numbers of the curves that are left out together, for each time.
fn left_out(curves: &[CurveOfScene], wanted: &[LeaveOut]) -> Result<Vec<Vec<usize>>, PassFitError> {
    let names: Vec<String> = curves.iter().map(|c| c.measured.name()).collect();
    let mut all = Vec::new();
    for want in wanted {
        match want {
            LeaveOut::Each => all.extend((0..curves.len()).map(|k| vec![k])),
            LeaveOut::Together(files) => {
                let mut own = Vec::new();
                for file in files {
                    let before = own.len();
                    let is = |k: &usize| {
                        names[*k] == *file || curves[*k].measured.path.as_os_str() == file.as_str()
                    };
                    own.extend((0..curves.len()).filter(is));
                    if own.len() == before {
                        let known = names.join(", ");
                        return Err(PassFitError::NotACurve { name: file.clone(), known });
                    }
                }
                own.sort_unstable();
                own.dedup();
                all.push(own);
            }
        }
    }
    if let Some(own) = all.iter().find(|own| own.len() == curves.len()) {
        let names: Vec<&str> = own.iter().map(|k| names[*k].as_str()).collect();
        return Err(PassFitError::AllLeftOut { names: names.join(", ") });
    }
    Ok(all)
}

/// A fit in which no sample of some curves counts: what their scenes share with the others' predicts them.
fn fit_without(
    curves: &[CurveOfScene],
    options: &FitOptions,
    without: &[usize],
    progress: &dyn Progress,
) -> Result<PassFit, PassFitError> {
    let start = Instant::now();
    options.check()?;
    let first = curves.first().ok_or(PassFitError::NoCurve)?;
    let mut warnings = Vec::new();
    let (studies, bouncing) = studies_of(curves, &mut warnings)?;
    let channels = channels(curves, &studies, &options.channels)?;
    let (mut data, mut left_out) = (Vec::new(), Vec::new());
    for (curve, study) in curves.iter().zip(&studies) {
        let (mut own, lost) = prepared(&curve.measured, study, &channels, options.scintillation)?;
        own.in_the_mean();
        warnings.extend(curve.measured.silent(&channels));
        left_out.push(lost);
        data.push(own);
    }
    let shown: Vec<Data> = data.clone();
    without.iter().for_each(|k| data[*k].used.fill(false));
    let parameters = parameters_of(curves, &studies, &data, &channels, options)?;
    let with = curves
        .iter()
        .zip(studies)
        .map(|(curve, study)| {
            let unit = unit(curve, &study, &channels);
            (curve.scene.clone(), study, unit)
        })
        .collect();
    let mut model = parameters.model(with);

    let tolerance = |k: usize| model.study(k).map_or(0.0, |s| s.pass().tolerance);
    let middles =
        data.iter().enumerate().map(|(k, data)| middle_may_err(data, tolerance(k))).collect();
    // What is left out is predicted by values alone; light between parts settles by uncertainties.
    let values = !without.is_empty() && !bouncing.contains(&true);
    // Every step along a profile is a search of all normals.
    let purpose = match (values, parameters.normals.is_empty()) {
        (true, _) => Purpose::Values,
        (false, true) => Purpose::Answer,
        (false, false) => Purpose::Covariance,
    };
    let search = Searching {
        curves,
        channels: &channels,
        data: &data,
        parameters: &parameters,
        options: Options { purpose, ..options.solver() },
        middles,
        progress,
    };
    let (mut fit, averaged, nodes) = search.fit(&mut model)?;
    let bouncing = Bouncing { curves, of: &bouncing, parameters: &parameters, channels: &channels };
    let (mut bounces, mut bounced) = (None, Vec::new());
    if bouncing.of.iter().any(|b| *b) {
        let mut refit = |model: &mut StudyModel, fit: &Fit| search.again(model, fit);
        let settled = bouncing.settle(&mut model, fit, progress, &mut refit)?;
        (fit, bounces, bounced) = (settled.fit, settled.bounces, settled.studies);
    }
    fit.widen_for_correlation(&data);
    // What is linear moves no light.
    let thinned: Vec<Option<Thinned>> = match parameters.free.is_empty() {
        true => nodes.iter().map(|t| Some(*t)).collect(),
        false => model.thinned(&searched(&fit))?,
    };
    if let Some(bounces) = bounces.as_ref().filter(|b| !b.settled) {
        warnings.push(format!(
            "light between the parts, up to {:.1} % of a sample's, had not settled after {} rounds: the last moved a parameter by {:.1} of its standard uncertainty",
            100.0 * bounces.share, bounces.rounds, bounces.moved_sigmas
        ));
    }
    warnings.extend(fit.warnings.iter().map(ToString::to_string));
    let spectra = match model.study(0) {
        Some(study) => {
            let magnitudes = first.measured.magnitudes;
            let of = OfCurve {
                number: 0,
                parameters: &parameters,
                fit: &fit,
                channels: &channels,
                study,
                magnitudes,
                as_factors: false,
            };
            spectra_of(&of, &mut Vec::new())?.0
        }
        None => Vec::new(),
    };
    let scenes = match without.is_empty() {
        true => {
            let by = (&model, &mut bounced[..]);
            fitted_scenes(curves, &parameters, &fit, &channels, by, &mut warnings)?
        }
        false => Vec::new(),
    };
    let doubts = materials::doubts(curves, &scenes, &fit, &channels)?;
    if !doubts.is_empty() {
        fit.add_materials(&doubts);
    }
    for scene in scenes.iter().filter(|s| !s.same) {
        warnings.push(format!(
            "{}.fitted.toml does not give the fit again: its light differs by {:.1e} (root mean square, mag or relative; at most 1e-3 is the same)",
            scene.name, scene.difference
        ));
    }
    let fitted = curves
        .iter()
        .enumerate()
        .filter_map(|(k, curve)| {
            Some(CurveFit::new(
                &curve.measured,
                model.study(k)?,
                &shown[k],
                &fit.curves[k],
                left_out[k].clone(),
                averaged[k],
                thinned[k],
            ))
        })
        .collect();
    Ok(PassFit {
        name: first.scene.name(),
        scene_file: first.scene.path.clone(),
        station: model.study(0).map(|s| s.pass().station.name.clone()).unwrap_or_default(),
        groups: answer::groups(&data, &fit, &model, &channels),
        channels,
        curves: fitted,
        inputs: inputs_of(curves, &model)?,
        fit,
        spectra,
        scenes,
        predicted: Vec::new(),
        in_the_scene: parameters.in_the_scene(),
        doubtful_materials: doubts.into_iter().map(|(material, _)| material).collect(),
        scintillation: options.scintillation,
        bounces,
        seconds: start.elapsed().as_secs_f64(),
        warnings,
    })
}

fn unit(curve: &CurveOfScene, study: &Study, channels: &[String]) -> Unit {
    match curve.measured.magnitudes {
        true => Unit::Band(V),
        false => Unit::Channels(channels.iter().map(|c| place(&study.pass().station, c)).collect()),
    }
}

fn parameters_of(
    curves: &[CurveOfScene],
    studies: &[Study],
    data: &[Data],
    channels: &[String],
    options: &FitOptions,
) -> Result<Parameters, PassFitError> {
    let sides: Vec<CurveSide<'_>> = curves
        .iter()
        .zip(studies)
        .zip(data)
        .map(|((curve, study), data)| CurveSide {
            scene: &curve.scene,
            study,
            unit: unit(curve, study, channels),
            has: data.used.columns().into_iter().map(|c| c.iter().any(|u| *u)).collect(),
            cameras: curve.measured.cameras.as_deref(),
            used: data.used.rows().into_iter().map(|r| r.iter().any(|u| *u)).collect(),
        })
        .collect();
    Parameters::new(&options.free, &options.per_pass, options.largest_albedo, channels, &sides)
}

/// The files that a fit was made of.
fn inputs_of(curves: &[CurveOfScene], model: &StudyModel) -> Result<Vec<Input>, PassFitError> {
    let mut all: Vec<Input> = Vec::new();
    let mut add = |input: Input| {
        if !all.iter().any(|own| own.sha256 == input.sha256) {
            all.push(input);
        }
    };
    for (k, curve) in curves.iter().enumerate() {
        for path in [&curve.measured.path, &curve.scene.path] {
            let bytes = std::fs::read(path)
                .map_err(|source| PassFitError::Input { path: path.clone(), source })?;
            let sha256 = sunglint_formats::sha256(&bytes);
            add(Input { file: path.display().to_string(), sha256 });
        }
        let own = model.study(k).map(|s| s.pass().inputs.clone());
        own.into_iter().flatten().for_each(&mut add);
    }
    Ok(all)
}

/// Returns the relative difference allowed between the light of an exposure's middle and the mean, for a curve's samples: an amount that does not matter beside the best sample's
/// uncertainty, or beside what light itself may err by.
fn middle_may_err(data: &Data, tolerance: f64) -> f64 {
    let used = data.used.iter().zip(data.sigma.iter().zip(&data.rate)).filter(|(used, _)| **used);
    let relative = used.map(|(_, (sigma, rate))| sigma / rate.abs().max(*sigma));
    let best = relative.filter(|r| r.is_finite()).fold(1.0, f64::min);
    (AVERAGED_SIGMAS * best).max(THINNED * tolerance)
}

/// Sum of Huber's loss over the samples of a fit, and of the squares of its priors: outliers of other fits do not decide between them.
fn cost(fit: &Fit) -> f64 {
    const HUBER: f64 = 1.345;
    let pulls = fit.curves.iter().flat_map(|c| &c.pull).filter(|p| p.is_finite());
    let one = |p: &f64| match p.abs() {
        p if p <= HUBER => p * p,
        p => HUBER * (2.0 * p - HUBER),
    };
    let of_prior =
        |p: &Estimate| p.prior.map(|known| ((p.value - known.mean) / known.sigma).powi(2));
    pulls.map(one).sum::<f64>() + fit.parameters.iter().filter_map(of_prior).sum::<f64>()
}

/// Values of what was searched for.
fn searched(fit: &Fit) -> Vec<f64> {
    let own = fit.parameters.iter().filter(|p| p.kind == ParameterKind::Nonlinear);
    own.map(|p| p.value).collect()
}

/// Returns the error of the lines between epochs at which light was computed, over the allowed error.
fn wrong_between(model: &mut StudyModel, fit: &Fit) -> Result<f64, PassFitError> {
    let thinned = model.thinned(&searched(fit))?;
    let own = thinned.iter().enumerate().filter_map(|(k, t)| {
        let allowed = THINNED * model.study(k)?.pass().tolerance;
        t.as_ref().map(|t| t.error / allowed)
    });
    Ok(own.fold(0.0, f64::max))
}
