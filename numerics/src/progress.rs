//! Progress of long work for whoever watches it, and its early end.

/// Watches long work: a bar on a terminal, lines of JSON, a web page. Every method has a default that does nothing, and may be called from any
/// thread.
pub trait Progress: Sync {
    /// A stage begins. `steps` is how many steps it has, where that is known.
    fn begin(&self, _stage: &str, _steps: Option<u64>) {}

    /// The stage is so many steps further.
    fn advance(&self, _steps: u64) {}

    /// Says in a line where the work stands.
    fn status(&self, _text: &str) {}

    /// Passes on something that a person should know before believing the result.
    fn warn(&self, _warning: &str) {}

    /// Returns true where the work should end as soon as it can.
    fn is_cancelled(&self) -> bool {
        false
    }
}

/// Watches nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {}

/// The work was ended early by whoever watches it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("stopped")]
pub struct Cancelled;
