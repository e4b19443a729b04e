//! Simulation of a satellite pass in every spectral channel. Stands on `sunglint-radiometry`.
//!
//! In the order in which data flows through it:
//!
//! - [`attitude`]: inertial, spinning, tumbling, orbit-following and Sun-facing bodies;
//! - [`mesh`]: triangles from OBJ, PLY, STL, glTF and built-in bodies, and what is wrong with them;
//! - [`surface`]: how a material reflects, as a few spectra times a few weights;
//! - [`target`]: a body made of parts, each a shape with a material in its place, and the hinges that move them;
//! - [`light`]: the engine that turns a lit and seen body into one weight per material spectrum;
//! - [`intensity`]: the light of a body for directions that are given;
//! - [`picture`]: the body as it looks, and maps of its light over directions;
//! - [`ranging`]: lasers, photons per shot and how they are spread over depth;
//! - [`pass`]: all of it along a pass, to spectra, magnitudes and count rates;
//! - [`scenes`]: bodies and directions on which light engines are compared, with independent truths;
//! - [`sightings`]: passes that can be seen from a station, and how bright they are;
//! - [`mod@bench`]: error against time of the light engines on them.
//!
//! # Frames and conventions
//! Positions and directions in space are GCRS axes, metres. A body's attitude is the rotation from its own axes to the GCRS, written
//! `body_to_gcrs = [w, x, y, z]` in files ([`glam::DQuat`] keeps x, y, z, w). A surface's own axes are x along its tangent, z along its
//! outward normal. Directions on a surface point away from it: towards the Sun, towards the observer.

pub mod attitude;
pub mod bench;
pub mod intensity;
pub mod light;
pub mod mesh;
pub mod pass;
pub mod picture;
pub mod ranging;
pub mod scenes;
pub mod sightings;
pub mod surface;
pub mod target;
