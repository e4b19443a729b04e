//! Light from the Earth and the Moon.
//!
//! The Earth as a Lambert globe, of albedo 0.30 unless another is given, and that known to ±50 % only: a surface that sees all of it gets at most 0.30·1.5 (R/d)² of the
//! irradiance of the Sun, times the largest cosine that the Sun has over the cap that is seen. The full Moon is 14.0 mag fainter than the
//! Sun (−12.74 against −26.74 in V, Allen's Astrophysical Quantities): 2.5e-6.

use super::{Answer, Doubt, Options, Part, Question, Seen};
use crate::light::{EarthAlbedo, Effect, Globe, Need, Scene, SceneError, Source, shine};
use crate::surface::MaterialError;
use std::f64::consts::FRAC_1_PI;
use std::sync::Arc;

/// The error at which the division of curved parts stops that something shades or hides, of the light of one direction.
const CURVED: f64 = 2e-3;
/// Directions from which the Earth's light usually comes.
const DIRECTIONS: f64 = 50.0;
/// How many times that for a table of albedos, of which two rules have to agree one after the other; and what the table's light over the cap costs, s.
const OF_A_TABLE: f64 = 4.0;
const TABLE_S: f64 = 3e-4;
/// Irradiance of the full Moon over that of the Sun.
const MOON: f64 = 2.5e-6;
/// Radiance of the full Moon over the irradiance of the Sun, sr⁻¹: [`MOON`] over its solid angle of 6.4e-5 sr.
const MOON_RADIANCE: f64 = 0.039;

/// The largest irradiance on a surface by a lit Lambert globe whose albedo is nowhere above `most` ([`EarthAlbedo::most`]), of that of the Sun.
pub fn irradiance(globe: &Globe, most: f64) -> f64 {
    let sine = (globe.radius_m / globe.distance_m).min(1.0);
    // Of the cap that is seen, the point nearest to where the Sun stands overhead.
    let half_rad = sine.acos();
    let away_rad = (-globe.toward).angle_between(globe.sun) - half_rad;
    most * sine * sine * away_rad.max(0.0).cos().max(0.0)
}

pub(super) fn assess_earthshine(question: &Question) -> Result<Answer, SceneError> {
    let (options, course) = (question.options, question.course);
    let switch = options.switches.earthshine;
    let bound = course.earthshine;
    let needed = options.needs(switch, bound);
    let height_km = (course.radius_m.0 - crate::orbit::eclipse::EARTH_EQUATORIAL_RADIUS_M) * 1e-3;
    let why = format!(
        "from {height_km:.0} km height up, the Earth ({}; the ± {:.0} % of that are not in the stated error) gives a surface up to {:.2} % of sunlight{}",
        question.earth.describe(),
        100.0 * question.earth.uncertainty(),
        100.0 * bound,
        Options::reason(switch)
    );
    let (directions, table_s) = match question.earth.grid() {
        Some(_) => (OF_A_TABLE * DIRECTIONS, TABLE_S),
        None => (DIRECTIONS, 0.0),
    };
    let cost_s = needed.then(|| directions * super::direct::cost_s(question) + table_s);
    let need = Need { effect: "earthshine", needed, bound: Some(bound), why, cost_s };
    if !needed {
        return Ok(Answer { need, part: None, doubt: Some(Box::new(Earthshine)) });
    }
    let earth = question.earth.clone();
    let terms = shine::terms_of(&earth, question.scene.materials())?;
    // What is asked of the whole, of the largest share that this can be: the same for whatever is known of the way.
    let tolerance =
        (0.1 * options.tolerance / earth.most().max(f64::MIN_POSITIVE)).clamp(1e-5, 0.1);
    Ok(Answer { need, part: Some((terms, Box::new(Lit { tolerance, earth }))), doubt: None })
}

pub(super) fn assess_moonshine(question: &Question) -> Result<Answer, SceneError> {
    let switch = question.options.switches.moonshine;
    let needed = question.options.needs(switch, MOON);
    let why = format!("the full Moon gives {MOON:.1e} of sunlight{}", Options::reason(switch));
    let cost_s = needed.then(|| super::direct::cost_s(question));
    let need = Need { effect: "moonshine", needed, bound: Some(MOON), why, cost_s };
    if needed {
        // Grey: a spectrum of 1 before the materials' own.
        let grey = shine::grey().map_err(MaterialError::from)?;
        let terms = shine::terms(Source::Moonshine, question.scene.materials(), &grey)?;
        return Ok(Answer { need, part: Some((terms, Box::new(Moon))), doubt: None });
    }
    let gloss = |g: &super::body::Gloss| match g.lobe {
        None => FRAC_1_PI,
        Some((_, alpha)) => FRAC_1_PI.max(0.25 * FRAC_1_PI / (alpha * alpha)),
    };
    let peaks = question.body.glosses.iter().map(gloss).collect();
    Ok(Answer { need, part: None, doubt: Some(Box::new(Moonshine { peaks })) })
}

/// Light from the Earth.
#[derive(Debug)]
struct Lit {
    tolerance: f64,
    earth: Arc<EarthAlbedo>,
}

impl Part for Lit {
    fn source(&self) -> Source {
        Source::Earthshine
    }

    fn worker<'a>(&'a self, scene: &'a Scene) -> Box<dyn Effect + 'a> {
        let mut evaluator = scene.evaluator();
        // Each of many directions brings a small part of what is itself a part of all light.
        evaluator.set_curved_tolerance(CURVED);
        evaluator.set_near_tolerance(1e-2 * self.tolerance);
        Box::new(shine::Earthshine::new(evaluator, self.tolerance).of(self.earth.clone()))
    }
}

/// Light from the Moon.
#[derive(Debug)]
struct Moon;

impl Part for Moon {
    fn source(&self) -> Source {
        Source::Moonshine
    }

    fn worker<'a>(&'a self, scene: &'a Scene) -> Box<dyn Effect + 'a> {
        Box::new(shine::Moonshine::new(scene.evaluator()))
    }
}

/// Light from the Earth, left out.
#[derive(Debug)]
struct Earthshine;

impl Doubt for Earthshine {
    fn of_sun(&self) -> bool {
        false
    }

    fn add(&self, seen: &Seen, _: &[f64], _: &mut [f64], unknown: &mut [f64]) {
        for (error, area) in unknown.iter_mut().zip(&seen.earthlit_m2) {
            *error += seen.earth * FRAC_1_PI * area;
        }
    }
}

/// Light from the Moon, left out.
#[derive(Debug)]
struct Moonshine {
    /// The largest f_r of each material over its reflectance, sr⁻¹.
    peaks: Vec<f64>,
}

impl Doubt for Moonshine {
    fn of_sun(&self) -> bool {
        false
    }

    fn add(&self, seen: &Seen, _: &[f64], _: &mut [f64], unknown: &mut [f64]) {
        for ((error, area), peak) in unknown.iter_mut().zip(&seen.area_m2).zip(&self.peaks) {
            *error += (MOON * peak).min(MOON_RADIANCE) * area;
        }
    }
}
