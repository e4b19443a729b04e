//! Half-flux radius of a frame's stars.
//!
//! The half-flux radius is Σ f r / Σ f over an aperture around the star's centroid, with f the flux above the sky: for a disc out of focus, two thirds of its
//! radius. It grows evenly with the defocus, where widths of fitted profiles break down.

use serde::Serialize;
use sunglint_formats::Frame;

/// Stars that are measured at most, the brightest.
const MOST_STARS: usize = 60;
/// Side of the box that smooths the frame before stars are looked for, px.
const BOX: usize = 5;
/// Height above the smoothed sky from which a pixel belongs to a star, in standard deviations.
const HEIGHT: f64 = 5.0;
/// Fewest pixels of a star above that.
const FEWEST_PX: usize = 9;
/// Least signal to noise of a star's flux.
const LEAST_SNR: f64 = 15.0;
/// A pixel is hot, or was hit by a particle, where it stands out from its neighbours by so many times what the highest of them does. The light of a star that is
/// narrower than 1.1 px would do that, too: such a camera cannot be focused by radii.
const HOT_TIMES: f64 = 8.0;
/// And so many standard deviations above the sky.
const HOT_SIGMA: f64 = 10.0;
/// Least half-flux radius of light, px: light of one pixel alone has next to none.
const LEAST_HFR_PX: f64 = 0.4;
/// Part of the radius by which stars differ that are all in focus: field, guiding.
const SCATTER: f64 = 0.02;

/// Half-flux radius of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Sharpness {
    /// Half-flux radius, px of the frame: weighted mean over the stars.
    pub hfr_px: f64,
    /// Standard uncertainty of it by the light's own noise, px, wider where stars differ by more than 2 % beyond it. What the air does shows in the curve alone.
    pub sigma_px: f64,
    /// Stars that were measured.
    pub stars: usize,
}

#[derive(Debug, Clone, Copy)]
struct Star {
    x: f64,
    y: f64,
    radius: f64,
    flux: f64,
    hfr: f64,
    sigma: f64,
}

/// Median of whole numbers by their histogram.
fn median(counts: &[u32]) -> f64 {
    let total: u64 = counts.iter().map(|&n| u64::from(n)).sum();
    let mut below = 0_u64;
    for (value, &n) in counts.iter().enumerate() {
        below += u64::from(n);
        if 2 * below >= total {
            return value as f64;
        }
    }
    0.0
}

/// Sky of the frame, ADU: its median, and the standard deviation by the median distance from it.
fn sky(frame: &Frame) -> (f64, f64) {
    let mut counts = vec![0_u32; 65_536];
    for &value in &frame.pixels {
        counts[usize::from(value)] += 1;
    }
    let middle = median(&counts);
    let mut off = vec![0_u32; 65_536];
    for (value, &n) in counts.iter().enumerate() {
        off[(value as f64 - middle).abs() as usize] += n;
    }
    // A frame of whole numbers has at least the noise of their steps.
    (middle, (1.4826 * median(&off)).max(0.29))
}

/// The frame without its hot pixels: each gets the median of its neighbours. Behind a mosaic of colours the neighbours of its own colour are two pixels away.
fn without_hot(frame: &Frame, middle: f64, sigma: f64) -> Frame {
    let (rows, columns) = frame.pixels.dim();
    let reach = if frame.bayer.is_some() { 2 } else { 1 };
    let mut clean = frame.clone();
    let mut around = Vec::with_capacity(24);
    for ((r, c), &value) in frame.pixels.indexed_iter() {
        let above = f64::from(value) - middle;
        if above < HOT_SIGMA * sigma {
            continue;
        }
        around.clear();
        for row in r.saturating_sub(reach)..(r + reach + 1).min(rows) {
            for column in c.saturating_sub(reach)..(c + reach + 1).min(columns) {
                if (row, column) != (r, c) {
                    around.push(frame.pixels[(row, column)]);
                }
            }
        }
        around.sort_unstable();
        // Neighbours are noise where there is no light: what they must stand out from is not below it.
        let highest = around.last().map_or(0.0, |&n| f64::from(n) - middle).max(sigma);
        if above > HOT_TIMES * highest {
            clean.pixels[(r, c)] = around[around.len() / 2];
        }
    }
    clean
}

/// Places of the frame's stars: centroid and a radius that holds what is above the sky.
fn find(frame: &Frame, middle: f64, sigma: f64) -> Vec<(f64, f64, f64)> {
    let (rows, columns) = frame.pixels.dim();
    if rows <= 2 * BOX || columns <= 2 * BOX {
        return Vec::new();
    }
    // Sums from the corner, for boxes of any size.
    let mut sums = vec![0.0; (rows + 1) * (columns + 1)];
    for r in 0..rows {
        let mut row = 0.0;
        for c in 0..columns {
            row += f64::from(frame.pixels[(r, c)]) - middle;
            sums[(r + 1) * (columns + 1) + c + 1] = sums[r * (columns + 1) + c + 1] + row;
        }
    }
    let half = BOX / 2;
    let smooth = |r: usize, c: usize| {
        let (r0, r1) = (r.saturating_sub(half), (r + half + 1).min(rows));
        let (c0, c1) = (c.saturating_sub(half), (c + half + 1).min(columns));
        let at = |r: usize, c: usize| sums[r * (columns + 1) + c];
        (at(r1, c1) - at(r0, c1) - at(r1, c0) + at(r0, c0)) / ((r1 - r0) * (c1 - c0)) as f64
    };
    let limit = HEIGHT * sigma / BOX as f64;
    let mut seen = vec![false; rows * columns];
    let mut found = Vec::new();
    let mut open = Vec::new();
    for start in 0..rows * columns {
        if seen[start] || smooth(start / columns, start % columns) < limit {
            continue;
        }
        seen[start] = true;
        open.push(start);
        let (mut n, mut weight, mut x, mut y) = (0_usize, 0.0, 0.0, 0.0);
        let (mut lowest, mut highest) = ([usize::MAX; 2], [0; 2]);
        while let Some(at) = open.pop() {
            let (r, c) = (at / columns, at % columns);
            let value = smooth(r, c);
            n += 1;
            weight += value;
            (x, y) = (x + value * c as f64, y + value * r as f64);
            (lowest[0], lowest[1]) = (lowest[0].min(c), lowest[1].min(r));
            (highest[0], highest[1]) = (highest[0].max(c), highest[1].max(r));
            for (dr, dc) in [(0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)] {
                let (Some(r), Some(c)) = (r.checked_add_signed(dr), c.checked_add_signed(dc))
                else {
                    continue;
                };
                if r < rows && c < columns && !seen[r * columns + c] && smooth(r, c) >= limit {
                    seen[r * columns + c] = true;
                    open.push(r * columns + c);
                }
            }
        }
        if n >= FEWEST_PX && weight > 0.0 {
            let extent = (highest[0] - lowest[0]).max(highest[1] - lowest[1]) as f64;
            found.push((x / weight, y / weight, 0.5 * extent + 1.0));
        }
    }
    found
}

/// Measures a star; `None` where it is saturated, too near to the edge, or too faint.
fn measure(frame: &Frame, place: (f64, f64, f64), sigma: f64) -> Option<Star> {
    let (rows, columns) = frame.pixels.dim();
    let full = frame.saturation_adu.unwrap_or(65_535.0);
    let gain = frame.gain_e_per_adu.filter(|gain| *gain > 0.0).unwrap_or(1.0);
    let (mut x, mut y, first) = place;
    let mut radius = (1.5 * first).max(6.0);
    let mut star = None;
    for turn in 0..5 {
        let outer = radius + 3.0 + (0.5 * radius).max(5.0);
        let inside = x - radius >= 0.0
            && y - radius >= 0.0
            && x + radius <= columns as f64 - 1.0
            && y + radius <= rows as f64 - 1.0;
        if !inside {
            return None;
        }
        let range = |middle: f64, most: usize| {
            let from = (middle - outer).floor().max(0.0) as usize;
            from..((middle + outer).ceil() as usize + 1).min(most)
        };
        let mut around = Vec::new();
        let mut within = Vec::new();
        for r in range(y, rows) {
            for c in range(x, columns) {
                let (dx, dy) = (c as f64 - x, r as f64 - y);
                let distance = dx.hypot(dy);
                let value = f64::from(frame.pixels[(r, c)]);
                if distance <= radius {
                    within.push((dx, dy, distance, value));
                } else if distance > radius + 3.0 && distance <= outer {
                    around.push(value);
                }
            }
        }
        if around.len() < 20 {
            return None;
        }
        // The mean of the middle half: a median of whole numbers is coarser than the sky must be known here.
        around.sort_by(f64::total_cmp);
        let part = &around[around.len() / 4..around.len() - around.len() / 4];
        let local = part.iter().sum::<f64>() / part.len() as f64;
        let (mut flux, mut sx, mut sy, mut sr) = (0.0, 0.0, 0.0, 0.0);
        for &(dx, dy, distance, value) in &within {
            if value >= full {
                return None;
            }
            let f = value - local;
            flux += f;
            (sx, sy, sr) = (sx + f * dx, sy + f * dy, sr + f * distance);
        }
        let noise =
            sigma * (within.len() as f64 * (1.0 + within.len() as f64 / part.len() as f64)).sqrt();
        if flux < LEAST_SNR * noise.max(1e-9) {
            return None;
        }
        let hfr = sr / flux;
        if !(hfr > LEAST_HFR_PX && hfr < radius) {
            return None;
        }
        let variance: f64 = within
            .iter()
            .map(|&(_, _, distance, value)| {
                (distance - hfr).powi(2) * (sigma * sigma + (value - local).max(0.0) / gain)
            })
            .sum();
        // The sky's own error moves all pixels at once.
        let lever: f64 = within.iter().map(|&(_, _, distance, _)| distance - hfr).sum();
        let common = sigma * lever / (part.len() as f64).sqrt();
        let sigma_hfr = (variance + common * common).sqrt() / flux;
        star = Some(Star { x, y, radius, flux, hfr, sigma: sigma_hfr });
        if turn < 4 {
            let step = [sx / flux, sy / flux].map(|d| d.clamp(-2.0, 2.0));
            (x, y) = (x + step[0], y + step[1]);
            radius = (3.0 * hfr + 3.0).clamp(6.0, 2.5 * first.max(6.0));
        }
    }
    star
}

/// Half-flux radius of the frame's stars, hot pixels left out; `None` where none can be measured.
pub fn sharpness(frame: &Frame) -> Option<Sharpness> {
    let (middle, sigma) = sky(frame);
    let frame = &without_hot(frame, middle, sigma);
    let places = find(frame, middle, sigma);
    let mut stars: Vec<Star> =
        places.iter().filter_map(|&place| measure(frame, place, sigma)).collect();
    // Stars whose apertures overlap spoil one another; what is near counts even where it could not be measured.
    let lonely = |star: &Star| {
        let near = |&&(x, y, r): &&(f64, f64, f64)| {
            let distance = (x - star.x).hypot(y - star.y);
            distance > 0.5 * star.hfr + 1.0 && distance < star.radius + r
        };
        places.iter().find(near).is_none()
    };
    stars.retain(lonely);
    stars.sort_by(|a, b| b.flux.total_cmp(&a.flux).then(a.x.total_cmp(&b.x)));
    stars.truncate(MOST_STARS);
    if stars.is_empty() {
        return None;
    }
    let mut radii: Vec<f64> = stars.iter().map(|star| star.hfr).collect();
    radii.sort_by(f64::total_cmp);
    let middle = radii[radii.len() / 2];
    let error = |star: &Star| star.sigma.hypot(SCATTER * middle);
    let kept: Vec<&Star> = match stars.len() {
        1 | 2 => stars.iter().collect(),
        _ => {
            let mut off: Vec<f64> = radii.iter().map(|r| (r - middle).abs()).collect();
            off.sort_by(f64::total_cmp);
            let spread = 1.4826 * off[off.len() / 2];
            let near = |star: &&Star| (star.hfr - middle).abs() <= 4.0 * error(star).max(spread);
            stars.iter().filter(near).collect()
        }
    };
    let weights: Vec<f64> = kept.iter().map(|star| error(star).powi(-2)).collect();
    let total: f64 = weights.iter().sum();
    let mean = kept.iter().zip(&weights).map(|(star, w)| star.hfr * w).sum::<f64>() / total;
    let noise: f64 = kept.iter().zip(&weights).map(|(star, w)| (star.sigma * w).powi(2)).sum();
    let chi2: f64 = kept.iter().zip(&weights).map(|(s, w)| (s.hfr - mean).powi(2) * w).sum();
    let scale = if kept.len() > 1 { (chi2 / (kept.len() - 1) as f64).max(1.0) } else { 1.0 };
    let sigma_px = (scale * noise).sqrt() / total;
    Some(Sharpness { hfr_px: mean, sigma_px, stars: kept.len() })
}
