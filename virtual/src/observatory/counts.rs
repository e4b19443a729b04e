//! Counts of a bin without its photons: drawn from the law of the detector, where a whole night would be too many events.
//!
//! Counts whose gaps are independent and alike, of mean μ and variance σ², are a renewal process: over a time T long against μ
//! their number has the mean T/μ and the variance T σ²/μ³, and is normally distributed (Cox, *Renewal theory*, 1962, §3.3). What is needed is the
//! distribution of a gap, from S(t) = P(no count within t of the last one):
//!
//! - **non-paralysable**, with u = t − τ and q = p e^(−τ/δ) the probability that a trapped charge outlives the dead time:
//!   S = e^(−nu) (1 − q (1 − e^(−u/δ))), so that E u = (1−q)/n + q/(n+1/δ) and E u² = 2(1−q)/n² + 2q/(n+1/δ)². Without
//!   afterpulses μ = τ + 1/n and σ² = 1/n²: the mean n/(1+nτ) and the variance n/(1+nτ)³ per second;
//! - **exponential recovery**: the same with the hazard n(1−e^(−u/r)): S = exp(−n(u − r(1−e^(−u/r)))) times the probability that
//!   no charge was taken, integrated numerically: E u = ∫S du, E u² = 2∫u S du;
//! - **many pixels**: the sum of as many independent non-paralysable detectors, each with its part of the light;
//! - **paralysable**: no renewal process of its counts that would be simple, but a count at t wants no arrival in the τ before it: the
//!   density of pairs at a lag beyond τ is m², within τ nothing, so that the mean is m = n e^(−nτ) and the variance m − 2τm² per second.
//!   With afterpulses there is no such form: those counts are drawn photon by photon;
//! - **comparator**: the same of the pulses that all pixels fire together, each of which recovers exponentially.

use super::events::{Arrival, DeadTime, Detector, PS, Running, arrivals};
use super::random::{Purpose, stream};
use rand::RngExt as _;
use rand_distr::{Distribution as _, StandardNormal};
use std::ops::Range;

/// With fewer arrivals than this in a bin they are played photon by photon: there a normal distribution is no longer good (its
/// skewness is off by 1/√256 at most), and it costs little.
const FEW: f64 = 256.0;

/// Nodes and weights of five-point Gauss–Legendre quadrature on [−1, 1].
pub(crate) const GAUSS_5: [(f64, f64); 5] = [
    (-0.906_179_845_938_664, 0.236_926_885_056_189_1),
    (-0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
    (0.0, 0.568_888_888_888_888_9),
    (0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
    (0.906_179_845_938_664, 0.236_926_885_056_189_1),
];

/// Mean and variance of counts, per second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moments {
    /// Mean, Hz.
    pub mean_hz: f64,
    /// Variance, Hz.
    pub variance_hz: f64,
}

impl Moments {
    fn of_gap(mean_s: f64, variance_s2: f64) -> Self {
        Self { mean_hz: 1.0 / mean_s, variance_hz: variance_s2 / mean_s.powi(3) }
    }
}

impl Detector {
    /// Mean and variance of the counts in steady light of `rate_hz`, dark events added, per second of a time that is long
    /// against the dead time. `None` for a paralysable detector with afterpulses, which has no such form.
    ///
    /// ```
    /// use sunglint_virtual::observatory::events::Detector;
    ///
    /// // Poisson's law: mean and variance are equal.
    /// let moments = Detector::IDEAL.moments(1e4).ok_or("no closed form")?;
    /// assert!((moments.mean_hz - 1e4).abs() < 1e-6 && (moments.variance_hz - 1e4).abs() < 1e-6);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn moments(&self, rate_hz: f64) -> Option<Moments> {
        let arriving_hz = rate_hz.max(0.0) + self.dark_rate_hz;
        if arriving_hz <= 0.0 {
            return Some(Moments { mean_hz: 0.0, variance_hz: 0.0 });
        }
        Some(match self.dead_time {
            DeadTime::None => self.renewal(arriving_hz, 0.0),
            DeadTime::NonParalysable { dead_time_s } => self.renewal(arriving_hz, dead_time_s),
            DeadTime::MultiPixel { pixels, dead_time_s } => {
                let pixels = f64::from(pixels.max(1));
                let one = self.renewal(arriving_hz / pixels, dead_time_s);
                Moments { mean_hz: pixels * one.mean_hz, variance_hz: pixels * one.variance_hz }
            }
            DeadTime::ExponentialRecovery { dead_time_s, recovery_s } => {
                self.recovering(arriving_hz, dead_time_s, recovery_s)
            }
            DeadTime::Comparator { pixels, recovery_s, pulse_s } => {
                if self.afterpulsing.is_some_and(|trap| trap.probability > 0.0) {
                    return None;
                }
                let pixels = f64::from(pixels.max(1));
                let one = self.recovering(arriving_hz / pixels, 0.0, recovery_s);
                // The pulses of many pixels are as random as photons but for what one pixel's own spacing adds.
                let fired_hz = pixels * one.mean_hz;
                let mean_hz = fired_hz * (-fired_hz * pulse_s).exp();
                let spaced = one.variance_hz / one.mean_hz;
                Moments { mean_hz, variance_hz: spaced * mean_hz * (1.0 - 2.0 * pulse_s * mean_hz) }
            }
            DeadTime::Paralysable { dead_time_s } => {
                if self.afterpulsing.is_some_and(|trap| trap.probability > 0.0) {
                    return None;
                }
                let mean_hz = arriving_hz * (-arriving_hz * dead_time_s).exp();
                let variance_hz = mean_hz - 2.0 * dead_time_s * mean_hz * mean_hz;
                Moments { mean_hz, variance_hz }
            }
        })
    }

    /// The probability that a charge is trapped and outlives the dead time, and the rate at which it comes, Hz.
    fn trap(&self, dead_time_s: f64) -> (f64, f64) {
        self.afterpulsing.map_or((0.0, 0.0), |trap| {
            let left = (-dead_time_s / trap.time_constant_s).exp();
            (trap.probability * left, 1.0 / trap.time_constant_s)
        })
    }

    fn renewal(&self, n: f64, dead_time_s: f64) -> Moments {
        let (q, freed_hz) = self.trap(dead_time_s);
        let first = (1.0 - q) / n + q / (n + freed_hz);
        let second = 2.0 * (1.0 - q) / n.powi(2) + 2.0 * q / (n + freed_hz).powi(2);
        Moments::of_gap(dead_time_s + first, second - first * first)
    }

    fn recovering(&self, n: f64, dead_time_s: f64, recovery_s: f64) -> Moments {
        const PANELS: u32 = 32;
        let (q, freed_hz) = self.trap(dead_time_s);
        let exponent = |u: f64| n * (u + recovery_s * (-u / recovery_s).exp_m1());
        // Where the exponent is 40: between u = 40/n and 40/n + r.
        let (mut low, mut high) = (40.0 / n, 40.0 / n + recovery_s);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if exponent(middle) < 40.0 { low = middle } else { high = middle }
        }
        let both_hz = freed_hz + 1.0 / recovery_s;
        let survival = |u: f64| {
            // The charge comes at v with density f e^(−fv), and is taken with probability 1 − e^(−v/r).
            let taken = -(-freed_hz * u).exp_m1() + freed_hz / both_hz * (-both_hz * u).exp_m1();
            (-exponent(u)).exp() * (1.0 - q * taken)
        };
        // Panels grow as the cube of their number: the recovery may be much shorter than the gaps.
        let edge = |panel: u32| high * (f64::from(panel) / f64::from(PANELS)).powi(3);
        let (mut first, mut second) = (0.0, 0.0);
        for panel in 0..PANELS {
            let (begin, half) = (edge(panel), 0.5 * (edge(panel + 1) - edge(panel)));
            for (node, weight) in GAUSS_5 {
                let u = begin + half * (1.0 + node);
                let part = half * weight * survival(u);
                first += part;
                second += 2.0 * u * part;
            }
        }
        Moments::of_gap(dead_time_s + first, second - first * first)
    }

    /// The counts of bin `number`, within `span_ps`, of light whose rate is `rates_hz` in steps that fill the bin evenly (at least
    /// one). Bins have streams of their own: what a bin holds does not depend on which others were asked for. The
    /// dead time that reaches over from the bin before is in the mean, not as a link between the two counts.
    pub fn counts(&self, seed: u64, number: i64, span_ps: Range<i64>, rates_hz: &[f64]) -> u64 {
        let step_s = (span_ps.end - span_ps.start) as f64 / PS / rates_hz.len().max(1) as f64;
        let (mut expected, mut mean, mut variance) = (0.0, 0.0, 0.0);
        let mut lawless = false;
        for rate_hz in rates_hz {
            expected += (rate_hz.max(0.0) + self.dark_rate_hz) * step_s;
            match self.moments(*rate_hz) {
                Some(moments) => {
                    mean += moments.mean_hz * step_s;
                    variance += moments.variance_hz * step_s;
                }
                None => lawless = true,
            }
        }
        let mut random = stream(seed, Purpose::Bin, number as u64);
        if lawless || expected < FEW {
            return self.played(&mut random, span_ps, rates_hz);
        }
        // Rounded up or down by chance, which keeps the mean and adds a variance of 1/6.
        let z: f64 = StandardNormal.sample(&mut random);
        let dither: f64 = random.random();
        let drawn = (mean + (variance - 1.0 / 6.0).max(0.0).sqrt() * z + dither).floor();
        drawn.max(0.0) as u64
    }

    /// The same, photon by photon.
    fn played(
        &self,
        random: &mut super::random::Random,
        span_ps: Range<i64>,
        rates_hz: &[f64],
    ) -> u64 {
        let (mut running, mut seen, mut counts) = (Running::new(*self), Vec::new(), Vec::new());
        let begin = span_ps.start;
        let light = |rate_hz: f64| rate_hz.max(0.0) + self.dark_rate_hz;
        if let Some(first) = rates_hz.first() {
            arrivals(random, light(*first), begin - self.warm_up_ps()..begin, &mut seen);
        }
        let steps = rates_hz.len() as i64;
        for (i, rate_hz) in (0..).zip(rates_hz) {
            let edge = |i: i64| begin + (span_ps.end - begin) * i / steps;
            arrivals(random, light(*rate_hz), edge(i)..edge(i + 1), &mut seen);
        }
        let take = |arrival: &Arrival| running.take(*arrival, &mut counts);
        seen.iter().for_each(take);
        running.free_charges(span_ps.end, &mut counts);
        counts.iter().filter(|time| **time >= begin).count() as u64
    }
}
