//! Pre-flight: whether a night can be what its plan says, asked before it begins.
//!
//! Each visit is held against the sky, each device's settings against its own ranges, the bytes of the night against the disk. Nothing is set or moved.

use super::clock;
use super::mount::check_mount;
use super::movers::behind;
use super::opener::Opener;
use super::plan::{CameraPlan, CounterPlan, NightClock, Plan, RotatorPlan, WheelPlan};
use super::pointing::{Body, airmass};
use super::saturation::Judge;
use super::schedule::Slot;
use super::sequence::Exposing;
use super::status::free_bytes;
use hifitime::Epoch;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};
use sunglint_drivers::clock::{Deadline, utc_now};
use sunglint_drivers::device::{
    Camera, DeviceError, FilterWheel, Limits, PhotonCounter, RotationStage,
};
use sunglint_ephemeris::geometry::Geometry;
use sunglint_ephemeris::orbit::elements;
use sunglint_formats::session::{ClockState, TargetKind};
use sunglint_formats::time::format_utc;
use sunglint_formats::toml::{Finite, Positive};
use sunglint_numerics::measured::Interval;
use sunglint_radiometry::air::Air;
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::sky::{
    Catalogue, EarthOrientation, Equatorial, Observer, StarError, separation_rad,
};
use sunglint_radiometry::station::{Detector, Station};

/// How bad a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Level {
    /// It was looked at, and is as it should be.
    Fine,
    /// The night can go on, but something of it will be missing or worse than it could be.
    Warning,
    /// A part of the plan cannot be.
    Error,
}

/// Something that was looked at.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlanFinding {
    /// How bad it is.
    pub level: Level,
    /// The visit, the device, or what else it is about.
    pub about: String,
    /// Finding in words, with the numbers and the next step for the user.
    pub text: String,
}

/// Result of the pre-flight of a plan.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Preflight {
    /// When it was looked, UTC.
    pub utc: String,
    /// The findings, in the order of the plan.
    pub findings: Vec<PlanFinding>,
}

/// How a plan is checked.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct PreflightOptions {
    /// The time that counts as now.
    pub now: Epoch,
    /// Where the session will lie: its disk is asked for its room. The plan's `output` where there is none.
    pub folder: Option<PathBuf>,
    /// Whether devices are opened.
    pub open_devices: bool,
    /// How long opening them may take, all at once.
    pub open_within: Duration,
    /// Age at which elements are worth a warning, and at which they are useless, days.
    pub elements_days: Interval,
    /// The altitude below which a target is worth a warning, degrees.
    pub low_deg: f64,
    /// The distance from the Moon below which a target is worth a warning, degrees.
    pub moon_deg: f64,
    /// The distance from the Sun below which nothing is looked at, degrees.
    pub sun_deg: f64,
    /// Width of a star's image at half of its height, arcsec: for what saturates.
    pub seeing_arcsec: f64,
}

impl Default for PreflightOptions {
    /// Devices within 1.5 s; elements of 7 and 60 days; 10° high, 10° from the Moon, 30° from the Sun; images 2.5″ wide.
    fn default() -> Self {
        Self {
            now: utc_now(),
            folder: None,
            open_devices: true,
            open_within: Duration::from_millis(1500),
            elements_days: Interval::new(7.0, 60.0),
            low_deg: 10.0,
            moon_deg: 10.0,
            seeing_arcsec: 2.5,
            sun_deg: 30.0,
        }
    }
}

/// A visit that began so long ago is late, s.
const LATE_S: f64 = 60.0;
/// A night that begins in more than that is far, s.
const FAR_S: f64 = 86_400.0;
/// A longer night is worth a question, and a visit that begins so long after the one before it, s.
const LONG_S: f64 = 172_800.0;
/// Length of a visit without an end, as far as it is looked at, s.
const OPEN_S: f64 = 3600.0;
/// Moments of a visit that are looked at: one each 5 s, but so many at least and at most.
const STEP_S: f64 = 5.0;
const MOMENTS: [f64; 2] = [4.0, 120.0];
/// Mean refraction at the horizon, degrees.
const HORIZON_REFRACTION_DEG: f64 = 34.0 / 60.0;
/// Part of the free room that a night may take without a warning.
const ROOM: f64 = 0.8;
/// Bytes of a frame beside its pixels, and of a counter's row beside its channels' columns, about.
pub(crate) const FRAME_BYTES: f64 = 5760.0;
pub(crate) const ROW_BYTES: f64 = 50.0;
pub(crate) const COLUMN_BYTES: f64 = 14.0;

impl Preflight {
    /// The findings of a level.
    pub fn of(&self, level: Level) -> impl Iterator<Item = &PlanFinding> {
        self.findings.iter().filter(move |finding| finding.level == level)
    }

    /// Whether nothing of the plan is impossible.
    pub fn is_possible(&self) -> bool {
        self.of(Level::Error).next().is_none()
    }

    pub(crate) fn find(&mut self, level: Level, about: &str, text: impl Into<String>) {
        self.findings.push(PlanFinding { level, about: about.to_owned(), text: text.into() });
    }

    pub(crate) fn error(&mut self, about: &str, text: impl Into<String>) {
        self.find(Level::Error, about, text);
    }

    pub(crate) fn warning(&mut self, about: &str, text: impl Into<String>) {
        self.find(Level::Warning, about, text);
    }

    pub(crate) fn fine(&mut self, about: &str, text: impl Into<String>) {
        self.find(Level::Fine, about, text);
    }
}

/// Checks a plan. The opener's devices are opened, asked, and let go; nothing is set.
pub fn preflight(plan: &Plan, opener: &Arc<dyn Opener>, options: &PreflightOptions) -> Preflight {
    let mut found = Preflight { utc: format_utc(options.now, 3), findings: Vec::new() };
    let opened = (options.open_devices && plan.clock != NightClock::Virtual)
        .then(|| Opened::start(plan, opener, options));
    check_clock(plan, &mut found);
    check_times(plan, options, &mut found);
    let mut ended = None;
    for (number, visit) in plan.schedule.visits().iter().enumerate() {
        check_visit(number + 1, visit, ended, plan, options, &mut found);
        ended = Some(visit.to.unwrap_or(visit.from));
    }
    check_mount(plan, opener, options, &mut found);
    check_saturation(plan, options, &mut found);
    check_channels(plan, &mut found);
    check_calibration(plan, &mut found);
    let sensors = opened.map_or_else(Vec::new, |opened| opened.finish(plan, options, &mut found));
    check_output(plan, options, &mut found);
    check_room(plan, &sensors, options, &mut found);
    found
}

fn seconds(from: Epoch, to: Epoch) -> f64 {
    (to - from).to_seconds()
}

/// A length of time for people.
fn span(s: f64) -> String {
    match s.abs() {
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} min", s / 60.0),
        s if s < 172_800.0 => format!("{:.1} h", s / 3600.0),
        s if s < 5e7 => format!("{:.1} days", s / 86_400.0),
        s => format!("{:.1} years", s / 31_557_600.0),
    }
}

fn check_clock(plan: &Plan, found: &mut Preflight) {
    if plan.clock != NightClock::Computer {
        return;
    }
    match clock::measured() {
        ClockState { synchronised: Some(true), offset_s: Some(offset), method, .. } => {
            found.fine("clock", format!("{method}: {:+.3} ms from UTC", 1e3 * offset));
        }
        ClockState { synchronised: Some(true), method, .. } => {
            found.fine("clock", format!("{method} keeps the computer's clock"));
        }
        ClockState { synchronised: None, .. } => found.warning(
            "clock",
            "the clock is not synchronised (no chrony or timesyncd); time stamps may be wrong",
        ),
        ClockState { method, .. } => found.warning(
            "clock",
            format!("{method} says that the clock does not follow UTC; time stamps may be wrong"),
        ),
    }
}

fn check_times(plan: &Plan, options: &PreflightOptions, found: &mut Preflight) {
    let Some(to) = plan.to else {
        found.warning(
            "night",
            "it has no end: it goes on until it is stopped (give `to` or `for_s`)",
        );
        return;
    };
    if plan.clock != NightClock::Computer {
        return;
    }
    let past_s = seconds(to, options.now);
    let ahead_s = seconds(options.now, plan.from);
    if past_s >= 0.0 {
        let text =
            format!("it ended at {}, {} ago: correct its times", format_utc(to, 0), span(past_s));
        found.error("night", text);
        return;
    }
    if ahead_s > FAR_S {
        let text = format!("it begins in {}: cameras wait for it, counters do not", span(ahead_s));
        found.warning("night", text);
    }
    let length_s = seconds(plan.from.max(options.now), to);
    let text = format!("until {}, {} from now", format_utc(to, 0), span(past_s));
    if length_s > LONG_S {
        found.warning("night", format!("{text}: is that right? It is {} long", span(length_s)));
    } else if ahead_s <= FAR_S {
        found.fine("night", text);
    }
}

/// Checks a visit; the one before it ended at a time.
fn check_visit(
    number: usize,
    slot: &Slot,
    ended: Option<Epoch>,
    plan: &Plan,
    options: &PreflightOptions,
    found: &mut Preflight,
) {
    let about = format!("visit {number} ({})", slot.target.name);
    let end = slot.to.or(plan.to);
    let to = end.unwrap_or(slot.from + hifitime::Duration::from_seconds(OPEN_S));
    let before = found.findings.len();
    if plan.clock == NightClock::Computer {
        let late_s = seconds(slot.from, options.now);
        if slot.to.is_some_and(|to| to <= options.now) {
            let text = format!(
                "it is past: it ended at {}, {} ago",
                format_utc(to, 0),
                span(seconds(to, options.now))
            );
            found.error(&about, text);
        } else if late_s > LATE_S {
            let text = format!("it began at {}, {} ago", format_utc(slot.from, 0), span(late_s));
            found.warning(&about, text);
        }
    }
    if let Some(night) = plan.to {
        if slot.from >= night {
            let text = format!("it never begins: the night ends at {}", format_utc(night, 0));
            found.error(&about, text);
            return;
        }
        if slot.to.is_some_and(|to| to > night) {
            found.warning(&about, format!("the night ends before it, at {}", format_utc(night, 0)));
        }
    }
    if let Some(ended) = ended.filter(|ended| seconds(*ended, slot.from) > LONG_S) {
        let gap = span(seconds(ended, slot.from));
        found.warning(&about, format!("it begins {gap} after the visit before it: is that right?"));
    }
    let length_s = seconds(slot.from, to);
    check_exposures(&about, slot.from, to, plan, found);
    for counter in plan.counters.iter().filter(|counter| counter.bin_s.get() > length_s) {
        let (bin_s, name) = (counter.bin_s.get(), &counter.name);
        found.warning(
            &about,
            format!("no bin of {name} lies within it: {bin_s} s in {length_s:.1} s"),
        );
    }
    let kind = slot.target.target_kind;
    if kind == TargetKind::Flat {
        let from = if plan.clock != NightClock::Computer {
            slot.from
        } else {
            slot.from.max(options.now.min(to))
        };
        check_twilight(&about, slot, (from, to), &plan.station, found);
    } else if !matches!(kind, TargetKind::Dark | TargetKind::Bias) {
        // A visit that has begun is looked at from now on.
        let from = if plan.clock != NightClock::Computer {
            slot.from
        } else {
            slot.from.max(options.now.min(to))
        };
        check_sky(&about, slot, (from, to), &plan.station, options, found);
    }
    if found.findings.len() == before {
        found.fine(&about, "no light is needed");
    }
}

/// Exposures of each step of a visit against its length.
fn check_exposures(about: &str, from: Epoch, to: Epoch, plan: &Plan, found: &mut Preflight) {
    let steps = plan.schedule.slots().iter().filter(|slot| slot.from >= from && slot.from < to);
    let mut told: Vec<&str> = Vec::new();
    for step in steps {
        let length_s = seconds(step.from, step.to.unwrap_or(to));
        let kind = Some(step.target.target_kind);
        for camera in plan.cameras.iter() {
            let exposing = Exposing::of(camera, kind, step.step.as_deref());
            let exposure_s = exposing.plan.exposure_s.get();
            let every_s = exposing.plan.interval_s.map_or(exposure_s, Positive::get);
            let frames = f64::from(exposing.frames.unwrap_or(1));
            if told.contains(&camera.name.as_str()) {
                continue;
            }
            let name = &camera.name;
            if exposure_s > length_s {
                told.push(name);
                let text = format!(
                    "no frame of {name} lies within it: {exposure_s} s of exposure in {length_s:.1} s"
                );
                found.warning(about, text);
            } else if (frames - 1.0) * every_s + exposure_s > length_s {
                told.push(name);
                let text = format!(
                    "{frames} frames of {name} take {:.1} s or more, each step has {length_s:.1} s",
                    (frames - 1.0) * every_s + exposure_s
                );
                found.warning(about, text);
            }
        }
    }
}

/// A star that comes so near to the end of a range is worth a word.
const NEAR: f64 = 0.7;

/// Finds the stars of the plan that saturate a channel, at the typical κ of the station.
fn check_saturation(plan: &Plan, options: &PreflightOptions, found: &mut Preflight) {
    let known = plan.station.air_options().and_then(|known| Air::new(&known));
    let air = match known {
        Ok(air) => air,
        Err(error) => {
            return found.warning("saturation", format!("not checked, without air: {error}"));
        }
    };
    let judge = Judge {
        station: &plan.station,
        air: &air,
        orientation: EarthOrientation::embedded(),
        zero: ZeroPoint::default(),
        seeing_arcsec: options.seeing_arcsec,
    };
    let visits = plan.schedule.visits();
    for (number, visit) in visits.iter().enumerate() {
        let target = &visit.target;
        let (Some(ra_deg), Some(dec_deg)) = (target.ra_deg, target.dec_deg) else { continue };
        if target.target_kind != TargetKind::Star {
            continue;
        }
        let place = Equatorial { ra_deg, dec_deg };
        let star = match Catalogue::embedded().find_at(&target.name, place) {
            Ok(star) => star,
            Err(error @ StarError::Elsewhere { .. }) => {
                let about = format!("visit {} ({})", number + 1, target.name);
                found.warning(
                    &about,
                    format!("{error} (`ra_deg` is in degrees, 15 of them an hour)"),
                );
                continue;
            }
            // Stars that only the plan knows have no brightness.
            Err(_) => continue,
        };
        let to = visit.to.or(plan.to).unwrap_or(visit.from);
        let steps = plan.schedule.slots().iter().filter(|s| s.from >= visit.from && s.from < to);
        let mut exposings: Vec<Exposing> = Vec::new();
        for slot in steps {
            for camera in &plan.cameras {
                let kind = Some(TargetKind::Star);
                exposings.push(Exposing::of(camera, kind, slot.step.as_deref()));
            }
        }
        let middle = visit.from + (to - visit.from) * 0.5;
        let Ok(Some(near)) = judge.star(star, middle, &exposings, &plan.counters) else { continue };
        let about = format!("visit {} ({})", number + 1, target.name);
        let range = format!("{:.0} % of its range", 100.0 * near.part);
        if near.part >= 1.0 {
            found.warning(&about, format!("it saturates {}: {range}", near.what));
        } else if near.part > NEAR {
            found.warning(&about, format!("it comes near the end of {}: {range}", near.what));
        }
    }
}

/// Flats of the sky need twilight; a screen may be lit at any time.
fn check_twilight(
    about: &str,
    slot: &Slot,
    span: (Epoch, Epoch),
    station: &Station,
    found: &mut Preflight,
) {
    let Ok(course) = course(slot, span, station) else { return };
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

fn course(slot: &Slot, (from, to): (Epoch, Epoch), station: &Station) -> Result<Course, String> {
    let body = match slot.target.on {
        true => Some(
            Body::of(&slot.target).ok_or("its place is not known: no orbit from its elements")?,
        ),
        false => None,
    };
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
        let (horizontal, direction, sunlit) = match &body {
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

fn check_sky(
    about: &str,
    slot: &Slot,
    times: (Epoch, Epoch),
    station: &Station,
    options: &PreflightOptions,
    found: &mut Preflight,
) {
    check_elements(about, slot, times.0, options, found);
    let course = match course(slot, times, station) {
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
        if let Some(dec) = slot.target.dec_deg.filter(|dec| (dec - latitude).abs() > 90.6) {
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
    if found.findings.len() == others {
        let low = least(&course.altitude_deg);
        found.fine(about, format!("up at {low:.0}° to {highest:.0}°, in the dark"));
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

/// Counters' channels that the station does not have: their counts could not be reduced or calibrated.
fn check_channels(plan: &Plan, found: &mut Preflight) {
    let known: Vec<&str> = plan
        .station
        .channels
        .iter()
        .filter(|channel| matches!(channel.detector, Detector::Counter(_)))
        .map(|channel| channel.name.as_str())
        .collect();
    for counter in &plan.counters {
        let names = counter.channel_names();
        for name in names.iter().filter(|name| !known.contains(&name.as_str())) {
            let has = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
            let text = format!(
                "the station {} has no channel `{name}`: its counts cannot be calibrated (it has {has})",
                plan.station.name
            );
            found.warning(&counter.name, text);
        }
    }
}

/// A longer bias frame holds dark current, s.
const BIAS_S: f64 = 1.0;
/// A flat above this part of the camera's range is worth a word.
const FLAT_PART: f64 = 0.9;
/// The largest count of a frame.
const MOST_ADU: f64 = 65_535.0;
/// A pulse has at most so many volts, about.
const TRIGGER_V: f64 = 5.0;

/// How calibration frames must be like others: exposure (s; of bias frames none), gain, window and binning.
type Like = (Option<f64>, Option<f64>, Option<[u32; 4]>, u32);

/// Dark frames, bias frames and flats: whether they fit what they are for.
fn check_calibration(plan: &Plan, found: &mut Preflight) {
    for camera in &plan.cameras {
        let name = camera.name.as_str();
        let (mut lights, mut darks, mut told): (Vec<Like>, Vec<Like>, Vec<String>) =
            Default::default();
        for slot in plan.schedule.slots() {
            let kind = slot.target.target_kind;
            let set = Exposing::of(camera, Some(kind), slot.step.as_deref());
            let exposure_s = set.plan.exposure_s.get();
            let gain = set.plan.gain.map(Finite::get);
            let like =
                |exposure_s| (exposure_s, gain, set.plan.window_px, set.plan.binning.unwrap_or(1));
            match kind {
                TargetKind::Star | TargetKind::Satellite => lights.push(like(Some(exposure_s))),
                TargetKind::Dark => darks.push(like(Some(exposure_s))),
                TargetKind::Bias => darks.push(like(None)),
                _ => {}
            }
            let mut tell = |level, text: String| {
                if !told.contains(&text) {
                    told.push(text.clone());
                    found.find(level, name, text);
                }
            };
            if kind == TargetKind::Bias && exposure_s > BIAS_S {
                let text = format!(
                    "its bias frames are {exposure_s} s long, and hold dark current: take the camera's shortest exposure"
                );
                tell(Level::Warning, text);
            }
            if let Some(level) = set.level_adu {
                let end = plan.station.camera.as_ref().map(|camera| camera.saturation_adu());
                let end = end.unwrap_or(MOST_ADU).min(MOST_ADU);
                if level > MOST_ADU {
                    let text = format!(
                        "level_adu is {level}, and no frame has more than {MOST_ADU} ADU: its flats would never count"
                    );
                    tell(Level::Error, text);
                } else if level > FLAT_PART * end {
                    let text = format!(
                        "level_adu is {level}, and its pixels are full at {end:.0} ADU: take half of that"
                    );
                    tell(Level::Warning, text);
                }
            }
        }
        let fits = |light: &Like, dark: &Like| {
            let exposure = match (light.0, dark.0) {
                (Some(light), Some(dark)) => (light - dark).abs() <= 0.01 * dark,
                _ => true,
            };
            exposure && (light.1, light.2, light.3) == (dark.1, dark.2, dark.3)
        };
        let mut missing: Vec<String> = lights
            .iter()
            .filter(|light| !darks.iter().any(|dark| fits(light, dark)))
            .map(|(exposure_s, gain, _, binning)| {
                let gain = gain.map_or(String::new(), |gain| format!(", gain {gain}"));
                format!("{} s{gain}, binning {binning}", exposure_s.unwrap_or(0.0))
            })
            .collect();
        missing.dedup();
        if !missing.is_empty() {
            missing.truncate(4);
            found.warning(
                name,
                format!(
                    "no dark or bias frames are planned like its exposures of targets ({}): without a library (`reduce --library`) nothing is subtracted from them",
                    missing.join("; ")
                ),
            );
        }
    }
}

/// Answer of a device about itself.
enum Said {
    Camera { sensor_px: [u32; 2], limits: Option<Limits> },
    Wheel { names: Vec<String>, slots: u32 },
    Rotator { travel_deg: Option<Interval> },
    Counter { channels: Vec<String>, tags: bool },
}

/// Opens a device and asks it.
type Open = dyn FnOnce(&Deadline) -> Result<Said, DeviceError> + Send;

/// Devices on their way.
struct Opened {
    receiver: std::sync::mpsc::Receiver<(String, Result<Said, DeviceError>)>,
    until: Instant,
}

impl Opened {
    fn start(plan: &Plan, opener: &Arc<dyn Opener>, options: &PreflightOptions) -> Self {
        let (sender, receiver) = channel();
        let within = options.open_within;
        let spawn = |name: &str, open: Box<Open>| {
            let (sender, name) = (sender.clone(), name.to_owned());
            let work = move || {
                let said = open(&Deadline::within(within));
                // Whoever asked may have waited long enough.
                let _ = sender.send((name, said));
            };
            // Without a thread the device has said nothing, which is told.
            drop(std::thread::Builder::new().name("preflight".into()).spawn(work));
        };
        for camera in &plan.cameras {
            let (plan, opener) = (camera.clone(), opener.clone());
            let open = move |deadline: &Deadline| opener.camera(&plan, deadline).map(camera_said);
            spawn(&camera.name, Box::new(open));
        }
        for counter in &plan.counters {
            let (plan, opener) = (counter.clone(), opener.clone());
            let open = move |deadline: &Deadline| opener.counter(&plan, deadline).map(counter_said);
            spawn(&counter.name, Box::new(open));
        }
        for wheel in &plan.wheels {
            let (plan, opener) = (wheel.clone(), opener.clone());
            let said = |wheel: Box<dyn FilterWheel>| Said::Wheel {
                names: wheel.names(),
                slots: wheel.slots(),
            };
            let open = move |deadline: &Deadline| opener.wheel(&plan, deadline).map(said);
            spawn(&wheel.name, Box::new(open));
        }
        for rotator in &plan.rotators {
            let (plan, opener) = (rotator.clone(), opener.clone());
            let said =
                |stage: Box<dyn RotationStage>| Said::Rotator { travel_deg: stage.travel_deg() };
            let open = move |deadline: &Deadline| opener.rotator(&plan, deadline).map(said);
            spawn(&rotator.name, Box::new(open));
        }
        // A driver that holds out for a little longer than its deadline is not waited for.
        let until = Instant::now() + within + Duration::from_millis(200);
        Self { receiver, until }
    }

    /// The sensors' sizes by camera, px.
    fn finish(
        self,
        plan: &Plan,
        options: &PreflightOptions,
        found: &mut Preflight,
    ) -> Vec<(String, [u32; 2])> {
        let count =
            plan.cameras.len() + plan.counters.len() + plan.wheels.len() + plan.rotators.len();
        let mut answers = Vec::new();
        while answers.len() < count {
            let left = self.until.saturating_duration_since(Instant::now());
            match self.receiver.recv_timeout(left) {
                Ok(answer) => answers.push(answer),
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => break,
            }
        }
        let mut sensors = Vec::new();
        let mut answer = |name: &str| {
            let place = answers.iter().position(|(device, _)| device == name)?;
            Some(answers.swap_remove(place).1)
        };
        for camera in &plan.cameras {
            let name = &camera.name;
            match answer(name) {
                Some(Ok(Said::Camera { sensor_px, limits })) => {
                    sensors.push((name.clone(), sensor_px));
                    check_camera(camera, sensor_px, limits.as_ref(), found);
                    check_steps(camera, plan, sensor_px, limits.as_ref(), found);
                }
                other => not_there(name, other, options, found),
            }
        }
        for counter in &plan.counters {
            let name = &counter.name;
            match answer(name) {
                Some(Ok(Said::Counter { channels, tags })) => {
                    check_counter(counter, &channels, tags, found);
                }
                other => not_there(name, other, options, found),
            }
        }
        for wheel in &plan.wheels {
            match answer(&wheel.name) {
                Some(Ok(Said::Wheel { names, slots })) => {
                    check_wheel(wheel, plan, &names, slots, found);
                }
                other => not_there(&wheel.name, other, options, found),
            }
        }
        for rotator in &plan.rotators {
            match answer(&rotator.name) {
                Some(Ok(Said::Rotator { travel_deg })) => {
                    check_rotator(rotator, plan, travel_deg, found);
                }
                other => not_there(&rotator.name, other, options, found),
            }
        }
        sensors
    }
}

fn camera_said(camera: Box<dyn Camera>) -> Said {
    Said::Camera { sensor_px: camera.sensor_px(), limits: camera.limits() }
}

fn counter_said(counter: Box<dyn PhotonCounter>) -> Said {
    Said::Counter { channels: counter.channels().to_vec(), tags: counter.streams_tags() }
}

fn not_there(
    name: &str,
    said: Option<Result<Said, DeviceError>>,
    options: &PreflightOptions,
    found: &mut Preflight,
) {
    match said {
        Some(Err(error)) if error.is_permanent_setting() && !error.is_not_served() => {
            found.error(name, error.to_string());
        }
        Some(Err(error)) => {
            let text = format!("{error}; the night tries it again and again");
            found.warning(name, text);
        }
        _ => {
            let s = options.open_within.as_secs_f64();
            found.warning(
                name,
                format!("it did not answer within {s:.1} s; the night tries it again"),
            );
        }
    }
}

/// A value against a range, both in the unit of the value's name.
fn check_value(
    name: &str,
    what: &str,
    value: f64,
    range: Option<Interval>,
    found: &mut Preflight,
) -> bool {
    let Some(Interval { low: least, high: most }) = range.filter(|range| range.low < range.high)
    else {
        return true;
    };
    if (least..=most).contains(&value) {
        return true;
    }
    found.error(name, format!("{what} is {value}, the device takes {least} to {most}"));
    false
}

fn check_camera(
    plan: &CameraPlan,
    sensor_px: [u32; 2],
    limits: Option<&Limits>,
    found: &mut Preflight,
) {
    let name = plan.name.as_str();
    let before = found.findings.len();
    let binning = plan.binning.unwrap_or(1);
    if let Some([x, y, columns, rows]) = plan.window_px {
        for (what, first, size, sensor) in
            [("columns", x, columns, sensor_px[0]), ("rows", y, rows, sensor_px[1])]
        {
            if u64::from(first) + u64::from(size) > u64::from(sensor) || size < binning.max(1) {
                let text = format!(
                    "window_px asks for {size} {what} from {first} on with a binning of {binning}, the sensor has {sensor}"
                );
                found.error(name, text);
            }
            if first % binning.max(1) != 0 {
                let text = format!(
                    "window_px begins at {first} of the {what}, which is no multiple of the binning, {binning}"
                );
                found.error(name, text);
            }
        }
    }
    if let Some(limits) = limits {
        check_value(name, "exposure_s", plan.exposure_s.get(), limits.exposure_s, found);
        match (plan.gain, limits.gain) {
            (Some(gain), None) => {
                found.error(
                    name,
                    format!("gain is {}, but the camera has no gain to set", gain.get()),
                );
            }
            (Some(gain), range) => {
                check_value(name, "gain", gain.get(), range, found);
            }
            (None, _) => {}
        }
        match (plan.temperature_c, limits.temperature_c) {
            (Some(wanted), None) => {
                let wanted = wanted.get();
                let text =
                    format!("temperature_c is {wanted}, but the camera has no cooling to set");
                found.error(name, text);
            }
            (Some(wanted), range) => {
                check_value(name, "temperature_c", wanted.get(), range, found);
            }
            (None, _) => {}
        }
        if let Some(most) = limits.binning.filter(|most| binning > *most) {
            found.error(name, format!("binning is {binning}, the device takes 1 to {most}"));
        }
        if let (Some(filter), false) = (&plan.filter, limits.filters.is_empty())
            && !limits.filters.contains(filter)
        {
            let text = format!("filter is `{filter}`, its wheel has {}", limits.filters.join(", "));
            found.warning(name, text);
        }
    }
    if found.findings.len() == before {
        let [columns, rows] = sensor_px;
        found.fine(name, format!("a sensor of {columns} × {rows} px; its settings are in range"));
    }
}

/// The settings that the steps ask of a camera, each difference once.
fn check_steps(
    camera: &CameraPlan,
    plan: &Plan,
    sensor_px: [u32; 2],
    limits: Option<&Limits>,
    found: &mut Preflight,
) {
    let mut seen = vec![camera.clone()];
    for slot in plan.schedule.slots() {
        let set = Exposing::of(camera, None, slot.step.as_deref()).plan;
        if seen.contains(&set) {
            continue;
        }
        let mut own = Preflight { utc: String::new(), findings: Vec::new() };
        check_camera(&set, sensor_px, limits, &mut own);
        for finding in own.findings.into_iter().filter(|finding| finding.level != Level::Fine) {
            let about = format!("{} at {}", camera.name, slot.target.name);
            found.find(finding.level, &about, finding.text);
        }
        seen.push(set);
    }
}

fn check_wheel(
    wheel: &WheelPlan,
    plan: &Plan,
    names: &[String],
    slots: u32,
    found: &mut Preflight,
) {
    let name = wheel.name.as_str();
    if wheel.filters.len() > slots as usize {
        let text = format!("`filters` names {}, the wheel has {slots} slots", wheel.filters.len());
        found.error(name, text);
        return;
    }
    let names = if wheel.filters.is_empty() { names } else { &wheel.filters };
    let has =
        if names.is_empty() { "no names: give its `filters`".into() } else { names.join(", ") };
    let mut missing: Vec<String> = Vec::new();
    for slot in plan.schedule.slots() {
        for camera in behind(&wheel.cameras, &plan.cameras) {
            let filter = Exposing::of(camera, None, slot.step.as_deref()).plan.filter;
            missing.extend(filter.filter(|filter| !names.contains(filter)));
        }
    }
    missing.sort();
    missing.dedup();
    for filter in &missing {
        found.error(name, format!("filter `{filter}` is asked for, it has {has}"));
    }
    if missing.is_empty() {
        found.fine(name, format!("{slots} slots: {has}"));
    }
}

fn check_rotator(
    rotator: &RotatorPlan,
    plan: &Plan,
    travel_deg: Option<Interval>,
    found: &mut Preflight,
) {
    let name = rotator.name.as_str();
    let asked = plan.schedule.slots().iter().filter_map(|slot| slot.step.as_ref()?.rotator_deg);
    let (low, high) =
        asked.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), a| (l.min(a), h.max(a)));
    let good = low > high
        || [low, high].iter().all(|a| check_value(name, "rotator_deg", *a, travel_deg, found));
    if good {
        found.fine(name, "it is there");
    }
}

fn check_counter(plan: &CounterPlan, known: &[String], tags: bool, found: &mut Preflight) {
    let name = plan.name.as_str();
    let before = found.findings.len();
    for (channel, input) in &plan.channels {
        if !known.iter().any(|known| known == channel || *known == format!("c{input}")) {
            let text = format!(
                "channel `{channel}` is on input {input}, which it lacks: it has {}",
                known.join(", ")
            );
            found.error(name, text);
        }
    }
    for (channel, level) in &plan.trigger_level_v {
        if level.get().abs() > TRIGGER_V {
            let text = format!(
                "trigger_level_v of `{channel}` is {} V: pulses have less than {TRIGGER_V} V",
                level.get()
            );
            found.warning(name, text);
        }
    }
    for (channel, dead_ps) in &plan.dead_time_ps {
        let (dead_s, bin_s) = (1e-12 * *dead_ps as f64, plan.bin_s.get());
        if dead_s < 0.0 || dead_s >= bin_s {
            let text = format!(
                "dead_time_ps of `{channel}` is {dead_ps} ({dead_s} s), expected 0 to less than a bin, {bin_s} s"
            );
            found.error(name, text);
        }
    }
    if plan.raw_tags && !tags {
        found.error(name, "it hands over no time tags: leave out `raw_tags`");
    }
    if found.findings.len() == before {
        found.fine(name, format!("{} channels are there", plan.channels.len()));
    }
}

/// The first folder above that is there.
fn existing(path: &Path) -> Option<PathBuf> {
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    path.ancestors()
        .map(|path| if path.as_os_str().is_empty() { Path::new(".") } else { path })
        .find(|path| path.is_dir())
        .map(Path::to_path_buf)
}

/// Bytes that a camera reads out in a second at most, and the least time for it, s: a fast camera, so that more frames than that do not come.
const FAST_BYTES_S: f64 = 4e8;
const FAST_S: f64 = 0.01;
/// Readout of a slow camera, s.
const SLOW_S: f64 = 2.0;
/// Flats that follow the light are more than those that count, at most so many times.
const FLATS: f64 = 4.0;

/// Bytes of the devices, least and most; raw tags are not among them.
type Bytes = [f64; 2];

/// Bytes of a frame as a camera is set; `None` where the sensor's size is not known.
fn frame_bytes(camera: &CameraPlan, sensors: &[(String, [u32; 2])]) -> Option<f64> {
    let binning = f64::from(camera.binning.unwrap_or(1).max(1));
    let size = camera
        .window_px
        .map(|[_, _, columns, rows]| [columns, rows])
        .or_else(|| sensors.iter().find(|(name, _)| *name == camera.name).map(|(_, size)| *size))?;
    let pixels = f64::from(size[0]) * f64::from(size[1]) / (binning * binning);
    Some(2.0 * pixels + FRAME_BYTES)
}

/// Bytes a second of a camera that takes frames without a number, least and most.
fn camera_bytes_s(set: &CameraPlan, frame: f64) -> Bytes {
    [SLOW_S, FAST_S + frame / FAST_BYTES_S].map(|readout_s| {
        let frame_s = set.exposure_s.get() + readout_s;
        frame / set.interval_s.map_or(frame_s, |interval| interval.get().max(frame_s))
    })
}

/// Bytes that a camera gives between two times, slot by slot. A step with a number of frames is over with them: what it leaves is time for the next that has none.
/// A camera may rest between visits.
fn camera_bytes(
    camera: &CameraPlan,
    plan: &Plan,
    sensors: &[(String, [u32; 2])],
    (from, to): (Epoch, Epoch),
) -> Option<Bytes> {
    let mut times: Vec<Epoch> = plan.schedule.slots().iter().map(|slot| slot.from).collect();
    times.retain(|time| *time > from && *time < to);
    times.insert(0, from);
    times.push(to);
    let mut sum = [0.0; 2];
    // Time that steps left, by the least and the most.
    let mut left_s = [0.0; 2];
    for pair in times.windows(2) {
        let set = plan.schedule.exposing(camera, pair[0]);
        let frame = frame_bytes(&set.plan, sensors)?;
        let bytes_s = camera_bytes_s(&set.plan, frame);
        let mut length_s = seconds(pair[0], pair[1]).max(0.0);
        let rests = camera.rests_between_visits;
        if let Some(idle_to) = plan.schedule.idle_to(pair[0], Some(plan.from), rests) {
            length_s = seconds(idle_to, pair[1]).clamp(0.0, length_s);
            left_s = [0.0; 2];
        }
        for (i, rate) in bytes_s.into_iter().enumerate() {
            let Some(frames) = set.frames.map(f64::from) else {
                sum[i] += rate * (length_s + std::mem::take(&mut left_s[i]));
                continue;
            };
            let more = if set.level_adu.is_some() && i == 1 { FLATS } else { 1.0 };
            let bytes = (frame * frames * more).min(rate * length_s);
            sum[i] += bytes;
            left_s[i] += length_s - bytes / rate;
        }
    }
    Some(sum)
}

/// Where the session will be made, where that folder is not there yet; or why it cannot be.
fn check_output(plan: &Plan, options: &PreflightOptions, found: &mut Preflight) {
    let folder = match &options.folder {
        // The session's own folder, to be made.
        Some(root) => root.parent().unwrap_or(root),
        None => &plan.output,
    };
    let is_here = |path: &Path| path.as_os_str().is_empty();
    if is_here(folder) || folder.is_dir() {
        return;
    }
    let shown = folder.display();
    let above = folder.ancestors().find(|path| !is_here(path) && path.exists());
    let above = above.unwrap_or(Path::new("."));
    if !above.is_dir() {
        let text = format!("{shown} cannot be made: {} is a file", above.display());
        found.error("output", text);
    } else if !may_write(above) {
        let text = format!("{shown} cannot be made: nothing may be written in {}", above.display());
        found.error("output", text);
    } else {
        found.fine("output", format!("the folder {shown} is new: it will be made"));
    }
}

/// Whether this user may make a folder there.
#[cfg(unix)]
fn may_write(folder: &Path) -> bool {
    use nix::unistd::{AccessFlags, access};
    access(folder, AccessFlags::W_OK | AccessFlags::X_OK).is_ok()
}

/// Whether this user may make a folder there.
#[cfg(not(unix))]
fn may_write(folder: &Path) -> bool {
    folder.metadata().is_ok_and(|about| !about.permissions().readonly())
}

fn check_room(
    plan: &Plan,
    sensors: &[(String, [u32; 2])],
    options: &PreflightOptions,
    found: &mut Preflight,
) {
    let folder = options.folder.as_deref().unwrap_or(&plan.output);
    let Some(free) = existing(folder).and_then(|folder| free_bytes(&folder)) else { return };
    let free = free as f64;
    let rows_s: f64 = plan
        .counters
        .iter()
        .map(|counter| {
            let row = ROW_BYTES + 2.0 * COLUMN_BYTES * counter.channels.len() as f64;
            row / counter.bin_s.get()
        })
        .sum();
    let tags = if plan.counters.iter().any(|counter| counter.raw_tags) {
        "; raw tags come on top, 16 bytes a photon"
    } else {
        ""
    };
    let from = if plan.clock != NightClock::Computer { plan.from } else { options.now };
    let Some(to) = plan.to else {
        // As the cameras are set after the last visit that has an end.
        let last = plan.schedule.slots().last().map_or(from, |slot| slot.from.max(from));
        let mut rate = rows_s;
        for camera in &plan.cameras {
            let set = plan.schedule.exposing(camera, last).plan;
            let Some(frame) = frame_bytes(&set, sensors) else { return };
            rate += camera_bytes_s(&set, frame)[1];
        }
        let hours = free / rate.max(1e-9) / 3600.0;
        found.fine("disk", format!("room for {hours:.0} h at up to {:.2} MB/s{tags}", 1e-6 * rate));
        return;
    };
    let rows = rows_s * seconds(from, to).max(0.0);
    let mut bytes = [rows; 2];
    for camera in &plan.cameras {
        let Some(own) = camera_bytes(camera, plan, sensors, (from, to)) else { return };
        bytes = [0, 1].map(|i| bytes[i] + own[i]);
    }
    let [least, most, room] =
        [bytes[0], bytes[1], free].map(|bytes| format!("{:.3}", 1e-9 * bytes));
    let text = format!(
        "the night takes {least} to {most} GB, as fast as its cameras read out (2 s or next to nothing); {room} GB are free{tags}"
    );
    if bytes[0] > free {
        found.error("disk", text);
    } else if bytes[1] > ROOM * free {
        found.warning("disk", text);
    } else {
        found.fine("disk", text);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Catalogue;
    use sunglint_formats::time::parse_utc;

    const STATION: &str = "station = \"ufo\"\n";
    const DEVICES: &str = "[[camera]]\nname = \"cam\"\ndevice = \"sim-camera\"\nexposure_s = 0.3\n";
    const ISS: &str = "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927\n\
                       2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537\n";
    /// Synthetic satellites: one over the north of the Stuttgart of this test in the evening, one that passes near its zenith.
    const MADE: &str = "1 99101U 24001A   26332.50000000  .00000000  00000-0  10000-4 0    17\n\
                        2 99101  51.6400  20.0000 0007000  30.0000   0.0000 15.50000000    12\n\
                        1 99003U 24001A   26332.50000000  .00000000  00000-0  10000-4 0    18\n\
                        2 99003  98.6000 328.0000 0010000  90.0000  60.0000 14.27000000    10\n";

    /// The findings of a plan at 2026-11-23T20:00:00Z: a November night at Stuttgart.
    fn findings(name: &str, top: &str, devices: &str, visits: &str) -> Preflight {
        let folder =
            std::env::temp_dir().join(format!("sunglint-preflight-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("iss.tle"), ISS).unwrap();
        std::fs::write(folder.join("made.tle"), MADE).unwrap();
        let path = folder.join("night.toml");
        std::fs::write(&path, format!("{STATION}{top}\n{devices}\n{visits}")).unwrap();
        let plan = Plan::read(&path).unwrap();
        let opener: Arc<dyn Opener> = Arc::new(Catalogue);
        let now = parse_utc("2026-11-23T20:00:00Z").unwrap();
        let options = PreflightOptions { now, ..PreflightOptions::default() };
        let begun = Instant::now();
        let found = preflight(&plan, &opener, &options);
        assert!(begun.elapsed() < Duration::from_secs(2), "{:?}", begun.elapsed());
        std::fs::remove_dir_all(&folder).unwrap();
        found
    }

    const NIGHT: &str = "from = \"2026-11-23T20:05:00Z\"\nto = \"2026-11-23T23:00:00Z\"";

    fn visit(target: &str, from: &str) -> String {
        format!("[[visit]]\n{target}\nfrom = \"{from}\"\nfor_s = 600\n")
    }

    /// Truth: what is wrong with each plan is put in by hand. Canopus (declination −52.7°) never rises at Stuttgart (latitude 48.7°); Arcturus has set on a
    /// November evening; the elements are of 2008; the simulated camera has 160 × 120 px.
    #[test]
    fn impossible_plans_are_named() {
        let late = "2026-11-23T20:10:00Z";
        let gain = format!("{DEVICES}gain = 1e9\n");
        let window = format!("{DEVICES}window_px = [100, 100, 200, 200]\n");
        let long = DEVICES.replace("0.3", "1e7");
        let channel = "[[counter]]\nname = \"tagger\"\ndevice = \"sim-timetagger\"\nchannels = { nosuch = 1 }\nbin_s = 0.1\n";
        let bright = DEVICES.replace("0.3", "30");
        let cases: [(&str, &str, String, &str); 10] = [
            // Vega is 10^4 times brighter than a star of V 10; 30 s at a 43 cm telescope.
            ("saturated", &bright, visit("star = \"Capella\"", late), "it saturates"),
            ("canopus", DEVICES, visit("star = \"Canopus\"", late), "never rises"),
            ("arcturus", DEVICES, visit("star = \"Arcturus\"", late), "not up"),
            ("past", DEVICES, visit("star = \"Vega\"", "2020-11-18T20:00:00Z"), "is past"),
            ("day", DEVICES, visit("star = \"Capella\"", "2026-11-24T11:00:00Z"), "day"),
            ("elements", DEVICES, visit("tle = \"iss.tle\"", late), "elements are"),
            ("gain", &gain, visit("star = \"Capella\"", late), "gain is"),
            ("window", &window, visit("star = \"Capella\"", late), "window_px"),
            ("exposure", &long, visit("star = \"Capella\"", late), "exposure_s"),
            ("channel", channel, visit("star = \"Capella\"", late), "no channel `nosuch`"),
        ];
        for (name, devices, visits, expected) in cases {
            // Each with its own beginning: without one it is the present, whatever the day of the test.
            let top = match name {
                "day" => "from = \"2026-11-23T20:05:00Z\"\nto = \"2026-11-24T12:00:00Z\"",
                "past" => "from = \"2020-11-18T19:00:00Z\"\nto = \"2026-11-23T23:00:00Z\"",
                _ => NIGHT,
            };
            let found = findings(name, top, devices, &visits);
            let named = |level| found.of(level).any(|finding| finding.text.contains(expected));
            let level = if ["channel", "saturated"].contains(&name) {
                Level::Warning
            } else {
                Level::Error
            };
            assert!(named(level), "{name}: {found:?}");
        }
    }

    /// Truth: by hand: each of these plans has one fault that the devices, or the frames, would show too late; its words name it. The sensor has 160 × 120 px.
    #[test]
    fn faults_that_a_night_would_show_too_late_are_named() {
        let late = "2026-11-23T20:10:00Z";
        let star = visit("star = \"Capella\"", late);
        let off = |keys: &str| format!("{star}[[visit]]\n{keys}\n");
        let binned = format!("{DEVICES}binning = 2\nwindow_px = [11, 10, 60, 60]\n");
        let plain = format!("{DEVICES}binning = 2\nwindow_px = [10, 10, 60, 60]\n");
        let step = off(
            "off = \"bias\"\nexposure_s = 0.001\nfor_s = 9\nbinning = 2\nwindow_px = [11, 10, 60, 60]",
        );
        let tagger = |keys: &str| {
            format!(
                "[[counter]]\nname = \"tagger\"\ndevice = \"sim-timetagger\"\nchannels = {{ spcm = 1 }}\nbin_s = 0.1\n{keys}\n"
            )
        };
        let level = |adu: u32| off(&format!("off = \"flat\"\nfor_s = 60\nlevel_adu = {adu}"));
        let (bad, worse) = (Level::Warning, Level::Error);
        let cases: [(&str, String, String, Level, &str); 9] = [
            ("odd", binned, star.clone(), worse, "no multiple of the binning"),
            ("odd-step", DEVICES.into(), step, worse, "no multiple of the binning"),
            ("flat", DEVICES.into(), level(70_000), worse, "no frame has more than 65535"),
            ("bright", DEVICES.into(), level(65_000), bad, "its pixels are full"),
            (
                "bias",
                DEVICES.into(),
                off("off = \"bias\"\nexposure_s = 10\nfor_s = 60"),
                bad,
                "hold dark current",
            ),
            ("darkless", DEVICES.into(), star.clone(), bad, "no dark or bias frames are planned"),
            (
                "other",
                DEVICES.into(),
                off("off = \"dark\"\nexposure_s = 5\nfor_s = 60"),
                bad,
                "(0.3 s, binning 1)",
            ),
            (
                "dead",
                tagger("dead_time_ps = { spcm = 1_000_000_000_000_000 }"),
                star.clone(),
                worse,
                "less than a bin",
            ),
            ("trigger", tagger("trigger_level_v = { spcm = 50 }"), star.clone(), bad, "50 V"),
        ];
        for (name, devices, visits, level, expected) in cases {
            let found = findings(name, NIGHT, &devices, &visits);
            let named = found.of(level).any(|finding| finding.text.contains(expected));
            assert!(named, "{name}: {found:?}");
        }
        // What fits raises none of them.
        let dark = off("off = \"dark\"\nfor_s = 60");
        let found = findings("fits", NIGHT, &plain, &dark);
        let quiet = ["multiple", "dark or bias"];
        let said = found.findings.iter().any(|f| quiet.iter().any(|word| f.text.contains(word)));
        assert!(!said, "{found:?}");
    }

    /// Truth: by hand: what each plan gets wrong. Right ascension in hours puts Vega (279.2°) at 18.6°; the made satellite is lit only while it is below the horizon (that the same visit cut to its pass is wholly in
    /// shadow is the second case); a mask of 60° hides what stands at 50°; a year is wrong in one visit, and in the end of the night.
    #[test]
    fn mistakes_of_planners_are_named() {
        let vega = "name = \"Vega\"\nra_deg = 18.6156\ndec_deg = 38.78";
        let early = "2026-11-23T20:10:00Z";
        let capella = visit("star = \"Capella\"", early);
        let next_year = visit("star = \"Capella\"", "2027-11-23T20:30:00Z");
        let made = |from: &str, to: &str| {
            format!(
                "[[visit]]\ntle = \"made.tle\"\nobject = \"99101\"\nfrom = \"2026-11-29T{from}Z\"\nto = \"2026-11-29T{to}Z\"\n"
            )
        };
        let week = "from = \"2026-11-23T20:05:00Z\"\nto = \"2026-11-30T00:00:00Z\"";
        let cases: [(&str, &str, String, Level, &str); 6] = [
            ("hours", NIGHT, visit(vega, early), Level::Warning, "from the catalogue's 279."),
            (
                "lit-below",
                week,
                made("23:00:00", "23:50:00"),
                Level::Error,
                "shadow as long as it is up",
            ),
            (
                "dark",
                week,
                made("23:43:30", "23:49:00"),
                Level::Error,
                "shadow for the whole visit",
            ),
            (
                "gap",
                "",
                capella.clone() + &next_year,
                Level::Warning,
                "365.0 days after the visit before it",
            ),
            (
                "years",
                "from = \"2026-11-23T20:05:00Z\"\nto = \"2062-11-23T23:00:00Z\"",
                capella.clone(),
                Level::Warning,
                "36.0 years long",
            ),
            (
                "far",
                "from = \"2026-11-26T20:05:00Z\"\nto = \"2026-11-26T21:00:00Z\"",
                visit("star = \"Capella\"", "2026-11-26T20:10:00Z"),
                Level::Warning,
                "begins in 3.0 days: cameras wait",
            ),
        ];
        for (name, top, visits, level, expected) in cases {
            let found = findings(name, top, DEVICES, &visits);
            let named = found.of(level).any(|finding| finding.text.contains(expected));
            assert!(named, "{name}: {found:?}");
        }
    }

    /// A mount that does not answer is the one that the plan tells of. Truth: by hand: Capella culminates at Stuttgart at 0:25 UTC; 1 °/s about the vertical is too slow for a pass near the zenith, of
    /// 1.6 °/s across the sky.
    #[test]
    fn a_mount_that_is_off_is_held_against_the_plan() {
        let mount = |keys: &str| {
            format!(
                "{DEVICES}[mount]\ndevice = \"indi-telescope:localhost:1/T\"\ntrust_clock = true\n{keys}\n"
            )
        };
        let star = "[[visit]]\nstar = \"Capella\"\nfrom = \"2026-11-23T22:00:00Z\"\nto = \"2026-11-24T02:00:00Z\"\n";
        let pass = "[[visit]]\ntle = \"made.tle\"\nobject = \"99003\"\nfrom = \"2026-11-29T16:06:00Z\"\nto = \"2026-11-29T16:13:00Z\"\n";
        let found = findings("german", "", &mount("axes = \"equatorial\"\ngerman = true"), star);
        let turns = found.of(Level::Warning).any(|f| f.text.contains("the mount turns over"));
        assert!(turns, "{found:?}");
        let found = findings("slow", "", &mount("axes = \"altaz\"\nmost_rate_deg_s = 1"), pass);
        let keyhole = found.findings.iter().any(|f| {
            f.level != Level::Fine
                && f.about.starts_with("visit 1")
                && f.text.contains("cannot follow")
        });
        assert!(keyhole, "{found:?}");
        let found = findings("unknown", "", &mount(""), pass);
        assert!(!found.findings.iter().any(|f| f.text.contains("can follow it")), "{found:?}");
    }

    /// Truth: by hand: 200 bias frames of 160 × 120 px, 16 bits and a header of two blocks are 8.8 MB, and no more however short they are; after them the camera takes a frame of
    /// 0.3 s each 0.31 to 2.3 s for the rest of three hours.
    #[test]
    fn the_forecast_counts_what_each_step_takes() {
        let bias = "[[visit]]\noff = \"bias\"\nexposure_s = 0.001\nframes = 200\nfrom = \"2026-11-23T20:10:00Z\"\nto = \"2026-11-23T23:00:00Z\"\n";
        let found = findings("forecast", NIGHT, DEVICES, bias);
        let disk = found.findings.iter().find(|finding| finding.about == "disk").unwrap();
        let frame = 160.0 * 120.0 * 2.0 + FRAME_BYTES;
        // From 5 s before the night to the step the camera is set as for it, and takes frames without a number; a camera that rests does so for 5 s only.
        let told = |before_s: f64| {
            let [least, most] = [SLOW_S, FAST_S + frame / FAST_BYTES_S]
                .map(|readout_s| 1e-9 * frame * (200.0 + before_s / (0.001 + readout_s)));
            format!("the night takes {least:.3} to {most:.3} GB")
        };
        let text = told(305.0);
        assert!(disk.text.contains(&text), "{text}: {}", disk.text);
        assert_ne!(disk.level, Level::Error);
        let rests = format!("{DEVICES}rests_between_visits = true\n");
        let found = findings("forecast-rests", NIGHT, &rests, bias);
        let disk = found.findings.iter().find(|finding| finding.about == "disk").unwrap();
        assert!(disk.text.contains(&told(5.0)), "{}: {}", told(5.0), disk.text);
    }

    /// Truth: stars that culminate high at Stuttgart on a November night (right ascension 1 h to 7 h, declination above 10°), in the dark.
    #[test]
    fn sound_plans_raise_no_error() {
        let stars = ["Capella", "Aldebaran", "Hamal", "Mirfak", "Algol", "Alcyone", "Elnath"];
        for (number, star) in stars.iter().enumerate() {
            for from in ["2026-11-23T20:10:00Z", "2026-11-23T21:30:00Z", "2026-11-23T22:30:00Z"] {
                let visits = visit(&format!("star = \"{star}\""), from)
                    + "[[visit]]\noff = \"dark\"\nfor_s = 60\n";
                let found = findings(&format!("sound{number}"), NIGHT, DEVICES, &visits);
                assert!(found.is_possible(), "{star}: {found:?}");
            }
        }
    }
}
