//! Curves as CSV, and in layouts of refractiveindex.info and spectral libraries: a passband, a quantum efficiency, a filter transmission, as vendors' plots are digitised.
//!
//! The first column is the grid, any other may be the values: `wavelength_nm,transmission`. Lines that begin with `#`
//! are notes. Wavelengths may decrease; they increase once they are read. Wavelengths in `_um` and `_angstrom` become nanometres, `_percent` becomes a fraction, in the values and
//! in the names.

mod foreign;

use crate::error::{FileError, ParseError, excerpt, nearest_names};
use std::path::Path;

/// A curve: values over a grid that increases.
///
/// Two curves are equal if they hold the same; on which lines of their files it stood does not matter.
#[derive(Debug, Clone)]
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
    /// The line of each row.
    lines: Vec<u64>,
}

impl PartialEq for Curve {
    fn eq(&self, other: &Self) -> bool {
        // Taken apart, so that a new field cannot be forgotten here.
        let Self { x, y, x_name, y_name, notes, lines: _ } = self;
        (x, y, x_name, y_name, notes)
            == (&other.x, &other.y, &other.x_name, &other.y_name, &other.notes)
    }
}

impl Curve {
    /// The line of the file on which a row begins, counted from 1: for an error about a value that a curve may have
    /// and its user not (`error.at_line(curve.line(i))`).
    ///
    /// # Panics
    /// There was no such row in the file.
    pub fn line(&self, row: usize) -> u64 {
        self.lines[row]
    }
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
/// increase (or wavelengths that turn), a wrong number of fields, less than two rows, wavelengths that are obviously in another
/// unit (nanometres as micrometres, micrometres or ångström as nanometres), a column in percent without a value above 1.
pub fn read_str(
    path: impl AsRef<Path>,
    text: &str,
    column: Option<&str>,
) -> Result<Curve, ParseError> {
    read_str_at(path.as_ref(), text, column)
}

fn read_str_at(path: &Path, text: &str, column: Option<&str>) -> Result<Curve, ParseError> {
    if let Some(found) = foreign::read(path, text, column) {
        return found;
    }
    let notes = text.lines().filter_map(|line| line.strip_prefix('#'));
    let notes = notes.map(|note| note.trim().to_owned()).collect();
    let mut rows = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .comment(Some(b'#'))
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let mut record = csv::StringRecord::new();
    let mut line_counter = LineCounter { text, byte: 0, line: 1 };
    let mut next = |record: &mut csv::StringRecord| match rows.read_record(record) {
        Ok(more) => Ok(more.then(|| line_counter.line_of(record))),
        Err(error) => Err(ParseError::new(path, error.to_string(), "comma-separated values")),
    };
    let Some(header) = next(&mut record)? else {
        return Err(ParseError::new(
            path,
            "no line",
            "column names, such as wavelength_nm,transmission",
        ));
    };
    let names: Vec<String> = record.iter().map(str::to_owned).collect();
    check_names(path, header, &names)?;
    let index = value_column(path, header, &names, column)?;
    let (x_name, x_factor) = converted(&names[0]);
    let (y_name, y_factor) = converted(&names[index]);
    let mut found = Rows::new(path, &names[0], Unit::of(&names[0], x_factor), x_name, y_name);
    found.curve.notes = notes;
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
        found.push(line, &record[0], x, y)?;
    }
    let curve = found.finish()?;
    let most = curve.y.iter().copied().fold(0.0, f64::max);
    if let Some(stem) = without_percent(&names[index])
        && most > 0.0
        && most <= 0.01
    {
        let found = format!("no value above {} %", most * 100.0);
        let error = ParseError::new(path, found, "percent").at_line(header).in_field(&names[index]);
        return Err(error.with_hint(format!(
            "if they are fractions, name it {stem}; if they are percent, divide them by 100 and name it {stem}, too"
        )));
    }
    Ok(curve)
}

/// A curve as its rows come.
struct Rows<'a> {
    path: &'a Path,
    /// The grid's name in the file.
    name: &'a str,
    unit: Unit,
    curve: Curve,
    /// Whether it goes down: libraries list wavelengths from long to short, too.
    falling: bool,
}

impl<'a> Rows<'a> {
    fn new(path: &'a Path, name: &'a str, unit: Unit, x_name: String, y_name: String) -> Self {
        let curve = Curve {
            x: Vec::new(),
            y: Vec::new(),
            x_name,
            y_name,
            notes: Vec::new(),
            lines: Vec::new(),
        };
        Self { path, name, unit, curve, falling: false }
    }

    /// `shown` is `x` as the file has it.
    fn push(&mut self, line: u64, shown: &str, x: f64, y: f64) -> Result<(), ParseError> {
        // In nanometres a number may be beyond all of them.
        if !(x.is_finite() && y.is_finite()) {
            let error = ParseError::new(self.path, excerpt(shown), "a finite number of nm");
            return Err(error.at_line(line).in_field(self.name));
        }
        let curve = &mut self.curve;
        if let Some(&last) = curve.x.last() {
            if curve.x.len() == 1 && curve.x_name.starts_with("wavelength") {
                self.falling = x < last;
            }
            let (what, expected) = match (x == last, self.falling) {
                (true, true) => ("repeated", "a grid that goes on decreasing"),
                (true, false) => ("repeated", "a grid that increases"),
                (false, true) => ("larger", "a grid that goes on decreasing"),
                (false, false) => ("smaller", "a grid that increases"),
            };
            if x == last || (x < last) != self.falling {
                let found = format!("{shown}, {what} after the line before");
                let error = ParseError::new(self.path, found, expected);
                return Err(error.at_line(line).in_field(self.name));
            }
        }
        curve.x.push(x);
        curve.y.push(y);
        curve.lines.push(line);
        Ok(())
    }

    fn finish(self) -> Result<Curve, ParseError> {
        let mut curve = self.curve;
        if curve.x.len() < 2 {
            let found = format!("{} rows of values", curve.x.len());
            return Err(ParseError::new(self.path, found, "at least 2 rows"));
        }
        if self.falling {
            curve.x.reverse();
            curve.y.reverse();
            curve.lines.reverse();
        }
        self.unit.check(self.path, self.name, &curve)?;
        Ok(curve)
    }
}

/// Unit of a grid that its name says, which somebody may have got wrong.
#[derive(Clone, Copy)]
enum Unit {
    /// `wavelength_nm`.
    Nanometre,
    /// Micrometres.
    Micrometre,
    /// No wavelengths, or a file that says its unit in words of its own.
    Other,
}

impl Unit {
    fn of(name: &str, factor: Factor) -> Self {
        match factor {
            Factor::Times(_) => Self::Micrometre,
            _ if name.eq_ignore_ascii_case("wavelength_nm") => Self::Nanometre,
            _ => Self::Other,
        }
    }

    /// Refuses wavelengths that are obviously in another unit, by where they begin and end, nm. Each refusal names the column in which the same numbers would be read as they stand.
    fn check(self, path: &Path, name: &str, curve: &Curve) -> Result<(), ParseError> {
        // No optics are tabulated beyond 100 µm only.
        const FARTHEST_NM: f64 = 1e5;
        // Nor below 20 nm only.
        const NEAREST_NM: f64 = 20.0;
        // The optics and detectors of the visible and the near infrared, in ångström.
        const ANGSTROM: std::ops::RangeInclusive<f64> = 3000.0..=30_000.0;
        let (first, last) = (curve.x[0], curve.x[curve.x.len() - 1]);
        let wrong = |found: String, expected: &str, hint: &str| {
            Err(ParseError::new(path, found, expected).in_field(name).with_hint(hint))
        };
        match self {
            Self::Micrometre if first >= FARTHEST_NM => wrong(
                format!("{} to {} µm", first / 1e3, last / 1e3),
                "wavelengths in micrometres",
                "if they are in nanometres, name the column wavelength_nm",
            ),
            Self::Nanometre if first >= 0.0 && last < NEAREST_NM => wrong(
                format!("{first} to {last} nm"),
                "wavelengths in nm",
                "if they are in micrometres, name the column wavelength_um",
            ),
            Self::Nanometre if ANGSTROM.contains(&first) && ANGSTROM.contains(&last) => wrong(
                format!("{first} to {last} nm"),
                "wavelengths in nm",
                "if they are in ångström, name the column wavelength_angstrom, or divide them by 10; if this is the infrared, write micrometres under wavelength_um",
            ),
            _ => Ok(()),
        }
    }
}

/// Counts lines from record to record, so that a long file is counted once.
struct LineCounter<'a> {
    text: &'a str,
    /// The beginning of a line, and its number.
    byte: usize,
    line: u64,
}

impl LineCounter<'_> {
    /// The line on which a record begins. The position that csv gives is before the comments and blank lines above it.
    /// Records must come in their order.
    fn line_of(&mut self, record: &csv::StringRecord) -> u64 {
        let mut start = record.position().map_or(0, |position| position.byte() as usize);
        // It may also be amid the two characters that end the line before.
        while let Some(b'\r' | b'\n') = self.text.as_bytes().get(start) {
            start += 1;
        }
        for line in self.text.get(self.byte..).unwrap_or("").split_inclusive('\n') {
            let end = self.byte + line.len();
            // Other blanks, and a `#` after some, are a record to csv.
            if end > start && !line.starts_with(['\r', '\n', '#']) {
                break;
            }
            self.byte = end;
            self.line += 1;
        }
        self.line
    }
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
    let is_alike = |name: &String| {
        name.eq_ignore_ascii_case(wanted) || converted(name).0.eq_ignore_ascii_case(wanted)
    };
    let mut values = names[1..].iter();
    if let Some(index) = values.clone().position(is_it).or_else(|| values.position(is_alike)) {
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

/// Factor that a value is multiplied with. Division by a whole number rounds once where multiplying by its inverse rounds
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
    let lower = name.to_lowercase();
    if lower.starts_with("wavelength") {
        if let Some(stem) = lower.strip_suffix("_um") {
            return (format!("{stem}_nm"), Factor::Times(1000.0));
        }
        if let Some(stem) = lower.strip_suffix("_angstrom") {
            return (format!("{stem}_nm"), Factor::Over(10.0));
        }
        return (lower, Factor::One);
    }
    match without_percent(name) {
        Some(stem) => (stem.to_owned(), Factor::Over(100.0)),
        None => (name.to_owned(), Factor::One),
    }
}

/// The name of a column in percent, without that.
fn without_percent(name: &str) -> Option<&str> {
    const PERCENT: &str = "_percent";
    let (stem, end) = name.split_at_checked(name.len().checked_sub(PERCENT.len())?)?;
    end.eq_ignore_ascii_case(PERCENT).then_some(stem)
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

    #[test]
    fn each_row_knows_its_line() {
        let text = "# a\n\nwavelength_nm,\"a\nname\",b\r\n# b\r\n100,2,3\n\r\n#\n200,3,\"two\nlines\"\n# c\n300,4,5";
        let curve = read_str("f.csv", text, Some("a\nname")).unwrap();
        assert_eq!((0..3).map(|row| curve.line(row)).collect::<Vec<_>>(), [6, 9, 12]);
        // The same curve from other lines is the same curve.
        let notes = "# a\n# b\n#\n# c\n";
        let text = format!("{notes}wavelength_nm,\"a\nname\"\n100,2\n200,3\n300,4\n");
        let same = read_str("f.csv", &text, None).unwrap();
        assert_eq!((same.line(0), same.line(2)), (7, 9));
        assert_eq!(same, curve);
        assert_ne!(read_str("f.csv", &text.replace("0,4", "0,5"), None).unwrap(), curve);
    }

    #[test]
    fn lines_of_a_long_file_are_counted_once() {
        let mut text = String::from("wavelength_nm,y\n");
        (0..200_000)
            .for_each(|i| text.push_str(&format!("{i},0.123456789012345678901234567890\n")));
        let curve = read_str("f.csv", &text, None).unwrap();
        assert_eq!(curve.line(199_999), 200_001);
    }

    /// Truth: the numbers of the text, of which µm are a thousand times as many nm (synthetic).
    #[test]
    fn wavelengths_may_decrease_and_names_may_be_written_large() {
        let text = "Wavelength_um,QE_Percent,note\n1.24,80,1\n0.6,70,2\n0.3,60,3\n";
        let curve = read_str("f.csv", text, Some("qe")).unwrap();
        assert_eq!((&*curve.x, &*curve.y), (&[300.0, 600.0, 1240.0][..], &[0.6, 0.7, 0.8][..]));
        assert_eq!((curve.line(0), curve.line(2)), (4, 2));
        assert_eq!((&*curve.x_name, &*curve.y_name), ("wavelength_nm", "QE"));
        let message = |text: &str| read_str("f.csv", text, None).unwrap_err().to_string();
        assert!(
            message("wavelength_nm,a\n3,1\n2,1\n2,1\n")
                .contains(":4: wavelength_nm: found 2, repeated")
        );
        assert!(
            message("wavelength_nm,a\n3,1\n2,1\n2.5,1\n")
                .contains(":4: wavelength_nm: found 2.5, larger")
        );
        assert!(message("measured_hz,true_hz\n3,3\n2,2\n").contains("a grid that increases"));
    }

    #[test]
    fn units_that_cannot_be_are_refused_with_the_way_out() {
        let message = |text: &str| read_str("f.csv", text, None).unwrap_err().to_string();
        let said = message("wavelength_um,efficiency\n400,0.4\n1000,0.2\n");
        assert!(
            said.contains("400 to 1000 µm") && said.contains("name the column wavelength_nm"),
            "{said}"
        );
        // Bessell's U, V and a silicon detector in ångström, the last as they begin and end in the table of a maker.
        for (text, range) in [
            ("wavelength_nm,transmission\n3000,0\n4200,1\n", "3000 to 4200 nm"),
            ("wavelength_nm,transmission\n4700,0\n7000,1\n", "4700 to 7000 nm"),
            ("Wavelength_nm,qe\n11000,0.1\n3000,0.3\n", "3000 to 11000 nm"),
        ] {
            let said = message(text);
            for words in [range, "divide them by 10", "wavelength_angstrom", "wavelength_um"] {
                assert!(said.contains(words), "{said}");
            }
        }
        let said = message("wavelength_nm,n\n0.3,1\n14,2\n");
        assert!(
            said.contains("0.3 to 14 nm") && said.contains("name the column wavelength_um"),
            "{said}"
        );
        let said = message("wavelength_nm,qe_percent\n400,0.4\n1000,1\n");
        assert!(said.contains("f.csv:1: qe_percent") && said.contains("name it qe"), "{said}");
        // Infrared optics, a curve of which a part is black, one that is 0.
        for text in [
            "wavelength_um,n\n0.3,1\n30,2\n",
            "wavelength_um,n\n20,1\n99,2\n",
            "wavelength_um,n\n3,1\n5,2\n",
            "wavelength_angstrom,n\n3000,1\n11000,2\n",
            "wavelength_nm,n\n2500,1\n25000,2\n",
            "wavelength_nm,n\n3000,1\n100000,2\n",
            "wavelength_nm,qe_percent\n400,0.4\n500,1.1\n",
            "wavelength_nm,qe_percent\n400,0\n500,0\n",
        ] {
            read_str("f.csv", text, None).unwrap();
        }
    }

    /// Truth: the numbers of the texts, written by hand in the layouts of refractiveindex.info (synthetic).
    #[test]
    fn indices_of_refractiveindex_info() {
        let yaml = "REFERENCES: |\n    1) x\nDATA:\n  - type: tabulated nk\n    data: |\n        0.3 0.5 3.5\n        0.5 0.75 4\nSPECS:\n    film: yes\n";
        let two = "DATA:\n  - type: tabulated n\n    data: |\n        0.3 0.5\n        0.5 0.75\n  - type: tabulated k\n    data: |\n        0.3 3.5\n        0.5 4\n";
        let export = "wl,n\n0.3,0.5\n0.5,0.75\n\nwl,k\n0.3,3.5\n0.5,4\n";
        let (tabs, old) = (
            "wl\tn\tk\n0.3\t0.5\t3.5\n0.5\t0.75\t4\n",
            "\"Wavelength, µm\",n,k\n0.3,0.5,3.5\n0.5,0.75,4\n",
        );
        for text in [yaml, two, export, tabs, old, &old.replace('"', "")] {
            for (name, values) in [("n", [0.5, 0.75]), ("k", [3.5, 4.0])] {
                let curve = read_str("x", text, Some(name)).unwrap();
                assert_eq!((&*curve.x, &*curve.y), (&[300.0, 500.0][..], &values[..]), "{text}");
                assert_eq!((&*curve.x_name, &*curve.y_name), ("wavelength_nm", name));
            }
        }
        assert_eq!(read_str("x", yaml, Some("k")).unwrap().line(1), 7);
        for (text, said) in [
            (&*yaml.replace("tabulated nk", "formula 2"), "x:4: type: found `formula 2`"),
            (&yaml.replace("0.5 0.75 4", "0.5 0.75"), "x:7: found `0.5 0.75`, expected 3 numbers"),
            (&export.replace("0.5,4", "0.6,4"), "x:7: found k at other wavelengths than n"),
            ("wl,n\n0.3,0.5\n0.5,0.75\n", "x: k: found no values of it"),
            (&yaml.replace("0.5 0.75 4", "0.3 0.75 4"), "x:7: wavelength_um: found 0.3, repeated"),
            // Beyond all doubles in nm.
            (&yaml.replace("0.5 0.75 4", "1e306 0.75 4"), "expected a finite number of nm"),
        ] {
            let error = read_str("x", text, Some("k")).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
    }

    /// Truth: the numbers of the text, written by hand in the layouts of the libraries (synthetic).
    #[test]
    fn spectral_libraries() {
        let text = "Name: Aluminum Metal\nType: manmade\nX Units: Wavelength (micrometers)\nY Units: Reflectance (percent)\n\n 14.0000\t 95.0000\n 0.3000\t 65.0000\n";
        let curve = read_str("x", text, Some("reflectance")).unwrap();
        assert_eq!((&*curve.x, &*curve.y), (&[300.0, 14_000.0][..], &[0.65, 0.95][..]));
        let error = read_str("x", &text.replace("Reflectance", "Emissivity"), None).unwrap_err();
        assert!(error.to_string().contains("Y Units"), "{error}");
        let text = " splib07a Record=1: Aluminum ASDFRa AREF\n -1.2300000e+34\n 5.0e-01\n";
        let error = read_str("x", text, Some("reflectance")).unwrap_err().to_string();
        assert!(
            error.contains("USGS") && error.contains("wavelengths in a file of their own"),
            "{error}"
        );
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
            &with("410,0.2\n390,0.2\n"),
            None,
            "f.csv:6: wavelength_nm: found 390, smaller after the line before, expected a grid that increases",
        );
        refused(
            &with("\n400.0,0.2\n"),
            None,
            "f.csv:6: wavelength_nm: found 400.0, repeated after the line before, expected a grid that increases",
        );
        refused(
            &with("\r\n  \n410,0.2"),
            None,
            "f.csv:6: found 1 fields, expected 2 fields, one for each column",
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
