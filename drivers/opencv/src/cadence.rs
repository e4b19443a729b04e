//! Frames that were lost, and frames that came twice.

use crate::sidecar::Sidecar;
use hifitime::Epoch;
use ndarray::Array2;

/// Slower frames are asked for one by one; between them nothing is lost, s.
const SLOWEST_S: f64 = 1.0;
/// A longer gap is a break, frames.
const LONGEST: f64 = 50.0;
/// Part of an interval by which two are still the same, and part of all intervals that must be.
const SAME: f64 = 0.1;
const REGULAR: f64 = 0.8;

/// Counts of frames that are not there, or not of their time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Losses {
    /// Frames that the times lack.
    pub lost: u64,
    /// Frames whose pixels are those of the one before, each of them.
    pub doubled: u64,
}

/// Watch over the times and pixels of frames in a row.
#[derive(Debug, Default)]
pub(crate) struct Cadence {
    /// From a frame to the next, s, if they come evenly.
    interval_s: Option<f64>,
    last_s: Option<f64>,
    last: Option<Array2<u16>>,
    pub losses: Losses,
}

impl Cadence {
    pub fn new(interval_s: Option<f64>) -> Self {
        let interval_s = interval_s.filter(|interval_s| *interval_s <= SLOWEST_S);
        Self { interval_s, ..Self::default() }
    }

    /// A frame that stands at this time, s, on any clock that runs evenly.
    pub fn came(&mut self, at_s: f64) {
        if let (Some(interval_s), Some(last_s)) = (self.interval_s, self.last_s) {
            let steps = ((at_s - last_s) / interval_s).round();
            if (2.0..=LONGEST).contains(&steps) {
                self.losses.lost += steps as u64 - 1;
            }
        }
        self.last_s = Some(at_s);
    }

    /// Whether a frame repeats the one before. Where all pixels are equal, two frames may be the same by themselves.
    pub fn is_doubled(&mut self, pixels: &Array2<u16>) -> bool {
        let first = pixels.first();
        let plain = pixels.iter().all(|pixel| Some(pixel) == first);
        let doubled = !plain && self.last.as_ref() == Some(pixels);
        if doubled {
            self.losses.doubled += 1;
        } else {
            self.last = Some(pixels.clone());
        }
        doubled
    }
}

/// Seconds between two times.
pub(crate) fn since_s(first: Epoch, then: Epoch) -> f64 {
    (then - first).to_seconds()
}

/// The interval of a table's frames, s: the median, if most are that.
pub(crate) fn interval_s(table: &Sidecar) -> Option<f64> {
    let steps = table.rows.windows(2).map(|two| since_s(two[0].start, two[1].start));
    let mut steps: Vec<f64> = steps.filter(|step| *step > 0.0).collect();
    steps.sort_by(f64::total_cmp);
    let median = *steps.get(steps.len() / 2)?;
    let same = steps.iter().filter(|step| (*step - median).abs() <= SAME * median).count();
    (same as f64 >= REGULAR * steps.len() as f64).then_some(median)
}
