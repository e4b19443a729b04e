//! A session's folder: what is promised of it after a power failure, on a full disk, on a bad one; what the check finds.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use ndarray::Array2;
use proptest::prelude::*;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use sunglint_formats::session::{
    ClockState, Device, DeviceKind, Disk, FORMAT, FileSum, Fragile, Manifest, Report, Session,
    SessionWriter, Storage, Target, TargetKind, What,
};
use sunglint_formats::time::parse_utc;
use sunglint_formats::{CountFlags, CountRecord, CountSeries, Frame, Meta, ecsv};
use sunglint_testkit::{peer_python, run_python};

const BIN_PS: i64 = 100_000_000_000;

fn start() -> hifitime::Epoch {
    parse_utc("2016-12-31T23:59:59Z").unwrap()
}

fn later(s: f64) -> hifitime::Epoch {
    start() + hifitime::Duration::from_seconds(s)
}

fn device(name: &str, kind: DeviceKind) -> Device {
    let channels = if kind == DeviceKind::Counter { vec!["g".into(), "r".into()] } else { vec![] };
    Device {
        name: name.into(),
        kind,
        address: "sim".into(),
        options: vec![],
        channels,
        inputs: vec![],
        raw_tags: false,
        exposure_s: 0.1,
        interval_s: None,
        filter: None,
    }
}

fn manifest() -> Manifest {
    Manifest {
        format: FORMAT.into(),
        program: "a test".into(),
        station: "ufo".into(),
        start_utc: start(),
        clock: ClockState {
            method: "none".into(),
            synchronised: None,
            offset_s: None,
            error_s: None,
        },
        devices: vec![device("tagger", DeviceKind::Counter), device("cam", DeviceKind::Camera)],
        files: vec![FileSum::of("night.toml", b"station = \"ufo\"\n")],
    }
}

fn writer(storage: &Arc<dyn Storage>, root: &Path) -> SessionWriter {
    let files = [("night.toml".to_owned(), b"station = \"ufo\"\n".to_vec())];
    SessionWriter::create(storage.clone(), root, &manifest(), &files).unwrap()
}

/// A session of the counter alone.
fn counter_alone(storage: &Arc<dyn Storage>, root: &Path) -> SessionWriter {
    let mut manifest = manifest();
    manifest.devices.truncate(1);
    let files = [("night.toml".to_owned(), b"station = \"ufo\"\n".to_vec())];
    SessionWriter::create(storage.clone(), root, &manifest, &files).unwrap()
}

/// The bin of that number.
fn bin(i: u64) -> CountRecord {
    CountRecord {
        start: later(i as f64 * 0.1),
        start_ps: i as i64 * BIN_PS,
        length_ps: BIN_PS,
        counts: vec![i, 2 * i],
        missed: vec![0, i % 3],
        flags: if i.is_multiple_of(7) { CountFlags::OVERFLOW } else { CountFlags::empty() },
    }
}

fn frame(i: u64) -> Frame {
    Frame {
        pixels: Array2::from_shape_fn((8, 6), |(y, x)| (i * 48 + y as u64 * 6 + x as u64) as u16),
        origin: [2, 4],
        binning: [1, 1],
        bayer: None,
        start: later(i as f64),
        exposure_s: 0.5,
        gain_e_per_adu: Some(0.3),
        temperature_c: Some(-10.0),
        saturation_adu: Some(65535.0),
        header: sunglint_formats::fits::Header::default(),
    }
}

fn rows(session: &Session) -> Vec<CountRecord> {
    session.counts("tagger").unwrap().collect::<Result<_, _>>().unwrap()
}

fn frames(session: &Session) -> Vec<(u64, Frame)> {
    let files = session.frames("cam").unwrap().files;
    files.iter().map(|file| (file.sequence, file.read().unwrap())).collect()
}

fn missing(report: &Report) -> Vec<String> {
    report
        .findings
        .iter()
        .filter(|f| f.severity == sunglint_formats::session::Severity::Missing)
        .map(|f| format!("{}: {}", f.file, f.text))
        .collect()
}

/// Data that a test has given to a writer.
struct Night {
    writer: SessionWriter,
    now: Duration,
    bins: u64,
    frames: u64,
}

impl Night {
    fn new(storage: &Arc<dyn Storage>, root: &Path) -> Self {
        Self { writer: writer(storage, root), now: Duration::ZERO, bins: 0, frames: 0 }
    }

    /// A tenth of a second: a bin, each half second a frame.
    fn step(&mut self) {
        let utc = later(self.now.as_secs_f64());
        self.writer.count("tagger", &bin(self.bins)).unwrap();
        self.bins += 1;
        if self.bins.is_multiple_of(5) {
            self.frames += 1;
            let _ = self.writer.frame("cam", self.frames, &frame(self.frames)).unwrap();
        }
        self.now += Duration::from_millis(100);
        self.writer.tick(self.now, utc);
    }
}

/// Random numbers from 0 to 1 without a library: a linear congruence (Knuth's MMIX).
fn draws(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    move || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Truth: the test's own list of what it gave to the writer more than half a second (5 steps) before the power failed; the rule
/// of POSIX that what was not synced may be lost in any part. Exact.
#[test]
fn a_power_failure_takes_less_than_the_last_second() {
    for seed in 0..150 {
        let mut draw = draws(seed);
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("night");
        let disk = Fragile::new();
        let storage: Arc<dyn Storage> = Arc::new(disk.clone());
        let mut night = Night::new(&storage, &root);
        let steps = (draw() * 60.0) as u64;
        for i in 0..steps {
            // A third of the nights meet a disk that fails now and then.
            if seed % 3 == 0 && i % 13 == 5 {
                disk.fail_syncs(1);
            }
            night.step();
        }
        disk.fail_syncs(0);
        drop(night);
        disk.power_loss(&mut draw).unwrap();
        let session = Session::open(&root).unwrap();
        let report = session.check().unwrap();
        for text in missing(&report) {
            let expected = ["did not end", "was cut off", "found"];
            assert!(expected.iter().any(|known| text.contains(known)), "seed {seed}: {text}");
            assert!(!text.contains("CRC") && !text.contains("were safe"), "seed {seed}: {text}");
        }
        // A failed sync is made good by the next, half a second on.
        let age = if seed % 3 == 0 { 10 } else { 5 };
        let safe = steps.saturating_sub(age + 1);
        let read: Vec<CountRecord> =
            session.counts("tagger").unwrap().map_while(Result::ok).collect();
        // Behind the last mark zeros may stand, which spoil the thousand rows that are parsed with them.
        let report = &report.counters[0];
        assert!(report.marked_rows >= safe, "seed {seed}: {} of {safe}", report.marked_rows);
        assert!(report.rows >= report.marked_rows, "seed {seed}: {report:?}");
        for (i, record) in read.iter().enumerate() {
            assert_eq!(*record, bin(i as u64), "seed {seed}");
        }
        let frames = frames(&session);
        assert!(frames.len() as u64 >= safe / 5, "seed {seed}: {} of {}", frames.len(), safe / 5);
        for (i, (sequence, found)) in frames.iter().enumerate() {
            assert_eq!(*sequence, i as u64 + 1, "seed {seed}");
            assert_eq!(found.pixels, frame(*sequence).pixels);
        }
    }
}

/// Truth: the bins and frames that were given; a disk of so many bytes. What was written before it was full stays, the bins that
/// came meanwhile follow once there is room, the frames are lost and counted. Exact.
#[test]
fn a_full_disk_loses_nothing_that_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("night");
    let disk = Fragile::new();
    let storage: Arc<dyn Storage> = Arc::new(disk.clone());
    let mut night = Night::new(&storage, &root);
    (0..20).for_each(|_| night.step());
    disk.set_room(Some(1000));
    (0..40).for_each(|_| night.step());
    let session = Session::open(&root).unwrap();
    let while_full = rows(&session);
    assert!(while_full.len() >= 20, "{}", while_full.len());
    assert!(night.writer.missing() > 0);
    disk.set_room(None);
    (0..20).for_each(|_| night.step());
    let (bins, taken) = (night.bins, night.frames);
    let ended = night.writer.finish(later(8.0), "done");
    let read = rows(&session);
    assert_eq!(read, (0..bins).map(bin).collect::<Vec<_>>());
    let frames = frames(&session);
    let lost = taken - frames.len() as u64;
    assert_eq!(ended.lost, lost);
    assert!((6..=10).contains(&lost), "{lost}");
    assert!(frames.iter().all(|(number, found)| found.pixels == frame(*number).pixels));
    let report = session.check().unwrap();
    assert!(report.ended && report.cameras[0].missing_frames == lost, "{report:?}");
    let found = missing(&report);
    assert!(found.iter().any(|text| text.contains("frames are missing")), "{found:?}");
    let said = session.events().unwrap().map(Result::unwrap).filter(
        |event| matches!(&event.what, What::Error { error, .. } if error.contains("No space left")),
    );
    assert!(said.count() >= 1, "the log says that the disk was full");
}

/// Truth: a disk of each number of bytes from none to all that a new session writes, where a full disk stands for a kill at that byte: the manifest
/// is there whole, and then all that it names, or not at all.
#[test]
fn a_session_that_cannot_be_begun_has_no_manifest() {
    let folder = tempfile::tempdir().unwrap();
    let configuration = [("station/station.toml".to_owned(), b"name = \"ufo\"\n".to_vec())];
    let (mut absent, mut present) = (0, 0);
    for room in 0.. {
        let root = folder.path().join(room.to_string());
        let disk = Fragile::new();
        disk.set_room(Some(room));
        let made = SessionWriter::create(Arc::new(disk), &root, &manifest(), &configuration);
        if root.join("session.toml").exists() {
            present += 1;
            let session = Session::open(&root).unwrap();
            assert_eq!((session.manifest(), rows(&session).len()), (&manifest(), 0));
            assert!(frames(&session).is_empty() && !session.check().unwrap().ended);
        } else {
            absent += 1;
            assert!(made.is_err());
        }
        if made.is_ok() {
            break;
        }
    }
    assert!(absent > 500 && present > 100, "{absent} {present}");
}

/// Truth: a tmpfs of 1 MiB, which the kernel refuses to fill beyond; needs root. What was written stays readable, and the error says
/// what is the matter.
#[test]
#[cfg(target_os = "linux")]
fn a_small_tmpfs_runs_full() {
    let test = "a_small_tmpfs_runs_full";
    let folder = tempfile::tempdir().unwrap();
    let mount = |arguments: &[&str]| {
        std::process::Command::new(arguments[0])
            .args(&arguments[1..])
            .arg(folder.path())
            .output()
            .is_ok_and(|output| output.status.success())
    };
    if !mount(&["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs"]) {
        sunglint_testkit::skip(test, "a tmpfs can only be mounted by root");
        return;
    }
    let result = std::panic::catch_unwind(|| {
        let root = folder.path().join("night");
        let storage: Arc<dyn Storage> = Arc::new(Disk);
        let mut writer = writer(&storage, &root);
        let big = Frame { pixels: Array2::from_elem((200, 200), 7), ..frame(1) };
        let (mut now, mut troubles) = (Duration::ZERO, Vec::new());
        for i in 0..100 {
            writer.count("tagger", &bin(i)).unwrap();
            let frame = Frame { start: later(i as f64), ..big.clone() };
            troubles.extend(writer.frame("cam", i + 1, &frame).unwrap());
            now += Duration::from_millis(100);
            troubles.extend(writer.tick(now, later(i as f64)));
        }
        let ended = writer.finish(later(100.0), "done");
        assert!(troubles.iter().any(|t| t.error.to_string().contains("No space left")));
        let session = Session::open(&root).unwrap();
        let (rows, frames) = (rows(&session), frames(&session));
        assert!(
            (8..=12).contains(&frames.len()),
            "1 MiB holds 12 frames of 86400 bytes: {}",
            frames.len()
        );
        assert!(frames.iter().all(|(_, frame)| frame.pixels == big.pixels));
        assert_eq!(rows, (0..rows.len() as u64).map(bin).collect::<Vec<_>>());
        assert!(ended.lost >= 100 - frames.len() as u64);
        assert!(!session.check().unwrap().is_whole());
    });
    assert!(mount(&["umount"]), "the test's tmpfs could not be taken away");
    if let Err(panic) = result {
        std::panic::resume_unwind(panic);
    }
}

fn whole_night(root: &Path) {
    let storage: Arc<dyn Storage> = Arc::new(Fragile::new());
    let mut night = Night::new(&storage, root);
    night.writer.event(later(0.0), What::Target(Target::off(TargetKind::Sky)));
    (0..50).for_each(|_| night.step());
    assert_eq!(night.writer.finish(later(5.0), "done").lost, 0);
}

/// Truth: damage that the test does to a whole session: each kind is found, and nothing else.
#[test]
fn the_check_names_what_is_missing() {
    type Damage = fn(&Path);
    fn change(path: &Path, change: impl FnOnce(&mut Vec<u8>)) {
        let mut bytes = std::fs::read(path).unwrap();
        change(&mut bytes);
        std::fs::write(path, bytes).unwrap();
    }
    fn a_frame(root: &Path, number: usize) -> std::path::PathBuf {
        Session::open(root).unwrap().frames("cam").unwrap().files[number - 1].path.clone()
    }
    let damages: [(&str, Damage); 8] = [
        ("", |_| {}),
        ("counts/tagger.ecsv: its last row was cut off: 10 bytes", |root| {
            change(&root.join("counts/tagger.ecsv"), |bytes| bytes.extend(b"2016-12-31"));
        }),
        ("bytes, of", |root| {
            change(&root.join("counts/tagger.ecsv"), |bytes| bytes.truncate(bytes.len() - 100));
        }),
        ("are not what was written (CRC-32 of the mark at", |root| {
            change(&root.join("counts/tagger.ecsv"), |bytes| {
                let last = bytes.len() - 2;
                bytes[last] ^= 1;
            });
        }),
        ("frames/cam: frame 3 is missing", |root| {
            std::fs::remove_file(a_frame(root, 3)).unwrap();
        }),
        ("are not what was written", |root| {
            change(&a_frame(root, 4), |bytes| bytes[2900] ^= 1);
        }),
        ("night.toml: its SHA-256 is not the one in session.toml", |root| {
            change(&root.join("night.toml"), |bytes| bytes[0] = b'S');
        }),
        ("events.jsonl: the session did not end in good order", |root| {
            change(&root.join("events.jsonl"), |bytes| {
                let end = bytes.windows(12).position(|w| w == b"\"kind\":\"end\"").unwrap();
                let line = bytes[..end].iter().rposition(|&b| b == b'\n').unwrap();
                bytes.truncate(line + 1);
            });
        }),
    ];
    for (expected, damage) in damages {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("night");
        whole_night(&root);
        damage(&root);
        let report = Session::open(&root).unwrap().check().unwrap();
        let found = missing(&report);
        assert_eq!(report.is_whole(), expected.is_empty(), "{expected}: {found:?}");
        assert!(expected.is_empty() || found.iter().any(|f| f.contains(expected)), "{found:?}");
    }
}

/// Truth: the byte that was changed. Half of the changes fall on a byte of all bytes, half on a file of all files: small files count as much as frames.
#[test]
fn a_changed_byte_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("night");
    whole_night(&root);
    assert!(Session::open(&root).unwrap().check().unwrap().is_whole());
    let mut files = Vec::new();
    let mut open = vec![root.clone()];
    while let Some(folder) = open.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => open.push(path),
                false => files.push((path.clone(), std::fs::read(&path).unwrap())),
            }
        }
    }
    files.sort();
    let all: usize = files.iter().map(|(_, bytes)| bytes.len()).sum();
    let mut draw = draws(7);
    let mut below = |n: usize| ((draw() * n as f64) as usize).min(n - 1);
    let mut unfound = Vec::new();
    for i in 0..1000 {
        let (file, at) = if i % 2 == 0 {
            let mut at = below(all);
            let file = files.iter().position(|(_, bytes)| {
                let here = at < bytes.len();
                at -= if here { 0 } else { bytes.len() };
                here
            });
            (file.unwrap(), at)
        } else {
            let file = below(files.len());
            (file, below(files[file].1.len()))
        };
        let (path, bytes) = &files[file];
        let mut changed = bytes.clone();
        changed[at] ^= 1 << below(8);
        std::fs::write(path, &changed).unwrap();
        let found = match Session::open(&root) {
            Ok(session) => session.check().map_or(true, |report| !report.is_whole()),
            Err(_) => true,
        };
        if !found {
            unfound.push((path.clone(), at));
        }
        std::fs::write(path, bytes).unwrap();
    }
    // Of a thousand one may slip through; none does.
    assert!(unfound.is_empty(), "{unfound:?}");
    assert!(Session::open(&root).unwrap().check().unwrap().is_whole());
}

/// A session of the former format is read, and the check says what it cannot find.
#[test]
fn the_former_format_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("night");
    whole_night(&root);
    let path = root.join("session.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replace("sunglint session 2", "sunglint session 1")).unwrap();
    let report = Session::open(&root).unwrap().check().unwrap();
    assert!(missing(&report).iter().any(|t| t.contains("SHA-256")), "{report:?}");
    // As the program of that time wrote it: no sum in the log, no mark of its end.
    let log = root.join("events.jsonl");
    let events = std::fs::read_to_string(&log).unwrap();
    let without = |line: &str| match line.split_once(",\"manifest_sha256\"") {
        Some((start, _)) => format!("{start}}}"),
        None => line.to_owned(),
    };
    let lines: Vec<String> =
        events.lines().filter(|l| !l.contains("\"sync\"")).map(without).collect();
    std::fs::write(&log, lines.join("\n") + "\n").unwrap();
    std::fs::remove_file(root.join("events.end")).unwrap();
    let report = Session::open(&root).unwrap().check().unwrap();
    assert!(report.is_whole(), "{:?}", report.findings);
    assert!(report.findings.iter().any(|f| f.text.contains("format 1")), "{:?}", report.findings);
    std::fs::write(&path, text.replace("sunglint session 2", "sunglint session 3")).unwrap();
    let error = Session::open(&root).unwrap_err().to_string();
    assert!(error.contains("later version"), "{error}");
}

/// A device that was planned and recorded nothing is missing from a night that ended in good order.
#[test]
fn a_device_without_data_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("night");
    let storage: Arc<dyn Storage> = Arc::new(Disk);
    let writer = writer(&storage, &root);
    assert_eq!(writer.finish(later(1.0), "done").lost, 0);
    let report = Session::open(&root).unwrap().check().unwrap();
    let said = missing(&report).join("; ");
    assert!(said.contains("recorded no frame") && said.contains("recorded no bin"), "{said}");
}

/// Truth: a bin left out and one written twice, in the counter's own time; with its own flag a gap is none of the disk's.
#[test]
fn gaps_and_doubled_bins_are_told_apart() {
    for (bins, flag, expected) in [
        (vec![0, 1, 3], CountFlags::empty(), "0.100000 s lacks before the bin at"),
        (vec![0, 1, 1, 2], CountFlags::empty(), "0.100000 s is there twice from the bin at"),
        (vec![0, 1, 3], CountFlags::GAP, ""),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("night");
        let storage: Arc<dyn Storage> = Arc::new(Fragile::new());
        let mut writer = counter_alone(&storage, &root);
        for &i in &bins {
            let flags = if i == 3 { flag } else { CountFlags::empty() };
            writer.count("tagger", &CountRecord { flags, ..bin(i) }).unwrap();
        }
        writer.finish(later(1.0), "done");
        let report = Session::open(&root).unwrap().check().unwrap();
        let found = missing(&report);
        assert_eq!(found.is_empty(), expected.is_empty(), "{found:?}");
        assert!(expected.is_empty() || found[0].contains(expected), "{found:?}");
    }
}

/// Truth: 100,000 bins of about 40 bytes without a tick between them: none is lost.
#[test]
fn rows_that_come_faster_than_ticks_are_all_there() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("night");
    let storage: Arc<dyn Storage> = Arc::new(Fragile::new());
    let mut writer = counter_alone(&storage, &root);
    for i in 0..100_000 {
        writer.count("tagger", &bin(i)).unwrap();
    }
    assert_eq!(writer.finish(later(1e4), "done").lost, 0);
    let session = Session::open(&root).unwrap();
    let rows = session.counts("tagger").unwrap().map(Result::unwrap);
    assert!(rows.zip(0..).all(|(found, i)| found == bin(i)));
    assert_eq!(session.check().unwrap().counters[0].rows, 100_000);
    assert!(session.check().unwrap().is_whole());
}

/// Truth: the table that `CountSeries` writes whole, which astropy reads (tests/astropy.rs). Byte for byte.
#[test]
fn rows_are_those_of_the_whole_table() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("night");
    whole_night(&root);
    let text = std::fs::read_to_string(root.join("counts/tagger.ecsv")).unwrap();
    let mut meta = Meta::default();
    meta.insert("device".into(), "tagger".into());
    let series = CountSeries {
        channels: vec!["g".into(), "r".into()],
        records: (0..50).map(bin).collect(),
        meta,
    };
    assert_eq!(text, ecsv::to_string(&series.to_table().unwrap()).unwrap());
}

/// Truth: astropy's readers: the counts' column, the frames' pixels and headers, json's reader for the events. Exact.
#[test]
fn astropy_opens_all_of_it() {
    let Some(python) = peer_python("astropy_opens_all_of_it", &["astropy"]) else { return };
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("night");
    whole_night(&root);
    let script = "
import sys, json, glob, warnings, tomllib, zlib, os
import numpy as np
from astropy.io import fits
from astropy.table import Table
warnings.simplefilter('error')
root = sys.argv[1]
t = Table.read(f'{root}/counts/tagger.ecsv', format='ascii.ecsv')
assert len(t) == 50 and t.meta['kind'] == 'counts' and str(t['g_counts'].unit) == 'ct'
assert (np.asarray(t['r_counts']) == 2 * np.arange(50)).all()
paths = sorted(glob.glob(f'{root}/frames/cam/*/*.fits'), key=lambda p: p[-13:])
assert len(paths) == 10, paths
for i, path in enumerate(paths):
    with fits.open(path) as hdus:
        hdus.verify('exception')
        assert hdus[0].header['FRAMENO'] == i + 1 and hdus[0].header['EXPTIME'] == 0.5
        expected = ((i + 1) * 48 + np.arange(48)).astype('u2').reshape(8, 6)
        assert (hdus[0].data == expected).all()
manifest = tomllib.load(open(f'{root}/session.toml', 'rb'))
assert [d['name'] for d in manifest['device']] == ['tagger', 'cam']
marks = {}
for line in open(f'{root}/events.jsonl'):
    event = json.loads(line)
    if event['kind'] == 'sync':
        for mark in event['files']:
            data = open(f'{root}/' + mark['file'], 'rb').read()[:mark['bytes']]
            assert len(data) == mark['bytes'] and zlib.crc32(data) == mark['crc32'], mark
            marks[mark['file']] = mark
assert marks['counts/tagger.ecsv']['rows'] == 50
print('read')
";
    assert_eq!(run_python(&python, script, &[root.to_str().unwrap()]), "read\n");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, failure_persistence: None, ..Default::default() })]

    /// Truth: a table cut anywhere has the rows before the cut; bytes put anywhere end in an error or other rows, never a panic.
    #[test]
    fn a_cut_table_has_the_rows_before_the_cut(cut in 0_usize..3000, at in 0_usize..3000, byte in any::<u8>()) {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("night");
        whole_night(&root);
        let session = Session::open(&root).unwrap();
        let path = root.join("counts/tagger.ecsv");
        let text = std::fs::read(&path).unwrap();
        let cut = cut.min(text.len());
        std::fs::write(&path, &text[..cut]).unwrap();
        if let Ok(counts) = session.counts("tagger") {
            let read: Vec<_> = counts.collect::<Result<Vec<_>, _>>().unwrap();
            prop_assert_eq!(&read, &(0..read.len() as u64).map(bin).collect::<Vec<_>>());
            let lines = text[..cut].iter().filter(|&&b| b == b'\n').count();
            let header = text.iter().filter(|&&b| b == b'\n').count() - 50;
            prop_assert_eq!(read.len(), lines - header);
        } else {
            // Cut within the header.
            prop_assert!(!text[..cut].windows(10).any(|part| part == b"start_utc,") || cut < 1000);
        }
        let mut changed = text;
        let place = at.min(changed.len() - 1);
        changed[place] = byte;
        std::fs::write(&path, &changed).unwrap();
        let _ = session.check().unwrap();
        std::fs::write(root.join("events.jsonl"), &changed).unwrap();
        let _ = session.check().unwrap();
    }
}

fn bin_at(i: i64, gap_s: f64) -> CountRecord {
    CountRecord {
        start: later(0.1 * i as f64 + gap_s),
        start_ps: i * BIN_PS,
        length_ps: BIN_PS,
        counts: vec![i as u64, 1000 - i as u64],
        missed: vec![0, 0],
        flags: if i == 77 { CountFlags::OVERFLOW } else { CountFlags::empty() },
    }
}

/// Truth: the reader of whole tables, and sums by hand: 300 bins over a leap second, with a gap, in blocks that do not bridge it; any stretch is the same as
/// from the reader; a row that is none ends the index there; what is written later is found.
#[test]
fn an_index_finds_any_stretch() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("night");
    let files = [("night.toml".to_owned(), b"station = \"ufo\"\n".to_vec())];
    let mut writer = SessionWriter::create(Arc::new(Disk), &root, &manifest(), &files).unwrap();
    let all: Vec<CountRecord> =
        (0..300).map(|i| bin_at(i, if i < 150 { 0.0 } else { 7.0 })).collect();
    for record in &all[..200] {
        writer.count("tagger", record).unwrap();
    }
    writer.sync(later(20.0));
    let session = Session::open(&root).unwrap();
    let mut index = session.count_index("tagger").unwrap();
    assert_eq!((index.rows(), index.fault()), (200, None));
    for record in &all[200..] {
        writer.count("tagger", record).unwrap();
    }
    writer.event(later(30.0), What::Control { action: "note".into(), text: "clouds".into() });
    assert_eq!(writer.finish(later(40.0), "done").lost, 0);
    index.refresh().unwrap();
    assert_eq!((index.rows(), index.fault()), (300, None));
    assert_eq!(index.span(), Some([later(0.0), all[299].start + 0.1 * hifitime::Unit::Second]));
    let read: Vec<CountRecord> =
        session.counts("tagger").unwrap().collect::<Result<_, _>>().unwrap();
    assert_eq!(read, all);
    for (from, to) in
        [(-5.0, 100.0), (0.0, 0.1), (3.35, 9.0), (14.0, 23.0), (15.5, 21.0), (30.0, 20.0)]
    {
        let (from, to) = (later(from), later(to));
        let expected: Vec<&CountRecord> =
            all.iter().filter(|r| r.start >= from && r.start < to).collect();
        let found = index.records(from, to, 1000).unwrap();
        assert_eq!(found.iter().collect::<Vec<_>>(), expected, "{from} {to}");
    }
    assert_eq!(index.records(later(0.0), later(100.0), 7).unwrap(), all[..7]);
    let sum: u64 = index.blocks().iter().map(|block| block.counts[0]).sum();
    assert_eq!(sum, 299 * 300 / 2);
    let block = index.blocks().iter().find(|b| b.flags.contains(CountFlags::OVERFLOW)).unwrap();
    assert!(block.start <= all[77].start && block.end > all[77].start);
    let first = &index.blocks()[0];
    let rates = [0.0, 10.0 * (first.rows - 1) as f64];
    assert!((first.range_hz[0][1] - rates[1]).abs() < 1e-6 && first.range_hz[0][0] == rates[0]);
    assert!(index.blocks().iter().all(|b| b.end <= all[150].start || b.start >= all[150].start));
    // The log without its marks.
    let (mut marks, mut rest) = (0, Vec::new());
    for event in session.events().unwrap() {
        match event.unwrap().what {
            What::Sync { .. } => marks += 1,
            what => rest.push(what),
        }
    }
    let without: Vec<What> =
        session.events().unwrap().without_marks().map(|event| event.unwrap().what).collect();
    assert!(marks > 0 && without == rest && rest.iter().any(|w| matches!(w, What::Control { .. })));
    // A broken row, and half a last one.
    let path = root.join("counts/tagger.ecsv");
    let text = std::fs::read_to_string(&path).unwrap();
    let mut lines: Vec<&str> = text.lines().collect();
    let at = lines.len() - 100;
    lines[at] = "2016-12-31T24:61:00Z,1,2,x";
    std::fs::write(&path, lines.join("\n")).unwrap();
    let broken = session.count_index("tagger").unwrap();
    assert_eq!(broken.rows(), 200);
    assert!(broken.fault().unwrap().starts_with("row 201"), "{:?}", broken.fault());
    std::fs::write(&path, text.trim_end()).unwrap();
    assert_eq!(session.count_index("tagger").unwrap().rows(), 299);
    std::fs::write(&path, text.replace("start_utc,start_ps", "start_ps,start_utc")).unwrap();
    assert!(session.count_index("tagger").is_err());
}

/// Truth: the names that the writer gives.
#[test]
fn frames_names_tell_when() {
    let file = |name: &str| sunglint_formats::session::FrameFile {
        sequence: 1,
        path: Path::new("17").join(name),
    };
    assert_eq!(file("20161231T235960.500000Z_00000001.fits").start(), Some(later(1.5)));
    for bad in ["x.fits", "2016_1.fits", "20161232T000000.0Z_1.fits", "é20161231T235960Z_1.fits"] {
        assert_eq!(file(bad).start(), None, "{bad}");
    }
}

/// Truth: by hand: of six frames the last two are left out, after the last file; a message that comes three times, with other numbers, is one note with their count, another one is itself.
#[test]
fn frames_after_the_last_file_are_missing() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("night");
    let storage: Arc<dyn Storage> = Arc::new(Disk);
    let mut writer = writer(&storage, &root);
    for number in 1..=4 {
        assert!(writer.frame("cam", number, &frame(number)).unwrap().is_none());
    }
    (5..=6).for_each(|number| writer.lose_frame("cam", number));
    for (about, error) in [
        ("tags of tagger", "left out: 0.3 MB are free"),
        ("tags of tagger", "left out: 12.5 MB are free"),
        ("cam", "it is warm"),
        ("tags of tagger", "left out: 7 MB are free"),
    ] {
        let (about, error) = (about.to_owned(), error.to_owned());
        writer.event(later(1.0), What::Error { about, error });
    }
    writer.finish(later(2.0), "done");
    let report = Session::open(&root).unwrap().check().unwrap();
    assert_eq!((report.cameras[0].frames, report.cameras[0].missing_frames), (4, 2));
    let found = missing(&report);
    let last = "the last 2 frames are missing: 5 to 6";
    assert!(found.iter().any(|text| text.contains(last)), "{found:?}");
    let said = |about: &str| {
        let own = report.findings.iter().filter(|finding| finding.file == about);
        own.map(|finding| finding.text.clone()).collect::<Vec<_>>()
    };
    assert_eq!(said("tags of tagger"), ["said 3 times, at first: left out: 0.3 MB are free"]);
    assert_eq!(said("cam"), ["said: it is warm"]);
}
