//! Conversations between host and device, as text: recorded live, replayed strictly, or spoilt on purpose.
//!
//! # The format
//!
//! One file is one conversation. UTF-8, one thing a line; empty lines and lines that begin with `;` say nothing.
//!
//! ```text
//! # device=Trinamic TMCM-1110, module 1
//! # source=pytrinamic 0.2.26
//! # synthetic=no
//! > 01 06 01 00 00 00 00 00 08   ; what the host sent (ASCII behind the semicolon is for the reader)
//! ~ 12.5                         ; a pause, ms
//! < 02 01 64 06 00 00 00 00 6d   ; what the device sent
//! ! timeout                      ; the host waited in vain
//! ```
//!
//! - **Header**, first: `# key=value` with `device`, `source` and `synthetic` (`no` only for bytes from a real device or
//!   from software that is not ours, which `source` names with its version), and `host` and `recorded` where known.
//! - **Streams** (serial, TCP, child process): `>` and `<` lines. Where one line ends means nothing: bytes are bytes.
//! - **Transfers** (USB, HID): `> [request]`, with the data that the host sends behind it, then, for a request to which
//!   the device sends data, one `<` line, empty if it sent nothing. Requests: `control-in type= request= value= index= length=`,
//!   `control-out type= request= value= index=`, `bulk-in endpoint= length=`, `bulk-out endpoint=`, `clear-halt
//!   endpoint=`, `report-in length=`, `report-out`, `feature-get report= length=`, `feature-set`; numbers are hexadecimal
//!   (2 or 4 digits) but for `length`, which is decimal. Data of a report begins with the report's number.
//! - **Faults**: `! timeout`, `! disconnect` (nothing comes after it), `! stall` (a USB request that the device refused).
//! - **Pauses** belong to what follows them. On replay the device's are kept, the host may take what time it likes.
//!
//! A line holds at most 1 MiB of data, a pause at most a day, a file at most 64 MiB.
//!
//! # A recording, read and replayed
//!
//! ```
//! use std::{sync::Arc, time::Duration};
//! use sunglint_drivers::clock::{Deadline, VirtualClock};
//! use sunglint_drivers::recording::{Recording, Replay};
//! use sunglint_drivers::transport::Bytes as _;
//!
//! let text = "# device=pm100\n# source=example\n# synthetic=yes\n> 2a 49 44 4e 3f 0a\n< 54 68 6f 72 0a\n";
//! let mut line = Replay::new(Recording::parse("example.rec", text)?);
//! let deadline = Deadline::after(Arc::new(VirtualClock::new()), Duration::from_secs(1));
//! line.send(b"*IDN?\n", &deadline)?;
//! let mut answer = [0; 5];
//! line.receive_exact(&mut answer, &deadline)?;
//! assert_eq!(&answer, b"Thor\n");
//! // Refuses where something of the recording was not asked for.
//! line.finish()?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod event;
mod faulty;
mod parse;
mod player;
mod recorded;
mod replay;
pub mod umockdev;

pub use event::{Event, Fault, Header};
pub use faulty::{Faults, Faulty, Injected};
pub use player::play;
pub use recorded::Recorded;
pub use replay::{Replay, ReplayError};

use std::path::{Path, PathBuf};
use sunglint_formats::{EncodeError, FileError, ParseError};

/// The most data of one line, bytes.
pub const MOST_DATA: usize = 1 << 20;
/// The longest pause, microseconds: a day.
pub const LONGEST_PAUSE_US: u64 = 86_400_000_000;
/// The longest recording, bytes of text.
pub const LONGEST_FILE: usize = 64 << 20;

/// A conversation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recording {
    /// The file, or what stands for it in messages.
    pub path: PathBuf,
    /// Who spoke.
    pub header: Header,
    /// Events of the conversation, each with its line in the file (0 if it has none yet).
    pub events: Vec<(u64, Event)>,
}

impl Recording {
    /// A recording that was made up in a program.
    pub fn new(header: Header, events: impl IntoIterator<Item = Event>) -> Self {
        let events = events.into_iter().map(|event| (0, event)).collect();
        Self { path: PathBuf::from("<recording>"), header, events }
    }

    /// Reads the text of a recording; `path` is for messages.
    ///
    /// # Errors
    /// The first line that the format (see the [module](self)) does not have.
    pub fn parse(path: impl AsRef<Path>, text: &str) -> Result<Self, ParseError> {
        parse::recording(path.as_ref(), text)
    }

    /// Reads a file.
    ///
    /// # Errors
    /// The file cannot be read, or is no recording.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, FileError> {
        let text = sunglint_formats::read::text(&path)?;
        Ok(Self::parse(path, &text)?)
    }

    /// The text of the recording.
    ///
    /// # Errors
    /// A header value or an event that the format cannot hold.
    pub fn to_text(&self) -> Result<String, EncodeError> {
        let mut text = self.header.to_text()?;
        for (_, event) in &self.events {
            event.check()?;
            text.push_str(&event.to_string());
            text.push('\n');
        }
        Ok(text)
    }
}

/// The first bytes in hexadecimal, for a message.
pub(crate) fn hex_excerpt(bytes: &[u8]) -> String {
    const MOST: usize = 24;
    let mut text = String::new();
    for (i, byte) in bytes.iter().take(MOST).enumerate() {
        text.push_str(if i == 0 { "" } else { " " });
        text.push_str(&format!("{byte:02x}"));
    }
    if bytes.len() > MOST {
        text.push_str(&format!(" … ({} bytes)", bytes.len()));
    }
    text
}
