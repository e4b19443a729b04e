//! Fields of fibres found by `align` in whole virtual nights: what it states is what it is off by.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use sunglint_formats::session::Session;
use sunglint_radiometry::station::{Detector, Station};
use sunglint_testkit::Campaign;

/// Intervals of the night with the truth below and above them, the mean of (found − truth)/σ and their number: of the fields' middles, and of their widths.
const COLUMNS: &[&str] = &[
    "middle_below",
    "middle_above",
    "middle_pull",
    "middle_of",
    "width_below",
    "width_above",
    "width_pull",
    "width_of",
];

/// A night from photons and pixels to the fields.
fn night(seed: u64) -> Vec<f64> {
    let folder = Folder::new(&format!("fibres_{seed}"));
    for (name, text) in sunglint_rehearsal::demo::short_files(seed) {
        std::fs::write(folder.path(name), text).unwrap();
    }
    std::fs::create_dir(folder.path("simulated")).unwrap();
    folder.done(&["simulate", "pass.toml", "-q", "-o", "simulated/demo-sat.ecsv"]);
    folder.done(&["observe", "night.toml", "-q", "-o", "session"]);
    let found = folder.json(&["align", "session", "--json"]);
    let session = Session::open(folder.path("session")).unwrap();
    let station = Station::of_session(&session).unwrap();
    let mut sums = [[0.0; 4]; 2];
    for channel in found["channels"].as_array().unwrap() {
        let name = channel["name"].as_str().unwrap();
        let channel_of = station.channels.iter().find(|c| c.name == name).unwrap();
        let Detector::Counter(counter) = &channel_of.detector else { panic!("{name}") };
        let fibre = counter.fibre.unwrap();
        let numbers = |key: &str| [0, 1].map(|k| channel[key][k].as_f64().unwrap());
        let middle = (numbers("offset_px"), numbers("offset_uncertainty_px"), fibre.offset_px);
        let width = (numbers("sigma_px"), numbers("sigma_uncertainty_px"), fibre.sigma_px);
        for (sums, (value, sigma, truth)) in sums.iter_mut().zip([middle, width]) {
            for k in 0..2 {
                let pull = (value[k] - truth[k]) / sigma[k];
                let row = [f64::from(pull > 1.96), f64::from(pull < -1.96), pull, 1.0];
                sums.iter_mut().zip(row).for_each(|(sum, own)| *sum += own);
            }
        }
    }
    for sums in &mut sums {
        sums[2] /= f64::max(sums[3], 1.0);
    }
    sums.concat()
}

/// Nights of the short demonstration with other seeds (synthetic): photons, pixels, a mount that wanders, twinkling, places of stars as frames tell them. Truth: the station's fields, with which the night was made. 95 % intervals are 1.96 σ
/// to both sides. docs/uncertainty.md counts them by whole nights; here: nine of ten hold.
#[test]
fn campaign_fibres() {
    let mut campaign = Campaign::in_shards("fibres", 100, 1, COLUMNS);
    for seed in campaign.seeds() {
        let row = night(seed);
        println!("{seed}: {row:.2?}");
        campaign.keep(seed, &row);
    }
    let mut missed = Vec::new();
    for (what, figure) in [("middle", "middles_missed"), ("width", "widths_missed")] {
        let sum = |end: &str| campaign.column(&format!("{what}_{end}")).iter().sum::<f64>();
        missed.push((figure, (sum("below") + sum("above")) / sum("of")));
        campaign.largest(figure, missed[missed.len() - 1].1);
    }
    let whole = campaign.is_whole();
    campaign.finish();
    assert!(!whole || missed.iter().all(|(_, share)| *share < 0.1), "{missed:?}");
}
