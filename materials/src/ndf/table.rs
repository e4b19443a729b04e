//! D as a table, and back.

use super::{Ndf, NdfFlags, Profile};
use crate::table::per_steradian;
use serde_json::{Value, json};
use std::path::Path;
use sunglint_formats::flag_bits::{Numbering, bit_names};
use sunglint_formats::{Column, Meta, ParseError, Table};

/// The table of an NDF: `theta_deg`, `phi_deg` (of an anisotropic sample), `d_per_sr`, `sigma_d_per_sr` (where it is known), `bound_d_per_sr`,
/// `sigma_projected`, `flags`.
pub fn to_table(ndf: &Ndf) -> Table {
    let (nt, np) = (ndf.theta_rad.len(), ndf.phi_rad.len());
    let theta: Vec<f64> = ndf.theta_rad.iter().map(|t| t.to_degrees()).collect();
    let sr = Some("1 / sr");
    let mut columns = vec![
        Column::f64("theta_deg", Some("deg"), theta.repeat(np))
            .described("angle of microfacets' normals from the surface's"),
    ];
    if !ndf.is_isotropic() {
        let phi = ndf.phi_rad.iter().flat_map(|p| std::iter::repeat_n(p.to_degrees(), nt));
        columns.push(
            Column::f64("phi_deg", Some("deg"), phi.collect())
                .described("azimuth; the same half a turn further"),
        );
    }
    columns.push(
        Column::f64("d_per_sr", sr, ndf.density.clone())
            .described("density D of microfacets' normals: ∫ D cos(theta) = 1"),
    );
    if let Some(sigma) = &ndf.density_sigma {
        columns.push(
            Column::f64("sigma_d_per_sr", sr, sigma.clone())
                .described("standard deviation by the readings"),
        );
    }
    columns
        .push(Column::f64("bound_d_per_sr", sr, ndf.density_bound.clone()).described(
            "largest change with other continuations beyond the last angle and in gaps",
        ));
    columns.push(
        Column::f64("sigma_projected", None, ndf.projected_area.clone())
            .described("projected area of microfacets towards that direction"),
    );
    let flags = ndf.flags.iter().map(|f| i64::from(f.bits())).collect();
    columns.push(Column::i64("flags", None, flags));
    Table { meta: meta(ndf), columns }
}

fn meta(ndf: &Ndf) -> Meta {
    let notes: Vec<String> = ndf.notes.iter().map(ToString::to_string).collect();
    let first = ndf.profiles.first();
    [
        ("kind", json!("ndf")),
        ("f0", json!(ndf.f0)),
        ("f0_sigma", json!(ndf.f0_sigma)),
        ("f0_bound", json!(ndf.f0_bound)),
        ("zero_deg", json!(first.map(|p| p.zero.angle_deg))),
        ("convergence", json!(ndf.convergence)),
        ("fits", json!(first.map(|p| json!({ "beckmann": p.beckmann, "ggx": p.ggx })))),
        ("profiles", json!(ndf.profiles)),
        ("smallest_alpha", json!(ndf.smallest_alpha)),
        ("resamplings", json!(ndf.resamplings)),
        ("notes", json!(notes)),
        ("flag_bits", bit_names::<NdfFlags>()),
    ]
    .into_iter()
    .map(|(key, value)| (key.to_owned(), value))
    .collect()
}

/// An NDF from its table, without its notes; `path` names it in errors.
///
/// # Errors
/// Another kind of table, columns that are missing, densities that are negative, directions that are no grid, metadata that are missing.
pub fn from_table(path: impl AsRef<Path>, table: &Table) -> Result<Ndf, ParseError> {
    from_table_at(path.as_ref(), table)
}

fn from_table_at(path: &Path, table: &Table) -> Result<Ndf, ParseError> {
    let bad = |field: &str, found: String, expected: &str| {
        ParseError::new(path, found, expected).in_field(field)
    };
    let kind = table.meta_text("kind").unwrap_or("no kind");
    if kind != "ndf" {
        let error = bad("kind", format!("`{kind}`"), "`ndf`");
        return Err(error.with_hint("`sunglint brdf ndf` makes such a table"));
    }
    let column = |name: &str, unit: &str| {
        table.quantity(name, unit).map(|c| c.into_owned()).map_err(|e| e.in_file(path))
    };
    let density = per_steradian(table, "d_per_sr").map_err(|e| e.in_file(path))?.into_owned();
    let projected_area = column("sigma_projected", "")?;
    let theta = column("theta_deg", "deg")?;
    let has = |name: &str| table.columns.iter().any(|c| c.name == name);
    let phi = if has("phi_deg") { column("phi_deg", "deg")? } else { vec![0.0; theta.len()] };
    let nt = phi.iter().take_while(|p| **p == phi[0]).count();
    let grid = |k: usize| theta[k] == theta[k % nt] && phi[k] == phi[k / nt * nt];
    let increasing = |v: &[f64]| v.windows(2).all(|pair| pair[0] < pair[1]);
    let azimuths: Vec<f64> = phi.iter().step_by(nt.max(1)).copied().collect();
    let is_grid = nt >= 4
        && theta.len() % nt == 0
        && (0..theta.len()).all(grid)
        && increasing(&theta[..nt])
        && increasing(&azimuths);
    if !is_grid {
        let found = format!("{} rows of which {nt} have the first azimuth", theta.len());
        return Err(bad("theta_deg", found, "elevations that increase, the same in each azimuth"));
    }
    let wrong = |v: &f64| !(v.is_finite() && *v >= 0.0);
    for (name, values) in [("d_per_sr", &density), ("sigma_projected", &projected_area)] {
        if let Some(at) = values.iter().position(wrong) {
            let found = format!("{} in row {}", values[at], at + 1);
            return Err(bad(name, found, "numbers of 0 or above"));
        }
    }
    let optional = |name: &str| {
        let values = has(name).then(|| per_steradian(table, name).map(|c| c.into_owned()));
        values.transpose().map_err(|e| e.in_file(path))
    };
    let numbering = Numbering::<NdfFlags>::read(path, table.meta.get("flag_bits"))?;
    let flags = match has("flags").then(|| table.i64("flags")) {
        None => vec![NdfFlags::empty(); theta.len()],
        Some(values) => values
            .map_err(|e| e.in_file(path))?
            .iter()
            .map(|v| numbering.flags(v.unwrap_or(0)))
            .collect::<Option<_>>()
            .ok_or_else(|| bad("flags", "a bit without a name".into(), "bits of `flag_bits`"))?,
    };
    let number = |key: &str| table.meta.get(key).and_then(Value::as_f64);
    let f0 = number("f0").ok_or_else(|| bad("f0", "no such metadata".into(), "a number"))?;
    let read = |key: &str| table.meta.get(key).cloned().unwrap_or(Value::Null);
    let convergence = serde_json::from_value(read("convergence"))
        .map_err(|e| bad("convergence", e.to_string(), "residual, iterations, eigenvalue_gap"))?;
    let profiles: Vec<Profile> = serde_json::from_value(read("profiles"))
        .map_err(|e| bad("profiles", e.to_string(), "the planes of incidence"))?;
    Ok(Ndf {
        theta_rad: theta[..nt].iter().map(|t| t.to_radians()).collect(),
        phi_rad: azimuths.iter().map(|p| p.to_radians()).collect(),
        density_sigma: optional("sigma_d_per_sr")?,
        density_bound: optional("bound_d_per_sr")?.unwrap_or_else(|| vec![0.0; density.len()]),
        density,
        projected_area,
        flags,
        f0,
        f0_sigma: number("f0_sigma"),
        f0_bound: number("f0_bound").unwrap_or(0.0),
        convergence,
        profiles,
        smallest_alpha: number("smallest_alpha"),
        resamplings: number("resamplings").map_or(0, |n| n as usize),
        notes: Vec::new(),
    })
}
