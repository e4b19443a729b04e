//! Where descents end, and which minima are told apart: models whose minima are known in closed form.

use ndarray::{Array2, Array3};
use sunglint_inference::solver::{
    Columns, Data, Fit, Free, IntervalMethod, Linear, Loss, Model, ModelError, Options, Purpose,
    Side, Warning, fit,
};

/// Samples.
const N: usize = 40;
/// How much stronger the second pattern is than the first: how narrow the valley is.
const NARROW: f64 = 30.0;

/// 100 plus multiples of two patterns that are perpendicular to each other and to a constant.
struct Patterns<F>(F);

/// The patterns at a sample.
fn patterns(i: usize) -> [f64; 2] {
    [[1.0, -1.0][i % 2], NARROW * [1.0, 1.0, -1.0, -1.0][i % 4]]
}

impl<F: Fn(&[f64]) -> [f64; 2]> Model for Patterns<F> {
    fn columns(&mut self, values: &[f64]) -> Result<Vec<Columns>, ModelError> {
        let own = (self.0)(values);
        let rate = |(i, _)| {
            let [a, b] = patterns(i);
            100.0 + own[0] * a + own[1] * b
        };
        let fixed = Array2::from_shape_fn((N, 1), rate);
        Ok(vec![Columns { fixed, columns: Array3::zeros((N, 1, 0)) }])
    }
}

/// Samples of unit noise about 100 plus multiples of the patterns.
fn data(own: [f64; 2]) -> Data {
    let rate = |(i, _): (usize, usize)| {
        let chance: f64 = (0..12)
            .map(|k| (7919.0 * ((12 * i + k) as f64 * 0.618_033_988_749_895).fract()).fract() - 0.5)
            .sum();
        let [a, b] = patterns(i);
        100.0 + own[0] * a + own[1] * b + chance
    };
    let rate = Array2::from_shape_fn((N, 1), rate);
    Data::new("synthetic", rate, Array2::ones((N, 1)))
}

/// Least squares of the multiples: the patterns are perpendicular, so that each is a mean.
fn best(data: &Data) -> [f64; 2] {
    let mean = |k: usize| {
        let all = (0..N).map(|i| (patterns(i)[k], data.rate[[i, 0]] - 100.0));
        let (along, size) =
            all.fold((0.0, 0.0), |(along, size), (p, y)| (along + p * y, size + p * p));
        along / size
    };
    [mean(0), mean(1)]
}

fn found(data: &Data, of: impl Fn(&[f64]) -> [f64; 2], free: &[Free], purpose: Purpose) -> Fit {
    let options =
        Options { loss: Loss::Squares, places: 32, starts: 6, purpose, ..Options::default() };
    let data = std::slice::from_ref(data);
    fit(data, &mut Patterns(of), free, &[], &options, &mut |_| ()).unwrap()
}

fn others(fit: &Fit) -> Vec<&Warning> {
    fit.warnings.iter().filter(|w| matches!(w, Warning::OtherMinimum { .. })).collect()
}

/// Truth: closed form: with multiples q₁ and q₂ − q₁² the only minimum is at q₁, q₂ of the means, at the end of a bent, narrow valley. Tolerance: a hundredth of the standard uncertainty of q₁ (1/√40) where
/// intervals are asked for, a tenth where only values or the covariance are. No other minimum is named, although six searches come down the valley from all over it.
#[test]
fn a_bent_valley_has_one_minimum() {
    let data = data([0.7, 0.02]);
    let [a, b] = best(&data);
    let free = [Free::new("q1", -1.5, -2.0, 2.0), Free::new("q2", 3.0, -1.0, 5.0)];
    for (purpose, part) in
        [(Purpose::Answer, 0.01), (Purpose::Covariance, 0.1), (Purpose::Values, 0.1)]
    {
        let found = found(&data, |q| [q[0], q[1] - q[0] * q[0]], &free, purpose);
        let sigma = 1.0 / (N as f64).sqrt();
        let off = (found.parameters[0].value - a).abs() / sigma;
        assert!(off < part, "{purpose:?}: q1 is off by {off} of its uncertainty");
        let q2 = found.parameters[1].value;
        assert!((q2 - (b + a * a)).abs() < 2.0 * a.abs() * part * sigma + 1e-3, "{purpose:?} {q2}");
        assert!(found.converged && others(&found).is_empty(), "{purpose:?}: {:?}", found.warnings);
    }
}

/// Truth: by symmetry: with the multiple p² minima lie at p = ±√mean and are equally deep. The one that is not the answer is named, once, where uncertainties are asked for.
#[test]
fn the_second_of_two_minima_is_named_once() {
    let data = data([1.0, 0.0]);
    let p = best(&data)[0].sqrt();
    let free = [Free::new("p", 0.5, -2.0, 2.0)];
    for purpose in [Purpose::Answer, Purpose::Covariance] {
        let found = found(&data, |q| [q[0] * q[0], 0.0], &free, purpose);
        let value = found.parameters[0].value;
        assert!((value.abs() - p).abs() < 1e-3, "{value}, expected ±{p}");
        let [Warning::OtherMinimum { delta_chi2, at }] = others(&found)[..] else {
            panic!("{purpose:?}: {:?}", found.warnings)
        };
        assert!((at[0].1 + value).abs() < 2e-3 && *delta_chi2 < 1e-3, "{at:?} {delta_chi2}");
    }
}

/// Truth: by hand: a parameter that changes nothing. It is named, and has no uncertainty, whether or not profiles of χ² are gone through; the other one keeps its own.
#[test]
fn a_parameter_without_effect_is_named() {
    let data = data([0.7, 0.0]);
    let free = [Free::new("q", 0.0, -2.0, 2.0), Free::new("idle", 0.3, 0.0, 1.0)];
    for purpose in [Purpose::Answer, Purpose::Covariance] {
        let found = found(&data, |q| [q[0], 0.0], &free, purpose);
        let idle =
            |w: &&Warning| matches!(w, Warning::Undetermined { names } if *names == ["idle"]);
        assert_eq!(found.warnings.iter().filter(idle).count(), 1, "{:?}", found.warnings);
        let [q, idle] = &found.parameters[..] else { panic!("{:?}", found.parameters) };
        assert_eq!((idle.sigma, idle.interval_method), (None, IntervalMethod::None));
        let sigma = q.sigma.unwrap() / found.scaled_by.sqrt();
        assert!((sigma * (N as f64).sqrt() - 1.0).abs() < 1e-3, "{sigma}");
        assert!(others(&found).is_empty(), "{purpose:?}: {:?}", found.warnings);
    }
}

/// Light that is a size squared times an albedo times 1000 to 1400: nothing tells the two apart.
struct SizeTimesAlbedo;

impl SizeTimesAlbedo {
    fn light(i: usize) -> f64 {
        1000.0 + 10.0 * i as f64
    }
}

impl Model for SizeTimesAlbedo {
    fn columns(&mut self, values: &[f64]) -> Result<Vec<Columns>, ModelError> {
        let column = |(i, _, _): (usize, usize, usize)| 0.5 * values[0].powi(2) * Self::light(i);
        let columns = Array3::from_shape_fn((N, 1, 1), column);
        Ok(vec![Columns { fixed: Array2::zeros((N, 1)), columns }])
    }
}

/// Truth: closed form. Only q = size² albedo is determined, by the mean of the samples over the light, with the uncertainty 1/√Σ light². The albedo is at most 1: the size may be anything from
/// √(q − 1.96 of that) to its own bound 2, χ² is level between and a wall at the lower end; the albedo anything from q/4 to 1. Tolerance: 1 % of the way to the end. The combination is named, wherever the search began or ended
/// (also with the size at its bound or the albedo at its own), and places along the level are no other minima.
#[test]
fn what_goes_together_is_named_and_its_interval_goes_to_the_wall() {
    let chance = data([0.0, 0.0]);
    let rate = Array2::from_shape_fn((N, 1), |(i, _)| {
        0.5 * SizeTimesAlbedo::light(i) + chance.rate[[i, 0]] - 100.0
    });
    let squares: f64 = (0..N).map(|i| SizeTimesAlbedo::light(i).powi(2)).sum();
    let q = (0..N).map(|i| SizeTimesAlbedo::light(i) * rate[[i, 0]]).sum::<f64>() / squares;
    let data = [Data::new("synthetic", rate, Array2::ones((N, 1)))];
    let albedo = Linear {
        name: "albedo".into(),
        component: 0,
        channels: vec![0],
        curves: None,
        unit: 0.5,
        most: Some(1.0),
        prior: None,
    };
    for (start, places, iterations) in [(1.0, 0, 60), (2.0, 0, 0), (0.5, 0, 60), (1.3, 32, 60)] {
        let free = [Free::new("size", start, 0.3, 2.0)];
        let loss = Loss::Squares;
        let options = Options { loss, places, starts: 6, iterations, ..Options::default() };
        let linear = std::slice::from_ref(&albedo);
        let found = fit(&data, &mut SizeTimesAlbedo, &free, linear, &options, &mut |_| ()).unwrap();
        let [size, albedo] = &found.parameters[..] else { panic!("{:?}", found.parameters) };
        let wall = (q - 1.96 * (found.scaled_by / squares).sqrt()).sqrt();
        let way = (size.value - wall).max(0.02);
        let [low, high] = size.interval_95.map(Option::unwrap);
        assert!(low < wall + 0.002 * way && low > wall - 0.012 * way, "{start}: {low}, {wall}");
        assert!((high - 2.0).abs() < 1e-9, "{start}: {high}");
        let [low, high] = albedo.interval_95.map(Option::unwrap);
        assert!((low / (0.25 * q) - 1.0).abs() < 0.02, "{start}: {low}, {}", 0.25 * q);
        assert!((0.98..=1.0 + 1e-9).contains(&high), "{start}: {high}");
        if albedo.at_bound.is_none() {
            assert!(albedo.sigma.unwrap() > 0.1, "{start}: {albedo:?}");
        }
        assert_eq!(size.at_bound, (iterations == 0).then_some(Side::High), "{start}: {size:?}");
        let named = |w: &&Warning| matches!(w, Warning::Undetermined { names } if *names == ["size", "albedo"]);
        assert_eq!(found.warnings.iter().filter(named).count(), 1, "{start}: {:?}", found.warnings);
        assert!(others(&found).is_empty(), "{start}: {:?}", found.warnings);
    }
}
