//! A night of glints that are shorter than its bins, photon by photon, with its tags.

#![allow(dead_code, reason = "each test binary uses its part")]
#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use std::path::Path;
use std::sync::Arc;
use sunglint_drivers::tags::Tag;
use sunglint_formats::session::{
    ClockState, Device, DeviceKind, Disk, FORMAT, Manifest, Session, SessionWriter, Target,
    TargetKind, What,
};
use sunglint_formats::{CountFlags, CountRecord};
use sunglint_virtual::observatory::events::{DeadTime, Detector};

use super::night::at;

const BIN_PS: i64 = 100_000_000_000;
const SECOND_PS: i64 = 1_000_000_000_000;
/// Sky until here, Vega after it, s.
pub const TARGET_FROM_S: f64 = 10.0;
pub const SECONDS: i64 = 30;
const SKY_HZ: f64 = 200.0;
const STEADY_HZ: f64 = 1000.0;
const PEAK_HZ: f64 = 5e4;
const GLINT_S: f64 = 0.008;

/// Rate that arrives of the target in the bin of a glint, and in any other, Hz.
pub fn truth_hz(glint: bool) -> f64 {
    let glint_hz = PEAK_HZ * GLINT_S * std::f64::consts::TAU.sqrt() / 0.1;
    if glint { STEADY_HZ + glint_hz } else { STEADY_HZ }
}

fn light_hz(t: f64) -> f64 {
    if t < TARGET_FROM_S {
        return SKY_HZ;
    }
    // One each second, in the middle of a bin.
    let off = (t.fract() - 0.55) / GLINT_S;
    SKY_HZ + STEADY_HZ + PEAK_HZ * (-0.5 * off * off).exp()
}

/// Tags, in order, and bins of the counters id400 (input 1, dead for 10 µs) and spcm (input 2, 22 ns).
pub struct Tagged {
    pub tags: Vec<Tag>,
    pub bins: Vec<CountRecord>,
    pub inputs: Vec<i32>,
    /// Bytes that follow the last whole record.
    pub tail: Vec<u8>,
}

impl Tagged {
    pub fn new(seed: u64) -> Self {
        let mut bins: Vec<CountRecord> = (0..SECONDS * 10)
            .map(|i| CountRecord {
                start: at(i as f64 / 10.0),
                start_ps: i * BIN_PS,
                length_ps: BIN_PS,
                counts: vec![0; 2],
                missed: vec![0; 2],
                flags: CountFlags::empty(),
            })
            .collect();
        let mut tags = Vec::new();
        for (column, (dead_time_s, dark_rate_hz)) in
            [(1e-5, 756.0), (22e-9, 825.0)].into_iter().enumerate()
        {
            let detector = Detector {
                dead_time: DeadTime::NonParalysable { dead_time_s },
                dark_rate_hz,
                afterpulsing: None,
            };
            let span = 0..SECONDS * SECOND_PS;
            for time_ps in detector.tags(seed + column as u64, span, 500_000_000, light_hz) {
                bins[(time_ps / BIN_PS) as usize].counts[column] += 1;
                tags.push(Tag::photon(column as i32 + 1, time_ps));
            }
        }
        tags.sort_by_key(|tag| tag.time_ps);
        Self { tags, bins, inputs: vec![1, 2], tail: Vec::new() }
    }

    /// Writes the session.
    pub fn session(&self, root: &Path) -> Session {
        let device = Device {
            name: "tagger".into(),
            kind: DeviceKind::Counter,
            address: "sim".into(),
            options: vec![],
            channels: vec!["id400".into(), "spcm".into()],
            inputs: self.inputs.clone(),
            raw_tags: true,
            exposure_s: 0.1,
            interval_s: None,
            filter: None,
        };
        let clock =
            ClockState { method: "none".into(), synchronised: None, offset_s: None, error_s: None };
        let manifest = Manifest {
            format: FORMAT.into(),
            program: "a test".into(),
            station: "ufo".into(),
            start_utc: at(0.0),
            clock,
            devices: vec![device],
            files: vec![],
        };
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
        writer.event(at(TARGET_FROM_S), What::Target(star));
        for bin in &self.bins {
            writer.count("tagger", bin).unwrap();
        }
        let bytes: Vec<u8> = self.tags.iter().flat_map(Tag::to_bytes).collect();
        for some in bytes.chunks(1 << 16) {
            assert!(writer.tags(at(0.0), "tagger", some).unwrap());
            assert!(writer.sync(at(0.0)).is_empty());
        }
        assert_eq!(writer.finish(at(SECONDS as f64), "done").lost, 0);
        let session = Session::open(root).unwrap();
        if !self.tail.is_empty() {
            let path = session.tags("tagger").unwrap().unwrap();
            let whole = std::fs::read(&path).unwrap();
            std::fs::write(&path, [&whole[..], &self.tail].concat()).unwrap();
        }
        session
    }
}
