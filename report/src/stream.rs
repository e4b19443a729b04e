//! Tables that are written piece by piece.

use crate::Format;
use std::io::{self, Write};
use sunglint_formats::{EncodeError, Table, ecsv};

/// Why a piece was not written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TableRowsError {
    /// The table cannot be written in that form.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// The system refuses.
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// A table on its way into a file as ECSV or CSV: the same bytes as [`crate::Product::encode`] has for all rows together.
///
/// ```
/// use sunglint_formats::{Column, Table};
/// use sunglint_report::{Format, TableRows};
///
/// let piece = |values: Vec<f64>| Table { columns: vec![Column::f64("t", Some("s"), values)], ..Table::default() };
/// let mut rows = TableRows::new(Vec::new(), Format::Csv);
/// rows.push(&piece(vec![0.0, 1.0]))?;
/// rows.push(&piece(vec![2.0]))?;
/// assert_eq!(rows.into_inner(), b"t\n0.0\n1.0\n2.0\n");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct TableRows<W> {
    out: W,
    format: Format,
    begun: bool,
}

impl<W: Write> TableRows<W> {
    /// A table without rows yet; of any form but CSV it is ECSV.
    pub fn new(out: W, format: Format) -> Self {
        Self { out, format, begun: false }
    }

    /// Adds the rows of the next piece. What stands above the rows is that of the first piece.
    ///
    /// # Errors
    /// A table that cannot be written; the system's refusal.
    pub fn push(&mut self, piece: &Table) -> Result<(), TableRowsError> {
        let mut text = String::new();
        if !self.begun {
            let head = ecsv::head(piece)?;
            let columns = || head.lines().skip_while(|line| line.starts_with('#'));
            match self.format {
                Format::Csv => columns().for_each(|line| text.extend([line, "\n"])),
                _ => text = head,
            }
            self.begun = true;
        }
        ecsv::rows(piece, &mut text)?;
        Ok(self.out.write_all(text.as_bytes())?)
    }

    /// The file.
    pub fn get_ref(&self) -> &W {
        &self.out
    }

    /// The file, with all that was written.
    pub fn into_inner(self) -> W {
        self.out
    }
}
