//! Frames that stay in memory, for who reduces the same visits again and again.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;
use sunglint_formats::session::FrameFile;
use sunglint_formats::{FileError, Frame};

/// Frames as they were read. A frame whose file has changed since is read again.
#[derive(Debug)]
pub struct HeldFrames {
    /// Memory that frames take at most, bytes.
    most_bytes: usize,
    held: Mutex<Held>,
}

#[derive(Debug, Default)]
struct Held {
    frames: HashMap<PathBuf, (Stamp, Arc<Frame>)>,
    bytes: usize,
}

/// Signs of a file by which a change is seen: length, time of the last write, and on Unix its number and when anything of it changed: who keeps the time of a file that is mended keeps neither.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Stamp(u64, SystemTime, [i64; 3]);

impl Stamp {
    fn of(file: &std::fs::Metadata) -> std::io::Result<Self> {
        #[cfg(unix)]
        let signs = {
            use std::os::unix::fs::MetadataExt as _;
            [file.ino().cast_signed(), file.ctime(), file.ctime_nsec()]
        };
        #[cfg(not(unix))]
        let signs = [0; 3];
        Ok(Self(file.len(), file.modified()?, signs))
    }
}

/// Bytes that a frame takes beside its pixels and for each of its header's cards, about.
const FRAME_BYTES: usize = 512;
const CARD_BYTES: usize = 256;

/// Memory that a frame takes, about.
fn bytes(frame: &Frame) -> usize {
    frame.pixels.len() * size_of::<u16>() + frame.header.cards.len() * CARD_BYTES + FRAME_BYTES
}

impl HeldFrames {
    /// Holds no frame yet, and at most so many bytes.
    pub fn new(most_bytes: usize) -> Self {
        Self { most_bytes, held: Mutex::default() }
    }

    /// Number of frames that are held.
    pub fn len(&self) -> usize {
        self.held.lock().unwrap_or_else(PoisonError::into_inner).frames.len()
    }

    /// Whether no frame is held.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The frame of a file: the one that is held, where the file is as it was, else read.
    ///
    /// # Errors
    /// The errors of [`Frame::read`].
    pub fn read(&self, file: &FrameFile) -> Result<Frame, FileError> {
        let held = || self.held.lock().unwrap_or_else(PoisonError::into_inner);
        // A file that cannot be looked at tells why when it is read.
        let stamp = std::fs::metadata(&file.path).and_then(|of| Stamp::of(&of));
        let Ok(stamp) = stamp else { return file.read() };
        let known = held().frames.get(&file.path).filter(|(of, _)| *of == stamp).cloned();
        if let Some((_, frame)) = known {
            return Ok(Frame::clone(&frame));
        }
        let frame = file.read()?;
        let mut held = held();
        if let Some((_, old)) = held.frames.remove(&file.path) {
            held.bytes -= bytes(&old);
        }
        if held.bytes + bytes(&frame) <= self.most_bytes {
            held.bytes += bytes(&frame);
            held.frames.insert(file.path.clone(), (stamp, Arc::new(frame.clone())));
        }
        Ok(frame)
    }
}

/// Reads frames: from the memory where there is one, else from the disk.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Reads<'a>(pub Option<&'a HeldFrames>);

impl Reads<'_> {
    /// # Errors
    /// The errors of [`Frame::read`].
    pub fn read(self, file: &FrameFile) -> Result<Frame, FileError> {
        match self.0 {
            Some(held) => held.read(file),
            None => file.read(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;
    use sunglint_formats::atomic::Overwrite;

    fn write(folder: &std::path::Path, number: u16, value: u16) -> FrameFile {
        let frame = Frame {
            pixels: Array2::from_elem((10, 10), value),
            origin: [0, 0],
            binning: [1, 1],
            bayer: None,
            start: hifitime::Epoch::from_unix_seconds(1.6e9),
            exposure_s: 1.0,
            gain_e_per_adu: None,
            temperature_c: None,
            saturation_adu: None,
            header: sunglint_formats::fits::Header::default(),
        };
        let path = folder.join(format!("{number}.fits"));
        frame.write_file(&path, Overwrite::Allow).unwrap();
        FrameFile { sequence: number.into(), path }
    }

    /// Truth: by hand: the values that were written; a file that was written anew is read anew, one that is gone is an error; two fit into two and a half times the memory of one.
    #[test]
    fn frames_are_held_as_long_as_their_files_stay() {
        let folder = std::env::temp_dir().join(format!("sunglint-held-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let files = [1, 2, 3].map(|number| write(&folder, number, 100 * number));
        let one = bytes(&files[0].read().unwrap());
        let held = HeldFrames::new(2 * one + one / 2);
        for _ in 0..2 {
            for (i, file) in files.iter().enumerate() {
                let frame = held.read(file).unwrap();
                assert_eq!(frame.pixels[[3, 3]], 100 * (i as u16 + 1));
                assert_eq!(frame, file.read().unwrap());
            }
            assert_eq!(held.len(), 2);
        }
        let later = SystemTime::now() + std::time::Duration::from_secs(5);
        write(&folder, 1, 77);
        std::fs::File::options()
            .write(true)
            .open(&files[0].path)
            .unwrap()
            .set_modified(later)
            .unwrap();
        assert_eq!(held.read(&files[0]).unwrap().pixels[[0, 0]], 77);
        assert_eq!(held.len(), 2);
        std::fs::remove_file(&files[1].path).unwrap();
        assert!(held.read(&files[1]).is_err());
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
