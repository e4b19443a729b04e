//! A two-dimensional normal distribution through rates at places.
//!
//! A place that is known to a covariance C spreads the field: the mean rate there is A √(|S|/|S+C|) exp(−½ dᵀ(S+C)⁻¹d) + b, with S the field's own
//! covariance, so that σ_x and σ_y come out as the fibre's and not as those of fibre and centroids together.

use super::FieldPoint;
use super::correlated::{long_run, reach, sequences};
use glam::DVec2;
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeSet;
use sunglint_numerics::least_squares::{Descent, Limits, Normal, minimise};
use sunglint_numerics::measured::Measured;
use sunglint_numerics::order::robust_sigma;
use sunglint_radiometry::station::Fibre;

/// Options of the fit: which parameters are fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitOptions {
    /// Whether the field's axes may turn against the frame's.
    pub rotation: bool,
    /// Whether a background, common to all points, is fitted.
    pub background: bool,
    /// Whether points far off count less (Tukey's biweight, 4.685 times the scatter: 95 % as efficient as least squares where there are none).
    pub robust: bool,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self { rotation: false, background: false, robust: true }
    }
}

/// Why there is no fit.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    /// Too few points.
    #[error("{found} points: expected more than the {parameters} numbers that are fitted")]
    TooFew {
        /// Points.
        found: usize,
        /// Numbers to be fitted.
        parameters: usize,
    },
    /// A point that is none.
    #[error("point {0}: expected finite numbers and an uncertainty above 0 Hz")]
    Point(usize),
    /// The points do not tell.
    #[error("the points do not determine the field: {0}")]
    Undetermined(&'static str),
}

/// A fitted field.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldFit {
    /// Centre of the field from the frame's centre, px.
    pub offset_px: DVec2,
    /// Standard deviations of the field along its own axes, px.
    pub sigma_px: DVec2,
    /// How far its first axis is turned from the frame's columns towards its rows, degrees, −45 to 45; 0 where no rotation was fitted.
    pub angle_deg: f64,
    /// Covariance of x₀, y₀, σ_x, σ_y (px) and the angle (deg): by the points' own scatter, and where they err together as much wider; zeros for an angle
    /// that was not fitted.
    pub covariance: [[f64; 5]; 5],
    /// Rate of each star at the centre and its standard uncertainty, Hz; stars in increasing number.
    pub amplitudes_hz: Vec<(usize, Measured)>,
    /// Background and its standard uncertainty, Hz; zeros where none was fitted.
    pub background_hz: Measured,
    /// Scatter of the points about the fit over their stated uncertainty: above 1 where scintillation, ghosts or places are worse than stated.
    pub scatter: f64,
    /// Over how many points of a star, in their order, residuals are alike; 0 where each errs for itself.
    pub correlated_points: usize,
    /// Points less numbers fitted.
    pub degrees_of_freedom: usize,
    /// How much each point counted, 0 to 1.
    pub weights: Vec<f64>,
}

impl FieldFit {
    /// Standard uncertainties of x₀, y₀, σ_x, σ_y (px), and the angle (deg).
    pub fn uncertainties(&self) -> [f64; 5] {
        [0, 1, 2, 3, 4].map(|i| self.covariance[i][i].sqrt())
    }

    /// The field along the frame's axes, as a station has it: of a turned one its widths in columns and rows, whose correlation a station cannot hold.
    pub fn fibre(&self) -> Fibre {
        let (sin, cos) = self.angle_deg.to_radians().sin_cos();
        let [u, v] = self.sigma_px.to_array();
        let sigma_px = DVec2::new((u * cos).hypot(v * sin), (u * sin).hypot(v * cos));
        Fibre { offset_px: self.offset_px, sigma_px }
    }

    /// The field at a point, against its centre, and spread by what is not known of the place.
    pub fn profile(&self, point: &FieldPoint) -> f64 {
        let [x, y] = self.offset_px.to_array();
        let [u, v] = self.sigma_px.to_array();
        profile(&[x, y, u.ln(), v.ln(), self.angle_deg.to_radians()], point)
    }

    /// Returns the rate that the fit gives at a point, Hz; `None` for a star that was not in it.
    pub fn rate_hz(&self, point: &FieldPoint) -> Option<f64> {
        let (_, amplitude) = self.amplitudes_hz.iter().find(|(star, _)| *star == point.star)?;
        Some(amplitude.value * self.profile(point) + self.background_hz.value)
    }
}

type Shape = [f64; 5];

/// The normal distribution of x₀, y₀, ln σ_u, ln σ_v, angle (rad), spread by the point's covariance.
fn profile([x, y, u, v, angle]: &Shape, point: &FieldPoint) -> f64 {
    let (sin, cos) = angle.sin_cos();
    let (uu, vv) = ((2.0 * u).exp(), (2.0 * v).exp());
    let [cxx, cyy, cxy] = point.covariance_px2;
    let xx = uu * cos * cos + vv * sin * sin + cxx;
    let yy = uu * sin * sin + vv * cos * cos + cyy;
    let xy = (uu - vv) * sin * cos + cxy;
    let det = xx * yy - xy * xy;
    let (dx, dy) = (point.offset_px[0] - x, point.offset_px[1] - y);
    let q = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / det;
    (uu * vv / det).sqrt() * (-0.5 * q).exp()
}

/// Points in the order of their stars, and which numbers are fitted: shape (4 or 5), background (0 or 1), amplitudes.
struct Problem<'a> {
    points: &'a [FieldPoint],
    star: Vec<usize>,
    stars: usize,
    shape: usize,
    background: bool,
    weights: Vec<f64>,
}

/// Fits the field.
///
/// # Errors
/// Too few points, points that are none, points that leave the field open: all at one place, or all where the field is flat.
pub fn fit_field(points: &[FieldPoint], options: &FitOptions) -> Result<FieldFit, FitError> {
    for (i, p) in points.iter().enumerate() {
        let numbers = [p.offset_px[0], p.offset_px[1], p.rate_hz, p.sigma_hz];
        let finite = numbers.iter().chain(&p.covariance_px2).all(|v| v.is_finite());
        let [xx, yy, xy] = p.covariance_px2;
        if !(finite && p.sigma_hz > 0.0 && xx >= 0.0 && yy >= 0.0 && xy * xy <= xx * yy) {
            return Err(FitError::Point(i + 1));
        }
    }
    let names: Vec<usize> =
        points.iter().map(|p| p.star).collect::<BTreeSet<_>>().into_iter().collect();
    let star = points.iter().map(|p| names.partition_point(|name| *name < p.star)).collect();
    let mut problem = Problem {
        points,
        star,
        stars: names.len(),
        shape: if options.rotation { 5 } else { 4 },
        background: options.background,
        weights: vec![1.0; points.len()],
    };
    let n = problem.parameters();
    if points.len() <= n {
        return Err(FitError::TooFew { found: points.len(), parameters: n });
    }
    let mut best: Option<(f64, DVector<f64>)> = None;
    for scale in [1.0, 0.5, 2.0] {
        let (cost, at) = problem.descend(problem.start(scale)?);
        if best.as_ref().is_none_or(|(least, _)| cost < *least) {
            best = Some((cost, at));
        }
    }
    let Some((_, mut at)) = best else { return Err(FitError::Undetermined("no start")) };
    let freedom = points.len() - n;
    let mut scale2 = problem.residuals(&at).norm_squared() / freedom as f64;
    let (mut psi, mut slope): (Vec<f64>, f64) =
        (problem.residuals(&at).iter().copied().collect(), 1.0);
    if options.robust {
        for _ in 0..50 {
            let residuals = problem.residuals(&at);
            let spread = spread(&residuals, freedom);
            problem.weights = residuals.iter().map(|r| biweight(r / spread)).collect();
            let (_, next) = problem.descend(at.clone());
            let moved = (&next - &at).amax() > 1e-9 * at.amax();
            at = next;
            if !moved {
                break;
            }
        }
        let residuals = problem.residuals(&at);
        let spread = spread(&residuals, freedom);
        // The variance of an M-estimate: Σψ²/(n−p) over the square of the mean of ψ'.
        let u: Vec<f64> = residuals.iter().map(|r| r / spread).collect();
        let psi2: f64 = u.iter().map(|u| (u * biweight(*u)).powi(2)).sum();
        slope = u.iter().map(|u| biweight_slope(*u)).sum::<f64>() / u.len() as f64;
        psi = u.iter().map(|u| spread * u * biweight(*u)).collect();
        scale2 = spread * spread * psi2 / freedom as f64 / (slope * slope);
    }
    problem.result(&at, &names, &Scores { scale2, psi, slope })
}

/// Terms of which the covariance is made.
struct Scores {
    /// The variance of an estimate from points that err each for itself, over that of unit variance.
    scale2: f64,
    /// ψ(r) of each point.
    psi: Vec<f64>,
    /// The mean of ψ'.
    slope: f64,
}

/// 1.4826 times the median of |r|, with the degrees of freedom that the fit took.
fn spread(residuals: &DVector<f64>, freedom: usize) -> f64 {
    let sigma = robust_sigma(residuals.iter().copied()).unwrap_or(0.0);
    (sigma * (residuals.len() as f64 / freedom as f64).sqrt()).max(1e-12)
}

const TUKEY: f64 = 4.685;

/// ψ(u)/u of Tukey's biweight.
fn biweight(u: f64) -> f64 {
    if u.abs() < TUKEY { (1.0 - (u / TUKEY).powi(2)).powi(2) } else { 0.0 }
}

fn biweight_slope(u: f64) -> f64 {
    let t = (u / TUKEY).powi(2);
    if t < 1.0 { (1.0 - t) * (1.0 - 5.0 * t) } else { 0.0 }
}

/// Numbers of the fit, and the weighted sum of squares there.
struct At {
    numbers: DVector<f64>,
    cost: f64,
}

struct Descending<'a, 'b>(&'a Problem<'b>);

impl Descent for Descending<'_, '_> {
    type Place = At;
    type Error = std::convert::Infallible;

    fn cost(&self, place: &At) -> f64 {
        place.cost
    }

    fn normal(&mut self, place: &mut At) -> Result<Normal, Self::Error> {
        let (matrix, downhill) = self.0.normal(&place.numbers, false);
        Ok(Normal { matrix, downhill })
    }

    fn step(&mut self, from: &At, step: &mut DVector<f64>) -> Result<At, Self::Error> {
        Ok(self.0.at(&from.numbers + &*step))
    }
}

impl Problem<'_> {
    fn parameters(&self) -> usize {
        self.shape + usize::from(self.background) + self.stars
    }

    fn shape_of(&self, at: &DVector<f64>) -> Shape {
        let mut shape = [0.0; 5];
        shape[..self.shape].copy_from_slice(&at.as_slice()[..self.shape]);
        shape
    }

    /// From the moments of the points above half of their star's largest, with `scale` times their width.
    fn start(&self, scale: f64) -> Result<DVector<f64>, FitError> {
        let mut most = vec![f64::NEG_INFINITY; self.stars];
        for (point, star) in self.points.iter().zip(&self.star) {
            most[*star] = most[*star].max(point.rate_hz);
        }
        let (mut sum, mut x, mut xx) = (0.0, [0.0; 2], [0.0; 2]);
        for (point, star) in self.points.iter().zip(&self.star) {
            let w = (point.rate_hz / most[*star] - 0.3).max(0.0);
            if !w.is_finite() || most[*star] <= 0.0 {
                continue;
            }
            sum += w;
            for i in 0..2 {
                x[i] += w * point.offset_px[i];
                xx[i] += w * point.offset_px[i].powi(2);
            }
        }
        if sum <= 0.0 {
            return Err(FitError::Undetermined("no star has a rate above 0 Hz"));
        }
        let mut at = DVector::zeros(self.parameters());
        for i in 0..2 {
            at[i] = x[i] / sum;
            let width2 = xx[i] / sum - at[i] * at[i];
            if width2 <= 0.0 {
                return Err(FitError::Undetermined("all points lie in one column or row"));
            }
            at[i + 2] = (scale * width2.sqrt()).ln();
        }
        let first = self.parameters() - self.stars;
        for (star, most) in most.into_iter().enumerate() {
            at[first + star] = most;
        }
        Ok(at)
    }

    /// (rate − model)/σ.
    fn residuals(&self, at: &DVector<f64>) -> DVector<f64> {
        let shape = self.shape_of(at);
        let first = self.parameters() - self.stars;
        let background = if self.background { at[self.shape] } else { 0.0 };
        let residual = |(p, star): (&FieldPoint, &usize)| {
            (p.rate_hz - background - at[first + star] * profile(&shape, p)) / p.sigma_hz
        };
        DVector::from_iterator(self.points.len(), self.points.iter().zip(&self.star).map(residual))
    }

    fn cost(&self, residuals: &DVector<f64>) -> f64 {
        residuals.iter().zip(&self.weights).map(|(r, w)| w * r * r).sum()
    }

    /// JᵀWJ and JᵀWr of the model over σ; unit weights for `plain`.
    fn normal(&self, at: &DVector<f64>, plain: bool) -> (DMatrix<f64>, DVector<f64>) {
        let n = self.parameters();
        let residuals = self.residuals(at);
        let (mut matrix, mut vector) = (DMatrix::zeros(n, n), DVector::zeros(n));
        let mut row = Vec::with_capacity(n);
        for i in 0..self.points.len() {
            let weight = if plain { 1.0 } else { self.weights[i] };
            self.slopes(at, i, &mut row);
            for (a, left) in &row {
                vector[*a] += weight * left * residuals[i];
                for (b, right) in &row {
                    matrix[(*a, *b)] += weight * left * right;
                }
            }
        }
        (matrix, vector)
    }

    /// The slopes of a point's model over its σ, by each number that it depends on.
    fn slopes(&self, at: &DVector<f64>, i: usize, row: &mut Vec<(usize, f64)>) {
        let shape = self.shape_of(at);
        let (point, number) = (&self.points[i], self.parameters() - self.stars + self.star[i]);
        row.clear();
        for k in 0..self.shape {
            // Central differences: a hundred-thousandth of the width, or of the logarithms.
            let step = 1e-5 * if k < 2 { shape[k + 2].exp() } else { 1.0 };
            let (mut up, mut down) = (shape, shape);
            up[k] += step;
            down[k] -= step;
            let slope = (profile(&up, point) - profile(&down, point)) / (2.0 * step);
            row.push((k, at[number] * slope / point.sigma_hz));
        }
        if self.background {
            row.push((self.shape, 1.0 / point.sigma_hz));
        }
        row.push((number, profile(&shape, point) / point.sigma_hz));
    }

    fn at(&self, numbers: DVector<f64>) -> At {
        let cost = self.cost(&self.residuals(&numbers));
        At { numbers, cost: if cost.is_nan() { f64::INFINITY } else { cost } }
    }

    /// Down to a minimum.
    fn descend(&self, start: DVector<f64>) -> (f64, DVector<f64>) {
        let limits = Limits { steps: 200, gain: 1e-13, step: 0.0 };
        let Ok(found) = minimise(&mut Descending(self), self.at(start), &limits);
        (found.place.cost, found.place.numbers)
    }

    fn result(
        &self,
        at: &DVector<f64>,
        names: &[usize],
        scores: &Scores,
    ) -> Result<FieldFit, FitError> {
        let (matrix, _) = self.normal(at, true);
        // Scaled to a unit diagonal, so that what is nearly singular shows as such.
        let n = matrix.nrows();
        let size = DVector::from_fn(n, |k, _| matrix[(k, k)].sqrt());
        if size.iter().any(|s| !(s.is_finite() && *s > 0.0)) {
            return Err(FitError::Undetermined("a number has no effect on any point"));
        }
        let scaled = DMatrix::from_fn(n, n, |i, j| matrix[(i, j)] / (size[i] * size[j]));
        let open = FitError::Undetermined(
            "some of its numbers can change together without a trace; more places are needed",
        );
        let least = scaled.clone().symmetric_eigenvalues().min();
        if least.is_nan() || least < 1e-9 {
            return Err(open);
        }
        let inverse = scaled.try_inverse().ok_or(open)?;
        let freedom = self.points.len() - n;
        let sequences = sequences(&self.star, self.stars);
        let together = reach(&scores.psi, &sequences);
        let middle = if together == 0 {
            inverse * scores.scale2
        } else {
            let mut rows = vec![Vec::new(); self.points.len()];
            rows.iter_mut().enumerate().for_each(|(i, row)| self.slopes(at, i, row));
            let b = long_run(&rows, &scores.psi, &sequences, together, n);
            let scaled = DMatrix::from_fn(n, n, |i, j| b[(i, j)] / (size[i] * size[j]));
            let few = self.points.len() as f64 / freedom as f64;
            &inverse * scaled * &inverse * (few / (scores.slope * scores.slope))
        };
        let covariance = |i: usize, j: usize| middle[(i, j)] / (size[i] * size[j]);
        let mut shape = self.shape_of(at);
        let turns = (shape[4] / std::f64::consts::FRAC_PI_2).round();
        shape[4] -= turns * std::f64::consts::FRAC_PI_2;
        let mut order = [0, 1, 2, 3, 4];
        if turns.rem_euclid(2.0) == 1.0 {
            shape.swap(2, 3);
            order.swap(2, 3);
        }
        let factor = [1.0, 1.0, shape[2].exp(), shape[3].exp(), 1_f64.to_degrees()];
        let mut found = [[0.0; 5]; 5];
        for i in 0..self.shape {
            for j in 0..self.shape {
                found[i][j] = covariance(order[i], order[j]) * factor[i] * factor[j];
            }
        }
        let first = n - self.stars;
        let measured = |k: usize| Measured::new(at[k], covariance(k, k).sqrt());
        Ok(FieldFit {
            offset_px: DVec2::new(shape[0], shape[1]),
            sigma_px: DVec2::new(factor[2], factor[3]),
            angle_deg: shape[4].to_degrees(),
            covariance: found,
            amplitudes_hz: names
                .iter()
                .enumerate()
                .map(|(k, name)| (*name, measured(first + k)))
                .collect(),
            background_hz: if self.background { measured(self.shape) } else { Measured::default() },
            scatter: scores.scale2.sqrt(),
            correlated_points: together,
            degrees_of_freedom: freedom,
            weights: self.weights.clone(),
        })
    }
}
