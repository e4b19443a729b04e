//! Scattered light as ASTM E1392 and E2387 have laboratories write it: a header, a line of names, values with commas.
//!
//! ```text
//! NUM_POINTS 3
//! VARS theta_i,phi_i,theta_s,phi_s,532nm
//! 0.1745,0,0.1745,3.1416,12.5
//! ```
//!
//! The columns of angles are known by their names and stand in any order; all others are values. Angles are in radians, both directions point away from the sample. By the layout that libbsdf (Kimura, MPL 2.0) reads; no file of a laboratory was at hand. Other lines of the header, such as the sample's
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

/// The columns of angles, in the order of [`AstmRow::angles_rad`].
const ANGLES: [&str; 4] = ["theta_i", "phi_i", "theta_s", "phi_s"];

/// The meaning of a column by its name.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Column {
    /// One of [`ANGLES`], in radians.
    Angle(usize),
    /// An angle whose name says degrees.
    Degrees,
    /// An angle of the half vector or to it.
    Half,
    /// A value.
    Value,
}

/// Case, separators and a unit (`theta_i (rad)`, `Theta_I_rad`) do not matter.
fn column(name: &str) -> Column {
    let name = name.to_lowercase();
    let (stem, unit) = match name.split_once(['(', '[', '{']) {
        Some((stem, unit)) => (stem, unit),
        None => match ["_rad", "_radians", "_deg", "_degrees"].iter().find(|u| name.ends_with(**u))
        {
            Some(unit) => name.split_at(name.len() - unit.len()),
            None => (name.as_str(), ""),
        },
    };
    let letters: String = stem.chars().filter(char::is_ascii_alphanumeric).collect();
    let found = match letters.as_str() {
        "thetai" | "thetain" => Column::Angle(0),
        "phii" | "phiin" => Column::Angle(1),
        "thetas" | "thetar" | "thetao" | "thetaout" => Column::Angle(2),
        "phis" | "phir" | "phio" | "phiout" => Column::Angle(3),
        "thetah" | "phih" | "thetad" | "phid" => Column::Half,
        _ => return Column::Value,
    };
    let is_degrees = unit.contains("deg") || unit.contains('°');
    if is_degrees && found != Column::Half { Column::Degrees } else { found }
}

/// Returns true of a text in whose header a line `VARS` names five columns or more, with commas, or an angle.
pub fn is_astm(text: &str) -> bool {
    text.lines().take(200).find_map(names).is_some_and(|n| {
        n.split(',').count() >= 5 || n.split(',').any(|n| column(n) != Column::Value)
    })
}

/// The columns of the four angles and of the values.
fn columns(all: &[&str], bad: impl Fn(&str, &str) -> ParseError) -> Result<Columns, ParseError> {
    let mut angles = [None; 4];
    let mut values = Vec::new();
    for (k, name) in all.iter().enumerate() {
        match column(name) {
            Column::Value => values.push(k),
            Column::Angle(which) if angles[which].is_none() => angles[which] = Some(k),
            Column::Angle(which) => {
                return Err(bad(name, &format!("{} in one column only", ANGLES[which])));
            }
            Column::Degrees => return Err(bad(name, "an angle in radians")),
            Column::Half => {
                let error = bad(name, "theta_i, phi_i, theta_s, phi_s");
                return Err(error.with_hint(
                    "angles of the half vector and to it are not read: turn them into the directions of the light and of the scattered light",
                ));
            }
        }
    }
    if let Some(which) = angles.iter().position(Option::is_none) {
        let instead = all.get(which).copied().unwrap_or_default();
        let expected = format!("{} as column {} or elsewhere", ANGLES[which], which + 1);
        let hint = match which {
            3 => {
                "without the azimuth of the scattered light its side of the normal is not known: add a column phi_s, 0 beside the light and π opposite to it where phi_i is 0"
            }
            _ => {
                "the names of angles are theta_i, phi_i, theta_s, phi_s; all other columns are values"
            }
        };
        return Err(bad(instead, &expected).with_hint(hint));
    }
    Ok(Columns { angles: angles.map(|k| k.unwrap_or_default()), values })
}

/// Where each column stands.
struct Columns {
    angles: [usize; 4],
    values: Vec<usize>,
}

/// Reads a file from text; `path` names it in errors.
///
/// # Errors
/// A [`ParseError`] with line: no line of names, an angle that none of them names or two do, angles of the half vector, fewer than one column of values, a row with another number of values, what is no number,
/// angles from the normal of more than π/2, another number of rows than the header says.
pub fn read_str(path: impl AsRef<Path>, text: &str) -> Result<AstmScatter, ParseError> {
    read_str_at(path.as_ref(), text)
}

fn read_str_at(path: &Path, text: &str) -> Result<AstmScatter, ParseError> {
    let bad = |line: usize, found: &str, expected: &str| {
        ParseError::new(path, excerpt(found), expected).at_line(line as u64)
    };
    let mut found = AstmScatter::default();
    let (mut promised, mut at) = (None, None);
    for (k, raw) in text.lines().enumerate() {
        let (line, number) = (raw.trim(), k + 1);
        if line.is_empty() {
            continue;
        }
        let Some(at) = &at else {
            if let Some(list) = names(line) {
                let all: Vec<&str> = list.split(',').map(str::trim).collect();
                let all_columns =
                    columns(&all, |found, expected| bad(number, found, expected).in_field("VARS"))?;
                if all_columns.values.is_empty() || all.iter().any(|n| n.is_empty()) {
                    let expected = "VARS with the names of four angles and of one value or more";
                    return Err(bad(number, line, expected));
                }
                found.names = all_columns.values.iter().map(|k| all[*k].to_owned()).collect();
                at = Some(all_columns);
            } else if let Some(count) = line.strip_prefix("NUM_POINTS") {
                let count = count.trim().parse::<usize>();
                promised = Some(count.map_err(|_| bad(number, line, "a number of points"))?);
            } else {
                found.header.push(line.to_owned());
            }
            continue;
        };
        let numbers: Option<Vec<f64>> = line
            .split(',')
            .map(|w| w.trim().parse::<f64>().ok().filter(|v| v.is_finite()))
            .collect();
        let count = 4 + found.names.len();
        let numbers = numbers.filter(|n| n.len() == count).ok_or_else(|| {
            bad(number, line, &format!("{count} numbers with commas between them"))
        })?;
        let angles_rad = at.angles.map(|k| numbers[k]);
        if angles_rad[0].abs().max(angles_rad[2].abs()) > std::f64::consts::FRAC_PI_2 + 1e-6 {
            let error = bad(number, line, "angles from the normal of up to π/2, in radians");
            return Err(error.with_hint("a file in degrees is none of this format"));
        }
        let bsdf_per_sr = at.values.iter().map(|k| numbers[*k]).collect();
        found.rows.push(AstmRow { angles_rad, bsdf_per_sr });
    }
    if at.is_none() {
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

    /// Truth: numbers of one direction, written by hand in other orders and under other names of their columns (synthetic).
    #[test]
    fn columns_of_angles_are_known_by_their_names() {
        let read = |vars: &str, row: &str| read_str("x", &format!("VARS {vars}\n{row}\n"));
        for (vars, row) in [
            ("theta_i,phi_i,theta_s,phi_s,525nm", "0.1,0.2,0.3,0.4,5"),
            ("theta_s,phi_s,theta_i,phi_i,525nm", "0.3,0.4,0.1,0.2,5"),
            ("525nm,Phi_R [rad],THETA_R (rad),phi_i_rad,Theta I", "5,0.4,0.3,0.2,0.1"),
            ("theta_i,theta_o,phi_i,phi_o,525nm", "0.1,0.3,0.2,0.4,5"),
        ] {
            let file = read(vars, row).unwrap();
            let row = AstmRow { angles_rad: [0.1, 0.2, 0.3, 0.4], bsdf_per_sr: vec![5.0] };
            assert_eq!((file.rows, &*file.names), (vec![row], &["525nm".to_owned()][..]), "{vars}");
        }
        for (vars, said) in [
            (
                "theta_i,phi_i,theta_s,465nm,525nm",
                "VARS: found `465nm`, expected phi_s as column 4",
            ),
            ("theta_i,phi_i,theta_s,465nm", "found `465nm`, expected phi_s"),
            ("theta_h,phi_h,theta_d,phi_d,525nm", "half vector"),
            ("a,b,theta_s,phi_s,525nm", "found `a`, expected theta_i as column 1"),
            ("theta_i,phi_i,theta_s,theta_r,phi_s,525nm", "theta_s in one column only"),
            ("theta_i (deg),phi_i,theta_s,phi_s,525nm", "radians"),
        ] {
            let text = format!("VARS {vars}\n0,0,0,0,1\n");
            assert!(is_astm(&text), "{vars}");
            let error = read_str("x", &text).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
    }
}
