//! The spin of a body over many passes: sidereal period, axis, sense and drift, with the turns between passes not counted.
//!
//! In each pass the light repeats at an apparent (synodic) frequency: its phase is f t − n λ(t)/2π with the sidereal frequency f of the light's repetition, the longitude λ of the bisector
//! of Sun and observer about the spin axis ([`crate::synodic`]), and n repetitions of the light to a turn of the body. From pass to pass λ moves otherwise, so that the apparent frequencies differ: by how much is
//! what tells axis and sense, and with them f. A body whose halves look alike has n = 2: its frequencies differ by twice as much.
//!
//! Each pass gives amplitudes of harmonics in stretches of a few turns; an axis turns their phases, and a frequency is found at which they agree. The axes, n, and how far the
//! light is no function of λ (a slip of the phase over a pass), are summed over with their likelihoods; frequency and drift are linear and summed over in closed form. So the intervals of
//! the period hold the axes that fit as well, and both senses where the passes do not tell.

mod chain;
mod posterior;
mod scan;
mod stretches;

pub use posterior::Interval;

use crate::period::{PeriodError, Verdict};
use crate::series::Series;
use crate::synodic::Bisectors;
use glam::DVec3;

/// Passes at least. Frequency, drift and two angles of an axis are four unknowns; each pass has a frequency, and how that bends.
pub const LEAST_PASSES: usize = 3;
/// Share of the likelihood that one answer must have to be told as the only one.
pub const SURE: f64 = 0.99;

/// A pass: light, and how the body was seen.
#[derive(Debug, Clone, PartialEq)]
pub struct SpinPass {
    /// Name for messages.
    pub name: String,
    /// The channels; times in seconds from a moment that all passes share.
    pub series: Vec<Series>,
    /// The bisector of Sun and observer, in the same time.
    pub path: Bisectors,
}

impl SpinPass {
    /// From the first sample to the last of all channels, s.
    fn ends_s(&self) -> (f64, f64) {
        let ends = self.series.iter().flat_map(|s| [s.time_s.first(), s.time_s.last()]).flatten();
        ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| (a.min(*t), b.max(*t)))
    }
}

/// Knowledge of the body's shape.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Body {
    /// Nothing: its light may repeat once or twice a turn.
    #[default]
    Any,
    /// Long, and turning across its length or nearly so, as the stages of rockets do: it shows its side twice a turn, and not four times. Light of which even harmonics have the most has two maxima in its
    /// repetition, and so repeats once a turn. Light of which they have less says nothing: the two ends may be unlike enough to be the strongest. Light in which only even ones are seen says nothing either:
    /// it may as well repeat in half of the time.
    Long,
}

/// Odds that a long body whose even harmonics are clearly the strongest repeats once a turn: of 300 cylinders (synthetic) 233 had that share, and all did but for some whose odd harmonics were not seen, of which a long shape says nothing: at 95 % at least 78 to 1.
/// Bodies whose two ends are alike were not among them.
const LONG_ODDS: f64 = 78.0;
/// Share of the variation in even harmonics, above one half, from which on they are that.
const CLEAR: f64 = 0.1;

impl Body {
    /// Log of the odds of one repetition a turn against two, before the passes' frequencies are asked, for the share of the variation that even harmonics have.
    fn log_odds(self, even: Option<f64>) -> f64 {
        match (self, even) {
            (Self::Any, _) | (_, None) => 0.0,
            (Self::Long, Some(even)) => LONG_ODDS.ln() * ((even - 0.5) / CLEAR).clamp(0.0, 1.0),
        }
    }
}

/// Options of the search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpinOptions {
    /// Bounds of the period in each pass.
    pub search: crate::period::Options,
    /// Standard deviation of the drift that is expected, as a share of the period and day.
    pub drift_per_day: f64,
    /// Knowledge of the body's shape.
    pub body: Body,
}

impl Default for SpinOptions {
    fn default() -> Self {
        Self {
            search: crate::period::Options::default(),
            drift_per_day: 1e-3,
            body: Body::default(),
        }
    }
}

/// Why no spin is told.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NoSpin {
    /// Too few passes have a period of their own.
    #[error(
        "{with} of {of} passes have a period of their own; expected {LEAST_PASSES} passes or more, two of them with one"
    )]
    Passes {
        /// Passes with a period of their own.
        with: usize,
        /// All passes.
        of: usize,
    },
    /// Too few samples in a turn, or too few turns without gaps.
    #[error(
        "{usable} of the {of} passes that agree on a period have three turns with samples enough (nine or more a turn, no gap above a quarter), expected {LEAST_PASSES}"
    )]
    Sampled {
        /// Passes with stretches enough.
        usable: usize,
        /// Passes that agree.
        of: usize,
    },
    /// The passes' periods are no one body's.
    #[error(
        "{agree} of {of} passes agree on a period, within the bisector's turn and the drift: too few"
    )]
    Apart {
        /// Passes that agree.
        agree: usize,
        /// All passes.
        of: usize,
    },
}

/// The spin by one number of repetitions of the light to a turn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spin {
    /// Repetitions of the light to a turn of the body.
    pub repeats: u32,
    /// Share of the likelihood.
    pub share: f64,
    /// Sidereal period at [`SpinFound::epoch_s`], s.
    pub period_s: Interval,
    /// Change of the period, as a share of it and day.
    pub drift_per_day: Interval,
    /// Mean axis (GCRS, unit): the body turns right-handed about it.
    pub axis: DVec3,
    /// The angle from it that holds 95 % of the axes, degrees.
    pub axis_within_deg: f64,
    /// Share of the axes in the same half of the sky as the mean one: how sure the sense is.
    pub sense: f64,
    /// Slip of the phase over a pass beside the model, turns.
    pub slip_turns: f64,
}

impl Spin {
    /// Whether one sense is left.
    pub fn knows_sense(&self) -> bool {
        self.sense >= SURE
    }
}

/// One pass of a spin.
#[derive(Debug, Clone, PartialEq)]
pub struct PassFound {
    /// Name of the pass.
    pub name: String,
    /// The verdict on it alone; its periods are apparent ones.
    pub verdict: Verdict,
    /// The period that passes share, as this one shows it, s, also where too few do; none where it does not, or does not fit.
    pub apparent_s: Option<f64>,
    /// The same by the likeliest spin, s.
    pub model_s: Option<f64>,
    /// The middle of it, s.
    pub middle_s: f64,
}

/// The spin over some passes.
#[derive(Debug, Clone, PartialEq)]
pub struct SpinFound {
    /// The spins by their shares, the likeliest first; those below 1 − [`SURE`] are left out.
    pub spins: Vec<Spin>,
    /// Those of all numbers of repetitions, for a body of which nothing is known.
    all: Vec<Spin>,
    /// Share of the light's variation that the even harmonics of its repetition have, over the passes that are used: 1 where it has two equal maxima, near 0 where it has one. `None` where no pass
    /// bears two harmonics.
    pub even_share: Option<f64>,
    /// Whether odd harmonics stand out of the noise. Where they do not, the light may as well repeat in half of what is taken for its repetition, and a long shape says nothing.
    pub odd_is_seen: bool,
    /// Why there is none.
    pub refused: Option<NoSpin>,
    /// The moment of the periods: the mean of the passes' middles, s.
    pub epoch_s: f64,
    /// Each pass.
    pub passes: Vec<PassFound>,
}

impl SpinFound {
    /// The spin, where the passes leave one.
    pub fn only(&self) -> Option<&Spin> {
        self.spins.first().filter(|s| s.share >= SURE)
    }

    /// The same passes, where that is known of the body.
    #[must_use]
    pub fn knowing(mut self, body: Body) -> Self {
        let odds = body.log_odds(self.even_share.filter(|_| self.odd_is_seen));
        let weigh = |s: &Spin| {
            s.share * if s.repeats == 1 { (0.5 * odds).exp() } else { (-0.5 * odds).exp() }
        };
        let total: f64 = self.all.iter().map(weigh).sum();
        self.spins = self.all.iter().map(|s| Spin { share: weigh(s) / total, ..*s }).collect();
        self.spins.retain(|s| s.share > 1.0 - SURE);
        self.spins.sort_by(|a, b| b.share.total_cmp(&a.share));
        self
    }
}

/// Parts series into passes: what lies less than `gap_s` apart is one, whatever the channel.
pub fn by_pass(mut series: Vec<Series>, gap_s: f64) -> Vec<Vec<Series>> {
    series.retain(|s| !s.is_empty());
    let end = |s: &Series| s.time_s.last().copied().unwrap_or(f64::NEG_INFINITY);
    let first = |s: &Series| s.time_s.first().copied().unwrap_or(f64::INFINITY);
    series.sort_by(|a, b| first(a).total_cmp(&first(b)).then_with(|| a.name.cmp(&b.name)));
    let mut passes: Vec<Vec<Series>> = Vec::new();
    let mut last = f64::NEG_INFINITY;
    for s in series {
        let (from, to) = (first(&s), end(&s));
        match passes.last_mut() {
            Some(pass) if from - last < gap_s => pass.push(s),
            _ => passes.push(vec![s]),
        }
        last = last.max(to);
    }
    passes
}

/// Finds the spin of a body over some passes.
///
/// # Errors
/// Those of [`crate::period::verdict()`]; passes that are too short or constant are named in the result.
pub fn find_spin(passes: &[SpinPass], options: &SpinOptions) -> Result<SpinFound, PeriodError> {
    let (mut found, shown, refused) = chain::of_passes(passes, options)?;
    if refused.is_some() {
        return Ok(found);
    }
    let scans: Vec<scan::Scan> =
        shown.iter().filter_map(|(k, hz)| scan::Scan::new(&passes[*k], *k, *hz)).collect();
    if scans.len() < LEAST_PASSES {
        found.refused = Some(NoSpin::Sampled { usable: scans.len(), of: shown.len() });
        return Ok(found);
    }
    let posterior = posterior::Posterior::new(&scans, options);
    (found.all, found.epoch_s) = (posterior.spins(), posterior.epoch_s);
    let even = scan::even_share(&scans);
    (found.even_share, found.odd_is_seen) = (even.map(|e| e.0), even.is_some_and(|e| e.1));
    found.passes.iter_mut().for_each(|pass| pass.apparent_s = None);
    for scan in &scans {
        let pass = &mut found.passes[scan.number];
        pass.apparent_s = Some(1.0 / scan.apparent_hz());
        pass.model_s = posterior.apparent_s(scan);
    }
    Ok(found.knowing(options.body))
}
