//! Removal of what a pass itself does to the light: the air, the range, and the slow change with phase angle.
//!
//! Rates are divided by factors; the factors are returned, so that nothing is removed unseen.

use nalgebra::{Cholesky, DMatrix, DVector};
use sunglint_numerics::order::robust_sigma;
use sunglint_radiometry::air::{Air, AirError, Zenith};
use sunglint_radiometry::light_curve::TOLERATED;
use sunglint_radiometry::light_curve::{ChannelCurve, LightCurve};
use sunglint_radiometry::spectrum::{Irradiance, Spectrum, SpectrumError};
use sunglint_radiometry::station::{Channel, Station};

/// Why a factor is not known. What asks for it goes on without, and says so.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrendError {
    /// The curve does not say it.
    #[error("the light curve has no {0}")]
    Missing(&'static str),
    /// The air has no answer.
    #[error(transparent)]
    Air(#[from] AirError),
    /// Light and air have no wavelength in common.
    #[error(transparent)]
    Spectrum(#[from] SpectrumError),
    /// No light arrives.
    #[error(
        "{channel}: no light of this spectrum reaches the channel at a zenith angle of {zenith_deg} deg"
    )]
    Dark {
        /// The channel's name.
        channel: String,
        /// The zenith angle, degrees.
        zenith_deg: f64,
    },
    /// A stretch of the curve is not above 0: it has no magnitude.
    #[error(
        "{channel}: the mean of {samples} samples around a phase angle of {phase_deg:.1} deg is {mean_hz:.3e} Hz, not above 0: no trend in magnitudes"
    )]
    NotPositive {
        /// The channel's name.
        channel: String,
        /// Samples in the mean.
        samples: usize,
        /// Their mean phase angle, degrees.
        phase_deg: f64,
        /// Their mean, Hz.
        mean_hz: f64,
    },
    /// Too few samples, or the phase angle hardly changes.
    #[error(
        "{channel}: {samples} samples over {range_deg:.2} deg of phase angle show no trend with it"
    )]
    Flat {
        /// The channel's name.
        channel: String,
        /// The samples that count.
        samples: usize,
        /// The range of their phase angles, degrees.
        range_deg: f64,
    },
}

/// Number of times that light goes through the air.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ways {
    /// Once: sunlight.
    Once,
    /// Twice: a laser beside the telescope.
    Twice,
}

/// Zenith angles between which the factor of the air is interpolated, degrees: its logarithm is smooth in 1/cos z.
const NODES: usize = 65;

/// The part of a light's rate in a channel that the air leaves, ∫E P λ T^ζ dλ / ∫E P λ dλ, at true zenith angles, each 0 to 90 degrees.
///
/// # Errors
/// An angle below the horizon; light and air without a common wavelength; no light in the channel.
pub fn air_factor(
    station: &Station,
    channel: &Channel,
    light: &Spectrum<Irradiance>,
    air: &Air,
    zenith_deg: &[f64],
    ways: Ways,
) -> Result<Vec<f64>, TrendError> {
    let above = station.rate_hz(channel, light, None).value;
    let at = |z: f64| -> Result<f64, TrendError> {
        let transmission = air.spectrum(Zenith::True(z), light.range_nm())?;
        let twice;
        let arriving = match ways {
            Ways::Once => light,
            Ways::Twice => {
                twice = light.through(&transmission)?;
                &twice
            }
        };
        let part = station.rate_hz(channel, arriving, Some(&transmission)).value / above;
        if part.is_finite() && part > 0.0 {
            Ok(part.ln())
        } else {
            Err(TrendError::Dark { channel: channel.name.clone(), zenith_deg: z })
        }
    };
    let low = zenith_deg.iter().copied().fold(f64::INFINITY, f64::min);
    let high = zenith_deg.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if zenith_deg.len() <= NODES || high - low < 1e-6 {
        return zenith_deg.iter().map(|z| Ok(at(*z)?.exp())).collect();
    }
    // Even in a smoothed airmass, which stays finite at the horizon.
    let mass = |z: f64| 1.0 / (z.to_radians().cos().max(0.0) + 0.02);
    let zenith = |x: f64| (1.0 / x - 0.02).clamp(-1.0, 1.0).acos().to_degrees();
    let (first, last) = (mass(low), mass(high));
    let step = (last - first) / (NODES - 1) as f64;
    let values: Vec<f64> = (0..NODES)
        .map(|k| at(zenith(first + k as f64 * step).clamp(low, high)))
        .collect::<Result<_, _>>()?;
    let between = |z: &f64| {
        let place = ((mass(*z) - first) / step).clamp(0.0, (NODES - 1) as f64);
        let lower = (place.floor() as usize).min(NODES - 2);
        let f = place - lower as f64;
        (values[lower] + f * (values[lower + 1] - values[lower])).exp()
    };
    Ok(zenith_deg.iter().map(between).collect())
}

/// The part of the light that a range leaves, against 1,000 km: (1,000 km/R)².
///
/// # Errors
/// A curve without ranges.
pub fn range_factor(curve: &LightCurve) -> Result<Vec<f64>, TrendError> {
    let ranges = curve.samples.range_m.as_ref().ok_or(TrendError::Missing("range_m"))?;
    Ok(ranges.iter().map(|r| (1e6 / r).powi(2)).collect())
}

/// A slow change with phase angle.
#[derive(Debug, Clone, PartialEq)]
pub struct PhaseTrend {
    /// Coefficients of the magnitude in (γ − middle)/90°, from the first power on.
    pub magnitudes: Vec<f64>,
    /// The middle of the phase angles, degrees.
    pub middle_deg: f64,
    /// By what the rates are divided, sample by sample: 1 at the middle.
    pub factor: Vec<f64>,
}

/// Stretches of time whose mean light is fitted.
const STRETCHES: usize = 12;
/// A phase angle that changes by less shows no trend, degrees.
const LEAST_RANGE_DEG: f64 = 2.0;

/// The slow change of a channel's light with phase angle: a line in magnitude (a parabola where the phase angle changes by more than 40°), fitted to means over a twelfth
/// of the samples each, by least squares whose weights fall with the deviation (Huber). Glints within a stretch lift its mean; those of a whole stretch count less.
///
/// # Errors
/// No phase angles, or hardly a change of them; a stretch without light.
pub fn phase_trend(curve: &LightCurve, channel: &ChannelCurve) -> Result<PhaseTrend, TrendError> {
    let phase = curve.samples.phase_deg.as_ref().ok_or(TrendError::Missing("phase_deg"))?;
    let mut used: Vec<usize> = (0..curve.len())
        .filter(|i| {
            channel.flags[*i].difference(TOLERATED).is_empty() && channel.rate_hz[*i].is_finite()
        })
        .collect();
    used.sort_by_key(|i| curve.samples.time[*i]);
    let ends = used.iter().map(|i| phase[*i]);
    let low = ends.clone().fold(f64::INFINITY, f64::min);
    let high = ends.fold(f64::NEG_INFINITY, f64::max);
    let range_deg = high - low;
    if used.len() < 5 * STRETCHES || range_deg.is_nan() || range_deg < LEAST_RANGE_DEG {
        let range_deg = if used.is_empty() { 0.0 } else { range_deg };
        return Err(TrendError::Flat {
            channel: channel.name.clone(),
            samples: used.len(),
            range_deg,
        });
    }
    let middle_deg = 0.5 * (low + high);
    let degree = if range_deg > 40.0 { 2 } else { 1 };
    let mut points = Vec::with_capacity(STRETCHES);
    for k in 0..STRETCHES {
        let members = &used[k * used.len() / STRETCHES..(k + 1) * used.len() / STRETCHES];
        let n = members.len() as f64;
        let mean = members.iter().map(|i| channel.rate_hz[*i]).sum::<f64>() / n;
        let phase_deg = members.iter().map(|i| phase[*i]).sum::<f64>() / n;
        if mean.is_nan() || mean <= 0.0 {
            let channel = channel.name.clone();
            return Err(TrendError::NotPositive {
                channel,
                samples: members.len(),
                phase_deg,
                mean_hz: mean,
            });
        }
        points.push(((phase_deg - middle_deg) / 90.0, -2.5 * mean.log10()));
    }
    let Some(fit) = robust(&points, degree) else {
        return Err(TrendError::Flat {
            channel: channel.name.clone(),
            samples: used.len(),
            range_deg,
        });
    };
    let magnitudes = fit[1..].to_vec();
    let factor = phase
        .iter()
        .map(|p| {
            let x = (p - middle_deg) / 90.0;
            let magnitude = magnitudes.iter().rev().fold(0.0, |sum, c| (sum + c) * x);
            10_f64.powf(-0.4 * magnitude)
        })
        .collect();
    Ok(PhaseTrend { magnitudes, middle_deg, factor })
}

/// A polynomial by iterated weights: 1 within 1.345 deviations, falling as their inverse beyond.
fn robust(points: &[(f64, f64)], degree: usize) -> Option<Vec<f64>> {
    let design = DMatrix::from_fn(points.len(), degree + 1, |i, j| points[i].0.powi(j as i32));
    let values = DVector::from_fn(points.len(), |i, _| points[i].1);
    let mut weights = DVector::from_element(points.len(), 1.0);
    let mut solution = DVector::zeros(degree + 1);
    for _ in 0..30 {
        let weighted = DMatrix::from_diagonal(&weights) * &design;
        let normal = design.transpose() * &weighted;
        solution = Cholesky::new(normal)?.solve(&(weighted.transpose() * &values));
        let left = &values - &design * &solution;
        let scale = 1.345 * robust_sigma(left.iter().copied())?;
        if scale <= 1e-12 {
            break;
        }
        weights = left.map(|r| if r.abs() <= scale { 1.0 } else { scale / r.abs() });
    }
    Some(solution.iter().copied().collect())
}

/// A channel divided by a factor, uncertainties with it. Both of one length.
pub fn divide(channel: &mut ChannelCurve, factor: &[f64]) {
    let sigmas = [Some(&mut channel.sigma_hz), channel.common_sigma_hz.as_mut()];
    for values in sigmas.into_iter().flatten().chain([&mut channel.rate_hz]) {
        values.iter_mut().zip(factor).for_each(|(v, f)| *v /= f);
    }
}
