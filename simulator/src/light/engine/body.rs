//! Facts of a target that decide what it needs: surfaces by the way they look, lobes, reflectances.

use crate::light::scene::Scene;
use crate::light::{SceneError, Source, Term};
use crate::surface::{Distribution, Material};
use crate::target::Hinge;
use glam::{DQuat, DVec3};
use std::collections::BTreeMap;
use sunglint_radiometry::spectrum::{Factor, Spectrum};

/// Cells along each side of a face of the cube on which normals are gathered.
const CELLS: f64 = 16.0;
/// Facets up to which each is a patch of its own.
const EACH: usize = 64;
/// Cosines of incidence at which a reflectance is looked at.
const COSINES: [f64; 4] = [1.0, 0.7, 0.3, 0.05];

/// Facets of one material that look the same way, or nearly.
#[derive(Debug, Clone)]
pub struct Patch {
    /// Unit normal, body axes, at angle 0 of the hinges.
    pub normal: DVec3,
    /// No normal of its facets is farther from it than this.
    pub chord: f64,
    /// m².
    pub area_m2: f64,
    /// The material.
    pub material: usize,
    /// 0, or the number of the hinge + 1.
    pub group: usize,
}

/// A material in short.
#[derive(Debug, Clone)]
pub struct Gloss {
    /// The kind and the smaller roughness of its lobe; `None` for a diffuse one, roughness 0 for a mirror.
    pub lobe: Option<(Distribution, f64)>,
    /// Largest reflectance over all wavelengths.
    pub most: f64,
    /// The largest reflectance at each wavelength over angles of incidence.
    pub envelope: Spectrum<Factor>,
}

/// Facts of a target.
#[derive(Debug)]
pub struct Body {
    pub(super) patches: Vec<Patch>,
    /// Radius (of a ball around it) and material of each curved part.
    pub(super) rounds: Vec<(f64, usize)>,
    pub(super) glosses: Vec<Gloss>,
    pub(super) hinges: Vec<Hinge>,
    /// The farthest point from the body's origin, m.
    pub size_m: f64,
}

impl Body {
    pub(super) fn new(scene: &Scene) -> Result<Self, SceneError> {
        let glosses = scene.materials().iter().map(gloss).collect::<Result<_, _>>()?;
        let now = &scene.geometry;
        let corner = now.corners.iter().map(|c| c.length()).fold(0.0, f64::max);
        let places = scene.rounds.iter().zip(&now.place);
        let reach = places.map(|(r, place)| place.point(r.middle).length() + r.radius);
        Ok(Self {
            patches: patches(scene),
            rounds: scene.rounds.iter().map(|r| (r.radius, r.material as usize)).collect(),
            glosses,
            hinges: scene.hinges.clone(),
            size_m: reach.fold(corner, f64::max),
        })
    }

    /// The unit normal of a patch with the Sun in a direction: hinged parts turn to it.
    pub(super) fn normal(&self, patch: &Patch, sun: DVec3) -> DVec3 {
        match patch.group {
            0 => patch.normal,
            h => {
                let hinge = &self.hinges[h - 1];
                DQuat::from_axis_angle(hinge.axis, hinge.angle_rad(sun)) * patch.normal
            }
        }
    }

    /// The area of all surfaces, m²; of curved parts that of a ball around each.
    pub fn area_m2(&self) -> f64 {
        let flat: f64 = self.patches.iter().map(|p| p.area_m2).sum();
        let round: f64 = self.rounds.iter().map(|(r, _)| r * r).sum();
        flat + 4.0 * std::f64::consts::PI * round
    }

    /// Whether any surface is of this material.
    pub fn uses(&self, material: usize) -> bool {
        self.patches.iter().any(|p| p.material == material)
            || self.rounds.iter().any(|(_, m)| *m == material)
    }

    /// The materials that some surface is of.
    pub fn used(&self) -> impl Iterator<Item = (usize, &Gloss)> {
        self.glosses.iter().enumerate().filter(|(m, _)| self.uses(*m))
    }

    /// The lobe that is the narrowest among flat surfaces.
    pub fn narrowest(&self) -> Option<(Distribution, f64)> {
        let lobes = self.used().filter_map(|(_, g)| g.lobe);
        lobes.min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// The largest reflectance of any surface at any wavelength.
    pub fn most_reflectance(&self) -> f64 {
        self.used().map(|(_, g)| g.most).fold(0.0, f64::max)
    }

    /// Terms of what is unknown: one a material.
    pub(super) fn unknown_terms(&self) -> Result<Vec<Term>, SceneError> {
        let term = |(number, gloss): (usize, &Gloss)| Term {
            source: Source::Unknown,
            material: Some(number),
            spectrum: gloss.envelope.clone(),
        };
        Ok(self.glosses.iter().enumerate().map(term).collect())
    }
}

fn gloss(material: &Material) -> Result<Gloss, SceneError> {
    let mut nm: Vec<f64> =
        material.spectra().iter().flat_map(|s| s.wavelength_nm()).copied().collect();
    nm.sort_by(f64::total_cmp);
    nm.dedup();
    let mut value = vec![0.0_f64; nm.len()];
    for cos in COSINES {
        let incident = DVec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos);
        let weights = material.albedo_weights(incident)?;
        for (value, nm) in value.iter_mut().zip(&nm) {
            *value = value.max(material.times_spectra(*nm, &weights));
        }
    }
    let most = value.iter().copied().fold(0.0, f64::max);
    let envelope = Spectrum::new(nm, value).map_err(crate::surface::MaterialError::from)?;
    Ok(Gloss { lobe: material.narrowest_lobe(), most, envelope })
}

fn patches(scene: &Scene) -> Vec<Patch> {
    let facets = scene.facets.iter().enumerate();
    let each = scene.report().facets <= EACH;
    let mut cells: BTreeMap<(u32, u32, [i64; 4]), Vec<usize>> = BTreeMap::new();
    for (i, facet) in facets {
        let key = if each { [i as i64, 0, 0, 0] } else { cell(scene.geometry.normal[i]) };
        cells.entry((facet.group, facet.material, key)).or_default().push(i);
    }
    let patch = |((group, material, _), facets): ((u32, u32, _), Vec<usize>)| {
        let area_m2 = facets.iter().map(|&i| scene.facets[i].area).sum();
        let mean: DVec3 =
            facets.iter().map(|&i| scene.facets[i].area * scene.geometry.normal[i]).sum();
        let normal = mean.try_normalize().unwrap_or(scene.geometry.normal[facets[0]]);
        let apart = facets.iter().map(|&i| scene.geometry.normal[i].distance(normal));
        Patch {
            normal,
            chord: if facets.len() == 1 { 0.0 } else { apart.fold(0.0, f64::max) },
            area_m2,
            material: material as usize,
            group: group as usize,
        }
    };
    cells.into_iter().map(patch).collect()
}

/// The cell of a direction on a cube.
fn cell(direction: DVec3) -> [i64; 4] {
    let size = direction.abs().max_element();
    let at = |x: f64| (x / size * CELLS * 0.5).round() as i64;
    [at(direction.x), at(direction.y), at(direction.z), 0]
}
