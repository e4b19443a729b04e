//! From the period that is seen to the period of the spin.
//!
//! The light that is seen repeats when the body shows the same face to the bisector of Sun and observer (the phase-angle bisector). While the bisector moves by dφ about the spin axis,
//! the body turns by a whole turn ± dφ: 1/P_sidereal = 1/P_synodic ± φ̇/2π. The bisector's angular speed bounds φ̇ as long as it keeps away from the axis: about
//! an axis from which it stands β away, φ̇ ≤ speed/sin β.
//!
//! Along a pass the bisector does not turn evenly, and what repeats with the body does not repeat evenly in time: its phase at t is t/P_sidereal − λ(t)/2π with the bisector's
//! longitude λ about the axis ([`Bisectors::turned`]).

use crate::series::Series;
use glam::DVec3;
use std::f64::consts::TAU;

/// Range of sidereal periods that the geometry of a pass allows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sidereal {
    /// The fastest the bisector moves, degrees per second.
    pub fastest_deg_s: f64,
    /// The angle from its first to its last direction, degrees.
    pub moved_deg: f64,
    /// The shortest and the longest period that the spin may have, s, for an axis across the bisector; the longest is infinite where the bisector turns as
    /// fast as the body.
    pub from_to_s: (f64, f64),
}

/// The directions of the bisector of Sun and observer along a pass.
#[derive(Debug, Clone, PartialEq)]
pub struct Bisectors {
    time_s: Vec<f64>,
    direction: Vec<DVec3>,
}

/// The angle between two directions, radians, exact near 0.
fn angle(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b))
}

impl Bisectors {
    /// From moments (s, increasing) and the unit vectors from the target to Sun and observer in a frame that does not turn (GCRS). `None` with fewer than two
    /// moments, moments that do not increase, or where Sun and observer stand opposite one another.
    pub fn new(moments: &[(f64, DVec3, DVec3)]) -> Option<Self> {
        if moments.len() < 2 || !moments.windows(2).all(|w| w[1].0 > w[0].0) {
            return None;
        }
        let direction = moments
            .iter()
            .map(|(_, sun, observer)| {
                let sum = *sun + *observer;
                // Opposite but for rounding: no direction is left.
                (sum.length() > 1e-9).then(|| sum.normalize())
            })
            .collect::<Option<Vec<_>>>()?;
        Some(Self { time_s: moments.iter().map(|m| m.0).collect(), direction })
    }

    /// The bounds of the spin's period for a period that is seen, s.
    pub fn bounds(&self, period_s: f64) -> Sidereal {
        let steps = self.time_s.windows(2).zip(self.direction.windows(2));
        let fastest = steps.map(|(t, d)| angle(d[0], d[1]) / (t[1] - t[0])).fold(0.0, f64::max);
        let last = self.direction.len() - 1;
        let frequency = 1.0 / period_s;
        let by = fastest / TAU;
        let longest = if frequency > by { 1.0 / (frequency - by) } else { f64::INFINITY };
        Sidereal {
            fastest_deg_s: fastest.to_degrees(),
            moved_deg: angle(self.direction[0], self.direction[last]).to_degrees(),
            from_to_s: (1.0 / (frequency + by), longest),
        }
    }

    /// The way of the bisector between two moments, degrees.
    pub fn way_deg(&self, from_s: f64, to_s: f64) -> f64 {
        let inside = |t: &[f64]| t[1] > from_s && t[0] < to_s;
        let steps = self.time_s.windows(2).zip(self.direction.windows(2));
        steps.filter(|(t, _)| inside(t)).map(|(_, d)| angle(d[0], d[1])).sum::<f64>().to_degrees()
    }

    /// The bisector's turn about an axis, right-handed. `None` for an axis of no length, or one that the bisector meets.
    pub fn turned(&self, axis: DVec3) -> Option<Turn> {
        let axis = axis.try_normalize()?;
        let first = axis.any_orthonormal_vector();
        let second = axis.cross(first);
        let mut turns = Vec::with_capacity(self.direction.len());
        let (mut before, mut sum) = (None, 0.0);
        for d in &self.direction {
            let (x, y) = (d.dot(first), d.dot(second));
            if x.hypot(y) < 1e-9 {
                return None;
            }
            let longitude = y.atan2(x) / TAU;
            let step = longitude - before.unwrap_or(longitude);
            // The shorter way around.
            sum += step - step.round();
            before = Some(longitude);
            turns.push(sum);
        }
        Some(Turn { time_s: self.time_s.clone(), turns })
    }
}

/// A longitude along time, in turns, which runs on over whole turns.
#[derive(Debug, Clone, PartialEq)]
pub struct Turn {
    time_s: Vec<f64>,
    turns: Vec<f64>,
}

impl Turn {
    /// At a moment: on lines between its own, held beyond them.
    pub fn at(&self, time_s: f64) -> f64 {
        let next = self.time_s.partition_point(|t| *t < time_s);
        let (a, b) = (next.saturating_sub(1), next.min(self.time_s.len() - 1));
        let (from, to) = (self.time_s[a], self.time_s[b]);
        let part = if to > from { ((time_s - from) / (to - from)).clamp(0.0, 1.0) } else { 0.0 };
        self.turns[a] + part * (self.turns[b] - self.turns[a])
    }

    /// The even part, turns per second, and what bends about it.
    pub fn split(&self) -> (f64, Self) {
        let n = self.time_s.len() as f64;
        let mean = |of: &[f64]| of.iter().sum::<f64>() / n;
        let (t, y) = (mean(&self.time_s), mean(&self.turns));
        let pairs = || self.time_s.iter().zip(&self.turns).map(|(x, v)| (x - t, v - y));
        let square: f64 = pairs().map(|(x, _)| x * x).sum();
        let slope_hz = pairs().map(|(x, v)| x * v).sum::<f64>() / square;
        let turns = pairs().map(|(x, v)| v - slope_hz * x).collect();
        (slope_hz, Self { time_s: self.time_s.clone(), turns })
    }

    /// The largest of its values, either way.
    pub fn most(&self) -> f64 {
        self.turns.iter().fold(0.0, |most, b| most.max(b.abs()))
    }

    /// A series on the clock of a body that turns `frequency_hz` times a second: its times less what this turn takes. `None` where that clock runs backwards.
    pub fn clocked(&self, series: &Series, frequency_hz: f64) -> Option<Series> {
        let time = series.time_s.iter().map(|t| t - self.at(*t) / frequency_hz);
        let time_s: Vec<f64> = time.collect();
        let forward = time_s.windows(2).all(|w| w[1] >= w[0]);
        forward.then(|| Series { time_s, ..series.clone() })
    }
}
