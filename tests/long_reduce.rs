//! Ten hours from photons to light curves: memory stays below its bound, and no sample is lost or doubled. Alone in its process, because its memory is measured.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use crate::common::virtual_night::{observe, plan_of};
use std::time::Instant;
use sunglint_calibration::reduction::{ReduceOptions, reduce};
use sunglint_formats::session::Session;
use sunglint_numerics::progress::Silent;
use sunglint_radiometry::light_curve::Flags;
use sunglint_radiometry::station::Station;
use sunglint_testkit::Campaign;

/// The largest memory that this process ever had, bytes (`VmHWM` of proc(5)).
fn peak_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}

/// Truth: the plan's own arithmetic: frames of 200 × 200 px each 2 s and bins of 0.1 s, of which each is in the account once, and
/// in each visit the times that the grid has; the bound of the issue, 300 MB. A tenth of ten hours runs every time.
#[test]
fn campaign_long_reduce() {
    if !sunglint_testkit::alone("campaign_long_reduce") {
        return;
    }
    let mut campaign = Campaign::start("long_reduce", 10);
    let hours = campaign.seeds().count();
    let folder = Folder::new("long-reduce");
    // An hour: twelve stars of 240 s with 40 s of sky and 10 s of way each. Two minutes of dark at each end.
    let stars = 12 * hours;
    let seconds = 290 * stars as u64 + 240;
    let options = format!(
        "seed = 2\n[plan]\nstars = {stars}\nvisit_s = 240\nsky_s = 40\nslew_s = 10\ndark_s = 120\n"
    );
    let begun = Instant::now();
    let (summary, truth) = observe(&folder.0, &plan_of(&[]), &options);
    eprintln!("observed in {:.1} s", begun.elapsed().as_secs_f64());
    assert_eq!((summary.taken["cam"], summary.taken["tagger"]), (seconds / 2, 10 * seconds));
    let session = Session::open(folder.path("session")).unwrap();
    let station = Station::built_in("ufo").unwrap().unwrap();
    let options = ReduceOptions::for_station(&station);
    let begun = Instant::now();
    let mut night = reduce(&session, &station, &options, &Silent).unwrap();
    let (mut visits, mut bins, mut frames) = (0, 0, 0);
    while let Some(visited) = night.take(&session, &station).unwrap() {
        let curve = &visited.linear;
        let table = curve.to_table().unwrap();
        std::fs::write(
            folder.path("visit.ecsv"),
            sunglint_formats::ecsv::to_string(&table).unwrap(),
        )
        .unwrap();
        let times = |name: &str| -> Vec<i64> {
            let flags = &curve.channel(name).unwrap().flags;
            let own = curve.samples.time.iter().zip(flags);
            let own = own.filter(|(_, f)| !f.contains(Flags::NOT_SAMPLED));
            own.map(|(time, _)| (truth.seconds(*time) * 1e3).round() as i64).collect()
        };
        let grid = |times: &[i64], step_ms: i64| {
            assert!(times.windows(2).all(|pair| pair[1] - pair[0] == step_ms), "{step_ms} ms");
        };
        let (counted, pictured) = (times("spcm"), times("g"));
        grid(&counted, 100);
        grid(&pictured, 2000);
        assert_eq!((counted.len(), pictured.len()), (2400, 120));
        (visits, bins, frames) = (visits + 1, bins + counted.len(), frames + pictured.len());
    }
    eprintln!("reduced in {:.1} s", begun.elapsed().as_secs_f64());
    assert_eq!(visits, stars);
    let counted = bins as u64 + night.counters[0].summary.outside;
    let pictured = frames as u64 + night.cameras[0].outside;
    let lost = counted.abs_diff(10 * seconds) + pictured.abs_diff(seconds / 2);
    campaign.largest("lost_or_doubled", lost as f64);
    assert_eq!(lost, 0);
    match peak_bytes() {
        None => sunglint_testkit::skip("campaign_long_reduce", "no /proc/self/status"),
        Some(peak) => {
            eprintln!("at most {:.1} MB", peak as f64 * 1e-6);
            assert!(peak < 300_000_000, "{peak} bytes");
        }
    }
    campaign.finish();
}
