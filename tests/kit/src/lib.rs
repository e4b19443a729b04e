//! Common parts of the workspace's tests: skips that are counted, the Python of the peer programs, campaigns and how often their intervals held, and the folders.

mod campaign;
pub mod coverage;
mod fuzz;
mod namespace;
mod rows;

pub use campaign::Campaign;
pub use fuzz::{Fuzz, Tried};
pub use namespace::live;

use std::io::Write as _;
use std::path::PathBuf;
use std::process::Command;

/// The top of the repository.
pub fn repository() -> PathBuf {
    // tests/kit lies two folders below the top.
    let mut top = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    top.pop();
    top.pop();
    top
}

/// A file of `fixtures/`.
pub fn fixture(path: &str) -> PathBuf {
    repository().join("fixtures").join(path)
}

/// A file of the folder `shared` beside the checkout, where there is one.
pub fn shared(path: &str) -> Option<PathBuf> {
    let file = repository().parent()?.join("shared").join(path);
    file.exists().then_some(file)
}

/// Records that `test` could not run, and why. The test returns after it; `./test` counts it as skipped,
/// and under `CI=true` fails if `tests/allowed_skips.txt` does not list it.
pub fn skip(test: &str, reason: &str) {
    eprintln!("skipped {test}: {reason}");
    if let Some(log) = std::env::var_os("SUNGLINT_SKIP_LOG") {
        let line = format!("{test}\t{}\n", reason.replace('\n', " "));
        let written = std::fs::OpenOptions::new()
            .create(true)
            .append(true)
            .open(&log)
            // One write call per line: tests run side by side.
            .and_then(|mut file| file.write_all(line.as_bytes()));
        if let Err(error) = written {
            panic!("cannot record the skip of {test} in {}: {error}", log.display());
        }
    }
}

/// The Python that has the peer programs (`.venv` at the top, made by `./test`), or `None` after recording the skip
/// of `test`.
pub fn peer_python(test: &str, modules: &[&str]) -> Option<PathBuf> {
    let python = repository().join(".venv/bin/python");
    if !python.exists() {
        skip(test, "no .venv with the peer programs (./test makes it)");
        return None;
    }
    for module in modules {
        let found = Command::new(&python)
            .args(["-c", &format!("import {module}")])
            .output()
            .is_ok_and(|out| out.status.success());
        if !found {
            skip(test, &format!("the Python package {module} is not in .venv"));
            return None;
        }
    }
    Some(python)
}

/// Runs a Python script with the peer programs and gives what it printed; panics with its error output if it fails.
pub fn run_python(python: &std::path::Path, script: &str, arguments: &[&str]) -> String {
    let output = Command::new(python)
        .arg("-c")
        .arg(script)
        .args(arguments)
        .output()
        .unwrap_or_else(|error| panic!("cannot start {}: {error}", python.display()));
    assert!(
        output.status.success(),
        "the peer script failed:\n{}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Runs a test in a process of its own, because it changes or measures the whole process (allocator, signals, limits, working folder) and the tests of a
/// crate share one program. Returns true in that process, where the test goes on; false in the parent once the child has passed.
///
/// `test` is the function's name; no other test of the program has it.
///
/// # Panics
/// Panics with the output of the child where the child fails, or where it ran no test.
pub fn alone(test: &str) -> bool {
    const CHILD: &str = "SUNGLINT_ALONE";
    if std::env::var(CHILD).is_ok_and(|running| running == test) {
        return true;
    }
    let (program, arguments) = again(test);
    let output = Command::new(program)
        .args(arguments)
        .env(CHILD, test)
        .output()
        .unwrap_or_else(|error| panic!("cannot start {test}: {error}"));
    passed(&output, &format!("{test} alone"));
    false
}

/// Panics with what a child said, unless it passed its one test. Indented, so that who counts the lines `test result:` counts the parent's alone.
pub(crate) fn passed(child: &std::process::Output, who: &str) {
    let said = [&child.stdout, &child.stderr].map(|bytes| String::from_utf8_lossy(bytes));
    let indented = said.join("\n").replace('\n', "\n  ");
    assert!(child.status.success() && said[0].contains("1 passed"), "{who}:\n  {indented}");
}

/// This test program, and the arguments with which it runs the test function of this name and no other.
///
/// # Panics
/// Panics where the program has no such test, or several.
pub fn again(test: &str) -> (PathBuf, Vec<String>) {
    let program = std::env::current_exe().unwrap_or_else(|e| panic!("where is this test: {e}"));
    let listed = Command::new(&program).args(["--list", "--format", "terse"]).output();
    let listed =
        listed.unwrap_or_else(|error| panic!("cannot start {}: {error}", program.display()));
    let listed = String::from_utf8_lossy(&listed.stdout).into_owned();
    let own = |line: &&str| line.rsplit("::").next() == Some(test);
    let mut found = listed.lines().filter_map(|line| line.strip_suffix(": test")).filter(own);
    let name = match (found.next(), found.next()) {
        (Some(name), None) => name.to_owned(),
        (None, _) => panic!("{} has no test {test}", program.display()),
        (Some(one), Some(other)) => panic!("two tests have the same name: {one}, {other}"),
    };
    (program, ["--exact", &name, "--nocapture", "--test-threads=1"].map(str::to_owned).to_vec())
}

/// Seconds that all threads of this process have computed; 0 where the system does not say.
pub fn cpu_s() -> f64 {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after = text.rsplit(')').next().unwrap_or_default();
    let ticks: f64 =
        after.split_whitespace().skip(11).take(2).filter_map(|t| t.parse::<f64>().ok()).sum();
    ticks / 100.0
}

/// The chance that `missed` or more of n trials fail of which each fails with the chance `share`, below 1.
///
/// ```
/// // 1 − 0.95¹⁰ − 10·0.05·0.95⁹
/// assert!((sunglint_testkit::chance_of_misses(10, 2, 0.05) - 0.086_14).abs() < 1e-5);
/// assert_eq!(sunglint_testkit::chance_of_misses(60, 0, 0.05), 1.0);
/// ```
pub fn chance_of_misses(n: u64, missed: u64, share: f64) -> f64 {
    let mut term = (1.0 - share).powi(n as i32);
    let mut below = 0.0;
    for k in 0..missed {
        below += term;
        term *= (n - k) as f64 / (k + 1) as f64 * share / (1.0 - share);
    }
    1.0 - below
}
