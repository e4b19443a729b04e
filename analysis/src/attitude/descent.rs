//! From a trial down to the minimum near it: Levenberg-Marquardt with the light engine's own derivatives by attitude; what is proportional to a scale is solved for.

use super::compare::Compared;
use super::forward::{Eye, Forward};
use super::state::{Law, State, Unknowns};
use super::{AttitudeError, Scale};
use glam::{DQuat, DVec3};
use nalgebra::{DMatrix, DVector};
use std::sync::Arc;

/// Half of the step that turns of the body are differentiated by, radians.
const STEP: f64 = 1e-5;
/// Beyond so many standard deviations a residual counts linearly (Huber).
const HUBER: f64 = 3.0;

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

/// A trial's light at all epochs: channels × groups each, and its derivatives.
struct Light {
    model: Vec<f64>,
    slopes: Vec<f64>,
}

/// A trial's sum of squares.
struct Judged {
    cost: f64,
    scales: Vec<f64>,
    normal: DMatrix<f64>,
    pull: DVector<f64>,
}

impl<'a> Descent<'a> {
    /// The same with the light that a minimum has added.
    pub fn with(mut self, found: &'a Found) -> Self {
        self.held = found.held.as_ref().map(|h| h.as_slice());
        self
    }
}

impl Descent<'_> {
    fn groups(&self) -> usize {
        match self.scale {
            Scale::Materials if matches!(self.space, Space::Rates { .. }) => {
                self.materials.iter().max().map_or(1, |m| m + 1)
            }
            _ => 1,
        }
    }

    /// How many factors are solved for.
    fn factors(&self) -> usize {
        match (self.scale, self.space) {
            (Scale::None, _) => 0,
            (Scale::Grey, _) => 1,
            (Scale::Materials, Space::Rates { .. }) => self.groups(),
            // By logarithms the factors of materials are no sums: those of channels stand for them.
            (Scale::Channels | Scale::Materials, _) => self.forward.channels,
        }
    }

    /// The factor of a channel and group.
    fn factor(&self, channel: usize, group: usize) -> Option<usize> {
        match (self.scale, self.space) {
            (Scale::None, _) => None,
            (Scale::Grey, _) => Some(0),
            (Scale::Materials, Space::Rates { .. }) => Some(group),
            (Scale::Channels | Scale::Materials, _) => Some(channel),
        }
    }

    fn light(&self, eye: &mut Eye, state: &State, slopes: bool) -> Result<Light, AttitudeError> {
        let (channels, groups, p) = (self.forward.channels, self.groups(), self.unknowns.count());
        let cells = self.moments.len() * channels * groups;
        let mut light = Light {
            model: vec![0.0; cells],
            slopes: if slopes { vec![0.0; cells * p] } else { Vec::new() },
        };
        let mut ends: Vec<[State; 2]> = Vec::new();
        if slopes {
            for k in 0..p {
                let mut step = vec![0.0; p];
                step[k] = STEP;
                let up = self.law.moved(state, self.unknowns, &step)?;
                step[k] = -STEP;
                ends.push([self.law.moved(state, self.unknowns, &step)?, up]);
            }
        }
        let k = self.forward.weights;
        for (e, m) in self.moments.iter().enumerate() {
            let time_s = self.forward.moments[*m].time_s;
            let turned = self.law.at(state, time_s);
            let unit = self.forward.unit_rates(*m);
            let start = e * channels * groups;
            let of = |w: usize| if groups > 1 { self.materials[w] } else { 0 };
            let held = |c: usize| self.other(*m, c);
            if !slopes {
                let weights = eye.weights(*m, turned)?;
                for c in 0..channels {
                    for (w, weight) in weights.iter().enumerate() {
                        light.model[start + c * groups + of(w)] += unit[c * k + w] * weight;
                    }
                    if groups == 1 {
                        light.model[start + c] += held(c);
                    }
                }
                continue;
            }
            let turns: Vec<DVec3> = ends
                .iter()
                .map(|[a, b]| {
                    scaled_axis(self.law.at(a, time_s), self.law.at(b, time_s)) / (2.0 * STEP)
                })
                .collect();
            let (weights, by) = eye.weights_and_slopes(*m, turned)?;
            for c in 0..channels {
                for (w, weight) in weights.iter().enumerate() {
                    let cell = start + c * groups + of(w);
                    let unit = unit[c * k + w];
                    light.model[cell] += unit * weight;
                    let change = DVec3::new(by[w], by[k + w], by[2 * k + w]);
                    for (s, turn) in light.slopes[cell * p..(cell + 1) * p].iter_mut().zip(&turns) {
                        *s += unit * change.dot(*turn);
                    }
                }
                if groups == 1 {
                    light.model[start + c] += held(c);
                }
            }
        }
        Ok(light)
    }

    /// Light that is held and belongs to no group.
    fn held(&self, moment: usize, channel: usize) -> f64 {
        if self.groups() > 1 { self.other(moment, channel) } else { 0.0 }
    }

    fn other(&self, moment: usize, channel: usize) -> f64 {
        let at = moment * self.forward.channels + channel;
        self.held.and_then(|h| h.get(at)).copied().unwrap_or(0.0)
    }

    /// The sum of squares; `about` gives the rates that noise is a part of.
    fn judge(&self, light: &Light, about: &[f64]) -> Judged {
        let (channels, groups) = (self.forward.channels, self.groups());
        let steps = if light.slopes.is_empty() { 0 } else { self.unknowns.count() };
        let factors = self.factors();
        let mut scales = vec![1.0; factors];
        // Residual, its uncertainty, and its derivatives, of one sample; what is free of the brightness as it stands in `scales`.
        let sample = |e: usize, c: usize, scales: &[f64], row: &mut [f64]| -> Option<f64> {
            let m = self.moments[e];
            let i = m * channels + c;
            if !self.forward.rate[i].is_finite() {
                return None;
            }
            let cell = (e * channels + c) * groups;
            row.fill(0.0);
            match self.space {
                Space::Logarithms { spread } => {
                    let rate = light.model[cell];
                    let sigma = spread.hypot(self.compared.sigma(m, c));
                    let slope = self.compared.slope(m, c, rate) / sigma;
                    for (k, r) in row.iter_mut().take(steps).enumerate() {
                        *r = slope * light.slopes[cell * steps + k];
                    }
                    let mut model = self.compared.ln(m, c, rate);
                    if let Some(f) = self.factor(c, 0) {
                        row[steps + f] = 1.0 / sigma;
                        model += scales[f].ln();
                    }
                    Some((self.compared.measured(m, c) - model) / sigma)
                }
                Space::Rates { extra } => {
                    let sigma = self.forward.sigma[i].hypot(extra * about[e * channels + c]);
                    let mut left = self.forward.rate[i] - self.held(m, c);
                    for g in 0..groups {
                        let scale = self.factor(c, g).map_or(1.0, |f| scales[f]);
                        let rate = light.model[cell + g];
                        left -= scale * rate;
                        for (k, r) in row.iter_mut().take(steps).enumerate() {
                            *r += scale * light.slopes[(cell + g) * steps + k] / sigma;
                        }
                        if let Some(f) = self.factor(c, g) {
                            row[steps + f] += rate / sigma;
                        }
                    }
                    Some(left / sigma)
                }
            }
        };
        let size = steps + factors;
        let mut row = vec![0.0; size];
        // Factors first, twice: large residuals count less only once they are known.
        for _ in 0..if factors > 0 { 3 } else { 0 } {
            let mut a = DMatrix::<f64>::zeros(factors, factors);
            let mut b = DVector::<f64>::zeros(factors);
            for e in 0..self.moments.len() {
                for c in 0..channels {
                    let Some(r) = sample(e, c, &scales, &mut row) else { continue };
                    let w = weight(r);
                    for f in (0..factors).filter(|f| row[steps + f] != 0.0) {
                        b[f] += w * row[steps + f] * r;
                        for h in 0..factors {
                            a[(f, h)] += w * row[steps + f] * row[steps + h];
                        }
                    }
                }
            }
            for f in 0..factors {
                a[(f, f)] += 1e-12 * a[(f, f)] + f64::MIN_POSITIVE;
            }
            let Some(change) = a.cholesky().map(|c| c.solve(&b)) else { break };
            for (s, d) in scales.iter_mut().zip(change.iter()) {
                *s = match self.space {
                    Space::Logarithms { .. } => *s * d.clamp(-20.0, 20.0).exp(),
                    Space::Rates { .. } => (*s + d).max(0.0),
                };
            }
        }
        let mut judged = Judged {
            cost: 0.0,
            normal: DMatrix::zeros(size, size),
            pull: DVector::zeros(size),
            scales: Vec::new(),
        };
        for e in 0..self.moments.len() {
            for c in 0..channels {
                let Some(r) = sample(e, c, &scales, &mut row) else { continue };
                let size_r = r.abs();
                judged.cost += if size_r <= HUBER { r * r } else { HUBER * (2.0 * size_r - HUBER) };
                if steps == 0 {
                    continue;
                }
                let w = weight(r);
                for (i, a) in row.iter().enumerate().filter(|(_, a)| **a != 0.0) {
                    judged.pull[i] += w * a * r;
                    for (j, b) in row.iter().enumerate().take(i + 1) {
                        judged.normal[(i, j)] += w * a * b;
                    }
                }
            }
        }
        for i in 0..size {
            for j in 0..i {
                judged.normal[(j, i)] = judged.normal[(i, j)];
            }
        }
        judged.scales = scales;
        judged
    }

    /// The rates that noise is a part of: the trial's own, as bright as it fits.
    fn about(&self, light: &Light, scales: &[f64]) -> Vec<f64> {
        let (channels, groups) = (self.forward.channels, self.groups());
        let mut about = Vec::with_capacity(self.moments.len() * channels);
        for (e, m) in self.moments.iter().enumerate() {
            for c in 0..channels {
                let cell = (e * channels + c) * groups;
                let own = (0..groups).map(|g| {
                    let scale = self.factor(c, g).map_or(1.0, |f| scales[f]);
                    scale * light.model[cell + g]
                });
                about.push(own.sum::<f64>() + self.held(*m, c));
            }
        }
        about
    }

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

    fn measured(&self) -> Vec<f64> {
        let rates = |m: &usize| self.forward.rates(*m).iter().map(|r| r.max(0.0));
        self.moments.iter().flat_map(rates).collect()
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

/// How a residual counts.
fn weight(residual: f64) -> f64 {
    let size = residual.abs();
    if size <= HUBER { 1.0 } else { HUBER / size }
}

/// The rotation from one attitude to another that is near, as axis times angle.
fn scaled_axis(a: DQuat, b: DQuat) -> DVec3 {
    let q = b * a.conjugate();
    let half = DVec3::new(q.x, q.y, q.z) * q.w.signum();
    // 2 asin of the length; of small angles the length itself.
    let length = half.length();
    if length < 1e-4 { 2.0 * half } else { half * (2.0 * length.min(1.0).asin() / length) }
}
