//! Index of a counter's table: where its rows lie and what they add up to, so that any stretch of a night is read at once.

use super::counts::Counts;
use crate::counts::{CountFlags, CountRecord};
use crate::error::{FileError, ParseError};
use crate::time::parse_utc;
use hifitime::{Duration, Epoch};
use std::fs::File;
use std::io::{BufRead as _, BufReader, Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

/// Rows of a block.
const ROWS: u64 = 64;
/// No row of ours is longer, bytes.
const LONGEST: u64 = 1 << 16;

/// A stretch of rows.
#[derive(Debug, Clone, PartialEq)]
pub struct CountBlock {
    /// Start of its first bin.
    pub start: Epoch,
    /// End of its last bin.
    pub end: Epoch,
    /// Offset of its first row in the file, bytes.
    pub offset: u64,
    /// Its rows.
    pub rows: u64,
    /// Faults of any of its bins.
    pub flags: CountFlags,
    /// Summed length of its bins, s.
    pub exposure_s: f64,
    /// Counts of each channel.
    pub counts: Vec<u64>,
    /// Lowest and highest rate of each channel in one bin, Hz.
    pub range_hz: Vec<[f64; 2]>,
}

/// Where the rows of a counter's table lie. It holds a hundred bytes for 64 bins, whatever the table's length.
#[derive(Debug, Clone)]
pub struct CountIndex {
    path: PathBuf,
    channels: Vec<String>,
    blocks: Vec<CountBlock>,
    rows: u64,
    /// How far it was read, bytes: to the end of the last whole row.
    read_to: u64,
    fault: Option<String>,
}

impl CountIndex {
    /// Reads a table once and notes where its rows are. A row that is none ends the index: [`fault`](Self::fault) says where.
    ///
    /// # Errors
    /// The system's; a header that is not one of counts.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, FileError> {
        Self::open_at(path.as_ref())
    }

    fn open_at(path: &Path) -> Result<Self, FileError> {
        // The header as the reader of tables takes it.
        let channels = Counts::open(path)?.channels().to_vec();
        let mut index = Self {
            path: path.to_path_buf(),
            channels,
            blocks: Vec::new(),
            rows: 0,
            read_to: 0,
            fault: None,
        };
        let mut file = BufReader::with_capacity(1 << 20, index.file()?);
        let mut line = Vec::new();
        loop {
            let bytes = index.line(&mut file, &mut line)?;
            if bytes == 0 {
                return Ok(index);
            }
            index.read_to += bytes;
            if !line.starts_with(b"#") {
                break;
            }
        }
        let names = std::str::from_utf8(&line).unwrap_or_default().trim_end();
        let wanted = header_of(&index.channels);
        if names != wanted {
            let found = crate::error::excerpt(names);
            let error = ParseError::new(path, found, format!("the columns {wanted}"));
            return Err(error.into());
        }
        index.read_on(&mut file)?;
        Ok(index)
    }

    /// Reads what was written since.
    ///
    /// # Errors
    /// The system's.
    pub fn refresh(&mut self) -> Result<(), FileError> {
        let mut file = self.file()?;
        file.seek(SeekFrom::Start(self.read_to))
            .map_err(|error| FileError::io("read", &self.path, error))?;
        self.read_on(&mut BufReader::with_capacity(1 << 20, file))
    }

    /// Names of the channels.
    pub fn channels(&self) -> &[String] {
        &self.channels
    }

    /// The blocks, in the order of the file.
    pub fn blocks(&self) -> &[CountBlock] {
        &self.blocks
    }

    /// Whole rows.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// What ended the index before the file's end, with its row.
    pub fn fault(&self) -> Option<&str> {
        self.fault.as_deref()
    }

    /// Start of the first bin and end of the last one.
    pub fn span(&self) -> Option<[Epoch; 2]> {
        Some([self.blocks.first()?.start, self.blocks.last()?.end])
    }

    /// The blocks that have bins within a stretch of time.
    pub fn within(&self, from: Epoch, to: Epoch) -> &[CountBlock] {
        let first = self.blocks.partition_point(|block| block.end <= from);
        let last = self.blocks.partition_point(|block| block.start < to);
        self.blocks.get(first..last.max(first)).unwrap_or_default()
    }

    /// The bins of a stretch of time, at most `most` of them, read from the file.
    ///
    /// # Errors
    /// The system's; a row that is none since the index was made.
    pub fn records(
        &self,
        from: Epoch,
        to: Epoch,
        most: usize,
    ) -> Result<Vec<CountRecord>, FileError> {
        let blocks = self.within(from, to);
        let Some(first) = blocks.first() else { return Ok(Vec::new()) };
        let rows: u64 = blocks.iter().map(|block| block.rows).sum();
        let mut file = self.file()?;
        file.seek(SeekFrom::Start(first.offset))
            .map_err(|error| FileError::io("read", &self.path, error))?;
        let mut file = BufReader::with_capacity(1 << 16, file);
        let (mut line, mut records) = (Vec::new(), Vec::new());
        for _ in 0..rows {
            if records.len() >= most || self.line(&mut file, &mut line)? == 0 {
                break;
            }
            let Some(record) = record(&line, self.channels.len()) else {
                let found = crate::error::excerpt(&String::from_utf8_lossy(&line));
                return Err(ParseError::new(&self.path, found, "a row of counts").into());
            };
            if record.start >= from && record.start < to {
                records.push(record);
            }
        }
        Ok(records)
    }

    fn file(&self) -> Result<File, FileError> {
        File::open(&self.path).map_err(|error| FileError::io("read", &self.path, error))
    }

    /// The next whole line and its bytes; 0 at the end, where a line without its end does not count.
    fn line(&self, file: &mut BufReader<File>, line: &mut Vec<u8>) -> Result<u64, FileError> {
        line.clear();
        let io = |error| FileError::io("read", &self.path, error);
        let read = file.by_ref().take(LONGEST).read_until(b'\n', line).map_err(io)?;
        Ok(if line.last() == Some(&b'\n') { read as u64 } else { 0 })
    }

    fn read_on(&mut self, file: &mut BufReader<File>) -> Result<(), FileError> {
        let mut line = Vec::new();
        loop {
            let bytes = self.line(file, &mut line)?;
            if bytes == 0 {
                return Ok(());
            }
            let Some(record) = record(&line, self.channels.len()) else {
                let found = crate::error::excerpt(&String::from_utf8_lossy(&line));
                self.fault = Some(format!("row {}: {found} is no row of counts", self.rows + 1));
                return Ok(());
            };
            self.add(&record, self.read_to);
            self.read_to += bytes;
            self.rows += 1;
        }
    }

    fn add(&mut self, record: &CountRecord, offset: u64) {
        let length_s = record.length_ps as f64 * 1e-12;
        let end =
            record.start + Duration::from_total_nanoseconds(i128::from(record.length_ps) / 1000);
        // A gap begins a block, so that none bridges it.
        let anew = self.blocks.last().is_none_or(|block| {
            block.rows >= ROWS || (record.start - block.end).to_seconds().abs() > 0.5 * length_s
        });
        if anew {
            self.blocks.push(CountBlock {
                start: record.start,
                end,
                offset,
                rows: 0,
                flags: CountFlags::empty(),
                exposure_s: 0.0,
                counts: vec![0; self.channels.len()],
                range_hz: vec![[f64::INFINITY, f64::NEG_INFINITY]; self.channels.len()],
            });
        }
        let Some(block) = self.blocks.last_mut() else { return };
        block.end = end;
        block.rows += 1;
        block.flags |= record.flags;
        block.exposure_s += length_s;
        for (i, &counts) in record.counts.iter().enumerate() {
            block.counts[i] = block.counts[i].saturating_add(counts);
            if length_s > 0.0 {
                let rate_hz = counts as f64 / length_s;
                let [low, high] = block.range_hz[i];
                block.range_hz[i] = [low.min(rate_hz), high.max(rate_hz)];
            }
        }
    }
}

/// The names of the columns, as the writer has them.
fn header_of(channels: &[String]) -> String {
    let each = channels.iter().map(|channel| format!(",{channel}_counts,{channel}_missed"));
    format!("start_utc,start_ps,length_ps,flags{}", each.collect::<String>())
}

/// A row of the table, as the writer has it.
fn record(line: &[u8], channels: usize) -> Option<CountRecord> {
    let mut fields = std::str::from_utf8(line).ok()?.trim_end().split(',');
    let start = parse_utc(fields.next()?).ok()?;
    let start_ps = fields.next()?.parse().ok()?;
    let length_ps: i64 = fields.next()?.parse().ok()?;
    let flags = CountFlags::from_bits_retain(fields.next()?.parse().ok()?);
    let (mut counts, mut missed) = (Vec::with_capacity(channels), Vec::with_capacity(channels));
    for _ in 0..channels {
        counts.push(fields.next()?.parse().ok()?);
        missed.push(fields.next()?.parse().ok()?);
    }
    (fields.next().is_none() && length_ps >= 0).then_some(CountRecord {
        start,
        start_ps,
        length_ps,
        counts,
        missed,
        flags,
    })
}
