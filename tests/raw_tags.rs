//! Raw tags of a night: beside bins of the same stream, killed, played back, refused.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use crate::common::night::{at, bins, plan_of};
use crate::common::tagged::{Tagged, truth_hz};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};
use sunglint::observe::replayed;
use sunglint_calibration::reduction::tags::TagSummary;
use sunglint_calibration::reduction::{ReduceOptions, reduce};
use sunglint_drivers::clock::Cancel;
use sunglint_drivers::tags::{Tag, TagFile, TagKind};
use sunglint_formats::CountRecord;
use sunglint_formats::session::{
    ClockState, Device, DeviceKind, Disk, FORMAT, Manifest, Session, SessionWriter,
};
use sunglint_numerics::progress::Silent;
use sunglint_radiometry::light_curve::{Flags, LightCurve};
use sunglint_radiometry::station::Station;

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
        let record =
            CountRecord { counts: vec![1, 1], ..crate::common::night::bin(i as u64, 0.01) };
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
    folder.done(&["observe", "night.toml", "--anyway", "-o", "s"]);
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

/// A disk that is too small for the night (a small tmpfs). Truth: the recorded night: of the bins its beginning is on the disk, of the tags some, with a mark in place of the others; that some are missing is
/// said by the program and by `session check`.
#[test]
fn a_full_disk_leaves_the_tags_before_it() {
    let folder = Folder::new("tags_full");
    let old = recorded(&folder.0.join("old"), 120);
    let small = folder.0.join("small");
    std::fs::create_dir(&small).unwrap();
    let system = |arguments: &[&str]| {
        let run = Command::new(arguments[0]).args(&arguments[1..]).arg(&small).output();
        run.is_ok_and(|output| output.status.success())
    };
    if !system(&["mount", "-t", "tmpfs", "-o", "size=500k", "tmpfs"]) {
        let test = "a_full_disk_leaves_the_tags_before_it";
        return sunglint_testkit::skip(test, "a tmpfs can only be mounted by root");
    }
    let output = folder.run(&["observe", "--replay", "old", "--fast", "-o", "small/s"]);
    let check = folder.run(&["session", "check", "small/s", "--json"]);
    let session = Session::open(small.join("s"));
    let read = session.as_ref().map(|session| (bins(session), tags(session)));
    assert!(system(&["umount"]), "the test's tmpfs could not be taken away");
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("tags of tagger are left out"), "{message}");
    assert!(message.contains("not be written"), "{message}");
    assert_eq!(check.status.code(), Some(1));
    let (new_bins, new_tags) = read.unwrap();
    let (old_bins, old_tags) = (bins(&old), tags(&old));
    assert!(new_tags.len() < old_tags.len(), "{}: {message}", new_tags.len());
    // Those that found room, behind a mark of those that did not.
    let kept: Vec<&Tag> = new_tags.iter().filter(|t| t.kind() == Some(TagKind::TimeTag)).collect();
    assert!(kept.iter().all(|tag| old_tags.contains(tag)));
    assert!(kept.len() < new_tags.len() || new_tags.is_empty(), "{message}");
    // The bins come first. Not even they have room here: 12,000 rows of 70 bytes.
    assert!(
        new_bins.len() > 3000 && new_bins[..] == old_bins[..new_bins.len()],
        "{}",
        new_bins.len()
    );
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
    let mut night = crate::common::night::Fakes::new(10.0).night(&folder.0.join("s"));
    night.counters[0].raw_tags = true;
    let error = night.run(&Cancel::new(), &mut |_| {}).unwrap_err().to_string();
    assert!(error.contains("counter tagger") && error.contains("no time tags"), "{error}");
    assert!(error.contains("leave out its `raw_tags`") && !folder.0.join("s").exists());
}

/// The reduced curve of Vega, what became of the tags, and the warnings.
fn reduced(session: &Session) -> (LightCurve, Option<TagSummary>, String) {
    let station = Station::built_in("ufo").unwrap().unwrap();
    let options = ReduceOptions::for_station(&station);
    let mut night = reduce(session, &station, &options, &Silent).unwrap();
    let curve = night.take(session, &station).unwrap().unwrap().linear;
    (curve, night.counters[0].tags.clone(), night.warnings.join("\n"))
}

/// Statistics of the bins with a glint between two times of a channel: the mean of rate over truth, the standard deviation of that by what is stated, how many there are,
/// and how many are flagged.
fn glints(curve: &LightCurve, channel: &str, [from_s, to_s]: [f64; 2]) -> (f64, f64, usize, usize) {
    let channel = curve.channel(channel).unwrap();
    let (mut sum, mut variance, mut n, mut flagged) = (0.0, 0.0, 0, 0);
    for (i, time) in curve.samples.time.iter().enumerate() {
        let t = (*time - at(0.0)).to_seconds();
        if !(from_s..to_s).contains(&t) || (t.fract() - 0.55).abs() > 0.01 {
            continue;
        }
        sum += channel.rate_hz[i] / truth_hz(true);
        variance += (channel.sigma_hz[i] / truth_hz(true)).powi(2);
        n += 1;
        flagged += usize::from(channel.flags[i].contains(Flags::FAST_GLINT));
    }
    (sum / n as f64, variance.sqrt() / n as f64, n, flagged)
}

/// A glint that is right: within 4 stated standard deviations of the mean and what fine bins of 1 ms leave of one of 8 ms (0.2 %).
fn right((mean, sigma, ..): (f64, f64, usize, usize)) -> bool {
    (mean - 1.0).abs() < 4.0 * sigma + 0.002
}

/// Truth: photon events through a detector that is dead for 10 µs: 20 glints of 8 ms, at their peak half of what it can follow. With tags their mean is right
/// (0.7 % of noise); without them it falls short by 7 % or more and each is flagged. What the program says is what the library did.
#[test]
fn glints_shorter_than_a_bin_are_right_through_the_program() {
    let folder = Folder::new("tags_reduce");
    let session = Tagged::new(1).session(&folder.0.join("s"));
    let (curve, tags, warnings) = reduced(&session);
    let tags = tags.unwrap();
    assert!(!warnings.contains("counter tagger"), "{warnings}");
    assert_eq!((tags.used, tags.differ, tags.beyond, tags.stretches), (300, 0, 0, [1, 0]));
    let found = glints(&curve, "id400", [10.0, 30.0]);
    eprintln!("with tags {found:?}");
    assert!(found.2 == 20 && right(found) && found.3 <= 2, "{found:?}");
    let json = folder.json(&["reduce", "s", "--json"]);
    let said = &json["counters"][0]["tags"];
    assert_eq!(
        (said["bins_used"].as_u64(), said["unused_stretches"].as_u64()),
        (Some(300), Some(0))
    );
    let text = folder.done(&["reduce", "s"]);
    assert!(text.contains("bins linearised by them 300"), "{text}");
    std::fs::remove_file(session.tags("tagger").unwrap().unwrap()).unwrap();
    let (curve, tags, warnings) = reduced(&session);
    assert!(tags.is_none() && warnings.contains("tags/tagger.tags is not there"), "{warnings}");
    let found = glints(&curve, "id400", [10.0, 30.0]);
    eprintln!("without {found:?}");
    assert!(found.2 == 20 && found.0 < 0.93 && found.3 == 20, "{found:?}");
}

/// Truth: the file cut at a byte, 20 s in, and zeros behind it: glints before are right, those after are flagged, and how many bins that were is said.
#[test]
fn tags_that_were_cut_serve_as_far_as_they_go() {
    let folder = Folder::new("tags_cut");
    let mut night = Tagged::new(2);
    night.tags.retain(|tag| tag.time_ps < 20_000_000_000_000);
    night.tail = [[0; 16].to_vec(), vec![7; 5]].concat();
    let (curve, tags, warnings) = reduced(&night.session(&folder.0.join("s")));
    let tags = tags.unwrap();
    assert_eq!((tags.cut, tags.used, tags.differ, tags.beyond), ([5, 1], 200, 0, 100));
    assert!(warnings.contains("5 bytes of a torn record and 1 records of zeros"), "{warnings}");
    assert!(warnings.contains("100 bins with counts before the first tag or after"), "{warnings}");
    let (before, after) =
        (glints(&curve, "id400", [10.0, 20.0]), glints(&curve, "id400", [20.0, 30.0]));
    assert!(right(before) && before.3 <= 1, "{before:?}");
    assert!(after.0 < 0.93 && after.3 == 10, "{after:?}");
}

/// Truth: tags that the disk lost for two seconds, as `observe` marks it; an overflow of the counter itself in one bin. Those bins are not linearised by what is left.
#[test]
fn lost_tags_are_not_taken_for_darkness() {
    let folder = Folder::new("tags_lost");
    let mut night = Tagged::new(3);
    let lost = 12_000_000_000_000..14_000_000_000_000_i64;
    let first = night.tags.iter().position(|tag| lost.contains(&tag.time_ps)).unwrap();
    night.tags.retain(|tag| !lost.contains(&tag.time_ps));
    night.tags.insert(first, Tag::overflow_begin(lost.start));
    night.tags.insert(first + 1, Tag::overflow_end(lost.end - 1));
    night.bins[255].flags |= sunglint_formats::CountFlags::OVERFLOW;
    let (curve, tags, warnings) = reduced(&night.session(&folder.0.join("s")));
    let tags = tags.unwrap();
    assert_eq!((tags.used, tags.differ, tags.incomplete), (279, 20, 1));
    assert!(warnings.contains("20 bins with more or fewer tags than counts"), "{warnings}");
    let hole = glints(&curve, "id400", [12.0, 14.0]);
    assert!(hole.2 == 2 && hole.3 == 2 && hole.0 > 0.7, "{hole:?}");
    let rest = glints(&curve, "id400", [14.0, 25.0]);
    assert!(right(rest) && rest.3 <= 1, "{rest:?}");
    let overflow = glints(&curve, "id400", [25.0, 26.0]);
    assert!(overflow.2 == 1 && overflow.3 == 1, "{overflow:?}");
}

/// Truth: a file without the tags of one input; a session that does not say which inputs there are.
#[test]
fn a_channel_without_tags_is_named() {
    let folder = Folder::new("tags_channel");
    let mut night = Tagged::new(4);
    night.tags.retain(|tag| tag.channel == 1);
    let (curve, tags, warnings) = reduced(&night.session(&folder.0.join("s")));
    let tags = tags.unwrap();
    assert_eq!((tags.used, tags.without), (300, vec!["spcm".to_owned()]));
    assert!(warnings.contains("no tag of channel spcm"), "{warnings}");
    // Half a thousandth of 50 kHz is dead time there: right without tags.
    for channel in ["id400", "spcm"] {
        let found = glints(&curve, channel, [10.0, 30.0]);
        assert!(right(found), "{channel}: {found:?}");
    }
    night.inputs = vec![];
    let (curve, tags, warnings) = reduced(&night.session(&folder.0.join("no_inputs")));
    assert!(tags.is_none() && warnings.contains("`inputs`"), "{warnings}");
    assert_eq!(glints(&curve, "id400", [10.0, 30.0]).3, 20);
}

/// Truth: the same tags 0.3 s late: of another clock. By chance one bin in thirty has as many tags as counts on both channels at most; not one is used.
#[test]
fn tags_of_another_clock_are_not_used() {
    let folder = Folder::new("tags_clock");
    let mut night = Tagged::new(5);
    for tag in &mut night.tags {
        tag.time_ps += 300_000_000_000;
    }
    let (curve, tags, warnings) = reduced(&night.session(&folder.0.join("s")));
    let tags = tags.unwrap();
    assert_eq!((tags.used, tags.stretches), (0, [1, 1]));
    assert!(tags.differ > 250, "{tags:?}");
    assert!(warnings.contains("they are not of these bins, and are not used"), "{warnings}");
    let found = glints(&curve, "id400", [10.0, 30.0]);
    assert!(found.0 < 0.93 && found.3 == 20, "{found:?}");
}

/// Truth: a counter that was lost at 20 s and began its clock anew, as `observe` records it, with tags of a third clock between that belong to no bin. All bins of
/// both clocks are linearised by their tags.
#[test]
fn a_clock_that_began_anew_finds_its_tags() {
    let folder = Folder::new("tags_anew");
    let mut night = Tagged::new(6);
    let anew = 20_000_000_000_000;
    for bin in night.bins.iter_mut().filter(|bin| bin.start_ps >= anew) {
        bin.start_ps -= anew;
    }
    night.bins[200].flags |= sunglint_formats::CountFlags::GAP;
    let mut tags: Vec<Tag> = night.tags.iter().copied().filter(|tag| tag.time_ps < anew).collect();
    tags.push(Tag::error(5));
    tags.extend((0..50).map(|i| Tag::photon(1, 1_000_000_000 * i)));
    tags.push(Tag::error(5));
    let later = night.tags.iter().filter(|tag| tag.time_ps >= anew);
    tags.extend(later.map(|tag| Tag { time_ps: tag.time_ps - anew, ..*tag }));
    night.tags = tags;
    let (curve, tags, warnings) = reduced(&night.session(&folder.0.join("s")));
    let tags = tags.unwrap();
    assert_eq!((tags.used, tags.differ, tags.beyond), (300, 0, 0), "{warnings}");
    let found = glints(&curve, "id400", [10.0, 30.0]);
    assert!(right(found) && found.3 <= 2, "{found:?}");
}
