//! Light from the Earth that is reflected more than once.
//!
//! The share that inter-reflection adds at most to sunlight ([`super::bounce`]) it adds at most to earthshine: that share of the largest irradiance by the
//! Earth bounds it. Where that is more than the tolerance, and bounces and earthshine are modelled, it is found by patches, or by light paths
//! from the cap.

use super::bounce::{self, EFFECT as OF_SUNLIGHT};
use super::{Answer, Doubt, Options, Part, Question, Seen, Switch};
use crate::light::bounce::{BounceOptions, Earthlit, EarthlitLight, stand_in};
use crate::light::{Effect, Need, Scene, SceneError, Source};
use std::f64::consts::FRAC_1_PI;
use std::sync::Arc;

const EFFECT: &str = "bounced earthshine";

pub(super) fn assess(question: &Question) -> Result<Answer, SceneError> {
    let (options, earthshine) = (question.options, question.course.earthshine);
    let answered = |effect: &str| question.answered.iter().find(|need| need.effect == effect);
    let of_sunlight = answered(OF_SUNLIGHT);
    let modelled = of_sunlight.is_some_and(Need::is_modelled);
    // Where bounces are modelled, their bound is over any surface; that over the body is mostly less.
    let over_body = if modelled { bounce::share(question) } else { f64::INFINITY };
    // Of what can bounce more often than can be said, as much as all that falls on the body.
    let share = of_sunlight.and_then(|need| need.bound).unwrap_or(1.0).min(over_body);
    let bound = share * earthshine;
    let off = [options.switches.inter_reflection, options.switches.earthshine]
        .into_iter()
        .find(|switch| *switch == Switch::Off);
    let whole = modelled && answered("earthshine").is_some_and(Need::is_modelled);
    let needed = off.is_none() && whole && options.needs(Switch::Auto, bound);
    let mut why = if share == 0.0 {
        "no surface sees another".to_owned()
    } else {
        format!(
            "of earthshine of up to {:.2} % of sunlight up to {:.1} % may bounce, as of sunlight{}",
            100.0 * earthshine,
            100.0 * share,
            off.map_or("", Options::reason)
        )
    };
    if needed && let Some((terms, part)) = paths(question)? {
        why = format!("{why}; {}", part.plan.describe());
        let cost_s = Some(part.plan.cost_s());
        let need = Need { effect: EFFECT, needed, bound: Some(bound), why, cost_s };
        return Ok(Answer { need, part: Some((terms, Box::new(part))), doubt: None });
    }
    let need = Need { effect: EFFECT, needed, bound: Some(bound), why, cost_s: None };
    let doubt = (share > 0.0).then(|| Box::new(Left { share }) as Box<dyn Doubt>);
    Ok(Answer { need, part: None, doubt })
}

/// Returns the terms and the part that adds to them; `None` where the materials have no wavelengths in common.
fn paths(question: &Question) -> Result<Option<(Vec<crate::light::Term>, Bounced)>, SceneError> {
    let tolerance = question.options.tolerance;
    // From each panel of the cap (two at most).
    let most_paths = question.options.paths();
    let options = BounceOptions { tolerance, most_paths, ..BounceOptions::default() };
    let twin = stand_in(question.target);
    let own = twin.as_ref().map(|twin| Scene::new(&twin.target)).transpose()?;
    let shape_error = twin.map_or(0.0, |twin| twin.error);
    let scene = own.as_ref().unwrap_or(question.scene);
    let parts = (shape_error, question.course.earthshine);
    let plan = Earthlit::new(scene, &options, parts, question.earth);
    let Ok(Some(plan)) = plan else { return Ok(None) };
    let Ok(terms) = plan.terms() else { return Ok(None) };
    Ok(Some((terms, Bounced { plan: Arc::new(plan), own })))
}

/// Light from the Earth, scattered twice or more.
#[derive(Debug)]
struct Bounced {
    plan: Arc<Earthlit>,
    /// The scene that it was planned for, where it is not the engine's.
    own: Option<Scene>,
}

impl Part for Bounced {
    fn source(&self) -> Source {
        Source::Earthshine
    }

    fn worker<'a>(&'a self, scene: &'a Scene) -> Box<dyn Effect + 'a> {
        let scene = self.own.as_ref().unwrap_or(scene);
        Box::new(EarthlitLight::new(scene, self.plan.clone()))
    }

    fn is_between_surfaces(&self) -> bool {
        true
    }

    fn recoloured(&self, scene: &Scene) -> Option<Box<dyn Part>> {
        let own = match &self.own {
            Some(own) => Some(own.recoloured(scene.materials())?),
            None => None,
        };
        let plan = Arc::new(self.plan.recoloured(own.as_ref().unwrap_or(scene))?);
        Some(Box::new(Self { plan, own }))
    }
}

/// The same, left out.
#[derive(Debug)]
struct Left {
    share: f64,
}

impl Doubt for Left {
    fn of_sun(&self) -> bool {
        false
    }

    fn add(&self, seen: &Seen, _: &[f64], _: &mut [f64], unknown: &mut [f64]) {
        // What the Earth does not light is lit by what it does.
        for (error, area) in unknown.iter_mut().zip(&seen.area_m2) {
            *error += self.share * seen.earth * FRAC_1_PI * area;
        }
    }
}
