//! SCPI in the requests of ZeroMQ: our driver with a socket of pyzmq 27.3.0 that answers as an ID900, and other ends that break the protocol.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use rand::{RngExt as _, SeedableRng as _};
use std::collections::{BTreeMap, VecDeque};
use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::catalogue::{Address, AnyDevice};
use sunglint_drivers::clock::{Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{Device as _, DeviceError, Level, Meter, Value};
use sunglint_drivers::recording::{Faults, Faulty, Injected};
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

/// Faults of the other end at an answer.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Slip {
    Silence,
    Late(Duration),
    /// The second half is lost.
    Half,
    /// A command of the protocol comes before it.
    Ping,
}

/// A socket of the kind REP in memory, of a counter whose rate grows by 1 % a second.
#[derive(Default)]
struct Rep {
    heard: Vec<u8>,
    said: VecDeque<(Duration, u8)>,
    /// Outcome of this connection: nothing, the greeting, the handshake.
    stage: u8,
    closed: bool,
    answers: u32,
    slips: BTreeMap<u32, Slip>,
}

fn rate(at: Duration) -> f64 {
    5e6 * 1.01_f64.powf(at.as_secs_f64())
}

impl Rep {
    fn new(seed: u64) -> Self {
        let mut random = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(seed);
        let slips = (0..3).map(|_| {
            let slip = match random.random_range(0..4) {
                0 => Slip::Silence,
                1 => Slip::Late(Duration::from_millis(random.random_range(0..1000))),
                2 => Slip::Half,
                _ => Slip::Ping,
            };
            (random.random_range(1..10), slip)
        });
        Self { slips: slips.collect(), ..Self::default() }
    }

    fn say(&mut self, bytes: &[u8], at: Duration) {
        self.said.extend(bytes.iter().map(|byte| (at, *byte)));
    }

    /// The next whole frame that came: flags and body. A long one, or one of unknown flags, closes the connection.
    fn frame(&mut self) -> Option<(u8, Vec<u8>)> {
        let (&flags, &length) = (self.heard.first()?, self.heard.get(1)?);
        if flags & !5 != 0 {
            self.closed = true;
            return None;
        }
        let end = 2 + usize::from(length);
        let body = self.heard.get(2..end)?.to_vec();
        self.heard.drain(..end);
        Some((flags, body))
    }

    fn go_on(&mut self, now: Duration) {
        if self.stage == 0 && self.heard.len() >= 64 {
            self.heard.drain(..64);
            self.say(&[greeting(3, b"NULL"), ready(b"REP")].concat(), now);
            self.stage = 1;
        }
        while self.stage > 0 && !self.closed {
            let Some((flags, body)) = self.frame() else { return };
            if self.stage == 1 || flags & 4 != 0 {
                self.stage = 2;
            } else if flags & 1 == 0 {
                self.request(&body, now);
            }
        }
    }

    fn request(&mut self, line: &[u8], now: Duration) {
        let text = match line {
            b"*IDN?" => "IDQ,ID900-MASTER,190001,1.13".to_owned(),
            b"C?" => format!("{:.7E}\n", rate(now)),
            _ => "SCPI_ERR_UNKNOWN_COMMAND".to_owned(),
        };
        self.answers += 1;
        let bytes = answer(text.as_bytes());
        match self.slips.get(&self.answers) {
            Some(Slip::Silence) => {}
            Some(Slip::Late(by)) => self.say(&bytes, now + *by),
            Some(Slip::Half) => self.say(&bytes[..bytes.len() / 2], now),
            Some(Slip::Ping) => {
                self.say(&[frame(4, b"\x04PING\0\x0a"), bytes].concat(), now);
            }
            None => self.say(&bytes, now),
        }
    }
}

impl Bytes for Rep {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        deadline.remaining()?;
        self.heard.extend(bytes);
        self.go_on(deadline.now());
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        loop {
            let now = deadline.now();
            let ready = self.said.iter().take(buffer.len()).take_while(|(due, _)| *due <= now);
            let ready = ready.count();
            if ready > 0 {
                for (to, (_, byte)) in buffer.iter_mut().zip(self.said.drain(..ready)) {
                    *to = byte;
                }
                return Ok(ready);
            }
            if self.closed && self.said.is_empty() {
                return Err(TransportError::disconnected("the other end"));
            }
            let next = self.said.front().map_or(Duration::MAX, |(due, _)| *due - now);
            deadline.sleep(next)?;
        }
    }

    fn discard(&mut self, _: &Deadline) -> Result<Vec<u8>, TransportError> {
        Ok(Vec::new())
    }

    /// A new connection: what was still to come on the old one never does.
    fn reconnect(&mut self, deadline: &Deadline) -> Result<(), TransportError> {
        deadline.remaining()?;
        self.heard.clear();
        self.said.clear();
        (self.stage, self.closed) = (0, false);
        Ok(())
    }
}

fn name(error: &DeviceError) -> &'static str {
    match error {
        DeviceError::Transport { .. } => "transport",
        DeviceError::TooSlow { .. } => "too slow",
        DeviceError::Protocol { .. } => "protocol",
        DeviceError::Rejected { .. } => "rejected",
        other => panic!("no such error can come of a bad line: {other}"),
    }
}

/// A life with the counter: opened, read five times, asked who it is. Each call ends in its time. Counts readings that are not of their own time.
fn life(seed: u64, faults: Faults, injected: &mut Injected) -> (Result<(), DeviceError>, u32) {
    let clock = Arc::new(VirtualClock::new());
    let limit = Duration::from_secs(10);
    let within = || Deadline::after(clock.clone(), limit);
    let in_time = |begun: Duration| {
        let took = clock.now() - begun;
        assert!(took <= limit, "seed {seed}: {took:?}");
    };
    let line = crate::common::scpi::Shared::new(Faulty::new(Rep::new(seed), faults, seed));
    let about = Definition::parse("device.toml", FILE).unwrap();
    let link = Link::zeromq(line.clone(), &about);
    let mut wrong = 0;
    let go = || -> Result<(), DeviceError> {
        let opened = ScpiMeter::open(link, about, &Told::default(), &within());
        in_time(Duration::ZERO);
        let mut meter = opened?;
        for _ in 0..5 {
            let begun = clock.now();
            let read = meter.read(&within());
            in_time(begun);
            let (least, most) = (rate(begun) * 0.999_999, rate(clock.now()) * 1.000_001);
            let right = matches!(read?, Level::Value(found) if (least..=most).contains(&found));
            wrong += u32::from(!right);
        }
        meter.identity(&within()).map(|_| ())
    };
    let end = go();
    let now = line.with(|line| line.injected());
    injected.delays += now.delays;
    injected.drops += now.drops;
    injected.flips += now.flips;
    injected.silences += now.silences;
    (end, wrong)
}

fn thousand(faults: impl Fn(u64) -> Faults) -> (BTreeMap<&'static str, u32>, Injected, u32) {
    let (mut ends, mut sum, mut wrong) = (BTreeMap::new(), Injected::default(), 0);
    for seed in 0..1000 {
        let (end, readings) = life(seed, faults(seed), &mut sum);
        wrong += readings;
        *ends.entry(end.as_ref().map_or_else(name, |()| "right")).or_default() += 1;
    }
    eprintln!("{ends:?} {sum:?}, {wrong} wrong");
    (ends, sum, wrong)
}

/// Truth: the rate that the other end counts at its own time (six digits), and the clock. Delays beyond the host's patience of 0.5 s, answers that are missing, late or torn, and
/// cables pulled out: a thousand lives end right or with a named error, in time, and no reading is wrong.
#[test]
fn a_thousand_counters_on_losing_lines_are_right_or_errors() {
    let (ends, sum, wrong) = thousand(|seed| Faults {
        delay: 0.01,
        longest_delay: Duration::from_millis(800),
        short_read: 0.05,
        disconnect: if seed.is_multiple_of(3) { 0.000_3 } else { 0.0 },
        ..Faults::NONE
    });
    assert!(sum.delays > 400, "{sum:?}");
    assert_eq!(wrong, 0);
    assert!((600..1000).contains(&ends["right"]), "{ends:?}");
}

/// The same with bytes altered and lost, which TCP itself does not let happen: every life ends in time with a named error or is done. A digit that is altered cannot be seen: at most one reading in a hundred.
#[test]
fn a_thousand_counters_on_spoiling_lines_end_in_time() {
    let (ends, sum, wrong) = thousand(|_| Faults {
        delay: 0.005,
        longest_delay: Duration::from_millis(800),
        drop: 0.000_5,
        flip: 0.000_5,
        silence: 0.000_5,
        ..Faults::NONE
    });
    assert!(sum.flips > 150 && sum.drops > 150, "{sum:?}");
    assert!(wrong < 50, "{wrong}");
    assert!(ends["right"] >= 400, "{ends:?}");
}
