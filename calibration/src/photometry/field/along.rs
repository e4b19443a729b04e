//! The light along a streak: its parts in order, for a light curve within one exposure.

use super::{PhotometryError, Streak};
use ndarray::ArrayView2;
use serde::Serialize;
use sunglint_numerics::order::{SIGMA_PER_MAD, median};

/// A part of a streak.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Along {
    /// Middle of the part, as a part of the streak's length from its first end, 0 to 1.
    pub at: f64,
    /// Length of the part as a part of the streak's.
    pub width: f64,
    /// Light, ADU.
    pub flux_adu: f64,
    /// Standard deviation of the light from the scatter of the sky beside it (and its own photons, with a gain), ADU.
    pub sigma_adu: f64,
    /// Part of its pixels that are masked or off the frame.
    pub masked: f64,
}

/// Light of `parts` equal parts of a streak: sums over 1.5 widths at half maximum to either side, less the median of the sky beside.
///
/// The point spread blurs parts shorter than a width into each other, so there are at most as many as the streak has widths.
///
/// # Errors
/// Less than one part; a streak without length.
pub fn along(
    pixels: ArrayView2<'_, f32>,
    streak: &Streak,
    parts: usize,
    gain_e_per_adu: Option<f64>,
) -> Result<Vec<Along>, PhotometryError> {
    let bad = |name, value, expected| Err(PhotometryError::Option { name, value, expected });
    if parts == 0 {
        return bad("parts", 0.0, "1 or more");
    }
    if streak.length_px.is_nan() || streak.length_px <= 1.0 {
        return bad("length_px", streak.length_px, "more than 1");
    }
    let parts = parts.min((streak.length_px / streak.fwhm_px.max(1.0)).floor().max(1.0) as usize);
    let [a, b] = streak.ends_px;
    let unit = [0, 1].map(|i| (b[i] - a[i]) / streak.length_px);
    let half = 1.5 * streak.fwhm_px;
    let [inner, outer] = [half + 1.0, half + 1.0 + (2.0 * streak.fwhm_px).max(5.0)];
    // Sub-pixels, so that a part's edge cuts pixels rightly.
    const SUB: usize = 4;
    let mut sums = vec![(0.0, 0.0, 0.0); parts];
    let mut skies: Vec<Vec<f64>> = vec![Vec::new(); parts];
    let (columns, rows) = (pixels.ncols(), pixels.nrows());
    let range = |axis: usize, n: usize| {
        let (low, high) = (a[axis].min(b[axis]) - outer, a[axis].max(b[axis]) + outer);
        low.floor().max(0.0) as usize..((high.ceil().max(-1.0) + 1.0) as usize).min(n)
    };
    // Light beyond an end belongs to the part at that end.
    let reach = half / streak.length_px;
    for row in range(1, rows) {
        for column in range(0, columns) {
            let place = |dx: f64, dy: f64| {
                let [x, y] = [column as f64 + dx - a[0], row as f64 + dy - a[1]];
                let t = (x * unit[0] + y * unit[1]) / streak.length_px;
                (t, (y * unit[0] - x * unit[1]).abs())
            };
            let value = f64::from(pixels[[row, column]]);
            let (t, across) = place(0.0, 0.0);
            if across > outer + 1.0 || t < -reach - 0.1 || t > 1.0 + reach + 0.1 {
                continue;
            }
            let part = |t: f64| ((t * parts as f64).floor().max(0.0) as usize).min(parts - 1);
            if across >= inner && across <= outer && (0.0..1.0).contains(&t) && value.is_finite() {
                skies[part(t)].push(value);
            }
            if across > half + 1.0 {
                continue;
            }
            for i in 0..SUB * SUB {
                let sub = |i: usize| (i as f64 + 0.5) / SUB as f64 - 0.5;
                let (t, across) = place(sub(i % SUB), sub(i / SUB));
                if across <= half && t >= -reach && t <= 1.0 + reach {
                    let weight = 1.0 / (SUB * SUB) as f64;
                    let sum = &mut sums[part(t)];
                    if value.is_finite() {
                        sum.0 += weight * value;
                        sum.1 += weight;
                    } else {
                        sum.2 += weight;
                    }
                }
            }
        }
    }
    let all: Vec<f64> = skies.iter().flatten().copied().collect();
    let spread = |values: &[f64], level: f64| {
        median(values.iter().map(|v| (v - level).abs())).map(|mad| SIGMA_PER_MAD * mad)
    };
    let common = median(all.iter().copied()).unwrap_or(f64::NAN);
    let noise = spread(&all, common).unwrap_or(f64::NAN);
    let width = 1.0 / parts as f64;
    Ok(sums
        .into_iter()
        .zip(&skies)
        .enumerate()
        .map(|(i, ((sum, area, missing), sky))| {
            // Few pixels beside: the level of the whole.
            let level = if sky.len() >= 12 {
                median(sky.iter().copied()).unwrap_or(common)
            } else {
                common
            };
            let n = if sky.len() >= 12 { sky.len() } else { all.len() }.max(1) as f64;
            let masked = missing / (area + missing).max(1e-12);
            let kept = (1.0 - masked).max(1e-3);
            let flux = (sum - area * level) / kept;
            let own = gain_e_per_adu.map_or(0.0, |gain| flux.max(0.0) / gain);
            let sky_part = noise * noise * (area + 1.57 * area * area / n) / (kept * kept);
            Along {
                at: (i as f64 + 0.5) * width,
                width,
                flux_adu: flux,
                sigma_adu: (sky_part + own).sqrt(),
                masked,
            }
        })
        .collect())
}
