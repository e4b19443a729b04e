//! The Sun's disc: limb darkening, lobes and mirrors as narrow as it, horizons, spheres, shadows and eclipses.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

mod composite;
mod eclipse;
mod facets;
mod kit;
mod law;
mod merged;
mod scenes;
mod spheres;
