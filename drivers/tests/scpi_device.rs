//! Meters, sources and power meters that a file describes, on simulated instruments and a virtual clock.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::scpi::{Shared, template};
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::catalogue::{Address, AnyDevice};
use sunglint_drivers::clock::{Cancel, Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{
    Device as _, DeviceError, Level, Meter as _, Power, PowerMeter as _, Source as _, Value,
};
use sunglint_drivers::scpi::{
    Cable, Definition, Link, ScpiMeter, ScpiPowerMeter, ScpiSource, Told,
};
use sunglint_drivers::simulated::scpi::{Adapter, Instrument, Kind, Model, ScpiSettings};
use sunglint_drivers::simulated::script::{Fault, Script};
use sunglint_drivers::simulated::{InMemory, Steady, pm100};
use sunglint_drivers::usbtmc::TmcSettings;

type Line = Shared<InMemory<Instrument>>;

struct Desk {
    clock: Arc<VirtualClock>,
}

impl Desk {
    fn new() -> Self {
        Self { clock: Arc::new(VirtualClock::new()) }
    }

    fn within(&self, seconds: u64) -> Deadline {
        Deadline::after(self.clock.clone(), Duration::from_secs(seconds))
    }
}

fn line(settings: ScpiSettings, signal: impl Fn(Duration) -> f64 + Send + 'static) -> Line {
    Shared::new(InMemory::new(Instrument::new(settings, signal)))
}

fn quiet(model: Model) -> ScpiSettings {
    ScpiSettings { model, noise: 0.0, ..ScpiSettings::default() }
}

fn meter(desk: &Desk, line: &Line, about: &Definition) -> Result<ScpiMeter, DeviceError> {
    let link = Link::stream(line.clone(), Cable::Unchecked, about);
    ScpiMeter::open(link, about.clone(), &Told::default(), &desk.within(10))
}

/// Truth: the current that was put in, 1.2 nA, the ranges of a 6485, and the instrument's own state. Its zero check, on after power-on, is taken off.
#[test]
fn a_picoammeter_is_read_and_set() {
    let desk = Desk::new();
    let line = line(quiet(Model::Picoammeter), |_| 1.2e-9);
    let mut meter = meter(&desk, &line, &template("keithley6485")).unwrap();
    let identity = meter.identity(&desk.within(5)).unwrap();
    assert_eq!((identity.model.as_str(), identity.driver), ("6485", "scpi-meter"));
    assert_eq!(identity.serial.as_deref(), Some("1234567"));
    assert_eq!(meter.unit(), "A");
    assert_eq!(meter.read(&desk.within(5)).unwrap(), Level::Value(1.2e-9));
    let set = |meter: &mut ScpiMeter, name: &str, value: &str| {
        meter.set_own(name, value, &desk.within(5))
    };
    let text = |text: &str| Value::Text(text.to_owned());
    assert_eq!(set(&mut meter, "range", "2nA").unwrap(), text("2nA"));
    assert_eq!(line.with(|line| line.device.range()), Some(2.1e-9));
    assert_eq!(set(&mut meter, "range", "auto").unwrap(), text("auto"));
    assert_eq!(line.with(|line| line.device.range()), None);
    assert_eq!(set(&mut meter, "nplc", "5").unwrap(), Value::Number(5.0));
    let refused = set(&mut meter, "nplc", "60").unwrap_err().to_string();
    assert_eq!(refused, "nplc: found 60, expected 0.01 to 50");
    let refused = set(&mut meter, "range", "3nA").unwrap_err().to_string();
    assert!(refused.contains("expected one of auto, 2nA, 20nA, 200nA, 2uA"), "{refused}");
    let refused = set(&mut meter, "rnage", "2nA").unwrap_err().to_string();
    assert!(refused.contains("nplc, range"), "{refused}");
    let settings = meter.settings(&desk.within(5)).unwrap();
    let of =
        |name: &str| settings.iter().find(|setting| setting.name == name).unwrap().value.clone();
    assert_eq!(
        (of("range"), of("nplc"), of("unit")),
        (text("auto"), Value::Number(5.0), text("A"))
    );
    assert_eq!(line.with(|line| line.device.overlaps()), 0, "one question at a time");
    assert_eq!(line.with(|line| line.device.waiting()), 0);
}

/// Truth: SCPI-99's signs: 5 nA in a range of 2.1 nA are too much; 9.91E37 is no number.
#[test]
fn too_much_and_no_number_are_told() {
    let desk = Desk::new();
    let line = line(quiet(Model::Picoammeter), |_| -5e-9);
    let mut meter = meter(&desk, &line, &template("keithley6485")).unwrap();
    meter.set_own("range", "2nA", &desk.within(5)).unwrap();
    assert_eq!(meter.read(&desk.within(5)).unwrap(), Level::Over);
    let say = Fault::new("READ?", 2, Kind::Say("9.91E37A,1,0"));
    line.with(|line| line.device.faults = Script::new(vec![Fault { nth: 1, ..say }]));
    let error = meter.read(&desk.within(5)).unwrap_err().to_string();
    assert_eq!(
        error,
        "Keithley 6485: the answer to READ?: 9.91E37, which is SCPI's sign for no number"
    );
}

/// Truth: the level and the switch that the supply itself has; SCPI's number for a value out of range.
#[test]
fn a_supply_is_set_and_switched() {
    let desk = Desk::new();
    let line = line(quiet(Model::Supply), |_| 0.0);
    let about = template("rigol_dp832");
    let link = Link::stream(line.clone(), Cable::Checked, &about);
    let mut source = ScpiSource::open(link, about, &Told::default(), &desk.within(10)).unwrap();
    assert_eq!(source.range().unwrap().to_array(), [0.0, 32.0]);
    // 10 mV steps, half of which is let pass.
    assert_eq!(source.set_level(4.996, &desk.within(5)).unwrap(), 5.0);
    assert!(!source.is_on(&desk.within(5)).unwrap());
    assert!(source.switch(true, &desk.within(5)).unwrap());
    assert_eq!(line.with(|line| (line.device.volts(), line.device.is_on())), (5.0, true));
    assert!(!source.switch(false, &desk.within(5)).unwrap());
    assert_eq!(source.level(&desk.within(5)).unwrap(), 5.0);
    for beyond in [-0.1, 32.1, f64::NAN] {
        let error = source.set_level(beyond, &desk.within(5)).unwrap_err();
        assert!(matches!(error, DeviceError::OutOfRange { .. }), "{error}");
    }
    let text =
        sunglint_drivers::scpi::TEMPLATES.iter().find(|t| t.name == "rigol_dp832").unwrap().text;
    let about = Definition::parse("wide.toml", &text.replace("most = 32", "most = 40")).unwrap();
    let link = Link::stream(line.clone(), Cable::Checked, &about);
    let mut source = ScpiSource::open(link, about, &Told::default(), &desk.within(10)).unwrap();
    match source.set_level(35.0, &desk.within(5)).unwrap_err() {
        DeviceError::Complained { code: -222, said, request, .. } => {
            assert_eq!(
                (said.as_str(), request.as_str()),
                ("Data out of range", ":SOUR1:VOLT 3.5E1")
            );
        }
        other => panic!("{other}"),
    }
    assert_eq!(source.level(&desk.within(5)).unwrap(), 5.0);
}

const VOLTMETER: &str = "\
kind = \"KIND\"
name = \"photodiode\"
[open]
send = [\"INIT:CONT OFF\"]
[read]
send = \"READ?\"
again = \"FETC?\"
unit = \"V\"
fresh = \"trigger\"
[gain]
v_per_a = { low = 1e3, high = 1e6 }
";

/// Truth: arithmetic: 0.25 V through 1e6 V/A are 0.25 µA; 0.3 A/W between 0.2 at 400 nm and 0.4 at 600 nm make 0.25/0.3 µW of it at 500 nm.
#[test]
fn an_amplifier_and_a_responsivity_make_amperes_and_watts() {
    let desk = Desk::new();
    let line = line(quiet(Model::Multimeter), |_| 0.25);
    let about = Definition::parse(
        "d.toml",
        &format!("unit = \"A\"\n{}", VOLTMETER.replace("KIND", "meter")),
    )
    .unwrap();
    let mut amperes = meter(&desk, &line, &about).unwrap();
    let untold = amperes.read(&desk.within(5)).unwrap_err().to_string();
    assert_eq!(untold, "gain: found none (tell it: --with gain=NAME), expected one of low, high");
    assert!(amperes.set_own("gain", "medium", &desk.within(5)).is_err());
    amperes.set_own("gain", "high", &desk.within(5)).unwrap();
    assert_eq!(amperes.read(&desk.within(5)).unwrap(), Level::Value(0.25 * (1.0 / 1e6)));
    let text = VOLTMETER.replace("KIND", "power_meter")
        + "[response]\na_per_w = [[400, 0.2], [600, 0.4]]\n";
    let about = Definition::parse("d.toml", &text).unwrap();
    let told = Told { gain: Some("high".to_owned()), wavelength_nm: None };
    let link = Link::stream(line.clone(), Cable::Unchecked, &about);
    let mut watts = ScpiPowerMeter::open(link, about, &told, &desk.within(10)).unwrap();
    let untold = watts.power(&desk.within(5)).unwrap_err().to_string();
    assert!(untold.contains("--with wavelength_nm=NM"), "{untold}");
    assert_eq!(watts.set_wavelength_nm(500.0, &desk.within(5)).unwrap(), 500.0);
    let Power::Watts(found) = watts.power(&desk.within(5)).unwrap() else { panic!() };
    assert!((found / (0.25e-6 / 0.3) - 1.0).abs() < 1e-12, "{found}");
    let beyond = watts.set_wavelength_nm(601.0, &desk.within(5)).unwrap_err().to_string();
    assert_eq!(beyond, "wavelength_nm: found 601, expected 400 to 600");
    assert!(watts.zero(&desk.within(5)).unwrap_err().to_string().contains("no [zero]"));
    assert!(watts.ranges(&desk.within(5)).unwrap().is_empty());
}

/// Truth: a signal that says its own time: a reading was measured after the call began, whether the device is triggered or shows what it measured by itself.
#[test]
fn readings_are_measured_after_the_call_began() {
    let poll = "\
kind = \"meter\"
name = \"free-running\"
unit = \"V\"
[open]
send = [\"INIT:CONT ON\"]
[read]
send = \"FETC?\"
fresh = \"poll\"
period_ms = 400
";
    let desk = Desk::new();
    for cable in [Cable::Checked, Cable::Unchecked] {
        for (about, measurement) in
            [(Definition::parse("poll.toml", poll).unwrap(), 400), (template("keithley2000"), 700)]
        {
            let settings = ScpiSettings {
                measurement: Duration::from_millis(measurement),
                ..quiet(Model::Multimeter)
            };
            let line = line(settings, |at| at.as_secs_f64());
            let link = Link::stream(line.clone(), cable, &about);
            let mut meter =
                ScpiMeter::open(link, about, &Told::default(), &desk.within(10)).unwrap();
            for pause in [0, 1, 50, 333, 2000] {
                desk.within(10).sleep(Duration::from_millis(pause)).unwrap();
                let begun = desk.clock.now();
                let Level::Value(measured) = meter.read(&desk.within(10)).unwrap() else {
                    panic!()
                };
                // The signal is that of the middle of the measurement; eight digits.
                let start = measured - f64::from(measurement as u32) / 2000.0;
                assert!(start >= begun.as_secs_f64() - 1e-4, "{cable:?}: {start} {begun:?}");
                let waited = (desk.clock.now() - begun).as_secs_f64();
                assert!(waited < 3.0, "{waited}");
            }
        }
    }
    // `FETC?` alone repeats: what the waiting is for.
    let line = line(quiet(Model::Multimeter), |at| at.as_secs_f64());
    let text = poll
        .replace("INIT:CONT ON", "INIT:CONT OFF")
        .replace("\"FETC?\"", "\"READ?\"")
        .replace("\"poll\"", "\"trigger\"")
        .replace("period_ms = 400\n", "");
    let about = Definition::parse("trigger.toml", &text).unwrap();
    let refused = meter(&desk, &line, &about).unwrap_err().to_string();
    assert!(refused.contains("`again`"), "{refused}");
}

/// Truth: the answer's own reading, whatever came before it: late, half, missing and foreign answers of the instrument.
#[test]
fn answers_that_are_late_torn_or_missing_are_asked_for_again() {
    let late = Kind::Late(Duration::from_millis(5300));
    for kind in [Kind::Silence, late, Kind::Half, Kind::Say("1.5E-9V,1,0"), Kind::Say("ready")] {
        let desk = Desk::new();
        let line = line(quiet(Model::Picoammeter), |at| 1e-9 * (1.0 + at.as_secs_f64()));
        let mut meter = meter(&desk, &line, &template("keithley6485")).unwrap();
        line.with(|line| {
            line.device.faults = Script::new(vec![Fault::new("READ?", 2, kind.clone())])
        });
        for i in 0..3 {
            let begun = 1e-9 * (1.0 + desk.clock.now().as_secs_f64());
            let Level::Value(found) = meter.read(&desk.within(20)).unwrap() else { panic!() };
            let now = 1e-9 * (1.0 + desk.clock.now().as_secs_f64());
            assert!(
                (begun * 0.999_999..=now * 1.000_001).contains(&found),
                "{kind:?} {i}: {begun} {found} {now}"
            );
        }
    }
    // Twice is an error that says what came.
    let desk = Desk::new();
    let line = line(quiet(Model::Picoammeter), |_| 1e-9);
    let mut meter = meter(&desk, &line, &template("keithley6485")).unwrap();
    line.with(|line| {
        line.device.faults = Script::new(vec![Fault::new("READ?", 0, Kind::Say("hello"))])
    });
    let error = meter.read(&desk.within(20)).unwrap_err().to_string();
    assert_eq!(
        error,
        "Keithley 6485: the answer to READ?: found `hello`, expected `{value}A,{number},{number}`"
    );
    line.with(|line| line.device.faults = Script::new(vec![Fault::new("READ?", 0, Kind::Silence)]));
    let begun = desk.clock.now();
    let error = meter.read(&desk.within(3)).unwrap_err().to_string();
    assert!(error.contains("no answer within"), "{error}");
    assert!(desk.clock.now() - begun <= Duration::from_secs(3));
    let cancel = Cancel::new();
    cancel.cancel();
    let error = meter.read(&desk.within(3).with_cancel(&cancel)).unwrap_err();
    assert!(matches!(error, DeviceError::Cancelled { .. }), "{error}");
}

/// Truth: errors that others left are not blamed on our settings, and one of ours that is refused says its number, also where the answer to SYST:ERR? was lost.
#[test]
fn the_error_queue_is_drained() {
    let desk = Desk::new();
    let settings = ScpiSettings { complaints: vec![-113, -222], ..quiet(Model::Picoammeter) };
    let line = line(settings, |_| 1e-9);
    let text =
        sunglint_drivers::scpi::TEMPLATES.iter().find(|t| t.name == "keithley6485").unwrap().text;
    let text = format!(
        "{text}\n[settings.filter]\nsend = \"FILT {{value}}\"\nnames = {{ on = \"1\", off = \"0\" }}\n"
    );
    let about = Definition::parse("filter.toml", &text).unwrap();
    let mut meter = meter(&desk, &line, &about).unwrap();
    assert_eq!(line.with(|line| line.device.waiting()), 0);
    meter.set_own("nplc", "2", &desk.within(5)).unwrap();
    for nth in [0, 1] {
        // An unknown command that nobody reads back; the second time its complaint is lost once.
        let lost = Fault::new("SYST:ERR?", nth, Kind::Silence);
        line.with(|line| {
            line.device.faults = if nth == 0 { Script::default() } else { Script::new(vec![lost]) }
        });
        match meter.set_own("filter", "on", &desk.within(30)).unwrap_err() {
            DeviceError::Complained { code, said, .. } => {
                assert_eq!((code, said.as_str()), (-113, "Undefined header"))
            }
            other => panic!("{other}"),
        }
    }
    assert_eq!(line.with(|line| line.device.waiting()), 0);
}

/// Truth: another instrument than the file's; a file of another kind.
#[test]
fn another_device_is_refused() {
    let desk = Desk::new();
    let line = line(quiet(Model::Supply), |_| 0.0);
    let error = meter(&desk, &line, &template("keithley6485")).unwrap_err().to_string();
    assert!(
        error.contains(
            "found `RIGOL TECHNOLOGIES,DP832,DP8A123456789,00.01.14`, expected `KEITHLEY"
        ),
        "{error}"
    );
    let error = meter(&desk, &line, &template("rigol_dp832")).unwrap_err().to_string();
    assert!(error.contains("scpi-source"), "{error}");
}

/// The same instrument behind a GPIB adapter. Truth: the current that was put in; an adapter that is set to another address has no device there.
#[test]
fn an_instrument_behind_a_gpib_adapter_is_read() {
    let desk = Desk::new();
    let settings =
        ScpiSettings { measurement: Duration::from_millis(2500), ..quiet(Model::Picoammeter) };
    let line = Shared::new(InMemory::new(Adapter::new(8, Instrument::new(settings, |_| 3.5e-6))));
    let about = template("keithley6485");
    let link = Link::gpib(line.clone(), 8, Cable::Unchecked, &about);
    let mut meter =
        ScpiMeter::open(link, about.clone(), &Told::default(), &desk.within(10)).unwrap();
    // A reading takes longer than the adapter waits for.
    assert_eq!(meter.read(&desk.within(10)).unwrap(), Level::Value(3.5e-6));
    line.with(|line| {
        line.device.device.faults = Script::new(vec![Fault::new("READ?", 2, Kind::Half)])
    });
    assert_eq!(meter.read(&desk.within(30)).unwrap(), Level::Value(3.5e-6));
    assert_eq!(meter.read(&desk.within(30)).unwrap(), Level::Value(3.5e-6));
    assert_eq!(line.with(|line| line.device.device.overlaps()), 0);
    let link = Link::gpib(line, 9, Cable::Unchecked, &about);
    let error =
        ScpiMeter::open(link, about.clone(), &Told::default(), &desk.within(20)).unwrap_err();
    assert!(error.to_string().contains("no answer within"), "{error}");
    // No adapter at all.
    let bare = Shared::new(InMemory::new(Instrument::new(quiet(Model::Picoammeter), |_| 1e-9)));
    let link = Link::gpib(bare, 8, Cable::Unchecked, &about);
    assert!(ScpiMeter::open(link, about, &Told::default(), &desk.within(20)).is_err());
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
least = 400
most = 1100
[settings.range]
send = \"SENS:POW:RANG {value}\"
ask = \"SENS:POW:RANG?\"
names = { \"5mW\" = \"5e-3\", \"50mW\" = \"5e-2\" }
auto = { send = \"SENS:POW:RANG:AUTO 1\", ask = \"SENS:POW:RANG:AUTO?\", on = \"1\" }
[zero]
send = [\"SENS:CORR:COLL:ZERO:INIT\"]
settle_ms = 1500
";

/// USBTMC: the simulated Thorlabs meter, whose messages python-usbtmc knows, by a file. Truth: the light that was put in, and the meter's own wavelength.
#[test]
fn an_instrument_on_usb_is_read() {
    let desk = Desk::new();
    let mut usb = pm100::Pm100::new(Default::default(), Steady(1.3e-3));
    usb.faults = Script::new(vec![
        Fault::new("MEAS:POW?", 2, pm100::Kind::Silence),
        Fault::new("MEAS:POW?", 5, pm100::Kind::Parts),
        Fault::new("MEAS:POW?", 7, pm100::Kind::Stall),
    ]);
    let about = Definition::parse("pm100.toml", PM100).unwrap();
    let link = Link::usbtmc(usb, TmcSettings::default(), &about);
    let mut meter = ScpiPowerMeter::open(link, about, &Told::default(), &desk.within(10)).unwrap();
    assert_eq!(meter.identity(&desk.within(5)).unwrap().model, "PM100D");
    assert_eq!(meter.set_wavelength_nm(532.0, &desk.within(5)).unwrap(), 532.0);
    assert_eq!(meter.ranges(&desk.within(5)).unwrap(), ["auto", "5mW", "50mW"]);
    assert_eq!(meter.set_range("5mW", &desk.within(5)).unwrap(), "5mW");
    assert_eq!(meter.set_range("auto", &desk.within(5)).unwrap(), "auto");
    meter.zero(&desk.within(5)).unwrap();
    for _ in 0..8 {
        let Power::Watts(watts) = meter.power(&desk.within(20)).unwrap() else { panic!() };
        assert!(watts.abs() < 2e-3, "{watts}");
    }
}

/// Truth: the catalogue's own simulated instruments, by address, also behind their simulated adapter.
#[test]
fn simulated_instruments_open_by_address() {
    let desk = Desk::new();
    for options in [&[][..], &["gpib=8"], &["model=multimeter"]] {
        let mut options: Vec<String> = options.iter().map(|&option| option.to_owned()).collect();
        options.extend(["level=0.5e-3".to_owned(), "noise=0".to_owned()]);
        let mut address = Address::parse("sim-scpi", &options).unwrap();
        let line = address.connect(&desk.within(5)).unwrap();
        let AnyDevice::Meter(mut meter) = address.open(line, &desk.within(20)).unwrap() else {
            panic!()
        };
        assert_eq!(meter.read(&desk.within(5)).unwrap(), Level::Value(0.5e-3), "{options:?}");
    }
    let without = Address::parse("scpi-meter:/dev/null", &[]).unwrap().connect(&desk.within(1));
    assert!(without.unwrap_err().to_string().contains("sunglint devices template"));
}
