//! The Earth as a table of albedos: its light against sums over latitude and longitude that know nothing of the rule over the cap, and the files that tables come in.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

mod cap;
mod files;
mod fits;
mod light;
mod truth;
mod turning;
