//! Unmixing against closed forms, SciPy and simulated bodies whose light is known.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]
#![allow(clippy::needless_range_loop, reason = "indices are those of matrices")]

mod campaign;
mod hard;
mod mixtures;
mod targets;
