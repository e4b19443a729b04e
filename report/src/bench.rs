//! Error against time of the light engines: rows as text, table, figure and JSON.

use crate::plot::{Axis, Figure, Panel, Series};
use crate::{Product, json_of, rounded};
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_formats::{Column, Table};
use sunglint_simulator::bench::{BenchRow, Benchmark};

/// Value at which an error of exactly 0 is drawn.
const NO_ERROR: f64 = 1e-17;

#[derive(Serialize)]
struct RowJson<'a> {
    scene: &'a str,
    engine: &'a str,
    bins: usize,
    facets: usize,
    seconds_per_epoch: f64,
    seconds_fastest: f64,
    repeats: usize,
    epochs_per_repeat: usize,
    seconds_prepare: Option<f64>,
    relative_error: Option<f64>,
    error_source: &'a str,
    error_estimate: Option<f64>,
}

/// A row with its documented keys.
pub fn row_json(row: &BenchRow) -> Value {
    json_of(&RowJson {
        scene: &row.scene,
        engine: row.engine,
        bins: row.bins,
        facets: row.facets,
        seconds_per_epoch: rounded(row.timing.median_s),
        seconds_fastest: rounded(row.timing.fastest_s),
        repeats: row.timing.repeats,
        epochs_per_repeat: row.timing.epochs,
        seconds_prepare: row.prepare_s.map(rounded),
        relative_error: row.error.map(rounded),
        error_source: row.error_source,
        error_estimate: row.estimate.map(rounded),
    })
}

#[derive(Serialize)]
struct BenchJson<'a> {
    program: String,
    processor: &'a str,
    threads: u8,
    rows: Vec<Value>,
}

/// All forms of the result.
pub fn product(found: &Benchmark) -> Product {
    Product {
        name: "bench".into(),
        table: table(found),
        figure: figure(found),
        json: json_of(&BenchJson {
            program: format!("sunglint {}", env!("CARGO_PKG_VERSION")),
            processor: &found.processor,
            threads: 1,
            rows: found.rows.iter().map(row_json).collect(),
        }),
        ..Product::default()
    }
}

/// Table with a row for each engine, scene and grid.
pub fn table(found: &Benchmark) -> Table {
    let text = |name: &str, get: &dyn Fn(&BenchRow) -> &str| {
        Column::text(name, found.rows.iter().map(|r| get(r).to_owned()).collect())
    };
    let count = |name: &str, get: &dyn Fn(&BenchRow) -> usize| {
        // No count of facets or stretches reaches 2⁶³.
        let values = found.rows.iter().map(|r| get(r) as i64).collect();
        Column::i64(name, None, values)
    };
    let number = |name: &str, unit: Option<&str>, get: &dyn Fn(&BenchRow) -> Option<f64>| {
        let value = |r| get(r).map_or(f64::NAN, rounded);
        Column::f64(name, unit, found.rows.iter().map(value).collect())
    };
    let columns = vec![
        text("scene", &|r| &r.scene),
        text("engine", &|r| r.engine),
        count("bins", &|r| r.bins),
        count("facets", &|r| r.facets),
        number("seconds_per_epoch", Some("s"), &|r| Some(r.timing.median_s))
            .described("median of the repeats, warm-up not counted"),
        number("seconds_fastest", Some("s"), &|r| Some(r.timing.fastest_s))
            .described("the fastest repeat"),
        count("repeats", &|r| r.timing.repeats),
        count("epochs_per_repeat", &|r| r.timing.epochs),
        number("seconds_prepare", Some("s"), &|r| r.prepare_s)
            .described("once for a scene; nan where it is in the time of the epochs"),
        number("relative_error", None, &|r| r.error)
            .described("sum |E - truth| / sum truth over the bins; nan without a truth"),
        text("error_source", &|r| r.error_source),
        number("error_estimate", None, &|r| r.estimate)
            .described("what the engine thinks of its own error"),
    ];
    let mut table = Table { columns, ..Table::default() };
    for (key, value) in [
        ("title", "Error against time of the light engines, one thread".into()),
        ("program", format!("sunglint {}", env!("CARGO_PKG_VERSION")).into()),
        ("processor", json_of(&found.processor)),
    ] {
        table.meta.insert(key.into(), value);
    }
    table
}

/// Figure with one panel for grey light, one for spectra; none where nothing has an error.
pub fn figure(found: &Benchmark) -> Option<Figure> {
    let panel = |title: &str, wanted: &dyn Fn(usize) -> bool| {
        let mut series: Vec<Series> = Vec::new();
        for row in found.rows.iter().filter(|r| wanted(r.bins)) {
            let Some(error) = row.error else { continue };
            let label = format!("{}, {}", row.scene, row.engine);
            let point = (row.timing.median_s, error.max(NO_ERROR));
            match series.iter_mut().find(|s| s.label == label) {
                Some(series) => series.points.push(point),
                None => series.push(Series::dots(label, series.len(), vec![point])),
            }
        }
        // A ladder's steps belong together.
        let lines: Vec<Series> = series
            .iter()
            .filter(|s| s.points.len() > 1)
            .map(|s| Series::line("", 0, s.points.clone()).with_colour(s.colour))
            .collect();
        series.extend(lines);
        let x = Axis::log(format!("time per epoch on one thread (s), {title}"));
        Panel::new(x, Axis::log("relative error (0 at 1e-17)").from_to(0.1 * NO_ERROR, 1.0), series)
    };
    let panels = [panel("1 bin", &|bins| bins == 1), panel("a spectrum", &|bins| bins > 1)];
    let panels: Vec<Panel> = panels.into_iter().filter(|p| !p.series.is_empty()).collect();
    let title = format!("Light engines: error against time ({})", found.processor);
    (!panels.is_empty()).then_some(Figure { title, panels })
}

/// Text of the rows, 110 columns wide at most.
pub fn text(found: &Benchmark) -> String {
    let mut text = format!(
        "Singly scattered sunlight, one thread. sunglint {}, {}\n\n",
        env!("CARGO_PKG_VERSION"),
        found.processor
    );
    let cells = |r: &BenchRow| {
        [
            shortened(&r.scene, 16),
            r.engine.to_owned(),
            r.bins.to_string(),
            r.facets.to_string(),
            duration(r.timing.median_s),
            duration(r.timing.fastest_s),
            r.prepare_s.map_or("-".into(), duration),
            r.error.map_or("-".into(), |e| if e == 0.0 { "0".into() } else { format!("{e:.1e}") }),
            r.error_source.to_owned(),
        ]
    };
    let head =
        ["scene", "engine", "bins", "facets", "per epoch", "fastest", "prepare", "error", "truth"];
    let _ = writeln!(text, "{}", line(&head.map(str::to_owned)));
    for row in &found.rows {
        let _ = writeln!(text, "{}", line(&cells(row)));
    }
    text.push_str("\nper epoch: median of the repeats. error: sum |E - truth| / sum truth over the bins, at the scene's\n");
    text.push_str(
        "own directions; the time is that of directions turned a little from epoch to epoch.\n",
    );
    for (source, meaning) in [
        ("closed form", "a formula"),
        ("stored", "exact sums of an independent program, stored with how they were made"),
        ("none", "no independent truth is known, so no error is given"),
    ] {
        if found.rows.iter().any(|r| r.error_source == source) {
            let _ = writeln!(text, "truth `{source}`: {meaning}.");
        }
    }
    text
}

fn line(cells: &[String; 9]) -> String {
    const WIDTHS: [usize; 9] = [16, 14, 5, 7, 9, 9, 9, 8, 11];
    let mut line = String::new();
    for (k, (cell, width)) in cells.iter().zip(WIDTHS).enumerate() {
        // Words to the left, numbers to the right.
        let _ = match k {
            0 | 1 => write!(line, "{cell:<width$}  "),
            8 => write!(line, "{cell}"),
            _ => write!(line, "{cell:>width$}  "),
        };
    }
    line
}

fn shortened(text: &str, most: usize) -> String {
    if text.chars().count() <= most {
        return text.to_owned();
    }
    text.chars().take(most - 1).chain(['…']).collect()
}

/// A time in the unit that suits it, three digits.
fn duration(seconds: f64) -> String {
    let (value, unit) = match seconds {
        s if s < 1e-6 => (s * 1e9, "ns"),
        s if s < 1e-3 => (s * 1e6, "µs"),
        s if s < 1.0 => (s * 1e3, "ms"),
        s => (s, "s"),
    };
    let places = if value < 10.0 { 2 } else { usize::from(value < 100.0) };
    format!("{value:.places$} {unit}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_three_digits() {
        let times = [2.44e-7, 2.8e-6, 1.234_5e-5, 0.000_45, 0.185, 12.0, 123.4];
        let texts = times.map(duration);
        assert_eq!(texts, ["244 ns", "2.80 µs", "12.3 µs", "450 µs", "185 ms", "12.0 s", "123 s"]);
    }
}
