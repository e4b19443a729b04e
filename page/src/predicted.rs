//! Light that the plan's targets should have: stars by the catalogue, satellites by the standard magnitude that the plan gives them. The counts are held against it where nobody gave a curve, and tracks on the sky have its colour.

use crate::corrected::Predicted;
use crate::sky::SkyTrack;
use hifitime::{Duration, Epoch};
use sunglint_ephemeris::passes::brightness::Brightness;
use sunglint_formats::session::{Target, TargetKind};
use sunglint_observatory::{Pointing, Slot};
use sunglint_radiometry::air::Air;
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::sky::{Catalogue, EarthOrientation, Equatorial, SkyFrames};
use sunglint_radiometry::star_light::{self, StarColours, VEGA_HIP};
use sunglint_radiometry::star_track::{StarSight, StarTrack, StarView};
use sunglint_radiometry::station::{Detector, Station};
use sunglint_simulator::sightings::{ExpectedLight, Photometer, SightingLight};

/// Time between two points of a star's curve, s: it rises slowly.
const STAR_STEP_S: f64 = 60.0;
/// The same of a satellite.
const SATELLITE_STEP_S: f64 = 1.0;
/// Points of a curve at most.
const POINTS: usize = 240;
/// Stays whose curves are kept at most.
const STAYS: usize = 200;

/// A stay whose curve was computed.
#[derive(Debug)]
struct Known {
    target: Target,
    from: Epoch,
    to: Epoch,
    magnitude: Option<f64>,
    curve: Option<Predicted>,
}

/// Curves of stays, each computed once.
#[derive(Debug, Default)]
pub(crate) struct StayCurves(Vec<Known>);

/// End of a stay; one without an end is shown for an hour.
fn end(slot: &Slot) -> Epoch {
    slot.to.unwrap_or(slot.from + Duration::from_hours(1.0))
}

/// Standard magnitude that the plan gives a satellite.
fn magnitude_of(slot: &Slot) -> Option<f64> {
    slot.step.as_ref().and_then(|step| step.standard_magnitude)
}

impl StayCurves {
    /// Curves of a schedule's stars and satellites over their stays. A star that the catalogue does not have with its magnitude has none, nor a satellite without a standard magnitude.
    pub fn of(&mut self, slots: &[Slot], station: &Station, start: Epoch) -> Vec<Predicted> {
        let mut curves = Vec::new();
        let air = air_for(slots.iter(), station);
        let mut eye = None;
        for slot in slots {
            let magnitude = magnitude_of(slot);
            if slot.target.target_kind != TargetKind::Star && magnitude.is_none() {
                continue;
            }
            let to = end(slot);
            let is_it = |known: &&Known| {
                (&known.target, known.from, known.to, known.magnitude)
                    == (&slot.target, slot.from, to, magnitude)
            };
            let curve = match self.0.iter().find(is_it) {
                Some(known) => known.curve.clone(),
                None => {
                    let curve = match magnitude {
                        Some(magnitude) => {
                            let eye = eye.get_or_insert_with(|| Eye::new(station, air.as_ref()?));
                            eye.as_mut().and_then(|eye| eye.curve(slot, magnitude, start))
                        }
                        None => star_curve(&slot.target, slot.from, to, station, start),
                    };
                    if self.0.len() >= STAYS {
                        self.0.remove(0);
                    }
                    let (target, from, curve) = (slot.target.clone(), slot.from, curve);
                    self.0.push(Known { target, from, to, magnitude, curve: curve.clone() });
                    curve
                }
            };
            curves.extend(curve);
        }
        curves
    }
}

/// Gives the tracks of satellites their V at the station, where the plan has a standard magnitude.
pub(crate) fn brighten(tracks: &mut [(SkyTrack, &Slot)], station: &Station, start: Epoch) {
    let with = |of: &&mut (SkyTrack, &Slot)| magnitude_of(of.1).is_some();
    let air = air_for(tracks.iter().map(|(_, slot)| *slot), station);
    let mut eye = None;
    for (track, slot) in tracks.iter_mut().filter(with) {
        let (Some(eye), Some(magnitude)) = (
            eye.get_or_insert_with(|| Eye::new(station, air.as_ref()?)).as_mut(),
            magnitude_of(slot),
        ) else {
            return;
        };
        let at = |s: &f64| start + Duration::from_seconds(*s);
        let of = |s: &f64| eye.light(&slot.target, magnitude, at(s))?.v_station;
        track.v_mag = track.at_s.iter().map(of).collect();
    }
}

/// The station's usual air, where a satellite's light is asked for.
fn air_for<'a>(mut slots: impl Iterator<Item = &'a Slot>, station: &Station) -> Option<Air> {
    slots.any(|slot| magnitude_of(slot).is_some()).then_some(())?;
    Air::new(&station.air_options().ok()?).ok()
}

/// The station's eye on satellites.
struct Eye<'a> {
    station: &'a Station,
    photometer: Photometer<'a>,
    pointing: Pointing,
}

impl<'a> Eye<'a> {
    /// Through an air; `None` where that has no spectrum.
    fn new(station: &'a Station, air: &'a Air) -> Option<Self> {
        // By the law no frame is asked for: any time will do.
        let now = Epoch::from_mjd_utc(60_000.0);
        let frames = SkyFrames::over(now, now, EarthOrientation::embedded()).ok()?;
        let law = SightingLight::Law(Brightness::Standard { magnitude: 0.0 });
        let photometer = Photometer::new(station, air, law, frames, ZeroPoint::default(), 1.0);
        let pointing = Pointing::new(station.clone());
        Some(Self { station, photometer: photometer.ok()?, pointing })
    }

    /// Light of a satellite of this standard magnitude.
    fn light(&mut self, target: &Target, magnitude: f64, utc: Epoch) -> Option<ExpectedLight> {
        let geometry = self.pointing.geometry(target, utc)?;
        Some(self.photometer.by_law(Brightness::Standard { magnitude }, &geometry))
    }

    /// Rates that the counters should report over a stay, without the sky beside it; `None` where no light comes at all.
    fn curve(&mut self, slot: &Slot, magnitude: f64, start: Epoch) -> Option<Predicted> {
        let times = times(slot.from, end(slot), SATELLITE_STEP_S);
        let counters: Vec<usize> = counters(self.station).collect();
        let mut rates = vec![Vec::new(); counters.len()];
        for utc in &times {
            let light = self.light(&slot.target, magnitude, *utc);
            for (list, k) in rates.iter_mut().zip(&counters) {
                let of = light.as_ref().and_then(|light| light.channels.get(*k)?.as_ref());
                list.push(of.and_then(|(_, predicted)| predicted.counted_hz));
            }
        }
        predicted(self.station, &times, rates, start)
    }
}

/// Times over a stay, at most so far apart as asked, and not more than a curve may have.
fn times(from: Epoch, to: Epoch, step_s: f64) -> Vec<Epoch> {
    let length_s = (to - from).to_seconds().max(0.0);
    let steps = ((length_s / step_s).ceil() as usize).clamp(1, POINTS);
    let at = |i: usize| from + Duration::from_seconds(length_s * i as f64 / steps as f64);
    (0..=steps).map(at).collect()
}

/// The station's counters, by their places among the channels.
fn counters(station: &Station) -> impl Iterator<Item = usize> {
    let is_counter = |i: &usize| matches!(station.channels[*i].detector, Detector::Counter(_));
    (0..station.channels.len()).filter(is_counter)
}

/// A curve of all counters; none where no rate is known.
fn predicted(
    station: &Station,
    times: &[Epoch],
    rates: Vec<Vec<Option<f64>>>,
    start: Epoch,
) -> Option<Predicted> {
    if rates.iter().flatten().all(Option::is_none) {
        return None;
    }
    let at_s = times.iter().map(|utc| (*utc - start).to_seconds()).collect();
    let names = counters(station).map(|i| station.channels[i].name.clone()).collect();
    Some(Predicted::new(names, at_s, rates))
}

/// Rates that the station's counters should report of a star, without the sky beside it.
fn star_curve(
    target: &Target,
    from: Epoch,
    to: Epoch,
    station: &Station,
    start: Epoch,
) -> Option<Predicted> {
    let place = Equatorial { ra_deg: target.ra_deg?, dec_deg: target.dec_deg? };
    let star = Catalogue::embedded().find_at(&target.name, place).ok()?.clone();
    let zero = ZeroPoint::default();
    let colours = StarColours {
        v_mag: star.v_mag?,
        b_minus_v_mag: star.bv_mag,
        spectral_type: star.spectral_type.as_deref(),
        zero,
    };
    let light = match star.hip {
        Some(VEGA_HIP) => star_light::vega(colours),
        _ => star_light::of(colours),
    };
    let air = Air::new(&station.air_options().ok()?).ok()?;
    let light = light.ok()?;
    let view = StarView { star, light, station: station.clone(), air, zero, exposure_s: 1.0 };
    let times = times(from, to, STAR_STEP_S);
    let track = StarTrack::new(view, EarthOrientation::embedded(), times.clone()).ok()?;
    let rate = |sight: &StarSight, i: usize| sight.rates[i].counted_hz;
    let rates = counters(station);
    let rates = rates.map(|i| track.sights.iter().map(|sight| rate(sight, i)).collect());
    predicted(station, &times, rates.collect(), start)
}

#[cfg(test)]
mod tests {
    use super::*;
    use sunglint_formats::time::parse_utc;

    /// Truth: `sunglint star Vega` of the program itself, whose rates are held against measured ones elsewhere: the same star track, asked for one moment. A name that the catalogue lacks has no curve;
    /// a stay is computed once.
    #[test]
    fn stars_of_the_plan_have_curves() {
        let station = Station::built_in("ufo").unwrap().unwrap();
        let vega = Catalogue::embedded().find("Vega").unwrap();
        let mut target = Target::off(TargetKind::Star);
        (target.name, target.on) = ("Vega".into(), true);
        (target.ra_deg, target.dec_deg) = (Some(vega.icrs.ra_deg), Some(vega.icrs.dec_deg));
        let from = parse_utc("2020-11-18T17:00:00Z").unwrap();
        let to = from + Duration::from_seconds(600.0);
        let slot = Slot::new(target.clone(), from, Some(to));
        let other = Slot::new(Target { name: "Nowhere".into(), ..target }, from, Some(to));
        let start = from - Duration::from_seconds(100.0);
        let mut curves = StayCurves::default();
        let found = curves.of(&[slot.clone(), other], &station, start);
        assert_eq!((found.len(), curves.0.len()), (1, 2));
        let found = serde_json::to_value(&found[0]).unwrap();
        assert_eq!(found["at_s"].as_array().unwrap().len(), 11);
        assert_eq!((&found["at_s"][0], &found["at_s"][10]), (&100.0.into(), &700.0.into()));
        let channels = found["channels"].as_array().unwrap();
        let at = channels.iter().position(|name| name == "id400").unwrap();
        // It sinks in the north-west: fainter minute by minute, and not by much.
        let rates: Vec<f64> =
            found["rate_hz"][at].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
        assert!(rates.is_sorted_by(|a, b| a > b) && rates[10] > 0.8 * rates[0], "{rates:?}");
        curves.of(&[slot], &station, start);
        assert_eq!(curves.0.len(), 2);
    }
    /// Truth: Pogson's law: a body of 6 mag sends ten times the light of one of 8.5 at all times, once dead time and dark counts are taken off by the laws that are tested on their own (to 1 %: the bias of few counts). The light itself is
    /// that of `sunglint passes`, whose tests hold it. Below the horizon and without a standard magnitude there is none.
    #[test]
    fn satellites_of_the_plan_have_curves() {
        let station = Station::built_in("ufo").unwrap().unwrap();
        let mut target = Target::off(TargetKind::Satellite);
        (target.name, target.on) = ("synthetic".into(), true);
        target.tle = Some([
            "1 99004U 20001A   20323.50000000  .00000000  00000-0  10000-4 0    19".into(),
            "2 99004  98.6000 318.0000 0010000  90.0000  90.0000 14.27000000    13".into(),
        ]);
        // It rises, and is seen in the dusk.
        let start = parse_utc("2020-11-18T16:10:00Z").unwrap();
        let slot = |magnitude: Option<f64>| {
            let mut slot =
                Slot::new(target.clone(), start, Some(start + Duration::from_seconds(1200.0)));
            let step =
                sunglint_observatory::Step { standard_magnitude: magnitude, ..Default::default() };
            slot.step = Some(std::sync::Arc::new(step));
            slot
        };
        let mut curves = StayCurves::default();
        assert_eq!(curves.of(&[slot(None)], &station, start), []);
        let rates = |curves: &mut StayCurves, magnitude: f64| -> Vec<Option<f64>> {
            let found = curves.of(&[slot(Some(magnitude))], &station, start);
            let found = serde_json::to_value(&found[0]).unwrap();
            let channels = found["channels"].as_array().unwrap();
            let at = channels.iter().position(|name| name == "id400").unwrap();
            found["rate_hz"][at].as_array().unwrap().iter().map(|v| v.as_f64()).collect()
        };
        let (faint, bright) = (rates(&mut curves, 8.5), rates(&mut curves, 6.0));
        assert_eq!(faint.len(), POINTS + 1);
        let corrected = crate::corrected::Corrected::of(&station);
        let light = |counted: f64| corrected.rate_hz("id400", counted, 1e4);
        let both =
            faint.iter().zip(&bright).filter_map(|(a, b)| Some((light((*a)?)?, light((*b)?)?)));
        let both: Vec<(f64, f64)> = both.filter(|(faint, _)| *faint > 10.0).collect();
        assert!(both.len() > 20 && faint.iter().any(Option::is_none), "{faint:?}");
        for (faint, bright) in both {
            assert!((bright / faint / 10.0 - 1.0).abs() < 1e-2, "{faint} {bright}");
        }
        // The same on the sky: V of its track, 2.5 mag apart, brighter than at 1,000 km at most by what its range and its lit part make of it.
        let of = |magnitude: f64| {
            let slot = slot(Some(magnitude));
            let to = slot.to.unwrap();
            let track = SkyTrack::over(&station, start, &slot.target, slot.from, to).unwrap();
            let mut tracks = [(track, &slot)];
            brighten(&mut tracks, &station, start);
            tracks[0].0.v_mag.clone()
        };
        let (faint, bright) = (of(8.5), of(6.0));
        let both: Vec<(f64, f64)> =
            faint.iter().zip(&bright).filter_map(|(a, b)| Some(((*a)?, (*b)?))).collect();
        assert!(both.len() > 20 && both.len() < faint.len(), "{faint:?}");
        for (faint, bright) in both {
            assert!((faint - bright - 2.5).abs() < 1e-9 && faint > 8.5 - 2.0, "{faint} {bright}");
        }
    }
}
