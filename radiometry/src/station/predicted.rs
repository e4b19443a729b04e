//! Response of a channel to a rate: the arriving rate, the counted rate, and the uncertainty.

use super::{Channel, Detector, Station};

/// Response of a channel to a predicted rate in one exposure.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Predicted {
    /// Arriving rate: the predicted rate over the channel's typical κ. Hz for a counter, counts of the converter per second (ADU/s) for a
    /// camera. `None` without a κ.
    pub arriving: Option<f64>,
    /// Rate that a counter reports for the arriving and its dark rate with its dead time, Hz; `None` where its law or its κ is not known.
    pub counted_hz: Option<f64>,
    /// Standard uncertainty of the predicted rate, Hz: photons, dark counts and the statistics of the dead time of a counter; of a camera the
    /// photons alone. No scintillation. Without a κ, photons and dark counts alone. `None` where the counter is saturated past its law.
    pub sigma_hz: Option<f64>,
    /// Whether the counter is saturated ([`super::Counter::is_saturated_by`]).
    pub saturated: bool,
}

impl Station {
    /// Computes the response of a channel of this station to a predicted rate (Hz, not below 0) in an exposure (s, above 0).
    pub fn predict(&self, channel: &Channel, rate_hz: f64, exposure_s: f64) -> Predicted {
        let arriving = channel.typical_kappa.map(|kappa| rate_hz / kappa);
        let mut found = Predicted { arriving, ..Predicted::default() };
        match &channel.detector {
            Detector::Counter(counter) => match arriving {
                Some(arriving) => {
                    let scale = channel.typical_kappa.unwrap_or(1.0);
                    let true_hz = arriving + counter.dark_rate_hz;
                    found.counted_hz = counter.dead_time.counted_hz(true_hz);
                    found.saturated = counter.is_saturated_by(true_hz);
                    let sigma = counter.dead_time.sigma_hz(true_hz, exposure_s);
                    found.sigma_hz = sigma.map(|sigma| scale * sigma);
                }
                // Without a κ it is not known what arrives, nor what the dead time makes of it: photons and dark counts alone.
                None => {
                    found.sigma_hz = Some(((rate_hz + counter.dark_rate_hz) / exposure_s).sqrt())
                }
            },
            Detector::CameraPlane(_) => {
                // Photons are counted in electrons, κ in counts of the converter.
                let gain = self.camera.as_ref().map_or(1.0, |c| c.gain_e_per_adu);
                let electrons_hz = arriving.map_or(rate_hz, |adu| adu * gain);
                let scale = channel.typical_kappa.map_or(1.0, |kappa| kappa / gain);
                found.sigma_hz = Some(scale * (electrons_hz / exposure_s).sqrt());
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::station::DeadTime;

    /// Truth: the formulas of the physics by hand: a counter with κ = 2, 50 Hz of dark counts and a dead time of 1 µs that is to show 2000 Hz has
    /// 1000 Hz arriving; n = 1050 Hz, m = n/(1+nτ), σ = 2 √(n(1+nτ)/t). A camera plane with κ = 4 and 3 e/ADU: 500 ADU/s, 1500 e/s,
    /// σ = (4/3) √(1500/t).
    #[test]
    fn noise_is_that_of_what_arrives() {
        let mut station = Station::built_in("ufo").unwrap().unwrap();
        let mut counter = station.channel("spcm").unwrap().clone();
        counter.typical_kappa = Some(2.0);
        let Detector::Counter(detector) = &mut counter.detector else { panic!("a counter") };
        detector.dark_rate_hz = 50.0;
        detector.dead_time = DeadTime::NonParalysable { dead_time_s: 1e-6 };
        detector.saturation_hz = 1e5;
        let found = station.predict(&counter, 2000.0, 0.1);
        assert_eq!(found.arriving, Some(1000.0));
        assert!((found.counted_hz.unwrap() - 1050.0 / 1.00105).abs() < 1e-9);
        assert!((found.sigma_hz.unwrap() - 2.0 * (1050.0 * 1.00105 / 0.1_f64).sqrt()).abs() < 1e-9);
        assert!(!found.saturated && station.predict(&counter, 4e5, 0.1).saturated);
        counter.typical_kappa = None;
        let blind = station.predict(&counter, 4e5, 0.1);
        assert_eq!((blind.arriving, blind.counted_hz, blind.saturated), (None, None, false));
        assert!((blind.sigma_hz.unwrap() - ((4e5 + 50.0) / 0.1_f64).sqrt()).abs() < 1e-9);

        let mut plane = station.channel("g").unwrap().clone();
        plane.typical_kappa = Some(4.0);
        station.camera.as_mut().unwrap().gain_e_per_adu = 3.0;
        let found = station.predict(&plane, 2000.0, 0.1);
        assert_eq!((found.arriving, found.counted_hz), (Some(500.0), None));
        assert!((found.sigma_hz.unwrap() - 4.0 / 3.0 * (1500.0_f64 / 0.1).sqrt()).abs() < 1e-9);
    }
}
