//! A night: what every channel would get, moment by moment, before any chance.

mod channels;
mod error;
mod visits;

pub use error::NightError;

use super::events::Detector;
use super::frame::Sensor;
use super::options::Options;
use super::plan::{Target, Visit};
use channels::{channel_truth, sensor, true_air};
use glam::DVec2;
use hifitime::Epoch;
use sunglint_radiometry::sky::EarthOrientation;
use sunglint_radiometry::station::{Fibre, Station};
use visits::Maker;

/// The height over which scintillation falls to 1/e², m (Young 1967).
const SCINTILLATION_HEIGHT_M: f64 = 8000.0;

/// True properties of a channel.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelTruth {
    /// Name.
    pub name: String,
    /// predicted = κ × arriving.
    pub kappa: f64,
    /// Instrument that counts its light.
    pub instrument: Instrument,
}

/// Counts of a counter in steady light, from a table. It says nothing of the gaps between counts: they are as random as those of photons.
#[derive(Debug, Clone, PartialEq)]
pub struct CountTable {
    /// Rates that arrive, dark events among them, Hz, rising.
    arriving_hz: Vec<f64>,
    /// Rates that are counted, Hz.
    counted_hz: Vec<f64>,
    /// Dark events, Hz.
    dark_rate_hz: f64,
}

impl CountTable {
    /// Returns the rate that is counted of light, Hz: on a line from darkness below the table's first row, between rows on a line, and what its last row counts beyond that.
    pub fn counted_hz(&self, light_hz: f64) -> f64 {
        let arriving = light_hz.max(0.0) + self.dark_rate_hz;
        let mut before = (0.0, 0.0);
        for row in self.arriving_hz.iter().copied().zip(self.counted_hz.iter().copied()) {
            if arriving < row.0 {
                let part = (arriving - before.0) / (row.0 - before.0);
                return before.1 + part * (row.1 - before.1);
            }
            before = row;
        }
        before.1
    }
}

/// Instrument that counts the light of a channel.
#[derive(Debug, Clone, PartialEq)]
pub enum Instrument {
    /// A counter.
    Counter {
        /// Detector.
        detector: Detector,
        /// A table of what it counts, in place of a dead time: the dark counts are in it.
        table: Option<CountTable>,
        /// Fibre's field; all of the light without it.
        fibre: Option<Fibre>,
        /// Sky's light that arrives at the night's begin, Hz.
        sky_hz: f64,
        /// Change of its logarithm for each unit of the exponent of λ/550 nm.
        sky_colour: f64,
        /// Seed of its own chance.
        seed: u64,
    },
    /// A plane of the camera.
    Plane {
        /// Colours in a picture: 0 red, 1 green, 2 blue.
        colours: &'static [usize],
        /// Sky's light that arrives on one of its pixels, e/s.
        sky_e_per_s: f64,
        /// Change of its logarithm for each unit of the exponent of λ/550 nm.
        sky_colour: f64,
    },
}

/// A visit with its light.
#[derive(Debug, Clone, PartialEq)]
pub struct VisitTruth {
    /// When, and of what.
    pub visit: Visit,
    /// True light over catalogued light of each channel; 1 of what is no star.
    pub factor: Vec<f64>,
    /// Where the target is meant to stand on the sensor, px from its middle.
    pub aim_px: DVec2,
    /// Times, s from the night's begin.
    pub time_s: Vec<f64>,
    /// Light that arrives at each time for each channel at the fibre's middle and through a clear sky: Hz of a counter, ADU/s of a plane, for the whole
    /// aperture as if every pixel had its colour.
    pub arriving_hz: Vec<Vec<f64>>,
    /// Airmass at each time.
    pub airmass: Vec<f64>,
    /// True zenith angle at each time, degrees; none of what is no star.
    pub zenith_deg: Vec<f64>,
}

impl VisitTruth {
    /// Between which times a moment lies, and how far along.
    fn between(&self, time_s: f64) -> Option<(usize, f64)> {
        let after = self.time_s.partition_point(|t| *t <= time_s);
        let last = self.time_s.len().checked_sub(1)?;
        if after == 0 || (after > last && time_s > self.time_s[last]) {
            return None;
        }
        let i = (after - 1).min(last.saturating_sub(1));
        let next = (i + 1).min(last);
        let span = self.time_s[next] - self.time_s[i];
        Some((i, if span > 0.0 { (time_s - self.time_s[i]) / span } else { 0.0 }))
    }

    /// Returns the light that arrives in a channel at a moment, before clouds, twinkling and coupling.
    pub fn arriving_hz(&self, channel: usize, time_s: f64) -> f64 {
        self.between(time_s).map_or(0.0, |(i, part)| {
            let next = (i + 1).min(self.time_s.len() - 1);
            mixed(self.arriving_hz[i][channel], self.arriving_hz[next][channel], part)
        })
    }

    /// The airmass at a moment; 1 where there is no target.
    pub fn airmass(&self, time_s: f64) -> f64 {
        self.between(time_s).map_or(1.0, |(i, part)| {
            let next = (i + 1).min(self.time_s.len() - 1);
            mixed(self.airmass[i], self.airmass[next], part)
        })
    }
}

fn mixed(one: f64, other: f64, part: f64) -> f64 {
    one + (other - one) * part
}

/// A night whose truth is known.
#[derive(Debug, Clone, PartialEq)]
pub struct Night {
    /// Begin.
    pub start: Epoch,
    /// Options of the night.
    pub options: Options,
    /// The station's channels, in its order.
    pub channels: Vec<ChannelTruth>,
    /// The visits, in the order of time.
    pub visits: Vec<VisitTruth>,
    /// The camera's sensor.
    pub sensor: Option<Sensor>,
    /// Angle that a pixel sees, arcsec; 1 without a camera.
    pub pixel_scale_arcsec: f64,
    /// Variance of the twinkling of a star in the zenith in an instant: what Young's law for 1 s asks for at the correlation time.
    pub scintillation: f64,
}

impl Night {
    /// A night over a station.
    ///
    /// # Errors
    /// Options that no night can have or that name another station's channels; a counter whose dead time has no model; a star
    /// without light or below the horizon; visits that overlap; a curve of the wrong shape.
    pub fn new(
        options: Options,
        station: &Station,
        start: Epoch,
        visits: Vec<Visit>,
        orientation: &EarthOrientation,
    ) -> Result<Self, NightError> {
        options.check()?;
        let known =
            || station.channels.iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", ");
        for (key, channel) in (options.kappa.keys().map(|name| ("kappa", name)))
            .chain(options.counter.keys().map(|name| ("counter", name)))
        {
            if station.channel(channel).is_none() {
                let (channel, station) = (channel.clone(), station.name.clone());
                return Err(NightError::Channel { key, channel, station, known: known() });
            }
        }
        let channels = (0_u64..).zip(&station.channels);
        let channels = channels.map(|(i, channel)| channel_truth(&options, station, channel, i));
        let channels: Vec<ChannelTruth> = channels.collect::<Result<_, _>>()?;
        let sensor = station.camera.as_ref().map(|camera| sensor(&options, camera));
        let maker = Maker {
            options: &options,
            station,
            start,
            orientation,
            channels: &channels,
            air: true_air(&options, station)?,
        };
        let visits = maker.visits(visits)?;
        let young = 1e-5
            * options.scintillation.strength.powi(2)
            * station.telescope.primary_diameter_m.powf(-4.0 / 3.0)
            * (-2.0 * station.site.geodetic().height_m / SCINTILLATION_HEIGHT_M).exp();
        // Averaged over t, long against the correlation time T, a variance s² becomes 2 s² T/t.
        let scintillation = young / (2.0 * options.scintillation.time_s);
        let pixel_scale_arcsec = station.camera.as_ref().map_or(1.0, |c| c.pixel_scale_arcsec);
        Ok(Self { start, options, channels, visits, sensor, pixel_scale_arcsec, scintillation })
    }

    /// Returns the time after the night's begin, s.
    pub fn seconds(&self, epoch: Epoch) -> f64 {
        (epoch - self.start).to_seconds()
    }

    /// Returns the end of the last visit, s from the night's begin.
    pub fn length_s(&self) -> f64 {
        self.visits.last().map_or(0.0, |visit| visit.visit.to_s)
    }

    /// The visit at a moment, by its number.
    pub fn visit_at(&self, time_s: f64) -> Option<usize> {
        let i = self.visits.partition_point(|visit| visit.visit.from_s <= time_s).checked_sub(1)?;
        (time_s < self.visits[i].visit.to_s).then_some(i)
    }

    /// Returns true where the shutter is closed at a moment.
    pub fn is_dark(&self, time_s: f64) -> bool {
        self.visit_at(time_s).is_some_and(|i| self.visits[i].visit.target == Target::Dark)
    }
}
