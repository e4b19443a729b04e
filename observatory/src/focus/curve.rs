//! The V-curve: a hyperbola or a parabola, whichever fits better, and its lowest point.
//!
//! A hyperbola h² = a² + b² (x − x₀)² is a parabola of h², so that both are linear fits with a closed form.
//!
//! Points scatter by their own noise, which they state, and by a part s of the radius, which nobody knows: seeing that changes from frame to frame, guiding,
//! other stars in the aperture. Few points tell s badly. So x₀ is asked of every s from 0.01 % to 30 % and of both shapes, and each answer counts by its
//! likelihood (restricted, Patterson and Thompson 1971, with each factor in s and the light's noise together as likely as another). Intervals are those of all answers together. With nothing
//! but s they are Student's; points that lie on the curve by chance make none that is narrower than the light's noise.
//!
//! Up to two points may be wrong: far out of focus a hot pixel is brighter than the stars. Those that fit least are left out, and what is left answers, too, by its likelihood: one point in twenty is taken to be wrong.

use serde::Serialize;
use std::f64::consts::SQRT_2;
use sunglint_numerics::order::median;

/// Fewest points of a curve.
pub const FEWEST: usize = 5;
/// Points on either side of the lowest, at least.
const EACH_SIDE: usize = 2;
/// Multiple of the least radius up to which points are fitted: farther out the curve is no longer that of the model.
const REACH: f64 = 4.0;
/// Scatter of radii beyond which they are on no curve, as a part of them.
const NO_CURVE: f64 = 0.28;
/// Scatter of radii by the air, as a part of them, where no curve tells it.
const TYPICAL: f64 = 0.02;

/// Point of a V-curve.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Point {
    /// Position of the focuser, steps.
    pub position: f64,
    /// Half-flux radius, px.
    pub hfr_px: f64,
    /// Standard uncertainty of it, px.
    pub sigma_px: f64,
}

/// Shape of a curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// h² = a² + b² (x − x₀)²: straight arms, a disc of light that grows with the defocus.
    Hyperbola,
    /// h = a + b (x − x₀)².
    Parabola,
}

/// Curve through the points.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Curve {
    /// Shape that fits better.
    pub shape: Shape,
    /// Best position, steps.
    pub best: f64,
    /// Standard uncertainty of it, steps: half of the 68.3 % interval.
    pub sigma: f64,
    /// Half of the 95 % interval, steps.
    pub half_width_95: f64,
    /// Half-flux radius at the best position, px.
    pub least_px: f64,
    /// χ² of the curve, by the points' own uncertainties.
    pub chi2: f64,
    /// Part of the radius by which points scatter beyond these, the likeliest.
    pub scatter: f64,
    /// Points that were fitted.
    pub fitted: usize,
    /// Coefficients in u = (x − middle) / scale: c₀ + c₁ u + c₂ u², of h or h².
    #[serde(skip)]
    coefficients: [f64; 3],
    #[serde(skip)]
    middle: f64,
    #[serde(skip)]
    scale: f64,
}

impl Curve {
    /// Half-flux radius of the curve at a position, px; NaN where a hyperbola has none.
    pub fn at(&self, position: f64) -> f64 {
        let u = (position - self.middle) / self.scale;
        let [c0, c1, c2] = self.coefficients;
        let value = c0 + u * (c1 + u * c2);
        match self.shape {
            Shape::Hyperbola => value.sqrt(),
            Shape::Parabola => value,
        }
    }
}

/// Why there is no best position.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CurveError {
    /// Too few points.
    #[error(
        "{found} points have stars, {FEWEST} at least are needed: expose longer, or take smaller steps around the focus{}",
        sharpest.map_or_else(String::new, |at| format!(" (the sharpest was at {at:.0}: --center)"))
    )]
    TooFew {
        /// Points with stars.
        found: usize,
        /// Position of the sharpest, steps.
        sharpest: Option<f64>,
    },
    /// The lowest point is not within the points.
    #[error(
        "the lowest point lies at the edge: {best:.0} steps by the curve, with points from {from:.0} to {to:.0}; begin again around {next:.0} (--center)"
    )]
    AtEdge {
        /// Lowest point of the curve, or the point of the least radius.
        best: f64,
        /// First point.
        from: f64,
        /// Last point.
        to: f64,
        /// Where to look next.
        next: f64,
    },
    /// The points do not bend.
    #[error(
        "the radius does not change with the position beyond its noise ({least:.2} to {most:.2} px): take larger steps (--step)"
    )]
    Flat {
        /// Least radius, px.
        least: f64,
        /// Largest radius, px.
        most: f64,
    },
    /// The points are on no curve.
    #[error(
        "the points scatter by {times:.0} times their uncertainty about any curve: clouds, or a star that is lost? look at the points and begin again"
    )]
    NoCurve {
        /// √(χ²/ν).
        times: f64,
    },
}

/// Quadratic through points (u, y, σ): coefficients, their covariance, the determinant of its inverse. `None` where it is not determined.
fn quadratic(points: &[(f64, f64, f64)]) -> Option<([f64; 3], [[f64; 3]; 3], f64)> {
    let (mut m, mut v) = ([[0.0; 3]; 3], [0.0; 3]);
    for &(u, y, sigma) in points {
        let w = sigma.powi(-2);
        let powers = [1.0, u, u * u];
        for i in 0..3 {
            v[i] += w * powers[i] * y;
            for j in 0..3 {
                m[i][j] += w * powers[i] * powers[j];
            }
        }
    }
    let minor = |i: usize, j: usize| {
        let [a, b] = [(i + 1) % 3, (i + 2) % 3];
        let [c, d] = [(j + 1) % 3, (j + 2) % 3];
        m[a][c] * m[b][d] - m[a][d] * m[b][c]
    };
    let determinant: f64 = (0..3).map(|j| m[0][j] * minor(0, j)).sum();
    let size = m[0][0] * m[1][1] * m[2][2];
    if !(determinant.is_finite() && determinant > 1e-12 * size) {
        return None;
    }
    let mut covariance = [[0.0; 3]; 3];
    for (i, row) in covariance.iter_mut().enumerate() {
        for (j, cell) in row.iter_mut().enumerate() {
            *cell = minor(j, i) / determinant;
        }
    }
    let mut c = [0.0; 3];
    for (i, c) in c.iter_mut().enumerate() {
        *c = (0..3).map(|j| covariance[i][j] * v[j]).sum();
    }
    Some((c, covariance, determinant))
}

/// Scatter of radii beyond the light's noise, as a part of them: from nothing to clouds, by equal factors.
const SCATTERS: usize = 41;
const SCATTER: [f64; 2] = [1e-4, 0.3];

fn scatters() -> impl Iterator<Item = f64> {
    let [least, most] = SCATTER.map(f64::ln);
    (0..SCATTERS).map(move |i| (least + (most - least) * i as f64 / (SCATTERS - 1) as f64).exp())
}

/// Answer of a shape and a scatter.
struct Answer {
    curve: Curve,
    /// The curvature over its standard uncertainty.
    bends: f64,
    /// Standard uncertainty of the best position, steps.
    sigma: f64,
    /// Twice the negative logarithm of the likelihood with its prior.
    cost: f64,
}

/// Part of the points that are wrong for reasons of their own: a hot pixel where all stars are too faint, a star that is lost. They lie anywhere up to the largest radius.
const WRONG: f64 = 0.05;
/// Points that are left out at most.
const MOST_WRONG: usize = 2;

/// Number of points up to which all pairs are tried.
const MOST_PAIRED: usize = 15;

/// Points but for some.
fn but(points: &[Point], is_out: impl Fn(usize) -> bool) -> Vec<Point> {
    points.iter().enumerate().filter(|(k, _)| !is_out(*k)).map(|(_, p)| *p).collect()
}

/// Points by position, and how these become small numbers.
struct Points {
    /// Middle and half of the reach, steps.
    middle: f64,
    scale: f64,
    /// Largest radius and a middle one, px.
    most: f64,
    typical: f64,
    /// Light's noise as a part of the radius.
    light: f64,
}

impl Points {
    /// The answer of some points, `wrong` of which were left out; `None` where they do not determine a curve.
    fn answer(&self, used: &[Point], wrong: usize, shape: Shape, scatter: f64) -> Option<Answer> {
        let noise = |p: &Point| p.sigma_px.hypot(scatter * p.hfr_px);
        let of = |p: &Point| {
            let u = (p.position - self.middle) / self.scale;
            match shape {
                Shape::Hyperbola => (u, p.hfr_px.powi(2), 2.0 * p.hfr_px * noise(p)),
                Shape::Parabola => (u, p.hfr_px, noise(p)),
            }
        };
        let rows: Vec<_> = used.iter().map(of).collect();
        let (coefficients, covariance, volume) = quadratic(&rows)?;
        let [_, c1, c2] = coefficients;
        let u = -c1 / (2.0 * c2);
        // ∂u/∂c₁ = −1/2c₂, ∂u/∂c₂ = −u/c₂.
        let (by1, by2) = (-0.5 / c2, -u / c2);
        let variance = by1 * by1 * covariance[1][1]
            + 2.0 * by1 * by2 * covariance[1][2]
            + by2 * by2 * covariance[2][2];
        let mut curve = Curve {
            shape,
            best: self.middle + self.scale * u,
            sigma: 0.0,
            half_width_95: 0.0,
            least_px: 0.0,
            chi2: 0.0,
            scatter,
            fitted: used.len(),
            coefficients,
            middle: self.middle,
            scale: self.scale,
        };
        curve.least_px = curve.at(curve.best);
        // Held against the points in px for both shapes, so that they can be compared.
        let off = |p: &Point| {
            let value = curve.at(p.position);
            p.hfr_px - if value.is_finite() { value } else { 0.0 }
        };
        let chi2 = used.iter().map(|p| (off(p) / p.sigma_px).powi(2)).sum();
        let right: f64 = used
            .iter()
            .map(|p| (off(p) / noise(p)).powi(2) + 2.0 * (noise(p) / (1.0 - WRONG)).ln())
            .sum();
        curve.chi2 = chi2;
        let left_out = 2.0 * wrong as f64 * (self.most / WRONG).ln();
        // Three coefficients take the 2π of as many points.
        let turn = (used.len() as f64 - 3.0) * std::f64::consts::TAU.ln();
        // The shapes' coefficients have other units: at a middle radius both are px.
        let unit = match shape {
            Shape::Hyperbola => 6.0 * (2.0 * self.typical).ln(),
            Shape::Parabola => 0.0,
        };
        // Each factor in light's noise and scatter together is as likely as another: a scatter far below the noise is hardly one.
        let prior = -2.0 * (scatter / (scatter + self.light)).ln();
        let cost = right + left_out + turn + volume.ln() + unit + prior;
        let bends = c2 / covariance[2][2].sqrt();
        let sigma = self.scale * variance.max(0.0).sqrt();
        cost.is_finite().then_some(Answer { curve, bends, sigma, cost })
    }

    /// All answers of some points, and the least cost of them.
    fn answers(&self, used: &[Point], wrong: usize) -> ([Vec<Answer>; 2], f64) {
        let of = [Shape::Hyperbola, Shape::Parabola].map(|shape| -> Vec<Answer> {
            scatters().filter_map(|scatter| self.answer(used, wrong, shape, scatter)).collect()
        });
        let least = of.iter().flatten().map(|a| a.cost).fold(f64::INFINITY, f64::min);
        (of, least)
    }

    /// Best curve and the interval by all answers: with all points, and with those left out that fit least.
    fn best(&self, every: &[Point]) -> Option<Curve> {
        let mut used = every.to_vec();
        let mut all: Vec<Answer> = Vec::new();
        let mut wrong = 0;
        let (mut shapes, _) = self.answers(&used, wrong);
        loop {
            for answers in shapes {
                let least = answers.iter().map(|a| a.cost).fold(f64::INFINITY, f64::min);
                let weight = |a: &Answer| (-0.5 * (a.cost - least)).exp();
                let whole: f64 = answers.iter().map(weight).sum();
                let usable: Vec<Answer> = answers
                    .into_iter()
                    .filter(|a| a.bends > 3.0 && a.curve.least_px > 0.0 && a.sigma > 0.0)
                    .collect();
                if usable.iter().map(weight).sum::<f64>() >= 0.5 * whole {
                    all.extend(usable);
                }
            }
            if wrong == MOST_WRONG || used.len() <= FEWEST {
                break;
            }
            wrong += 1;
            // Two that are wrong may hide one another: few points are tried in all pairs, many one after the other.
            let n = every.len();
            let left: Vec<Vec<Point>> = if wrong == 2 && n <= MOST_PAIRED {
                let pairs = (0..n).flat_map(|i| (0..i).map(move |j| (i, j)));
                pairs.map(|(i, j)| but(every, |k| k == i || k == j)).collect()
            } else {
                (0..used.len()).map(|i| but(&used, |k| k == i)).collect()
            };
            let tried = left.into_iter().map(|rest| {
                let (shapes, least) = self.answers(&rest, wrong);
                (least, rest, shapes)
            });
            let next = tried.min_by(|a, b| a.0.total_cmp(&b.0))?;
            (used, shapes) = (next.1, next.2);
        }
        let likeliest = all.iter().min_by(|a, b| a.cost.total_cmp(&b.cost))?;
        let (least, mut curve) = (likeliest.cost, likeliest.curve);
        let weigh = |a: &Answer| ((-0.5 * (a.cost - least)).exp(), a.curve.best, a.sigma);
        let mixture: Vec<_> = all.iter().map(weigh).collect();
        curve.sigma = half_width(&mixture, curve.best, 0.682_689);
        curve.half_width_95 = half_width(&mixture, curve.best, 0.95);
        Some(curve)
    }
}

/// Half of the interval about a middle that holds a share of a mixture of (weight, place, σ).
fn half_width(mixture: &[(f64, f64, f64)], middle: f64, share: f64) -> f64 {
    let total: f64 = mixture.iter().map(|(weight, ..)| weight).sum();
    let held = |half: f64| {
        let part = |&(weight, at, sigma): &(f64, f64, f64)| {
            let below = |end: f64| 0.5 * libm::erfc((at - end) / (sigma * SQRT_2));
            weight * (below(middle + half) - below(middle - half))
        };
        mixture.iter().map(part).sum::<f64>() / total
    };
    let far = |&(_, at, sigma): &(f64, f64, f64)| (at - middle).abs() + 10.0 * sigma;
    let (mut low, mut high) = (0.0, mixture.iter().map(far).fold(0.0, f64::max));
    for _ in 0..60 {
        let half = 0.5 * (low + high);
        if held(half) < share { low = half } else { high = half }
    }
    high
}

/// Curve through points in any order.
///
/// # Errors
/// See [`CurveError`].
pub fn fit(points: &[Point]) -> Result<Curve, CurveError> {
    let good = |p: &&Point| p.hfr_px > 0.0 && p.sigma_px > 0.0 && p.hfr_px.is_finite();
    let mut all: Vec<Point> = points.iter().filter(good).copied().collect();
    all.sort_by(|a, b| a.position.total_cmp(&b.position).then(a.hfr_px.total_cmp(&b.hfr_px)));
    let lowest = all.iter().min_by(|a, b| a.hfr_px.total_cmp(&b.hfr_px)).map(|p| p.position);
    if all.len() < FEWEST {
        return Err(CurveError::TooFew { found: all.len(), sharpest: lowest });
    }
    let of = |fold: fn(f64, f64) -> f64, start| all.iter().map(|p| p.hfr_px).fold(start, fold);
    let (least, most) = (of(f64::min, f64::INFINITY), of(f64::max, 0.0));
    // The lowest may be a hot pixel.
    let mut radii: Vec<f64> = all.iter().map(|p| p.hfr_px).collect();
    radii.sort_by(f64::total_cmp);
    let near: Vec<Point> = all.iter().filter(|p| p.hfr_px <= REACH * radii[1]).copied().collect();
    let used = if near.len() >= FEWEST { near } else { all.clone() };
    let (from, to) = (all[0].position, all[all.len() - 1].position);
    let middle = used.iter().map(|p| p.position).sum::<f64>() / used.len() as f64;
    let scale = used.iter().map(|p| (p.position - middle).abs()).fold(0.0, f64::max);
    if scale <= 0.0 {
        return Err(CurveError::TooFew { found: 1, sharpest: lowest });
    }
    let light = median(used.iter().map(|p| p.sigma_px / p.hfr_px)).unwrap_or(0.0);
    let typical = median(used.iter().map(|p| p.hfr_px)).unwrap_or(least);
    let best = Points { middle, scale, most, typical, light }.best(&used);
    let lowest = lowest.unwrap_or(middle);
    let edge = |best: f64, next: f64| CurveError::AtEdge { best, from, to, next };
    let Some(curve) = best else {
        let ends = all
            .iter()
            .filter(|p| p.position < lowest)
            .count()
            .min(all.iter().filter(|p| p.position > lowest).count());
        let noise = used.iter().map(|p| p.sigma_px.hypot(TYPICAL * p.hfr_px)).fold(0.0, f64::max);
        return Err(if most - least > 6.0 * noise && ends < EACH_SIDE {
            edge(lowest, lowest)
        } else {
            CurveError::Flat { least, most }
        });
    };
    let below = all.iter().filter(|p| p.position < curve.best).count();
    if below.min(all.len() - below) < EACH_SIDE {
        let reach = to - from;
        let next = curve.best.clamp(from - reach, to + reach);
        return Err(edge(curve.best, next));
    }
    let times = (curve.chi2 / (curve.fitted - 3) as f64).sqrt();
    // Away from any curve, the lowest point of one says nothing.
    if times > 3.0 && curve.scatter > NO_CURVE {
        return Err(CurveError::NoCurve { times });
    }
    Ok(curve)
}
