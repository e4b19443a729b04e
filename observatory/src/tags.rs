//! Raw tags on their way to the disk: in bounded memory, and never in the way of bins.

use std::sync::atomic::{AtomicU64, Ordering};
use sunglint_drivers::tags::{RECORD_BYTES, Tag, TagKind};

/// Bytes of tags that wait for the writer at most; what comes then is lost, and counted.
const MOST_WAITING: u64 = 64 << 20;

/// Bytes of tags on their way, of all counters.
#[derive(Debug, Default)]
pub struct TagBudget(AtomicU64);

impl TagBudget {
    /// Takes room for so many bytes, if there is. After a loss (`full`) only once half of it is free, so that losses are few and long.
    pub fn take(&self, bytes: u64, full: bool) -> bool {
        let most = if full { MOST_WAITING / 2 } else { MOST_WAITING };
        let more = |waiting: u64| Some(waiting + bytes).filter(|sum| *sum <= most);
        self.0.fetch_update(Ordering::SeqCst, Ordering::SeqCst, more).is_ok()
    }

    /// Takes room whether there is any or not.
    pub fn add(&self, bytes: u64) {
        self.0.fetch_add(bytes, Ordering::SeqCst);
    }

    /// Gives room back.
    pub fn give(&self, bytes: u64) {
        self.0.fetch_sub(bytes, Ordering::SeqCst);
    }
}

/// Records that are lost before the next ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Loss {
    /// Time of the first and of the last, ps.
    pub span_ps: [i64; 2],
    /// How many.
    pub records: u64,
}

impl Loss {
    /// All of these records.
    pub fn of(records: &[[u8; RECORD_BYTES]]) -> Option<Self> {
        let time_ps = |record| Tag::from_bytes(record).time_ps;
        let span_ps = [time_ps(records.first()?), time_ps(records.last()?)];
        Some(Self { span_ps, records: records.len() as u64 })
    }

    /// Both, one after the other.
    pub fn and(before: Option<Self>, after: Option<Self>) -> Option<Self> {
        match (before, after) {
            (Some(before), Some(after)) => Some(Self {
                span_ps: [before.span_ps[0], after.span_ps[1]],
                records: before.records + after.records,
            }),
            (before, after) => before.or(after),
        }
    }

    /// Returns the records that replace the lost tags: an overflow, as which readers of the tags see the loss.
    pub fn marks(self) -> [[u8; RECORD_BYTES]; 2] {
        let [from_ps, to_ps] = self.span_ps;
        [Tag::overflow_begin(from_ps).to_bytes(), Tag::overflow_end(to_ps).to_bytes()]
    }
}

/// The records of the planned inputs, and what the counter reports between them.
pub fn planned(mut records: Vec<[u8; RECORD_BYTES]>, inputs: &[i32]) -> Vec<[u8; RECORD_BYTES]> {
    records.retain(|record| {
        let tag = Tag::from_bytes(record);
        tag.kind() != Some(TagKind::TimeTag) || inputs.contains(&tag.channel)
    });
    records
}
