//! Our simulated Elliptec mount on a pty, under hosts that we did not write: the packages elliptec 0.1.0 and pylablib 1.4.3.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use serialport::SerialPort as _;
use sunglint_drivers::clock::Cancel;
use sunglint_drivers::simulated::elliptec::{Elliptec, ElliptecSettings};
use sunglint_drivers::simulated::serve;
use sunglint_drivers::transport::serial::Serial;
use sunglint_testkit::{peer_python, run_python};

/// Runs a script against a mount on a pty, and gives what it printed and the mount.
fn run(python: &std::path::Path, script: &str, settings: ElliptecSettings) -> (String, Elliptec) {
    let (device, mut host) = serialport::TTYPort::pair().unwrap();
    // Kept open beside the script's, so that the device's end sees no hang-up before the script is there.
    host.set_exclusive(false).unwrap();
    let path = host.name().unwrap();
    let cancel = Cancel::new();
    let deadline = crate::common::within(60.0).with_cancel(&cancel);
    let mut device = Serial::from_port(Box::new(device));
    let mount = Elliptec::new(settings);
    let server = std::thread::spawn(move || serve(mount, &mut device, &deadline).unwrap());
    let printed = run_python(python, script, &[&path]);
    drop(host);
    cancel.cancel();
    (printed, server.join().unwrap())
}

/// Truth: elliptec's own reading: 90° come back as 90°; 10.5° are 4181.33 pulses, of which that package takes the whole ones, 10.4992°.
#[test]
fn the_package_elliptec_turns_our_mount() {
    let name = "the_package_elliptec_turns_our_mount";
    let Some(python) = peer_python(name, &["elliptec"]) else { return };
    let script = r#"
import sys, elliptec
controller = elliptec.Controller(sys.argv[1], debug=False)
mount = elliptec.Rotator(controller, debug=False)
info = mount.get("info")
print(info["Motor Type"], info["Serial No."], info["Range"], info["Pulse/Rev"])
mount.home()
print(mount.get_angle())
print(mount.set_angle(90.0), mount.get_angle())
print(mount.set_angle(10.5), mount.shift_angle(-20.0))
print(mount.get("status"))
controller.close_connection()
"#;
    let (printed, mount) = run(&python, script, ElliptecSettings::default());
    assert_eq!(
        printed,
        "14 11400519 360 143360\n0.0\n90.0 90.0\n10.4992 -9.4997\n('0', 'GS', '0')\n"
    );
    // 4181 − 7964 pulses.
    assert_eq!(mount.place() + 35_840, -3_783);
}

/// Truth: pylablib's own reading; it finds the one mount among sixteen addresses.
#[test]
fn pylablib_turns_our_mount() {
    let name = "pylablib_turns_our_mount";
    let Some(python) = peer_python(name, &["pylablib"]) else { return };
    let script = r#"
import os, sys, types, pylablib.devices
# The package's own __init__ loads cameras, which need numba.
folder = os.path.join(os.path.dirname(pylablib.devices.__file__), "Thorlabs")
sys.modules["pylablib.devices.Thorlabs"] = package = types.ModuleType("pylablib.devices.Thorlabs")
package.__path__ = [folder]
from pylablib.devices.Thorlabs.elliptec import ElliptecMotor
mount = ElliptecMotor(sys.argv[1])
print(mount.get_connected_addrs(), *mount.get_device_info())
print(mount.get_status(), mount.get_velocity(), mount.home(), mount.get_position())
print(mount.move_to(90.0), mount.get_position(), mount.move_by(-10.0), round(mount.get_position(), 3))
print(mount.set_velocity(50), mount.move_to(0), mount.get_position())
mount.close()
"#;
    let settings = ElliptecSettings { address: 2, ..ElliptecSettings::default() };
    let (printed, mount) = run(&python, script, settings);
    assert_eq!(
        printed,
        "[2] 11400519 14 2021 22 1 360 143360\nok 100 True 0.0\nTrue 90.0 True 80.001\n50 True 0.0\n"
    );
    assert_eq!(mount.place(), -35_840);
}
