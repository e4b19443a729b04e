//! Results of an epoch: sums over the terms of its light, and over their errors.

use super::functionals::Functionals;
use super::simulate::Place;
use super::{BANDS, Pass, PassError};
use crate::light::{Source, Stated};
use sunglint_radiometry::air::Zenith;
use sunglint_radiometry::station::Predicted;

/// The place of V among the bands.
const V: usize = 2;

/// The light of an epoch: weights of the terms and their errors, m² sr⁻¹.
#[derive(Clone, Copy)]
pub(super) struct Light<'a> {
    pub weights: &'a [f64],
    pub errors: &'a [f64],
}

/// Results of a channel at an epoch.
pub(super) struct ChannelCounts {
    pub rate_hz: f64,
    pub error_hz: f64,
    pub above_air_hz: f64,
    pub predicted: Predicted,
    pub uncovered_nm: f64,
}

/// Results of an epoch.
pub(super) struct Counts {
    pub spectrum: Vec<f64>,
    pub spectrum_errors: Vec<f32>,
    pub uncovered: bool,
    pub channels: Vec<ChannelCounts>,
    pub magnitudes: [f64; BANDS.len()],
    pub magnitude_errors: [f64; BANDS.len()],
    pub ground: [f64; BANDS.len()],
    /// The largest share of a rate that the air's table may be off by.
    pub relative: f64,
    /// Which errors of the light make most of the stated error of the worst channel (of V where there is none).
    pub limit: Option<Source>,
}

impl Pass {
    /// Light above the air of weights, as [`Counts`] has it: the rates of all channels, Hz; the flux in V where there is none.
    pub(super) fn above_air(
        &self,
        place: &Place,
        weights: &[f64],
        functionals: &Functionals,
    ) -> Vec<f64> {
        let here = (place.geometry.sun.distance_au() * place.geometry.range_m).powi(-2);
        let channels = self.station.channels.len();
        let wanted = if channels == 0 { V..V + 1 } else { 0..channels };
        wanted.map(|c| here * functionals.sums.above(c, weights)).collect()
    }

    pub(super) fn counts(
        &self,
        place: &Place,
        exposure_s: f64,
        light: Light<'_>,
        functionals: &Functionals,
    ) -> Result<Counts, PassError> {
        let Light { weights, errors } = light;
        let sums = &functionals.sums;
        let per_au = place.geometry.sun.distance_au().powi(-2);
        let per_range = place.geometry.range_m.powi(-2);
        let here = per_au * per_range;
        let visible = place.apparent_zenith_deg.map(Zenith::Apparent);
        let mut transmissions = Vec::new();
        if let Some(zenith) = visible {
            sums.transmissions(zenith, &mut transmissions)?;
        }
        let mut relative = 0.0_f64;
        let channels = self.station.channels.iter().enumerate().map(|(c, channel)| {
            let above = sums.above(c, weights);
            let Some(_) = visible else {
                let (rate_hz, error_hz, predicted) = (f64::NAN, f64::NAN, Predicted::default());
                let uncovered_nm = sums.uncovered(c, weights);
                let above_air_hz = here * above;
                return ChannelCounts { rate_hz, error_hz, above_air_hz, predicted, uncovered_nm };
            };
            let above_air_hz = here * above;
            let below = sums.below(c, weights, &transmissions);
            let of_air = sums.air_error(c, weights);
            let here = here * self.correction.dimming(place, Some(&channel.name));
            let (rate_hz, air_hz) = (here * below, here * of_air);
            if rate_hz > 0.0 && !place.hidden {
                relative = relative.max(air_hz / rate_hz);
            }
            let share = share(below, above);
            let of_weights = sums.error_below(c, errors, &transmissions, share) + of_air;
            ChannelCounts {
                rate_hz,
                error_hz: here * of_weights,
                above_air_hz,
                predicted: self.station.predict(channel, rate_hz, exposure_s),
                uncovered_nm: sums.uncovered(c, weights),
            }
        });
        let channels: Vec<_> = channels.collect();
        let first = self.station.channels.len();
        let magnitude = |flux: f64| if flux > 0.0 { -2.5 * flux.log10() } else { f64::NAN };
        let above = |b: usize| sums.above(first + b, weights);
        let magnitude_errors = std::array::from_fn(|b| {
            let flux = above(b);
            magnitude_error(flux, sums.error_above(first + b, errors))
        });
        let dim = self.correction.dimming(place, None);
        let ground = |b: usize| match visible {
            Some(_) => magnitude(here * dim * sums.below(first + b, weights, &transmissions)),
            None => f64::NAN,
        };
        let (ground, magnitudes) =
            (std::array::from_fn(ground), std::array::from_fn(|b| magnitude(here * above(b))));
        let (spectrum, spectrum_errors) = match (&functionals.at_telescope, visible) {
            (None, _) => bins(functionals, light, per_au),
            (Some(set), Some(zenith)) => {
                set.transmissions(zenith, &mut transmissions)?;
                (0..set.len())
                    .map(|bin| {
                        let below = set.below(bin, weights, &transmissions);
                        let share = share(below, set.above(bin, weights));
                        let of_weights = set.error_below(bin, errors, &transmissions, share);
                        let of_weights = of_weights + set.air_error(bin, weights);
                        (here * dim * below, (here * dim * of_weights) as f32)
                    })
                    .unzip()
            }
            (Some(set), None) => (vec![f64::NAN; set.len()], vec![f32::NAN; set.len()]),
        };
        let uncovered = match &functionals.at_telescope {
            None => {
                (functionals.spectral_uncovered.iter().zip(weights)).any(|(u, w)| *u && *w != 0.0)
            }
            Some(set) => (0..set.len()).any(|bin| set.uncovered(bin, weights) > 0.0),
        };
        let relative_error = |c: &ChannelCounts| {
            if c.rate_hz > 0.0 { c.error_hz / c.rate_hz } else { 0.0 }
        };
        let worst = (0..channels.len())
            .max_by(|a, b| relative_error(&channels[*a]).total_cmp(&relative_error(&channels[*b])));
        let limit = functionals.limit(worst.unwrap_or(first + V), errors);
        Ok(Counts {
            limit,
            spectrum,
            spectrum_errors,
            uncovered,
            channels,
            magnitudes,
            magnitude_errors,
            ground,
            relative,
        })
    }
}

/// Spectral intensities of all bins, and their errors.
fn bins(functionals: &Functionals, light: Light<'_>, per_au: f64) -> (Vec<f64>, Vec<f32>) {
    let bin = |row: &Vec<(usize, f64)>| {
        let (mut sum, mut stated) = (0.0, Stated::default());
        for (k, mean) in row {
            sum += mean * light.weights[*k];
            stated.add(functionals.ways[*k], mean.abs() * light.errors[*k]);
        }
        (per_au * sum, (per_au * stated.total()) as f32)
    };
    functionals.spectral.iter().map(bin).unzip()
}

/// The part of the light that the air leaves; all of it where there is no light that would say so.
fn share(below: f64, above: f64) -> f64 {
    if above > 0.0 { (below / above).clamp(0.0, 1.0) } else { 1.0 }
}

/// Returns the increase of a magnitude if the flux is less by its error; infinite where nothing may be left, NaN without light.
fn magnitude_error(flux: f64, error: f64) -> f64 {
    if flux > 0.0 {
        let left = 1.0 - error / flux;
        if left > 0.0 { -2.5 * left.log10() } else { f64::INFINITY }
    } else {
        f64::NAN
    }
}
