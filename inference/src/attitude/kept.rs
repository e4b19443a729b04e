//! Keeps what a search that is cut off can go on from.

use super::analysis::AnalysisError;
use super::{Checkpoint, Progress as At, Watch};
use std::path::PathBuf;
use std::sync::Mutex;
use std::time::{Duration, Instant};
use sunglint_formats::atomic::{Overwrite, write_file};
use sunglint_numerics::progress::Progress;

/// A checkpoint is written as often.
const EVERY: Duration = Duration::from_secs(5);

/// The file, and whoever watches.
pub(super) struct Kept<'a> {
    to: &'a dyn Progress,
    path: Option<PathBuf>,
    from: Option<Checkpoint>,
    /// When the file was written last, and whether that failed.
    last: Mutex<(Instant, bool)>,
}

impl<'a> Kept<'a> {
    /// Reads the checkpoint, if there is one and the search does not begin `anew`.
    pub fn new(
        path: Option<PathBuf>,
        anew: bool,
        to: &'a dyn Progress,
    ) -> Result<Self, AnalysisError> {
        let from = match path.as_ref().filter(|p| p.exists() && !anew) {
            Some(path) => {
                let text = sunglint_formats::read::text(path)?;
                let wrong = |source| AnalysisError::Checkpoint { path: path.clone(), source };
                Some(serde_json::from_str(&text).map_err(wrong)?)
            }
            None => None,
        };
        Ok(Self { to, path, from, last: Mutex::new((Instant::now(), false)) })
    }

    /// Returns the checkpoint to go on from.
    pub fn from(&self) -> Option<&Checkpoint> {
        self.from.as_ref()
    }

    /// The search is over: the checkpoint has done its work and is taken away.
    pub fn end(&self) {
        if let Some(path) = self.path.as_ref().filter(|p| p.exists())
            && let Err(error) = std::fs::remove_file(path)
        {
            self.to.warn(&format!("{}: cannot be removed: {error}", path.display()));
        }
    }
}

impl Watch for Kept<'_> {
    fn tell(&self, at: At) {
        let At { stage, done, of } = at;
        self.to.status(&format!("{stage}: {done} of {of}"));
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
            self.to.warn(&format!("no checkpoint is kept: {error}"));
        }
    }
}
