//! Common parts of the tests of capture: a recorded night, devices that do as they are told, and what a session holds.

#![allow(dead_code, reason = "each test binary uses its part")]
#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use hifitime::Epoch;
use ndarray::Array2;
use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use sunglint_drivers::clock::{Deadline, DeviceClock, SystemClock, VirtualClock};
use sunglint_drivers::device::{
    Camera, Device, DeviceError, Identity, Interrupted, PhotonCounter, Setting, Window,
};
use sunglint_formats::session::{
    ClockState, Device as Listed, DeviceKind, Disk, FORMAT, Manifest, Session, SessionWriter,
    Target, TargetKind, What,
};
use sunglint_formats::time::{format_utc, parse_utc};
use sunglint_formats::toml::{Document, Positive};
use sunglint_formats::{CountFlags, CountRecord, Frame};
use sunglint_observatory::{CameraPlan, CounterPlan, Night, Opener, Plan};

/// When every night of these tests begins.
pub fn at(s: f64) -> Epoch {
    parse_utc("2020-11-18T17:00:00Z").unwrap() + hifitime::Duration::from_seconds(s)
}

/// A plan for a camera and a counter: sky for 20 s, Vega for 30 s; with replacements.
pub fn plan_of(changes: &[(&str, &str)]) -> String {
    let plan = r#"
station = "ufo"
from = "2020-11-18T17:00:00Z"
for_s = 60

[[camera]]
name = "cam"
device = "sim-camera"
exposure_s = 0.5
interval_s = 2.0
filter = "V"

[[counter]]
name = "tagger"
device = "sim-timetagger"
channels = { g = 1, r = 3 }
bin_s = 0.1

[[visit]]
off = "sky"
for_s = 20

[[visit]]
star = "Vega"
for_s = 30
"#;
    changes.iter().fold(plan.to_owned(), |plan, (from, to)| {
        assert!(plan.contains(from), "{from}");
        plan.replacen(from, to, 1)
    })
}

/// The bin of that number.
pub fn bin(i: u64, bin_s: f64) -> CountRecord {
    let length_ps = (bin_s * 1e12).round() as i64;
    let start_ps = i as i64 * length_ps;
    CountRecord {
        start: at(0.0) + hifitime::Duration::from_total_nanoseconds(i128::from(start_ps / 1000)),
        start_ps,
        length_ps,
        counts: vec![i, 3 * i + 1],
        missed: vec![0, i % 2],
        flags: if i.is_multiple_of(11) { CountFlags::OVERFLOW } else { CountFlags::empty() },
    }
}

/// The frame of that number.
pub fn frame(start: Epoch, exposure_s: f64, px: usize, number: u64) -> Frame {
    // What a dim field has: noise of a few ADU, drawn by a hash of place and number.
    let value = |(row, column): (usize, usize)| {
        let hash =
            (number << 32 ^ (row << 16) as u64 ^ column as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        500 + (hash >> 60) as u16
    };
    Frame {
        pixels: Array2::from_shape_fn((px, px), value),
        origin: [0, 0],
        binning: [1, 1],
        bayer: None,
        start,
        exposure_s,
        gain_e_per_adu: Some(0.3),
        temperature_c: Some(-10.0),
        saturation_adu: Some(65535.0),
        header: sunglint_formats::fits::Header::default(),
    }
}

/// A night to be recorded.
pub struct Recording {
    pub seconds: f64,
    pub bin_s: f64,
    pub frame_s: f64,
    pub frame_px: usize,
}

impl Default for Recording {
    fn default() -> Self {
        Self { seconds: 10.0, bin_s: 0.1, frame_s: 1.0, frame_px: 16 }
    }
}

fn manifest(bin_s: f64, exposure_s: f64) -> Manifest {
    let device = |name: &str, kind, exposure_s, channels: &[&str]| Listed {
        name: name.into(),
        kind,
        address: "sim".into(),
        options: vec![],
        channels: channels.iter().map(|&channel| channel.to_owned()).collect(),
        inputs: vec![1, 3][..channels.len()].to_vec(),
        raw_tags: false,
        exposure_s,
        interval_s: None,
        filter: None,
    };
    Manifest {
        format: FORMAT.into(),
        program: "a test".into(),
        station: "ufo".into(),
        start_utc: at(0.0),
        clock: ClockState {
            method: "none".into(),
            synchronised: None,
            offset_s: None,
            error_s: None,
        },
        devices: vec![
            device("cam", DeviceKind::Camera, exposure_s, &[]),
            device("tagger", DeviceKind::Counter, bin_s, &["g", "r"]),
        ],
        files: vec![],
    }
}

impl Recording {
    /// Writes it.
    pub fn write(&self, root: &Path) -> Session {
        let exposure_s = 0.5 * self.frame_s;
        let manifest = manifest(self.bin_s, exposure_s);
        let mut writer = SessionWriter::create(Arc::new(Disk), root, &manifest, &[]).unwrap();
        writer.event(at(0.0), What::Target(Target::off(TargetKind::Sky)));
        let star = Target {
            name: "Vega".into(),
            target_kind: TargetKind::Star,
            on: true,
            ra_deg: Some(279.2347),
            dec_deg: Some(38.7837),
            tle: None,
            omm: None,
        };
        writer.event(at(0.4 * self.seconds), What::Target(star));
        for i in 0..(self.seconds / self.bin_s).round() as u64 {
            writer.count("tagger", &bin(i, self.bin_s)).unwrap();
            if i % 1000 == 999 {
                writer.sync(at(0.0));
            }
        }
        for i in 0..(self.seconds / self.frame_s).round() as u64 {
            let start = at(i as f64 * self.frame_s);
            let mut frame = frame(start, exposure_s, self.frame_px, i + 1);
            frame.header.set("OBJECT", if i % 3 == 0 { "Vega" } else { "sky" }, "");
            assert!(writer.frame("cam", i + 1, &frame).unwrap().is_none());
        }
        assert_eq!(writer.finish(at(self.seconds), "done").lost, 0);
        Session::open(root).unwrap()
    }
}

/// All bins of a session.
pub fn bins(session: &Session) -> Vec<CountRecord> {
    session.counts("tagger").unwrap().collect::<Result<_, _>>().unwrap()
}

/// All frames of a session.
pub fn frames(session: &Session) -> Vec<(u64, Frame)> {
    let files = session.frames("cam").unwrap().files;
    files.iter().map(|file| (file.sequence, file.read().unwrap())).collect()
}

/// How many of the first so many bins and frames of `old` are not in `new`, and how many are there twice or changed.
pub fn lost_between(old: &Session, new: &Session, safe: [usize; 2]) -> [usize; 2] {
    let (mut lost, mut doubled) = (0, 0);
    let mut found: HashMap<i64, Vec<CountRecord>> = HashMap::new();
    for record in bins(new) {
        found.entry(record.start_ps).or_default().push(record);
    }
    for (i, record) in bins(old).into_iter().enumerate() {
        match found.remove(&record.start_ps).unwrap_or_default().as_slice() {
            [] => lost += usize::from(i < safe[0]),
            [same] if *same == record => {}
            _ => doubled += 1,
        }
    }
    let mut found: HashMap<u64, Vec<Frame>> = HashMap::new();
    for (number, frame) in frames(new) {
        found.entry(number).or_default().push(frame);
    }
    for (i, (number, frame)) in frames(old).into_iter().enumerate() {
        match found.remove(&number).unwrap_or_default().as_slice() {
            [] => lost += usize::from(i < safe[1]),
            [same] if *same == frame => {}
            _ => doubled += 1,
        }
    }
    [lost, doubled]
}

/// Devices that do as they are told, each on its own virtual clock.
#[derive(Debug)]
pub struct Fakes {
    pub seconds: f64,
    /// The counter fails after so many bins, once.
    pub fail_after: Option<u64>,
    /// So often it cannot be opened after that.
    pub refuse: u32,
    pub no_camera: bool,
    /// On the computer's clock.
    pub real_time: bool,
    pub frame_px: usize,
    /// The camera takes no gain above this.
    pub most_gain: f64,
    pub clocks: Mutex<HashMap<String, Arc<VirtualClock>>>,
    pub state: Arc<Mutex<State>>,
}

#[derive(Debug, Default)]
pub struct State {
    failed: bool,
    refused: u32,
}

impl Fakes {
    pub fn new(seconds: f64) -> Self {
        Self {
            seconds,
            fail_after: None,
            refuse: 0,
            no_camera: false,
            real_time: false,
            frame_px: 16,
            most_gain: f64::INFINITY,
            clocks: Mutex::default(),
            state: Arc::default(),
        }
    }

    /// A night with them, by the plan of [`plan_of`].
    pub fn night(self, root: &Path) -> Night {
        let source = plan_of(&[("for_s = 60", &format!("for_s = {}", self.seconds))]);
        let file = root.with_extension("toml");
        std::fs::write(&file, &source).unwrap();
        let plan = Plan::read(Document::read(&file).unwrap().path()).unwrap();
        let manifest = Manifest {
            devices: plan.devices(),
            files: plan.sums(),
            start_utc: if self.real_time { sunglint_drivers::clock::utc_now() } else { at(0.0) },
            ..manifest(0.1, 0.5)
        };
        Night {
            root: root.to_path_buf(),
            storage: Arc::new(Disk),
            manifest,
            files: plan.files,
            station: plan.station,
            cameras: plan.cameras,
            counters: plan.counters,
            wheels: vec![],
            rotators: vec![],
            mount: None,
            watchdog: None,
            from: None,
            ends_with_visits: false,
            resumes: false,
            end: if self.real_time { None } else { plan.to },
            opener: Arc::new(self),
            schedule: plan.schedule,
            ended: None,
            in_utc: false,
            live: None,
        }
    }

    fn of(&self, device: &str) -> Fake {
        Fake {
            clock: Opener::clock(self, device),
            next: 0,
            bin_ps: 0,
            frame_px: self.frame_px,
            most_gain: self.most_gain,
            fail_after: self.fail_after,
            state: self.state.clone(),
            names: vec!["c1".into(), "c2".into(), "c3".into()],
        }
    }
}

impl Opener for Fakes {
    fn clock(&self, device: &str) -> DeviceClock {
        if self.real_time {
            return DeviceClock { clock: Arc::new(SystemClock), zero_utc: None };
        }
        let clock = self.clocks.lock().unwrap().entry(device.to_owned()).or_default().clone();
        DeviceClock { clock, zero_utc: Some(at(0.0)) }
    }

    fn camera(&self, plan: &CameraPlan, _: &Deadline) -> Result<Box<dyn Camera>, DeviceError> {
        if self.no_camera {
            return Err(DeviceError::NotReady { device: "fake", reason: "nobody is there" });
        }
        Ok(Box::new(self.of(&plan.name)))
    }

    fn counter(
        &self,
        plan: &CounterPlan,
        _: &Deadline,
    ) -> Result<Box<dyn PhotonCounter>, DeviceError> {
        let mut state = self.state.lock().unwrap();
        if state.failed && state.refused < self.refuse {
            state.refused += 1;
            return Err(DeviceError::NotReady { device: "fake", reason: "unplugged" });
        }
        Ok(Box::new(self.of(&plan.name)))
    }
}

#[derive(Debug)]
struct Fake {
    clock: DeviceClock,
    next: u64,
    bin_ps: i64,
    frame_px: usize,
    most_gain: f64,
    fail_after: Option<u64>,
    state: Arc<Mutex<State>>,
    names: Vec<String>,
}

impl Device for Fake {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        Ok(Identity {
            vendor: "sunglint".into(),
            model: "fake".into(),
            serial: Some(format_utc(at(0.0), 0)),
            firmware: None,
            driver: "fake",
        })
    }

    fn settings(&mut self, _: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        Ok(vec![])
    }
}

impl Camera for Fake {
    fn sensor_px(&self) -> [u32; 2] {
        [self.frame_px as u32; 2]
    }
    fn set_window(&mut self, window: Window, _: &Deadline) -> Result<Window, DeviceError> {
        Ok(window)
    }
    fn set_gain(&mut self, gain: f64, _: &Deadline) -> Result<f64, DeviceError> {
        if gain > self.most_gain {
            let (least, most) = (0.0, self.most_gain);
            return Err(DeviceError::OutOfRange { name: "gain", asked: gain, least, most });
        }
        Ok(gain)
    }
    fn set_temperature_c(&mut self, temperature: f64, _: &Deadline) -> Result<f64, DeviceError> {
        Ok(temperature)
    }
    fn expose(&mut self, exposure_s: f64, _: &Deadline) -> Result<Frame, DeviceError> {
        let start = self.clock.utc();
        self.clock.clock.sleep(Duration::from_secs_f64(exposure_s));
        self.next += 1;
        Ok(frame(start, exposure_s, self.frame_px, self.next))
    }
}

impl PhotonCounter for Fake {
    fn channels(&self) -> &[String] {
        &self.names
    }
    fn set_trigger_level_v(&mut self, _: usize, v: f64, _: &Deadline) -> Result<f64, DeviceError> {
        Ok(v)
    }
    fn set_input_delay_ps(&mut self, _: usize, ps: i64, _: &Deadline) -> Result<i64, DeviceError> {
        Ok(ps)
    }
    fn set_dead_time_ps(&mut self, _: usize, ps: i64, _: &Deadline) -> Result<i64, DeviceError> {
        Ok(ps)
    }
    fn start(&mut self, bin_ps: i64, _: &Deadline) -> Result<(), DeviceError> {
        self.bin_ps = bin_ps;
        Ok(())
    }
    fn read(
        &mut self,
        bins: usize,
        _: &Deadline,
    ) -> Result<Vec<CountRecord>, Interrupted<Vec<CountRecord>>> {
        let mut done = Vec::new();
        while done.len() < bins {
            if self.fail_after == Some(self.next) && !self.state.lock().unwrap().failed {
                self.state.lock().unwrap().failed = true;
                let error = DeviceError::NotReady { device: "fake", reason: "it vanished" };
                return Err(Interrupted::new(done, error));
            }
            let start = self.clock.utc();
            self.clock.clock.sleep(Duration::from_nanos((self.bin_ps / 1000).unsigned_abs()));
            let i = self.next;
            self.next += 1;
            done.push(CountRecord {
                start,
                start_ps: i as i64 * self.bin_ps,
                length_ps: self.bin_ps,
                counts: vec![i, 2 * i, 3 * i],
                missed: vec![0; 3],
                flags: CountFlags::empty(),
            });
        }
        Ok(done)
    }
    fn stop(&mut self, _: &Deadline) -> Result<(), DeviceError> {
        Ok(())
    }
}

/// A number above zero.
pub fn positive(number: f64) -> Positive {
    Positive::new(number).unwrap()
}
