//! What is lit and seen of a body, piece by piece: for whoever needs more of it than its weights.

use super::View;
use super::clip::{P2, Polygons};
use super::evaluate::{DirectionError, Evaluator};
use glam::DVec3;

/// The lit and seen part of one facet: convex polygons in the facet's plane.
#[derive(Debug)]
pub struct Piece<'a> {
    /// The part that it belongs to.
    pub part: usize,
    /// Its material.
    pub material: usize,
    /// The number of the sphere that this is a facet of, if any: the facets of a sphere stand for it approximately.
    pub sphere: Option<usize>,
    /// The origin of the plane's coordinates, body axes, m.
    pub origin: DVec3,
    /// Its axes: tangent, bitangent, normal; body axes.
    pub axes: [DVec3; 3],
    /// Unit vector towards the light, in those axes.
    pub to_light: DVec3,
    /// Unit vector to the observer from the origin, in those axes.
    pub to_observer: DVec3,
    polygons: Outlines<'a>,
}

#[derive(Debug)]
enum Outlines<'a> {
    Whole(&'a [P2]),
    Cut(&'a Polygons),
}

impl Piece<'_> {
    /// The corners of each polygon, counter-clockwise, m in the plane's coordinates.
    pub fn polygons(&self) -> impl Iterator<Item = &[[f64; 2]]> {
        let (whole, cut) = match &self.polygons {
            Outlines::Whole(outline) => (Some(*outline), None),
            Outlines::Cut(kept) => (None, Some(kept.iter())),
        };
        whole.into_iter().chain(cut.into_iter().flatten())
    }

    /// A point of the plane in the body's axes, m.
    pub fn point(&self, [x, y]: [f64; 2]) -> DVec3 {
        self.origin + x * self.axes[0] + y * self.axes[1]
    }
}

impl Evaluator<'_> {
    /// Gives what is lit by collimated light from `light_body` and seen from `view`, facet by facet, spheres as their facets. Hinged parts turn to
    /// `sun_body`.
    ///
    /// # Errors
    /// A direction that is none.
    pub fn pieces(
        &mut self,
        light_body: DVec3,
        sun_body: DVec3,
        view: View,
        take: &mut dyn FnMut(&Piece<'_>),
    ) -> Result<(), DirectionError> {
        let (light, eye) = self.stand(light_body, sun_body, view)?;
        for i in 0..self.scene.facets.len() {
            let normal = self.now.normal[i];
            let origin = self.now.origin[i];
            let toward = eye.from(origin);
            if !(super::evaluate::is_open(normal.dot(light))
                && super::evaluate::is_open(normal.dot(toward)))
            {
                continue;
            }
            let facet = &self.scene.facets[i];
            let outline = self.scene.outlines.get(i);
            let cut = self.work.visible(self.scene, &self.now, i, light, eye, outline);
            let kept = self.work.kept();
            if cut && kept.is_empty() {
                continue;
            }
            let (u, v) = (self.now.tangent[i], self.now.bitangent[i]);
            let local = |d: DVec3| DVec3::new(u.dot(d), v.dot(d), normal.dot(d));
            take(&Piece {
                part: facet.part as usize,
                material: facet.material as usize,
                sphere: facet.sphere.map(|s| s as usize),
                origin,
                axes: [u, v, normal],
                to_light: local(light),
                to_observer: local(toward),
                polygons: if cut { Outlines::Cut(kept) } else { Outlines::Whole(outline) },
            });
        }
        Ok(())
    }
}

impl<'a> Evaluator<'a> {
    /// The scene.
    pub fn scene(&self) -> &'a super::Scene {
        self.scene
    }

    /// How far the body reaches from its origin, m, with its hinges as they stand.
    pub fn radius_m(&self) -> f64 {
        let corners = self.now.corners.iter().map(|c| c.length());
        let facets =
            self.scene.facets.iter().zip(&self.now.origin).map(|(f, o)| o.length() + f.radius);
        corners.chain(facets).fold(0.0, f64::max)
    }

    /// For each sphere its closed form over the sum of its facets, where nothing shades or hides it: what the facets of [`Evaluator::pieces`] lack.
    ///
    /// # Errors
    /// Directions that are none.
    pub fn sphere_scales(
        &mut self,
        light_body: DVec3,
        sun_body: DVec3,
        observer_body: DVec3,
    ) -> Result<Vec<f64>, DirectionError> {
        let (light, eye) = self.stand(light_body, sun_body, View::Distant(observer_body))?;
        let scene = self.scene;
        let scale = |ball: &super::scene::Ball| {
            let material = &scene.materials[ball.material as usize];
            let to = eye.from(self.now.middle[ball.occluder]);
            let phase = 2.0 * (light - to).length().atan2((light + to).length());
            let mut closed = vec![0.0; material.spectra().len()];
            let mut flat = closed.clone();
            let area = ball.radius * ball.radius;
            // Its material has no tangent, the angle is one: nothing is left to refuse.
            let _ = material.add_sphere_weights(phase.min(std::f64::consts::PI), area, &mut closed);
            for i in ball.facets.clone() {
                let (u, v, n) = (self.now.tangent[i], self.now.bitangent[i], self.now.normal[i]);
                let local = |d: DVec3| DVec3::new(u.dot(d), v.dot(d), n.dot(d));
                let (i_local, o_local) = (local(light), local(to));
                if i_local.z > 0.0 && o_local.z > 0.0 {
                    let area = scene.facets[i].area * i_local.z * o_local.z;
                    material.add_weights(i_local, o_local, area, &mut flat);
                }
            }
            let (closed, flat): (f64, f64) = (closed.iter().sum(), flat.iter().sum());
            if flat > 0.0 { closed / flat } else { 1.0 }
        };
        Ok(scene.spheres.iter().map(scale).collect())
    }
}

/// The one point of a mirror sphere that sends light to the observer.
#[derive(Debug, Clone, PartialEq)]
pub struct Glint {
    /// Its part.
    pub part: usize,
    /// Its material.
    pub material: usize,
    /// Where it is, body axes, m.
    pub point_m: DVec3,
    /// The material's weights of the sphere, m² sr⁻¹.
    pub weights: Vec<f64>,
}

impl Evaluator<'_> {
    /// The glints of mirror spheres that light and observer in one direction see, hinged parts turned to `sun_body`.
    ///
    /// # Errors
    /// Directions that are none.
    pub fn glints(
        &mut self,
        toward_body: DVec3,
        sun_body: DVec3,
    ) -> Result<Vec<Glint>, DirectionError> {
        let (light, eye) = self.stand(toward_body, sun_body, View::Distant(toward_body))?;
        let scene = self.scene;
        let mut glints = Vec::new();
        for (number, ball) in scene.spheres.iter().enumerate() {
            if !scene.materials[ball.material as usize].is_mirror() {
                continue;
            }
            let mut out = vec![0.0; scene.weight_count()];
            self.ball(number, light, eye, 0, &mut out);
            let weights = out[scene.weights_of(ball.material as usize)].to_vec();
            let point_m = self.now.middle[ball.occluder] + ball.radius * light;
            let (part, material) = (ball.part as usize, ball.material as usize);
            glints.push(Glint { part, material, point_m, weights });
        }
        Ok(glints)
    }
}
