//! Curves as CSV: a passband, a quantum efficiency, a filter transmission, as vendors' plots are digitised.
//!
//! The first column is the grid, any other may be the values: `wavelength_nm,transmission`. Lines that begin with `#`
//! are notes. Wavelengths in `_um` and `_angstrom` become nanometres, `_percent` becomes a fraction, in the values and
//! in the names.

use crate::error::{FileError, ParseError, excerpt, nearest_names};
use std::path::Path;

/// A curve: values over a grid that increases.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// The grid, strictly increasing, finite.
    pub x: Vec<f64>,
    /// The values, finite; as many.
    pub y: Vec<f64>,
    /// Name of the grid, with its unit as suffix (`wavelength_nm`).
    pub x_name: String,
    /// Name of the values, with the unit as suffix where they have one.
    pub y_name: String,
    /// The comment lines, without `#`.
    pub notes: Vec<String>,
}

/// Reads a curve from a file; see [`read_str`].
pub fn read(path: impl AsRef<Path>, column: Option<&str>) -> Result<Curve, FileError> {
    let path = path.as_ref();
    let text = crate::read::text(path)?;
    Ok(read_str(path, &text, column)?)
}

/// Reads a curve from CSV text. `column` names the values (before or after conversion: `qe_percent` or `qe`); without
/// it the file must have two columns. `path` names the text in errors.
///
/// # Errors
/// A [`ParseError`] with line and column: no such column, a value that is no finite number, a grid that does not
/// increase, a wrong number of fields, less than two rows.
pub fn read_str(
    path: impl AsRef<Path>,
    text: &str,
    column: Option<&str>,
) -> Result<Curve, ParseError> {
    let path = path.as_ref();
    let notes = text.lines().filter_map(|line| line.strip_prefix('#'));
    let notes = notes.map(|note| note.trim().to_owned()).collect();
    let mut rows = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .comment(Some(b'#'))
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let mut record = csv::StringRecord::new();
    let mut next = |record: &mut csv::StringRecord| match rows.read_record(record) {
        Ok(more) => Ok(more.then(|| line_of_record(text, record))),
        Err(error) => Err(ParseError::new(path, error.to_string(), "comma-separated values")),
    };
    let Some(line) = next(&mut record)? else {
        return Err(ParseError::new(
            path,
            "no line",
            "column names, such as wavelength_nm,transmission",
        ));
    };
    let names: Vec<String> = record.iter().map(str::to_owned).collect();
    check_names(path, line, &names)?;
    let index = value_column(path, line, &names, column)?;
    let (x_name, x_factor) = converted(&names[0]);
    let (y_name, y_factor) = converted(&names[index]);
    let mut curve = Curve { x: Vec::new(), y: Vec::new(), x_name, y_name, notes };
    while let Some(line) = next(&mut record)? {
        if record.len() != names.len() {
            let found = format!("{} fields", record.len());
            let expected = format!("{} fields, one for each column", names.len());
            return Err(ParseError::new(path, found, expected).at_line(line));
        }
        let number = |i: usize, factor: Factor| {
            let text = record.get(i).unwrap_or("");
            let value = text.parse().map(|value| factor.apply(value));
            value.ok().filter(|value: &f64| value.is_finite()).ok_or_else(|| {
                ParseError::new(path, excerpt(text), "a finite number")
                    .at_line(line)
                    .in_field(&names[i])
            })
        };
        let (x, y) = (number(0, x_factor)?, number(index, y_factor)?);
        if let Some(&last) = curve.x.last()
            && x <= last
        {
            let what = if x == last { "repeated" } else { "smaller" };
            let found = format!("{}, {what} after the line before", &record[0]);
            return Err(ParseError::new(path, found, "a grid that increases")
                .at_line(line)
                .in_field(&names[0]));
        }
        curve.x.push(x);
        curve.y.push(y);
    }
    if curve.x.len() < 2 {
        let found = format!("{} rows of values", curve.x.len());
        return Err(ParseError::new(path, found, "at least 2 rows"));
    }
    Ok(curve)
}

/// The line on which a record begins. The position that csv gives is before the comments and blank lines above it.
fn line_of_record(text: &str, record: &csv::StringRecord) -> u64 {
    let Some(position) = record.position() else { return 1 };
    let mut byte = position.byte() as usize;
    for line in text.get(byte..).unwrap_or("").split_inclusive('\n') {
        let content = line.trim();
        if !content.is_empty() && !content.starts_with('#') {
            break;
        }
        byte += line.len();
    }
    crate::read::line_of(text, byte)
}

fn check_names(path: &Path, line: u64, names: &[String]) -> Result<(), ParseError> {
    let bad = |found: String, expected: &str| ParseError::new(path, found, expected).at_line(line);
    if names.len() < 2 {
        let error = bad(excerpt(&names.join(",")), "two or more columns, separated by commas");
        return Err(match names.iter().any(|name| name.contains([';', '\t'])) {
            true => error.with_hint("semicolons and tabs do not separate columns"),
            false => error,
        });
    }
    for (i, name) in names.iter().enumerate() {
        if name.is_empty() || name.parse::<f64>().is_ok() {
            return Err(bad(excerpt(name), "a column name").with_hint(
                "the first line names the columns, such as wavelength_nm,transmission",
            ));
        }
        if names[..i].contains(name) {
            return Err(bad("the column twice".to_owned(), "each column once").in_field(name));
        }
    }
    Ok(())
}

fn value_column(
    path: &Path,
    line: u64,
    names: &[String],
    wanted: Option<&str>,
) -> Result<usize, ParseError> {
    let list = || names[1..].iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
    let Some(wanted) = wanted else {
        if names.len() == 2 {
            return Ok(1);
        }
        let found = format!("{} columns of values", names.len() - 1);
        return Err(ParseError::new(path, found, "one, or the name of one")
            .at_line(line)
            .with_hint(format!("the columns are {}", list())));
    };
    let is_it = |name: &String| name == wanted || converted(name).0 == wanted;
    if let Some(index) = names[1..].iter().position(is_it) {
        return Ok(index + 1);
    }
    let error = ParseError::new(path, "no such column", format!("one of {}", list()))
        .at_line(line)
        .in_field(wanted);
    let nearest = nearest_names(wanted, names[1..].iter().map(String::as_str), 1);
    Err(match nearest.first() {
        Some(nearest) => error.with_hint(format!("did you mean `{nearest}`?")),
        None => error,
    })
}

/// What a value is multiplied with. Division by a whole number rounds once where multiplying by its inverse rounds
/// twice.
#[derive(Clone, Copy)]
enum Factor {
    One,
    Times(f64),
    Over(f64),
}

impl Factor {
    fn apply(self, value: f64) -> f64 {
        match self {
            Self::One => value,
            Self::Times(factor) => value * factor,
            Self::Over(divisor) => value / divisor,
        }
    }
}

/// The name that a column has here, and the conversion to it.
fn converted(name: &str) -> (String, Factor) {
    if name.starts_with("wavelength") {
        if let Some(stem) = name.strip_suffix("_um") {
            return (format!("{stem}_nm"), Factor::Times(1000.0));
        }
        if let Some(stem) = name.strip_suffix("_angstrom") {
            return (format!("{stem}_nm"), Factor::Over(10.0));
        }
    }
    if let Some(stem) = name.strip_suffix("_percent") {
        return (stem.to_owned(), Factor::Over(100.0));
    }
    (name.to_owned(), Factor::One)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_and_notes() {
        let text = "# QE, digitised\r\nwavelength_um, dark_hz, qe_percent\r\n\r\n0.4,1,50\r\n# gap\r\n0.5,2,75\r\n";
        let curve = read_str("qe.csv", text, Some("qe")).unwrap();
        assert_eq!(curve.x, [400.0, 500.0]);
        assert_eq!(curve.y, [0.5, 0.75]);
        assert_eq!((curve.x_name.as_str(), curve.y_name.as_str()), ("wavelength_nm", "qe"));
        assert_eq!(curve.notes, ["QE, digitised", "gap"]);
        assert_eq!(read_str("qe.csv", text, Some("qe_percent")).unwrap(), curve);
        let text = "wavelength_angstrom,transmission\n4000,0\n5500.5,1\n";
        assert_eq!(read_str("f.csv", text, None).unwrap().x, [400.0, 550.05]);
    }

    #[track_caller]
    fn refused(text: &str, column: Option<&str>, message: &str) {
        assert_eq!(read_str("f.csv", text, column).unwrap_err().to_string(), message);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line_and_column() {
        let head = "# a note\n\nwavelength_nm,transmission\n400,0.1\n";
        let with = |rest: &str| format!("{head}{rest}");
        refused(
            &with("# another\n410,NaN\n"),
            None,
            "f.csv:6: transmission: found `NaN`, expected a finite number",
        );
        refused(
            &with("410,0,1\n"),
            None,
            "f.csv:5: found 3 fields, expected 2 fields, one for each column",
        );
        refused(
            &with("41O,0.2\n"),
            None,
            "f.csv:5: wavelength_nm: found `41O`, expected a finite number",
        );
        refused(
            &with("390,0.2\n"),
            None,
            "f.csv:5: wavelength_nm: found 390, smaller after the line before, expected a grid that increases",
        );
        refused(
            &with("\n400.0,0.2\n"),
            None,
            "f.csv:6: wavelength_nm: found 400.0, repeated after the line before, expected a grid that increases",
        );
        refused(&with(""), None, "f.csv: found 1 rows of values, expected at least 2 rows");
        refused(
            "",
            None,
            "f.csv: found no line, expected column names, such as wavelength_nm,transmission",
        );
        refused(
            "400,0.1\n500,0.2\n",
            None,
            "f.csv:1: found `400`, expected a column name (the first line names the columns, such as \
             wavelength_nm,transmission)",
        );
        refused(
            "wavelength_nm;transmission\n",
            None,
            "f.csv:1: found `wavelength_nm;transmission`, expected two or more columns, separated by commas (semicolons and \
             tabs do not separate columns)",
        );
        refused(
            "wavelength_nm,red,green\n",
            Some("gren"),
            "f.csv:1: gren: found no such column, expected one of `red`, `green` (did you mean `green`?)",
        );
        refused(
            "wavelength_nm,red,green\n",
            None,
            "f.csv:1: found 2 columns of values, expected one, or the name of one (the columns are `red`, `green`)",
        );
        refused("a,a\n", None, "f.csv:1: a: found the column twice, expected each column once");
    }
}
