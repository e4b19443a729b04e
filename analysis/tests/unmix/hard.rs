//! Closed forms, and what cannot be unmixed.

use super::campaign::{problem, violation};
use ndarray::{Array2, array};
use sunglint_analysis::unmix::nnls::{Constraint, Nnls, NnlsError};
use sunglint_analysis::unmix::{Mixing, MixingError, Noise, osp};

fn names(count: usize) -> Vec<String> {
    (0..count).map(|i| format!("m{i}")).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Truth: two columns in closed form: Cramer's rule where both answers are above 0, else the better of one column alone, s·x/s·s or 0.
/// Tolerance: 1e-12 of the largest weight over the squared sine of the columns' angle, by which Cramer's rule itself loses digits.
#[test]
fn two_columns_are_those_of_the_closed_form() {
    for seed in 0..3000 {
        let p = problem(7 * seed);
        if p.matrix.ncols() < 2 {
            continue;
        }
        let (a, b) = (p.matrix.column(0).to_vec(), p.matrix.column(1).to_vec());
        let matrix = Array2::from_shape_fn((a.len(), 2), |(i, j)| [a[i], b[i]][j]);
        let (aa, ab, bb) = (dot(&a, &a), dot(&a, &b), dot(&b, &b));
        let (ax, bx) = (dot(&a, &p.x), dot(&b, &p.x));
        let determinant = aa * bb - ab * ab;
        let both = [(bb * ax - ab * bx) / determinant, (aa * bx - ab * ax) / determinant];
        let truth = if both[0] > 0.0 && both[1] > 0.0 {
            both
        } else {
            let (only_a, only_b) = ((ax / aa).max(0.0), (bx / bb).max(0.0));
            // What is gained: (s·x)²/s·s.
            if only_a * ax.max(0.0) >= only_b * bx.max(0.0) { [only_a, 0.0] } else { [0.0, only_b] }
        };
        let found = Nnls::new(matrix.view(), Constraint::Free).unwrap().solve(&p.x).unwrap();
        let most = truth[0].max(truth[1]).max(1e-3);
        let tolerance = 1e-12 * most * aa * bb / determinant;
        for (found, truth) in found.weights.iter().zip(truth) {
            assert!((found - truth).abs() <= tolerance, "seed {seed}: {found} {truth}");
        }
    }
}

/// Truth: all supports tried, each by its normal equations with a multiplier for the sum (Gaussian elimination): the best that is nowhere negative.
/// Tolerance: 1e-9 of the sum, for the normal equations lose half of the digits; the sum itself to 4 units in the last place.
#[test]
fn a_given_sum_is_exact_and_its_answer_the_best_of_all_supports() {
    for seed in 0..700 {
        let p = problem(7 * seed + 1);
        let count = p.matrix.ncols().min(5);
        let matrix = p.matrix.slice(ndarray::s![.., ..count]).to_owned();
        let total = [1.0, 3.7e-5, 42.0][seed as usize % 3];
        let x: Vec<f64> = p.x.iter().map(|x| x * total).collect();
        let solver = Nnls::new(matrix.view(), Constraint::Sum(total)).unwrap();
        let found = solver.solve(&x).unwrap();
        let sum: f64 = found.weights.iter().sum();
        assert!((sum - total).abs() <= 4.0 * f64::EPSILON * total, "{sum} {total}");
        let far = |weights: &[f64]| {
            let left = |(row, x): (ndarray::ArrayView1<'_, f64>, &f64)| {
                x - row.iter().zip(weights).map(|(s, a)| s * a).sum::<f64>()
            };
            matrix.rows().into_iter().zip(&x).map(left).map(|l| l * l).sum::<f64>()
        };
        let mut best = (f64::INFINITY, Vec::new());
        for support in 1..1_u32 << count {
            let used: Vec<usize> = (0..count).filter(|j| support >> j & 1 == 1).collect();
            let k = used.len();
            let column = |j: usize| matrix.column(used[j]).to_vec();
            let mut system = vec![vec![0.0; k + 2]; k + 1];
            for i in 0..k {
                for j in 0..k {
                    system[i][j] = dot(&column(i), &column(j));
                }
                system[i][k] = 1.0;
                system[k][i] = 1.0;
                system[i][k + 1] = dot(&column(i), &x);
            }
            system[k][k + 1] = total;
            let Some(answer) = eliminate(system) else { continue };
            if answer[..k].iter().all(|a| *a >= 0.0) {
                let mut weights = vec![0.0; count];
                used.iter().zip(&answer).for_each(|(j, a)| weights[*j] = *a);
                if far(&weights) < best.0 {
                    best = (far(&weights), weights);
                }
            }
        }
        assert!(
            far(&found.weights) <= best.0 * (1.0 + 1e-9) + 1e-18 * total * total,
            "seed {seed}"
        );
        if p.matrix.nrows() > count + 3 {
            for (found, truth) in found.weights.iter().zip(&best.1) {
                assert!((found - truth).abs() <= 1e-9 * total, "seed {seed}: {found} {truth}");
            }
        }
        assert!(found.kkt <= 1e-12, "{:e}", found.kkt);
    }
}

fn eliminate(mut m: Vec<Vec<f64>>) -> Option<Vec<f64>> {
    let n = m.len();
    for i in 0..n {
        let pivot = (i..n).max_by(|a, b| m[*a][i].abs().total_cmp(&m[*b][i].abs()))?;
        m.swap(i, pivot);
        if m[i][i].abs() < 1e-13 {
            return None;
        }
        for k in i + 1..n {
            let f = m[k][i] / m[i][i];
            for j in i..=n {
                m[k][j] -= f * m[i][j];
            }
        }
    }
    for i in (0..n).rev() {
        for j in i + 1..n {
            m[i][n] -= m[i][j] * m[j][n];
        }
        m[i][n] /= m[i][i];
    }
    Some(m.into_iter().map(|r| r[n]).collect())
}

/// Truth: what the arguments say. Nothing of it gives numbers that look like an answer.
#[test]
fn what_cannot_be_unmixed_is_refused_or_said() {
    let refuse =
        |m: Array2<f64>| Mixing::new(m.clone(), &names(m.ncols())).unwrap_err().to_string();
    assert!(refuse(array![[1.0, 0.0], [2.0, 0.0]]).contains("m1 reflects nothing"));
    let same = refuse(array![[1.0, 0.5, 3.0], [2.0, 0.1, 6.0]]);
    assert!(same.contains("m0 and m2 have one spectrum"), "{same}");
    assert!(refuse(array![[1.0, f64::NAN], [2.0, 1.0]]).contains("NaN"));
    assert!(refuse(Array2::zeros((0, 2))).contains("at least one"));

    // One channel: one endmember is a division; two cannot be told apart.
    let one = Mixing::new(array![[0.5]], &names(1)).unwrap();
    let found = one.solve(&[2.0], Noise::Independent(&[0.1]), Constraint::Free).unwrap();
    assert_eq!((found.weights[0], found.sigma[0], found.unique), (4.0, 0.2, true));
    let two = Mixing::new(array![[0.5, 0.25]], &names(2)).unwrap();
    assert!(!two.is_complete() && two.rank == 1 && two.condition.is_infinite());
    let found = two.solve(&[2.0], Noise::Independent(&[0.1]), Constraint::Free).unwrap();
    assert!(!found.unique && found.sigma.iter().all(|s| s.is_infinite()), "{found:?}");
    // With a known sum one channel does: 0.5 a + 0.25 (8 − a) = 3 at a = 4.
    let found = two.solve(&[3.0], Noise::Independent(&[0.1]), Constraint::Sum(8.0)).unwrap();
    assert!(found.unique && (found.weights[0] - 4.0).abs() < 1e-13, "{found:?}");
    assert!((found.sigma[0] - 0.4).abs() < 1e-13 && (found.sigma[1] - 0.4).abs() < 1e-13);

    // Zero light; negative rates; no numbers.
    let m = Mixing::new(array![[1.0, 0.2], [0.3, 1.0], [0.5, 0.5]], &names(2)).unwrap();
    let dark = m.solve(&[0.0; 3], Noise::Independent(&[1.0; 3]), Constraint::Free).unwrap();
    assert_eq!(dark.weights, [0.0, 0.0]);
    assert!(dark.shares[0].is_nan() && dark.residual_relative.is_nan() && dark.sigma[0] > 0.0);
    let negative = m.solve(&[-1.0, -2.0, -0.5], Noise::Unknown, Constraint::Free).unwrap();
    assert_eq!(
        (&negative.weights[..], &negative.bounded[..]),
        (&[0.0, 0.0][..], &[true, true][..])
    );
    assert!((negative.residual_relative - 1.0).abs() < 1e-15 && negative.unique);
    let wrong = |x: [f64; 3], noise: Noise<'_>| m.solve(&x, noise, Constraint::Free).unwrap_err();
    assert!(wrong([f64::NAN, 1.0, 1.0], Noise::Unknown).to_string().contains("channel 1"));
    assert!(matches!(
        wrong([1.0; 3], Noise::Independent(&[1.0, 0.0, 1.0])),
        MixingError::Sigma { channel: 1, .. }
    ));
    let indefinite = array![[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    assert!(matches!(
        wrong([1.0; 3], Noise::Covariance(indefinite.view())),
        MixingError::Covariance { .. }
    ));
    let sum = m.solve(&[1.0; 3], Noise::Unknown, Constraint::Sum(0.0)).unwrap_err();
    assert!(matches!(sum, MixingError::Nnls(NnlsError::Sum { .. })));

    // More endmembers than channels: unique only where data outside the cone push all but a few to their bounds.
    let wide = Mixing::new(array![[1.0, 0.5, 0.2], [0.2, 0.6, 1.0]], &names(3)).unwrap();
    assert_eq!(wide.rank, 2);
    let inside = wide.solve(&[1.0, 1.0], Noise::Unknown, Constraint::Free).unwrap();
    assert!(!inside.unique && inside.sigma.iter().all(|s| !s.is_finite()), "{inside:?}");
    let outside = wide.solve(&[1.0, 0.0], Noise::Unknown, Constraint::Free).unwrap();
    assert!(outside.unique && outside.weights[1..] == [0.0, 0.0], "{outside:?}");
}

/// Truth: scales at the ends of f64 are powers of two away from scales near 1: the weights are the same numbers but for that power.
#[test]
fn scales_at_the_ends_of_the_numbers_change_nothing() {
    for seed in 0..200 {
        let p = problem(7 * seed + 1);
        let plain = Nnls::new(p.matrix.view(), Constraint::Free).unwrap().solve(&p.x).unwrap();
        for (column, data) in [(400, 400), (-400, -400), (-600, -100), (500, 0)] {
            let matrix = p.matrix.mapv(|v| v * 2.0_f64.powi(column));
            let x: Vec<f64> = p.x.iter().map(|v| v * 2.0_f64.powi(data)).collect();
            let far = Nnls::new(matrix.view(), Constraint::Free).unwrap().solve(&x).unwrap();
            let back: Vec<f64> =
                far.weights.iter().map(|w| w * 2.0_f64.powi(column - data)).collect();
            assert_eq!(back, plain.weights, "seed {seed}");
        }
        assert!(violation(&p.matrix, &p.x, &plain.weights) <= 1e-12);
    }
}

/// Truth: where no bound holds, projection is plain least squares: the same weights as the active set finds, which is another way there.
/// Tolerance: 1e-11 of the largest weight; the columns are random, their condition below 1e3.
#[test]
fn subspace_projection_is_least_squares() {
    let mut compared = 0;
    for seed in 0..2000 {
        let p = problem(7 * seed + 2);
        let found = Nnls::new(p.matrix.view(), Constraint::Free).unwrap().solve(&p.x).unwrap();
        if !found.in_use.iter().all(|u| *u) || p.matrix.nrows() < p.matrix.ncols() + 4 {
            continue;
        }
        compared += 1;
        let weights = osp(p.matrix.view(), &p.x).unwrap();
        for (a, b) in weights.iter().zip(&found.weights) {
            assert!((a - b).abs() < 1e-11, "{a} {b}");
        }
    }
    assert!(compared > 100, "{compared}");
    assert!(osp(array![[1.0, 2.0], [2.0, 4.0]].view(), &[1.0, 1.0]).is_err());
}
