//! `sunglint devices` as a person runs it: on simulated devices, on lines to them, and on recordings.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use serde_json::Value;
use serialport::{SerialPort as _, TTYPort};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};
use sunglint_drivers::catalogue::DRIVERS;
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::simulated::indi::{Ramp, Server, ServerSettings};
use sunglint_drivers::simulated::ophir::Ophir;
use sunglint_drivers::simulated::tmcl::{Module, ModuleSettings};
use sunglint_drivers::simulated::{Steady, indi, serve};
use sunglint_drivers::transport::serial::Serial;
use sunglint_drivers::transport::tcp::Tcp;

/// Longest time for which a served device waits for its host: a test that needs it ends long before, on any machine.
const PATIENCE: Duration = Duration::from_secs(300);

fn fixtures(folder: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(folder);
    let mut all: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "rec"))
        .collect();
    all.sort();
    all
}

/// The document of a command that ended with this code, and what it said on stderr.
fn document(folder: &Folder, code: i32, arguments: &[&str]) -> (Value, String) {
    let output = folder.run(&[arguments, &["--json"]].concat());
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {message}");
    (serde_json::from_slice(&output.stdout).unwrap_or(Value::Null), message)
}

/// Truth: each simulated device passes its own self-test; what was said replays to the last byte and gives the same.
#[test]
fn every_simulated_device_checks_out_and_its_recording_replays() {
    let folder = Folder::new("devices-check");
    for driver in DRIVERS.into_iter().filter(|driver| driver.simulated) {
        let (check, _) = document(
            &folder,
            0,
            &["devices", "check", driver.name, "--record", "c.rec", "--force"],
        );
        let steps = check["steps"].as_array().unwrap();
        assert_eq!(steps.len(), 4, "{check}");
        assert!(steps.iter().all(|step| step["verdict"] == "ok"), "{check}");
        assert_eq!(check["simulated"], true);
        let (replay, _) = document(&folder, 0, &["devices", "replay", "c.rec"]);
        assert_eq!(replay["agrees"], true, "{}: {replay}", driver.name);
        assert_eq!(replay["result"]["settings"], check["settings"], "{}", driver.name);
        assert_eq!(replay["synthetic"], true);
    }
}

/// Truth: what the simulated devices were told: a light of 2.5 mW, 200 full steps of 256 microsteps a turn (so that 10° is
/// 1422 steps, 9.998°), a wheel's slots, a camera's window.
#[test]
fn readings_settings_and_moves_are_those_of_the_device() {
    let folder = Folder::new("devices-act");
    for meter in ["sim-ophir", "sim-pm100"] {
        let read = ["devices", "read", meter, "--with", "power_w=0.0025", "-n", "2", "-o"];
        let file = format!("{meter}.ecsv");
        folder.done(&[&read[..], &[&file, "-q"]].concat());
        let table = sunglint_formats::ecsv::read(folder.path(&file)).unwrap();
        assert_eq!(table.f64("power_w").unwrap().as_ref(), [0.0025; 2], "{meter}");
    }
    let (over, _) =
        document(&folder, 0, &["devices", "read", "sim-ophir", "--with", "power_w=0.5"]);
    assert_eq!(
        (&over["readings"][0]["over"], &over["readings"][0]["power_w"]),
        (&Value::Bool(true), &Value::Null)
    );
    let (moved, _) = document(&folder, 0, &["devices", "move", "sim-tmcl", "10", "-5"]);
    let at = |i: usize| moved["moves"][i]["angle_deg"].as_f64().unwrap();
    assert_eq!((at(0), at(1)), (1422.0 * 360.0 / 51_200.0, -711.0 * 360.0 / 51_200.0));
    let (turned, _) = document(&folder, 0, &["devices", "move", "sim-wheel", "4"]);
    assert_eq!(turned["at"]["slot"], 4);
    let (set, _) =
        document(&folder, 0, &["devices", "set", "sim-camera", "gain=40", "window_px=10,20,64,48"]);
    assert_eq!(set["settings"][0]["value"], 40.0);
    assert_eq!(set["settings"][1]["value"], "10,20,64,48 binned 1x1");
    folder.done(&[
        "devices",
        "read",
        "sim-camera",
        "--exposure-s",
        "0.05",
        "-o",
        "one.fits",
        "-n",
        "1",
    ]);
    let frame = sunglint_formats::Frame::read(folder.path("one.fits")).unwrap();
    assert_eq!((frame.pixels.dim(), frame.exposure_s), ((120, 160), 0.05));
    assert_eq!(frame.pixels[(3, 5)], Ramp::adu(5, 3, 0.05));
    folder.done(&[
        "devices",
        "read",
        "sim-camera",
        "--exposure-s",
        "0.05",
        "-n",
        "2",
        "-o",
        "both/",
    ]);
    assert!(
        folder.path("both/frame_0002.fits").exists() && folder.path("both/readings.ecsv").exists()
    );
    let message =
        folder.refused(2, &["devices", "read", "sim-camera", "-n", "2", "-o", "two.fits"]);
    assert!(message.contains("give `-o` a folder"), "{message}");
}

/// Truth: the light that was asked for: 20 kHz on each input are 2,000 photons in 0.1 s with a scatter of 45, so that 20 bins of two inputs lie within 5 σ
/// of their mean each, and their sum within 5 σ of 80,000. Bins follow one another by 0.1 s. A stage of 409,600 microsteps for 3° stands at 12.5° exactly.
#[test]
fn a_counter_counts_and_an_apt_stage_turns() {
    let folder = Folder::new("devices-count");
    let light = ["--with", "rate_hz=20000", "--with", "channels=2"];
    let read = [&["devices", "read", "sim-timetagger", "-n", "20"][..], &light].concat();
    let (counted, _) = document(&folder, 0, &read);
    let readings = counted["readings"].as_array().unwrap();
    assert_eq!(readings.len(), 20);
    let mut sum = 0.0;
    for reading in readings {
        assert_eq!(reading["exposure_s"], 0.1);
        for channel in ["c1", "c2"] {
            let count = reading["counts"][channel].as_f64().unwrap();
            assert!((count - 2000.0).abs() < 5.0 * 2000.0_f64.sqrt(), "{reading}");
            sum += count;
        }
        assert_eq!(reading["counts"].as_object().unwrap().len(), 2);
    }
    assert!((sum - 80_000.0).abs() < 5.0 * 80_000.0_f64.sqrt(), "{sum}");
    let (moved, _) = document(&folder, 0, &["devices", "move", "sim-apt", "12.5", "-3"]);
    let at = |i: usize| moved["moves"][i]["angle_deg"].as_f64().unwrap();
    let step = 3.0 / 409_600.0;
    assert!((at(0) - 12.5).abs() <= 0.5 * step && (at(1) + 3.0).abs() <= 0.5 * step);
}

/// The work done before a failure is shown and kept, with exit code 1.
#[test]
fn failures_keep_what_was_done() {
    let folder = Folder::new("devices-fail");
    let arguments =
        ["devices", "set", "sim-pm100", "averaging=10", "wavelength_nm=99", "-o", "set.json"];
    let (set, message) = document(&folder, 1, &arguments);
    assert!(message.contains("found 99, expected 400 to 1100"), "{message}");
    assert_eq!(
        (set["complete"].as_bool(), set["settings"].as_array().unwrap().len()),
        (Some(false), 1)
    );
    let kept = std::fs::read_to_string(folder.path("set.json")).unwrap();
    assert_eq!(serde_json::from_str::<Value>(&kept).unwrap(), set);
    // Truth: the switches of the simulated module close a motor turn away on either side.
    let (moved, message) = document(&folder, 1, &["devices", "move", "sim-tmcl", "350", "400"]);
    assert!(message.contains("the right limit switch stopped it at 360.0000 deg"), "{message}");
    assert_eq!(moved["moves"].as_array().unwrap().len(), 1);
    assert_eq!(moved["at"]["angle_deg"], 360.0);
    let (turned, message) = document(&folder, 1, &["devices", "move", "sim-efw", "9"]);
    assert!(message.contains("slot: found 9, expected 1 to 7; it stands at slot 1"), "{message}");
    assert_eq!(turned["at"]["slot"], 1);
    let (check, _) =
        document(&folder, 0, &["devices", "check", "sim-tmcl", "--with", "trust_counter=no"]);
    assert_eq!(check["steps"][3]["verdict"], "note", "{check}");
}

#[test]
fn what_cannot_be_done_says_what_to_do() {
    let folder = Folder::new("devices-refuse");
    for (code, arguments, words) in [
        (1, &["read", "ofir"][..], "nearest: ophir:PORT"),
        (1, &["read", "ophir"], "expected ophir:PORT (such as ophir:/dev/ttyUSB0)"),
        (1, &["read", "ophir:/dev/no-such-port"], "check cable and power"),
        (1, &["read", "ophir:/dev/null"], "it is no serial port"),
        (1, &["check", "indi-camera:127.0.0.1:1/X"], "start the server, or check the port"),
        (1, &["check", "sim-tmcl", "--with", "gaer=3"], "nearest: gear"),
        (1, &["check", "sim-tmcl", "--timeout-s", "0"], "--timeout-s: found 0"),
        (1, &["move", "sim-ophir", "3"], "a power meter does not move"),
        (1, &["move", "sim-tmcl", "left"], "an angle in degrees, `home` or `stop`"),
        (1, &["set", "sim-pm100", "colour=3"], "one of wavelength_nm, range, zero, averaging"),
        (2, &["set", "sim-pm100", "range"], "expected NAME=VALUE"),
        (2, &["record", "sim-efw", "-o", "x.rec", "--", "turn", "3"], "check, read, set, move"),
        (1, &["replay", "no-such.rec"], "no-such.rec"),
        (2, &["move", "sim-tmcl"], "TARGET"),
    ] {
        let message = folder.refused(code, &[&["devices"], arguments].concat());
        assert!(message.contains(words), "{arguments:?}: {message}");
    }
    assert!(!folder.path("x.rec").exists());
    // A recording is not overwritten, and nothing is said to the device then.
    folder.done(&["devices", "record", "sim-wheel", "-o", "w.rec", "-q", "--", "read"]);
    let before = std::fs::read(folder.path("w.rec")).unwrap();
    let message = folder.refused(1, &["devices", "read", "sim-wheel", "--record", "w.rec"]);
    assert!(message.contains("w.rec"), "{message}");
    assert_eq!(std::fs::read(folder.path("w.rec")).unwrap(), before);
    assert!(folder.done(&["devices", "udev"]).contains("TAG+=\"uaccess\""));
    assert!(folder.done(&["devices", "list"]).contains("sim-tmcl"));
    assert!(folder.done(&["devices", "list", "--drivers"]).contains("--with gear=1"));
}

/// Truth: the recordings of our own commands, made by an earlier build: every driver still says the same bytes.
#[test]
fn recordings_of_our_commands_replay_to_the_last_byte() {
    let folder = Folder::new("devices-replay");
    let all = fixtures("devices");
    assert!(all.len() >= 11, "{all:?}");
    for file in &all {
        let (replay, _) = document(&folder, 0, &["devices", "replay", file.to_str().unwrap()]);
        assert_eq!(replay["agrees"], true, "{}", file.display());
        let fails = ["refused", "limit"].iter().any(|end| file.to_string_lossy().contains(end));
        assert_eq!(replay["ended"].is_string(), fails, "{replay}");
    }
    // One byte of the host's changed: the line and both sides are shown.
    let text = std::fs::read_to_string(&all[0]).unwrap();
    let host = text.lines().find(|line| line.starts_with("> [feature-set]")).unwrap();
    let changed = host.replacen(" 5a ", " 5b ", 1);
    assert_ne!(changed, host);
    std::fs::write(folder.path("changed.rec"), text.replacen(host, &changed, 1)).unwrap();
    let (replay, message) = document(&folder, 1, &["devices", "replay", "changed.rec"]);
    assert_eq!(replay["agrees"], false);
    assert!(message.contains("changed.rec:") && message.contains("the host asks `>"), "{message}");
}

/// Truth: the ends that `drivers/tests/common` has for these conversations. Those that fail while the device is opened end so
/// under the self-test too; all others were made by another host, and the first line that differs is shown.
#[test]
fn recordings_of_other_hosts_are_held_against_ours() {
    let folder = Folder::new("devices-fixtures");
    let ends = [
        ("tmcl/silence", "no answer within 0.300 s"),
        ("tmcl/status_3_type", "the module has no such parameter (code 3)"),
        ("tmcl/wrong_checksum", "no answer within 0.300 s"),
        ("ophir/no_head", "no head: plug one in"),
        ("pm100/no_sensor", "no sensor: plug one in"),
        ("pm100/wrong_tag_always", "a message with tag 3"),
        ("efw/silence", "no answer within 1.000 s"),
        ("efw/spoilt", "expected 16 bytes that begin with"),
    ];
    let mut agreed = 0;
    for (driver, part) in ["tmcl", "ophir", "pm100", "efw"]
        .map(|name| (name, ""))
        .into_iter()
        .chain([("indi-camera", "camera"), ("indi-rotator", "rotator"), ("indi-wheel", "wheel")])
    {
        let kind = if part.is_empty() { driver } else { "indi" };
        for file in fixtures(kind) {
            let name = file.file_stem().unwrap().to_str().unwrap();
            if !name.starts_with(part) {
                continue;
            }
            let output = folder.run(&[
                "devices",
                "replay",
                file.to_str().unwrap(),
                "--driver",
                driver,
                "--json",
            ]);
            let replay: Value = serde_json::from_slice(&output.stdout).unwrap();
            let case = format!("{kind}/{name}");
            match ends.iter().find(|(known, _)| *known == case) {
                Some((_, end)) => {
                    assert_eq!(
                        (&replay["agrees"], output.status.code()),
                        (&Value::Bool(true), Some(0)),
                        "{case}"
                    );
                    assert!(replay["ended"].as_str().unwrap().contains(end), "{case}: {replay}");
                    agreed += 1;
                }
                None => {
                    assert_eq!(
                        (&replay["agrees"], output.status.code()),
                        (&Value::Bool(false), Some(1)),
                        "{case}"
                    );
                    let mismatch = replay["mismatch"].as_str().unwrap();
                    assert!(mismatch.contains(&format!("{name}.rec:")), "{case}: {mismatch}");
                    // It was opened: another host's next question differs from ours.
                    assert!(
                        case.contains("good_not_cleared")
                            || replay["result"]["steps"][0]["verdict"] == "ok",
                        "{case}: {replay}"
                    );
                }
            }
        }
    }
    assert_eq!(agreed, ends.len());
}

/// Ctrl-C in the middle of a move: the motor is stopped, and where it stands is said. Truth: at 10,000 of 51,200 microsteps
/// a turn each second, 300° take 4.3 s; the recording shows the stop (TMCL command 3).
#[cfg(unix)]
#[test]
fn ctrl_c_stops_the_motor_and_says_where_it_stands() {
    let folder = Folder::new("devices-cancel");
    let child = Command::new(crate::common::program())
        .args(["devices", "move", "sim-tmcl", "10", "300", "--json", "--record", "m.rec"])
        .current_dir(&folder.0)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let recorded = || std::fs::read_to_string(folder.path("m.rec")).unwrap_or_default();
    let begun = Instant::now();
    // 300° is counter 42667, a6ab in hexadecimal.
    while !recorded().contains("> 01 04 00 00 00 00 a6 ab") {
        assert!(begun.elapsed() < PATIENCE, "{}", recorded());
        thread::sleep(Duration::from_millis(10));
    }
    let killed = Command::new("sh").args(["-c", &format!("kill -INT {}", child.id())]).status();
    assert!(killed.unwrap().success());
    let output = child.wait_with_output().unwrap();
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{message}");
    let moved: Value = serde_json::from_slice(&output.stdout).unwrap();
    let at = moved["at"]["angle_deg"].as_f64().unwrap();
    assert!((9.99..300.0).contains(&at), "{at}");
    assert_eq!(moved["moves"].as_array().unwrap().len(), 1, "{moved}");
    assert!(message.contains("was cancelled; it stands at"), "{message}");
    assert!(recorded().contains("> 01 03 00 00 00 00 00 00 04"), "it was stopped");
}

/// The real drivers on real lines: a pty and TCP, at the other end of which our simulated devices serve.
#[test]
fn real_drivers_reach_devices_through_a_pty_and_tcp() {
    let folder = Folder::new("devices-lines");
    // The two ends of a pty; the host's is opened by its path.
    let (device, host) = TTYPort::pair().unwrap();
    let port = host.name().unwrap();
    drop(host);
    thread::spawn(move || {
        let mut line = Serial::from_port(Box::new(device));
        let mut module = Module::new(ModuleSettings::default());
        // Before the program opens the pty, and after it, the module has no host.
        while let Ok(after) = serve(module, &mut line, &Deadline::within(PATIENCE)) {
            module = after;
            thread::sleep(Duration::from_millis(5));
        }
    });
    let address = format!("tmcl:{port}");
    let trust = ["--with", "trust_counter=yes"];
    let moved = document(
        &folder,
        0,
        &[&["devices", "move", &address, "20"][..], &trust, &["--record", "tmcl.rec"]].concat(),
    )
    .0;
    assert_eq!(
        (&moved["simulated"], &moved["device"]["model"]),
        (&Value::Bool(false), &Value::from("TMCM-1110"))
    );
    assert!((moved["at"]["angle_deg"].as_f64().unwrap() - 20.0).abs() < 0.01);
    assert_eq!(
        document(&folder, 0, &["devices", "replay", "tmcl.rec"]).0["result"]["at"],
        moved["at"]
    );

    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("ophir:tcp:{}", listener.local_addr().unwrap());
    thread::spawn(move || {
        for stream in listener.incoming() {
            let mut line = Tcp::from_stream(stream.unwrap()).unwrap();
            let meter = Ophir::new(Default::default(), Steady(1.25e-3));
            let _ = serve(meter, &mut line, &Deadline::within(PATIENCE));
        }
    });
    let read = document(&folder, 0, &["devices", "read", &address]).0;
    assert_eq!(read["readings"][0]["power_w"], 1.25e-3);

    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let host = listener.local_addr().unwrap().to_string();
    thread::spawn(move || {
        for stream in listener.incoming() {
            let mut line = Tcp::from_stream(stream.unwrap()).unwrap();
            let server = Server::new(ServerSettings::default(), Ramp);
            let _ = indi::serve(server, &mut line, &Deadline::within(PATIENCE));
        }
    });
    let listed = document(&folder, 0, &["devices", "list", "--indi", &host]).0;
    let devices = listed["indi"][0]["devices"].as_array().unwrap();
    let addresses: Vec<&str> =
        devices.iter().filter_map(|device| device["addresses"][0].as_str()).collect();
    assert_eq!(addresses.len(), 3, "{listed}");
    for address in addresses {
        let check = document(&folder, 0, &["devices", "check", address]).0;
        assert_eq!(check["error"], Value::Null, "{check}");
    }
}

/// Every command of the page on devices that names a simulated device, or none, runs, in the order of the page.
#[test]
fn the_commands_of_the_page_run() {
    let folder = Folder::new("devices-page");
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/devices.md");
    let page = std::fs::read_to_string(page).unwrap();
    let commands: Vec<&str> = page
        .lines()
        .filter(|line| {
            line.starts_with("sunglint ") && (line.contains("sim-") || line.contains(".rec"))
        })
        // They run until somebody ends them (`served.rs`).
        .filter(|line| !line.contains("devices serve"))
        .collect();
    assert!(commands.len() >= 8, "{commands:?}");
    for driver in DRIVERS {
        assert!(page.contains(&format!("`{}", driver.name)), "{} is not on the page", driver.name);
    }
    let program = crate::common::programs();
    let path = std::env::var("PATH").unwrap();
    for command in commands {
        let output = Command::new("sh")
            .args(["-e", "-c", command])
            .current_dir(&folder.0)
            .env("PATH", format!("{}:{path}", program.display()))
            .output()
            .unwrap();
        assert!(output.status.success(), "{command}: {}", String::from_utf8_lossy(&output.stderr));
    }
}
