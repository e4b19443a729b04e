//! A pass under an axis: the frequency at which its stretches agree.

use super::SpinPass;
use super::stretches::Stretches;
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
    /// Orthonormal functions of the stretches: constant, and linear where there are enough.
    shapes: Vec<Vec<f64>>,
    /// Sum of the squares of all amplitudes.
    whole: f64,
    /// Variance of an amplitude's part that the best clock leaves.
    noise: f64,
}

impl Channel {
    fn new(stretches: Stretches) -> Self {
        let n = stretches.time_s.len() as f64;
        let mean = stretches.time_s.iter().sum::<f64>() / n;
        let mut shapes = vec![vec![n.sqrt().recip(); stretches.time_s.len()]];
        if stretches.time_s.len() >= DRIFTS_FROM {
            let about: Vec<f64> = stretches.time_s.iter().map(|t| t - mean).collect();
            let norm = about.iter().map(|t| t * t).sum::<f64>().sqrt();
            shapes.push(about.iter().map(|t| t / norm).collect());
        }
        let whole = stretches.amplitudes.iter().flatten().map(Complex::norm_sqr).sum();
        Self { stretches, shapes, whole, noise: 1.0 }
    }

    /// Squares that the clock explains, for phases ψ of the stretches in turns.
    fn gain(&self, psi: &[f64], turn: &mut Vec<Complex<f64>>, base: &mut Vec<Complex<f64>>) -> f64 {
        base.clear();
        base.extend(psi.iter().map(|p| {
            let (sin, cos) = (-TAU * p).sin_cos();
            Complex::new(cos, sin)
        }));
        turn.clone_from(base);
        let mut gain = 0.0;
        for (h, row) in self.stretches.amplitudes.iter().enumerate() {
            if h > 0 {
                turn.iter_mut().zip(base.iter()).for_each(|(t, b)| *t *= b);
            }
            for shape in &self.shapes {
                let sum: Complex<f64> =
                    row.iter().zip(turn.iter()).zip(shape).map(|((a, t), s)| a * t * s).sum();
                gain += sum.norm_sqr();
            }
        }
        gain
    }

    /// Degrees of freedom that are left.
    fn free(&self) -> f64 {
        let h = self.stretches.amplitudes.len() as f64;
        2.0 * h * (self.stretches.time_s.len() as f64 - self.shapes.len() as f64) - 2.0
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
        scan.offset_hz = scan.highest(&|_| 0.0, 0.0).0;
        Some(scan)
    }

    /// The apparent frequency, Hz.
    pub fn apparent_hz(&self) -> f64 {
        self.nominal_hz + self.offset_hz
    }

    /// Squares that a clock explains, in units of each channel's noise.
    fn gain(&self, phase: &dyn Fn(f64) -> f64, hz: f64) -> f64 {
        let (mut psi, mut turn, mut base) = (Vec::new(), Vec::new(), Vec::new());
        let one = |channel: &Channel| {
            psi.clear();
            psi.extend(channel.stretches.time_s.iter().map(|t| hz * t + phase(*t)));
            (channel.gain(&psi, &mut turn, &mut base)) / channel.noise
        };
        self.channels.iter().map(one).sum()
    }

    /// The highest gain near a frequency beside the nominal one: where, and how high.
    fn highest(&self, phase: &dyn Fn(f64) -> f64, about_hz: f64) -> (f64, f64) {
        let harmonics =
            self.channels.iter().map(|c| c.stretches.amplitudes.len()).max().unwrap_or(1) as f64;
        let step = 1.0 / (OVERSAMPLING * harmonics * self.span_s);
        let n = (BESIDE / self.span_s / step).ceil() as i32;
        let tried = (-n..=n).map(|k| {
            let hz = about_hz + f64::from(k) * step;
            (hz, self.gain(phase, hz))
        });
        let best = tried.max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((about_hz, 0.0));
        let (hz, gain, _) = self.uphill(phase, best.0, 0.5 * step);
        (hz, gain)
    }

    /// The peak near a frequency, its gain and curvature.
    fn uphill(&self, phase: &dyn Fn(f64) -> f64, from_hz: f64, step: f64) -> (f64, f64, f64) {
        let (mut hz, mut step) = (from_hz, step);
        let mut top = self.gain(phase, hz);
        let mut bend = 0.0;
        for _ in 0..STEPS {
            let (a, b) = (self.gain(phase, hz - step), self.gain(phase, hz + step));
            bend = (a + b - 2.0 * top) / (step * step);
            let slope = (b - a) / (2.0 * step);
            let next = if bend < 0.0 {
                hz - (slope / bend).clamp(-2.0 * step, 2.0 * step)
            } else if a > b {
                hz - step
            } else {
                hz + step
            };
            let there = self.gain(phase, next);
            if there > top {
                (hz, top) = (next, there);
            }
            step *= 0.5;
        }
        (hz, top, bend)
    }

    /// Squares that the even harmonics have, and all, at the apparent frequency, without what noise has. `None` where no channel bears two harmonics.
    fn even_and_all(&self) -> Option<(f64, f64)> {
        let mut sums = None;
        for channel in self.channels.iter().filter(|c| c.stretches.amplitudes.len() > 1) {
            let times = &channel.stretches.time_s;
            let n = times.len() as f64;
            let (even, all): &mut (f64, f64) = sums.get_or_insert((0.0, 0.0));
            for (h, row) in (1_u32..).zip(&channel.stretches.amplitudes) {
                let turned = row.iter().zip(times).map(|(a, t)| {
                    let (sin, cos) = (-TAU * f64::from(h) * self.offset_hz * t).sin_cos();
                    a * Complex::new(cos, sin)
                });
                let turned: Vec<Complex<f64>> = turned.collect();
                let mean = turned.iter().sum::<Complex<f64>>() / n;
                let about: f64 = turned.iter().map(|a| (a - mean).norm_sqr()).sum();
                let square = (mean.norm_sqr() - about / (n * (n - 1.0))).max(0.0);
                *all += square;
                *even += if h % 2 == 0 { square } else { 0.0 };
            }
        }
        sums.filter(|s| s.1 > 0.0)
    }

    /// Mean turn of the bisector about an axis, Hz; `None` where it meets it.
    pub fn mean_turn_hz(&self, axis: DVec3) -> Option<f64> {
        Some(self.path.turned(axis)?.split().0)
    }

    /// Takes the noise from the best of some axes, so that likelihoods can be compared.
    pub fn settle(&mut self, axes: &[DVec3]) {
        // Channels apart: the noise is each one's own.
        for c in 0..self.channels.len() {
            let alone = Self { channels: vec![self.channels[c].clone()], ..self.clone() };
            let gains = axes.iter().flat_map(|axis| [1.0, 2.0].map(|n| (*axis, n)));
            let best = gains
                .filter_map(|(axis, n)| alone.under(axis, n).map(|(_, gain, _)| gain))
                .fold(0.0, f64::max);
            let channel = &mut self.channels[c];
            // Each square is the sum of two parts.
            channel.noise = ((channel.whole - best) / channel.free().max(1.0)).max(1e-12);
        }
    }

    /// Frequency beside the nominal one, gain and curvature under an axis.
    fn under(&self, axis: DVec3, repeats: f64) -> Option<(f64, f64, f64)> {
        let turn = self.path.turned(axis)?;
        let (mean_hz, _) = turn.split();
        let phase = |t: f64| -repeats * turn.at(self.middle_s + t);
        let about = self.offset_hz + repeats * mean_hz;
        let (hz, _) = self.highest(&phase, about);
        let harmonics = self.channels.iter().map(|c| c.stretches.amplitudes.len()).max()? as f64;
        let (hz, gain, bend) = self.uphill(&phase, hz, 0.1 / (harmonics * self.span_s));
        Some((hz, gain, bend))
    }

    /// Returns what the pass says under an axis; `None` where the axis is met by the bisector.
    pub fn peak(&self, axis: DVec3, repeats: u32) -> Option<Peak> {
        let (hz, gain, bend) = self.under(axis, f64::from(repeats))?;
        // The log likelihood is half of the squares.
        let variance = if bend < 0.0 { -2.0 / bend } else { self.span_s.powi(-2) };
        // What the best of all axes explains, in units of the noise that it leaves.
        let best: f64 = self.channels.iter().map(|c| c.whole / c.noise - c.free().max(1.0)).sum();
        // Channels share much of what is left: they count as one.
        let alike = self.channels.len() as f64;
        Some(Peak {
            hz: self.nominal_hz + hz,
            variance: variance * alike,
            turn_hz: f64::from(repeats) * self.mean_turn_hz(axis)?,
            log_likelihood: 0.5 * (gain - best).min(0.0) / alike,
        })
    }
}

/// Share of the variation that even harmonics have, over some passes; `None` where none bears two harmonics.
pub fn even_share(scans: &[Scan]) -> Option<f64> {
    let sums = scans.iter().filter_map(Scan::even_and_all);
    let (even, all) = sums.fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
    (all > 0.0).then(|| even / all)
}
