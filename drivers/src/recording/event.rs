//! Events in the lines of a recording, and how they are written.

use super::{LONGEST_PAUSE_US, MOST_DATA};
use crate::transport::Transfer;
use std::fmt;
use std::time::Duration;
use sunglint_formats::EncodeError;

/// Who spoke, and whether it was real.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Header {
    /// The device: vendor, model, whatever tells it apart.
    pub device: String,
    /// Where the device's bytes come from: `hardware`, or the program and its version.
    pub source: String,
    /// The program that spoke to it.
    pub host: Option<String>,
    /// When, in UTC.
    pub recorded: Option<String>,
    /// Whether the bytes were made up by us. `false` only for bytes of a real device or of software that is not ours.
    pub synthetic: bool,
}

impl Header {
    /// The header's lines.
    pub(crate) fn to_text(&self) -> Result<String, EncodeError> {
        let mut text = String::new();
        let host = self.host.as_deref();
        let recorded = self.recorded.as_deref();
        for (key, value) in [
            ("device", Some(self.device.as_str())),
            ("source", Some(self.source.as_str())),
            ("host", host),
            ("recorded", recorded),
            ("synthetic", Some(if self.synthetic { "yes" } else { "no" })),
        ] {
            let Some(value) = value else { continue };
            if value.is_empty() || value.trim() != value || value.chars().any(char::is_control) {
                let expected = "one line of text without space around it";
                return Err(EncodeError::new(key, format!("{value:?}"), expected));
            }
            text.push_str(&format!("# {key}={value}\n"));
        }
        Ok(text)
    }
}

/// Fault in the conversation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// The host waited in vain.
    Timeout,
    /// The device went away.
    Disconnect,
    /// The device refused a USB request.
    Stall,
}

impl Fault {
    /// The word in a recording.
    pub fn name(self) -> &'static str {
        match self {
            Self::Timeout => "timeout",
            Self::Disconnect => "disconnect",
            Self::Stall => "stall",
        }
    }
}

/// One line of a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Event {
    /// The host sent bytes on a stream.
    Sent(Vec<u8>),
    /// The host made a request, with what it sent.
    Asked(Transfer),
    /// The device sent bytes.
    Received(Vec<u8>),
    /// Time passed before the next event; whole microseconds, at most a day.
    Pause(Duration),
    /// Something went wrong.
    Fault(Fault),
}

impl Event {
    /// Whether the format can hold it.
    pub(crate) fn check(&self) -> Result<(), EncodeError> {
        let data = match self {
            Self::Sent(data) if data.is_empty() => {
                return Err(EncodeError::new("sent", "no bytes", "at least one byte"));
            }
            Self::Pause(time) => {
                let whole =
                    Duration::from_micros(u64::try_from(time.as_micros()).unwrap_or(u64::MAX));
                if whole != *time || *time > Duration::from_micros(LONGEST_PAUSE_US) {
                    let expected = "whole microseconds, at most a day";
                    return Err(EncodeError::new("pause", format!("{time:?}"), expected));
                }
                return Ok(());
            }
            Self::Fault(_) => return Ok(()),
            Self::Sent(data) | Self::Received(data) => data.len(),
            Self::Asked(transfer) => {
                transfer.data().map_or(0, <[u8]>::len).max(transfer.room().unwrap_or(0))
            }
        };
        if data > MOST_DATA {
            let found = format!("{data} bytes");
            return Err(EncodeError::new("data", found, format!("at most {MOST_DATA} bytes")));
        }
        Ok(())
    }
}

impl fmt::Display for Event {
    /// The line, without its end.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sent(data) => write_data(f, ">", data),
            Self::Received(data) => write_data(f, "<", data),
            Self::Asked(transfer) => {
                write!(f, "> [{transfer}]")?;
                write_data(f, "", transfer.data().unwrap_or(&[]))
            }
            Self::Pause(time) => {
                let us = time.as_micros();
                write!(f, "~ {}", us / 1000)?;
                match us % 1000 {
                    0 => Ok(()),
                    part => write!(f, ".{}", format!("{part:03}").trim_end_matches('0')),
                }
            }
            Self::Fault(fault) => write!(f, "! {}", fault.name()),
        }
    }
}

/// The bytes in hexadecimal, and as ASCII where they are mostly text.
fn write_data(f: &mut fmt::Formatter<'_>, mark: &str, data: &[u8]) -> fmt::Result {
    f.write_str(mark)?;
    for byte in data {
        write!(f, " {byte:02x}")?;
    }
    let is_text = |byte: &u8| byte.is_ascii_graphic() || *byte == b' ';
    let texts = data.iter().filter(|byte| is_text(byte)).count();
    if texts * 3 >= data.len() * 2 && texts > 0 {
        f.write_str("  ; ")?;
        for byte in data {
            write!(f, "{}", if is_text(byte) { char::from(*byte) } else { '.' })?;
        }
    }
    Ok(())
}
