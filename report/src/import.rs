//! A file of photometry as it was understood.

use crate::{Product, ProductError};
use serde::Serialize;
use std::fmt::Write as _;
use std::path::Path;
use sunglint_formats::photometry::{Import, UNKNOWN, ZERO_POINT};
use sunglint_formats::text::counted;
use sunglint_formats::time::format_utc;
use sunglint_formats::{Column, Meta, Table, Values};
use sunglint_numerics::measured::{Interval, pair};

/// The quantity that a column was taken for.
#[derive(Debug, Clone, Serialize)]
pub struct Taken {
    /// Meaning of the column.
    pub meaning: &'static str,
    /// Name of the column.
    pub column: String,
}

/// What a command would need beyond what a file says.
#[derive(Debug, Clone, Serialize)]
pub struct Need {
    /// Commands.
    pub commands: &'static str,
    /// The needs, in words.
    pub needs: String,
}

/// Summary of an import: the JSON document.
#[derive(Debug, Clone, Serialize)]
pub struct Summary {
    /// Format, in words.
    pub format: &'static str,
    /// Name of the target; may be empty.
    pub target: String,
    /// Rows.
    pub rows: usize,
    /// Rows with a magnitude.
    pub with_magnitude: usize,
    /// First moment, UTC.
    pub from_utc: Option<String>,
    /// Last moment, UTC.
    pub to_utc: Option<String>,
    /// Brightest and faintest magnitude.
    #[serde(with = "pair")]
    pub magnitudes: Option<Interval>,
    /// True where the zero point is unknown.
    pub is_relative: bool,
    /// Sessions that the file names.
    pub sessions: usize,
    /// Filters that the file names.
    pub filters: Vec<String>,
    /// Columns of a table and what they were taken for.
    pub columns: Vec<Taken>,
    /// Columns that nothing was taken from.
    pub unused: Vec<String>,
    /// Limits and meaning of what was read.
    pub notes: Vec<String>,
    /// Numbers that cannot be what they stand for, and what became of them.
    pub warnings: Vec<String>,
    /// What commands would need beyond this.
    pub needs: Vec<Need>,
}

impl Summary {
    /// Sums up what was understood.
    pub fn new(import: &Import) -> Self {
        let s = &import.samples;
        let times = || s.time.iter().copied();
        let finite = || s.magnitude.iter().copied().filter(|m| m.is_finite());
        let different = |c: &Option<Vec<String>>| {
            let mut all: Vec<String> =
                c.iter().flatten().filter(|t| !t.is_empty()).cloned().collect();
            all.sort();
            all.dedup();
            all
        };
        let range =
            [finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max)];
        let mut notes = s.notes.clone();
        if import.of_flux {
            notes.push(
                "fluxes in an unknown unit: as magnitudes they have an unknown zero point".into(),
            );
        }
        Self {
            format: import.format,
            target: s.target.clone(),
            rows: s.time.len(),
            with_magnitude: finite().count(),
            from_utc: times().min().map(|t| format_utc(t, 3)),
            to_utc: times().max().map(|t| format_utc(t, 3)),
            magnitudes: range[0].is_finite().then(|| range.into()),
            is_relative: s.is_relative,
            sessions: different(&s.session).len(),
            filters: different(&s.filter),
            columns: import
                .columns
                .iter()
                .map(|(meaning, column)| Taken { meaning, column: column.clone() })
                .collect(),
            unused: import.unused.clone(),
            notes,
            warnings: s.warnings.clone(),
            needs: import
                .needs()
                .into_iter()
                .map(|(commands, needs)| Need { commands, needs })
                .collect(),
        }
    }

    /// Text for people.
    pub fn text(&self, path: &Path) -> String {
        let mut text =
            format!("{}: {}, {}", path.display(), self.format, counted(self.rows, "row"));
        if self.with_magnitude < self.rows {
            let _ = write!(text, ", {} of them with a magnitude", self.with_magnitude);
        }
        text.push('\n');
        let mut line = |name: &str, value: String| {
            let _ = writeln!(text, "  {name:<12}{value}");
        };
        if !self.target.is_empty() {
            line("target", self.target.clone());
        }
        if let (Some(from), Some(to)) = (&self.from_utc, &self.to_utc) {
            line("times", format!("{from} to {to}"));
        }
        if let Some(Interval { low, high }) = self.magnitudes {
            let relative = if self.is_relative { ", zero point unknown" } else { "" };
            line("magnitudes", format!("{low:.3} to {high:.3}{relative}"));
        }
        if self.sessions > 0 {
            line("sessions", self.sessions.to_string());
        }
        if !self.filters.is_empty() {
            line("filters", self.filters.join(", "));
        }
        for taken in &self.columns {
            line("column", format!("`{}` is the {}", taken.column, taken.meaning));
        }
        if !self.unused.is_empty() {
            line("not used", self.unused.join(", "));
        }
        for note in &self.notes {
            line("note", note.clone());
        }
        for need in &self.needs {
            line("needed", format!("for {}: {}", need.commands, need.needs));
        }
        text
    }

    /// The samples as a table that every command reads, with the summary as JSON. Fluxes are written as such, without magnitudes.
    ///
    /// # Errors
    /// A summary that JSON cannot hold.
    pub fn product(&self, name: &str, import: &Import) -> Result<Product, ProductError> {
        let s = &import.samples;
        let mut columns =
            vec![Column::text("time_utc", s.time.iter().map(|t| format_utc(*t, 6)).collect())];
        // Magnitudes of fluxes have a zero point of their own, and CSV cannot say so.
        let of_magnitudes = s.flux.is_none();
        if of_magnitudes {
            columns.push(Column::f64("magnitude", Some("mag"), s.magnitude.clone()));
        }
        let sigma_mag = s.sigma_mag.clone().filter(|_| of_magnitudes);
        let optional = [
            ("sigma_mag", Some("mag"), &sigma_mag),
            ("flux", None, &s.flux),
            ("sigma_flux", None, &s.sigma_flux),
            ("exposure_s", Some("s"), &s.exposure_s),
            ("range_km", Some("km"), &s.range_km),
            ("phase_deg", Some("deg"), &s.phase_deg),
            ("standard_magnitude", Some("mag"), &s.standard),
        ];
        for (name, unit, values) in optional {
            columns.extend(values.as_ref().map(|v| Column::f64(name, unit, v.clone())));
        }
        for (name, values) in [("session", &s.session), ("filter", &s.filter)] {
            columns.extend(values.as_ref().map(|v| Column {
                name: name.into(),
                unit: None,
                description: None,
                values: Values::Text(v.iter().cloned().map(Some).collect()),
            }));
        }
        let mut meta = Meta::default();
        meta.insert("source_format".into(), self.format.into());
        if s.flux.is_some() {
            meta.insert(ZERO_POINT.into(), UNKNOWN.into());
        }
        if !self.target.is_empty() {
            meta.insert("target".into(), self.target.clone().into());
        }
        let json = serde_json::to_value(self)?;
        let table = Table { meta, columns };
        Ok(Product { name: name.to_owned(), table, json, ..Product::default() })
    }
}
