//! Bodies and directions.

use glam::{DQuat, DVec2, DVec3};
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::light::{Derivation, Parameter, Scene, View};
use sunglint_simulator::mesh::shapes::{Side, cuboid, plate};
use sunglint_simulator::surface::{Distribution, Fresnel, Lobe, Masking, Material};
use sunglint_simulator::target::{Hinge, Part, Placement, Shape, Target};

pub type Rng = Xoshiro256PlusPlus;

pub fn rng(seed: u64) -> Rng {
    Rng::seed_from_u64(seed)
}

pub fn direction(rng: &mut Rng) -> DVec3 {
    loop {
        let v = DVec3::new(rng.random(), rng.random(), rng.random()) * 2.0 - 1.0;
        if (0.01..1.0).contains(&v.length_squared()) {
            return v.normalize();
        }
    }
}

/// Towards the Sun, and to an observer within 60° or so of it, so that something is seen.
pub fn directions(rng: &mut Rng) -> (DVec3, DVec3) {
    let sun = direction(rng);
    (sun, (sun + 0.9 * direction(rng)).normalize())
}

pub fn white() -> Material {
    Material::lambert("white", Spectrum::constant(1.0, 300.0, 1240.0).unwrap()).unwrap()
}

pub fn grey() -> Fresnel {
    Fresnel::constant(Spectrum::constant(0.5, 300.0, 1240.0).unwrap()).unwrap()
}

pub fn rough(distribution: Distribution, x: f64, y: f64, masking: Masking, f: Fresnel) -> Material {
    Material::microfacet("rough", Lobe::anisotropic(distribution, x, y, masking).unwrap(), f)
}

/// Adds a part with a material of its own.
pub fn add(target: &mut Target, shape: Shape, placement: Placement, material: Material) {
    let k = target.parts.len();
    target.materials.push(material);
    target.parts.push(Part {
        name: format!("p{k}"),
        shape,
        material: k,
        placement,
        hinge: None,
        tangent: DVec3::new(1.0, 0.3, 0.2),
    });
}

pub fn at(offset_m: DVec3) -> Placement {
    Placement { offset_m, ..Placement::default() }
}

pub fn boxed(size: DVec3) -> Shape {
    Shape::Mesh(cuboid(size, &Side::ALL))
}

pub fn sheet(size: DVec2) -> Shape {
    Shape::Mesh(plate(size, true, false))
}

/// A body, two wings about an axis with a box on one of them, a mast on a second hinge: all near enough to shade one another and touching
/// the planes of one another's faces.
pub fn winged(range_rad: Option<(f64, f64)>) -> Target {
    let mut target = Target::default();
    let tilt = DQuat::from_rotation_y(0.3);
    add(&mut target, boxed(DVec3::new(1.0, 1.0, 2.0)), at(DVec3::ZERO), white());
    for y in [1.6, -1.6] {
        add(&mut target, boxed(DVec3::new(0.02, 2.0, 1.2)), at(DVec3::new(0.1, y, 0.2)), white());
    }
    let leaning = Placement { rotation: tilt, offset_m: DVec3::new(0.3, 1.0, 0.3) };
    add(&mut target, boxed(DVec3::splat(0.3)), leaning, white());
    add(&mut target, boxed(DVec3::new(0.1, 0.1, 2.0)), at(DVec3::new(1.0, 0.8, 0.4)), white());
    let hinge = |name: &str, point_m, axis, face, range_rad| Hinge {
        name: name.into(),
        point_m,
        axis,
        face,
        range_rad,
    };
    target.hinges.push(hinge("a", DVec3::new(0.1, 0.0, 0.2), DVec3::Y, DVec3::X, range_rad));
    target.hinges.push(hinge("b", DVec3::new(0.8, 0.8, 0.0), DVec3::X, DVec3::Z, None));
    (1..=3).for_each(|k| target.parts[k].hinge = Some(0));
    target.parts[4].hinge = Some(1);
    target
}

/// Values and derivatives.
pub fn derive(
    scene: &Scene,
    sun: DVec3,
    view: View,
    parameters: &[Parameter],
) -> (Vec<f64>, Vec<f64>, Vec<f64>, Derivation) {
    let mut eye = scene.evaluator();
    let count = scene.weight_count();
    let (mut w, mut dw) = (vec![f64::NAN; count], vec![f64::NAN; count * parameters.len()]);
    let done = eye.direct_derivatives(sun, view, parameters, &mut w, &mut dw).unwrap();
    (w, dw, eye.derivative_errors().to_vec(), done)
}

pub fn direct(scene: &Scene, sun: DVec3, view: View) -> Vec<f64> {
    let mut out = vec![0.0; scene.weight_count()];
    scene.evaluator().direct(sun, view, &mut out).unwrap();
    out
}

pub const AXES: [DVec3; 3] = [DVec3::X, DVec3::Y, DVec3::Z];

/// Turns about three axes, the Sun's and the observer's direction along three.
pub fn all() -> Vec<Parameter> {
    let mut all: Vec<Parameter> = AXES.map(Parameter::Attitude).to_vec();
    all.extend(AXES.map(Parameter::Sun));
    all.extend(AXES.map(Parameter::Observer));
    all
}
