//! A new file, HDU by HDU.

use super::BLOCK;
use super::card::{Card, CardValue};
use super::header::{Header, is_structural};
use super::image::{Image, encode};
use super::table_out::Encoded;
use crate::atomic::Overwrite;
use crate::error::{EncodeError, FileError};
use crate::table::{Meta, Table};
use std::path::Path;

/// Puts images and tables into a FITS file, in the order in which they are given. A file that begins with a table gets
/// an empty primary HDU before it.
#[derive(Debug, Clone, Default)]
pub struct Writer {
    bytes: Vec<u8>,
}

impl Writer {
    /// A file without HDUs.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds an image. Its header is written after the cards that describe the layout; such cards in it are left out,
    /// a comment that is too long is cut, and `?` stands in it for what is not ASCII. Texts are escaped where they are not
    /// ASCII: see [`fits`](super).
    ///
    /// # Errors
    /// A card that FITS cannot hold: a keyword or a unit that is not ASCII, a number that is not finite, a text that is
    /// too long beside its keyword.
    pub fn image(&mut self, image: &Image) -> Result<(), EncodeError> {
        let (bitpix, zero, data) = encode(&image.pixels);
        let head =
            image_head(self.bytes.is_empty(), (bitpix, zero), image.pixels.shape(), &image.header)?;
        self.push(&head, &data);
        Ok(())
    }

    /// Adds a table as a binary table with that EXTNAME (or none if it is empty).
    ///
    /// Whole numbers become 64-bit columns (K), with TNULL where one is missing; floats D; truth values L; texts A as
    /// wide as the longest, in which a missing text is an empty one and blanks at the end are lost. Keywords of the
    /// metadata are written in capitals; lists of text under `COMMENT`, `comments`, `HISTORY` or `history` become such
    /// cards.
    ///
    /// # Errors
    /// All that FITS cannot hold: a column's name, unit or text that is not ASCII, nested metadata, columns of different
    /// lengths. Other texts (titles, descriptions of columns, notes) are escaped where they are not ASCII: see
    /// [`fits`](super).
    pub fn table(&mut self, table: &Table, name: &str) -> Result<(), EncodeError> {
        if self.bytes.is_empty() {
            self.push(&empty_primary()?, &[]);
        }
        let columns = super::table_out::encode(table, 0)?;
        let head = table_head(&columns, columns.rows, &table.meta, name)?;
        self.push(&head, &columns.data);
        Ok(())
    }

    /// The bytes of the file.
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    /// Writes the file, whole or not at all.
    pub fn write_file(self, path: impl AsRef<Path>, overwrite: Overwrite) -> Result<(), FileError> {
        crate::atomic::write_file(path, &self.bytes, overwrite)
    }

    fn push(&mut self, head: &[u8], data: &[u8]) {
        self.bytes.extend_from_slice(head);
        self.bytes.extend_from_slice(data);
        self.bytes.resize(self.bytes.len().next_multiple_of(BLOCK), 0);
    }
}

/// Header of an image of pixels with that BITPIX and BZERO; `first` of a file or not.
pub(super) fn image_head(
    first: bool,
    (bitpix, zero): (i64, Option<f64>),
    shape: &[usize],
    free: &Header,
) -> Result<Vec<u8>, EncodeError> {
    let mut header = Header::default();
    begin(first, &mut header, "IMAGE", "image");
    header.set("BITPIX", bitpix, "bits of a pixel");
    header.set("NAXIS", shape.len() as i64, "number of axes");
    for (i, &n) in shape.iter().rev().enumerate() {
        header.set(&format!("NAXIS{}", i + 1), n as i64, "");
    }
    end_of_layout(first, &mut header);
    if let Some(zero) = zero {
        header.set("BSCALE", 1_i64, "");
        let value = match zero as i64 {
            // 2^63 is beyond i64; the standard asks for a whole number all the same.
            i64::MAX => CardValue::Other("9223372036854775808".to_owned()),
            zero => CardValue::Integer(zero),
        };
        header.set("BZERO", value, "offset of the integers");
    }
    whole(header, free)
}

/// Header of a binary table of so many rows.
pub(super) fn table_head(
    columns: &Encoded,
    rows: usize,
    meta: &Meta,
    name: &str,
) -> Result<Vec<u8>, EncodeError> {
    let mut header = Header::default();
    begin(false, &mut header, "BINTABLE", "binary table");
    header.set("BITPIX", 8_i64, "");
    header.set("NAXIS", 2_i64, "");
    header.set("NAXIS1", columns.row_bytes as i64, "bytes of a row");
    header.set("NAXIS2", rows as i64, "rows");
    end_of_layout(false, &mut header);
    header.set("TFIELDS", columns.fields as i64, "columns");
    header.cards.extend(columns.cards.iter().cloned());
    if !name.is_empty() {
        header.set("EXTNAME", name, "");
    }
    whole(header, &super::table_out::meta_cards(meta)?)
}

/// Header of a file that begins with a table.
pub(super) fn empty_primary() -> Result<Vec<u8>, EncodeError> {
    let mut header = Header::default();
    begin(true, &mut header, "", "");
    header.set("BITPIX", 8_i64, "");
    header.set("NAXIS", 0_i64, "no data here");
    end_of_layout(true, &mut header);
    whole(header, &Header::default())
}

fn begin(first: bool, header: &mut Header, extension: &str, what: &str) {
    if first {
        header.set("SIMPLE", true, "FITS");
    } else {
        header.set("XTENSION", extension, what);
    }
}

fn end_of_layout(first: bool, header: &mut Header) {
    if first {
        header.set("EXTEND", true, "");
    } else {
        header.set("PCOUNT", 0_i64, "");
        header.set("GCOUNT", 1_i64, "");
    }
}

fn whole(mut header: Header, free: &Header) -> Result<Vec<u8>, EncodeError> {
    let keep = |card: &&Card| !is_structural(&card.keyword);
    for card in free.cards.iter().filter(keep) {
        // EXTNAME as an argument wins over one in the metadata.
        if card.keyword != "EXTNAME" || header.get("EXTNAME").is_none() {
            header.cards.push(card.clone());
        }
    }
    header.encode()
}
