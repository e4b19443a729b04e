//! Exchange matrices of many wavelengths, in few.
//!
//! The matrices Q_n of a body with a handful of materials differ over all wavelengths n by a handful of reflectances: they are rational functions of them,
//! and combinations of a few matrices B_k give all of them. So an epoch reads a few matrices and not one for each wavelength. The B_k are found
//! by Gram–Schmidt among the Q_n, each number relative to its mean over the wavelengths Q̄, so that what is left is known of every number: |Q_n − Σ_k c_nk B_k| ≤ ε_n Q̄.
//! All numbers of both ends are positive, hence the error of the light is at most ε_n v Q̄ e.

use super::transport::Stored;
use super::views::End;
use rayon::prelude::*;

/// Q of each wavelength as a combination of few.
#[derive(Debug)]
pub struct Spectral {
    /// The first is the mean over the wavelengths.
    basis: Vec<Stored>,
    /// For each wavelength the factors of the basis.
    mix: Vec<Vec<f64>>,
    /// For each wavelength the largest error of a number, of that of the mean.
    off: Vec<f64>,
}

/// For each matrix of the basis: v B e of each pair of what comes straight and by each channel of rough surfaces, observer's by Sun's.
pub struct Products {
    channels: [usize; 2],
    each: Vec<Vec<f64>>,
}

impl Spectral {
    /// In as many matrices as an error of `wanted` asks for, relative to the mean over the wavelengths.
    pub fn new(all: Vec<Stored>, wanted: f64) -> Self {
        let count = all.len();
        if count < 2 {
            let (mix, off) = (vec![vec![1.0]; count], vec![0.0; count]);
            return Self { basis: all, mix, off };
        }
        let numbers = all[0].len();
        let share = 1.0 / count as f64;
        let mut mean = vec![0.0_f64; numbers];
        for q in &all {
            mean.iter_mut().zip(q).for_each(|(m, q)| *m += share * f64::from(*q));
        }
        // What is left of each wavelength, relative to the mean.
        let mut left = all;
        for q in &mut left {
            for (q, m) in q.iter_mut().zip(&mean) {
                *q = if *m > 0.0 { (f64::from(*q) / m) as f32 - 1.0 } else { 0.0 };
            }
        }
        let mut mix = vec![vec![1.0]; count];
        let mut basis = vec![mean.iter().map(|m| *m as f32).collect::<Stored>()];
        let mut off: Vec<f64> = left.iter().map(|q| largest(q)).collect();
        while basis.len() < count {
            let Some(worst) = (0..count).max_by(|a, b| off[*a].total_cmp(&off[*b])) else { break };
            if off[worst] <= wanted {
                break;
            }
            let axis = left[worst].clone();
            let square = product(&axis, &axis);
            if square <= 0.0 {
                break;
            }
            let each = left.par_iter_mut().zip(&mut mix).zip(&mut off);
            each.for_each(|((q, mix), off)| {
                let factor = (product(q, &axis) / square) as f32;
                q.iter_mut().zip(&axis).for_each(|(q, a)| *q -= factor * a);
                mix.push(f64::from(factor));
                *off = largest(q);
            });
            let stored = axis.iter().zip(&mean).map(|(a, m)| (f64::from(*a) * m) as f32);
            basis.push(stored.collect());
        }
        Self { basis, mix, off }
    }

    /// How many matrices there are.
    pub fn len(&self) -> usize {
        self.basis.len()
    }

    /// Returns the light that both ends bring, the Sun or the Earth and the observer, through each matrix: each is read once.
    pub fn between(&self, [sun, eye]: [&End; 2]) -> Products {
        let [suns, eyes] = [sun, eye]
            .map(|end| std::iter::once(&end.straight[0]).chain(&end.gain.fine).collect::<Vec<_>>());
        let n = suns[0].len();
        // Most patches are dark to one end: those that are not, alone.
        let open = |rows: &[&Vec<f64>]| {
            (0..n).filter(|k| rows.iter().any(|row| row[*k] != 0.0)).collect::<Vec<usize>>()
        };
        let (lit, seen) = (open(&suns), open(&eyes));
        let packed: Vec<Vec<f64>> =
            suns.iter().map(|row| lit.iter().map(|k| row[*k]).collect()).collect();
        let mut room = vec![0.0; lit.len()];
        let mut one = |matrix: &Stored| {
            let mut out = vec![0.0; eyes.len() * suns.len()];
            for p in &seen {
                let row = &matrix[p * n..(p + 1) * n];
                room.iter_mut().zip(&lit).for_each(|(m, q)| *m = f64::from(row[*q]));
                for (b, e) in packed.iter().enumerate() {
                    let dot = dot(&room, e);
                    for (a, v) in eyes.iter().enumerate() {
                        out[a * suns.len() + b] += v[*p] * dot;
                    }
                }
            }
            out
        };
        Products {
            channels: [suns.len(), eyes.len()],
            each: self.basis.iter().map(&mut one).collect(),
        }
    }

    /// The light between two diffuse patches at a wavelength where the channels have these reflectances, with its error.
    pub fn at(&self, node: usize, rho: &[f64], products: &Products) -> (f64, f64) {
        let [suns, _] = products.channels;
        // What comes straight, then each channel.
        let through = |each: &[f64]| -> f64 {
            let of_suns = |row: &[f64]| {
                let more = rho.iter().zip(&row[1..]).map(|(r, x)| r * x);
                row[0] + more.sum::<f64>()
            };
            let mut rows = each.chunks_exact(suns);
            let straight = rows.next().map_or(0.0, of_suns);
            straight + rho.iter().zip(rows).map(|(r, row)| r * of_suns(row)).sum::<f64>()
        };
        let Some(first) = products.each.first() else { return (0.0, 0.0) };
        let mut all = vec![0.0; first.len()];
        for (each, factor) in products.each.iter().zip(&self.mix[node]) {
            all.iter_mut().zip(each).for_each(|(all, x)| *all += factor * x);
        }
        (through(&all).max(0.0), self.off[node] * through(first))
    }
}

/// Numbers side by side in a sum: as many as a processor takes at once.
const SIDE_BY_SIDE: usize = 8;

/// Σ a b of stored numbers, in double precision.
fn product(a: &[f32], b: &[f32]) -> f64 {
    let mut sums = [0.0; SIDE_BY_SIDE];
    let (wide_a, wide_b) = (a.chunks_exact(SIDE_BY_SIDE), b.chunks_exact(SIDE_BY_SIDE));
    let rest = wide_a.remainder().iter().zip(wide_b.remainder());
    let rest: f64 = rest.map(|(a, b)| f64::from(*a) * f64::from(*b)).sum();
    for (a, b) in wide_a.zip(wide_b) {
        for k in 0..SIDE_BY_SIDE {
            sums[k] += f64::from(a[k]) * f64::from(b[k]);
        }
    }
    rest + sums.iter().sum::<f64>()
}

/// The largest of the numbers' sizes.
fn largest(q: &[f32]) -> f64 {
    let mut most = [0.0_f32; SIDE_BY_SIDE];
    let wide = q.chunks_exact(SIDE_BY_SIDE);
    let rest = wide.remainder().iter().fold(0.0_f32, |most, x| most.max(x.abs()));
    for q in wide {
        for (most, x) in most.iter_mut().zip(q) {
            let size = x.abs();
            *most = if size > *most { size } else { *most };
        }
    }
    f64::from(most.into_iter().fold(rest, f32::max))
}

/// Σ a b in four sums, side by side.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (wide_a, wide_b) = (a.chunks_exact(4), b.chunks_exact(4));
    let rest: f64 = wide_a.remainder().iter().zip(wide_b.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in wide_a.zip(wide_b) {
        for k in 0..4 {
            sums[k] += a[k] * b[k];
        }
    }
    rest + sums.iter().sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::super::transport;
    use super::*;

    /// Truth: the matrices of each wavelength themselves. Forty wavelengths of a row of ten patches of three materials, solved one by one: few
    /// matrices give every number within the claimed error (and 2e-7, since numbers are stored to 6e-8).
    #[test]
    fn few_matrices_give_all_wavelengths() {
        let n = 10;
        let area: Vec<f64> = (0..n).map(|k| 0.5 + 0.1 * k as f64).collect();
        let mut s = vec![0.0; n * n];
        for p in 0..n {
            for q in (0..n).filter(|q| *q != p) {
                s[p * n + q] = 0.06 / (1.0 + (p as f64 - q as f64).abs());
            }
        }
        let materials = |t: f64| [0.05 + 0.9 * t, 0.6 + 0.3 * (7.0 * t).sin(), 0.3 + 0.2 * t * t];
        let solved = |k: usize| {
            let of = materials(k as f64 / 39.0);
            let rho: Vec<f64> = (0..n).map(|p| of[p % 3]).collect();
            let q = transport::solve(&s, &area, &rho).unwrap();
            q.into_iter().map(|q| q as f32).collect::<Stored>()
        };
        let all: Vec<Stored> = (0..40).map(solved).collect();
        for wanted in [1e-2, 1e-4, 1e-6] {
            let few = Spectral::new(all.clone(), wanted);
            assert!(few.len() < 25, "{wanted}: {}", few.len());
            for (node, truth) in all.iter().enumerate() {
                assert!(few.off[node] <= wanted);
                for (k, q) in truth.iter().enumerate() {
                    let found: f64 = few
                        .basis
                        .iter()
                        .zip(&few.mix[node])
                        .map(|(b, c)| f64::from(b[k]) * c)
                        .sum();
                    let off = (found - f64::from(*q)).abs();
                    let mean = f64::from(few.basis[0][k]);
                    assert!(off <= (few.off[node] + 5e-7) * mean, "{wanted} {node} {k}: {off}");
                }
            }
        }
    }
}
