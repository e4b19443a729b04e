//! Common parts of the tests of the reduction: a night of the virtual observatory, observed into a session.

#![allow(dead_code, reason = "each test binary uses its part")]
#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use std::path::Path;
use std::sync::Arc;
use sunglint_drivers::clock::Cancel;
use sunglint_observatory::Summary;
use sunglint_rehearsal::planned;
use sunglint_virtual::observatory::night::Night;

const PROGRAM: &str = concat!("sunglint ", env!("CARGO_PKG_VERSION"));

/// A plan with a camera and a counter of the station `ufo`, both virtual; with replacements.
pub fn plan_of(changes: &[(&str, &str)]) -> String {
    let plan = r#"
station = "ufo"
from = "2020-11-18T18:00:00Z"
virtual = "virtual.toml"

[[camera]]
name = "cam"
device = "virtual"
exposure_s = 0.5
interval_s = 2.0
window_px = [595, 419, 200, 200]

[[counter]]
name = "tagger"
device = "virtual"
channels = { id400 = 1, spcm = 2, mppc = 3 }
bin_s = 0.1
"#;
    changes.iter().fold(plan.to_owned(), |plan, (from, to)| {
        assert!(plan.contains(from), "{from}");
        plan.replacen(from, to, 1)
    })
}

/// Writes plan and options into a folder.
pub fn write(folder: &Path, plan: &str, options: &str) {
    std::fs::write(folder.join("night.toml"), plan).unwrap();
    std::fs::write(folder.join("virtual.toml"), options).unwrap();
}

/// Observes into `session` of a folder; gives the truth, too.
pub fn observe(folder: &Path, plan: &str, options: &str) -> (Summary, Arc<Night>) {
    write(folder, plan, options);
    let (session, made) =
        planned(&folder.join("night.toml"), Some(&folder.join("session")), PROGRAM).unwrap();
    let night = made.unwrap().observatory().night().clone();
    (session.run(&Cancel::new(), &mut |_| {}).unwrap(), night)
}
