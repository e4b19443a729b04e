//! Our simulated Ophir meter through a real pty, under our driver and under a host that we did not write: pylablib 1.4.3.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use serialport::SerialPort as _;
use sunglint_drivers::clock::Cancel;
use sunglint_drivers::device::{Power, PowerMeter as _};
use sunglint_drivers::ophir::{LinkSettings, Meter, MeterSettings};
use sunglint_drivers::simulated::ophir::{Ophir, OphirSettings};
use sunglint_drivers::simulated::{Steady, serve};
use sunglint_drivers::transport::serial::Serial;
use sunglint_testkit::{peer_python, run_python};

/// Truth: what pylablib's own parsers make of the answers, beside the numbers that were put into the meter: 13 µW at the
/// head (with the filter on and believed, the same; with the filter on and not believed, a hundredth), 532 nm, ranges that
/// pylablib lists in W from 30 mW down.
#[test]
fn pylablibs_host_reads_and_sets_our_simulated_meter() {
    let name = "pylablibs_host_reads_and_sets_our_simulated_meter";
    let Some(python) = peer_python(name, &["pylablib"]) else { return };
    let (device, mut host) = serialport::TTYPort::pair().unwrap();
    // Kept open beside the script's, so that the device's end sees no hang-up before the script is there.
    host.set_exclusive(false).unwrap();
    let path = host.name().unwrap();
    let cancel = Cancel::new();
    let deadline = crate::common::within(60.0).with_cancel(&cancel);
    let mut device = Serial::from_port(Box::new(device));
    // pylablib counts the ranges from the third name, as a Vega with a photodiode lists them.
    let settings =
        OphirSettings { knows_dbm: true, filter_is_on: true, ..OphirSettings::default() };
    let meter = Ophir::new(settings, Steady(13e-6));
    let server = std::thread::spawn(move || serve(meter, &mut device, &deadline).unwrap());
    let script = r#"
import sys
from pylablib.devices import Ophir
meter = Ophir.VegaPowerMeter((sys.argv[1], 9600))
print(*meter.get_device_info())
print(*meter.get_head_info())
print(meter.get_units(), meter.get_power(), meter.is_filter_in())
print(meter.set_filter(True), meter.get_power())
print(meter.get_wavelength_info().mode, meter.set_wavelength(700e-9))
number = meter.set_range_idx(3)
print(number, *[f"{watts:.3g}" for watts in meter.get_range_info().ranges + [meter.get_range()]])
print(meter.set_range_idx(4), meter.get_power())
print(meter.set_range_idx(-1), meter.get_power(), meter.get_baudrate())
try: meter.query("$XY")
except Ophir.OphirError as error: print(error)
meter.close()
"#;
    let printed = run_python(&python, script, &[&path]);
    drop(host);
    cancel.cancel();
    let meter = server.join().unwrap();
    let expected = "\
        VEGA 222222 VEGA VG1.32\n\
        photodiode 123456 PD300 ('power', 'frequency')\n\
        W 1.3e-07 False\n\
        True 1.3e-05\n\
        continuous 7.000000000000001e-07\n\
        3 0.03 0.003 0.0003 3e-05 3e-06 3e-07 3e-08 3e-05\n\
        4 over\n\
        -1 1.3e-05 9600\n\
        Command $XY returned error: b'BAD COMMAND'\n";
    assert_eq!(printed, expected);
    assert_eq!((meter.wavelength_nm(), meter.range()), (Some(700), "AUTO"));
}

/// Our own driver through serialport and a pty. Truth: the light that was put in, and the meter's own state.
#[test]
fn our_driver_reads_and_sets_the_simulated_meter_on_a_pty() {
    let mut pty = crate::common::pty();
    let cancel = Cancel::new();
    let deadline = crate::common::within(60.0).with_cancel(&cancel);
    let meter = Ophir::new(OphirSettings::default(), Steady(2.5e-4));
    let server = std::thread::spawn(move || serve(meter, &mut pty.device, &deadline).unwrap());
    let within = crate::common::within(20.0);
    let (link, settings) = (LinkSettings::default(), MeterSettings::default());
    let mut meter = Meter::open(pty.host, link, settings, &within).unwrap();
    assert_eq!(meter.set_wavelength_nm(808.0, &within).unwrap(), 808.0);
    assert_eq!(meter.set_range("300uW", &within).unwrap(), "300uW");
    assert_eq!(meter.power(&within).unwrap(), Power::Watts(2.5e-4));
    assert_eq!(meter.set_range("30.0uW", &within).unwrap(), "30.0uW");
    assert_eq!(meter.power(&within).unwrap(), Power::Over { range_w: Some(3e-5) });
    cancel.cancel();
    let device = server.join().unwrap();
    assert_eq!((device.wavelength_nm(), device.range()), (Some(808), "30.0uW"));
}
