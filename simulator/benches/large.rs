//! Benchmark of a big mesh on one core at a tolerance: a body with hills that shade each other, of ten thousand to a million triangles.
//!
//! `cargo bench -p sunglint-simulator --bench large`. First it says, once for each size: the time to prepare the scene, the points of an
//! epoch, and the most memory that the process has held so far (Linux).

#![expect(clippy::unwrap_used, reason = "a benchmark that cannot run should stop")]

use divan::{Bencher, black_box};
use glam::DVec3;
use std::f64::consts::{PI, TAU};
use std::time::Instant;
use sunglint_simulator::light::{Scene, View};
use sunglint_simulator::mesh::Mesh;
use sunglint_simulator::target::{Shape, Target};

const SIZES: [usize; 3] = [10_000, 100_000, 1_000_000];
const TOLERANCE: f64 = 1e-2;

fn main() {
    for size in SIZES {
        let start = Instant::now();
        let scene = scene(size);
        let (prepared, sampling) = (start.elapsed(), scene.report().sampling);
        let most = peak_mib().map_or("unknown".into(), |mib| format!("{mib:.0} MiB"));
        eprintln!(
            "{size} triangles: {prepared:.2?} to prepare, {sampling:?}, {most} at most so far"
        );
    }
    divan::main();
}

/// About so many triangles, in rings of latitude.
fn scene(triangles: usize) -> Scene {
    let rings = ((triangles as f64 / 4.0).sqrt().round() as u32).max(3);
    let sides = 2 * rings;
    let waves = [(7.0, 3.0, 5.0), (-4.0, 8.0, 2.0), (5.0, -6.0, 9.0), (11.0, 4.0, -7.0)];
    let mut mesh = Mesh::default();
    for ring in 0..=rings {
        for side in 0..sides {
            let (polar, azimuth) =
                (PI * f64::from(ring) / f64::from(rings), TAU * f64::from(side) / f64::from(sides));
            let p =
                DVec3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos());
            let height: f64 =
                waves.iter().map(|(x, y, z)| (x * p.x + y * p.y + z * p.z).sin()).sum();
            mesh.vertices.push(p * (1.0 + 0.06 * height));
        }
    }
    let at = |ring: u32, side: u32| ring * sides + side % sides;
    for ring in 0..rings {
        for side in 0..sides {
            let (a, b) = (at(ring, side), at(ring + 1, side));
            let (c, d) = (at(ring + 1, side + 1), at(ring, side + 1));
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    let mut target = Target::built_in("lambert_sphere").unwrap();
    target.parts[0].shape = Shape::Mesh(mesh);
    Scene::with_tolerance(&target, TOLERANCE).unwrap()
}

fn peak_mib() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find(|line| line.starts_with("VmHWM:"))?;
    Some(line.split_whitespace().nth(1)?.parse::<f64>().ok()? / 1024.0)
}

#[divan::bench(args = SIZES)]
fn epoch(bencher: Bencher, size: usize) {
    let scene = scene(size);
    let (sun, to) =
        (DVec3::new(0.7, 0.6, 0.25).normalize(), DVec3::new(0.6, -0.1, 0.3).normalize());
    let mut eye = scene.evaluator();
    let mut out = vec![0.0; scene.weight_count()];
    bencher.bench_local(|| {
        eye.direct(black_box(sun), View::Distant(black_box(to)), &mut out).unwrap();
        out[0]
    });
}
