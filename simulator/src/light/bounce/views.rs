//! Light that one end of all paths, Sun, Earth or observer, gives to patches or sees of them.

use super::chords::{Chords, Gain, Pairs, Weights};
use super::clear::{Clear, Twice};
use super::orders::{Found, Orders, Vectors};
use super::patches::{Patches, Room};
use super::surfaces::Surfaces;
use crate::light::clip::P2;
use crate::light::occlude::Toward;
use crate::light::{Evaluator, Scene};
use glam::DVec3;
use std::sync::Arc;

/// Least open share of a patch that counts as all of it.
const WHOLE: f64 = 1.0 - 1e-9;

/// The surfaces that exchange light, in patches.
#[derive(Debug, Clone)]
pub struct Patched {
    pub surfaces: Surfaces,
    pub patches: Patches,
    /// Areas of the patches and of the larger ones outside of other bodies, m².
    pub areas: [Vec<f64>; 2],
    pub chords: Chords,
    pub clear: Arc<Clear>,
}

/// Share of each patch and larger patch that is open to an end, times the cosine, of what is open at all.
#[derive(Debug, Clone)]
pub struct Shares {
    pub toward: Toward,
    pub fine: Vec<f64>,
    pub coarse: Vec<f64>,
    /// The cosine at each patch (towards a near end with its scale).
    cosine: Vec<f64>,
    /// Whether only a part of a patch is open.
    partly: Vec<bool>,
    /// The cosine at each surface that is open to an end (0: closed; towards a near end with its scale), and whether all of it is.
    pub facing: Vec<f64>,
    pub whole: Vec<bool>,
    /// Open part of each surface that is partly hidden, in its axes.
    pub open: Vec<Vec<Vec<P2>>>,
    /// Light that rough surfaces send along their directions.
    pub weights: Weights,
}

impl Shares {
    /// Room for those of some patches.
    fn new(patched: &Patched) -> Self {
        let patches = &patched.patches;
        let (fine, coarse) = (patches.list.len(), patches.coarse_area.len());
        Self {
            toward: Toward::Far(DVec3::Z),
            fine: vec![0.0; fine],
            coarse: vec![0.0; coarse],
            cosine: vec![0.0; fine],
            partly: vec![false; fine],
            facing: vec![0.0; patched.surfaces.list.len()],
            whole: vec![false; patched.surfaces.list.len()],
            open: vec![Vec::new(); patched.surfaces.list.len()],
            weights: Weights::default(),
        }
    }

    /// The cosine at a point of a patch (the axes of its surface), 0 where the point is closed.
    pub fn at(&self, patch: usize, surface: usize, [x, y]: [f32; 2]) -> f64 {
        if self.fine[patch] == 0.0 {
            return 0.0;
        }
        let p = [f64::from(x), f64::from(y)];
        let open = || self.open[surface].iter().any(|ring| holds(ring, p));
        if !self.partly[patch] || open() { self.cosine[patch] } else { 0.0 }
    }
}

/// Whether a point lies in a convex ring.
fn holds(ring: &[P2], p: P2) -> bool {
    let Some(&last) = ring.last() else { return false };
    let mut a = last;
    ring.iter().all(|&b| {
        let left = (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) >= 0.0;
        a = b;
        left
    })
}

/// Finds shares, with room to work in.
#[derive(Debug)]
struct Viewer<'a> {
    evaluator: Evaluator<'a>,
    room: Room,
}

impl<'a> Viewer<'a> {
    fn new(scene: &'a Scene) -> Self {
        Self { evaluator: scene.evaluator(), room: Room::default() }
    }

    /// Looks from an end; `sends` of Sun and Earth, false of an observer.
    fn look(&mut self, patched: &Patched, toward: Toward, sends: bool, shares: &mut Shares) {
        let Patched { surfaces, patches, areas, .. } = patched;
        shares.toward = toward;
        let Shares { fine, coarse, cosine, partly, facing, whole, open: rings, weights, .. } =
            shares;
        fine.fill(0.0);
        coarse.fill(0.0);
        facing.fill(0.0);
        self.evaluator.prepare(toward);
        for list in patches.of_surfaces() {
            let surface = &surfaces.list[list[0].surface];
            let own = || list.iter().flat_map(|cells| cells.patches());
            // In front of the plane, from wherever it is looked at.
            let height = match toward {
                Toward::Far(d) => d.dot(surface.normal),
                Toward::Near(q) => (q - surface.origin).dot(surface.normal),
            };
            if height <= 0.0 {
                continue;
            }
            let rings = &mut rings[list[0].surface];
            facing[list[0].surface] = match toward {
                Toward::Far(_) => height,
                Toward::Near(q) => {
                    let away = (q - surface.origin).length();
                    height / away * (q.length() / away).powi(2)
                }
            };
            whole[list[0].surface] = false;
            match self.evaluator.open(surface.number, toward) {
                None => {
                    whole[list[0].surface] = true;
                    own().for_each(|p| {
                        fine[p] = patches.list[p].area;
                        partly[p] = false;
                    });
                }
                Some(open) => {
                    rings.clear();
                    rings.extend(open.iter().map(<[P2]>::to_vec));
                    for (polygon, cells) in
                        open.iter().flat_map(|o| list.iter().map(move |c| (o, c)))
                    {
                        cells.share(polygon, list.len() == 1, &mut self.room, fine);
                    }
                    own().for_each(|p| partly[p] = fine[p] < WHOLE * patches.list[p].area);
                }
            }
            for p in own() {
                if fine[p] == 0.0 {
                    continue;
                }
                let patch = &patches.list[p];
                let scale = match toward {
                    Toward::Far(_) => height,
                    Toward::Near(q) => {
                        let away = q - surface.point(patch.middle);
                        let range2 = away.length_squared();
                        let cos = away.dot(surface.normal) / range2.sqrt();
                        cos * q.length_squared() / range2
                    }
                };
                cosine[p] = scale;
                let open = scale * fine[p];
                fine[p] = open / areas[0][p];
                coarse[patch.coarse] += open / areas[1][patch.coarse];
            }
        }
        patched.chords.ask(patched, (toward, sends), fine, weights);
    }
}

/// Light that an end, of one direction or of many, brings to diffuse patches.
#[derive(Debug, Clone)]
pub struct End {
    /// Straight, of the patches and of the larger ones.
    pub straight: [Vec<f64>; 2],
    /// By one rough surface.
    pub gain: Gain,
}

impl End {
    pub fn new(patched: &Patched) -> Self {
        let counts = patched.patches.diffuse;
        let gain = Gain::new(patched.chords.rough, counts);
        Self { straight: counts.map(|n| vec![0.0; n]), gain }
    }

    /// Back to nothing.
    pub fn clear(&mut self) {
        self.straight.iter_mut().for_each(|row| row.fill(0.0));
        self.gain.clear();
    }

    /// Adds what a direction brings, times `weight`.
    fn add(&mut self, patched: &Patched, shares: &Shares, weight: f64) {
        for (sum, row) in self.straight.iter_mut().zip([&shares.fine, &shares.coarse]) {
            sum.iter_mut().zip(row).for_each(|(s, r)| *s += weight * r);
        }
        patched.chords.gather(patched, shares, weight, &mut self.gain);
    }
}

/// Both ends of all paths, with room to work in, for one thread.
#[derive(Debug)]
pub struct Views<'a> {
    viewer: Viewer<'a>,
    shares: [Shares; 2],
    ends: [End; 2],
    pairs: Pairs,
    twice: Twice,
    vectors: Vectors,
}

impl<'a> Views<'a> {
    pub fn new(scene: &'a Scene, patched: &Patched) -> Self {
        let (shares, end) = (Shares::new(patched), End::new(patched));
        Self {
            viewer: Viewer::new(scene),
            shares: [shares.clone(), shares],
            ends: [end.clone(), end],
            pairs: Pairs::new(&patched.chords),
            twice: Twice::default(),
            vectors: Vectors::default(),
        }
    }

    /// Looks from the observer.
    pub fn see(&mut self, patched: &Patched, eye: Toward) {
        let ([_, of_eye], [_, to]) = (&mut self.shares, &mut self.ends);
        to.clear();
        self.viewer.look(patched, eye, false, of_eye);
        to.add(patched, of_eye, 1.0);
    }

    /// The light of some directions, each times its irradiance, at each wavelength of `orders`, for the observer that it was looked from last: but for what
    /// these leave to others.
    pub fn between(
        &mut self,
        patched: &Patched,
        orders: &Orders,
        from: &[(DVec3, f64)],
    ) -> Vec<Found> {
        let [of_sun, of_eye] = &mut self.shares;
        let [sun, to] = &mut self.ends;
        let eye = of_eye.toward;
        sun.clear();
        self.pairs.clear();
        self.twice.clear(&patched.clear, eye);
        for &(toward, weight) in from {
            self.viewer.look(patched, Toward::Far(toward), true, of_sun);
            sun.add(patched, of_sun, weight);
            patched.chords.pairs(patched, [of_sun, of_eye], weight, &mut self.pairs);
            let ends = [&*of_sun, &*of_eye];
            patched.clear.add(&patched.surfaces, ends, weight, &mut self.twice);
        }
        orders.light([sun, to], &self.pairs, &self.twice, &mut self.vectors)
    }
}
