//! The light engine's laws and hard cases over random scenes.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

mod clipper;
mod hard;
mod hinges;
mod large;
mod large_hard;
mod laws;
mod near;
mod scenes;
mod spheres;
