//! Normal points: what a station makes of its single returns.
//!
//! The procedure is the ILRS's (the Herstmonceux recommendation as restated by A. T. Sinclair, 1997, `npt_algorithm.html` of the ILRS's site; its steps are from memory): residuals against the predicted times of
//! flight; a smooth trend taken from them, with returns beyond a multiple of the rms left out until none is; bins of fixed length from 0 h UTC; in each bin the mean residual and the mean epoch; the return whose epoch is nearest to
//! that, moved onto the bin's mean residual.

use std::collections::BTreeMap;

/// Returns beyond so many rms of the fit are left out.
const REJECTED: f64 = 3.0;
/// Rounds of fit and rejection at most.
const ROUNDS: usize = 50;
/// Numbers of the trend, a polynomial of time.
const TERMS: usize = 4;
/// Returns of a normal point at least: the ILRS's Governing Board asks for 3 at night (Nice, 2002).
pub const LEAST_SHOTS: usize = 3;

/// A return against its prediction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// When the shot left, s after 0 h UTC of the first day.
    pub sent_s: f64,
    /// Time of flight less the predicted one, s.
    pub residual_s: f64,
}

/// Moments of residuals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moments {
    /// How many there are.
    pub count: usize,
    /// Mean, s.
    pub mean_s: f64,
    /// Root mean square about the mean, s, by the number of residuals.
    pub rms_s: f64,
    /// Third moment over that of a normal distribution's width; `None` without scatter.
    pub skewness: Option<f64>,
    /// Fourth moment over the square of the second, less 3; `None` without scatter.
    pub kurtosis: Option<f64>,
}

impl Moments {
    /// Moments of values, s; `None` without any.
    pub fn of(values: &[f64]) -> Option<Self> {
        let count = values.len();
        if count == 0 {
            return None;
        }
        let n = count as f64;
        let mean_s = values.iter().sum::<f64>() / n;
        let moment = |power: i32| values.iter().map(|v| (v - mean_s).powi(power)).sum::<f64>() / n;
        let square = moment(2);
        let over = |by: f64, power: i32| (square > 0.0).then(|| moment(power) / by);
        Some(Self {
            count,
            mean_s,
            rms_s: square.sqrt(),
            skewness: over(square * square.sqrt(), 3),
            kurtosis: over(square * square, 4).map(|k| k - 3.0),
        })
    }
}

/// A normal point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NormalPoint {
    /// Number of the return that stands for all, among those that went in.
    pub nearest: usize,
    /// Shift of that return's time of flight, s.
    pub shift_s: f64,
    /// Begin of the bin, s after 0 h UTC of the first day.
    pub from_s: f64,
    /// Residuals of the bin against the trend.
    pub moments: Moments,
}

/// The normal points of a pass.
#[derive(Debug, Clone, PartialEq)]
pub struct NormalPoints {
    /// Points in the order of time.
    pub points: Vec<NormalPoint>,
    /// All accepted residuals against the trend; `None` without any.
    pub moments: Option<Moments>,
    /// Returns that the screening left out.
    pub rejected: usize,
    /// Returns in bins of fewer than [`LEAST_SHOTS`].
    pub in_small_bins: usize,
}

impl NormalPoints {
    /// Makes normal points of returns in the order of time, in bins of `bin_s` seconds (above 0).
    pub fn new(residuals: &[Residual], bin_s: f64) -> Self {
        let (kept, fitted) = screened(residuals);
        let mut bins = BTreeMap::<i64, Vec<usize>>::new();
        for i in (0..residuals.len()).filter(|i| kept[*i]) {
            bins.entry((residuals[i].sent_s / bin_s).floor() as i64).or_default().push(i);
        }
        let accepted: Vec<f64> =
            fitted.iter().zip(&kept).filter(|(_, k)| **k).map(|(f, _)| *f).collect();
        let mut made = Self {
            points: Vec::new(),
            moments: Moments::of(&accepted),
            rejected: kept.iter().filter(|k| !**k).count(),
            in_small_bins: 0,
        };
        for (bin, members) in bins {
            if members.len() < LEAST_SHOTS {
                made.in_small_bins += members.len();
                continue;
            }
            let values: Vec<f64> = members.iter().map(|i| fitted[*i]).collect();
            let epochs = members.iter().map(|i| residuals[*i].sent_s);
            let mean_epoch = epochs.sum::<f64>() / members.len() as f64;
            let away = |i: &usize| (residuals[*i].sent_s - mean_epoch).abs();
            let nearest = members.iter().copied().min_by(|a, b| away(a).total_cmp(&away(b)));
            if let (Some(nearest), Some(moments)) = (nearest, Moments::of(&values)) {
                let shift_s = moments.mean_s - fitted[nearest];
                made.points.push(NormalPoint {
                    nearest,
                    shift_s,
                    from_s: bin as f64 * bin_s,
                    moments,
                });
            }
        }
        made
    }
}

/// Which residuals are kept, and all of them less the trend of these.
fn screened(residuals: &[Residual]) -> (Vec<bool>, Vec<f64>) {
    let mut kept = vec![true; residuals.len()];
    let mut fitted = Vec::new();
    for _ in 0..ROUNDS {
        let chosen: Vec<Residual> =
            residuals.iter().zip(&kept).filter(|(_, k)| **k).map(|(r, _)| *r).collect();
        let trend = Trend::of(&chosen);
        fitted = residuals.iter().map(|r| r.residual_s - trend.at(r.sent_s)).collect();
        let n = chosen.len() as f64;
        let square: f64 = fitted.iter().zip(&kept).filter(|(_, k)| **k).map(|(f, _)| f * f).sum();
        let limit = REJECTED * (square / n).sqrt();
        // A few returns have no rms that would say which of them are wrong.
        let good: Vec<bool> =
            fitted.iter().map(|f| chosen.len() <= 2 * TERMS || f.abs() <= limit).collect();
        if good == kept {
            break;
        }
        kept = good;
    }
    (kept, fitted)
}

/// A polynomial of time, by orthogonal polynomials on the given times.
struct Trend {
    middle_s: f64,
    half_s: f64,
    /// Recurrence and coefficient of each term.
    terms: Vec<[f64; 3]>,
}

impl Trend {
    fn of(residuals: &[Residual]) -> Self {
        let times = residuals.iter().map(|r| r.sent_s);
        let (from, to) =
            times.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| (a.min(t), b.max(t)));
        let middle_s = if from <= to { 0.5 * (from + to) } else { 0.0 };
        let half_s = if to > from { 0.5 * (to - from) } else { 1.0 };
        let x: Vec<f64> = residuals.iter().map(|r| (r.sent_s - middle_s) / half_s).collect();
        let (mut before, mut now) = (vec![0.0; x.len()], vec![1.0; x.len()]);
        let (mut norm_before, mut terms) = (1.0, Vec::new());
        for _ in 0..TERMS.min(residuals.len() / 2).max(1) {
            let norm: f64 = now.iter().map(|p| p * p).sum();
            if norm <= 1e-9 * x.len() as f64 {
                break;
            }
            let of = residuals.iter().zip(&now).map(|(r, p)| r.residual_s * p).sum::<f64>() / norm;
            let a = x.iter().zip(&now).map(|(x, p)| x * p * p).sum::<f64>() / norm;
            let b = if terms.is_empty() { 0.0 } else { norm / norm_before };
            terms.push([a, b, of]);
            let next = (0..x.len()).map(|i| (x[i] - a) * now[i] - b * before[i]).collect();
            (before, now, norm_before) = (now, next, norm);
        }
        Self { middle_s, half_s, terms }
    }

    fn at(&self, sent_s: f64) -> f64 {
        let x = (sent_s - self.middle_s) / self.half_s;
        let (mut before, mut now, mut sum) = (0.0, 1.0, 0.0);
        for [a, b, of] in &self.terms {
            sum += of * now;
            (before, now) = (now, (x - a) * now - b * before);
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(sent_s: f64, residual_s: f64) -> Residual {
        Residual { sent_s, residual_s }
    }

    /// Truth: moments of 1, 2, 3, 6 by hand: mean 3, deviations -2 -1 0 3, second moment 14/4, third 18/4, fourth 98/4.
    #[test]
    fn moments_by_hand() {
        let found = Moments::of(&[1.0, 2.0, 3.0, 6.0]).unwrap();
        assert_eq!((found.count, found.mean_s), (4, 3.0));
        assert!((found.rms_s - 3.5_f64.sqrt()).abs() < 1e-15);
        assert!((found.skewness.unwrap() - 4.5 / 3.5_f64.powf(1.5)).abs() < 1e-15);
        assert!((found.kurtosis.unwrap() - (24.5 / 12.25 - 3.0)).abs() < 1e-15);
        assert_eq!(Moments::of(&[]), None);
        let one = Moments::of(&[2.0]).unwrap();
        assert_eq!((one.rms_s, one.skewness, one.kurtosis), (0.0, None, None));
    }

    /// Truth: residuals about a cubic (which the trend takes away) in an even pattern of +1, −1, −1, +1 ns each 4 s, to which a polynomial of third order is
    /// nearly blind (1e-2 ns). A return 100 ns off is left out, another is alone in its bin. Bins are of 20 s from 0 h: 100 to 120 s first. The mean of each bin is 0, its rms 1 ns, and its kurtosis that of two
    /// values, −2.
    #[test]
    fn trend_bins_and_screening() {
        let cubic = |t: f64| 1e-7 * (t / 300.0).powi(3) - 3e-8 * (t / 300.0) + 5e-9;
        let pattern = |k: usize| [1e-9, -1e-9, -1e-9, 1e-9][k % 4];
        let mut all: Vec<Residual> = (0..400)
            .map(|k| (100.0 + 0.5 * k as f64, k))
            .map(|(t, k)| at(t, cubic(t) + pattern(k)))
            .collect();
        all[40].residual_s += 1e-7;
        all.push(at(310.0, cubic(310.0)));
        let found = NormalPoints::new(&all, 20.0);
        assert_eq!((found.rejected, found.in_small_bins), (1, 1));
        assert_eq!(found.points.len(), 10);
        assert_eq!((found.points[0].from_s, found.points[0].moments.count), (100.0, 40));
        assert_eq!((found.points[1].from_s, found.points[1].moments.count), (120.0, 39));
        for (number, point) in found.points.iter().enumerate().filter(|(n, _)| *n != 1) {
            assert!(point.moments.mean_s.abs() < 2e-11, "{point:?}");
            assert!((point.moments.rms_s - 1e-9).abs() < 1e-11, "{point:?}");
            assert!((point.moments.kurtosis.unwrap() + 2.0).abs() < 0.05, "{point:?}");
            // The mean epoch of 40 returns half a second apart lies between the 20th and the 21st.
            let first = 40 * number;
            assert!(point.nearest == first + 19 || point.nearest == first + 20, "{point:?}");
            let moved = all[point.nearest].residual_s + point.shift_s;
            assert!((moved - cubic(all[point.nearest].sent_s)).abs() < 3e-11, "{point:?}");
        }
    }

    #[test]
    fn few_returns_make_no_point() {
        let none = NormalPoints::new(&[], 5.0);
        assert_eq!((none.points.len(), none.moments), (0, None));
        let two = NormalPoints::new(&[at(1.0, 1e-9), at(2.0, 2e-9)], 5.0);
        assert_eq!((two.points.len(), two.in_small_bins, two.rejected), (0, 2, 0));
        // All at one time.
        let same = NormalPoints::new(&[at(1.0, 1e-9), at(1.0, 2e-9), at(1.0, 3e-9)], 5.0);
        assert_eq!(same.points.len(), 1);
        assert!((same.points[0].moments.rms_s - 1e-9 * (2.0_f64 / 3.0).sqrt()).abs() < 1e-18);
    }
}
