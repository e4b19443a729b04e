//! A disk that runs full, fails, and loses at a power failure what was not synced: for tests.

use super::storage::{Disk, Growing, Storage};
use std::collections::HashMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};

/// Real files in a real folder, of which [`power_loss`](Self::power_loss) takes what POSIX lets a power failure take: bytes that
/// were not synced (or were, with an error), names that their folder has not synced. Clones are one disk.
#[derive(Debug, Clone)]
pub struct Fragile(Arc<Mutex<State>>);

#[derive(Debug, Default)]
struct State {
    /// Bytes that still fit; `None` where there is no end.
    room: Option<u64>,
    /// Syncs that will fail.
    failing_syncs: u32,
    files: HashMap<PathBuf, Bytes>,
    /// Names that their folders have not synced: the name before, if the file had one.
    names: Vec<(PathBuf, Option<PathBuf>)>,
}

#[derive(Debug, Default, Clone)]
struct Bytes {
    length: u64,
    safe: u64,
    /// From where a failed sync has thrown bytes away that a later sync does not bring back.
    thrown_from: Option<u64>,
}

#[derive(Debug)]
struct File {
    path: PathBuf,
    inner: Box<dyn Growing>,
    disk: Fragile,
}

impl Default for Fragile {
    fn default() -> Self {
        Self::new()
    }
}

impl Fragile {
    /// A disk without faults.
    pub fn new() -> Self {
        Self(Arc::new(Mutex::new(State::default())))
    }

    /// From now on so many bytes fit; `None` for all.
    pub fn set_room(&self, bytes: Option<u64>) {
        self.state().room = bytes;
    }

    /// The next `count` syncs of files fail with EIO, and throw away what they should have written.
    pub fn fail_syncs(&self, count: u32) {
        self.state().failing_syncs = count;
    }

    /// Takes from the files what a power failure may take: of the unsynced bytes of each file only a part stays, which `draw`
    /// (0 to 1, called as often as needed) decides, and so for the names that were not synced.
    ///
    /// # Errors
    /// The system's.
    pub fn power_loss(&self, mut draw: impl FnMut() -> f64) -> io::Result<()> {
        let mut state = self.state();
        let mut paths: Vec<PathBuf> = state.files.keys().cloned().collect();
        paths.sort();
        for path in paths {
            let bytes = state.files[&path].clone();
            let unsafe_bytes = bytes.length.saturating_sub(bytes.safe);
            let stay = bytes.safe + (unsafe_bytes as f64 * draw()) as u64;
            let file = std::fs::OpenOptions::new().write(true).open(&path)?;
            file.set_len(stay)?;
            // A file system that has given a file its length before its bytes leaves zeros.
            if let Some(from) = bytes.thrown_from.filter(|&from| from < stay) {
                file.set_len(from)?;
                file.set_len(stay)?;
            } else if stay > bytes.safe && draw() < 0.5 {
                file.set_len(bytes.safe)?;
                file.set_len(stay)?;
            }
        }
        for (now, before) in state.names.drain(..).rev().collect::<Vec<_>>() {
            if draw() < 0.5 {
                match before {
                    Some(before) => std::fs::rename(&now, before)?,
                    None => std::fs::remove_file(&now)?,
                }
            }
        }
        Ok(())
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

impl Storage for Fragile {
    fn create(&self, path: &Path) -> io::Result<Box<dyn Growing>> {
        let inner = Disk.create(path)?;
        let mut state = self.state();
        state.files.insert(path.to_path_buf(), Bytes::default());
        state.names.push((path.to_path_buf(), None));
        Ok(Box::new(File { path: path.to_path_buf(), inner, disk: self.clone() }))
    }

    fn create_folder(&self, path: &Path) -> io::Result<()> {
        Disk.create_folder(path)
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        Disk.rename(from, to)?;
        let mut state = self.state();
        if let Some(bytes) = state.files.remove(from) {
            state.files.insert(to.to_path_buf(), bytes);
        }
        // A name that was never synced is of no use to go back to.
        let fresh = state.names.iter().position(|(now, before)| now == from && before.is_none());
        let before = match fresh {
            Some(i) => {
                state.names.remove(i);
                None
            }
            None => Some(from.to_path_buf()),
        };
        state.names.push((to.to_path_buf(), before));
        Ok(())
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        Disk.remove(path)?;
        let mut state = self.state();
        let freed = state.files.remove(path).map_or(0, |bytes| bytes.length);
        state.room = state.room.map(|room| room + freed);
        state.names.retain(|(now, _)| now != path);
        Ok(())
    }

    fn sync_folder(&self, path: &Path) -> io::Result<()> {
        self.state().names.retain(|(now, _)| now.parent() != Some(path));
        Ok(())
    }
}

/// Linux's numbers: the messages are the system's own.
const ENOSPC: i32 = 28;
const EIO: i32 = 5;

impl Growing for File {
    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut state = self.disk.state();
        let fits = state.room.map_or(bytes.len(), |room| {
            usize::try_from(room).unwrap_or(usize::MAX).min(bytes.len())
        });
        self.inner.append(&bytes[..fits])?;
        state.room = state.room.map(|room| room - fits as u64);
        if let Some(file) = state.files.get_mut(&self.path) {
            file.length += fits as u64;
        }
        if fits < bytes.len() { Err(io::Error::from_raw_os_error(ENOSPC)) } else { Ok(()) }
    }

    fn cut(&mut self, length: u64) -> io::Result<()> {
        self.inner.cut(length)?;
        let mut state = self.disk.state();
        let mut freed = 0;
        if let Some(file) = state.files.get_mut(&self.path) {
            freed = file.length.saturating_sub(length);
            file.length = length;
            file.safe = file.safe.min(length);
            file.thrown_from = file.thrown_from.filter(|&from| from < length);
        }
        state.room = state.room.map(|room| room + freed);
        Ok(())
    }

    fn sync(&mut self) -> io::Result<()> {
        let mut state = self.disk.state();
        let fails = state.failing_syncs > 0;
        state.failing_syncs = state.failing_syncs.saturating_sub(1);
        if let Some(file) = state.files.get_mut(&self.path) {
            if fails && file.safe < file.length {
                file.thrown_from = Some(file.thrown_from.unwrap_or(file.safe));
            }
            file.safe = if fails { file.safe } else { file.length };
        }
        if fails { Err(io::Error::from_raw_os_error(EIO)) } else { Ok(()) }
    }
}
