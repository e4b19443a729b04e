//! Benchmark of a pass: 6,001 epochs, six channels, 188 bins, a body with panels; on one and two threads, whole and its stages apart.
//!
//! `cargo bench -p sunglint-simulator --bench pass`

#![expect(clippy::unwrap_used, reason = "a benchmark that cannot run should stop")]

use divan::{Bencher, black_box};
use std::sync::Mutex;
use std::time::Instant;
use sunglint_simulator::pass::{Overrides, Pass, PassFile, Stage};

const PASS: &str = r#"
[target]
built_in = "box_wing"
[orbit]
lines = ["1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
         "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537"]
[attitude]
law = "orbit"
[station]
name = "ufo"
[times]
from = 2008-09-21T18:43:47Z
to = 2008-09-21T18:53:47Z
step_s = 0.1
"#;

fn main() {
    for threads in [1, 2] {
        let stages = stages(threads);
        let text: Vec<String> =
            stages.iter().map(|(s, ms)| format!("{} {ms:.1}", s.name())).collect();
        println!("stages on {threads} threads, ms, fastest of ten: {}", text.join(", "));
    }
    divan::main();
}

fn pass() -> Pass {
    let pass = PassFile::parse("bench.toml", PASS).unwrap().resolve(Overrides::default()).unwrap();
    assert_eq!((pass.times.len(), pass.station.channels.len(), pass.bins()), (6001, 6, 188));
    pass
}

fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap()
}

/// The stages of the simulation as it tells of them itself.
fn stages(threads: usize) -> Vec<(Stage, f64)> {
    let (pass, pool) = (pass(), pool(threads));
    let mut best: Vec<(Stage, f64)> = Vec::new();
    for _ in 0..10 {
        let begins: Mutex<Vec<(Stage, Instant)>> = Mutex::default();
        pool.install(|| {
            pass.simulate(&|p| {
                let mut begins = begins.lock().unwrap();
                if begins.last().is_none_or(|(stage, _)| *stage != p.stage) {
                    begins.push((p.stage, Instant::now()));
                }
            })
            .unwrap()
        });
        let begins = begins.into_inner().unwrap();
        let costs: Vec<(Stage, f64)> = (begins.windows(2))
            .map(|w| (w[0].0, w[1].1.duration_since(w[0].1).as_secs_f64() * 1e3))
            .collect();
        if best.is_empty() {
            best = costs;
        } else {
            best.iter_mut().zip(costs).for_each(|(best, now)| best.1 = best.1.min(now.1));
        }
    }
    best
}

#[divan::bench(args = [1, 2], max_time = 5)]
fn whole(bencher: Bencher, threads: usize) {
    let (pass, pool) = (pass(), pool(threads));
    bencher.bench_local(|| {
        pool.install(|| black_box(&pass).simulate(&|_| ()).unwrap().spectra[[0, 0]])
    });
}

/// The scene and the integrals over wavelength: once a pass.
#[divan::bench(args = [1, 2], max_time = 5)]
fn tables(bencher: Bencher, threads: usize) {
    let (pass, pool) = (pass(), pool(threads));
    bencher
        .bench_local(|| pool.install(|| black_box(&pass).ready().unwrap().report().warnings.len()));
}

/// One moment by itself: place, light, counts.
#[divan::bench]
fn sample(bencher: Bencher) {
    let pass = pass();
    let ready = pass.ready().unwrap();
    let frames = ready.frames(pass.times[0], pass.times[6000]).unwrap();
    let mut eye = ready.eye();
    bencher.bench_local(|| {
        eye.sample(&pass.orbit, black_box(pass.times[2500]), &frames, 0.1).unwrap().magnitudes
    });
}
