//! Frames: ASCOM's ImageBytes, and the older form in JSON.
//!
//! ImageBytes (ASCOM, "Alpaca ImageBytes transfer", 2022) is little-endian: eleven 32-bit numbers (version, error, the request's number, the server's, where
//! the pixels begin, the pixels' type in the camera, their type here, rank, three sizes), then the pixels, of which the *last* index runs fastest. The first index
//! is the column, so that columns follow one another.

use super::answer::Envelope;
use ndarray::Array2;
use serde::Deserializer;
use serde::de::{DeserializeSeed, Error as _, IgnoredAny, MapAccess, SeqAccess, Visitor};
use std::borrow::Cow;

/// Bytes of the numbers before the pixels.
pub const HEADER_BYTES: usize = 44;
/// The most bytes that may lie between the numbers and the pixels.
const MOST_GAP: usize = 64 << 10;

/// An image that a camera gave.
#[derive(Debug, Clone, PartialEq)]
pub struct AlpacaImage {
    /// Pixels, ADU, `[row, column]`.
    pub pixels: Array2<u16>,
    /// Number of the request that is answered; zero where the server does not say.
    pub client_transaction: u32,
}

/// Why there is no image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ImageError {
    /// The camera said no: ASCOM's code, and its words.
    Said(i64, String),
    /// It is no image, or not the one that was asked for.
    Unfit(String),
}

impl From<String> for ImageError {
    fn from(reason: String) -> Self {
        Self::Unfit(reason)
    }
}

/// Reads ImageBytes of `expected` columns and rows.
///
/// # Errors
/// See [`ImageError`]. Nothing larger than the body is made.
pub fn image_bytes(body: &[u8], expected: [u32; 2]) -> Result<AlpacaImage, ImageError> {
    let short = || format!("ImageBytes of {} bytes, expected {HEADER_BYTES} at least", body.len());
    let number = |i: usize| -> Option<i32> {
        Some(i32::from_le_bytes(body.get(4 * i..4 * i + 4)?.try_into().ok()?))
    };
    let mut head = [0; 11];
    for (i, slot) in head.iter_mut().enumerate() {
        *slot = number(i).ok_or_else(short)?;
    }
    let [version, error, client, _, start, _, kind, rank, columns, rows, planes] = head;
    if version != 1 {
        return Err(format!("ImageBytes of version {version}, expected 1").into());
    }
    let start = usize::try_from(start)
        .ok()
        .filter(|start| (HEADER_BYTES..=HEADER_BYTES + MOST_GAP).contains(start))
        .ok_or_else(|| format!("the pixels begin at byte {start}"))?;
    let data = body.get(start..).ok_or_else(|| format!("the pixels begin at byte {start}"))?;
    if error != 0 {
        let words = String::from_utf8_lossy(&data[..data.len().min(400)]).into_owned();
        return Err(ImageError::Said(error.into(), words));
    }
    if rank != 2 {
        return Err(format!(
            "an image of rank {rank} ({columns} × {rows} × {planes}): colour planes are no measurement, set the camera to raw frames"
        )
        .into());
    }
    let size = [columns, rows].map(i64::from);
    check_size(size, expected)?;
    let [columns, rows] = expected.map(|n| n as usize);
    let count = columns * rows;
    let width = match kind {
        1 | 8 => 2,
        2 | 4 | 9 => 4,
        3 | 5 | 7 => 8,
        6 => 1,
        other => return Err(format!("pixels of type {other}").into()),
    };
    if count.checked_mul(width) != Some(data.len()) {
        return Err(format!(
            "{} bytes of pixels, expected {columns} × {rows} of {width} bytes",
            data.len()
        )
        .into());
    }
    macro_rules! values {
        ($type:ty) => {
            data.chunks_exact(size_of::<$type>()).map(|bytes| {
                let mut own = [0; size_of::<$type>()];
                own.copy_from_slice(bytes);
                <$type>::from_le_bytes(own) as f64
            })
        };
    }
    let pixels = match kind {
        1 => adu(values!(i16), [columns, rows])?,
        2 => adu(values!(i32), [columns, rows])?,
        3 => adu(values!(f64), [columns, rows])?,
        4 => adu(values!(f32), [columns, rows])?,
        5 => adu(values!(u64), [columns, rows])?,
        6 => adu(values!(u8), [columns, rows])?,
        7 => adu(values!(i64), [columns, rows])?,
        8 => adu(values!(u16), [columns, rows])?,
        _ => adu(values!(u32), [columns, rows])?,
    };
    // The number is written as it was sent, in 32 bits.
    Ok(AlpacaImage { pixels, client_transaction: client.cast_unsigned() })
}

/// Reader of the member `Value`: values one after the other, and no more of them than are expected, whatever the body has.
struct Pixels<'v> {
    expected: [u32; 2],
    values: &'v mut Vec<f32>,
}

impl<'de> Visitor<'de> for Pixels<'_> {
    type Value = ();

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("an answer with an image as columns of numbers")
    }

    fn visit_map<A: MapAccess<'de>>(mut self, mut map: A) -> Result<(), A::Error> {
        while let Some(key) = map.next_key::<Cow<'de, str>>()? {
            match key.as_ref() {
                "Value" => map.next_value_seed(&mut self)?,
                _ => map.next_value::<IgnoredAny>().map(drop)?,
            }
        }
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut columns: A) -> Result<(), A::Error> {
        let [count, rows] = self.expected;
        self.values.clear();
        let mut column = 0;
        while columns.next_element_seed(Column { rows, values: self.values })?.is_some() {
            column += 1;
            if column > count {
                return Err(A::Error::custom(format_args!("more than {count} columns")));
            }
        }
        match column == count {
            true => Ok(()),
            false => Err(A::Error::custom(format_args!("{column} columns, expected {count}"))),
        }
    }
}

impl<'de> DeserializeSeed<'de> for &mut Pixels<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, from: D) -> Result<(), D::Error> {
        from.deserialize_seq(Pixels { expected: self.expected, values: self.values })
    }
}

/// Reader of a column.
struct Column<'v> {
    rows: u32,
    values: &'v mut Vec<f32>,
}

impl<'de> Visitor<'de> for Column<'_> {
    type Value = ();

    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "a column of {} numbers", self.rows)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut numbers: A) -> Result<(), A::Error> {
        let mut row = 0;
        while let Some(number) = numbers.next_element::<f32>()? {
            row += 1;
            if row > self.rows {
                break;
            }
            self.values.push(number);
        }
        match row == self.rows {
            true => Ok(()),
            false => Err(A::Error::invalid_length(row as usize, &self)),
        }
    }
}

impl<'de> DeserializeSeed<'de> for Column<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, from: D) -> Result<(), D::Error> {
        from.deserialize_seq(self)
    }
}

/// Reads an image in JSON of `expected` columns and rows.
///
/// # Errors
/// See [`ImageError`]. No more values are kept than are expected, nor than the body has.
pub fn image_json(body: &[u8], expected: [u32; 2]) -> Result<AlpacaImage, ImageError> {
    let wrong = |error: serde_json::Error| {
        format!("the image is no JSON of Alpaca ({error}): {}", super::answer::excerpt(body))
    };
    let envelope: Envelope<IgnoredAny> = serde_json::from_slice(body).map_err(wrong)?;
    if envelope.error_number != 0 {
        let message = envelope.error_message.unwrap_or_default();
        return Err(ImageError::Said(envelope.error_number, message));
    }
    check_size(expected.map(i64::from), expected)?;
    let mut values = Vec::new();
    let mut reader = serde_json::Deserializer::from_slice(body);
    let pixels = Pixels { expected, values: &mut values };
    reader.deserialize_map(pixels).and_then(|()| reader.end()).map_err(wrong)?;
    if values.len() != expected[0] as usize * expected[1] as usize {
        return Err("the answer has no image".to_owned().into());
    }
    let all = values.iter().map(|&value| f64::from(value));
    let pixels = adu(all, expected.map(|n| n as usize))?;
    let client = u32::try_from(envelope.client_transaction).unwrap_or(0);
    Ok(AlpacaImage { pixels, client_transaction: client })
}

fn check_size(size: [i64; 2], expected: [u32; 2]) -> Result<(), String> {
    let [columns, rows] = size;
    if expected.contains(&0) || size != expected.map(i64::from) {
        return Err(format!(
            "the frame has {columns} × {rows} pixels, expected {} × {}",
            expected[0], expected[1]
        ));
    }
    Ok(())
}

/// Pixels from values of which the row runs fastest.
fn adu(values: impl Iterator<Item = f64>, size: [usize; 2]) -> Result<Array2<u16>, String> {
    let [columns, rows] = size;
    let mut pixels = Array2::zeros((rows, columns));
    for (i, value) in values.enumerate() {
        let (column, row) = (i / rows, i % rows);
        let whole = value.round();
        if !(0.0..=65_535.0).contains(&whole) {
            return Err(format!(
                "the pixel of column {column}, row {row} is {value}, expected 0 to 65535 ADU"
            ));
        }
        if let Some(pixel) = pixels.get_mut((row, column)) {
            *pixel = whole as u16;
        }
    }
    Ok(pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: written by hand: two columns of three rows, the first index the column.
    #[test]
    fn an_image_in_json_is_read_and_no_more_of_it_than_was_asked_for() {
        let body = |value: &str| {
            format!(
                r#"{{"Type":2,"Rank":2,"Value":{value},"ClientTransactionID":7,"ErrorNumber":0}}"#
            )
        };
        let read = |value: &str| image_json(body(value).as_bytes(), [2, 3]);
        let image = read("[[1,2,3],[4,5,6]]").unwrap();
        assert_eq!(image.pixels, ndarray::arr2(&[[1, 4], [2, 5], [3, 6]]));
        assert_eq!(image.client_transaction, 7);
        let empty = format!("[{}[]]", "[],".repeat(100_000));
        for bad in [
            "[[1,2,3],[4,5,6],[7,8,9]]",
            "[[1,2,3]]",
            "[[1,2,3,4],[5,6,7,8]]",
            "[[1,2],[3,4]]",
            "[1,2,3]",
            "[[[1],[2],[3]]]",
            "7",
            "null",
            &empty,
        ] {
            assert!(matches!(read(bad), Err(ImageError::Unfit(_))), "{bad:.40}");
        }
        let none = br#"{"Type":2,"ErrorNumber":0}"#;
        assert!(matches!(image_json(none, [2, 3]), Err(ImageError::Unfit(_))));
        assert!(matches!(image_json(none, [0, 3]), Err(ImageError::Unfit(_))));
    }
}
