//! Stretches of samples without a gap.

use hifitime::Epoch;
use std::ops::Range;
use sunglint_formats::time::tai_nanoseconds;
use sunglint_numerics::order::median;

/// A gap of more than so many steps (and of a minute) parts one track from the next.
const GAP_STEPS: f64 = 20.0;
const GAP_S: f64 = 60.0;
/// More tracks than these are drawn on one axis.
const MOST_TRACKS: usize = 4;

/// A stretch of samples without a gap.
#[derive(Debug, Clone)]
pub struct Track {
    /// Samples of the track.
    pub samples: Range<usize>,
    /// The first moment.
    pub from: Epoch,
    /// The last moment.
    pub to: Epoch,
}

/// The usual distance of moments that increase, s: their median; 1 of a single one.
pub fn usual_step_s(times_s: &[f64]) -> f64 {
    median(times_s.windows(2).map(|p| p[1] - p[0]).filter(|s| *s > 0.0)).unwrap_or(1.0)
}

fn seconds(epoch: Epoch) -> f64 {
    tai_nanoseconds(epoch) as f64 * 1e-9
}

/// The tracks of a pass; one of all samples where the times do not increase or there are too many gaps.
pub fn tracks(times: &[Epoch]) -> Vec<Track> {
    let all: Vec<f64> = times.iter().map(|t| seconds(*t)).collect();
    let gap_s = GAP_S.max(GAP_STEPS * usual_step_s(&all));
    let mut starts = vec![0];
    starts.extend((1..all.len()).filter(|i| (all[*i] - all[*i - 1]).abs() > gap_s));
    if starts.len() > MOST_TRACKS || all.windows(2).any(|p| p[1] < p[0]) {
        starts.truncate(1);
    }
    let ends = starts.iter().skip(1).copied().chain([times.len()]);
    let track = |(from, to): (usize, usize)| {
        let (first, last) = (times[from], times[to - 1]);
        Track { samples: from..to, from: first, to: last }
    };
    starts.iter().copied().zip(ends).filter(|(a, b)| a < b).map(track).collect()
}
