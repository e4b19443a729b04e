//! TMCL's frames: nine bytes each way, the value big-endian, the last byte the sum of the others.
//!
//! A request is address, command, type, motor, value (4 bytes), sum; a reply is host, module, status, command, value, sum.
//!
//! # Sources
//! Frame layout, command numbers, status codes and their meanings: pytrinamic 0.2.26 (`tmcl.py`). Axis parameters 0, 1, 3,
//! 4, 5, 6, 7, 8, 10–13, 140, 193–195: the class `AP` of pytrinamic's `modules/TMCM1110.py` (the same numbers in its
//! TMCM1140 and TMCM3110). The reference search's kinds 0, 1, 2: pytrinamic's `reference_search`; that status 0 says "no
//! search is active": Trinamic, PD-1021 TMCL firmware manual V1.19, section 3.5.13. Module number and version in the value
//! of command 136, kind 1: Trinamic, TMCM-1310 TMCL firmware manual V1.11, section 6.8.39 (older modules leave the module
//! number at 0: TMCM-6110 manual V1.19, section 5.6.39). None of these has been seen on a real module.

use std::fmt;

/// Bytes of a frame.
pub const LENGTH: usize = 9;

/// Commands that the driver uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Command {
    /// Rotate right: not used by the driver, known to the simulated module.
    RotateRight,
    /// Stop a motor.
    Stop,
    /// Move to a position (kind 0: absolute).
    Move,
    /// Set an axis parameter.
    Set,
    /// Get an axis parameter.
    Get,
    /// Reference search (kind 0 start, 1 stop, 2 is it running?).
    Search,
    /// Module number and firmware version (kind 1: in the value).
    Version,
    /// Any other.
    Other(u8),
}

impl Command {
    /// Returns the number in the TMCL protocol.
    pub fn number(self) -> u8 {
        match self {
            Self::RotateRight => 1,
            Self::Stop => 3,
            Self::Move => 4,
            Self::Set => 5,
            Self::Get => 6,
            Self::Search => 13,
            Self::Version => 136,
            Self::Other(number) => number,
        }
    }
}

impl From<u8> for Command {
    fn from(number: u8) -> Self {
        [
            Self::RotateRight,
            Self::Stop,
            Self::Move,
            Self::Set,
            Self::Get,
            Self::Search,
            Self::Version,
        ]
        .into_iter()
        .find(|command| command.number() == number)
        .unwrap_or(Self::Other(number))
    }
}

/// Axis parameters that the driver uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Axis {
    /// Where to go, microsteps.
    TargetPosition = 0,
    /// Where it is, microsteps.
    ActualPosition = 1,
    /// How fast it turns now, in the module's own unit; 0 is standstill.
    ActualSpeed = 3,
    /// The speed of moves, in the module's own unit.
    MaxSpeed = 4,
    /// The acceleration of moves, in the module's own unit.
    MaxAcceleration = 5,
    /// The motor's current while it moves, in the module's own unit.
    MaxCurrent = 6,
    /// The motor's current while it stands, in the module's own unit.
    StandbyCurrent = 7,
    /// 1 once the position is the target.
    PositionReached = 8,
    /// 1 while the right limit switch is pressed.
    RightLimit = 10,
    /// 1 while the left limit switch is pressed.
    LeftLimit = 11,
    /// 1 if the right limit switch does not stop the motor.
    RightLimitDisabled = 12,
    /// 1 if the left limit switch does not stop the motor.
    LeftLimitDisabled = 13,
    /// A full step has 2 to this power microsteps.
    Microsteps = 140,
    /// How the reference is searched.
    SearchMode = 193,
    /// The speed of the search, in the module's own unit.
    SearchSpeed = 194,
    /// The speed at the switch, in the module's own unit.
    SwitchSpeed = 195,
}

impl Axis {
    /// All of them.
    pub const ALL: [Self; 16] = [
        Self::TargetPosition,
        Self::ActualPosition,
        Self::ActualSpeed,
        Self::MaxSpeed,
        Self::MaxAcceleration,
        Self::MaxCurrent,
        Self::StandbyCurrent,
        Self::PositionReached,
        Self::RightLimit,
        Self::LeftLimit,
        Self::RightLimitDisabled,
        Self::LeftLimitDisabled,
        Self::Microsteps,
        Self::SearchMode,
        Self::SearchSpeed,
        Self::SwitchSpeed,
    ];

    /// Returns the number in the TMCL protocol.
    pub fn number(self) -> u8 {
        self as u8
    }
}

/// Status of a request, as a module reports it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// 100: done.
    Success,
    /// 101: put into the module's program memory, which the driver never asks for.
    Loaded,
    /// 1: the request's sum was wrong.
    WrongChecksum,
    /// 2: no such command.
    InvalidCommand,
    /// 3: no such kind or parameter.
    WrongType,
    /// 4: no such value.
    InvalidValue,
    /// 5: the memory is locked.
    EepromLocked,
    /// 6: this module cannot do it.
    NotAvailable,
    /// 9: beyond the maximum.
    MaximumExceeded,
    /// Any other.
    Other(u8),
}

impl Status {
    /// Returns the number in the TMCL protocol.
    pub fn number(self) -> u8 {
        match self {
            Self::Success => 100,
            Self::Loaded => 101,
            Self::WrongChecksum => 1,
            Self::InvalidCommand => 2,
            Self::WrongType => 3,
            Self::InvalidValue => 4,
            Self::EepromLocked => 5,
            Self::NotAvailable => 6,
            Self::MaximumExceeded => 9,
            Self::Other(number) => number,
        }
    }

    /// Returns the meaning of the status in words.
    pub fn meaning(self) -> &'static str {
        match self {
            Self::Success => "done",
            Self::Loaded => "put into the program memory instead of carried out",
            Self::WrongChecksum => "the checksum of the request was wrong",
            Self::InvalidCommand => "the module has no such command",
            Self::WrongType => "the module has no such parameter",
            Self::InvalidValue => "the module does not take this value",
            Self::EepromLocked => "the module's memory is locked",
            Self::NotAvailable => "the command is not available on this module",
            Self::MaximumExceeded => "the value is beyond the module's maximum",
            Self::Other(_) => "a status that TMCL does not name",
        }
    }
}

impl From<u8> for Status {
    fn from(number: u8) -> Self {
        [
            Self::Success,
            Self::Loaded,
            Self::WrongChecksum,
            Self::InvalidCommand,
            Self::WrongType,
            Self::InvalidValue,
            Self::EepromLocked,
            Self::NotAvailable,
            Self::MaximumExceeded,
        ]
        .into_iter()
        .find(|status| status.number() == number)
        .unwrap_or(Self::Other(number))
    }
}

/// Why bytes are no frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// Not nine bytes.
    #[error("{found} bytes, a frame has 9")]
    Length {
        /// How many there are.
        found: usize,
    },
    /// The last byte is not the sum of the others.
    #[error("checksum {found:02x}, the other bytes sum to {sum:02x}")]
    Checksum {
        /// The last byte.
        found: u8,
        /// Checksum that was expected: the sum of the other bytes.
        sum: u8,
    },
}

fn sum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
}

/// Nine bytes whose sum is right, not yet interpreted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame([u8; LENGTH]);

impl Frame {
    /// Checks length and sum; what passes can be read in full.
    ///
    /// # Errors
    /// Not nine bytes, or the sum is wrong.
    pub fn new(bytes: &[u8]) -> Result<Self, FrameError> {
        let frame: [u8; LENGTH] =
            bytes.try_into().map_err(|_| FrameError::Length { found: bytes.len() })?;
        let [body @ .., found] = &frame;
        match sum(body) {
            sum if sum == *found => Ok(Self(frame)),
            sum => Err(FrameError::Checksum { found: *found, sum }),
        }
    }

    fn from_fields(head: [u8; 4], value: i32) -> Self {
        let [a, b, c, d] = head;
        let [e, f, g, h] = value.to_be_bytes();
        Self([a, b, c, d, e, f, g, h, sum(&[a, b, c, d, e, f, g, h])])
    }

    /// The bytes as they go over the line.
    pub fn bytes(&self) -> &[u8; LENGTH] {
        &self.0
    }

    /// The four bytes in front of the value.
    pub fn head(&self) -> [u8; 4] {
        let [a, b, c, d, ..] = self.0;
        [a, b, c, d]
    }

    /// The value.
    pub fn value(&self) -> i32 {
        let [_, _, _, _, e, f, g, h, _] = self.0;
        i32::from_be_bytes([e, f, g, h])
    }
}

/// Request of the host.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Request {
    /// The module's address.
    pub module: u8,
    /// The command.
    pub command: Command,
    /// Kind of the command, or the parameter's number.
    pub kind: u8,
    /// The motor, or the bank.
    pub motor: u8,
    /// The value.
    pub value: i32,
}

impl Request {
    /// The request in a frame.
    pub fn parse(frame: &Frame) -> Self {
        let [module, command, kind, motor] = frame.head();
        Self { module, command: command.into(), kind, motor, value: frame.value() }
    }

    /// The frame of the request.
    pub fn emit(&self) -> Frame {
        let head = [self.module, self.command.number(), self.kind, self.motor];
        Frame::from_fields(head, self.value)
    }
}

impl fmt::Display for Request {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { kind, motor, value, .. } = self;
        match self.command {
            Command::Stop => write!(f, "stop of motor {motor}"),
            Command::Move => write!(f, "move of motor {motor} to {value}"),
            Command::Set => write!(f, "axis parameter {kind} of motor {motor} = {value}"),
            Command::Get => write!(f, "axis parameter {kind} of motor {motor}"),
            Command::Search => write!(f, "reference search (kind {kind}) of motor {motor}"),
            Command::Version => write!(f, "firmware version"),
            other => write!(f, "command {} (kind {kind}, motor {motor})", other.number()),
        }
    }
}

/// Reply of the module.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reply {
    /// The host's address.
    pub host: u8,
    /// The module's address.
    pub module: u8,
    /// Status of the request.
    pub status: Status,
    /// The request's command.
    pub command: Command,
    /// The value.
    pub value: i32,
}

impl Reply {
    /// The reply in a frame.
    pub fn parse(frame: &Frame) -> Self {
        let [host, module, status, command] = frame.head();
        Self { host, module, status: status.into(), command: command.into(), value: frame.value() }
    }

    /// The frame of the reply.
    pub fn emit(&self) -> Frame {
        let head = [self.host, self.module, self.status.number(), self.command.number()];
        Frame::from_fields(head, self.value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the frames that pytrinamic 0.2.26 makes (`tests/tmcl_peer.rs` asks it itself, where it is installed).
    #[test]
    fn frames_are_the_vendors() {
        let of = |command, kind, value| {
            *Request { module: 1, command, kind, motor: 0, value }.emit().bytes()
        };
        assert_eq!(of(Command::Move, 0, 12_800), [1, 4, 0, 0, 0, 0, 0x32, 0, 0x37]);
        assert_eq!(of(Command::Move, 1, -100), [1, 4, 1, 0, 0xff, 0xff, 0xff, 0x9c, 0x9f]);
        assert_eq!(of(Command::Stop, 0, 0), [1, 3, 0, 0, 0, 0, 0, 0, 4]);
        assert_eq!(of(Command::Get, 8, 0), [1, 6, 8, 0, 0, 0, 0, 0, 0x0f]);
        assert_eq!(of(Command::Version, 1, 0), [1, 0x88, 1, 0, 0, 0, 0, 0, 0x8a]);
    }

    /// Truth: arithmetic. A flipped bit changes a sum modulo 256 by a power of two, so no single one goes unseen.
    #[test]
    fn every_flipped_bit_is_seen() {
        let frame =
            Request { module: 1, command: Command::Move, kind: 0, motor: 0, value: -7 }.emit();
        for bit in 0..LENGTH * 8 {
            let mut bytes = *frame.bytes();
            bytes[bit / 8] ^= 1 << (bit % 8);
            assert!(matches!(Frame::new(&bytes), Err(FrameError::Checksum { .. })), "bit {bit}");
        }
    }
}
