//! Differences of the exact sum, over random directions.

use super::bodies::*;
use glam::{DQuat, DVec3};
use sunglint_simulator::light::{Method, Parameter, Scene, View};
use sunglint_simulator::target::Target;

/// A change of directions by `x` along a parameter; the world turns the other way about the body.
fn moved(sun: DVec3, to: DVec3, parameter: Parameter, x: f64) -> (DVec3, DVec3) {
    match parameter {
        Parameter::Attitude(axis) => {
            let turn = DQuat::from_axis_angle(axis, -x);
            (turn * sun, turn * to)
        }
        Parameter::Sun(v) => ((sun + x * (v - v.dot(sun) * sun)).normalize(), to),
        Parameter::Observer(v) => (sun, (to + x * (v - v.dot(to) * to)).normalize()),
        _ => (sun, to),
    }
}

/// Derivatives by Richardson's extrapolation of central differences (h, h/2, h/4; Σ weights kept apart), and how far it is from converged.
fn richardson(f: &mut dyn FnMut(f64) -> Vec<f64>, h: f64) -> (Vec<f64>, f64) {
    let mut central = |h: f64| -> Vec<f64> {
        let (plus, minus) = (f(h), f(-h));
        plus.iter().zip(&minus).map(|(a, b)| (a - b) / (2.0 * h)).collect()
    };
    let (a, b, c) = (central(h), central(0.5 * h), central(0.25 * h));
    let fourth = |a: f64, b: f64| (4.0 * b - a) / 3.0;
    let mut off = 0.0_f64;
    let values = (0..a.len())
        .map(|k| {
            let (p, q) = (fourth(a[k], b[k]), fourth(b[k], c[k]));
            off = off.max((p - q).abs());
            (16.0 * q - p) / 15.0
        })
        .collect();
    (values, off)
}

/// Compares many random directions; gives how many derivatives were compared, how many lay at a kink, the worst difference.
fn compare(target: &Target, seeds: std::ops::Range<u64>) -> (usize, usize, f64) {
    let scene = Scene::new(target).unwrap();
    let mut eye = scene.evaluator();
    let (mut compared, mut kinks, mut worst) = (0, 0, 0.0_f64);
    for seed in seeds {
        let (sun, to) = directions(&mut rng(seed));
        let parameters = all();
        let (w, dw, _, done) = derive(&scene, sun, View::Distant(to), &parameters);
        assert_eq!(done.method, Method::Forward);
        let direct = direct(&scene, sun, View::Distant(to));
        w.iter().zip(&direct).for_each(|(a, b)| assert!((a - b).abs() <= 1e-14 * (1.0 + b)));
        for (p, row) in parameters.iter().zip(dw.chunks(w.len())) {
            let mut at = |x: f64| {
                let (sun, to) = moved(sun, to, *p, x);
                let mut out = vec![0.0; w.len()];
                eye.direct(sun, View::Distant(to), &mut out).unwrap();
                out
            };
            let size: f64 = w.iter().sum::<f64>() + row.iter().map(|d| d.abs()).sum::<f64>() + 1e-6;
            // The step at which it converges best: smaller where a kink is near, larger against rounding.
            let best = [4e-3, 1e-3, 2.5e-4]
                .map(|h| richardson(&mut at, h))
                .into_iter()
                .min_by(|a, b| a.1.total_cmp(&b.1))
                .unwrap();
            if best.1 > 3e-7 * size {
                kinks += 1;
                continue;
            }
            compared += 1;
            for (found, truth) in row.iter().zip(&best.0) {
                let off = (found - truth).abs() / size;
                worst = worst.max(off);
                assert!(off < 1e-6, "seed {seed}, {p:?}: {found} for {truth}");
            }
        }
    }
    (compared, kinks, worst)
}

fn check(name: &str, target: &Target, count: u64) {
    let (compared, kinks, worst) = compare(target, 0..count);
    eprintln!("{name}: {compared} derivatives, worst {worst:.1e}, {kinks} at kinks");
    assert!(kinks * 20 < compared, "{name}: {kinks} kinks of {compared}");
}

/// Truth: Richardson's extrapolation of differences of the exact sum, at three steps. 1e-6 of W + |dW| for each weight; where no step
/// converges to 3e-7 there is a kink within 0.25 mrad, and that is less than one in 20.
#[test]
fn built_in_bodies() {
    for name in ["box_wing", "box_wing_diffuse", "corner", "hexagon"] {
        check(name, &Target::built_in(name).unwrap(), 60);
    }
}

/// Truth: as above; wings on one hinge, a mast on another, that shade the body, one another and are shaded.
#[test]
fn hinged_bodies() {
    check("free hinges", &winged(None), 80);
    check("hinges with stops", &winged(Some((-0.6, 0.9))), 80);
}

/// Truth: as above; boxes that reach into each other and are open sheets or closed.
#[test]
fn boxes_in_each_other() {
    for seed in 0..12 {
        let target = tangle(seed);
        let (compared, kinks, worst) = compare(&target, 100 * seed..100 * seed + 8);
        assert!(kinks * 8 < compared, "{seed}: {kinks} kinks of {compared}, worst {worst:.1e}");
    }
}

/// Truth: as above; so many small boxes over a floor that its outline is halved to share their shadows out.
#[test]
fn many_shadows() {
    let mut target = Target::default();
    add(&mut target, boxed(DVec3::new(4.0, 4.0, 0.1)), at(DVec3::ZERO), white());
    let mut rng = rng(5);
    for k in 0..30 {
        let place = DVec3::new(f64::from(k % 6) - 2.5, f64::from(k / 6) - 2.0, 0.4);
        let size = 0.3 * direction(&mut rng).abs() + 0.1;
        add(&mut target, boxed(size), at(0.6 * place + 0.1 * direction(&mut rng)), white());
    }
    let (compared, kinks, worst) = compare(&target, 0..20);
    eprintln!("many shadows: {compared} derivatives, worst {worst:.1e}, {kinks} at kinks");
    assert!(kinks * 3 < compared, "{kinks} kinks of {compared}");
}

/// Five boxes in each other, every second one without a side.
fn tangle(seed: u64) -> Target {
    use sunglint_simulator::mesh::shapes::{Side, cuboid};
    use sunglint_simulator::target::{Placement, Shape};
    let mut rng = rng(seed);
    let mut target = Target::default();
    for k in 0..5 {
        let size = direction(&mut rng).abs() + 0.2;
        let sides = if k % 2 == 0 { &Side::ALL[..] } else { &Side::ALL[..5] };
        let placement = Placement {
            rotation: DQuat::from_axis_angle(direction(&mut rng), 1.0 + seed as f64),
            offset_m: 0.6 * direction(&mut rng),
        };
        add(&mut target, Shape::Mesh(cuboid(size, sides)), placement, white());
    }
    target
}
