//! Signals that ask a running command to end: Ctrl-C, `kill`, a terminal that goes away.

use anyhow::Context as _;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

/// Meaning of a terminal that goes away (SIGHUP): a dropped connection, a closed window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hangup {
    /// Ends as Ctrl-C does.
    Ends,
    /// Goes on, as under `nohup`: nobody reads the output any more.
    GoesOn,
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
