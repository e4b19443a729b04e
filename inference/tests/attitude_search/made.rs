//! Passes that are made up: simulated with all effects, noise drawn beside.

use glam::{DQuat, DVec3};
use ndarray::Array2;
use rand::{RngExt as _, SeedableRng as _};
use rand_distr::{Distribution as _, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus as Random;
use std::f64::consts::TAU;
use sunglint_inference::attitude::{
    Answer, Forward, Measured, Question, Scale, Turn, Unknowns, angle,
};
use sunglint_inference::solver::{Data, Unit};
use sunglint_simulator::attitude::{Attitude, Spin};
use sunglint_simulator::pass::{Overrides, Pass, PassFile};

pub const ALL: Unknowns = Unknowns { axis: true, phase: true, period: true };

/// The scene of the demonstration with other times and another target.
pub fn pass(target: &str, from: &str, to: &str, step_s: f64) -> Pass {
    let path = sunglint_testkit::repository().join("fixtures/scenes/box_wing_dusk.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let text = text
        .replace("2020-11-18T16:22:00", from)
        .replace("2020-11-18T16:30:00", to)
        .replace("step_s = 0.5", &format!("step_s = {step_s:?}"))
        .replace("built_in = \"box_wing\"", target);
    PassFile::parse(&path, &text).unwrap().resolve(Overrides::default()).unwrap()
}

/// Passes over the same station that other orbits make, all synthetic: low (546 km away at the least), two higher ones with phase angles about 40° and 80°, one at 1,700 km about 85°, a semi-synchronous one of 6,800 km about 27° for twenty minutes, an
/// eccentric one.
pub fn elsewhere(which: u64) -> Pass {
    let orbits = [
        (
            "99128",
            "51.6400 240.0000 0005000 270.0000 180.0000 15.50000000",
            ("16:33:30", "16:38:30"),
        ),
        (
            "99148",
            "74.0000 180.0000 0010000 270.0000 180.0000 13.16000000",
            ("17:35:00", "17:43:00"),
        ),
        (
            "99156",
            "74.0000 300.0000 0010000 270.0000 180.0000 13.16000000",
            ("17:13:00", "17:21:00"),
        ),
        (
            "99172",
            "66.0000 180.0000 0010000 270.0000 180.0000 12.00000000",
            ("18:09:00", "18:17:00"),
        ),
        (
            "99201",
            "55.0000 240.0000 0020000 270.0000 270.0000  6.00000000",
            ("18:50:00", "19:10:00"),
        ),
        (
            "99229",
            "63.4000 300.0000 1500000 270.0000 270.0000 11.50000000",
            ("19:38:00", "19:46:00"),
        ),
    ];
    let (number, elements, (from, to)) = orbits[which as usize % orbits.len()];
    let line = |text: String| {
        let digit = |c: char| c.to_digit(10).unwrap_or(u32::from(c == '-'));
        let sum: u32 = text.chars().map(digit).sum();
        format!("{text}{}", sum % 10)
    };
    let first = format!("1 {number}U 20001A   20323.50000000  .00000000  00000-0  10000-4 0    1");
    let second = format!("2 {number}  {elements}    1");
    let lines = [
        ("1 99004U 20001A   20323.50000000  .00000000  00000-0  10000-4 0    19", line(first)),
        ("2 99004  98.6000 318.0000 0010000  90.0000  90.0000 14.27000000    13", line(second)),
    ];
    let path = sunglint_testkit::repository().join("fixtures/scenes/box_wing_dusk.toml");
    let mut text = std::fs::read_to_string(&path).unwrap();
    for (old, new) in &lines {
        assert!(text.contains(old));
        text = text.replace(old, new);
    }
    let step_s = if from == "18:50:00" { 5.0 } else { 2.0 };
    let text = text
        .replace("16:22:00", from)
        .replace("16:30:00", to)
        .replace("step_s = 0.5", &format!("step_s = {step_s:?}"));
    let mut pass = PassFile::parse(&path, &text).unwrap().resolve(Overrides::default()).unwrap();
    pass.tolerance = 0.004;
    pass
}

/// A pass of eight minutes, or its first or last five.
pub fn usual(which: u64) -> Pass {
    let (from, to) = match which % 3 {
        0 => ("2020-11-18T16:22:00", "2020-11-18T16:30:00"),
        1 => ("2020-11-18T16:22:00", "2020-11-18T16:27:00"),
        _ => ("2020-11-18T16:25:00", "2020-11-18T16:30:00"),
    };
    let mut pass = pass("built_in = \"box_wing\"", from, to, 2.0);
    // Far below the noise, and another than the search's.
    pass.tolerance = 0.004;
    pass
}

pub fn normal(random: &mut Random) -> f64 {
    StandardNormal.sample(random)
}

pub fn direction(random: &mut Random) -> DVec3 {
    DVec3::new(normal(random), normal(random), normal(random)).normalize()
}

/// A simulated pass with noise of a part of the rate and of photons; what is stated is the photons' alone.
pub fn measured(mut pass: Pass, spin: Spin, noise: f64, random: &mut Random) -> Measured {
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

pub fn question(spin_axis: DVec3, epoch: hifitime::Epoch, shortest_s: f64) -> Question {
    Question {
        axis_body: spin_axis,
        epoch,
        unknowns: ALL,
        known: Turn { axis_gcrs: DVec3::Z, turns_per_s: 0.0, phase_rad: 0.0 },
        rates: vec![(-1.0 / shortest_s, 1.0 / shortest_s)],
        scale: Scale::None,
    }
}

/// Makes a blind case from a seed: a spin about the body's z axis with any axis, phase, sense and a period of 10 to 200 s.
pub fn blind(seed: u64) -> (Measured, Spin, Question, f64) {
    blind_in(usual(seed), seed)
}

/// The same, seen in another pass.
pub fn blind_in(pass: Pass, seed: u64) -> (Measured, Spin, Question, f64) {
    let mut random = Random::seed_from_u64(seed);
    let axis = direction(&mut random);
    let period = 10.0 * 20.0_f64.powf(random.random::<f64>());
    let sense = if random.random::<bool>() { 1.0 } else { -1.0 };
    let phase = TAU * random.random::<f64>();
    let epoch = pass.times[0];
    let spin = Spin::along(DVec3::Z, axis, sense / period, phase, epoch).unwrap();
    let curve = measured(pass, spin, 0.03, &mut random);
    let question = question(DVec3::Z, epoch, 5.0);
    (curve, spin, question, period)
}

/// The largest angle between an attitude that was found and the true one at the ends and in the middle of the data, degrees.
pub fn error_deg(answer: &Answer, number: usize, spin: &Spin, zero: hifitime::Epoch) -> f64 {
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

/// The errors of all minima, degrees; what was found is printed.
pub fn errors_deg(name: &str, answer: &Answer, spin: &Spin, curves: &[Measured]) -> Vec<f64> {
    let zero = Forward::new(curves).unwrap().zero;
    let errors: Vec<f64> =
        (0..answer.minima.len()).map(|i| error_deg(answer, i, spin, zero)).collect();
    println!(
        "{name}: {:?}, {:.2} turns, extra {:.3}, reduced {:.2}, alike {:.2}, {} periods, {} epochs simulated, finer {}, warnings {:?}",
        answer.verdict,
        answer.turns,
        answer.extra_noise,
        answer.reduced_chi2,
        answer.correlation,
        answer.periods,
        answer.simulated,
        answer.finer,
        answer.warnings,
    );
    for (m, e) in answer.minima.iter().zip(&errors) {
        println!(
            "  error {e:8.3}, ra {:.2} dec {:.2}, period {:.4} ± {:?}, chi2 +{:.1}, p {:.4}, attitude ± {:?}, brightness {:?}, twin {:?}",
            m.ra_deg,
            m.dec_deg,
            m.period_s,
            m.period_sigma_s,
            m.delta_chi2,
            m.probability,
            m.attitude_sigma_deg,
            m.scales,
            m.twin.as_ref().map(|(t, off)| (t.name(), *off)),
        );
    }
    errors
}
