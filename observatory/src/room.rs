//! The disk's room, and who gets the last of it: the log and the bins of the counters, then frames, then raw tags.

use super::plan::{CameraPlan, CounterPlan};
use super::preflight::{COLUMN_BYTES, FRAME_BYTES, ROW_BYTES};
use super::status::free_bytes;
use hifitime::Epoch;
use std::path::PathBuf;
use std::time::{Duration, Instant};
use sunglint_formats::toml::Positive;

/// How often the system is asked.
const ASK: Duration = Duration::from_millis(200);
/// Bytes of the log in a second: marks of what is safe, four times, for the log and for each device.
const MARKS: f64 = 4.0 * 130.0;
/// Bytes that the end of a night may take, and its surprises.
const LEAST: f64 = 262_144.0;
/// A forecast is taken so much larger.
const MARGIN: f64 = 1.2;
/// A night without an end is thought to go on for so long, s.
const OPEN_S: f64 = 3600.0;

/// The data to be written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bulk {
    /// A frame.
    Frame,
    /// Raw tags.
    Tags,
}

/// The room of a night's disk.
#[derive(Debug)]
pub struct Room {
    folder: PathBuf,
    start: Epoch,
    end: Option<Epoch>,
    /// Bytes a second of the log and the counters' bins.
    rows_per_s: f64,
    /// Bytes a second of the frames, as far as the plan says their size.
    frames_per_s: f64,
    asked: Option<Instant>,
    free: Option<u64>,
}

impl Room {
    /// The room below a folder for a night with these devices, from then to then.
    pub fn new(
        folder: PathBuf,
        (start, end): (Epoch, Option<Epoch>),
        cameras: &[CameraPlan],
        counters: &[CounterPlan],
    ) -> Self {
        let row = |plan: &CounterPlan| {
            (ROW_BYTES + 2.0 * COLUMN_BYTES * plan.channels.len() as f64) / plan.bin_s.get()
        };
        let devices = 1 + cameras.len() + counters.len();
        let rows_per_s = counters.iter().map(row).sum::<f64>() + MARKS * devices as f64;
        // A frame's size is known where the plan has a window; of the others each frame that comes tells.
        let frame = |plan: &CameraPlan| {
            let [_, _, columns, rows] = plan.window_px.unwrap_or_default();
            let binning = f64::from(plan.binning.unwrap_or(1).max(1));
            let pixels = f64::from(columns) * f64::from(rows) / (binning * binning);
            let every_s = plan.interval_s.map_or(plan.exposure_s.get(), Positive::get);
            (2.0 * pixels + FRAME_BYTES) / every_s.max(0.01)
        };
        let frames_per_s = cameras.iter().map(frame).sum();
        Self { folder, start, end, rows_per_s, frames_per_s, asked: None, free: None }
    }

    /// Bytes that are kept from such data at a time of the night.
    fn kept(&self, bulk: Bulk, now: Epoch) -> f64 {
        let left_s =
            self.end.map_or(OPEN_S, |end| (end - now.max(self.start)).to_seconds().max(0.0));
        let rows = LEAST + MARGIN * self.rows_per_s * left_s;
        match bulk {
            Bulk::Frame => rows,
            Bulk::Tags => rows + MARGIN * self.frames_per_s * left_s,
        }
    }

    /// Whether there is room for so many bytes of such data, once the rest of the night has what comes before it. If there is, it is taken.
    ///
    /// # Errors
    /// There is not: the bytes that are free, and those that are kept.
    pub fn take(&mut self, bulk: Bulk, bytes: u64, now: Epoch) -> Result<(), (u64, u64)> {
        if self.asked.is_none_or(|asked| asked.elapsed() >= ASK) {
            self.asked = Some(Instant::now());
            self.free = free_bytes(&self.folder);
        }
        // Where the system does not say, the disk itself will.
        let Some(free) = self.free else { return Ok(()) };
        let kept = self.kept(bulk, now);
        if (free as f64) < kept + bytes as f64 {
            return Err((free, kept as u64));
        }
        self.free = Some(free.saturating_sub(bytes));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;
    use sunglint_formats::time::parse_utc;

    /// Truth: by hand: 10 bins a second of two channels and 1000 s make 1000 · 10 · (ROW_BYTES + 4 COLUMN_BYTES) bytes, the log of two devices
    /// 1000 · 3 · 520; both 1.2 times, and 256 KiB. Tags leave as much as the frames of 100 × 100 pixels in every second, too.
    #[test]
    fn bins_come_first_then_frames() {
        let at = parse_utc("2026-11-21T18:00:00Z").unwrap();
        let end = at + hifitime::Duration::from_seconds(1000.0);
        let bin_s = Positive::new(0.1).unwrap();
        let mut counter = CounterPlan::plain("c".into(), "sim".into(), bin_s);
        counter.channels = BTreeMap::from([("g".into(), 1), ("r".into(), 2)]);
        let mut camera = CameraPlan::plain("cam".into(), "sim".into(), Positive::new(1.0).unwrap());
        camera.window_px = Some([0, 0, 100, 100]);
        let mut room = Room::new("/nowhere".into(), (at, Some(end)), &[camera], &[counter]);
        let rows = 1e4 * (ROW_BYTES + 4.0 * COLUMN_BYTES) + 1000.0 * 3.0 * 520.0;
        let rows = 1.2 * rows + 262_144.0;
        assert!((room.kept(Bulk::Frame, at) - rows).abs() < 1.0);
        let frames = 1.2 * 1000.0 * (20_000.0 + FRAME_BYTES);
        assert!((room.kept(Bulk::Tags, at) - rows - frames).abs() < 1.0);
        // Nothing is kept behind the end but what that takes.
        assert!((room.kept(Bulk::Tags, end) - 262_144.0).abs() < 1.0);
        // A disk that says nothing refuses nothing.
        assert_eq!(room.take(Bulk::Frame, u64::MAX, at), Ok(()));
        room.free = Some(rows as u64 + 50_000);
        room.asked = Some(Instant::now());
        assert!(room.take(Bulk::Tags, 16, at).is_err());
        assert_eq!(room.take(Bulk::Frame, 40_000, at), Ok(()));
        assert!(room.take(Bulk::Frame, 40_000, at).is_err());
    }
}
