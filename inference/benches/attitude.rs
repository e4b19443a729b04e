//! Cost of a trial of the attitude search on one core, and its error: the built-in box with wings, its shadows included, in six channels.
//!
//! `cargo bench -p sunglint-analysis --bench attitude` first prints the table: epochs a second of the forward model, and its error against the whole engine (direct light: nothing; all light: what the search adds at the end).

#![expect(clippy::unwrap_used, reason = "a benchmark that cannot run should stop")]

use divan::{Bencher, black_box};
use glam::DVec3;
use ndarray::Array2;
use std::time::Instant;
use sunglint_inference::attitude::{Forward, Law, Measured, State, Turn};
use sunglint_inference::solver::{Data, Unit};
use sunglint_simulator::attitude::{Attitude, Spin};
use sunglint_simulator::light::engine::Switches;
use sunglint_simulator::pass::{Overrides, Pass, PassFile, Study};

fn main() {
    table();
    divan::main();
}

fn pass() -> Pass {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../fixtures/scenes/box_wing_dusk.toml");
    let text = std::fs::read_to_string(&path).unwrap().replace("step_s = 0.5", "step_s = 4.0");
    PassFile::parse(&path, &text).unwrap().resolve(Overrides::default()).unwrap()
}

fn ready() -> (Forward, Law, State, Spin) {
    let pass = pass();
    let shape = (pass.times.len(), pass.station.channels.len());
    let data = Data::new("bench", Array2::from_elem(shape, 1.0), Array2::from_elem(shape, 1.0));
    let unit = Unit::Channels((0..shape.1).map(Some).collect());
    let epoch = pass.times[0];
    let axis_gcrs = DVec3::new(-0.30, 0.10, 0.95).normalize();
    let forward = Forward::new(&[Measured { pass, unit, data }]).unwrap();
    let law = Law::new(DVec3::Z, epoch, forward.zero, 240.0).unwrap();
    let turn = Turn { axis_gcrs, turns_per_s: 1.0 / 20.0, phase_rad: 0.3 };
    let state = law.state(&turn).unwrap();
    (forward, law, state, Spin::along(DVec3::Z, axis_gcrs, 1.0 / 20.0, 0.3, epoch).unwrap())
}

/// Speed and error of the same trials side by side.
fn table() {
    let (forward, law, state, spin) = ready();
    let channels = forward.channels;
    let mut eye = forward.eye();
    let (mut rates, mut all) = (vec![0.0; channels], Vec::new());
    for (m, moment) in forward.moments.iter().enumerate() {
        eye.rates(m, law.at(&state, moment.time_s), &mut rates).unwrap();
        all.extend_from_slice(&rates);
    }
    let (start, rounds) = (Instant::now(), 200);
    for _ in 0..rounds {
        for (m, moment) in forward.moments.iter().enumerate() {
            eye.rates(m, law.at(&state, moment.time_s), &mut rates).unwrap();
            black_box(&rates);
        }
    }
    let speed = (rounds * forward.moments.len()) as f64 / start.elapsed().as_secs_f64();
    println!(
        "| forward model | epochs a second, one core | sum of differences, of all light | largest of a sample |"
    );
    println!("|---|---|---|---|");
    for (name, effects) in
        [("against direct light", Switches::OFF), ("against all light", Switches::default())]
    {
        let mut pass = pass();
        pass.attitude = Attitude::Spin(spin);
        pass.effects = effects;
        let truth = Study::new(pass).unwrap().term_rates().unwrap().rates_hz;
        let (mut apart, mut sum, mut most) = (0.0, 0.0, 0.0_f64);
        for (m, moment) in forward.moments.iter().enumerate() {
            for c in 0..channels {
                let truth: f64 = truth.slice(ndarray::s![moment.sample, c, ..]).sum();
                let found = all[m * channels + c];
                apart += (found - truth).abs();
                sum += truth;
                if truth > 0.0 {
                    most = most.max((found / truth - 1.0).abs());
                }
            }
        }
        println!("| {name} | {speed:.3e} | {:.1e} | {most:.1e} |", apart / sum);
    }
}

#[divan::bench]
fn epoch(bencher: Bencher) {
    let (forward, law, state, _) = ready();
    let mut eye = forward.eye();
    let mut rates = vec![0.0; forward.channels];
    let mut m = 0;
    bencher.bench_local(|| {
        m = (m + 1) % forward.moments.len();
        eye.rates(m, law.at(black_box(&state), forward.moments[m].time_s), &mut rates).unwrap();
        rates[0]
    });
}

#[divan::bench]
fn epoch_and_slopes(bencher: Bencher) {
    let (forward, law, state, _) = ready();
    let mut eye = forward.eye();
    let mut m = 0;
    bencher.bench_local(|| {
        m = (m + 1) % forward.moments.len();
        let at = law.at(black_box(&state), forward.moments[m].time_s);
        eye.weights_and_slopes(m, at).unwrap().1[0]
    });
}
