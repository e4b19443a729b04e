//! A pass: from orbit, attitude and target to spectra, magnitudes and count rates.
//!
//! In the order in which data flows through it:
//!
//! - [`mod@file`]: a `PASS.toml` and the files that it names → [`Pass`];
//! - [`Pass::simulate`]: for every epoch where Sun, target and station stand, and how the body is turned ([`Place`]); the weights W_k of the
//!   material spectra ([`crate::light`]); and from these, by sums alone, spectra, rates and magnitudes;
//! - [`Simulation`]: the curves and tables of the result;
//! - [`Simulation::exposure_means`]: means over exposures in place of their middles, where the light changes while one is taken;
//! - [`Pass::simulate_in_pieces`]: the same for more epochs than memory holds results of; [`Totals`]: what is said of all of them together;
//! - [`Pass::ready`]: the same for single moments, of any orbit;
//! - [`Study`]: the same again and again with another attitude or body: for fits.
//!
//! # What is summed
//! With the Sun's irradiance E(λ) at 1 au, its distance d in au, the visible part s of its disc, the range r, the transmission T(λ; z) of
//! the air and the effective sensitivity P_c(λ) of a channel behind an area A,
//!
//! ```text
//! I(λ)  = s/d² E(λ) Σ_k ρ_k(λ) W_k                            W sr⁻¹ nm⁻¹, means over bins
//! ν_c   = s/(d² r²) Σ_k W_k K_ck(z),  K_ck = (A/hc) ∫ E ρ_k T P_c λ dλ     Hz
//! m_b   = −2.5 lg( s/(d² r²) Σ_k W_k F_bk ),  F_bk = ∫ E ρ_k S_b dλ / (∫ S_b dλ · E_0)
//! ```
//!
//! The ρ_k W_k stand for all [`crate::light::Term`]s that the light engine has, whatever way the light took; and each W_k has an error w_k, absolute, which
//! gives those of rates, bins and magnitudes by the same sums, Σ |K_ck| w_k, with what the air's table may err by: the *stated error*. What the engine
//! does not model ([`Simulation::needs`]) is in these w_k. In the edge of the Earth's shadow the error of s is added.
//!
//! The integrals are taken on the union of all tables, once, exactly for piecewise-linear tables; over the zenith angle K_ck/K_ck(no
//! air) is a mean transmission, tabulated with a measured error ([`sunglint_radiometry::air::AirTable`]).

mod alike;
mod along;
mod concerns;
mod correction;
mod cost;
mod counts;
mod elsewhere;
mod error;
mod explain;
pub mod exposure;
pub mod file;
mod functionals;
mod keys;
pub(crate) mod material;
mod moments;
mod observation;
mod pieces;
mod polarisation;
mod promise;
mod ready;
mod result;
mod shadow;
mod simulate;
mod study;
mod totals;

pub use alike::Alike;
pub use correction::{Correction, LightFactor, airmass};
pub use cost::{Cost, Stopwatch};
pub use elsewhere::{Elsewhere, TwoWay};
pub use error::PassError;
pub use explain::Explanation;
pub use exposure::ExposureMeans;
pub use file::{Overrides, PassFile};
pub use material::{MaterialDoubt, OneMaterial};
pub use observation::Observation;
pub use pieces::{Extras, Piece};
pub use polarisation::Polarisation;
pub(crate) use promise::light_name;
pub use promise::{Limit, Promise};
pub use ready::{Eye, Ready, Sample};
pub use result::{StandardMagnitude, StatedError, WITHIN_AN_EXPOSURE};
pub use simulate::{Bounds, ChannelSamples, Place, Progress, Simulation, Stage};
pub use study::{Averaged, Study, TermRates, Thinned};
pub use sunglint_radiometry::light_curve::SpectralQuantity;
pub use totals::{At, ChannelTotals, Ends, Highest, HighestRate, Totals};

use crate::attitude::Attitude;
use crate::light::EarthAlbedo;
use crate::light::engine::Switches;
use crate::target::Target;
use hifitime::Epoch;
use std::sync::Arc;
use sunglint_ephemeris::orbit::Orbit;
use sunglint_ephemeris::orbit::eclipse::EarthShape;
use sunglint_radiometry::air::Air;
use sunglint_radiometry::light_curve::Input;
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::sky::EarthOrientation;
use sunglint_radiometry::spectrum::{Irradiance, Spectrum};
use sunglint_radiometry::station::Station;

/// The Johnson–Cousins bands in which magnitudes are given.
pub const BANDS: [&str; 5] = ["U", "B", "V", "R", "I"];

/// Everything that a pass is made of; nothing is read any more.
#[derive(Debug, Clone)]
pub struct Pass {
    /// Name of the pass.
    pub name: String,
    /// Target that reflects the light.
    pub target: Target,
    /// Where it is.
    pub orbit: Orbit,
    /// How it is turned.
    pub attitude: Attitude,
    /// Whether somebody said how it is turned.
    pub attitude_given: bool,
    /// Who looks.
    pub station: Station,
    /// Through what; `None` for no air at all.
    pub air: Option<Air>,
    /// When (mid-exposure, at the station); at least one moment, in any order.
    pub times: Vec<Epoch>,
    /// For how long, s; as many.
    pub exposure_s: Vec<f64>,
    /// Target and site of each sample, where each has its own (`[times] table`); none where all have [`Pass::orbit`] and the station's site.
    pub observations: Vec<Arc<Observation>>,
    /// Edges of the spectral bins, vacuum nm, increasing.
    pub edges_nm: Vec<f64>,
    /// Quantity of the spectra.
    pub spectral: SpectralQuantity,
    /// The Sun's spectral irradiance at 1 au.
    pub sun: Spectrum<Irradiance>,
    /// Where that is from.
    pub sun_name: String,
    /// The Earth that casts the shadow; `None` for no eclipse at all.
    pub shadow: Option<EarthShape>,
    /// Albedo of the Earth.
    pub earth: Arc<EarthAlbedo>,
    /// UT1 and the pole; the embedded table where `None`.
    pub orientation: Option<EarthOrientation>,
    /// Zero point of the magnitudes.
    pub zero: ZeroPoint,
    /// An effect that may change the light by more than this, relative, is modelled ([`crate::light::engine`]).
    pub tolerance: f64,
    /// The work that an epoch's light between surfaces may cost, CPU seconds ([`crate::light::engine::Options::budget_s`]).
    pub budget_s: f64,
    /// Error allowed in transmission (absolute) by the air's tables over the zenith angle.
    pub air_tolerance: f64,
    /// Which effects are switched on or off.
    pub effects: Switches,
    /// Factors and an offset that a fit found beside the scene.
    pub correction: Correction,
    /// Files that went in.
    pub inputs: Vec<Input>,
    /// Further notes of the file.
    pub notes: Vec<String>,
    /// Warnings to read before believing the result.
    pub warnings: Vec<String>,
}

impl Pass {
    /// Number of spectral bins.
    pub fn bins(&self) -> usize {
        self.edges_nm.len().saturating_sub(1)
    }

    /// The Earth's orientation that is used.
    pub fn orientation(&self) -> &EarthOrientation {
        self.orientation.as_ref().unwrap_or_else(|| EarthOrientation::embedded())
    }
}
