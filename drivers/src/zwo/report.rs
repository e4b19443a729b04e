//! The wheel's feature reports of 16 bytes, the report's number first.

use crate::reply::ReplyError;

/// Bytes of a report.
pub const LENGTH: usize = 16;
/// Room to ask for: with less, or more, the wheel answers nonsense.
pub const ROOM: usize = 17;
/// The number of the reports to the wheel.
pub const TO_WHEEL: u8 = 3;
/// The number of the reports from the wheel.
pub const FROM_WHEEL: u8 = 1;

const MARK: [u8; 2] = [0x7e, 0x5a];
const KIND_INFO: u8 = 4;
const KIND_POSITION: u8 = 1;

/// A request to the wheel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Request {
    /// Who are you.
    Info,
    /// Where do you stand.
    Position,
    /// Turn to a slot, counted from 1.
    Move(u8),
}

impl Request {
    /// The report.
    pub fn emit(self) -> [u8; LENGTH] {
        let [a, b, c] = match self {
            Self::Info => [2, 4, 0],
            Self::Position => [2, 1, 0],
            Self::Move(slot) => [1, 2, slot],
        };
        let mut report = [0; LENGTH];
        report[..6].copy_from_slice(&[TO_WHEEL, MARK[0], MARK[1], a, b, c]);
        report
    }

    /// Reads a report; `None` if it is no request.
    pub fn parse(report: &[u8]) -> Option<Self> {
        let report: &[u8; LENGTH] = report.try_into().ok()?;
        let rest_is_zero = report[6..].iter().all(|byte| *byte == 0);
        if report[..3] != [TO_WHEEL, MARK[0], MARK[1]] || !rest_is_zero {
            return None;
        }
        match report[3..6] {
            [2, 4, 0] => Some(Self::Info),
            [2, 1, 0] => Some(Self::Position),
            [1, 2, slot] => Some(Self::Move(slot)),
            _ => None,
        }
    }
}

fn answer<'a>(
    report: &'a [u8],
    kind: u8,
    expected: &'static str,
) -> Result<&'a [u8; LENGTH], ReplyError> {
    let error = || ReplyError::new(&crate::recording::hex_excerpt(report), expected);
    let whole: &[u8; LENGTH] = report.try_into().map_err(|_| error())?;
    if whole[..4] == [FROM_WHEEL, MARK[0], MARK[1], kind] { Ok(whole) } else { Err(error()) }
}

/// Who the wheel says it is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Info {
    /// Three bytes that look like its firmware's version.
    pub version: [u8; 3],
    /// Name of the wheel (`EFW-S-0`).
    pub name: String,
}

impl Info {
    /// Reads the answer to [`Request::Info`].
    ///
    /// # Errors
    /// It is no such report.
    pub fn parse(report: &[u8]) -> Result<Self, ReplyError> {
        let expected = "16 bytes that begin with 01 7e 5a 04 and hold a name";
        let whole = answer(report, KIND_INFO, expected)?;
        let name = whole[8..].split(|byte| *byte == 0).next().unwrap_or_default();
        if name.is_empty() || !name.iter().all(u8::is_ascii_graphic) {
            return Err(ReplyError::new(&crate::recording::hex_excerpt(report), expected));
        }
        let name = String::from_utf8_lossy(name).into_owned();
        Ok(Self { version: [whole[4], whole[5], whole[6]], name })
    }

    /// The report, as the wheel sends it. A name of more than seven bytes is cut.
    pub fn emit(&self) -> [u8; LENGTH] {
        let mut report = [0; LENGTH];
        report[..4].copy_from_slice(&[FROM_WHEEL, MARK[0], MARK[1], KIND_INFO]);
        report[4..7].copy_from_slice(&self.version);
        for (place, byte) in report[8..LENGTH - 1].iter_mut().zip(self.name.bytes()) {
            *place = byte;
        }
        report
    }
}

/// How the wheel stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// It stands.
    Standing,
    /// It turns.
    Moving,
    /// It has given up; only cutting its power helps.
    Fault,
    /// A number that nobody has described.
    Other(u8),
}

impl From<u8> for State {
    fn from(number: u8) -> Self {
        match number {
            1 => Self::Standing,
            4 => Self::Moving,
            6 => Self::Fault,
            other => Self::Other(other),
        }
    }
}

impl From<State> for u8 {
    fn from(state: State) -> Self {
        match state {
            State::Standing => 1,
            State::Moving => 4,
            State::Fault => 6,
            State::Other(number) => number,
        }
    }
}

/// Where the wheel says it stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Position {
    /// How it stands.
    pub state: State,
    /// The wheel's error number, 0 for none.
    pub error: u8,
    /// Three slots from 1: two of which nobody has described the difference (the first is called the current one), and the
    /// target. When it has arrived, they agree.
    pub slots: [u8; 3],
    /// How many slots it has.
    pub count: u8,
}

impl Position {
    /// Reads the answer to [`Request::Position`]. The last six bytes are left over from other answers and are not looked at.
    ///
    /// # Errors
    /// It is no such report, or has no slots.
    pub fn parse(report: &[u8]) -> Result<Self, ReplyError> {
        let expected = "16 bytes that begin with 01 7e 5a 01, with slots from 1 to their number";
        let whole = answer(report, KIND_POSITION, expected)?;
        let [state, error, current, other, target, count] =
            [whole[4], whole[5], whole[6], whole[7], whole[8], whole[9]];
        let slots = [current, other, target];
        if count == 0 || slots.iter().any(|slot| *slot > count) {
            return Err(ReplyError::new(&crate::recording::hex_excerpt(report), expected));
        }
        Ok(Self { state: state.into(), error, slots, count })
    }

    /// The report, as the wheel sends it.
    pub fn emit(&self) -> [u8; LENGTH] {
        let mut report = [0; LENGTH];
        report[..4].copy_from_slice(&[FROM_WHEEL, MARK[0], MARK[1], KIND_POSITION]);
        report[4..6].copy_from_slice(&[self.state.into(), self.error]);
        report[6..9].copy_from_slice(&self.slots);
        report[9] = self.count;
        report[14] = 0x30;
        report
    }

    /// The slot in the beam, if it has arrived.
    pub fn arrived(&self) -> Option<u8> {
        let [current, other, target] = self.slots;
        let agree = current == other && other == target && current > 0;
        (self.state == State::Standing && self.error == 0 && agree).then_some(current)
    }

    /// Whether it has given up.
    pub fn has_failed(&self) -> bool {
        self.state == State::Fault || self.error != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(hex: &str) -> Vec<u8> {
        hex.split(' ').map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect()
    }

    /// Truth: the reports that Adam Fritzler captured with usbmon from a 7-slot wheel (comments of `zwoefw-set.c`).
    #[test]
    fn captured_reports_are_read_and_written() {
        let info = bytes("01 7e 5a 04 03 00 09 00 45 46 57 2d 53 2d 30 00");
        let read = Info::parse(&info).unwrap();
        assert_eq!((read.name.as_str(), read.version), ("EFW-S-0", [3, 0, 9]));
        assert_eq!(read.emit()[..], info);
        let captured = [
            ("01 7e 5a 01 04 00 03 02 03 07 00 00 00 00 30 00", State::Moving, 0, [3, 2, 3]),
            ("01 7e 5a 01 01 00 03 03 03 07 00 00 00 00 30 00", State::Standing, 0, [3, 3, 3]),
            ("01 7e 5a 01 06 0c 07 06 07 07 00 00 00 00 30 00", State::Fault, 12, [7, 6, 7]),
        ];
        for (hex, state, error, slots) in captured {
            let position = Position::parse(&bytes(hex)).unwrap();
            assert_eq!(position, Position { state, error, slots, count: 7 });
            assert_eq!(position.emit()[..], bytes(hex));
        }
        let to_wheel = [
            ("03 7e 5a 02 04 00 00 00 00 00 00 00 00 00 00 00", Request::Info),
            ("03 7e 5a 02 01 00 00 00 00 00 00 00 00 00 00 00", Request::Position),
            ("03 7e 5a 01 02 05 00 00 00 00 00 00 00 00 00 00", Request::Move(5)),
        ];
        for (hex, request) in to_wheel {
            assert_eq!(request.emit()[..], bytes(hex));
            assert_eq!(Request::parse(&bytes(hex)), Some(request));
        }
        let position = |hex| Position::parse(&bytes(hex)).unwrap();
        assert_eq!(position("01 7e 5a 01 01 00 03 03 03 07 00 00 00 00 30 00").arrived(), Some(3));
        assert!(Position::parse(&info).is_err() && Info::parse(&info[..15]).is_err());
        assert!(
            Position::parse(&bytes("01 7e 5a 01 01 00 08 08 08 07 00 00 00 00 30 00")).is_err()
        );
        assert!(
            Position::parse(&bytes("01 7e 5a 01 01 00 00 00 00 00 00 00 00 00 30 00")).is_err()
        );
    }
}
