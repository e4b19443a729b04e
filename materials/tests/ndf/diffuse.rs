//! Diffuse light beside a lobe: found, taken off, or said not to be known.

use crate::ndf::truth::{Shape, Truth, noisy, run};
use std::f64::consts::PI;
use sunglint_materials::ndf::{DiffuseOrigin, NdfOptions, Note, ZeroOrigin, extract};
use sunglint_testkit::Campaign;

fn angles(to: f64) -> Vec<f64> {
    (0..).map(|k| -10.0 + 0.5 * f64::from(k)).take_while(|a| *a <= to + 1e-9).collect()
}

fn options() -> NdfOptions {
    NdfOptions { resamplings: 0, diffuse: true, ..NdfOptions::default() }
}

/// Truth: closed forms: a lobe of microfacets (Walter et al. 2007) and ρ/π, without noise. Tolerance: α 1 %, ρ and F₀ 2 %.
#[test]
fn gloss_over_paint() {
    for (shape, alpha, f0, rho) in [
        (Shape::Ggx, 0.15, 0.04, 0.6),
        (Shape::Beckmann, 0.1, 0.04, 0.8),
        (Shape::Ggx, 0.05, 0.06, 0.05),
    ] {
        let truth = Truth::isotropic(shape, alpha, f0);
        let table = run(&angles(75.0), |a| truth.f(a.to_radians(), 0.0) + rho / PI);
        let ndf = extract(&table, &options()).unwrap();
        let p = &ndf.profiles[0];
        let fit = if matches!(shape, Shape::Ggx) { p.ggx } else { p.beckmann };
        println!("{shape:?} {alpha} {f0} {rho}: {fit:?} {:?} F₀ {}", p.diffuse, ndf.f0);
        assert_eq!(p.diffuse.origin, DiffuseOrigin::Fitted);
        assert!((p.diffuse.reflectance() / rho - 1.0).abs() < 0.02);
        assert!((fit.alpha / alpha - 1.0).abs() < 0.01);
        assert!((ndf.f0 / f0 - 1.0).abs() < 0.02, "{}", ndf.f0);
        assert!(ndf.notes.iter().any(|n| matches!(n, Note::Diffuse { .. })));
        let whole = NdfOptions { diffuse: false, ..options() };
        let whole = extract(&table, &whole).unwrap();
        assert!(whole.profiles[0].ggx.alpha > 1.5 * alpha, "as it was without a diffuse part");
    }
}

/// Truth: the closed forms. Nothing is taken off a lobe alone (metals), nor off diffuse light alone (F₀ 2.0821 ρ as before): there is no lobe, and no normal.
#[test]
fn one_part_alone_stays_whole() {
    for (shape, alpha) in [(Shape::Ggx, 0.05), (Shape::Ggx, 0.4), (Shape::Beckmann, 0.2)] {
        let truth = Truth::isotropic(shape, alpha, 0.8);
        let exact = truth.run(0.5, 0.7);
        for table in [exact.clone(), noisy(&exact, 0.01, 3)] {
            let ndf = extract(&table, &options()).unwrap();
            let p = &ndf.profiles[0];
            assert_ne!(
                p.diffuse.origin,
                DiffuseOrigin::Fitted,
                "{shape:?} {alpha} {:?}",
                p.diffuse
            );
            assert!((p.zero.angle_deg - 0.7).abs() < 0.2, "{:?}", p.zero);
        }
    }
    for seed in 0..10 {
        let table = noisy(&run(&angles(65.0), |_| 0.9 / PI), 0.01, seed);
        let ndf = extract(&table, &options()).unwrap();
        let p = &ndf.profiles[0];
        assert_ne!(p.diffuse.origin, DiffuseOrigin::Fitted, "{:?}", p.diffuse);
        assert_eq!(p.zero.origin, ZeroOrigin::Assumed, "{:?}", p.zero);
        assert!((ndf.f0 / (2.0821 * 0.9) - 1.0).abs() < 0.03, "{}", ndf.f0);
    }
}

/// Truth: closed forms; −10° to 75° by 0.5°, 1 % noise, a mount that is off by up to 2°, α from 0.04 to 0.5, F₀ 0.04 to 0.6, ρ from 0.02 to 0.8.
///
/// Promises: where diffuse light is said to be taken off, α within 5 % in 90 % and ρ within its bound and 3 % in 90 %; where the lobe's peak is at least as bright as the diffuse light and it is seen over
/// 25°, it is taken off in 90 %. The normal is never off by more than 1.5° without a word.
#[test]
fn campaign_diffuse_retro() {
    let mut campaign = Campaign::start("diffuse_retro", 200);
    let (mut taken, mut alpha_off, mut rho_off, mut wanted, mut found, mut zero_off) =
        (0, 0, 0, 0, 0, 0);
    for seed in campaign.seeds() {
        let part = |k: u64| (((seed * k) % 101) as f64 + 0.5) / 101.0;
        let shape = if seed % 2 == 0 { Shape::Beckmann } else { Shape::Ggx };
        let alpha = 0.04 * 12.5_f64.powf(part(37));
        let f0 = 0.04 * 15_f64.powf(part(53));
        let rho = 0.02 * 40_f64.powf(part(71));
        let zero = 2.0 * (seed as f64 * 2.39996).sin();
        let truth = Truth::isotropic(shape, alpha, f0);
        let f = |a: f64| truth.f((a - zero).to_radians(), 0.0) + rho / PI;
        let ndf = extract(&noisy(&run(&angles(75.0), f), 0.01, seed), &options()).unwrap();
        let p = &ndf.profiles[0];
        let off = (p.zero.angle_deg - zero).abs();
        zero_off += i32::from(off > 1.5 && p.zero.origin == ZeroOrigin::Fitted);
        let fit = if matches!(shape, Shape::Ggx) { p.ggx } else { p.beckmann };
        let is_taken = p.diffuse.origin == DiffuseOrigin::Fitted;
        let seen = (0..75).filter(|a| truth.f(f64::from(*a).to_radians(), 0.0) < 0.2 * rho / PI);
        let is_wanted = truth.f(0.0, 0.0) > rho / PI && seen.count() >= 25;
        wanted += i32::from(is_wanted);
        found += i32::from(is_wanted && is_taken);
        if is_taken {
            taken += 1;
            let (a, r) = (fit.alpha / alpha - 1.0, p.diffuse.reflectance() / rho - 1.0);
            alpha_off += i32::from(a.abs() > 0.05);
            let bound = PI * p.diffuse.bound_per_sr / rho + 0.03;
            rho_off += i32::from(r.abs() > bound);
            if a.abs() > 0.05 || r.abs() > bound {
                println!(
                    "{seed}: {shape:?} α {alpha:.3} F₀ {f0:.3} ρ {rho:.3}: α {a:+.3} ρ {r:+.3}"
                );
            }
        } else if is_wanted {
            println!("{seed}: {shape:?} α {alpha:.3} F₀ {f0:.3} ρ {rho:.3}: {:?}", p.diffuse);
        }
    }
    println!(
        "taken {taken}, α off {alpha_off}, ρ off {rho_off}; {found} of {wanted}; zero {zero_off}"
    );
    campaign.largest("alpha_off_percent", 100.0 * f64::from(alpha_off) / f64::from(taken.max(1)));
    campaign.largest("rho_off_percent", 100.0 * f64::from(rho_off) / f64::from(taken.max(1)));
    campaign
        .largest("missed_percent", 100.0 * f64::from(wanted - found) / f64::from(wanted.max(1)));
    campaign.largest("normals_off", f64::from(zero_off));
    campaign.finish();
    assert!(10 * alpha_off <= taken + 9 && 10 * rho_off <= taken + 9);
    // Of a part of the seeds one more may be missed.
    assert!(10 * found + 9 >= 9 * wanted && zero_off == 0);
}

/// Truth: the closed form of a lobe, to whose signal (f cosθ) a constant of 1 % of the peak was added: f has c/cosθ more. Tolerance: c within 10 % from −10° to 85°, without noise and with 1 %; nothing is said of the lobe without it, nor of Lambert light beside it.
#[test]
fn a_dark_offset_is_told_from_diffuse_light() {
    let floor = |notes: &[Note]| {
        notes.iter().find_map(|n| match n {
            Note::Floor { f_per_sr, .. } => Some(*f_per_sr),
            _ => None,
        })
    };
    for (shape, alpha) in [(Shape::Ggx, 0.15), (Shape::Beckmann, 0.15), (Shape::Beckmann, 0.3)] {
        let truth = Truth::isotropic(shape, alpha, 0.8);
        let dark = 0.01 * truth.f(0.0, 0.0);
        let lobe = |a: f64| truth.f(a.to_radians(), 0.0);
        let with = run(&angles(85.0), |a| lobe(a) + dark / a.to_radians().cos());
        for table in [with.clone(), noisy(&with, 0.01, 5)] {
            let notes = extract(&table, &options()).unwrap().notes;
            let found = floor(&notes).unwrap_or_else(|| panic!("{shape:?} {alpha}: {notes:?}"));
            println!("{shape:?} {alpha}: {found} of {dark}");
            assert!((found / dark - 1.0).abs() < 0.1, "{shape:?} {alpha}: {found} of {dark}");
        }
        for table in [run(&angles(85.0), lobe), run(&angles(85.0), |a| lobe(a) + 0.3 / PI)] {
            let notes = extract(&noisy(&table, 0.01, 6), &options()).unwrap().notes;
            assert_eq!(floor(&notes), None, "{shape:?} {alpha}: {notes:?}");
        }
    }
}
