//! Lights in a frame, found fast: for a mount that follows, not for photometry.

use ndarray::ArrayView2;

/// Pixels along each side that are added first: the colours of a mosaic, and noise.
const BLOCK: usize = 2;
/// Blocks that are looked at for level and noise, about.
const SAMPLE: usize = 20_000;
/// A light stands out by so many times the noise of a block.
const STANDS_OUT: f64 = 6.0;
/// Share of the four blocks beside the brightest one of a light: what has less is a hot pixel.
const BESIDE: f64 = 0.25;
/// Half the width of the box about a light, px.
const HALF: usize = 7;
/// Lights that are given at most.
const MOST: usize = 30;

/// A light in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Centroid: column and row of the frame, the first pixel's middle is 0.
    pub(crate) at_px: [f64; 2],
    /// Sum of its pixels over the sky, ADU.
    pub flux_adu: f64,
}

/// The lights of a frame, the brightest first, at most thirty.
pub fn lights(pixels: ArrayView2<'_, u16>) -> Vec<Light> {
    let (rows, columns) = pixels.dim();
    let (down, across) = (rows / BLOCK, columns / BLOCK);
    if down < 3 || across < 3 {
        return Vec::new();
    }
    let mut blocks = vec![0_u32; down * across];
    for (row, line) in pixels.outer_iter().enumerate().take(down * BLOCK) {
        let at = row / BLOCK * across;
        for (column, pixel) in line.iter().enumerate().take(across * BLOCK) {
            blocks[at + column / BLOCK] += u32::from(*pixel);
        }
    }
    let step = (blocks.len() / SAMPLE).max(1);
    let mut sample: Vec<u32> = blocks.iter().copied().step_by(step).collect();
    let middle = sample.len() / 2;
    let level = f64::from(*sample.select_nth_unstable(middle).1);
    // From the lower half, which has no stars: the quartile lies 0.674 sigma below the middle.
    let quarter = f64::from(*sample.select_nth_unstable(middle / 2).1);
    let noise = ((level - quarter) / 0.674_5).max(1.0);
    let least = level + STANDS_OUT * noise;
    let mut peaks: Vec<(u32, usize, usize)> = Vec::new();
    for y in 1..down - 1 {
        for x in 1..across - 1 {
            let here = blocks[y * across + x];
            if f64::from(here) < least {
                continue;
            }
            let beside = [(y - 1, x), (y, x - 1), (y, x + 1), (y + 1, x)]
                .map(|(y, x)| blocks[y * across + x]);
            // Of two that are equal the first is the peak.
            let top =
                beside[..2].iter().all(|b| *b < here) && beside[2..].iter().all(|b| *b <= here);
            let around = beside.iter().map(|b| f64::from(*b) - level).sum::<f64>();
            if top && around > BESIDE * (f64::from(here) - level) {
                peaks.push((here, y, x));
            }
        }
    }
    peaks.sort_by(|a, b| b.cmp(a));
    let sky = level / (BLOCK * BLOCK) as f64;
    let least = 1.5 * noise / BLOCK as f64;
    let mut found: Vec<Light> = Vec::new();
    for (_, y, x) in peaks {
        let Some(light) = light(pixels, [x * BLOCK, y * BLOCK], sky, least) else { continue };
        let near = |other: &Light| {
            let [dx, dy] = [0, 1].map(|i| other.at_px[i] - light.at_px[i]);
            dx.hypot(dy) < HALF as f64
        };
        if !found.iter().any(near) {
            found.push(light);
        }
        if found.len() == MOST {
            break;
        }
    }
    found.sort_by(|a, b| b.flux_adu.total_cmp(&a.flux_adu));
    found
}

/// The light about a pixel: its centroid in a box that is set on it twice.
fn light(pixels: ArrayView2<'_, u16>, from: [usize; 2], sky: f64, least: f64) -> Option<Light> {
    let (rows, columns) = pixels.dim();
    let mut at = [from[0] as f64 + 0.5, from[1] as f64 + 0.5];
    let mut flux = 0.0;
    for _ in 0..2 {
        let span = |middle: f64, end: usize| {
            let middle = middle.round().max(0.0) as usize;
            middle.saturating_sub(HALF)..(middle + HALF + 1).min(end)
        };
        let (mut sum, mut x, mut y) = (0.0, 0.0, 0.0);
        for row in span(at[1], rows) {
            for column in span(at[0], columns) {
                let over = f64::from(pixels[[row, column]]) - sky;
                if over > least {
                    sum += over;
                    x += over * column as f64;
                    y += over * row as f64;
                }
            }
        }
        if sum <= 0.0 {
            return None;
        }
        (at, flux) = ([x / sum, y / sum], sum);
    }
    Some(Light { at_px: at, flux_adu: flux })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;

    /// Truth: Gaussian images at known places (synthetic), the noise of a fixed pattern; a centroid is within 0.1 px because the threshold cuts the wings evenly. Hot pixels and a gradient are no lights.
    #[test]
    fn lights_are_found_and_hot_pixels_are_not() {
        let stars = [([30.3, 40.7], 4000.0), ([101.6, 22.2], 900.0), ([60.0, 90.5], 400.0)];
        let mut pixels = Array2::from_shape_fn((121, 141), |(row, column)| {
            let mut value = 300.0 + 0.05 * column as f64;
            value += ((row * 7919 + column * 104_729) % 23) as f64 - 11.0;
            for ([x, y], peak) in stars {
                let (dx, dy) = (column as f64 - x, row as f64 - y);
                value += peak * (-(dx * dx + dy * dy) / (2.0 * 1.8 * 1.8)).exp();
            }
            value as u16
        });
        pixels[[70, 20]] = 30_000;
        pixels[[15, 77]] = 9_000;
        let found = lights(pixels.view());
        assert_eq!(found.len(), stars.len(), "{found:?}");
        for (light, (at, peak)) in found.iter().zip(stars) {
            let off = (light.at_px[0] - at[0]).hypot(light.at_px[1] - at[1]);
            assert!(off < 0.1, "{light:?} {at:?}");
            // 2 pi sigma squared times the peak; the wings below the threshold are lost.
            let whole = 2.0 * std::f64::consts::PI * 1.8 * 1.8 * peak;
            assert!((0.8..1.1).contains(&(light.flux_adu / whole)), "{light:?}");
        }
        assert!(lights(Array2::<u16>::zeros((4, 4)).view()).is_empty());
        assert!(lights(Array2::from_elem((50, 50), 65_535_u16).view()).is_empty());
    }
}
