//! How much of a body's light falls on the body itself.

use crate::light::scene::Scene;
use glam::{DQuat, DVec3};
use std::f64::consts::{FRAC_1_PI, TAU};

/// Points times polygons that are looked at; above it a body that is not convex is taken to fill everything.
const MOST: usize = 4_000_000;
/// Angles of hinges that are looked at.
const ANGLES: usize = 12;
/// Directions of the Sun that are looked at.
const DIRECTIONS: usize = 64;

/// How much of what the facets of a body send falls on other facets, as fractions of the hemisphere weighted with the cosine: means over facets.
/// Occluders are ignored, so that the true fractions are no larger.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Fill {
    /// The largest of any facet.
    pub facet: f64,
    /// Fraction for the whole body under the Sun from where that is most, weighted by what each facet gets.
    pub body: f64,
}

impl Fill {
    /// Everything.
    const ALL: Self = Self { facet: 1.0, body: 1.0 };

    /// Looks at a scene. What is round beside other things may fill all that they see: whoever needs more has to look closer.
    pub(super) fn of(scene: &Scene) -> Self {
        if scene.report().no_occlusion {
            return Self::default();
        }
        if !scene.rounds.is_empty() {
            return Self::ALL;
        }
        let facets = scene.facets.len();
        let angles = if scene.hinges.is_empty() { 1 } else { ANGLES };
        let corners: usize = (0..facets).map(|i| scene.outlines.get(i).len()).sum();
        if (3 * corners).saturating_mul(facets) * angles > MOST {
            return Self::ALL;
        }
        (0..angles).fold(Self::default(), |most, angle| {
            let now = Self::at(scene, TAU * angle as f64 / angles as f64);
            Self { facet: most.facet.max(now.facet), body: most.body.max(now.body) }
        })
    }

    fn at(scene: &Scene, angle_rad: f64) -> Self {
        let placed: Vec<Placed> =
            (0..scene.facets.len()).map(|i| place(scene, i, angle_rad)).collect();
        let closed = scene.report().closed;
        let fills: Vec<f64> = placed
            .iter()
            .map(|facet| {
                let others = placed.iter().filter(|o| facet.may_see(o, scene.touching_m));
                facet.filled_by(&others.collect::<Vec<_>>(), closed)
            })
            .collect();
        let share = |sun: DVec3| {
            let (mut all, mut filled) = (0.0, 0.0);
            for ((facet, fill), placed) in scene.facets.iter().zip(&fills).zip(&placed) {
                let lit = facet.area * placed.normal.dot(sun).max(0.0);
                (all, filled) = (all + lit, filled + lit * fill);
            }
            if all > 0.0 { filled / all } else { 0.0 }
        };
        Self {
            facet: fills.iter().copied().fold(0.0, f64::max),
            body: directions().map(share).fold(0.0, f64::max),
        }
    }
}

/// Directions all over the sphere, along a golden spiral.
fn directions() -> impl Iterator<Item = DVec3> {
    (0..DIRECTIONS).map(|k| {
        let z: f64 = 1.0 - (2.0 * k as f64 + 1.0) / DIRECTIONS as f64;
        let (sin, cos) = (2.399_963_229_728_653 * k as f64).sin_cos();
        let across = (1.0 - z * z).sqrt();
        DVec3::new(across * cos, across * sin, z)
    })
}

/// A facet in its place.
struct Placed {
    corners: Vec<DVec3>,
    middle: DVec3,
    normal: DVec3,
    component: u32,
    convex: bool,
}

impl Placed {
    /// Whether another has a part above this one's plane.
    fn may_see(&self, other: &Self, touching_m: f64) -> bool {
        let above = |c: &DVec3| (*c - self.middle).dot(self.normal) > touching_m;
        !(self.convex && other.component == self.component) && other.corners.iter().any(above)
    }

    /// The mean over the facet of the fraction that others fill. Of closed bodies the sides that face a point count, which hide the others;
    /// so a point inside a body sees nothing of it.
    fn filled_by(&self, others: &[&Self], closed: bool) -> f64 {
        let n = self.corners.len();
        let (mut sum, mut area) = (0.0, 0.0);
        for k in 0..n {
            let [a, b, c] = [self.middle, self.corners[k], self.corners[(k + 1) % n]];
            let weight = (b - a).cross(c - a).length() / 3.0;
            for point in [(a, b, c), (b, c, a), (c, a, b)] {
                let point = (4.0 * point.0 + point.1 + point.2) / 6.0;
                let seen = others
                    .iter()
                    .filter(|o| !closed || (point - o.middle).dot(o.normal) > 0.0)
                    .map(|o| fraction(point, self.normal, &o.corners));
                sum += weight * seen.sum::<f64>().min(1.0);
                area += weight;
            }
        }
        if area > 0.0 { sum / area } else { 0.0 }
    }
}

fn place(scene: &Scene, i: usize, angle_rad: f64) -> Placed {
    let (facet, now) = (&scene.facets[i], &scene.geometry);
    let (rotation, point) = match facet.group {
        0 => (DQuat::IDENTITY, DVec3::ZERO),
        h => {
            let hinge = &scene.hinges[h as usize - 1];
            let angle = match hinge.range_rad {
                Some((least, most)) => least + (most - least) * angle_rad / TAU,
                None => angle_rad,
            };
            (DQuat::from_axis_angle(hinge.axis, angle), hinge.point_m)
        }
    };
    let turned = |p: DVec3| point + rotation * (p - point);
    let corners = scene.outlines.get(i).iter();
    let corner = |p: &[f64; 2]| now.origin[i] + p[0] * now.tangent[i] + p[1] * now.bitangent[i];
    let corners: Vec<DVec3> = corners.map(|p| turned(corner(p))).collect();
    let middle = corners.iter().sum::<DVec3>() / corners.len() as f64;
    let normal = rotation * now.normal[i];
    let (component, convex) = (facet.component, facet.convex);
    Placed { corners, middle, normal, component, convex }
}

/// The fraction of the hemisphere about `normal` at a point that a polygon fills, seen from either side (Lambert's formula), after what lies
/// below the horizon is cut off.
fn fraction(point: DVec3, normal: DVec3, corners: &[DVec3]) -> f64 {
    let mut above: Vec<DVec3> = Vec::with_capacity(corners.len() + 1);
    for (k, corner) in corners.iter().enumerate() {
        let (a, b) = (*corner - point, corners[(k + 1) % corners.len()] - point);
        let (za, zb) = (a.dot(normal), b.dot(normal));
        if za >= 0.0 {
            above.push(a);
        }
        if (za > 0.0 && zb < 0.0) || (za < 0.0 && zb > 0.0) {
            above.push(a + za / (za - zb) * (b - a));
        }
    }
    let n = above.len();
    let edge = |k: usize| {
        let (a, b) = (above[k], above[(k + 1) % n]);
        let cross = a.cross(b);
        let sine = cross.length();
        if sine > 0.0 { sine.atan2(a.dot(b)) / sine * cross.dot(normal) } else { 0.0 }
    };
    (0.5 * FRAC_1_PI * (0..n).map(edge).sum::<f64>()).abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::target::Target;

    /// Truth: from a point on the edge of a wall without end, square to the ground, the wall fills half of the sky; a disc of radius R at height h
    /// overhead R²/(R² + h²) (here a polygon of 720 corners). Tolerance: the size of the wall and the polygon, 1e-4.
    #[test]
    fn walls_and_ceilings_fill_what_their_formulas_say() {
        let wall = [(-1e4, 0.0), (1e4, 0.0), (1e4, 1e4), (-1e4, 1e4)];
        let wall: Vec<DVec3> = wall.iter().map(|(y, z)| DVec3::new(1e-6, *y, *z)).collect();
        assert!((fraction(DVec3::ZERO, DVec3::Z, &wall) - 0.5).abs() < 1e-4);
        let corner = |k: u32| {
            let (sin, cos) = (TAU * f64::from(k) / 720.0).sin_cos();
            DVec3::new(2.0 * cos, 2.0 * sin, 3.0)
        };
        let disc: Vec<DVec3> = (0..720).map(corner).collect();
        assert!((fraction(DVec3::ZERO, DVec3::Z, &disc) - 4.0 / 13.0).abs() < 1e-4);
        assert_eq!(fraction(DVec3::ZERO, -DVec3::Z, &disc), 0.0);
    }

    /// Truth: two unit squares that share an edge at a right angle exchange F = 0.20004 (Hottel 1931; Howell's catalogue C-14), so a face of
    /// three that meet in a corner has 0.40009; a convex body has none. Tolerance: 2e-2 for twelve points a face beside a common edge.
    #[test]
    fn a_corner_fills_two_fifths_and_a_convex_body_nothing() {
        let fill = |mesh: crate::mesh::Mesh| {
            let mut target = Target::built_in("lambert_sphere").unwrap();
            target.parts[0].shape = crate::target::Shape::Mesh(mesh);
            Fill::of(&Scene::new(&target).unwrap())
        };
        let points = [
            [0., 0., 0.],
            [1., 0., 0.],
            [1., 1., 0.],
            [0., 1., 0.],
            [0., 0., 1.],
            [1., 0., 1.],
            [0., 1., 1.],
        ];
        let quads = [[0, 1, 2, 3], [0, 4, 5, 1], [0, 3, 6, 4]];
        let corner = crate::mesh::Mesh {
            vertices: points.map(DVec3::from).to_vec(),
            triangles: quads
                .iter()
                .flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]])
                .collect(),
            ..crate::mesh::Mesh::default()
        };
        let found = fill(corner);
        assert!((found.facet - 0.40009).abs() < 2e-2, "{found:?}");
        use crate::mesh::shapes::{Side, cuboid};
        assert_eq!(fill(cuboid(DVec3::new(1.0, 2.0, 3.0), &Side::ALL)), Fill::default());
    }
}
