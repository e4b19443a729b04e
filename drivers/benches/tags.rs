//! Tags binned per second on one core, beside what the memory itself gives: the same bytes copied, and summed.
//!
//! `cargo bench -p sunglint-drivers --bench tags`
//!
//! The file lies in the system's cache, so that the disk is not measured. All lines handle the same 2²⁴ tags, 256 MiB.

#![expect(clippy::unwrap_used, reason = "a benchmark that cannot run should stop")]

use divan::counter::{BytesCount, ItemsCount};
use divan::{Bencher, black_box};
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::sync::LazyLock;
use sunglint_drivers::ptu::PtuFile;
use sunglint_drivers::tags::{Binning, CheckOptions, Tag, TagFile, TagWriter, Tags};
use tempfile::NamedTempFile;

const TAGS: usize = 1 << 24;
/// Three SPADs at 1 MHz each.
const MEAN_GAP_PS: u64 = 333_333;

fn main() {
    // One core, in a pool of one thread.
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global().unwrap();
    divan::main();
}

static BYTES: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(5);
    let mut time_ps = 0;
    let mut bytes = Vec::with_capacity(16 * TAGS);
    for _ in 0..TAGS {
        time_ps += random.random_range(0..=2 * MEAN_GAP_PS) as i64;
        bytes.extend(Tag::photon(random.random_range(1..=4), time_ps).to_bytes());
    }
    bytes
});

static FILE: LazyLock<NamedTempFile> = LazyLock::new(|| {
    let file = NamedTempFile::new().unwrap();
    std::fs::write(file.path(), &*BYTES).unwrap();
    file
});

/// Bins of a width, for three of the four channels.
fn binning(width_ps: i64) -> Binning {
    let end_ps = Tag::from_bytes(BYTES.last_chunk().unwrap()).time_ps + 1;
    Binning::new(&[1, 2, 3], width_ps, 0, end_ps).unwrap()
}

/// 0.1 s (a light curve), 100 µs, and 1 µs (three tags a bin).
const WIDTHS_PS: [i64; 3] = [100_000_000_000, 100_000_000, 1_000_000];

#[divan::bench(args = WIDTHS_PS, sample_count = 5)]
fn bin_in_memory(bencher: Bencher, width_ps: i64) {
    let (tags, binning) = (Tags::new(&BYTES).unwrap(), binning(width_ps));
    bencher
        .counter(ItemsCount::new(TAGS))
        .counter(BytesCount::new(16 * TAGS))
        .bench_local(|| black_box(tags).bin(&binning));
}

#[divan::bench(args = WIDTHS_PS, sample_count = 5)]
fn bin_file(bencher: Bencher, width_ps: i64) {
    let (file, binning) = (TagFile::open(FILE.path()).unwrap(), binning(width_ps));
    bencher
        .counter(ItemsCount::new(TAGS))
        .counter(BytesCount::new(16 * TAGS))
        .bench_local(|| file.bin(&binning).unwrap());
}

#[divan::bench(sample_count = 5)]
fn check_file(bencher: Bencher) {
    let file = TagFile::open(FILE.path()).unwrap();
    bencher
        .counter(ItemsCount::new(TAGS))
        .counter(BytesCount::new(16 * TAGS))
        .bench_local(|| file.check(&CheckOptions::default()).unwrap());
}

#[divan::bench(sample_count = 5)]
fn write_file(bencher: Bencher) {
    let folder = tempfile::tempdir().unwrap();
    let tags: Vec<Tag> = Tags::new(&BYTES).unwrap().iter().collect();
    let path = folder.path().join("out.tags");
    bencher
        .counter(ItemsCount::new(TAGS))
        .counter(BytesCount::new(16 * TAGS))
        .with_inputs(|| {
            let _ = std::fs::remove_file(&path);
        })
        .bench_local_values(|()| {
            let mut writer = TagWriter::create(&path).unwrap();
            writer.write(&tags, std::time::Duration::ZERO).unwrap();
            writer.finish().unwrap()
        });
}

/// Tags out of a PTU file: 2²² records of a MultiHarp in T3 mode, a rollover in 16.
#[divan::bench(sample_count = 5)]
fn ptu_tags(bencher: Bencher) {
    const RECORDS: u32 = 1 << 22;
    let mut bytes = b"PQTTTR\0\x001.0.00\0\0".to_vec();
    let mut entry = |name: &str, kind: u32, value: u64| {
        let mut ident = name.as_bytes().to_vec();
        ident.resize(32, 0);
        bytes.extend(ident);
        bytes.extend((-1_i32).to_le_bytes());
        bytes.extend(kind.to_le_bytes());
        bytes.extend(value.to_le_bytes());
    };
    entry("TTResultFormat_TTTRRecType", 0x1000_0008, 0x0001_0307);
    entry("MeasDesc_GlobalResolution", 0x2000_0008, 1.2500317e-8_f64.to_bits());
    entry("MeasDesc_Resolution", 0x2000_0008, 5e-12_f64.to_bits());
    entry("Header_End", 0xffff_0008, 0);
    for i in 0..RECORDS {
        let record = if i % 16 == 15 { 0xfe00_0001 } else { (i % 4) << 25 | i << 6 & 0x1ff_ffff };
        bytes.extend(record.to_le_bytes());
    }
    let file = PtuFile::from_bytes("synthetic.ptu", bytes).unwrap();
    bencher
        .counter(ItemsCount::new(RECORDS))
        .bench_local(|| file.tags().map(|tag| tag.unwrap().time_ps).max());
}

/// Memory bandwidth: the same bytes copied.
#[divan::bench(sample_count = 5)]
fn memory_copy(bencher: Bencher) {
    let mut to = vec![0; BYTES.len()];
    bencher
        .counter(ItemsCount::new(TAGS))
        .counter(BytesCount::new(16 * TAGS))
        .bench_local(|| black_box(&mut to).copy_from_slice(black_box(&BYTES)));
}

/// Memory bandwidth: the same bytes read and summed.
#[divan::bench(sample_count = 5)]
fn memory_sum(bencher: Bencher) {
    bencher.counter(ItemsCount::new(TAGS)).counter(BytesCount::new(16 * TAGS)).bench_local(|| {
        let (words, _) = black_box(&*BYTES).as_chunks();
        words.iter().fold(0_u64, |sum, &word| sum.wrapping_add(u64::from_le_bytes(word)))
    });
}

/// The file read in the same pieces, and nothing done with it.
#[divan::bench(sample_count = 5)]
fn read_file(bencher: Bencher) {
    let file = TagFile::open(FILE.path()).unwrap();
    bencher.counter(ItemsCount::new(TAGS)).counter(BytesCount::new(16 * TAGS)).bench_local(|| {
        file.for_each(0..file.len(), |tags| {
            black_box(tags.records());
            Ok::<_, sunglint_formats::FileError>(())
        })
        .unwrap()
    });
}
