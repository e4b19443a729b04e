//! The photometry of frames against photutils and against frames rendered photon by photon.

#![expect(clippy::unwrap_used, reason = "a test that cannot run should stop")]

mod apertures;
mod bad_pixels;
mod detection;
mod hard_cases;
mod places;
mod render;
mod statistics;
