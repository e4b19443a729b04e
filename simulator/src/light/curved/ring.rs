//! Integrals over parts of a zone that nothing else shades: arcs of each circle of latitude by their exact ends, then over the circles.
//!
//! Along a cylinder or a cone all circles are alike to a distant observer, so that one integral over azimuth is left.

use super::zone::{Half, Pole, Profile, Ring, Zone, crossings};
use crate::surface::{Material, Width};
use glam::{DQuat, DVec3};
use std::f64::consts::{PI, TAU};
use std::sync::LazyLock;
use sunglint_numerics::panels;

/// Halvings of a panel at most: an end of an arc that appears within a panel leaves a root, which gains a factor 2.8 each time.
const DEPTH: u32 = 24;
/// Rounding of a lobe, relative, over the square of its roughness.
const ROUNDING: f64 = 1e-13;
/// Panels at most of one integral over one variable.
const MOST_PANELS: usize = 2000;
/// Steps in which the parameters are looked for at which an arc appears.
const STEPS: usize = 12;
/// Gauss–Legendre rules for small cells (Abramowitz and Stegun, table 25.4).
const GAUSS_3: [(f64, f64); 3] =
    [(-0.774_596_669_241_483_4, 5.0 / 9.0), (0.0, 8.0 / 9.0), (0.774_596_669_241_483_4, 5.0 / 9.0)];
const GAUSS_5: [(f64, f64); 5] = [
    (-0.906_179_845_938_664, 0.236_926_885_056_189_08),
    (-0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
    (0.0, 128.0 / 225.0),
    (0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
    (0.906_179_845_938_664, 0.236_926_885_056_189_08),
];
/// Rules for whole zones.
static FINE: LazyLock<[Vec<(f64, f64)>; 2]> =
    LazyLock::new(|| [1, 2].map(|order| panels::panel(-1.0, 1.0, order).collect()));
/// Widths below which the material's lobe may lie: panels shrink towards it, radians.
const NARROW: [f64; 3] = [0.4, 0.08, 0.016];
/// The sine of an angle below which a lobe lies on the axis: far above rounding, far below the narrowest lobe.
const ON_AXIS: f64 = 1e-9;

/// Integral to compute, in the part's axes.
#[derive(Debug)]
pub struct Task<'a> {
    /// The side of the zone.
    pub zone: Zone,
    /// The material.
    pub material: &'a Material,
    /// The part's tangent.
    pub tangent: DVec3,
    /// Towards the Sun.
    pub sun: DVec3,
    /// To the observer.
    pub eye: Pole,
    /// The square of the observer's distance from the body's origin, m²; not used for one far away.
    pub range_squared: f64,
    /// Half-spaces that the part's own shape leaves open.
    pub halves: Vec<Half>,
    /// Half-way between the Sun and the observer, where the surface mirrors the one to the other as far as that is known.
    bisector: DVec3,
    /// Relative error at which panels are no longer halved.
    pub precision: f64,
    /// Reference of the precision where the integral is less: this times the area, sr⁻¹.
    pub floor: f64,
}

/// A part of a zone: between two azimuths and two parameters.
#[derive(Debug, Clone, Copy)]
pub struct Cell {
    /// Azimuths, radians.
    pub(crate) azimuth: [f64; 2],
    /// The profile's parameters.
    pub(crate) t: [f64; 2],
}

impl<'a> Task<'a> {
    /// `None` where the zone hides all of itself.
    pub fn new(
        zone: Zone,
        material: &'a Material,
        tangent: DVec3,
        sun: DVec3,
        eye: Pole,
        range_squared: f64,
    ) -> Option<Self> {
        let mut halves: Vec<Half> = zone.halves(Pole::Far(sun))?.into_iter().flatten().collect();
        halves.extend(zone.halves(eye)?.into_iter().flatten());
        // What a narrow lobe makes of the rounding of its cosines does not get less by halving panels.
        let rounding = match material.width() {
            Width::Lobe { lobe, .. } => ROUNDING / lobe.narrowest().powi(2),
            _ => 0.0,
        };
        let precision = rounding.clamp(1e-9, 1e-5);
        let floor = 0.0;
        let bisector = bisector(&zone, sun, eye);
        Some(Self {
            zone,
            material,
            tangent,
            sun,
            eye,
            range_squared,
            halves,
            bisector,
            precision,
            floor,
        })
    }

    /// The whole zone.
    pub fn whole(&self) -> Cell {
        Cell { azimuth: [0.0, TAU], t: [self.zone.from, self.zone.to] }
    }

    /// Adds `scale` times the integrand per area of surface at an azimuth of a circle, without asking for what the zone hides.
    pub fn point(&self, ring: &Ring, azimuth: f64, scale: f64, out: &mut [f64]) {
        let (sin, cos) = azimuth.sin_cos();
        let length = (ring.dr * ring.dr + ring.dz * ring.dz).sqrt();
        let (across, up) = (ring.dz / length, -ring.dr / length);
        let normal = self.zone.sign() * DVec3::new(across * cos, across * sin, up);
        let cos_i = normal.dot(self.sun);
        if cos_i <= 0.0 {
            return;
        }
        let (to, nearness) = match self.eye {
            Pole::Far(d) => (d, 1.0),
            Pole::Near(q) => {
                let away = q - DVec3::new(ring.r * cos, ring.r * sin, ring.z);
                let square = away.length_squared();
                (away / square.sqrt(), self.range_squared / square)
            }
        };
        let cos_o = normal.dot(to);
        if cos_o <= 0.0 {
            return;
        }
        let scale = scale * cos_i * cos_o * nearness;
        let x = tangent(self.tangent, normal);
        let y = normal.cross(x);
        let local = |d: DVec3, cos: f64| DVec3::new(d.dot(x), d.dot(y), cos);
        self.material.add_weights(local(self.sun, cos_i), local(to, cos_o), scale, out);
    }

    /// Adds ∫ w cosθ_i cosθ_o dA over what the zone leaves of a cell of itself; gives the error estimate of the sum.
    pub fn cell(&self, cell: &Cell, out: &mut [f64]) -> f64 {
        let [from, to] = cell.t;
        if let (Profile::Line { .. }, Pole::Far(_)) = (self.zone.profile, self.eye) {
            // All circles are alike but for their radius, which is that of the middle in the mean.
            let ring = self.zone.profile.at(0.5 * (from + to));
            return self.ring(&ring, cell.azimuth, to - from, out);
        }
        let mut breaks = self.breaks(from, to);
        if !self.material.is_lambert() {
            let steepest = self.specular_parameter();
            breaks.extend([steepest, steepest - 0.1 * (to - from), steepest + 0.1 * (to - from)]);
            breaks.retain(|t| (from..=to).contains(t));
        }
        breaks.sort_by(f64::total_cmp);
        breaks.dedup_by(|a, b| *a - *b <= 1e-12 * (to - from));
        let floor = self.floor * self.zone.area(from, to, cell.azimuth[1] - cell.azimuth[0]);
        let mut error = 0.0;
        for pair in breaks.windows(2) {
            // An arc appears as a root of the parameter: t = u²(3 − 2u) makes it smooth at both ends.
            let width = pair[1] - pair[0];
            error += self.adaptive(
                vec![0.0, 1.0],
                [0.0, 1.0],
                [self.precision, floor],
                out,
                &mut |u, w, sum| {
                    let ring = self.zone.profile.at(pair[0] + width * u * u * (3.0 - 2.0 * u));
                    self.ring(&ring, cell.azimuth, w * width * 6.0 * u * (1.0 - u), sum);
                },
            );
        }
        error
    }

    /// Where arcs begin, end or come to meet, between two parameters.
    fn breaks(&self, from: f64, to: f64) -> Vec<f64> {
        let mut breaks = vec![from, to];
        for (k, half) in self.halves.iter().enumerate() {
            let spare = |t: f64| {
                let ring = self.zone.profile.at(t);
                let amplitude = ring.r * half.normal.x.hypot(half.normal.y);
                amplitude - (half.normal.z * ring.z + half.offset).abs()
            };
            let steps = if self.floor > 0.0 { 2 } else { STEPS };
            let at = |n: usize| from + (to - from) * n as f64 / steps as f64;
            for n in 0..steps {
                let (mut low, mut high) = (at(n), at(n + 1));
                let first = spare(low) > 0.0;
                if first == (spare(high) > 0.0) {
                    continue;
                }
                for _ in 0..48 {
                    let middle = 0.5 * (low + high);
                    if (spare(middle) > 0.0) == first { low = middle } else { high = middle }
                }
                breaks.push(0.5 * (low + high));
            }
            for other in &self.halves[..k] {
                breaks.extend(self.zone.meets(half, other));
            }
        }
        breaks.retain(|t| (from..=to).contains(t));
        breaks
    }

    /// The parameter at which the normal, in its meridian, leans as the bisector of Sun and observer.
    fn specular_parameter(&self) -> f64 {
        let half = self.zone.sign() * self.bisector;
        let across = half.x.hypot(half.y);
        match self.zone.profile {
            Profile::Line { .. } => self.zone.from,
            Profile::Arc { .. } => across.atan2(-half.z),
            Profile::Parabola { focus } if half.z < 0.0 => 2.0 * focus * across / -half.z,
            Profile::Parabola { .. } => self.zone.from,
        }
    }

    /// Adds `scale` times the integral along a circle between two azimuths, per parameter.
    fn ring(&self, ring: &Ring, azimuth: [f64; 2], scale: f64, out: &mut [f64]) -> f64 {
        let [from, to] = azimuth;
        let mut stops = vec![from, to];
        for half in &self.halves {
            crossings(half, ring, from, &mut stops);
        }
        if !self.material.is_lambert() {
            let half = self.zone.sign() * self.bisector;
            // Circles about the lobe's own axis are alike all around.
            if half.x.hypot(half.y) > ON_AXIS {
                let middle = half.y.atan2(half.x);
                let near = NARROW.iter().flat_map(|a| [-a, *a]).chain([0.0]);
                stops.extend(near.map(|a| from + (middle + a - from).rem_euclid(TAU)));
            }
        }
        let scale = scale * ring.r * ring.dr.hypot(ring.dz);
        // What is left of its error must not look like the shape of what is integrated over it.
        let floor = self.floor * scale.abs() * (to - from);
        let precision = [(0.03 * self.precision).max(1e-12), floor];
        self.adaptive(stops, azimuth, precision, out, &mut |azimuth, weight, sum| {
            let (sin, cos) = azimuth.sin_cos();
            let p = DVec3::new(ring.r * cos, ring.r * sin, ring.z);
            // Between two stops all points are alike; those of the ends do not come here.
            if self.halves.iter().all(|half| half.at(p) > 0.0) {
                self.point(ring, azimuth, scale * weight, sum);
            }
        })
    }

    /// Gauss–Legendre over panels between stops, halved until two orders agree.
    fn adaptive(
        &self,
        mut stops: Vec<f64>,
        [from, to]: [f64; 2],
        [precision, floor]: [f64; 2],
        out: &mut [f64],
        f: &mut dyn FnMut(f64, f64, &mut [f64]),
    ) -> f64 {
        stops.retain(|s| (from..=to).contains(s));
        stops.sort_by(f64::total_cmp);
        stops.dedup_by(|a, b| *a - *b <= 1e-13 * (to - from));
        let count = out.len();
        let mut sums = vec![0.0; 2 * count];
        let mut open: Vec<(f64, f64, u32)> =
            stops.windows(2).rev().map(|w| (w[0], w[1], 0)).collect();
        let mut size: f64 = out.iter().map(|o| o.abs()).sum::<f64>().max(floor);
        let (mut error, mut panels) = (0.0, 0);
        let orders: [&[_]; 2] = if self.precision < 1e-8 || self.floor == 0.0 {
            FINE.each_ref().map(|r| &r[..])
        } else {
            [&GAUSS_3, &GAUSS_5]
        };
        while let Some((a, b, depth)) = open.pop() {
            sums.fill(0.0);
            let (low, high) = sums.split_at_mut(count);
            let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
            panels += 1;
            orders[1].iter().for_each(|(x, w)| f(middle + half * x, half * w, high));
            if high.iter().all(|h| *h == 0.0) && depth > 0 {
                continue;
            }
            orders[0].iter().for_each(|(x, w)| f(middle + half * x, half * w, low));
            let here: f64 = high.iter().map(|h| h.abs()).sum();
            let apart: f64 = low.iter().zip(high.iter()).map(|(l, h)| (l - h).abs()).sum();
            let limit = precision * here.max(size * (b - a) / (to - from));
            let enough = depth == DEPTH || panels >= MOST_PANELS;
            if apart <= limit || apart <= 0.01 * precision * size || enough {
                out.iter_mut().zip(high).for_each(|(o, h)| *o += *h);
                size += here;
                // The higher order is closer by far than the two are to each other, where they agree at all.
                error += if enough { apart } else { 0.1 * apart };
            } else {
                open.push((middle, b, depth + 1));
                open.push((a, middle, depth + 1));
            }
        }
        error
    }
}

/// Half-way between Sun and observer, seen from the middle of a zone; where a ball's outside mirrors the Sun to a point near by, from there: as many lobes are narrow as
/// the two differ, and panels are laid about it.
fn bisector(zone: &Zone, sun: DVec3, eye: Pole) -> DVec3 {
    if let (Profile::Arc { radius, middle }, Pole::Near(q), true) =
        (zone.profile, eye, zone.outward)
    {
        let away = q - DVec3::new(0.0, 0.0, middle);
        let (to, distance) = (away.normalize_or_zero(), away.length());
        let phase = to.angle_between(sun);
        let across = (sun - sun.dot(to) * to).normalize_or_zero();
        // The angle of the normal from the line to the observer: it mirrors where the angles on both of its sides are alike.
        let (mut low, mut high) = (0.0, phase);
        for _ in 0..40 {
            let t = 0.5 * (low + high);
            let out = (distance * t.sin()).atan2(distance * t.cos() - radius);
            if out > phase - t { high = t } else { low = t }
        }
        let (sin, cos) = (0.5 * (low + high)).sin_cos();
        return cos * to + sin * across;
    }
    let middle = zone.profile.at(0.5 * (zone.from + zone.to)).z;
    (sun + eye.from(DVec3::new(0.0, 0.0, middle))).normalize_or_zero()
}

/// Adds the weights of a sphere of 1 m at a phase angle for an observer at a distance from its middle, m, times the square of that; gives the relative error.
pub fn add_near_ball(material: &Material, phase: f64, distance: f64, out: &mut [f64]) -> f64 {
    let profile = Profile::Arc { radius: 1.0, middle: 0.0 };
    let zone = Zone { profile, from: 0.0, to: PI, outward: true };
    // A ball has any axis: that through the point that mirrors the Sun to the observer, about which the lobe is round.
    let (sun, eye) = (DVec3::new(phase.cos(), phase.sin(), 0.0), distance * DVec3::X);
    let turn = DQuat::from_rotation_arc(bisector(&zone, sun, Pole::Near(eye)), DVec3::Z);
    let (sun, eye) = (turn * sun, Pole::Near(turn * eye));
    let Some(task) = Task::new(zone, material, DVec3::X, sun, eye, distance * distance) else {
        return 0.0;
    };
    let mut own = vec![0.0; out.len()];
    let error = task.cell(&task.whole(), &mut own);
    out.iter_mut().zip(&own).for_each(|(o, w)| *o += w);
    let sum: f64 = own.iter().map(|w| w.abs()).sum();
    // Rounding: of the sum, and of where arcs end.
    1e-11 + if sum > 0.0 { (error + 1e-15 * zone.area(0.0, PI, TAU)) / sum } else { 0.0 }
}

/// A tangent in the plane across a normal: the part's, or the next of its axes where that stands on it.
fn tangent(wanted: DVec3, normal: DVec3) -> DVec3 {
    let in_plane = |axis: DVec3| axis - axis.dot(normal) * normal;
    let axes = [wanted, DVec3::X, DVec3::Y].map(in_plane);
    let chosen = axes.into_iter().find(|a| a.length_squared() > 1e-12).unwrap_or(axes[0]);
    chosen.normalize_or_zero()
}
