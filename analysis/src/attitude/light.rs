//! Light from the Earth beside the direct light that the search goes by, and what else of all light is left out.

use super::AttitudeError;
use super::forward::{Forward, Measured};
use super::search::{Hunt, Trial};
use super::state::{Law, State, Turn};
use ndarray::Array2;
use rayon::prelude::*;
use std::sync::Arc;
use sunglint_calibration::pass::Unit;
use sunglint_simulator::attitude::{Attitude, Spin};
use sunglint_simulator::light::engine::Switch;
use sunglint_simulator::light::shine::EARTH_ALBEDO;
use sunglint_simulator::pass::Study;

/// Points along each side of a panel of the lit Earth: 8 a panel.
const ORDER: usize = 2;

impl Hunt<'_> {
    /// Whether the scenes want the Earth's light.
    pub(super) fn wants_earth(&self, curves: &[Measured]) -> bool {
        curves.iter().any(|c| c.pass.effects.earthshine != Switch::Off)
    }

    /// The trials with the Earth's light, held as it is at each of them, and the largest share of it at the first. It comes from half a world and changes little with the attitude: what
    /// it is at a trial is nearly what it is beside it.
    pub(super) fn lit(&self, law: &Law, trials: &mut [Trial]) -> Result<f64, AttitudeError> {
        let mut share = 0.0;
        for (i, trial) in trials.iter_mut().enumerate() {
            let held = earthshine(self.forward, law, &trial.state)?;
            if i == 0 {
                let rates = self.forward.rate.iter().zip(&held);
                share = rates
                    .filter(|(r, _)| **r > 0.0)
                    .map(|(r, h)| h / r.max(*h))
                    .fold(0.0, f64::max);
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
            || (forward.eye(), vec![0.0; forward.weights]),
            |(eye, sum), m| {
                sum.fill(0.0);
                eye.add_earth(m, law.at(state, forward.moments[m].time_s), ORDER, sum)?;
                let rate = |row: &[f64]| {
                    EARTH_ALBEDO * row.iter().zip(&*sum).map(|(k, w)| k * w).sum::<f64>()
                };
                Ok(forward.unit_rates(m).chunks_exact(forward.weights).map(rate).collect())
            },
        )
        .collect();
    Ok(rows?.concat())
}

/// How far the search's light is from all light that the scenes need, at some moments: the median and the largest difference, of all light.
pub(super) fn left_out(
    curves: &[Measured],
    forward: &Forward,
    law: &Law,
    turn: &Turn,
    epoch: hifitime::Epoch,
    moments: &[usize],
    model: &dyn Fn(usize) -> Result<Vec<f64>, AttitudeError>,
) -> Result<(f64, f64), AttitudeError> {
    let spin =
        Spin::along(law.axis_body(), turn.axis_gcrs, turn.turns_per_s, turn.phase_rad, epoch)?;
    let (mut off, mut most) = (Vec::new(), 0.0_f64);
    for (number, curve) in curves.iter().enumerate() {
        let own: Vec<usize> =
            moments.iter().copied().filter(|m| forward.moments[*m].curve == number).collect();
        if own.is_empty() {
            continue;
        }
        let failed = |source| AttitudeError::Pass {
            name: curve.data.name.clone(),
            source: Box::new(source),
        };
        let mut pass = curve.pass.clone();
        let sample = |m: &usize| forward.moments[*m].sample;
        pass.times = own.iter().map(|m| curve.pass.times[sample(m)]).collect();
        pass.exposure_s = own.iter().map(|m| curve.pass.exposure_s[sample(m)]).collect();
        pass.attitude = Attitude::Spin(spin);
        let rates = Study::new(pass).and_then(|s| s.term_rates()).map_err(failed)?;
        let all = Array2::from_shape_fn((own.len(), forward.channels), |(i, c)| match &curve.unit {
            Unit::Channels(own) => match own.get(c).copied().flatten() {
                Some(own) => rates.rates_hz.slice(ndarray::s![i, own, ..]).sum(),
                None => 0.0,
            },
            Unit::Band(band) => rates.fluxes.slice(ndarray::s![i, *band, ..]).sum(),
        });
        for (i, m) in own.iter().enumerate() {
            for (c, found) in model(*m)?.iter().enumerate() {
                let truth = all[[i, c]];
                if truth > 0.0 && forward.rates(*m)[c].is_finite() {
                    let share = (found / truth - 1.0).abs();
                    off.push(share);
                    most = most.max(share);
                }
            }
        }
    }
    Ok((super::compare::median(off).unwrap_or(0.0), most))
}
