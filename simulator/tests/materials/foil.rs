//! Wrinkled foil.

use crate::materials::{direction, flat, hemisphere};
use glam::DVec3;
use std::f64::consts::{PI, SQRT_2};
use sunglint_simulator::surface::{Distribution, Fresnel, Lobe, Masking, Material};

fn lobe(alpha: f64) -> Lobe {
    Lobe::isotropic(Distribution::Beckmann, alpha, Masking::Separable).unwrap()
}

fn smooth(alpha: f64) -> Material {
    Material::microfacet("base", lobe(alpha), Fresnel::constant(flat(0.9)).unwrap())
}

/// Truth: D G/(4 cosθ_i cosθ_o) with Beckmann's D in angles and Smith's G₁ = 2/(1 + erf a + e^(−a²)/(a√π)), a = 1/(α tanθ) (Walter et al. 2007), 0.9 of it. Tolerance:
/// rounding for the mirror; for a base of α 0.01 its own width adds 1e-3 (its square beside the tilts').
#[test]
fn foil_of_a_mirror_is_a_microfacet_lobe() {
    let slope = 0.3 / SQRT_2;
    let mirror = Material::mirror("mirror", Fresnel::constant(flat(0.9)).unwrap());
    let exact = Material::foil("foil", mirror, slope, slope, Masking::Separable).unwrap();
    let near = Material::foil("foil", smooth(0.01), slope, slope, Masking::Separable).unwrap();
    for (i, o) in [
        (direction(10.0, 0.0), direction(30.0, 120.0)),
        (direction(50.0, 0.0), direction(45.0, 170.0)),
        (direction(70.0, 0.0), direction(60.0, 190.0)),
    ] {
        let h = (i + o).normalize();
        let tan2 = (1.0 - h.z * h.z) / (h.z * h.z);
        let d = (-tan2 / 0.09).exp() / (PI * 0.09 * h.z.powi(4));
        let g1 = |v: DVec3| {
            let a = v.z / (0.3 * (1.0 - v.z * v.z).sqrt());
            2.0 / (1.0 + libm::erf(a) + (-a * a).exp() / (a * PI.sqrt()))
        };
        let truth = 0.9 * d * g1(i) * g1(o) / (4.0 * i.z * o.z);
        let value = exact.brdf(500.0, i, o);
        assert!((value / truth - 1.0).abs() < 1e-10, "{value} {truth}");
        let value = near.brdf(500.0, i, o);
        assert!((value / truth - 1.0).abs() < 6e-3, "{value} {truth}");
    }
}

/// Truth: Lambert facets seen and lit from above: ρ/π times the mean of 1/√(1+slope²) over Gaussian slopes, √π/α e^(1/α²) erfc(1/α). Tolerance: 1e-5 (9 points a panel).
#[test]
fn foil_of_paint_seen_from_above() {
    for alpha in [0.05, 0.3, 0.8] {
        let white = Material::lambert("white", flat(0.8)).unwrap();
        let slope = alpha / SQRT_2;
        let foil = Material::foil("foil", white, slope, slope, Masking::Separable).unwrap();
        let x = 1.0 / alpha;
        let truth = 0.8 / PI * PI.sqrt() * x * (x * x).exp() * libm::erfc(x);
        let value = foil.brdf(500.0, DVec3::Z, DVec3::Z);
        assert!((value / truth - 1.0).abs() < 1e-5, "{alpha}: {value} {truth}");
    }
}

/// Truth: reciprocity; energy: no more than the base reflects. Tolerance: rounding; the sum's 1e-3.
#[test]
fn foil_is_reciprocal_and_loses_energy_only() {
    for base in [smooth(0.1), Material::lambert("white", flat(0.9)).unwrap()] {
        let foil = Material::foil("foil", base, 0.3, 0.1, Masking::HeightCorrelated).unwrap();
        for (a, b, phi) in [(10.0, 60.0, 40.0), (80.0, 85.0, 170.0), (0.0, 89.9, 10.0)] {
            let (i, o) = (direction(a, 5.0), direction(b, 5.0 + phi));
            let (there, back) = (foil.brdf(500.0, i, o), foil.brdf(500.0, o, i));
            assert!(there > 0.0 && (there / back - 1.0).abs() < 1e-9, "{there} {back}");
        }
        for theta in [0.0, 60.0, 85.0] {
            let i = direction(theta, 20.0);
            let albedo = hemisphere(60, |o| foil.brdf(500.0, i, o));
            assert!(albedo < 0.901 && albedo > 0.2, "{theta}: {albedo}");
        }
        assert!(!foil.is_isotropic() && foil.albedo_bound() <= 0.901, "{}", foil.albedo_bound());
    }
}
