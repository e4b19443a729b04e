//! From measured values to a material.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

mod anisotropic;
mod assemble;
mod cases;
mod fit;
mod ingest;
mod surface;
