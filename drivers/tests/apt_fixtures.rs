//! The recorded conversations of `fixtures/apt`: each replays strictly and ends as it says.
//!
//! They were recorded from our simulated stage (synthetic), on a virtual clock, so that they are the same each time;
//! `SUNGLINT_UPDATE=1` records them anew.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Clock, Deadline, SystemClock, VirtualClock};
use sunglint_drivers::device::{DeviceError, RotationStage as _};
use sunglint_drivers::recording::{Event, Fault, Header, Recorded, Recording, Replay, play};
use sunglint_drivers::simulated::InMemory;
use sunglint_drivers::simulated::apt::{Apt, AptSettings, Trouble};
use sunglint_drivers::thorlabs::apt::{LinkSettings, Model, Stage, StageSettings};
use sunglint_drivers::transport::{Bytes, TransportError};
use sunglint_formats::atomic::Overwrite;
use sunglint_testkit::fixture;

/// One case: the stage, what is wrong with it, what happens to the cable, and how it must end.
struct Case {
    name: &'static str,
    trouble: Trouble,
    cable: Cable,
    servo: bool,
    end: &'static str,
}

#[derive(Clone, Copy, PartialEq)]
enum Cable {
    Good,
    /// Pulled out after so many messages of the host.
    Cut(u32),
    /// A byte of the answer to this message of the host is spoilt.
    Flip(u32),
    /// The power is cut for a moment before this message of the host.
    Power(u32),
}

struct Line {
    apt: InMemory<Apt>,
    cable: Cable,
    sent: u32,
    heard: u32,
}

impl Bytes for Line {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        self.sent += 1;
        self.heard = 0;
        if self.cable == Cable::Power(self.sent) {
            self.apt.device.power_cycle();
        }
        self.apt.send(bytes, deadline)
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        if matches!(self.cable, Cable::Cut(n) if self.sent >= n) {
            return Err(TransportError::disconnected("the simulated stage"));
        }
        let count = self.apt.receive(buffer, deadline)?;
        if self.cable == Cable::Flip(self.sent) && self.heard == 0 {
            buffer[1] ^= 0x40;
        }
        self.heard += 1;
        Ok(count)
    }

    fn discard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        self.apt.discard(deadline)
    }
}

/// Does what the host does in every case: it opens the stage, homes it, turns to 10°. Returns how that ended, in words.
fn session(line: impl Bytes, servo: bool, clock: &Arc<dyn Clock>) -> String {
    let within = |seconds| Deadline::after(clock.clone(), Duration::from_secs(seconds));
    let link = LinkSettings { reply_within: Duration::from_millis(150), ..LinkSettings::default() };
    let settings = StageSettings {
        model: Some(if servo { Model::Prm1z8 } else { Model::K10cr1 }),
        stall_after: Duration::from_millis(300),
        ..StageSettings::default()
    };
    let mut stage = match Stage::open(line, link, settings, &within(5)) {
        Ok(stage) => stage,
        Err(error) => return format!("open: {}", words(&error)),
    };
    if let Err(interrupted) = stage.home(&within(10)) {
        return format!("home: {}", words(&interrupted.error));
    }
    match stage.move_to(10.0, &within(10)) {
        Ok(angle) => format!("{angle:.4} deg"),
        Err(interrupted) => {
            let at = interrupted.done.map(|at| format!("{at:.4}"));
            format!("move, at {at:?}: {}", words(&interrupted.error))
        }
    }
}

/// The error, without the times that a real clock would change.
fn words(error: &DeviceError) -> String {
    match error {
        DeviceError::Transport { source: TransportError::Timeout { .. }, .. } => "no answer".into(),
        DeviceError::Transport { source: TransportError::Disconnected { .. }, .. } => "gone".into(),
        DeviceError::NotStopped { source, .. } => format!("{}; not stopped", words(source)),
        other => other.to_string(),
    }
}

fn cases() -> Vec<Case> {
    let good = Trouble::default;
    let case = |name, trouble, cable, end| Case { name, trouble, cable, servo: false, end };
    vec![
        case("good", good(), Cable::Good, "10.0000 deg"),
        // (round(10 · 1919.64) + 4 counts of its own error) / 1919.64
        Case { servo: true, ..case("servo", good(), Cable::Good, "10.0019 deg") },
        case(
            "obstacle",
            Trouble { obstacle: Some(-100_000), ..good() },
            Cable::Good,
            // (204,800 − 100,000) microsteps · 3° / 409,600
            "move, at Some(\"0.7676\"): Thorlabs stage: it stands still at 0.7676 deg on the way to 10.0000 deg: check for an obstacle, the motor's current and its supply",
        ),
        case(
            "no_search",
            Trouble { no_search: true, ..good() },
            Cable::Good,
            "home: Thorlabs stage: its reference search did not begin: is the channel on, and the switch free?",
        ),
        case(
            "complaint",
            Trouble { complains: true, ..good() },
            Cable::Good,
            "home: Thorlabs stage refused what it was asked: the channel is busy",
        ),
        case(
            "disabled",
            Trouble { disabled: true, ..good() },
            Cable::Good,
            "open: Thorlabs stage: channel_enabled was set to 1, the device says Some(2)",
        ),
        case("silence", Trouble { dead: true, ..good() }, Cable::Good, "open: no answer"),
        case("spoilt", good(), Cable::Flip(10), "10.0000 deg"),
        case("disconnect", good(), Cable::Cut(12), "home: gone; not stopped"),
        case(
            "power_lost",
            good(),
            Cable::Power(16),
            "move, at None: Thorlabs stage: its angle is not known yet (it was not homed since it was switched on): home it (or trust its counter) first",
        ),
    ]
}

/// A stage with its reference 1.5° in reverse; an obstacle is met only on the way from there.
fn line(case: &Case) -> Line {
    let settings = AptSettings {
        model: if case.servo { "KDC101".into() } else { "K10CR1".into() },
        servo: case.servo,
        speed: if case.servo { 38_400 } else { 2_730_667 },
        reference: if case.servo { -2_880 } else { -204_800 },
        error: if case.servo { 4 } else { 0 },
        ..AptSettings::default()
    };
    let mut apt = Apt::new(settings);
    apt.trouble = case.trouble;
    Line { apt: InMemory::new(apt), cable: case.cable, sent: 0, heard: 0 }
}

/// Puts an obstacle in the way once the host sends the stage off.
struct Later {
    line: Line,
    obstacle: Option<i64>,
}

impl Bytes for Later {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        if bytes.starts_with(&[0x53, 0x04]) {
            self.line.apt.device.trouble.obstacle = self.obstacle;
        }
        self.line.send(bytes, deadline)
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        self.line.receive(buffer, deadline)
    }

    fn discard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        self.line.discard(deadline)
    }
}

fn record(case: &Case, path: &std::path::Path) -> String {
    let header = Header {
        device: format!("Thorlabs {}", if case.servo { "PRM1Z8 on a KDC101" } else { "K10CR1" }),
        source: "sunglint's simulated APT stage".into(),
        host: Some("sunglint's APT driver".into()),
        recorded: None,
        synthetic: true,
    };
    let mut line = line(case);
    let obstacle = line.apt.device.trouble.obstacle.take();
    let clock: Arc<dyn Clock> = Arc::new(VirtualClock::new());
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    let line = Later { line, obstacle };
    let line = Recorded::create(line, path, &header, Overwrite::Allow).unwrap();
    session(line, case.servo, &clock)
}

/// Truth: the named ends above; the recordings in the repository, byte for byte.
#[test]
fn every_recording_ends_as_it_says() {
    for case in cases() {
        let path = fixture(&format!("apt/{}.rec", case.name));
        if std::env::var_os("SUNGLINT_UPDATE").is_some() {
            assert_eq!(record(&case, &path), case.end, "recording {}", case.name);
        }
        let recording = Recording::read(&path).unwrap();
        assert!(recording.header.synthetic, "{} was made up, and says so", case.name);
        let clock: Arc<dyn Clock> = Arc::new(VirtualClock::new());
        let mut line = Replay::new(recording);
        assert_eq!(session(&mut line, case.servo, &clock), case.end, "{}", case.name);
        line.finish().unwrap_or_else(|error| panic!("{}: {error}", case.name));
    }
}

/// The files in which nothing depends on the clock, through a real pty with serialport. Truth: the same ends.
#[test]
fn the_same_recordings_through_a_pty() {
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    std::thread::scope(|scope| {
        for case in cases() {
            if !["complaint", "disabled", "silence", "disconnect"].contains(&case.name) {
                continue;
            }
            let clock = &clock;
            scope.spawn(move || {
                let path = fixture(&format!("apt/{}.rec", case.name));
                let recording = Recording::read(path).unwrap();
                let pty = crate::common::pty();
                let mut device = pty.device;
                let last = recording.events.last().map(|(_, event)| event.clone());
                let goes = last == Some(Event::Fault(Fault::Disconnect));
                let player = std::thread::spawn(move || {
                    let played = play(&recording, &mut device, &crate::common::within(20.0));
                    // What arrives together with a hang-up may be lost with it.
                    std::thread::sleep(Duration::from_millis(30));
                    (played, (!goes).then_some(device))
                });
                assert_eq!(session(pty.host, case.servo, clock), case.end, "{}", case.name);
                player.join().unwrap().0.unwrap();
            });
        }
    });
}
