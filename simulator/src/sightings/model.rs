//! How bright the targets are: by a law, or by the light engine of a model.

use crate::attitude::Attitude;
use crate::light::Options;
use crate::pass::{Pass, Ready, SpectralQuantity};
use crate::target::Target;
use hifitime::Epoch;
use sunglint_ephemeris::orbit::Orbit;
use sunglint_ephemeris::orbit::eclipse::EarthShape;
use sunglint_ephemeris::passes::brightness::Brightness;
use sunglint_radiometry::air::Air;
use sunglint_radiometry::light::sun_at_1_au;
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::sky::EarthOrientation;
use sunglint_radiometry::station::Station;

/// A model's brightness is looked at no more than so many seconds apart.
pub(super) const MODEL_STEP_S: f64 = 10.0;
/// Error allowed in transmission by the air's tables.
const AIR_TOLERANCE: f64 = 1e-6;

/// How bright the targets are taken to be.
pub enum SightingLight<'a> {
    /// By a law of phase angle and range.
    Law(Brightness),
    /// By the light engine.
    Model(Box<Ready<'a>>, ModelWords),
}

/// A model in words.
#[derive(Debug, Clone)]
pub struct ModelWords {
    /// The target's name.
    pub target: String,
    /// Attitude of the target, as it was requested.
    pub attitude: String,
    /// Relative error allowed in the model's light.
    pub tolerance: f64,
}

/// A body whose light is calculated, and how it is turned.
#[derive(Debug, Clone)]
pub struct Model {
    /// The body.
    pub target: Target,
    /// How it is turned.
    pub attitude: Attitude,
    /// The attitude as it was asked for.
    pub attitude_name: String,
    /// Relative error allowed in the model's light.
    pub tolerance: f64,
}

impl Model {
    /// The model in words.
    pub fn words(&self) -> ModelWords {
        ModelWords {
            target: self.target.name.clone(),
            attitude: self.attitude_name.clone(),
            tolerance: self.tolerance,
        }
    }

    /// The pass that the model is the target of. Its orbit is any: each sample has its own.
    pub fn pass(
        self,
        orbit: Orbit,
        station: &Station,
        air: &Air,
        (from, orientation): (Epoch, &EarthOrientation),
        (zero, exposure_s): (ZeroPoint, f64),
    ) -> Pass {
        let Self { target, attitude, tolerance, .. } = self;
        let warnings = [target.warnings.clone(), attitude.warnings()].concat();
        Pass {
            name: "passes".into(),
            target,
            orbit,
            attitude,
            attitude_given: true,
            station: station.clone(),
            air: Some(air.clone()),
            times: vec![from],
            exposure_s: vec![exposure_s],
            observations: Vec::new(),
            // No spectrum is asked for; one bin is the least that there is.
            edges_nm: vec![500.0, 600.0],
            spectral: SpectralQuantity::Intensity,
            sun: sun_at_1_au().clone(),
            sun_name: "ASTM G173-03".into(),
            shadow: Some(EarthShape::default()),
            earth: Default::default(),
            orientation: Some(orientation.clone()),
            zero,
            tolerance,
            budget_s: Options::BUDGET_S,
            air_tolerance: AIR_TOLERANCE,
            effects: Default::default(),
            correction: Default::default(),
            inputs: Vec::new(),
            notes: Vec::new(),
            warnings,
        }
    }
}
