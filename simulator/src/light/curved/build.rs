//! Curved parts on their way into a scene.

use super::Round;
use super::outline::{CORNERS, Form};
use super::zone::{Profile, Zone};
use crate::light::facets::Polygon;
use crate::mesh::Mesh;
use crate::target::{Curved, DishForm, Part, Shape, Target, cap_radius_m};
use glam::{DQuat, DVec3};
use std::f64::consts::{PI, TAU};

/// Facets of a dish that hides what stands within it: around and along.
const DISH_FACETS: [usize; 2] = [64, 12];

/// Result of building a curved part.
pub struct Made {
    /// Itself, with its ball.
    pub round: Round,
    /// Flat faces of the part, in the body's axes.
    pub ends: Vec<Polygon>,
    /// Sheets that stand for it as an occluder, in the body's axes, where its outline does not do.
    pub sheets: Vec<Vec<DVec3>>,
    /// Whether it is a closed convex body.
    pub closed: bool,
}

/// The curved part of a number; `None` for meshes.
pub fn make(target: &Target, number: usize, component: usize, touching_m: f64) -> Option<Made> {
    let part = &target.parts[number];
    let mut made = Made {
        round: Round {
            zones: Vec::new(),
            sphere: None,
            outline: None,
            material: part.material as u32,
            part: number as u32,
            component: component as u32,
            group: part.hinge.map_or(0, |h| h + 1),
            tangent: part.tangent,
            middle: DVec3::ZERO,
            radius: 0.0,
        },
        ends: Vec::new(),
        sheets: Vec::new(),
        closed: true,
    };
    match part.shape {
        Shape::Mesh(_) => return None,
        Shape::Sphere { radius_m: radius } => {
            let profile = Profile::Arc { radius, middle: 0.0 };
            made.round.zones.push(Zone { profile, from: 0.0, to: PI, outward: true });
            made.round.sphere = Some(radius);
            made.round.radius = radius;
        }
        Shape::Curved(Curved::Frustum { bottom_radius_m, top_radius_m, height_m }) => {
            frustum(&mut made, part, number, [bottom_radius_m, top_radius_m], height_m);
        }
        Shape::Curved(Curved::Dish { radius_m, depth_m, form, inside, outside }) => {
            let profile = match form {
                DishForm::Paraboloid => {
                    Profile::Parabola { focus: radius_m * radius_m / (4.0 * depth_m) }
                }
                DishForm::Sphere => {
                    let radius = cap_radius_m(radius_m, depth_m);
                    Profile::Arc { radius, middle: radius }
                }
            };
            let to = profile.parameter(radius_m, depth_m);
            let zone = |outward| Zone { profile, from: 0.0, to, outward };
            let wanted = [(outside, true), (inside, false)];
            made.round.zones.extend(wanted.iter().filter(|w| w.0).map(|w| zone(w.1)));
            made.round.middle = DVec3::new(0.0, 0.0, 0.5 * depth_m);
            made.round.radius = radius_m.hypot(0.5 * depth_m);
            made.closed = false;
            if is_clear(target, number, radius_m, depth_m, touching_m) {
                made.round.outline = Some(Form::new(zone(true), true));
            } else {
                made.sheets = sheets(part, &zone(true));
            }
        }
    }
    Some(made)
}

/// Returns the fault in the sizes of a curved shape: the size at fault, its value in m, the values that are allowed.
pub fn fault(shape: &Curved) -> Option<(&'static str, f64, &'static str)> {
    let positive = |what, value: f64| {
        (!(value > 0.0 && value.is_finite())).then_some((what, value, "more than 0"))
    };
    let least = |what, value: f64| {
        (!(value >= 0.0 && value.is_finite())).then_some((what, value, "0 or more"))
    };
    match *shape {
        Curved::Frustum { bottom_radius_m, top_radius_m, height_m } => {
            least("the bottom radius", bottom_radius_m)
                .or(least("the top radius", top_radius_m))
                .or(positive("the larger radius", bottom_radius_m.max(top_radius_m)))
                .or(positive("the height", height_m))
        }
        Curved::Dish { radius_m, depth_m, form, .. } => {
            let deep = form == DishForm::Sphere && depth_m > radius_m;
            positive("the radius", radius_m)
                .or(positive("the depth", depth_m))
                .or(deep.then_some(("the depth", depth_m, "at most the radius: half a sphere")))
        }
    }
}

/// The normals of each triangle that is bent, turned, and how many triangles have some that look to their other side.
pub fn bends(mesh: &Mesh, rotation: DQuat) -> (Vec<Option<[DVec3; 3]>>, usize) {
    if mesh.normals.is_empty() {
        return (vec![None; mesh.triangles.len()], 0);
    }
    let mut wrong = 0;
    let bends = (0..mesh.triangles.len()).map(|t| {
        let flat = mesh.normal(t)?;
        // Where there is none, the triangle's own.
        let normals = mesh.triangles[t].map(|k| mesh.normals[k as usize].normalize_or(flat));
        if normals.iter().any(|n| n.dot(flat) <= 0.0) {
            wrong += 1;
            return None;
        }
        let bent = normals.iter().any(|n| n.distance(flat) > 1e-9);
        bent.then(|| normals.map(|n| rotation * n))
    });
    (bends.collect(), wrong)
}

fn frustum(made: &mut Made, part: &Part, number: usize, [low, high]: [f64; 2], height: f64) {
    let profile = Profile::Line { radius: 0.5 * (low + high), slope: (high - low) / height };
    let half = 0.5 * height;
    let zone = Zone { profile, from: -half, to: half, outward: true };
    made.round.zones.push(zone);
    made.round.radius = half.hypot(low.max(high));
    made.round.outline = Some(Form::new(zone, false));
    for (radius, z, sign) in [(low, -half, -1.0), (high, half, 1.0)] {
        if radius == 0.0 {
            continue;
        }
        let step = TAU / CORNERS as f64;
        // The area of the circle.
        let r = radius * (step / step.sin()).sqrt();
        let corner = |k: usize| {
            let (sin, cos) = (sign * step * k as f64).sin_cos();
            part.placement.point(DVec3::new(r * cos, r * sin, z))
        };
        let corners = (0..CORNERS).map(corner).collect();
        made.ends.extend(Polygon::new(corners, number, made.round.component as usize));
    }
}

/// Whether no other part reaches into a dish's bounding box: then no light begins between the bowl and its mouth but on the bowl, and it hides as
/// if it were full.
fn is_clear(target: &Target, number: usize, radius_m: f64, depth_m: f64, touching_m: f64) -> bool {
    let dish = &target.parts[number];
    // The box in the part's axes, a little smaller: what touches does not reach in.
    let slack = 4.0 * touching_m;
    let least = DVec3::new(-radius_m, -radius_m, 0.0) + slack;
    let most = DVec3::new(radius_m, radius_m, depth_m) - slack;
    let reaches = |low: DVec3, high: DVec3| low.cmplt(most).all() && high.cmpgt(least).all();
    target.parts.iter().enumerate().filter(|(k, _)| *k != number).all(|(_, part)| {
        if part.hinge != dish.hinge {
            // It may come anywhere about its axis.
            return !may_meet(target, dish, part, radius_m.hypot(depth_m));
        }
        let back = dish.placement.rotation.inverse();
        let local = |p: DVec3| back * (part.placement.point(p) - dish.placement.offset_m);
        match &part.shape {
            Shape::Mesh(mesh) => mesh.faces().all(|corners| {
                let [a, b, c] = corners.map(local);
                !reaches(a.min(b).min(c), a.max(b).max(c))
            }),
            Shape::Sphere { radius_m } => {
                let middle = local(DVec3::ZERO);
                !reaches(middle - *radius_m, middle + *radius_m)
            }
            Shape::Curved(curved) => {
                let half = 0.5 * curved.size_m();
                let corners = (0..8).map(|k| {
                    let sign = |bit: u32| if k & bit == 0 { -1.0 } else { 1.0 };
                    let corner = half * DVec3::new(sign(1), sign(2), sign(4));
                    local(corner + DVec3::new(0.0, 0.0, curved.middle_m()))
                });
                let (low, high) = corners
                    .fold((DVec3::MAX, DVec3::MIN), |(low, high), p| (low.min(p), high.max(p)));
                !reaches(low, high)
            }
        }
    })
}

/// Whether two parts that turn against each other could come together: by balls about the hinge's point.
fn may_meet(target: &Target, dish: &Part, other: &Part, reach_m: f64) -> bool {
    let pivot = other.hinge.or(dish.hinge).map_or(DVec3::ZERO, |h| target.hinges[h].point_m);
    let extent = |p: DVec3| other.placement.point(p).distance(pivot);
    let (nearest, farthest) = match &other.shape {
        Shape::Mesh(mesh) => {
            let farthest = mesh.faces().flatten().map(extent).fold(0.0, f64::max);
            (0.0, farthest)
        }
        Shape::Sphere { radius_m } => {
            (extent(DVec3::ZERO) - radius_m, extent(DVec3::ZERO) + radius_m)
        }
        Shape::Curved(curved) => {
            let radius = 0.5 * curved.size_m().length() + curved.middle_m();
            (extent(DVec3::ZERO) - radius, extent(DVec3::ZERO) + radius)
        }
    };
    let away = dish.placement.offset_m.distance(pivot);
    away - reach_m < farthest && away + reach_m > nearest
}

/// A dish as flat sheets, in the body's axes.
fn sheets(part: &Part, zone: &Zone) -> Vec<Vec<DVec3>> {
    let [around, along] = DISH_FACETS;
    let at = |i: usize, j: usize| {
        let t = zone.from + (zone.to - zone.from) * j as f64 / along as f64;
        part.placement.point(zone.point(t, TAU * i as f64 / around as f64))
    };
    let mut sheets = Vec::with_capacity(around * along);
    for i in 0..around {
        for j in 0..along {
            let mut corners = vec![at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            if j == 0 {
                corners.remove(1);
            }
            sheets.push(corners);
        }
    }
    sheets
}
