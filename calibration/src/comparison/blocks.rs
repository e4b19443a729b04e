//! Blocks of time, and what they say of an uncertainty that neighbouring samples share.

/// Blocks of a curve that is long enough.
pub const BLOCKS: usize = 20;
/// Samples that a block must have.
const LEAST_SAMPLES: usize = 3;
/// Fewer blocks say nothing.
const LEAST_BLOCKS: usize = 5;

/// Rows of a curve in blocks of as equal a length of time as they allow, one after the other; the same for all channels.
#[derive(Debug, Clone, PartialEq)]
pub struct Blocks {
    of: Vec<usize>,
    count: usize,
}

impl Blocks {
    /// Divides rows, at times that do not decrease (s), into blocks with equal numbers of rows.
    pub fn new(rows: usize) -> Self {
        let count = BLOCKS.min(rows / LEAST_SAMPLES).max(1);
        Self { of: (0..rows).map(|i| i * count / rows.max(1)).collect(), count }
    }

    /// The block of a row.
    pub fn of(&self, row: usize) -> usize {
        self.of[row]
    }

    /// Their number.
    pub fn count(&self) -> usize {
        self.count
    }
}

/// The standard uncertainty of what `statistic` makes of samples, by leaving out one block after the other: √((b−1)/b Σ (x₋ₖ − x̄)²) over the b blocks that have
/// samples. `None` of too few.
pub(super) fn jackknife(
    blocks: &Blocks,
    picked: &[usize],
    statistic: &dyn Fn(&mut dyn Iterator<Item = usize>) -> f64,
) -> Option<f64> {
    let mut filled = vec![0_usize; blocks.count()];
    picked.iter().for_each(|i| filled[blocks.of(*i)] += 1);
    let own: Vec<usize> = (0..blocks.count()).filter(|b| filled[*b] > 0).collect();
    let b = own.len();
    if b < LEAST_BLOCKS || picked.len() < LEAST_SAMPLES * b {
        return None;
    }
    let without =
        |left: &usize| statistic(&mut picked.iter().copied().filter(|i| blocks.of(*i) != *left));
    let values: Vec<f64> = own.iter().map(without).collect();
    let mean = values.iter().sum::<f64>() / b as f64;
    let square: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    let sigma = ((b - 1) as f64 / b as f64 * square).sqrt();
    sigma.is_finite().then_some(sigma)
}

/// The factor of a standard uncertainty with so many degrees of freedom that makes a 95 % interval: Student's t.
pub fn student_95(freedom: usize) -> f64 {
    // Quantiles 0.975 of Student's t for 4 to 19 degrees of freedom, as tables print them.
    const FROM: usize = 4;
    const T: [f64; 16] = [
        2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131, 2.120,
        2.110, 2.101, 2.093,
    ];
    let at = freedom.saturating_sub(FROM).min(T.len() - 1);
    if freedom < FROM { f64::INFINITY } else { T[at] }
}
