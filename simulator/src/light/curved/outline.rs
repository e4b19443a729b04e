//! How a cylinder, a cone or a dish hides what is behind it: by its outline from where the light comes.
//!
//! The outline of a convex body of revolution is made of parts of its two rims and of two straight lines between them (a dish: its rim and
//! the curve along which its outside turns away). Where the lines leave the rims is exact, so that the width is; the rims are polygons whose
//! corners stand a little outside, for the area of the round ones: 256 corners deviate by 5e-5 of the radius, with the mean 0.

use super::zone::{Half, Pole, Zone, crossings};
use crate::light::geometry::Motion;
use crate::light::occlude::{Kind, Occluder, Plane, Toward};
use glam::DVec3;
use std::f64::consts::TAU;

/// Corners around a rim.
pub const CORNERS: usize = 256;
/// Points of each half of the curve along which a dish turns away.
const TURNS: usize = 96;

/// Occluding form: a zone seen from outside, between plane rims.
#[derive(Debug, Clone)]
pub struct Form {
    /// The outside.
    pub zone: Zone,
    /// Whether it is a dish: its lower rim is a point, and the profile is curved.
    pub dish: bool,
    /// Edges between the corners of [`Outline::solid`].
    pub edges: Vec<(u16, u16)>,
}

/// The outline of one body in one direction, body axes, m.
#[derive(Debug, Clone, Default)]
pub struct Outline {
    /// Corners whose hull it is.
    pub ring: Vec<DVec3>,
    /// Corners of the body, for planes that cut it.
    pub solid: Vec<DVec3>,
}

impl Form {
    /// Creates the form of the outside of a zone.
    pub fn new(zone: Zone, dish: bool) -> Self {
        let n = CORNERS as u16;
        let mut edges: Vec<(u16, u16)> = Vec::new();
        let rims: &[u16] = if dish { &[0] } else { &[0, n] };
        for first in rims {
            edges.extend((0..n).map(|k| (first + k, first + (k + 1) % n)));
        }
        if dish {
            // The curve runs from the rim to its lowest point and back to the rim.
            edges.extend((n..n + 2 * TURNS as u16 - 1).map(|k| (k, k + 1)));
        } else {
            edges.extend((0..n).map(|k| (k, n + k)));
        }
        Self { zone, dish, edges }
    }

    /// The outline towards the Sun or an observer.
    pub fn outline(&self, place: &Motion, toward: Toward, out: &mut Outline) {
        out.ring.clear();
        out.solid.clear();
        let inverse = place.rotation.inverse();
        let pole = match toward {
            Toward::Far(d) => Pole::Far(inverse * d),
            Toward::Near(q) => Pole::Near(inverse * (q - place.offset_m)),
        };
        let Some([Some(half), _]) = self.zone.halves(pole) else { return };
        if self.dish {
            self.bowl(&half, place, out);
        } else {
            self.frustum(&half, pole, place, out);
        }
    }

    fn frustum(&self, half: &Half, pole: Pole, place: &Motion, out: &mut Outline) {
        let rims = [self.zone.to, self.zone.from].map(|t| self.zone.profile.at(t));
        let wide = if rims[0].r > rims[1].r { rims[0] } else { rims[1] };
        let mut turns = Vec::new();
        crossings(half, &wide, 0.0, &mut turns);
        // The azimuths between which the side is seen; all or nothing where it does not turn away.
        let seen_at = |azimuth: f64| {
            half.at(DVec3::new(wide.r * azimuth.cos(), wide.r * azimuth.sin(), wide.z)) > 0.0
        };
        let arcs = match turns[..] {
            [a, b] => {
                let (a, b) = (a.min(b), a.max(b));
                let arcs = [(a, b - a), (b, TAU - (b - a))];
                if seen_at(0.5 * (a + b)) { arcs } else { [arcs[1], arcs[0]] }
            }
            _ if seen_at(0.0) => [(0.0, TAU), (0.0, 0.0)],
            _ => [(0.0, 0.0), (0.0, TAU)],
        };
        for (rim, sign) in rims.iter().zip([1.0, -1.0]) {
            let above = match pole {
                Pole::Far(d) => sign * d.z > 0.0,
                Pole::Near(q) => sign * (q.z - rim.z) > 0.0,
            };
            // From before an end its far half is the outline, from behind the near one.
            let chosen = usize::from(above);
            let points = |(start, width): (f64, f64), count: usize, to: &mut Vec<DVec3>| {
                let step = width / count as f64;
                let factor = if step > 0.0 { (step / step.sin()).sqrt() } else { 1.0 };
                let whole = width == TAU;
                for k in 0..count + usize::from(!whole) {
                    let (sin, cos) = (start + step * k as f64).sin_cos();
                    let r = if !whole && (k == 0 || k == count) { rim.r } else { rim.r * factor };
                    to.push(place.point(DVec3::new(r * cos, r * sin, rim.z)));
                }
            };
            if rim.r == 0.0 {
                out.ring.push(place.point(DVec3::new(0.0, 0.0, rim.z)));
            } else if arcs[chosen].1 > 0.0 {
                let whole = arcs[chosen].1 == TAU;
                let count = if whole { CORNERS } else { CORNERS / 2 };
                points(arcs[chosen], count, &mut out.ring);
            }
            if arcs[0].1 == TAU || arcs[1].1 == TAU {
                points((0.0, TAU), CORNERS, &mut out.solid);
            } else {
                for arc in arcs {
                    points(arc, CORNERS / 2, &mut out.solid);
                    // The arc's end is the next one's beginning.
                    out.solid.pop();
                }
            }
        }
    }

    fn bowl(&self, half: &Half, place: &Motion, out: &mut Outline) {
        let rim = self.zone.profile.at(self.zone.to);
        let step = TAU / CORNERS as f64;
        let r = rim.r * (step / step.sin()).sqrt();
        for k in 0..CORNERS {
            let (sin, cos) = (step * k as f64).sin_cos();
            out.ring.push(place.point(DVec3::new(r * cos, r * sin, rim.z)));
        }
        // Where the curve is lowest.
        let turns_away = |t: f64| {
            let mut found = Vec::new();
            crossings(half, &self.zone.profile.at(t), 0.0, &mut found);
            found
        };
        let mut curve = Vec::new();
        if turns_away(self.zone.to).len() == 2 {
            let (mut low, mut high) = (self.zone.from, self.zone.to);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if turns_away(middle).len() == 2 { high = middle } else { low = middle }
            }
            let at = |t: f64, which: usize| {
                let found = turns_away(t);
                self.zone.point(t, found.get(which).copied().unwrap_or_default())
            };
            // Even steps across the curve's axis.
            let across = self.zone.to * self.zone.to - high * high;
            let t = |k: usize| (high * high + across * (k as f64 / TURNS as f64).powi(2)).sqrt();
            curve.extend((1..=TURNS).rev().map(|k| at(t(k), 0)));
            curve.extend((1..=TURNS).map(|k| at(t(k), 1)));
        }
        // As many corners whatever the direction.
        let rest = self.zone.point(self.zone.to, 0.0);
        curve.resize(2 * TURNS, rest);
        out.ring.extend(curve.iter().map(|p| place.point(*p)));
        out.solid.clone_from(&out.ring);
    }
}

/// How far the area of an occluder's shadow on a plane may be off where its outline is round, m².
pub fn error_m2(occluder: &Occluder, plane: &Plane, toward: Toward) -> f64 {
    let share = match occluder.kind {
        Kind::Sphere => 2e-6,
        // The curve of a dish is a polygon within it.
        Kind::Outline(_) => 3e-5,
        _ => return 0.0,
    };
    let lean = plane.cos(toward).max(1e-3);
    share * occluder.radius * occluder.radius / lean
}
