//! Light that comes from the Sun and is scattered once.

use super::{Answer, Part, Question};
use crate::light::{
    DirectionError, Effect, Evaluator, Lighting, Need, Scene, SceneError, Source, Term,
};

/// Seconds for a facet, for a pair of a facet and what may hide it, for a sphere: of a core of about 3 GHz.
const COSTS_S: [f64; 3] = [5e-8, 2e-8, 1e-7];

pub(super) fn assess(question: &Question) -> Result<Answer, SceneError> {
    let scene = question.scene;
    let report = scene.report();
    let mut terms = Vec::with_capacity(scene.weight_count());
    for (number, material) in scene.materials().iter().enumerate() {
        terms.extend(Term::of_material(Source::Direct, number, material)?);
    }
    let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    let why = format!(
        "{} and {}, {} before weights; areas exact",
        count(report.facets, "flat facet"),
        count(report.spheres, "sphere"),
        count(terms.len(), "spectrum").replace("spectrums", "spectra"),
    );
    let cost_s = COSTS_S[0] * report.facets as f64 + COSTS_S[2] * report.spheres as f64;
    let need =
        Need { effect: "direct light", needed: true, bound: None, why, cost_s: Some(cost_s) };
    Ok(Answer { need, part: Some((terms, Box::new(Direct))), doubt: None })
}

/// What looking at pairs costs.
pub(super) fn cost_of_pairs_s(question: &Question) -> f64 {
    let report = question.scene.report();
    // Where no list is kept, an index finds some ten for each facet.
    COSTS_S[1] * report.occluder_pairs.unwrap_or(10 * report.facets) as f64
}

/// The exact light of flat facets and spheres.
#[derive(Debug)]
struct Direct;

impl Part for Direct {
    fn worker<'a>(&'a self, scene: &'a Scene) -> Box<dyn Effect + 'a> {
        let found = vec![0.0; scene.weight_count()];
        Box::new(Exact { scene, evaluator: scene.evaluator(), found })
    }
}

struct Exact<'a> {
    scene: &'a Scene,
    evaluator: Evaluator<'a>,
    found: Vec<f64>,
}

impl Effect for Exact<'_> {
    fn add(
        &mut self,
        lighting: &Lighting,
        weights: &mut [f64],
        errors: &mut [f64],
    ) -> Result<(), DirectionError> {
        self.evaluator.direct(lighting.sun_body, lighting.view, &mut self.found)?;
        for (weight, found) in weights.iter_mut().zip(&self.found) {
            *weight += found;
        }
        for (material, error) in self.evaluator.errors().iter().enumerate() {
            let range = self.scene.weights_of(material);
            let (found, errors) = (&self.found[range.clone()], &mut errors[range]);
            let sum: f64 = found.iter().sum();
            for (error_k, found) in errors.iter_mut().zip(found) {
                // What is off is an area, and off for all weights of a facet alike. Of a sum of nothing any weight may be off.
                let share = if sum > 0.0 { found / sum } else { 1.0 };
                *error_k += error * share + 1e-15 * found;
            }
        }
        Ok(())
    }
}
