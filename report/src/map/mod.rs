//! Maps on the frame of a body: text, JSON, FITS, figures, the track.

mod plane;
pub mod quality;

use crate::plot::{Axis, Figure, Heat, Panel, Series};
use crate::{Product, json_of, rounded};
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_analysis::map::BodyMap;
use sunglint_analysis::unmix::column_name;
use sunglint_formats::fits::{Image, Pixels, Writer};
use sunglint_formats::time::format_utc_shortest;
use sunglint_formats::{Column, EncodeError, Table};
use sunglint_inference::map::{BodyMaps, MapLayer, MapQuantity};

/// Colours reach so many decades below the largest value.
const DECADES: f64 = 4.0;

/// Quantity for people, unit for files, a word for names.
fn words(quantity: MapQuantity) -> (&'static str, Option<&'static str>, &'static str) {
    match quantity {
        MapQuantity::Factor => ("reflection factor (m² sr⁻¹)", Some("m2 / sr"), "factor"),
        MapQuantity::Weight => ("light of the material (m² sr⁻¹)", Some("m2 / sr"), "weight"),
        MapQuantity::Share => ("share, unmixed", None, "share"),
        MapQuantity::Range => ("range (m)", Some("m"), "range"),
        MapQuantity::Rate => ("rate (Hz)", Some("Hz"), "rate"),
    }
}

/// All forms of the result.
///
/// # Errors
/// A map that cannot be written as FITS.
pub fn product(maps: &BodyMaps) -> Result<Product, EncodeError> {
    let fits = fits(maps)?;
    let others = match &maps.track {
        None => Vec::new(),
        // In a folder a table and images have a place each.
        Some(_) => vec![Product {
            name: "body_map".into(),
            fits: Some(fits.clone()),
            figure: figure(maps),
            ..Product::default()
        }],
    };
    Ok(Product {
        name: if maps.track.is_some() { "track" } else { "body_map" }.into(),
        table: table(maps),
        figure: if maps.shortcut.is_empty() { figure(maps) } else { curves(maps) },
        fits: Some(fits),
        json: json(maps),
        others,
        ..Product::default()
    })
}

/// Table of the track: a row for each sample; without columns where there is no track.
pub fn table(maps: &BodyMaps) -> Table {
    let mut table = Table::default();
    let Some(track) = &maps.track else { return table };
    table.meta.insert("title".into(), json_of(&maps.title));
    let times = track.time.iter().map(|t| format_utc_shortest(*t)).collect();
    let deg = Some("deg");
    table.columns = vec![
        Column::text("time_utc", times),
        Column::f64("longitude_deg", deg, track.at.iter().map(|a| a.0).collect())
            .described("of the phase vector, body axes"),
        Column::f64("latitude_deg", deg, track.at.iter().map(|a| a.1).collect()),
    ];
    for column in &track.columns {
        let (_, unit, word) = words(column.quantity);
        let name = column_name(&column.name);
        let suffix = if column.quantity == MapQuantity::Rate { "rate_hz" } else { word };
        table.columns.push(Column::f64(format!("{name}_{suffix}"), unit, column.values.clone()));
    }
    table
}

/// Figure of the maps; `None` where none of them has light.
pub fn figure(maps: &BodyMaps) -> Option<Figure> {
    let panels: Vec<Panel> = maps.layers.iter().filter_map(panel).collect();
    let title = match maps.phase_deg {
        Some(deg) => format!("{}, phase angle {deg:.1}°", maps.title),
        None => maps.title.clone(),
    };
    (!panels.is_empty()).then_some(Figure { title, panels })
}

/// Figure of the rates from the map beside the direct ones.
pub fn curves(maps: &BodyMaps) -> Option<Figure> {
    let track = maps.track.as_ref()?;
    let first = track.time.first()?;
    let seconds: Vec<f64> = track.time.iter().map(|t| (*t - *first).to_seconds()).collect();
    let points = |v: &[f64]| seconds.iter().copied().zip(v.iter().copied()).collect();
    let panels = track.columns.chunks_exact(2).map(|pair| {
        let x = Axis::linear(format!("s since {}", format_utc_shortest(*first)));
        let name = pair[0].name.trim_end_matches("_direct");
        let series = vec![
            Series::line("direct", 0, points(&pair[0].values)),
            Series::line("from the map", 1, points(&pair[1].values)),
        ];
        Panel::new(x, Axis::log(format!("{name}: rate (Hz)")), series)
    });
    let panels: Vec<Panel> = panels.collect();
    (!panels.is_empty()).then(|| Figure { title: maps.title.clone(), panels })
}

/// The maps as FITS images.
///
/// # Errors
/// A map that cannot be written.
pub fn fits(maps: &BodyMaps) -> Result<Vec<u8>, EncodeError> {
    let mut writer = Writer::new();
    for layer in &maps.layers {
        let (_, unit, word) = words(layer.quantity);
        let mut planes = vec![(word.to_uppercase(), layer.map.mean.clone(), unit)];
        if layer.map.left_out > 0 || layer.map.count.iter().any(|c| *c > 1) {
            planes.push((
                format!("{}_SCATTER", word.to_uppercase()),
                layer.map.scatter.clone(),
                unit,
            ));
            planes.push((
                format!("{}_COUNT", word.to_uppercase()),
                layer.map.count.mapv(f64::from),
                None,
            ));
        }
        for (name, values, unit) in planes {
            let layer_name: String = layer
                .name
                .chars()
                .map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_uppercase() } else { '_' })
                .collect();
            let mut header = plane::header(
                &format!("{layer_name}_{name}"),
                unit,
                layer.map.grid,
                ["LON", "LAT"],
                "of the phase vector, body axes",
            );
            header.set("OBJECT", layer.name.as_str(), "");
            if let Some(deg) = maps.phase_deg {
                header.set("PHASE", deg, "deg, Sun-target-observer");
            }
            let coverage = layer.map.coverage();
            header.set("FILLED", coverage.filled as i64, "cells with a value");
            header.set("EMPTY", coverage.empty as i64, "cells without one: NaN");
            header.set("COVERAGE", coverage.share, "of the sphere");
            writer.image(&Image { header, pixels: Pixels::F64(values.into_dyn()) })?;
        }
    }
    Ok(writer.into_bytes())
}

/// Text with a line for each map.
pub fn text(maps: &BodyMaps) -> String {
    let mut text = format!("{}\n", maps.title);
    if let Some(deg) = maps.phase_deg {
        let _ = writeln!(
            text,
            "  direct light at a phase angle of {deg:.2}°, above the air; Sun and observer stand in the plane through the phase vector and the body's z axis, the Sun on the side of +z"
        );
    }
    let _ = writeln!(
        text,
        "  map                            of                               largest   at lon, lat (°)   covered   agreement"
    );
    for layer in &maps.layers {
        let coverage = layer.map.coverage();
        let (most, at) = largest(&layer.map);
        let at = at.map_or("-".to_owned(), |(l, b)| format!("{l:.1}, {b:.1}"));
        let agreement = layer.agreement.map_or("-".to_owned(), |a| format!("{a:.3}"));
        let _ = writeln!(
            text,
            "  {:<30} {:<28} {most:>11.4e} {at:>17} {:>8.1}% {agreement:>11}",
            layer.name,
            words(layer.quantity).0,
            100.0 * coverage.share
        );
    }
    if maps.layers.iter().any(|l| l.agreement.is_some()) {
        text.push_str("  agreement: variance within cells over that of all samples; near 0 where place alone decides, near 1 where it decides nothing\n");
    }
    if !maps.shortcut.is_empty() {
        text.push_str("  rates from the map against the direct ones along the pass: relative error of the sum, median and 95th percentile of each sample's\n");
    }
    for s in &maps.shortcut {
        let _ = writeln!(
            text,
            "  {:<10} {:>7.1} % {:>7.1} % {:>7.1} %   ({} samples)",
            s.channel,
            100.0 * s.relative_error,
            100.0 * s.median,
            100.0 * s.worst_of_twenty,
            s.samples
        );
    }
    text
}

#[derive(Serialize)]
struct MapJson<'a> {
    name: &'a str,
    quantity: &'a str,
    unit: Option<&'a str>,
    largest: f64,
    longitude_deg: Option<f64>,
    latitude_deg: Option<f64>,
    filled_cells: usize,
    empty_cells: usize,
    coverage: f64,
    left_out_samples: usize,
    agreement: Option<f64>,
}

#[derive(Serialize)]
struct ShortcutJson<'a> {
    channel: &'a str,
    samples: usize,
    relative_error: f64,
    median_error: f64,
    percentile_95_error: f64,
}

#[derive(Serialize)]
struct MapsJson<'a> {
    title: &'a str,
    phase_deg: Option<f64>,
    step_deg: Option<f64>,
    maps: Vec<MapJson<'a>>,
    shortcut: Vec<ShortcutJson<'a>>,
    warnings: &'a [String],
}

/// Summary with its documented keys.
pub fn json(maps: &BodyMaps) -> Value {
    let layers = maps.layers.iter().map(|layer| {
        let coverage = layer.map.coverage();
        let (most, at) = largest(&layer.map);
        MapJson {
            name: &layer.name,
            quantity: words(layer.quantity).2,
            unit: words(layer.quantity).1,
            largest: rounded(most),
            longitude_deg: at.map(|a| rounded(a.0)),
            latitude_deg: at.map(|a| rounded(a.1)),
            filled_cells: coverage.filled,
            empty_cells: coverage.empty,
            coverage: rounded(coverage.share),
            left_out_samples: coverage.left_out,
            agreement: layer.agreement.map(rounded),
        }
    });
    let shortcut = maps.shortcut.iter().map(|s| ShortcutJson {
        channel: &s.channel,
        samples: s.samples,
        relative_error: rounded(s.relative_error),
        median_error: rounded(s.median),
        percentile_95_error: rounded(s.worst_of_twenty),
    });
    json_of(&MapsJson {
        title: &maps.title,
        phase_deg: maps.phase_deg.map(rounded),
        step_deg: maps.layers.first().map(|l| rounded(l.map.grid.step_deg())),
        maps: layers.collect(),
        shortcut: shortcut.collect(),
        warnings: &maps.warnings,
    })
}

fn largest(map: &BodyMap) -> (f64, Option<(f64, f64)>) {
    let good = map.mean.indexed_iter().filter(|(_, v)| v.is_finite());
    match good.max_by(|a, b| a.1.total_cmp(b.1)) {
        Some((cell, most)) => (*most, Some(map.grid.middle(cell))),
        None => (f64::NAN, None),
    }
}

fn panel(layer: &MapLayer) -> Option<Panel> {
    let grid = layer.map.grid;
    let (rows, columns) = grid.dim();
    let edges = |n: usize, from: f64, to: f64| -> Vec<f64> {
        (0..=n).map(|i| from + (to - from) * i as f64 / n as f64).collect()
    };
    let log = matches!(layer.quantity, MapQuantity::Factor | MapQuantity::Weight);
    // Ranges are negative in front of the origin; colours begin at 0: shown is what stands nearer than the farthest.
    let shift = match layer.quantity {
        MapQuantity::Range => {
            let good = layer.map.mean.iter().copied().filter(|v| v.is_finite());
            -good.fold(f64::INFINITY, f64::min)
        }
        _ => 0.0,
    };
    let mut values = Vec::with_capacity(rows * columns);
    for column in 0..columns {
        for row in 0..rows {
            let value = layer.map.mean[(row, column)];
            values.push(if log && value <= 0.0 { f64::NAN } else { value + shift });
        }
    }
    let (words, ..) = words(layer.quantity);
    let label = match layer.quantity {
        MapQuantity::Range => {
            vec![layer.name.clone(), "range (m) from".into(), format!("{:.2} m", -shift)]
        }
        _ => match words.split_once(" (") {
            Some((quantity, unit)) => {
                vec![layer.name.clone(), quantity.into(), unit.trim_end_matches(')').into()]
            }
            None => vec![layer.name.clone(), words.to_owned()],
        },
    };
    let heat = Heat {
        x_edges: edges(columns, -180.0, 180.0),
        y_edges: edges(rows, -90.0, 90.0),
        values,
        label,
        decades: log.then_some(DECADES),
    };
    let x = Axis::linear("longitude of the phase vector from the body's x axis (°)");
    let y = Axis::linear("latitude above its xy-plane (°)");
    heat.has_light().then(|| Panel { heat: Some(heat), ..Panel::new(x, y, vec![]) })
}
