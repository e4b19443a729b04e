//! Consequences of every law: drawn directions, spheres, widths.

use crate::materials::laws;
use crate::materials::{direction, flat, hemisphere};
use std::f64::consts::PI;
use sunglint_simulator::surface::{
    CookTorranceLobe, Distribution, Fresnel, Gloss, Lobe, Masking, Material, WardForm,
};

fn everything() -> Vec<Material> {
    let mut all = laws::all();
    let beckmann = Lobe::anisotropic(Distribution::Beckmann, 0.3, 0.6, Masking::Separable).unwrap();
    let ggx = Lobe::isotropic(Distribution::Ggx, 0.4, Masking::HeightCorrelated).unwrap();
    let one = Fresnel::constant(flat(1.0)).unwrap();
    all.push(Material::lambert("white", flat(0.8)).unwrap());
    all.push(Material::microfacet("beckmann", beckmann, one.clone()));
    all.push(Material::microfacet("ggx", ggx, one));
    let coat = Fresnel::schlick(flat(0.04)).unwrap();
    all.push(Material::blend("paint", flat(0.8), ggx, coat).unwrap());
    all
}

/// Truth: a density integrates to the share of draws that are not lost below the horizon, and the mean of f cosθ/density is the albedo, both by the midpoint rule.
/// Tolerance: 400 × 400 draws and 600 × 1200 directions: 3e-3.
#[test]
fn directions_are_drawn_with_the_density_that_is_said() {
    for material in everything() {
        for theta in [15.0, 65.0] {
            let i = direction(theta, 40.0);
            let n = 400;
            let (mut hits, mut mean) = (0.0, 0.0);
            for a in 0..n {
                for b in 0..n {
                    let u =
                        [(f64::from(a) + 0.5) / f64::from(n), (f64::from(b) + 0.5) / f64::from(n)];
                    let Some(drawn) = material.sample(i, u) else { continue };
                    let o = drawn.direction;
                    assert!((o.length() - 1.0).abs() < 1e-9 && o.z > 0.0);
                    let density = material.sampling_density_per_sr(i, o);
                    assert!((density / drawn.density_per_sr - 1.0).abs() < 1e-9);
                    hits += 1.0;
                    mean += material.brdf(500.0, i, o) * o.z / density;
                }
            }
            let all = f64::from(n * n);
            let whole = hemisphere(600, |o| material.sampling_density_per_sr(i, o) / o.z);
            let albedo = hemisphere(600, |o| material.brdf(500.0, i, o));
            let what = material.describe();
            assert!((hits / all - whole).abs() < 3e-3, "{what} {theta}: {} {whole}", hits / all);
            let error = mean / all / albedo - 1.0;
            assert!(error.abs() < 3e-3, "{what} {theta}: {} {albedo}", mean / all);
        }
    }
}

/// Truth: a mirror sends all light to one direction.
#[test]
fn a_mirror_draws_its_one_direction() {
    let mirror = Material::built_in("mirror").unwrap();
    let drawn = mirror.sample(direction(30.0, 10.0), [0.3, 0.4]).unwrap();
    assert!((drawn.direction - direction(30.0, 190.0)).length() < 1e-12);
    assert!(drawn.density_per_sr.is_infinite() && mirror.lobe_width_rad() == 0.0);
}

/// Truth: 2/(3π)(sin γ + (π−γ) cos γ) of a Lambert sphere, through the law of a black Phong lobe; and the closed strip integral of a Beckmann sphere (tested beside
/// it against an independent sum), through a Cook–Torrance lobe. Tolerance: the cubature's 1e-5.
#[test]
fn spheres_agree_with_closed_forms() {
    let gloss = Gloss::Phong { exponent: 50.0 };
    let lambert = Material::glossy("white", gloss, flat(0.0), Some(flat(1.0))).unwrap();
    let lobe = Lobe::isotropic(Distribution::Beckmann, 0.05, Masking::Separable).unwrap();
    let fresnel = Fresnel::constant(flat(0.9)).unwrap();
    let one = [CookTorranceLobe { lobe, grooves: false, share: 1.0 }];
    let rough = Material::cook_torrance("m", &one, &fresnel, None).unwrap();
    let known = Material::microfacet("m", lobe, fresnel);
    for phase_deg in [0.0, 1.0, 50.0, 120.0, 170.0] {
        let phase = f64::to_radians(phase_deg);
        let mut sum = [0.0; 2];
        let error = lambert.add_sphere_weights(phase, 1.0, &mut sum).unwrap();
        let truth = 2.0 / (3.0 * PI) * (phase.sin() + (PI - phase) * phase.cos());
        assert!(
            error < 1e-4 && (sum[1] / truth - 1.0).abs() < 1e-4,
            "{phase_deg}: {sum:?} {truth}"
        );
        let (mut found, mut truth) = ([0.0], [0.0]);
        rough.add_sphere_weights(phase, 1.0, &mut found).unwrap();
        known.add_sphere_weights(phase, 1.0, &mut truth).unwrap();
        assert!((found[0] / truth[0] - 1.0).abs() < 1e-4, "{phase_deg}: {found:?} {truth:?}");
    }
}

/// Truth: the angle at which each lobe has fallen to 1/e at normal incidence, from its formula.
#[test]
fn lobes_know_their_width() {
    let value = |m: &Material, deg: f64| m.brdf(500.0, direction(0.0, 0.0), direction(deg, 0.0));
    let ward = laws::ward(0.05, 0.05, WardForm::Original);
    let gloss = Gloss::Phong { exponent: 400.0 };
    let phong = Material::glossy("phong", gloss, flat(0.7), None).unwrap();
    for material in [ward, phong, laws::abg()] {
        let width = material.lobe_width_rad().to_degrees();
        let fall = value(&material, width) / value(&material, 0.0);
        assert!((fall - (-1.0_f64).exp()).abs() < 0.01, "{}: {fall}", material.describe());
    }
}
