//! Lines in the requests of ZeroMQ: ZMTP 3.0 without security, as a socket of the kind REQ speaks it (ID Quantique's time controllers listen so).
//!
//! A connection begins with a greeting of 64 bytes and a command `READY`, both ways. A message is frames: flags, length, bytes. A request is an empty frame and a
//! frame with the line; its answer is an empty frame and a frame with the text. Every request is answered, commands too.

use super::reply::LONGEST_REPLY;
use super::way::Way;
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::reply::ReplyError;
use crate::transport::Bytes;
use crate::twice::Trouble;

/// Flag of a frame: another one of the same message follows.
const MORE: u8 = 1;
/// Flag: the length has 8 bytes.
const LONG: u8 = 2;
/// Flag: a command of the protocol.
const COMMAND: u8 = 4;
/// More commands of the protocol than anybody sends between a request and its answer.
const MOST_COMMANDS: usize = 16;
/// Beginning of the answer with which ID Quantique's controllers refuse a line.
const REFUSAL: &str = "SCPI_ERR_";

/// The greeting: signature, version 3.0, mechanism, no server.
fn greeting() -> [u8; 64] {
    let mut bytes = [0; 64];
    bytes[0] = 0xFF;
    bytes[9] = 0x7F;
    bytes[10] = 3;
    bytes[12..16].copy_from_slice(b"NULL");
    bytes
}

/// A frame's bytes.
fn frame(flags: u8, body: &[u8]) -> Vec<u8> {
    let mut bytes = match u8::try_from(body.len()) {
        Ok(short) => vec![flags, short],
        Err(_) => [&[flags | LONG][..], &(body.len() as u64).to_be_bytes()].concat(),
    };
    bytes.extend_from_slice(body);
    bytes
}

/// The command `READY` of a socket of the kind REQ.
fn ready() -> Vec<u8> {
    frame(COMMAND, b"\x05READY\x0bSocket-Type\x00\x00\x00\x03REQ\x08Identity\x00\x00\x00\x00")
}

/// Name of a command, and what follows.
fn command(body: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = body.split_first()?;
    rest.split_at_checked((*length).into())
}

/// A property of `READY`, by its name in small letters.
fn property(mut data: &[u8], name: &[u8]) -> Option<Vec<u8>> {
    while let Some((found, rest)) = command(data) {
        let (length, rest) = rest.split_first_chunk::<4>()?;
        let length = usize::try_from(u32::from_be_bytes(*length)).ok()?;
        let (value, rest) = rest.split_at_checked(length)?;
        if found.eq_ignore_ascii_case(name) {
            return Some(value.to_vec());
        }
        data = rest;
    }
    None
}

fn shown(bytes: &[u8]) -> String {
    let text: String = bytes.iter().copied().map(char::from).collect();
    ReplyError::new(&text, "").found
}

/// A frame that came.
struct Frame {
    flags: u8,
    body: Vec<u8>,
}

/// An instrument that takes lines as requests of ZeroMQ.
pub(super) struct Zmq<T> {
    device: &'static str,
    line: T,
    /// Whether something was said on this connection.
    used: bool,
    /// The answer to the last line.
    said: Option<Vec<u8>>,
}

impl<T: Bytes> Zmq<T> {
    pub fn new(device: &'static str, line: T) -> Self {
        Self { device, line, used: false, said: None }
    }

    fn wrong(&self, reason: String) -> Trouble {
        Trouble::Again(DeviceError::Protocol { device: self.device, reason })
    }

    /// The other end's frame number `number` of what is called `about`.
    fn frame(&mut self, about: &str, number: usize, step: &Deadline) -> Result<Frame, Trouble> {
        let mut flags = [0];
        self.line.receive_exact(&mut flags, step)?;
        let [flags] = flags;
        let place = format!("frame {number} of {about}");
        if flags & !(MORE | LONG | COMMAND) != 0 || flags & (MORE | COMMAND) == MORE | COMMAND {
            let reason = format!("{place}: found flags 0x{flags:02x}, expected 0 to 4, or 6");
            return Err(self.wrong(reason));
        }
        let length = match flags & LONG {
            0 => {
                let mut length = [0];
                self.line.receive_exact(&mut length, step)?;
                u64::from(length[0])
            }
            _ => {
                let mut length = [0; 8];
                self.line.receive_exact(&mut length, step)?;
                u64::from_be_bytes(length)
            }
        };
        let length = usize::try_from(length).ok().filter(|length| *length <= LONGEST_REPLY);
        let Some(length) = length else {
            let reason = format!("{place}: it is said to have more than {LONGEST_REPLY} bytes");
            return Err(self.wrong(reason));
        };
        let mut body = vec![0; length];
        self.line.receive_exact(&mut body, step)?;
        Ok(Frame { flags, body })
    }

    /// The other end's `ERROR`, which closes the connection.
    fn refused(&self, name: &[u8], data: &[u8]) -> Option<Trouble> {
        let reason = command(data).map_or(data, |(reason, _)| reason);
        (name == b"ERROR")
            .then(|| self.wrong(format!("its ZeroMQ refuses the connection: `{}`", shown(reason))))
    }

    fn shake_hands(&mut self, step: &Deadline) -> Result<(), Trouble> {
        self.used = true;
        self.line.send(&greeting(), step)?;
        let mut theirs = [0; 64];
        // In parts: who does not speak ZeroMQ says less.
        let (first, rest) = theirs.split_at_mut(1);
        self.line.receive_exact(first, step)?;
        if first != [0xFF] {
            return Err(self.wrong(format!(
                "its first byte is `{}`, no greeting of ZeroMQ: does it take plain lines (tcp:HOST:PORT)?",
                first.escape_ascii()
            )));
        }
        let (signature, rest) = rest.split_at_mut(10);
        self.line.receive_exact(signature, step)?;
        if let [.., mark, version] = signature
            && (*mark & 1 == 0 || *version < 3)
        {
            return Err(self.wrong(format!(
                "its greeting: found version {version}, expected ZMTP 3.0 (ZeroMQ 4.0) or later"
            )));
        }
        self.line.receive_exact(rest, step)?;
        let mechanism = rest.get(1..21).unwrap_or_default();
        if mechanism != greeting().get(12..32).unwrap_or_default() {
            let found = shown(mechanism.split(|byte| *byte == 0).next().unwrap_or_default());
            return Err(self.wrong(format!(
                "its greeting: found the security `{found}`, expected NULL (none)"
            )));
        }
        self.line.send(&ready(), step)?;
        let Frame { flags, body } = self.frame("its handshake", 1, step)?;
        let parts = command(&body).filter(|_| flags & COMMAND != 0);
        let Some((name, data)) = parts else {
            return Err(
                self.wrong(format!("its handshake: found `{}`, expected READY", shown(&body)))
            );
        };
        if let Some(trouble) = self.refused(name, data) {
            return Err(trouble);
        }
        let kind = property(data, b"socket-type").filter(|_| name == b"READY");
        match kind.as_deref() {
            Some(b"REP" | b"ROUTER") => Ok(()),
            Some(kind) => Err(self.wrong(format!(
                "its handshake: found a socket of the kind `{}`, expected REP or ROUTER",
                shown(kind)
            ))),
            None => {
                Err(self.wrong(format!("its handshake: found `{}`, expected READY", shown(&body))))
            }
        }
    }

    fn answer(&mut self, line: &str, step: &Deadline) -> Result<Vec<u8>, Trouble> {
        let about = format!("the answer to {line}");
        let mut parts = Vec::new();
        for number in 1..=MOST_COMMANDS {
            let Frame { flags, body } = self.frame(&about, number, step)?;
            if flags & COMMAND != 0 {
                let trouble = command(&body).and_then(|(name, data)| self.refused(name, data));
                if let Some(trouble) = trouble {
                    return Err(trouble);
                }
                continue;
            }
            // An empty one, and the text.
            let good = match parts.len() {
                0 => flags & MORE != 0 && body.is_empty(),
                _ => flags & MORE == 0,
            };
            if !good {
                return Err(self.wrong(format!(
                    "frame {number} of {about}: found {} bytes and {}, expected an empty frame and one with the text",
                    body.len(),
                    if flags & MORE != 0 { "more to follow" } else { "the end" }
                )));
            }
            parts.push(body);
            if parts.len() == 2 {
                return Ok(parts.pop().unwrap_or_default());
            }
        }
        Err(self.wrong(format!("{about}: {MOST_COMMANDS} frames and no text")))
    }
}

impl<T: Bytes> Way for Zmq<T> {
    fn say(&mut self, line: &str, step: &Deadline) -> Result<(), Trouble> {
        self.said = None;
        let request = [frame(MORE, &[]), frame(0, line.as_bytes())].concat();
        self.line.send(&request, step)?;
        let answer = self.answer(line, step)?;
        if let Ok(text) = std::str::from_utf8(&answer)
            && text.contains(REFUSAL)
        {
            let said = shown(text.trim().as_bytes());
            let request = line.to_owned();
            return Err(Trouble::Final(DeviceError::Rejected {
                device: self.device,
                request,
                said,
            }));
        }
        self.said = Some(answer);
        Ok(())
    }

    fn hear(&mut self, _: &Deadline) -> Result<Vec<u8>, Trouble> {
        // One request, one answer.
        self.said.take().ok_or_else(|| self.wrong("its answer was read already".into()))
    }

    /// A connection that something went wrong on is closed: a request that is not answered would block the next one.
    fn renew(&mut self, step: &Deadline) -> Result<(), Trouble> {
        self.said = None;
        if self.used {
            self.line.reconnect(step)?;
        }
        self.shake_hands(step)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the frames of ZMTP 3.0 (RFC 23), by hand.
    #[test]
    fn frames_and_commands_are_those_of_the_protocol() {
        assert_eq!(frame(MORE, b""), b"\x01\x00");
        assert_eq!(frame(0, b"*IDN?"), b"\x00\x05*IDN?");
        let long = frame(0, &[7; 256]);
        assert_eq!(long[..9], [2, 0, 0, 0, 0, 0, 0, 1, 0]);
        assert_eq!(long.len(), 265);
        assert_eq!(&ready()[..9], b"\x04\x26\x05READY\x0b");
        let (name, data) = command(&ready()[2..]).map(|(a, b)| (a.to_vec(), b.to_vec())).unwrap();
        assert_eq!(name, b"READY");
        assert_eq!(property(&data, b"socket-type"), Some(b"REQ".to_vec()));
        assert_eq!(property(&data, b"identity"), Some(Vec::new()));
        assert_eq!(property(&data, b"other"), None);
        for torn in 0..data.len() {
            let _ = property(&data[..torn], b"identity");
        }
        assert_eq!(property(b"\x01a\xff\xff\xff\xffb", b"a"), None);
        assert_eq!((command(b""), command(b"\x05ab")), (None, None));
    }
}
