//! `sunglint tables`: what the program carries with it, and where it is from.

use crate::output::{Console, OutputArgs, Product};
use anyhow::bail;
use clap::Args;
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};
use std::fmt::Write as _;
use sunglint_formats::{Column, Table, Values, nearest_names};
use sunglint_radiometry::tables::{self, Embedded};

/// Arguments of `sunglint tables`.
#[derive(Debug, Args)]
pub struct TablesArgs {
    /// The table to show or write; all are listed without it
    pub name: Option<String>,
    /// Where the table goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Lists the tables, or shows or writes one.
pub fn run(args: &TablesArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    match &args.name {
        None => {
            let rows: Vec<Description> = tables::all().iter().map(|t| Description::of(t)).collect();
            let product = list(&rows);
            args.out.deliver(&product, console)?;
            if args.out.output.is_empty() {
                console.result(&list_text(&rows), &product.json)?;
            }
        }
        Some(name) => {
            let Some(embedded) = tables::get(name) else {
                let names = tables::all().iter().map(|t| t.name);
                let near = nearest_names(name, names.clone(), 3);
                let names: Vec<&str> = names.collect();
                bail!(
                    "there is no table `{name}`; {}",
                    if near.is_empty() {
                        format!("the tables are {}", names.join(", "))
                    } else {
                        format!("did you mean {}? (`sunglint tables` lists all)", near.join(", "))
                    }
                );
            };
            let description = Description::of(embedded);
            let json = description.json();
            let product = Product {
                name: embedded.name.to_owned(),
                table: embedded.table().clone(),
                figure: None,
                json,
            };
            args.out.deliver(&product, console)?;
            if args.out.output.is_empty() {
                console.result(&description.text(embedded.table()), &product.json)?;
            }
        }
    }
    Ok(())
}

/// What there is to say of a table.
struct Description {
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

impl Description {
    fn of(embedded: &Embedded) -> Self {
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
            sha256: hex(&Sha256::digest(embedded.text)),
        }
    }

    fn json(&self) -> Value {
        json!({
            "name": self.name, "title": self.title, "rows": self.rows,
            "range": self.range.as_ref().map(|(column, from, to)| json!({"column": column, "from": from, "to": to})),
            "source": self.source, "licence": self.licence, "note": self.note, "sha256": self.sha256,
        })
    }

    fn range_text(&self) -> String {
        self.range
            .as_ref()
            .map_or(String::new(), |(column, from, to)| format!("{column} {from} to {to}"))
    }

    fn text(&self, table: &Table) -> String {
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
        let _ = writeln!(text, "write it with: sunglint tables {0} -o {0}.ecsv", self.name);
        text
    }
}

fn range(column: &Column) -> Option<(String, f64, f64)> {
    let Values::F64(values) = &column.values else { return None };
    let finite = values.iter().copied().filter(|v| v.is_finite());
    let (lo, hi) =
        finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)));
    (lo <= hi).then(|| (column.name.clone(), lo, hi))
}

fn list(rows: &[Description]) -> Product {
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
    let json = json!({ "tables": rows.iter().map(Description::json).collect::<Vec<_>>() });
    Product { name: "tables".into(), table, figure: None, json }
}

fn list_text(rows: &[Description]) -> String {
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

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}
