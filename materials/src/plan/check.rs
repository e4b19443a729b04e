//! A plan's table read again: what was planned, and what of it was not measured.

use crate::samples::{Samples, direction};
use glam::DVec3;
use std::path::Path;
use sunglint_formats::{ParseError, Table};

/// A measurement of a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Planned {
    /// Number of the step, from 1.
    pub step: usize,
    /// Polar angle of the light, degrees from the normal.
    pub theta_i_deg: f64,
    /// Azimuth of the light, degrees.
    pub phi_i_deg: f64,
    /// Polar angle of the detector, degrees from the normal.
    pub theta_o_deg: f64,
    /// Azimuth of the detector, degrees.
    pub phi_o_deg: f64,
}

/// The measurements of a plan's table, each once, in their order: with a rig at its marks, else at the cells' directions. And whether the plan is of a quarter of
/// the circle. `path` names the table in errors.
///
/// # Errors
/// Another kind of table, columns that are missing or in other units, angles that are no numbers.
pub fn planned(path: &Path, table: &Table) -> Result<(Vec<Planned>, bool), ParseError> {
    let bad = |field: &str, found: String, expected: &str| {
        ParseError::new(path, found, expected).in_field(field)
    };
    match table.meta_text("kind") {
        Some("brdf_plan") => {}
        other => {
            let found = other.map_or("none".to_owned(), |kind| format!("`{kind}`"));
            return Err(bad("kind", found, "`brdf_plan`, as `sunglint brdf plan` writes it"));
        }
    }
    let degrees = |name: &str| table.quantity(name, "deg").map_err(|e| e.in_file(path));
    let steps = table.f64("step").map_err(|e| e.in_file(path))?;
    let (theta_i, phi_i) = (degrees("theta_i_deg")?, degrees("phi_i_deg")?);
    let (theta_o, phi_o) = (degrees("theta_o_deg")?, degrees("phi_o_deg")?);
    let has_marks = table.columns.iter().any(|c| c.name == "mark_i_deg");
    let marks =
        if has_marks { Some((degrees("mark_i_deg")?, degrees("mark_o_deg")?)) } else { None };
    let mut rows: Vec<Planned> = Vec::new();
    for row in (0..table.rows()).filter(|row| steps[*row] >= 1.0) {
        let mut one = Planned {
            step: steps[row] as usize,
            theta_i_deg: theta_i[row],
            phi_i_deg: phi_i[row],
            theta_o_deg: theta_o[row],
            phi_o_deg: phi_o[row],
        };
        if let Some((mark_i, mark_o)) = &marks {
            // The detector's mark is negative on the light's side.
            one.theta_i_deg = mark_i[row];
            one.theta_o_deg = mark_o[row].abs();
            one.phi_o_deg = one.phi_i_deg + if mark_o[row] < 0.0 { 0.0 } else { 180.0 };
        }
        let angles = [one.theta_i_deg, one.phi_i_deg, one.theta_o_deg, one.phi_o_deg];
        if let Some(angle) = angles.iter().find(|a| !a.is_finite()) {
            let found = format!("{angle} in row {}", row + 1);
            return Err(bad("step", found, "angles for each measurement"));
        }
        rows.push(one);
    }
    let flag = |name: &str| table.meta.get(name).and_then(serde_json::Value::as_bool);
    if flag("isotropic").unwrap_or(false) && marks.is_none() {
        // One of a direction and its mirror images is measured.
        for one in &mut rows {
            let i = direction(one.theta_i_deg, 0.0);
            let o = direction(one.theta_o_deg, one.phi_o_deg - one.phi_i_deg);
            let o = super::representative(o, i.x.atan2(i.z));
            one.phi_o_deg = one.phi_i_deg + o.y.atan2(o.x).to_degrees();
        }
    }
    rows.sort_by_key(|p| p.step);
    rows.dedup_by_key(|p| p.step);
    Ok((rows, flag("quarter").unwrap_or(false)))
}

/// Returns the planned measurements that have no sample with a value above 0 within `tolerance_deg` of both directions, and the number of samples that belong to nothing that was planned. Of an
/// `isotropic` sample the azimuth between light and detector counts alone.
#[must_use]
pub fn missing(
    planned: &[Planned],
    samples: &Samples,
    isotropic: bool,
    tolerance_deg: f64,
) -> (Vec<Planned>, usize) {
    let near = 2.0 * (0.5 * tolerance_deg.to_radians()).sin();
    let turned = |i: DVec3, o: DVec3| {
        if !isotropic {
            return (i, o);
        }
        // An isotropic sample is the same on both sides of the plane of incidence.
        let (i, o) = crate::samples::turned(i, o);
        (i, DVec3::new(o.x, o.y.abs(), o.z))
    };
    let wanted: Vec<(DVec3, DVec3)> = planned
        .iter()
        .map(|p| {
            turned(direction(p.theta_i_deg, p.phi_i_deg), direction(p.theta_o_deg, p.phi_o_deg))
        })
        .collect();
    // By the light's height, so that only a few are compared.
    let mut order: Vec<usize> = (0..wanted.len()).collect();
    order.sort_by(|a, b| wanted[*a].0.z.total_cmp(&wanted[*b].0.z));
    let mut found = vec![false; planned.len()];
    let mut others = 0;
    for row in &samples.rows {
        let (i, o) = row.directions();
        let (i, o) = turned(i, o);
        let from = order.partition_point(|k| wanted[*k].0.z < i.z - near);
        let mut belongs = false;
        for k in order[from..].iter().take_while(|k| wanted[**k].0.z <= i.z + near) {
            let (wi, wo) = wanted[*k];
            if (wi - i).length() <= near && (wo - o).length() <= near {
                belongs = true;
                found[*k] |= row.brdf_per_sr.iter().all(|v| *v > 0.0);
            }
        }
        others += usize::from(!belongs);
    }
    let none = planned.iter().zip(&found).filter(|(_, found)| !**found);
    (none.map(|(p, _)| *p).collect(), others)
}
