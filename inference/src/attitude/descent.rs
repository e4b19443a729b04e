//! From a trial down to the minimum near it: Levenberg and Marquardt's steps with the light engine's own derivatives by attitude; what is proportional to a scale is solved for.

use super::compare::Compared;
use super::forward::{Eye, Forward};
use super::residuals::Judged;
use super::state::{Law, State, Unknowns};
use super::{AttitudeError, Scale};
use nalgebra::{DMatrix, DVector};
use std::sync::Arc;
use sunglint_numerics::least_squares::{self, Limits, Normal, minimise};

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

/// Inputs of a descent to a minimum.
pub struct Descent<'a> {
    /// The light.
    pub forward: &'a Forward,
    /// Logarithms of the measured light.
    pub compared: &'a Compared,
    /// The spin.
    pub law: &'a Law,
    /// Unknown numbers of the spin.
    pub unknowns: Unknowns,
    /// The epochs.
    pub moments: &'a [usize],
    /// How it is compared.
    pub space: Space,
    /// Free factors of the brightness.
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
        let mut going =
            Going { descent: self, eye, simulated: self.moments.len(), about: self.measured() };
        let judged = self.judge(&self.light(going.eye, from, false)?, &going.about);
        let limits = Limits { steps: most, gain: 1e-7, step: 1e-9 };
        let place = minimise(&mut going, At { state: *from, judged }, &limits)?.place;
        let At { state, judged } = place;
        Ok(Found {
            state,
            cost: judged.cost,
            scales: judged.scales,
            normal: judged.normal,
            simulated: going.simulated,
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

/// A trial and how it answers.
struct At {
    state: State,
    judged: Judged,
}

struct Going<'a, 'b, 'c> {
    descent: &'a Descent<'b>,
    eye: &'a mut Eye<'c>,
    simulated: usize,
    /// The rates that noise is a part of.
    about: Vec<f64>,
}

impl least_squares::Descent for Going<'_, '_, '_> {
    type Place = At;
    type Error = AttitudeError;

    fn cost(&self, place: &At) -> f64 {
        place.judged.cost
    }

    fn normal(&mut self, place: &mut At) -> Result<Normal, AttitudeError> {
        let light = self.descent.light(self.eye, &place.state, true)?;
        self.simulated += self.descent.moments.len();
        if matches!(self.descent.space, Space::Rates { .. }) {
            // What is measured too low by chance has no smaller noise for it: the model's own light counts.
            self.about = self.descent.about(&light, &place.judged.scales);
        }
        place.judged = self.descent.judge(&light, &self.about);
        let Judged { normal, pull, .. } = &place.judged;
        Ok(Normal { matrix: normal.clone(), downhill: pull.clone() })
    }

    fn step(&mut self, from: &At, step: &mut DVector<f64>) -> Result<At, AttitudeError> {
        let count = self.descent.unknowns.count();
        // What is free of the brightness is solved for at each place.
        step.rows_mut(count, step.len() - count).fill(0.0);
        // A step beyond half a radian is none that a slope knows of.
        let longest = step.amax();
        if longest > 0.5 {
            *step *= 0.5 / longest;
        }
        let turned = &step.as_slice()[..count];
        let state = self.descent.law.moved(&from.state, self.descent.unknowns, turned)?;
        let light = self.descent.light(self.eye, &state, false)?;
        self.simulated += self.descent.moments.len();
        Ok(At { state, judged: self.descent.judge(&light, &self.about) })
    }

    fn arrive(&mut self, place: &mut At) -> Result<(), AttitudeError> {
        self.normal(place).map(|_| ())
    }
}

/// A sample beside its model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Epoch of the sample, by number in [`Forward::moments`].
    pub moment: usize,
    /// Channel of the sample.
    pub channel: usize,
    /// Measured.
    pub rate: f64,
    /// Stated standard uncertainty.
    pub sigma: f64,
    /// Simulated.
    pub model: f64,
}
