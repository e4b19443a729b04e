//! The promise of a simulation: what error was asked for, what is stated, and what stands between them.

use super::Simulation;
use crate::light::{Need, Source, percent};
use serde::Serialize;
use sunglint_numerics::order::median;

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

    /// The promise of all samples together.
    pub fn promise(&self) -> Promise {
        let stated: Vec<(usize, f64)> = (0..self.places.len())
            .filter_map(|sample| Some((sample, self.stated_relative(sample)?)))
            .collect();
        let mut limited_by: Vec<Limit> = Vec::new();
        let mut met = 0;
        for (sample, _) in &stated {
            let Some(light) = self.over_tolerance(*sample) else {
                met += 1;
                continue;
            };
            match limited_by.iter_mut().find(|l| l.light == light) {
                Some(limit) => limit.samples += 1,
                None => limited_by.push(Limit { light, samples: 1, why: self.why(light) }),
            }
        }
        limited_by.sort_by_key(|limit| std::cmp::Reverse(limit.samples));
        let shares: Vec<f64> = stated.iter().map(|(_, share)| *share).collect();
        Promise {
            asked: self.pass.tolerance,
            budget_s: self.pass.budget_s,
            samples: shares.len(),
            met,
            stated_median: median(shares.iter().copied()),
            stated_largest: shares.iter().copied().reduce(f64::max),
            limited_by,
        }
    }

    fn why(&self, of: &str) -> String {
        match of {
            "light between surfaces" => {
                let budget_s = self.pass.budget_s;
                format!(
                    "more patches and light paths than the budget of {budget_s} s an epoch holds"
                )
            }
            "earthshine" => "more directions than an epoch may take".into(),
            "what is left out" => {
                let missing = |n: &&Need| !n.is_modelled() && n.bound.is_some_and(|b| b > 0.0);
                let bound = |n: &Need| n.bound.unwrap_or(0.0);
                let most = self.needs.iter().filter(missing);
                match most.max_by(|a, b| bound(a).total_cmp(&bound(b))) {
                    Some(need) => format!("{} of up to {}", need.effect, need.bound_text()),
                    None => "the edge of the Earth's shadow".into(),
                }
            }
            "direct light" => {
                "curved parts, the Sun's disc, or the edge of the Earth's shadow".into()
            }
            _ => "its own stated error".into(),
        }
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
