//! Pictures inside an SVG, which the drawing library cannot put there: it draws a stand-in of a colour that nothing else has.

use super::{PlotError, RGBColor};
use image::RgbaImage;
use std::cell::RefCell;
use std::io::Cursor;

/// The pictures of a drawing, in the order in which they were added.
#[derive(Debug, Default)]
pub(super) struct Rasters(RefCell<Vec<String>>);

impl Rasters {
    /// Keeps a picture, and gives the colour in which a rectangle is to stand for it.
    pub fn add(&self, picture: &RgbaImage) -> Result<RGBColor, PlotError> {
        let mut bytes = Cursor::new(Vec::new());
        picture
            .write_to(&mut bytes, image::ImageFormat::Png)
            .map_err(|e| PlotError::Draw(e.to_string()))?;
        let mut all = self.0.borrow_mut();
        all.push(base64(&bytes.into_inner()));
        let number = u8::try_from(all.len())
            .map_err(|_| PlotError::Draw("more than 255 fields in one figure".into()))?;
        Ok(RGBColor(1, 2, number))
    }

    /// The text of an SVG with the pictures where their rectangles stood.
    pub fn put_into(self, mut svg: String) -> String {
        for (i, picture) in self.0.into_inner().iter().enumerate() {
            let colour = format!("fill=\"#0102{:02X}\"", i + 1);
            let Some(at) = svg.find(&colour) else { continue };
            let (Some(from), Some(to)) = (svg[..at].rfind("<rect "), svg[at..].find("/>")) else {
                continue;
            };
            let Some(place) = svg[from..at].find(" opacity") else { continue };
            let place = svg[from + "<rect".len()..from + place].to_owned();
            let image = format!(
                "<image{place} preserveAspectRatio=\"none\" href=\"data:image/png;base64,{picture}\"/>"
            );
            svg.replace_range(from..at + to + "/>".len(), &image);
        }
        svg
    }
}

/// Returns bytes as base64 (RFC 4648, padded).
///
/// ```
/// // RFC 4648, section 10.
/// assert_eq!(sunglint_report::plot::base64(b"foobar"), "Zm9vYmFy");
/// assert_eq!(sunglint_report::plot::base64(b"f"), "Zg==");
/// ```
pub fn base64(bytes: &[u8]) -> String {
    base64::Engine::encode(&base64::prelude::BASE64_STANDARD, bytes)
}
