//! Two functions of μ = cosθ that vary fast below μ ≈ α, tabulated.
//!
//! They are computed at Chebyshev points in s, μ = δ sinh(s asinh(1/δ)) with δ ≈ α: 65 to 1025 of them, the fewer the rougher. Their interpolant fills a table that is
//! cubic between nodes at equal distances in s, which is fast to look up.

use super::MaterialError;
use std::f64::consts::PI;
use sunglint_numerics::panels;

/// The largest error of the interpolation between Chebyshev points.
const TOLERANCE: f64 = 2e-5;
/// The largest error of the cubics.
const CUBIC_TOLERANCE: f64 = 1e-6;
const FEWEST_POINTS: usize = 17;
const MOST_POINTS: usize = 1025;
const FEWEST_NODES: usize = 65;
const MOST_NODES: usize = 8193;

/// Places with both functions there.
type Points = Vec<(f64, [f64; 2])>;

/// Two functions that are nowhere negative, from below.
#[derive(Debug, Clone)]
pub(super) struct Curve {
    delta: f64,
    /// asinh(1/δ).
    span: f64,
    pub(super) values: Vec<[f64; 2]>,
}

impl Curve {
    /// Tabulates both functions, lower by what they may err: by twice the measured error of each interpolation and of the quadrature.
    pub(super) fn new(
        alpha: f64,
        function: impl Fn(f64) -> Result<[f64; 2], MaterialError>,
    ) -> Result<Self, MaterialError> {
        let delta = 0.5 * alpha.min(1.0);
        let span = (1.0 / delta).asinh();
        // At the horizon itself nothing is defined: its limit.
        let at = |s: f64| function((delta * (s.max(1e-9) * span).sinh()).min(1.0));
        let (points, error) = chebyshev(at)?;
        let mut curve = Self { delta, span, values: Vec::new() };
        let mut nodes = FEWEST_NODES;
        loop {
            let s = |j: usize| j as f64 / (nodes - 1) as f64;
            curve.values = (0..nodes).map(|j| interpolate(&points, s(j))).collect();
            let mut cubic = 0.0_f64;
            for j in 1..nodes {
                let middle = 0.5 * (s(j - 1) + s(j));
                let (found, truth) = (curve.cubic(middle), interpolate(&points, middle));
                cubic = cubic.max(difference(found, truth));
            }
            if cubic <= CUBIC_TOLERANCE {
                let margin = 2.0 * (error + cubic) + 1e-8;
                curve.values.iter_mut().flatten().for_each(|v| *v -= margin);
                return Ok(curve);
            }
            if nodes >= MOST_NODES {
                return Err(MaterialError::Coat { nodes, error: cubic, expected: CUBIC_TOLERANCE });
            }
            nodes = 2 * nodes - 1;
        }
    }

    /// Both at μ.
    pub(super) fn at(&self, mu: f64) -> [f64; 2] {
        self.cubic((mu / self.delta).asinh() / self.span).map(|v| v.max(0.0))
    }

    /// The cubic through the four nodes around s (0 to 1).
    fn cubic(&self, s: f64) -> [f64; 2] {
        let last = self.values.len() - 1;
        let x = (s * last as f64).clamp(0.0, last as f64);
        let first = (x as usize).saturating_sub(1).min(last - 3);
        let t = x - first as f64;
        let y = &self.values[first..first + 4];
        let (a, b, c, d) = (t, t - 1.0, t - 2.0, t - 3.0);
        let weights = [-b * c * d / 6.0, 0.5 * a * c * d, -0.5 * a * b * d, a * b * c / 6.0];
        let of = |k: usize| {
            weights[0] * y[0][k]
                + weights[1] * y[1][k]
                + weights[2] * y[2][k]
                + weights[3] * y[3][k]
        };
        [of(0), of(1)]
    }

    /// 2∫ f μ dμ of each, by a quadrature that is exact for the cubics.
    pub(super) fn mean(&self) -> [f64; 2] {
        let nodes = self.values.len();
        let edges: Vec<f64> = (0..nodes).map(|j| j as f64 / (nodes - 1) as f64).collect();
        let mut sum = [0.0; 2];
        for (s, weight) in panels::points(&edges, 0) {
            let t = s * self.span;
            let (mu, slope) = (self.delta * t.sinh(), self.delta * self.span * t.cosh());
            for (sum, value) in sum.iter_mut().zip(self.cubic(s)) {
                *sum += 2.0 * weight * value.max(0.0) * mu * slope;
            }
        }
        sum
    }
}

fn difference(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).abs().max((a[1] - b[1]).abs())
}

/// Values at as many Chebyshev points (of the second kind, each with its s) as are needed, and the error of their interpolant: the sum of the last eighth of its
/// coefficients, which fall geometrically, so that those beyond are together less.
fn chebyshev(
    at: impl Fn(f64) -> Result<[f64; 2], MaterialError>,
) -> Result<(Points, f64), MaterialError> {
    let point = |j: usize, count: usize| (0.5 * PI * j as f64 / (count - 1) as f64).sin().powi(2);
    let value = |s: f64| Ok::<_, MaterialError>((s, at(s)?));
    let mut points = (0..FEWEST_POINTS)
        .map(|j| value(point(j, FEWEST_POINTS)))
        .collect::<Result<Vec<_>, _>>()?;
    loop {
        let error = tail(&points);
        if error <= TOLERANCE {
            return Ok((points, error));
        }
        if points.len() >= MOST_POINTS {
            let nodes = points.len();
            return Err(MaterialError::Coat { nodes, error, expected: TOLERANCE });
        }
        let count = 2 * points.len() - 1;
        let mut finer = vec![points[0]];
        for (j, known) in points.iter().enumerate().skip(1) {
            finer.extend([value(point(2 * j - 1, count))?, *known]);
        }
        points = finer;
    }
}

/// The sum of the last eighth of the Chebyshev coefficients, of the larger function.
fn tail(points: &[(f64, [f64; 2])]) -> f64 {
    let last = points.len() - 1;
    let coefficient = |k: usize, of: usize| -> f64 {
        let term = |j: usize| {
            let half = if j == 0 || j == last { 0.5 } else { 1.0 };
            // The points are counted from s = 0; there the argument of the polynomials is −1.
            let turn = PI * ((k * (last - j)) % (2 * last)) as f64 / last as f64;
            half * points[j].1[of] * turn.cos()
        };
        2.0 / last as f64 * (0..=last).map(term).sum::<f64>()
    };
    let sum = |of: usize| (last - last / 8..=last).map(|k| coefficient(k, of).abs()).sum::<f64>();
    sum(0).max(sum(1))
}

/// The polynomial through all points, in its barycentric form: of Chebyshev points of the second kind the weights are ±1, half at
/// the ends (Berrut and Trefethen 2004, SIAM Review 46, 501).
fn interpolate(points: &[(f64, [f64; 2])], s: f64) -> [f64; 2] {
    let (mut sum, mut all, mut sign) = ([0.0; 2], 0.0, 1.0);
    for (j, (node, value)) in points.iter().enumerate() {
        if s == *node {
            return *value;
        }
        let half = if j == 0 || j + 1 == points.len() { 0.5 } else { 1.0 };
        let weight = sign * half / (s - node);
        all += weight;
        sum[0] += weight * value[0];
        sum[1] += weight * value[1];
        sign = -sign;
    }
    [sum[0] / all, sum[1] / all]
}
