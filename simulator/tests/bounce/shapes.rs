//! Materials with laws of their own, and curved parts.

use super::rays::{Law, Rays};
use super::scenes::*;
use glam::DVec3;
use rand::SeedableRng as _;
use rand_xoshiro::Xoshiro256PlusPlus;
use std::f64::consts::{PI, TAU};
use sunglint_radiometry::spectrum::{Reflectance, Spectrum};
use sunglint_simulator::light::bounce::{Bounce, BounceOptions, stand_in};
use sunglint_simulator::light::{Scene, View};
use sunglint_simulator::mesh::Mesh;
use sunglint_simulator::mesh::shapes::{Side, cuboid};
use sunglint_simulator::surface::{Gloss, Material, WardForm};
use sunglint_simulator::target::{Curved, DishForm, Placement, Shape, Target};

/// Ward (1992), eq. 5a, with α = 0.4 and ρ_s = 0.3, and 0.4 of Lambert light.
fn ward(n: DVec3, i: DVec3, o: DVec3) -> f64 {
    let (ci, co) = (n.dot(i), n.dot(o));
    if ci <= 0.0 || co <= 0.0 {
        return 0.0;
    }
    let cos2 = n.dot((i + o).normalize()).powi(2);
    let tan2 = (1.0 - cos2) / cos2;
    0.4 / PI + 0.3 * (-tan2 / 0.16).exp() / (4.0 * PI * 0.16 * (ci * co).sqrt())
}

/// Phong's law, (n+2)/(2π) cosⁿα with n = 12 and 0.6 of the light.
fn phong(n: DVec3, i: DVec3, o: DVec3) -> f64 {
    let cos = (2.0 * n.dot(i) * n - i).dot(o);
    if n.dot(i) > 0.0 && cos > 0.0 { 0.6 * 14.0 / (2.0 * PI) * cos.powi(12) } else { 0.0 }
}

fn flat(rho: f64) -> Spectrum<Reflectance> {
    Spectrum::constant(rho, 300.0, 1240.0).unwrap()
}

/// Truth: the tests' own path tracer with the laws written down above, in a corner one wall of which follows them. Four of its standard errors and what is claimed.
#[test]
fn walls_with_laws_of_their_own() {
    let gloss = Gloss::Ward { alpha_x: 0.4, alpha_y: 0.4, form: WardForm::Original };
    let ward_wall = Material::glossy("ward", gloss, flat(0.3), Some(flat(0.4))).unwrap();
    let gloss = Gloss::Phong { exponent: 12.0 };
    let phong_wall = Material::glossy("phong", gloss, flat(0.6), None).unwrap();
    for (law, material) in [(ward as Law, ward_wall), (phong as Law, phong_wall)] {
        let mut target = Target::built_in("corner").unwrap();
        target.materials = vec![material, grey("a", 0.7), grey("b", 0.7)];
        target.parts.iter_mut().enumerate().for_each(|(k, part)| part.material = k);
        let scene = Scene::new(&target).unwrap();
        let bounce = Bounce::new(
            &scene,
            &BounceOptions { tolerance: 5e-3, seed: 2, ..BounceOptions::default() },
        )
        .unwrap();
        let rays = Rays::with_laws(&target, &[(0, law)]);
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(7);
        for (sun, to) in [([0.7, 0.3, 0.6], [0.4, 0.4, 0.9]), ([0.3, 0.9, 0.4], [0.6, 0.2, 0.5])] {
            let (sun, to) = (DVec3::from(sun).normalize(), DVec3::from(to).normalize());
            let (truth, sigma) = rays.bounced(sun, to, 400_000, &mut rng);
            let (found, error) = grey_light(&bounce, sun, View::Distant(to));
            eprintln!("{found:.5} of {truth:.5} ± {sigma:.1e}, claimed {error:.1e}");
            assert!(sigma < 0.02 * truth, "{truth} {sigma}");
            assert!((found - truth).abs() <= error + 4.0 * sigma, "{found} {truth} {error}");
        }
    }
}

/// The inside of the paraboloid z = depth (r/radius)² in 60 by 8 quadrilaterals.
fn bowl(radius: f64, depth: f64) -> Mesh {
    let (around, rings) = (60_u32, 8_u32);
    let mut mesh = Mesh::default();
    for ring in 0..=rings {
        for k in 0..around {
            let (sin, cos) = (TAU * f64::from(k) / f64::from(around)).sin_cos();
            let r = f64::from(ring) / f64::from(rings);
            mesh.vertices.push(DVec3::new(radius * r * cos, radius * r * sin, depth * r * r));
        }
    }
    for ring in 0..rings {
        for k in 0..around {
            let (a, b) = (ring * around + k, ring * around + (k + 1) % around);
            mesh.triangles.push([a, a + around, b + around]);
            if ring > 0 {
                mesh.triangles.push([a, b + around, b]);
            }
        }
    }
    mesh
}

/// The wall of a frustum of the same mean radius in 120 facets, without its ends, which stand on the plate and see nothing.
fn wall(low: f64, high: f64, height: f64) -> Mesh {
    let around = 120_u32;
    let mut mesh = Mesh::default();
    for k in 0..around {
        let (sin, cos) = (TAU * f64::from(k) / f64::from(around)).sin_cos();
        for (radius, z) in [(low, -0.5), (high, 0.5)] {
            mesh.vertices.push(DVec3::new(radius * cos, radius * sin, height * z));
        }
        let (a, b) = (2 * k, 2 * ((k + 1) % around));
        mesh.triangles.extend([[a, b, b + 1], [a, b + 1, a + 1]]);
    }
    // A lid hides what is behind.
    for k in 1..around - 1 {
        mesh.triangles.push([1, 2 * k + 1, 2 * k + 3]);
    }
    mesh
}

/// Truth: the tests' own path tracer over meshes that are made here, with 60 and 120 facets around (their own tilts bring 0.3 % at most). A frustum that
/// stands on a plate, and a bowl over one: the stand-in's light is right within what it claims (of which facets are 2 % of the light at most) and
/// three standard errors.
#[test]
fn curved_parts_have_a_stand_in() {
    let cylinder = Curved::Frustum { bottom_radius_m: 0.3, top_radius_m: 0.2, height_m: 1.0 };
    let form = DishForm::Paraboloid;
    let dish = Curved::Dish { radius_m: 0.6, depth_m: 0.25, form, inside: true, outside: false };
    let plate = || Shape::Mesh(cuboid(DVec3::new(2.0, 2.0, 0.1), &Side::ALL));
    for (curved, mesh, below) in
        [(cylinder, wall(0.3, 0.2, 1.0), 0.55), (dish, bowl(0.6, 0.25), 0.2)]
    {
        let mut target = Target::default();
        add(&mut target, Shape::Curved(curved), grey("round", 0.8), Placement::default());
        let offset_m = DVec3::new(0.0, 0.0, -below);
        add(
            &mut target,
            plate(),
            grey("flat", 0.7),
            Placement { offset_m, ..Placement::default() },
        );
        let twin = stand_in(&target).unwrap();
        assert!(stand_in(&twin.target).is_none());
        assert!(twin.error < 0.02, "{}", twin.error);
        let scene = Scene::new(&twin.target).unwrap();
        let options = BounceOptions { tolerance: 5e-3, seed: 2, ..BounceOptions::default() };
        let bounce = Bounce::new(&scene, &options).unwrap().with_shape_error(twin.error);
        assert!(bounce.need().why.contains("facets"), "{}", bounce.need().why);
        let mut fine = target.clone();
        fine.parts[0].shape = Shape::Mesh(mesh);
        let rays = Rays::new(&fine);
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
        let (sun, to) =
            (DVec3::new(0.6, 0.2, 0.7).normalize(), DVec3::new(0.5, -0.3, 0.8).normalize());
        let (truth, sigma) = rays.bounced(sun, to, 80_000, &mut rng);
        let (found, error) = grey_light(&bounce, sun, View::Distant(to));
        eprintln!(
            "{found:.5} of {truth:.5} ± {sigma:.1e}, claimed {error:.1e}; {}",
            bounce.need().why
        );
        assert!((found - truth).abs() <= error + 3.0 * sigma, "{found} {truth} {error}");
    }
}
