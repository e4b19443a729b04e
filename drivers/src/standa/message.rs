//! Commands and replies: `move`, steps and microsteps, checksum → `move`; `gets` → `gets`, 48 bytes, checksum. Numbers have their lowest byte first.

use crate::reply::ReplyError;

/// Letters of a command.
pub type Name = [u8; 4];

/// Bytes of the data in the reply to `gets`.
pub const STATUS: usize = 48;

/// The checksum over data: CRC-16 with the reflected polynomial 0x8005, begun with 0xFFFF.
pub fn checksum(data: &[u8]) -> u16 {
    data.iter().fold(0xFFFF, |sum, byte| {
        (0..8).fold(sum ^ u16::from(*byte), |sum, _| match sum & 1 {
            1 => (sum >> 1) ^ 0xA001,
            _ => sum >> 1,
        })
    })
}

/// The bytes of a command, or of a reply.
pub fn message(name: Name, data: &[u8]) -> Vec<u8> {
    let mut bytes = name.to_vec();
    if !data.is_empty() {
        bytes.extend_from_slice(data);
        bytes.extend_from_slice(&checksum(data).to_le_bytes());
    }
    bytes
}

/// The data of `move`: full steps and microsteps of the target, both of its sign.
pub fn target(steps: i32, microsteps: i16) -> [u8; 12] {
    let mut data = [0; 12];
    let [a, b, c, d] = steps.to_le_bytes();
    let [e, f] = microsteps.to_le_bytes();
    data[..6].copy_from_slice(&[a, b, c, d, e, f]);
    data
}

/// A reply's data, without their checksum.
///
/// # Errors
/// A checksum that is wrong, or bytes that have no room for one.
pub fn checked(bytes: &[u8]) -> Result<&[u8], ReplyError> {
    let split = bytes.split_last_chunk::<2>();
    let good = split.filter(|(data, sum)| u16::from_le_bytes(**sum) == checksum(data));
    good.map(|(data, _)| data).ok_or_else(|| shown(bytes, "data with their checksum"))
}

/// The error for bytes that should have been something else.
pub(super) fn shown(bytes: &[u8], expected: &'static str) -> ReplyError {
    let text: String = bytes.iter().copied().map(char::from).collect();
    ReplyError::new(&text, expected)
}

/// Reads numbers one after another.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn next<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (value, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*value)
    }

    fn byte(&mut self) -> Option<u8> {
        self.next::<1>().map(|[byte]| byte)
    }

    fn i32(&mut self) -> Option<i32> {
        self.next().map(i32::from_le_bytes)
    }

    fn i16(&mut self) -> Option<i16> {
        self.next().map(i16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.next().map(u32::from_le_bytes)
    }
}

/// State of a controller and its motor (`gets`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Status {
    /// Whether the motor turns, or is about to.
    pub turning: bool,
    /// Number of the last command of motion ([`HOME`] and others).
    pub command: u8,
    /// Whether that command has not ended yet.
    pub running: bool,
    /// Whether it ended with an error.
    pub failed: bool,
    /// Position, full steps; of a DC motor counts of its encoder.
    pub steps: i32,
    /// Microsteps beside them, of the same sign.
    pub microsteps: i16,
    /// Supply of the motor, V.
    pub supply_v: f64,
    /// Temperature of the controller, °C.
    pub temperature_c: f64,
    /// Flags of the controller ([`ALARM`], [`HOMED`] and others).
    pub flags: u32,
    /// Flags of its inputs ([`RIGHT`], [`LEFT`] and others).
    pub inputs: u32,
}

/// The command `home`, as a status numbers it.
pub const HOME: u8 = 6;
/// Flag: the position is tied to a switch or a mark, since the last `home`. Not every controller says it.
pub const HOMED: u32 = 0x20;
/// Flag: the stage has a memory with its name.
pub const NAMED: u32 = 0x10;
/// Flag: something dangerous happened. Commands of motion are ignored until `stop`.
pub const ALARM: u32 = 0x40;
/// Flag: steps and encoder do not agree.
pub const SLIPPED: u32 = 0x80;
/// Input: the right limit switch is pressed.
pub const RIGHT: u32 = 1;
/// Input: the left limit switch is pressed.
pub const LEFT: u32 = 2;

/// Dangers, by their flags.
const DANGERS: [(u32, &str); 15] = [
    (SLIPPED, "its steps and its encoder do not agree: check for an obstacle and the load"),
    (0x100, "its power stage is too hot"),
    (0x200, "it is too hot"),
    (0x400, "its supply voltage is too high"),
    (0x800, "its supply current is too high"),
    (0x1000, "the voltage of its USB is too high"),
    (0x2000, "the voltage of its USB is too low"),
    (0x4000, "the current of its USB is too high"),
    (0x8000, "it met the limit switch of the other side: are they swapped?"),
    (0x1_0000, "its supply voltage is too low"),
    (0x2_0000, "its power stage reports a fault"),
    (0x10_0000, "the windings of its motor differ in resistance"),
    (0x20_0000, "its encoder reports a fault"),
    (0x80_0000, "its motor does not respond"),
    (0x100_0000, "an input is set to raise an alarm"),
];

impl Status {
    /// Reads the data of a reply to `gets`.
    ///
    /// # Errors
    /// Data of another length.
    pub fn parse(data: &[u8]) -> Result<Self, ReplyError> {
        let wrong = || shown(data, "a status of 48 bytes");
        if data.len() != STATUS {
            return Err(wrong());
        }
        let mut reader = Reader(data);
        let mut read = || {
            let (motion, command) = (reader.byte()?, reader.byte()?);
            // Power, encoder, windings.
            let _ = reader.next::<3>()?;
            let (steps, microsteps) = (reader.i32()?, reader.i16()?);
            // The encoder, speed, and the motor's current.
            let _ = reader.next::<16>()?;
            let supply = reader.i16()?;
            // The current and the voltage of USB.
            let _ = reader.next::<4>()?;
            let temperature = reader.i16()?;
            Some(Self {
                turning: motion & 1 != 0,
                command: command & 0x3F,
                running: command & 0x80 != 0,
                failed: command & 0x40 != 0,
                steps,
                microsteps,
                supply_v: f64::from(supply) / 100.0,
                temperature_c: f64::from(temperature) / 10.0,
                flags: reader.u32()?,
                inputs: reader.u32()?,
            })
        };
        read().ok_or_else(wrong)
    }

    /// Whether it is at work.
    pub fn is_busy(&self) -> bool {
        self.turning || self.running
    }

    /// Trouble in words, where there is some.
    pub fn fault(&self) -> Option<String> {
        let dangers: Vec<&str> = DANGERS
            .iter()
            .filter(|(flag, _)| self.flags & flag != 0)
            .map(|(_, words)| *words)
            .collect();
        if self.flags & ALARM != 0 {
            return Some(match dangers.is_empty() {
                true => "alarm, without a reason".into(),
                false => format!("alarm: {}", dangers.join("; ")),
            });
        }
        if self.flags & SLIPPED != 0 {
            return DANGERS.first().map(|(_, words)| (*words).to_owned());
        }
        let failed = self.failed && !self.running;
        failed.then(|| format!("its last command (number {}) ended with an error", self.command))
    }
}

/// Counts of a motor, by its kind (`gent`) and the controller's settings of it (`geng`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Engine {
    /// Whether it is a stepper, whose position has microsteps.
    pub stepper: bool,
    /// Microsteps of a full step; 1 of another motor.
    pub microsteps: i32,
    /// Full steps of a turn of the motor.
    pub steps: u16,
}

impl Engine {
    /// Bytes of the data in the reply to `gent`, and to `geng`.
    pub const DATA: [usize; 2] = [8, 28];

    /// Reads both.
    ///
    /// # Errors
    /// A kind of motor or a division of a step that the protocol does not know.
    pub fn parse(kind: &[u8], settings: &[u8]) -> Result<Self, ReplyError> {
        let kind = match kind.first().copied() {
            Some(kind @ 0..=5) => kind,
            _ => return Err(shown(kind, "a kind of motor from 0 to 5")),
        };
        match settings.get(13..16) {
            Some(&[mode @ 1..=9, low, high]) => {
                let (stepper, steps) = (kind == 3, u16::from_le_bytes([low, high]));
                let microsteps = if stepper { 1 << (mode - 1) } else { 1 };
                Ok(Self { stepper, microsteps, steps })
            }
            // A motor without steps has no division.
            Some(&[_, low, high]) if kind != 3 => {
                let steps = u16::from_le_bytes([low, high]);
                Ok(Self { stepper: false, microsteps: 1, steps })
            }
            _ => Err(shown(settings, "a division of a step from 1 (full) to 9 (256)")),
        }
    }

    /// The counter of a position.
    ///
    /// # Errors
    /// One beyond 32 bits.
    pub fn counter(&self, steps: i32, microsteps: i16) -> Result<i32, ReplyError> {
        let beside = if self.stepper { i64::from(microsteps) } else { 0 };
        let counter = i64::from(steps) * i64::from(self.microsteps) + beside;
        let wrong = || ReplyError::new(&counter.to_string(), "a position of 32 bits in microsteps");
        i32::try_from(counter).map_err(|_| wrong())
    }

    /// Full steps and microsteps of a counter.
    pub fn split(&self, counter: i32) -> (i32, i16) {
        // A microstep is at most 1/256 of a step.
        (counter / self.microsteps, (counter % self.microsteps) as i16)
    }
}

/// Text of a fixed field: its printable characters.
pub(super) fn text(bytes: &[u8]) -> String {
    let kept = bytes.iter().take_while(|byte| **byte != 0).filter(|byte| byte.is_ascii_graphic());
    kept.map(|byte| char::from(*byte)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the check value of CRC-16/MODBUS, which has these parameters, in Greg Cook's catalogue; the bytes that pylablib 1.4.3
    /// sends for 1000 steps and 5 microsteps.
    #[test]
    fn checksums_and_commands_are_those_of_others() {
        assert_eq!(checksum(b"123456789"), 0x4B37);
        assert_eq!(message(*b"gets", &[]), b"gets");
        let bytes = message(*b"move", &target(1000, 5));
        assert_eq!(bytes, b"move\xe8\x03\x00\x00\x05\x00\x00\x00\x00\x00\x00\x00\xc8\x58");
        assert_eq!(checked(&bytes[4..]), Ok(&target(1000, 5)[..]));
        assert!(checked(&bytes[5..]).is_err() && checked(&[]).is_err() && checked(&[1]).is_err());
    }

    /// Truth: by construction: places of the fields as the maker's description has them.
    #[test]
    fn a_status_is_read_field_by_field() {
        let mut data = [0; STATUS];
        data[0] = 1;
        data[1] = 0x80 | HOME;
        data[5..9].copy_from_slice(&(-12_i32).to_le_bytes());
        data[9..11].copy_from_slice(&(-34_i16).to_le_bytes());
        data[27..29].copy_from_slice(&3605_i16.to_le_bytes());
        data[33..35].copy_from_slice(&251_i16.to_le_bytes());
        data[35..39].copy_from_slice(&(HOMED | NAMED).to_le_bytes());
        data[39..43].copy_from_slice(&LEFT.to_le_bytes());
        let status = Status::parse(&data).unwrap();
        let expected = Status {
            turning: true,
            command: HOME,
            running: true,
            failed: false,
            steps: -12,
            microsteps: -34,
            supply_v: 36.05,
            temperature_c: 25.1,
            flags: 0x30,
            inputs: 2,
        };
        assert_eq!(status, expected);
        assert!(status.is_busy() && status.fault().is_none());
        assert!(Status::parse(&data[1..]).is_err());
        let trouble = |flags, failed, running| Status { flags, failed, running, ..status }.fault();
        assert!(trouble(ALARM | 0x100, false, false).unwrap().contains("alarm: its power stage"));
        assert!(trouble(ALARM, false, false).unwrap().contains("without a reason"));
        assert!(trouble(SLIPPED, false, false).unwrap().contains("do not agree"));
        // A supply by network or RS-232 leaves USB without a voltage: no danger as long as nothing is stopped by it.
        assert_eq!(trouble(0x2000, false, false), None);
        assert!(trouble(0, true, false).unwrap().contains("ended with an error"));
        assert_eq!(trouble(0, true, true), None);
    }

    /// Truth: by construction.
    #[test]
    fn counts_are_microsteps_and_back() {
        let mut settings = [0; 28];
        settings[13] = 9;
        settings[14] = 200;
        let engine = Engine::parse(&[3; 8], &settings).unwrap();
        assert_eq!(engine, Engine { stepper: true, microsteps: 256, steps: 200 });
        for counter in [0, 1, -1, 255, 256, -257, i32::MAX, i32::MIN] {
            let (steps, microsteps) = engine.split(counter);
            assert_eq!(engine.counter(steps, microsteps), Ok(counter));
            assert!(i64::from(steps) * i64::from(microsteps) >= 0, "both of one sign");
        }
        assert!(engine.counter(i32::MAX, 0).is_err());
        let dc = Engine::parse(&[1], &settings).unwrap();
        assert_eq!((dc.microsteps, dc.counter(7, 99)), (1, Ok(7)));
        for (kind, mode) in [(3, 0), (3, 10), (6, 9)] {
            settings[13] = mode;
            assert!(Engine::parse(&[kind], &settings).is_err());
        }
        assert!(Engine::parse(&[], &settings).is_err() && Engine::parse(&[3], &[0; 15]).is_err());
    }
}
