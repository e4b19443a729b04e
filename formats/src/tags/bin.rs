//! Counting tags in bins: the inner loop.

use super::binned::{Binned, Sums};
use super::tag::{RECORD_BYTES, Tag, TagKind, Tags};
use super::{TagError, binned::Bins};

/// The most counts (bins × channels) that are kept at once: half a GiB of them, and as much for missed events.
pub const MOST_CELLS: u64 = 1 << 26;

/// Records of one piece of work: what a piece keeps is at most some tens of bytes for each, whatever the bins.
pub(super) const PIECE_RECORDS: u64 = 1 << 16;

/// Which channels are counted, and in which bins: half-open, `[from + i·width, from + (i+1)·width)`, the last one cut at
/// the end of the span.
#[derive(Debug, Clone)]
pub struct Binning {
    pub(super) channels: Vec<i32>,
    pub(super) bins: Bins,
    slots: Slots,
}

impl Binning {
    /// Bins of `width_ps` from `from_ps` to before `to_ps`, all ps on the counter's clock, for `channels` (negative ones
    /// are falling edges; virtual ones may have any number).
    ///
    /// # Errors
    /// [`TagError::Width`], [`TagError::Span`] and [`TagError::Channels`] for what makes no sense,
    /// [`TagError::TooManyBins`] for more than [`MOST_CELLS`] counts.
    pub fn new(
        channels: &[i32],
        width_ps: i64,
        from_ps: i64,
        to_ps: i64,
    ) -> Result<Self, TagError> {
        let Some(width) = u64::try_from(width_ps).ok().filter(|&width| width > 0) else {
            return Err(TagError::Width { width_ps });
        };
        if to_ps <= from_ps {
            return Err(TagError::Span { from_ps, to_ps });
        }
        let twice = channels.iter().enumerate().any(|(i, c)| channels[..i].contains(c));
        if channels.is_empty() || twice {
            return Err(TagError::Channels { channels: channels.to_vec() });
        }
        let count = to_ps.abs_diff(from_ps).div_ceil(width);
        if u128::from(count) * channels.len() as u128 > u128::from(MOST_CELLS) {
            return Err(TagError::TooManyBins {
                bins: count,
                channels: channels.len(),
                most: MOST_CELLS,
            });
        }
        Ok(Self {
            channels: channels.to_vec(),
            bins: Bins { from_ps, to_ps, width, count: count as usize },
            slots: Slots::new(channels),
        })
    }

    /// How many bins there are.
    pub fn bins(&self) -> usize {
        self.bins.count
    }
}

/// From a channel to its place in a row of counts; what is not counted goes to the place after the last.
#[derive(Debug, Clone)]
pub(super) struct Slots {
    /// For channels from −128 to 127: real inputs.
    near: Box<[u32; 256]>,
    /// Virtual channels, in order.
    far: Vec<(i32, u32)>,
    rest: u32,
}

impl Slots {
    pub(super) fn new(channels: &[i32]) -> Self {
        let rest = channels.len() as u32;
        let mut slots = Self { near: Box::new([rest; 256]), far: Vec::new(), rest };
        for (&channel, slot) in channels.iter().zip(0..) {
            match slots.near.get_mut(channel.wrapping_add(128) as u32 as usize) {
                Some(near) => *near = slot,
                None => slots.far.push((channel, slot)),
            }
        }
        slots.far.sort_unstable();
        slots
    }

    #[inline(always)]
    pub(super) fn of(&self, channel: i32) -> usize {
        let slot = match self.near.get(channel.wrapping_add(128) as u32 as usize) {
            Some(&slot) => slot,
            None => self.of_far(channel),
        };
        slot as usize
    }

    fn of_far(&self, channel: i32) -> u32 {
        match self.far.binary_search_by_key(&channel, |&(channel, _)| channel) {
            Ok(place) => self.far[place].1,
            Err(_) => self.rest,
        }
    }
}

/// Where the dropping of events stands between two records.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Dropping {
    /// It began at this time, ps, and has not ended.
    Since(i64),
    /// It does not happen; the last time it ended, ps (the beginning of time if it never did).
    NotSince(i64),
}

/// Counts from a piece of a file, to be added up in any number of threads: they grow with the number of records, never
/// with the number of bins.
#[derive(Debug)]
pub(super) struct Piece<'a> {
    binning: &'a Binning,
    /// Rows of: the bin, the counts of its channels, the count of all others. A bin that is left and met again has two.
    /// Zeros from `used` on.
    rows: Vec<u64>,
    used: usize,
    /// Numbers in a row.
    stride: usize,
    /// Bin, place of the channel, missed events.
    pub(super) missed: Vec<(usize, usize, u16)>,
    /// Bins with an error.
    pub(super) errors: Vec<usize>,
    /// Bins from … to (inclusive) that have a moment in common with an overflow.
    pub(super) overflows: Vec<(usize, usize)>,
    /// The first overflow record: whether it is a beginning, and its time.
    pub(super) first: Option<(bool, i64)>,
    /// The state after the last record; `None` without any overflow record.
    pub(super) last: Option<Dropping>,
    /// Start of the bin that `row` belongs to, and its length: both 0 before the first.
    start: i64,
    length: u64,
    row: usize,
}

impl<'a> Piece<'a> {
    pub(super) fn new(binning: &'a Binning) -> Self {
        Self {
            binning,
            rows: Vec::new(),
            used: 0,
            stride: binning.channels.len() + 2,
            missed: Vec::new(),
            errors: Vec::new(),
            overflows: Vec::new(),
            first: None,
            last: None,
            start: 0,
            length: 0,
            row: 0,
        }
    }

    /// Bins and their rows of counts; of each row, the last count is of the channels that were not asked for.
    pub(super) fn rows(&self) -> impl Iterator<Item = (usize, &[u64])> {
        let rows = self.rows[..self.used].chunks_exact(self.stride);
        rows.map(|row| (row[0] as usize, &row[1..]))
    }

    /// Forgets all, to be used for another piece.
    pub(super) fn clear(&mut self) {
        self.rows[..self.used].fill(0);
        self.used = 0;
        self.missed.clear();
        self.errors.clear();
        self.overflows.clear();
        (self.first, self.last) = (None, None);
        (self.start, self.length, self.row) = (0, 0, 0);
    }

    pub(super) fn add(&mut self, records: &[[u8; RECORD_BYTES]]) {
        let (blocks, rest) = records.as_chunks::<8>();
        for block in blocks {
            if !self.add_block(block) {
                for record in block {
                    self.add_one(record);
                }
            }
        }
        for record in rest {
            self.add_one(record);
        }
    }

    /// The fast path: eight time tags that all lie in the present bin. Says whether it was taken.
    // A tag lies in the bin if its distance from the start, taken modulo 2⁶⁴, is below the length: the bin ends at an i64,
    // so no time outside of it has such a distance.
    #[inline(always)]
    fn add_block(&mut self, block: &[[u8; RECORD_BYTES]; 8]) -> bool {
        // Where bins are short, one look at the last tag is enough to know.
        let last = (u128::from_le_bytes(block[7]) >> 64) as u64;
        if last.wrapping_sub(self.start as u64) >= self.length {
            return false;
        }
        let mut heads = [0_u64; 8];
        let mut kinds = 0;
        let mut inside = true;
        for (head, record) in heads.iter_mut().zip(block) {
            let all = u128::from_le_bytes(*record);
            *head = all as u64;
            kinds |= *head;
            inside &= ((all >> 64) as u64).wrapping_sub(self.start as u64) < self.length;
        }
        if !inside || kinds & 0xff != 0 {
            return false;
        }
        let Some(row) = self.rows.get_mut(self.row..) else { return false };
        for head in heads {
            if let Some(count) = row.get_mut(self.binning.slots.of((head >> 32) as i32)) {
                *count += 1;
            }
        }
        true
    }

    fn add_one(&mut self, record: &[u8; RECORD_BYTES]) {
        let tag = Tag::from_bytes(record);
        match tag.kind() {
            Some(TagKind::TimeTag) => {
                if (tag.time_ps as u64).wrapping_sub(self.start as u64) >= self.length
                    && !self.enter(tag.time_ps)
                {
                    return;
                }
                self.rows[self.row + self.binning.slots.of(tag.channel)] += 1;
            }
            Some(TagKind::Error) => self.errors.extend(self.binning.bins.of(tag.time_ps)),
            Some(TagKind::OverflowBegin) => self.overflow(true, tag.time_ps),
            Some(TagKind::OverflowEnd) => self.overflow(false, tag.time_ps),
            Some(TagKind::MissedEvents) => {
                let slot = self.binning.slots.of(tag.channel);
                if tag.missed > 0
                    && slot < self.binning.channels.len()
                    && let Some(bin) = self.binning.bins.of(tag.time_ps)
                {
                    self.missed.push((bin, slot, tag.missed));
                }
            }
            None => {}
        }
    }

    /// Makes the bin of `time_ps` the present one; says whether it has one.
    fn enter(&mut self, time_ps: i64) -> bool {
        let bins = &self.binning.bins;
        // The next bin is found by its edges alone, so that nothing is divided in a dense, sorted file.
        let next = match self.row.checked_sub(1).and_then(|head| self.rows.get(head)) {
            Some(&bin) if bin + 1 < bins.count as u64 => {
                let start = self.start.wrapping_add_unsigned(self.length);
                let length = bins.length(start);
                let inside = (time_ps as u64).wrapping_sub(start as u64) < length;
                inside.then_some((bin + 1, start, length))
            }
            _ => None,
        };
        let found = next.or_else(|| {
            let bin = bins.of(time_ps)?;
            let start = bins.start(bin);
            Some((bin as u64, start, bins.length(start)))
        });
        let Some((bin, start, length)) = found else { return false };
        (self.start, self.length) = (start, length);
        self.row = self.used + 1;
        self.used += self.stride;
        if self.used > self.rows.len() {
            self.rows.resize(2 * self.used, 0);
        }
        self.rows[self.row - 1] = bin;
        true
    }

    fn overflow(&mut self, begins: bool, time_ps: i64) {
        let last = match (self.last, begins) {
            (None, _) => {
                self.first = Some((begins, time_ps));
                if begins { Dropping::Since(time_ps) } else { Dropping::NotSince(time_ps) }
            }
            // A second beginning: the first one stands.
            (Some(Dropping::Since(since)), true) => Dropping::Since(since),
            (Some(Dropping::NotSince(_)), true) => Dropping::Since(time_ps),
            // An end without its beginning: something was lost since the end before.
            (Some(Dropping::Since(since) | Dropping::NotSince(since)), false) => {
                self.overflows.extend(self.binning.bins.touched(since, time_ps));
                Dropping::NotSince(time_ps)
            }
        };
        self.last = Some(last);
    }
}

impl Tags<'_> {
    /// Counts the tags in bins. They need not be in time. See [the module](super) for what is flagged.
    pub fn bin(&self, binning: &Binning) -> Binned {
        let mut sums = Sums::new(binning);
        let mut piece = Piece::new(binning);
        for records in self.records().chunks(PIECE_RECORDS as usize) {
            piece.clear();
            piece.add(records);
            sums.add(&piece);
        }
        sums.finish()
    }
}
