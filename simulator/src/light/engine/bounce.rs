//! Light that is reflected more than once.
//!
//! A body reflects at most ρ of what it gets from the Sun, and of that at most a fraction F falls on the body again: F is taken from the geometry
//! alone ([`super::fill`]), under the Sun from where it is most. So the first bounce has at most ρF of the sunlight that the body gets, and all of them
//! ρF/(1 − ρF'), with F' that of the facet that sees most of the others. What a surface sends of it to an observer is at most that of its whole
//! reflectance. This bounds the light of the body as a whole, for facets whose light is even; a lobe sends its light to one side, and F is right for
//! it on the average over directions.

use super::fill::Fill;
use super::{Answer, Doubt, Options, Part, Question, Seen};
use crate::light::bounce::{Bounce, BounceOptions, Prepared, stand_in};
use crate::light::{Effect, Need, Scene, SceneError, Source};
use std::f64::consts::FRAC_1_PI;

pub(super) fn assess(question: &Question) -> Result<Answer, SceneError> {
    let (body, options) = (question.body, question.options);
    let switch = options.switches.inter_reflection;
    let most = body.most_reflectance();
    let fill = Fill::of(question.scene);
    let bound = of(most, &fill);
    let wanted = bound > 0.0 && options.needs(switch, bound);
    if wanted && let Some(answer) = modelled(question)? {
        return Ok(answer);
    }
    let why = if fill.facet == 0.0 {
        "no surface sees another".to_owned()
    } else {
        let lobes = body.narrowest().is_some();
        let lobe = if lobes { " (of lobes on the average over directions)" } else { "" };
        format!(
            "up to {:.1} % of what the body sends may fall on itself{lobe}, of one facet up to {:.1} %; it reflects up to {:.1} %{}",
            100.0 * fill.body,
            100.0 * fill.facet,
            100.0 * most,
            Options::reason(switch)
        )
    };
    let need = Need { effect: EFFECT, needed: wanted, bound: Some(bound), why, cost_s: None };
    Ok(Answer { need, part: None, doubt: left(bound) })
}

/// Name of the effect in the list of needs.
pub(super) const EFFECT: &str = "inter-reflection";

/// Returns the largest share that all bounces may have in the light of the body as a whole.
pub(super) fn share(question: &Question) -> f64 {
    of(question.body.most_reflectance(), &Fill::of(question.scene))
}

fn of(most: f64, fill: &Fill) -> f64 {
    most * fill.body / (1.0 - (most * fill.facet).min(0.999))
}

fn left(share: f64) -> Option<Box<dyn Doubt>> {
    (share > 0.0).then(|| Box::new(Left { share }) as Box<dyn Doubt>)
}

/// Returns the answer of a closer look; `None` where the materials have no wavelengths in common.
fn modelled(question: &Question) -> Result<Option<Answer>, SceneError> {
    let options = BounceOptions {
        tolerance: question.options.tolerance,
        most_paths: question.options.paths(),
        analyser: question.options.switches.analyser,
        ..BounceOptions::default()
    };
    let twin = stand_in(question.target);
    let own = twin.as_ref().map(|twin| Scene::new(&twin.target)).transpose()?;
    let Ok(mut bounce) = Bounce::new(own.as_ref().unwrap_or(question.scene), &options) else {
        return Ok(None);
    };
    if let Some(twin) = &twin {
        bounce = bounce.with_shape_error(twin.error);
    }
    let mut need = bounce.need().clone();
    if own.is_some() {
        need.why.push_str("; curved parts stand as facets in this");
    }
    need.why.push_str(Options::reason(question.options.switches.inter_reflection));
    if !need.needed {
        let doubt = left(need.bound.unwrap_or(1.0));
        return Ok(Some(Answer { need, part: None, doubt }));
    }
    let terms = bounce.terms().to_vec();
    let part = Bounces { prepared: bounce.prepared(), own };
    Ok(Some(Answer { need, part: Some((terms, Box::new(part))), doubt: None }))
}

/// All bounces.
#[derive(Debug)]
struct Bounces {
    prepared: Prepared,
    /// The scene that they were prepared for, where it is not the engine's.
    own: Option<Scene>,
}

impl Part for Bounces {
    fn source(&self) -> Source {
        Source::Bounce
    }

    fn worker<'a>(&'a self, scene: &'a Scene) -> Box<dyn Effect + 'a> {
        Box::new(self.prepared.light(self.own.as_ref().unwrap_or(scene)))
    }

    fn is_between_surfaces(&self) -> bool {
        true
    }

    fn recoloured(&self, scene: &Scene) -> Option<Box<dyn Part>> {
        let own = match &self.own {
            Some(own) => Some(own.recoloured(scene.materials())?),
            None => None,
        };
        let prepared = self.prepared.recoloured(own.as_ref().unwrap_or(scene))?;
        Some(Box::new(Self { prepared, own }))
    }
}

/// All bounces, left out.
#[derive(Debug)]
struct Left {
    share: f64,
}

impl Doubt for Left {
    fn add(&self, seen: &Seen, _: &[f64], _: &mut [f64], unknown: &mut [f64]) {
        for (error, area) in unknown.iter_mut().zip(&seen.area_m2) {
            *error += self.share * FRAC_1_PI * area;
        }
    }
}
