//! The promise of a simulation: what error was asked for, what is stated, and what stands between them.

use super::{Pass, Simulation};
use crate::light::{Need, Source, percent};
use serde::Serialize;
use sunglint_numerics::order::RunningMedian;

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
}

/// Samples whose light changes while they are exposed by more than is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Smeared {
    /// How many there are.
    pub samples: usize,
    /// The largest difference between middle and mean, relative.
    pub relative: f64,
    /// The sample that has it, from 0.
    pub sample: usize,
}

/// The promise, found sample by sample.
#[derive(Debug, Clone, Default)]
pub(super) struct Promises {
    stated: RunningMedian,
    /// Samples that were taken in, counted or not.
    taken: usize,
    samples: usize,
    met: usize,
    /// Which light limits, and how many samples: in the order in which they came.
    limits: Vec<(&'static str, usize)>,
    smeared: Option<Smeared>,
}

impl Promises {
    /// Takes the samples of a simulation in.
    pub fn add(&mut self, simulation: &Simulation<'_>) {
        for sample in 0..simulation.places.len() {
            let stated = simulation.stated_relative(sample);
            stated.into_iter().for_each(|share| self.stated.add(share));
            let light = simulation.over_tolerance(sample);
            if light == Some(EXPOSURE) {
                self.add_smeared(self.taken + sample, simulation.smear[sample]);
            }
            if stated.is_none() && !simulation.is_dark(sample) {
                continue;
            }
            self.samples += 1;
            let Some(light) = light else {
                self.met += 1;
                continue;
            };
            match self.limits.iter_mut().find(|l| l.0 == light) {
                Some(limit) => limit.1 += 1,
                None => self.limits.push((light, 1)),
            }
        }
        self.taken += simulation.places.len();
    }

    fn add_smeared(&mut self, sample: usize, relative: f64) {
        let all = self.smeared.get_or_insert(Smeared { samples: 0, relative, sample });
        all.samples += 1;
        if relative > all.relative {
            (all.relative, all.sample) = (relative, sample);
        }
    }

    /// Samples whose exposures are too long for their light; `None` without any.
    pub fn smeared(&self) -> Option<Smeared> {
        self.smeared
    }

    /// The promise of all samples together.
    pub fn promise(&self, pass: &Pass, needs: &[Need]) -> Promise {
        let limit = |(light, samples): &(&'static str, usize)| Limit {
            light,
            samples: *samples,
            why: self.why(light, pass, needs),
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

    fn why(&self, of: &str, pass: &Pass, needs: &[Need]) -> String {
        match of {
            "light between surfaces" => {
                let budget_s = pass.budget_s;
                format!(
                    "more patches and light paths than the budget of {budget_s} s an epoch holds"
                )
            }
            "earthshine" => "more directions than an epoch may take".into(),
            "what is left out" => {
                let missing = |n: &&Need| !n.is_modelled() && n.bound.is_some_and(|b| b > 0.0);
                let bound = |n: &Need| n.bound.unwrap_or(0.0);
                let most = needs.iter().filter(missing);
                match most.max_by(|a, b| bound(a).total_cmp(&bound(b))) {
                    Some(need) => {
                        let cure = cure(need.effect);
                        format!(
                            "{} of up to {} of the same surfaces' light in full sunlight{cure}",
                            need.effect,
                            need.bound_text()
                        )
                    }
                    None => "the edge of the Earth's shadow".into(),
                }
            }
            "direct light" => {
                "curved parts, the Sun's disc, or the edge of the Earth's shadow".into()
            }
            EXPOSURE => {
                let most = self.smeared.map_or(0.0, |all| all.relative);
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
