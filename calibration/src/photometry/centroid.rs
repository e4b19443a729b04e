//! Where a source is to a fraction of a pixel, with the covariance of that, and how wide it is.

use super::look::Light;
use super::overlap::Aperture;
use glam::DVec2;
use sunglint_numerics::measured::Interval;

/// A source's place and width.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Centroid {
    /// Column and row, px.
    pub place_px: DVec2,
    /// Variances of column and row and their covariance, px², from the noise of the pixels.
    pub covariance_px2: [f64; 3],
    /// Full widths at half maximum along its narrow and its wide axis, px, without the pixel's own width; infinite where it is
    /// wider than the window can tell.
    pub fwhm_px: Interval,
}

impl Centroid {
    /// Returns the width of a point: the mean of both axes (geometric); of a trail, the width across it.
    pub fn point_fwhm_px(&self) -> f64 {
        let [narrow, wide] = self.fwhm_px.to_array();
        if wide.is_finite() { (narrow * wide).sqrt() } else { narrow }
    }
}

/// √(8 ln 2): full width at half maximum over standard deviation of a normal profile.
pub(crate) const FWHM_PER_SIGMA: f64 = 2.354_820_045_030_949;

/// Sums of a source's light under a normal window.
#[derive(Default)]
struct Sums {
    light: f64,
    first: [f64; 2],
    /// xx, yy, xy.
    second: [f64; 3],
    /// Covariance of `first` from the pixels' noise: xx, yy, xy.
    noise: [f64; 3],
}

/// The place where the light under a normal window is balanced, from `start` on: Σ w (p − x) v = 0 (a Gaussian-weighted centroid), found by
/// Newton steps. Its covariance is J⁻¹ S J⁻ᵀ, S that of the sum and J its derivative.
///
/// In a mosaic the kernel is averaged over the four 2 × 2 squares that a pixel belongs to. Each square holds all colours, so that the
/// grid of one colour does not draw the centroid, and no colour is interpolated. A masked pixel has the light of its mirror image.
/// `None` where there is no light, or the balance lies more than two window widths away.
pub(crate) fn windowed(
    light: &Light<'_>,
    start: [f64; 2],
    window_sigma_px: f64,
) -> Option<Centroid> {
    const STEPS: usize = 40;
    let s2 = window_sigma_px * window_sigma_px;
    let mut place = start;
    let mut last = None;
    for _ in 0..STEPS {
        let sums = add_up(light, place, window_sigma_px);
        if sums.light.is_nan() || sums.light <= 0.0 {
            return None;
        }
        let jacobian = [
            sums.light - sums.second[0] / s2,
            sums.light - sums.second[1] / s2,
            -sums.second[2] / s2,
        ];
        let inverse = inverse(jacobian)
            .filter(|_| jacobian[0] > 0.1 * sums.light && jacobian[1] > 0.1 * sums.light);
        let step = match inverse {
            Some(i) => times(i, sums.first),
            None => sums.first.map(|g| 2.0 * g / sums.light),
        };
        // Never further than half a window at once.
        let length = step[0].hypot(step[1]);
        let scale = (0.5 * window_sigma_px / length).min(1.0);
        place = [place[0] + scale * step[0], place[1] + scale * step[1]];
        if (place[0] - start[0]).hypot(place[1] - start[1]) > 2.0 * window_sigma_px {
            return None;
        }
        last = Some((sums, inverse));
        if length < 1e-5 {
            break;
        }
    }
    let (sums, inverse) = last?;
    let covariance_px2 = match inverse {
        Some(i) => sandwich(i, sums.noise),
        None => sums.noise.map(|n| 4.0 * n / (sums.light * sums.light)),
    };
    let fwhm_px = widths(light, &sums, s2).into();
    Some(Centroid { place_px: place.into(), covariance_px2, fwhm_px })
}

/// Widths without window and pixel: a normal source of variance σ² has 1/(1/σ² + 1/s²) under the window.
fn widths(light: &Light<'_>, sums: &Sums, s2: f64) -> [f64; 2] {
    let [xx, yy, xy] = sums.second.map(|m| m / sums.light);
    let (mean, half) = (0.5 * (xx + yy), (0.25 * (xx - yy).powi(2) + xy * xy).sqrt());
    // A pixel's own variance, and that of the four corners of the squares of a mosaic.
    let own = 1.0 / 12.0 + if light.mosaic { 0.25 } else { 0.0 };
    [mean - half, mean + half].map(|seen| {
        if seen >= 0.98 * s2 {
            return f64::INFINITY;
        }
        let variance = if seen > 0.0 { 1.0 / (1.0 / seen - 1.0 / s2) - own } else { 0.0 };
        variance.max(0.0).sqrt() * FWHM_PER_SIGMA
    })
}

/// Window and its first two moments at a distance, averaged over both squares of a mosaic.
fn kernel(distance: f64, s2: f64, mosaic: bool) -> [f64; 3] {
    let at = |d: f64| {
        let w = (-0.5 * d * d / s2).exp();
        [w, w * d, w * d * d]
    };
    if !mosaic {
        return at(distance);
    }
    let (low, high) = (at(distance - 0.5), at(distance + 0.5));
    [0, 1, 2].map(|i| 0.5 * (low[i] + high[i]))
}

/// How far the window reaches, in its standard deviations.
const REACH: f64 = 4.0;

fn add_up(light: &Light<'_>, place: [f64; 2], window_sigma_px: f64) -> Sums {
    let (s2, reach) = (window_sigma_px * window_sigma_px, REACH * window_sigma_px);
    let mut sums = Sums::default();
    let origin = light.window.origin;
    let range = |axis: usize| {
        let from = (place[axis] - reach - origin[axis] as f64).ceil().max(0.0) as usize;
        let to = (place[axis] + reach - origin[axis] as f64).floor().max(-1.0) + 1.0;
        from..(to as usize).min(light.window.size[axis])
    };
    let (columns, rows) = (range(0), range(1));
    let across: Vec<[f64; 3]> = columns
        .clone()
        .map(|i| kernel((origin[0] + i) as f64 - place[0], s2, light.mosaic))
        .collect();
    for row in rows {
        let down = kernel((origin[1] + row) as f64 - place[1], s2, light.mosaic);
        for (column, x_kernel) in columns.clone().zip(&across) {
            let value = f64::from(light.values[row * light.window.size[0] + column]);
            if !value.is_nan() {
                let sigma = light.pixel_sigma(origin[0] + column, origin[1] + row);
                sums.add(value, sigma * sigma + value.max(0.0) * light.adu_per_e, x_kernel, &down);
            }
        }
    }
    for [x, y] in light.masked() {
        if (x - place[0]).abs() <= reach
            && (y - place[1]).abs() <= reach
            && let Some(value) = light.mirrored([x, y], place)
        {
            let [x_kernel, down] =
                [x - place[0], y - place[1]].map(|d| kernel(d, s2, light.mosaic));
            let sigma = light.pixel_sigma(x as usize, y as usize);
            sums.add(value, sigma * sigma + value.max(0.0) * light.adu_per_e, &x_kernel, &down);
        }
    }
    sums
}

impl Sums {
    fn add(&mut self, value: f64, variance: f64, across: &[f64; 3], down: &[f64; 3]) {
        let (gx, gy) = (across[1] * down[0], across[0] * down[1]);
        self.light += value * across[0] * down[0];
        self.first[0] += value * gx;
        self.first[1] += value * gy;
        self.second[0] += value * across[2] * down[0];
        self.second[1] += value * across[0] * down[2];
        self.second[2] += value * across[1] * down[1];
        self.noise[0] += variance * gx * gx;
        self.noise[1] += variance * gy * gy;
        self.noise[2] += variance * gx * gy;
    }
}

/// The centre of the light within a pill, from its middle on; for a target that is drawn out.
pub(crate) fn balanced(light: &Light<'_>, start: &Aperture, fwhm_px: f64) -> Option<Centroid> {
    const STEPS: usize = 10;
    let mut aperture = *start;
    let mut covariance_px2 = [0.0; 3];
    for _ in 0..STEPS {
        let (mut sum, mut first, mut noise) = (0.0, [0.0; 2], [0.0; 3]);
        for (row, line) in light.rows() {
            for (i, &value) in line.iter().enumerate() {
                let column = light.window.origin[0] + i;
                let weight = aperture.overlap(column as f64, row as f64);
                if weight == 0.0 || value.is_nan() {
                    continue;
                }
                let value = f64::from(value);
                let d = [column as f64 - aperture.centre_px[0], row as f64 - aperture.centre_px[1]];
                let sigma = light.pixel_sigma(column, row);
                let variance = weight * weight * (sigma * sigma + value.max(0.0) * light.adu_per_e);
                sum += weight * value;
                first = [first[0] + weight * value * d[0], first[1] + weight * value * d[1]];
                noise[0] += variance * d[0] * d[0];
                noise[1] += variance * d[1] * d[1];
                noise[2] += variance * d[0] * d[1];
            }
        }
        if sum.is_nan() || sum <= 0.0 {
            return None;
        }
        let step = first.map(|f| f / sum);
        covariance_px2 = noise.map(|n| n / (sum * sum));
        aperture.centre_px =
            DVec2::new(aperture.centre_px[0] + step[0], aperture.centre_px[1] + step[1]);
        let moved = [0, 1].map(|axis| aperture.centre_px[axis] - start.centre_px[axis]);
        if moved[0].hypot(moved[1]) > start.radius_px + 0.5 * start.trail_length_px() {
            return None;
        }
        if step[0].hypot(step[1]) < 1e-4 {
            break;
        }
    }
    Some(Centroid {
        place_px: aperture.centre_px,
        covariance_px2,
        fwhm_px: Interval::new(fwhm_px, f64::INFINITY),
    })
}

/// Inverse of a symmetric matrix (xx, yy, xy), where it is positive definite.
fn inverse([xx, yy, xy]: [f64; 3]) -> Option<[f64; 3]> {
    let determinant = xx * yy - xy * xy;
    (xx > 0.0 && determinant > 0.0).then(|| [yy / determinant, xx / determinant, -xy / determinant])
}

fn times([xx, yy, xy]: [f64; 3], [x, y]: [f64; 2]) -> [f64; 2] {
    [xx * x + xy * y, xy * x + yy * y]
}

/// A S A of symmetric matrices.
fn sandwich(a: [f64; 3], s: [f64; 3]) -> [f64; 3] {
    let column = |v: [f64; 2]| times(a, times(s, times(a, v)));
    let (first, second) = (column([1.0, 0.0]), column([0.0, 1.0]));
    [first[0], second[1], 0.5 * (first[1] + second[0])]
}
