//! A channel, measured and simulated: which samples count, and what they say.

use super::TOLERATED;
use super::blocks::{Blocks, jackknife};
use std::fmt;
use sunglint_numerics::order::{median, weighted_quantile};
use sunglint_radiometry::light_curve::Flags;

/// The part of a normal distribution within one standard deviation.
const CENTRAL: f64 = 0.682_689_492_137_085_9;

/// A channel as it comes: one entry a sample, all in one unit.
#[derive(Debug, Clone, Copy)]
pub struct Given<'a> {
    /// Name of the channel.
    pub name: &'a str,
    /// Exposures, s: the weights of samples.
    pub exposure_s: &'a [f64],
    /// Measured value of each sample.
    pub measured: &'a [f64],
    /// Standard uncertainty of each measured value; NaN or 0 where none is known.
    pub sigma: &'a [f64],
    /// Flags of each measured value.
    pub flags: &'a [Flags],
    /// Simulated value of each sample; NaN where the simulation gives none.
    pub simulated: &'a [f64],
    /// How far off that may be by its own stated error: a bound.
    pub model_error: &'a [f64],
    /// Half-width of the 95 % interval that it has by the doubt of the body's materials; `None` where no material says how well it is known.
    pub material: Option<&'a [f64]>,
    /// Flags of each simulated value.
    pub simulated_flags: &'a [Flags],
    /// Whether the sample lies within the times that are compared.
    pub within: &'a [bool],
    /// The relative variance of the sample by twinkling, where that is known.
    pub twinkling: Option<&'a [f64]>,
    /// The relative uncertainty that all samples have in common: κ's.
    pub common_sigma: Option<f64>,
    /// Whether the values are of magnitudes, whose uncertainties are shares of the light: then ln(m/s) is compared, each sample with the weight of its own share.
    pub of_magnitudes: bool,
}

/// Why a sample was left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reason {
    /// A flag of the measurement.
    Flag(Flags),
    /// Outside the times of the scene.
    Outside,
    /// Below the horizon in the simulation, or behind what stands there.
    Hidden,
    /// The simulation has no value.
    NotSimulated,
    /// The simulation has no light, and so no magnitude.
    Dark,
    /// The measurement has no number, and no flag that says why.
    NoNumber,
}

impl Reason {
    /// Returns the name of the reason in tables; a flag has its own name.
    pub fn name(self) -> String {
        match self {
            Reason::Flag(flag) => {
                flag.iter_names().map(|(name, _)| name.to_lowercase()).collect::<Vec<_>>().join("+")
            }
            Reason::Outside => "outside_the_pass".into(),
            Reason::Hidden => "hidden_in_the_simulation".into(),
            Reason::NotSimulated => "not_simulated".into(),
            Reason::Dark => "dark_in_the_simulation".into(),
            Reason::NoNumber => "no_number".into(),
        }
    }
}

/// Samples that were left out, by reason; one with several flags counts under each.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LeftOut {
    /// Their number, each counted once.
    pub samples: usize,
    /// By reason, in the order of the flags' bits, then the others.
    pub reasons: Vec<(Reason, usize)>,
}

impl LeftOut {
    fn add(&mut self, reasons: &[Reason]) {
        self.samples += 1;
        for reason in reasons {
            match self.reasons.iter_mut().find(|(r, _)| r == reason) {
                Some((_, n)) => *n += 1,
                None => self.reasons.push((*reason, 1)),
            }
        }
    }
}

impl fmt::Display for LeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.reasons.is_empty() {
            return write!(f, "{} left out", self.samples);
        }
        let reasons: Vec<String> =
            self.reasons.iter().map(|(reason, n)| format!("{n} {}", reason.name())).collect();
        write!(f, "{} left out ({})", self.samples, reasons.join(", "))
    }
}

/// Reduced χ² of a channel, over its samples with a σ, about the scaled simulation (samples − 1 degrees of freedom).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chi2 {
    /// Samples that went in.
    pub samples: usize,
    /// By the data's σ alone.
    pub data: f64,
    /// By that and what twinkling makes; `None` where that is not known.
    pub with_twinkling: Option<f64>,
    /// By the data's σ, of what is left of a difference past the simulation's stated error: the least that this error allows.
    pub past_stated: f64,
    /// The same of what is left past that and the doubt of the materials; `None` where no material says how well it is known. The scale has taken what all samples have in common, so this is
    /// the least that both allow.
    pub past_materials: Option<f64>,
    /// By the data's σ alone, at a scale of 1.
    pub unscaled: f64,
}

/// Doubt of the body's materials, as it is in the light of a channel: half-widths of 95 % intervals, relative.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaterialBudget {
    /// The median over the samples with light.
    pub median: f64,
    /// The largest.
    pub largest: f64,
    /// Share of all the light, if all of it is off alike, and so of the scale. It is in no uncertainty of the scale: more samples do not make it less.
    pub of_scale: f64,
}

/// Statistics of the samples of a channel that count.
#[derive(Debug, Clone, PartialEq)]
pub struct Numbers {
    /// How many they are.
    pub samples: usize,
    /// Σ t m / Σ t s; of magnitudes exp of the weighted mean of ln(m/s).
    pub scale: f64,
    /// Standard uncertainty of the scale from the samples' σ; `None` where a sample has none.
    pub scale_sigma: Option<f64>,
    /// Standard uncertainty of the scale from the scatter of blocks of time; `None` with too few samples.
    pub scale_sigma_blocks: Option<f64>,
    /// Blocks behind that, as many as equally bright ones would say as much: (Σ w)²/Σ w² of their light w, rounded down.
    pub blocks: usize,
    /// The relative uncertainty that all samples have in common.
    pub common_sigma: Option<f64>,
    /// The median of m/s, each sample with the weight of its simulated light, or of magnitudes as in the scale.
    pub median: f64,
    /// Half of what the central 68 % of m/(scale·s) spans, with the same weights.
    pub scatter: f64,
    /// Root of the mean square of m − scale·s over that of scale·s; of magnitudes that of ln(m/(scale·s)).
    pub rms: f64,
    /// The same of the data's σ: what `rms` would be were the model right and twinkling away; `None` without any σ.
    pub noise: Option<f64>,
    /// The same of twinkling.
    pub twinkling: Option<f64>,
    /// The simulation's stated error: the median and the largest, relative to the sample.
    pub stated: (f64, f64),
    /// Doubt of the materials; `None` where none says how well it is known.
    pub material: Option<MaterialBudget>,
    /// Measured less simulated in magnitudes: mean, root mean square, standard deviation about the mean; `None` where a sample that counts is not above 0.
    pub magnitudes: Option<[f64; 3]>,
    /// χ²; `None` without σ.
    pub chi2: Option<Chi2>,
}

/// A channel, compared.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Name of the channel.
    pub name: String,
    /// Samples with an exposure of this channel.
    pub samples: usize,
    /// Whether each sample counts.
    pub used: Vec<bool>,
    /// The others.
    pub left_out: LeftOut,
    /// Statistics of the samples that count; `None` where none counts, or no light is simulated.
    pub numbers: Option<Numbers>,
}

impl Channel {
    /// Compares. All entries of `given` have one length, that of `blocks`.
    pub fn new(given: &Given<'_>, blocks: &Blocks) -> Self {
        let n = given.measured.len();
        let mut channel = Self {
            name: given.name.to_owned(),
            samples: 0,
            used: vec![false; n],
            left_out: LeftOut::default(),
            numbers: None,
        };
        for i in 0..n {
            if given.flags[i].contains(Flags::NOT_SAMPLED) {
                continue;
            }
            channel.samples += 1;
            let reasons = given.against(i);
            if reasons.is_empty() {
                channel.used[i] = true;
            } else {
                channel.left_out.add(&reasons);
            }
        }
        let order = |reason: &Reason| match reason {
            Reason::Flag(flag) => u64::from(flag.bits()),
            other => (1 << 40) + u64::from(*other == Reason::Hidden),
        };
        channel.left_out.reasons.sort_by_key(|(reason, _)| order(reason));
        channel.numbers = Numbers::of(given, &channel.used, blocks);
        channel
    }
}

impl Given<'_> {
    /// Returns the reasons not to count a sample.
    fn against(&self, i: usize) -> Vec<Reason> {
        let mut reasons: Vec<Reason> =
            (self.flags[i] - TOLERATED).iter().map(Reason::Flag).collect();
        if !self.within[i] {
            reasons.push(Reason::Outside);
        } else if self.simulated_flags[i].contains(Flags::HIDDEN) {
            reasons.push(Reason::Hidden);
        } else if !self.simulated[i].is_finite() {
            reasons.push(Reason::NotSimulated);
        } else if self.of_magnitudes && self.simulated[i] <= 0.0 {
            reasons.push(Reason::Dark);
        }
        let is_number = self.measured[i].is_finite();
        if reasons.is_empty() && !(is_number && (!self.of_magnitudes || self.measured[i] > 0.0)) {
            reasons.push(Reason::NoNumber);
        }
        reasons
    }

    /// Σ t m and Σ t s of some samples.
    pub(super) fn sums(&self, samples: impl Iterator<Item = usize>) -> (f64, f64) {
        samples.fold((0.0, 0.0), |(m, s), i| {
            let t = self.exposure_s[i];
            (m + t * self.measured[i], s + t * self.simulated[i])
        })
    }

    /// The measured light of some samples over the simulated: Σ t m / Σ t s; of magnitudes exp of the mean of ln(m/s), each sample with its [`weight`](Self::weight).
    pub(super) fn quotient(&self, samples: impl Iterator<Item = usize>) -> f64 {
        if !self.of_magnitudes {
            let (light, model) = self.sums(samples);
            return light / model;
        }
        let (sum, weight) = samples.fold((0.0, 0.0), |(sum, weight), i| {
            let own = self.weight(i);
            (sum + own * (self.measured[i] / self.simulated[i]).ln(), weight + own)
        });
        (sum / weight).exp()
    }

    /// Standard uncertainty of that by the samples' own; `None` where one has none.
    pub(super) fn sigma_of_quotient(&self, samples: &[usize]) -> Option<f64> {
        if !self.of_magnitudes {
            let (_, model) = self.sums(samples.iter().copied());
            return self.sigma_of_sum(samples.iter().copied()).map(|s| s / model);
        }
        let each = samples.iter().map(|i| self.share(*i).map(|share| share.powi(-2)));
        let weight: f64 = each.sum::<Option<f64>>()?;
        Some(self.quotient(samples.iter().copied()) / weight.sqrt())
    }

    /// Standard uncertainty of a sample as a share of it; `None` where none is known.
    fn share(&self, i: usize) -> Option<f64> {
        let share = self.sigma[i] / self.measured[i];
        (share.is_finite() && share > 0.0).then_some(share)
    }

    /// The difference of a sample from the simulation at a scale: m − a·s, or ln(m/(a·s)).
    fn residual(&self, i: usize, scale: f64) -> f64 {
        match self.of_magnitudes {
            true => (self.measured[i] / (scale * self.simulated[i])).ln(),
            false => self.measured[i] - scale * self.simulated[i],
        }
    }

    /// The sample's own standard uncertainty, as [`residual`](Self::residual) has it.
    fn noise(&self, i: usize) -> f64 {
        match self.of_magnitudes {
            true => self.sigma[i] / self.measured[i],
            false => self.sigma[i],
        }
    }

    /// All of the simulated light, as [`residual`](Self::residual) has a share of it.
    fn unit(&self, i: usize, scale: f64) -> f64 {
        if self.of_magnitudes { 1.0 } else { scale * self.simulated[i] }
    }

    /// An error of the simulated light, as [`residual`](Self::residual) has it.
    fn error(&self, i: usize, of: &[f64], scale: f64) -> f64 {
        match self.of_magnitudes {
            true => of[i] / self.simulated[i],
            false => scale.abs() * of[i],
        }
    }

    /// The weight of a sample in a mean: its light t s; of magnitudes its uncertainty to the power −2, or 1 where none is known.
    fn weight(&self, i: usize) -> f64 {
        match self.of_magnitudes {
            true => self.share(i).map_or(1.0, |share| share.powi(-2)),
            false => self.exposure_s[i] * self.simulated[i].max(0.0),
        }
    }

    /// √(Σ t² σ²) of some samples; `None` where one has no σ.
    pub(super) fn sigma_of_sum(&self, samples: impl Iterator<Item = usize>) -> Option<f64> {
        let mut sum = 0.0;
        for i in samples {
            if !self.sigma[i].is_finite() {
                return None;
            }
            sum += (self.exposure_s[i] * self.sigma[i]).powi(2);
        }
        Some(sum.sqrt())
    }
}

impl Numbers {
    fn of(given: &Given<'_>, used: &[bool], blocks: &Blocks) -> Option<Self> {
        let picked: Vec<usize> = (0..used.len()).filter(|i| used[*i]).collect();
        let (_, model) = given.sums(picked.iter().copied());
        if picked.is_empty() || model.is_nan() || model <= 0.0 {
            return None;
        }
        let scale = given.quotient(picked.iter().copied());
        let jackknifed = jackknife(blocks, &picked, &|left| given.quotient(left));
        let ratios: Vec<(f64, f64)> = picked
            .iter()
            .filter(|i| given.simulated[**i] > 0.0)
            .map(|i| {
                let s = given.simulated[*i];
                (given.measured[*i] / s, given.weight(*i))
            })
            .collect();
        let at = |p: f64| weighted_quantile(&ratios, p);
        let root = |f: &dyn Fn(usize) -> f64| {
            let t = |i: &usize| if given.of_magnitudes { 1.0 } else { given.exposure_s[*i] };
            let square: f64 = picked.iter().map(|i| t(i) * f(*i).powi(2)).sum();
            let of: f64 = picked.iter().map(|i| t(i) * given.unit(*i, scale).powi(2)).sum();
            (square / of).sqrt()
        };
        let has_sigma = picked.iter().all(|i| given.sigma[*i].is_finite());
        Some(Self {
            samples: picked.len(),
            scale,
            scale_sigma: given.sigma_of_quotient(&picked),
            scale_sigma_blocks: jackknifed,
            blocks: effective(given, &picked, blocks),
            common_sigma: given.common_sigma,
            median: at(0.5),
            scatter: 0.5 * (at(0.5 + 0.5 * CENTRAL) - at(0.5 - 0.5 * CENTRAL)) / scale.abs(),
            rms: root(&|i| given.residual(i, scale)),
            noise: has_sigma.then(|| root(&|i| given.noise(i))),
            twinkling: given.twinkling.map(|v| root(&|i| v[i].sqrt() * given.unit(i, scale))),
            stated: relative_error(given, &picked, given.model_error),
            material: given.material.map(|half| {
                let (median, largest) = relative_error(given, &picked, half);
                let doubtful = picked.iter().filter(|i| half[**i].is_finite());
                let of_scale = if given.of_magnitudes {
                    let all: f64 = picked.iter().map(|i| given.weight(*i)).sum();
                    let part = |i: &usize| given.weight(*i) * half[*i] / given.simulated[*i];
                    doubtful.map(part).sum::<f64>() / all
                } else {
                    doubtful.map(|i| given.exposure_s[*i] * half[*i]).sum::<f64>() / model
                };
                MaterialBudget { median, largest, of_scale }
            }),
            magnitudes: magnitudes(given, &picked),
            chi2: chi2(given, &picked, scale),
        })
    }

    /// The larger of both uncertainties of the scale; `None` where neither is known.
    pub fn scale_uncertainty(&self) -> Option<f64> {
        match (self.scale_sigma, self.scale_sigma_blocks) {
            (Some(a), Some(b)) => Some(a.max(b)),
            (a, b) => a.or(b),
        }
    }

    /// The scale's standard uncertainty with what all samples have in common; `None` where no uncertainty of its own is known.
    pub fn scale_total(&self) -> Option<f64> {
        let common = self.common_sigma.unwrap_or(0.0) * self.scale;
        self.scale_uncertainty().map(|own| own.hypot(common))
    }

    /// The scale's 95 % interval: by Student's distribution about the blocks where they say more than the samples' σ, and with what all samples have in
    /// common. `None` where no uncertainty is known.
    pub fn scale_interval(&self) -> Option<(f64, f64)> {
        let own = 1.959_963_984_540_054 * self.scale_sigma.unwrap_or(0.0);
        let blocks = self.scale_sigma_blocks.map_or(0.0, |s| student_half(s, self.blocks));
        let half = own.max(blocks);
        self.scale_uncertainty()?;
        let common = 1.959_963_984_540_054 * self.common_sigma.unwrap_or(0.0) * self.scale;
        let half = half.hypot(common);
        Some((self.scale - half, self.scale + half))
    }
}

/// How many equally bright blocks would say as much as those that have samples.
fn effective(given: &Given<'_>, picked: &[usize], blocks: &Blocks) -> usize {
    let mut light = vec![0.0; blocks.count()];
    for i in picked {
        light[blocks.of(*i)] += given.weight(*i);
    }
    let (sum, squares) = light.iter().fold((0.0, 0.0), |(a, b), w| (a + w, b + w * w));
    // From 1 to the number of blocks.
    if squares > 0.0 { (sum * sum / squares) as usize } else { 0 }
}

fn student_half(sigma: f64, blocks: usize) -> f64 {
    super::student_95(blocks.saturating_sub(1)) * sigma
}

/// An error of samples with light, relative: median and largest.
fn relative_error(given: &Given<'_>, picked: &[usize], error: &[f64]) -> (f64, f64) {
    let shares: Vec<f64> = picked
        .iter()
        .filter(|i| given.simulated[**i] > 0.0 && error[**i].is_finite())
        .map(|i| error[*i] / given.simulated[*i])
        .collect();
    let largest = shares.iter().copied().reduce(f64::max).unwrap_or(f64::NAN);
    (median(shares).unwrap_or(f64::NAN), largest)
}

fn magnitudes(given: &Given<'_>, picked: &[usize]) -> Option<[f64; 3]> {
    let difference = |i: &usize| {
        let ratio = given.measured[*i] / given.simulated[*i];
        (given.measured[*i] > 0.0 && ratio.is_finite() && ratio > 0.0).then(|| -2.5 * ratio.log10())
    };
    let all = picked.iter().map(difference).collect::<Option<Vec<f64>>>()?;
    let n = all.len() as f64;
    let mean = all.iter().sum::<f64>() / n;
    let square = all.iter().map(|d| d * d).sum::<f64>() / n;
    let about = all.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / n;
    Some([mean, square.sqrt(), about.sqrt()])
}

fn chi2(given: &Given<'_>, picked: &[usize], scale: f64) -> Option<Chi2> {
    let good: Vec<usize> = picked
        .iter()
        .copied()
        .filter(|i| given.sigma[*i].is_finite() && given.sigma[*i] > 0.0)
        .collect();
    let n = good.len();
    if n < 2 {
        return None;
    }
    let sum = |f: &dyn Fn(usize) -> f64| good.iter().map(|i| f(*i)).sum::<f64>();
    let residual = |i: usize, a: f64| given.residual(i, a);
    let variance = |i: usize| given.noise(i).powi(2);
    let free = (n - 1) as f64;
    let with_twinkling = given.twinkling.map(|v| {
        let more = |i: usize| v[i] * given.unit(i, scale).powi(2);
        sum(&|i| residual(i, scale).powi(2) / (variance(i) + more(i))) / free
    });
    let error = |i: usize, of: &[f64]| given.error(i, of, scale);
    let past = |i: usize| (residual(i, scale).abs() - error(i, given.model_error)).max(0.0);
    let past_materials = given.material.map(|half| {
        let allowed = |i: usize| if half[i].is_finite() { error(i, half) } else { 0.0 };
        sum(&|i| (past(i) - allowed(i)).max(0.0).powi(2) / variance(i)) / free
    });
    Some(Chi2 {
        samples: n,
        data: sum(&|i| residual(i, scale).powi(2) / variance(i)) / free,
        with_twinkling,
        past_stated: sum(&|i| past(i).powi(2) / variance(i)) / free,
        past_materials,
        unscaled: sum(&|i| residual(i, 1.0).powi(2) / variance(i)) / n as f64,
    })
}
