//! Where satellites are, and when they can be seen.
//!
//! - [`orbit`]: TLE and SGP4, or a table of positions; eclipse by the Earth;
//! - [`geometry`]: where target, Sun and station stand at one moment, light time included;
//! - [`passes`]: when a target can be seen at all.

pub mod geometry;
pub mod orbit;
pub mod passes;
