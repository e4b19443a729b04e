//! A target, prepared for evaluation.

use super::clip::{self, P2};
use super::evaluate::Evaluator;
use super::facets::{self, Polygon, Triangle};
use super::geometry::Geometry;
use super::occlude::{Kind, Occluder};
use super::{closed, solid, sphere, weld};
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
    pub(super) spheres: Vec<Ball>,
    pub(super) occluders: Vec<Occluder>,
    pub(super) geometry: Geometry,
    /// For each facet a range of `candidates`; `None` where an index is made for each direction instead.
    pub(super) pairs: Option<(Vec<Range<usize>>, Vec<u32>)>,
    pub(super) touching_m: f64,
    /// Whether faces cover others in their plane.
    pub(super) covers: bool,
    report: SceneReport,
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
    /// The sphere that it stands for, if any: then it says only what share of the sphere is left.
    pub sphere: Option<u32>,
    /// Whether its component is convex, and hides nothing of itself.
    pub convex: bool,
}

/// A sphere; its middle is that of its occluder.
#[derive(Debug, Clone)]
pub(super) struct Ball {
    pub radius: f64,
    pub material: u32,
    pub part: u32,
    pub occluder: usize,
    pub facets: Range<usize>,
}

/// Why a target cannot be prepared.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A perfect mirror that is flat.
    #[error(
        "part `{part}` is a flat mirror (`{material}`): under a Sun without extent it sends nothing or an infinite intensity; give it a roughness, or make it a sphere"
    )]
    FlatMirror {
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
}

/// What a scene needs.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SceneReport {
    /// Triangles that came in.
    pub triangles: usize,
    /// Facets after merging triangles of one plane and part; those that stand for spheres not counted.
    pub facets: usize,
    /// Spheres, in closed form wherever nothing interferes with them.
    pub spheres: usize,
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
    /// Error of a sphere that something shades or hides, of the geometric mean of the whole and the smaller of its hidden and remaining
    /// parts; 0 without spheres.
    pub sphere_faceting: f64,
    /// What a person should hear of.
    pub warnings: Vec<String>,
}

impl Scene {
    /// A corner nearer to a facet's plane than this times the scene's size (half the diagonal of its bounding box) lies in that plane.
    pub const TOUCHING: f64 = 1e-10;
    /// Triangles merge where their corners lie in one plane within this times the scene's size.
    pub const FLAT: f64 = 1e-13;
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
        for part in &target.parts {
            check(target, part)?;
        }
        Ok(Builder::new(target).finish(most_pairs))
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

fn check(target: &Target, part: &Part) -> Result<(), SceneError> {
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
            if material.is_mirror() {
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
            mesh.vertices.iter().all(|v| v.is_finite())
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
            spheres: Vec::new(),
            occluders: Vec::new(),
            geometry: Geometry::default(),
            pairs: None,
            touching_m: size * Scene::TOUCHING,
            covers: false,
            report,
        };
        Self { target, size, components: 0, scene }
    }

    fn finish(mut self, most_pairs: usize) -> Scene {
        for group in 0..=self.target.hinges.len() {
            self.group(group);
        }
        self.spheres();
        let scene = &mut self.scene;
        scene.report.facets = scene.facets.iter().filter(|f| f.sphere.is_none()).count();
        scene.report.spheres = scene.spheres.len();
        if scene.spheres.len() + scene.report.facets > 1 && !scene.spheres.is_empty() {
            scene.report.sphere_faceting = sphere::FACETING;
        }
        self.pair(most_pairs);
        let alone = self.components <= 1 && self.scene.facets.iter().all(|f| f.convex);
        let report = &mut self.scene.report;
        report.convex = alone && self.components == 1;
        report.no_occlusion = report.occluder_pairs == Some(0) || alone;
        self.scene
    }

    fn group(&mut self, group: usize) {
        let target = self.target;
        let of_group = |p: &Part| p.hinge.map_or(0, |h| h + 1) == group;
        let (mut points, mut triangles): (Vec<DVec3>, Vec<([u32; 3], usize)>) = Default::default();
        for (number, part) in target.parts.iter().enumerate().filter(|(_, p)| of_group(p)) {
            let Shape::Mesh(mesh) = &part.shape else { continue };
            let first = points.len() as u32;
            points.extend(mesh.vertices.iter().map(|v| part.placement.point(*v)));
            triangles.extend(mesh.triangles.iter().map(|t| (t.map(|k| k + first), number)));
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
            .zip(&of)
            .map(|((corners, part), c)| Triangle { corners: *corners, part: *part, component: *c })
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
            self.facet(polygon, component, convex[polygon.component], group, None);
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

    fn facet(
        &mut self,
        polygon: &Polygon,
        component: usize,
        convex: bool,
        group: usize,
        sphere: Option<u32>,
    ) {
        let part = &self.target.parts[polygon.part];
        let (origin, normal) = (polygon.middle(), polygon.normal);
        let tangent = tangent(part, normal);
        let bitangent = normal.cross(tangent);
        let flat: Vec<P2> = polygon
            .corners
            .iter()
            .map(|c| [(*c - origin).dot(tangent), (*c - origin).dot(bitangent)])
            .collect();
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
            sphere,
            convex,
        });
    }

    fn spheres(&mut self) {
        let unit = sphere::triangles();
        for (number, part) in self.target.parts.iter().enumerate() {
            let Shape::Sphere { radius_m } = part.shape else { continue };
            let group = part.hinge.map_or(0, |h| h + 1);
            let middle = part.placement.point(DVec3::ZERO);
            let component = self.components;
            self.components += 1;
            let ball = self.scene.spheres.len() as u32;
            let first = self.scene.facets.len();
            for corners in &unit {
                let corners = corners.map(|c| middle + radius_m * c).to_vec();
                if let Some(polygon) = Polygon::new(corners, number, component) {
                    self.facet(&polygon, component, true, group, Some(ball));
                }
            }
            let facets = first..self.scene.facets.len();
            let occluder = self.scene.occluders.len();
            self.hide(&[middle], None, component, group, Kind::Sphere);
            self.scene.occluders[occluder].radius = radius_m;
            let (material, part) = (part.material as u32, number as u32);
            self.scene.spheres.push(Ball { radius: radius_m, material, part, occluder, facets });
        }
    }

    /// Looks at every pair of a facet and an occluder once, if they are not too many.
    fn pair(&mut self, most_pairs: usize) {
        let scene = &mut self.scene;
        scene.report.solids =
            scene.occluders.iter().filter(|o| matches!(o.kind, Kind::Solid(_))).count();
        let usual = scene.facets.iter().filter(|f| f.sphere.is_none()).count();
        let alone = self.components <= 1 && scene.facets.iter().all(|f| f.convex);
        if alone {
            scene.report.occluder_pairs = Some(0);
            scene.pairs = Some((vec![0..0; scene.facets.len()], Vec::new()));
            return;
        }
        if scene.facets.len() * scene.occluders.len() > most_pairs && usual > 0 {
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
                let ball = matches!(occluder.kind, Kind::Sphere);
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

/// Half the diagonal of the bounding box, at least 1e-300 m.
fn size(target: &Target) -> f64 {
    let (mut low, mut high) = (DVec3::MAX, DVec3::MIN);
    let mut take = |p: DVec3, r: f64| {
        low = low.min(p - r);
        high = high.max(p + r);
    };
    for part in &target.parts {
        match &part.shape {
            Shape::Mesh(mesh) => {
                mesh.vertices.iter().for_each(|v| take(part.placement.point(*v), 0.0));
            }
            Shape::Sphere { radius_m } => take(part.placement.point(DVec3::ZERO), *radius_m),
        }
    }
    // Coordinates far from the origin carry the rounding of that distance.
    let far = low.abs().max(high.abs()).max_element();
    if far.is_finite() { (0.5 * (high - low).length()).max(far).max(1e-300) } else { 1.0 }
}

/// Components, those that are closed within one part before those that only several parts close together.
fn components_of_parts(
    places: &[DVec3],
    triangles: &[([u32; 3], usize)],
    tolerance_m: f64,
) -> (Vec<usize>, Vec<bool>) {
    let mut of = vec![usize::MAX; triangles.len()];
    let mut closed = Vec::new();
    let mut take = |members: &[usize], keep_open: bool, of: &mut Vec<usize>| {
        let corners: Vec<[u32; 3]> = members.iter().map(|&t| triangles[t].0).collect();
        let found = closed::components(places, &corners, tolerance_m);
        let mut numbers = vec![usize::MAX; found.closed.len()];
        for (&t, &c) in members.iter().zip(&found.of) {
            let c = c as usize;
            if !found.closed[c] && !keep_open {
                continue;
            }
            if numbers[c] == usize::MAX {
                numbers[c] = closed.len();
                closed.push(found.closed[c]);
            }
            of[t] = numbers[c];
        }
    };
    let mut first = 0;
    // A part's triangles stand together.
    while first < triangles.len() {
        let part = triangles[first].1;
        let end = first + triangles[first..].iter().take_while(|t| t.1 == part).count();
        let members: Vec<usize> = (first..end).collect();
        take(&members, false, &mut of);
        first = end;
    }
    let rest: Vec<usize> = (0..triangles.len()).filter(|&t| of[t] == usize::MAX).collect();
    if !rest.is_empty() {
        take(&rest, true, &mut of);
    }
    (of, closed)
}

/// A facet's tangent: the part's in the facet's plane, or the next of its axes x, y, z where that stands on the facet.
fn tangent(part: &Part, normal: DVec3) -> DVec3 {
    let in_plane = |axis: DVec3| {
        let axis = part.placement.rotation * axis;
        axis - axis.dot(normal) * normal
    };
    let axes = [part.tangent, DVec3::X, DVec3::Y, DVec3::Z].map(in_plane);
    let chosen = axes.into_iter().find(|a| a.length() > 1e-6).unwrap_or(axes[0]);
    (chosen - chosen.dot(normal) * normal).normalize()
}
