//! All tests of this crate: one program, so that one is linked.

mod attacks;
mod marks;
mod rework;
