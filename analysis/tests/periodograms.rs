//! Periodograms beside the sums that define them and beside other programs.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use rand::RngExt as _;
use rand::SeedableRng as _;
use rand_distr::{Distribution as _, Normal};
use rand_xoshiro::Xoshiro256PlusPlus as Random;
use std::f64::consts::TAU;
use sunglint_analysis::fold::{FoldError, Folding, fold};
use sunglint_analysis::period::stats::{chi2_survival, f_survival};
use sunglint_analysis::period::{
    FrequencyGrid, PeriodError, false_alarm, fit, joint_gain, lomb_scargle, pdm, spectrum, window,
};
use sunglint_analysis::series::{Series, SeriesError};
use sunglint_testkit::{peer_python, run_python};

/// Irregular samples of three harmonics with unequal uncertainties.
fn curve(seed: u64, n: usize) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
    let mut random = Random::seed_from_u64(seed);
    let normal = Normal::new(0.0, 1.0).unwrap();
    let mut time: Vec<f64> = (0..n).map(|_| 1000.0 * random.random::<f64>()).collect();
    time.sort_by(f64::total_cmp);
    let sigma: Vec<f64> = (0..n).map(|_| 0.2 + 0.3 * random.random::<f64>()).collect();
    let value = time
        .iter()
        .zip(&sigma)
        .map(|(t, s)| {
            let p = TAU * t / 20.0;
            50.0 + p.sin()
                + 0.7 * (2.0 * p + 1.0).cos()
                + 0.4 * (3.0 * p).sin()
                + s * normal.sample(&mut random)
        })
        .collect();
    (time, value, sigma)
}

fn json<T: std::fmt::Debug>(values: &[T]) -> String {
    format!("{values:?}")
}

/// The share of the variance that the model explains, by modified Gram-Schmidt on the columns: no sums over angles, no normal equations.
fn direct(time: &[f64], value: &[f64], sigma: &[f64], f: f64, harmonics: usize) -> f64 {
    let root: Vec<f64> = sigma.iter().map(|s| 1.0 / s).collect();
    let column = |of: &dyn Fn(f64) -> f64| -> Vec<f64> {
        time.iter().zip(&root).map(|(t, r)| r * of(*t)).collect()
    };
    let mut columns = vec![column(&|_| 1.0)];
    for k in 1..=harmonics {
        // The phase's whole turns are taken away before it is made an angle.
        let angle = move |t: f64| {
            let turns = k as f64 * f * t;
            TAU * (turns - turns.round() + (k as f64 * f).mul_add(t, -turns))
        };
        columns.push(column(&move |t| angle(t).cos()));
        columns.push(column(&move |t| angle(t).sin()));
    }
    let mut y: Vec<f64> = value.iter().zip(&root).map(|(v, r)| (v - 50.0) * r).collect();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut done: Vec<Vec<f64>> = Vec::new();
    let mut about_mean = 0.0;
    for (k, mut c) in columns.into_iter().enumerate() {
        // Twice is enough.
        for _ in 0..2 {
            for d in &done {
                let part = dot(&c, d);
                c.iter_mut().zip(d).for_each(|(c, d)| *c -= part * d);
            }
        }
        let size = dot(&c, &c).sqrt();
        c.iter_mut().for_each(|c| *c /= size);
        let part = dot(&y, &c);
        y.iter_mut().zip(&c).for_each(|(y, c)| *y -= part * c);
        if k == 0 {
            about_mean = dot(&y, &y);
        }
        done.push(c);
    }
    1.0 - dot(&y, &y) / about_mean
}

/// Truth: weighted least squares by Gram-Schmidt, written here. Tolerance: 1e-10 of the whole variance, what this crate promises.
#[test]
fn lomb_scargle_is_the_least_squares_fit() {
    let (time, value, sigma) = curve(1, 2600);
    let series = Series::new("c", &time, &value, Some(&sigma)).unwrap();
    // The peers' job: 50,000 frequencies; and one that begins nearly at 0.
    for (grid, harmonics) in [
        (FrequencyGrid { first_hz: 0.01, step_hz: 1e-4, n: 50_000 }, 1),
        (FrequencyGrid { first_hz: 2e-3, step_hz: 1e-4, n: 5000 }, 1),
        (FrequencyGrid { first_hz: 0.01, step_hz: 1e-4, n: 10_000 }, 3),
        (FrequencyGrid { first_hz: 0.01, step_hz: 1e-4, n: 3000 }, 8),
    ] {
        let power = lomb_scargle(&series, &grid, harmonics).unwrap();
        let mut worst = 0.0_f64;
        for i in (0..grid.n).step_by(grid.n / 150).chain([400, 401, 1400]) {
            let truth = direct(&time, &value, &sigma, grid.frequency_hz(i), harmonics);
            worst = worst.max((power[i] - truth).abs());
        }
        assert!(worst <= 1e-10, "{harmonics} harmonics: {worst:e}");
        eprintln!(
            "{harmonics} harmonics, {} frequencies: off the direct fit by at most {worst:.1e}",
            grid.n
        );
    }
    // The same at one frequency, with coefficients: those that went in, within their noise.
    let found = fit(&series, 0.05, 3).unwrap();
    let truth = direct(&time, &value, &sigma, 0.05, 3);
    assert!((found.power - truth).abs() < 1e-10);
    let amplitude = |k: usize| found.harmonics[k][0].hypot(found.harmonics[k][1]);
    for (k, truth) in [(0, 1.0), (1, 0.7), (2, 0.4)] {
        // The uncertainty of an amplitude is σ √(2/N) = 0.01; four of them.
        assert!((amplitude(k) - truth).abs() < 0.04, "{k}: {}", amplitude(k));
    }
    assert!((found.at(7.0) - (50.0 + value_at(7.0))).abs() < 0.08);
}

fn value_at(t: f64) -> f64 {
    let p = TAU * t / 20.0;
    p.sin() + 0.7 * (2.0 * p + 1.0).cos() + 0.4 * (3.0 * p).sin()
}

/// Truth: astropy 8.0.2, LombScargle (floating mean), method `cython` for one harmonic, `chi2` (its own matrices) for three; its window is the periodogram of ones without
/// mean. Tolerance: 1e-9, the peer's own sums.
#[test]
fn lomb_scargle_beside_astropy() {
    let Some(python) = peer_python("lomb_scargle_beside_astropy", &["astropy"]) else { return };
    let (time, value, sigma) = curve(2, 400);
    let script = format!(
        "import astropy, numpy as np\nfrom astropy.timeseries import LombScargle as L\nassert astropy.__version__ == '8.0.2', astropy.__version__\n\
         t, y, s = np.array({}), np.array({}), np.array({})\nf = 0.011 + 0.0005 * np.arange(1000)\n\
         for k, m in ((1, 'cython'), (3, 'chi2')):\n    p = L(t, y, s, nterms=k).power(f, method=m)\n    print(*[repr(float(x)) for x in p])\n\
         w = s**-2.0\nprint(*[repr(float(abs(np.sum(w * np.exp(2j*np.pi*x*t)))**2 / w.sum()**2)) for x in f])",
        json(&time),
        json(&value),
        json(&sigma)
    );
    let printed = run_python(&python, &script, &[]);
    let rows: Vec<Vec<f64>> =
        printed.lines().map(|l| l.split(' ').map(|x| x.parse().unwrap()).collect()).collect();
    let series = Series::new("c", &time, &value, Some(&sigma)).unwrap();
    let grid = FrequencyGrid { first_hz: 0.011, step_hz: 0.0005, n: 1000 };
    let ours = [
        lomb_scargle(&series, &grid, 1).unwrap(),
        lomb_scargle(&series, &grid, 3).unwrap(),
        window(&series, &grid).unwrap(),
    ];
    for (ours, theirs) in ours.iter().zip(&rows) {
        let worst = ours.iter().zip(theirs).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-9, "{worst:e}");
    }
}

/// Truth: PyAstronomy 0.25.0, pyPDM with equidistant bins, equal weights. Tolerance: 1e-9; the peer leaves out bins with fewer than three samples, so that bins here have many.
#[test]
fn dispersion_beside_pyastronomy() {
    let Some(python) = peer_python("dispersion_beside_pyastronomy", &["PyAstronomy"]) else {
        return;
    };
    let (time, value, _) = curve(3, 500);
    let script = format!(
        "import numpy as np, PyAstronomy\nfrom PyAstronomy.pyTiming import pyPDM\nassert PyAstronomy.__version__ == '0.25.0', PyAstronomy.__version__\n\
         t, y = np.array({}), np.array({})\nt = t - t[0]\nS = pyPDM.Scanner(minVal=5.0, maxVal=45.0, dVal=0.1, mode='period')\n\
         p, th = pyPDM.PyPDM(t, y).pdmEquiBin(10, S)\nprint(*[repr(float(x)) for x in p])\nprint(*[repr(float(x)) for x in th])",
        json(&time),
        json(&value)
    );
    let printed = run_python(&python, &script, &[]);
    let rows: Vec<Vec<f64>> = printed
        .lines()
        .filter_map(|l| l.split(' ').map(|x| x.parse().ok()).collect::<Option<Vec<f64>>>())
        .filter(|row| row.len() > 100)
        .collect();
    let series = Series::new("c", &time, &value, None).unwrap();
    let ours = pdm(&series, &rows[0], 10).unwrap();
    let worst = ours.iter().zip(&rows[1]).map(|(a, b)| (a.theta - b).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-9, "{worst:e}");
    // The period that went in, or a multiple of it, disperses least.
    let best = ours.iter().zip(&rows[0]).min_by(|a, b| a.0.theta.total_cmp(&b.0.theta)).unwrap();
    assert!((best.1 / 20.0 - (best.1 / 20.0).round()).abs() < 0.01, "{}", best.1);
}

/// Truth: scipy 1.17.1, chi2.sf and f.sf, and the closed forms e^(-x/2) and (1 + x/b)^(-b). Tolerance: 1e-11 relative.
#[test]
fn tails_are_those_of_the_tables() {
    for x in [0.1, 1.0, 7.5, 60.0, 500.0] {
        assert!((chi2_survival(x, 2.0) / (-0.5 * x).exp() - 1.0).abs() < 1e-11);
        for b in [1.0, 4.0, 12.0] {
            let closed = (1.0_f64 + x / b).powf(-b);
            assert!((f_survival(x, 2.0, 2.0 * b) / closed - 1.0).abs() < 1e-11, "{x} {b}");
        }
    }
    let Some(python) = peer_python("tails_are_those_of_the_tables", &["scipy"]) else { return };
    let script = "from scipy.stats import chi2, f\n\
        for x, d in ((0.3, 1), (3.8, 1), (11.0, 5.5), (40.0, 30), (300.0, 200.0)):\n    print(repr(float(chi2.sf(x, d))))\n\
        for x, a, b in ((0.5, 3, 7), (2.0, 20, 400), (1.3, 100.0, 55.5), (9.0, 1, 3)):\n    print(repr(float(f.sf(x, a, b))))";
    let printed = run_python(&python, script, &[]);
    let theirs: Vec<f64> = printed.lines().map(|l| l.parse().unwrap()).collect();
    let ours = [
        chi2_survival(0.3, 1.0),
        chi2_survival(3.8, 1.0),
        chi2_survival(11.0, 5.5),
        chi2_survival(40.0, 30.0),
        chi2_survival(300.0, 200.0),
        f_survival(0.5, 3.0, 7.0),
        f_survival(2.0, 20.0, 400.0),
        f_survival(1.3, 100.0, 55.5),
        f_survival(9.0, 1.0, 3.0),
    ];
    for (ours, theirs) in ours.iter().zip(&theirs) {
        assert!((ours / theirs - 1.0).abs() < 1e-11, "{ours} {theirs}");
    }
}

/// Truth: 400 curves of noise alone. The bound must be one: peaks that it calls rarer than 1 in 10 come no more often (binomial: 40 ± 6, so at most 60), and it is
/// no empty one: at least a third of that.
#[test]
fn the_false_alarm_bound_holds_for_noise() {
    let grid = |k: f64| FrequencyGrid {
        first_hz: 0.004,
        step_hz: 0.002 / k,
        n: (498.0 * k / 2.0) as usize,
    };
    for (harmonics, channels) in [(1, 1), (3, 1), (1, 4)] {
        let mut rare = 0;
        for seed in 0..400 {
            let mut random = Random::seed_from_u64(1000 + seed);
            let normal = Normal::new(0.0, 1.0).unwrap();
            let time: Vec<f64> = (0..200).map(|_| 200.0 * random.random::<f64>()).collect();
            let all: Vec<Series> = (0..channels)
                .map(|_| {
                    let y: Vec<f64> = time.iter().map(|_| normal.sample(&mut random)).collect();
                    Series::new("noise", &time, &y, None).unwrap()
                })
                .collect();
            let grid = grid(harmonics as f64);
            let mut sum = vec![0.0; grid.n];
            for s in &all {
                let power = lomb_scargle(s, &grid, harmonics).unwrap();
                sum.iter_mut().zip(power).for_each(|(a, p)| *a += joint_gain(p, 200, harmonics));
            }
            let highest = sum.iter().copied().fold(0.0, f64::max);
            let all: Vec<&Series> = all.iter().collect();
            let chance = false_alarm(highest, &all, harmonics, grid.last_hz(), 1.0).unwrap();
            rare += usize::from(chance < 0.1);
        }
        eprintln!(
            "{harmonics} harmonics, {channels} channels: {rare} of 400 called rarer than 1 in 10"
        );
        assert!((13..=60).contains(&rare), "{harmonics} {channels}: {rare}");
    }
}

/// Truth: a sine of amplitude 3 at a whole number of turns has that amplitude at its frequency and none elsewhere (orthogonality). Tolerance: 1e-9.
#[test]
fn the_spectrum_of_a_sine_is_a_line() {
    let time: Vec<f64> = (0..256).map(|i| 5.0 + 0.25 * f64::from(i)).collect();
    let value: Vec<f64> =
        (0..256).map(|i| 7.0 + 3.0 * (TAU * 9.0 * f64::from(i) / 256.0).sin()).collect();
    let found = spectrum(&Series::new("s", &time, &value, None).unwrap()).unwrap();
    assert_eq!((found.missing, found.beside, found.grid.n), (0, 0, 128));
    for (i, amplitude) in found.amplitude.iter().enumerate() {
        let truth = if i == 8 { 3.0 } else { 0.0 };
        assert!((amplitude - truth).abs() < 1e-9, "{i}: {amplitude}");
    }
    // Ten samples away, one of them beside its place.
    let mut odd: Vec<f64> = time.clone();
    odd.drain(20..30);
    odd[50] += 0.05;
    let value = vec![1.0, 2.0].into_iter().cycle().take(odd.len()).collect::<Vec<f64>>();
    let found = spectrum(&Series::new("s", &odd, &value, None).unwrap()).unwrap();
    assert_eq!((found.missing, found.beside), (10, 1));
}

/// Truth: by hand. Means, unbiased scatter and uncertainty of the mean of a bin with values 1, 2, 6; phases by the definition.
#[test]
fn folding_puts_samples_where_they_belong() {
    let series =
        Series::new("c", &[0.0, 10.0, 20.0, 5.0, 12.5], &[1.0, 2.0, 6.0, 9.0, 4.0], None).unwrap();
    let folding = Folding { period_s: 10.0, period_sigma_s: Some(0.5), epoch_s: 0.0, bins: 4 };
    let found = fold(&series, &folding).unwrap();
    assert_eq!(found.phase, [0.0, 0.5, 0.0, 0.25, 0.0]);
    assert_eq!(found.turn, [0, 0, 1, 1, 2]);
    let bin = found.bins[0];
    assert_eq!((bin.samples, bin.mean), (3, 3.0));
    // Squares about 3: 4 + 1 + 9 = 14, over 2.
    assert!((bin.scatter - 7.0_f64.sqrt()).abs() < 1e-12);
    assert!((bin.sigma - (7.0_f64 / 3.0).sqrt()).abs() < 1e-12);
    assert!(found.bins[3].mean.is_nan() && found.bins[3].samples == 0);
    assert_eq!((found.turns, found.slip), (2.0, Some(0.1)));
    for (folding, error) in [
        (Folding { period_s: 0.0, ..folding }, FoldError::Period(0.0)),
        (Folding { bins: 1, ..folding }, FoldError::Bins(1)),
        (Folding { period_sigma_s: Some(-1.0), ..folding }, FoldError::Uncertainty(-1.0)),
    ] {
        assert_eq!(fold(&series, &folding).unwrap_err(), error);
    }
}

#[test]
fn what_cannot_be_computed_is_refused_with_the_reason() {
    let time: Vec<f64> = (0..50).map(f64::from).collect();
    let flat = Series::new("flat", &time, &vec![4.0; 50], None).unwrap();
    let grid = FrequencyGrid { first_hz: 0.01, step_hz: 0.01, n: 10 };
    let error = lomb_scargle(&flat, &grid, 1).unwrap_err();
    assert_eq!(error.to_string(), "flat: all 50 values are 4: constant light has no period");
    let three = Series::new("c", &[0.0, 1.0, 2.0], &[1.0, 2.0, 1.0], None).unwrap();
    assert!(matches!(lomb_scargle(&three, &grid, 1), Err(PeriodError::Samples { samples: 3, .. })));
    assert!(matches!(lomb_scargle(&three, &grid, 0), Err(PeriodError::Harmonics(0))));
    assert!(matches!(
        lomb_scargle(&three, &FrequencyGrid { step_hz: -1.0, ..grid }, 1),
        Err(PeriodError::Grid { .. })
    ));
    assert!(matches!(pdm(&three, &[1.0], 1), Err(PeriodError::Bins(1))));
    assert!(matches!(pdm(&three, &[f64::NAN], 5), Err(PeriodError::Period(_))));
    assert!(matches!(
        Series::new("c", &[0.0], &[1.0, 2.0], None),
        Err(SeriesError::Lengths { .. })
    ));
    // What is no number is left out and counted; times are sorted.
    let mixed = Series::new(
        "c",
        &[3.0, f64::NAN, 1.0, 3.0],
        &[1.0, 2.0, f64::INFINITY, 5.0],
        Some(&[1.0; 4]),
    )
    .unwrap();
    assert_eq!((mixed.len(), mixed.left_out.not_finite, mixed.left_out.same_time), (2, 2, 1));
}
