//! How bright the targets are: by a law, or by the light engine of a model.

use super::PassesArgs;
use anyhow::{Context as _, bail};
use hifitime::Epoch;
use std::path::Path;
use sunglint_ephemeris::orbit::Orbit;
use sunglint_ephemeris::orbit::eclipse::EarthShape;
use sunglint_ephemeris::passes::brightness::Brightness;
use sunglint_formats::nearest_names;
use sunglint_radiometry::air::Air;
use sunglint_radiometry::light::sun_at_1_au;
use sunglint_radiometry::sky::EarthOrientation;
use sunglint_radiometry::station::Station;
use sunglint_simulator::attitude::Attitude;
use sunglint_simulator::pass::{Pass, Ready, SpectralQuantity};
use sunglint_simulator::target::Target;

/// A model's brightness is looked at no more than so many seconds apart.
pub(super) const MODEL_STEP_S: f64 = 10.0;
/// What the air's tables may err by in transmission.
const AIR_TOLERANCE: f64 = 1e-6;

/// How bright the targets are taken to be.
pub enum Light<'a> {
    /// By a law of phase angle and range.
    Law(Brightness),
    /// By the light engine.
    Model(Box<Ready<'a>>, Words),
}

/// A model in words.
#[derive(Debug, Clone)]
pub struct Words {
    /// The target's name.
    pub target: String,
    /// Its attitude as it was asked for.
    pub attitude: String,
    /// What its light may err by, relative.
    pub tolerance: f64,
}

impl PassesArgs {
    /// The pass that the model is the target of; `None` without a model. Its orbit is any: each sample has its own.
    pub(super) fn model(
        &self,
        orbit: Option<Orbit>,
        station: &Station,
        air: &Air,
        (from, orientation): (Epoch, &EarthOrientation),
    ) -> anyhow::Result<Option<(Pass, Words)>> {
        let (Some(model), Some(orbit)) = (&self.brightness.model, orbit) else { return Ok(None) };
        let target = target(model)?;
        let law = self.brightness.attitude.as_deref().unwrap_or("orbit");
        let attitude = attitude(law)?;
        let tolerance = self.brightness.tolerance;
        let words = Words { target: target.name.clone(), attitude: law.to_owned(), tolerance };
        let warnings = [target.warnings.clone(), attitude.warnings()].concat();
        let pass = Pass {
            name: "passes".into(),
            target,
            orbit,
            attitude,
            attitude_given: true,
            station: station.clone(),
            air: Some(air.clone()),
            times: vec![from],
            exposure_s: vec![self.exposure_s],
            // No spectrum is asked for; one bin is the least that there is.
            edges_nm: vec![500.0, 600.0],
            spectral: SpectralQuantity::Intensity,
            sun: sun_at_1_au().clone(),
            sun_name: "ASTM G173-03".into(),
            shadow: Some(EarthShape::default()),
            earth: Default::default(),
            orientation: Some(orientation.clone()),
            zero: self.zero_point,
            tolerance,
            air_tolerance: AIR_TOLERANCE,
            effects: Default::default(),
            inputs: Vec::new(),
            notes: Vec::new(),
            warnings,
        };
        Ok(Some((pass, words)))
    }
}

/// A built-in target, or one of a file.
pub(crate) fn target(model: &str) -> anyhow::Result<Target> {
    if let Some(target) = Target::built_in(model) {
        return Ok(target);
    }
    let path = Path::new(model);
    if path.exists() {
        return Ok(Target::read(path)?);
    }
    let names = Target::built_in_names();
    let near = nearest_names(model, names.iter().copied(), 1);
    let hint = near.first().map_or(String::new(), |near| format!("; did you mean {near}?"));
    bail!(
        "--model: there is no target `{model}`: it is neither a built-in name ({}) nor a file{hint}",
        names.join(", ")
    )
}

/// A law by its name, or one of a file.
fn attitude(law: &str) -> anyhow::Result<Attitude> {
    const ALONE: [&str; 4] = ["orbit", "yaw_steering", "sun", "inertial"];
    let path = Path::new(law);
    if path.exists() {
        return Attitude::read(path).context("--attitude");
    }
    if !ALONE.contains(&law) {
        let near = nearest_names(law, ALONE, 1);
        let hint = near.first().map_or(String::new(), |near| format!("; did you mean {near}?"));
        bail!(
            "--attitude: there is no law and no file `{law}`: laws that need nothing else are {}; a file with [attitude] has all others (docs/pass.md){hint}",
            ALONE.join(", ")
        );
    }
    Attitude::named(law).context("--attitude: give it in a file with [attitude]")
}
