//! The recorded conversations of `fixtures/ophir`: each replays strictly and ends as it says.
//!
//! They were recorded from our simulated meter (synthetic), on a virtual clock, so that they are the same each time;
//! `SUNGLINT_UPDATE=1` records them anew.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Clock, SystemClock, VirtualClock};
use sunglint_drivers::recording::{Event, Fault, Header, Recorded, Recording, Replay, play};
use sunglint_drivers::transport::Bytes;
use sunglint_formats::atomic::Overwrite;
use sunglint_testkit::fixture;

fn header() -> Header {
    Header {
        device: "Ophir Vega with a PD300".into(),
        source: "sunglint's simulated meter".into(),
        host: Some("sunglint's Ophir driver".into()),
        recorded: None,
        synthetic: true,
    }
}

/// Truth: the named ends; the recordings in the repository, byte for byte.
#[test]
fn every_recording_ends_as_it_says() {
    for case in crate::common::ophir::cases() {
        let path = fixture(&format!("ophir/{}.rec", case.name));
        let clock: Arc<dyn Clock> = Arc::new(VirtualClock::new());
        if std::env::var_os("SUNGLINT_UPDATE").is_some() {
            let line = Recorded::create(case.line(), &path, &header(), Overwrite::Allow).unwrap();
            assert_eq!(
                crate::common::ophir::session(line, &clock),
                case.end,
                "recording {}",
                case.name
            );
        }
        let recording = Recording::read(&path).unwrap();
        assert!(recording.header.synthetic, "{} was made up, and says so", case.name);
        let clock: Arc<dyn Clock> = Arc::new(VirtualClock::new());
        let mut line = Replay::new(recording);
        assert_eq!(crate::common::ophir::session(&mut line, &clock), case.end, "{}", case.name);
        line.finish().unwrap_or_else(|error| panic!("{}: {error}", case.name));
    }
}

/// The same files through a real pty with serialport and through a real socket. Truth: the same ends.
#[test]
fn the_same_recordings_through_a_pty_and_a_socket() {
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    // Side by side, as most of the time is waiting.
    std::thread::scope(|scope| {
        for case in crate::common::ophir::cases() {
            let clock = &clock;
            scope.spawn(move || {
                let path = fixture(&format!("ophir/{}.rec", case.name));
                let recording = Recording::read(path).unwrap();
                // On a busy machine the meter may not get its turn within the host's patience, 0.3 s: it is tried again.
                let settled = |end: &String| *end == case.end || !end.contains("no answer but");
                let tried = |once: &dyn Fn() -> String| {
                    let first = (0..4).map(|_| once()).find(settled);
                    first.unwrap_or_else(once)
                };
                let by_pty = || {
                    let pty = crate::common::pty();
                    through(&recording, pty.host, pty.device, clock)
                };
                assert_eq!(tried(&by_pty), case.end, "{} through a pty", case.name);
                let by_socket = || {
                    let (host, device) = crate::common::tcp();
                    through(&recording, host, device, clock)
                };
                assert_eq!(tried(&by_socket), case.end, "{} through a socket", case.name);
            });
        }
    });
}

fn through<D: Bytes + 'static>(
    recording: &Recording,
    host: impl Bytes,
    mut device: D,
    clock: &Arc<dyn Clock>,
) -> String {
    let recording = recording.clone();
    let goes = matches!(recording.events.last(), Some((_, Event::Fault(Fault::Disconnect))));
    let player = std::thread::spawn(move || {
        let played = play(&recording, &mut device, &crate::common::within(20.0));
        // What arrives together with a hang-up may be lost with it, so the host gets a moment to read.
        std::thread::sleep(Duration::from_millis(30));
        (played, (!goes).then_some(device))
    });
    let end = crate::common::ophir::session(host, clock);
    player.join().unwrap().0.unwrap();
    end
}
