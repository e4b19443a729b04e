//! A file of tags, read in pieces.

use super::bin::{PIECE_RECORDS, Piece};
use super::binned::Sums;
use super::bytes_at::BytesAt;
use super::check::Checker;
use super::tag::{RECORD_BYTES, Tag, Tags, first_unsorted};
use super::{Binned, Binning, CheckOptions, Report, TagError};
use crate::{FileError, ParseError};
use rayon::iter::{
    IndexedParallelIterator as _, IntoParallelRefMutIterator as _, ParallelIterator as _,
};
use std::ops::Range;
use std::path::Path;
use std::sync::OnceLock;

/// Records that are read at once: 256 KiB, so that they are still in the core's cache when they are counted.
const READ_RECORDS: usize = 1 << 14;

/// A file of 16-byte records, open for reading. Nothing of it is held in memory.
#[derive(Debug)]
pub struct TagFile {
    file: BytesAt,
    records: u64,
    /// Whether all times are in order, once somebody had to know: the first record that is not, its time and the one
    /// before, ps.
    order: OnceLock<Result<(), (u64, i64, i64)>>,
}

/// Numbers of records that [`TagFile::recover`] kept, and of records and bytes that it left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Recovered {
    /// Whole records that can be read.
    pub records: u64,
    /// Records of zeros at the end, which a file system leaves after a crash.
    pub zero_records: u64,
    /// Bytes of a torn record at the end.
    pub torn_bytes: u64,
}

impl TagFile {
    /// Opens a plain file of whole records. What is written to it afterwards is not seen.
    ///
    /// # Errors
    /// [`FileError::Io`] if it is not a plain file or cannot be read; [`FileError::Parse`] if its length is no multiple of
    /// 16 bytes: [`TagFile::recover`] reads it up to there.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, FileError> {
        Self::open_at(path.as_ref())
    }

    fn open_at(path: &Path) -> Result<Self, FileError> {
        let file = BytesAt::open(path)?;
        let torn = file.len() % RECORD_BYTES as u64;
        if torn > 0 {
            let whole = file.len() / RECORD_BYTES as u64;
            let error = ParseError::new(
                path,
                format!("{torn} bytes of a record that is torn"),
                "whole records of 16 bytes",
            );
            let place = format!("byte {}", file.len() - torn);
            let hint = format!("recover the {whole} whole records before it");
            return Err(error.in_field(place).with_hint(hint).into());
        }
        Ok(Self::of(file))
    }

    /// Opens a plain file that a crash may have cut short or padded with zeros: only the whole records before that are seen.
    /// The file is not changed.
    ///
    /// # Errors
    /// [`FileError::Io`] if it is not a plain file or cannot be read.
    pub fn recover(path: impl AsRef<Path>) -> Result<(Self, Recovered), FileError> {
        Self::recover_at(path.as_ref())
    }

    fn recover_at(path: &Path) -> Result<(Self, Recovered), FileError> {
        let mut file = Self::of(BytesAt::open(path)?);
        let zero_records = file.zeros_at_end()?;
        let torn_bytes = file.file.len() % RECORD_BYTES as u64;
        file.records -= zero_records;
        let recovered = Recovered { records: file.records, zero_records, torn_bytes };
        Ok((file, recovered))
    }

    fn of(file: BytesAt) -> Self {
        let records = file.len() / RECORD_BYTES as u64;
        Self { file, records, order: OnceLock::new() }
    }

    fn zeros_at_end(&self) -> Result<u64, FileError> {
        let mut zeros = 0;
        let mut end = self.records;
        let mut buffer = Vec::new();
        while end > 0 {
            let start = end.saturating_sub(READ_RECORDS as u64);
            let records = self.read_into(start..end, &mut buffer)?;
            let here = records.iter().rev().take_while(|record| **record == [0; 16]).count();
            zeros += here as u64;
            if here < records.len() {
                break;
            }
            end = start;
        }
        Ok(zeros)
    }

    /// How many records there are.
    pub fn len(&self) -> u64 {
        self.records
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.records == 0
    }

    /// The records of a range, at most as many as are read at once.
    fn read_into<'b>(
        &self,
        range: Range<u64>,
        buffer: &'b mut Vec<[u8; RECORD_BYTES]>,
    ) -> Result<&'b [[u8; RECORD_BYTES]], FileError> {
        let count = (range.end - range.start).min(READ_RECORDS as u64) as usize;
        if buffer.len() < count {
            buffer.resize(count, [0; RECORD_BYTES]);
        }
        let records = &mut buffer[..count];
        self.file.read(range.start * RECORD_BYTES as u64, records.as_flattened_mut())?;
        Ok(records)
    }

    /// Hands the tags of a range of records over in views of some thousands, in order, until `take` says `Err`.
    ///
    /// # Errors
    /// The errors of `take`, or a [`FileError`]: the range reaches beyond the file, or the file shrank since it was opened.
    pub fn for_each<E: From<FileError>>(
        &self,
        range: Range<u64>,
        take: impl FnMut(Tags<'_>) -> Result<(), E>,
    ) -> Result<(), E> {
        self.for_each_in(&mut Vec::new(), range, take)
    }

    fn for_each_in<E: From<FileError>>(
        &self,
        buffer: &mut Vec<[u8; RECORD_BYTES]>,
        range: Range<u64>,
        mut take: impl FnMut(Tags<'_>) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut start = range.start;
        while start < range.end {
            let records = self.read_into(start..range.end, buffer)?;
            start += records.len() as u64;
            take(Tags::of_records(records))?;
        }
        Ok(())
    }

    /// The tag at a place counted from 0.
    ///
    /// # Errors
    /// A [`FileError`] if there is none there, or the file shrank since it was opened.
    pub fn get(&self, index: u64) -> Result<Tag, FileError> {
        let mut record = [[0; RECORD_BYTES]];
        let start = index.saturating_mul(RECORD_BYTES as u64);
        self.file.read(start, record.as_flattened_mut())?;
        Ok(Tag::from_bytes(&record[0]))
    }

    /// Looks at all tags once, on one thread.
    ///
    /// # Errors
    /// A [`FileError`] if the file shrank since it was opened, or cannot be read.
    pub fn check(&self, options: &CheckOptions) -> Result<Report, FileError> {
        let mut checker = Checker::new(options);
        self.for_each(0..self.records, |tags| {
            checker.add(tags.records());
            Ok::<_, FileError>(())
        })?;
        Ok(checker.finish())
    }

    /// The records from `from_ps` to before `to_ps`. The first call reads the whole file, to be sure that its times are in
    /// order; later ones are binary searches.
    ///
    /// # Errors
    /// [`TagError::Unsorted`] with the first tag that is earlier than the one before it, since then a search finds only
    /// some of them; [`TagError::Span`] if `to_ps` is before `from_ps`; [`TagError::File`] if the file cannot be read.
    pub fn slice(&self, from_ps: i64, to_ps: i64) -> Result<Range<u64>, TagError> {
        if to_ps < from_ps {
            return Err(TagError::Span { from_ps, to_ps });
        }
        self.require_order()?;
        Ok(self.before(from_ps)?..self.before(to_ps)?)
    }

    fn require_order(&self) -> Result<(), TagError> {
        let known = match self.order.get() {
            Some(known) => *known,
            None => {
                let found = match self.find_disorder() {
                    Ok(()) => Ok(()),
                    Err(TagError::Unsorted { record, time_ps, before_ps }) => {
                        Err((record, time_ps, before_ps))
                    }
                    Err(error) => return Err(error),
                };
                *self.order.get_or_init(|| found)
            }
        };
        known.map_err(|(record, time_ps, before_ps)| TagError::Unsorted {
            record,
            time_ps,
            before_ps,
        })
    }

    fn find_disorder(&self) -> Result<(), TagError> {
        let mut before_ps = None;
        let mut number = 0;
        self.for_each(0..self.records, |tags| {
            if let Some(fault) = first_unsorted(tags.records(), before_ps, number) {
                return Err(fault);
            }
            before_ps = tags.iter().next_back().map(|tag| tag.time_ps).or(before_ps);
            number += tags.len() as u64;
            Ok(())
        })
    }

    /// How many records are before a time, where they are in order.
    fn before(&self, limit_ps: i64) -> Result<u64, FileError> {
        let (mut low, mut high) = (0, self.records);
        while low < high {
            let middle = low + (high - low) / 2;
            if self.get(middle)?.time_ps < limit_ps {
                low = middle + 1;
            } else {
                high = middle;
            }
        }
        Ok(low)
    }

    /// Counts the tags in bins, on all threads of the present rayon pool; the result does not depend on their number. The
    /// tags need not be in time. The whole file is read, since an overflow that began long before the first bin may still
    /// last in it. See [the module](super) for what is flagged.
    ///
    /// # Errors
    /// A [`FileError`] if the file shrank since it was opened, or cannot be read.
    pub fn bin(&self, binning: &Binning) -> Result<Binned, FileError> {
        let mut sums = Sums::new(binning);
        // In batches, so that memory does not grow with the file. A thread alone adds up each piece while it is in its cache.
        let threads = rayon::current_num_threads();
        let mut desks: Vec<_> = (0..if threads == 1 { 1 } else { 4 * threads })
            .map(|_| Desk { piece: Piece::new(binning), buffer: Vec::new() })
            .collect();
        let mut start = 0;
        while start < self.records {
            let left = (self.records - start).div_ceil(PIECE_RECORDS);
            let used = left.min(desks.len() as u64) as usize;
            let desks = &mut desks[..used];
            desks
                .par_iter_mut()
                .enumerate()
                .map(|(i, desk)| self.piece(desk, start + i as u64 * PIECE_RECORDS))
                .collect::<Result<(), FileError>>()?;
            for desk in desks {
                sums.add(&desk.piece);
            }
            start += used as u64 * PIECE_RECORDS;
        }
        Ok(sums.finish())
    }

    fn piece(&self, desk: &mut Desk<'_>, start: u64) -> Result<(), FileError> {
        desk.piece.clear();
        let end = self.records.min(start + PIECE_RECORDS);
        self.for_each_in(&mut desk.buffer, start..end, |tags| {
            desk.piece.add(tags.records());
            Ok(())
        })
    }
}

/// The memory for one piece of a file, used again for others.
struct Desk<'a> {
    piece: Piece<'a>,
    buffer: Vec<[u8; RECORD_BYTES]>,
}
