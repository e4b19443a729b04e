//! Raw tags of a night: beside bins of the same stream, killed, played back, refused.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

mod common;
#[path = "common/night.rs"]
mod night;

use common::Folder;
use night::{at, bins, plan_of};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};
use sunglint::observe::replayed;
use sunglint_drivers::clock::Cancel;
use sunglint_drivers::tags::{Tag, TagFile};
use sunglint_formats::CountRecord;
use sunglint_formats::session::{
    ClockState, Device, DeviceKind, Disk, FORMAT, Manifest, Session, SessionWriter,
};

fn tags(session: &Session) -> Vec<Tag> {
    let (file, _) = TagFile::recover(session.tags("tagger").unwrap().unwrap()).unwrap();
    let mut tags = Vec::new();
    file.for_each(0..file.len(), |some| {
        tags.extend(some.iter());
        Ok::<_, sunglint_formats::FileError>(())
    })
    .unwrap();
    tags
}

/// Tags of the bin on these inputs, by a filter.
fn counted(tags: &[Tag], bin: &CountRecord, inputs: &[i32]) -> Vec<u64> {
    let within = bin.start_ps..bin.start_ps + bin.length_ps;
    let of = |input: &i32| {
        tags.iter().filter(|t| t.channel == *input && within.contains(&t.time_ps)).count() as u64
    };
    inputs.iter().map(of).collect()
}

/// A night of so many seconds with 100 tags a second on inputs 1 and 3, in bins of 10 ms.
fn recorded(root: &Path, seconds: i64) -> Session {
    let clock =
        ClockState { method: "none".into(), synchronised: None, offset_s: None, error_s: None };
    let device = Device {
        name: "tagger".into(),
        kind: DeviceKind::Counter,
        address: "sim".into(),
        options: vec![],
        channels: vec!["g".into(), "r".into()],
        inputs: vec![1, 3],
        raw_tags: true,
        exposure_s: 0.01,
        interval_s: None,
        filter: None,
    };
    let manifest = Manifest {
        format: FORMAT.into(),
        program: "a test".into(),
        station: "ufo".into(),
        start_utc: at(0.0),
        clock,
        devices: vec![device],
        files: vec![],
    };
    let mut writer = SessionWriter::create(Arc::new(Disk), root, &manifest, &[]).unwrap();
    for i in 0..seconds * 100 {
        let start_ps = i * 10_000_000_000;
        let photons = [Tag::photon(1, start_ps), Tag::photon(3, start_ps + 9_999_999_999)];
        let bytes: Vec<u8> = photons.iter().flat_map(Tag::to_bytes).collect();
        assert!(writer.tags(at(0.0), "tagger", &bytes).unwrap());
        let record = CountRecord { counts: vec![1, 1], ..night::bin(i as u64, 0.01) };
        writer.count("tagger", &record).unwrap();
        if i % 100 == 99 {
            assert!(writer.sync(at(0.0)).is_empty());
        }
    }
    // Of a bin that was not over.
    let last = Tag::photon(1, seconds * 1_000_000_000_000 + 5);
    writer.tags(at(0.0), "tagger", &last.to_bytes()).unwrap();
    assert_eq!(writer.finish(at(seconds as f64), "done").lost, 0);
    Session::open(root).unwrap()
}

/// Truth: the tags of the file, counted by a filter; the inputs of the plan, and none of the one between.
#[test]
fn bins_and_tags_of_a_night_are_of_the_same_photons() {
    let folder = Folder::new("tags_live");
    let plan = plan_of(&[
        ("from = \"2020-11-18T17:00:00Z\"", ""),
        ("for_s = 60", "for_s = 3"),
        ("bin_s = 0.1", "bin_s = 0.1\nraw_tags = true"),
        ("channels = { g = 1, r = 3 }", "channels = { g = 3, r = 1 }"),
    ]);
    std::fs::write(folder.0.join("night.toml"), plan).unwrap();
    folder.done(&["observe", "night.toml", "-o", "s"]);
    let text = folder.done(&["session", "check", "s"]);
    assert!(text.contains("raw tags"), "{text}");
    let session = Session::open(folder.0.join("s")).unwrap();
    let device = session.manifest().devices[1].clone();
    assert_eq!((device.channels, device.inputs), (vec!["r".into(), "g".into()], vec![1, 3]));
    let (bins, tags) = (bins(&session), tags(&session));
    assert!(bins.len() >= 10 && tags.iter().all(|tag| tag.channel != 2));
    for bin in &bins {
        assert_eq!(bin.counts, counted(&tags, bin, &[1, 3]));
        // 10,000 Hz in 0.1 s: 1,000 ± 32, ten sigma.
        assert!(bin.counts.iter().all(|n| (680..1320).contains(n)), "{:?}", bin.counts);
    }
}

/// Truth: the recorded bytes.
#[test]
fn a_replay_has_the_same_tags() {
    let folder = Folder::new("tags_replay");
    let old = recorded(&folder.0.join("old"), 5);
    assert!(old.check().unwrap().is_whole(), "{:?}", old.check().unwrap());
    let night = replayed(old.root(), true, Some(&folder.0.join("new"))).unwrap();
    assert_eq!(night.run(&Cancel::new(), &mut |_| {}).unwrap().not_written, 0);
    let new = Session::open(folder.0.join("new")).unwrap();
    let bytes = |session: &Session| std::fs::read(session.tags("tagger").unwrap().unwrap());
    assert_eq!(bytes(&new).unwrap(), bytes(&old).unwrap());
    assert_eq!((bins(&new), tags(&new).len()), (bins(&old), 1001));
    let report = new.check().unwrap();
    assert!(report.is_whole(), "{report:?}");
    let counter = &report.counters[0];
    assert_eq!((counter.tags, counter.marked_tags), (Some(1001), 1001));
    // One byte that is another is seen.
    let path = new.tags("tagger").unwrap().unwrap();
    let mut changed = std::fs::read(&path).unwrap();
    changed[100] ^= 1;
    std::fs::write(&path, &changed).unwrap();
    let text = format!("{:?}", new.check().unwrap().findings);
    assert!(text.contains("tags/tagger.tags") && text.contains("CRC-32"), "{text}");
}

/// Truth: the recorded night, played at speed, and when it was killed (SIGKILL): all tags older than a second are there, as they were.
#[test]
fn a_killed_night_has_its_tags_to_within_a_second() {
    let folder = Folder::new("tags_kill");
    let old = recorded(&folder.0.join("old"), 6);
    let root = folder.0.join("new");
    let mut program = Command::new(env!("CARGO_BIN_EXE_sunglint"))
        .args(["observe", "--replay"])
        .arg(old.root())
        .arg("-o")
        .arg(&root)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let limit = Instant::now() + Duration::from_secs(60);
    while !std::fs::metadata(root.join("tags/tagger.tags")).is_ok_and(|about| about.len() > 0) {
        assert!(Instant::now() < limit, "no tag within a minute");
        std::thread::sleep(Duration::from_millis(2));
    }
    let begun = Instant::now();
    std::thread::sleep(Duration::from_millis(2300));
    let lived_s = begun.elapsed().as_secs_f64();
    program.kill().unwrap();
    program.wait().unwrap();
    let new = Session::open(&root).unwrap();
    let (before, after) = (tags(&old), tags(&new));
    assert_eq!(after[..], before[..after.len()]);
    // 200 tags a second.
    assert!(after.len() as f64 >= 200.0 * (lived_s - 1.0), "{} in {lived_s} s", after.len());
    let report = new.check().unwrap();
    let bad = |text: &str| text.contains("CRC") || text.contains("were safe");
    assert!(!report.ended && !report.findings.iter().any(|f| bad(&f.text)), "{report:?}");
}

/// Truth: a counter of bins alone: the night does not begin, no folder is made, and the message says what to do.
#[test]
fn a_counter_without_tags_is_refused_before_the_night() {
    let folder = Folder::new("tags_refused");
    let mut night = night::Fakes::new(10.0).night(&folder.0.join("s"));
    night.counters[0].raw_tags = true;
    let error = night.run(&Cancel::new(), &mut |_| {}).unwrap_err().to_string();
    assert!(error.contains("counter tagger") && error.contains("no time tags"), "{error}");
    assert!(error.contains("leave out its `raw_tags`") && !folder.0.join("s").exists());
}
