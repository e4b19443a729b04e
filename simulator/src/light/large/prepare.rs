//! A scene's facets, put in order, and how many points they take.

use super::cluster::{Kind, clusters};
use super::{
    FEWEST_FACETS, Found, Large, Look, MOST_POINTS, Ordered, Question, Room, Sampling, TRIAL_POINTS,
};
use crate::light::occlude;
use crate::light::scene::Scene;
use crate::light::weld;
use glam::DVec3;

/// Pairs of directions on which the number of points is tried.
const TRIALS: usize = 12;

/// Why a scene is summed exactly although it has a tolerance; `None` where it is sampled.
pub fn why_exact(scene: &Scene) -> Option<String> {
    let report = scene.report();
    if report.no_occlusion {
        Some("nothing hides anything, so every facet counts whole".into())
    } else if scene.facets.len() < FEWEST_FACETS {
        Some(format!("{} facets are fewer than {FEWEST_FACETS}", scene.facets.len()))
    } else if !scene.rounds.is_empty() {
        Some("curved parts stand among the meshes".into())
    } else if !scene.patches.is_empty() {
        Some("triangles are bent by their normals".into())
    } else {
        None
    }
}

impl Large {
    /// Prepares a scene that [`why_exact`] has nothing against; `None` where the tolerance takes too many points for most directions.
    pub fn new(scene: &Scene, tolerance: f64) -> Option<Self> {
        let sampling = Sampling { tolerance, points: TRIAL_POINTS };
        let mut large = Self::ordered(scene, sampling);
        large.sampling.points = large.points(scene)?;
        Some(large)
    }

    fn ordered(scene: &Scene, sampling: Sampling) -> Self {
        let now = &scene.geometry;
        let (mut low, mut high) = (DVec3::MAX, DVec3::MIN);
        for (facet, origin) in scene.facets.iter().zip(&now.origin) {
            low = low.min(*origin - facet.radius);
            high = high.max(*origin + facet.radius);
        }
        let centre = 0.5 * (low + high);
        let span = (high - low).max_element().max(f64::MIN_POSITIVE);
        let sheets = sheets(scene);
        let kind = |k: u32| {
            let facet = &scene.facets[k as usize];
            let sheet = sheets[facet.component as usize];
            Kind { part: facet.part, material: facet.material, group: facet.group, sheet }
        };
        let mut order: Vec<(u64, u32)> =
            (0..).zip(&now.origin).map(|(k, origin)| (morton((*origin - low) / span), k)).collect();
        // By the group first: only what moves together can share corners. A part has one group.
        order.sort_unstable_by_key(|&(place, k)| {
            let Kind { part, group, sheet, .. } = kind(k);
            (group, part, sheet, place, k)
        });
        let kinds: Vec<Kind> = order.iter().map(|o| kind(o.1)).collect();
        let mut large = Self {
            sampling,
            vertices: Vec::new(),
            centre,
            corners: Vec::new(),
            ends: Vec::with_capacity(order.len()),
            clusters: Vec::new(),
            balls: Vec::new(),
            facets: Vec::with_capacity(order.len()),
            looks: Vec::with_capacity(order.len()),
            jitter: super::jitter::Jitter::new(),
        };
        let mut balls = Vec::with_capacity(order.len());
        for group in order.chunk_by(|a, b| kind(a.1).group == kind(b.1).group) {
            large.add_group(scene, group, &mut balls);
        }
        let normals: Vec<DVec3> = large.facets.iter().map(|f| f.normal).collect();
        (large.clusters, large.balls) = clusters(&kinds, &normals, &balls);
        large
    }

    /// Adds facets that move together, and the balls that hold them.
    fn add_group(&mut self, scene: &Scene, order: &[(u64, u32)], balls: &mut Vec<(DVec3, f64)>) {
        let now = &scene.geometry;
        let mut points: Vec<DVec3> = Vec::new();
        for i in order.iter().map(|o| o.1 as usize) {
            let start = points.len();
            let place = |p: &[f64; 2]| {
                now.origin[i] + p[0] * now.tangent[i] + p[1] * now.bitangent[i] - self.centre
            };
            points.extend(scene.outlines.get(i).iter().map(place));
            let own = &points[start..];
            let (mut low, mut high) = (DVec3::MAX, DVec3::MIN);
            own.iter().for_each(|p| (low, high) = (low.min(*p), high.max(*p)));
            // In the facet's plane.
            let (middle, normal) = (0.5 * (low + high), now.normal[i]);
            let middle = middle - (middle - own[0]).dot(normal) * normal;
            let reach = own.iter().map(|p| p.distance(middle)).fold(0.0, f64::max);
            // Corners move when they are welded.
            balls.push((middle, reach + 2.0 * scene.touching_m));
            let facet = &scene.facets[i];
            self.facets.push(Ordered { normal, area: facet.area });
            self.looks.push(Look { tangent: now.tangent[i], radius: facet.radius });
            self.ends.push((self.corners.len() + points.len()) as u32);
        }
        let (numbers, places) = weld::weld(&points, scene.touching_m);
        let base = self.vertices.len() as u32;
        self.corners.extend(numbers.iter().map(|number| base + number));
        self.vertices.extend(places);
    }

    /// With how many points the tolerance is met from most directions.
    fn points(&self, scene: &Scene) -> Option<f64> {
        let mut room = Room::default();
        let (mut out, mut errors) =
            (vec![0.0; scene.weight_count()], vec![0.0; scene.weight_count()]);
        let angles = vec![0.0; scene.hinges.len()];
        let mut wanted = Vec::with_capacity(TRIALS);
        for trial in 0..TRIALS {
            let (sun, to) = directions(trial);
            let q = Question { scene, angles: &angles, sun, to, stride: 0 };
            let found: Option<Found> =
                self.with_points(&q, TRIAL_POINTS, &mut room, &mut out, &mut errors);
            let points = match found {
                Some(f) if f.error == 0.0 => TRIAL_POINTS,
                Some(f) if f.total > 0.0 => {
                    let excess = f.error / (self.sampling.tolerance * f.total);
                    TRIAL_POINTS * (1.1 * excess).powf(4.0 / 3.0)
                }
                _ => f64::INFINITY,
            };
            wanted.push(points);
        }
        wanted.sort_by(f64::total_cmp);
        let points = wanted[TRIALS * 2 / 3].max(256.0);
        (points <= MOST_POINTS).then_some(points)
    }
}

/// Directions at phase angles from 10° to 120° about a golden spiral.
pub(super) fn directions(trial: usize) -> (DVec3, DVec3) {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let z = 1.0 - (2.0 * trial as f64 + 1.0) / TRIALS as f64;
    let across = (1.0 - z * z).sqrt();
    let (sin, cos) = (golden * trial as f64).sin_cos();
    let sun = DVec3::new(across * cos, across * sin, z);
    let (x, y) = sun.any_orthonormal_pair();
    let (sin, cos) = (1.0 + golden * (trial * 7) as f64).sin_cos();
    let phase = (10.0 + 110.0 * ((trial * 5) % TRIALS) as f64 / TRIALS as f64).to_radians();
    (sun, phase.cos() * sun + phase.sin() * (cos * x + sin * y))
}

/// Which components hide with both sides.
fn sheets(scene: &Scene) -> Vec<bool> {
    let count = scene.facets.iter().map(|f| f.component as usize + 1).max().unwrap_or(0);
    let mut sheets = vec![false; count];
    for occluder in scene.occluders.iter().filter(|o| matches!(o.kind, occlude::Kind::Sheet)) {
        if let Some(sheet) = sheets.get_mut(occluder.component as usize) {
            *sheet = true;
        }
    }
    sheets
}

/// The bits of three coordinates from 0 to 1 in turn, 21 of each (Morton 1966).
fn morton(p: DVec3) -> u64 {
    let spread = |x: f64| {
        let mut v = (x * 2_097_151.0) as u64 & 0x1f_ffff;
        v = (v | (v << 32)) & 0x1f_0000_0000_ffff;
        v = (v | (v << 16)) & 0x1f_0000_ff00_00ff;
        v = (v | (v << 8)) & 0x100f_00f0_0f00_f00f;
        v = (v | (v << 4)) & 0x10c3_0c30_c30c_30c3;
        (v | (v << 2)) & 0x1249_2492_4924_9249
    };
    spread(p.x) | (spread(p.y) << 1) | (spread(p.z) << 2)
}
