//! The Thorlabs driver on our simulated meter.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{Device as _, DeviceError, Power, PowerMeter as _, Value};
use sunglint_drivers::simulated::pm100::{self, Kind};
use sunglint_drivers::simulated::script::{Fault, Script};
use sunglint_drivers::simulated::{PowerSource, Steady};
use sunglint_drivers::thorlabs::{Pm100, Pm100Settings, TmcSettings};

type Meter = Pm100<pm100::Pm100>;

fn within(clock: &Arc<VirtualClock>, seconds: u64) -> Deadline {
    Deadline::after(clock.clone(), Duration::from_secs(seconds))
}

fn open(
    settings: pm100::Pm100Settings,
    source: impl PowerSource + 'static,
) -> (Meter, Arc<VirtualClock>) {
    let clock = Arc::new(VirtualClock::new());
    let usb = pm100::Pm100::new(settings, source);
    let deadline = within(&clock, 10);
    let meter = Pm100::open(usb, TmcSettings::default(), Pm100Settings::default(), &deadline);
    (meter.unwrap(), clock)
}

/// Truth: the light that was put in, the simulated meter's own state, and the ends of its ranges.
#[test]
fn readings_ranges_and_wavelengths() {
    let (mut meter, clock) = open(pm100::Pm100Settings::default(), Steady(7e-6));
    let deadline = within(&clock, 60);
    assert_eq!(meter.power(&deadline).unwrap(), Power::Watts(7e-6));
    assert_eq!(meter.ranges(&deadline).unwrap(), ["AUTO", "5e-7W", "5e-2W"]);
    assert_eq!(meter.set_range("AUTO", &deadline).unwrap(), "5e-5W");
    assert_eq!(meter.set_range("1uW", &deadline).unwrap(), "5e-6W");
    let over = Power::Over { range_w: Some(5e-6) };
    assert_eq!(meter.power(&deadline).unwrap(), over);
    assert_eq!(meter.set_range("5e-2W", &deadline).unwrap(), "5e-2W");
    assert_eq!(meter.power(&deadline).unwrap(), Power::Watts(7e-6));
    let error = meter.set_range("60mW", &deadline).unwrap_err();
    assert!(matches!(error, DeviceError::OutOfRange { .. }), "{error}");
    let error = meter.set_range("large", &deadline).unwrap_err();
    assert!(error.to_string().contains("expected one of AUTO, 5e-7W, 5e-2W"), "{error}");
    assert_eq!(meter.set_wavelength_nm(532.1, &deadline).unwrap(), 532.1);
    assert_eq!(meter.usb().wavelength_nm(), 532.1);
    for asked in [399.9, 1100.1, f64::NAN] {
        let error = meter.set_wavelength_nm(asked, &deadline).unwrap_err();
        assert!(matches!(error, DeviceError::OutOfRange { .. }), "{error}");
    }
    assert_eq!(meter.set_averaging(100, &deadline).unwrap(), 100);
    let error = meter.set_averaging(100_000, &deadline).unwrap_err();
    assert!(error.to_string().contains("-222, Data out of range"), "{error}");
    let settings = meter.settings(&deadline).unwrap();
    let value = |name| settings.iter().find(|setting| setting.name == name).unwrap().value.clone();
    assert_eq!(value("wavelength_nm"), Value::Number(532.1));
    assert_eq!(value("averaging"), Value::Integer(100));
    assert_eq!(value("sensor"), Value::Text("S120C".into()));
    assert_eq!(meter.identity(&deadline).unwrap().serial.as_deref(), Some("P0000001"));
}

/// Truth: 1 nW of dark signal that is gone after zeroing.
#[test]
fn zeroing_ends_or_is_stopped() {
    let settings = pm100::Pm100Settings { dark_w: 1e-9, ..pm100::Pm100Settings::default() };
    let (mut meter, clock) = open(settings, Steady(0.0));
    let deadline = within(&clock, 60);
    assert_eq!(meter.power(&deadline).unwrap(), Power::Watts(1e-9));
    let error = meter.zero(&within(&clock, 0)).unwrap_err();
    assert!(error.to_string().contains("no answer within"), "{error}");
    let short = Deadline::after(clock.clone(), Duration::from_millis(500));
    let error = meter.zero(&short).unwrap_err();
    assert!(matches!(error, DeviceError::TooSlow { .. }), "{error}");
    clock.sleep(Duration::from_secs(5));
    assert_eq!(meter.power(&deadline).unwrap(), Power::Watts(1e-9), "stopped");
    meter.zero(&deadline).unwrap();
    assert_eq!(meter.power(&deadline).unwrap(), Power::Watts(0.0));
}

/// Truth: light that doubles each second. An answer that was not fetched in time is cleared away, not taken for the next.
#[test]
fn a_late_answer_is_nobodys() {
    let light = |at: Duration| 1e-9 * at.as_secs_f64().exp2();
    let (mut meter, clock) = open(pm100::Pm100Settings::default(), light);
    let late = |nth| Fault::new("MEAS", nth, Kind::Late(Duration::from_millis(4000)));
    let wrong = Fault::new("MEAS", 6, Kind::WrongTag);
    meter.usb_mut().faults = Script::new(vec![late(1), late(3), late(4), wrong]);
    let mut read = 0;
    for _ in 0..6 {
        let before = clock.now();
        match meter.power(&within(&clock, 8)) {
            Ok(Power::Watts(watts)) => {
                let (least, most) = (light(before), light(clock.now()));
                assert!(watts >= least * 0.999 && watts <= most * 1.001, "{least} {watts} {most}");
                read += 1;
            }
            Ok(over) => panic!("{over:?}"),
            Err(error) => assert!(error.to_string().contains("no answer within"), "{error}"),
        }
    }
    assert!(read >= 4, "{read}");
}

/// Truth: what the settings say. A meter in dBm or with complaints of others is brought to watts at opening; a key pressed
/// later is seen. A thermal sensor has no wavelength, a pyroelectric one no power.
#[test]
fn keys_and_sensors_are_seen() {
    let settings = pm100::Pm100Settings {
        shows_dbm: true,
        complaints: vec!["-113,\"Undefined header\""; 30],
        ..pm100::Pm100Settings::default()
    };
    let (mut meter, clock) = open(settings, Steady(1e-3));
    let deadline = within(&clock, 60);
    assert_eq!(meter.power(&deadline).unwrap(), Power::Watts(1e-3));
    meter.usb_mut().faults = Script::new(vec![Fault::new("SENS:POW:UNIT?", 1, Kind::Say("DBM"))]);
    let error = meter.power(&deadline).unwrap_err();
    assert_eq!(error.to_string(), "Thorlabs power meter: unit was set to W, the device says DBM");
    let with = |sensor: &str| pm100::Pm100Settings {
        sensor: sensor.into(),
        ..pm100::Pm100Settings::default()
    };
    let (mut thermal, clock) = open(with("S302C,1,12-Jun-2014,2,0,81"), Steady(0.01));
    let error = thermal.set_wavelength_nm(532.0, &within(&clock, 9)).unwrap_err();
    assert!(matches!(error, DeviceError::NotReady { .. }), "{error}");
    let usb = pm100::Pm100::new(with("ES111C,1,12-Jun-2014,3,0,2"), Steady(0.0));
    let (tmc, settings) = (TmcSettings::default(), Pm100Settings::default());
    let error = Pm100::open(usb, tmc, settings, &within(&clock, 9)).unwrap_err();
    assert!(error.to_string().contains("measures no power"), "{error}");
}
