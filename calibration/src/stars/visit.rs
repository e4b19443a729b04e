//! The mean rates of a visit to a star, from its linear light curve.

use super::scintillation::Aperture;
use sunglint_radiometry::light_curve::{ChannelCurve, Flags, LightCurve, TOLERATED};

/// The mean of a channel over a visit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mean {
    /// Mean rate over the exposed time, in the curve's unit.
    pub rate_hz: f64,
    /// Standard uncertainty of the mean rate without scintillation.
    pub sigma_hz: f64,
    /// Samples that went in.
    pub used: usize,
    /// Samples that were left out for their flags, those without an exposure of the channel not counted.
    pub flagged: usize,
    /// Exposed time, s.
    pub exposed_s: f64,
    /// Scatter of the samples over what their uncertainties and the scintillation let expect; `NaN` of fewer than five.
    pub scatter_ratio: f64,
    /// Mean time of these samples, weighted by exposure, s after the curve's first sample.
    pub middle_s: f64,
    /// Mean true zenith angle of these samples, degrees.
    pub zenith_deg: f64,
    /// Mean airmass, weighted by exposed time.
    pub airmass: f64,
}

/// The mean of a channel; `None` where no sample is valid. `airmass` has one entry a sample. The weights are the exposed times: weights by the samples' own
/// uncertainties would favour those that came out faint.
pub fn mean(
    curve: &LightCurve,
    channel: &ChannelCurve,
    zenith_deg: &[f64],
    airmass: &[f64],
    aperture: &Aperture,
) -> Option<Mean> {
    let good = |i: &usize| {
        channel.flags[*i].difference(TOLERATED).is_empty()
            && channel.rate_hz[*i].is_finite()
            && channel.sigma_hz[*i].is_finite()
    };
    let picked: Vec<usize> = (0..curve.len()).filter(good).collect();
    let absent = channel.flags.iter().filter(|f| f.contains(Flags::NOT_SAMPLED)).count();
    let exposure = |i: usize| curve.samples.exposure_s[i];
    let exposed_s: f64 = picked.iter().map(|i| exposure(*i)).sum();
    if picked.is_empty() {
        return None;
    }
    let share = |i: usize| exposure(i) / exposed_s;
    let rate_hz: f64 = picked.iter().map(|i| share(*i) * channel.rate_hz[*i]).sum();
    let common = |i: usize| channel.common_sigma_hz.as_ref().map_or(0.0, |common| common[i]);
    let own = |i: usize| {
        let square = channel.sigma_hz[i].powi(2);
        (square - common(i).powi(2)).max(1e-6 * square)
    };
    let stated: f64 = picked.iter().map(|i| share(*i).powi(2) * own(*i)).sum();
    // The error of a level that was taken off all samples stays what it is.
    let common: f64 = picked.iter().map(|i| share(*i) * common(*i)).sum();
    // Of the samples that the rate is of: a cloud or a gap shifts all of these alike.
    let over = |value: &dyn Fn(usize) -> f64| -> f64 {
        picked.iter().map(|i| share(*i) * value(*i)).sum()
    };
    let first = curve.samples.time[0];
    let middle_s = over(&|i| (curve.samples.time[i] - first).to_seconds());
    let scatter_ratio = if picked.len() < 5 {
        f64::NAN
    } else {
        let square = |i: &usize| {
            let twinkle = rate_hz.powi(2) * aperture.variance(exposure(*i), airmass[*i]);
            (channel.rate_hz[*i] - rate_hz).powi(2) / (own(*i) + twinkle)
        };
        (picked.iter().map(square).sum::<f64>() / (picked.len() - 1) as f64).sqrt()
    };
    // Samples that scatter more than they should make a mean that is known less well; fewer than chance would have it, not better.
    let more = if scatter_ratio > 1.0 { scatter_ratio } else { 1.0 };
    Some(Mean {
        rate_hz,
        sigma_hz: (stated.sqrt() * more).hypot(common),
        used: picked.len(),
        flagged: curve.len() - picked.len() - absent,
        exposed_s,
        scatter_ratio,
        middle_s,
        zenith_deg: over(&|i| zenith_deg[i]),
        airmass: over(&|i| airmass[i]),
    })
}
