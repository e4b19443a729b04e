//! Counting tags in bins as they come: finished bins only.

use super::TagError;
use super::bin::Slots;
use super::tag::{RECORD_BYTES, Tag, TagKind, Tags};
use crate::CountFlags;
use std::collections::BTreeMap;

/// A bin that is over.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FinishedBin {
    /// Start on the counter's clock, ps.
    pub start_ps: i64,
    /// Tags of each channel.
    pub counts: Vec<u64>,
    /// Events of each channel that the counter says it missed.
    pub missed: Vec<u64>,
    /// `OVERFLOW`, `MISSED`, `ERROR`: what they mean is said in [the module](super).
    pub flags: CountFlags,
}

/// Counts a stream of tags in bins that follow each other from a first one on, each given once it is over.
///
/// It does what [`Tags::bin`] does for tags that are all there, to the tag. What differs is only what comes too late, for a bin
/// that was given already: missed events are booked in the next bin, so that their sum stays right; an overflow flags the bins from
/// there on; a time tag is counted nowhere ([`late`](Self::late)), and the next bin carries `ERROR`, since a clock that goes back is not
/// one clock. Memory grows with the bins that are met and not over, never with the time between two tags.
#[derive(Debug, Clone)]
pub struct BinStream {
    slots: Slots,
    channels: usize,
    width_ps: i64,
    /// Start of the first bin that was not given.
    next_ps: i64,
    /// By their starts, those in which something lies; all but the present one.
    open: BTreeMap<i64, FinishedBin>,
    /// The bin of the last tag.
    present: Option<FinishedBin>,
    /// An overflow began then and has not ended, ps.
    dropping_since_ps: Option<i64>,
    /// When the last one ended, ps.
    ended_ps: i64,
    /// Overflows that ended and reach into bins that were not given, ps (closed intervals).
    overflows: Vec<(i64, i64)>,
    late: u64,
    late_here: bool,
}

impl BinStream {
    /// Bins of `width_ps` from `from_ps` on, ps on the counter's clock, for `channels`.
    ///
    /// # Errors
    /// [`TagError::Width`] and [`TagError::Channels`] for what makes no sense.
    pub fn new(channels: &[i32], width_ps: i64, from_ps: i64) -> Result<Self, TagError> {
        if width_ps <= 0 {
            return Err(TagError::Width { width_ps });
        }
        let twice = channels.iter().enumerate().any(|(i, c)| channels[..i].contains(c));
        if channels.is_empty() || twice {
            return Err(TagError::Channels { channels: channels.to_vec() });
        }
        Ok(Self {
            slots: Slots::new(channels),
            channels: channels.len(),
            width_ps,
            next_ps: from_ps,
            open: BTreeMap::new(),
            present: None,
            dropping_since_ps: None,
            ended_ps: i64::MIN,
            overflows: Vec::new(),
            late: 0,
            late_here: false,
        })
    }

    /// Where the next bin begins, ps.
    pub fn next_ps(&self) -> i64 {
        self.next_ps
    }

    /// How many time tags of the channels came after their bin was given: they are in no bin.
    pub fn late(&self) -> u64 {
        self.late
    }

    /// Takes the tags that come next.
    pub fn add(&mut self, tags: Tags<'_>) {
        for record in tags.records() {
            self.add_one(record);
        }
    }

    fn add_one(&mut self, record: &[u8; RECORD_BYTES]) {
        let tag = Tag::from_bytes(record);
        let slot = self.slots.of(tag.channel);
        match tag.kind() {
            Some(TagKind::TimeTag) if slot < self.channels => {
                if tag.time_ps < self.next_ps {
                    self.late += 1;
                    self.late_here = true;
                } else if let Some(bin) = self.bin_of(tag.time_ps) {
                    bin.counts[slot] += 1;
                }
            }
            Some(TagKind::MissedEvents) if slot < self.channels && tag.missed > 0 => {
                if let Some(bin) = self.bin_of(tag.time_ps) {
                    bin.missed[slot] += u64::from(tag.missed);
                    bin.flags |= CountFlags::MISSED;
                }
            }
            Some(TagKind::Error) => {
                if let Some(bin) = self.bin_of(tag.time_ps) {
                    bin.flags |= CountFlags::ERROR;
                }
            }
            // A second beginning: the first one stands.
            Some(TagKind::OverflowBegin) => {
                self.dropping_since_ps.get_or_insert(tag.time_ps);
            }
            // An end without its beginning: something was lost since the end before.
            Some(TagKind::OverflowEnd) => {
                let since = self.dropping_since_ps.take().unwrap_or(self.ended_ps);
                self.ended_ps = tag.time_ps;
                let (first, last) = (since.min(tag.time_ps), since.max(tag.time_ps));
                // One that is told too late flags the next bin.
                self.overflows.push((first, last.max(self.next_ps)));
            }
            Some(TagKind::TimeTag | TagKind::MissedEvents) | None => {}
        }
    }

    /// The bin of a time, or the next where that was given; `None` at the end of time.
    fn bin_of(&mut self, time_ps: i64) -> Option<&mut FinishedBin> {
        let time_ps = time_ps.max(self.next_ps);
        let inside = |bin: &FinishedBin| {
            time_ps >= bin.start_ps && time_ps.abs_diff(bin.start_ps) < self.width_ps.unsigned_abs()
        };
        if !self.present.as_ref().is_some_and(inside) {
            let width = self.width_ps.unsigned_abs();
            let since = time_ps.abs_diff(self.next_ps);
            let start_ps = time_ps.checked_sub_unsigned(since % width)?;
            start_ps.checked_add(self.width_ps)?;
            let entered = self.open.remove(&start_ps).unwrap_or_else(|| self.empty(start_ps));
            if let Some(left) = self.present.replace(entered) {
                self.open.insert(left.start_ps, left);
            }
        }
        self.present.as_mut()
    }

    fn empty(&self, start_ps: i64) -> FinishedBin {
        let zeros = vec![0; self.channels];
        let flags = CountFlags::empty();
        FinishedBin { start_ps, counts: zeros.clone(), missed: zeros, flags }
    }

    /// The next bin, if it is over at `until_ps`: up to there (exclusive) all tags have come. Ask until there is none.
    pub fn finished(&mut self, until_ps: i64) -> Option<FinishedBin> {
        let start_ps = self.next_ps;
        let end_ps = start_ps.checked_add(self.width_ps).filter(|end| *end <= until_ps)?;
        let mut bin = match self.present.take_if(|bin| bin.start_ps == start_ps) {
            Some(bin) => bin,
            None => self.open.remove(&start_ps).unwrap_or_else(|| self.empty(start_ps)),
        };
        let touched = self.dropping_since_ps.is_some_and(|since| since < end_ps)
            || self.overflows.iter().any(|(from, to)| *from < end_ps && *to >= start_ps);
        bin.flags.set(CountFlags::OVERFLOW, touched);
        if std::mem::take(&mut self.late_here) {
            bin.flags |= CountFlags::ERROR;
        }
        self.next_ps = end_ps;
        self.overflows.retain(|(_, to)| *to >= end_ps);
        Some(bin)
    }
}
