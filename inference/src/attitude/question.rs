//! What is asked, how it is searched, who is told of it, and what a search that was cut off goes on from.

use super::state::{Turn, Unknowns};
use super::{Scale, coarse};
use glam::DVec3;
use hifitime::Epoch;

/// What is asked.
#[derive(Debug, Clone)]
pub struct Question {
    /// The axis of the spin in the body.
    pub axis_body: DVec3,
    /// When the phase counts.
    pub epoch: Epoch,
    /// What is unknown.
    pub unknowns: Unknowns,
    /// What is known: of it counts what is not unknown.
    pub known: Turn,
    /// Turns a second between which the spin is looked for, pairs of a lower and an upper bound; negative ones are left-handed.
    pub rates: Vec<(f64, f64)>,
    /// What of the brightness is free.
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
    /// What is done.
    pub stage: &'static str,
    /// How much of it.
    pub done: usize,
    /// Of how much.
    pub of: usize,
}

/// What a search that was cut off can go on from.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Checkpoint {
    /// Of which question and which data.
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
    /// What was done could be kept; called between chunks of the first look.
    fn keep(&self, checkpoint: &Checkpoint);
}

/// Nobody.
impl Watch for () {
    fn tell(&self, _: Progress) {}
    fn keep(&self, _: &Checkpoint) {}
}
