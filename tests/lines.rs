//! A served bench and the hands of a run, where something goes away: a host, a server that was killed, a run that is stopped.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::{Folder, page_toml};
use crate::served::Server;
use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A virtual goniometer whose stages turn by 20 degrees a second.
const SLOW: &str = "seed = 1\n[stage]\nspeed_deg_per_s = 20\n[meter]\nreading_s = 0.01\n";

/// Addresses of a served bench's devices by their names.
fn places(server: &Server) -> BTreeMap<String, String> {
    let devices = server.begun["devices"].as_array().unwrap();
    let text = |device: &serde_json::Value, key: &str| device[key].as_str().unwrap().to_owned();
    devices.iter().map(|d| (text(d, "name"), text(d, "address"))).collect()
}

fn connect(address: &str) -> TcpStream {
    let line = TcpStream::connect(address.rsplit_once("tcp:").unwrap().1).unwrap();
    line.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    line
}

/// A host of a Zaber stage that is none of ours: one command, the words of the answer.
fn ask(line: &mut TcpStream, command: &str) -> Vec<String> {
    line.write_all(format!("/1 1 {command}\n").as_bytes()).unwrap();
    let mut answer = Vec::new();
    while !answer.ends_with(b"\n") {
        let mut byte = [0];
        line.read_exact(&mut byte).unwrap();
        answer.push(byte[0]);
    }
    String::from_utf8(answer).unwrap().split_whitespace().map(str::to_owned).collect()
}

/// Truth: 10 degrees at 20 degrees a second take half a second, with the acceleration at most one. The host goes as soon as the command is heard; the one who comes 3 s later finds the stage at the end of its way, at rest, in its first answer,
/// which is also the first: no answer to who has gone comes to it.
#[test]
fn a_stage_moves_on_without_a_host() {
    let folder = Folder::new("lines-alone");
    std::fs::write(folder.path("goniometer.toml"), SLOW).unwrap();
    let server = Server::start(&folder, &["goniometer.toml", "--tcp", "0"]);
    let places = places(&server);
    let mut line = connect(&places["azimuth"]);
    assert_eq!(ask(&mut line, "move abs 10000")[2..4], ["OK".to_owned(), "BUSY".to_owned()]);
    // Asked for, and not waited for: the answer is for nobody.
    line.write_all(b"/1 1 get pos\n").unwrap();
    drop(line);
    std::thread::sleep(Duration::from_secs(3));
    let begun = Instant::now();
    let mut line = loop {
        // The one before may not be known to have gone.
        let mut line = connect(&places["azimuth"]);
        line.write_all(b"/1 1 get maxspeed\n").unwrap();
        let mut first = String::new();
        if BufReader::new(line.try_clone().unwrap()).read_line(&mut first).is_ok_and(|n| n > 0) {
            assert!(!first.contains("10000"), "an answer to another: {first}");
            break line;
        }
        assert!(begun.elapsed().as_secs() < 10, "no second host is taken");
    };
    let answer = ask(&mut line, "get pos");
    assert_eq!(answer[2..5], ["OK", "IDLE", "--"].map(str::to_owned));
    // Behind it the sum of the line.
    assert_eq!(answer[5].split(':').next(), Some("10000"), "{answer:?}");
    assert_eq!(server.end().0.code(), Some(0));
}

/// A server that was killed leaves the names of its ports; the next one takes them over, and the one after it is refused while they are in use.
#[test]
fn names_that_a_killed_server_left_are_taken_over() {
    let folder = Folder::new("lines-names");
    std::fs::write(folder.path("goniometer.toml"), SLOW).unwrap();
    let serve = ["goniometer.toml", "--pty", "ports"];
    // Dropped, it is killed.
    drop(Server::start(&folder, &serve));
    let link = folder.path("ports/meter");
    assert!(link.is_symlink(), "a killed server cannot take its names away");
    let server = Server::start(&folder, &serve);
    let port = std::fs::read_link(&link).unwrap();
    assert!(port.exists(), "{} leads nowhere", port.display());
    let meter = places(&server)["meter"].clone();
    let read = folder.json(&["devices", "read", &meter, "--with", "update_hz=100", "--json"]);
    assert!(read["readings"][0]["power_w"].as_f64().unwrap() >= 0.0, "{read}");
    let said = folder.refused(1, &["devices", "serve", "goniometer.toml", "--pty", "ports"]);
    assert!(said.contains("ports/sample"), "{said}");
    assert_eq!(std::fs::read_link(&link).unwrap(), port, "the names of who serves stay");
    assert_eq!(server.end().0.code(), Some(0));
    assert!(!link.is_symlink());
}

/// Whether a program runs that is not only waited for.
fn runs(id: &str) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", id.trim())).unwrap_or_default();
    stat.rsplit_once(')').is_some_and(|(_, rest)| !rest.trim_start().starts_with('Z'))
}

/// Ctrl-C while `--hands` works: what the program has started ends with it, though it does not pass the signal on, and the run says how to go on.
#[test]
fn hands_end_with_their_run() {
    let folder = Folder::new("lines-hands");
    std::fs::write(folder.path("goniometer.toml"), SLOW).unwrap();
    std::fs::write(folder.path("run.toml"), page_toml("lab.md", "[scan]")).unwrap();
    std::fs::write(folder.path("rig.toml"), "[sample]\nalpha = 0.2\n").unwrap();
    folder.done(&["brdf", "retro", "run.toml", "-q", "-o", "lab/"]);
    folder.done(&["brdf", "ndf", "lab/retro.ecsv", "-q", "--resamplings", "3", "-o", "lab/"]);
    let plan = ["brdf", "plan", "lab/ndf.ecsv", "-q", "--measurements", "24", "-o", "lab/"];
    folder.done(&plan);
    let serve = ["goniometer.toml", "--pty", "ports", "-o", "bench.toml"];
    let server = Server::start(&folder, &serve);
    let made = Command::new("sh")
        .args(["-c", "printf '#!/bin/sh\\nsleep 300 &\\necho $! > started\\nwait\\n' > hands; chmod 755 hands"])
        .current_dir(&folder.0)
        .status();
    assert!(made.unwrap().success());
    let run = Command::new(crate::common::program())
        .args(["brdf", "run", "lab/plan.ecsv", "--bench", "bench.toml", "--hands", "./hands"])
        .args(["-q", "-o", "run/"])
        .current_dir(&folder.0)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let begun = Instant::now();
    let started = loop {
        let text = std::fs::read_to_string(folder.path("started")).unwrap_or_default();
        if text.ends_with('\n') {
            break text;
        }
        assert!(begun.elapsed().as_secs() < 60, "the hands were not called");
        std::thread::sleep(Duration::from_millis(10));
    };
    assert!(runs(&started), "{started}");
    let id = run.id().to_string();
    assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    let ended = run.wait_with_output().unwrap();
    assert_eq!(ended.status.code(), Some(1));
    let said = String::from_utf8_lossy(&ended.stderr);
    assert!(said.contains("--resume"), "{said}");
    assert!(!runs(&started), "what the hands started goes on: {started}");
    assert!(Path::new(&folder.path("run/readings.ecsv")).exists());
    assert_eq!(server.end().0.code(), Some(0));
}
