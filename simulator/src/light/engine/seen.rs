//! Visible areas of an epoch before any light is computed: how much of each material could be seen at all, by what.

use super::body::Body;
use super::change::Change;
use super::globes;
use crate::light::scene::Scene;
use crate::light::{Lighting, View};
use crate::surface::Distribution;

/// Visible areas that the doubts of an epoch are made of. Areas are upper bounds: occluders are ignored.
#[derive(Debug, Clone, Default)]
pub struct Seen {
    /// For each material the area that the observer could see, projected, m².
    pub area_m2: Vec<f64>,
    /// The part of it that is of no sphere, m².
    pub open_m2: Vec<f64>,
    /// For each material the squares of the radii of its spheres, m².
    pub spheres_m2: Vec<f64>,
    /// The part of it that could also see the Earth, m².
    pub earthlit_m2: Vec<f64>,
    /// The part of it on whose horizon the Sun's disc may stand, m²: of facets that look nearly the same way. Those of facets that look the same way are in [`Seen::change`].
    pub horizon_m2: Vec<f64>,
    /// For each material how far off its lobes are on the average, weighted by what they send: ⟨t²⟩ and ⟨t⟩ with t = tanθ_h/α.
    pub off_lobe: Vec<(f64, f64)>,
    /// The material of each term that has light, where it is of one.
    pub materials: Vec<Option<usize>>,
    /// Irradiance by the Earth on a surface that sees all of it, of that of the Sun.
    pub earth: f64,
    /// Angular radius of the Sun, radians.
    pub sun_radius_rad: f64,
    /// cos(γ/2) of the phase angle γ: the direction midway between Sun and observer moves by up to 1/(2 cos γ/2) of what either moves.
    pub half_cos: f64,
    /// Change by the disc of flat facets; empty where nobody asks.
    pub change: Change,
    asks_change: bool,
    lobes: Vec<f64>,
    /// The largest albedo of the Earth.
    albedo: f64,
}

impl Seen {
    /// Nothing yet, for terms of these materials and an Earth whose albedo is nowhere above `albedo`. `asks_change` says whether what the disc changes is asked for.
    pub(super) fn of(materials: Vec<Option<usize>>, albedo: f64, asks_change: bool) -> Self {
        Self { materials, albedo, asks_change, ..Self::default() }
    }

    /// Looks at an epoch.
    pub(super) fn look(&mut self, (scene, body): (&Scene, &Body), lighting: &Lighting) {
        let sun = lighting.sun_body.normalize_or_zero();
        let to = match lighting.view {
            View::Distant(d) | View::At(d) => d.normalize_or_zero(),
        };
        let count = body.glosses.len();
        for row in [
            &mut self.area_m2,
            &mut self.open_m2,
            &mut self.spheres_m2,
            &mut self.earthlit_m2,
            &mut self.horizon_m2,
            &mut self.lobes,
        ] {
            row.clear();
            row.resize(count, 0.0);
        }
        self.off_lobe.clear();
        self.off_lobe.resize(count, (0.0, 0.0));
        self.sun_radius_rad = lighting.sun_radius_rad;
        let irradiance = |earth| globes::irradiance(&earth, self.albedo);
        self.earth = lighting.earth.map_or(self.albedo, irradiance);
        let (toward, earth_sine) = match lighting.earth {
            Some(globe) => (globe.toward, globe.radius_m / globe.distance_m),
            None => (to, 1.0),
        };
        self.half_cos = 0.5 * (sun + to).length();
        let halfway = (sun + to).normalize_or_zero();
        for patch in &body.patches {
            let normal = body.normal(patch, sun);
            let cos = normal.dot(to) + patch.chord;
            if cos <= 0.0 {
                continue;
            }
            let (m, area) = (patch.material, patch.area_m2 * cos.min(1.0));
            self.area_m2[m] += area;
            if normal.dot(toward) + patch.chord > -earth_sine {
                self.earthlit_m2[m] += area;
            }
            let height = normal.dot(sun);
            if patch.chord > 0.0 && height.abs() < lighting.sun_radius_rad + patch.chord {
                self.horizon_m2[m] += area;
            }
            if let (Some((kind, alpha)), true) = (body.glosses[m].lobe, height + patch.chord > 0.0)
            {
                self.lobe(m, kind, alpha, normal.dot(halfway) + patch.chord, area);
            }
        }
        self.open_m2.copy_from_slice(&self.area_m2);
        for (radius_m, m, is_sphere) in &body.rounds {
            let area = std::f64::consts::PI * radius_m * radius_m;
            self.area_m2[*m] += area;
            let row = if *is_sphere { &mut self.spheres_m2 } else { &mut self.open_m2 };
            row[*m] += if *is_sphere { radius_m * radius_m } else { area };
            self.earthlit_m2[*m] += area;
        }
        if self.asks_change {
            self.change.look((scene, body), sun, to, lighting.sun_radius_rad);
        }
        for ((t2, t), sum) in self.off_lobe.iter_mut().zip(&self.lobes) {
            if *sum > 0.0 {
                (*t2, *t) = (*t2 / sum, *t / sum);
            }
        }
    }

    /// Adds one patch to how far off the lobes are.
    fn lobe(&mut self, material: usize, kind: Distribution, alpha: f64, cos: f64, area: f64) {
        if alpha == 0.0 || cos <= 0.0 {
            return;
        }
        let cos = cos.min(1.0);
        let t2 = (1.0 / (cos * cos) - 1.0) / (alpha * alpha);
        let sent = area
            * match kind {
                Distribution::Beckmann => (-t2).exp(),
                Distribution::Ggx => 1.0 / ((1.0 + t2) * (1.0 + t2)),
            };
        self.off_lobe[material].0 += sent * t2;
        self.off_lobe[material].1 += sent * t2.sqrt();
        self.lobes[material] += sent;
    }

    /// Adds to the errors of each term a share of its weight: what `of` says of its material.
    pub fn add_shares(&self, weights: &[f64], errors: &mut [f64], of: impl Fn(usize) -> f64) {
        for ((weight, error), material) in weights.iter().zip(errors).zip(&self.materials) {
            if let Some(material) = material {
                *error += of(*material) * weight.abs();
            }
        }
    }
}
