//! Files of spectra: CSV and JCAMP-DX.

use super::RawSpectrum;
use std::path::Path;
use sunglint_formats::toml::Document;
use sunglint_formats::{FileError, ParseError, jcamp};

/// First bytes of a file of Bruker's OPUS.
const OPUS: [u8; 4] = [0x0a, 0x0a, 0xfe, 0xfe];
/// Columns that are an axis: name, factor to nm (of wavenumbers none).
const AXES: [(&str, Option<f64>); 4] = [
    ("wavelength_nm", Some(1.0)),
    ("wavelength_um", Some(1e3)),
    ("wavelength_angstrom", Some(0.1)),
    ("wavenumber_per_cm", None),
];

struct Columns {
    factor: Option<f64>,
    x: Vec<f64>,
    y: Vec<f64>,
    line: Vec<u64>,
}

/// Reads a spectrum: what its content says, JCAMP-DX or CSV.
///
/// # Errors
/// A file that cannot be read or is of another kind (OPUS), a turning axis, gaps, no numbers: with file and line.
pub fn read(path: &Path) -> Result<RawSpectrum, FileError> {
    let bytes = sunglint_formats::read::bytes(path)?;
    if bytes.starts_with(&OPUS) {
        let error = ParseError::new(path, "a file of Bruker OPUS", "CSV or JCAMP-DX");
        let hint = "OPUS exports both: Save File As, Mode, Data point table or JCAMP-DX";
        return Err(FileError::from(error.with_hint(hint)));
    }
    let (path, text) = (path, sunglint_formats::read::decode(path, bytes)?);
    let columns = if text.trim_start().starts_with("##") {
        of_jcamp(path, &text)?
    } else {
        of_csv(path, &text)?
    };
    let axis: Vec<f64> = columns.x.iter().map(|x| x * columns.factor.unwrap_or(1.0)).collect();
    Ok(RawSpectrum::new(&axis, &columns.y, columns.factor.is_none()).map_err(|error| {
        let mut wrong = ParseError::new(path, error.to_string(), "a spectrum");
        if let Some(line) = error.row().and_then(|row| columns.line.get(row)) {
            wrong = wrong.at_line(*line);
        }
        wrong
    })?)
}

fn of_jcamp(path: &Path, text: &str) -> Result<Columns, ParseError> {
    let read = jcamp::read_str(path, text)?;
    let unit: String =
        read.x_unit.chars().filter(|c| !c.is_whitespace()).collect::<String>().to_uppercase();
    let factor = match unit.as_str() {
        "1/CM" | "CM-1" | "CM^-1" => None,
        "NANOMETERS" | "NANOMETRES" | "NM" => Some(1.0),
        "MICROMETERS" | "MICROMETRES" | "UM" => Some(1e3),
        _ => {
            let error = ParseError::new(
                path,
                format!("`{}`", read.x_unit),
                "1/CM, NANOMETERS or MICROMETERS",
            );
            return Err(error.in_field("XUNITS"));
        }
    };
    Ok(Columns { factor, x: read.x, y: read.y, line: read.line })
}

fn of_csv(path: &Path, text: &str) -> Result<Columns, ParseError> {
    let mut lines = text
        .lines()
        .enumerate()
        .map(|(k, line)| (k as u64 + 1, line.trim()))
        .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let expected = "two columns, the first wavelength_nm, wavelength_um, wavelength_angstrom or wavenumber_per_cm";
    let Some((number, header)) = lines.next() else {
        return Err(ParseError::new(path, "no line", expected));
    };
    let names: Vec<&str> = header.split(',').map(str::trim).collect();
    let axis = AXES.iter().find(|(name, _)| names.first() == Some(name));
    let (Some((_, factor)), 2) = (axis, names.len()) else {
        return Err(ParseError::new(path, format!("`{header}`"), expected).at_line(number));
    };
    let mut columns = Columns { factor: *factor, x: Vec::new(), y: Vec::new(), line: Vec::new() };
    for (number, line) in lines {
        let numbers: Option<Vec<f64>> = line.split(',').map(|t| t.trim().parse().ok()).collect();
        let Some([x, y]) = numbers.as_deref() else {
            let error = ParseError::new(path, format!("`{line}`"), "two numbers");
            return Err(error.at_line(number));
        };
        columns.x.push(*x);
        columns.y.push(*y);
        columns.line.push(number);
    }
    Ok(columns)
}

/// A key of a document names a spectrum that cannot be read.
#[derive(Debug, thiserror::Error)]
#[error("{file}: {key}")]
pub struct NamedSpectrumError {
    /// The document.
    pub file: String,
    /// The key.
    pub key: String,
    /// Why.
    pub source: Box<FileError>,
}

/// Reads a spectrum that a key of a document names.
pub(super) fn named(
    document: &Document,
    key: &str,
    name: &str,
) -> Result<RawSpectrum, NamedSpectrumError> {
    read(&document.resolve(name)).map_err(|source| NamedSpectrumError {
        file: document.path().display().to_string(),
        key: key.to_owned(),
        source: Box::new(source),
    })
}
