//! Sources and streaks of one frame, whatever program wrote it: found with a stated significance, and measured.
//!
//! [`find`] goes in these steps:
//!
//! 1. the background and its scatter on a mesh of 32 px, clipped; what is sharper than a point (cosmic rays, hot pixels) is taken out and counted;
//! 2. the width of points from the frame's own bright ones, by the curvature of their summits' logarithm across their narrow side;
//! 3. the frame smoothed with that width: summits that are round are stars, and are masked for what follows;
//! 4. sums along all segments propose streaks; each proposal is refined (direction, ends), fitted with a line of even light, and kept if it is lit along its whole
//!    length, as wide as a point, stands out of the lines beside it, does not run along the border, and if three points explain it less well;
//! 5. what is left is measured through an aperture.
//!
//! The significance of a streak is its fitted light over the standard deviation that the sky's noise gives that light.

mod along;
mod exposed;
mod growth;
mod mosaic;
mod plateau;
mod radon;
mod streak;

pub use along::{Along, along};
pub use growth::Growth;
pub use mosaic::{green_light, looks_like_mosaic};
pub use plateau::{Plateau, cut_flat, plateau};

use super::PhotometryError;
use super::image::Image;
use super::levels::Counter;
use super::overlap::Aperture;
use super::tiles::Tiles;
use exposed::Exposed;
use glam::DVec2;
use ndarray::ArrayView2;
use rayon::prelude::*;
use serde::Serialize;
use streak::{Fitted, Found, Search};
use sunglint_formats::frame::Bayer;
use sunglint_numerics::measured::Measured;
use sunglint_numerics::order::{SIGMA_PER_MAD, median};

/// Options of a search.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct FieldOptions {
    /// Full width at half maximum of a point, px; `None` takes it from the frame's own points.
    pub fwhm_px: Option<f64>,
    /// Points stand out of the smoothed frame by so many standard deviations.
    pub point_sigmas: f64,
    /// Streaks have at least so much light in standard deviations of it.
    pub streak_sigmas: f64,
    /// Length of the shortest streak, px.
    pub shortest_px: f64,
    /// Value from which a pixel is saturated, ADU.
    pub saturation_adu: Option<f64>,
    /// Electrons for one ADU: with it the noise of the light itself is counted.
    pub gain_e_per_adu: Option<f64>,
    /// Colours of the first 2 × 2 pixels of a colour camera: its green light is searched and measured ([`green_light`]).
    pub bayer: Option<Bayer>,
    /// Radius of the aperture of points, px; `None` takes 1.5 times their width at half maximum.
    pub aperture_px: Option<f64>,
    /// Points that are measured at most, the brightest first.
    pub most_points: usize,
    /// Whether the profile of points is fitted, wings and all (`growth`).
    pub fit_growth: bool,
}

impl Default for FieldOptions {
    fn default() -> Self {
        Self {
            fwhm_px: None,
            point_sigmas: 6.0,
            streak_sigmas: 8.0,
            shortest_px: 14.0,
            saturation_adu: None,
            gain_e_per_adu: None,
            bayer: None,
            aperture_px: None,
            most_points: 20_000,
            fit_growth: false,
        }
    }
}

/// A point of light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PointSource {
    /// Column and row, px; the middle of the first pixel is at 0, 0.
    pub place_px: DVec2,
    /// Light in the aperture above the local background, ADU.
    pub flux_adu: f64,
    /// Standard deviation of the light, ADU.
    pub sigma_adu: f64,
    /// Height of the summit of the smoothed frame in standard deviations.
    pub significance: f64,
    /// Whether a pixel in the aperture is saturated: the light is then a lower bound.
    pub is_saturated: bool,
    /// Whether the aperture leaves the frame.
    pub is_cut: bool,
}

/// A streak.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Streak {
    /// Both ends, columns and rows, px.
    pub ends_px: [DVec2; 2],
    /// Distance of the ends, px.
    pub length_px: f64,
    /// Direction from the columns' axis towards the rows' axis, deg, −90 to 90.
    pub angle_deg: f64,
    /// Light of the whole streak, ADU, by a fit of a line of even light with the width of a point.
    pub flux_adu: f64,
    /// Standard deviation of the light, ADU.
    pub sigma_adu: f64,
    /// Light over the standard deviation that the sky alone gives.
    pub significance: f64,
    /// Full width across at half maximum, px.
    pub fwhm_px: f64,
    /// Part of its length that is masked (stars, faults).
    pub masked: f64,
    /// Whether an end is at the frame's edge: the streak goes on beyond.
    pub is_cut: bool,
    /// Whether an end is hidden by a star or a fault: the streak may be longer, and its light more.
    pub is_end_hidden: bool,
    /// Whether it is one of many of the same length and direction: a star, while the telescope moved.
    pub is_star_trail: bool,
    /// Whether a pixel along it is saturated.
    pub is_saturated: bool,
}

/// Length and direction of the stars' trails. Written as a pair.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(into = "[f64; 2]")]
pub struct StarTrails {
    /// Length, px.
    pub length_px: f64,
    /// Direction from the columns' axis towards the rows' axis, deg, −90 to 90.
    pub angle_deg: f64,
}

impl From<StarTrails> for [f64; 2] {
    fn from(trails: StarTrails) -> Self {
        [trails.length_px, trails.angle_deg]
    }
}

/// Contents of a frame.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Field {
    /// Columns and rows.
    pub size_px: [usize; 2],
    /// Full width at half maximum of points, px.
    pub fwhm_px: f64,
    /// Points from which the width was taken; 0 where it was told or assumed.
    pub fwhm_points: usize,
    /// Middle of the background, ADU.
    pub background_adu: f64,
    /// Middle of the scatter of a pixel of the background, ADU.
    pub noise_adu: f64,
    /// Pixels of cosmic rays and hot pixels that were left out.
    pub cosmic_ray_pixels: usize,
    /// Streaks, the most significant first.
    pub streaks: Vec<Streak>,
    /// Points, the brightest first.
    pub points: Vec<PointSource>,
    /// Length and direction of the stars' trails, where stars are trailed.
    pub star_trails: Option<StarTrails>,
    /// Radius of the points' aperture, px.
    #[serde(skip)]
    pub aperture_px: f64,
    /// Growth of a point's light with the radius, where bright lone points or trails tell it.
    #[serde(skip)]
    pub growth: Option<Growth>,
    /// Remarks for the reader: which light was measured, saturation that no header told, pixels that look like a colour camera's.
    #[serde(skip)]
    pub remarks: Vec<String>,
}

impl Field {
    /// Standard deviation of the ratio of a point's and a streak's light by what is not known of the profile, mag.
    pub fn profile_sigma_mag(&self) -> f64 {
        self.growth().sigma_mag()
    }

    fn growth(&self) -> Growth {
        self.growth.clone().unwrap_or_else(|| Growth::assumed(self.fwhm_px))
    }

    /// All of a point's light and its standard deviation, ADU: what its aperture found over the part that it catches.
    pub fn whole_point_adu(&self, point: &PointSource) -> Measured {
        let part = self.growth().of_point(self.aperture_px).clamp(0.5, 1.0);
        Measured::new(point.flux_adu / part, point.sigma_adu / part)
    }

    /// All of a streak's light and its standard deviation, ADU.
    pub fn whole_streak_adu(&self, streak: &Streak) -> Measured {
        let half = half_width(self.fwhm_px / FWHM_PER_SIGMA);
        let part = self.growth().of_streak(streak.fwhm_px / FWHM_PER_SIGMA, half).clamp(0.5, 1.05);
        Measured::new(streak.flux_adu / part, streak.sigma_adu / part)
    }
}

/// Half of the width of the corridor in which a streak is fitted, px.
pub(crate) fn half_width(sigma_px: f64) -> f64 {
    5.0 * sigma_px + 2.0
}

/// Inner and outer radius of the ring for the background of an aperture, px.
pub(crate) fn ring(radius_px: f64) -> [f64; 2] {
    [(1.6 * radius_px).max(radius_px + 1.5), (2.5 * radius_px).max(radius_px + 4.0)]
}

/// Full width at half maximum over the standard deviation of a normal profile.
const FWHM_PER_SIGMA: f64 = super::centroid::FWHM_PER_SIGMA;
/// Width of a point where no frame tells, px.
const FWHM_PX: f64 = 3.0;

/// The frame above its background, ready to be searched.
pub(crate) struct Prepared {
    pub size: [usize; 2],
    /// Above the background, in standard deviations of a pixel; sharp pixels replaced.
    pub above: Vec<f32>,
    /// Smoothed with a point's width, in standard deviations.
    pub smooth: Vec<f32>,
    /// Pixels that are not to be used: no number, sharp, stars, streaks already found.
    pub masked: Vec<bool>,
    pub sigma_px: f64,
    /// The area that light reaches.
    pub exposed: Exposed,
}

/// Finds and measures the sources and streaks of a frame (values in ADU, `[row, column]`; NaN is masked).
///
/// # Errors
/// An option out of its range; a frame smaller than 16 × 16 pixels, or without a number.
pub fn find(pixels: ArrayView2<'_, f32>, options: &FieldOptions) -> Result<Field, PhotometryError> {
    check(pixels, options)?;
    let size = [pixels.ncols(), pixels.nrows()];
    let mut options = options.clone();
    let mut remarks = remarks(pixels, &mut options);
    let options = &options;
    let Values { all: mut raw, mut own, unit } = Values::of(pixels, options.bayer);
    let exposed = Exposed::of(&raw, size);
    exposed.take_out_others(&mut raw, size);
    own.iter_mut().for_each(|own| exposed.take_out_others(own, size));
    remarks.extend(exposed.note(size));
    // The values are in units of their own.
    let full = options.saturation_adu.map_or(f32::INFINITY, |adu| (adu / unit) as f32);
    let own = own.as_deref().unwrap_or(&raw);
    let whole = unit == 1.0 && own.iter().step_by(97).all(|v| v.is_nan() || v.fract() == 0.0);
    let mut counter = Counter::default();
    let step = if whole { 1.0 } else { 0.0 };
    let tiles = Tiles::of(own, size, step, &mut counter).continued();
    let tiles = if options.bayer.is_some() { tiles.with_noise_times(mosaic::NOISE) } else { tiles };
    let mut image = Image::above(raw.clone(), size, &tiles);
    // Sharper than any point first, then sharper than this frame's points.
    let mut sharp = image.take_out_sharp(0.55).len();
    let (sigma_px, fwhm_points) = match options.fwhm_px {
        Some(fwhm) => (fwhm / FWHM_PER_SIGMA, 0),
        None => width(image.values(), size, &raw, full),
    };
    sharp += image.take_out_sharp(0.8 * sigma_px).len();
    let smooth = image.significance(sigma_px).to_vec();
    let (above, left_out) = image.into_parts();
    let mut prepared = Prepared { size, above, smooth, masked: left_out, sigma_px, exposed };
    let summits = summits(&prepared, options.point_sigmas);
    let stars = mask_stars(&mut prepared, &summits);
    let search = Search { options, raw: &raw, full };
    let Found { streaks: fitted, edges } = streak::search(&mut prepared, &search);
    if edges > 0 {
        remarks.push(format!(
            "light along the border in {edges} place{}: an edge of the sensor is as bright as a trail there, so it is not listed as a streak",
            if edges == 1 { "" } else { "s" }
        ));
    }
    let noise_at = |x: f64, y: f64| f64::from(tiles.sigma_at(x, y)) * unit;
    let mut streaks: Vec<Streak> =
        fitted.iter().map(|fit| measured(fit, size, options, &noise_at)).collect();
    let star_trails = mark_star_trails(&mut streaks);
    let aperture_px = options.aperture_px.unwrap_or(1.5 * FWHM_PER_SIGMA * sigma_px);
    let near =
        |place: [f64; 2]| fitted.iter().any(|fit| fit.distance(place) < 3.0 * sigma_px + 1.0);
    let mut wanted: Vec<([f64; 2], f64)> = summits
        .iter()
        .zip(&stars)
        .filter(|(summit, is_star)| **is_star || !near(summit.place))
        .map(|(summit, _)| (summit.place, summit.height))
        .collect();
    wanted.sort_by(|a, b| b.1.total_cmp(&a.1));
    wanted.truncate(options.most_points);
    let gain = options.gain_e_per_adu;
    let mut points: Vec<PointSource> = wanted
        .into_par_iter()
        .filter_map(|(place, height)| {
            let noise = noise_at(place[0], place[1]);
            point(&raw, size, place, height, aperture_px, [unit, noise], gain, full)
        })
        .collect();
    points.sort_by(|a, b| {
        b.flux_adu.total_cmp(&a.flux_adu).then(a.place_px[0].total_cmp(&b.place_px[0]))
    });
    let growth = match star_trails {
        _ if !options.fit_growth => None,
        None => growth::of_points(&raw, size, &points, &streaks, sigma_px),
        Some(_) => growth::of_trails(&raw, size, &streaks, &points, sigma_px),
    };
    let middle = [0.5 * size[0] as f64, 0.5 * size[1] as f64];
    Ok(Field {
        size_px: size,
        fwhm_px: FWHM_PER_SIGMA * sigma_px,
        fwhm_points,
        background_adu: tiles.middle_level() * unit,
        noise_adu: noise_at(middle[0], middle[1]),
        cosmic_ray_pixels: sharp,
        streaks,
        points,
        star_trails,
        aperture_px,
        growth,
        remarks,
    })
}

/// The remark on a frame whose pixels all have one value, those aside that are no number; `None` of any other, and of one without a number.
pub fn constant(pixels: ArrayView2<'_, f32>) -> Option<String> {
    let mut numbers = pixels.iter().copied().filter(|v| v.is_finite());
    let value = numbers.next()?;
    numbers.all(|v| v == value).then(|| {
        let n = pixels.iter().filter(|v| v.is_finite()).count();
        format!(
            "all of its {n} pixels that are numbers have the value {value}: it holds no picture; is it a cover, a mask, another plane (--extension), or darker than the camera's 0?"
        )
    })
}

/// Notes that a reader needs beside what is found in a frame; corrects the options by it.
fn remarks(pixels: ArrayView2<'_, f32>, options: &mut FieldOptions) -> Vec<String> {
    let mut remarks = Vec::new();
    remarks.extend(constant(pixels));
    if let Some(found) = plateau(pixels)
        && options.saturation_adu.is_none_or(|adu| found.adu < adu)
    {
        options.saturation_adu = Some(found.adu);
        remarks.push(found.note());
    }
    match options.bayer {
        Some(pattern) => {
            remarks.push(format!(
                "a colour camera ({}): places and light are those of its green pixels",
                pattern.name()
            ));
            // Half of the pixels tell the light, and each electron counts twice.
            options.gain_e_per_adu = options.gain_e_per_adu.map(|gain| 0.5 * gain);
        }
        None => {
            if let Some([a, b, c, d]) = looks_like_mosaic(pixels) {
                remarks.push(format!(
                    "the sky's levels in the 2 x 2 pixels are {a:.0}, {b:.0}, {c:.0} and {d:.0} ADU, as a colour camera's: its light is not measured rightly without the pattern (--bayer RGGB, GRBG, GBRG or BGGR)"
                ));
            }
        }
    }
    remarks
}

fn check(pixels: ArrayView2<'_, f32>, options: &FieldOptions) -> Result<(), PhotometryError> {
    let bad = |name, value, expected| Err(PhotometryError::Option { name, value, expected });
    let least = pixels.ncols().min(pixels.nrows());
    if least < 16 {
        return bad("columns and rows", least as f64, "at least 16 of each");
    }
    if options.fwhm_px.is_some_and(|fwhm| !(0.5..=50.0).contains(&fwhm)) {
        return bad("fwhm_px", options.fwhm_px.unwrap_or(f64::NAN), "0.5 to 50");
    }
    if !(3.0..=1e6).contains(&options.point_sigmas) {
        return bad("point_sigmas", options.point_sigmas, "3 or above");
    }
    if !(5.0..=1e6).contains(&options.streak_sigmas) {
        return bad("streak_sigmas", options.streak_sigmas, "5 or above");
    }
    if !(8.0..=1e6).contains(&options.shortest_px) {
        return bad("shortest_px", options.shortest_px, "8 or above");
    }
    if options.aperture_px.is_some_and(|radius| !(0.5..=500.0).contains(&radius)) {
        return bad("aperture_px", options.aperture_px.unwrap_or(f64::NAN), "0.5 to 500");
    }
    if !pixels.iter().any(|v| v.is_finite()) {
        return Err(PhotometryError::NoNumber { pixels: pixels.len() });
    }
    Ok(())
}

/// The values of a frame with no infinities, in units in which the noise is not below whole counts.
struct Values {
    /// The values of all pixels; of a colour camera the green light.
    all: Vec<f32>,
    /// The green pixels of a colour camera, the others NaN: their scatter is that of independent pixels.
    own: Option<Vec<f32>>,
    /// A unit of the values, ADU.
    unit: f64,
}

impl Values {
    fn of(pixels: ArrayView2<'_, f32>, bayer: Option<Bayer>) -> Self {
        let finite = pixels.mapv(|v| if v.is_finite() { v } else { f32::NAN });
        let (all, own) = match bayer {
            None => (finite, None),
            Some(pattern) => {
                let greens = mosaic::greens(finite.view(), pattern);
                (mosaic::between(greens.view()), Some(greens))
            }
        };
        let mut all: Vec<f32> = all.iter().copied().collect();
        let mut own: Option<Vec<f32>> = own.map(|own| own.iter().copied().collect());
        // Scatter of neighbours (of one colour): of floating frames between 0 and 1 it is far below 1.
        let apart = if own.is_some() { 2 } else { 1 };
        let measured = own.as_ref().unwrap_or(&all);
        let pairs = measured.windows(apart + 1).step_by(101).map(|w| f64::from(w[apart] - w[0]));
        let pairs: Vec<f64> = pairs.filter(|d| d.is_finite()).map(f64::abs).collect();
        let noise = SIGMA_PER_MAD * median(pairs).unwrap_or(0.0) / std::f64::consts::SQRT_2;
        if noise <= 0.0 || noise >= 0.5 {
            return Self { all, own, unit: 1.0 };
        }
        let scale = 100.0 / noise;
        for value in all.iter_mut().chain(own.iter_mut().flatten()) {
            *value = (f64::from(*value) * scale) as f32;
        }
        Self { all, own, unit: 1.0 / scale }
    }
}

/// Curvatures of the logarithm of a summit's 3 × 3 pixels: the strongest and the weakest, as variances of a normal profile, px²; `None` where a pixel is not above 0.
fn variances(values: &[f32], [width, height]: [usize; 2], pixel: usize) -> Option<[f64; 2]> {
    let (x, y) = (pixel % width, pixel / width);
    if x == 0 || y == 0 || x + 1 >= width || y + 1 >= height {
        return None;
    }
    let log = |dx: isize, dy: isize| {
        let value = values[(y.wrapping_add_signed(dy)) * width + x.wrapping_add_signed(dx)];
        (value > 0.0).then(|| f64::from(value).ln())
    };
    let middle = log(0, 0)?;
    let xx = log(1, 0)? + log(-1, 0)? - 2.0 * middle;
    let yy = log(0, 1)? + log(0, -1)? - 2.0 * middle;
    let xy = 0.25 * (log(1, 1)? + log(-1, -1)? - log(1, -1)? - log(-1, 1)?);
    let (mean, half) = (0.5 * (xx + yy), (0.25 * (xx - yy).powi(2) + xy * xy).sqrt());
    // The strongest curvature is the most negative.
    let variance = |curvature: f64| if curvature < 0.0 { -1.0 / curvature } else { f64::INFINITY };
    Some([variance(mean - half), variance(mean + half)])
}

/// Whether a pixel is the highest of its neighbourhood.
fn is_summit(values: &[f32], [width, height]: [usize; 2], pixel: usize) -> bool {
    let (x, y) = (pixel % width, pixel / width);
    let columns = x.saturating_sub(1)..(x + 2).min(width);
    (y.saturating_sub(1)..(y + 2).min(height)).all(|row| {
        columns.clone().all(|column| {
            let other = row * width + column;
            other == pixel
                || values[other] < values[pixel]
                || values[other] == values[pixel] && other > pixel
        })
    })
}

/// Standard deviation of a point's profile across its narrow side, px, and the points that it was taken from.
fn width(above: &[f32], size: [usize; 2], raw: &[f32], full: f32) -> (f64, usize) {
    const BRIGHT: f32 = 15.0;
    const FEW: usize = 3;
    let mut widths: Vec<(f32, f64)> = super::image::above(above, BRIGHT)
        .filter(|&pixel| raw[pixel] < 0.8 * full && is_summit(above, size, pixel))
        .filter_map(|pixel| {
            let variance = variances(above, size, pixel)?[0];
            let sigma = variance.sqrt();
            (0.45..12.0).contains(&sigma).then_some((above[pixel], sigma))
        })
        .collect();
    // The brightest have the least noise; many are enough.
    widths.sort_by(|a, b| b.0.total_cmp(&a.0));
    widths.truncate(300);
    if widths.len() < FEW {
        return (FWHM_PX / FWHM_PER_SIGMA, 0);
    }
    let middle = median(widths.iter().map(|(_, sigma)| *sigma)).unwrap_or(FWHM_PX / FWHM_PER_SIGMA);
    (middle, widths.len())
}

/// A summit of the smoothed frame.
#[derive(Debug, Clone, Copy)]
struct Summit {
    place: [f64; 2],
    height: f64,
    /// Variances of the smoothed profile along its narrow and its wide axis, px².
    variances: Option<[f64; 2]>,
}

fn summits(prepared: &Prepared, threshold: f64) -> Vec<Summit> {
    let Prepared { size, smooth, .. } = prepared;
    super::image::above(smooth, threshold as f32)
        .filter(|&pixel| is_summit(smooth, *size, pixel))
        .map(|pixel| {
            let (x, y) = (pixel % size[0], pixel / size[0]);
            // Parabola of the logarithm: exact of a normal profile.
            let vertex = |at: usize, last: usize, step: usize| {
                let log = |p: usize| f64::from(smooth[p].max(0.1)).ln();
                if at == 0 || at == last {
                    return at as f64;
                }
                let [a, b, c] = [log(pixel - step), log(pixel), log(pixel + step)];
                let bend = a + c - 2.0 * b;
                let shift = if bend < 0.0 { 0.5 * (a - c) / bend } else { 0.0 };
                at as f64 + shift.clamp(-0.5, 0.5)
            };
            Summit {
                place: [vertex(x, size[0] - 1, 1), vertex(y, size[1] - 1, size[0])],
                height: f64::from(smooth[pixel]),
                variances: variances(smooth, *size, pixel),
            }
        })
        .collect()
}

/// Masks what is round like a point, out to where it is lost in the noise; says which summits are. What is long stays for the search of streaks.
fn mask_stars(prepared: &mut Prepared, summits: &[Summit]) -> Vec<bool> {
    // Of the smoothed frame: twice that of a point.
    let variance = 2.0 * prepared.sigma_px * prepared.sigma_px;
    let [width, height] = prepared.size;
    let mut stars = Vec::with_capacity(summits.len());
    for summit in summits {
        // Noise bends the crest of a streak too; a star bends it as much in both directions.
        let noise = 1.5 / summit.height;
        let is_round = match summit.variances {
            Some([_, wide]) => variance / wide > 0.45 + noise,
            None => false,
        };
        let is_star = is_round && summit.height > 7.0
            || summit.height > 40.0 && is_compact(prepared, summit, variance);
        stars.push(is_star);
        if !is_star {
            continue;
        }
        let reach = (2.0 * variance * (summit.height / 0.7).ln()).sqrt().max(1.5 * variance.sqrt());
        let [x, y] = summit.place;
        let columns = (x - reach).max(0.0) as usize..((x + reach) as usize + 2).min(width);
        for row in (y - reach).max(0.0) as usize..((y + reach) as usize + 2).min(height) {
            for column in columns.clone() {
                if (column as f64 - x).hypot(row as f64 - y) <= reach {
                    prepared.masked[row * width + column] = true;
                }
            }
        }
    }
    stars
}

/// Whether the light around a bright summit with a flat top (saturated) falls off on all sides at the distance of a few widths.
fn is_compact(prepared: &Prepared, summit: &Summit, variance: f64) -> bool {
    let reach = 5.0 * variance.sqrt();
    (0..16).all(|i| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / 16.0).sin_cos();
        let at = [summit.place[0] + reach * cos, summit.place[1] + reach * sin];
        prepared.smooth_at(at).is_none_or(|(value, _)| value < 0.1 * summit.height)
    })
}

impl Prepared {
    /// The smoothed frame between pixels, and whether the nearest pixel is masked; `None` off the frame.
    #[inline]
    fn smooth_at(&self, [x, y]: [f64; 2]) -> Option<(f64, bool)> {
        let [width, height] = self.size;
        if !(x >= 0.0 && y >= 0.0 && x < (width - 1) as f64 && y < (height - 1) as f64) {
            return None;
        }
        let (column, row) = (x as usize, y as usize);
        let (u, v) = (x - column as f64, y - row as f64);
        let at = row * width + column;
        let upper = &self.smooth[at..at + 2];
        let lower = &self.smooth[at + width..at + width + 2];
        let between = |line: &[f32]| (1.0 - u) * f64::from(line[0]) + u * f64::from(line[1]);
        let nearest = at + usize::from(v >= 0.5) * width + usize::from(u >= 0.5);
        Some(((1.0 - v) * between(upper) + v * between(lower), self.masked[nearest]))
    }

    /// Whether the nearest pixel is masked; what is off the frame is.
    fn is_masked(&self, [x, y]: [f64; 2]) -> bool {
        let [width, height] = self.size;
        let (column, row) = (x.round(), y.round());
        if !(column >= 0.0 && row >= 0.0 && column < width as f64 && row < height as f64) {
            return true;
        }
        self.masked[row as usize * width + column as usize]
    }
}

fn measured(
    fit: &Fitted,
    size: [usize; 2],
    options: &FieldOptions,
    noise_at: &dyn Fn(f64, f64) -> f64,
) -> Streak {
    let [a, b] = fit.ends;
    let steps = 9;
    let noise = median((0..=steps).map(|i| {
        let t = f64::from(i) / f64::from(steps);
        noise_at(a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]))
    }))
    .unwrap_or(f64::NAN);
    let flux_adu = fit.flux * noise;
    let sky = fit.sigma * noise;
    let own = options.gain_e_per_adu.map_or(0.0, |gain| flux_adu.max(0.0) / gain);
    let length_px = (b[0] - a[0]).hypot(b[1] - a[1]);
    let mut angle_deg = (b[1] - a[1]).atan2(b[0] - a[0]).to_degrees();
    if angle_deg > 90.0 {
        angle_deg -= 180.0;
    } else if angle_deg <= -90.0 {
        angle_deg += 180.0;
    }
    let margin = 2.0 * fit.sigma_px + 1.0;
    let is_cut = fit.ends.iter().any(|end| {
        (0..2).any(|axis| end[axis] < margin || end[axis] > size[axis] as f64 - 1.0 - margin)
    });
    Streak {
        ends_px: fit.ends.map(DVec2::from),
        length_px,
        angle_deg,
        flux_adu,
        sigma_adu: (sky * sky + own).sqrt(),
        significance: fit.flux / fit.sigma,
        fwhm_px: FWHM_PER_SIGMA * fit.sigma_px,
        masked: fit.masked,
        is_cut,
        is_end_hidden: fit.is_end_hidden,
        is_star_trail: false,
        is_saturated: fit.is_saturated,
    }
}

/// Marks the streaks that share length and direction with at least three others, and are the majority of the long ones: trailed stars. Gives their median length and direction.
fn mark_star_trails(streaks: &mut [Streak]) -> Option<StarTrails> {
    const LEAST: usize = 4;
    let alike = |a: &Streak, b: &Streak| {
        let turned = (a.angle_deg - b.angle_deg + 90.0).rem_euclid(180.0) - 90.0;
        let reach = (0.15 * a.length_px).max(4.0);
        (a.length_px - b.length_px).abs() < reach
            && turned.abs() < (120.0 / a.length_px).clamp(2.0, 8.0)
    };
    let whole: Vec<usize> = (0..streaks.len()).filter(|&i| !streaks[i].is_cut).collect();
    let best = whole.iter().copied().max_by_key(|&i| {
        (whole.iter().filter(|&&j| alike(&streaks[i], &streaks[j])).count(), usize::MAX - i)
    })?;
    let model = streaks[best];
    let of_it: Vec<usize> = whole.iter().copied().filter(|&j| alike(&model, &streaks[j])).collect();
    if of_it.len() < LEAST || 2 * of_it.len() <= whole.len() {
        return None;
    }
    let length = median(of_it.iter().map(|&j| streaks[j].length_px))?;
    for streak in streaks.iter_mut() {
        let turned = (model.angle_deg - streak.angle_deg + 90.0).rem_euclid(180.0) - 90.0;
        let cut = streak.is_cut && streak.length_px < 1.1 * length;
        streak.is_star_trail = alike(&model, streak) || cut && turned.abs() < 8.0;
    }
    Some(StarTrails { length_px: length, angle_deg: model.angle_deg })
}

/// The light of a point through an aperture, less the median of an annulus.
#[expect(clippy::too_many_arguments, reason = "one place, one call")]
fn point(
    raw: &[f32],
    [width, height]: [usize; 2],
    place: [f64; 2],
    significance: f64,
    radius: f64,
    [unit, noise]: [f64; 2],
    gain: Option<f64>,
    full: f32,
) -> Option<PointSource> {
    let [inner, outer] = ring(radius);
    let aperture = Aperture::disc(place.into(), radius);
    let range = |at: f64, n: usize| {
        (at - outer).floor().max(0.0) as usize..((at + outer).ceil() as usize + 1).min(n)
    };
    let (mut sum, mut area, mut is_saturated) = (0.0, 0.0, false);
    let mut ring = Vec::new();
    for row in range(place[1], height) {
        for column in range(place[0], width) {
            let value = raw[row * width + column];
            let distance = (column as f64 - place[0]).hypot(row as f64 - place[1]);
            if distance >= inner && distance <= outer && value.is_finite() {
                ring.push(f64::from(value));
            }
            let part = if distance < radius + 1.0 {
                aperture.overlap(column as f64, row as f64)
            } else {
                0.0
            };
            if part > 0.0 && value.is_finite() {
                sum += part * f64::from(value);
                area += part;
                is_saturated |= value >= full;
            }
        }
    }
    let whole = std::f64::consts::PI * radius * radius;
    let background = clipped(&mut ring)?;
    let flux = (sum - area * background) * unit;
    let level = noise * noise * area * (1.0 + 1.57 * area / ring.len().max(1) as f64);
    let own = gain.map_or(0.0, |gain| flux.max(0.0) / gain);
    Some(PointSource {
        place_px: place.into(),
        flux_adu: flux,
        sigma_adu: (level + own).sqrt(),
        significance,
        is_saturated,
        is_cut: area < 0.999 * whole,
    })
}

/// Median of what lies within 3 standard deviations of it.
fn clipped(values: &mut Vec<f64>) -> Option<f64> {
    for _ in 0..3 {
        let middle = median(values.iter().copied())?;
        let spread = SIGMA_PER_MAD * median(values.iter().map(|v| (v - middle).abs()))?;
        let before = values.len();
        values.retain(|v| (v - middle).abs() <= 3.0 * spread.max(1e-12));
        if values.len() == before || values.len() < 8 {
            return Some(middle);
        }
    }
    median(values.iter().copied())
}
