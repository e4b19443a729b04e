//! The stages of a simulation as a watcher of long work hears of them.

use std::sync::{Mutex, PoisonError};
use sunglint_numerics::progress::Progress;
use sunglint_simulator::pass::{self, Stage};

/// Passes on the stages of a simulation and their steps.
pub(crate) struct Stages<'a> {
    to: &'a dyn Progress,
    /// The stage, and how many of its steps are done.
    at: Mutex<(Option<Stage>, usize)>,
}

impl<'a> Stages<'a> {
    pub fn new(to: &'a dyn Progress) -> Self {
        Self { to, at: Mutex::default() }
    }

    pub fn tell(&self, progress: pass::Progress) {
        // A lock that a panicking thread left holds nothing that could be wrong.
        let mut at = self.at.lock().unwrap_or_else(PoisonError::into_inner);
        if at.0 != Some(progress.stage) {
            *at = (Some(progress.stage), 0);
            let steps = (progress.stage != Stage::Done).then_some(progress.of as u64);
            self.to.begin(progress.stage.name(), steps);
        }
        // Threads tell in any order.
        if progress.done > at.1 {
            self.to.advance((progress.done - at.1) as u64);
            at.1 = progress.done;
        }
    }
}
