//! Files of spectra: CSV, JCAMP-DX and Bruker's OPUS.

use super::RawSpectrum;
use std::path::Path;
use sunglint_formats::opus::{self, OpusSpectrum, Quantity, Side};
use sunglint_formats::toml::Document;
use sunglint_formats::{FileError, ParseError, jcamp};

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
    /// Name of the values in the file.
    quantity: String,
}

/// A spectrum with what its file says of its axis and values.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Labelled {
    pub spectrum: RawSpectrum,
    /// Unit of the axis and quantity of the values, in words.
    pub label: String,
    /// The quantity, where it does not grow with the light.
    pub not_linear: Option<String>,
}

/// Reads a spectrum as [`read`] does, with what its file says of its axis and values.
pub(crate) fn read_labelled(path: &Path) -> Result<Labelled, FileError> {
    let (spectrum, factor, quantity) = read_columns(path, None)?;
    let axis = match factor {
        None => "cm-1".to_owned(),
        Some(factor) => format!("axis in units of {factor} nm"),
    };
    let quantity = quantity.trim().to_lowercase();
    // Logarithms, and what Kubelka and Munk made of a reflectance.
    let bent = ["absorbance", "log(1/r)", "kubelka"].iter().any(|word| quantity.contains(word));
    let not_linear = bent.then(|| quantity.clone());
    Ok(Labelled { spectrum, label: format!("{axis}, `{quantity}`"), not_linear })
}

/// Reads a spectrum: what its content says, OPUS, JCAMP-DX or CSV. Of several spectra in a file of OPUS that of the sample's light is taken.
///
/// # Errors
/// A file that cannot be read, a turning axis, gaps, no numbers: with file and line; a file of OPUS whose spectra leave a choice.
pub fn read(path: &Path) -> Result<RawSpectrum, FileError> {
    read_part(path, None)
}

/// [`read`], of a file of OPUS the spectrum of that name: `sample`, `reference`, `reflectance`, `transmittance`, `absorbance` or `emission`.
fn read_part(path: &Path, part: Option<&str>) -> Result<RawSpectrum, FileError> {
    Ok(read_columns(path, part)?.0)
}

/// A spectrum, the factor of its axis to nm (none of wavenumbers), and what its file calls its values.
fn read_columns(
    path: &Path,
    part: Option<&str>,
) -> Result<(RawSpectrum, Option<f64>, String), FileError> {
    let bytes = sunglint_formats::read::bytes(path)?;
    let columns = if opus::is_opus(&bytes) {
        of_opus(path, &bytes, part)?
    } else {
        if let Some(part) = part {
            let error = ParseError::new(path, format!("`#{part}`"), "a file of Bruker OPUS");
            return Err(FileError::from(error.with_hint("other files hold one spectrum")));
        }
        let text = sunglint_formats::read::decode(path, bytes)?;
        if text.trim_start().starts_with("##") {
            of_jcamp(path, &text)?
        } else {
            of_csv(path, &text)?
        }
    };
    let axis: Vec<f64> = columns.x.iter().map(|x| x * columns.factor.unwrap_or(1.0)).collect();
    let read = RawSpectrum::new(&axis, &columns.y, columns.factor.is_none()).map_err(|error| {
        let mut wrong = ParseError::new(path, error.to_string(), "a spectrum");
        if let Some(line) = error.row().and_then(|row| columns.line.get(row)) {
            wrong = wrong.at_line(*line);
        }
        wrong
    })?;
    let read = RawSpectrum { file: Some(path.display().to_string()), ..read };
    Ok((read, columns.factor, columns.quantity))
}

/// Names of the spectra of a file of OPUS, as a key has them after `#`.
const PARTS: [(&str, Quantity, Option<Side>); 6] = [
    ("sample", Quantity::Single, Some(Side::Sample)),
    ("reference", Quantity::Single, Some(Side::Reference)),
    ("reflectance", Quantity::Reflectance, None),
    ("transmittance", Quantity::Transmittance, None),
    ("absorbance", Quantity::Absorbance, None),
    ("emission", Quantity::Emission, None),
];

fn of_opus(path: &Path, bytes: &[u8], part: Option<&str>) -> Result<Columns, ParseError> {
    let file = opus::from_bytes(path, bytes)?;
    let named = |name: &str| {
        let (_, quantity, side) = PARTS.iter().find(|(known, ..)| *known == name)?;
        let is = |s: &&OpusSpectrum| s.quantity == *quantity && side.is_none_or(|d| s.side == d);
        file.spectra.iter().find(is)
    };
    let found = match (part, file.spectra.as_slice()) {
        (Some(part), _) => named(part),
        (None, [one]) => Some(one),
        (None, _) => named("sample"),
    };
    let Some(found) = found else {
        let there: Vec<String> = file.spectra.iter().map(OpusSpectrum::name).collect();
        let names: Vec<&str> =
            PARTS.iter().map(|(name, ..)| *name).filter(|name| named(name).is_some()).collect();
        let error = ParseError::new(path, there.join(", "), "one spectrum, or which of them");
        let hint = format!("say which: \"{}#{}\"", path.display(), names.join("\", \"#"));
        return Err(error.with_hint(hint));
    };
    let factor = match found.axis {
        opus::Axis::WavenumberPerCm => None,
        opus::Axis::WavelengthUm => Some(1e3),
    };
    let quantity = found.name();
    Ok(Columns { factor, x: found.x(), y: found.y(), line: Vec::new(), quantity })
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
    Ok(Columns { factor, x: read.x, y: read.y, line: read.line, quantity: read.y_unit })
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
    let mut columns = Columns {
        factor: *factor,
        x: Vec::new(),
        y: Vec::new(),
        line: Vec::new(),
        quantity: names[1].to_owned(),
    };
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
    // `a.0#sample` is a spectrum of a file.
    let is_part = |part: &str| PARTS.iter().any(|(known, ..)| *known == part);
    let (file, part) = match name.rsplit_once('#').filter(|(_, part)| is_part(part)) {
        Some((file, part)) => (file, Some(part)),
        None => (name, None),
    };
    read_part(&document.resolve(file), part).map_err(|source| NamedSpectrumError {
        file: document.path().display().to_string(),
        key: key.to_owned(),
        source: Box::new(source),
    })
}
