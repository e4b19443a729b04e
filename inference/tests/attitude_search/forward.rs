//! The light of a trial, and the symmetries that leave it as it is.

use super::made::{direction, measured, pass};
use glam::DVec3;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus as Random;
use std::f64::consts::{PI, TAU};
use sunglint_inference::attitude::{Forward, Law, Turn};
use sunglint_simulator::attitude::{Attitude, Spin};
use sunglint_simulator::pass::{Overrides, Pass, PassFile};

/// A rotation by hand (Rodrigues' formula).
fn rodrigues(axis: DVec3, angle: f64, v: DVec3) -> DVec3 {
    let k = axis.normalize();
    v * angle.cos() + k.cross(v) * angle.sin() + k * k.dot(v) * (1.0 - angle.cos())
}

/// Truth: the closed form of a convex diffuse box, Σ A ρ/π max(0, n·s) max(0, n·o), turned by Rodrigues' formula. The rates of two attitudes go as these sums. Tolerance: rounding.
#[test]
fn a_turning_box_sends_what_its_faces_send() {
    let target = "[[target.part]]\nname = \"box\"\nshape = \"box\"\nsize_m = [1, 2, 3]\nmaterial = \"grey80\"";
    let path = sunglint_testkit::repository().join("fixtures/scenes/box_wing_dusk.toml");
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
    pass.effects = sunglint_simulator::light::engine::Switches::OFF;
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

/// Direct light alone. Truth: reciprocity (Helmholtz) and the mirror itself: half a turn about the bisector leaves the light of any body as it is, and the body's own mirror that of a body that has it. The built-in box with
/// wings is its mirror image along z but for shadows on unlike strips. Tolerance: rounding for the exchange; for the mirror what `symmetries` measured, tenfold, since it is a mean.
#[test]
fn twins_send_the_same_light_in_the_middle() {
    let mut direct =
        pass("built_in = \"box_wing\"", "2020-11-18T16:25:00", "2020-11-18T16:25:20", 0.5);
    direct.effects = sunglint_simulator::light::engine::Switches::OFF;
    let curve = measured(
        direct,
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
    let symmetries = sunglint_inference::attitude::twins::symmetries(&forward).unwrap();
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
            sunglint_inference::attitude::twins::twins(&forward, &law, &state, &symmetries)
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
    let once = sunglint_inference::attitude::twins::twins(&forward, &law, &state, &[])[0].1;
    let twice = sunglint_inference::attitude::twins::twins(&forward, &law, &once, &[])[0].1;
    assert!(law.apart(&state, &twice) < 1e-9);
}

/// Truth: the whole simulation of the same scene with the Earth's light switched on, all else off, less that with it off. Tolerance: 2 % of the Earth's light (five points along a side of a panel of the lit cap
/// where the simulation goes on to its own tolerance, and no air-tables of its own). The slopes are held against central differences of the light itself, 1 % of the largest: they are differences
/// over a thousandth of a radian, to one side.
#[test]
fn a_trial_has_the_earths_light_of_the_simulation() {
    use sunglint_simulator::light::engine::{Switch, Switches};
    let mut pass =
        pass("built_in = \"box_wing\"", "2020-11-18T16:22:00", "2020-11-18T16:30:00", 20.0);
    let off = Switches::OFF;
    let axis = DVec3::new(-0.2, 0.6, -0.4).normalize();
    let spin = Spin::along(DVec3::Z, axis, -1.0 / 33.0, 5.0, pass.times[3]).unwrap();
    pass.attitude = Attitude::Spin(spin);
    pass.effects = off;
    let without = pass.simulate(&|_| ()).unwrap();
    let mut pass = Pass { effects: Switches { earthshine: Switch::On, ..off }, ..pass.clone() };
    pass.tolerance = 1e-3;
    let with = pass.simulate(&|_| ()).unwrap();
    let curve = measured(pass.clone(), spin, 0.0, &mut Random::seed_from_u64(1));
    let forward = Forward::new(&[curve]).unwrap();
    let lit = forward.clone().with_earth(5);
    assert!(lit.has_earth() && !forward.has_earth());
    let law = Law::new(DVec3::Z, pass.times[3], forward.zero, 240.0).unwrap();
    let turn = Turn { axis_gcrs: axis, turns_per_s: -1.0 / 33.0, phase_rad: 5.0 };
    let state = law.state(&turn).unwrap();
    let (mut own, mut all) = (vec![0.0; forward.channels], vec![0.0; forward.channels]);
    let (mut apart, mut sum) = (0.0, 0.0);
    let (mut slopes_apart, mut steepest) = (0.0_f64, 0.0_f64);
    for (m, moment) in forward.moments.iter().enumerate() {
        let at = law.at(&state, moment.time_s);
        forward.eye().rates(m, at, &mut own).unwrap();
        lit.eye().rates(m, at, &mut all).unwrap();
        for c in 0..forward.channels {
            let truth = with.channels[c].rate_hz[moment.sample]
                - without.channels[c].rate_hz[moment.sample];
            apart += (all[c] - own[c] - truth).abs();
            sum += truth;
        }
        let earth = |q| -> Vec<f64> {
            let (mut lit, mut bare) = (lit.eye(), forward.eye());
            let bare = bare.weights(m, q).unwrap();
            lit.weights(m, q).unwrap().iter().zip(bare).map(|(a, b)| a - b).collect()
        };
        let (mut lit, mut bare) = (lit.eye(), forward.eye());
        let bare = bare.weights_and_slopes(m, at).unwrap().1;
        let slopes = lit.weights_and_slopes(m, at).unwrap().1;
        for (k, a) in DVec3::AXES.into_iter().enumerate() {
            let up = earth(glam::DQuat::from_axis_angle(a, 1e-3) * at);
            let down = earth(glam::DQuat::from_axis_angle(a, -1e-3) * at);
            for w in 0..forward.weights {
                let truth = (up[w] - down[w]) / 2e-3;
                let found = slopes[k * forward.weights + w] - bare[k * forward.weights + w];
                slopes_apart = slopes_apart.max((found - truth).abs());
                steepest = steepest.max(truth.abs());
            }
        }
    }
    println!("{apart} of {sum}, slopes {slopes_apart} of {steepest}");
    assert!(sum > 0.0 && apart < 0.02 * sum, "{apart} of {sum}");
    assert!(slopes_apart < 0.01 * steepest, "{slopes_apart} of {steepest}");
}
