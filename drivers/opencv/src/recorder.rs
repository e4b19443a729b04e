//! Frames into a lossless recording.
//!
//! This module makes up for what OpenCV's writer does not say: the writer reports no failed write, cuts odd rows and columns off, and does not keep
//! times. So odd sides get a row or column of zeros, the times go into a table beside the recording, a row as each frame is written,
//! and at the end the whole recording is read back and held against the check sums of what was given.

use crate::grabber::{Grabber, GrabberSettings, Source};
use crate::sequence::Pattern;
use crate::sidecar::{self, Row, Sidecar};
use ndarray::{Array2, s};
use opencv::core::{Mat, Size, Vector};
use opencv::imgcodecs;
use opencv::prelude::*;
use opencv::videoio::{self, VideoWriter};
use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::device::DeviceError;
use sunglint_formats::fits::Header;
use sunglint_formats::{EncodeError, Frame, ecsv};

/// Why frames were not recorded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordError {
    /// The path is not one of a recording.
    #[error("{}: {reason}", path.display())]
    Path {
        /// The path.
        path: PathBuf,
        /// Fault of the path.
        reason: String,
    },
    /// Something is there already. A recording is never written over another.
    #[error("{} is there already: choose another name, or move it away", path.display())]
    Exists {
        /// Path of the file that is there.
        path: PathBuf,
    },
    /// A frame that does not belong with the first.
    #[error("frame {index}: {what}: found {found}, expected {expected} as in the first")]
    Changed {
        /// Which frame, from 0.
        index: u64,
        /// Property that differs.
        what: &'static str,
        /// Value of the property in this frame.
        found: String,
        /// Value of the property in the first frame.
        expected: String,
    },
    /// A pixel that the recording cannot hold.
    #[error(
        "frame {index}: row {row}, column {column} has {value} ADU, more than 8 bits: record it as a sequence of images"
    )]
    TooBright {
        /// Which frame, from 0.
        index: u64,
        /// The pixel's row.
        row: usize,
        /// The pixel's column.
        column: usize,
        /// Value of the pixel.
        value: u16,
    },
    /// OpenCV or the system did not write.
    #[error("cannot write {}: {reason}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// There was nothing to record.
    #[error("{}: no frame was given, and no file was made", path.display())]
    Empty {
        /// The path.
        path: PathBuf,
    },
    /// Data read back are not the data that were given.
    #[error(
        "the recording does not hold what was given ({good} of {given} frames are good): {source}"
    )]
    NotKept {
        /// How many frames came back.
        good: u64,
        /// How many were given.
        given: u64,
        /// Error found in reading back.
        source: Box<DeviceError>,
    },
    /// A frame's metadata that no table holds.
    #[error("frame {index}: {source}")]
    Encode {
        /// Which frame, from 0.
        index: u64,
        /// Error in the metadata.
        source: EncodeError,
    },
}

/// A recording that was read back and is good.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recorded {
    /// The recording.
    pub path: PathBuf,
    /// The table beside it.
    pub table: PathBuf,
    /// Frames in it.
    pub frames: u64,
}

/// Kind of recording that the frames go into.
enum Kind {
    /// FFV1, 8 bits.
    Film,
    /// Images of 16 bits.
    Images(Pattern),
}

/// Writes frames into a recording: FFV1 (`.avi`, `.mkv`) for 8 bits, numbered images (`night_%05d.png`, or `.tiff`) for 16.
///
/// All frames have one size, origin, binning and pattern: those of the first. Nothing is written before it.
pub struct Recorder {
    path: PathBuf,
    kind: Kind,
    rate_hz: f64,
    begun: Option<Begun>,
}

/// State of the recording once the first frame has come.
struct Begun {
    like: Sidecar,
    first: Header,
    /// The table's text before its first row.
    head: String,
    table: File,
    film: Option<VideoWriter>,
    count: u64,
}

impl std::fmt::Debug for Recorder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Recorder")
            .field("path", &self.path)
            .field("frames", &self.frames())
            .finish()
    }
}

impl Recorder {
    /// A recording at this path. `rate_hz` is the rate at which film players show it, Hz; the true times are in the table.
    ///
    /// # Errors
    /// A path that is none of a recording, or where something is already.
    pub fn create(path: impl Into<PathBuf>, rate_hz: f64) -> Result<Self, RecordError> {
        let path = path.into();
        let bad = |reason: String| RecordError::Path { path: path.clone(), reason };
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
        let kind = match extension.to_lowercase().as_str() {
            "avi" | "mkv" => Kind::Film,
            "png" | "tif" | "tiff" => Kind::Images(Pattern::new(&path).map_err(bad)?),
            other => {
                return Err(bad(format!(
                    "found `.{other}`, expected .avi or .mkv (8 bits), or _%05d.png or .tiff (16 bits)"
                )));
            }
        };
        if !(rate_hz.is_finite() && (0.001..=1000.0).contains(&rate_hz)) {
            return Err(bad(format!(
                "the players' rate: found {rate_hz} Hz, expected 0.001 to 1000"
            )));
        }
        if let Kind::Images(pattern) = &kind {
            let numbers = pattern.numbers().map_err(|error| bad(error.to_string()))?;
            if let Some(&number) = numbers.first() {
                return Err(RecordError::Exists { path: pattern.path(number) });
            }
        }
        for there in [path.clone(), sidecar::path_of(&path)] {
            if there.symlink_metadata().is_ok() {
                return Err(RecordError::Exists { path: there });
            }
        }
        Ok(Self { path, kind, rate_hz, begun: None })
    }

    /// How many frames were written.
    pub fn frames(&self) -> u64 {
        self.begun.as_ref().map_or(0, |begun| begun.count)
    }

    /// Writes a frame, and its row of the table.
    ///
    /// # Errors
    /// A frame unlike the first, or too bright for 8 bits: it is left out, and the recording goes on. A disk that does not
    /// write: end it with [`finish`](Self::finish), which says what was kept. OpenCV does not report all of these here.
    pub fn write(&mut self, frame: &Frame) -> Result<(), RecordError> {
        let index = self.frames();
        self.check(index, frame)?;
        let mut begun = match self.begun.take() {
            Some(begun) => begun,
            None => self.begin(frame)?,
        };
        let written = self.append(&mut begun, frame);
        self.begun = Some(begun);
        written
    }

    fn append(&self, begun: &mut Begun, frame: &Frame) -> Result<(), RecordError> {
        let index = begun.count;
        let alone = Sidecar { rows: vec![Row::of(frame)], ..begun.like.clone() };
        let text = ecsv::to_string(&alone.table_after(&begun.first))
            .map_err(|source| RecordError::Encode { index, source })?;
        match &self.kind {
            Kind::Film => begun.film(&self.path, &frame.pixels)?,
            Kind::Images(pattern) => image(&pattern.path(index), &frame.pixels)?,
        }
        let row = text.strip_prefix(&begun.head).unwrap_or_default();
        begun.table.write_all(row.as_bytes()).map_err(|error| failed(&self.path, error))?;
        begun.count += 1;
        Ok(())
    }

    fn check(&self, index: u64, frame: &Frame) -> Result<(), RecordError> {
        if let Kind::Film = self.kind
            && let Some(((row, column), &value)) =
                frame.pixels.indexed_iter().find(|(_, value)| **value > 255)
        {
            return Err(RecordError::TooBright { index, row, column, value });
        }
        let like = Sidecar::like(frame);
        let Some(first) = self.begun.as_ref().map(|begun| &begun.like) else {
            if like.size_px.contains(&0) {
                let reason = "the first frame has no pixels".into();
                return Err(RecordError::Path { path: self.path.clone(), reason });
            }
            return Ok(());
        };
        for (what, found, expected) in [
            ("columns and rows", format!("{:?}", like.size_px), format!("{:?}", first.size_px)),
            ("origin", format!("{:?}", like.origin), format!("{:?}", first.origin)),
            ("binning", format!("{:?}", like.binning), format!("{:?}", first.binning)),
            ("pattern", format!("{:?}", like.bayer), format!("{:?}", first.bayer)),
        ] {
            if found != expected {
                return Err(RecordError::Changed { index, what, found, expected });
            }
        }
        Ok(())
    }

    fn begin(&self, frame: &Frame) -> Result<Begun, RecordError> {
        let like = Sidecar::like(frame);
        let head = ecsv::to_string(&like.table_after(&frame.header))
            .map_err(|source| RecordError::Encode { index: 0, source })?;
        let film = match self.kind {
            Kind::Film => Some(self.open_film(like.size_px)?),
            Kind::Images(_) => None,
        };
        let path = sidecar::path_of(&self.path);
        let mut table = File::options()
            .write(true)
            .create_new(true)
            .open(&path)
            .map_err(|error| failed(&path, error))?;
        table.write_all(head.as_bytes()).map_err(|error| failed(&path, error))?;
        Ok(Begun { like, first: frame.header.clone(), head, table, film, count: 0 })
    }

    fn open_film(&self, size_px: [u32; 2]) -> Result<VideoWriter, RecordError> {
        let [columns, rows] = size_px.map(|side| even(side as usize) as i32);
        let open = || -> opencv::Result<Option<VideoWriter>> {
            let codec = VideoWriter::fourcc('F', 'F', 'V', '1')?;
            let size = Size::new(columns, rows);
            let api = videoio::CAP_FFMPEG;
            let film =
                VideoWriter::new_with_backend(&self.path, api, codec, self.rate_hz, size, false)?;
            Ok(film.is_opened()?.then_some(film))
        };
        match open() {
            Ok(Some(film)) => Ok(film),
            Ok(None) => Err(failed(
                &self.path,
                "OpenCV's FFmpeg does not open it: is the folder there, and FFV1 in this build?",
            )),
            Err(error) => Err(failed(&self.path, error.message)),
        }
    }

    /// Ends the recording, reads all of it back and holds it against what was given.
    ///
    /// # Errors
    /// [`RecordError::Empty`] without a frame; [`RecordError::NotKept`] with what is wrong; `deadline` for the reading.
    pub fn finish(mut self, deadline: &Deadline) -> Result<Recorded, RecordError> {
        let Some(mut begun) = self.begun.take() else {
            return Err(RecordError::Empty { path: self.path.clone() });
        };
        let path = self.path.clone();
        if let Some(mut film) = begun.film.take() {
            film.release().map_err(|error| failed(&path, error.message))?;
        }
        let table = sidecar::path_of(&path);
        begun.table.sync_all().map_err(|error| failed(&table, error))?;
        let given = begun.count;
        let mut good = 0;
        let mut all = || -> Result<(), DeviceError> {
            let mut grabber = self.read_back(deadline)?;
            while grabber.next_frame(deadline)?.is_some() {
                good += 1;
            }
            Ok(())
        };
        match all() {
            Ok(()) => Ok(Recorded { path, table, frames: given }),
            Err(error) => Err(RecordError::NotKept { good, given, source: Box::new(error) }),
        }
    }

    fn read_back(&self, deadline: &Deadline) -> Result<Grabber, DeviceError> {
        let source = match self.kind {
            Kind::Film => Source::Recording(self.path.clone()),
            Kind::Images(_) => Source::Sequence(self.path.clone()),
        };
        Grabber::open(source, GrabberSettings::default(), deadline)
    }
}

impl Begun {
    fn film(&mut self, path: &Path, pixels: &Array2<u16>) -> Result<(), RecordError> {
        let Some(film) = &mut self.film else { return Ok(()) };
        let (rows, columns) = pixels.dim();
        let mut bytes = Array2::<u8>::zeros((even(rows), even(columns)));
        // Values above 255 have been refused.
        bytes
            .slice_mut(s![..rows, ..columns])
            .zip_mut_with(pixels, |byte, &value| *byte = value as u8);
        let (rows, columns) = bytes.dim();
        let mut write = || -> opencv::Result<()> {
            let bytes = bytes.as_slice().unwrap_or_default();
            film.write(&Mat::new_rows_cols_with_data(rows as i32, columns as i32, bytes)?)
        };
        write().map_err(|error| failed(path, error.message))
    }
}

fn image(path: &Path, pixels: &Array2<u16>) -> Result<(), RecordError> {
    let (rows, columns) = pixels.dim();
    let standard = pixels.as_standard_layout();
    let write = || -> opencv::Result<bool> {
        let values = standard.as_slice().unwrap_or_default();
        let mat = Mat::new_rows_cols_with_data(rows as i32, columns as i32, values)?;
        imgcodecs::imwrite(path, &mat, &Vector::new())
    };
    match write() {
        Ok(true) => Ok(()),
        Ok(false) => Err(failed(path, "OpenCV does not say why: is the disk full?")),
        Err(error) => Err(failed(path, error.message)),
    }
}

/// The side of a film that holds so many pixels: OpenCV's writer cuts odd ones.
fn even(side: usize) -> usize {
    side.next_multiple_of(2)
}

fn failed(path: &Path, reason: impl ToString) -> RecordError {
    RecordError::Write { path: path.to_owned(), reason: reason.to_string() }
}
