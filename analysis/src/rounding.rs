//! Steps to which times are rounded.

use sunglint_numerics::order::median;

/// Steps to which times are usually rounded, s: a minute, decimals of a second, decimals of a day; whether it is one of a day.
const STEPS: [(f64, bool); 13] = [
    (8640.0, true),
    (864.0, true),
    (86.4, true),
    (60.0, false),
    (10.0, false),
    (8.64, true),
    (1.0, false),
    (0.864, true),
    (0.1, false),
    (0.0864, true),
    (0.01, false),
    (0.00864, true),
    (0.001, false),
];
/// Part of a step by which times may lie beside its multiples: a Julian date in a double is good to 40 µs.
const BESIDE: f64 = 0.01;
/// Fewer different times may lie on multiples by chance.
const LEAST: usize = 12;
/// Share of the steps between samples that are the shortest, where times on a decimal of a day are sampled so and not rounded.
const ALIKE: f64 = 0.95;

/// Returns the step to which times are rounded, s: the largest usual one of which all differences are multiples. `None` where there is none, or where the samples themselves were taken on such multiples as far as they show. Times do not fall.
pub(crate) fn rounding_s(time_s: &[f64]) -> Option<f64> {
    let first = time_s.first()?;
    let is_on = |t: f64, step: f64| ((t / step).round() - t / step).abs() <= BESIDE;
    let (step_s, of_day) =
        STEPS.into_iter().find(|(step, _)| time_s.iter().all(|t| is_on(t - first, *step)))?;
    let between: Vec<f64> = time_s.windows(2).map(|t| t[1] - t[0]).collect();
    let units: Vec<f64> =
        between.iter().map(|d| (d / step_s).round()).filter(|n| *n > 0.0).collect();
    let least = units.iter().copied().fold(f64::INFINITY, f64::min);
    if units.len() + 1 < LEAST {
        return None;
    }
    let is_doubled = units.len() < between.len();
    let odd = units.iter().any(|n| n % least != 0.0);
    let alike = units.iter().filter(|n| **n == least).count() as f64 / units.len() as f64;
    (is_doubled || odd || of_day && alike < ALIKE).then_some(step_s)
}

/// Returns the same where it is more than a twentieth of the usual step of the samples: then it is felt.
pub(crate) fn felt_rounding_s(time_s: &[f64]) -> Option<f64> {
    let usual = median(time_s.windows(2).map(|t| t[1] - t[0]).filter(|d| *d > 0.0))?;
    rounding_s(time_s).filter(|step| *step > usual / 20.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Times of a cadence, rounded to a step, as doubles of a Julian date.
    fn rounded(cadence: f64, step: f64) -> Vec<f64> {
        let days = |t: f64| 2_459_000.3 + (t / step).round() * step / 86_400.0;
        (0..300).map(|i| (days(cadence * f64::from(i)) - 2_459_000.3) * 86_400.0).collect()
    }

    /// Truth: the steps that were put in: 1e-5 d and 1e-4 d of Julian dates, whole seconds, milliseconds. Samples that were taken on whole steps, with or without gaps, are not rounded, nor are any times.
    #[test]
    fn steps_of_rounded_times_are_found() {
        for (cadence, step) in [
            (2.0, 0.864),
            (1.1, 0.864),
            (2.0, 8.64),
            (31.0, 8.64),
            (2.4, 1.0),
            (0.3, 1.0),
            (7.137, 0.01),
        ] {
            assert_eq!(rounding_s(&rounded(cadence, step)), Some(step), "{cadence} {step}");
        }
        for (cadence, step) in [(2.0, 1.0), (0.1, 0.1), (86.4, 86.4), (90.0, 1.0)] {
            assert_eq!(rounding_s(&rounded(cadence, step)), None, "{cadence} {step}");
        }
        let gappy: Vec<f64> = (0..300_u32).filter(|i| i % 50 < 40).map(f64::from).collect();
        assert_eq!(rounding_s(&gappy), None);
        let any: Vec<f64> = (0..300).map(|i| f64::from(i) * 2.0_f64.sqrt()).collect();
        assert_eq!(rounding_s(&any), None);
        assert_eq!(felt_rounding_s(&rounded(2.0, 0.864)), Some(0.864));
        assert_eq!(felt_rounding_s(&rounded(91.0, 0.864)), None);
        assert_eq!(rounding_s(&[]), None);
        assert_eq!(rounding_s(&[1.0]), None);
    }
}
