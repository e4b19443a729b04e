//! Transmissions for thousands of zenith angles on one sampling.

use super::math::{STENCIL, exp_minus, lagrange};
use super::path::{Outside, checked, invert};
use super::{Air, AirError, Sampling, Zenith};

/// Scale of the variable in which the nodes are even: the Earth's radius over the thickness of a shell of 400 m. It moves
/// nodes, not results. A shell as thin as that crowds them at the horizon, where water and haze bend fastest, as much as
/// the zenith can bear: the error is then about the same everywhere.
const RADIUS_OVER_SCALE: f64 = 16000.0;
/// Intervals between nodes at first; doubled until the error is below the tolerance.
const FIRST_INTERVALS: usize = 16;
const MOST_INTERVALS: usize = 1024;

/// Transmission of one [`Air`] on one [`Sampling`] as a table over the zenith angle, for thousands of angles.
///
/// # How
/// Tabulated is the optical depth L = −ln T of every sample (of the bin's mean, where the sampling has bins), at nodes that
/// are even in t = ln m, with m the air mass of a homogeneous shell, smooth from the zenith to the horizon. Between
/// nodes L is a polynomial of degree five through six of them, with weights that all wavelengths share. A row costs six
/// multiply-adds and an exponential per sample, all vectorised.
///
/// # Error
/// L is smooth in t: each species' path integral is, and a bin's −ln of a mean of exponentials of such. Between two nodes the
/// interpolation errs by ω(t) L⁽⁶⁾/720 with a known ω, so where L⁽⁶⁾ changes little over six nodes the error is largest where
/// ω is: in the middle of an interval, in the outermost ones within a quarter of it. The builder measures the error in T
/// against the exact calculation at 0.25, 0.5 and 0.75 of *every* interval, for every sample, by apparent and by true zenith
/// angle; it doubles the nodes until 1.5 times the largest is below the tolerance, and reports that. A near target's angle
/// goes through the same tabulated bending and geometry without error, and errs as a true angle does. So the bound is
/// sampled, not proven: the factor of 1.5 covers what lies between the samples (a property test draws stations and angles at
/// random; 6000 stations were drawn once without a case beyond the bound).
#[derive(Debug, Clone)]
pub struct AirTable {
    samples: usize,
    wavelength_nm: Vec<f64>,
    t_last: f64,
    intervals: usize,
    /// Optical depths, node by node.
    depths: Vec<f64>,
    /// Refraction over sin z \[deg\] at the nodes: even in z, hence smooth in t also at the zenith, where the refraction itself
    /// goes as √t.
    bending_deg: Vec<f64>,
    outside: Outside,
    error: f64,
}

impl AirTable {
    /// The tolerance that suits light curves: 1e−6 in transmission.
    pub const TOLERANCE: f64 = 1e-6;

    /// Tabulates an air on a sampling until the interpolation errs by less than `tolerance` in transmission (absolute).
    ///
    /// # Errors
    /// A tolerance that is not positive, or that 1024 intervals do not reach.
    pub fn new(air: &Air, sampling: &Sampling, tolerance: f64) -> Result<Self, AirError> {
        if !(tolerance > 0.0 && tolerance.is_finite()) {
            return Err(AirError::Option {
                option: "tolerance",
                value: tolerance,
                expected: "a positive difference in transmission (1e-6 is usual)",
            });
        }
        let builder = Builder { air, sampling, terms: air.terms_on(sampling) };
        let t_last = t_of(90.0);
        let mut intervals = FIRST_INTERVALS;
        let mut nodes: Vec<Node> =
            (0..=intervals).map(|i| builder.node(t_last, i as f64 / intervals as f64)).collect();
        loop {
            let mut table = Self::from_nodes(sampling, t_last, &nodes, air.outside());
            let middles = builder.between(&table, 0.5);
            let worst = table.worst(&middles);
            let mut error = 1.5 * worst;
            if error <= tolerance {
                for place in [0.25, 0.75] {
                    error = error.max(1.5 * table.worst(&builder.between(&table, place)));
                }
                if error <= tolerance {
                    table.error = error;
                    return Ok(table);
                }
            }
            if 2 * intervals > MOST_INTERVALS {
                return Err(AirError::Tolerance { tolerance, error, nodes: nodes.len() });
            }
            // The middles become nodes: nothing is calculated twice.
            intervals *= 2;
            let mut merged = Vec::with_capacity(intervals + 1);
            let mut middles = middles.into_iter();
            for node in nodes {
                merged.push(node);
                merged.extend(middles.next());
            }
            nodes = merged;
        }
    }

    /// The wavelengths, or the bins' centres \[nm\]: the columns of every row.
    pub fn wavelength_nm(&self) -> &[f64] {
        &self.wavelength_nm
    }

    /// Largest error of a transmission by this table against the exact calculation: measured, see the type's page.
    pub fn interpolation_error(&self) -> f64 {
        self.error
    }

    /// How many zenith angles are tabulated.
    pub fn nodes(&self) -> usize {
        self.intervals + 1
    }

    /// Transmission for one zenith angle: one value per sample.
    ///
    /// # Errors
    /// The errors of [`Air::path`].
    pub fn transmission(&self, zenith: Zenith) -> Result<Vec<f64>, AirError> {
        let mut row = vec![0.0; self.samples];
        self.row(self.t(zenith)?, &mut row);
        Ok(row)
    }

    /// Transmissions for many zenith angles, row by row: `out[i * wavelengths + j]`.
    ///
    /// # Errors
    /// The errors of [`Air::path`], for the first angle that has no answer (rows before it are filled); an output of the wrong
    /// length.
    pub fn transmissions_into(&self, zeniths: &[Zenith], out: &mut [f64]) -> Result<(), AirError> {
        let expected = zeniths.len() * self.samples;
        if out.len() != expected {
            return Err(AirError::OutputLength { found: out.len(), expected });
        }
        for (zenith, row) in zeniths.iter().zip(out.chunks_exact_mut(self.samples)) {
            self.row(self.t(*zenith)?, row);
        }
        Ok(())
    }

    /// Transmissions for many zenith angles: zenith angles × wavelengths.
    ///
    /// # Errors
    /// The errors of [`Air::path`], for the first angle that has no answer.
    pub fn transmissions(&self, zeniths: &[Zenith]) -> Result<ndarray::Array2<f64>, AirError> {
        let mut all = ndarray::Array2::zeros((zeniths.len(), self.samples));
        for (zenith, mut row) in zeniths.iter().zip(all.rows_mut()) {
            let t = self.t(*zenith)?;
            // A fresh array in standard order has contiguous rows.
            if let Some(row) = row.as_slice_mut() {
                self.row(t, row);
            }
        }
        Ok(all)
    }

    fn from_nodes(sampling: &Sampling, t_last: f64, nodes: &[Node], outside: Outside) -> Self {
        Self {
            samples: sampling.len(),
            wavelength_nm: sampling.wavelength_nm().to_vec(),
            t_last,
            intervals: nodes.len() - 1,
            depths: nodes.iter().flat_map(|n| n.depths.iter().copied()).collect(),
            bending_deg: nodes.iter().map(|n| n.bending_deg).collect(),
            outside,
            error: f64::INFINITY,
        }
    }

    /// The table's variable for a zenith angle.
    fn t(&self, zenith: Zenith) -> Result<f64, AirError> {
        self.apparent_deg(zenith).map(t_of)
    }

    /// The apparent zenith angle \[deg\] of a zenith angle, by the refraction that is tabulated with the depths: much faster
    /// than [`Air::path`], and as near to it as the transmissions' error asks for.
    ///
    /// # Errors
    /// The errors of [`Air::path`].
    pub fn apparent_deg(&self, zenith: Zenith) -> Result<f64, AirError> {
        Ok(match zenith {
            Zenith::Apparent(z) => checked(z, "apparent", 90.0)?,
            Zenith::True(z) => {
                let horizon_deg = 90.0 + self.bending_deg[self.intervals];
                let z = checked(z, "true", horizon_deg)?;
                invert(z, z.min(90.0), |a| self.true_deg(a))
            }
            Zenith::Near { true_deg, range_m } => {
                let radius_km = self.outside.radius_km(true_deg, range_m)?;
                let near_of = |a| self.outside.near_deg(a, self.true_deg(a), radius_km);
                if true_deg > 90.0 {
                    checked(true_deg, "true", near_of(90.0))?;
                }
                invert(true_deg, true_deg.min(90.0), near_of)
            }
        })
    }

    /// True zenith angle \[deg\] of a target at infinity, by the tabulated bending.
    fn true_deg(&self, apparent_deg: f64) -> f64 {
        apparent_deg + self.bending(t_of(apparent_deg)) * apparent_deg.to_radians().sin()
    }

    /// The six nodes that serve a place, and their weights.
    fn stencil(&self, t: f64) -> (usize, [f64; STENCIL]) {
        let u = t / self.t_last * self.intervals as f64;
        let first = (u.floor() as usize).saturating_sub(STENCIL / 2 - 1);
        let first = first.min(self.intervals + 1 - STENCIL);
        (first, lagrange(u - first as f64))
    }

    fn bending(&self, t: f64) -> f64 {
        let (first, weights) = self.stencil(t);
        weights.iter().zip(&self.bending_deg[first..]).map(|(w, r)| w * r).sum()
    }

    fn row(&self, t: f64, out: &mut [f64]) {
        let (first, w) = self.stencil(t);
        let n = out.len();
        let nodes = &self.depths[first * n..(first + STENCIL) * n];
        let (a, rest) = nodes.split_at(n);
        let (b, rest) = rest.split_at(n);
        let (c, rest) = rest.split_at(n);
        let (d, rest) = rest.split_at(n);
        let (e, f) = rest.split_at(n);
        // Slices of one length, so that the loop has no bounds checks and is vectorised.
        for j in 0..n {
            let low = w[0] * a[j] + w[1] * b[j] + w[2] * c[j];
            let high = w[3] * d[j] + w[4] * e[j] + w[5] * f[j];
            out[j] = exp_minus(low + high);
        }
    }

    /// Largest difference in transmission from exact nodes, by apparent and by true zenith angle.
    fn worst(&self, exact: &[Node]) -> f64 {
        let mut row = vec![0.0; self.samples];
        let mut worst = 0.0_f64;
        for node in exact {
            let exact: Vec<f64> = node.depths.iter().map(|l| exp_minus(*l)).collect();
            for zenith in [Zenith::Apparent(node.apparent_deg), Zenith::True(node.true_deg)] {
                // Rounding may put a true angle past the interpolated horizon; the apparent one speaks for it.
                let Ok(t) = self.t(zenith) else { continue };
                self.row(t, &mut row);
                for (a, b) in row.iter().zip(&exact) {
                    worst = worst.max((a - b).abs());
                }
            }
        }
        worst
    }
}

/// One exact zenith angle.
struct Node {
    apparent_deg: f64,
    true_deg: f64,
    bending_deg: f64,
    depths: Vec<f64>,
}

struct Builder<'a> {
    air: &'a Air,
    sampling: &'a Sampling,
    terms: Vec<super::spectra::Term>,
}

impl Builder<'_> {
    fn node(&self, t_last: f64, fraction: f64) -> Node {
        let path = self.air.path_at(zenith_of(t_last * fraction));
        let mut native = vec![0.0; self.sampling.native.len()];
        for term in &self.terms {
            term.add(&path.amounts, &mut native);
        }
        let curve: Vec<f64> = native.iter().map(|l| exp_minus(*l)).collect();
        let mut depths = vec![0.0; self.sampling.len()];
        self.sampling.apply(&curve, &mut depths);
        for (j, depth) in depths.iter_mut().enumerate() {
            // Where the mean is next to nothing, its logarithm is taken without leaving the range of numbers.
            *depth = if *depth > 1e-250 { -depth.ln() } else { self.sampling.depth(j, &native) };
        }
        // At the zenith 0/0; a tenth of a degree beside it the ratio is the same to 3e-6.
        let beside = if path.apparent_deg < 0.1 { self.air.path_at(0.1) } else { path };
        let bending_deg =
            (beside.true_deg - beside.apparent_deg) / beside.apparent_deg.to_radians().sin();
        Node { apparent_deg: path.apparent_deg, true_deg: path.true_deg, bending_deg, depths }
    }

    /// Exact nodes at one place of every interval.
    fn between(&self, table: &AirTable, place: f64) -> Vec<Node> {
        (0..table.intervals)
            .map(|i| self.node(table.t_last, (i as f64 + place) / table.intervals as f64))
            .collect()
    }
}

/// t = ln m, m = (2q + 1)/(√((q cos z)² + 2q + 1) + q cos z): the air mass of a homogeneous shell, without cancellation.
fn t_of(apparent_deg: f64) -> f64 {
    let q = RADIUS_OVER_SCALE;
    let c = q * (90.0 - apparent_deg).to_radians().sin();
    ((2.0 * q + 1.0) / ((c * c + 2.0 * q + 1.0).sqrt() + c)).ln()
}

/// The apparent zenith angle \[deg\] of t.
fn zenith_of(t: f64) -> f64 {
    let q = RADIUS_OVER_SCALE;
    let m = t.exp();
    let cos = ((2.0 * q + 1.0 - m * m) / (2.0 * q * m)).clamp(0.0, 1.0);
    90.0 - cos.asin().to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_variable_runs_from_the_zenith_to_the_horizon_and_back() {
        assert_eq!(t_of(0.0), 0.0);
        for z in [0.01, 10.0, 45.0, 80.0, 89.9, 90.0] {
            assert!((zenith_of(t_of(z)) - z).abs() < 1e-6, "{z}: {}", zenith_of(t_of(z)));
        }
    }
}
