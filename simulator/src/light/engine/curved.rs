//! Curved surfaces: spheres, cylinders, cones and dishes are round, triangles with normals are bent, others are flat as they are given.

use super::{Answer, Question};
use crate::light::{Need, Scene, SceneError};

/// Seconds for a curved part that nothing shades, and for a bent triangle.
const COSTS_S: [f64; 2] = [1e-6, 5e-7];

pub(super) fn assess(question: &Question) -> Result<Answer, SceneError> {
    let report = question.scene.report();
    let round = report.spheres + report.curved;
    let needed = round + report.bent > 0;
    let (bound, why) = if !needed {
        let why = format!("none: {} facets are taken to be flat, as they are given", report.facets);
        (0.0, why)
    } else {
        let shaded = if report.no_occlusion {
            "nothing shades or hides them".to_owned()
        } else {
            format!(
                "divided where something shades or hides them, until {:.0e} is left",
                Scene::CURVED_TOLERANCE
            )
        };
        let why = format!(
            "{} spheres and {} cylinders, cones and dishes by integrals, {} triangles bent by their normals; {shaded}",
            report.spheres, report.curved, report.bent
        );
        (if report.no_occlusion && report.bent == 0 { 1e-9 } else { Scene::CURVED_TOLERANCE }, why)
    };
    let cost_s = needed.then_some(COSTS_S[0] * round as f64 + COSTS_S[1] * report.bent as f64);
    let need = Need { effect: "curved surfaces", needed, bound: Some(bound), why, cost_s };
    Ok(Answer { need, part: None, doubt: None })
}
