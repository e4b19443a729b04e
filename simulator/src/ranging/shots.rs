//! Single detections along a pass: every shot of a laser, drawn.
//!
//! The photons that are detected of a shot are a Poisson process in time of the mean n̄ F(t): F is the profile of depths, there and back, through the pulse. The first of it comes where n̄ F reaches a number
//! from an exponential distribution of mean 1, or never. Corner cubes under speckle have a mean that differs from shot to shot, by a gamma distribution of µ cells. Counts of sunlight and dark counts are a Poisson process
//! from the opening of the gate. The counter stops at whichever is first.

use super::{Profile, Returns};
use crate::pass::{PassError, Simulation, TwoWay};
use rand::{RngExt as _, SeedableRng as _};
use rand_distr::{Distribution as _, Exp1, Gamma, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;
use rayon::prelude::*;
use std::f64::consts::{PI, SQRT_2};
use std::ops::Range;
use sunglint_formats::time::tai_nanoseconds;
use sunglint_radiometry::constants::LIGHT_M_PER_S;
use sunglint_radiometry::station::{Detector, Ranging};

/// Shots and detections of a pass at most.
const MOST_SHOTS: f64 = 1e8;
const MOST_DETECTIONS: usize = 5_000_000;
/// Seconds between ways of light that are computed; between them they are interpolated at eighth order, to 1e-7 m for a low orbit.
const NODE_S: f64 = 1.0;
/// Ways of light that an interpolation takes.
const ORDER: usize = 8;
/// A full width at half of the most is so many standard deviations of a normal distribution.
const FWHM: f64 = 2.354_820_045_030_949;
/// Steps of the table of arrivals at least: between them it is a line.
const FINEST: f64 = 1024.0;
/// A pulse reaches so many standard deviations to either side.
const REACH: f64 = 6.0;

/// Why there are no shots.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ShotsError {
    /// Times that do not increase, or fewer than two.
    #[error(
        "shots are drawn between samples of one pass in the order of time, two at least: give [times] from, to and step_s"
    )]
    Times,
    /// Samples of several targets or sites.
    #[error("shots are drawn along one orbit from one site, and [times] table has others")]
    Observations,
    /// Too many shots.
    #[error(
        "{shots:.3e} shots are more than {MOST_SHOTS:.0e}: shorten the pass with --from and --to"
    )]
    TooManyShots {
        /// Number of shots.
        shots: f64,
    },
    /// Too many detections.
    #[error(
        "more than {MOST_DETECTIONS} detections: shorten the pass with --from and --to, or the gate (gate_ns of [laser.ranging])"
    )]
    TooManyDetections,
    /// No way of light.
    #[error(transparent)]
    Pass(#[from] PassError),
}

/// A recorded shot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detection {
    /// When the pulse left, s after the first of the pass's times.
    pub sent_s: f64,
    /// Recorded time of flight, s.
    pub flight_s: f64,
    /// Time of flight by the body's origin, s.
    pub predicted_s: f64,
    /// Whether it is a count of sunlight or darkness.
    pub is_noise: bool,
}

/// All shots of a laser along a pass.
#[derive(Debug, Clone, PartialEq)]
pub struct Shots {
    /// Recorded shots, in the order of time.
    pub detections: Vec<Detection>,
    /// Time between shots, s.
    pub period_s: f64,
    /// When the first shot left, s after the first of the pass's times.
    pub first_s: f64,
    /// Numbers of the shots that were fired: those while the target is seen.
    pub fired: Vec<Range<u64>>,
}

/// When photons of one shot arrive: the share of them that is there, against time.
#[derive(Debug, Clone, PartialEq)]
pub struct Arrivals {
    from_s: f64,
    step_s: f64,
    share: Vec<f64>,
}

impl Arrivals {
    /// Arrivals of a profile's photons through a pulse, a normal distribution of `pulse_s` (full width at half of the most); `None` of no photons. Each bin is even within.
    pub fn new(profile: &Profile, pulse_s: f64) -> Option<Self> {
        let total: f64 = profile.photons.iter().sum();
        if !(total.is_finite() && total > 0.0) {
            return None;
        }
        let bins = profile.bins;
        let both = 2.0 / LIGHT_M_PER_S;
        let sigma = pulse_s / FWHM;
        let (first, width) = (both * bins.from_m, both * bins.step_m);
        let from_s = first - REACH * sigma;
        let to_s = first + bins.count as f64 * width + REACH * sigma;
        // Fine enough for the bins, for the pulse, and for a body of few bins.
        let fine = (0.25 * width.max(sigma)).min((to_s - from_s) / FINEST);
        let count = ((to_s - from_s) / fine).ceil().clamp(1.0, 8192.0) as usize;
        let step_s = (to_s - from_s) / count as f64;
        // The integral of the normal distribution's own integral.
        let ramp = |x: f64| {
            if x <= -8.0 * sigma {
                0.0
            } else if x >= 8.0 * sigma {
                x
            } else {
                let z = x / sigma;
                0.5 * x * (1.0 + libm::erf(z / SQRT_2))
                    + sigma * (-0.5 * z * z).exp() / (2.0 * PI).sqrt()
            }
        };
        let at = |t: f64| {
            let edge = |k: usize| ramp(t - (first + k as f64 * width));
            let mut sum = 0.0;
            for (k, photons) in profile.photons.iter().enumerate().filter(|(_, p)| **p > 0.0) {
                sum += photons * (edge(k) - edge(k + 1));
            }
            sum / (total * width)
        };
        let mut share: Vec<f64> = (0..=count).map(|i| at(from_s + i as f64 * step_s)).collect();
        let last = *share.last()?;
        let mut most = 0.0_f64;
        for value in &mut share {
            most = most.max(*value / last);
            *value = most;
        }
        share[0] = 0.0;
        Some(Self { from_s, step_s, share })
    }

    /// The time after the light from the body's origin at which a share (0 to 1) of the photons is there, s.
    pub fn quantile(&self, share: f64) -> f64 {
        let after = self.share.partition_point(|s| *s < share).clamp(1, self.share.len() - 1);
        let (low, high) = (self.share[after - 1], self.share[after]);
        let within = if high > low { (share - low) / (high - low) } else { 0.5 };
        self.from_s + self.step_s * ((after - 1) as f64 + within.clamp(0.0, 1.0))
    }
}

/// Times of flight between those that were computed.
struct Ways(Vec<TwoWay>);

impl Ways {
    fn at(&self, sent_s: f64) -> f64 {
        let all = &self.0;
        let order = ORDER.min(all.len());
        let after = all.partition_point(|w| w.sent_s < sent_s);
        let from = after.saturating_sub(order / 2).min(all.len() - order);
        let near = &all[from..from + order];
        let mut sum = 0.0;
        for (i, one) in near.iter().enumerate() {
            let mut weight = 1.0;
            for (j, other) in near.iter().enumerate() {
                if i != j {
                    weight *= (sent_s - other.sent_s) / (one.sent_s - other.sent_s);
                }
            }
            sum += weight * one.flight_s;
        }
        sum
    }
}

/// A sample, ready to be drawn from.
struct Drawn {
    arrivals: Arrivals,
    scattered: f64,
    retro: f64,
    /// Speckle of the cubes' light; `None` where nothing is speckled.
    gain: Option<Gamma<f64>>,
}

/// The receiver of a shot: [`Receiver::shot`] is the recorded time against the prediction, s, and whether that is noise.
struct Receiver {
    gate_s: f64,
    jitter_s: f64,
}

impl Receiver {
    fn shot(
        &self,
        drawn: Option<&Drawn>,
        noise_hz: f64,
        rng: &mut Xoshiro256PlusPlus,
    ) -> Option<(f64, bool)> {
        let signal = drawn.and_then(|drawn| {
            let gain = drawn.gain.map_or(1.0, |gain| gain.sample(rng));
            let mean = drawn.scattered + gain * drawn.retro;
            let wait: f64 = Exp1.sample(rng);
            (wait < mean).then(|| drawn.arrivals.quantile(wait / mean))
        });
        let opens = -0.5 * self.gate_s;
        let dark = (noise_hz > 0.0).then(|| {
            let wait: f64 = Exp1.sample(rng);
            opens + wait / noise_hz
        });
        // What comes before the gate opens is not seen.
        let signal = signal.filter(|t| *t >= opens).unwrap_or(f64::INFINITY);
        let dark = dark.unwrap_or(f64::INFINITY);
        let first = signal.min(dark);
        if first > -opens {
            return None;
        }
        let jitter: f64 = StandardNormal.sample(rng);
        Some((first + self.jitter_s * jitter, dark < signal))
    }
}

impl Shots {
    /// Draws all shots of a laser along a simulated pass. Between two samples, each shot is drawn from one of them at random, by how near it is.
    ///
    /// # Errors
    /// Times or a target that are not one pass; more shots or detections than make sense; no way of light.
    pub fn draw(
        simulation: &Simulation<'_>,
        returns: &Returns<'_>,
        ranging: &Ranging,
        seed: u64,
    ) -> Result<Self, ShotsError> {
        let pass = simulation.pass;
        if !pass.observations.is_empty() {
            return Err(ShotsError::Observations);
        }
        let first_ns = tai_nanoseconds(pass.times[0]);
        let times: Vec<f64> =
            pass.times.iter().map(|t| (tai_nanoseconds(*t) - first_ns) as f64 * 1e-9).collect();
        if times.len() < 2 || times.windows(2).any(|p| p[1] <= p[0]) {
            return Err(ShotsError::Times);
        }
        let period_s = 1.0 / returns.laser.repetition_rate_hz;
        let span_s = times[times.len() - 1];
        let most = span_s / period_s;
        if most > MOST_SHOTS {
            return Err(ShotsError::TooManyShots { shots: most });
        }
        let nodes = ((span_s / NODE_S).ceil() as usize).max(ORDER) + 1;
        let ways = Ways(pass.two_ways(returns.laser.site.as_ref(), nodes)?);
        let drawn = Self::samples(returns);
        let dark_hz = match &pass.station.channels[returns.channel].detector {
            Detector::Counter(counter) => counter.dark_rate_hz,
            _ => 0.0,
        };
        let noise_hz = |i: usize| {
            dark_hz + Some(returns.passive_hz[i]).filter(|r| r.is_finite()).unwrap_or(0.0)
        };
        let receiver = Receiver { gate_s: ranging.gate_s, jitter_s: ranging.jitter_s };
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let (first_s, last_s) = (ways.0[0].sent_s, ways.0[ways.0.len() - 1].sent_s);
        let mut shots = Self { detections: Vec::new(), period_s, first_s, fired: Vec::new() };
        let seen = |i: usize| returns.photons[i].is_finite();
        let mut sample = 0;
        for number in 0..=((last_s - first_s) / period_s).floor() as u64 {
            let sent_s = first_s + number as f64 * period_s;
            // The light's way changes by less than 1e-4 of the time.
            let arrives = sent_s + ways.0[0].flight_s.max(0.0);
            while sample + 2 < times.len() && times[sample + 1] <= arrives {
                sample += 1;
            }
            if !(seen(sample) && seen(sample + 1)) {
                continue;
            }
            match shots.fired.last_mut() {
                Some(run) if run.end == number => run.end = number + 1,
                _ => shots.fired.push(number..number + 1),
            }
            let share = (arrives - times[sample]) / (times[sample + 1] - times[sample]);
            let of = sample + usize::from(rng.random::<f64>() < share);
            let Some((after_s, is_noise)) =
                receiver.shot(drawn[of].as_ref(), noise_hz(of), &mut rng)
            else {
                continue;
            };
            if shots.detections.len() == MOST_DETECTIONS {
                return Err(ShotsError::TooManyDetections);
            }
            let predicted_s = ways.at(sent_s);
            let flight_s = predicted_s + after_s;
            shots.detections.push(Detection { sent_s, flight_s, predicted_s, is_noise });
        }
        Ok(shots)
    }

    fn samples(returns: &Returns<'_>) -> Vec<Option<Drawn>> {
        let one = |i: usize| {
            let profile = returns.profiles[i].as_ref()?;
            let arrivals = Arrivals::new(profile, returns.laser.pulse_length_s)?;
            let cells = returns.speckles[i];
            let speckled = profile.retro > 0.0 && cells.is_finite() && cells > 0.0;
            let gain = if speckled { Gamma::new(cells, 1.0 / cells).ok() } else { None };
            let scattered = (profile.total - profile.retro).max(0.0);
            Some(Drawn { arrivals, scattered, retro: profile.retro, gain })
        };
        (0..returns.profiles.len()).into_par_iter().map(one).collect()
    }

    /// Number of shots that were fired.
    pub fn count(&self) -> u64 {
        self.fired.iter().map(|run| run.end - run.start).sum()
    }

    /// Number of shots that were fired from one time to before another, s after the first of the pass's times.
    pub fn fired_within(&self, from_s: f64, to_s: f64) -> u64 {
        let number = |t: f64| ((t - self.first_s) / self.period_s).ceil().max(0.0) as u64;
        let (from, to) = (number(from_s), number(to_s));
        self.fired.iter().map(|r| r.end.min(to).saturating_sub(r.start.max(from))).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ranging::DepthBins;

    fn profile(from_m: f64, step_m: f64, photons: Vec<f64>) -> Profile {
        let total = photons.iter().sum();
        let bins = DepthBins { from_m, step_m, count: photons.len() };
        let area_m2 = vec![0.0; photons.len()];
        Profile { bins, photons, area_m2, total, outside: 0.0, retro: 0.0, bounced: None }
    }

    /// The largest distance between the distribution of values and a given one.
    fn distance(mut values: Vec<f64>, truth: impl Fn(f64) -> f64) -> f64 {
        values.sort_by(f64::total_cmp);
        let n = values.len() as f64;
        let apart = |(i, v): (usize, &f64)| {
            let p = truth(*v);
            (p - i as f64 / n).abs().max(((i + 1) as f64 / n - p).abs())
        };
        values.iter().enumerate().map(apart).fold(0.0, f64::max)
    }

    fn drawn(profile: &Profile, pulse_s: f64) -> Drawn {
        let arrivals = Arrivals::new(profile, pulse_s).unwrap();
        Drawn { arrivals, scattered: profile.total, retro: 0.0, gain: None }
    }

    fn draws(drawn: &Drawn, receiver: &Receiver, noise_hz: f64, shots: usize) -> Vec<(f64, bool)> {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(26);
        (0..shots).filter_map(|_| receiver.shot(Some(drawn), noise_hz, &mut rng)).collect()
    }

    const OPEN: Receiver = Receiver { gate_s: 1e-6, jitter_s: 0.0 };

    /// Truth: two humps, even over 0 to 0.3 m (a quarter) and 0.9 to 1.2 m (three quarters) as an array with a hole has them, of so few photons that each is alone: the distribution is a broken line.
    /// Kolmogorov and Smirnov: of n values it is within 1.63/√n in 99 of 100 seeds.
    #[test]
    fn single_photons_follow_the_profile() {
        let two = profile(0.0, 0.3, vec![2.5e-3, 0.0, 0.0, 7.5e-3]);
        let found = draws(&drawn(&two, 1e-18), &OPEN, 0.0, 2_000_000);
        let n = found.len() as f64;
        // Of 2e6 shots 1 - e^-0.01 yield one: 19,900 ± 140.
        assert!((n - 2e6 * -(-0.01_f64).exp_m1()).abs() < 4.0 * 140.0, "{n}");
        assert!(found.iter().all(|(_, noise)| !noise));
        let truth = |t: f64| {
            let x = t * 299_792_458.0 / 2.0;
            let even = |a: f64| ((x - a) / 0.3).clamp(0.0, 1.0);
            0.25 * even(0.0) + 0.75 * even(0.9)
        };
        let apart = distance(found.iter().map(|f| f.0).collect(), truth);
        assert!(apart < 1.63 / n.sqrt() + 0.003, "{apart}");
        // The same photons from the other end are far from it.
        let wrong = distance(found.iter().map(|f| -f.0).collect(), truth);
        assert!(wrong > 0.5, "{wrong}");
    }

    /// Truth: a point at depth 0 through a pulse of 1 ns (full width at half of the most) and a jitter of 0.3 ns: a normal distribution of the root of the sum of squares.
    #[test]
    fn pulse_and_jitter_add() {
        let point = profile(-1e-6, 2e-6, vec![1e-2]);
        let receiver = Receiver { jitter_s: 3e-10, ..OPEN };
        let found = draws(&drawn(&point, 1e-9), &receiver, 0.0, 1_000_000);
        let sigma = (1e-9 / (8.0 * 2.0_f64.ln()).sqrt()).hypot(3e-10);
        let truth = |t: f64| 0.5 * (1.0 + libm::erf(t / (sigma * SQRT_2)));
        let n = found.len() as f64;
        let apart = distance(found.iter().map(|f| f.0).collect(), truth);
        // Two photons in a shot are 0.5 % of those that have any, and move the first of them by half a width.
        assert!(apart < 1.63 / n.sqrt() + 0.005, "{apart} {n}");
    }

    /// Truth: of five photons in the mean, even over 1 m, the first is at x with the density 5 e^(-5x) of those that have one.
    #[test]
    fn the_first_of_many_photons() {
        let even = profile(0.0, 0.01, vec![0.05; 100]);
        let found = draws(&drawn(&even, 1e-18), &OPEN, 0.0, 20_000);
        let n = found.len() as f64;
        assert!(
            (n / 2e4 - (1.0 - (-5.0_f64).exp())).abs() < 4.0 * (0.0067_f64 / 2e4).sqrt(),
            "{n}"
        );
        let truth = |t: f64| {
            let x = t * 299_792_458.0 / 2.0;
            (-5.0 * x.clamp(0.0, 1.0)).exp_m1() / (-5.0_f64).exp_m1()
        };
        let apart = distance(found.iter().map(|f| f.0).collect(), truth);
        assert!(apart < 1.63 / n.sqrt(), "{apart}");
    }

    /// Truth: µ = 2 cells: at least one photon of a mean of 3 in 1 - (1 + 3/2)^-2 = 0.84 of the shots.
    #[test]
    fn speckle_leaves_shots_without_light() {
        let mut cube = drawn(&profile(0.0, 0.01, vec![3.0]), 1e-18);
        (cube.scattered, cube.retro, cube.gain) = (0.0, 3.0, Gamma::new(2.0, 0.5).ok());
        let n = draws(&cube, &OPEN, 0.0, 100_000).len() as f64;
        assert!((n / 1e5 - 0.84).abs() < 4.0 * (0.84 * 0.16 / 1e5_f64).sqrt(), "{n}");
    }

    /// Truth: counts of 1 MHz before a return in the middle of a gate of 1 µs that every shot has: 1 - e^-0.5 of the shots are noise, an exponential distribution from the gate's opening that ends there.
    #[test]
    fn noise_comes_first_in_half_of_the_gate() {
        let bright = drawn(&profile(-0.005, 0.01, vec![1e4]), 1e-18);
        let found = draws(&bright, &OPEN, 1e6, 100_000);
        assert_eq!(found.len(), 100_000);
        let noise: Vec<f64> = found.iter().filter(|f| f.1).map(|f| f.0).collect();
        let share = -(-0.5_f64).exp_m1();
        assert!(
            (noise.len() as f64 / 1e5 - share).abs() < 4.0 * (share * (1.0 - share) / 1e5).sqrt()
        );
        let n = noise.len() as f64;
        let apart = distance(noise, |t| -(-(t + 5e-7) * 1e6).exp_m1() / share);
        assert!(apart < 1.63 / n.sqrt() + 1e-4, "{apart}");
    }

    /// Truth: by hand. Every tenth of a second from 5 s on: shots 0 to 9 and 20 to 24 were fired.
    #[test]
    fn shots_within_a_time() {
        let shots = Shots {
            detections: Vec::new(),
            period_s: 0.1,
            first_s: 5.0,
            fired: vec![0..10, 20..25],
        };
        assert_eq!(shots.count(), 15);
        assert_eq!(shots.fired_within(0.0, 100.0), 15);
        assert_eq!(shots.fired_within(5.45, 7.15), 7);
        assert_eq!(shots.fired_within(6.05, 6.95), 0);
    }

    /// Truth: a body that moves along a parabola: polynomials of second order are met by an interpolation of eighth to the digits of a double, 1e-16 of 0.05 s, times its weights of at most 10.
    #[test]
    fn ways_between_those_computed() {
        let flight = |t: f64| 0.05 + 1e-5 * t + 3e-7 * t * t;
        let ways = Ways(
            (0..20).map(f64::from).map(|t| TwoWay { sent_s: t, flight_s: flight(t) }).collect(),
        );
        for t in [0.0, 0.3, 7.5, 18.9, 19.0] {
            assert!((ways.at(t) - flight(t)).abs() < 1e-15, "{t}");
        }
    }
}
