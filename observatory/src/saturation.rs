//! The detector that a star saturates: a counter by its law, a camera by its brightest pixel.

use super::plan::CounterPlan;
use super::sequence::Exposing;
use hifitime::Epoch;
use sunglint_radiometry::air::Air;
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::sky::{EarthOrientation, Star};
use sunglint_radiometry::star_light::{self, StarColours, VEGA_HIP};
use sunglint_radiometry::star_track::{StarTrack, StarTrackError, StarView};
use sunglint_radiometry::station::{Detector, Station};

/// Surroundings in which a star is judged.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Judge<'a> {
    pub station: &'a Station,
    pub air: &'a Air,
    pub orientation: &'a EarthOrientation,
    pub zero: ZeroPoint,
    /// Width of a star's image at half of its height, arcsec.
    pub seeing_arcsec: f64,
}

/// A channel that comes near its end.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Near {
    /// The channel and its device.
    pub what: String,
    /// The part of its range that is used; from 1 on it is saturated.
    pub part: f64,
}

impl Judge<'_> {
    /// The channels that a star brings to a part of their range, each once, the nearest to its end first; none where its light is not known.
    ///
    /// # Errors
    /// A place or a path through the air that cannot be computed.
    pub fn star(
        &self,
        star: &Star,
        epoch: Epoch,
        exposings: &[Exposing],
        counters: &[CounterPlan],
    ) -> Result<Vec<Near>, StarTrackError> {
        let Some(v_mag) = star.v_mag else { return Ok(Vec::new()) };
        let colours = StarColours {
            v_mag,
            b_minus_v_mag: star.bv_mag,
            spectral_type: star.spectral_type.as_deref(),
            zero: self.zero,
        };
        let light = match star.hip {
            Some(VEGA_HIP) => star_light::vega(colours),
            _ => star_light::of(colours),
        };
        let Ok(light) = light else { return Ok(Vec::new()) };
        let view = StarView {
            star: star.clone(),
            light,
            station: self.station.clone(),
            air: self.air.clone(),
            zero: self.zero,
            exposure_s: 1.0,
        };
        let track = StarTrack::new(view, self.orientation, vec![epoch])?;
        let Some(sight) = track.sights.first() else { return Ok(Vec::new()) };
        let mut all = Vec::new();
        for (channel, rate) in self.station.channels.iter().zip(&sight.rates) {
            let near =
                |device: &str, part| Near { what: format!("{} of {device}", channel.name), part };
            match &channel.detector {
                Detector::Counter(counter) => {
                    let is_its = |plan: &&CounterPlan| plan.channels.contains_key(&channel.name);
                    let counted = rate.counted_hz.unwrap_or(0.0) / counter.saturation_hz;
                    let part = if rate.saturated { counted.max(1.0) } else { counted };
                    all.extend(counters.iter().find(is_its).map(|plan| near(&plan.name, part)));
                }
                Detector::CameraPlane(_) => {
                    let Some(camera) = &self.station.camera else { continue };
                    let adu_s = rate.arriving.or(rate.rate_hz.map(|hz| hz / camera.gain_e_per_adu));
                    for Exposing { plan, .. } in exposings {
                        let other = channel.filter.is_some() && channel.filter != plan.filter;
                        // In a gain of the camera's own steps nobody knows how many electrons a count has.
                        let (Some(adu_s), false, None) = (adu_s, other, plan.gain) else {
                            continue;
                        };
                        let side = camera.pixel_scale_arcsec * f64::from(plan.binning.unwrap_or(1));
                        let share = central_share(side, self.seeing_arcsec);
                        let adu = adu_s * share * plan.exposure_s.get();
                        all.push(near(&plan.name, adu / camera.saturation_adu()));
                    }
                }
            }
        }
        all.sort_by(|a, b| b.part.total_cmp(&a.part));
        let mut once: Vec<Near> = Vec::new();
        for near in all {
            if once.iter().all(|known| known.what != near.what) {
                once.push(near);
            }
        }
        Ok(once)
    }
}

/// The share of a round normal image's light in the pixel that it is centred on.
fn central_share(side_arcsec: f64, seeing_arcsec: f64) -> f64 {
    let sigma = seeing_arcsec / (8.0 * 2.0_f64.ln()).sqrt();
    libm::erf(0.5 * side_arcsec / (sigma * std::f64::consts::SQRT_2)).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: erf(√ln 2) = 0.761 along each side of a pixel as wide as the image at half of its height (tables of erf: erf(0.8326) = 0.7610);
    /// a small pixel has the peak's density, 4 ln 2/π/FWHM² times its area.
    #[test]
    fn the_brightest_pixel_has_its_share() {
        assert!((central_share(2.5, 2.5) - 0.7610_f64.powi(2)).abs() < 1e-4);
        let peak = 4.0 * 2.0_f64.ln() / std::f64::consts::PI / 2.5_f64.powi(2);
        assert!((central_share(0.05, 2.5) / (peak * 0.05 * 0.05) - 1.0).abs() < 1e-3);
    }
}
