//! Light that two diffuse surfaces scatter one after the other, where nothing can stand between them: exact.
//!
//! Under a distant Sun and before a distant observer the lit part of one surface and the seen part of another are polygons of one brightness. So what goes
//! from the one to the other is their exchange in closed form ([`form_factor`]): nothing depends on patches or rays. Patches keep all further scatterings, which
//! are weaker by as much as surfaces see of each other.

use super::form_factor;
use super::split::beyond;
use super::surfaces::{Outline, Surface, Surfaces};
use super::views::Shares;
use crate::light::clip::P2;
use crate::light::occlude::Toward;
use glam::DVec3;
use std::f64::consts::FRAC_1_PI;

/// Pairs of which each takes part in the other's hemisphere by less than this are left to patches.
const FAINT: f64 = 1e-4;

/// Pairs of diffuse surfaces that see each other without anything between.
#[derive(Debug, Clone, Default)]
pub struct Clear {
    pairs: Vec<Pair>,
    /// For each surface the number of its material among the diffuse ones.
    material: Vec<usize>,
    /// The diffuse materials.
    pub materials: Vec<usize>,
    surfaces: usize,
    /// Farthest point of any surface from the origin, m.
    reach_m: f64,
    /// For each two surfaces whether they are a pair.
    is_pair: Vec<bool>,
}

/// An observer at a point is as good as a distant one where the body reaches this much of the way to it at most.
const NEAR: f64 = 1e-4;
/// Error of cosines, directions and distances together that are taken to be the same all over a surface, in units of that part.
const UNEVEN: f64 = 4.0;

/// Two surfaces.
#[derive(Debug, Clone)]
struct Pair {
    surfaces: [usize; 2],
    /// The line of each beyond which it lies before the other, in its axes; `None` where all of it does.
    front: [Option<[f64; 3]>; 2],
    /// Area times form factor of all that each has before the other, m², and its error.
    whole: (f64, f64),
}

/// Light that clear pairs scatter twice: for each diffuse material that is seen and each that is lit, before both reflectances, m² sr⁻¹.
#[derive(Debug, Clone, Default)]
pub struct Twice {
    /// Whether clear pairs are counted here: not where the observer is very near.
    pub is_counted: bool,
    /// Relative error of light that is taken to be even over a surface.
    uneven: f64,
    pub light: Vec<f64>,
    pub error: Vec<f64>,
    rings: [Vec<Vec<DVec3>>; 2],
}

impl Clear {
    /// The clear pairs among some diffuse surfaces, at most so many: those that exchange most.
    pub fn new(surfaces: &Surfaces, diffuse: &[usize], touching_m: f64, most: usize) -> Self {
        let list = &surfaces.list;
        let mut clear = Self {
            material: vec![0; list.len()],
            surfaces: list.len(),
            reach_m: list.iter().map(|s| s.origin.length() + s.radius).fold(0.0, f64::max),
            is_pair: vec![false; list.len() * list.len()],
            ..Self::default()
        };
        for &k in diffuse {
            let material = list[k].material;
            let found = clear.materials.iter().position(|m| *m == material);
            clear.material[k] = found.unwrap_or_else(|| {
                clear.materials.push(material);
                clear.materials.len() - 1
            });
        }
        if most == 0 {
            return clear;
        }
        for (n, &a) in diffuse.iter().enumerate() {
            for &b in &diffuse[n + 1..] {
                clear.pairs.extend(pair(list, [a, b], touching_m));
            }
        }
        clear.pairs.sort_by(|a, b| b.whole.0.total_cmp(&a.whole.0));
        clear.pairs.truncate(most);
        for pair in &clear.pairs {
            let [a, b] = pair.surfaces;
            clear.is_pair[a * list.len() + b] = true;
            clear.is_pair[b * list.len() + a] = true;
        }
        clear
    }

    /// Whether there is any.
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// Whether two surfaces are one of the pairs.
    pub fn holds(&self, a: usize, b: usize) -> bool {
        self.is_pair[a * self.surfaces + b]
    }

    /// The number of a surface's material among the diffuse ones.
    pub fn material(&self, surface: usize) -> usize {
        self.material[surface]
    }

    /// Adds what comes from one direction, times `weight`.
    pub fn add(&self, surfaces: &Surfaces, [from, to]: [&Shares; 2], weight: f64, out: &mut Twice) {
        if !out.is_counted {
            return;
        }
        let count = self.materials.len();
        for pair in &self.pairs {
            for lit in [0, 1] {
                let (a, b) = (pair.surfaces[lit], pair.surfaces[1 - lit]);
                let bright = weight * from.facing[a] * to.facing[b];
                if bright == 0.0 {
                    continue;
                }
                let (exchanged, error) = if from.whole[a] && to.whole[b] {
                    pair.whole
                } else {
                    let [lit_rings, seen_rings] = &mut out.rings;
                    pair.rings(surfaces, lit, from, lit_rings);
                    pair.rings(surfaces, 1 - lit, to, seen_rings);
                    let mut sum = (0.0, 0.0);
                    for a in &*lit_rings {
                        for b in &*seen_rings {
                            let (light, apart) = form_factor::exchange(a, b);
                            sum = (sum.0 + light, sum.1 + apart);
                        }
                    }
                    sum
                };
                let at = self.material[b] * count + self.material[a];
                out.light[at] += FRAC_1_PI * bright * exchanged;
                out.error[at] += FRAC_1_PI * bright.abs() * (error + out.uneven * exchanged);
            }
        }
    }
}

impl Twice {
    /// Nothing yet, before an observer.
    pub fn clear(&mut self, clear: &Clear, eye: Toward) {
        let part = match eye {
            Toward::Far(_) => 0.0,
            Toward::Near(q) => clear.reach_m / q.length(),
        };
        self.is_counted = !clear.is_empty() && part <= NEAR;
        self.uneven = UNEVEN * part;
        let count = clear.materials.len() * clear.materials.len();
        for row in [&mut self.light, &mut self.error] {
            row.clear();
            row.resize(count, 0.0);
        }
    }
}

impl Pair {
    /// The open part of one of the two and lies before the other, in the body's axes.
    fn rings(&self, surfaces: &Surfaces, which: usize, shares: &Shares, out: &mut Vec<Vec<DVec3>>) {
        let number = self.surfaces[which];
        let surface = &surfaces.list[number];
        out.clear();
        let mut room = Vec::new();
        let mut push = |ring: &[P2]| {
            let ring = match self.front[which] {
                None => ring,
                Some(line) => {
                    beyond(ring, line, &mut room);
                    &room
                }
            };
            if ring.len() >= 3 {
                out.push(ring.iter().map(|p| surface.point(*p)).collect());
            }
        };
        if shares.whole[number] {
            push(corners(surface));
        } else {
            shares.open[number].iter().for_each(|ring| push(ring));
        }
    }
}

fn corners(surface: &Surface) -> &[P2] {
    match &surface.shape {
        Outline::Polygon(corners) => corners,
        Outline::Sphere => &[],
    }
}

/// Two surfaces, if they see each other and nothing can stand between.
fn pair(list: &[Surface], surfaces: [usize; 2], touching_m: f64) -> Option<Pair> {
    let [a, b] = surfaces.map(|k| &list[k]);
    if a.highest(b) <= touching_m || b.highest(a) <= touching_m {
        return None;
    }
    let mut front = [None; 2];
    let mut rings = [Vec::new(), Vec::new()];
    for (k, (own, other)) in [(a, b), (b, a)].into_iter().enumerate() {
        front[k] = before(own, other, touching_m);
        let mut ring = corners(own).to_vec();
        if let Some(line) = front[k] {
            beyond(corners(own), line, &mut ring);
        }
        if ring.len() < 3 {
            return None;
        }
        rings[k] = ring.iter().map(|p| own.point(*p)).collect::<Vec<DVec3>>();
    }
    let whole = form_factor::exchange(&rings[0], &rings[1]);
    if whole.0 <= FAINT * a.area.min(b.area) {
        return None;
    }
    let planes = hull(&rings, [a, b], touching_m);
    let blocks = |other: &Surface| {
        let apart = |(normal, height): &(DVec3, f64)| {
            let least = match other.shape {
                Outline::Sphere => other.origin.dot(*normal) - other.radius,
                Outline::Polygon(_) => {
                    other.corners().map(|p| p.dot(*normal)).fold(f64::INFINITY, f64::min)
                }
            };
            least >= height - touching_m
        };
        !planes.iter().any(apart)
    };
    let others = list.iter().enumerate().filter(|(k, _)| !surfaces.contains(k));
    if others.into_iter().any(|(_, other)| blocks(other)) {
        return None;
    }
    Some(Pair { surfaces, front, whole })
}

/// The line in a surface beyond which it lies before another's plane; `None` where all of it does.
fn before(own: &Surface, other: &Surface, touching_m: f64) -> Option<[f64; 3]> {
    let height = |p: DVec3| (p - other.origin).dot(other.normal);
    if own.corners().all(|p| height(p) >= -touching_m) {
        return None;
    }
    let (x, y) = (own.tangent.dot(other.normal), own.bitangent.dot(other.normal));
    let length = x.hypot(y);
    let at = (own.origin - other.origin).dot(other.normal);
    // In planes side by side heights do not differ: here nothing lies before.
    Some(if length > 0.0 { [x / length, y / length, at / length] } else { [0.0, 0.0, -1.0] })
}

/// Planes with both rings on one side: what lies on the other side of any of them does not stand between (normal away from the rings, height).
fn hull(rings: &[Vec<DVec3>; 2], surfaces: [&Surface; 2], touching_m: f64) -> Vec<(DVec3, f64)> {
    // What lies behind either surface.
    let mut planes: Vec<(DVec3, f64)> =
        surfaces.iter().map(|s| (-s.normal, -s.origin.dot(s.normal))).collect();
    for [ring, other] in [[&rings[0], &rings[1]], [&rings[1], &rings[0]]] {
        for k in 0..ring.len() {
            let (p, q) = (ring[k], ring[(k + 1) % ring.len()]);
            for r in other {
                let Some(normal) = (q - p).cross(*r - p).try_normalize() else { continue };
                for normal in [normal, -normal] {
                    let height = normal.dot(p);
                    let all = ring.iter().chain(other.iter());
                    if all.into_iter().all(|x| x.dot(normal) <= height + touching_m) {
                        planes.push((normal, height));
                    }
                }
            }
        }
    }
    planes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::Scene;
    use crate::mesh::shapes::{Side, cuboid};
    use crate::target::{Placement, Shape, Target};

    /// Cubes of 1 m at some heights, the second of another size.
    fn cubes(heights: &[(f64, f64)]) -> (Surfaces, f64) {
        let mut target = Target::built_in("corner").unwrap();
        target.parts.truncate(heights.len());
        for (part, (z, side)) in target.parts.iter_mut().zip(heights) {
            part.shape = Shape::Mesh(cuboid(DVec3::splat(*side), &Side::ALL));
            part.placement =
                Placement { offset_m: DVec3::new(0.0, 0.0, *z), ..Placement::default() };
        }
        let scene = Scene::new(&target).unwrap();
        (Surfaces::new(&scene), scene.touching_m)
    }

    /// Truth: two unit squares that face each other at 1 m exchange A F = 0.199 825 m² (Howell's catalogue, C-11). Nothing else of two cubes one above the other sees each
    /// other. With a small cube in between they are no clear pair any more, and its own faces above and below are.
    #[test]
    fn what_stands_between_makes_a_pair_no_clear_one() {
        let (surfaces, touching) = cubes(&[(0.0, 1.0), (2.0, 1.0)]);
        let all: Vec<usize> = (0..surfaces.list.len()).collect();
        let clear = Clear::new(&surfaces, &all, touching, 100);
        assert_eq!(clear.pairs.len(), 1);
        assert!((clear.pairs[0].whole.0 - 0.199_825).abs() < 1e-6, "{:?}", clear.pairs[0]);
        let (surfaces, touching) = cubes(&[(0.0, 1.0), (2.0, 1.0), (1.0, 0.2)]);
        let all: Vec<usize> = (0..surfaces.list.len()).collect();
        let clear = Clear::new(&surfaces, &all, touching, 100);
        let area = |k: usize| surfaces.list[k].area;
        assert_eq!(clear.pairs.len(), 2);
        for pair in &clear.pairs {
            let [a, b] = pair.surfaces.map(area);
            assert!((a.min(b) - 0.04).abs() < 1e-12 && (a.max(b) - 1.0).abs() < 1e-12);
        }
        assert!(Clear::new(&surfaces, &all, touching, 0).is_empty());
    }
}
