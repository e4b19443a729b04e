//! How far a fit is.

use crate::output::Console;
use indicatif::{ProgressBar, ProgressStyle};
use std::time::{Duration, Instant};
use sunglint_inference::solver;

/// What takes longer shows its progress.
const PATIENCE: Duration = Duration::from_secs(1);

/// Shows how far the fit is, where that takes long.
pub(super) struct Shown {
    start: Instant,
    bar: Option<ProgressBar>,
    quiet: bool,
}

impl Shown {
    pub fn new(console: Console) -> Self {
        Self { start: Instant::now(), bar: None, quiet: console.quiet }
    }

    fn bar(&mut self) -> Option<&ProgressBar> {
        if self.quiet || self.start.elapsed() < PATIENCE {
            return None;
        }
        Some(self.bar.get_or_insert_with(|| {
            // Hidden where stderr is no terminal.
            let bar = ProgressBar::new_spinner();
            match ProgressStyle::with_template("{spinner} {msg} ({elapsed})") {
                Ok(style) => bar.with_style(style),
                Err(_) => bar,
            }
        }))
    }

    pub fn tell(&mut self, progress: solver::Progress) {
        if let Some(bar) = self.bar() {
            let solver::Progress { stage, evaluations, chi2 } = progress;
            bar.set_message(format!("{stage}: {evaluations} simulations, chi-square {chi2:.4e}"));
            bar.tick();
        }
    }

    pub fn say(&mut self, text: &str) {
        if let Some(bar) = self.bar() {
            bar.set_message(text.to_owned());
            bar.tick();
        }
    }

    pub fn end(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
