//! A body in flat facets beside the exact one, for whoever needs to know where on it light comes from.

use super::evaluate::{DirectionError, Evaluator};
use super::occlude::toward;
use super::pieces::Piece;
use super::scene::{Scene, SceneError};
use super::{View, occlude::unit};
use crate::mesh::shapes::{Faceting, icosphere};
use crate::surface::Material;
use crate::target::{Shape, Target};
use glam::DVec3;
use sunglint_radiometry::spectrum::Spectrum;

/// A sphere is 20·4⁵ triangles.
const SUBDIVISIONS: u32 = 5;

/// A target twice: exact, and with all that is curved in flat facets. What the facets of a part send is scaled to what the part sends, so that
/// sums are exact and only their place on the body is approximate.
#[derive(Debug, Clone)]
pub struct Faceted {
    exact: Scene,
    flat: Scene,
    /// Flags of the curved parts, one for each part.
    curved: Vec<bool>,
    radius_m: f64,
}

/// Room to evaluate a faceted body in: one for each thread.
#[derive(Debug)]
pub struct FacetedEye<'a> {
    body: &'a Faceted,
    exact: Evaluator<'a>,
    flat: Evaluator<'a>,
    weights: Vec<f64>,
}

/// The one point of a mirror sphere that sends light to the observer.
#[derive(Debug, Clone, PartialEq)]
pub struct Glint {
    /// Index of the part.
    pub part: usize,
    /// Index of the material.
    pub material: usize,
    /// Where it is, body axes, m.
    pub point_m: DVec3,
    /// The material's weights of the sphere, m² sr⁻¹.
    pub weights: Vec<f64>,
}

impl Faceted {
    /// Prepares a target.
    ///
    /// # Errors
    /// The errors of [`Scene::new`].
    pub fn new(target: &Target) -> Result<Self, SceneError> {
        let exact = Scene::new(target)?;
        let mut twin = target.clone();
        let mut curved = Vec::with_capacity(twin.parts.len());
        for part in &mut twin.parts {
            let mesh = match &part.shape {
                Shape::Mesh(mesh) if mesh.normals.is_empty() => None,
                Shape::Mesh(mesh) => Some(mesh.clone().flat()),
                Shape::Sphere { radius_m } => {
                    Some(icosphere(*radius_m, SUBDIVISIONS, Faceting::SameArea))
                }
                Shape::Curved(shape) => Some(shape.mesh().flat()),
            };
            curved.push(mesh.is_some());
            if let Some(mesh) = mesh {
                part.shape = Shape::Mesh(mesh);
            }
        }
        // The facets of a mirror send nothing: they only hide.
        for material in &mut twin.materials {
            if material.is_mirror()
                && let Ok(black) = Spectrum::constant(0.0, 300.0, 1240.0)
                && let Ok(black) = Material::lambert(material.name.clone(), black)
            {
                *material = black;
            }
        }
        let flat = Scene::new(&twin)?;
        let reach = |part: usize| {
            let mesh = twin.part_mesh(part, &[]);
            mesh.vertices.iter().map(|v| v.length()).fold(0.0, f64::max)
        };
        let radius_m = (0..twin.parts.len()).map(reach).fold(0.0, f64::max);
        Ok(Self { exact, flat, curved, radius_m })
    }

    /// The exact scene: its weights are those that [`FacetedEye::pieces`] gives.
    pub fn scene(&self) -> &Scene {
        &self.exact
    }

    /// How far the body reaches from its origin with its hinges at 0, m.
    pub fn radius_m(&self) -> f64 {
        self.radius_m
    }

    /// Room to evaluate in.
    pub fn eye(&self) -> FacetedEye<'_> {
        FacetedEye {
            body: self,
            exact: self.exact.evaluator(),
            flat: self.flat.evaluator(),
            weights: vec![0.0; self.exact.weight_count()],
        }
    }
}

impl<'a> FacetedEye<'a> {
    /// The body.
    pub fn body(&self) -> &'a Faceted {
        self.body
    }

    /// Gives what is lit by collimated light from `light_body` and seen from `view`, facet by facet, each with the weights that a square metre
    /// of it sends, sr⁻¹ (the scene's; all but its material's are 0). Hinged parts turn to `sun_body`.
    ///
    /// # Errors
    /// Directions that are none.
    pub fn pieces(
        &mut self,
        light_body: DVec3,
        sun_body: DVec3,
        view: View,
        take: &mut dyn FnMut(&Piece<'_>, &[f64]),
    ) -> Result<(), DirectionError> {
        let scene = &self.body.exact;
        let stride = scene.weight_count();
        let scales = self.scales(light_body, sun_body, view)?;
        let row = &mut self.weights;
        self.flat.pieces(light_body, sun_body, view, &mut |piece| {
            let range = scene.weights_of(piece.material);
            weigh(scene, piece, 1.0, row);
            if self.body.curved[piece.part] {
                for k in range.clone() {
                    row[k] *= scales[piece.part * stride + k];
                }
            }
            take(piece, row);
            row[range].fill(0.0);
        })
    }

    /// For each part and weight what the exact part sends over what its facets send.
    fn scales(&mut self, light: DVec3, sun: DVec3, view: View) -> Result<Vec<f64>, DirectionError> {
        let scene = &self.body.exact;
        if !self.body.curved.contains(&true) {
            return Ok(Vec::new());
        }
        let stride = scene.weight_count();
        let mut exact = vec![0.0; scene.part_count() * stride];
        self.exact.sum(light, sun, view, stride, &mut exact)?;
        let mut flat = vec![0.0; exact.len()];
        self.flat.pieces(light, sun, view, &mut |piece| {
            let area: f64 = piece.polygons().map(super::clip::area).sum();
            let start = piece.part * stride;
            weigh(scene, piece, area, &mut flat[start..start + stride]);
        })?;
        let scale = |(e, f): (f64, f64)| if f > 0.0 { e / f } else { 1.0 };
        Ok(exact.into_iter().zip(flat).map(scale).collect())
    }

    /// The glints of mirror spheres between a collimated light and a distant observer, hinged parts turned to `sun_body`.
    ///
    /// # Errors
    /// Directions that are none.
    pub fn glints(
        &mut self,
        light_body: DVec3,
        sun_body: DVec3,
        observer_body: DVec3,
    ) -> Result<Vec<Glint>, DirectionError> {
        let scene = &self.body.exact;
        let stride = scene.weight_count();
        let mirrors = |r: &&super::curved::Round| scene.materials[r.material as usize].is_mirror();
        if !scene.rounds.iter().any(|r| mirrors(&r)) {
            return Ok(Vec::new());
        }
        let mut exact = vec![0.0; scene.part_count() * stride];
        self.exact.sum(light_body, sun_body, View::Distant(observer_body), stride, &mut exact)?;
        let light = unit("the direction of the light", light_body)?;
        let to = toward(View::Distant(observer_body))?.from(DVec3::ZERO);
        let halfway = (light + to).normalize_or_zero();
        let glint = |(k, round): (usize, &super::curved::Round)| {
            let radius = round.sphere?;
            let (part, material) = (round.part as usize, round.material as usize);
            let range = scene.weights_of(material);
            let weights = exact[part * stride + range.start..part * stride + range.end].to_vec();
            let point_m = self.exact.now.place[k].point(round.middle) + radius * halfway;
            mirrors(&round).then_some(Glint { part, material, point_m, weights })
        };
        Ok(scene.rounds.iter().enumerate().filter_map(glint).collect())
    }
}

/// Adds what an area of a piece sends to a row of all weights.
fn weigh(scene: &Scene, piece: &Piece<'_>, area: f64, row: &mut [f64]) {
    let (i, o) = (piece.to_light, piece.to_observer);
    let range = scene.weights_of(piece.material);
    scene.materials[piece.material].add_weights(i, o, area * i.z * o.z, &mut row[range]);
}
