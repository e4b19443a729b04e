//! Real surfaces: one to three lobes, a coherent mirror and diffuse light through a measured table of several incidences, at one wavelength.
//!
//! f = F(θ_d) [Σ sₖ Lₖ + m exp(−(g cosθ_d)²) L_m] + diffuse, with θ_d the angle between light and bisector. Lobes are GGX, Beckmann or ABg; the mirror is a lobe of Beckmann
//! microfacets as narrow as the surface is flat. F is constant, Schlick's, or a dielectric's. Every part is the same with light and detector exchanged.
//!
//! The quantity compared with the table is what an instrument would see: the law through the detector's cone and the source's disc. The cost is the mean square of ln f, plus
//! (½ ln E)² + (¼ ln P)² of each incidence, with E the hemispherical reflectance and P the peak, law over table ([`hemisphere`] says what both are). An albedo above 1 costs more than
//! any misfit. A sample counts less only if it lies apart from its partner on the other side of the mirrored direction: where both sides are off alike it is the law that is wrong.
//!
//! Recipes are chosen by what they say of incidences that they were not fitted to, one left out at a time, and the simplest is taken that is not worse by more than chance.
//! The residuals at the incidences left out give the doubt of ln f, by region. A table of one incidence has none to leave out: recipes whose parts it cannot tell apart are not tried then, and the
//! doubt is wide.
//!
//! Where errors do not all grow with the value, ln f gives way to arsinh(f/b), which is linear below b: values around 0 and below count as what they are, and do not bend the law.

pub mod colour;
mod common;
pub mod hemisphere;
mod judge;
mod model;
mod search;

pub use judge::Region;
pub use model::{Cone, Floor, Kind, Recipe, Rise, Surface};

use super::report::{FitError, LeftOut};
use super::{independent, saturated, student_quantile, wavelength};
use crate::instrument::TableInstrument;
use crate::samples::{Samples, turned};
use common::Common;
pub(super) use common::of_instrument;
use judge::{Incidence, Judge};
pub(crate) use model::disc;
use search::Candidate;
use serde::Serialize;
use std::fmt;
use sunglint_formats::toml::quoted;
use sunglint_numerics::measured::Interval;
use sunglint_numerics::order::quantile;
use sunglint_numerics::progress::Progress;
use sunglint_simulator::surface::MaterialError;

/// Values that an incidence needs.
const LEAST_VALUES: usize = 5;
/// Incidences below which it is said that there are few.
const FEW_INCIDENCES: usize = 3;
/// Part of the doubt of ln f of a law from one incidence, at others; and where no sample lies.
const UNKNOWN_LN: f64 = 1.0;
/// Errors in proportion to the value: with which a search begins, and which are possible.
const RELATIVE: f64 = 0.1;
const RELATIVES: [f64; 2] = [0.003, 0.2];
/// Values larger than this many times the error that is the same everywhere say how large the errors in proportion are.
const BRIGHT: f64 = 20.0;
/// Hemispherical reflectance and peak may be off by this before a material is doubtful: 10 % and 25 %.
pub(super) const MOST_OFF: [f64; 2] = [0.10, 0.25];
/// With samples farther apart than this about the mirrored direction no mirror is looked for, degrees.
const MOST_STEP_DEG: f64 = 3.0;
/// Samples of an incidence on which recipes are searched; those that are kept then see all.
const SEARCHED: usize = 90;
/// Angles of incidence at which the albedo is told besides those of the table, degrees.
const TOLD_DEG: [f64; 6] = [0.0, 30.0, 60.0, 75.0, 85.0, 89.0];

/// How real surfaces are fitted.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct SurfaceOptions {
    /// The wavelength, vacuum nm; may be left out where the table has one only.
    pub wavelength_nm: Option<f64>,
    /// Values up to this are no measurements, sr⁻¹.
    pub floor_per_sr: Option<f64>,
    /// An error of every value that does not grow with it, sr⁻¹.
    pub additive_per_sr: f64,
    /// The instrument's disc.
    pub cone: Cone,
    /// Directions of light or detector farther from the normal are left out, degrees.
    pub theta_most_deg: f64,
    /// The recipes that are tried; all where empty.
    pub recipes: Vec<Recipe>,
    /// The most lobes of a recipe that is tried by itself, 1 to 3.
    pub most_lobes: usize,
}

impl Default for SurfaceOptions {
    fn default() -> Self {
        Self {
            wavelength_nm: None,
            floor_per_sr: None,
            additive_per_sr: 0.0,
            cone: Cone { detector_deg: 0.24, source_deg: 0.0 },
            theta_most_deg: 85.0,
            recipes: Vec::new(),
            most_lobes: 3,
        }
    }
}

impl SurfaceOptions {
    /// Usual options, with what the table says of its instrument: the detector's cone, the source, and the error that does not grow with the value.
    #[must_use]
    pub fn of(samples: &Samples) -> Self {
        let mut options = Self::default();
        if let Some(instrument) = TableInstrument::of(samples) {
            let Cone { detector_deg, source_deg } = options.cone;
            options.cone = Cone {
                detector_deg: instrument.cone_half_angle_deg.unwrap_or(detector_deg),
                source_deg: instrument.source_half_angle_deg.unwrap_or(source_deg),
            };
            options.additive_per_sr = instrument.additive_per_sr;
        }
        options
    }
}

/// A number of the surface.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Number {
    /// Key of the number in a material's file.
    pub name: &'static str,
    /// The lobe that it belongs to, counted from 1.
    pub lobe: Option<usize>,
    /// Value of the number.
    pub value: f64,
    /// The standard deviation of its logarithm; none where it lies at a bound or the values do not decide it.
    pub sigma_ln: Option<f64>,
    /// The interval that holds it with 95 %.
    pub interval: Option<Interval>,
    /// Whether it lies at the end of its range.
    pub at_bound: bool,
}

/// Root mean square of ln f, measured over law, by region; none without a sample there.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Rms {
    /// Root mean square over all samples.
    pub all: f64,
    /// Up to 3° from the mirrored direction.
    pub peak: Option<f64>,
    /// Elsewhere.
    pub wings: Option<f64>,
    /// Light or detector more than 75° from the normal.
    pub grazing: Option<f64>,
}

/// Half-widths of the 95 % intervals of ln f; of a region without a sample (see [`Rms`]) that of all others and a factor of e.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Doubt {
    /// Up to 3° from the mirrored direction.
    pub peak_ln: f64,
    /// Elsewhere.
    pub wings_ln: f64,
    /// Light or detector more than 75° from the normal.
    pub grazing_ln: f64,
}

/// The peak of an incidence, see [`hemisphere::peak`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Peak {
    /// The sample's angle from the mirrored direction, degrees.
    pub off_deg: f64,
    /// Peak in the table, sr⁻¹.
    pub table_per_sr: f64,
    /// Law over table.
    pub ratio: f64,
}

/// An incidence as a fit without it would have it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Unseen {
    /// Root mean square of ln f.
    pub rms_ln: f64,
    /// Hemispherical reflectance, law over table.
    pub hemispherical_ratio: f64,
    /// Peak, law over table.
    pub peak_ratio: Option<f64>,
    /// The part of its samples inside the stated doubt.
    pub inside: f64,
    /// The median half-width of that doubt.
    pub half_width_ln: f64,
    /// True of the first and the last incidence: the law is then extrapolated.
    pub extrapolated: bool,
}

/// One incidence.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AtIncidence {
    /// Angle of incidence, degrees.
    pub theta_i_deg: f64,
    /// Number of samples.
    pub values: usize,
    /// Root mean square of ln f.
    pub rms_ln: f64,
    /// Hemispherical reflectance of the table, see [`hemisphere::Hemisphere`]; NaN where its samples are so far apart at the peak that nothing is known of it.
    pub hemispherical_table: f64,
    /// How far that may be off, as a logarithm, by what lies between the samples.
    pub hemispherical_ln_doubt: f64,
    /// The hemispherical reflectance that the file itself states (Zemax's TIS).
    pub tis: Option<f64>,
    /// How much of the hemisphere its samples stand for.
    pub coverage: f64,
    /// The same sum over the same directions of the law, over that of the table: also where it is not known what that sum says of the hemisphere.
    pub hemispherical_ratio: f64,
    /// The peak; none where the table has no sample near the mirrored direction.
    pub peak: Option<Peak>,
    /// Directional–hemispherical reflectance of the law.
    pub albedo: f64,
    /// How a fit without this incidence has it.
    pub unseen: Option<Unseen>,
}

/// A recipe that was tried.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tried {
    /// Name of the recipe.
    pub recipe: String,
    /// Number of its parameters.
    pub parameters: usize,
    /// Root mean square of ln f over all samples.
    pub rms_ln: f64,
    /// The cost: mean square of ln f and what hemispherical reflectance and peaks cost.
    pub cost: f64,
    /// The mean cost of incidences that were left out; none where it was not looked at.
    pub left_out: Option<f64>,
}

/// Fault of a fit, or of the table.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "what", rename_all = "snake_case")]
#[non_exhaustive]
pub enum Flaw {
    /// The hemispherical reflectance is off.
    Hemispherical {
        /// Angle of incidence, degrees.
        theta_i_deg: f64,
        /// Law over table.
        ratio: f64,
    },
    /// The peak is off.
    Peak {
        /// Angle of incidence, degrees.
        theta_i_deg: f64,
        /// Law over table.
        ratio: f64,
    },
    /// The table reflects more than came, or so much that a law which does not cannot follow.
    TableGains {
        /// Angle of incidence, degrees.
        theta_i_deg: f64,
        /// Hemispherical reflectance of the table.
        hemispherical: f64,
    },
    /// The samples are too far apart for the peak, which may hold any part of the light.
    PeakNotResolved {
        /// Angle of incidence, degrees.
        theta_i_deg: f64,
        /// Hemispherical reflectance of the table; NaN where nothing is known of it.
        hemispherical: f64,
        /// How far that may be off, as a logarithm.
        ln_doubt: f64,
    },
    /// The values do not reflect as much as the file says that they do.
    Tis {
        /// Angle of incidence, degrees.
        theta_i_deg: f64,
        /// Hemispherical reflectance of the values.
        hemispherical: f64,
        /// That in the file.
        tis: f64,
    },
    /// The law was held back by energy.
    Held {
        /// The largest albedo, at which angle, degrees.
        theta_i_deg: f64,
        /// That albedo.
        albedo: f64,
    },
    /// Light came from few directions.
    FewIncidences {
        /// Number of the incidences.
        incidences: usize,
    },
    /// Values that were not used, and that are missed.
    LeftOut {
        /// How many.
        left_out: LeftOut,
    },
    /// The largest value is there several times: the detector could not show more.
    Saturated {
        /// That value, sr⁻¹.
        per_sr: f64,
        /// Whether it is that of f cos θ_o, as the detector sees it; else of f.
        signal: bool,
        /// How many have it.
        values: usize,
    },
    /// The table is not the same with light and detector exchanged.
    NotReciprocal {
        /// Pairs of directions that were measured both ways.
        pairs: usize,
        /// Root mean square of ln f(i, o)/f(o, i).
        rms_ln: f64,
    },
    /// A quantity of the instrument that was not measured. Doubts are wider for it, and the intervals of strengths but for the zeros.
    NotMeasured {
        /// Name of the quantity, and what is assumed instead.
        quantity: String,
    },
    /// The diffuse part is not more than what may be left of stray light.
    DiffuseMayBeStray {
        /// Reflectance of the diffuse part.
        diffuse: f64,
        /// Stray light that may be left, sr⁻¹.
        stray_per_sr: f64,
    },
}

impl Flaw {
    /// Whether the material should not be used without a second look.
    pub fn needs_consent(&self) -> bool {
        matches!(self, Self::Hemispherical { .. } | Self::Peak { .. })
    }
}

impl fmt::Display for Flaw {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Hemispherical { theta_i_deg, ratio } => {
                write!(
                    f,
                    "at {theta_i_deg}° of incidence the law reflects {ratio:.2} times what the table does in all directions"
                )
            }
            Self::Peak { theta_i_deg, ratio } => {
                write!(
                    f,
                    "at {theta_i_deg}° of incidence the law's mirrored peak is {ratio:.2} times the table's"
                )
            }
            Self::TableGains { theta_i_deg, hemispherical } => write!(
                f,
                "the table itself reflects {hemispherical:.2} of the light at {theta_i_deg}° of incidence, if its peak is as wide across the plane of incidence as in it: its calibration may be high, or the peak is narrower there. The law keeps to 1"
            ),
            Self::PeakNotResolved { theta_i_deg, hemispherical, ln_doubt } => {
                write!(
                    f,
                    "at {theta_i_deg}° of incidence the samples are too far apart for the peak: "
                )?;
                if hemispherical.is_nan() {
                    f.write_str("how much the table reflects is not known")?;
                } else {
                    let factor = ln_doubt.exp();
                    write!(
                        f,
                        "the {hemispherical:.3} that the table reflects may be off by a factor of {factor:.1}"
                    )?;
                }
                f.write_str(". Measure nearer to the mirrored direction")
            }
            Self::Tis { theta_i_deg, hemispherical, tis } => write!(
                f,
                "at {theta_i_deg}° of incidence the values reflect {hemispherical:.3} and the file's own TIS is {tis:.3}: look at the units and the scale of the values"
            ),
            Self::Held { theta_i_deg, albedo } => write!(
                f,
                "the law was held back by energy: it reflects {albedo:.3} of the light at {theta_i_deg}° of incidence"
            ),
            Self::FewIncidences { incidences: 1 } => f.write_str(
                "all light came from one angle of incidence: how the surface changes with it is the law's own word, and its doubt is wide",
            ),
            Self::FewIncidences { incidences } => write!(
                f,
                "light came from {incidences} angles of incidence: between and beyond them the law is little tested"
            ),
            Self::LeftOut { left_out } => {
                write!(f, "{left_out}")?;
                if left_out.not_above_zero > 0 {
                    f.write_str(". Values around 0 count only with --additive-per-sr, their error; what is left is too bright on the average")?;
                }
                Ok(())
            }
            Self::Saturated { per_sr, signal, values } => write!(
                f,
                "{values} values are the same maximum, {}{per_sr} sr⁻¹: the detector was saturated. They are left out, and the peak is what the law makes of its sides",
                if *signal { "f cos θ_o = " } else { "" }
            ),
            Self::NotReciprocal { pairs, rms_ln } => write!(
                f,
                "the table is not reciprocal: light and detector exchanged give values that differ by {:.0} % more than the law does (rms of {pairs} pairs). The law is reciprocal",
                100.0 * rms_ln.exp_m1()
            ),
            Self::NotMeasured { quantity } => {
                write!(f, "the instrument was not measured whole: {quantity}")
            }
            Self::DiffuseMayBeStray { diffuse, stray_per_sr } => write!(
                f,
                "the diffuse part ({diffuse:.1e}) may be stray light, of which up to {stray_per_sr:.1e} /sr may be left in the values: take it as an upper bound"
            ),
        }
    }
}

/// A real surface as a law.
#[derive(Debug, Clone, Serialize)]
pub struct SurfaceFit {
    /// At which wavelength, vacuum nm.
    pub wavelength_nm: f64,
    /// The parts of the surface.
    pub recipe: Recipe,
    /// Their name.
    pub name: String,
    /// Their numbers.
    pub numbers: Vec<Number>,
    /// How many samples were used.
    pub values: usize,
    /// Number of independent values that these samples amount to.
    pub independent_values: f64,
    /// The others.
    pub left_out: LeftOut,
    /// Samples that count less, because they lie apart on one side of the mirrored direction alone.
    pub outliers: usize,
    /// The cones of detector and source through which the law was seen.
    pub cone: Cone,
    /// The instrument as the table says it; none where it says nothing.
    pub instrument: Option<TableInstrument>,
    /// How far the law is from the table.
    pub rms_ln: Rms,
    /// How far it may be from the surface, from incidences that were left out and from what all values share.
    pub doubt: Doubt,
    /// By incidence.
    pub incidences: Vec<AtIncidence>,
    /// Directional–hemispherical reflectance by angle of incidence, degrees.
    pub albedo: Vec<(f64, f64)>,
    /// Faults of the fit and of the table.
    pub flaws: Vec<Flaw>,
    /// All recipes that were tried, the chosen one first.
    pub tried: Vec<Tried>,
    /// Rows of the table that were used.
    #[serde(skip)]
    pub used: Vec<usize>,
    /// ln f measured − ln f of the law, by used row.
    #[serde(skip)]
    pub residual: Vec<f64>,
    /// The law.
    #[serde(skip)]
    pub surface: Surface,
}

impl SurfaceFit {
    /// The half-width of the narrowest lobe or mirror about the mirrored direction, degrees; none of diffuse light alone.
    pub fn narrowest_deg(&self) -> Option<f64> {
        self.surface.narrowest().map(f64::to_degrees)
    }

    /// Whether peak and hemispherical reflectance are those of the table at every incidence.
    pub fn is_faithful(&self) -> bool {
        !self.flaws.iter().any(Flaw::needs_consent)
    }

    /// Returns the law as an instrument with this cone sees it, sr⁻¹.
    pub fn seen(&self, i: glam::DVec3, o: glam::DVec3, cone: &Cone) -> f64 {
        let (i, o) = turned(i, o);
        let radius = cone.radius_rad();
        self.surface.seen(i, o, &model::disc(o, radius), 0.5 * radius * radius)
    }

    /// The law as `[[material]]` of a scene, grey: known at one wavelength; with its doubt.
    pub fn to_toml(&self, name: &str) -> String {
        self.toml_of(name, &model::Tint::grey(), None)
    }

    /// The same with colours of its parts.
    fn toml_of(&self, name: &str, tint: &model::Tint, colour: Option<&colour::Coloured>) -> String {
        use fmt::Write as _;
        let mut text = String::new();
        let _ = writeln!(
            text,
            "# {} through {} values at {} nm, residuals of ln f {:.3} (rms); written by `sunglint brdf fit`.\n{}",
            self.name,
            self.values,
            self.wavelength_nm,
            self.rms_ln.all,
            colour.map_or_else(
                || "# The reflectances are those of that wavelength.".to_owned(),
                |colour| format!("# Colour: {}.", colour.division)
            )
        );
        for flaw in &self.flaws {
            let _ = writeln!(text, "# {flaw}.");
        }
        text.push_str(&self.surface.toml(name, tint));
        let Doubt { peak_ln, wings_ln, grazing_ln } = self.doubt;
        let _ = writeln!(
            text,
            "[material.doubt]\npeak_ln = {peak_ln:.4}\nwings_ln = {wings_ln:.4}\ngrazing_ln = {grazing_ln:.4}"
        );
        if let Some(colour) = colour.filter(|c| c.most_apart_ln > 0.0) {
            let _ = writeln!(text, "colour_ln = {:.4}", colour.most_apart_ln);
        }
        if !self.flaws.is_empty() {
            let said: Vec<String> = self
                .flaws
                .iter()
                .map(|f| quoted(&f.to_string().replace(char::is_control, " ")))
                .collect();
            let _ = writeln!(text, "said = [{}]", said.join(", "));
        }
        text
    }
}

/// Fits a surface of several parts to measured values.
///
/// # Errors
/// A wavelength that is not there or not said; an anisotropic table; no incidence with five values; too few values.
pub fn fit_surface(
    samples: &Samples,
    options: &SurfaceOptions,
    progress: &dyn Progress,
) -> Result<SurfaceFit, FitError> {
    let column = wavelength(samples, options.wavelength_nm)?;
    let (mut incidences, left_out) = self::incidences(samples, column, options, RELATIVE)?;
    let cone = options.cone;
    let mut recipes = options.recipes.clone();
    if recipes.is_empty() {
        recipes = search::recipes(options.most_lobes.min(2));
        // A mirror as narrow as it is here shows in the step from one sample to its neighbour: where that is wide it would fit a single sample.
        let steps = incidences.iter().filter_map(Incidence::step_at_peak_deg);
        if sunglint_numerics::order::median(steps).is_none_or(|step| step > MOST_STEP_DEG) {
            recipes.retain(|r| !r.mirror);
        }
        if incidences.len() == 1 {
            // One incidence does not tell what changes with it.
            recipes.retain(|r| !r.mirror && r.rise == Rise::Constant && r.floor != Floor::Falling);
        }
    }
    let count: usize = incidences.iter().map(|i| i.ln.len()).sum();
    recipes.retain(|r| count >= 2 * r.ranges().len() + 3);
    let few: Vec<Incidence> = incidences.iter().map(|i| i.thinned(SEARCHED, &cone)).collect();
    let few: Vec<&Incidence> = few.iter().collect();
    let with = (&cone, search::MISFIT);
    progress.begin("surfaces of up to two lobes", Some(recipes.len() as u64));
    let mut candidates = search::all(&recipes, &few, with, &|| progress.advance(1));
    if options.recipes.is_empty() && incidences.iter().any(Incidence::is_out_of_plane) {
        let more = search::polarised(&candidates);
        progress.begin("surfaces in polarised light", Some(more.len() as u64));
        candidates.extend(search::all(&more, &few, with, &|| progress.advance(1)));
        candidates.sort_by(|a, b| a.found.cost.total_cmp(&b.found.cost));
    }
    if options.recipes.is_empty() && options.most_lobes > 2 {
        let more = three_lobes(&candidates);
        progress.begin("surfaces of three lobes", Some(more.len() as u64));
        candidates.extend(search::all(&more, &few, with, &|| progress.advance(1)));
        candidates.sort_by(|a, b| a.found.cost.total_cmp(&b.found.cost));
    }
    if options.additive_per_sr > 0.0
        && let Some(best) = candidates.first()
    {
        let relative = relative_error(best, &incidences, options);
        incidences = self::incidences(samples, column, options, relative)?.0;
    }
    let refs: Vec<&Incidence> = incidences.iter().collect();
    let misfit = search::misfit(&candidates, &refs, &cone);
    let (mut candidates, others) = search::shortlist(candidates);
    search::finish(&mut candidates, &refs, &cone, misfit);
    progress.begin("incidences left out", None);
    search::leave_out(&mut candidates, &incidences, &cone, misfit);
    let independent = candidates.first().map_or(1.0, |best| {
        let judge = Judge::new(&best.recipe, refs.clone(), &cone, misfit);
        independent(count, alike(&judge.samples(&judge.surface(&best.found.x)), &incidences))
    });
    let Some(chosen) = search::choose(&candidates, independent) else {
        return Err(FitError::Law {
            law: "a surface of several parts".into(),
            reason: "the table has too few values for any of them",
        });
    };
    let mut tried: Vec<Tried> = candidates
        .iter()
        .chain(&others)
        .map(|c| {
            let judge = Judge::new(&c.recipe, refs.clone(), &cone, misfit);
            let residual = judge.samples(&judge.surface(&c.found.x));
            Tried {
                recipe: c.recipe.name(),
                parameters: c.found.x.len(),
                rms_ln: rms(residual.iter().copied()).unwrap_or(f64::NAN),
                cost: c.found.cost,
                left_out: Some(search::score(c)).filter(|s| s.is_finite()),
            }
        })
        .collect();
    let first = tried.remove(chosen);
    tried.sort_by(|a, b| {
        let key = |t: &Tried| t.left_out.unwrap_or(f64::INFINITY);
        (key(a), a.cost).partial_cmp(&(key(b), b.cost)).unwrap_or(std::cmp::Ordering::Equal)
    });
    tried.insert(0, first);
    let mut candidate = candidates.swap_remove(chosen);
    search::to_the_end(&mut candidate, &refs, (&cone, misfit));
    finish(samples, column, &candidate, &incidences, left_out, tried, (&cone, misfit))
}

/// The errors in proportion to the value, from bright samples.
fn relative_error(
    candidate: &Candidate,
    incidences: &[Incidence],
    options: &SurfaceOptions,
) -> f64 {
    let refs: Vec<&Incidence> = incidences.iter().collect();
    let judge = Judge::new(&candidate.recipe, refs, &options.cone, search::MISFIT);
    let residual = judge.samples(&judge.surface(&candidate.found.x));
    let values = incidences.iter().flat_map(|i| i.value.iter().copied());
    let is_bright = |v: f64| v > BRIGHT * options.additive_per_sr;
    let bright = residual.iter().zip(values).filter(|(_, v)| is_bright(*v)).map(|(r, _)| *r);
    let found = sunglint_numerics::order::robust_sigma(bright).unwrap_or(RELATIVE);
    found.clamp(RELATIVES[0], RELATIVES[1])
}

/// The best recipes of two lobes with a third one.
fn three_lobes(candidates: &[Candidate]) -> Vec<Recipe> {
    let mut all: Vec<Recipe> = Vec::new();
    for candidate in candidates.iter().filter(|c| c.recipe.lobes.len() == 2).take(3) {
        for kind in [Kind::Ggx, Kind::Abg] {
            let mut recipe = candidate.recipe.clone();
            recipe.lobes.push(kind);
            recipe.lobes.sort_unstable();
            if !all.contains(&recipe) {
                all.push(recipe);
            }
        }
    }
    all
}

fn rms(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0.0);
    for v in values {
        sum += v * v;
        count += 1.0;
    }
    (count > 0.0).then(|| (sum / count).sqrt())
}

/// The samples of a table by incidence.
fn incidences(
    samples: &Samples,
    column: usize,
    options: &SurfaceOptions,
    relative: f64,
) -> Result<(Vec<Incidence>, LeftOut), FitError> {
    let refused = |reason| FitError::Law { law: "a surface of several parts".into(), reason };
    if samples.has_azimuths() {
        return Err(refused(
            "the table has several azimuths of incidence, and its parts have no tangent: fit one law with --law",
        ));
    }
    let mut left_out = LeftOut::default();
    let least = options.theta_most_deg.to_radians().cos() - 1e-9;
    let limit = saturated(samples, column);
    let additive = options.additive_per_sr;
    let mut rows = Vec::new();
    for (k, row) in samples.rows.iter().enumerate() {
        let value = row.brdf_per_sr[column];
        let (i, o) = row.directions();
        let (i, o) = turned(i, o);
        if value.is_nan() {
            left_out.missing += 1;
        } else if i.z < least.max(1e-6) || o.z < least.max(1e-6) {
            left_out.horizon += 1;
        } else if limit.is_some_and(|limit| limit.holds(value, o)) {
            left_out.saturated += 1;
        } else if value <= 0.0 && additive <= 0.0 {
            left_out.not_above_zero += 1;
        } else if options.floor_per_sr.is_some_and(|floor| value <= floor) {
            left_out.at_floor += 1;
        } else {
            let sigma = row.sigma_per_sr.get(column).copied().unwrap_or(f64::NAN);
            rows.push((row.theta_i_deg.abs(), k, i, o, value, sigma / value));
        }
    }
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    // Relative uncertainties over their median, where all are known.
    let known = rows.iter().all(|r| r.5 > 0.0 && r.5.is_finite());
    let middle = sunglint_numerics::order::median(rows.iter().map(|r| r.5)).unwrap_or(1.0);
    let mut groups: Vec<(f64, glam::DVec3, Vec<judge::Row>)> = Vec::new();
    for (theta, k, i, o, value, relative) in rows {
        let is_known = known && additive <= 0.0;
        let unit = if is_known { (relative / middle).max(1.0) } else { 1.0 };
        match groups.last_mut() {
            Some(group) if (theta - group.0).abs() < 1e-3 => group.2.push((k, o, value, unit)),
            _ => groups.push((theta, i, vec![(k, o, value, unit)])),
        }
    }
    // A handful of values says nothing of an incidence as a whole.
    groups.retain(|g| {
        let is_enough = g.2.len() >= LEAST_VALUES;
        left_out.few += if is_enough { 0 } else { g.2.len() };
        is_enough
    });
    if groups.is_empty() {
        return Err(refused(
            "the table has no incidence with five values or more: fit one law with --law",
        ));
    }
    let equal = additive / relative;
    let made = groups
        .into_iter()
        .map(|(theta, i, rows)| Incidence::new(theta, i, rows, &options.cone, equal));
    Ok((made.collect(), left_out))
}

/// Evaluates the chosen candidate: its numbers, its errors and its faults.
fn finish(
    samples: &Samples,
    column: usize,
    candidate: &Candidate,
    incidences: &[Incidence],
    left_out: LeftOut,
    tried: Vec<Tried>,
    (cone, misfit): (&Cone, f64),
) -> Result<SurfaceFit, FitError> {
    let refs: Vec<&Incidence> = incidences.iter().collect();
    let mut judge = Judge::new(&candidate.recipe, refs, cone, misfit);
    judge.weight.clone_from(&candidate.weight);
    let (x, albedo, held) = settled(&judge, &candidate.found.x, incidences)?;
    let surface = judge.surface(&x);
    let residual = judge.samples(&surface);
    let unit: Vec<f64> = incidences.iter().flat_map(|i| i.unit.iter().copied()).collect();
    let raw: Vec<f64> = residual.iter().zip(&unit).map(|(r, u)| r * u).collect();
    let count = raw.len();
    let independent = independent(count, alike(&residual, incidences));
    let sigma = judge.sigmas(&x, independent);
    let quantile = student_quantile(count.saturating_sub(x.len()).max(1) as f64);
    let bounds = judge.bounds();
    let instrument = TableInstrument::of(samples);
    let common = instrument.as_ref().map(|instrument| Common {
        instrument,
        surface: &surface,
        cone: *cone,
        incidences,
    });
    let numbers = candidate.recipe.ranges().into_iter().enumerate().map(|(j, range)| {
        let value = x[j].exp();
        let shared = |own: f64| common.as_ref().map_or(own, |c| c.sigma(range.key, value, own));
        let sigma_ln = sigma[j].map(shared);
        let interval = sigma_ln
            .map(|s| Interval::new(value * (-quantile * s).exp(), value * (quantile * s).exp()));
        Number {
            name: range.key,
            lobe: Some(range.lobe).filter(|l| *l > 0),
            value,
            sigma_ln,
            interval,
            at_bound: x[j] <= bounds[j].low + 1e-6 || x[j] >= bounds[j].high - 1e-6,
        }
    });
    let numbers: Vec<Number> = numbers.collect();
    let region: Vec<Region> = incidences.iter().flat_map(|i| i.region.iter().copied()).collect();
    let of =
        |which: Region| rms(raw.iter().zip(&region).filter(|(_, r)| **r == which).map(|(v, _)| *v));
    let rms_ln = Rms {
        all: rms(raw.iter().copied()).unwrap_or(f64::NAN),
        peak: of(Region::Peak),
        wings: of(Region::Wings),
        grazing: of(Region::Grazing),
    };
    let doubt = doubt(candidate, incidences, &raw);
    let doubt = common.as_ref().map_or(doubt, |common| common.widened(doubt));
    let (mut told, mut flaws, mut at) = (Vec::new(), Vec::new(), 0);
    for (k, incidence) in incidences.iter().enumerate() {
        let n = incidence.ln.len();
        let seen = incidence.seen(&surface, judge.blur2);
        let (hemispherical_ratio, ratio) = incidence.ratios(&seen);
        let theta_i_deg = incidence.theta_i_deg;
        let mirrored = glam::DVec3::new(-incidence.i.x, -incidence.i.y, incidence.i.z);
        let peak = incidence.peak.first().zip(ratio).map(|(k, ratio)| Peak {
            off_deg: incidence.o[*k].angle_between(mirrored).to_degrees(),
            table_per_sr: incidence.value[*k],
            ratio,
        });
        let hemisphere = &incidence.hemisphere;
        let known = |value: f64| if hemisphere.is_known() { value } else { f64::NAN };
        let hemispherical = known(incidence.hemispherical);
        let tis = samples.tis(theta_i_deg);
        if !hemisphere.is_resolved() {
            let ln_doubt = hemisphere.ln_doubt;
            flaws.push(Flaw::PeakNotResolved { theta_i_deg, hemispherical, ln_doubt });
        }
        if hemispherical * (-hemisphere.ln_doubt).exp() > judge::MOST_OF_TABLE {
            flaws.push(Flaw::TableGains { theta_i_deg, hemispherical });
        }
        if let Some(tis) = tis.filter(|tis| is_other(*tis, hemispherical, incidence)) {
            flaws.push(Flaw::Tis { theta_i_deg, hemispherical, tis });
        }
        if hemisphere.is_known() && (hemispherical_ratio - 1.0).abs() > MOST_OFF[0] {
            flaws.push(Flaw::Hemispherical { theta_i_deg, ratio: hemispherical_ratio });
        }
        if let Some(ratio) = ratio.filter(|r| (r - 1.0).abs() > MOST_OFF[1]) {
            flaws.push(Flaw::Peak { theta_i_deg, ratio });
        }
        told.push(AtIncidence {
            theta_i_deg,
            values: n,
            rms_ln: rms(raw[at..at + n].iter().copied()).unwrap_or(f64::NAN),
            hemispherical_table: hemispherical,
            hemispherical_ln_doubt: incidence.hemisphere.ln_doubt,
            tis,
            coverage: incidence.hemisphere.coverage,
            hemispherical_ratio,
            peak,
            albedo: albedo.iter().find(|a| a.0 == theta_i_deg).map_or(f64::NAN, |a| a.1),
            unseen: unseen(candidate, k, incidence, &doubt),
        });
        at += n;
    }
    if held {
        let most = albedo.iter().copied().fold((0.0, 0.0), |m, a| if a.1 > m.1 { a } else { m });
        flaws.push(Flaw::Held { theta_i_deg: most.0, albedo: most.1 });
    }
    if incidences.len() < FEW_INCIDENCES {
        flaws.push(Flaw::FewIncidences { incidences: incidences.len() });
    }
    if let Some(limit) = saturated(samples, column).filter(|_| left_out.saturated > 0) {
        let (per_sr, values) = (limit.per_sr, left_out.saturated);
        flaws.push(Flaw::Saturated { per_sr, signal: limit.signal, values });
    }
    if left_out.not_above_zero + left_out.few + left_out.missing > 0 {
        flaws.push(Flaw::LeftOut { left_out });
    }
    flaws.extend(reciprocity(incidences, &raw));
    if let Some(common) = &common {
        flaws.extend(common.flaws(&numbers));
    }
    Ok(SurfaceFit {
        wavelength_nm: samples.wavelength_nm[column],
        name: candidate.recipe.name(),
        recipe: candidate.recipe.clone(),
        numbers,
        values: count,
        independent_values: independent,
        left_out,
        outliers: candidate.weight.iter().filter(|w| **w < 1.0).count(),
        cone: *cone,
        instrument: instrument.clone(),
        rms_ln,
        doubt,
        incidences: told,
        albedo,
        flaws,
        tried,
        used: incidences.iter().flat_map(|i| i.row.iter().copied()).collect(),
        residual: raw,
        surface,
    })
}

/// Whether a stated reflectance is not that of the values, beyond 10 % and what lies between the samples.
fn is_other(tis: f64, hemispherical: f64, incidence: &Incidence) -> bool {
    (hemispherical / tis).ln().abs() > MOST_OFF[0] + incidence.hemisphere.ln_doubt
}

/// Numbers, albedos by angle of incidence, and whether energy held them back.
type Settled = (Vec<f64>, Vec<(f64, f64)>, bool);

/// Numbers at which the material's own quadrature finds no more light than came at any angle; the albedos there, and whether energy held the fit back.
fn settled(judge: &Judge<'_>, x: &[f64], incidences: &[Incidence]) -> Result<Settled, FitError> {
    let mut x = x.to_vec();
    let strengths: Vec<usize> = judge
        .recipe
        .ranges()
        .iter()
        .enumerate()
        .filter(|(_, r)| matches!(r.key, "share" | "mirror_share" | "diffuse"))
        .map(|(k, _)| k)
        .collect();
    let mut angles: Vec<f64> = TOLD_DEG.to_vec();
    angles.extend(incidences.iter().map(|i| i.theta_i_deg));
    angles.sort_by(f64::total_cmp);
    angles.dedup();
    let mut albedo = Vec::new();
    for _ in 0..24 {
        let over = match judge.surface(&x).material("fit") {
            Ok(material) => {
                albedo = angles
                    .iter()
                    .map(|deg| {
                        let (sin, cos) = deg.to_radians().sin_cos();
                        Ok((*deg, material.albedo(550.0, glam::DVec3::new(sin, 0.0, cos))?))
                    })
                    .collect::<Result<Vec<_>, MaterialError>>()?;
                albedo.iter().fold(0.0_f64, |m, a| m.max(a.1))
            }
            Err(MaterialError::Gain { albedo, .. }) => albedo.max(1.0005),
            Err(MaterialError::Parameter { value, .. }) if value > 1.0 => value,
            Err(error) => return Err(error.into()),
        };
        if over <= 1.0 {
            break;
        }
        for k in &strengths {
            x[*k] -= over.ln() + 1e-5;
        }
    }
    let most = albedo.iter().fold(0.0_f64, |m, a| m.max(a.1));
    Ok((x, albedo, most > 0.97))
}

/// The correlation of neighbours' residuals, incidence by incidence in the order along the plane of incidence.
fn alike(residual: &[f64], incidences: &[Incidence]) -> f64 {
    let (mut products, mut squares, mut pairs, mut at) = (0.0, 0.0, 0_usize, 0);
    for incidence in incidences {
        let n = incidence.o.len();
        let mut order: Vec<usize> = (0..n).collect();
        let key = |k: &usize| {
            let o = incidence.o[*k];
            ((o.y.abs() / (1.0 + o.z) * 50.0).round(), o.x)
        };
        order.sort_by(|a, b| key(a).partial_cmp(&key(b)).unwrap_or(std::cmp::Ordering::Equal));
        for w in order.windows(2) {
            let (a, b) = (residual[at + w[0]], residual[at + w[1]]);
            products += a * b;
            squares += 0.5 * (a * a + b * b);
            pairs += 1;
        }
        at += n;
    }
    let found = if squares > 0.0 { products / squares } else { 0.0 };
    // What chance gives is none.
    if found < 2.5 / (pairs.max(1) as f64).sqrt() { 0.0 } else { found.min(0.999) }
}

/// The 95 % point of |ln f| where it was left out, by region: of interior incidences where there are any, of all else; at least that of the fit itself.
fn doubt(candidate: &Candidate, incidences: &[Incidence], raw: &[f64]) -> Doubt {
    let any = candidate.folds.iter().any(|f| f.interior);
    let point = |region: Option<Region>, interior: bool| {
        let mut all = Vec::new();
        for fold in candidate.folds.iter().filter(|f| f.interior || !interior) {
            let incidence = &incidences[fold.incidence];
            for (k, r) in fold.residual.iter().enumerate() {
                if region.is_none_or(|region| incidence.region[k] == region) {
                    all.push((r * incidence.unit[k]).abs());
                }
            }
        }
        all.sort_by(f64::total_cmp);
        (all.len() >= 5).then(|| quantile(&all, 0.95))
    };
    let mut own: Vec<f64> = raw.iter().map(|r| r.abs()).collect();
    own.sort_by(f64::total_cmp);
    let of_fit = quantile(&own, 0.95);
    let of = |region: Region| {
        // Of a region without a sample no error is known that a law makes there.
        let is_seen = incidences.iter().any(|i| i.region.contains(&region));
        let found = point(Some(region), any).or_else(|| point(Some(region), false));
        let unknown = if candidate.folds.is_empty() || !is_seen { UNKNOWN_LN } else { 0.0 };
        found.unwrap_or_else(|| point(None, false).unwrap_or(of_fit).hypot(unknown))
    };
    Doubt {
        peak_ln: of(Region::Peak),
        wings_ln: of(Region::Wings),
        grazing_ln: of(Region::Grazing),
    }
}

fn unseen(candidate: &Candidate, k: usize, incidence: &Incidence, doubt: &Doubt) -> Option<Unseen> {
    let fold = candidate.folds.iter().find(|f| f.incidence == k)?;
    let raw: Vec<f64> = fold.residual.iter().zip(&incidence.unit).map(|(r, u)| r * u).collect();
    let half = |region: &Region| match region {
        Region::Peak => doubt.peak_ln,
        Region::Wings => doubt.wings_ln,
        Region::Grazing => doubt.grazing_ln,
    };
    let inside = raw.iter().zip(&incidence.region).filter(|(r, g)| r.abs() <= half(g)).count();
    let halves = incidence.region.iter().map(half);
    Some(Unseen {
        rms_ln: rms(raw.iter().copied())?,
        hemispherical_ratio: fold.hemispherical,
        peak_ratio: fold.peak,
        inside: inside as f64 / raw.len() as f64,
        half_width_ln: sunglint_numerics::order::median(halves)?,
        extrapolated: !fold.interior,
    })
}

/// Differences of ln f with light and detector exchanged larger than this, rms, are said.
const MOST_APART: f64 = 0.10;

/// Compares what was measured both ways: samples with the nearest of another incidence to their exchange, each over the law, which is reciprocal, so that the fall between both directions is none. What
/// the noise of neighbours explains is no difference.
fn reciprocity(incidences: &[Incidence], residual: &[f64]) -> Option<Flaw> {
    let mut differences = Vec::new();
    let from: Vec<usize> = incidences
        .iter()
        .scan(0, |at, i| {
            *at += i.ln.len();
            Some(*at - i.ln.len())
        })
        .collect();
    for (m, a) in incidences.iter().enumerate() {
        for (n, b) in incidences.iter().enumerate() {
            if b.theta_i_deg <= a.theta_i_deg {
                continue;
            }
            for (k, o) in a.o.iter().enumerate() {
                // Light from a's incidence to b's direction: on b's side both have the azimuths of light exchanged.
                let theta = o.z.acos().to_degrees();
                if (theta - b.theta_i_deg).abs() > 0.6 || o.y.abs() > 2e-3 {
                    continue;
                }
                let wanted = glam::DVec3::new(a.i.x * o.x.signum(), 0.0, a.i.z);
                let near =
                    b.o.iter().enumerate().min_by(|p, q| {
                        p.1.angle_between(wanted).total_cmp(&q.1.angle_between(wanted))
                    });
                if let Some((j, found)) = near
                    && found.angle_between(wanted).to_degrees() < 0.6
                    && a.region[k] != Region::Peak
                    && b.region[j] != Region::Peak
                {
                    differences.push(residual[from[m] + k] - residual[from[n] + j]);
                }
            }
        }
    }
    let rms_ln = rms(differences.iter().copied())?;
    let pairs = differences.len();
    // As far as neighbours along the plane of incidence differ, both ways may; and so few pairs scatter.
    let chance = noise(incidences, residual) * (1.0 + 3.0 / (2.0 * pairs as f64).sqrt());
    (rms_ln > MOST_APART.max(chance)).then_some(Flaw::NotReciprocal { pairs, rms_ln })
}

/// The scatter of the difference of two samples: that of neighbours in the plane of incidence.
fn noise(incidences: &[Incidence], residual: &[f64]) -> f64 {
    let (mut steps, mut at) = (Vec::new(), 0);
    for incidence in incidences {
        let mut order: Vec<usize> =
            (0..incidence.o.len()).filter(|k| incidence.o[*k].y.abs() < 2e-3).collect();
        order.sort_by(|a, b| incidence.o[*a].x.total_cmp(&incidence.o[*b].x));
        steps.extend(order.windows(2).map(|w| residual[at + w[1]] - residual[at + w[0]]));
        at += incidence.o.len();
    }
    sunglint_numerics::order::robust_sigma(steps).unwrap_or(0.0)
}
