//! FRED's tabular scatter data: what `Scatter → Tabulated` of FRED (Photon Engineering) reads and writes.
//!
//! ```text
//! type bsdf_data
//! format angles=deg bsdf=value scale=1
//! 10 0            incidence: angle from the normal, azimuth
//! 0 0 0.031984    scattered: angle from the normal, azimuth, 1/sr
//! ```
//!
//! The azimuth of the scattered light is 0 on the mirrored side (checked against the same surface in Zemax's format).

use crate::error::{ParseError, excerpt};
use std::fmt::Write as _;
use std::path::Path;

/// One scattered direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FredRow {
    /// Angle from the normal, degrees.
    pub theta_deg: f64,
    /// Azimuth, degrees; 0 on the mirrored side.
    pub phi_deg: f64,
    /// 1/sr.
    pub bsdf_per_sr: f64,
}

/// An incidence with its scattered light.
#[derive(Debug, Clone, PartialEq)]
pub struct FredIncidence {
    /// Angle of the incident light from the normal, degrees.
    pub theta_deg: f64,
    /// Azimuth of the incidence, degrees.
    pub phi_deg: f64,
    /// In the order of the file.
    pub rows: Vec<FredRow>,
}

/// A file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FredScatter {
    /// In the order of the file.
    pub incidences: Vec<FredIncidence>,
}

/// Returns true of a text whose first word is `type` and whose second one is `bsdf_data`.
pub fn is_fred(text: &str) -> bool {
    let mut lines = text.lines().map(str::trim).filter(|l| !is_comment(l));
    let mut words = lines.next().unwrap_or_default().split_whitespace();
    words.next().is_some_and(|w| w.eq_ignore_ascii_case("type"))
        && words.next().is_some_and(|w| w.eq_ignore_ascii_case("bsdf_data"))
}

fn is_comment(line: &str) -> bool {
    line.is_empty() || line.starts_with(['#', '!'])
}

/// Reads a file from text; `path` names it in errors. Values are multiplied by the header's scale, angles come out in degrees.
///
/// # Errors
/// A [`ParseError`] with line: another type, angles or values in a form that is not known, a row of other than two or three numbers, scattered light before an
/// incidence, numbers that are none, negative or infinite, angles beyond the horizon.
pub fn read_str(path: impl AsRef<Path>, text: &str) -> Result<FredScatter, ParseError> {
    read_str_at(path.as_ref(), text)
}

fn read_str_at(path: &Path, text: &str) -> Result<FredScatter, ParseError> {
    let bad = |line: u64, found: &str, expected: &str| {
        ParseError::new(path, excerpt(found), expected).at_line(line)
    };
    if !is_fred(text) {
        return Err(bad(1, text.lines().next().unwrap_or_default(), "`type bsdf_data`"));
    }
    let (mut scale, mut to_deg) = (1.0, 1.0);
    let mut found = FredScatter::default();
    let mut headed = false;
    for (k, raw) in text.lines().enumerate() {
        let (line, number) = (raw.trim(), k as u64 + 1);
        if is_comment(line) {
            continue;
        }
        let mut words = line.split_whitespace();
        match words.next() {
            Some("type") if !headed => continue,
            Some("format") if found.incidences.is_empty() => {
                for word in words {
                    match word.split_once('=') {
                        Some(("angles", "deg")) => to_deg = 1.0,
                        Some(("angles", "rad")) => to_deg = 180.0 / std::f64::consts::PI,
                        Some(("bsdf", "value")) => {}
                        Some(("scale", value)) => {
                            scale = value
                                .parse::<f64>()
                                .ok()
                                .filter(|v| v.is_finite() && *v > 0.0)
                                .ok_or_else(|| bad(number, word, "a scale above 0"))?;
                        }
                        _ => {
                            let expected = "angles=deg or rad, bsdf=value, scale=NUMBER";
                            return Err(bad(number, word, expected));
                        }
                    }
                }
                headed = true;
                continue;
            }
            _ => {}
        }
        let numbers: Option<Vec<f64>> = line
            .split_whitespace()
            .map(|w| w.parse::<f64>().ok().filter(|v| v.is_finite()))
            .collect();
        let expected = "two numbers (incidence) or three (angle, azimuth, 1/sr)";
        let numbers = numbers.ok_or_else(|| bad(number, line, expected))?;
        let theta_deg = numbers[0] * to_deg;
        let scaled = |k: usize, by: f64| numbers.get(k).is_none_or(|v| (v * by).is_finite());
        if !(scaled(1, to_deg) && scaled(2, scale)) {
            return Err(bad(number, line, "numbers that can be"));
        }
        if !(0.0..=90.0 + 1e-9).contains(&theta_deg.abs()) {
            return Err(bad(number, line, "an angle from the normal of up to 90°"));
        }
        match (numbers.as_slice(), found.incidences.last_mut()) {
            ([_, phi], _) => {
                let phi_deg = phi * to_deg;
                found.incidences.push(FredIncidence { theta_deg, phi_deg, rows: Vec::new() });
            }
            ([_, phi, value], Some(incidence)) => {
                if *value < 0.0 {
                    return Err(bad(number, line, "a value of 0 or above"));
                }
                let (phi_deg, bsdf_per_sr) = (phi * to_deg, value * scale);
                incidence.rows.push(FredRow { theta_deg, phi_deg, bsdf_per_sr });
            }
            ([_, _, _], None) => {
                return Err(bad(number, line, "an incidence (two numbers) before scattered light"));
            }
            _ => return Err(bad(number, line, expected)),
        }
    }
    if !found.incidences.iter().any(|i| !i.rows.is_empty()) {
        return Err(ParseError::new(path, "no scattered light", "rows of three numbers"));
    }
    Ok(found)
}

/// Writes what [`read_str`] reads, every number with all its digits.
pub fn to_string(scatter: &FredScatter) -> String {
    let mut text = String::from("type bsdf_data\nformat angles=deg bsdf=value scale=1\n");
    for incidence in &scatter.incidences {
        let _ = writeln!(text, "{}\t{}", incidence.theta_deg, incidence.phi_deg);
        for row in &incidence.rows {
            let _ = writeln!(text, "{}\t{}\t{}", row.theta_deg, row.phi_deg, row.bsdf_per_sr);
        }
    }
    text
}
