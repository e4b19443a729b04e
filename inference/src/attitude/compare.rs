//! Measured and simulated light as logarithms, for the search: brightness with range and air taken out, and a floor below which nothing is told apart.

use super::AttitudeError;
use super::forward::Forward;
use glam::DQuat;
use sunglint_numerics::order::median;
use sunglint_numerics::sphere::spread;
use sunglint_simulator::light::View;

/// The floor, of the median light of a channel.
const FLOOR: f64 = 0.05;
/// The floor at most by what the body usually sends, of the light of a channel that one sample in ten exceeds.
const FLOOR_BRIGHT: f64 = 0.2;
/// Directions that what it usually sends is found from.
const LOOKS: usize = 300;
/// The floor, of the median noise of a channel.
const FLOOR_NOISE: f64 = 2.0;
/// The body's light must change by more than this times its noise.
const LEAST_CHANGE: f64 = 1.5;

/// Logarithms of what was measured.
#[derive(Debug, Clone)]
pub struct Compared {
    channels: usize,
    /// The rate of a unit weight, mean over the spectra: `[moment * channels + channel]`.
    unit: Vec<f64>,
    floor: Vec<f64>,
    measured: Vec<f64>,
    sigma: Vec<f64>,
}

impl Compared {
    /// Prepares what was measured.
    ///
    /// # Errors
    /// Light that does not change by more than its noise.
    pub fn new(forward: &Forward) -> Result<Self, AttitudeError> {
        let (n, channels) = (forward.moments.len(), forward.channels);
        let mut unit = vec![0.0; n * channels];
        for m in 0..n {
            for (c, row) in forward.unit_rates(m).chunks_exact(forward.weights).enumerate() {
                unit[m * channels + c] = row.iter().sum::<f64>() / forward.weights as f64;
            }
        }
        let good = |i: &usize| forward.rate[*i].is_finite() && unit[*i] > 0.0;
        let of = |c: usize, values: &[f64]| {
            let own = (0..n).map(|m| m * channels + c).filter(good);
            median(own.map(|i| values[i] / unit[i]).filter(|v| v.is_finite()))
        };
        let usual = usual_light(forward)?;
        let bright = |c: usize| {
            let own = (0..n).map(|m| m * channels + c).filter(good);
            let mut all: Vec<f64> = own.map(|i| forward.rate[i] / unit[i]).collect();
            all.sort_by(f64::total_cmp);
            all.get(all.len() * 9 / 10).copied().unwrap_or(0.0).max(0.0)
        };
        let floor: Vec<f64> = (0..channels)
            .map(|c| {
                let light = of(c, &forward.rate).unwrap_or(0.0).max(0.0);
                let noise = of(c, &forward.sigma).unwrap_or(0.0);
                // Light by other ways than the direct one is of the order of a twentieth of what the body usually sends; where its brightness is free, that is not known.
                let usual = (FLOOR * usual[c]).min(FLOOR_BRIGHT * bright(c));
                (FLOOR * light).max(usual).max(FLOOR_NOISE * noise).max(f64::MIN_POSITIVE)
            })
            .collect();
        let mut compared = Self {
            channels,
            measured: vec![f64::NAN; n * channels],
            sigma: vec![f64::NAN; n * channels],
            unit,
            floor,
        };
        for i in 0..n * channels {
            let (m, c) = (i / channels, i % channels);
            if !forward.rate[i].is_finite() || compared.unit[i] <= 0.0 {
                continue;
            }
            compared.measured[i] = compared.ln(m, c, forward.rate[i]);
            let light = (forward.rate[i] / compared.unit[i]).max(0.0) + compared.floor[c];
            compared.sigma[i] = forward.sigma[i] / compared.unit[i] / light;
        }
        compared.changes(forward)?;
        Ok(compared)
    }

    /// The logarithm of a rate; what lies below 0 by noise counts as 0.
    pub fn ln(&self, moment: usize, channel: usize, rate: f64) -> f64 {
        let unit = self.unit[moment * self.channels + channel];
        if unit > 0.0 { ((rate / unit).max(0.0) + self.floor[channel]).ln() } else { f64::NAN }
    }

    /// The derivative of that by the rate.
    pub fn slope(&self, moment: usize, channel: usize, rate: f64) -> f64 {
        let unit = self.unit[moment * self.channels + channel];
        if unit > 0.0 && rate > 0.0 { 1.0 / (rate + unit * self.floor[channel]) } else { 0.0 }
    }

    /// Returns the logarithm of the measured light; NaN where nothing counts.
    pub fn measured(&self, moment: usize, channel: usize) -> f64 {
        self.measured[moment * self.channels + channel]
    }

    /// Returns the stated standard uncertainty of that logarithm.
    pub fn sigma(&self, moment: usize, channel: usize) -> f64 {
        self.sigma[moment * self.channels + channel]
    }

    /// Refuses light that does not change.
    fn changes(&self, forward: &Forward) -> Result<(), AttitudeError> {
        let (mut most, mut noise_there) = (0.0_f64, 0.0);
        let mut any = false;
        for c in 0..self.channels {
            let all: Vec<(f64, f64)> = (0..forward.moments.len())
                .map(|m| (self.measured(m, c), self.sigma(m, c)))
                .filter(|(v, _)| v.is_finite())
                .collect();
            if all.len() < 3 {
                continue;
            }
            any = true;
            let mean = all.iter().map(|a| a.0).sum::<f64>() / all.len() as f64;
            let spread = (all.iter().map(|a| (a.0 - mean).powi(2)).sum::<f64>()
                / (all.len() - 1) as f64)
                .sqrt();
            let noise = (all.iter().map(|a| a.1 * a.1).sum::<f64>() / all.len() as f64).sqrt();
            if spread > LEAST_CHANGE * noise && spread > 0.01 {
                return Ok(());
            }
            if spread > most {
                (most, noise_there) = (spread, noise);
            }
        }
        if !any {
            let (samples, epochs) = (forward.samples(), forward.moments.len());
            return Err(AttitudeError::Few { samples, epochs, least: super::LEAST_EPOCHS });
        }
        Err(AttitudeError::Constant { change: most, noise: noise_there })
    }
}

/// The light of each channel in the mean over all attitudes, at the geometry in the middle, in the same measure as what is compared.
fn usual_light(forward: &Forward) -> Result<Vec<f64>, AttitudeError> {
    let Some(moment) = forward.moments.get(forward.moments.len() / 2) else {
        return Ok(vec![0.0; forward.channels]);
    };
    let mut evaluator = forward.scene.evaluator();
    let (mut sum, mut own) = (vec![0.0; forward.weights], vec![0.0; forward.weights]);
    let angle = moment.to_sun.angle_between(moment.to_observer);
    let axes = spread(LOOKS, 0.0);
    for (i, sun) in axes.iter().enumerate() {
        let turn = DQuat::from_axis_angle(*sun, 2.399_963 * i as f64);
        let across = turn * sun.any_orthonormal_vector();
        let observer = *sun * angle.cos() + across * angle.sin();
        evaluator.direct(*sun, View::Distant(observer), &mut own)?;
        sum.iter_mut().zip(&own).for_each(|(s, w)| *s += w / LOOKS as f64);
    }
    let rows = forward.unit_rates(forward.moments.len() / 2).chunks_exact(forward.weights);
    Ok(rows
        .map(|row| {
            let unit = row.iter().sum::<f64>() / forward.weights as f64;
            let light: f64 = row.iter().zip(&sum).map(|(k, w)| k * w).sum();
            if unit > 0.0 { light / unit } else { 0.0 }
        })
        .collect())
}
