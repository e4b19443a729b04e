//! Orthogonal subspace projection, and endmembers that nobody knew.

use super::nnls::NnlsError;
use ndarray::{ArrayView2, Axis};
use sunglint_numerics::basis::{Basis, dot, norm};

/// Share of the longest spectrum below which a residual is rounding.
const EXHAUSTED: f64 = 1e-12;
/// An endmember of which less than this stands upright on the others cannot be told from them.
const DEPENDENT: f64 = 1e-12;

/// The weight of each column by orthogonal subspace projection, a_p = s_pᵀP⊥x / s_pᵀP⊥s_p, with the projector that takes all other columns out: the least squares
/// answer without bounds (Harsanyi and Chang 1994).
///
/// # Errors
/// Columns of zeros or of another length than x; columns that are combinations of others ([`NnlsError::Zero`] of what is left of them).
pub fn osp(matrix: ArrayView2<'_, f64>, x: &[f64]) -> Result<Vec<f64>, NnlsError> {
    let (rows, count) = matrix.dim();
    if rows == 0 || count == 0 {
        return Err(NnlsError::Empty { rows, columns: count });
    }
    if x.len() != rows {
        return Err(NnlsError::Length { rows, found: x.len() });
    }
    if let Some(value) = matrix.iter().chain(x).find(|v| !v.is_finite()) {
        return Err(NnlsError::NotFinite { what: "matrix or data".into(), value: *value });
    }
    let columns: Vec<Vec<f64>> = matrix.axis_iter(Axis(1)).map(|c| c.to_vec()).collect();
    let weight = |p: usize| {
        let mut others = Basis::default();
        for (_, column) in columns.iter().enumerate().filter(|(j, _)| *j != p) {
            others.push(column, DEPENDENT);
        }
        let mut own = columns[p].clone();
        others.project_out(&mut own);
        if norm(&own) <= DEPENDENT * norm(&columns[p]) {
            return Err(NnlsError::Zero { column: p });
        }
        // P⊥ is idempotent: it need not be applied to x.
        Ok(dot(&own, x) / dot(&own, &own))
    };
    (0..count).map(weight).collect()
}

/// The angle between two spectra, radians: 0 where they differ in scale alone.
///
/// ```
/// use sunglint_analysis::unmix::spectral_angle_rad;
///
/// assert!(spectral_angle_rad(&[1.0, 2.0], &[3.0, 6.0]) < 1e-12);
/// assert!((spectral_angle_rad(&[1.0, 0.0], &[0.0, 5.0]) - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
/// ```
pub fn spectral_angle_rad(a: &[f64], b: &[f64]) -> f64 {
    let (la, lb) = (norm(a), norm(b));
    // By the half-angle: arccos loses half of the digits near 0.
    let (mut minus, mut plus) = (0.0_f64, 0.0_f64);
    for (x, y) in a.iter().zip(b) {
        minus += (x / la - y / lb).powi(2);
        plus += (x / la + y / lb).powi(2);
    }
    2.0 * minus.sqrt().atan2(plus.sqrt())
}

/// Conditions to stop.
#[derive(Debug, Clone, PartialEq)]
pub struct AtgpOptions {
    /// Endmembers at most.
    pub most: usize,
    /// η_i ≤ this, of η_1 = s₁ᵀs₁: the signature that made it so is no new one.
    pub epsilon: f64,
    /// The longest rest of the data, of the longest sample, that is taken for noise.
    pub noise: f64,
    /// A signature to begin with; the longest sample where `None`.
    pub first: Option<Vec<f64>>,
}

impl Default for AtgpOptions {
    fn default() -> Self {
        Self { most: 16, epsilon: 1e-9, noise: EXHAUSTED, first: None }
    }
}

/// A signature.
#[derive(Debug, Clone, PartialEq)]
pub struct Target {
    /// The sample that it is; `None` of one that was given.
    pub sample: Option<usize>,
    /// Values.
    pub spectrum: Vec<f64>,
    /// The length of what the signatures before it leave of it, of the longest sample.
    pub rest: f64,
    /// η_i = s₁ᵀP⊥[s₂…s_i]s₁, of s₁ᵀs₁.
    pub eta: f64,
}

/// Signatures, and why there are no more of them.
#[derive(Debug, Clone, PartialEq)]
pub struct Targets {
    /// In the order in which they were found.
    pub targets: Vec<Target>,
    /// In words.
    pub stopped: &'static str,
    /// The length of what they leave of the data at most, of the longest sample.
    pub left: f64,
}

/// Why there are no signatures.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AtgpError {
    /// No light.
    #[error("{samples} samples in {bands} bands without any light: there is nothing to find")]
    Dark {
        /// Samples.
        samples: usize,
        /// Bands.
        bands: usize,
    },
    /// A number that is none.
    #[error("sample {}, band {}: {value}, expected a number; leave such samples out", row + 1, column + 1)]
    NotFinite {
        /// Sample, from 0.
        row: usize,
        /// Band, from 0.
        column: usize,
        /// Value that was given.
        value: f64,
    },
    /// A first signature of another length.
    #[error("the first signature has {found} bands, the data {bands}")]
    First {
        /// Number of bands of the data.
        bands: usize,
        /// Number of bands of the signature.
        found: usize,
    },
}

/// Automatic target generation: from samples × bands the signatures of which the others are made (Ren and Chang 2003). Each is the sample of which the projector upright
/// on those before leaves most; the projector is a basis that is orthogonalised twice, so that the tenth signature is as clean as the second. Found are *samples*: pure
/// materials only where a sample shows one alone.
///
/// # Errors
/// No light, numbers that are none, a first signature of another length.
pub fn atgp(samples: ArrayView2<'_, f64>, options: &AtgpOptions) -> Result<Targets, AtgpError> {
    let (count, bands) = samples.dim();
    if let Some(((row, column), value)) = samples.indexed_iter().find(|(_, v)| !v.is_finite()) {
        return Err(AtgpError::NotFinite { row, column, value: *value });
    }
    let mut rest: Vec<Vec<f64>> = samples.rows().into_iter().map(|r| r.to_vec()).collect();
    let longest = rest.iter().map(|r| norm(r)).fold(0.0, f64::max);
    if count == 0 || longest == 0.0 {
        return Err(AtgpError::Dark { samples: count, bands });
    }
    if let Some(first) = &options.first
        && (first.len() != bands || norm(first) == 0.0)
    {
        return Err(AtgpError::First { bands, found: first.len() });
    }
    let (mut all, mut after_first) = (Basis::default(), Basis::default());
    let mut targets: Vec<Target> = Vec::new();
    let mut first: Vec<f64> = Vec::new();
    let most_left = |rest: &[Vec<f64>]| {
        let lengths = rest.iter().map(|r| norm(r) / longest).enumerate();
        lengths.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0))
    };
    let stopped = loop {
        let (at, left) = most_left(&rest);
        if targets.len() >= options.most.min(bands) {
            break if targets.len() == bands { "as many as bands" } else { "as many as asked for" };
        }
        if !targets.is_empty() && left <= options.noise.max(EXHAUSTED) {
            break "nothing but noise is left of the data";
        }
        let given = options.first.as_ref().filter(|_| targets.is_empty());
        let (sample, spectrum) = match given {
            Some(first) => (None, first.clone()),
            None => (Some(at), samples.row(at).to_vec()),
        };
        all.push(&spectrum, 0.0);
        let eta = if targets.is_empty() {
            first.clone_from(&spectrum);
            1.0
        } else {
            after_first.push(&spectrum, 0.0);
            let mut upright = first.clone();
            after_first.project_out(&mut upright);
            (norm(&upright) / norm(&first)).powi(2)
        };
        if eta <= options.epsilon {
            break "eta: the last one made the first superfluous, and is no new one";
        }
        targets.push(Target { sample, spectrum, rest: left, eta });
        for row in &mut rest {
            all.project_out(row);
        }
    };
    let left = most_left(&rest).1;
    Ok(Targets { targets, stopped, left })
}
