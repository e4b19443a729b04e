//! The recording format: round trips, hostile text, strict replay.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use proptest::prelude::*;
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Clock as _, Deadline, VirtualClock};
use sunglint_drivers::recording::{Event, Fault, Header, Recorded, Recording, Replay};
use sunglint_drivers::transport::{Bytes, Transfer, Transfers, TransportError};
use sunglint_formats::FileError;
use sunglint_formats::atomic::Overwrite;

const HEAD: &str = "# device=d\n# source=s\n# synthetic=yes\n";

fn header() -> Header {
    Header { device: "d".into(), source: "s".into(), host: None, recorded: None, synthetic: true }
}

fn replay(events: &str) -> Replay {
    Replay::new(Recording::parse("case.rec", &format!("{HEAD}{events}")).unwrap())
}

fn second() -> Deadline {
    Deadline::after(Arc::new(VirtualClock::new()), Duration::from_secs(1))
}

fn data() -> impl Strategy<Value = Vec<u8>> {
    proptest::collection::vec(any::<u8>(), 0..40)
}

fn transfer() -> impl Strategy<Value = Transfer> {
    prop_oneof![
        any::<(u8, u8, u16, u16, u16)>().prop_map(
            |(request_type, request, value, index, length)| {
                Transfer::ControlIn { request_type, request, value, index, length }
            }
        ),
        (any::<(u8, u8, u16, u16)>(), data()).prop_map(
            |((request_type, request, value, index), data)| {
                Transfer::ControlOut { request_type, request, value, index, data }
            }
        ),
        (any::<u8>(), 0..100_000_usize)
            .prop_map(|(endpoint, length)| Transfer::BulkIn { endpoint, length }),
        (any::<u8>(), data()).prop_map(|(endpoint, data)| Transfer::BulkOut { endpoint, data }),
        any::<u8>().prop_map(|endpoint| Transfer::ClearHalt { endpoint }),
        (0..100_000_usize).prop_map(|length| Transfer::ReportIn { length }),
        data().prop_map(|data| Transfer::ReportOut { data }),
        (any::<u8>(), 0..1000_usize)
            .prop_map(|(report, length)| Transfer::FeatureGet { report, length }),
        data().prop_map(|data| Transfer::FeatureSet { data }),
    ]
}

fn event() -> impl Strategy<Value = Event> {
    prop_oneof![
        proptest::collection::vec(any::<u8>(), 1..40).prop_map(Event::Sent),
        data().prop_map(Event::Received),
        transfer().prop_map(Event::Asked),
        (0..=86_400_000_000_u64).prop_map(|us| Event::Pause(Duration::from_micros(us))),
        Just(Event::Fault(Fault::Timeout)),
        Just(Event::Fault(Fault::Stall)),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, failure_persistence: None, ..ProptestConfig::default() })]

    /// Truth: the events themselves.
    #[test]
    fn any_list_of_events_goes_round(
        events in proptest::collection::vec(event(), 0..30),
        gone in any::<bool>(),
        names in proptest::collection::vec("[ -~é]{0,20}[!-~]", 4..5),
        synthetic in any::<bool>(),
    ) {
        let name = |i: usize| names[i].trim().to_owned();
        let header = Header {
            device: name(0), source: name(1), host: Some(name(2)), recorded: Some(name(3)), synthetic,
        };
        let mut recording = Recording::new(header, events);
        if gone {
            recording.events.push((0, Event::Fault(Fault::Disconnect)));
        }
        let text = recording.to_text().unwrap();
        let back = Recording::parse("x", &text).unwrap();
        prop_assert_eq!(&back.header, &recording.header);
        let only = |recording: &Recording| -> Vec<Event> {
            recording.events.iter().map(|(_, event)| event.clone()).collect()
        };
        prop_assert_eq!(only(&back), only(&recording));
    }
}

/// A million broken texts: valid lines with bytes changed, lost, doubled, and pure noise. No panic; what is accepted can be
/// written and read again. The generator is written out here, since a property runner costs more than the parser.
#[test]
fn a_million_broken_texts_do_no_harm() {
    use rand::{RngExt as _, SeedableRng as _};
    let mut random = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(5);
    let lines = [
        "# device=a",
        "# source=b",
        "# synthetic=yes",
        "# host=c",
        "> 01 ff 30 ; .0",
        "< 02",
        "<",
        "~ 12.345",
        "~ 86400000",
        "! timeout",
        "! disconnect",
        "! stall",
        "; remark",
        "> [control-in type=c0 request=a1 value=0000 index=0022 length=64]",
        "> [control-out type=40 request=83 value=0001 index=0000] 01",
        "> [bulk-in endpoint=82 length=64]",
        "> [bulk-out endpoint=02] 2a 49",
        "> [feature-get report=01 length=17]",
        "> [feature-set] 03 7e",
        "> [clear-halt endpoint=82]",
    ];
    let alphabet: Vec<char> =
        "0123456789abcdefxyz[]=;#<>~!. \t\n\r-+éß\u{0}\u{2028}".chars().collect();
    let (mut accepted, mut refused) = (0_u32, 0_u32);
    for _ in 0..1_000_000 {
        let mut text = String::new();
        if random.random_bool(0.9) {
            text.push_str(HEAD);
        }
        for _ in 0..random.random_range(0..3) {
            text.push_str(lines[random.random_range(0..lines.len())]);
            text.push('\n');
        }
        let mut letters: Vec<char> = text.chars().collect();
        for _ in 0..random.random_range(0..3) {
            let at = random.random_range(0..=letters.len());
            let new = alphabet[random.random_range(0..alphabet.len())];
            match random.random_range(0..3) {
                0 => letters.insert(at, new),
                1 if at < letters.len() => letters[at] = new,
                _ if at < letters.len() => drop(letters.remove(at)),
                _ => {}
            }
        }
        let text: String = letters.into_iter().collect();
        match Recording::parse("x", &text) {
            Ok(recording) => {
                accepted += 1;
                let again = Recording::parse("x", &recording.to_text().unwrap()).unwrap();
                assert_eq!(again.events.len(), recording.events.len(), "{text:?}");
            }
            Err(error) => {
                refused += 1;
                assert!(error.line.is_some() || error.field.is_some(), "{error}");
            }
        }
    }
    assert!(accepted > 100_000 && refused > 100_000, "{accepted} accepted, {refused} refused");
}

/// Truth: the messages that a person needs, written out.
#[test]
fn errors_name_line_and_field() {
    let message = |text: &str| Recording::parse("case.rec", text).unwrap_err().to_string();
    assert_eq!(
        message("# devise=x\n"),
        "case.rec:1: header: found `devise`, expected one of device, source, host, recorded, synthetic (did you mean `device`?)"
    );
    assert_eq!(
        message("# device=d\n# source=s\n"),
        "case.rec: synthetic: found no such line in the header, expected a line `# synthetic=…`"
    );
    let in_line_4 = |line: &str| message(&format!("{HEAD}{line}\n"));
    assert_eq!(
        in_line_4("> 1"),
        "case.rec:4: data: found `1`, expected two hexadecimal digits for each byte"
    );
    assert_eq!(
        in_line_4("~ 86400000.001"),
        "case.rec:4: pause: found `86400000.001`, expected milliseconds, with at most three decimals, at most a day"
    );
    assert_eq!(
        in_line_4("! fire"),
        "case.rec:4: fault: found `fire`, expected timeout, disconnect or stall"
    );
    assert_eq!(
        in_line_4("> [bulk-in endpoint=82 size=64]"),
        "case.rec:4: request: found `size=64`, expected length=…"
    );
    assert_eq!(
        in_line_4("> [bulk-in endpoint=82 length=9999999]"),
        "case.rec:4: length: found `9999999`, expected a number of at most 1048576"
    );
    assert_eq!(
        in_line_4("! disconnect\n> 01"),
        "case.rec:5: event: found `> 01`, expected nothing after `! disconnect`"
    );
}

/// Truth: the recording, by hand. Both sides and the line are shown; pauses pass on the clock to the millisecond.
#[test]
fn replay_is_strict_and_keeps_time() {
    let clock = Arc::new(VirtualClock::new());
    let deadline = Deadline::after(clock.clone(), Duration::from_secs(10));
    let mut line = replay("> 01 02\n~ 250\n< 0a 0b\n< 0c\n~ 5000\n> 03\n");
    // Where one send ends means nothing.
    line.send(&[1], &deadline).unwrap();
    line.send(&[2], &deadline).unwrap();
    let mut three = [0; 3];
    line.receive_exact(&mut three, &deadline).unwrap();
    assert_eq!((three, clock.now()), ([10, 11, 12], Duration::from_millis(250)));
    // The host need not think as long as it did.
    let error = line.send(&[4, 5], &deadline).unwrap_err();
    assert_eq!(error.to_string(), "case.rec:9: the host sends `> 04 05`, the recording has `> 03`");
    line.send(&[3], &deadline).unwrap();
    assert_eq!(
        line.send(&[9], &deadline).unwrap_err().to_string(),
        "case.rec:9: the host sends `> 09`, the recording has ended"
    );
    line.finish().unwrap();
}

#[test]
fn what_is_left_over_is_told() {
    let deadline = second();
    let mut line = replay("> 01\n< 0a 0b\n");
    line.send(&[1], &deadline).unwrap();
    line.receive(&mut [0], &deadline).unwrap();
    // The host speaks while the device does.
    assert_eq!(
        line.send(&[2], &deadline).unwrap_err().to_string(),
        "case.rec:5: the host sends `> 02`, the recording has `< 0b`"
    );
    assert_eq!(
        line.finish().unwrap_err().to_string(),
        "case.rec:5: the host has finished, the recording goes on with `< 0b`"
    );
    let mut line = replay("> 01\n");
    assert_eq!(
        line.receive(&mut [0], &deadline).unwrap_err().to_string(),
        "case.rec:4: the host waits for the device, the recording has `> 01`"
    );
}

/// Truth: the deadline of the host, 1 s on the virtual clock, and what had come by then.
#[test]
fn recorded_faults_happen_again() {
    let deadline = second();
    let mut line = replay("> 01\n< 0a\n! timeout\n> 02\n! disconnect\n");
    line.send(&[1], &deadline).unwrap();
    let error = line.receive_exact(&mut [0; 2], &deadline).unwrap_err();
    match error {
        TransportError::Timeout { after, got_so_far } => {
            assert_eq!((after, got_so_far), (Duration::from_secs(1), vec![10]));
        }
        other => panic!("{other}"),
    }
    let deadline = second();
    line.send(&[2], &deadline).unwrap();
    for _ in 0..2 {
        let error = line.receive(&mut [0], &deadline).unwrap_err();
        assert!(matches!(error, TransportError::Disconnected { .. }), "{error}");
    }
    // A pause longer than the host's patience: it times out, and hears the rest later.
    let mut line = replay("> 01\n~ 1500\n< 0a\n");
    let clock = Arc::new(VirtualClock::new());
    let step = || Deadline::after(clock.clone(), Duration::from_secs(1));
    line.send(&[1], &step()).unwrap();
    assert!(line.receive(&mut [0], &step()).unwrap_err().is_timeout());
    assert!(line.discard(&step()).unwrap().is_empty());
    assert_eq!(line.receive(&mut [0], &step()).unwrap(), 1);
    assert_eq!(clock.now(), Duration::from_millis(1500));
}

/// Truth: the same calls on the recording of a recording: what was recorded replays, byte for byte, for streams and for
/// transfers; the file is complete after every event, before anything is closed.
#[test]
fn what_is_recorded_replays() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("case.rec");
    let clock = Arc::new(VirtualClock::new());
    let within = || Deadline::after(clock.clone(), Duration::from_secs(1));
    let source = "> 24 49\n~ 30.5\n< 2a 20\n< 41 0a\n> 01\n! timeout\n> 02\n! disconnect\n";
    let mut line = Recorded::create(replay(source), &path, &header(), Overwrite::Refuse).unwrap();
    line.send(b"$I", &within()).unwrap();
    assert!(std::fs::read_to_string(&path).unwrap().ends_with("> 24 49  ; $I\n"));
    assert_eq!(line.receive_until(b'\n', 10, &within()).unwrap(), b"* A\n");
    line.send(&[1], &within()).unwrap();
    line.receive(&mut [0], &within()).unwrap_err();
    line.send(&[2], &within()).unwrap();
    line.receive(&mut [0], &within()).unwrap_err();
    let recording = Recording::read(&path).unwrap();
    let mut again = Replay::new(recording);
    again.send(b"$I", &within()).unwrap();
    assert_eq!(again.receive_until(b'\n', 10, &within()).unwrap(), b"* A\n");
    again.send(&[1], &within()).unwrap();
    assert!(again.receive(&mut [0], &within()).unwrap_err().is_timeout());
    again.send(&[2], &within()).unwrap();
    again.finish().unwrap();
    let exists = Recorded::create(replay(""), &path, &header(), Overwrite::Refuse).unwrap_err();
    assert!(matches!(exists, FileError::Exists { .. }), "{exists}");
}

#[test]
fn transfers_are_recorded_and_replayed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("usb.rec");
    let clock = Arc::new(VirtualClock::new());
    let within = || Deadline::after(clock.clone(), Duration::from_secs(1));
    let source = "> [control-out type=21 request=09 value=0300 index=0000] 03 7e\n\
        > [feature-get report=01 length=17]\n~ 3\n< 01 7e\n\
        > [bulk-in endpoint=82 length=64]\n! stall\n\
        > [clear-halt endpoint=82]\n\
        > [bulk-out endpoint=02] 2a\n! timeout\n";
    let calls = |device: &mut dyn Transfers| {
        let out = Transfer::ControlOut {
            request_type: 0x21,
            request: 9,
            value: 0x300,
            index: 0,
            data: vec![3, 0x7e],
        };
        assert!(device.transfer(&out, &within()).unwrap().is_empty());
        let get = Transfer::FeatureGet { report: 1, length: 17 };
        assert_eq!(device.transfer(&get, &within()).unwrap(), [1, 0x7e]);
        let read = Transfer::BulkIn { endpoint: 0x82, length: 64 };
        let stalled = device.transfer(&read, &within()).unwrap_err();
        assert!(matches!(stalled, TransportError::Stalled { .. }), "{stalled}");
        device.transfer(&Transfer::ClearHalt { endpoint: 0x82 }, &within()).unwrap();
    };
    let mut device = Recorded::create(replay(source), &path, &header(), Overwrite::Refuse).unwrap();
    calls(&mut device);
    let write = Transfer::BulkOut { endpoint: 2, data: vec![0x2a] };
    assert!(device.transfer(&write, &within()).unwrap_err().is_timeout());
    // The same again, and strictly: both sides are shown.
    calls(&mut Replay::new(Recording::read(&path).unwrap()));
    let mut again = Replay::new(Recording::read(&path).unwrap());
    let wrong = Transfer::FeatureSet { data: vec![9] };
    let error = again.transfer(&wrong, &second()).unwrap_err().to_string();
    assert!(
        error.ends_with(
            "usb.rec:4: the host asks `> [feature-set] 09`, the recording has `> [control-out type=21 request=09 value=0300 index=0000] 03 7e`"
        ),
        "{error}"
    );
}

/// Truth: probabilities of 1 and 0. Requests fail as asked, in the host's own time, and the device within is untouched.
#[test]
fn faults_of_requests() {
    use sunglint_drivers::recording::{Faults, Faulty};
    let source = "> [bulk-in endpoint=82 length=8]\n< 00 00 00 00\n";
    let read = Transfer::BulkIn { endpoint: 0x82, length: 8 };
    let with = |faults| {
        let deadline = second();
        let mut device = Faulty::new(replay(source), faults, 1);
        let answer = device.transfer(&read, &deadline);
        (answer, device.injected(), deadline.elapsed())
    };
    assert_eq!(with(Faults::NONE).0.unwrap(), [0; 4]);
    let (answer, injected, _) = with(Faults { flip: 1.0, ..Faults::NONE });
    assert!(answer.unwrap().iter().all(|byte| byte.count_ones() == 1) && injected.flips == 4);
    let (answer, _, took) = with(Faults { silence: 1.0, ..Faults::NONE });
    assert!(answer.unwrap_err().is_timeout() && took == Duration::from_secs(1));
    let (answer, ..) = with(Faults { short_read: 1.0, ..Faults::NONE });
    assert!((1..4).contains(&answer.unwrap().len()));
    let (answer, injected, _) = with(Faults { disconnect: 1.0, ..Faults::NONE });
    assert!(matches!(answer, Err(TransportError::Disconnected { .. })) && injected.disconnected);
}

#[test]
fn a_header_that_would_not_read_back_is_not_written() {
    for device in ["", " x", "two\nlines"] {
        let header = Header { device: device.into(), ..header() };
        let error = Recording::new(header, []).to_text().unwrap_err();
        assert_eq!(error.field, "device", "{device:?}");
    }
    let long = Event::Pause(Duration::from_nanos(1));
    assert!(Recording::new(header(), [long]).to_text().is_err());
}

/// Truth: a full disk, which `/dev/full` is.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_told() {
    let made = Recorded::create(replay("> 01\n"), "/dev/full", &header(), Overwrite::Allow);
    let error = made.expect_err("nothing fits").to_string();
    assert!(error.starts_with("cannot write /dev/full: "), "{error}");
}
