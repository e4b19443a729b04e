//! Scenes and what is asked of them.

use glam::DVec3;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::light::bounce::Bounce;
use sunglint_simulator::light::{Effect as _, Lighting, Scene, View};
use sunglint_simulator::mesh::Mesh;
use sunglint_simulator::surface::{Distribution, Fresnel, Lobe, Masking, Material};
use sunglint_simulator::target::{Part, Placement, Shape, Target};

pub fn grey(name: &str, rho: f64) -> Material {
    Material::lambert(name, Spectrum::constant(rho, 300.0, 1240.0).unwrap()).unwrap()
}

pub fn beckmann(name: &str, alpha: f64, rho: f64) -> Material {
    let lobe = Lobe::isotropic(Distribution::Beckmann, alpha, Masking::Separable).unwrap();
    let spectrum = Spectrum::constant(rho, 300.0, 1240.0).unwrap();
    Material::microfacet(name, lobe, Fresnel::constant(spectrum).unwrap())
}

pub fn add(target: &mut Target, shape: Shape, material: Material, placement: Placement) {
    target.parts.push(Part {
        name: format!("p{}", target.parts.len()),
        shape,
        material: target.materials.len(),
        placement,
        hinge: None,
        tangent: DVec3::X,
    });
    target.materials.push(material);
}

/// One mesh of one grey material.
pub fn alone(mesh: Mesh, rho: f64) -> Target {
    let mut target = Target::default();
    add(&mut target, Shape::Mesh(mesh), grey("grey", rho), Placement::default());
    target
}

/// The inner sides of a box without a lid, 1 × 1 × `depth` m: five sheets that look inward.
pub fn open_box(depth: f64) -> Mesh {
    use sunglint_simulator::mesh::shapes::{Side, cuboid};
    let sides: Vec<Side> = Side::ALL.into_iter().filter(|s| !(s.axis == 2 && s.positive)).collect();
    let mut mesh = cuboid(DVec3::new(1.0, 1.0, depth), &sides);
    mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    mesh
}

/// Weights and errors of the terms.
pub fn light(bounce: &Bounce, sun: DVec3, view: View) -> (Vec<f64>, Vec<f64>) {
    let n = bounce.terms().len();
    let (mut weights, mut errors) = (vec![0.0; n], vec![0.0; n]);
    let lighting = Lighting {
        sun_body: sun,
        sun_radius_rad: 0.0,
        earth: None,
        moon: None,
        shadow: None,
        sunlit: 1.0,
        sunlit_error: 0.0,
        view,
    };
    bounce.light().add(&lighting, &mut weights, &mut errors).unwrap();
    (weights, errors)
}

/// The same of a grey scene, as one number and its error.
pub fn grey_light(bounce: &Bounce, sun: DVec3, view: View) -> (f64, f64) {
    let (weights, errors) = light(bounce, sun, view);
    let at = |rows: &[f64]| -> f64 {
        bounce.terms().iter().zip(rows).map(|(t, w)| t.spectrum.at(550.0) * w).sum()
    };
    (at(&weights), at(&errors))
}

/// Returns the light that is scattered once, at 550 nm.
pub fn direct(scene: &Scene, sun: DVec3, view: View) -> f64 {
    let mut out = vec![0.0; scene.weight_count()];
    scene.evaluator().direct(sun, view, &mut out).unwrap();
    scene.spectra().zip(&out).map(|(rho, w)| rho.at(550.0) * w).sum()
}
