//! A two-dimensional normal distribution through rates at places.
//!
//! A place that is known to a covariance C spreads the field: the mean rate there is A √(|S|/|S+C|) exp(−½ dᵀ(S+C)⁻¹d) + b, with S the field's own
//! covariance, so that σ_x and σ_y come out as the fibre's and not as those of fibre and centroids together.
//!
//! Rates are weighted by what they are off by and share ([`super::noise`]). Intervals go as far as the weighted sum of squares with all other numbers
//! fitted anew rises by 1.96² (profile likelihood): stars that stand near the middle tell 1/σ², not σ, and a width that came out small is not known better.

use super::correlated::{long_run, reach, sequences};
use super::noise::{Factor, Light, Likeliest, Row, Star, WIDTH};
use super::{Between, FieldPoint};
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
    /// Whether rates may scatter beyond their σ by a part of the star's light, as twinkling makes them; the part is each star's own and is fitted.
    pub twinkling: bool,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self { rotation: false, background: false, robust: true, twinkling: true }
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
    /// Covariance of x₀, y₀, σ_x, σ_y (px) and the angle (deg): by the points' own scatter and what their places share, and where residuals are still
    /// alike in a row as much wider; zeros for an angle that was not fitted.
    pub covariance: [[f64; 5]; 5],
    /// Intervals of x₀, y₀, σ_x, σ_y that hold 95 %, px; without an end where the points set none: the stars of a field that is wide against their ways
    /// may as well have seen a wider one.
    pub intervals_px: [Interval; 4],
    /// Rate of each star at the centre and its standard uncertainty, Hz; stars in increasing number.
    pub amplitudes_hz: Vec<(usize, Measured)>,
    /// Background and its standard uncertainty, Hz; zeros where none was fitted.
    pub background_hz: Measured,
    /// Scatter of the points about the fit over their stated uncertainty: above 1 where scintillation, ghosts or places are worse than stated.
    pub scatter: f64,
    /// Over how many points of a star, in their order, residuals are alike beyond what places share; 0 where each errs for itself.
    pub correlated_points: usize,
    /// Points less numbers fitted.
    pub degrees_of_freedom: usize,
    /// How much each point counted, 0 to 1.
    pub weights: Vec<f64>,
}

/// An interval, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// Lower end; `None` where the points set none.
    pub low_px: Option<f64>,
    /// Upper end; `None` where the points set none.
    pub high_px: Option<f64>,
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

/// Standard deviations of a 95 % interval.
const WIDE: f64 = 1.96;
/// Scatter of rates for the start, as a part of them.
const START: f64 = 0.02;
/// An interval that goes on to so many times the width has no end.
const WIDEST: f64 = 20.0;
/// Gain of the last step of a descent, as a part of the cost, which is about the number of points: of the fit, and of the ends of intervals.
const GAIN: f64 = 1e-12;
const ROUGH: f64 = 1e-7;
/// Rounds of noise and fit, at most.
const ROUNDS: usize = 50;
/// Square of the standard deviations by which a round moves the fit when it is the last.
const STILL: f64 = 1e-8;

/// The points, star by star, which numbers are fitted (shape (4 or 5), background (0 or 1), amplitudes), and the noise as it is known so far.
struct Problem<'a> {
    points: &'a [FieldPoint],
    /// The star of each point.
    star: Vec<usize>,
    stars: Vec<Star>,
    shape: usize,
    background: bool,
    weights: Vec<f64>,
    /// Twinkling of each star; `None` where rates scatter by their σ alone.
    twinkling: Option<Vec<Likeliest>>,
    factors: Vec<Factor>,
    /// A number that stays where it is.
    held: Option<usize>,
}

/// Fits the field.
///
/// # Errors
/// Too few points, points that are none, points that leave the field open: all at one place, or all where the field is flat.
pub fn fit_field(points: &[FieldPoint], options: &FitOptions) -> Result<FieldFit, FitError> {
    for (i, p) in points.iter().enumerate() {
        if !is_point(p) {
            return Err(FitError::Point(i + 1));
        }
    }
    let names: Vec<usize> =
        points.iter().map(|p| p.star).collect::<BTreeSet<_>>().into_iter().collect();
    let star: Vec<usize> =
        points.iter().map(|p| names.partition_point(|name| *name < p.star)).collect();
    let stars = sequences(&star, names.len());
    let mut problem = Problem {
        points,
        star,
        stars: stars.into_iter().map(|own| Star::new(points, own)).collect(),
        shape: if options.rotation { 5 } else { 4 },
        background: options.background,
        weights: vec![1.0; points.len()],
        twinkling: None,
        factors: Vec::new(),
        held: None,
    };
    let n = problem.parameters();
    if points.len() <= n {
        return Err(FitError::TooFew { found: points.len(), parameters: n });
    }
    if options.twinkling {
        // Until there is a model a rate's light is the rate.
        let start = Likeliest { ln: 2.0 * START.ln(), variance: 0.0 };
        problem.twinkling = Some(vec![start; names.len()]);
    }
    let light = |p: &FieldPoint| Light { hz: p.rate_hz, slope: DVec2::ZERO };
    problem.factors = problem.factors(&points.iter().map(light).collect::<Vec<_>>())?;
    let mut best: Option<(f64, DVector<f64>)> = None;
    for scale in [1.0, 0.5, 2.0] {
        let (cost, at) = problem.descend(problem.start(scale)?, GAIN);
        if best.as_ref().is_none_or(|(least, _)| cost < *least) {
            best = Some((cost, at));
        }
    }
    let Some((_, mut at)) = best else { return Err(FitError::Undetermined("no start")) };
    let freedom = points.len() - n;
    for round in 0..ROUNDS {
        let light = problem.light(&at);
        if round == 0 {
            problem.guess(&at, &light);
        }
        if options.robust {
            problem.weights = problem.alone(&at, &light, freedom).map(biweight).collect();
        }
        problem.factors = problem.factors(&light)?;
        let (_, next) = problem.descend(at.clone(), GAIN);
        let (matrix, _) = problem.normal(&next);
        let step = &next - &at;
        at = next;
        let moved = step.dot(&(&matrix * &step));
        let settled = problem.twinkle(&at, &matrix);
        if round > 0 && settled && moved < STILL {
            break;
        }
    }
    let light = problem.light(&at);
    let slope = if options.robust {
        let u: Vec<f64> = problem.alone(&at, &light, freedom).collect();
        problem.weights = u.iter().map(|u| biweight(*u)).collect();
        u.iter().map(|u| biweight_slope(*u)).sum::<f64>() / u.len() as f64
    } else {
        1.0
    };
    problem.factors = problem.factors(&light)?;
    let weights = std::mem::replace(&mut problem.weights, vec![1.0; points.len()]);
    let plain = problem.factors(&light)?;
    problem.weights = weights;
    problem.result(at, &names, &plain, slope, options.robust)
}

/// Whether a point's numbers can be used.
fn is_point(p: &FieldPoint) -> bool {
    let numbers = [p.offset_px[0], p.offset_px[1], p.rate_hz, p.sigma_hz];
    // A target that moves on a line has xy² = xx yy, but for rounding.
    let is_covariance = |c: &[f64; 3]| {
        c.iter().all(|v| v.is_finite())
            && c[0] >= 0.0
            && c[1] >= 0.0
            && c[2] * c[2] <= c[0] * c[1] * (1.0 + 1e-9)
    };
    let is_between = |at: &Between| {
        (0.0..=1.0).contains(&at.part)
            && [at.span_s, at.exposure_s, at.wander_px2_per_s]
                .iter()
                .all(|v| v.is_finite() && *v >= 0.0)
            && at.frames_px2.iter().all(is_covariance)
    };
    numbers.iter().all(|v| v.is_finite())
        && p.sigma_hz > 0.0
        && is_covariance(&p.covariance_px2)
        && p.between.as_ref().is_none_or(is_between)
}

/// 1.4826 times the median of |r|, with the degrees of freedom that the fit took.
fn spread(residuals: &[f64], freedom: usize) -> f64 {
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
        let (matrix, downhill) = self.0.normal(&place.numbers);
        Ok(Normal { matrix, downhill })
    }

    fn step(&mut self, from: &At, step: &mut DVector<f64>) -> Result<At, Self::Error> {
        Ok(self.0.at(&from.numbers + &*step))
    }

    fn is_held(&self, _place: &At, number: usize, _downhill: f64) -> bool {
        self.0.held == Some(number)
    }
}

impl Problem<'_> {
    fn parameters(&self) -> usize {
        self.first() + self.stars.len()
    }

    /// Number of the first amplitude.
    fn first(&self) -> usize {
        self.shape + usize::from(self.background)
    }

    fn shape_of(&self, at: &DVector<f64>) -> Shape {
        let mut shape = [0.0; 5];
        shape[..self.shape].copy_from_slice(&at.as_slice()[..self.shape]);
        shape
    }

    /// Number of the fit that belongs to a place in a row of a star.
    fn number(&self, star: usize, place: usize) -> usize {
        if place < self.first() { place } else { self.first() + star }
    }

    /// From the moments of the points above half of their star's largest, with `scale` times their width.
    fn start(&self, scale: f64) -> Result<DVector<f64>, FitError> {
        let mut most = vec![f64::NEG_INFINITY; self.stars.len()];
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
        let first = self.first();
        for (star, most) in most.into_iter().enumerate() {
            at[first + star] = most;
        }
        Ok(at)
    }

    /// Rate less model, Hz.
    fn residual(&self, at: &DVector<f64>, i: usize) -> f64 {
        let background = if self.background { at[self.shape] } else { 0.0 };
        let amplitude = at[self.first() + self.star[i]];
        let profile = profile(&self.shape_of(at), &self.points[i]);
        self.points[i].rate_hz - background - amplitude * profile
    }

    /// Residuals of a star times L⁻¹, in the star's order.
    fn whitened(&self, at: &DVector<f64>, star: usize) -> Vec<f64> {
        let own = &self.stars[star];
        let row = |i: &usize| {
            let mut row = [0.0; WIDTH];
            row[WIDTH - 1] = self.residual(at, *i);
            row
        };
        let mut rows: Vec<Row> = own.points.iter().map(row).collect();
        own.whiten(&self.factors[star], &mut rows);
        rows.iter().map(|row| row[WIDTH - 1]).collect()
    }

    fn cost(&self, at: &DVector<f64>) -> f64 {
        (0..self.stars.len()).flat_map(|star| self.whitened(at, star)).map(|r| r * r).sum()
    }

    /// Light at each point and its slopes by the place.
    fn light(&self, at: &DVector<f64>) -> Vec<Light> {
        let slopes = (0..self.points.len()).map(|i| {
            let amplitude = at[self.first() + self.star[i]];
            let row = self.slopes(at, i);
            // The field moves the other way.
            Light { hz: amplitude * row[self.first()], slope: -DVec2::new(row[0], row[1]) }
        });
        slopes.collect()
    }

    /// Slopes of a point's model by each number that it depends on, Hz, and the residual behind them.
    fn slopes(&self, at: &DVector<f64>, i: usize) -> Row {
        let shape = self.shape_of(at);
        let point = &self.points[i];
        let amplitude = at[self.first() + self.star[i]];
        let mut row = [0.0; WIDTH];
        for k in 0..self.shape {
            // Central differences: a hundred-thousandth of the width, or of the logarithms.
            let step = 1e-5 * if k < 2 { shape[k + 2].exp() } else { 1.0 };
            let (mut up, mut down) = (shape, shape);
            up[k] += step;
            down[k] -= step;
            let slope = (profile(&up, point) - profile(&down, point)) / (2.0 * step);
            row[k] = amplitude * slope;
        }
        if self.background {
            row[self.shape] = 1.0;
        }
        row[self.first()] = profile(&shape, point);
        row[WIDTH - 1] = self.residual(at, i);
        row
    }

    /// Slopes and residuals of a star in its order, times L⁻¹ of a factor.
    fn rows(&self, at: &DVector<f64>, star: usize, factor: &Factor) -> Vec<Row> {
        let own = &self.stars[star];
        let mut rows: Vec<Row> = own.points.iter().map(|i| self.slopes(at, *i)).collect();
        own.whiten(factor, &mut rows);
        rows
    }

    /// JᵀV⁻¹J and JᵀV⁻¹r.
    fn normal(&self, at: &DVector<f64>) -> (DMatrix<f64>, DVector<f64>) {
        self.normal_by(at, &self.factors)
    }

    fn normal_by(&self, at: &DVector<f64>, factors: &[Factor]) -> (DMatrix<f64>, DVector<f64>) {
        let n = self.parameters();
        let (mut matrix, mut vector) = (DMatrix::zeros(n, n), DVector::zeros(n));
        for (star, factor) in factors.iter().enumerate() {
            for row in self.rows(at, star, factor) {
                for a in 0..=self.first() {
                    let to = self.number(star, a);
                    vector[to] += row[a] * row[WIDTH - 1];
                    for b in 0..=self.first() {
                        matrix[(to, self.number(star, b))] += row[a] * row[b];
                    }
                }
            }
        }
        (matrix, vector)
    }

    fn s2(&self, star: usize) -> f64 {
        self.twinkling.as_ref().map_or(0.0, |found| found[star].ln.exp())
    }

    /// Factors of all stars' covariances, by the weights.
    fn factors(&self, light: &[Light]) -> Result<Vec<Factor>, FitError> {
        let factor = |(star, own): (usize, &Star)| {
            own.factor(self.points, light, self.s2(star), &self.weights)
        };
        let factors: Option<Vec<Factor>> = self.stars.iter().enumerate().map(factor).collect();
        factors.ok_or(FitError::Undetermined("the covariances of the places are none"))
    }

    /// First guess of the stars' twinkling.
    fn guess(&mut self, at: &DVector<f64>, light: &[Light]) {
        let residuals: Vec<f64> = (0..self.points.len()).map(|i| self.residual(at, i)).collect();
        if let Some(twinkling) = &mut self.twinkling {
            for (found, star) in twinkling.iter_mut().zip(&self.stars) {
                found.ln = star.first_guess(self.points, light, &residuals);
            }
        }
    }

    /// Twinkling by the restricted likelihood, where there is any. Returns whether it hardly changed.
    fn twinkle(&mut self, at: &DVector<f64>, matrix: &DMatrix<f64>) -> bool {
        let Some(before) = self.twinkling.take() else { return true };
        let light = self.light(at);
        let mean = before.iter().map(|found| found.ln).sum::<f64>() / before.len() as f64;
        // Where the points leave something open no degree of freedom is taken off.
        let covariance = inverse(matrix);
        let width = self.first() + 1;
        let likeliest = |(star, own): (usize, &Star)| {
            let mut rows: Vec<Row> = own.points.iter().map(|i| self.slopes(at, *i)).collect();
            let numbers: Vec<usize> = (0..width).map(|place| self.number(star, place)).collect();
            let root = covariance.as_ref().and_then(|c| root(c, &numbers));
            for row in &mut rows {
                let mut slopes = [0.0; WIDTH];
                if let Some(root) = &root {
                    for a in 0..width {
                        slopes[a] = (a..width).map(|b| row[b] * root[(b, a)]).sum();
                    }
                }
                slopes[WIDTH - 1] = row[WIDTH - 1];
                *row = slopes;
            }
            own.likeliest(self.points, &light, &self.weights, &rows, (before[star].ln, mean))
        };
        let found: Vec<Likeliest> = self.stars.iter().enumerate().map(likeliest).collect();
        let settled = found.iter().zip(&before).all(|(a, b)| (a.ln - b.ln).abs() < 0.05);
        self.twinkling = Some(found);
        settled
    }

    /// The covariance C of the fit with what is not known of the twinkling: C + 2C ΣW(Q − PCP)C (Kenward and Roger 1997, equation 5 and below), W the variances of ln s², P and Q the
    /// slopes' products with the change of V once and twice.
    fn with_twinkling(
        &self,
        at: &DVector<f64>,
        light: &[Light],
        plain: &[Factor],
        covariance: &DMatrix<f64>,
    ) -> DMatrix<f64> {
        let Some(twinkling) = &self.twinkling else { return covariance.clone() };
        let n = covariance.nrows();
        let mut sum = DMatrix::<f64>::zeros(n, n);
        for (star, (own, found)) in self.stars.iter().zip(twinkling).enumerate() {
            let slopes = self.rows(at, star, &plain[star]);
            let changed = own.by_twinkling(&plain[star], light, found.ln.exp(), &slopes);
            let (mut p, mut q) = (DMatrix::<f64>::zeros(n, n), DMatrix::<f64>::zeros(n, n));
            for (slope, change) in slopes.iter().zip(&changed) {
                for a in 0..=self.first() {
                    for b in 0..=self.first() {
                        let to = (self.number(star, a), self.number(star, b));
                        p[to] += slope[a] * change[b];
                        q[to] += change[a] * change[b];
                    }
                }
            }
            sum += (q - &p * covariance * &p) * found.variance;
        }
        covariance + covariance * sum * covariance * 2.0
    }

    /// Each point's residual over its own standard deviation, and over the spread of all where that is larger.
    fn alone(
        &self,
        at: &DVector<f64>,
        light: &[Light],
        freedom: usize,
    ) -> impl Iterator<Item = f64> + use<> {
        let mut u = vec![0.0; self.points.len()];
        for (star, own) in self.stars.iter().enumerate() {
            let variances = own.variances(self.points, light, self.s2(star));
            for (i, variance) in own.points.iter().zip(variances) {
                u[*i] = self.residual(at, *i) / variance.sqrt();
            }
        }
        let spread = match self.twinkling {
            Some(_) => spread(&u, freedom).max(1.0),
            None => spread(&u, freedom),
        };
        u.into_iter().map(move |u| u / spread)
    }

    fn at(&self, numbers: DVector<f64>) -> At {
        let cost = self.cost(&numbers);
        At { numbers, cost: if cost.is_nan() { f64::INFINITY } else { cost } }
    }

    /// Down to a minimum: until a step gains less than this part of the cost.
    fn descend(&self, start: DVector<f64>, gain: f64) -> (f64, DVector<f64>) {
        let limits = Limits { steps: 200, gain, step: 0.0 };
        let Ok(found) = minimise(&mut Descending(self), self.at(start), &limits);
        (found.place.cost, found.place.numbers)
    }

    /// Where √(cost − least) of a number, all others fitted anew, reaches `far` on one side; `None` where it does not before `most`, steps from `sigma` on.
    fn end(
        &mut self,
        at: &DVector<f64>,
        number: usize,
        side: f64,
        (sigma, most): (f64, f64),
        far: f64,
    ) -> Option<f64> {
        let least = self.cost(at);
        self.held = Some(number);
        let mut from = at.clone();
        let mut rise = |problem: &Self, off: f64| {
            let mut start = from.clone();
            start[number] = at[number] + side * off;
            let (cost, found) = problem.descend(start, ROUGH);
            from = found;
            (cost - least).max(0.0).sqrt()
        };
        let (mut low, mut high) = ((0.0, 0.0), None);
        let mut off = (WIDE * sigma).min(most);
        for _ in 0..40 {
            let risen = rise(self, off);
            if risen < far {
                low = (off, risen)
            } else {
                high = Some((off, risen))
            }
            if (risen - far).abs() < 1e-3 * far {
                high = Some((off, risen));
                low = (off, risen);
                break;
            }
            off = match high {
                // On the line between both, and at least a tenth of the way from either.
                Some((end, over)) => {
                    let part: f64 = (far - low.1) / (over - low.1);
                    low.0 + part.clamp(0.1, 0.9) * (end - low.0)
                }
                None if off >= most => break,
                None => (1.6 * off).min(most),
            };
        }
        self.held = None;
        high.map(|_| at[number] + side * low.0)
    }

    fn result(
        mut self,
        at: DVector<f64>,
        names: &[usize],
        plain: &[Factor],
        slope: f64,
        robust: bool,
    ) -> Result<FieldFit, FitError> {
        let (matrix, _) = self.normal_by(&at, plain);
        let n = matrix.nrows();
        if (0..n).any(|k| !(matrix[(k, k)].is_finite() && matrix[(k, k)] > 0.0)) {
            return Err(FitError::Undetermined("a number has no effect on any point"));
        }
        let open = FitError::Undetermined(
            "some of its numbers can change together without a trace; more places are needed",
        );
        let Some(inverse_plain) = inverse(&matrix) else { return Err(open) };
        let freedom = self.points.len() - n;
        let few = self.points.len() as f64 / freedom as f64;
        let (mut psi, mut rows) =
            (vec![0.0; self.points.len()], vec![Vec::new(); self.points.len()]);
        for (star, factor) in plain.iter().enumerate() {
            let whitened = self.whitened(&at, star);
            let scores = self.stars[star].scores(&self.factors[star], factor, &whitened);
            let slopes = self.rows(&at, star, factor);
            for ((i, score), row) in self.stars[star].points.iter().zip(scores).zip(slopes) {
                psi[*i] = score;
                rows[*i] = (0..=self.first())
                    .map(|place| (self.number(star, place), row[place]))
                    .collect();
            }
        }
        // The variance of an M-estimate: Σψ²/(n−p) over the square of the mean of ψ'.
        let scale2 = psi.iter().map(|psi| psi * psi).sum::<f64>() / freedom as f64 / slope.powi(2);
        let orders: Vec<Vec<usize>> = self.stars.iter().map(|star| star.points.clone()).collect();
        let together = reach(&psi, &orders);
        let light = self.light(&at);
        let mut covariance = self.with_twinkling(&at, &light, plain, &inverse_plain) * scale2;
        if together > 0 {
            let b = long_run(&rows, &psi, &orders, together, n);
            let mut wide = &inverse_plain * b * &inverse_plain * (few / slope.powi(2));
            // Correlated residuals make nothing better known: few points may look so by chance.
            let size =
                DVector::from_fn(n, |k, _| (covariance[(k, k)] / wide[(k, k)]).max(1.0).sqrt());
            wide = DMatrix::from_fn(n, n, |i, j| wide[(i, j)] * size[i] * size[j]);
            covariance = wide;
        }
        let (by_cost, _) = self.normal(&at);
        let Some(by_cost) = inverse(&by_cost) else { return Err(open) };
        let mut ends = [[None; 2]; 4];
        for (k, ends) in ends.iter_mut().enumerate() {
            // The cost is taken to rise as fast as the covariance says.
            let far = WIDE * (covariance[(k, k)] / by_cost[(k, k)]).sqrt();
            let sigma = covariance[(k, k)].sqrt();
            // A field so much wider, or so far away, is as good as none.
            let most = if k < 2 { WIDEST * at[k + 2].exp() } else { WIDEST.ln() };
            *ends = [-1.0, 1.0].map(|side| self.end(&at, k, side, (sigma, most), far));
        }
        let mut shape = self.shape_of(&at);
        let turns = (shape[4] / std::f64::consts::FRAC_PI_2).round();
        shape[4] -= turns * std::f64::consts::FRAC_PI_2;
        let mut order = [0, 1, 2, 3, 4];
        if turns.rem_euclid(2.0) == 1.0 {
            shape.swap(2, 3);
            ends.swap(2, 3);
            order.swap(2, 3);
        }
        let interval = |k: usize| {
            let px = |end: f64| if k < 2 { end } else { end.exp() };
            Interval { low_px: ends[k][0].map(px), high_px: ends[k][1].map(px) }
        };
        let factor = [1.0, 1.0, shape[2].exp(), shape[3].exp(), 1_f64.to_degrees()];
        let mut found = [[0.0; 5]; 5];
        for i in 0..self.shape {
            for j in 0..self.shape {
                found[i][j] = covariance[(order[i], order[j])] * factor[i] * factor[j];
            }
        }
        let first = self.first();
        let measured = |k: usize| Measured::new(at[k], covariance[(k, k)].sqrt());
        let stated: Vec<f64> = (0..self.points.len())
            .map(|i| self.residual(&at, i) / self.points[i].sigma_hz)
            .collect();
        Ok(FieldFit {
            offset_px: DVec2::new(shape[0], shape[1]),
            sigma_px: DVec2::new(factor[2], factor[3]),
            angle_deg: shape[4].to_degrees(),
            covariance: found,
            intervals_px: [0, 1, 2, 3].map(interval),
            amplitudes_hz: names
                .iter()
                .enumerate()
                .map(|(k, name)| (*name, measured(first + k)))
                .collect(),
            background_hz: if self.background { measured(self.shape) } else { Measured::default() },
            scatter: if robust {
                spread(&stated, freedom)
            } else {
                (stated.iter().map(|r| r * r).sum::<f64>() / freedom as f64).sqrt()
            },
            correlated_points: together,
            degrees_of_freedom: freedom,
            weights: self.weights,
        })
    }
}

/// The inverse of a normal matrix; `None` where it is nearly singular, which shows when it is scaled to a unit diagonal.
fn inverse(matrix: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = matrix.nrows();
    let size = DVector::from_fn(n, |k, _| matrix[(k, k)].sqrt());
    if size.iter().any(|s| !(s.is_finite() && *s > 0.0)) {
        return None;
    }
    let scaled = DMatrix::from_fn(n, n, |i, j| matrix[(i, j)] / (size[i] * size[j]));
    let least = scaled.clone().symmetric_eigenvalues().min();
    if least.is_nan() || least < 1e-9 {
        return None;
    }
    let inverse = scaled.try_inverse()?;
    Some(DMatrix::from_fn(n, n, |i, j| inverse[(i, j)] / (size[i] * size[j])))
}

/// R of the covariance RRᵀ of some numbers.
fn root(covariance: &DMatrix<f64>, numbers: &[usize]) -> Option<DMatrix<f64>> {
    let n = numbers.len();
    let size = |i: usize| covariance[(numbers[i], numbers[i])].sqrt();
    let scaled =
        DMatrix::from_fn(n, n, |i, j| covariance[(numbers[i], numbers[j])] / (size(i) * size(j)));
    let root = scaled.cholesky()?.unpack();
    Some(DMatrix::from_fn(n, n, |i, j| root[(i, j)] * size(i)))
}
