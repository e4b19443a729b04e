//! Question of a search, its options, its progress, and the checkpoint from which a search that was cut off goes on.

use super::state::{Turn, Unknowns};
use super::{Scale, coarse};
use glam::DVec3;
use hifitime::Epoch;

/// Question of an attitude search.
#[derive(Debug, Clone)]
pub struct Question {
    /// The axis of the spin in the body.
    pub axis_body: DVec3,
    /// When the phase counts.
    pub epoch: Epoch,
    /// Unknown numbers of the spin.
    pub unknowns: Unknowns,
    /// Known spin: only those of its numbers count that are not unknown.
    pub known: Turn,
    /// Turns a second between which the spin is looked for, pairs of a lower and an upper bound; negative ones are left-handed.
    pub rates: Vec<(f64, f64)>,
    /// Free factors of the brightness.
    pub scale: Scale,
}

/// How it is searched.
#[derive(Debug, Clone)]
pub struct Options {
    /// The seed of which epochs are taken first, and of how the grid of axes lies.
    pub seed: u64,
    /// Axes of the first look.
    pub axes: usize,
    /// Whether light by other ways than the direct one is added at the end, as far as the scene does not switch it off.
    pub all_light: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { seed: 0, axes: 640, all_light: true }
    }
}

/// How far the search is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Stage that the search is at.
    pub stage: &'static str,
    /// How much of it.
    pub done: usize,
    /// Number of steps in the whole stage.
    pub of: usize,
}

/// Checkpoint from which a search that was cut off can go on.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Checkpoint {
    /// Hash of the question and the data that it belongs to.
    pub of: u64,
    /// How many times the usual number of axes are looked at.
    pub times: usize,
    /// The cost of each axis that was looked at.
    pub wide: Vec<f64>,
    /// Places of the axes that were looked at more closely.
    pub closer: Vec<Vec<coarse::Place>>,
}

/// Who is told.
pub trait Watch: Sync {
    /// Something was done.
    fn tell(&self, progress: Progress);
    /// Keeps a checkpoint of the work so far, if wanted; called between chunks of the first look.
    fn keep(&self, checkpoint: &Checkpoint);
}

/// Nobody.
impl Watch for () {
    fn tell(&self, _: Progress) {}
    fn keep(&self, _: &Checkpoint) {}
}
