//! Question of a period search, and its answer.

use crate::period::PeriodError;
use sunglint_formats::text::counted;

/// Options of the search.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Options {
    /// The shortest period, s [default: twice the median step of the samples, or twice the exposure where that is longer; shorter where the samples are uneven and show more].
    pub shortest_s: Option<f64>,
    /// The longest period, s [default: half of the span].
    pub longest_s: Option<f64>,
}

/// A period with its standard uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The period, s.
    pub period_s: f64,
    /// Standard uncertainty, s, from the curvature of the joint χ² with the noise that the fit leaves.
    pub sigma_s: f64,
}

/// Why a period is in a family.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Membership {
    /// The smallest period that fits; of a family with parts or folded periods, the one that fits best.
    Best,
    /// That many times the best: what tells them apart is neither there nor ruled out.
    Multiple(usize),
    /// That part of the best: it may be enough.
    Part(usize),
    /// Another peak of the periodogram, nearly as high.
    Alias,
    /// One of two at once, which explain the light about as well as one period does whose light changes.
    Second,
    /// Not among the periods that harmonics give: flashes ask for it.
    Flashes,
    /// Even samples show it as the best: |n f_s ± f| with the rate f_s of the samples, the number n, and exposures that are too short to rule it out.
    Folded(usize),
}

/// A period that the data leave possible.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Member {
    /// The period.
    pub estimate: Estimate,
    /// Why it is one.
    pub membership: Membership,
    /// Turns in the longest series.
    pub turns: f64,
}

/// A probability in words: two places, and powers of ten where these would be 0.
fn small(chance: f64) -> String {
    if chance >= 0.01 { format!("{chance:.2}") } else { format!("{chance:.1e}") }
}

/// Why there are not enough data.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Reason {
    /// Too few samples everywhere.
    #[error("the longest channel has {} that count, at least {least} are needed", counted(*samples, "sample"))]
    Samples {
        /// Samples of the longest channel.
        samples: usize,
        /// Number that is needed.
        least: usize,
    },
    /// No light that changes.
    #[error("the light is constant in every channel")]
    Constant,
    /// No period stands out, and no more scatter than the rounding makes.
    #[error(
        "the light is constant as far as its digits say: it scatters by {scatter_mag:.4} mag, no more than the step of {step_mag} mag to which the magnitudes are rounded, and nothing in it repeats"
    )]
    Rounded {
        /// Standard deviation of the light in the channel where it is largest, mag.
        scatter_mag: f64,
        /// Rounding step there, mag.
        step_mag: f64,
    },
    /// No period between sampling and span.
    #[error(
        "samples every {step_s:.4} s (exposures up to {exposure_s:.4} s) over {span_s:.4} s leave no period to look for: the shortest that they show is {shortest_s:.4} s, the longest {longest_s:.4} s"
    )]
    Range {
        /// Median step, s.
        step_s: f64,
        /// Longest exposure, s.
        exposure_s: f64,
        /// Span, s.
        span_s: f64,
        /// Shortest period, s.
        shortest_s: f64,
        /// Longest period, s.
        longest_s: f64,
    },
    /// Nothing above the noise.
    #[error(
        "no period stands out of the noise: the best, {period_s:.6} s, would do as well by chance with a probability of up to {}", small(*chance)
    )]
    Noise {
        /// The best period, s.
        period_s: f64,
        /// The chance.
        chance: f64,
    },
    /// Nothing that repeats often enough.
    #[error(
        "the best period, {period_s:.6} s, fits only {turns:.2} times into the data: at least {least} turns are needed to see it repeat, {wanted_s:.0} s of data"
    )]
    Turns {
        /// The best period, s.
        period_s: f64,
        /// Turns in the data.
        turns: f64,
        /// Turns that are needed.
        least: f64,
        /// The span that this needs, s.
        wanted_s: f64,
    },
}

/// Even sampling, and the periods that it shows as the best.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Folding {
    /// Step of the samples, s.
    pub step_s: f64,
    /// The longest exposure, s; `None` where it is not known: then exposures are presumed to fill the step, and no folded period is possible.
    pub exposure_s: Option<f64>,
    /// Folded periods that are possible beyond those that are members.
    pub unnamed: usize,
    /// The shortest folded period that is possible, s; infinite where none is.
    pub shortest_s: f64,
}

/// Uneven sampling: it shows periods below twice its median step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Uneven {
    /// Twice the median step, or twice the exposure where that is longer, s.
    pub usual_s: f64,
    /// The shortest period that was looked for, s.
    pub shortest_s: f64,
    /// Whether still shorter ones would show, and were left out for their number.
    pub is_cut: bool,
}

/// Answer that the data give.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Outcome {
    /// One period.
    One(Estimate),
    /// Several, the best first.
    Family(Vec<Member>),
    /// Two periods at once, the one with more light first: a body that tumbles, or the light of two bodies.
    Two(Estimate, Estimate),
    /// None.
    NotEnough(Reason),
}

/// One question about a multiple or a part of the best period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Question {
    /// The longer of the two periods, s.
    pub longer_s: f64,
    /// The shorter, s.
    pub shorter_s: f64,
    /// The chance that the longer one explains more by noise alone, from lines; `None` where turns are too few to tell.
    pub chance: Option<f64>,
    /// Share of their light by which successive turns of the shorter one may differ all the same, at about 95 %.
    pub unlike: Option<f64>,
    /// The same chance from phase dispersion.
    pub dispersion_chance: Option<f64>,
}

/// The verdict and what it rests on.
#[derive(Debug, Clone, PartialEq)]
pub struct Verdict {
    /// Answer that the data give.
    pub outcome: Outcome,
    /// The best period, even where it is no answer.
    pub best: Option<Estimate>,
    /// Harmonics of the model at the best period.
    pub harmonics: usize,
    /// Upper bound of the chance that noise gives the best period (white noise, its correlation counted).
    pub false_alarm: Option<f64>,
    /// Chance that its harmonics are no more than what lies beside them in the spectrum.
    pub beside: Option<f64>,
    /// Questions about multiples and parts.
    pub questions: Vec<Question>,
    /// The highest peaks of the search: harmonics of the model, period in s, twice the logarithm of the likelihood gained.
    pub peaks: Vec<(usize, f64, f64)>,
    /// The shortest and longest period that were looked for, s.
    pub searched_s: Option<(f64, f64)>,
    /// Uneven sampling, and how far below its usual end the search went; `None` where it did not.
    pub uneven: Option<Uneven>,
    /// Peaks of the sampling's own spectrum: frequency in Hz, height.
    pub window_peaks: Vec<(f64, f64)>,
    /// Even sampling, and what it cannot tell from the best; `None` where the sampling is uneven.
    pub folding: Option<Folding>,
    /// Drift of the phase over the data that parts of a turn show which go ahead of others, turns, as one standard deviation: it is in the uncertainties. 0 where all keep step.
    pub drift_turns: f64,
    /// Channels that say something of their own: fewer than there are where the noise is shared.
    pub independent_channels: f64,
    /// The share of the samples that are independent of their neighbours.
    pub independent_samples: f64,
    /// Channels that were left out, and why.
    pub left_out: Vec<(String, PeriodError)>,
}
