//! Files of tags: written, torn, cut, out of order.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use std::path::{Path, PathBuf};
use std::time::Duration;
use sunglint_drivers::tags::{Binning, CheckOptions, Tag, TagError, TagFile, TagWriter};
use sunglint_formats::CountFlags;

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

// Truth: the records as they are written out here; the README beside the files says what they are for.
#[test]
fn the_fixtures_are_what_their_readme_says() {
    let odd = [
        Tag::photon(1, 1_000),
        Tag::photon(2, 1_000),
        Tag::photon(1, 1_000),
        Tag::photon(-1, 40_000),
        Tag::photon(2, 39_000),
        Tag::error(50_000),
        Tag::overflow_begin(150_000_000),
        Tag::missed_events(2, 300, 160_000_000),
        Tag::overflow_end(250_000_000),
        Tag { kind_byte: 9, ..Tag::photon(1, 260_000_000) },
        Tag { reserved: 7, ..Tag::photon(1, 270_000_000) },
        Tag::photon(3, 350_000_000),
    ];
    let mut torn = bytes_of(&odd[..3]);
    torn.extend(&bytes_of(&odd[3..4])[..5]);
    for (name, bytes) in [("odd.tags", bytes_of(&odd)), ("torn.tags", torn), ("empty.tags", vec![])]
    {
        let path = sunglint_testkit::fixture("tags").join(name);
        if std::env::var_os("SUNGLINT_WRITE_FIXTURES").is_some() {
            std::fs::write(&path, &bytes).unwrap();
        }
        assert_eq!(std::fs::read(&path).unwrap(), bytes, "{name}");
    }
    let odd = TagFile::open(sunglint_testkit::fixture("tags/odd.tags")).unwrap();
    let binned = odd.bin(&Binning::new(&[1, 2], 100_000_000, 0, 400_000_000).unwrap()).unwrap();
    let bins: Vec<_> = (0..4).map(|b| (binned.counts(b).to_vec(), binned.flags(b))).collect();
    assert_eq!(
        bins,
        [
            (vec![2, 2], CountFlags::ERROR),
            (vec![0, 0], CountFlags::OVERFLOW | CountFlags::MISSED),
            (vec![1, 0], CountFlags::OVERFLOW),
            (vec![0, 0], CountFlags::empty()),
        ]
    );
    assert!(TagFile::open(sunglint_testkit::fixture("tags/torn.tags")).is_err());
}

#[test]
fn files_that_are_torn_say_where_and_are_recovered() {
    let scratch = Scratch::new();
    let tags = [Tag::photon(1, 5), Tag::photon(2, 6), Tag::photon(0, 0)];
    let mut bytes = bytes_of(&tags);
    bytes.extend([0; 40]);
    let path = scratch.file(&bytes);
    let message = TagFile::open(&path).unwrap_err().to_string();
    assert_eq!(
        message,
        format!(
            "{}: byte 80: found 8 bytes of a record that is torn, expected whole records of 16 bytes (recover the 5 whole \
             records before it)",
            path.display()
        )
    );
    let (file, recovered) = TagFile::recover(&path).unwrap();
    assert_eq!((recovered.records, recovered.zero_records, recovered.torn_bytes), (2, 3, 8));
    assert_eq!((file.len(), file.get(1).unwrap()), (2, tags[1]));
    let beyond = file.get(6).unwrap_err().to_string();
    assert!(
        beyond.ends_with("byte 96: found the end of the file at byte 88, expected bytes up to 112"),
        "{beyond}"
    );
    assert!(file.get(u64::MAX).is_err());

    // Appending cuts the same, and goes on.
    let (mut writer, cut) = TagWriter::append(&path).unwrap();
    assert_eq!((cut, writer.records()), (56, 2));
    writer.write(&[Tag::photon(3, 7)], Duration::ZERO).unwrap();
    assert_eq!(writer.finish().unwrap(), 3);
    assert_eq!(std::fs::read(&path).unwrap(), bytes_of(&[tags[0], tags[1], Tag::photon(3, 7)]));

    // All zeros, empty, and what is no file.
    let (file, recovered) = TagFile::recover(scratch.file(&[0; 16 * 40_000])).unwrap();
    assert_eq!((file.len(), recovered.zero_records), (0, 40_000));
    let file = TagFile::open(scratch.file(&[])).unwrap();
    assert!(file.is_empty());
    assert_eq!(file.slice(0, 9).unwrap(), 0..0);
    assert_eq!(file.bin(&Binning::new(&[1], 1, 0, 1).unwrap()).unwrap().totals(), [0]);
    let folder = TagFile::open(scratch.0.path()).unwrap_err().to_string();
    assert!(folder.contains("it is a folder, not a file"), "{folder}");
    if Path::new("/dev/zero").exists() {
        assert!(TagFile::open("/dev/zero").is_err());
        assert!(TagWriter::append("/dev/zero").is_err());
    }
}

#[test]
fn a_file_that_shrinks_is_an_error() {
    let scratch = Scratch::new();
    let path = scratch.file(&bytes_of(&vec![Tag::photon(1, 5); 100_000]));
    let file = TagFile::open(&path).unwrap();
    std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(16 * 50_000).unwrap();
    let binning = Binning::new(&[1], 10, 0, 10).unwrap();
    for message in [
        file.bin(&binning).unwrap_err().to_string(),
        file.check(&CheckOptions::default()).unwrap_err().to_string(),
        file.slice(0, 9).unwrap_err().to_string(),
    ] {
        assert!(message.contains("expected the 1600000 bytes that it had"), "{message}");
        assert!(message.ends_with("(another program cut it)"), "{message}");
    }
}

#[test]
fn a_writer_syncs_by_the_callers_clock_and_never_overwrites() {
    let scratch = Scratch::new();
    let path = scratch.0.path().join("night.tags");
    let on_disk = || std::fs::metadata(&path).unwrap().len();
    let mut writer = TagWriter::create(&path).unwrap();
    let tag = Tag::photon(1, 1);
    let at = Duration::from_millis;
    writer.write(&[tag; 3], at(70_000)).unwrap();
    writer.write(&[tag; 3], at(70_499)).unwrap();
    assert_eq!(on_disk(), 0);
    writer.tick(at(70_500)).unwrap();
    assert_eq!(on_disk(), 6 * 16);
    // Many at once go through in whole records.
    writer.write(&vec![tag; 100_000], at(70_501)).unwrap();
    assert_eq!(on_disk() % 16, 0);
    assert!(on_disk() > 1_000_000);
    assert_eq!(writer.records(), 100_006);
    // Nobody else writes meanwhile.
    let message = TagWriter::append(&path).unwrap_err().to_string();
    assert!(message.ends_with("another program is writing to it"), "{message}");
    // A clock that runs backwards syncs nothing and harms nothing.
    writer.tick(at(1)).unwrap();
    drop(writer);
    assert_eq!(on_disk(), 100_006 * 16);
    let message = TagWriter::create(&path).unwrap_err().to_string();
    assert!(message.contains("is there already"), "{message}");
}

// Truth: the one place where the file is out of order.
#[test]
fn disorder_is_found_at_every_place() {
    let scratch = Scratch::new();
    let times: Vec<i64> = (0..40_000).map(|i| i * 10).collect();
    // 16,384 records are read at once.
    for place in [1, 16_383, 16_384, 16_385, 32_768, 39_999] {
        let mut times = times.clone();
        times[place] = times[place - 1] - 1;
        let tags: Vec<Tag> = times.iter().map(|&time| Tag::photon(1, time)).collect();
        let bytes = bytes_of(&tags);
        let file = TagFile::open(scratch.file(&bytes)).unwrap();
        for error in [file.slice(0, 9), file.slice(0, 9)] {
            let Err(TagError::Unsorted { record, time_ps, before_ps }) = error else { panic!() };
            assert_eq!((record, time_ps), (place as u64, before_ps - 1));
        }
        let report = file.check(&CheckOptions::default()).unwrap();
        assert_eq!((report.unsorted, &*report.unsorted_at), (1, &[place as u64][..]));
    }
}
