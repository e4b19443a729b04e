//! Shows how far the search is, and keeps what it can go on from.

use crate::output::Console;
use anyhow::Context as _;
use indicatif::{ProgressBar, ProgressStyle};
use std::path::PathBuf;
use std::sync::Mutex;
use std::time::{Duration, Instant};
use sunglint_formats::atomic::{Overwrite, write_file};
use sunglint_inference::attitude::{Checkpoint, Progress, Watch};

/// What takes longer shows its progress.
const PATIENCE: Duration = Duration::from_secs(1);
/// A checkpoint is written as often.
const EVERY: Duration = Duration::from_secs(5);

/// The bar and the file.
pub(super) struct Kept {
    start: Instant,
    bar: ProgressBar,
    quiet: bool,
    console: Console,
    path: Option<PathBuf>,
    from: Option<Checkpoint>,
    /// When the file was written last, and whether that failed.
    last: Mutex<(Instant, bool)>,
}

impl Kept {
    /// Reads the checkpoint, if there is one.
    pub fn new(path: Option<PathBuf>, force: bool, console: Console) -> anyhow::Result<Self> {
        let from = match path.as_ref().filter(|p| p.exists() && !force) {
            Some(path) => {
                let text = sunglint_formats::read::text(path)?;
                let read = serde_json::from_str(&text).with_context(|| {
                    format!(
                        "{}: this is no checkpoint of `analyse attitude` (--force begins anew and overwrites it)",
                        path.display()
                    )
                })?;
                Some(read)
            }
            None => None,
        };
        let bar = ProgressBar::new_spinner();
        let bar = match ProgressStyle::with_template("{spinner} {msg} ({elapsed})") {
            Ok(style) => bar.with_style(style),
            Err(_) => bar,
        };
        let last = Mutex::new((Instant::now(), false));
        Ok(Self { start: Instant::now(), bar, quiet: console.quiet, console, path, from, last })
    }

    /// What to go on from.
    pub fn from(&self) -> Option<&Checkpoint> {
        self.from.as_ref()
    }

    /// The search is over: the checkpoint has done its work and is taken away.
    pub fn end(&self) {
        self.bar.finish_and_clear();
        if let Some(path) = self.path.as_ref().filter(|p| p.exists())
            && let Err(error) = std::fs::remove_file(path)
        {
            self.console.warn(&format!("{}: cannot be removed: {error}", path.display()));
        }
    }
}

impl Watch for Kept {
    fn tell(&self, progress: Progress) {
        if self.quiet || self.start.elapsed() < PATIENCE {
            return;
        }
        let Progress { stage, done, of } = progress;
        self.bar.set_message(format!("{stage}: {done} of {of}"));
        self.bar.tick();
    }

    fn keep(&self, checkpoint: &Checkpoint) {
        let Some(path) = &self.path else { return };
        let Ok(mut last) = self.last.lock() else { return };
        if last.0.elapsed() < EVERY || last.1 {
            return;
        }
        last.0 = Instant::now();
        let written = serde_json::to_vec(checkpoint).map_err(|e| e.to_string()).and_then(|bytes| {
            write_file(path, &bytes, Overwrite::Allow).map_err(|e| e.to_string())
        });
        if let Err(error) = written {
            last.1 = true;
            self.console.warn(&format!("no checkpoint is kept: {error}"));
        }
    }
}
