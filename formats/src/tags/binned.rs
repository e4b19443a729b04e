//! Counts in bins.

use super::TagError;
use super::bin::{Binning, Dropping, Piece};
use crate::{CountFlags, CountRecord, CountSeries, Meta};
use hifitime::{Duration, Epoch};

/// Where the bins lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Bins {
    pub(super) from_ps: i64,
    pub(super) to_ps: i64,
    /// At least 1 and at most `i64::MAX`, ps.
    pub(super) width: u64,
    pub(super) count: usize,
}

impl Bins {
    /// The bin of a time.
    pub(super) fn of(&self, time_ps: i64) -> Option<usize> {
        let inside = (self.from_ps..self.to_ps).contains(&time_ps);
        inside.then(|| (time_ps.abs_diff(self.from_ps) / self.width) as usize)
    }

    /// Start of a bin, ps; it is before the end of the span, so that it is an i64.
    pub(super) fn start(&self, bin: usize) -> i64 {
        self.from_ps.wrapping_add_unsigned(bin as u64 * self.width)
    }

    /// Length of the bin that starts at `start`, ps: the width, or what is left of the span.
    pub(super) fn length(&self, start: i64) -> u64 {
        self.width.min(self.to_ps.abs_diff(start))
    }

    /// The first and the last bin that have a moment in common with the closed interval between two times.
    pub(super) fn touched(&self, one_ps: i64, other_ps: i64) -> Option<(usize, usize)> {
        let (first, last) = (one_ps.min(other_ps), one_ps.max(other_ps));
        if last < self.from_ps || first >= self.to_ps {
            return None;
        }
        Some((self.of(first.max(self.from_ps))?, self.of(last.min(self.to_ps - 1))?))
    }
}

/// Sums of the counts from all pieces.
pub(super) struct Sums<'a> {
    binning: &'a Binning,
    counts: Vec<u64>,
    missed: Vec<u64>,
    flags: Vec<CountFlags>,
    /// At each bin, how many overflows start there less how many ended with the bin before: one step for an overflow,
    /// however many bins it covers. Empty without overflows.
    steps: Vec<i64>,
    dropping: Dropping,
}

impl<'a> Sums<'a> {
    pub(super) fn new(binning: &'a Binning) -> Self {
        let cells = binning.bins.count * binning.channels.len();
        Self {
            binning,
            counts: vec![0; cells],
            missed: vec![0; cells],
            flags: vec![CountFlags::empty(); binning.bins.count],
            steps: Vec::new(),
            dropping: Dropping::NotSince(i64::MIN),
        }
    }

    /// Adds the piece that follows those before.
    pub(super) fn add(&mut self, piece: &Piece<'_>) {
        let channels = self.binning.channels.len();
        for (bin, row) in piece.rows() {
            let counts = &mut self.counts[bin * channels..(bin + 1) * channels];
            for (count, more) in counts.iter_mut().zip(row) {
                *count += more;
            }
        }
        for &(bin, slot, missed) in &piece.missed {
            self.missed[bin * channels + slot] += u64::from(missed);
            self.flags[bin] |= CountFlags::MISSED;
        }
        for &bin in &piece.errors {
            self.flags[bin] |= CountFlags::ERROR;
        }
        for &(first, last) in &piece.overflows {
            self.overflow(first, last);
        }
        // The first overflow record of the piece meets what the pieces before it left open.
        if let Some((begins, time_ps)) = piece.first {
            let since = match (self.dropping, begins) {
                (Dropping::NotSince(_), true) => None,
                (Dropping::Since(since), _) | (Dropping::NotSince(since), false) => Some(since),
            };
            if let Some(since) = since {
                self.overflow_between(since, time_ps);
            }
        }
        if let Some(last) = piece.last {
            self.dropping = last;
        }
    }

    fn overflow_between(&mut self, one_ps: i64, other_ps: i64) {
        if let Some((first, last)) = self.binning.bins.touched(one_ps, other_ps) {
            self.overflow(first, last);
        }
    }

    fn overflow(&mut self, first: usize, last: usize) {
        self.steps.resize(self.binning.bins.count + 1, 0);
        self.steps[first] += 1;
        self.steps[last + 1] -= 1;
    }

    pub(super) fn finish(mut self) -> Binned {
        if let Dropping::Since(since) = self.dropping {
            self.overflow_between(since, i64::MAX);
        }
        let mut open = 0;
        // Without overflows there are no steps, and nothing is touched.
        for (flags, step) in self.flags.iter_mut().zip(&self.steps) {
            open += step;
            flags.set(CountFlags::OVERFLOW, open > 0);
        }
        let bins = self.binning.bins;
        if let Some(flags) = self.flags.last_mut() {
            flags.set(CountFlags::PARTIAL, bins.length(bins.start(bins.count - 1)) < bins.width);
        }
        Binned {
            channels: self.binning.channels.clone(),
            bins,
            counts: self.counts,
            missed: self.missed,
            flags: self.flags,
        }
    }
}

/// Counts of each bin and channel, with what is known to be wrong with them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Binned {
    channels: Vec<i32>,
    bins: Bins,
    counts: Vec<u64>,
    missed: Vec<u64>,
    flags: Vec<CountFlags>,
}

impl Binned {
    /// The channels, in the order of [`Binned::counts`].
    pub fn channels(&self) -> &[i32] {
        &self.channels
    }

    /// How many bins there are.
    pub fn bins(&self) -> usize {
        self.bins.count
    }

    /// Start of a bin on the counter's clock, ps (inclusive).
    ///
    /// # Panics
    /// If there is no such bin.
    pub fn start_ps(&self, bin: usize) -> i64 {
        assert!(bin < self.bins.count, "bin {bin} of {}", self.bins.count);
        self.bins.start(bin)
    }

    /// Length of a bin, ps: the width, but for a last one that the end of the span cuts.
    ///
    /// # Panics
    /// If there is no such bin.
    pub fn length_ps(&self, bin: usize) -> i64 {
        self.bins.length(self.start_ps(bin)) as i64
    }

    /// The tags of each channel in a bin.
    ///
    /// # Panics
    /// If there is no such bin.
    pub fn counts(&self, bin: usize) -> &[u64] {
        &self.counts[bin * self.channels.len()..][..self.channels.len()]
    }

    /// The events of each channel that the counter, in this bin, said it missed.
    ///
    /// # Panics
    /// If there is no such bin.
    pub fn missed(&self, bin: usize) -> &[u64] {
        &self.missed[bin * self.channels.len()..][..self.channels.len()]
    }

    /// Returns the flags of a bin: all that is known to be wrong with it.
    ///
    /// # Panics
    /// If there is no such bin.
    pub fn flags(&self, bin: usize) -> CountFlags {
        self.flags[bin]
    }

    /// The tags of each channel in all bins.
    pub fn totals(&self) -> Vec<u64> {
        let mut totals = vec![0; self.channels.len()];
        for counts in self.counts.chunks_exact(self.channels.len()) {
            for (total, count) in totals.iter_mut().zip(counts) {
                *total += count;
            }
        }
        totals
    }

    /// The bins as a series: `zero` is the epoch at which the counter's clock stood at 0 ps (starts are rounded to the
    /// nearest ns, their exact time stays in `start_ps`), `names` are the names of the channels, `always` are flags that
    /// hold for all bins, such as [`CountFlags::CLOCK_FREE`] where `zero` comes from a computer's clock.
    ///
    /// # Errors
    /// [`TagError::Names`] unless there is a name for each channel.
    pub fn to_series(
        &self,
        zero: Epoch,
        names: &[&str],
        always: CountFlags,
    ) -> Result<CountSeries, TagError> {
        if names.len() != self.channels.len() {
            let (names, channels) = (names.len(), self.channels.len());
            return Err(TagError::Names { names, channels });
        }
        let record = |bin| {
            let start_ps = self.start_ps(bin);
            let start_ns = (i128::from(start_ps) + 500).div_euclid(1_000);
            CountRecord {
                start: zero + Duration::from_total_nanoseconds(start_ns),
                start_ps,
                length_ps: self.length_ps(bin),
                counts: self.counts(bin).to_vec(),
                missed: self.missed(bin).to_vec(),
                flags: self.flags(bin) | always,
            }
        };
        let mut meta = Meta::new();
        meta.insert("tag_channels".into(), self.channels.clone().into());
        Ok(CountSeries {
            channels: names.iter().map(|&name| name.to_owned()).collect(),
            records: (0..self.bins.count).map(record).collect(),
            meta,
        })
    }
}
