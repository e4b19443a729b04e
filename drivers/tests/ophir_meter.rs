//! The Ophir driver on our simulated meter.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::clock::{Cancel, Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::{
    Confirmed, Device as _, DeviceError, Power, PowerMeter as _, Value,
};
use sunglint_drivers::ophir::{Filter, LinkSettings, Meter, MeterSettings};
use sunglint_drivers::simulated::ophir::{HeadWavelengths, Kind, Ophir, OphirSettings};
use sunglint_drivers::simulated::script::{Fault, Script};
use sunglint_drivers::simulated::{InMemory, PowerSource, Steady};

type Simulated = InMemory<Ophir>;

fn within(clock: &Arc<VirtualClock>, seconds: u64) -> Deadline {
    Deadline::after(clock.clone(), Duration::from_secs(seconds))
}

fn open(
    settings: OphirSettings,
    source: impl PowerSource + 'static,
) -> (Meter<Simulated>, Arc<VirtualClock>) {
    let clock = Arc::new(VirtualClock::new());
    let line = InMemory::new(Ophir::new(settings, source));
    let deadline = within(&clock, 10);
    let meter = Meter::open(line, LinkSettings::default(), MeterSettings::default(), &deadline);
    (meter.unwrap(), clock)
}

/// Truth: the light that was put in. A filter that is on and not believed makes readings 100 times too small, and the
/// metadata says what the meter believes.
#[test]
fn the_filter_is_read_and_told() {
    let settings = OphirSettings { filter_is_on: true, ..OphirSettings::default() };
    let (mut meter, clock) = open(settings, Steady(2.5e-3));
    let deadline = within(&clock, 60);
    let filter = |meter: &mut Meter<Simulated>| {
        let settings = meter.settings(&deadline).unwrap();
        settings.into_iter().find(|setting| setting.name == "filter").unwrap().value
    };
    assert_eq!(filter(&mut meter), Value::Text("OUT".into()));
    assert_eq!(meter.power(&deadline).unwrap(), Power::Watts(2.5e-5));
    meter.set_filter(Filter::In, &deadline).unwrap();
    assert_eq!(filter(&mut meter), Value::Text("IN".into()));
    assert_eq!(meter.power(&deadline).unwrap(), Power::Watts(2.5e-3));
    assert_eq!(meter.filter(&deadline).unwrap(), Some(Filter::In));
}

/// Truth: the simulated meter's own state, and the names and ends of its ranges. `AUTO` is −1 wherever it stands in the list.
#[test]
fn ranges_go_by_name_wherever_auto_stands() {
    for knows_dbm in [false, true] {
        let settings = OphirSettings { knows_dbm, ..OphirSettings::default() };
        let (mut meter, clock) = open(settings, Steady(4e-6));
        let deadline = within(&clock, 60);
        let names = meter.ranges(&deadline).unwrap();
        assert_eq!(
            names,
            ["AUTO", "30.0mW", "3.00mW", "300uW", "30.0uW", "3.00uW", "300nW", "30.0nW"]
        );
        for name in &names {
            assert_eq!(&meter.set_range(name, &deadline).unwrap(), name);
            assert_eq!(meter.line().device.range(), name);
            let reading = meter.power(&deadline).unwrap();
            let over = |range_w| Power::Over { range_w: Some(range_w) };
            let expected = match name.as_str() {
                "3.00uW" => over(3e-6),
                "300nW" => over(300e-9),
                "30.0nW" => over(30e-9),
                _ => Power::Watts(4e-6),
            };
            assert_eq!(reading, expected, "{name}");
        }
        let error = meter.set_range("dBm", &deadline).unwrap_err();
        assert!(matches!(error, DeviceError::Unknown { .. }), "{error}");
        let error = meter.set_range("5mW", &deadline).unwrap_err();
        assert!(error.to_string().contains("3.00mW"), "{error}");
    }
}

/// Truth: the simulated meter's own wavelength.
#[test]
fn wavelengths_are_set_and_read_back() {
    let (mut meter, clock) = open(OphirSettings::default(), Steady(1e-6));
    let deadline = within(&clock, 60);
    // A slot that holds it is chosen; else the slot in use is overwritten, with whole nanometres.
    for (asked, got) in [(1064.0, 1064.0), (632.8, 633.0), (350.0, 350.0), (1100.4, 1100.0)] {
        assert_eq!(meter.set_wavelength_nm(asked, &deadline).unwrap(), got);
        assert_eq!(meter.line().device.wavelength_nm(), Some(got as u32));
    }
    for asked in [349.0, 1101.0, f64::NAN, -532.0, f64::INFINITY] {
        let error = meter.set_wavelength_nm(asked, &deadline).unwrap_err();
        assert!(matches!(error, DeviceError::OutOfRange { .. }), "{asked}: {error}");
    }
    let wavelengths = HeadWavelengths::Discrete(vec!["633", "1064", "<800"]);
    let (mut meter, clock) =
        open(OphirSettings { wavelengths, ..OphirSettings::default() }, Steady(1e-6));
    let deadline = within(&clock, 60);
    assert_eq!(meter.set_wavelength_nm(1064.0, &deadline).unwrap(), 1064.0);
    assert!(matches!(
        meter.set_wavelength_nm(700.0, &deadline).unwrap_err(),
        DeviceError::Unknown { .. }
    ));
}

/// Truth: 1 µW of dark signal that is gone after zeroing; the mean of a ramp over 3 s is its value 1.35 s before the measurement (ten samples,
/// 0.3 s apart), which ended after the meter was asked.
#[test]
fn zero_and_averaging() {
    let settings = OphirSettings { dark_w: 1e-6, ..OphirSettings::default() };
    let light = |at: Duration| if at.as_secs_f64() < 30.0 { 0.0 } else { at.as_secs_f64() * 1e-6 };
    let (mut meter, clock) = open(settings, light);
    let deadline = within(&clock, 600);
    assert_eq!(meter.power(&deadline).unwrap(), Power::Watts(1e-6));
    meter.zero(&deadline).unwrap();
    assert_eq!(meter.power(&deadline).unwrap(), Power::Watts(0.0));
    meter.save_zero(&deadline).unwrap();
    clock.sleep(Duration::from_secs(60));
    meter.set_averaging("3s", &deadline).unwrap();
    assert_eq!(meter.averaging(&deadline).unwrap().unwrap().name(), "3s");
    let before = clock.now().as_secs_f64();
    let Power::Watts(watts) = meter.power(&deadline).unwrap() else { panic!("no power") };
    // Four digits of about 60 µW.
    let [least, most] = [before, clock.now().as_secs_f64()].map(|at| (at - 1.35) * 1e-6);
    assert!((least - 1e-8..=most + 1e-8).contains(&watts), "{watts} at {before}");
    let error = meter.set_averaging("7s", &deadline).unwrap_err();
    assert!(error.to_string().contains("NONE, 0.5s, 1s, 3s"), "{error}");
    // A zeroing that is cut short is told, and stopped in the meter.
    let error = meter.zero(&within(&clock, 2)).unwrap_err();
    assert!(matches!(error, DeviceError::TooSlow { .. }), "{error}");
    let cancel = Cancel::new();
    cancel.cancel();
    let error = meter.power(&within(&clock, 9).with_cancel(&cancel)).unwrap_err();
    assert!(matches!(error, DeviceError::Cancelled { .. }), "{error}");
}

/// Truth: light that doubles each second. An answer that comes 0.7 s after the host gave up on it is never taken for the
/// next reading: readings are those of their own time.
#[test]
fn a_late_answer_is_nobodys() {
    let light = |at: Duration| 1e-9 * at.as_secs_f64().exp2();
    let (mut meter, clock) = open(OphirSettings::default(), light);
    let late = |nth| Fault::new("$SP", nth, Kind::Late(Duration::from_millis(1700)));
    meter.line_mut().device.faults = Script::new(vec![late(1), late(3), late(4), late(7)]);
    let mut read = 0;
    for _ in 0..8 {
        let before = clock.now();
        match meter.power(&within(&clock, 3)) {
            Ok(Power::Watts(watts)) => {
                let (least, most) = (light(before), light(clock.now()));
                // Four digits.
                assert!(
                    watts >= least * 0.9994 && watts <= most * 1.0006,
                    "{least} {watts} {most}"
                );
                read += 1;
            }
            Ok(over) => panic!("{over:?}"),
            Err(error) => assert!(error.to_string().contains("no answer within"), "{error}"),
        }
        clock.sleep(Duration::from_millis(500));
    }
    assert!(read >= 5, "{read}");
}

/// Truth: the command that brings the power mode where `$FP` is unknown (pymeasure's `Modes.POWER` is 2).
#[test]
fn a_meter_without_the_old_mode_command_is_opened() {
    let clock = Arc::new(VirtualClock::new());
    let deadline = within(&clock, 20);
    let open = |faults| {
        let mut device = Ophir::new(OphirSettings::default(), Steady(1e-6));
        device.faults = Script::new(faults);
        let (link, settings) = (LinkSettings::default(), MeterSettings::default());
        Meter::open(InMemory::new(device), link, settings, &deadline)
    };
    let no = |on| Fault::new(on, 0, Kind::Say("?BAD COMMAND"));
    assert_eq!(open(vec![no("$FP")]).unwrap().power(&deadline).unwrap(), Power::Watts(1e-6));
    let error = open(vec![no("$FP"), no("$MM2")]).unwrap_err();
    assert!(matches!(error, DeviceError::Rejected { .. }), "{error}");
}

/// Truth: the refusals' own words; the unit that a key on the meter changes.
#[test]
fn refusals_and_keys_on_the_meter_are_seen() {
    let (mut meter, clock) = open(OphirSettings::default(), Steady(1e-6));
    let deadline = within(&clock, 60);
    meter.line_mut().device.faults = Script::new(vec![Fault::new("$SI", 1, Kind::Say("*dBm"))]);
    let error = meter.power(&deadline).unwrap_err();
    assert_eq!(error.to_string(), "Ophir power meter: unit was set to W, the device says dBm");
    assert_eq!(meter.power(&deadline).unwrap(), Power::Watts(1e-6));
    meter.line_mut().device.faults =
        Script::new(vec![Fault::new("$FQ", 0, Kind::Say("?NO FILTER"))]);
    assert_eq!(meter.filter(&deadline).unwrap(), None);
    let error = meter.set_filter(Filter::In, &deadline).unwrap_err();
    assert_eq!(error.to_string(), "Ophir power meter refused $FQ2: it says `NO FILTER`");
    meter.line_mut().device.faults = Script::new(vec![Fault::new("$WN2", 0, Kind::Say("*"))]);
    let identity = meter.identity(&deadline).unwrap();
    assert_eq!(
        (identity.model.as_str(), identity.serial.as_deref(), identity.firmware.as_deref()),
        ("VEGA", Some("222222"), Some("VG1.32"))
    );
    // Another meter on the same cable is not taken for it.
    meter.line_mut().device = Ophir::new(
        OphirSettings { instrument: "VEGA 333333 VEGA".into(), ..OphirSettings::default() },
        Steady(1.0),
    );
    let error = meter.identity(&deadline).unwrap_err();
    assert!(error.to_string().contains("the meter that was there before"), "{error}");
}

/// Truth: the light. Of spoilt readings none is believed when two in a row have to agree.
#[test]
fn confirmed_readings_outlive_a_spoilt_one() {
    let (mut meter, clock) = open(OphirSettings::default(), Steady(1.3e-5));
    let faults = vec![
        Fault::new("$SP", 1, Kind::Say("*1.700E-5")),
        Fault::new("$SP", 3, Kind::Say("*1.300E-7")),
    ];
    meter.line_mut().device.faults = Script::new(faults);
    let mut meter = Confirmed::new(meter, 1e-3, 0.0, 6);
    assert_eq!(meter.power(&within(&clock, 60)).unwrap(), Power::Watts(1.3e-5));
    let flicker = |at: Duration| 1e-6 * (1.0 + at.as_secs_f64());
    let (meter, clock) = open(OphirSettings::default(), flicker);
    let error = Confirmed::new(meter, 1e-3, 0.0, 4).power(&within(&clock, 60)).unwrap_err();
    assert!(error.to_string().contains("unsteady light"), "{error}");
}
