//! All orders of light among patches, between two ends.
//!
//! With Q of [`super::transport`] between diffuse patches and Q₀ the light that a diffuse patch scatters once (ρA/π), an observer gets
//! V Q E of light whose first and last diffuse patches are two: V and E hold what comes straight (v, e) and what comes by one rough surface. With one
//! diffuse patch alone this is (V − v) Q₀ (E − e) where a rough surface stands at both ends. Where it stands at one end, and where two rough surfaces
//! scatter one after the other, light is scattered twice in all and found from point to point ([`super::chords`]). This is all light that is scattered twice
//! or more but for paths that end (or begin) with two rough surfaces and have a third scattering.

use super::chords::Pairs;
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
    /// The number of the node that these are of.
    tried: usize,
}

/// At one wavelength, of the patches and of the larger ones.
#[derive(Debug)]
struct Node {
    /// Q of the larger patches.
    coarse: Stored,
    once: [Vec<f64>; 2],
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

/// Room for vectors.
#[derive(Debug, Default)]
pub struct Vectors {
    ends: [[Vec<f64>; 2]; 2],
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
            let s = exchange.at(&alone, patches, node);
            let gathered = transport::gathered(&s, patches);
            let stored = |q: Matrix| q.into_iter().map(|q| q as f32).collect::<Stored>();
            let all = stored(transport::solve(&s, areas[0], &rho[0])?);
            let large = stored(transport::solve(&gathered, areas[1], &rho[1])?);
            let once = [0, 1].map(|k| {
                areas[k].iter().zip(&rho[k]).map(|(a, r)| FRAC_1_PI * a * r).collect::<Vec<f64>>()
            });
            let channels = patched.chords.channels.iter();
            let rho = channels.map(|(m, k)| optics.rho(*m, *k, node)).collect();
            Some((all, Node { coarse: large, once, rho }))
        };
        let solved = wanted.clone().into_par_iter().map(at).collect::<Option<Vec<_>>>()?;
        let (all, nodes): (Vec<Stored>, Vec<Node>) = solved.into_iter().unzip();
        let spectral = Spectral::new(all, (OF_NODES * between_nodes).max(LEAST_SPECTRAL));
        let mut scrambles: Vec<Matrix> = (0..SCRAMBLES).map(|k| exchange.scramble(k)).collect();
        let share = 1.0 / SCRAMBLES as f64;
        let mean: Matrix = (0..coarse * coarse)
            .map(|k| share * scrambles.iter().map(|s| s[k]).sum::<f64>())
            .collect();
        for scramble in &mut scrambles {
            scramble.iter_mut().zip(&mean).for_each(|(s, m)| *s -= m);
        }
        Some(Self { nodes, spectral, scrambles, mean, tried: tried - wanted.start })
    }

    /// Matrices of the patches that an epoch reads.
    pub fn matrices(&self) -> usize {
        self.spectral.len()
    }

    /// The light between two ends, the Sun's or the Earth's and the observer's, at each wavelength.
    pub fn light(&self, ends: [&End; 2], pairs: &Pairs, vectors: &mut Vectors) -> Vec<Found> {
        let factors = self.nodes.get(self.tried).map_or(0.0, |node| {
            node.brought(ends, vectors);
            self.of_factors([&vectors.ends[0][1], &vectors.ends[1][1]])
        });
        let fine = self.spectral.between(ends);
        let light = |(n, node): (usize, &Node)| {
            let (all, off) = self.spectral.at(n, &node.rho, &fine);
            node.light(factors, ends, pairs, vectors, (all, off))
        };
        self.nodes.iter().enumerate().map(light).collect()
    }

    /// The claimed error of the form factors, relative.
    fn of_factors(&self, [e, v]: [&[f64]; 2]) -> f64 {
        let whole = transport::between(v, &self.mean, e);
        if whole <= 0.0 {
            return 0.0;
        }
        let square: f64 = self.scrambles.iter().map(|s| transport::between(v, s, e).powi(2)).sum();
        CLAIMED * (square * of_mean()).sqrt() / whole
    }
}

/// The variance of a mean of eight by the sum of their squares.
fn of_mean() -> f64 {
    let n = SCRAMBLES as f64;
    1.0 / (n * (n - 1.0))
}

impl Node {
    /// The light at this wavelength; `all` is what goes between two diffuse patches, with its error.
    fn light(
        &self,
        factors: f64,
        ends: [&End; 2],
        pairs: &Pairs,
        vectors: &mut Vectors,
        (all, off): (f64, f64),
    ) -> Found {
        self.brought(ends, vectors);
        let Vectors { ends: [sun, eye], rows } = vectors;
        let straight = |level: usize| [&ends[0].straight[level], &ends[1].straight[level]];
        let sets = || pairs.sets.iter().map(|set| self.paired(set));
        let pair = sets().sum::<f64>();
        let fine = all + self.once(0, [&sun[0], &eye[0]], straight(0)) + pair;
        let large = transport::between(&eye[1], &self.coarse, &sun[1]);
        let coarse = large + self.once(1, [&sun[1], &eye[1]], straight(1)) + pair;
        let mut chords = 0.0;
        if !self.rho.is_empty() {
            let others = [(&*eye, &ends[1].straight), (&*sun, &ends[0].straight)];
            for (row, (all, straight)) in rows.iter_mut().zip(others) {
                row.resize(all[1].len(), 0.0);
                transport::times(&all[1], &self.coarse, row);
                for (k, q) in self.once[1].iter().enumerate() {
                    row[k] += q * (all[1][k] - straight[1][k]);
                }
            }
            let mut estimates = [0.0; SCRAMBLES];
            for (k, (estimate, pair)) in estimates.iter_mut().zip(sets()).enumerate() {
                *estimate = pair;
                for (end, row) in ends.into_iter().zip(&*rows) {
                    for (rho, gain) in self.rho.iter().zip(&end.gain.sets[k]) {
                        *estimate += rho * gain.iter().zip(row).map(|(g, r)| g * r).sum::<f64>();
                    }
                }
            }
            let n = SCRAMBLES as f64;
            let mean = estimates.iter().sum::<f64>() / n;
            let square: f64 = estimates.iter().map(|e| (n * (e - mean)).powi(2)).sum();
            chords = CLAIMED * (square * of_mean()).sqrt();
        }
        Found { light: fine, left: (fine - coarse).abs(), factors: factors * fine + off, chords }
    }

    /// All that the ends bring to the patches and to the larger ones.
    fn brought(&self, ends: [&End; 2], vectors: &mut Vectors) {
        for (end, rooms) in ends.into_iter().zip(&mut vectors.ends) {
            for (room, straight) in rooms.iter_mut().zip(&end.straight) {
                room.clear();
                room.extend_from_slice(straight);
            }
            let mut add = |level: usize, rho: f64, gain: &[f64]| {
                rooms[level].iter_mut().zip(gain).for_each(|(r, g)| *r += rho * g);
            };
            for (c, rho) in self.rho.iter().enumerate().take(end.gain.fine.len()) {
                add(0, *rho, &end.gain.fine[c]);
                end.gain.sets.iter().for_each(|set| add(1, *rho, &set[c]));
            }
        }
    }

    /// Returns the light that one diffuse patch alone scatters between rough surfaces.
    fn once(&self, level: usize, [e, v]: [&[f64]; 2], [e0, v0]: [&Vec<f64>; 2]) -> f64 {
        if self.rho.is_empty() {
            return 0.0;
        }
        let more = |k: usize| (v[k] - v0[k]) * (e[k] - e0[k]);
        self.once[level].iter().enumerate().map(|(k, q)| q * more(k)).sum()
    }

    /// Returns the light that is scattered twice, by a rough surface at least once.
    fn paired(&self, pairs: &[f64]) -> f64 {
        let n = self.rho.len();
        pairs.iter().enumerate().map(|(k, w)| self.rho[k / n] * self.rho[k % n] * w).sum()
    }
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
