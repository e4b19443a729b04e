//! PTU files: ours written here (synthetic) and decoded by ptufile too; one written by ptufile.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use rand::{Rng as _, RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use sunglint_drivers::ptu::{
    Decoder, MARKER_CHANNEL, MOST_ENTRIES, PtuFile, Record, RecordType, Value,
};
use sunglint_drivers::tags::{Binning, Tag, Tags};
use sunglint_formats::CountFlags;

const INT: u32 = 0x1000_0008;
const FLOAT: u32 = 0x2000_0008;
const ANSI: u32 = 0x4001_ffff;
const WIDE: u32 = 0x4002_ffff;
const BLOB: u32 = 0xffff_ffff;
const EMPTY: u32 = 0xffff_0008;

/// A header as PicoQuant's format page describes it.
struct Writer(Vec<u8>);

impl Writer {
    fn new() -> Self {
        Self(b"PQTTTR\0\x001.0.00\0\0".to_vec())
    }

    fn entry(mut self, name: &str, index: i32, kind: u32, value: u64) -> Self {
        let mut bytes = name.as_bytes().to_vec();
        bytes.resize(32, 0);
        self.0.extend(bytes);
        self.0.extend(index.to_le_bytes());
        self.0.extend(kind.to_le_bytes());
        self.0.extend(value.to_le_bytes());
        self
    }

    fn int(self, name: &str, value: i64) -> Self {
        self.entry(name, -1, INT, value as u64)
    }

    fn float(self, name: &str, value: f64) -> Self {
        self.entry(name, -1, FLOAT, value.to_bits())
    }

    fn with(self, name: &str, kind: u32, more: &[u8]) -> Self {
        let mut out = self.entry(name, -1, kind, more.len() as u64);
        out.0.extend(more);
        out
    }

    fn end(self) -> Self {
        self.entry("Header_End", -1, EMPTY, 0)
    }

    fn records(mut self, records: &[u32]) -> Vec<u8> {
        self.0.extend(records.iter().flat_map(|record| record.to_le_bytes()));
        self.0
    }
}

fn file_of(kind: RecordType, global_s: f64, records: &[u32]) -> Vec<u8> {
    Writer::new()
        .with("File_Comment", ANSI, b"synthetic\0\0\0\0\0\0\0")
        .int("Measurement_Mode", if kind.is_t3() { 3 } else { 2 })
        .int("Measurement_SubMode", 0)
        .int("TTResultFormat_TTTRRecType", kind.number())
        .int("TTResultFormat_BitsPerRecord", 32)
        .float("MeasDesc_GlobalResolution", global_s)
        .float("MeasDesc_Resolution", 4e-12)
        .int("TTResult_NumberOfRecords", records.len() as i64)
        .end()
        .records(records)
}

fn read(bytes: Vec<u8>) -> PtuFile {
    PtuFile::from_bytes("synthetic.ptu", bytes).unwrap()
}

fn refused(bytes: Vec<u8>) -> String {
    PtuFile::from_bytes("x.ptu", bytes).unwrap_err().to_string()
}

/// Records of all documented kinds, laid out here by hand after the format page: nothing of the product is used.
fn records_of(kind: RecordType, seed: u64, count: usize) -> Vec<u32> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut one = || {
        let roll = random.random_range(0..100);
        let time: u32 = random.next_u32();
        let markers = random.random_range(1..16_u32);
        match kind {
            RecordType::PicoHarpT2 => match roll {
                0..10 => 0xf000_0000,
                10..20 => 0xf000_0000 | (time & 0x0fff_fff0) | markers,
                _ => random.random_range(0..5) << 28 | (time & 0x0fff_ffff),
            },
            RecordType::PicoHarpT3 => match roll {
                0..10 => 0xf000_0000 | (time & 0xffff),
                10..20 => 0xf000_0000 | markers << 16 | (time & 0xffff),
                _ => random.random_range(1..5) << 28 | (time & 0x0fff_ffff),
            },
            _ => {
                let clock_bits = if kind.is_t3() { 10 } else { 25 };
                let clock = time & ((1 << clock_bits) - 1);
                match roll {
                    // Rollovers: none counted (old firmware), one, some.
                    0..3 => 1 << 31 | 63 << 25,
                    3..6 => 1 << 31 | 63 << 25 | 1,
                    6..12 => 1 << 31 | 63 << 25 | (time & 0x3f),
                    12..20 => 1 << 31 | markers << 25 | clock,
                    20..30 if !kind.is_t3() => 1 << 31 | clock,
                    _ => random.random_range(0..64) << 25 | (time & 0x01ff_ffff),
                }
            }
        }
    };
    (0..count).map(|_| one()).collect()
}

/// A record as ptufile 2026.2.6 prints it: time, channel (−1 for none), marker bits, dtime (−1 for none).
fn as_ptufile(kind: RecordType, record: Record, raw: u32) -> [i64; 4] {
    // ptufile counts the inputs of a HydraHarp from 0 and gives its sync input the same 0, and a PicoHarp's from 0 in T3
    // mode and from 1 in T2 mode (0 is the sync there).
    let first = if kind == RecordType::PicoHarpT2 { 0 } else { 1 };
    match record {
        Record::Photon { input, count, dtime } => {
            [count as i64, i64::from(input) - first, 0, dtime.map_or(-1, i64::from)]
        }
        Record::Sync { count } => [count as i64, 0, 0, -1],
        Record::Markers { bits, count } => {
            // It leaves the bits of a PicoHarp's markers in the time.
            let rest = if kind == RecordType::PicoHarpT2 { raw & 0xf } else { 0 };
            [count as i64 + i64::from(rest), -1, bits.into(), -1]
        }
        Record::Rollover { .. } => [-1, -1, 0, -1],
        Record::Unknown { .. } => panic!("{record:?}"),
    }
}

const DECODE: &str = "
import sys, ptufile
for name in sys.argv[1:]:
    with ptufile.PtuFile(name) as ptu:
        print('file', ptu.record_type.name, ptu.number_records)
        d = ptu.decode_records()
        dtime = d['dtime'].view('u2') if ptu.is_t3 else None
        for i in range(len(d)):
            channel, marker = int(d['channel'][i]), int(d['marker'][i])
            rollover = channel < 0 and marker == 0
            t = -1 if rollover else int(d['time'][i])
            photon = channel >= 0
            print(t, channel, marker, int(dtime[i]) if photon and dtime is not None else -1)
";

// Truth: ptufile 2026.2.6 (C. Gohlke, BSD), an independent decoder, record by record and exactly, on files of ours
// (synthetic) of all twelve record types with rollovers, markers and syncs. Where it differs by choice, see `as_ptufile`.
#[test]
fn records_are_those_of_ptufile() {
    let test = "records_are_those_of_ptufile";
    let Some(python) = sunglint_testkit::peer_python(test, &["ptufile", "numpy"]) else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut names = vec![];
    let mut expected = String::new();
    let mut rollovers = 0;
    for (seed, kind) in (1..).zip(RecordType::ALL) {
        let raws = records_of(kind, seed, 5_000);
        let bytes = file_of(kind, 1e-9, &raws);
        let path = folder.path().join(format!("{kind:?}.ptu"));
        std::fs::write(&path, &bytes).unwrap();
        names.push(path.display().to_string());
        let file = PtuFile::open(&path).unwrap();
        assert_eq!((file.record_type(), file.len()), (kind, 5_000));
        assert_eq!(file.header().text("File_Comment"), Some("synthetic"));
        expected += &format!("file {kind:?} 5000\n");
        for (record, raw) in file.records().zip(raws) {
            let record = record.unwrap();
            rollovers += u32::from(matches!(record, Record::Rollover { .. }));
            let [time, channel, marker, dtime] = as_ptufile(kind, record, raw);
            expected += &format!("{time} {channel} {marker} {dtime}\n");
        }
    }
    assert!(rollovers > 5_000, "{rollovers}");
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let printed = sunglint_testkit::run_python(&python, DECODE, &names);
    for (number, (theirs, ours)) in printed.lines().zip(expected.lines()).enumerate() {
        assert_eq!(theirs, ours, "line {number}");
    }
    assert_eq!(printed.lines().count(), expected.lines().count());
}

// Truth: an image that ptufile 2026.2.6 wrote itself (T3, PicoHarp and Generic records): as many photons in each channel
// and delay as its pixels hold.
#[test]
fn files_of_ptufile_are_read() {
    let test = "files_of_ptufile_are_read";
    let Some(python) = sunglint_testkit::peer_python(test, &["ptufile", "numpy"]) else { return };
    let folder = tempfile::tempdir().unwrap();
    let script = "
import sys, numpy, ptufile
image = numpy.random.default_rng(7).poisson(0.4, (2, 9, 8, 2, 60)).astype('u1')
for name, kind in zip(sys.argv[1:], (ptufile.PtuRecordType.PicoHarpT3, ptufile.PtuRecordType.GenericT3)):
    ptufile.imwrite(name, image, 5e-8, 1e-11, 1e-4, record_type=kind)
print(*image.sum(axis=(0, 1, 2)).ravel())
";
    let paths = ["p.ptu", "g.ptu"].map(|name| folder.path().join(name).display().to_string());
    let printed =
        sunglint_testkit::run_python(&python, script, &[paths[0].as_str(), paths[1].as_str()]);
    let theirs: Vec<u64> = printed.split_whitespace().map(|n| n.parse().unwrap()).collect();
    for (path, kind) in paths.iter().zip([RecordType::PicoHarpT3, RecordType::GenericT3]) {
        let file = PtuFile::open(path).unwrap();
        assert_eq!(file.record_type(), kind);
        let mut ours = vec![0; 120];
        let mut lines = 0;
        for record in file.records() {
            match record.unwrap() {
                Record::Photon { input, dtime: Some(dtime), .. } => {
                    ours[60 * (usize::from(input) - 1) + usize::from(dtime)] += 1;
                }
                Record::Markers { bits, .. } => lines += u32::from(bits & 1),
                Record::Rollover { .. } => {}
                other => panic!("{other:?}"),
            }
        }
        assert_eq!(ours, theirs);
        assert_eq!(lines, 2 * 9);
        // 2 × 9 lines of 8 pixels of 100 µs, with the pauses between that the writer makes.
        let last = file.tags().last().unwrap().unwrap();
        assert!((14_400_000_000..30_000_000_000).contains(&last.time_ps), "{last:?}");
        assert!(file.header().float("ImgHdr_TimePerPixel").is_some());
    }
}

// Truth: worked out by hand from the format page.
#[test]
fn tags_of_t2_and_t3() {
    let t2 = [
        1 << 31 | 7,                // sync at 7
        5 << 25 | 9,                // input 6 at 9
        1 << 31 | 63 << 25 | 3,     // three rollovers
        0b0101 << 25 | 1 << 31 | 2, // markers 1 and 3 at 3·2²⁵ + 2
        1 << 31 | 40 << 25 | 1,     // nobody knows
        63 << 25 | 0x01ff_ffff,     // input 64 at 4·2²⁵ − 1
    ];
    let tags: Vec<Tag> =
        read(file_of(RecordType::GenericT2, 5e-12, &t2)).tags().map(Result::unwrap).collect();
    let turn = 5 * (1 << 25);
    assert_eq!(
        tags,
        [
            Tag::photon(0, 35),
            Tag::photon(6, 45),
            Tag::photon(MARKER_CHANNEL + 1, 3 * turn + 10),
            Tag::photon(MARKER_CHANNEL + 3, 3 * turn + 10),
            Tag::error(3 * turn),
            Tag::photon(64, 4 * turn - 5),
        ]
    );
    // What nobody knows flags its bin.
    let bytes: Vec<u8> = tags.iter().flat_map(Tag::to_bytes).collect();
    let binning = Binning::new(&[6, 64], turn, 0, 4 * turn).unwrap();
    let binned = Tags::new(&bytes).unwrap().bin(&binning);
    let bins: Vec<_> = (0..4).map(|bin| (binned.counts(bin).to_vec(), binned.flags(bin))).collect();
    let none = CountFlags::empty();
    let zeros = (vec![0, 0], none);
    assert_eq!(bins, [(vec![1, 0], none), zeros.clone(), zeros, (vec![0, 1], CountFlags::ERROR)]);

    // A period of 12,500.5 ps and delays of 4 ps: rounded once.
    let t3 = [
        2 << 28 | 100 << 16 | 3,   // input 2, 3 syncs and 400 ps
        0xf000_0000,               // a rollover
        0xf000_0000 | 2 << 16 | 1, // marker 2 at 65,537 syncs
        9 << 28,                   // no such input
    ];
    let file = read(file_of(RecordType::PicoHarpT3, 1.25005e-8, &t3));
    let tags: Vec<Tag> = file.tags().map(Result::unwrap).collect();
    assert_eq!(
        tags,
        [
            Tag::photon(2, 37_902),
            Tag::photon(MARKER_CHANNEL + 2, 819_245_269),
            Tag::error(819_232_768),
        ]
    );
}

// Truth: the records as they are written out here.
#[test]
fn the_fixture_is_what_its_readme_says() {
    let special = 1 << 31;
    let rollover = special | 63 << 25;
    let records = [
        special | 10,          // sync at 10
        20,                    // input 1 at 20
        1 << 25 | 0x01ff_ffff, // input 2 at 2²⁵ − 1
        rollover | 1,
        special | 2 << 25 | 30, // marker 2 at 2²⁵ + 30
        rollover,               // one rollover, as old firmware wrote it
        rollover | 2,
        special | 50 << 25, // not defined, at 4·2²⁵
        40,                 // input 1 at 4·2²⁵ + 40
    ];
    let bytes = file_of(RecordType::GenericT2, 1e-12, &records);
    let path = sunglint_testkit::fixture("tags/generic_t2.ptu");
    if std::env::var_os("SUNGLINT_WRITE_FIXTURES").is_some() {
        std::fs::write(&path, &bytes).unwrap();
    }
    assert_eq!(std::fs::read(&path).unwrap(), bytes);
    let tags: Vec<Tag> = PtuFile::open(&path).unwrap().tags().map(Result::unwrap).collect();
    let turn = 1 << 25;
    assert_eq!(
        tags,
        [
            Tag::photon(0, 10),
            Tag::photon(1, 20),
            Tag::photon(2, turn - 1),
            Tag::photon(MARKER_CHANNEL + 2, turn + 30),
            Tag::error(4 * turn),
            Tag::photon(1, 4 * turn + 40),
        ]
    );
}

// Truth: the rollovers of the format page, counted by hand.
#[test]
fn the_clock_unrolls() {
    for (kind, rollover, turn) in [
        (RecordType::PicoHarpT2, 0xf000_0000, 210_698_240),
        (RecordType::PicoHarpT3, 0xf000_0000, 65_536),
        (RecordType::HydraHarpT2, 0xfe00_0009, 33_552_000),
        (RecordType::HydraHarpT3, 0xfe00_0009, 1_024),
        (RecordType::HydraHarp2T2, 0xfe00_0000, 33_554_432),
        (RecordType::GenericT3, 0xfe00_0000, 1_024),
    ] {
        let mut decoder = Decoder::new(kind);
        assert_eq!(decoder.decode(rollover), Ok(Record::Rollover { times: 1 }));
        decoder.decode(rollover).unwrap();
        let Ok(Record::Photon { count, .. }) = decoder.decode(0x1000_0002) else { panic!() };
        assert_eq!(count, 2 * turn + 2, "{kind:?}");
    }
    // Beyond 64 bits, and before that beyond 63 bits of ps.
    let records = [0xffff_ffff; 40_000];
    let file = read(file_of(RecordType::GenericT2, 1e-12, &records));
    let error = file.records().find_map(Result::err).unwrap().to_string();
    assert!(error.ends_with("the clock rolled over so often that its count is beyond 64 bits, expected a clock within 64 bits"), "{error}");
    assert_eq!(file.records().filter(Result::is_err).count(), 1);
    let file = read(file_of(RecordType::GenericT2, 1e-6, &[[0xffff_ffff; 40], [5; 40]].concat()));
    let error = file.tags().find_map(Result::err).unwrap().to_string();
    // 40·(2²⁵ − 1)·2²⁵ + 5 µs are 1,427 years. The header is 16 + 9 · 48 bytes and a text of 16.
    assert_eq!(
        error,
        "synthetic.ptu: byte 624 (record 40): found Photon { input: 1, count: 45035994931527685, dtime: None }, expected a \
         time of at most 2^63 ps (107 days)"
    );
    assert!(file.records().all(|record| record.is_ok()));
}

#[test]
fn headers_of_all_kinds_of_entries() {
    let floats: Vec<u8> = [0.5_f64, -2.0].iter().flat_map(|f| f.to_le_bytes()).collect();
    let wide: Vec<u8> = "Höhe\0\0".encode_utf16().flat_map(u16::to_le_bytes).collect();
    let bytes = Writer::new()
        .entry("Yes", -1, 8, 1)
        .entry("Bits", -1, 0x1100_0008, u64::MAX)
        .entry("Color", -1, 0x1200_0008, 3)
        .entry("File_CreatingTime", -1, 0x2100_0008, 45_000.25_f64.to_bits())
        .with("Numbers", 0x2001_ffff, &floats)
        .with("Old", ANSI, b"H\xf6he\0\0\0\0")
        .with("Wide", WIDE, &wide)
        .with("Blob", BLOB, &[1, 2, 3, 4, 5, 6, 7, 8])
        .entry("List", 0, INT, 4)
        .entry("List", 1, INT, 5)
        .int("TTResultFormat_TTTRRecType", 0x0001_0207)
        .float("MeasDesc_GlobalResolution", 1.0)
        .float("MeasDesc_GlobalResolution", 1e-12)
        .int("TTResult_NumberOfRecords", -1)
        .end()
        .records(&[1, 2]);
    let file = read(bytes);
    let header = file.header();
    assert_eq!(header.version, "1.0.00");
    let value = |name: &str| header.get(name).map(|entry| entry.value.clone());
    assert_eq!(value("Yes"), Some(Value::Bool(true)));
    assert_eq!(value("Bits"), Some(Value::Bits(u64::MAX)));
    assert_eq!(value("Color"), Some(Value::Color(3)));
    assert_eq!(value("File_CreatingTime"), Some(Value::Days(45_000.25)));
    assert_eq!(value("Numbers"), Some(Value::Floats(vec![0.5, -2.0])));
    assert_eq!((header.text("Old"), header.text("Wide")), (Some("Höhe"), Some("Höhe")));
    let Some(Value::Blob { at_byte, bytes: 8 }) = value("Blob") else { panic!() };
    assert_eq!(at_byte, header.get("Blob").unwrap().at_byte + 48);
    assert_eq!(value("List"), None);
    assert_eq!(header.entries.iter().filter(|entry| entry.name == "List").count(), 2);
    // The last of two stands; a number of records below 1 means all that are there.
    assert_eq!(file.global_resolution().ps(3), Some(3));
    assert_eq!((file.len(), file.trailing_bytes()), (2, 0));
}

#[test]
fn what_is_wrong_is_named_with_its_byte() {
    let good = || {
        Writer::new()
            .int("TTResultFormat_TTTRRecType", 0x0001_0307)
            .float("MeasDesc_GlobalResolution", 5e-8)
            .float("MeasDesc_Resolution", 4e-12)
    };
    assert_eq!(
        refused(vec![]),
        "x.ptu: byte 0: found the end of the file at byte 0, expected the magic bytes PQTTTR, 8 bytes"
    );
    assert_eq!(
        refused(b"PQHISTO\x001.0.00\0\0".to_vec()),
        "x.ptu: byte 0: found PQHISTO\\x00, expected PQTTTR, with which a PTU file begins"
    );
    assert_eq!(
        refused(good().records(&[])),
        "x.ptu: byte 160: found the end of the file at byte 160, expected an entry of the header, 48 bytes"
    );
    assert_eq!(
        refused(good().entry("Odd", -1, 0x77, 0).end().records(&[])),
        "x.ptu: byte 160: found `Odd` of type 0x00000077, expected an entry of a type that is defined"
    );
    // Lengths that lie.
    assert_eq!(
        refused(good().entry("Text", -1, ANSI, 1 << 40).end().records(&[])),
        "x.ptu: byte 208: found the end of the file at byte 256, expected the value of `Text`, 1099511627776 bytes"
    );
    assert_eq!(
        refused(good().entry("Blob", -1, BLOB, u64::MAX).end().records(&[])),
        "x.ptu: byte 200: found a length of -1 bytes, expected the value of `Blob`"
    );
    let many = (0..=MOST_ENTRIES).fold(Writer::new(), |writer, _| writer.int("A", 1));
    let message = refused(many.end().records(&[]));
    assert_eq!(
        message,
        "x.ptu: byte 3145744: found more than 65536 entries, expected `Header_End` before"
    );
    // Entries that are missing or make no sense.
    assert_eq!(
        refused(Writer::new().end().records(&[])),
        "x.ptu: byte 64: TTResultFormat_TTTRRecType: found no such entry before the header's end, expected the number of a \
         documented T2 or T3 record type"
    );
    assert_eq!(
        refused(Writer::new().int("TTResultFormat_TTTRRecType", 0x0101_0205).end().records(&[])),
        "x.ptu: byte 16: TTResultFormat_TTTRRecType: found 0x01010205, expected the number of a documented T2 or T3 record \
         type"
    );
    assert_eq!(
        refused(good().float("MeasDesc_Resolution", -1.0).end().records(&[])),
        "x.ptu: byte 160: MeasDesc_Resolution: found Float(-1.0), expected a number from 1e-16 to 3.6e3 s"
    );
    assert_eq!(
        refused(good().int("TTResultFormat_BitsPerRecord", 64).end().records(&[])),
        "x.ptu: byte 160: TTResultFormat_BitsPerRecord: found Int(64), expected 32"
    );
    // Records that are not there.
    let short = || good().int("TTResult_NumberOfRecords", i64::MAX).end().records(&[1, 2, 3]);
    assert_eq!(
        refused(short()),
        "x.ptu: byte 160: TTResult_NumberOfRecords: found 9223372036854775807 promised and 3 in the file, expected all \
         records of 4 bytes (recover the 3 whole records)"
    );
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.ptu");
    let mut bytes = short();
    bytes.push(7);
    std::fs::write(&path, &bytes).unwrap();
    let file = PtuFile::recover(&path).unwrap();
    assert_eq!((file.len(), file.trailing_bytes()), (3, 1));
    assert_eq!(file.records().count(), 3);
    let mut torn = good().end().records(&[1]);
    torn.extend([1, 2]);
    assert!(refused(torn).contains("found 2 bytes of a record that is torn"));
    // A file that shrinks.
    std::fs::write(&path, file_of(RecordType::GenericT2, 1e-12, &[1; 100_000])).unwrap();
    let file = PtuFile::open(&path).unwrap();
    std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(200_000).unwrap();
    let errors: Vec<_> = file.records().filter_map(Result::err).collect();
    assert_eq!(errors.len(), 1);
    assert!(errors[0].to_string().ends_with("(another program cut it)"), "{}", errors[0]);
}

// 10⁶ damaged and random files: no panic, and no more records than there are bytes for.
#[test]
fn any_bytes_are_handled() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(8);
    let kinds = RecordType::ALL;
    let good: Vec<Vec<u8>> =
        kinds.iter().map(|&kind| file_of(kind, 1e-12, &records_of(kind, 9, 12))).collect();
    let mut read = 0;
    for case in 0..1_000_000 {
        let mut bytes = good[case % good.len()].clone();
        match case % 5 {
            0 => {
                let header = bytes.len() - 48;
                random.fill(&mut bytes[header..]);
            }
            1 => random.fill(&mut bytes[16..]),
            _ => {
                for _ in 0..random.random_range(1..6) {
                    let at = random.random_range(0..bytes.len());
                    bytes[at] ^= 1 << random.random_range(0..8);
                }
            }
        }
        if case % 3 == 0 {
            bytes.truncate(random.random_range(0..=bytes.len()));
        }
        let most = bytes.len() / 4;
        if let Ok(file) = PtuFile::from_bytes("x.ptu", bytes) {
            read += 1;
            assert!(file.records().count() <= most);
            assert!(file.tags().count() <= 13 * most);
        }
    }
    assert!(read > 100_000, "{read} files could be read");
}
