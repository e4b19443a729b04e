//! The engine: what a scene needs, and the light of all that it needs.
//!
//! Made once from a target, [`Options`] and a [`Course`] (what is known of the way that the target takes), it asks every effect of
//! `EFFECTS` whether the scene needs it. An effect answers with a [`Need`], in words and numbers, and with one of two things: a [`Part`]
//! that adds its light to terms, or a [`Doubt`] that adds to the errors what is left out. So nothing is left out in silence: the errors
//! of an epoch hold what each effect that is not modelled could have added at that epoch.
//!
//! To add an effect: a file with a function `assess`, and its name in `EFFECTS`.

mod body;
mod bounce;
mod change;
mod curved;
mod direct;
mod disc;
mod distance;
mod earthlit;
mod eclipse;
mod fill;
mod globes;
mod hiding;
mod motion;
mod options;
mod seen;

pub use globes::irradiance as earthshine;
pub use options::{
    Aspects, Course, Options, Switch, Switches, WrongBudget, WrongTolerance, check_budget,
    check_tolerance,
};
pub use seen::Seen;

use super::{
    DirectionError, EarthAlbedo, Effect, Lighting, Need, Scene, SceneError, SceneOptions, Source,
    SunOptions, Term, View,
};
use crate::surface::Material;
use crate::target::Target;
use body::Body;
use std::cell::OnceCell;
use std::ops::Range;
use std::sync::Arc;

/// Question to an effect: the scene, and what is known and wanted of it.
#[derive(Debug)]
pub struct Question<'a> {
    /// The target, as it was given.
    pub target: &'a Target,
    /// The target, prepared for direct light.
    pub scene: &'a Scene,
    /// Facts of the target that decide.
    pub body: &'a Body,
    /// Options of the engine.
    pub options: &'a Options,
    /// Known facts about the target's trajectory.
    pub course: &'a Course,
    /// Albedo of the Earth.
    pub earth: &'a Arc<EarthAlbedo>,
    /// Answers of the effects before this one.
    pub answered: &'a [Need],
    /// Change by the Sun's disc over the directions of the course, once looked at.
    pub disc: &'a OnceCell<disc::Looked>,
}

/// Answer of an effect.
#[derive(Debug)]
pub struct Answer {
    /// Whether it is needed, and why.
    pub need: Need,
    /// Part that adds the effect's light, with the terms that it adds to; none where it is not modelled or a part of another effect.
    pub part: Option<(Vec<Term>, Box<dyn Part>)>,
    /// Possible error of leaving the effect out (or modelling it in part); none where there is no error.
    pub doubt: Option<Box<dyn Doubt>>,
}

/// An effect that adds light, ready for one scene and shared by all threads.
pub trait Part: Send + Sync + std::fmt::Debug {
    /// Which way its light came.
    fn source(&self) -> Source;

    /// Creates a worker that adds the light, with room to work in: one for each thread.
    fn worker<'a>(&'a self, scene: &'a Scene) -> Box<dyn Effect + 'a>;

    /// Whether its light went between surfaces.
    fn is_between_surfaces(&self) -> bool {
        false
    }

    /// Such light for the same body in other reflectances; `None` where it has to be prepared anew.
    fn recoloured(&self, _scene: &Scene) -> Option<Box<dyn Part>> {
        None
    }
}

/// Bound on the light that an effect could have added at an epoch, had it not been left out.
pub trait Doubt: Send + Sync + std::fmt::Debug {
    /// Whether it is about the Sun's own light, and so less in the Earth's shadow.
    fn of_sun(&self) -> bool {
        true
    }

    /// Adds to the errors of direct light (one number a term, m² sr⁻¹, beside its weights) and to those of what is unknown (one number a
    /// material, m² sr⁻¹, before its whole reflectance).
    fn add(&self, seen: &Seen, weights: &[f64], errors: &mut [f64], unknown: &mut [f64]);
}

/// The part of the Sun's light below which a crescent is a factor.
const LEAST_CRESCENT: f64 = 1e-3;

/// How an effect answers.
type Assess = fn(&Question) -> Result<Answer, SceneError>;

/// All effects, in the order in which they are listed and added. Direct light is the first.
const EFFECTS: [Assess; 11] = [
    direct::assess,
    hiding::assess,
    curved::assess,
    disc::assess,
    bounce::assess,
    globes::assess_earthshine,
    earthlit::assess,
    globes::assess_moonshine,
    eclipse::assess,
    distance::assess,
    motion::assess,
];

/// A target with everything that its light needs.
#[derive(Debug)]
pub struct Engine {
    scene: Scene,
    body: Body,
    terms: Vec<Term>,
    lit: usize,
    needs: Vec<Need>,
    parts: Vec<(Range<usize>, Box<dyn Part>)>,
    doubts: Vec<Box<dyn Doubt>>,
    /// Whether the observer stands at a point.
    near: bool,
    /// The largest albedo of the Earth.
    albedo: f64,
    glint_rad: f64,
    /// Whether the disc of the Sun is left out.
    collimated: bool,
}

impl Engine {
    /// Prepares a target, and finds what it needs over an Earth that is the same everywhere.
    ///
    /// # Errors
    /// The errors of [`Scene::new`].
    pub fn new(target: &Target, options: &Options, course: &Course) -> Result<Self, SceneError> {
        Self::over(target, options, course, &Arc::default())
    }

    /// The same over an Earth of some albedo.
    ///
    /// # Errors
    /// The errors of [`Engine::new`].
    pub fn over(
        target: &Target,
        options: &Options,
        course: &Course,
        earth: &Arc<EarthAlbedo>,
    ) -> Result<Self, SceneError> {
        let looked = OnceCell::new();
        let mut scene = prepared(target, options, course, earth, &looked)?;
        scene.tabulate_spheres();
        let body = Body::new(&scene)?;
        let question = Question {
            target,
            scene: &scene,
            body: &body,
            options,
            course,
            earth,
            answered: &[],
            disc: &looked,
        };
        let mut needs = Vec::new();
        let (mut terms, mut parts, mut doubts) = (Vec::new(), Vec::new(), Vec::new());
        for assess in EFFECTS {
            let answer = assess(&Question { answered: &needs, ..question })?;
            needs.push(answer.need);
            if let Some((own, part)) = answer.part {
                let start = terms.len();
                terms.extend(own);
                parts.push((start..terms.len(), part));
            }
            doubts.extend(answer.doubt.filter(|_| options.switches.analyser.is_none()));
        }
        let near = distance::is_needed(&question);
        let lit = terms.len();
        terms.extend(body.unknown_terms()?);
        let albedo = earth.most();
        let glint_rad = glint_rad(&scene, &body, course);
        let collimated = needs.iter().any(|n| n.effect == disc::EFFECT && !n.is_modelled());
        Ok(Self {
            scene,
            body,
            terms,
            lit,
            needs,
            parts,
            doubts,
            near,
            albedo,
            glint_rad,
            collimated,
        })
    }

    /// The light that went between surfaces, of the same body in other reflectances, in the same terms: what does not depend on reflectances is kept. All other light is left
    /// out. `None` of materials that differ in more.
    pub(crate) fn bounced_of(&self, materials: &[Material]) -> Option<Self> {
        let scene = self.scene.recoloured(materials)?;
        let between = self.parts.iter().filter(|(_, part)| part.is_between_surfaces());
        let parts = between.map(|(range, part)| Some((range.clone(), part.recoloured(&scene)?)));
        // Where nothing is added, brighter surfaces might add something.
        let parts = parts.collect::<Option<Vec<_>>>().filter(|parts| !parts.is_empty())?;
        let body = Body::new(&scene).ok()?;
        let (terms, needs) = (self.terms.clone(), self.needs.clone());
        let Self { lit, near, albedo, glint_rad, collimated, .. } = *self;
        let doubts = Vec::new();
        Some(Self {
            scene,
            body,
            terms,
            lit,
            needs,
            parts,
            doubts,
            near,
            albedo,
            glint_rad,
            collimated,
        })
    }

    /// The prepared target.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Returns the spectra that stand before the weights: first [`Engine::lit_terms`] terms that have light, then for each material what is unknown of it:
    /// an envelope of its reflectance, which has errors alone.
    pub fn terms(&self) -> &[Term] {
        &self.terms
    }

    /// How many terms have light.
    pub fn lit_terms(&self) -> usize {
        self.lit
    }

    /// Returns the needs of the scene, effect by effect.
    pub fn needs(&self) -> &[Need] {
        &self.needs
    }

    /// Facts of the target that decide what it needs.
    pub(crate) fn body(&self) -> &Body {
        &self.body
    }

    /// How far the direction half-way between Sun and observer turns over the body between the peak of the narrowest glint and where that has fallen to 1/e or so: the roughness of a lobe, or half of
    /// the Sun's radius where the disc is modelled and that is more. Infinite where nothing glints. A ball glints the same wherever it turns.
    pub(crate) fn glint_rad(&self) -> f64 {
        self.glint_rad
    }

    /// The sum of the bounds of all that is not modelled: a share of the light of the same surfaces in full sunlight.
    pub fn left_out(&self) -> f64 {
        left_out(&self.needs)
    }

    /// Room to work in: one for each thread.
    pub fn worker(&self) -> Worker<'_> {
        let effect = |(range, part): &'_ (Range<usize>, Box<dyn Part>)| Adding {
            range: range.clone(),
            source: part.source(),
        };
        let adding = self.parts.iter().map(effect).collect();
        let effects = self.parts.iter().map(|(_, part)| part.worker(&self.scene));
        let materials = self.terms[..self.lit].iter().map(|t| t.material).collect();
        let seen = Seen::of(materials, self.albedo, self.collimated);
        Worker { engine: self, adding, effects: effects.collect(), seen }
    }
}

/// [`Engine::glint_rad`].
fn glint_rad(scene: &Scene, body: &Body, course: &Course) -> f64 {
    let disc = if scene.sun.is_some() { 0.5 * course.sun_radius_rad } else { 0.0 };
    let flat = body.patches.iter().map(|p| p.material);
    let bent = scene.rounds.iter().filter(|r| r.sphere.is_none()).map(|r| r.material as usize);
    let lobes = flat.chain(bent).filter_map(|material| body.glosses[material].lobe);
    let wide = lobes.map(|(_, alpha)| alpha.max(disc)).filter(|rad| *rad > 0.0);
    wide.fold(f64::INFINITY, f64::min)
}

/// The scene, sampled where it is big, under the Sun's disc where that is needed or partly hidden.
fn prepared(
    target: &Target,
    options: &Options,
    course: &Course,
    earth: &Arc<EarthAlbedo>,
    looked: &OnceCell<disc::Looked>,
) -> Result<Scene, SceneError> {
    // A part of the tolerance is for all others.
    let sun = SunOptions {
        tolerance: (0.01 * options.tolerance).clamp(1e-7, 1e-4),
        eclipse: course.shadow && course.penumbra > 0,
    };
    let wanted = SceneOptions { tolerance: options.tolerance, ..SceneOptions::default() };
    let mut scene = match Scene::with_options(target, wanted) {
        // Only the disc makes a number of it.
        Err(SceneError::FlatMirror { .. } | SceneError::CurvedMirror { .. })
            if options.switches.solar_disc != Switch::Off =>
        {
            return Scene::with_options(target, SceneOptions { sun: Some(sun), ..wanted });
        }
        other => other?,
    };
    let body = Body::new(&scene)?;
    let question = Question {
        target,
        scene: &scene,
        body: &body,
        options,
        course,
        earth,
        answered: &[],
        disc: looked,
    };
    if sun.eclipse || disc::is_modelled(&question) {
        scene.under_sun(target, sun);
    }
    Ok(scene)
}

/// The sum of the bounds of all effects that are not modelled; infinite where one of them is unknown.
pub fn left_out(needs: &[Need]) -> f64 {
    let missing = needs.iter().filter(|n| !n.is_modelled());
    missing.map(|n| n.bound.unwrap_or(f64::INFINITY)).sum()
}

/// An engine with room to work in.
pub struct Worker<'a> {
    engine: &'a Engine,
    adding: Vec<Adding>,
    effects: Vec<Box<dyn Effect + 'a>>,
    seen: Seen,
}

/// Where an effect adds, and whose light.
#[derive(Debug)]
struct Adding {
    range: Range<usize>,
    source: Source,
}

impl Worker<'_> {
    /// Sets the weights of all terms \[m² sr⁻¹\] and their errors (absolute, same unit).
    ///
    /// # Errors
    /// A direction that is none; rows of another length than [`Engine::terms`].
    pub fn light(
        &mut self,
        lighting: &Lighting,
        weights: &mut [f64],
        errors: &mut [f64],
    ) -> Result<(), DirectionError> {
        self.light_of(lighting, &|_| true, weights, errors)?;
        self.doubt(lighting, weights, errors);
        Ok(())
    }

    /// The same where only light straight from the Sun is looked for: `beside` adds all other light to weights and errors.
    ///
    /// # Errors
    /// The errors of [`Worker::light`].
    pub fn light_beside(
        &mut self,
        lighting: &Lighting,
        beside: &dyn Fn(&mut [f64], &mut [f64]),
        weights: &mut [f64],
        errors: &mut [f64],
    ) -> Result<(), DirectionError> {
        self.light_of(lighting, &|source| source == Source::Direct, weights, errors)?;
        beside(weights, errors);
        self.doubt(lighting, weights, errors);
        Ok(())
    }

    /// Adds what is left out to the errors.
    fn doubt(&mut self, lighting: &Lighting, weights: &[f64], errors: &mut [f64]) {
        let (engine, lighting) = (self.engine, self.viewed(lighting));
        if !engine.doubts.is_empty() {
            self.seen.look((&engine.scene, &engine.body), &lighting);
            let (known, unknown) = errors.split_at_mut(engine.lit);
            for about_sun in [true, false] {
                for doubt in engine.doubts.iter().filter(|d| d.of_sun() == about_sun) {
                    doubt.add(&self.seen, &weights[..engine.lit], known, unknown);
                }
                if about_sun {
                    // What is unknown of light that is not there is nothing.
                    let most = (lighting.sunlit + lighting.sunlit_error).min(1.0);
                    unknown.iter_mut().for_each(|e| *e *= most);
                }
            }
        }
    }

    /// The same of light that came by some ways only, with its own errors: those of what is left out are not looked for.
    ///
    /// # Errors
    /// The errors of [`Worker::light`].
    pub fn light_of(
        &mut self,
        lighting: &Lighting,
        wanted: &dyn Fn(Source) -> bool,
        weights: &mut [f64],
        errors: &mut [f64],
    ) -> Result<(), DirectionError> {
        let engine = self.engine;
        for row in [weights.len(), errors.len()] {
            let expected = engine.terms.len();
            if row != expected {
                return Err(DirectionError::Room { found: row, expected });
            }
        }
        weights.fill(0.0);
        errors.fill(0.0);
        let lighting = self.viewed(lighting);
        let full = Lighting { shadow: None, ..lighting };
        let all = self.adding.iter().zip(&mut self.effects);
        for (adding, effect) in all.filter(|(adding, _)| wanted(adding.source)) {
            let (weights, errors) =
                (&mut weights[adding.range.clone()], &mut errors[adding.range.clone()]);
            // Of a crescent that is next to nothing the place on the disc does not matter, and what is unsure of it is not a share of it.
            let resolves = adding.source == Source::Direct
                && engine.scene.sun.is_some()
                && lighting.sunlit > LEAST_CRESCENT;
            if lighting.shadow.is_some() && resolves {
                effect.add(&lighting, weights, errors)?;
                let air = lighting.sunlit_error / lighting.sunlit;
                errors.iter_mut().zip(&*weights).for_each(|(e, w)| *e += air * w.abs());
                continue;
            }
            effect.add(&full, weights, errors)?;
            if matches!(adding.source, Source::Direct | Source::Bounce) {
                in_shadow(&lighting, weights, errors);
            }
        }
        Ok(())
    }

    /// The lighting with the observer at a point only where that matters.
    fn viewed(&self, lighting: &Lighting) -> Lighting {
        match (self.engine.near, lighting.view) {
            (false, View::At(q)) => Lighting { view: View::Distant(q), ..*lighting },
            _ => *lighting,
        }
    }
}

/// Scales weights and errors to the light that the Earth's shadow leaves, and adds the uncertainty of that part to the errors.
fn in_shadow(lighting: &Lighting, weights: &mut [f64], errors: &mut [f64]) {
    if lighting.sunlit == 1.0 && lighting.sunlit_error == 0.0 {
        return;
    }
    for (weight, error) in weights.iter_mut().zip(errors) {
        *error = lighting.sunlit * *error + lighting.sunlit_error * (weight.abs() + *error);
        *weight *= lighting.sunlit;
    }
}
