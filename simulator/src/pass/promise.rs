//! The promise of a simulation: what error was asked for, what is stated, and what stands between them.

use super::Simulation;
use crate::light::{Need, Source, percent};
use serde::Serialize;
use sunglint_numerics::order::median;

/// Cause that keeps samples from the requested error.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Limit {
    /// Which light has most of the stated error: `direct light`, `light between surfaces`, `earthshine`, `moonshine` or `what is left out`; or `the exposure`, where the light of its middle is
    /// farther off its mean than all of that.
    pub light: &'static str,
    /// Samples of which this has most.
    pub samples: usize,
    /// The reason, in words.
    pub why: String,
}

/// Requested error, stated error, and why the request was not met: over the visible samples with light, and those in sunlight that have none in a channel but an error.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Promise {
    /// The relative error that was asked for.
    pub asked: f64,
    /// The work that an epoch's light between surfaces may cost, CPU seconds.
    pub budget_s: f64,
    /// Visible samples with light, or in sunlight with an error where there is none.
    pub samples: usize,
    /// Those of which the stated error of every channel is within what was asked, and what the middle of the exposure differs by from its mean ([`Simulation::smear`]) too. An error where there is
    /// no light is not within it.
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

/// Limit of samples whose light changes while they are exposed.
pub(super) const EXPOSURE: &str = "the exposure";

/// An error below this where there is no light is none: a photon in ten days, Hz.
const LEAST_ERROR_HZ: f64 = 1e-6;

/// What has an effect modelled that is left out.
fn cure(effect: &str) -> String {
    let key = effect.replace([' ', '-'], "_");
    let keys = ["solar_disc", "inter_reflection", "earthshine", "moonshine", "finite_distance"];
    match keys.contains(&key.as_str()) {
        true => format!(" ({key} = \"on\" in [effects] has it modelled)"),
        false => String::new(),
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

    /// Whether a sample's error is more than what was asked, and which light has most of it. Without light in some channel it is wherever there is an error.
    pub fn over_tolerance(&self, sample: usize) -> Option<&'static str> {
        let stated = self.stated_relative(sample).unwrap_or(0.0);
        let stated = if self.is_dark(sample) { f64::INFINITY } else { stated };
        let smear = if self.places[sample].hidden { 0.0 } else { self.smear[sample] };
        if smear > stated.max(self.pass.tolerance) {
            return Some(EXPOSURE);
        }
        (stated > self.pass.tolerance)
            .then(|| self.limits[sample].map_or("what is left out", light_name))
    }

    /// Whether a sample is visible and in sunlight, and some channel has an error but no light.
    fn is_dark(&self, sample: usize) -> bool {
        let place = &self.places[sample];
        let dark = |c: &super::ChannelSamples| {
            c.rate_hz[sample] == 0.0 && c.error_hz[sample] > LEAST_ERROR_HZ
        };
        !place.hidden && place.sunlit > 0.0 && self.channels.iter().any(dark)
    }

    /// The promise of all samples together.
    pub fn promise(&self) -> Promise {
        let stated: Vec<Option<f64>> =
            (0..self.places.len()).map(|sample| self.stated_relative(sample)).collect();
        let counted = |sample: &usize| stated[*sample].is_some() || self.is_dark(*sample);
        let counted: Vec<usize> = (0..stated.len()).filter(counted).collect();
        let mut limited_by: Vec<Limit> = Vec::new();
        let mut met = 0;
        for sample in &counted {
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
        let shares: Vec<f64> = stated.iter().copied().flatten().collect();
        Promise {
            asked: self.pass.tolerance,
            budget_s: self.pass.budget_s,
            samples: counted.len(),
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
                    Some(need) => {
                        let cure = cure(need.effect);
                        format!("{} of up to {}{cure}", need.effect, need.bound_text())
                    }
                    None => "the edge of the Earth's shadow".into(),
                }
            }
            "direct light" => {
                "curved parts, the Sun's disc, or the edge of the Earth's shadow".into()
            }
            EXPOSURE => {
                let most = self.smear.iter().copied().fold(0.0, f64::max);
                format!(
                    "the light changes while it is taken, and its middle, which stands for it, is up to {} off its mean; shorter exposures, or `compare`, which averages",
                    percent(most)
                )
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
            let dark = match self.limited_by.first() {
                None => String::new(),
                Some(limit) => format!(
                    ", but {} of them in sunlight have an error; limited by {}: {}",
                    self.samples, limit.light, limit.why
                ),
            };
            return format!("asked {}; no sample has light{dark}", percent(self.asked));
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
