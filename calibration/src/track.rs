//! Where the target stood on the camera's frame, and when: what the photometry of frames finds, and what the gating of counts needs.

use hifitime::Epoch;

/// The target in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackPoint {
    /// The middle of the exposure.
    pub time: Epoch,
    /// Length of the exposure, s.
    pub exposure_s: f64,
    /// Where the target was found; `None` where it was not.
    pub place: Option<Place>,
}

/// A place on a frame, with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Columns and rows from the middle of the camera's sensor, unbinned pixels: the origin of a fibre's
    /// [`offset_px`](sunglint_radiometry::station::Fibre::offset_px). Rows grow in the order of the file.
    pub offset_px: [f64; 2],
    /// Variances of column and row and their covariance, px².
    pub covariance_px2: [f64; 3],
}

/// The target in the frames of a stretch of time, in the order of time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Track {
    /// One point a frame.
    pub points: Vec<TrackPoint>,
}
