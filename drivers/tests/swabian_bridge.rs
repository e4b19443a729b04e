//! The bridge itself, as a child process. With a stand-in of ours for the maker's package these tests show that the
//! plumbing holds, and say nothing about a real Time Tagger; with the maker's package (where it is installed) they show
//! what a user meets who has plugged in nothing.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::swabian::{BIN_PS, settings};
use crate::common::within;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;
use sunglint_drivers::device::{Device as _, PhotonCounter as _, TagSink};
use sunglint_drivers::swabian::{
    BRIDGE, Source, TaggerSettings, TimeTagger, convert, spawn, spawn_with,
};
use sunglint_drivers::tags::{TagFile, TagWriter};
use sunglint_drivers::transport::child::Child;
use sunglint_formats::CountFlags;
use sunglint_testkit::{peer_python, repository, skip};

const STAND_IN: &str = "standin_tagger";

fn folder() -> String {
    repository().join("drivers/tests/standin").to_str().unwrap().to_owned()
}

fn stand_in(python: &Path) -> Child {
    spawn_with(python, &["--module", STAND_IN, "--path", &folder()]).unwrap()
}

/// The same with an environment of its own.
fn stand_in_with(python: &Path, variable: &str, value: &str) -> Child {
    let mut command = Command::new(python);
    command.args(["-B", "-c", BRIDGE, "--module", STAND_IN, "--path", &folder()]);
    Child::spawn(command.env(variable, value)).unwrap()
}

/// Truth: what the stand-in counts, by its own words: 1000 · channel + the number of the bin.
#[test]
fn bins_pass_the_bridge_once_with_all_that_was_missed() {
    let name = "bins_pass_the_bridge_once_with_all_that_was_missed";
    let Some(python) = peer_python(name, &["numpy"]) else { return };
    let mut tagger = TimeTagger::open(stand_in(&python), settings(), &within(60.0)).unwrap();
    let identity = tagger.identity(&within(5.0)).unwrap();
    assert_eq!(identity.model, "Time Tagger Stand-in");
    assert_eq!(identity.firmware.as_deref(), Some("fw 0, library 0.0-standin"));
    assert_eq!(tagger.set_trigger_level_v(1, 0.1234, &within(5.0)).unwrap(), 0.123);
    assert_eq!(tagger.set_input_delay_ps(1, -77, &within(5.0)).unwrap(), -77);
    assert_eq!(tagger.set_dead_time_ps(0, 5, &within(5.0)).unwrap(), 2_100);
    let error = tagger.set_trigger_level_v(0, 3.0, &within(5.0)).unwrap_err().to_string();
    assert!(error.contains("Trigger level 3.0 V is out of range for channel 1"), "{error}");
    assert!(tagger.set_test_signal(2, true, &within(5.0)).unwrap());
    tagger.start(BIN_PS / 10, &within(5.0)).unwrap();
    let mut records = tagger.read(4, &within(20.0)).unwrap();
    // Questions in between, and a pause in which bins pile up.
    assert_eq!(tagger.settings(&within(5.0)).unwrap().len(), 6);
    std::thread::sleep(Duration::from_millis(100));
    records.extend(tagger.read(26, &within(20.0)).unwrap());
    for (n, record) in records.iter().enumerate() {
        let n = n as u64;
        assert_eq!(record.counts, [1000 + n, 2000 + n, 3000 + n]);
        assert_eq!(record.start_ps, records[0].start_ps + n as i64 * BIN_PS / 10);
        assert!(!record.flags.contains(CountFlags::GAP));
    }
    let overflows = records.iter().filter(|r| r.flags.contains(CountFlags::OVERFLOW)).count();
    assert!((1..=2).contains(&overflows) && records[3].flags.contains(CountFlags::OVERFLOW));
    let missed: u64 = records.iter().map(|record| record.missed[1]).sum();
    assert_eq!(missed, 77 + 5, "a late report is booked too");
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap();
    let late_s = now.as_secs_f64() - records[29].start.to_unix_seconds();
    assert!((0.0..5.0).contains(&late_s), "the last bin is {late_s} s old");
    tagger.stop(&within(5.0)).unwrap();
    tagger.close(&within(5.0)).unwrap();
}

/// Truth: the stand-in's tags, one a millisecond and channel; its files.
#[test]
fn tags_and_files_pass_the_bridge() {
    let Some(python) = peer_python("tags_and_files_pass_the_bridge", &["numpy"]) else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("raw.tags");
    let mut tagger = TimeTagger::open(stand_in(&python), settings(), &within(60.0)).unwrap();
    tagger.start_tags(&within(5.0)).unwrap();
    let mut writer = TagWriter::create(&path).unwrap();
    let time = Duration::from_millis(300);
    let summary = tagger.record(&mut writer, time, &within(20.0)).unwrap();
    writer.finish().unwrap();
    assert_eq!((summary.records, summary.unsorted), (summary.photons, 0));
    let report = TagFile::open(&path).unwrap().check(&Default::default()).unwrap();
    assert!(report.is_clean() && report.records == summary.records && report.records > 100);
    // A tag each millisecond on three channels: all times are there, three times each.
    let span_ms = (report.last_ps.unwrap() - report.first_ps.unwrap()) / 1_000_000_000 + 1;
    assert_eq!(report.records as i64, 3 * span_ms);
    assert_eq!(report.longest_gap.unwrap().length_ps(), 1_000_000_000);
    drop(tagger);

    let run = |kind: &str| {
        let file = folder.path().join(format!("{kind}.ttbin"));
        std::fs::write(&file, kind).unwrap();
        let path = folder.path().join(format!("{kind}.tags"));
        let mut writer = TagWriter::create(&path).unwrap();
        let converted = convert(stand_in(&python), &file, &mut writer, &within(60.0));
        converted.map_err(|interrupted| interrupted.error.to_string())
    };
    let summary = run("good").unwrap().summary;
    assert_eq!((summary.records, summary.photons, summary.missed), (100_000, 99_999, 9));
    let error = run("damaged").unwrap_err();
    assert!(error.contains("after 0 events: Incorrect Header"), "{error}");
    assert!(run("empty").unwrap_err().contains("holds no events; is it a whole .ttbin"));
}

/// Truth: the stand-in's tags, one a millisecond and channel: each bin of 10 ms that is made of them has ten of each, none is lost between.
#[test]
fn bins_of_a_stream_pass_the_bridge() {
    let Some(python) = peer_python("bins_of_a_stream_pass_the_bridge", &["numpy"]) else { return };
    let mut tagger = TimeTagger::open(stand_in(&python), settings(), &within(60.0)).unwrap();
    let sink = TagSink::new(|records| assert!(!records.is_empty()));
    tagger.start_with_tags(BIN_PS / 10, sink, &within(5.0)).unwrap();
    let records = tagger.read(30, &within(20.0)).unwrap();
    for (i, record) in records.iter().enumerate() {
        assert_eq!(record.start_ps, records[0].start_ps + i as i64 * BIN_PS / 10);
        assert_eq!((&record.counts[..], record.flags), (&[10; 3][..], CountFlags::CLOCK_FREE));
    }
    tagger.stop(&within(5.0)).unwrap();
}

/// Truth: the named errors; the stand-in says that it was freed when the host hangs up.
#[test]
fn the_bridge_fails_by_name_and_ends_with_its_host() {
    let name = "the_bridge_fails_by_name_and_ends_with_its_host";
    let Some(python) = peer_python(name, &["numpy"]) else { return };
    let open = |line: Child, source: Source| {
        TimeTagger::open(line, TaggerSettings { source, ..settings() }, &within(60.0))
    };
    let usb = |serial: &str| Source::Usb { serial: Some(serial.into()) };
    let error = open(stand_in(&python), usb("other")).unwrap_err().to_string();
    assert!(error.contains("No Time Tagger attached") && error.contains("plug it in"), "{error}");
    let address = "127.0.0.1:41101".to_owned();
    let error = open(stand_in(&python), Source::Network { address }).unwrap_err().to_string();
    assert!(error.contains("startServer"), "{error}");
    let error = open(stand_in(&python), usb("crash")).unwrap_err().to_string();
    assert!(
        error.contains("is gone") && error.contains("instance of 'TimeTaggerError'"),
        "{error}"
    );
    let line = spawn_with(&python, &["--module", "no_such_package"]).unwrap();
    let error = open(line, usb("")).unwrap_err().to_string();
    assert!(
        error.contains("No module named 'no_such_package'") && error.contains("pip install"),
        "{error}"
    );
    let line = stand_in_with(&python, "STANDIN", "statistics");
    let error = open(line, usb("")).unwrap_err().to_string();
    assert!(error.contains("usage statistics cannot be switched off"), "{error}");

    // Closing asks the bridge to free the device; it then ends by itself.
    let folder = tempfile::tempdir().unwrap();
    let freed = folder.path().join("freed");
    let line = stand_in_with(&python, "STANDIN_FREED", freed.to_str().unwrap());
    let tagger = TimeTagger::open(line, settings(), &within(60.0)).unwrap();
    tagger.close(&within(20.0)).unwrap();
    assert_eq!(std::fs::read_to_string(&freed).unwrap(), "freed");

    // So does the end of its input, as when its host crashes; damaged requests are told as such.
    std::fs::remove_file(&freed).unwrap();
    let output = Command::new("sh")
        .args([
            "-c",
            "printf 'what?\\n' | \"$0\" -B -c \"$1\" --module standin_tagger --path \"$2\"",
        ])
        .args([python.to_str().unwrap(), BRIDGE, &self::folder()])
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(said.contains("a request came damaged"), "{said}");
}

/// A Python with the maker's package: named by `SUNGLINT_SWABIAN_PYTHON`, or `.venv`.
fn makers_python(test: &str) -> Option<PathBuf> {
    let named = std::env::var_os("SUNGLINT_SWABIAN_PYTHON").map(PathBuf::from);
    let python = named.unwrap_or_else(|| repository().join(".venv/bin/python"));
    let tried = Command::new(&python).args(["-c", "import Swabian.TimeTagger"]).output();
    if tried.is_ok_and(|output| output.status.success()) {
        return Some(python);
    }
    skip(
        test,
        "no Python with Swabian-TimeTagger (its licence is not stated, CI does not install it)",
    );
    None
}

/// Truth: the maker's package (2.22.6 tried), without hardware: on a computer with a Time Tagger it would be opened.
#[test]
fn the_makers_package_without_hardware() {
    let Some(python) = makers_python("the_makers_package_without_hardware") else { return };
    let open = |source: Source| {
        let settings = TaggerSettings { source, ..settings() };
        TimeTagger::open(spawn(&python).unwrap(), settings, &within(60.0)).unwrap_err().to_string()
    };
    let error = open(Source::Usb { serial: None });
    assert!(error.contains("No Time Tagger attached or already in use"), "{error}");
    assert!(error.contains("plug it in, close other programs"), "{error}");
    let error = open(Source::Usb { serial: Some("2138000XYZ".into()) });
    assert!(error.contains("'2138000XYZ' is not a valid Time Tagger serial number"), "{error}");
    assert!(error.contains("plug it in, close other programs"), "{error}");
    // Nobody listens on the port of discarded bytes.
    let error = open(Source::Network { address: "127.0.0.1:9".into() });
    assert!(error.contains("Could not connect to Time Tagger server"), "{error}");
    assert!(error.contains("start its server"), "{error}");
    // A damaged file: the library opens it, logs `Incorrect Header`, and says that it has data.
    let folder = tempfile::tempdir().unwrap();
    let mut writer = TagWriter::create(folder.path().join("out.tags")).unwrap();
    let mut run = |file: &Path| {
        let line = spawn(&python).unwrap();
        convert(line, file, &mut writer, &within(60.0)).unwrap_err().error.to_string()
    };
    let zeros = folder.path().join("zeros.ttbin");
    std::fs::write(&zeros, [0; 4096]).unwrap();
    let error = run(&zeros);
    assert!(error.contains("after 0 events") && error.contains("Incorrect Header"), "{error}");
    let empty = folder.path().join("empty.ttbin");
    std::fs::write(&empty, []).unwrap();
    assert!(run(&empty).contains("is it a whole .ttbin file"));
    assert!(run(&folder.path().join("none.ttbin")).contains("is no file"));
}
