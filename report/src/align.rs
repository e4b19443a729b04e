//! Fields of the fibres on the camera image: text, JSON, table, maps.

use crate::plot::gallery::{Gallery, Key, Tile};
use crate::plot::{RGBColor, viridis};
use crate::{Product, json_of, rounded};
use image::{Rgba, RgbaImage};
use serde::Serialize;
use std::fmt::Write as _;
use sunglint_calibration::alignment::{Alignment, Cell, Field, Interval};
use sunglint_formats::{Column, Table};
use sunglint_radiometry::station::{Detector, Station};

/// The fields as text.
pub fn text(found: &Alignment, station: &Station) -> String {
    let fields = &found.fields;
    let mut text = format!(
        "fields of the fibres of {} on the camera image, px from the sensor's middle\n\n",
        station.name
    );
    let _ = writeln!(
        text,
        "  channel     stars   points        column           row       sigma column      sigma row    scatter  station has"
    );
    for field in fields {
        let fit = &field.fit;
        let fibre = fit.fibre();
        let [x, y, u, v, _] = fit.uncertainties();
        let with = |value: f64, sigma: f64| format!("{value:.2} ± {sigma:.2}");
        let known = match station.channel(&field.channel).map(|c| &c.detector) {
            Some(Detector::Counter(counter)) => counter.fibre,
            _ => None,
        };
        let known = known.map_or_else(
            || "-".to_owned(),
            |f| {
                format!(
                    "{:.2}, {:.2}; {:.2}, {:.2}",
                    f.offset_px[0], f.offset_px[1], f.sigma_px[0], f.sigma_px[1]
                )
            },
        );
        let _ = writeln!(
            text,
            "  {:<10} {:>6} {:>8} {:>15} {:>15} {:>16} {:>15} {:>9.2}  {known}",
            field.channel,
            field.stars,
            field.points,
            with(fibre.offset_px[0], x),
            with(fibre.offset_px[1], y),
            with(fibre.sigma_px[0], u),
            with(fibre.sigma_px[1], v),
            fit.scatter
        );
    }
    text.push_str("\nscatter: of the rates about the fit over their stated uncertainty; scintillation and what is no normal distribution make it more than 1\n");
    text.push_str("\n95 % intervals, without an end where the stars set none\n");
    for field in fields {
        let of = field.fit.intervals_px.map(|Interval { low_px, high_px }| {
            let end = |end: Option<f64>| end.map_or_else(|| "-".to_owned(), |v| format!("{v:.2}"));
            format!("{} to {}", end(low_px), end(high_px))
        });
        let [x, y, u, v] = of;
        let _ = writeln!(
            text,
            "  {:<10} column {x}, row {y}, sigma column {u}, sigma row {v}",
            field.channel
        );
    }
    text.push('\n');
    for field in fields.iter().filter(|field| field.fit.correlated_points > 0) {
        let _ = writeln!(
            text,
            "{}: {} rates in a row err together beyond what places between frames explain (slow twinkling, clouds); the uncertainties allow for it",
            field.channel, field.fit.correlated_points
        );
    }
    for field in fields {
        if let Some(cell) = field.map.strongest_residual() {
            let _ = writeln!(
                text,
                "{}: the field is furthest above the fit at ({:.1}, {:.1}) px: by {:+.3} ± {:.3} of its middle",
                field.channel, cell.offset_px[0], cell.offset_px[1], cell.residual, cell.sigma
            );
        }
    }
    text
}

#[derive(Serialize)]
struct FibreJson<'a> {
    name: &'a str,
    stars: usize,
    points: usize,
    offset_px: [f64; 2],
    offset_uncertainty_px: [f64; 2],
    sigma_px: [f64; 2],
    sigma_uncertainty_px: [f64; 2],
    offset_interval_px: [[Option<f64>; 2]; 2],
    sigma_interval_px: [[Option<f64>; 2]; 2],
    angle_deg: f64,
    angle_uncertainty_deg: f64,
    scatter: f64,
    correlated_points: usize,
}

#[derive(Serialize)]
struct AlignedJson<'a> {
    station: &'a str,
    channels: Vec<FibreJson<'a>>,
    warnings: &'a [String],
}

/// The measured maps as a table, a picture of them, and the fits as JSON.
pub fn product(found: &Alignment, station: &Station) -> Product {
    let Alignment { fields, warnings } = found;
    let cells: Vec<_> = fields
        .iter()
        .flat_map(|f| f.map.cells.iter().map(move |cell| (&f.channel, cell)))
        .collect();
    let number = |value: &dyn Fn(&Cell) -> f64| cells.iter().map(|(_, cell)| value(cell)).collect();
    let columns = vec![
        Column::text("channel", cells.iter().map(|(name, _)| (*name).clone()).collect()),
        Column::f64("column_px", Some("pix"), number(&|c| c.offset_px[0])),
        Column::f64("row_px", Some("pix"), number(&|c| c.offset_px[1])),
        Column::f64("value", None, number(&|c| c.value)),
        Column::f64("sigma", None, number(&|c| c.sigma)),
        Column::f64("residual", None, number(&|c| c.residual)),
        Column::i64("points", None, cells.iter().map(|(_, c)| c.points as i64).collect()),
    ];
    let pair = |values: [f64; 2]| values.map(rounded);
    let ends = |Interval { low_px, high_px }: Interval| [low_px, high_px].map(|e| e.map(rounded));
    let fits = fields.iter().map(|field| {
        let fibre = field.fit.fibre();
        let [x, y, u, v, angle] = field.fit.uncertainties();
        FibreJson {
            name: &field.channel,
            stars: field.stars,
            points: field.points,
            offset_px: pair(fibre.offset_px.to_array()),
            offset_uncertainty_px: pair([x, y]),
            sigma_px: pair(fibre.sigma_px.to_array()),
            sigma_uncertainty_px: pair([u, v]),
            offset_interval_px: [0, 1].map(|k| ends(field.fit.intervals_px[k])),
            sigma_interval_px: [2, 3].map(|k| ends(field.fit.intervals_px[k])),
            angle_deg: rounded(field.fit.angle_deg),
            angle_uncertainty_deg: rounded(angle),
            scatter: rounded(field.fit.scatter),
            correlated_points: field.fit.correlated_points,
        }
    });
    Product {
        name: "fibres".into(),
        table: Table { columns, ..Table::default() },
        gallery: Some(Gallery {
            title: format!("Fields of the fibres of {}", station.name),
            subtitle: vec![
                "left: measured, of the fitted middle; right: measured less fitted".into(),
            ],
            tiles: fields
                .iter()
                .flat_map(|field| [tile(field, false), tile(field, true)])
                .collect(),
        }),
        json: json_of(&AlignedJson { station: &station.name, channels: fits.collect(), warnings }),
        ..Product::default()
    }
}

const SIDE: u32 = 400;
const EMPTY: Rgba<u8> = Rgba([236, 236, 236, 255]);
const BLUE: [f64; 3] = [33.0, 102.0, 172.0];
const RED: [f64; 3] = [178.0, 24.0, 43.0];

/// White at 0, blue at −1, red at 1.
fn diverging(value: f64) -> RGBColor {
    let end = if value < 0.0 { BLUE } else { RED };
    let part = value.abs().min(1.0);
    let [r, g, b] = [0, 1, 2].map(|i| (255.0 + part * (end[i] - 255.0)).round() as u8);
    RGBColor(r, g, b)
}

/// The measured field, or what the fit leaves of it.
fn tile(field: &Field, is_residual: bool) -> Tile {
    let cells = &field.map.cells;
    let cell_px = field.map.cell_px;
    let ends = |i: usize| {
        let at = cells.iter().map(|cell| cell.offset_px[i]);
        let low = at.clone().fold(f64::INFINITY, f64::min) - 0.5 * cell_px;
        (low, at.fold(f64::NEG_INFINITY, f64::max) + 0.5 * cell_px)
    };
    let (x, y) = (ends(0), ends(1));
    let side = (x.1 - x.0).max(y.1 - y.0).max(cell_px);
    let scale = f64::from(SIDE) / side;
    let most = cells.iter().map(|cell| cell.residual.abs()).fold(1e-6, f64::max);
    let brightest = cells.iter().map(|cell| cell.value).fold(1e-6, f64::max);
    let mut image = RgbaImage::from_pixel(SIDE, SIDE, EMPTY);
    for cell in cells {
        let RGBColor(r, g, b) = match is_residual {
            true => diverging(cell.residual / most),
            false => viridis(cell.value / brightest),
        };
        let from = [(cell.offset_px[0], x.0), (cell.offset_px[1], y.0)]
            .map(|(at, low)| ((at - 0.5 * cell_px - low) * scale).floor().max(0.0) as u32);
        let to = from.map(|low| (low + (cell_px * scale).ceil() as u32).min(SIDE));
        for row in from[1]..to[1] {
            for column in from[0]..to[0] {
                image.put_pixel(column, row, Rgba([r, g, b, 255]));
            }
        }
    }
    let key = if is_residual {
        Key::Names(vec![
            (diverging(1.0), format!("{most:+.3}")),
            (diverging(0.0), "as fitted".into()),
            (diverging(-1.0), format!("{:+.3}", -most)),
        ])
    } else {
        Key::Bar { label: vec!["of the middle".into()], range: (0.0, brightest), log: false }
    };
    Tile {
        title: format!("{}, {}", field.channel, if is_residual { "residual" } else { "measured" }),
        image,
        is_dark: false,
        key,
        arrows: Vec::new(),
        scale_bar: Some((10.0 / side, "10 px".into())),
    }
}
