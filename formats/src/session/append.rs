//! A file of lines that only grows, and how far it is safe.

use super::event::Mark;
use super::storage::{Growing, Storage};
use std::io::{self, Read as _};
use std::path::Path;

/// Bytes that wait in memory while the disk takes none; what comes then is lost, and counted.
pub(super) const MOST_LINES: usize = 1 << 20;

/// Lines on their way to the disk.
///
/// The bytes since the last sync are kept: after a sync that failed nobody knows which of them are on the disk, so they are
/// cut off and written again.
#[derive(Debug)]
pub(super) struct Appender {
    /// Within the session's folder, with `/`.
    pub name: String,
    file: Box<dyn Growing>,
    /// Mark up to which the file is safely on the disk.
    safe: Mark,
    hasher: flate2::Crc,
    /// Bytes written since that mark, whole lines.
    tail: Vec<u8>,
    tail_rows: u64,
    /// How much of the tail the system has.
    handed: usize,
    /// The file may have more bytes than the system said it took.
    torn: bool,
    /// Bytes that wait at most.
    most: usize,
    /// Rows that found no room.
    lost: u64,
}

impl Appender {
    /// A new file that begins with `header`, which counts as no row; it is not synced yet.
    pub fn create(
        storage: &dyn Storage,
        root: &Path,
        name: &str,
        header: &[u8],
        most: usize,
    ) -> io::Result<Self> {
        let file = storage.create(&root.join(name))?;
        let mut appender = Self {
            name: name.to_owned(),
            file,
            safe: Mark { file: name.to_owned(), bytes: 0, rows: 0, crc32: 0 },
            hasher: flate2::Crc::new(),
            tail: header.to_vec(),
            tail_rows: 0,
            handed: 0,
            torn: false,
            most,
            lost: 0,
        };
        appender.flush()?;
        Ok(appender)
    }

    /// Goes on with a file that is there, behind its first `keep` bytes with `rows` rows; the rest is cut off. What is kept is written through to the disk.
    pub fn reopen(
        storage: &dyn Storage,
        root: &Path,
        name: &str,
        (keep, rows): (u64, u64),
        most: usize,
    ) -> io::Result<Self> {
        let path = root.join(name);
        let mut hasher = flate2::Crc::new();
        let mut left = std::fs::File::open(&path)?.take(keep);
        let mut room = vec![0; 1 << 16];
        loop {
            match left.read(&mut room)? {
                0 => break,
                n => hasher.update(&room[..n]),
            }
        }
        let mut file = storage.reopen(&path)?;
        file.cut(keep)?;
        file.sync()?;
        let safe = Mark { file: name.to_owned(), bytes: keep, rows, crc32: hasher.sum() };
        Ok(Self {
            name: name.to_owned(),
            file,
            safe,
            hasher,
            tail: Vec::new(),
            tail_rows: 0,
            handed: 0,
            torn: false,
            most,
            lost: 0,
        })
    }

    /// Takes a whole line, with its end. Whether there was room for it; the system gets it when it takes any.
    pub fn push(&mut self, line: &[u8]) -> bool {
        self.push_rows(line, 1)
    }

    /// Takes so many whole rows. Whether there was room for them.
    pub fn push_rows(&mut self, bytes: &[u8], rows: u64) -> bool {
        if self.tail.len() + bytes.len() > self.most {
            self.lost += rows;
            return false;
        }
        self.tail.extend_from_slice(bytes);
        self.tail_rows += rows;
        true
    }

    /// Rows that were lost before they came here.
    pub fn lose(&mut self, rows: u64) {
        self.lost += rows;
    }

    /// Hands to the system what it has not got.
    pub fn flush(&mut self) -> io::Result<()> {
        self.mend()?;
        let result = self.file.append(&self.tail[self.handed..]);
        match result {
            Ok(()) => self.handed = self.tail.len(),
            Err(_) => {
                // Some of it may be there, down to half a line: off again, so that whoever reads now sees whole lines.
                self.torn = true;
                let _ = self.mend();
            }
        }
        result
    }

    /// Writes all through to the disk; the new mark, or none where nothing was new.
    pub fn sync(&mut self) -> io::Result<Option<Mark>> {
        self.flush()?;
        if self.tail.is_empty() {
            return Ok(None);
        }
        if let Err(error) = self.file.sync() {
            self.handed = 0;
            self.torn = true;
            return Err(error);
        }
        self.hasher.update(&self.tail);
        self.safe.bytes += self.tail.len() as u64;
        self.safe.rows += self.tail_rows;
        self.safe.crc32 = self.hasher.sum();
        (self.tail_rows, self.handed) = (0, 0);
        self.tail.clear();
        Ok(Some(self.safe.clone()))
    }

    /// How far it is safe.
    pub fn mark(&self) -> &Mark {
        &self.safe
    }

    /// Bytes that are not safe yet.
    pub fn waiting_bytes(&self) -> usize {
        self.tail.len()
    }

    /// Rows that did not find room.
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Those, and the ones that are not safe yet.
    pub fn missing(&self) -> u64 {
        self.lost + self.tail_rows
    }

    fn mend(&mut self) -> io::Result<()> {
        if self.torn {
            self.file.cut(self.safe.bytes + self.handed as u64)?;
            self.torn = false;
        }
        Ok(())
    }
}
