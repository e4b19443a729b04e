//! Colour cameras: the light of the green pixels, and frames that look like a colour camera's.

use ndarray::{Array2, ArrayView2};
use sunglint_formats::frame::Bayer;
use sunglint_numerics::order::{SIGMA_PER_MAD, median};

/// Standard deviation of sums over many pixels of the green light between the green pixels, over what as many green pixels of their own would have: each counts twice.
pub(super) const NOISE: f32 = std::f32::consts::SQRT_2;

/// Whether a pixel sees green.
fn is_green(pattern: Bayer, row: usize, column: usize) -> bool {
    let is_odd = (row + column) % 2 == 1;
    match pattern {
        Bayer::Rggb | Bayer::Bggr => is_odd,
        Bayer::Grbg | Bayer::Gbrg => !is_odd,
    }
}

/// The green pixels alone, all others NaN.
pub(super) fn greens(pixels: ArrayView2<'_, f32>, pattern: Bayer) -> Array2<f32> {
    Array2::from_shape_fn(pixels.dim(), |(row, column)| {
        if is_green(pattern, row, column) { pixels[[row, column]] } else { f32::NAN }
    })
}

/// The green light of a colour camera's frame: its green pixels, and between them the mean of the green ones beside; NaN where fewer than two of those are there.
///
/// The pixels are not independent of one another: a sum over many has twice the variance that as many green pixels would have.
pub fn green_light(pixels: ArrayView2<'_, f32>, pattern: Bayer) -> Array2<f32> {
    between(greens(pixels, pattern).view())
}

/// Fills the gaps of a checkerboard.
pub(super) fn between(greens: ArrayView2<'_, f32>) -> Array2<f32> {
    let (rows, columns) = greens.dim();
    let mut filled = greens.to_owned();
    for row in 0..rows {
        for column in 0..columns {
            if !greens[[row, column]].is_nan() {
                continue;
            }
            let beside = [
                (row.wrapping_sub(1), column),
                (row + 1, column),
                (row, column.wrapping_sub(1)),
                (row, column + 1),
            ];
            let (mut sum, mut n) = (0.0, 0.0);
            for value in beside.into_iter().filter_map(|at| greens.get(at)) {
                if value.is_finite() {
                    sum += value;
                    n += 1.0;
                }
            }
            if n >= 2.0 {
                filled[[row, column]] = sum / n;
            }
        }
    }
    filled
}

/// Levels of the 2 × 2 pixels of a frame that looks like a colour camera's: two that lie across a corner are alike, and the others are not like them. `None` of any other frame, and of a
/// colour camera's whose sky is too dark to tell.
pub fn looks_like_mosaic(pixels: ArrayView2<'_, f32>) -> Option<[f64; 4]> {
    /// Steps between pixels of one colour that are looked at.
    const STRIDE: usize = 7;
    let (rows, columns) = pixels.dim();
    let phase = |p: usize| -> Vec<f64> {
        let width = columns.saturating_sub(p % 2).div_ceil(2).max(1);
        let count = rows.saturating_sub(p / 2).div_ceil(2) * width;
        (0..count)
            .step_by(STRIDE)
            .filter_map(|i| pixels.get((2 * (i / width) + p / 2, 2 * (i % width) + p % 2)))
            .map(|v| f64::from(*v))
            .filter(|v| v.is_finite())
            .collect()
    };
    let mut levels = [0.0; 4];
    let mut noise: f64 = 0.0;
    for (p, level) in levels.iter_mut().enumerate() {
        let values = phase(p);
        if values.len() < 200 {
            return None;
        }
        *level = median(values.iter().copied())?;
        noise = noise.max(SIGMA_PER_MAD * median(values.iter().map(|v| (v - *level).abs()))?);
    }
    let alike = |a: usize, b: usize| (levels[a] - levels[b]).abs();
    let pairs = [[0, 3, 1, 2], [1, 2, 0, 3]];
    let is_one = pairs.iter().any(|[a, b, c, d]| {
        let green = 0.5 * (levels[*a] + levels[*b]);
        let away = [levels[*c] - green, levels[*d] - green].map(f64::abs);
        let least = away[0].min(away[1]);
        // Offsets of rows or columns make neighbours alike, never corners.
        alike(*a, *b) < 0.2 * least && least > 0.5 * noise
    });
    is_one.then_some(levels)
}
