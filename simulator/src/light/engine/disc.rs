//! The size of the Sun's disc.
//!
//! The answer of a facet is f cosθ_i, averaged over the disc. Where f varies slowly, the direction of the disc's middle errs by
//! (δ²/8) ∇²f/f, with δ the disc's angular radius: of a Beckmann lobe (δ²/8)(t² − 1)/α², of a GGX lobe (δ²/8)(16t² − 8)/(4α² (1 + t²)²),
//! with t = tanθ_h/α (θ_h turns by half of what the Sun moves). Where the light comes from behind, at a phase angle γ, the direction midway moves by
//! 1/(2 cos γ/2) across the plane of Sun and observer: δ counts as δ/cos(γ/2) there.
//!
//! A facet on whose horizon the middle stands has a mean cosine of 2δ/3π = 9.9e-4 where the middle has 0. Beside a facet in full sunlight that is little; where the observer sees no other
//! facet lit it is everything, as of a body that keeps a side to the Sun. So the directions that occur ([`Course::aspects`](super::Course::aspects)) are looked at: where facets on the horizon
//! change the light by more than the tolerance more often than now and then, the disc is modelled.

use super::{Answer, Doubt, Options, Question, Seen, Switch};
use crate::light::{Need, SceneError};
use crate::surface::Distribution;
use std::f64::consts::{FRAC_1_PI, PI};

/// Where a Beckmann lobe has fallen to 1e-3 of its peak: t² there.
const WING: f64 = 6.9;

/// ∇²f/f of a lobe, as a factor of 1/α².
fn curvature(kind: Distribution, t2: f64) -> f64 {
    match kind {
        Distribution::Beckmann => (t2 - 1.0).abs(),
        Distribution::Ggx => (4.0 * t2 - 2.0).abs() / ((1.0 + t2) * (1.0 + t2)),
    }
}

/// The relative error of a lobe by the middle's direction; more than itself it cannot err, and no more is said than 1.
fn relative(kind: Distribution, alpha: f64, t2: f64, sun_radius_rad: f64) -> f64 {
    // The second order holds for lobes that are wide; of one as narrow as the disc nothing is known.
    let small = sun_radius_rad * sun_radius_rad / (8.0 * alpha * alpha);
    let error = small * curvature(kind, t2).max(1.0);
    if error < 0.3 { error * (1.0 + error) } else { 1.0 }
}

/// Part of the directions with facets on the Sun's horizon, above which the disc is modelled for them: of a body that turns about it is a hundredth.
const OFTEN: f64 = 0.05;

/// Facets on the Sun's horizon beside all other light, over the directions that occur.
struct Horizon {
    /// The part of the directions at which they change the light by more than the tolerance.
    often: f64,
    /// The largest share of the light that they have, 1 at most.
    share: f64,
}

impl Horizon {
    /// Looks at the directions; nothing hides anything here, and all is taken as diffuse.
    fn of(question: &Question) -> Self {
        let (body, radius) = (question.body, question.course.sun_radius_rad);
        let (mut count, mut share) = (0, 0.0_f64);
        let aspects = question.course.aspects.iter();
        let all = aspects.len();
        for [sun, to] in aspects {
            let (mut lit, mut open) = (0.0, 0.0);
            for patch in &body.patches {
                let normal = body.normal(patch, sun);
                let sent = body.glosses[patch.material].most * patch.area_m2 * normal.dot(to);
                if sent <= 0.0 {
                    continue;
                }
                let height = normal.dot(sun);
                lit += sent * height.max(0.0);
                // Of many facets that look nearly the same way the part on whose horizon the disc stands.
                if height.abs() < radius + patch.chord {
                    open += sent * 2.0 * radius / (3.0 * PI) * radius / (radius + patch.chord);
                }
            }
            let phase = sun.angle_between(to);
            let (sine, cosine) = phase.sin_cos();
            for (radius_m, material) in &body.rounds {
                let disc = 2.0 / 3.0 * radius_m * radius_m * body.glosses[*material].most;
                lit += disc * (sine + (PI - phase) * cosine);
            }
            count += usize::from(open > question.options.tolerance * lit);
            if open > 0.0 {
                share = share.max((open / lit).min(1.0));
            }
        }
        Self { often: count as f64 / all.max(1) as f64, share }
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
    let need = Need { effect: "solar disc", needed, bound: Some(bound), why, cost_s };
    let flat = !body.patches.is_empty();
    let lobes = body.glosses.iter().map(|g| g.lobe).collect();
    let doubt = (!needed).then(|| Box::new(Middle { lobes, flat }) as Box<dyn Doubt>);
    Ok(Answer { need, part: None, doubt })
}

/// Whether it is needed, its bound, and why.
fn look(question: &Question) -> (bool, f64, String) {
    let (body, options) = (question.body, question.options);
    let radius = question.course.sun_radius_rad;
    let switch = options.switches.solar_disc;
    let flat = !body.patches.is_empty();
    let horizon = if flat { 2.0 * radius / (3.0 * PI) } else { 0.0 };
    // The cosine itself, over the disc.
    let diffuse = 0.25 * radius * radius;
    let (lobe, words) = match body.narrowest() {
        None => (diffuse, "all materials are diffuse".to_owned()),
        Some((_, 0.0)) if !flat => (
            0.25 * radius,
            "a mirror, but curved: the disc's image is smaller than the sphere's".into(),
        ),
        Some((_, 0.0)) => (1.0, "a flat mirror".to_owned()),
        Some((kind, alpha)) => (
            relative(
                kind,
                alpha,
                if kind == Distribution::Beckmann { WING } else { 0.0 },
                radius / (0.5 * question.course.phase_rad).cos().max(1e-9),
            ),
            format!("the narrowest lobe has α {alpha}"),
        ),
    };
    let mut bound = lobe.max(horizon);
    let mut needed = options.needs(switch, bound);
    let edge = if flat {
        let own = Horizon::of(question);
        let beside = own.often > OFTEN;
        needed |= beside && switch == Switch::Auto;
        let here = if beside {
            bound = bound.max(own.share);
            format!(
                ", and in {:.0} % of the directions here that is more than the tolerance of all light, up to {:.1e} of it",
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
    lobes: Vec<Option<(Distribution, f64)>>,
    flat: bool,
}

impl Doubt for Middle {
    fn add(&self, seen: &Seen, weights: &[f64], errors: &mut [f64], unknown: &mut [f64]) {
        let delta = seen.sun_radius_rad;
        let diffuse = 0.25 * delta * delta;
        seen.add_shares(weights, errors, |m| match self.lobes[m] {
            None => diffuse,
            Some((_, 0.0)) if !self.flat => 0.25 * delta,
            Some((kind, alpha)) => {
                let delta = delta / seen.half_cos.max(1e-9);
                diffuse + relative(kind, alpha, seen.off_lobe[m].0, delta)
            }
        });
        for (error, area) in unknown.iter_mut().zip(&seen.horizon_m2) {
            *error += 2.0 * delta / (3.0 * PI) * FRAC_1_PI * area;
        }
    }
}
