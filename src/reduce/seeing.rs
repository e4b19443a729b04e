//! How wide points are on the frames of a stay: what the filters of the detection and the centroids go by.

use sunglint_calibration::photometry::{
    Expected, FrameCalibration, FrameReducer, PhotometryError, PhotometryOptions,
};
use sunglint_formats::session::FrameFile;

/// Frames of a stay that are looked at.
const LOOKS: usize = 9;
/// Widths that are tried, narrow ones first: a filter for wider points takes narrow ones for cosmic rays.
const TRIED_PX: [f64; 4] = [3.0, 6.0, 12.0, 24.0];
/// A width that was found this far above the one that was tried is not yet it: the window of the centroid was too narrow.
const WIDER: f64 = 1.3;

/// The median full width at half maximum of the target on some frames of a stay, px; `None` where fewer than half of them show one of a width
/// that is tried.
///
/// # Errors
/// Options out of their range.
pub fn fwhm_px(
    files: &[&FrameFile],
    options: &PhotometryOptions,
    calibration: &FrameCalibration,
) -> Result<Option<f64>, PhotometryError> {
    let step = files.len().div_ceil(LOOKS).max(1);
    // What cannot be read is told of when it is measured.
    let frames: Vec<_> = files.iter().step_by(step).filter_map(|file| file.read().ok()).collect();
    for tried_px in TRIED_PX {
        let options = PhotometryOptions { fwhm_px: tried_px, ..options.clone() };
        let mut reducer = FrameReducer::new(options, calibration.clone())?;
        let mut found: Vec<f64> = frames
            .iter()
            .filter_map(|frame| reducer.measure(frame, &Expected::default()).ok()?.fwhm_px)
            .filter(|fwhm_px| fwhm_px.is_finite() && *fwhm_px >= 0.5)
            .collect();
        found.sort_by(f64::total_cmp);
        if found.is_empty() || 2 * found.len() < frames.len() {
            continue;
        }
        let median = found[found.len() / 2];
        if median <= WIDER * tried_px {
            return Ok(Some(median));
        }
    }
    Ok(None)
}
