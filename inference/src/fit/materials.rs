//! Doubt of the materials in a fit: how far the light of its curves may be off, material by material.

use super::answer::FittedScene;
use super::error::PassFitError;
use crate::measured::{CurveOfScene, pass_of, place};
use crate::scene::Scene;
use crate::solver::Fit;
use ndarray::Array2;

/// Half of a 95 % interval in standard deviations.
const Z95: f64 = 1.959_963_984_540_054;

/// A material, and what its doubt makes of the light of each curve, `[sample, channel]`.
pub(super) type Doubts = (String, Vec<Array2<f64>>);

/// One standard deviation of the light of each curve by the doubt of each material that says how well it is known, at what was found; all directions of a material are off alike, in all curves.
pub(super) fn doubts(
    curves: &[CurveOfScene],
    scenes: &[FittedScene],
    fit: &Fit,
    channels: &[String],
) -> Result<Vec<Doubts>, PassFitError> {
    let mut found: Vec<Doubts> = Vec::new();
    let nothing = || fit.curves.iter().map(|c| Array2::zeros(c.model.raw_dim())).collect();
    for (k, curve) in curves.iter().enumerate() {
        let name = curve.measured.name();
        let Some(scene) = scenes.iter().find(|s| s.curves.contains(&name)) else { continue };
        let scene = Scene::parse(&curve.scene.path, &scene.text)?;
        // What it warns of was said when the curve was read.
        let pass = pass_of(&CurveOfScene { scene, ..curve.clone() }, &mut Vec::new())?;
        let target = &pass.target;
        if !target.parts.iter().any(|p| target.materials[p.material].says_doubt()) {
            continue;
        }
        let simulation = pass.simulate(&|_| {})?;
        let Some(doubt) = simulation.material_doubt(&|_| {})? else { continue };
        let model = &fit.curves[k].model;
        let places: Vec<Option<usize>> = channels.iter().map(|c| place(&pass.station, c)).collect();
        for one in &doubt.each {
            let relative = |i: usize, c: usize| {
                if curve.measured.magnitudes {
                    return one.v_relative[i];
                }
                places[c].map_or(0.0, |own| {
                    let rate = simulation.channels[own].rate_hz[i];
                    if rate > 0.0 { one.channels_hz[own][i] / rate } else { 0.0 }
                })
            };
            let change = Array2::from_shape_fn(model.raw_dim(), |(i, c)| {
                let change = model[[i, c]] * relative(i, c) / Z95;
                if change.is_finite() { change } else { 0.0 }
            });
            match found.iter_mut().find(|(material, _)| *material == one.material) {
                Some((_, all)) => all[k] = change,
                None => {
                    let mut all: Vec<Array2<f64>> = nothing();
                    all[k] = change;
                    found.push((one.material.clone(), all));
                }
            }
        }
    }
    Ok(found)
}
