//! All tests of this crate: one program, so that one is linked.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

mod bayer;
#[cfg(feature = "opencv")]
mod common;
mod fields;
mod films;
mod images;
mod live;
mod off;
