//! Progress of long work on a terminal.

use crate::interrupt::{Hangup, listen};
use crate::output::{Console, tell};
use indicatif::{ProgressBar, ProgressStyle};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use sunglint_numerics::progress::Progress;

/// Work that takes longer shows its progress.
const PATIENCE: Duration = Duration::from_secs(1);
/// Interval of the lines on stderr where that is no terminal.
const LINES: Duration = Duration::from_secs(10);

/// Progress of one piece of work: a bar where the number of steps is known, else a spinner; lines where stderr is no terminal. Nothing is shown in the
/// first second, nor with `-q`. It leaves nothing behind on the terminal.
pub struct Bar {
    console: Console,
    start: Instant,
    shown: Mutex<Shown>,
}

/// State that is shown.
struct Shown {
    stage: String,
    steps: Option<u64>,
    done: u64,
    status: String,
    /// When the last line was written, after the start.
    said: Duration,
    bar: Option<ProgressBar>,
}

/// A bar whose work Ctrl-C ends.
pub struct Watched {
    /// The bar.
    pub bar: Bar,
    stop: Arc<AtomicBool>,
}

impl Watched {
    /// Progress that begins now, and listens for Ctrl-C.
    ///
    /// # Errors
    /// The system does not let it listen.
    pub fn new(console: Console) -> anyhow::Result<Self> {
        let stop = Arc::new(AtomicBool::new(false));
        let heard = Arc::clone(&stop);
        listen(Hangup::Ends, move || heard.store(true, Ordering::Relaxed))?;
        Ok(Self { bar: Bar::new(console), stop })
    }
}

impl Progress for Watched {
    fn begin(&self, stage: &str, steps: Option<u64>) {
        self.bar.begin(stage, steps);
    }

    fn advance(&self, steps: u64) {
        self.bar.advance(steps);
    }

    fn status(&self, text: &str) {
        self.bar.status(text);
    }

    fn warn(&self, warning: &str) {
        self.bar.warn(warning);
    }

    fn is_cancelled(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

impl Bar {
    /// Progress that begins now.
    pub fn new(console: Console) -> Self {
        let shown = Shown {
            stage: String::new(),
            steps: None,
            done: 0,
            status: String::new(),
            said: Duration::ZERO,
            bar: None,
        };
        Self { console, start: Instant::now(), shown: Mutex::new(shown) }
    }

    /// Takes the bar off the terminal.
    pub fn end(&self) {
        if let Some(bar) = self.shown().bar.take() {
            bar.finish_and_clear();
        }
    }

    /// Runs `print` while the bar is off the terminal.
    pub fn suspend<T>(&self, print: impl FnOnce() -> T) -> T {
        match &self.shown().bar {
            Some(bar) => bar.suspend(print),
            None => print(),
        }
    }

    fn shown(&self) -> MutexGuard<'_, Shown> {
        self.shown.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn show(&self, shown: &mut Shown) {
        let elapsed = self.start.elapsed();
        if self.console.quiet || elapsed < PATIENCE {
            return;
        }
        let message = shown.message();
        let bar = shown.bar.get_or_insert_with(|| bar(shown.steps, message)).clone();
        if bar.is_hidden() {
            if elapsed >= shown.said + LINES {
                shown.said = elapsed;
                tell(&format!("{} in {:.0} s", shown.text(), elapsed.as_secs_f64()));
            }
            return;
        }
        bar.set_message(shown.message());
        bar.set_position(shown.done);
    }
}

/// A bar that is not drawn yet; hidden where stderr is no terminal. One without a number of steps turns on its own, since its work may say nothing for long.
fn bar(steps: Option<u64>, message: String) -> ProgressBar {
    let (bar, template) = match steps {
        Some(steps) => (ProgressBar::new(steps), "{msg} {wide_bar} {pos}/{len} ({eta})"),
        None => (ProgressBar::new_spinner(), "{spinner} {msg} ({elapsed})"),
    };
    let bar = bar.with_message(message);
    let bar = match ProgressStyle::with_template(template) {
        Ok(style) => bar.with_style(style),
        // A template that does not parse would only leave the plain bar.
        Err(_) => bar,
    };
    if steps.is_none() {
        bar.enable_steady_tick(PATIENCE / 2);
    }
    bar
}

impl Shown {
    /// The stage and where it stands, beside a bar.
    fn message(&self) -> String {
        let parts = match (self.steps, self.done) {
            (None, 1..) => format!("{} {}", self.done, self.stage),
            _ => self.stage.clone(),
        };
        match (parts.is_empty(), self.status.is_empty()) {
            (_, true) => parts,
            (true, _) => self.status.clone(),
            _ => format!("{parts}: {}", self.status),
        }
    }

    /// The same without a bar.
    fn text(&self) -> String {
        let message = self.message();
        match self.steps {
            Some(steps) => format!("{message}: {} of {steps}", self.done),
            None => message,
        }
    }
}

impl Progress for Bar {
    fn begin(&self, stage: &str, steps: Option<u64>) {
        self.end();
        let mut shown = self.shown();
        stage.clone_into(&mut shown.stage);
        (shown.steps, shown.done) = (steps, 0);
        shown.status.clear();
        // A spinner is begun at once: its own ticks draw it later.
        if steps.is_none() && !self.console.quiet {
            let message = shown.message();
            shown.bar = Some(bar(steps, message));
        }
        self.show(&mut shown);
    }

    fn advance(&self, steps: u64) {
        let mut shown = self.shown();
        shown.done += steps;
        self.show(&mut shown);
    }

    fn status(&self, text: &str) {
        let mut shown = self.shown();
        text.clone_into(&mut shown.status);
        self.show(&mut shown);
    }

    fn warn(&self, warning: &str) {
        self.suspend(|| self.console.warn(warning));
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.end();
    }
}
