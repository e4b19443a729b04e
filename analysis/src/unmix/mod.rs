//! Materials from spectra and from channels: how much of the light is whose.
//!
//! A body's light is a sum over its materials, I(λ) = E(λ) Σ_m ρ_m(λ) W_m, and so are the rates of channels. Divided by what a Lambert-like *unit reflector*
//! (ρ = 1, W = 1 m² sr⁻¹) would give under the same Sun, through the same air and at the same range, a rate is the **reflection factor**
//!
//! ```text
//! Γ_c = ν_c d²r²/U_c(z) = Σ_m s_cm(z) W_m,   U_c = (A/hc) ∫ E T P_c λ dλ,   s_cm = ∫ E ρ_m T P_c λ dλ / ∫ E T P_c λ dλ
//! ```
//!
//! in m² sr⁻¹: an area, as the light engine weighs it, not what is there of a material on the body's surface.
//!
//! In the order in which data flows through it:
//!
//! - [`Endmember`]: the spectrum of a material, from `sunglint_simulator::surface::Material`;
//! - [`Bands`]: channels or bins → U_c and the matrix s_cm for an airmass;
//! - [`nnls`]: non-negative least squares, on a free or a given sum; [`Mixing`]: what a matrix can tell apart (condition, near twins);
//! - [`Mixing::solve`]: weights, shares, their uncertainties, and what there is to say of them → [`Mixture`];
//! - [`unmix()`]: whole curves, each sample with the bands, the air and the light that it has;
//! - [`osp`], [`atgp`]: orthogonal projections; endmembers that nobody knew;
//! - [`Confusion`]: shares found against shares that are true.
//!
//! # Unmix with NNLS
//!
//! Two materials in three channels, and a sample that is 2 m² sr⁻¹ of the first and 0.5 m² sr⁻¹ of the second:
//!
//! ```
//! use ndarray::array;
//! use sunglint_analysis::unmix::nnls::Constraint;
//! use sunglint_analysis::unmix::{Mixing, Noise};
//!
//! let reflectance = array![[0.1, 0.6], [0.3, 0.5], [0.7, 0.4]];
//! let names = ["gold".to_owned(), "silicon".to_owned()];
//! let mixing = Mixing::new(reflectance, &names)?;
//! assert!(mixing.is_complete());
//!
//! let sample = [0.1 * 2.0 + 0.6 * 0.5, 0.3 * 2.0 + 0.5 * 0.5, 0.7 * 2.0 + 0.4 * 0.5];
//! let sigma = [0.01; 3];
//! let mixture = mixing.solve(&sample, Noise::Independent(&sigma), Constraint::Free)?;
//! assert!((mixture.weights[0] - 2.0).abs() < 1e-9);
//! assert!((mixture.shares[1] - 0.2).abs() < 1e-9);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod atgp;
mod bands;
mod concerns;
mod confusion;
mod curve;
mod endmember;
mod mixture;
pub mod nnls;

pub use atgp::{AtgpError, AtgpOptions, Target, Targets, atgp, osp, spectral_angle_rad};
pub use bands::{Bands, BandsError, Factors};
pub use concerns::{concerns, reasons};
pub use confusion::{Confusion, ConfusionError};
pub use curve::{Light, State, UnmixError, Unmixed, Values, unmix};
pub use endmember::{Endmember, column_name};
pub use mixture::{Mixing, MixingError, Mixture, Noise, Twins};
pub use sunglint_numerics::basis::Basis;
