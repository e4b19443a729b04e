//! Messages that power meters and the wheel may send, spoilt at random: no panic, and what is read keeps its promises.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use proptest::prelude::*;
use rand::SeedableRng as _;
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Deadline, VirtualClock};
use sunglint_drivers::ophir::reply::{
    Choice, Head, Instrument, LONGEST_LINE, Line, Ranges, Reading, Wavelengths, Zeroing,
};
use sunglint_drivers::ophir::{LinkSettings, Meter, MeterSettings};
use sunglint_drivers::thorlabs::{Pm100, Pm100Settings, TmcSettings, scpi};
use sunglint_drivers::transport::{Bytes, Transfer, Transfers, TransportError};
use sunglint_drivers::usbtmc::MessageIn;
use sunglint_drivers::zwo::report::{Info, Position, Request};
use sunglint_drivers::zwo::{Wheel, WheelSettings};
use sunglint_testkit::Campaign;

/// Tries every reader of an Ophir line; gives how many things the longest list held.
fn ophir(bytes: &[u8]) -> usize {
    let Ok(Line::Good(body)) = Line::parse(bytes) else { return 0 };
    assert!(body.len() < LONGEST_LINE && body.is_ascii());
    let mut longest = 0;
    if let Ok(Reading::Value(watts)) = Reading::parse(&body) {
        assert!(watts.is_finite());
    }
    if let Ok(instrument) = Instrument::parse(&body) {
        assert!(!instrument.serial.is_empty() && !instrument.name.is_empty());
        assert!(Head::parse(&body).is_err(), "nothing is both: {body}");
    }
    if let Ok(head) = Head::parse(&body) {
        assert!(head.is_there() || head.capabilities == 0);
    }
    if let Ok(choice) = Choice::parse(&body) {
        assert!(!choice.name().is_empty());
        longest = choice.names.len();
    }
    if let Ok(ranges) = Ranges::parse(&body) {
        assert!(!ranges.name().is_empty() && ranges.largest_w().unwrap() > 0.0);
        assert!(ranges.end_w().unwrap_or(1.0) > 0.0);
        if !ranges.is_dbm() {
            assert!(ranges.end_w().is_some(), "{body}");
        }
        longest = longest.max(ranges.names.len());
    }
    if let Ok(Wavelengths::Continuous { range_nm: [least, most], index, slots }) =
        Wavelengths::parse(&body)
    {
        let in_use = slots[index].unwrap();
        assert!(least <= in_use && in_use <= most);
        longest = longest.max(slots.len());
    }
    let _ = Zeroing::parse(&body);
    longest
}

/// Tries every reader of what a Thorlabs meter sends.
fn thorlabs(bytes: &[u8]) {
    let tag = bytes.get(1).copied().unwrap_or(1);
    if let Ok(message) = MessageIn::parse(bytes, tag) {
        assert!(
            message.payload.len() + 12 <= bytes.len() && message.payload.len() + 15 >= bytes.len()
        );
    }
    let text = String::from_utf8_lossy(bytes);
    if let Ok(scpi::Reading::Value(value)) = scpi::Reading::parse(&text) {
        assert!(value.abs() <= 1e30);
    }
    if let Ok(about) = scpi::Instrument::parse(&text) {
        assert!(!about.model.is_empty() && !about.serial.is_empty());
    }
    if let Ok(Some(sensor)) = scpi::Sensor::parse(&text) {
        assert!(!sensor.name.is_empty());
    }
    let _ = (scpi::Complaint::parse(&text), scpi::flag(&text));
}

/// Tries every reader of the wheel's reports.
fn wheel(bytes: &[u8]) {
    if let Ok(position) = Position::parse(bytes) {
        assert!(position.slots.iter().all(|slot| *slot <= position.count));
        assert!(position.arrived().is_none_or(|slot| (1..=position.count).contains(&slot)));
        assert_eq!(Position::parse(&position.emit()), Ok(position));
    }
    if let Ok(info) = Info::parse(bytes) {
        assert!(!info.name.is_empty() && info.name.len() <= 8);
    }
    if let Some(request) = Request::parse(bytes) {
        assert_eq!(request.emit()[..], *bytes);
    }
}

/// Answers as they should be; parts of them are put together and altered.
const SEEDS: [&[u8]; 22] = [
    b"*1.300E-5\r\n",
    b"*OVER\r\n",
    b"?COM ERROR\r\n",
    b"* SI 123456 PD300 80000001\r\n",
    b"*VEGA 222222 VEGA\r\n",
    b"* 3 AUTO 30.0mW 3.00mW 300uW 30.0uW 3.00uW 300nW 30.0nW\r\n",
    b"*-2 dBm AUTO 30.0mW 3.00mW\r\n",
    b"*CONTINUOUS 350 1100 2 633 532 1064 NONE NONE NONE\r\n",
    b"*DISCRETE 1 633 1064 <800\r\n",
    b"*1 OUT IN\r\n",
    b"*ZEROING COMPLETED\r\n",
    b"Thorlabs,PM100D,P0000001,2.6.0",
    b"S120C,180101101,24-Jan-2018,1,18,289",
    b"\"no sensor\",\"\",\"\",0,0,0",
    b"-222,\"Data out of range\"",
    b"9.90000000E+37",
    &[2, 7, 0xf8, 0, 3, 0, 0, 0, 1, 0, 0, 0, b'1', b'0', b'\n', 0],
    &[1, 0x7e, 0x5a, 1, 4, 0, 3, 2, 3, 7, 0, 0, 0, 0, 0x30, 0],
    &[1, 0x7e, 0x5a, 1, 6, 12, 7, 6, 7, 7, 0, 0, 0, 0, 0x30, 0],
    &[1, 0x7e, 0x5a, 4, 3, 0, 9, 0, 0x45, 0x46, 0x57, 0x2d, 0x53, 0x2d, 0x30, 0],
    &[3, 0x7e, 0x5a, 1, 2, 5, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
    b" ",
];

/// A million spoilt answers through every reader. Truth: what is promised of whatever is read. The lists stay as short as
/// the lines are.
#[test]
fn campaign_power_answers() {
    let mut campaign = Campaign::start("power_answers", 1_000_000);
    let mut longest = 0;
    for seed in campaign.seeds() {
        let mut random = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut bytes = SEEDS[random.random_range(0..SEEDS.len())].to_vec();
        for _ in 0..random.random_range(0..4) {
            let place = random.random_range(0..=bytes.len());
            match random.random_range(0..5) {
                0 => bytes.insert(place, random.random()),
                1 => bytes.truncate(place),
                2 if place < bytes.len() => bytes[place] ^= 1 << random.random_range(0..8),
                3 if place < bytes.len() => drop(bytes.remove(place)),
                _ => {
                    let other = SEEDS[random.random_range(0..SEEDS.len())];
                    let end = random.random_range(0..=other.len());
                    bytes.splice(place..place, other[..end].iter().copied());
                }
            }
        }
        longest = longest.max(ophir(&bytes));
        thorlabs(&bytes);
        wheel(&bytes);
    }
    assert!(longest < LONGEST_LINE / 2);
    campaign.largest("longest_list", longest as f64);
    campaign.finish();
}

proptest! {
    /// Any bytes and any text at all.
    #[test]
    fn anything_is_survived(bytes in proptest::collection::vec(any::<u8>(), 0..600), text in ".{0,80}") {
        ophir(&bytes);
        thorlabs(&bytes);
        wheel(&bytes);
        ophir(format!("*{text}\r\n").as_bytes());
        thorlabs(text.as_bytes());
    }
}

/// A device that only makes noise, a byte each millisecond, and counts what was taken.
struct Noise(rand_xoshiro::Xoshiro256PlusPlus, usize);

impl Bytes for Noise {
    fn send(&mut self, _: &[u8], _: &Deadline) -> Result<(), TransportError> {
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        deadline.sleep(Duration::from_micros(100))?;
        self.0.fill(buffer);
        self.1 += buffer.len();
        Ok(buffer.len())
    }

    fn discard(&mut self, _: &Deadline) -> Result<Vec<u8>, TransportError> {
        Ok(Vec::new())
    }
}

impl Transfers for Noise {
    fn transfer(&mut self, transfer: &Transfer, d: &Deadline) -> Result<Vec<u8>, TransportError> {
        d.sleep(Duration::from_millis(1))?;
        let mut answer = vec![0; transfer.room().unwrap_or(0)];
        self.0.fill(&mut answer[..]);
        self.1 += answer.len();
        Ok(answer)
    }
}

/// Truth: the clock and the count of bytes. Noise is told as such, in time and in bounded memory.
#[test]
fn noise_is_no_device() {
    for seed in 0..200 {
        let clock = Arc::new(VirtualClock::new());
        let within = || Deadline::after(clock.clone(), Duration::from_secs(5));
        let noise = || Noise(rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(seed), 0);
        let mut line = noise();
        let (link, settings) = (LinkSettings::default(), MeterSettings::default());
        assert!(Meter::open(&mut line, link, settings, &within()).is_err());
        // Two attempts of a second, ten bytes a millisecond.
        assert!(line.1 <= 20_000, "{}", line.1);
        let (tmc, settings) = (TmcSettings::default(), Pm100Settings::default());
        assert!(Pm100::open(noise(), tmc, settings, &within()).is_err());
        assert!(Wheel::open(noise(), WheelSettings::default(), &within()).is_err());
    }
}
