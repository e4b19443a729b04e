//! What flat faces mirror to an observer: light from a wide source whose place on that source is known beforehand.
//!
//! A face with a narrow lobe makes a sharp answer of a source that is smooth. Seen from the face it is the other way round: its microfacets are spread smoothly about its own
//! normal, and each of them mirrors one place of the source. So such faces are taken apart from the rest, and the sum over the source is one over their microfacets
//! ([`Face::direction`]), which takes as many points for α = 10⁻⁶ as for 0.1 (Walter et al. 2007, Microfacet models for refraction, section 5: the densities and the Jacobian 4 h·o). Perfect
//! mirrors have one direction alone. What lies below a lobe, and laws that are no microfacets, stay with the rest: where these may be missed, [`Glint`] says.

use super::evaluate::{DirectionError, Evaluator, GRAZING};
use super::occlude::Toward;
use super::{View, curved::sight::Sight};
use crate::surface::{Distribution, Lobe, Material, Width};
use glam::DVec3;
use std::f64::consts::PI;

/// Lobes that are wider than this, radians, are no glints.
const WIDE_RAD: f64 = 0.5;
/// Lobes that are narrower than this, radians, also where light grazes, are looked at from their faces.
const NARROW_RAD: f64 = 0.15;
/// Unless the source is farther than so many widths from what they mirror: it has the tails of their lobes alone then, which are smooth.
const REACH: f64 = 3.0;
/// Faces in more directions than these make something wide of their glints together.
const MOST: usize = 64;
/// Directions that are apart by less than this, of the lobe's width, are one.
const ALIKE: f64 = 0.25;

/// What an observer sees that mirrors.
#[derive(Debug, Default)]
pub(super) struct Mirroring {
    /// Faces with a lobe of microfacets.
    pub faces: Vec<Face>,
    /// Narrow lobes of other kinds.
    pub glints: Vec<Glint>,
}

/// Facets of one material in one plane's direction.
#[derive(Debug)]
pub(super) struct Face {
    /// Which of the scene's facets.
    pub facets: Vec<u32>,
    material: u32,
    lobe: Lobe,
    /// How many of the material's weights, from the first on, are the lobe's.
    weights: usize,
    /// Tangent, bitangent and normal, the body's axes.
    axes: [DVec3; 3],
    /// To the observer.
    to: DVec3,
}

/// A direction that a flat face mirrors to the observer, and the lobe about it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Glint {
    /// Towards the light, a unit vector in the body's axes.
    pub toward: DVec3,
    /// Half-width of the lobe (at 1/e), radians: where light grazes, the narrower one.
    pub width_rad: f64,
    /// What its light would come from if all of it were as bright as the peak, sr.
    pub solid_angle: f64,
}

impl Face {
    /// The direction that some of its microfacets mirror to the observer, by two coordinates from −1 to 1 (how steep they are and whither), and its solid angle for
    /// each unit of both. `None` where that direction or they themselves are turned away.
    pub fn direction(&self, [steep, whither]: [f64; 2]) -> Option<(DVec3, f64)> {
        let (alpha_x, alpha_y) = self.lobe.alpha();
        let [x, y, z] = self.axes;
        // Slopes of r times α, and r dr for each unit of a coordinate from 0 to 1.
        let v = 0.5 * (1.0 + steep);
        let (r, rate) = match self.lobe.distribution() {
            // The share v² of microfacets is less steep.
            Distribution::Beckmann => {
                let left = (1.0 - v) * (1.0 + v);
                ((-left.ln()).sqrt(), v / left)
            }
            // Long tails: half of the coordinate is for what is steeper than α, and steep slopes have room in it.
            Distribution::Ggx => (v / (1.0 - v), v / (1.0 - v).powi(3)),
        };
        let (sin, cos) = (PI * whither).sin_cos();
        let slope = alpha_x * r * cos * x + alpha_y * r * sin * y;
        let h = (slope + z).normalize();
        let along = h.dot(self.to);
        let toward = 2.0 * along * h - self.to;
        let slopes = alpha_x * alpha_y * rate * 0.5 * PI;
        let solid_angle = 4.0 * along * h.dot(z).powi(3) * slopes;
        let is_seen = along > 0.0 && toward.dot(z) > GRAZING && solid_angle.is_finite();
        is_seen.then(|| (toward.normalize(), solid_angle))
    }

    /// Whether it is turned as these axes are, as far as its lobe can tell.
    fn is_like(&self, axes: &[DVec3; 3]) -> bool {
        let (alpha_x, alpha_y) = self.lobe.alpha();
        let near = |i: usize, most: f64| (self.axes[i] - axes[i]).length_squared() < most * most;
        let is_isotropic = alpha_x == alpha_y;
        near(2, 1e-3 * alpha_x.min(alpha_y)) && (is_isotropic || near(0, 1e-3))
    }
}

impl Evaluator<'_> {
    /// What of flat faces mirrors to the observer, hidden or not, by lobes that are narrow; nothing in a big mesh, and where there are too many to matter one by one. Hinged
    /// parts turn to `facing`; `shines` says whether light comes from a direction.
    ///
    /// # Errors
    /// A direction that is none.
    pub(super) fn mirroring(
        &mut self,
        facing: DVec3,
        view: View,
        shines: &dyn Fn(DVec3) -> bool,
    ) -> Result<Mirroring, DirectionError> {
        let (_, eye) = self.aim(facing, facing, view)?;
        let mut found = Mirroring::default();
        if self.scene.large.is_some() {
            return Ok(found);
        }
        for (i, facet) in self.scene.facets.iter().enumerate() {
            let material = &self.scene.materials[facet.material as usize];
            let (lobe, width_rad) = match material.width() {
                Width::Even | Width::Mirror(_) => continue,
                Width::Lobe { lobe, .. } => (Some(*lobe), lobe.width_rad()),
                Width::Other(width_rad) => (None, width_rad),
            };
            if facet.patch.is_some() || width_rad > WIDE_RAD {
                continue;
            }
            let Some((toward, cos)) = self.mirrored(i, eye) else { continue };
            let is_face = |_: &Lobe| {
                let most = REACH * width_rad;
                width_rad * cos < NARROW_RAD && around(toward, most).into_iter().any(shines)
            };
            match lobe.filter(is_face) {
                Some(lobe) => {
                    let (now, number) = (&self.now, i as u32);
                    let axes = [now.tangent[i], now.bitangent[i], now.normal[i]];
                    let to = eye.from(now.origin[i]);
                    let same = |f: &&mut Face| f.material == facet.material && f.is_like(&axes);
                    match found.faces.iter_mut().find(same) {
                        Some(face) => face.facets.push(number),
                        None => {
                            let weights = material.lobe_weights();
                            let (facets, material) = (vec![number], facet.material);
                            found.faces.push(Face { facets, material, lobe, weights, axes, to });
                        }
                    }
                }
                None => {
                    // A Beckmann lobe's: F/(4π α² cosθ) at its peak, F in all.
                    let solid_angle = PI * width_rad * width_rad * cos;
                    let glint = Glint { toward, width_rad: width_rad * cos, solid_angle };
                    let alike = |other: &Glint| {
                        let most = ALIKE * glint.width_rad.min(other.width_rad);
                        (other.toward - toward).length() < most
                    };
                    if !found.glints.iter().any(alike) {
                        found.glints.push(glint);
                    }
                }
            }
            if found.faces.len() + found.glints.len() > MOST {
                return Ok(Mirroring::default());
            }
        }
        Ok(found)
    }

    /// Sums from now on leave out the lobes of some faces, until it is called again with none.
    pub(super) fn leave_out(&mut self, faces: &[Face]) {
        self.apart.clear();
        if !faces.is_empty() {
            self.apart.resize(self.scene.facets.len(), 0);
            for (face, facet) in
                faces.iter().flat_map(|face| face.facets.iter().map(move |f| (face, f)))
            {
                self.apart[*facet as usize] = face.weights;
            }
        }
    }

    /// Adds what of a facet is not left out. Gives the error that it brings, m² sr⁻¹.
    pub(super) fn rest_of_facet(
        &mut self,
        i: usize,
        sun: DVec3,
        eye: Toward,
        stride: usize,
        out: &mut [f64],
    ) -> f64 {
        let facet = &self.scene.facets[i];
        let own = self.scene.weights_of(facet.material as usize);
        let apart = self.apart[i];
        if apart == own.len() {
            return 0.0;
        }
        let first = facet.part as usize * stride + own.start;
        let lobe = first..first + apart;
        let before = out[lobe.clone()].to_vec();
        let brought = self.facet(i, sun, eye, stride, out);
        out[lobe].copy_from_slice(&before);
        brought
    }

    /// As [`Evaluator::direct_from`], of the lobe of a face alone. Gives the relative error.
    ///
    /// # Errors
    /// A direction that is none.
    pub(super) fn face_from(
        &mut self,
        face: &Face,
        light: DVec3,
        (facing, view): (DVec3, View),
        out: &mut [f64],
    ) -> Result<f64, DirectionError> {
        out.fill(0.0);
        let (light, eye) = self.stand(light, facing, view)?;
        let mut error = 0.0;
        for facet in &face.facets {
            error += self.facet(*facet as usize, light, eye, 0, out);
        }
        let own = self.scene.weights_of(face.material as usize);
        out[own.start + face.weights..own.end].fill(0.0);
        let total: f64 = out.iter().sum();
        Ok(if total > 0.0 { error / total + 1e-15 } else { 0.0 })
    }

    /// Adds to `weights` what flat mirrors send of a source whose radiance, of the irradiance that W stands before, is `radiance(direction)` \[sr⁻¹\], layer by layer of
    /// `weights` in rows of [`Scene::weight_count`](super::Scene::weight_count). Seen from a point a facet mirrors what it does from its own origin.
    ///
    /// # Errors
    /// A direction that is none.
    pub(super) fn add_mirrors(
        &mut self,
        (facing, view): (DVec3, View),
        radiance: &dyn Fn(DVec3) -> Vec<f64>,
        weights: &mut [f64],
    ) -> Result<(), DirectionError> {
        let scene = self.scene;
        if !scene.materials.iter().any(Material::is_mirror) {
            return Ok(());
        }
        let (_, eye) = self.aim(facing, facing, view)?;
        let mut sorted = None;
        let mut row = vec![0.0; scene.weight_count()];
        for (i, facet) in scene.facets.iter().enumerate() {
            let Width::Mirror(fresnel) = scene.materials[facet.material as usize].width() else {
                continue;
            };
            let Some((toward, cos)) = self.mirrored(i, eye) else { continue };
            let lights = radiance(toward);
            if lights.iter().all(|light| *light == 0.0) {
                continue;
            }
            if sorted != Some(toward) {
                self.sort(toward, eye);
                sorted = Some(toward);
            }
            let sight = Sight { scene, now: &self.now, outlines: &self.outlines };
            let cut = self.work.visible(&sight, i, toward, eye, scene.outlines.get(i));
            let area = if cut { self.work.kept.area() } else { facet.area };
            row.fill(0.0);
            let own = scene.weights_of(facet.material as usize);
            fresnel.add_weights(cos, area * cos, &mut row[own]);
            for (weights, light) in weights.chunks_exact_mut(row.len()).zip(lights) {
                weights.iter_mut().zip(&row).for_each(|(weight, w)| *weight += light * w);
            }
        }
        Ok(())
    }

    /// The direction that a facet mirrors to the observer, and the cosine of both; `None` where it does not face the observer.
    fn mirrored(&self, facet: usize, eye: Toward) -> Option<(DVec3, f64)> {
        let normal = self.now.normal[facet];
        let to = eye.from(self.now.origin[facet]);
        let cos = normal.dot(to);
        (cos > GRAZING).then(|| ((2.0 * cos * normal - to).normalize(), cos))
    }
}

/// A direction, and 16 others within an angle of it.
fn around(toward: DVec3, most_rad: f64) -> Vec<DVec3> {
    let (x, y) = toward.any_orthonormal_pair();
    let at = |k: u32| {
        let (sin, cos) = (0.25 * PI * f64::from(k)).sin_cos();
        let off = most_rad * if k < 8 { 1.0 } else { 0.5 };
        toward * off.cos() + (x * cos + y * sin) * off.sin()
    };
    std::iter::once(toward).chain((0..16).map(at)).collect()
}
