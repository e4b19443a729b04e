//! How far an analysis is, on a terminal.

use crate::output::Console;
use indicatif::{ProgressBar, ProgressDrawTarget};
use std::time::Duration;
use sunglint_numerics::progress::Progress;

/// A spinner, or a bar where the number of steps is known. It is hidden with `-q` and where stderr is no terminal.
pub(super) struct Spinner {
    bar: ProgressBar,
}

impl Spinner {
    /// A spinner that is not yet seen.
    pub fn new(console: Console) -> Self {
        let bar = ProgressBar::new_spinner();
        if console.quiet {
            bar.set_draw_target(ProgressDrawTarget::hidden());
        }
        bar.enable_steady_tick(Duration::from_millis(500));
        Self { bar }
    }

    /// Removes it.
    pub fn end(&self) {
        self.bar.finish_and_clear();
    }
}

impl Progress for Spinner {
    fn begin(&self, stage: &str, steps: Option<u64>) {
        if let Some(steps) = steps {
            self.bar.set_style(indicatif::ProgressStyle::default_bar());
            self.bar.set_length(steps);
            self.bar.set_position(0);
        }
        self.bar.set_message(stage.to_owned());
    }

    fn advance(&self, steps: u64) {
        self.bar.inc(steps);
    }
}
