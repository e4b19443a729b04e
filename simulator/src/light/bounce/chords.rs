//! Light that a rough surface sends to others, or gets from them, at one end of a path.
//!
//! A lobe sends the light of the Sun into some directions more than into others, so no reflectance says what another surface gets of it. What the
//! body alone decides is done once: for each rough surface a set of directions, spread by the cosine, and for each of its patches what is met along
//! each of them from a point of it. For an end (Sun, Earth, observer) the material is then asked once for each direction, and what each patch sends along is
//! added up where it arrives. Light that is scattered twice in all is known at both points, so that what is lit and seen of a patch counts where it
//! is. Eight sets that do not know of each other give the error.

use super::cast::Ray;
use super::optics::{Optics, spread};
use super::paths::mixed;
use super::surfaces::Surface;
use super::transport::{Between, SCRAMBLES};
use super::views::{Patched, Shares};
use crate::light::occlude::Toward;
use crate::surface::{Masked, Material};
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::{FRAC_1_PI, PI};
use std::ops::Range;

/// Blocks of directions of a surface at most.
const BLOCKS: u32 = 16;

/// The directions of all rough surfaces.
#[derive(Debug, Clone, Default)]
pub struct Chords {
    /// Directions of a patch and set.
    pub each: u32,
    /// One for each material and spectrum: of rough surfaces, then of diffuse ones.
    pub channels: Vec<(usize, usize)>,
    /// How many of them are of rough surfaces.
    pub rough: usize,
    /// The channel of each diffuse patch.
    diffuse: Vec<u32>,
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
    /// Blocks of directions (of all sets) along which any of their patches meets anything: each patch has one block, so that neighbours err by chance in different ways.
    blocks: Vec<Vec<Direction>>,
}

/// Direction in a surface's axes, as the material is asked for it.
#[derive(Debug, Clone, Copy)]
struct Direction {
    along: DVec3,
    masked: Masked,
}

/// The materials' weights of all rough surfaces along their directions, sr⁻¹: for each surface some rows, one a block (of a near end, one a patch).
#[derive(Debug, Clone, Default)]
pub struct Weights {
    rows: Vec<Vec<Vec<f64>>>,
    near: bool,
}

/// Patch that another patch meets along a direction.
#[derive(Debug, Clone, Copy)]
struct Meeting {
    /// The direction's place in its block.
    direction: u32,
    patch: u32,
    /// Where it leaves the one and arrives at the other, in the surfaces' axes.
    leaves: [f32; 2],
    arrives: [f32; 2],
    /// The set of the direction.
    set: u8,
}

/// Gain of an end at diffuse patches by one rough surface: irradiance E, or the share that is seen.
#[derive(Debug, Clone, Default)]
pub struct Gain {
    /// For each channel and patch.
    pub fine: Vec<Vec<f64>>,
    /// For each set, channel and larger patch.
    pub sets: Vec<Vec<Vec<f64>>>,
}

/// Light that two surfaces scatter one after the other, one of them or both rough, m² sr⁻¹: for each set, each channel of the first and of the second.
#[derive(Debug, Clone, Default)]
pub struct Pairs {
    pub sets: Vec<Vec<f64>>,
    room: Vec<f64>,
}

impl Gain {
    /// Creates an empty gain for so many channels, diffuse patches and larger ones.
    pub fn new(channels: usize, [fine, coarse]: [usize; 2]) -> Self {
        Self {
            fine: vec![vec![0.0; fine]; channels],
            sets: vec![vec![vec![0.0; coarse]; channels]; SCRAMBLES],
        }
    }

    /// Back to nothing.
    pub fn clear(&mut self) {
        self.fine.iter_mut().chain(self.sets.iter_mut().flatten()).for_each(|row| row.fill(0.0));
    }
}

impl Pairs {
    /// Nothing yet.
    pub fn new(chords: &Chords) -> Self {
        let none = vec![0.0; chords.channels.len() * chords.channels.len()];
        Self { sets: vec![none; SCRAMBLES], room: Vec::new() }
    }

    /// Back to nothing.
    pub fn clear(&mut self) {
        self.sets.iter_mut().for_each(|set| set.fill(0.0));
    }
}

impl Chords {
    /// Traces the directions of the rough patches, which come after the diffuse ones.
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
            let blocks = BLOCKS.min((end - first) as u32);
            let material = optics.material(surface.material).clone();
            let along = directions(each, blocks, mixed(seed, number as u32));
            let sheet = Sheet {
                surface: number,
                channels: chords.channels_of(optics, surface.material),
                patches: first..end,
                material,
                blocks: vec![Vec::new(); along.len()],
            };
            chords.add(sheet, &along, between, seed);
            first = end;
        }
        chords.rough = chords.channels.len();
        if chords.rough > 0 {
            for p in 0..patches.diffuse[0] {
                let material = surfaces.list[surface_of(p)].material;
                let channel = chords.channels_of(optics, material).start as u32;
                chords.diffuse.push(channel);
            }
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

    fn add(&mut self, mut sheet: Sheet, along: &[Vec<DVec3>], between: &Between, seed: u32) {
        let Between { surfaces, caster, patches, of_surface } = *between;
        let surface = &surfaces.list[sheet.surface];
        let each = self.each;
        let looked = |p: usize| {
            let (mut meets, mut buried) = ([Vec::new(), Vec::new()], 0);
            for (k, along) in along[sheet.block(p)].iter().enumerate() {
                let (set, index) = (k as u32 / each, k as u32 % each);
                let seed = mixed(mixed(seed, 0xc0 + p as u32), set);
                let u = sobol_burley::sample_4d(index, 1, seed).map(f64::from);
                let leaves = patches.list[p].even(u[0], u[1]);
                let from = surface.point(leaves);
                let along = body(surface, *along);
                let ray = Ray { from, along, leaves: sheet.surface };
                let Ok(hit) = caster.first_outside(&ray, |k| !surfaces.list[k].sheet) else {
                    buried += 1;
                    continue;
                };
                let met = hit.and_then(|hit| patches.met_by(surfaces, of_surface, &ray, hit));
                let Some((q, number, at)) = met else { continue };
                let rough = usize::from(q >= patches.diffuse[0]);
                let other = &surfaces.list[number];
                let at = local(other, at - other.origin);
                meets[rough].push(Meeting {
                    direction: k as u32,
                    patch: q as u32,
                    leaves: leaves.map(|x| x as f32),
                    arrives: [at.x as f32, at.y as f32],
                    set: set as u8,
                });
            }
            (meets, buried)
        };
        let of_patches: Vec<_> = sheet.patches.clone().into_par_iter().map(looked).collect();
        let mut places: Vec<Vec<Option<u32>>> = along.iter().map(|a| vec![None; a.len()]).collect();
        for (p, (meets, _)) in sheet.patches.clone().zip(&of_patches) {
            let places = &mut places[sheet.block(p)];
            meets.iter().flatten().for_each(|m| places[m.direction as usize] = Some(0));
        }
        for ((places, along), block) in places.iter_mut().zip(along).zip(&mut sheet.blocks) {
            for (place, along) in places.iter_mut().zip(along).filter(|(place, _)| place.is_some())
            {
                *place = Some(block.len() as u32);
                block.push(Direction { along: *along, masked: sheet.material.masked(*along) });
            }
        }
        for (p, (mut meets, buried)) in sheet.patches.clone().zip(of_patches) {
            let places = &places[sheet.block(p)];
            for meeting in meets.iter_mut().flatten() {
                meeting.direction = places[meeting.direction as usize].unwrap_or(0);
            }
            self.meets.push(meets);
            self.buried.push(buried);
        }
        self.sheets.push(sheet);
    }

    /// Whether any rough surface sees another.
    pub fn see_each_other(&self) -> bool {
        self.meets.iter().any(|m| !m[1].is_empty())
    }

    /// How often materials are asked for a distant end.
    pub fn asked(&self) -> usize {
        self.sheets.iter().flat_map(|s| &s.blocks).map(Vec::len).sum()
    }

    /// How many directions meet anything.
    pub fn meetings(&self) -> usize {
        self.meets.iter().flatten().map(Vec::len).sum()
    }

    /// Returns the part of each rough patch that is inside of another body.
    pub fn buried(&self) -> impl Iterator<Item = f64> + '_ {
        let rays = f64::from(self.each) * SCRAMBLES as f64;
        self.buried.iter().map(move |b| f64::from(*b) / rays)
    }

    /// Returns the light that a patch of this area sends along each of its directions under E = 1 before a weight of 1 sr⁻¹, m².
    fn each_m2(&self, area: f64) -> f64 {
        PI * area / (f64::from(self.each) * SCRAMBLES as f64)
    }

    /// Asks the materials for an end, of which a share of each patch in `open` is open: where none is, nothing is asked. `sends` of the Sun and the Earth, false of an
    /// observer.
    pub fn ask(
        &self,
        patched: &Patched,
        (toward, sends): (Toward, bool),
        open: &[f64],
        weights: &mut Weights,
    ) {
        weights.near = matches!(toward, Toward::Near(_));
        weights.rows.resize(self.sheets.len(), Vec::new());
        for (sheet, rows) in self.sheets.iter().zip(&mut weights.rows) {
            let surface = &patched.surfaces.list[sheet.surface];
            let seen = || sheet.patches.clone().filter(|p| open[*p] > 0.0);
            rows.resize(rows.len().max(sheet.patches.len()), Vec::new());
            if weights.near {
                for p in seen() {
                    let end = towards(&toward, surface.point(patched.patches.list[p].middle));
                    let row = &mut rows[p - sheet.patches.start];
                    sheet.weights(sheet.block(p), local(surface, end), sends, row);
                }
                continue;
            }
            let end = local(surface, towards(&toward, surface.origin));
            for (block, row) in rows.iter_mut().enumerate().take(sheet.blocks.len()) {
                if seen().any(|p| sheet.block(p) == block) {
                    sheet.weights(block, end, sends, row);
                }
            }
        }
    }

    /// Adds what an end brings to diffuse patches by one rough surface, times `weight`.
    pub fn gather(&self, patched: &Patched, shares: &Shares, weight: f64, gain: &mut Gain) {
        let Patched { patches, areas, .. } = patched;
        for (number, sheet) in self.sheets.iter().enumerate() {
            let count = sheet.channels.len();
            for p in sheet.patches.clone().filter(|p| shares.fine[*p] > 0.0) {
                let weights = shares.weights.row(number, sheet, p);
                let scale = weight * self.each_m2(patches.list[p].area);
                for meeting in &self.meets[p - patches.diffuse[0]][0] {
                    let (q, k) = (meeting.patch as usize, meeting.direction as usize);
                    let weights = &weights[k * count..(k + 1) * count];
                    // Most directions have nothing of a lobe.
                    if weights.iter().all(|w| *w == 0.0) {
                        continue;
                    }
                    let lit = scale * shares.at(p, sheet.surface, meeting.leaves);
                    if lit == 0.0 {
                        continue;
                    }
                    let (set, large) = (meeting.set as usize, patches.list[q].coarse);
                    let (fine, coarse) = (lit / areas[0][q], lit / areas[1][large]);
                    for (c, w) in sheet.channels.clone().zip(weights) {
                        gain.fine[c][q] += fine * w;
                        gain.sets[set][c][large] += coarse * w;
                    }
                }
            }
        }
    }

    /// Adds the light that two surfaces scatter one after the other, one of them or both rough, times `weight`, `from` where it comes from `to` the
    /// observer.
    pub fn pairs(
        &self,
        patched: &Patched,
        [from, to]: [&Shares; 2],
        weight: f64,
        pairs: &mut Pairs,
    ) {
        let patches = &patched.patches;
        let (first, channels) = (patches.diffuse[0], self.channels.len());
        let surface_of = |q: usize| patches.cells[patches.list[q].cells].surface;
        for (number, sheet) in self.sheets.iter().enumerate() {
            let count = sheet.channels.len();
            for (near, far) in [(from, to), (to, from)] {
                for p in sheet.patches.clone().filter(|p| near.fine[*p] > 0.0) {
                    let weights = near.weights.row(number, sheet, p);
                    let scale = FRAC_1_PI * weight * self.each_m2(patches.list[p].area);
                    for meeting in &self.meets[p - first][0] {
                        let (q, k) = (meeting.patch as usize, meeting.direction as usize);
                        let weights = &weights[k * count..(k + 1) * count];
                        if far.fine[q] == 0.0 || weights.iter().all(|w| *w == 0.0) {
                            continue;
                        }
                        let there = far.at(q, surface_of(q), meeting.arrives);
                        if there == 0.0 {
                            continue;
                        }
                        let here = near.at(p, sheet.surface, meeting.leaves);
                        let last = self.diffuse[q] as usize;
                        let set = &mut pairs.sets[meeting.set as usize];
                        for (c, w) in sheet.channels.clone().zip(weights) {
                            set[c * channels + last] += scale * here * there * w;
                        }
                    }
                }
            }
            for p in sheet.patches.clone().filter(|p| from.fine[*p] > 0.0) {
                let weights = from.weights.row(number, sheet, p);
                let scale = weight * self.each_m2(patches.list[p].area);
                for meeting in &self.meets[p - first][1] {
                    let k = meeting.direction as usize;
                    let weights = &weights[k * count..(k + 1) * count];
                    let q = meeting.patch as usize;
                    if to.fine[q] == 0.0 || weights.iter().all(|w| *w == 0.0) {
                        continue;
                    }
                    let here = scale * from.at(p, sheet.surface, meeting.leaves);
                    if here > 0.0 {
                        let along = body(
                            &patched.surfaces.list[sheet.surface],
                            sheet.blocks[sheet.block(p)][k].along,
                        );
                        self.pair(patched, (meeting, along, here), (sheet, weights), to, pairs);
                    }
                }
            }
        }
    }

    /// One meeting of two rough surfaces.
    fn pair(
        &self,
        patched: &Patched,
        (meeting, along, here): (&Meeting, DVec3, f64),
        (sheet, sent): (&Sheet, &[f64]),
        to: &Shares,
        pairs: &mut Pairs,
    ) {
        let Patched { surfaces, patches, .. } = patched;
        let q = meeting.patch as usize;
        let number = patches.cells[patches.list[q].cells].surface;
        let there = to.at(q, number, meeting.arrives);
        let last = self.sheets.iter().find(|s| s.surface == number);
        let Some(last) = last.filter(|_| there > 0.0) else { return };
        let face = &surfaces.list[number];
        let eye = local(face, towards(&to.toward, face.point(patches.list[q].middle)));
        pairs.room.clear();
        pairs.room.resize(last.channels.len(), 0.0);
        let room = &mut pairs.room;
        last.material.add_weights(local(face, -along), eye, here * there, room);
        let set = &mut pairs.sets[meeting.set as usize];
        for (a, w) in sheet.channels.clone().zip(sent) {
            for (b, v) in last.channels.clone().zip(&*room) {
                set[a * self.channels.len() + b] += w * v;
            }
        }
    }
}

impl Weights {
    /// Those of a patch: for each of its directions and each of its surface's channels.
    fn row(&self, number: usize, sheet: &Sheet, patch: usize) -> &[f64] {
        let row = if self.near { patch - sheet.patches.start } else { sheet.block(patch) };
        &self.rows[number][row]
    }
}

impl Sheet {
    /// The block of directions of a patch.
    fn block(&self, patch: usize) -> usize {
        patch % self.blocks.len()
    }

    /// The material's weights along the directions of a block, sr⁻¹.
    fn weights(&self, block: usize, end: DVec3, sends: bool, out: &mut Vec<f64>) {
        let (block, count) = (&self.blocks[block], self.channels.len());
        out.clear();
        out.resize(block.len() * count, 0.0);
        if end.z <= 0.0 {
            return;
        }
        let end = (end, self.material.masked(end));
        for (direction, row) in block.iter().zip(out.chunks_exact_mut(count.max(1))) {
            let along = (direction.along, direction.masked);
            let (i, o) = if sends { (end, along) } else { (along, end) };
            self.material.add_weights_between(i, o, 1.0, row);
        }
    }
}

/// Blocks of directions by the cosine, so many of each set. Blocks of a power of two are as even as all of them (Sobol' points).
fn directions(each: u32, blocks: u32, seed: u32) -> Vec<Vec<DVec3>> {
    let one = |block: u32, k: u32| {
        let (set, index) = (k / each, block * each + k % each);
        let u = sobol_burley::sample_4d(index, 0, mixed(seed, set)).map(f64::from);
        spread(u[0], u[1]).to
    };
    let block = |block| (0..each * SCRAMBLES as u32).map(|k| one(block, k)).collect();
    (0..blocks).map(block).collect()
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
