//! The fibre's field, against rasters that were drawn from a known one, and against scipy.
#![allow(clippy::unwrap_used)]

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use sunglint_calibration::alignment::{
    Between, FieldMap, FieldPoint, FitError, FitOptions, fit_field,
};
use sunglint_testkit::{peer_python, run_python};

/// The field that points are drawn from: x₀, y₀, σ_x, σ_y.
const TRUTH: [f64; 4] = [-1.6, 7.9, 14.5, 16.8];
const AMPLITUDES: [f64; 3] = [3000.0, 800.0, 12_000.0];

struct Draw(Xoshiro256PlusPlus);

impl Draw {
    fn new(seed: u64) -> Self {
        Self(Xoshiro256PlusPlus::seed_from_u64(seed))
    }

    fn uniform(&mut self) -> f64 {
        self.0.random::<f64>()
    }

    /// Box and Muller's.
    fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.uniform()).ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
    }

    /// Points of stars all over 80 × 80 px: true places, rates of the field there with noise, places as measured.
    fn points(&mut self, number: usize, place_px: f64, turn_deg: f64) -> Vec<FieldPoint> {
        let (sin, cos) = turn_deg.to_radians().sin_cos();
        let mut points = Vec::new();
        for i in 0..number {
            let [x, y] = [0, 1].map(|k| TRUTH[k] + 80.0 * (self.uniform() - 0.5));
            let (dx, dy) = (x - TRUTH[0], y - TRUTH[1]);
            let (u, v) = ((cos * dx + sin * dy) / TRUTH[2], (cos * dy - sin * dx) / TRUTH[3]);
            let rate = AMPLITUDES[i % 3] * (-0.5 * (u * u + v * v)).exp();
            let sigma_hz = 0.02 * AMPLITUDES[i % 3];
            points.push(FieldPoint {
                offset_px: [x + place_px * self.normal(), y + place_px * self.normal()].into(),
                covariance_px2: [place_px * place_px, place_px * place_px, 0.0],
                rate_hz: rate + sigma_hz * self.normal(),
                sigma_hz,
                star: 10 + i % 3,
                between: None,
            });
        }
        points
    }
}

/// Truth: the field that the points were drawn from, 120 draws of 300 points: intervals of 1 σ cover 68.3 % of centre and widths (binomial, 3.5 σ;
/// robust weights and an estimated scatter included), the mean pull is nothing (4 σ). Once with exact places, once with centroids of 0.5 px.
#[test]
fn intervals_of_the_field_cover_the_truth() {
    for place_px in [0.0, 0.5] {
        let mut covered = [0.0_f64; 4];
        let mut pulls = [0.0_f64; 4];
        let draws = 120;
        for seed in 0..draws {
            let points = Draw::new(seed).points(300, place_px, 0.0);
            let fit = fit_field(&points, &FitOptions::default()).unwrap();
            let found = [fit.offset_px.to_array(), fit.sigma_px.to_array()].concat();
            let sigma = fit.uncertainties();
            for i in 0..4 {
                let pull = (found[i] - TRUTH[i]) / sigma[i];
                pulls[i] += pull;
                covered[i] += f64::from(pull.abs() <= 1.0);
            }
            assert!(
                (fit.scatter - 1.0).abs() < if place_px > 0.0 { 1.0 } else { 0.35 },
                "{}",
                fit.scatter
            );
        }
        let n = draws as f64;
        println!("places {place_px}: pulls {pulls:?}, covered {covered:?}");
        for i in 0..4 {
            let far = (covered[i] / n - 0.683).abs();
            assert!(far < 3.5 * (0.683 * 0.317 / n).sqrt(), "{place_px}: {covered:?}");
            assert!(pulls[i].abs() / n < 4.0 / n.sqrt(), "{place_px}: {pulls:?}");
        }
    }
}

/// Truth: the field that the points were drawn from, 80 draws of three stars that wander over it for 600 points each, with an error that lasts 15 points (first
/// order autoregressive) three times the stated one. Tolerance: binomial, 3.5 σ, and half a σ of coverage more below, since the long-run variance of so few
/// independent stretches is itself known to a fifth only. Taken as independent, a third of the intervals would cover: that is asserted too, so that the test can fail.
#[test]
fn points_that_err_together_are_not_counted_each() {
    let (mut covered, mut alone, draws) = ([0.0_f64; 4], [0.0_f64; 4], 80);
    for seed in 0..draws {
        let mut draw = Draw::new(1000 + seed);
        let mut points = Vec::new();
        for (star, amplitude) in AMPLITUDES.into_iter().enumerate() {
            let (sigma_hz, keep) = (0.02 * amplitude, f64::exp(-1.0 / 15.0));
            let mut lasting = draw.normal();
            let turn = std::f64::consts::TAU * draw.uniform();
            for i in 0..600 {
                let t = f64::from(i) / 600.0 * std::f64::consts::TAU;
                let offset = [30.0 * (3.0 * t + turn).sin(), 30.0 * (5.0 * t).cos()];
                let [u, v] = [0, 1].map(|k| offset[k] / TRUTH[2 + k]);
                let rate = amplitude * (-0.5 * (u * u + v * v)).exp();
                lasting = keep * lasting + (1.0 - keep * keep).sqrt() * draw.normal();
                points.push(FieldPoint {
                    offset_px: [TRUTH[0] + offset[0], TRUTH[1] + offset[1]].into(),
                    covariance_px2: [0.0; 3],
                    rate_hz: rate + sigma_hz * (draw.normal() + 3.0 * lasting),
                    sigma_hz,
                    star,
                    between: None,
                });
            }
        }
        let fit = fit_field(&points, &FitOptions::default()).unwrap();
        assert!((15..150).contains(&fit.correlated_points), "{}", fit.correlated_points);
        // The same points in no order: what they have together is not seen.
        let mut shuffled = points.clone();
        for i in (1..shuffled.len()).rev() {
            shuffled.swap(i, (draw.uniform() * (i + 1) as f64) as usize);
        }
        let unordered = fit_field(&shuffled, &FitOptions::default()).unwrap();
        for (fit, covered) in [(&fit, &mut covered), (&unordered, &mut alone)] {
            let (found, sigma) =
                ([fit.offset_px.to_array(), fit.sigma_px.to_array()].concat(), fit.uncertainties());
            for i in 0..4 {
                covered[i] += f64::from((found[i] - TRUTH[i]).abs() <= sigma[i]) / draws as f64;
            }
        }
    }
    println!("covered {covered:?}, as if independent {alone:?}");
    let sigma = (0.683 * 0.317 / draws as f64).sqrt();
    for i in 0..4 {
        assert!(covered[i] - 0.683 > -4.0 * sigma && covered[i] - 0.683 < 3.5 * sigma);
        assert!(alone[i] < 0.683 - 4.0 * sigma, "{alone:?}");
    }
}

/// A night of ten stars that a telescope wanders about (synthetic), as a station has it: 24 s each, bins of 1 s, a frame every 4 s.
///
/// The telescope's place is a process of Ornstein and Uhlenbeck (2 px in each axis, 20 s) about an aim that scatters by 2 px, in steps of 0.05 s; a rate is the mean of the field over its bin, twinkles
/// by 0.8 % times airmass^1.5, and has counts of its own. A place is on the line between the frames' places, which are off by 0.02 px.
fn wandering(draw: &mut Draw) -> Vec<FieldPoint> {
    const STEP_S: f64 = 0.05;
    const NOISE_PX: f64 = 0.02;
    let keep = f64::exp(-STEP_S / 20.0);
    let mut points = Vec::new();
    for star in 0..10 {
        let airmass = 1.0 + 0.1 * star as f64;
        let amplitude = 2e5 * 10_f64.powf(draw.uniform());
        let aim = [0, 1].map(|k| TRUTH[k] + [-0.5, 0.7][k] + 2.0 * draw.normal());
        let mut off = [draw.normal(), draw.normal()];
        let path: Vec<[f64; 2]> = (0..480)
            .map(|_| {
                off = off.map(|off| keep * off + (1.0 - keep * keep).sqrt() * draw.normal());
                [0, 1].map(|k| aim[k] + 2.0 * off[k])
            })
            .collect();
        let first = (draw.uniform() * 80.0) as usize;
        let frames: Vec<[f64; 2]> = (first..480)
            .step_by(80)
            .map(|i| path[i].map(|x| x + NOISE_PX * draw.normal()))
            .collect();
        for bin in 0..24 {
            let Some(after) = (20 * bin + 10_usize).checked_sub(first) else { continue };
            let (frame, part) = (after / 80, (after % 80) as f64 / 80.0);
            let (Some(from), Some(to)) = (frames.get(frame), frames.get(frame + 1)) else {
                continue;
            };
            let field = |at: &[f64; 2]| {
                let [u, v] = [0, 1].map(|k| (at[k] - TRUTH[k]) / TRUTH[2 + k]);
                (-0.5 * (u * u + v * v)).exp()
            };
            let seen = path[20 * bin..20 * bin + 20].iter().map(field).sum::<f64>() / 20.0;
            let light = amplitude * seen * (1.0 + 0.008 * f64::powf(airmass, 1.5) * draw.normal());
            let sigma_hz = light.sqrt();
            // 2σ²/T, the slope of the process's structure function at 0.
            let wander = 2.0 * 4.0 / 20.0;
            let noise = [NOISE_PX * NOISE_PX, NOISE_PX * NOISE_PX, 0.0];
            let bridge = wander * part * (1.0 - part) * 4.0;
            points.push(FieldPoint {
                offset_px: [0, 1].map(|k| from[k] + part * (to[k] - from[k])).into(),
                covariance_px2: [noise[0] + bridge, noise[1] + bridge, 0.0],
                rate_hz: light + sigma_hz * draw.normal(),
                sigma_hz,
                star,
                between: Some(Between {
                    frame,
                    part,
                    span_s: 4.0,
                    exposure_s: 1.0,
                    frames_px2: [noise; 2],
                    wander_px2_per_s: wander,
                }),
            });
        }
    }
    points
}

/// Truth: the field that the nights were drawn from, by a path that no formula of the fit makes: 95 % intervals of middles and widths hold 90 to 99 % of 80 nights, and no more than 6 % of the truths lie on
/// one side (binomial of 160 numbers of a kind, some 3 σ). With the stated σ alone, as if each rate and place were off for itself, less than 88 % hold (4 σ less), and two of three widths that do not are too small: so
/// the test can fail. A night in twenty may leave the field open.
#[test]
fn twinkling_and_the_way_between_frames_are_in_the_intervals() {
    // Middles and widths: truths below and above the intervals, and beyond 1.96 σ of the fit that knows of neither.
    let (mut missed, mut before, mut n) = ([[0.0_f64; 2]; 2], [[0.0_f64; 2]; 2], 0.0);
    for seed in 0..80 {
        let mut points = wandering(&mut Draw::new(5000 + seed));
        let options = FitOptions { background: true, ..FitOptions::default() };
        let with = fit_field(&points, &options);
        points.iter_mut().for_each(|point| point.between = None);
        points.iter_mut().for_each(|point| point.covariance_px2 = [0.0; 3]);
        let without = fit_field(&points, &FitOptions { twinkling: false, ..options });
        let (Ok(with), Ok(without)) = (with, without) else { continue };
        n += 2.0;
        for (k, interval) in with.intervals_px.iter().enumerate() {
            missed[k / 2][0] += f64::from(interval.low_px.is_some_and(|low| TRUTH[k] < low));
            missed[k / 2][1] += f64::from(interval.high_px.is_some_and(|high| TRUTH[k] > high));
        }
        let found = [without.offset_px.to_array(), without.sigma_px.to_array()].concat();
        for (k, sigma) in without.uncertainties().into_iter().take(4).enumerate() {
            let pull = (found[k] - TRUTH[k]) / sigma;
            before[k / 2][0] += f64::from(pull > 1.96);
            before[k / 2][1] += f64::from(pull < -1.96);
        }
    }
    println!("missed {missed:?}, before {before:?} of {n}");
    assert!(n > 0.95 * 160.0, "{n}");
    for sides in missed {
        let held = 1.0 - (sides[0] + sides[1]) / n;
        assert!((0.90..0.99).contains(&held) && sides.iter().all(|s| *s < 0.06 * n), "{missed:?}");
    }
    for sides in before {
        assert!(sides[0] + sides[1] > 0.12 * n, "{before:?}");
    }
    assert!(before[1][1] > 2.0 * before[1][0], "{before:?}");
}

/// Truth: the field that the points were drawn from, to 5 of the stated σ, with an eighth of the points spoilt upwards (another star in the fibre); least
/// squares miss it by more than ten.
#[test]
fn spoilt_points_do_not_pull() {
    let mut draw = Draw::new(3);
    let mut points = draw.points(400, 0.0, 0.0);
    for point in points.iter_mut().step_by(8) {
        point.rate_hz += 30.0 * point.sigma_hz * (1.0 + draw.uniform());
    }
    let off = |robust| {
        let fit = fit_field(&points, &FitOptions { robust, ..FitOptions::default() }).unwrap();
        let found = [fit.offset_px.to_array(), fit.sigma_px.to_array()].concat();
        (0..4).map(|i| (found[i] - TRUTH[i]).abs()).zip(fit.uncertainties()).collect::<Vec<_>>()
    };
    let robust = off(true);
    assert!(robust.iter().all(|(off, sigma)| *off < 5.0 * sigma), "{robust:?}");
    let plain = off(false);
    assert!(plain.iter().zip(&robust).any(|(p, r)| p.0 > 10.0 * r.1), "{plain:?} {robust:?}");
}

/// Truth: the field that the points were drawn from, turned by 25° (5 σ), with a background of 200 Hz added to all; its widths along the frame's axes by
/// the rotation of its covariance.
#[test]
fn a_turned_field_and_a_background_are_found() {
    let mut points = Draw::new(9).points(600, 0.0, 25.0);
    points.iter_mut().for_each(|point| point.rate_hz += 200.0);
    let options = FitOptions { rotation: true, background: true, ..FitOptions::default() };
    let fit = fit_field(&points, &options).unwrap();
    let sigma = fit.uncertainties();
    let found =
        [fit.offset_px[0], fit.offset_px[1], fit.sigma_px[0], fit.sigma_px[1], fit.angle_deg];
    let truth = [TRUTH[0], TRUTH[1], TRUTH[2], TRUTH[3], 25.0];
    for i in 0..5 {
        assert!(
            (found[i] - truth[i]).abs() < 5.0 * sigma[i] && sigma[i] < 4.0,
            "{found:?} {sigma:?}"
        );
    }
    let [background, its_sigma] = fit.background_hz.to_array();
    assert!((background - 200.0).abs() < 5.0 * its_sigma && its_sigma < 5.0, "{background}");
    for (star, found) in &fit.amplitudes_hz {
        assert!(found.pull(AMPLITUDES[star - 10]).abs() < 5.0, "{:?}", fit.amplitudes_hz);
    }
    let (sin, cos) = fit.angle_deg.to_radians().sin_cos();
    let [u, v] = fit.sigma_px.to_array().map(|s| s * s);
    let fibre = fit.fibre();
    assert!((fibre.sigma_px[0].powi(2) - (u * cos * cos + v * sin * sin)).abs() < 1e-9);
    assert!((fibre.sigma_px[1].powi(2) - (u * sin * sin + v * cos * cos)).abs() < 1e-9);
}

/// Truth: a second maximum of 0.15 and σ = 4 px, 30 px beside the centre, is where the map's strongest residual lies (a cell of 5 px), at 0.08 to 0.16: a cell
/// averages over it, and the fit takes a part.
#[test]
fn a_ghost_shows_in_the_map() {
    let mut points = Draw::new(4).points(4000, 0.0, 0.0);
    for point in &mut points {
        let [dx, dy] = [point.offset_px[0] - TRUTH[0] - 30.0, point.offset_px[1] - TRUTH[1]];
        let ghost = 0.15 * (-0.5 * (dx * dx + dy * dy) / 16.0).exp();
        point.rate_hz += ghost * AMPLITUDES[point.star - 10];
    }
    let fit = fit_field(&points, &FitOptions::default()).unwrap();
    let map = FieldMap::new(&points, &fit, 5.0);
    assert_eq!(map.cells.iter().map(|cell| cell.points).sum::<usize>(), 4000);
    let cell = map.strongest_residual().unwrap();
    let off = [0, 1].map(|i| cell.offset_px[i] - TRUTH[i] - if i == 0 { 30.0 } else { 0.0 });
    assert!(off[0].hypot(off[1]) < 5.0, "{cell:?}");
    assert!((0.08..0.16).contains(&cell.residual), "{cell:?}");
    assert_eq!(map.at(cell.offset_px), Some(cell));
    assert_eq!(map.at([1e4, 0.0].into()), None);
}

#[test]
fn points_that_tell_nothing_are_refused() {
    let points = Draw::new(1).points(7, 0.0, 0.0);
    let refused = |points: &[FieldPoint]| fit_field(points, &FitOptions::default()).unwrap_err();
    assert_eq!(refused(&points), FitError::TooFew { found: 7, parameters: 7 });
    assert_eq!(refused(&[]), FitError::TooFew { found: 0, parameters: 4 });
    let mut same = Draw::new(1).points(50, 0.0, 0.0);
    same.iter_mut().for_each(|point| point.offset_px = [1.0, 2.0].into());
    assert!(matches!(refused(&same), FitError::Undetermined(_)));
    let mut dark = Draw::new(1).points(50, 0.0, 0.0);
    dark.iter_mut().for_each(|point| point.rate_hz = 0.0);
    assert!(matches!(refused(&dark), FitError::Undetermined(_)));
    let spoils: [fn(&mut FieldPoint); 3] =
        [|p| p.sigma_hz = 0.0, |p| p.rate_hz = f64::NAN, |p| p.covariance_px2[2] = 1.0];
    for spoil in spoils {
        let mut points = Draw::new(1).points(50, 0.0, 0.0);
        spoil(&mut points[20]);
        assert_eq!(refused(&points), FitError::Point(21));
    }
}

/// Truth: `scipy.optimize.curve_fit` on the same points (exact places, least squares, covariance scaled by the scatter): parameters to 1e-4 of their
/// σ and more, σ to 1e-3: both stop at their own tolerances.
#[test]
fn the_fit_is_scipys() {
    let test = "the_fit_is_scipys";
    let Some(python) = peer_python(test, &["scipy"]) else { return };
    let points = Draw::new(12).points(150, 0.0, 15.0);
    let options = FitOptions { rotation: true, background: true, robust: false, twinkling: false };
    let fit = fit_field(&points, &options).unwrap();
    let rows: Vec<String> = points
        .iter()
        .map(|p| {
            let [x, y] = p.offset_px.to_array();
            format!("{x:?},{y:?},{:?},{:?},{}", p.rate_hz, p.sigma_hz, p.star - 10)
        })
        .collect();
    let script = r#"
import sys, numpy as np
from scipy.optimize import curve_fit
d = np.array([[float(v) for v in row.split(',')] for row in sys.argv[1].split(';')])
x, y, rate, sigma, star = d.T
star = star.astype(int)
def model(_, x0, y0, su, sv, angle, b, *a):
    t = np.radians(angle)
    dx, dy = x - x0, y - y0
    u, v = np.cos(t)*dx + np.sin(t)*dy, -np.sin(t)*dx + np.cos(t)*dy
    return np.array(a)[star]*np.exp(-u**2/(2*su**2) - v**2/(2*sv**2)) + b
p, c = curve_fit(model, x, rate, p0=[0, 5, 15, 18, 10, 0, 3000, 800, 12000], sigma=sigma, ftol=1e-15, xtol=1e-15, gtol=1e-15)
print(' '.join(repr(float(v)) for v in [*p, *np.sqrt(np.diag(c))]))
"#;
    let answer = run_python(&python, script, &[&rows.join(";")]);
    let scipys: Vec<f64> = answer.split_whitespace().map(|v| v.parse().unwrap()).collect();
    let [b, b_sigma] = fit.background_hz.to_array();
    let mut ours = vec![
        fit.offset_px[0],
        fit.offset_px[1],
        fit.sigma_px[0],
        fit.sigma_px[1],
        fit.angle_deg,
        b,
    ];
    let mut sigma = fit.uncertainties().to_vec();
    sigma.push(b_sigma);
    for (_, found) in &fit.amplitudes_hz {
        ours.push(found.value);
        sigma.push(found.sigma);
    }
    for i in 0..9 {
        let off = (ours[i] - scipys[i]).abs() / sigma[i];
        let ratio = sigma[i] / scipys[i + 9];
        println!("{i}: {} ± {}: off {off:.1e} σ, σ ratio {ratio}", ours[i], sigma[i]);
        assert!(off < 1e-3 && (ratio - 1.0).abs() < 1e-3, "{i}: {off} {ratio}");
    }
}
