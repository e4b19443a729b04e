//! APT messages: a header of 6 bytes, little-endian, and data of up to 255 bytes behind some of them.
//!
//! | bytes | without data | with data |
//! |---|---|---|
//! | 0–1 | number | number |
//! | 2 | first parameter | length of the data, u16 |
//! | 3 | second parameter | |
//! | 4 | destination | destination, bit 7 set |
//! | 5 | source | source |

use std::fmt;

/// Bytes of a header.
pub const HEADER: usize = 6;
/// The longest data, bytes (the protocol: "currently no data packet exceeds 255 bytes").
pub const MOST_DATA: usize = 255;
/// The computer's address.
pub const HOST: u8 = 0x01;

macro_rules! numbers {
    ($($(#[$doc:meta])* $name:ident = $number:literal, $length:expr;)*) => {
        /// The messages that the driver knows.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        #[repr(u16)]
        pub enum Id {
            $($(#[$doc])* $name = $number,)*
        }

        impl Id {
            /// All of them.
            pub const ALL: &'static [Self] = &[$(Self::$name,)*];

            /// The message with this number.
            pub fn from_number(number: u16) -> Option<Self> {
                match number {
                    $($number => Some(Self::$name),)*
                    _ => None,
                }
            }

            /// The lengths of data that it may have: `0` for none.
            pub fn lengths(self) -> &'static [usize] {
                match self {
                    $(Self::$name => $length,)*
                }
            }
        }
    };
}

numbers! {
    /// The host goes.
    Disconnect = 0x0002, &[0];
    /// Who are you?
    RequestInfo = 0x0005, &[0];
    /// Serial number, model, firmware.
    Info = 0x0006, &[84];
    /// Stops messages that come by themselves ten times a second.
    StopUpdates = 0x0012, &[0];
    /// The first message of a host.
    NoFlashProgramming = 0x0018, &[0];
    /// Something is wrong (no details).
    Response = 0x0080, &[0];
    /// Something is wrong: the message's number, a code, words.
    RichResponse = 0x0081, &[68];
    /// Switches a channel on (1) or off (2).
    SetEnabled = 0x0210, &[0];
    /// Is the channel on?
    RequestEnabled = 0x0211, &[0];
    /// 1 on, 2 off.
    Enabled = 0x0212, &[0];
    /// Asks for the counter alone.
    RequestCounter = 0x0411, &[0];
    /// Channel, counter.
    Counter = 0x0412, &[6];
    /// Asks for speeds.
    RequestSpeeds = 0x0414, &[0];
    /// Channel, least speed, acceleration, greatest speed.
    Speeds = 0x0415, &[14];
    /// Asks for the status bits alone.
    RequestStatusBits = 0x0429, &[0];
    /// Channel, status bits.
    StatusBits = 0x042a, &[6];
    /// Asks how the reference is searched.
    RequestHoming = 0x0441, &[0];
    /// Channel, direction, switch, speed, offset.
    Homing = 0x0442, &[14];
    /// Searches the reference.
    Home = 0x0443, &[0];
    /// The reference was found.
    Homed = 0x0444, &[0];
    /// Moves to a counter's value.
    MoveAbsolute = 0x0453, &[6];
    /// A move ended; with the state of a stepper (14) or a servo (14), or without.
    MoveCompleted = 0x0464, &[0, 14];
    /// Stops: 1 at once, 2 with the profile.
    StopMove = 0x0465, &[0];
    /// It was stopped.
    MoveStopped = 0x0466, &[0, 14];
    /// Asks for the state of a stepper.
    RequestStatus = 0x0480, &[0];
    /// Channel, counter, encoder, state.
    Status = 0x0481, &[14];
    /// Asks for the state of a servo.
    RequestServoStatus = 0x0490, &[0];
    /// Channel, counter, speed, nothing, state.
    ServoStatus = 0x0491, &[14];
    /// The host is alive: after 50 messages about states without it a controller falls silent.
    Alive = 0x0492, &[0];
}

/// Payload of a message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Body {
    /// Two parameters.
    Short(u8, u8),
    /// Data.
    Long(Vec<u8>),
}

/// One message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// Which.
    pub id: Id,
    /// To whom.
    pub destination: u8,
    /// From whom.
    pub source: u8,
    /// Payload of the message.
    pub body: Body,
}

/// Bytes that are no message.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{} is no APT message to {whom:02x}", crate::recording::hex_excerpt(header))]
pub struct NoMessage {
    /// Where a header should be.
    pub header: [u8; HEADER],
    /// To whom it should go.
    pub whom: u8,
}

impl Message {
    /// A message without data.
    pub fn short(id: Id, first: u8, second: u8, destination: u8, source: u8) -> Self {
        Self { id, destination, source, body: Body::Short(first, second) }
    }

    /// A message with data, at most [`MOST_DATA`] bytes; what is longer is not sent.
    pub fn long(id: Id, data: &[u8], destination: u8, source: u8) -> Self {
        let data = data.get(..data.len().min(MOST_DATA)).unwrap_or_default().to_vec();
        Self { id, destination, source, body: Body::Long(data) }
    }

    /// The bytes on the line.
    pub fn emit(&self) -> Vec<u8> {
        let number = (self.id as u16).to_le_bytes();
        match &self.body {
            Body::Short(first, second) => {
                vec![number[0], number[1], *first, *second, self.destination & 0x7f, self.source]
            }
            Body::Long(data) => {
                // At most 255 (see `long`).
                let length = data.len() as u8;
                let mut bytes =
                    vec![number[0], number[1], length, 0, self.destination | 0x80, self.source];
                bytes.extend_from_slice(data);
                bytes
            }
        }
    }

    /// The data; empty for a message without.
    pub fn data(&self) -> &[u8] {
        match &self.body {
            Body::Short(..) => &[],
            Body::Long(data) => data,
        }
    }

    /// The channel that it is about, where it names one.
    pub fn channel(&self) -> u16 {
        match &self.body {
            Body::Short(first, _) => (*first).into(),
            Body::Long(data) => data.first_chunk().map_or(0, |word| u16::from_le_bytes(*word)),
        }
    }

    /// The signed 32-bit number at a place of the data.
    pub fn long_at(&self, at: usize) -> Option<i32> {
        let word = self.data().get(at..)?.first_chunk()?;
        Some(i32::from_le_bytes(*word))
    }
}

impl fmt::Display for Message {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?} (0x{:04x})", self.id, self.id as u16)
    }
}

/// The first message of bytes to `whom`, and how many bytes it takes; `None` if more have to come.
///
/// # Errors
/// [`NoMessage`] for bytes that cannot be a message: another number, length, destination or source.
pub fn parse(bytes: &[u8], whom: u8) -> Result<Option<(Message, usize)>, NoMessage> {
    let Some(header) = bytes.first_chunk::<HEADER>() else { return Ok(None) };
    let wrong = || NoMessage { header: *header, whom };
    let id = Id::from_number(u16::from_le_bytes([header[0], header[1]])).ok_or_else(wrong)?;
    let is_long = header[4] & 0x80 != 0;
    let (destination, source) = (header[4] & 0x7f, header[5]);
    // Motherboard, bays, or a device of its own; or the host.
    let known = |who: u8| matches!(who, 0x01 | 0x11 | 0x21..=0x2a | 0x50);
    if destination != whom || !known(source) {
        return Err(wrong());
    }
    let length = u16::from_le_bytes([header[2], header[3]]);
    let length = if is_long { usize::from(length) } else { 0 };
    if !id.lengths().contains(&length) || (is_long && length == 0) {
        return Err(wrong());
    }
    let Some(data) = bytes.get(HEADER..HEADER + length) else { return Ok(None) };
    let body = match is_long {
        true => Body::Long(data.to_vec()),
        false => Body::Short(header[2], header[3]),
    };
    Ok(Some((Message { id, destination, source, body }, HEADER + length)))
}

/// Bits of a stage's state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StateBits(pub u32);

impl StateBits {
    /// The forward limit switch is pressed.
    pub const FORWARD_LIMIT: u32 = 1;
    /// The reverse limit switch is pressed.
    pub const REVERSE_LIMIT: u32 = 1 << 1;
    /// It moves: forward, in reverse, jogging either way.
    pub const MOVING: u32 = 0xf0;
    /// It searches the reference.
    pub const HOMING: u32 = 1 << 9;
    /// The reference was found since it was switched on.
    pub const HOMED: u32 = 1 << 10;
    /// The motor does not follow.
    pub const MOTION_ERROR: u32 = 1 << 14;
    /// The channel is on.
    pub const ENABLED: u32 = 1 << 31;

    /// Whether one of these bits is set.
    pub fn any(self, bits: u32) -> bool {
        self.0 & bits != 0
    }

    /// Whether it moves or searches.
    pub fn is_moving(self) -> bool {
        self.any(Self::MOVING | Self::HOMING)
    }
}

/// Where a stage is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct State {
    /// The counter.
    pub counter: i32,
    /// Status bits of the stage: what it does.
    pub bits: StateBits,
}

impl State {
    /// The state in a message about it.
    pub fn of(message: &Message) -> Option<Self> {
        if !matches!(message.id, Id::Status | Id::ServoStatus) {
            return None;
        }
        let bits = StateBits(message.long_at(10)?.cast_unsigned());
        Some(Self { counter: message.long_at(2)?, bits })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: bytes of thorlabs-apt-protocol 29.0.0.
    #[test]
    fn bytes_are_those_of_another_codec() {
        let home = Message::short(Id::Home, 1, 0, 0x50, HOST);
        assert_eq!(home.emit(), [0x43, 0x04, 0x01, 0x00, 0x50, 0x01]);
        let stop = Message::short(Id::StopMove, 1, 2, 0x50, HOST);
        assert_eq!(stop.emit(), [0x65, 0x04, 0x01, 0x02, 0x50, 0x01]);
        let mut data = vec![1, 0];
        data.extend(96_000_i32.to_le_bytes());
        let go = Message::long(Id::MoveAbsolute, &data, 0x50, HOST);
        assert_eq!(go.emit(), [0x53, 4, 6, 0, 0xd0, 1, 1, 0, 0, 0x77, 1, 0]);
    }

    #[test]
    fn what_is_no_message_is_refused() {
        let status = [0x81, 4, 14, 0, 0x81, 0x50, 1, 0, 1, 2, 3, 4, 0, 0, 0, 0, 0, 4, 0, 0x80];
        for end in 0..status.len() {
            assert_eq!(parse(&status[..end], HOST), Ok(None), "{end} bytes");
        }
        let (message, taken) = parse(&status, HOST).unwrap().unwrap();
        assert_eq!((taken, message.emit().as_slice()), (20, status.as_slice()));
        let state = State::of(&message).unwrap();
        assert_eq!(state.counter, 0x0403_0201);
        assert!(state.bits.any(StateBits::HOMED) && state.bits.any(StateBits::ENABLED));
        assert!(!state.bits.is_moving());
        for (at, value) in [(0, 0x83), (2, 13), (3, 1), (4, 0x82), (4, 1), (5, 0x13)] {
            let mut wrong = status;
            wrong[at] = value;
            let error = parse(&wrong, HOST).unwrap_err().to_string();
            assert!(error.contains("is no APT message to 01"), "{error}");
        }
    }
}
