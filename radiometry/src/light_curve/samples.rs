//! Columns that light curves of every kind share: when each sample was taken, for how long, and from where the target was seen.

use super::Flags;
use hifitime::Epoch;
use std::path::Path;
use sunglint_formats::flag_bits::Numbering;
use sunglint_formats::time::{UtcDay, format_utc, format_utc_shortest, parse_utc};
use sunglint_formats::{Column, ParseError, Table, Values, nearest_names};

/// Times and geometry of the samples of a light curve; all of one length. Times may be in any order, and repeat: whoever needs an
/// order sorts.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Samples {
    /// Mid-exposure times.
    pub time: Vec<Epoch>,
    /// Exposure times, s, each above 0.
    pub exposure_s: Vec<f64>,
    /// Distance from station to target, m.
    pub range_m: Option<Vec<f64>>,
    /// Phase angle, Sun–target–station, degrees 0–180.
    pub phase_deg: Option<Vec<f64>>,
    /// True zenith angle of the target, degrees 0–180.
    pub zenith_deg: Option<Vec<f64>>,
}

impl Samples {
    /// Samples of one exposure time, without geometry.
    pub fn new(time: Vec<Epoch>, exposure_s: f64) -> Self {
        let exposure_s = vec![exposure_s; time.len()];
        Self { time, exposure_s, ..Self::default() }
    }

    /// The names of the columns.
    pub(super) const COLUMNS: [&'static str; 5] =
        ["time_utc", "exposure_s", "range_m", "phase_deg", "zenith_deg"];

    fn optional(&self) -> [(&'static str, &'static str, &Option<Vec<f64>>); 3] {
        [
            ("range_m", "m", &self.range_m),
            ("phase_deg", "deg", &self.phase_deg),
            ("zenith_deg", "deg", &self.zenith_deg),
        ]
    }

    /// Time and exposure, which come first in a table, and the geometry, which comes last.
    pub(super) fn columns(&self) -> (Vec<Column>, Vec<Column>) {
        let mut time =
            Column::text("time_utc", self.time.iter().map(|t| format_utc_shortest(*t)).collect());
        time.description = Some("mid-exposure, ISO 8601".into());
        let first = vec![time, Column::f64("exposure_s", Some("s"), self.exposure_s.clone())];
        let column = |(name, unit, values): (&str, &str, &Option<Vec<f64>>)| {
            values.as_ref().map(|values| Column::f64(name, Some(unit), values.clone()))
        };
        (first, self.optional().into_iter().filter_map(column).collect())
    }

    pub(super) fn read(reader: &Reader) -> Result<Self, ParseError> {
        Ok(Self {
            time: reader.times("time_utc")?,
            exposure_s: reader.numbers("exposure_s", "s")?,
            range_m: reader.optional("range_m", "m")?,
            phase_deg: reader.optional("phase_deg", "deg")?,
            zenith_deg: reader.optional("zenith_deg", "deg")?,
        })
    }

    /// Refuses what no samples can be. `path` names the file in errors.
    pub(super) fn check(&self, path: &Path) -> Result<(), ParseError> {
        let wrong = |field: String, found: String, expected: &str| {
            Err(ParseError::new(path, found, expected).in_field(field))
        };
        let n = self.time.len();
        let lengths = self
            .optional()
            .into_iter()
            .filter_map(|(name, _, values)| Some((name, values.as_ref()?.len())));
        let mut lengths = std::iter::once(("exposure_s", self.exposure_s.len())).chain(lengths);
        if let Some((field, length)) = lengths.find(|(_, length)| *length != n) {
            return wrong(
                field.into(),
                format!("{length} values"),
                &format!("{n}, as many as time_utc"),
            );
        }
        if let Some(i) = self.time.iter().position(|t| UtcDay::containing(*t).is_none()) {
            return wrong(
                row("time_utc", i),
                format_utc(self.time[i], 0),
                "a time from 1972 to 2100",
            );
        }
        let bad =
            |values: &[f64], good: &dyn Fn(f64) -> bool| values.iter().position(|v| !good(*v));
        if let Some(i) = bad(&self.exposure_s, &|s| s.is_finite() && s > 0.0) {
            return wrong(row("exposure_s", i), self.exposure_s[i].to_string(), "a time above 0 s");
        }
        for (name, _, values) in self.optional() {
            let Some(values) = values else { continue };
            let found = if name == "range_m" {
                bad(values, &|m| m.is_finite() && m > 0.0).map(|i| (i, "a distance above 0 m"))
            } else {
                bad(values, &|deg| (0.0..=180.0).contains(&deg))
                    .map(|i| (i, "an angle from 0 to 180 degrees"))
            };
            if let Some((i, expected)) = found {
                return wrong(row(name, i), values[i].to_string(), expected);
            }
        }
        Ok(())
    }
}

/// A place in a table for an error message; rows count from 1.
pub(super) fn row(column: &str, i: usize) -> String {
    format!("{column}, row {}", i + 1)
}

/// Reads columns of a table, with the file's name in the errors.
pub(super) struct Reader<'a> {
    pub path: &'a Path,
    pub table: &'a Table,
}

impl Reader<'_> {
    fn column(&self, name: &str) -> Result<&Values, ParseError> {
        self.table.column(name).map(|c| &c.values).map_err(|_| {
            let found: Vec<&str> = self.table.columns.iter().map(|c| c.name.as_str()).collect();
            let error = ParseError::new(self.path, "no such column", format!("a column `{name}`"))
                .in_field(name);
            match nearest_names(name, found.iter().copied(), 1).first() {
                Some(near) => error.with_hint(format!("the nearest is `{near}`")),
                None => error,
            }
        })
    }

    /// The numbers of a column, which must be in `unit` or name none.
    pub fn numbers(&self, name: &str, unit: &str) -> Result<Vec<f64>, ParseError> {
        self.column(name)?;
        let numbers = self.table.quantity(name, unit).map_err(|error| error.in_file(self.path))?;
        Ok(numbers.into_owned())
    }

    pub fn optional(&self, name: &str, unit: &str) -> Result<Option<Vec<f64>>, ParseError> {
        match self.table.column(name) {
            Ok(_) => self.numbers(name, unit).map(Some),
            Err(_) => Ok(None),
        }
    }

    pub fn times(&self, name: &str) -> Result<Vec<Epoch>, ParseError> {
        let Values::Text(values) = self.column(name)? else {
            return Err(
                ParseError::new(self.path, "numbers", "times as text, ISO 8601").in_field(name)
            );
        };
        let time = |(i, text): (usize, &Option<String>)| {
            let text = text.as_deref().unwrap_or("");
            parse_utc(text).map_err(|error| {
                ParseError::new(
                    self.path,
                    format!("`{text}`"),
                    "a time such as 2026-11-20T18:30:00.5",
                )
                .in_field(row(name, i))
                .with_hint(error.to_string())
            })
        };
        values.iter().enumerate().map(time).collect()
    }

    pub fn flags(&self, name: &str, bits: &Numbering<Flags>) -> Result<Vec<Flags>, ParseError> {
        let Values::I64(values) = self.column(name)? else {
            return Err(ParseError::new(self.path, "no whole numbers", "flag bits").in_field(name));
        };
        let read = |(i, value): (usize, &Option<i64>)| {
            value.and_then(|v| bits.flags(v)).ok_or_else(|| {
                let found = value.map_or_else(|| "nothing".to_owned(), |v| v.to_string());
                ParseError::new(self.path, found, "bits that flag_bits in the metadata names")
                    .in_field(row(name, i))
            })
        };
        values.iter().enumerate().map(read).collect()
    }

    /// Refuses a column that is not among `known`.
    pub fn refuse_unknown(&self, known: &[String]) -> Result<(), ParseError> {
        let Some(column) = self.table.columns.iter().find(|c| !known.contains(&c.name)) else {
            return Ok(());
        };
        let error = ParseError::new(self.path, "an unknown column", "the columns of a light curve")
            .in_field(column.name.clone());
        Err(match nearest_names(&column.name, known.iter().map(String::as_str), 1).first() {
            Some(near) => error.with_hint(format!("did you mean `{near}`?")),
            None => error,
        })
    }
}
