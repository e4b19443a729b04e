//! Stretches where a sampled function is positive, and the place where it is highest.

/// Times are found this well, s.
const TIME_S: f64 = 5e-4;

/// A value at a time, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sample {
    pub t: f64,
    pub value: f64,
}

/// The spans in which a function is positive, to half a millisecond. Between three samples of one sign the middle of which is
/// nearest to zero, an extremum beyond zero is looked for.
pub(super) fn positive(samples: &[Sample], value: impl Fn(f64) -> f64) -> Vec<(f64, f64)> {
    // The changes of sign, in order; every other one is a begin.
    let mut changes: Vec<f64> = Vec::new();
    for (i, s) in samples.iter().enumerate() {
        if let Some(next) = samples.get(i + 1)
            && (s.value > 0.0) != (next.value > 0.0)
        {
            changes.push(crossing(*s, *next, &value));
        } else if i > 0
            && let Some(next) = samples.get(i + 1)
        {
            let before = samples[i - 1];
            let sign = if s.value > 0.0 { -1.0 } else { 1.0 };
            let [a, b, c] = [before, *s, *next].map(|s| sign * s.value);
            // A bump is not higher over its middle sample than the largest step to it.
            if a <= 0.0 && a < b && b >= c && b + (b - a).max(b - c) > 0.0 {
                let top = maximum(before.t, next.t, |t| sign * value(t));
                if top.value > 0.0 {
                    let top = Sample { value: sign * top.value, ..top };
                    changes.push(crossing(before, top, &value));
                    changes.push(crossing(top, *next, &value));
                }
            }
        }
    }
    changes.sort_by(f64::total_cmp);
    let (Some(first), Some(last)) = (samples.first(), samples.last()) else { return Vec::new() };
    if first.value > 0.0 {
        changes.insert(0, first.t);
    }
    if changes.len() % 2 == 1 {
        changes.push(last.t);
    }
    changes.chunks_exact(2).map(|pair| (pair[0], pair[1])).filter(|(a, b)| b > a).collect()
}

/// The highest point between samples.
pub(super) fn highest(samples: &[Sample], value: impl Fn(f64) -> f64) -> Sample {
    let best = (0..samples.len()).max_by(|i, j| samples[*i].value.total_cmp(&samples[*j].value));
    let Some(i) = best else { return Sample { t: 0.0, value: f64::NAN } };
    let (before, after) = (i.saturating_sub(1), (i + 1).min(samples.len() - 1));
    let inner = maximum(samples[before].t, samples[after].t, value);
    if inner.value > samples[i].value { inner } else { samples[i] }
}

/// Between two samples of different sign, by false position (Illinois), which bisects where that is slow.
fn crossing(a: Sample, b: Sample, value: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (a, b);
    let (mut low_weight, mut high_weight) = (1.0, 1.0);
    let mut rounds = 0;
    while high.t - low.t > TIME_S {
        let (x, y) = (low.value * low_weight, high.value * high_weight);
        rounds += 1;
        let t = if rounds % 4 == 0 {
            0.5 * (low.t + high.t)
        } else {
            // Never nearer to an end than the tolerance, so that both ends close in.
            let margin = 0.4 * TIME_S;
            (low.t - x * (high.t - low.t) / (y - x)).clamp(low.t + margin, high.t - margin)
        };
        let middle = Sample { t, value: value(t) };
        if (middle.value > 0.0) == (low.value > 0.0) {
            low = middle;
            (low_weight, high_weight) = (1.0, 0.5 * high_weight);
        } else {
            high = middle;
            (low_weight, high_weight) = (0.5 * low_weight, 1.0);
        }
    }
    0.5 * (low.t + high.t)
}

/// The maximum of a function with one between two times, by golden sections, to 5 ms.
fn maximum(mut low: f64, mut high: f64, value: impl Fn(f64) -> f64) -> Sample {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let at = |t: f64| Sample { t, value: value(t) };
    let mut left = at(high - GOLDEN * (high - low));
    let mut right = at(low + GOLDEN * (high - low));
    while high - low > 10.0 * TIME_S {
        if left.value > right.value {
            high = right.t;
            right = left;
            left = at(high - GOLDEN * (high - low));
        } else {
            low = left.t;
            left = right;
            right = at(low + GOLDEN * (high - low));
        }
    }
    if left.value > right.value { left } else { right }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sampled(step: f64, end: f64, value: impl Fn(f64) -> f64) -> Vec<Sample> {
        (0..=(end / step) as usize)
            .map(|i| i as f64 * step)
            .map(|t| Sample { t, value: value(t) })
            .collect()
    }

    /// Truth: zeros and maxima of a sine by hand; to the millisecond that is promised.
    #[test]
    fn spans_of_a_sine() {
        let value = |t: f64| (t / 10.0).sin();
        let spans = positive(&sampled(7.0, 140.0, value), value);
        let pi = std::f64::consts::PI;
        let truth = [(0.0, 10.0 * pi), (20.0 * pi, 30.0 * pi), (40.0 * pi, 140.0)];
        assert_eq!(spans.len(), 3);
        for (found, truth) in spans.iter().zip(truth) {
            assert!((found.0 - truth.0).abs() < 1e-3 && (found.1 - truth.1).abs() < 1e-3);
        }
        let top = highest(&sampled(7.0, 40.0, value), value);
        assert!((top.t - 5.0 * pi).abs() < 1e-2 && (top.value - 1.0).abs() < 1e-6);
    }

    /// Truth: a parabola over zero for 0.4 s, between samples 10 s apart; a dip below zero as short; one that stays below.
    #[test]
    fn what_lies_between_samples_is_found() {
        for offset in [0.0, 1.0, 4.9, 5.0, 8.0] {
            let bump = move |t: f64| 0.04 - (t - 50.0 - offset).powi(2);
            let spans = positive(&sampled(10.0, 100.0, bump), bump);
            assert_eq!(spans.len(), 1, "{offset}");
            assert!((spans[0].0 - 49.8 - offset).abs() < 1e-3, "{spans:?}");
            assert!((spans[0].1 - 50.2 - offset).abs() < 1e-3, "{spans:?}");
            let dip = move |t: f64| -bump(t);
            let spans = positive(&sampled(10.0, 100.0, dip), dip);
            assert_eq!(spans.len(), 2, "{offset}");
            let below = move |t: f64| bump(t) - 0.05;
            assert!(positive(&sampled(10.0, 100.0, below), below).is_empty());
        }
    }
}
