//! Mixture of materials that makes the light of a sample, and its uncertainty.

use super::atgp::osp;
use super::nnls::{Constraint, Nnls, NnlsError};
use nalgebra::DMatrix;
use ndarray::{Array2, ArrayView2};
use sunglint_numerics::basis::{Basis, dot, norm};

/// Spectra that differ by less than this (sine of the angle between them) are one.
const SAME: f64 = 1e-10;
/// A rank is counted down to this, of the longest column's share.
const RANK: f64 = 1e-12;

/// Knowledge of the noise of a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Noise<'a> {
    /// Nothing: all channels count alike, and uncertainties follow from what is left over.
    Unknown,
    /// A standard uncertainty above 0 for each channel; channels count by their inverse squares.
    Independent(&'a [f64]),
    /// The covariance matrix, positive definite: scintillation moves channels together.
    Covariance(ArrayView2<'a, f64>),
}

/// Two endmembers that are hard to tell apart.
#[derive(Debug, Clone, PartialEq)]
pub struct Twins {
    /// Which, counted from 0.
    pub pair: [usize; 2],
    /// The angle between their spectra, radians.
    pub angle_rad: f64,
}

/// Why nothing can be unmixed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MixingError {
    /// Two endmembers of one spectrum.
    #[error(
        "{first} and {second} have one spectrum in these {channels} channels but for its scale: only their sum could be found; leave one of them out"
    )]
    Same {
        /// One.
        first: String,
        /// The other.
        second: String,
        /// Channels.
        channels: usize,
    },
    /// An endmember that reflects nothing.
    #[error("{name} reflects nothing in any of these {channels} channels: leave it out")]
    Black {
        /// Which.
        name: String,
        /// Channels.
        channels: usize,
    },
    /// Uncertainties that are none.
    #[error("channel {}: an uncertainty of {sigma}, expected a number above 0", channel + 1)]
    Sigma {
        /// Which, from 0.
        channel: usize,
        /// Value that was given.
        sigma: f64,
    },
    /// A covariance that is none.
    #[error(
        "the covariance of {channels} channels is {rows} x {columns}, or not positive definite"
    )]
    Covariance {
        /// Channels.
        channels: usize,
        /// Rows.
        rows: usize,
        /// Columns.
        columns: usize,
    },
    /// The fit.
    #[error(transparent)]
    Nnls(#[from] NnlsError),
}

/// A matrix of endmembers, channels × endmembers, checked.
#[derive(Debug, Clone)]
pub struct Mixing {
    matrix: Array2<f64>,
    /// The condition number of the matrix with its columns scaled to one length: by how much relative errors may grow.
    pub condition: f64,
    /// The number of endmembers that the channels can tell apart.
    pub rank: usize,
    /// The two endmembers that are nearest to each other; `None` of one endmember.
    pub nearest: Option<Twins>,
}

/// Mixture of materials in a sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Mixture {
    /// Amount of each endmember; exactly 0 where the bound holds it.
    pub weights: Vec<f64>,
    /// The weights that orthogonal subspace projection gives ([`super::osp`]): least squares with the same noise, without any bound or sum. Below 0 by more than `sigma` there is light that no endmember
    /// explains. NaN where the channels cannot tell.
    pub projected: Vec<f64>,
    /// Standard uncertainties, as if no bound held (a bound only makes them smaller): infinite where the channels cannot tell, NaN where nothing is known of the noise and nothing is left
    /// over.
    pub sigma: Vec<f64>,
    /// Their covariance.
    pub covariance: Array2<f64>,
    /// Weights over their sum; NaN where that is 0.
    pub shares: Vec<f64>,
    /// Standard uncertainties of the shares.
    pub share_sigma: Vec<f64>,
    /// True for the weights that a bound holds at 0.
    pub bounded: Vec<bool>,
    /// x − S a, in the unit of the data.
    pub residual: Vec<f64>,
    /// ‖x − S a‖/‖x‖; NaN without light.
    pub residual_relative: f64,
    /// Σ of squared residuals over their variances; `None` where the noise is unknown.
    pub chi_squared: Option<f64>,
    /// Channels less weights that are in use.
    pub freedom: usize,
    /// True where no other weights fit as well; where not, the weights are one answer of many.
    pub unique: bool,
    /// The largest violation of the conditions of an optimum ([`super::nnls::Solution::kkt`]).
    pub kkt: f64,
}

impl Mixing {
    /// A matrix of channels × endmembers with the endmembers' names.
    ///
    /// # Errors
    /// An endmember without light, two of one spectrum, numbers that are none.
    pub fn new(matrix: Array2<f64>, names: &[String]) -> Result<Self, MixingError> {
        let (channels, count) = matrix.dim();
        if channels == 0 || count == 0 {
            return Err(NnlsError::Empty { rows: channels, columns: count }.into());
        }
        if let Some(((row, column), value)) = matrix.indexed_iter().find(|(_, v)| !v.is_finite()) {
            let what = format!("endmember {}, channel {}", column + 1, row + 1);
            return Err(NnlsError::NotFinite { what, value: *value }.into());
        }
        let name =
            |j: usize| names.get(j).cloned().unwrap_or_else(|| format!("endmember {}", j + 1));
        let columns: Vec<Vec<f64>> = matrix.columns().into_iter().map(|c| c.to_vec()).collect();
        if let Some(black) = columns.iter().position(|c| norm(c) == 0.0) {
            return Err(MixingError::Black { name: name(black), channels });
        }
        let mut nearest: Option<Twins> = None;
        for first in 0..count {
            for second in first + 1..count {
                let angle_rad = super::spectral_angle_rad(&columns[first], &columns[second]);
                // In one channel every endmember has the same spectrum; that is said by the rank.
                if channels > 1 && angle_rad.sin() <= SAME {
                    let (first, second) = (name(first), name(second));
                    return Err(MixingError::Same { first, second, channels });
                }
                if nearest.as_ref().is_none_or(|n| angle_rad < n.angle_rad) {
                    nearest = Some(Twins { pair: [first, second], angle_rad });
                }
            }
        }
        let scaled = DMatrix::from_fn(channels, count, |i, j| columns[j][i] / norm(&columns[j]));
        let singular = scaled.singular_values();
        let most = singular.iter().copied().fold(0.0, f64::max);
        let rank = singular.iter().filter(|s| **s > RANK * most).count();
        let least = singular.iter().copied().fold(f64::INFINITY, f64::min);
        let condition = if rank < count { f64::INFINITY } else { most / least };
        Ok(Self { matrix, condition, rank, nearest })
    }

    /// Channels × endmembers.
    pub fn matrix(&self) -> ArrayView2<'_, f64> {
        self.matrix.view()
    }

    /// Returns true where the channels tell all endmembers apart.
    pub fn is_complete(&self) -> bool {
        self.rank == self.matrix.ncols()
    }

    /// Unmixes a sample.
    ///
    /// # Errors
    /// Data or uncertainties that are none; [`NnlsError::NotConverged`].
    pub fn solve(
        &self,
        x: &[f64],
        noise: Noise<'_>,
        constraint: Constraint,
    ) -> Result<Mixture, MixingError> {
        let (channels, count) = self.matrix.dim();
        if x.len() != channels {
            return Err(NnlsError::Length { rows: channels, found: x.len() }.into());
        }
        let whitener = Whitener::new(noise, channels)?;
        let white = whitener.matrix(&self.matrix);
        let y = whitener.apply(x);
        let solution = Nnls::new(white.view(), constraint)?.solve(&y)?;
        let projected = osp(white.view(), &y).unwrap_or_else(|_| vec![f64::NAN; count]);
        let weights = solution.weights;
        let mut residual = x.to_vec();
        for (row, residual) in self.matrix.rows().into_iter().zip(&mut residual) {
            *residual -= row.iter().zip(&weights).map(|(s, a)| s * a).sum::<f64>();
        }
        let squares = dot(&solution.residual, &solution.residual);
        let in_use = solution.in_use.iter().filter(|u| **u).count();
        let fixed = usize::from(matches!(constraint, Constraint::Sum(_)));
        let unknown = matches!(noise, Noise::Unknown);
        let spare = (channels + fixed).saturating_sub(count);
        let scale = match (unknown, spare) {
            (false, _) => 1.0,
            (true, 0) => f64::NAN,
            (true, spare) => squares / spare as f64,
        };
        let covariance = covariance(&white, constraint).mapv(|v| v * scale);
        let sigma: Vec<f64> = covariance.diag().iter().map(|v| v.sqrt()).collect();
        let (shares, share_sigma) = shares(&weights, &covariance);
        let length = norm(x);
        Ok(Mixture {
            bounded: solution.in_use.iter().map(|u| !u).collect(),
            residual_relative: if length > 0.0 { norm(&residual) / length } else { f64::NAN },
            residual,
            chi_squared: (!unknown).then_some(squares),
            freedom: (channels + fixed).saturating_sub(in_use),
            unique: solution.unique,
            kkt: solution.kkt,
            weights,
            projected,
            sigma,
            covariance,
            shares,
            share_sigma,
        })
    }
}

/// Turns data of some covariance into data of covariance 1.
enum Whitener {
    None,
    Scale(Vec<f64>),
    Triangle(DMatrix<f64>),
}

impl Whitener {
    fn new(noise: Noise<'_>, channels: usize) -> Result<Self, MixingError> {
        Ok(match noise {
            Noise::Unknown => Self::None,
            Noise::Independent(sigma) => {
                if sigma.len() != channels {
                    return Err(NnlsError::Length { rows: channels, found: sigma.len() }.into());
                }
                let bad = sigma.iter().position(|s| !(s.is_finite() && *s > 0.0));
                if let Some(channel) = bad {
                    return Err(MixingError::Sigma { channel, sigma: sigma[channel] });
                }
                Self::Scale(sigma.to_vec())
            }
            Noise::Covariance(matrix) => {
                let (rows, columns) = matrix.dim();
                let wrong = || MixingError::Covariance { channels, rows, columns };
                if (rows, columns) != (channels, channels) || matrix.iter().any(|v| !v.is_finite())
                {
                    return Err(wrong());
                }
                let own = DMatrix::from_fn(rows, columns, |i, j| matrix[(i, j)]);
                Self::Triangle(own.cholesky().ok_or_else(wrong)?.l())
            }
        })
    }

    fn apply(&self, x: &[f64]) -> Vec<f64> {
        match self {
            Self::None => x.to_vec(),
            Self::Scale(sigma) => x.iter().zip(sigma).map(|(x, s)| x / s).collect(),
            Self::Triangle(l) => {
                let mut y = x.to_vec();
                for i in 0..y.len() {
                    let known: f64 = (0..i).map(|k| l[(i, k)] * y[k]).sum();
                    y[i] = (y[i] - known) / l[(i, i)];
                }
                y
            }
        }
    }

    fn matrix(&self, matrix: &Array2<f64>) -> Array2<f64> {
        let columns: Vec<Vec<f64>> =
            matrix.columns().into_iter().map(|c| self.apply(&c.to_vec())).collect();
        Array2::from_shape_fn(matrix.dim(), |(i, j)| columns[j][i])
    }
}

/// (SᵀS)⁻¹ of whitened columns, on the plane of a given sum where there is one; infinite where the columns depend on one another.
fn covariance(white: &Array2<f64>, constraint: Constraint) -> Array2<f64> {
    let count = white.ncols();
    let columns: Vec<Vec<f64>> = white.columns().into_iter().map(|c| c.to_vec()).collect();
    let mut basis = Basis::default();
    let unknown = Array2::from_elem((count, count), f64::INFINITY);
    match constraint {
        Constraint::Free => {
            if columns.iter().any(|c| basis.push(c, RANK) <= RANK) {
                return unknown;
            }
            let inverse = basis.inverse_gram();
            Array2::from_shape_fn((count, count), |(i, j)| inverse[i][j])
        }
        Constraint::Sum(_) => {
            // Along differences to the first column; what that one loses the others gain.
            for other in &columns[1..] {
                let difference: Vec<f64> =
                    other.iter().zip(&columns[0]).map(|(a, b)| a - b).collect();
                if norm(&difference) == 0.0 || basis.push(&difference, RANK) <= RANK {
                    return unknown;
                }
            }
            let inverse = basis.inverse_gram();
            let slope = |i: usize, k: usize| match i {
                0 => -1.0,
                _ => f64::from(i - 1 == k),
            };
            Array2::from_shape_fn((count, count), |(i, j)| {
                let terms = (0..count - 1).flat_map(|k| (0..count - 1).map(move |l| (k, l)));
                terms.map(|(k, l)| slope(i, k) * inverse[k][l] * slope(j, l)).sum()
            })
        }
    }
}

/// Weights over their sum, and the standard uncertainties to first order.
fn shares(weights: &[f64], covariance: &Array2<f64>) -> (Vec<f64>, Vec<f64>) {
    let sum: f64 = weights.iter().sum();
    let count = weights.len();
    if sum.is_nan() || sum <= 0.0 {
        return (vec![f64::NAN; count], vec![f64::NAN; count]);
    }
    let shares: Vec<f64> = weights.iter().map(|w| w / sum).collect();
    let sigma = |m: usize| {
        if covariance.iter().any(|v| v.is_infinite()) {
            return f64::INFINITY;
        }
        let slope = |k: usize| (f64::from(k == m) - shares[m]) / sum;
        let terms = covariance.indexed_iter().map(|((i, j), v)| slope(i) * v * slope(j));
        let variance: f64 = terms.sum();
        if variance.is_nan() { f64::NAN } else { variance.max(0.0).sqrt() }
    };
    let sigmas = (0..count).map(sigma).collect();
    (shares, sigmas)
}
