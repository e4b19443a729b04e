//! From a trial down to the minimum near it: Levenberg-Marquardt with the light engine's own derivatives by attitude; what is proportional to a scale is solved for.

use super::compare::Compared;
use super::forward::{Eye, Forward};
use super::state::{Law, State, Unknowns};
use super::{AttitudeError, Scale};
use nalgebra::DMatrix;
use std::sync::Arc;

/// How light is compared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Space {
    /// By logarithms, with an uncertainty of the model of `spread` beside the stated noise.
    Logarithms {
        /// ln.
        spread: f64,
    },
    /// By rates, with noise of `extra` times the rate beside the stated one.
    Rates {
        /// A part of the rate.
        extra: f64,
    },
}

/// What a descent works on.
pub struct Descent<'a> {
    /// The light.
    pub forward: &'a Forward,
    /// Its logarithms.
    pub compared: &'a Compared,
    /// The spin.
    pub law: &'a Law,
    /// What of it is unknown.
    pub unknowns: Unknowns,
    /// The epochs.
    pub moments: &'a [usize],
    /// How it is compared.
    pub space: Space,
    /// What of the brightness is free.
    pub scale: Scale,
    /// For each weight the material that it is of.
    pub materials: &'a [usize],
    /// Light by other ways than the direct one, added to every trial's: `[moment * channels + channel]`.
    pub held: Option<&'a [f64]>,
}

/// A minimum.
#[derive(Debug, Clone)]
pub struct Found {
    /// The trial.
    pub state: State,
    /// The sum of squares, large residuals linear.
    pub cost: f64,
    /// Factors of the brightness, as [`Scale`] has them.
    pub scales: Vec<f64>,
    /// The normal matrix of steps ([`Law::moved`]), then scales, at the minimum.
    pub normal: DMatrix<f64>,
    /// Epochs simulated on the way.
    pub simulated: usize,
    /// The light by other ways that was added.
    pub held: Option<Arc<Vec<f64>>>,
}

impl<'a> Descent<'a> {
    /// The same with the light that a minimum has added.
    pub fn with(mut self, found: &'a Found) -> Self {
        self.held = found.held.as_ref().map(|h| h.as_slice());
        self
    }
}

impl Descent<'_> {
    /// Goes down from a trial, in `most` steps at most.
    ///
    /// # Errors
    /// A trial that is none.
    pub fn down(&self, eye: &mut Eye, from: &State, most: usize) -> Result<Found, AttitudeError> {
        let mut state = *from;
        let mut light = self.light(eye, &state, true)?;
        let mut simulated = self.moments.len();
        let mut about = self.measured();
        let mut judged = self.judge(&light, &about);
        if matches!(self.space, Space::Rates { .. }) {
            // What is measured too low by chance has no smaller noise for it: the model's own light counts.
            about = self.about(&light, &judged.scales);
            judged = self.judge(&light, &about);
        }
        let steps = self.unknowns.count();
        let mut damping = 1e-3;
        for _ in 0..most {
            let mut damped = judged.normal.clone();
            for i in 0..damped.nrows() {
                damped[(i, i)] += damping * damped[(i, i)] + f64::MIN_POSITIVE;
            }
            let Some(change) = damped.cholesky().map(|c| c.solve(&judged.pull)) else { break };
            // A step beyond half a radian is none that a slope knows of.
            let longest = change.iter().take(steps).fold(0.0_f64, |a, v| a.max(v.abs()));
            let part = if longest > 0.5 { 0.5 / longest } else { 1.0 };
            let step: Vec<f64> = change.iter().take(steps).map(|v| part * v).collect();
            let next = self.law.moved(&state, self.unknowns, &step)?;
            let tried = self.judge(&self.light(eye, &next, false)?, &about);
            simulated += self.moments.len();
            if tried.cost < judged.cost {
                let gain = (judged.cost - tried.cost) / judged.cost.max(f64::MIN_POSITIVE);
                state = next;
                light = self.light(eye, &state, true)?;
                simulated += self.moments.len();
                if matches!(self.space, Space::Rates { .. }) {
                    about = self.about(&light, &tried.scales);
                }
                judged = self.judge(&light, &about);
                damping = (0.2 * damping).max(1e-9);
                if gain < 1e-7 || part * longest < 1e-8 {
                    break;
                }
            } else {
                damping *= 8.0;
                if damping > 1e7 || longest < 1e-9 {
                    break;
                }
            }
        }
        Ok(Found {
            state,
            cost: judged.cost,
            scales: judged.scales,
            normal: judged.normal,
            simulated,
            held: None,
        })
    }

    /// The sum of squares of a trial.
    ///
    /// # Errors
    /// A trial that is none.
    pub fn cost(&self, eye: &mut Eye, state: &State) -> Result<f64, AttitudeError> {
        let light = self.light(eye, state, false)?;
        Ok(self.judge(&light, &self.measured()).cost)
    }

    /// Measured, simulated (as bright as it fits) and uncertain by the stated noise, of all samples that count: for what is left over.
    ///
    /// # Errors
    /// A trial that is none.
    pub fn samples(&self, eye: &mut Eye, state: &State) -> Result<Vec<Sample>, AttitudeError> {
        let light = self.light(eye, state, false)?;
        let judged = self.judge(&light, &self.measured());
        let model = self.about(&light, &judged.scales);
        let channels = self.forward.channels;
        let mut all = Vec::new();
        for (e, m) in self.moments.iter().enumerate() {
            for channel in 0..channels {
                let i = m * channels + channel;
                if self.forward.rate[i].is_finite() {
                    all.push(Sample {
                        moment: *m,
                        channel,
                        rate: self.forward.rate[i],
                        sigma: self.forward.sigma[i],
                        model: model[e * channels + channel],
                    });
                }
            }
        }
        Ok(all)
    }
}

/// A sample beside its model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Its epoch, by number in [`Forward::moments`].
    pub moment: usize,
    /// Its channel.
    pub channel: usize,
    /// Measured.
    pub rate: f64,
    /// Stated standard uncertainty.
    pub sigma: f64,
    /// Simulated.
    pub model: f64,
}
