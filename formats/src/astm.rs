//! Scattered light as ASTM E1392 and E2387 have laboratories write it: a header, a line of names, values with commas.
//!
//! ```text
//! NUM_POINTS 3
//! VARS theta_i,phi_i,theta_s,phi_s,532nm
//! 0.1745,0,0.1745,3.1416,12.5
//! ```
//!
//! Angles are in radians, both directions point away from the sample. By the layout that libbsdf (Kimura, MPL 2.0) reads; no file of a laboratory was at hand. Other lines of the header, such as the sample's
//! name, stand before `VARS` and are kept as they are.

use crate::error::{ParseError, excerpt};
use std::fmt::Write as _;
use std::path::Path;

/// A direction with its values.
#[derive(Debug, Clone, PartialEq)]
pub struct AstmRow {
    /// Angle of the light from the normal, its azimuth, the same two of the scattered light: radians.
    pub angles_rad: [f64; 4],
    /// 1/sr, one a column.
    pub bsdf_per_sr: Vec<f64>,
}

/// A file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct AstmScatter {
    /// Lines before the names of the columns, but for the number of points.
    pub header: Vec<String>,
    /// Names of the columns after the angles.
    pub names: Vec<String>,
    /// In the order of the file.
    pub rows: Vec<AstmRow>,
}

impl AstmScatter {
    /// The wavelength that a column's name says (`532nm`), vacuum nm.
    pub fn wavelength_nm(&self, column: usize) -> Option<f64> {
        let number = self.names.get(column)?.trim().strip_suffix("nm")?.trim().parse::<f64>();
        number.ok().filter(|nm| nm.is_finite() && *nm > 1.0)
    }
}

fn names(line: &str) -> Option<&str> {
    let rest = line.trim().strip_prefix("VARS")?;
    rest.starts_with([' ', '\t']).then(|| rest.trim())
}

/// Returns true of a text in whose header a line `VARS` names five columns or more, with commas.
pub fn is_astm(text: &str) -> bool {
    text.lines().take(200).find_map(names).is_some_and(|n| n.split(',').count() >= 5)
}

/// Reads a file from text; `path` names it in errors.
///
/// # Errors
/// A [`ParseError`] with line: no line of names, fewer than one column of values, a row with another number of values, what is no number, angles from the normal of more than π/2, another number of rows than
/// the header says.
pub fn read_str(path: impl AsRef<Path>, text: &str) -> Result<AstmScatter, ParseError> {
    let path = path.as_ref();
    let bad = |line: usize, found: &str, expected: &str| {
        ParseError::new(path, excerpt(found), expected).at_line(line as u64)
    };
    let mut found = AstmScatter::default();
    let mut promised = None;
    for (k, raw) in text.lines().enumerate() {
        let (line, number) = (raw.trim(), k + 1);
        if line.is_empty() {
            continue;
        }
        if found.names.is_empty() {
            if let Some(list) = names(line) {
                let all: Vec<String> = list.split(',').map(|n| n.trim().to_owned()).collect();
                if all.len() < 5 || all.iter().any(String::is_empty) {
                    let expected = "VARS with the names of four angles and of one value or more";
                    return Err(bad(number, line, expected));
                }
                found.names = all[4..].to_vec();
            } else if let Some(count) = line.strip_prefix("NUM_POINTS") {
                let count = count.trim().parse::<usize>();
                promised = Some(count.map_err(|_| bad(number, line, "a number of points"))?);
            } else {
                found.header.push(line.to_owned());
            }
            continue;
        }
        let numbers: Option<Vec<f64>> = line
            .split(',')
            .map(|w| w.trim().parse::<f64>().ok().filter(|v| v.is_finite()))
            .collect();
        let count = 4 + found.names.len();
        let expected = || format!("{count} numbers with commas between them");
        let numbers = numbers.ok_or_else(|| bad(number, line, &expected()))?;
        let [theta_i, phi_i, theta_s, phi_s, values @ ..] = numbers.as_slice() else {
            return Err(bad(number, line, &expected()));
        };
        if values.len() != found.names.len() {
            return Err(bad(number, line, &expected()));
        }
        if theta_i.abs().max(theta_s.abs()) > std::f64::consts::FRAC_PI_2 + 1e-6 {
            let error = bad(number, line, "angles from the normal of up to π/2, in radians");
            return Err(error.with_hint("a file in degrees is none of this format"));
        }
        found.rows.push(AstmRow {
            angles_rad: [*theta_i, *phi_i, *theta_s, *phi_s],
            bsdf_per_sr: values.to_vec(),
        });
    }
    if found.names.is_empty() {
        return Err(ParseError::new(path, "no line VARS", "`VARS` with the names of the columns"));
    }
    match promised {
        Some(count) if count != found.rows.len() => {
            let error =
                ParseError::new(path, format!("{} rows", found.rows.len()), format!("{count}"));
            Err(error.in_field("NUM_POINTS").with_hint("the file may be cut off"))
        }
        _ => Ok(found),
    }
}

/// Writes what [`read_str`] reads, every number with all its digits.
pub fn to_string(scatter: &AstmScatter) -> String {
    let mut text = String::new();
    for line in &scatter.header {
        let _ = writeln!(text, "{line}");
    }
    let _ = writeln!(text, "NUM_POINTS {}", scatter.rows.len());
    let _ = writeln!(text, "VARS theta_i,phi_i,theta_s,phi_s,{}", scatter.names.join(","));
    for row in &scatter.rows {
        let numbers = row.angles_rad.iter().chain(&row.bsdf_per_sr);
        let numbers: Vec<String> = numbers.map(f64::to_string).collect();
        let _ = writeln!(text, "{}", numbers.join(","));
    }
    text
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failure should stop the run")]
    use super::*;

    /// Truth: the layout that libbsdf's reader has, written by hand (synthetic).
    #[test]
    fn the_layout_of_libbsdf() {
        let text = "SAMPLE black coat\r\nNUM_POINTS 2\r\nVARS theta_i,phi_i,theta_s,phi_s,532nm,650nm\r\n0.5,0,0.5,3.14,12.5,1e1\r\n0.5,0,0.25,-1,0.1,0.2\r\n";
        assert!(is_astm(text));
        let file = read_str("x", text).unwrap();
        assert_eq!((file.wavelength_nm(1), file.rows[1].angles_rad[3]), (Some(650.0), -1.0));
        assert_eq!(file.header, ["SAMPLE black coat"]);
        assert_eq!(read_str("x", &to_string(&file)).unwrap(), file);
        for (from, to, said) in [
            ("NUM_POINTS 2", "NUM_POINTS 3", "2 rows"),
            ("12.5,1e1", "12.5", "6 numbers"),
            ("12.5,1e1", "12.5,x", "6 numbers"),
            ("0.5,0,0.25", "0.5,0,25", "radians"),
            ("phi_s,532nm,650nm", "phi_s", "VARS"),
        ] {
            let error = read_str("x", &text.replace(from, to)).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
    }
}
