//! Whether the Earth's shadow is met.

use super::{Answer, Question};
use crate::light::{Need, SceneError};

pub(super) fn assess(question: &Question) -> Result<Answer, SceneError> {
    let course = question.course;
    let needed = course.shadow && (course.epochs == 0 || course.penumbra + course.umbra > 0);
    let (bound, why) = if !course.shadow {
        (Some(1.0), "switched off in [illumination]".to_owned())
    } else if course.epochs == 0 {
        (None, "looked at epoch by epoch".to_owned())
    } else if needed {
        let why = format!(
            "{} epochs in penumbra, {} in umbra: of the Sun's limb-darkened disc what is left; what the Earth's air changes there is in the errors of these epochs",
            course.penumbra, course.umbra
        );
        (None, why)
    } else {
        (Some(0.0), "no epoch is in the Earth's shadow".to_owned())
    };
    let need = Need { effect: "eclipse", needed, bound, why, cost_s: needed.then_some(1e-7) };
    Ok(Answer { need, part: None, doubt: None })
}
