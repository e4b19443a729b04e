//! Exchange matrices of many wavelengths, in few.
//!
//! The matrices Q_n of a body with a handful of materials differ over all wavelengths n by a handful of reflectances: they are rational functions of them,
//! and combinations of a few matrices B_k give all of them. So few are solved, and an epoch reads few. Which wavelengths these are, and how the others are made of
//! them, is found among the larger patches, where all are solved at an eighth of the side's cube: by Gram–Schmidt, each number relative to its mean over
//! the wavelengths Q̄ and a hundredth of what an even exchange would have there, F = r rᵀ / Σr with r the sums of Q̄'s rows; so that what is left is known of every number: |Q_n − Σ_k c_nk B_k| ≤ ε_n (Q̄ + F/100). The small patches have the same c_nk; at the wavelengths where most is left they are solved as
//! well, and where more is left there, all ε_n are larger by as much.
//! All numbers of both ends are positive, hence the error of the light is at most ε_n v (Q̄ + F/100) e.

use super::transport::{Matrix, Stored};
use super::views::End;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Wavelengths at which the small patches are solved besides, to see what is left.
const LOOKED_AT: usize = 3;
/// The share of an even exchange that is added to each number which errors are relative to: patches that hardly see each other have no part in the light, but the most uneven spectra.
const EVEN: f64 = 0.01;
/// Errors among the larger patches that are not gone below: numbers are stored to 6e-8.
const LEAST: f64 = 1e-6;

/// Q of each wavelength as a combination of few.
#[derive(Debug)]
pub struct Spectral {
    basis: Vec<Stored>,
    /// For each wavelength the factors of the basis.
    mix: Vec<Vec<f64>>,
    /// The same of the mean over the wavelengths.
    mean: Vec<f64>,
    /// Sums of the rows of the mean, over the root of all.
    sums: Vec<f64>,
    /// For each wavelength the largest error of a number, of that of the mean.
    off: Vec<f64>,
}

/// For each matrix of the basis: v B e of each pair of what comes straight and by each channel of rough surfaces, observer's by Sun's. Channels that bring nothing are left out.
pub struct Products {
    /// Channels of the Sun's end and the observer's.
    channels: [Vec<usize>; 2],
    each: Vec<Vec<f64>>,
    /// The same through the mean over the wavelengths.
    mean: Vec<f64>,
    /// Light of an even exchange that comes straight and by each channel, Sun's and observer's.
    even: [Vec<f64>; 2],
}

impl Products {
    /// The light that all channels bring together, where they have these reflectances.
    fn through(&self, each: &[f64], rho: &[f64]) -> f64 {
        let [suns, eyes] = &self.channels;
        let of_suns = |row: &[f64]| end(row, suns, rho);
        let mut rows = each.chunks_exact(suns.len() + 1);
        let straight = rows.next().map_or(0.0, of_suns);
        straight + eyes.iter().zip(rows).map(|(c, row)| rho[*c] * of_suns(row)).sum::<f64>()
    }
}

/// Rows of what an end brings to the patches straight, and by some channels.
fn brought<'a>(end: &'a End, channels: &[usize]) -> Vec<&'a Vec<f64>> {
    let gain = channels.iter().map(|c| &end.gain.fine[*c]);
    std::iter::once(&end.straight[0]).chain(gain).collect()
}

/// The sum of what comes straight and by each channel.
fn end(row: &[f64], channels: &[usize], rho: &[f64]) -> f64 {
    row[0] + channels.iter().zip(&row[1..]).map(|(c, x)| rho[*c] * x).sum::<f64>()
}

/// Σ factor × row.
fn mixed(rows: &[Vec<f64>], factors: &[f64]) -> Vec<f64> {
    let mut all = vec![0.0; rows.first().map_or(0, Vec::len)];
    for (row, factor) in rows.iter().zip(factors) {
        all.iter_mut().zip(row).for_each(|(all, x)| *all += factor * x);
    }
    all
}

/// Sums of the rows of a square matrix, over the root of the sum of all: their product is an even exchange.
fn row_sums(matrix: impl Iterator<Item = f64>, n: usize) -> Vec<f64> {
    let mut sums = vec![0.0; n];
    for (k, q) in matrix.enumerate() {
        sums[k / n] += q;
    }
    let root = sums.iter().sum::<f64>().sqrt();
    if root > 0.0 {
        sums.iter_mut().for_each(|s| *s /= root);
    }
    sums
}

/// How the matrices of all wavelengths are made of those at a few.
struct Mixing {
    /// The wavelengths whose matrices are solved, in the order in which they were needed.
    chosen: Vec<usize>,
    /// For each wavelength the factors of what each of them adds to those before it.
    mix: Vec<Vec<f64>>,
    /// For each wavelength the largest error of a number, of that of the mean.
    off: Vec<f64>,
    /// The rest of each wavelength, relative to the mean.
    left: Vec<Stored>,
}

impl Mixing {
    /// Begins with the matrices of all wavelengths: nothing is chosen yet.
    fn new(all: &[&Stored]) -> Self {
        let count = all.len();
        let share = 1.0 / count.max(1) as f64;
        let mut mean = vec![0.0_f64; all.first().map_or(0, |q| q.len())];
        for q in all {
            mean.iter_mut().zip(*q).for_each(|(m, q)| *m += share * f64::from(*q));
        }
        let n = mean.len().isqrt();
        let sums = row_sums(mean.iter().copied(), n);
        for (k, mean) in mean.iter_mut().enumerate() {
            *mean += EVEN * sums[k / n] * sums[k % n];
        }
        let relative = |q: &Stored| -> Stored {
            let each = q.iter().zip(&mean);
            each.map(|(q, m)| if *m > 0.0 { (f64::from(*q) / m) as f32 } else { 0.0 }).collect()
        };
        let left: Vec<Stored> = all.iter().map(|q| relative(q)).collect();
        let off = left.iter().map(|q| largest(q)).collect();
        Self { chosen: Vec::new(), mix: vec![Vec::new(); count], off, left }
    }

    /// The largest error.
    fn most(&self) -> f64 {
        self.off.iter().copied().fold(0.0, f64::max)
    }

    /// Chooses until no error is larger.
    fn until(&mut self, wanted: f64) {
        let count = self.off.len();
        while self.chosen.len() < count && (self.most() > wanted || self.chosen.is_empty()) {
            let worst = (0..count).max_by(|a, b| self.off[*a].total_cmp(&self.off[*b]));
            let Some(worst) = worst else { break };
            self.chosen.push(worst);
            let axis = self.left[worst].clone();
            let square = product(&axis, &axis);
            let each = self.left.par_iter_mut().zip(&mut self.mix).zip(&mut self.off);
            each.for_each(|((q, mix), off)| {
                let factor = if square > 0.0 { (product(q, &axis) / square) as f32 } else { 0.0 };
                q.iter_mut().zip(&axis).for_each(|(q, a)| *q -= factor * a);
                mix.push(f64::from(factor));
                *off = largest(q);
            });
            // Of itself nothing is left but rounding.
            if let Some(own) = self.mix[worst].last_mut() {
                *own = 1.0;
            }
            self.off[worst] = 0.0;
            self.left[worst].fill(0.0);
        }
    }
}

impl Spectral {
    /// In as many matrices as an error of `wanted` asks for, relative to the mean over the wavelengths. `coarse` are the matrices of the larger patches at all
    /// wavelengths, `fine` solves those of the patches at one; `None` where that has no solution.
    pub fn new(
        coarse: &[&Stored],
        wanted: f64,
        fine: impl Fn(usize) -> Option<Matrix> + Sync + Send,
    ) -> Option<Self> {
        let count = coarse.len();
        let mut mixing = Mixing::new(coarse);
        let mut solved = BTreeMap::new();
        let mut basis: Vec<Matrix> = Vec::new();
        let mut until = wanted;
        let (mean, sums, worse) = loop {
            mixing.until(until);
            let Mixing { chosen, mix, off, .. } = &mixing;
            let mut looked: Vec<usize> = (0..count).filter(|n| !chosen.contains(n)).collect();
            looked.sort_by(|a, b| off[*b].total_cmp(&off[*a]));
            looked.truncate(LOOKED_AT);
            let asked = chosen[basis.len()..].iter().chain(&looked).copied();
            let asked: Vec<usize> = asked.filter(|n| !solved.contains_key(n)).collect();
            let found = asked.par_iter().map(|n| fine(*n)).collect::<Option<Vec<_>>>()?;
            solved.extend(asked.into_iter().zip(found));
            for n in &chosen[basis.len()..] {
                let mut q = solved.remove(n)?;
                for (axis, factor) in basis.iter().zip(&mix[*n]) {
                    q.iter_mut().zip(axis).for_each(|(q, a)| *q -= factor * a);
                }
                basis.push(q);
            }
            let share = 1.0 / count.max(1) as f64;
            let mut mean = vec![0.0; basis.len()];
            for mix in mix {
                mean.iter_mut().zip(mix).for_each(|(m, c)| *m += share * c);
            }
            let made = |mix: &[f64], number: usize| -> f64 {
                basis.iter().zip(mix).map(|(b, c)| c * b[number]).sum()
            };
            let size = basis.first().map_or(0, |b| b.len().isqrt());
            let sums = row_sums((0..size * size).map(|k| made(&mean, k)), size);
            let mut worse = 1.0_f64;
            for n in looked {
                let apart = |(k, q): (usize, &f64)| {
                    let mean = made(&mean, k) + EVEN * sums[k / size] * sums[k % size];
                    if mean > 0.0 { (q - made(&mix[n], k)).abs() / mean } else { 0.0 }
                };
                let most = solved.get(&n)?.iter().enumerate().map(apart).fold(0.0, f64::max);
                worse = worse.max(most / off[n].max(f64::from(f32::EPSILON)));
            }
            if worse * mixing.most() <= wanted || until <= LEAST {
                break (mean, sums, worse);
            }
            until = (0.5 * wanted / worse).min(0.5 * until).max(LEAST);
        };
        // Where less is left among the larger patches, the small ones may have as much as anywhere.
        let most = worse * mixing.most();
        let Mixing { chosen, mix, .. } = mixing;
        let off = (0..count).map(|n| if chosen.contains(&n) { 0.0 } else { most }).collect();
        let stored = |q: Matrix| q.into_iter().map(|q| q as f32).collect::<Stored>();
        let basis = basis.into_iter().map(stored).collect();
        Some(Self { basis, mix, mean, sums, off })
    }

    /// How many matrices there are.
    pub fn len(&self) -> usize {
        self.basis.len()
    }

    /// Returns the light that both ends bring, the Sun or the Earth and the observer, through each matrix: each is read once.
    pub fn between(&self, [sun, eye]: [&End; 2]) -> Products {
        let channels = [sun, eye].map(|end| {
            let brings = |row: &Vec<f64>| row.iter().any(|x| *x != 0.0);
            (0..end.gain.fine.len()).filter(|c| brings(&end.gain.fine[*c])).collect::<Vec<_>>()
        });
        let (suns, eyes) = (brought(sun, &channels[0]), brought(eye, &channels[1]));
        let n = suns[0].len();
        // Most patches are dark to one end: those that are not, alone.
        let open = |rows: &[&Vec<f64>]| {
            (0..n).filter(|k| rows.iter().any(|row| row[*k] != 0.0)).collect::<Vec<usize>>()
        };
        let (lit, seen) = (open(&suns), open(&eyes));
        let packed: Vec<Vec<f64>> =
            suns.iter().map(|row| lit.iter().map(|k| row[*k]).collect()).collect();
        // Patches of a surface follow one another.
        let runs: Vec<&[usize]> = lit.chunk_by(|a, b| a + 1 == *b).collect();
        let mut room = vec![0.0; lit.len()];
        let mut one = |matrix: &Stored| {
            let mut out = vec![0.0; eyes.len() * suns.len()];
            for p in &seen {
                let row = &matrix[p * n..(p + 1) * n];
                let mut left = &mut room[..];
                for run in &runs {
                    let (here, rest) = left.split_at_mut(run.len());
                    let from = &row[run[0]..run[0] + run.len()];
                    here.iter_mut().zip(from).for_each(|(m, q)| *m = f64::from(*q));
                    left = rest;
                }
                for (b, e) in packed.iter().enumerate() {
                    let dot = dot(&room, e);
                    for (a, v) in eyes.iter().enumerate() {
                        out[a * suns.len() + b] += v[*p] * dot;
                    }
                }
            }
            out
        };
        let each: Vec<Vec<f64>> = self.basis.iter().map(&mut one).collect();
        let even = [&suns, &eyes].map(|rows| rows.iter().map(|row| dot(row, &self.sums)).collect());
        Products { channels, mean: mixed(&each, &self.mean), each, even }
    }

    /// The light between two diffuse patches at a wavelength where the channels have these reflectances, with its error.
    pub fn at(&self, node: usize, rho: &[f64], products: &Products) -> (f64, f64) {
        if products.each.is_empty() {
            return (0.0, 0.0);
        }
        let made = |all: &[f64]| products.through(all, rho).max(0.0);
        let [sun, eye] = [0, 1].map(|k| end(&products.even[k], &products.channels[k], rho));
        let even = EVEN * sun * eye;
        let light = made(&mixed(&products.each, &self.mix[node]));
        (light, self.off[node] * (made(&products.mean) + even))
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

    /// Truth: the matrices of each wavelength themselves. Forty wavelengths of a row of twelve patches of three materials, solved one by one: few
    /// matrices give every number within the claimed error (and 2e-7, since numbers are stored to 6e-8).
    #[test]
    fn few_matrices_give_all_wavelengths() {
        let n = 12;
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
            let rho: Vec<f64> = (0..n).map(|p| of[p / 2 % 3]).collect();
            transport::solve(&s, &area, &rho).unwrap()
        };
        // The larger patches are two of the small ones each.
        let m = n / 2;
        let mut gathered = vec![0.0; m * m];
        for p in 0..n {
            for q in 0..n {
                gathered[p / 2 * m + q / 2] += s[p * n + q];
            }
        }
        let area_of: Vec<f64> = (0..m).map(|p| area[2 * p] + area[2 * p + 1]).collect();
        let larger = |k: usize| {
            let of = materials(k as f64 / 39.0);
            let rho: Vec<f64> = (0..m).map(|p| of[p % 3]).collect();
            let q = transport::solve(&gathered, &area_of, &rho).unwrap();
            q.into_iter().map(|q| q as f32).collect::<Stored>()
        };
        let coarse: Vec<Stored> = (0..40).map(larger).collect();
        let all: Vec<Matrix> = (0..40).map(solved).collect();
        for wanted in [1e-2, 1e-4] {
            let few =
                Spectral::new(&coarse.iter().collect::<Vec<_>>(), wanted, |k| Some(solved(k)))
                    .unwrap();
            assert!(few.len() < 25, "{wanted}: {}", few.len());
            for (node, truth) in all.iter().enumerate() {
                assert!(few.off[node] <= 10.0 * wanted, "{wanted}: {}", few.off[node]);
                for (k, q) in truth.iter().enumerate() {
                    let made = |mix: &[f64]| -> f64 {
                        few.basis.iter().zip(mix).map(|(b, c)| f64::from(b[k]) * c).sum()
                    };
                    let mean = made(&few.mean) + EVEN * few.sums[k / n] * few.sums[k % n];
                    let off = (made(&few.mix[node]) - q).abs();
                    assert!(off <= (few.off[node] + 5e-7) * mean, "{wanted} {node} {k}: {off}");
                }
            }
        }
    }
}
