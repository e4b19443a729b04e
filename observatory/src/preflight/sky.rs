//! What a visit's target and the sky around it do during the visit.

use super::{PlanFinding, Preflight, PreflightOptions, seconds, span};
use crate::pointing::{Body, airmass};
use crate::schedule::Slot;
use hifitime::Epoch;
use sunglint_ephemeris::geometry::Geometry;
use sunglint_ephemeris::orbit::{Orbit, elements};
use sunglint_formats::time::format_utc;
use sunglint_radiometry::sky::{EarthOrientation, Observer, separation_rad};
use sunglint_radiometry::station::Station;

/// Moments of a visit that are looked at: one each 5 s, but so many at least and at most.
const STEP_S: f64 = 5.0;
const MOMENTS: [f64; 2] = [4.0, 120.0];
/// Mean refraction at the horizon, degrees.
const HORIZON_REFRACTION_DEG: f64 = 34.0 / 60.0;

/// Flats of the sky need twilight; a screen may be lit at any time.
pub(super) fn check_twilight(
    about: &str,
    slot: &Slot,
    span: (Epoch, Epoch),
    station: &Station,
    found: &mut Preflight,
) {
    let Ok(course) = body(slot).and_then(|body| course(body.as_ref(), span, station)) else {
        return;
    };
    let (low, high) = (least(&course.sun_altitude_deg), most(&course.sun_altitude_deg));
    if high > 0.0 || low < -10.0 {
        let text = format!(
            "the Sun stands at {low:+.0}° to {high:+.0}°: the sky of twilight (0° to −10°) is missing, if these are no flats of a screen"
        );
        found.warning(about, text);
    } else {
        found.fine(about, format!("twilight: the Sun stands at {low:+.0}° to {high:+.0}°"));
    }
}

/// A visit at some moments.
#[derive(Debug, Default)]
struct Course {
    /// Altitudes above the station's horizon, and true ones, degrees.
    above_deg: Vec<f64>,
    altitude_deg: Vec<f64>,
    sun_altitude_deg: Vec<f64>,
    /// Only where it is up: angles to the Sun, with the Sun's altitude, and whether the Sun shines on a satellite.
    sun_deg: Vec<f64>,
    sun_beside_deg: Vec<f64>,
    sunlit: Vec<f64>,
    /// Only where the Moon is up, too.
    moon_deg: Vec<f64>,
}

fn most(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::NEG_INFINITY, f64::max)
}

fn least(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::INFINITY, f64::min)
}

/// The part of the values for which something is true.
fn part(values: &[f64], is: impl Fn(f64) -> bool) -> f64 {
    values.iter().filter(|value| is(**value)).count() as f64 / values.len().max(1) as f64
}

fn body(slot: &Slot) -> Result<Option<Body>, String> {
    let known =
        || Body::of(&slot.target).ok_or("its place is not known: no orbit from its elements");
    Ok(slot.target.on.then(known).transpose()?)
}

fn course(
    body: Option<&Body>,
    (from, to): (Epoch, Epoch),
    station: &Station,
) -> Result<Course, String> {
    let length_s = seconds(from, to).max(0.0);
    let steps = (length_s / STEP_S).clamp(MOMENTS[0], MOMENTS[1]).ceil();
    let mut course = Course::default();
    for i in 0..=steps as u32 {
        let utc = from + hifitime::Duration::from_seconds(length_s * f64::from(i) / steps);
        let earth = EarthOrientation::embedded();
        let observer =
            Observer::at(utc, &station.site, earth).map_err(|error| error.to_string())?;
        let sun = observer.sun();
        course.sun_altitude_deg.push(sun.horizontal.altitude_deg());
        let (horizontal, direction, sunlit) = match body {
            None => continue,
            Some(Body::Star(star)) => {
                let place = observer.star(star);
                (place.horizontal, place.direction_gcrs, None)
            }
            Some(Body::Orbit(orbit)) => {
                let geometry = Geometry::at(orbit, &observer).map_err(|error| error.to_string())?;
                (geometry.horizontal, -geometry.to_observer, Some(geometry.sunlit))
            }
        };
        let altitude = horizontal.altitude_deg();
        let horizon = station.horizon.elevation_deg(horizontal.azimuth_deg());
        // What stands at the horizon is lifted; higher up that matters to no plan.
        let lifted = if altitude < 5.0 { HORIZON_REFRACTION_DEG } else { 0.0 };
        course.above_deg.push(altitude + lifted - horizon);
        course.altitude_deg.push(altitude);
        if altitude + lifted <= horizon {
            continue;
        }
        course.sunlit.extend(sunlit);
        course.sun_beside_deg.push(sun.horizontal.altitude_deg());
        course.sun_deg.push(separation_rad(direction, sun.place.direction_gcrs).to_degrees());
        let moon = observer.moon();
        if moon.horizontal.altitude_deg() > 0.0 {
            let apart = separation_rad(direction, moon.place.direction_gcrs).to_degrees();
            course.moon_deg.push(apart);
        }
    }
    Ok(course)
}

/// Checks where a visit's target stands: up, in the dark, lit, away from the Sun and the Moon.
pub(super) fn check_sky(
    about: &str,
    slot: &Slot,
    times: (Epoch, Epoch),
    station: &Station,
    options: &PreflightOptions,
    found: &mut Preflight,
) {
    check_elements(about, slot, times.0, options, found);
    let body = match body(slot) {
        Ok(body) => body,
        Err(error) => return found.error(about, format!("it has no place: {error}")),
    };
    let course = match course(body.as_ref(), times, station) {
        Ok(course) => course,
        Err(error) => return found.error(about, format!("it has no place: {error}")),
    };
    let others = found.findings.len();
    check_dark(about, &course, found);
    if !slot.target.on {
        if found.findings.len() == others {
            let sun = most(&course.sun_altitude_deg);
            found.fine(about, format!("the Sun stands at {sun:.0}° or lower"));
        }
        return;
    }
    check_target(about, &course, slot.target.dec_deg, station, options, found);
    if found.findings.len() == others {
        let (low, high) = (least(&course.altitude_deg), most(&course.altitude_deg));
        found.fine(about, format!("up at {low:.0}° to {high:.0}°, in the dark"));
    }
}

/// Checks a pass of a satellite as a visit of a plan is checked: the Earth's shadow, daylight, how low it stands, the Sun and the Moon beside it.
///
/// # Errors
/// An orbit without a place at these times.
pub fn check_pass(
    orbit: &Orbit,
    times: (Epoch, Epoch),
    station: &Station,
    options: &PreflightOptions,
) -> Result<Vec<PlanFinding>, String> {
    let mut found = Preflight { utc: format_utc(options.now, 3), findings: Vec::new() };
    let name = orbit.name();
    let course = course(Some(&Body::Orbit(Box::new(orbit.clone()))), times, station)?;
    check_dark(&name, &course, &mut found);
    check_target(&name, &course, None, station, options, &mut found);
    Ok(found.findings)
}

fn check_target(
    about: &str,
    course: &Course,
    dec_deg: Option<f64>,
    station: &Station,
    options: &PreflightOptions,
    found: &mut Preflight,
) {
    let highest = most(&course.altitude_deg);
    let up = part(&course.above_deg, |above| above > 0.0);
    if up == 0.0 {
        let mut text =
            format!("it is not up: it stands at a zenith angle of {:.0}° at best", 90.0 - highest);
        if highest > 0.0 {
            let short = -most(&course.above_deg);
            text += &format!(", {short:.0}° or more below the horizon that the station has there");
        }
        let latitude = station.site.geodetic().latitude_deg;
        if let Some(dec) = dec_deg.filter(|dec| (dec - latitude).abs() > 90.6) {
            text = format!(
                "it never rises at {}: declination {dec:+.1}°, latitude {latitude:+.1}°",
                station.name
            );
        }
        found.error(about, text);
    } else if up < 1.0 {
        let text = format!("it is up in {:.0} % of the visit only", 100.0 * up);
        found.warning(about, text);
    } else if least(&course.altitude_deg) < options.low_deg {
        let low = least(&course.altitude_deg);
        let text = match airmass(low) {
            Some(airmass) => format!("it stands as low as {low:.1}° (airmass {airmass:.1})"),
            None => format!("it stands as low as {low:.1}°"),
        };
        found.warning(about, text);
    }
    if !course.sunlit.is_empty() {
        let lit = part(&course.sunlit, |lit| lit > 0.5);
        if lit == 0.0 {
            let of = if up < 1.0 { "as long as it is up" } else { "for the whole visit" };
            found.error(about, format!("it is in the Earth's shadow {of}"));
        } else if lit < 1.0 {
            let dark = 100.0 * (1.0 - lit);
            let of = if up < 1.0 { "the time for which it is up" } else { "the visit" };
            found.warning(about, format!("it is in the Earth's shadow for {dark:.0} % of {of}"));
        }
    }
    let sun = least(&course.sun_deg);
    if sun < options.sun_deg {
        let risen = most(&course.sun_beside_deg) > -0.833;
        let text = format!("it comes within {sun:.0}° of the Sun");
        if risen { found.error(about, text) } else { found.warning(about, text) }
    }
    if let Some(moon) = course.moon_deg.iter().copied().reduce(f64::min)
        && moon < options.moon_deg
    {
        found.warning(about, format!("it comes within {moon:.1}° of the Moon"));
    }
}

fn check_dark(about: &str, course: &Course, found: &mut Preflight) {
    let sun = most(&course.sun_altitude_deg);
    if part(&course.sun_altitude_deg, |sun| sun > -0.833) == 1.0 {
        found.error(about, format!("it is day: the Sun stands at {sun:+.0}°"));
    } else if sun > -0.833 {
        found.warning(about, format!("it is not dark for all of it: the Sun stands at {sun:+.0}°"));
    } else if sun > -12.0 {
        found.warning(about, format!("it is twilight: the Sun stands at {sun:+.0}°"));
    }
}

fn check_elements(
    about: &str,
    slot: &Slot,
    from: Epoch,
    options: &PreflightOptions,
    found: &mut Preflight,
) {
    let Some(text) = slot.target.elements() else { return };
    let sets = elements::parse("the plan's elements", &text);
    let Some(elements) = sets.ok().and_then(|sets| sets.into_iter().next()) else { return };
    let age_s = seconds(elements.epoch, from);
    let days = age_s.abs() / 86_400.0;
    let word = if age_s < 0.0 { "younger than the visit" } else { "old" };
    let text = format!(
        "its elements are {} {word} (epoch {}): fetch new ones",
        span(age_s),
        format_utc(elements.epoch, 0)
    );
    let [warn, useless] = options.elements_days.to_array();
    if days > useless {
        found.error(about, text);
    } else if days > warn {
        found.warning(about, text);
    }
}
