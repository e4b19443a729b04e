//! The few things that a session asks of a disk, so that a test can stand in for one.

use std::fmt;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Write as _};
use std::path::Path;

/// A disk, as a session's writer needs it.
///
/// [`Disk`] is the system's; [`Fragile`](super::Fragile) one that runs full, fails and loses what was not synced.
pub trait Storage: Send + Sync + fmt::Debug {
    /// A new, empty file that grows at its end.
    ///
    /// # Errors
    /// It is there already, or the system refuses.
    fn create(&self, path: &Path) -> io::Result<Box<dyn Growing>>;

    /// A file that is there already, to grow on at its end.
    ///
    /// # Errors
    /// It is not there, or the system refuses; a storage that cannot go on with a file.
    fn reopen(&self, path: &Path) -> io::Result<Box<dyn Growing>> {
        let _ = path;
        Err(io::ErrorKind::Unsupported.into())
    }

    /// Keeps a file for this process alone, until the result is dropped or the process ends. `None` where the system knows no such thing.
    ///
    /// # Errors
    /// Another process has it ([`io::ErrorKind::WouldBlock`]), or the system refuses.
    fn lock(&self, path: &Path) -> io::Result<Option<File>> {
        let _ = path;
        Ok(None)
    }

    /// A new folder; nothing where it is there already.
    ///
    /// # Errors
    /// The system refuses.
    fn create_folder(&self, path: &Path) -> io::Result<()>;

    /// Gives a file another name in the same folder.
    ///
    /// # Errors
    /// The system refuses.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;

    /// Takes a file away.
    ///
    /// # Errors
    /// The system refuses.
    fn remove(&self, path: &Path) -> io::Result<()>;

    /// Writes the names in a folder through to the disk.
    ///
    /// # Errors
    /// The system refuses.
    fn sync_folder(&self, path: &Path) -> io::Result<()>;
}

/// A file that grows at its end.
pub trait Growing: Send + fmt::Debug {
    /// Hands bytes to the system.
    ///
    /// # Errors
    /// The system refuses: some of the bytes may be in the file then.
    fn append(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// Cuts the file to so many bytes; the next ones follow there.
    ///
    /// # Errors
    /// The system refuses.
    fn cut(&mut self, length: u64) -> io::Result<()>;

    /// Writes the bytes through to the disk.
    ///
    /// # Errors
    /// The system refuses. Nobody knows then which of the bytes since the last success are on the disk, and a second call
    /// that succeeds says nothing about them: they have to be written again.
    fn sync(&mut self) -> io::Result<()>;
}

/// The system's own files.
#[derive(Debug, Clone, Copy, Default)]
pub struct Disk;

#[derive(Debug)]
struct Plain(File);

impl Storage for Disk {
    fn create(&self, path: &Path) -> io::Result<Box<dyn Growing>> {
        // Opened to append: after a cut the next bytes follow at the new end.
        let file = OpenOptions::new().append(true).create_new(true).open(path)?;
        Ok(Box::new(Plain(file)))
    }

    fn reopen(&self, path: &Path) -> io::Result<Box<dyn Growing>> {
        Ok(Box::new(Plain(OpenOptions::new().append(true).open(path)?)))
    }

    fn lock(&self, path: &Path) -> io::Result<Option<File>> {
        // Elsewhere a lock would keep readers away, too.
        if !cfg!(unix) {
            return Ok(None);
        }
        let file = File::open(path)?;
        match file.try_lock() {
            Ok(()) => Ok(Some(file)),
            Err(TryLockError::WouldBlock) => Err(io::ErrorKind::WouldBlock.into()),
            // Some network file systems know no locks.
            Err(TryLockError::Error(_)) => Ok(None),
        }
    }

    fn create_folder(&self, path: &Path) -> io::Result<()> {
        match std::fs::create_dir(path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists && path.is_dir() => Ok(()),
            made => made,
        }
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        std::fs::rename(from, to)
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        std::fs::remove_file(path)
    }

    fn sync_folder(&self, path: &Path) -> io::Result<()> {
        // Only here can a folder be opened as a file.
        if cfg!(unix) { File::open(path)?.sync_all() } else { Ok(()) }
    }
}

impl Growing for Plain {
    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.0.write_all(bytes)
    }

    fn cut(&mut self, length: u64) -> io::Result<()> {
        self.0.set_len(length)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.0.sync_data()
    }
}
