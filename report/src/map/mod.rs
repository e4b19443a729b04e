//! What `analyse map` says: text, JSON, FITS, figures, the track.

use super::plane;
use hifitime::Epoch;
use serde_json::{Value, json};
use std::fmt::Write as _;
use sunglint_analysis::map::BodyMap;
use sunglint_formats::fits::{Image, Pixels, Writer};
use sunglint_formats::time::format_utc_shortest;
use sunglint_formats::{Column, Table};
use sunglint_radiometry::light_curve::Samples;
use sunglint_report::plot::{Axis, Figure, Heat, Panel, Series};
use sunglint_report::{Product, rounded};

/// Colours reach so many decades below the largest value.
const DECADES: f64 = 4.0;

/// What the values of a map are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Of {
    /// Reflection factor of a channel, m² sr⁻¹.
    Factor,
    /// Light of a material in truth, m² sr⁻¹ at a reflectance of 1.
    Weight,
    /// Share of a material as unmixing finds it.
    Share,
    /// Metres away from the observer against the body's origin.
    Range,
    /// Hz at the detector.
    Rate,
}

impl Of {
    /// Quantity for people, unit for files, a word for names.
    fn words(self) -> (&'static str, Option<&'static str>, &'static str) {
        match self {
            Self::Factor => ("reflection factor (m² sr⁻¹)", Some("m2 / sr"), "factor"),
            Self::Weight => ("light of the material (m² sr⁻¹)", Some("m2 / sr"), "weight"),
            Self::Share => ("share, unmixed", None, "share"),
            Self::Range => ("range (m)", Some("m"), "range"),
            Self::Rate => ("rate (Hz)", Some("Hz"), "rate"),
        }
    }
}

/// One map.
pub struct Layer {
    pub name: String,
    pub of: Of,
    pub map: BodyMap,
    /// Variance within cells over that of all samples.
    pub agreement: Option<f64>,
}

/// Where samples stand, and what they have.
pub struct Track {
    time: Vec<Epoch>,
    at: Vec<(f64, f64)>,
    pub columns: Vec<(String, Of, Vec<f64>)>,
}

impl Track {
    pub fn new(samples: &Samples, at: &[(f64, f64)]) -> Self {
        Self { time: samples.time.clone(), at: at.to_vec(), columns: Vec::new() }
    }
}

/// A curve from a map against the direct one.
pub struct Shortcut {
    pub channel: String,
    /// Samples that both have.
    pub samples: usize,
    /// Σ|found − direct|/Σ direct.
    pub relative_error: f64,
    /// Median and 95th percentile of |found/direct − 1|.
    pub median: f64,
    pub worst_of_twenty: f64,
}

impl Shortcut {
    pub fn of(channel: &str, direct: &[f64], found: &[f64]) -> Self {
        let pairs = direct.iter().zip(found);
        let pairs: Vec<(f64, f64)> = pairs
            .filter(|(d, f)| d.is_finite() && f.is_finite() && **d > 0.0)
            .map(|(d, f)| (*d, *f))
            .collect();
        let sum: f64 = pairs.iter().map(|(d, _)| d).sum();
        let off: f64 = pairs.iter().map(|(d, f)| (f - d).abs()).sum();
        let mut each: Vec<f64> = pairs.iter().map(|(d, f)| (f / d - 1.0).abs()).collect();
        each.sort_by(f64::total_cmp);
        let at = |part: f64| {
            let last = each.len().saturating_sub(1) as f64;
            each.get((part * last).round() as usize).copied().unwrap_or(f64::NAN)
        };
        Self {
            channel: channel.to_owned(),
            samples: pairs.len(),
            relative_error: off / sum,
            median: at(0.5),
            worst_of_twenty: at(0.95),
        }
    }
}

pub struct Answer {
    pub title: String,
    pub phase_deg: Option<f64>,
    pub layers: Vec<Layer>,
    pub track: Option<Track>,
    pub shortcut: Vec<Shortcut>,
    pub warnings: Vec<String>,
}

impl Answer {
    pub fn product(&self) -> anyhow::Result<Product> {
        let fits = self.fits()?;
        let others = match &self.track {
            None => Vec::new(),
            // In a folder a table and images have a place each.
            Some(_) => vec![Product {
                name: "body_map".into(),
                fits: Some(fits.clone()),
                figure: self.figure(),
                ..Product::default()
            }],
        };
        Ok(Product {
            name: if self.track.is_some() { "track" } else { "body_map" }.into(),
            table: self.table(),
            figure: if self.shortcut.is_empty() { self.figure() } else { self.curves() },
            fits: Some(fits),
            json: self.json(),
            others,
            ..Product::default()
        })
    }

    fn table(&self) -> Table {
        let mut table = Table::default();
        let Some(track) = &self.track else { return table };
        table.meta.insert("title".into(), json!(self.title));
        let times = track.time.iter().map(|t| format_utc_shortest(*t)).collect();
        let deg = Some("deg");
        table.columns = vec![
            Column::text("time_utc", times),
            Column::f64("longitude_deg", deg, track.at.iter().map(|a| a.0).collect())
                .described("of the phase vector, body axes"),
            Column::f64("latitude_deg", deg, track.at.iter().map(|a| a.1).collect()),
        ];
        for (name, of, values) in &track.columns {
            let (_, unit, word) = of.words();
            let name: String =
                name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
            let suffix = if *of == Of::Rate { "rate_hz" } else { word };
            table.columns.push(Column::f64(format!("{name}_{suffix}"), unit, values.clone()));
        }
        table
    }

    fn figure(&self) -> Option<Figure> {
        let panels: Vec<Panel> = self.layers.iter().filter_map(panel).collect();
        let title = match self.phase_deg {
            Some(deg) => format!("{}, phase angle {deg:.1}°", self.title),
            None => self.title.clone(),
        };
        (!panels.is_empty()).then_some(Figure { title, panels })
    }

    /// Rates from the map beside the direct ones.
    fn curves(&self) -> Option<Figure> {
        let track = self.track.as_ref()?;
        let first = track.time.first()?;
        let seconds: Vec<f64> = track.time.iter().map(|t| (*t - *first).to_seconds()).collect();
        let points = |v: &[f64]| seconds.iter().copied().zip(v.iter().copied()).collect();
        let panels = track.columns.chunks_exact(2).map(|pair| {
            let x = Axis::linear(format!("s since {}", format_utc_shortest(*first)));
            let name = pair[0].0.trim_end_matches("_direct");
            let series = vec![
                Series::line("direct", 0, points(&pair[0].2)),
                Series::line("from the map", 1, points(&pair[1].2)),
            ];
            Panel::new(x, Axis::log(format!("{name}: rate (Hz)")), series)
        });
        let panels: Vec<Panel> = panels.collect();
        (!panels.is_empty()).then(|| Figure { title: self.title.clone(), panels })
    }

    fn fits(&self) -> anyhow::Result<Vec<u8>> {
        let mut writer = Writer::new();
        for layer in &self.layers {
            let (_, unit, word) = layer.of.words();
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
                if let Some(deg) = self.phase_deg {
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

    pub fn text(&self) -> String {
        let mut text = format!("{}\n", self.title);
        if let Some(deg) = self.phase_deg {
            let _ = writeln!(
                text,
                "  direct light at a phase angle of {deg:.2}°, above the air; Sun and observer stand in the plane through the phase vector and the body's z axis, the Sun on the side of +z"
            );
        }
        let _ = writeln!(
            text,
            "  map                            of                               largest   at lon, lat (°)   covered   agreement"
        );
        for layer in &self.layers {
            let coverage = layer.map.coverage();
            let (most, at) = largest(&layer.map);
            let at = at.map_or("-".to_owned(), |(l, b)| format!("{l:.1}, {b:.1}"));
            let agreement = layer.agreement.map_or("-".to_owned(), |a| format!("{a:.3}"));
            let _ = writeln!(
                text,
                "  {:<30} {:<28} {most:>11.4e} {at:>17} {:>8.1}% {agreement:>11}",
                layer.name,
                layer.of.words().0,
                100.0 * coverage.share
            );
        }
        if self.layers.iter().any(|l| l.agreement.is_some()) {
            text.push_str("  agreement: variance within cells over that of all samples; near 0 where place alone decides, near 1 where it decides nothing\n");
        }
        if !self.shortcut.is_empty() {
            text.push_str("  rates from the map against the direct ones along the pass: relative error of the sum, median and 95th percentile of each sample's\n");
        }
        for s in &self.shortcut {
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

    fn json(&self) -> Value {
        let number = |v: f64| if v.is_finite() { json!(rounded(v)) } else { Value::Null };
        let layer = |layer: &Layer| {
            let coverage = layer.map.coverage();
            let (most, at) = largest(&layer.map);
            json!({
                "name": layer.name,
                "quantity": layer.of.words().2,
                "unit": layer.of.words().1,
                "largest": number(most),
                "longitude_deg": at.map(|a| rounded(a.0)),
                "latitude_deg": at.map(|a| rounded(a.1)),
                "filled_cells": coverage.filled,
                "empty_cells": coverage.empty,
                "coverage": rounded(coverage.share),
                "left_out_samples": coverage.left_out,
                "agreement": layer.agreement.map(rounded),
            })
        };
        let shortcut = |s: &Shortcut| {
            json!({
                "channel": s.channel,
                "samples": s.samples,
                "relative_error": number(s.relative_error),
                "median_error": number(s.median),
                "percentile_95_error": number(s.worst_of_twenty),
            })
        };
        json!({
            "title": self.title,
            "phase_deg": self.phase_deg.map(rounded),
            "step_deg": self.layers.first().map(|l| rounded(l.map.grid.step_deg())),
            "maps": self.layers.iter().map(layer).collect::<Vec<_>>(),
            "shortcut": self.shortcut.iter().map(shortcut).collect::<Vec<_>>(),
            "warnings": self.warnings,
        })
    }
}

fn largest(map: &BodyMap) -> (f64, Option<(f64, f64)>) {
    let good = map.mean.indexed_iter().filter(|(_, v)| v.is_finite());
    match good.max_by(|a, b| a.1.total_cmp(b.1)) {
        Some((cell, most)) => (*most, Some(map.grid.middle(cell))),
        None => (f64::NAN, None),
    }
}

fn panel(layer: &Layer) -> Option<Panel> {
    let grid = layer.map.grid;
    let (rows, columns) = grid.dim();
    let edges = |n: usize, from: f64, to: f64| -> Vec<f64> {
        (0..=n).map(|i| from + (to - from) * i as f64 / n as f64).collect()
    };
    let log = matches!(layer.of, Of::Factor | Of::Weight);
    // Ranges are negative in front of the origin; colours begin at 0: shown is what stands nearer than the farthest.
    let shift = match layer.of {
        Of::Range => {
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
    let (words, ..) = layer.of.words();
    let label = match layer.of {
        Of::Range => vec![layer.name.clone(), "range (m) from".into(), format!("{:.2} m", -shift)],
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
