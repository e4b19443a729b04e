//! Benchmark of inter-reflected light on one core: the cost of one epoch at a tolerance of 0.2 %, and of making the scene ready for it.
//!
//! `cargo bench -p sunglint-simulator --bench bounce`

#![expect(clippy::unwrap_used, reason = "a benchmark that cannot run should stop")]

use divan::{Bencher, black_box};
use sunglint_simulator::light::bounce::{Bounce, BounceOptions};
use sunglint_simulator::light::{Effect as _, Lighting, Scene, View};
use sunglint_simulator::scenes::BenchScene;

fn main() {
    divan::main();
}

const OPTIONS: BounceOptions =
    BounceOptions { tolerance: 2e-3, seed: 1, most_paths: 1 << 17, analyser: None };

#[divan::bench(args = ["corner", "box_wing_diffuse", "box_wing"])]
fn epoch_188_bins(bencher: Bencher, name: &str) {
    let bench = BenchScene::new(name).unwrap();
    let scene = Scene::new(&bench.target).unwrap();
    let bounce = Bounce::new(&scene, &OPTIONS).unwrap();
    let mut light = bounce.light();
    let lighting = Lighting {
        sun_body: bench.sun_body,
        sun_radius_rad: 0.0,
        earth: None,
        moon: None,
        shadow: None,
        sunlit: 1.0,
        sunlit_error: 0.0,
        view: View::Distant(bench.view_body),
    };
    let at = |k: i32| 302.5 + 5.0 * f64::from(k);
    let spectra: Vec<Vec<f64>> =
        bounce.terms().iter().map(|t| (0..188).map(|k| t.spectrum.at(at(k))).collect()).collect();
    let (mut weights, mut errors) = (vec![0.0; spectra.len()], vec![0.0; spectra.len()]);
    let mut bins = vec![0.0; 188];
    bencher.bench_local(|| {
        weights.fill(0.0);
        errors.fill(0.0);
        light.add(black_box(&lighting), &mut weights, &mut errors).unwrap();
        bins.fill(0.0);
        for (w, spectrum) in weights.iter().zip(&spectra) {
            bins.iter_mut().zip(spectrum).for_each(|(b, s)| *b += w * s);
        }
        bins[0]
    });
}

#[divan::bench(args = ["corner", "box_wing_diffuse", "box_wing"], sample_count = 3, sample_size = 1)]
fn prepare(bencher: Bencher, name: &str) {
    let bench = BenchScene::new(name).unwrap();
    let scene = Scene::new(&bench.target).unwrap();
    bencher.bench_local(|| Bounce::new(&scene, &OPTIONS).unwrap().terms().len());
}
