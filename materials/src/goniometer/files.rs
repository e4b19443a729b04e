//! Files of an instrument that cannot be driven: the run waits for a new one after each placement, reads it, and keeps a copy.

use super::channels::{Band, FilesPlan, is_of};
use super::line::{Line, Taken};
use super::spectra::is_within;
use crate::ingest::spectra::{Labelled, read_labelled};
use crate::log::RecordError;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};
use sunglint_drivers::clock::{Cancel, Deadline, DeviceClock};
use sunglint_formats::FileError;
use sunglint_numerics::measured::Interval;

/// Copies of the files that were taken, in a run's folder.
pub const COPIES: &str = "spectra";
/// Time between two looks into the folder.
const LOOK: Duration = Duration::from_millis(200);
/// Time after which the run says again what it waits for.
const REMIND: Duration = Duration::from_secs(300);

/// Why no file was taken.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FolderReadError {
    /// Somebody stopped it.
    #[error("stopped")]
    Stopped,
    /// The folder cannot be read, or the copy not written.
    #[error(transparent)]
    File(#[from] FileError),
    /// Something that cannot be kept.
    #[error(transparent)]
    Record(#[from] RecordError),
}

/// State of a file at a look: its length and when it was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Stamp {
    length: u64,
    written: Option<SystemTime>,
}

/// Axis of the run's files: all have the same.
#[derive(Debug, Clone, PartialEq)]
struct Grid {
    name: String,
    values: usize,
    ends_nm: [f64; 2],
    label: String,
}

impl Grid {
    fn new(name: &str, read: &Labelled) -> Self {
        let nm = &read.spectrum.nm;
        let ends_nm = [nm[0], nm[nm.len() - 1]];
        Self { name: name.to_owned(), values: nm.len(), ends_nm, label: read.label.clone() }
    }

    fn text(&self) -> String {
        let [from, to] = self.ends_nm;
        format!("{} values from {from:.3} to {to:.3} nm, {}", self.values, self.label)
    }

    fn is_as(&self, other: &Self) -> bool {
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-6 * b;
        self.values == other.values
            && self.label == other.label
            && (0..2).all(|k| near(self.ends_nm[k], other.ends_nm[k]))
    }
}

/// A file as values of the channels.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// Mean over each channel; infinite where the spectrum stands at its detector's end.
    pub values: Vec<f64>,
    /// Standard deviation of each mean by the spectrum's own scatter.
    pub noise: Vec<f64>,
    /// The file.
    pub file: Taken,
}

/// Why a file is not taken.
enum Refusal {
    /// The file does not fit, whenever it is read.
    Unfit(String),
    /// It cannot be read now.
    Unread(String),
}

/// The folder into which the files come.
#[derive(Debug)]
pub struct Folder {
    folder: PathBuf,
    copies: PathBuf,
    plan: FilesPlan,
    bands: Vec<Band>,
    /// Files that were there at the last look at which none was wanted, or were taken since.
    known: BTreeMap<String, Stamp>,
    /// Files that were refused, in the state in which they were.
    refused: HashMap<String, Stamp>,
    /// Names of the files that were taken, by the SHA-256 of their content.
    taken: HashMap<String, String>,
    grid: Option<Grid>,
    /// When the youngest of the known files was written.
    youngest: Option<SystemTime>,
}

impl Folder {
    /// The folder of a plan, which is at `folder`; `run` is the run's folder, `before` what it has already.
    ///
    /// # Errors
    /// A folder that cannot be read; copies of the run that are missing.
    pub fn new(
        plan: &FilesPlan,
        bands: &[Band],
        folder: &Path,
        run: &Path,
        before: &[Line],
    ) -> Result<Self, FileError> {
        let mut made = Self {
            folder: folder.to_path_buf(),
            copies: run.join(COPIES),
            plan: plan.clone(),
            bands: bands.to_vec(),
            known: BTreeMap::new(),
            refused: HashMap::new(),
            taken: HashMap::new(),
            grid: None,
            youngest: None,
        };
        for Taken { name, sha256 } in before.iter().filter_map(|line| line.file.as_ref()) {
            if made.grid.is_none() {
                let copy = made.copy_of(name, sha256);
                made.grid = Some(Grid::new(name, &read_labelled(&copy)?));
            }
            made.taken.insert(sha256.clone(), name.clone());
        }
        made.known = made.look()?;
        Ok(made)
    }

    /// Where the files come.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.folder
    }

    /// The copy of a file in the run's folder.
    fn copy_of(&self, name: &str, sha256: &str) -> PathBuf {
        self.copies.join(format!("{}_{name}", sha256.get(..12).unwrap_or(sha256)))
    }

    /// Files of the pattern as they are now.
    fn look(&self) -> Result<BTreeMap<String, Stamp>, FileError> {
        let failed = |error| FileError::io("read the folder", &self.folder, error);
        let mut found = BTreeMap::new();
        for entry in std::fs::read_dir(&self.folder).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            // A name that is no text cannot be said in the record.
            let Some(name) = entry.file_name().to_str().map(str::to_owned) else { continue };
            // A file may go while it is looked at.
            let Ok(about) = std::fs::metadata(entry.path()) else { continue };
            if about.is_file() && is_of(&self.plan.pattern, &name) {
                let stamp = Stamp { length: about.len(), written: about.modified().ok() };
                found.insert(name, stamp);
            }
        }
        Ok(found)
    }

    /// All stands for the next measurement: files that are there now are older. Gives what is to be said of those that came since the last one.
    ///
    /// # Errors
    /// A folder that cannot be read.
    pub fn placed(&mut self) -> Result<Vec<String>, FolderReadError> {
        let now = self.look()?;
        let late: Vec<&str> = now
            .keys()
            .filter(|name| !self.known.contains_key(*name) && !self.refused.contains_key(*name))
            .map(String::as_str)
            .collect();
        let said = (!late.is_empty()).then(|| {
            format!(
                "not taken, since they came before all stood in its place: {} (record once the run waits for a file)",
                late.join(", ")
            )
        });
        self.youngest = now.values().filter_map(|stamp| stamp.written).max();
        self.known = now;
        self.refused.clear();
        Ok(said.into_iter().collect())
    }

    /// Says to a person which spectrum is wanted; `reading` counts from 0.
    #[must_use]
    pub fn wanted(&self, place: &str, reading: u32, readings: u32) -> String {
        let of =
            if readings > 1 { format!(" {} of {readings}", reading + 1) } else { String::new() };
        format!(
            "{place}: record spectrum{of} now; waiting for a new file {} in {}",
            self.plan.pattern,
            self.folder.display()
        )
    }

    /// Waits for a new file that is whole and fits, and keeps a copy of it. What is refused is said, and the next one is waited for.
    ///
    /// # Errors
    /// Somebody stopped it; the folder cannot be read, or the copy not written.
    pub fn next(
        &mut self,
        clock: &DeviceClock,
        cancel: &Cancel,
        say: &mut dyn FnMut(&str) -> Result<(), RecordError>,
    ) -> Result<Found, FolderReadError> {
        let now = || clock.clock.now();
        let complete = Duration::from_secs_f64(self.plan.complete_s.get());
        // Files on their way: their last state, and since when it is theirs.
        let mut coming: BTreeMap<String, (Stamp, Duration)> = BTreeMap::new();
        let mut reminded = now();
        let mut overwritten: HashMap<String, Stamp> = HashMap::new();
        let mut unread: HashSet<String> = HashSet::new();
        loop {
            let there = self.look()?;
            coming.retain(|name, _| there.contains_key(name));
            for (name, stamp) in &there {
                if let Some(before) = self.known.get(name) {
                    if before != stamp && overwritten.insert(name.clone(), *stamp).is_none() {
                        say(&format!(
                            "{name} was there before and has changed: it is not taken; have the instrument number its files"
                        ))?;
                    }
                    continue;
                }
                if self.refused.get(name) == Some(stamp) {
                    continue;
                }
                match coming.get(name) {
                    Some((same, _)) if same == stamp => {}
                    _ => {
                        coming.insert(name.clone(), (*stamp, now()));
                    }
                }
            }
            // The one that is whole for the longest time comes first.
            let mut whole: Vec<(Duration, String, Stamp)> = coming
                .iter()
                .filter(|(_, (stamp, since))| stamp.length > 0 && now() - *since >= complete)
                .map(|(name, (stamp, since))| (*since, name.clone(), *stamp))
                .collect();
            whole.sort_by(|a, b| (a.0, &a.1).cmp(&(b.0, &b.1)));
            for (_, name, stamp) in whole {
                coming.remove(&name);
                match self.take(&name, stamp)? {
                    Ok(found) => {
                        self.known.insert(name, stamp);
                        return Ok(found);
                    }
                    // Whoever writes it may still hold it: it is looked at again.
                    Err(Refusal::Unread(why)) => {
                        coming.insert(name.clone(), (stamp, now()));
                        if unread.insert(name.clone()) {
                            say(&format!(
                                "{name} cannot be read: {why}; it is tried again, and any other file is waited for"
                            ))?;
                        }
                    }
                    Err(Refusal::Unfit(why)) => {
                        self.refused.insert(name.clone(), stamp);
                        say(&format!("{name} is not taken: {why}; still waiting for a file"))?;
                    }
                }
            }
            if now() - reminded > REMIND {
                reminded = now();
                say(&format!(
                    "still waiting for a new file {} in {}",
                    self.plan.pattern,
                    self.folder.display()
                ))?;
            }
            let within = Deadline::after(clock.clock.clone(), 2 * LOOK).with_cancel(cancel);
            within.sleep(LOOK).map_err(|_| FolderReadError::Stopped)?;
        }
    }

    /// Takes a file, or says why not.
    fn take(&mut self, name: &str, stamp: Stamp) -> Result<Result<Found, Refusal>, FileError> {
        if let (Some(written), Some(youngest)) = (stamp.written, self.youngest)
            && written < youngest
        {
            return Ok(Err(Refusal::Unfit(
                "it was written before files that were there already, so it is not of this measurement"
                    .to_owned(),
            )));
        }
        let path = self.folder.join(name);
        // A file that cannot be read yet is as one that is not whole.
        let bytes = match sunglint_formats::read::bytes(&path) {
            Ok(bytes) => bytes,
            Err(error) => return Ok(Err(Refusal::Unread(told(&error)))),
        };
        let sha256 = sunglint_formats::sha256(&bytes);
        if let Some(before) = self.taken.get(&sha256) {
            return Ok(Err(Refusal::Unfit(format!(
                "it has the same content as {before}, which was taken before"
            ))));
        }
        let copy = self.copy_of(name, &sha256);
        write(&self.copies, &copy, &bytes)?;
        let found = self.values(name, &copy, &path);
        let (values, noise, grid) = match found {
            Ok(found) => found,
            Err(why) => {
                // What was not taken leaves no copy; one that stays does no harm.
                let _ = std::fs::remove_file(&copy);
                return Ok(Err(Refusal::Unfit(why)));
            }
        };
        self.grid.get_or_insert(grid);
        self.taken.insert(sha256.clone(), name.to_owned());
        Ok(Ok(Found { values, noise, file: Taken { name: name.to_owned(), sha256 } }))
    }

    /// The channels of a file, read from its copy; `path` names it.
    fn values(
        &self,
        name: &str,
        copy: &Path,
        path: &Path,
    ) -> Result<(Vec<f64>, Vec<f64>, Grid), String> {
        let shown =
            |text: String| text.replace(&copy.display().to_string(), &path.display().to_string());
        let read = read_labelled(copy).map_err(|error| shown(told(&error)))?;
        if let Some(what) = &read.not_linear {
            return Err(format!(
                "its values are {what}, which do not grow with the light: record single-beam spectra (of the sample's light alone)"
            ));
        }
        let grid = Grid::new(name, &read);
        if let Some(first) = self.grid.as_ref().filter(|first| !first.is_as(&grid)) {
            return Err(format!(
                "it has {}, and {} had {}: all files of a run have one axis and unit",
                grid.text(),
                first.name,
                first.text()
            ));
        }
        let spectrum = &read.spectrum;
        let top = spectrum.flat_ends_nm();
        let (mut values, mut noise) = (Vec::new(), Vec::new());
        for band in &self.bands {
            let Interval { low: from, high: to } = band.ends_nm();
            let first = spectrum.nm.partition_point(|nm| *nm < from);
            let inside = &spectrum.y[first..spectrum.nm.partition_point(|nm| *nm < to).max(first)];
            if inside.len() < 2 {
                return Err(format!(
                    "{} of its values lie in the channel at {} nm, {} nm wide, 2 or more are needed: it has {}",
                    inside.len(),
                    band.nm,
                    band.width_nm,
                    grid.text()
                ));
            }
            if !is_within(&spectrum.nm, band) {
                return Err(format!(
                    "the channel at {} nm, {} nm wide, goes beyond the ends of its spectrum: it has {}",
                    band.nm,
                    band.width_nm,
                    grid.text()
                ));
            }
            let n = inside.len() as f64;
            let is_over = top.is_some_and(|[low, high]| low <= to && from <= high);
            let mean = inside.iter().sum::<f64>() / n;
            values.push(if is_over { f64::INFINITY } else { mean });
            noise.push(spectrum.noise / n.sqrt());
        }
        Ok((values, noise, grid))
    }
}

/// An error with what lies behind it, in one line.
fn told(error: &FileError) -> String {
    let mut text = error.to_string();
    let mut next = std::error::Error::source(error);
    while let Some(source) = next {
        let more = source.to_string();
        if !text.contains(&more) {
            text = format!("{text}: {more}");
        }
        next = source.source();
    }
    text
}

/// Writes a copy so that it is whole or not there.
fn write(folder: &Path, path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    std::fs::create_dir_all(folder).map_err(|error| FileError::io("create", folder, error))?;
    let part = folder.join("part.tmp");
    let put = || -> std::io::Result<()> {
        let mut file = File::create(&part)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        std::fs::rename(&part, path)
    };
    put().map_err(|error| FileError::io("write", path, error))
}
