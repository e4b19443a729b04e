//! Running this test program again under `umockdev-run`, with a device made of a recording.
#![allow(dead_code, reason = "each test uses its part")]

use std::path::Path;
use std::process::Command;
use sunglint_drivers::recording::Recording;

/// The case that this program has to play as the host, if it was started for that.
const CASE: &str = "SUNGLINT_UNDER_UMOCKDEV";
/// Begins the line that tells how it ended.
const MARK: &str = "ended: ";

/// Whether `umockdev-run` can be used; records the skip of `test` if not.
pub fn is_there(test: &str) -> bool {
    let there = Command::new("umockdev-run").arg("--version").output();
    let there = there.is_ok_and(|output| output.status.success());
    if !there {
        sunglint_testkit::skip(test, "no umockdev-run (Debian package umockdev)");
    }
    there
}

/// In a program started by [`run`]: plays the host, and tells how that ended.
pub fn play_if_asked(host: impl FnOnce(&str) -> String) {
    if let Some(case) = std::env::var_os(CASE) {
        println!("\n{MARK}{}", host(&case.to_string_lossy()));
    }
}

/// Starts a test of this program, which plays the host, under umockdev with these options, and gives how it ended.
pub fn run(host: &str, case: &str, options: &[String]) -> String {
    let (program, arguments) = sunglint_testkit::again(host);
    // A program that asks for what is not in the recording waits for ever.
    let output = Command::new("timeout")
        .args(["--kill-after=2", "20", "umockdev-run"])
        .args(options)
        .arg("--")
        .arg(program)
        .args(arguments)
        .env(CASE, case)
        .output()
        .expect("umockdev-run");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    match text.lines().find_map(|line| line.strip_prefix(MARK)) {
        Some(end) => end.to_owned(),
        None => panic!(
            "{case}: {} under umockdev\n{text}\n{}",
            output.status,
            String::from_utf8_lossy(&output.stderr)
        ),
    }
}

/// A file beside others, and its path.
pub fn write(folder: &Path, name: &str, bytes: impl AsRef<[u8]>) -> String {
    let path = folder.join(name);
    std::fs::write(&path, bytes).expect("written");
    path.display().to_string()
}

/// Returns the conversation, without pauses.
pub fn said(recording: &Recording) -> Vec<String> {
    let lines = recording.events.iter().map(|(_, event)| event.to_string());
    lines.filter(|line| !line.starts_with('~')).collect()
}
