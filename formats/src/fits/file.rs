//! A file in memory: where its HDUs lie.

use super::header::Header;
use super::{BLOCK, CARD, Image};
use crate::error::{FileError, ParseError, excerpt};
use crate::table::Table;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// A FITS file in memory.
#[derive(Debug, Clone)]
pub struct Fits {
    pub(super) path: PathBuf,
    bytes: Vec<u8>,
    hdus: Vec<Hdu>,
}

/// A header and data unit.
#[derive(Debug, Clone, PartialEq)]
pub struct Hdu {
    header: Header,
    kind: Kind,
    pub(super) index: usize,
    data: Range<usize>,
}

/// Kind of data that an HDU holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Kind {
    /// A header alone (NAXIS = 0).
    Empty,
    /// An image or a cube.
    Image,
    /// A binary table.
    Table,
    /// A tile-compressed image in a binary table (`.fits.fz`), which is not read.
    CompressedImage,
    /// Another extension (an ASCII table), which is not read.
    Other,
}

impl Hdu {
    /// All cards, those that describe the layout of the data too.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Returns the kind of data in this HDU.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// EXTNAME.
    pub fn name(&self) -> Option<&str> {
        self.header.text("EXTNAME")
    }
}

/// The bytes of a file that may be packed with gzip or zlib, unpacked; bytes that are not packed as they are.
///
/// # Errors
/// A [`ParseError`] if the packed stream is damaged or unpacks to more than `most` bytes, or if it is packed in another way that is known, with the command that unpacks it.
pub fn inflate(path: impl AsRef<Path>, bytes: Vec<u8>, most: u64) -> Result<Vec<u8>, ParseError> {
    inflate_at(path.as_ref(), bytes, most)
}

fn inflate_at(path: &Path, bytes: Vec<u8>, most: u64) -> Result<Vec<u8>, ParseError> {
    use std::io::Read as _;
    let mut unpacked = Vec::new();
    // One byte more than allowed tells that there is more.
    let result = match bytes.as_slice() {
        [0x1f, 0x8b, ..] => flate2::read::MultiGzDecoder::new(bytes.as_slice())
            .take(most.saturating_add(1))
            .read_to_end(&mut unpacked),
        [0x78, 0x01 | 0x5e | 0x9c | 0xda, ..] => flate2::read::ZlibDecoder::new(bytes.as_slice())
            .take(most.saturating_add(1))
            .read_to_end(&mut unpacked),
        other => {
            let Some((name, command)) = packed_otherwise(other) else { return Ok(bytes) };
            let error = ParseError::new(
                path,
                format!("a file packed with {name}"),
                "a file that is not packed, or packed with gzip",
            );
            return Err(error.with_hint(format!("unpack it first: {command} {}", path.display())));
        }
    };
    match result {
        Ok(read) if read as u64 > most => Err(ParseError::new(
            path,
            format!("a packed file of more than {most} bytes"),
            format!("at most {most} bytes"),
        )),
        Ok(_) => Ok(unpacked),
        Err(error) => {
            Err(ParseError::new(path, "a damaged packed file", "a whole gzip or zlib stream")
                .with_hint(error.to_string()))
        }
    }
}

/// The way in which bytes are packed, where it is one that is not read, and the command that unpacks them. Each by its first bytes.
fn packed_otherwise(bytes: &[u8]) -> Option<(&'static str, &'static str)> {
    let known: [(&[u8], &str, &str); 6] = [
        (b"\x1f\x9d", "compress", "uncompress"),
        // After BZh comes the size of a block, then the digits of pi: no text begins so.
        (b"1AY&SY", "bzip2", "bunzip2"),
        (b"\xfd7zXZ\0", "xz", "unxz"),
        (b"\x28\xb5\x2f\xfd", "zstd", "unzstd"),
        (b"PK\x03\x04", "zip", "unzip"),
        (b"7z\xbc\xaf\x27\x1c", "7-Zip", "7z x"),
    ];
    let is = |(first, name, _): &(&[u8], &str, &str)| match *name {
        "bzip2" => {
            bytes.starts_with(b"BZh") && bytes.get(4..).is_some_and(|b| b.starts_with(first))
        }
        _ => bytes.starts_with(first),
    };
    known.into_iter().find(is).map(|(_, name, command)| (name, command))
}

impl Fits {
    /// Reads a file; one packed with gzip or zlib is unpacked, up to 64 MiB or 256 times its size.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, FileError> {
        Self::read_at(path.as_ref())
    }

    fn read_at(path: &Path) -> Result<Self, FileError> {
        let bytes = crate::read::bytes(path)?;
        let most = (64_u64 << 20).max(bytes.len() as u64 * 256);
        let bytes = inflate(path, bytes, most)?;
        Ok(Self::from_bytes(path, bytes)?)
    }

    /// A file from its bytes; `path` names it in errors. Headers are read and the data are seen to be there; they are
    /// decoded when asked for.
    ///
    /// # Errors
    /// A [`ParseError`] with the keyword: no FITS file, a header without END, a layout that makes no sense, data cut
    /// off.
    pub fn from_bytes(path: impl AsRef<Path>, bytes: Vec<u8>) -> Result<Self, ParseError> {
        Self::from_bytes_at(path.as_ref(), bytes)
    }

    fn from_bytes_at(path: &Path, bytes: Vec<u8>) -> Result<Self, ParseError> {
        let mut fits = Self { path: path.to_path_buf(), bytes, hdus: Vec::new() };
        let mut at = 0;
        while at < fits.bytes.len() {
            let rest = &fits.bytes[at..];
            // Some writers fill up with blocks of nothing.
            if at > 0 && rest.iter().all(|&b| b == 0 || b == b' ') {
                break;
            }
            let (hdu, next) = fits.scan(at)?;
            fits.hdus.push(hdu);
            at = next;
        }
        if fits.hdus.is_empty() {
            return Err(ParseError::new(&fits.path, "no bytes", "a FITS file"));
        }
        Ok(fits)
    }

    /// The file's bytes with other cards in its first header: those that `is_gone` names are taken out, the new ones stand before END. All else,
    /// the pixels too, stays as it is, byte for byte.
    ///
    /// # Errors
    /// A card that FITS cannot hold; a file whose first header is not the image's.
    pub fn with_cards(
        &self,
        is_gone: impl Fn(&str) -> bool,
        cards: &Header,
    ) -> Result<Vec<u8>, crate::error::EncodeError> {
        let first = self.hdus.first().filter(|hdu| hdu.kind == Kind::Image).ok_or_else(|| {
            crate::error::EncodeError::new("NAXIS", "no image", "an image in the first header")
        })?;
        let mut out = Vec::with_capacity(self.bytes.len() + BLOCK);
        let mut goes_on = false;
        for card in self.bytes[..first.data.start].chunks_exact(CARD) {
            let keyword = String::from_utf8_lossy(&card[..8]);
            let keyword = keyword.trim_end();
            if keyword == "END" {
                break;
            }
            // Long texts go on in cards of their own.
            goes_on = is_gone(keyword) || goes_on && keyword == "CONTINUE";
            if !goes_on {
                out.extend_from_slice(card);
            }
        }
        for card in &cards.cards {
            card.encode(false, &mut out)?;
        }
        out.extend_from_slice(b"END");
        out.resize(out.len().next_multiple_of(BLOCK), b' ');
        out.extend_from_slice(&self.bytes[first.data.start..]);
        Ok(out)
    }

    /// The HDUs, the primary one first.
    pub fn hdus(&self) -> &[Hdu] {
        &self.hdus
    }

    /// The file as the user named it.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The number of the HDU with that EXTNAME.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.hdus.iter().position(|hdu| hdu.name() == Some(name))
    }

    /// The number of the first HDU that is an image, or a table.
    pub fn first(&self, kind: Kind) -> Option<usize> {
        self.hdus.iter().position(|hdu| hdu.kind == kind)
    }

    /// The image of an HDU (0 is the primary one).
    ///
    /// # Errors
    /// A [`ParseError`] if there is no such HDU, or if it is something else.
    pub fn image(&self, index: usize) -> Result<Image, ParseError> {
        let hdu = self.hdu_of(index, Kind::Image, "an image")?;
        super::image::decode(self, hdu)
    }

    /// The binary table of an HDU (0 is the primary one, which is never a table).
    ///
    /// The metadata are the cards that do not describe the layout: numbers, texts and truth values by keyword,
    /// `COMMENT` and `HISTORY` as lists of text.
    ///
    /// # Errors
    /// A [`ParseError`] if there is no such HDU, if it is something else, or with the name of a column that is not
    /// read.
    pub fn table(&self, index: usize) -> Result<Table, ParseError> {
        let hdu = self.hdu_of(index, Kind::Table, "a binary table")?;
        super::table::decode(self, hdu)
    }

    /// The tile-compressed image of an HDU, unpacked: RICE_1, GZIP_1, GZIP_2.
    ///
    /// # Errors
    /// A [`ParseError`] if there is no such HDU, if it is something else, another compression, bytes that are none.
    pub fn compressed_image(&self, index: usize) -> Result<Image, ParseError> {
        let hdu = self.hdu_of(index, Kind::CompressedImage, "a tile-compressed image")?;
        super::tiles::decode(self, hdu)
    }

    fn hdu_of(&self, index: usize, kind: Kind, what: &str) -> Result<&Hdu, ParseError> {
        let wrong =
            |found: &str| ParseError::new(&self.path, found, what).in_field(format!("HDU {index}"));
        let Some(hdu) = self.hdus.get(index) else {
            return Err(wrong(&format!("{} HDUs (the first is 0)", self.hdus.len())));
        };
        match hdu.kind {
            found if found == kind => Ok(hdu),
            Kind::Empty => Err(wrong("a header without data")),
            Kind::Image => Err(wrong("an image")),
            Kind::Table => Err(wrong("a binary table")),
            Kind::CompressedImage => Err(wrong("a tile-compressed image")
                .with_hint("unpack it with funpack, or turn the compression of the camera off")),
            Kind::Other => Err(wrong(&hdu.header.get("XTENSION").map_or_else(
                || "another kind of data".to_owned(),
                |value| format!("XTENSION = {value}"),
            ))),
        }
    }

    pub(super) fn data(&self, hdu: &Hdu) -> &[u8] {
        &self.bytes[hdu.data.clone()]
    }

    /// Reads the header at a byte and finds where its data end: the HDU, and the byte of the next.
    fn scan(&self, at: usize) -> Result<(Hdu, usize), ParseError> {
        let index = self.hdus.len();
        let rest = &self.bytes[at..];
        let start: &[u8] = if index == 0 { b"SIMPLE  =" } else { b"XTENSION=" };
        if !rest.starts_with(start) {
            if let (0, Some(kind)) = (index, crate::kind::of(rest)) {
                let wanted = "a FITS file, which begins with `SIMPLE  =`";
                return Err(kind.in_place_of(&self.path, wanted));
            }
            let found: String = rest.iter().take(9).map(|&b| char::from(b)).collect();
            let expected = if index == 0 {
                "a FITS file, which begins with `SIMPLE  =`"
            } else {
                "`XTENSION=`, or the end"
            };
            let error = ParseError::new(&self.path, excerpt(&found), expected);
            return Err(error.in_field(format!("HDU {index}")));
        }
        let Some((header, length)) = Header::parse(rest) else {
            return Err(ParseError::new(
                &self.path,
                format!("a header of {} bytes without END", rest.len()),
                "a card END",
            )
            .in_field(format!("HDU {index}"))
            .with_hint("the file is cut off"));
        };
        let mut hdu = Hdu { header, kind: Kind::Other, index, data: 0..0 };
        let size = self.size_of(&hdu)?;
        let present = rest.len().saturating_sub(length) as u64;
        let Some(bytes) = size.bytes.filter(|&bytes| bytes <= present) else {
            let expected = match size.bytes {
                Some(bytes) => format!("{bytes} bytes, as the header says"),
                None => "a size that fits into 64 bits".to_owned(),
            };
            return Err(self
                .bad(&hdu, &size.widest, format!("{present} bytes of data"), expected)
                .with_hint("the file is cut off, or its header is wrong"));
        };
        // The padding of the last block may be missing.
        let begin = at + length.min(rest.len());
        let end = begin + bytes as usize;
        hdu.data = begin..end;
        hdu.kind = self.kind_of(&hdu, size.axes)?;
        let next = begin + (bytes as usize).next_multiple_of(BLOCK);
        Ok((hdu, next))
    }

    fn kind_of(&self, hdu: &Hdu, axes: usize) -> Result<Kind, ParseError> {
        let header = &hdu.header;
        if hdu.index == 0 {
            if header.logical("SIMPLE") != Some(true) {
                let found = header.get("SIMPLE").map_or("nothing".to_owned(), |v| v.to_string());
                return Err(self.bad(hdu, "SIMPLE", found, "T"));
            }
            if header.logical("GROUPS") == Some(true) {
                return Err(self.bad(hdu, "GROUPS", "random groups", "an image"));
            }
            return Ok(if axes == 0 { Kind::Empty } else { Kind::Image });
        }
        Ok(match header.text("XTENSION") {
            Some("IMAGE" | "IUEIMAGE") if axes == 0 => Kind::Empty,
            Some("IMAGE" | "IUEIMAGE") => Kind::Image,
            Some("BINTABLE" | "A3DTABLE") if header.logical("ZIMAGE") == Some(true) => {
                Kind::CompressedImage
            }
            Some("BINTABLE" | "A3DTABLE") => Kind::Table,
            _ => Kind::Other,
        })
    }

    fn size_of(&self, hdu: &Hdu) -> Result<Size, ParseError> {
        let bitpix = self.integer(hdu, "BITPIX")?;
        if ![8, 16, 32, 64, -32, -64].contains(&bitpix) {
            return Err(self.bad(hdu, "BITPIX", bitpix.to_string(), "8, 16, 32, 64, -32 or -64"));
        }
        let shape = self.axes(hdu)?;
        let optional = |keyword, default| match hdu.header.get(keyword) {
            None => Ok(default),
            Some(_) => self.count(hdu, keyword),
        };
        let (parameters, groups) = (optional("PCOUNT", 0)?, optional("GCOUNT", 1)?);
        // Random groups have a first axis of 0 that does not count.
        let groups_here = hdu.header.logical("GROUPS") == Some(true) && shape.first() == Some(&0);
        let axes = if groups_here { &shape[1..] } else { shape.as_slice() };
        // A factor of 0 makes all nothing, whatever the others would overflow to.
        let pixels = if shape.is_empty() || axes.contains(&0) {
            Some(0)
        } else {
            axes.iter().try_fold(1_u64, |product, &n| product.checked_mul(n))
        };
        let bytes = pixels
            .and_then(|pixels| pixels.checked_add(parameters))
            .and_then(|values| values.checked_mul(groups))
            .and_then(|values| values.checked_mul(bitpix.unsigned_abs() / 8));
        let widest = shape.iter().enumerate().max_by_key(|&(i, &n)| (n, usize::MAX - i));
        let widest = widest.map_or("NAXIS".to_owned(), |(i, _)| format!("NAXIS{}", i + 1));
        let widest = if parameters > shape.iter().copied().max().unwrap_or(0) {
            "PCOUNT".into()
        } else {
            widest
        };
        Ok(Size { bytes, axes: shape.len(), widest })
    }

    /// NAXIS1, NAXIS2 …, in that order.
    pub(crate) fn axes(&self, hdu: &Hdu) -> Result<Vec<u64>, ParseError> {
        let axes = self.integer(hdu, "NAXIS")?;
        if !(0..=999).contains(&axes) {
            return Err(self.bad(hdu, "NAXIS", axes.to_string(), "0 to 999 axes"));
        }
        (1..=axes).map(|i| self.count(hdu, &format!("NAXIS{i}"))).collect()
    }

    /// A whole number of 0 or above that must be in the header.
    pub(super) fn count(&self, hdu: &Hdu, keyword: &str) -> Result<u64, ParseError> {
        let value = self.integer(hdu, keyword)?;
        u64::try_from(value)
            .map_err(|_| self.bad(hdu, keyword, value.to_string(), "a number of 0 or above"))
    }

    /// A whole number that must be in the header.
    pub(super) fn integer(&self, hdu: &Hdu, keyword: &str) -> Result<i64, ParseError> {
        match hdu.header.get(keyword) {
            None => Err(self.bad(hdu, keyword, "no such card", "a whole number")),
            Some(value) => value
                .integer()
                .ok_or_else(|| self.bad(hdu, keyword, value.to_string(), "a whole number")),
        }
    }

    /// A number that may be in the header.
    pub(super) fn real_or(
        &self,
        hdu: &Hdu,
        keyword: &str,
        default: f64,
    ) -> Result<f64, ParseError> {
        match hdu.header.get(keyword) {
            None => Ok(default),
            Some(value) => {
                value.real().ok_or_else(|| self.bad(hdu, keyword, value.to_string(), "a number"))
            }
        }
    }

    /// An error at a keyword; the HDU is named unless it is the primary one.
    pub(super) fn bad(
        &self,
        hdu: &Hdu,
        keyword: &str,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> ParseError {
        let field = match hdu.index {
            0 => keyword.to_owned(),
            index => format!("HDU {index}, {keyword}"),
        };
        ParseError::new(&self.path, found, expected).in_field(field)
    }
}

/// The size that a header promises.
struct Size {
    /// `None` if it does not fit into 64 bits.
    bytes: Option<u64>,
    axes: usize,
    /// The keyword that contributes most, for errors.
    widest: String,
}
