//! Zemax OpticStudio's tabular BSDF: text, with the same ending `.bsdf` as the tensor files of [`crate::bsdf`].
//!
//! ```text
//! Source  Measured
//! Symmetry  PlaneSymmetrical
//! SpectralContent  Monochrome
//! ScatterType  BRDF
//! SampleRotation  1
//! 0
//! AngleOfIncidence  2          count, then on the next line the values; so ScatterAzimuth and ScatterRadial
//! 10 30
//! …
//! Monochrome
//! DataBegin
//! TIS 0.0387                   per incidence; then a row per azimuth with a value per radial angle
//! …
//! DataEnd
//! ```
//!
//! The scattered direction is given about the mirrored ray: the radial angle from it, and the azimuth about it, 0 towards the normal. What lies below the horizon holds 0.

use crate::error::{ParseError, excerpt};
use std::fmt::Write as _;
use std::path::Path;

/// A file of one rotation of the sample and one colour.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ZemaxBsdf {
    /// Comment lines before the first keyword, without `#`.
    pub comments: Vec<String>,
    /// `Measured`, or what else stands there.
    pub source: String,
    /// True of `PlaneSymmetrical`, where azimuths go from 0 to 180°; false of `Asymmetrical`.
    pub plane_symmetrical: bool,
    /// True of light that is transmitted (BTDF).
    pub transmitted: bool,
    /// Angles of incidence, degrees.
    pub incidence_deg: Vec<f64>,
    /// Azimuths about the mirrored ray, degrees.
    pub azimuth_deg: Vec<f64>,
    /// Angles from the mirrored ray, degrees.
    pub radial_deg: Vec<f64>,
    /// Total integrated scatter, by incidence.
    pub tis: Vec<f64>,
    /// 1/sr by incidence, then azimuth, then radial angle; 0 where there is no value.
    pub value_per_sr: Vec<f64>,
}

/// Returns true of a text whose first keyword is `Source`.
pub fn is_zemax(text: &str) -> bool {
    let first = text.lines().map(str::trim).find(|l| !l.is_empty() && !l.starts_with('#'));
    first.and_then(|l| l.split_whitespace().next()) == Some("Source")
}

struct Lines<'a> {
    path: &'a Path,
    all: Vec<(u64, &'a str)>,
    at: usize,
}

impl<'a> Lines<'a> {
    fn next(&mut self, expected: &str) -> Result<(u64, &'a str), ParseError> {
        let found = self.all.get(self.at).copied();
        self.at += 1;
        found.ok_or_else(|| {
            ParseError::new(self.path, "the end of the file", expected)
                .with_hint("the file may be cut off")
        })
    }

    fn keyword(&mut self, key: &str) -> Result<(u64, &'a str), ParseError> {
        let (number, line) = self.next(key)?;
        match line.split_once(char::is_whitespace) {
            Some((word, rest)) if word == key => Ok((number, rest.trim())),
            _ => Err(self.bad(number, line, &format!("`{key}` and its value"))),
        }
    }

    fn bad(&self, line: u64, found: &str, expected: &str) -> ParseError {
        ParseError::new(self.path, excerpt(found), expected).at_line(line)
    }

    fn numbers(&self, number: u64, line: &str, count: usize) -> Result<Vec<f64>, ParseError> {
        let all: Option<Vec<f64>> = line
            .split_whitespace()
            .map(|w| w.parse::<f64>().ok().filter(|v| v.is_finite()))
            .collect();
        let all = all.ok_or_else(|| self.bad(number, line, "numbers"))?;
        if all.len() == count {
            Ok(all)
        } else {
            Err(self.bad(number, &format!("{} numbers", all.len()), &format!("{count} numbers")))
        }
    }

    /// A keyword with a count, then as many values.
    fn list(&mut self, key: &str) -> Result<Vec<f64>, ParseError> {
        let (number, count) = self.keyword(key)?;
        let expected = "a number of values from 1 on";
        let count: usize = count
            .parse()
            .ok()
            .filter(|n| (1..=100_000).contains(n))
            .ok_or_else(|| self.bad(number, count, expected).in_field(key))?;
        let (number, line) = self.next("values")?;
        let values = self.numbers(number, line, count).map_err(|e| e.in_field(key))?;
        match values.windows(2).find(|w| w[1] <= w[0]) {
            Some(w) => {
                let found = format!("{} after {}", w[1], w[0]);
                Err(self.bad(number, &found, "values that increase").in_field(key))
            }
            None => Ok(values),
        }
    }
}

/// Reads a file from text; `path` names it in errors.
///
/// # Errors
/// A [`ParseError`] with line and keyword: keywords that are missing or in another order, several rotations of the sample, tristimulus data, counts that do not agree with
/// the values, numbers that are none or negative, angles out of range, a file that is cut off.
pub fn read_str(path: impl AsRef<Path>, text: &str) -> Result<ZemaxBsdf, ParseError> {
    read_str_at(path.as_ref(), text)
}

fn read_str_at(path: &Path, text: &str) -> Result<ZemaxBsdf, ParseError> {
    let mut comments = Vec::new();
    let mut all = Vec::new();
    for (k, line) in text.lines().enumerate() {
        let line = line.trim();
        if let Some(comment) = line.strip_prefix('#') {
            if all.is_empty() {
                comments.push(comment.trim().to_owned());
            }
        } else if !line.is_empty() {
            all.push((k as u64 + 1, line));
        }
    }
    let mut lines = Lines { path, all, at: 0 };
    let source = lines.keyword("Source")?.1.to_owned();
    let (number, symmetry) = lines.keyword("Symmetry")?;
    let plane_symmetrical = match symmetry {
        "PlaneSymmetrical" => true,
        "Asymmetrical" => false,
        other => {
            let error = lines.bad(number, other, "PlaneSymmetrical or Asymmetrical");
            return Err(error.in_field("Symmetry"));
        }
    };
    let (number, content) = lines.keyword("SpectralContent")?;
    if content != "Monochrome" {
        let error = lines.bad(number, content, "Monochrome").in_field("SpectralContent");
        return Err(error.with_hint("tristimulus values are no values at a wavelength"));
    }
    let (number, kind) = lines.keyword("ScatterType")?;
    let transmitted = match kind {
        "BRDF" => false,
        "BTDF" => true,
        other => {
            return Err(lines.bad(number, other, "BRDF or BTDF").in_field("ScatterType"));
        }
    };
    let rotations = lines.list("SampleRotation")?;
    if rotations.len() > 1 {
        let found = format!("{} rotations of the sample", rotations.len());
        return Err(ParseError::new(path, found, "one").in_field("SampleRotation"));
    }
    let incidence_deg = lines.list("AngleOfIncidence")?;
    let azimuth_deg = lines.list("ScatterAzimuth")?;
    let radial_deg = lines.list("ScatterRadial")?;
    let most_azimuth = if plane_symmetrical { 180.0 } else { 360.0 };
    for (field, values, most) in [
        ("AngleOfIncidence", &incidence_deg, 90.0),
        ("ScatterAzimuth", &azimuth_deg, most_azimuth),
        ("ScatterRadial", &radial_deg, 180.0),
    ] {
        if let Some(v) = values.iter().find(|v| !(0.0..=most).contains(*v)) {
            let error = ParseError::new(path, v.to_string(), format!("an angle from 0 to {most}°"));
            return Err(error.in_field(field));
        }
    }
    for word in ["Monochrome", "DataBegin"] {
        let (number, line) = lines.next(word)?;
        if line != word {
            return Err(lines.bad(number, line, &format!("`{word}`")));
        }
    }
    let (mut tis, mut value_per_sr) = (Vec::new(), Vec::new());
    for _ in &incidence_deg {
        let (number, value) = lines.keyword("TIS")?;
        let value = lines.numbers(number, value, 1).map_err(|e| e.in_field("TIS"))?;
        tis.push(value[0]);
        for _ in &azimuth_deg {
            let (number, line) = lines.next("a row of values")?;
            let row = lines.numbers(number, line, radial_deg.len())?;
            if row.iter().any(|v| *v < 0.0) {
                return Err(lines.bad(number, line, "values of 0 or above"));
            }
            value_per_sr.extend(row);
        }
    }
    let (number, end) = lines.next("`DataEnd`")?;
    if end != "DataEnd" {
        return Err(lines.bad(number, end, "`DataEnd`"));
    }
    Ok(ZemaxBsdf {
        comments,
        source,
        plane_symmetrical,
        transmitted,
        incidence_deg,
        azimuth_deg,
        radial_deg,
        tis,
        value_per_sr,
    })
}

/// Writes what [`read_str`] reads, every number with all its digits.
pub fn to_string(bsdf: &ZemaxBsdf) -> String {
    let mut text = String::new();
    for comment in &bsdf.comments {
        let _ = writeln!(text, "# {comment}");
    }
    let symmetry = if bsdf.plane_symmetrical { "PlaneSymmetrical" } else { "Asymmetrical" };
    let kind = if bsdf.transmitted { "BTDF" } else { "BRDF" };
    let _ = writeln!(
        text,
        "Source\t{}\nSymmetry\t{symmetry}\nSpectralContent\tMonochrome\nScatterType\t{kind}\nSampleRotation\t1\n0",
        bsdf.source
    );
    let row =
        |values: &[f64]| values.iter().map(ToString::to_string).collect::<Vec<_>>().join("\t");
    for (key, values) in [
        ("AngleOfIncidence", &bsdf.incidence_deg),
        ("ScatterAzimuth", &bsdf.azimuth_deg),
        ("ScatterRadial", &bsdf.radial_deg),
    ] {
        let _ = writeln!(text, "{key}\t{}\n{}", values.len(), row(values));
    }
    text.push_str("\nMonochrome\nDataBegin\n");
    let width = bsdf.radial_deg.len().max(1);
    let block = width * bsdf.azimuth_deg.len().max(1);
    for (tis, block) in bsdf.tis.iter().zip(bsdf.value_per_sr.chunks(block)) {
        let _ = writeln!(text, "TIS\t{tis}");
        for values in block.chunks(width) {
            let _ = writeln!(text, "{}", row(values));
        }
    }
    text.push_str("DataEnd\n");
    text
}
