//! Rates that the plan's stars should have, by the catalogue: what the counts are held against where nobody gave a curve.

use crate::corrected::Predicted;
use hifitime::{Duration, Epoch};
use sunglint_formats::session::{Target, TargetKind};
use sunglint_observatory::Slot;
use sunglint_radiometry::air::Air;
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::sky::{Catalogue, EarthOrientation, Equatorial};
use sunglint_radiometry::star_light::{self, StarColours, VEGA_HIP};
use sunglint_radiometry::star_track::{StarTrack, StarView};
use sunglint_radiometry::station::{Detector, Station};

/// Time between two points, s: a star rises slowly.
const STEP_S: f64 = 60.0;
/// Points of a curve at most.
const POINTS: usize = 240;
/// Stays whose curves are kept at most.
const STAYS: usize = 200;

/// Curves of stays at stars, each computed once.
#[derive(Debug, Default)]
pub(crate) struct StarCurves(Vec<(Target, Epoch, Epoch, Option<Predicted>)>);

impl StarCurves {
    /// Curves of a schedule's stars over their stays. A star that the catalogue does not have with its magnitude has none.
    pub fn of(&mut self, slots: &[Slot], station: &Station, start: Epoch) -> Vec<Predicted> {
        let mut curves = Vec::new();
        for slot in slots.iter().filter(|slot| slot.target.target_kind == TargetKind::Star) {
            let to = slot.to.unwrap_or(slot.from + Duration::from_hours(1.0));
            let is_it = |known: &&(Target, Epoch, Epoch, Option<Predicted>)| {
                (&known.0, known.1, known.2) == (&slot.target, slot.from, to)
            };
            let curve = match self.0.iter().find(is_it) {
                Some(known) => known.3.clone(),
                None => {
                    let curve = star_curve(&slot.target, slot.from, to, station, start);
                    if self.0.len() >= STAYS {
                        self.0.remove(0);
                    }
                    self.0.push((slot.target.clone(), slot.from, to, curve.clone()));
                    curve
                }
            };
            curves.extend(curve);
        }
        curves
    }
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
    let (station, light) = (station.clone(), light.ok()?);
    let view = StarView { star, light, station, air, zero, exposure_s: 1.0 };
    let length_s = (to - from).to_seconds().max(0.0);
    let steps = ((length_s / STEP_S).ceil() as usize).clamp(1, POINTS);
    let at = |i: usize| from + Duration::from_seconds(length_s * i as f64 / steps as f64);
    let track = StarTrack::new(view, EarthOrientation::embedded(), (0..=steps).map(at).collect());
    let track = track.ok()?;
    let channels = track.station.channels.iter().enumerate();
    let counters: Vec<(usize, String)> = channels
        .filter(|(_, channel)| matches!(channel.detector, Detector::Counter(_)))
        .map(|(i, channel)| (i, channel.name.clone()))
        .collect();
    let rates = counters.iter().map(|(i, _)| {
        let rate = |sight: &sunglint_radiometry::star_track::StarSight| sight.rates[*i].counted_hz;
        track.sights.iter().map(rate).collect::<Vec<Option<f64>>>()
    });
    let rates: Vec<Vec<Option<f64>>> = rates.collect();
    if rates.iter().flatten().all(Option::is_none) {
        return None;
    }
    let at_s = track.sights.iter().map(|sight| (sight.epoch - start).to_seconds()).collect();
    let names = counters.into_iter().map(|(_, name)| name).collect();
    Some(Predicted::new(names, at_s, rates))
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
        let mut curves = StarCurves::default();
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
}
