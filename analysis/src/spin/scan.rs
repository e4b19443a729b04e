//! A pass under an axis: the frequency at which its stretches agree.

use super::SpinPass;
use super::stretches::{HARMONICS, Stretches};
use crate::synodic::Bisectors;
use glam::DVec3;
use nalgebra::Complex;
use std::f64::consts::TAU;

/// Frequencies to a resolution of the highest harmonic, and resolutions 1/span to either side.
const OVERSAMPLING: f64 = 2.0;
const BESIDE: f64 = 1.0;
/// Stretches from which on the amplitudes may drift along the pass.
const DRIFTS_FROM: usize = 6;
/// Steps of Newton's method at the peak.
const STEPS: usize = 4;

/// The frequency of a pass under an axis.
#[derive(Debug, Clone, Copy)]
pub struct Peak {
    /// Sidereal frequency of the light's repetition, Hz.
    pub hz: f64,
    /// Variance of that, Hz².
    pub variance: f64,
    /// Mean turn of the light by the bisector's, Hz: what apparent and sidereal frequency differ by.
    pub turn_hz: f64,
    /// Log likelihood there, beside that of the best axis.
    pub log_likelihood: f64,
}

/// The bisector's turn about an axis over a pass.
#[derive(Debug, Clone)]
pub struct Turned {
    /// Mean of the turn, Hz: by that, times the repetitions in a turn, apparent and sidereal frequency differ.
    pub mean_hz: f64,
    /// By channel: how far it is at each stretch, turns.
    at: Vec<Vec<f64>>,
}

/// By channel: phase of a clock at each stretch, beside that of its frequency, turns.
type Phases = Vec<Vec<f64>>;

/// A pass, ready for axes.
#[derive(Debug, Clone)]
pub struct Scan {
    /// Place in the list.
    pub number: usize,
    /// The middle between its first and its last sample, s, and the time between them, s.
    pub middle_s: f64,
    pub span_s: f64,
    channels: Vec<Channel>,
    path: Bisectors,
    nominal_hz: f64,
    offset_hz: f64,
}

/// Stretches of a channel.
#[derive(Debug, Clone)]
struct Channel {
    stretches: Stretches,
    /// The same amplitudes, stretch by stretch.
    by_stretch: Vec<Complex<f64>>,
    /// Time of each stretch from their mean, of norm 1: amplitudes may drift along it. Empty where the stretches are too few.
    along: Vec<f64>,
    /// Sum of the squares of all amplitudes.
    whole: f64,
    /// Variance of an amplitude's part that the best clock leaves.
    noise: f64,
}

impl Channel {
    fn new(stretches: Stretches) -> Self {
        let count = stretches.time_s.len();
        let mean = stretches.time_s.iter().sum::<f64>() / count as f64;
        let mut along = Vec::new();
        if count >= DRIFTS_FROM {
            let about = stretches.time_s.iter().map(|t| t - mean);
            let norm = about.clone().map(|t| t * t).sum::<f64>().sqrt();
            along.extend(about.map(|t| t / norm));
        }
        let whole = stretches.amplitudes.iter().flatten().map(Complex::norm_sqr).sum();
        let of = |k: usize| stretches.amplitudes.iter().map(move |row| row[k]);
        let by_stretch = (0..count).flat_map(of).collect();
        Self { stretches, by_stretch, along, whole, noise: 1.0 }
    }

    /// The hands of a clock at the stretches: e^(−2πi ψ), with the phases ψ = f t + φ.
    fn hands(&self, phases: &[f64], hz: f64) -> Vec<Complex<f64>> {
        let one = |(t, phase): (&f64, &f64)| {
            let (sin, cos) = (-TAU * (hz * t + phase)).sin_cos();
            Complex::new(cos, sin)
        };
        self.stretches.time_s.iter().zip(phases).map(one).collect()
    }

    /// Squares that the clock explains.
    fn gain(&self, hands: &[Complex<f64>]) -> f64 {
        let none = Complex::new(0.0, 0.0);
        let (mut even, mut drifting) = ([none; HARMONICS], [none; HARMONICS]);
        let rows = self.by_stretch.chunks_exact(self.stretches.amplitudes.len());
        for (k, (row, hand)) in rows.zip(hands).enumerate() {
            let along = self.along.get(k).copied().unwrap_or(0.0);
            let mut turn = *hand;
            for ((a, even), drifting) in row.iter().zip(&mut even).zip(&mut drifting) {
                let part = a * turn;
                *even += part;
                *drifting += part * along;
                turn *= hand;
            }
        }
        let squares = |sums: &[Complex<f64>]| sums.iter().map(Complex::norm_sqr).sum::<f64>();
        squares(&even) / hands.len() as f64 + squares(&drifting)
    }

    /// Degrees of freedom that are left.
    fn free(&self) -> f64 {
        let h = self.stretches.amplitudes.len() as f64;
        let shapes = if self.along.is_empty() { 1.0 } else { 2.0 };
        2.0 * h * (self.stretches.time_s.len() as f64 - shapes) - 2.0
    }
}

impl Scan {
    /// Reads a pass that repeats at an apparent frequency; `None` where no channel has stretches enough.
    pub fn new(pass: &SpinPass, number: usize, nominal_hz: f64) -> Option<Self> {
        let (first, last) = pass.ends_s();
        let middle_s = 0.5 * (first + last);
        let stretches = pass.series.iter().filter_map(|s| Stretches::new(s, middle_s, nominal_hz));
        let channels: Vec<Channel> = stretches.map(Channel::new).collect();
        if channels.is_empty() {
            return None;
        }
        let (path, span_s) = (pass.path.clone(), last - first);
        let mut scan =
            Self { number, middle_s, span_s, channels, path, nominal_hz, offset_hz: 0.0 };
        let still: Phases =
            scan.channels.iter().map(|c| vec![0.0; c.stretches.time_s.len()]).collect();
        scan.offset_hz = scan.highest(&still, 0.0).0;
        Some(scan)
    }

    /// The apparent frequency, Hz.
    pub fn apparent_hz(&self) -> f64 {
        self.nominal_hz + self.offset_hz
    }

    /// Squares that a clock explains, in units of each channel's noise.
    fn gain(&self, phases: &[Vec<f64>], hz: f64) -> f64 {
        let one = |(c, phases): (&Channel, &Vec<f64>)| c.gain(&c.hands(phases, hz)) / c.noise;
        self.channels.iter().zip(phases).map(one).sum()
    }

    /// Harmonics of the channel that has most.
    fn harmonics(&self) -> f64 {
        self.channels.iter().map(|c| c.stretches.amplitudes.len()).max().unwrap_or(1) as f64
    }

    /// The highest gain near a frequency beside the nominal one: where, and how high.
    fn highest(&self, phases: &[Vec<f64>], about_hz: f64) -> (f64, f64) {
        let step = 1.0 / (OVERSAMPLING * self.harmonics() * self.span_s);
        let n = (BESIDE / self.span_s / step).ceil() as i32;
        // From step to step each hand turns by as much.
        let mut clocks: Vec<_> = (self.channels.iter().zip(phases))
            .map(|(c, phases)| {
                let first = c.hands(phases, about_hz - f64::from(n) * step);
                (c, first, c.hands(&vec![0.0; phases.len()], step))
            })
            .collect();
        let mut best = (about_hz, f64::NEG_INFINITY);
        for k in -n..=n {
            let gain: f64 = clocks.iter().map(|(c, hands, _)| c.gain(hands) / c.noise).sum();
            if gain >= best.1 {
                best = (about_hz + f64::from(k) * step, gain);
            }
            for (_, hands, further) in &mut clocks {
                hands.iter_mut().zip(further.iter()).for_each(|(hand, by)| *hand *= by);
            }
        }
        let (hz, gain, _) = self.uphill(phases, best.0, 0.5 * step);
        (hz, gain)
    }

    /// The peak near a frequency, its gain and curvature.
    fn uphill(&self, phases: &[Vec<f64>], from_hz: f64, step: f64) -> (f64, f64, f64) {
        let (mut hz, mut step) = (from_hz, step);
        let mut top = self.gain(phases, hz);
        let mut bend = 0.0;
        for _ in 0..STEPS {
            let (a, b) = (self.gain(phases, hz - step), self.gain(phases, hz + step));
            bend = (a + b - 2.0 * top) / (step * step);
            let slope = (b - a) / (2.0 * step);
            let next = if bend < 0.0 {
                hz - (slope / bend).clamp(-2.0 * step, 2.0 * step)
            } else if a > b {
                hz - step
            } else {
                hz + step
            };
            let there = self.gain(phases, next);
            if there > top {
                (hz, top) = (next, there);
            }
            step *= 0.5;
        }
        (hz, top, bend)
    }

    /// The variation that the harmonics have at the apparent frequency, without what noise has. `None` where no channel bears two harmonics.
    fn variation(&self) -> Option<Variation> {
        let mut sums = None;
        for channel in self.channels.iter().filter(|c| c.stretches.amplitudes.len() > 1) {
            let times = &channel.stretches.time_s;
            let n = times.len() as f64;
            let sum: &mut Variation = sums.get_or_insert_default();
            for (h, row) in (1_u32..).zip(&channel.stretches.amplitudes) {
                let turned = row.iter().zip(times).map(|(a, t)| {
                    let (sin, cos) = (-TAU * f64::from(h) * self.offset_hz * t).sin_cos();
                    a * Complex::new(cos, sin)
                });
                let turned: Vec<Complex<f64>> = turned.collect();
                let mean = turned.iter().sum::<Complex<f64>>() / n;
                let about: f64 = turned.iter().map(|a| (a - mean).norm_sqr()).sum();
                // The square of the mean that noise alone would have; it scatters by as much.
                let noise = about / (n * (n - 1.0));
                let square = mean.norm_sqr() - noise;
                sum.all += square.max(0.0);
                if h % 2 == 0 {
                    sum.even += square.max(0.0);
                } else {
                    sum.odd += square;
                    sum.odd_variance += noise * noise;
                }
            }
        }
        sums.filter(|s| s.all > 0.0)
    }

    /// The bisector's turn about an axis; `None` where it meets it.
    pub fn turned(&self, axis: DVec3) -> Option<Turned> {
        let turn = self.path.turned(axis)?;
        let at = |c: &Channel| {
            c.stretches.time_s.iter().map(|t| turn.at(self.middle_s + t)).collect::<Vec<_>>()
        };
        Some(Turned { mean_hz: turn.split().0, at: self.channels.iter().map(at).collect() })
    }

    /// Takes the noise from the best of some axes, so that likelihoods can be compared.
    pub fn settle(&mut self, axes: &[DVec3]) {
        // Channels apart: the noise is each one's own.
        for c in 0..self.channels.len() {
            let alone = Self { channels: vec![self.channels[c].clone()], ..self.clone() };
            let turns = axes.iter().filter_map(|axis| alone.turned(*axis));
            let best = turns
                .flat_map(|turned| [1.0, 2.0].map(|n| alone.under(&turned, n).1))
                .fold(0.0, f64::max);
            let channel = &mut self.channels[c];
            // Each square is the sum of two parts.
            channel.noise = ((channel.whole - best) / channel.free().max(1.0)).max(1e-12);
        }
    }

    /// Frequency beside the nominal one, gain and curvature under an axis.
    fn under(&self, turned: &Turned, repeats: f64) -> (f64, f64, f64) {
        let phases: Phases =
            turned.at.iter().map(|at| at.iter().map(|t| -repeats * t).collect()).collect();
        let (hz, _) = self.highest(&phases, self.offset_hz + repeats * turned.mean_hz);
        self.uphill(&phases, hz, 0.1 / (self.harmonics() * self.span_s))
    }

    /// Returns what the pass says under the axis that the bisector turned about.
    pub fn peak(&self, turned: &Turned, repeats: u32) -> Peak {
        let (hz, gain, bend) = self.under(turned, f64::from(repeats));
        // The log likelihood is half of the squares.
        let variance = if bend < 0.0 { -2.0 / bend } else { self.span_s.powi(-2) };
        // What the best of all axes explains, in units of the noise that it leaves.
        let best: f64 = self.channels.iter().map(|c| c.whole / c.noise - c.free().max(1.0)).sum();
        // Channels share much of what is left: they count as one.
        let alike = self.channels.len() as f64;
        Peak {
            hz: self.nominal_hz + hz,
            variance: variance * alike,
            turn_hz: f64::from(repeats) * turned.mean_hz,
            log_likelihood: 0.5 * (gain - best).min(0.0) / alike,
        }
    }
}

/// Squares of harmonics' amplitudes.
#[derive(Debug, Clone, Copy, Default)]
struct Variation {
    even: f64,
    all: f64,
    /// Those of odd harmonics; negative where noise alone would have more.
    odd: f64,
    /// Variance of `odd` where there is noise alone.
    odd_variance: f64,
}

/// Standard deviations by which odd harmonics have to stand out of the noise.
const SEEN: f64 = 3.0;

/// Share of the variation that even harmonics have, over some passes, and whether odd ones stand out of the noise; `None` where none bears two harmonics.
pub fn even_share(scans: &[Scan]) -> Option<(f64, bool)> {
    let sum =
        scans.iter().filter_map(Scan::variation).fold(Variation::default(), |a, b| Variation {
            even: a.even + b.even,
            all: a.all + b.all,
            odd: a.odd + b.odd,
            odd_variance: a.odd_variance + b.odd_variance,
        });
    (sum.all > 0.0).then(|| (sum.even / sum.all, sum.odd > SEEN * sum.odd_variance.sqrt()))
}
