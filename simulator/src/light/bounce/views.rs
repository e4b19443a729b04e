//! What one end of all paths, Sun, Earth or observer, gives to patches, or sees of them.

use super::chords::{Chords, Gain, Pairs};
use super::orders::{Found, Orders, Vectors};
use super::patches::{Patches, Room};
use super::surfaces::Surfaces;
use crate::light::occlude::Toward;
use crate::light::{Evaluator, Scene};
use glam::DVec3;

/// The surfaces that exchange light, in patches.
#[derive(Debug, Clone)]
pub struct Patched {
    pub surfaces: Surfaces,
    pub patches: Patches,
    /// What of the patches and of the larger ones is not inside of another body, m².
    pub areas: [Vec<f64>; 2],
    pub chords: Chords,
}

/// What of each patch and larger patch is open to an end, times the cosine, of what is open at all.
#[derive(Debug, Clone)]
pub struct Shares {
    pub toward: Toward,
    pub fine: Vec<f64>,
    pub coarse: Vec<f64>,
}

impl Shares {
    /// Room for those of some patches.
    pub fn new(patches: &Patches) -> Self {
        let (fine, coarse) = (patches.list.len(), patches.coarse_area.len());
        let toward = Toward::Far(DVec3::Z);
        Self { toward, fine: vec![0.0; fine], coarse: vec![0.0; coarse] }
    }
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

    /// Looks from an end.
    fn look(&mut self, patched: &Patched, toward: Toward, shares: &mut Shares) {
        let Patched { surfaces, patches, areas, .. } = patched;
        let Shares { fine, coarse, .. } = shares;
        shares.toward = toward;
        fine.fill(0.0);
        coarse.fill(0.0);
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
            match self.evaluator.open(surface.number, toward) {
                None => own().for_each(|p| fine[p] = patches.list[p].area),
                Some(open) => {
                    for (polygon, cells) in
                        open.iter().flat_map(|o| list.iter().map(move |c| (o, c)))
                    {
                        cells.share(polygon, list.len() == 1, &mut self.room, fine);
                    }
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
                let open = scale * fine[p];
                fine[p] = open / areas[0][p];
                coarse[patch.coarse] += open / areas[1][patch.coarse];
            }
        }
    }
}

/// What an end, of one direction or of many, brings to diffuse patches.
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
        let gain = Gain::new(patched.chords.channels.len(), counts);
        Self { straight: counts.map(|n| vec![0.0; n]), gain }
    }

    /// Back to nothing.
    pub fn clear(&mut self) {
        self.straight.iter_mut().for_each(|row| row.fill(0.0));
        self.gain.clear();
    }

    /// Adds what a direction brings, times `weight`; `sends` of Sun and Earth, false of an observer.
    pub fn add(&mut self, patched: &Patched, shares: &Shares, sends: bool, weight: f64) {
        for (sum, row) in self.straight.iter_mut().zip([&shares.fine, &shares.coarse]) {
            sum.iter_mut().zip(row).for_each(|(s, r)| *s += weight * r);
        }
        let Patched { surfaces, patches, areas, chords } = patched;
        chords.gather((surfaces, patches, areas), shares, (sends, weight), &mut self.gain);
    }
}

/// Both ends of all paths, with room to work in, for one thread.
#[derive(Debug)]
pub struct Views<'a> {
    viewer: Viewer<'a>,
    shares: [Shares; 2],
    ends: [End; 2],
    pairs: Pairs,
    vectors: Vectors,
}

impl<'a> Views<'a> {
    pub fn new(scene: &'a Scene, patched: &Patched) -> Self {
        let (shares, end) = (Shares::new(&patched.patches), End::new(patched));
        Self {
            viewer: Viewer::new(scene),
            shares: [shares.clone(), shares],
            ends: [end.clone(), end],
            pairs: Pairs::new(patched.chords.channels.len()),
            vectors: Vectors::default(),
        }
    }

    /// The light of some directions, each times its irradiance, at each wavelength of `orders`: but for what these leave to others.
    pub fn between(
        &mut self,
        patched: &Patched,
        orders: &Orders,
        from: &[(DVec3, f64)],
        eye: Toward,
    ) -> Vec<Found> {
        let [of_sun, of_eye] = &mut self.shares;
        let [sun, to] = &mut self.ends;
        to.clear();
        self.viewer.look(patched, eye, of_eye);
        to.add(patched, of_eye, false, 1.0);
        sun.clear();
        self.pairs.clear();
        for &(toward, weight) in from {
            self.viewer.look(patched, Toward::Far(toward), of_sun);
            sun.add(patched, of_sun, true, weight);
            let places = (&patched.surfaces, &patched.patches);
            patched.chords.pairs(places, [of_sun, of_eye], weight, &mut self.pairs);
        }
        orders.light([sun, to], &self.pairs, &mut self.vectors)
    }
}
