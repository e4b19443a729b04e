//! A pass whose integrals are taken, for single samples: of any orbit, at any moment.

use super::alike::Kept;
use super::counts::Light;
use super::functionals::Functionals;
use super::simulate::Place;
use super::{BANDS, Pass, PassError};
use crate::light::engine::Worker;
use crate::light::{Course, DirectionError, Engine, Options, SceneReport, Source};
use hifitime::Epoch;
use std::sync::Arc;
use sunglint_ephemeris::orbit::Orbit;
use sunglint_formats::time::format_utc_shortest;
use sunglint_radiometry::sky::{SkyError, SkyFrames};
use sunglint_radiometry::station::Predicted;

/// A pass with its scene and its integrals over wavelength: what all samples share. Made by [`Pass::ready`]; for another orbit or other
/// times than the pass's own, and for the moment that is brightest.
pub struct Ready<'a> {
    pub(super) pass: &'a Pass,
    pub(super) engine: Engine,
    pub(super) functionals: Arc<Functionals>,
}

/// Room to evaluate in: one for each thread.
pub struct Eye<'a> {
    ready: &'a Ready<'a>,
    worker: Worker<'a>,
    weights: Vec<f64>,
    errors: Vec<f64>,
}

/// Results of one moment.
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
        let (shadow, earthshine) = (self.shadow.is_some(), self.earth.most());
        self.ready_for(&Course { shadow, earthshine, ..Course::default() })
    }

    /// The same for what is known of the way.
    pub(super) fn ready_for(&self, course: &Course) -> Result<Ready<'_>, PassError> {
        self.ready_with(course, None)
    }

    /// The same with integrals that passes of the same scene keep.
    pub(super) fn ready_with(
        &self,
        course: &Course,
        kept: Option<&Kept>,
    ) -> Result<Ready<'_>, PassError> {
        let engine = self.engine(course)?;
        let (terms, lit) = (engine.terms(), engine.lit_terms());
        let functionals = match kept {
            Some(kept) => kept.functionals(self, terms, lit)?,
            None => Arc::new(Functionals::new(self, terms, lit)?),
        };
        Ok(Ready { pass: self, engine, functionals })
    }

    /// The light engine for what is known of the way.
    pub(super) fn engine(&self, course: &Course) -> Result<Engine, PassError> {
        let options =
            Options { tolerance: self.tolerance, switches: self.effects, budget_s: self.budget_s };
        Engine::over(&self.target, &options, course, &self.earth).map_err(|source| {
            let target = self.target.name.clone();
            PassError::Target { target, source: Box::new(source) }
        })
    }
}

impl Ready<'_> {
    /// Returns the report of the light engine on the target.
    pub fn report(&self) -> &SceneReport {
        self.engine.scene().report()
    }

    /// Frames of the pass's Earth over a stretch of time.
    ///
    /// # Errors
    /// The errors of [`SkyFrames::over`].
    pub fn frames(&self, from: Epoch, to: Epoch) -> Result<SkyFrames<'_>, SkyError> {
        SkyFrames::over(from, to, self.pass.orientation())
    }

    /// Room to evaluate in.
    pub fn eye(&self) -> Eye<'_> {
        let row = vec![0.0; self.engine.terms().len()];
        Eye { ready: self, worker: self.engine.worker(), weights: row.clone(), errors: row }
    }

    /// ΣW's relative error by the light engine's own errors, those of what is not modelled left aside.
    pub(super) fn relative(&self, weights: &[f64], errors: &[f64]) -> f64 {
        let lit = self.engine.lit_terms();
        let sum: f64 = weights[..lit].iter().map(|w| w.abs()).sum();
        if sum > 0.0 { errors[..lit].iter().sum::<f64>() / sum } else { 0.0 }
    }
}

impl Eye<'_> {
    /// Computes what the station records of an orbit's target at an epoch, in an exposure (s, above 0).
    ///
    /// # Errors
    /// The errors of [`Pass::simulate`] at that epoch.
    pub fn sample(
        &mut self,
        orbit: &Orbit,
        epoch: Epoch,
        frames: &SkyFrames<'_>,
        exposure_s: f64,
    ) -> Result<Sample, PassError> {
        let Ready { pass, functionals, .. } = self.ready;
        let mut place = pass.place(epoch, orbit, frames)?;
        pass.refract(&mut place, functionals)?;
        self.weigh(&place)?;
        let light = Light { weights: &self.weights, errors: &self.errors };
        let counts = pass.counts(&place, exposure_s, light, functionals)?;
        Ok(Sample {
            place,
            magnitudes: counts.magnitudes,
            ground_magnitudes: counts.ground,
            channels: counts.channels.iter().map(|c| (c.rate_hz, c.predicted)).collect(),
        })
    }

    /// The weights W_k of a place and their errors, m² sr⁻¹.
    pub(super) fn weigh(&mut self, place: &Place) -> Result<(&[f64], &[f64]), PassError> {
        let lit = self.worker.light(&place.lighting(), &mut self.weights, &mut self.errors);
        lit.map_err(|source| failed(place, source))?;
        Ok((&self.weights, &self.errors))
    }

    /// The same where `beside` adds the light that came by another way than straight from the Sun.
    pub(super) fn weigh_beside(
        &mut self,
        place: &Place,
        beside: &dyn Fn(&mut [f64], &mut [f64]),
    ) -> Result<(&[f64], &[f64]), PassError> {
        let (weights, errors) = (&mut self.weights, &mut self.errors);
        let lit = self.worker.light_beside(&place.lighting(), beside, weights, errors);
        lit.map_err(|source| failed(place, source))?;
        Ok((&self.weights, &self.errors))
    }

    /// Light that came by some ways, with its own errors.
    pub(super) fn weigh_some(
        &mut self,
        place: &Place,
        wanted: &dyn Fn(Source) -> bool,
    ) -> Result<(Vec<f64>, Vec<f64>), PassError> {
        let (weights, errors) = (&mut self.weights, &mut self.errors);
        let lit = self.worker.light_of(&place.lighting(), wanted, weights, errors);
        lit.map_err(|source| failed(place, source))?;
        Ok((weights.clone(), errors.clone()))
    }
}

fn failed(place: &Place, source: DirectionError) -> PassError {
    PassError::Light {
        epoch_utc: format_utc_shortest(place.geometry.epoch),
        source: Box::new(source),
    }
}
