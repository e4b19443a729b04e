//! A spectrum as a spectrometer left it, onto the wavelengths of the result.

use sunglint_numerics::order::{median, robust_sigma};

/// A step of more than this many times the usual one is a gap.
const GAP: f64 = 6.0;

/// Values over a wavelength, as recorded.
#[derive(Debug, Clone, PartialEq)]
pub struct RawSpectrum {
    /// Vacuum wavelengths, nm, increasing.
    pub nm: Vec<f64>,
    /// Values, as many as wavelengths.
    pub y: Vec<f64>,
    /// White noise of a single value, from the second differences.
    pub noise: f64,
    /// The file that it was read from.
    pub file: Option<String>,
}

/// Values in a row that are the largest of a spectrum.
pub(super) struct FlatTop {
    pub value: f64,
    pub from_nm: f64,
    pub to_nm: f64,
    /// True where these are all values.
    pub all: bool,
}

impl std::fmt::Display for FlatTop {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { value, from_nm, to_nm, all } = self;
        if *all {
            return write!(f, "all its values are {value}: a saturated detector, or no recording");
        }
        write!(
            f,
            "its largest value, {value}, stands from {from_nm:.1} to {to_nm:.1} nm: the detector was saturated, as it seems; measure with less light or shorter exposures"
        )
    }
}

/// Error in an axis or its values; `row` counts from 0.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AxisError {
    /// No number.
    #[error("{found}, expected a number")]
    Number {
        /// Where.
        row: usize,
        /// Number in this row.
        found: f64,
    },
    /// Not above 0.
    #[error("{found}, expected a wavelength or wavenumber above 0")]
    NotPositive {
        /// Where.
        row: usize,
        /// Number in this row.
        found: f64,
    },
    /// Neither increasing nor decreasing.
    #[error("{found} after {before}, expected an axis that only increases or only decreases")]
    Order {
        /// Where.
        row: usize,
        /// Number in this row.
        found: f64,
        /// Number in the row before.
        before: f64,
    },
    /// A hole.
    #[error(
        "{found} after {before}: a gap of {steps:.0} usual steps; cut the file in two and give each as a detector of its own"
    )]
    Gap {
        /// Where.
        row: usize,
        /// Number in this row.
        found: f64,
        /// Number in the row before.
        before: f64,
        /// How many steps.
        steps: f64,
    },
    /// Too few values.
    #[error("{rows} values, expected at least {least}")]
    Few {
        /// How many there are.
        rows: usize,
        /// How many there have to be.
        least: usize,
    },
}

impl AxisError {
    /// The row at which it is wrong, from 0.
    pub fn row(&self) -> Option<usize> {
        match self {
            Self::Number { row, .. }
            | Self::NotPositive { row, .. }
            | Self::Order { row, .. }
            | Self::Gap { row, .. } => Some(*row),
            Self::Few { .. } => None,
        }
    }
}

impl RawSpectrum {
    /// From an axis in vacuum nm (or with `wavenumbers` in cm⁻¹), in either order.
    ///
    /// # Errors
    /// [`AxisError`]: less than four values, no numbers, an axis that turns, a gap of more than six usual steps.
    pub fn new(axis: &[f64], y: &[f64], wavenumbers: bool) -> Result<Self, AxisError> {
        if axis.len() < 4 || axis.len() != y.len() {
            return Err(AxisError::Few { rows: axis.len().min(y.len()), least: 4 });
        }
        for (row, (x, y)) in axis.iter().zip(y).enumerate() {
            if let Some(found) = [*x, *y].into_iter().find(|v| !v.is_finite()) {
                return Err(AxisError::Number { row, found });
            }
            if *x <= 0.0 {
                return Err(AxisError::NotPositive { row, found: *x });
            }
        }
        let sign = if axis[1] > axis[0] { 1.0 } else { -1.0 };
        let mut steps: Vec<f64> = Vec::with_capacity(axis.len() - 1);
        for row in 1..axis.len() {
            let step = sign * (axis[row] - axis[row - 1]);
            if step <= 0.0 {
                return Err(AxisError::Order { row, found: axis[row], before: axis[row - 1] });
            }
            steps.push(step);
        }
        for row in 1..axis.len() {
            // The usual step hereabouts: gratings and prisms have steps that grow along the axis.
            let from = row.saturating_sub(6);
            let near = steps[from..(row + 5).min(steps.len())].iter().copied();
            let (usual, step) = (median(near).unwrap_or(f64::INFINITY), steps[row - 1]);
            if step > GAP * usual {
                let (found, before) = (axis[row], axis[row - 1]);
                return Err(AxisError::Gap { row, found, before, steps: step / usual });
            }
        }
        let mut pairs: Vec<(f64, f64)> =
            axis.iter().zip(y).map(|(x, y)| (if wavenumbers { 1e7 / x } else { *x }, *y)).collect();
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (nm, y): (Vec<f64>, Vec<f64>) = pairs.into_iter().unzip();
        let noise = noise(&y);
        Ok(Self { nm, y, noise, file: None })
    }

    /// The same at all wavelengths.
    pub fn constant(value: f64) -> Self {
        Self { nm: vec![1e-3, 1e9], y: vec![value; 2], noise: 0.0, file: None }
    }

    /// The place where a detector stood at its end, if it seems so: several values in a row that are the largest, beside one that is clearly less.
    pub(super) fn flat_top(&self) -> Option<FlatTop> {
        const LEAST: usize = 5;
        /// A smooth curve that is rounded goes down by less, two values beside five that are alike: (4/2)² units of its rounding.
        const UNITS: f64 = 4.0;
        let most = self.y.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if most <= 0.0 || self.y.len() < LEAST {
            return None;
        }
        let mut sorted = self.y.clone();
        sorted.sort_by(f64::total_cmp);
        let gaps = sorted.windows(2).map(|w| w[1] - w[0]).filter(|gap| *gap > 0.0);
        let unit = gaps.fold(f64::INFINITY, f64::min);
        let mut first = 0;
        for run in self.y.chunk_by(|a, b| (*a == most) == (*b == most)) {
            let last = first + run.len() - 1;
            if run[0] == most && run.len() >= LEAST {
                let before = first.checked_sub(2).map(|k| self.y[k]);
                let beside = before.into_iter().chain(self.y.get(last + 2).copied());
                let least = beside.fold(f64::INFINITY, f64::min);
                let all = run.len() == self.y.len();
                if all || most - least > UNITS * unit {
                    return Some(FlatTop {
                        value: most,
                        from_nm: self.nm[first],
                        to_nm: self.nm[last],
                        all,
                    });
                }
            }
            first = last + 1;
        }
        None
    }

    /// Where a detector stood at its end, if it seems so: both ends of the stretch, nm.
    pub(crate) fn flat_ends_nm(&self) -> Option<[f64; 2]> {
        self.flat_top().map(|top| [top.from_nm, top.to_nm])
    }

    fn at(&self, nm: f64) -> f64 {
        let j = self.nm.partition_point(|x| *x <= nm).clamp(1, self.nm.len() - 1) - 1;
        let t = (nm - self.nm[j]) / (self.nm[j + 1] - self.nm[j]);
        self.y[j] * (1.0 - t) + self.y[j + 1] * t
    }

    /// The mean of the lines between the values over a stretch that they cover.
    fn mean(&self, from: f64, to: f64) -> f64 {
        let first = self.nm.partition_point(|x| *x <= from);
        let last = self.nm.partition_point(|x| *x < to);
        let (mut sum, mut x, mut y) = (0.0, from, self.at(from));
        for k in first..last {
            sum += 0.5 * (y + self.y[k]) * (self.nm[k] - x);
            (x, y) = (self.nm[k], self.y[k]);
        }
        sum += 0.5 * (y + self.at(to)) * (to - x);
        sum / (to - from)
    }
}

/// The standard deviation of white noise: second differences have √6 of it, and of a smooth curve nothing else; their median keeps lines out.
fn noise(y: &[f64]) -> f64 {
    const LEAST: usize = 20;
    if y.len() < LEAST + 2 {
        return 0.0;
    }
    let second = y.windows(3).map(|w| w[0] - 2.0 * w[1] + w[2]);
    robust_sigma(second).unwrap_or(0.0) / 6.0_f64.sqrt()
}

/// The wavelengths of the result, each with the stretch for which it stands.
pub(super) struct Onto<'a> {
    nm: &'a [f64],
    edges: Vec<(f64, f64)>,
}

impl<'a> Onto<'a> {
    pub fn new(nm: &'a [f64]) -> Self {
        let n = nm.len();
        let half = |k: usize| 0.5 * (nm[k] + nm[k + 1]);
        let edge = |k: usize| match (k, n) {
            (_, 1) => (nm[0], nm[0]),
            (0, _) => (2.0 * nm[0] - half(0), half(0)),
            (k, n) if k == n - 1 => (half(k - 1), 2.0 * nm[k] - half(k - 1)),
            _ => (half(k - 1), half(k)),
        };
        Self { nm, edges: (0..n).map(edge).collect() }
    }

    /// Values and their standard deviations: means over the stretches where the spectrum is finer than they are, else between its values. NaN beyond the spectrum.
    pub fn values(&self, raw: &RawSpectrum) -> (Vec<f64>, Vec<f64>) {
        let (first, last) = (raw.nm[0], raw.nm[raw.nm.len() - 1]);
        let one = |(nm, edges): (&f64, &(f64, f64))| {
            if *nm < first || *nm > last {
                return (f64::NAN, f64::NAN);
            }
            // At the ends of the spectrum the stretch is cut on both sides, so that its middle stays.
            let half = (nm - edges.0).min(edges.1 - nm).min(nm - first).min(last - nm);
            let (from, to) = (nm - half, nm + half);
            let inside =
                raw.nm.partition_point(|x| *x <= to) - raw.nm.partition_point(|x| *x < from);
            if inside < 2 || half <= 0.0 {
                (raw.at(*nm), raw.noise)
            } else {
                (raw.mean(from, to), raw.noise / (inside as f64).sqrt())
            }
        };
        self.nm.iter().zip(&self.edges).map(one).unzip()
    }
}
