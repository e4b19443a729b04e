//! Our simulated Thorlabs meter under a host that we did not write: python-usbtmc 0.8, whose endpoints are pipes to it.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Command, Stdio};
use std::time::Duration;
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::simulated::Steady;
use sunglint_drivers::simulated::pm100::{Kind, Pm100, Pm100Settings};
use sunglint_drivers::simulated::script::{Fault, Script};
use sunglint_drivers::transport::{Transfer, Transfers as _};
use sunglint_drivers::usbtmc::{MessageIn, message_out, request_in};
use sunglint_testkit::{peer_python, run_python};

const HOST: &str = r#"
import array, sys
import usb.core
from usbtmc import Instrument
def ask(*words):
    print(*words, flush=True)
    answer = sys.stdin.readline().split()
    if answer[0] == "error": raise usb.core.USBError("no answer", errno=5)
    return array.array("B", bytes.fromhex(answer[1] if len(answer) > 1 else ""))
class Device:
    def ctrl_transfer(self, kind, request, value, index, length, timeout=None):
        return ask("control", kind, request, value, index, length)
class Interface: index = 0
class Out:
    def write(self, data, timeout=None): ask("out", bytes(data).hex())
    def clear_halt(self): ask("halt", 2)
class In:
    def read(self, length, timeout=None): return ask("in", length)
meter = Instrument(Device())
meter.iface, meter.bulk_out_ep, meter.bulk_in_ep, meter.connected = Interface(), Out(), In(), True
# Closing would ask for more of libusb.
meter.close = lambda: None
said = []
meter.clear()
said.append(meter.ask("*IDN?"))
meter.write("SENS:CORR:WAV 808")
said.append(meter.ask("SYST:ERR?"))
said.append(float(meter.ask("SENS:CORR:WAV?")))
said.append(float(meter.ask("MEAS:POW?")))
try: meter.ask("SYST:SENS:IDN?")
except usb.core.USBError: said.append("lost")
meter.clear()
said.append(meter.ask("SYST:SENS:IDN?"))
meter.write("NONSENSE")
said.append(meter.ask("SYST:ERR?"))
print("said", said, flush=True)
"#;

fn bytes_of(hex: &str) -> Vec<u8> {
    (0..hex.len() / 2).map(|i| u8::from_str_radix(&hex[2 * i..2 * i + 2], 16).unwrap()).collect()
}

/// Returns the request that a line of the host stands for.
fn transfer(line: &str) -> Transfer {
    let words: Vec<&str> = line.split(' ').collect();
    let number = |i: usize| words[i].parse::<u16>().unwrap();
    match words[0] {
        "out" => Transfer::BulkOut { endpoint: 2, data: bytes_of(words[1]) },
        "in" => Transfer::BulkIn { endpoint: 0x82, length: words[1].parse().unwrap() },
        "halt" => Transfer::ClearHalt { endpoint: 2 },
        "control" => Transfer::ControlIn {
            request_type: number(1) as u8,
            request: number(2) as u8,
            value: number(3),
            index: number(4),
            length: number(5),
        },
        other => panic!("{other}"),
    }
}

/// Truth: what python-usbtmc makes of the answers, beside what was put into the meter: 1.3 mW, the wavelength that it set,
/// a sensor whose first answer stays away until python-usbtmc clears the meter, and SCPI's number for an unknown command.
#[test]
fn python_usbtmc_reads_and_sets_our_simulated_meter() {
    let name = "python_usbtmc_reads_and_sets_our_simulated_meter";
    let Some(python) = peer_python(name, &["usbtmc"]) else { return };
    let mut host = Command::new(python)
        .args(["-c", HOST])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut meter =
        Pm100::new(Pm100Settings { clearing: 1, ..Pm100Settings::default() }, Steady(1.3e-3));
    meter.faults = Script::new(vec![Fault::new("SYST:SENS:IDN?", 1, Kind::Silence)]);
    let mut answers = host.stdin.take().unwrap();
    let mut said = String::new();
    for line in BufReader::new(host.stdout.take().unwrap()).lines() {
        let line = line.unwrap();
        if line.starts_with("said ") {
            said = line;
            break;
        }
        let deadline = Deadline::within(Duration::from_millis(300));
        match meter.transfer(&transfer(&line), &deadline) {
            Ok(bytes) => {
                let hex: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
                writeln!(answers, "ok {hex}").unwrap();
            }
            Err(_) => writeln!(answers, "error").unwrap(),
        }
    }
    drop(answers);
    assert!(host.wait().unwrap().success());
    assert_eq!(
        said,
        r#"said ['Thorlabs,PM100D,P0000001,2.6.0', '0,"No error"', 808.0, 0.0013, 'lost', 'S120C,180101101,24-Jan-2018,1,18,289', '-113,"Undefined header"']"#
    );
    assert_eq!(meter.wavelength_nm(), 808.0);
}

/// Truth: python-usbtmc's own codec: headers to the device byte for byte, tags from 255 to 1, messages from it field by field.
#[test]
fn messages_agree_with_python_usbtmc() {
    let Some(python) = peer_python("messages_agree_with_python_usbtmc", &["usbtmc"]) else {
        return;
    };
    let script = r#"
from usbtmc import Instrument
meter = Instrument(object())
for i in range(256):
    meter.last_btag = (i - 1) % 255
    print(meter.pack_dev_dep_msg_out_header(i, True).hex(), end=" ")
    meter.last_btag = (i - 1) % 255
    print(meter.pack_dev_dep_msg_in_header(i * 257).hex())
print(*meter.unpack_dev_dep_resp_header(bytes.fromhex("0207f80003000000010000003130"+"0a00"))[:5])
"#;
    let printed = run_python(&python, script, &[]);
    let lines: Vec<&str> = printed.lines().collect();
    for (i, line) in lines[..256].iter().enumerate() {
        let tag = if i == 0 { 255 } else { u8::try_from(i).unwrap() };
        let (out, request) = line.split_once(' ').unwrap();
        assert_eq!(message_out(tag, &vec![0; i])[..12], bytes_of(out), "{i}");
        assert_eq!(request_in(tag, i as u32 * 257), bytes_of(request), "{i}");
    }
    assert_eq!(lines[256], "2 7 248 3 1");
    let message = [2, 7, 0xf8, 0, 3, 0, 0, 0, 1, 0, 0, 0, b'1', b'0', b'\n', 0];
    let message = MessageIn::parse(&message, 7).unwrap();
    assert_eq!((message.payload.len(), message.end), (3, true));
}
