//! Part of a point's light that an aperture catches, and that the fit of a streak catches: from the frame's own bright points, whatever the form of their wings.
//!
//! The light of bright lone points grows with the radius out to four full widths at half maximum, which counts as all of it. A streak's profile across is that of a point summed along
//! lines (Abel's transform), so the same growth tells what a normal profile fitted to it finds.
//!
//! Where stars are trailed there are no lone points: a Moffat profile summed along lines, (1 + y²/α²)^(½−β), is fitted across the bright trails, and its growth is the point's.

use super::super::overlap::Aperture;
use super::{FWHM_PER_SIGMA, PointSource, Streak};
use sunglint_numerics::order::median;

/// Radii, in parts of the full width at half maximum.
const STEP: f64 = 0.25;
const STEPS: usize = 16;
/// Points that are looked at, and those that are enough.
const MOST: usize = 60;
const FEW: usize = 3;

/// Growth of a point's light.
#[derive(Debug, Clone, PartialEq)]
pub struct Growth {
    /// Part of a point's light that its aperture finds.
    point: f64,
    /// Part of the light within radii, px.
    curve: Vec<(f64, f64)>,
    /// Points that it was taken from.
    pub points: usize,
}

/// The growth of the light of a frame's points; `None` where fewer than three are bright and alone.
pub(super) fn growth(
    raw: &[f32],
    size: [usize; 2],
    points: &[PointSource],
    streaks: &[[[f64; 2]; 2]],
    sigma_px: f64,
    unit: f64,
) -> Option<Growth> {
    let fwhm = FWHM_PER_SIGMA * sigma_px;
    let far = STEP * STEPS as f64 * fwhm;
    let outer = 1.5 * far;
    let is_alone = |i: usize, point: &PointSource| {
        let away = |p: [f64; 2]| (p[0] - point.place_px[0]).hypot(p[1] - point.place_px[1]);
        points.iter().enumerate().all(|(j, other)| {
            i == j || other.flux_adu < 0.02 * point.flux_adu || away(other.place_px) > 1.3 * far
        }) && streaks.iter().all(|ends| super::streak::distance(*ends, point.place_px) > 1.3 * far)
    };
    let inside =
        |p: [f64; 2]| (0..2).all(|k| p[k] > outer + 1.0 && p[k] < size[k] as f64 - outer - 2.0);
    let mut curves: Vec<Vec<f64>> = Vec::new();
    let mut caught = Vec::new();
    for (i, point) in points.iter().enumerate().take(500) {
        let is_bright = point.flux_adu > 50.0 * point.sigma_adu;
        if point.is_saturated
            || point.is_cut
            || !is_bright
            || !inside(point.place_px)
            || !is_alone(i, point)
        {
            continue;
        }
        let Some(curve) = light_within(raw, size, point.place_px, fwhm, [far, outer]) else {
            continue;
        };
        let all = curve[STEPS - 1];
        if all <= 0.0 {
            continue;
        }
        caught.push(point.flux_adu / (all * unit));
        curves.push(curve.iter().map(|light| light / all).collect());
        if curves.len() == MOST {
            break;
        }
    }
    if curves.len() < FEW {
        return None;
    }
    let point = median(caught)?.clamp(0.5, 1.05);
    let mut curve = Vec::new();
    let mut least: f64 = 0.0;
    for k in 0..STEPS {
        // Noise may make it fall; light does not.
        least = median(curves.iter().map(|c| c[k]))?.clamp(least, 1.0);
        curve.push(((k + 1) as f64 * STEP * fwhm, least));
    }
    Some(Growth { point, curve, points: curves.len() })
}

/// Exponents of Moffat profiles that are tried; the last is nearly normal.
const BETAS: [f64; 11] = [1.8, 2.1, 2.4, 2.7, 3.0, 3.5, 4.0, 5.0, 7.0, 12.0, 40.0];

/// The growth of a point's light from the profile across trailed stars; `None` where fewer than three trails are bright and alone.
pub(super) fn of_trails(
    raw: &[f32],
    [width, height]: [usize; 2],
    streaks: &[Streak],
    points: &[PointSource],
    sigma_px: f64,
    aperture_px: f64,
) -> Option<Growth> {
    const MOST_TRAILS: usize = 20;
    const MOST_PIXELS: usize = 2500;
    let fwhm = FWHM_PER_SIGMA * sigma_px;
    let far = STEP * STEPS as f64 * fwhm;
    let places = |s: &Streak| {
        let [a, b] = s.ends_px;
        [0.0, 0.25, 0.5, 0.75, 1.0].map(|t| [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])])
    };
    let is_alone = |i: usize, of: &Streak| {
        let clear = |p: [f64; 2]| super::streak::distance(of.ends_px, p) > 1.3 * far;
        points.iter().all(|p| p.flux_adu < 0.02 * of.flux_adu || clear(p.place_px))
            && streaks.iter().enumerate().all(|(j, other)| {
                i == j
                    || other.flux_adu < 0.02 * of.flux_adu
                    || places(other).into_iter().all(clear)
            })
    };
    // Distances across and values, trail by trail.
    let mut trails: Vec<Vec<[f64; 2]>> = Vec::new();
    for (i, streak) in streaks.iter().enumerate() {
        let whole =
            streak.is_star_trail && !streak.is_cut && !streak.is_saturated && !streak.is_end_hidden;
        if !whole || streak.masked > 0.1 || streak.significance < 15.0 || !is_alone(i, streak) {
            continue;
        }
        let [a, b] = streak.ends_px;
        let along = [0, 1].map(|k| (b[k] - a[k]) / streak.length_px);
        let (low, high) = (0.1 * streak.length_px, 0.9 * streak.length_px);
        let range = |k: usize, n: usize| {
            let (p, q) = (a[k].min(b[k]) - far, a[k].max(b[k]) + far);
            p.max(0.0) as usize..((q.max(0.0) as usize) + 1).min(n)
        };
        let mut pixels = Vec::new();
        for row in range(1, height) {
            for column in range(0, width) {
                let d = [column as f64 - a[0], row as f64 - a[1]];
                let t = d[0] * along[0] + d[1] * along[1];
                let y = d[1] * along[0] - d[0] * along[1];
                let value = f64::from(raw[row * width + column]);
                if t > low && t < high && y.abs() < far && value.is_finite() {
                    pixels.push([y, value]);
                }
            }
        }
        let step = pixels.len().div_ceil(MOST_PIXELS).max(1);
        trails.push(pixels.into_iter().step_by(step).collect());
        if trails.len() == MOST_TRAILS {
            break;
        }
    }
    if trails.len() < FEW {
        return None;
    }
    let mut best: Option<(f64, f64, f64)> = None;
    for beta in BETAS {
        for size in 0..21 {
            let fwhm = fwhm * (0.7 + 0.03 * f64::from(size));
            let alpha = 0.5 * fwhm / (2.0_f64.powf(beta.recip()) - 1.0).sqrt();
            let missed: f64 = trails.iter().map(|t| missed(t, alpha, beta)).sum();
            if best.is_none_or(|(least, _, _)| missed < least) {
                best = Some((missed, alpha, beta));
            }
        }
    }
    let (_, alpha, beta) = best?;
    let within = |r: f64| 1.0 - (1.0 + (r / alpha).powi(2)).powf(1.0 - beta);
    // An aperture with its ring, as points are measured.
    let (inner, outer) =
        ((1.6 * aperture_px).max(aperture_px + 1.5), (2.5 * aperture_px).max(aperture_px + 4.0));
    let ring = (within(outer) - within(inner)) / (outer * outer - inner * inner);
    Some(Growth {
        point: (within(aperture_px) - ring * aperture_px * aperture_px).clamp(0.5, 1.05),
        curve: (1..=2 * STEPS).map(|k| k as f64 * STEP * fwhm).map(|r| (r, within(r))).collect(),
        points: trails.len(),
    })
}

/// Squares that a Moffat profile summed along lines leaves of a trail's pixels beside an even background.
fn missed(pixels: &[[f64; 2]], alpha: f64, beta: f64) -> f64 {
    let (mut n, mut g1, mut gg, mut v1, mut gv, mut vv) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for [y, value] in pixels {
        let g = (1.0 + (y / alpha).powi(2)).powf(0.5 - beta);
        n += 1.0;
        g1 += g;
        gg += g * g;
        v1 += value;
        gv += g * value;
        vv += value * value;
    }
    let (cgg, cgv, cvv) = (gg - g1 * g1 / n, gv - g1 * v1 / n, vv - v1 * v1 / n);
    if cgg > 0.0 { cvv - cgv * cgv / cgg } else { cvv }
}

/// Light within the radii above the median of a far ring, in the units of the values.
fn light_within(
    raw: &[f32],
    [width, _]: [usize; 2],
    place: [f64; 2],
    fwhm: f64,
    [far, outer]: [f64; 2],
) -> Option<Vec<f64>> {
    let range = |at: f64| (at - outer).floor() as usize..(at + outer).ceil() as usize + 1;
    let apertures: Vec<Aperture> =
        (1..=STEPS).map(|k| Aperture::disc(place, k as f64 * STEP * fwhm)).collect();
    let (mut sums, mut areas) = (vec![0.0; STEPS], vec![0.0; STEPS]);
    let mut ring = Vec::new();
    for row in range(place[1]) {
        for column in range(place[0]) {
            let value = f64::from(raw[row * width + column]);
            if !value.is_finite() {
                return None;
            }
            let (x, y) = (column as f64, row as f64);
            let distance = (x - place[0]).hypot(y - place[1]);
            if distance > 1.1 * far && distance < outer {
                ring.push(value);
            }
            for (k, aperture) in apertures.iter().enumerate() {
                if distance < (k + 1) as f64 * STEP * fwhm + 1.0 {
                    let part = aperture.overlap(x, y);
                    sums[k] += part * value;
                    areas[k] += part;
                }
            }
        }
    }
    let background = super::clipped(&mut ring)?;
    Some(sums.iter().zip(&areas).map(|(sum, area)| sum - area * background).collect())
}

impl Growth {
    /// Part of a point's light that its aperture finds.
    pub fn of_point(&self) -> f64 {
        self.point
    }

    /// Part of a streak's light that a line with a normal profile of this standard deviation finds, beside an even background out to the corridor's edge.
    pub fn of_streak(&self, sigma_px: f64, half_px: f64) -> f64 {
        const BINS: usize = 400;
        let width = half_px / BINS as f64;
        // Light between the line and a distance from it, of both sides: that of a thin ring is 2/π asin(h/r).
        let within = |h: f64| {
            let mut sum = 0.0;
            let mut before = (0.0, 0.0);
            for &(radius, light) in &self.curve {
                // Thin rings; between two radii the light outside falls as that of a normal profile does, evenly in its logarithm and the square of the radius.
                const THIN: u32 = 24;
                let outside = |t: f64| {
                    let (a, b) = (1.0 - before.1, 1.0 - light);
                    if b > 1e-6 { a * (b / a).powf(t) } else { a + (b - a) * t }
                };
                for part in 0..THIN {
                    let [from, to] = [part, part + 1].map(|p| f64::from(p) / f64::from(THIN));
                    let t = 0.5 * (from + to);
                    let r = f64::sqrt(
                        before.0 * before.0 + t * (radius * radius - before.0 * before.0),
                    );
                    let here = outside(from) - outside(to);
                    sum += here * std::f64::consts::FRAC_2_PI * (h / r).min(1.0).asin();
                }
                before = (radius, light);
            }
            sum
        };
        let (mut n, mut g1, mut l1, mut gg, mut gl) = (0.0, 0.0, 0.0, 0.0, 0.0);
        let mut last = 0.0;
        for bin in 0..BINS {
            let edge = (bin + 1) as f64 * width;
            let so_far = within(edge);
            // Density on each side.
            let l = 0.5 * (so_far - last) / width;
            last = so_far;
            let y = edge - 0.5 * width;
            let g = (-0.5 * (y / sigma_px).powi(2)).exp()
                / (sigma_px * (2.0 * std::f64::consts::PI).sqrt());
            n += 1.0;
            g1 += g;
            l1 += l;
            gg += g * g;
            gl += g * l;
        }
        let found = (n * gl - g1 * l1) / (n * gg - g1 * g1);
        if found.is_finite() { found.clamp(0.5, 1.05) } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A growth as an analytic profile has it.
    fn of(profile: impl Fn(f64) -> f64, fwhm: f64) -> Growth {
        let curve = (1..=STEPS).map(|k| k as f64 * STEP * fwhm).map(|r| (r, profile(r))).collect();
        Growth { point: profile(1.5 * fwhm), curve, points: 9 }
    }

    /// A normal profile is found whole by its own width (1 %: rings of finite width); of one fitted with t times its width, √(2t²/(1 + t²)) is found, by hand.
    #[test]
    fn a_normal_profile_is_found_whole() {
        let sigma = 1.5;
        let normal = of(|r| 1.0 - (-0.5 * r * r / (sigma * sigma)).exp(), FWHM_PER_SIGMA * sigma);
        let whole = normal.of_streak(sigma, 5.0 * sigma + 2.0);
        assert!((whole - 1.0).abs() < 0.01, "{whole}");
        let narrow = normal.of_streak(0.5 * sigma, 200.0);
        assert!((narrow - (2.0_f64 * 0.25 / 1.25).sqrt()).abs() < 0.03, "{narrow}");
    }
}
