//! Several readings at an angle as one.

use sunglint_numerics::order::median;

/// The readings at one angle, as they came.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct AtAngle {
    /// The stage's angle, degrees.
    pub angle_deg: f64,
    /// When they were read (their middle), s, from any zero common to the run.
    pub time_s: f64,
    /// Powers, W.
    pub power_w: Vec<f64>,
    /// Readings over range besides.
    pub over: usize,
    /// The meter's range, as it names it.
    pub range: String,
}

/// Readings as one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mean {
    /// The mean without outliers, W; not a number where there is none.
    pub power_w: f64,
    /// Standard uncertainty of the mean by the scatter, W.
    pub sigma_w: f64,
    /// Readings in it.
    pub used: usize,
    /// Outliers.
    pub left_out: usize,
    /// Readings over range.
    pub over: usize,
}

/// A reading further from the median than this many standard deviations is an outlier.
const OUTLIER: f64 = 5.0;
/// MAD of a normal distribution: σ over this.
const MAD: f64 = 0.674_489_750_196_081_7;
/// Angles on both sides that help to tell the scatter, ten readings of one angle alone tell it to a quarter only.
const BESIDE: usize = 3;

/// Means of a scan, in its order.
///
/// The scatter of an angle is that of its readings and those of up to three angles before and after it that were read in the same range with powers within a
/// factor of two, each relative to its power: first by the median of absolute deviations, about which readings beyond 5 σ are left out, then by the variance
/// of those that stay. It is never taken below what the meter's digits allow.
pub fn means(scan: &[AtAngle]) -> Vec<Mean> {
    let medians: Vec<f64> =
        scan.iter().map(|at| median(at.power_w.iter().copied()).unwrap_or(f64::NAN)).collect();
    let digits: Vec<f64> = scan.iter().map(|at| digit(scan, &at.range)).collect();
    let neighbours = |k: usize| {
        let near = k.saturating_sub(BESIDE)..(k + BESIDE + 1).min(scan.len());
        let (scan, medians) = (&scan, &medians);
        near.filter(move |j| {
            let ratio = medians[*j] / medians[k];
            *j == k || (scan[*j].range == scan[k].range && (0.5..=2.0).contains(&ratio))
        })
        .filter(move |j| !scan[*j].power_w.is_empty())
    };
    // Relative to the power of angle k.
    let scale = |j: usize, k: usize| if j == k { 1.0 } else { medians[k] / medians[j] };
    let kept: Vec<Vec<f64>> = (0..scan.len())
        .map(|k| {
            let away = |j: usize| {
                let scale = scale(j, k);
                let middle = medians[j];
                scan[j].power_w.iter().map(move |p| (p - middle).abs() * scale)
            };
            let all: Vec<f64> = neighbours(k).flat_map(away).collect();
            let sigma = (median(all).unwrap_or(f64::NAN) / MAD).max(digits[k]);
            let stays = |p: &&f64| (*p - medians[k]).abs() <= OUTLIER * sigma;
            scan[k].power_w.iter().filter(stays).copied().collect()
        })
        .collect();
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    (0..scan.len())
        .map(|k| {
            let (mut squares, mut free) = (0.0, 0.0);
            for j in neighbours(k).filter(|j| kept[*j].len() > 1) {
                let middle = mean(&kept[j]);
                let square: f64 = kept[j].iter().map(|p| (p - middle).powi(2)).sum();
                squares += square * scale(j, k).powi(2);
                free += kept[j].len() as f64 - 1.0;
            }
            let used = kept[k].len();
            let scatter = if free > 0.0 { squares / free } else { f64::NAN };
            let variance = scatter.max(digits[k] * digits[k] / 12.0);
            Mean {
                power_w: mean(&kept[k]),
                sigma_w: (variance / used as f64).sqrt(),
                used,
                left_out: scan[k].power_w.len() - used,
                over: scan[k].over,
            }
        })
        .collect()
}

/// The least difference between two readings at an angle in a range, W: a step of its digits or more; 0 where all are equal.
fn digit(scan: &[AtAngle], range: &str) -> f64 {
    let at_one = |at: &AtAngle| {
        let mut values = at.power_w.clone();
        values.sort_by(f64::total_cmp);
        let apart = values.windows(2).map(|pair| pair[1] - pair[0]).filter(|d| *d > 0.0);
        apart.fold(f64::INFINITY, f64::min)
    };
    let least =
        scan.iter().filter(|at| at.range == range).map(at_one).fold(f64::INFINITY, f64::min);
    if least.is_finite() { least } else { 0.0 }
}
