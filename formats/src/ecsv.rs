//! ECSV (Astropy Proposal for Enhancement 6): interim reader, to be replaced by the full one.

use crate::error::ParseError;
use crate::table::{Column, Meta, Table, Values};
use std::path::Path;

/// Reads an ECSV text. `path` names it in errors.
pub fn read_str(path: impl AsRef<Path>, text: &str) -> Result<Table, ParseError> {
    let path = path.as_ref();
    let mut units: Vec<(String, String, Option<String>)> = Vec::new();
    let mut meta = Meta::new();
    for line in text.lines().take_while(|l| l.starts_with('#')) {
        if let Some(rest) = line.strip_prefix("# - {name: ") {
            let get = |key: &str| {
                rest.split_once(key).map(|(_, r)| {
                    r.split([',', '}']).next().unwrap_or("").trim().trim_matches('\'').to_owned()
                })
            };
            let name = rest.split([',', '}']).next().unwrap_or("").to_owned();
            units.push((name, get("datatype: ").unwrap_or_default(), get("unit: ")));
        } else if let Some(rest) = line.strip_prefix("# - ")
            && let Some((k, v)) = rest.split_once(": ")
        {
            meta.insert(k.trim_start_matches('{').into(), v.trim_matches(['"', '}']).into());
        }
    }
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(text.as_bytes());
    let bad = |e: csv::Error| ParseError::new(path, e.to_string(), "comma-separated values");
    let headers: Vec<String> = reader.headers().map_err(bad)?.iter().map(str::to_owned).collect();
    let mut cells: Vec<Vec<String>> = vec![Vec::new(); headers.len()];
    for record in reader.records() {
        for (cell, value) in cells.iter_mut().zip(record.map_err(bad)?.iter()) {
            cell.push(value.to_owned());
        }
    }
    let columns = headers
        .into_iter()
        .zip(cells)
        .map(|(name, cells)| {
            let info = units.iter().find(|u| u.0 == name);
            let values = match info.map(|u| u.1.as_str()) {
                Some("string") => {
                    Values::Text(cells.into_iter().map(|c| (!c.is_empty()).then_some(c)).collect())
                }
                Some("int64") => Values::I64(cells.iter().map(|c| c.parse().ok()).collect()),
                _ => Values::F64(cells.iter().map(|c| c.parse().unwrap_or(f64::NAN)).collect()),
            };
            Column { name, unit: info.and_then(|u| u.2.clone()), description: None, values }
        })
        .collect();
    Ok(Table { meta, columns })
}
