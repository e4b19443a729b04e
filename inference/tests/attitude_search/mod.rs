//! Attitudes found in light whose attitude is known because it was simulated with it.
//!
//! The curves come from [`Pass::simulate`] with all effects (earthshine, the Sun's disc, light between parts) and noise drawn independently. Shared with the search are the engine's exact areas and
//! surface laws and the integrals over wavelength, which have truths of their own (another program's sums, rays, closed forms: the simulator's tests); not shared are the geometry of trials, which the
//! search makes by its own rotations, and everything but direct light.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

mod campaign;
mod cases;
mod forward;
mod made;
mod search;
