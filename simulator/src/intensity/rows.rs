//! Tables of aspects, read row by row: comma-separated values with the names in the first line and notes after `#`.
//!
//! `sun_x, sun_y, sun_z, observer_x, observer_y, observer_z` must be there; `range_km`, `sun_distance_au`, and `earth_x, earth_y, earth_z, height_km` may. A row may
//! leave those empty: it then has a far observer, the Sun at 1 au, no Earth (all four of the Earth's or none).

use super::Aspect;
use glam::DVec3;
use std::io::BufRead;
use std::path::{Path, PathBuf};
use sunglint_formats::{FileError, ParseError};

/// Columns, in the order of the numbers of a row.
const NAMES: [&str; 12] = [
    "sun_x",
    "sun_y",
    "sun_z",
    "observer_x",
    "observer_y",
    "observer_z",
    "range_km",
    "sun_distance_au",
    "earth_x",
    "earth_y",
    "earth_z",
    "height_km",
];
/// Those that must be there.
const NEEDED: usize = 6;
/// Those of the Earth: all of them or none.
const EARTH: std::ops::Range<usize> = 8..12;
/// A longer line is none of a table, bytes.
const LONGEST: u64 = 1 << 16;

/// Aspects of a table, one after the other: memory does not grow with the rows.
pub struct Rows<R> {
    path: PathBuf,
    from: R,
    line: u64,
    /// The number of each field of a row.
    fields: Vec<usize>,
    text: String,
}

impl<R: BufRead> Rows<R> {
    /// Reads the names of the columns.
    ///
    /// # Errors
    /// Missing or unknown columns.
    pub fn new(path: &Path, from: R) -> Result<Self, FileError> {
        let (fields, text) = (Vec::new(), String::new());
        let mut rows = Self { path: path.to_owned(), from, line: 0, fields, text };
        let expected = "sun_x, sun_y, sun_z, observer_x, observer_y, observer_z (and range_km, sun_distance_au, earth_x, earth_y, earth_z, height_km) in the first line";
        if !rows.advance()? {
            return Err(ParseError::new(path, "no line", expected).into());
        }
        for name in rows.text.split(',').map(str::trim) {
            let Some(number) = NAMES.iter().position(|known| *known == name) else {
                let error = ParseError::new(path, format!("the column `{name}`"), expected);
                return Err(error.at_line(rows.line).into());
            };
            if rows.fields.contains(&number) {
                let error = ParseError::new(path, format!("the column `{name}` twice"), expected);
                return Err(error.at_line(rows.line).into());
            }
            rows.fields.push(number);
        }
        let has = |k: &usize| rows.fields.contains(k);
        let earth = EARTH.filter(has).count();
        let missing = (0..NEEDED).find(|k| !has(k));
        let missing = missing.or(EARTH.clone().find(|k| earth > 0 && !has(k)));
        match missing {
            None => Ok(rows),
            Some(k) => {
                let found = format!("no column `{}`", NAMES[k]);
                Err(ParseError::new(path, found, expected).at_line(rows.line).into())
            }
        }
    }

    /// The number of the line that was read last.
    pub fn line(&self) -> u64 {
        self.line
    }

    /// Goes to the next line that is neither empty nor a note; false at the end.
    fn advance(&mut self) -> Result<bool, FileError> {
        loop {
            self.text.clear();
            let path = &self.path;
            let mut some = std::io::Read::take(&mut self.from, LONGEST);
            let read =
                some.read_line(&mut self.text).map_err(|e| FileError::io("read", path, e))?;
            self.line += 1;
            if read == 0 {
                return Ok(false);
            }
            if read as u64 == LONGEST {
                let error = ParseError::new(path, "more than 65,536 bytes", "a row of numbers");
                return Err(error.at_line(self.line).into());
            }
            let text = self.text.trim();
            if !text.is_empty() && !text.starts_with('#') {
                return Ok(true);
            }
        }
    }

    fn row(&mut self) -> Result<Option<Aspect>, FileError> {
        if !self.advance()? {
            return Ok(None);
        }
        let mut numbers = [f64::NAN; NAMES.len()];
        let mut count = 0;
        for (k, field) in self.text.split(',').map(str::trim).enumerate() {
            count += 1;
            let Some(&number) = self.fields.get(k) else { continue };
            // What need not be there may be empty.
            if field.is_empty() && number >= NEEDED {
                continue;
            }
            let value = field.parse::<f64>().ok().filter(|v| v.is_finite());
            numbers[number] = value.ok_or_else(|| {
                let error = ParseError::new(&self.path, format!("`{field}`"), "a number");
                error.at_line(self.line).in_field(NAMES[number])
            })?;
        }
        if count != self.fields.len() {
            let found = format!("{count} fields");
            let expected = format!("{}, as many as names", self.fields.len());
            return Err(ParseError::new(&self.path, found, expected).at_line(self.line).into());
        }
        let given = |k: usize| (!numbers[k].is_nan()).then_some(numbers[k]);
        let earth = EARTH.filter(|k| given(*k).is_some()).count();
        if let Some(k) = EARTH.clone().find(|k| earth > 0 && given(*k).is_none()) {
            let expected = "a number, or none of earth_x, earth_y, earth_z and height_km";
            let error = ParseError::new(&self.path, "nothing", expected);
            return Err(error.at_line(self.line).in_field(NAMES[k]).into());
        }
        let three = |k: usize| DVec3::new(numbers[k], numbers[k + 1], numbers[k + 2]);
        Ok(Some(Aspect {
            sun: three(0),
            observer: three(3),
            range_m: given(6).map(|km| km * 1e3),
            sun_distance_au: given(7).unwrap_or(1.0),
            earth: given(11).map(|km| (three(8), km * 1e3)),
        }))
    }
}

impl<R: BufRead> Iterator for Rows<R> {
    type Item = Result<Aspect, FileError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.row().transpose()
    }
}
