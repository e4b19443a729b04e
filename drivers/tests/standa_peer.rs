//! Our simulated Standa controller on a pty, under hosts that we did not write: pylablib 1.4.3 and the maker's libximc 2.14.30; and our driver through TCP.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use serialport::SerialPort as _;
use std::fs::OpenOptions;
use std::os::unix::fs::OpenOptionsExt as _;
use sunglint_drivers::catalogue::{Address, AnyDevice};
use sunglint_drivers::clock::Cancel;
use sunglint_drivers::simulated::serve;
use sunglint_drivers::simulated::served::{Port, Served};
use sunglint_drivers::simulated::standa::{Standa, StandaSettings};
use sunglint_drivers::transport::serial::Serial;
use sunglint_testkit::{peer_python, run_python};

/// Runs a script against a controller on a pty, and gives what it printed and the controller.
fn run(python: &std::path::Path, script: &str) -> (String, Standa) {
    /// The terminal shall not become this program's own.
    const NO_TERMINAL: i32 = 0o400;
    let (device, host) = serialport::TTYPort::pair().unwrap();
    let path = host.name().unwrap();
    // Kept open beside the script's, so that the device's end sees no hang-up before the script is there; by a file without a lock, as the maker's library locks the port.
    let kept = OpenOptions::new().read(true).write(true).custom_flags(NO_TERMINAL).open(&path);
    let kept = kept.unwrap();
    drop(host);
    let cancel = Cancel::new();
    let deadline = crate::common::within(300.0).with_cancel(&cancel);
    let mut device = Serial::from_port(Box::new(device));
    let stage = Standa::new(StandaSettings::default());
    let server = std::thread::spawn(move || serve(stage, &mut device, &deadline).unwrap());
    let printed = run_python(python, script, &[&path]);
    drop(kept);
    cancel.cancel();
    (printed, server.join().unwrap())
}

/// Truth: pylablib's own reading of what our controller says: it homes, moves there and back, sets the speed, is stopped on its way, and comes back after garbage.
#[test]
fn pylablib_turns_our_controller() {
    let name = "pylablib_turns_our_controller";
    let Some(python) = peer_python(name, &["pylablib"]) else { return };
    let script = r#"
import os, sys, types, pylablib.devices
folder = os.path.join(os.path.dirname(pylablib.devices.__file__), "Standa")
sys.modules["pylablib.devices.Standa"] = package = types.ModuleType("pylablib.devices.Standa")
package.__path__ = [folder]
from pylablib.devices.Standa.base import Standa8SMC, StandaError
stage = Standa8SMC((sys.argv[1], 115200, 8, "N", 2))
print(*stage.get_engine_type(), *stage.get_stepper_motor_calibration())
print(stage.get_position(), stage.is_moving(), stage.home(), stage.get_position())
print(stage.set_position_reference(0), stage.move_to(256_007), stage.wait_move(), stage.get_position())
print(stage.move_by(-512_014), stage.wait_move(), stage.get_position(), stage.get_encoder())
state = stage.get_status()
print(state.smov, state.scmd, state.spwr, state.position, state.speed, state.ivpwr, state.temp, hex(state.flags))
print(stage.setup_move(speed=51_203).speed, stage.move_to(100_000_000), stage.is_moving(), stage.get_status().scmd)
stage.stop()
print(stage.is_moving(), -256_007 < stage.get_position() < 100_000_000, stage.get_status().scmd)
try: stage.query("nope")
except StandaError as error: print(error)
print(stage.set_position_reference(-300), stage.get_status().scmd)
stage.close()
"#;
    let (printed, stage) = run(&python, script);
    assert_eq!(
        printed,
        "step fet 200 256\n\
         0 False None -384000\n\
         0 None None 256007\n\
         None None -256007 -640007\n\
         () ('movr', 'success') norm -256007 0 (0.4, 36.0) 25.1 0x30\n\
         51203 None True ('move', 'running')\n\
         False True ('sstp', 'success')\n\
         command nope returned an error 'errc' (unrecognized command)\n\
         -300 ('sstp', 'success')\n"
    );
    assert!(stage.is_standing() && stage.place() > -640_007);
}

/// Truth: the reading of the maker's own library, libximc 2.14.30: `command_homezero` as our driver homes, microsteps there and back, another speed, a soft stop.
#[test]
fn the_makers_library_turns_our_controller() {
    let name = "the_makers_library_turns_our_controller";
    let Some(python) = peer_python(name, &["libximc"]) else { return };
    let script = r#"
import sys, libximc.highlevel as ximc
number = lambda value: getattr(value, "value", value)
axis = ximc.Axis("xi-com://" + sys.argv[1])
axis.open_device()
about = axis.get_device_information()
print(about.Manufacturer, about.ManufacturerId, about.ProductDescription, about.Major, about.Minor, about.Release)
print(axis.get_serial_number(), *axis.get_firmware_version())
engine = axis.get_engine_settings()
print(number(engine.MicrostepMode), engine.StepsPerRev, number(axis.get_entype_settings().EngineType))
axis.command_homezero()
def where():
    at = axis.get_position()
    return at.Position, at.uPosition, at.EncPosition
print(*where())
axis.command_move(1000, 7)
axis.command_wait_for_stop(10)
print(*where())
axis.command_movr(-2000, -14)
axis.command_wait_for_stop(10)
state = axis.get_status()
print(state.CurPosition, state.uCurPosition, number(state.MvCmdSts), state.Upwr, state.CurT, number(state.Flags))
move = axis.get_move_settings()
move.Speed, move.uSpeed = 200, 3
axis.set_move_settings(move)
print(axis.get_move_settings().Speed, axis.get_move_settings().uSpeed)
axis.command_move(300_000, 0)
print(number(axis.get_status().MvCmdSts))
axis.command_sstp()
axis.command_wait_for_stop(10)
print(number(axis.get_status().MvCmdSts), -1001 < axis.get_position().Position < 300_000)
axis.close_device()
"#;
    let (printed, stage) = run(&python, script);
    assert_eq!(
        printed,
        "XIMC SM 8SMC5-US 2 3 8\n\
         12345 4 7 8\n\
         9 200 3\n\
         0 0 -384000\n\
         1000 7 -127993\n\
         -1000 -7 2 3600 251 48\n\
         200 3\n\
         129\n\
         8 True\n"
    );
    assert!(stage.is_standing());
}

/// Our own driver by its address, through TCP, to the served device. Truth: the device's reference, 15° in reverse of where it was.
#[test]
fn our_driver_turns_it_through_tcp() {
    let mut device = Served::new(Address::parse("sim-standa", &[]).unwrap()).unwrap();
    let port = Port::listen("127.0.0.1:0").unwrap();
    let at = port.at();
    let cancel = Cancel::new();
    let angles = std::thread::scope(|scope| {
        let server = scope.spawn(|| device.at_port(&port, &cancel, |_| {}));
        let turn = || {
            let options = ["counts_per_deg=25600".to_owned()];
            let mut address = Address::parse(&format!("standa:tcp:{at}"), &options).unwrap();
            let line = address.connect(&crate::common::within(10.0)).unwrap();
            let AnyDevice::RotationStage(mut stage) =
                address.open(line, &crate::common::within(10.0)).unwrap()
            else {
                panic!("another kind");
            };
            let before = stage.angle_deg(&crate::common::within(10.0)).unwrap();
            let home = stage.home(&crate::common::within(20.0)).unwrap();
            (before, home, stage.move_to(12.5, &crate::common::within(20.0)).unwrap())
        };
        // Whatever happens in there, the server ends.
        let done = std::panic::catch_unwind(std::panic::AssertUnwindSafe(turn));
        cancel.cancel();
        server.join().unwrap().unwrap();
        done.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    });
    assert_eq!(angles, (0.0, 0.0, 12.5));
}
