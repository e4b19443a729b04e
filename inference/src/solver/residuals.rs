//! Residuals in groups: by channel, phase angle, airmass.

use super::{Data, Fit};
use serde::Serialize;

/// The residuals of a group of samples.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Common property of the samples: a channel's name, a range of phase angles.
    pub group: String,
    /// Samples.
    pub samples: usize,
    /// Mean of (measured − model)/model, weighted by the inverse square of the samples' noise.
    pub mean_relative: f64,
    /// Standard uncertainty of the mean by the noise of single samples, which takes them as independent.
    pub sigma_relative: f64,
    /// Root of the mean square of measured less model over the noise of a single sample: 1 where noise and model are as stated.
    pub rms_pull: f64,
}

/// Summaries of groups; `group` gives the number of the group of a sample (curve, epoch, channel). Groups without samples are left out.
pub fn summaries(
    data: &[Data],
    fit: &Fit,
    names: &[String],
    group: &dyn Fn(usize, usize, usize) -> Option<usize>,
) -> Vec<Summary> {
    // Samples, Σ w, Σ w r, Σ pull².
    let mut sums = vec![(0_usize, 0.0, 0.0, 0.0); names.len()];
    for (p, (curve, fitted)) in data.iter().zip(&fit.curves).enumerate() {
        for ((i, c), used) in curve.used.indexed_iter() {
            let Some(sum) = group(p, i, c).filter(|_| *used).and_then(|g| sums.get_mut(g)) else {
                continue;
            };
            let (model, pull) = (fitted.model[[i, c]], fitted.pull[[i, c]]);
            let left = curve.rate[[i, c]] - model;
            sum.0 += 1;
            sum.3 += pull * pull;
            if model > 0.0 && pull != 0.0 {
                // pull = left/noise.
                let weight = (model * pull / left).powi(2);
                sum.1 += weight;
                sum.2 += weight * left / model;
            }
        }
    }
    let of = |(name, (samples, weight, sum, square)): (&String, &(usize, f64, f64, f64))| {
        (*samples > 0).then(|| Summary {
            group: name.clone(),
            samples: *samples,
            mean_relative: sum / weight,
            sigma_relative: weight.sqrt().recip(),
            rms_pull: (square / *samples as f64).sqrt(),
        })
    };
    names.iter().zip(&sums).filter_map(of).collect()
}
