//! A fit that computes light at few epochs, beside the same at all of them.

use crate::solver::night::{orbit, over, random, scene, visible};
use glam::DQuat;
use ndarray::Array2;
use rand::RngExt as _;
use sunglint_inference::solver::{
    Component, Data, Fit, Free, Law, Linear, Loss, Model as _, Options, Shaping, StudyModel, Unit,
    fit,
};
use sunglint_simulator::attitude::Attitude;
use sunglint_simulator::light::engine::Switch;
use sunglint_simulator::pass::{Pass, Study};

const V: usize = 2;

fn model(pass: &Pass) -> StudyModel {
    let tilted = |v: &[f64]| Ok(Attitude::Orbit(DQuat::from_rotation_y(v[0].to_radians())));
    let shaping = Shaping {
        attitude: Some(Law { uses: vec![0], make: Box::new(tilted) }),
        ..Shaping::default()
    };
    // The others keep their light: with all free so short a pass would not tell a pitch from them.
    let components = vec![Component { material: "mli".into(), spectrum: None }];
    StudyModel::new(vec![(Study::new(pass.clone()).unwrap(), Unit::Band(V), shaping)], components)
}

fn solved(data: &[Data], model: &mut StudyModel, from: f64, places: usize) -> Fit {
    let linear = [Linear {
        name: "mli".into(),
        component: 0,
        channels: vec![0],
        curves: None,
        unit: 1.0,
        most: None,
        prior: None,
    }];
    let mut pitch = Free::new("pitch_deg", from, -15.0, 15.0);
    // Where the Earth's quadrature goes from one order to the next its light steps by 2e-3: differences are taken over more than that.
    pitch.step = 0.05;
    let options =
        Options { loss: Loss::Huber, places, starts: places.min(1), seed: 1, ..Options::default() };
    fit(data, model, &[pitch], &linear, &options, &mut |_| ()).unwrap()
}

/// Samples of a satellite that keeps an axis to the Earth, each with a noise of 3 %, fitted with light at few epochs (found where the search begins, and once more where it ended)
/// and at all. Truth: the fit at all epochs, and what was put in: a pitch of 4° (the material that is solved for beside it is hardly seen). Tolerance: a tenth of a standard uncertainty from the former: lines that err by 3e-4 of
/// the light move the mean of 60 samples of 3 % by 0.08 of its own; ends of intervals to a tenth of their distance from the latter, which lies within them.
#[test]
fn a_fit_at_few_epochs_is_that_at_all() {
    let mut pass = scene("built_in = \"box_wing\"", orbit(14.27, 98.6, 318.0));
    pass.attitude = Attitude::Orbit(DQuat::IDENTITY);
    pass.effects.earthshine = Switch::On;
    // Of the Earth's light no more digits are needed here than cost little; the lines between epochs get 3e-4 of all light.
    pass.tolerance = 1e-2;
    let mut found = visible(&pass);
    found.sort_by(|a, b| b.1.total_cmp(&a.1));
    let pass = over(&pass, found[0].0, 60, 0.3, 0.1);

    let mut all = model(&pass);
    let columns = all.columns(&[4.0]).unwrap().remove(0);
    let truth: Array2<f64> = &columns.fixed + &columns.columns.sum_axis(ndarray::Axis(2));
    let mut random = random(7);
    let mut normal = || {
        let (a, b): (f64, f64) = (random.random(), random.random());
        (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    };
    let data =
        [Data::new("ten a second", truth.map(|r| r * (1.0 + 0.03 * normal())), 0.03 * &truth)];

    let (start, whole) = (std::time::Instant::now(), solved(&data, &mut all, 4.5, 0));
    let whole_s = start.elapsed().as_secs_f64();
    let start = std::time::Instant::now();
    let mut few = model(&pass);
    let thinned = few.thin(&[4.5], 0.03).unwrap()[0];
    let first = solved(&data, &mut few, 4.5, 0);
    let pitch = first.parameter("pitch_deg").unwrap().value;
    few.thin(&[pitch], 0.03).unwrap();
    let found = solved(&data, &mut few, pitch, 0);
    let few_s = start.elapsed().as_secs_f64();
    let here = few.thinned(&[found.parameter("pitch_deg").unwrap().value]).unwrap()[0].unwrap();
    println!("{thinned:?}, where it ended {here:?}; {whole_s:.2} s against {few_s:.2} s");
    assert!(here.error < 3e-4 && here.direct < 30, "{here:?}");
    let put_in = 4.0;
    let (a, b) = (whole.parameter("pitch_deg").unwrap(), found.parameter("pitch_deg").unwrap());
    let sigma = a.sigma.unwrap();
    println!(
        "pitch: {} ± {sigma} {:?} and {} {:?}",
        a.value, a.interval_95, b.value, b.interval_95
    );
    assert!((a.value - b.value).abs() < 0.1 * sigma, "pitch: {} {}", a.value, b.value);
    // A side comes into view near the minimum: χ² is no parabola, and intervals are gone through.
    let whole = whole.parameter("pitch_deg").unwrap().interval_95;
    for (a, b, reach) in [(whole[0], b.interval_95[0], -1.0), (whole[1], b.interval_95[1], 1.0)] {
        // One that is open is so in both.
        let (Some(a), Some(b)) = (a, b) else {
            assert_eq!((a, b), (None, None), "pitch");
            continue;
        };
        assert!((a - b).abs() < 0.1 * (b - put_in).abs().max(sigma), "pitch: {a} {b}");
        assert!(reach * (b - put_in) > 0.0, "pitch: {b}");
    }
}
