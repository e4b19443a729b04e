//! Light of a body for directions that are given, without orbit, station and air.
//!
//! An [`Aspect`] says where the Sun, the observer and, where its light is wanted, the Earth stand in the body's axes. [`Intensities`] prepares a target once for
//! all aspects of a [`Span`] and gives for each the weights W_k of its terms (\[m² sr⁻¹\], I(λ) = E(λ) Σ_k τ_k(λ) W_k, see [`crate::light`]), the sum at some
//! wavelengths, and the stated errors of both.

pub mod rows;

mod pool;

pub use pool::{Held, IntensityPool};

use crate::light::engine::{self, Aspects, Switches};
use crate::light::{
    Course, DirectionError, EarthAlbedo, Engine, Globe, Lighting, Need, Options, SceneError,
    Source, Stated, Term, View, Way,
};
use crate::pass::light_name;
use crate::pass::material::{DOUBT_TOLERANCE, doubted};
use crate::surface::{MaterialError, is_uncovered};
use crate::target::Target;
use glam::{DQuat, DVec3};
use rayon::prelude::*;
use serde::Serialize;
use std::sync::Arc;
use sunglint_ephemeris::orbit::eclipse::EARTH_EQUATORIAL_RADIUS_M;
use sunglint_radiometry::constants::{AU_M, SUN_RADIUS_M};
use sunglint_radiometry::light::sun_at_1_au;

/// Where Sun, observer and Earth stand, in the body's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aspect {
    /// The direction to the Sun; its length does not count.
    pub sun: DVec3,
    /// The direction to the observer.
    pub observer: DVec3,
    /// The observer's distance, m; `None` where all lines of sight are parallel.
    pub range_m: Option<f64>,
    /// The Sun's distance, au.
    pub sun_distance_au: f64,
    /// The direction to the middle of the Earth and the height above its equator's radius, m; `None` without an Earth.
    pub earth: Option<(DVec3, f64)>,
}

impl Aspect {
    /// The Sun at 1 au, a far observer and no Earth.
    pub fn new(sun: DVec3, observer: DVec3) -> Self {
        Self { sun, observer, range_m: None, sun_distance_au: 1.0, earth: None }
    }

    /// The light, as the engine has it.
    fn lighting(&self) -> Lighting {
        let observer = self.observer.normalize_or_zero();
        let sun = self.sun.normalize_or_zero();
        let earth = match self.earth {
            Some((toward, height_m)) => Globe {
                toward: toward.normalize_or_zero(),
                distance_m: EARTH_EQUATORIAL_RADIUS_M + height_m,
                radius_m: EARTH_EQUATORIAL_RADIUS_M,
                sun,
                to_ground: DQuat::IDENTITY,
            },
            // Far away, and so without light.
            None => Globe {
                toward: -sun,
                distance_m: 1e3 * AU_M,
                radius_m: EARTH_EQUATORIAL_RADIUS_M,
                sun,
                to_ground: DQuat::IDENTITY,
            },
        };
        Lighting {
            sun_body: sun,
            sun_radius_rad: self.sun_radius_rad(),
            shadow: None,
            sunlit: 1.0,
            sunlit_error: 0.0,
            earth: Some(earth),
            moon: None,
            view: self.range_m.map_or(View::Distant(observer), |m| View::At(m * observer)),
        }
    }

    fn sun_radius_rad(&self) -> f64 {
        (SUN_RADIUS_M / (self.sun_distance_au * AU_M)).asin()
    }

    /// Checks that its numbers are some.
    fn check(&self) -> Result<(), IntensityError> {
        let wrong = |what, value, expected| Err(IntensityError::Value { what, value, expected });
        let direction = |d: DVec3| d.is_finite() && d.length() > 1e-9;
        let directions = [
            ("the direction to the Sun", Some(self.sun)),
            ("the direction to the observer", Some(self.observer)),
            ("the direction to the Earth", self.earth.map(|e| e.0)),
        ];
        for (what, value) in directions {
            if let Some(value) = value.filter(|d| !direction(*d)) {
                return Err(DirectionError::NoDirection { what, value }.into());
            }
        }
        if let Some(m) = self.range_m.filter(|m| !(m.is_finite() && *m > 0.0)) {
            return wrong("the observer's distance, m,", m, "a number above 0");
        }
        if !(0.05..=100.0).contains(&self.sun_distance_au) {
            return wrong("the Sun's distance, au,", self.sun_distance_au, "0.05 to 100");
        }
        if let Some((_, m)) = self.earth.filter(|e| !(1e4..=1e12).contains(&e.1)) {
            return wrong("the height above the Earth, m,", m, "1e4 to 1e12");
        }
        Ok(())
    }
}

/// Common properties of many aspects, which decide which effects are modelled.
#[derive(Debug, Clone, PartialEq)]
pub struct Span {
    course: Course,
}

impl Default for Span {
    fn default() -> Self {
        let course = Course {
            epochs: 0,
            geometries: 0,
            range_m: f64::INFINITY,
            radius_m: (f64::INFINITY, 0.0),
            sun_radius_rad: 0.0,
            phase_rad: 0.0,
            earthshine: 0.0,
            moon: false,
            penumbra: 0,
            umbra: 0,
            shadow: false,
            aspects: Aspects::default(),
        };
        Self { course }
    }
}

impl Span {
    /// Adds an aspect.
    ///
    /// # Errors
    /// [`IntensityError::Direction`] and [`IntensityError::Value`]: numbers that are none.
    pub fn add(&mut self, aspect: &Aspect) -> Result<(), IntensityError> {
        aspect.check()?;
        let course = &mut self.course;
        course.epochs += 1;
        course.geometries += 1;
        course.range_m = course.range_m.min(aspect.range_m.unwrap_or(f64::INFINITY));
        course.sun_radius_rad = course.sun_radius_rad.max(aspect.sun_radius_rad());
        course.phase_rad = course.phase_rad.max(aspect.sun.angle_between(aspect.observer));
        let (sun, observer) = (aspect.sun.normalize_or_zero(), aspect.observer.normalize_or_zero());
        course.aspects.add(sun, observer);
        if let (Some(_), Some(earth)) = (aspect.earth, aspect.lighting().earth) {
            let (least, most) = course.radius_m;
            course.radius_m = (least.min(earth.distance_m), most.max(earth.distance_m));
            let most = EarthAlbedo::default().most();
            course.earthshine = course.earthshine.max(engine::earthshine(&earth, most));
        }
        Ok(())
    }

    /// Adds the aspects of another span.
    pub fn join(&mut self, other: &Self) {
        let (own, course) = (&mut self.course, &other.course);
        own.epochs += course.epochs;
        own.geometries += course.geometries;
        own.range_m = own.range_m.min(course.range_m);
        own.sun_radius_rad = own.sun_radius_rad.max(course.sun_radius_rad);
        own.phase_rad = own.phase_rad.max(course.phase_rad);
        let (least, most) = own.radius_m;
        own.radius_m = (least.min(course.radius_m.0), most.max(course.radius_m.1));
        own.earthshine = own.earthshine.max(course.earthshine);
        own.aspects.join(&course.aspects);
    }

    /// Aspects so far.
    pub fn len(&self) -> usize {
        self.course.epochs
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Options of an intensity computation.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct IntensityOptions {
    /// The relative error that is asked for, and the bound above which an effect is modelled.
    pub tolerance: f64,
    /// The work that an aspect's light between surfaces may cost, CPU seconds.
    pub budget_s: f64,
    /// Effects that are switched on or off.
    pub switches: Switches,
    /// Vacuum wavelengths, nm.
    pub wavelength_nm: Vec<f64>,
    /// Whether derivatives by the materials' albedos are wanted.
    pub derivatives: bool,
}

impl Default for IntensityOptions {
    fn default() -> Self {
        let Options { tolerance, budget_s, switches } = Options::default();
        Self { tolerance, budget_s, switches, wavelength_nm: vec![550.0], derivatives: false }
    }
}

/// Why there is no light to give.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum IntensityError {
    /// A direction that is none.
    #[error(transparent)]
    Direction(#[from] DirectionError),
    /// A number out of its range.
    #[error("{what} is {value}, expected {expected}")]
    Value {
        /// Which number.
        what: &'static str,
        /// The number.
        value: f64,
        /// The range.
        expected: &'static str,
    },
    /// A target that the engine refuses.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A material that cannot be made.
    #[error(transparent)]
    Material(#[from] MaterialError),
    /// A wavelength that a material's tables do not cover.
    #[error(
        "the material {material} is tabulated from {from_nm} to {to_nm} nm: there is no light at {nm} nm"
    )]
    Wavelength {
        /// The material.
        material: String,
        /// The first wavelength of its tables.
        from_nm: f64,
        /// The last.
        to_nm: f64,
        /// Requested wavelength, nm.
        nm: f64,
    },
    /// Derivatives of light that is not linear in an albedo.
    #[error(
        "light between surfaces is modelled for this target ({why}), and it is not linear in an albedo: derivatives by albedos are given of light that is scattered once; leave it out (`--without inter_reflection`, `Switches::inter_reflection`) to have them"
    )]
    NotLinear {
        /// Why it is modelled.
        why: String,
    },
}

/// One term of the light.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Weight {
    /// The way of the light: `direct`, `inter-reflection` or `earthshine`.
    pub source: &'static str,
    /// The material that sent it; none where it went by several.
    pub material: Option<String>,
    /// W, m² sr⁻¹, before the term's spectrum.
    pub weight_m2_per_sr: f64,
    /// Stated error of the weight.
    pub error_m2_per_sr: f64,
}

/// The light at one wavelength.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct At {
    /// Vacuum wavelength, nm.
    pub wavelength_nm: f64,
    /// Radiant intensity over the Sun's irradiance, m² sr⁻¹.
    pub per_irradiance_m2_per_sr: f64,
    /// Stated error of the light, a bound; how well the materials are known is not in it.
    pub error_m2_per_sr: f64,
    /// Half-width of the 95 % interval that the light has by what the materials say of themselves ([`crate::surface::Material::ln_doubt`]), from direct sunlight, all directions of a material off alike; none where no material says it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub material_m2_per_sr: Option<f64>,
    /// Spectral radiant intensity under the Sun's irradiance (ASTM G173-03) at its distance, W sr⁻¹ nm⁻¹.
    pub intensity_w_per_sr_nm: f64,
}

/// The derivative by the logarithm of a material's albedo: what a change of all its reflectances by a small share brings, over that share.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ByAlbedo {
    /// The material.
    pub material: String,
    /// d(I/E)/d ln ρ at each wavelength, m² sr⁻¹.
    pub derivative_m2_per_sr: Vec<f64>,
    /// Stated error of the derivative, for the light that is modelled.
    pub error_m2_per_sr: Vec<f64>,
}

/// The light of one aspect.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Intensity {
    /// The unit vector to the Sun, body axes.
    pub sun: [f64; 3],
    /// The unit vector to the observer.
    pub observer: [f64; 3],
    /// The phase angle, degrees.
    pub phase_deg: f64,
    /// The largest stated error over the wavelengths, relative; none without light.
    pub stated_relative: Option<f64>,
    /// Whether that is within the tolerance. Where there is no light at a wavelength no error is within it, unless it is nothing: 1e-9 sr⁻¹ of the body's area.
    pub met: bool,
    /// Which light has most of the stated error, where that is more than the tolerance.
    pub limited_by: Option<&'static str>,
    /// The light at each wavelength.
    pub light: Vec<At>,
    /// The terms that have light or an error.
    pub weights: Vec<Weight>,
    /// Derivatives by albedos, where they are wanted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub by_albedo: Option<Vec<ByAlbedo>>,
}

/// A target that is prepared for some aspects.
#[derive(Debug)]
pub struct Intensities {
    engine: Engine,
    options: IntensityOptions,
    materials: Vec<String>,
    /// τ of each term at each wavelength: `[term * wavelengths + s]`.
    tau: Vec<f64>,
    /// Way of each term's error into that of all light.
    ways: Vec<Way>,
    /// The Sun's irradiance at 1 au at each wavelength, W m⁻² nm⁻¹.
    sun: Vec<f64>,
    /// Terms whose weight says that geometries were not measured.
    uncovered: Vec<usize>,
    /// The target with the doubt of one material in place of its light and the others black, material by material.
    doubted: Vec<Intensities>,
}

impl Intensities {
    /// Prepares a target for the aspects of a span.
    ///
    /// # Errors
    /// [`IntensityError`]: a target that the engine refuses, a wavelength without tables, derivatives of what is not linear.
    pub fn new(
        target: &Target,
        options: IntensityOptions,
        span: &Span,
    ) -> Result<Self, IntensityError> {
        let mut made = Self::alone(target, options, span)?;
        let switches = Switches { solar_disc: made.options.switches.solar_disc, ..Switches::OFF };
        let tolerance = made.options.tolerance.max(DOUBT_TOLERANCE);
        let options =
            IntensityOptions { tolerance, switches, derivatives: false, ..made.options.clone() };
        for (_, body) in doubted(target)? {
            made.doubted.push(Self::alone(&body, options.clone(), span)?);
        }
        Ok(made)
    }

    /// The same without the doubt of the materials.
    fn alone(
        target: &Target,
        options: IntensityOptions,
        span: &Span,
    ) -> Result<Self, IntensityError> {
        let asked = Options {
            tolerance: options.tolerance,
            switches: options.switches,
            budget_s: options.budget_s,
        };
        let engine = Engine::over(target, &asked, &span.course, &Arc::default())?;
        let materials: Vec<String> = target.materials.iter().map(|m| m.name.clone()).collect();
        let nm = &options.wavelength_nm;
        for term in engine.terms() {
            let (Source::Direct, Some(material)) = (term.source, term.material) else { continue };
            let (from_nm, to_nm) = term.spectrum.range_nm();
            if is_uncovered((from_nm, to_nm)) {
                continue;
            }
            if let Some(nm) = nm.iter().copied().find(|nm| !(from_nm..=to_nm).contains(nm)) {
                let material = materials[material].clone();
                return Err(IntensityError::Wavelength { material, from_nm, to_nm, nm });
            }
        }
        let lit = &engine.terms()[..engine.lit_terms()];
        if options.derivatives && lit.iter().any(|t| t.material.is_none()) {
            let bounced = |n: &&Need| n.effect == "inter-reflection";
            let why = engine.needs().iter().find(bounced).map_or(String::new(), |n| n.why.clone());
            return Err(IntensityError::NotLinear { why });
        }
        let at = |term: &Term| nm.iter().map(|nm| term.spectrum.at(*nm)).collect::<Vec<f64>>();
        let tau = engine.terms().iter().flat_map(at).collect();
        let sun = nm.iter().map(|nm| sun_at_1_au().at(*nm)).collect();
        let terms = engine.terms().iter().enumerate();
        let marks = terms.filter(|(_, term)| is_uncovered(term.spectrum.range_nm()));
        let uncovered = marks.map(|(k, _)| k).collect();
        let doubted = Vec::new();
        let ways = engine.terms().iter().map(Term::way).collect();
        Ok(Self { engine, options, materials, tau, ways, sun, uncovered, doubted })
    }

    /// Returns the target's needs, effect by effect. The Earth's shadow is none of them: the body is in full sunlight.
    pub fn needs(&self) -> Vec<Need> {
        self.engine.needs().iter().filter(|need| need.effect != "eclipse").cloned().collect()
    }

    /// Whether a material says how well it is known, so that the light has [`At::material_m2_per_sr`].
    pub fn has_material_doubt(&self) -> bool {
        !self.doubted.is_empty()
    }

    /// Warnings about the target.
    pub fn warnings(&self) -> &[String] {
        &self.engine.scene().report().warnings
    }

    /// The options.
    pub fn options(&self) -> &IntensityOptions {
        &self.options
    }

    /// The light of many aspects, side by side, in their order.
    ///
    /// # Errors
    /// Those of [`IntensityWorker::light`], of the first aspect that has one.
    pub fn many(&self, aspects: &[Aspect]) -> Result<Vec<Intensity>, IntensityError> {
        let one = |worker: &mut IntensityWorker<'_>, aspect: &Aspect| worker.light(aspect);
        let all: Vec<Result<Intensity, IntensityError>> =
            aspects.par_iter().map_init(|| self.worker(), one).collect();
        all.into_iter().collect()
    }

    /// Spectral radiant intensity, W sr⁻¹ nm⁻¹, under the Sun at an aspect's distance, of the light over its irradiance at the wavelength of a number, m² sr⁻¹.
    pub fn intensity(&self, wavelength: usize, aspect: &Aspect, light_m2_per_sr: f64) -> f64 {
        aspect.sun_distance_au.powi(-2) * self.sun[wavelength] * light_m2_per_sr
    }

    /// Room to work in: one for each thread.
    pub fn worker(&self) -> IntensityWorker<'_> {
        let row = vec![0.0; self.engine.terms().len()];
        let worker = self.engine.worker();
        let doubted = self.doubted.iter().map(Self::worker).collect();
        IntensityWorker { all: self, worker, weights: row.clone(), errors: row, doubted }
    }
}

/// A prepared target with room to work in.
pub struct IntensityWorker<'a> {
    all: &'a Intensities,
    worker: engine::Worker<'a>,
    weights: Vec<f64>,
    errors: Vec<f64>,
    doubted: Vec<IntensityWorker<'a>>,
}

/// Error of light that is not there, sr⁻¹ of the body's area, that is none: 3e-9 of white paint.
const NOTHING: f64 = 1e-9;

fn phase_deg(aspect: &Aspect) -> f64 {
    aspect.sun.angle_between(aspect.observer).to_degrees()
}

/// Companions of the light of one aspect, where the light itself is written to rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lit {
    /// The phase angle, degrees.
    pub phase_deg: f64,
    /// Whether the largest stated error over the wavelengths is within the tolerance ([`Intensity::met`]).
    pub met: bool,
}

impl IntensityWorker<'_> {
    /// Finds the weights of all terms and their errors.
    fn weigh(&mut self, aspect: &Aspect, lighting: &Lighting) -> Result<(), IntensityError> {
        aspect.check()?;
        if let View::At(place) = lighting.view
            && place.length() < self.all.engine.body().size_m
            && self.all.engine.scene().encloses(place)
        {
            let value = place.length();
            let (what, expected) = ("the observer's distance, m,", "a place outside of the body");
            return Err(IntensityError::Value { what, value, expected });
        }
        self.worker.light(lighting, &mut self.weights, &mut self.errors)?;
        Ok(())
    }

    /// The light over the Sun's irradiance at a wavelength and its stated error, m² sr⁻¹, of the weights at hand.
    fn sums(&self, s: usize) -> (f64, f64) {
        let (all, count) = (self.all, self.all.sun.len());
        let tau = |k: usize| all.tau[k * count + s];
        let light = (0..all.engine.lit_terms()).map(|k| tau(k) * self.weights[k]).sum();
        let mut stated = Stated::default();
        for ((k, way), error) in all.ways.iter().enumerate().zip(&self.errors) {
            stated.add(*way, tau(k).abs() * error);
        }
        (light, stated.total())
    }

    /// Whether the error of some light is as small as was asked for.
    fn is_met(&self, light: f64, error: f64) -> bool {
        match light > 0.0 {
            true => error / light <= self.all.options.tolerance,
            false => error <= NOTHING * self.all.engine.body().area_m2(),
        }
    }

    /// The same light as [`IntensityWorker::light`], written to two rows of one number for each wavelength: over the Sun's irradiance, m² sr⁻¹, and its stated
    /// error. It allocates nothing.
    ///
    /// # Errors
    /// Those of [`IntensityWorker::light`]; rows of another length than the wavelengths.
    pub fn light_into(
        &mut self,
        aspect: &Aspect,
        light: &mut [f64],
        error: &mut [f64],
    ) -> Result<Lit, IntensityError> {
        let expected = self.all.sun.len();
        for found in [light.len(), error.len()] {
            if found != expected {
                return Err(DirectionError::Room { found, expected }.into());
            }
        }
        self.weigh(aspect, &aspect.lighting())?;
        let mut met = true;
        for (s, (light, error)) in light.iter_mut().zip(error).enumerate() {
            (*light, *error) = self.sums(s);
            met &= self.is_met(*light, *error);
        }
        Ok(Lit { phase_deg: phase_deg(aspect), met })
    }

    /// The light at one of the wavelengths by the material that sent it, written to two rows of one number for each material and one more, for light that went by several:
    /// over the Sun's irradiance, m² sr⁻¹, and its stated error. The sum of the first is what [`IntensityWorker::light_into`] gives, that of the errors no less than its.
    ///
    /// # Errors
    /// Those of [`IntensityWorker::light`]; rows of another length.
    pub fn light_by_material(
        &mut self,
        aspect: &Aspect,
        wavelength: usize,
        light: &mut [f64],
        error: &mut [f64],
    ) -> Result<Lit, IntensityError> {
        let all = self.all;
        let (several, count) = (all.materials.len(), all.sun.len());
        for found in [light.len(), error.len()] {
            if found != several + 1 {
                return Err(DirectionError::Room { found, expected: several + 1 }.into());
            }
        }
        if wavelength >= count {
            return Err(DirectionError::Room { found: wavelength + 1, expected: count }.into());
        }
        self.weigh(aspect, &aspect.lighting())?;
        light.fill(0.0);
        error.fill(0.0);
        for (k, term) in all.engine.terms().iter().enumerate() {
            let tau = all.tau[k * count + wavelength];
            let row = term.material.unwrap_or(several);
            if k < all.engine.lit_terms() {
                light[row] += tau * self.weights[k];
            }
            error[row] += tau.abs() * self.errors[k];
        }
        let (sum, doubt) = self.sums(wavelength);
        let met = self.is_met(sum, doubt);
        Ok(Lit { phase_deg: phase_deg(aspect), met })
    }

    /// The light of an aspect.
    ///
    /// # Errors
    /// [`IntensityError::Direction`] and [`IntensityError::Value`]: numbers that are none.
    pub fn light(&mut self, aspect: &Aspect) -> Result<Intensity, IntensityError> {
        let lighting = aspect.lighting();
        self.weigh(aspect, &lighting)?;
        let count = self.all.sun.len();
        let mut material = vec![0.0_f64; count];
        for doubted in &mut self.doubted {
            doubted.weigh(aspect, &lighting)?;
            for (s, sum) in material.iter_mut().enumerate() {
                *sum = sum.hypot(doubted.sums(s).0);
            }
        }
        let has_doubt = self.all.has_material_doubt();
        let at = |s: usize| {
            let (light, error) = self.sums(s);
            At {
                wavelength_nm: self.all.options.wavelength_nm[s],
                per_irradiance_m2_per_sr: light,
                error_m2_per_sr: error,
                material_m2_per_sr: has_doubt.then(|| material[s]),
                intensity_w_per_sr_nm: self.all.intensity(s, aspect, light),
            }
        };
        let light: Vec<At> = (0..count).map(at).collect();
        let fails = |at: &&At| !self.is_met(at.per_irradiance_m2_per_sr, at.error_m2_per_sr);
        let met = light.iter().find(fails).is_none();
        let Self { all, weights, errors, .. } = self;
        let terms = all.engine.terms();
        let tau = |k: usize, s: usize| all.tau[k * count + s];
        let lit = all.engine.lit_terms();
        // Without any light it is above all.
        let share = |at: &At| match at.error_m2_per_sr {
            0.0 => 0.0,
            error => error / at.per_irradiance_m2_per_sr.max(0.0),
        };
        let lit_up = light.iter().filter(|at| at.per_irradiance_m2_per_sr > 0.0);
        let stated_relative = lit_up.map(share).reduce(f64::max);
        let worst = light.iter().enumerate().max_by(|a, b| share(a.1).total_cmp(&share(b.1)));
        let limited_by = worst.filter(|_| !met).and_then(|(s, _)| {
            let mut of: Vec<(Source, f64)> = Vec::new();
            for (k, term) in terms.iter().enumerate() {
                let error = tau(k, s).abs() * errors[k];
                match of.iter_mut().find(|o| o.0 == term.source) {
                    Some((_, sum)) => *sum += error,
                    None => of.push((term.source, error)),
                }
            }
            of.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).map(|(source, _)| light_name(source))
        });
        let weight = |k: usize| Weight {
            source: terms[k].source.name(),
            material: terms[k].material.map(|m| all.materials[m].clone()),
            weight_m2_per_sr: weights[k],
            error_m2_per_sr: errors[k],
        };
        let by_albedo = |m: usize| {
            let own = |k: &usize| terms[*k].material == Some(m);
            let sum = |row: &[f64], s: usize| -> f64 {
                (0..lit).filter(own).map(|k| tau(k, s).abs() * row[k]).sum()
            };
            ByAlbedo {
                material: all.materials[m].clone(),
                derivative_m2_per_sr: (0..count).map(|s| sum(weights, s)).collect(),
                error_m2_per_sr: (0..count).map(|s| sum(errors, s)).collect(),
            }
        };
        Ok(Intensity {
            sun: lighting.sun_body.to_array(),
            observer: aspect.observer.normalize_or_zero().to_array(),
            phase_deg: phase_deg(aspect),
            stated_relative,
            met,
            limited_by,
            weights: (0..terms.len())
                .filter(|k| weights.get(*k).is_some_and(|w| *w != 0.0) || errors[*k] != 0.0)
                .filter(|k| !all.uncovered.contains(k))
                .map(weight)
                .collect(),
            light,
            by_albedo: all
                .options
                .derivatives
                .then(|| (0..all.materials.len()).map(by_albedo).collect()),
        })
    }
}
