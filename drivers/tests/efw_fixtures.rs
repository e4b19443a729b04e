//! The recorded conversations of `fixtures/efw`: each replays strictly and ends as it says. Those that a fake device can
//! show go through the real library too, see `umockdev_efw.rs`.
//!
//! They were recorded from our simulated device (synthetic), on a virtual clock, so that they are the same each time;
//! `SUNGLINT_UPDATE=1` records them anew.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::sync::Arc;
use sunglint_drivers::clock::{Clock, VirtualClock};
use sunglint_drivers::recording::{Header, Recorded, Recording, Replay};
use sunglint_formats::atomic::Overwrite;
use sunglint_testkit::fixture;

fn header() -> Header {
    Header {
        device: "ZWO EFW with seven slots".into(),
        source: "sunglint's simulated wheel".into(),
        host: Some("sunglint's ZWO driver".into()),
        recorded: None,
        synthetic: true,
    }
}

/// Truth: the named ends; the recordings in the repository, byte for byte.
#[test]
fn every_recording_ends_as_it_says() {
    for case in crate::common::efw::cases() {
        let path = fixture(&format!("efw/{}.rec", case.name));
        let clock: Arc<dyn Clock> = Arc::new(VirtualClock::new());
        if std::env::var_os("SUNGLINT_UPDATE").is_some() {
            let hid = Recorded::create(case.hid(), &path, &header(), Overwrite::Allow).unwrap();
            assert_eq!(
                crate::common::efw::session(hid, &clock),
                case.end,
                "recording {}",
                case.name
            );
        }
        let recording = Recording::read(&path).unwrap();
        assert!(recording.header.synthetic, "{} was made up, and says so", case.name);
        let clock: Arc<dyn Clock> = Arc::new(VirtualClock::new());
        let mut hid = Replay::new(recording);
        assert_eq!(crate::common::efw::session(&mut hid, &clock), case.end, "{}", case.name);
        hid.finish().unwrap_or_else(|error| panic!("{}: {error}", case.name));
    }
}
