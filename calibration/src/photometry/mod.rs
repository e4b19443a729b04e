//! From a frame to the rates of a target and its place: masks, detection, centroids, apertures, backgrounds, errors.
//!
//! In the order in which data flows:
//!
//! - [`MasterFrame`], [`BadPixels`], [`FrameCalibration`]: what dark frames and a flat say about the sensor;
//! - [`Detector`]: the sources of a frame, and which of them is the target (area, fill, aspect, sharpness, offset);
//! - [`Centroid`]: where it is to a fraction of a pixel, with the covariance of that, and how wide;
//! - [`Aperture`], [`Background`]: sums with exact areas, less the clipped median of an annulus, for each plane of a colour mosaic;
//! - [`FrameReducer`]: all of it for frame after frame: a [`FrameMeasurement`] each, and a [`Tally`] of what each rule removed.
//!
//! [`field`] finds points and streaks on a single frame of any program.
//!
//! Places on a frame are `[column, row]` in pixels of the frame, the middle of its first pixel at (0, 0) (as in photutils and SEP).
//! Colours are measured on the pixels that sampled them; nothing is interpolated between colours.
//!
//! # A frame, measured
//!
//! A round star of 4 px FWHM and 50,000 ADU on a flat background of 100 ADU:
//!
//! ```
//! use hifitime::Epoch;
//! use ndarray::Array2;
//! use sunglint_calibration::photometry::{
//!     Expected, FrameCalibration, FrameReducer, PhotometryOptions,
//! };
//! use sunglint_formats::{fits::Header, frame::Frame};
//!
//! let sigma = 4.0 / (8.0 * 2f64.ln()).sqrt();
//! let pixels = Array2::from_shape_fn((64, 64), |(y, x)| {
//!     let r2 = (x as f64 - 31.0).powi(2) + (y as f64 - 33.0).powi(2);
//!     let star = 50_000.0 / (std::f64::consts::TAU * sigma * sigma) * (-0.5 * r2 / (sigma * sigma)).exp();
//!     // Whole numbers from −5 to 5 ADU stand for noise.
//!     (100.0 + star + ((7 * x + 13 * y) % 11) as f64 - 5.0).round() as u16
//! });
//! let frame = Frame {
//!     pixels,
//!     origin: [0, 0],
//!     binning: [1, 1],
//!     bayer: None,
//!     start: Epoch::from_gregorian_utc_at_midnight(2026, 11, 21),
//!     exposure_s: 2.0,
//!     gain_e_per_adu: Some(1.0),
//!     temperature_c: None,
//!     saturation_adu: Some(65_535.0),
//!     header: Header::default(),
//! };
//! let options = PhotometryOptions::new([64, 64], 5.0);
//! let mut reducer = FrameReducer::new(options, FrameCalibration::default())?;
//! let measured = reducer.measure(&frame, &Expected::default())?;
//! let place = measured.place_px.ok_or("no star")?;
//! assert!((place[0] - 31.0).abs() < 0.02 && (place[1] - 33.0).abs() < 0.02);
//! assert!((measured.planes[0].rate_adu_per_s / 25_000.0 - 1.0).abs() < 0.01);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod aperture;
mod background;
mod calibrate;
mod centroid;
mod detect;
pub mod field;
mod image;
mod levels;
mod look;
mod measurement;
mod options;
mod overlap;
mod quiet;
mod reducer;
mod regions;
mod scintillation;
mod smooth;
mod tiles;
mod window;

pub use background::Background;
pub use calibrate::{BadPixels, FrameCalibration, MasterFrame, PixelFault};
pub use centroid::Centroid;
pub use detect::{Candidate, Detection, Detector, Rejection};
pub use measurement::{Colour, FrameMeasurement, PlaneMeasurement, SigmaParts, Tally};
pub use options::{Choice, DetectionOptions, PhotometryOptions, Trail};
pub use overlap::Aperture;
pub(crate) use reducer::{Desk, Measured};
pub use reducer::{Expected, FrameReducer};
pub use scintillation::Scintillation;

/// Why a frame cannot be measured, or options cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PhotometryError {
    /// An option is out of its range.
    #[error("photometry: {name} is {value}, expected {expected}")]
    Option {
        /// Name of the option, with the unit.
        name: &'static str,
        /// Value of the option.
        value: f64,
        /// Values that are allowed.
        expected: &'static str,
    },
    /// No pixel of the frame is a number.
    #[error(
        "none of its {pixels} pixels is a number (all are NaN or infinite): there is nothing in this frame to be found; was it written whole, and are its BLANK, BZERO and BSCALE right?"
    )]
    NoNumber {
        /// Pixels of the frame.
        pixels: usize,
    },
    /// Neither the frame nor the options say how many electrons an ADU is.
    #[error(
        "the frame has no gain (EGAIN): give the camera's gain_e_per_adu; without it the noise of the target is not known"
    )]
    NoGain,
    /// An exposure of no length has no rate.
    #[error("the frame's exposure is {exposure_s} s, expected more than 0")]
    Exposure {
        /// Exposure that the frame states, s.
        exposure_s: f64,
    },
    /// Fewer frames than a mask or a mean needs.
    #[error("{found} frames, expected at least {needed} of them")]
    TooFew {
        /// Frames that were given.
        found: usize,
        /// Frames that are needed.
        needed: usize,
    },
    /// A dark, a flat or a mask is of another part of the sensor, or binned otherwise.
    #[error(
        "the {what} covers sensor columns {covered_columns:?} and rows {covered_rows:?} with binning {covered_binning:?}, the frame needs \
         columns {columns:?} and rows {rows:?} with binning {binning:?}: take calibration frames of the frame's own region and binning"
    )]
    OtherRegion {
        /// Calibration frame that does not fit: `dark`, `flat` or `mask`.
        what: &'static str,
        /// Unbinned columns that it covers: first, and one past the last.
        covered_columns: [u32; 2],
        /// Unbinned rows that it covers.
        covered_rows: [u32; 2],
        /// Binning of the calibration frame.
        covered_binning: [u32; 2],
        /// Unbinned columns of the frame.
        columns: [u32; 2],
        /// Unbinned rows of the frame.
        rows: [u32; 2],
        /// The frame's binning.
        binning: [u32; 2],
    },
    /// A dark of another exposure cannot be subtracted.
    #[error(
        "the dark was exposed {dark_s} s, the frame {frame_s} s: take darks of the same exposure, or subtract a bias"
    )]
    DarkExposure {
        /// Exposure of the dark, s.
        dark_s: f64,
        /// Exposure of the frame, s.
        frame_s: f64,
    },
}
