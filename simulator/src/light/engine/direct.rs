//! Light that comes from the Sun and is scattered once.

use super::{Answer, Part, Question};
use crate::light::{DirectionError, Effect, Evaluator, Lighting, Need, Scene, SceneError, Source};

/// Seconds for a facet, for a pair of a facet and what may hide it, for a sphere: of a core of about 3 GHz.
const COSTS_S: [f64; 3] = [5e-8, 2e-8, 1e-7];

/// Share of the tolerance that the quadrature over facets seen from a point may take.
const OF_TOLERANCE: f64 = 1e-3;

pub(super) fn assess(question: &Question) -> Result<Answer, SceneError> {
    let scene = question.scene;
    let report = scene.report();
    let terms = scene.terms()?;
    let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    let areas = match &report.sampling {
        Some(sampling) => format!("areas found at {} points or more", sampling.points),
        None => "areas exact".to_owned(),
    };
    let why = format!(
        "{} and {}, {} before weights; {areas}",
        count(report.facets, "flat facet"),
        count(report.spheres, "sphere"),
        count(terms.len(), "spectrum").replace("spectrums", "spectra"),
    );
    let cost_s = COSTS_S[0] * report.facets as f64 + COSTS_S[2] * report.spheres as f64;
    let need =
        Need { effect: "direct light", needed: true, bound: None, why, cost_s: Some(cost_s) };
    Ok(Answer {
        need,
        part: Some((
            terms,
            Box::new(Direct {
                disc: super::disc::is_modelled(question),
                near_tolerance: OF_TOLERANCE * question.options.tolerance,
            }),
        )),
        doubt: None,
    })
}

/// Estimates the cost of one direction of light, s, shadows included.
pub(super) fn cost_s(question: &Question) -> f64 {
    let report = question.scene.report();
    let facets = COSTS_S[0] * report.facets as f64 + COSTS_S[2] * report.spheres as f64;
    facets + cost_of_pairs_s(question)
}

/// Estimates the cost of looking at pairs, s.
pub(super) fn cost_of_pairs_s(question: &Question) -> f64 {
    let report = question.scene.report();
    // Where no list is kept, an index finds some ten for each facet.
    COSTS_S[1] * report.occluder_pairs.unwrap_or(10 * report.facets) as f64
}

/// Light that is scattered once, under the Sun's disc where the scene has one.
#[derive(Debug)]
struct Direct {
    /// Whether the disc is wanted in full light too, not only in partial eclipses.
    disc: bool,
    /// Tolerance for facets that are seen from a point.
    near_tolerance: f64,
}

impl Part for Direct {
    fn source(&self) -> Source {
        Source::Direct
    }

    fn worker<'a>(&'a self, scene: &'a Scene) -> Box<dyn Effect + 'a> {
        let row = vec![0.0; scene.term_count()];
        let (weights, errors) = (row.clone(), row);
        let mut evaluator = scene.evaluator();
        evaluator.set_near_tolerance(self.near_tolerance);
        Box::new(Once { disc: self.disc, evaluator, weights, errors })
    }
}

struct Once<'a> {
    disc: bool,
    evaluator: Evaluator<'a>,
    weights: Vec<f64>,
    errors: Vec<f64>,
}

impl Effect for Once<'_> {
    fn add(
        &mut self,
        lighting: &Lighting,
        weights: &mut [f64],
        errors: &mut [f64],
    ) -> Result<(), DirectionError> {
        let mut lighting = *lighting;
        if !self.disc && lighting.shadow.is_none() {
            lighting.sun_radius_rad = 0.0;
        }
        self.evaluator.light(&lighting, &mut self.weights, &mut self.errors)?;
        let found = self.weights.iter().zip(&self.errors);
        for ((weight, error), (w, e)) in weights.iter_mut().zip(errors).zip(found) {
            *weight += w;
            *error += e + 1e-15 * w.abs();
        }
        Ok(())
    }
}
