//! Writing a file so that it is there whole or not at all.

use crate::error::FileError;
use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// Whether a file that is there already may be replaced.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Overwrite {
    /// Leave it and report [`FileError::Exists`]: the habit of the program without `--force`.
    #[default]
    Refuse,
    /// Replace it.
    Allow,
}

/// Writes `bytes` to `path`: into a temporary file of the same folder, flushed to the disk, then moved into place.
/// A crash or a full disk leaves the old file (or none), never half a file.
///
/// # Errors
/// [`FileError::Exists`] if the file is there and `overwrite` refuses; [`FileError::Io`] if the system refuses.
pub fn write_file(
    path: impl AsRef<Path>,
    bytes: &[u8],
    overwrite: Overwrite,
) -> Result<(), FileError> {
    let mut part = Part::begin(path.as_ref(), overwrite)?;
    part.write_all(bytes).map_err(|source| FileError::io("write", path.as_ref(), source))?;
    part.finish()
}

/// A file in the making, for what is written piece by piece: a temporary file of the same folder, which [`Part::finish`] moves into place. Nothing is left of it where it is dropped before.
///
/// ```
/// use std::io::Write as _;
/// use sunglint_formats::atomic::{Overwrite, Part};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("long.csv");
/// let mut part = Part::begin(&path, Overwrite::Refuse)?;
/// part.write_all(b"a,b\n")?;
/// part.write_all(b"1,2\n")?;
/// assert!(!path.exists());
/// part.finish()?;
/// assert_eq!(std::fs::read(&path)?, b"a,b\n1,2\n");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Part {
    file: NamedTempFile,
    path: PathBuf,
    overwrite: Overwrite,
}

impl Part {
    /// Begins a file.
    ///
    /// # Errors
    /// The errors of [`write_file`].
    pub fn begin(path: impl Into<PathBuf>, overwrite: Overwrite) -> Result<Self, FileError> {
        let path = path.into();
        // Before the work, for a quick answer; the move at the end closes the race.
        if overwrite == Overwrite::Refuse && path.symlink_metadata().is_ok() {
            return Err(FileError::Exists { path });
        }
        let mut builder = tempfile::Builder::new();
        builder.prefix(".sunglint-").suffix(".part");
        // Made as any new file, so that the umask decides who reads it, and with the system's own words where that fails: what `tempfile` makes by itself is
        // private, and its errors name a file that the user never gave.
        let make = |part: &Path| File::options().write(true).create_new(true).open(part);
        let made = builder.make_in(folder_of(&path), make);
        let file = made.map_err(|source| FileError::io("write", &path, source))?;
        Ok(Self { file, path, overwrite })
    }

    /// The file that is being made.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The temporary file, for whoever has to remove it when the program is told to end.
    pub fn part_path(&self) -> &Path {
        self.file.path()
    }

    /// Flushes the file to the disk and moves it into place.
    ///
    /// # Errors
    /// The errors of [`write_file`].
    pub fn finish(self) -> Result<(), FileError> {
        let Self { file, path, overwrite } = self;
        let io = |source| FileError::io("write", &path, source);
        file.as_file().sync_all().map_err(io)?;
        match overwrite {
            Overwrite::Allow => file.persist(&path).map_err(|e| io(e.error))?,
            Overwrite::Refuse => {
                file.persist_noclobber(&path).map_err(|e| match e.error.kind() {
                    std::io::ErrorKind::AlreadyExists => FileError::Exists { path: path.clone() },
                    _ => io(e.error),
                })?
            }
        };
        // The name itself is only safe once the folder is on the disk; some file systems cannot do that.
        #[cfg(unix)]
        if let Ok(folder) = File::open(folder_of(&path)) {
            let _ = folder.sync_all();
        }
        Ok(())
    }
}

impl Write for Part {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.as_file_mut().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.as_file_mut().flush()
    }
}

impl Seek for Part {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.as_file_mut().seek(to)
    }
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_name_the_users_file_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("not there").join("a.txt");
        let message = write_file(&path, b"x", Overwrite::Allow).unwrap_err().to_string();
        assert!(message.starts_with(&format!("cannot write {}: ", path.display())), "{message}");
        assert!(!message.contains(".part"), "{message}");
    }

    #[test]
    fn a_file_is_not_overwritten_unless_asked_and_no_part_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("night.ecsv");
        write_file(&path, b"one", Overwrite::Refuse).unwrap();
        let refused = write_file(&path, b"two", Overwrite::Refuse).unwrap_err();
        assert!(matches!(refused, FileError::Exists { .. }), "{refused}");
        assert_eq!(std::fs::read(&path).unwrap(), b"one");
        write_file(&path, b"two", Overwrite::Allow).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"two");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn nothing_is_left_of_a_file_that_was_not_finished() {
        let folder = tempfile::tempdir().unwrap();
        let mut part = Part::begin(folder.path().join("night.fits"), Overwrite::Refuse).unwrap();
        part.write_all(b"half").unwrap();
        assert!(part.part_path().exists());
        drop(part);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_missing_folder_is_an_error_with_the_path() {
        let folder = tempfile::tempdir().unwrap();
        let error =
            write_file(folder.path().join("no/such.ecsv"), b"", Overwrite::Refuse).unwrap_err();
        assert!(error.to_string().contains("no/such.ecsv"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn the_file_is_as_readable_as_any_other_new_file() {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().unwrap();
        write_file(folder.path().join("ours"), b"", Overwrite::Refuse).unwrap();
        File::create(folder.path().join("theirs")).unwrap();
        let mode = |name| folder.path().join(name).metadata().unwrap().permissions().mode();
        assert_eq!(mode("ours"), mode("theirs"));
    }
}
