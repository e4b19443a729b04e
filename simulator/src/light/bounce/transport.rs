//! Diffuse light among patches: form factors by rays, all orders by one symmetric solution for each node.
//!
//! With S the symmetric matrix A_p F_pq, ρ the reflectances and e the irradiances in E, the light that leaves patch p after two scatterings
//! or more is (I − C)⁻¹ − I in between, C = √(ρ_p/A_p) S_pq √(ρ_q/A_q), and what an observer gets of it is v Q e with
//! v the shares of the patches that are seen times cosθ_o. Q is symmetric, so light and observer may be swapped, and S has the row sums that rays
//! counted, so no light is made.

use super::cast::{Caster, Ray};
use super::patches::Patches;
use super::paths::mixed;
use super::surfaces::Surfaces;
use std::f64::consts::{FRAC_1_PI, PI};
use std::ops::Range;

/// Scrambles that do not know of each other.
pub const SCRAMBLES: usize = 8;
/// Rays of each patch and scramble at most.
pub const MOST_RAYS: u32 = 1 << 12;
/// A patch counts as open by this share of it at least.
const LEAST_OPEN: f64 = 1e-3;
/// Rounds of scaling to the row sums.
const ROUNDS: usize = 40;

/// How patches see each other, as rays have it.
#[derive(Debug, Clone)]
pub struct Exchange {
    count: usize,
    coarse: usize,
    /// Rays of each patch and scramble.
    pub rays: u32,
    /// Rays from one patch to another, all scrambles.
    hits: Vec<u32>,
    /// Rays that began inside of another body.
    buried: Vec<u32>,
    /// The same between the larger patches, of each scramble, times the patch's area, m².
    scrambles: Vec<Vec<f64>>,
}

/// Square symmetric, row by row.
pub type Matrix = Vec<f64>;

impl Exchange {
    pub fn new(patches: &Patches) -> Self {
        let (count, coarse) = (patches.list.len(), patches.coarse_area.len());
        let scrambles = vec![vec![0.0; coarse * coarse]; SCRAMBLES];
        Self {
            count,
            coarse,
            rays: 0,
            hits: vec![0; count * count],
            buried: vec![0; count],
            scrambles,
        }
    }

    /// Sends rays until each patch has sent `until` of each scramble.
    pub fn shoot(
        &mut self,
        surfaces: &Surfaces,
        caster: &Caster,
        patches: &Patches,
        of_surface: &[Range<usize>],
        until: u32,
        seed: u32,
    ) {
        for (p, patch) in patches.list.iter().enumerate() {
            let number = patches.cells[patch.cells].surface;
            let surface = &surfaces.list[number];
            for scramble in 0..SCRAMBLES {
                let seed = mixed(mixed(seed, p as u32), scramble as u32);
                for index in self.rays..until {
                    let u = sobol_burley::sample_4d(index, 0, seed).map(f64::from);
                    let at = surface.point(patch.even(u[0], u[1]));
                    let (sin, cos) = (2.0 * PI * u[3]).sin_cos();
                    let across = u[2].sqrt();
                    let along = (across * cos) * surface.tangent
                        + (across * sin) * surface.bitangent
                        + (1.0 - u[2]).sqrt() * surface.normal;
                    let ray = Ray { from: at, along, leaves: number };
                    if caster.is_inside(&ray, |k| !surfaces.list[k].sheet) {
                        self.buried[p] += 1;
                        continue;
                    }
                    let Some(hit) = caster.first(&ray).filter(|h| h.front) else { continue };
                    let cells = of_surface[hit.surface].clone();
                    if cells.is_empty() {
                        continue;
                    }
                    let other = &surfaces.list[hit.surface];
                    let there = at + hit.distance * along - other.origin;
                    let there = [there.dot(other.tangent), there.dot(other.bitangent)];
                    let Some(q) = patches.at(cells, there) else { continue };
                    self.hits[p * self.count + q] += 1;
                    let (a, b) = (patch.coarse, patches.list[q].coarse);
                    self.scrambles[scramble][a * self.coarse + b] += patch.area;
                }
            }
        }
        self.rays = until;
    }

    /// What of the patches' areas is not inside of another body, m²; of the patches and the larger ones.
    pub fn open_areas(&self, patches: &Patches) -> [Vec<f64>; 2] {
        let each = f64::from(self.rays) * SCRAMBLES as f64;
        let mut coarse = vec![0.0; self.coarse];
        let fine = patches
            .list
            .iter()
            .zip(&self.buried)
            .map(|(patch, buried)| {
                let open = patch.area * (1.0 - f64::from(*buried) / each).max(LEAST_OPEN);
                coarse[patch.coarse] += open;
                open
            })
            .collect();
        [fine, coarse]
    }

    /// S of the patches: the mean of both directions, scaled to the row sums that were counted.
    pub fn matrix(&self, patches: &Patches) -> Matrix {
        let n = self.count;
        let each = f64::from(self.rays) * SCRAMBLES as f64;
        let area = |p: usize| patches.list[p].area / each;
        let mut s = vec![0.0; n * n];
        let mut wanted = vec![0.0; n];
        for p in 0..n {
            for q in 0..n {
                let (there, back) = (self.hits[p * n + q], self.hits[q * n + p]);
                s[p * n + q] = 0.5 * (area(p) * f64::from(there) + area(q) * f64::from(back));
                wanted[p] += area(p) * f64::from(there);
            }
        }
        for _ in 0..ROUNDS {
            let scale: Vec<f64> = s
                .chunks(n)
                .zip(&wanted)
                .map(|(row, wanted)| {
                    let sum: f64 = row.iter().sum();
                    if sum > 0.0 { (wanted / sum).sqrt() } else { 0.0 }
                })
                .collect();
            for (row, a) in s.chunks_mut(n).zip(&scale) {
                row.iter_mut().zip(&scale).for_each(|(s, b)| *s *= a * b);
            }
        }
        s
    }

    /// S of the larger patches, of one scramble: the mean of both directions.
    pub fn scramble(&self, number: usize) -> Matrix {
        let n = self.coarse;
        let rows = &self.scrambles[number];
        let scale = 0.5 / f64::from(self.rays);
        let mut s = vec![0.0; n * n];
        for p in 0..n {
            for q in 0..n {
                s[p * n + q] = scale * (rows[p * n + q] + rows[q * n + p]);
            }
        }
        s
    }
}

/// S of the larger patches, from that of the patches.
pub fn gathered(fine: &Matrix, patches: &Patches) -> Matrix {
    let (n, m) = (patches.list.len(), patches.coarse_area.len());
    let mut s = vec![0.0; m * m];
    for (p, a) in patches.list.iter().enumerate() {
        for (q, b) in patches.list.iter().enumerate() {
            s[a.coarse * m + b.coarse] += fine[p * n + q];
        }
    }
    s
}

/// Q: what an observer gets of light scattered twice or more, from the shares that are seen and lit. `None` where light is never lost.
pub fn solve(s: &Matrix, area: &[f64], rho: &[f64]) -> Option<Matrix> {
    let n = area.len();
    let root: Vec<f64> = area.iter().zip(rho).map(|(a, r)| (r / a).sqrt()).collect();
    let outer: Vec<f64> = area.iter().zip(rho).map(|(a, r)| (a * r * FRAC_1_PI).sqrt()).collect();
    let c = |p: usize, q: usize| root[p] * s[p * n + q] * root[q];
    let mut factor: Matrix =
        (0..n * n).map(|k| f64::from(u8::from(k / n == k % n)) - c(k / n, k % n)).collect();
    if !cholesky(&mut factor, n) {
        return None;
    }
    // (I − C)⁻¹ − I = (I − C)⁻¹ C: no difference of nearly equal numbers where little is bounced.
    let mut q = vec![0.0; n * n];
    let mut column = vec![0.0; n];
    for k in 0..n {
        (0..n).for_each(|p| column[p] = c(p, k));
        substitute(&factor, n, &mut column);
        (0..n).for_each(|p| q[p * n + k] = outer[p] * column[p] * outer[k]);
    }
    for p in 0..n {
        for k in 0..p {
            let mean = 0.5 * (q[p * n + k] + q[k * n + p]);
            (q[p * n + k], q[k * n + p]) = (mean, mean);
        }
    }
    Some(q)
}

/// L of L Lᵀ in the lower half, in place; whether there is one.
fn cholesky(a: &mut Matrix, n: usize) -> bool {
    for p in 0..n {
        let (above, row) = a.split_at_mut(p * n);
        for k in 0..p {
            let other = &above[k * n..k * n + k + 1];
            let dot: f64 = row[..k].iter().zip(other).map(|(x, y)| x * y).sum();
            row[k] = (row[k] - dot) / other[k];
        }
        let dot: f64 = row[..p].iter().map(|x| x * x).sum();
        let left = row[p] - dot;
        // Of a cavity that no light leaves nothing is left but rounding.
        if left.is_nan() || left <= 1e-12 {
            return false;
        }
        row[p] = left.sqrt();
    }
    true
}

fn substitute(l: &Matrix, n: usize, x: &mut [f64]) {
    for p in 0..n {
        let dot: f64 = l[p * n..p * n + p].iter().zip(&*x).map(|(a, b)| a * b).sum();
        x[p] = (x[p] - dot) / l[p * n + p];
    }
    for p in (0..n).rev() {
        x[p] /= l[p * n + p];
        let value = x[p];
        let (before, _) = x.split_at_mut(p);
        before.iter_mut().zip(&l[p * n..p * n + p]).for_each(|(x, a)| *x -= a * value);
    }
}

/// v M e.
pub fn between(v: &[f64], matrix: &[f64], e: &[f64]) -> f64 {
    let n = e.len();
    let rows = v.iter().zip(matrix.chunks_exact(n)).filter(|(v, _)| **v != 0.0);
    rows.map(|(v, row)| v * dot(row, e)).sum()
}

/// In eight sums side by side.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (a8, b8) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = a8.remainder().iter().zip(b8.remainder()).map(|(a, b)| a * b).sum();
    let mut sums = [0.0; 8];
    for (a, b) in a8.zip(b8) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    rest + sums.iter().sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: two patches that see each other wholly, F = f both ways: B = ρe + ρ²f e' + …, summed as a geometric series by hand. 1e-14.
    #[test]
    fn two_patches_by_hand() {
        let (area, f, rho) = ([2.0, 2.0], 0.3, [0.9, 0.5]);
        let s = vec![0.0, 2.0 * f, 2.0 * f, 0.0];
        let q = solve(&s, &area, &rho).unwrap();
        let loss = 1.0 - f * f * rho[0] * rho[1];
        let across = 2.0 * FRAC_1_PI * rho[0] * rho[1] * f / loss;
        let back = 2.0 * FRAC_1_PI * rho[0] * rho[0] * rho[1] * f * f / loss;
        for (found, truth) in [(q[1], across), (q[2], across), (q[0], back)] {
            assert!((found / truth - 1.0).abs() < 1e-14, "{found} {truth}");
        }
        assert!((between(&[0.0, 1.0], &q, &[1.0, 0.0]) - across).abs() < 1e-15);
        // White, and all light stays: no solution.
        assert!(solve(&vec![0.0, 2.0, 2.0, 0.0], &area, &[1.0, 1.0]).is_none());
    }
}
