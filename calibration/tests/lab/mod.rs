//! The lab: what a power meter read becomes retro-reflection; what a detector counted becomes its efficiency.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

mod efficiency;
mod retro;
