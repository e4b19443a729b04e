//! A result in all its forms, and the bytes of each.

use crate::plot::gallery::Gallery;
use crate::plot::{Figure, PlotError};
use serde::Serialize;
use serde_json::Value;
use sunglint_formats::fits::ascii_json;
use sunglint_formats::{EncodeError, Meta, Table, ecsv};

/// A form that a result can be written in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Format {
    /// The table, as ECSV.
    Ecsv,
    /// The columns of the table alone.
    Csv,
    /// The table, or what else the result has for it, as FITS.
    Fits,
    /// The summary, as JSON.
    Json,
    /// The page.
    Html,
    /// The picture in pixels.
    Png,
    /// The picture in lines.
    Svg,
}

impl Format {
    /// Returns the format of files with this extension (without the dot, in small letters).
    ///
    /// ```
    /// use sunglint_report::Format;
    ///
    /// assert_eq!(Format::of_extension("svg"), Some(Format::Svg));
    /// assert_eq!(Format::of_extension("docx"), None);
    /// ```
    pub fn of_extension(extension: &str) -> Option<Self> {
        Some(match extension {
            "ecsv" => Format::Ecsv,
            "csv" => Format::Csv,
            "fits" | "fit" => Format::Fits,
            "json" => Format::Json,
            "html" | "htm" => Format::Html,
            "png" => Format::Png,
            "svg" => Format::Svg,
            _ => return None,
        })
    }
}

/// Why a result cannot be written in a form.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProductError {
    /// The result has no figure.
    #[error("`{name}` has no figure; write it as .ecsv")]
    NoFigure {
        /// The result's name.
        name: String,
    },
    /// The result has no page.
    #[error("`{name}` has no page; write it as .ecsv")]
    NoPage {
        /// The result's name.
        name: String,
    },
    /// The form is written by whoever makes the numbers, piece by piece.
    #[error("`{name}` is written while it is made, and not once more")]
    Streamed {
        /// The result's name.
        name: String,
    },
    /// The picture cannot be drawn.
    #[error(transparent)]
    Plot(#[from] PlotError),
    /// The table cannot be written.
    #[error(transparent)]
    Table(#[from] EncodeError),
    /// The summary cannot be written.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
}

/// A result in all its forms: the same numbers as table, figure, page and JSON.
#[derive(Debug, Clone, Default)]
pub struct Product {
    /// The file name without extension when it goes into a folder.
    pub name: String,
    /// The numbers; without columns where there is no table.
    pub table: Table,
    /// The picture.
    pub figure: Option<Figure>,
    /// Pictures in its place.
    pub gallery: Option<Gallery>,
    /// Bytes of a FITS file where that holds something else than the table.
    pub fits: Option<Vec<u8>>,
    /// The page to read in a browser.
    pub html: Option<String>,
    /// Forms that are written while the numbers are made, piece by piece ([`crate::TableRows`]): nothing of them is here.
    pub streamed: Vec<Format>,
    /// The summary with documented keys.
    pub json: Value,
    /// Other products: a folder gets them too, with the names of their own.
    pub others: Vec<Product>,
}

impl Product {
    /// The extensions under which it goes into a folder.
    ///
    /// ```
    /// use sunglint_report::plot::Figure;
    /// use sunglint_report::{Format, Product};
    ///
    /// let figure = Figure { title: "Empty".into(), panels: Vec::new() };
    /// let product = Product {
    ///     name: "pass".into(),
    ///     figure: Some(figure),
    ///     json: serde_json::json!({"samples": 3}),
    ///     ..Product::default()
    /// };
    /// assert_eq!(product.extensions().collect::<Vec<_>>(), ["png", "svg"]);
    /// let written: serde_json::Value = serde_json::from_slice(&product.encode(Format::Json)?)?;
    /// assert_eq!(written["samples"], 3);
    /// // There is no page.
    /// assert!(product.encode(Format::Html).is_err());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn extensions(&self) -> impl Iterator<Item = &'static str> {
        let streams = |format| self.streamed.contains(&format);
        let has_table = !self.table.columns.is_empty() || streams(Format::Ecsv);
        let table = has_table.then_some(&["ecsv"][..]);
        let drawn = self.figure.is_some() || self.gallery.is_some();
        let figure = drawn.then_some(&["png", "svg"][..]);
        // Beside a table a FITS file holds something else, which has its own place among the others.
        let has_fits = self.fits.is_some() || streams(Format::Fits);
        let fits = (table.is_none() && has_fits).then_some(&["fits"][..]);
        let html = self.html.is_some().then_some(&["html"][..]);
        [table, fits, figure, html].into_iter().flatten().flatten().copied()
    }

    /// Returns the bytes of a file in that form.
    ///
    /// # Errors
    /// A form that the result does not have, a table or figure that cannot be written.
    pub fn encode(&self, format: Format) -> Result<Vec<u8>, ProductError> {
        if self.streamed.contains(&format) {
            return Err(ProductError::Streamed { name: self.name.clone() });
        }
        let figure = || {
            let missing = || ProductError::NoFigure { name: self.name.clone() };
            self.figure.as_ref().ok_or_else(missing)
        };
        Ok(match format {
            Format::Ecsv => ecsv::to_string(&self.table)?.into_bytes(),
            Format::Csv => plain_csv(&self.table)?,
            Format::Fits if self.fits.is_some() => self.fits.clone().unwrap_or_default(),
            Format::Fits => {
                let mut writer = sunglint_formats::fits::Writer::new();
                let table = Table {
                    meta: flat_meta(&self.table.meta),
                    columns: self.table.columns.clone(),
                };
                writer.table(&table, &self.name.to_uppercase())?;
                writer.into_bytes()
            }
            Format::Json => {
                let mut text = serde_json::to_vec_pretty(&self.json)?;
                text.push(b'\n');
                text
            }
            Format::Html => match &self.html {
                Some(page) => page.clone().into_bytes(),
                None => return Err(ProductError::NoPage { name: self.name.clone() }),
            },
            Format::Png => match &self.gallery {
                Some(gallery) => gallery.png()?,
                None => figure()?.png()?,
            },
            Format::Svg => match &self.gallery {
                Some(gallery) => gallery.svg()?.into_bytes(),
                None => figure()?.svg()?.into_bytes(),
            },
        })
    }
}

/// Metadata as a FITS header holds them: what is nested becomes JSON under a keyword of eight letters (`flag_bits` is `FLAGBITS`, `provenance`
/// is `PROVENAN`, as in spectral light curves).
fn flat_meta(meta: &Meta) -> Meta {
    let flat = |(key, value): (&String, &Value)| match value {
        Value::Object(_) | Value::Array(_) => {
            let letters = key.chars().filter(char::is_ascii_alphanumeric).take(8);
            let keyword: String = letters.map(|c| c.to_ascii_uppercase()).collect();
            (keyword, Value::String(ascii_json(value)))
        }
        plain => (key.clone(), plain.clone()),
    };
    meta.iter().map(flat).collect()
}

/// The columns alone, for programs that know no ECSV.
fn plain_csv(table: &Table) -> Result<Vec<u8>, EncodeError> {
    let text = ecsv::to_string(table)?;
    let body: Vec<&str> = text.lines().skip_while(|l| l.starts_with('#')).collect();
    Ok((body.join("\n") + "\n").into_bytes())
}

/// A value as JSON: structs, texts, numbers (null where not finite) and lists of them always have one.
pub(crate) fn json_of(of: &(impl Serialize + ?Sized)) -> Value {
    serde_json::to_value(of).unwrap_or_default()
}
