//! Light that is reflected more than once.
//!
//! Of what a body gets from the Sun it reflects at most ρ, and of that at most a fraction F falls on the body again: F is taken from the geometry
//! alone ([`super::fill`]), under the Sun from where it is most. So the first bounce has at most ρF of the sunlight that the body gets, and all of them
//! ρF/(1 − ρF'), with F' that of the facet that sees most of the others. What a surface sends of it to an observer is at most that of its whole
//! reflectance. This bounds the light of the body as a whole, for facets whose light is even; a lobe sends its light to one side, and F is right for
//! it on the average over directions.

use super::fill::Fill;
use super::{Answer, Doubt, Options, Question, Seen};
use crate::light::{Need, SceneError};
use std::f64::consts::FRAC_1_PI;

pub(super) fn assess(question: &Question) -> Result<Answer, SceneError> {
    let (body, options) = (question.body, question.options);
    let switch = options.switches.inter_reflection;
    let most = body.most_reflectance();
    let fill = Fill::of(question.scene);
    let lobes = body.narrowest().is_some();
    let bound = most * fill.body / (1.0 - (most * fill.facet).min(0.999));
    let needed = bound > 0.0 && options.needs(switch, bound);
    let why = if fill.facet == 0.0 {
        "no surface sees another".to_owned()
    } else {
        let lobe = if lobes { " (of lobes on the average over directions)" } else { "" };
        format!(
            "up to {:.1} % of what the body sends may fall on itself{lobe}, of one facet up to {:.1} %; it reflects up to {:.1} %{}",
            100.0 * fill.body,
            100.0 * fill.facet,
            100.0 * most,
            Options::reason(switch)
        )
    };
    let need = Need { effect: "inter-reflection", needed, bound: Some(bound), why, cost_s: None };
    let doubt = (bound > 0.0).then(|| Box::new(Left { share: bound }) as Box<dyn Doubt>);
    Ok(Answer { need, part: None, doubt })
}

/// All bounces, left out.
#[derive(Debug)]
struct Left {
    share: f64,
}

impl Doubt for Left {
    fn add(&self, seen: &Seen, _: &[f64], _: &mut [f64], unknown: &mut [f64]) {
        for (error, area) in unknown.iter_mut().zip(&seen.area_m2) {
            *error += self.share * FRAC_1_PI * area;
        }
    }
}
