//! Counted rates without dead time and dark counts, and rates that were predicted: what the counts are held against on the page.

use hifitime::Epoch;
use serde::Serialize;
use std::collections::HashMap;
use sunglint_calibration::detector::Linearity;
use sunglint_radiometry::light_curve::LightCurve;
use sunglint_radiometry::station::{Detector, Station};

/// Points of a predicted curve at most; of a longer one every so-and-so-many-th is shown.
const POINTS: usize = 20_000;

/// The laws of a station's counters.
#[derive(Debug, Default)]
pub(crate) struct Corrected(HashMap<String, (Linearity, f64)>);

impl Corrected {
    /// Those of the station's channels whose law has an inverse.
    pub fn of(station: &Station) -> Self {
        let of = |channel: &sunglint_radiometry::station::Channel| match &channel.detector {
            Detector::Counter(counter) => {
                let law = Linearity::of(counter).ok()?;
                Some((channel.name.clone(), (law, counter.dark_rate_hz)))
            }
            Detector::CameraPlane(_) => None,
        };
        Self(station.channels.iter().filter_map(of).collect())
    }

    /// A channel's rate of photons, Hz; `None` where the station does not have the channel, or it is saturated.
    pub fn rate_hz(&self, channel: &str, counted_hz: f64, length_s: f64) -> Option<f64> {
        self.linear(channel, counted_hz, length_s).map(|(rate, _)| rate)
    }

    /// The same with its standard uncertainty from counting.
    pub fn linear(&self, channel: &str, counted_hz: f64, length_s: f64) -> Option<(f64, f64)> {
        let (law, dark_hz) = self.0.get(channel)?;
        let counts = counted_hz * length_s;
        if !(0.0..9e15).contains(&counts) {
            return None;
        }
        let linear = law.linearise(counts.round() as u64, length_s).ok()?;
        Some((linear.rate_hz - dark_hz, linear.sigma_hz))
    }

    /// The same of all points of all channels.
    pub fn all(
        &self,
        channels: &[String],
        counted_hz: &[Vec<f64>],
        length_s: &[f64],
    ) -> Vec<Vec<Option<f64>>> {
        let of = |(channel, rates): (&String, &Vec<f64>)| {
            let points = rates.iter().zip(length_s);
            points.map(|(rate, length)| self.rate_hz(channel, *rate, *length)).collect()
        };
        channels.iter().zip(counted_hz).map(of).collect()
    }
}

/// A predicted curve, as the page shows it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Predicted {
    /// Channels, in the order of the rates.
    channels: Vec<String>,
    /// Seconds after the session's start.
    at_s: Vec<f64>,
    /// Rates, Hz; `None` where there is none.
    rate_hz: Vec<Vec<Option<f64>>>,
}

impl Predicted {
    /// Rates of these channels at these times, s after the session's start.
    pub fn new(channels: Vec<String>, at_s: Vec<f64>, rate_hz: Vec<Vec<Option<f64>>>) -> Self {
        Self { channels, at_s, rate_hz }
    }

    /// A light curve beside a night that began then, in the order of time.
    pub fn of(curve: &LightCurve, start: Epoch) -> Self {
        let mut order: Vec<usize> = (0..curve.samples.time.len()).collect();
        order.sort_by_key(|i| curve.samples.time[*i]);
        let step = order.len().div_ceil(POINTS).max(1);
        let order: Vec<usize> = order.into_iter().step_by(step).collect();
        Self {
            channels: curve.channels.iter().map(|channel| channel.name.clone()).collect(),
            at_s: order.iter().map(|i| (curve.samples.time[*i] - start).to_seconds()).collect(),
            rate_hz: curve
                .channels
                .iter()
                .map(|channel| {
                    let rate =
                        |i: &usize| Some(channel.rate_hz[*i]).filter(|rate| rate.is_finite());
                    order.iter().map(rate).collect()
                })
                .collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the laws by hand: the id400 of the station `ufo` has 10 µs of dead time, so that 50 kHz counted are 100 kHz, and what stands at its limit is no rate.
    #[test]
    fn dead_time_and_dark_counts_are_taken_off() {
        let station = Station::built_in("ufo").unwrap().unwrap();
        let dark_hz = station
            .channels
            .iter()
            .find_map(|channel| match &channel.detector {
                Detector::Counter(counter) if channel.name == "id400" => Some(counter.dark_rate_hz),
                _ => None,
            })
            .unwrap();
        let corrected = Corrected::of(&station);
        let rate = corrected.rate_hz("id400", 50_000.0, 1.0).unwrap();
        // The bias of few counts is below a hertz here.
        assert!((rate + dark_hz - 100_000.0).abs() < 2.0, "{rate} {dark_hz}");
        for bad in [99_999.0, f64::NAN, -1.0, 1e300] {
            assert_eq!(corrected.rate_hz("id400", bad, 1.0), None, "{bad}");
        }
        assert_eq!(corrected.rate_hz("elsewhere", 5.0, 1.0), None);
        assert_eq!(corrected.rate_hz("id400", 5.0, 0.0), None);
    }
}
