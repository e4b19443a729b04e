//! Tests with servers that listen on every interface, in a network of their own.

use crate::{again, passed, skip};
use std::process::Command;

const INSIDE: &str = "SUNGLINT_IN_NAMESPACE";
const UNSHARE: [&str; 5] = ["-rn", "--pid", "--fork", "--kill-child", "sh"];

/// Runs `body` in namespaces of its own (`unshare`): users, so that anybody may; network, so that nobody else can connect; processes, so that nothing
/// outlives it. Where that is not possible, or a program (of Debian's indi-bin) is missing, the skip of the test is recorded, which has that name.
///
/// # Panics
/// Panics where the test fails in there.
pub fn live(test: &str, programs: &[&str], body: impl FnOnce()) {
    if std::env::var_os(INSIDE).is_some() {
        return body();
    }
    if let Err(reason) = possible(programs) {
        return skip(test, &reason);
    }
    let (program, arguments) = again(test);
    let output = Command::new("unshare")
        .args(UNSHARE)
        .args(["-c", "ip link set lo up && exec \"$@\"", "sh"])
        .arg(program)
        .args(arguments)
        .env(INSIDE, "yes")
        .output()
        .unwrap_or_else(|error| panic!("cannot start {test}: {error}"));
    eprintln!("{}", String::from_utf8_lossy(&output.stderr));
    passed(&output, "in the namespace");
}

fn possible(programs: &[&str]) -> Result<(), String> {
    for program in programs {
        let there = std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default())
            .any(|folder| folder.join(program).exists());
        if !there {
            return Err(format!("no {program} (Debian package indi-bin)"));
        }
    }
    let tried = Command::new("unshare").args(UNSHARE).args(["-c", "ip link set lo up"]).output();
    match tried {
        Ok(output) if output.status.success() => Ok(()),
        _ => Err("no network namespaces for this user (unshare, ip)".to_owned()),
    }
}
