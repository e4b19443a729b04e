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
