//! Spheres of every material.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use glam::DVec3;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::surface::{Distribution, Fresnel, Lobe, Masking, Material};

fn rough(distribution: Distribution, alpha: f64, masking: Masking) -> Material {
    let fresnel = Fresnel::constant(Spectrum::constant(1.0, 300.0, 1240.0).unwrap()).unwrap();
    Material::microfacet("m", Lobe::isotropic(distribution, alpha, masking).unwrap(), fresnel)
}

fn sphere(material: &Material, phase_deg: f64) -> f64 {
    let mut sum = vec![0.0; material.spectra().len()];
    let error = material.add_sphere_weights(phase_deg.to_radians(), 1.0, &mut sum).unwrap();
    assert!(error <= 1e-8, "{} {phase_deg}: {error}", material.describe());
    material.times_spectra(500.0, &sum)
}

/// The midpoint rule over longitude and latitude of the part that is lit and seen: all normals, no half vectors.
fn brute_force(material: &Material, phase_deg: f64) -> f64 {
    let phase = phase_deg.to_radians();
    let (sun, eye) = (
        DVec3::new((phase / 2.0).cos(), (phase / 2.0).sin(), 0.0),
        DVec3::new((phase / 2.0).cos(), -(phase / 2.0).sin(), 0.0),
    );
    let (n, half) = (1500, (std::f64::consts::PI - phase) / 2.0);
    let step = std::f64::consts::FRAC_PI_2 / f64::from(n);
    let mut sum = 0.0;
    for j in 0..2 * n {
        let longitude = (f64::from(j) + 0.5) * half / f64::from(n) - half;
        for k in 0..n {
            let latitude = (f64::from(k) + 0.5) * step;
            let normal = DVec3::new(
                latitude.cos() * longitude.cos(),
                latitude.cos() * longitude.sin(),
                latitude.sin(),
            );
            let (x, y) = normal.any_orthonormal_pair();
            let own = |v: DVec3| DVec3::new(x.dot(v), y.dot(v), normal.dot(v));
            let (i, o) = (own(sun), own(eye));
            sum += material.brdf(500.0, i, o) * i.z * o.z * 2.0 * latitude.cos() * step * half
                / f64::from(n);
        }
    }
    sum
}

/// Truth: brute force over the sphere with f itself. Tolerance: 3e-5, its steps.
#[test]
fn spheres_are_what_their_surface_adds_up_to() {
    let lobe = Lobe::isotropic(Distribution::Ggx, 0.3, Masking::Separable).unwrap();
    let tint = Spectrum::new(vec![300.0, 1240.0], vec![0.1, 0.7]).unwrap();
    let white = Spectrum::constant(0.9, 300.0, 1240.0).unwrap();
    let materials = [
        Material::built_in("unit").unwrap(),
        rough(Distribution::Beckmann, 0.12, Masking::Separable),
        rough(Distribution::Beckmann, 1.0, Masking::HeightCorrelated),
        rough(Distribution::Ggx, 0.15, Masking::HeightCorrelated),
        Material::blend("paint", white, lobe, Fresnel::schlick(tint).unwrap()).unwrap(),
    ];
    for material in materials {
        for phase in [0.0, 40.0, 95.0, 160.0] {
            let (found, truth) = (sphere(&material, phase), brute_force(&material, phase));
            assert!(
                (found / truth - 1.0).abs() < 3e-5,
                "{} {phase}: {found} {truth}",
                material.describe()
            );
        }
    }
}

/// Truth: Mitsuba 3.9.1's Beckmann spheres (64 samples a pixel, one run; its rational fit of the masking). Tolerance: 2.5 %, the noise that its five values for
/// α = 0.05, which lie all at 0.2503, show.
#[test]
fn spheres_are_near_mitsubas() {
    for (alpha, truth) in [
        (0.05, [0.2486, 0.2511, 0.2488, 0.2511, 0.2564]),
        (0.12, [0.2515, 0.2527, 0.2514, 0.2520, 0.2530]),
        (0.5, [0.2783, 0.2780, 0.2734, 0.2525, 0.1936]),
    ] {
        for (phase, truth) in [10.0, 40.0, 70.0, 95.0, 120.0].into_iter().zip(truth) {
            let found = sphere(&rough(Distribution::Beckmann, alpha, Masking::Separable), phase);
            assert!((found / truth - 1.0).abs() < 0.025, "{alpha} {phase}: {found} {truth}");
        }
    }
}

/// Truth: closed forms. Mirror 1/4 at any phase angle, Lambert 2/(3π)(sin γ + (π−γ) cos γ), near γ = π 2ε³/(9π); α → 0 a mirror.
#[test]
fn closed_forms() {
    let (mirror, unit) =
        (Material::built_in("mirror").unwrap(), Material::built_in("unit").unwrap());
    for phase in [0.0_f64, 33.0, 90.0, 150.0, 179.9] {
        assert_eq!(sphere(&mirror, phase), 0.25);
        let g = phase.to_radians();
        let pi = std::f64::consts::PI;
        let truth = 2.0 / (3.0 * pi) * (g.sin() + (pi - g) * g.cos());
        let tolerance = 1e-9 * truth + 1e-16;
        assert!((sphere(&unit, phase) - truth).abs() < tolerance, "{phase}");
        if phase < 179.0 {
            for distribution in [Distribution::Beckmann, Distribution::Ggx] {
                let found = sphere(&rough(distribution, 1e-5, Masking::Separable), phase);
                assert!((found - 0.25).abs() < 1e-8, "{distribution:?} {phase}: {found}");
            }
        }
    }
    let left: f64 = 1e-5;
    let mut sum = [0.0];
    unit.add_sphere_weights(std::f64::consts::PI - left, 1.0, &mut sum).unwrap();
    let truth = 2.0 * left.powi(3) / (9.0 * std::f64::consts::PI);
    assert!((sum[0] / truth - 1.0).abs() < 1e-9);
    for material in [&mirror, &unit, &rough(Distribution::Ggx, 0.3, Masking::Separable)] {
        assert_eq!(sphere(material, 180.0), 0.0);
    }
}

#[test]
fn what_has_no_sphere_says_so() {
    let brushed = Lobe::anisotropic(Distribution::Ggx, 0.1, 0.4, Masking::Separable).unwrap();
    let fresnel = Fresnel::constant(Spectrum::constant(1.0, 300.0, 1240.0).unwrap()).unwrap();
    let brushed = Material::microfacet("brushed", brushed, fresnel);
    assert!(
        brushed
            .add_sphere_weights(1.0, 1.0, &mut [0.0])
            .unwrap_err()
            .to_string()
            .contains("tangent")
    );
    let unit = Material::built_in("unit").unwrap();
    assert!(unit.add_sphere_weights(f64::NAN, 1.0, &mut [0.0]).is_err());
}
