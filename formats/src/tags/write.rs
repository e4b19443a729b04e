//! Writing tags as they come, so that a crash loses at most a second of them.

use super::tag::{RECORD_BYTES, Tag};
use crate::FileError;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// How old, on the caller's clock, unsynced tags are when a call writes them through to the disk: half a second, so that
/// calls at least twice a second keep all but the last second safe.
pub const SYNC_EVERY: Duration = Duration::from_millis(500);

/// Bytes that are kept before they are handed to the system.
const BUFFER_BYTES: usize = 1 << 18;

/// Appends tags to a file. Call [`TagWriter::write`], or [`TagWriter::tick`] when no tags come, at least twice a second.
///
/// A writer that is dropped hands its last tags to the system and says nothing; [`TagWriter::finish`] says whether they
/// reached the disk.
#[derive(Debug)]
pub struct TagWriter {
    file: File,
    path: PathBuf,
    buffer: Vec<u8>,
    /// Records that the system took.
    written: u64,
    synced_at: Option<Duration>,
    /// Whether something is not on the disk yet.
    unsynced: bool,
    /// After a failure nobody knows what is on the disk: no more is written.
    failed: bool,
}

impl TagWriter {
    /// A new file.
    ///
    /// # Errors
    /// [`FileError::Exists`] if it is there already ([`TagWriter::append`] goes on with one); [`FileError::Io`] if the system
    /// refuses.
    pub fn create(path: impl AsRef<Path>) -> Result<Self, FileError> {
        Self::create_at(path.as_ref())
    }

    fn create_at(path: &Path) -> Result<Self, FileError> {
        let file = OpenOptions::new().write(true).create_new(true).open(path);
        let file = file.map_err(|source| match source.kind() {
            std::io::ErrorKind::AlreadyExists => FileError::Exists { path: path.to_path_buf() },
            _ => FileError::io("create", path, source),
        })?;
        lock(&file, path)?;
        // The name itself is only safe once the folder is on the disk; some file systems cannot do that.
        #[cfg(unix)]
        {
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
            if let Ok(folder) = File::open(folder.unwrap_or(Path::new("."))) {
                let _ = folder.sync_all();
            }
        }
        Ok(Self::of(file, path, 0))
    }

    /// Goes on with a file that is there. What a crash left of its last record is cut off, and whole records of zeros
    /// at its end with it; the second value is how many bytes that were.
    ///
    /// # Errors
    /// [`FileError::Io`] if it is not a plain file, another writer is at it, or the system refuses.
    pub fn append(path: impl AsRef<Path>) -> Result<(Self, u64), FileError> {
        Self::append_at(path.as_ref())
    }

    fn append_at(path: &Path) -> Result<(Self, u64), FileError> {
        // Refuses what is not a plain file, before it is opened for writing.
        super::TagFile::recover(path)?;
        let io = |source| FileError::io("write", path, source);
        let mut file = OpenOptions::new().read(true).write(true).open(path).map_err(io)?;
        lock(&file, path)?;
        // Only now does no other writer make it longer.
        let (_, recovered) = super::TagFile::recover(path)?;
        let len = file.metadata().map_err(io)?.len();
        let whole = recovered.records * RECORD_BYTES as u64;
        if len > whole {
            file.set_len(whole).map_err(io)?;
            file.sync_all().map_err(io)?;
        }
        file.seek(SeekFrom::Start(whole)).map_err(io)?;
        Ok((Self::of(file, path, recovered.records), len.saturating_sub(whole)))
    }

    fn of(file: File, path: &Path, written: u64) -> Self {
        Self {
            file,
            path: path.to_path_buf(),
            buffer: Vec::with_capacity(BUFFER_BYTES),
            written,
            synced_at: None,
            unsynced: false,
            failed: false,
        }
    }

    /// How many records the file has, those included that are still on their way.
    pub fn records(&self) -> u64 {
        self.written + (self.buffer.len() / RECORD_BYTES) as u64
    }

    /// Appends tags. `now` is any clock of the caller that does not run backwards.
    ///
    /// # Errors
    /// [`FileError::Io`] if the system refuses, for instance because the disk is full. After that nothing more is written:
    /// what is there can be read, and [`TagWriter::append`] goes on with it.
    pub fn write(&mut self, tags: &[Tag], now: Duration) -> Result<(), FileError> {
        self.refuse_after_failure()?;
        for chunk in tags.chunks(BUFFER_BYTES / RECORD_BYTES) {
            if self.buffer.len() + chunk.len() * RECORD_BYTES > BUFFER_BYTES {
                self.flush()?;
            }
            self.buffer.extend(chunk.iter().flat_map(Tag::to_bytes));
            self.unsynced = true;
        }
        self.tick(now)
    }

    /// Writes through to the disk what has waited long enough (see [`SYNC_EVERY`]).
    ///
    /// # Errors
    /// The errors of [`TagWriter::write`].
    pub fn tick(&mut self, now: Duration) -> Result<(), FileError> {
        self.refuse_after_failure()?;
        let synced_at = *self.synced_at.get_or_insert(now);
        if now.saturating_sub(synced_at) >= SYNC_EVERY {
            self.synced_at = Some(now);
            self.sync()?;
        }
        Ok(())
    }

    /// Writes all that is left through to the disk.
    ///
    /// # Errors
    /// The errors of [`TagWriter::write`].
    pub fn finish(mut self) -> Result<u64, FileError> {
        self.refuse_after_failure()?;
        self.sync()?;
        Ok(self.written)
    }

    fn refuse_after_failure(&self) -> Result<(), FileError> {
        if !self.failed {
            return Ok(());
        }
        let why = format!("writing failed before; {} records are whole", self.written);
        Err(FileError::io("write", &self.path, std::io::Error::other(why)))
    }

    fn sync(&mut self) -> Result<(), FileError> {
        self.flush()?;
        if self.unsynced {
            let synced = self.file.sync_data();
            self.keep(synced)?;
            self.unsynced = false;
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), FileError> {
        let written = self.file.write_all(&self.buffer);
        if written.is_err() {
            // Half a record may be there; without it the file can be read as it is. If even that fails, it is recovered
            // when it is opened again.
            let _ = self.file.set_len(self.written * RECORD_BYTES as u64);
            self.buffer.clear();
        }
        self.keep(written)?;
        self.written += (self.buffer.len() / RECORD_BYTES) as u64;
        self.buffer.clear();
        Ok(())
    }

    fn keep(&mut self, result: std::io::Result<()>) -> Result<(), FileError> {
        self.failed |= result.is_err();
        result.map_err(|source| FileError::io("write", &self.path, source))
    }
}

/// Keeps other writers away, that would cut what this one has half written.
fn lock(file: &File, path: &Path) -> Result<(), FileError> {
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => {
            let why = std::io::Error::other("another program is writing to it");
            Err(FileError::io("write", path, why))
        }
        // Some file systems know no locks.
        Ok(()) | Err(TryLockError::Error(_)) => Ok(()),
    }
}

impl Drop for TagWriter {
    fn drop(&mut self) {
        if !self.failed {
            let _ = self.flush();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Truth: Linux's device that refuses each write as a full disk does.
    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_an_error_that_stays() {
        let path = Path::new("/dev/full");
        let Ok(full) = OpenOptions::new().write(true).open(path) else {
            sunglint_testkit::skip("a_full_disk_is_an_error_that_stays", "no /dev/full");
            return;
        };
        let mut writer = TagWriter::of(full, path, 7);
        writer.write(&[Tag::photon(1, 1)], Duration::ZERO).unwrap();
        let message = writer.tick(Duration::from_secs(1)).unwrap_err().to_string();
        assert!(message.contains("No space left"), "{message}");
        let message = writer.write(&[], Duration::from_secs(1)).unwrap_err().to_string();
        assert!(message.contains("writing failed before; 7 records are whole"), "{message}");
        assert!(writer.finish().is_err());
    }
}
