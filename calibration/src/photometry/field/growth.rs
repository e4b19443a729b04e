//! Part of a point's light that an aperture catches, and that the fit of a streak catches: from the frame's own points or trails, whose wings no normal profile has.
//!
//! A Moffat profile (1 + r²/α²)^−β is fitted to the pixels of bright lone points (Moffat 1969, A&A 3, 455; β 2.5 to 5 of telescopes under air, large of a normal profile). Summed along
//! lines it is (1 + y²/α²)^(½−β): that is fitted across the trails where stars are trailed, and it tells what a normal profile fitted to a streak finds.

use super::{FWHM_PER_SIGMA, PointSource, Streak};
use rayon::prelude::*;
use sunglint_numerics::order::median;

/// Points or trails that are enough, and those that are looked at.
const FEW: usize = 3;
const MOST: usize = 30;
/// Pixels of a point or a trail that are looked at.
const MOST_PIXELS: usize = 1200;
/// Radius of what is looked at, in full widths at half maximum.
const FAR: f64 = 4.0;
/// Exponents that are tried; the last is nearly that of a normal profile.
const BETAS: [f64; 12] = [1.6, 1.8, 2.1, 2.4, 2.7, 3.0, 3.5, 4.0, 5.0, 7.0, 12.0, 40.0];
/// The exponent where no point tells.
const BETA: f64 = 3.5;

/// Growth of a point's light with the radius.
#[derive(Debug, Clone, PartialEq)]
pub struct Growth {
    /// Scale of the profile, px.
    alpha_px: f64,
    /// The profile's exponent.
    beta: f64,
    /// Points or trails that it was taken from; 0 where it is assumed.
    pub sources: usize,
}

/// Distances from the middle or across, and values.
type Pixels = Vec<[f64; 2]>;

fn is_clear(of: f64, other: f64, distance: f64, far: f64) -> bool {
    other < 0.05 * of || distance > 1.1 * far
}

/// Both ends of a streak, columns and rows, px.
fn ends(streak: &Streak) -> [[f64; 2]; 2] {
    streak.ends_px.map(|end| end.to_array())
}

/// The growth from bright lone points; `None` where fewer than three are.
pub(super) fn of_points(
    raw: &[f32],
    [width, height]: [usize; 2],
    points: &[PointSource],
    streaks: &[Streak],
    sigma_px: f64,
) -> Option<Growth> {
    let fwhm = FWHM_PER_SIGMA * sigma_px;
    let far = FAR * fwhm;
    let mut found: Vec<(Pixels, f64)> = Vec::new();
    for (i, point) in points.iter().enumerate().take(400) {
        let [x, y] = point.place_px.to_array();
        let inside = |v: f64, n: usize| v > far + 1.0 && v < n as f64 - far - 2.0;
        let is_bright = point.flux_adu > 25.0 * point.sigma_adu;
        if point.is_saturated || !is_bright || !inside(x, width) || !inside(y, height) {
            continue;
        }
        let is_alone = points.iter().enumerate().all(|(j, other)| {
            let d = (other.place_px[0] - x).hypot(other.place_px[1] - y);
            i == j || is_clear(point.flux_adu, other.flux_adu, d, far)
        }) && streaks.iter().all(|s| {
            is_clear(point.flux_adu, s.flux_adu, super::streak::distance(ends(s), [x, y]), far)
        });
        if !is_alone {
            continue;
        }
        let range = |v: f64| (v - far) as usize..(v + far) as usize + 2;
        let mut pixels = Vec::new();
        for row in range(y) {
            for column in range(x) {
                let value = f64::from(raw[row * width + column]);
                let r = (column as f64 - x).hypot(row as f64 - y);
                if r < far && value.is_finite() {
                    pixels.push([r, value]);
                }
            }
        }
        found.push((thinned(pixels), point.flux_adu));
        if found.len() == MOST {
            break;
        }
    }
    fitted(&found, fwhm, 0.0)
}

/// The growth from the profile across trailed stars; `None` where fewer than three trails are bright and alone.
pub(super) fn of_trails(
    raw: &[f32],
    [width, height]: [usize; 2],
    streaks: &[Streak],
    points: &[PointSource],
    sigma_px: f64,
) -> Option<Growth> {
    let fwhm = FWHM_PER_SIGMA * sigma_px;
    let far = FAR * fwhm;
    let places = |s: &Streak| {
        let [a, b] = s.ends_px;
        [0.0, 0.25, 0.5, 0.75, 1.0].map(|t| [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])])
    };
    let mut found: Vec<(Pixels, f64)> = Vec::new();
    for (i, streak) in streaks.iter().enumerate() {
        let whole =
            streak.is_star_trail && !streak.is_cut && !streak.is_saturated && !streak.is_end_hidden;
        if !whole || streak.masked > 0.1 || streak.significance < 15.0 {
            continue;
        }
        let clear = |p: [f64; 2], flux: f64| {
            is_clear(streak.flux_adu, flux, super::streak::distance(ends(streak), p), far)
        };
        let is_alone = points.iter().all(|p| clear(p.place_px.to_array(), p.flux_adu))
            && streaks.iter().enumerate().all(|(j, other)| {
                i == j || places(other).into_iter().all(|p| clear(p, other.flux_adu))
            });
        if !is_alone {
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
        found.push((thinned(pixels), streak.flux_adu));
        if found.len() == MOST {
            break;
        }
    }
    fitted(&found, fwhm, 0.5)
}

fn thinned(pixels: Pixels) -> Pixels {
    let step = pixels.len().div_ceil(MOST_PIXELS).max(1);
    pixels.into_iter().step_by(step).collect()
}

/// The profile that leaves least of the pixels; `lines` is ½ of trails and 0 of points. Each source counts by its light, as its own noise does.
fn fitted(found: &[(Pixels, f64)], fwhm: f64, lines: f64) -> Option<Growth> {
    if found.len() < FEW {
        return None;
    }
    let tried: Vec<(f64, f64, f64)> = BETAS
        .into_par_iter()
        .flat_map_iter(|beta| (0..25).map(move |size| (beta, 0.7 + 0.03 * f64::from(size))))
        .map(|(beta, size)| {
            let alpha = alpha_of(fwhm * size, beta);
            let all = found.iter().map(|(pixels, flux)| left(pixels, alpha, lines - beta) / flux);
            (all.sum(), alpha, beta)
        })
        .collect();
    let best = tried.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
    best.map(|(_, alpha_px, beta)| Growth { alpha_px, beta, sources: found.len() })
}

fn alpha_of(fwhm: f64, beta: f64) -> f64 {
    0.5 * fwhm / (2.0_f64.powf(beta.recip()) - 1.0).sqrt()
}

/// Squares that a profile leaves of pixels beside an even background.
fn left(pixels: &[[f64; 2]], alpha: f64, exponent: f64) -> f64 {
    let (mut n, mut g1, mut gg, mut v1, mut gv, mut vv) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for [y, value] in pixels {
        let g = (1.0 + (y / alpha).powi(2)).powf(exponent);
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

impl Growth {
    /// The growth of a usual profile with this full width at half maximum, where no point tells: β 3.5.
    pub fn assumed(fwhm_px: f64) -> Self {
        Self { alpha_px: alpha_of(fwhm_px, BETA), beta: BETA, sources: 0 }
    }

    /// The middle of several; `None` of none.
    pub fn middle<'a>(of: impl Iterator<Item = &'a Self> + Clone) -> Option<Self> {
        let beta = median(of.clone().map(|g| g.beta))?;
        let fwhm = |g: &Self| 2.0 * g.alpha_px * (2.0_f64.powf(g.beta.recip()) - 1.0).sqrt();
        let middle = median(of.clone().map(fwhm))?;
        let sources = of.map(|g| g.sources).max()?;
        Some(Self { alpha_px: alpha_of(middle, beta), beta, sources })
    }

    /// Standard deviation of the ratio of a point's and a streak's light by what is not known of the profile, mag: 0.05 for one source, in made-up frames; 0.03 of an assumed one.
    pub fn sigma_mag(&self) -> f64 {
        if self.sources == 0 { 0.03 } else { (0.05 / (self.sources as f64).sqrt()).min(0.03) }
    }

    /// Part of a point's light within a radius.
    fn within(&self, radius_px: f64) -> f64 {
        1.0 - (1.0 + (radius_px / self.alpha_px).powi(2)).powf(1.0 - self.beta)
    }

    /// Part of a point's light that an aperture finds, whose background is that of the ring about it.
    pub fn of_point(&self, radius_px: f64) -> f64 {
        let [inner, outer] = super::ring(radius_px);
        let beside = (self.within(outer) - self.within(inner)) / (outer * outer - inner * inner);
        self.within(radius_px) - beside * radius_px * radius_px
    }

    /// Part of a streak's light that a line with a normal profile of this standard deviation finds beside an even background, out to the corridor's edge.
    pub fn of_streak(&self, sigma_px: f64, half_px: f64) -> f64 {
        const BINS: usize = 400;
        let step = half_px / BINS as f64;
        // Height of the profile across: Γ(β − ½) / (√π Γ(β − 1) α).
        let height = (libm::lgamma(self.beta - 0.5) - libm::lgamma(self.beta - 1.0)).exp()
            / (std::f64::consts::PI.sqrt() * self.alpha_px);
        let (mut n, mut g1, mut l1, mut gg, mut gl) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for bin in 0..BINS {
            let y = (bin as f64 + 0.5) * step;
            let l = height * (1.0 + (y / self.alpha_px).powi(2)).powf(0.5 - self.beta);
            let g = (-0.5 * (y / sigma_px).powi(2)).exp()
                / (sigma_px * (2.0 * std::f64::consts::PI).sqrt());
            n += 1.0;
            g1 += g;
            l1 += l;
            gg += g * g;
            gl += g * l;
        }
        (n * gl - g1 * l1) / (n * gg - g1 * g1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// β of 4,000 is a normal profile: found whole by a line of its own width; by one fitted with t times its width √(2t²/(1 + t²)) is found, by hand. Half of the light of
    /// β = 2 is within α, by hand; that of β = 3 within 2α is 1 − 1/25.
    #[test]
    fn parts_are_those_of_closed_forms() {
        let sigma = 1.5;
        let normal =
            Growth { alpha_px: alpha_of(FWHM_PER_SIGMA * sigma, 4e3), beta: 4e3, sources: 9 };
        let whole = normal.of_streak(sigma, 5.0 * sigma + 2.0);
        assert!((whole - 1.0).abs() < 0.01, "{whole}");
        let narrow = normal.of_streak(0.5 * sigma, 200.0);
        assert!((narrow - (2.0_f64 * 0.25 / 1.25).sqrt()).abs() < 0.01, "{narrow}");
        let of = |beta: f64| Growth { alpha_px: 2.0, beta, sources: 9 };
        assert!((of(2.0).within(2.0) - 0.5).abs() < 1e-12);
        assert!((of(3.0).within(4.0) - 0.96).abs() < 1e-12);
        assert!((normal.of_point(1.5 * FWHM_PER_SIGMA * sigma) - 1.0).abs() < 0.005);
        let pair = [of(3.0), of(3.0)];
        assert_eq!(Growth::middle(pair.iter()), Some(of(3.0)));
    }
}
