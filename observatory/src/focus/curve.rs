//! The V-curve: a hyperbola or a parabola, whichever fits better, and its lowest point.
//!
//! A hyperbola h² = a² + b² (x − x₀)² is a parabola of h², so that both are linear fits with a closed form.
//!
//! Points scatter by their own noise, which they state, and by a part s of the radius, which nobody knows: seeing that changes from frame to frame, guiding,
//! other stars in the aperture. Few points tell s badly. So x₀ is asked of every s from 0.01 % to 30 % and of both shapes, and each answer counts by its
//! likelihood (restricted, Patterson and Thompson 1971, with each factor in s and the light's noise together as likely as another). Intervals are those of all answers together. With nothing
//! but s they are Student's; points that lie on the curve by chance make none that is narrower than the light's noise.

use serde::Serialize;
use std::f64::consts::SQRT_2;
use sunglint_numerics::order::median;

/// Fewest points of a curve.
pub const FEWEST: usize = 5;
/// Points on either side of the lowest, at least.
const EACH_SIDE: usize = 2;
/// Multiple of the least radius up to which points are fitted: farther out the curve is no longer that of the model.
const REACH: f64 = 4.0;
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

/// What a shape and a scatter answer.
struct Answer {
    curve: Curve,
    /// The curvature over its standard uncertainty.
    bends: f64,
    /// Standard uncertainty of the best position, steps.
    sigma: f64,
    /// Twice the negative logarithm of the likelihood, and what the restricted one adds to it.
    cost: f64,
    restricted: f64,
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
    let near: Vec<Point> = all.iter().filter(|p| p.hfr_px <= REACH * least).copied().collect();
    let used = if near.len() >= FEWEST { near } else { all.clone() };
    let (from, to) = (all[0].position, all[all.len() - 1].position);
    let middle = used.iter().map(|p| p.position).sum::<f64>() / used.len() as f64;
    let scale = used.iter().map(|p| (p.position - middle).abs()).fold(0.0, f64::max);
    if scale <= 0.0 {
        return Err(CurveError::TooFew { found: 1, sharpest: lowest });
    }
    let freedom = used.len() - 3;
    let answer = |shape: Shape, scatter: f64| {
        let noise = |p: &Point| p.sigma_px.hypot(scatter * p.hfr_px);
        let of = |p: &Point| {
            let u = (p.position - middle) / scale;
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
            best: middle + scale * u,
            sigma: 0.0,
            half_width_95: 0.0,
            least_px: 0.0,
            chi2: 0.0,
            scatter,
            fitted: used.len(),
            coefficients,
            middle,
            scale,
        };
        curve.least_px = curve.at(curve.best);
        // Held against the points in px for both shapes, so that they can be compared.
        let off = |p: &Point| {
            let value = curve.at(p.position);
            p.hfr_px - if value.is_finite() { value } else { 0.0 }
        };
        let chi2 = used.iter().map(|p| (off(p) / p.sigma_px).powi(2)).sum();
        let cost = used.iter().map(|p| (off(p) / noise(p)).powi(2) + 2.0 * noise(p).ln()).sum();
        curve.chi2 = chi2;
        let bends = c2 / covariance[2][2].sqrt();
        let sigma = scale * variance.max(0.0).sqrt();
        Some(Answer { curve, bends, sigma, cost, restricted: volume.ln() })
    };
    // Each factor in light's noise and scatter together is as likely as another: a scatter far below the noise is hardly one.
    let light = median(used.iter().map(|p| p.sigma_px / p.hfr_px)).unwrap_or(0.0);
    let prior = |s: f64| -2.0 * (s / (s + light)).ln();
    let mut answers = Vec::new();
    let mut least_cost = f64::INFINITY;
    let mut best: Option<Curve> = None;
    for shape in [Shape::Hyperbola, Shape::Parabola] {
        let of: Vec<Answer> = scatters().filter_map(|s| answer(shape, s)).collect();
        // The restricted part has the units of the shape's own numbers.
        let Some(reference) = of.first().map(|a| a.restricted) else { continue };
        let cost = |a: &Answer| a.cost + a.restricted - reference + prior(a.curve.scatter);
        let least = of.iter().map(cost).fold(f64::INFINITY, f64::min);
        let weight = |a: &Answer| (-0.5 * (cost(a) - least)).exp();
        let all: f64 = of.iter().map(weight).sum();
        let usable: Vec<&Answer> = of
            .iter()
            .filter(|a| a.bends > 3.0 && a.curve.least_px > 0.0 && a.sigma > 0.0)
            .collect();
        if usable.iter().map(|a| weight(a)).sum::<f64>() < 0.5 * all {
            continue;
        }
        if let Some(likeliest) = usable.iter().min_by(|a, b| cost(a).total_cmp(&cost(b)))
            && cost(likeliest) < least_cost
        {
            least_cost = cost(likeliest);
            best = Some(likeliest.curve);
        }
        answers.extend(usable.iter().map(|a| (cost(a), a.curve.best, a.sigma)));
    }
    let best = best.map(|mut curve| {
        let weigh =
            |(cost, at, sigma): (f64, f64, f64)| ((-0.5 * (cost - least_cost)).exp(), at, sigma);
        let mixture: Vec<_> = answers.into_iter().map(weigh).collect();
        curve.sigma = half_width(&mixture, curve.best, 0.682_689);
        curve.half_width_95 = half_width(&mixture, curve.best, 0.95);
        curve
    });
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
    let times = (curve.chi2 / freedom as f64).sqrt();
    // Away from any curve, the lowest point of one says nothing.
    if times > 10.0 && used.iter().any(|p| (p.hfr_px - curve.at(p.position)).abs() > 0.5 * least) {
        return Err(CurveError::NoCurve { times });
    }
    Ok(curve)
}
