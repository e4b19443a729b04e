//! Photons one by one, and what a detector makes of them.
//!
//! Light and dark counts arrive as a Poisson process whose rate is constant within a step and changes from step to step. Each arrival
//! carries 64 random bits of its own, its mark, from which everything that happens to it is derived: which pixel it meets, whether
//! a detector that recovers takes it, whether it leaves a trapped charge that comes back as an afterpulse. So the detector's
//! answer is a function of the arrivals and of its own past alone. That past is forgotten within some dead times, and tags that are
//! asked for in other pieces are the same tags.

use super::random::{Purpose, Random, fraction, mix, stream};
use rand::Rng as _;
use rand_distr::{Distribution as _, Exp1};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::ops::Range;

/// Picoseconds of a second.
pub const PS: f64 = 1e12;

/// Dead time of a detector after an event.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum DeadTime {
    /// Never.
    None,
    /// For a time after each count.
    NonParalysable {
        /// τ, s.
        dead_time_s: f64,
    },
    /// For a time after each arrival, counted or not.
    Paralysable {
        /// τ, s.
        dead_time_s: f64,
    },
    /// For a time after each count; then an arrival of age t is counted with the probability 1 − exp(−(t − τ)/τ_r).
    ExponentialRecovery {
        /// τ, s.
        dead_time_s: f64,
        /// τ_r, s.
        recovery_s: f64,
    },
    /// Many pixels, each of them deaf for a time after each of its own counts; an arrival meets any of them alike. The pulses of different
    /// pixels are all told apart.
    MultiPixel {
        /// How many, at least 1.
        pixels: u32,
        /// τ of a pixel, s.
        dead_time_s: f64,
    },
    /// Many pixels, each of which recovers after its own counts with the probability 1 − exp(−t/τ_r), behind one comparator: a pulse within a width of the one before is not told from it.
    Comparator {
        /// How many, at least 1.
        pixels: u32,
        /// τ_r of a pixel, s.
        recovery_s: f64,
        /// Width of a pulse, s.
        pulse_s: f64,
    },
}

/// Charges that are trapped by a count and come back. Each count fills the trap anew, and what was in it is gone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Afterpulsing {
    /// The probability that a count leaves a charge behind, below 1.
    pub probability: f64,
    /// The mean time after the count at which it is set free, s; while the detector is deaf it is lost like a photon.
    pub time_constant_s: f64,
}

/// A detector of single photons.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detector {
    /// Dead time.
    pub dead_time: DeadTime,
    /// Dark events before any dead time, Hz; they arrive as photons do.
    pub dark_rate_hz: f64,
    /// Afterpulses that follow a count.
    pub afterpulsing: Option<Afterpulsing>,
}

impl DeadTime {
    /// The time after which a detector's past may matter no more, counted from its last arrival, s.
    fn memory_s(&self) -> f64 {
        match *self {
            Self::None => 0.0,
            Self::NonParalysable { dead_time_s }
            | Self::Paralysable { dead_time_s }
            | Self::MultiPixel { dead_time_s, .. } => dead_time_s,
            Self::ExponentialRecovery { dead_time_s, recovery_s } => dead_time_s + 8.0 * recovery_s,
            Self::Comparator { recovery_s, pulse_s, .. } => pulse_s + 8.0 * recovery_s,
        }
    }
}

impl Detector {
    /// A detector without faults.
    pub const IDEAL: Self =
        Self { dead_time: DeadTime::None, dark_rate_hz: 0.0, afterpulsing: None };

    /// The counts' times from `span_ps.start` to before `span_ps.end`, ps, in order, of light of `rate_hz(t)` (t in s, in the middle of
    /// a step of `step_ps`; a rate that is not above 0 is darkness). The steps are counted from time 0 and the detector runs
    /// for a while before the span, so that spans side by side are one series of counts.
    ///
    /// ```
    /// use sunglint_virtual::observatory::events::{DeadTime, Detector};
    ///
    /// let dead_time = DeadTime::NonParalysable { dead_time_s: 1e-6 };
    /// let detector = Detector { dead_time, ..Detector::IDEAL };
    /// // 50 ms of 1 MHz: with n τ = 1 half of the photons are counted, and no two counts are closer than τ.
    /// let tags = detector.tags(7, 0..50_000_000_000, 1_000_000_000, |_| 1e6);
    /// assert!((tags.len() as f64 / 25_000.0 - 1.0).abs() < 0.03);
    /// assert!(tags.windows(2).all(|pair| pair[1] - pair[0] >= 1_000_000));
    /// ```
    pub fn tags(
        &self,
        seed: u64,
        span_ps: Range<i64>,
        step_ps: i64,
        mut rate_hz: impl FnMut(f64) -> f64,
    ) -> Vec<i64> {
        let mut events = Events::new(*self, seed, step_ps);
        let mut tags = Vec::new();
        events.jump_before(span_ps.start);
        while events.next_ps() < span_ps.end {
            let rate = rate_hz(events.middle_s());
            events.step(rate, &mut tags);
        }
        tags.retain(|tag| span_ps.contains(tag));
        tags
    }

    /// Time before a moment that the detector has to run to be, at that moment, as if it had always run, ps.
    pub(crate) fn warm_up_ps(&self) -> i64 {
        let trap_s = self.afterpulsing.map_or(0.0, |trap| 20.0 * trap.time_constant_s);
        ((100.0 * self.dead_time.memory_s() + trap_s) * PS).ceil() as i64
    }
}

/// An arrival: a photon, a dark event or a charge from the trap.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Arrival {
    /// When, ps.
    pub time_ps: i64,
    /// Random bits.
    pub mark: u64,
}

/// Appends the arrivals of a Poisson process of `rate_hz` within `span_ps`.
pub fn arrivals(random: &mut Random, rate_hz: f64, span_ps: Range<i64>, into: &mut Vec<Arrival>) {
    if rate_hz.is_nan() || rate_hz <= 0.0 {
        return;
    }
    let (mean_gap_ps, length_ps) = (PS / rate_hz, (span_ps.end - span_ps.start) as f64);
    let mut after_ps = mean_gap_ps * exponential(random);

    let begun = into.len();
    while after_ps < length_ps {
        into.push(Arrival { time_ps: span_ps.start + after_ps as i64, mark: 0 });
        after_ps += mean_gap_ps * exponential(random);
    }
    for arrival in &mut into[begun..] {
        arrival.mark = random.next_u64();
    }
}

/// One pixel, or a whole detector that has no pixels.
#[derive(Debug, Clone, Copy)]
struct Pixel {
    /// Moment from which its deafness counts, ps.
    last_ps: i64,
    /// The charge in its trap, and when it comes.
    trapped: Option<Arrival>,
}

/// A detector that runs: arrivals in, counts out, in the order of time.
#[derive(Debug, Clone)]
pub struct Running {
    detector: Detector,
    dead_ps: i64,
    pixels: Vec<Pixel>,
    /// The last pulse of any pixel, ps.
    pulse_ps: i64,
    /// Charges that may come: those that were replaced in the meantime are still among them.
    due: BinaryHeap<Reverse<(Arrival, u32)>>,
}

impl Running {
    /// A detector that has not counted for long.
    pub fn new(detector: Detector) -> Self {
        let (pixels, dead_time_s) = match detector.dead_time {
            DeadTime::None => (1, 0.0),
            DeadTime::NonParalysable { dead_time_s }
            | DeadTime::Paralysable { dead_time_s }
            | DeadTime::ExponentialRecovery { dead_time_s, .. } => (1, dead_time_s),
            DeadTime::MultiPixel { pixels, dead_time_s } => (pixels.max(1), dead_time_s),
            DeadTime::Comparator { pixels, .. } => (pixels.max(1), 0.0),
        };
        let pixel = Pixel { last_ps: i64::MIN / 4, trapped: None };
        let dead_ps = (dead_time_s * PS).round() as i64;
        let pixels = vec![pixel; pixels as usize];
        Self { detector, dead_ps, pixels, pulse_ps: i64::MIN / 4, due: BinaryHeap::new() }
    }

    /// Takes an arrival, not earlier than the one before, and appends the counts up to it.
    pub fn take(&mut self, arrival: Arrival, counts: &mut Vec<i64>) {
        self.free_charges(arrival.time_ps, counts);
        let pixel = (u128::from(arrival.mark) * self.pixels.len() as u128) >> 64;
        self.meet(pixel as u32, arrival, counts);
    }

    /// Takes the charges that come before `until_ps`.
    pub fn free_charges(&mut self, until_ps: i64, counts: &mut Vec<i64>) {
        while let Some(&Reverse((charge, pixel))) = self.due.peek()
            && charge.time_ps < until_ps
        {
            self.due.pop();
            if self.pixels[pixel as usize].trapped == Some(charge) {
                self.pixels[pixel as usize].trapped = None;
                self.meet(pixel, charge, counts);
            }
        }
    }

    fn meet(&mut self, number: u32, arrival: Arrival, counts: &mut Vec<i64>) {
        let pixel = &mut self.pixels[number as usize];
        let awake_ps = arrival.time_ps - pixel.last_ps - self.dead_ps;
        let counted = match self.detector.dead_time {
            DeadTime::ExponentialRecovery { recovery_s, .. }
            | DeadTime::Comparator { recovery_s, .. } => {
                let recovered = -(-(awake_ps as f64) / (recovery_s * PS)).exp_m1();
                awake_ps >= 0 && fraction(mix(arrival.mark ^ 0x7265_636f)) < recovered
            }
            _ => awake_ps >= 0,
        };
        if counted || matches!(self.detector.dead_time, DeadTime::Paralysable { .. }) {
            pixel.last_ps = arrival.time_ps;
        }
        if !counted {
            return;
        }
        let merged = match self.detector.dead_time {
            DeadTime::Comparator { pulse_s, .. } => {
                arrival.time_ps - self.pulse_ps < (pulse_s * PS).round() as i64
            }
            _ => false,
        };
        self.pulse_ps = arrival.time_ps;
        if !merged {
            counts.push(arrival.time_ps);
        }
        let Some(trap) = self.detector.afterpulsing else { return };
        let mark = mix(arrival.mark ^ 0x7472_6170);
        pixel.trapped = (fraction(mark) < trap.probability).then(|| {
            let mark = mix(mark);
            let after_ps = -(1.0 - fraction(mark)).ln() * trap.time_constant_s * PS;
            Arrival { time_ps: arrival.time_ps + after_ps as i64, mark: mix(mark) }
        });
        if let Some(charge) = pixel.trapped {
            self.due.push(Reverse((charge, number)));
        }
    }
}

/// The counts of a detector, step by step: each step of the light's rate has its own stream of random numbers.
#[derive(Debug, Clone)]
pub struct Events {
    running: Running,
    seed: u64,
    step_ps: i64,
    next: i64,
    arrivals: Vec<Arrival>,
}

impl Events {
    /// From time 0 on, in steps of `step_ps` (at least 1).
    pub fn new(detector: Detector, seed: u64, step_ps: i64) -> Self {
        let running = Running::new(detector);
        Self { running, seed, step_ps: step_ps.max(1), next: 0, arrivals: Vec::new() }
    }

    /// Goes to a step so long before `time_ps` that by then the detector is as if it had always run.
    pub fn jump_before(&mut self, time_ps: i64) {
        let begin = time_ps.saturating_sub(self.running.detector.warm_up_ps());
        *self = Self {
            next: begin.div_euclid(self.step_ps) - 1,
            ..Self::new(self.running.detector, self.seed, self.step_ps)
        };
    }

    /// Where the next step begins, ps.
    pub fn next_ps(&self) -> i64 {
        self.next * self.step_ps
    }

    /// The middle of the next step, s.
    pub fn middle_s(&self) -> f64 {
        (self.next as f64 + 0.5) * self.step_ps as f64 / PS
    }

    /// Appends the counts of the next step, in which the light's rate is `rate_hz`, ps.
    pub fn step(&mut self, rate_hz: f64, into: &mut Vec<i64>) {
        let (begin, end) = (self.next_ps(), self.next_ps() + self.step_ps);
        let mut random = stream(self.seed, Purpose::Arrivals, self.next as u64);
        self.arrivals.clear();
        let light_hz = if rate_hz > 0.0 { rate_hz } else { 0.0 };
        let all_hz = light_hz + self.running.detector.dark_rate_hz;
        arrivals(&mut random, all_hz, begin..end, &mut self.arrivals);
        for arrival in &self.arrivals {
            self.running.take(*arrival, into);
        }
        self.running.free_charges(end, into);
        self.next += 1;
    }
}

fn exponential(random: &mut Random) -> f64 {
    Exp1.sample(random)
}
