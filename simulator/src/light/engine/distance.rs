//! Lines of sight that are not parallel.
//!
//! A part at s from the body's origin sees an observer at r turned by up to s/r; a lobe changes by t/α of itself with each radian that the
//! observer moves, a diffuse surface by the tangent of its angle.

use super::{Answer, Doubt, Options, Question, Seen};
use crate::light::{Need, SceneError};

/// t where a Beckmann lobe has fallen to 1e-3 of its peak.
const WING: f64 = 2.6;
/// The tangent of 63°: what a diffuse surface is taken at.
const OBLIQUE: f64 = 2.0;

fn bound(question: &Question) -> f64 {
    let angle_rad = question.body.size_m / question.course.range_m;
    let slope = match question.body.narrowest() {
        Some((_, alpha)) if alpha > 0.0 => {
            OBLIQUE.max(WING / alpha / (0.5 * question.course.phase_rad).cos().max(1e-9))
        }
        _ => OBLIQUE,
    };
    (angle_rad * slope).min(1.0)
}

/// Whether the observer is to stand at a point.
pub(super) fn is_needed(question: &Question) -> bool {
    question.options.needs(question.options.switches.finite_distance, bound(question))
}

pub(super) fn assess(question: &Question) -> Result<Answer, SceneError> {
    let (needed, bound) = (is_needed(question), bound(question));
    let body = question.body;
    let why = format!(
        "{:.2} m from its origin at the farthest, seen from {:.0} km at the nearest: directions differ by up to {:.1e} rad{}",
        body.size_m,
        question.course.range_m * 1e-3,
        body.size_m / question.course.range_m,
        Options::reason(question.options.switches.finite_distance)
    );
    // The quadrature of a facet takes some ten evaluations.
    let cost_s = needed.then_some(5e-7 * question.scene.report().facets as f64);
    let need = Need { effect: "finite distance", needed, bound: Some(bound), why, cost_s };
    let alphas = body.glosses.iter().map(|g| g.lobe.map_or(0.0, |l| l.1)).collect();
    let parallel = Parallel { angle_rad: body.size_m / question.course.range_m, alphas };
    let doubt = (!needed).then(|| Box::new(parallel) as Box<dyn Doubt>);
    Ok(Answer { need, part: None, doubt })
}

/// Parallel lines of sight in place of those that meet.
#[derive(Debug)]
struct Parallel {
    angle_rad: f64,
    alphas: Vec<f64>,
}

impl Doubt for Parallel {
    fn add(&self, seen: &Seen, weights: &[f64], errors: &mut [f64], _: &mut [f64]) {
        seen.add_shares(weights, errors, |m| {
            let alpha = self.alphas[m];
            let slope = if alpha > 0.0 {
                seen.off_lobe[m].1 / alpha / seen.half_cos.max(1e-9)
            } else {
                0.0
            };
            self.angle_rad * slope.max(OBLIQUE)
        });
    }
}
