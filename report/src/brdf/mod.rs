//! A sample on a goniometer, from retro-reflection to a measured material.

pub mod assemble;
pub mod fit;
pub mod goniometer;
mod hemispheres;
pub mod ingest;
pub mod ndf;
pub mod page;
pub mod plan;
pub mod retro;
pub mod show;
pub mod surface;
