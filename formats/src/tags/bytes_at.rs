//! The bytes of a plain file at any place, for any number of threads, in memory that the caller bounds.

use crate::{FileError, ParseError};
use std::fs::File;
use std::path::{Path, PathBuf};

/// A plain file as long as it was when it was opened, or what stands for it.
#[derive(Debug)]
pub struct BytesAt {
    path: PathBuf,
    source: Source,
    len: u64,
}

#[derive(Debug)]
enum Source {
    #[cfg(unix)]
    File(File),
    #[cfg(not(unix))]
    File(std::sync::Mutex<File>),
    Memory(Vec<u8>),
}

impl BytesAt {
    /// Opens a plain file.
    ///
    /// # Errors
    /// A path that cannot be read, or is no plain file.
    pub fn open(path: &Path) -> Result<Self, FileError> {
        let io = |source| FileError::io("read", path, source);
        // Asked before it is opened: opening a pipe waits for whoever writes to it.
        let about = std::fs::metadata(path).map_err(io)?;
        if !about.is_file() {
            let what = if about.is_dir() { "a folder" } else { "a pipe or a device" };
            let why = format!("it is {what}, not a file");
            return Err(io(std::io::Error::new(std::io::ErrorKind::InvalidInput, why)));
        }
        let file = File::open(path).map_err(io)?;
        let len = file.metadata().map_err(io)?.len();
        #[cfg(not(unix))]
        let file = std::sync::Mutex::new(file);
        Ok(Self { path: path.to_path_buf(), source: Source::File(file), len })
    }

    /// Bytes that are in memory already; `path` stands for them in errors.
    pub fn memory(path: &Path, bytes: Vec<u8>) -> Self {
        let len = bytes.len() as u64;
        Self { path: path.to_path_buf(), source: Source::Memory(bytes), len }
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Length of the file, bytes.
    #[expect(clippy::len_without_is_empty, reason = "nobody asks")]
    pub fn len(&self) -> u64 {
        self.len
    }

    /// Fills `bytes` with what stands from `start` on.
    ///
    /// # Errors
    /// A file that has become shorter, or cannot be read any more.
    pub fn read(&self, start: u64, bytes: &mut [u8]) -> Result<(), FileError> {
        let end = start.saturating_add(bytes.len() as u64);
        if end > self.len {
            let found = format!("the end of the file at byte {}", self.len);
            let error = ParseError::new(&self.path, found, format!("bytes up to {end}"));
            return Err(error.in_field(format!("byte {start}")).into());
        }
        self.read_exact(start, bytes).map_err(|error| match error.kind() {
            std::io::ErrorKind::UnexpectedEof => {
                let found = "the end of the file";
                let expected = format!("the {} bytes that it had when it was opened", self.len);
                let error = ParseError::new(&self.path, found, expected);
                error.in_field(format!("byte {start}")).with_hint("another program cut it").into()
            }
            _ => FileError::io("read", &self.path, error),
        })
    }

    fn read_exact(&self, start: u64, bytes: &mut [u8]) -> std::io::Result<()> {
        match &self.source {
            Source::File(file) => read_file(file, start, bytes),
            Source::Memory(all) => {
                let there = usize::try_from(start).ok().and_then(|start| all.get(start..));
                let there = there.and_then(|there| there.get(..bytes.len()));
                let there = there.ok_or(std::io::ErrorKind::UnexpectedEof)?;
                bytes.copy_from_slice(there);
                Ok(())
            }
        }
    }
}

#[cfg(unix)]
fn read_file(file: &File, start: u64, bytes: &mut [u8]) -> std::io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, start)
}

#[cfg(not(unix))]
fn read_file(file: &std::sync::Mutex<File>, start: u64, bytes: &mut [u8]) -> std::io::Result<()> {
    use std::io::{Read as _, Seek as _};
    let poisoned = || std::io::Error::other("another thread failed while it read");
    let mut file = file.lock().map_err(|_| poisoned())?;
    file.seek(std::io::SeekFrom::Start(start))?;
    file.read_exact(bytes)
}
