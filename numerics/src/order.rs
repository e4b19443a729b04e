//! Medians and quantiles.

/// Standard deviation of a normal distribution over its median absolute deviation, 1/Φ⁻¹(3/4).
pub const SIGMA_PER_MAD: f64 = 1.482_602_218_505_602;

/// Returns the median: the middle value, or the mean of the middle two. Values that are no numbers are left out; `None` where none is left.
///
/// ```
/// use sunglint_numerics::order::median;
/// assert_eq!(median([3.0, 1.0, f64::NAN, 2.0]), Some(2.0));
/// assert_eq!(median([1.0, 2.0, 4.0, 8.0]), Some(3.0));
/// assert_eq!(median([]), None);
/// ```
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().filter(|v| !v.is_nan()).collect();
    let middle = values.len() / 2;
    if values.is_empty() {
        return None;
    }
    let even = values.len().is_multiple_of(2);
    let (below, upper, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    let upper = *upper;
    if !even {
        return Some(upper);
    }
    // Half of each: the sum of two large values may be beyond all numbers.
    let lower = below.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    Some(if lower == upper { upper } else { 0.5 * lower + 0.5 * upper })
}

/// Median of values that come one after another, in memory that does not grow with them without end.
///
/// Up to [`RunningMedian::EXACT`] values it is their [`median`] to the bit. Beyond that values are counted in cells of a part in 4096 of their size, and the median is off by at most a part in 8192 of itself.
///
/// ```
/// use sunglint_numerics::order::RunningMedian;
/// let mut running = RunningMedian::default();
/// [3.0, 1.0, f64::NAN, 2.0].into_iter().for_each(|v| running.add(v));
/// assert_eq!(running.median(), Some(2.0));
/// assert_eq!(running.largest(), Some(3.0));
/// ```
#[derive(Debug, Clone, Default)]
pub struct RunningMedian {
    exact: Vec<f64>,
    /// Counts by the upper bits of the values in their order: a page for each sign and exponent.
    pages: Vec<Option<Box<[u64; CELLS]>>>,
    count: u64,
    largest: Option<f64>,
}

/// Cells of one exponent.
const CELLS: usize = 1 << CELL_BITS;
const CELL_BITS: u32 = 12;
/// Bits of a value below those that name its cell.
const REST_BITS: u32 = 52 - CELL_BITS;
const SIGN: u64 = 1 << 63;

impl RunningMedian {
    /// So many values are kept as they are.
    pub const EXACT: usize = 1 << 19;

    /// Takes one more value in; one that is no number is left out.
    pub fn add(&mut self, value: f64) {
        if value.is_nan() {
            return;
        }
        self.count += 1;
        self.largest = Some(self.largest.map_or(value, |most| most.max(value)));
        if self.pages.is_empty() && self.exact.len() < Self::EXACT {
            self.exact.push(value);
            return;
        }
        for value in std::mem::take(&mut self.exact) {
            self.sort_in(value);
        }
        self.sort_in(value);
    }

    fn sort_in(&mut self, value: f64) {
        let bits = value.to_bits();
        // Negative values in the opposite order, below all others.
        let key = if bits & SIGN == 0 { bits | SIGN } else { !bits } >> REST_BITS;
        let (page, cell) = ((key >> CELL_BITS) as usize, key as usize % CELLS);
        if self.pages.is_empty() {
            self.pages.resize(1 << 12, None);
        }
        self.pages[page].get_or_insert_with(|| Box::new([0; CELLS]))[cell] += 1;
    }

    /// Number of values.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The largest value; `None` of none.
    pub fn largest(&self) -> Option<f64> {
        self.largest
    }

    /// The median; `None` of no value.
    pub fn median(&self) -> Option<f64> {
        if self.pages.is_empty() {
            return median(self.exact.iter().copied());
        }
        let (lower, upper) = (self.ranked((self.count - 1) / 2)?, self.ranked(self.count / 2)?);
        Some(if lower == upper { upper } else { 0.5 * lower + 0.5 * upper })
    }

    /// The middle of the cell that holds the value of a rank.
    fn ranked(&self, rank: u64) -> Option<f64> {
        let mut before = 0;
        for (page, cells) in self.pages.iter().enumerate() {
            for (cell, count) in cells.iter().flat_map(|cells| cells.iter().enumerate()) {
                before += count;
                if before > rank {
                    let key = ((page as u64) << CELL_BITS | cell as u64) << REST_BITS;
                    let of =
                        |key: u64| f64::from_bits(if key & SIGN == 0 { !key } else { key ^ SIGN });
                    let (low, middle) = (of(key), of(key | 1 << (REST_BITS - 1)));
                    // Nothing is halved below the smallest normal number, nor beyond the largest.
                    let whole = middle.is_normal();
                    return Some(if whole { middle } else { low });
                }
            }
        }
        None
    }
}

/// Returns the robust standard deviation of values about 0: 1.4826 times the median of their sizes. `None` without a number.
///
/// ```
/// use sunglint_numerics::order::robust_sigma;
/// assert_eq!(robust_sigma([-2.0, 1.0, 30.0]), Some(1.482_602_218_505_602 * 2.0));
/// ```
pub fn robust_sigma(deviations: impl IntoIterator<Item = f64>) -> Option<f64> {
    median(deviations.into_iter().map(f64::abs)).map(|mad| SIGMA_PER_MAD * mad)
}

/// Returns the quantile of sorted values, linear between them: type 7 of Hyndman and Fan (1996), as numpy's and R's. NaN of none.
///
/// ```
/// use sunglint_numerics::order::quantile;
/// assert_eq!(quantile(&[1.0, 2.0, 4.0], 0.75), 3.0);
/// assert!(quantile(&[], 0.5).is_nan());
/// ```
pub fn quantile(sorted: &[f64], p: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let at = p.clamp(0.0, 1.0) * last as f64;
    let below = (at.floor() as usize).min(last);
    let above = (below + 1).min(last);
    sorted[below] + (at - below as f64) * (sorted[above] - sorted[below])
}

/// Returns the value below which a part of the weight lies, of pairs (value, weight): values stand at the middles of their own weights, with straight
/// lines between them. Pairs without weight do not count; NaN of none.
///
/// ```
/// use sunglint_numerics::order::weighted_quantile;
/// assert_eq!(weighted_quantile(&[(1.0, 1.0), (2.0, 1.0), (9.0, 0.0)], 0.5), 1.5);
/// ```
pub fn weighted_quantile(weighted: &[(f64, f64)], part: f64) -> f64 {
    let mut sorted: Vec<(f64, f64)> = weighted.iter().copied().filter(|(_, w)| *w > 0.0).collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = sorted.iter().map(|(_, w)| w).sum();
    let wanted = part * total;
    let (mut below, mut before) = (0.0, None::<(f64, f64)>);
    for (value, weight) in sorted {
        let middle = below + 0.5 * weight;
        if middle >= wanted {
            return match before {
                None => value,
                Some((at, v)) => v + (value - v) * (wanted - at) / (middle - at),
            };
        }
        before = Some((middle, value));
        below += weight;
    }
    before.map_or(f64::NAN, |(_, v)| v)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the median of all values, by sorting: to a part in 8192 beyond what is kept, exactly up to that; negative values, zeros and infinite ones among them.
    #[test]
    fn a_running_median_is_the_median() {
        let value = |i: usize| {
            let x = (i as f64 * 0.618_033_988_749_894_9).fract();
            match i % 97 {
                0 => 0.0,
                1 => f64::INFINITY,
                2 => -1e-3 / (x + 1e-9),
                _ => 10_f64.powf(20.0 * x - 12.0),
            }
        };
        for count in [1, 2, 1000, RunningMedian::EXACT, RunningMedian::EXACT + 1, 900_000] {
            let mut running = RunningMedian::default();
            (0..count).for_each(|i| running.add(value(i)));
            running.add(f64::NAN);
            let known = median((0..count).map(value)).unwrap();
            let found = running.median().unwrap();
            let allowed = if count > RunningMedian::EXACT { known.abs() / 8192.0 } else { 0.0 };
            let good = found == known || (found - known).abs() <= allowed;
            assert!(good, "{count}: {found} {known}");
            assert_eq!(running.count(), count as u64);
            assert_eq!(running.largest(), (0..count).map(value).reduce(f64::max));
        }
        let mut zeros = RunningMedian::default();
        (0..RunningMedian::EXACT + 10).for_each(|_| zeros.add(0.0));
        assert_eq!(zeros.median(), Some(0.0));
        let mut less = RunningMedian::default();
        (0..RunningMedian::EXACT + 10).for_each(|i| less.add(-1.0 - i as f64));
        let known = -1.0 - 0.5 * (RunningMedian::EXACT + 9) as f64;
        assert!((less.median().unwrap() / known - 1.0).abs() < 1.0 / 8192.0);
    }

    /// Truth: the definition, by sorting; numbers from a congruence. Infinite values are values.
    #[test]
    fn the_median_is_that_of_the_sorted_values() {
        let mut state = 1_u64;
        for n in 1..60_usize {
            let values: Vec<f64> = (0..n)
                .map(|_| {
                    state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                    ((state >> 40) % 17) as f64 - 8.0
                })
                .collect();
            let mut sorted = values.clone();
            sorted.sort_by(f64::total_cmp);
            let expected = 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]);
            assert_eq!(median(values.iter().copied()), Some(expected));
            assert_eq!(quantile(&sorted, 0.5), expected);
        }
        assert_eq!(median([f64::INFINITY, f64::INFINITY]), Some(f64::INFINITY));
        assert_eq!(median([f64::MAX, f64::MAX]), Some(f64::MAX));
        assert_eq!(median([f64::NEG_INFINITY, 1.0, 2.0]), Some(1.0));
        assert_eq!(median([f64::NAN]), None);
    }

    /// Truth: numpy 2.4 `quantile` of 1, 2, 4, 8, 16: 1.4 at 0.1, 4 at 0.5, 12.8 at 0.9; the ends.
    #[test]
    fn quantiles_are_those_of_numpy() {
        let sorted = [1.0, 2.0, 4.0, 8.0, 16.0];
        for (p, expected) in [(0.0, 1.0), (0.1, 1.4), (0.5, 4.0), (0.9, 12.8), (1.0, 16.0)] {
            assert!((quantile(&sorted, p) - expected).abs() < 1e-12, "{p}");
        }
    }

    /// Truth: equal weights at the middles of n equal parts are Hazen's plotting positions: type 5 of Hyndman and Fan.
    #[test]
    fn weights_that_are_alike_give_hazens_quantiles() {
        let all: Vec<(f64, f64)> = (0..5).map(|i| (f64::from(i), 3.0)).collect();
        for (p, expected) in [(0.1, 0.0), (0.3, 1.0), (0.4, 1.5), (0.5, 2.0), (0.95, 4.0)] {
            assert!((weighted_quantile(&all, p) - expected).abs() < 1e-12, "{p}");
        }
        assert!(weighted_quantile(&[(1.0, 0.0)], 0.5).is_nan());
    }
}
