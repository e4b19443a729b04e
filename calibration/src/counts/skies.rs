//! Where the sky of a visit's samples came from.

use super::off_target::{BackgroundSource, NotCarried};
use super::reduction::ChannelSample;
use std::collections::BTreeMap;

/// Samples with a rate of one channel in one visit, by how the sky was taken between the looks at it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SkyTally {
    /// Number of those whose background goes as the sky in the camera's frames.
    pub carried: u64,
    /// Numbers of those on the line between two looks at a sky that changed, by the reason.
    pub on_line: BTreeMap<NotCarried, u64>,
    /// Sums over those on the line: standard uncertainties of the background and rates, Hz.
    line_hz: [f64; 2],
}

impl SkyTally {
    /// Counts a sample; one without a rate does not count.
    pub fn add(&mut self, sample: &ChannelSample) {
        if !sample.rate_hz.is_finite() {
            return;
        }
        match sample.background_from {
            Some(BackgroundSource::Carried) => self.carried += 1,
            Some(BackgroundSource::OnLine(why)) => {
                *self.on_line.entry(why).or_default() += 1;
                let coupling = sample.coupling.value;
                let coupling = if coupling.is_finite() { coupling } else { 1.0 };
                self.line_hz[0] += sample.background_hz.sigma / coupling;
                self.line_hz[1] += sample.rate_hz;
            }
            _ => {}
        }
    }

    /// Number of samples on the line between two looks at a sky that changed.
    pub fn on_line(&self) -> u64 {
        self.on_line.values().sum()
    }

    /// Reason of most samples on the line.
    pub fn reason(&self) -> Option<NotCarried> {
        self.on_line.iter().max_by_key(|(_, samples)| **samples).map(|(why, _)| *why)
    }

    /// Mean standard uncertainty of the line as a part of the mean rate of the samples on it; `None` without any, infinite where they have no light.
    pub fn doubt(&self) -> Option<f64> {
        let [sigma_hz, rate_hz] = self.line_hz;
        (self.on_line() > 0).then(|| if rate_hz > 0.0 { sigma_hz / rate_hz } else { f64::INFINITY })
    }
}
