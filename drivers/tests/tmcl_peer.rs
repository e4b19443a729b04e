//! TMCL against the vendor's own codec: pytrinamic 0.2.26.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use serialport::SerialPort as _;
use std::io::{BufRead as _, BufReader, Read as _};
use std::process::{Command as Program, Stdio};
use std::time::Duration;
use sunglint_drivers::clock::Cancel;
use sunglint_drivers::device::RotationStage as _;
use sunglint_drivers::simulated::serve;
use sunglint_drivers::simulated::tmcl::{Module, ModuleSettings};
use sunglint_drivers::transport::serial::Serial;
use sunglint_drivers::trinamic::tmcl::{Axis, Command, Frame, Reply, Request, Status};
use sunglint_drivers::trinamic::{LinkSettings, Search, Stage, StageSettings};
use sunglint_testkit::{peer_python, run_python};

/// Values at the ends of 32 bits, around 0, and a few in between.
const VALUES: [i32; 9] = [0, 1, -1, 12_800, -100, 71_111, i32::MAX, i32::MIN, 0x0456_0109];

fn bytes_of(hex: &str) -> Vec<u8> {
    (0..hex.len() / 2).map(|i| u8::from_str_radix(&hex[2 * i..2 * i + 2], 16).unwrap()).collect()
}

/// Truth: pytrinamic's `TMCLRequest` and `TMCLReply` make the same bytes as ours, for every command and status that we
/// know and for values to the ends of 32 bits; ours read theirs to the same fields.
#[test]
fn frames_agree_with_pytrinamic_both_ways() {
    let Some(python) = peer_python("frames_agree_with_pytrinamic_both_ways", &["pytrinamic"])
    else {
        return;
    };
    let script = r#"
from pytrinamic.tmcl import TMCLRequest, TMCLReply, TMCLCommand as C, TMCLStatus as S
import sys
values = [int(v) for v in sys.argv[1].split(",")]
for c in (C.ROR, C.MST, C.MVP, C.SAP, C.GAP, C.RFS, C.GET_FIRMWARE_VERSION):
    for v in values:
        print("request", c, v, TMCLRequest(1, c, 7, 2, v).to_buffer().hex())
for s in sorted(S.messages):
    for v in values:
        print("reply", s, v, TMCLReply(2, 1, s, C.GAP, v).to_buffer().hex())
for line in sys.argv[2].split(","):
    r = TMCLRequest.from_buffer(bytes.fromhex(line))
    signed = r.value - (1 << 32) if r.value >> 31 else r.value
    q = TMCLReply.from_buffer(bytes.fromhex(line))
    print("ours", r.moduleAddress, r.command, r.commandType, r.motorBank, signed, q.is_checksum_correct())
"#;
    let ours: Vec<Request> = VALUES
        .iter()
        .map(|value| Request {
            module: 3,
            command: Command::Move,
            kind: 1,
            motor: 2,
            value: *value,
        })
        .collect();
    let hex = |request: &Request| -> String {
        request.emit().bytes().iter().map(|byte| format!("{byte:02x}")).collect()
    };
    let values = VALUES.map(|value| value.to_string()).join(",");
    let lines = ours.iter().map(hex).collect::<Vec<_>>().join(",");
    let printed = run_python(&python, script, &[&values, &lines]);
    let (mut requests, mut replies, mut read) = (0, 0, 0);
    for line in printed.lines() {
        let words: Vec<&str> = line.split(' ').collect();
        match words[0] {
            "request" => {
                let (number, value) = (words[1].parse::<u8>().unwrap(), words[2].parse().unwrap());
                let theirs = bytes_of(words[3]);
                let command = Command::from(number);
                assert!(!matches!(command, Command::Other(_)), "command {number}");
                let request = Request { module: 1, command, kind: 7, motor: 2, value };
                assert_eq!(request.emit().bytes()[..], theirs, "{line}");
                assert_eq!(Request::parse(&Frame::new(&theirs).unwrap()), request);
                requests += 1;
            }
            "reply" => {
                let (number, value) = (words[1].parse::<u8>().unwrap(), words[2].parse().unwrap());
                let theirs = bytes_of(words[3]);
                let status = Status::from(number);
                assert!(!matches!(status, Status::Other(_)), "status {number} is known");
                let reply = Reply { host: 2, module: 1, status, command: Command::Get, value };
                assert_eq!(reply.emit().bytes()[..], theirs, "{line}");
                assert_eq!(Reply::parse(&Frame::new(&theirs).unwrap()), reply);
                replies += 1;
            }
            _ => {
                assert_eq!(line, format!("ours 3 4 1 2 {} True", VALUES[read]));
                read += 1;
            }
        }
    }
    assert_eq!((requests, replies, read), (7 * 9, 9 * 9, 9));
}

/// Truth: the class `AP` in pytrinamic's module files, by name.
#[test]
fn axis_parameters_are_pytrinamics() {
    let Some(python) = peer_python("axis_parameters_are_pytrinamics", &["pytrinamic"]) else {
        return;
    };
    let names = [
        ("TargetPosition", Axis::TargetPosition),
        ("ActualPosition", Axis::ActualPosition),
        ("ActualVelocity", Axis::ActualSpeed),
        ("MaxVelocity", Axis::MaxSpeed),
        ("MaxAcceleration", Axis::MaxAcceleration),
        ("MaxCurrent", Axis::MaxCurrent),
        ("StandbyCurrent", Axis::StandbyCurrent),
        ("PositionReachedFlag", Axis::PositionReached),
        ("RightEndstop", Axis::RightLimit),
        ("LeftEndstop", Axis::LeftLimit),
        ("RightLimitSwitchDisable", Axis::RightLimitDisabled),
        ("LeftLimitSwitchDisable", Axis::LeftLimitDisabled),
        ("MicrostepResolution", Axis::Microsteps),
        ("ReferenceSearchMode", Axis::SearchMode),
        ("ReferenceSearchSpeed", Axis::SearchSpeed),
        ("ReferenceSwitchSpeed", Axis::SwitchSpeed),
    ];
    assert_eq!(names.len(), Axis::ALL.len());
    let script = "
import sys
from pytrinamic.modules import TMCM1110, TMCM3110
for module in (TMCM1110, TMCM3110):
    ap = module._MotorTypeA.AP
    print(*[getattr(ap, name) for name in sys.argv[1].split(',')])
";
    let asked = names.map(|(name, _)| name).join(",");
    let ours = names.map(|(_, axis)| axis.number().to_string()).join(" ");
    assert_eq!(run_python(&python, script, &[&asked]), format!("{ours}\n{ours}\n"));
}

/// A module whose frames are made and read by pytrinamic alone; its motion is a few lines of Python. It turns, finds its
/// switch, and spoils every 7th reply's checksum.
const DEVICE: &str = r#"
import os, sys, time, tty
from pytrinamic.tmcl import TMCLRequest, TMCLReply, TMCLCommand as C, TMCLStatus as S
master, slave = os.openpty()
tty.setraw(slave)
print(os.ttyname(slave), flush=True)
speed, pos, target, zero, since, searching = 20000.0, 0.0, 0.0, 0, time.monotonic(), False
ap = {140: 6, 12: 0, 13: 0, 193: 0, 194: 0, 195: 0}
def turn():
    global pos, since, searching, target
    now = time.monotonic(); way = speed * (now - since); since = now
    goal = -3000.0 if searching else target
    pos = goal if abs(goal - pos) <= way else pos + way * (1 if goal > pos else -1)
    if searching and pos == goal:
        searching = False; pos = 0.0; target = 0.0
n = 0
data = b""
while True:
    try: data += os.read(master, 256)
    except OSError: break
    while len(data) >= 9:
        q = TMCLRequest.from_buffer(data[:9]); data = data[9:]
        turn()
        status, value = S.SUCCESS, 0
        signed = q.value - (1 << 32) if q.value >> 31 else q.value
        if q.checksum != (sum(q.to_buffer()[:-1]) & 0xff): status = S.WRONG_CHECKSUM
        elif q.command == C.GET_FIRMWARE_VERSION: value = 0x04560109
        elif q.command == C.MVP: target = float(signed); value = q.value
        elif q.command == C.MST: target = pos
        elif q.command == C.RFS:
            if q.commandType == 0: searching = True
            elif q.commandType == 1: searching = False
            value = int(searching)
        elif q.command == C.SAP and q.commandType in ap: ap[q.commandType] = signed
        elif q.command == C.GAP:
            at, there = int(pos), int(target)
            value = {0: there, 1: at, 3: 0 if pos == target else 1, 8: int(pos == target), 10: 0, 11: 0, **ap}.get(q.commandType)
            if value is None: status, value = S.WRONG_TYPE, 0
        else: status = S.INVALID_COMMAND
        reply = bytearray(TMCLReply(2, q.moduleAddress, status, q.command, value).to_buffer())
        n += 1
        if n % 7 == 0: reply[8] ^= 0x10
        os.write(master, bytes(reply))
print("end", int(pos), flush=True)
"#;

/// Our driver, through serialport and a real pty, against a device on the vendor's codec. Truth: the motor in that other
/// process; 200 full steps of 2^6 microsteps and a gear of 90: 3,200 microsteps a degree.
#[test]
fn the_driver_moves_a_device_on_pytrinamics_codec() {
    let name = "the_driver_moves_a_device_on_pytrinamics_codec";
    let Some(python) = peer_python(name, &["pytrinamic"]) else { return };
    let mut device = Program::new(python)
        .args(["-c", DEVICE])
        .stdout(Stdio::piped())
        .spawn()
        .expect("the device");
    let mut printed = BufReader::new(device.stdout.take().unwrap());
    let mut path = String::new();
    printed.read_line(&mut path).unwrap();
    let settings = StageSettings {
        gear: 90.0,
        poll: Duration::from_millis(20),
        search: Some(Search { mode: 1, speed: 300, switch_speed: 100, tolerance_deg: 0.1 }),
        ..StageSettings::default()
    };
    let line = Serial::open(path.trim(), 9600).unwrap();
    let mut stage =
        Stage::open(line, LinkSettings::default(), settings, &crate::common::within(20.0)).unwrap();
    assert_eq!(stage.microsteps_per_deg(), 3_200.0);
    assert_eq!(stage.home(&crate::common::within(20.0)).unwrap(), 0.0);
    assert_eq!(stage.move_to(2.5, &crate::common::within(20.0)).unwrap(), 2.5);
    assert_eq!(stage.move_to(-0.5, &crate::common::within(20.0)).unwrap(), -0.5);
    assert_eq!(stage.angle_deg(&crate::common::within(20.0)).unwrap(), -0.5);
    device.kill().unwrap();
    let gone = stage.angle_deg(&crate::common::within(20.0)).unwrap_err();
    assert!(gone.to_string().contains("is gone"), "{gone}");
    let mut rest = String::new();
    printed.read_to_string(&mut rest).unwrap();
    device.wait().unwrap();
}

/// The vendor's host drives our simulated module on a pty. Truth: pytrinamic's own checks of every reply.
#[test]
fn pytrinamics_host_moves_our_simulated_module() {
    let name = "pytrinamics_host_moves_our_simulated_module";
    let Some(python) = peer_python(name, &["pytrinamic"]) else { return };
    let (device, mut host) = serialport::TTYPort::pair().unwrap();
    // Kept open beside the script's, so that the device's end sees no hang-up before the script is there.
    host.set_exclusive(false).unwrap();
    let path = host.name().unwrap();
    let cancel = Cancel::new();
    let deadline = crate::common::within(60.0).with_cancel(&cancel);
    let mut device = Serial::from_port(Box::new(device));
    let module = Module::new(ModuleSettings {
        speed: 50_000,
        switches: [-9_000, 51_200],
        ..ModuleSettings::default()
    });
    let server = std::thread::spawn(move || serve(module, &mut device, &deadline).unwrap());
    let script = r#"
import os, sys, time, tty
from pytrinamic.connections.tmcl_interface import TmclInterface
from pytrinamic.tmcl import TMCLReplyChecksumError, TMCLReplyStatusError
from pytrinamic.modules import TMCM1110
class Line(TmclInterface):
    def __init__(self, path):
        super().__init__(); self.file = os.open(path, os.O_RDWR | os.O_NOCTTY)
    def _send(self, host, module, data): os.write(self.file, data)
    def _recv(self, host, module):
        data = b""
        while len(data) < 9: data += os.read(self.file, 9 - len(data))
        return data
    def _reply_check(self, reply):
        if not reply.is_checksum_correct(): raise TMCLReplyChecksumError(reply)
module = TMCM1110(Line(sys.argv[1]))
motor = module.motors[0]
module.move_to(0, -5000)
while not motor.get_position_reached(): time.sleep(0.01)
print(motor.actual_position, motor.get_axis_parameter(motor.AP.MicrostepResolution))
try: motor.set_axis_parameter(250, 1)
except TMCLReplyStatusError as error: print(error.status_code, error.error_description)
module.connection.reference_search(0, 0)
while module.connection.reference_search(2, 0): time.sleep(0.01)
print(motor.actual_position, motor.get_axis_parameter(motor.AP.LeftEndstop))
"#;
    let printed = run_python(&python, script, &[&path]);
    drop(host);
    assert_eq!(printed, "-5000 8\n3 Wrong Type\n0 1\n");
    cancel.cancel();
    assert_eq!(server.join().unwrap().motor(), -9_000);
}
