//! Transmission of the atmosphere for a direct beam: T(λ; z) = exp(−Σ τ_s(λ) m_s(z)), for a station that looks at
//! something outside the air.
//!
//! In the order in which data flows through it:
//!
//! - [`Profile`]: pressure, temperature and gases against altitude (six AFGL atmospheres, or the user's own);
//! - [`AirOptions`] → [`Air`]: the profile above one station, with its columns scaled to what was measured there;
//! - [`Zenith`] → [`Path`]: the ray through spherical shells, refracted, and what it meets on its way;
//! - [`Sampling`]: at which wavelengths, or over which bins, the answer is wanted;
//! - [`Air::transmission`], [`Air::components`]: the answer for one zenith angle, exact;
//! - [`Air::survey`]: the answer for several zenith angles, and through the channels of a station;
//! - [`AirTable`]: the same for thousands of zenith angles on one sampling, by an interpolation whose error it
//!   measures and reports.
//!
//! ```
//! use sunglint_radiometry::air::{Air, AirOptions, Profile, Sampling, Zenith};
//!
//! let options = AirOptions { altitude_m: 399.0, ..AirOptions::new(Profile::midlatitude_winter()) };
//! let air = Air::new(&options)?;
//! let green = Sampling::points(&[550.0])?;
//! let t = air.transmission(Zenith::Apparent(60.0), &green)?;
//! assert!((t[0] - 0.781).abs() < 1e-3);
//! # Ok::<(), sunglint_radiometry::air::AirError>(())
//! ```
//!
//! # What is in it
//! Rayleigh scattering, ozone (Hartley–Huggins with its temperature dependence, Chappuis), the bands of water, oxygen
//! and CO₂ by LOWTRAN7's band model (20 cm⁻¹), the water continuum, and aerosol where the options name one.
//!
//! # What is not
//! - The O₂–O₂ collision-induced absorption at 577, 630 and 1064 nm (no free cross section at hand): at 1064 nm the
//!   transmission is too high by 0.015 at the zenith and up to 0.14 at 85°.
//! - CH₄ and N₂O: LOWTRAN7 has no band of theirs in 294–1250 nm (their transmission is exactly 1 in the reference).
//! - Scattered light: the direct beam only.
//! - Lines: below 20 cm⁻¹ (0.2 nm at 300 nm, 3 nm at 1240 nm) nothing is resolved; a laser line inside a band of water
//!   or oxygen needs a line-by-line code.
//!
//! # One way
//! All transmissions are for one passage between the station and space. Sunlight reflected by a satellite passes
//! once; a laser's light that comes back has passed twice (T² where both ways share one zenith angle and wavelength).
//!
//! # Range
//! 294.118–1250 nm (34000–8000 cm⁻¹), where the band and ozone tables end; outside is an error. The reference against
//! which this is held covers 300–1240 nm.

mod aerosol;
mod describe;
mod error;
mod math;
mod model;
mod path;
mod plausible;
mod profile;
mod sampling;
mod spectra;
pub mod survey;
mod table;

pub use aerosol::{Aerosol, AerosolModel};
pub use error::AirError;
pub use model::{Air, AirMasses, AirOptions, Columns, Components};
pub use path::{Path, Zenith};
pub use profile::{Level, Profile};
pub use sampling::Sampling;
pub use table::AirTable;

/// Loschmidt's number as LOWTRAN7 rounds it \[cm⁻³\]: its band coefficients belong to this value.
pub(crate) const LOSCHMIDT_CM3: f64 = 2.6868e19;
