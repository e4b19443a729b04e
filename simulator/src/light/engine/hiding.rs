//! Whether one surface may stand before another.

use super::{Answer, Question, direct};
use crate::light::{Need, SceneError};

pub(super) fn assess(question: &Question) -> Result<Answer, SceneError> {
    let report = question.scene.report();
    let needed = !report.no_occlusion;
    let why = if report.convex {
        "one convex closed body: it hides nothing of itself".to_owned()
    } else if !needed {
        "no surface stands before any other".to_owned()
    } else {
        let pairs = match report.occluder_pairs {
            Some(pairs) => format!("{pairs} pairs of a facet and what may hide it"),
            None => "an index of what may hide what, made for each direction".to_owned(),
        };
        let closed = if report.closed { "closed" } else { "with open sheets" };
        format!("not convex, {closed}: {pairs}, {} solids hide by their outline", report.solids)
    };
    let bound = if needed { None } else { Some(0.0) };
    let cost_s = needed.then(|| direct::cost_of_pairs_s(question));
    let need = Need { effect: "hiding and shadows", needed, bound, why, cost_s };
    Ok(Answer { need, part: None, doubt: None })
}
