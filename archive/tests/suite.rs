//! Tests of the archive.
#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

mod index;
