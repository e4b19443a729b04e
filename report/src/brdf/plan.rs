//! Plan of the measurement of a sample: text, summary, table, hemispheres.

use super::goniometer::hours;
use super::hemispheres;
use crate::{Product, json_of, rounded};
use serde::Serialize;
use std::fmt::Write as _;
use sunglint_formats::text::counted;
use sunglint_materials::plan::{Chosen, Plan, to_table};
use sunglint_radiometry::light_curve::Input;

fn reachable(plan: &Plan) -> usize {
    plan.cells.iter().filter(|c| c.step.is_some()).count()
}

#[derive(Serialize)]
struct PlanJson<'a> {
    theta_i_deg: Vec<f64>,
    phi_i_deg: Vec<f64>,
    side: usize,
    wide: f64,
    cells: usize,
    reachable_cells: usize,
    steps: usize,
    travel_deg: f64,
    unordered_travel_deg: f64,
    rig: Option<RigJson>,
    budget: Option<BudgetJson>,
    inputs: &'a [Input],
}

#[derive(Serialize)]
struct BudgetJson {
    directions: usize,
    references: Option<usize>,
    instrument: Option<usize>,
    instrument_s: Option<f64>,
    estimate_s: Option<f64>,
}

impl BudgetJson {
    fn new(chosen: &Chosen) -> Self {
        let times = chosen.times;
        Self {
            directions: chosen.of,
            references: times.map(|t| t.references),
            instrument: times.map(|t| t.instrument),
            instrument_s: times.map(|t| rounded(t.own_s)),
            estimate_s: times.map(|t| rounded(t.total_s)),
        }
    }
}

#[derive(Serialize)]
struct RigJson {
    least_phase_deg: f64,
    most_theta_i_deg: f64,
    most_theta_o_deg: f64,
    mark_deg: f64,
}

/// All forms of the result.
pub fn product(made: &Plan, inputs: &[Input]) -> Product {
    let mut table = to_table(made);
    table.meta.insert("inputs".into(), json_of(&inputs));
    let reachable = reachable(made);
    let degrees =
        |values: &[f64]| values.iter().map(|v| rounded(v.to_degrees())).collect::<Vec<_>>();
    let json = json_of(&PlanJson {
        theta_i_deg: degrees(&made.theta_i_rad),
        phi_i_deg: degrees(&made.phi_i_rad),
        side: made.options.side,
        wide: made.options.wide,
        cells: made.cells.len(),
        reachable_cells: reachable,
        steps: made.steps.len(),
        travel_deg: rounded(made.travel_deg),
        unordered_travel_deg: rounded(made.unordered_travel_deg),
        rig: made.options.rig.map(|rig| RigJson {
            least_phase_deg: rig.least_phase_deg,
            most_theta_i_deg: rig.most_theta_i_deg,
            most_theta_o_deg: rig.most_theta_o_deg,
            mark_deg: rig.mark_deg,
        }),
        budget: made.chosen.as_ref().map(BudgetJson::new),
        inputs,
    });
    Product {
        name: "plan".into(),
        gallery: Some(hemispheres::gallery(made)),
        table,
        json,
        ..Product::default()
    }
}

/// The text.
pub fn text(plan: &Plan) -> String {
    let reachable = reachable(plan);
    let mut text = String::new();
    let count = plan.steps.len();
    let _ = match &plan.chosen {
        None => writeln!(
            text,
            "{count} measurements give {reachable} of {} cells of the file's grid",
            plan.cells.len()
        ),
        Some(chosen) => writeln!(
            text,
            "{count} of {} directions that the bench reaches: those that lower the doubt of all most",
            chosen.of
        ),
    };
    if let Some(times) = plan.chosen.and_then(|chosen| chosen.times) {
        let _ = writeln!(
            text,
            "about {} on the bench: {} for the directions with {} at the reference, {} for {} of the instrument itself",
            hours(times.total_s),
            hours(times.total_s - times.own_s),
            counted(times.references, "look"),
            hours(times.own_s),
            counted(times.instrument, "measurement"),
        );
    }
    for (p, phi) in plan.phi_i_rad.iter().enumerate() {
        for (t, theta) in plan.theta_i_rad.iter().enumerate() {
            let steps = plan.steps.iter().filter(|s| s.incident == [p, t]).count();
            if steps == 0 && plan.chosen.is_some() {
                continue;
            }
            let azimuth = match plan.phi_i_rad.len() {
                1 => String::new(),
                _ => format!(", azimuth {:7.2}°", phi.to_degrees()),
            };
            let theta = theta.to_degrees();
            let steps = counted(steps, "direction");
            let _ = writeln!(text, "  incidence {theta:6.2}°{azimuth}: {steps}");
        }
    }
    let _ = writeln!(
        text,
        "the detector travels {:.0}° (in the order of the cells {:.0}°)",
        plan.travel_deg, plan.unordered_travel_deg
    );
    text
}
