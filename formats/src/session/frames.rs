//! Names of frames, and the frames of a camera one by one.

use crate::error::FileError;
use crate::frame::Frame;
use crate::time::{format_utc, parse_utc};
use hifitime::Epoch;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// The keyword of a frame's sequence number: counts each camera's frames from 1, whether they could be written or not.
pub const FRAME_NUMBER: &str = "FRAMENO";

/// The keyword of a frame that may be another program's: one used the camera, too.
pub const SHARED: &str = "SHARED";
/// The keyword of the median that a flat should have, ADU.
pub const FLAT_LEVEL: &str = "FLATLEV";
/// The keyword of a frame whose filter is not known: nobody saw where the wheel stood.
pub const FILTER_DOUBTED: &str = "FILTDOUB";
/// Parts of its level between which a flat's median lies.
const NEAR_LEVEL: [f64; 2] = [0.6, 1.5];

/// Whether a flat with this median, ADU, is near enough to its level to count.
pub fn is_near_level(median_adu: f64, level_adu: f64) -> bool {
    (NEAR_LEVEL[0]..=NEAR_LEVEL[1]).contains(&(median_adu / level_adu))
}

/// Suffix of an unfinished frame's name.
pub(super) const PART: &str = ".part";

/// Folder and name of a frame within its camera's folder: `17/20201118T170503.123456Z_00000042.fits`.
pub(super) fn place(start: Epoch, sequence: u64) -> (String, String) {
    let utc: String = format_utc(start, 6).chars().filter(|c| !matches!(c, '-' | ':')).collect();
    let hour = utc.split_once('T').map_or("00", |(_, time)| &time[..2]).to_owned();
    (hour, format!("{utc}_{sequence:08}.fits"))
}

/// The sequence number in a frame's name.
fn sequence_of(name: &OsStr) -> Option<u64> {
    let (_, number) = name.to_str()?.strip_suffix(".fits")?.rsplit_once('_')?;
    number.parse().ok()
}

/// A frame on the disk.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FrameFile {
    /// Sequence number of the frame: counts from 1, and a missing number means a lost frame.
    pub sequence: u64,
    /// The file.
    pub path: PathBuf,
}

impl FrameFile {
    /// Start of the exposure by the file's name; `None` for a name that holds no time.
    pub fn start(&self) -> Option<Epoch> {
        let (utc, _) = self.path.file_name()?.to_str()?.rsplit_once('_')?;
        let (date, time) = (utc.get(..8)?, utc.get(9..)?);
        let [year, month, day] = [date.get(..4)?, date.get(4..6)?, date.get(6..)?];
        let [hour, minute, second] = [time.get(..2)?, time.get(2..4)?, time.get(4..)?];
        parse_utc(&format!("{year}-{month}-{day}T{hour}:{minute}:{second}")).ok()
    }

    /// Reads the frame; its header has the target (`OBJECT`), the filter (`FILTER`) and the number ([`FRAME_NUMBER`]).
    ///
    /// # Errors
    /// The errors of [`Frame::read`].
    pub fn read(&self) -> Result<Frame, FileError> {
        Frame::read(&self.path)
    }
}

/// Files in a camera's folder.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Frames {
    /// The frames, by their sequence numbers.
    pub files: Vec<FrameFile>,
    /// Frames that were being written when the program ended.
    pub unfinished: Vec<PathBuf>,
    /// Other files in the folder, which are no frames.
    pub foreign: Vec<PathBuf>,
}

impl Frames {
    /// Lists a camera's folder; only names are read.
    pub(super) fn list(folder: &Path) -> Result<Self, FileError> {
        let mut frames = Self::default();
        for hour in entries(folder)? {
            if !hour.is_dir() {
                frames.foreign.push(hour);
                continue;
            }
            for path in entries(&hour)? {
                let name = path.file_name().unwrap_or_default();
                if let Some(sequence) = sequence_of(name) {
                    frames.files.push(FrameFile { sequence, path });
                } else if name.to_str().is_some_and(|name| name.ends_with(PART)) {
                    frames.unfinished.push(path);
                } else {
                    frames.foreign.push(path);
                }
            }
        }
        frames.files.sort_by(|a, b| (a.sequence, &a.path).cmp(&(b.sequence, &b.path)));
        Ok(frames)
    }
}

/// Returns the entries of a folder, by name; nothing where the folder is not there.
fn entries(folder: &Path) -> Result<Vec<PathBuf>, FileError> {
    let io = |error| FileError::io("read", folder, error);
    let list = match std::fs::read_dir(folder) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(vec![]),
        list => list.map_err(io)?,
    };
    let paths: Result<Vec<PathBuf>, _> = list.map(|entry| entry.map(|e| e.path())).collect();
    let mut paths = paths.map_err(io)?;
    paths.sort();
    Ok(paths)
}
