//! The recorded conversations of `fixtures/tmcl`: each replays strictly and ends as it says.
//!
//! They were recorded from our simulated module (synthetic), on a virtual clock, so that they are the same each time;
//! `SUNGLINT_UPDATE=1` records them anew.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Clock, Deadline, SystemClock, VirtualClock};
use sunglint_drivers::device::{DeviceError, RotationStage as _};
use sunglint_drivers::recording::{Event, Fault, Header, Recorded, Recording, Replay, play};
use sunglint_drivers::simulated::InMemory;
use sunglint_drivers::simulated::tmcl::{Module, ModuleSettings, Trouble};
use sunglint_drivers::transport::{Bytes, TransportError};
use sunglint_drivers::trinamic::tmcl::{Command, Status};
use sunglint_drivers::trinamic::{LinkSettings, Search, Stage, StageSettings};
use sunglint_formats::atomic::Overwrite;
use sunglint_testkit::fixture;

/// The device's end of a case, where more than the module is at fault.
#[derive(Clone, Copy, PartialEq)]
enum Cable {
    Good,
    /// Pulled out in the middle of the reply to this request.
    Cut(u32),
}

/// A line whose cable may be pulled out.
struct Line {
    module: InMemory<Module>,
    cable: Cable,
    sent: u32,
    heard: u32,
}

impl Bytes for Line {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        self.sent += 1;
        self.heard = 0;
        self.module.send(bytes, deadline)
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        if matches!(self.cable, Cable::Cut(request) if self.sent >= request) {
            if self.heard >= 4 {
                return Err(TransportError::disconnected("the simulated module"));
            }
            self.heard = 4;
            let most = buffer.len().min(4);
            return self.module.receive(&mut buffer[..most], deadline);
        }
        self.module.receive(buffer, deadline)
    }

    fn discard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        self.module.discard(deadline)
    }
}

fn settings() -> StageSettings {
    StageSettings {
        search: Some(Search { mode: 1, speed: 20_000, switch_speed: 500, tolerance_deg: 0.5 }),
        stall_after: Duration::from_millis(200),
        ..StageSettings::default()
    }
}

/// Does what the host does in every case: it opens the stage, homes it, turns to 10°. Returns how that ended, in words.
fn session(line: impl Bytes, clock: &Arc<dyn Clock>) -> String {
    let within = |seconds| Deadline::after(clock.clone(), Duration::from_secs(seconds));
    let link = LinkSettings { reply_within: Duration::from_millis(100), ..LinkSettings::default() };
    let mut stage = match Stage::open(line, link, settings(), &within(5)) {
        Ok(stage) => stage,
        Err(error) => return format!("open: {}", words(&error)),
    };
    if let Err(interrupted) = stage.home(&within(10)) {
        return format!("home: {}", words(&interrupted.error));
    }
    match stage.move_to(10.0, &within(10)) {
        Ok(angle) => format!("{angle:.4} deg"),
        Err(interrupted) => {
            format!("move, at {:?}: {}", interrupted.done, words(&interrupted.error))
        }
    }
}

/// The error, without the times that a real clock would change.
fn words(error: &DeviceError) -> String {
    match error {
        DeviceError::Transport { source: TransportError::Timeout { got_so_far, .. }, .. } => {
            format!("no answer but {} bytes", got_so_far.len())
        }
        DeviceError::Transport {
            source: TransportError::Disconnected { got_so_far, .. }, ..
        } => {
            format!("gone after {} bytes", got_so_far.len())
        }
        DeviceError::NotStopped { source, .. } => format!("{}; not stopped", words(source)),
        other => other.to_string(),
    }
}

fn refusing(command: Command, kind: u8, status: Status) -> Trouble {
    Trouble { refuse: Some((command, Some(kind), status)), ..Trouble::default() }
}

/// Name, what is wrong, and how it must end. The statuses and their meanings are pytrinamic's.
fn cases() -> Vec<(&'static str, Trouble, Cable, &'static str)> {
    let good = Trouble::default;
    vec![
        ("good", good(), Cable::Good, "9.9984 deg"),
        (
            "status_1_checksum",
            Trouble { refuse: Some((Command::Move, Some(0), Status::WrongChecksum)), ..good() },
            Cable::Good,
            "move, at Some(0.0): Trinamic stage refused the move of motor 0 to 1422: the checksum of the request was wrong (code 1)",
        ),
        (
            "status_2_command",
            refusing(Command::Search, 0, Status::InvalidCommand),
            Cable::Good,
            "home: Trinamic stage refused the reference search (kind 0) of motor 0: the module has no such command (code 2)",
        ),
        (
            "status_3_type",
            refusing(Command::Get, 140, Status::WrongType),
            Cable::Good,
            "open: Trinamic stage refused the axis parameter 140 of motor 0: the module has no such parameter (code 3)",
        ),
        (
            "status_4_value",
            refusing(Command::Set, 194, Status::InvalidValue),
            Cable::Good,
            "home: Trinamic stage refused the axis parameter 194 of motor 0 = 20000: the module does not take this value (code 4)",
        ),
        (
            "status_5_locked",
            refusing(Command::Set, 193, Status::EepromLocked),
            Cable::Good,
            "home: Trinamic stage refused the axis parameter 193 of motor 0 = 1: the module's memory is locked (code 5)",
        ),
        (
            "status_6_not_available",
            refusing(Command::Search, 0, Status::NotAvailable),
            Cable::Good,
            "home: Trinamic stage refused the reference search (kind 0) of motor 0: the command is not available on this module (code 6)",
        ),
        (
            "status_9_maximum",
            refusing(Command::Move, 0, Status::MaximumExceeded),
            Cable::Good,
            "move, at Some(0.0): Trinamic stage refused the move of motor 0 to 1422: the value is beyond the module's maximum (code 9)",
        ),
        ("silence", Trouble { dead: true, ..good() }, Cable::Good, "open: no answer but 0 bytes"),
        (
            "wrong_checksum",
            Trouble { bad_checksums: true, ..good() },
            Cable::Good,
            "open: no answer but 9 bytes",
        ),
        (
            "stall",
            Trouble { obstacle: Some(-1_000), ..good() },
            Cable::Good,
            "move, at Some(7.03125): Trinamic stage: it stands still at 7.0312 deg on the way to 9.9984 deg: check for an obstacle, the motor's current and its supply",
        ),
        ("disconnect", good(), Cable::Cut(12), "home: gone after 4 bytes; not stopped"),
    ]
}

fn module(name: &str) -> Module {
    // The left switch is 2,000 microsteps (14°) away, the right one far; in `limit` it is closer than the target. An
    // obstacle is met on the way back from the switch.
    let right = if name == "limit" { -1_200 } else { 60_000 };
    Module::new(ModuleSettings { switches: [-2_000, right], ..ModuleSettings::default() })
}

fn all_cases() -> Vec<(&'static str, Trouble, Cable, &'static str)> {
    let mut cases = cases();
    cases.push((
        "limit",
        Trouble::default(),
        Cable::Good,
        "move, at Some(5.625): Trinamic stage: the right limit switch stopped it at 5.6250 deg on the way to 9.9984 deg",
    ));
    cases
}

/// A simulated module that has the case's trouble; an obstacle appears once the stage was homed.
fn record(name: &str, trouble: Trouble, cable: Cable, path: &std::path::Path) -> String {
    let mut module = module(name);
    let obstacle = trouble.obstacle;
    module.trouble = trouble;
    if obstacle.is_some() {
        module.trouble.obstacle = None;
    }
    let header = Header {
        device: "TMCL module TMCM-1110, one motor".into(),
        source: "sunglint's simulated module".into(),
        host: Some("sunglint's Trinamic driver".into()),
        recorded: None,
        synthetic: true,
    };
    let clock: Arc<dyn Clock> = Arc::new(VirtualClock::new());
    let line = Line { module: InMemory::new(module), cable, sent: 0, heard: 0 };
    let line = Obstacle { line, obstacle };
    session(Recorded::create(line, path, &header, Overwrite::Allow).unwrap(), &clock)
}

/// Puts an obstacle in the way once the host sends the stage off.
struct Obstacle {
    line: Line,
    obstacle: Option<i64>,
}

impl Bytes for Obstacle {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        if bytes.get(1) == Some(&Command::Move.number()) {
            self.line.module.device.trouble.obstacle = self.obstacle;
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

/// Truth: the named ends above; the recordings in the repository, byte for byte.
#[test]
fn every_recording_ends_as_it_says() {
    for (name, trouble, cable, end) in all_cases() {
        let path = fixture(&format!("tmcl/{name}.rec"));
        if std::env::var_os("SUNGLINT_UPDATE").is_some() {
            assert_eq!(record(name, trouble, cable, &path), end, "recording {name}");
        }
        let recording = Recording::read(&path).unwrap();
        assert!(recording.header.synthetic, "{name} was made up, and says so");
        let clock: Arc<dyn Clock> = Arc::new(VirtualClock::new());
        let mut line = Replay::new(recording);
        assert_eq!(session(&mut line, &clock), end, "{name}");
        line.finish().unwrap_or_else(|error| panic!("{name}: {error}"));
    }
}

/// The same files through a real pty with serialport and through a real socket. Truth: the same ends.
#[test]
fn the_same_recordings_through_a_pty_and_a_socket() {
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    for (name, _, _, end) in all_cases() {
        if name == "stall" {
            // What the host asks meanwhile depends on the clock.
            continue;
        }
        let recording = Recording::read(fixture(&format!("tmcl/{name}.rec"))).unwrap();
        // The host's patience is 100 ms of real time: on a busy computer the other end may take longer, and is given another try.
        let tries = |one: &dyn Fn() -> String| {
            let mut ends = (0..5).map(|_| one());
            ends.find(|found| found == end).unwrap_or_else(one)
        };
        let by_pty = tries(&|| {
            let pty = crate::common::pty();
            through(&recording, pty.host, pty.device, &clock)
        });
        assert_eq!(by_pty, end, "{name} through a pty");
        let by_socket = tries(&|| {
            let (host, device) = crate::common::tcp();
            through(&recording, host, device, &clock)
        });
        assert_eq!(by_socket, end, "{name} through a socket");
    }
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
        // What arrives together with a hang-up may be lost with it, so the host gets a moment to read: less than its patience of 100 ms.
        std::thread::sleep(Duration::from_millis(30));
        (played, (!goes).then_some(device))
    });
    let end = session(host, clock);
    player.join().unwrap().0.unwrap();
    end
}
