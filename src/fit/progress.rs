//! How far a comparison or a fit is.

use crate::output::Console;
use indicatif::{ProgressBar, ProgressStyle};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};
use sunglint_numerics::progress::Progress;

/// Time after which work shows its progress.
const PATIENCE: Duration = Duration::from_secs(1);

/// Shows how far the work is, where that takes long; passes warnings on.
pub(crate) struct Bar {
    start: Instant,
    console: Console,
    shown: Mutex<Shown>,
}

/// State that is shown.
#[derive(Default)]
struct Shown {
    bar: Option<ProgressBar>,
    stage: String,
    /// How many steps the stage has, where that is known.
    of: Option<u64>,
    done: u64,
}

impl Bar {
    pub fn new(console: Console) -> Self {
        Self { start: Instant::now(), console, shown: Mutex::default() }
    }

    fn show(&self, text: Option<&str>, steps: u64) {
        // A lock that a panicking thread left holds nothing that could be wrong.
        let mut shown = self.shown.lock().unwrap_or_else(PoisonError::into_inner);
        let Shown { bar, stage, of, done } = &mut *shown;
        *done += steps;
        if self.console.quiet || self.start.elapsed() < PATIENCE {
            return;
        }
        // Hidden where stderr is no terminal.
        let bar = bar.get_or_insert_with(|| {
            let (bar, template) = match *of {
                Some(of) => (ProgressBar::new(of), "{msg:>8} {wide_bar} {pos}/{len} {eta}"),
                None => (ProgressBar::new_spinner(), "{spinner} {msg} ({elapsed})"),
            };
            match ProgressStyle::with_template(template) {
                Ok(style) => bar.with_style(style),
                Err(_) => bar,
            }
        });
        bar.set_message(text.unwrap_or(stage).to_owned());
        match of {
            Some(_) => bar.set_position(*done),
            None => bar.tick(),
        }
    }

    /// Takes it away.
    pub fn end(&self) {
        let mut shown = self.shown.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(bar) = shown.bar.take() {
            bar.finish_and_clear();
        }
    }
}

impl Progress for Bar {
    fn begin(&self, stage: &str, steps: Option<u64>) {
        self.end();
        let mut shown = self.shown.lock().unwrap_or_else(PoisonError::into_inner);
        *shown = Shown { stage: stage.to_owned(), of: steps, ..Shown::default() };
    }

    fn advance(&self, steps: u64) {
        self.show(None, steps);
    }

    fn status(&self, text: &str) {
        self.show(Some(text), 0);
    }

    fn warn(&self, warning: &str) {
        self.console.warn(warning);
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.end();
    }
}
