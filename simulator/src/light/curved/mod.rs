//! Curved surfaces: spheres, cylinders, cones and dishes that stand for themselves, and triangles that are bent by their normals.
//!
//! - [`zone`]: surfaces of revolution of the second degree, and what they hide of themselves, without error;
//! - [`ring`]: their integrals where nothing else interferes: closed forms of spheres aside, one integral over azimuth (cylinders, cones)
//!   or two (dishes, observers at a point);
//! - [`refine`]: where something else shades or hides them: cells, divided where a shadow's edge crosses, until the error is small enough;
//! - [`sight`]: which occluders stand between a cell and the Sun or the observer;
//! - [`outline`]: how curved bodies hide others;
//! - [`bent`]: triangles with normals;
//! - [`phase`]: light of whole spheres by phase angle, in tables.

pub mod bent;
pub mod build;
pub mod outline;
pub mod phase;
pub mod refine;
pub mod ring;
pub mod sight;
pub mod zone;

use super::evaluate::Direct;
use super::geometry::Geometry;
use super::occlude::Toward;
use super::scene::Scene;
use glam::DVec3;
use refine::Refiner;
use ring::Task;
use sight::{Candidates, Sight};
use zone::{Pole, Zone};

/// Precision of whole zones where only a rough sum is asked for ([`Curves::tolerance`]), as a share of its tolerance, and where zones send next to nothing, sr⁻¹.
const OF_MANY: f64 = 1e-2;
const OF_MANY_FLOOR: f64 = 1e-2;

/// A curved part.
#[derive(Debug, Clone)]
pub struct Round {
    /// Surfaces of the part that reflect.
    pub zones: Vec<Zone>,
    /// The radius where it is a whole sphere.
    pub sphere: Option<f64>,
    /// How it hides others, where that is by an outline of its own.
    pub outline: Option<outline::Form>,
    /// The material's number.
    pub material: u32,
    /// The part's number.
    pub part: u32,
    /// The component that it is.
    pub component: u32,
    /// The group that it moves with.
    pub group: usize,
    /// The part's tangent, in its own axes.
    pub tangent: DVec3,
    /// Middle of a ball around it, in its own axes, m.
    pub middle: DVec3,
    /// Radius of that ball, m.
    pub radius: f64,
}

/// Where light comes from and goes to.
#[derive(Debug, Clone, Copy)]
pub struct Light {
    /// Unit vector to the Sun.
    pub sun: DVec3,
    /// The observer.
    pub eye: Toward,
}

/// Room to evaluate curved parts in.
#[derive(Debug)]
pub struct Curves {
    refiner: Refiner,
    /// The error at which refinement stops, of what the part would send with nothing before it.
    pub tolerance: f64,
}

impl Default for Curves {
    fn default() -> Self {
        Self { refiner: Refiner::default(), tolerance: Scene::CURVED_TOLERANCE }
    }
}

impl Curves {
    /// Adds a curved part to its weights and the absolute errors of each.
    pub fn add(
        &mut self,
        sight: &Sight,
        number: usize,
        light: Light,
        out: &mut [f64],
        errors: &mut [f64],
        done: &mut Direct,
    ) {
        let (scene, now) = (sight.scene, sight.now);
        let round = &scene.rounds[number];
        let material = &scene.materials[round.material as usize];
        let place = now.place[number];
        let middle = place.point(round.middle);
        let Some(near) = self.refiner.before(sight, round.component, middle, round.radius, light)
        else {
            return;
        };
        let free = near.iter().all(Vec::is_empty);
        let to = light.eye.from(middle);
        let far = matches!(light.eye, Toward::Far(_));
        if let Some(radius) = round.sphere
            && (material.is_mirror() || (free && far))
        {
            done.spheres += usize::from(free);
            self.sphere(sight, &near, (middle, radius), light, to, round, out, errors);
            return;
        }
        if free {
            done.round += 1;
        } else {
            done.refined += 1;
        }
        let inverse = place.rotation.inverse();
        let (eye, range_squared) = match light.eye {
            Toward::Far(d) => (Pole::Far(inverse * d), 1.0),
            Toward::Near(q) => (Pole::Near(inverse * (q - place.offset_m)), q.length_squared()),
        };
        let sun = inverse * light.sun;
        for zone in &round.zones {
            let task = Task::new(*zone, material, round.tangent, sun, eye, range_squared);
            let Some(mut task) = task else { continue };
            if free {
                // Of one of many directions no more is asked than of what something hides.
                if self.tolerance > Scene::CURVED_TOLERANCE {
                    (task.floor, task.precision) = (OF_MANY_FLOOR, OF_MANY * self.tolerance);
                }
                let whole = task.whole();
                let error = task.cell(&whole, out);
                let sum: f64 = out.iter().sum();
                // Rounding: of the sum, and of where arcs end.
                let area = zone.area(zone.from, zone.to, std::f64::consts::TAU);
                spread(error + 1e-11 * sum + 1e-15 * area, out, errors);
            } else {
                task.floor = 0.1;
                task.precision = (1e-2 * self.tolerance).clamp(1e-9, 1e-5);
                self.refiner.add(sight, &task, &place, light, &near, self.tolerance, out, errors);
            }
        }
    }

    /// Whether nothing of another component stands before a facet.
    pub fn is_free(&mut self, sight: &Sight, facet: usize, light: Light) -> bool {
        let about = &sight.scene.facets[facet];
        let (origin, radius) = (sight.now.origin[facet], about.radius);
        let near = self.refiner.before(sight, about.component, origin, radius, light);
        near.is_some_and(|near| near.iter().all(Vec::is_empty))
    }

    /// Whether nothing of another component stands before a curved part.
    pub fn round_is_free(&mut self, sight: &Sight, number: usize, light: Light) -> bool {
        let round = &sight.scene.rounds[number];
        let middle = sight.now.place[number].point(round.middle);
        let near = self.refiner.before(sight, round.component, middle, round.radius, light);
        near.is_some_and(|near| near.iter().all(Vec::is_empty))
    }

    /// A whole sphere that nothing hides, or a mirror of which one point counts.
    #[expect(clippy::too_many_arguments, reason = "one use")]
    fn sphere(
        &mut self,
        sight: &Sight,
        near: &[Candidates; 2],
        (middle, radius): (DVec3, f64),
        light: Light,
        to: DVec3,
        round: &Round,
        out: &mut [f64],
        errors: &mut [f64],
    ) {
        let material = &sight.scene.materials[round.material as usize];
        let (nearness, bend) = match light.eye {
            Toward::Far(_) => (1.0, 0.0),
            // The mirror's image is that of the middle's distance and angle to the radius' share of the distance.
            Toward::Near(q) => {
                let square = (q - middle).length_squared();
                (q.length_squared() / square, (2.0 * radius / square.sqrt()).min(1.0))
            }
        };
        // Right at all angles (Kahan), where the arc cosine is not.
        let phase = 2.0 * (light.sun - to).length().atan2((light.sun + to).length());
        let mut full = vec![0.0; out.len()];
        let scale = radius * radius * nearness;
        // Neither a tangent nor an angle out of range is left to refuse: the scene was checked, the angle is made here.
        let error = sight.scene.add_sphere(
            round.material,
            phase.min(std::f64::consts::PI),
            scale,
            &mut full,
        );
        let mut error = error + bend;
        if material.is_mirror() {
            let glint = middle + radius * (light.sun + to).normalize_or_zero();
            match self.refiner.point(sight, glint, light, near, 1e-9 * radius) {
                sight::Fate::Free => {}
                sight::Fate::Dark => return,
                sight::Fate::Mixed => error = 1.0,
            }
        }
        for ((o, e), f) in out.iter_mut().zip(errors).zip(&full) {
            *o += f;
            *e += f * error;
        }
    }
}

/// A sum's error over the weights, each for its share.
pub fn spread(error: f64, weights: &[f64], errors: &mut [f64]) {
    let total: f64 = weights.iter().sum();
    for (e, w) in errors.iter_mut().zip(weights) {
        *e += if total > 0.0 { error * w / total } else { error };
    }
}

/// Moves the places of curved parts of one group.
pub fn turn(scene: &Scene, now: &mut Geometry, group: usize, motion: &super::geometry::Motion) {
    for (k, _) in scene.rounds.iter().enumerate().filter(|r| r.1.group == group) {
        let base = scene.geometry.place[k];
        now.place[k].rotation = motion.rotation * base.rotation;
        now.place[k].offset_m = motion.point(base.offset_m);
    }
}
