//! A pass whose integrals are taken, for single samples: of any orbit, at any moment.

use super::functionals::Functionals;
use super::simulate::Place;
use super::{BANDS, Pass, PassError};
use crate::light::{Evaluator, Scene, SceneReport, View};
use crate::orbit::Orbit;
use hifitime::Epoch;
use sunglint_formats::time::format_utc_shortest;
use sunglint_radiometry::sky::{SkyError, SkyFrames};
use sunglint_radiometry::station::Predicted;

/// A pass with its scene and its integrals over wavelength: what all samples share. Made by [`Pass::ready`]; for another orbit or other
/// times than the pass's own, and for the moment that is brightest.
pub struct Ready<'a> {
    pub(super) pass: &'a Pass,
    pub(super) scene: Scene,
    pub(super) functionals: Functionals,
}

/// Room to evaluate in: one for each thread.
pub struct Eye<'a> {
    ready: &'a Ready<'a>,
    evaluator: Evaluator<'a>,
    weights: Vec<f64>,
}

/// What one moment yields.
#[derive(Debug, Clone)]
pub struct Sample {
    /// Where everything stands.
    pub place: Place,
    /// Magnitudes above the air in [`BANDS`]; NaN without light.
    pub magnitudes: [f64; BANDS.len()],
    /// The same after the air; NaN below the horizon too.
    pub ground_magnitudes: [f64; BANDS.len()],
    /// For each channel of the station: the predicted rate at the detector, Hz (NaN below the horizon), and what the channel makes of it.
    pub channels: Vec<(f64, Predicted)>,
}

impl Pass {
    /// The scene and the integrals, for samples beyond the pass's own orbit and times.
    ///
    /// # Errors
    /// [`PassError::Target`], [`PassError::Air`], [`PassError::Spectrum`] and [`PassError::Photometry`].
    pub fn ready(&self) -> Result<Ready<'_>, PassError> {
        let scene = Scene::new(&self.target).map_err(|source| {
            let target = self.target.name.clone();
            PassError::Target { target, source: Box::new(source) }
        })?;
        let functionals = Functionals::new(self, &scene.spectra().collect::<Vec<_>>())?;
        Ok(Ready { pass: self, scene, functionals })
    }
}

impl Ready<'_> {
    /// What the light engine made of the target.
    pub fn report(&self) -> &SceneReport {
        self.scene.report()
    }

    /// Frames of the pass's Earth over a stretch of time.
    ///
    /// # Errors
    /// As [`SkyFrames::over`].
    pub fn frames(&self, from: Epoch, to: Epoch) -> Result<SkyFrames<'_>, SkyError> {
        SkyFrames::over(from, to, self.pass.orientation())
    }

    /// Room to evaluate in.
    pub fn eye(&self) -> Eye<'_> {
        let weights = vec![0.0; self.scene.spectra().count()];
        Eye { ready: self, evaluator: self.scene.evaluator(), weights }
    }
}

impl Eye<'_> {
    /// What the station records of an orbit's target at an epoch, in an exposure (s, above 0).
    ///
    /// # Errors
    /// As [`Pass::simulate`] at that epoch.
    pub fn sample(
        &mut self,
        orbit: &Orbit,
        epoch: Epoch,
        frames: &SkyFrames<'_>,
        exposure_s: f64,
    ) -> Result<Sample, PassError> {
        let Ready { pass, functionals, .. } = self.ready;
        let place = pass.place(epoch, orbit, frames, functionals)?;
        self.weigh(&place)?;
        let counts = pass.counts(&place, exposure_s, &self.weights, functionals)?;
        Ok(Sample {
            place,
            magnitudes: counts.magnitudes,
            ground_magnitudes: counts.ground,
            channels: counts.channels.iter().map(|c| (c.0, c.2)).collect(),
        })
    }

    /// The weights W_k of a place, m² sr⁻¹, and the engine's estimate of their relative error.
    pub(super) fn weigh(&mut self, place: &Place) -> Result<(&[f64], f64), PassError> {
        let view = View::Distant(place.observer_body);
        let lit = self.evaluator.direct(place.sun_body, view, &mut self.weights);
        let lit = lit.map_err(|source| PassError::Light {
            epoch_utc: format_utc_shortest(place.geometry.epoch),
            source: Box::new(source),
        })?;
        Ok((&self.weights, lit.error))
    }
}
