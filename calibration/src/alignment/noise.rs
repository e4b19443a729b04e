//! Errors of a star's rates, and how much of them its points share.
//!
//! The rate A p(x) + b of a star at a place x is off by three things:
//!
//! - counting, σ, which is stated;
//! - twinkling, s A p: in proportion to the star's light, each bin for itself, s unknown and each star's own;
//! - the place, g·δ with g = A ∂p/∂x. Places between the same two frames, at parts w and w′ of the way, share the errors of both frames and what the
//!   telescope did between them. As a random walk of D px²/s that is known at both ends (a Brownian bridge) this has the covariance
//!   D Δt (min(w, w′) − w w′). A bin of length T is the mean over it, whose own variance is less by D T/6, and D T/12 on a frame itself.
//!
//! Together they make a covariance V for each star. A fit is weighted by V⁻¹ (generalised least squares): points and slopes are multiplied by L⁻¹, with
//! V = LLᵀ. V couples a point with those between the same frames and the next ones, so that L keeps the short rows of V.
//!
//! s² is what makes the residuals likeliest, those degrees of freedom left out that the fit took (restricted likelihood, Patterson and Thompson 1971), with
//! the stars' s² alike within a factor: ln s² scatters by 0.8 about its mean, as between one and two airmasses. A star of many points is not moved by that.
//! Twenty points tell s² to a third. Weights by such variances make the fit a little worse and let it look a little better than it is; both together are
//! the term of Kenward and Roger (1997), which is added to the covariance.

use super::FieldPoint;
use crate::track::MEDIAN_CHI2;
use glam::DVec2;
use sunglint_numerics::order::median;

/// Numbers of a row: up to five of the shape, background, amplitude, and the residual.
pub(super) const WIDTH: usize = 8;
/// A point's slopes and its residual.
pub(super) type Row = [f64; WIDTH];

/// Standard deviation of ln s² from star to star.
const ALIKE: f64 = 0.8;
/// ln s² of 1e-5, less than any rate is known to, and of the star's whole light.
const RANGE: [f64; 2] = [-23.0, 0.0];
/// Step of ln s² by which the bend of the likelihood is found.
const STEP: f64 = 0.5;

/// A star's twinkling: ln s² and its variance.
#[derive(Debug, Clone, Copy)]
pub(super) struct Likeliest {
    pub ln: f64,
    pub variance: f64,
}

/// Light at a point and its slopes by the place, Hz and Hz/px.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Light {
    pub hz: f64,
    pub slope: DVec2,
}

/// Points of a star with the covariances of their places.
#[derive(Debug)]
pub(super) struct Star {
    /// The points, those between the same frames together.
    pub points: Vec<usize>,
    /// Covariances of a point's place with those from `first` to the point itself: xx, yy, xy, px².
    places: Vec<Vec<[f64; 3]>>,
    /// The first point of each row.
    first: Vec<usize>,
}

/// Lower triangle L of V = LLᵀ, rows as in [`Star`].
#[derive(Debug)]
pub(super) struct Factor(Vec<Vec<f64>>);

/// Covariance of two points' places, px²; `None` for nothing.
fn shared(a: &FieldPoint, b: &FieldPoint) -> Option<[f64; 3]> {
    let (a, b) = (a.between?, b.between?);
    let (a, b) = if a.frame <= b.frame { (a, b) } else { (b, a) };
    match b.frame - a.frame {
        0 => {
            let bridge = a.wander_px2_per_s * a.span_s * (a.part.min(b.part) - a.part * b.part);
            let both = |k: usize| {
                (1.0 - a.part) * (1.0 - b.part) * a.frames_px2[0][k]
                    + a.part * b.part * a.frames_px2[1][k]
            };
            Some([both(0) + bridge, both(1) + bridge, both(2)])
        }
        1 => Some([0, 1, 2].map(|k| a.part * (1.0 - b.part) * a.frames_px2[1][k])),
        _ => None,
    }
}

/// Covariance of a point's own place, px².
fn own(point: &FieldPoint) -> [f64; 3] {
    let Some(at) = point.between else { return point.covariance_px2 };
    let way_s = at.part * (1.0 - at.part) * at.span_s - at.exposure_s / 6.0;
    let bridge = at.wander_px2_per_s * way_s.max(at.exposure_s / 12.0);
    let both = |k: usize| {
        (1.0 - at.part).powi(2) * at.frames_px2[0][k] + at.part.powi(2) * at.frames_px2[1][k]
    };
    [both(0) + bridge, both(1) + bridge, both(2)]
}

impl Star {
    /// A star of these points.
    pub fn new(all: &[FieldPoint], mut points: Vec<usize>) -> Self {
        let order = |i: &usize| all[*i].between.map_or((0, 0.0), |at| (at.frame, at.part));
        points.sort_by(|a, b| {
            let (a, b) = (order(a), order(b));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        });
        let (mut places, mut first) = (Vec::new(), Vec::new());
        for (row, i) in points.iter().enumerate() {
            let before = points[..row].iter().rev();
            let before = before.map_while(|j| shared(&all[*j], &all[*i]));
            let mut covariances: Vec<[f64; 3]> = before.collect();
            covariances.reverse();
            first.push(row - covariances.len());
            covariances.push(own(&all[*i]));
            places.push(covariances);
        }
        Self { points, places, first }
    }

    /// The place's part in the covariance of two rates, Hz².
    fn by_place(&self, row: usize, column: usize, light: &[Light]) -> f64 {
        let [xx, yy, xy] = self.places[row][column - self.first[row]];
        let [a, b] = [row, column].map(|k| light[self.points[k]].slope);
        a[0] * xx * b[0] + a[1] * yy * b[1] + xy * (a[0] * b[1] + a[1] * b[0])
    }

    /// The variance of each rate, Hz², in the star's order.
    pub fn variances(&self, all: &[FieldPoint], light: &[Light], s2: f64) -> Vec<f64> {
        let own = |(row, i): (usize, &usize)| {
            all[*i].sigma_hz.powi(2) + s2 * light[*i].hz.powi(2) + self.by_place(row, row, light)
        };
        self.points.iter().enumerate().map(own).collect()
    }

    /// L. A point that counts less (`weights`) has a larger variance of its own. `None` where the covariances of the places are none.
    pub fn factor(
        &self,
        all: &[FieldPoint],
        light: &[Light],
        s2: f64,
        weights: &[f64],
    ) -> Option<Factor> {
        let mut factor: Vec<Vec<f64>> = Vec::with_capacity(self.points.len());
        for (row, i) in self.points.iter().enumerate() {
            let from = self.first[row];
            let mut own: Vec<f64> =
                (from..=row).map(|column| self.by_place(row, column, light)).collect();
            let alone = all[*i].sigma_hz.powi(2) + s2 * light[*i].hz.powi(2);
            own[row - from] += alone / weights[*i].max(1e-9);
            for column in from..row {
                let other = &factor[column];
                let begin = from.max(self.first[column]);
                let sum: f64 =
                    (begin..column).map(|k| own[k - from] * other[k - self.first[column]]).sum();
                own[column - from] =
                    (own[column - from] - sum) / other[column - self.first[column]];
            }
            let pivot = own[row - from] - own[..row - from].iter().map(|l| l * l).sum::<f64>();
            if !(pivot.is_finite() && pivot > 0.0) {
                return None;
            }
            own[row - from] = pivot.sqrt();
            factor.push(own);
        }
        Some(Factor(factor))
    }

    /// L⁻¹ times rows that stand in the star's order.
    pub fn whiten(&self, factor: &Factor, rows: &mut [Row]) {
        for row in 0..rows.len() {
            let (done, rest) = rows.split_at_mut(row);
            let (own, from) = (&factor.0[row], self.first[row]);
            for (l, before) in own.iter().zip(&done[from..]) {
                rest[0].iter_mut().zip(before).for_each(|(value, before)| *value -= l * before);
            }
            rest[0].iter_mut().for_each(|value| *value /= own[row - from]);
        }
    }

    /// L₀ᵀ V⁻¹ r of residuals r that are whitened by the factor of V: what the plain factor L₀ makes of them if some points count less.
    pub fn scores(&self, factor: &Factor, plain: &Factor, whitened: &[f64]) -> Vec<f64> {
        // L⁻ᵀ from the last row on.
        let mut y = whitened.to_vec();
        for row in (0..y.len()).rev() {
            let (own, from) = (&factor.0[row], self.first[row]);
            y[row] /= own[row - from];
            for column in from..row {
                y[column] -= own[column - from] * y[row];
            }
        }
        let mut scores = vec![0.0; y.len()];
        for (row, own) in plain.0.iter().enumerate() {
            for (column, l) in (self.first[row]..).zip(own) {
                scores[column] += l * y[row];
            }
        }
        scores
    }

    /// ln s² at which the median of the squared residuals over their variances is that of χ²: where points are spoilt, too.
    pub fn first_guess(&self, all: &[FieldPoint], light: &[Light], residuals: &[f64]) -> f64 {
        let of = |ln: f64| {
            let variances = self.variances(all, light, ln.exp());
            let squares = self.points.iter().map(|i| residuals[*i].powi(2));
            median(squares.zip(variances).map(|(r2, v)| r2 / v)).unwrap_or(0.0)
        };
        let [mut low, mut high] = RANGE;
        for _ in 0..20 {
            let middle = 0.5 * (low + high);
            if of(middle) > MEDIAN_CHI2 { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }

    /// L⁻¹ (s²M) L⁻ᵀ times whitened slopes: how their weights change with ln s², M the squares of the star's light.
    pub fn by_twinkling(
        &self,
        factor: &Factor,
        light: &[Light],
        s2: f64,
        whitened: &[Row],
    ) -> Vec<Row> {
        let mut rows = whitened.to_vec();
        for row in (0..rows.len()).rev() {
            let (own, from) = (&factor.0[row], self.first[row]);
            let (before, rest) = rows.split_at_mut(row);
            rest[0].iter_mut().for_each(|value| *value /= own[row - from]);
            for (l, other) in own.iter().zip(&mut before[from..]) {
                other.iter_mut().zip(&rest[0]).for_each(|(value, own)| *value -= l * own);
            }
        }
        for (i, row) in self.points.iter().zip(&mut rows) {
            row.iter_mut().for_each(|value| *value *= s2 * light[*i].hz.powi(2));
        }
        self.whiten(factor, &mut rows);
        rows
    }

    /// ln s² of the largest restricted likelihood, near the one before, and its variance. `rows` hold the slopes times a root of the numbers' covariance, and the residual.
    pub fn likeliest(
        &self,
        all: &[FieldPoint],
        light: &[Light],
        weights: &[f64],
        rows: &[Row],
        (before, mean): (f64, f64),
    ) -> Likeliest {
        // A point either counts for the scatter or not: those that count less are no narrower.
        let counts: Vec<f64> = weights.iter().map(|w| if *w > 0.0 { 1.0 } else { 0.0 }).collect();
        let cost = |ln: f64| {
            let Some(factor) = self.factor(all, light, ln.exp(), &counts) else {
                return f64::INFINITY;
            };
            let mut rows = rows.to_vec();
            self.whiten(&factor, &mut rows);
            let squares: f64 = rows.iter().flatten().map(|v| v * v).sum();
            let diagonal = factor.0.iter().filter_map(|own| own.last());
            let volume: f64 = diagonal.map(|l| 2.0 * l.ln()).sum();
            volume + squares + ((ln - mean) / ALIKE).powi(2)
        };
        let near = |ln: f64| ln.clamp(RANGE[0], RANGE[1]);
        let ln = least(cost, [near(before - 1.5), near(before + 1.5)]);
        // Twice the logarithm of the likelihood falls by 1 within a standard deviation; the stars' likeness sets the most.
        let bend = (cost(ln + STEP) + cost(ln - STEP) - 2.0 * cost(ln)) / (STEP * STEP);
        let variance = if bend.is_finite() { 2.0 / bend.max(2.0 / (ALIKE * ALIKE)) } else { 0.0 };
        Likeliest { ln, variance }
    }
}

/// Least of a function between two ends, to 0.01, by the golden section.
fn least(cost: impl Fn(f64) -> f64, [mut low, mut high]: [f64; 2]) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_895;
    let mut inner = [high - GOLDEN * (high - low), low + GOLDEN * (high - low)];
    let mut costs = inner.map(&cost);
    while high - low > 0.01 {
        if costs[0] < costs[1] {
            high = inner[1];
            inner = [high - GOLDEN * (high - low), inner[0]];
            costs = [cost(inner[0]), costs[0]];
        } else {
            low = inner[0];
            inner = [inner[1], low + GOLDEN * (high - low)];
            costs = [costs[1], cost(inner[1])];
        }
    }
    0.5 * (low + high)
}
