//! Derivatives of the direct light: closed forms, another program's sums, and differences of the exact sum.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

mod bodies;
mod differences;
mod forms;
mod hard;
mod materials;
mod peer;
