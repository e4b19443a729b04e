//! Tables as other programs and laboratories write them: FRED, Zemax, ASTM E1392 and E2387, the columns of *Scatterworks* tables as Fankhauser et al. (2023) published them, and the MERL, UTIA and RGL databases' files.
//!
//! Which it is follows from the content, never from the ending: Zemax's `.bsdf` is text, ours and Mitsuba's is a tensor file.

mod database;

use super::Row;
use glam::DVec3;
use serde::Serialize;
use std::path::Path;
use sunglint_formats::ParseError;
use sunglint_formats::astm::{self, AstmScatter};
use sunglint_formats::fred::{self, FredIncidence, FredRow, FredScatter};
use sunglint_formats::zemax::{self, ZemaxBsdf};
use sunglint_formats::{merl, utia};

/// A format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Exchange {
    /// FRED's tabular scatter data.
    Fred,
    /// Zemax OpticStudio's tabular BSDF.
    Zemax,
    /// ASTM E1392 and E2387, in the layout with a line `VARS`.
    Astm,
    /// Columns `phi_i theta_i phi_o theta_o brdf`, where phi is the angle from the normal.
    Columns,
    /// A file of the MERL database.
    Merl,
    /// A file of the UTIA database.
    Utia,
    /// A tensor file of the RGL database, which Mitsuba 3 reads and writes.
    Rgl,
}

/// Values of a file in one of these formats.
#[derive(Debug, Clone, PartialEq)]
pub struct ForeignRows {
    /// Vacuum wavelengths, nm, increasing.
    pub wavelength_nm: Vec<f64>,
    /// True where the file has colours, not wavelengths: these are the dominant wavelengths of sRGB's primaries.
    pub colours: bool,
    /// In the order of the file; azimuths are this program's: the mirrored light is at the light's + 180°.
    pub rows: Vec<Row>,
    /// Directions above the horizon that hold no value.
    pub missing: usize,
    /// Hemispherical reflectance that the file states (Zemax's TIS): angle of incidence, degrees, and value.
    pub tis: Vec<(f64, f64)>,
    /// Changes that were made to the values in reading, for people.
    pub remarks: Vec<String>,
}

impl Exchange {
    /// The format of a file by its content, if it is one of these.
    pub fn of(content: &[u8]) -> Option<Self> {
        if content.starts_with(b"tensor_file\0") {
            return Some(Self::Rgl);
        } else if merl::is_merl(content) {
            return Some(Self::Merl);
        } else if utia::is_utia(content) {
            return Some(Self::Utia);
        }
        let text = std::str::from_utf8(content).ok()?;
        if fred::is_fred(text) {
            Some(Self::Fred)
        } else if zemax::is_zemax(text) {
            Some(Self::Zemax)
        } else if astm::is_astm(text) {
            Some(Self::Astm)
        } else if columns_header(text) {
            Some(Self::Columns)
        } else {
            None
        }
    }

    /// Returns the name of the format for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fred => "FRED",
            Self::Zemax => "Zemax",
            Self::Astm => "ASTM",
            Self::Columns => "columns phi_i theta_i phi_o theta_o brdf",
            Self::Merl => "MERL",
            Self::Utia => "UTIA",
            Self::Rgl => "RGL",
        }
    }

    /// Reads a file in this format. `wavelength_nm` is that of a file that does not say it, or which of several.
    ///
    /// # Errors
    /// The errors of the format's reader; light that was transmitted; a wavelength that neither file nor caller gives, or that the file lacks; no value.
    pub fn read(
        self,
        path: &Path,
        content: &[u8],
        wavelength_nm: Option<f64>,
    ) -> Result<ForeignRows, ParseError> {
        if let Some(nm) = wavelength_nm.filter(|nm| !(nm.is_finite() && *nm > 1.0)) {
            return Err(ParseError::new(path, format!("{nm} nm"), "a wavelength in nm"));
        }
        let text = || {
            let text = std::str::from_utf8(content);
            text.map_err(|_| ParseError::new(path, "bytes that are no text", "text in UTF-8"))
        };
        let (mut tis, mut remarks) = (Vec::new(), Vec::new());
        let (rows, of_file, missing) = match self {
            Self::Fred => (from_fred(&fred::read_str(path, text()?)?), None, 0),
            Self::Zemax => {
                let file = zemax::read_str(path, text()?)?;
                let (rows, missing) = from_zemax(path, &file)?;
                tis = file.incidence_deg.iter().copied().zip(file.tis.iter().copied()).collect();
                (rows, None, missing)
            }
            Self::Astm => {
                let file = astm::read_str(path, text()?)?;
                let (rows, column) = from_astm(path, &file, wavelength_nm)?;
                if is_cosine_corrected(&file.names[column]) {
                    remarks.push(format!(
                        "{}: cosine-corrected values (ASTM E2387) are divided by the cosine of the scattered light's angle",
                        file.names[column]
                    ));
                }
                (rows, file.wavelength_nm(column), 0)
            }
            Self::Columns => {
                let said = said_wavelength(text()?);
                if let (Some(said), Some(asked)) = (said, wavelength_nm)
                    && (said - asked).abs() >= SAME_NM
                {
                    let found = format!("the wavelength {said} nm");
                    let error =
                        ParseError::new(path, found, format!("{asked} nm, which was asked for"));
                    return Err(error.with_hint("leave the wavelength out: the file says its own"));
                }
                (from_columns(path, text()?)?, said, 0)
            }
            Self::Merl | Self::Utia | Self::Rgl => {
                let found = database::read(self, path, content)?;
                return some(path, database::picked(path, found, wavelength_nm)?);
            }
        };
        let Some(nm) = wavelength_nm.or(of_file) else {
            let error = ParseError::new(path, "no wavelength", "the wavelength of its values");
            let hint = "say it: --wavelength-nm 650, or wavelength_nm = 650 in a scene";
            return Err(error.with_hint(hint));
        };
        some(
            path,
            ForeignRows { wavelength_nm: vec![nm], colours: false, rows, missing, tis, remarks },
        )
    }
}

/// Refuses what holds no value.
fn some(path: &Path, found: ForeignRows) -> Result<ForeignRows, ParseError> {
    if found.rows.is_empty() {
        return Err(ParseError::new(path, "no value", "measured values"));
    }
    Ok(found)
}

fn row(theta_i_deg: f64, phi_i_deg: f64, theta_o_deg: f64, phi_o_deg: f64, f: f64) -> Row {
    Row { theta_i_deg, phi_i_deg, theta_o_deg, phi_o_deg, brdf_per_sr: vec![f] }
}

/// FRED has the azimuth of scattered light 0 on the mirrored side; ours is the light's + 180° there.
fn from_fred(file: &FredScatter) -> Vec<Row> {
    let of = |i: &FredIncidence| {
        let (theta, phi) = (i.theta_deg, i.phi_deg + 180.0);
        let one = move |r: &FredRow| row(theta, phi, r.theta_deg, r.phi_deg, r.bsdf_per_sr);
        i.rows.iter().map(one).collect::<Vec<_>>()
    };
    file.incidences.iter().flat_map(of).collect()
}

/// Wavelengths closer than this are the same, nm.
const SAME_NM: f64 = 0.5;

/// The values of a wavelength, and which column they are; where it is not asked for the file must have one column only.
fn from_astm(
    path: &Path,
    file: &AstmScatter,
    wavelength_nm: Option<f64>,
) -> Result<(Vec<Row>, usize), ParseError> {
    let said: Vec<Option<f64>> = (0..file.names.len()).map(|k| file.wavelength_nm(k)).collect();
    let column = match (said.as_slice(), wavelength_nm) {
        ([_], None) | ([None], Some(_)) => Some(0),
        (_, Some(nm)) => said.iter().position(|s| s.is_some_and(|s| (s - nm).abs() < SAME_NM)),
        _ => None,
    };
    let Some(column) = column else {
        let error = ParseError::new(path, file.names.join(", "), "one of its wavelengths");
        return Err(error.with_hint("say which: --wavelength-nm 532, or wavelength_nm in a scene"));
    };
    let corrected = is_cosine_corrected(&file.names[column]);
    let one = |r: &astm::AstmRow| {
        let [theta_i, phi_i, theta_s, phi_s] = r.angles_rad.map(f64::to_degrees);
        let cos = if corrected { r.angles_rad[2].cos() } else { 1.0 };
        // At the horizon nothing is left of what was multiplied by 0.
        (cos > 1e-6).then(|| row(theta_i, phi_i, theta_s, phi_s, r.bsdf_per_sr[column] / cos))
    };
    Ok((file.rows.iter().filter_map(one).collect(), column))
}

/// Whether a column holds the BSDF times the cosine of the scattered light's angle (`ccBSDF`).
fn is_cosine_corrected(name: &str) -> bool {
    let name = name.to_lowercase();
    ["ccbsdf", "ccbrdf", "cc_bsdf", "cc_brdf", "cosine"].iter().any(|word| name.contains(word))
}

/// The direction at a radial angle and an azimuth about the mirrored ray of light with the azimuth 180°: 0 towards the normal.
fn about_mirrored(theta_i_deg: f64, azimuth_deg: f64, radial_deg: f64) -> DVec3 {
    let (sin_i, cos_i) = theta_i_deg.to_radians().sin_cos();
    let (sin_r, cos_r) = radial_deg.to_radians().sin_cos();
    let (sin_a, cos_a) = azimuth_deg.to_radians().sin_cos();
    let mirrored = DVec3::new(sin_i, 0.0, cos_i);
    let to_normal = DVec3::new(-cos_i, 0.0, sin_i);
    mirrored * cos_r + (to_normal * cos_a + DVec3::Y * sin_a) * sin_r
}

/// The values, and how many directions above the horizon have none.
fn from_zemax(path: &Path, file: &ZemaxBsdf) -> Result<(Vec<Row>, usize), ParseError> {
    if file.transmitted {
        let error = ParseError::new(path, "BTDF", "BRDF").in_field("ScatterType");
        return Err(error.with_hint("transmitted light has no place in a table of reflected light"));
    }
    let (mut rows, mut missing, mut at) = (Vec::new(), 0, 0);
    for theta_i in &file.incidence_deg {
        for (k, azimuth) in file.azimuth_deg.iter().enumerate() {
            for radial in &file.radial_deg {
                let value = file.value_per_sr[at];
                at += 1;
                // On the mirrored ray all azimuths are one direction.
                if *radial == 0.0 && k > 0 {
                    continue;
                }
                let o = about_mirrored(*theta_i, *azimuth, *radial);
                if o.z <= 1e-9 {
                    continue;
                }
                if value == 0.0 {
                    missing += 1;
                    continue;
                }
                let theta_o = o.x.hypot(o.y).atan2(o.z).to_degrees();
                rows.push(row(*theta_i, 180.0, theta_o, o.y.atan2(o.x).to_degrees(), value));
            }
        }
    }
    Ok((rows, missing))
}

/// Whether the last comment line before the values names the columns.
fn columns_header(text: &str) -> bool {
    let mut last = "";
    for line in text.lines().map(str::trim).filter(|l| !l.is_empty()) {
        match line.strip_prefix('#') {
            Some(comment) if !comment.trim().is_empty() => last = comment,
            Some(_) => {}
            None => break,
        }
    }
    let names: Vec<String> = last.split_whitespace().map(str::to_lowercase).collect();
    let is = |k: usize, all: [&str; 2]| names.get(k).is_some_and(|n| all.contains(&n.as_str()));
    names.len() == 5
        && is(0, ["phi_i", "phi_in"])
        && is(1, ["theta_i", "theta_in"])
        && is(2, ["phi_o", "phi_out"])
        && is(3, ["theta_o", "theta_out"])
        && is(4, ["brdf", "bsdf"])
}

/// A wavelength that a comment says: `lambda = 532 nm`.
fn said_wavelength(text: &str) -> Option<f64> {
    let comments = text.lines().map(str::trim).take_while(|l| l.is_empty() || l.starts_with('#'));
    for comment in comments.filter(|c| c.contains("wavelength") || c.contains("lambda")) {
        let Some((_, value)) = comment.split_once('=') else { continue };
        let mut words = value.split_whitespace();
        let number = words.next().and_then(|w| w.parse::<f64>().ok());
        if words.next() == Some("nm") {
            return number;
        }
    }
    None
}

/// In these tables phi is the angle from the normal and theta the azimuth.
fn from_columns(path: &Path, text: &str) -> Result<Vec<Row>, ParseError> {
    let mut rows = Vec::new();
    for (k, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let bad = |expected: &str| {
            let shown: String = line.chars().take(60).collect();
            ParseError::new(path, shown, expected).at_line(k as u64 + 1)
        };
        let numbers: Option<Vec<f64>> = line
            .split_whitespace()
            .map(|w| w.parse::<f64>().ok().filter(|v| v.is_finite()))
            .collect();
        match numbers.as_deref() {
            Some([theta_i, phi_i, theta_o, phi_o, f]) => {
                if theta_i.abs() > 90.0 || theta_o.abs() > 90.0 {
                    return Err(bad("angles from the normal of up to 90°"));
                }
                rows.push(row(*theta_i, *phi_i, *theta_o, *phi_o, *f));
            }
            _ => return Err(bad("five numbers: phi_i, theta_i, phi_o, theta_o, brdf")),
        }
    }
    Ok(rows)
}
