//! The size of the Sun's disc.
//!
//! The answer of a facet is f cosθ_i, averaged over the disc. Where f varies slowly, the direction of the disc's middle errs by
//! (δ²/8) ∇²f/f, with δ the disc's angular radius: of a Beckmann lobe (δ²/8)(t² − 1)/α², of a GGX lobe (δ²/8)(16t² − 8)/(4α² (1 + t²)²),
//! with t = tanθ_h/α (θ_h turns by half of what the Sun moves). Where the light comes from behind, at a phase angle γ, the direction midway moves by
//! 1/(2 cos γ/2) across the plane of Sun and observer: δ counts as δ/cos(γ/2) there.
//!
//! That is what decides before directions are known. Where they are ([`Course::aspects`](super::Course::aspects)), what the disc may change is looked at direction by direction ([`Change`]): a facet on whose
//! horizon the middle stands has a mean cosine of 2δ/3π = 9.9e-4 where the middle has 0, and a lobe that just misses the observer by the middle may not by the limb. Beside a facet in full light that is
//! little; where nothing else is lit it is everything. Where it is more than the tolerance more often than now and then, the disc is modelled; where it is not modelled, the same bound is the
//! stated error.
//!
//! A sphere's answer W depends on the phase angle alone. With ε what is left to 180° it falls off as ε³ at the most (Lambert), of which the disc's average differs by (δ²/9)(W''/W + W'/(εW)) = δ²/ε²; that of
//! Fresnel's factors by no more than 2δ² (Schlick's power of 5 over 4 % at half the phase angle: (δ²/9)·2·F''/F, F''/F ≤ 8).

use super::change::Change;
use super::{Answer, Doubt, Options, Question, Seen, Switch};
use crate::light::{Need, SceneError};
use crate::surface::{Distribution, Material};
use std::f64::consts::{FRAC_1_PI, PI};

/// Name of the effect.
pub(super) const EFFECT: &str = "solar disc";

/// Where a Beckmann lobe has fallen to 1e-3 of its peak: t² there.
const WING: f64 = 6.9;

/// ∇²f/f of a lobe, as a factor of 1/α².
fn curvature(kind: Distribution, t2: f64) -> f64 {
    match kind {
        Distribution::Beckmann => (t2 - 1.0).abs(),
        Distribution::Ggx => (4.0 * t2 - 2.0).abs() / ((1.0 + t2) * (1.0 + t2)),
    }
}

/// The largest relative error of a lobe by the middle's direction, down to a thousandth of its peak; more than itself it cannot err there, and no more is said than 1.
fn relative((kind, alpha): (Distribution, f64), sun_radius_rad: f64) -> f64 {
    let t2 = if kind == Distribution::Beckmann { WING } else { 0.0 };
    // The second order holds for lobes that are wide; of one as narrow as the disc nothing is known.
    let small = sun_radius_rad * sun_radius_rad / (8.0 * alpha * alpha);
    let error = small * curvature(kind, t2).max(1.0);
    if error < 0.3 { error * (1.0 + error) } else { 1.0 }
}

/// The relative error of a sphere by the middle's direction. `half_cos` is cos(γ/2) of the phase angle γ; `gloss` says whether there are Fresnel's factors.
fn of_sphere(half_cos: f64, gloss: bool, sun_radius_rad: f64) -> f64 {
    let left_rad = 2.0 * half_cos.max(1e-9);
    let fresnel = if gloss { 2.0 } else { 0.0 };
    sun_radius_rad * sun_radius_rad * (fresnel + 1.0 / (left_rad * left_rad))
}

/// Part of the directions in which the disc matters, above which it is modelled for them: of a body that turns, facets on the Sun's horizon are a hundredth.
const OFTEN: f64 = 0.05;
/// Patches that are looked at in all directions together, at most: some 0.1 s.
const MOST_LOOKS: usize = 100_000;
/// Directions that are looked at, at most: a part of 0.05 is found to 0.01, and a fit looks again at each body that it tries.
const MOST_DIRECTIONS: usize = 500;

/// Change by the disc beside all light, over the directions that occur.
#[derive(Debug)]
pub struct Looked {
    /// The part of the directions at which it changes the light by more than the tolerance.
    often: f64,
    /// The largest share of the light that it changes, 1 at most.
    share: f64,
}

impl Looked {
    /// Looks at the directions; nothing hides anything here.
    fn at(question: &Question) -> Self {
        let (scene, body, radius) = (question.scene, question.body, question.course.sun_radius_rad);
        let (mut count, mut share) = (0, 0.0_f64);
        let mut change = Change::default();
        let all = question.course.aspects.iter().len();
        let step = (all * body.patches.len()).div_ceil(MOST_LOOKS);
        let step = step.max(all.div_ceil(MOST_DIRECTIONS)).max(1);
        for [sun, to] in question.course.aspects.iter().step_by(step) {
            change.look((scene, body), sun, to, radius);
            let bright = |row: &[f64]| -> f64 {
                let of = |m: usize| row[scene.weights_of(m)].iter().sum::<f64>();
                body.glosses.iter().enumerate().map(|(m, gloss)| gloss.most * of(m)).sum()
            };
            let (mut lit, mut open) = (bright(&change.light), bright(&change.most));
            for patch in body.patches.iter().filter(|p| p.chord > 0.0) {
                let normal = body.normal(patch, sun);
                let seen = normal.dot(to) * patch.area_m2 * body.glosses[patch.material].most;
                // Of many facets that look nearly the same way the part on whose horizon the disc stands.
                if seen > 0.0 && normal.dot(sun).abs() < radius + patch.chord {
                    let horizon = 2.0 * radius / (3.0 * PI) * radius / (radius + patch.chord);
                    open += FRAC_1_PI * seen * horizon;
                }
            }
            let phase = sun.angle_between(to);
            let (sine, cosine) = phase.sin_cos();
            for (radius_m, material, _) in &body.rounds {
                let disc = 2.0 / 3.0 * FRAC_1_PI * radius_m * radius_m;
                lit += disc * body.glosses[*material].most * (sine + (PI - phase) * cosine);
            }
            count += usize::from(open > question.options.tolerance * lit);
            if open > 0.0 {
                share = share.max((open / lit).min(1.0));
            }
        }
        Self { often: count as f64 / all.div_ceil(step).max(1) as f64, share }
    }
}

/// Seconds for a facet under the disc.
const COST_S: f64 = 5e-7;

/// Whether the disc is modelled.
pub(super) fn is_modelled(question: &Question) -> bool {
    look(question).0
}

pub(super) fn assess(question: &Question) -> Result<Answer, SceneError> {
    let (needed, bound, why) = look(question);
    let switch = question.options.switches.solar_disc;
    let why = format!("{why}{}", Options::reason(switch));
    let (body, report) = (question.body, question.scene.report());
    let cost_s = needed.then_some(COST_S * (report.facets + report.spheres) as f64);
    let need = Need { effect: EFFECT, needed, bound: Some(bound), why, cost_s };
    let doubt = || {
        let curved = body.curved.iter().map(|&m| (m, body.glosses[m].lobe)).collect();
        let spheres = body.spheres.iter().map(|&m| (m, body.glosses[m].lobe.is_some())).collect();
        let even = |(m, material): (usize, &Material)| {
            vec![material.is_lambert().then_some(m); material.spectra().len()]
        };
        let even = question.scene.materials().iter().enumerate().flat_map(even).collect();
        Box::new(Middle { spheres, curved, even }) as Box<dyn Doubt>
    };
    Ok(Answer { need, part: None, doubt: (!needed).then(doubt) })
}

/// Whether it is needed, its bound, and why.
fn look(question: &Question) -> (bool, f64, String) {
    let (body, options) = (question.body, question.options);
    let radius = question.course.sun_radius_rad;
    let switch = options.switches.solar_disc;
    let flat = !body.patches.is_empty();
    let horizon = if flat { 2.0 * radius / (3.0 * PI) } else { 0.0 };
    let half_cos = (0.5 * question.course.phase_rad).cos();
    // The cosine itself, over the disc.
    let diffuse = 0.25 * radius * radius;
    let faces = body.patches.iter().map(|p| p.material).chain(body.curved.iter().copied());
    let lobes = faces.filter_map(|m| body.glosses[m].lobe);
    let (lobe, words) = match lobes.min_by(|a, b| a.1.total_cmp(&b.1)) {
        None if body.patches.is_empty() && body.curved.is_empty() => {
            (diffuse, "there are spheres alone".to_owned())
        }
        None => (diffuse, "all faces are diffuse".to_owned()),
        Some((_, 0.0)) => (1.0, "a mirror that is no sphere".to_owned()),
        Some(lobe) => (
            relative(lobe, radius / half_cos.max(1e-9)),
            format!("the narrowest lobe has α {}", lobe.1),
        ),
    };
    let sphere = |m: &usize| of_sphere(half_cos, body.glosses[*m].lobe.is_some(), radius).min(1.0);
    let lobe = body.spheres.iter().map(sphere).fold(lobe, f64::max);
    let mut bound = lobe.max(horizon);
    let mut needed = options.needs(switch, bound);
    let edge = if flat {
        let own = question.disc.get_or_init(|| Looked::at(question));
        let beside = own.often > OFTEN;
        needed |= beside && switch == Switch::Auto;
        let here = if beside {
            bound = bound.max(own.share);
            format!(
                ", and in {:.0} % of the directions here the disc may change all light by more than the tolerance, by up to {:.1e}",
                100.0 * own.often,
                own.share
            )
        } else {
            String::new()
        };
        format!(
            "; a facet on the Sun's horizon gets {horizon:.1e} of full sunlight where it is taken to get none{here}"
        )
    } else {
        String::new()
    };
    let why = format!(
        "{words}, the disc's radius is {:.4}°: its middle in place of it errs by {lobe:.1e}{edge}",
        radius.to_degrees(),
    );
    (needed, bound, why)
}

/// The middle of the disc in place of it.
#[derive(Debug)]
struct Middle {
    /// Materials of spheres, and whether they are glossy.
    spheres: Vec<(usize, bool)>,
    /// Materials of other curved surfaces, and their lobes.
    curved: Vec<(usize, Option<(Distribution, f64)>)>,
    /// For each weight of the scene its material, where that is diffuse: all of its reflectance then stands before what the disc changes.
    even: Vec<Option<usize>>,
}

impl Doubt for Middle {
    fn add(&self, seen: &Seen, weights: &[f64], errors: &mut [f64], unknown: &mut [f64]) {
        let delta = seen.sun_radius_rad;
        // Direct light's terms come first, and begin with the scene's weights.
        for ((error, most), even) in errors.iter_mut().zip(&seen.change.most).zip(&self.even) {
            match even {
                Some(m) => unknown[*m] += most,
                None => *error += most,
            }
        }
        seen.add_shares(weights, errors, |m| {
            let mut share = 0.25 * delta * delta;
            if let Some((_, gloss)) = self.spheres.iter().find(|(n, _)| *n == m) {
                share += of_sphere(seen.half_cos, *gloss, delta);
            }
            if let Some((_, Some(lobe))) = self.curved.iter().find(|(n, _)| *n == m) {
                share += relative(*lobe, delta / seen.half_cos.max(1e-9));
            }
            share
        });
        for (error, area) in unknown.iter_mut().zip(&seen.horizon_m2) {
            *error += 2.0 * delta / (3.0 * PI) * FRAC_1_PI * area;
        }
    }
}
