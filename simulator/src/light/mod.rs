//! The light engine: one weight per material spectrum, from what is lit and seen of a body.
//!
//! I(λ) = E(λ) Σ_k ρ_k(λ) W_k with W_k = Σ_facets A(visible ∩ lit) cosθ_i cosθ_o w_k(ω_i, ω_o) \[m² sr⁻¹\]: physics of one scattering under
//! a collimated Sun (thesis eq. 5.5 and its generalisation).

use glam::DVec3;

/// Where the observer is, in the body's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum View {
    /// So far away that all lines of sight are parallel: the unit vector towards the observer.
    Distant(DVec3),
    /// At a point, m from the body's origin.
    At(DVec3),
}
