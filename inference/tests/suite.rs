//! All tests of this crate: one program, so that one is linked.

mod attitude_search;
mod range;
mod solver;
