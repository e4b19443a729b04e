//! `sunglint focus`: a rehearsal, a real server's camera and focuser, refusals.

#![allow(clippy::unwrap_used, reason = "a test says what it expects")]

use crate::common::Folder;
use sunglint_testkit::{peer_python, repository};

/// Truth: the virtual telescope's own: sharp at 25,300 steps of its moving part, which lags behind the counter by the play of 120 where it comes from below.
#[test]
fn a_rehearsal_finds_the_focus_and_runs_give_a_drift() {
    let folder = Folder::new("focus");
    let page = std::fs::read_to_string(repository().join("docs/focus.md")).unwrap();
    let lines =
        page.lines().filter_map(|line| line.strip_prefix("sunglint focus run --focuser virtual"));
    let mut ran = 0;
    for line in lines {
        let words = line.split('#').next().unwrap();
        let words: Vec<&str> = words.split_whitespace().collect();
        folder.done(&[&["focus", "run", "--focuser", "virtual"], &words[..]].concat());
        ran += 1;
    }
    assert!(ran > 0 && folder.path("focus.png").exists());
    let focus = ["focus", "run", "--focuser", "virtual", "--camera", "virtual", "--step", "500"];
    for (side, truth, file) in [("up", 25_420.0, "up.json"), ("down", 25_300.0, "down.json")] {
        folder.done(&[&focus[..], &["--approach", side, "-o", file]].concat());
        let text = std::fs::read_to_string(folder.path(file)).unwrap();
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        let (best, half) = (
            json["curve"]["best"].as_f64().unwrap(),
            json["curve"]["half_width_95"].as_f64().unwrap(),
        );
        assert!((best - truth).abs() < half && half < 100.0, "{side} {best} {half}");
        assert!(json["error"].is_null() && json["points"].as_array().unwrap().len() == 9);
    }
    // The same temperature in all: no drift, and that is said.
    let none = folder.refused(1, &["focus", "drift", "up.json", "down.json", "up.json"]);
    assert!(none.contains("span 0.00 K"), "{none}");
    // By hand: 10 steps/K.
    for (i, celsius) in [0, 1, 2].into_iter().enumerate() {
        let text = format!(
            r#"{{"curve":{{"best":{},"sigma":1.0}},"temperature_c":{celsius}}}"#,
            100 + 10 * i
        );
        std::fs::write(folder.path(&format!("{i}.json")), text).unwrap();
    }
    let drift =
        folder.json(&["focus", "drift", "0.json", "1.json", "2.json", "--at", "5", "--json"]);
    assert_eq!(drift["position_there"], 150.0);
    let wrong = |code, more: &[&str]| folder.refused(code, &[&focus[..], more].concat());
    assert!(wrong(1, &["--points", "3"]).contains("expected 5 to 99"));
    assert!(wrong(1, &["--center", "100"]).contains("the focuser has 0 to 50000"));
    let mixed = ["focus", "run", "--focuser", "virtual", "--camera", "sim-camera", "--step", "500"];
    assert!(folder.refused(2, &mixed).contains("both `virtual`"));
}

/// Truth: alpaca-simulators 1.3.2, whose seeing is least at position 10,000 of its focuser and grows evenly on both sides; the frames hold three dozen stars. Camera and
/// focuser are read over HTTP by the program itself.
#[test]
fn an_alpaca_camera_and_focuser_are_focused() {
    let test = "an_alpaca_camera_and_focuser_are_focused";
    let Some(python) = peer_python(test, &["alpaca_simulators"]) else { return };
    use std::io::BufRead as _;
    let mut server = std::process::Command::new(python)
        .arg(repository().join("drivers/tests/alpaca_server.py"))
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let mut port = String::new();
    std::io::BufReader::new(server.stdout.take().unwrap()).read_line(&mut port).unwrap();
    let port = port.trim();
    for _ in 0..600 {
        if std::net::TcpStream::connect(format!("127.0.0.1:{port}")).is_ok() {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(100));
    }
    let folder = Folder::new("focus-alpaca");
    let (focuser, camera) =
        (format!("alpaca-focuser:127.0.0.1:{port}/0"), format!("alpaca-camera:127.0.0.1:{port}/0"));
    let run = folder.run(&[
        "focus",
        "run",
        "--focuser",
        &focuser,
        "--camera",
        &camera,
        "--step",
        "50",
        "--center",
        "10060",
        "--exposure-s",
        "0.1",
        "--overshoot",
        "50",
        "--json",
    ]);
    let listed =
        folder.run(&["devices", "list", "--alpaca", &format!("127.0.0.1:{port}"), "--json"]);
    server.kill().unwrap();
    server.wait().unwrap();
    let text = String::from_utf8_lossy(&run.stderr).into_owned();
    assert!(run.status.success(), "{text}");
    let json: serde_json::Value = serde_json::from_slice(&run.stdout).unwrap();
    let (best, half) =
        (json["curve"]["best"].as_f64().unwrap(), json["curve"]["half_width_95"].as_f64().unwrap());
    // Frames of the same stars and other noise; the seeing's corner at the focus is sharper than a hyperbola's.
    assert!((best - 10_000.0).abs() < half.max(5.0) && half < 30.0, "{best} {half}");
    let listed: serde_json::Value = serde_json::from_slice(&listed.stdout).unwrap();
    let devices = listed["alpaca"][0]["devices"].as_array().unwrap();
    assert!(devices.iter().any(|one| one["addresses"][0] == camera), "{devices:?}");
}
