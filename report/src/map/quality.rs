//! How well samples agree on the frame of a spin, over the sky.

use super::plane;
use crate::plot::{Axis, Figure, Heat, Panel};
use crate::{Product, json_of, rounded};
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_formats::EncodeError;
use sunglint_formats::fits::{Image, Pixels, Writer};
use sunglint_inference::map::{ALIKE, SpinQuality};

fn title(found: &SpinQuality) -> String {
    format!("How well samples of {} agree on a spin's frame", found.target)
}

/// All forms of the result.
///
/// # Errors
/// A map that cannot be written as FITS.
pub fn product(found: &SpinQuality) -> Result<Product, EncodeError> {
    Ok(Product {
        name: "spin_quality".into(),
        figure: figure(found),
        fits: Some(fits(found)?),
        json: json(found),
        ..Product::default()
    })
}

/// Text of the best axis and those alike.
pub fn text(found: &SpinQuality) -> String {
    let (spin, quality) = found.best;
    let (ra, dec) = found.axis_deg();
    let mut text = format!("{}\n", title(found));
    let _ = writeln!(
        text,
        "  {} samples in cells of {}°; {} axes {}° apart, {} periods each",
        found.samples,
        rounded(found.step_deg),
        found.theta.mean.len(),
        rounded(found.theta.grid.step_deg()),
        found.periods
    );
    let _ = writeln!(
        text,
        "  best      theta {:.4}: axis at RA {ra:.1}°, Dec {dec:+.1}°, {:.5} s; {} cells are visited in two turns or more, {} visits",
        quality.theta, spin.period_s, quality.cells, quality.visits
    );
    let _ = writeln!(
        text,
        "  alike     axes with a theta of at most {ALIKE} times that: {:.1} % of the sky, periods from {:.5} s to {:.5} s",
        100.0 * found.alike,
        found.alike_s.0,
        found.alike_s.1
    );
    text.push_str("  theta: how visits of a cell differ from turn to turn, over how all visits differ; near 0 where a place always looks the same, near 1 where place says nothing. Under the Sun light is not made by place alone: the true axis need not be the best\n");
    text
}

#[derive(Serialize)]
struct QualityJson<'a> {
    title: String,
    samples: usize,
    step_deg: f64,
    axes: usize,
    periods: usize,
    best: BestJson,
    alike: AlikeJson,
    warnings: &'a [String],
}

#[derive(Serialize)]
struct BestJson {
    ra_deg: f64,
    dec_deg: f64,
    period_s: f64,
    theta: f64,
    cells: usize,
    visits: usize,
}

#[derive(Serialize)]
struct AlikeJson {
    sky_share: f64,
    period_s: [f64; 2],
}

/// Summary with its documented keys.
pub fn json(found: &SpinQuality) -> Value {
    let (spin, quality) = found.best;
    let (ra, dec) = found.axis_deg();
    json_of(&QualityJson {
        title: title(found),
        samples: found.samples,
        step_deg: rounded(found.step_deg),
        axes: found.theta.mean.len(),
        periods: found.periods,
        best: BestJson {
            ra_deg: rounded(ra),
            dec_deg: rounded(dec),
            period_s: rounded(spin.period_s),
            theta: rounded(quality.theta),
            cells: quality.cells,
            visits: quality.visits,
        },
        alike: AlikeJson {
            sky_share: rounded(found.alike),
            period_s: [rounded(found.alike_s.0), rounded(found.alike_s.1)],
        },
        warnings: &found.warnings,
    })
}

/// The measure and its period as FITS images.
///
/// # Errors
/// A map that cannot be written.
pub fn fits(found: &SpinQuality) -> Result<Vec<u8>, EncodeError> {
    let mut writer = Writer::new();
    let planes = [("THETA", &found.theta.mean, None), ("PERIOD", &found.period_s, Some("s"))];
    for (name, values, unit) in planes {
        let of = "of the spin axis, GCRS";
        let header = plane::header(name, unit, found.theta.grid, ["RA", "DEC"], of);
        writer.image(&Image { header, pixels: Pixels::F64(values.clone().into_dyn()) })?;
    }
    Ok(writer.into_bytes())
}

/// Figure of the measure over the sky; `None` where it has no value.
pub fn figure(found: &SpinQuality) -> Option<Figure> {
    let (rows, columns) = found.theta.grid.dim();
    let edges = |n: usize, half: f64| -> Vec<f64> {
        (0..=n).map(|i| half * (2.0 * i as f64 / n as f64 - 1.0)).collect()
    };
    let values = (0..columns).flat_map(|c| (0..rows).map(move |r| (r, c)));
    let heat = Heat {
        x_edges: edges(columns, 180.0),
        y_edges: edges(rows, 90.0),
        values: values.map(|cell| found.theta.mean[cell]).collect(),
        label: vec!["theta".into(), "0: a place".into(), "looks alike".into()],
        decades: None,
    };
    let x = Axis::linear("right ascension of the axis (°)");
    let y = Axis::linear("declination (°)");
    heat.has_light().then(|| Figure {
        title: title(found),
        panels: vec![Panel { heat: Some(heat), ..Panel::new(x, y, vec![]) }],
    })
}
