//! Closed forms.

use super::rays::Rays;
use super::scenes::*;
use glam::DVec3;
use std::f64::consts::PI;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::light::bounce::{Bounce, BounceOptions};
use sunglint_simulator::light::{Scene, View};
use sunglint_simulator::mesh::Mesh;
use sunglint_simulator::mesh::shapes::{Faceting, icosphere};
use sunglint_simulator::surface::{Fresnel, Material};
use sunglint_simulator::target::{Placement, Shape, Target};

fn plate(corners: [DVec3; 4]) -> Mesh {
    Mesh { vertices: corners.to_vec(), triangles: vec![[0, 1, 2], [0, 2, 3]], ..Mesh::default() }
}

/// Truth: two unit squares at a right angle along an edge exchange F = 0.200044 (Howell's catalogue, C-14). With the Sun on one alone and an observer who
/// sees the other alone W = ρ²/π F cosθ_i cosθ_o (1 + ρ²F₂ + …): at ρ = 0.01 higher orders are below 1e-5 of it. The Sun shines along the second, which is edge-on to it. The claimed error, and 2 %.
#[test]
fn plates_at_a_right_angle() {
    let floor = plate([DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y]);
    let wall = plate([DVec3::ZERO, DVec3::Y, DVec3::new(0.0, 1.0, 1.0), DVec3::Z]);
    let mut target = Target::default();
    for mesh in [floor, wall] {
        add(&mut target, Shape::Mesh(mesh), grey("dark", 0.01), Placement::default());
    }
    let scene = Scene::new(&target).unwrap();
    let bounce = Bounce::new(
        &scene,
        &BounceOptions { tolerance: 1e-5, seed: 2, ..BounceOptions::default() },
    )
    .unwrap();
    let (sun, to) = (DVec3::new(0.0, 0.6, 0.8), DVec3::new(0.8, 0.6, -1e-9));
    let (found, error) = grey_light(&bounce, sun, View::Distant(to));
    let truth = 1e-4 / PI * 0.200_044 * 0.8 * 0.8;
    eprintln!("{:.1e} off, {:.1e} claimed", found / truth - 1.0, error / truth);
    assert!(
        (found - truth).abs() <= error && (found / truth - 1.0).abs() < 0.02,
        "{found} {truth}"
    );
}

/// The inside of a sphere of 1 m above z = −1 and below `lid`, and its area left out, of the whole.
fn cavity(subdivisions: u32, lid: f64) -> (Mesh, f64) {
    let mut mesh = icosphere(1.0, subdivisions, Faceting::SameArea);
    let area = |m: &Mesh| -> f64 {
        (0..m.triangles.len())
            .map(|t| {
                let [a, b, c] = m.corners(t);
                0.5 * (b - a).cross(c - a).length()
            })
            .sum()
    };
    let whole = area(&mesh);
    let vertices = mesh.vertices.clone();
    mesh.triangles.retain(|t| t.iter().map(|k| vertices[*k as usize].z).sum::<f64>() < 3.0 * lid);
    mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    let left = area(&mesh);
    (mesh, 1.0 - left / whole)
}

/// Truth: the integrating sphere. Of the flux Φ that enters, ρΦ/(4πR²)/(1 − ρ(1 − f)) falls on every part of the wall after the first
/// scattering, f the share of the opening; so an observer gets W = ρ/π times that times what is seen of the wall (found from the direct light, whose Sun
/// stands where the observer does). Facets of the sphere see each other a little differently: 2 %, and the claimed error. Both go by
/// paths: their facets would be too many patches.
#[test]
fn an_integrating_sphere() {
    let rho = 0.9;
    for (subdivisions, limit) in [(2, 0.04), (3, 0.02)] {
        let (mesh, open) = cavity(subdivisions, 0.75);
        let target = alone(mesh, rho);
        let scene = Scene::new(&target).unwrap();
        let bounce = Bounce::new(
            &scene,
            &BounceOptions { tolerance: 5e-3, seed: 2, ..BounceOptions::default() },
        )
        .unwrap();
        let sun = DVec3::new(0.1, 0.05, 1.0).normalize();
        let to = DVec3::new(-0.25, 0.1, 1.0).normalize();
        // What enters the hole is what it fills across the direction.
        let rays = Rays::new(&target);
        let across = |d: DVec3| rays.across(d, 1.05, 150);
        let irradiance = rho * across(sun) / (4.0 * PI) / (1.0 - rho * (1.0 - open));
        let truth = rho / PI * irradiance * across(to);
        let (found, error) = grey_light(&bounce, sun, View::Distant(to));
        eprintln!(
            "{subdivisions}: {:.1e} off, {:.1e} claimed; {}",
            found / truth - 1.0,
            error / truth,
            bounce.need().why
        );
        assert!((found - truth).abs() <= error + limit * truth, "{found} {truth}");
    }
}

/// Truth: a small mirror sphere sends R²/4 of the irradiance into each direction, so a plate at its side gets R²/4 Ω, Ω the solid angle under which the sphere
/// sees it, and sends ρ/π cosθ_o of it on; light takes the way back as well, with cosθ_i; and the sphere sends Ω of the plate's own light back to it. What goes on
/// is (R/h)² of it, as is the sphere's size: 2 %, and the claimed error.
#[test]
fn a_mirror_sphere_beside_a_plate() {
    let (radius, height, rho) = (0.05, 0.5, 0.8);
    let mut target = Target::default();
    let corner = |x: f64, y: f64| DVec3::new(0.5 * x, 0.5 * y, 0.0);
    let ground =
        plate([corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)]);
    add(&mut target, Shape::Mesh(ground), grey("ground", rho), Placement::default());
    let one = Spectrum::constant(1.0, 300.0, 1240.0).unwrap();
    let mirror = Material::mirror("mirror", Fresnel::constant(one).unwrap());
    let placement = Placement { offset_m: height * DVec3::Z, ..Placement::default() };
    add(&mut target, Shape::Sphere { radius_m: radius }, mirror, placement);
    let scene = Scene::new(&target).unwrap();
    // Neither end's shadow of the sphere falls on the plate.
    let (sun, to) = (DVec3::new(0.96, 0.0, 0.28), DVec3::new(0.0, 0.96, 0.28));
    let bounce = Bounce::new(
        &scene,
        &BounceOptions { tolerance: 1e-4, seed: 2, ..BounceOptions::default() },
    )
    .unwrap();
    let (found, error) = grey_light(&bounce, sun, View::Distant(to));
    // A square seen from above its middle at its half side: a sixth of the sphere.
    let solid_angle = 4.0 * PI / 6.0;
    let sphere = radius * radius / 4.0 * solid_angle;
    let once = rho / PI * sphere * (sun.z + to.z);
    // From the plate to the sphere and back.
    let truth = once + (rho / PI).powi(2) * sun.z * to.z * sphere * solid_angle;
    eprintln!("{:.1e} off, {:.1e} claimed", found / truth - 1.0, error / truth);
    assert!((found - truth).abs() <= error + 0.02 * truth, "{found} {truth} {error}");
}
