//! Reduction of a recorded session: frames and counts, visit by visit, as linear light curves.
//!
//! [`reduce`] reads a session's cameras and counters, [`Reduced::take`] gives its visits one after the other, so that a night of any length fits into
//! memory. [`folder::reduce_frames`] takes frames of any program in a folder. [`light_curves`] is the short way for a whole session with the usual options.

pub mod counts;
mod error;
pub mod folder;
pub mod frames;
pub mod held;
pub mod join;
pub mod library;
pub mod night;
pub mod recipe;
mod seeing;
pub(crate) mod sensor;
pub mod sight;
pub mod sky;
pub mod tags;
pub mod times;
mod widths;
pub mod wings;

pub use error::ReduceError;
pub use library::Library;
pub use night::{ReduceOptions, Reduced, Visited, reduce, reduce_with, stays};
pub use recipe::Recipe;
pub use sensor::Used;

use hifitime::Epoch;
use std::path::Path;
use sunglint_formats::session::{Session, Target};
use sunglint_numerics::progress::{Cancelled, Progress};
use sunglint_radiometry::light_curve::LightCurve;
use sunglint_radiometry::station::Station;

/// Visit of the telescope to a target, as the session's log has it, with an end.
#[derive(Debug, Clone, PartialEq)]
pub struct Stay {
    /// Target of the stay.
    pub target: Target,
    /// Which stay at a target of this name it is, from 1.
    pub number: u32,
    /// When it began.
    pub from: Epoch,
    /// When it ended: the log's word, else the end of what was recorded.
    pub to: Epoch,
}

impl Stay {
    /// Name of the visit's files: letters, digits, `_` and `-` of its target, and its number.
    pub fn file_name(&self) -> String {
        let name: String = self
            .target
            .name
            .chars()
            .map(|c| if c.is_alphanumeric() || c == '-' { c } else { '_' })
            .collect();
        format!("{name}_{}", self.number)
    }
}

/// Light curve with the name of its files.
pub type NamedCurve = (String, LightCurve);

/// Reduces a recorded session with the usual options: the linear curve of each visit, with the name of its files, and warnings.
///
/// # Errors
/// The errors of [`reduce`]; a session whose station is not known.
pub fn light_curves(
    folder: &Path,
    progress: &dyn Progress,
) -> Result<(Vec<NamedCurve>, Vec<String>), ReduceError> {
    let session = Session::open(folder)?;
    let station = Station::of_session(&session)?;
    let options = ReduceOptions::for_station(&station);
    let mut night = reduce(&session, &station, &options, progress)?;
    let mut curves = Vec::new();
    while let Some(visited) = night.take(&session, &station)? {
        curves.push((visited.stay.file_name(), visited.linear));
    }
    Ok((curves, night.warnings))
}

/// Passes on that the work is so many steps further.
fn step(progress: &dyn Progress, count: u64) -> Result<(), Cancelled> {
    progress.advance(count);
    if progress.is_cancelled() { Err(Cancelled) } else { Ok(()) }
}
