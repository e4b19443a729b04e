//! From measured values to a material.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

mod anisotropic;
mod assemble;
mod cases;
mod colour;
mod fit;
mod gallery;
mod ingest;
mod surface;
mod tables;
