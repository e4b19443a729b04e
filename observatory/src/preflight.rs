//! Pre-flight: whether a night can be what its plan says, asked before it begins.
//!
//! Each visit is held against the sky, each device's settings against its own ranges, the bytes of the night against the disk. Nothing is set or moved.

mod sky;
#[cfg(test)]
mod tests;

use super::clock;
use super::mount::check_mount;
use super::movers::behind;
use super::opener::Opener;
use super::plan::{CameraPlan, CounterPlan, NightClock, Plan, RotatorPlan, WheelPlan};
use super::saturation::Judge;
use super::schedule::Slot;
use super::sequence::Exposing;
use super::status::free_bytes;
use hifitime::Epoch;
use serde::Serialize;
pub use sky::check_pass;
use sky::{check_sky, check_twilight};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};
use sunglint_drivers::clock::{Deadline, utc_now};
use sunglint_drivers::device::{
    Camera, DeviceError, FilterWheel, Focuser, Limits, PhotonCounter, RotationStage,
};
use sunglint_formats::session::{ClockState, TargetKind};
use sunglint_formats::time::format_utc;
use sunglint_formats::toml::{Finite, Positive};
use sunglint_numerics::measured::Interval;
use sunglint_radiometry::air::Air;
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::sky::{Catalogue, EarthOrientation, Equatorial, StarError};
use sunglint_radiometry::station::Detector;

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
        let Ok(all) = judge.star(star, middle, &exposings, &plan.counters) else { continue };
        let about = format!("visit {} ({})", number + 1, target.name);
        let named = |range: std::ops::Range<f64>| {
            let within = all.iter().filter(|near| range.contains(&near.part));
            let each = within.map(|near| format!("{}: {:.0} %", near.what, 100.0 * near.part));
            each.collect::<Vec<String>>().join(", ")
        };
        let (over, close) = (named(1.0..f64::INFINITY), named(NEAR..1.0));
        if !over.is_empty() {
            found.warning(&about, format!("it saturates {over} of its range"));
        }
        if !close.is_empty() {
            found.warning(&about, format!("it comes near the end of {close} of its range"));
        }
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
    Focuser { range: [i64; 2] },
}

/// Name of a camera's focuser in what is found.
fn focuser_of(camera: &CameraPlan) -> String {
    format!("{} focuser", camera.name)
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
        for camera in &plan.cameras {
            let Some(plan) = camera.focuser.clone() else { continue };
            let opener = opener.clone();
            let said = |focuser: Box<dyn Focuser>| Said::Focuser { range: focuser.range() };
            let open = move |deadline: &Deadline| opener.focuser(&plan, deadline).map(said);
            spawn(&focuser_of(camera), Box::new(open));
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
        let focusers = plan.cameras.iter().filter(|camera| camera.focuser.is_some());
        let count = plan.cameras.len()
            + focusers.clone().count()
            + plan.counters.len()
            + plan.wheels.len()
            + plan.rotators.len();
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
        for (camera, focuser) in focusers.filter_map(|c| Some((c, c.focuser.as_ref()?))) {
            let name = focuser_of(camera);
            match answer(&name) {
                Some(Ok(Said::Focuser { range: [least, most] })) => {
                    let options = focuser.options(camera.exposure_s.get());
                    // At most 99 points of a million steps.
                    let way = options.step * (options.points as i64 - 1) + options.overshoot;
                    if way > most.saturating_sub(least) {
                        let text = format!(
                            "a run through the focus takes {way} steps with its overshoot, the focuser has {least} to {most}: smaller `step`"
                        );
                        found.error(&name, text);
                    }
                }
                Some(Err(error)) if !error.is_permanent_setting() => {
                    found.warning(
                        &name,
                        format!("{error}; it is opened anew when the page asks for focus"),
                    );
                }
                other => not_there(&name, other, options, found),
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
