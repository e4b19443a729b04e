//! The truth of a night, for whoever compares: what is written beside what the devices gave.

use super::night::{Instrument, Night};
use super::options::VisitKind;
use glam::DVec2;
use serde::Serialize;
use std::collections::BTreeMap;
use sunglint_formats::time::format_utc_shortest;

/// The truth of a night.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Truth {
    /// Begin, UTC.
    pub start_utc: String,
    /// Seed of all chance.
    pub seed: u64,
    /// True coefficient of each channel: predicted = κ × arriving.
    pub kappa: BTreeMap<String, f64>,
    /// Sky's light that arrives, by counter, Hz.
    pub sky_hz: BTreeMap<String, f64>,
    /// Sky's light that arrives on a pixel, by plane, e/s.
    pub sky_e_per_s: BTreeMap<String, f64>,
    /// Optical depth at 550 nm of an aerosol that the station's file does not name.
    pub aerosol_depth: f64,
    /// The visits.
    pub visits: Vec<TrueVisit>,
}

/// The truth of a visit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrueVisit {
    /// The target's name.
    pub name: String,
    /// Kind.
    pub kind: VisitKind,
    /// From when on, s from the night's begin.
    pub from_s: f64,
    /// Until when, s from the night's begin.
    pub to_s: f64,
    /// True light over catalogued light, by channel; empty of what is no star.
    pub factor: BTreeMap<String, f64>,
    /// Light that arrives on average over the visit at a fibre's middle under a clear sky, by channel: Hz of counters, ADU/s of
    /// planes (as if every pixel had the colour). Empty without a target.
    pub arriving_hz: BTreeMap<String, f64>,
    /// Airmass in the middle.
    pub airmass: Option<f64>,
    /// Where the target was meant to stand, px from the middle of the sensor.
    pub aim_px: DVec2,
}

impl Night {
    /// Truth.
    pub fn truth(&self) -> Truth {
        let by_name = |value: &dyn Fn(usize) -> Option<f64>| {
            let channels = self.channels.iter().enumerate();
            channels.filter_map(|(i, channel)| Some((channel.name.clone(), value(i)?))).collect()
        };
        let visits = self.visits.iter().map(|truth| {
            let visit = &truth.visit;
            let kind = visit.target.kind();
            let seen = !truth.time_s.is_empty();
            let mean = |channel: usize| {
                const PARTS: u32 = 200;
                let parts = (0..PARTS).map(|part| (f64::from(part) + 0.5) / f64::from(PARTS));
                let rates = parts.map(|part| {
                    truth.arriving_hz(channel, visit.from_s + part * (visit.to_s - visit.from_s))
                });
                rates.sum::<f64>() / f64::from(PARTS)
            };
            TrueVisit {
                name: visit.target.name(),
                kind,
                from_s: visit.from_s,
                to_s: visit.to_s,
                factor: by_name(&|i| (kind == VisitKind::Star).then(|| truth.factor[i])),
                arriving_hz: by_name(&|i| seen.then(|| mean(i))),
                airmass: seen.then(|| truth.airmass(0.5 * (visit.from_s + visit.to_s))),
                aim_px: truth.aim_px,
            }
        });
        Truth {
            start_utc: format_utc_shortest(self.start),
            seed: self.options.seed,
            kappa: by_name(&|i| Some(self.channels[i].kappa)),
            sky_hz: by_name(&|i| match self.channels[i].instrument {
                Instrument::Counter { sky_hz, .. } => Some(sky_hz),
                Instrument::Plane { .. } => None,
            }),
            sky_e_per_s: by_name(&|i| match self.channels[i].instrument {
                Instrument::Plane { sky_e_per_s, .. } => Some(sky_e_per_s),
                Instrument::Counter { .. } => None,
            }),
            aerosol_depth: self.options.air.aerosol_depth,
            visits: visits.collect(),
        }
    }
}
