//! Pressure of sunlight and of air on a body's surface.

use crate::light::{DirectionError, Evaluator, Exposed, Scene, SceneError};
use crate::mesh::shapes::{Faceting, icosphere};
use crate::surface::Material;
use crate::target::{Shape, Target};
use glam::DVec3;
use std::f64::consts::FRAC_PI_2;
use sunglint_radiometry::light;

/// Round spheres become 20·4³ facets of the same area.
const SPHERE_SUBDIVISIONS: u32 = 3;
/// Intervals of the angle of incidence at which a material's recoil is tabulated.
const ANGLES: usize = 90;

/// Force and torque about the centre of mass, body axes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Push {
    /// Force, N.
    pub force_n: DVec3,
    /// Torque, N m.
    pub torque_n_m: DVec3,
}

/// Surface of a body, flat facet by flat facet, with what each hides of the others.
#[derive(Debug, Clone)]
pub struct Skin {
    scene: Scene,
    recoils: Vec<Recoil>,
    centre_m: DVec3,
}

/// Momentum that a material's reflected sunlight carries away, at even angles of incidence: along the light's own trace in the surface,
/// and along the normal. Parts of the momentum that came.
#[derive(Debug, Clone, PartialEq)]
struct Recoil {
    along: Vec<f64>,
    normal: Vec<f64>,
}

impl Skin {
    /// Takes the surface of a target: spheres, cylinders, cones and dishes become flat facets, normals at corners are left out. Shadows are
    /// exact for these facets. Recoil follows from the materials and the Sun's spectrum ([`Material::momentum`]); that of a
    /// material with a tangent is a mean over the azimuth.
    ///
    /// # Errors
    /// The errors of [`Scene::new`].
    pub fn new(target: &Target, centre_m: DVec3) -> Result<Self, SceneError> {
        let mut flat = target.clone();
        for part in &mut flat.parts {
            let mesh = match &part.shape {
                Shape::Mesh(mesh) => mesh.clone(),
                Shape::Sphere { radius_m } => {
                    icosphere(*radius_m, SPHERE_SUBDIVISIONS, Faceting::SameArea)
                }
                Shape::Curved(curved) => curved.mesh(),
            };
            part.shape = Shape::Mesh(mesh.flat());
        }
        // The scene is asked for places alone: a flat mirror is as good as any paint.
        let plain = flat
            .materials
            .iter()
            .map(|m| Material::lambert(m.name.clone(), light_of_all()?))
            .collect::<Result<Vec<_>, _>>()?;
        let recoils = flat.materials.iter().map(Recoil::of).collect();
        flat.materials = plain;
        Ok(Self { scene: Scene::new(&flat)?, recoils, centre_m })
    }

    /// Room to work in.
    pub(super) fn evaluator(&self) -> Evaluator<'_> {
        self.scene.evaluator()
    }

    /// Push of sunlight of a pressure (irradiance over the speed of light, Pa) from a direction: on each open facet
    /// −P A cosθ (ŝ + ∫ f cosθ_o ω_o dω_o), at the centroid of its lit part. One scattering; heat that is radiated is left out.
    ///
    /// # Errors
    /// [`DirectionError::NoDirection`].
    pub fn sunlight(&self, sun_body: DVec3, pressure_pa: f64) -> Result<Push, DirectionError> {
        self.sunlight_in(&mut self.evaluator(), sun_body, pressure_pa)
    }

    pub(super) fn sunlight_in(
        &self,
        evaluator: &mut Evaluator<'_>,
        sun_body: DVec3,
        pressure_pa: f64,
    ) -> Result<Push, DirectionError> {
        let sun = sun_body.normalize_or_zero();
        let mut push = Push::default();
        evaluator.exposed(sun, sun, &mut |open: &Exposed| {
            let trace = (sun - open.cos * open.normal).normalize_or_zero();
            let (along, normal) = self.recoils[open.material].at(open.cos);
            let carried = sun + along * trace + normal * open.normal;
            push.add(
                -pressure_pa * open.area_m2 * open.cos * carried,
                open.centroid_m - self.centre_m,
            );
        })?;
        Ok(push)
    }

    /// Push of air that the body moves through, with one drag coefficient for all of the surface: −½ ρ C_D v² A cosθ v̂ on each open facet.
    ///
    /// # Errors
    /// [`DirectionError::NoDirection`], for a body that stands still in the air too.
    pub fn air(
        &self,
        velocity_body_m_s: DVec3,
        sun_body: DVec3,
        density_kg_m3: f64,
        coefficient: f64,
    ) -> Result<Push, DirectionError> {
        self.air_in(&mut self.evaluator(), velocity_body_m_s, sun_body, density_kg_m3 * coefficient)
    }

    pub(super) fn air_in(
        &self,
        evaluator: &mut Evaluator<'_>,
        velocity_body_m_s: DVec3,
        sun_body: DVec3,
        density_times_coefficient: f64,
    ) -> Result<Push, DirectionError> {
        let pressure = 0.5 * density_times_coefficient * velocity_body_m_s.length_squared();
        let ahead = velocity_body_m_s.normalize_or_zero();
        let mut push = Push::default();
        evaluator.exposed(ahead, sun_body, &mut |open: &Exposed| {
            push.add(-pressure * open.area_m2 * open.cos * ahead, open.centroid_m - self.centre_m);
        })?;
        Ok(push)
    }
}

impl Push {
    fn add(&mut self, force_n: DVec3, arm_m: DVec3) {
        self.force_n += force_n;
        self.torque_n_m += arm_m.cross(force_n);
    }
}

fn light_of_all() -> Result<
    sunglint_radiometry::spectrum::Spectrum<sunglint_radiometry::spectrum::Reflectance>,
    crate::surface::MaterialError,
> {
    Ok(sunglint_radiometry::spectrum::Spectrum::constant(1.0, 300.0, 1300.0)?)
}

impl Recoil {
    fn of(material: &Material) -> Self {
        let sun = light::sun_at_1_au();
        let (nm, power) = (sun.wavelength_nm(), sun.value());
        // Means over the Sun's light, by trapezia; beyond its table a reflectance is held.
        let mut shares = vec![0.0; material.spectra().len()];
        let mut all = 0.0;
        for i in 1..nm.len() {
            let width = 0.5 * (nm[i] - nm[i - 1]);
            all += width * (power[i] + power[i - 1]);
            for (share, rho) in shares.iter_mut().zip(material.spectra()) {
                *share += width * (power[i] * rho.at(nm[i]) + power[i - 1] * rho.at(nm[i - 1]));
            }
        }
        let azimuths: &[f64] = if material.is_isotropic() {
            &[0.0]
        } else {
            &[0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75]
        };
        let (mut along, mut normal) = (Vec::new(), Vec::new());
        for k in 0..=ANGLES {
            // At grazing incidence the last angle stands for the limit.
            let theta = (FRAC_PI_2 * k as f64 / ANGLES as f64).min(FRAC_PI_2 - 1e-3);
            let (sin, cos) = theta.sin_cos();
            let mut sum = [0.0; 2];
            for half_turns in azimuths {
                let (y, x) = (half_turns * std::f64::consts::PI).sin_cos();
                let carried = material.momentum(DVec3::new(sin * x, sin * y, cos));
                for (m, share) in carried.iter().zip(&shares) {
                    let part = share / all / azimuths.len() as f64;
                    sum[0] += part * (m.x * x + m.y * y);
                    sum[1] += part * m.z;
                }
            }
            along.push(sum[0]);
            normal.push(sum[1]);
        }
        Self { along, normal }
    }

    /// Linear between the angles: along the trace, and along the normal.
    fn at(&self, cos: f64) -> (f64, f64) {
        let at = cos.clamp(0.0, 1.0).acos() / FRAC_PI_2 * ANGLES as f64;
        let k = (at as usize).min(ANGLES - 1);
        let part = at - k as f64;
        let mix = |v: &[f64]| v[k] + part * (v[k + 1] - v[k]);
        (mix(&self.along), mix(&self.normal))
    }
}
