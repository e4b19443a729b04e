//! The V-curve: a hyperbola or a parabola, whichever fits better, and its lowest point.
//!
//! A hyperbola h² = a² + b² (x − x₀)² is a parabola of h², so that both are linear fits with a closed form. The uncertainty of x₀ comes from the points' own
//! uncertainties, enlarged by √(χ²/ν) where they scatter more; the interval takes Student's t with the ν degrees of freedom.

use serde::Serialize;

/// Fewest points of a curve.
pub const FEWEST: usize = 5;
/// Points on either side of the lowest, at least.
const EACH_SIDE: usize = 2;
/// Multiple of the least radius up to which points are fitted: farther out the curve is no longer that of the model.
const REACH: f64 = 4.0;

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
    /// Standard uncertainty of it, steps.
    pub sigma: f64,
    /// Half of the 95 % interval, steps.
    pub half_width_95: f64,
    /// Half-flux radius at the best position, px.
    pub least_px: f64,
    /// χ² of the curve, by the points' own uncertainties.
    pub chi2: f64,
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

/// Quadratic through points (u, y, σ): coefficients, their covariance, χ². `None` where it is not determined.
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
    let off =
        |&(u, y, sigma): &(f64, f64, f64)| ((y - c[0] - u * (c[1] + u * c[2])) / sigma).powi(2);
    let chi2 = points.iter().map(off).sum();
    Some((c, covariance, chi2))
}

/// Student's t of the 95 % interval (two-sided) by degrees of freedom: tables, and beyond ten a fit to them within 0.2 %.
fn student(freedom: usize) -> f64 {
    const TABLE: [f64; 10] =
        [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228];
    match freedom {
        0 => f64::INFINITY,
        n if n <= 10 => TABLE[n - 1],
        n => 1.960 + 2.372 / n as f64 + 2.8 / (n * n) as f64,
    }
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
    let shape = |shape: Shape| {
        let of = |p: &Point| {
            let u = (p.position - middle) / scale;
            match shape {
                Shape::Hyperbola => (u, p.hfr_px.powi(2), 2.0 * p.hfr_px * p.sigma_px),
                Shape::Parabola => (u, p.hfr_px, p.sigma_px),
            }
        };
        let rows: Vec<_> = used.iter().map(of).collect();
        let (coefficients, covariance, _) = quadratic(&rows)?;
        let mut curve = Curve {
            shape,
            best: 0.0,
            sigma: 0.0,
            half_width_95: 0.0,
            least_px: 0.0,
            chi2: 0.0,
            fitted: used.len(),
            coefficients,
            middle,
            scale,
        };
        // Held against the points in px for both shapes, so that they can be compared.
        curve.chi2 = used
            .iter()
            .map(|p| {
                let value = curve.at(p.position);
                let value = if value.is_finite() { value } else { 0.0 };
                ((p.hfr_px - value) / p.sigma_px).powi(2)
            })
            .sum();
        let [_, c1, c2] = coefficients;
        let enlarge = (curve.chi2 / freedom as f64).max(1.0);
        let bends = c2 / (covariance[2][2] * enlarge).sqrt();
        let u = -c1 / (2.0 * c2);
        // ∂u/∂c₁ = −1/2c₂, ∂u/∂c₂ = −u/c₂.
        let (by1, by2) = (-0.5 / c2, -u / c2);
        let variance = by1 * by1 * covariance[1][1]
            + 2.0 * by1 * by2 * covariance[1][2]
            + by2 * by2 * covariance[2][2];
        curve.best = middle + scale * u;
        curve.sigma = scale * (variance.max(0.0) * enlarge).sqrt();
        curve.half_width_95 = student(freedom) * curve.sigma;
        curve.least_px = curve.at(curve.best);
        Some((curve, bends))
    };
    let found = [Shape::Hyperbola, Shape::Parabola].map(shape);
    let usable = found
        .into_iter()
        .flatten()
        .filter(|(curve, bends)| *bends > 3.0 && curve.least_px > 0.0)
        .map(|(curve, _)| curve);
    let best = usable.min_by(|a, b| a.chi2.total_cmp(&b.chi2));
    let lowest = lowest.unwrap_or(middle);
    let edge = |best: f64, next: f64| CurveError::AtEdge { best, from, to, next };
    let Some(curve) = best else {
        let ends = all
            .iter()
            .filter(|p| p.position < lowest)
            .count()
            .min(all.iter().filter(|p| p.position > lowest).count());
        let noise = used.iter().map(|p| p.sigma_px).fold(0.0, f64::max);
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
