//! Our simulated Zaber device at a TCP port, under the maker's own library, zaber-motion 10.3.0, and our driver at the same port.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use sunglint_drivers::catalogue::{Address, AnyDevice};
use sunglint_drivers::clock::Cancel;
use sunglint_drivers::simulated::served::{Port, Served};
use sunglint_testkit::{peer_python, run_python};

/// Serves `sim-zaber` at a port while `act` runs.
fn served<V>(act: impl FnOnce(std::net::SocketAddr) -> V) -> V {
    let address = Address::parse("sim-zaber", &[]).unwrap();
    let mut device = Served::new(address).unwrap();
    let port = Port::listen("127.0.0.1:0").unwrap();
    let at = port.at();
    let cancel = Cancel::new();
    std::thread::scope(|scope| {
        let server = scope.spawn(|| device.at_port(&port, &cancel, |_| {}));
        // Whatever happens in there, the server ends.
        let done = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| act(at)));
        cancel.cancel();
        server.join().unwrap().unwrap();
        done.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    })
}

/// Truth: the maker's own reading of what our device says: it homes, moves there and back, and is stopped on its way. `identify` is not
/// asked: the library's table of devices is on the internet.
#[test]
fn the_makers_library_turns_our_device() {
    let name = "the_makers_library_turns_our_device";
    let Some(python) = peer_python(name, &["zaber_motion"]) else { return };
    let script = r#"
import sys
from zaber_motion.ascii import Connection
with Connection.open_tcp("127.0.0.1", int(sys.argv[1])) as connection:
    device = connection.get_device(1)
    axis = device.get_axis(1)
    print(device.generic_command("get deviceid").data, device.generic_command("get version").data)
    axis.home()
    print(axis.is_homed(), axis.is_busy(), axis.get_position(), axis.warnings.get_flags())
    axis.move_absolute(12345)
    print(axis.get_position())
    axis.move_relative(-2345)
    print(axis.get_position(), axis.generic_command("get pos").data)
    axis.move_absolute(10_000_000, wait_until_idle=False)
    print(axis.is_busy())
    axis.stop()
    print(axis.is_busy(), 10_000 < axis.get_position() < 10_000_000)
    try: device.generic_command("nonsense")
    except Exception as error: print(type(error).__name__)
"#;
    let printed = served(|at| run_python(&python, script, &[&at.port().to_string()]));
    assert_eq!(
        printed,
        "50081 7.35\nTrue False 0.0 set()\n12345.0\n10000.0 10000\nTrue\nFalse True\nBadCommandException\n"
    );
}

/// Our own driver by its address, through TCP. Truth: the device's reference, 15° in reverse of where it was.
#[test]
fn our_driver_turns_it_through_tcp() {
    let angle = served(|at| {
        let options = ["counts_per_deg=1000".to_owned()];
        let mut address = Address::parse(&format!("zaber:tcp:{at}"), &options).unwrap();
        let line = address.connect(&crate::common::within(10.0)).unwrap();
        let AnyDevice::RotationStage(mut stage) =
            address.open(line, &crate::common::within(10.0)).unwrap()
        else {
            panic!("another kind");
        };
        assert_eq!(stage.angle_deg(&crate::common::within(10.0)).unwrap(), 0.0);
        assert_eq!(stage.home(&crate::common::within(20.0)).unwrap(), 0.0);
        stage.move_to(12.5, &crate::common::within(20.0)).unwrap()
    });
    assert_eq!(angle, 12.5);
}
