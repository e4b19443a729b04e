//! Facts of a target that decide what it needs: surfaces by the way they look, lobes, reflectances.

use crate::light::scene::Scene;
use crate::light::{SceneError, Source, Term};
use crate::surface::{Distribution, Material};
use crate::target::Hinge;
use glam::{DQuat, DVec3};
use std::collections::{BTreeMap, BTreeSet};
use sunglint_radiometry::spectrum::{Factor, Spectrum};

/// Cells along each side of a face of the cube on which normals are gathered.
const CELLS: f64 = 16.0;
/// Directions up to which all facets that look the same way are a patch of their own.
const EACH: usize = 64;
/// Axes that are alike, radians: far below anything that a lobe or the disc could tell apart, far above rounding.
const ALIKE: f64 = 1e-8;
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
    /// First axis in the plane of its facets (of one of them, where their material needs none), body axes, at angle 0 of the hinges.
    pub tangent: DVec3,
    /// Whether normals at their corners bend its facets.
    pub bent: bool,
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
    /// Radius (of a ball around it) and material of each curved part, and whether it is a sphere.
    pub(super) rounds: Vec<(f64, usize, bool)>,
    /// Materials of spheres, and those of other curved surfaces: parts, and facets that are bent.
    pub(super) spheres: Vec<usize>,
    pub(super) curved: Vec<usize>,
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
        let of = |sphere: bool| {
            let rounds = scene.rounds.iter().filter(move |r| r.sphere.is_some() == sphere);
            rounds.map(|r| r.material as usize)
        };
        let rounds =
            scene.rounds.iter().map(|r| (r.radius, r.material as usize, r.sphere.is_some()));
        let bent = scene.facets.iter().filter(|f| f.patch.is_some()).map(|f| f.material as usize);
        Ok(Self {
            patches: patches(scene),
            rounds: rounds.collect(),
            spheres: distinct(of(true)),
            curved: distinct(of(false).chain(bent)),
            glosses,
            hinges: scene.hinges.clone(),
            size_m: reach.fold(corner, f64::max),
        })
    }

    /// The unit normal of a patch with the Sun in a direction: hinged parts turn to it.
    pub(super) fn normal(&self, patch: &Patch, sun: DVec3) -> DVec3 {
        self.turned(patch, sun, patch.normal)
    }

    /// Tangent of a patch with the Sun in a direction.
    pub(super) fn tangent(&self, patch: &Patch, sun: DVec3) -> DVec3 {
        self.turned(patch, sun, patch.tangent)
    }

    fn turned(&self, patch: &Patch, sun: DVec3, axis: DVec3) -> DVec3 {
        match patch.group {
            0 => axis,
            h => {
                let hinge = &self.hinges[h - 1];
                DQuat::from_axis_angle(hinge.axis, hinge.angle_rad(sun)) * axis
            }
        }
    }

    /// The area of all surfaces, m²; of curved parts that of a ball around each.
    pub fn area_m2(&self) -> f64 {
        let flat: f64 = self.patches.iter().map(|p| p.area_m2).sum();
        let round: f64 = self.rounds.iter().map(|(r, ..)| r * r).sum();
        flat + 4.0 * std::f64::consts::PI * round
    }

    /// Whether any surface is of this material.
    pub fn uses(&self, material: usize) -> bool {
        self.patches.iter().any(|p| p.material == material)
            || self.rounds.iter().any(|(_, m, _)| *m == material)
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
    let exact = gathered(scene, |d| (d / ALIKE).round().to_array().map(|x| x as i64));
    let patches = if exact.len() <= EACH { exact } else { gathered(scene, cell) };
    let patch = |(key, facets): (Key, Vec<usize>)| {
        let area_m2 = facets.iter().map(|&i| scene.facets[i].area).sum();
        let mean: DVec3 =
            facets.iter().map(|&i| scene.facets[i].area * scene.geometry.normal[i]).sum();
        let normal = mean.try_normalize().unwrap_or(scene.geometry.normal[facets[0]]);
        let apart = facets.iter().map(|&i| scene.geometry.normal[i].distance(normal));
        let chord = apart.fold(0.0, f64::max);
        Patch {
            normal,
            chord: if chord < 2.0 * ALIKE { 0.0 } else { chord },
            area_m2,
            material: key.material as usize,
            group: key.group as usize,
            tangent: scene.geometry.tangent[facets[0]],
            bent: key.bent,
        }
    };
    patches.into_iter().map(patch).collect()
}

/// Properties that the facets of a patch share.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Key {
    group: u32,
    material: u32,
    bent: bool,
    normal: [i64; 3],
    /// None where the material reflects the same whatever its tangent.
    tangent: Option<[i64; 3]>,
}

/// Facets by what they share, with axes that are alike where `cell` says so.
fn gathered(scene: &Scene, cell: impl Fn(DVec3) -> [i64; 3]) -> BTreeMap<Key, Vec<usize>> {
    let isotropic: Vec<bool> = scene.materials().iter().map(Material::is_isotropic).collect();
    let mut cells: BTreeMap<Key, Vec<usize>> = BTreeMap::new();
    for (i, facet) in scene.facets.iter().enumerate() {
        let key = Key {
            group: facet.group,
            material: facet.material,
            bent: facet.patch.is_some(),
            normal: cell(scene.geometry.normal[i]),
            tangent: (!isotropic[facet.material as usize]).then(|| cell(scene.geometry.tangent[i])),
        };
        cells.entry(key).or_default().push(i);
    }
    cells
}

/// Each number once.
fn distinct(numbers: impl Iterator<Item = usize>) -> Vec<usize> {
    numbers.collect::<BTreeSet<_>>().into_iter().collect()
}

/// The cell of a direction on a cube.
fn cell(direction: DVec3) -> [i64; 3] {
    let size = direction.abs().max_element();
    (direction / size * CELLS * 0.5).round().to_array().map(|x| x as i64)
}
