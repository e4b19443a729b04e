//! Live state of a night as other threads see it, and the queue of what they ask of it.
//!
//! Capture never waits here: it hands over bins and events by a queue that drops what finds no room, and a frame by a lock that it only tries. The night's own
//! thread empties the queue twenty times a second. Readers ask for what came [since](LiveState::since) they asked last, so that any number of them, at any
//! speed, costs nothing but their own answers.

use super::mount::MountPlan;
use super::night::Night;
use super::schedule::Slot;
use super::status::{Snapshot, Status};
use glam::DVec2;
use hifitime::Epoch;
use serde::Serialize;
use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use sunglint_drivers::clock::Cancel;
use sunglint_formats::session::{ClockState, Event, TargetKind, What};
use sunglint_formats::time::format_utc;
use sunglint_formats::toml::{Finite, Positive};
use sunglint_formats::{CountRecord, Frame};
use sunglint_radiometry::sky::AzimuthAltitude;
use sunglint_radiometry::station::Station;

/// Bunches of bins and events that wait at most.
const WAITING: usize = 4096;
/// Shortest time of a point of the counts, s.
const POINT_S: f64 = 0.1;
/// Points of each counter that are kept: ten minutes at ten a second.
const POINTS: usize = 6000;
/// Points of the last stretch of empty sky that are kept.
const OFF_POINTS: usize = 600;
/// Points in one answer at most: all that are kept, so that a page that is loaded again has them.
const ANSWER: usize = POINTS;
/// Length of a point of the whole night, s.
const COARSE_S: f64 = 5.0;
/// Points of the whole night that are kept for each counter: those of a day.
const COARSE: usize = 17_280;
/// Events that are kept.
const EVENTS: usize = 500;
/// Commands that wait at most.
const COMMANDS: usize = 16;
/// Time between two looks for a start.
const LOOK: std::time::Duration = std::time::Duration::from_millis(50);
/// Longest note, characters.
pub const LONGEST_NOTE: usize = 500;

/// Command to a running night.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Control {
    /// A night that waits begins.
    Start,
    /// What is recorded from now on belongs to no visit, until `Resume`. Capture goes on.
    Pause,
    /// The plan goes on as it stands at that time.
    Resume,
    /// The present visit ends now. The next one begins now, unless it is a satellite's, which keeps its time.
    Skip,
    /// The night ends in good order.
    Stop,
    /// A line of text for the log.
    Note(String),
    /// Exposure and gain of the next frames of the sky that a camera takes, until it is told otherwise; without either: as planned.
    Expose {
        /// Name of the camera.
        camera: String,
        /// Exposure, s.
        exposure_s: Option<Positive>,
        /// Gain in the camera's own steps.
        gain: Option<Finite>,
    },
    /// A camera goes through its focus; meanwhile what is recorded belongs to no visit. `Resume` ends it early.
    Focus {
        /// Name of the camera.
        camera: String,
    },
    /// The present visit, or else the last one, once more, whole and from now on.
    Repeat,
    /// A light of a frame is the target that the mount follows.
    Lock(Click),
    /// The target is kept at a place of the frame from now on.
    Keep(Click),
    /// The telescope looks by so much beside, arcsec: to the right and up in the frames of the mount's camera; without one along the growing axes.
    Jog(DVec2),
    /// The mount stands until it is told to follow.
    Halt,
    /// The mount is parked until it is told to follow.
    Park,
    /// The mount follows the plan again.
    Follow,
}

/// A place in a frame that a person pointed at.
#[derive(Debug, Clone, PartialEq)]
pub struct Click {
    /// Name of the camera.
    pub camera: String,
    /// Start of the frame's exposure.
    pub start: Epoch,
    /// Column and row; the first pixel's middle is 0, 0.
    pub place_px: DVec2,
}

impl Click {
    fn text(&self) -> String {
        let ([column, row], utc) = (self.place_px.to_array(), format_utc(self.start, 3));
        format!("{}: column {column:.1}, row {row:.1} of the frame of {utc}", self.camera)
    }
}

impl Control {
    /// Name of the command in the log.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Start => "start",
            Self::Pause => "pause",
            Self::Resume => "resume",
            Self::Skip => "skip",
            Self::Stop => "stop",
            Self::Note(_) => "note",
            Self::Expose { .. } => "expose",
            Self::Focus { .. } => "focus",
            Self::Repeat => "repeat",
            Self::Lock(_) => "lock",
            Self::Keep(_) => "keep",
            Self::Jog(_) => "jog",
            Self::Halt => "halt",
            Self::Park => "park",
            Self::Follow => "follow",
        }
    }

    /// The rest of its line in the log.
    pub fn text(&self) -> String {
        match self {
            Self::Note(text) => text.clone(),
            Self::Focus { camera } => camera.clone(),
            Self::Expose { camera, exposure_s: None, gain: None } => {
                format!("{camera}: as planned")
            }
            Self::Expose { camera, exposure_s, gain } => {
                let exposure = exposure_s.map(|exposure| format!("{} s", exposure.get()));
                let gain = gain.map(|gain| format!("gain {}", gain.get()));
                let parts: Vec<String> = exposure.into_iter().chain(gain).collect();
                format!("{camera}: {}", parts.join(", "))
            }
            Self::Lock(click) | Self::Keep(click) => click.text(),
            Self::Jog(DVec2 { x: first, y: second }) => format!("{first:+.0}″, {second:+.0}″"),
            _ => String::new(),
        }
    }
}

/// Why a command was not taken.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ControlError {
    /// Too many wait, or nobody takes them.
    #[error("the night takes no command at the moment: {COMMANDS} wait already; try again")]
    Busy,
    /// The night has ended.
    #[error("the night has ended")]
    Ended,
    /// The night cannot do that.
    #[error("{0}")]
    Refused(String),
}

/// Answer to a command, with a sentence for the person who gave it.
pub type ControlAnswer = Result<String, ControlError>;

/// A command on its way.
#[derive(Debug)]
pub(crate) struct Asked {
    pub control: Control,
    answer: SyncSender<ControlAnswer>,
}

impl Asked {
    /// Answers, and does not wait for anybody to hear it.
    pub fn answer(self, answer: ControlAnswer) {
        let _ = self.answer.try_send(answer);
    }
}

#[derive(Debug)]
enum Update {
    Counts(String, Vec<CountRecord>),
    Event(Box<Event>),
}

/// A device of a night.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LiveDevice {
    /// Name in the session.
    pub name: String,
    /// `camera` or `counter`.
    pub kind: &'static str,
    /// Channels of a counter.
    pub channels: Vec<String>,
}

/// A stay at a target, in seconds after the night's start.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LiveSlot {
    /// Name of the target.
    pub name: String,
    /// Kind of the target: `star`, `satellite`, `sky`, `dark` or `none`.
    pub kind: TargetKind,
    /// When it begins, s.
    pub from_s: f64,
    /// When it ends, s; `None`: with the night.
    pub to_s: Option<f64>,
}

/// An event, as a page shows it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LiveEvent {
    /// Number: counts from 1.
    pub number: u64,
    /// Time, s after the night's start.
    pub at_s: f64,
    /// UTC to a tenth of a second.
    pub utc: String,
    /// Kind, as the log names it.
    pub kind: String,
    /// The rest of its line.
    pub text: String,
    /// The device that it is about.
    pub device: Option<String>,
    /// Whether somebody should look at it.
    pub alarm: bool,
}

impl LiveEvent {
    /// Makes the view of an event.
    pub fn of(number: u64, event: &Event, start: Epoch) -> Self {
        let (kind, text) = event_text(event);
        Self {
            number,
            at_s: (event.utc - start).to_seconds(),
            utc: format_utc(event.utc, 1),
            device: device_of(&event.what),
            alarm: is_alarm(&event.what),
            kind,
            text,
        }
    }
}

fn device_of(what: &What) -> Option<String> {
    match what {
        What::Device { device, .. }
        | What::DeviceLost { device, .. }
        | What::DeviceBack { device, .. }
        | What::DeviceFailed { device, .. }
        | What::Mount { device, .. }
        | What::FramesRefused { device, .. } => Some(device.clone()),
        _ => None,
    }
}

fn is_alarm(what: &What) -> bool {
    matches!(
        what,
        What::DeviceLost { .. }
            | What::DeviceFailed { .. }
            | What::FramesRefused { .. }
            | What::ClockStep { .. }
            | What::Stall { .. }
            | What::Error { .. }
    )
}

/// Kind and text of an event.
fn event_text(event: &Event) -> (String, String) {
    let line = serde_json::from_str(&event.to_line());
    let Ok(serde_json::Value::Object(mut fields)) = line else { return Default::default() };
    let kind = fields.shift_remove("kind").and_then(|kind| kind.as_str().map(str::to_owned));
    fields.shift_remove("utc");
    let text = match &event.what {
        What::Target(target) => target.name.clone(),
        What::Device { device, identity, .. } => {
            let said =
                ["vendor", "model", "serial"].iter().filter_map(|key| identity.get(*key)?.as_str());
            format!("{device}: {}", said.collect::<Vec<_>>().join(" "))
        }
        What::DeviceLost { device, error, again_in_s } => {
            format!("{device}: {error}; tried again in {again_in_s} s")
        }
        What::DeviceBack { device, after_s } => format!("{device}: back after {after_s:.1} s"),
        What::DeviceFailed { device, error } => format!("{device} was given up: {error}"),
        What::FramesRefused { device, frames, error } => {
            format!("{frames} frames of {device} refused so far: {error}")
        }
        What::Mount { device, state, .. } => format!("{device}: {state}"),
        What::Error { about, error } => format!("{about}: {error}"),
        What::Control { action, text } if text.is_empty() => action.clone(),
        What::Control { action, text } => format!("{action}: {text}"),
        _ => {
            let one = |(key, value): (String, serde_json::Value)| match value {
                serde_json::Value::String(text) => format!("{key} {text}"),
                value => format!("{key} {value}"),
            };
            fields.into_iter().map(one).collect::<Vec<_>>().join(", ")
        }
    };
    (kind.unwrap_or_default(), text)
}

/// A point of the counts: a bin, or several that make a tenth of a second.
#[derive(Debug, Clone, PartialEq)]
struct Point {
    number: u64,
    start_s: f64,
    length_s: f64,
    counts: Vec<u64>,
    flags: u32,
}

/// Counts of a visit to the empty sky.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct OffPoints {
    /// Channels, in the order of the counts.
    pub channels: Vec<String>,
    /// When that visit began, s after the night's start.
    pub from_s: f64,
    /// Length of each point, s.
    pub length_s: Vec<f64>,
    /// Counts of each point, by channel.
    pub counts: Vec<Vec<u64>>,
    /// Flags of each point: bits of [`CountFlags`](sunglint_formats::CountFlags).
    pub flags: Vec<u32>,
}

/// Some seconds of counts, with the range of their points: flashes stay to be seen.
#[derive(Debug, Clone, PartialEq)]
struct Coarse {
    number: u64,
    start_s: f64,
    end_s: f64,
    length_s: f64,
    counts: Vec<u64>,
    /// Lowest and highest rate of a point, by channel, Hz.
    range_hz: Vec<[f64; 2]>,
    flags: u32,
}

impl Coarse {
    fn of(point: &Point) -> Self {
        let rate = |counts: &u64| [*counts as f64 / point.length_s; 2];
        Self {
            number: 0,
            start_s: point.start_s,
            end_s: point.start_s + point.length_s,
            length_s: point.length_s,
            counts: point.counts.clone(),
            range_hz: point.counts.iter().map(rate).collect(),
            flags: point.flags,
        }
    }

    fn add(&mut self, point: &Point) {
        self.end_s = point.start_s + point.length_s;
        self.length_s += point.length_s;
        self.flags |= point.flags;
        let own = self.counts.iter_mut().zip(&mut self.range_hz);
        for ((sum, [low, high]), counts) in own.zip(&point.counts) {
            *sum = sum.saturating_add(*counts);
            let rate_hz = *counts as f64 / point.length_s;
            (*low, *high) = (low.min(rate_hz), high.max(rate_hz));
        }
    }

    /// Whether a point goes on where this one ends, and it is not long enough.
    fn takes(&self, point: &Point) -> bool {
        self.length_s < COARSE_S * (1.0 - 1e-9)
            && (point.start_s - self.end_s).abs() < 0.5 * point.length_s
    }
}

#[derive(Debug, Default)]
struct Ring {
    channels: Vec<String>,
    points: VecDeque<Point>,
    open: Option<Point>,
    next: u64,
    /// The whole night in larger points; the last one grows.
    coarse: VecDeque<Coarse>,
    next_coarse: u64,
    /// Visits to the empty sky, the last one at the end: those within the time of `points`, and the one before it.
    off: VecDeque<OffPoints>,
}

impl Ring {
    fn add(&mut self, start_s: f64, record: &CountRecord) {
        let length_s = record.length_ps as f64 * 1e-12;
        let open = self.open.get_or_insert_with(|| Point {
            number: 0,
            start_s,
            length_s: 0.0,
            counts: vec![0; record.counts.len()],
            flags: 0,
        });
        open.length_s += length_s;
        open.flags |= record.flags.bits();
        for (sum, counts) in open.counts.iter_mut().zip(&record.counts) {
            *sum = sum.saturating_add(*counts);
        }
        // A bin of 0.1 s may be a rounding error shorter.
        if open.length_s < POINT_S * (1.0 - 1e-9) {
            return;
        }
        if let Some(mut point) = self.open.take() {
            self.next += 1;
            point.number = self.next;
            self.add_coarse(&point);
            self.points.push_back(point);
        }
        while self.points.len() > POINTS {
            self.points.pop_front();
        }
    }

    fn add_coarse(&mut self, point: &Point) {
        match self.coarse.back_mut().filter(|last| last.takes(point)) {
            Some(last) => last.add(point),
            None => {
                self.next_coarse += 1;
                self.coarse.push_back(Coarse { number: self.next_coarse, ..Coarse::of(point) });
            }
        }
        while self.coarse.len() > COARSE {
            self.coarse.pop_front();
        }
    }

    /// Keeps the points from number `first` on that lie within a visit to the empty sky; `sky` has the visits, s after the night's start.
    fn keep_off(&mut self, first: u64, sky: &[[f64; 2]]) {
        let new = usize::try_from(self.next.saturating_sub(first)).unwrap_or(usize::MAX);
        for point in self.points.iter().skip(self.points.len().saturating_sub(new)) {
            let end_s = point.start_s + point.length_s;
            // A start may be a rounding error early.
            let within = |visit: &&[f64; 2]| visit[0] <= point.start_s + 1e-6 && end_s <= visit[1];
            let Some(visit) = sky.iter().find(within) else { continue };
            if self.off.back().is_none_or(|off| visit[0] > off.from_s) {
                self.off.push_back(OffPoints {
                    channels: self.channels.clone(),
                    from_s: visit[0],
                    ..OffPoints::default()
                });
            }
            if let Some(off) = self.off.back_mut().filter(|off| off.counts.len() < OFF_POINTS) {
                off.length_s.push(point.length_s);
                off.counts.push(point.counts.clone());
                off.flags.push(point.flags);
            }
        }
        let oldest_s = self.points.front().map_or(f64::INFINITY, |point| point.start_s);
        while self.off.get(1).is_some_and(|second| second.from_s <= oldest_s) {
            self.off.pop_front();
        }
    }
}

/// Counts of a counter that came since a reader asked last.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LiveCounts {
    /// Channels, in the order of `counts`.
    pub channels: Vec<String>,
    /// Number of the last point.
    pub last: u64,
    /// Points that came since and are not kept any more, or are too many for one answer.
    pub missed: u64,
    /// Start of each point, s after the night's start.
    pub start_s: Vec<f64>,
    /// Length of each point, s.
    pub length_s: Vec<f64>,
    /// Rates of each channel, Hz.
    pub rate_hz: Vec<Vec<f64>>,
    /// Flags of each point: bits of [`CountFlags`](sunglint_formats::CountFlags).
    pub flags: Vec<u32>,
}

/// Counts of a whole night in points of some seconds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LiveHistory {
    /// Channels, in the order of the rates.
    pub channels: Vec<String>,
    /// Number of the last point, which may grow on.
    pub last: u64,
    /// Start of each point, s after the night's start.
    pub start_s: Vec<f64>,
    /// Time that each point has counted, s.
    pub length_s: Vec<f64>,
    /// Mean rate of each channel, Hz.
    pub rate_hz: Vec<Vec<f64>>,
    /// Lowest rate in a tenth of a second.
    pub low_hz: Vec<Vec<f64>>,
    /// Highest rate in a tenth of a second.
    pub high_hz: Vec<Vec<f64>>,
    /// Flags of any of the bins: bits of [`CountFlags`](sunglint_formats::CountFlags).
    pub flags: Vec<u32>,
}

/// Last frame of a camera, in numbers.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LiveFrame {
    /// Number of the frame; 0 for one that is not recorded, by which the mount looks for its target.
    pub number: u64,
    /// Start of the exposure, s after the night's start.
    pub start_s: f64,
    /// Mean of its pixels, ADU.
    pub mean_adu: f64,
    /// The largest of its pixels, ADU.
    pub most_adu: u16,
    /// Place of the brightest spot from the frame's middle, px.
    pub brightest_px: Option<DVec2>,
}

/// Health of a device.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LiveHealth {
    /// `opening`, `running`, `lost`, `failed` or `ended`.
    pub state: &'static str,
    /// Error of a device that is lost or failed.
    pub error: Option<String>,
    /// Frames or bins so far.
    pub taken: u64,
    /// How often it was lost.
    pub losses: u64,
    /// Frames that were refused.
    pub refused: u64,
    /// Rate of each channel over the last second, Hz.
    pub rates_hz: Vec<(String, f64)>,
    /// Last frame of a camera.
    pub frame: Option<LiveFrame>,
    /// Where a mount stands.
    pub mount: Option<LiveMount>,
}

/// Where a mount stands.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LiveMount {
    /// State: `slewing`, `waiting`, `predicted`, `searching`, `locked`, `coasting`, `stopped`, `parking` or `parked`.
    pub state: String,
    /// Distance of the mount from where the target is believed to be, arcsec.
    pub error_arcsec: Option<f64>,
    /// Distance of the target from where it should stand in the last frame, arcsec.
    pub seen_arcsec: Option<f64>,
    /// Azimuth and altitude where it stands, deg.
    pub at_deg: Option<AzimuthAltitude>,
    /// Distance of the Sun from there, deg.
    pub sun_deg: Option<f64>,
}

/// State of a night, and what came since a reader asked last.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LiveView {
    /// Changes with every start of the program.
    pub run: u64,
    /// The night's time, UTC to a tenth of a second.
    pub utc: String,
    /// The same in seconds after the night's start.
    pub now_s: f64,
    /// End of the night, s after its start.
    pub end_s: Option<f64>,
    /// The present target.
    pub target: Option<LiveSlot>,
    /// The next one.
    pub next: Option<LiveSlot>,
    /// Whether it is paused.
    pub paused: bool,
    /// Whether pause and skip can be done: not in a night that is played back or virtual.
    pub can_pause: bool,
    /// Whether it waits for somebody to start it.
    pub waiting: bool,
    /// Why it ended, once it has: `done` or `stopped`.
    pub ended: Option<String>,
    /// Devices by name.
    pub devices: BTreeMap<String, LiveHealth>,
    /// Bytes that are free on the disk.
    pub free_bytes: Option<u64>,
    /// Bytes by which that falls each second, over the last minute at least.
    pub bytes_per_s: Option<f64>,
    /// Error with which the disk refuses to write.
    pub disk_error: Option<String>,
    /// How far the computer's clock is from UTC, as it was known last.
    pub clock: Option<ClockState>,
    /// Rows and frames that are not on the disk.
    pub not_written: u64,
    /// Bunches of bins or events that the page did not get, because it was too slow; the session has them.
    pub dropped: u64,
    /// Counts since.
    pub counts: BTreeMap<String, LiveCounts>,
    /// Events since.
    pub events: Vec<LiveEvent>,
    /// Events since that are not kept any more.
    pub events_missed: u64,
}

/// How far a reader has come.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Seen {
    /// Number of its last event.
    pub events: u64,
    /// Number of its last point of each counter.
    pub counts: BTreeMap<String, u64>,
}

#[derive(Debug, Default)]
struct Inner {
    start: Option<Epoch>,
    end: Option<Epoch>,
    station: Option<Station>,
    name: String,
    root: std::path::PathBuf,
    devices: Vec<LiveDevice>,
    slots: Vec<Slot>,
    snapshot: Option<Snapshot>,
    paused: bool,
    can_pause: bool,
    /// Cameras with a focuser.
    focusers: Vec<String>,
    /// Least distance of the mount from the Sun, deg.
    sun_limit_deg: Option<f64>,
    /// Hour angle up to which a mount that may turn over follows, deg.
    past_meridian_deg: Option<f64>,
    waiting: bool,
    /// Whether it was started by somebody who looked on.
    started: bool,
    ended: Option<String>,
    clock: Option<ClockState>,
    rings: BTreeMap<String, Ring>,
    events: VecDeque<LiveEvent>,
    next_event: u64,
    free: VecDeque<(f64, u64)>,
}

/// Live state of a night and the queue of commands to it. See the module's text.
#[derive(Debug)]
pub struct LiveState {
    run: u64,
    updates: SyncSender<Update>,
    waiting: Mutex<Receiver<Update>>,
    dropped: AtomicU64,
    frames: Mutex<BTreeMap<String, (u64, Arc<Frame>)>>,
    commands: SyncSender<Asked>,
    asked: Mutex<Receiver<Asked>>,
    inner: Mutex<Inner>,
}

impl Default for LiveState {
    fn default() -> Self {
        let (updates, waiting) = sync_channel(WAITING);
        let (commands, asked) = sync_channel(COMMANDS);
        let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
        let run = now.map_or(0, |now| u64::try_from(now.as_micros()).unwrap_or(0));
        Self {
            run,
            updates,
            waiting: Mutex::new(waiting),
            dropped: AtomicU64::new(0),
            frames: Mutex::default(),
            commands,
            asked: Mutex::new(asked),
            inner: Mutex::default(),
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What capture calls: none of it waits.
impl LiveState {
    pub(crate) fn counts(&self, counter: &str, records: &[CountRecord]) {
        self.hand_over(Update::Counts(counter.to_owned(), records.to_vec()));
    }

    pub(crate) fn event(&self, utc: Epoch, what: &What) {
        // The lines of each second are in the state of the mount.
        if matches!(what, What::Mount { changed: false, .. }) {
            return;
        }
        self.hand_over(Update::Event(Box::new(Event { utc, what: what.clone() })));
    }

    fn hand_over(&self, update: Update) {
        if self.updates.try_send(update).is_err() {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Takes a frame, unless somebody looks at the last one in this very moment.
    pub(crate) fn frame(&self, camera: &str, number: u64, frame: &Arc<Frame>) {
        let Ok(mut frames) = self.frames.try_lock() else { return };
        frames.insert(camera.to_owned(), (number, frame.clone()));
    }
}

/// What the night's own thread calls.
impl LiveState {
    pub(crate) fn begin(&self, night: &Night, can_pause: bool) {
        let mut inner = lock(&self.inner);
        inner.start = Some(night.manifest.start_utc);
        inner.end = night.end;
        inner.station = Some(night.station.clone());
        inner.root.clone_from(&night.root);
        let name = night.root.file_name().unwrap_or_default();
        inner.name = name.to_string_lossy().into_owned();
        inner.can_pause = can_pause;
        let with = night.cameras.iter().filter(|camera| camera.focuser.is_some());
        inner.focusers = with.map(|camera| camera.name.clone()).collect();
        inner.sun_limit_deg = night.mount.as_ref().map(|mount| mount.sun_limit_deg());
        let turns = |mount: &&MountPlan| mount.german != Some(false);
        inner.past_meridian_deg =
            night.mount.as_ref().filter(turns).map(|mount| mount.past_meridian_deg());
        inner.waiting = false;
        inner.clock = Some(night.manifest.clock.clone());
        inner.devices.clear();
        for camera in &night.cameras {
            let (name, channels) = (camera.name.clone(), Vec::new());
            inner.devices.push(LiveDevice { name, kind: "camera", channels });
        }
        for counter in &night.counters {
            let (name, channels) = (counter.name.clone(), counter.channel_names());
            let ring = Ring { channels: channels.clone(), ..Ring::default() };
            inner.rings.insert(name.clone(), ring);
            inner.devices.push(LiveDevice { name, kind: "counter", channels });
        }
    }

    pub(crate) fn collect(&self, snapshot: &Snapshot, slots: &[Slot], paused: bool) {
        let mut inner = lock(&self.inner);
        let inner = &mut *inner;
        let Some(start) = inner.start else { return };
        let seconds = |epoch: Epoch| (epoch - start).to_seconds();
        let of_sky = |slot: &&Slot| slot.target.target_kind == TargetKind::Sky;
        let ends_s = |slot: &Slot| slot.to.map_or(f64::INFINITY, seconds);
        let sky: Vec<[f64; 2]> =
            slots.iter().filter(of_sky).map(|slot| [seconds(slot.from), ends_s(slot)]).collect();
        let waiting = lock(&self.waiting);
        loop {
            match waiting.try_recv() {
                Ok(Update::Counts(counter, records)) => {
                    if let Some(ring) = inner.rings.get_mut(&counter) {
                        let first = ring.next;
                        for record in &records {
                            ring.add(seconds(record.start), record);
                        }
                        ring.keep_off(first, &sky);
                    }
                }
                Ok(Update::Event(event)) => {
                    if let What::Clock(state) = &event.what {
                        inner.clock = Some(state.clone());
                    }
                    inner.next_event += 1;
                    inner.events.push_back(LiveEvent::of(inner.next_event, &event, start));
                    while inner.events.len() > EVENTS {
                        inner.events.pop_front();
                    }
                }
                Err(TryRecvError::Empty | TryRecvError::Disconnected) => break,
            }
        }
        if inner.slots != slots {
            inner.slots = slots.to_vec();
        }
        inner.paused = paused;
        inner.snapshot = Some(snapshot.clone());
    }

    /// Notes how much room the disk has; `at_s` is any clock's seconds.
    pub(crate) fn room(&self, at_s: f64) {
        let root = lock(&self.inner).root.clone();
        let Some(free) = super::status::free_bytes(&root) else { return };
        let mut inner = lock(&self.inner);
        inner.free.push_back((at_s, free));
        while inner.free.len() > 600 {
            inner.free.pop_front();
        }
    }

    pub(crate) fn end(&self, reason: &str) {
        lock(&self.inner).ended = Some(reason.to_owned());
    }

    pub(crate) fn next_command(&self) -> Option<Asked> {
        lock(&self.asked).try_recv().ok()
    }

    /// Whether somebody who looked on started it.
    pub(crate) fn was_started(&self) -> bool {
        lock(&self.inner).started
    }

    /// Shows a night that does not run yet, and waits until somebody starts it. Returns false where it was stopped, or `cancel` was set. Nothing is recorded meanwhile.
    pub fn wait(&self, night: &Night, cancel: &Cancel) -> bool {
        self.begin(night, false);
        lock(&self.inner).waiting = true;
        let status = Status::new(night.manifest.start_utc, false);
        loop {
            self.collect(&status.snapshot(), night.schedule.slots(), false);
            while let Some(asked) = self.next_command() {
                match asked.control {
                    Control::Start => {
                        lock(&self.inner).started = true;
                        asked.answer(Ok("the night begins".into()));
                        return true;
                    }
                    Control::Stop => {
                        self.end("stopped");
                        asked.answer(Ok("nothing was recorded".into()));
                        return false;
                    }
                    _ => {
                        let text = "the night has not been started".to_owned();
                        asked.answer(Err(ControlError::Refused(text)));
                    }
                }
            }
            if cancel.is_cancelled() {
                self.end("stopped");
                return false;
            }
            std::thread::sleep(LOOK);
        }
    }
}

/// Calls of readers.
impl LiveState {
    /// Makes the state of a night that has not begun.
    pub fn new() -> Self {
        Self::default()
    }

    /// The session's name: of its folder. Empty before the night begins.
    pub fn name(&self) -> String {
        lock(&self.inner).name.clone()
    }

    /// When the night began; `None` before.
    pub fn start(&self) -> Option<Epoch> {
        lock(&self.inner).start
    }

    /// The station; `None` before the night begins.
    pub fn station(&self) -> Option<Station> {
        lock(&self.inner).station.clone()
    }

    /// Cameras with a focuser, by name.
    pub fn focusers(&self) -> Vec<String> {
        lock(&self.inner).focusers.clone()
    }

    /// Least distance of the mount from the Sun, deg; `None` without a mount.
    pub fn sun_limit_deg(&self) -> Option<f64> {
        lock(&self.inner).sun_limit_deg
    }

    /// Hour angle past the meridian up to which the mount follows before it is turned over, deg; `None` without a mount that may turn over.
    pub fn past_meridian_deg(&self) -> Option<f64> {
        lock(&self.inner).past_meridian_deg
    }

    /// The devices.
    pub fn devices(&self) -> Vec<LiveDevice> {
        lock(&self.inner).devices.clone()
    }

    /// The schedule as it stands.
    pub fn slots(&self) -> Vec<Slot> {
        lock(&self.inner).slots.clone()
    }

    /// The last frame of a camera, with its number.
    pub fn last_frame(&self, camera: &str) -> Option<(u64, Arc<Frame>)> {
        lock(&self.frames).get(camera).cloned()
    }

    /// Counts of visits to the empty sky, in the order of time: those within the time of the points that are kept, and the last one before it.
    pub fn off(&self, counter: &str) -> Vec<OffPoints> {
        let inner = lock(&self.inner);
        inner.rings.get(counter).map(|ring| ring.off.iter().cloned().collect()).unwrap_or_default()
    }

    /// Counts of the whole night from the point of that number on; `None` for a counter that there is not.
    pub fn history(&self, counter: &str, from: u64) -> Option<LiveHistory> {
        let inner = lock(&self.inner);
        let ring = inner.rings.get(counter)?;
        let at = ring.coarse.partition_point(|point| point.number < from);
        let points = || ring.coarse.range(at..);
        let each = |of: &dyn Fn(&Coarse, usize) -> f64| {
            (0..ring.channels.len()).map(|i| points().map(|p| of(p, i)).collect()).collect()
        };
        let range = |p: &Coarse, i: usize| p.range_hz.get(i).copied().unwrap_or_default();
        Some(LiveHistory {
            channels: ring.channels.clone(),
            last: ring.next_coarse,
            start_s: points().map(|p| p.start_s).collect(),
            length_s: points().map(|p| p.length_s).collect(),
            rate_hz: each(&|p, i| p.counts.get(i).map_or(0.0, |n| *n as f64 / p.length_s)),
            low_hz: each(&|p, i| range(p, i)[0]),
            high_hz: each(&|p, i| range(p, i)[1]),
            flags: points().map(|p| p.flags).collect(),
        })
    }

    /// State of the night, and what came since. `None` before it begins.
    pub fn since(&self, seen: &Seen) -> Option<LiveView> {
        let inner = lock(&self.inner);
        let (start, snapshot) = (inner.start?, inner.snapshot.as_ref()?);
        let seconds = |epoch: Epoch| (epoch - start).to_seconds();
        let slot = |slot: &Slot| LiveSlot {
            name: slot.target.name.clone(),
            kind: slot.target.target_kind,
            from_s: seconds(slot.from),
            to_s: slot.to.map(seconds),
        };
        let at = inner.slots.partition_point(|slot| slot.from <= snapshot.utc);
        let planned = |slot: &&Slot| slot.target.target_kind != TargetKind::None;
        let now = at.checked_sub(1).and_then(|at| inner.slots.get(at));
        let next = inner.slots.iter().skip(at).find(planned);
        let devices = snapshot.devices.iter().map(|(name, device)| {
            let error = match &device.state {
                super::State::Lost { error } | super::State::Failed { error } => {
                    Some(error.clone())
                }
                _ => None,
            };
            let frame = device.frame.as_ref().map(|frame| LiveFrame {
                number: frame.number,
                start_s: seconds(frame.start),
                mean_adu: frame.mean_adu,
                most_adu: frame.most_adu,
                brightest_px: frame.brightest_px,
            });
            let health = LiveHealth {
                state: device.state.word(),
                error,
                taken: device.taken,
                losses: device.losses,
                refused: device.refused,
                rates_hz: device.rates_hz.clone(),
                frame,
                mount: device.mount.as_ref().map(|mount| LiveMount {
                    state: mount.state.clone(),
                    error_arcsec: mount.error_arcsec,
                    seen_arcsec: mount.seen_arcsec,
                    at_deg: mount.at_deg,
                    sun_deg: mount.sun_deg,
                }),
            };
            (name.clone(), health)
        });
        let first_event = inner.events.front().map_or(inner.next_event + 1, |event| event.number);
        // A reader that has seen more than there is was at another run.
        let seen_events = if seen.events > inner.next_event { 0 } else { seen.events };
        Some(LiveView {
            run: self.run,
            utc: format_utc(snapshot.utc, 1),
            now_s: seconds(snapshot.utc),
            end_s: inner.end.map(seconds),
            target: now.map(slot),
            next: next.map(slot),
            paused: inner.paused,
            can_pause: inner.can_pause,
            waiting: inner.waiting,
            ended: inner.ended.clone(),
            devices: devices.collect(),
            free_bytes: inner.free.back().map(|(_, free)| *free),
            bytes_per_s: shrinks(&inner.free),
            disk_error: snapshot.disk_error.clone(),
            clock: inner.clock.clone(),
            not_written: snapshot.missing,
            dropped: self.dropped.load(Ordering::Relaxed),
            counts: inner
                .rings
                .iter()
                .map(|(name, ring)| {
                    let seen = seen.counts.get(name).copied().unwrap_or(0);
                    (name.clone(), counts_since(ring, seen))
                })
                .collect(),
            events: inner.events.iter().filter(|e| e.number > seen_events).cloned().collect(),
            // A reader that asks for the first time has missed nothing.
            events_missed: match seen_events {
                0 => 0,
                seen => first_event.saturating_sub(seen + 1),
            },
        })
    }

    /// Gives a command to the night. The receiver gets its answer within a tenth of a second, unless the night has ended.
    ///
    /// # Errors
    /// [`ControlError::Busy`], [`ControlError::Ended`]; a note that is empty or too long.
    pub fn ask(&self, control: Control) -> Result<Receiver<ControlAnswer>, ControlError> {
        if let Control::Note(text) = &control {
            let length = text.chars().count();
            if text.trim().is_empty() || length > LONGEST_NOTE {
                let text = format!("a note has 1 to {LONGEST_NOTE} characters, this one {length}");
                return Err(ControlError::Refused(text));
            }
        }
        if lock(&self.inner).ended.is_some() {
            return Err(ControlError::Ended);
        }
        let (answer, receiver) = sync_channel(1);
        self.commands.try_send(Asked { control, answer }).map_err(|_| ControlError::Busy)?;
        Ok(receiver)
    }
}

/// Bytes by which the room falls each second; `None` before a minute has passed, and where it does not fall.
fn shrinks(free: &VecDeque<(f64, u64)>) -> Option<f64> {
    let ((first_s, first), (last_s, last)) = (free.front()?, free.back()?);
    let passed_s = last_s - first_s;
    let fell = first.checked_sub(*last)?;
    (passed_s >= 60.0 && fell > 0).then(|| fell as f64 / passed_s)
}

fn counts_since(ring: &Ring, seen: u64) -> LiveCounts {
    let seen = if seen > ring.next { 0 } else { seen };
    let new = usize::try_from(ring.next - seen).unwrap_or(usize::MAX);
    let give = new.min(ring.points.len()).min(ANSWER);
    let points = || ring.points.iter().skip(ring.points.len() - give);
    // A reader that asks for the first time has missed nothing.
    let missed = if seen == 0 { 0 } else { new - give };
    let rate = |i: usize| {
        let one = |p: &Point| p.counts.get(i).map_or(0.0, |counts| *counts as f64 / p.length_s);
        points().map(one).collect()
    };
    LiveCounts {
        channels: ring.channels.clone(),
        last: ring.next,
        missed: missed as u64,
        start_s: points().map(|p| p.start_s).collect(),
        length_s: points().map(|p| p.length_s).collect(),
        rate_hz: (0..ring.channels.len()).map(rate).collect(),
        flags: points().map(|p| p.flags).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sunglint_formats::CountFlags;
    use sunglint_formats::time::parse_utc;

    fn record(i: u64, length_ps: i64) -> CountRecord {
        let start = parse_utc("2026-11-21T18:00:00Z").unwrap();
        CountRecord {
            start: start + hifitime::Duration::from_seconds(i as f64 * length_ps as f64 * 1e-12),
            start_ps: i as i64 * length_ps,
            length_ps,
            counts: vec![i],
            missed: vec![0],
            flags: if i == 5 { CountFlags::GAP } else { CountFlags::empty() },
        }
    }

    /// Truth: by hand: bins of 10 ms become points of 0.1 s with their sums and flags; bins of 1 s stay; a reader gets each point once, and is told of those that are gone.
    #[test]
    fn counts_become_points() {
        let mut ring = Ring { channels: vec!["g".into()], ..Ring::default() };
        for i in 0..25 {
            ring.add(0.01 * i as f64, &record(i, 10_000_000_000));
        }
        let all = counts_since(&ring, 0);
        assert_eq!((all.last, all.missed, all.start_s.len()), (2, 0, 2));
        // 0 + … + 9 = 45 and 10 + … + 19 = 145 in 0.1 s.
        for (found, expected) in all.rate_hz[0].iter().zip([450.0, 1450.0]) {
            assert!((found - expected).abs() < 1e-6, "{found}");
        }
        assert_eq!(all.flags, [CountFlags::GAP.bits(), 0]);
        assert_eq!(counts_since(&ring, 1).start_s, [0.1]);
        assert_eq!(counts_since(&ring, 2).start_s.len(), 0);
        // A reader of another run begins anew.
        assert_eq!(counts_since(&ring, 99).start_s.len(), 2);
        let mut long = Ring { channels: vec!["g".into()], ..Ring::default() };
        for i in 0..7000 {
            long.add(i as f64, &record(i, 1_000_000_000_000));
        }
        assert_eq!(long.points.len(), POINTS);
        let late = counts_since(&long, 100);
        assert_eq!(
            (late.last, late.start_s.len(), late.missed),
            (7000, ANSWER, 6900 - ANSWER as u64)
        );
        assert_eq!(counts_since(&long, 6999).start_s, [6999.0]);
    }

    /// Truth: by hand: bins of 0.1 s with 0, 1, 2 … counts become points of 5 s with the lowest and the highest rate in them; a gap ends a point; the last point grows, and is given again.
    #[test]
    fn the_whole_night_is_kept_in_larger_points() {
        let state = LiveState::new();
        let mut ring = Ring { channels: vec!["g".into()], ..Ring::default() };
        for i in 0..70 {
            ring.add(0.1 * i as f64, &record(i, 100_000_000_000));
        }
        // Ten seconds of nothing.
        for i in 170..173 {
            ring.add(0.1 * i as f64, &record(i, 100_000_000_000));
        }
        lock(&state.inner).rings.insert("tagger".into(), ring);
        assert!(state.history("elsewhere", 0).is_none());
        let all = state.history("tagger", 0).unwrap();
        assert_eq!(all.last, 3);
        let near = |found: &[f64], expected: &[f64]| {
            assert_eq!(found.len(), expected.len());
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}");
        };
        near(&all.start_s, &[0.0, 5.0, 17.0]);
        near(&all.length_s, &[5.0, 2.0, 0.3]);
        // (0 + … + 49) / 5 s, (50 + … + 69) / 2 s, (170 + 171 + 172) / 0.3 s.
        near(&all.rate_hz[0], &[245.0, 595.0, 1710.0]);
        near(&all.low_hz[0], &[0.0, 500.0, 1700.0]);
        near(&all.high_hz[0], &[490.0, 690.0, 1720.0]);
        assert_eq!(all.flags, [CountFlags::GAP.bits(), 0, 0]);
        near(&state.history("tagger", 3).unwrap().start_s, &[17.0]);
        let mut inner = lock(&state.inner);
        let ring = inner.rings.get_mut("tagger").unwrap();
        ring.add(17.3, &record(173, 100_000_000_000));
        // Bins that are longer than a point are points of their own, and a day of them is kept.
        for i in 0..COARSE as u64 + 9 {
            ring.add(100.0 + 10.0 * i as f64, &record(i, 10_000_000_000_000));
        }
        assert_eq!((ring.coarse.len(), ring.next_coarse), (COARSE, COARSE as u64 + 12));
    }

    /// Truth: by hand: whoever asks for the first time has missed nothing, however long the night has gone on; whoever comes late is told of what is gone.
    #[test]
    fn a_first_look_has_missed_nothing() {
        let state = LiveState::new();
        let start = parse_utc("2026-11-21T18:00:00Z").unwrap();
        lock(&state.inner).start = Some(start);
        let status = Status::new(start, false);
        for i in 0..EVENTS + 100 {
            state.event(start, &What::Control { action: "note".into(), text: i.to_string() });
            if i % 100 == 99 {
                state.collect(&status.snapshot(), &[], false);
            }
        }
        let view = |events| {
            let seen = Seen { events, ..Seen::default() };
            let view = state.since(&seen).unwrap();
            (view.events.len(), view.events_missed)
        };
        assert_eq!((view(0), view(10), view(590)), ((EVENTS, 0), (EVENTS, 90), (10, 0)));
    }

    /// Truth: by hand: of points of a second, two visits to the sky of 10 s and 5 s keep their own, those that lie within them whole. A visit is dropped once points after the next are all that is kept.
    #[test]
    fn empty_sky_is_kept_as_long_as_its_points() {
        let mut ring = Ring { channels: vec!["g".into()], ..Ring::default() };
        let sky = [[2.0, 12.0], [20.5, 25.5]];
        for i in 0..15 {
            ring.add(i as f64, &record(i, 1_000_000_000_000));
            ring.keep_off(i, &sky);
        }
        let kept = |ring: &Ring| -> Vec<(f64, Vec<u64>)> {
            let counts =
                |off: &OffPoints| off.counts.iter().map(|counts| counts[0]).collect::<Vec<u64>>();
            ring.off.iter().map(|off| (off.from_s, counts(off))).collect()
        };
        let first = (2.0, (2..12).collect::<Vec<u64>>());
        assert_eq!(kept(&ring), std::slice::from_ref(&first));
        for i in 15..30 {
            ring.add(i as f64, &record(i, 1_000_000_000_000));
        }
        ring.keep_off(15, &sky);
        let second = (20.5, vec![21, 22, 23, 24]);
        assert_eq!(kept(&ring), [first.clone(), second.clone()]);
        for (until, expected) in
            [(POINTS as u64 + 20, vec![first, second.clone()]), (POINTS as u64 + 22, vec![second])]
        {
            while ring.next < until {
                let i = ring.next;
                ring.add(i as f64, &record(i, 1_000_000_000_000));
                ring.keep_off(i, &sky);
            }
            assert_eq!(kept(&ring), expected);
        }
    }

    /// Truth: by hand: capture that nobody empties loses what finds no room, and counts it; it never waits. A frame that somebody holds is left.
    #[test]
    fn capture_never_waits() {
        let state = LiveState::new();
        for i in 0..WAITING as u64 + 10 {
            state.counts("tagger", &[record(i, 1)]);
        }
        assert_eq!(state.dropped.load(Ordering::Relaxed), 10);
        assert!(state.since(&Seen::default()).is_none());
        let note = |text: &str| state.ask(Control::Note(text.to_owned()));
        assert!(matches!(note(" "), Err(ControlError::Refused(_))));
        assert!(matches!(note(&"x".repeat(LONGEST_NOTE + 1)), Err(ControlError::Refused(_))));
        for _ in 0..COMMANDS {
            assert!(state.ask(Control::Stop).is_ok());
        }
        assert_eq!(state.ask(Control::Stop).unwrap_err(), ControlError::Busy);
        let asked = state.next_command().unwrap();
        asked.answer(Ok("nobody hears it".into()));
        state.end("done");
        assert_eq!(state.ask(Control::Stop).unwrap_err(), ControlError::Ended);
    }
}
