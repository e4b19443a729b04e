//! All orders of light among patches, between two ends.
//!
//! With Q of [`super::transport`] between diffuse patches and Q₀ the light that a diffuse patch scatters once (ρA/π), an observer gets
//! V Q E of light whose first and last diffuse patches are two: V and E hold what comes straight (v, e) and what comes by one rough surface. With one
//! diffuse patch alone this is (V − v) Q₀ (E − e) where a rough surface stands at both ends. Where it stands at one end, and where two rough surfaces
//! scatter one after the other, light is scattered twice in all and found from point to point ([`super::chords`]). This is all light that is scattered twice
//! or more but for paths that end (or begin) with two rough surfaces and have a third scattering.

use super::chords::Pairs;
use super::clear::Twice;
use super::optics::Optics;
use super::spectral::Spectral;
use super::surfaces::Surfaces;
use super::transport::{self, Exchange, Matrix, SCRAMBLES, Stored};
use super::views::{End, Patched};
use rayon::prelude::*;
use std::f64::consts::FRAC_1_PI;

/// White is taken as a little darker: of a cavity that loses nothing there is no end.
const WHITEST: f64 = 1.0 - 1e-7;
/// Standard errors that are claimed: Student's t of 7 degrees of freedom at 96 %.
const CLAIMED: f64 = 2.5;
/// Error that few matrices in place of one a node may make, as a share of the error between the nodes.
const OF_NODES: f64 = 0.03;
/// Wavelengths at which it is found how coarse and how noisy the light is: between them it is as the worse of the two beside.
const LOOKED_AT: usize = 12;
/// No less than this: numbers are stored to 6e-8.
const LEAST_SPECTRAL: f64 = 1e-6;

/// The orders at some wavelengths.
#[derive(Debug)]
pub struct Orders {
    nodes: Vec<Node>,
    /// Q of the patches at all wavelengths, in few matrices.
    spectral: Spectral,
    /// S of the larger patches by each scramble, less their mean; and that mean.
    scrambles: Vec<Matrix>,
    mean: Matrix,
    /// ρ/A of the larger patches at the node of which these are.
    kept: Vec<f64>,
    /// Light that goes straight between clear pairs, of the patches and of the larger ones.
    straight: [Straight; 2],
    /// The nodes at which errors are found, increasing; the first and the last are among them.
    looked: Vec<usize>,
    /// The number of the node that these are of.
    tried: usize,
}

/// S between the patches of clear pairs: for each patch its partners.
#[derive(Debug, Default)]
struct Straight {
    rows: Vec<Vec<(u32, f32)>>,
    /// For each patch the number of its material among the diffuse ones.
    material: Vec<usize>,
    /// Areas of the patches, m².
    area: Vec<f64>,
    materials: usize,
}

/// At one wavelength, of the patches and of the larger ones.
#[derive(Debug)]
struct Node {
    /// Q of the larger patches, and the light that each scatters once under E = 1.
    coarse: Stored,
    once: Vec<f64>,
    /// ρ of each diffuse material.
    diffuse: Vec<f64>,
    /// ρ of each channel.
    rho: Vec<f64>,
}

/// Light at one wavelength, m² sr⁻¹.
#[derive(Debug, Clone, Copy, Default)]
pub struct Found {
    pub light: f64,
    /// Change of the light with patches of twice the size.
    pub left: f64,
    /// The claimed error of the form factors.
    pub factors: f64,
    /// The claimed error of the directions of rough surfaces.
    pub chords: f64,
}

impl Found {
    /// The claimed error of everything but the patches' size.
    pub fn noise(&self) -> f64 {
        self.factors + self.chords
    }
}

/// Room for vectors, of the larger patches.
#[derive(Debug, Default)]
pub struct Vectors {
    ends: [Vec<f64>; 2],
    rows: [Vec<f64>; 2],
}

impl Orders {
    /// At some of the optics' nodes, of which the exchange knows its error at the one that is `tried`; `None` where light is never lost.
    pub fn new(
        patched: &Patched,
        exchange: &Exchange,
        optics: &Optics,
        (wanted, tried): (std::ops::Range<usize>, usize),
        between_nodes: f64,
    ) -> Option<Self> {
        let patches = &patched.patches;
        let alone = exchange.matrix(patches);
        let [fine, coarse] = patches.diffuse;
        let areas = [&patched.areas[0][..fine], &patched.areas[1][..coarse]];
        let at = |node: usize| {
            let rho = reflectances(patched, optics, node);
            let gathered = transport::gathered(&exchange.at(&alone, patches, node), patches);
            let large = transport::solve(&gathered, areas[1], &rho[1])?;
            let coarse = large.into_iter().map(|q| q as f32).collect();
            let once = areas[1].iter().zip(&rho[1]).map(|(a, r)| FRAC_1_PI * a * r).collect();
            let of_material = |m: &usize| optics.lambert(*m).map_or(0.0, |r| r[node]).min(WHITEST);
            let diffuse = patched.clear.materials.iter().map(of_material).collect();
            let channels = patched.chords.channels.iter();
            let rho = channels.map(|(m, k)| optics.rho(*m, *k, node)).collect();
            Some(Node { coarse, once, diffuse, rho })
        };
        let nodes = wanted.clone().into_par_iter().map(at).collect::<Option<Vec<Node>>>()?;
        let fine = |n: usize| {
            let node = wanted.start + n;
            let [rho, _] = reflectances(patched, optics, node);
            transport::solve(&exchange.at(&alone, patches, node), areas[0], &rho)
        };
        let larger: Vec<&Stored> = nodes.iter().map(|node| &node.coarse).collect();
        let spectral =
            Spectral::new(&larger, (OF_NODES * between_nodes).max(LEAST_SPECTRAL), fine)?;
        let mut scrambles: Vec<Matrix> = (0..SCRAMBLES).map(|k| exchange.scramble(k)).collect();
        let share = 1.0 / SCRAMBLES as f64;
        let mean: Matrix = (0..coarse * coarse)
            .map(|k| share * scrambles.iter().map(|s| s[k]).sum::<f64>())
            .collect();
        for scramble in &mut scrambles {
            scramble.iter_mut().zip(&mean).for_each(|(s, m)| *s -= m);
        }
        let straight = Straight::of(patched, &alone);
        let [_, rho] = reflectances(patched, optics, tried);
        let kept = rho.iter().zip(areas[1]).map(|(r, a)| r / a).collect();
        let tried = tried - wanted.start;
        let last = nodes.len().saturating_sub(1);
        let step = last as f64 / (LOOKED_AT - 1) as f64;
        let mut looked: Vec<usize> =
            (0..LOOKED_AT).map(|k| (k as f64 * step).round() as usize).collect();
        looked.push(tried);
        looked.sort_unstable();
        looked.dedup();
        Some(Self { nodes, spectral, scrambles, mean, kept, straight, looked, tried })
    }

    /// Matrices of the patches that an epoch reads.
    pub fn matrices(&self) -> usize {
        self.spectral.len()
    }

    /// The light between two ends, the Sun's or the Earth's and the observer's, at each wavelength.
    pub fn light(
        &self,
        ends: [&End; 2],
        pairs: &Pairs,
        twice: &Twice,
        vectors: &mut Vectors,
    ) -> Vec<Found> {
        let factors = self.nodes.get(self.tried).map_or(0.0, |node| {
            node.brought(ends, vectors);
            self.of_factors(ends, [&vectors.ends[0], &vectors.ends[1]], twice)
        });
        let by_patches = [0, 1].map(|level| {
            let [sun, eye] = ends.map(|end| &end.straight[level][..]);
            if twice.is_counted { self.straight[level].by_materials(eye, sun) } else { Vec::new() }
        });
        let fine = self.spectral.between(ends);
        let between = self.straight[0].between_rough(ends);
        let mut paired = vec![0.0; pairs.sets.first().map_or(0, Vec::len)];
        for set in &pairs.sets {
            paired.iter_mut().zip(set).for_each(|(sum, w)| *sum += w);
        }
        let paired = Sparse::of(&paired);
        let light = |n: usize| {
            let node = &self.nodes[n];
            let (all, off) = self.spectral.at(n, &node.rho, &fine);
            let known = node.known(twice, &by_patches);
            // What rounding leaves below 0 is nothing.
            let by_factors = (all - known.by_patches[0]).max(0.0);
            let light = by_factors
                + quadratic(&node.diffuse, &node.rho, &between)
                + paired.sum(&node.rho)
                + known.light;
            let factors = factors * by_factors + off + known.error;
            (Found { light, left: 0.0, factors, chords: 0.0 }, known)
        };
        let (mut found, known): (Vec<Found>, Vec<Known>) = (0..self.nodes.len()).map(light).unzip();
        for &n in &self.looked {
            self.nodes[n].look(ends, pairs, vectors, (&known[n], &paired), &mut found[n]);
        }
        for ends in self.looked.windows(2) {
            let [a, b] = [found[ends[0]], found[ends[1]]];
            for between in &mut found[ends[0] + 1..ends[1]] {
                // What has light at neither end is as bad there.
                let worse = |of: &dyn Fn(&Found) -> f64| {
                    let one = |end: &Found| {
                        let share = if end.light > 0.0 { between.light / end.light } else { 1.0 };
                        share * of(end)
                    };
                    one(&a).max(one(&b))
                };
                (between.left, between.chords) = (worse(&|f| f.left), worse(&|f| f.chords));
            }
        }
        found
    }

    /// The claimed error of the form factors, relative to the light that patches find: of what goes from patch to patch once (but between clear pairs) and twice.
    fn of_factors(&self, ends: [&End; 2], [e, v]: [&[f64]; 2], twice: &Twice) -> f64 {
        let [sun, eye] = ends.map(|end| &end.straight[1][..]);
        let once = |s: &Matrix| {
            let known = if twice.is_counted { self.straight[1].within(eye, s, sun) } else { 0.0 };
            transport::between(v, s, e) - known
        };
        // After one exchange.
        let gone = |x: &[f64]| {
            let n = x.len();
            let mut out = vec![0.0; n];
            for (x, row) in
                x.iter().zip(self.mean.chunks_exact(n.max(1))).filter(|(x, _)| **x != 0.0)
            {
                out.iter_mut().zip(row).for_each(|(o, s)| *o += x * s);
            }
            out.iter_mut().zip(&self.kept).for_each(|(o, kept)| *o *= kept);
            out
        };
        let (after, before) = (gone(e), gone(v));
        let more = |s: &Matrix| transport::between(v, s, &after);
        let whole = once(&self.mean) + more(&self.mean);
        if whole <= 0.0 {
            return 0.0;
        }
        let all: Vec<f64> = e.iter().zip(&after).map(|(e, after)| e + after).collect();
        let off = |s: &Matrix| {
            let known = if twice.is_counted { self.straight[1].within(eye, s, sun) } else { 0.0 };
            transport::between(v, s, &all) + transport::between(&before, s, e) - known
        };
        let square: f64 = self.scrambles.iter().map(|s| off(s).powi(2)).sum();
        CLAIMED * (square * of_mean()).sqrt() / whole
    }
}

/// The variance of a mean of eight by the sum of their squares.
fn of_mean() -> f64 {
    let n = SCRAMBLES as f64;
    1.0 / (n * (n - 1.0))
}

impl Straight {
    /// Light of the patches and of the larger ones, from what goes straight from patch to patch.
    fn of(patched: &Patched, alone: &Matrix) -> [Self; 2] {
        let Patched { patches, clear, .. } = patched;
        let [fine, coarse] = patches.diffuse;
        let mut surface = [vec![0; fine], vec![0; coarse]];
        for (p, patch) in patches.list[..fine].iter().enumerate() {
            let number = patches.cells[patch.cells].surface;
            surface[0][p] = number;
            surface[1][patch.coarse] = number;
        }
        let gathered = transport::gathered(alone, patches);
        let mut matrices = [alone, &gathered].into_iter();
        let mut open = patched.areas.iter();
        surface.map(|surface| {
            let (n, s) = (surface.len(), matrices.next().map_or(&[][..], |m| m));
            let row = |p: usize| -> Vec<(u32, f32)> {
                if clear.is_empty() {
                    return Vec::new();
                }
                let partners = (0..n).filter(|q| clear.holds(surface[p], surface[*q]));
                let with = |q: usize| (q as u32, s[p * n + q] as f32);
                partners.map(with).filter(|(_, s)| *s > 0.0).collect()
            };
            Self {
                rows: (0..n).map(row).collect(),
                area: open.next().map_or(Vec::new(), |areas| areas[..n].to_vec()),
                material: surface.iter().map(|k| clear.material(*k)).collect(),
                materials: clear.materials.len(),
            }
        })
    }

    /// v S e/π for each material that is seen and each that is lit.
    fn by_materials(&self, v: &[f64], e: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.materials * self.materials];
        for (p, v) in v.iter().enumerate().filter(|(_, v)| **v != 0.0) {
            let row = &mut out[self.material[p] * self.materials..][..self.materials];
            for (q, s) in &self.rows[p] {
                let q = *q as usize;
                row[self.material[q]] += FRAC_1_PI * v * f64::from(*s) * e[q];
            }
        }
        out
    }

    /// Light that one diffuse patch alone scatters between rough surfaces, before all three reflectances: for each diffuse material, that of the observer's and the Sun's channels.
    fn between_rough(&self, [sun, eye]: [&End; 2]) -> Vec<Sparse> {
        let count = sun.gain.fine.len();
        let brings = |row: &&Vec<f64>| row.iter().any(|x| *x != 0.0);
        let suns: Vec<&Vec<f64>> = sun.gain.fine.iter().filter(brings).collect();
        let numbers: Vec<usize> = (0..count).filter(|c| brings(&&sun.gain.fine[*c])).collect();
        let mut out = vec![Sparse::default(); self.materials];
        let mut room = vec![0.0; self.materials * suns.len()];
        for (a, v) in eye.gain.fine.iter().enumerate().filter(|(_, v)| brings(v)) {
            room.fill(0.0);
            for (k, v) in v.iter().enumerate().filter(|(_, v)| **v != 0.0) {
                let scale = FRAC_1_PI * self.area[k] * v;
                let row = &mut room[self.material[k] * suns.len()..][..suns.len()];
                row.iter_mut().zip(&suns).for_each(|(sum, e)| *sum += scale * e[k]);
            }
            for (out, row) in out.iter_mut().zip(room.chunks_exact(suns.len().max(1))) {
                let all = numbers.iter().zip(row).filter(|(_, w)| **w != 0.0);
                out.0.extend(all.map(|(b, w)| (a, *b, *w)));
            }
        }
        out
    }

    /// v S e of another matrix between clear pairs.
    fn within(&self, v: &[f64], s: &Matrix, e: &[f64]) -> f64 {
        let n = e.len();
        let seen = v.iter().enumerate().filter(|(_, v)| **v != 0.0);
        let row = |(p, v): (usize, &f64)| {
            let one = |(q, _): &(u32, f32)| s[p * n + *q as usize] * e[*q as usize];
            v * self.rows[p].iter().map(one).sum::<f64>()
        };
        seen.map(row).sum()
    }
}

/// Light of clear pairs at a wavelength, and how much of it is in the sums over patches and over the larger ones.
#[derive(Debug, Clone, Copy, Default)]
struct Known {
    light: f64,
    error: f64,
    by_patches: [f64; 2],
}

impl Node {
    /// The light of clear pairs at this wavelength.
    fn known(&self, twice: &Twice, by_patches: &[Vec<f64>; 2]) -> Known {
        if !twice.is_counted {
            return Known::default();
        }
        let sum = |row: &[f64]| bilinear(&self.diffuse, &self.diffuse, row);
        Known {
            light: sum(&twice.light),
            error: sum(&twice.error),
            by_patches: [0, 1].map(|level| sum(&by_patches[level])),
        }
    }

    /// Finds how far larger patches are off, and how noisy lobes are.
    fn look(
        &self,
        ends: [&End; 2],
        pairs: &Pairs,
        vectors: &mut Vectors,
        (known, paired): (&Known, &Sparse),
        found: &mut Found,
    ) {
        self.brought(ends, vectors);
        let Vectors { ends: [sun, eye], rows } = vectors;
        let straight = |end: usize| &ends[end].straight[1][..];
        let large = transport::between(eye, &self.coarse, sun);
        let large = (large - known.by_patches[1]).max(0.0) + known.light;
        let coarse =
            large + self.once([sun, eye], [straight(0), straight(1)]) + paired.sum(&self.rho);
        found.left = (found.light - coarse).abs();
        if self.rho.is_empty() {
            return;
        }
        let others = [(&*eye, straight(1)), (&*sun, straight(0))];
        for (row, (all, straight)) in rows.iter_mut().zip(others) {
            row.resize(all.len(), 0.0);
            transport::times(all, &self.coarse, row);
            for (k, q) in self.once.iter().enumerate() {
                row[k] += q * (all[k] - straight[k]);
            }
        }
        let mut estimates = [0.0; SCRAMBLES];
        for (k, (estimate, set)) in estimates.iter_mut().zip(&pairs.sets).enumerate() {
            *estimate = bilinear(&self.rho, &self.rho, set);
            for (end, row) in ends.into_iter().zip(&*rows) {
                for (rho, gain) in self.rho.iter().zip(&end.gain.sets[k]) {
                    *estimate += rho * gain.iter().zip(row).map(|(g, r)| g * r).sum::<f64>();
                }
            }
        }
        let n = SCRAMBLES as f64;
        let mean = estimates.iter().sum::<f64>() / n;
        let square: f64 = estimates.iter().map(|e| (n * (e - mean)).powi(2)).sum();
        found.chords = CLAIMED * (square * of_mean()).sqrt();
    }

    /// All that the ends bring to the larger patches.
    fn brought(&self, ends: [&End; 2], vectors: &mut Vectors) {
        for (end, room) in ends.into_iter().zip(&mut vectors.ends) {
            room.clear();
            room.extend_from_slice(&end.straight[1]);
            for (c, rho) in self.rho.iter().enumerate().take(end.gain.fine.len()) {
                for set in &end.gain.sets {
                    room.iter_mut().zip(&set[c]).for_each(|(r, g)| *r += rho * g);
                }
            }
        }
    }

    /// Returns the light that one of the larger diffuse patches alone scatters between rough surfaces.
    fn once(&self, [e, v]: [&[f64]; 2], [e0, v0]: [&[f64]; 2]) -> f64 {
        if self.rho.is_empty() {
            return 0.0;
        }
        let more = |k: usize| (v[k] - v0[k]) * (e[k] - e0[k]);
        self.once.iter().enumerate().map(|(k, q)| q * more(k)).sum()
    }
}

/// Σ a b m over the rows of a matrix and its columns.
fn bilinear(a: &[f64], b: &[f64], matrix: &[f64]) -> f64 {
    let row = |row: &[f64]| row.iter().zip(b).map(|(m, b)| m * b).sum::<f64>();
    matrix.chunks_exact(b.len().max(1)).zip(a).map(|(m, a)| a * row(m)).sum()
}

/// Numbers of pairs of channels that are not 0: most channels bring nothing.
#[derive(Debug, Clone, Default)]
struct Sparse(Vec<(usize, usize, f64)>);

impl Sparse {
    /// Those of a square matrix.
    fn of(matrix: &[f64]) -> Self {
        let count = matrix.len().isqrt().max(1);
        let all = matrix.iter().enumerate().filter(|(_, m)| **m != 0.0);
        Self(all.map(|(k, m)| (k / count, k % count, *m)).collect())
    }

    /// Σ ρ m ρ.
    fn sum(&self, rho: &[f64]) -> f64 {
        self.0.iter().map(|(a, b, m)| rho[*a] * m * rho[*b]).sum()
    }
}

/// The same, for each diffuse material.
fn quadratic(diffuse: &[f64], rho: &[f64], matrices: &[Sparse]) -> f64 {
    diffuse.iter().zip(matrices).map(|(d, matrix)| d * matrix.sum(rho)).sum()
}

/// Returns the reflectances of the diffuse patches and of the larger ones.
fn reflectances(patched: &Patched, optics: &Optics, node: usize) -> [Vec<f64>; 2] {
    let Patched { surfaces, patches, .. } = patched;
    let [fine, coarse] = patches.diffuse;
    let mut large = vec![0.0; coarse];
    let small = patches.list[..fine].iter().map(|patch| {
        let surface = &surfaces.list[patches.cells[patch.cells].surface];
        let rho = optics.lambert(surface.material).map_or(0.0, |r| r[node]).min(WHITEST);
        large[patch.coarse] = rho;
        rho
    });
    [small.collect(), large]
}

/// The node where most light is bounced.
pub fn brightest(optics: &Optics, surfaces: &Surfaces, active: &[usize]) -> usize {
    let rho = |material: usize, s: usize| {
        let weights = 0..optics.material(material).spectra().len();
        weights.map(|k| optics.rho(material, k, s)).fold(0.0, f64::max)
    };
    let sum = |s: usize| -> f64 {
        let of = |k: &usize| surfaces.list[*k].area * rho(surfaces.list[*k].material, s);
        active.iter().map(of).sum()
    };
    (0..optics.nodes).max_by(|a, b| sum(*a).total_cmp(&sum(*b))).unwrap_or(0)
}
