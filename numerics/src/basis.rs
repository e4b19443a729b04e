//! An orthonormal basis that grows column by column.

/// Orthonormal columns, and the triangle R by which they make those that were pushed: s_j = Σ_i q_i R_ij. Every column is orthogonalised twice
/// (Gram–Schmidt, "twice is enough": Giraud, Langou and Rozložník 2005), so that the q are orthonormal to rounding however nearly parallel the s are.
#[derive(Debug, Clone, Default)]
pub struct Basis {
    q: Vec<Vec<f64>>,
    /// R by columns; column j has j + 1 numbers.
    r: Vec<Vec<f64>>,
}

/// Sum of products, over as many as the shorter has. Eight sums run beside one another, so that a product need not wait for the sum before it.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    const LANES: usize = 8;
    let n = a.len().min(b.len());
    let (a, b) = (&a[..n], &b[..n]);
    let mut sums = [0.0; LANES];
    let (whole, whole_b) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest: f64 = whole.remainder().iter().zip(whole_b.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in whole.zip(whole_b) {
        for ((sum, x), y) in sums.iter_mut().zip(x).zip(y) {
            *sum += x * y;
        }
    }
    sums.iter().sum::<f64>() + rest
}

/// Length, without overflow.
pub fn norm(a: &[f64]) -> f64 {
    let most = a.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    if most == 0.0 || !most.is_finite() {
        return most;
    }
    most * a.iter().map(|v| (v / most).powi(2)).sum::<f64>().sqrt()
}

impl Basis {
    /// The number of its columns.
    pub fn len(&self) -> usize {
        self.q.len()
    }

    /// Returns true where it has no column.
    pub fn is_empty(&self) -> bool {
        self.q.is_empty()
    }

    /// Takes out of `v` all that lies in the space of the basis, and gives the coordinates of what was taken.
    pub fn project_out(&self, v: &mut [f64]) -> Vec<f64> {
        let mut coordinates = vec![0.0; self.q.len()];
        for _ in 0..2 {
            for (q, c) in self.q.iter().zip(&mut coordinates) {
                let part = dot(q, v);
                *c += part;
                v.iter_mut().zip(q).for_each(|(v, q)| *v -= part * q);
            }
        }
        coordinates
    }

    /// Adds a column if more than `least` of its length stands upright on those that are there; gives that share of its length, from 0 to 1.
    pub fn push(&mut self, column: &[f64], least: f64) -> f64 {
        let mut rest = column.to_vec();
        let mut r = self.project_out(&mut rest);
        let (length, whole) = (norm(&rest), norm(column));
        let share = if whole > 0.0 { length / whole } else { 0.0 };
        if share > least {
            rest.iter_mut().for_each(|v| *v /= length);
            r.push(length);
            self.q.push(rest);
            self.r.push(r);
        }
        share
    }

    /// Qᵀ v.
    pub fn coordinates(&self, v: &[f64]) -> Vec<f64> {
        self.project_out(&mut v.to_vec())
    }

    /// R⁻¹ c: the coefficients of the pushed columns whose combination has the coordinates c.
    pub fn solve(&self, mut c: Vec<f64>) -> Vec<f64> {
        for j in (0..c.len()).rev() {
            c[j] /= self.r[j][j];
            let value = c[j];
            for (i, above) in c[..j].iter_mut().enumerate() {
                *above -= self.r[j][i] * value;
            }
        }
        c
    }

    /// (SᵀS)⁻¹ = R⁻¹R⁻ᵀ of the pushed columns, row by row.
    pub fn inverse_gram(&self) -> Vec<Vec<f64>> {
        let p = self.len();
        let unit = |j: usize| (0..p).map(|i| f64::from(i == j)).collect();
        let columns: Vec<Vec<f64>> = (0..p).map(|j| self.solve(unit(j))).collect();
        let entry = |i: usize, j: usize| columns.iter().map(|c| c[i] * c[j]).sum();
        (0..p).map(|i| (0..p).map(|j| entry(i, j)).collect()).collect()
    }
}
