//! A PTU file: its header, its records, its tags.

use super::header::{Header, Value};
use super::record::{Decoder, MARKER_CHANNEL, Record, RecordType};
use super::scale::Resolution;
use crate::tags::Tag;
use std::path::Path;
use sunglint_formats::tags::bytes_at::BytesAt;
use sunglint_formats::{FileError, ParseError};

/// Records that are read at once.
const READ_RECORDS: usize = 1 << 14;

/// A PTU file, open for reading; only its header is held in memory.
#[derive(Debug)]
pub struct PtuFile {
    file: BytesAt,
    header: Header,
    kind: RecordType,
    global: Resolution,
    fine: Option<Resolution>,
    records: u64,
}

impl PtuFile {
    /// Opens a plain file that holds all the records that its header promises. (A header that promises none, as after a
    /// measurement that was broken off, is taken to mean all that are there.)
    ///
    /// # Errors
    /// [`FileError::Io`] if it is not a plain file; [`FileError::Parse`] with the byte of the entry that is missing, unknown or
    /// makes no sense, and with fewer records than promised: [`PtuFile::recover`] reads those.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, FileError> {
        Self::of(BytesAt::open(path.as_ref())?, false)
    }

    /// Opens a plain file that was cut short: as many whole records as are there, at most as many as promised.
    ///
    /// # Errors
    /// The errors of [`PtuFile::open`], but not for missing records.
    pub fn recover(path: impl AsRef<Path>) -> Result<Self, FileError> {
        Self::of(BytesAt::open(path.as_ref())?, true)
    }

    /// The bytes of a file; `name` stands for it in errors.
    ///
    /// # Errors
    /// The errors of [`PtuFile::open`].
    pub fn from_bytes(name: impl AsRef<Path>, bytes: Vec<u8>) -> Result<Self, FileError> {
        Self::of(BytesAt::memory(name.as_ref(), bytes), false)
    }

    fn of(file: BytesAt, cut_short: bool) -> Result<Self, FileError> {
        let header = Header::read(&file)?;
        let entries = Entries { path: file.path(), header: &header };
        let kind = entries.record_type()?;
        entries.bits_per_record()?;
        let global = entries.resolution("MeasDesc_GlobalResolution")?;
        let fine = kind.is_t3().then(|| entries.resolution("MeasDesc_Resolution")).transpose()?;
        let bytes = file.len() - header.end_byte;
        let records = entries.records(bytes, cut_short)?;
        Ok(Self { file, header, kind, global, fine, records })
    }

    /// The header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The type of the records.
    pub fn record_type(&self) -> RecordType {
        self.kind
    }

    /// How many records there are, rollovers of the clock included.
    pub fn len(&self) -> u64 {
        self.records
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.records == 0
    }

    /// Bytes behind the last record that belong to nothing.
    pub fn trailing_bytes(&self) -> u64 {
        self.file.len() - self.header.end_byte - 4 * self.records
    }

    /// Length of a tick (T2) or a sync period (T3).
    pub fn global_resolution(&self) -> Resolution {
        self.global
    }

    /// Unit of `dtime` (T3 only).
    pub fn dtime_resolution(&self) -> Option<Resolution> {
        self.fine
    }

    /// The records as the instrument wrote them, the clock unrolled. Ends after the first error: a file that shrank, or a
    /// clock beyond 64 bits.
    pub fn records(&self) -> Records<'_> {
        Records {
            file: self,
            decoder: Decoder::new(self.kind),
            buffer: Vec::new(),
            used: 0,
            next: 0,
        }
    }

    /// The records as tags; see [the module](super). Ends after the first error, which besides those of
    /// [`PtuFile::records`] may be a time beyond 2⁶³ ps.
    pub fn tags(&self) -> TagsOf<'_> {
        TagsOf { records: self.records(), pending: Vec::new() }
    }

    /// Time of a record, ps; `None` beyond 2⁶³ ps. A rollover has none of its own and is at 0.
    fn time_ps(&self, record: &Record) -> Option<i64> {
        match *record {
            Record::Photon { count, dtime, .. } => match (self.fine, dtime) {
                (Some(fine), Some(dtime)) => self.global.ps_with(count, &fine, dtime.into()),
                _ => self.global.ps(count),
            },
            Record::Sync { count }
            | Record::Markers { count, .. }
            | Record::Unknown { count, .. } => self.global.ps(count),
            Record::Rollover { .. } => Some(0),
        }
    }

    fn refuse_record(&self, number: u64, found: String, expected: &str) -> FileError {
        let at = self.header.end_byte + 4 * number;
        let error = ParseError::new(self.file.path(), found, expected);
        error.in_field(format!("byte {at} (record {number})")).into()
    }
}

/// The entries that the records cannot be read without.
struct Entries<'a> {
    path: &'a Path,
    header: &'a Header,
}

impl Entries<'_> {
    fn refuse(&self, name: &str, found: String, expected: &str) -> ParseError {
        let at = self.header.get(name).map_or(self.header.end_byte, |entry| entry.at_byte);
        ParseError::new(self.path, found, expected).in_field(format!("byte {at}: {name}"))
    }

    fn found(&self, name: &str) -> String {
        match self.header.get(name).map(|entry| &entry.value) {
            None => "no such entry before the header's end".into(),
            Some(Value::Text(_) | Value::Floats(_)) => "a text or a list".into(),
            Some(value) => format!("{value:?}"),
        }
    }

    fn record_type(&self) -> Result<RecordType, ParseError> {
        const NAME: &str = "TTResultFormat_TTTRRecType";
        let number = self.header.int(NAME);
        number.and_then(RecordType::from_number).ok_or_else(|| {
            let found = number.map_or_else(|| self.found(NAME), |n| format!("0x{n:08X}"));
            self.refuse(NAME, found, "the number of a documented T2 or T3 record type")
        })
    }

    fn bits_per_record(&self) -> Result<(), ParseError> {
        const NAME: &str = "TTResultFormat_BitsPerRecord";
        match self.header.get(NAME).map(|entry| &entry.value) {
            // Some writers leave it out or 0.
            None | Some(Value::Int(0 | 32)) => Ok(()),
            Some(_) => Err(self.refuse(NAME, self.found(NAME), "32")),
        }
    }

    fn resolution(&self, name: &str) -> Result<Resolution, ParseError> {
        let found = self.header.float(name).and_then(Resolution::from_seconds);
        found.ok_or_else(|| {
            let (least, most) = Resolution::RANGE_S;
            let expected = format!("a number from {least:e} to {most:e} s");
            self.refuse(name, self.found(name), &expected)
        })
    }

    /// How many records to read of those that `bytes` have room for.
    fn records(&self, bytes: u64, cut_short: bool) -> Result<u64, ParseError> {
        const NAME: &str = "TTResult_NumberOfRecords";
        let there = bytes / 4;
        let promised = self.header.int(NAME).unwrap_or(0);
        let promised = u64::try_from(promised).ok().filter(|&promised| promised > 0);
        let whole = match promised {
            Some(promised) => promised <= there,
            None => bytes.is_multiple_of(4),
        };
        if whole || cut_short {
            return Ok(promised.unwrap_or(there).min(there));
        }
        let found = match promised {
            Some(promised) => format!("{promised} promised and {there} in the file"),
            None => format!("{} bytes of a record that is torn", bytes % 4),
        };
        let error = self.refuse(NAME, found, "all records of 4 bytes");
        Err(error.with_hint(format!("recover the {there} whole records")))
    }
}

/// The records of a file, one after the other.
#[derive(Debug)]
pub struct Records<'a> {
    file: &'a PtuFile,
    decoder: Decoder,
    buffer: Vec<[u8; 4]>,
    /// How much of the buffer was handed out.
    used: usize,
    /// Number of the next record.
    next: u64,
}

impl Records<'_> {
    fn fill(&mut self) -> Result<(), FileError> {
        let left = self.file.records - self.next;
        self.buffer.resize(left.min(READ_RECORDS as u64) as usize, [0; 4]);
        self.used = 0;
        let start = self.file.header.end_byte + 4 * self.next;
        self.file.file.read(start, self.buffer.as_flattened_mut())
    }

    fn end(&mut self) {
        self.next = self.file.records;
    }
}

impl Iterator for Records<'_> {
    type Item = Result<Record, FileError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.next >= self.file.records {
            return None;
        }
        if self.used == self.buffer.len()
            && let Err(error) = self.fill()
        {
            self.end();
            return Some(Err(error));
        }
        let raw = u32::from_le_bytes(*self.buffer.get(self.used)?);
        let record = self.decoder.decode(raw).map_err(|error| {
            let found = format!("0x{raw:08X}: {error}");
            self.file.refuse_record(self.next, found, "a clock within 64 bits")
        });
        self.used += 1;
        self.next += 1;
        if record.is_err() {
            self.end();
        }
        Some(record)
    }
}

/// The tags of a file, one after the other.
#[derive(Debug)]
pub struct TagsOf<'a> {
    records: Records<'a>,
    /// Further tags of the present record, the last one first.
    pending: Vec<Tag>,
}

impl Iterator for TagsOf<'_> {
    type Item = Result<Tag, FileError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(tag) = self.pending.pop() {
                return Some(Ok(tag));
            }
            let number = self.records.next;
            let record = match self.records.next()? {
                Ok(record) => record,
                Err(error) => return Some(Err(error)),
            };
            let Some(time_ps) = self.records.file.time_ps(&record) else {
                self.records.end();
                let found = format!("{record:?}");
                let expected = "a time of at most 2^63 ps (107 days)";
                return Some(Err(self.records.file.refuse_record(number, found, expected)));
            };
            match record {
                Record::Photon { input, .. } => {
                    return Some(Ok(Tag::photon(input.into(), time_ps)));
                }
                Record::Sync { .. } => return Some(Ok(Tag::photon(0, time_ps))),
                Record::Unknown { .. } => return Some(Ok(Tag::error(time_ps))),
                Record::Markers { bits, .. } => {
                    let set = (0..16).rev().filter(|bit| bits >> bit & 1 == 1);
                    let tag = |bit: i32| Tag::photon(MARKER_CHANNEL + 1 + bit, time_ps);
                    self.pending.extend(set.map(tag));
                }
                Record::Rollover { .. } => {}
            }
        }
    }
}
