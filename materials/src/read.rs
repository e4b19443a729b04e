//! Tables of the lab, read from files: ECSV, FITS or plain columns.

use crate::exchange::{self, Exchange};
use crate::ndf::{self, Ndf};
use crate::samples::Samples;
use std::path::Path;
use sunglint_formats::fits::Fits;
use sunglint_formats::merl::{self, MerlBrdf};
use sunglint_formats::text_table::read_str;
use sunglint_formats::toml::Document;
use sunglint_formats::utia::{self, UtiaBrdf};
use sunglint_formats::{FileError, ParseError, Table, opus};
use sunglint_radiometry::light_curve::Input;

/// Why a table cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// A file that cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// A table that is not what it should be.
    #[error(transparent)]
    Parse(#[from] ParseError),
    /// A file that is no text.
    #[error("{file}: expected a table as UTF-8 text")]
    NoText {
        /// The file.
        file: String,
        /// Where it is none.
        source: std::string::FromUtf8Error,
    },
}

/// Reads measured values from a file: ECSV, FITS, plain columns, or what [`crate::exchange`] knows. `wavelength_nm` is that of a table that does not say it.
///
/// # Errors
/// A file that cannot be read, or holds no samples.
pub fn samples(
    path: &Path,
    wavelength_nm: Option<f64>,
) -> Result<(Samples, Vec<Input>), ReadError> {
    let is_fits = |e: &std::ffi::OsStr| ["fits", "fit"].iter().any(|f| e.eq_ignore_ascii_case(f));
    if path.extension().is_some_and(is_fits) {
        let bytes = sunglint_formats::read::bytes(path)?;
        let sha256 = sunglint_formats::sha256(&bytes);
        let fits = Fits::from_bytes(path, bytes)?;
        let inputs = vec![Input { file: path.display().to_string(), sha256 }];
        return Ok((Samples::from_fits(&fits)?, inputs));
    }
    let bytes = sunglint_formats::read::bytes(path)?;
    if let Some(format) = Exchange::of(&bytes) {
        let sha256 = sunglint_formats::sha256(&bytes);
        let inputs = vec![Input { file: path.display().to_string(), sha256 }];
        return Ok((exchange::read_bytes(path, &bytes, format, wavelength_nm)?, inputs));
    }
    if opus::is_opus(&bytes) {
        let error = ParseError::new(path, "a spectrum of Bruker OPUS", "BRDF values");
        let hint = "a spectrum is one direction: name it in an ingest.toml (docs/lab-values.md)";
        return Err(ReadError::Parse(error.with_hint(hint)));
    }
    if merl::has_header(&bytes) {
        MerlBrdf::from_bytes(path, &bytes)?;
    } else if utia::may_be_cut(&bytes) {
        UtiaBrdf::from_bytes(path, &bytes)?;
    }
    let is_own = bytes.windows(OWN.len()).any(|part| part == OWN.as_bytes());
    let (text, inputs) = text_of(path, bytes).map_err(|error| match error {
        ReadError::NoText { .. } => {
            let error = ParseError::new(path, "bytes that are no text", "measured values");
            ReadError::Parse(error.with_hint(READABLE))
        }
        error => error,
    })?;
    let found = read_str(path, &text)
        .and_then(|table| Samples::from_table(path, &table, wavelength_nm))
        .map_err(|error| match &error.hint {
            _ if is_own => error,
            Some(hint) => {
                let hint = format!("{hint}; {READABLE}");
                error.with_hint(hint)
            }
            None => error.with_hint(READABLE),
        })?;
    Ok((found, inputs))
}

/// A column that tables of our own have.
const OWN: &str = "theta_i_deg";
/// The formats of measured values, for people.
const READABLE: &str = "files that can be read: tables with the columns theta_i_deg, phi_i_deg, theta_o_deg, phi_o_deg and brdf_532nm_per_sr (CSV, ECSV, FITS), FRED, Zemax, ASTM E1392 and E2387, columns phi_i theta_i phi_o theta_o brdf, MERL, UTIA, RGL";

/// The format of another program that a file is in; `None` of our own tables, and of what is not there.
pub fn exchange_format(path: &Path) -> Option<Exchange> {
    Exchange::of(&sunglint_formats::read::bytes(path).ok()?)
}

/// Reads a table from a file, ECSV or plain columns.
///
/// # Errors
/// A file that cannot be read, or holds no table.
pub fn table(path: &Path) -> Result<(Table, Vec<Input>), ReadError> {
    let (text, inputs) = text(path)?;
    Ok((read_str(path, &text)?, inputs))
}

/// Reads a TOML document from a file.
///
/// # Errors
/// A file that cannot be read, or holds no TOML.
pub fn document(path: &Path) -> Result<(Document, Vec<Input>), ReadError> {
    let (text, inputs) = text(path)?;
    Ok((Document::new(path, text)?, inputs))
}

fn text(path: &Path) -> Result<(String, Vec<Input>), ReadError> {
    let bytes = std::fs::read(path).map_err(|e| FileError::io("read", path, e))?;
    text_of(path, bytes)
}

fn text_of(path: &Path, bytes: Vec<u8>) -> Result<(String, Vec<Input>), ReadError> {
    let sha256 = sunglint_formats::sha256(&bytes);
    let text = String::from_utf8(bytes).map_err(|source| {
        let file = path.display().to_string();
        ReadError::NoText { file, source }
    })?;
    let inputs = vec![Input { file: path.display().to_string(), sha256 }];
    Ok((text, inputs))
}

/// Reads the density of microfacet normals from a file.
///
/// # Errors
/// A file that cannot be read, or holds none.
pub fn density(path: &Path) -> Result<(Ndf, Vec<Input>), ReadError> {
    let (source, inputs) = table(path)?;
    Ok((ndf::from_table(path, &source)?, inputs))
}
