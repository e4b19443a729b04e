//! Random scenes of random materials.

use glam::{DQuat, DVec3};
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::f64::consts::TAU;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::light::{Globe, View};
use sunglint_simulator::mesh::shapes::{Side, cuboid};
use sunglint_simulator::surface::{Distribution, Fresnel, Lobe, Masking, Material};
use sunglint_simulator::target::{Hinge, Part, Placement, Shape, Target};

pub type Rng = Xoshiro256PlusPlus;

/// Paint of a part: its reflectance and its lobe, `None` for a Lambert surface.
#[derive(Debug, Clone, Copy)]
pub struct Paint {
    pub reflectance: f64,
    pub lobe: Option<(Distribution, f64)>,
}

/// A scene: a target with the paints of its parts, and who lights and sees it.
pub struct RandomScene {
    pub target: Target,
    pub paints: Vec<Paint>,
    pub sun: DVec3,
    pub view: View,
    pub earth: Option<Globe>,
    pub sun_radius_rad: f64,
}

pub fn direction(rng: &mut Rng) -> DVec3 {
    let z = 2.0 * rng.random::<f64>() - 1.0;
    let (sin, cos) = (TAU * rng.random::<f64>()).sin_cos();
    let across = (1.0 - z * z).sqrt();
    DVec3::new(across * cos, across * sin, z)
}

/// One to five boxes, turned, perhaps reaching into each other, every third scene with concave bodies; a sphere among them in every fourth, a panel on a
/// hinge in every fifth; the Earth below convex bodies and every second other, the observer 3 to 300 m away in every sixth. Two paints of five are diffuse, the others shine.
pub fn scene(seed: u64) -> RandomScene {
    let mut rng = Rng::seed_from_u64(seed);
    let (mut target, mut paints) = (Target::default(), Vec::new());
    for k in 0..1 + (seed % 5) as usize {
        let size = DVec3::new(rng.random(), rng.random(), rng.random()) + 0.1;
        let mut mesh = cuboid(size, &Side::ALL);
        if seed.is_multiple_of(3) {
            mesh.vertices.iter_mut().filter(|v| v.min_element() > 0.0).for_each(|v| *v *= 0.1);
        }
        let placement = Placement {
            rotation: DQuat::from_axis_angle(direction(&mut rng), rng.random::<f64>() * TAU),
            offset_m: 0.9 * direction(&mut rng) * rng.random::<f64>(),
        };
        let shape = if k == 0 && seed % 4 == 1 {
            Shape::Sphere { radius_m: 0.1 + 0.4 * rng.random::<f64>() }
        } else {
            Shape::Mesh(mesh)
        };
        add(&mut target, &mut paints, shape, placement, &mut rng);
    }
    if seed % 5 == 2 {
        let panel = Shape::Mesh(cuboid(DVec3::new(0.9, 0.5, 0.03), &Side::ALL));
        let offset_m = 0.8 * direction(&mut rng);
        let rotation = DQuat::from_axis_angle(direction(&mut rng), rng.random::<f64>() * TAU);
        add(&mut target, &mut paints, panel, Placement { rotation, offset_m }, &mut rng);
        let (axis, face) = (rotation * DVec3::X, rotation * DVec3::Z);
        let hinge = Hinge { name: "h".into(), point_m: offset_m, axis, face, range_rad: None };
        target.hinges.push(hinge);
        target.parts.last_mut().unwrap().hinge = Some(0);
    }
    let sun = direction(&mut rng);
    let to = (sun + 1.2 * direction(&mut rng)).normalize();
    let view = if seed % 6 == 4 {
        View::At(3.0 * 100.0_f64.powf(rng.random()) * to)
    } else {
        View::Distant(to)
    };
    let convex = target.parts.len() == 1 && !seed.is_multiple_of(3);
    let earth = (convex || seed.is_multiple_of(2)).then(|| below(sun, &mut rng));
    RandomScene { target, paints, sun, view, earth, sun_radius_rad: 4.65e-3 }
}

/// A part of a material of its own.
fn add(
    target: &mut Target,
    paints: &mut Vec<Paint>,
    shape: Shape,
    placement: Placement,
    rng: &mut Rng,
) {
    let k = paints.len();
    let reflectance = 0.05 + 0.85 * rng.random::<f64>();
    let lobe = rng.random_bool(0.6).then(|| {
        let beckmann = rng.random_bool(0.5);
        let distribution = if beckmann { Distribution::Beckmann } else { Distribution::Ggx };
        (distribution, 0.07 * 9.0_f64.powf(rng.random()))
    });
    let spectrum = Spectrum::constant(reflectance, 300.0, 1240.0).unwrap();
    target.materials.push(match lobe {
        None => Material::lambert(format!("m{k}"), spectrum).unwrap(),
        Some((distribution, alpha)) => {
            let lobe = Lobe::isotropic(distribution, alpha, Masking::Separable).unwrap();
            Material::microfacet(format!("m{k}"), lobe, Fresnel::constant(spectrum).unwrap())
        }
    });
    paints.push(Paint { reflectance, lobe });
    let (name, tangent) = (format!("p{k}"), DVec3::X);
    target.parts.push(Part { name, shape, material: k, placement, hinge: None, tangent });
}

/// The Earth from 400 to 2,000 km height, not before the Sun.
fn below(sun: DVec3, rng: &mut Rng) -> Globe {
    let radius_m = 6.371e6;
    let distance_m = radius_m + 4e5 * 5.0_f64.powf(rng.random());
    loop {
        let toward = direction(rng);
        if toward.angle_between(sun) > (radius_m / distance_m).asin() + 0.05 {
            return Globe { toward, distance_m, radius_m, sun, to_ground: glam::DQuat::IDENTITY };
        }
    }
}
