//! All tests of this crate: one program, so that one is linked.

mod fuzz;
mod geometry;
mod motion;
mod orbit_eclipse;
mod orbit_elements;
mod orbit_ephemeris;
mod orbit_places;
mod orbit_tle;
mod orbit_vallado;
mod passes;
