//! The area of a frame that light reaches: without overscan, masked strips, and lines that hold no number.

use std::ops::Range;
use sunglint_numerics::order::{SIGMA_PER_MAD, median};

/// Least fall of the level at the border of the exposed area, standard deviations of a pixel.
const STEP: f64 = 1.5;
/// Lines on each side of a step whose middles are compared: more than a trail along them covers.
const LINES: usize = 8;
/// Fewest lines of a strip that is told from a faulty line.
const FEWEST: usize = 3;
/// Part of the frame to which strips reach at most.
const LARGEST: usize = 6;
/// Pixels of a line that are looked at.
const MOST_PIXELS: usize = 512;

/// Columns and rows that light reaches.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Exposed {
    columns: Range<usize>,
    rows: Range<usize>,
}

impl Exposed {
    /// Finds strips along the borders whose level is below that of what lies next to them by a step: overscan, and what a frame was filled up with.
    pub fn of(values: &[f32], size: [usize; 2]) -> Self {
        let [width, height] = size;
        let pairs = values.windows(2).step_by(101).map(|w| f64::from((w[1] - w[0]).abs()));
        let noise = median(pairs.filter(|d| d.is_finite())).unwrap_or(0.0);
        let least = STEP * SIGMA_PER_MAD * noise / std::f64::consts::SQRT_2;
        let column = |x: usize| {
            let step = height.div_ceil(MOST_PIXELS);
            median(
                (0..height).step_by(step).map(|y| f64::from(values[y * width + x])).filter(finite),
            )
        };
        let row = |y: usize| {
            let line = values[y * width..][..width].iter().step_by(width.div_ceil(MOST_PIXELS));
            median(line.map(|v| f64::from(*v)).filter(finite))
        };
        let range = |n: usize, of: &dyn Fn(usize) -> Option<f64>| {
            let first = strip(n, least, &of);
            let last = strip(n, least, &|i| of(n - 1 - i));
            first..n - last
        };
        Self { columns: range(width, &column), rows: range(height, &row) }
    }

    /// Pixels outside become NaN.
    pub fn take_out_others(&self, values: &mut [f32], [width, _]: [usize; 2]) {
        for (y, line) in values.chunks_exact_mut(width.max(1)).enumerate() {
            if self.rows.contains(&y) {
                line[..self.columns.start].fill(f32::NAN);
                line[self.columns.end..].fill(f32::NAN);
            } else {
                line.fill(f32::NAN);
            }
        }
    }

    /// A remark for the reader; `None` where all of the frame is exposed.
    pub fn note(&self, [width, height]: [usize; 2]) -> Option<String> {
        let whole = self.columns == (0..width) && self.rows == (0..height);
        (!whole).then(|| {
            format!(
                "only columns {} to {} and rows {} to {} are searched: the strips beyond are darker by a step, as an overscan is, or hold no number",
                self.columns.start,
                self.columns.end - 1,
                self.rows.start,
                self.rows.end - 1
            )
        })
    }

    /// Whether a segment runs along the border, within `reach` pixels of it.
    pub(crate) fn is_border(&self, ends: [[f64; 2]; 2], reach: f64) -> bool {
        // A pixel is what the ends of a faint segment are known to.
        const PARALLEL_PX: f64 = 1.0;
        [&self.columns, &self.rows].into_iter().enumerate().any(|(axis, range)| {
            let [a, b] = ends.map(|end| end[axis]);
            let (low, high) = (range.start as f64, range.end as f64 - 1.0);
            let is_near = |v: f64| v < low + reach || v > high - reach;
            let length = (ends[1][1 - axis] - ends[0][1 - axis]).abs();
            // An edge of a sensor is straight and along it, but the fit of a broad one turns a little.
            (a - b).abs() < PARALLEL_PX.max(0.01 * length) && is_near(a) && is_near(b)
        })
    }
}

fn finite(value: &f64) -> bool {
    value.is_finite()
}

/// Lines of a strip at the beginning of `n` lines with these middles.
fn strip(n: usize, least: f64, of: &dyn Fn(usize) -> Option<f64>) -> usize {
    let looked = n / LARGEST;
    let lines: Vec<f64> = (0..(looked + LINES).min(n)).map(|i| of(i).unwrap_or(f64::NAN)).collect();
    let empty = lines.iter().take(looked).take_while(|v| v.is_nan()).count();
    if least <= 0.0 {
        return empty;
    }
    let level = |range: Range<usize>| median(lines[range].iter().copied().filter(finite));
    let is_step = |i: usize| {
        let outside = level(i.saturating_sub(LINES).max(empty)..i)?;
        let inside = level(i..(i + LINES).min(lines.len()))?;
        // A gradient rises evenly; the border is a matter of one line, or of two where it cuts pixels.
        let here = lines[(i + 1).min(lines.len() - 1)] - lines[i - 1];
        Some(inside - outside > least && here > 0.7 * (inside - outside))
    };
    (empty + FEWEST..looked).rev().find(|&i| is_step(i) == Some(true)).unwrap_or(empty)
}
