//! Point spread, and the part of it that falls on a pixel.

use crate::observatory::counts::GAUSS_5;
use glam::DVec2;

/// Nodes and weights of three-point Gauss–Legendre quadrature on [−1, 1].
const GAUSS_3: [(f64, f64); 3] = [
    (-0.774_596_669_241_483_4, 0.555_555_555_555_555_6),
    (0.0, 0.888_888_888_888_888_8),
    (0.774_596_669_241_483_4, 0.555_555_555_555_555_6),
];

/// Nodes and weights of two-point Gauss–Legendre quadrature on [−1, 1].
const GAUSS_2: [(f64, f64); 2] = [(-0.577_350_269_189_625_8, 1.0), (0.577_350_269_189_625_8, 1.0)];

/// Spread of a point's light over the sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum PointSpread {
    /// A normal distribution.
    Gaussian {
        /// Full width at half maximum, px.
        fwhm_px: f64,
    },
    /// (β−1)/(πα²) (1+r²/α²)^(−β) (Moffat 1969): long exposures through the air; β is about 2.5 to 4.
    Moffat {
        /// Full width at half maximum, px: 2α√(2^(1/β)−1).
        fwhm_px: f64,
        /// β, above 1.
        beta: f64,
    },
}

/// A rectangle of weights over a picture: from this column and row on, `columns` wide.
#[derive(Debug, Clone, Default)]
pub(super) struct Stamp {
    pub origin: [usize; 2],
    pub columns: usize,
    pub weights: Vec<f64>,
}

impl PointSpread {
    /// Full width at half maximum, px.
    pub fn fwhm_px(&self) -> f64 {
        match *self {
            Self::Gaussian { fwhm_px } | Self::Moffat { fwhm_px, .. } => fwhm_px,
        }
    }

    /// The radius outside which no more than this fraction of the light falls, px.
    pub fn radius_px(&self, outside: f64) -> f64 {
        match *self {
            Self::Gaussian { fwhm_px } => sigma_px(fwhm_px) * (-2.0 * outside.ln()).sqrt(),
            Self::Moffat { fwhm_px, beta } => {
                alpha_px(fwhm_px, beta) * (outside.powf(-1.0 / (beta - 1.0)) - 1.0).sqrt()
            }
        }
    }

    /// The fraction of the light of a point at `at_px` that falls on the pixel of a column and row, px. Of a normal distribution it is
    /// exact, of a Moffat profile good to 2e−5 of the light for widths of 1 px and more.
    pub fn on_pixel(&self, at_px: impl Into<DVec2>, column: f64, row: f64) -> f64 {
        let at_px = at_px.into();
        let (x, y) = (column - at_px[0], row - at_px[1]);
        match *self {
            Self::Gaussian { fwhm_px } => {
                on_line(x, sigma_px(fwhm_px)) * on_line(y, sigma_px(fwhm_px))
            }
            Self::Moffat { fwhm_px, beta } => moffat(x, y, fwhm_px, beta),
        }
    }

    /// Returns the light on the pixels of a picture of `size` from `origin` on; less than the fraction `outside` is left out far away. The
    /// stamp is empty where the light passes beside the picture.
    pub(super) fn stamp(
        &self,
        at_px: [f64; 2],
        origin: [f64; 2],
        size: [usize; 2],
        outside: f64,
        stamp: &mut Stamp,
    ) {
        let radius = self.radius_px(outside) + 1.0;
        let middle = [at_px[0] - origin[0], at_px[1] - origin[1]];
        let range = |axis: usize| {
            let first = (middle[axis] - radius).ceil().clamp(0.0, size[axis] as f64);
            let end = ((middle[axis] + radius).floor() + 1.0).clamp(first, size[axis] as f64);
            (first as usize, end as usize)
        };
        let ((left, right), (top, bottom)) = (range(0), range(1));
        stamp.origin = [left, top];
        stamp.columns = right - left;
        stamp.weights.clear();
        match *self {
            Self::Gaussian { fwhm_px } => {
                let sigma = sigma_px(fwhm_px);
                let across: Vec<f64> =
                    (left..right).map(|c| on_line(c as f64 - middle[0], sigma)).collect();
                for row in top..bottom {
                    let down = on_line(row as f64 - middle[1], sigma);
                    stamp.weights.extend(across.iter().map(|across| across * down));
                }
            }
            Self::Moffat { fwhm_px, beta } => {
                for row in top..bottom {
                    let y = row as f64 - middle[1];
                    let of_row = (left..right).map(|c| c as f64 - middle[0]).map(|x| {
                        let within = x * x + y * y <= radius * radius;
                        if within { moffat(x, y, fwhm_px, beta) } else { 0.0 }
                    });
                    stamp.weights.extend(of_row);
                }
            }
        }
    }
}

fn sigma_px(fwhm_px: f64) -> f64 {
    fwhm_px / (8.0 * std::f64::consts::LN_2).sqrt()
}

fn alpha_px(fwhm_px: f64, beta: f64) -> f64 {
    0.5 * fwhm_px / (2_f64.powf(1.0 / beta) - 1.0).sqrt()
}

/// The part of a normal distribution about 0 that falls on the pixel at x.
fn on_line(x: f64, sigma: f64) -> f64 {
    let scale = 1.0 / (sigma * std::f64::consts::SQRT_2);
    // Of the tails the difference of the small complements keeps its digits.
    let x = x.abs();
    0.5 * (libm::erfc((x - 0.5) * scale) - libm::erfc((x + 0.5) * scale))
}

/// The part of a Moffat profile about the origin that falls on the pixel at (x, y): finer where it is steep.
fn moffat(x: f64, y: f64, fwhm_px: f64, beta: f64) -> f64 {
    let alpha = alpha_px(fwhm_px, beta);
    let peak = (beta - 1.0) / (std::f64::consts::PI * alpha * alpha);
    let per_alpha2 = 1.0 / (alpha * alpha);
    let density = |x: f64, y: f64| (-beta * (x * x + y * y).mul_add(per_alpha2, 1.0).ln()).exp();
    let mean = |nodes: &[(f64, f64)]| {
        let mut sum = 0.0;
        for (down, down_weight) in nodes {
            for (across, across_weight) in nodes {
                let weight = 0.25 * down_weight * across_weight;
                sum += weight * density(x + 0.5 * across, y + 0.5 * down);
            }
        }
        sum
    };
    let widths = (x * x + y * y).sqrt() / fwhm_px.max(1.0);
    // Fewer points where a pixel is small against the profile, and far out.
    let mean = match widths {
        near if near < 1.5 && alpha < 2.0 => mean(&GAUSS_5),
        near if near < 1.5 || (near < 3.0 && alpha < 2.0) => mean(&GAUSS_3),
        near if near < 4.0 || (near < 6.0 && alpha < 2.0) => mean(&GAUSS_2),
        _ => density(x, y),
    };
    peak * mean
}
