//! Reading a file whole, with errors that name it.

use crate::error::{FileError, ParseError};
use std::io::Read as _;
use std::path::Path;

/// Texts are tables, curves and configurations: none that makes sense is larger, bytes.
const LARGEST_TEXT: u64 = 512 << 20;

/// The bytes of a file. It must be a plain file: a pipe may never end, and a device has no size by which memory is bounded.
pub fn bytes(path: impl AsRef<Path>) -> Result<Vec<u8>, FileError> {
    bytes_up_to(path.as_ref(), u64::MAX)
}

/// The bytes of a file that should be text: of at most 512 MiB.
pub fn bytes_of_text(path: impl AsRef<Path>) -> Result<Vec<u8>, FileError> {
    bytes_up_to(path.as_ref(), LARGEST_TEXT)
}

/// The text of a file of at most 512 MiB: UTF-8, a byte-order mark at its start taken off.
pub fn text(path: impl AsRef<Path>) -> Result<String, FileError> {
    let path = path.as_ref();
    Ok(decode(path, bytes_of_text(path)?)?)
}

fn bytes_up_to(path: &Path, most: u64) -> Result<Vec<u8>, FileError> {
    let io = |source| FileError::io("read", path, source);
    let refuse = |why: String| io(std::io::Error::new(std::io::ErrorKind::InvalidInput, why));
    // Asked before it is opened: opening a pipe waits for whoever writes to it.
    let about = std::fs::metadata(path).map_err(io)?;
    if !about.is_file() {
        let what = if about.is_dir() { "a folder" } else { "a pipe or a device" };
        return Err(refuse(format!("it is {what}, not a file")));
    }
    if about.len() > most {
        return Err(refuse(format!(
            "it has {} bytes, and at most {most} make sense here",
            about.len()
        )));
    }
    // A file may grow while it is read, but not without end.
    let file = std::fs::File::open(path).map_err(io)?;
    let mut bytes = Vec::new();
    file.take(about.len().saturating_add(1)).read_to_end(&mut bytes).map_err(io)?;
    if bytes.len() as u64 > about.len() {
        return Err(refuse("it grew while it was read: read it again when it is whole".into()));
    }
    Ok(bytes)
}

/// The text of `bytes`: UTF-8, a byte-order mark at its start taken off. `path` names it in errors.
pub fn decode(path: impl AsRef<Path>, bytes: Vec<u8>) -> Result<String, ParseError> {
    decode_at(path.as_ref(), bytes)
}

fn decode_at(path: &Path, bytes: Vec<u8>) -> Result<String, ParseError> {
    if let Some(kind) = crate::kind::of_bytes(&bytes) {
        return Err(kind.in_place_of(path, "text in UTF-8"));
    }
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
    fn only_files_are_read() {
        let error = text("/").unwrap_err().to_string();
        assert!(error.contains("it is a folder, not a file"), "{error}");
        if Path::new("/dev/zero").exists() {
            let error = bytes("/dev/zero").unwrap_err().to_string();
            assert!(error.contains("a pipe or a device, not a file"), "{error}");
        }
        assert!(
            bytes("no such file").unwrap_err().to_string().starts_with("cannot read no such file")
        );
        assert!(!bytes(file!().trim_start_matches("formats/")).unwrap().is_empty());
    }

    #[test]
    fn text_that_is_not_utf8_names_the_byte_and_the_line() {
        let error = decode("a.csv", b"x,y\n1,2\n3,\xb5\n".to_vec()).unwrap_err();
        assert_eq!(error.to_string(), "a.csv:3: found the byte 0xb5, expected text in UTF-8");
        assert_eq!(decode("a.csv", b"\xef\xbb\xbfx,y".to_vec()).unwrap(), "x,y");
    }
}
