//! Curved surfaces: spheres are, meshes are taken as the flat facets that they are.

use super::{Answer, Question};
use crate::light::{Need, SceneError};

pub(super) fn assess(question: &Question) -> Result<Answer, SceneError> {
    let report = question.scene.report();
    let needed = report.spheres > 0;
    let (bound, why) = if !needed {
        (
            Some(0.0),
            format!("none: {} facets are taken to be flat, as they are given", report.facets),
        )
    } else if report.sphere_faceting > 0.0 {
        let error = report.sphere_faceting;
        (
            Some(error),
            format!(
                "{} spheres in closed form; where something shades or hides one, the share that is left is found with flat facets, to {:.1} % of the geometric mean of what is hidden and what is not",
                report.spheres,
                100.0 * error
            ),
        )
    } else {
        (Some(1e-9), "a sphere, in closed form".to_owned())
    };
    let cost_s = needed.then_some(1e-7 * report.spheres as f64);
    let need = Need { effect: "curved surfaces", needed, bound, why, cost_s };
    Ok(Answer { need, part: None, doubt: None })
}
