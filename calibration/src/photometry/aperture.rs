//! The sum over an aperture of one plane, and what is known of its error.

use super::background::Background;
use super::centroid::FWHM_PER_SIGMA;
use super::measurement::{Colour, PlaneMeasurement, SigmaParts};
use super::overlap::Aperture;
use super::window::{Plane, Window};
use sunglint_radiometry::light_curve::Flags;

/// Inputs of the sum over a plane besides its pixels.
#[derive(Clone, Copy)]
pub(crate) struct Summing {
    pub aperture: Aperture,
    /// Full width at half maximum of the target, px.
    pub fwhm_px: f64,
    pub exposure_s: f64,
    pub gain_e_per_adu: f64,
    pub max_masked_light: f64,
    /// The aperture leaves the frame.
    pub cut: bool,
}

/// Sums over an aperture's pixels.
#[derive(Debug, Default)]
struct Sums {
    light_adu: f64,
    /// Σw of the summed pixels.
    area_px2: f64,
    /// Σw² of them.
    square_px4: f64,
    /// Σw² (value − background).
    shot_adu: f64,
    masked_px2: f64,
    saturated: usize,
}

/// The rate of a plane.
pub(crate) fn measure(
    window: &Window,
    plane: Plane,
    background: Option<&Background>,
    summing: &Summing,
) -> PlaneMeasurement {
    let Some(background) = background else { return empty(plane.colour, Flags::EDGE) };
    let sums = add_up(window, plane, background.level_adu, summing);
    let masked_light = match sums.masked_px2 > 0.0 {
        true => light_on_masked(window, plane, summing),
        false => 0.0,
    };
    let mut flags = Flags::empty();
    flags.set(Flags::MASKED_PIXELS, sums.masked_px2 > 0.0);
    flags.set(Flags::SATURATED, sums.saturated > 0);
    flags.set(Flags::EDGE, summing.cut);
    let kept = 1.0 - masked_light;
    // A light of nothing but masked pixels is NaN.
    let measured = sums.saturated == 0 && !summing.cut && masked_light <= summing.max_masked_light;
    // ADU of the plane to ADU/s of the whole aperture.
    let scale = plane.factor() / summing.exposure_s / kept;
    let rate = sums.light_adu * scale;
    let sigma = SigmaParts {
        target: (sums.shot_adu.max(0.0) / summing.gain_e_per_adu).sqrt() * scale,
        pixels: sums.square_px4.sqrt() * background.pixel_sigma_adu * scale,
        background: sums.area_px2 * background.level_sigma_adu * scale,
        // A profile other than normal: half of what was made up for.
        masked: 0.5 * masked_light * rate.abs(),
        sampling: sampling(plane.colour, summing) * rate.abs(),
    };
    PlaneMeasurement {
        colour: plane.colour,
        rate_adu_per_s: if measured { rate } else { f64::NAN },
        sigma: if measured { sigma } else { SigmaParts::UNKNOWN },
        flags,
        background_adu: background.level_adu,
        background_sigma_adu: background.level_sigma_adu,
        area_px2: sums.area_px2,
        masked_fraction: sums.masked_px2 / (sums.masked_px2 + sums.area_px2),
        masked_light,
        saturated_pixels: sums.saturated,
    }
}

/// A plane without a rate, for this reason.
pub(crate) fn empty(colour: Colour, flags: Flags) -> PlaneMeasurement {
    PlaneMeasurement {
        colour,
        rate_adu_per_s: f64::NAN,
        sigma: SigmaParts::UNKNOWN,
        flags,
        background_adu: f64::NAN,
        background_sigma_adu: f64::NAN,
        area_px2: 0.0,
        masked_fraction: 0.0,
        masked_light: 0.0,
        saturated_pixels: 0,
    }
}

/// Calls `pixel(column, row, overlap, value)` for the plane's pixels that touch the aperture.
fn each_pixel(
    window: &Window,
    plane: Plane,
    aperture: &Aperture,
    mut pixel: impl FnMut(f64, f64, f64, f32),
) {
    let [half_x, half_y] = aperture.half_box_px(aperture.radius_px + 0.5);
    let [cx, cy] = aperture.centre_px.to_array();
    for (row, line) in window.rows() {
        let y = row as f64;
        if (y - cy).abs() > half_y {
            continue;
        }
        let from = (cx - half_x).ceil().max(window.origin[0] as f64) as usize;
        let Some((mut column, step)) = plane.columns(row, from) else { continue };
        while let Some(&value) = line.get(column - window.origin[0]) {
            let x = column as f64;
            if x - cx > half_x {
                break;
            }
            let overlap = aperture.overlap(x, y);
            if overlap > 0.0 {
                pixel(x, y, overlap, value);
            }
            column += step;
        }
    }
}

fn add_up(window: &Window, plane: Plane, level_adu: f64, summing: &Summing) -> Sums {
    let mut sums = Sums::default();
    each_pixel(window, plane, &summing.aperture, |_, _, overlap, value| {
        if value.is_nan() {
            sums.masked_px2 += overlap;
        } else if value == f32::INFINITY {
            sums.saturated += 1;
        } else {
            let light = overlap * (f64::from(value) - level_adu);
            sums.light_adu += light;
            sums.area_px2 += overlap;
            sums.square_px4 += overlap * overlap;
            sums.shot_adu += overlap * light;
        }
    });
    sums
}

/// Fraction of the light in the plane's part of the aperture that falls on masked pixels, for a normal profile across the trail.
fn light_on_masked(window: &Window, plane: Plane, summing: &Summing) -> f64 {
    let sigma = (summing.fwhm_px / FWHM_PER_SIGMA).hypot(12f64.sqrt().recip());
    let (mut masked, mut all) = (0.0, 0.0);
    each_pixel(window, plane, &summing.aperture, |x, y, overlap, value| {
        let distance = summing.aperture.distance_px(x, y) / sigma;
        let light = overlap * (-0.5 * distance * distance).exp();
        all += light;
        if value.is_nan() {
            masked += light;
        }
    });
    masked / all
}

/// Relative standard deviation of a plane's sum over where in the mosaic a normal point falls, for even odds of all places.
///
/// A sum over every second column is 1 + 2a cos(πx) of the whole, a the transform of point and pixel at half a cycle per pixel,
/// exp(−π²σ²/2)·2/π; red and blue have it in columns and rows, green (every second pixel of each row) has the product alone. A trail
/// averages over it.
fn sampling(colour: Colour, summing: &Summing) -> f64 {
    let sigma = summing.fwhm_px / FWHM_PER_SIGMA;
    let a = std::f64::consts::FRAC_2_PI * (-0.5 * (std::f64::consts::PI * sigma).powi(2)).exp();
    match colour {
        Colour::Mono => 0.0,
        Colour::Green => 2.0 * a * a,
        Colour::Red | Colour::Blue => (4.0 * a * a + 4.0 * a.powi(4)).sqrt(),
    }
}
