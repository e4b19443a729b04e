//! How often stated intervals held: shares with intervals of their own, from rows of campaigns.

/// Resamples of the nights.
const RESAMPLES: usize = 20_000;
/// Seed of the resampling.
const SEED: u64 = 20_261_130;

/// Misses of one night (or pass, or run): each of its intervals that missed, by where the truth lay, of so many.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Night {
    /// Intervals with the truth below them.
    pub below: f64,
    /// Intervals with the truth above them.
    pub above: f64,
    /// Intervals.
    pub of: f64,
    /// Mean of (found − truth)/σ over the night; NaN where it is not kept.
    pub pull: f64,
}

/// Counts of 95 % intervals that held.
#[derive(Debug, Clone, PartialEq)]
pub struct Coverage {
    /// Nights.
    pub nights: usize,
    /// Intervals.
    pub intervals: f64,
    /// Share of them that held.
    pub held: f64,
    /// 95 % interval of that share.
    pub interval: [f64; 2],
    /// Intervals with the truth below, and above.
    pub missed: [f64; 2],
    /// Mean of (found − truth)/σ, and its standard uncertainty by the scatter of the nights.
    pub bias: [f64; 2],
    /// Probability of a share as far from 95 %, if 95 % were true.
    pub p: f64,
}

/// Counts what was held. Where each night has one interval the share's own interval is Clopper and Pearson's (1934); else whole nights are drawn again, which
/// keeps what the intervals of a night have in common, and the interval is that of the percentiles.
///
/// # Panics
/// Where there is no night.
pub fn coverage(nights: &[Night]) -> Coverage {
    assert!(!nights.is_empty(), "no night to count");
    let sum = |of: fn(&Night) -> f64| nights.iter().map(of).sum::<f64>();
    let (below, above, of) = (sum(|n| n.below), sum(|n| n.above), sum(|n| n.of));
    let held = 1.0 - (below + above) / of;
    let (interval, p) = if nights.iter().all(|n| n.of == 1.0) {
        let hits = (of - below - above).round() as u64;
        (clopper_pearson(hits, of as u64), two_sided(hits, of as u64))
    } else {
        resampled(nights)
    };
    let n = nights.len() as f64;
    let mean = sum(|n| n.pull) / n;
    let square = nights.iter().map(|n| (n.pull - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    Coverage {
        nights: nights.len(),
        intervals: of,
        held,
        interval,
        missed: [below, above],
        bias: [mean, (square / n).sqrt()],
        p,
    }
}

/// Percentiles of the share that resampled nights hold, and twice the lesser share of resamples on either side of 95 %.
fn resampled(nights: &[Night]) -> ([f64; 2], f64) {
    let mut state = SEED;
    // SplitMix64 (Steele, Lea and Flood 2014).
    let mut next = || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    };
    let n = nights.len() as u64;
    let mut shares: Vec<f64> = (0..RESAMPLES)
        .map(|_| {
            let (mut missed, mut of) = (0.0, 0.0);
            for _ in 0..n {
                let night = nights[(next() % n) as usize];
                missed += night.below + night.above;
                of += night.of;
            }
            1.0 - missed / of
        })
        .collect();
    shares.sort_by(f64::total_cmp);
    let at = |part: f64| shares[((part * RESAMPLES as f64) as usize).min(RESAMPLES - 1)];
    let count = |of: &dyn Fn(f64) -> bool| shares.iter().filter(|s| of(**s)).count() as f64;
    let less = count(&|s| s <= 0.95).min(count(&|s| s >= 0.95)) + 1.0;
    ([at(0.025), at(0.975)], (2.0 * less / (RESAMPLES as f64 + 1.0)).min(1.0))
}

/// P(at most `hits` of n), each with a probability.
fn at_most(hits: u64, n: u64, each: f64) -> f64 {
    if each <= 0.0 {
        return 1.0;
    }
    if each >= 1.0 {
        return f64::from(u8::from(hits >= n));
    }
    let (mut ln_term, mut sum) = (n as f64 * (1.0 - each).ln(), 0.0);
    for k in 0..=hits {
        sum += ln_term.exp();
        ln_term += ((n - k) as f64 / (k + 1) as f64).ln() + (each / (1.0 - each)).ln();
    }
    sum.min(1.0)
}

/// The 95 % interval of a share of which `hits` of n were seen: Clopper and Pearson's.
pub fn clopper_pearson(hits: u64, n: u64) -> [f64; 2] {
    let root = |above: &dyn Fn(f64) -> bool| {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if above(middle) { high = middle } else { low = middle }
        }
        0.5 * (low + high)
    };
    let low = match hits {
        0 => 0.0,
        hits => root(&|p| 1.0 - at_most(hits - 1, n, p) > 0.025),
    };
    let high = if hits == n { 1.0 } else { root(&|p| at_most(hits, n, p) < 0.025) };
    [low, high]
}

/// Twice the lesser tail of a binomial with 95 %.
fn two_sided(hits: u64, n: u64) -> f64 {
    let below = at_most(hits, n, 0.95);
    let above = if hits == 0 { 1.0 } else { 1.0 - at_most(hits - 1, n, 0.95) };
    (2.0 * below.min(above)).min(1.0)
}

/// Probabilities of several questions asked at once: Holm's (1979).
pub fn holm(p: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p.len()).collect();
    order.sort_by(|a, b| p[*a].total_cmp(&p[*b]));
    let (mut adjusted, mut most) = (vec![1.0; p.len()], 0.0_f64);
    for (rank, k) in order.into_iter().enumerate() {
        most = most.max((p[k] * (p.len() - rank) as f64).min(1.0));
        adjusted[k] = most;
    }
    adjusted
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: scipy 1.17.1, `binomtest(k, n, 0.95).proportion_ci(method="exact")`. Tolerance: 1e-6, the digits that were typed.
    #[test]
    fn intervals_of_shares_are_those_of_scipy() {
        for (hits, n, low, high) in [
            (190, 200, 0.909_972_462, 0.975_765_835),
            (135, 135, 0.973_044_918, 1.0),
            (47, 100, 0.369_405_164, 0.572_418_515),
        ] {
            let [a, b] = clopper_pearson(hits, n);
            assert!((a - low).abs() < 1e-6 && (b - high).abs() < 1e-6, "{a} {b}");
        }
        // The same program's `binom.cdf(184, 200, 0.95)`, twice.
        assert!((two_sided(184, 200) - 0.088_711_258).abs() < 1e-6, "{}", two_sided(184, 200));
    }

    /// Truth: by hand: of 0.01, 0.04, 0.03, 0.005 Holm's are 3, 1, 2 and 4 times, each not below the one before.
    #[test]
    fn several_questions_are_asked_at_once() {
        let found = holm(&[0.01, 0.04, 0.03, 0.005]);
        for (a, b) in found.iter().zip([0.03, 0.06, 0.06, 0.02]) {
            assert!((a - b).abs() < 1e-12, "{found:?}");
        }
    }

    /// Truth: by hand: nights whose six intervals hold or miss together are as so many single ones: the standard deviation of a share of 95 % of 400 is 1.09 %, so that the interval is ± 2.1 %, not ± 0.9 % as of 2400. Tolerance: 10 %.
    #[test]
    fn whole_nights_are_drawn_again() {
        let night = |k: usize| Night {
            below: if k < 20 { 6.0 } else { 0.0 },
            above: 0.0,
            of: 6.0,
            pull: if k.is_multiple_of(2) { 1.0 } else { 0.0 },
        };
        let nights: Vec<Night> = (0..400).map(night).collect();
        let found = coverage(&nights);
        assert!((found.held - 0.95).abs() < 1e-12 && found.p > 0.5, "{found:?}");
        let width = 0.5 * (found.interval[1] - found.interval[0]);
        assert!((width / (1.96 * 0.0109) - 1.0).abs() < 0.1, "{found:?}");
        assert!((found.bias[0] - 0.5).abs() < 1e-12 && (found.bias[1] - 0.025).abs() < 1e-3);
    }
}
