//! Tags in files and in bins, against loops so plain that they are right by reading.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use proptest::prelude::*;
use rand::SeedableRng as _;
use rand_xoshiro::Xoshiro256PlusPlus;
use std::path::PathBuf;
use sunglint_drivers::tags::{
    Binned, Binning, CheckOptions, MOST_CELLS, Tag, TagError, TagFile, TagKind, Tags,
};
use sunglint_formats::time::parse_utc;
use sunglint_formats::{CountFlags, CountSeries, ecsv};

fn bytes_of(tags: &[Tag]) -> Vec<u8> {
    tags.iter().flat_map(Tag::to_bytes).collect()
}

struct Scratch(tempfile::TempDir);

impl Scratch {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn file(&self, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join("x.tags");
        std::fs::write(&path, bytes).unwrap();
        path
    }
}

/// Poisson streams of some channels, merged in time, seeded.
fn poisson(seed: u64, channels: &[i32], mean_gap_ps: f64, from_ps: i64, tags: usize) -> Vec<Tag> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut time_ps = from_ps as f64;
    (0..tags)
        .map(|_| {
            time_ps -= mean_gap_ps * (1.0 - random.random::<f64>()).ln();
            Tag::photon(channels[random.random_range(0..channels.len())], time_ps as i64)
        })
        .collect()
}

/// Expected bins, found bin by bin in i128: nothing is shared with the product.
struct Naive {
    counts: Vec<Vec<u64>>,
    missed: Vec<Vec<u64>>,
    flags: Vec<CountFlags>,
}

fn naive(tags: &[Tag], channels: &[i32], width: i64, from: i64, to: i64) -> Naive {
    let mut edges = vec![];
    let mut edge = i128::from(from);
    while edge < i128::from(to) {
        edges.push((edge, (edge + i128::from(width)).min(to.into())));
        edge += i128::from(width);
    }
    let of = |kind: TagKind, low: i128, high: i128| -> Vec<&Tag> {
        let inside =
            |tag: &&Tag| tag.kind() == Some(kind) && (low..high).contains(&i128::from(tag.time_ps));
        tags.iter().filter(inside).collect()
    };
    // Intervals of dropping, by the rules of the documentation.
    let (mut intervals, mut open, mut ended) = (vec![], None, i64::MIN);
    for tag in tags {
        match tag.kind() {
            Some(TagKind::OverflowBegin) => open = open.or(Some(tag.time_ps)),
            Some(TagKind::OverflowEnd) => {
                let begin = open.take().unwrap_or(ended);
                intervals.push((begin.min(tag.time_ps), begin.max(tag.time_ps)));
                ended = tag.time_ps;
            }
            _ => {}
        }
    }
    intervals.extend(open.map(|begin| (begin, i64::MAX)));
    let mut out = Naive { counts: vec![], missed: vec![], flags: vec![] };
    for &(low, high) in &edges {
        let per_channel = |kind, value: fn(&Tag) -> u64| -> Vec<u64> {
            let all = of(kind, low, high);
            channels
                .iter()
                .map(|&c| all.iter().filter(|t| t.channel == c).map(|t| value(t)).sum())
                .collect()
        };
        let counts = per_channel(TagKind::TimeTag, |_| 1);
        let missed = per_channel(TagKind::MissedEvents, |tag| tag.missed.into());
        let mut flags = CountFlags::empty();
        flags.set(CountFlags::MISSED, missed.iter().any(|&missed| missed > 0));
        flags.set(CountFlags::ERROR, !of(TagKind::Error, low, high).is_empty());
        let touches =
            |&(begin, end): &(i64, i64)| i128::from(begin) < high && i128::from(end) >= low;
        flags.set(CountFlags::OVERFLOW, intervals.iter().any(touches));
        flags.set(CountFlags::PARTIAL, high - low < i128::from(width));
        out.counts.push(counts);
        out.missed.push(missed);
        out.flags.push(flags);
    }
    out
}

#[track_caller]
fn same(binned: &Binned, naive: &Naive) {
    assert_eq!(binned.bins(), naive.counts.len());
    for bin in 0..binned.bins() {
        assert_eq!(binned.counts(bin), naive.counts[bin], "counts of bin {bin}");
        assert_eq!(binned.missed(bin), naive.missed[bin], "missed of bin {bin}");
        assert_eq!(binned.flags(bin), naive.flags[bin], "flags of bin {bin}");
    }
}

// Truth: a photon stream counted tag by tag and bin by bin, exactly; the file, at 1 and at 3 threads, gives the same.
#[test]
fn poisson_streams_are_counted_exactly() {
    let scratch = Scratch::new();
    for (seed, width_ps) in [(1, 1_000_000), (2, 7_777_777), (3, 100_000_001), (4, 900_000_000_000)]
    {
        // 300,000 tags are several pieces of work in a file.
        let mut tags = poisson(seed, &[1, 2, 3, -1, 1001], 100_000.0, -2_000_000_000, 300_000);
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        for _ in 0..40 {
            let at = random.random_range(0..tags.len());
            let time_ps = tags[at].time_ps;
            let end_ps = time_ps + random.random_range(0..30_000_000);
            tags.push(Tag::overflow_begin(time_ps));
            tags.push(Tag::missed_events(2, random.random(), end_ps));
            tags.push(Tag::missed_events(9, 5, end_ps));
            tags.push(Tag::overflow_end(end_ps));
            tags.push(Tag { kind_byte: 77, ..Tag::photon(1, time_ps) });
        }
        tags.push(Tag::error(5_000_000_000));
        tags.sort_by_key(|tag| tag.time_ps);
        let channels = [2, -1, 1001];
        let (from, to) = (-1_500_000_000, 25_000_000_000);
        let binning = Binning::new(&channels, width_ps, from, to).unwrap();
        let bytes = bytes_of(&tags);
        let binned = Tags::new(&bytes).unwrap().bin(&binning);
        // The plain loop is quadratic; only its sparse part is compared bin by bin where bins are many.
        if binning.bins() <= 400 {
            same(&binned, &naive(&tags, &channels, width_ps, from, to));
        } else {
            let (first, last) = (from + 800 * width_ps, from + 900 * width_ps);
            let part = naive(&tags, &channels, width_ps, first, last);
            for bin in 0..100 {
                assert_eq!(binned.counts(800 + bin), part.counts[bin]);
                assert_eq!(binned.flags(800 + bin), part.flags[bin]);
            }
        }
        let file = TagFile::open(scratch.file(&bytes)).unwrap();
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            assert_eq!(pool.install(|| file.bin(&binning)).unwrap(), binned, "{threads} threads");
        }
    }
}

// Truth: the plain loop. Overflows that begin in one piece of work and end, or begin again, or end unbegun in another.
#[test]
fn overflows_reach_across_pieces() {
    let scratch = Scratch::new();
    let mut random = Xoshiro256PlusPlus::seed_from_u64(12);
    let mut flagged = 0;
    for _ in 0..12 {
        // 65,536 records are a piece.
        let mut tags: Vec<Tag> = (0..200_000).map(|i| Tag::photon(1, i)).collect();
        for _ in 0..random.random_range(1..6) {
            let at = random.random_range(0..tags.len());
            tags[at].kind_byte = random.random_range(2..=3);
        }
        let bytes = bytes_of(&tags);
        let binning = Binning::new(&[1], 8_000, 0, 200_000).unwrap();
        let binned = Tags::new(&bytes).unwrap().bin(&binning);
        same(&binned, &naive(&tags, &[1], 8_000, 0, 200_000));
        assert_eq!(TagFile::open(scratch.file(&bytes)).unwrap().bin(&binning).unwrap(), binned);
        flagged += (0..25).filter(|&bin| binned.flags(bin) == CountFlags::OVERFLOW).count();
    }
    assert!((50..250).contains(&flagged), "{flagged} of 300");
}

// Truth: numpy.histogram on the same times (64-bit integers, integer edges), exactly. numpy closes the last bin at both
// ends, so no tag may lie on the last edge; the span is drawn so that none does.
#[test]
fn bins_are_those_of_numpy() {
    let test = "bins_are_those_of_numpy";
    let Some(python) = sunglint_testkit::peer_python(test, &["numpy"]) else { return };
    let scratch = Scratch::new();
    let tags = poisson(11, &[1, 2, 4], 50_000.0, 123_456_789, 200_000);
    let path = scratch.file(&bytes_of(&tags));
    let script = "
import sys, numpy as np
t = np.fromfile(sys.argv[1], dtype=[('type', 'u1'), ('res', 'u1'), ('missed', '<u2'), ('ch', '<i4'), ('t', '<i8')])
edges = np.arange(0, 1001, dtype=np.int64) * 9_999_991
assert not (t['t'] == edges[-1]).any()
for ch in (4, 1):
    print(*np.histogram(t['t'][t['ch'] == ch], bins=edges)[0])
";
    let printed = sunglint_testkit::run_python(&python, script, &[&path.display().to_string()]);
    let binning = Binning::new(&[4, 1], 9_999_991, 0, 1_000 * 9_999_991).unwrap();
    let binned = TagFile::open(&path).unwrap().bin(&binning).unwrap();
    for (slot, line) in printed.lines().enumerate() {
        let numpy: Vec<u64> = line.split(' ').map(|count| count.parse().unwrap()).collect();
        let ours: Vec<u64> = (0..1_000).map(|bin| binned.counts(bin)[slot]).collect();
        assert_eq!(ours, numpy);
    }
    assert_eq!(printed.lines().count(), 2);
    assert!(binned.totals().iter().all(|&total| total > 50_000), "{:?}", binned.totals());
}

fn any_tag() -> impl Strategy<Value = Tag> {
    let time = prop_oneof![
        8 => -60_i64..60,
        1 => Just(i64::MIN), 1 => Just(i64::MAX), 1 => any::<i64>()
    ];
    let channel =
        prop_oneof![8 => -2..3_i32, 1 => any::<i32>(), 1 => Just(i32::MIN), 1 => Just(127)];
    (prop_oneof![6 => Just(0_u8), 3 => 1..6_u8, 1 => any::<u8>()], 0..3_u8, 0..4_u16, channel, time)
        .prop_map(|(kind_byte, reserved, missed, channel, time_ps)| Tag {
            kind_byte,
            reserved,
            missed,
            channel,
            time_ps,
        })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    // Truth: the plain loop. Unsorted and duplicate times, overflows that begin, end or nest anywhere, negative times
    // and both ends of i64, any channel and type.
    #[test]
    fn any_tags_in_any_order_are_counted_as_by_hand(
        tags in prop::collection::vec(any_tag(), 0..120),
        width in 1_i64..40,
        from in -50_i64..50,
        length in 1_i64..90,
    ) {
        let bytes = bytes_of(&tags);
        let channels = [1, -2, i32::MIN];
        let binning = Binning::new(&channels, width, from, from + length).unwrap();
        let binned = Tags::new(&bytes).unwrap().bin(&binning);
        same(&binned, &naive(&tags, &channels, width, from, from + length));
    }

    // The sum over all bins is the number of photons in the span, and bins of 2 w are pairs of bins of w.
    #[test]
    fn sums_and_pairs(
        tags in prop::collection::vec(any_tag(), 0..200),
        width in 1_i64..30,
        pairs in 1_i64..10,
    ) {
        let bytes = bytes_of(&tags);
        let view = Tags::new(&bytes).unwrap();
        let (from, to) = (-40, -40 + 2 * width * pairs);
        let narrow = view.bin(&Binning::new(&[0, 1, 2], width, from, to).unwrap());
        let wide = view.bin(&Binning::new(&[0, 1, 2], 2 * width, from, to).unwrap());
        let photons = |channel| tags.iter().filter(|tag| {
            tag.kind_byte == 0 && tag.channel == channel && (from..to).contains(&tag.time_ps)
        }).count() as u64;
        prop_assert_eq!(narrow.totals(), [photons(0), photons(1), photons(2)]);
        for bin in 0..wide.bins() {
            for slot in 0..3 {
                let pair = narrow.counts(2 * bin)[slot] + narrow.counts(2 * bin + 1)[slot];
                prop_assert_eq!(wide.counts(bin)[slot], pair);
            }
            let either = narrow.flags(2 * bin) | narrow.flags(2 * bin + 1);
            prop_assert_eq!(wide.flags(bin), either);
        }
    }

    #[test]
    fn a_tag_comes_back_from_its_bytes(bytes in any::<[u8; 16]>()) {
        prop_assert_eq!(Tag::from_bytes(&bytes).to_bytes(), bytes);
    }

    // Truth: a sort and a filter.
    #[test]
    fn slices_of_files_are_filters(
        mut times in prop::collection::vec(-30_i64..30, 0..80),
        from in -35_i64..35,
        length in 0_i64..40,
    ) {
        let sorted = times.is_sorted();
        let scratch = Scratch::new();
        let tags: Vec<Tag> = times.iter().map(|&time| Tag::photon(1, time)).collect();
        let file = TagFile::open(scratch.file(&bytes_of(&tags))).unwrap();
        prop_assert_eq!(file.slice(from, from + length).is_ok(), sorted);
        times.sort_unstable();
        let tags: Vec<Tag> = times.iter().map(|&time| Tag::photon(1, time)).collect();
        let file = TagFile::open(scratch.file(&bytes_of(&tags))).unwrap();
        let range = file.slice(from, from + length).unwrap();
        let mut found = vec![];
        file.for_each(range, |tags| {
            found.extend(tags.iter().map(|tag| tag.time_ps));
            Ok::<_, TagError>(())
        }).unwrap();
        times.retain(|time| (from..from + length).contains(time));
        prop_assert_eq!(found, times);
    }
}

// Truth: worked out by hand.
#[test]
fn the_ends_of_time_do_not_overflow() {
    let tags = [
        Tag::photon(1, i64::MIN),
        Tag::photon(1, -1),
        Tag::photon(1, 0),
        Tag::photon(1, i64::MAX - 1),
        Tag::photon(1, i64::MAX),
    ];
    let bytes = bytes_of(&tags);
    let bin = |width, from, to| {
        let binned = Tags::new(&bytes).unwrap().bin(&Binning::new(&[1], width, from, to).unwrap());
        let counts: Vec<u64> = (0..binned.bins()).map(|bin| binned.counts(bin)[0]).collect();
        (counts, binned)
    };
    let (counts, binned) = bin(i64::MAX, i64::MIN, i64::MAX);
    // 2⁶⁴ − 1 ps in bins of 2⁶³ − 1 ps: two whole ones and 1 ps.
    assert_eq!(counts, [1, 2, 1]);
    assert_eq!((binned.start_ps(1), binned.start_ps(2)), (-1, i64::MAX - 1));
    assert_eq!((binned.length_ps(1), binned.length_ps(2)), (i64::MAX, 1));
    assert_eq!(binned.flags(2), CountFlags::PARTIAL);
    let (counts, _) = bin(1, i64::MAX - 2, i64::MAX);
    assert_eq!(counts, [0, 1]);
    let (counts, _) = bin(2, i64::MIN, i64::MIN + 3);
    assert_eq!(counts, [1, 0]);
    let (counts, _) = bin(3, i64::MAX - 3, i64::MAX);
    assert_eq!(counts, [1]);
}

// Truth: worked out by hand. The interval is closed at both ends.
#[test]
fn bins_that_touch_an_overflow_are_flagged() {
    let flagged = |tags: &[Tag]| -> String {
        let bytes = bytes_of(tags);
        let binned = Tags::new(&bytes).unwrap().bin(&Binning::new(&[1], 10, 0, 60).unwrap());
        let mark = |bin| if binned.flags(bin).contains(CountFlags::OVERFLOW) { 'x' } else { '.' };
        (0..binned.bins()).map(mark).collect()
    };
    let (begin, end) = (Tag::overflow_begin, Tag::overflow_end);
    assert_eq!(flagged(&[begin(19), end(20)]), ".xx...");
    assert_eq!(flagged(&[begin(10), end(10)]), ".x....");
    assert_eq!(flagged(&[begin(-5), end(-1)]), "......");
    assert_eq!(flagged(&[begin(-5), end(0)]), "x.....");
    assert_eq!(flagged(&[begin(60), end(90)]), "......");
    assert_eq!(flagged(&[begin(59), end(90)]), ".....x");
    assert_eq!(flagged(&[begin(-9), end(99)]), "xxxxxx");
    // No end: to the end of the file. No beginning: since the end before.
    assert_eq!(flagged(&[begin(35)]), "...xxx");
    assert_eq!(flagged(&[end(35)]), "xxxx..");
    assert_eq!(flagged(&[begin(1), end(2), end(35)]), "xxxx..");
    assert_eq!(flagged(&[begin(1), begin(15), end(25)]), "xxx...");
    // Types 1 to 4 and unknown ones are no photons.
    let bytes = bytes_of(
        &(0..=255).map(|kind_byte| Tag { kind_byte, ..Tag::photon(1, 5) }).collect::<Vec<_>>(),
    );
    let binned = Tags::new(&bytes).unwrap().bin(&Binning::new(&[1], 10, 0, 10).unwrap());
    assert_eq!(binned.counts(0), [1]);
}

#[test]
fn what_makes_no_sense_is_refused() {
    let refused = |channels: &[i32], width, from, to| {
        Binning::new(channels, width, from, to).unwrap_err().to_string()
    };
    assert_eq!(refused(&[1], 0, 0, 9), "a bin of 0 ps: it has to be at least 1 ps wide");
    assert_eq!(
        refused(&[1], i64::MIN, 0, 9),
        format!("a bin of {} ps: it has to be at least 1 ps wide", i64::MIN)
    );
    assert_eq!(
        refused(&[1], 1, 9, 9),
        "from 9 ps to 9 ps is no span: the end has to be later than the start"
    );
    let each = "each has to be named once, and at least one";
    assert_eq!(refused(&[], 1, 0, 9), format!("the channels []: {each}"));
    assert_eq!(refused(&[1, 2, 1], 1, 0, 9), format!("the channels [1, 2, 1]: {each}"));
    assert_eq!(
        refused(&[1, 2], 1, i64::MIN, i64::MAX),
        format!(
            "18446744073709551615 bins of 2 channels are more than the {MOST_CELLS} counts that are kept at once: take \
             wider bins or a shorter span"
        )
    );
    assert!(Binning::new(&[1, 2], 1, 0, MOST_CELLS as i64 / 2).is_ok());
}

// Truth: the report of a recording that was written by hand, oddity by oddity.
#[test]
fn a_check_finds_what_is_odd() {
    let tags = [
        Tag::photon(1, 100),
        Tag::photon(2, 100),
        Tag::photon(1, 100), // 2: a duplicate
        Tag::photon(2, 90),  // 3: out of order
        Tag { reserved: 1, ..Tag::photon(-1, 200) },
        Tag { kind_byte: 9, ..Tag::photon(1, 200) }, // 5
        Tag::error(300),                             // 6
        Tag::overflow_begin(400),
        Tag::missed_events(2, 7, 450),
        Tag::missed_events(2, 65_535, 460),
        Tag::overflow_end(500),
        Tag::overflow_end(600),   // no beginning
        Tag::overflow_begin(700), // no end
        Tag::photon(300, 5_000),
    ];
    let mut bytes = bytes_of(&tags);
    let path = Scratch::new();
    let file = TagFile::open(path.file(&bytes)).unwrap();
    let report = file.check(&CheckOptions { gap_ps: Some(1_000) }).unwrap();
    assert_eq!(report, Tags::new(&bytes).unwrap().check(&CheckOptions { gap_ps: Some(1_000) }));
    assert!(!report.is_clean());
    assert_eq!(report.records, 14);
    let channels: Vec<_> =
        report.channels.iter().map(|(n, c)| (*n, c.tags, c.missed, c.duplicates)).collect();
    assert_eq!(channels, [(-1, 1, 0, 0), (1, 2, 0, 1), (2, 2, 65_542, 0), (300, 1, 0, 0)]);
    assert_eq!((report.first_ps, report.last_ps), (Some(100), Some(5_000)));
    assert_eq!((report.earliest_ps, report.latest_ps), (Some(90), Some(5_000)));
    assert_eq!((report.unsorted, &*report.unsorted_at), (1, &[3][..]));
    assert_eq!((report.duplicates, &*report.duplicates_at), (1, &[2][..]));
    assert_eq!((report.reserved, &*report.reserved_at), (1, &[4][..]));
    assert_eq!((report.unknown, &*report.unknown_at), (1, &[5][..]));
    assert_eq!((report.errors, &*report.errors_at), (1, &[6][..]));
    let intervals: Vec<_> =
        report.overflow_intervals.iter().map(|o| (o.begin_ps, o.end_ps)).collect();
    assert_eq!(intervals, [(Some(400), Some(500)), (None, Some(600)), (Some(700), None)]);
    assert_eq!((report.overflows, report.unpaired, report.overflow_ps), (3, 2, 100));
    assert_eq!(report.missed, 65_542);
    assert_eq!((report.gaps, report.gaps_at[0].length_ps()), (1, 4_300));
    assert_eq!(report.longest_gap, Some(report.gaps_at[0]));
    assert_eq!(report.zeros_at_end, 0);
    bytes.extend([0; 32]);
    assert_eq!(Tags::new(&bytes).unwrap().check(&CheckOptions::default()).zeros_at_end, 2);
    assert!(Tags::new(&[]).unwrap().check(&CheckOptions::default()).is_clean());
}

#[test]
fn bins_become_a_series_that_astropy_could_read() {
    let tags = [
        Tag::photon(1, -1),
        Tag::photon(2, 100_000_000_400),
        Tag::missed_events(2, 9, 100_000_000_500),
        Tag::photon(1, 200_000_000_000),
    ];
    let bytes = bytes_of(&tags);
    let binning = Binning::new(&[1, 2], 100_000_000_000, 600, 200_000_000_600).unwrap();
    let binned = Tags::new(&bytes).unwrap().bin(&binning);
    let zero = parse_utc("2016-12-31T23:59:60.9Z").unwrap();
    let series = binned.to_series(zero, &["g", "r"], CountFlags::CLOCK_FREE).unwrap();
    let [first, second] = &*series.records else { panic!("{series:?}") };
    // 600 ps is nearest to 1 ns; 0.1 s after the leap second's 0.9 s the new year begins.
    assert_eq!(first.start, parse_utc("2016-12-31T23:59:60.900000001Z").unwrap());
    assert_eq!(second.start, parse_utc("2017-01-01T00:00:00.000000001Z").unwrap());
    assert_eq!((second.start_ps, second.length_ps), (100_000_000_600, 100_000_000_000));
    assert_eq!((&*first.counts, &*first.missed), (&[0, 1][..], &[0, 9][..]));
    assert_eq!(first.flags, CountFlags::MISSED | CountFlags::CLOCK_FREE);
    assert_eq!((&*second.counts, second.flags), (&[1, 0][..], CountFlags::CLOCK_FREE));
    let text = ecsv::to_string(&series.to_table().unwrap()).unwrap();
    let table = ecsv::read_str("c.ecsv", &text).unwrap();
    assert_eq!(CountSeries::from_table("c.ecsv", &table).unwrap(), series);
    let message = binned.to_series(zero, &["g"], CountFlags::empty()).unwrap_err().to_string();
    assert_eq!(message, "1 names for 2 channels: give one for each, in their order");
}

// 10⁶ pieces of random and of damaged bytes: no panic, and what is kept does not grow beyond the bytes.
#[test]
fn any_bytes_are_handled() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(6);
    let good = bytes_of(&poisson(6, &[1, 2], 5.0, 0, 8));
    let binning = Binning::new(&[1, 2], 7, -20, 100).unwrap();
    let mut bytes = vec![];
    for case in 0..1_000_000 {
        bytes.clear();
        if case % 2 == 0 {
            bytes.resize(random.random_range(0..80), 0);
            random.fill(&mut bytes[..]);
        } else {
            bytes.extend_from_slice(&good);
            for _ in 0..random.random_range(1..4) {
                let at = random.random_range(0..bytes.len());
                bytes[at] ^= 1 << random.random_range(0..8);
            }
            bytes.truncate(random.random_range(0..=good.len()));
        }
        let (tags, torn) = Tags::whole_records(&bytes);
        assert_eq!(tags.len() * 16 + torn.len(), bytes.len());
        assert_eq!(Tags::new(&bytes).is_ok(), torn.is_empty());
        let total: u64 = tags.bin(&binning).totals().iter().sum();
        assert!(total <= tags.len() as u64);
        let report = tags.check(&CheckOptions { gap_ps: Some(3) });
        assert_eq!(report.records, tags.len() as u64);
        if let Ok(part) = tags.slice(0, 50) {
            assert!(part.iter().all(|tag| (0..50).contains(&tag.time_ps)));
        }
    }
}
