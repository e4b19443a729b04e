//! Memory that tags and PTU files need, however many bins, records or promises a file has.

// The counting allocator is the only unsafe code, and only in this test.
#![allow(unsafe_code, reason = "an allocator that counts")]
#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use sunglint_drivers::ptu::PtuFile;
use sunglint_drivers::tags::{Binning, CheckOptions, Tag, TagFile};

struct Counting;

static NOW: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let now = NOW.fetch_add(layout.size(), Relaxed) + layout.size();
        PEAK.fetch_max(now, Relaxed);
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        NOW.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller's promises are passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// The most bytes that were held while `work` ran, beyond those before.
fn peak_of(work: impl FnOnce()) -> usize {
    let before = NOW.load(Relaxed);
    PEAK.store(before, Relaxed);
    work();
    PEAK.load(Relaxed) - before
}

// One test in a process of its own, so that no other allocates meanwhile.
// Truth: an allocator that counts. The bounds are what the documentation says: for bins, two numbers of 8 bytes for each
// count, 12 bytes for each bin, and per thread a few pieces of 65,536 records at less than 120 bytes; for headers, the
// bytes that are there.
#[test]
fn memory_is_bounded_by_what_is_there() {
    if !sunglint_testkit::alone("memory_is_bounded_by_what_is_there") {
        return;
    }
    const MIB: usize = 1 << 20;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.tags");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();

    // A million tags (16 MB) that jump from one end of the span to the other, every fourth an overflow.
    let tag = |i: i64| match i % 4 {
        0 => Tag::overflow_begin(i * 7_919 % 2_000_000),
        1 => Tag::overflow_end(i * 104_729 % 2_000_000),
        2 => Tag::missed_events(1, 9, i),
        _ => Tag::photon((i % 3_000_000) as i32, i * 1_299_709 % 2_000_000),
    };
    let bytes: Vec<u8> = (0..1_000_000).flat_map(|i| tag(i).to_bytes()).collect();
    std::fs::write(&path, bytes).unwrap();
    let file = TagFile::open(&path).unwrap();
    let binning = Binning::new(&[1, 3], 1, 0, 2_000_000).unwrap();
    let bound = 2_000_000 * (2 * 2 * 8 + 12) + 8 * 65_536 * 120;
    let peak = peak_of(|| drop(pool.install(|| file.bin(&binning)).unwrap()));
    assert!(peak < bound, "{} MiB for bins, at most {} are allowed", peak / MIB, bound / MIB);
    let peak = peak_of(|| drop(file.check(&CheckOptions { gap_ps: Some(1) }).unwrap()));
    assert!(peak < MIB, "{peak} bytes for a check of a million channels");
    let peak = peak_of(|| drop(file.slice(0, 9).unwrap_err()));
    assert!(peak < MIB, "{peak} bytes for a search");

    // A header that promises a TB, and one of many entries.
    let mut lies = b"PQTTTR\0\x001.0.00\0\0".to_vec();
    for (length, name) in [(1_u64 << 40, "Text"), (1 << 62, "Blob")] {
        let mut ident = name.as_bytes().to_vec();
        ident.resize(32, 0);
        lies.extend(ident);
        lies.extend((-1_i32).to_le_bytes());
        lies.extend(0x4001_ffff_u32.to_le_bytes());
        lies.extend(length.to_le_bytes());
    }
    let peak = peak_of(|| drop(PtuFile::from_bytes("x.ptu", lies).unwrap_err()));
    assert!(peak < MIB, "{peak} bytes for lies");
    let mut many = b"PQTTTR\0\x001.0.00\0\0".to_vec();
    let mut entry = [0; 48];
    entry[..4].copy_from_slice(b"Name");
    entry[36..40].copy_from_slice(&0x1000_0008_u32.to_le_bytes());
    (0..1_000_000).for_each(|_| many.extend(entry));
    let peak = peak_of(|| drop(PtuFile::from_bytes("x.ptu", many).unwrap_err()));
    assert!(peak < 32 * MIB, "{} MiB for a million entries (48 MB)", peak / MIB);
}
