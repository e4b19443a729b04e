//! Benchmark of the Sun's disc on one core: a facet by the width of its lobe, box-wing, spheres, an eclipse's fractions. Before it measures,
//! it prints the error of each facet at several tolerances, against the finest.
//!
//! `cargo bench -p sunglint-simulator --bench disc`

#![expect(clippy::unwrap_used, reason = "a benchmark that cannot run should stop")]

use divan::{Bencher, black_box};
use glam::{DVec2, DVec3};
use sunglint_ephemeris::orbit::eclipse::Discs;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::light::disc::eclipse::fractions;
use sunglint_simulator::light::{Lighting, Scene, SunOptions, View};
use sunglint_simulator::mesh::shapes::plate;
use sunglint_simulator::surface::{Distribution, Fresnel, Lobe, Masking, Material};
use sunglint_simulator::target::{Part, Placement, Shape, Target};

const SUN: f64 = 4.652_4e-3;

fn main() {
    errors();
    divan::main();
}

fn grey() -> Fresnel {
    Fresnel::constant(Spectrum::constant(1.0, 300.0, 1240.0).unwrap()).unwrap()
}

fn rough(distribution: Distribution, alpha: f64) -> Material {
    let lobe = Lobe::isotropic(distribution, alpha, Masking::Separable).unwrap();
    Material::microfacet("rough", lobe, grey())
}

fn target(material: Material, shape: Shape) -> Target {
    let part = Part {
        name: "part".into(),
        shape,
        material: 0,
        placement: Placement::default(),
        hinge: None,
        tangent: DVec3::X,
    };
    Target { parts: vec![part], materials: vec![material], ..Target::default() }
}

fn facet(material: Material) -> Target {
    target(material, Shape::Mesh(plate(DVec2::ONE, true, false)))
}

/// In the glint, half a radius from its middle.
fn lighting() -> Lighting {
    let tilted = |t: f64| DVec3::new(f64::sin(t), 0.0, f64::cos(t));
    Lighting {
        sun_body: tilted(0.7),
        sun_radius_rad: SUN,
        earth: None,
        moon: None,
        shadow: None,
        sunlit: 1.0,
        sunlit_error: 0.0,
        view: View::Distant(tilted(-0.7 + 0.5 * SUN)),
    }
}

fn light(scene: &Scene, lighting: &Lighting) -> f64 {
    let (mut w, mut e) = (vec![0.0; scene.term_count()], vec![0.0; scene.term_count()]);
    scene.evaluator().light(lighting, &mut w, &mut e).unwrap();
    w[0]
}

fn errors() {
    for distribution in [Distribution::Beckmann, Distribution::Ggx] {
        for alpha in [1e-5, 1e-3, 3e-3, 1e-2, 0.05, 0.2] {
            let target = facet(rough(distribution, alpha));
            let at = |tolerance: f64| {
                let options = SunOptions { tolerance, eclipse: false };
                light(&Scene::with_sun(&target, options).unwrap(), &lighting())
            };
            let finest = at(1e-9);
            let off = [1e-3, 1e-4, 1e-5].map(|t| format!("{:.1e}", (at(t) / finest - 1.0).abs()));
            println!("{distribution:?} {alpha}: at 1e-3, 1e-4, 1e-5 off by {}", off.join(", "));
        }
    }
}

fn run(bencher: Bencher, scene: &Scene, lighting: Lighting) {
    let mut eye = scene.evaluator();
    let (mut w, mut e) = (vec![0.0; scene.term_count()], vec![0.0; scene.term_count()]);
    bencher.bench_local(|| {
        eye.light(black_box(&lighting), &mut w, &mut e).unwrap();
        w[0]
    });
}

#[divan::bench(args = [1e-5, 1e-3, 3e-3, 1e-2, 0.05, 0.2])]
fn beckmann_facet(bencher: Bencher, alpha: f64) {
    let target = facet(rough(Distribution::Beckmann, alpha));
    run(bencher, &Scene::with_sun(&target, SunOptions::default()).unwrap(), lighting());
}

#[divan::bench(args = [1e-5, 1e-3, 3e-3, 1e-2, 0.05, 0.2])]
fn ggx_facet(bencher: Bencher, alpha: f64) {
    let target = facet(rough(Distribution::Ggx, alpha));
    run(bencher, &Scene::with_sun(&target, SunOptions::default()).unwrap(), lighting());
}

#[divan::bench]
fn mirror_facet(bencher: Bencher) {
    let target = facet(Material::mirror("mirror", grey()));
    run(bencher, &Scene::with_sun(&target, SunOptions::default()).unwrap(), lighting());
}

/// The same scenes as the bench `light`, 0: without the disc.
#[divan::bench(args = [("box_wing", 0.0), ("box_wing", SUN), ("corner", 0.0), ("corner", SUN), ("lambert_sphere", SUN)])]
fn epoch(bencher: Bencher, (name, radius): (&str, f64)) {
    let scene = Scene::with_sun(&Target::built_in(name).unwrap(), SunOptions::default()).unwrap();
    let lighting = Lighting {
        sun_body: DVec3::new(0.70, 0.60, 0.25).normalize(),
        sun_radius_rad: radius,
        view: View::Distant(DVec3::new(0.6, -0.1, 0.3).normalize()),
        ..lighting()
    };
    run(bencher, &scene, lighting);
}

#[divan::bench(args = [0.01, 0.3])]
fn rough_sphere(bencher: Bencher, alpha: f64) {
    let target = target(rough(Distribution::Ggx, alpha), Shape::Sphere { radius_m: 1.0 });
    run(bencher, &Scene::with_sun(&target, SunOptions::default()).unwrap(), lighting());
}

#[divan::bench]
fn eclipse_fractions(bencher: Bencher) {
    let discs = Discs { sun_rad: SUN, earth_rad: 1.1, separation_rad: 1.1 + 0.3 * SUN };
    bencher.bench_local(|| fractions(black_box(&discs)));
}
