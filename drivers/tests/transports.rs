//! Real transports: ptys with serialport, TCP sockets, child processes; round trip, deadline, cancel, a cable pulled out.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::{pty, tcp, within};
use std::process::Command;
use std::time::{Duration, Instant};
use sunglint_drivers::clock::Cancel;
use sunglint_drivers::recording::{Recording, play};
use sunglint_drivers::transport::child::Child;
use sunglint_drivers::transport::serial::Serial;
use sunglint_drivers::transport::tcp::Tcp;
use sunglint_drivers::transport::{Bytes, TransportError};
use sunglint_testkit::fixture;

/// The waits of these tests are 100 to 300 ms; this much more is for a machine that does other things too.
const SLACK: Duration = Duration::from_secs(3);

fn round_trip(host: &mut impl Bytes, device: &mut impl Bytes) {
    // Every byte value, so that a terminal that edits lines or drops controls would be seen.
    let all: Vec<u8> = (0..=255).collect();
    host.send(&all, &within(5.0)).unwrap();
    let mut heard = vec![0; 256];
    device.receive_exact(&mut heard, &within(5.0)).unwrap();
    assert_eq!(heard, all);
    device.send(&all, &within(5.0)).unwrap();
    host.receive_exact(&mut heard, &within(5.0)).unwrap();
    assert_eq!(heard, all);
}

fn deadline_and_cancel(host: &mut impl Bytes, device: &mut impl Bytes) {
    device.send(&[1, 2, 3], &within(5.0)).unwrap();
    let begun = Instant::now();
    let error = host.receive_exact(&mut [0; 5], &within(0.2)).unwrap_err();
    match error {
        TransportError::Timeout { got_so_far, .. } => assert_eq!(got_so_far, [1, 2, 3]),
        other => panic!("{other}"),
    }
    let took = begun.elapsed();
    assert!(took >= Duration::from_millis(200) && took < SLACK, "{took:?}");
    let cancel = Cancel::new();
    let other = cancel.clone();
    let thread = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(100));
        other.cancel();
    });
    let begun = Instant::now();
    let error = host.receive(&mut [0], &within(60.0).with_cancel(&cancel)).unwrap_err();
    assert!(matches!(error, TransportError::Cancelled { .. }), "{error}");
    assert!(begun.elapsed() < SLACK);
    thread.join().unwrap();
    // What arrives unasked is dropped, and told.
    device.send(&[7, 8, 9], &within(5.0)).unwrap();
    std::thread::sleep(Duration::from_millis(50));
    assert_eq!(host.discard(&within(5.0)).unwrap(), [7, 8, 9]);
    assert!(host.discard(&within(5.0)).unwrap().is_empty());
}

/// The recording `cut.rec` breaks off in the middle of a reply: the host gets what had come, and is told.
fn pulled_out<D: Bytes + 'static>(mut host: impl Bytes, mut device: D) {
    let recording = Recording::read(fixture("transports/cut.rec")).unwrap();
    let player = std::thread::spawn(move || {
        let played = play(&recording, &mut device, &within(20.0));
        drop(device);
        played
    });
    host.send(&[0x2a, 0x49], &within(5.0)).unwrap();
    let mut reply = [0; 9];
    let begun = Instant::now();
    let error = host.receive_exact(&mut reply, &within(20.0)).unwrap_err();
    match &error {
        TransportError::Disconnected { got_so_far, .. } => assert_eq!(got_so_far, &[2, 1, 0x64, 6]),
        other => panic!("{other}"),
    }
    assert!(begun.elapsed() < SLACK, "told at once, not after the deadline");
    player.join().unwrap().unwrap();
    let error = host.send(&[1], &within(5.0)).and_then(|()| {
        // A socket learns of it with the answer to its first packet.
        host.receive(&mut [0], &within(5.0)).map(|_| ())
    });
    assert!(matches!(error, Err(TransportError::Disconnected { .. })), "{error:?}");
}

/// Truth: the bytes themselves, and the computer's clock.
#[test]
fn serial_on_a_pty() {
    let mut pty = pty();
    round_trip(&mut pty.host, &mut pty.device);
    deadline_and_cancel(&mut pty.host, &mut pty.device);
    let error = Serial::open(&pty.path, 9600).unwrap_err();
    assert!(
        error.to_string().ends_with("; close the other program that has it open"),
        "a port in use: {error}"
    );
    pulled_out(pty.host, pty.device);
}

#[test]
fn tcp_on_a_socket() {
    let (mut host, mut device) = tcp();
    round_trip(&mut host, &mut device);
    deadline_and_cancel(&mut host, &mut device);
    pulled_out(host, device);
    let error = Tcp::connect("127.0.0.1:1", &within(5.0)).unwrap_err();
    assert!(error.to_string().ends_with("; start the server, or check the port"), "{error}");
    let error = Tcp::connect("no port", &within(5.0)).unwrap_err();
    assert!(matches!(error, TransportError::NotFound { .. }), "{error}");
}

/// Truth: what `cat` and `sh` do.
#[test]
fn a_child_process() {
    let mut cat = Child::spawn(&mut Command::new("cat")).unwrap();
    let all: Vec<u8> = (0..=255).collect();
    cat.send(&all, &within(5.0)).unwrap();
    let mut heard = vec![0; 256];
    cat.receive_exact(&mut heard, &within(5.0)).unwrap();
    assert_eq!(heard, all);
    assert!(cat.receive(&mut [0], &within(0.1)).unwrap_err().is_timeout());
    let script = "printf 'ab'; echo 'no licence found' >&2; exit 3";
    let mut shell = Child::spawn(Command::new("sh").args(["-c", script])).unwrap();
    let error = shell.receive_exact(&mut [0; 4], &within(5.0)).unwrap_err();
    assert_eq!(
        error.to_string(),
        "sh (exit status: 3: no licence found) is gone: check cable and power, then connect again (so far: 61 62)"
    );
    let missing = Child::spawn(&mut Command::new("no-such-program")).unwrap_err();
    assert!(matches!(missing, TransportError::NotFound { .. }), "{missing}");
    // A child that does not read does not hold the host.
    let mut deaf = Child::spawn(Command::new("sleep").arg("60")).unwrap();
    let begun = Instant::now();
    let much = vec![0; 1 << 20];
    let error = (0..4).find_map(|_| deaf.send(&much, &within(0.2)).err()).unwrap();
    assert!(error.is_timeout() && begun.elapsed() < SLACK, "{error}");
    drop(deaf);
    assert!(begun.elapsed() < SLACK, "dropping it kills it");
}

/// Truth: the computer's clock. On a clock that nobody turns, a real line still ends its wait.
#[test]
fn a_clock_that_stands_does_not_hang_a_real_line() {
    use sunglint_drivers::clock::{Deadline, VirtualClock};
    let (mut host, _device) = tcp();
    let clock = std::sync::Arc::new(VirtualClock::new());
    let begun = Instant::now();
    let deadline = Deadline::after(clock, Duration::from_millis(200));
    assert!(host.receive(&mut [0], &deadline).unwrap_err().is_timeout());
    let took = begun.elapsed();
    assert!(took >= Duration::from_millis(200) && took < SLACK, "{took:?}");
}
