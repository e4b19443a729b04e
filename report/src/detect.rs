//! Points and streaks of frames: text, table, JSON, pictures with marks.

use crate::Product;
use crate::plot::gallery::{Gallery, Key, Tile};
use crate::plot::{RGBColor, viridis};
use crate::reduce::figure::ring;
use image::{Rgba, RgbaImage};
use ndarray::ArrayView2;
use serde::Serialize;
use std::fmt::Write as _;
use sunglint_calibration::photometry::field::{Field, StarTrails, Streak};
use sunglint_formats::image_frame::{FrameHeader, FrameKind, FrameSite};
use sunglint_formats::text::counted;
use sunglint_formats::time::format_utc;
use sunglint_formats::{Column, Table};

/// Points that the text lists.
const LISTED: usize = 10;
/// Pictures that a figure holds at most.
const MOST_PICTURES: usize = 12;
/// Longer side of a picture, pixels.
const SIDE: usize = 800;
const STREAK: Rgba<u8> = Rgba([255, 90, 60, 255]);
const TRAIL: Rgba<u8> = Rgba([255, 255, 255, 255]);
const POINT: Rgba<u8> = Rgba([255, 255, 255, 255]);

/// A frame and what was found in it.
#[derive(Debug, Serialize)]
pub struct Detected {
    /// The file.
    pub file: String,
    /// The program that wrote it.
    pub program: Option<String>,
    /// Kind by its header.
    pub frame_type: Option<FrameKind>,
    /// Middle of the exposure.
    pub time_utc: Option<String>,
    /// The cards that the time was taken from.
    pub time_source: Option<String>,
    /// Length of the exposure, s.
    pub exposure_s: Option<f64>,
    /// Name of the filter.
    pub filter: Option<String>,
    /// Electrons for one ADU.
    pub gain_e_per_adu: Option<f64>,
    /// Place of the telescope.
    pub site: Option<FrameSite>,
    /// Assumptions, and contradictions in the file.
    pub notes: Vec<String>,
    /// Findings.
    #[serde(flatten)]
    pub field: Field,
    /// The picture with marks.
    #[serde(skip)]
    picture: Option<RgbaImage>,
}

impl Detected {
    /// Puts a frame's header and its sources together; with a picture where `is_drawn`.
    pub fn new(
        header: &FrameHeader,
        field: Field,
        pixels: ArrayView2<'_, f32>,
        is_drawn: bool,
    ) -> Self {
        Self {
            file: header.path.display().to_string(),
            program: header.program.clone(),
            frame_type: header.kind,
            time_utc: header.time.as_ref().map(|time| format_utc(time.middle, 4)),
            time_source: header.time.as_ref().map(|time| time.source.clone()),
            exposure_s: header.exposure_s,
            filter: header.filter.clone(),
            gain_e_per_adu: header.gain_e_per_adu,
            site: header.site,
            notes: header.notes.clone(),
            picture: is_drawn.then(|| picture(pixels, &field)),
            field,
        }
    }

    fn kind_of(streak: &Streak) -> &'static str {
        if streak.is_star_trail { "star_trail" } else { "streak" }
    }
}

/// Number of frames that are drawn.
pub fn is_drawn(index: usize) -> bool {
    index < MOST_PICTURES
}

/// The frames in all their forms.
///
/// # Errors
/// None in practice: a document of numbers and texts.
pub fn product(frames: &[Detected]) -> Result<Product, serde_json::Error> {
    let tiles: Vec<Tile> = frames
        .iter()
        .filter_map(|frame| {
            let noise = frame.field.noise_adu;
            let low = frame.field.background_adu - 2.0 * noise;
            Some(Tile {
                title: std::path::Path::new(&frame.file)
                    .file_name()
                    .map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
                image: frame.picture.clone()?,
                is_dark: true,
                key: Key::Bar {
                    label: vec![
                        counted(frame.field.streaks.len(), "streak"),
                        counted(frame.field.points.len(), "point"),
                        "ADU".into(),
                    ],
                    range: (low, low + 12.0 * noise),
                    log: false,
                },
                arrows: Vec::new(),
                scale_bar: None,
            })
        })
        .collect();
    let gallery = (!tiles.is_empty()).then(|| Gallery {
        title: "Points and streaks".into(),
        subtitle: vec!["streaks (red), trails of stars and points (white); the first row of the file is on top".into()],
        tiles,
    });
    #[derive(Serialize)]
    struct Document<'a> {
        frames: &'a [Detected],
    }
    let json = serde_json::to_value(Document { frames })?;
    Ok(Product {
        name: "detected".into(),
        table: table(frames),
        gallery,
        json,
        ..Product::default()
    })
}

/// A row for each streak and point.
fn table(frames: &[Detected]) -> Table {
    const NAMES: [(&str, Option<&str>); 12] = [
        ("column_px", Some("pix")),
        ("row_px", Some("pix")),
        ("flux_adu", Some("adu")),
        ("sigma_adu", Some("adu")),
        ("significance", None),
        ("length_px", Some("pix")),
        ("angle_deg", Some("deg")),
        ("from_column_px", Some("pix")),
        ("from_row_px", Some("pix")),
        ("to_column_px", Some("pix")),
        ("to_row_px", Some("pix")),
        ("fwhm_px", Some("pix")),
    ];
    let (mut files, mut times, mut kinds, mut remarks) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut numbers: Vec<Vec<f64>> = vec![Vec::new(); NAMES.len()];
    let mut add = |frame: &Detected, kind: &str, remark: Vec<&str>, values: [f64; 12]| {
        files.push(frame.file.clone());
        times.push(frame.time_utc.clone().unwrap_or_default());
        kinds.push(kind.to_owned());
        remarks.push(remark.join(" "));
        for (column, value) in numbers.iter_mut().zip(values) {
            column.push(value);
        }
    };
    for frame in frames {
        for s in &frame.field.streaks {
            let [a, b] = s.ends_px;
            let remark =
                [(s.is_cut, "cut"), (s.is_end_hidden, "end_hidden"), (s.is_saturated, "saturated")];
            let remark = remark.into_iter().filter(|(is, _)| *is).map(|(_, word)| word).collect();
            add(
                frame,
                Detected::kind_of(s),
                remark,
                [
                    0.5 * (a[0] + b[0]),
                    0.5 * (a[1] + b[1]),
                    s.flux_adu,
                    s.sigma_adu,
                    s.significance,
                    s.length_px,
                    s.angle_deg,
                    a[0],
                    a[1],
                    b[0],
                    b[1],
                    s.fwhm_px,
                ],
            );
        }
        for p in &frame.field.points {
            let remark = [(p.is_cut, "cut"), (p.is_saturated, "saturated")];
            let remark = remark.into_iter().filter(|(is, _)| *is).map(|(_, word)| word).collect();
            let [x, y] = p.place_px.to_array();
            let none = f64::NAN;
            add(
                frame,
                "point",
                remark,
                [
                    x,
                    y,
                    p.flux_adu,
                    p.sigma_adu,
                    p.significance,
                    0.0,
                    none,
                    none,
                    none,
                    none,
                    none,
                    none,
                ],
            );
        }
    }
    let mut columns = vec![
        Column::text("file", files),
        Column::text("time_utc", times),
        Column::text("kind", kinds),
    ];
    for ((name, unit), values) in NAMES.into_iter().zip(numbers) {
        columns.push(Column::f64(name, unit, values));
    }
    columns.push(Column::text("remark", remarks));
    Table { columns, ..Table::default() }
}

/// The frames as text.
pub fn text(frames: &[Detected]) -> String {
    let mut text = String::new();
    for frame in frames {
        let field = &frame.field;
        let time = match (&frame.time_utc, &frame.time_source) {
            (Some(time), Some(source)) => format!("{time} (middle; {source})"),
            _ => "no time in the header".into(),
        };
        let exposure = frame
            .exposure_s
            .map_or_else(|| "no exposure in the header".into(), |s| format!("{s} s"));
        let filter = frame.filter.as_deref().map_or_else(String::new, |f| format!(", filter {f}"));
        let width = match field.fwhm_points {
            0 => "told or assumed".to_owned(),
            n => format!("by {n} points"),
        };
        let _ = writeln!(
            text,
            "{}\n  {time}, {exposure}{filter}\n  {} × {} px, background {:.1} ± {:.1} ADU, points of {:.1} px at half their maximum ({width}), {} pixels of cosmic rays left out",
            frame.file,
            field.size_px[0],
            field.size_px[1],
            field.background_adu,
            field.noise_adu,
            field.fwhm_px,
            field.cosmic_ray_pixels
        );
        for note in &frame.notes {
            let _ = writeln!(text, "  note: {note}");
        }
        if let Some(StarTrails { length_px: length, angle_deg: angle }) = field.star_trails {
            let _ = writeln!(text, "  stars are trailed: {length:.1} px, {angle:.1}°");
        }
        if field.streaks.is_empty() {
            text.push_str("  no streak\n");
        } else {
            text.push_str("  streak from           to                   length  angle       light ADU       ±     S/N\n");
        }
        for s in &field.streaks {
            let [a, b] = s.ends_px;
            let remark = [
                (s.is_star_trail, " star trail"),
                (s.is_cut, " cut by the edge"),
                (s.is_end_hidden, " an end hidden"),
                (s.is_saturated, " saturated"),
            ];
            let remark: String = remark.into_iter().filter(|(is, _)| *is).map(|(_, w)| w).collect();
            let _ = writeln!(
                text,
                "  ({:8.2}, {:8.2}) ({:8.2}, {:8.2}) {:7.1} {:6.1}° {:15.5e} {:7.1e} {:7.1}{remark}",
                a[0],
                a[1],
                b[0],
                b[1],
                s.length_px,
                s.angle_deg,
                s.flux_adu,
                s.sigma_adu,
                s.significance
            );
        }
        let _ = writeln!(
            text,
            "  {} points{}",
            field.points.len(),
            if field.points.len() > LISTED {
                format!(", the {LISTED} brightest:")
            } else {
                String::new()
            }
        );
        for p in field.points.iter().take(LISTED) {
            let remark = [(p.is_cut, " cut by the edge"), (p.is_saturated, " saturated")];
            let remark: String = remark.into_iter().filter(|(is, _)| *is).map(|(_, w)| w).collect();
            let _ = writeln!(
                text,
                "  ({:8.2}, {:8.2}) {:52.5e} {:7.1e} {:7.1}{remark}",
                p.place_px[0], p.place_px[1], p.flux_adu, p.sigma_adu, p.significance
            );
        }
    }
    text
}

/// A frame with its sources marked: means of its pixels, linear from 2 standard deviations below the background to 10 above.
fn picture(pixels: ArrayView2<'_, f32>, field: &Field) -> RgbaImage {
    let (rows, columns) = pixels.dim();
    let longest = rows.max(columns).max(1);
    let scale = (SIDE as f64 / longest as f64).min(4.0);
    let [width, height] = [columns, rows].map(|n| ((n as f64 * scale).round() as u32).max(1));
    let block = (1.0 / scale).ceil().max(1.0) as usize;
    let low = field.background_adu - 2.0 * field.noise_adu;
    let span = (12.0 * field.noise_adu).max(1e-12);
    let mut image = RgbaImage::from_fn(width, height, |x, y| {
        let [column, row] = [(x, columns), (y, rows)]
            .map(|(at, n)| (((f64::from(at) + 0.5) / scale) as usize).min(n - 1));
        let part = pixels.slice(ndarray::s![
            row..(row + block).min(rows),
            column..(column + block).min(columns)
        ]);
        let (sum, n) = part
            .iter()
            .filter(|v| v.is_finite())
            .fold((0.0, 0.0), |(s, n), v| (s + f64::from(*v), n + 1.0));
        let RGBColor(r, g, b) = viridis((if n > 0.0 { sum / n } else { low } - low) / span);
        Rgba([r, g, b, 255])
    });
    for streak in &field.streaks {
        let [a, b] = streak.ends_px;
        let middle = [0, 1].map(|i| 0.5 * (a[i] + b[i]));
        let trail = [0, 1].map(|i| b[i] - a[i]);
        let colour = if streak.is_star_trail { TRAIL } else { STREAK };
        ring(&mut image, middle, trail, (2.0 * field.fwhm_px).max(4.0 / scale), scale, colour);
        // The long sides.
        let steps = (streak.length_px * scale * 2.0).ceil().max(1.0) as u32;
        let across = [-trail[1] / streak.length_px, trail[0] / streak.length_px];
        let radius = (2.0 * field.fwhm_px).max(4.0 / scale);
        for i in 0..=steps {
            let t = f64::from(i) / f64::from(steps) - 0.5;
            for side in [-radius, radius] {
                let [x, y] =
                    [0, 1].map(|k| (middle[k] + t * trail[k] + side * across[k] + 0.5) * scale);
                if x >= 0.0 && y >= 0.0 && x < f64::from(width) && y < f64::from(height) {
                    image.put_pixel(x as u32, y as u32, colour);
                }
            }
        }
    }
    // So many that they would cover the picture are not marked.
    for point in field.points.iter().take(300) {
        ring(
            &mut image,
            point.place_px.to_array(),
            [0.0; 2],
            (2.0 * field.fwhm_px).max(4.0 / scale),
            scale,
            POINT,
        );
    }
    image
}
