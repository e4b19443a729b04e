//! Cost and error of sampling a big mesh, over many draws: `dense_satellite` from 48 pairs of directions within 2 mrad of the scene's own, so that no single
//! draw's luck counts. The truth of each is the exact sum, which at the scene's own directions is another program's to 1e-13 (`sunglint bench`).
//!
//! `cargo run --release -p sunglint-simulator --example dense_rms`
#![allow(clippy::unwrap_used, reason = "an example that cannot measure should stop")]

use glam::DVec3;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::time::Instant;
use sunglint_simulator::light::{Scene, SceneOptions, View};
use sunglint_simulator::scenes::{BenchScene, grey};

const DRAWS: usize = 48;
const APART_RAD: f64 = 2e-3;

fn main() {
    let bench = BenchScene::new("dense_satellite").unwrap();
    let exact = Scene::new(&bench.target).unwrap();
    let spectra = exact.materials().iter().flat_map(|material| material.spectra());
    let rho: Vec<f64> = spectra.map(|spectrum| grey(spectrum).unwrap()).collect();
    let light = |weights: &[f64]| weights.iter().zip(&rho).map(|(w, r)| w * r).sum::<f64>();
    let mut random = Xoshiro256PlusPlus::seed_from_u64(7);
    let mut near = |direction: DVec3| {
        let [x, y, z] = [(); 3].map(|()| APART_RAD * random.random_range(-1.0..1.0));
        (direction + DVec3::new(x, y, z)).normalize()
    };
    let views: Vec<[DVec3; 2]> =
        (0..DRAWS).map(|_| [near(bench.sun_body), near(bench.view_body)]).collect();
    let mut weights = vec![0.0; exact.weight_count()];
    let mut evaluator = exact.evaluator();
    let mut sent = |[sun, to]: &[DVec3; 2]| {
        evaluator.direct(*sun, View::Distant(*to), &mut weights).unwrap();
        light(&weights)
    };
    let truth: Vec<f64> = views.iter().map(&mut sent).collect();
    println!(
        "tolerance, median time, error (root of the mean square of {DRAWS} draws), stated error (mean)"
    );
    for tolerance in [5e-2, 4e-2, 3e-2, 1e-2, 3e-3, 2.8e-3, 2.6e-3] {
        let options = SceneOptions { tolerance, ..SceneOptions::default() };
        let scene = Scene::with_options(&bench.target, options).unwrap();
        let mut evaluator = scene.evaluator();
        let (mut seconds, mut square, mut stated) = (Vec::new(), 0.0, 0.0);
        // Once more than counts: the first fills caches.
        for ([sun, to], truth) in views.iter().zip(&truth).chain(views.iter().zip(&truth)) {
            let begin = Instant::now();
            let done = evaluator.direct(*sun, View::Distant(*to), &mut weights).unwrap();
            seconds.push(begin.elapsed().as_secs_f64());
            if seconds.len() > DRAWS {
                square += (light(&weights) / truth - 1.0).powi(2);
                stated += done.error;
            }
        }
        let seconds = &mut seconds[DRAWS..];
        seconds.sort_by(f64::total_cmp);
        let n = DRAWS as f64;
        println!(
            "{tolerance}, {:.2} ms, {:.2e}, {:.1e}",
            1e3 * seconds[DRAWS / 2],
            (square / n).sqrt(),
            stated / n
        );
    }
}
