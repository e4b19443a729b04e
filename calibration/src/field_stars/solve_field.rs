//! Place of a frame by astrometry.net's `solve-field` and the index files that it has: another program with another list of stars (Tycho-2 in Debian's
//! `astrometry-data-tycho2`), for fields that are too narrow for patterns of ours.
//!
//! It is given the sources that were found here, so that clouds and trails are out, and says which star is which. The coordinates are fitted anew to all stars of the index that are seen, as
//! [`super::blind`] does; a frame whose stars do not fit is refused.

use super::blind::{LEAST_FOUND, MOST_SCATTER_PX, Solved};
use super::matching::{Star, pair};
use super::{Source, sources};
use crate::photometry::field::Field;
use glam::DVec2;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use sunglint_formats::atomic::Overwrite;
use sunglint_formats::fits::{Fits, Writer};
use sunglint_formats::wcs::{Equatorial, Wcs};
use sunglint_formats::{Column, FileError, Table};
use sunglint_numerics::progress::{Cancelled, Progress};

/// Sources that are handed over at most, the brightest.
const SOURCES: usize = 200;
/// Widths that are tried where none is known, deg: the index files of Tycho-2.
const WIDTHS_DEG: [f64; 2] = [0.5, 60.0];
/// Times its processor time that it may take by the clock, and so many seconds more: another program may keep the machine busy.
const PATIENCE: (u32, u64) = (10, 60);
/// Time between two looks at whether it has ended.
const LOOK: Duration = Duration::from_millis(10);

/// Why there can be no answer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SolveFieldError {
    /// The program is not there, or does not start.
    #[error(
        "{} cannot be started: {source}; install astrometry.net and its index files (Debian: astrometry.net, astrometry-data-tycho2), or name the program",
        program.display()
    )]
    Start {
        /// The program.
        program: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It ended otherwise than with an answer or without one.
    #[error("{}: {end}", program.display())]
    Failed {
        /// The program.
        program: PathBuf,
        /// How it ended, and the last that it said.
        end: String,
    },
    /// Files between the programs.
    #[error("files for {}: {source}", program.display())]
    Folder {
        /// The program.
        program: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file between the programs.
    #[error(transparent)]
    File(#[from] FileError),
    /// It was ended by whoever watches.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// The program `solve-field`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SolveField {
    program: PathBuf,
    /// Processor time for a frame, s.
    within_s: u32,
}

impl SolveField {
    /// A program by its path, or by a name that is looked for where programs are (`solve-field`).
    pub fn new(program: impl Into<PathBuf>) -> Self {
        Self { program: program.into(), within_s: 60 }
    }

    /// The same with so much processor time for a frame, s (60).
    #[must_use]
    pub fn within_s(mut self, within_s: u32) -> Self {
        self.within_s = within_s.max(1);
        self
    }

    /// Place of a frame by its sources: points, or trails where stars are trailed. `width_deg` is the frame's width, with the part by which it may be wrong,
    /// where it is known. `None` where the program finds none, or none that all stars fit. Where `progress` is cancelled, the program is ended.
    ///
    /// # Errors
    /// [`SolveFieldError`].
    pub fn solve(
        &self,
        field: &Field,
        is_trailed: bool,
        width_deg: Option<(f64, f64)>,
        progress: &dyn Progress,
    ) -> Result<Option<Solved>, SolveFieldError> {
        let found: Vec<Source> = sources(field, is_trailed);
        let places: Vec<DVec2> = found.iter().take(SOURCES).map(|s| s.place.into()).collect();
        if places.len() < LEAST_FOUND {
            return Ok(None);
        }
        let folder = tempfile::Builder::new().prefix("sunglint-solve-").tempdir();
        let folder = folder
            .map_err(|source| SolveFieldError::Folder { program: self.program.clone(), source })?;
        let list = folder.path().join("frame.xyls");
        write_list(&list, &places)?;
        self.run(folder.path(), &list, field.size_px, width_deg, progress)?;
        if !folder.path().join("frame.solved").exists() {
            return Ok(None);
        }
        read(folder.path(), &places, field.size_px)
    }

    /// Runs the program; whether it found something is told by its files.
    fn run(
        &self,
        folder: &Path,
        list: &Path,
        size_px: [usize; 2],
        width_deg: Option<(f64, f64)>,
        progress: &dyn Progress,
    ) -> Result<(), SolveFieldError> {
        let failed = |end: String| SolveFieldError::Failed { program: self.program.clone(), end };
        let [low, high] = match width_deg {
            Some((width, part)) => [width * (1.0 - part), width * (1.0 + part)],
            None => WIDTHS_DEG,
        };
        let said = folder.join("said.txt");
        let fail = |source| SolveFieldError::Folder { program: self.program.clone(), source };
        let log = std::fs::File::create(&said).map_err(fail)?;
        let errors = log.try_clone().map_err(fail)?;
        let mut command = Command::new(&self.program);
        command.args(["--no-plots", "--overwrite", "--no-tweak", "--crpix-center"]);
        // Its scripts in Python need modules that may not be there.
        command.args(["--no-remove-lines", "--uniformize", "0", "--new-fits", "none"]);
        command.args(["--x-column", "X", "--y-column", "Y", "--sort-column", "FLUX"]);
        command.args(["--scale-units", "degwidth", "--scale-low", &low.to_string()]);
        command.args(["--scale-high", &high.to_string()]);
        command.args(["--width", &size_px[0].to_string(), "--height", &size_px[1].to_string()]);
        command.args(["--cpulimit", &self.within_s.to_string()]);
        for (option, name) in
            [("--dir", ""), ("--temp-dir", ""), ("--corr", "frame.corr"), ("--wcs", "frame.wcs")]
        {
            command.arg(option).arg(folder.join(name));
        }
        command.arg(list).stdin(Stdio::null()).stdout(log).stderr(errors).current_dir(folder);
        // A group of its own, which is ended as one: it starts programs that would go on.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command
            .spawn()
            .map_err(|source| SolveFieldError::Start { program: self.program.clone(), source })?;
        let (times, more_s) = PATIENCE;
        let until = Instant::now() + Duration::from_secs(u64::from(times * self.within_s) + more_s);
        let status = loop {
            match child.try_wait() {
                Ok(Some(status)) => break status,
                Ok(None) if progress.is_cancelled() => {
                    end(&mut child);
                    return Err(Cancelled.into());
                }
                Ok(None) if Instant::now() < until => std::thread::sleep(LOOK),
                outcome => {
                    end(&mut child);
                    return Err(failed(match outcome {
                        Err(error) => error.to_string(),
                        Ok(_) => format!("no end in {} s of processor time", self.within_s),
                    }));
                }
            }
        };
        if status.success() {
            return Ok(());
        }
        let words = std::fs::read(&said).unwrap_or_default();
        let words = String::from_utf8_lossy(&words);
        let last = words.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("").trim();
        Err(failed(format!("{status}: {}", last.chars().take(300).collect::<String>())))
    }
}

/// Ends a program at once, with those that it has started.
fn end(child: &mut Child) {
    if cfg!(unix) {
        let group = format!("-{}", child.id());
        let _ = Command::new("kill")
            .args(["-KILL", "--", &group])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status();
    }
    let _ = child.kill();
    let _ = child.wait();
}

/// Sources, the brightest first, as a list for the program. FITS counts pixels from 1.
fn write_list(path: &Path, places: &[DVec2]) -> Result<(), FileError> {
    let of = |of: fn(&DVec2) -> f64| places.iter().map(|place| of(place) + 1.0).collect();
    let order = (0..places.len()).map(|i| (places.len() - i) as f64).collect();
    let table = Table {
        columns: vec![
            Column::f64("X", Some("pix"), of(|place| place.x)),
            Column::f64("Y", Some("pix"), of(|place| place.y)),
            Column::f64("FLUX", None, order),
        ],
        ..Table::default()
    };
    let mut writer = Writer::new();
    writer.table(&table, "SOURCES").map_err(|error| FileError::encode(path, error))?;
    writer.write_file(path, Overwrite::Allow)
}

/// The program's answer, fitted anew to the stars of its index.
fn read(
    folder: &Path,
    places: &[DVec2],
    size_px: [usize; 2],
) -> Result<Option<Solved>, SolveFieldError> {
    let answer = Fits::read(folder.join("frame.wcs"))?;
    let header = answer.hdus().first().map(sunglint_formats::fits::Hdu::header);
    let Some(Ok(Some(first))) = header.map(Wcs::from_header) else { return Ok(None) };
    let numbers = |path: &str, columns: [&str; 2]| -> Result<Option<[Vec<f64>; 2]>, FileError> {
        let path = folder.join(path);
        let fits = Fits::read(&path)?;
        let Some(index) = fits.first(sunglint_formats::fits::Kind::Table) else {
            return Ok(None);
        };
        let table = fits.table(index)?;
        let [a, b] = columns.map(|name| table.f64(name).map(|values| values.to_vec()).ok());
        Ok(a.zip(b).map(|(a, b)| [a, b]))
    };
    let Some([ra, dec]) = numbers("frame.corr", ["index_ra", "index_dec"])? else {
        return Ok(None);
    };
    let stars = ra.into_iter().zip(dec).enumerate().map(|(number, (ra_deg, dec_deg))| Star {
        number,
        sky_deg: Equatorial { ra_deg, dec_deg },
        magnitude: number as f64,
    });
    let stars: Vec<Star> = stars.filter(|star| star.sky_deg.is_finite()).collect();
    let Some(pairs) = pair(&first, &stars, places, size_px) else { return Ok(None) };
    if pairs.of.len() < LEAST_FOUND || pairs.scatter_px > MOST_SCATTER_PX {
        return Ok(None);
    }
    // Natural logarithm of the odds against chance.
    let odds = numbers("frame.match", ["LOGODDS", "LOGODDS"]).ok().flatten();
    let odds = odds.and_then(|[odds, _]| odds.first().copied()).unwrap_or(f64::NAN);
    Ok(Solved::of(pairs, size_px, (-odds).exp()))
}
