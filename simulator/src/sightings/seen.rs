//! A pass as the station sees it: its moments, how bright, what the channels count.

use super::SightingError;
use super::model::{MODEL_STEP_S, SightingLight};
use crate::pass::{Eye, PassError, Sample};
use hifitime::Epoch;
use rayon::prelude::*;
use std::cell::RefCell;
use sunglint_ephemeris::geometry::Geometry;
use sunglint_ephemeris::orbit::{Orbit, Tle};
use sunglint_ephemeris::passes::brightness::Brightness;
use sunglint_ephemeris::passes::{Pass, Search, Span};
use sunglint_radiometry::air::{Air, Zenith};
use sunglint_radiometry::light::sun_at_1_au;
use sunglint_radiometry::passband::{Passband, ZeroPoint};
use sunglint_radiometry::sky::{Observer, SkyFrames, Twilight};
use sunglint_radiometry::station::{Mount, Predicted, Station};

/// A pass that can be seen.
#[derive(Debug, Clone)]
pub struct SeenPass {
    /// Name and number.
    pub target: String,
    /// The number in the catalogue.
    pub norad_id: u32,
    /// The stay above the horizon.
    pub pass: Pass,
    /// Orbit of the target, for figures.
    pub orbit: Orbit,
    /// The first moment at which it can be seen.
    pub start: SightingEvent,
    /// When it stands highest, seen or not.
    pub culmination: SightingEvent,
    /// When it is brightest above the air while it can be seen.
    pub brightest: SightingEvent,
    /// The last moment at which it can be seen.
    pub end: SightingEvent,
    /// Expected light at the brightest moment.
    pub expected: ExpectedLight,
    /// Whether a mount of the station's kind is interrupted: meridian crossing while visible (equatorial).
    pub meridian_flip: bool,
    /// Whether it passes through the blind cone of an alt-azimuth mount while visible.
    pub keyhole: bool,
}

/// A moment of a pass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SightingEvent {
    /// Where everything is.
    pub geometry: Geometry,
    /// Johnson V above the air; infinite in the umbra.
    pub v_mag: f64,
    /// True altitude of the Sun at the station, degrees.
    pub sun_altitude_deg: f64,
    /// True altitude of the Moon, degrees.
    pub moon_altitude_deg: f64,
    /// Angle to the Moon, degrees.
    pub moon_separation_deg: f64,
    /// Illuminated part of the Moon's disc.
    pub moon_illuminated: f64,
    /// How dark the sky is.
    pub twilight: Twilight,
}

impl SightingEvent {
    /// The standard magnitude (V at 1,000 km, half lit) by which a target has this V here; `None` in the umbra.
    pub fn standard_magnitude(&self) -> Option<f64> {
        let Geometry { phase_rad, range_m, sun, sunlit, .. } = self.geometry;
        let nought = Brightness::Standard { magnitude: 0.0 };
        let factor = nought.of_sunlight(phase_rad, range_m, sun.distance_m, sunlit, 0.0);
        let magnitude = self.v_mag + 2.5 * factor.log10();
        magnitude.is_finite().then_some(magnitude)
    }
}

/// Light that arrives and is counted at one moment.
#[derive(Debug, Clone, PartialEq)]
pub struct ExpectedLight {
    /// Johnson V at the station, after the air; `None` where no light comes through.
    pub v_station: Option<f64>,
    /// For each channel of the station: the predicted rate at the detector, Hz, and what the channel makes of it.
    pub channels: Vec<Option<(f64, Predicted)>>,
}

/// The place of V among [`BANDS`](crate::pass::BANDS).
const V: usize = 2;
/// Above this altitude an alt-azimuth mount counts as blind, degrees.
pub const KEYHOLE_DEG: f64 = 85.0;

impl SeenPass {
    pub(super) fn new(
        orbit: &Orbit,
        tle: &Tle,
        pass: Pass,
        search: &Search,
        photometer: &Photometer<'_>,
    ) -> Result<Self, SightingError> {
        let event = |epoch| photometer.event(orbit, epoch);
        let (first, last) = match pass.visible.as_slice() {
            [] => (pass.span, pass.span),
            [first, .., last] => (*first, *last),
            [only] => (*only, *only),
        };
        let start = event(first.from)?;
        let mut brightest = start;
        for span in &pass.visible {
            let found = event(photometer.brightest(search, orbit, *span, &start))?;
            if found.v_mag < brightest.v_mag {
                brightest = found;
            }
        }
        let seen_at = |epoch| pass.visible.iter().any(|v: &Span| v.from <= epoch && epoch <= v.to);
        let mount = photometer.station.telescope.mount;
        let meridian_flip =
            mount == Mount::Equatorial && pass.meridian.iter().any(|c| seen_at(c.epoch));
        let keyhole = mount == Mount::AltAzimuth
            && pass.highest_deg > KEYHOLE_DEG
            && seen_at(pass.culmination);
        Ok(Self {
            target: tle.label(),
            norad_id: tle.norad_id,
            start,
            culmination: event(pass.culmination)?,
            brightest,
            end: event(last.to)?,
            expected: photometer.expected(orbit, &brightest.geometry)?,
            meridian_flip,
            keyhole,
            orbit: orbit.clone(),
            pass,
        })
    }

    /// How long it can be seen, s.
    pub fn visible_s(&self) -> f64 {
        self.pass.visible.iter().map(Span::seconds).sum()
    }

    /// The highest altitude while it can be seen, degrees.
    pub fn highest_visible_deg(&self) -> f64 {
        let culmination = self.culmination.geometry.epoch;
        if self.pass.visible.iter().any(|v| v.from <= culmination && culmination <= v.to) {
            return self.pass.highest_deg;
        }
        let altitude = |e: &SightingEvent| e.geometry.horizontal.altitude_deg();
        [&self.start, &self.brightest, &self.end].into_iter().map(altitude).fold(-90.0, f64::max)
    }
}

/// The station's eyes on sunlight: channel rates and magnitudes of light that is the Sun's times a factor, through the air at any height.
pub struct Photometer<'a> {
    /// The station.
    pub station: &'a Station,
    /// The air above it.
    pub air: &'a Air,
    /// How bright the targets are.
    pub light: SightingLight<'a>,
    frames: SkyFrames<'a>,
    /// Magnitude of Vega that V counts from.
    pub zero: ZeroPoint,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Johnson V of the Sun at 1 au above the air.
    pub sun_v: f64,
    /// By the logarithm of an air mass 1/sin(h + …): the Sun's V after the air, and the channels' ln of rates in Hz.
    nodes: Vec<Node>,
}

struct Node {
    v_mag: f64,
    ln_rates: Vec<f64>,
}

/// Heights at which the air is computed; between them magnitudes and logarithms of rates are interpolated, to 0.1 %.
const NODES: usize = 64;

/// A coordinate in which extinction is nearly linear: Kasten and Young's (1989) airmass of the true altitude, logarithmic.
fn height_coordinate(altitude_deg: f64) -> f64 {
    let h = altitude_deg.max(0.0);
    -(h.to_radians().sin() + 0.50572 * (h + 6.07995).powf(-1.6364)).ln()
}

impl<'a> Photometer<'a> {
    /// Prepares the air at all heights.
    ///
    /// # Errors
    /// Air without a spectrum there, sunlight without a magnitude.
    pub fn new(
        station: &'a Station,
        air: &'a Air,
        light: SightingLight<'a>,
        frames: SkyFrames<'a>,
        zero: ZeroPoint,
        exposure_s: f64,
    ) -> Result<Self, SightingError> {
        let band = Passband::named("V")?;
        let sun = sun_at_1_au();
        let sun_v = band.magnitude(sun, zero)?;
        let node = |i: usize| -> Result<Node, SightingError> {
            let zenith = Zenith::True(90.0 - node_altitude_deg(i));
            let t = air.spectrum(zenith, sun.range_nm())?;
            let v_mag = match sun.through(&t) {
                Ok(after) => band.magnitude(&after, zero)?,
                Err(error) => return Err(error.into()),
            };
            let rates = station.channels.iter().map(|c| station.rate_hz(c, sun, Some(&t)));
            Ok(Node { v_mag, ln_rates: rates.map(|r| r.value.ln()).collect() })
        };
        let nodes: Vec<Result<Node, SightingError>> =
            (0..NODES).into_par_iter().map(node).collect();
        let nodes = nodes.into_iter().collect::<Result<Vec<Node>, SightingError>>()?;
        Ok(Self { station, air, light, frames, zero, exposure_s, sun_v, nodes })
    }

    /// The light that is expected at a moment. Every threshold is left aside: a target below the horizon has no light, one in the umbra neither.
    ///
    /// # Errors
    /// A moment outside the frames, an orbit without a place then, a model without light.
    pub fn at(&self, orbit: &Orbit, epoch: Epoch) -> Result<ExpectedLight, SightingError> {
        let observer = Observer::new(self.frames.at(epoch)?, &self.station.site);
        self.expected(orbit, &Geometry::at(orbit, &observer)?)
    }

    /// Whether the light is that of a model, which costs time at each moment.
    pub fn is_model(&self) -> bool {
        matches!(self.light, SightingLight::Model(..))
    }

    /// Sunlight times this arrives above the air.
    fn factor(&self, brightness: Brightness, geometry: &Geometry) -> f64 {
        let Geometry { phase_rad, range_m, sun, sunlit, .. } = geometry;
        brightness.of_sunlight(*phase_rad, *range_m, sun.distance_m, *sunlit, self.sun_v)
    }

    /// The moment of a span at which the target is brightest above the air.
    fn brightest(
        &self,
        search: &Search,
        orbit: &Orbit,
        span: Span,
        start: &SightingEvent,
    ) -> Epoch {
        match &self.light {
            SightingLight::Law(law) => {
                let sun_m = start.geometry.sun.distance_m;
                let measure = |phase, range| law.of_sunlight(phase, range, sun_m, 1.0, self.sun_v);
                search.brightest(orbit, span, measure)
            }
            SightingLight::Model(ready, _) => {
                let eye = RefCell::new(ready.eye());
                // Where there is no light there is no magnitude, and nothing is fainter.
                search.highest(span, MODEL_STEP_S.min(span.seconds() / 16.0), |epoch| {
                    let sample = self.sample(&mut eye.borrow_mut(), orbit, epoch);
                    let v = sample.map_or(f64::NAN, |s| s.magnitudes[V]);
                    if v.is_nan() { f64::NEG_INFINITY } else { -v }
                })
            }
        }
    }

    fn sample(&self, eye: &mut Eye<'_>, orbit: &Orbit, epoch: Epoch) -> Result<Sample, PassError> {
        eye.sample(orbit, epoch, &self.frames, self.exposure_s)
    }

    fn event(&self, orbit: &Orbit, epoch: Epoch) -> Result<SightingEvent, SightingError> {
        let observer = Observer::new(self.frames.at(epoch)?, &self.station.site);
        let geometry = Geometry::at(orbit, &observer)?;
        let v_mag = match &self.light {
            SightingLight::Law(law) => self.sun_v - 2.5 * self.factor(*law, &geometry).log10(),
            SightingLight::Model(ready, _) => {
                let v = self.sample(&mut ready.eye(), orbit, epoch)?.magnitudes[V];
                if v.is_nan() { f64::INFINITY } else { v }
            }
        };
        let moon = observer.moon();
        Ok(SightingEvent {
            geometry,
            v_mag,
            sun_altitude_deg: geometry.sun_altitude_deg(&observer),
            moon_altitude_deg: moon.horizontal.altitude_deg(),
            moon_separation_deg: moon.horizontal.separation_deg(geometry.horizontal),
            moon_illuminated: moon.place.illuminated_fraction(),
            twilight: observer.twilight(),
        })
    }

    fn expected(&self, orbit: &Orbit, geometry: &Geometry) -> Result<ExpectedLight, SightingError> {
        match &self.light {
            SightingLight::Law(law) => Ok(self.by_law(*law, geometry)),
            SightingLight::Model(ready, _) => {
                let sample = self.sample(&mut ready.eye(), orbit, geometry.epoch)?;
                let v = sample.ground_magnitudes[V];
                let good = |(hz, predicted): &(f64, Predicted)| {
                    hz.is_finite().then_some((*hz, *predicted))
                };
                Ok(ExpectedLight {
                    v_station: v.is_finite().then_some(v),
                    channels: sample.channels.iter().map(good).collect(),
                })
            }
        }
    }

    /// The light of a target that has this law of brightness.
    pub fn by_law(&self, law: Brightness, geometry: &Geometry) -> ExpectedLight {
        let altitude_deg = geometry.horizontal.altitude_deg();
        let factor = self.factor(law, geometry);
        let channels = &self.station.channels;
        if altitude_deg < 0.0 || factor <= 0.0 {
            return ExpectedLight { v_station: None, channels: vec![None; channels.len()] };
        }
        let at = height_coordinate(altitude_deg) / height_coordinate(0.0) * (NODES - 1) as f64;
        let i = (at.floor().max(0.0) as usize).min(NODES - 2);
        let part = at - i as f64;
        let between = |a: f64, b: f64| if a == b { a } else { a + (b - a) * part };
        let (a, b) = (&self.nodes[i], &self.nodes[i + 1]);
        let v_station = Some(between(a.v_mag, b.v_mag) - 2.5 * factor.log10());
        let rate = |k: usize| {
            let hz = between(a.ln_rates[k], b.ln_rates[k]).exp() * factor;
            let predicted = self.station.predict(&channels[k], hz, self.exposure_s);
            hz.is_finite().then_some((hz, predicted))
        };
        ExpectedLight { v_station, channels: (0..channels.len()).map(rate).collect() }
    }
}

/// The altitude of a node, by bisection of the coordinate, which falls with the altitude.
fn node_altitude_deg(i: usize) -> f64 {
    let wanted = height_coordinate(0.0) * i as f64 / (NODES - 1) as f64;
    let (mut low, mut high) = (0.0, 90.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if height_coordinate(middle) > wanted { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the definition: altitudes come back from their coordinate, from the zenith to the horizon; to rounding of the bisection.
    #[test]
    fn nodes_go_from_the_zenith_to_the_horizon() {
        assert!(node_altitude_deg(0) > 88.0);
        assert!(node_altitude_deg(NODES - 1) < 1e-9);
        for i in 1..NODES {
            assert!(node_altitude_deg(i) < node_altitude_deg(i - 1));
            let at = height_coordinate(node_altitude_deg(i)) / height_coordinate(0.0);
            assert!((at * (NODES - 1) as f64 - i as f64).abs() < 1e-9, "{i}");
        }
    }
}
