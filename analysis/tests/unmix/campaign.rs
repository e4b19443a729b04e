//! Non-negative least squares against SciPy.

use ndarray::Array2;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::io::Write as _;
use sunglint_analysis::unmix::nnls::{Constraint, Nnls, Solution};
use sunglint_testkit::{Campaign, peer_python, run_python};

const KINDS: u64 = 7;

/// A problem, and the powers of ten by which its columns and its data are scaled.
pub struct Problem {
    pub matrix: Array2<f64>,
    pub x: Vec<f64>,
    pub kind: u64,
}

fn normal(random: &mut Xoshiro256PlusPlus) -> f64 {
    random.sample(rand_distr::StandardNormal)
}

/// In turn: any signs; spectra (all positive) with noise; exact mixtures; collinear columns; fewer channels than endmembers; columns at scales from 1e−12 to 1e12;
/// data outside the cone.
pub fn problem(seed: u64) -> Problem {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let kind = seed % KINDS;
    let columns = random.random_range(1..=10_usize);
    let rows = match kind {
        4 => random.random_range(1..=columns),
        _ => columns + random.random_range(0..=30_usize),
    };
    let mut matrix = Array2::from_shape_fn((rows, columns), |_| match kind {
        0 => normal(&mut random),
        _ => random.random_range(0.0..1.0),
    });
    if kind == 3 && columns > 1 {
        let near = 10_f64.powf(random.random_range(-12.0..-2.0));
        let first = matrix.column(0).to_owned();
        let noise = Array2::from_shape_fn((rows, 1), |_| normal(&mut random));
        let twin = &first + &(near * &noise.column(0));
        matrix.column_mut(columns - 1).assign(&twin);
    }
    let truth: Vec<f64> = (0..columns)
        .map(|_| if random.random_bool(0.4) { 0.0 } else { random.random_range(0.0..1.0) })
        .collect();
    let mut x: Vec<f64> =
        matrix.rows().into_iter().map(|r| r.iter().zip(&truth).map(|(s, a)| s * a).sum()).collect();
    match kind {
        2 => {}
        6 => x.iter_mut().for_each(|x| *x = -x.abs() + 0.1 * normal(&mut random)),
        _ => x.iter_mut().for_each(|x| *x += 0.05 * normal(&mut random)),
    }
    if kind == 5 {
        for mut column in matrix.columns_mut() {
            let power = random.random_range(-12..=12);
            column.mapv_inplace(|v| v * 10_f64.powi(power));
        }
        let power = random.random_range(-12..=12);
        x.iter_mut().for_each(|x| *x *= 10_f64.powi(power));
    }
    Problem { matrix, x, kind }
}

fn norm(v: &[f64]) -> f64 {
    v.iter().map(|v| v * v).sum::<f64>().sqrt()
}

/// The Karush–Kuhn–Tucker conditions of an answer, from the answer alone.
pub fn violation(matrix: &Array2<f64>, x: &[f64], weights: &[f64]) -> f64 {
    let mut left = x.to_vec();
    for (column, a) in matrix.columns().into_iter().zip(weights) {
        left.iter_mut().zip(column).for_each(|(l, s)| *l -= a * s);
    }
    let lengths: Vec<f64> = matrix.columns().into_iter().map(|c| norm(&c.to_vec())).collect();
    let scale = lengths.iter().zip(weights).map(|(l, a)| l * a).fold(norm(x), f64::max);
    let mut most = 0.0_f64;
    for ((column, a), length) in matrix.columns().into_iter().zip(weights).zip(&lengths) {
        assert!(*a >= 0.0 && a.is_finite(), "{a}");
        let part: f64 = column.iter().zip(&left).map(|(s, l)| s * l).sum();
        let part = if scale > 0.0 { part / (length * scale) } else { 0.0 };
        most = most.max(if *a > 0.0 { part.abs() } else { part });
    }
    most
}

pub fn solve(matrix: &Array2<f64>, x: &[f64]) -> Solution {
    Nnls::new(matrix.view(), Constraint::Free).unwrap().solve(x).unwrap()
}

const SCRIPT: &str = "
import sys, numpy as np
from scipy.optimize import nnls
data = np.fromfile(sys.argv[1]); at = 0
while at < len(data):
    n, p = int(data[at]), int(data[at+1]); at += 2
    s = data[at:at+n*p].reshape(n, p); at += n*p
    x = data[at:at+n]; at += n
    try:
        a, r = nnls(s, x)
        print(repr(float(r)), ''.join('1' if v > 0 else '0' for v in a))
    except RuntimeError:
        print('nan', '-')
";

/// Truth: `scipy.optimize.nnls` 1.17.1 on the same numbers: nothing that it finds fits better, and where the answer is the only one and its columns are not nearly
/// parallel, it uses the same endmembers. The conditions of an optimum are computed from the answer alone.
/// Tolerance: 1e-12 for the conditions, as the promise says; 1e-9 of ‖x‖ for what SciPy fits better, since it stops at its own tolerance.
#[test]
fn campaign_nnls() {
    let mut campaign = Campaign::start("nnls", 10_000);
    let (mut kkt, mut rescaled, mut moved) = (0.0_f64, 0_u32, 0.0_f64);
    let mut answers = Vec::new();
    let mut bytes: Vec<u8> = Vec::new();
    for seed in campaign.seeds() {
        let problem = problem(seed);
        let (rows, columns) = problem.matrix.dim();
        let found = solve(&problem.matrix, &problem.x);
        kkt = kkt.max(violation(&problem.matrix, &problem.x, &found.weights)).max(found.kkt);
        // In other units, each endmember in its own.
        let mut random = Xoshiro256PlusPlus::seed_from_u64(!seed);
        let units: Vec<f64> =
            (0..columns).map(|_| 10_f64.powf(random.random_range(-12.0..12.0))).collect();
        let unit = 10_f64.powf(random.random_range(-12.0..12.0));
        let other =
            Array2::from_shape_fn((rows, columns), |(i, j)| problem.matrix[(i, j)] * units[j]);
        let again = solve(&other, &problem.x.iter().map(|x| x * unit).collect::<Vec<_>>());
        // Twins nearer to each other than rounding to their correlations may change places.
        if found.unique && problem.kind != 3 {
            rescaled += u32::from(found.in_use != again.in_use);
            let most = found.weights.iter().copied().fold(0.0, f64::max);
            for ((a, b), u) in found.weights.iter().zip(&again.weights).zip(&units) {
                if most > 0.0 && problem.kind != 5 {
                    moved = moved.max((a - b * u / unit).abs() / most);
                }
            }
        }
        let header = [rows as f64, columns as f64];
        for value in header.iter().chain(problem.matrix.iter()).chain(&problem.x) {
            bytes.extend(value.to_le_bytes());
        }
        answers.push((problem, found));
    }
    campaign.largest("kkt_relative", kkt);
    campaign.largest("supports_that_change_with_units", rescaled.into());
    campaign.largest("weights_that_change_with_units_relative", moved);
    if let Some(python) = peer_python("nnls_beside_scipy", &["scipy"]) {
        let mut file = tempfile();
        file.0.write_all(&bytes).unwrap();
        let text = run_python(&python, SCRIPT, &[file.1.to_str().unwrap()]);
        std::fs::remove_file(&file.1).unwrap();
        let (mut excess, mut others, mut refused) = (0.0_f64, 0_u32, 0_u32);
        for (line, (problem, found)) in text.lines().zip(&answers) {
            let (left, support) = line.split_once(' ').unwrap();
            let left: f64 = left.parse().unwrap();
            if left.is_nan() {
                refused += 1;
                continue;
            }
            let own = norm(&found.residual);
            excess = excess.max((own - left) / norm(&problem.x));
            let same = support.chars().zip(&found.in_use).all(|(s, u)| (s == '1') == *u);
            // Where SciPy stops at a worse answer its support is another's; its tolerance is not free of units.
            let as_good = (own - left).abs() <= 1e-12 * norm(&problem.x);
            let clear = found.unique && ![3, 5].contains(&problem.kind) && as_good;
            // An exact mixture leaves nothing that decides about weights of 1e-16.
            if clear && problem.kind != 2 && !same {
                others += 1;
            }
        }
        assert_eq!(text.lines().count(), answers.len());
        campaign.largest("residual_above_scipy_relative", excess);
        campaign.largest("other_supports_than_scipy", others.into());
        assert!(excess <= 1e-9, "SciPy fits better by {excess:e} of the data");
        assert_eq!(others, 0, "supports that are not SciPy's");
        println!("SciPy gave up on {refused} of {}", answers.len());
    }
    campaign.finish();
    assert!(kkt <= 1e-12, "{kkt:e}");
    assert_eq!(rescaled, 0, "supports that change with the units");
    assert!(moved <= 1e-9, "{moved:e}");
}

fn tempfile() -> (std::fs::File, std::path::PathBuf) {
    let path = std::env::temp_dir().join(format!("sunglint-nnls-{}.bin", std::process::id()));
    (std::fs::File::create(&path).unwrap(), path)
}
