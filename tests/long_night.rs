//! Ten hours of capture: memory stays flat, and no sample is lost or doubled. Alone in its process, because its memory is measured.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use crate::common::night::{Fakes, frame};
use std::time::Instant;
use sunglint_drivers::clock::Cancel;
use sunglint_formats::session::Session;
use sunglint_testkit::Campaign;

/// The largest memory that this process ever had, bytes (`VmHWM` of proc(5)).
fn peak_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}

/// Truth: the plan's own arithmetic: frames of 200 × 200 px each 2 s, bins of 0.1 s, each with the number that the device gave it;
/// the bound of the issue, 300 MB. A tenth of ten hours runs every time.
#[test]
fn campaign_long_night() {
    if !sunglint_testkit::alone("campaign_long_night") {
        return;
    }
    let mut campaign = Campaign::start("long_night", 10);
    let hours = campaign.seeds().count() as u64;
    let folder = Folder::new("long");
    let root = folder.0.join("s");
    let fakes = Fakes { frame_px: 200, ..Fakes::new(3600.0 * hours as f64) };
    let begun = Instant::now();
    let summary = fakes.night(&root).run(&Cancel::new(), &mut |_| {}).unwrap();
    eprintln!("{hours} h in {:.1} s", begun.elapsed().as_secs_f64());
    assert_eq!(summary.not_written, 0);
    let session = Session::open(&root).unwrap();
    let (mut rows, mut odd) = (0, 0);
    for record in session.counts("tagger").unwrap() {
        let record = record.unwrap();
        odd += u64::from(record.counts != [rows, 3 * rows]);
        rows += 1;
    }
    let files = session.frames("cam").unwrap().files;
    for (i, file) in files.iter().enumerate() {
        odd += u64::from(file.sequence != i as u64 + 1);
        // Each hundredth is read, too.
        if i % 100 == 0 {
            let found = file.read().unwrap();
            assert_eq!(found.pixels, frame(found.start, 0.5, 200, file.sequence).pixels);
        }
    }
    let lost = (36_000 * hours).abs_diff(rows) + (1800 * hours).abs_diff(files.len() as u64);
    campaign.largest("lost", lost as f64);
    campaign.largest("doubled_or_changed", odd as f64);
    match peak_bytes() {
        None => sunglint_testkit::skip("campaign_long_night", "no /proc/self/status"),
        Some(peak) => {
            eprintln!("at most {:.1} MB", peak as f64 * 1e-6);
            assert!(peak < 300_000_000, "{peak} bytes");
        }
    }
    campaign.finish();
}
