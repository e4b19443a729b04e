//! Diffuse light among patches: form factors by rays, all orders by one symmetric solution for each node.
//!
//! With S the symmetric matrix A_p F_pq, ρ the reflectances and e the irradiances in E, the light that leaves patch p after two scatterings
//! or more is (I − C)⁻¹ − I in between, C = √(ρ_p/A_p) S_pq √(ρ_q/A_q), and what an observer gets of it is v Q e with
//! v the shares of the patches that are seen times cosθ_o. Q is symmetric, so light and observer may be swapped, and S has the row sums that rays
//! counted, so no light is made.
//!
//! A ray that meets a rough surface goes on in a direction drawn from its material, until it meets a diffuse one: so S holds light that went from one
//! diffuse patch to another by any number of rough surfaces, at each node.

use super::cast::{Caster, Ray};
use super::optics::Optics;
use super::patches::Patches;
use super::paths::mixed;
use super::surfaces::Surfaces;
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::{FRAC_1_PI, PI};
use std::ops::Range;

/// Scrambles that do not know of each other.
pub const SCRAMBLES: usize = 8;
/// Rays of each patch and scramble at most.
pub const MOST_RAYS: u32 = 1 << 12;
/// A patch counts as open by this share of it at least.
pub const LEAST_OPEN: f64 = 1e-3;
/// Rounds of scaling to the row sums.
const ROUNDS: usize = 40;
/// Rough surfaces that a ray meets before it ends by chance, in proportion to what it has lost.
const SAFE: u32 = 2;
/// Patches whose rays are sent side by side before what they brought is added up.
const TOGETHER: usize = 64;
/// The longest way from one diffuse patch to another.
const LONGEST: u32 = 100;

/// How patches see each other, as rays have it.
#[derive(Debug, Clone)]
pub struct Exchange {
    count: usize,
    coarse: usize,
    /// Rays of each patch and scramble.
    pub rays: u32,
    /// Rays from one patch to another, all scrambles.
    hits: Vec<u32>,
    /// Light that rays brought from one patch to another by rough surfaces, for each node; none where there are no rough surfaces.
    through: Vec<Matrix>,
    /// Rays that began inside of another body.
    buried: Vec<u32>,
    /// Light brought between the larger patches in any way at one node, for each scramble, times the patch's area, m².
    scrambles: Vec<Vec<f64>>,
    /// That node.
    node: usize,
}

/// Result of the rays of one patch.
struct Shot {
    /// For each patch.
    hits: Vec<u32>,
    buried: u32,
    through: Through,
    /// For each scramble and larger patch.
    scrambles: Vec<f64>,
}

/// Light that the rays of one patch brought by rough surfaces: most patches get none.
struct Through {
    nodes: usize,
    /// For each patch its row, counted from 1; 0 where there is none.
    row: Vec<u32>,
    /// The patches that have rows, and these: the light at each node.
    patches: Vec<usize>,
    rows: Vec<f64>,
}

impl Through {
    fn add(&mut self, patch: usize, light: &[f64]) {
        if self.row[patch] == 0 {
            self.patches.push(patch);
            self.row[patch] = self.patches.len() as u32;
            self.rows.resize(self.patches.len() * self.nodes, 0.0);
        }
        let row = (self.row[patch] as usize - 1) * self.nodes;
        let sums = &mut self.rows[row..row + self.nodes];
        sums.iter_mut().zip(light).for_each(|(sum, light)| *sum += light);
    }
}

/// Square symmetric, row by row.
pub type Matrix = Vec<f64>;

/// The same in half of the memory, which is what a product waits for: 6e-8 of each number.
pub type Stored = Vec<f32>;

/// Scene that rays go through.
#[derive(Debug, Clone, Copy)]
pub struct Between<'a> {
    pub surfaces: &'a Surfaces,
    pub caster: &'a Caster,
    pub patches: &'a Patches,
    /// The cells of each surface.
    pub of_surface: &'a [Range<usize>],
}

impl Exchange {
    /// Creates an empty exchange of the diffuse patches, with light at `nodes` wavelengths where there are rough ones; the error is known of `node`.
    pub fn new(patches: &Patches, nodes: usize, node: usize) -> Self {
        let [count, coarse] = patches.diffuse;
        let nodes = if patches.list.len() > count { nodes } else { 0 };
        Self {
            count,
            coarse,
            rays: 0,
            hits: vec![0; count * count],
            through: vec![vec![0.0; count * count]; nodes],
            buried: vec![0; count],
            scrambles: vec![vec![0.0; coarse * coarse]; SCRAMBLES],
            node,
        }
    }

    /// Sends rays until each patch has sent `until` of each scramble.
    pub fn shoot(&mut self, between: &Between, optics: &Optics, until: u32, seed: u32) {
        let patches = between.patches;
        for first in (0..self.count).step_by(TOGETHER) {
            let some = first..(first + TOGETHER).min(self.count);
            let own = |optics: &mut Optics, p| self.shot(between, optics, p, (until, seed));
            let shots: Vec<Shot> =
                some.clone().into_par_iter().map_init(|| optics.clone(), own).collect();
            some.zip(shots).for_each(|(p, shot)| self.take(p, patches.list[p].coarse, &shot));
        }
        self.rays = until;
    }

    /// Adds what the rays of a patch brought, a part of the larger patch `coarse`.
    fn take(&mut self, p: usize, coarse: usize, shot: &Shot) {
        let add = |sum: &mut [f64], own: &[f64]| {
            sum.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
        };
        let row = p * self.count..(p + 1) * self.count;
        self.hits[row.clone()].iter_mut().zip(&shot.hits).for_each(|(sum, own)| *sum += own);
        self.buried[p] += shot.buried;
        let rows = shot.through.rows.chunks(shot.through.nodes.max(1));
        for (q, light) in shot.through.patches.iter().zip(rows) {
            let sums = self.through.iter_mut().zip(light);
            sums.for_each(|(sum, light)| sum[p * self.count + q] += light);
        }
        let row = coarse * self.coarse..(coarse + 1) * self.coarse;
        for (sum, own) in self.scrambles.iter_mut().zip(shot.scrambles.chunks(self.coarse)) {
            add(&mut sum[row.clone()], own);
        }
    }

    /// Traces the rays of one patch, from those that it has sent up to `until` of each scramble.
    fn shot(
        &self,
        between: &Between,
        optics: &mut Optics,
        p: usize,
        (until, seed): (u32, u32),
    ) -> Shot {
        let Between { surfaces, caster, patches, of_surface } = *between;
        let mut light = vec![0.0; self.through.len()];
        let mut shot = Shot {
            hits: vec![0; self.count],
            buried: 0,
            through: Through {
                nodes: self.through.len(),
                row: vec![0; self.count],
                patches: Vec::new(),
                rows: Vec::new(),
            },
            scrambles: vec![0.0; self.coarse * SCRAMBLES],
        };
        let patch = &patches.list[p];
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
                let Ok(hit) = caster.first_outside(&ray, |k| !surfaces.list[k].sheet) else {
                    shot.buried += 1;
                    continue;
                };
                let met = hit.and_then(|hit| patches.met_by(surfaces, of_surface, &ray, hit));
                let Some(met) = met else { continue };
                let followed = self.follow(between, optics, (ray, met), (index, seed), &mut light);
                let Some((q, by)) = followed else { continue };
                let brought = if by == 0 { 1.0 } else { light[self.node] };
                shot.scrambles[scramble * self.coarse + patches.list[q].coarse] +=
                    patch.area * brought;
                if by == 0 {
                    shot.hits[q] += 1;
                    continue;
                }
                shot.through.add(q, &light);
            }
        }
        shot
    }

    /// The diffuse patch at which a ray ends and by how many rough surfaces it came there, from the patch (with its surface and the place) that it meets first, with what they leave of its light: nothing is written where it
    /// came straight.
    fn follow(
        &self,
        between: &Between,
        optics: &mut Optics,
        (mut ray, mut met): (Ray, (usize, usize, DVec3)),
        (index, seed): (u32, u32),
        light: &mut [f64],
    ) -> Option<(usize, u32)> {
        let Between { surfaces, caster, patches, of_surface } = *between;
        for by in 0..LONGEST {
            let (q, number, at) = met;
            if q < self.count {
                return Some((q, by));
            }
            if by == 0 {
                light.fill(1.0);
            }
            let surface = &surfaces.list[number];
            let there = surface.place(number, at);
            let came = there.local(-ray.along);
            let set = by + 1;
            let u = sobol_burley::sample_4d(index, set % 16, mixed(seed, set / 16)).map(f64::from);
            let drawn = optics.draw(surface.material, came, [u[0], u[1], u[2]]);
            let density = drawn.density.filter(|d| *d > 0.0 && drawn.to.z > 0.0)?;
            let before = light.iter().copied().fold(0.0, f64::max);
            optics.scatter(surface.material, came, drawn.to, drawn.to.z / density, light);
            let after = light.iter().copied().fold(0.0, f64::max);
            if by >= SAFE {
                let stays = (after / before).min(1.0);
                if u[3] >= stays {
                    return None;
                }
                light.iter_mut().for_each(|l| *l /= stays);
            }
            if after <= 0.0 {
                return None;
            }
            ray = Ray { from: at, along: there.body(drawn.to), leaves: number };
            met = patches.met(surfaces, caster, of_surface, &ray)?;
        }
        None
    }

    /// Returns the part of each diffuse patch that is inside of another body.
    pub fn buried(&self) -> impl Iterator<Item = f64> + '_ {
        let each = f64::from(self.rays) * SCRAMBLES as f64;
        self.buried.iter().map(move |buried| f64::from(*buried) / each)
    }

    /// Returns the exchange by rough surfaces at a node, from both directions; `None` where there are none.
    fn through(&self, patches: &Patches, node: usize) -> Option<Matrix> {
        let (n, rows) = (self.count, self.through.get(node)?);
        let each = 2.0 * f64::from(self.rays) * SCRAMBLES as f64;
        let area = |p: usize| patches.list[p].area / each;
        let both = |p: usize, q: usize| area(p) * rows[p * n + q] + area(q) * rows[q * n + p];
        Some((0..n * n).map(|k| both(k / n, k % n)).collect())
    }

    /// S at a node: `alone` is [`Exchange::matrix`].
    pub fn at(&self, alone: &Matrix, patches: &Patches, node: usize) -> Matrix {
        match self.through(patches, node) {
            None => alone.clone(),
            Some(through) => alone.iter().zip(&through).map(|(a, b)| a + b).collect(),
        }
    }

    /// S of what goes straight from patch to patch: the mean of both directions, scaled to the row sums that were counted.
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
                .chunks(n.max(1))
                .zip(&wanted)
                .map(|(row, wanted)| {
                    let sum: f64 = row.iter().sum();
                    if sum > 0.0 { (wanted / sum).sqrt() } else { 0.0 }
                })
                .collect();
            for (row, a) in s.chunks_mut(n.max(1)).zip(&scale) {
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
    let [n, m] = patches.diffuse;
    let mut s = vec![0.0; m * m];
    for (p, a) in patches.list[..n].iter().enumerate() {
        for (q, b) in patches.list[..n].iter().enumerate() {
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
    let mut q: Matrix = (0..n * n).map(|k| c(k / n, k % n)).collect();
    substitute(&factor, n, &mut q);
    for (row, a) in q.chunks_mut(n.max(1)).zip(&outer) {
        row.iter_mut().zip(&outer).for_each(|(q, b)| *q *= a * b);
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
            row[k] = (row[k] - dot(&row[..k], &other[..k])) / other[k];
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

/// All columns of x at once, row by row.
fn substitute(l: &Matrix, n: usize, x: &mut [f64]) {
    for p in 0..n {
        let (above, row) = x.split_at_mut(p * n);
        let row = &mut row[..n];
        for (a, other) in l[p * n..p * n + p].iter().zip(above.chunks_exact(n)) {
            if *a != 0.0 {
                row.iter_mut().zip(other).for_each(|(x, o)| *x -= a * o);
            }
        }
        row.iter_mut().for_each(|x| *x /= l[p * n + p]);
    }
    for p in (0..n).rev() {
        let (above, row) = x.split_at_mut(p * n);
        let row = &mut row[..n];
        row.iter_mut().for_each(|x| *x /= l[p * n + p]);
        for (a, other) in l[p * n..p * n + p].iter().zip(above.chunks_exact_mut(n)) {
            if *a != 0.0 {
                other.iter_mut().zip(&*row).for_each(|(o, x)| *o -= a * x);
            }
        }
    }
}

/// v M.
pub fn times(v: &[f64], matrix: &[f32], out: &mut [f64]) {
    out.fill(0.0);
    let rows = v.iter().zip(matrix.chunks_exact(out.len().max(1))).filter(|(v, _)| **v != 0.0);
    for (v, row) in rows {
        out.iter_mut().zip(row).for_each(|(o, m)| *o += v * f64::from(*m));
    }
}

/// v M e.
pub fn between<T: Copy + Into<f64>>(v: &[f64], matrix: &[T], e: &[f64]) -> f64 {
    let n = e.len().max(1);
    let rows = v.iter().zip(matrix.chunks_exact(n)).filter(|(v, _)| **v != 0.0);
    rows.map(|(v, row)| v * dot(row, e)).sum()
}

/// In eight sums side by side.
fn dot<T: Copy + Into<f64>>(a: &[T], b: &[f64]) -> f64 {
    let (a8, b8) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = a8.remainder().iter().zip(b8.remainder()).map(|(a, b)| (*a).into() * b).sum();
    let mut sums = [0.0; 8];
    for (a, b) in a8.zip(b8) {
        for k in 0..8 {
            sums[k] += a[k].into() * b[k];
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
