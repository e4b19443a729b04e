//! Light that is reflected more than once.
//!
//! If no point of a body has more than a fraction F of its hemisphere (weighted with the cosine) filled by the rest of the body, and nothing reflects more
//! than ρ, then the first bounce brings at most ρF of full sunlight to any point, the second (ρF)², and all of them ρF/(1 − ρF). What a
//! surface sends of it to an observer is at most that of its whole reflectance. This holds for diffuse light; a lobe may send all its light into whatever
//! else is there: its F is 1 unless that is nothing. (A lobe that concentrates light may bring more than ρF to a point; over the body it
//! does not.)

use super::{Answer, Doubt, Options, Question, Seen, fill};
use crate::light::{Need, SceneError};
use std::f64::consts::FRAC_1_PI;

pub(super) fn assess(question: &Question) -> Result<Answer, SceneError> {
    let (body, options) = (question.body, question.options);
    let switch = options.switches.inter_reflection;
    let most = body.most_reflectance();
    let filled = fill::largest(question.scene);
    let lobes = body.narrowest().is_some();
    let fraction = if lobes && filled > 0.0 { 1.0 } else { filled };
    let first = (most * fraction).min(1.0);
    let bound = if first < 1.0 { first / (1.0 - first) } else { f64::INFINITY };
    let needed = bound > 0.0 && options.needs(switch, bound);
    let why = if filled == 0.0 {
        "no surface sees another".to_owned()
    } else {
        let lobe = if lobes { "; lobes may send all of their light there" } else { "" };
        format!(
            "up to {:.0} % of a surface's sky is filled by others{lobe}; they reflect up to {:.3} %{}",
            100.0 * filled,
            100.0 * most,
            Options::reason(switch)
        )
    };
    let need = Need { effect: "inter-reflection", needed, bound: Some(bound), why, cost_s: None };
    // Of what has no bound, more than all light is not said.
    let doubt = (bound > 0.0).then(|| Box::new(Left { share: bound.min(1e3) }) as Box<dyn Doubt>);
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
