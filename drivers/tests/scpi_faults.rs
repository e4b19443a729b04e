//! SCPI instruments on lines that fail: a thousand seeds each on a virtual clock.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::scpi::{Shared, template};
use rand::{RngExt as _, SeedableRng as _};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{
    Device as _, DeviceError, Level, Meter as _, Power, PowerMeter as _, Source as _, Value,
};
use sunglint_drivers::recording::{Faults, Faulty, Injected};
use sunglint_drivers::scpi::{
    Cable, Definition, Link, ScpiMeter, ScpiPowerMeter, ScpiSource, Told,
};
use sunglint_drivers::simulated::scpi::{Adapter, Instrument, Kind, Model, ScpiSettings};
use sunglint_drivers::simulated::script::{Fault, Script};
use sunglint_drivers::simulated::{InMemory, pm100};
use sunglint_drivers::usbtmc::TmcSettings;

/// A line that loses time and is pulled out; each byte is a read of its own.
fn losing(seed: u64) -> Faults {
    Faults {
        delay: 0.002,
        longest_delay: Duration::from_millis(4500),
        disconnect: if seed.is_multiple_of(3) { 0.000_1 } else { 0.0 },
        ..Faults::NONE
    }
}

/// The same, which alters bytes.
fn spoiling(seed: u64) -> Faults {
    Faults { drop: 0.000_3, flip: 0.000_3, ..losing(seed) }
}

/// Faults of the instrument itself, at messages that the seed picks.
fn slips(seed: u64) -> Script<Kind> {
    let mut random = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut pick = |most: u32| random.random_range(0..most);
    let faults = (0..3).map(|_| {
        let on = [
            "READ?",
            "FETC?",
            "*IDN?",
            "SYST:ERR?",
            "CURR:RANG",
            "CURR:NPLC",
            ":SOUR1:VOLT",
            ":OUTP",
        ][pick(8) as usize];
        let nth = pick(5) + 1;
        let kind = match pick(4) {
            0 => Kind::Silence,
            1 => Kind::Late(Duration::from_millis(u64::from(pick(8000)))),
            2 => Kind::Half,
            _ => Kind::Say("-1.5E-3"),
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
        DeviceError::Complained { .. } => "complained",
        DeviceError::NotTaken { .. } => "not taken",
        other => panic!("no such error can come of a bad line: {other}"),
    }
}

/// Runs a step of a life and checks that it ended in time.
struct Life {
    clock: Arc<VirtualClock>,
    seed: u64,
}

impl Life {
    fn new(seed: u64) -> Self {
        Self { clock: Arc::new(VirtualClock::new()), seed }
    }

    fn within<T>(&self, seconds: u64, call: impl FnOnce(&Deadline) -> T) -> T {
        let start = self.clock.now();
        let limit = Duration::from_secs(seconds);
        let done = call(&Deadline::after(self.clock.clone(), limit));
        let took = self.clock.now() - start;
        assert!(took <= limit, "seed {}: {took:?} of {limit:?}", self.seed);
        done
    }
}

/// 5 µA that grow by 1 % a second, so that an old reading is a wrong one.
fn current(at: Duration) -> f64 {
    5e-6 * 1.01_f64.powf(at.as_secs_f64())
}

fn check(life: &Life, value: f64, before: Duration) {
    let (least, most) = (current(before) * 0.999_99, current(life.clock.now()) * 1.000_01);
    assert!((least..=most).contains(&value), "seed {}: {value} of {least} to {most}", life.seed);
}

fn settings(model: Model) -> ScpiSettings {
    ScpiSettings { model, noise: 0.0, ..ScpiSettings::default() }
}

type End = (Result<(), DeviceError>, Injected);

/// Goes through a life with a picoammeter: chooses a range, reads five times, is told the settings. Panics on a wrong number.
fn measure(life: &Life, meter: &mut ScpiMeter) -> Result<(), DeviceError> {
    let range = life.within(40, |d| meter.set_own("range", "20uA", d))?;
    assert_eq!(range, Value::Text("20uA".to_owned()));
    assert_eq!(life.within(40, |d| meter.set_own("nplc", "2", d))?, Value::Number(2.0));
    for _ in 0..5 {
        let before = life.clock.now();
        match life.within(60, |d| meter.read(d))? {
            Level::Value(value) => check(life, value, before),
            other => panic!("seed {}: {other:?}", life.seed),
        }
    }
    let settings = life.within(60, |d| meter.settings(d))?;
    let nplc = settings.iter().find(|setting| setting.name == "nplc").unwrap();
    assert_eq!(nplc.value, Value::Number(2.0), "seed {}", life.seed);
    assert_eq!(life.within(20, |d| meter.identity(d))?.model, "6485");
    Ok(())
}

fn picoammeter(seed: u64, faults: Faults, gpib: bool) -> End {
    let life = Life::new(seed);
    let mut device = Instrument::new(settings(Model::Picoammeter), current);
    device.faults = slips(seed);
    let about = template("keithley6485");
    let told = Told::default();
    if gpib {
        let line = Shared::new(Faulty::new(InMemory::new(Adapter::new(8, device)), faults, seed));
        let link = Link::gpib(line.clone(), 8, Cable::Unchecked, &about);
        let opened = life.within(60, |d| ScpiMeter::open(link, about, &told, d));
        let end = opened.and_then(|mut meter| measure(&life, &mut meter));
        return (end, line.with(|line| line.injected()));
    }
    let line = Shared::new(Faulty::new(InMemory::new(device), faults, seed));
    let link = Link::stream(line.clone(), Cable::Unchecked, &about);
    let opened = life.within(60, |d| ScpiMeter::open(link, about, &told, d));
    let end = opened.and_then(|mut meter| measure(&life, &mut meter));
    (end, line.with(|line| line.injected()))
}

fn supply(seed: u64, faults: Faults) -> End {
    let life = Life::new(seed);
    let mut device = Instrument::new(settings(Model::Supply), |_| 0.0);
    device.faults = slips(seed);
    let line = Shared::new(Faulty::new(InMemory::new(device), faults, seed));
    let about = template("rigol_dp832");
    let link = Link::stream(line.clone(), Cable::Unchecked, &about);
    let truth = || line.with(|line| (line.inner().device.volts(), line.inner().device.is_on()));
    let go = || -> Result<(), DeviceError> {
        let mut source = life.within(60, |d| ScpiSource::open(link, about, &Told::default(), d))?;
        for (level, on) in [(5.0, true), (12.5, true), (0.25, false)] {
            assert_eq!(life.within(60, |d| source.set_level(level, d))?, level, "seed {seed}");
            assert_eq!(truth().0, level, "seed {seed}");
            assert_eq!(life.within(60, |d| source.switch(on, d))?, on, "seed {seed}");
            assert_eq!(truth().1, on, "seed {seed}");
            assert_eq!(life.within(60, |d| source.level(d))?, truth().0, "seed {seed}");
            assert_eq!(life.within(60, |d| source.is_on(d))?, truth().1, "seed {seed}");
        }
        Ok(())
    };
    let end = go();
    (end, line.with(|line| line.injected()))
}

const PM100: &str = "\
kind = \"power_meter\"
name = \"PM100 by its file\"
[read]
send = \"MEAS:POW?\"
unit = \"W\"
fresh = \"trigger\"
[settings.wavelength_nm]
send = \"SENS:CORR:WAV {value}\"
ask = \"SENS:CORR:WAV?\"
";

/// USB carries checksums: what is lost or late is noticed, nothing is altered.
fn on_usb(seed: u64) -> End {
    let life = Life::new(seed);
    let faults = Faults {
        delay: 0.05,
        longest_delay: Duration::from_millis(4500),
        short_read: 0.01,
        silence: 0.005,
        disconnect: if seed.is_multiple_of(3) { 0.001 } else { 0.0 },
        ..Faults::NONE
    };
    let usb = Faulty::new(pm100::Pm100::new(Default::default(), current), faults, seed);
    let about = Definition::parse("pm100.toml", PM100).unwrap();
    let link = Link::usbtmc(usb, TmcSettings::default(), &about);
    let go = || -> Result<(), DeviceError> {
        let told = Told::default();
        let mut meter = life.within(60, |d| ScpiPowerMeter::open(link, about, &told, d))?;
        assert_eq!(life.within(60, |d| meter.set_wavelength_nm(532.0, d))?, 532.0);
        for _ in 0..5 {
            let before = life.clock.now();
            let power = life.within(60, |d| meter.power(d))?;
            let Power::Watts(watts) = power else { panic!("seed {seed}: {power:?}") };
            let (least, most) = (current(before) * 0.9994, current(life.clock.now()) * 1.0006);
            assert!((least..=most).contains(&watts), "seed {seed}: {watts} of {least} to {most}");
        }
        Ok(())
    };
    (go(), Injected::default())
}

fn thousand(run: impl Fn(u64) -> End) -> (BTreeMap<&'static str, u32>, Injected) {
    let (mut ends, mut sum) = (BTreeMap::new(), Injected::default());
    for seed in 0..1000 {
        let (end, injected) = run(seed);
        *ends.entry(end.as_ref().map_or_else(name, |()| "right")).or_default() += 1;
        sum.delays += injected.delays;
        sum.drops += injected.drops;
        sum.flips += injected.flips;
    }
    eprintln!("{ends:?} {sum:?}");
    (ends, sum)
}

/// Truth: the current that was put in, at its own time, and the clock. Delays beyond the host's patience, answers of the instrument that are missing, late, torn or foreign,
/// cables pulled out: every life ends right or with a named error, in time, and most end right.
#[test]
fn scpi_readings_on_a_losing_line_are_right_or_errors() {
    let (ends, sum) = thousand(|seed| picoammeter(seed, losing(seed), false));
    assert!(sum.delays > 1000, "{sum:?}");
    assert!((600..1000).contains(&ends["right"]), "{ends:?}");
}

/// The same with bytes altered on a serial line without checksum: each reading is said twice, each setting read back twice.
#[test]
fn scpi_readings_on_a_spoiling_line_are_right_or_errors() {
    let (ends, sum) = thousand(|seed| picoammeter(seed, spoiling(seed), false));
    assert!(sum.flips > 150 && sum.drops > 150, "{sum:?}");
    assert!((500..1000).contains(&ends["right"]), "{ends:?}");
}

/// The same behind a GPIB adapter, whose own lines are spoilt, too.
#[test]
fn scpi_readings_behind_a_spoilt_adapter_are_right_or_errors() {
    let (ends, sum) = thousand(|seed| picoammeter(seed, spoiling(seed), true));
    assert!(sum.flips > 150, "{sum:?}");
    assert!((400..1000).contains(&ends["right"]), "{ends:?}");
}

/// Truth: the supply's own level and switch after each call that ends well.
#[test]
fn scpi_sources_on_a_spoiling_line_have_what_they_say_or_errors() {
    let (ends, sum) = thousand(|seed| supply(seed, spoiling(seed)));
    assert!(sum.flips > 150, "{sum:?}");
    assert!((500..1000).contains(&ends["right"]), "{ends:?}");
}

/// Truth: as for the losing line, over USBTMC.
#[test]
fn scpi_readings_on_a_losing_usb_are_right_or_errors() {
    let (ends, _) = thousand(on_usb);
    assert!((600..1000).contains(&ends["right"]), "{ends:?}");
}
