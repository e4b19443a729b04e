//! Light from the Earth and the Moon.
//!
//! The Earth as a Lambert globe, of albedo 0.30 unless another is given, and that known to ±50 % only: a surface that sees all of it gets at most 0.30·1.5 (R/d)² of the
//! irradiance of the Sun, times the largest cosine that the Sun has over the cap that is seen. The full Moon is 14.0 mag fainter than the
//! Sun (−12.74 against −26.74 in V, Allen's Astrophysical Quantities): 2.5e-6.

use super::{Answer, Doubt, Options, Part, Question, Seen};
use crate::light::{
    EarthAlbedo, Effect, Globe, Lighting, Need, Scene, SceneError, Source, View, shine,
};
use crate::surface::{Material, MaterialError};
use glam::{DQuat, DVec3};
use std::f64::consts::{FRAC_1_PI, PI, TAU};
use std::sync::Arc;

/// The error at which the division of curved parts stops that something shades or hides, of the light of one direction.
const CURVED: f64 = 2e-3;
/// Share of the tolerance that the quadrature over the Earth's lit cap may take.
const OF_TOLERANCE: f64 = 0.5;
/// Geometries on which it is counted from how many directions the Earth's light is taken, at most.
const COUNTED: usize = 16;
/// Most that counting may look at: directions times facets, pairs of these and what may hide them, and so many for a curved part. Where that is not enough for one
/// geometry, that many directions are taken for granted.
const MOST_LOOKS: usize = 4_000_000;
const OF_CURVED: usize = 2000;
const DIRECTIONS: f64 = 500.0;
/// Cost of a table's light over the cap for one epoch, s.
const TABLE_S: f64 = 3e-4;
/// Irradiance of the full Moon over that of the Sun.
const MOON: f64 = 2.5e-6;
/// Phase angles at which the light of spheres is looked at, and how much more it may be between them.
const SPHERE_PHASES: u32 = 64;
const OF_PHASES: f64 = 1.1;
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
    let height_km =
        (course.radius_m.0 - sunglint_ephemeris::orbit::eclipse::EARTH_EQUATORIAL_RADIUS_M) * 1e-3;
    let why = format!(
        "from {height_km:.0} km height up, the Earth ({}; the ± {:.0} % of that are not in the stated error) gives a surface up to {:.2} % of sunlight{}",
        question.earth.describe(),
        100.0 * question.earth.uncertainty(),
        100.0 * bound,
        Options::reason(switch)
    );
    if !needed {
        let need = Need { effect: "earthshine", needed, bound: Some(bound), why, cost_s: None };
        return Ok(Answer { need, part: None, doubt: Some(Box::new(Earthshine)) });
    }
    let earth = question.earth.clone();
    let table_s = if earth.grid().is_some() { TABLE_S } else { 0.0 };
    let terms = shine::terms_of(&earth, question.scene.materials())?;
    let lit = Lit { tolerance: OF_TOLERANCE * options.tolerance, earth };
    let directions = lit.directions(question);
    let why = format!("{why}; taken from some {directions:.0} directions");
    let cost_s = Some(directions * super::direct::cost_s(question) + table_s);
    let need = Need { effect: "earthshine", needed, bound: Some(bound), why, cost_s };
    Ok(Answer { need, part: Some((terms, Box::new(lit))), doubt: None })
}

pub(super) fn assess_moonshine(question: &Question) -> Result<Answer, SceneError> {
    let switch = question.options.switches.moonshine;
    let effect = "moonshine";
    if !question.course.moon {
        let why = "only Sun, observer and, where it is given, the Earth are there".to_owned();
        let need = Need { effect, needed: false, bound: Some(0.0), why, cost_s: None };
        return Ok(Answer { need, part: None, doubt: None });
    }
    let needed = question.options.needs(switch, MOON);
    let why = format!("the full Moon gives {MOON:.1e} of sunlight{}", Options::reason(switch));
    let cost_s = needed.then(|| super::direct::cost_s(question));
    let need = Need { effect, needed, bound: Some(MOON), why, cost_s };
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
    let sphere = |(m, material): (usize, &Material)| {
        if !question.body.spheres.contains(&m) {
            return 0.0;
        }
        let at = |k: u32| {
            let mut weights = vec![0.0; material.spectra().len()];
            let phase_rad = PI * f64::from(k) / f64::from(SPHERE_PHASES);
            question.scene.add_sphere(m as u32, phase_rad, 1.0, &mut weights);
            weights.iter().map(|w| w.abs()).sum::<f64>()
        };
        OF_PHASES * (0..SPHERE_PHASES).map(at).fold(0.0, f64::max)
    };
    let spheres = question.scene.materials().iter().enumerate().map(sphere).collect();
    Ok(Answer { need, part: None, doubt: Some(Box::new(Moonshine { peaks, spheres })) })
}

/// Light from the Earth.
#[derive(Debug)]
struct Lit {
    tolerance: f64,
    earth: Arc<EarthAlbedo>,
}

impl Lit {
    fn shine<'a>(&self, scene: &'a Scene) -> shine::Earthshine<'a> {
        let mut evaluator = scene.evaluator();
        // Each of many directions brings a small part of what is itself a part of all light.
        evaluator.set_curved_tolerance(CURVED);
        evaluator.set_near_tolerance(1e-2 * self.tolerance);
        shine::Earthshine::new(evaluator, self.tolerance).of(self.earth.clone())
    }

    /// From how many directions light is taken for an epoch: the mean over some with Sun, Earth and observer anywhere in front of the body, from as high up as the way
    /// is lowest.
    fn directions(&self, question: &Question) -> f64 {
        let scene = question.scene;
        let report = scene.report();
        let Some(pairs) = report.occluder_pairs else { return DIRECTIONS };
        let looks = report.facets + pairs + OF_CURVED * (report.curved + report.bent);
        let geometries = (MOST_LOOKS / (DIRECTIONS as usize * looks.max(1))).min(COUNTED) as u32;
        if geometries == 0 {
            return DIRECTIONS;
        }
        let mut shine = self.shine(scene);
        let none = vec![0.0; scene.weight_count() * self.earth.layers()];
        let (mut weights, mut errors) = (none.clone(), none);
        let radius_m = sunglint_ephemeris::orbit::eclipse::EARTH_EQUATORIAL_RADIUS_M;
        let mut counted = 0;
        for k in 0..geometries {
            let [a, b, c] = [0, 1, 2].map(|set| {
                let u = sobol_burley::sample_4d(k, set, 0xea).map(f64::from);
                on_sphere(u[0], u[1])
            });
            let distance_m = question.course.radius_m.0.max(1.001 * radius_m);
            let to_ground = DQuat::IDENTITY;
            let earth = Globe { toward: b, distance_m, radius_m, sun: a, to_ground };
            let lighting = Lighting {
                sun_body: a,
                sun_radius_rad: 0.0,
                shadow: None,
                sunlit: 1.0,
                sunlit_error: 0.0,
                earth: Some(earth),
                moon: None,
                view: View::Distant(c),
            };
            // Directions that are drawn on a sphere are directions: what cannot be lit from them costs nothing.
            let before = shine.asked();
            if shine.add(&lighting, &mut weights, &mut errors).is_ok() && shine.asked() > before {
                counted += 1;
            }
        }
        shine.asked() / f64::from(counted.max(1))
    }
}

/// A direction by two numbers from 0 to 1.
fn on_sphere(a: f64, b: f64) -> DVec3 {
    let z = 2.0 * a - 1.0;
    let (sin, cos) = (TAU * b).sin_cos();
    let across = (1.0 - z * z).max(0.0).sqrt();
    DVec3::new(across * cos, across * sin, z)
}

impl Part for Lit {
    fn source(&self) -> Source {
        Source::Earthshine
    }

    fn worker<'a>(&'a self, scene: &'a Scene) -> Box<dyn Effect + 'a> {
        Box::new(self.shine(scene))
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
    /// Largest light of a sphere of 1 m of each material, m² sr⁻¹. A sphere spreads what it mirrors, however smooth it is: R²/4 of a mirror.
    spheres: Vec<f64>,
}

impl Doubt for Moonshine {
    fn of_sun(&self) -> bool {
        false
    }

    fn add(&self, seen: &Seen, _: &[f64], _: &mut [f64], unknown: &mut [f64]) {
        for ((error, area), peak) in unknown.iter_mut().zip(&seen.open_m2).zip(&self.peaks) {
            *error += (MOON * peak).min(MOON_RADIANCE) * area;
        }
        for ((error, square), most) in unknown.iter_mut().zip(&seen.spheres_m2).zip(&self.spheres) {
            *error += MOON * most * square;
        }
    }
}
