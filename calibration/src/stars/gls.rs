//! Generalised least squares on samples: stars are independent, what is measured of one star is not.

use super::sample::Sample;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Components of the variance of y beside counts and scintillation.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Scatter {
    /// Common to all channels of a star.
    pub common: f64,
    /// Each channel's own, the same in all visits to a star.
    pub own: Vec<f64>,
}

/// Which parameters the model has: for each channel ln κ and perhaps slopes, then perhaps one aerosol depth for all.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Model {
    pub channels: usize,
    /// The airmass that ln κ is of, where a slope against airmass is fitted.
    pub airmass: Option<f64>,
    /// The colour that ln κ is of, where a slope against colour is fitted.
    pub colour: Option<f64>,
    /// Whether an aerosol depth is fitted.
    pub aerosol: bool,
}

impl Model {
    /// ln κ alone.
    pub fn plain(channels: usize) -> Self {
        Self { channels, airmass: None, colour: None, aerosol: false }
    }

    /// Parameters of a channel.
    pub fn per_channel(&self) -> usize {
        1 + usize::from(self.airmass.is_some()) + usize::from(self.colour.is_some())
    }

    pub fn parameters(&self) -> usize {
        self.channels * self.per_channel() + usize::from(self.aerosol)
    }

    /// A row of the design: what each parameter adds to y of a channel of a sample.
    fn row(&self, sample: &Sample, channel: usize) -> Vec<(usize, f64)> {
        let first = channel * self.per_channel();
        let mut row = vec![(first, 1.0)];
        let mut next = first + 1;
        if let Some(mean) = self.airmass {
            row.push((next, sample.airmass - mean));
            next += 1;
        }
        if let Some(mean) = self.colour {
            row.push((next, sample.colour.map_or(0.0, |c| c - mean)));
        }
        if self.aerosol {
            let depth = sample.points[channel].and_then(|p| p.per_depth).unwrap_or(0.0);
            row.push((self.parameters() - 1, depth));
        }
        row
    }

    /// Returns the model's value of y.
    pub fn value(&self, parameters: &DVector<f64>, sample: &Sample, channel: usize) -> f64 {
        self.row(sample, channel).iter().map(|(i, v)| parameters[*i] * v).sum()
    }
}

/// The normal equations A p = b of one star.
#[derive(Debug, Clone)]
pub(super) struct Normal {
    pub a: DMatrix<f64>,
    pub b: DVector<f64>,
}

/// The normal equations of what was measured of one star.
pub(super) fn normal(star: &[&Sample], scatter: &Scatter, model: &Model) -> Option<Normal> {
    let rows: Vec<(usize, usize)> = star
        .iter()
        .enumerate()
        .flat_map(|(v, s)| {
            let used = s.points.iter().enumerate().filter(|(_, p)| p.is_some());
            used.map(move |(c, _)| (v, c))
        })
        .collect();
    let point = |(v, c): (usize, usize)| star[v].points[c];
    let covariance = DMatrix::from_fn(rows.len(), rows.len(), |i, j| {
        let ((v, c), (w, d)) = (rows[i], rows[j]);
        let mut value = scatter.common;
        if c == d {
            value += scatter.own[c];
        }
        if v == w {
            value += star[v].scintillation;
        }
        if i == j {
            value += point(rows[i]).map_or(0.0, |p| p.counts);
        }
        value
    });
    let mut x = DMatrix::zeros(rows.len(), model.parameters());
    let mut y = DVector::zeros(rows.len());
    for (i, &(v, c)) in rows.iter().enumerate() {
        model.row(star[v], c).into_iter().for_each(|(k, value)| x[(i, k)] = value);
        y[i] = point((v, c))?.y;
    }
    let factor = Cholesky::new(covariance)?;
    let l = factor.l_dirty();
    l.solve_lower_triangular_mut(&mut x).then_some(())?;
    l.solve_lower_triangular_mut(&mut y).then_some(())?;
    Some(Normal { a: x.tr_mul(&x), b: x.tr_mul(&y) })
}

/// A solution: the parameters, and their covariance.
#[derive(Debug, Clone)]
pub(super) struct Solution {
    pub parameters: DVector<f64>,
    pub covariance: DMatrix<f64>,
}

/// Sums the stars' equations and solves them. A channel that nobody measured keeps `NaN`; `None` where what is left has no solution.
pub(super) fn solve<'a>(stars: impl IntoIterator<Item = &'a Normal>) -> Option<Solution> {
    let mut stars = stars.into_iter();
    let first = stars.next()?;
    let (mut a, mut b) = (first.a.clone(), first.b.clone());
    for star in stars {
        a += &star.a;
        b += &star.b;
    }
    solve_sums(a, b)
}

fn solve_sums(mut a: DMatrix<f64>, b: DVector<f64>) -> Option<Solution> {
    let n = b.len();
    let unknown: Vec<usize> = (0..n).filter(|i| a[(*i, *i)] <= 0.0).collect();
    unknown.iter().for_each(|i| a[(*i, *i)] = 1.0);
    // Scaled to a unit diagonal, so that "singular" means the same for slopes as for κ.
    let scale = DVector::from_fn(n, |i, _| 1.0 / a[(i, i)].sqrt());
    let scaled = DMatrix::from_fn(n, n, |i, j| a[(i, j)] * scale[i] * scale[j]);
    let factor: Cholesky<f64, Dyn> = Cholesky::new(scaled)?;
    let smallest = factor.l_dirty().diagonal().min();
    if smallest < 1e-6 {
        return None;
    }
    let parameters = factor.solve(&b.component_mul(&scale)).component_mul(&scale);
    let inverse = factor.inverse();
    let covariance = DMatrix::from_fn(n, n, |i, j| inverse[(i, j)] * scale[i] * scale[j]);
    let mut solution = Solution { parameters, covariance };
    for i in unknown {
        solution.parameters[i] = f64::NAN;
        solution.covariance.row_mut(i).fill(f64::NAN);
        solution.covariance.column_mut(i).fill(f64::NAN);
    }
    Some(solution)
}

/// Samples by star, in the order of the stars' numbers.
pub(super) fn by_star<'a>(samples: impl IntoIterator<Item = &'a Sample>) -> Vec<Vec<&'a Sample>> {
    let mut groups: Vec<(usize, Vec<&Sample>)> = Vec::new();
    for sample in samples {
        match groups.iter_mut().find(|(star, _)| *star == sample.star) {
            Some((_, group)) => group.push(sample),
            None => groups.push((sample.star, vec![sample])),
        }
    }
    groups.sort_by_key(|(star, _)| *star);
    groups.into_iter().map(|(_, group)| group).collect()
}

/// Fits samples, star by star.
pub(super) fn fit<'a>(
    samples: impl IntoIterator<Item = &'a Sample>,
    scatter: &Scatter,
    model: &Model,
) -> Option<(Vec<Normal>, Solution)> {
    let groups = by_star(samples);
    let stars: Vec<Normal> =
        groups.iter().map(|star| normal(star, scatter, model)).collect::<Option<_>>()?;
    let solution = solve(&stars)?;
    Some((stars, solution))
}
