//! Mirroring by flat faces towards an observer: light from a wide source whose place on that source is known beforehand.
//!
//! A face with a narrow lobe makes a sharp answer of a source that is smooth. Seen from the face it is the other way round: its microfacets are spread smoothly about its own
//! normal, and each of them mirrors one place of the source. So such faces are taken apart from the rest, and the sum over the source is one over their microfacets
//! ([`Face::direction`]), which takes as many points for α = 10⁻⁶ as for 0.1 (Walter et al. 2007, Microfacet models for refraction: the Jacobian 4 h·o, eq. 14, and the densities, section 5). Perfect
//! mirrors have one direction alone. What lies below a lobe, and laws that are no microfacets, stay with the rest: where these may be missed, [`Glint`] says.

use super::evaluate::{DirectionError, Evaluator, GRAZING};
use super::occlude::Toward;
use super::{View, curved::sight::Sight, near};
use crate::surface::{Distribution, Lobe, Material, Width};
use glam::DVec3;
use std::f64::consts::PI;

/// Lobes that are wider than this, radians, are no glints.
const WIDE_RAD: f64 = 0.5;
/// Lobes that are narrower than this, radians, also where light grazes, are looked at from their faces.
const NARROW_RAD: f64 = 0.15;
/// And only if they are narrower than this much of the source's radius: the smaller one of the two is what points should lie in.
const OF_SOURCE: f64 = 0.5;
/// Unless the source is farther than so many widths from what they mirror: it has nothing of a Beckmann lobe then, and of GGX's long tails (the second) what is smooth all over it.
const REACH: [f64; 2] = [3.0, 20.0];
/// More faces or glints are none: so many make something wide together, and looking at each would cost more than the scene.
const MOST: usize = 256;
/// And so do faces with so many others whose lobes overlap with theirs and that are at least so large beside them.
const OVERLAPPING: usize = 4;
const AS_LARGE: f64 = 0.3;
/// Directions that are apart by less than this, of the lobe's width, are one, if their widths are alike as well.
const ALIKE: f64 = 0.25;
const ALIKE_WIDTHS: f64 = 1.5;
/// The half-vectors of one face may be apart by this, of the lobe's smaller roughness: facets in other places, seen from a point.
const OF_ROUGHNESS: f64 = 0.2;
/// The steepest microfacets of a Beckmann lobe, slopes in units of α: 1e-7 of it is steeper.
const STEEPEST: f64 = 4.0;
/// Relative error of a mirror that is seen from a point.
const NEAR_TOLERANCE: f64 = 1e-4;

/// A wide source, as far as is asked here.
pub(super) struct Sky<'a> {
    /// Whether light comes from a direction.
    pub shines: &'a dyn Fn(DVec3) -> bool,
    /// Angular radius of the source.
    pub radius_rad: f64,
}

/// Faces and lobes that mirror light to an observer.
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
    /// Whether light comes from all around what it mirrors.
    pub is_within: bool,
}

/// A direction that a flat face mirrors to the observer, and the lobe about it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Glint {
    /// Towards the light, a unit vector in the body's axes.
    pub toward: DVec3,
    /// Half-width of the lobe (at 1/e), radians: where light grazes, or a lobe has two, the narrower one.
    pub width_rad: f64,
    /// The wider one.
    pub reach_rad: f64,
    /// Solid angle that its light would come from if all of it were as bright as the peak, sr.
    pub solid_angle: f64,
}

impl Mirroring {
    /// Leaves what is narrow as a whole; `areas` are those of the faces, as the observer sees them.
    fn keep_narrow(&mut self, areas: &[f64]) {
        if self.faces.len() > MOST {
            self.faces.clear();
        }
        if self.glints.len() > MOST {
            self.glints.clear();
        }
        let all: Vec<(DVec3, f64, f64)> = self
            .faces
            .iter()
            .zip(areas)
            .map(|(f, a)| (f.mirrored(), f.lobe.width_rad(), *a))
            .collect();
        let overlaps = |a: &(DVec3, f64, f64)| {
            let near = |b: &&(DVec3, f64, f64)| (a.0 - b.0).length() < a.1 && b.2 > AS_LARGE * a.2;
            // Itself among them.
            all.iter().filter(near).count() > OVERLAPPING
        };
        let mut kept = all.iter().map(|face| !overlaps(face));
        self.faces.retain(|_| kept.next().unwrap_or(true));
    }
}

impl Face {
    /// The direction that all of it mirrors to the observer.
    fn mirrored(&self) -> DVec3 {
        let normal = self.axes[2];
        2.0 * normal.dot(self.to) * normal - self.to
    }

    /// The direction that some of its microfacets mirror to the observer, by two coordinates from −1 to 1 (how steep they are and whither), and its solid angle for
    /// each unit of both. `None` where that direction or they themselves are turned away.
    pub(crate) fn direction(&self, [steep, whither]: [f64; 2]) -> Option<(DVec3, f64)> {
        let (alpha_x, alpha_y) = self.lobe.alpha();
        let [x, y, z] = self.axes;
        // Slopes of r times α, and r dr for each unit of a coordinate from 0 to 1.
        let v = 0.5 * (1.0 + steep);
        let (r, rate) = match self.lobe.distribution() {
            // As many microfacets in each ring of equal area, so that the answer to even light is exact. The steep ones have little room in it.
            Distribution::Beckmann if self.is_within => {
                let left = (1.0 - v) * (1.0 + v);
                ((-left.ln()).sqrt(), v / left)
            }
            // Of a Gauss curve there is nothing beyond.
            Distribution::Beckmann => (STEEPEST * v, STEEPEST * STEEPEST * v),
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

    /// Whether it is turned as these axes are and sees the observer where another does, as far as its lobe can tell.
    fn is_like(&self, axes: &[DVec3; 3], to: DVec3) -> bool {
        let (alpha_x, alpha_y) = self.lobe.alpha();
        let (least, most) = (alpha_x.min(alpha_y), alpha_x.max(alpha_y));
        let near = |a: DVec3, b: DVec3, most: f64| (a - b).length_squared() < most * most;
        let turned = least == most || near(self.axes[0], axes[0], 1e-3 * least / most);
        near(self.axes[2], axes[2], 1e-3 * least)
            && near(self.to, to, OF_ROUGHNESS * least)
            && turned
    }
}

impl Evaluator<'_> {
    /// Finds the flat faces that mirror to the observer, hidden or not, by lobes that are narrow; none in a big mesh. Hinged parts turn to `facing`.
    ///
    /// # Errors
    /// A direction that is none.
    pub(super) fn mirroring(
        &mut self,
        facing: DVec3,
        view: View,
        sky: &Sky<'_>,
    ) -> Result<Mirroring, DirectionError> {
        let (_, eye) = self.aim(facing, facing, view)?;
        let mut found = Mirroring::default();
        if self.scene.large.is_some() {
            return Ok(found);
        }
        let mut areas = Vec::new();
        for (i, facet) in self.scene.facets.iter().enumerate() {
            let material = &self.scene.materials[facet.material as usize];
            let (lobe, [narrow, wide]) = match material.width() {
                Width::Even | Width::Mirror(_) => continue,
                Width::Lobe { lobe, .. } => {
                    let (alpha_x, alpha_y) = lobe.alpha();
                    let ratio = alpha_x.max(alpha_y) / alpha_x.min(alpha_y);
                    let narrow = lobe.width_rad();
                    (Some(*lobe), [narrow, (ratio * narrow).min(PI)])
                }
                Width::Other(width_rad) => (None, [width_rad; 2]),
            };
            if facet.patch.is_some() || narrow > WIDE_RAD {
                continue;
            }
            let Some((toward, cos)) = self.mirrored(i, eye) else { continue };
            // Seen from a point the facet's places mirror other directions.
            let spread = match eye {
                Toward::Far(_) => 0.0,
                Toward::Near(q) => facet.radius / (q - self.now.origin[i]).length(),
            };
            let mut shining = [false, true];
            let lobe = lobe.filter(|lobe| {
                let (alpha_x, alpha_y) = lobe.alpha();
                narrow * cos < NARROW_RAD
                    && wide < OF_SOURCE * sky.radius_rad
                    && spread <= OF_ROUGHNESS * alpha_x.min(alpha_y) * cos
            });
            if let Some(lobe) = &lobe {
                let [near, far] = REACH;
                for toward in around(toward, near * wide) {
                    let shines = (sky.shines)(toward);
                    shining = [shining[0] || shines, shining[1] && shines];
                }
                shining[0] |= lobe.distribution() == Distribution::Ggx
                    && around(toward, (far * wide).min(WIDE_RAD)).into_iter().any(sky.shines);
                if !shining[0] {
                    continue;
                }
            }
            match lobe {
                Some(lobe) => {
                    let (now, number) = (&self.now, i as u32);
                    let axes = [now.tangent[i], now.bitangent[i], now.normal[i]];
                    let to = eye.from(now.origin[i]);
                    let same = |f: &Face| f.material == facet.material && f.is_like(&axes, to);
                    match found.faces.iter().position(same) {
                        Some(k) => {
                            found.faces[k].facets.push(number);
                            areas[k] += cos * facet.area;
                        }
                        None => {
                            let weights = material.lobe_weights();
                            let (facets, material) = (vec![number], facet.material);
                            let is_within = shining[1];
                            let face =
                                Face { facets, material, lobe, weights, axes, to, is_within };
                            found.faces.push(face);
                            areas.push(cos * facet.area);
                        }
                    }
                }
                None => {
                    let glint = Glint {
                        toward,
                        width_rad: narrow * cos + spread,
                        reach_rad: wide + spread,
                        // A Beckmann lobe's: F/(4π α_x α_y cosθ) at its peak, F in all.
                        solid_angle: PI * (narrow + spread) * (wide + spread) * cos,
                    };
                    let alike = |other: &Glint| {
                        let [a, b] = [glint.width_rad, other.width_rad];
                        (other.toward - toward).length() < ALIKE * a.min(b)
                            && a.max(b) < ALIKE_WIDTHS * a.min(b)
                    };
                    if !found.glints.iter().any(alike) {
                        found.glints.push(glint);
                    }
                }
            }
        }
        found.keep_narrow(&areas);
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

    /// Computes the weights of [`Evaluator::direct_from`] for the lobe of a face alone. Gives the relative error.
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

    /// Adds to `weights` and `errors` what flat mirrors send of a source whose radiance, of the irradiance that W stands before, is `radiance(direction)` \[sr⁻¹\], layer by
    /// layer in rows of [`Scene::weight_count`](super::Scene::weight_count). Gives how many facets were looked at.
    ///
    /// # Errors
    /// A direction that is none.
    pub(super) fn add_mirrors(
        &mut self,
        (facing, view): (DVec3, View),
        radiance: &dyn Fn(DVec3) -> Vec<f64>,
        (weights, errors): (&mut [f64], &mut [f64]),
    ) -> Result<usize, DirectionError> {
        let scene = self.scene;
        if !scene.materials.iter().any(Material::is_mirror) {
            return Ok(0);
        }
        let (_, eye) = self.aim(facing, facing, view)?;
        let (mut sorted, mut looked) = (None, 0);
        let count = scene.weight_count();
        for (i, facet) in scene.facets.iter().enumerate() {
            let Width::Mirror(fresnel) = scene.materials[facet.material as usize].width() else {
                continue;
            };
            let Some((toward, cos)) = self.mirrored(i, eye) else { continue };
            if facet.patch.is_some() {
                continue;
            }
            let own = scene.weights_of(facet.material as usize);
            let lights = radiance(toward);
            if matches!(eye, Toward::Far(_)) && lights.is_empty() {
                continue;
            }
            looked += 1;
            if sorted != Some(toward) {
                self.sort(toward, eye);
                sorted = Some(toward);
            }
            let sight = Sight { scene, now: &self.now, outlines: &self.outlines };
            let outline = scene.outlines.get(i);
            let cut = self.work.visible(&sight, i, toward, eye, outline);
            let rounding = if cut { self.cut_rounding_m2(facet) } else { 0.0 };
            let mut row = vec![0.0; weights.len() / count * own.len()];
            let mut brought = 0.0;
            match eye {
                Toward::Far(_) => {
                    let area = if cut { self.work.kept.area() } else { facet.area };
                    for (row, light) in row.chunks_exact_mut(own.len()).zip(&lights) {
                        fresnel.add_weights(cos, area * cos * light, row);
                    }
                    brought = row.iter().sum::<f64>() * rounding / area.max(f64::MIN_POSITIVE);
                }
                // Each place mirrors its own direction; what hides it of the light is taken for the facet's origin.
                Toward::Near(q) => {
                    let [u, v, n] =
                        [self.now.tangent[i], self.now.bitangent[i], self.now.normal[i]];
                    let rel = q - self.now.origin[i];
                    let mut weigh = |to: DVec3, scale: f64, out: &mut [f64]| {
                        let lights = radiance(to.z * n - to.x * u - to.y * v);
                        for (out, light) in out.chunks_exact_mut(own.len()).zip(lights) {
                            fresnel.add_weights(to.z, scale * light, out);
                        }
                    };
                    let mut task = near::Task {
                        weigh: &mut weigh,
                        tolerance: NEAR_TOLERANCE,
                        longest_m: f64::INFINITY,
                        smooth_m: 0.0,
                        at: DVec3::new(rel.dot(u), rel.dot(v), rel.dot(n)),
                        range_squared: q.length_squared(),
                        facet_area: facet.area,
                    };
                    if cut {
                        for piece in self.work.kept.iter() {
                            brought += self.near.add(&mut task, piece, 1.0, &mut row);
                        }
                    } else {
                        brought += self.near.add(&mut task, outline, 1.0, &mut row);
                    }
                }
            }
            let rows = weights.chunks_exact_mut(count).zip(errors.chunks_exact_mut(count));
            for ((weights, errors), row) in rows.zip(row.chunks_exact(own.len())) {
                weights[own.clone()].iter_mut().zip(row).for_each(|(weight, w)| *weight += w);
                errors[own.start] += brought;
            }
        }
        Ok(looked)
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
