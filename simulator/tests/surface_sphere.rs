//! Spheres of every material.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::surface::{Distribution, Fresnel, Lobe, Masking, Material};

fn sphere(distribution: Distribution, alpha: f64, masking: Masking, phase: f64) -> (f64, f64) {
    let fresnel = Fresnel::constant(Spectrum::constant(1.0, 300.0, 1240.0).unwrap()).unwrap();
    let lobe = Lobe::isotropic(distribution, alpha, masking).unwrap();
    let mut sum = [0.0];
    let e =
        Material::microfacet("m", lobe, fresnel).add_sphere_weights(phase, 1.0, &mut sum).unwrap();
    (sum[0], e)
}
#[test]
fn look() {
    for d in [Distribution::Beckmann, Distribution::Ggx] {
        for alpha in [1e-5, 1e-3, 0.05, 0.12, 0.5, 1.0, 2.0] {
            for phase in [0.0_f64, 10.0, 40.0, 70.0, 95.0, 120.0, 150.0, 179.0, 179.99, 179.999999]
            {
                let t = std::time::Instant::now();
                let (v, e) = sphere(d, alpha, Masking::Separable, phase.to_radians());
                println!("{d:?} {alpha} {phase} {v:.12} {e:.1e} {:?}", t.elapsed());
            }
        }
    }
}
