//! A target, prepared for evaluation.

use super::clip::{self, P2};
use super::curved::{self, Round, bent::Patch};
use super::evaluate::Evaluator;
use super::facets::{self, Polygon, Triangle};
use super::geometry::{Geometry, Motion};
use super::large::{Large, Sampling};
use super::occlude::{Kind, Occluder};
use super::parts::{components_of_parts, size};
use super::{solid, weld};
use crate::surface::Material;
use crate::target::{Hinge, Part, Shape, Target};
use glam::DVec3;
use std::ops::Range;

/// A target prepared for the light engine: facets, what may hide them, and where each material's weights stand.
#[derive(Debug, Clone)]
pub struct Scene {
    pub(super) materials: Vec<Material>,
    pub(super) hinges: Vec<Hinge>,
    pub(super) parts: usize,
    weights: Vec<Range<usize>>,
    pub(super) facets: Vec<Facet>,
    pub(super) outlines: clip::Polygons,
    pub(super) rounds: Vec<Round>,
    pub(super) patches: Vec<Patch>,
    pub(super) occluders: Vec<Occluder>,
    pub(super) geometry: Geometry,
    /// For each facet a range of `candidates`; `None` where an index is made for each direction instead.
    pub(super) pairs: Option<(Vec<Range<usize>>, Vec<u32>)>,
    pub(super) touching_m: f64,
    /// Whether faces cover others in their plane.
    pub(super) covers: bool,
    /// The Sun's disc, where it is modelled.
    pub(super) sun: Option<super::disc::Sun>,
    /// The same once more, where it is sampled.
    pub(super) large: Option<Box<Large>>,
    pub(super) report: SceneReport,
}

/// A facet; its place is in [`Geometry`].
#[derive(Debug, Clone)]
pub(super) struct Facet {
    pub area: f64,
    pub radius: f64,
    pub material: u32,
    pub part: u32,
    pub component: u32,
    pub group: u32,
    /// The bent triangle over it, if any.
    pub patch: Option<u32>,
    /// Whether its component is convex, and hides nothing of itself.
    pub convex: bool,
}

/// How a target is prepared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneOptions {
    /// Facets times occluders up to which every pair is looked at once and for all: with fewer the scene takes less memory and looks for what hides what
    /// anew in each direction.
    pub most_pairs: usize,
    /// What sums may be off by, of ΣW: big meshes that hide parts of themselves are then sampled for distant observers
    /// ([`SceneReport::sampling`]); all else stays exact ([`SceneReport::why_exact`]), and with 0 all.
    pub tolerance: f64,
    /// The Sun's disc; `None` for a collimated Sun.
    pub sun: Option<super::SunOptions>,
}

impl Default for SceneOptions {
    fn default() -> Self {
        Self { most_pairs: Scene::MOST_PAIRS, tolerance: 0.0, sun: None }
    }
}

/// Why a target cannot be prepared.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A perfect mirror that is flat.
    #[error(
        "part `{part}` is a flat mirror (`{material}`): under a Sun without extent it sends nothing or an infinite intensity; model the Sun's disc, give it a roughness, or make it a sphere"
    )]
    FlatMirror {
        /// The part.
        part: String,
        /// Its material.
        material: String,
    },
    /// A perfect mirror that is curved one way only, or a bowl.
    #[error(
        "part `{part}` is a cylinder, a cone or a dish that is a mirror (`{material}`): under a Sun without extent it sends nothing or an infinite intensity; give it a roughness, or make it a sphere"
    )]
    CurvedMirror {
        /// The part.
        part: String,
        /// Its material.
        material: String,
    },
    /// A part names what is not there.
    #[error("part `{part}` names {what} number {number}, there are {count}")]
    Missing {
        /// The part.
        part: String,
        /// A material or a hinge.
        what: &'static str,
        /// The number, from 0.
        number: usize,
        /// How many there are.
        count: usize,
    },
    /// A place that is not a number.
    #[error("part `{part}` has a corner, a radius or a place that is not a finite number")]
    NotFinite {
        /// The part.
        part: String,
    },
    /// A triangle of corners that are not there.
    #[error("part `{part}`: triangle {triangle} names corner {corner}, there are {count}")]
    Corner {
        /// The part.
        part: String,
        /// The triangle, from 0.
        triangle: usize,
        /// The corner, from 0.
        corner: u32,
        /// How many there are.
        count: usize,
    },
    /// A sphere whose material has a tangent.
    #[error(
        "part `{part}` is a sphere of `{material}`, which reflects by its tangent: a sphere has none; make it a mesh"
    )]
    Tangent {
        /// The part.
        part: String,
        /// Its material.
        material: String,
    },
    /// A tolerance that is none.
    #[error("the tolerance is {tolerance}, expected a number from 0 to 1, a part of the whole")]
    Tolerance {
        /// What was given.
        tolerance: f64,
    },
    /// A material whose reflectance cannot be summed.
    #[error(transparent)]
    Material(#[from] crate::surface::MaterialError),
    /// A sphere without a radius.
    #[error("part `{part}` is a sphere of radius {radius_m} m, expected more than 0")]
    Radius {
        /// The part.
        part: String,
        /// Its radius, m.
        radius_m: f64,
    },
    /// A cylinder, a cone or a dish without a size.
    #[error("part `{part}`: {what} is {value_m} m, expected {expected}")]
    Size {
        /// The part.
        part: String,
        /// Of what.
        what: &'static str,
        /// What was given, m.
        value_m: f64,
        /// What would do.
        expected: &'static str,
    },
    /// Normals that do not belong to the vertices.
    #[error("part `{part}` has {found} normals for {expected} vertices")]
    Normals {
        /// The part.
        part: String,
        /// How many there are.
        found: usize,
        /// How many vertices.
        expected: usize,
    },
}

/// What a scene needs.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SceneReport {
    /// Triangles that came in.
    pub triangles: usize,
    /// Facets after merging triangles of one plane and part.
    pub facets: usize,
    /// Of them, triangles that are bent by their normals.
    pub bent: usize,
    /// Facets left out because they lie inside a convex body that moves with them.
    pub buried: usize,
    /// Spheres, in closed form wherever nothing interferes with them.
    pub spheres: usize,
    /// Cylinders, cones and dishes.
    pub curved: usize,
    /// Whether every surface is part of a closed body.
    pub closed: bool,
    /// Whether the whole target is one convex closed body.
    pub convex: bool,
    /// Whether nothing can ever hide anything.
    pub no_occlusion: bool,
    /// Convex bodies that hide by their outline.
    pub solids: usize,
    /// Pairs of a facet and what may hide it, where a list is kept; `None` where an index is made for each direction.
    pub occluder_pairs: Option<usize>,
    /// Corners nearer to a plane than this lie in it, m.
    pub touching_m: f64,
    /// How a big mesh is sampled; `None` where all sums are exact.
    pub sampling: Option<Sampling>,
    /// Why the sums are exact although a tolerance was given.
    pub why_exact: Option<String>,
    /// What a person should hear of.
    pub warnings: Vec<String>,
}

impl Scene {
    /// A corner nearer to a facet's plane than this times the scene's size (half the diagonal of its bounding box) lies in that plane.
    pub const TOUCHING: f64 = 1e-10;
    /// Triangles merge where their corners lie in one plane within this times the scene's size.
    pub const FLAT: f64 = 1e-13;
    /// A curved part that something shades or hides is divided until its error is below this times what it would send alone.
    pub const CURVED_TOLERANCE: f64 = 1e-4;
    /// Facets times occluders up to which every pair is looked at once and for all.
    pub const MOST_PAIRS: usize = 4_000_000;

    /// Prepares a target.
    ///
    /// # Errors
    /// A flat perfect mirror, indices without their thing, corners that are no numbers.
    pub fn new(target: &Target) -> Result<Self, SceneError> {
        Self::with_most_pairs(target, Self::MOST_PAIRS)
    }

    /// Prepares a target with another limit than [`Scene::MOST_PAIRS`]: with fewer the scene takes less memory and looks for what hides
    /// what anew in each direction. The weights are the same but for the rounding of sums in another order.
    ///
    /// # Errors
    /// As [`Scene::new`].
    pub fn with_most_pairs(target: &Target, most_pairs: usize) -> Result<Self, SceneError> {
        Self::with_options(target, SceneOptions { most_pairs, ..SceneOptions::default() })
    }

    /// Prepares a target as [`SceneOptions`] say.
    ///
    /// # Errors
    /// As [`Scene::new`] (flat mirrors are welcome under the Sun's disc), and a tolerance that is no number from 0 to 1.
    pub fn with_options(target: &Target, options: SceneOptions) -> Result<Self, SceneError> {
        let SceneOptions { most_pairs, tolerance, sun } = options;
        if !(0.0..=1.0).contains(&tolerance) {
            return Err(SceneError::Tolerance { tolerance });
        }
        for part in &target.parts {
            check(target, part, sun.is_some())?;
        }
        let mut scene = Builder::new(target).finish(most_pairs);
        scene.sun = sun.map(|options| super::disc::Sun::new(target, options));
        if tolerance > 0.0 {
            scene.sample(tolerance);
        }
        Ok(scene)
    }

    /// Room to evaluate in: one for each thread.
    pub fn evaluator(&self) -> Evaluator<'_> {
        Evaluator::new(self)
    }

    /// The materials, in the target's order.
    pub fn materials(&self) -> &[Material] {
        &self.materials
    }

    /// All spectra ρ_k in the order of the weights.
    pub fn spectra(
        &self,
    ) -> impl Iterator<
        Item = &sunglint_radiometry::spectrum::Spectrum<sunglint_radiometry::spectrum::Reflectance>,
    > {
        self.materials.iter().flat_map(|m| m.spectra())
    }

    /// Where a material's weights stand.
    pub fn weights_of(&self, material: usize) -> Range<usize> {
        self.weights[material].clone()
    }

    /// How many weights there are.
    pub fn weight_count(&self) -> usize {
        self.weights.last().map_or(0, |w| w.end)
    }

    /// How many parts there are.
    pub fn part_count(&self) -> usize {
        self.parts
    }

    /// What it needs.
    pub fn report(&self) -> &SceneReport {
        &self.report
    }
}

fn check(target: &Target, part: &Part, has_disc: bool) -> Result<(), SceneError> {
    let missing =
        |what, number, count| SceneError::Missing { part: part.name.clone(), what, number, count };
    let Some(material) = target.materials.get(part.material) else {
        return Err(missing("material", part.material, target.materials.len()));
    };
    if let Some(hinge) = part.hinge
        && hinge >= target.hinges.len()
    {
        return Err(missing("hinge", hinge, target.hinges.len()));
    }
    let placed = part.placement.offset_m.is_finite() && part.placement.rotation.is_finite();
    let finite = match &part.shape {
        Shape::Mesh(mesh) => {
            if material.is_mirror() && !has_disc {
                let (part, material) = (part.name.clone(), material.name.clone());
                return Err(SceneError::FlatMirror { part, material });
            }
            let count = mesh.vertices.len();
            for (triangle, corners) in mesh.triangles.iter().enumerate() {
                if let Some(&corner) = corners.iter().find(|c| **c as usize >= count) {
                    let part = part.name.clone();
                    return Err(SceneError::Corner { part, triangle, corner, count });
                }
            }
            let (found, expected) = (mesh.normals.len(), count);
            if found != 0 && found != expected {
                return Err(SceneError::Normals { part: part.name.clone(), found, expected });
            }
            mesh.vertices.iter().chain(&mesh.normals).all(|v| v.is_finite())
        }
        Shape::Curved(shape) => {
            if material.is_mirror() {
                let (part, material) = (part.name.clone(), material.name.clone());
                return Err(SceneError::CurvedMirror { part, material });
            }
            if let Some((what, value_m, expected)) = curved::build::fault(shape) {
                let part = part.name.clone();
                return Err(SceneError::Size { part, what, value_m, expected });
            }
            true
        }
        Shape::Sphere { radius_m } => {
            if *radius_m <= 0.0 {
                return Err(SceneError::Radius { part: part.name.clone(), radius_m: *radius_m });
            }
            if !material.is_isotropic() {
                let (part, material) = (part.name.clone(), material.name.clone());
                return Err(SceneError::Tangent { part, material });
            }
            radius_m.is_finite()
        }
    };
    if placed && finite { Ok(()) } else { Err(SceneError::NotFinite { part: part.name.clone() }) }
}

/// A scene on its way.
struct Builder<'a> {
    target: &'a Target,
    size: f64,
    components: usize,
    scene: Scene,
}

impl<'a> Builder<'a> {
    fn new(target: &'a Target) -> Self {
        let mut weights = Vec::new();
        let mut next = 0;
        for material in &target.materials {
            weights.push(next..next + material.spectra().len());
            next += material.spectra().len();
        }
        let size = size(target);
        let report = SceneReport {
            closed: true,
            touching_m: size * Scene::TOUCHING,
            ..SceneReport::default()
        };
        let scene = Scene {
            materials: target.materials.clone(),
            hinges: target.hinges.clone(),
            parts: target.parts.len(),
            weights,
            facets: Vec::new(),
            outlines: clip::Polygons::default(),
            rounds: Vec::new(),
            patches: Vec::new(),
            occluders: Vec::new(),
            geometry: Geometry::default(),
            pairs: None,
            touching_m: size * Scene::TOUCHING,
            covers: false,
            sun: None,
            large: None,
            report,
        };
        Self { target, size, components: 0, scene }
    }

    fn finish(mut self, most_pairs: usize) -> Scene {
        for group in 0..=self.target.hinges.len() {
            self.group(group);
        }
        self.rounds();
        let scene = &mut self.scene;
        scene.report.facets = scene.facets.len();
        scene.report.bent = scene.patches.len();
        scene.report.spheres = scene.rounds.iter().filter(|r| r.sphere.is_some()).count();
        scene.report.curved = scene.rounds.len() - scene.report.spheres;
        self.pair(most_pairs);
        let alone = self.components <= 1 && self.scene.facets.iter().all(|f| f.convex);
        let report = &mut self.scene.report;
        report.convex = alone && self.components == 1 && report.closed;
        report.no_occlusion = report.occluder_pairs == Some(0) || alone;
        self.scene
    }

    fn group(&mut self, group: usize) {
        let target = self.target;
        let of_group = |p: &Part| p.hinge.map_or(0, |h| h + 1) == group;
        let (mut points, mut triangles): (Vec<DVec3>, Vec<([u32; 3], usize)>) = Default::default();
        let mut normals: Vec<Option<[DVec3; 3]>> = Vec::new();
        for (number, part) in target.parts.iter().enumerate().filter(|(_, p)| of_group(p)) {
            let Shape::Mesh(mesh) = &part.shape else { continue };
            let first = points.len() as u32;
            points.extend(mesh.vertices.iter().map(|v| part.placement.point(*v)));
            triangles.extend(mesh.triangles.iter().map(|t| (t.map(|k| k + first), number)));
            let (bends, wrong) = curved::build::bends(mesh, part.placement.rotation);
            normals.extend(bends);
            if wrong > 0 {
                self.scene.report.warnings.push(format!(
                    "part `{}`: {wrong} triangles have a normal that looks to their other side: they stay flat",
                    part.name
                ));
            }
        }
        self.scene.report.triangles += triangles.len();
        if triangles.is_empty() {
            return;
        }
        let touching = self.scene.touching_m;
        let (numbers, places) = weld::weld(&points, touching);
        let welded: Vec<([u32; 3], usize)> =
            triangles.iter().map(|(t, p)| (t.map(|k| numbers[k as usize]), *p)).collect();
        let (of, closed) = components_of_parts(&places, &welded, touching);
        let triangles: Vec<Triangle> = welded
            .iter()
            .zip(of.iter().zip(normals))
            .map(|((corners, part), (c, normals))| Triangle {
                corners: *corners,
                part: *part,
                component: *c,
                normals,
            })
            .collect();
        let mut polygons = facets::merge(&places, &triangles, self.size * Scene::FLAT);
        let mut by_component: Vec<Vec<&Polygon>> = vec![Vec::new(); closed.len()];
        polygons.iter().for_each(|p| by_component[p.component].push(p));
        let mut convex = vec![false; closed.len()];
        let mut hides: Vec<Option<Kind>> = vec![None; closed.len()];
        for (c, polygons) in by_component.iter().enumerate().filter(|(_, p)| !p.is_empty()) {
            self.scene.report.closed &= closed[c];
            let shape =
                if closed[c] { solid::examine(polygons, touching) } else { solid::Shape::Hollow };
            convex[c] = !matches!(shape, solid::Shape::Hollow);
            // Normals that look inward, on the whole: light may stand on the wrong side, so both sides hide.
            let inward = closed[c] && solid::volume(polygons) < -touching * touching * self.size;
            if !closed[c] || inward {
                hides[c] = Some(Kind::Sheet);
                let (name, what) = (
                    &target.parts[polygons[0].part].name,
                    if inward { "its normals look inward" } else { "it is not closed" },
                );
                self.scene.report.warnings.push(format!(
                    "part `{name}`: {what}; its faces reflect with their front and hide with both sides"
                ));
            } else if let solid::Shape::Small(solid) = shape {
                let kind = Kind::Solid(solid.edges);
                self.hide(&solid.corners, None, self.components + c, group, kind);
            } else {
                hides[c] = Some(Kind::Leaving);
            }
        }
        let before = polygons.len();
        super::buried::remove(&mut polygons, &convex, touching);
        self.scene.report.buried += before - polygons.len();
        for polygon in &polygons {
            if let Some(kind) = &hides[polygon.component] {
                let component = self.components + polygon.component;
                let normal = Some(polygon.normal);
                self.hide(&polygon.corners, normal, component, group, kind.clone());
            }
        }
        let covered = super::coincident::resolve(&mut polygons, touching);
        if let Some((part, other, area)) = covered {
            self.scene.covers = true;
            let (part, other) = (&target.parts[part].name, &target.parts[other].name);
            self.scene.report.warnings.push(format!(
                "coincident faces that look the same way, {area:.3e} m² in all (`{other}` on `{part}` and perhaps more): the later covers the earlier"
            ));
        }
        for polygon in &polygons {
            let component = self.components + polygon.component;
            self.facet(polygon, component, convex[polygon.component], group);
        }
        self.components += closed.len();
    }

    /// Adds an occluder.
    fn hide(
        &mut self,
        corners: &[DVec3],
        normal: Option<DVec3>,
        component: usize,
        group: usize,
        kind: Kind,
    ) {
        let now = &mut self.scene.geometry;
        let start = now.corners.len();
        now.corners.extend_from_slice(corners);
        let middle = corners.iter().sum::<DVec3>() / corners.len() as f64;
        let radius = corners.iter().map(|c| c.distance(middle)).fold(0.0, f64::max);
        now.middle.push(middle);
        now.facing.push(normal.unwrap_or(DVec3::ZERO));
        let corners = start..now.corners.len();
        let component = component as u32;
        self.scene.occluders.push(Occluder { corners, radius, component, group, kind });
    }

    fn facet(&mut self, polygon: &Polygon, component: usize, convex: bool, group: usize) {
        let part = &self.target.parts[polygon.part];
        let (origin, normal) = (polygon.middle(), polygon.normal);
        let tangent = facets::tangent(part, normal);
        let bitangent = normal.cross(tangent);
        let flat: Vec<P2> = polygon
            .corners
            .iter()
            .map(|c| [(*c - origin).dot(tangent), (*c - origin).dot(bitangent)])
            .collect();
        let patch = polygon.bend.as_ref().map(|bend| {
            let flat = |p: DVec3| [(p - origin).dot(tangent), (p - origin).dot(bitangent)];
            let turned = |n: DVec3| DVec3::new(n.dot(tangent), n.dot(bitangent), n.dot(normal));
            self.scene.patches.push(Patch::new(bend.corners.map(flat), bend.normals.map(turned)));
            self.scene.patches.len() as u32 - 1
        });
        let now = &mut self.scene.geometry;
        now.normal.push(normal);
        now.origin.push(origin);
        now.tangent.push(tangent);
        now.bitangent.push(bitangent);
        self.scene.outlines.push(&flat);
        self.scene.facets.push(Facet {
            area: polygon.area,
            radius: flat.iter().map(|p| p[0].hypot(p[1])).fold(0.0, f64::max),
            material: part.material as u32,
            part: polygon.part as u32,
            component: component as u32,
            group: group as u32,
            patch,
            convex,
        });
    }

    /// Adds what is curved.
    fn rounds(&mut self) {
        for number in 0..self.target.parts.len() {
            let touching = self.scene.touching_m;
            let made = curved::build::make(self.target, number, self.components, touching);
            let Some(made) = made else { continue };
            let component = self.components;
            self.components += 1;
            let (group, place) = (made.round.group, self.target.parts[number].placement);
            for end in &made.ends {
                self.facet(end, component, true, group);
            }
            let motion = Motion { rotation: place.rotation, offset_m: place.offset_m };
            let kind = match made.round.sphere {
                Some(_) => Kind::Sphere,
                None => Kind::Outline(self.scene.rounds.len() as u32),
            };
            if made.sheets.is_empty() {
                let occluder = self.scene.occluders.len();
                self.hide(&[motion.point(made.round.middle)], None, component, group, kind);
                self.scene.occluders[occluder].radius = made.round.radius;
            }
            for sheet in &made.sheets {
                let normal = Polygon::new(sheet.clone(), number, component).map(|p| p.normal);
                self.hide(sheet, normal, component, group, Kind::Sheet);
            }
            self.scene.report.closed &= made.closed;
            self.scene.geometry.place.push(motion);
            self.scene.rounds.push(made.round);
        }
    }

    /// Looks at every pair of a facet and an occluder once, if they are not too many.
    fn pair(&mut self, most_pairs: usize) {
        let scene = &mut self.scene;
        scene.report.solids =
            scene.occluders.iter().filter(|o| matches!(o.kind, Kind::Solid(_))).count();
        let alone = self.components <= 1 && scene.facets.iter().all(|f| f.convex);
        if alone {
            scene.report.occluder_pairs = Some(0);
            scene.pairs = Some((vec![0..0; scene.facets.len()], Vec::new()));
            return;
        }
        if scene.facets.len() * scene.occluders.len() > most_pairs {
            return;
        }
        let (mut ranges, mut pairs) = (Vec::with_capacity(scene.facets.len()), Vec::new());
        let now = &scene.geometry;
        for (i, facet) in scene.facets.iter().enumerate() {
            let start = pairs.len();
            let height = |p: DVec3| (p - now.origin[i]).dot(now.normal[i]);
            for (k, occluder) in scene.occluders.iter().enumerate() {
                if facet.convex && occluder.component == facet.component {
                    continue;
                }
                let corners = &now.corners[occluder.corners.clone()];
                let ball = matches!(occluder.kind, Kind::Sphere | Kind::Outline(_));
                let above = if ball {
                    height(now.middle[k]) + occluder.radius > scene.touching_m
                } else {
                    corners.iter().any(|c| height(*c) > scene.touching_m)
                };
                if above || occluder.group != facet.group as usize {
                    pairs.push(k as u32);
                }
            }
            ranges.push(start..pairs.len());
        }
        scene.report.occluder_pairs = Some(pairs.len());
        scene.pairs = Some((ranges, pairs));
    }
}
