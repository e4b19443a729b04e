//! Live status of a night: what every thread knows of itself, as data.

use glam::DVec2;
use hifitime::Epoch;
use std::collections::{BTreeMap, VecDeque};
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};
use sunglint_drivers::clock::DeviceClock;
use sunglint_formats::session::Trouble as DiskFault;
use sunglint_formats::{CountRecord, Frame};
use sunglint_radiometry::sky::AzimuthAltitude;

/// Steps without a frame that are named at most.
const EMPTY: usize = 20;
/// Over how long rates are averaged, ps.
const WINDOW_PS: i64 = 1_000_000_000_000;

/// State of a device.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum State {
    /// It is being opened.
    #[default]
    Opening,
    /// It measures.
    Running,
    /// It failed, and is tried again.
    Lost {
        /// Error that the device reported.
        error: String,
    },
    /// It can never do what is asked, and is not tried again.
    Failed {
        /// Error that the device reported.
        error: String,
    },
    /// End of the device's night.
    Ended,
}

impl State {
    /// Returns the state in a word: `opening`, `running`, `lost`, `failed` or `ended`.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Opening => "opening",
            Self::Running => "running",
            Self::Lost { .. } => "lost",
            Self::Failed { .. } => "failed",
            Self::Ended => "ended",
        }
    }
}

/// The last frame of a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct LastFrame {
    /// When its exposure began.
    pub start: Epoch,
    /// Number of the frame; 0 for one that is not recorded, by which the mount looks for its target.
    pub number: u64,
    /// Mean of its pixels, ADU.
    pub mean_adu: f64,
    /// The largest of its pixels, ADU.
    pub most_adu: u16,
    /// The brightest spot's place from the frame's middle, columns and rows, px; `None` where nothing stands out.
    pub brightest_px: Option<DVec2>,
}

/// Where a mount stands.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MountStatus {
    /// State, as the log has it.
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

/// Status of a device.
#[derive(Debug, Clone, Default)]
pub struct DeviceStatus {
    /// State of the device.
    pub state: State,
    /// Frames or bins so far.
    pub taken: u64,
    /// How often it was lost.
    pub losses: u64,
    /// Frames that were refused, because they are not what was asked for.
    pub refused: u64,
    /// Rates of a counter's channels over the last second, Hz.
    pub rates_hz: Vec<(String, f64)>,
    /// The last frame of a camera.
    pub frame: Option<LastFrame>,
    /// Where a mount stands.
    pub mount: Option<MountStatus>,
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
    empty: Vec<String>,
}

/// Status of a night, which all threads write into.
#[derive(Debug)]
pub struct Status {
    start: Epoch,
    live: bool,
    shared: Mutex<Shared>,
}

impl Status {
    /// Makes the status of a night that begins at `start`; `live` if UTC is the computer's.
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
            State::Failed { error } => format!("{device}: given up: {error}"),
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

    /// A camera took a frame that is not recorded: the mount looks for its target.
    pub fn look(&self, camera: &str, frame: &Frame) {
        let last = LastFrame::of(0, frame);
        self.shared().devices.entry(camera.to_owned()).or_default().frame = Some(last);
    }

    /// A mount's state.
    pub fn mount(&self, device: &str, mount: MountStatus) {
        self.shared().devices.entry(device.to_owned()).or_default().mount = Some(mount);
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
    pub fn disk_fault(&self, fault: &DiskFault) {
        let text = format!("cannot write {}: {}", fault.file, fault.error);
        let mut shared = self.shared();
        if !fault.again {
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

    /// A frame of a camera was refused; gives how many were in all.
    pub fn refused(&self, device: &str, error: &str) -> u64 {
        let mut shared = self.shared();
        let status = shared.devices.entry(device.to_owned()).or_default();
        status.refused += 1;
        let refused = status.refused;
        if refused.is_power_of_two() {
            shared.messages.push(format!("{device}: {refused} frames refused so far: {error}"));
        }
        refused
    }

    /// No frame of a step counts.
    pub fn empty_step(&self, step: String) {
        let mut shared = self.shared();
        // A night may have thousands of steps.
        if shared.empty.len() < EMPTY {
            shared.empty.push(step);
        }
    }

    /// Adds a message for the next snapshot.
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
            empty: shared.empty.clone(),
        }
    }
}

/// State of a night at a moment.
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
    /// Error with which the disk refuses to write.
    pub disk_error: Option<String>,
    /// Rows and frames that are not on the disk.
    pub missing: u64,
    /// Messages since the last snapshot.
    pub messages: Vec<String>,
    /// Steps of which no frame counts.
    pub empty: Vec<String>,
}

impl LastFrame {
    fn of(number: u64, frame: &Frame) -> Self {
        let (mean_adu, most_adu) = (frame.mean_adu(), frame.most_adu());
        Self { start: frame.start, number, mean_adu, most_adu, brightest_px: brightest(frame) }
    }
}

/// The centroid of the 9 × 9 pixels around the brightest one, from the frame's middle: a hint for the person at the telescope,
/// no measurement. Nothing where it does not stand out by more than five times the spread.
fn brightest(frame: &Frame) -> Option<DVec2> {
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
    (light > 0.0).then(|| DVec2::new(x / light - middle(columns), y / light - middle(rows)))
}

/// Returns the bytes that are free on the disk of a folder.
#[cfg(unix)]
pub fn free_bytes(folder: &Path) -> Option<u64> {
    let about = nix::sys::statvfs::statvfs(folder).ok()?;
    #[allow(clippy::useless_conversion, reason = "the types differ between systems")]
    Some(u64::from(about.blocks_available()).saturating_mul(u64::from(about.fragment_size())))
}

/// Returns the bytes that are free on the disk of a folder: not known on this system.
#[cfg(not(unix))]
pub fn free_bytes(_: &Path) -> Option<u64> {
    None
}
