//! Materials of all kinds, against differences of their exact sums.

use super::bodies::*;
use glam::{DVec2, DVec3};
use sunglint_radiometry::spectrum::{Reflectance, Spectrum};
use sunglint_simulator::light::{Parameter, Roughness, Scene, View};
use sunglint_simulator::surface::{
    ComplexIndex, Distribution, Fresnel, Gloss, Lobe, Masking, Material, WardForm,
};
use sunglint_simulator::target::{Part, Placement, Shape, Target};

fn half() -> Spectrum<Reflectance> {
    Spectrum::constant(0.5, 300.0, 1240.0).unwrap()
}

fn schlick() -> Fresnel {
    Fresnel::schlick(half()).unwrap()
}

fn metal() -> Fresnel {
    Fresnel::conductor(&ComplexIndex::named("aluminium").unwrap()).unwrap()
}

/// One part of a material.
fn one(shape: Shape, material: Material) -> Target {
    let mut target = Target::default();
    target.materials.push(material);
    let placement = Placement::default();
    let tangent = DVec3::new(1.0, 0.3, 0.0);
    target.parts.push(Part {
        name: "it".into(),
        shape,
        material: 0,
        placement,
        hinge: None,
        tangent,
    });
    target
}

/// The fourth-order derivative of a function at 0 by four values.
fn fourth(f: &mut dyn FnMut(f64) -> Vec<f64>, h: f64) -> Vec<f64> {
    let v = [f(h), f(-h), f(2.0 * h), f(-2.0 * h)];
    let one = |k: usize| (8.0 * (v[0][k] - v[1][k]) - (v[2][k] - v[3][k])) / (12.0 * h);
    (0..v[0].len()).map(one).collect()
}

/// Truth: differences of the sum by the Sun's and the observer's direction (fourth order, 2e-4 rad: 1e-9), for every kind of law. 1e-6 of
/// the largest derivative, or the error that is stated where the law itself is differentiated numerically.
#[test]
fn laws_by_direction() {
    let ward = Gloss::Ward { alpha_x: 0.2, alpha_y: 0.3, form: WardForm::Bounded };
    let coat = Lobe::isotropic(Distribution::Ggx, 0.2, Masking::Separable).unwrap();
    let materials = [
        rough(Distribution::Beckmann, 0.2, 0.4, Masking::Separable, grey()),
        rough(Distribution::Beckmann, 0.3, 0.1, Masking::HeightCorrelated, metal()),
        rough(Distribution::Ggx, 0.5, 0.1, Masking::HeightCorrelated, schlick()),
        rough(Distribution::Ggx, 0.3, 0.3, Masking::Separable, metal()),
        Material::blend("paint", half(), coat, schlick()).unwrap(),
        Material::glossy("phong", Gloss::Phong { exponent: 20.0 }, half(), None).unwrap(),
        Material::glossy("ward", ward, half(), Some(half())).unwrap(),
    ];
    for material in materials {
        let name = material.describe();
        let scene = Scene::new(&one(sheet(DVec2::ONE), material)).unwrap();
        for seed in 0..20 {
            let mut rng = rng(seed);
            let lift = |d: DVec3| (d + 1.3 * DVec3::Z).normalize();
            let (sun, to) = (lift(direction(&mut rng)), lift(direction(&mut rng)));
            let (_, dw, errors, _) = derive(&scene, sun, View::Distant(to), &all());
            let largest = dw.iter().fold(1e-3_f64, |a, b| a.max(b.abs()));
            let count = scene.weight_count();
            for (j, axis) in AXES.into_iter().enumerate() {
                let across = |d: DVec3| axis - axis.dot(d) * d;
                let by_sun =
                    fourth(&mut |x| direct(&scene, sun + x * across(sun), View::Distant(to)), 2e-4);
                let by_view =
                    fourth(&mut |x| direct(&scene, sun, View::Distant(to + x * across(to))), 2e-4);
                for (p, truth) in [(3 + j, by_sun), (6 + j, by_view)] {
                    for (found, truth) in dw[p * count..].iter().zip(&truth) {
                        let off = (found - truth).abs();
                        assert!(
                            off < 1e-6 * largest || off < errors[p],
                            "{name} {seed}: {found} for {truth}, {:.1e} stated",
                            errors[p]
                        );
                    }
                    assert!(errors[p] < 1e-3 * largest, "{name} {seed}: {:.1e}", errors[p]);
                }
            }
        }
    }
}

/// Truth: differences of the sum between scenes of other roughnesses (fourth order, steps of 1e-3 α: 1e-9). A plate with two roughnesses,
/// a sphere with one. 1e-7 of the derivative and the error that is stated.
#[test]
fn roughness() {
    let sun = DVec3::new(0.2, 0.4, 1.0).normalize();
    let view = View::Distant(DVec3::new(0.3, -0.5, 0.8).normalize());
    for distribution in [Distribution::Beckmann, Distribution::Ggx] {
        for masking in [Masking::Separable, Masking::HeightCorrelated] {
            let kinds = [
                (Roughness::Along, [1.0, 0.0], false),
                (Roughness::Across, [0.0, 1.0], false),
                (Roughness::Alpha, [1.0, 1.0], false),
                (Roughness::Alpha, [1.0, 1.0], true),
            ];
            for (of, share, sphere) in kinds {
                let (x, y) = if sphere { (0.25, 0.25) } else { (0.2, 0.35) };
                let make = |d: f64| {
                    let material =
                        rough(distribution, x + d * share[0], y + d * share[1], masking, schlick());
                    let shape =
                        if sphere { Shape::Sphere { radius_m: 1.0 } } else { sheet(DVec2::ONE) };
                    Scene::new(&one(shape, material)).unwrap()
                };
                let truth = fourth(&mut |d| direct(&make(d), sun, view), 1e-3 * x);
                let parameter = Parameter::Roughness { material: 0, of };
                let (_, dw, errors, _) = derive(&make(0.0), sun, view, &[parameter]);
                for (found, truth) in dw.iter().zip(&truth) {
                    let limit = 1e-7 * (truth.abs() + 1e-3) + errors[0];
                    assert!((found - truth).abs() < limit, "{of:?} {sphere}: {found} for {truth}");
                }
                assert!(errors[0] < 1e-5, "{:.1e}", errors[0]);
            }
        }
    }
}

/// Truth: differences of a rough sphere's sum by the phase angle (fourth order, 1e-3 rad), and the error that is stated.
#[test]
fn rough_sphere() {
    let material = rough(Distribution::Ggx, 0.3, 0.3, Masking::Separable, metal());
    let scene = Scene::new(&one(Shape::Sphere { radius_m: 0.7 }, material)).unwrap();
    for phase in [0.2, 1.0, 2.4] {
        let at = |x: f64| DVec3::new(f64::cos(phase + x), f64::sin(phase + x), 0.0);
        let truth = fourth(&mut |x| direct(&scene, DVec3::X, View::Distant(at(x))), 1e-3);
        let along = DVec3::new(-at(0.0).y, at(0.0).x, 0.0);
        let parameters = [Parameter::Observer(along)];
        let (_, dw, errors, _) = derive(&scene, DVec3::X, View::Distant(at(0.0)), &parameters);
        for (found, truth) in dw.iter().zip(&truth) {
            let off = (found - truth).abs();
            assert!(
                off < 1e-6 && off < errors[0] + 1e-7,
                "{found} for {truth} ± {:.1e}",
                errors[0]
            );
        }
    }
}
