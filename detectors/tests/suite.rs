//! All tests of this crate: one program, so that one is linked.

mod drift;
mod efficiency;
mod linearity;
