//! Helpers that the tests of the Time Tagger share: a known light, a session, words for how it ended.
#![allow(dead_code, clippy::unwrap_used, reason = "each test uses its part")]

use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Clock, Deadline};
use sunglint_drivers::device::{Device as _, DeviceError, PhotonCounter as _};
use sunglint_drivers::simulated::swabian::{Light, LightBin};
use sunglint_drivers::swabian::{Channel, TaggerSettings, TimeTagger};
use sunglint_drivers::tags::{Tag, TagWriter};
use sunglint_drivers::transport::{Bytes, TransportError};
use sunglint_formats::CountRecord;

/// 0.1 s.
pub const BIN_PS: i64 = 100_000_000_000;

/// Counts that anybody can compute: a hash (splitmix64) of the bin's start and the channel.
pub fn count(start_ps: i64, channel: i32) -> u64 {
    let mut z = (start_ps as u64).wrapping_add(channel as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (z ^ (z >> 31)) % 100_000
}

/// Light whose bins are [`count`], and which sends a tag every millisecond, on the channels in turn.
#[derive(Debug, Clone)]
pub struct Known;

impl Light for Known {
    fn tags(&mut self, channels: &[i32], from_ps: i64, to_ps: i64, into: &mut Vec<Tag>) {
        let every = 1_000_000_000;
        let mut time = from_ps + (-from_ps).rem_euclid(every);
        while time < to_ps {
            let channel = channels[(time / every).rem_euclid(channels.len() as i64) as usize];
            into.push(Tag::photon(channel, time));
            time += every;
        }
    }

    fn bin(&mut self, channels: &[i32], start_ps: i64, _: i64) -> LightBin {
        let counts = channels.iter().map(|channel| count(start_ps, *channel)).collect();
        LightBin { counts, missed: vec![0; channels.len()], ..LightBin::default() }
    }
}

pub fn settings() -> TaggerSettings {
    let channel = |name: &str, number| Channel { name: name.into(), number };
    let channels = vec![channel("g", 1), channel("r", 2), channel("i", -3)];
    TaggerSettings { channels, reply_within: Duration::from_secs(1), ..TaggerSettings::default() }
}

/// `1767 (g) 3 (r) …, flags`.
pub fn told(record: &CountRecord) -> String {
    format!("{:?} missed {:?} {}", record.counts, record.missed, flags(record))
}

fn flags(record: &CountRecord) -> String {
    let names = record.flags.iter_names().map(|(name, _)| name).filter(|n| *n != "CLOCK_FREE");
    names.collect::<Vec<_>>().join("+")
}

/// Runs the session of every case: open, set, count five bins, stop, take tags for 60 ms. Returns how that ended, in words.
pub fn session(line: impl Bytes, clock: &Arc<dyn Clock>) -> String {
    let within = |ms| Deadline::after(clock.clone(), Duration::from_millis(ms));
    let mut tagger = match TimeTagger::open(line, settings(), &within(2000)) {
        Ok(tagger) => tagger,
        Err(error) => return format!("open: {}", words(&error)),
    };
    let set = tagger
        .set_trigger_level_v(1, 0.1234, &within(2000))
        .and_then(|_| tagger.set_dead_time_ps(0, 1, &within(2000)))
        .and_then(|_| tagger.settings(&within(2000)))
        .and_then(|_| tagger.start(BIN_PS, &within(2000)));
    if let Err(error) = set {
        return format!("set: {}", words(&error));
    }
    let mut end = match tagger.read(5, &within(2000)) {
        Ok(records) => records.iter().map(told).collect::<Vec<_>>().join("; "),
        Err(interrupted) => {
            let done = interrupted.done.len();
            return format!("after {done} bins: {}", words(&interrupted.error));
        }
    };
    let started = tagger.stop(&within(2000)).and_then(|()| tagger.start_tags(&within(2000)));
    if let Err(error) = started {
        return format!("{end}; tags: {}", words(&error));
    }
    let folder = tempfile::tempdir().unwrap();
    let mut writer = TagWriter::create(folder.path().join("raw.tags")).unwrap();
    match tagger.record(&mut writer, Duration::from_millis(60), &within(2000)) {
        Ok(tags) => {
            end += &format!(
                "; {} records, {} photons, {} overflows, {} missed, {} errors, {} unsorted",
                tags.records, tags.photons, tags.overflows, tags.missed, tags.errors, tags.unsorted
            );
        }
        Err(interrupted) => return format!("{end}; tags: {}", words(&interrupted.error)),
    }
    match tagger.stop(&within(2000)) {
        Ok(()) => end,
        Err(error) => format!("{end}; stop: {}", words(&error)),
    }
}

/// The error, without the times that a real clock would change.
pub fn words(error: &DeviceError) -> String {
    match error {
        DeviceError::Transport { source: TransportError::Timeout { .. }, .. } => "no answer".into(),
        DeviceError::Transport { source: TransportError::Disconnected { .. }, .. } => "gone".into(),
        other => other.to_string(),
    }
}
