//! `sunglint session`: recorded nights. `check` reads all of one and says what is there and what is missing.

use crate::output::Console;
use anyhow::bail;
use clap::{Args, Subcommand};
use std::path::PathBuf;
use sunglint_formats::session::{Session, Severity};
use sunglint_report::session::{json, text};

/// Command for a session.
#[derive(Debug, Subcommand)]
pub enum SessionCommand {
    /// Read all of a session and say what is missing; the exit code is 1 where something is
    Check(CheckArgs),
}

/// Arguments of `sunglint session check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    /// The session's folder
    pub session: PathBuf,
}

/// Runs a command on a session.
pub fn run(command: &SessionCommand, console: Console) -> anyhow::Result<()> {
    match command {
        SessionCommand::Check(args) => check(args, console),
    }
}

fn check(args: &CheckArgs, console: Console) -> anyhow::Result<()> {
    let session = Session::open(&args.session)?;
    let report = session.check()?;
    console.result(&text(&session, &report), &json(&session, &report))?;
    if !report.is_whole() {
        let missing = report.findings.iter().filter(|f| f.severity == Severity::Missing).count();
        let things = if missing == 1 { "1 thing is" } else { &format!("{missing} things are") };
        bail!("{}: {things} missing or wrong", args.session.display());
    }
    Ok(())
}
