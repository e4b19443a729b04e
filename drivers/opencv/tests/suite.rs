//! All tests of this crate: one program, so that one is linked.

mod bayer;
#[cfg(feature = "opencv")]
mod common;
mod films;
mod images;
mod live;
mod off;
