//! Passes that are not the usual ones.

use super::made::{ALL, errors_deg, measured, pass, question};
use glam::DVec3;
use rand::SeedableRng as _;
use rand_xoshiro::Xoshiro256PlusPlus as Random;
use sunglint_analysis::attitude::{
    Answer, Measured, Options, Question, Scale, Turn, Unknowns, find,
};
use sunglint_simulator::attitude::Spin;

const BODY: &str = "built_in = \"box_wing\"";

fn spin(period_s: f64, curve: &sunglint_simulator::pass::Pass) -> Spin {
    let axis = DVec3::new(-0.2, 0.6, -0.4).normalize();
    Spin::along(DVec3::Z, axis, 1.0 / period_s, 5.0, curve.times[0]).unwrap()
}

#[test]
fn x_short_arcs() {
    for (to, step, period) in [
        ("2020-11-18T16:25:08", 0.1, 20.0),
    ] {
        let pass = pass(BODY, "2020-11-18T16:25:00", to, step);
        let epoch = pass.times[0];
        let spin = spin(period, &pass);
        let curves = [measured(pass, spin, 0.03, &mut Random::seed_from_u64(7))];
        let question = question(DVec3::Z, epoch, 4.0 * step.max(0.2));
        match find(&curves, &question, &Options::default(), &(), None) {
            Ok(answer) => {
                errors_deg(&format!("{to} {period}"), &answer, &spin, &curves);
            }
            Err(e) => println!("{to} {period}: {e}"),
        }
    }
}

fn passes(axes: usize, from: &[(&str, &str)]) -> (Vec<Measured>, Spin, Answer) {
    let all: Vec<_> = from.iter().map(|(a, b)| pass(BODY, a, b, 1.0)).collect();
    let spin = spin(47.0, &all[0]);
    let epoch = all[0].times[0];
    let mut random = Random::seed_from_u64(11);
    let curves: Vec<Measured> =
        all.into_iter().map(|p| measured(p, spin, 0.03, &mut random)).collect();
    let question = question(DVec3::Z, epoch, 5.0);
    let options = Options { axes, ..Options::default() };
    let answer = find(&curves, &question, &options, &(), None).unwrap();
    (curves, spin, answer)
}

#[test]
fn x_several() {
    for from in [
        &[("2020-11-18T16:22:00", "2020-11-18T16:24:00")][..],
        &[
            ("2020-11-18T16:22:00", "2020-11-18T16:24:00"),
            ("2020-11-18T16:27:00", "2020-11-18T16:29:00"),
        ],
        &[
            ("2020-11-18T16:22:00", "2020-11-18T16:24:00"),
            ("2020-11-18T18:04:00", "2020-11-18T18:06:00"),
        ],
    ] {
        let (curves, spin, answer) = passes(400, from);
        errors_deg(&format!("{from:?}"), &answer, &spin, &curves);
    }
}

#[test]
fn x_scales() {
    let pass = pass(BODY, "2020-11-18T16:22:00", "2020-11-18T16:30:00", 4.0);
    let epoch = pass.times[0];
    let spin = spin(70.0, &pass);
    for (scale, factors) in [
        (Scale::Grey, [0.7; 6]),
        (Scale::Channels, [0.7, 1.2, 0.9, 1.1, 0.8, 1.4]),
        (Scale::Materials, [0.7; 6]),
    ] {
        let mut curve = measured(pass.clone(), spin, 0.03, &mut Random::seed_from_u64(7));
        for i in 0..curve.data.epochs() {
            for c in 0..6 {
                curve.data.rate[[i, c]] *= factors[c];
                curve.data.sigma[[i, c]] *= factors[c];
            }
        }
        let question = Question { scale, ..question(DVec3::Z, epoch, 20.0) };
        let curves = [curve];
        let answer =
            find(&curves, &question, &Options { axes: 400, ..Options::default() }, &(), None)
                .unwrap();
        errors_deg(&format!("{scale:?}"), &answer, &spin, &curves);
    }
}

#[test]
fn x_unknowns() {
    let pass = pass(BODY, "2020-11-18T16:22:00", "2020-11-18T16:30:00", 4.0);
    let epoch = pass.times[0];
    let spin = spin(70.0, &pass);
    let axis = DVec3::new(-0.2, 0.6, -0.4).normalize();
    for n in 1..8_u8 {
        let unknowns = Unknowns { axis: n & 1 > 0, phase: n & 2 > 0, period: n & 4 > 0 };
        let curves = [measured(pass.clone(), spin, 0.03, &mut Random::seed_from_u64(7))];
        let known = Turn { axis_gcrs: axis, turns_per_s: 1.0 / 70.0, phase_rad: 5.0 };
        let question = Question { unknowns, known, ..question(DVec3::Z, epoch, 20.0) };
        let answer =
            find(&curves, &question, &Options { axes: 400, ..Options::default() }, &(), None)
                .unwrap();
        errors_deg(&format!("{unknowns:?}"), &answer, &spin, &curves);
    }
    assert_eq!(ALL.count(), 4);
}

#[test]
fn x_longer_than_data() {
    let pass = pass(BODY, "2020-11-18T16:22:00", "2020-11-18T16:30:00", 4.0);
    let epoch = pass.times[0];
    for period in [700.0, 2000.0, 1e6] {
        let spin = spin(period, &pass);
        let curves = [measured(pass.clone(), spin, 0.03, &mut Random::seed_from_u64(7))];
        let question = question(DVec3::Z, epoch, 20.0);
        let answer =
            find(&curves, &question, &Options { axes: 400, ..Options::default() }, &(), None)
                .unwrap();
        errors_deg(&format!("{period} s in 480 s"), &answer, &spin, &curves);
    }
}

#[test]
fn x_rank() {
    use sunglint_analysis::attitude::{Compared, Forward, Law, coarse};
    for seed in [11, 33, 37] {
        let (curve, spin, question, period) = super::made::blind(seed);
        let forward = Forward::new(&[curve]).unwrap();
        let compared = Compared::new(&forward).unwrap();
        let (a, b) = forward.ends_s();
        let law = Law::new(DVec3::Z, question.epoch, forward.zero, 0.5 * (b - a)).unwrap();
        let truth = spin.body_to_gcrs(forward.zero) * DVec3::Z;
        let axes = coarse::axes(640, 0.0);
        let rates: Vec<f64> = coarse::rates(-0.2, 0.2, &law, ALL);
        for n in [16] {
            let step = forward.moments.len() as f64 / n as f64;
            let moments: Vec<usize> = (0..n).map(|i| ((i as f64 + (i * i) as f64 * 0.618 % 1.0) * step) as usize).collect();
            let look = coarse::Look {
                forward: &forward,
                compared: &compared,
                law: &law,
                unknowns: ALL,
                moments: &moments,
                rates: &rates,
                phase_rad: 0.0,
                scale: Scale::None,
            };
            let mut costs: Vec<(f64, f64, f64)> = axes
                .iter()
                .enumerate()
                .map(|(i, axis)| {
                    let p = look.axis(i, *axis).unwrap()[0];
                    (p.cost, axis.angle_between(truth).to_degrees(), 1.0 / p.turns_per_s)
                })
                .collect();
            costs.sort_by(|a, b| a.0.total_cmp(&b.0));
            let near: Vec<String> = costs
                .iter()
                .enumerate()
                .filter(|(_, c)| c.1 < 9.0)
                .map(|(r, c)| format!("{r}: {:.2} at {:.1} deg, {:.2} s", c.0, c.1, c.2))
                .collect();
            println!("seed {seed}, period {period:.2}, {n} epochs: costs {:.2} {:.2} {:.2} {:.2}; near {near:?}", costs[0].0, costs[64].0, costs[160].0, costs[320].0);
        }
    }
}
