//! The fibre's field on the camera image: where a target must stand for its light to be counted.
//!
//! From the linear rates of stars (without gate and coupling: [`crate::counts::Gate`] with `most_q: None, divide: false`) at the places where the
//! frames saw them. [`fit_field`] fits a two-dimensional normal distribution, one amplitude per star, with what rates are off by and share: twinkling, and
//! the place between two frames; [`FieldMap`] is what was measured, cell by cell, with what the fit leaves of it: ghosts and a rim that no normal distribution has.
//! [`align`] does all of it from recorded sessions; [`fibre_file`] and [`read_fibres`] keep the fields.

mod correlated;
mod file;
mod fit;
mod map;
mod noise;
mod sessions;

pub use file::{fibre_file, read_fibres};
pub use fit::{FieldFit, FitError, FitOptions, Interval, fit_field};
pub use map::{Cell, FieldMap};
pub use sessions::{AlignError, AlignOptions, Alignment, CELL_PX, Field, align};

use crate::track::{NoPlace, Track};
use glam::DVec2;
use hifitime::{Duration, Epoch};

/// A rate of a star at a place. Points of a star stand in the order of time: what errs together is found by it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldPoint {
    /// The star's place from the frame's centre, px, as in [`crate::track::Place`]: the mean over the rate's bin.
    pub offset_px: DVec2,
    /// Variances of column and row and their covariance, px²: of what is not known of the place, and of the star's way within the bin. They spread the
    /// field.
    pub covariance_px2: [f64; 3],
    /// Rate of the star there, background subtracted, Hz.
    pub rate_hz: f64,
    /// Standard uncertainty, Hz, above 0: of the counts, without twinkling and place.
    pub sigma_hz: f64,
    /// Which star it is: each has its own amplitude.
    pub star: usize,
    /// The frames that the place comes from; `None` where each place is off for itself, by `covariance_px2`.
    pub between: Option<Between>,
}

/// A place on the way between two frames: places there are off together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Between {
    /// Number of the frame before, among the star's frames.
    pub frame: usize,
    /// Part of the way from that frame to the next, 0 to 1, at the middle of the rate's bin.
    pub part: f64,
    /// Time between the two frames, s.
    pub span_s: f64,
    /// Length of the rate's bin, s; shorter than the time between the frames.
    pub exposure_s: f64,
    /// Covariances of the places in the two frames (xx, yy, xy), px².
    pub frames_px2: [[f64; 3]; 2],
    /// Wander of the telescope off the line between frames, px²/s in each axis.
    pub wander_px2_per_s: f64,
}

/// A place of a star in a bin, as [`FieldPoint`] has it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Stand {
    offset_px: DVec2,
    covariance_px2: [f64; 3],
    between: Option<Between>,
}

impl Stand {
    /// Where a track has the star in a bin. `apart_s` and `wander_px2_per_s` are those of [`Track::at`].
    fn on(
        track: &Track,
        middle: Epoch,
        exposure_s: f64,
        apart_s: f64,
        wander_px2_per_s: f64,
    ) -> Result<Self, NoPlace> {
        let at = track.at(middle, apart_s, wander_px2_per_s)?;
        let around = track.around(middle, apart_s)?;
        let [from, to] = [-0.5, 0.5].map(|k| middle + Duration::from_seconds(k * exposure_s));
        // A bin that begins before the first frame has its place at its middle.
        let offset_px = mean_place(track, from, to, apart_s).unwrap_or(at.place.offset_px);
        let [xx, yy, xy] = at.place.covariance_px2;
        let [dx, dy] = at.drift_px_per_s.to_array();
        // A way of length l, passed evenly, has the variance l²/12.
        let way_s2 = exposure_s * exposure_s / 12.0;
        let covariance_px2 = [xx + dx * dx * way_s2, yy + dy * dy * way_s2, xy + dx * dy * way_s2];
        let between = (exposure_s < around.span_s).then_some(Between {
            frame: around.before,
            part: around.part,
            span_s: around.span_s,
            exposure_s,
            frames_px2: around.covariances_px2,
            wander_px2_per_s,
        });
        Ok(Self { offset_px, covariance_px2, between })
    }
}

/// The mean place over a time, of a track that is straight from frame to frame.
fn mean_place(track: &Track, from: Epoch, to: Epoch, apart_s: f64) -> Result<DVec2, NoPlace> {
    let first = track.points.partition_point(|p| p.time <= from);
    let frames = track.points[first..].iter().map(|p| p.time).take_while(|time| *time < to);
    let (mut sum, mut start) = (DVec2::ZERO, from);
    for end in frames.chain([to]) {
        let length_s = (end - start).to_seconds();
        let middle = start + Duration::from_seconds(0.5 * length_s);
        sum += length_s * track.at(middle, apart_s, 0.0)?.place.offset_px;
        start = end;
    }
    Ok(sum / (to - from).to_seconds())
}
