//! Albedos of the Earth as CSV: what spreadsheets and scripts write.
//!
//! `lat_deg,lon_deg,albedo`, a line a cell, in any order; `albedo_450nm,albedo_650nm,…` in place of `albedo` where they depend on the wavelength; without `lon_deg`
//! a table of zones. An empty value or `nan` is none. Lines that begin with `#` are notes. `wavelength_nm,albedo` is one spectrum for all of the Earth.

use super::EarthAlbedo;
use super::grid::{AlbedoGrid, Cells, WrongCell};
use std::path::Path;
use sunglint_formats::{ParseError, curve};
use sunglint_radiometry::spectrum::Spectrum;

const COLUMNS: &str = "lat_deg,lon_deg,albedo, or albedo_450nm and others in place of albedo; or wavelength_nm,albedo";

/// Reads a table; `missing` is the albedo of cells without a value. `path` names the text in errors.
///
/// # Errors
/// A [`ParseError`] with line and column: other columns, a number that is none, and what [`AlbedoGrid::new`] refuses.
pub fn parse(path: &Path, text: &str, missing: Option<f64>) -> Result<EarthAlbedo, ParseError> {
    let mut lines = text.lines().zip(1_u64..).filter(|(line, _)| {
        let line = line.trim();
        !line.is_empty() && !line.starts_with('#')
    });
    let Some((head, head_line)) = lines.next() else {
        return Err(ParseError::new(path, "no line", COLUMNS));
    };
    let names: Vec<&str> = head.trim_start_matches('\u{feff}').split(',').map(str::trim).collect();
    if names[0].starts_with("wavelength") {
        return spectrum(path, text);
    }
    let columns = Columns::of(&names).map_err(|e| at(path, e).at_line(head_line))?;
    let (mut cells, mut own) = (Cells::default(), Vec::new());
    for (line, number) in lines {
        let fields: Vec<&str> = line.split(',').map(str::trim).collect();
        if fields.len() != names.len() {
            let found = format!("{} fields", fields.len());
            let expected = format!("{} fields, one for each column", names.len());
            return Err(ParseError::new(path, found, expected).at_line(number));
        }
        let value = |column: usize| match fields[column] {
            "" => Ok(f64::NAN),
            text => text.parse::<f64>().map_err(|_| {
                ParseError::new(path, text, "a number").at_line(number).in_field(names[column])
            }),
        };
        let lon = columns.lon.map_or(Ok(0.0), value)?;
        cells.places_deg.push([value(columns.lat)?, lon]);
        for column in &columns.albedo {
            cells.albedo.push(value(*column)?);
        }
        own.push(number);
    }
    let grid = AlbedoGrid::new(&cells, &columns.wavelength_nm, columns.lon.is_none(), missing);
    let grid = grid.map_err(|wrong| {
        let line = wrong.cell.map(|cell| own[cell]);
        let error = at(path, wrong);
        line.map_or(error.clone(), |line| error.at_line(line))
    })?;
    Ok(EarthAlbedo::tabulated(path.display().to_string(), grid))
}

/// Where the columns are.
struct Columns {
    lat: usize,
    lon: Option<usize>,
    albedo: Vec<usize>,
    wavelength_nm: Vec<f64>,
}

impl Columns {
    fn of(names: &[&str]) -> Result<Self, WrongCell> {
        let wrong = |found: String| WrongCell {
            cell: None,
            field: "the columns",
            found,
            expected: COLUMNS.into(),
            hint: None,
        };
        let mut found =
            Self { lat: usize::MAX, lon: None, albedo: Vec::new(), wavelength_nm: Vec::new() };
        for (number, name) in names.iter().enumerate() {
            if names[..number].contains(name) {
                return Err(wrong(format!("{name} twice")));
            }
            let nm = name.strip_prefix("albedo_").and_then(|rest| rest.strip_suffix("nm"));
            match (*name, nm.and_then(|nm| nm.trim_end_matches('_').parse::<f64>().ok())) {
                ("lat_deg", _) => found.lat = number,
                ("lon_deg", _) => found.lon = Some(number),
                ("albedo", _) => found.albedo.push(number),
                (_, Some(nm)) => {
                    found.albedo.push(number);
                    found.wavelength_nm.push(nm);
                }
                _ => return Err(wrong((*name).to_owned())),
            }
        }
        let grey = found.wavelength_nm.is_empty() && found.albedo.len() == 1;
        let coloured = found.wavelength_nm.len() == found.albedo.len() && !found.albedo.is_empty();
        if found.lat == usize::MAX || !(grey || coloured) {
            return Err(wrong(names.join(",")));
        }
        Ok(found)
    }
}

/// One spectrum for all of the Earth.
fn spectrum(path: &Path, text: &str) -> Result<EarthAlbedo, ParseError> {
    let curve = curve::read_str(path, text, Some("albedo"))?;
    let wrong = curve.y.iter().position(|y| !(0.0..=1.0).contains(y));
    if let Some(row) = wrong {
        let error = ParseError::new(path, curve.y[row].to_string(), "an albedo from 0 to 1");
        return Err(error.at_line(curve.line(row)).in_field("albedo"));
    }
    let spectrum = Spectrum::new(curve.x, curve.y);
    let spectrum = spectrum.map_err(|e| ParseError::new(path, e.to_string(), "a spectrum"))?;
    Ok(EarthAlbedo::coloured(spectrum))
}

/// Returns the fault as an error with the file's name.
pub(super) fn at(path: &Path, wrong: WrongCell) -> ParseError {
    let error = ParseError::new(path, wrong.found, wrong.expected).in_field(wrong.field);
    match wrong.hint {
        Some(hint) => error.with_hint(hint),
        None => error,
    }
}
