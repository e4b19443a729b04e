//! How the night goes: what every thread knows of itself, for whoever looks.

use super::opener::DeviceClock;
use hifitime::Epoch;
use serde_json::{Value, json};
use std::collections::{BTreeMap, VecDeque};
use std::fmt::Write as _;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use sunglint_formats::session::Trouble;
use sunglint_formats::time::format_utc;
use sunglint_formats::{CountRecord, Frame};

/// Over how long rates are averaged, ps.
const WINDOW_PS: i64 = 1_000_000_000_000;

/// What a device is doing.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum State {
    /// It is being opened.
    #[default]
    Opening,
    /// It measures.
    Running,
    /// It failed, and is tried again.
    Lost {
        /// What it said.
        error: String,
    },
    /// Its night is over.
    Ended,
}

impl State {
    fn word(&self) -> &'static str {
        match self {
            Self::Opening => "opening",
            Self::Running => "running",
            Self::Lost { .. } => "lost",
            Self::Ended => "ended",
        }
    }
}

/// The last frame of a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct LastFrame {
    /// When its exposure began.
    pub start: Epoch,
    /// Its number.
    pub number: u64,
    /// Mean of its pixels, ADU.
    pub mean_adu: f64,
    /// The largest of its pixels, ADU.
    pub most_adu: u16,
    /// The brightest spot's place from the frame's middle, columns and rows, px; `None` where nothing stands out.
    pub brightest_px: Option<[f64; 2]>,
}

/// What is known of a device.
#[derive(Debug, Clone, Default)]
pub struct DeviceStatus {
    /// What it is doing.
    pub state: State,
    /// Frames or bins so far.
    pub taken: u64,
    /// How often it was lost.
    pub losses: u64,
    /// Rates of a counter's channels over the last second, Hz.
    pub rates_hz: Vec<(String, f64)>,
    /// The last frame of a camera.
    pub frame: Option<LastFrame>,
    recent: VecDeque<CountRecord>,
}

#[derive(Debug, Default)]
struct Shared {
    devices: BTreeMap<String, DeviceStatus>,
    /// The latest time of any device, where their clocks are not the computer's.
    latest: Option<Epoch>,
    disk_error: Option<String>,
    messages: Vec<String>,
    lost: u64,
    unwritable: u64,
}

/// What all threads write into.
#[derive(Debug)]
pub struct Status {
    start: Epoch,
    live: bool,
    shared: Mutex<Shared>,
}

impl Status {
    /// Of a night that begins then; `live` if UTC is the computer's.
    pub fn new(start: Epoch, live: bool) -> Self {
        Self { start, live, shared: Mutex::default() }
    }

    fn shared(&self) -> MutexGuard<'_, Shared> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The night's time: UTC, or the latest time of any device of a night that is not now.
    pub fn utc(&self) -> Epoch {
        if self.live {
            DeviceClock::live().utc()
        } else {
            self.shared().latest.unwrap_or(self.start)
        }
    }

    /// A device's time has come so far.
    pub fn reached(&self, utc: Epoch) {
        let mut shared = self.shared();
        shared.latest = Some(shared.latest.map_or(utc, |latest| latest.max(utc)));
    }

    /// A device's state.
    pub fn set_state(&self, device: &str, state: State) {
        let mut shared = self.shared();
        let message = match &state {
            State::Lost { error } => format!("{device}: {error}"),
            State::Running => format!("{device}: running"),
            State::Opening | State::Ended => String::new(),
        };
        if !message.is_empty() {
            shared.messages.push(message);
        }
        let status = shared.devices.entry(device.to_owned()).or_default();
        status.losses += u64::from(matches!(state, State::Lost { .. }));
        status.state = state;
    }

    /// A camera's frame was taken.
    pub fn frame(&self, camera: &str, number: u64, frame: &Frame) {
        let last = LastFrame::of(number, frame);
        let mut shared = self.shared();
        let status = shared.devices.entry(camera.to_owned()).or_default();
        status.taken += 1;
        status.frame = Some(last);
    }

    /// A counter's bins came.
    pub fn counts(&self, counter: &str, channels: &[String], records: &[CountRecord]) {
        let mut shared = self.shared();
        let status = shared.devices.entry(counter.to_owned()).or_default();
        status.taken += records.len() as u64;
        status.recent.extend(records.iter().rev().take(1000).rev().cloned());
        let end = status.recent.back().map_or(0, |record| record.start_ps);
        let old = |record: &CountRecord| end.saturating_sub(record.start_ps) >= WINDOW_PS;
        while status.recent.len() > 1 && status.recent.front().is_some_and(old) {
            status.recent.pop_front();
        }
        let length_ps: i64 = status.recent.iter().map(|record| record.length_ps).sum();
        let rate = |i: usize| {
            let counts: u64 = status.recent.iter().filter_map(|record| record.counts.get(i)).sum();
            counts as f64 / (length_ps.max(1) as f64 * 1e-12)
        };
        status.rates_hz = channels.iter().enumerate().map(|(i, c)| (c.clone(), rate(i))).collect();
    }

    /// The disk refused something.
    pub fn disk_trouble(&self, trouble: &Trouble) {
        let text = format!("cannot write {}: {}", trouble.file, trouble.error);
        let mut shared = self.shared();
        if !trouble.again {
            shared.messages.push(text.clone());
        }
        shared.disk_error = Some(text);
    }

    /// The format cannot hold what a device delivered.
    pub fn unwritable(&self, about: &str, error: &str) {
        let mut shared = self.shared();
        shared.unwritable += 1;
        shared.messages.push(format!("{about}: cannot be written: {error}"));
    }

    /// Rows and frames that are lost, and whether the disk still refuses something.
    pub fn set_lost(&self, lost: u64, failing: bool) {
        let mut shared = self.shared();
        shared.lost = lost;
        if !failing && lost == 0 {
            shared.disk_error = None;
        }
    }

    /// Says something to whoever looks.
    pub fn say(&self, message: String) {
        self.shared().messages.push(message);
    }

    /// How it stands now; the messages since the last call go with it.
    pub fn snapshot(&self) -> Snapshot {
        let utc = self.utc();
        let mut shared = self.shared();
        Snapshot {
            utc,
            devices: shared.devices.clone(),
            target: None,
            free_bytes: None,
            disk_error: shared.disk_error.clone(),
            missing: shared.lost + shared.unwritable,
            messages: std::mem::take(&mut shared.messages),
        }
    }
}

/// How the night stands at a moment.
#[derive(Debug, Clone)]
pub struct Snapshot {
    /// The night's time.
    pub utc: Epoch,
    /// The devices.
    pub devices: BTreeMap<String, DeviceStatus>,
    /// The target's name, where there is one.
    pub target: Option<String>,
    /// Bytes that are free on the disk.
    pub free_bytes: Option<u64>,
    /// What the disk refuses.
    pub disk_error: Option<String>,
    /// Rows and frames that are not on the disk.
    pub missing: u64,
    /// What was said since the last snapshot.
    pub messages: Vec<String>,
}

impl LastFrame {
    fn of(number: u64, frame: &Frame) -> Self {
        let sum: u64 = frame.pixels.iter().map(|&pixel| u64::from(pixel)).sum();
        let mean_adu = sum as f64 / frame.pixels.len().max(1) as f64;
        let most_adu = frame.pixels.iter().copied().max().unwrap_or(0);
        Self { start: frame.start, number, mean_adu, most_adu, brightest_px: brightest(frame) }
    }
}

/// The centroid of the 9 × 9 pixels around the brightest one, from the frame's middle: a hint for the person at the telescope,
/// no measurement. Nothing where it does not stand out by more than five times the spread.
fn brightest(frame: &Frame) -> Option<[f64; 2]> {
    const HALF: usize = 4;
    let (rows, columns) = frame.pixels.dim();
    let n = frame.pixels.len() as f64;
    let (sum, squares) = frame.pixels.iter().fold((0.0, 0.0), |(sum, squares), &pixel| {
        let value = f64::from(pixel);
        (sum + value, squares + value * value)
    });
    let mean = sum / n;
    let spread = (squares / n - mean * mean).max(0.0).sqrt();
    let ((row, column), most) = frame.pixels.indexed_iter().max_by_key(|(_, pixel)| **pixel)?;
    if f64::from(*most) <= mean + 5.0 * spread {
        return None;
    }
    let span = |at: usize, end: usize| at.saturating_sub(HALF)..(at + HALF + 1).min(end);
    let (mut light, mut x, mut y) = (0.0, 0.0, 0.0);
    for (row, column) in
        span(row, rows).flat_map(|row| span(column, columns).map(move |column| (row, column)))
    {
        let value = (f64::from(frame.pixels[[row, column]]) - mean).max(0.0);
        light += value;
        x += value * column as f64;
        y += value * row as f64;
    }
    let middle = |n: usize| (n as f64 - 1.0) / 2.0;
    (light > 0.0).then(|| [x / light - middle(columns), y / light - middle(rows)])
}

impl Snapshot {
    /// In a few words, on one line.
    pub fn text(&self) -> String {
        let mut text = format_utc(self.utc, 1);
        if let Some(target) = &self.target {
            let _ = write!(text, "  {target}");
        }
        for (name, device) in &self.devices {
            let _ = write!(text, "  | {name}");
            if device.state != State::Running {
                let _ = write!(text, " {}", device.state.word());
            }
            for (channel, rate_hz) in &device.rates_hz {
                let _ = write!(text, " {channel} {}", short_hz(*rate_hz));
            }
            if let Some(frame) = &device.frame {
                let _ = write!(
                    text,
                    " #{} {:.0}..{} ADU",
                    frame.number, frame.mean_adu, frame.most_adu
                );
                if let Some([x, y]) = frame.brightest_px {
                    let _ = write!(text, " at {x:+.1} {y:+.1} px");
                }
            }
        }
        if let Some(free) = self.free_bytes {
            let _ = write!(text, "  | {:.1} GB free", free as f64 * 1e-9);
        }
        if let Some(error) = &self.disk_error {
            let _ = write!(text, "  | {error}");
        }
        if self.missing > 0 {
            let _ = write!(text, "  | {} NOT WRITTEN", self.missing);
        }
        text
    }

    /// The same with keys.
    pub fn json(&self) -> Value {
        let devices = self.devices.iter().map(|(name, device)| {
            let rates: Value =
                device.rates_hz.iter().map(|(c, rate)| (c.clone(), json!(rate))).collect();
            let error = if let State::Lost { error } = &device.state { Some(error) } else { None };
            let frame = device.frame.as_ref().map(|frame| {
                json!({
                    "start_utc": format_utc(frame.start, 6),
                    "number": frame.number,
                    "mean_adu": frame.mean_adu,
                    "most_adu": frame.most_adu,
                    "brightest_px": frame.brightest_px,
                })
            });
            let value = json!({
                "state": device.state.word(),
                "error": error,
                "taken": device.taken,
                "losses": device.losses,
                "rates_hz": rates,
                "frame": frame,
            });
            (name.clone(), value)
        });
        json!({
            "utc": format_utc(self.utc, 3),
            "target": self.target,
            "devices": devices.collect::<serde_json::Map<_, _>>(),
            "disk_free_bytes": self.free_bytes,
            "disk_error": self.disk_error,
            "not_written": self.missing,
            "messages": self.messages,
        })
    }
}

/// A rate in three figures.
fn short_hz(rate_hz: f64) -> String {
    match rate_hz {
        rate if rate >= 1e6 => format!("{:.2} MHz", rate * 1e-6),
        rate if rate >= 1e3 => format!("{:.2} kHz", rate * 1e-3),
        rate => format!("{rate:.0} Hz"),
    }
}

/// How often a snapshot is shown where nobody says: on a terminal, and elsewhere.
pub const EVERY: [Duration; 2] = [Duration::from_secs(1), Duration::from_secs(10)];
