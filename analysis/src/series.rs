//! The samples of one channel that count: finite, unflagged, sorted, in seconds from one moment.

use hifitime::Epoch;
use sunglint_radiometry::light_curve::TOLERATED;
use sunglint_radiometry::light_curve::{ChannelCurve, LightCurve};

/// Reasons why no series can be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SeriesError {
    /// Columns of different lengths.
    #[error(
        "{name}: {times} times, {values} values and {sigmas} uncertainties, expected as many of each"
    )]
    Lengths {
        /// The series' name.
        name: String,
        /// Number of times.
        times: usize,
        /// Number of values.
        values: usize,
        /// Number of uncertainties.
        sigmas: usize,
    },
}

/// Samples of one channel, in order of time. What is in it can be computed with: every number is finite.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Whose samples they are, for messages and legends.
    pub name: String,
    /// Seconds from a moment that all series of one question share; not falling.
    pub time_s: Vec<f64>,
    /// The values, Hz or whatever they were given in.
    pub value: Vec<f64>,
    /// Their weights: 1/σ² in units of the values, scaled to a mean of 1; all 1 where an uncertainty was missing or 0.
    pub weight: Vec<f64>,
    /// The longest exposure, s; 0 where it is not known.
    pub exposure_s: f64,
    /// Step to which the magnitudes behind the values are rounded, mag; `None` where they are no magnitudes.
    pub rounding_mag: Option<f64>,
    /// True where the weights come from uncertainties.
    pub is_weighted: bool,
    /// Samples that were left out, and found odd.
    pub left_out: LeftOut,
}

/// Numbers of samples that were left out of a series, and why.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LeftOut {
    /// A flag says that the rate is not what came from the target.
    pub flagged: usize,
    /// Time or value is no number.
    pub not_finite: usize,
    /// Taken at the same moment as another one: not left out, only counted.
    pub same_time: usize,
    /// Stands alone far from its neighbours, and is not seen again at the same phase.
    pub alone: usize,
}

/// The part of the light's variation that no model explains.
const FLOOR: f64 = 0.1;

/// The standard deviation of what is a number, 0 of nothing.
fn deviation(values: &[f64]) -> f64 {
    let good = || values.iter().filter(|v| v.is_finite());
    let n = good().count().max(1) as f64;
    let mean = good().sum::<f64>() / n;
    (good().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt()
}

impl Series {
    /// A series of bare numbers, in any order. `sigma` may be `None`: equal weights. A sample whose time or value is no number is left out and counted;
    /// one whose uncertainty is no number above 0 makes all weights equal, since nothing says how to weigh it against the others.
    ///
    /// # Errors
    /// Columns of different lengths.
    ///
    /// ```
    /// use sunglint_analysis::series::Series;
    ///
    /// let series = Series::new("red", &[2.0, 0.0, 1.0], &[5.0, 1.0, f64::NAN], None)?;
    /// assert_eq!(series.time_s, [0.0, 2.0]);
    /// assert_eq!(series.left_out.not_finite, 1);
    /// assert_eq!(series.mean(), 3.0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn new(
        name: impl Into<String>,
        time_s: &[f64],
        value: &[f64],
        sigma: Option<&[f64]>,
    ) -> Result<Self, SeriesError> {
        let name = name.into();
        let sigmas = sigma.map_or(time_s.len(), <[f64]>::len);
        if time_s.len() != value.len() || sigmas != time_s.len() {
            let (times, values) = (time_s.len(), value.len());
            return Err(SeriesError::Lengths { name, times, values, sigmas });
        }
        let mut order: Vec<usize> =
            (0..time_s.len()).filter(|i| time_s[*i].is_finite() && value[*i].is_finite()).collect();
        let not_finite = time_s.len() - order.len();
        // Samples of one moment by their values, so that the order of a file never matters.
        order.sort_by(|a, b| {
            let sigmas = |i: &usize| sigma.map_or(0.0, |s| s[*i]);
            let values = value[*a].total_cmp(&value[*b]).then(sigmas(a).total_cmp(&sigmas(b)));
            time_s[*a].total_cmp(&time_s[*b]).then(values)
        });
        let pick = |from: &[f64]| order.iter().map(|i| from[*i]).collect::<Vec<f64>>();
        let time = pick(time_s);
        let good = |s: &f64| s.is_finite() && *s > 0.0;
        let sigma = sigma.map(pick).filter(|s| s.iter().all(good));
        let is_weighted = sigma.is_some();
        let weight = match sigma {
            Some(sigma) => {
                // Against the smallest, so that no square leaves the range of floats.
                let least = sigma.iter().copied().fold(f64::INFINITY, f64::min);
                let raw: Vec<f64> = sigma.iter().map(|s| (least / s).powi(2)).collect();
                let mean = raw.iter().sum::<f64>() / raw.len().max(1) as f64;
                raw.iter().map(|w| w / mean).collect()
            }
            None => vec![1.0; time.len()],
        };
        let same_time = time.windows(2).filter(|pair| pair[0] == pair[1]).count();
        Ok(Self {
            value: pick(value),
            time_s: time,
            weight,
            exposure_s: 0.0,
            rounding_mag: None,
            is_weighted,
            left_out: LeftOut { not_finite, same_time, ..LeftOut::default() },
            name,
        })
    }

    /// A channel of a light curve, in seconds from `zero`. Samples with a flag that changes the rate are left out and counted. To the uncertainties a tenth of the light's
    /// standard deviation is added in squares before they become weights.
    ///
    /// # Errors
    /// A channel that is not as long as its curve.
    pub fn of_channel(
        name: impl Into<String>,
        curve: &LightCurve,
        channel: &ChannelCurve,
        zero: Epoch,
    ) -> Result<Self, SeriesError> {
        let lengths = [channel.rate_hz.len(), channel.sigma_hz.len(), channel.flags.len()];
        if lengths.iter().any(|n| *n != curve.len()) {
            let [values, sigmas, _] = lengths;
            return Err(SeriesError::Lengths {
                name: name.into(),
                times: curve.len(),
                values,
                sigmas,
            });
        }
        let kept: Vec<usize> = (0..curve.len())
            .filter(|i| channel.flags[*i].difference(TOLERATED).is_empty())
            .collect();
        let time: Vec<f64> =
            kept.iter().map(|i| (curve.samples.time[*i] - zero).to_seconds()).collect();
        let pick = |from: &[f64]| kept.iter().map(|i| from[*i]).collect::<Vec<f64>>();
        let rate = pick(&channel.rate_hz);
        // No model of harmonics is better than that part of the light's own variation: weights by photon noise alone would all but leave out the glints.
        let floor = FLOOR * deviation(&rate);
        let sigma = pick(&channel.sigma_hz);
        // One that has none would weigh most with that part alone.
        let all_known = sigma.iter().all(|s| s.is_finite() && *s > 0.0);
        let sigma: Vec<f64> = sigma.iter().map(|s| s.hypot(floor)).collect();
        let mut series = Self::new(name, &time, &rate, Some(&sigma[..]).filter(|_| all_known))?;
        series.left_out.flagged = curve.len() - kept.len();
        series.exposure_s = kept.iter().map(|i| curve.samples.exposure_s[*i]).fold(0.0, f64::max);
        Ok(series)
    }

    /// The samples from one moment to before another, s, with weights of a mean of 1 again.
    pub fn piece(&self, name: impl Into<String>, from_s: f64, before_s: f64) -> Self {
        let first = self.time_s.partition_point(|t| *t < from_s);
        let end = self.time_s.partition_point(|t| *t < before_s).max(first);
        let mean = self.weight[first..end].iter().sum::<f64>() / (end - first).max(1) as f64;
        let time_s = self.time_s[first..end].to_vec();
        let same_time = time_s.windows(2).filter(|pair| pair[0] == pair[1]).count();
        Self {
            name: name.into(),
            value: self.value[first..end].to_vec(),
            weight: self.weight[first..end].iter().map(|w| w / mean).collect(),
            time_s,
            left_out: LeftOut { same_time, ..LeftOut::default() },
            ..*self
        }
    }

    /// The samples for which `keep` is true, with weights of a mean of 1 again.
    pub fn kept(&self, keep: &[bool]) -> Self {
        let pick = |from: &[f64]| -> Vec<f64> {
            from.iter().zip(keep).filter(|(_, k)| **k).map(|(v, _)| *v).collect()
        };
        let (time_s, weight) = (pick(&self.time_s), pick(&self.weight));
        let mean = weight.iter().sum::<f64>() / weight.len().max(1) as f64;
        Self {
            name: self.name.clone(),
            value: pick(&self.value),
            weight: weight.iter().map(|w| w / mean).collect(),
            time_s,
            ..*self
        }
    }

    /// The means of neighbouring samples within `width_s`, which then counts as the exposure.
    pub fn binned(&self, width_s: f64) -> Self {
        let (mut time_s, mut value, mut weight) = (Vec::new(), Vec::new(), Vec::new());
        let mut i = 0;
        while i < self.len() {
            let (from, first) = (self.time_s[i], i);
            while i < self.len() && self.time_s[i] - from < width_s {
                i += 1;
            }
            let own = first..i;
            let total: f64 = self.weight[own.clone()].iter().sum();
            let sum: f64 = own.clone().map(|k| self.weight[k] * self.value[k]).sum();
            time_s.push(self.time_s[own.clone()].iter().sum::<f64>() / own.len() as f64);
            value.push(sum / total);
            weight.push(total);
        }
        let mean = weight.iter().sum::<f64>() / weight.len().max(1) as f64;
        Self {
            name: self.name.clone(),
            time_s,
            value,
            weight: weight.iter().map(|w| w / mean).collect(),
            exposure_s: self.exposure_s.max(width_s),
            ..*self
        }
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time_s.len()
    }

    /// Returns true where there is none.
    pub fn is_empty(&self) -> bool {
        self.time_s.is_empty()
    }

    /// From the first to the last sample, s.
    pub fn span_s(&self) -> f64 {
        match (self.time_s.first(), self.time_s.last()) {
            (Some(first), Some(last)) => last - first,
            _ => 0.0,
        }
    }

    /// Scatter (standard deviation) and rounding step, mag, where the first is no more than the second: nothing but the rounding of constant light need be in it.
    pub(crate) fn rounded_away(&self) -> Option<(f64, f64)> {
        let step_mag = self.rounding_mag?;
        let scatter_mag = 2.5 / std::f64::consts::LN_10 * deviation(&self.value) / self.mean();
        (scatter_mag >= 0.0 && scatter_mag <= step_mag).then_some((scatter_mag, step_mag))
    }

    /// The weighted mean; `NaN` of nothing.
    pub fn mean(&self) -> f64 {
        let sum: f64 = self.value.iter().zip(&self.weight).map(|(v, w)| v * w).sum();
        sum / self.weight.iter().sum::<f64>()
    }
}
