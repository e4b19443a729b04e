//! Attitudes found in light whose attitude is known because it was simulated with it.
//!
//! The curves come from [`Pass::simulate`] with all effects (earthshine, the Sun's disc, light between parts) and noise drawn independently. Shared with the search are the engine's exact areas and
//! surface laws and the integrals over wavelength, which have truths of their own (another program's sums, rays, closed forms: the simulator's tests); not shared are the geometry of trials, which the
//! search makes by its own rotations, and everything but direct light.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use glam::{DQuat, DVec3};
use ndarray::Array2;
use rand::{RngExt as _, SeedableRng as _};
use rand_distr::{Distribution as _, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus as Random;
use std::f64::consts::{PI, TAU};
use sunglint_analysis::attitude::{
    Answer, AttitudeError, Forward, Law, Measured, Options, Question, Scale, Turn, Unknowns,
    Verdict, angle, find,
};
use sunglint_calibration::pass::{Data, Unit};
use sunglint_simulator::attitude::{Attitude, Spin};
use sunglint_simulator::pass::{Overrides, Pass, PassFile};
use sunglint_testkit::Campaign;

const ALL: Unknowns = Unknowns { axis: true, phase: true, period: true };

/// The scene of the demonstration with other times and another target.
fn pass(target: &str, from: &str, to: &str, step_s: f64) -> Pass {
    let path = sunglint_testkit::repository().join("src/demo/pass.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let text = text
        .replace("2020-11-18T16:22:00", from)
        .replace("2020-11-18T16:30:00", to)
        .replace("step_s = 0.5", &format!("step_s = {step_s:?}"))
        .replace("built_in = \"box_wing\"", target);
    PassFile::parse(&path, &text).unwrap().resolve(Overrides::default()).unwrap()
}

fn usual() -> Pass {
    let mut pass = pass("built_in = \"box_wing\"", "2020-11-18T16:22:00", "2020-11-18T16:30:00", 1.0);
    // A third of the noise: what light between the parts needs to be known to.
    pass.tolerance = 0.01;
    pass
}

fn normal(random: &mut Random) -> f64 {
    StandardNormal.sample(random)
}

fn direction(random: &mut Random) -> DVec3 {
    DVec3::new(normal(random), normal(random), normal(random)).normalize()
}

/// A simulated pass with noise of a part of the rate and of photons; what is stated is the photons' alone.
fn measured(mut pass: Pass, spin: Spin, noise: f64, random: &mut Random) -> Measured {
    pass.attitude = Attitude::Spin(spin);
    let simulation = pass.simulate(&|_| ()).unwrap();
    let n = pass.times.len();
    let channels = simulation.channels.len();
    let mut rate = Array2::from_elem((n, channels), f64::NAN);
    let mut sigma = rate.clone();
    for (c, channel) in simulation.channels.iter().enumerate() {
        for i in 0..n {
            let place = &simulation.places[i];
            if place.sunlit < 1.0 || place.hidden {
                continue;
            }
            let truth = channel.rate_hz[i];
            // A background of 100 Hz, measured well, keeps what is dark from being certain.
            let photons = ((truth + 100.0) / pass.exposure_s[i]).sqrt();
            rate[[i, c]] = truth * (1.0 + noise * normal(random)) + photons * normal(random);
            sigma[[i, c]] = photons;
        }
    }
    let unit = Unit::Channels((0..channels).map(Some).collect());
    let data = Data::new("made up", rate, sigma);
    Measured { pass, unit, data }
}

fn question(spin_axis: DVec3, epoch: hifitime::Epoch, shortest_s: f64) -> Question {
    Question {
        axis_body: spin_axis,
        epoch,
        unknowns: ALL,
        known: Turn { axis_gcrs: DVec3::Z, turns_per_s: 0.0, phase_rad: 0.0 },
        rates: vec![(-1.0 / shortest_s, 1.0 / shortest_s)],
        scale: Scale::None,
    }
}

/// A rotation by hand (Rodrigues' formula).
fn rodrigues(axis: DVec3, angle: f64, v: DVec3) -> DVec3 {
    let k = axis.normalize();
    v * angle.cos() + k.cross(v) * angle.sin() + k * k.dot(v) * (1.0 - angle.cos())
}

/// Truth: the closed form of a convex diffuse box, Σ A ρ/π max(0, n·s) max(0, n·o), turned by Rodrigues' formula. The rates of two attitudes go as these sums. Tolerance: rounding.
#[test]
fn a_turning_box_sends_what_its_faces_send() {
    let target = "[[target.part]]\nname = \"box\"\nshape = \"box\"\nsize_m = [1, 2, 3]\nmaterial = \"grey80\"";
    let path = sunglint_testkit::repository().join("src/demo/pass.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let text = text
        .replace("built_in = \"box_wing\"", "")
        .replace("[orbit]", &format!("{target}\n[orbit]"))
        .replace("step_s = 0.5", "step_s = 20.0");
    let pass = PassFile::parse(&path, &text).unwrap().resolve(Overrides::default()).unwrap();
    let axis = DVec3::new(0.3, -0.5, 0.8).normalize();
    let spin = Spin::along(DVec3::Z, axis, 1.0 / 77.0, 0.4, pass.times[0]).unwrap();
    let curve = measured(pass.clone(), spin, 0.0, &mut Random::seed_from_u64(1));
    let forward = Forward::new(&[curve]).unwrap();
    let law = Law::new(DVec3::Z, pass.times[0], forward.zero, 240.0).unwrap();
    let turn = Turn { axis_gcrs: axis, turns_per_s: 1.0 / 77.0, phase_rad: 0.4 };
    let state = law.state(&turn).unwrap();
    let mut eye = forward.eye();
    let mut rates = vec![0.0; forward.channels];
    let mut ratios = Vec::new();
    for (m, moment) in forward.moments.iter().enumerate() {
        eye.rates(m, law.at(&state, moment.time_s), &mut rates).unwrap();
        // Body to GCRS: z to the axis by the shortest way, then about it.
        let across = DVec3::Z.cross(axis);
        let tilt = DVec3::Z.angle_between(axis);
        let angle = 0.4 + TAU * (moment.time_s - law.epoch_s) / 77.0;
        let turned = |v: DVec3| rodrigues(axis, angle, rodrigues(across, tilt, v));
        let faces = [(DVec3::X, 6.0), (DVec3::Y, 3.0), (DVec3::Z, 2.0)];
        let sum: f64 = faces
            .into_iter()
            .flat_map(|(n, area)| [(turned(n), area), (turned(-n), area)])
            .map(|(n, area)| area / PI * n.dot(moment.to_sun).max(0.0) * n.dot(moment.to_observer).max(0.0))
            .sum();
        let weight = eye.weights(m, law.at(&state, moment.time_s)).unwrap()[0];
        assert!((weight - sum).abs() < 1e-12, "{m}: {weight} {sum}");
        ratios.push(rates[0] / (sum * forward.unit_rates(m)[0]));
    }
    assert!(ratios.len() > 20 && ratios.iter().all(|r| (r - 1.0).abs() < 1e-12));
}

/// Truth: the whole simulation of the same scene with all effects switched off: the path by laws and places, not by the search's rotations. Tolerance: 1e-9, the nanosecond of times and rounding.
#[test]
fn a_trial_has_the_rates_of_the_simulation() {
    let mut pass = pass("built_in = \"box_wing\"", "2020-11-18T16:22:00", "2020-11-18T16:30:00", 7.0);
    let off = sunglint_simulator::light::engine::Switch::Off;
    pass.effects = sunglint_simulator::light::engine::Switches {
        solar_disc: off,
        inter_reflection: off,
        earthshine: off,
        moonshine: off,
        finite_distance: off,
    };
    let axis = DVec3::new(-0.2, 0.6, -0.4).normalize();
    let body = DVec3::new(0.1, 0.2, 1.0);
    let spin = Spin::along(body, axis, -1.0 / 33.0, 5.0, pass.times[3]).unwrap();
    pass.attitude = Attitude::Spin(spin);
    let simulation = pass.simulate(&|_| ()).unwrap();
    let curve = measured(pass.clone(), spin, 0.0, &mut Random::seed_from_u64(1));
    let forward = Forward::new(&[curve]).unwrap();
    let law = Law::new(body, pass.times[3], forward.zero, 240.0).unwrap();
    let turn = Turn { axis_gcrs: axis, turns_per_s: -1.0 / 33.0, phase_rad: 5.0 };
    let state = law.state(&turn).unwrap();
    let back = law.turn(&state).unwrap();
    assert!(back.axis_gcrs.distance(axis) < 1e-12 && (back.phase_rad - 5.0).abs() < 1e-7);
    let mut eye = forward.eye();
    let mut rates = vec![0.0; forward.channels];
    for (m, moment) in forward.moments.iter().enumerate() {
        eye.rates(m, law.at(&state, moment.time_s), &mut rates).unwrap();
        for (c, rate) in rates.iter().enumerate() {
            let truth = simulation.channels[c].rate_hz[moment.sample];
            assert!((rate - truth).abs() <= 1e-9 * truth.abs().max(1.0), "{m} {c}: {rate} {truth}");
        }
    }
}

/// What a seed makes: a spin about the body's z axis with any axis, phase, sense and a period of 10 to 200 s.
fn blind(seed: u64) -> (Measured, Spin, Question, Law, f64) {
    let mut random = Random::seed_from_u64(seed);
    let axis = direction(&mut random);
    let period = 10.0 * 20.0_f64.powf(random.random::<f64>());
    let sense = if random.random::<bool>() { 1.0 } else { -1.0 };
    let phase = TAU * random.random::<f64>();
    let pass = usual();
    let epoch = pass.times[0];
    let spin = Spin::along(DVec3::Z, axis, sense / period, phase, epoch).unwrap();
    let curve = measured(pass, spin, 0.03, &mut random);
    let question = question(DVec3::Z, epoch, 5.0);
    let forward = Forward::new(std::slice::from_ref(&curve)).unwrap();
    let (a, b) = forward.ends_s();
    let law = Law::new(DVec3::Z, epoch, forward.zero, 0.5 * (b - a)).unwrap();
    (curve, spin, question, law, period)
}

/// The largest angle between an attitude that was found and the true one at the ends and in the middle of the data, degrees.
fn error_deg(answer: &Answer, number: usize, spin: &Spin, zero: hifitime::Epoch) -> f64 {
    let law = &answer.law;
    [-1.0, 0.0, 1.0]
        .map(|end| law.middle_s + end * law.half_span_s)
        .map(|t| {
            let truth: DQuat = spin.body_to_gcrs(zero + hifitime::Duration::from_seconds(t));
            angle(law.at(&answer.minima[number].state, t), truth).to_degrees()
        })
        .into_iter()
        .fold(0.0, f64::max)
}

#[allow(dead_code)]
struct Timed(std::time::Instant, std::sync::Mutex<(String, f64)>);
impl sunglint_analysis::attitude::Watch for Timed {
    fn tell(&self, p: sunglint_analysis::attitude::Progress) {
        let mut last = self.1.lock().unwrap();
        let now = self.0.elapsed().as_secs_f64();
        if last.0 != p.stage {
            println!("      {:.2} s after {}", now - last.1, last.0);
            *last = (p.stage.into(), now);
        }
    }
    fn keep(&self, _: &sunglint_analysis::attitude::Checkpoint) {}
}

#[test]
fn explore() {
    let n: u64 = std::env::var("N").map_or(6, |v| v.parse().unwrap());
    let from: u64 = std::env::var("FROM").map_or(0, |v| v.parse().unwrap());
    let zero_of = |curve: &Measured| Forward::new(std::slice::from_ref(curve)).unwrap().zero;
    for seed in from..from + n {
        let (curve, spin, question, _, period) = blind(seed);
        let zero = zero_of(&curve);
        let start = std::time::Instant::now();
        let watch = Timed(start, std::sync::Mutex::new(("setup".into(), 0.0)));
        let answer = find(&[curve], &question, &Options::default(), &watch, None).unwrap();
        let last = watch.1.lock().unwrap().clone();
        println!("      {:.2} s after {}", start.elapsed().as_secs_f64() - last.1, last.0);
        let seconds = start.elapsed().as_secs_f64();
        let b = &answer.minima[0];
        println!(
            "seed {seed} period {period:.2}: {seconds:.2} s, {} simulated, error {:.3} deg, {:?}, extra {:.4}, red {:.2}, left out {:?}, finer {}, p {:.3}",
            answer.simulated, error_deg(&answer, 0, &spin, zero), answer.verdict, answer.extra_noise, answer.reduced_chi2, answer.left_out, answer.finer, b.probability
        );
        println!("   P {:.4} ± {:?} axis {:?} turn {:?} phase {:?}", b.period_s, b.period_sigma_s, b.axis, b.turn_sigma_deg, b.phase_sigma_deg);
        for (i, m) in answer.minima.iter().enumerate().skip(1).take(4) {
            println!("   d {:.1} P {:.3} err {:.1} from best {:.1} twin {:?}", m.delta_chi2, m.period_s, error_deg(&answer, i, &spin, zero), m.from_best_deg, m.twin.as_ref().map(|t| (t.0.name(), t.1)));
        }
        if seed == from {
            for s in &answer.symmetries { println!("   {} unlike {:.3}", s.name, s.unlike); }
        }
    }
}
