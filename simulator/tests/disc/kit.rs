//! One plate or sphere under the disc, and the law of limb darkening written once more.

use glam::{DVec2, DVec3};
use std::f64::consts::PI;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::light::{Lighting, Scene, SunOptions, View};
use sunglint_simulator::mesh::shapes::plate;
use sunglint_simulator::surface::{Distribution, Fresnel, Lobe, Masking, Material};
use sunglint_simulator::target::{Part, Placement, Shape, Target};

/// Angular radius of the Sun at 1 au, radians.
pub const SUN: f64 = 0.004_652_4;

/// Brightness over its mean: the law with the coefficients of Hestroffer and Magnan (1998).
pub fn law(mu: f64, nm: f64) -> f64 {
    let a = if nm >= 416.0 { -0.023 + 292.0 / nm } else { -0.507 + 441.0 / nm };
    (a + 2.0) / 2.0 * mu.powf(a)
}

pub fn grey() -> Fresnel {
    Fresnel::constant(Spectrum::constant(1.0, 300.0, 1240.0).unwrap()).unwrap()
}

pub fn rough(distribution: Distribution, alpha: f64) -> Material {
    let lobe = Lobe::isotropic(distribution, alpha, Masking::Separable).unwrap();
    Material::microfacet("rough", lobe, grey())
}

pub fn mirror() -> Material {
    Material::mirror("mirror", grey())
}

pub fn white() -> Material {
    Material::lambert("white", Spectrum::constant(1.0, 300.0, 1240.0).unwrap()).unwrap()
}

pub fn add(target: &mut Target, material: Material, shape: Shape, offset_m: DVec3) {
    let k = target.parts.len();
    target.materials.push(material);
    target.parts.push(Part {
        name: format!("p{k}"),
        shape,
        material: k,
        placement: Placement { offset_m, ..Placement::default() },
        hinge: None,
        tangent: DVec3::X,
    });
}

/// White paint under a varnish.
pub fn paint() -> Material {
    let flat = |v| Spectrum::constant(v, 300.0, 1240.0).unwrap();
    let lobe = Lobe::isotropic(Distribution::Ggx, 0.3, Masking::Separable).unwrap();
    Material::blend("paint", flat(0.8), lobe, Fresnel::schlick(flat(0.04)).unwrap()).unwrap()
}

/// A plate of 1 m² that looks along z.
pub fn facet(material: Material) -> Target {
    let mut target = Target::default();
    add(&mut target, material, Shape::Mesh(plate(DVec2::ONE, true, false)), DVec3::ZERO);
    target
}

pub fn lighting(sun: DVec3, to: DVec3) -> Lighting {
    Lighting {
        sun_body: sun,
        sun_radius_rad: SUN,
        earth: None,
        moon: None,
        shadow: None,
        sunlit: 1.0,
        sunlit_error: 0.0,
        view: View::Distant(to),
    }
}

/// W at a wavelength and its claimed error.
pub fn at(scene: &Scene, lighting: &Lighting, nm: f64) -> (f64, f64) {
    let (mut weights, mut errors) = (vec![0.0; scene.term_count()], vec![0.0; scene.term_count()]);
    scene.evaluator().light(lighting, &mut weights, &mut errors).unwrap();
    let terms = scene.terms().unwrap();
    assert_eq!(terms.len(), weights.len());
    let sum = |row: &[f64], abs: bool| -> f64 {
        row.iter()
            .zip(&terms)
            .map(|(w, t)| w * if abs { t.spectrum.at(nm).abs() } else { t.spectrum.at(nm) })
            .sum()
    };
    assert!(errors.iter().all(|e| *e >= 0.0), "{errors:?}");
    (sum(&weights, false), sum(&errors, true))
}

/// The same of a target, with an unusually small tolerance where asked for.
pub fn weigh(target: &Target, lighting: &Lighting, nm: f64) -> (f64, f64) {
    at(&Scene::with_sun(target, SunOptions::default()).unwrap(), lighting, nm)
}

/// ⟨value⟩ over the disc about `sun`, by rings even in μ^1.5 and as many places around: independent of the engine's rules.
pub fn average(sun: DVec3, nm: f64, n: u32, value: impl Fn(DVec3) -> f64) -> f64 {
    let u = sun.any_orthonormal_vector();
    let v = sun.cross(u);
    let (mut sum, mut all) = (0.0, 0.0);
    for k in 0..n {
        let t = (f64::from(k) + 0.5) / f64::from(n);
        let mu = t * t;
        let r = ((1.0 - mu) * (1.0 + mu)).sqrt();
        // 2 μ dμ = 4 t³ dt.
        let weight = 4.0 * t * t * t / f64::from(n);
        let psi = (r * SUN.sin()).asin();
        for j in 0..n {
            let (s, c) = ((f64::from(j) + 0.5) * 2.0 * PI / f64::from(n)).sin_cos();
            let d = psi.cos() * sun + psi.sin() * (c * u + s * v);
            sum += weight * law(mu, nm) * value(d) / psi.cos() / f64::from(n);
        }
        all += weight;
    }
    // The midpoint rule of the weight itself is 1 to 1e-6.
    sum / all
}

/// A unit vector at an angle from z, in the plane of x.
pub fn tilted(theta: f64) -> DVec3 {
    DVec3::new(theta.sin(), 0.0, theta.cos())
}
