//! Contents of a recording, and what is odd about them.

use super::tag::{RECORD_BYTES, Tag, TagKind, Tags};
use std::collections::BTreeMap;

/// Number of oddities of each kind that are listed with their places; all are counted.
pub const MOST_LISTED: usize = 16;

/// Virtual channels that are kept apart; a real counter has some dozens, a damaged file may seem to have billions.
const MOST_CHANNELS: usize = 1024;

/// Options of a check: the oddities to look for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CheckOptions {
    /// List silences (of all channels together) longer than this, ps. `None` lists none; the longest is told anyway.
    pub gap_ps: Option<u64>,
}

/// A time without any tag.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Gap {
    /// The last tag before it, ps.
    pub from_ps: i64,
    /// The first tag after it, ps.
    pub to_ps: i64,
}

impl Gap {
    /// Returns the length of the recording, ps.
    pub fn length_ps(&self) -> u64 {
        self.to_ps.abs_diff(self.from_ps)
    }
}

/// An interval in which the counter dropped events.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Overflow {
    /// When it began, ps; `None` if the file holds no beginning.
    pub begin_ps: Option<i64>,
    /// When it ended, ps; `None` if the file holds no end.
    pub end_ps: Option<i64>,
}

/// Report on the tags of one channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ChannelReport {
    /// Time tags.
    pub tags: u64,
    /// Events that the counter says it missed.
    pub missed: u64,
    /// Time tags at the very time of the channel's tag before: two photons in one picosecond, or one that was written
    /// twice.
    pub duplicates: u64,
    /// The channel's tag before, ps.
    last_ps: Option<i64>,
}

/// Contents of a recording. All places are numbers of records, counted from 0; a record begins at byte 16 × its number.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Report {
    /// All records.
    pub records: u64,
    /// The channels that were met, by number.
    pub channels: BTreeMap<i32, ChannelReport>,
    /// Tags on channels beyond the first 1,024 virtual ones: the file is damaged.
    pub other_tags: u64,
    /// Time of the first record, ps.
    pub first_ps: Option<i64>,
    /// Time of the last record, ps.
    pub last_ps: Option<i64>,
    /// The earliest time of a record, ps.
    pub earliest_ps: Option<i64>,
    /// The latest time of a record, ps.
    pub latest_ps: Option<i64>,
    /// Records that are earlier than the one before them.
    pub unsorted: u64,
    /// The first of them.
    pub unsorted_at: Vec<u64>,
    /// All duplicates (see [`ChannelReport::duplicates`]).
    pub duplicates: u64,
    /// The first of them.
    pub duplicates_at: Vec<u64>,
    /// Records of a type that is not defined.
    pub unknown: u64,
    /// The first of them.
    pub unknown_at: Vec<u64>,
    /// Records whose reserved byte is not 0.
    pub reserved: u64,
    /// The first of them.
    pub reserved_at: Vec<u64>,
    /// Errors that the counter reported.
    pub errors: u64,
    /// The first of them.
    pub errors_at: Vec<u64>,
    /// Intervals in which the counter dropped events.
    pub overflows: u64,
    /// The first of them.
    pub overflow_intervals: Vec<Overflow>,
    /// Beginnings without an end and ends without a beginning.
    pub unpaired: u64,
    /// Time within overflows that have a beginning and an end, ps.
    pub overflow_ps: u128,
    /// Events that the counter says it missed, all channels.
    pub missed: u64,
    /// Silences longer than [`CheckOptions::gap_ps`].
    pub gaps: u64,
    /// The first of them.
    pub gaps_at: Vec<Gap>,
    /// The longest time between two records that follow each other.
    pub longest_gap: Option<Gap>,
    /// Records at the very end of which all bytes are 0: what a file system leaves after a crash, not tags.
    pub zeros_at_end: u64,
}

impl Report {
    /// Whether nothing is odd: in time, no duplicates, known types, no error, no overflow, nothing missed.
    pub fn is_clean(&self) -> bool {
        let oddities = [
            self.unsorted,
            self.duplicates,
            self.unknown,
            self.reserved,
            self.errors,
            self.overflows,
            self.unpaired,
            self.missed,
            self.gaps,
            self.other_tags,
            self.zeros_at_end,
        ];
        oddities == [0; 11]
    }
}

/// Looks at one record after the other.
#[derive(Debug)]
pub(super) struct Checker {
    options: CheckOptions,
    report: Report,
    /// Channels from −128 to 127, real inputs, until they are booked in the report.
    near: Box<[Option<ChannelReport>; 256]>,
    /// When the open overflow began, ps.
    open_ps: Option<i64>,
}

impl Checker {
    pub(super) fn new(options: &CheckOptions) -> Self {
        let near = Box::new([None; 256]);
        Self { options: *options, report: Report::default(), near, open_ps: None }
    }

    pub(super) fn add(&mut self, records: &[[u8; RECORD_BYTES]]) {
        for record in records {
            self.add_one(Tag::from_bytes(record));
        }
    }

    fn add_one(&mut self, tag: Tag) {
        let number = self.report.records;
        self.order(number, tag.time_ps);
        let report = &mut self.report;
        report.records += 1;
        let empty = Tag::photon(0, 0);
        report.zeros_at_end = if tag == empty { report.zeros_at_end + 1 } else { 0 };
        if tag.reserved != 0 {
            note(&mut report.reserved, &mut report.reserved_at, number);
        }
        match tag.kind() {
            Some(TagKind::TimeTag) => self.time_tag(number, tag),
            Some(TagKind::Error) => note(&mut report.errors, &mut report.errors_at, number),
            Some(TagKind::OverflowBegin) => {
                if let Some(before) = self.open_ps.replace(tag.time_ps) {
                    // The earlier beginning stands, as in the bins.
                    self.open_ps = Some(before);
                    report.unpaired += 1;
                }
            }
            Some(TagKind::OverflowEnd) => {
                let begin_ps = self.open_ps.take();
                self.overflow(Overflow { begin_ps, end_ps: Some(tag.time_ps) });
            }
            Some(TagKind::MissedEvents) => {
                report.missed += u64::from(tag.missed);
                if let Some(channel) = channel(&mut self.near, report, tag.channel) {
                    channel.missed += u64::from(tag.missed);
                }
            }
            None => note(&mut report.unknown, &mut report.unknown_at, number),
        }
    }

    fn order(&mut self, number: u64, time_ps: i64) {
        let report = &mut self.report;
        report.first_ps.get_or_insert(time_ps);
        let earliest = report.earliest_ps.get_or_insert(time_ps);
        *earliest = time_ps.min(*earliest);
        let latest = report.latest_ps.get_or_insert(time_ps);
        *latest = time_ps.max(*latest);
        let Some(before_ps) = report.last_ps.replace(time_ps) else { return };
        if time_ps < before_ps {
            note(&mut report.unsorted, &mut report.unsorted_at, number);
            return;
        }
        let gap = Gap { from_ps: before_ps, to_ps: time_ps };
        if report.longest_gap.is_none_or(|longest| gap.length_ps() > longest.length_ps()) {
            report.longest_gap = Some(gap);
        }
        if self.options.gap_ps.is_some_and(|least| gap.length_ps() > least) {
            note(&mut report.gaps, &mut report.gaps_at, gap);
        }
    }

    fn time_tag(&mut self, number: u64, tag: Tag) {
        let report = &mut self.report;
        let Some(channel) = channel(&mut self.near, report, tag.channel) else {
            report.other_tags += 1;
            return;
        };
        channel.tags += 1;
        if channel.last_ps.replace(tag.time_ps) == Some(tag.time_ps) {
            channel.duplicates += 1;
            note(&mut report.duplicates, &mut report.duplicates_at, number);
        }
    }

    fn overflow(&mut self, overflow: Overflow) {
        let report = &mut self.report;
        note(&mut report.overflows, &mut report.overflow_intervals, overflow);
        match (overflow.begin_ps, overflow.end_ps) {
            (Some(begin), Some(end)) => report.overflow_ps += u128::from(end.abs_diff(begin)),
            _ => report.unpaired += 1,
        }
    }

    pub(super) fn finish(mut self) -> Report {
        if self.open_ps.is_some() {
            self.overflow(Overflow { begin_ps: self.open_ps, end_ps: None });
        }
        let near = self.near.iter().zip(-128..).filter_map(|(one, at)| one.map(|one| (at, one)));
        self.report.channels.extend(near);
        self.report
    }
}

fn note<T>(count: &mut u64, listed: &mut Vec<T>, one: T) {
    *count += 1;
    if listed.len() < MOST_LISTED {
        listed.push(one);
    }
}

fn channel<'a>(
    near: &'a mut [Option<ChannelReport>; 256],
    report: &'a mut Report,
    number: i32,
) -> Option<&'a mut ChannelReport> {
    if let Some(near) = near.get_mut(number.wrapping_add(128) as u32 as usize) {
        return Some(near.get_or_insert_default());
    }
    if report.channels.len() >= MOST_CHANNELS && !report.channels.contains_key(&number) {
        return None;
    }
    Some(report.channels.entry(number).or_default())
}

impl Tags<'_> {
    /// Looks at all tags once.
    pub fn check(&self, options: &CheckOptions) -> Report {
        let mut checker = Checker::new(options);
        checker.add(self.records());
        checker.finish()
    }
}
