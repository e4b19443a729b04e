//! The header: named entries of 48 bytes, some with more bytes behind them.

use sunglint_formats::tags::bytes_at::BytesAt;
use sunglint_formats::{FileError, ParseError};

/// The most entries that are read; files have some hundreds.
pub const MOST_ENTRIES: usize = 1 << 16;

/// The most bytes that the texts and lists of numbers of a header have together.
pub const MOST_VALUE_BYTES: u64 = 64 << 20;

const MAGIC: &[u8; 8] = b"PQTTTR\0\0";
const ENTRY_BYTES: u64 = 48;

/// Value of an entry.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Value {
    /// Nothing: the name says it all.
    Empty,
    /// Yes or no.
    Bool(bool),
    /// A whole number.
    Int(i64),
    /// 64 flags.
    Bits(u64),
    /// A colour.
    Color(u64),
    /// A number.
    Float(f64),
    /// A date: days since 1899-12-30, in whatever time zone the computer had.
    Days(f64),
    /// Numbers.
    Floats(Vec<f64>),
    /// Text.
    Text(String),
    /// Bytes that stay where they are in the file.
    Blob {
        /// Where they begin.
        at_byte: u64,
        /// How many there are.
        bytes: u64,
    },
}

/// One entry.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// The name, as in PicoQuant's tag dictionary.
    pub name: String,
    /// Place of the entry in a list of the same name, or −1.
    pub index: i32,
    /// Value of the entry.
    pub value: Value,
    /// Where it begins in the file.
    pub at_byte: u64,
}

/// All entries, in the order of the file.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    /// Version of the header's format, such as `1.0.00`.
    pub version: String,
    /// The entries before `Header_End`.
    pub entries: Vec<Entry>,
    /// Where the records begin.
    pub end_byte: u64,
}

impl Header {
    /// The entry of a name that is no list (the last one, where it stands twice: it is the newer).
    pub fn get(&self, name: &str) -> Option<&Entry> {
        self.entries.iter().rev().find(|entry| entry.name == name && entry.index < 0)
    }

    /// A whole number.
    pub fn int(&self, name: &str) -> Option<i64> {
        match self.get(name)?.value {
            Value::Int(value) => Some(value),
            _ => None,
        }
    }

    /// A number.
    pub fn float(&self, name: &str) -> Option<f64> {
        match self.get(name)?.value {
            Value::Float(value) => Some(value),
            _ => None,
        }
    }

    /// A text.
    pub fn text(&self, name: &str) -> Option<&str> {
        match &self.get(name)?.value {
            Value::Text(text) => Some(text),
            _ => None,
        }
    }

    pub(super) fn read(file: &BytesAt) -> Result<Self, FileError> {
        let mut reader = Reader { file, at: 0, kept: 0 };
        let magic: [u8; 8] = reader.array("the magic bytes PQTTTR")?;
        if magic != *MAGIC {
            let found = magic.escape_ascii().to_string();
            let error = ParseError::new(file.path(), found, "PQTTTR, with which a PTU file begins");
            return Err(error.in_field("byte 0").into());
        }
        let version = text_of(&reader.array::<8>("the version of the header")?);
        let mut entries = Vec::new();
        loop {
            let entry = reader.entry()?;
            if entry.name == "Header_End" {
                break;
            }
            if entries.len() == MOST_ENTRIES {
                let found = format!("more than {MOST_ENTRIES} entries");
                return Err(reader.refuse(entry.at_byte, found, "`Header_End` before"));
            }
            entries.push(entry);
        }
        Ok(Self { version, entries, end_byte: reader.at })
    }
}

struct Reader<'a> {
    file: &'a BytesAt,
    at: u64,
    /// Bytes of texts and lists so far.
    kept: u64,
}

impl Reader<'_> {
    fn refuse(&self, at: u64, found: impl Into<String>, expected: &str) -> FileError {
        let error = ParseError::new(self.file.path(), found, expected);
        error.in_field(format!("byte {at}")).into()
    }

    fn require(&self, bytes: u64, what: &str) -> Result<(), FileError> {
        if bytes > self.file.len().saturating_sub(self.at) {
            let found = format!("the end of the file at byte {}", self.file.len());
            return Err(self.refuse(self.at, found, &format!("{what}, {bytes} bytes")));
        }
        Ok(())
    }

    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], FileError> {
        self.require(N as u64, what)?;
        let mut bytes = [0; N];
        self.file.read(self.at, &mut bytes)?;
        self.at += N as u64;
        Ok(bytes)
    }

    fn entry(&mut self) -> Result<Entry, FileError> {
        let at_byte = self.at;
        let bytes: [u8; ENTRY_BYTES as usize] = self.array("an entry of the header")?;
        let (name, rest) = bytes.split_at(32);
        let (numbers, _) = rest.as_chunks::<4>();
        let (index, kind) = (i32::from_le_bytes(numbers[0]), u32::from_le_bytes(numbers[1]));
        let (values, _) = rest.as_chunks::<8>();
        let (int, float) = (i64::from_le_bytes(values[1]), f64::from_le_bytes(values[1]));
        let name = text_of(name);
        let value = match kind {
            0xffff_0008 => Value::Empty,
            0x0000_0008 => Value::Bool(int != 0),
            0x1000_0008 => Value::Int(int),
            0x1100_0008 => Value::Bits(int as u64),
            0x1200_0008 => Value::Color(int as u64),
            0x2000_0008 => Value::Float(float),
            0x2100_0008 => Value::Days(float),
            0x2001_ffff => {
                let bytes = self.more(&name, int)?;
                let (numbers, _) = bytes.as_chunks::<8>();
                Value::Floats(numbers.iter().map(|&number| f64::from_le_bytes(number)).collect())
            }
            0x4001_ffff => Value::Text(text_of(&self.more(&name, int)?)),
            0x4002_ffff => Value::Text(wide_text_of(&self.more(&name, int)?)),
            0xffff_ffff => {
                let blob = Value::Blob { at_byte: self.at, bytes: self.length(&name, int)? };
                self.at += int as u64;
                blob
            }
            _ => {
                let found = format!("`{}` of type 0x{kind:08X}", name.escape_debug());
                return Err(self.refuse(at_byte, found, "an entry of a type that is defined"));
            }
        };
        Ok(Entry { name, index, value, at_byte })
    }

    /// The length that an entry claims for what follows it, once that is known to be there.
    fn length(&self, name: &str, claimed: i64) -> Result<u64, FileError> {
        let what = format!("the value of `{}`", name.escape_debug());
        let Ok(bytes) = u64::try_from(claimed) else {
            let found = format!("a length of {claimed} bytes");
            return Err(self.refuse(self.at - 8, found, &what));
        };
        self.require(bytes, &what)?;
        Ok(bytes)
    }

    /// Reads the bytes that follow an entry.
    fn more(&mut self, name: &str, claimed: i64) -> Result<Vec<u8>, FileError> {
        let length = self.length(name, claimed)?;
        self.kept = self.kept.saturating_add(length);
        if self.kept > MOST_VALUE_BYTES {
            let found = format!("{} bytes of texts and lists", self.kept);
            let expected = format!("at most {MOST_VALUE_BYTES}");
            return Err(self.refuse(self.at, found, &expected));
        }
        let mut bytes = vec![0; length as usize];
        self.file.read(self.at, &mut bytes)?;
        self.at += length;
        Ok(bytes)
    }
}

/// Text up to the first NUL: UTF-8, or else Latin-1, as old programs wrote it.
fn text_of(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
    match std::str::from_utf8(&bytes[..end]) {
        Ok(text) => text.to_owned(),
        Err(_) => bytes[..end].iter().map(|&byte| char::from(byte)).collect(),
    }
}

/// UTF-16, little-endian, up to the first NUL; what is not valid becomes U+FFFD.
fn wide_text_of(bytes: &[u8]) -> String {
    let (pairs, _) = bytes.as_chunks::<2>();
    let units = pairs.iter().map(|&pair| u16::from_le_bytes(pair)).take_while(|&unit| unit != 0);
    char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect()
}
