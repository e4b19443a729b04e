//! Least squares with bounds, from normal equations: minimise ½ xᵀG x − gᵀx with low ≤ x ≤ high.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Directions of the scaled normal matrix (unit diagonal) with an eigenvalue below this share of the largest are not determined.
pub(super) const SINGULAR: f64 = 1e-11;

/// Solves G x = g for symmetric G ≥ 0, scaled to a unit diagonal; in directions that G does not determine the solution of least length is taken.
pub(super) fn solve(g_matrix: &DMatrix<f64>, g: &DVector<f64>) -> DVector<f64> {
    let n = g.len();
    let scale = DVector::from_fn(n, |i, _| match g_matrix[(i, i)] {
        d if d > 0.0 => 1.0 / d.sqrt(),
        _ => 0.0,
    });
    let scaled = DMatrix::from_fn(n, n, |i, j| g_matrix[(i, j)] * scale[i] * scale[j]);
    let right = g.component_mul(&scale);
    if let Some(cholesky) = scaled.clone().cholesky() {
        let l = cholesky.l_dirty();
        let least = (0..n).map(|i| l[(i, i)]).fold(f64::INFINITY, f64::min);
        if least * least > 1e3 * SINGULAR {
            return cholesky.solve(&right).component_mul(&scale);
        }
    }
    (inverse(&scaled).0 * right).component_mul(&scale)
}

/// The pseudo-inverse of a symmetric matrix, and its eigenvectors that are not determined.
pub(super) fn inverse(matrix: &DMatrix<f64>) -> (DMatrix<f64>, Vec<DVector<f64>>) {
    let n = matrix.nrows();
    if n == 0 {
        return (DMatrix::zeros(0, 0), Vec::new());
    }
    let eigen = SymmetricEigen::new(matrix.clone());
    let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
    let (mut inverse, mut open) = (DMatrix::zeros(n, n), Vec::new());
    for (k, value) in eigen.eigenvalues.iter().enumerate() {
        let vector = eigen.eigenvectors.column(k).into_owned();
        if *value > SINGULAR * largest {
            inverse += &vector * vector.transpose() / *value;
        } else {
            open.push(vector);
        }
    }
    (inverse, open)
}

/// The bounded solution: an active set as of Stark and Parker 1995 (BVLS). Which bounds hold is returned beside it.
pub(super) fn solve_bounded(
    g_matrix: &DMatrix<f64>,
    g: &DVector<f64>,
    low: &[f64],
    high: &[f64],
) -> (DVector<f64>, Vec<bool>) {
    let n = g.len();
    let plain = solve(g_matrix, g);
    if (0..n).all(|i| low[i] <= plain[i] && plain[i] <= high[i]) {
        return (plain, vec![false; n]);
    }
    // From the corner nearest to the unbounded solution; what is within its bounds starts free.
    let mut x = DVector::from_fn(n, |i, _| plain[i].clamp(low[i], high[i]));
    let mut free: Vec<bool> = (0..n).map(|i| low[i] < plain[i] && plain[i] < high[i]).collect();
    settle(g_matrix, g, low, high, &mut x, &mut free);
    // Each round frees one; every set of free numbers lowers the sum, so that none comes twice.
    for _ in 0..8 * n + 8 {
        let slope = g - g_matrix * &x;
        let gain = |i: usize| {
            let worth = g_matrix[(i, i)].sqrt().max(f64::MIN_POSITIVE);
            let inward = match x[i] {
                v if v <= low[i] => slope[i],
                _ => -slope[i],
            };
            inward / worth
        };
        let tolerance = 1e-10
            * g.iter().enumerate().fold(0.0_f64, |m, (i, v)| {
                m.max((v / g_matrix[(i, i)].sqrt().max(f64::MIN_POSITIVE)).abs())
            });
        let best = (0..n)
            .filter(|i| !free[*i] && low[*i] < high[*i] && g_matrix[(*i, *i)] > 0.0)
            .max_by(|a, b| gain(*a).total_cmp(&gain(*b)));
        match best {
            Some(i) if gain(i) > tolerance => free[i] = true,
            _ => break,
        }
        settle(g_matrix, g, low, high, &mut x, &mut free);
    }
    let bound = free.iter().map(|f| !f).collect();
    (x, bound)
}

/// Goes to the solution of what is free, stopping at bounds, which then hold.
fn settle(
    g_matrix: &DMatrix<f64>,
    g: &DVector<f64>,
    low: &[f64],
    high: &[f64],
    x: &mut DVector<f64>,
    free: &mut [bool],
) {
    for _ in 0..=free.len() {
        let set: Vec<usize> = (0..free.len()).filter(|i| free[*i]).collect();
        if set.is_empty() {
            return;
        }
        let part = DMatrix::from_fn(set.len(), set.len(), |a, b| g_matrix[(set[a], set[b])]);
        let right = DVector::from_fn(set.len(), |a, _| {
            let i = set[a];
            let held = (0..free.len()).filter(|j| !free[*j]);
            g[i] - held.map(|j| g_matrix[(i, j)] * x[j]).sum::<f64>()
        });
        let wanted = solve(&part, &right);
        // As far as the first bound on the way.
        let (mut share, mut first) = (1.0, None);
        for (a, i) in set.iter().enumerate() {
            let end = if wanted[a] < low[*i] {
                low[*i]
            } else if wanted[a] > high[*i] {
                high[*i]
            } else {
                continue;
            };
            let step = (end - x[*i]) / (wanted[a] - x[*i]);
            if first.is_none() || step < share {
                (share, first) = (step.clamp(0.0, 1.0), Some((*i, end)));
            }
        }
        for (a, i) in set.iter().enumerate() {
            x[*i] += share * (wanted[a] - x[*i]);
        }
        let Some((i, end)) = first else { return };
        x[i] = end;
        free[i] = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the conditions of Karush, Kuhn and Tucker, which only the minimum of a convex problem meets, on 300 drawn problems; and for a
    /// diagonal matrix the clamped quotient. Tolerance: rounding of 8 × 8 systems.
    #[test]
    fn bounded_solutions_meet_the_conditions_of_the_minimum() {
        let mut state = 1_u64;
        let mut draw = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / (1_u64 << 31) as f64 - 0.5
        };
        for round in 0..300 {
            let n = 2 + round % 7;
            let a = DMatrix::from_fn(3 * n, n, |_, _| draw());
            let b = DVector::from_fn(3 * n, |_, _| 2.0 * draw());
            let (g_matrix, g) = (a.transpose() * &a, a.transpose() * &b);
            let (low, high) = (vec![0.0; n], vec![0.5; n]);
            let (x, bound) = solve_bounded(&g_matrix, &g, &low, &high);
            let slope = &g - &g_matrix * &x;
            for i in 0..n {
                assert!((0.0..=0.5).contains(&x[i]), "{round}: {x}");
                let fine = match (bound[i], x[i]) {
                    (false, _) => slope[i].abs() < 1e-9,
                    (true, 0.0) => slope[i] < 1e-9,
                    (true, _) => slope[i] > -1e-9,
                };
                assert!(fine, "{round}: x {} slope {} bound {}", x[i], slope[i], bound[i]);
            }
        }
        let g_matrix = DMatrix::from_diagonal(&DVector::from_row_slice(&[2.0, 4.0]));
        let (x, bound) =
            solve_bounded(&g_matrix, &DVector::from_row_slice(&[-1.0, 1.0]), &[0.0; 2], &[9.0; 2]);
        assert_eq!((x[0], x[1], bound), (0.0, 0.25, vec![true, false]));
    }

    /// Truth: by hand: of two equal columns only the sum is determined, and the shortest solution shares it.
    #[test]
    fn equal_columns_share_what_they_explain() {
        let g_matrix = DMatrix::from_row_slice(2, 2, &[1.0, 1.0, 1.0, 1.0]);
        let x = solve(&g_matrix, &DVector::from_row_slice(&[3.0, 3.0]));
        assert!((x[0] - 1.5).abs() < 1e-12 && (x[1] - 1.5).abs() < 1e-12, "{x}");
        assert_eq!(inverse(&g_matrix).1.len(), 1);
    }
}
