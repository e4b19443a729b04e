//! Commands and replies of the ASCII protocol.
//!
//! `/1 1 07 move abs 5000:8D` → `@01 1 07 OK BUSY -- 0:F7`: device, axis, number, flag, state, the gravest warning, data, checksum.

use crate::reply::ReplyError;

/// The longest line, bytes, with its end.
pub const LONGEST_LINE: usize = 256;

/// The checksum of a message's text, between its first character and the colon: with it the bytes add up to 0 modulo 256.
pub fn checksum(text: &[u8]) -> u8 {
    text.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte)).wrapping_neg()
}

/// The bytes of a command with its number (0 to 99) and checksum.
pub fn command(device: u8, axis: u8, number: u8, text: &str) -> Vec<u8> {
    let space = if text.is_empty() { "" } else { " " };
    let body = format!("{device} {axis} {number:02}{space}{text}");
    format!("/{body}:{:02X}\n", checksum(body.as_bytes())).into_bytes()
}

/// A reply to a command.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reply {
    /// Device, 1 to 99.
    pub device: u8,
    /// Axis; 0 for the device as a whole.
    pub axis: u8,
    /// Number of the command, where it had one.
    pub number: Option<u8>,
    /// Whether the command was taken.
    pub taken: bool,
    /// Whether the axis moves.
    pub busy: bool,
    /// The gravest warning; `--` for none.
    pub warning: String,
    /// Data; the reason where the command was refused.
    pub data: String,
}

/// One line of a device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Line {
    /// A reply.
    Reply(Reply),
    /// An alert or a piece of information, which comes unasked.
    Unasked,
}

/// Whether two characters are the digits of a checksum.
fn digits(text: &[u8]) -> Option<u8> {
    let good = text.iter().all(u8::is_ascii_hexdigit) && text.len() == 2;
    let text = std::str::from_utf8(text).ok().filter(|_| good)?;
    u8::from_str_radix(text, 16).ok()
}

/// One line, and whether it had a checksum.
///
/// # Errors
/// Anything that the protocol does not know, and a checksum that is wrong.
pub fn parse(line: &[u8]) -> Result<(Line, bool), ReplyError> {
    let shown = String::from_utf8_lossy(line);
    let wrong = |expected| ReplyError::new(&shown, expected);
    let text = line.strip_suffix(b"\n").ok_or_else(|| wrong("a line with its end"))?;
    let text = text.strip_suffix(b"\r").unwrap_or(text);
    if !text.iter().all(|byte| (b' '..=b'~').contains(byte)) {
        return Err(wrong("a line of ASCII"));
    }
    let (first, mut body) = text.split_first().ok_or_else(|| wrong("`@`, `!` or `#`"))?;
    let mut checked = false;
    if let Some((before, after)) = body.split_last_chunk::<3>()
        && after[0] == b':'
        && let Some(sum) = digits(&after[1..])
    {
        if checksum(before) != sum {
            return Err(wrong("a line with its checksum"));
        }
        (body, checked) = (before, true);
    }
    match first {
        b'!' | b'#' => return Ok((Line::Unasked, checked)),
        b'@' => {}
        _ => return Err(wrong("`@`, `!` or `#`")),
    }
    let text = std::str::from_utf8(body).map_err(|_| wrong("a line of ASCII"))?;
    reply(text).map(|reply| (Line::Reply(reply), checked)).ok_or_else(|| wrong("a reply"))
}

fn reply(text: &str) -> Option<Reply> {
    let two = |text: &str| match text.len() == 2 && text.bytes().all(|b| b.is_ascii_digit()) {
        true => text.parse::<u8>().ok(),
        false => None,
    };
    let (device, rest) = text.split_once(' ')?;
    let (axis, rest) = rest.split_once(' ')?;
    let (word, after) = rest.split_once(' ')?;
    let (number, rest) = match two(word) {
        Some(number) => (Some(number), after),
        None => (None, rest),
    };
    let mut words = rest.splitn(4, ' ');
    let (flag, state, warning) = (words.next()?, words.next()?, words.next()?);
    let one_digit = axis.len() == 1 && axis.bytes().all(|b| b.is_ascii_digit());
    let good = warning.len() == 2 && warning.bytes().all(|b| b == b'-' || b.is_ascii_uppercase());
    Some(Reply {
        device: two(device)?,
        axis: axis.parse().ok().filter(|_| one_digit)?,
        number,
        taken: match flag {
            "OK" => true,
            "RJ" => false,
            _ => return None,
        },
        busy: match state {
            "BUSY" => true,
            "IDLE" => false,
            _ => return None,
        },
        warning: Some(warning.to_owned()).filter(|_| good)?,
        data: words.next()?.to_owned(),
    })
}

/// A list of warnings (`02 WR FS`): their number, and as many flags.
///
/// # Errors
/// Anything else.
pub fn warnings(data: &str) -> Result<Vec<String>, ReplyError> {
    let mut words = data.split(' ');
    let count: Option<usize> = words.next().and_then(|count| count.parse().ok());
    let flags: Vec<String> = words.map(str::to_owned).collect();
    let good = flags.iter().all(|f| f.len() == 2 && f.bytes().all(|b| b.is_ascii_uppercase()));
    match count == Some(flags.len()) && good {
        true => Ok(flags),
        false => Err(ReplyError::new(data, "a number of warnings and as many flags")),
    }
}

/// A fault in words, where the flag is one: they end a motion or keep it from beginning.
pub fn fault(flag: &str) -> Option<&'static str> {
    Some(match flag {
        "FD" => "the driver is disabled (overheated, or its supply is out of range)",
        "FF" => "critical system error",
        "FN" => "peripheral not supported",
        "FZ" => "inactive axis: is the stage plugged in?",
        "FH" => "device not homed, its last motion was interrupted",
        "FQ" => "encoder error: its position may be wrong",
        "FI" => "index error",
        "FO" => "phase not found",
        "FS" => "stalled and stopped: check for an obstacle and the load",
        "FT" => "excessive twist",
        "FB" => "stream bounds error",
        "FP" => "interpolated path deviation",
        "FE" => "limit error: it met a limit that it did not expect",
        "FR" => "overdrive limit exceeded",
        "FV" => "supply voltage out of range",
        "FW" => "temperature too high",
        other if other.starts_with('F') => "a fault that this program does not know",
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: bytes that zaber-motion 10.3.0 sent, and took.
    #[test]
    fn commands_are_those_of_the_makers_library() {
        for (device, axis, number, text, bytes) in [
            (1, 0, 0, "get deviceid", "/1 0 00 get deviceid:42\n"),
            (1, 1, 1, "home", "/1 1 01 home:34\n"),
            (1, 1, 2, "", "/1 1 02:FC\n"),
            (1, 1, 3, "move abs 12345", "/1 1 03 move abs 12345:AF\n"),
            (1, 1, 11, "get pos", "/1 1 11 get pos:2A\n"),
        ] {
            assert_eq!(command(device, axis, number, text), bytes.as_bytes());
        }
        let (line, checked) = parse(b"@01 1 05 OK IDLE -- 12345:38\r\n").unwrap();
        let reply = Reply {
            device: 1,
            axis: 1,
            number: Some(5),
            taken: true,
            busy: false,
            warning: "--".into(),
            data: "12345".into(),
        };
        assert_eq!((line, checked), (Line::Reply(reply), true));
    }

    #[test]
    fn other_lines_are_refused() {
        for wrong in [
            &b""[..],
            b"\r\n",
            b"@01 1 05 OK IDLE -- 12345:39\r\n",
            b"@01 1 05 OK IDLE -- 12345",
            b"@1 1 05 OK IDLE -- 0\r\n",
            b"@01 1 05 OK IDLE --\r\n",
            b"@01 1 05 YES IDLE -- 0\r\n",
            b"@01 1 05 OK WAIT -- 0\r\n",
            b"@01 1 05 OK IDLE -w 0\r\n",
            b"@01 11 05 OK IDLE -- 0\r\n",
            b"\x01@01 1 OK IDLE -- 0\r\n",
        ] {
            assert!(parse(wrong).is_err(), "{}", wrong.escape_ascii());
        }
        let (line, checked) = parse(b"@01 0 RJ IDLE WR BADCOMMAND\n").unwrap();
        assert!(matches!(line, Line::Reply(Reply { number: None, taken: false, .. })) && !checked);
        assert_eq!(parse(b"!01 1 IDLE --:96\r\n").map(|(line, _)| line), Ok(Line::Unasked));
        assert_eq!(parse(b"#01 0 hello\r\n"), Ok((Line::Unasked, false)));
        assert_eq!(warnings("02 WR FS"), Ok(vec!["WR".to_owned(), "FS".to_owned()]));
        assert_eq!(warnings("00"), Ok(Vec::new()));
        for wrong in ["", "01", "1 WR FS", "01 wr", "x"] {
            assert!(warnings(wrong).is_err(), "{wrong}");
        }
    }
}
