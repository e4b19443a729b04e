//! A picture in colours.

use crate::plot::gallery::{Arrow, Gallery, Key, Tile};
use crate::plot::{COLOURS, RGBColor, viridis};
use image::{Rgba, RgbaImage};
use std::ops::Range;
use sunglint_numerics::order;
use sunglint_simulator::picture::{RGB_NM, Shot, What};

/// Behind pictures of light.
const SKY: [f64; 3] = [10.0, 10.0, 14.0];
/// Where the body is and no light comes from it.
const UNLIT: [f64; 3] = [70.0, 70.0, 78.0];
/// The arrow to the Sun.
const SUN: RGBColor = RGBColor(240, 140, 0);
/// Behind the others.
const PAPER: [f64; 3] = [246.0, 246.0, 244.0];
/// Where the brightest pixel is so many times brighter than the lit body in the middle, colours are logarithmic.
const CONTRAST: f64 = 20.0;
/// Over so many decades.
const DECADES: f64 = 3.0;
/// The share of lit pixels that an eye's picture lets saturate.
const SATURATED: f64 = 0.005;

/// The pictures that were asked for.
pub(super) fn gallery(shot: &Shot<'_>) -> Gallery {
    let mut tiles = Vec::new();
    for what in &shot.what {
        match what {
            What::Intensity => tiles.extend((0..shot.asked).map(|band| intensity(shot, band))),
            What::Material => tiles.push(materials(shot)),
            What::Depth => tiles.push(depth(shot)),
            What::Rgb => tiles.push(eye(shot)),
            _ => {}
        }
    }
    let [w, h] = shot.camera.size_px;
    let mut optics = format!("{w} × {h} pixels of {}", length(shot.camera.pixel_m));
    if let Some(words) = &shot.optics.words {
        optics = format!("{optics}; {words}");
    }
    let words = format!(
        "{}; sunlight scattered once, from the middle of the Sun's disc; orthographic",
        shot.aim.up_name
    );
    Gallery { title: shot.aim.title.clone(), subtitle: vec![optics, words], tiles }
}

/// A length as people read it.
pub(super) fn length(m: f64) -> String {
    match m {
        m if m >= 1e3 => format!("{:.4} km", m * 1e-3),
        m if m >= 0.1 => format!("{m:.3} m"),
        m if m >= 1e-3 => format!("{:.2} mm", m * 1e3),
        m => format!("{m:.2e} m"),
    }
}

fn tile(shot: &Shot<'_>, title: String, is_dark: bool, image: RgbaImage, key: Key) -> Tile {
    let arrows = shot.aim.axes().map_or(Vec::new(), |(right, up)| {
        let arrow = |(name, toward): &(&str, glam::DVec3)| Arrow {
            name: (*name).to_owned(),
            across: (toward.dot(right), toward.dot(up)),
            is_near: toward.dot(shot.aim.observer_body) > 0.0,
            colour: (*name == "Sun").then_some(SUN),
        };
        shot.aim.compass.iter().map(arrow).collect()
    });
    let field_m = shot.camera.pixel_m * shot.camera.size_px[0] as f64;
    Tile { title, image, is_dark, key, arrows, scale_bar: Some(bar(field_m, shot.aim.range_m)) }
}

/// A round length of about a fifth of the picture, with the angle that it is seen under.
fn bar(field_m: f64, range_m: Option<f64>) -> (f64, String) {
    let raw = 0.25 * field_m;
    let decade = 10_f64.powf(raw.log10().floor());
    let round = [5.0, 2.0, 1.0].into_iter().find(|m| m * decade <= raw).unwrap_or(1.0) * decade;
    let words = match round {
        m if m >= 1e3 => format!("{} km", m * 1e-3),
        m if m >= 1.0 => format!("{m} m"),
        m if m >= 1e-2 => format!("{:.0} cm", m * 1e2),
        m => format!("{} mm", m * 1e3),
    };
    let words = match range_m {
        Some(range_m) => format!("{words} ({:.2}″)", (round / range_m).to_degrees() * 3600.0),
        None => words,
    };
    (round / field_m, words)
}

fn seen(shot: &Shot<'_>, pixel: usize) -> f64 {
    shot.picture.materials.iter().map(|m| m[pixel]).sum::<f64>().clamp(0.0, 1.0)
}

/// A picture whose pixels are `colour` where the body is, over a ground.
fn painted(
    shot: &Shot<'_>,
    ground: [f64; 3],
    colour: impl Fn(usize) -> ([f64; 3], f64),
) -> RgbaImage {
    let [width, height] = shot.camera.size_px;
    // A picture has 10,000 pixels on a side at most.
    RgbaImage::from_fn(width as u32, height as u32, |x, y| {
        let (colour, share) = colour(y as usize * width + x as usize);
        // Between two bytes lies a byte.
        let mix = |c: usize| (share * colour[c] + (1.0 - share) * ground[c]).round() as u8;
        Rgba([mix(0), mix(1), mix(2), 255])
    })
}

fn bytes(RGBColor(r, g, b): RGBColor) -> [f64; 3] {
    [r, g, b].map(f64::from)
}

/// The quantile of values; 0 of nothing.
fn quantile(values: impl Iterator<Item = f64>, share: f64) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    if values.is_empty() { 0.0 } else { order::quantile(&values, share) }
}

fn intensity(shot: &Shot<'_>, band: usize) -> Tile {
    let values = &shot.picture.bands[band];
    let most = values.iter().copied().fold(0.0, f64::max);
    let lit = || values.iter().copied().filter(|v| *v > 1e-9 * most);
    let blurred = !shot.optics.fwhm_arcsec.is_empty();
    let log = !blurred && most > CONTRAST * quantile(lit(), 0.5);
    let range = match (most > 0.0, log) {
        (false, _) => (0.0, 1.0),
        (true, false) => (0.0, most),
        (true, true) => (most * 10_f64.powf(-DECADES), most),
    };
    let fraction = |v: f64| match log {
        true => (v.max(range.0) / range.0).ln() / (range.1 / range.0).ln(),
        false => v / range.1,
    };
    let image = painted(shot, SKY, |pixel| {
        let share = if blurred { 1.0 } else { seen(shot, pixel) };
        // At an outline the value is that of the covered part, and the cover shows how much that is.
        let value = if share > 1e-3 { values[pixel] / share } else { values[pixel] };
        let dark = value <= 1e-9 * most && !blurred;
        (if dark { UNLIT } else { bytes(viridis(fraction(value))) }, share)
    });
    let nm = shot.bands_nm[band];
    let total = format!("all: {:.3e}", shot.totals[band]);
    let mut label = vec![shot.unit_words().to_owned(), total];
    if !blurred {
        label.push("grey: no sunlight".into());
    }
    let title = format!("Intensity at {nm} nm{}", if log { ", logarithmic" } else { "" });
    tile(shot, title, true, image, Key::Bar { label, range, log })
}

/// The colours of materials.
fn palette(k: usize) -> RGBColor {
    // The greys last: the ground is pale.
    COLOURS[[0, 5, 2, 1, 4, 3, 7, 6][k % 8]]
}

fn materials(shot: &Shot<'_>) -> Tile {
    let all = &shot.picture.materials;
    let visible: Vec<usize> =
        (0..all.len()).filter(|k| all[*k].iter().any(|share| *share > 1e-6)).collect();
    let image = painted(shot, PAPER, |pixel| {
        let sum = seen(shot, pixel);
        let mut colour = [0.0; 3];
        for (i, k) in visible.iter().enumerate() {
            let share = all[*k][pixel] / sum.max(1e-12);
            let own = bytes(palette(i));
            colour.iter_mut().zip(own).for_each(|(c, own)| *c += share * own);
        }
        (colour.map(|c| c.clamp(0.0, 255.0)), sum)
    });
    let scene = &shot.aim.target.materials;
    let area = shot.camera.pixel_m * shot.camera.pixel_m;
    let name = |(i, k): (usize, &usize)| {
        let seen_m2 = area * all[*k].iter().sum::<f64>();
        let name = scene.get(*k).map_or("", |m| m.name.as_str());
        (palette(i), format!("{}, {seen_m2:.3} m²", short(name)))
    };
    let names = visible.iter().enumerate().map(name).collect();
    tile(shot, "Materials, and what is seen of them".into(), false, image, Key::Names(names))
}

fn short(name: &str) -> String {
    match name.char_indices().nth(14) {
        Some((at, _)) => format!("{}…", &name[..at]),
        None => name.to_owned(),
    }
}

/// The least and the greatest depth.
pub(super) fn depths(shot: &Shot<'_>) -> Option<Range<f64>> {
    let good = shot.picture.depth_m.iter().copied().filter(|d| d.is_finite());
    let (low, high) =
        good.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), d| (l.min(d), h.max(d)));
    (low <= high).then_some(low..high)
}

fn depth(shot: &Shot<'_>) -> Tile {
    let ends = depths(shot).unwrap_or(0.0..1.0);
    let room = (ends.end - ends.start).max(1e-6);
    let image = painted(shot, PAPER, |pixel| {
        let depth = shot.picture.depth_m[pixel];
        if depth.is_nan() {
            return (PAPER, 1.0);
        }
        (bytes(viridis((depth - ends.start) / room)), seen(shot, pixel))
    });
    let label = vec!["m from the plane of".into(), "the body's origin, away".into()];
    let range = (ends.start, ends.start + room);
    tile(shot, "Depth".into(), false, image, Key::Bar { label, range, log: false })
}

/// The sRGB curve (IEC 61966-2-1), 0 to 255.
fn srgb(linear: f64) -> f64 {
    let v = linear.clamp(0.0, 1.0);
    255.0 * if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

fn eye(shot: &Shot<'_>) -> Tile {
    let bands = shot.bands_nm.len() - RGB_NM.len()..shot.bands_nm.len();
    // Over sunlight's own colour: what reflects alike at all wavelengths is grey.
    let of = |band: usize, pixel: usize| {
        let sun = shot.irradiance[band];
        if sun > 0.0 { shot.picture.bands[band][pixel] / sun } else { 0.0 }
    };
    let pixels = shot.picture.bands.first().map_or(0, Vec::len);
    let brightest = |pixel: usize| bands.clone().map(|b| of(b, pixel)).fold(0.0, f64::max);
    let most = (0..pixels).map(brightest).fold(0.0, f64::max);
    let lit = (0..pixels).map(brightest).filter(|v| *v > 1e-6 * most);
    let white = quantile(lit, 1.0 - SATURATED).max(f64::MIN_POSITIVE);
    let ground = [0.0; 3];
    let image = painted(shot, ground, |pixel| {
        let mut colour = [0.0; 3];
        colour.iter_mut().zip(bands.clone()).for_each(|(c, b)| *c = srgb(of(b, pixel) / white));
        (colour, 1.0)
    });
    let words = [
        "red: 640 nm",
        "green: 550 nm",
        "blue: 450 nm",
        "over the Sun's own",
        "irradiance: grey is grey",
        "sRGB curve;",
        "brightest 0.5 % of lit",
        "pixels saturated",
    ];
    let words = words.map(str::to_owned).to_vec();
    tile(shot, "As an eye might see it".into(), true, image, Key::Words(words))
}
