//! Error of light between surfaces against its cost, for concave bodies: `benches/convergence.py` holds it against a ray program of its own.
//!
//! `cargo run --release -p sunglint-simulator --example convergence -- mesh BODY` prints a body's triangles, ten numbers to a line (three corners, albedo);
//! `… -- light BODY TOLERANCE BUDGET_S` a JSON line for each pair of directions, and the CPU time.
#![allow(clippy::unwrap_used, reason = "an example that cannot measure should stop")]

use glam::{DQuat, DVec2, DVec3};
use std::f64::consts::TAU;
use std::time::Instant;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::light::bounce::{Bounce, BounceOptions};
use sunglint_simulator::light::{Effect as _, Lighting, Options, Scene, View};
use sunglint_simulator::mesh::Mesh;
use sunglint_simulator::mesh::shapes::{Side, cuboid};
use sunglint_simulator::surface::{Distribution, Fresnel, Lobe, Masking, Material};
use sunglint_simulator::target::{Part, Placement, Shape, Target};

/// Pairs of directions.
const PAIRS: usize = 8;
/// Cosine of the largest phase angle, 130°.
const LARGEST_PHASE_COS: f64 = -0.642_787_609_686_539_4;

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let name = arguments[2].as_str();
    let target = body(name);
    if arguments[1] == "mesh" {
        for part in &target.parts {
            let Shape::Mesh(mesh) = &part.shape else { continue };
            let material = &target.materials[part.material];
            let rho = material.spectra()[0].at(550.0);
            for t in 0..mesh.triangles.len() {
                let corners =
                    mesh.corners(t).map(|c| part.placement.rotation * c + part.placement.offset_m);
                let numbers = corners.iter().flat_map(|c| c.to_array()).chain([rho]);
                println!("{}", numbers.map(|x| format!("{x:.17}")).collect::<Vec<_>>().join(" "));
            }
        }
        return;
    }
    let number = |k: usize| arguments[k].parse::<f64>().unwrap();
    let (tolerance, budget_s) = (number(3), number(4));
    let scene = Scene::new(&target).unwrap();
    let began = Instant::now();
    let most_paths = Options { budget_s, ..Options::default() }.paths();
    let options = BounceOptions { tolerance, most_paths, ..BounceOptions::default() };
    let bounce = Bounce::new(&scene, &options).unwrap();
    let prepared_s = began.elapsed().as_secs_f64();
    let mut evaluator = scene.evaluator();
    let mut light = bounce.light();
    let n = bounce.terms().len();
    for (sun, to) in directions() {
        let mut out = vec![0.0; scene.weight_count()];
        evaluator.direct(sun, View::Distant(to), &mut out).unwrap();
        let direct: f64 = scene.spectra().zip(&out).map(|(rho, w)| rho.at(550.0) * w).sum();
        let (mut weights, mut errors) = (vec![0.0; n], vec![0.0; n]);
        let began = Instant::now();
        light.add(&lighting(sun, to), &mut weights, &mut errors).unwrap();
        let light_s = began.elapsed().as_secs_f64();
        let at = |rows: &[f64]| -> f64 {
            bounce.terms().iter().zip(rows).map(|(t, w)| t.spectrum.at(550.0) * w).sum()
        };
        let (found, mut claimed) = (at(&weights), at(&errors));
        if !bounce.need().needed {
            claimed = bounce.need().bound.unwrap_or(1.0) * direct;
        }
        println!(
            "{{\"body\":\"{name}\",\"sun\":[{},{},{}],\"to\":[{},{},{}],\"direct\":{direct:e},\"bounced\":{found:e},\"stated\":{claimed:e},\"light_s\":{light_s:e},\"prepared_s\":{prepared_s:e}}}",
            sun.x, sun.y, sun.z, to.x, to.y, to.z
        );
    }
    eprintln!("{name} {tolerance} {budget_s}: {}", bounce.need().why);
}

fn lighting(sun_body: DVec3, to: DVec3) -> Lighting {
    Lighting {
        sun_body,
        sun_radius_rad: 0.0,
        earth: None,
        moon: None,
        shadow: None,
        sunlit: 1.0,
        sunlit_error: 0.0,
        view: View::Distant(to),
    }
}

/// Pairs of directions from which the openings of all bodies, along +z, are seen.
fn directions() -> impl Iterator<Item = (DVec3, DVec3)> {
    let pairs = (0..).map(|k| {
        let u = sobol_burley::sample_4d(k, 0, 77).map(f64::from);
        let on_sphere = |z: f64, turn: f64| {
            let (sin, cos) = (TAU * turn).sin_cos();
            let across = (1.0 - z * z).max(0.0).sqrt();
            DVec3::new(across * cos, across * sin, z)
        };
        let sun = on_sphere(0.05 + 0.95 * u[0], u[1]);
        let (x, y) = sun.any_orthonormal_pair();
        let at = on_sphere(LARGEST_PHASE_COS + (1.0 - LARGEST_PHASE_COS) * u[2], u[3]);
        (sun, (at.x * x + at.y * y + at.z * sun).normalize())
    });
    pairs.filter(|(_, to)| to.z > 0.1).take(PAIRS)
}

fn grey(rho: f64) -> Material {
    Material::lambert("grey", Spectrum::constant(rho, 300.0, 1240.0).unwrap()).unwrap()
}

fn ggx(alpha: f64, rho: f64) -> Material {
    let lobe = Lobe::isotropic(Distribution::Ggx, alpha, Masking::HeightCorrelated).unwrap();
    let spectrum = Spectrum::constant(rho, 300.0, 1240.0).unwrap();
    Material::microfacet("rough", lobe, Fresnel::constant(spectrum).unwrap())
}

fn add(target: &mut Target, mesh: Mesh, material: usize, offset_m: DVec3) {
    target.parts.push(Part {
        name: format!("p{}", target.parts.len()),
        shape: Shape::Mesh(mesh),
        material,
        placement: Placement { rotation: DQuat::IDENTITY, offset_m },
        hinge: None,
        tangent: DVec3::X,
    });
}

/// A closed body of revolution about z from a closed outline (radius, height), counter-clockwise with the radius to the right.
fn revolved(outline: &[DVec2], sides: usize) -> Mesh {
    let mut mesh = Mesh::default();
    let at = |p: DVec2, k: usize| {
        let (sin, cos) = (TAU * k as f64 / sides as f64).sin_cos();
        DVec3::new(p.x * cos, p.x * sin, p.y)
    };
    let n = outline.len();
    for k in 0..sides {
        for j in 0..n {
            let (p, q) = (outline[j], outline[(j + 1) % n]);
            let ring = [at(p, k), at(p, (k + 1) % sides), at(q, (k + 1) % sides), at(q, k)];
            for t in [[0, 1, 2], [0, 2, 3]] {
                let [a, b, c] = t.map(|i| ring[i]);
                if (b - a).cross(c - a).length() < 1e-12 {
                    continue;
                }
                let first = mesh.vertices.len() as u32;
                mesh.vertices.extend([a, b, c]);
                mesh.triangles.push([first, first + 1, first + 2]);
            }
        }
    }
    mesh
}

fn box_mesh(x: f64, y: f64, z: f64) -> Mesh {
    cuboid(DVec3::new(x, y, z), &Side::ALL)
}

fn body(name: &str) -> Target {
    let (shape, finish) = name.split_once('-').unwrap_or((name, ""));
    let mut target = Target::default();
    let rho = match shape {
        "torus" => 0.9,
        "comb" => 0.85,
        _ => 0.8,
    };
    target.materials.push(match finish {
        "" => grey(rho),
        alpha => ggx(alpha.parse().unwrap(), rho),
    });
    let round = |points: &[(f64, f64)]| -> Vec<DVec2> {
        points.iter().map(|(r, z)| DVec2::new(*r, *z)).collect()
    };
    match shape {
        "comb" => {
            add(&mut target, box_mesh(2.0, 1.0, 0.1), 0, DVec3::new(0.0, 0.0, -0.05));
            for k in 0..20 {
                let x = 0.1 * (f64::from(k) - 9.5);
                add(&mut target, box_mesh(0.02, 1.0, 0.6), 0, DVec3::new(x, 0.0, 0.3));
            }
        }
        "torus" => {
            let ring: Vec<DVec2> = (0..20)
                .map(|k| {
                    let (sin, cos) = (TAU * f64::from(k) / 20.0).sin_cos();
                    DVec2::new(1.0 + 0.4 * cos, 0.4 * sin)
                })
                .collect();
            add(&mut target, revolved(&ring, 48), 0, DVec3::ZERO);
        }
        "cup" => {
            let ring = round(&[
                (0.0, -0.02),
                (0.12, -0.02),
                (0.12, 2.0),
                (0.1, 2.0),
                (0.1, 0.0),
                (0.0, 0.0),
            ]);
            add(&mut target, revolved(&ring, 24), 0, DVec3::ZERO);
        }
        "tube" => {
            let mut points = vec![(0.0, -0.02), (0.32, -0.02), (0.32, 1.0), (0.3, 1.0)];
            for k in (1..5).rev() {
                let z = 0.2 * f64::from(k);
                points.extend([
                    (0.3, z + 0.005),
                    (0.2, z + 0.005),
                    (0.2, z - 0.005),
                    (0.3, z - 0.005),
                ]);
            }
            points.extend([(0.3, 0.0), (0.0, 0.0)]);
            add(&mut target, revolved(&round(&points), 16), 0, DVec3::ZERO);
        }
        "slit" => {
            for side in [-1.0, 1.0] {
                let at = DVec3::new(side * 0.251, 0.0, 0.1);
                add(&mut target, box_mesh(0.5, 1.0, 0.2), 0, at);
            }
        }
        // Two plates at a right angle.
        "corner" => {
            add(&mut target, box_mesh(1.0, 1.0, 0.02), 0, DVec3::new(0.0, 0.0, -0.01));
            add(&mut target, box_mesh(0.02, 1.0, 1.0), 0, DVec3::new(-0.51, 0.0, 0.48));
        }
        "cavity" => {
            let ring = round(&[
                (0.0, -0.05),
                (0.55, -0.05),
                (0.55, 0.5),
                (0.5, 0.5),
                (0.5, 0.0),
                (0.0, 0.0),
            ]);
            add(&mut target, revolved(&ring, 12), 0, DVec3::ZERO);
        }
        "boxes" => {
            for (k, at) in [
                (0, [0.0, 0.0, 0.0]),
                (1, [0.8, 0.1, 0.2]),
                (2, [0.1, 0.9, -0.1]),
                (3, [0.7, 0.8, 0.6]),
            ] {
                let s = 0.5 + 0.07 * f64::from(k);
                add(&mut target, box_mesh(s, 0.6, 0.5), 0, DVec3::from_array(at));
            }
        }
        other => return Target::built_in(other).unwrap(),
    }
    target
}
