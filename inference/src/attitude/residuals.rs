//! A trial's light against what was measured: residuals with their derivatives, and what is free of the brightness, which is solved for.

use super::descent::{Descent, Space};
use super::forward::Eye;
use super::state::State;
use super::{AttitudeError, Scale};
use glam::{DQuat, DVec3};
use nalgebra::{DMatrix, DVector};

/// Half of the step that turns of the body are differentiated by, radians.
const STEP: f64 = 1e-5;
/// Beyond so many standard deviations a residual counts linearly (Huber).
const HUBER: f64 = 3.0;

/// A trial's light at all epochs: channels × groups each, and its derivatives.
pub(super) struct Light {
    model: Vec<f64>,
    slopes: Vec<f64>,
}

/// A trial's sum of squares.
pub(super) struct Judged {
    pub cost: f64,
    pub scales: Vec<f64>,
    pub normal: DMatrix<f64>,
    pub pull: DVector<f64>,
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

    pub(super) fn light(
        &self,
        eye: &mut Eye,
        state: &State,
        slopes: bool,
    ) -> Result<Light, AttitudeError> {
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
            let held = |c: usize| self.held(*m, c);
            if !slopes {
                let weights = eye.weights(*m, turned)?;
                for c in 0..channels {
                    for (w, weight) in weights.iter().enumerate() {
                        light.model[start + c * groups + of(w)] += unit[c * k + w] * weight;
                    }
                    share(&mut light.model[start + c * groups..][..groups], held(c));
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
                share(&mut light.model[start + c * groups..][..groups], held(c));
            }
        }
        Ok(light)
    }

    fn held(&self, moment: usize, channel: usize) -> f64 {
        let at = moment * self.forward.channels + channel;
        self.held.and_then(|h| h.get(at)).copied().unwrap_or(0.0)
    }

    /// The sum of squares; `about` gives the rates that noise is a part of.
    pub(super) fn judge(&self, light: &Light, about: &[f64]) -> Judged {
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
                    let mut left = self.forward.rate[i];
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
    pub(super) fn about(&self, light: &Light, scales: &[f64]) -> Vec<f64> {
        let (channels, groups) = (self.forward.channels, self.groups());
        let mut about = Vec::with_capacity(self.moments.len() * channels);
        for e in 0..self.moments.len() {
            for c in 0..channels {
                let cell = (e * channels + c) * groups;
                let own = (0..groups).map(|g| {
                    let scale = self.factor(c, g).map_or(1.0, |f| scales[f]);
                    scale * light.model[cell + g]
                });
                about.push(own.sum::<f64>());
            }
        }
        about
    }

    pub(super) fn measured(&self) -> Vec<f64> {
        let rates = |m: &usize| self.forward.rates(*m).iter().map(|r| r.max(0.0));
        self.moments.iter().flat_map(rates).collect()
    }
}

/// Adds light that is held to that of the groups, as they share in what the trial has: it comes from the same surfaces.
fn share(groups: &mut [f64], held: f64) {
    let all: f64 = groups.iter().sum();
    let count = groups.len() as f64;
    for group in groups {
        *group += if all > 0.0 { *group / all * held } else { held / count };
    }
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
