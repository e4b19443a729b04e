//! A table in memory: named columns with units, and metadata. ECSV and FITS binary tables read into it and are written
//! from it.

use crate::error::{EncodeError, ParseError, nearest_names};
use std::borrow::Cow;
use std::collections::HashSet;
use std::path::Path;

/// Metadata, in the order in which it was written.
pub type Meta = serde_json::Map<String, serde_json::Value>;

/// A table: columns of one length, and what is known about them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// Free metadata (`title`, `source`, `licence`, `quantity` …).
    pub meta: Meta,
    /// The columns, all of one length.
    pub columns: Vec<Column>,
}

/// One column.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Name, with the unit as suffix where it has one (`wavelength_nm`).
    pub name: String,
    /// Unit as astropy spells it (`nm`, `W / (m2 nm)`); `None` for a pure number or text.
    pub unit: Option<String>,
    /// A sentence for people.
    pub description: Option<String>,
    /// The values.
    pub values: Values,
}

/// The values of a column. A missing value is `NaN` among floats, `None` elsewhere.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Values {
    /// Floating-point numbers; `NaN` where missing.
    F64(Vec<f64>),
    /// Whole numbers.
    I64(Vec<Option<i64>>),
    /// Truth values.
    Bool(Vec<Option<bool>>),
    /// Text; an empty text is text, not a missing value.
    Text(Vec<Option<String>>),
    /// A vector in each row, all of one width (from FITS; ECSV does not hold them).
    Vectors {
        /// Number of values in each row; at least 1.
        width: usize,
        /// The values of all rows, one row after the other; never vectors again.
        flat: Box<Values>,
    },
}

impl Values {
    /// Number of rows.
    pub fn len(&self) -> usize {
        match self {
            Values::F64(v) => v.len(),
            Values::I64(v) => v.len(),
            Values::Bool(v) => v.len(),
            Values::Text(v) => v.len(),
            Values::Vectors { width, flat } => flat.len() / (*width).max(1),
        }
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The kind in words, for error messages.
    pub fn kind(&self) -> &'static str {
        match self {
            Values::F64(_) => "floating-point numbers",
            Values::I64(_) => "whole numbers",
            Values::Bool(_) => "truth values",
            Values::Text(_) => "text",
            Values::Vectors { .. } => "vectors",
        }
    }
}

/// Mismatch between a table and what the caller requested of it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TableError {
    /// The column is not there.
    #[error("there is no column `{name}`; the columns are {}", crate::text::listed(available))]
    NoColumn {
        /// The column that was asked for.
        name: String,
        /// The columns that there are.
        available: Vec<String>,
    },
    /// The column holds something else.
    #[error("column `{name}` holds {found}, not {expected}")]
    WrongKind {
        /// The column.
        name: String,
        /// Kind of data that the column holds.
        found: &'static str,
        /// Requested kind of data.
        expected: &'static str,
    },
    /// The column is in another unit.
    #[error("column `{name}` is in {found}, expected {}", unit_in_words(expected))]
    WrongUnit {
        /// The column.
        name: String,
        /// Unit of the column.
        found: String,
        /// The unit that was asked for; empty for a pure number.
        expected: String,
    },
}

fn unit_in_words(unit: &str) -> &str {
    if unit.is_empty() { "a pure number" } else { unit }
}

impl TableError {
    /// The same as an error of the file that the table was read from.
    pub fn in_file(self, path: impl AsRef<Path>) -> ParseError {
        self.in_file_at(path.as_ref())
    }

    fn in_file_at(self, path: &Path) -> ParseError {
        match self {
            Self::NoColumn { name, available } => {
                let nearest = nearest_names(&name, available.iter().map(String::as_str), 1);
                let hint = nearest.first().map(|nearest| format!("did you mean `{nearest}`?"));
                let error = ParseError::new(
                    path,
                    "no such column",
                    format!("it beside {}", crate::text::listed(&available)),
                )
                .in_field(name);
                match hint {
                    Some(hint) => error.with_hint(hint),
                    None => error,
                }
            }
            Self::WrongKind { name, found, expected } => {
                ParseError::new(path, found, expected).in_field(name)
            }
            Self::WrongUnit { name, found, expected } => {
                ParseError::new(path, format!("the unit {found}"), unit_in_words(&expected))
                    .in_field(name)
            }
        }
    }
}

impl Table {
    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, |c| c.values.len())
    }

    /// Whether the columns have one length and a name each, as every writer needs it.
    pub(crate) fn check_columns(&self) -> Result<(), EncodeError> {
        let mut names = HashSet::new();
        for column in &self.columns {
            let bad =
                |found: String, expected: &str| EncodeError::new(&column.name, found, expected);
            if column.values.len() != self.rows() {
                let expected = format!("{} rows, as in the first column", self.rows());
                return Err(bad(format!("{} rows", column.values.len()), &expected));
            }
            if !names.insert(&column.name) {
                return Err(bad("the column twice".to_owned(), "each column once"));
            }
        }
        Ok(())
    }

    /// The column of that name.
    pub fn column(&self, name: &str) -> Result<&Column, TableError> {
        self.columns.iter().find(|c| c.name == name).ok_or_else(|| TableError::NoColumn {
            name: name.to_owned(),
            available: self.columns.iter().map(|c| c.name.clone()).collect(),
        })
    }

    /// A column of numbers (`NaN` where missing). Whole numbers are widened: a writer that found no fraction in a
    /// column may have made it one of those. Beyond 2^53 that rounds; [`Table::i64`] does not.
    pub fn f64(&self, name: &str) -> Result<Cow<'_, [f64]>, TableError> {
        numbers(self.column(name)?)
    }

    /// A column of numbers in that unit (empty for pure numbers), else as [`Table::f64`]. A column that does not say
    /// its unit is taken to be in it; blanks do not matter (`W/(m2 nm)` is `W / (m2 nm)`), but nothing is converted,
    /// and another spelling of the unit is another unit.
    pub fn quantity(&self, name: &str, unit: &str) -> Result<Cow<'_, [f64]>, TableError> {
        let column = self.column(name)?;
        let found = column.unit.as_deref().map(plain_blanks).unwrap_or_default();
        if !found.is_empty() && found != plain_blanks(unit) {
            let found = column.unit.as_deref().unwrap_or_default().trim().to_owned();
            let expected = unit.trim().to_owned();
            return Err(TableError::WrongUnit { name: name.to_owned(), found, expected });
        }
        numbers(column)
    }

    /// A column of whole numbers.
    pub fn i64(&self, name: &str) -> Result<&[Option<i64>], TableError> {
        match &self.column(name)?.values {
            Values::I64(v) => Ok(v),
            other => Err(wrong_kind(name, other, "whole numbers")),
        }
    }

    /// A column of truth values.
    pub fn bool(&self, name: &str) -> Result<&[Option<bool>], TableError> {
        match &self.column(name)?.values {
            Values::Bool(v) => Ok(v),
            other => Err(wrong_kind(name, other, "truth values")),
        }
    }

    /// A column of vectors of floating-point numbers: the width, and all rows one after the other.
    pub fn f64_vectors(&self, name: &str) -> Result<(usize, &[f64]), TableError> {
        match &self.column(name)?.values {
            Values::Vectors { width, flat } => match flat.as_ref() {
                Values::F64(v) => Ok((*width, v)),
                other => Err(wrong_kind(name, other, "vectors of floating-point numbers")),
            },
            other => Err(wrong_kind(name, other, "vectors of floating-point numbers")),
        }
    }

    /// A column of text.
    pub fn text(&self, name: &str) -> Result<&[Option<String>], TableError> {
        match &self.column(name)?.values {
            Values::Text(v) => Ok(v),
            other => Err(wrong_kind(name, other, "text")),
        }
    }

    /// A text in the metadata.
    pub fn meta_text(&self, key: &str) -> Option<&str> {
        self.meta.get(key).and_then(|v| v.as_str())
    }
}

fn numbers(column: &Column) -> Result<Cow<'_, [f64]>, TableError> {
    match &column.values {
        Values::F64(v) => Ok(Cow::Borrowed(v)),
        Values::I64(v) => Ok(v.iter().map(|v| v.map_or(f64::NAN, |v| v as f64)).collect()),
        other => Err(wrong_kind(&column.name, other, "numbers")),
    }
}

/// A unit with single blanks, and none where they mean nothing. A blank between two units multiplies them, so it stays.
fn plain_blanks(unit: &str) -> String {
    let mut plain = String::new();
    for part in unit.split_whitespace() {
        let apart = !plain.is_empty()
            && !plain.ends_with(['/', '*', '(', '^'])
            && !part.starts_with(['/', '*', ')', '^']);
        if apart {
            plain.push(' ');
        }
        plain.push_str(part);
    }
    plain
}

fn wrong_kind(name: &str, found: &Values, expected: &'static str) -> TableError {
    TableError::WrongKind { name: name.to_owned(), found: found.kind(), expected }
}

impl Column {
    /// A column of floating-point numbers.
    pub fn f64(name: impl Into<String>, unit: Option<&str>, values: Vec<f64>) -> Self {
        Self {
            name: name.into(),
            unit: unit.map(str::to_owned),
            description: None,
            values: Values::F64(values),
        }
    }

    /// A column of whole numbers, none missing.
    pub fn i64(name: impl Into<String>, unit: Option<&str>, values: Vec<i64>) -> Self {
        Self {
            name: name.into(),
            unit: unit.map(str::to_owned),
            description: None,
            values: Values::I64(values.into_iter().map(Some).collect()),
        }
    }

    /// The same column with a sentence for people.
    #[must_use]
    pub fn described(mut self, description: impl Into<String>) -> Self {
        self.description = Some(description.into());
        self
    }

    /// A column of text, none missing.
    pub fn text(name: impl Into<String>, values: Vec<String>) -> Self {
        let values = Values::Text(values.into_iter().map(Some).collect());
        Self { name: name.into(), unit: None, description: None, values }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(columns: Vec<Column>) -> Table {
        Table { columns, ..Table::default() }
    }

    #[test]
    fn whole_numbers_are_numbers() {
        let mut missing = Column::i64("i", None, vec![1, -2, i64::MAX]);
        missing.values = match missing.values {
            Values::I64(values) => Values::I64(values.into_iter().chain([None]).collect()),
            other => other,
        };
        let text = Column::text("s", vec!["1".into(); 4]);
        let table = table(vec![missing, Column::f64("f", None, vec![0.5; 4]), text]);
        let widened = table.f64("i").unwrap();
        assert_eq!(widened[..3], [1.0, -2.0, 9_223_372_036_854_775_807.0]);
        assert!(widened[3].is_nan());
        // What needs no widening is not copied.
        assert!(matches!(table.f64("f").unwrap(), Cow::Borrowed([0.5, ..])));
        let error = table.f64("s").unwrap_err();
        assert_eq!(error.to_string(), "column `s` holds text, not numbers");
        assert_eq!(error.in_file("t.ecsv").to_string(), "t.ecsv: s: found text, expected numbers");
        assert!(matches!(table.quantity("s", ""), Err(TableError::WrongKind { .. })));
        assert!(matches!(table.quantity("x", "m"), Err(TableError::NoColumn { .. })));
    }

    #[test]
    fn a_quantity_is_in_its_unit_or_in_none() {
        let unit = |unit: Option<&str>| table(vec![Column::f64("range_m", unit, vec![1.0])]);
        for (found, expected) in [
            (None, "m"),
            (Some(""), "m"),
            (Some(" "), ""),
            (Some("m"), "m"),
            (Some(" m "), "m"),
            (Some("W/(m2 nm)"), "W / (m2 nm)"),
            (Some("W / ( m2  nm )"), "W/(m2 nm)"),
            (Some("m ** 2 * s"), "m**2*s"),
        ] {
            assert_eq!(*unit(found).quantity("range_m", expected).unwrap(), [1.0], "{found:?}");
        }
        for (found, expected) in [
            ("km", "m"),
            ("M", "m"),
            ("ms", "m s"),
            ("m s", "ms"),
            ("W / m2 nm", "W / (m2 nm)"),
            ("%", ""),
        ] {
            let error = unit(Some(found)).quantity("range_m", expected).unwrap_err();
            assert!(matches!(error, TableError::WrongUnit { .. }), "{error}");
        }
        let error = unit(Some("km")).quantity("range_m", "m").unwrap_err();
        assert_eq!(error.to_string(), "column `range_m` is in km, expected m");
        assert_eq!(
            error.in_file("n.ecsv").to_string(),
            "n.ecsv: range_m: found the unit km, expected m"
        );
        let error = unit(Some("%")).quantity("range_m", "").unwrap_err();
        assert_eq!(error.to_string(), "column `range_m` is in %, expected a pure number");
        let whole = table(vec![Column::i64("alt", Some("deg"), vec![45])]);
        assert_eq!(*whole.quantity("alt", "deg").unwrap(), [45.0]);
    }
}
