//! Part of the Sun's light that the Earth leaves, profile by profile.
//!
//! In a partial eclipse the limb-darkened disc gives E(λ) (s_0 + Σ_j L_j(λ) s_j) in place of E(λ), with L_j of
//! [`profile::factors`](super::profile::factors): s_0 is the visible part of the grey disc's light, and the others, 0 for a whole disc and for none, make
//! what is left redder as it comes from the limb.
//!
//! A pass has two ways. For all that does not resolve the disc it multiplies: I(λ) = E(λ) Σ_k ρ_k(λ) W_k (s_0 + Σ_j L_j(λ) s_j), that is
//! the weight W_k s_j before the term ρ_k L_j. Where facets resolve the disc (glints), which part of it is hidden matters to them:
//! then it hands the shadow to [`Evaluator::light`](crate::light::Evaluator::light) as [`globe`] makes it, and does not multiply.

use super::cut::{Cut, Disc, Left};
use super::profile::PROFILES;
use super::rings;
use crate::light::Globe;
use glam::{DQuat, DVec3};
use sunglint_ephemeris::orbit::eclipse::Discs;

/// The visible part of the light of each profile, 1, 0, 0 … for the whole disc.
///
/// Light is counted as irradiance of a plane across the direction to the Sun's middle; to 1e-6 (the area of the disc's places, which
/// the uniform [`Discs::visible_fraction`] counts as solid angles, differs by δ² = 2e-5 of itself at most).
pub fn fractions(discs: &Discs) -> [f64; PROFILES] {
    let mut all = [0.0; PROFILES];
    let disc = Disc::new(DVec3::Z, DVec3::X, discs.sun_rad.sin());
    let (sin, cos) = discs.separation_rad.sin_cos();
    let cut = Cut::globe(&disc, DVec3::new(sin, 0.0, cos), discs.earth_rad);
    match cut.left() {
        Left::Nothing => {}
        Left::All => all[0] = 1.0,
        Left::Part => all = rings::fractions(&[cut]),
    }
    all
}

/// The Earth for a light engine's shadow: a globe that stands before the Sun as [`Discs`] say, whatever shape they were made for.
/// `sun_body` and `earth_body` are unit vectors from the target to the middles of both, the body's axes.
pub fn globe(discs: &Discs, sun_body: DVec3, earth_body: DVec3, distance_m: f64) -> Globe {
    let across = (earth_body - earth_body.dot(sun_body) * sun_body)
        .try_normalize()
        .unwrap_or_else(|| sun_body.any_orthonormal_vector());
    let (sin, cos) = discs.separation_rad.sin_cos();
    let toward = cos * sun_body + sin * across;
    Globe {
        toward,
        distance_m,
        radius_m: distance_m * discs.earth_rad.sin(),
        sun: sun_body,
        to_ground: DQuat::IDENTITY,
    }
}
