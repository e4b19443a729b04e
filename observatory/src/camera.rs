//! A camera's thread: frames from start to start, set as each visit asks.

use super::focus::curve::Curve;
use super::focus::run::{self as focus, Seen};
use super::mount::{Aim, Ready, Sights, Waiting};
use super::movers::{Before, FrameFilter};
use super::plan::CameraPlan;
use super::pointing::Pointing;
use super::schedule::{CameraWish, Schedule};
use super::sequence::Exposing;
use super::worker::{READY, SOON, Worker};
use hifitime::Epoch;
use serde::Serialize;
use std::collections::HashMap;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::clock_offset_s;
use sunglint_drivers::device::{
    CLOCKS_S, Camera, DeviceError, HOST_DIFFERENCE, Limits, Value, Window,
};
use sunglint_formats::Frame;
use sunglint_formats::session::{
    FILTER_DOUBTED, FLAT_LEVEL, FRAME_NUMBER, Target, TargetKind, What, is_near_level,
};
use sunglint_formats::toml::{Finite, Positive};
use sunglint_numerics::measured::Interval;

/// Settings of a camera as an event tells them: those that are planned.
#[derive(Serialize)]
struct Settings<'a> {
    exposure_s: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    window_px: Option<[u32; 4]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    binning: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    gain: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    filter: Option<&'a str>,
}

/// Result of a run through focus as an event tells it.
#[derive(Serialize)]
struct Focused {
    stands_at: Option<i64>,
    curve: Option<Curve>,
}

/// Where the focuser stands after a run that was ended.
#[derive(Serialize)]
struct FocusEnded {
    ended: &'static str,
}

/// How much longer than its exposure and the longest readout so far a frame may take.
const LATE: Duration = Duration::from_secs(5);
/// Readout of a camera that has given no frame.
const READOUT: Duration = Duration::from_secs(10);
/// A difference between clocks that is no step, s.
const STEP_S: f64 = super::clock::STEP_S;

/// Shortest and longest exposure of flats that follow the light, s.
const FLAT_S: [f64; 2] = [1e-3, 60.0];
/// How often a camera that has nothing to do looks at the schedule.
const LOOK: Duration = Duration::from_millis(20);
/// How long a camera waits for a wheel or rotator that is lost, before it takes frames all the same.
const LOST: Duration = Duration::from_secs(5);
/// A sensor is as cold as was asked within this, °C.
const COLD_C: f64 = 1.0;
/// How often a camera that waits for its cooler asks it, how long it waits at most, and after how long without progress it waits no more.
const COOLER: Duration = Duration::from_secs(2);
const COOLS: Duration = Duration::from_secs(900);
const STUCK: Duration = Duration::from_secs(60);
/// Progress of a cooler, °C.
const COOLER_C: f64 = 0.2;
/// Time for the readout of a frame, before one came, that a cooler leaves, s.
const READOUT_S: f64 = 2.0;
/// How often a camera that waits for the mount looks at it.
const AIM: Duration = Duration::from_millis(100);

/// A camera at work.
#[derive(Debug)]
pub struct CameraWork {
    plan: CameraPlan,
    pointing: Pointing,
    /// The wheel and the rotators that it waits for.
    before: Before,
    /// The last frame's number.
    number: u64,
    /// The longest time from the end of an exposure to its frame so far.
    readout: Option<Duration>,
    /// The frame type that the camera was told.
    told: Option<&'static str>,
    /// The camera's own setting.
    set: Option<CameraPlan>,
    /// Frames of each step so far.
    taken: HashMap<u32, u32>,
    /// The step whose settings the camera cannot have.
    barred: Option<u32>,
    /// Exposures of flats, s, by filter: as the light asked for last.
    flat_s: HashMap<Option<String>, f64>,
    /// The mount that it waits for, and what it remembers of it.
    aim: Option<Arc<Aim>>,
    waiting: Waiting,
    /// Where its frames go for the mount.
    sights: Option<Arc<Sights>>,
    /// The calibration step whose temperature is settled, and the wait for it.
    settled: Option<(Option<Epoch>, Option<u32>)>,
    cooling: Option<Cooling>,
    /// Whether it was told that the clock of the camera's computer is wrong.
    clock_told: bool,
}

/// A wait for the cooler.
#[derive(Debug, Clone, Copy)]
struct Cooling {
    /// When it began, and when the sensor was nearest to its temperature.
    begun: Duration,
    nearest_at: Duration,
    /// How far it was then, °C.
    nearest_c: f64,
}

/// The next act of a camera.
#[derive(Debug, Clone, PartialEq)]
struct Now {
    exposing: Exposing,
    /// Number of the step, within one.
    step: Option<u32>,
    /// When it ends.
    to: Option<Epoch>,
    /// Whether there is nothing to do until then.
    idle: bool,
    /// Whether the camera takes frames in another way then.
    changes: bool,
    /// Angle of the rotators, degrees.
    angle_deg: Option<f64>,
    /// The visit's target.
    target: Option<Target>,
    /// Beginning of the visit.
    begun: Option<Epoch>,
}

impl CameraWork {
    /// A camera as planned.
    pub fn new(plan: CameraPlan, pointing: Pointing, before: Before) -> Self {
        Self {
            plan,
            pointing,
            before,
            number: 0,
            readout: None,
            told: None,
            set: None,
            taken: HashMap::new(),
            barred: None,
            flat_s: HashMap::new(),
            aim: None,
            waiting: Waiting::default(),
            sights: None,
            settled: None,
            cooling: None,
            clock_told: false,
        }
    }

    /// Waits for a mount, and shows it its frames where `sights` are given.
    pub fn behind_mount(&mut self, aim: Arc<Aim>, sights: Option<Arc<Sights>>) {
        (self.aim, self.sights) = (Some(aim), sights);
    }

    /// Goes on after the frame of a number; of the step in its course it has so many frames.
    pub fn go_on(&mut self, number: u64, taken: Option<(u32, u32)>) {
        self.number = number;
        self.taken.extend(taken);
    }

    /// Opens the camera and takes frames until the night is over.
    pub fn run(&mut self, worker: &mut Worker) -> Result<(), DeviceError> {
        let mut camera = worker.opener.camera(&self.plan, &worker.within(READY))?;
        let base = self.plan.clone();
        self.set = None;
        self.prepare(camera.as_mut(), &base, worker).map_err(|error| worker.setting(error))?;
        worker.opened(camera.as_mut())?;
        if let Some(sights) = &self.sights {
            sights.sensor(camera.sensor_px());
        }
        self.told = None;
        let mut grid = Grid::default();
        let mut works = false;
        let mut before: Option<Now> = None;
        while !worker.is_over() {
            if let Some(plan) = worker.schedule.takes_focus(&self.plan.name) {
                let done = self.focus(camera.as_mut(), &plan, worker);
                worker.schedule.focus_done();
                done?;
                grid = Grid::default();
            }
            let now = self.now(worker);
            if let Some(before) = before.replace(now.clone()).filter(|b| b.step != now.step) {
                self.tell_short(&before, worker);
                grid = Grid::default();
            }
            if self.rests(&now, worker) {
                self.rest(now.to, worker);
                continue;
            }
            match self.aims(&now, worker) {
                Ready::Record => {}
                Ready::Wait => {
                    let _ = worker.within(Duration::MAX).sleep(AIM);
                    continue;
                }
                Ready::Look => {
                    self.look(camera.as_mut(), &now, worker)?;
                    continue;
                }
            }
            if !self.is_set(camera.as_mut(), &now, worker)? {
                continue;
            }
            if !self.is_ready(&now, worker) {
                continue;
            }
            if !self.is_cold(camera.as_mut(), &now, worker)? {
                continue;
            }
            if let Some(interval) = now.exposing.plan.interval_s.map(Positive::get) {
                let turn = grid.wait(worker, interval, now.to);
                if self.now(worker) != now {
                    continue;
                }
                let Some(turn) = turn else { continue };
                grid.begun = Some(turn);
            }
            self.tell_type(camera.as_mut(), now.exposing.frame_type, worker)?;
            let exposure_s = self.exposure_s(&now);
            let readout = self.readout.unwrap_or(READOUT);
            let most = seconds(exposure_s).saturating_add(readout).saturating_add(LATE);
            let busy = seconds(exposure_s).saturating_add(self.readout.unwrap_or_default());
            let (asked, asked_at) = (worker.clock.utc(), worker.clock.clock.now());
            let turns = self.before.turns();
            let slot = worker.schedule.get().slot(asked).cloned();
            let mut frame = match camera.expose(exposure_s, &worker.within_of(most, busy)) {
                Err(error @ DeviceError::NotOurs { .. }) => {
                    self.refuse(&error.to_string(), worker);
                    // Whoever took it may have set it, too.
                    (self.set, self.told) = (None, None);
                    continue;
                }
                Err(error) if error.is_permanent_setting() && self.is_wished(worker) => {
                    self.forget_wish(&error, worker);
                    continue;
                }
                taken => taken?,
            };
            let took = worker.clock.clock.now().saturating_sub(asked_at);
            let late = took.saturating_sub(seconds(exposure_s));
            self.readout = Some(self.readout.map_or(late, |longest| longest.max(late)));
            if worker.clock.is_live() {
                without_step(&mut frame, asked, clock_offset_s());
            }
            if !works || worker.lost_at.is_some() {
                works = true;
                worker.works();
            }
            self.tell_clock(&frame, worker);
            let filter = self.before.filter_over([asked_at, worker.clock.clock.now()]);
            if filter == FrameFilter::Moved || self.before.turns() != turns {
                self.refuse("the wheel or the rotator before it moved during the exposure", worker);
                continue;
            }
            if let Some(sights) =
                self.sights.as_ref().filter(|_| now.exposing.frame_type == "light")
            {
                sights.see(&frame, camera.sensor_px());
            }
            let counts = self.follow_light(&now, exposure_s, &frame, camera.limits());
            let target = slot.map(|slot| slot.target);
            let taken = Taken { exposing: &now.exposing, target, filter, asked, took };
            self.hand_over(frame, taken, worker);
            if let Some(step) = now.step.filter(|_| counts) {
                *self.taken.entry(step).or_default() += 1;
            }
        }
        if let Some(before) = before {
            self.tell_short(&before, worker);
        }
        Ok(())
    }

    /// Whether the telescope is on the visit's target.
    fn aims(&mut self, now: &Now, worker: &Worker) -> Ready {
        let Some(aim) = &self.aim else { return Ready::Record };
        let target = now.target.as_ref().zip(now.begun);
        self.waiting.decide(aim, &self.plan.name, target, worker.clock.utc())
    }

    /// Takes a frame of the whole sensor for the mount, which looks for its target. It is not recorded.
    fn look(
        &mut self,
        camera: &mut dyn Camera,
        now: &Now,
        worker: &mut Worker,
    ) -> Result<(), DeviceError> {
        let mut wide = now.clone();
        let whole = &mut wide.exposing.plan;
        if whole.binning.is_none_or(|binning| binning == 1) {
            (whole.window_px, whole.binning) = (None, None);
        }
        if !self.is_set(camera, &wide, worker)? {
            return Ok(());
        }
        let whole = wide.exposing.plan;
        self.tell_type(camera, now.exposing.frame_type, worker)?;
        let exposure_s = whole.exposure_s.get();
        let readout = self.readout.unwrap_or(READOUT);
        let most = seconds(exposure_s).saturating_add(readout).saturating_add(LATE);
        let busy = seconds(exposure_s).saturating_add(self.readout.unwrap_or_default());
        let (asked, begun) = (worker.clock.utc(), worker.clock.clock.now());
        match camera.expose(exposure_s, &worker.within_of(most, busy)) {
            Ok(mut frame) => {
                if worker.clock.is_live() {
                    without_step(&mut frame, asked, clock_offset_s());
                }
                let middle = frame.start + hifitime::Duration::from_seconds(0.5 * frame.exposure_s);
                // A frame of the future is of a clock that is wrong: where the mount stood then is not known.
                if let Some(sights) = self.sights.as_ref().filter(|_| middle <= worker.clock.utc())
                {
                    sights.see(&frame, camera.sensor_px());
                }
                worker.status.look(&worker.name, &frame);
                worker.disk.look(&worker.name, frame);
            }
            Err(error @ DeviceError::NotOurs { .. }) => {
                self.refuse(&error.to_string(), worker);
                (self.set, self.told) = (None, None);
            }
            Err(error) if error.is_permanent_setting() && self.is_wished(worker) => {
                self.forget_wish(&error, worker);
                return Ok(());
            }
            Err(error) => return Err(error),
        }
        // As often as the visit asks for frames.
        let took = worker.clock.clock.now().saturating_sub(begun);
        let left = whole.interval_s.map(|interval| seconds(interval.get()).saturating_sub(took));
        let _ = worker.within(Duration::MAX).sleep(left.unwrap_or_default());
        Ok(())
    }

    /// Goes through the focus, as a person asked: with frames of the whole sensor in the visit's filter, gain and exposure, which are not recorded. What came of it is in the log.
    fn focus(
        &mut self,
        camera: &mut dyn Camera,
        before: &Schedule,
        worker: &mut Worker,
    ) -> Result<(), DeviceError> {
        let Some(plan) = self.plan.focuser.clone() else { return Ok(()) };
        let about = self.plan.name.clone();
        let failed = |worker: &Worker, error: String| {
            worker.status.say(format!("{about}: {error}"));
            worker.disk.event(worker.clock.utc(), What::Error { about: about.clone(), error });
        };
        if self.aim.as_ref().is_some_and(|aim| !aim.follows()) {
            failed(worker, "no focus: the mount follows no target, and stars would trail".into());
            return Ok(());
        }
        let mut focuser = match worker.opener.focuser(&plan, &worker.within(READY)) {
            Ok(focuser) => focuser,
            Err(error) => {
                failed(worker, format!("its focuser: {error}"));
                return Ok(());
            }
        };
        let begun_at = worker.clock.utc();
        let mut exposing = before.exposing(&self.plan, begun_at);
        worker.schedule.wished(&self.plan.name).over(&mut exposing);
        let mut wide = exposing.plan;
        if wide.binning.is_none_or(|binning| binning == 1) {
            (wide.window_px, wide.binning) = (None, None);
        }
        let ready = match self.prepare(camera, &wide, worker) {
            Ok(()) => self.tell_type(camera, "light", worker),
            refused => refused,
        };
        match ready {
            Err(error) if error.is_permanent_setting() => {
                failed(worker, format!("no focus: {error}"));
                (self.set, self.told) = (None, None);
                return Ok(());
            }
            ready => ready?,
        }
        let said = |worker: &Worker, fields: serde_json::Result<serde_json::Value>| {
            let Ok(serde_json::Value::Object(mut fields)) = fields else { return };
            fields.insert("camera".into(), about.clone().into());
            worker.disk.event(worker.clock.utc(), What::Other { kind: "focus".into(), fields });
        };
        let target = before.at(begun_at).cloned();
        let goes_on = || {
            let same = before.at(worker.clock.utc()) == target.as_ref();
            same && !worker.is_over() && worker.schedule.focus_goes_on()
        };
        let mut each = |seen: &Seen| {
            let radius = seen.sharpness.map_or("no star".into(), |s| format!("{:.2} px", s.hfr_px));
            worker.status.say(format!("{about}: focuser at {}: {radius}", seen.position));
            said(worker, serde_json::to_value(seen));
            if goes_on() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        };
        // The mount goes on to follow by them, and the page shows them.
        let sensor_px = camera.sensor_px();
        let mut show = |mut frame: Frame, asked: Epoch| {
            if worker.clock.is_live() {
                without_step(&mut frame, asked, clock_offset_s());
            }
            let middle = frame.start + hifitime::Duration::from_seconds(0.5 * frame.exposure_s);
            if let Some(sights) = self.sights.as_ref().filter(|_| middle <= worker.clock.utc()) {
                sights.see(&frame, sensor_px);
            }
            worker.status.look(&worker.name, &frame);
            worker.disk.look(&worker.name, frame);
        };
        let options = plan.options(wide.exposure_s.get());
        let (clock, cancel) = (&worker.clock, &worker.cancel);
        let focuser = focuser.as_mut();
        let run = focus::run_showing(camera, focuser, clock, cancel, options, &mut each, &mut show);
        match run {
            Ok(run) => {
                let at = run.stands_at.unwrap_or_default();
                let best = run.curve.map_or(String::new(), |curve| {
                    format!(", ± {:.0} steps (1σ), {:.2} px", curve.sigma, curve.least_px)
                });
                worker.status.say(format!("{about}: in focus at {at}{best}"));
                let focused = Focused { stands_at: run.stands_at, curve: run.curve };
                said(worker, serde_json::to_value(focused));
            }
            Err(run) => {
                // Whoever took the camera meanwhile may have set it.
                (self.set, self.told) = (None, None);
                let back = match run.returned {
                    true => "the focuser stands where it stood",
                    false => "where the focuser stands is not known",
                };
                if goes_on() {
                    failed(worker, format!("no focus: {run}; {back}"));
                } else {
                    // A person, or the end of the visit: no fault.
                    worker.status.say(format!("{about}: focusing was ended; {back}"));
                    said(worker, serde_json::to_value(FocusEnded { ended: back }));
                }
            }
        }
        Ok(())
    }

    /// What the schedule asks for now.
    fn now(&self, worker: &Worker) -> Now {
        let (schedule, utc) = (worker.schedule.get(), worker.clock.utc());
        let mut exposing = schedule.exposing(&self.plan, utc);
        let wish = worker.schedule.wished(&self.plan.name);
        wish.over(&mut exposing);
        let slot = schedule.slot(utc);
        let planned = slot.filter(|slot| slot.target.target_kind != TargetKind::None);
        let step = planned.and_then(|slot| slot.step.as_ref()).map(|step| step.number);
        let rests = self.plan.rests_between_visits;
        let idle_to = schedule.idle_to(utc, worker.from, rests);
        let idle_to = idle_to.filter(|_| wish == CameraWish::default());
        let to = idle_to.or(slot.and_then(|slot| slot.to));
        let changes = to.is_some_and(|to| {
            let mut next = schedule.exposing(&self.plan, to);
            wish.over(&mut next);
            next.plan != exposing.plan || next.frame_type != exposing.frame_type
        });
        let setting = schedule.setting(utc).and_then(|slot| slot.step.as_ref());
        let angle_deg = setting.and_then(|step| step.rotator_deg);
        let target = planned.map(|slot| slot.target.clone());
        let begun = schedule.visits().iter().rev().map(|v| v.from).find(|from| *from <= utc);
        Now { exposing, step, to, idle: idle_to.is_some(), changes, angle_deg, target, begun }
    }

    /// Whether it takes no frame now: it has nothing to do between visits, has all of the step, cannot be set for it, or the next would not end before something else begins.
    fn rests(&self, now: &Now, worker: &Worker) -> bool {
        if now.idle || now.step.is_some() && now.step == self.barred {
            return true;
        }
        let taken = now.step.and_then(|step| self.taken.get(&step)).copied().unwrap_or(0);
        if let (Some(step), Some(frames)) = (now.step, now.exposing.frames)
            && taken >= frames
        {
            worker.schedule.finish(&self.plan.name, step);
            return true;
        }
        let sharp = now.changes || now.exposing.frames.is_some();
        let ends = worker.clock.utc() + hifitime::Duration::from_seconds(self.exposure_s(now));
        sharp && now.to.is_some_and(|to| ends > to)
    }

    /// Waits: with a live clock only a moment, because the schedule may change.
    fn rest(&self, to: Option<Epoch>, worker: &Worker) {
        let until = [to, worker.end].into_iter().flatten().min();
        let left = until.map_or(Duration::MAX, |until| worker.clock.until(until));
        let wait = if worker.clock.is_live() || until.is_none() { left.min(LOOK) } else { left };
        // Cut short by Ctrl-C alone. At least a moment: the end may lie within the clock's last digit.
        let _ = worker.within(Duration::MAX).sleep(wait.max(Duration::from_micros(1)));
    }

    /// Sets the camera as the schedule asks; false where it cannot be set so.
    fn is_set(
        &mut self,
        camera: &mut dyn Camera,
        now: &Now,
        worker: &mut Worker,
    ) -> Result<bool, DeviceError> {
        match self.prepare(camera, &now.exposing.plan, worker) {
            Ok(()) => Ok(true),
            // A wish that the camera refuses costs no night: it is forgotten.
            Err(error) if error.is_permanent_setting() && self.is_wished(worker) => {
                self.forget_wish(&error, worker);
                Ok(false)
            }
            Err(error) if error.is_permanent_setting() && now.step.is_some() => {
                self.barred = now.step;
                let error = format!("no frames in step {}: {error}", now.step.unwrap_or(0));
                worker.status.say(format!("{}: {error}", worker.name));
                let about = worker.name.clone();
                worker.status.empty_step(format!("{about}: {error}"));
                worker.disk.event(worker.clock.utc(), What::Error { about, error });
                Ok(false)
            }
            Err(error) => Err(worker.setting(error)),
        }
    }

    /// Whether a person wants another exposure or gain than the plan.
    fn is_wished(&self, worker: &Worker) -> bool {
        worker.schedule.wished(&self.plan.name) != CameraWish::default()
    }

    /// Goes back to the plan's exposure and gain after the camera refused a person's wish, and says so.
    fn forget_wish(&self, error: &DeviceError, worker: &mut Worker) {
        worker.schedule.wish(&self.plan.name, CameraWish::default());
        let error = format!("exposure and gain are as planned again: {error}");
        worker.status.say(format!("{}: {error}", worker.name));
        let about = worker.name.clone();
        worker.disk.event(worker.clock.utc(), What::Error { about, error });
    }

    /// Waits for the wheel and the rotators; false where the schedule went on meanwhile.
    fn is_ready(&self, now: &Now, worker: &Worker) -> bool {
        let begun = worker.clock.clock.now();
        loop {
            match self.before.is_ready(&now.exposing, now.angle_deg) {
                Some(true) => return true,
                None if worker.clock.clock.now().saturating_sub(begun) >= LOST => return true,
                _ => {}
            }
            self.rest(now.to, worker);
            if worker.is_over() || self.now(worker) != *now || self.rests(now, worker) {
                return false;
            }
        }
    }

    /// The next frame's exposure, s.
    fn exposure_s(&self, now: &Now) -> f64 {
        let planned = now.exposing.plan.exposure_s.get();
        match now.exposing.level_adu {
            Some(_) => *self.flat_s.get(&now.exposing.plan.filter).unwrap_or(&planned),
            None => planned,
        }
    }

    /// Brings the exposure of flats to their level. True for a frame that counts: of a flat one that is near its level.
    fn follow_light(
        &mut self,
        now: &Now,
        exposure_s: f64,
        frame: &Frame,
        limits: Option<Limits>,
    ) -> bool {
        let Some(level) = now.exposing.level_adu else { return true };
        let Some(median) = frame.median_adu() else { return false };
        let [least, most] =
            limits.and_then(|limits| limits.exposure_s).map_or(FLAT_S, Interval::to_array);
        let (least, most) = (least.max(FLAT_S[0]), most.min(FLAT_S[1]));
        let wanted = exposure_s * (level / median.max(1.0)).clamp(0.1, 10.0);
        let next = wanted.max(least).min(most);
        self.flat_s.insert(now.exposing.plan.filter.clone(), next);
        is_near_level(median, level)
    }

    /// A step that ended with fewer frames than it should have.
    fn tell_short(&self, before: &Now, worker: &Worker) {
        let (Some(step), Some(frames)) = (before.step, before.exposing.frames) else { return };
        let taken = self.taken.get(&step).copied().unwrap_or(0);
        if taken < frames {
            let (about, error) =
                (worker.name.clone(), format!("{taken} of {frames} frames in step {step}"));
            worker.status.say(format!("{about}: {error}"));
            if taken == 0 {
                let name = before.target.as_ref().map_or("none", |target| target.name.as_str());
                worker.status.empty_step(format!("{about} ({name}): {error}"));
            }
            worker.disk.event(worker.clock.utc(), What::Error { about, error });
        }
    }

    /// Whether the sensor is as cold as dark and bias frames must be. The cooler is waited for as long as its frames then still find their time.
    fn is_cold(
        &mut self,
        camera: &mut dyn Camera,
        now: &Now,
        worker: &Worker,
    ) -> Result<bool, DeviceError> {
        let key = (now.begun, now.step);
        let calibrates = matches!(now.exposing.frame_type, "dark" | "bias");
        let wanted = now.exposing.plan.temperature_c.filter(|_| calibrates).map(Finite::get);
        let Some(wanted_c) = wanted.filter(|_| self.settled != Some(key)) else { return Ok(true) };
        let said = camera.settings(&worker.within(SOON))?;
        let at_c = said.into_iter().find_map(|setting| match setting.value {
            Value::Number(at_c) if setting.name == "temperature_c" => Some(at_c),
            _ => None,
        });
        let Some(at_c) = at_c else {
            self.settled = Some(key);
            return Ok(true);
        };
        let (off_c, clock) = ((at_c - wanted_c).abs(), worker.clock.clock.now());
        if off_c <= COLD_C {
            if self.cooling.take().is_some() {
                worker.status.say(format!("{}: the sensor is at {at_c:.1} °C", worker.name));
            }
            self.settled = Some(key);
            return Ok(true);
        }
        let first = self.cooling.is_none();
        let cooling = self.cooling.get_or_insert(Cooling {
            begun: clock,
            nearest_at: clock,
            nearest_c: off_c,
        });
        if off_c < cooling.nearest_c - COOLER_C {
            (cooling.nearest_at, cooling.nearest_c) = (clock, off_c);
        }
        let stuck = clock.saturating_sub(cooling.nearest_at) >= STUCK;
        let long = clock.saturating_sub(cooling.begun) >= COOLS;
        let left_s = now.to.map(|to| (to - worker.clock.utc()).to_seconds() - self.needs_s(now));
        if stuck || long || left_s.is_some_and(|left_s| left_s <= 0.0) {
            (self.settled, self.cooling) = (Some(key), None);
            let about = worker.name.clone();
            let error = format!(
                "the sensor is at {at_c:.1} °C, asked were {wanted_c} °C: {} frames are taken all the same",
                now.exposing.frame_type
            );
            worker.status.say(format!("{about}: {error}"));
            worker.disk.event(worker.clock.utc(), What::Error { about, error });
            return Ok(true);
        }
        if first {
            worker.status.say(format!(
                "{}: {} frames wait for the cooler: the sensor is at {at_c:.1} °C, asked were {wanted_c} °C",
                worker.name, now.exposing.frame_type
            ));
        }
        let wait = left_s.map_or(COOLER, |left_s| COOLER.min(seconds(left_s)));
        let _ = worker.within(Duration::MAX).sleep(wait);
        Ok(false)
    }

    /// Time that the frames of a step take, s; half of its visit where it has no number of them.
    fn needs_s(&self, now: &Now) -> f64 {
        let readout_s = self.readout.map_or(READOUT_S, |readout| readout.as_secs_f64());
        let frame_s = self.exposure_s(now) + readout_s;
        let every_s = now.exposing.plan.interval_s.map_or(frame_s, |i| i.get().max(frame_s));
        let taken = now.step.and_then(|step| self.taken.get(&step)).copied().unwrap_or(0);
        match (now.exposing.frames, now.begun.zip(now.to)) {
            (Some(frames), _) => every_s * f64::from(frames.saturating_sub(taken)),
            (None, Some((begun, to))) => 0.5 * (to - begun).to_seconds(),
            (None, None) => 0.0,
        }
    }

    /// Says once that the clock of the camera's computer is wrong: its frames then have the time of this one.
    fn tell_clock(&mut self, frame: &Frame, worker: &Worker) {
        // A step of this computer's own clock is told as such.
        let stepped_s = clock_offset_s();
        let wrong = |s: &f64| s.abs() > CLOCKS_S && (s - stepped_s).abs() > CLOCKS_S;
        let Some(apart_s) = frame.header.real(HOST_DIFFERENCE).filter(wrong) else {
            self.clock_told = false;
            return;
        };
        if std::mem::replace(&mut self.clock_told, true) {
            return;
        }
        let about = worker.name.clone();
        let error = format!(
            "the clock of its computer is {apart_s:+.1} s from this one's: its frames have the time of this computer (TIMRDER says how exactly); set its clock"
        );
        worker.status.say(format!("{about}: {error}"));
        worker.disk.event(worker.clock.utc(), What::Error { about, error });
    }

    /// Tells the camera what the next frame is taken for, so that its driver closes the shutter for a dark one.
    fn tell_type(
        &mut self,
        camera: &mut dyn Camera,
        wanted: &'static str,
        worker: &Worker,
    ) -> Result<(), DeviceError> {
        const NAME: &str = "frame_type";
        if self.told == Some(wanted) || !camera.own_settings().iter().any(|(n, _)| *n == NAME) {
            return Ok(());
        }
        camera.set_own(NAME, wanted, &worker.within(SOON))?;
        self.told = Some(wanted);
        Ok(())
    }

    /// A frame that is not what was asked for: counted, and told now and then.
    fn refuse(&self, error: &str, worker: &Worker) {
        let frames = worker.status.refused(&worker.name, error);
        if frames <= 16 || frames.is_power_of_two() {
            let (device, error) = (worker.name.clone(), error.to_owned());
            let what = What::FramesRefused { device, frames, error };
            worker.disk.event(worker.clock.utc(), what);
        }
    }

    /// Sets the camera: all of it at first, then what differs. A window that a visit set is opened again where the next has none.
    fn prepare(
        &mut self,
        camera: &mut dyn Camera,
        plan: &CameraPlan,
        worker: &Worker,
    ) -> Result<(), DeviceError> {
        if self.set.as_ref() == Some(plan) {
            return Ok(());
        }
        let before = self.set.take();
        let window = |plan: &CameraPlan| (plan.window_px, plan.binning);
        let was = before.as_ref().map(window).unwrap_or_default();
        if window(plan) != was || (before.is_none() && plan.window_px.is_some()) {
            let [columns, rows] = camera.sensor_px();
            let [x, y, columns, rows] = plan.window_px.unwrap_or([0, 0, columns, rows]);
            let binning = [plan.binning.unwrap_or(1); 2];
            let window = Window { origin_px: [x, y], size_px: [columns, rows], binning };
            camera.set_window(window, &worker.within(SOON))?;
        }
        let differs = |of: &dyn Fn(&CameraPlan) -> Option<f64>| {
            of(plan).filter(|value| before.as_ref().and_then(of) != Some(*value))
        };
        if let Some(gain) = differs(&|plan| plan.gain.map(Finite::get)) {
            camera.set_gain(gain, &worker.within(SOON))?;
        }
        if let Some(temperature) = differs(&|plan| plan.temperature_c.map(Finite::get)) {
            camera.set_temperature_c(temperature, &worker.within(SOON))?;
        }
        if before.is_some() {
            self.tell_settings(plan, worker);
        }
        self.set = Some(plan.clone());
        Ok(())
    }

    fn tell_settings(&self, plan: &CameraPlan, worker: &Worker) {
        let all = Settings {
            exposure_s: plan.exposure_s.get(),
            window_px: plan.window_px,
            binning: plan.binning,
            gain: plan.gain.map(Finite::get),
            filter: plan.filter.as_deref(),
        };
        let Ok(serde_json::Value::Object(settings)) = serde_json::to_value(all) else { return };
        let device = worker.name.clone();
        worker.disk.event(worker.clock.utc(), What::Set { device, settings });
    }

    /// Puts the filter, the cooler's and the converter's settings into a header: as the device says them, else as planned.
    fn say_settings(&self, plan: &CameraPlan, filter: FrameFilter, frame: &mut Frame) {
        match filter {
            FrameFilter::NoWheel => {}
            FrameFilter::Stood(name) => {
                frame.header.set("FILTER", name.as_str(), "where the wheel stood");
            }
            // Such a frame is refused.
            FrameFilter::Lost | FrameFilter::Moved => {
                frame.header.set("FILTER", "unknown", "the wheel was lost");
            }
            FrameFilter::Doubted(last) => {
                let name = plan.filter.clone().or(last).unwrap_or_else(|| "unknown".into());
                frame.header.set("FILTER", name.as_str(), "as planned, or where the wheel stood");
                if let Some(planned) = &plan.filter {
                    frame.header.set("FILTPLAN", planned.as_str(), "planned");
                }
                let comment = "nobody saw the wheel after the frame";
                frame.header.set(FILTER_DOUBTED, true, comment);
            }
        }
        if let Some(angle_deg) = self.before.angle_deg() {
            frame.header.set("ROTATANG", angle_deg, "deg, where the rotator stood");
        }
        if let Some(planned) = &plan.filter {
            match frame.header.text("FILTER").map(str::to_owned) {
                Some(wheel) if wheel.trim() == planned => {}
                Some(_) => frame.header.set(
                    "FILTPLAN",
                    planned.as_str(),
                    "planned; the wheel stood at FILTER",
                ),
                None => {
                    frame.header.set("FILTER", planned.as_str(), "as planned; no wheel said it")
                }
            }
        }
        if let Some(temperature) = plan.temperature_c {
            frame.header.set("SET-TEMP", temperature.get(), "deg C, asked of the cooler");
        }
        if let Some(gain) = plan.gain.filter(|_| frame.header.get("GAIN").is_none()) {
            frame.header.set("GAIN", gain.get(), "in the camera's own steps");
        }
        // In another gain the station's number says nothing.
        if frame.gain_e_per_adu.is_none() && plan.gain.is_none() {
            frame.gain_e_per_adu = self.pointing.gain_e_per_adu();
        }
    }

    fn hand_over(&mut self, mut frame: Frame, taken: Taken<'_>, worker: &Worker) {
        let Taken { exposing, target, filter, asked, took } = taken;
        let half = hifitime::Duration::from_seconds(0.5 * frame.exposure_s);
        let middle: Epoch = frame.start + half;
        if worker.opener.keeps_numbers() {
            let number = frame.header.integer(FRAME_NUMBER).and_then(|n| u64::try_from(n).ok());
            self.number = number.unwrap_or(self.number + 1).max(self.number + 1);
        } else {
            self.number += 1;
            frame.header.set(
                "CAMERA",
                self.plan.name.as_str(),
                "the camera's name in this session",
            );
            self.say_settings(&exposing.plan, filter, &mut frame);
            let doubt_s = begin_doubt_s(frame.start, frame.exposure_s, asked, took.as_secs_f64());
            // Twice the standard uncertainty holds all of it.
            let comment = "s, times may be off by twice that";
            frame.header.set("TIMSYER", 0.5 * doubt_s, comment);
            if let Some(level) = exposing.level_adu {
                frame.header.set(FLAT_LEVEL, level, "ADU, median that was asked for");
            }
            // A recording has times of its own.
            let target = match worker.clock.is_live() {
                true => target,
                false => worker.schedule.get().at(middle).cloned(),
            };
            self.pointing.describe(target.as_ref(), middle, self.told, &mut frame);
        }
        worker.status.frame(&worker.name, self.number, &frame);
        worker.reached(frame.start + half * 2);
        worker.disk.frame(&worker.name, self.number, frame);
    }
}

/// How a frame was taken.
struct Taken<'a> {
    exposing: &'a Exposing,
    /// The target of the slot in which it was asked for.
    target: Option<Target>,
    filter: FrameFilter,
    /// When the host asked for it, and how long it took.
    asked: Epoch,
    took: Duration,
}

/// Largest error of the begin that a frame says, s, by the host's clock: the exposure began after it was asked for, at `asked`, and early enough to end before the frame was
/// here, `took_s` later.
///
/// ```
/// use hifitime::{Epoch, Unit};
/// use sunglint_observatory::begin_doubt_s;
///
/// let asked = Epoch::from_gregorian_utc_at_midnight(2026, 11, 28);
/// // A frame of 1 s that came after 1.4 s and says that it began at once may have begun 0.4 s later.
/// assert!((begin_doubt_s(asked, 1.0, asked, 1.4) - 0.4).abs() < 1e-9);
/// // One that says 0.3 s before it was asked for is off by 0.3 to 0.7 s.
/// assert!((begin_doubt_s(asked - 0.3 * Unit::Second, 1.0, asked, 1.4) - 0.7).abs() < 1e-9);
/// ```
pub fn begin_doubt_s(said: Epoch, exposure_s: f64, asked: Epoch, took_s: f64) -> f64 {
    let said_s = (said - asked).to_seconds();
    let latest_s = (took_s - exposure_s).max(0.0);
    said_s.abs().max((latest_s - said_s).abs())
}

/// Takes a step of the computer's clock, s, out of a frame's time: its driver stamps with that clock. Of a driver on another computer,
/// whose clock did not step, the time is left. The header says it.
fn without_step(frame: &mut Frame, asked: Epoch, step_s: f64) {
    let ahead_s = (frame.start - asked).to_seconds();
    if step_s.abs() <= STEP_S || (ahead_s - step_s).abs() >= ahead_s.abs() {
        return;
    }
    frame.start -= hifitime::Duration::from_seconds(step_s);
    let comment = "s, step of the driver's clock, taken off DATE-OBS";
    frame.header.set("CLKSTEP", step_s, comment);
}

/// Turns of frames at an even distance.
#[derive(Debug, Clone, Copy, Default)]
struct Grid {
    /// When the first of them was, and the number of the last one.
    begun: Option<(Duration, u64)>,
}

impl Grid {
    /// Waits for the next turn, turns that have passed are left out. It is taken only when it is put into `begun`: a turn at the very time at which another
    /// stay begins belongs to that one. `None` where the night or the stay (`to`) ended before it.
    fn wait(&self, worker: &Worker, interval_s: f64, to: Option<Epoch>) -> Option<(Duration, u64)> {
        let now = worker.clock.clock.now();
        let Some((first, last)) = self.begun else { return Some((now, 0)) };
        let passed_s = now.saturating_sub(first).as_secs_f64();
        // A turn that is a thousandth late is still this one.
        let next = (last + 1).max((passed_s / interval_s - 1e-3).ceil() as u64);
        let mut wait = first.saturating_add(seconds(next as f64 * interval_s)).saturating_sub(now);
        let mut ends = false;
        if let Some(end) = [worker.end, to].into_iter().flatten().min() {
            let left = worker.clock.until(end);
            ends = left < wait;
            wait = wait.min(left);
        }
        // Cut short by Ctrl-C alone, which the caller sees.
        let _ = worker.within(Duration::MAX).sleep(wait);
        (!ends && !worker.is_over()).then_some((first, next))
    }
}

/// Seconds that a plan gives: above zero.
pub(crate) fn seconds(s: f64) -> Duration {
    Duration::try_from_secs_f64(s).unwrap_or(Duration::MAX)
}
