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
    Answer, Forward, Law, Measured, Options, Question, Scale, Turn, Unknowns, angle, find,
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

/// A pass of eight minutes, or its first or last five.
fn usual(which: u64) -> Pass {
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
            .map(|(n, area)| {
                area / PI * n.dot(moment.to_sun).max(0.0) * n.dot(moment.to_observer).max(0.0)
            })
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
    let mut pass =
        pass("built_in = \"box_wing\"", "2020-11-18T16:22:00", "2020-11-18T16:30:00", 7.0);
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

/// Truth: reciprocity (Helmholtz) and the mirror itself: half a turn about the bisector leaves the light of any body as it is, and the body's own mirror that of a body that has it. The built-in box with
/// wings is its mirror image along z but for shadows on unlike strips. Tolerance: rounding for the exchange; for the mirror what `symmetries` measured, tenfold, since it is a mean.
#[test]
fn twins_send_the_same_light_in_the_middle() {
    let curve = measured(
        pass("built_in = \"box_wing\"", "2020-11-18T16:25:00", "2020-11-18T16:25:20", 0.5),
        Spin::along(
            DVec3::Z,
            DVec3::X,
            0.01,
            0.0,
            hifitime::Epoch::from_gregorian_utc_at_midnight(2020, 11, 18),
        )
        .unwrap(),
        0.0,
        &mut Random::seed_from_u64(3),
    );
    let epoch = curve.pass.times[0];
    let forward = Forward::new(&[curve]).unwrap();
    let law = Law::new(DVec3::Z, epoch, forward.zero, 10.0).unwrap();
    let symmetries = sunglint_analysis::attitude::twins::symmetries(&forward).unwrap();
    let nearest = |m: &usize| (forward.moments[*m].time_s.abs() * 1e9) as i64;
    let middle = (0..forward.moments.len()).min_by_key(nearest).unwrap();
    let time_s = forward.moments[middle].time_s;
    let mut random = Random::seed_from_u64(5);
    let (mut exchanged, mut mirrored, mut lit) = (0, 0, 0);
    let mut eye = forward.eye();
    for _ in 0..20 {
        let axis_gcrs = direction(&mut random);
        let turn = Turn { axis_gcrs, turns_per_s: 0.05, phase_rad: TAU * random.random::<f64>() };
        let state = law.state(&turn).unwrap();
        let own = eye.weights(middle, law.at(&state, time_s)).unwrap().to_vec();
        let all: f64 = own.iter().sum();
        for (twin, other) in
            sunglint_analysis::attitude::twins::twins(&forward, &law, &state, &symmetries)
        {
            let found = eye.weights(middle, law.at(&other, time_s)).unwrap();
            let off: f64 = own.iter().zip(found).map(|(a, b)| (a - b).abs()).sum();
            let allowed = 1e-9 + 10.0 * twin.unlike();
            assert!(off <= allowed * all.max(1e-3), "{}: {off} of {all}", twin.name());
            exchanged += usize::from(twin.exchanged);
            mirrored += usize::from(twin.body.is_some_and(|b| b.mirror));
            lit += usize::from(all > 0.0);
        }
    }
    assert!(exchanged >= 20 && mirrored >= 20 && lit > 20, "{exchanged} {mirrored} {lit}");
    // An exchange twice is none.
    let state =
        law.state(&Turn { axis_gcrs: DVec3::Y, turns_per_s: 0.05, phase_rad: 1.0 }).unwrap();
    let once = sunglint_analysis::attitude::twins::twins(&forward, &law, &state, &[])[0].1;
    let twice = sunglint_analysis::attitude::twins::twins(&forward, &law, &once, &[])[0].1;
    assert!(law.apart(&state, &twice) < 1e-9);
}

/// What a watch was given to keep.
struct Keeping(std::sync::Mutex<Vec<sunglint_analysis::attitude::Checkpoint>>);

impl sunglint_analysis::attitude::Watch for Keeping {
    fn tell(&self, _: sunglint_analysis::attitude::Progress) {}
    fn keep(&self, checkpoint: &sunglint_analysis::attitude::Checkpoint) {
        self.0.lock().unwrap().push(checkpoint.clone());
    }
}

/// Truth: the search that was not cut off, bit by bit; and that of one thread.
#[test]
fn a_search_goes_on_where_it_was_cut_off_and_hangs_on_no_number_of_threads() {
    let pass = pass("built_in = \"box_wing\"", "2020-11-18T16:22:00", "2020-11-18T16:30:00", 12.0);
    let epoch = pass.times[0];
    let spin = Spin::along(DVec3::Z, DVec3::Y, 1.0 / 90.0, 2.0, epoch).unwrap();
    let curve = || measured(pass.clone(), spin, 0.03, &mut Random::seed_from_u64(4));
    let mut question = question(DVec3::Z, epoch, 5.0);
    question.known.turns_per_s = 1.0 / 90.0;
    question.unknowns.period = false;
    let options = Options { axes: 100, all_light: false, ..Options::default() };
    let keeping = Keeping(std::sync::Mutex::new(Vec::new()));
    let whole = find(&[curve()], &question, &options, &keeping, None).unwrap();
    let kept = keeping.0.into_inner().unwrap();
    assert!(kept.len() >= 2 && kept[0].places.len() < kept[1].places.len());
    let on = find(&[curve()], &question, &options, &(), Some(&kept[0])).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let one = pool.install(|| find(&[curve()], &question, &options, &(), None).unwrap());
    for other in [&on, &one] {
        assert_eq!(whole.minima.len(), other.minima.len());
        for (a, b) in whole.minima.iter().zip(&other.minima) {
            assert_eq!((a.state, a.chi2, a.probability), (b.state, b.chi2, b.probability));
        }
    }
    let otherwise = Options { seed: 1, ..options };
    let refused = find(&[curve()], &question, &otherwise, &(), Some(&kept[0]));
    assert!(refused.unwrap_err().to_string().contains("another search"));
}

/// What a seed makes: a spin about the body's z axis with any axis, phase, sense and a period of 10 to 200 s.
fn blind(seed: u64) -> (Measured, Spin, Question, f64) {
    let mut random = Random::seed_from_u64(seed);
    let axis = direction(&mut random);
    let period = 10.0 * 20.0_f64.powf(random.random::<f64>());
    let sense = if random.random::<bool>() { 1.0 } else { -1.0 };
    let phase = TAU * random.random::<f64>();
    let pass = usual(seed);
    let epoch = pass.times[0];
    let spin = Spin::along(DVec3::Z, axis, sense / period, phase, epoch).unwrap();
    let curve = measured(pass, spin, 0.03, &mut random);
    let question = question(DVec3::Z, epoch, 5.0);
    (curve, spin, question, period)
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

/// Seconds that all threads of this process have computed.
fn cpu_s() -> f64 {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after = text.rsplit(')').next().unwrap_or_default();
    let ticks: f64 =
        after.split_whitespace().skip(11).take(2).filter_map(|t| t.parse::<f64>().ok()).sum();
    ticks / 100.0
}

/// What came of a seed.
struct Judged {
    error_deg: f64,
    named: bool,
    seconds: f64,
    cpu_s: f64,
    /// The error of the axis over its stated uncertainty, squared, of two degrees of freedom.
    axis_chi2: f64,
}

fn judged(seed: u64) -> Judged {
    let (curve, spin, question, period) = blind(seed);
    let zero = Forward::new(std::slice::from_ref(&curve)).unwrap().zero;
    let (start, before) = (std::time::Instant::now(), cpu_s());
    let answer = find(&[curve], &question, &Options::default(), &(), None).unwrap();
    let (seconds, cpu) = (start.elapsed().as_secs_f64(), cpu_s() - before);
    let errors: Vec<f64> =
        (0..answer.minima.len()).map(|i| error_deg(&answer, i, &spin, zero)).collect();
    // The truth may be another minimum that is named a mirror solution of the first.
    let named = answer.minima.iter().zip(&errors).any(|(m, e)| *e < 5.0 && m.twin.is_some());
    let best = &answer.minima[0];
    let truth = spin.body_to_gcrs(zero + hifitime::Duration::from_seconds(answer.law.middle_s));
    // The rotation from what was found to the truth, in the frame of the covariance's first three.
    let off = truth * best.state.at_zero.conjugate();
    let axis = answer.law.axis(&best.state);
    let across = axis.any_orthonormal_vector();
    let frame = [across, axis.cross(across)];
    let turn = 2.0 * off.w.signum() * DVec3::new(off.x, off.y, off.z);
    let [a, b] = frame.map(|f| f.dot(turn));
    let c = &best.covariance;
    let axis_chi2 = if c.len() == 4 {
        let det = c[0][0] * c[1][1] - c[0][1] * c[1][0];
        (a * a * c[1][1] - 2.0 * a * b * c[0][1] + b * b * c[0][0]) / det
    } else {
        f64::INFINITY
    };
    println!(
        "seed {seed}: period {period:.2} s, error {:.3} deg, axis chi2 {axis_chi2:.1}, {:?}, {} minima, next {:.0}, extra {:.4}, reduced {:.2}, other light {:.3} {:.2}, {} epochs, finer {}, {seconds:.1} s, {cpu:.1} s of CPU",
        errors[0],
        answer.verdict,
        answer.minima.len(),
        answer.minima.get(1).map_or(f64::NAN, |m| m.delta_chi2),
        answer.extra_noise,
        answer.reduced_chi2,
        answer.other_light.0,
        answer.other_light.1,
        answer.simulated,
        answer.finer,
    );
    Judged { error_deg: errors[0], named, seconds, cpu_s: cpu, axis_chi2 }
}

/// Blind passes in six channels with 3 % noise beside the photons', of which only the photons' is stated: axis, phase, sense and period are looked for together, the period between 5 s and a body at rest.
/// Truth: the spin that each was simulated with. Tolerance: what was promised: 95 of 100 within 5° at both ends and in the middle of the data, or named as the mirror solution of the answer. What it costs is
/// printed, not judged: half of the CPU time of both cores (a quiet machine's wall clock; this one may be shared). The axis' ellipses are held against χ² of two degrees of freedom: of the errors'
/// χ² at most one in ten exceeds 9.2 (1 in 100 by chance; light between the parts is known to a hundredth only).
#[test]
fn campaign_attitude() {
    const WHOLE: u64 = 10;
    let mut campaign = Campaign::start("attitude", WHOLE);
    let full = campaign.seeds().end == WHOLE;
    let all: Vec<Judged> = (0..if full { WHOLE } else { 6 }).map(judged).collect();
    let n = all.len() as f64;
    let wrong = all.iter().filter(|j| j.error_deg > 5.0 && !j.named).count() as f64;
    let unsure = all.iter().filter(|j| j.error_deg <= 5.0 && j.axis_chi2 > 9.21).count() as f64;
    let sorted = |f: &dyn Fn(&Judged) -> f64| {
        let mut v: Vec<f64> = all.iter().map(f).collect();
        v.sort_by(f64::total_cmp);
        v
    };
    let (errors, two) = (sorted(&|j| j.error_deg), sorted(&|j| 0.5 * j.cpu_s));
    let wall = sorted(&|j| j.seconds);
    println!(
        "wrong {wrong} of {n}, unsure {unsure}, median error {:.4}, two cores {:.1} s in the middle, {:.1} s at most (wall {:.1}, {:.1})",
        errors[errors.len() / 2],
        two[two.len() / 2],
        two[two.len() - 1],
        wall[wall.len() / 2],
        wall[wall.len() - 1]
    );
    campaign.largest("wrong", wrong);
    campaign.largest("beyond_the_99_percent_ellipse", unsure);
    if full {
        campaign.largest("median_error_deg", errors[errors.len() / 2]);
        let found: Vec<f64> = errors.iter().copied().filter(|e| *e <= 5.0).collect();
        campaign
            .largest("largest_error_of_those_found_deg", found.last().copied().unwrap_or(f64::NAN));
    }
    // Written first: a promise that is missed is on record, too.
    campaign.finish();
    if full {
        assert!(wrong <= 0.05 * n, "{wrong} of {n} were not found");
        assert!(unsure <= 0.1 * n, "{unsure} of {n} ellipses");
    }
}
