//! The first look: all axes, all phases, all periods, at few epochs.
//!
//! For an axis the light of each epoch is simulated at [`PHASES`] phases, with that epoch's own geometry. Any period and phase is then a way through these simulations: at each
//! epoch the one whose phase is nearest. What a trial costs beyond the simulations that its axis needs anyway is a sum over epochs, so that no period is left out.
//!
//! Light is compared by its logarithm: a glint that the grid misses does not outweigh all others. The common brightness of an epoch, which a few degrees change much, counts
//! less than its colours, and no epoch more than `MOST`.

use super::compare::Compared;
use super::forward::Forward;
use super::state::{Law, State, Unknowns};
use super::{AttitudeError, Scale};
use glam::{DQuat, DVec3};
use std::f64::consts::TAU;

/// Phases of a turn.
pub const PHASES: usize = 48;
/// Error of the brightness on a grid that is a few degrees wide, ln.
const BRIGHTNESS: f64 = 0.35;
/// The same of the colours.
const COLOURS: f64 = 0.12;
/// The most that an epoch adds.
const MOST: f64 = 9.0;
/// Places that are kept of each axis: where the body turns about the bisector of Sun and station, nearly, many periods fit.
const KEPT: usize = 12;
/// Steps of the period: turns by which the ends of the data slip against one another.
const SLIP_TURNS: f64 = 0.06;

/// A place of the first look.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Place {
    /// Which axis, by number.
    pub axis: usize,
    /// Turns a second.
    pub turns_per_s: f64,
    /// Turn about the axis in the middle of the data, of a turn, from [`Law::upright`].
    pub phase: f64,
    /// Mean over the epochs of what they add.
    pub cost: f64,
}

/// Inputs of the first look at the sky, the same for all axes.
pub struct Look<'a> {
    /// The light.
    pub forward: &'a Forward,
    /// How it is compared.
    pub compared: &'a Compared,
    /// The spin.
    pub law: &'a Law,
    /// Unknown numbers of the spin.
    pub unknowns: Unknowns,
    /// The epochs.
    pub moments: &'a [usize],
    /// Turns a second, increasing.
    pub rates: &'a [f64],
    /// The known phase, radians, where it is known.
    pub phase_rad: f64,
    /// Free factors of the brightness.
    pub scale: Scale,
}

/// Turns a second from the first to the last bound, so that none lies more than half a step of `SLIP_TURNS` away: over the data's span, or the time to where a known phase counts.
pub fn rates(low: f64, high: f64, law: &Law, unknowns: Unknowns) -> Vec<f64> {
    let reach = if unknowns.phase { 0.0 } else { (law.epoch_s - law.middle_s).abs() };
    let span = (2.0 * law.half_span_s).max(law.half_span_s + reach);
    let count = ((high - low) * span / SLIP_TURNS).ceil().max(0.0) as usize + 1;
    if count == 1 {
        return vec![0.5 * (low + high)];
    }
    (0..count).map(|i| low + (high - low) * i as f64 / (count - 1) as f64).collect()
}

impl Place {
    /// The trial of a place on this axis.
    ///
    /// # Errors
    /// An axis that is none.
    pub fn state(&self, law: &Law, axis: DVec3) -> Result<State, AttitudeError> {
        let turn = DQuat::from_axis_angle(axis.normalize(), TAU * self.phase);
        let at_zero = (turn * law.upright(axis)?).normalize();
        Ok(State { at_zero, turns_per_s: self.turns_per_s })
    }
}

impl Look<'_> {
    /// The best places of an axis.
    ///
    /// # Errors
    /// An axis that is none.
    pub fn axis(&self, number: usize, axis: DVec3) -> Result<Vec<Place>, AttitudeError> {
        let rows = self.table(axis)?;
        let n = PHASES;
        let epoch_turns = self.phase_rad / TAU;
        let times: Vec<f64> = self
            .moments
            .iter()
            .map(|m| self.forward.moments[*m].time_s - self.law.middle_s)
            .collect();
        let mut costs: Vec<(f32, usize)> = Vec::with_capacity(self.rates.len());
        let mut sum = [0.0_f32; PHASES];
        for rate in self.rates {
            sum.fill(0.0);
            for (row, t) in rows.chunks_exact(2 * n).zip(&times) {
                let turns = rate * t;
                let shift = ((turns - turns.floor()) * n as f64).round() as usize % n;
                for (s, d) in sum.iter_mut().zip(&row[shift..shift + n]) {
                    *s += d;
                }
            }
            let best = if self.unknowns.phase {
                (0..n).min_by(|a, b| sum[*a].total_cmp(&sum[*b])).unwrap_or(0)
            } else {
                let turns = epoch_turns - rate * (self.law.epoch_s - self.law.middle_s);
                ((turns - turns.floor()) * n as f64).round() as usize % n
            };
            costs.push((sum[best], best));
        }
        let at = |i: usize| costs[i].0;
        let mut minima: Vec<usize> = (0..costs.len())
            .filter(|&i| {
                (i == 0 || at(i) < at(i - 1)) && (i + 1 == costs.len() || at(i) <= at(i + 1))
            })
            .collect();
        minima.sort_by(|a, b| at(*a).total_cmp(&at(*b)).then(a.cmp(b)));
        minima.truncate(KEPT);
        let place = |i: usize| Place {
            axis: number,
            turns_per_s: self.rates[i],
            phase: costs[i].1 as f64 / n as f64,
            cost: f64::from(costs[i].0) / self.moments.len().max(1) as f64,
        };
        Ok(minima.into_iter().map(place).collect())
    }

    /// Computes the cost that each epoch adds at each phase, twice over: epochs × 2 phases.
    fn table(&self, axis: DVec3) -> Result<Vec<f32>, AttitudeError> {
        let (n, channels) = (PHASES, self.forward.channels);
        let upright = self.law.upright(axis)?;
        let axis = axis.normalize();
        let mut eye = self.forward.eye();
        let mut model = vec![0.0; channels];
        // Measured less simulated, ln; NaN where nothing was measured.
        let mut off = Vec::with_capacity(self.moments.len() * n * channels);
        for m in self.moments {
            for k in 0..n {
                let turn = DQuat::from_axis_angle(axis, TAU * k as f64 / n as f64);
                eye.rates(*m, turn * upright, &mut model)?;
                for (c, rate) in model.iter().enumerate() {
                    off.push(self.compared.measured(*m, c) - self.compared.ln(*m, c, *rate));
                }
            }
        }
        self.free_scales(&mut off);
        let mut rows = vec![0.0_f32; self.moments.len() * 2 * n];
        for (e, m) in self.moments.iter().enumerate() {
            for k in 0..n {
                let own = &off[(e * n + k) * channels..][..channels];
                let cost = self.cost(*m, own).min(MOST) as f32;
                rows[e * 2 * n + k] = cost;
                rows[e * 2 * n + n + k] = cost;
            }
        }
        Ok(rows)
    }

    fn cost(&self, moment: usize, off: &[f64]) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        let good = |v: &&f64| v.is_finite();
        for v in off.iter().filter(good) {
            sum += v;
            count += 1.0;
        }
        if count == 0.0 {
            return 0.0;
        }
        let mean = sum / count;
        // What is noise alone says little.
        let noise = |c: usize| self.compared.sigma(moment, c).powi(2);
        let (mut colours, mut all) = (0.0, 0.0);
        for (c, v) in off.iter().enumerate().filter(|(_, v)| v.is_finite()) {
            colours += (v - mean).powi(2) / (COLOURS * COLOURS + noise(c));
            all += noise(c);
        }
        mean * mean / (BRIGHTNESS * BRIGHTNESS + all / (count * count)) + colours
    }

    /// Takes out what a free scale could: the mean over all epochs and phases, of each channel or of all.
    fn free_scales(&self, off: &mut [f64]) {
        let channels = self.forward.channels;
        if self.scale == Scale::None {
            return;
        }
        let mut mean = vec![(0.0, 0.0); channels];
        for row in off.chunks_exact(channels) {
            for (v, (sum, count)) in row.iter().zip(&mut mean).filter(|(v, _)| v.is_finite()) {
                *sum += v;
                *count += 1.0;
            }
        }
        if self.scale == Scale::Grey {
            let all = mean.iter().fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
            mean.fill(all);
        }
        for row in off.chunks_exact_mut(channels) {
            for (v, (sum, count)) in row.iter_mut().zip(&mean).filter(|(_, m)| m.1 > 0.0) {
                *v -= sum / count;
            }
        }
    }
}
