//! Light that a rough surface sends to others, or gets from them, at one end of a path.
//!
//! A lobe sends the light of the Sun into some directions more than into others, so no reflectance says what another surface gets of it. What the
//! body alone decides is done once: for each rough surface a set of directions, spread by the cosine, and for each of its patches what is met along
//! each of them. For an end (Sun, Earth, observer) the material is then asked once for each direction, and what each patch sends along is added up
//! where it arrives. Eight sets that do not know of each other give the error.

use super::cast::Ray;
use super::optics::{Optics, spread};
use super::patches::Patches;
use super::paths::mixed;
use super::surfaces::{Surface, Surfaces};
use super::transport::{Between, SCRAMBLES};
use super::views::Shares;
use crate::light::occlude::Toward;
use crate::surface::Material;
use glam::DVec3;
use std::f64::consts::PI;
use std::ops::Range;

/// The directions of all rough surfaces.
#[derive(Debug, Clone, Default)]
pub struct Chords {
    /// Directions of a set.
    pub each: u32,
    /// One for each material and spectrum.
    pub channels: Vec<(usize, usize)>,
    sheets: Vec<Sheet>,
    /// For each rough patch what its directions meet, first diffuse patches, then rough ones.
    meets: Vec<[Vec<Meeting>; 2]>,
    /// For each rough patch, how many of its rays began inside of another body.
    buried: Vec<u32>,
}

/// A rough surface.
#[derive(Debug, Clone)]
struct Sheet {
    surface: usize,
    material: Material,
    channels: Range<usize>,
    patches: Range<usize>,
    /// Directions of all sets one after the other, in the surface's axes.
    along: Vec<DVec3>,
    /// Those along which any patch meets anything.
    used: Vec<u32>,
}

/// What a patch meets along a direction.
#[derive(Debug, Clone, Copy)]
struct Meeting {
    direction: u32,
    patch: u32,
}

/// What an end brings to diffuse patches by one rough surface, E or of what is seen.
#[derive(Debug, Clone, Default)]
pub struct Gain {
    /// For each channel and patch.
    pub fine: Vec<Vec<f64>>,
    /// For each set, channel and larger patch.
    pub sets: Vec<Vec<Vec<f64>>>,
    /// The materials' weights along the directions of a surface.
    room: Vec<f64>,
}

/// Light that two rough surfaces scatter one after the other, m² sr⁻¹.
#[derive(Debug, Clone, Default)]
pub struct Pairs {
    /// For each channel of the first surface and of the second.
    pub fine: Vec<f64>,
    /// The same by larger patches, for each set.
    pub sets: Vec<Vec<f64>>,
}

impl Gain {
    /// Of so many channels, diffuse patches and larger ones: nothing yet.
    pub fn new(channels: usize, [fine, coarse]: [usize; 2]) -> Self {
        Self {
            fine: vec![vec![0.0; fine]; channels],
            sets: vec![vec![vec![0.0; coarse]; channels]; SCRAMBLES],
            room: Vec::new(),
        }
    }

    /// Back to nothing.
    pub fn clear(&mut self) {
        self.fine.iter_mut().chain(self.sets.iter_mut().flatten()).for_each(|row| row.fill(0.0));
    }
}

impl Pairs {
    /// Of so many channels: nothing yet.
    pub fn new(channels: usize) -> Self {
        let none = vec![0.0; channels * channels];
        Self { sets: vec![none.clone(); SCRAMBLES], fine: none }
    }

    /// Back to nothing.
    pub fn clear(&mut self) {
        self.fine.fill(0.0);
        self.sets.iter_mut().for_each(|set| set.fill(0.0));
    }
}

impl Chords {
    /// Of the patches after the diffuse ones.
    pub fn new(between: &Between, optics: &Optics, (each, seed): (u32, u32)) -> Self {
        let Between { surfaces, patches, .. } = *between;
        let mut chords = Self { each, ..Self::default() };
        let surface_of = |p: usize| patches.cells[patches.list[p].cells].surface;
        let mut first = patches.diffuse[0];
        while first < patches.list.len() {
            let number = surface_of(first);
            let end = (first..patches.list.len())
                .find(|p| surface_of(*p) != number)
                .unwrap_or(patches.list.len());
            let surface = &surfaces.list[number];
            let sheet = Sheet {
                surface: number,
                material: optics.material(surface.material).clone(),
                channels: chords.channels_of(optics, surface.material),
                patches: first..end,
                along: directions(each, mixed(seed, number as u32)),
                used: Vec::new(),
            };
            chords.add(sheet, between, seed);
            first = end;
        }
        chords
    }

    fn channels_of(&mut self, optics: &Optics, material: usize) -> Range<usize> {
        let count = optics.material(material).spectra().len();
        let first =
            self.channels.iter().position(|c| c.0 == material).unwrap_or(self.channels.len());
        if first == self.channels.len() {
            self.channels.extend((0..count).map(|k| (material, k)));
        }
        first..first + count
    }

    fn add(&mut self, mut sheet: Sheet, between: &Between, seed: u32) {
        let Between { surfaces, caster, patches, of_surface } = *between;
        let surface = &surfaces.list[sheet.surface];
        let mut used = vec![false; sheet.along.len()];
        for p in sheet.patches.clone() {
            let (mut meets, mut buried) = ([Vec::new(), Vec::new()], 0);
            for (k, local) in sheet.along.iter().enumerate() {
                let (set, index) = (k as u32 / self.each, k as u32 % self.each);
                let seed = mixed(mixed(seed, 0xc0 + p as u32), set);
                let u = sobol_burley::sample_4d(index, 1, seed).map(f64::from);
                let from = surface.point(patches.list[p].even(u[0], u[1]));
                let along = body(surface, *local);
                let ray = Ray { from, along, leaves: sheet.surface };
                if caster.is_inside(&ray, |k| !surfaces.list[k].sheet) {
                    buried += 1;
                    continue;
                }
                let Some((q, ..)) = patches.met(surfaces, caster, of_surface, &ray) else {
                    continue;
                };
                used[k] = true;
                let rough = usize::from(q >= patches.diffuse[0]);
                meets[rough].push(Meeting { direction: k as u32, patch: q as u32 });
            }
            self.meets.push(meets);
            self.buried.push(buried);
        }
        sheet.used = (0..used.len() as u32).filter(|k| used[*k as usize]).collect();
        self.sheets.push(sheet);
    }

    /// Whether any rough surface sees another.
    pub fn see_each_other(&self) -> bool {
        self.meets.iter().any(|m| !m[1].is_empty())
    }

    /// How many directions meet anything.
    pub fn meetings(&self) -> usize {
        self.meets.iter().flatten().map(Vec::len).sum()
    }

    /// Of each rough patch, the part that is inside of another body.
    pub fn buried(&self) -> impl Iterator<Item = f64> + '_ {
        let rays = f64::from(self.each) * SCRAMBLES as f64;
        self.buried.iter().map(move |b| f64::from(*b) / rays)
    }

    /// What a patch of an area sends along each of its directions under E = 1 before a weight of 1 sr⁻¹, m².
    fn each_m2(&self, area: f64) -> f64 {
        PI * area / (f64::from(self.each) * SCRAMBLES as f64)
    }

    /// Adds what an end brings to diffuse patches by one rough surface, times `weight`. `sends` of the Sun and the Earth, false of an observer.
    pub fn gather(
        &self,
        (surfaces, patches, areas): (&Surfaces, &Patches, &[Vec<f64>; 2]),
        shares: &Shares,
        (sends, weight): (bool, f64),
        gain: &mut Gain,
    ) {
        let first = patches.diffuse[0];
        let mut room = std::mem::take(&mut gain.room);
        for sheet in &self.sheets {
            let surface = &surfaces.list[sheet.surface];
            let lit = |p: &usize| shares.coarse[patches.list[*p].coarse] > 0.0;
            let mut known = false;
            for p in sheet.patches.clone().filter(lit) {
                let patch = &patches.list[p];
                let near = matches!(shares.toward, Toward::Near(_));
                if near || !known {
                    let end = local(surface, towards(&shares.toward, surface.point(patch.middle)));
                    sheet.weights(end, sends, &mut room);
                    known = true;
                }
                let scale = weight * self.each_m2(patch.area);
                let (fine, coarse) =
                    (scale * shares.fine[p], scale * shares.coarse[patch.coarse]);
                for meeting in &self.meets[p - first][0] {
                    let (q, k) = (meeting.patch as usize, meeting.direction as usize);
                    let (set, large) = (k / self.each as usize, patches.list[q].coarse);
                    let count = sheet.channels.len();
                    let weights = &room[k * count..(k + 1) * count];
                    for (c, w) in sheet.channels.clone().zip(weights) {
                        gain.fine[c][q] += fine * w / areas[0][q];
                        gain.sets[set][c][large] += coarse * w / areas[1][large];
                    }
                }
            }
        }
        gain.room = room;
    }

    /// Adds the light that two rough surfaces scatter one after the other, times `weight`, `from` where it comes from `to` the observer.
    pub fn pairs(
        &self,
        (surfaces, patches): (&Surfaces, &Patches),
        [from, to]: [&Shares; 2],
        weight: f64,
        pairs: &mut Pairs,
    ) {
        let (first, channels) = (patches.diffuse[0], self.channels.len());
        let most = self.sheets.iter().map(|s| s.channels.len()).max().unwrap_or(0);
        let mut rooms = [vec![0.0; most], vec![0.0; most]];
        for sheet in &self.sheets {
            let surface = &surfaces.list[sheet.surface];
            let lit = |p: &usize| from.coarse[patches.list[*p].coarse] > 0.0;
            for p in sheet.patches.clone().filter(lit) {
                let patch = &patches.list[p];
                let sun = local(surface, towards(&from.toward, surface.point(patch.middle)));
                let scale = weight * self.each_m2(patch.area);
                for meeting in &self.meets[p - first][1] {
                    let (q, k) = (meeting.patch as usize, meeting.direction as usize);
                    let there = &patches.list[q];
                    if to.coarse[there.coarse] <= 0.0 {
                        continue;
                    }
                    let number = patches.cells[there.cells].surface;
                    let Some(other) = self.sheets.iter().find(|s| s.surface == number) else {
                        continue;
                    };
                    let face = &surfaces.list[number];
                    let eye = local(face, towards(&to.toward, face.point(there.middle)));
                    let back = local(face, -body(surface, sheet.along[k]));
                    let [leaves, arrives] = &mut rooms;
                    leaves.fill(0.0);
                    arrives.fill(0.0);
                    let (m, n) = (sheet.channels.len(), other.channels.len());
                    sheet.material.add_weights(sun, sheet.along[k], 1.0, &mut leaves[..m]);
                    if leaves[..m].iter().all(|w| *w == 0.0) {
                        continue;
                    }
                    other.material.add_weights(back, eye, 1.0, &mut arrives[..n]);
                    let fine = scale * from.fine[p] * to.fine[q];
                    let coarse = scale * from.coarse[patch.coarse] * to.coarse[there.coarse];
                    let set = &mut pairs.sets[k / self.each as usize];
                    for (a, w) in sheet.channels.clone().zip(&*leaves) {
                        for (b, v) in other.channels.clone().zip(&*arrives) {
                            pairs.fine[a * channels + b] += fine * w * v;
                            set[a * channels + b] += coarse * w * v;
                        }
                    }
                }
            }
        }
    }
}

impl Sheet {
    /// The material's weights along the directions in use, sr⁻¹.
    fn weights(&self, end: DVec3, sends: bool, out: &mut Vec<f64>) {
        let count = self.channels.len();
        out.clear();
        out.resize(self.along.len() * count, 0.0);
        for &k in &self.used {
            let k = k as usize;
            let (i, o) = if sends { (end, self.along[k]) } else { (self.along[k], end) };
            self.material.add_weights(i, o, 1.0, &mut out[k * count..(k + 1) * count]);
        }
    }
}

/// Directions by the cosine: so many of each set.
fn directions(each: u32, seed: u32) -> Vec<DVec3> {
    let one = |k: u32| {
        let u = sobol_burley::sample_4d(k % each, 0, mixed(seed, k / each)).map(f64::from);
        spread(u[0], u[1]).to
    };
    (0..each * SCRAMBLES as u32).map(one).collect()
}

/// The direction of an end from a place.
fn towards(toward: &Toward, at: DVec3) -> DVec3 {
    match *toward {
        Toward::Far(d) => d,
        Toward::Near(q) => (q - at).normalize_or_zero(),
    }
}

fn local(surface: &Surface, d: DVec3) -> DVec3 {
    DVec3::new(d.dot(surface.tangent), d.dot(surface.bitangent), d.dot(surface.normal))
}

fn body(surface: &Surface, d: DVec3) -> DVec3 {
    d.x * surface.tangent + d.y * surface.bitangent + d.z * surface.normal
}
