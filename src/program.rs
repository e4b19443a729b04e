//! The program around a command line: parses, calls, and turns errors into text and exit codes.

use crate::cli::{Cli, run};
use crate::output::{Usage, tell};
use clap::Parser as _;
use std::process::ExitCode;

/// Runs the command line that this process was started with, and prints what goes wrong.
pub fn program() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        // clap prints help and versions to stdout with code 0, mistakes to stderr with code 2.
        Err(error) => {
            let code = error.exit_code();
            let _ = error.print();
            return ExitCode::from(u8::try_from(code).unwrap_or(2));
        }
    };
    match run(&cli) {
        Ok(()) => ExitCode::SUCCESS,
        // Whoever reads the pipe has read enough.
        Err(error) if is_broken_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            tell(&format!("sunglint: {}", describe(&error)));
            // What the parser cannot see is usage all the same.
            if error.downcast_ref::<Usage>().is_some() {
                ExitCode::from(2)
            } else {
                ExitCode::FAILURE
            }
        }
    }
}

/// The command line as provenance has it: with all options that change what comes out, without those that say where it goes.
pub(crate) fn command_line() -> String {
    let mut words = vec!["sunglint".to_owned()];
    let mut given = std::env::args_os().skip(1).map(|a| a.to_string_lossy().into_owned());
    while let Some(word) = given.next() {
        match word.as_str() {
            "-o" | "--output" => {
                given.next();
            }
            "--force" | "--json" | "-q" | "--quiet" | "-v" | "--verbose" => {}
            _ if word.starts_with("--output=") => {}
            _ if word.starts_with("-o") => {}
            _ => words.push(
                match word
                    .contains(|c: char| !c.is_ascii_alphanumeric() && !"_@%+=:,./-".contains(c))
                {
                    true => format!("'{}'", word.replace('\'', r"'\''")),
                    false => word,
                },
            ),
        }
    }
    words.join(" ")
}

/// The error and what caused it, each said once: many errors repeat their cause in their own message.
fn describe(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain() {
        let cause = cause.to_string();
        if text.is_empty() {
            text = cause;
        } else if !text.contains(&cause) {
            text.push_str(": ");
            text.push_str(&cause);
        }
    }
    text
}

fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        cause
            .downcast_ref::<std::io::Error>()
            .is_some_and(|e| e.kind() == std::io::ErrorKind::BrokenPipe)
    })
}
