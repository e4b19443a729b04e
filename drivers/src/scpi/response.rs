//! Responsivity of a photodiode: amperes a watt, at wavelengths.

use glam::DVec2;
use std::path::Path;
use sunglint_formats::{FileError, ParseError, read};
use sunglint_numerics::measured::Interval;

/// The first line of a responsivity's file.
const HEADER: &str = "wavelength_nm,responsivity_a_per_w";
/// Most points of a table.
const MOST: usize = 10_000;

/// Responsivity between the ends of a table, linear from point to point.
#[derive(Debug, Clone, PartialEq)]
pub struct Response {
    /// `x` is the wavelength, nm, rising, and `y` A/W, above zero.
    points: Vec<DVec2>,
}

fn is_point(point: DVec2) -> bool {
    point.is_finite() && point.min_element() > 0.0
}

impl Response {
    /// A table: `x` is a wavelength, nm, and `y` A/W.
    ///
    /// # Errors
    /// Words that say what a table should be.
    pub fn new(points: &[DVec2]) -> Result<Self, String> {
        let rising = points.windows(2).all(|pair| pair[0].x < pair[1].x);
        let good =
            (2..=MOST).contains(&points.len()) && points.iter().all(|point| is_point(*point));
        if good && rising {
            return Ok(Self { points: points.to_vec() });
        }
        let what = "pairs [nm, A/W], both above 0, the wavelengths rising";
        Err(format!("2 to {MOST} {what}"))
    }

    /// Reads a CSV: the line `wavelength_nm,responsivity_a_per_w`, then pairs of numbers; lines that begin with `#` are comments.
    ///
    /// # Errors
    /// A file that cannot be read, or a [`ParseError`] with its line.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, FileError> {
        let path = path.as_ref();
        Ok(Self::parse(path, &read::text(path)?)?)
    }

    /// Reads a CSV's text; `path` names it in errors.
    ///
    /// # Errors
    /// A [`ParseError`] with the line.
    pub fn parse(path: impl AsRef<Path>, text: &str) -> Result<Self, ParseError> {
        Self::parse_at(path.as_ref(), text)
    }

    fn parse_at(path: &Path, text: &str) -> Result<Self, ParseError> {
        let lines = text.lines().map(str::trim).zip(1_u64..);
        let mut lines = lines.filter(|(line, _)| !line.is_empty() && !line.starts_with('#'));
        let error = |found: &str, line, expected: &str| {
            ParseError::new(path, format!("`{found}`"), expected).at_line(line)
        };
        let (header, at) = lines.next().unwrap_or(("", 1));
        if header.replace(' ', "") != HEADER {
            return Err(error(header, at, HEADER));
        }
        let mut points: Vec<DVec2> = Vec::new();
        for (line, at) in lines {
            let point = line.split_once(',').and_then(|(nm, a_per_w)| {
                Some(DVec2::new(nm.trim().parse().ok()?, a_per_w.trim().parse().ok()?))
            });
            let Some(point) = point.filter(|point| is_point(*point)) else {
                return Err(error(line, at, "a wavelength, nm, and A/W, both above 0"));
            };
            if points.last().is_some_and(|last| last.x >= point.x) {
                return Err(error(line, at, "a wavelength above that of the line before"));
            }
            if points.len() == MOST {
                return Err(error(line, at, "at most 10000 points"));
            }
            points.push(point);
        }
        let count = points.len();
        Self::new(&points)
            .map_err(|_| ParseError::new(path, format!("{count} points"), "at least 2 points"))
    }

    /// The first and the last wavelength, nm.
    pub fn ends_nm(&self) -> Interval {
        let end = |point: Option<&DVec2>| point.map_or(f64::NAN, |point| point.x);
        Interval::new(end(self.points.first()), end(self.points.last()))
    }

    /// A/W at a wavelength, nm; `None` beyond the table.
    pub fn a_per_w(&self, nm: f64) -> Option<f64> {
        let after = self.points.partition_point(|point| point.x < nm);
        let right = *self.points.get(after)?;
        if right.x == nm {
            return Some(right.y);
        }
        let left = *self.points.get(after.checked_sub(1)?)?;
        Some(left.y + (right.y - left.y) * ((nm - left.x) / (right.x - left.x)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: straight lines between the points, by hand; nothing beyond them.
    #[test]
    fn responsivity_is_linear_and_ends_with_its_table() {
        let text = "# S1337, from its sheet\nwavelength_nm, responsivity_a_per_w\n400,0.2\n600,0.4\n\n 800 , 0.5\n";
        let response = Response::parse("s1337.csv", text).unwrap();
        assert_eq!(response.ends_nm().to_array(), [400.0, 800.0]);
        for (nm, a_per_w) in [(400.0, 0.2), (500.0, 0.3), (600.0, 0.4), (800.0, 0.5)] {
            let found = response.a_per_w(nm).unwrap();
            assert!((found - a_per_w).abs() < 1e-15, "{nm}: {found}");
        }
        for beyond in [399.9, 800.1, f64::NAN, 0.0] {
            assert_eq!(response.a_per_w(beyond), None);
        }
    }

    #[test]
    fn a_wrong_table_says_its_line() {
        let error = |text: &str| Response::parse("r.csv", text).unwrap_err().to_string();
        assert!(error("nm,a\n").starts_with("r.csv:1: "), "{}", error("nm,a\n"));
        let head = "wavelength_nm,responsivity_a_per_w\n";
        for (rows, line, why) in [
            ("400,0.2\n400,0.3\n", 3, "above that of the line before"),
            ("400,0.2\n500,-1\n", 3, "both above 0"),
            ("400;0.2\n", 2, "both above 0"),
            ("400,nan\n", 2, "both above 0"),
        ] {
            let said = error(&format!("{head}{rows}"));
            assert!(said.starts_with(&format!("r.csv:{line}: ")) && said.contains(why), "{said}");
        }
        assert!(error(&format!("{head}400,1\n")).contains("at least 2 points"));
        assert!(Response::new(&[DVec2::new(400.0, 0.1), DVec2::new(300.0, 0.2)]).is_err());
    }
}
