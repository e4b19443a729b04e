//! From photons to calibrated light curves: linear rates, the coefficient of a night, magnitudes. Does not see the simulator.
//!
//! The workflows, one function each, which read their files and report progress:
//!
//! - [`reduction`]: a recorded session as one linear light curve for each visit;
//! - [`apply`]: a linear light curve times the night's coefficient, magnitudes and irradiances.
//!
//! Modules of which they are made; these work in memory:
//!
//! - [`track`]: where the target stood on the camera's frame, and when;
//! - [`photometry`]: from frames to rates of the target's planes, and its place: masks, detection, centroids, apertures, backgrounds;
//! - [`detector`]: dead time and other non-linearity, inverted with its uncertainty, and found in raw tags;
//! - [`counts`]: off-target stretches, linear rates, the fibre's gate and coupling;
//! - [`alignment`]: the fibre's field on the camera image;
//! - [`comparison`]: a measured curve beside a simulated one: scales, scatter, χ², ratios;
//! - [`stars`]: the night's coefficient per channel from stars;
//! - [`efficiency`]: a detector's counts per photon, against a photodiode.

pub mod alignment;
pub mod apply;
pub mod comparison;
pub mod counts;
pub mod detector;
pub mod efficiency;
pub mod field_stars;
pub mod photometry;
pub mod reduction;
pub mod stars;
pub mod timing;
pub mod track;
