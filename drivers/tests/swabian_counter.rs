//! The Time Tagger's driver with a simulated bridge, on a virtual clock: its counts against the light that was there.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::swabian::{BIN_PS, Known, count, settings, words};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Cancel, Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{Device as _, DeviceError, PhotonCounter as _};
use sunglint_drivers::simulated::swabian::{Light, Poisson, Simulated, TaggerSpec, Trouble};
use sunglint_drivers::swabian::{Source, TaggerSettings, TimeTagger, convert};
use sunglint_drivers::tags::{Binning, Tag, TagFile, TagWriter};
use sunglint_formats::CountFlags;

fn clock() -> Arc<VirtualClock> {
    Arc::new(VirtualClock::new())
}

fn after(clock: &Arc<VirtualClock>, ms: u64) -> Deadline {
    Deadline::after(clock.clone(), Duration::from_millis(ms))
}

fn open(
    clock: &Arc<VirtualClock>,
    trouble: Trouble,
    light: impl Light + 'static,
) -> TimeTagger<Simulated> {
    let mut line = Simulated::new(TaggerSpec::default(), light);
    line.trouble = trouble;
    TimeTagger::open(line, settings(), &after(clock, 5000)).unwrap()
}

/// Truth: the light's own counts. However the host asks (one bin, many, late, too early, other questions in between), each
/// bin comes once, in order, with its counts; its UTC is the clock's, late by the 2 ms that the line takes.
#[test]
fn bins_come_once_however_they_are_asked_for() {
    let clock = clock();
    let mut tagger = open(&clock, Trouble::default(), Known);
    tagger.start(BIN_PS, &after(&clock, 1000)).unwrap();
    let mut records = tagger.read(3, &after(&clock, 5000)).unwrap();
    // Late: twenty bins have ended meanwhile.
    clock.sleep(Duration::from_secs(2));
    assert_eq!(tagger.settings(&after(&clock, 1000)).unwrap().len(), 6);
    // It came while the settings were asked for, and no time is needed to hand it over.
    records.extend(tagger.read(1, &after(&clock, 0)).unwrap());
    records.extend(tagger.read(20, &after(&clock, 5000)).unwrap());
    // Too early: what had come is in the error, and the rest comes with the next call.
    let early = tagger.read(10, &after(&clock, 350)).unwrap_err();
    assert!((2..=4).contains(&early.done.len()), "{}", early.done.len());
    records.extend(early.done);
    records.extend(tagger.read(5, &after(&clock, 5000)).unwrap());
    for (i, record) in records.iter().enumerate() {
        let start_ps = records[0].start_ps + i as i64 * BIN_PS;
        assert_eq!((record.start_ps, record.length_ps), (start_ps, BIN_PS));
        let truth = [1, 2, -3].map(|channel| count(start_ps, channel));
        assert_eq!(record.counts, truth);
        assert_eq!(record.flags, CountFlags::CLOCK_FREE);
        let at_ns = (record.start - records[0].start).total_nanoseconds();
        assert_eq!(at_ns, i128::from(start_ps - records[0].start_ps) / 1000);
    }
    // The first bin began as soon as the simulated clock had served the requests; its UTC is 2 ms late.
    let utc = sunglint_formats::time::parse_utc("2026-01-01T00:00:00").unwrap();
    let late =
        (records[0].start - utc).total_nanoseconds() - i128::from(records[0].start_ps) / 1000;
    assert_eq!(late, 2_000_000);
    tagger.stop(&after(&clock, 1000)).unwrap();
    let error = tagger.read(1, &after(&clock, 1000)).unwrap_err();
    assert!(error.to_string().contains("it does not count: start it first"), "{error}");
    // A new measurement begins anew.
    tagger.start(2 * BIN_PS, &after(&clock, 1000)).unwrap();
    let next = tagger.read(1, &after(&clock, 5000)).unwrap();
    assert!(next[0].start_ps > records.last().unwrap().start_ps && next[0].length_ps == 2 * BIN_PS);
    tagger.close(&after(&clock, 1000)).unwrap();
}

/// Truth: settings of the simulated device: levels in steps of 1 mV, dead times from 2.1 ns to 2.147 ms.
#[test]
fn settings_are_read_back() {
    let clock = clock();
    let mut tagger = open(&clock, Trouble::default(), Known);
    let d = after(&clock, 60_000);
    assert_eq!(tagger.channels(), ["g", "r", "i"]);
    assert_eq!(tagger.set_trigger_level_v(1, 0.1234, &d).unwrap(), 0.123);
    assert_eq!(tagger.set_trigger_level_v(1, 4.0, &d).unwrap(), 2.5, "what the device then has");
    assert_eq!(tagger.set_input_delay_ps(0, -1_250, &d).unwrap(), -1_250);
    assert_eq!(tagger.set_dead_time_ps(2, 1, &d).unwrap(), 2_100);
    assert_eq!(tagger.set_dead_time_ps(2, 50_000, &d).unwrap(), 50_000);
    assert!(tagger.set_test_signal(0, true, &d).unwrap());
    let settings = tagger.settings(&d).unwrap();
    let told: Vec<String> = settings.iter().map(|s| format!("{} {}", s.name, s.value)).collect();
    assert_eq!(
        told,
        [
            "channel_number g=1 r=2 i=-3",
            "trigger_level_v g=0.5 r=2.5 i=0.5",
            "input_delay_ps g=-1250 r=0 i=0",
            "dead_time_ps g=2100 r=2100 i=50000",
            "test_signal g=true r=false i=false",
            "overflows_since_start 0",
        ]
    );
    for (error, says) in [
        (tagger.set_dead_time_ps(0, 3_000_000_000, &d).unwrap_err(), "exceeds 2147000000 ps"),
        (tagger.set_trigger_level_v(9, 0.5, &d).unwrap_err(), "channel: found 9, expected"),
        (tagger.set_trigger_level_v(0, f64::NAN, &d).unwrap_err(), "found NaN, expected -5 to 5"),
        (tagger.start(0, &d).unwrap_err(), "bin_ps: found 0, expected 1000000000 to"),
    ] {
        assert!(error.to_string().contains(says), "{error}");
    }
    tagger.start(BIN_PS, &d).unwrap();
    let error = tagger.start_tags(&d).unwrap_err();
    assert!(error.to_string().contains("stop first"), "{error}");
}

/// Truth: the maker's library 2.22.6 says these four sentences where nothing is plugged in; each has to say what to do.
#[test]
fn the_makers_messages_say_what_to_do() {
    for (code, text, says) in [
        (
            "no_module",
            "ModuleNotFoundError: No module named 'Swabian' (Python: /usr/bin/python3)",
            "pip install Swabian-TimeTagger",
        ),
        ("no_device", "No Time Tagger attached or already in use.", "plug it in"),
        ("no_licence", "No license file found or no Time Tagger connected.", "simulated counter"),
        (
            "no_server",
            "Could not connect to Time Tagger server at 127.0.0.1:41101.",
            "address, the port (41101",
        ),
        ("bad_file", "FileReader could not open file 'x.ttbin'.", "whole .ttbin file"),
    ] {
        let trouble = Trouble {
            refuse: Some(("open".into(), code.into(), text.into())),
            ..Trouble::default()
        };
        let mut line = Simulated::new(TaggerSpec::default(), Known);
        line.trouble = trouble;
        let error = TimeTagger::open(line, settings(), &after(&clock(), 5000)).unwrap_err();
        let told = error.to_string();
        assert!(told.contains(text.trim_end_matches('.')) && told.contains(says), "{told}");
        assert!(matches!(error, DeviceError::Declined { .. }));
    }
    let open = |settings| {
        let line = Simulated::new(TaggerSpec::default(), Known);
        TimeTagger::open(line, settings, &after(&clock(), 5000)).unwrap_err().to_string()
    };
    let serial = Some("other".into());
    let other = open(TaggerSettings { source: Source::Usb { serial }, ..settings() });
    assert!(other.contains("No Time Tagger attached"), "{other}");
    let mut twice = settings();
    twice.channels[1].number = 1;
    assert!(open(twice).contains("channels: found r (1)"));
    let mut far = settings();
    far.channels[1].number = 19;
    assert!(open(far).contains("no such channel"));
}

/// Light with a bad night: an overflow from 0.25 s to 0.45 s, in which 1,000 events of channel 2 are missed (told at its
/// end), an error at 0.65 s, and a photon of channel 1 every 10 ms.
fn bad_night(_: &[i32], from_ps: i64, to_ps: i64, into: &mut Vec<Tag>) {
    let ms = 1_000_000_000;
    let mut all: Vec<Tag> = (0..100).map(|i| Tag::photon(1, i * 10 * ms + 5 * ms)).collect();
    all.extend([
        Tag::overflow_begin(250 * ms),
        Tag::missed_events(2, 1_000, 450 * ms),
        Tag::overflow_end(450 * ms),
        Tag::error(650 * ms),
    ]);
    all.sort_by_key(|tag| tag.time_ps);
    into.extend(all.iter().filter(|tag| (from_ps..to_ps).contains(&tag.time_ps)));
}

/// Truth: the bad night above, by hand; and the same night binned from its raw tags by `tags`.
#[test]
fn overflows_missed_events_and_errors_are_kept() {
    let clock = clock();
    let mut tagger = open(&clock, Trouble::default(), bad_night);
    tagger.start(BIN_PS, &after(&clock, 1000)).unwrap();
    let records = tagger.read(8, &after(&clock, 5000)).unwrap();
    let first_ps = records[0].start_ps;
    assert!(first_ps < 20_000_000_000, "the bins lie as they were thought: {first_ps}");
    use CountFlags as F;
    let truth = [
        F::empty(),
        F::empty(),
        F::OVERFLOW,
        F::OVERFLOW,
        F::OVERFLOW | F::MISSED,
        F::empty(),
        F::ERROR,
        F::empty(),
    ];
    let mut night = Vec::new();
    bad_night(&[], 0, i64::MAX, &mut night);
    let bytes: Vec<u8> = night.iter().flat_map(Tag::to_bytes).collect();
    let binning = Binning::new(&[1, 2, -3], BIN_PS, first_ps, first_ps + 8 * BIN_PS).unwrap();
    let binned = sunglint_drivers::tags::Tags::new(&bytes).unwrap().bin(&binning);
    for (i, (record, truth)) in records.iter().zip(truth).enumerate() {
        assert_eq!(record.flags, truth | F::CLOCK_FREE, "bin {i}");
        assert_eq!(record.missed, [0, if i == 4 { 1_000 } else { 0 }, 0]);
        assert_eq!(record.counts, [10, 0, 0]);
        assert_eq!(record.counts, binned.counts(i), "bin {i}");
    }
}

/// Truth: the light's tags, record by record, in the file; the counts of its bins.
#[test]
fn raw_tags_reach_the_file_as_they_are() {
    let clock = clock();
    let rates = [(1, 20_000.0), (2, 3_000.0), (-3, 0.0)];
    let mut tagger = open(&clock, Trouble::default(), Poisson::new(&rates, 7));
    tagger.start_tags(&after(&clock, 1000)).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("raw.tags");
    let mut writer = TagWriter::create(&path).unwrap();
    let mut records = 0;
    for _ in 0..5 {
        let time = Duration::from_millis(100);
        records += tagger.record(&mut writer, time, &after(&clock, 5000)).unwrap().records;
    }
    assert_eq!(writer.finish().unwrap(), records);
    let file = TagFile::open(&path).unwrap();
    let mut read = Vec::new();
    file.for_each(0..file.len(), |tags| {
        read.extend(tags.iter());
        Ok::<_, sunglint_formats::FileError>(())
    })
    .unwrap();
    // The same light once more, from the moment of the start on.
    let mut again = Vec::new();
    let from_ps = 4_000_000_000;
    let mut light = Poisson::new(&rates, 7);
    for i in 0..25 {
        light.tags(
            &[1, 2, -3],
            from_ps + i * 20_000_000_000,
            from_ps + (i + 1) * 20_000_000_000,
            &mut again,
        );
    }
    assert!(read.len() > 10_000 && again.len() >= read.len(), "{} {}", read.len(), again.len());
    assert_eq!(read, again[..read.len()]);
    // 0.48 s or more of 23,000 Hz: 11,040 ± 105; five sigma.
    assert!((10_500..12_100).contains(&read.len()), "{}", read.len());
}

/// Truth: the tags of the simulated file.
#[test]
fn a_file_is_converted_whole_or_not_at_all() {
    let clock = clock();
    let mut tags: Vec<Tag> = (0..200_000).map(|i| Tag::photon(1 + i as i32 % 3, i * 7)).collect();
    tags.push(Tag::overflow_begin(2_000_000));
    tags.push(Tag::missed_events(2, 9, 2_000_001));
    tags.push(Tag::photon(1, 5));
    let spec = || TaggerSpec {
        files: BTreeMap::from([("night.ttbin".to_owned(), tags.clone())]),
        ..TaggerSpec::default()
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("night.tags");
    let mut writer = TagWriter::create(&path).unwrap();
    let line = Simulated::new(spec(), Known);
    let converted = convert(line, "night.ttbin", &mut writer, &after(&clock, 60_000)).unwrap();
    let summary = converted.summary;
    assert_eq!((summary.records, summary.photons, summary.missed), (200_003, 200_001, 9));
    assert_eq!((summary.unsorted, summary.overflows), (1, 1));
    writer.finish().unwrap();
    let bytes: Vec<u8> = tags.iter().flat_map(Tag::to_bytes).collect();
    assert_eq!(std::fs::read(&path).unwrap(), bytes);
    let mut writer = TagWriter::create(folder.path().join("other.tags")).unwrap();
    let line = Simulated::new(spec(), Known);
    let error = convert(line, "day.ttbin", &mut writer, &after(&clock, 60_000)).unwrap_err();
    assert!(error.to_string().contains("day.ttbin is no file; is it a whole .ttbin"), "{error}");
    let mut line = Simulated::new(spec(), Known);
    line.trouble.dies_after = Some(3);
    let error = convert(line, "night.ttbin", &mut writer, &after(&clock, 60_000)).unwrap_err();
    assert_eq!((error.done.records, words(&error.error).as_str()), (131_072, "gone"));
}

/// Truth: the clock and the named errors.
#[test]
fn deadlines_tokens_and_broken_streams() {
    let trouble = Trouble { twice: Some(2), ..Trouble::default() };
    let run = |trouble: Trouble| {
        let clock = clock();
        let mut tagger = open(&clock, trouble, Known);
        tagger.start(BIN_PS, &after(&clock, 1000)).unwrap();
        tagger.read(5, &after(&clock, 5000))
    };
    let error = run(trouble).unwrap_err();
    assert_eq!(error.done.len(), 3);
    assert!(error.to_string().contains("it came twice, or the clock went back"), "{error}");
    let records = run(Trouble { dropped: Some(2), ..Trouble::default() }).unwrap();
    let gaps: Vec<bool> = records.iter().map(|r| r.flags.contains(CountFlags::GAP)).collect();
    assert_eq!(gaps, [false, false, true, false, false]);
    let clock = clock();
    let mut tagger = open(&clock, Trouble::default(), Known);
    tagger.start(BIN_PS, &after(&clock, 1000)).unwrap();
    let cancel = Cancel::new();
    cancel.cancel();
    let error = tagger.read(1, &after(&clock, 5000).with_cancel(&cancel)).unwrap_err();
    assert!(matches!(*error.error, DeviceError::Cancelled { .. }), "{error}");
    // It goes on after that.
    assert_eq!(tagger.read(2, &after(&clock, 5000)).unwrap().len(), 2);
    // A bridge that falls silent, and answers later: the late answer is not taken for another's.
    tagger.line_mut().trouble.silent = true;
    let begun = clock.now();
    assert_eq!(words(&tagger.settings(&after(&clock, 5000)).unwrap_err()), "no answer");
    assert_eq!(clock.now() - begun, Duration::from_secs(1), "reply_within");
    tagger.line_mut().trouble.silent = false;
    assert_eq!(tagger.settings(&after(&clock, 5000)).unwrap().len(), 6);
}
