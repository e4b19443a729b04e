//! Lobes that are seen through a cone of light.

use crate::ndf::truth::{Shape, Truth, density_error, noisy, run};
use glam::DVec3;
use sunglint_materials::ndf::{NdfOptions, ZeroOrigin, extract};
use sunglint_materials::table::{ConeSpread, RetroTable, StatedZero};

/// f̄ over a rectangle of directions, half-widths in radians along and across the plane of incidence, by the middles of many cells: mean of f(i, o) cosθ_o/cosθ_i with the closed forms of D and
/// G₁, and G = min(G₁(i), G₁(o)).
fn seen(truth: &Truth, theta: f64, along: f64, across: f64) -> f64 {
    const CELLS: usize = 60;
    let i = DVec3::new(theta.sin(), 0.0, theta.cos());
    let sides = [DVec3::new(theta.cos(), 0.0, -theta.sin()), DVec3::Y];
    let angle = |v: DVec3| (v.x.hypot(v.y).atan2(v.z).max(1e-12), v.y.atan2(v.x));
    let masking = |v: DVec3| {
        let (theta, phi) = angle(v);
        truth.masking(theta, phi)
    };
    let place = |k: usize| (2.0 * k as f64 + 1.0) / CELLS as f64 - 1.0;
    let mut sum = 0.0;
    for u in (0..CELLS).map(place) {
        for v in (0..CELLS).map(place) {
            let o = (i + u * along * sides[0] + v * across * sides[1]).normalize();
            let (theta_h, phi_h) = angle(i + o);
            sum += truth.density(theta_h, phi_h) * masking(i).min(masking(o));
        }
    }
    truth.f0 * sum / (CELLS * CELLS) as f64 / (4.0 * i.z * i.z)
}

/// −10° to 65° by 0.5° through a rectangle of directions; the normal at 0.3°.
fn through(truth: &Truth, along_deg: f64, across_deg: f64) -> RetroTable {
    let angles: Vec<f64> = (0..151).map(|k| -10.0 + 0.5 * f64::from(k)).collect();
    let (along, across) = (along_deg.to_radians(), across_deg.to_radians());
    run(&angles, |angle| seen(truth, (angle - 0.3).to_radians().abs(), along, across))
}

fn options() -> NdfOptions {
    NdfOptions { resamplings: 0, ..NdfOptions::default() }
}

/// Truth: the law itself, and of α as it is seen √(α² + 2 s²) with s the rms of half-vectors along the plane (a Gaussian's width). The cone is a square, and a plate three times as wide as
/// high, which is not what its solid angle says. Tolerance: α 5e-5, since the square is taken for an ellipse, 2·(s/α)⁴ of it with (s/α)² 0.01 or less; D and F₀ 1e-3, four times as much of the
/// spread on both axes and of half a degree's step (α = 0.03 is 1.7°). What is seen, 5 % of its excess over α for Beckmann, whose peak is a Gaussian; GGX's is not.
#[test]
fn a_lobe_is_told_from_the_cone() {
    for shape in [Shape::Beckmann, Shape::Ggx] {
        for (alpha, along_deg, across_deg) in
            [(0.03, 0.28, 0.28), (0.03, 0.5, 0.16), (0.06, 0.28, 0.28), (0.3, 0.5, 0.5)]
        {
            let truth = Truth::isotropic(shape, alpha, 0.8);
            let mut table = through(&truth, along_deg, across_deg);
            let rms = |half: f64| half / 3_f64.sqrt();
            table.cone_spread =
                Some(ConeSpread { along_deg: rms(along_deg), across_deg: rms(across_deg) });
            let found = extract(&table, &options()).unwrap();
            let of = |ndf: &sunglint_materials::ndf::Ndf| match shape {
                Shape::Beckmann => ndf.profiles[0].beckmann,
                Shape::Ggx => ndf.profiles[0].ggx,
            };
            let fit = of(&found);
            let case = format!("{shape:?} {alpha} {along_deg} {across_deg}: {fit:?}");
            assert!((fit.alpha / alpha - 1.0).abs() < 5e-5, "{case}");
            assert!((found.f0 / 0.8 - 1.0).abs() < 1e-3, "{case}: F0 {}", found.f0);
            let worst = density_error(&truth, &found.theta_rad, &[0.0], &found.density);
            assert!(worst < 1e-3, "{case}: D {worst:e}");
            assert!(found.profiles[0].zero.angle_deg - 0.3 < 1e-3, "{case}");
            // A table that does not state its cone: the lobe as it is seen.
            table.cone_spread = None;
            let plain = of(&extract(&table, &options()).unwrap());
            let seen_alpha = fit.seen_alpha.unwrap();
            assert_eq!(plain.seen_alpha, None);
            assert!((plain.alpha / seen_alpha - 1.0).abs() < 1e-9, "{case} {plain:?}");
            if matches!(shape, Shape::Beckmann) && alpha < 0.1 {
                let half_vector = 0.5 * rms(along_deg).to_radians();
                let wide = (alpha * alpha + 2.0 * half_vector * half_vector).sqrt();
                assert!((seen_alpha - wide).abs() < 0.05 * (wide - alpha), "{case}: {wide}");
            }
        }
    }
}

/// Truth: how α goes with the normal, by the same readings with the normal given half a degree to either side; and the law. Beckmann's α = 0.57 is level about the normal (1/α² = 3, with
/// what the cosines add), so that the readings do not decide where it is, and the run's own word is taken: 0 ± 0.5° where it is at 0.4°. Then the interval of α has to hold the law's, which
/// without that uncertainty it misses. Tolerance of σ: a fifth, of 400 draws and of a slope that is no straight line.
#[test]
fn a_normal_that_is_only_stated_is_in_the_interval() {
    let truth = Truth::isotropic(Shape::Beckmann, 0.57, 0.8);
    let mut table = noisy(&truth.run(0.5, 0.4), 0.003, 3);
    table.zero = Some(StatedZero { angle_deg: 0.0, sigma_deg: 0.5, origin: ZeroOrigin::Assumed });
    let options = NdfOptions { resamplings: 400, ..NdfOptions::default() };
    let found = extract(&table, &options).unwrap();
    let profile = &found.profiles[0];
    assert_eq!(profile.zero.origin, ZeroOrigin::Assumed);
    let (fit, sigma) = (profile.beckmann, profile.beckmann.sigma.unwrap());
    // f of the run was divided by the cosine of the stage's angle: that goes with the normal.
    let given = |zero_deg: f64| {
        let mut table = table.clone();
        for r in &mut table.readings {
            let turned = (r.angle_deg - zero_deg).to_radians().cos();
            let factor = r.angle_deg.to_radians().cos() / turned;
            (r.f_per_sr, r.sigma_f_per_sr) = (r.f_per_sr * factor, r.sigma_f_per_sr * factor);
        }
        let options = NdfOptions { zero_deg: Some(zero_deg), resamplings: 60, ..options.clone() };
        extract(&table, &options).unwrap().profiles[0].beckmann
    };
    let [low, middle, high] = [-0.5, 0.0, 0.5].map(given);
    let by_zero = 0.5 * (high.alpha - low.alpha).abs();
    let expected = by_zero.hypot(middle.sigma.unwrap());
    assert!((sigma / expected - 1.0).abs() < 0.2, "{sigma} {expected}");
    assert!(middle.sigma.unwrap() < 0.2 * by_zero, "{middle:?} {by_zero}");
    assert!((fit.alpha - 0.57).abs() < 1.96 * sigma, "{fit:?} {sigma}");
    // A table that states nothing: as before, the stage's zero, and no word of how well it is known.
    table.zero = None;
    let bare = extract(&table, &options).unwrap();
    assert_eq!(bare.profiles[0].zero.origin, ZeroOrigin::Assumed);
    assert!((bare.profiles[0].beckmann.alpha / fit.alpha - 1.0).abs() < 1e-12);
    assert!(bare.profiles[0].beckmann.sigma.unwrap() < 0.2 * sigma);
}
