//! Reading a table: a header line with the names of the columns, then numbers, separated by commas; or a file of another program ([`Exchange`]), which its content tells.
//!
//! ```text
//! # what it is, where it comes from
//! theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,brdf_450nm_per_sr,brdf_650nm_per_sr
//! 30,0,28,180,1.25,1.31
//! ```

use super::{Exchange, Row};
use std::path::Path;
use sunglint_formats::ParseError;

const ANGLES: [&str; 4] = ["theta_i_deg", "phi_i_deg", "theta_o_deg", "phi_o_deg"];
const HINT: &str = "the columns are theta_i_deg, phi_i_deg, theta_o_deg, phi_o_deg, and brdf_per_sr with wavelength_nm as a key, or brdf_450nm_per_sr and so on";

/// Wavelengths \[nm\] and rows of a table; `wavelength_nm` is that of a column `brdf_per_sr`, which names none, or which of a foreign file's.
///
/// # Errors
/// A [`ParseError`] with line and column: a column that is missing or not known, a number that is none.
pub fn read(
    path: &Path,
    content: Vec<u8>,
    wavelength_nm: Option<f64>,
) -> Result<(Vec<f64>, Vec<Row>), ParseError> {
    if let Some(format) = Exchange::of(&content) {
        if format == Exchange::Rgl {
            let error = ParseError::new(path, "a tensor file of the RGL database", "a table");
            return Err(error.with_hint("it is model = \"measured\", which keeps its own grid"));
        }
        let found = format.read(path, &content, wavelength_nm)?;
        return Ok((found.wavelength_nm, found.rows));
    }
    let text = sunglint_formats::read::decode(path, content)?;
    let mut lines = text
        .lines()
        .enumerate()
        .map(|(k, line)| (k as u64 + 1, line.trim()))
        .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let Some((number, header)) = lines.next() else {
        return Err(ParseError::new(path, "no line", "a header line").with_hint(HINT));
    };
    let names: Vec<&str> = header.split(',').map(str::trim).collect();
    let column = |name: &str| names.iter().position(|n| *n == name);
    let mut angles = [0; 4];
    for (at, name) in angles.iter_mut().zip(ANGLES) {
        *at = column(name).ok_or_else(|| {
            let error = ParseError::new(path, format!("`{header}`"), format!("a column `{name}`"));
            error.at_line(number).with_hint(HINT)
        })?;
    }
    let mut values: Vec<(f64, usize)> = Vec::new();
    for (at, name) in names.iter().enumerate().filter(|(at, _)| !angles.contains(at)) {
        let nm = match name.strip_prefix("brdf_").and_then(|n| n.strip_suffix("_per_sr")) {
            Some(nm) => nm.strip_suffix("nm").and_then(|nm| nm.parse::<f64>().ok()),
            None if *name == "brdf_per_sr" => wavelength_nm,
            None => None,
        };
        let Some(nm) = nm else {
            let error = ParseError::new(path, format!("`{name}`"), "a column of values");
            return Err(error.at_line(number).with_hint(HINT));
        };
        values.push((nm, at));
    }
    if values.is_empty() {
        let error = ParseError::new(path, format!("`{header}`"), "a column of values");
        return Err(error.at_line(number).with_hint(HINT));
    }
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut rows = Vec::new();
    for (line, text) in lines {
        let cells: Vec<&str> = text.split(',').map(str::trim).collect();
        if cells.len() != names.len() {
            let found = format!("{} numbers", cells.len());
            let error = ParseError::new(path, found, format!("{} numbers", names.len()));
            return Err(error.at_line(line));
        }
        let get = |at: usize| {
            cells[at].parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| {
                let error = ParseError::new(path, format!("`{}`", cells[at]), "a number");
                error.at_line(line).in_field(names[at])
            })
        };
        rows.push(Row {
            theta_i_deg: get(angles[0])?,
            phi_i_deg: get(angles[1])?,
            theta_o_deg: get(angles[2])?,
            phi_o_deg: get(angles[3])?,
            brdf_per_sr: values.iter().map(|(_, at)| get(*at)).collect::<Result<_, _>>()?,
        });
    }
    Ok((values.iter().map(|v| v.0).collect(), rows))
}
