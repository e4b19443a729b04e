//! Frames put on the sky by the pattern of their stars.

use crate::{Product, rounded};
use serde::Serialize;
use std::fmt::Write as _;
use sunglint_calibration::field_stars::blind::Solved;
use sunglint_formats::image_frame::FrameHeader;
use sunglint_formats::time::format_utc;
use sunglint_formats::{Column, Table};

/// A frame and its place.
#[derive(Debug, Clone, Serialize)]
pub struct Frame {
    /// The file.
    pub file: String,
    /// Middle of the exposure.
    pub time_utc: Option<String>,
    /// Points in the frame, or trails where stars are trailed.
    pub sources: usize,
    /// Where the first row is drawn: `top` where ROWORDER says TOP-DOWN, else `bottom`.
    pub first_row: &'static str,
    /// The place, its directions as the frame is drawn; none where no pattern was beyond chance.
    pub solved: Option<Solved>,
}

impl Frame {
    /// Puts them together.
    pub fn new(header: &FrameHeader, sources: usize, solved: Option<Solved>) -> Self {
        Self {
            file: header.path.display().to_string(),
            time_utc: header.time.as_ref().map(|time| format_utc(time.middle, 3)),
            sources,
            first_row: if header.is_top_down { "top" } else { "bottom" },
            solved: solved.map(|s| s.drawn(header.is_top_down)),
        }
    }
}

/// Table and JSON of frames.
///
/// # Errors
/// None: numbers that JSON cannot hold are `null`.
pub fn product(frames: &[Frame]) -> Result<Product, serde_json::Error> {
    let of = |value: fn(&Solved) -> f64| {
        let of_one = |f: &Frame| f.solved.as_ref().map_or(f64::NAN, |s| rounded(value(s)));
        frames.iter().map(of_one).collect::<Vec<f64>>()
    };
    let table = Table {
        columns: vec![
            Column::text("file", frames.iter().map(|f| f.file.clone()).collect()),
            Column::text(
                "time_utc",
                frames.iter().map(|f| f.time_utc.clone().unwrap_or_default()).collect(),
            ),
            Column::f64("ra_deg", Some("deg"), of(|s| s.centre_deg.ra_deg)),
            Column::f64("dec_deg", Some("deg"), of(|s| s.centre_deg.dec_deg)),
            Column::f64("width_deg", Some("deg"), of(|s| s.size_deg[0])),
            Column::f64("scale_arcsec", Some("arcsec"), of(|s| s.scale_arcsec)),
            Column::f64("up_deg", Some("deg"), of(|s| s.up_deg)),
            Column::f64("stars", None, of(|s| s.stars as f64)),
            Column::f64("scatter_px", Some("pix"), of(|s| s.scatter_px)),
            Column::f64("sigma_arcsec", Some("arcsec"), of(|s| s.sigma_arcsec)),
        ],
        ..Table::default()
    };
    #[derive(Serialize)]
    struct Document<'a> {
        frames: &'a [Frame],
    }
    let json = serde_json::to_value(Document { frames })?;
    Ok(Product { name: "solved".into(), table, json, ..Product::default() })
}

/// Text for a person.
pub fn text(frames: &[Frame]) -> String {
    let mut text = String::new();
    for frame in frames {
        let Some(s) = &frame.solved else {
            let _ = writeln!(text, "{}: not solved ({} sources)", frame.file, frame.sources);
            continue;
        };
        let mirrored = if s.is_mirrored { ", mirrored" } else { "" };
        let _ = writeln!(
            text,
            "{}: RA {:.5}°, Dec {:+.5}° (±{:.2}″), {:.3}° × {:.3}°, {:.3}″/px, up is {:.2}° from north through east{mirrored} (first row at the {}); {} stars, scatter {:.2} px",
            frame.file,
            s.centre_deg.ra_deg,
            s.centre_deg.dec_deg,
            s.sigma_arcsec,
            s.size_deg[0],
            s.size_deg[1],
            s.scale_arcsec,
            s.up_deg,
            frame.first_row,
            s.stars,
            s.scatter_px,
        );
    }
    text
}
