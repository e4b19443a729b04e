//! The promise of a simulation: what error was asked for, what is stated, and what stands between them.

use super::{Pass, Simulation};
use crate::light::{Need, Source, percent};
use serde::Serialize;
use sunglint_numerics::order::RunningMedian;

/// Cause that keeps samples from the requested error.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Limit {
    /// Which light has most of the stated error: `direct light`, `light between surfaces`, `earthshine`, `moonshine` or `what is left out`.
    pub light: &'static str,
    /// Samples of which this has most.
    pub samples: usize,
    /// The reason, in words.
    pub why: String,
}

/// Requested error, stated error, and why the request was not met: over the visible samples with light.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Promise {
    /// The relative error that was asked for.
    pub asked: f64,
    /// The work that an epoch's light between surfaces may cost, CPU seconds.
    pub budget_s: f64,
    /// Visible samples with light.
    pub samples: usize,
    /// Those of which the stated error of every channel is within what was asked.
    pub met: usize,
    /// The median over them of the stated error of the worst channel, relative; none without light.
    pub stated_median: Option<f64>,
    /// The largest.
    pub stated_largest: Option<f64>,
    /// Causes that limit the samples that did not meet it, the most frequent first.
    pub limited_by: Vec<Limit>,
}

/// Light in a few words.
pub(crate) fn light_name(source: Source) -> &'static str {
    match source {
        Source::Direct => "direct light",
        Source::Bounce => "light between surfaces",
        Source::Earthshine => "earthshine",
        Source::Moonshine => "moonshine",
        Source::Unknown => "what is left out",
    }
}

impl Simulation<'_> {
    /// The stated error of a sample's rate in its worst channel, relative; of its V magnitude where the station has no channel. `None` without light, or where
    /// the sample is hidden.
    pub fn stated_relative(&self, sample: usize) -> Option<f64> {
        if self.places[sample].hidden {
            return None;
        }
        let channel = |c: &super::ChannelSamples| {
            let (rate, error) = (c.rate_hz[sample], c.error_hz[sample]);
            (rate > 0.0).then(|| error / rate)
        };
        let of_v = || {
            let magnitudes = self.magnitude_errors[[sample, V]];
            (!magnitudes.is_nan()).then(|| 1.0 - 10_f64.powf(-0.4 * magnitudes))
        };
        let worst = self.channels.iter().filter_map(channel).reduce(f64::max);
        if self.channels.is_empty() { of_v() } else { worst }
    }

    /// Whether a sample's stated error is more than what was asked, and which light has most of it.
    pub fn over_tolerance(&self, sample: usize) -> Option<&'static str> {
        let stated = self.stated_relative(sample)?;
        (stated > self.pass.tolerance)
            .then(|| self.limits[sample].map_or("what is left out", light_name))
    }
}

/// The promise, found sample by sample.
#[derive(Debug, Clone, Default)]
pub(super) struct Promises {
    stated: RunningMedian,
    samples: usize,
    met: usize,
    /// Which light limits, and how many samples: in the order in which they came.
    limits: Vec<(&'static str, usize)>,
}

impl Promises {
    /// Takes the samples of a simulation in.
    pub fn add(&mut self, simulation: &Simulation<'_>) {
        for sample in 0..simulation.places.len() {
            let Some(share) = simulation.stated_relative(sample) else { continue };
            self.stated.add(share);
            self.samples += 1;
            let Some(light) = simulation.over_tolerance(sample) else {
                self.met += 1;
                continue;
            };
            match self.limits.iter_mut().find(|l| l.0 == light) {
                Some(limit) => limit.1 += 1,
                None => self.limits.push((light, 1)),
            }
        }
    }

    /// The promise of all samples together.
    pub fn promise(&self, pass: &Pass, needs: &[Need]) -> Promise {
        let limit = |(light, samples): &(&'static str, usize)| Limit {
            light,
            samples: *samples,
            why: why(light, pass, needs),
        };
        let mut limited_by: Vec<Limit> = self.limits.iter().map(limit).collect();
        limited_by.sort_by_key(|limit| std::cmp::Reverse(limit.samples));
        Promise {
            asked: pass.tolerance,
            budget_s: pass.budget_s,
            samples: self.samples,
            met: self.met,
            stated_median: self.stated.median(),
            stated_largest: self.stated.largest(),
            limited_by,
        }
    }
}

fn why(of: &str, pass: &Pass, needs: &[Need]) -> String {
    match of {
        "light between surfaces" => {
            let budget_s = pass.budget_s;
            format!("more patches and light paths than the budget of {budget_s} s an epoch holds")
        }
        "earthshine" => "more directions than an epoch may take".into(),
        "what is left out" => {
            let missing = |n: &&Need| !n.is_modelled() && n.bound.is_some_and(|b| b > 0.0);
            let bound = |n: &Need| n.bound.unwrap_or(0.0);
            let most = needs.iter().filter(missing);
            match most.max_by(|a, b| bound(a).total_cmp(&bound(b))) {
                Some(need) => format!("{} of up to {}", need.effect, need.bound_text()),
                None => "the edge of the Earth's shadow".into(),
            }
        }
        "direct light" => "curved parts, the Sun's disc, or the edge of the Earth's shadow".into(),
        _ => "its own stated error".into(),
    }
}

impl Promise {
    /// Whether every sample with light has the error that was asked for.
    pub fn is_met(&self) -> bool {
        self.met == self.samples
    }

    /// The promise in one line.
    pub fn line(&self) -> String {
        let (Some(median), Some(largest)) = (self.stated_median, self.stated_largest) else {
            return format!("asked {}; no sample has light", percent(self.asked));
        };
        let stated = format!(
            "asked {}, stated {} in the median, {} at most",
            percent(self.asked),
            percent(median),
            percent(largest)
        );
        match self.limited_by.first() {
            None => format!("{stated}: met in all {} samples with light", self.samples),
            Some(limit) => format!(
                "{stated}, met in {} of {} samples with light; limited by {}: {}",
                self.met, self.samples, limit.light, limit.why
            ),
        }
    }
}

/// The place of V among the bands.
const V: usize = 2;
