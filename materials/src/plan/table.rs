//! A plan as a table.

use super::{Cell, Plan};
use serde_json::json;
use sunglint_formats::{Column, Table, Values};

/// The table of a plan: a row a cell of the file's grid, in the order in which they are measured, then those that are not. Rows of one `step` are one measurement.
pub fn to_table(plan: &Plan) -> Table {
    let mut rows: Vec<&Cell> = plan.cells.iter().collect();
    rows.sort_by_key(|cell| (cell.step.is_none(), cell.step));
    let number = |of: &dyn Fn(&Cell) -> f64| rows.iter().map(|c| of(c)).collect::<Vec<f64>>();
    let degrees = |name: &str, of: &dyn Fn(&Cell) -> f64, about: &str| {
        Column::f64(name, Some("deg"), number(of)).described(about)
    };
    let index = |name: &str, k: usize| {
        Column::i64(name, None, rows.iter().map(|c| c.index[k] as i64).collect())
    };
    let step = |c: &&Cell| c.step.map(|step| step as i64 + 1);
    let mut columns = vec![
        Column {
            name: "step".into(),
            unit: None,
            description: Some("which measurement, from 1".into()),
            values: Values::I64(rows.iter().map(step).collect()),
        },
        degrees("theta_i_deg", &|c| plan.theta_i_rad[c.index[1]].to_degrees(), "of the light"),
        degrees("phi_i_deg", &|c| plan.phi_i_rad[c.index[0]].to_degrees(), "of the light"),
        degrees(
            "theta_o_deg",
            &|c| c.outgoing.truncate().length().atan2(c.outgoing.z).to_degrees(),
            "of the detector",
        ),
        degrees(
            "phi_o_deg",
            &|c| c.outgoing.y.atan2(c.outgoing.x).to_degrees(),
            "of the detector; the light's + 180 deg is opposite",
        ),
    ];
    if plan.options.rig.is_some() {
        let mark = |c: &Cell, which: usize| {
            let marks = c.step.and_then(|step| plan.steps[step].marks_deg);
            marks.map_or(f64::NAN, |marks| marks[which])
        };
        columns.push(degrees("mark_i_deg", &|c| mark(c, 0), "what the sample is set to"));
        columns.push(degrees(
            "mark_o_deg",
            &|c| mark(c, 1),
            "what the detector is set to, from the normal; negative on the light's side",
        ));
    }
    columns.push(Column::f64("u1", None, number(&|c| c.u[0])));
    columns.push(Column::f64("u2", None, number(&|c| c.u[1])));
    let names = ["index_phi_i", "index_theta_i", "index_row", "index_column"];
    columns.extend(names.into_iter().enumerate().map(|(k, name)| index(name, k)));
    columns.push(Column {
        name: "reachable".into(),
        unit: None,
        description: None,
        values: Values::Bool(rows.iter().map(|c| Some(c.step.is_some())).collect()),
    });
    let options = &plan.options;
    let rig = options.rig.map(|rig| {
        json!({
            "least_phase_deg": rig.least_phase_deg,
            "most_theta_i_deg": rig.most_theta_i_deg,
            "most_theta_o_deg": rig.most_theta_o_deg,
            "mark_deg": rig.mark_deg,
        })
    });
    let radians = |values: &[f64]| values.iter().map(|v| v.to_degrees()).collect::<Vec<f64>>();
    let meta = [
        ("kind", json!("brdf_plan")),
        ("theta_i_deg", json!(radians(&plan.theta_i_rad))),
        ("phi_i_deg", json!(radians(&plan.phi_i_rad))),
        ("side", json!(options.side)),
        ("normals", json!(options.normals)),
        ("wide", json!(options.wide)),
        ("quarter", json!(options.quarter)),
        ("isotropic", json!(plan.phi_i_rad.len() == 1)),
        ("rig", json!(rig)),
        ("steps", json!(plan.steps.len())),
        ("travel_deg", json!(plan.travel_deg)),
    ];
    let chosen = plan.chosen.map(|chosen| ("chosen_of", json!(chosen.of)));
    let meta = meta.into_iter().chain(chosen).map(|(key, value)| (key.to_owned(), value)).collect();
    Table { meta, columns }
}
