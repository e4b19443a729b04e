//! SCPI with programs that we did not write: pyvisa 1.16.2 with pyvisa-py 0.8.1 as hosts of our simulated instruments, and devices made of sinstruments 1.5.0 for our driver.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::scpi::template;
use serialport::SerialPort as _;
use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;
use sunglint_drivers::catalogue::{Address, AnyDevice};
use sunglint_drivers::clock::Cancel;
use sunglint_drivers::device::{DeviceError, Level, Value};
use sunglint_drivers::scpi::{Cable, Link, ScpiMeter, Told};
use sunglint_drivers::simulated::scpi::{Adapter, Instrument, Model, ScpiSettings};
use sunglint_drivers::simulated::served::{Port, Served};
use sunglint_drivers::simulated::{Speaker, serve};
use sunglint_drivers::transport::serial::Serial;
use sunglint_drivers::transport::tcp::Tcp;
use sunglint_testkit::{peer_python, run_python};

/// The host of a picoammeter. pyvisa-py is told to be the backend; the resource is the script's argument.
const HOST: &str = r#"
import sys, pyvisa
manager = pyvisa.ResourceManager("@py")
if len(sys.argv) > 2:
    adapter = manager.open_resource(sys.argv[2])
    it = manager.open_resource(sys.argv[1])
else: it = manager.open_resource(sys.argv[1], read_termination="\n", timeout=5000)
it.write_termination = "\n"
ask = lambda question: it.query(question).strip()
print(ask("*IDN?"))
it.write("SYST:ZCH OFF")
it.write("FORM:ELEM READ,UNIT,TIME,STAT")
print(ask("SYST:ERR?"))
value, time, status = ask("READ?").split(",")
print(value, float(status))
print(ask("FETC?").split(",")[0])
it.write("CURR:RANG 2E-9")
print(it.query_ascii_values("CURR:RANG?"), ask("CURR:RANG:AUTO?"), float(ask("READ?").split("A")[0]))
it.write("CURR:RANG 1")
it.write("NONSENSE")
print(ask("SYST:ERR?"), ask("SYST:ERR?"), ask("SYST:ERR?"))
print(ask("*OPC?;*ESE 37;*ESE?"))
it.write("FORM:ELEM READ")
print(it.query_binary_values("TRAC:DATA?", datatype="B", container=bytes) if BLOCKS else "")
it.close()
"#;

fn host(blocks: bool) -> String {
    HOST.replace("BLOCKS", if blocks { "True" } else { "False" })
}

/// Truth: 5 nA at the input: a reading, the same again, too much for 2.1 nA; SCPI's numbers of two mistakes.
const SAID: &str = "\
KEITHLEY INSTRUMENTS INC.,MODEL 6485,1234567,B03   Sep 25 2002
0,\"No error\"
+5.000000E-09A 0.0
+5.000000E-09A
[2.1e-09] 0 9.9e+37
-222,\"Data out of range\" -113,\"Undefined header\" 0,\"No error\"
1;37
";

fn picoammeter() -> Instrument {
    let settings =
        ScpiSettings { model: Model::Picoammeter, noise: 0.0, ..ScpiSettings::default() };
    Instrument::new(settings, |_| 5e-9)
}

fn on_tcp(device: impl Speaker + 'static, go: impl FnOnce(u16)) {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let server = std::thread::spawn(move || {
        let (stream, _) = listener.accept().unwrap();
        serve(device, &mut Tcp::from_stream(stream).unwrap(), &crate::common::within(60.0))
            .unwrap();
    });
    go(port);
    server.join().unwrap();
}

/// By TCP, as `devices serve sim-scpi --tcp 5025` serves it.
#[test]
fn pyvisa_drives_our_simulated_picoammeter_by_tcp() {
    let name = "pyvisa_drives_our_simulated_picoammeter_by_tcp";
    let Some(python) = peer_python(name, &["pyvisa", "pyvisa_py"]) else { return };
    let options = ["level=5e-9".to_owned(), "noise=0".to_owned()];
    let mut served = Served::new(Address::parse("sim-scpi", &options).unwrap()).unwrap();
    let port = Port::listen("127.0.0.1:0").unwrap();
    let at = port.at().port();
    let cancel = Cancel::new();
    let token = cancel.clone();
    let server = std::thread::spawn(move || served.at_port(&port, &token, |_| {}).unwrap());
    let resource = format!("TCPIP::127.0.0.1::{at}::SOCKET");
    let printed = run_python(&python, &host(true), &[&resource]);
    cancel.cancel();
    server.join().unwrap();
    assert_eq!(printed, format!("{SAID}b'+9.900000E+37'\n"));
}

/// On a pty.
#[test]
fn pyvisa_drives_our_simulated_picoammeter_on_a_pty() {
    let name = "pyvisa_drives_our_simulated_picoammeter_on_a_pty";
    let Some(python) = peer_python(name, &["pyvisa", "pyvisa_py", "serial"]) else { return };
    let (device, mut host_end) = serialport::TTYPort::pair().unwrap();
    // Kept open beside the script's, so that the device's end sees no hang-up before the script is there.
    host_end.set_exclusive(false).unwrap();
    let path = host_end.name().unwrap();
    let cancel = Cancel::new();
    let deadline = crate::common::within(60.0).with_cancel(&cancel);
    let mut device = Serial::from_port(Box::new(device));
    let server = std::thread::spawn(move || serve(picoammeter(), &mut device, &deadline).unwrap());
    let printed = run_python(&python, &host(true), &[&format!("ASRL{path}::INSTR")]);
    drop(host_end);
    cancel.cancel();
    assert_eq!(server.join().unwrap().overlaps(), 0);
    assert_eq!(printed, format!("{SAID}b'+9.900000E+37'\n"));
}

/// Behind our simulated Prologix adapter, with pyvisa-py's own session for such adapters.
#[test]
fn pyvisa_drives_our_simulated_adapter() {
    let name = "pyvisa_drives_our_simulated_adapter";
    let Some(python) = peer_python(name, &["pyvisa", "pyvisa_py"]) else { return };
    on_tcp(Adapter::new(8, picoammeter()), |port| {
        let adapter = format!("PRLGX-TCPIP::127.0.0.1::{port}::INTFC");
        let printed = run_python(&python, &host(false), &["GPIB0::8::INSTR", &adapter]);
        assert_eq!(printed, format!("{SAID}\n"));
    });
}

/// An ammeter on sinstruments: what it hears and says is that package's and this script's. It repeats its last reading at `FETC?`, and leaves one question unanswered.
const DEVICE: &str = r#"
import sys, gevent
from sinstruments.simulator import BaseDevice, Server
class Ammeter(BaseDevice):
    def __init__(self, name, **options):
        super().__init__(name, **options)
        self.count, self.errors, self.nplc, self.range, self.silent = 0, [], 1.0, None, 1
    def handle_message(self, line):
        said = line.decode().strip()
        header, _, value = said.partition(" ")
        answer = None
        if header == "*IDN?": answer = "KEITHLEY INSTRUMENTS INC.,MODEL 6487,7654321,B04"
        elif header == "SYST:ERR?": answer = self.errors.pop(0) if self.errors else '0,"No error"'
        elif header in ("SYST:ZCH", "FORM:ELEM"): pass
        elif header == "READ?":
            self.count += 1
            if self.count == 2 and self.silent:
                self.silent = 0
                return None
            answer = f"{self.count}.5E-6A,+1.0E+00,+0.0E+00"
        elif header == "FETC?": answer = f"{self.count}.5E-6A,+1.0E+00,+0.0E+00"
        elif header == "CURR:NPLC": self.nplc = float(value)
        elif header == "CURR:NPLC?": answer = f"{self.nplc}"
        elif header == "CURR:RANG:AUTO?": answer = "0" if self.range else "1"
        elif header == "CURR:RANG": self.errors.append('-221,"Settings conflict"')
        else: self.errors.append('-113,"Undefined header"')
        return None if answer is None else (answer + "\r\n").encode()
device = {"name": "ammeter", "class": "Ammeter", "package": "__main__", "transports": [
    {"type": "tcp", "url": "127.0.0.1:0"}, {"type": "serial", "url": sys.argv[1]}]}
server = Server(devices=[device])
tasks = server.start()
gevent.sleep(0.2)
tcp = server.devices["ammeter"].transports[0]
print(tcp.server_port, flush=True)
gevent.joinall(tasks)
"#;

struct Ammeter(Child);

impl Drop for Ammeter {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn ammeter(python: &std::path::Path, link: &str) -> (Ammeter, u16) {
    let mut device =
        Command::new(python).args(["-c", DEVICE, link]).stdout(Stdio::piped()).spawn().unwrap();
    let printed = device.stdout.take().unwrap();
    let device = Ammeter(device);
    let (sender, port) = mpsc::channel();
    std::thread::spawn(move || {
        let mut line = String::new();
        let _ = BufReader::new(printed).read_line(&mut line);
        let _ = sender.send(line);
    });
    let port = port.recv_timeout(std::time::Duration::from_secs(60)).unwrap();
    (device, port.trim().parse().unwrap())
}

/// Reads three times, the second of which is answered at the second try only, sets what that device takes, and what it does not. Truth: its own counter.
fn drive(meter: &mut dyn sunglint_drivers::device::Meter) {
    let within = crate::common::within;
    let identity = meter.identity(&within(20.0)).unwrap();
    assert_eq!((identity.model.as_str(), identity.serial.as_deref()), ("6487", Some("7654321")));
    for value in [1.5e-6, 3.5e-6, 4.5e-6] {
        assert_eq!(meter.read(&within(30.0)).unwrap(), Level::Value(value));
    }
    assert_eq!(meter.set_own("nplc", "5", &within(20.0)).unwrap(), Value::Number(5.0));
    match meter.set_own("range", "2nA", &within(20.0)).unwrap_err() {
        DeviceError::Complained { code, said, .. } => {
            assert_eq!((code, said.as_str()), (-221, "Settings conflict"));
        }
        other => panic!("{other}"),
    }
}

/// By TCP: after the answer that does not come, the connection is closed and opened. By the address that a user writes.
#[test]
fn the_driver_reads_a_device_on_sinstruments_by_tcp() {
    let name = "the_driver_reads_a_device_on_sinstruments_by_tcp";
    let Some(python) = peer_python(name, &["sinstruments"]) else { return };
    let folder = tempfile::tempdir().unwrap();
    let (_device, port) = ammeter(&python, folder.path().join("pty").to_str().unwrap());
    let options = ["device=keithley6485".to_owned()];
    let mut address = Address::parse(&format!("scpi:tcp:127.0.0.1:{port}"), &options).unwrap();
    let line = address.connect(&crate::common::within(10.0)).unwrap();
    let AnyDevice::Meter(mut meter) = address.open(line, &crate::common::within(20.0)).unwrap()
    else {
        panic!()
    };
    drive(meter.as_mut());
}

/// On that package's pty, where each reading is fetched a second time.
#[test]
fn the_driver_reads_a_device_on_sinstruments_on_a_pty() {
    let name = "the_driver_reads_a_device_on_sinstruments_on_a_pty";
    let Some(python) = peer_python(name, &["sinstruments"]) else { return };
    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("pty");
    let (_device, _) = ammeter(&python, link.to_str().unwrap());
    let about = template("keithley6485");
    let line = Serial::open(link.to_str().unwrap(), 9600).unwrap();
    let link = Link::stream(line, Cable::Unchecked, &about);
    let mut meter =
        ScpiMeter::open(link, about, &Told::default(), &crate::common::within(20.0)).unwrap();
    drive(&mut meter);
}
