//! Figures of a reduction: light curves, and frames with the target's rings.

use crate::plot::gallery::{Gallery, Key, Tile};
use crate::plot::{Axis, Figure, Panel, RGBColor, Series, colour_of_wavelength_nm, viridis};
use glam::DVec2;
use image::{Rgba, RgbaImage};
use sunglint_calibration::reduction::Visited;
use sunglint_calibration::reduction::frames::Shown;
use sunglint_formats::time::format_utc;
use sunglint_radiometry::light_curve::ChannelCurve;
use sunglint_radiometry::station::Station;

/// More points than this of a channel cannot be told apart.
const MOST_POINTS: usize = 20_000;
/// Side of a picture, pixels: what a tile shows.
const SIDE: u32 = 400;
/// Colours between these quantiles of the pixels.
const QUANTILES: [f64; 2] = [0.02, 0.9998];
const APERTURE: Rgba<u8> = Rgba([255, 255, 255, 255]);
const ANNULUS: Rgba<u8> = Rgba([255, 110, 70, 255]);

/// A panel of rates against time for each channel of a visit.
pub fn curves(visited: &Visited, station: &Station) -> Figure {
    let samples = &visited.linear.samples;
    let first = samples.time.first().copied().unwrap_or(visited.stay.from);
    let seconds: Vec<f64> = samples.time.iter().map(|time| (*time - first).to_seconds()).collect();
    let panel = |channel: &ChannelCurve| {
        let step = seconds.len().div_ceil(MOST_POINTS).max(1);
        let points = seconds.iter().copied().zip(channel.rate_hz.iter().copied());
        let points = points.filter(|(_, rate)| rate.is_finite()).step_by(step).collect();
        let colour = station
            .channel(&channel.name)
            .map_or(RGBColor(60, 60, 60), |c| colour_of_wavelength_nm(c.mean_wavelength_nm()));
        let unit = match station.channel(&channel.name).map(|c| &c.detector) {
            Some(sunglint_radiometry::station::Detector::CameraPlane(_)) => "ADU/s",
            _ => "Hz",
        };
        Panel::new(
            Axis::linear(format!("seconds after {} UTC", format_utc(first, 1))),
            Axis::linear(format!("{}, {unit}", channel.name)),
            vec![Series::dots(channel.name.clone(), 0, points).with_colour(colour)],
        )
    };
    let drawn = |channel: &&ChannelCurve| channel.rate_hz.iter().any(|rate| rate.is_finite());
    Figure {
        title: format!(
            "{}, visit {}: linear rates at {}",
            visited.stay.target.name, visited.stay.number, station.name
        ),
        panels: visited.linear.channels.iter().filter(drawn).map(panel).collect(),
    }
}

/// Frames of a visit with aperture and annulus; `None` without frames.
pub fn rings(visited: &Visited) -> Option<Gallery> {
    let tiles: Vec<Tile> = visited
        .shown
        .iter()
        .map(|(camera, shown)| {
            let (image, range) = picture(shown);
            let measured = &shown.measured;
            let place = match measured.place_px {
                Some(DVec2 { x: column, y: row }) => {
                    vec![format!("column {column:.1}"), format!("row {row:.1}")]
                }
                None => vec!["no target found".to_owned()],
            };
            Tile {
                title: format!("{camera} {}", format_utc(measured.time, 1)),
                image,
                is_dark: true,
                key: Key::Bar { label: [place, vec!["ADU".into()]].concat(), range, log: true },
                arrows: Vec::new(),
                scale_bar: None,
            }
        })
        .collect();
    (!tiles.is_empty()).then(|| Gallery {
        title: format!("{}, visit {}", visited.stay.target.name, visited.stay.number),
        subtitle: vec!["aperture (white), annulus of the background (red)".into()],
        tiles,
    })
}

/// A frame between two quantiles, in a logarithmic scale, with its rings; and the values at both ends.
fn picture(shown: &Shown) -> (RgbaImage, (f64, f64)) {
    let pixels = &shown.pixels;
    let (rows, columns) = pixels.dim();
    let mut sorted: Vec<u16> = pixels.iter().copied().collect();
    sorted.sort_unstable();
    let at = |q: f64| {
        let i = (q * sorted.len().saturating_sub(1) as f64) as usize;
        f64::from(sorted.get(i).copied().unwrap_or(0))
    };
    let low = at(QUANTILES[0]).max(1.0);
    let high = at(QUANTILES[1]).max(low + 1.0);
    let longest = rows.max(columns).max(1);
    let scale = f64::from(SIDE) / longest as f64;
    let [width, height] = [columns, rows].map(|n| ((n as f64 * scale).round() as u32).max(1));
    let mut image = RgbaImage::from_fn(width, height, |x, y| {
        let [column, row] = [(x, columns), (y, rows)]
            .map(|(at, n)| ((f64::from(at) + 0.5) / scale).min(n as f64 - 0.5) as usize);
        let value = pixels.get((row, column)).map_or(0.0, |adu| f64::from(*adu));
        let RGBColor(r, g, b) = viridis((value.max(low) / low).ln() / (high / low).ln());
        Rgba([r, g, b, 255])
    });
    if let Some(aperture) = &shown.measured.aperture {
        let [inner, outer] = shown.annulus_px.to_array();
        let centre_px = [0, 1].map(|i| aperture.centre_px[i] - shown.origin_px[i] as f64);
        for (radius, colour) in [(aperture.radius_px, APERTURE), (inner, ANNULUS), (outer, ANNULUS)]
        {
            ring(&mut image, centre_px, aperture.trail_px.to_array(), radius, scale, colour);
        }
    }
    (image, (low, high))
}

/// The outline of a circle, or of a pill along a trail, on a picture that is `scale` times its frame.
pub(crate) fn ring(
    image: &mut RgbaImage,
    centre_px: [f64; 2],
    trail_px: [f64; 2],
    radius_px: f64,
    scale: f64,
    colour: Rgba<u8>,
) {
    let turns = (16.0 * radius_px * scale).ceil().max(64.0) as u32;
    let along = trail_px[0].hypot(trail_px[1]);
    for i in 0..turns {
        let angle = std::f64::consts::TAU * f64::from(i) / f64::from(turns);
        let (sin, cos) = angle.sin_cos();
        // A pill is a circle whose halves are half a trail apart.
        let side =
            if along > 0.0 && cos * trail_px[0] + sin * trail_px[1] < 0.0 { -0.5 } else { 0.5 };
        let at = |k: usize, part: f64| {
            (centre_px[k] + side * trail_px[k] + radius_px * part + 0.5) * scale
        };
        let (x, y) = (at(0, cos), at(1, sin));
        let inside = (0.0..f64::from(image.width())).contains(&x)
            && (0.0..f64::from(image.height())).contains(&y);
        if inside {
            image.put_pixel(x as u32, y as u32, colour);
        }
    }
}
