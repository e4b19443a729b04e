//! The light of the visits.

use super::{ChannelTruth, Instrument, NightError, VisitTruth};
use crate::observatory::options::{Options, VisitKind};
use crate::observatory::plan::{Curve, Target, Visit};
use crate::observatory::random::{Purpose, stream};
use glam::DVec2;
use hifitime::{Epoch, Unit};
use rand::RngExt as _;
use rand_distr::{Distribution as _, StandardNormal};
use sunglint_radiometry::air::{Air, AirError, Zenith};
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::sky::{EarthOrientation, Observer, Star};
use sunglint_radiometry::star_light::{self, StarColours, StarLightError};
use sunglint_radiometry::station::Station;

/// The longest time between two places of a star that are computed, s: rates are lines between them, at 25° good to 2e−5.
const NODE_S: f64 = 60.0;

/// Data that the visits are made with.
pub(super) struct Maker<'a> {
    pub options: &'a Options,
    pub station: &'a Station,
    pub start: Epoch,
    pub orientation: &'a EarthOrientation,
    pub channels: &'a [ChannelTruth],
    pub air: Air,
}

impl Maker<'_> {
    pub(super) fn visits(&self, visits: Vec<Visit>) -> Result<Vec<VisitTruth>, NightError> {
        let mut names: Vec<String> = Vec::new();
        for visit in visits.iter().filter(|visit| visit.target.kind() == VisitKind::Star) {
            let name = visit.target.name();
            if !names.contains(&name) {
                names.push(name);
            }
        }
        let factors = self.factors(names.len());
        let mut before_s = f64::NEG_INFINITY;
        let mut made = Vec::with_capacity(visits.len());
        for (number, visit) in visits.into_iter().enumerate() {
            if visit.from_s < before_s || visit.to_s <= visit.from_s {
                return Err(NightError::Overlap { number, from_s: visit.from_s, before_s });
            }
            before_s = visit.to_s;
            let star = names.iter().position(|name| *name == visit.target.name());
            let aim_px = self.aim_px(number);
            made.push(match &visit.target {
                Target::Star(of) => {
                    let factor = star.map_or_else(Vec::new, |star| factors[star].clone());
                    self.star(&visit, of, factor, aim_px)?
                }
                Target::Curve(curve) => self.curve(&visit, curve, aim_px)?,
                _ => VisitTruth {
                    factor: vec![1.0; self.channels.len()],
                    aim_px,
                    time_s: Vec::new(),
                    arriving_hz: Vec::new(),
                    airmass: Vec::new(),
                    zenith_deg: Vec::new(),
                    visit,
                },
            });
        }
        Ok(made)
    }

    /// Returns the true over the catalogued light of the stars, in each channel.
    fn factors(&self, stars: usize) -> Vec<Vec<f64>> {
        let options = &self.options.stars;
        let mut lots: Vec<(f64, f64, Vec<f64>)> = (0..stars as u64)
            .map(|star| {
                let mut random = stream(self.options.seed, Purpose::Stars, star);
                let (lot, part): (f64, f64) = (random.random(), random.random());
                let [least, most] = options.dimmed_to;
                let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
                let common = options.scatter * normal();
                let of_channel = |_| (common + options.channel_scatter * normal()).exp();
                (lot, least + (most - least) * part, self.channels.iter().map(of_channel).collect())
            })
            .collect();
        let mut order: Vec<usize> = (0..stars).collect();
        order.sort_by(|a, b| lots[*a].0.total_cmp(&lots[*b].0));
        for star in order.into_iter().take(options.dimmed) {
            let dimmed = lots[star].1;
            lots[star].2.iter_mut().for_each(|factor| *factor *= dimmed);
        }
        lots.into_iter().map(|(_, _, factors)| factors).collect()
    }

    fn aim_px(&self, number: usize) -> DVec2 {
        let fibres: Vec<DVec2> = (self.channels.iter())
            .filter_map(|channel| match &channel.instrument {
                Instrument::Counter { fibre, .. } => fibre.map(|fibre| fibre.offset_px),
                Instrument::Plane { .. } => None,
            })
            .collect();
        let mean = |axis: usize| {
            fibres.iter().map(|offset| offset[axis]).sum::<f64>() / fibres.len().max(1) as f64
        };
        let aim = self.options.pointing.aim_px.unwrap_or([mean(0), mean(1)]);
        let mut random = stream(self.options.seed, Purpose::Part, 2000 + number as u64);
        aim.map(|aim| {
            let off: f64 = StandardNormal.sample(&mut random);
            aim + self.options.pointing.aim_scatter_px * off
        })
        .into()
    }

    fn star(
        &self,
        visit: &Visit,
        star: &Star,
        factor: Vec<f64>,
        aim_px: DVec2,
    ) -> Result<VisitTruth, NightError> {
        let no_light = |source| NightError::Light { star: star.label(), source };
        let no_magnitude =
            StarLightError::NothingToGoBy { spectral_type: star.spectral_type.clone() };
        let colours = StarColours {
            v_mag: star.v_mag.ok_or(no_magnitude).map_err(no_light)?,
            b_minus_v_mag: star.bv_mag,
            spectral_type: star.spectral_type.as_deref(),
            zero: ZeroPoint::default(),
        };
        // Vega's own spectrum is measured: its number in the Hipparcos catalogue.
        let light = if star.hip == Some(91262) {
            star_light::vega(colours)
        } else {
            star_light::of(colours)
        };
        let light = light.map_err(no_light)?.irradiance;
        let steps = ((visit.to_s - visit.from_s) / NODE_S).ceil().max(1.0) as u32;
        let step_s = (visit.to_s - visit.from_s) / f64::from(steps);
        let mut made = VisitTruth {
            visit: visit.clone(),
            factor,
            aim_px,
            time_s: Vec::new(),
            arriving_hz: Vec::new(),
            airmass: Vec::new(),
            zenith_deg: Vec::new(),
        };
        for node in 0..=steps {
            let time_s = visit.from_s + f64::from(node) * step_s;
            let at = self.start + time_s * Unit::Second;
            let observer = Observer::at(at, &self.station.site, self.orientation)?;
            let zenith_deg = observer.star(star).horizontal.zenith_deg();
            let below = NightError::Below { star: star.label(), at, zenith_deg };
            let path = match self.air.path(Zenith::True(zenith_deg)) {
                Err(AirError::BelowHorizon { .. }) => return Err(below),
                path => path?,
            };
            let air = self.air.spectrum(Zenith::True(zenith_deg), light.range_nm())?;
            let channels = self.station.channels.iter().zip(self.channels).zip(&made.factor);
            let rates = channels.map(|((channel, truth), factor)| {
                self.station.rate_hz(channel, &light, Some(&air)).value * factor / truth.kappa
            });
            made.arriving_hz.push(rates.collect());
            made.time_s.push(time_s);
            made.airmass.push(self.air.air_masses(&path).rayleigh);
            made.zenith_deg.push(zenith_deg);
        }
        Ok(made)
    }

    fn curve(&self, visit: &Visit, curve: &Curve, aim_px: DVec2) -> Result<VisitTruth, NightError> {
        let channels = self.channels.len();
        let whole = curve.rates_hz.iter().all(|row| row.len() == channels)
            && curve.rates_hz.len() == curve.time_s.len()
            && curve.airmass.len() == curve.time_s.len()
            && curve.time_s.windows(2).all(|pair| pair[0] < pair[1]);
        if !whole {
            let (times, rows) = (curve.time_s.len(), curve.rates_hz.len());
            return Err(NightError::CurveShape { name: curve.name.clone(), times, rows, channels });
        }
        let arriving = |row: &Vec<f64>| {
            row.iter().zip(self.channels).map(|(hz, truth)| hz / truth.kappa).collect()
        };
        Ok(VisitTruth {
            visit: visit.clone(),
            factor: vec![1.0; channels],
            aim_px,
            time_s: curve.time_s.clone(),
            arriving_hz: curve.rates_hz.iter().map(arriving).collect(),
            airmass: curve.airmass.clone(),
            zenith_deg: Vec::new(),
        })
    }
}
