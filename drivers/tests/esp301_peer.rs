//! Our simulated ESP301 on a pty, under a host that we did not write: pymeasure 0.16.0.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use serialport::SerialPort as _;
use sunglint_drivers::clock::Cancel;
use sunglint_drivers::simulated::esp301::{Esp301, Esp301Settings};
use sunglint_drivers::simulated::serve;
use sunglint_drivers::transport::serial::Serial;
use sunglint_testkit::{peer_python, run_python};

/// Truth: pymeasure's own reading: positions, unit, end of motion, and the errors of an axis that is not there and of a motor
/// that is off.
#[test]
fn pymeasure_turns_our_controller() {
    let name = "pymeasure_turns_our_controller";
    let Some(python) = peer_python(name, &["pymeasure.instruments.newport"]) else { return };
    let script = r#"
import sys
from pymeasure.adapters import SerialAdapter
from pymeasure.instruments.newport import ESP300
adapter = SerialAdapter(sys.argv[1], baudrate=19200, timeout=2, write_termination="\r", read_termination="\r\n")
controller = ESP300(adapter)
axis = controller.x
print(axis.enabled, axis.units, axis.position, axis.motion_done)
axis.position = 5
print([str(error) for error in controller.errors])
axis.enable()
axis.home()
axis.wait_for_stop()
print(axis.enabled, axis.position, controller.error)
axis.position = 12.5
axis.wait_for_stop()
print(axis.position, axis.motion_done)
controller.y.enable()
print([str(error) for error in controller.errors])
"#;
    let (device, mut host) = serialport::TTYPort::pair().unwrap();
    // Kept open beside the script's, so that the device's end sees no hang-up before the script is there.
    host.set_exclusive(false).unwrap();
    let path = host.name().unwrap();
    let cancel = Cancel::new();
    let deadline = crate::common::within(60.0).with_cancel(&cancel);
    let mut device = Serial::from_port(Box::new(device));
    let controller = Esp301::new(Esp301Settings::default());
    let server = std::thread::spawn(move || serve(controller, &mut device, &deadline).unwrap());
    let printed = run_python(&python, script, &[&path]);
    drop(host);
    cancel.cancel();
    let controller = server.join().unwrap();
    assert_eq!(
        printed,
        "False degree 0.0 True\n['Newport ESP300 axis 1 reported the error: MOTOR NOT ENABLED']\nTrue 0.0 0\n12.5 True\n\
         ['Newport ESP300 reported the error: AXIS NUMBER OUT OF RANGE']\n"
    );
    assert_eq!(controller.place(), -25_000);
}
