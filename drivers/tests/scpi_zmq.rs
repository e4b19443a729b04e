//! SCPI in the requests of ZeroMQ: our driver with a socket of pyzmq 27.3.0 that answers as an ID900, and other ends that break the protocol.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::catalogue::{Address, AnyDevice};
use sunglint_drivers::clock::{Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{DeviceError, Level, Meter, Value};
use sunglint_drivers::scpi::{Definition, Link, ScpiMeter, Told};
use sunglint_drivers::transport::{Bytes, TransportError};
use sunglint_testkit::peer_python;

/// A counter on a socket of the kind REP. Its number is that of the last whole cycle, counted from its start, so that a test sees of when a reading is. It refuses
/// what it does not know as IDQ's own programs expect it, and once answers late.
const DEVICE: &str = r#"
import sys, time, zmq
socket = zmq.Context().socket(zmq.REP)
print(socket.bind_to_random_port("tcp://127.0.0.1"), flush=True)
begun, cycle, edge, late = time.monotonic(), 1.0, "RISING", True
while True:
    line = socket.recv().decode()
    now = int((time.monotonic() - begun) / cycle)
    if line == "*IDN?": answer = "IDQ,ID900-MASTER,190001,1.13"
    elif line == "INPU1:ENAB ON": answer = "Value set to ON"
    elif line.startswith("INPU1:COUN:MODE CYCL;INTE "):
        cycle = int(line.split()[-1]) * 1e-9
        answer = ""
    elif line == "INPU1:COUN?": answer = f"{now - 1}\n"
    elif line == "NOW?": answer = f"{now}\n"
    elif line.startswith("INPU1:EDGE "): edge, answer = line[11:], ""
    elif line == "INPU1:EDGE?": answer = edge
    elif line == "LONG?": answer = "7" + " " * 300
    elif line == "LATE?":
        if late: time.sleep(1.5)
        answer, late = "31" if late else "32", False
    else: answer = "SCPI_ERR_UNKNOWN_COMMAND: " + line
    socket.send_string(answer)
"#;

struct Counter(Child);

impl Drop for Counter {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn counter(python: &std::path::Path) -> (Counter, String) {
    let mut device =
        Command::new(python).args(["-c", DEVICE]).stdout(Stdio::piped()).spawn().unwrap();
    let printed = device.stdout.take().unwrap();
    let device = Counter(device);
    let mut line = String::new();
    BufReader::new(printed).read_line(&mut line).unwrap();
    (device, format!("scpi:zmq:127.0.0.1:{}", line.trim()))
}

/// Opens it by the address that a user writes.
fn opened(address: &str, file: &str) -> Box<dyn Meter> {
    let mut address = Address::parse(address, &[format!("device={file}")]).unwrap();
    let within = crate::common::within;
    let line = address.connect(&within(20.0)).unwrap();
    let AnyDevice::Meter(meter) = address.open(line, &within(20.0)).unwrap() else { panic!() };
    meter
}

/// The template on a device of pyzmq. Truth: the device's own number of each cycle: a reading is of a cycle that began after it was asked for, and none is told twice.
#[test]
fn the_template_reads_a_counter_on_pyzmq() {
    let name = "the_template_reads_a_counter_on_pyzmq";
    let Some(python) = peer_python(name, &["zmq"]) else { return };
    let (_device, address) = counter(&python);
    let folder = tempfile::tempdir().unwrap();
    let within = crate::common::within;
    let mut meter = opened(&address, "idq_id900");
    let mut clock = opened(&address, &own(&folder, "NOW?"));
    assert_eq!(meter.identity(&within(20.0)).unwrap().driver, "scpi-meter");
    let mut last = 0.0;
    for _ in 0..3 {
        let Level::Value(now) = clock.read(&within(20.0)).unwrap() else { panic!() };
        let Level::Value(cycle) = meter.read(&within(20.0)).unwrap() else { panic!() };
        assert!(
            cycle > now && cycle > last,
            "cycle {cycle}, asked for in cycle {now}, after {last}"
        );
        last = cycle;
    }
    let edge = meter.set_own("edge", "falling", &within(20.0)).unwrap();
    assert_eq!(edge, Value::Text("falling".into()));
}

/// A file with one question.
fn own(folder: &tempfile::TempDir, question: &str) -> String {
    let path = folder.path().join(format!("{}.toml", question.trim_end_matches('?')));
    let text = format!(
        "kind = \"meter\"\nname = \"counter\"\nunit = \"1\"\n[line]\ntimeout_ms = 1000\n[identify]\nexpect = \"{{vendor}},{{model}},{{serial}},{{firmware}}\"\n\
         [errors]\nsend = \"\"\n[read]\nsend = \"{question}\"\nfresh = \"trigger\"\n"
    );
    std::fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

/// Truth: the device's own script. An answer that comes after its time is not taken for the next one: the connection is made anew. A line that it refuses is an error with its words. An
/// answer of more than 255 bytes comes in a long frame.
#[test]
fn late_long_and_refused_answers_on_pyzmq() {
    let name = "late_long_and_refused_answers_on_pyzmq";
    let Some(python) = peer_python(name, &["zmq"]) else { return };
    let (_device, address) = counter(&python);
    let folder = tempfile::tempdir().unwrap();
    let within = crate::common::within;
    let mut late = opened(&address, &own(&folder, "LATE?"));
    assert_eq!(late.read(&within(20.0)).unwrap(), Level::Value(32.0));
    let identity = late.identity(&within(20.0)).unwrap();
    assert_eq!((identity.vendor.as_str(), identity.model.as_str()), ("IDQ", "ID900-MASTER"));
    let mut long = opened(&address, &own(&folder, "LONG?"));
    assert_eq!(long.read(&within(20.0)).unwrap(), Level::Value(7.0));
    let mut refused = opened(&address, &own(&folder, "NONSENSE?"));
    match refused.read(&within(20.0)).unwrap_err() {
        DeviceError::Rejected { request, said, .. } => {
            assert_eq!(request, "NONSENSE?");
            assert!(said.starts_with("SCPI_ERR_UNKNOWN_COMMAND"), "{said}");
        }
        other => panic!("{other}"),
    }
}

/// The other end: says what it has to say, and is silent or gone then. A new connection says the same.
struct Canned {
    all: Vec<u8>,
    said: usize,
    goes: bool,
}

impl Bytes for Canned {
    fn send(&mut self, _: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        Ok(deadline.remaining().map(|_| ())?)
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        let left = &self.all[self.said..];
        if left.is_empty() {
            if self.goes {
                return Err(TransportError::disconnected("the other end"));
            }
            deadline.sleep(Duration::MAX)?;
        }
        let count = buffer.len().min(left.len());
        buffer[..count].copy_from_slice(&left[..count]);
        self.said += count;
        Ok(count)
    }

    fn discard(&mut self, _: &Deadline) -> Result<Vec<u8>, TransportError> {
        Ok(Vec::new())
    }

    fn reconnect(&mut self, deadline: &Deadline) -> Result<(), TransportError> {
        self.said = 0;
        Ok(deadline.remaining().map(|_| ())?)
    }
}

const FILE: &str = "kind = \"meter\"\nname = \"counter\"\nunit = \"1/s\"\n[line]\ntimeout_ms = 500\n[identify]\nexpect = \"{rest}\"\n[errors]\nsend = \"\"\n[read]\nsend = \"C?\"\nfresh = \"trigger\"\n";

/// Opens and reads once; how that ended, and how long it took.
fn ends(all: Vec<u8>, goes: bool) -> (Result<Level, String>, Duration) {
    let clock = Arc::new(VirtualClock::new());
    let deadline = Deadline::after(clock.clone(), Duration::from_secs(10));
    let about = Definition::parse("device.toml", FILE).unwrap();
    let link = Link::zeromq(Canned { all, said: 0, goes }, &about);
    let read = || -> Result<Level, DeviceError> {
        ScpiMeter::open(link, about, &Told::default(), &deadline)?.read(&deadline)
    };
    (read().map_err(|error| error.to_string()), clock.now())
}

fn greeting(version: u8, security: &[u8]) -> Vec<u8> {
    let mut all = b"\xFF\0\0\0\0\0\0\0\x01\x7F".to_vec();
    all.extend([version, 1]);
    all.extend(security);
    all.resize(64, 0);
    all
}

fn frame(flags: u8, body: &[u8]) -> Vec<u8> {
    [&[flags, u8::try_from(body.len()).unwrap()], body].concat()
}

fn ready(kind: &[u8]) -> Vec<u8> {
    let length = u8::try_from(kind.len()).unwrap();
    frame(4, &[b"\x05READY\x0bSocket-Type\0\0\0", &[length][..], kind].concat())
}

fn answer(text: &[u8]) -> Vec<u8> {
    [frame(1, b""), frame(0, text)].concat()
}

/// A greeting and a handshake that are right.
fn begun() -> Vec<u8> {
    [greeting(3, b"NULL"), ready(b"REP")].concat()
}

/// Truth: the rule of ZMTP 3.0 that each breaks. Each ends within twice its time with an error that names it; sizes are refused before memory is taken for them.
#[test]
fn broken_ends_are_named_in_time() {
    let huge = b"\x02\x10\0\0\0\0\0\0\0abc".to_vec();
    let after = |rest: &[u8]| [begun(), rest.to_vec()].concat();
    let read = |rest: &[u8]| [begun(), answer(b"IDQ"), rest.to_vec()].concat();
    let hand = |rest: Vec<u8>| [greeting(3, b"NULL"), rest].concat();
    let cases: Vec<(&str, Vec<u8>, &str)> = vec![
        ("silence", Vec::new(), "no answer within 0.5"),
        ("plain SCPI", b"KEITHLEY,2000\n".to_vec(), "its first byte is `K`, no greeting of ZeroMQ"),
        ("a torn greeting", greeting(3, b"NULL")[..30].to_vec(), "no answer within"),
        (
            "ZMTP 1",
            b"\xFF\0\0\0\0\0\0\0\x01\x7F\x01\x04".to_vec(),
            "found version 1, expected ZMTP",
        ),
        ("security", greeting(3, b"CURVE"), "found the security `CURVE`, expected NULL"),
        ("a publisher", hand(ready(b"PUB")), "a socket of the kind `PUB`, expected REP or ROUTER"),
        ("refused", hand(frame(4, b"\x05ERROR\x08no entry")), "refuses the connection: `no entry`"),
        (
            "no kind",
            hand(frame(4, b"\x05READY")),
            "its handshake: found `\\u{5}READY`, expected READY",
        ),
        (
            "a message too soon",
            hand(frame(0, b"hello")),
            "its handshake: found `hello`, expected READY",
        ),
        (
            "a huge handshake",
            hand(huge.clone()),
            "frame 1 of its handshake: it is said to have more than",
        ),
        (
            "a huge answer",
            read(&huge),
            "frame 1 of the answer to C?: it is said to have more than 65536",
        ),
        ("unknown flags", read(b"\x08\x00"), "frame 1 of the answer to C?: found flags 0x08"),
        ("more of a command", read(b"\x05\x00"), "found flags 0x05"),
        (
            "no empty frame",
            read(&frame(0, b"17")),
            "found 2 bytes and the end, expected an empty frame",
        ),
        (
            "three parts",
            read(&[frame(1, b""), frame(1, b"17"), frame(0, b"")].concat()),
            "frame 2 of the answer to C?: found 2 bytes and more to follow",
        ),
        ("pings", read(&frame(4, b"\x04PING\0\x0a").repeat(100)), "16 frames and no text"),
        ("an error", read(&frame(4, b"\x05ERROR\x03out")), "refuses the connection: `out`"),
        ("no number", read(&answer(b"many")), "the answer to C?: found `many`, expected"),
        ("refused line", read(&answer(b"SCPI_ERR_X")), "refused C?: it says `SCPI_ERR_X`"),
        ("no name", after(&[]), "no answer within 0.5"),
    ];
    for (name, all, words) in cases {
        let (end, took) = ends(all, false);
        let error = end.unwrap_err();
        assert!(error.contains(words), "{name}: {error}");
        assert!(took <= Duration::from_millis(2100), "{name}: {took:?}");
    }
}

/// Truth: by construction: an exchange that is whole gives its number; one that is cut off anywhere, by silence or a closed connection, an error, and none is read wrongly. Commands of the protocol between frames
/// do not matter.
#[test]
fn an_exchange_that_is_torn_anywhere_is_an_error() {
    let ping = frame(4, b"\x04PING\0\x0a");
    let whole = [begun(), ping.clone(), answer(b"IDQ"), ping, answer(b"1234\n")].concat();
    assert_eq!(ends(whole.clone(), true).0, Ok(Level::Value(1234.0)));
    for torn in 0..whole.len() {
        for goes in [false, true] {
            let (end, took) = ends(whole[..torn].to_vec(), goes);
            let error = end.unwrap_err();
            let words = if goes { "is gone" } else { "no answer within" };
            assert!(error.contains(words), "{torn}: {error}");
            assert!(took <= Duration::from_millis(2100), "{torn}: {took:?}");
        }
    }
}
