//! USBTMC messages (Universal Serial Bus Test and Measurement Class, 1.00, tables 1 to 9).

/// Bytes of a message's header.
pub const HEADER: usize = 12;
/// MsgID of a message to the device.
pub const OUT: u8 = 1;
/// MsgID of a request for a message, and of that message.
pub const IN: u8 = 2;
/// Control request INITIATE_CLEAR (bmRequestType a1).
pub const INITIATE_CLEAR: u8 = 5;
/// Control request CHECK_CLEAR_STATUS (bmRequestType a1).
pub const CHECK_CLEAR_STATUS: u8 = 6;
/// USBTMC_status of a request that was carried out.
pub const STATUS_SUCCESS: u8 = 1;
/// USBTMC_status of one that is still under way.
pub const STATUS_PENDING: u8 = 2;

/// The tag after `tag`: 1 to 255, never 0.
pub fn next_tag(tag: u8) -> u8 {
    tag.checked_add(1).unwrap_or(1)
}

fn header(kind: u8, tag: u8, length: u32, attributes: u8) -> Vec<u8> {
    let mut message = vec![kind, tag, !tag, 0];
    message.extend(length.to_le_bytes());
    message.extend([attributes, 0, 0, 0]);
    message
}

/// A whole message to the device (DEV_DEP_MSG_OUT with EOM), padded to a multiple of four bytes. The payload has at most
/// 2³² − 1 bytes.
pub fn message_out(tag: u8, payload: &[u8]) -> Vec<u8> {
    let length = u32::try_from(payload.len()).unwrap_or(u32::MAX);
    let mut message = header(OUT, tag, length, 1);
    message.extend_from_slice(payload);
    message.resize(message.len().next_multiple_of(4), 0);
    message
}

/// A request for a message of at most `most` bytes (REQUEST_DEV_DEP_MSG_IN).
pub fn request_in(tag: u8, most: u32) -> Vec<u8> {
    header(IN, tag, most, 0)
}

/// Why a message from the device is none, or not the one that was asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MessageError {
    /// Not even a header.
    #[error("a message of {bytes} bytes, expected at least {HEADER}")]
    NoHeader {
        /// How many bytes came.
        bytes: usize,
    },
    /// Another kind of message.
    #[error("a message of kind {found}, expected {IN}")]
    WrongKind {
        /// MsgID of the message.
        found: u8,
    },
    /// The answer to another request, or a spoilt header.
    #[error("a message with tag {found} and {inverse} as its inverse, expected {expected}")]
    WrongTag {
        /// Tag of the message.
        found: u8,
        /// Byte that should be the inverse of the tag.
        inverse: u8,
        /// The request's tag.
        expected: u8,
    },
    /// Fewer or more bytes than the header says; more than three of padding.
    #[error("a message with {found} bytes behind its header, which says {said}")]
    WrongLength {
        /// How many bytes came behind the header.
        found: usize,
        /// Number of bytes that the header states.
        said: u32,
    },
}

/// A message from the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MessageIn<'a> {
    /// Payload of the message, without padding.
    pub payload: &'a [u8],
    /// Whether it is the last part (EOM).
    pub end: bool,
}

impl<'a> MessageIn<'a> {
    /// Checks a message against the tag of its request.
    ///
    /// # Errors
    /// See [`MessageError`].
    pub fn parse(bytes: &'a [u8], tag: u8) -> Result<Self, MessageError> {
        let no_header = MessageError::NoHeader { bytes: bytes.len() };
        let (head, rest) = bytes.split_first_chunk::<HEADER>().ok_or(no_header)?;
        if head[0] != IN {
            return Err(MessageError::WrongKind { found: head[0] });
        }
        if head[1] != tag || head[2] != !tag {
            let [_, found, inverse, ..] = *head;
            return Err(MessageError::WrongTag { found, inverse, expected: tag });
        }
        let said = u32::from_le_bytes([head[4], head[5], head[6], head[7]]);
        let wrong = MessageError::WrongLength { found: rest.len(), said };
        let length = usize::try_from(said).map_err(|_| wrong)?;
        let payload = rest.get(..length).ok_or(wrong)?;
        if rest.len() - length > 3 {
            return Err(wrong);
        }
        Ok(Self { payload, end: head[8] & 1 == 1 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the layout of the standard's tables 1 to 4, byte for byte; `drivers/tests/pm100_peer.rs` holds it against
    /// python-usbtmc.
    #[test]
    fn messages_are_those_of_the_standard() {
        assert_eq!(
            message_out(1, b"*IDN?\n"),
            [1, 1, 0xfe, 0, 6, 0, 0, 0, 1, 0, 0, 0, 0x2a, 0x49, 0x44, 0x4e, 0x3f, 0x0a, 0, 0]
        );
        assert_eq!(request_in(2, 1024), [2, 2, 0xfd, 0, 0, 4, 0, 0, 0, 0, 0, 0]);
        assert_eq!((next_tag(1), next_tag(254), next_tag(255)), (2, 255, 1));
    }

    #[test]
    fn what_is_no_answer_says_why() {
        let good = [2, 7, 0xf8, 0, 3, 0, 0, 0, 1, 0, 0, 0, b'1', b'0', b'\n', 0];
        let message = MessageIn::parse(&good, 7).unwrap();
        assert_eq!((message.payload, message.end), (&b"10\n"[..], true));
        assert!(MessageIn::parse(&good[..15], 7).is_ok(), "padding may be left out");
        let with = |place: usize, byte: u8| {
            let mut bytes = good;
            bytes[place] = byte;
            MessageIn::parse(&bytes, 7).map(|message| message.payload.len()).unwrap_err()
        };
        assert_eq!(with(0, 1), MessageError::WrongKind { found: 1 });
        let tag = MessageError::WrongTag { found: 6, inverse: 0xf8, expected: 7 };
        assert_eq!(with(1, 6), tag);
        let tag = MessageError::WrongTag { found: 7, inverse: 0xf9, expected: 7 };
        assert_eq!(with(2, 0xf9), tag);
        assert_eq!(with(4, 5), MessageError::WrongLength { found: 4, said: 5 });
        assert_eq!(with(4, 0), MessageError::WrongLength { found: 4, said: 0 });
        assert_eq!(with(7, 0xff), MessageError::WrongLength { found: 4, said: 0xff00_0003 });
        assert_eq!(MessageIn::parse(&good[..11], 7), Err(MessageError::NoHeader { bytes: 11 }));
    }
}
