//! Change by the Sun's disc of what flat facets send, bounded by a few places of the disc.
//!
//! A facet's answer v = f cosθ_i is averaged over the disc; without the disc it is taken at the middle. Along an axis through the middle what is odd of v drops out of the average, so the change is
//! the average of s = ½ (v(+) + v(−)) − v(middle). Of a v that is quadratic over the disc it is ⟨x²⟩ (s_1 + s_2), with s_1 and s_2 at the limb on two axes and ⟨x²⟩ = 1/4.5 of the
//! darkened disc: ½ (|s_1| + |s_2|) is 2.25 times that, for what is not quadratic. Where the horizon cuts the disc it is |s_1| + |s_2|: with the middle on it a Lambert facet gets (2/3π) v(+), of which |s_1| ≥ ½ v(+) is 2.4 times.
//! The first axis goes towards what the facet mirrors, so that both are principal axes of a round lobe and never vanish together.
//!
//! A lobe may be narrower than that needs, and the places then say little of it. But v lies between 0 and what it is at the place that is nearest to the lobe's peak, and its average is no more than the light of a mirror
//! in the brightest of the disc: 1.25/(π sin²δ) of all that is reflected (reciprocity: ∫ f cosθ_i dω_i ≤ 1).

use super::body::{Body, Patch};
use crate::light::disc::average::{Bell, mirrored};
use crate::light::disc::cut::Disc;
use crate::light::scene::Scene;
use crate::surface::Width;
use glam::{DVec2, DVec3};
use std::f64::consts::PI;

/// Lobes are wide whose shortest length, in the disc's radii, is more than this. Then ½ (|s_1| + |s_2|) bounds the change: by a sum over the disc, 36,000 Beckmann and GGX lobes with peaks up to 40 radii away, round and
/// up to 4 times as long as wide, have changes of up to 0.55 of it.
const WIDE: f64 = 2.0;
/// The brightness of the disc's middle over its mean, at the exponent ½ of its law: (a + 2)/2.
const BRIGHTEST: f64 = 1.25;
/// Places on the limb among which the nearest to a peak is looked for.
const AROUND: u32 = 32;

/// Bounds of an epoch, with room to find them.
#[derive(Debug, Clone, Default)]
pub struct Change {
    /// For each weight of the scene the largest change, m² sr⁻¹.
    pub most: Vec<f64>,
    /// For each weight of the scene the light of the middle, with nothing hidden, m² sr⁻¹.
    pub light: Vec<f64>,
    places: [Vec<f64>; 6],
}

impl Change {
    /// Looks at the flat facets of a scene. Hidden ones count as if they were not.
    pub(super) fn look(
        &mut self,
        (scene, body): (&Scene, &Body),
        sun: DVec3,
        to: DVec3,
        radius_rad: f64,
    ) {
        for row in [&mut self.most, &mut self.light] {
            row.clear();
            row.resize(scene.weight_count(), 0.0);
        }
        let sine = radius_rad.sin();
        if sine <= 0.0 {
            return;
        }
        for patch in body.patches.iter().filter(|p| !p.bent) {
            self.patch((scene, body), patch, sun, to, sine);
        }
    }

    fn patch(
        &mut self,
        (scene, body): (&Scene, &Body),
        patch: &Patch,
        sun: DVec3,
        to: DVec3,
        sine: f64,
    ) {
        let mut normal = body.normal(patch, sun);
        let height = normal.dot(sun);
        if normal.dot(to) + patch.chord <= 0.0 || height + patch.chord + sine <= 0.0 {
            return;
        }
        let material = &scene.materials()[patch.material];
        let even = matches!(material.width(), Width::Even);
        if patch.chord > 0.0 && !even {
            normal = turned(normal, (sun + to).normalize_or_zero(), patch.chord);
        }
        let tangent = body.tangent(patch, sun);
        let u = (tangent - tangent.dot(normal) * normal)
            .try_normalize()
            .unwrap_or_else(|| normal.any_orthonormal_vector());
        let v = normal.cross(u);
        let local = |d: DVec3| DVec3::new(u.dot(d), v.dot(d), normal.dot(d));
        let (sun, to) = (local(sun), local(to));
        if to.z <= 0.0 {
            return;
        }
        let range = scene.weights_of(patch.material);
        let disc = Disc::new(sun, DVec3::new(-to.x, -to.y, to.z) - sun, sine);
        let mut at = |row: usize, place: DVec2| {
            let values = &mut self.places[row];
            values.clear();
            values.resize(range.len(), 0.0);
            let from = disc.direction(place);
            if from.z > 0.0 {
                material.add_weights(from, to, from.z, values);
            }
        };
        let sent_m2 = patch.area_m2 * to.z;
        at(0, DVec2::ZERO);
        // The cosine is linear over the disc; the horizon of facets that look nearly the same way is known from their areas.
        let open = even && (patch.chord > 0.0 || sun.z >= sine);
        if open {
            let light = self.light[range].iter_mut().zip(&self.places[0]);
            light.for_each(|(light, v)| *light += sent_m2 * v);
            return;
        }
        [DVec2::X, DVec2::NEG_X, DVec2::Y, DVec2::NEG_Y]
            .into_iter()
            .enumerate()
            .for_each(|(k, place)| at(k + 1, place));
        // How many of the weights are of a narrow lobe, and where on the disc that is brightest.
        let narrow = match material.width() {
            Width::Lobe { lobe, .. } => Bell::of(lobe, &disc, to)
                .filter(|bell| bell.scale() < WIDE)
                .map(|bell| (material.lobe_weights(), brightest(&bell), true)),
            Width::Other(width) => (width < WIDE * sine).then(|| {
                let peak = mirrored(&disc, to).unwrap_or(DVec2::X);
                (range.len(), peak.clamp_length_max(1.0), false)
            }),
            Width::Even | Width::Mirror(_) => None,
        };
        if let Some((_, place, _)) = narrow {
            at(5, place);
        }
        let value = |row: usize, k: usize| self.places[row][k];
        let lobe = narrow.map_or(0, |n| n.0);
        let peak = |k: usize| (1..6).map(|row| value(row, k)).fold(value(0, k), f64::max);
        let whole: f64 = (0..lobe).map(peak).sum();
        let mirror = BRIGHTEST / (PI * sine * sine);
        let cap = match narrow {
            Some((_, _, true)) if whole > mirror => mirror / whole,
            _ => 1.0,
        };
        let edge = if sun.z < sine { 1.0 } else { 0.5 };
        for k in 0..range.len() {
            let middle = value(0, k);
            let change = if k < lobe {
                middle.max(cap * peak(k) - middle)
            } else {
                let bend = |a: usize| (0.5 * (value(a, k) + value(a + 1, k)) - middle).abs();
                edge * (bend(1) + bend(3))
            };
            self.most[range.start + k] += sent_m2 * change;
            self.light[range.start + k] += sent_m2 * middle;
        }
    }
}

/// A normal, turned towards another direction by a chord at most.
fn turned(normal: DVec3, toward: DVec3, chord: f64) -> DVec3 {
    let across = toward - toward.dot(normal) * normal;
    let angle = 2.0 * (0.5 * chord).min(1.0).asin();
    let most = across.length().atan2(toward.dot(normal));
    if most <= angle {
        return toward;
    }
    let (sin, cos) = angle.sin_cos();
    cos * normal + sin * across.normalize_or_zero()
}

/// The place of the disc that is nearest to a lobe's peak, in the lobe's own widths.
fn brightest(bell: &Bell) -> DVec2 {
    if bell.peak.length_squared() <= 1.0 {
        return bell.peak;
    }
    let inverse = bell.axes.inverse();
    let limb = |angle: f64| DVec2::new(angle.cos(), angle.sin());
    let off = |angle: f64| (inverse * (limb(angle) - bell.peak)).length_squared();
    let step = 2.0 * PI / f64::from(AROUND);
    let start = bell.peak.y.atan2(bell.peak.x);
    let angles = (0..AROUND).map(|k| start + step * f64::from(k));
    let best = angles.min_by(|a, b| off(*a).total_cmp(&off(*b))).unwrap_or(start);
    // Halving about the best: a place that is off by ε costs ε² of the distance.
    let (mut low, mut high) = (best - step, best + step);
    for _ in 0..30 {
        let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        if off(a) < off(b) { high = b } else { low = a }
    }
    limb(0.5 * (low + high))
}
