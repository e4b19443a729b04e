//! Marks on a frame: where the reduction would find its target, and what it would measure there.

use crate::request::Answer;
use hifitime::Epoch;
use serde::Serialize;
use sunglint_calibration::photometry::{Expected, FrameCalibration, FrameReducer, PhotometryError};
use sunglint_calibration::reduction::frames::FrameOptions;
use sunglint_formats::Frame;
use sunglint_radiometry::light_curve::Flags;
use sunglint_radiometry::station::Station;

/// Target of a frame, as the reduction would measure it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct MarksView {
    /// Start of the frame, s after the session's start: marks of another frame are not drawn.
    start_s: f64,
    /// Column and row of the target; `None`: none found.
    place_px: Option<[f64; 2]>,
    aperture_px: f64,
    annulus_px: [f64; 2],
    fwhm_px: Option<f64>,
    candidates: usize,
    planes: Vec<PlaneView>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct PlaneView {
    colour: String,
    rate_adu_per_s: Option<f64>,
    sigma_adu_per_s: Option<f64>,
    background_adu: Option<f64>,
    flags: Vec<String>,
}

/// Finds and measures the target of a frame as the reduction does with the station's usual options, but without dark frames and with an aperture of 8 px.
pub(crate) fn marks(frame: &Frame, station: &Station, start: Epoch) -> Result<MarksView, Answer> {
    let wrong = |text: &str| Answer::error(422, text);
    let options = FrameOptions::for_station(station)
        .ok_or_else(|| wrong("the station of this session has no camera"))?;
    let (aperture_px, annulus_px) =
        (options.photometry.aperture_radius_px, options.photometry.annulus_px.to_array());
    let said = |error: PhotometryError| wrong(&error.to_string());
    let mut reducer =
        FrameReducer::new(options.photometry, FrameCalibration::default()).map_err(said)?;
    let measured = reducer.measure(frame, &Expected::default()).map_err(said)?;
    let finite = |value: f64| value.is_finite().then_some(value);
    let planes = measured.planes.iter().map(|plane| PlaneView {
        colour: format!("{:?}", plane.colour).to_lowercase(),
        rate_adu_per_s: finite(plane.rate_adu_per_s),
        sigma_adu_per_s: finite(plane.sigma.total()),
        background_adu: finite(plane.background_adu),
        flags: names(plane.flags),
    });
    Ok(MarksView {
        start_s: (frame.start - start).to_seconds(),
        place_px: measured.place_px.map(|place| place.to_array()),
        aperture_px,
        annulus_px,
        fwhm_px: measured.fwhm_px,
        candidates: measured.candidates,
        planes: planes.collect(),
    })
}

impl MarksView {
    /// Focus and background of the frame.
    pub fn look(&self) -> Look {
        let background_adu = self.planes.iter().find_map(|plane| plane.background_adu);
        Look { start_s: self.start_s, fwhm_px: self.fwhm_px, background_adu }
    }
}

/// Focus and background of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Look {
    /// Start of the frame, s after the session's start.
    pub start_s: f64,
    /// Width of the target at half of its height, px.
    pub fwhm_px: Option<f64>,
    /// Background of a pixel, ADU, of the first colour.
    pub background_adu: Option<f64>,
}

/// Names of flags.
fn names(flags: Flags) -> Vec<String> {
    flags.iter_names().map(|(name, _)| name.to_lowercase()).collect()
}
