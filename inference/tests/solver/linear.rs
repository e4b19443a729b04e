//! The linear core against another program.

use nalgebra::{DMatrix, DVector};
use ndarray::{Array2, Array3};
use rand::{RngExt as _, SeedableRng as _};
use serde_json::{Value, json};
use sunglint_inference::solver::{
    CalibrationError, Columns, Data, FitError, Free, Linear, Loss, Model, ModelError, Options,
    Prior, Purpose, Warning, fit,
};
use sunglint_testkit::{peer_python, run_python};

/// Columns that are there, whatever the parameters; of one non-linear parameter the k-th column is scaled by e^(v t_k).
pub(super) struct Fixed {
    pub columns: Vec<Array3<f64>>,
    pub times: Option<Vec<f64>>,
}

impl Model for Fixed {
    fn columns(&mut self, values: &[f64]) -> Result<Vec<Columns>, ModelError> {
        let one = |columns: &Array3<f64>| {
            let (n, channels, _) = columns.dim();
            let mut columns = columns.clone();
            if let (Some(times), Some(v)) = (&self.times, values.first()) {
                for (i, t) in times.iter().enumerate() {
                    columns.slice_mut(ndarray::s![i, .., 0]).mapv_inplace(|x| x * (v * t).exp());
                }
            }
            Columns { fixed: Array2::zeros((n, channels)), columns }
        };
        Ok(self.columns.iter().map(one).collect())
    }
}

pub(super) fn linear(component: usize, channels: Vec<usize>) -> Linear {
    let name = format!("x{component}{channels:?}");
    Linear { name, component, channels, curves: None, unit: 1.0, most: None, prior: None }
}

pub(super) const PLAIN: Options = Options {
    loss: Loss::Squares,
    places: 0,
    starts: 0,
    seed: 0,
    iterations: 60,
    shakes: 6,
    purpose: Purpose::Answer,
};

const PEER: &str = r#"
import json, sys, numpy, scipy
from scipy.optimize import lsq_linear, least_squares
d = json.load(open(sys.argv[1]))
A, y, C = (numpy.array(d[k]) for k in ("design", "rate", "covariance"))
W = numpy.linalg.inv(numpy.linalg.cholesky(C))
lin = lsq_linear(W @ A, W @ y, bounds=(0, numpy.inf), tol=1e-14, lsmr_tol=1e-14)
free = lin.x > 1e-9
N = (W @ A)[:, free]
cov = numpy.linalg.inv(N.T @ N)
t = numpy.array(d["times"])
y2 = numpy.array(d["decay"])
first = numpy.array(d["first"])
def res(p):
    B = A.copy()
    B[:, first] *= numpy.exp(p[-1] * t)[:, None]
    return W @ (B @ p[:-1] - y2)
non = least_squares(res, numpy.r_[lin.x + 0.1, 0.0], bounds=(numpy.r_[0*lin.x, -1], numpy.r_[0*lin.x+numpy.inf, 1]), xtol=1e-14, ftol=1e-14, gtol=1e-14)
ncov = numpy.linalg.inv(non.jac.T @ non.jac)
print(json.dumps({"version": scipy.__version__, "x": lin.x.tolist(), "sigma": numpy.sqrt(numpy.diag(cov)).tolist(), "cost": 2*lin.cost,
  "n": non.x.tolist(), "nsigma": numpy.sqrt(numpy.diag(ncov)).tolist()}))
"#;

/// Truth: scipy's lsq_linear and least_squares (bounded, trust region) on the same columns and the same full covariance, of which scipy takes the Cholesky
/// root: albedos with one held at 0, their uncertainties, χ²; and a decay rate beside them. Tolerance: 1e-6 of the uncertainty for what is linear,
/// 1e-3 of it for the search.
#[test]
fn albedos_and_their_errors_are_those_of_scipy() {
    let Some(python) = peer_python("albedos_and_their_errors_are_those_of_scipy", &["scipy"])
    else {
        return;
    };
    let mut random = crate::solver::night::random(7);
    let (n, channels, components) = (40, 3, 2);
    let columns = Array3::from_shape_fn((n, channels, components), |(i, c, k)| {
        let t = i as f64 / n as f64;
        1000.0 * (1.0 + c as f64) * (1.2 + (3.0 * t + 2.0 * k as f64).sin())
            + 20.0 * random.random::<f64>()
    });
    // The second component of the last channel is not there: noise decides that its estimate is below 0.
    let truth = [[0.5, 0.3], [0.7, 0.1], [0.4, -0.05]];
    let times: Vec<f64> = (0..n).map(|i| i as f64 / n as f64).collect();
    let s = 0.02;
    let mean = Array2::from_shape_fn((n, channels), |(i, c)| {
        truth[c][0] * columns[[i, c, 0]] + truth[c][1] * columns[[i, c, 1]]
    });
    let noise = Array2::from_shape_fn((n, channels), |_| random.random::<f64>() - 0.5);
    let sigma = mean.map(|m| 3.0 + 0.01 * m);
    let rate = &mean + &(&noise * &sigma);
    let decay = Array2::from_shape_fn((n, channels), |(i, c)| {
        (0.2 * times[i]).exp() * 0.6 * columns[[i, c, 0]]
            + 0.2 * columns[[i, c, 1]]
            + noise[[i, c]] * sigma[[i, c]]
    });
    // Common noise by the measured rates: weights that follow the model would not be the peer's.
    let of = |rate: &Array2<f64>| {
        let mut data = Data::new("a", rate.clone(), sigma.clone());
        data.common_variance = vec![s * s; n];
        data
    };
    let linear: Vec<Linear> =
        (0..channels).flat_map(|c| (0..components).map(move |k| linear(k, vec![c]))).collect();
    let mut model = Fixed { columns: vec![columns.clone()], times: None };
    let found = fit(&[of(&rate)], &mut model, &[], &linear, &PLAIN, &mut |_| ()).unwrap();
    let fitted = &found.curves[0].model;
    let mut decaying = Fixed { columns: vec![columns.clone()], times: Some(times.clone()) };
    let free = [Free::new("v", 0.0, -1.0, 1.0)];
    let second = fit(&[of(&decay)], &mut decaying, &free, &linear, &PLAIN, &mut |_| ()).unwrap();

    // The peer's rows: epoch by epoch, the covariance by the fitted rates.
    let rows = n * channels;
    let design: Vec<Vec<f64>> = (0..rows)
        .map(|r| {
            let (i, c) = (r / channels, r % channels);
            linear
                .iter()
                .map(|l| if l.channels[0] == c { columns[[i, c, l.component]] } else { 0.0 })
                .collect()
        })
        .collect();
    let covariance = |model: &Array2<f64>| -> Vec<Vec<f64>> {
        (0..rows)
            .map(|a| {
                (0..rows)
                    .map(|b| {
                        let (ia, ca, ib, cb) =
                            (a / channels, a % channels, b / channels, b % channels);
                        let own = if a == b { sigma[[ia, ca]].powi(2) } else { 0.0 };
                        let common =
                            if ia == ib { s * s * model[[ia, ca]] * model[[ib, cb]] } else { 0.0 };
                        own + common
                    })
                    .collect()
            })
            .collect()
    };
    let ask = |model: &Array2<f64>| -> Value {
        let first: Vec<usize> = (0..linear.len()).filter(|p| linear[*p].component == 0).collect();
        let of_row: Vec<f64> = (0..rows).map(|r| times[r / channels]).collect();
        let data = json!({"design": design, "rate": rate.iter().collect::<Vec<_>>(), "decay": decay.iter().collect::<Vec<_>>(),
                          "covariance": covariance(model), "times": of_row, "first": first});
        let file = std::env::temp_dir().join(format!("sunglint-fit-{}.json", std::process::id()));
        std::fs::write(&file, serde_json::to_vec(&data).unwrap()).unwrap();
        let answer = run_python(&python, PEER, &[file.to_str().unwrap()]);
        std::fs::remove_file(&file).unwrap();
        serde_json::from_str(&answer).unwrap()
    };
    let numbers = |v: &Value| -> Vec<f64> { serde_json::from_value(v.clone()).unwrap() };
    let peer = ask(fitted);
    println!("scipy {}", peer["version"]);
    let (x, sigmas) = (numbers(&peer["x"]), numbers(&peer["sigma"]));
    let mut of_free = sigmas.iter();
    for (p, estimate) in found.parameters.iter().enumerate() {
        if estimate.at_bound.is_some() {
            assert!(x[p].abs() < 1e-9, "{}: {} {}", estimate.name, estimate.value, x[p]);
            continue;
        }
        let sigma = of_free.next().unwrap();
        let own = estimate.sigma.unwrap() / found.scaled_by.sqrt();
        assert!((own / sigma - 1.0).abs() < 1e-4, "{}: {own} {sigma}", estimate.name);
        let off = (estimate.value - x[p]).abs();
        assert!(off < 1e-3 * sigma, "{}: {} {}", estimate.name, estimate.value, x[p]);
    }
    assert!(found.parameters.iter().any(|p| p.at_bound.is_some()), "one stands at 0");
    let cost = peer["cost"].as_f64().unwrap();
    assert!((found.chi2 / cost - 1.0).abs() < 1e-4, "{} {cost}", found.chi2);

    let peer = ask(&second.curves[0].model);
    let (values, sigmas) = (numbers(&peer["n"]), numbers(&peer["nsigma"]));
    for (p, estimate) in second.parameters.iter().enumerate() {
        // The peer has the search's parameter last.
        let at = if p == 0 { values.len() - 1 } else { p - 1 };
        let own = estimate.sigma.unwrap() / second.scaled_by.sqrt();
        assert!((own / sigmas[at] - 1.0).abs() < 1e-2, "{}: {own} {}", estimate.name, sigmas[at]);
        let off = (estimate.value - values[at]).abs();
        assert!(off < 1e-2 * sigmas[at], "{}: {} {}", estimate.name, estimate.value, values[at]);
    }
}

/// Truth: by hand: one component that is 100 everywhere and an albedo of 1: errors of calibration of 3 % that a night's curves share stay 3 %, those of
/// two nights become 3 %/√2, whatever the number of samples.
#[test]
fn errors_of_calibration_do_not_average_out_within_a_night() {
    let n = 400;
    let columns = Array3::from_elem((n, 1, 1), 100.0);
    for (keys, expected) in [(["a", "a"], 0.03), (["a", "b"], 0.03 / 2_f64.sqrt())] {
        let data: Vec<Data> = keys
            .iter()
            .map(|key| {
                let rate = Array2::from_shape_fn((n, 1), |(i, _)| {
                    100.0 + if i % 2 == 0 { 1.0 } else { -1.0 }
                });
                let mut data = Data::new(*key, rate, Array2::from_elem((n, 1), 1.0));
                let covariance = Array2::from_elem((1, 1), 0.03_f64.powi(2));
                data.calibration = Some(CalibrationError { key: (*key).into(), covariance });
                data
            })
            .collect();
        let mut model = Fixed { columns: vec![columns.clone(), columns.clone()], times: None };
        let found =
            fit(&data, &mut model, &[], &[linear(0, vec![0])], &PLAIN, &mut |_| ()).unwrap();
        let p = &found.parameters[0];
        assert!((p.value - 1.0).abs() < 1e-12);
        assert!((p.sigma_calibration.unwrap() - expected).abs() < 1e-9, "{p:?}");
    }
}

/// Truth: the closed forms, by nalgebra. A light a·shape with noise of 10 in each of 300 samples and a level that is known to 3, the same error in all: least squares by the noise alone, whose covariance the level's error widens
/// by its square, so that a sample stays what it was; with a prior of the coefficient, generalised least squares under the whole covariance. Where the level's error is in each sample's own, as before, it would be divided by the
/// root of 300. A second curve has an error of its own. Tolerance: 1e-6 of the uncertainty.
#[test]
fn the_error_of_a_level_is_the_same_in_all_samples_of_a_channel() {
    let n = 300;
    let shape = |i: usize| 100.0 + 80.0 * (0.03 * i as f64).sin();
    let mut rng = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(4);
    let mut normal = || {
        let (u, v): (f64, f64) = (rng.random(), rng.random());
        (-2.0 * (1.0 - u).ln()).sqrt() * (2.0 * std::f64::consts::PI * v).cos()
    };
    let rates: Vec<Array2<f64>> = (0..2)
        .map(|_| Array2::from_shape_fn((n, 1), |(i, _)| 0.7 * shape(i) + 2.0 + 10.0 * normal()))
        .collect();
    let columns = Array3::from_shape_fn((n, 1, 1), |(i, _, _)| shape(i));
    for curves in [1, 2] {
        let data: Vec<Data> = rates[..curves]
            .iter()
            .map(|rate| {
                let whole = (10.0_f64.powi(2) + 3.0_f64.powi(2)).sqrt();
                let mut data = Data::new("a", rate.clone(), Array2::from_elem((n, 1), whole));
                data.with_level(Array2::from_elem((n, 1), 3.0));
                assert!((data.sigma[[7, 0]] - 10.0).abs() < 1e-12);
                data
            })
            .collect();
        let rows = curves * n;
        let a = DVector::from_fn(rows, |k, _| shape(k % n));
        let y = DVector::from_fn(rows, |k, _| rates[k / n][[k % n, 0]]);
        for prior in [None, Some(Prior { mean: 0.69, sigma: 0.01 })] {
            let mut model = Fixed { columns: vec![columns.clone(); curves], times: None };
            let linear = [Linear { prior, ..linear(0, vec![0]) }];
            let found = fit(&data, &mut model, &[], &linear, &PLAIN, &mut |_| ()).unwrap();
            let scale = found.scaled_by;
            let (value, variance) = match prior {
                None => {
                    let square = a.norm_squared();
                    let each = |k: usize| a.rows(k * n, n).sum() * 3.0 / square;
                    let of_levels: f64 = (0..curves).map(|k| each(k).powi(2)).sum();
                    (a.dot(&y) / square, scale * 100.0 / square + of_levels)
                }
                Some(prior) => {
                    let together = |k: usize, l: usize| if k / n == l / n { 9.0 } else { 0.0 };
                    let own = |k: usize, l: usize| if k == l { scale * 100.0 } else { 0.0 };
                    let covariance =
                        DMatrix::from_fn(rows, rows, |k, l| own(k, l) + together(k, l));
                    let inverse = covariance.try_inverse().unwrap();
                    let weight = (a.transpose() * &inverse * &a)[0];
                    let known = prior.sigma.powi(-2);
                    let pull = (a.transpose() * &inverse * &y)[0] + prior.mean * known;
                    (pull / (weight + known), 1.0 / (weight + known))
                }
            };
            let p = &found.parameters[0];
            let sigma = variance.sqrt();
            assert!((p.value - value).abs() < 1e-6 * sigma, "{} {value} ± {sigma}", p.value);
            assert!((p.sigma.unwrap() / sigma - 1.0).abs() < 1e-6, "{p:?} {sigma}");
            let half = 0.5 * (p.interval_95[1].unwrap() - p.interval_95[0].unwrap());
            assert!((half / (1.959_964 * sigma) - 1.0).abs() < 1e-3, "{p:?}");
        }
    }
}

/// Truth: by hand. 60 magnitudes of a light of 100, and 12 of a glint of 1,000 that the model lacks, all to 10 % of their own light: the weighted mean of the light, over 100, is 1.018. Were the uncertainties 10 % of the model's
/// light, it would be 2.5.
#[test]
fn a_glint_that_the_model_lacks_has_the_uncertainty_of_its_own_light() {
    let light = |i: usize| if i < 60 { 100.0 } else { 1000.0 };
    let rate = Array2::from_shape_fn((72, 1), |(i, _)| light(i));
    let mut data = Data::new("a", rate.clone(), rate.map(|r| 0.1 * r));
    data.share = Some(Array2::from_elem((72, 1), 0.1));
    let mut model = Fixed { columns: vec![Array3::from_elem((72, 1, 1), 100.0)], times: None };
    let found = fit(&[data], &mut model, &[], &[linear(0, vec![0])], &PLAIN, &mut |_| ()).unwrap();
    let (own, of_glint) = (60.0 / 100_f64.powi(2), 12.0 / 1000_f64.powi(2));
    let factor = (100.0 * own + 1000.0 * of_glint) / (100.0 * (own + of_glint));
    let value = found.parameters[0].value;
    // The weight of what is not in the glint follows the factor, which is 2 % above 1.
    assert!((value / factor - 1.0).abs() < 2e-3, "{value} {factor}");
}

/// Truth: by hand. Two materials make 100 and 50 Hz, constant in time, each alone in a channel, and both albedos are free. The first is known to 10 % (one standard deviation): its own albedo is unsure by 10 %, the other's
/// by nothing, whatever the number of samples. Where only a material of 50 Hz is free it takes up all of 10 Hz: 0.2.
#[test]
fn the_doubt_of_a_material_goes_where_least_squares_take_it() {
    let n = 200;
    let rate = |c: usize| if c == 0 { 100.0 } else { 50.0 };
    let ripple = |i: usize| if i.is_multiple_of(2) { 0.5 } else { -0.5 };
    // Epochs × channels × components.
    let apart = Array3::from_shape_fn((n, 2, 2), |(_, c, k)| if c == k { rate(k) } else { 0.0 });
    let doubt = Array2::from_shape_fn((n, 2), |(_, c)| if c == 0 { 10.0 } else { 0.0 });
    let data = Data::new(
        "a",
        Array2::from_shape_fn((n, 2), |(i, c)| rate(c) + ripple(i)),
        Array2::from_elem((n, 2), 0.5),
    );
    let mut model = Fixed { columns: vec![apart], times: None };
    let both = [linear(0, vec![0, 1]), linear(1, vec![0, 1])];
    let mut found =
        fit(std::slice::from_ref(&data), &mut model, &[], &both, &PLAIN, &mut |_| ()).unwrap();
    let before: Vec<_> = found.parameters.iter().map(|p| p.sigma.unwrap()).collect();
    assert!(found.parameters.iter().all(|p| p.sigma_material.is_none()));
    found.add_materials(&[("a".to_owned(), vec![doubt])]);
    for (k, expected) in [0.1, 0.0].into_iter().enumerate() {
        let p = &found.parameters[k];
        let own = p.sigma_material.unwrap();
        assert!((own - expected).abs() < 1e-9, "{p:?}");
        assert!((p.sigma.unwrap() - before[k].hypot(expected)).abs() < 1e-12);
        let half = 1.959_963_984_540_054 * before[k].hypot(expected);
        assert!((p.interval_95[1].unwrap() - p.value - half).abs() < 1e-9, "{p:?}");
    }
    // Light that is not free is unsure by 10 Hz beside a free 50 Hz.
    let rate = Array2::from_shape_fn((n, 1), |(i, _)| 50.0 + ripple(i));
    let data = Data::new("b", rate, Array2::from_elem((n, 1), 0.5));
    let mut model = Fixed { columns: vec![Array3::from_elem((n, 1, 1), 50.0)], times: None };
    let mut found =
        fit(&[data], &mut model, &[], &[linear(0, vec![0])], &PLAIN, &mut |_| ()).unwrap();
    found.add_materials(&[("a".to_owned(), vec![Array2::from_elem((n, 1), 10.0)])]);
    let own = found.parameters[0].sigma_material.unwrap();
    assert!((own - 0.2).abs() < 1e-9, "{own}");
}

#[test]
fn what_cannot_be_fitted_is_said() {
    let columns = Array3::from_elem((3, 1, 1), 100.0);
    let mut model = Fixed { columns: vec![columns.clone()], times: None };
    let rate = Array2::from_elem((3, 1), 50.0);
    let mut data = Data::new("evening", rate.clone(), Array2::from_elem((3, 1), 1.0));
    let mut refuse = |data: &Data, linear: &[Linear]| {
        fit(std::slice::from_ref(data), &mut model, &[], linear, &PLAIN, &mut |_| ()).unwrap_err()
    };
    assert!(matches!(
        refuse(&data, &[linear(0, vec![0]), linear(0, vec![0])]),
        FitError::Input { .. }
    ));
    data.used.fill(false);
    let error = refuse(&data, &[linear(0, vec![0])]);
    assert!(matches!(error, FitError::NothingLeft { .. }), "{error}");
    assert!(error.to_string().contains("evening"), "{error}");
    data.used[[0, 0]] = true;
    assert!(matches!(refuse(&data, &[linear(0, vec![0])]), FitError::TooFew { samples: 1, .. }));
}

/// Truth: the closed form of one coefficient with a normal prior, (Σ a y/σ² + m/s²)/(Σ a²/σ² + 1/s²), and the root of the denominator's inverse; and for a parameter
/// that changes no sample its prior itself, which is said. Tolerance: 1e-9 of the coefficient's uncertainty; 1e-3 of the prior's, where a search of χ² to 1e-9 of itself ends.
#[test]
fn a_prior_is_one_more_sample() {
    let n = 20;
    let columns = Array3::from_shape_fn((n, 1, 1), |(i, _, _)| 2.0 + (i as f64 * 0.3).sin());
    // Small residuals, so that nothing is widened.
    let rate = Array2::from_shape_fn((n, 1), |(i, _)| {
        0.6 * columns[[i, 0, 0]] + 0.03 * if i % 2 == 0 { 1.0 } else { -1.0 }
    });
    let sigma = Array2::from_elem((n, 1), 0.5);
    let data = [Data::new("a", rate.clone(), sigma)];
    let (mean, width) = (0.65, 0.02);
    let prior = Some(Prior { mean, sigma: width });
    let linear = [Linear { prior, ..linear(0, vec![0]) }];
    let idle =
        Free { prior: Some(Prior { mean: 0.3, sigma: 0.1 }), ..Free::new("v", 0.0, -1.0, 1.0) };
    let mut model = Fixed { columns: vec![columns.clone()], times: None };
    let found = fit(&data, &mut model, &[idle], &linear, &PLAIN, &mut |_| ()).unwrap();
    let (mut up, mut down) = (mean / width.powi(2), width.powi(-2));
    for i in 0..n {
        let a = columns[[i, 0, 0]];
        up += a * rate[[i, 0]] / 0.25;
        down += a * a / 0.25;
    }
    let x = found.parameter("x0[0]").unwrap();
    let (truth, error) = (up / down, down.sqrt().recip());
    assert!((x.value - truth).abs() < 1e-9 * error, "{} {truth}", x.value);
    assert!((x.sigma.unwrap() - error).abs() < 1e-6 * error, "{:?} {error}", x.sigma);
    assert!((0.6..0.65).contains(&x.value) && x.prior == prior);
    let v = found.parameter("v").unwrap();
    assert!((v.value - 0.3).abs() < 1e-4 && (v.sigma.unwrap() - 0.1).abs() < 1e-7, "{v:?}");
    let said = |w: &Warning| matches!(w, Warning::ByPrior { names } if names.iter().eq(["v"]));
    assert!(found.warnings.iter().any(said), "{:?}", found.warnings);
    let bad =
        Free { prior: Some(Prior { mean: 0.3, sigma: 0.0 }), ..Free::new("v", 0.0, -1.0, 1.0) };
    let refused = fit(&data, &mut model, &[bad], &[], &PLAIN, &mut |_| ());
    assert!(refused.unwrap_err().to_string().contains("the prior of v"));
}

/// Truth: the posterior of two albedos by hand (nalgebra's inverse of 2 × 2 matrices). Each channel's mean says 0.6 to its noise, both share errors of calibration of 3 % and 2 % with a correlation of 0.5, by the albedos that are
/// found, and the first is known beforehand: once to 0.3 %, once to 30 %. The tight prior wins over the first, pulls the second along by the correlation, and is said to know it alone. Tolerance: a thousandth of the standard
/// uncertainties, by both losses.
#[test]
fn a_prior_stands_beside_the_calibration_as_it_is() {
    use nalgebra::{Matrix2, Vector2};
    let n = 400;
    for (mean, width) in [(0.64, 0.002), (0.64, 0.2)] {
        for options in [PLAIN, Options { loss: Loss::Huber, ..PLAIN }] {
            let rate = Array2::from_shape_fn((n, 2), |(i, c)| {
                60.0 + if (i >> c) % 2 == 0 { 0.5 } else { -0.5 }
            });
            let mut data = Data::new("a", rate, Array2::from_elem((n, 2), 1.0));
            let both = 0.5 * 0.03 * 0.02;
            let covariance = ndarray::array![[0.03_f64.powi(2), both], [both, 0.02_f64.powi(2)]];
            data.calibration =
                Some(CalibrationError { key: "night".into(), covariance: covariance.clone() });
            let prior = Some(Prior { mean, sigma: width });
            let known = [Linear { prior, ..linear(0, vec![0]) }, linear(0, vec![1])];
            let columns = Array3::from_elem((n, 2, 1), 100.0);
            let mut model = Fixed { columns: vec![columns], times: None };
            let found = fit(&[data], &mut model, &[], &known, &options, &mut |_| ()).unwrap();
            let [a, b] = ["x0[0]", "x0[1]"].map(|name| found.parameter(name).unwrap());
            // By the albedos that were found: the errors are relative to the light.
            let at = Vector2::new(a.value, b.value);
            let noise = 0.01_f64.powi(2) / n as f64;
            let of_data = Matrix2::from_fn(|i, j| {
                covariance[[i, j]] * at[i] * at[j] + if i == j { noise } else { 0.0 }
            });
            let of_prior = Matrix2::new(width.powi(-2), 0.0, 0.0, 0.0);
            let weight = of_data.try_inverse().unwrap();
            let posterior = (weight + of_prior).try_inverse().unwrap();
            let truth =
                posterior * (weight * Vector2::new(0.6, 0.6) + of_prior * Vector2::new(mean, 0.0));
            for (k, found) in [a, b].into_iter().enumerate() {
                let sigma = posterior[(k, k)].sqrt();
                assert!((found.value - truth[k]).abs() < 1e-3 * sigma, "{} {truth}", found.value);
                let own = found.sigma.unwrap();
                assert!((own / sigma - 1.0).abs() < 1e-3, "{own} {sigma}");
            }
            let said = found.warnings.iter().any(|w| matches!(w, Warning::ByPrior { .. }));
            assert_eq!(said, width < 0.01, "{:?}", found.warnings);
            if width < 0.01 {
                assert!(a.value > 0.62 && b.value > 0.605, "{} {}", a.value, b.value);
            } else {
                assert!((a.value - 0.6).abs() < 0.002, "{}", a.value);
            }
        }
    }
}

/// Truth: albedos of 0.5, samples with a noise of their own and one that the channels of an epoch share (2 %), and of each channel one sample four times too bright. Tolerance: of 40 curves
/// the 95 % intervals hold it in 34 or more (33 or fewer have a chance of 1e-4 with 0.95 each); the mean estimate lies within 0.002 of it (the loss leaves 1.345/37 of a sample's noise, 6e-4, and 40 curves a noise of 3e-4). With one channel alone
/// and next to no noise of its own the same.
#[test]
fn a_single_outlier_draws_no_albedo_beside_common_noise() {
    let n = 37;
    for (channels, own) in [(3, 0.012), (1, 0.003)] {
        let mut held = vec![0; channels];
        let mut mean = vec![0.0; channels];
        for seed in 0..40 {
            let mut random = crate::solver::night::random(900 + seed);
            let mut normal = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
            let common: Vec<f64> = (0..n).map(|_| 1.0 + 0.02 * normal()).collect();
            let mut rate = Array2::from_shape_fn((n, channels), |(i, _)| 500.0 * common[i]);
            rate.mapv_inplace(|r| r + 500.0 * own * normal());
            for c in 0..channels {
                rate[[(7 * seed as usize + 11 * c) % n, c]] *= 4.0;
            }
            let mut data = Data::new("a", rate, Array2::from_elem((n, channels), 500.0 * own));
            data.common_variance = vec![0.02_f64.powi(2); n];
            let columns = vec![Array3::from_elem((n, channels, 1), 1000.0)];
            let mut model = Fixed { columns, times: None };
            let linear: Vec<Linear> = (0..channels).map(|c| linear(0, vec![c])).collect();
            let options = Options { loss: Loss::Huber, ..PLAIN };
            let found = fit(&[data], &mut model, &[], &linear, &options, &mut |_| ()).unwrap();
            for (c, p) in found.parameters.iter().enumerate() {
                held[c] += usize::from(p.covers(0.5));
                mean[c] += p.value / 40.0;
            }
        }
        println!("{channels} channels: held {held:?}, mean {mean:?}");
        assert!(held.iter().all(|held| *held >= 34), "{held:?} of 40");
        assert!(mean.iter().all(|mean| (mean - 0.5).abs() < 2e-3), "{mean:?}");
    }
}

/// Truth: 60 magnitudes of a factor of 1 with σ of 0.1 mag, of which ten, three or one are 2.5 mag too faint; the uncertainties are as curves have them, shares of a smooth brightness. Tolerance: a tenth
/// of outliers and more bends Huber's loss by a few per cent (Huber 1981, §1.3: outliers of a share ε on one side shift the mean by 1.345 σ ε/(1 − ε), 2.5 % for ten of 60, and their spread is wider for it): 8 % with ten, 3 % with fewer; Tukey's leaves them out:
/// 5 %, three standard errors. In any order of the samples.
#[test]
fn faint_outliers_of_magnitudes_draw_no_factor() {
    let n = 60;
    for (outliers, loss, most) in [
        (10, Loss::Huber, 0.08),
        (10, Loss::Tukey, 0.05),
        (3, Loss::Huber, 0.05),
        (1, Loss::Huber, 0.05),
        (0, Loss::Squares, 0.05),
    ] {
        for seed in 0..10_u64 {
            let mut random = crate::solver::night::random(500 + seed);
            let mut normal = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
            let truth = Array2::from_shape_fn((n, 1), |(i, _)| 3.0 + (0.4 * i as f64).sin());
            let off: Vec<f64> = (0..n).map(|_| 0.1 * normal()).collect();
            let faint = |i: usize| if (i * 7 + seed as usize) % n < outliers { 2.5 } else { 0.0 };
            let rate = Array2::from_shape_fn((n, 1), |(i, _)| {
                truth[[i, 0]] * 10_f64.powf(-0.4 * (off[i] + faint(i)))
            });
            let share = 0.1 * 0.4 * std::f64::consts::LN_10;
            let sigma = truth.mapv(|r| r * share);
            let mut data = Data::new("a", rate, sigma);
            data.share = Some(Array2::from_elem((n, 1), share));
            let columns = vec![truth.insert_axis(ndarray::Axis(2))];
            let mut model = Fixed { columns, times: None };
            let options = Options { loss, ..PLAIN };
            let linear = [linear(0, vec![0])];
            let found = fit(&[data], &mut model, &[], &linear, &options, &mut |_| ()).unwrap();
            let value = found.parameters[0].value;
            println!("{outliers} {loss:?} {seed}: {value} {}", found.converged);
            assert!((value - 1.0).abs() < most, "{outliers} {loss:?} {seed}: {value}");
            assert!(found.converged, "{outliers} {loss:?} {seed}");
        }
    }
}

/// Truth: 100 magnitudes of a factor of 1 with σ of 0.3 mag, normal in magnitudes, as curves of magnitudes become data: rates of exp(−s²/2) of what was measured, s = 0.4 ln 10 · 0.3, and shares of (exp(s²) − 1)^½. The mean of 200
/// fits is right to three of its standard errors by any loss (Huber's alone is 3 % lower where noise in light is taken as even), and 95 % intervals hold 200 · 0.95 ± 3 σ.
#[test]
fn noisy_magnitudes_are_right_in_the_mean_by_any_loss() {
    let (n, seeds) = (100, 200);
    let s = 0.3 * 0.4 * std::f64::consts::LN_10;
    for loss in [Loss::Squares, Loss::Huber, Loss::Student, Loss::Tukey] {
        let (mut sum, mut square, mut held) = (0.0, 0.0, 0);
        for seed in 0..seeds {
            let mut random = crate::solver::night::random(90_000 + seed);
            let mut normal = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
            let truth = Array2::from_shape_fn((n, 1), |(i, _)| 3.0 + (0.4 * i as f64).sin());
            let rate = truth.mapv(|light| light * (s * normal() - 0.5 * s * s).exp());
            let share = (s * s).exp_m1().sqrt();
            // Curves' uncertainties follow a smooth brightness, not the samples' own.
            let mut data = Data::new("a", rate, truth.mapv(|r| r * share));
            data.share = Some(Array2::from_elem((n, 1), share));
            let mut model =
                Fixed { columns: vec![truth.insert_axis(ndarray::Axis(2))], times: None };
            let options = Options { loss, ..PLAIN };
            let linear = [linear(0, vec![0])];
            let found = fit(&[data], &mut model, &[], &linear, &options, &mut |_| ()).unwrap();
            let one = &found.parameters[0];
            sum += one.value - 1.0;
            square += (one.value - 1.0).powi(2);
            held += usize::from(one.covers(1.0));
        }
        let count = f64::from(seeds as u32);
        let mean = sum / count;
        let error = ((square / count - mean * mean) / count).sqrt();
        println!("{loss:?}: {mean:+.5} ± {error:.5}, {held} of {seeds}");
        assert!(mean.abs() < 3.0 * error, "{loss:?}: {mean} ± {error}");
        assert!((181..=199).contains(&held), "{loss:?}: {held} of {seeds}");
    }
}
