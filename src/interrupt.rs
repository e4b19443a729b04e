//! Signals that ask a running command to end: Ctrl-C, `kill`, a terminal that goes away.

use anyhow::Context as _;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
use signal_hook::iterator::Signals;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Meaning of a terminal that goes away (SIGHUP): a dropped connection, a closed window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hangup {
    /// Ends as Ctrl-C does.
    Ends,
    /// Goes on, as under `nohup`: nobody reads the output any more.
    GoesOn,
}

/// Lets a file that reaches the largest size that is allowed (`ulimit -f`) end in an error, as on a full disk: the signal that comes with it would end the program.
///
/// # Errors
/// The system's refusal.
pub fn outlive_long_files() -> anyhow::Result<()> {
    // A handler that does nothing: the write then fails.
    signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)))
        .context("cannot ignore SIGXFSZ")?;
    Ok(())
}

/// Calls `end` on every Ctrl-C and SIGTERM, from a thread of its own; on SIGHUP where that ends too.
///
/// # Errors
/// The system's refusal.
pub fn listen(hangup: Hangup, end: impl Fn() + Send + 'static) -> anyhow::Result<()> {
    let mut signals =
        Signals::new([SIGINT, SIGTERM, SIGHUP]).context("cannot listen for Ctrl-C")?;
    std::thread::Builder::new()
        .name("signals".into())
        .spawn(move || {
            for signal in &mut signals {
                if signal != SIGHUP || hangup == Hangup::Ends {
                    end();
                }
            }
        })
        .context("cannot listen for Ctrl-C")?;
    Ok(())
}
