//! All tests of this crate: one program, so that one is linked.

mod goniometer;
mod observatory;
mod rig;
