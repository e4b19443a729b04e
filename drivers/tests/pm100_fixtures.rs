//! The recorded conversations of `fixtures/pm100`: each replays strictly and ends as it says. Those that a fake device can
//! show go through the real library too, see `umockdev_pm100.rs`.
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
        device: "Thorlabs PM100D with an S120C".into(),
        source: "sunglint's simulated meter".into(),
        host: Some("sunglint's Thorlabs driver".into()),
        recorded: None,
        synthetic: true,
    }
}

/// Truth: the named ends; the recordings in the repository, byte for byte.
#[test]
fn every_recording_ends_as_it_says() {
    for case in crate::common::pm100::cases() {
        let path = fixture(&format!("pm100/{}.rec", case.name));
        let clock: Arc<dyn Clock> = Arc::new(VirtualClock::new());
        if std::env::var_os("SUNGLINT_UPDATE").is_some() {
            let usb = Recorded::create(case.usb(), &path, &header(), Overwrite::Allow).unwrap();
            let end = crate::common::pm100::session(usb, case.clear_first, &clock);
            assert_eq!(end, case.end, "recording {}", case.name);
        }
        let recording = Recording::read(&path).unwrap();
        assert!(recording.header.synthetic, "{} was made up, and says so", case.name);
        let clock: Arc<dyn Clock> = Arc::new(VirtualClock::new());
        let mut usb = Replay::new(recording);
        let end = crate::common::pm100::session(&mut usb, case.clear_first, &clock);
        assert_eq!(end, case.end, "{}", case.name);
        usb.finish().unwrap_or_else(|error| panic!("{}: {error}", case.name));
    }
}
