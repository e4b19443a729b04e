//! A counter's table, row by row: out as the bins come, in without holding them all.

use crate::counts::{CountRecord, CountSeries};
use crate::error::{EncodeError, FileError, ParseError};
use crate::table::Meta;
use crate::time::format_utc_shortest;
use std::collections::VecDeque;
use std::fmt::Write as _;
use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};

/// The table's header: what [`CountSeries`] writes for no records, names of the columns included.
///
/// # Errors
/// The errors of [`CountSeries::to_table`].
pub(super) fn header(channels: &[String], meta: &Meta) -> Result<String, EncodeError> {
    let series = CountSeries { channels: channels.to_vec(), records: vec![], meta: meta.clone() };
    crate::ecsv::to_string(&series.to_table()?)
}

/// The row of a record, as [`CountSeries`] writes it.
///
/// # Errors
/// Another number of channels; a count beyond 63 bits.
pub(super) fn row(record: &CountRecord, channels: &[String]) -> Result<String, EncodeError> {
    let found = [record.counts.len(), record.missed.len()];
    if found != [channels.len(); 2] {
        let found = format!("{} counts and {} missed", found[0], found[1]);
        let expected = format!("{} of each, one for each channel", channels.len());
        return Err(EncodeError::new(format_utc_shortest(record.start), found, expected));
    }
    let CountRecord { start, start_ps, length_ps, flags, .. } = record;
    let mut row = format_utc_shortest(*start);
    let _ = write!(row, ",{start_ps},{length_ps},{}", flags.bits());
    for (i, channel) in channels.iter().enumerate() {
        for value in [record.counts[i], record.missed[i]] {
            let whole = i64::try_from(value).map_err(|_| {
                EncodeError::new(channel, value.to_string(), format!("at most {}", i64::MAX))
            })?;
            let _ = write!(row, ",{whole}");
        }
    }
    row.push('\n');
    Ok(row)
}

/// Rows that are parsed at once.
const ROWS: usize = 1024;
/// No line of ours is longer, bytes; a longer one is none of ours.
const LONGEST: u64 = 1 << 16;

/// The bins of a counter, in the order in which they were written, a thousand at a time in memory.
///
/// A last line without its end was cut off as it was written: it is left out, and [`torn_bytes`](Self::torn_bytes) says how
/// long it is.
#[derive(Debug)]
pub struct Counts {
    path: PathBuf,
    file: BufReader<File>,
    header: String,
    header_lines: u64,
    series: CountSeries,
    ready: VecDeque<CountRecord>,
    rows: u64,
    torn_bytes: u64,
    ended: bool,
    failed: Option<FileError>,
}

impl Counts {
    /// Opens a table.
    ///
    /// # Errors
    /// The system's, or a header that is not one of counts.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, FileError> {
        Self::open_at(path.as_ref())
    }

    fn open_at(path: &Path) -> Result<Self, FileError> {
        let file = File::open(path).map_err(|error| FileError::io("read", path, error))?;
        let mut counts = Self {
            path: path.to_path_buf(),
            file: BufReader::with_capacity(1 << 16, file),
            header: String::new(),
            header_lines: 0,
            series: CountSeries::default(),
            ready: VecDeque::new(),
            rows: 0,
            torn_bytes: 0,
            ended: false,
            failed: None,
        };
        // The comment lines, and one more: the names of the columns.
        let mut header = String::new();
        while let Some(line) = counts.line()? {
            counts.header_lines += 1;
            header.push_str(&line);
            if !line.starts_with('#') {
                break;
            }
        }
        counts.series = counts.parse(&header)?;
        counts.header = header;
        Ok(counts)
    }

    /// Names of the channels.
    pub fn channels(&self) -> &[String] {
        &self.series.channels
    }

    /// Returns the metadata of the series (device, identity …).
    pub fn meta(&self) -> &Meta {
        &self.series.meta
    }

    /// Bytes of a last line without its end; known once all rows were read.
    pub fn torn_bytes(&self) -> u64 {
        self.torn_bytes
    }

    /// The next whole line with its end.
    fn line(&mut self) -> Result<Option<String>, FileError> {
        use std::io::Read as _;
        let mut line = Vec::new();
        let io = |error| FileError::io("read", &self.path, error);
        self.file.by_ref().take(LONGEST).read_until(b'\n', &mut line).map_err(io)?;
        if line.last() != Some(&b'\n') {
            if line.len() as u64 == LONGEST {
                let found = format!("a line of more than {LONGEST} bytes");
                let error = ParseError::new(&self.path, found, "rows of counts");
                return Err(error.at_line(self.header_lines + self.rows + 1).into());
            }
            self.torn_bytes = line.len() as u64;
            return Ok(None);
        }
        Ok(Some(crate::read::decode(&self.path, line)?))
    }

    fn parse(&self, text: &str) -> Result<CountSeries, ParseError> {
        let table = crate::ecsv::read_str(&self.path, text)?;
        CountSeries::from_table(&self.path, &table)
    }

    /// Reads on. What is wrong with a row is told once the rows before it were given.
    fn fill(&mut self) -> Result<(), FileError> {
        let mut lines = Vec::new();
        while lines.len() < ROWS {
            let Some(line) = self.line()? else { break };
            lines.push(line);
        }
        self.ended = lines.len() < ROWS;
        match self.parse(&format!("{}{}", self.header, lines.concat())) {
            Ok(series) => {
                self.rows += lines.len() as u64;
                self.ready.extend(series.records);
                Ok(())
            }
            Err(_) => self.fill_singly(&lines),
        }
    }

    /// The same row by row, up to the one that is wrong.
    fn fill_singly(&mut self, lines: &[String]) -> Result<(), FileError> {
        for line in lines {
            match self.parse(&format!("{}{line}", self.header)) {
                Ok(series) => self.ready.extend(series.records),
                Err(error) => {
                    self.ended = true;
                    // Lines count from the top of the file.
                    let error = error.at_line(self.header_lines + self.rows + 1);
                    self.failed = Some(error.into());
                    return Ok(());
                }
            }
            self.rows += 1;
        }
        Ok(())
    }
}

impl Iterator for Counts {
    type Item = Result<CountRecord, FileError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ready.is_empty()
            && !self.ended
            && let Err(error) = self.fill()
        {
            self.ended = true;
            return Some(Err(error));
        }
        self.ready.pop_front().map(Ok).or_else(|| self.failed.take().map(Err))
    }
}
