//! `sunglint reduce`: a session's frames and counts, visit by visit, as linear light curves.

pub mod counts;
pub mod frames;
pub mod join;
pub mod night;
pub mod sky;

use hifitime::Epoch;
use sunglint_formats::session::Target;

/// A stay of the telescope, as the session's log has it, with an end.
#[derive(Debug, Clone, PartialEq)]
pub struct Stay {
    /// What it looked at.
    pub target: Target,
    /// Which stay at a target of this name it is, from 1.
    pub number: u32,
    /// When it began.
    pub from: Epoch,
    /// When it ended: the log's word, else the end of what was recorded.
    pub to: Epoch,
}

/// Told of progress; may end the work.
pub trait Stop {
    /// So many frames or bins further.
    ///
    /// # Errors
    /// The work is to end.
    fn step(&mut self, count: u64) -> anyhow::Result<()>;
}
