//! Light paths with their lengths, for whoever needs to know when light arrives.

use super::BounceOptions;
use super::bound::Bound;
use super::cast::Caster;
use super::optics::Optics;
use super::paths::{MOST_POINTS, Paths, SCRAMBLES, Sums, mixed};
use super::surfaces::Surfaces;
use crate::light::Scene;
use crate::light::occlude::Toward;
use glam::DVec3;

/// Contribution of one path of two scatterings or more.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Echo {
    /// Which of the scrambles that do not know of each other it belongs to.
    pub scramble: usize,
    /// Where the light met the body first, and where it left for the observer; body axes, m.
    pub first_m: DVec3,
    pub last_m: DVec3,
    /// The way between them, m.
    pub between_m: f64,
    /// Light of the path at the first node, m² sr⁻¹: the sum over a scramble's paths is their number times the scramble's light.
    pub light: f64,
}

impl Echo {
    /// Creates the echo of a path that began at the light, or at the observer.
    pub(super) fn new(
        from_light: bool,
        [start, end]: [DVec3; 2],
        between_m: f64,
        light: f64,
    ) -> Self {
        let (first_m, last_m) = if from_light { (start, end) } else { (end, start) };
        Self { scramble: 0, first_m, last_m, between_m, light }
    }
}

/// Callback that takes the echoes of a round: see [`Echoes::trace`].
type Take<'a> = dyn FnMut(&[Echo], u32, f64) -> Option<u32> + 'a;

/// The paths of a scene at one wavelength, for one thread.
#[derive(Debug, Clone)]
pub(crate) struct Echoes<'a> {
    scene: &'a Scene,
    surfaces: Surfaces,
    caster: Caster,
    optics: Optics,
    bound: Bound,
    both_ends: bool,
    seed: u32,
}

impl<'a> Echoes<'a> {
    /// Scrambles, each with an estimate of its own.
    pub(crate) const SCRAMBLES: usize = SCRAMBLES as usize;

    pub(crate) fn new(scene: &'a Scene, wavelength_nm: f64, options: &BounceOptions) -> Self {
        let surfaces = Surfaces::new(scene);
        let caster = Caster::new(&surfaces.list, scene.touching_m);
        let optics = Optics::new(scene.materials(), &[wavelength_nm]);
        let bound = Bound::new(scene, &surfaces.list);
        let lambert = |k: &usize| optics.lambert(surfaces.list[*k].material).is_some();
        let both_ends = !bound.active.iter().all(lambert);
        let seed = mixed(options.seed, 0xec);
        Self { scene, surfaces, caster, optics, bound, both_ends, seed }
    }

    /// The most that all orders can add, of what is scattered once; `None` where no bound is known.
    pub(crate) fn bound(&self) -> Option<f64> {
        if self.bound.active.is_empty() { Some(0.0) } else { self.bound.share() }
    }

    /// Paths of each scramble at most.
    pub(crate) fn most_points(options: &BounceOptions) -> u32 {
        (options.most_paths / SCRAMBLES).clamp(1, MOST_POINTS)
    }

    /// Traces paths between a distant light and a distant observer (unit vectors, body axes), hinged parts turned to `sun`, in rounds: `take` gets the echoes
    /// of a round, how many points each scramble has had by then, and what may be missing where few paths found anything (m² sr⁻¹), and says of
    /// how many there are to be until the next.
    pub(crate) fn trace(&mut self, [light, to, sun]: [DVec3; 3], take: &mut Take<'_>) {
        if self.surfaces.turn(self.scene, sun) {
            self.caster = Caster::new(&self.surfaces.list, self.scene.touching_m);
        }
        let mut sums = Sums::new(1);
        let mut paths = Paths {
            surfaces: &self.surfaces,
            caster: &self.caster,
            optics: &mut self.optics,
            active: &self.bound.active,
            both_ends: self.both_ends,
            rest_of: None,
            polariser: None,
            seed: self.seed,
        };
        let mut until = 0;
        let mut wanted = take(&[], 0, 0.0);
        while let Some(more) = wanted.filter(|w| *w > until) {
            until = more;
            sums.echoes = Some(Vec::new());
            paths.trace(light, Toward::Far(to), until, &mut sums);
            wanted = take(sums.echoes.as_deref().unwrap_or_default(), until, sums.missing());
        }
    }
}
