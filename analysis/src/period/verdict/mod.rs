//! The verdict: one period, a family of which the data cannot choose, or not enough data.
//!
//! The highest peak of a periodogram is rarely the period of a turning body: two like sides give half of it, a glint a third. So the highest peak is only where the search
//! begins. From there the period is made longer as long as twice, three, five or seven times it explains lines that it does not (see the module `lines`), and shorter as long as
//! nothing is lost. What is left is the smallest period that its multiples do not better; phase dispersion is asked the same by an F test. Where an answer is neither
//! yes nor no, both periods are members of a family, with what would decide.
//!
//! Even samples show f and |n f_s ± f| alike. Exposures that are known tell some of these apart: what turns in less than two of them, or has a harmonic that turns in less than 1.1 of them, is averaged away. The others are members. Where exposures
//! are not known they are presumed to fill the time between samples, and the verdict says so. Where many harmonics stand out, or some leave a line or do not keep step, two periods at once are asked for (module `two`).

mod change;
mod clock;
mod judge;
mod outcome;
mod range;
mod rivals;
mod search;
mod tracks;
mod two;

pub use clock::{Along, Clock, verdict_along};
pub use outcome::{
    Estimate, Folding, Member, Membership, Options, Outcome, Question, Reason, Uneven, Verdict,
};
pub use search::SEARCHED;
pub use tracks::{TrackPeriod, Tracks, compared};

use super::PeriodError;
use super::lomb_scargle::Centred;
use crate::series::Series;
use range::Range;
use search::Search;

/// Fewer samples than that are refused.
const LEAST_SAMPLES: usize = 12;

/// Gives the verdict on all series at once: a period that they share, with curves of their own.
///
/// # Errors
/// A range of periods that is none, or needs more frequencies than can be looked at.
pub fn verdict(series: &[Series], options: &Options) -> Result<Verdict, PeriodError> {
    verdict_of(series, options, true)
}

/// The same; where `is_wide` is false, in the usual range of even samples.
fn verdict_of(series: &[Series], options: &Options, is_wide: bool) -> Result<Verdict, PeriodError> {
    let mut answer = Verdict {
        outcome: Outcome::NotEnough(Reason::Constant),
        best: None,
        harmonics: 0,
        false_alarm: None,
        beside: None,
        questions: Vec::new(),
        peaks: Vec::new(),
        searched_s: None,
        uneven: None,
        window_peaks: Vec::new(),
        folding: None,
        drift_turns: 0.0,
        independent_channels: 0.0,
        independent_samples: 1.0,
        left_out: Vec::new(),
    };
    let mut used = Vec::new();
    for s in series {
        let checked = if s.len() < LEAST_SAMPLES {
            let (name, samples) = (s.name.clone(), s.len());
            Err(PeriodError::Samples { name, samples, harmonics: (LEAST_SAMPLES - 2) / 2 })
        } else {
            Centred::new(s, 1).map(|_| ())
        };
        match checked {
            Ok(()) => used.push(s),
            Err(error) => answer.left_out.push((s.name.clone(), error)),
        }
    }
    if used.is_empty() {
        let samples = series.iter().map(Series::len).max().unwrap_or(0);
        let is_short = samples < LEAST_SAMPLES;
        let least = LEAST_SAMPLES;
        answer.outcome = Outcome::NotEnough(if is_short {
            Reason::Samples { samples, least }
        } else {
            Reason::Constant
        });
        return Ok(answer);
    }
    let Some(range) = Range::new(&used, options)? else {
        answer.outcome = Outcome::NotEnough(Range::reason(&used, options));
        return Ok(answer);
    };
    let (beyond, uneven) = range.beyond(&used, options).filter(|_| is_wide).unzip();
    let highest_hz = beyond.map_or(range.highest_hz, |beyond: Range| beyond.highest_hz);
    answer.searched_s = Some((1.0 / highest_hz, 1.0 / range.lowest_hz));
    answer.uneven = uneven;
    Search { series: &used, range, beyond, centred: centred(&used) }.run(&mut answer)?;
    if let Outcome::NotEnough(_) = answer.outcome
        && let Some(reason) = rounded_away(&used)
    {
        // Constant light has no best period either.
        (answer.outcome, answer.best) = (Outcome::NotEnough(reason), None);
    }
    Ok(answer)
}

/// Constant light, where no channel scatters by more than its rounding.
fn rounded_away(series: &[&Series]) -> Option<Reason> {
    let all: Option<Vec<(f64, f64)>> = series.iter().map(|s| s.rounded_away()).collect();
    let (scatter_mag, step_mag) = all?.into_iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(Reason::Rounded { scatter_mag, step_mag })
}

fn centred<'a>(series: &[&'a Series]) -> Vec<Centred<'a>> {
    series.iter().filter_map(|s| Centred::new(s, 1).ok()).collect()
}
