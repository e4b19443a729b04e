//! APT messages against another codec: thorlabs-apt-protocol 29.0.0.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use serialport::SerialPort as _;
use std::io::{BufRead as _, BufReader, Read as _};
use std::process::{Command, Stdio};
use std::time::Duration;
use sunglint_drivers::clock::Cancel;
use sunglint_drivers::device::{Device as _, RotationStage as _};
use sunglint_drivers::simulated::apt::{Apt, AptSettings};
use sunglint_drivers::simulated::{Speaker as _, serve};
use sunglint_drivers::thorlabs::apt::message::{HOST, Id, Message, State, StateBits, parse};
use sunglint_drivers::thorlabs::apt::{LinkSettings, Stage, StageSettings};
use sunglint_drivers::transport::serial::Serial;
use sunglint_testkit::{peer_python, run_python};

const VALUES: [i32; 6] = [0, 1, -1, 96_000, i32::MAX, i32::MIN];

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn bytes_of(hex: &str) -> Vec<u8> {
    (0..hex.len() / 2).map(|i| u8::from_str_radix(&hex[2 * i..2 * i + 2], 16).unwrap()).collect()
}

/// Truth: that package makes the same bytes for all that the driver sends, to a device and to a bay of a rack.
#[test]
fn what_we_send_is_what_it_makes() {
    let name = "what_we_send_is_what_it_makes";
    let Some(python) = peer_python(name, &["thorlabs_apt_protocol"]) else { return };
    let script = "
import sys, thorlabs_apt_protocol as apt
for dest in (0x50, 0x21):
    a = dict(dest=dest, source=1)
    c = dict(a, chan_ident=1)
    for m in (apt.hw_disconnect(**a), apt.hw_req_info(**a), apt.hw_stop_updatemsgs(**a), apt.hw_no_flash_programming(**a),
              apt.mod_set_chanenablestate(enable_state=1, **c), apt.mod_req_chanenablestate(**c), apt.mot_req_velparams(**c),
              apt.mot_req_homeparams(**c), apt.mot_move_home(**c), apt.mot_move_stop(stop_mode=1, **c),
              apt.mot_req_statusupdate(**c), apt.mot_req_dcstatusupdate(**c), apt.mot_ack_dcstatusupdate(**a)):
        print(m.hex())
    for v in sys.argv[1].split(','):
        print(apt.mot_move_absolute(position=int(v), **c).hex())
";
    let values = VALUES.map(|value| value.to_string()).join(",");
    let mut ours = String::new();
    for to in [0x50, 0x21] {
        for (id, first, second) in [
            (Id::Disconnect, 0, 0),
            (Id::RequestInfo, 0, 0),
            (Id::StopUpdates, 0, 0),
            (Id::NoFlashProgramming, 0, 0),
            (Id::SetEnabled, 1, 1),
            (Id::RequestEnabled, 1, 0),
            (Id::RequestSpeeds, 1, 0),
            (Id::RequestHoming, 1, 0),
            (Id::Home, 1, 0),
            (Id::StopMove, 1, 1),
            (Id::RequestStatus, 1, 0),
            (Id::RequestServoStatus, 1, 0),
            (Id::Alive, 0, 0),
        ] {
            ours += &format!("{}\n", hex(&Message::short(id, first, second, to, HOST).emit()));
        }
        for value in VALUES {
            let mut data = vec![1, 0];
            data.extend(value.to_le_bytes());
            ours += &format!("{}\n", hex(&Message::long(Id::MoveAbsolute, &data, to, HOST).emit()));
        }
    }
    assert_eq!(run_python(&python, script, &[&values]), ours);
    for line in ours.lines() {
        let bytes = bytes_of(line);
        let to = bytes[4] & 0x7f;
        let (message, taken) = parse(&bytes, to).unwrap().unwrap();
        assert_eq!((taken, message.emit()), (bytes.len(), bytes));
    }
}

/// Truth: that package's reading of what our simulated stage says, field by field.
#[test]
fn what_our_stage_says_is_what_it_reads() {
    let name = "what_our_stage_says_is_what_it_reads";
    let Some(python) = peer_python(name, &["thorlabs_apt_protocol"]) else { return };
    let mut said = Vec::new();
    let mut read = String::new();
    for servo in [false, true] {
        let settings = AptSettings {
            servo,
            limits: Some([-3_000_000, 300_000]),
            model: "KDC101".into(),
            ..AptSettings::default()
        };
        let mut apt = Apt::new(settings);
        let status = if servo { Id::RequestServoStatus } else { Id::RequestStatus };
        let mut go = vec![1, 0];
        go.extend(400_000_i32.to_le_bytes());
        let steps = [
            (0, Message::short(Id::RequestInfo, 0, 0, 0x50, HOST)),
            (0, Message::short(Id::RequestEnabled, 1, 0, 0x50, HOST)),
            (0, Message::short(Id::RequestHoming, 1, 0, 0x50, HOST)),
            (0, Message::short(Id::RequestSpeeds, 1, 0, 0x50, HOST)),
            (0, Message::short(status, 1, 0, 0x50, HOST)),
            (1, Message::short(Id::Home, 1, 0, 0x50, HOST)),
            (2, Message::short(status, 1, 0, 0x50, HOST)),
            (9_000, Message::short(status, 1, 0, 0x50, HOST)),
            (9_001, Message::long(Id::MoveAbsolute, &go, 0x50, HOST)),
            (9_002, Message::short(Id::StopMove, 1, 1, 0x50, HOST)),
            (9_003, Message::short(status, 1, 0, 0x50, HOST)),
        ];
        for (ms, message) in steps {
            for (_, bytes) in apt.hear(&message.emit(), Duration::from_millis(ms)) {
                let (message, _) = parse(&bytes, HOST).unwrap().unwrap();
                if let Some(State { counter, bits }) = State::of(&message) {
                    let flags = [
                        StateBits::FORWARD_LIMIT,
                        StateBits::REVERSE_LIMIT,
                        0x10,
                        StateBits::HOMING,
                        StateBits::HOMED,
                        StateBits::ENABLED,
                    ];
                    let flags = flags.map(|bit| u8::from(bits.any(bit)).to_string()).join(" ");
                    read += &format!("{counter} {flags}\n");
                }
                said.push(hex(&bytes));
            }
        }
    }
    let script = "
import sys, thorlabs_apt_protocol as apt
u = apt.Unpacker(on_error='raise')
for line in sys.argv[1].split(','):
    u.feed(bytes.fromhex(line))
    m = next(u)
    if m.msg in ('mot_get_statusupdate', 'mot_get_dcstatusupdate'):
        print(m.position, *map(int, (m.forward_limit_switch, m.reverse_limit_switch, m.moving_forward, m.homing, m.homed, m.channel_enabled)))
    elif m.msg == 'hw_get_info':
        assert (m.serial_number, m.model_number.rstrip(b'\\0'), m.nchs) == (55123456, b'KDC101', 1), m
        assert tuple(m.firmware_version) == (1, 2, 3), m
    else:
        assert m.msg in ('mod_get_chanenablestate', 'mot_get_homeparams', 'mot_get_velparams', 'mot_move_homed', 'mot_move_stopped'), m
";
    assert_eq!(run_python(&python, script, &[&said.join(",")]), read);
    assert!(read.contains("0 0 0 0 0 1 1"), "homed, at zero:\n{read}");
}

/// A stage whose messages are made by that package alone; what it hears is read by `struct`. It turns, homes, and sends
/// messages that nobody asked for.
const DEVICE: &str = r#"
import os, struct, sys, time, tty
import thorlabs_apt_protocol.functions as f
master, slave = os.openpty()
tty.setraw(slave)
print(os.ttyname(slave), flush=True)
speed, pos, target, zero, since, homing, homed = 3e6, 700000.0, 700000.0, 0.0, time.monotonic(), False, False
def turn():
    global pos, since, homing, homed, target, zero
    now = time.monotonic(); way = speed * (now - since); since = now
    pos = target if abs(target - pos) <= way else pos + way * (1 if target > pos else -1)
    if homing and pos == target:
        homing, homed, zero, pos, target = False, True, 0.0, 0.0, 0.0
        os.write(master, f._pack(0x0444, 1, 0x50, param1=1))
def state():
    moving = pos != target
    return struct.pack("<HllL", 1, int(pos), 0, (0x30 if moving else 0) | homing << 9 | homed << 10 | 1 << 31)
data = b""
while True:
    try: data += os.read(master, 256)
    except OSError: break
    while len(data) >= 6:
        number, length, dest, source = struct.unpack("<HHBB", data[:6])
        size = 6 + (length if dest & 0x80 else 0)
        if len(data) < size: break
        body, first, second, data = data[6:size], data[2], data[3], data[size:]
        turn()
        if number == 0x05: os.write(master, f._pack(0x06, 1, 0x50, data=struct.pack("<l8sH4B60sHHH", 55000001, b"K10CR1\0\0", 16, 9, 1, 2, 0, b"", 1, 1, 1)))
        elif number == 0x0211: os.write(master, f._pack(0x0212, 1, 0x50, param1=1, param2=1))
        elif number == 0x0443: homing, homed, target = True, False, 0.0
        elif number == 0x0453: target = float(struct.unpack("<Hl", body)[1])
        elif number == 0x0465: target = pos; os.write(master, f._pack(0x0466, 1, 0x50, data=state()))
        elif number == 0x0480:
            os.write(master, f._pack(0x0464, 1, 0x50, data=state()))
            os.write(master, f._pack(0x0481, 1, 0x50, data=state()))
print("end", flush=True)
"#;

/// Our driver, through serialport and a real pty, against a device on that codec. Truth: the motor in that other process;
/// 409,600 microsteps are 3°.
#[test]
fn the_driver_moves_a_device_on_that_codec() {
    let name = "the_driver_moves_a_device_on_that_codec";
    let Some(python) = peer_python(name, &["thorlabs_apt_protocol"]) else { return };
    let mut device = Command::new(python)
        .args(["-c", DEVICE])
        .stdout(Stdio::piped())
        .spawn()
        .expect("the device");
    let mut printed = BufReader::new(device.stdout.take().unwrap());
    let mut path = String::new();
    printed.read_line(&mut path).unwrap();
    let settings = StageSettings { poll: Duration::from_millis(20), ..StageSettings::default() };
    let line = Serial::open(path.trim(), 115_200).unwrap();
    let mut stage =
        Stage::open(line, LinkSettings::default(), settings, &crate::common::within(20.0)).unwrap();
    let identity = stage.identity(&crate::common::within(5.0)).unwrap();
    assert_eq!(
        (identity.serial.unwrap().as_str(), identity.firmware.unwrap().as_str()),
        ("55000001", "2.1.9")
    );
    assert_eq!(stage.home(&crate::common::within(20.0)).unwrap(), 0.0);
    // 3° are 409,600 microsteps; 1e-9 is for the order of two divisions, here and below.
    assert!((stage.move_to(3.0, &crate::common::within(20.0)).unwrap() - 3.0).abs() < 1e-9);
    let half = stage.move_to(-0.5, &crate::common::within(20.0)).unwrap();
    // -68,266.67 microsteps, rounded.
    assert!((half + 68_267.0 * 3.0 / 409_600.0).abs() < 1e-12, "{half}");
    device.kill().unwrap();
    let gone = stage.angle_deg(&crate::common::within(20.0)).unwrap_err();
    assert!(gone.to_string().contains("is gone"), "{gone}");
    let mut rest = String::new();
    printed.read_to_string(&mut rest).unwrap();
    device.wait().unwrap();
}

/// pylablib's Kinesis host homes, moves and stops our simulated stages through a real pty. It lifts RTS when it opens a port,
/// which a pty refuses: the script takes that out of pyserial. Truth: pylablib's own reading of the messages; the stage's own
/// place. pylablib does not know the K10CR2 and takes counts there.
#[test]
fn pylablibs_kinesis_moves_our_simulated_stages() {
    let name = "pylablibs_kinesis_moves_our_simulated_stages";
    let Some(python) = peer_python(name, &["pylablib"]) else { return };
    let script = r#"
import os, sys, time, types, warnings, serial, pylablib.devices
warnings.simplefilter("ignore")
# The package's own __init__ loads cameras, which need numba.
folder = os.path.join(os.path.dirname(pylablib.devices.__file__), "Thorlabs")
sys.modules["pylablib.devices.Thorlabs"] = package = types.ModuleType("pylablib.devices.Thorlabs")
package.__path__ = [folder]
serial.Serial._update_rts_state = serial.Serial._update_dtr_state = lambda self: None
from pylablib.devices.Thorlabs.kinesis import KinesisMotor
port, scale, target = sys.argv[1], sys.argv[2], float(sys.argv[3])
stage = KinesisMotor(("serial", port), scale=scale)
info = stage.get_device_info()
print(info.serial_no, info.model_no, info.fw_ver, info.nchannels, stage.get_scale_units())
print(stage.is_homed(), stage.get_position(scale=False))
stage.home(timeout=20.)
print(stage.is_homed(), stage.get_position(scale=False), sorted(stage.get_status()))
stage.move_to(target)
stage.wait_move(timeout=20.)
print(round(stage.get_position(), 4), stage.get_position(scale=False))
stage.move_to(-target * 100)
# On a busy machine the stage may hear both in one piece, and stop before it moved.
end = time.monotonic() + 20
while stage.get_position() >= target and time.monotonic() < end:
    pass
stage.stop(immediate=True, timeout=20.)
print(stage.is_moving(), -target * 100 < stage.get_position() < target)
stage.close()
"#;
    for (model, scale, target, expected) in [
        (
            "K10CR1",
            "stage",
            "12",
            "55123456 K10CR1 1.2.3 1 deg\nFalse 0\nTrue 0 ['enabled', 'homed']\n12.0 1638400\nFalse True\n",
        ),
        (
            "K10CR2",
            "step",
            "1638400",
            "55123456 K10CR2 1.2.3 1 internal\nFalse 0\nTrue 0 ['enabled', 'homed']\n1638400 1638400\nFalse True\n",
        ),
        (
            "KBD101",
            "DDR100",
            "45",
            "55123456 KBD101 1.2.3 1 deg\nFalse 0\nTrue 0 ['enabled', 'homed']\n45.0 409600\nFalse True\n",
        ),
    ] {
        let (device, mut host) = serialport::TTYPort::pair().unwrap();
        // Kept open beside the script's, so that the device's end sees no hang-up before the script is there.
        host.set_exclusive(false).unwrap();
        let path = host.name().unwrap();
        let cancel = Cancel::new();
        let deadline = crate::common::within(60.0).with_cancel(&cancel);
        let mut device = Serial::from_port(Box::new(device));
        let settings = AptSettings {
            model: model.into(),
            servo: model == "KBD101",
            speed: 4_000_000,
            reference: -400_000,
            ..AptSettings::default()
        };
        let server =
            std::thread::spawn(move || serve(Apt::new(settings), &mut device, &deadline).unwrap());
        let printed = run_python(&python, script, &[&path, scale, target]);
        drop(host);
        cancel.cancel();
        let stage = server.join().unwrap();
        assert_eq!(printed, expected, "{model}");
        assert!(stage.is_standing(), "{model}");
    }
}
