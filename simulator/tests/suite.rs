//! All tests of this crate: one program, so that one is linked.

mod attitude;
mod attitude_file;
mod average;
mod bounce;
mod curved;
mod derivative;
mod disc;
mod earth;
mod engine;
mod intensity;
mod light;
mod light_exact;
mod light_rays;
mod materials;
mod mesh_files;
mod mesh_shapes;
mod observations;
mod pass;
mod picture;
mod ranging;
mod shine;
mod surface;
mod surface_sphere;
mod target;
mod target_peer;
mod thin;
