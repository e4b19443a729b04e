//! Light by other ways than the direct one, which the search goes by: from the Earth, and, for the best minima, all that the scenes need.

use super::AttitudeError;
use super::forward::{Forward, Measured};
use super::hunt::{Hunt, Trial};
use super::state::{Law, State};
use crate::solver::Unit;
use hifitime::Epoch;
use rayon::prelude::*;
use std::sync::Arc;
use sunglint_simulator::attitude::{Attitude, Spin};
use sunglint_simulator::light::engine::Switch;
use sunglint_simulator::pass::Study;

/// Points along each side of a panel of the lit Earth: 8 a panel.
const ORDER: usize = 2;
/// Relative tolerance of all light: it is computed for whole passes, several times.
const TOLERANCE: f64 = 0.01;

/// Whether the scenes want the Earth's light.
pub(super) fn wants_earth(curves: &[Measured]) -> bool {
    curves.iter().any(|c| c.pass.effects.earthshine != Switch::Off)
}

impl Hunt<'_> {
    /// The trials with the Earth's light, held as it is at each of them. It comes from half a world and changes little with the attitude: what it is at a trial is nearly what it is beside it.
    pub(super) fn lit(&self, law: &Law, trials: &mut [Trial]) -> Result<(), AttitudeError> {
        for trial in trials {
            trial.held = Some(Arc::new(earthshine(self.forward, law, &trial.state)?));
        }
        Ok(())
    }

    /// The trials with all light that the scenes need, likewise, and the median and the largest share of what is not direct at the first.
    pub(super) fn all_lit(
        &self,
        light: &mut AllLight,
        law: &Law,
        trials: &mut [Trial],
    ) -> Result<(f64, f64), AttitudeError> {
        let mut share = (0.0, 0.0);
        for (i, trial) in trials.iter_mut().enumerate() {
            let mut held = match &trial.held {
                Some(held) => held.as_ref().clone(),
                None => vec![0.0; self.forward.rate.len()],
            };
            let own =
                light.fill(self.forward, law, &trial.state, self.question.epoch, &mut held)?;
            if i == 0 {
                share = own;
            }
            trial.held = Some(Arc::new(held));
        }
        Ok(share)
    }
}

/// The rates by the Earth's light: `[moment * channels + channel]`.
fn earthshine(forward: &Forward, law: &Law, state: &State) -> Result<Vec<f64>, AttitudeError> {
    let rows: Result<Vec<Vec<f64>>, AttitudeError> = (0..forward.moments.len())
        .into_par_iter()
        .map_init(
            || forward.eye(),
            |eye, m| {
                let sum = eye.earth(m, law.at(state, forward.moments[m].time_s), ORDER)?;
                let rate = |row: &[f64]| row.iter().zip(&sum).map(|(k, w)| k * w).sum::<f64>();
                Ok(forward.unit_rates(m).chunks_exact(forward.weights).map(rate).collect())
            },
        )
        .collect();
    Ok(rows?.concat())
}

/// All light that the scenes need, for any attitude, at some moments.
pub(super) struct AllLight<'a> {
    curves: &'a [Measured],
    /// For each curve, the moments at which it is computed, and the scene at these.
    studies: Vec<(Vec<usize>, Study)>,
}

impl<'a> AllLight<'a> {
    /// Makes the scenes ready, at a tolerance that the noise of measurements allows.
    pub fn new(
        curves: &'a [Measured],
        forward: &Forward,
        moments: &[usize],
    ) -> Result<Self, AttitudeError> {
        let mut studies = Vec::new();
        for (number, curve) in curves.iter().enumerate() {
            let of = |m: &usize| forward.moments[*m].curve == number;
            let own: Vec<usize> = moments.iter().copied().filter(of).collect();
            let mut pass = curve.pass.clone();
            let sample = |m: &usize| forward.moments[*m].sample;
            pass.times = own.iter().map(|m| curve.pass.times[sample(m)]).collect();
            pass.exposure_s = own.iter().map(|m| curve.pass.exposure_s[sample(m)]).collect();
            pass.observations = curve.pass.observations_of(own.iter().map(sample));
            pass.tolerance = pass.tolerance.max(TOLERANCE);
            if own.is_empty() {
                continue;
            }
            let study = Study::new(pass).map_err(|source| AttitudeError::Pass {
                name: curve.data.name.clone(),
                source: Box::new(source),
            })?;
            studies.push((own, study));
        }
        Ok(Self { curves, studies })
    }

    /// Sets what all light has beyond the direct light of a trial; gives the median and the largest share of it.
    fn fill(
        &mut self,
        forward: &Forward,
        law: &Law,
        state: &State,
        epoch: Epoch,
        held: &mut [f64],
    ) -> Result<(f64, f64), AttitudeError> {
        let turn = law.turn(state)?;
        let spin =
            Spin::along(law.axis_body(), turn.axis_gcrs, turn.turns_per_s, turn.phase_rad, epoch)?;
        let mut eye = forward.eye();
        let mut direct = vec![0.0; forward.channels];
        let mut shares = Vec::new();
        for (own, study) in &mut self.studies {
            let Some(first) = own.first() else { continue };
            let curve = &self.curves[forward.moments[*first].curve];
            let failed = |source| AttitudeError::Pass {
                name: curve.data.name.clone(),
                source: Box::new(source),
            };
            study.set_attitude(Attitude::Spin(spin)).map_err(failed)?;
            let rates = study.term_rates().map_err(failed)?;
            for (i, m) in own.iter().enumerate() {
                eye.rates(*m, law.at(state, forward.moments[*m].time_s), &mut direct)?;
                for (c, direct) in direct.iter().enumerate() {
                    let row = match &curve.unit {
                        Unit::Channels(own) => own
                            .get(c)
                            .copied()
                            .flatten()
                            .map(|own| rates.rates_hz.slice(ndarray::s![i, own, ..])),
                        Unit::Band(band) => Some(rates.fluxes.slice(ndarray::s![i, *band, ..])),
                    };
                    let whole = row.map_or(f64::NAN, |r| r.sum());
                    if whole.is_finite() && forward.rates(*m)[c].is_finite() {
                        held[m * forward.channels + c] = whole - direct;
                        if whole > 0.0 {
                            shares.push(((whole - direct) / whole).abs());
                        }
                    }
                }
            }
        }
        let most = shares.iter().copied().fold(0.0, f64::max);
        Ok((sunglint_numerics::order::median(shares).unwrap_or(0.0), most))
    }
}
