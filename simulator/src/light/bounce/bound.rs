//! Upper bound of inter-reflection, from the places and normals of the surfaces alone.

use super::surfaces::Surface;
use crate::light::Scene;
use crate::surface::{Material, Width};
use std::f64::consts::PI;

/// More surfaces than this are not looked at in pairs: all of them may exchange light, and no bound is known.
const MOST_SURFACES: usize = 3000;

/// Who may exchange light, and how much.
#[derive(Debug, Clone)]
pub struct Bound {
    /// Surfaces that another may send light to or get light from.
    pub active: Vec<usize>,
    /// The largest fraction of the hemisphere over any point of a surface that others fill with their fronts, at most.
    pub filled: f64,
    /// The most that any of their materials reflects.
    pub reflectance: f64,
}

impl Bound {
    /// Computes the bound for a scene's surfaces (hinges at any angle).
    pub fn new(scene: &Scene, surfaces: &[Surface]) -> Self {
        let all = || (0..surfaces.len()).collect::<Vec<_>>();
        let (active, filled) = if scene.report().convex || surfaces.len() < 2 {
            (Vec::new(), 0.0)
        } else if surfaces.len() > MOST_SURFACES {
            (all(), 1.0)
        } else {
            pairs(surfaces, scene.touching_m)
        };
        let reflectance = active
            .iter()
            .map(|k| most(&scene.materials()[surfaces[*k].material]))
            .fold(0.0, f64::max);
        Self { active, filled, reflectance }
    }

    /// The light scattered twice and more, as a fraction of what is scattered once, both over all directions: each scattering keeps at most ρ of the light and
    /// sends at most F of it to another surface, so ρF + (ρF)² + …; `None` where that is not finite.
    pub fn share(&self) -> Option<f64> {
        let kept = self.filled * self.reflectance;
        (kept < 1.0).then(|| kept / (1.0 - kept))
    }
}

fn pairs(surfaces: &[Surface], touching_m: f64) -> (Vec<usize>, f64) {
    let (mut active, mut filled) = (Vec::new(), 0.0_f64);
    for (i, a) in surfaces.iter().enumerate() {
        let mut sum = 0.0;
        for (j, b) in surfaces.iter().enumerate() {
            let apart = a.group != b.group;
            if i != j && (apart || (a.highest(b) > touching_m && b.highest(a) > touching_m)) {
                sum += most_filled(a, b, apart);
            }
        }
        if sum > 0.0 {
            active.push(i);
            filled = filled.max(sum);
        }
    }
    (active, filled.min(1.0))
}

/// The largest fraction of the hemisphere over a point of `a` that the front of `b` can fill.
fn most_filled(a: &Surface, b: &Surface, apart: bool) -> f64 {
    // What moves apart may come as near as it likes.
    if apart {
        return 1.0;
    }
    // Directions that both fronts look along fill a lune: (1 − n·m)/2 of the cosine-weighted hemisphere.
    let lune =
        if a.is_sphere() || b.is_sphere() { 1.0 } else { 0.5 * (1.0 - a.normal.dot(b.normal)) };
    let away = (b.origin - a.origin).length() - a.radius;
    if away <= b.radius {
        return lune;
    }
    // The ball about it, and its area at its least distance.
    let ball = (b.radius / away).powi(2);
    let disc = b.area / (PI * (away - b.radius).powi(2));
    lune.min(ball).min(disc)
}

/// The most that a material reflects: of a Lambert one its largest ρ; of the others what their albedo is known to be at most.
fn most(material: &Material) -> f64 {
    match material.width() {
        Width::Even => material.spectra()[0].value().iter().copied().fold(0.0, f64::max),
        Width::Other(_) => material.albedo_bound(),
        _ => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::bounce::surfaces::Surfaces;
    use crate::mesh::shapes::{Side, cuboid};
    use crate::target::{Placement, Shape, Target};
    use glam::DVec3;

    fn two_boxes(gap: f64) -> Target {
        let mut target = Target::built_in("corner").unwrap();
        target.parts.truncate(2);
        for (part, offset_m) in target.parts.iter_mut().zip([DVec3::ZERO, DVec3::X * (1.0 + gap)]) {
            part.shape = Shape::Mesh(cuboid(DVec3::ONE, &Side::ALL));
            part.placement = Placement { offset_m, ..Placement::default() };
        }
        target
    }

    /// Truth: the form factor from the middle of a unit square to the one opposite, 4/π (a/√(1+a²)) atan(a/√(1+a²)) with a half the side over the
    /// distance, is the largest over the face; the bound lies above it, and falls as 1/distance².
    #[test]
    fn the_bound_lies_above_the_form_factor() {
        for gap in [0.2, 1.0, 4.0, 20.0] {
            let target = two_boxes(gap);
            let scene = Scene::new(&target).unwrap();
            let bound = Bound::new(&scene, &Surfaces::new(&scene).list);
            assert_eq!(bound.active.len(), 2);
            let a = 0.5 / gap;
            let b = a / (1.0 + a * a).sqrt();
            let truth = 4.0 / PI * b * b.atan();
            assert!(bound.filled >= truth, "{gap}: {} {truth}", bound.filled);
            assert!(gap < 4.0 || bound.filled < 2.5 * truth, "{gap}: {} {truth}", bound.filled);
            assert!((bound.reflectance - 0.8).abs() < 1e-15);
        }
        // A convex body alone: none.
        let mut target = two_boxes(1.0);
        target.parts.truncate(1);
        let scene = Scene::new(&target).unwrap();
        assert_eq!(Bound::new(&scene, &Surfaces::new(&scene).list).share(), Some(0.0));
    }
}
