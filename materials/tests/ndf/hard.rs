//! Runs that are not as they should be: a right answer, or a refusal with the reason.

use crate::ndf::truth::{Shape, Truth, density_error, noisy, run};
use proptest::prelude::*;
use sunglint_materials::ndf::{Ndf, NdfError, NdfFlags, NdfOptions, Note, extract};
use sunglint_materials::table::{RetroFlags, RetroTable};

fn options() -> NdfOptions {
    NdfOptions { resamplings: 0, ..NdfOptions::default() }
}

fn found(run: &RetroTable) -> Result<Ndf, NdfError> {
    extract(run, &options())
}

fn ggx(alpha: f64) -> Truth {
    Truth::isotropic(Shape::Ggx, alpha, 1.0)
}

fn error_of(truth: &Truth, ndf: &Ndf) -> f64 {
    density_error(truth, &ndf.theta_rad, &[0.0], &ndf.density)
}

#[test]
fn one_angle_and_none() {
    for angles in [&[][..], &[3.0], &[1.0; 20]] {
        let error = found(&run(angles, |_| 1.0)).unwrap_err();
        assert!(matches!(error, NdfError::TooFew { least: 8, .. }), "{error}");
    }
}

#[test]
fn nothing_but_zeros() {
    let angles: Vec<f64> = (0..151).map(|k| -10.0 + 0.5 * f64::from(k)).collect();
    let error = found(&run(&angles, |_| 0.0)).unwrap_err();
    assert!(error.to_string().contains("none of 151 readings is above 0"), "{error}");
    let error = found(&run(&angles, |_| -1e-3)).unwrap_err();
    assert!(matches!(error, NdfError::NoLight { .. }));
}

/// Truth: the closed form. Below the noise of the dark the readings are of both signs: the lobe is continued from where they begin. Tolerance 3 % in D:
/// the noise near a thousandth of the peak is 1e-5 of it, 1 %.
#[test]
fn negative_readings() {
    let truth = Truth::isotropic(Shape::Beckmann, 0.1, 1.0);
    let mut run = truth.run(0.5, 0.1);
    let peak = truth.f(0.0, 0.0);
    let dark = 1e-5 * peak;
    for (k, reading) in run.readings.iter_mut().enumerate() {
        reading.f_per_sr += dark * (2.4 * k as f64).sin();
        reading.sigma_f_per_sr = dark;
    }
    assert!(run.readings.iter().filter(|r| r.f_per_sr < 0.0).count() > 20);
    let ndf = found(&run).unwrap();
    assert!(ndf.notes.iter().any(|n| matches!(n, Note::BelowDetection { .. })), "{:?}", ndf.notes);
    assert!(error_of(&truth, &ndf) < 0.03, "{}", error_of(&truth, &ndf));
    assert!((ndf.f0 - 1.0).abs() < 1e-3);
    // A single one amid the lobe is left out and said.
    let mut run = ggx(0.2).run(0.5, 0.0);
    run.readings[40].f_per_sr = -3.0;
    let ndf = found(&run).unwrap();
    assert!(matches!(ndf.notes[..], [Note::LeftOut { angle_deg: 10.0, .. }]), "{:?}", ndf.notes);
    assert!(error_of(&ggx(0.2), &ndf) < 3e-3);
}

/// Truth: by hand. Of Beckmann with α = 0.004 the readings at 0 and 0.5° are in the ratio exp((0.5°/α)²): the neighbours say α, and a step of 0.43 α.
#[test]
fn a_mirror() {
    let truth = Truth::isotropic(Shape::Beckmann, 0.004, 1.0);
    let run = truth.run(0.5, 0.0);
    let error = found(&run).unwrap_err();
    let NdfError::TooCoarse { angle_deg, readings: 1, step_deg: 0.5, alpha, needed_deg } = error
    else {
        panic!("{error}")
    };
    assert!(angle_deg == 0.0 && (alpha / 0.004 - 1.0).abs() < 0.01, "{alpha}");
    assert!((needed_deg - 0.43 * 0.004_f64.to_degrees()).abs() < 0.002, "{needed_deg}");
    let words = error.to_string();
    assert!(
        words.contains("narrower than the step of 0.500°") && words.contains("a step of 0.099°"),
        "{words}"
    );
    // With the step that it asks for it is found. Tolerance 3e-3, as promised.
    let angles: Vec<f64> = (0..151).map(|k| -2.0 + 0.08 * f64::from(k)).collect();
    let fine = crate::ndf::truth::run(&angles, |a| truth.f(a.to_radians(), 0.0));
    let ndf = found(&RetroTable {
        readings: fine.readings.into_iter().filter(|r| r.f_per_sr > 1e-200).collect(),
        ..fine
    })
    .unwrap();
    assert!(error_of(&truth, &ndf) < 3e-3, "{}", error_of(&truth, &ndf));
}

#[test]
fn a_saturated_peak() {
    let mut flagged = ggx(0.05).run(0.5, 0.0);
    let mut cut = flagged.clone();
    let top = 0.4 * ggx(0.05).f(0.0, 0.0);
    for (reading, cut) in flagged.readings.iter_mut().zip(&mut cut.readings) {
        if reading.f_per_sr > top {
            (reading.flags, reading.f_per_sr) = (RetroFlags::OVER_RANGE, f64::NAN);
            cut.f_per_sr = top;
        }
    }
    for run in [flagged, cut] {
        let error = found(&run).unwrap_err();
        let NdfError::Saturated { angles_deg: (from, to), .. } = error else { panic!("{error}") };
        assert!((from + to).abs() < 1e-9 && to >= 1.0, "{error}");
    }
    // One reading over range far from the peak is left out.
    let mut run = ggx(0.2).run(0.5, 0.0);
    run.readings[100].flags = RetroFlags::OVER_RANGE;
    run.readings[100].f_per_sr = 1e6;
    let ndf = found(&run).unwrap();
    assert!(ndf.notes.len() == 1 && error_of(&ggx(0.2), &ndf) < 3e-3, "{:?}", ndf.notes);
}

/// Truth: the closed form, and the run in its order.
#[test]
fn angles_in_any_order() {
    let truth = ggx(0.1);
    let run = truth.run(0.5, 3.0);
    let straight = found(&run).unwrap();
    assert!((straight.profiles[0].zero.angle_deg - 3.0).abs() < 1e-3);
    let mut mixed = run.clone();
    let n = mixed.readings.len();
    for k in 0..n {
        mixed.readings.swap(k, (k * 7919 + 13) % n);
    }
    let ndf = found(&mixed).unwrap();
    assert_eq!(ndf.notes, [Note::Sorted]);
    assert_eq!(ndf.density, straight.density);
    // There and back: each angle twice.
    let mut twice = run.clone();
    twice.readings.extend(run.readings.iter().rev().copied());
    let ndf = found(&twice).unwrap();
    assert!(error_of(&truth, &ndf) < 3e-3);
}

/// Truth: the closed form. Tolerance: the stated bound, and 1 %.
#[test]
fn a_gap_of_ten_degrees() {
    let truth = ggx(0.3);
    let mut run = truth.run(0.5, 0.0);
    run.readings.retain(|r| !(30.0..40.0).contains(&r.angle_deg));
    let ndf = found(&run).unwrap();
    let is_gap =
        |n: &Note| matches!(n, Note::Gap { from_deg, .. } if (from_deg - 29.5).abs() < 1e-6);
    assert!(ndf.notes.iter().any(is_gap), "{:?}", ndf.notes);
    for (k, theta) in ndf.theta_rad.iter().enumerate() {
        let in_gap = (29.5..40.0).contains(&theta.to_degrees());
        assert_eq!(ndf.flags[k].contains(NdfFlags::GAP), in_gap);
        let off = (ndf.density[k] - truth.density(*theta, 0.0)).abs();
        if theta.to_degrees() < 60.0 {
            assert!(off < ndf.density_bound[k] + 0.01 * ndf.density[k], "{}", theta.to_degrees());
        }
    }
    // Amid the lobe it cannot be bridged; nor what begins beside the normal.
    let mut run = truth.run(0.5, 0.0);
    run.readings.retain(|r| r.angle_deg.abs() > 2.0);
    let error = found(&run).unwrap_err();
    assert!(matches!(error, NdfError::GapInPeak { from_deg: 0.0, .. }), "{error}");
    let mut run = truth.run(0.5, 0.0);
    run.readings.retain(|r| r.angle_deg >= 0.0 && !(3.0..13.0).contains(&r.angle_deg));
    assert!(matches!(found(&run).unwrap_err(), NdfError::GapInPeak { .. }));
}

/// Truth: the closed form, its normal at 0. From −10° to 0° and from 10° on, no angle is on both sides of the normal: lobes about other zeros leave less than the true one, by 1.1° wrong. Refused
/// with the gap; with the zero given D is right (tolerance 1 %: the gap beside the normal is known from the other side). A gap on one side alone that leaves more than half of the
/// angles on both sides is no matter: the zero within 0.02°.
#[test]
fn a_gap_that_hides_the_normal() {
    for (truth, step) in
        [(ggx(0.3), 0.5), (ggx(0.2), 0.5), (Truth::isotropic(Shape::Beckmann, 0.3, 1.0), 1.0)]
    {
        let whole = truth.run(step, 0.0);
        let mut run = whole.clone();
        run.readings.retain(|r| !(0.1..9.9).contains(&r.angle_deg));
        let error = found(&run).unwrap_err();
        match error {
            NdfError::GapBesideNormal { from_deg, to_deg } => {
                assert!(from_deg == 0.0 && to_deg == 10.0, "{error}");
                assert!(error.to_string().contains("--zero-deg"), "{error}");
            }
            // About another zero the gap lies amid the lobe.
            _ => assert!(matches!(error, NdfError::GapInPeak { .. }), "{error}"),
        }
        let given = NdfOptions { zero_deg: Some(0.0), ..options() };
        let ndf = extract(&run, &given).unwrap();
        assert!(error_of(&truth, &ndf) < 0.01, "{}", error_of(&truth, &ndf));

        let mut run = whole;
        run.readings.retain(|r| !(2.1..5.9).contains(&r.angle_deg));
        let zero = found(&run).unwrap().profiles[0].zero.angle_deg;
        assert!(zero.abs() < 0.02, "{zero}");
    }
}

/// A median that was asked for flattens a narrow peak; none is taken by itself.
#[test]
fn smoothing_is_asked_for() {
    let run = noisy(&ggx(0.05).run(0.5, 0.0), 0.002, 3);
    let plain = found(&run).unwrap();
    let smooth = NdfOptions { median: Some(5), ..options() };
    let smooth = extract(&run, &smooth).unwrap();
    assert!(smooth.density[0] < 0.98 * plain.density[0]);
    let wrong = NdfOptions { median: Some(4), ..options() };
    assert!(matches!(extract(&run, &wrong), Err(NdfError::Option { name: "median", .. })));
}

/// Truth: the cone's half-vector is blurred by half the cone's half-angle.
#[test]
fn the_rig_s_own_width() {
    let mut run = ggx(0.05).run(0.5, 0.0);
    run.cone_half_angle_deg = Some(2.0);
    let ndf = found(&run).unwrap();
    assert!((ndf.smallest_alpha.unwrap() - 0.017455).abs() < 1e-6);
    assert!(ndf.notes.is_empty(), "{:?}", ndf.notes);
    run.cone_half_angle_deg = Some(4.0);
    assert!(matches!(found(&run).unwrap().notes[..], [Note::Blurred { .. }]));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever stands in a table: no panic, and what comes out is a density.
    #[test]
    fn any_readings(values in prop::collection::vec((-80.0_f64..80.0, -1e3_f64..1e6, 0.0_f64..10.0, 0_u32..64), 0..60)) {
        let mut run = run(&[], |_| 0.0);
        for (angle, f, sigma, flags) in values {
            let mut one = crate::ndf::truth::run(&[angle.round()], |_| f);
            one.readings[0].sigma_f_per_sr = sigma;
            if flags < 8 {
                one.readings[0].flags = RetroFlags::from_bits_truncate(flags);
            }
            run.readings.extend(one.readings);
        }
        let options = NdfOptions { elevations: Some(16), resamplings: 3, ..NdfOptions::default() };
        if let Ok(ndf) = extract(&run, &options) {
            prop_assert!(ndf.f0 > 0.0 && ndf.f0.is_finite());
            prop_assert!(ndf.density.iter().all(|d| d.is_finite() && *d >= 0.0));
        }
    }
}
