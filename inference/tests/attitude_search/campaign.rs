//! Two hundred blind passes.

use super::made::{blind, blind_in, elsewhere, error_deg};
use glam::DVec3;
use std::f64::consts::TAU;
use sunglint_inference::attitude::descent::{Descent, Space};
use sunglint_inference::attitude::{
    Answer, Compared, Forward, Measured, Options, Question, State, Verdict, find,
};
use sunglint_simulator::attitude::Spin;
use sunglint_testkit::{Campaign, cpu_s};

/// Columns that are kept of each seed. `axis_chi2` is the error of the axis over its stated uncertainty, squared, of two degrees of freedom; `verdict` 0 one, 1 several, 2 undetermined; `truth_above` of those not found the
/// χ² of the true attitude above that of the answer (negative: the search has not seen it).
const COLUMNS: [&str; 12] = [
    "period_s",
    "error_deg",
    "named",
    "verdict",
    "axis_chi2",
    "extra_noise",
    "reduced_chi2",
    "finer",
    "next_chi2",
    "truth_above",
    "wall_s",
    "cpu_s",
];

fn judged(seed: u64, made: (Measured, Spin, Question, f64)) -> [f64; 12] {
    let (curve, spin, question, period) = made;
    let curves = [curve];
    let forward = Forward::new(&curves).unwrap();
    let zero = forward.zero;
    let (start, before) = (std::time::Instant::now(), cpu_s());
    let answer = find(&curves, &question, &Options::default(), &(), None).unwrap();
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
    let verdict = match answer.verdict {
        Verdict::One => 0.0,
        Verdict::Several(_) => 1.0,
        _ => 2.0,
    };
    let next = answer.minima.get(1).map_or(f64::NAN, |m| m.delta_chi2);
    let truth_above =
        if errors[0] > 5.0 { above(&forward, &answer, &question, &spin) } else { f64::NAN };
    println!(
        "seed {seed}: period {period:.2} s, error {:.3} deg, axis chi2 {axis_chi2:.1}, {:?}, {} minima, next {next:.0}, extra {:.4}, reduced {:.2}, other light {:.3} {:.2}, {} epochs, finer {}, truth above {truth_above:.0}, {seconds:.1} s, {cpu:.1} s of CPU",
        errors[0],
        answer.verdict,
        answer.minima.len(),
        answer.extra_noise,
        answer.reduced_chi2,
        answer.other_light.0,
        answer.other_light.1,
        answer.simulated,
        answer.finer,
    );
    [
        period,
        errors[0],
        f64::from(u8::from(named)),
        verdict,
        axis_chi2,
        answer.extra_noise,
        answer.reduced_chi2,
        f64::from(u8::from(answer.finer)),
        next,
        truth_above,
        seconds,
        cpu,
    ]
}

/// χ² of direct light, by logarithms, at the true attitude above that of the answer: negative where the search has missed it.
fn above(forward: &Forward, answer: &Answer, question: &Question, spin: &Spin) -> f64 {
    let compared = Compared::new(forward).unwrap();
    let moments: Vec<usize> = (0..forward.moments.len()).collect();
    let descent = Descent {
        forward,
        compared: &compared,
        law: &answer.law,
        unknowns: question.unknowns,
        moments: &moments,
        space: Space::Logarithms { spread: 0.07 },
        scale: question.scale,
        materials: &[],
        held: None,
    };
    let best = answer.minima[0].state;
    let at = forward.zero + hifitime::Duration::from_seconds(answer.law.middle_s);
    let later = at + hifitime::Duration::from_seconds(1e-3);
    let axis = answer.law.axis_body();
    let on = spin.body_to_gcrs(at).conjugate() * spin.body_to_gcrs(later);
    let turns_per_s = 2.0 * DVec3::new(on.x, on.y, on.z).dot(axis).atan2(on.w) / TAU / 1e-3;
    let truth = State { at_zero: spin.body_to_gcrs(at), turns_per_s };
    let mut eye = forward.eye();
    for (name, state) in [("answer", &best), ("truth", &truth)] {
        let down = descent.down(&mut eye, state, 30).unwrap();
        println!(
            "  {name}: {:.0}, from there down to {:.0}, {:.2} deg away",
            descent.cost(&mut eye, state).unwrap(),
            down.cost,
            answer.law.apart(state, &down.state).to_degrees()
        );
    }
    descent.cost(&mut eye, &truth).unwrap() - descent.cost(&mut eye, &best).unwrap()
}

/// Blind passes in six channels with 3 % noise beside the photons', of which only the photons' is stated: axis, phase, sense and period are looked for together, the period between 5 s and a body at rest.
/// Truth: the spin that each was simulated with. Tolerance: what was promised: 95 of 100 within 5° at both ends and in the middle of the data, or named as the mirror solution of the answer. What it costs is
/// printed, not judged: half of the CPU time of both cores (a quiet machine's wall clock; this one may be shared). The axis' ellipses are held against χ² of two degrees of freedom: of the errors'
/// χ² at most one in ten exceeds 9.2 (1 in 100 by chance; light between the parts is known to a hundredth only).
#[test]
fn campaign_attitude() {
    let mut campaign = Campaign::in_shards("attitude", 200, 1, &COLUMNS);
    for seed in campaign.seeds() {
        campaign.keep(seed, &judged(seed, blind(seed)));
    }
    let (errors, named) = (campaign.column("error_deg"), campaign.column("named"));
    let n = errors.len() as f64;
    let found: Vec<bool> = errors.iter().zip(&named).map(|(e, n)| *e <= 5.0 || *n > 0.0).collect();
    let wrong = found.iter().filter(|f| !**f).count() as f64;
    let right: Vec<f64> = campaign
        .column("axis_chi2")
        .into_iter()
        .zip(&errors)
        .filter(|(_, e)| **e <= 5.0)
        .map(|(c, _)| c)
        .collect();
    let beyond = |chi2: f64| right.iter().filter(|c| **c > chi2).count() as f64;
    let at = |mut v: Vec<f64>, part: f64| {
        v.sort_by(f64::total_cmp);
        v[((v.len() - 1) as f64 * part).round() as usize]
    };
    let two: Vec<f64> = campaign.column("cpu_s").iter().map(|s| 0.5 * s).collect();
    println!(
        "{n} passes: wrong {wrong}; errors {:.4} in the middle, {:.4} of 95 %; beyond the 95 % ellipse {}, the 99 % {}; two cores {:.1} s in the middle, {:.1} s at most (wall {:.1}, {:.1})",
        at(errors.clone(), 0.5),
        at(errors.clone(), 0.95),
        beyond(5.991),
        beyond(9.210),
        at(two.clone(), 0.5),
        at(two, 1.0),
        at(campaign.column("wall_s"), 0.5),
        at(campaign.column("wall_s"), 1.0),
    );
    let whole = campaign.is_whole();
    campaign.largest("wrong", wrong);
    campaign.largest("beyond_the_95_percent_ellipse", beyond(5.991));
    campaign.largest("beyond_the_99_percent_ellipse", beyond(9.210));
    let found: Vec<f64> = errors.iter().copied().filter(|e| *e <= 5.0).collect();
    campaign.largest("largest_error_of_those_found_deg", at(found, 1.0));
    let unsure = beyond(9.210);
    // Written first: a promise that is missed is on record, too.
    campaign.finish();
    if whole {
        assert!(wrong <= 0.05 * n, "{wrong} of {n} were not found");
        assert!(unsure <= 0.1 * n, "{unsure} of {n} ellipses");
    }
}

/// Blind passes as above in six other orbits. Truth and tolerance: as there; 95 of 100 are 34 of 36.
#[test]
fn campaign_attitude_orbits() {
    let mut campaign = Campaign::in_shards("attitude_orbits", 36, 1, &COLUMNS);
    for seed in campaign.seeds() {
        campaign.keep(seed, &judged(seed, blind_in(elsewhere(seed), 1000 + seed)));
    }
    let (errors, named) = (campaign.column("error_deg"), campaign.column("named"));
    let n = errors.len() as f64;
    let wrong = errors.iter().zip(&named).filter(|(e, n)| **e > 5.0 && **n == 0.0).count() as f64;
    let found = errors.iter().copied().filter(|e| *e <= 5.0);
    let whole = campaign.is_whole();
    campaign.largest("wrong", wrong);
    campaign.largest("largest_error_of_those_found_deg", found.fold(0.0, f64::max));
    campaign.finish();
    if whole {
        assert!(wrong <= 0.05 * n, "{wrong} of {n} were not found");
    }
}
