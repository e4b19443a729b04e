//! Writing a file so that it is there whole or not at all.

use crate::error::FileError;
use std::fs::File;
use std::io::Write as _;
use std::path::Path;

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
    let path = path.as_ref();
    let io = |source| FileError::io("write", path, source);
    // Before the work, for a quick answer; the move below closes the race.
    if overwrite == Overwrite::Refuse && path.symlink_metadata().is_ok() {
        return Err(FileError::Exists { path: path.to_path_buf() });
    }
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    builder.prefix(".sunglint-").suffix(".part");
    // Made as any new file, so that the umask decides who reads it, and with the system's own words where that fails: what `tempfile` makes by itself is
    // private, and its errors name a file that the user never gave.
    let make = |part: &Path| File::options().write(true).create_new(true).open(part);
    let mut file = builder.make_in(folder, make).map_err(io)?;
    file.write_all(bytes).map_err(io)?;
    file.as_file().sync_all().map_err(io)?;
    match overwrite {
        Overwrite::Allow => file.persist(path).map_err(|e| io(e.error))?,
        Overwrite::Refuse => file.persist_noclobber(path).map_err(|e| match e.error.kind() {
            std::io::ErrorKind::AlreadyExists => FileError::Exists { path: path.to_path_buf() },
            _ => io(e.error),
        })?,
    };
    // The name itself is only safe once the folder is on the disk; some file systems cannot do that.
    #[cfg(unix)]
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
    Ok(())
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
