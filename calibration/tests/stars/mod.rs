//! The calibration by stars, on virtual nights whose truth is known.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

mod campaign;
mod few;
mod files;
mod hard;
mod sky;
