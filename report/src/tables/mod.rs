//! Embedded tables: a list of them, or one with its source.

mod figure;

use crate::{Product, json_of};
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_formats::{Column, Table, Values};
use sunglint_radiometry::tables::Embedded;

/// An embedded table in all its forms.
pub fn product(embedded: &Embedded) -> Product {
    Product {
        name: embedded.name.to_owned(),
        table: embedded.table().clone(),
        figure: figure::figure(embedded.name, embedded.table()),
        json: Description::of(embedded).json(),
        ..Product::default()
    }
}

/// Text of an embedded table: where it is from, and its first rows.
pub fn text(embedded: &Embedded) -> String {
    let table = embedded.table();
    let is_curve = figure::figure(embedded.name, table).is_some();
    Description::of(embedded).text(table, is_curve)
}

/// Description of an embedded table.
pub struct Description {
    name: &'static str,
    title: String,
    rows: usize,
    /// Name, first and last value of the first column of numbers: what the table runs over.
    range: Option<(String, f64, f64)>,
    source: String,
    licence: String,
    note: String,
    sha256: String,
}

#[derive(Serialize)]
struct DescriptionJson<'a> {
    name: &'a str,
    title: &'a str,
    rows: usize,
    range: Option<RangeJson<'a>>,
    source: &'a str,
    licence: &'a str,
    note: &'a str,
    sha256: &'a str,
}

#[derive(Serialize)]
struct RangeJson<'a> {
    column: &'a str,
    from: f64,
    to: f64,
}

impl Description {
    /// Describes an embedded table.
    pub fn of(embedded: &Embedded) -> Self {
        let table = embedded.table();
        let meta = |key: &str| table.meta_text(key).unwrap_or_default().to_owned();
        Self {
            name: embedded.name,
            title: meta("title"),
            rows: table.rows(),
            range: table.columns.iter().find_map(range),
            source: meta("source"),
            licence: meta("licence"),
            note: meta("note"),
            sha256: sunglint_formats::sha256(embedded.text.as_ref()),
        }
    }

    /// Summary with its documented keys.
    pub fn json(&self) -> Value {
        json_of(&DescriptionJson {
            name: self.name,
            title: &self.title,
            rows: self.rows,
            range: self.range.as_ref().map(|(column, from, to)| RangeJson {
                column,
                from: *from,
                to: *to,
            }),
            source: &self.source,
            licence: &self.licence,
            note: &self.note,
            sha256: &self.sha256,
        })
    }

    fn range_text(&self) -> String {
        self.range
            .as_ref()
            .map_or(String::new(), |(column, from, to)| format!("{column} {from} to {to}"))
    }

    fn text(&self, table: &Table, curve: bool) -> String {
        let mut text = format!("{}: {}\n", self.name, self.title);
        let _ = writeln!(text, "  rows     {} ({})", self.rows, self.range_text());
        let _ = writeln!(text, "  source   {}", self.source);
        let _ = writeln!(text, "  licence  {}", self.licence);
        let _ = writeln!(text, "  sha256   {}", self.sha256);
        if !self.note.is_empty() {
            let _ = writeln!(text, "  note     {}", self.note);
        }
        let columns: Vec<String> = table
            .columns
            .iter()
            .map(|c| c.unit.as_ref().map_or(c.name.clone(), |unit| format!("{} [{unit}]", c.name)))
            .collect();
        let _ = writeln!(text, "  columns  {}", columns.join(", "));
        first_rows(&mut text, table);
        let _ = write!(text, "write it with: sunglint tables {0} -o {0}.ecsv", self.name);
        text.push_str(if curve { " (draw it with .png or .svg)\n" } else { "\n" });
        text
    }
}

/// The first rows, as wide as a terminal has room.
fn first_rows(text: &mut String, table: &Table) {
    const ROWS: usize = 5;
    const COLUMNS: usize = 8;
    let shown = &table.columns[..table.columns.len().min(COLUMNS)];
    let rows = table.rows().min(ROWS);
    let cells: Vec<Vec<String>> = shown
        .iter()
        .map(|c| std::iter::once(c.name.clone()).chain((0..rows).map(|row| cell(c, row))).collect())
        .collect();
    text.push('\n');
    for row in 0..=rows {
        for column in &cells {
            let width = column.iter().map(|c| c.chars().count()).max().unwrap_or(0);
            let _ = write!(text, "  {:>width$}", column[row]);
        }
        text.push_str(match (row, table.columns.len() > COLUMNS) {
            (_, false) => "\n",
            (0, true) => "  … (more columns)\n",
            (_, true) => "  …\n",
        });
    }
    if table.rows() > rows {
        let _ = writeln!(text, "  … and {} more rows", table.rows() - rows);
    }
    text.push('\n');
}

fn cell(column: &Column, row: usize) -> String {
    fn or_nothing<T: ToString>(value: Option<&Option<T>>) -> String {
        value.and_then(Option::as_ref).map_or_else(|| "-".to_owned(), T::to_string)
    }
    match &column.values {
        Values::F64(values) => match values.get(row) {
            Some(value) if value.is_finite() => {
                if *value == 0.0 || (1e-4..1e7).contains(&value.abs()) {
                    value.to_string()
                } else {
                    format!("{value:e}")
                }
            }
            _ => "-".to_owned(),
        },
        Values::I64(values) => or_nothing(values.get(row)),
        Values::Bool(values) => or_nothing(values.get(row)),
        Values::Text(values) => or_nothing(values.get(row)),
        _ => "…".to_owned(),
    }
}

fn range(column: &Column) -> Option<(String, f64, f64)> {
    let Values::F64(values) = &column.values else { return None };
    let finite = values.iter().copied().filter(|v| v.is_finite());
    let (lo, hi) =
        finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)));
    (lo <= hi).then(|| (column.name.clone(), lo, hi))
}

#[derive(Serialize)]
struct TablesJson {
    tables: Vec<Value>,
}

/// List of tables in all its forms.
pub fn list(rows: &[Description]) -> Product {
    let column = |name: &str, get: &dyn Fn(&Description) -> String| {
        Column::text(name, rows.iter().map(get).collect())
    };
    let count = Column {
        name: "rows".into(),
        unit: None,
        description: None,
        values: Values::I64(rows.iter().map(|r| i64::try_from(r.rows).ok()).collect()),
    };
    let table = Table {
        columns: vec![
            column("name", &|r| r.name.to_owned()),
            column("title", &|r| r.title.clone()),
            count,
            column("range", &Description::range_text),
            column("licence", &|r| r.licence.clone()),
            column("source", &|r| r.source.clone()),
            column("sha256", &|r| r.sha256.clone()),
        ],
        ..Table::default()
    };
    let json = json_of(&TablesJson { tables: rows.iter().map(Description::json).collect() });
    Product { name: "tables".into(), table, figure: None, json, ..Product::default() }
}

/// Text of a list of tables.
pub fn list_text(rows: &[Description]) -> String {
    let mut text = String::new();
    for row in rows {
        let _ = writeln!(text, "{:<24}{}", row.name, row.title);
        let _ = writeln!(
            text,
            "{:<24}{} rows, {}; {}; sha256 {}",
            "",
            row.rows,
            row.range_text(),
            row.licence,
            &row.sha256[..16]
        );
    }
    let _ = writeln!(
        text,
        "\n`sunglint tables NAME` shows one with its source; `-o FILE.ecsv` writes it."
    );
    text
}
