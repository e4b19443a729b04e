//! Working set of a thread that follows paths through a scene.

use super::cast::Caster;
use super::optics::Optics;
use super::paths::Paths;
use super::stokes::Polariser;
use super::surfaces::Surfaces;
use super::tracing::Direct;
use crate::light::Scene;
use crate::light::occlude::Toward;
use glam::DVec3;

/// Surfaces as they stand, an index of them, what they reflect, and the light that is scattered once.
#[derive(Debug)]
pub(super) struct Thread<'a> {
    scene: &'a Scene,
    surfaces: Surfaces,
    caster: Caster,
    optics: Optics,
    direct: Direct<'a>,
    /// Whether some surface that sees another is not Lambertian: its paths are followed from both ends.
    both_ends: bool,
    /// Flags of the surfaces that are not Lambertian, one for each surface.
    rough: Vec<bool>,
    polariser: Option<Polariser>,
}

impl<'a> Thread<'a> {
    /// Creates the working set for a scene and wavelengths; `active` are the surfaces that see another.
    pub fn new(scene: &'a Scene, surfaces: &Surfaces, active: &[usize], nm: &[f64]) -> Self {
        let surfaces = surfaces.clone();
        let caster = Caster::new(&surfaces.list, scene.touching_m);
        let optics = Optics::new(scene.materials(), nm);
        let rough: Vec<bool> =
            surfaces.list.iter().map(|s| optics.lambert(s.material).is_none()).collect();
        let both_ends = active.iter().any(|k| rough[*k]);
        let (direct, polariser) = (Direct::new(scene, nm), None);
        Self { scene, surfaces, caster, optics, direct, both_ends, rough, polariser }
    }

    /// The same for what passes a polariser at an angle, radians.
    pub fn behind(self, nm: &[f64], angle_rad: f64) -> Self {
        let polariser = Some(Polariser::new(self.scene.materials(), nm, angle_rad));
        Self { polariser, ..self }
    }

    /// Turns what follows the Sun.
    pub fn turn(&mut self, sun: DVec3) {
        if self.surfaces.turn(self.scene, sun) {
            self.caster = Caster::new(&self.surfaces.list, self.scene.touching_m);
        }
    }

    /// The light that is scattered once, at each wavelength, m² sr⁻¹; `None` where it is not known.
    pub fn direct(&mut self, sun: DVec3, eye: Toward) -> Option<Vec<f64>> {
        self.direct.at(sun, eye).map(<[f64]>::to_vec)
    }

    /// Paths that begin on the active surfaces; with `rest` those of [`Paths::rest_of`].
    pub fn paths<'t>(&'t mut self, active: &'t [usize], rest: bool, seed: u32) -> Paths<'t> {
        let Self { surfaces, caster, optics, both_ends, rough, polariser, .. } = self;
        let (rest_of, both_ends) = (rest.then_some(rough.as_slice()), *both_ends);
        let polariser = polariser.as_ref();
        Paths { surfaces, caster, optics, active, both_ends, rest_of, polariser, seed }
    }
}
