//! Laser ranging: what of a pulse comes back from a body, and from how deep.
//!
//! A laser is a point source of one wavelength. On the way up its pulse spreads to a spot ([`Beam`]); a body in it sends light back as it does
//! sunlight, with the Sun in the laser's direction ([`crate::light`]); and of that a telescope gathers its area ([`Receiver`]).
//! With the fluence H \[J m⁻²\] at the body, the transmissions T of both ways and the range r, the photons that are detected of one shot are
//!
//! ```text
//! n̄ = H T_up Σ_k ρ_k(λ) W_k T_down A η λ/(hc r²)
//! ```
//!
//! in the mean, and at least one with the probability 1 − e^{−n̄}. Everything is *per shot*: the irradiance within a pulse
//! ([`Beam::peak_spectral_irradiance`], eq. A.3 of the thesis) is 10⁶ times and more the mean one.
//!
//! Laser and telescope may stand apart ([`Stand`]): then T_up, H and the directions are those of each, and r that of the telescope.
//!
//! - [`Shot::profile`]: how n̄ is spread over depth: facet by facet over the exact lit and seen polygons, each by the beam's profile across the body;
//! - [`Bounces`]: what the body's surfaces scatter to each other comes later, by light paths with their lengths;
//! - [`Returns`]: all of it along a simulated pass, beside the sunlight that the same channel counts;
//! - [`glint`]: a flat mirror, which returns the beam from the laser's image at twice the range.
//!
//! - [`Shots`]: single detections of a pass, drawn from all this with the receiver's noise, and [`NormalPoints`] of them, as stations deliver them;
//! - [`cubes`]: corner cubes, which return far more than all of a body's surface, beside where they were lit from.

mod beam;
mod bounces;
pub mod cubes;
pub mod glint;
mod normal_points;
mod profile;
mod returns;
mod shots;

pub use beam::{Beam, Receiver, detection_probability};
pub use bounces::{Bounced, Bounces, BouncesError, BouncesEye};
pub use normal_points::{LEAST_SHOTS, Moments, NormalPoint, NormalPoints, Residual};
pub use profile::{DepthBins, DepthError, Profile, Shot, Stand};
pub use returns::{ALTITUDES_KM, Returns, ReturnsError, SATURATED};
pub use shots::{Arrivals, Detection, Shots, ShotsError};
pub use sunglint_radiometry::station::{BeamShape, Ranging};
