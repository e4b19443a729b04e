//! Power meters and the wheel on lines that fail: a thousand seeds each on a virtual clock.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use rand::{RngExt as _, SeedableRng as _};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{Confirmed, DeviceError, FilterWheel as _, Power, PowerMeter};
use sunglint_drivers::ophir::{LinkSettings, Meter, MeterSettings};
use sunglint_drivers::recording::{Faults, Faulty, Injected};
use sunglint_drivers::simulated::InMemory;
use sunglint_drivers::simulated::efw::{Efw, EfwSettings};
use sunglint_drivers::simulated::ophir::{Kind, Ophir, OphirSettings};
use sunglint_drivers::simulated::pm100::{self, Pm100Settings as SimulatedSettings};
use sunglint_drivers::simulated::script::{Fault, Script};
use sunglint_drivers::thorlabs::{Pm100, Pm100Settings, TmcSettings};
use sunglint_drivers::zwo::{Wheel, WheelSettings};

/// A cable that loses time and whole answers, and is pulled out, but alters nothing.
fn losing(seed: u64) -> Faults {
    Faults {
        delay: 0.05,
        longest_delay: Duration::from_millis(1500),
        drop: 0.0,
        flip: 0.0,
        short_read: 0.01,
        silence: 0.005,
        disconnect: if seed.is_multiple_of(3) { 0.001 } else { 0.0 },
    }
}

/// The same for a serial line, where each byte is a read of its own, so that a lost one alters what is read: what is lost
/// whole is left to the device.
fn losing_serial(seed: u64) -> Faults {
    let disconnect = losing(seed).disconnect / 10.0;
    Faults { delay: 0.002, short_read: 0.0, silence: 0.0, disconnect, ..losing(seed) }
}

/// A cable that alters bytes as well.
fn spoiling(faults: Faults) -> Faults {
    Faults { drop: 0.000_3, flip: 0.000_3, ..faults }
}

/// Makes the faults of the simulated meter itself: answers that are missing, late or cut off, at commands that the seed picks.
fn slips(seed: u64) -> Script<Kind> {
    let mut random = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut pick = |most: u32| random.random_range(0..most);
    let faults = (0..3).map(|_| {
        let on = ["$SP", "$SI", "$AW", "$AR", "$II", "$WI", "$FQ"][pick(7) as usize];
        let nth = pick(5) + 1;
        let kind = match pick(3) {
            0 => Kind::Silence,
            1 => Kind::Late(Duration::from_millis(u64::from(pick(2500)))),
            _ => Kind::Half,
        };
        Fault::new(on, nth, kind)
    });
    Script::new(faults.collect())
}

fn name(error: &DeviceError) -> &'static str {
    match error {
        DeviceError::Transport { .. } => "transport",
        DeviceError::TooSlow { .. } => "too slow",
        DeviceError::Protocol { .. } => "protocol",
        DeviceError::Refused { .. } => "refused",
        DeviceError::Rejected { .. } => "rejected",
        DeviceError::NotTaken { .. } => "not taken",
        DeviceError::NotReady { .. } => "not ready",
        DeviceError::Unknown { .. } => "unknown",
        DeviceError::OutOfRange { .. } => "out of range",
        other => panic!("no such error can come of a bad line: {other}"),
    }
}

/// Runs a step of a life and checks that it ended in time.
struct Life {
    clock: Arc<VirtualClock>,
    seed: u64,
    /// How much later than its deadline a call may end.
    grace: Duration,
}

impl Life {
    fn new(seed: u64, grace: Duration) -> Self {
        Self { clock: Arc::new(VirtualClock::new()), seed, grace }
    }

    fn within<T>(&self, seconds: u64, call: impl FnOnce(&Deadline) -> T) -> T {
        let start = self.clock.now();
        let limit = Duration::from_secs(seconds);
        let done = call(&Deadline::after(self.clock.clone(), limit));
        let took = self.clock.now() - start;
        assert!(took <= limit + self.grace, "seed {}: {took:?} of {limit:?}", self.seed);
        done
    }
}

/// 5 µW that grow by 1 % a second, so that an old reading is a wrong one; or that stand still.
fn light(grows: bool) -> impl Fn(Duration) -> f64 + Clone + Send + 'static {
    move |at| 5e-6 * if grows { 1.01_f64.powf(at.as_secs_f64()) } else { 1.0 }
}

/// Goes through a life with a meter: sets a wavelength and a range, reads five times. Panics on a wrong number.
fn measure(life: &Life, meter: &mut dyn PowerMeter, grows: bool) -> Result<(), DeviceError> {
    let seed = life.seed;
    assert_eq!(life.within(20, |d| meter.set_wavelength_nm(532.0, d))?, 532.0, "seed {seed}");
    life.within(20, |d| meter.set_range("AUTO", d))?;
    for _ in 0..5 {
        let before = life.clock.now();
        let reading = life.within(20, |d| meter.power(d))?;
        let Power::Watts(watts) = reading else { panic!("seed {seed}: {reading:?}") };
        let least = light(grows)(before) * 0.9994;
        let most = light(grows)(life.clock.now()) * 1.0006;
        assert!((least..=most).contains(&watts), "seed {seed}: {watts} of {least} to {most}");
    }
    life.within(20, |d| meter.settings(d))?;
    Ok(())
}

fn ophir(seed: u64, faults: Faults, confirmed: bool) -> (Result<(), DeviceError>, Injected) {
    let life = Life::new(seed, MeterSettings::default().abort_within);
    let mut device = Ophir::new(OphirSettings::default(), light(!confirmed));
    device.faults = slips(seed);
    let line = Faulty::new(InMemory::new(device), faults, seed);
    let (link, settings) = (LinkSettings::default(), MeterSettings::default());
    let mut meter = match life.within(20, |d| Meter::open(line, link, settings, d)) {
        Ok(meter) => meter,
        Err(error) => return (Err(error), Injected::default()),
    };
    if !confirmed {
        let end = measure(&life, &mut meter, true);
        return (end, meter.into_line().injected());
    }
    let mut meter = Confirmed::new(meter, 1e-4, 0.0, 8);
    let end = measure(&life, &mut meter, false);
    (end, meter.into_meter().into_line().injected())
}

fn thorlabs(seed: u64, faults: Faults, confirmed: bool) -> (Result<(), DeviceError>, Injected) {
    let life = Life::new(seed, Pm100Settings::default().abort_within);
    let usb = pm100::Pm100::new(SimulatedSettings::default(), light(!confirmed));
    let usb = Faulty::new(usb, faults, seed);
    let (tmc, settings) = (TmcSettings::default(), Pm100Settings::default());
    let mut meter = match life.within(20, |d| Pm100::open(usb, tmc, settings, d)) {
        Ok(meter) => meter,
        Err(error) => return (Err(error), Injected::default()),
    };
    if !confirmed {
        let end = measure(&life, &mut meter, true);
        return (end, meter.into_usb().injected());
    }
    let mut meter = Confirmed::new(meter, 1e-4, 0.0, 8);
    let end = measure(&life, &mut meter, false);
    (end, meter.into_meter().into_usb().injected())
}

fn wheel(seed: u64, faults: Faults) -> (Result<(), DeviceError>, Injected) {
    let settings = WheelSettings::default();
    let life = Life::new(seed, settings.grace);
    let hid = Faulty::new(Efw::new(EfwSettings::default()), faults, seed);
    let mut wheel = match life.within(20, |d| Wheel::open(hid, settings, d)) {
        Ok(wheel) => wheel,
        Err(error) => return (Err(error), Injected::default()),
    };
    assert_eq!(wheel.slots(), 7, "seed {seed}");
    let mut end = Ok(());
    for slot in [3, 1, 7] {
        match life.within(60, |d| wheel.select(slot, d)) {
            Ok(got) => {
                assert_eq!(got, slot, "seed {seed}");
                let truth = wheel.hid().inner().clone().slot(life.clock.now());
                assert_eq!(truth.map(u32::from), Some(slot), "seed {seed}");
            }
            Err(interrupted) => {
                end = Err(*interrupted.error);
                break;
            }
        }
    }
    (end, wheel.into_hid().injected())
}

type Ends = BTreeMap<&'static str, u32>;

fn thousand(run: impl Fn(u64) -> (Result<(), DeviceError>, Injected)) -> (Ends, Injected) {
    let (mut ends, mut sum) = (Ends::new(), Injected::default());
    for seed in 0..1000 {
        let (end, injected) = run(seed);
        *ends.entry(end.as_ref().map_or_else(name, |()| "right")).or_default() += 1;
        sum.delays += injected.delays;
        sum.drops += injected.drops;
        sum.flips += injected.flips;
        sum.short_reads += injected.short_reads;
        sum.silences += injected.silences;
    }
    eprintln!("{ends:?} {sum:?}");
    (ends, sum)
}

/// Truth: the light that was put in (readings are of their own time to 6e-4, four digits) and the clock. Delays up to 1.5
/// times the host's patience, answers missing, late or cut off, cables pulled out: every life ends right or with a named
/// error, in time, and most end right.
#[test]
fn ophir_readings_on_a_losing_line_are_right_or_errors() {
    let (ends, sum) = thousand(|seed| ophir(seed, losing_serial(seed), false));
    assert!(sum.delays > 1000, "{sum:?}");
    assert!((600..1000).contains(&ends["right"]), "{ends:?}");
}

/// The same with bytes altered, where two readings in a row have to agree: an Ophir line has no checksum.
#[test]
fn ophir_confirmed_readings_on_a_spoiling_line_are_right_or_errors() {
    let (ends, sum) = thousand(|seed| ophir(seed, spoiling(losing_serial(seed)), true));
    assert!(sum.flips > 150 && sum.drops > 150, "{sum:?}");
    assert!((300..1000).contains(&ends["right"]), "{ends:?}");
}

/// Checks the same as for Ophir; parts of messages are cut off, too, which the length in their header shows.
#[test]
fn thorlabs_readings_on_a_losing_line_are_right_or_errors() {
    let (ends, sum) = thousand(|seed| thorlabs(seed, losing(seed), false));
    assert!(sum.delays > 5000 && sum.silences > 200 && sum.short_reads > 200, "{sum:?}");
    assert!((600..1000).contains(&ends["right"]), "{ends:?}");
}

/// The same with bytes altered in the meter's answers. USB's own checksums leave that to firmware.
#[test]
fn thorlabs_confirmed_readings_on_a_spoiling_line_are_right_or_errors() {
    let (ends, sum) = thousand(|seed| thorlabs(seed, spoiling(losing(seed)), true));
    assert!(sum.flips > 150 && sum.drops > 150, "{sum:?}");
    assert!((300..1000).contains(&ends["right"]), "{ends:?}");
}

/// Truth: the wheel's own slot is the one that is told; 7 slots, whatever bytes are altered.
#[test]
fn the_wheel_on_a_spoiling_line_is_right_or_an_error() {
    let (ends, sum) = thousand(|seed| wheel(seed, spoiling(losing(seed))));
    assert!(sum.flips > 100 && sum.drops > 100 && sum.short_reads > 100, "{sum:?}");
    assert!((300..1000).contains(&ends["right"]), "{ends:?}");
}
