//! FITS: no panic, bounded memory, and a table that is read and written again reads the same.

use sunglint_formats::Frame;
use sunglint_formats::fits::{Fits, Writer};
use sunglint_formats::image_frame::ImageFrame;

/// Tries one input.
pub fn run(bytes: &[u8]) {
    let Ok(fits) = Fits::from_bytes("x", bytes.to_vec()) else { return };
    let _ = Frame::from_fits(&fits);
    let _ = ImageFrame::from_fits(&fits);
    for i in 0..fits.hdus().len() {
        if let Ok(image) = fits.image(i) {
            let mut writer = Writer::new();
            if writer.image(&image).is_ok() {
                let again =
                    Fits::from_bytes("x", writer.into_bytes()).expect("what we write, we read");
                let again = again.image(0).expect("what we write, we read");
                assert_eq!(format!("{:?}", again.pixels), format!("{:?}", image.pixels));
            }
        }
        if let Ok(table) = fits.table(i) {
            let mut writer = Writer::new();
            if writer.table(&table, "").is_ok() {
                let again =
                    Fits::from_bytes("x", writer.into_bytes()).expect("what we write, we read");
                let again = again.table(1).expect("what we write, we read");
                assert_eq!(again.rows(), table.rows());
            }
        }
    }
}
