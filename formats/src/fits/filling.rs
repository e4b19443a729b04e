//! A new file that is filled row by row.

use super::BLOCK;
use super::image::{Image, Pixels, encode};
use super::writer::{empty_primary, image_head, table_head};
use crate::error::EncodeError;
use crate::table::Table;
use std::io::{self, Seek, SeekFrom, Write};

/// Why a file was not filled.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FillingError {
    /// A value that FITS cannot hold, or rows that do not belong to the HDU.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// The system refuses.
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// The HDUs of a file whose numbers of rows are known before the rows are.
///
/// ```
/// use ndarray::{array, Array2};
/// use sunglint_formats::fits::{Header, Image, Layout, Pixels, Writer};
///
/// let image = |pixels: Array2<f64>| Image { header: Header::default(), pixels: Pixels::F64(pixels.into_dyn()) };
/// let mut layout = Layout::default();
/// layout.image(&image(Array2::zeros((0, 2))), 3)?;
/// let mut filling = layout.begin(std::io::Cursor::new(Vec::new()))?;
/// filling.pixels(0, &image(array![[1.0, 2.0]]).pixels)?;
/// filling.pixels(0, &image(array![[3.0, 4.0], [5.0, 6.0]]).pixels)?;
/// let mut writer = Writer::new();
/// writer.image(&image(array![[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]))?;
/// assert_eq!(filling.finish()?.into_inner(), writer.into_bytes());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct Layout {
    heads: Vec<(u64, Vec<u8>)>,
    areas: Vec<Area>,
    end: u64,
}

/// The data of one HDU.
#[derive(Debug, Clone)]
struct Area {
    at: u64,
    row_bytes: usize,
    rows: usize,
    done: usize,
    /// Least width of texts in a table.
    text_width: usize,
}

impl Area {
    fn bytes(&self) -> u64 {
        self.row_bytes as u64 * self.rows as u64
    }
}

impl Layout {
    /// Adds an image of the width and the kind of this one, with so many rows (the first axis of its shape). Otherwise as [`Writer::image`](super::Writer::image).
    ///
    /// # Errors
    /// A header that FITS cannot hold.
    pub fn image(&mut self, like: &Image, rows: usize) -> Result<(), EncodeError> {
        let (bitpix, zero, _) = encode(&like.pixels);
        let mut shape = like.pixels.shape().to_vec();
        let Some(first) = shape.first_mut() else {
            return Err(EncodeError::new("NAXIS", "no axis", "rows"));
        };
        *first = rows;
        let head = image_head(self.heads.is_empty(), (bitpix, zero), &shape, &like.header)?;
        let width: usize = shape[1..].iter().product();
        self.push(head, width * bitpix.unsigned_abs() as usize / 8, rows, 0);
        Ok(())
    }

    /// Adds a table with the columns and the metadata of this one and so many rows, in which no text is longer than `text_width`. Otherwise as [`Writer::table`](super::Writer::table).
    ///
    /// # Errors
    /// A table that FITS cannot hold.
    pub fn table(
        &mut self,
        like: &Table,
        name: &str,
        rows: usize,
        text_width: usize,
    ) -> Result<(), EncodeError> {
        if self.heads.is_empty() {
            // It has no data, but a number as every HDU.
            self.push(empty_primary()?, 0, 0, 0);
        }
        let columns = super::table_out::encode(like, text_width)?;
        let head = table_head(&columns, rows, &like.meta, name)?;
        self.push(head, columns.row_bytes, rows, text_width);
        Ok(())
    }

    fn push(&mut self, head: Vec<u8>, row_bytes: usize, rows: usize, text_width: usize) {
        let at = self.end + head.len() as u64;
        let area = Area { at, row_bytes, rows, done: 0, text_width };
        self.heads.push((self.end, head));
        self.end = (at + area.bytes()).next_multiple_of(BLOCK as u64);
        self.areas.push(area);
    }

    /// Writes the headers.
    ///
    /// # Errors
    /// The system's refusal.
    pub fn begin<W: Write + Seek>(self, mut out: W) -> io::Result<Filling<W>> {
        for (at, head) in &self.heads {
            out.seek(SeekFrom::Start(*at))?;
            out.write_all(head)?;
        }
        Ok(Filling { out, areas: self.areas })
    }
}

/// A file of a [`Layout`] that is being filled.
#[derive(Debug)]
pub struct Filling<W> {
    out: W,
    areas: Vec<Area>,
}

impl<W: Write + Seek> Filling<W> {
    /// Adds the next rows of an image, by the number of its HDU.
    ///
    /// # Errors
    /// Rows of another width, or more than there is room for; the system's refusal.
    pub fn pixels(&mut self, hdu: usize, pixels: &Pixels) -> Result<(), FillingError> {
        self.rows(hdu, pixels.shape().first().copied().unwrap_or(0), &encode(pixels).2)
    }

    /// Adds the next rows of a table, by the number of its HDU.
    ///
    /// # Errors
    /// The errors of [`Filling::pixels`]; a table that FITS cannot hold.
    pub fn table(&mut self, hdu: usize, table: &Table) -> Result<(), FillingError> {
        let text_width = self.areas.get(hdu).map_or(0, |area| area.text_width);
        let columns = super::table_out::encode(table, text_width)?;
        self.rows(hdu, columns.rows, &columns.data)
    }

    fn rows(&mut self, hdu: usize, rows: usize, bytes: &[u8]) -> Result<(), FillingError> {
        let wrong = |found: String, expected: String| {
            Err(EncodeError::new(format!("HDU {hdu}"), found, expected).into())
        };
        let Some(area) = self.areas.get_mut(hdu) else {
            return wrong("no such HDU".into(), "one of the layout".into());
        };
        if bytes.len() != rows * area.row_bytes {
            let found = format!("{rows} rows of {} bytes together", bytes.len());
            return wrong(found, format!("{} bytes a row", area.row_bytes));
        }
        if rows > area.rows - area.done {
            return wrong(format!("{} rows", area.done + rows), format!("{}", area.rows));
        }
        let at = area.at + area.done as u64 * area.row_bytes as u64;
        self.out.seek(SeekFrom::Start(at))?;
        self.out.write_all(bytes)?;
        area.done += rows;
        Ok(())
    }

    /// Fills the last block of each HDU.
    ///
    /// # Errors
    /// An HDU whose rows are not all there; the system's refusal.
    pub fn finish(mut self) -> Result<W, FillingError> {
        for (hdu, area) in self.areas.iter().enumerate() {
            if area.done != area.rows {
                let expected = format!("{}", area.rows);
                let found = format!("{} rows", area.done);
                return Err(EncodeError::new(format!("HDU {hdu}"), found, expected).into());
            }
            let end = area.at + area.bytes();
            let fill = end.next_multiple_of(BLOCK as u64) - end;
            self.out.seek(SeekFrom::Start(end))?;
            self.out.write_all(&vec![0; fill as usize])?;
        }
        Ok(self.out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fits::{Header, Writer};
    use crate::table::Column;
    use ndarray::Array2;
    use std::io::Cursor;

    fn image(from: usize, to: usize) -> Image {
        let value = |(i, j): (usize, usize)| (from + i) as f32 + 0.5 * j as f32;
        let pixels = Pixels::F32(Array2::from_shape_fn((to - from, 3), value).into_dyn());
        let mut header = Header::default();
        header.set("EXTNAME", "ERRORS", "");
        Image { header, pixels }
    }

    fn table(from: usize, to: usize) -> Table {
        let text = (from..to).map(|i| "x".repeat(i % 5)).collect();
        let number = (from..to).map(|i| i as f64).collect();
        let columns = vec![Column::text("name", text), Column::f64("t", Some("s"), number)];
        Table { columns, ..Table::default() }
    }

    /// Truth: the file that is written at once, byte for byte.
    #[test]
    fn a_file_that_is_filled_is_the_file_that_is_written() {
        let mut writer = Writer::new();
        writer.table(&table(0, 1000), "FIRST").unwrap();
        writer.image(&image(0, 1000)).unwrap();
        writer.table(&table(0, 7), "LAST").unwrap();
        let known = writer.into_bytes();
        let mut layout = Layout::default();
        layout.table(&table(0, 1), "FIRST", 1000, 4).unwrap();
        layout.image(&image(0, 0), 1000).unwrap();
        layout.table(&table(0, 1), "LAST", 7, 4).unwrap();
        let mut filling = layout.begin(Cursor::new(Vec::new())).unwrap();
        for from in (0..1000).step_by(300) {
            let to = (from + 300).min(1000);
            filling.pixels(2, &image(from, to).pixels).unwrap();
            filling.table(1, &table(from, to)).unwrap();
        }
        filling.table(3, &table(0, 7)).unwrap();
        assert!(filling.finish().unwrap().into_inner() == known);
    }

    #[test]
    fn rows_that_do_not_belong_are_refused() {
        let mut layout = Layout::default();
        layout.image(&image(0, 0), 4).unwrap();
        layout.table(&table(0, 1), "T", 2, 1).unwrap();
        let mut filling = layout.begin(Cursor::new(Vec::new())).unwrap();
        let message = |e: FillingError| e.to_string();
        let wide = Pixels::F32(Array2::zeros((1, 4)).into_dyn());
        assert!(message(filling.pixels(0, &wide).unwrap_err()).contains("12 bytes a row"));
        filling.pixels(0, &image(0, 3).pixels).unwrap();
        let more = message(filling.pixels(0, &image(3, 5).pixels).unwrap_err());
        assert!(more.contains("5 rows") && more.contains("expected 4"), "{more}");
        // A text that is wider than was said.
        assert!(message(filling.table(1, &table(3, 5)).unwrap_err()).contains("bytes a row"));
        let less = message(filling.finish().unwrap_err());
        assert!(less.contains("3 rows") && less.contains("expected 4"), "{less}");
    }
}
