//! Colours out of a mosaic.

use crate::error::{DEVICE, said, wrong};
use crate::mat;
use crate::picture::Planes;
use ndarray::Array2;
use opencv::core::Mat;
use opencv::imgproc;
use sunglint_drivers::device::DeviceError;
use sunglint_formats::{Bayer, Frame};

/// OpenCV's name of a pattern is that of its second row and column: FITS' `RGGB` is OpenCV's `BayerBG`.
fn code(bayer: Bayer) -> i32 {
    match bayer {
        Bayer::Rggb => imgproc::COLOR_BayerBG2BGR,
        Bayer::Grbg => imgproc::COLOR_BayerGB2BGR,
        Bayer::Gbrg => imgproc::COLOR_BayerGR2BGR,
        Bayer::Bggr => imgproc::COLOR_BayerRG2BGR,
    }
}

/// Red, green and blue of each pixel of a mosaic, `[row, column]`, ADU: each colour where the sensor has it, the means of the
/// nearest pixels of that colour elsewhere (bilinear). OpenCV copies the outermost rows and columns from their neighbours.
/// For pictures; photometry sums the mosaic's own pixels.
///
/// # Errors
/// A frame without a pattern or with fewer than 4 × 4 pixels.
pub fn demosaic(frame: &Frame) -> Result<[Array2<u16>; 3], DeviceError> {
    let Some(bayer) = frame.bayer else {
        let reason = "the frame has no Bayer pattern: it is monochrome or binned";
        return Err(DeviceError::NotReady { device: DEVICE, reason });
    };
    let (rows, columns) = frame.pixels.dim();
    if rows < 4 || columns < 4 {
        return Err(wrong(format!(
            "a mosaic of {columns} × {rows} pixels, expected 4 × 4 or more"
        )));
    }
    let standard = frame.pixels.as_standard_layout();
    let pixels = standard.as_slice().unwrap_or_default();
    let failed = |error: opencv::Error| said("colours of a mosaic", &error);
    let mosaic =
        Mat::new_rows_cols_with_data(rows as i32, columns as i32, pixels).map_err(failed)?;
    let mut colours = Mat::default();
    imgproc::cvt_color_def(&mosaic, &mut colours, code(bayer)).map_err(failed)?;
    match mat::planes(&colours).map_err(wrong)? {
        (Planes::Bgr([blue, green, red]), _) => Ok([red, green, blue]),
        (Planes::Mono(_), _) => Err(wrong("OpenCV gave one plane for a mosaic")),
    }
}
