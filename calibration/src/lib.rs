//! From what was recorded to what it means: linear rates, calibrated light curves, materials, fits.
//! Stands on `sunglint-simulator`. No file, no device, no clock: what comes in and goes out is in memory.
//!
//! In the order in which data flows through it:
//!
//! - [`track`]: where the target stood on the camera's frame, and when;
//! - [`photometry`]: from frames to rates of the target's planes, and its place: masks, detection, centroids, apertures, backgrounds;
//! - [`detector`]: dead time and other non-linearity, inverted with its uncertainty, and found in raw tags;
//! - [`counts`]: off-target stretches, linear rates, the fibre's gate and coupling;
//! - [`alignment`]: the fibre's field on the camera image;
//! - [`comparison`]: a measured curve beside a simulated one: scales, scatter, χ², ratios;
//! - [`stars`]: the night's coefficient per channel from stars;
//! - [`efficiency`]: a detector's counts per photon, against a photodiode;

pub mod alignment;
pub mod comparison;
pub mod counts;
pub mod detector;
pub mod efficiency;
pub mod photometry;
pub mod stars;
pub mod track;
