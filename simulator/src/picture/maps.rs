//! Reflection maps of a body at wavelengths: what it sends back over the directions of the phase vector.

use super::ViewError;
use super::aim::Aim;
use super::map::Map;
use super::shot::irradiance;
use crate::light::Scene;

/// Maps of one body at one phase angle.
#[derive(Debug, Clone)]
pub struct ReflectionMaps<'a> {
    /// The body.
    pub aim: &'a Aim,
    /// The phase angle, degrees.
    pub phase_deg: f64,
    /// Whether intensities are over the Sun's irradiance.
    pub per_irradiance: bool,
    /// Wavelength (vacuum nm) and map; at least one.
    pub maps: Vec<(f64, Map)>,
}

impl<'a> ReflectionMaps<'a> {
    /// Computes the maps, with steps of `step_deg` between directions.
    ///
    /// # Errors
    /// A target that is none, a phase angle or step that is none, wavelengths without sunlight or reflectance, a body that sends nothing back.
    pub fn new(
        aim: &'a Aim,
        wavelength_nm: &[f64],
        phase_deg: f64,
        step_deg: f64,
        per_irradiance: bool,
    ) -> Result<Self, ViewError> {
        let mut maps = Vec::new();
        let scene = Scene::new(&aim.target).map_err(|source| {
            let name = aim.target.name.clone();
            ViewError::Target { name, source }
        })?;
        for nm in wavelength_nm {
            let sun = if per_irradiance { 1.0 } else { irradiance(aim, *nm)? };
            let factors: Vec<f64> = scene.reflectances(*nm)?.iter().map(|r| sun * r).collect();
            maps.push((*nm, Map::of(&scene, phase_deg.to_radians(), step_deg, &factors)?));
        }
        if maps.iter().all(|(_, map)| map.intensity.iter().all(|v| *v <= 0.0)) {
            return Err(ViewError::Impossible(format!(
                "{} sends nothing back in any direction at a phase angle of {phase_deg}°",
                aim.target.name
            )));
        }
        Ok(Self { aim, phase_deg, per_irradiance, maps })
    }
}
