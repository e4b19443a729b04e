//! The density of microfacet normals, from retro-reflection whose truth is a closed form.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

mod campaign;
mod cone;
mod diffuse;
mod files;
mod hard;
mod nodes;
mod runs;
mod truth;
