//! Light that a scene sends to an observer.

use super::clip::{self, P2, Polygons, Scratch};
use super::curved::{self, Curves, Light, outline::Outline, sight::Sight};
use super::geometry::{Geometry, Motion};
use super::grid::Grid;
use super::large;
use super::occlude::{Kind, Plane, Room, Toward, toward, unit};
use super::scene::{Facet, Scene};
use super::{View, near};
use glam::DVec3;
use std::borrow::Cow;

/// Cosines below this are those of a direction in the facet's plane, to rounding: such a facet counts as unlit (or unseen).
pub(super) const GRAZING: f64 = 1e-15;

/// Error by faces of several parts in one plane, as a share of the W of all area in white paint, square to the light. Calibrated: random scenes of
/// such faces split into T-junctions and slivers of 1e-6 change by 0.4 of it (test `splitting_and_order_change_nothing`).
pub(super) const COVERING: f64 = 10.0 * Scene::TOUCHING;

/// More occluders than this over one facet are shared out among parts of it.
const MANY: usize = 12;

/// Report of one evaluation.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Direct {
    /// Facets that face both the Sun and the observer.
    pub facets: usize,
    /// Facets among them from which something was taken away.
    pub shadowed: usize,
    /// Pairs of a facet and an occluder looked at.
    pub occluder_tests: usize,
    /// Shadows that fell on a facet's outline.
    pub shadows: usize,
    /// Convex pieces that the shadowed facets fell into.
    pub pieces: usize,
    /// Spheres in closed form.
    pub spheres: usize,
    /// Cylinders, cones and dishes (from a point: spheres too) that nothing else shades or hides: integrals to 1e-9.
    pub round: usize,
    /// Curved parts that something shades or hides, divided into cells.
    pub refined: usize,
    /// Points at which a big mesh was sampled; 0 where its sum is exact.
    pub samples: usize,
    /// An estimate of the relative error of ΣW from sampling, rounding, touching tolerances, quadrature and cells of curved parts.
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
        /// Given value.
        value: DVec3,
    },
    /// Room for another number of weights.
    #[error("room for {found} weights, expected {expected}")]
    Room {
        /// Given value.
        found: usize,
        /// Required number.
        expected: usize,
    },
}

/// A scene with room to work in.
#[derive(Debug)]
pub struct Evaluator<'a> {
    pub(super) scene: &'a Scene,
    pub(super) now: Cow<'a, Geometry>,
    pub(super) angles: Vec<f64>,
    pub(super) radii: Vec<f64>,
    pub(super) work: Work,
    pub(super) near: near::Quadrature,
    pub(super) disc: super::disc::Room,
    pub(super) curves: Curves,
    /// Outlines of curved parts, towards the Sun and towards the observer.
    pub(super) outlines: [Vec<Outline>; 2],
    pub(super) large: large::Room,
    pub(super) errors: Vec<f64>,
    /// Number of first weights of each facet that sums leave out; empty where none are ([`Evaluator::leave_out`]).
    pub(super) apart: Vec<usize>,
    pub(super) rates: super::derivative::Room,
}

/// Buffers.
#[derive(Debug, Default)]
pub(super) struct Work {
    pub(super) grids: [Grid; 2],
    chosen: Vec<u32>,
    pub(super) shadows: Polygons,
    /// Occluder of each shadow, and whose it is: 0 the Sun's, 1 the observer's.
    pub(super) casters: Vec<(u32, u8)>,
    pieces: Polygons,
    next: Polygons,
    pub(super) kept: Polygons,
    room: Room,
    scratch: Scratch,
    /// How far a disc's shadows reach beyond those of its middle, m.
    pub(super) margin_m: f64,
    pub(super) shaded: bool,
    pub(super) done: Direct,
    /// Error of the area by the outlines of round bodies on the facet at hand, m².
    pub(super) outlines_m2: f64,
    watch: Watch,
}

/// Open parts of the facets towards one observer, kept while light comes from one direction after the other ([`Evaluator::watch`]).
#[derive(Debug, Default)]
struct Watch {
    watches: bool,
    observer: DVec3,
    facets: Vec<Option<Open>>,
}

/// Open part of a facet towards the observer.
#[derive(Debug, Clone)]
struct Open {
    /// Whether anything is taken away, and what is left then.
    cut: bool,
    pieces: Polygons,
    shadows: usize,
    outlines_m2: f64,
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
            disc: super::disc::Room::default(),
            curves: Curves::default(),
            outlines: [0, 1].map(|_| vec![Outline::default(); scene.rounds.len()]),
            large: large::Room::default(),
            errors: Vec::new(),
            apart: Vec::new(),
            rates: super::derivative::Room::default(),
        }
    }

    /// Sets the error at which the division of curved parts stops that something shades or hides, of what each would send alone (from
    /// 1e-9 to 1, in place of [`Scene::CURVED_TOLERANCE`]). The error that comes out is stated all the same.
    pub fn set_curved_tolerance(&mut self, tolerance: f64) {
        self.curves.tolerance = if tolerance > 1e-9 { tolerance.min(1.0) } else { 1e-9 };
    }

    /// Sets the relative error at which the quadrature over flat facets stops that are seen from a point, of each facet (from 1e-10, which is taken unless set,
    /// to 1e-2). The error that comes out is stated all the same.
    pub fn set_near_tolerance(&mut self, tolerance: f64) {
        let least = near::TOLERANCE;
        self.near.tolerance = if tolerance > least { tolerance.min(1e-2) } else { least };
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
        self.direct_from(sun_body, sun_body, view, out)
    }

    /// Computes the weights of [`Evaluator::direct`] for collimated light from another direction than the Sun's, to which hinged parts turn.
    ///
    /// # Errors
    /// The errors of [`Evaluator::direct`].
    pub fn direct_from(
        &mut self,
        light_body: DVec3,
        sun_body: DVec3,
        view: View,
        out: &mut [f64],
    ) -> Result<Direct, DirectionError> {
        self.check(out, self.scene.weight_count())?;
        self.sum(light_body, sun_body, view, 0, out)
    }

    /// Computes the weights of [`Evaluator::direct`], each part for itself: `out[part * weight_count + k]`.
    ///
    /// # Errors
    /// The errors of [`Evaluator::direct`], with room for [`Scene::part_count`] times [`Scene::weight_count`].
    pub fn direct_by_part(
        &mut self,
        sun_body: DVec3,
        view: View,
        out: &mut [f64],
    ) -> Result<Direct, DirectionError> {
        let stride = self.scene.weight_count();
        self.check(out, self.scene.part_count() * stride)?;
        self.sum(sun_body, sun_body, view, stride, out)
    }

    pub(super) fn check(&self, out: &[f64], expected: usize) -> Result<(), DirectionError> {
        let found = out.len();
        if found == expected { Ok(()) } else { Err(DirectionError::Room { found, expected }) }
    }

    pub(super) fn sum(
        &mut self,
        sun: DVec3,
        facing: DVec3,
        view: View,
        stride: usize,
        out: &mut [f64],
    ) -> Result<Direct, DirectionError> {
        out.fill(0.0);
        self.work.done = Direct::default();
        let (sun, eye) = self.aim(sun, facing, view)?;
        self.errors.clear();
        self.errors.resize(out.len(), 0.0);
        if let Toward::Far(to) = eye
            && let Some(done) = self.sampled(sun, to, stride, out)
        {
            return Ok(done);
        }
        self.sort(sun, eye);
        let mut error = 0.0;
        for i in 0..self.scene.facets.len() {
            let brought = match self.scene.facets[i].patch {
                None if !self.apart.is_empty() => self.rest_of_facet(i, sun, eye, stride, out),
                None => self.facet(i, sun, eye, stride, out),
                Some(patch) => self.bent(i, patch as usize, sun, eye, stride, out),
            };
            if brought > 0.0 {
                let facet = &self.scene.facets[i];
                let start = self.scene.weights_of(facet.material as usize).start;
                self.errors[facet.part as usize * stride + start] += brought;
                error += brought;
            }
        }
        error += self.rounds(Light { sun, eye }, stride, out);
        if self.scene.covers {
            let area: f64 = self.scene.facets.iter().map(|f| f.area).sum();
            let covering = COVERING * area * std::f64::consts::FRAC_1_PI;
            self.errors.iter_mut().for_each(|e| *e += covering);
            error += covering;
        }
        let total: f64 = out.iter().sum();
        let mut done = self.work.done;
        done.error = if total > 0.0 { error / total + 1e-15 } else { 0.0 };
        self.errors.fill(done.error * total);
        Ok(done)
    }

    /// Checks directions, turns hinges and sorts occluders for what follows.
    pub(super) fn stand(
        &mut self,
        light: DVec3,
        facing: DVec3,
        view: View,
    ) -> Result<(DVec3, Toward), DirectionError> {
        let (light, eye) = self.aim(light, facing, view)?;
        self.sort(light, eye);
        Ok((light, eye))
    }

    /// Checks directions and turns hinges.
    pub(super) fn aim(
        &mut self,
        light: DVec3,
        facing: DVec3,
        view: View,
    ) -> Result<(DVec3, Toward), DirectionError> {
        let facing = unit("the direction of the Sun", facing)?;
        let light = unit("the direction of the light", light)?;
        let eye = toward(view)?;
        self.turn(facing);
        Ok((light, eye))
    }

    /// Finds the outlines of what is curved and sorts occluders, for two directions.
    pub(super) fn sort(&mut self, light: DVec3, eye: Toward) {
        self.outline(light, eye);
        if self.scene.pairs.is_none() {
            self.index(light, eye);
        }
    }

    /// To be called before [`Evaluator::open`] for another direction.
    pub(super) fn prepare(&mut self, toward: Toward) {
        if let Toward::Far(d) = toward {
            self.outline(d, toward);
        }
        if self.scene.pairs.is_none()
            && let Toward::Far(d) = toward
        {
            self.index(d, toward);
        }
    }

    /// Returns the part of a facet that is open to one direction alone, in its own axes; `None` where nothing is taken away. Hinges stay as they are.
    pub(super) fn open(&mut self, facet: usize, toward: Toward) -> Option<&Polygons> {
        let (scene, work) = (self.scene, &mut self.work);
        if scene.report().no_occlusion {
            return None;
        }
        let sight = Sight { scene, now: &self.now, outlines: &self.outlines };
        work.shadows.clear();
        work.casters.clear();
        work.gather(&sight, facet, toward, 0);
        let touching = 1e-14 * scene.facets[facet].radius;
        let cut = !work.shadows.is_empty() && work.clip(scene.outlines.get(facet), touching);
        cut.then_some(&self.work.kept)
    }

    /// Begins (or ends) to keep what the observer sees of each facet, for light from many directions beside the same observer: sums find what hides facets from it once.
    pub(super) fn watch(&mut self, watches: bool) {
        self.work.watch.watches = watches;
        self.work.watch.facets.clear();
    }

    /// Turns hinged parts to the Sun.
    pub(super) fn turn(&mut self, sun: DVec3) {
        let scene = self.scene;
        for (h, hinge) in scene.hinges.iter().enumerate() {
            let angle = hinge.angle_rad(sun);
            if angle == self.angles[h] {
                continue;
            }
            self.angles[h] = angle;
            self.work.watch.facets.clear();
            let motion = Motion::about(hinge.point_m, hinge.axis, angle);
            let (base, now) = (&scene.geometry, self.now.to_mut());
            for (i, _) in scene.facets.iter().enumerate().filter(|f| f.1.group as usize == h + 1) {
                now.normal[i] = motion.vector(base.normal[i]);
                now.tangent[i] = motion.vector(base.tangent[i]);
                now.bitangent[i] = motion.vector(base.bitangent[i]);
                now.origin[i] = motion.point(base.origin[i]);
            }
            curved::turn(scene, now, h + 1, &motion);
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
    pub(super) fn index(&mut self, sun: DVec3, eye: Toward) {
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
    pub(super) fn facet(
        &mut self,
        i: usize,
        sun: DVec3,
        eye: Toward,
        stride: usize,
        out: &mut [f64],
    ) -> f64 {
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
        let sight = Sight { scene, now: &self.now, outlines: &self.outlines };
        let cut = match eye {
            Toward::Far(to) if self.work.watch.watches => {
                self.work.visible_again(&sight, i, [sun, to], outline)
            }
            _ => self.work.visible(&sight, i, sun, eye, outline),
        };
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
        let rounding = if cut { self.cut_rounding_m2(facet) } else { 0.0 };
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
                let mut weigh = |to: DVec3, scale: f64, out: &mut [f64]| {
                    material.add_weights(sun, to, scale * sun.z, out);
                };
                let mut task = near::Task {
                    weigh: &mut weigh,
                    tolerance: self.near.tolerance.max(material.grain()),
                    longest_m: f64::INFINITY,
                    smooth_m: near::smooth_m(near::width(&material.width()), sun, at),
                    at,
                    range_squared: q.length_squared(),
                    facet_area: facet.area,
                };
                if cut {
                    self.work.kept.iter().map(|p| self.near.add(&mut task, p, 1.0, out)).sum()
                } else {
                    self.near.add(&mut task, outline, 1.0, out)
                }
            }
        }
    }
}

impl Evaluator<'_> {
    /// Returns the error of the area of the facet that was cut last, m².
    pub(super) fn cut_rounding_m2(&self, facet: &Facet) -> f64 {
        let width = self.scene.touching_m.max(1e-15 * facet.radius);
        1e-15 * facet.area + 1e-4 * width * facet.radius + self.work.outlines_m2
    }
}

/// Whether a facet with this cosine towards a direction shows it its front.
pub(super) fn is_open(cos: f64) -> bool {
    cos > GRAZING
}

impl Work {
    /// Returns the part that [`Work::visible`] left of a facet from which something was taken.
    pub(super) fn kept(&self) -> &Polygons {
        &self.kept
    }

    /// Whether anything is taken away of facet `i`; what is left stands in `kept`.
    pub(super) fn visible(
        &mut self,
        sight: &Sight,
        i: usize,
        sun: DVec3,
        eye: Toward,
        outline: &[P2],
    ) -> bool {
        let scene = sight.scene;
        if scene.report().no_occlusion {
            return false;
        }
        self.begin();
        self.gather(sight, i, Toward::Far(sun), 0);
        self.shaded = !self.shadows.is_empty();
        // In opposition what is seen is what is lit.
        if !matches!(eye, Toward::Far(d) if d == sun) {
            self.gather(sight, i, eye, 1);
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

    /// The same as [`Work::visible`], where the observer's part of it may be known from another direction of the light. Leaves nothing in `shadows` and `casters` that is of use.
    fn visible_again(
        &mut self,
        sight: &Sight,
        i: usize,
        [sun, to]: [DVec3; 2],
        outline: &[P2],
    ) -> bool {
        let scene = sight.scene;
        if scene.report().no_occlusion {
            return false;
        }
        let touching = 1e-14 * scene.facets[i].radius;
        let watch = &mut self.watch;
        if watch.observer != to || watch.facets.len() != scene.facets.len() {
            watch.observer = to;
            watch.facets.clear();
            watch.facets.resize(scene.facets.len(), None);
        }
        let open = match self.watch.facets[i].take() {
            Some(open) => open,
            None => {
                self.begin();
                self.gather(sight, i, Toward::Far(to), 1);
                let cut = !self.shadows.is_empty() && self.clip(outline, touching);
                let pieces = if cut { self.kept.clone() } else { Polygons::default() };
                Open { cut, pieces, shadows: self.shadows.len(), outlines_m2: self.outlines_m2 }
            }
        };
        let cut = self.lit_of(&open, (sight, i), [sun, to], outline, touching);
        self.watch.facets[i] = Some(open);
        if cut {
            self.done.shadowed += 1;
            self.done.pieces += self.kept.len();
        }
        cut
    }

    /// Leaves in `kept` what is lit of a facet's open part; whether anything of the facet is missing.
    fn lit_of(
        &mut self,
        open: &Open,
        (sight, i): (&Sight, usize),
        [sun, to]: [DVec3; 2],
        outline: &[P2],
        touching: f64,
    ) -> bool {
        self.begin();
        // What is hidden anyway needs no light, and in opposition what is seen is what is lit.
        let hidden = open.cut && open.pieces.is_empty();
        if !hidden && sun != to {
            self.gather(sight, i, Toward::Far(sun), 0);
        }
        self.done.shadows += open.shadows + self.shadows.len();
        if self.shadows.len() > MANY {
            // They are shared out among parts of the facet: all of them.
            self.gather(sight, i, Toward::Far(to), 1);
            return self.clip(outline, touching);
        }
        self.outlines_m2 += open.outlines_m2;
        self.pieces.clear();
        if open.cut {
            open.pieces.iter().for_each(|piece| self.pieces.push(piece));
        } else {
            self.pieces.push(outline);
        }
        let mut cut = open.cut;
        for k in 0..self.shadows.len() {
            if self.pieces.is_empty() {
                break;
            }
            cut |= self.take(k, touching);
        }
        std::mem::swap(&mut self.kept, &mut self.pieces);
        cut
    }

    /// No shadows yet.
    fn begin(&mut self) {
        self.shadows.clear();
        self.casters.clear();
        self.outlines_m2 = 0.0;
    }

    /// Appends the shadows on a facet.
    fn gather(&mut self, sight: &Sight, i: usize, toward: Toward, grid: usize) {
        let (scene, now) = (sight.scene, sight.now);
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
        // Seen from a point, the shadow of a ball spreads with the distance.
        let plane = Plane::new(now, i, toward, scene.touching_m);
        let (b, m) = (clip::bounds(scene.outlines.get(i)), self.margin_m);
        let bounds = [b[0] - m, b[1] - m, b[2] + m, b[3] + m];
        for &k in candidates {
            let k = k as usize;
            let occluder = &scene.occluders[k];
            if occluder.component == facet.component && facet.convex {
                continue;
            }
            let away = now.middle[k] - origin;
            let across = curved::sight::misses(
                away,
                occluder.radius + self.margin_m,
                facet.radius,
                toward,
                origin,
            );
            if across || away.dot(now.normal[i]) + occluder.radius <= scene.touching_m {
                continue;
            }
            let added = sight.cast(k, &plane, toward, grid, &mut self.room, &mut self.shadows);
            if added {
                self.outlines_m2 += curved::outline::error_m2(occluder, &plane, toward);
                let last = self.shadows.len() - 1;
                if clip::overlap(&bounds, &clip::bounds(self.shadows.get(last))) {
                    self.casters.push((k as u32, grid as u8));
                } else {
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

#[cfg(test)]
mod tests {
    use crate::light::{Scene, View};
    use crate::target::Target;
    use glam::DVec3;

    /// Truth: the same sums without anything kept, which other tests hold against rays and closed forms. Tolerance: areas cut in another order, 1e-12. Observers and
    /// hinges change on the way, light comes from behind the observer and from the observer, too.
    #[test]
    fn what_is_kept_of_an_observers_view_changes_no_light() {
        for name in ["box_wing", "corner", "flying_laptop", "hexagon"] {
            let scene = Scene::new(&Target::built_in(name).unwrap()).unwrap();
            let (mut plain, mut watching) = (scene.evaluator(), scene.evaluator());
            let mut out = [vec![0.0; scene.weight_count()], vec![0.0; scene.weight_count()]];
            let direction = |k: usize| {
                let (z, turn) = (1.0 - (k as f64 * 0.754_877).fract() * 2.0, k as f64 * 2.4);
                let rho = (1.0 - z * z).sqrt();
                DVec3::new(rho * turn.cos(), rho * turn.sin(), z)
            };
            let (mut cut, mut lit) = (0, 0);
            for k in 0..40 {
                watching.watch(true);
                // Every other observer is another's place within one watch.
                for eye in [direction(3 * k), direction(3 * k + 1)] {
                    let sun = direction(k / 2 + 500);
                    let lights = (0..12).map(|j| direction(50 * k + j)).chain([eye, sun]);
                    for light in lights {
                        let view = View::Distant(eye);
                        let [a, b] = &mut out;
                        let one = plain.direct_from(light, sun, view, a).unwrap();
                        let other = watching.direct_from(light, sun, view, b).unwrap();
                        let most = a.iter().copied().fold(1e-3, f64::max);
                        for (a, b) in a.iter().zip(&*b) {
                            assert!((a - b).abs() <= 1e-12 * most, "{name} {light} {eye}: {a} {b}");
                        }
                        assert_eq!((one.facets, one.shadowed), (other.facets, other.shadowed));
                        cut += one.shadowed;
                        lit += one.facets;
                    }
                }
                watching.watch(false);
            }
            assert!(lit > 500 && (cut > 100 || name == "hexagon"), "{name} {lit} {cut}");
        }
    }
}
