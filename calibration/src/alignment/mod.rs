//! The fibre's field on the camera image: where a target must stand for its light to be counted.
//!
//! From the linear rates of stars (without gate and coupling: [`crate::counts::Gate`] with `most_q: None, divide: false`) at the places where the
//! frames saw them. [`fit_field`] fits a two-dimensional normal distribution, one amplitude per star; [`FieldMap`] is what was
//! measured, cell by cell, with what the fit leaves of it: ghosts and a rim that no normal distribution has.
//! [`align`] does all of it from recorded sessions; [`fibre_file`] and [`read_fibres`] keep the fields.

mod correlated;
mod file;
mod fit;
mod map;
mod sessions;

pub use file::{fibre_file, read_fibres};
pub use fit::{FieldFit, FitError, FitOptions, fit_field};
pub use map::{Cell, FieldMap};
pub use sessions::{AlignError, AlignOptions, Alignment, CELL_PX, Field, align};

use crate::counts::Sample;
use glam::DVec2;

/// A rate of a star at a place. Points of a star stand in the order of time: what errs together is found by it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldPoint {
    /// The star's place from the frame's centre, px, as in [`crate::track::Place`].
    pub offset_px: DVec2,
    /// Variances of column and row and their covariance, px².
    pub covariance_px2: [f64; 3],
    /// Rate of the star there, background subtracted, Hz.
    pub rate_hz: f64,
    /// Standard uncertainty, Hz, above 0.
    pub sigma_hz: f64,
    /// Which star it is: each has its own amplitude.
    pub star: usize,
}

impl FieldPoint {
    /// The point of a channel, by its number, in a sample; `None` where there is no rate or no place. `star` numbers the target.
    pub fn of(sample: &Sample, channel: usize, star: usize) -> Option<Self> {
        let found = sample.channels.get(channel)?;
        let place = sample.place?;
        let good = found.rate_hz.is_finite() && found.sigma_hz > 0.0;
        good.then_some(Self {
            offset_px: place.offset_px,
            covariance_px2: place.covariance_px2,
            rate_hz: found.rate_hz,
            sigma_hz: found.sigma_hz,
            star,
        })
    }
}
