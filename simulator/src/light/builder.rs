//! A target on its way to a [`Scene`]: parts, group by group, become facets and what may hide them.

use super::clip::{self, P2};
use super::curved::{self, bent::Patch};
use super::facets::{self, Polygon, Triangle};
use super::geometry::{Geometry, Motion};
use super::occlude::{Kind, Occluder};
use super::parts::{components_of_parts, size};
use super::scene::{Facet, Scene, SceneError, SceneReport};
use super::{solid, weld};
use crate::target::{Part, Shape, Target};
use glam::DVec3;

/// Whether a part can be prepared.
pub(super) fn check(target: &Target, part: &Part, has_disc: bool) -> Result<(), SceneError> {
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
pub(super) struct Builder<'a> {
    target: &'a Target,
    size: f64,
    components: usize,
    scene: Scene,
}

impl<'a> Builder<'a> {
    pub fn new(target: &'a Target) -> Self {
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
            phases: Vec::new(),
            large: None,
            report,
        };
        Self { target, size, components: 0, scene }
    }

    pub fn finish(mut self, most_pairs: usize) -> Scene {
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
        // Of each part, what is wrong with its pieces, and with how many.
        let mut sheets: Vec<(usize, &str, usize)> = Vec::new();
        for (c, polygons) in by_component.iter().enumerate().filter(|(_, p)| !p.is_empty()) {
            self.scene.report.closed &= closed[c];
            let shape =
                if closed[c] { solid::examine(polygons, touching) } else { solid::Shape::Hollow };
            convex[c] = !matches!(shape, solid::Shape::Hollow);
            // Normals that look inward, on the whole: light may stand on the wrong side, so both sides hide.
            let inward = closed[c] && solid::volume(polygons) < -touching * touching * self.size;
            if !closed[c] || inward {
                hides[c] = Some(Kind::Sheet);
                let part = polygons[0].part;
                let what = if inward { "normals look inward" } else { "not closed" };
                match sheets.iter_mut().find(|s| s.0 == part && s.1 == what) {
                    Some((_, _, count)) => *count += 1,
                    None => sheets.push((part, what, 1)),
                }
            } else if let solid::Shape::Small(solid) = shape {
                let kind = Kind::Solid(solid.edges);
                self.hide(&solid.corners, None, self.components + c, group, kind);
            } else {
                hides[c] = Some(Kind::Leaving);
            }
        }
        for (part, what, count) in sheets {
            let name = &target.parts[part].name;
            let what = match (what, count) {
                ("not closed", 1) => "it is not closed".to_owned(),
                ("not closed", _) => format!("{count} of its pieces are not closed"),
                (_, 1) => "its normals look inward".to_owned(),
                _ => format!("in {count} of its pieces the normals look inward"),
            };
            self.scene.report.warnings.push(format!(
                "part `{name}`: {what}; its faces reflect with their front and hide with both sides"
            ));
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
