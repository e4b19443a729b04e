//! Samples on the body's frame.
//!
//! A sample stands where its *phase vector*, the bisector of the directions to Sun and observer, meets the body: at a longitude and a latitude of the body's axes (thesis
//! section 7.3). At phase angle 0, with a laser, that place and the sample are one; under the Sun the phase angle and the turn about the phase vector count as well, and a map is a summary.
//!
//! In the order in which data flows through it:
//!
//! - [`phase_vector`], [`longitude_latitude`]: where a sample stands;
//! - [`Grid`]: cells; [`BodyMap`]: what samples have in each cell, with their number and scatter, and NaN where there is none;
//! - [`BodyMap::at`]: the value between the middles of cells: a curve from a map;
//! - [`Spin`], [`quality`], [`scan`]: how well samples agree with one another on the body's frame, for a body of unknown shape.

mod grid;
mod quality;

pub use grid::{
    BodyMap, Coverage, Grid, GridError, Interpolated, longitude_latitude, phase_vector,
};
pub use quality::{Quality, QualityError, Sighting, Spin, quality, scan};
