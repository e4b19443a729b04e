//! Bins that the Time Tagger's driver makes of its tag stream, against the light that was there.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::swabian::{BIN_PS, settings};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use sunglint_drivers::clock::{Deadline, VirtualClock};
use sunglint_drivers::device::{Device as _, PhotonCounter, TagSink};
use sunglint_drivers::simulated::swabian::{Light, Poisson, Simulated, TaggerSpec};
use sunglint_drivers::swabian::TimeTagger;
use sunglint_drivers::tags::{BinStream, Tag, TagError, TagKind, Tags};
use sunglint_formats::{CountFlags, CountRecord};

const MS: i64 = 1_000_000_000;

fn after(clock: &Arc<VirtualClock>, ms: u64) -> Deadline {
    Deadline::after(clock.clone(), Duration::from_millis(ms))
}

/// So many bins of this light, and the tags that came beside them.
fn streamed(light: impl Light + 'static, bins: usize) -> (Vec<CountRecord>, Vec<Tag>) {
    let clock = Arc::new(VirtualClock::new());
    let line = Simulated::new(TaggerSpec::default(), light);
    let mut tagger = TimeTagger::open(line, settings(), &after(&clock, 5000)).unwrap();
    assert!(tagger.streams_tags());
    let tags = Arc::new(Mutex::new(Vec::new()));
    let all = tags.clone();
    let sink = TagSink::new(move |records| {
        all.lock().unwrap().extend(records.iter().map(Tag::from_bytes));
    });
    tagger.start_with_tags(BIN_PS, sink, &after(&clock, 1000)).unwrap();
    let mut records = tagger.read(2, &after(&clock, 5000)).unwrap();
    // Questions in between take no tag away.
    assert_eq!(tagger.settings(&after(&clock, 1000)).unwrap().len(), 6);
    records.extend(tagger.read(bins - 2, &after(&clock, 60_000)).unwrap());
    tagger.stop(&after(&clock, 1000)).unwrap();
    // Counting in the maker's bins goes on afterwards.
    tagger.start(BIN_PS, &after(&clock, 1000)).unwrap();
    assert_eq!(tagger.read(1, &after(&clock, 5000)).unwrap().len(), 1);
    let tags = tags.lock().unwrap().clone();
    (records, tags)
}

/// Truth: the tags that were handed over, counted by a filter for each bin; bins without a gap. The start in UTC is the clock's (2026-01-01
/// at its zero), late by the line's 2 ms and nothing else.
#[test]
fn bins_are_made_of_the_tags_beside_them() {
    let rates = [(1, 20_000.0), (2, 3_000.0), (-3, 0.0)];
    let (records, tags) = streamed(Poisson::new(&rates, 7), 20);
    assert_eq!(records.len(), 20);
    for (i, record) in records.iter().enumerate() {
        assert_eq!(record.start_ps, records[0].start_ps + i as i64 * BIN_PS);
        let within = record.start_ps..record.start_ps + record.length_ps;
        let truth = [1, 2, -3].map(|channel| {
            let here = |t: &&Tag| t.channel == channel && within.contains(&t.time_ps);
            tags.iter().filter(here).count() as u64
        });
        assert_eq!(record.counts, truth, "bin {i}");
        assert_eq!(record.flags, CountFlags::CLOCK_FREE);
        let since_ns = record.start.to_unix_duration().total_nanoseconds()
            - 1_767_225_600_000_000_000
            - i128::from(record.start_ps / 1000);
        assert_eq!(since_ns, 2_000_000, "bin {i}");
    }
}

/// An overflow from 0.25 s to 0.45 s, in which 1,000 events of channel 2 are missed (told at its end), an error at 0.65 s, and a photon of
/// channel 1 every 10 ms.
fn bad_night(_: &[i32], from_ps: i64, to_ps: i64, into: &mut Vec<Tag>) {
    let mut all: Vec<Tag> = (0..200).map(|i| Tag::photon(1, i * 10 * MS + 5 * MS)).collect();
    all.extend([
        Tag::overflow_begin(250 * MS),
        Tag::missed_events(2, 1_000, 450 * MS),
        Tag::overflow_end(450 * MS),
        Tag::error(650 * MS),
    ]);
    all.sort_by_key(|tag| tag.time_ps);
    into.extend(all.iter().filter(|tag| (from_ps..to_ps).contains(&tag.time_ps)));
}

/// Truth: the bad night above, by hand.
#[test]
fn an_overflow_in_the_stream_flags_its_bins() {
    let (records, tags) = streamed(bad_night, 8);
    assert!(records[0].start_ps < 20 * MS, "the bins lie as they were thought");
    use CountFlags as F;
    let none = F::empty();
    let last = F::OVERFLOW | F::MISSED;
    let truth = [none, none, F::OVERFLOW, F::OVERFLOW, last, none, F::ERROR, none];
    for (i, (record, truth)) in records.iter().zip(truth).enumerate() {
        assert_eq!(record.flags, truth | F::CLOCK_FREE, "bin {i}");
        assert_eq!(record.missed, [0, if i == 4 { 1_000 } else { 0 }, 0]);
        assert_eq!(record.counts, [10, 0, 0]);
    }
    let others = tags.iter().filter(|tag| tag.kind() != Some(TagKind::TimeTag)).count();
    assert_eq!(others, 4, "what the counter reports is handed on too");
}

/// Truth: darkness has bins too, all of them zero.
#[test]
fn bins_without_a_tag_come_too() {
    let (records, tags) = streamed(Poisson::new(&[], 1), 5);
    assert!(tags.is_empty());
    assert!(records.iter().all(|r| r.counts == [0; 3] && r.flags == CountFlags::CLOCK_FREE));
}

/// Truth: by hand. Tags in any pieces; one that comes when its bin is gone is in no bin, and the next says so.
#[test]
fn a_stream_gives_finished_bins_alone() {
    let bytes = |tags: &[Tag]| tags.iter().map(Tag::to_bytes).collect::<Vec<_>>();
    let mut stream = BinStream::new(&[1, 500], 10, -5).unwrap();
    stream.add(Tags::of_records(&bytes(&[
        Tag::photon(1, -5),
        Tag::photon(500, 27),
        Tag::photon(1, 4),
        Tag::photon(2, 4),
        Tag::photon(1, 5),
    ])));
    assert_eq!(stream.finished(4), None);
    let bin = stream.finished(5).unwrap();
    assert_eq!((bin.start_ps, bin.counts, bin.flags), (-5, vec![2, 0], CountFlags::empty()));
    assert_eq!(stream.finished(5), None);
    stream.add(Tags::of_records(&bytes(&[Tag::photon(1, 4), Tag::overflow_begin(25)])));
    let bins: Vec<_> = std::iter::from_fn(|| stream.finished(44)).collect();
    let told: Vec<_> = bins.iter().map(|b| (b.start_ps, b.counts.clone(), b.flags)).collect();
    let (none, over) = (CountFlags::empty(), CountFlags::OVERFLOW);
    assert_eq!(
        told,
        [(5, vec![1, 0], CountFlags::ERROR), (15, vec![0, 0], none), (25, vec![0, 1], over),]
    );
    assert_eq!((stream.late(), stream.next_ps()), (1, 35));
    // It ended when a bin began: that one has the moment in common.
    stream.add(Tags::of_records(&bytes(&[Tag::overflow_end(45)])));
    let flags: Vec<_> = std::iter::from_fn(|| stream.finished(65)).map(|b| b.flags).collect();
    assert_eq!(flags, [over, over, none]);
    assert!(matches!(BinStream::new(&[1], 0, 0), Err(TagError::Width { width_ps: 0 })));
    assert!(matches!(BinStream::new(&[1, 1], 1, 0), Err(TagError::Channels { .. })));
    let mut late = BinStream::new(&[1], i64::MAX, 1).unwrap();
    assert_eq!(late.finished(i64::MAX), None);
}
