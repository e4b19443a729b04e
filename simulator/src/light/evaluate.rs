//! What a scene sends to an observer.

use super::clip::{self, P2, Polygons, Scratch};
use super::geometry::{Geometry, Motion};
use super::grid::Grid;
use super::occlude::{Kind, Plane, Room, Toward};
use super::scene::{Ball, Scene};
use super::{View, near, sphere};
use glam::DVec3;
use std::borrow::Cow;

/// Cosines below this are those of a direction in the facet's plane, to rounding: such a facet counts as unlit (or unseen).
const GRAZING: f64 = 1e-15;

/// What faces of several parts in one plane leave open, of the W of all area in white paint, square to the light. Calibrated: random scenes of
/// such faces split into T-junctions and slivers of 1e-6 change by 0.4 of it (test `splitting_and_order_change_nothing`).
const COVERING: f64 = 10.0 * Scene::TOUCHING;

/// More occluders than this over one facet are shared out among parts of it.
const MANY: usize = 12;

/// What was done for one evaluation.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Direct {
    /// Facets that face both the Sun and the observer.
    pub facets: usize,
    /// Of them, those of which something was taken away.
    pub shadowed: usize,
    /// Pairs of a facet and an occluder looked at.
    pub occluder_tests: usize,
    /// Shadows that fell on a facet's outline.
    pub shadows: usize,
    /// Convex pieces that the shadowed facets fell into.
    pub pieces: usize,
    /// Spheres in closed form.
    pub spheres: usize,
    /// Spheres whose remaining share was found with flat facets.
    pub tessellated: usize,
    /// An estimate of the relative error of ΣW from rounding, touching tolerances, quadrature and flat facets of spheres.
    pub error: f64,
}

/// Why nothing was evaluated.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DirectionError {
    /// A direction without length or not of finite numbers.
    #[error("{what} is ({}, {}, {}), expected finite numbers, not all 0", value.x, value.y, value.z)]
    NoDirection {
        /// Towards the Sun, or to the observer.
        what: &'static str,
        /// What was given.
        value: DVec3,
    },
    /// Room for another number of weights.
    #[error("room for {found} weights, expected {expected}")]
    Room {
        /// What was given.
        found: usize,
        /// What is needed.
        expected: usize,
    },
}

/// A scene with room to work in.
#[derive(Debug)]
pub struct Evaluator<'a> {
    scene: &'a Scene,
    now: Cow<'a, Geometry>,
    angles: Vec<f64>,
    radii: Vec<f64>,
    work: Work,
    near: near::Quadrature,
}

/// Buffers.
#[derive(Debug, Default)]
struct Work {
    grids: [Grid; 2],
    chosen: Vec<u32>,
    shadows: Polygons,
    pieces: Polygons,
    next: Polygons,
    kept: Polygons,
    room: Room,
    scratch: Scratch,
    done: Direct,
}

impl<'a> Evaluator<'a> {
    pub(super) fn new(scene: &'a Scene) -> Self {
        Self {
            scene,
            now: Cow::Borrowed(&scene.geometry),
            angles: vec![0.0; scene.hinges.len()],
            radii: scene.occluders.iter().map(|o| o.radius).collect(),
            work: Work::default(),
            near: near::Quadrature::default(),
        }
    }

    /// Sets `out[k]` to W_k \[m² sr⁻¹\] for the Sun in direction `sun_body` and an observer at `view`, both in the body's axes. Hinged parts
    /// turn to the Sun. For an observer at a point W_k is such that the irradiance there (on planes across each ray) is
    /// E Σ_k ρ_k W_k/|view|².
    ///
    /// # Errors
    /// A direction that is none, `out` of another length than [`Scene::weight_count`].
    pub fn direct(
        &mut self,
        sun_body: DVec3,
        view: View,
        out: &mut [f64],
    ) -> Result<Direct, DirectionError> {
        self.check(out, self.scene.weight_count())?;
        self.sum(sun_body, view, 0, out)
    }

    /// As [`Evaluator::direct`], each part for itself: `out[part * weight_count + k]`.
    ///
    /// # Errors
    /// As there, with room for [`Scene::part_count`] times [`Scene::weight_count`].
    pub fn direct_by_part(
        &mut self,
        sun_body: DVec3,
        view: View,
        out: &mut [f64],
    ) -> Result<Direct, DirectionError> {
        let stride = self.scene.weight_count();
        self.check(out, self.scene.part_count() * stride)?;
        self.sum(sun_body, view, stride, out)
    }

    fn check(&self, out: &[f64], expected: usize) -> Result<(), DirectionError> {
        let found = out.len();
        if found == expected { Ok(()) } else { Err(DirectionError::Room { found, expected }) }
    }

    fn sum(
        &mut self,
        sun: DVec3,
        view: View,
        stride: usize,
        out: &mut [f64],
    ) -> Result<Direct, DirectionError> {
        let unit = |what, value: DVec3| {
            value.try_normalize().ok_or(DirectionError::NoDirection { what, value })
        };
        let sun = unit("the direction of the Sun", sun)?;
        let eye = match view {
            View::Distant(d) => Toward::Far(unit("the direction of the observer", d)?),
            View::At(q) => {
                unit("the place of the observer", q)?;
                Toward::Near(q)
            }
        };
        out.fill(0.0);
        self.work.done = Direct::default();
        self.turn(sun);
        if self.scene.pairs.is_none() {
            self.index(sun, eye);
        }
        let mut error = 0.0;
        let usual = self.scene.spheres.first().map_or(self.scene.facets.len(), |s| s.facets.start);
        for i in 0..usual {
            error += self.facet(i, sun, eye, stride, out);
        }
        for ball in 0..self.scene.spheres.len() {
            error += self.ball(ball, sun, eye, stride, out);
        }
        if self.scene.covers {
            let area: f64 = self.scene.facets[..usual].iter().map(|f| f.area).sum();
            error += COVERING * area * std::f64::consts::FRAC_1_PI;
        }
        let total: f64 = out.iter().sum();
        let mut done = self.work.done;
        done.error = if total > 0.0 { error / total + 1e-15 } else { 0.0 };
        Ok(done)
    }

    /// To be called before [`Evaluator::open`] for another direction.
    pub(super) fn prepare(&mut self, toward: Toward) {
        if self.scene.pairs.is_none()
            && let Toward::Far(d) = toward
        {
            self.index(d, toward);
        }
    }

    /// What of a facet is open to one direction alone, in its own axes; `None` where nothing is taken away. Hinges stay as they are.
    pub(super) fn open(&mut self, facet: usize, toward: Toward) -> Option<&Polygons> {
        let (scene, work) = (self.scene, &mut self.work);
        if scene.report().no_occlusion {
            return None;
        }
        work.shadows.clear();
        work.gather(scene, &self.now, facet, toward, 0);
        let touching = 1e-14 * scene.facets[facet].radius;
        let cut = !work.shadows.is_empty() && work.clip(scene.outlines.get(facet), touching);
        cut.then_some(&self.work.kept)
    }

    /// Turns hinged parts to the Sun.
    fn turn(&mut self, sun: DVec3) {
        let scene = self.scene;
        for (h, hinge) in scene.hinges.iter().enumerate() {
            let angle = hinge.angle_rad(sun);
            if angle == self.angles[h] {
                continue;
            }
            self.angles[h] = angle;
            let motion = Motion::about(hinge.point_m, hinge.axis, angle);
            let (base, now) = (&scene.geometry, self.now.to_mut());
            for (i, _) in scene.facets.iter().enumerate().filter(|f| f.1.group as usize == h + 1) {
                now.normal[i] = motion.vector(base.normal[i]);
                now.tangent[i] = motion.vector(base.tangent[i]);
                now.bitangent[i] = motion.vector(base.bitangent[i]);
                now.origin[i] = motion.point(base.origin[i]);
            }
            for (k, o) in scene.occluders.iter().enumerate().filter(|o| o.1.group == h + 1) {
                now.middle[k] = motion.point(base.middle[k]);
                now.facing[k] = motion.vector(base.facing[k]);
                for c in o.corners.clone() {
                    now.corners[c] = motion.point(base.corners[c]);
                }
            }
        }
    }

    /// Sorts the occluders by their shadows.
    fn index(&mut self, sun: DVec3, eye: Toward) {
        let (scene, now) = (self.scene, &self.now);
        let leaves = |k: usize, d: DVec3| {
            !matches!(scene.occluders[k].kind, Kind::Leaving) || now.facing[k].dot(d) > 0.0
        };
        let radii = &self.radii;
        self.work.grids[0].fill(sun, &now.middle, radii, |k| leaves(k, sun));
        // From a point the shadows spread: the grid would be wrong.
        if let Toward::Far(d) = eye {
            self.work.grids[1].fill(d, &now.middle, radii, |k| leaves(k, d));
        }
    }

    /// Adds one facet. Gives the error that it brings, m² sr⁻¹.
    fn facet(&mut self, i: usize, sun: DVec3, eye: Toward, stride: usize, out: &mut [f64]) -> f64 {
        let normal = self.now.normal[i];
        let cos_i = normal.dot(sun);
        if cos_i <= GRAZING {
            return 0.0;
        }
        let origin = self.now.origin[i];
        let cos_o = normal.dot(eye.from(origin));
        if cos_o <= GRAZING {
            return 0.0;
        }
        let scene = self.scene;
        let facet = &scene.facets[i];
        self.work.done.facets += 1;
        let outline = scene.outlines.get(i);
        let cut = self.work.visible(scene, &self.now, i, sun, eye, outline);
        let area = if cut { self.work.kept.area() } else { facet.area };
        if area == 0.0 {
            return 0.0;
        }
        let weights = scene.weights_of(facet.material as usize);
        let start = facet.part as usize * stride;
        let out = &mut out[start + weights.start..start + weights.end];
        let material = &scene.materials[facet.material as usize];
        let (u, v) = (self.now.tangent[i], self.now.bitangent[i]);
        let sun = DVec3::new(u.dot(sun), v.dot(sun), cos_i);
        let rounding = if cut {
            let width = scene.touching_m.max(1e-15 * facet.radius);
            1e-15 * facet.area + 1e-4 * width * facet.radius
        } else {
            0.0
        };
        match eye {
            Toward::Far(d) => {
                let to = DVec3::new(u.dot(d), v.dot(d), cos_o);
                let before: f64 = if cut { out.iter().sum() } else { 0.0 };
                material.add_weights(sun, to, area * cos_i * cos_o, out);
                if cut {
                    let added = out.iter().sum::<f64>() - before;
                    (added / area).abs() * rounding
                } else {
                    0.0
                }
            }
            Toward::Near(q) => {
                let rel = q - origin;
                let at = DVec3::new(rel.dot(u), rel.dot(v), rel.dot(normal));
                let task = near::Task {
                    material,
                    sun,
                    at,
                    range_squared: q.length_squared(),
                    facet_area: facet.area,
                };
                if cut {
                    self.work.kept.iter().map(|p| self.near.add(&task, p, 1.0, out)).sum()
                } else {
                    self.near.add(&task, outline, 1.0, out)
                }
            }
        }
    }

    /// Adds a sphere.
    fn ball(
        &mut self,
        number: usize,
        sun: DVec3,
        eye: Toward,
        stride: usize,
        out: &mut [f64],
    ) -> f64 {
        let scene = self.scene;
        let ball = &scene.spheres[number];
        let middle = self.now.middle[ball.occluder];
        let weights = scene.weights_of(ball.material as usize);
        let start = ball.part as usize * stride;
        let range = start + weights.start..start + weights.end;
        let material = &scene.materials[ball.material as usize];
        let to = eye.from(middle);
        // From a point: the closed form at the middle's distance and angle, of which the facets say the share that is seen from there.
        let nearness = match eye {
            Toward::Far(_) => 1.0,
            Toward::Near(q) => q.length_squared() / (q - middle).length_squared(),
        };
        // Right at all angles (Kahan), where the arc cosine is not.
        let phase = 2.0 * (sun - to).length().atan2((sun + to).length());
        let scale = ball.radius * ball.radius * nearness;
        // Neither a tangent nor an angle out of range is left to refuse: the scene was checked, the angle is made here.
        let error = material
            .add_sphere_weights(phase.min(std::f64::consts::PI), scale, &mut out[range.clone()])
            .unwrap_or(f64::INFINITY);
        let full: f64 = out[range.clone()].iter().sum();
        let far = matches!(eye, Toward::Far(_));
        if far && self.is_free(number, sun, to) {
            self.work.done.spheres += 1;
            return full * error;
        }
        self.work.done.tessellated += 1;
        if material.is_mirror() {
            return self.glint(ball, sun, eye, to, &mut out[range]) + full * error;
        }
        // The facets say what share is left; the closed form says of how much.
        let mut left = vec![0.0; out.len()];
        let mut whole = vec![0.0; range.len()];
        let mut rounding = 0.0;
        for i in ball.facets.clone() {
            rounding += self.facet(i, sun, eye, stride, &mut left);
            let (normal, u, v) = (self.now.normal[i], self.now.tangent[i], self.now.bitangent[i]);
            let local = |d: DVec3| DVec3::new(u.dot(d), v.dot(d), normal.dot(d));
            let (i_local, o_local) = (local(sun), local(to));
            if i_local.z > GRAZING && o_local.z > GRAZING {
                let area = nearness * scene.facets[i].area * i_local.z * o_local.z;
                material.add_weights(i_local, o_local, area, &mut whole);
            }
        }
        let mut faceting = 0.0;
        for ((closed, left), whole) in out[range.clone()].iter_mut().zip(&left[range]).zip(&whole) {
            if *whole > 0.0 {
                let kept = *closed * left / whole;
                let resolved = (*closed / whole - 1.0).abs();
                let between = if far { kept.min(*closed - kept).max(0.0) } else { kept };
                faceting += sphere::FACETING * (between * whole).sqrt() + resolved * between;
                *closed = kept;
            } else {
                // A crescent too thin for the facets: nothing is known of what hides it.
                faceting += *closed;
            }
        }
        rounding + faceting + full * error
    }

    /// A mirror sphere sends light from one point: the facet there says whether it is lit and seen. Gives the error.
    fn glint(&mut self, ball: &Ball, sun: DVec3, eye: Toward, to: DVec3, out: &mut [f64]) -> f64 {
        let halfway = (sun + to).normalize_or_zero();
        let along = |i: &usize| self.now.normal[*i].dot(halfway);
        let Some(i) = ball.facets.clone().max_by(|a, b| along(a).total_cmp(&along(b))) else {
            return 0.0;
        };
        let scene = self.scene;
        if !self.work.visible(scene, &self.now, i, sun, eye, scene.outlines.get(i)) {
            return 0.0;
        }
        let share = self.work.kept.area() / scene.facets[i].area;
        let full: f64 = out.iter().sum();
        if share < 0.5 {
            out.fill(0.0);
        }
        // The point lies somewhere on the facet.
        if share > 1e-9 && share < 1.0 - 1e-9 { full } else { 0.0 }
    }

    /// Whether nothing stands before, behind or beside a sphere in these directions so near that it could shade or hide it.
    fn is_free(&self, number: usize, sun: DVec3, to: DVec3) -> bool {
        let ball = &self.scene.spheres[number];
        let middle = self.now.middle[ball.occluder];
        self.scene.occluders.iter().enumerate().all(|(k, other)| {
            let reach = ball.radius + other.radius;
            k == ball.occluder
                || [sun, to].iter().all(|d| {
                    let away = self.now.middle[k] - middle;
                    let along = away.dot(*d);
                    along < -reach || away.length_squared() - along * along >= reach * reach
                })
        })
    }
}

impl Work {
    /// Whether anything is taken away of facet `i`; what is left stands in `kept`.
    fn visible(
        &mut self,
        scene: &Scene,
        now: &Geometry,
        i: usize,
        sun: DVec3,
        eye: Toward,
        outline: &[P2],
    ) -> bool {
        if scene.report().no_occlusion {
            return false;
        }
        self.shadows.clear();
        self.gather(scene, now, i, Toward::Far(sun), 0);
        // In opposition what is seen is what is lit.
        if !matches!(eye, Toward::Far(d) if d == sun) {
            self.gather(scene, now, i, eye, 1);
        }
        if self.shadows.is_empty() {
            return false;
        }
        self.done.shadows += self.shadows.len();
        let touching = 1e-14 * scene.facets[i].radius;
        let cut = self.clip(outline, touching);
        if cut {
            self.done.shadowed += 1;
            self.done.pieces += self.kept.len();
        }
        cut
    }

    /// Appends the shadows on a facet.
    fn gather(&mut self, scene: &Scene, now: &Geometry, i: usize, toward: Toward, grid: usize) {
        let facet = &scene.facets[i];
        let origin = now.origin[i];
        let near = matches!(toward, Toward::Near(_));
        let candidates: &[u32] = match &scene.pairs {
            Some((ranges, pairs)) => &pairs[ranges[i].clone()],
            None => {
                self.chosen.clear();
                if near {
                    self.chosen.extend(0..scene.occluders.len() as u32);
                } else {
                    self.grids[grid].near(origin, facet.radius, &mut self.chosen);
                }
                &self.chosen
            }
        };
        if candidates.is_empty() {
            return;
        }
        self.done.occluder_tests += candidates.len();
        let direction = toward.from(origin);
        // Seen from a point, the shadow of a ball spreads with the distance.
        let plane = Plane::new(now, i, toward, scene.touching_m);
        let bounds = clip::bounds(scene.outlines.get(i));
        for &k in candidates {
            let k = k as usize;
            let occluder = &scene.occluders[k];
            if occluder.component == facet.component && facet.convex {
                continue;
            }
            let away = now.middle[k] - origin;
            let reach = facet.radius + occluder.radius;
            let across = match toward {
                Toward::Far(d) => {
                    let along = away.dot(d);
                    along < -reach || away.length_squared() - along * along > reach * reach
                }
                Toward::Near(q) => misses(away, q - origin, facet.radius, occluder.radius),
            };
            if across || away.dot(now.normal[i]) + occluder.radius <= scene.touching_m {
                continue;
            }
            let corners = &now.corners[occluder.corners.clone()];
            let added = match &occluder.kind {
                Kind::Solid(edges) => {
                    plane.shadow(corners, Some(edges), &mut self.room, &mut self.shadows)
                }
                Kind::Sphere => plane.sphere(
                    now.middle[k],
                    occluder.radius,
                    toward,
                    &mut self.room,
                    &mut self.shadows,
                ),
                Kind::Leaving | Kind::Sheet => {
                    let leaves = if near {
                        now.facing[k].dot(toward.from(corners[0]))
                    } else {
                        now.facing[k].dot(direction)
                    };
                    let hides = match occluder.kind {
                        Kind::Leaving => leaves > 0.0,
                        _ => leaves != 0.0,
                    };
                    hides && plane.shadow(corners, None, &mut self.room, &mut self.shadows)
                }
            };
            if added {
                let last = self.shadows.len() - 1;
                if !clip::overlap(&bounds, &clip::bounds(self.shadows.get(last))) {
                    self.shadows.pop();
                }
            }
        }
    }

    /// Takes all shadows from an outline; what is left goes to `kept`. Whether anything was taken.
    fn clip(&mut self, outline: &[P2], touching: f64) -> bool {
        self.kept.clear();
        let all: Vec<u32> = if self.shadows.len() > MANY {
            (0..self.shadows.len() as u32).collect()
        } else {
            Vec::new()
        };
        if all.is_empty() {
            self.pieces.clear();
            self.pieces.push(outline);
            let mut cut = false;
            for k in 0..self.shadows.len() {
                cut |= self.take(k, touching);
                if self.pieces.is_empty() {
                    break;
                }
            }
            std::mem::swap(&mut self.kept, &mut self.pieces);
            return cut;
        }
        let boxes: Vec<[f64; 4]> = self.shadows.iter().map(clip::bounds).collect();
        self.share(outline, &all, &boxes, touching, 0)
    }

    /// Takes one shadow from all pieces.
    fn take(&mut self, shadow: usize, touching: f64) -> bool {
        let hole = self.shadows.get(shadow);
        self.next.clear();
        let mut cut = false;
        for piece in self.pieces.iter() {
            cut |= clip::subtract(piece, hole, touching, &mut self.next, &mut self.scratch);
        }
        std::mem::swap(&mut self.pieces, &mut self.next);
        cut
    }

    /// Many shadows: the outline is halved until few fall on each part, so that a piece meets only what is near.
    fn share(
        &mut self,
        outline: &[P2],
        shadows: &[u32],
        boxes: &[[f64; 4]],
        touching: f64,
        depth: u32,
    ) -> bool {
        let here = clip::bounds(outline);
        let near: Vec<u32> =
            shadows.iter().copied().filter(|&k| clip::overlap(&here, &boxes[k as usize])).collect();
        // Halving helps only where shadows are smaller than the part.
        let (width, height) = (here[2] - here[0], here[3] - here[1]);
        let wide = |b: &[f64; 4]| b[2] - b[0] > 0.5 * width && b[3] - b[1] > 0.5 * height;
        let small = near.iter().filter(|&&k| !wide(&boxes[k as usize])).count();
        if small <= MANY || depth >= 40 {
            self.pieces.clear();
            self.pieces.push(outline);
            let mut cut = false;
            for &k in &near {
                cut |= self.take(k as usize, touching);
                if self.pieces.is_empty() {
                    break;
                }
            }
            for piece in self.pieces.iter() {
                self.kept.push(piece);
            }
            return cut;
        }
        let axis = usize::from(height > width);
        let middle = 0.5 * (here[axis] + here[axis + 2]);
        let mut halves = Polygons::default();
        clip::cut(outline, axis, middle, false, &mut halves);
        clip::cut(outline, axis, middle, true, &mut halves);
        let mut cut = false;
        for half in halves.iter() {
            cut |= self.share(half, &near, boxes, touching, depth + 1);
        }
        cut
    }
}

/// Whether a ball at `away` cannot stand between a facet's ball at the origin and an eye at `eye`.
fn misses(away: DVec3, eye: DVec3, facet: f64, ball: f64) -> bool {
    let range = eye.length();
    let toward = eye / range;
    let along = away.dot(toward);
    if along < -(facet + ball) || along > range + facet + ball {
        return true;
    }
    // Lines from the facet to the eye stay within its own radius of the axis.
    away.length_squared() - along * along > (facet + ball) * (facet + ball)
}
