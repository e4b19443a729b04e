//! How many of the epochs differ.

use super::{Answer, Question};
use crate::light::{Need, SceneError};

pub(super) fn assess(question: &Question) -> Result<Answer, SceneError> {
    let course = question.course;
    let hinges = question.body.hinges.len();
    let needed = course.geometries != 1;
    let turning = match hinges {
        0 => String::new(),
        1 => "; a hinge turns".to_owned(),
        n => format!("; {n} hinges turn"),
    };
    let why = match course.epochs {
        0 => format!("looked at epoch by epoch{turning}"),
        n => format!(
            "{n} epochs, {} of them with geometries of their own{turning}",
            course.geometries
        ),
    };
    let need = Need {
        effect: "motion",
        needed,
        bound: if needed { None } else { Some(0.0) },
        why,
        cost_s: needed.then_some(0.0),
    };
    Ok(Answer { need, part: None, doubt: None })
}
