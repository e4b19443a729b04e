//! Measured data as the fit wants them: numbers by epoch and channel, their noise, and what the channels share.

use super::FitError;
use ndarray::Array2;
use sunglint_numerics::order::median;

/// A variance that follows the model's rate stays above this share of the stated one.
const LEAST_VARIANCE: f64 = 0.1;

/// Samples before and after one whose median stands for its rate before there is a model, where uncertainties are shares of rates.
const NEIGHBOURS: usize = 4;

/// One measured curve. All curves of a fit have the same channels in the same order; what a curve lacks is not `used`.
#[derive(Debug, Clone)]
pub struct Data {
    /// Name of the curve, in messages.
    pub name: String,
    /// Rates, epochs × channels, in the unit of the model's ([`super::Columns`]): Hz, or fluxes.
    pub rate: Array2<f64>,
    /// Their stated standard uncertainties, each channel's own: photons, background.
    pub sigma: Array2<f64>,
    /// Which of them count. Those that do not may be NaN.
    pub used: Array2<bool>,
    /// Moment of each epoch, s, from any moment of the curve on; how long errors of the model last is told by them.
    pub time_s: Vec<f64>,
    /// Relative variance that all channels of an epoch share: scintillation ([`sunglint_calibration::stars::scintillation::Aperture`]).
    pub common_variance: Vec<f64>,
    /// Growth of the variance with the rate, ∂σ²/∂rate, epochs × channels: photons. Zeros where the stated variances hold as they are.
    pub variance_slope: Array2<f64>,
    /// The uncertainties as shares of the rates, epochs × channels, where they are such, as those of magnitudes are: then they follow the model's rates. A sample that is too faint by chance
    /// would have an uncertainty that is too small by as much, and draw all others.
    pub share: Option<Array2<f64>>,
    /// Error of the calibration, where it is known.
    pub calibration: Option<CalibrationError>,
    /// Standard uncertainty that all samples of a channel have in common, as by a level that was taken off all of them, in the unit of the rates, epochs × channels; it is not in [`Data::sigma`]. Channels
    /// are independent.
    pub level: Option<Array2<f64>>,
}

/// An error of calibration: the same in all samples of a channel. Curves of the same night share it.
#[derive(Debug, Clone)]
pub struct CalibrationError {
    /// The night: curves with the same key share their errors.
    pub key: String,
    /// Covariance of ln κ, channels × channels.
    pub covariance: Array2<f64>,
}

impl Data {
    /// A curve of which all finite samples with an uncertainty above 0 count, without common noise.
    pub fn new(name: impl Into<String>, rate: Array2<f64>, sigma: Array2<f64>) -> Self {
        let mut used = Array2::from_elem(rate.raw_dim(), false);
        ndarray::Zip::from(&mut used)
            .and(&rate)
            .and(&sigma)
            .for_each(|u, r, s| *u = r.is_finite() && s.is_finite() && *s > 0.0);
        Self {
            name: name.into(),
            time_s: (0..rate.nrows()).map(|i| i as f64).collect(),
            common_variance: vec![0.0; rate.nrows()],
            variance_slope: Array2::zeros(rate.raw_dim()),
            share: None,
            calibration: None,
            level: None,
            rate,
            sigma,
            used,
        }
    }

    /// Takes a part of the stated uncertainties as an error that all samples of a channel have in common ([`Data::level`]). Samples keep at least a thousandth of theirs for themselves; where the part is
    /// not known it is none.
    pub fn with_level(&mut self, mut level: Array2<f64>) {
        ndarray::Zip::from(&mut level).and(&mut self.sigma).for_each(|level, sigma| {
            let most = *sigma * (1.0 - 1e-6_f64).sqrt();
            *level = if *level > 0.0 && most.is_finite() { level.min(most) } else { 0.0 };
            *sigma = (*sigma * *sigma - *level * *level).sqrt();
        });
        self.level = level.iter().any(|hz| *hz > 0.0).then_some(level);
    }

    /// Rates of magnitudes as their noise leaves them in the mean. Noise of σ in a magnitude raises the mean light by exp(s²/2), s = 0.921 σ, and makes its variance exp(s²) − 1 of its square: without
    /// that, 0.3 mag would make bodies 4 % brighter.
    pub(crate) fn in_the_mean(&mut self) {
        let Some(share) = &mut self.share else { return };
        let each = ndarray::Zip::from(share).and(&mut self.rate).and(&mut self.sigma);
        each.for_each(|share, rate, sigma| {
            let mean = (-0.5 * *share * *share).exp();
            *rate *= mean;
            *sigma *= mean;
            *share = (*share * *share).exp_m1().sqrt();
        });
    }

    /// Epochs.
    pub fn epochs(&self) -> usize {
        self.rate.nrows()
    }

    /// Channels.
    pub fn channels(&self) -> usize {
        self.rate.ncols()
    }

    /// Samples that count.
    pub fn count(&self) -> usize {
        self.used.iter().filter(|u| **u).count()
    }

    /// Finds how the stated variances go with the rates: photons make σ² t = a + b·rate, and where they do a sample that came out low by chance
    /// also has a σ that is too low, which would draw a fit below the truth. `exposure_s` per epoch. Channels whose variances do not
    /// follow their rates (correlation below 0.3, fewer than eight samples) keep theirs.
    pub fn follow_photons(&mut self, exposure_s: &[f64]) {
        for c in 0..self.channels() {
            let samples: Vec<(f64, f64)> = (0..self.epochs().min(exposure_s.len()))
                .filter(|i| self.used[[*i, c]])
                .map(|i| (self.rate[[i, c]], self.sigma[[i, c]].powi(2) * exposure_s[i]))
                .collect();
            let Some(slope) = slope(&samples) else { continue };
            for (i, t) in exposure_s.iter().enumerate().take(self.epochs()) {
                self.variance_slope[[i, c]] = slope / t;
            }
        }
    }

    /// The variance of a sample where the model says what its rate is.
    pub(super) fn variance(&self, epoch: usize, channel: usize, model: Option<f64>) -> f64 {
        let at = [epoch, channel];
        let stated = self.sigma[at].powi(2);
        if let Some(share) = &self.share {
            // Not below what the track's own brightness says: where the model lacks a glint, its rate is no measure of the light's uncertainty.
            let rate = model.unwrap_or_else(|| self.beginning(epoch, channel));
            return (share[at] * rate).powi(2).max(stated);
        }
        match model {
            Some(model) => (stated + self.variance_slope[at] * (model - self.rate[at]))
                .max(LEAST_VARIANCE * stated),
            None => stated,
        }
    }

    /// The variance of the logarithm of a sample's rate where its uncertainty is a share of it; `None` of any other.
    pub(super) fn log_variance(&self, epoch: usize, channel: usize) -> Option<f64> {
        self.share.as_ref().map(|share| share[[epoch, channel]].powi(2).ln_1p())
    }

    /// The rate that stands for a sample's before there is a model: its own, or the median of its neighbours' where that is more.
    pub(super) fn beginning(&self, epoch: usize, channel: usize) -> f64 {
        let own = self.rate[[epoch, channel]];
        if self.share.is_none() {
            return own;
        }
        let near = epoch.saturating_sub(NEIGHBOURS)..(epoch + NEIGHBOURS + 1).min(self.epochs());
        let near = near.filter(|i| self.used[[*i, channel]]).map(|i| self.rate[[i, channel]]);
        median(near).map_or(own, |usual| usual.max(own))
    }

    pub(super) fn check(&self) -> Result<(), FitError> {
        let shape = self.rate.dim();
        let wrong = |what: &str, found: String| {
            Err(FitError::Input { what: format!("{}: {what}", self.name), found })
        };
        for (what, found) in [
            ("uncertainties", self.sigma.dim()),
            ("marks of what counts", self.used.dim()),
            ("slopes of the variance", self.variance_slope.dim()),
            ("levels", self.level.as_ref().map_or(shape, Array2::dim)),
        ] {
            if found != shape {
                return wrong(what, format!("{found:?}, expected {shape:?}"));
            }
        }
        if self.common_variance.len() != shape.0 {
            let found = format!("{}, expected {}", self.common_variance.len(), shape.0);
            return wrong("common variances", found);
        }
        if self.time_s.len() != shape.0 || self.time_s.iter().any(|t| !t.is_finite()) {
            let found = format!("{}, expected {} finite numbers", self.time_s.len(), shape.0);
            return wrong("moments", found);
        }
        if let Some(bad) = self.common_variance.iter().find(|v| !(v.is_finite() && **v >= 0.0)) {
            return wrong("a common variance", format!("{bad}, expected a number not below 0"));
        }
        for ((i, c), used) in self.used.indexed_iter() {
            let (rate, sigma) = (self.rate[[i, c]], self.sigma[[i, c]]);
            if *used && !(rate.is_finite() && sigma.is_finite() && sigma > 0.0) {
                let found = format!(
                    "{rate} ± {sigma} in channel {c}, expected finite numbers and σ above 0"
                );
                return wrong(&format!("sample {}", i + 1), found);
            }
        }
        if let Some(bad) = self.level.iter().flatten().find(|hz| !(hz.is_finite() && **hz >= 0.0)) {
            return wrong("the error of a level", format!("{bad}, expected a number not below 0"));
        }
        if let Some(calibration) = &self.calibration
            && calibration.covariance.dim() != (shape.1, shape.1)
        {
            let found =
                format!("{:?}, expected {} channels", calibration.covariance.dim(), shape.1);
            return wrong("the covariance of its calibration", found);
        }
        Ok(())
    }
}

/// The slope of y against x where they go together, not below 0.
fn slope(samples: &[(f64, f64)]) -> Option<f64> {
    if samples.len() < 8 {
        return None;
    }
    let n = samples.len() as f64;
    let (mx, my) = samples.iter().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / n, b + y / n));
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for (x, y) in samples {
        xx += (x - mx).powi(2);
        xy += (x - mx) * (y - my);
        yy += (y - my).powi(2);
    }
    let together = xy / (xx * yy).sqrt();
    (together.is_finite() && together > 0.3).then(|| xy / xx)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    /// Truth: the variances were made as (rate + 50)/0.1: the slope is 10 per second. Tolerance: rounding.
    #[test]
    fn variances_that_follow_their_rates_are_seen_and_others_kept() {
        let rate = Array2::from_shape_fn((20, 2), |(i, _)| 1000.0 + 37.0 * i as f64);
        let sigma = Array2::from_shape_fn((20, 2), |(i, c)| match c {
            0 => ((rate[[i, 0]] + 50.0) / 0.1).sqrt(),
            _ => 3.0,
        });
        let mut data = Data::new("a", rate, sigma);
        data.follow_photons(&[0.1; 20]);
        assert!((data.variance_slope[[3, 0]] - 10.0).abs() < 1e-9);
        assert_eq!(data.variance_slope[[3, 1]], 0.0);
        let truth = (1500.0 + 50.0) / 0.1;
        assert!((data.variance(3, 0, Some(1500.0)) - truth).abs() < 1e-6);
        assert_eq!(data.variance(3, 1, Some(1500.0)), 9.0);
    }

    #[test]
    fn what_is_no_number_does_not_count() {
        let data =
            Data::new("a", array![[1.0, f64::NAN], [2.0, 3.0]], array![[0.1, 0.1], [0.0, 0.2]]);
        assert_eq!(data.used, array![[true, false], [false, true]]);
        assert_eq!(data.count(), 2);
        assert!(data.check().is_ok());
    }
}
