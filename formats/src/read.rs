//! Reading a file whole, with errors that name it.

use crate::error::{FileError, ParseError};
use std::path::Path;

/// The bytes of a file.
pub fn bytes(path: impl AsRef<Path>) -> Result<Vec<u8>, FileError> {
    let path = path.as_ref();
    std::fs::read(path).map_err(|source| FileError::io("read", path, source))
}

/// The text of a file: UTF-8, a byte-order mark at its start taken off.
pub fn text(path: impl AsRef<Path>) -> Result<String, FileError> {
    let path = path.as_ref();
    Ok(decode(path, bytes(path)?)?)
}

/// The text of `bytes`: UTF-8, a byte-order mark at its start taken off. `path` names it in errors.
pub fn decode(path: impl AsRef<Path>, bytes: Vec<u8>) -> Result<String, ParseError> {
    let mut text = String::from_utf8(bytes).map_err(|error| {
        let good = error.utf8_error().valid_up_to();
        let bytes = error.as_bytes();
        let line = 1 + bytes[..good].iter().filter(|&&b| b == b'\n').count() as u64;
        ParseError::new(path, format!("the byte 0x{:02x}", bytes[good]), "text in UTF-8")
            .at_line(line)
    })?;
    if text.starts_with('\u{feff}') {
        text.drain(..'\u{feff}'.len_utf8());
    }
    Ok(text)
}

/// The number of the line, from 1, in which a byte of `text` lies.
pub(crate) fn line_of(text: &str, byte: usize) -> u64 {
    1 + text.as_bytes()[..byte.min(text.len())].iter().filter(|&&b| b == b'\n').count() as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_that_is_not_utf8_names_the_byte_and_the_line() {
        let error = decode("a.csv", b"x,y\n1,2\n3,\xb5\n".to_vec()).unwrap_err();
        assert_eq!(error.to_string(), "a.csv:3: found the byte 0xb5, expected text in UTF-8");
        assert_eq!(decode("a.csv", b"\xef\xbb\xbfx,y".to_vec()).unwrap(), "x,y");
    }
}
