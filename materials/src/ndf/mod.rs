//! The density of microfacet normals (NDF) of a sample, from what it throws back towards the light.
//!
//! Dupuy and Jakob (ACM TOG 37, 274, 2018): in retro-reflection the microfacets that mirror are those that face the light, so that
//! F₀ D(ω) = 4 f(ω, ω) cosθ σ(ω) with the projected area σ(ω) = ∫ D(m) max(0, ω·m) dω_m. D is the Perron vector of that kernel.
//!
//! From a table of angles to D: readings that are no light are left out ([`Note`]), the symmetry point is found from both sides of the normal, a cubic spline of
//! ln f, even about it, leads to the nodes; beyond the last angle the lobe is continued and flagged, and how much the choice of the continuation changes is said
//! beside the uncertainty that comes from the readings (by resampling). Where the run states the cone of light into the meter, both laws are fitted as that sees them, and what it takes from
//! the better of them is given back to the readings before D is found. Diffuse light is no microfacets': where it is asked for and seen it is taken off first ([`DiffuseLight`]).
//!
//! # From retro-reflection to the density of normals
//!
//! The closed form of a rough metal (GGX, roughness 0.2, Walter et al. 2007) at each half degree:
//!
//! ```
//! use std::f64::consts::PI;
//! use sunglint_materials::ndf::{NdfOptions, extract};
//! use sunglint_materials::table::{Reading, RetroFlags, RetroTable};
//!
//! let (alpha, f0) = (0.2_f64, 0.8);
//! let retro = |theta: f64| {
//!     let tan2 = theta.tan().powi(2);
//!     let d = (1.0 + tan2 / (alpha * alpha)).powi(-2) / (PI * alpha * alpha * theta.cos().powi(4));
//!     let masking = 2.0 / (1.0 + (1.0 + alpha * alpha * tan2).sqrt());
//!     f0 * d * masking / (4.0 * theta.cos().powi(2))
//! };
//! let reading = |k: i32| {
//!     let angle_deg = 0.5 * f64::from(k);
//!     Reading {
//!         angle_deg,
//!         azimuth_deg: 0.0,
//!         f_per_sr: retro(angle_deg.to_radians()),
//!         sigma_f_per_sr: 0.0,
//!         flags: RetroFlags::empty(),
//!     }
//! };
//! let run = RetroTable { readings: (-20..=130).map(reading).collect(), ..RetroTable::default() };
//! let ndf = extract(&run, &NdfOptions::default())?;
//! assert!((ndf.profiles[0].ggx.alpha - alpha).abs() < 0.002);
//! assert!((ndf.f0 - f0).abs() < 0.01);
//! # Ok::<(), sunglint_materials::ndf::NdfError>(())
//! ```

mod anisotropic;
mod cone;
mod diffuse;
mod laser;
mod nodes;
mod passes;
mod power;
mod profile;
mod scan;
mod shape;
mod spline;
mod table;
mod tail;
mod uncertainty;
mod zero;

pub use diffuse::{DiffuseLight, DiffuseOrigin};
pub use nodes::{Anisotropic, Elevations, Hemisphere, Isotropic};
pub use power::{Solution, solve};
pub use shape::ShapeFit;
pub use table::{from_table, to_table};
pub use tail::TailKind;
pub use zero::{Zero, ZeroOrigin};

use crate::table::RetroTable;
use cone::Cone;
use laser::Laser;
use profile::{Stated, Traced};
use scan::Scan;
use serde::{Deserialize, Serialize};
use std::fmt;

bitflags::bitflags! {
    /// Flags of a node: all that is known about it. In files the metadata `flag_bits` names the bits.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
    pub struct NdfFlags: u32 {
        /// Beyond the last angle at which light was seen.
        const EXTRAPOLATED = 1;
        /// In a gap between angles.
        const GAP = 1 << 1;
    }
}

/// How D is found.
#[derive(Debug, Clone, PartialEq)]
pub struct NdfOptions {
    /// Nodes in elevation: 128 leave 4e-6 for Beckmann and GGX; of an anisotropic sample 32.
    pub elevations: Option<usize>,
    /// Nodes in azimuth of an anisotropic sample: 12 α_max/α_min or more (64 at least where not given).
    pub azimuths: Option<usize>,
    /// Width of a running median over the readings (odd); none unless asked for: it flattens peaks.
    pub median: Option<usize>,
    /// The stage's angle at normal incidence, degrees, where it is known otherwise.
    pub zero_deg: Option<f64>,
    /// How far from the stage's zero the symmetry point is looked for, degrees.
    pub most_offset_deg: f64,
    /// How the lobe goes on beyond the last angle; the one that follows the last readings best where not given.
    pub tail: Option<TailKind>,
    /// Whether diffuse light is looked for and taken off where it is seen; else all light is taken for the microfacets'.
    pub diffuse: bool,
    /// Resamplings for the uncertainties; 0 leaves them out.
    pub resamplings: usize,
    /// Seed of the resamplings.
    pub seed: u64,
}

impl Default for NdfOptions {
    fn default() -> Self {
        Self {
            elevations: None,
            azimuths: None,
            median: None,
            zero_deg: None,
            most_offset_deg: 5.0,
            tail: None,
            diffuse: true,
            resamplings: 200,
            seed: 0,
        }
    }
}

/// Why there is no D.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NdfError {
    /// Fewer angles than a lobe needs.
    #[error("{found} angles with light: an NDF needs {least} or more")]
    TooFew {
        /// Different angles with light.
        found: usize,
        /// The least number.
        least: usize,
    },
    /// No reading above 0.
    #[error(
        "none of {readings} readings is above 0: no light came back (a shutter, a wrong range, a dark scan subtracted twice?)"
    )]
    NoLight {
        /// Number of readings.
        readings: usize,
    },
    /// The meter did not follow the peak.
    #[error(
        "the peak is saturated from {:.3}° to {:.3}° ({readings} readings): D is normalised by its peak, measure it with less light or in a higher range",
        angles_deg.0, angles_deg.1
    )]
    Saturated {
        /// First and last angle.
        angles_deg: (f64, f64),
        /// Number of readings.
        readings: usize,
    },
    /// The lobe is narrower than the angles are apart.
    #[error(
        "{}", too_coarse(*angle_deg, *readings, *step_deg, *alpha, *needed_deg)
    )]
    TooCoarse {
        /// Where the peak is.
        angle_deg: f64,
        /// Readings above half of it.
        readings: usize,
        /// Step of the angles.
        step_deg: f64,
        /// The roughness that the peak's neighbours would be of, or more than it has.
        alpha: f64,
        /// The step that it needs.
        needed_deg: f64,
    },
    /// Angles are missing amid the peak.
    #[error(
        "no reading from {from_deg:.2}° to {to_deg:.2}° off the normal, within the half-width of the lobe ({half_width_deg:.2}°): measure there"
    )]
    GapInPeak {
        /// Where it begins.
        from_deg: f64,
        /// Where it ends.
        to_deg: f64,
        /// Half the width of the lobe at half its height.
        half_width_deg: f64,
    },
    /// Angles are missing beside the normal, so that it is not known where that is.
    #[error(
        "the readings do not decide where the normal is: from {from_deg:.2}° to {to_deg:.2}° of the stage there is none, so that hardly any angle was measured on both sides of the peak. Measure there, or give the stage's angle at normal incidence (zero_deg; --zero-deg of the program)"
    )]
    GapBesideNormal {
        /// Where it begins, the stage's angle.
        from_deg: f64,
        /// Where it ends.
        to_deg: f64,
    },
    /// Values on the nodes that are no BRDF.
    #[error("retro-reflection on the nodes: found {0}, expected numbers of 0 or above, not all 0")]
    Values(String),
    /// The iteration did not end.
    #[error(
        "the power iteration did not converge: ‖Kv−F₀v‖/‖v‖ is {residual:.1e} after {iterations} iterations, the eigenvalue gap {eigenvalue_gap:.1e}"
    )]
    NotConverged {
        /// Residual that is left.
        residual: f64,
        /// Iterations done.
        iterations: usize,
        /// 1 − |λ₂|/λ₁.
        eigenvalue_gap: f64,
    },
    /// An option out of its range.
    #[error("{name}: found {found}, expected {expected}")]
    Option {
        /// The option.
        name: &'static str,
        /// Value that was found.
        found: f64,
        /// Allowed values.
        expected: &'static str,
    },
    /// Azimuths that do not cover the circle.
    #[error("{0}")]
    Azimuths(String),
}

fn too_coarse(
    angle_deg: f64,
    readings: usize,
    step_deg: f64,
    alpha: f64,
    needed_deg: f64,
) -> String {
    format!(
        "the peak at {angle_deg:.3}° is narrower than the step of {step_deg:.3}° resolves: {readings} of the readings about it {} above half of it; \
         its neighbours say a roughness α of {alpha:.4} or less, which needs a step of {needed_deg:.3}° or less",
        if readings == 1 { "is" } else { "are" }
    )
}

/// Note on a change to the readings, for the user.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Note {
    /// They were not in the order of their angles.
    Sorted,
    /// A reading was left out.
    LeftOut {
        /// Angle of the reading, degrees.
        angle_deg: f64,
        /// Value that was found.
        f_per_sr: f64,
        /// Why.
        reason: &'static str,
    },
    /// At an end of the scan no light was seen: the lobe is continued there.
    BelowDetection {
        /// First and last angle.
        angles_deg: (f64, f64),
        /// Number of readings.
        readings: usize,
    },
    /// Angles are missing.
    Gap {
        /// Where it begins, degrees off the normal.
        from_deg: f64,
        /// Where it ends.
        to_deg: f64,
    },
    /// The symmetry point was not found.
    ZeroAssumed,
    /// The lobe is hardly wider than the rig's cone of light, or not.
    Blurred {
        /// The roughness that was found.
        alpha: f64,
        /// The smallest that the rig can tell.
        smallest_alpha: f64,
    },
    /// Quarters of the circle are taken as mirror images of what was measured.
    Mirrored,
    /// Diffuse light was taken off.
    Diffuse {
        /// Reflectance of a Lambert surface that throws as much back.
        reflectance: f64,
        /// Largest error of the reflectance.
        bound: f64,
        /// The angle to which the lobe is followed, degrees.
        followed_to_deg: f64,
    },
    /// The readings are of several passes, and one is brighter or dimmer than the first.
    PassesDiffer {
        /// Number of the pass, from 1: that which is farthest off.
        pass: usize,
        /// Readings of this pass over those of the first.
        ratio: f64,
        /// Standard deviation of the ratio, by the scatter.
        sigma: f64,
        /// The ratio less 1 in standard deviations; 1000 stands for any more.
        sigmas: f64,
        /// Angles that both have.
        angles: usize,
    },
    /// Beyond the lobe f rises as one over the cosine, as readings with a dark offset do.
    Floor {
        /// The floor's f towards the normal, sr⁻¹.
        f_per_sr: f64,
        /// It over the largest reading.
        part: f64,
        /// Where the normal is, the stage's angle.
        zero_deg: f64,
    },
    /// More light comes back than from any surface.
    TooBright {
        /// The F₀ that was found.
        f0: f64,
    },
    /// Whether there is diffuse light is not decided.
    DiffuseUnknown {
        /// Reflectance that the readings would allow.
        most: f64,
    },
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sorted => f.write_str("the angles were not in order: sorted"),
            Self::LeftOut { angle_deg, f_per_sr, reason } => {
                write!(f, "left out: {f_per_sr:.4e} sr⁻¹ at {angle_deg:.3}° ({reason})")
            }
            Self::BelowDetection { angles_deg: (from, to), readings } => write!(
                f,
                "{readings} readings from {from:.2}° to {to:.2}° are no light that was seen (below 3σ, or not above 0): the lobe is continued there"
            ),
            Self::Gap { from_deg, to_deg } => write!(
                f,
                "no reading from {from_deg:.2}° to {to_deg:.2}° off the normal: interpolated and flagged"
            ),
            Self::ZeroAssumed => f.write_str(
                "the readings do not decide where the normal is (one side alone, or the same everywhere): the stage's zero is taken, with the uncertainty that the run states for it (none if it states none)",
            ),
            Self::Blurred { alpha, smallest_alpha } => write!(
                f,
                "α is {alpha:.4}, the smallest that the cone of light can tell {smallest_alpha:.4}: the lobe is the rig's, at least in part"
            ),
            Self::Diffuse { reflectance, bound, followed_to_deg } => write!(
                f,
                "diffuse light of reflectance {reflectance:.3} ± {bound:.3} was taken off; the lobe is followed to {followed_to_deg:.1}° and continued beyond"
            ),
            Self::DiffuseUnknown { most } => write!(
                f,
                "it is not decided whether there is diffuse light (of reflectance {most:.3} or less): nothing was taken off. Measure to larger angles, where the lobe has ended"
            ),
            Self::PassesDiffer { pass, ratio, sigma, sigmas, angles } => write!(
                f,
                "pass {pass} over the angles is not as bright as the first: {ratio:.4} ± {sigma:.4} times, {}{sigmas:.0} standard deviations by {angles} angles that both have. \
                 Both count alike, so that the result lies between them: find out which is wrong (the lamp, the range, the sample's place) and leave it out",
                if *sigmas < 1000.0 { "" } else { "more than " }
            ),
            Self::Floor { f_per_sr, part, zero_deg } => write!(
                f,
                "the readings do not vanish towards grazing, where a sample's light must: beyond the lobe f rises as {f_per_sr:.3e} sr⁻¹/cosθ, as it does with a dark offset of {:.2} % of the largest reading. \
                 Nothing was taken off, and the lobe is too wide if it is one. Subtract the dark, or take {f_per_sr:.4e}/cos(angle_deg − {zero_deg:.2}°) off f_per_sr; if the dark is right, it is a rough part of the sample",
                100.0 * part
            ),
            Self::TooBright { f0 } => write!(
                f,
                "F0 is {f0:.3}, more than any surface but a retro-reflector has (1 of mirrors, 2.1 of white paint): are the values percent (then divide f_per_sr by 100), or is the scale wrong?"
            ),
            Self::Mirrored => {
                f.write_str("azimuths beyond a quarter of the circle: mirror images of those measured")
            }
        }
    }
}

/// How a power iteration went.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Convergence {
    /// ‖K v − F₀ v‖/‖v‖.
    pub residual: f64,
    /// Iterations done.
    pub iterations: usize,
    /// 1 − |λ₂|/λ₁: each iteration takes that share of the error away.
    pub eigenvalue_gap: f64,
}

/// Properties of the lobe in one plane of incidence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Profile {
    /// The plane's azimuth on the sample, degrees.
    pub azimuth_deg: f64,
    /// Where the normal is.
    pub zero: Zero,
    /// The last angle off the normal at which light was seen, degrees.
    pub measured_to_deg: f64,
    /// Step of the angles, degrees.
    pub step_deg: f64,
    /// How it goes on beyond.
    pub tail: TailKind,
    /// The best Beckmann lobe.
    pub beckmann: ShapeFit,
    /// The best GGX lobe.
    pub ggx: ShapeFit,
    /// Diffuse light beside the lobe, taken off before D was found.
    #[serde(default)]
    pub diffuse: DiffuseLight,
}

/// The density of microfacet normals of a sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Ndf {
    /// Elevations of the nodes, radians, increasing.
    pub theta_rad: Vec<f64>,
    /// Azimuths of the nodes over half the circle, radians; a single 0 of an isotropic sample. D is the same half a turn further.
    pub phi_rad: Vec<f64>,
    /// D, sr⁻¹, by azimuth and elevation: node (k, j) is `k * theta_rad.len() + j`.
    pub density: Vec<f64>,
    /// The projected area σ of microfacets, 1 towards the normal.
    pub projected_area: Vec<f64>,
    /// Standard deviation of D by the readings, sr⁻¹; none where theirs is not known.
    pub density_sigma: Option<Vec<f64>>,
    /// Change of D with other continuations beyond the last angle and across gaps, and with the other law, if the readings allow it, for what the cone took, sr⁻¹: the largest
    /// difference.
    pub density_bound: Vec<f64>,
    /// Flags of the nodes.
    pub flags: Vec<NdfFlags>,
    /// F₀, the eigenvalue; it may exceed 1 where microfacets are no mirrors (a Lambert sample of reflectance ρ has 2.0821 ρ).
    pub f0: f64,
    /// Standard deviation of F₀ by the readings and by what they have in common.
    pub f0_sigma: Option<f64>,
    /// Change of it by other continuations, and by another law for what the cone took.
    pub f0_bound: f64,
    /// How the iteration went.
    pub convergence: Convergence,
    /// The planes of incidence.
    pub profiles: Vec<Profile>,
    /// The smallest roughness that the rig can tell: its cone blurs the half-vector by half the cone's half-angle.
    pub smallest_alpha: Option<f64>,
    /// Resamplings behind the standard deviations.
    pub resamplings: usize,
    /// Notes on what was done to the readings.
    pub notes: Vec<Note>,
}

impl Ndf {
    /// Whether it is the same in every azimuth.
    pub fn is_isotropic(&self) -> bool {
        self.phi_rad.len() == 1
    }
}

/// Refuses options out of their ranges.
fn check(options: &NdfOptions) -> Result<(), NdfError> {
    let wrong = |name, found, expected| Err(NdfError::Option { name, found, expected });
    if let Some(n) = options.elevations.filter(|n| !(8..=1024).contains(n)) {
        return wrong("elevations", n as f64, "8 to 1024 nodes");
    }
    if let Some(n) = options.azimuths.filter(|n| !(8..=1024).contains(n) || n % 4 != 0) {
        return wrong("azimuths", n as f64, "8 to 1024 nodes, a multiple of 4");
    }
    if let Some(n) = options.median.filter(|n| *n < 3 || n % 2 == 0) {
        return wrong("median", n as f64, "an odd number of readings, 3 or more");
    }
    if !(options.most_offset_deg >= 0.0 && options.most_offset_deg <= 45.0) {
        return wrong("most_offset_deg", options.most_offset_deg, "an angle from 0 to 45°");
    }
    match options.zero_deg {
        Some(zero) if zero.is_nan() || zero.abs() > 45.0 => {
            wrong("zero_deg", zero, "an angle from −45 to 45°")
        }
        _ => Ok(()),
    }
}

/// Finds D of a run.
///
/// # Errors
/// An [`NdfError`] with the reason: too few angles, no light, a peak that is saturated or that the angles do not resolve, angles missing amid it, no convergence.
pub fn extract(run: &RetroTable, options: &NdfOptions) -> Result<Ndf, NdfError> {
    check(options)?;
    let first = run.readings.first().map(|r| r.azimuth_deg);
    let mut ndf = if run.readings.iter().any(|r| Some(r.azimuth_deg) != first) {
        anisotropic::extract(run, options)?
    } else {
        isotropic(run, options)?
    };
    ndf.smallest_alpha = run.cone_half_angle_deg.map(|c| (0.5 * c).to_radians().tan());
    if let Some(smallest_alpha) = ndf.smallest_alpha {
        let alpha = ndf.profiles.iter().map(|p| p.ggx.alpha).fold(f64::INFINITY, f64::min);
        if alpha < 2.0 * smallest_alpha {
            ndf.notes.push(Note::Blurred { alpha, smallest_alpha });
        }
    }
    let is_wide = ndf.profiles.iter().all(|p| p.ggx.alpha.min(p.beckmann.alpha) > WIDE);
    if ndf.f0 > if is_wide { MOST_F0_WIDE } else { MOST_F0 } {
        ndf.notes.push(Note::TooBright { f0: ndf.f0 });
    }
    Ok(ndf)
}

/// Largest F₀ of a surface, with what a scale may be off: of mirrors 1, and of a lobe wider than this, which may be diffuse light, 2.08.
const MOST_F0: f64 = 1.5;
const WIDE: f64 = 0.5;
const MOST_F0_WIDE: f64 = 2.5;

/// The symmetry point by a law that meets readings of f cosθ, for a run whose two sides do not decide it; `shared` is by how much, relative, each reading may be off together with its
/// neighbours. None where no law meets the readings within their scatter.
pub(crate) fn zero_by_law(run: &RetroTable, shared: &[f64], most_deg: f64) -> Option<Zero> {
    let scan = Scan::clean(&run.readings, &mut Vec::new()).ok()?;
    zero::by_law(&scan, shared, most_deg)
}

fn isotropic(run: &RetroTable, options: &NdfOptions) -> Result<Ndf, NdfError> {
    let mut notes = Vec::new();
    let scan = Scan::clean(&run.readings, &mut notes)?;
    let over = Isotropic::new(options.elevations.unwrap_or(128));
    let theta = &over.elevations.theta_rad;
    let azimuth_deg = run.readings.first().map_or(0.0, |r| r.azimuth_deg);
    let stated = Stated { cone: Cone::of(run), zero: run.zero };
    let traced = Traced::new(&scan, azimuth_deg, theta, (options, &stated), &mut notes)?;
    let solution = solve(&over, &exp(&traced.ln_f[0]))?;
    let n = theta.len();
    let mut bound = uncertainty::Bound::new(n);
    for other in &traced.ln_f[1..] {
        bound.add(&solution, &solve(&over, &exp(other))?);
    }
    let mut ndf = Ndf {
        theta_rad: theta.clone(),
        phi_rad: vec![0.0],
        density_sigma: None,
        density_bound: bound.density,
        f0_bound: bound.f0,
        flags: traced.flags.clone(),
        f0: solution.f0,
        f0_sigma: None,
        convergence: solution.convergence,
        density: solution.density,
        projected_area: solution.sigma,
        profiles: vec![traced.profile.clone()],
        smallest_alpha: None,
        resamplings: 0,
        notes,
    };
    let scans = [(scan, traced)];
    let common = uncertainty::Common {
        stated,
        laser: Laser::of(run),
        scale_sigma: run.scale_sigma,
        cone_sigma: run.cone_sigma,
    };
    uncertainty::add(&mut ndf, &over, &scans, (&common, options), |traced| exp(&traced[0].ln_f[0]));
    Ok(ndf)
}

fn exp(values: &[f64]) -> Vec<f64> {
    values.iter().map(|v| v.exp()).collect()
}
