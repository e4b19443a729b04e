//! Whether the tracks of a body, each asked alone, have the period that all have together.

use super::super::stats::chi2_survival;
use super::outcome::{Estimate, Options, Outcome, Verdict};
use super::range::Range;
use super::search::Search;
use super::{LEAST_SAMPLES, centred};
use crate::period::lomb_scargle::Centred;
use crate::series::Series;

/// A track with fewer turns says nothing of its own.
const LEAST_TURNS: f64 = 3.0;
/// Turns by which a track's own period may slip against that of all over its length.
const SLIP: f64 = 1.0;
/// Steps to a resolution of the highest harmonic.
const FINE: f64 = 5.0;
/// A track whose light turns by chance with more than this probability says nothing.
const CHANCE: f64 = 1e-3;
/// Tracks differ where chance makes their periods differ so much with less than this probability.
const DIFFER: f64 = 1e-3;

/// Period of one track.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackPeriod {
    /// Name of the track's first series.
    pub name: String,
    /// Middle of the track, s on the axis of the series.
    pub middle_s: f64,
    /// The period that the track alone has, next to that of all.
    pub estimate: Estimate,
}

/// Periods of the tracks, compared.
#[derive(Debug, Clone, PartialEq)]
pub struct Tracks {
    /// Tracks with a period of their own.
    pub periods: Vec<TrackPeriod>,
    /// Chance that periods which are the same differ so much (χ² of as many degrees of freedom as there are tracks less one).
    pub chance: f64,
}

impl Tracks {
    /// Whether the period changes from track to track.
    pub fn differ(&self) -> bool {
        self.chance < DIFFER
    }

    /// The shortest and the longest period of the tracks, s.
    pub fn from_to_s(&self) -> (f64, f64) {
        let all = || self.periods.iter().map(|p| p.estimate.period_s);
        (all().fold(f64::INFINITY, f64::min), all().fold(0.0, f64::max))
    }
}

/// The period that series of one track have next to a period; `None` where they show none.
fn own(series: &[Series], period_s: f64, options: &Options) -> Option<Estimate> {
    let good = |s: &&Series| s.len() >= LEAST_SAMPLES && Centred::new(s, 1).is_ok();
    let used: Vec<&Series> = series.iter().filter(good).collect();
    let usual = Range::new(&used, options).ok()??;
    let range = match usual.beyond(&used, options) {
        Some((beyond, _)) if usual.limit_hz * period_s < 1.0 => {
            Range { lowest_hz: usual.lowest_hz, ..beyond }
        }
        _ => usual,
    };
    let middle = 1.0 / period_s;
    if range.span_s * middle < LEAST_TURNS || middle > range.limit_hz {
        return None;
    }
    let search = Search { series: &used, range, beyond: None, centred: centred(&used) };
    let most = ((range.limit_hz / middle) as usize).clamp(1, 4);
    // Coarse with few harmonics, which see a track's own period from farther away; then with as many as the data ask for.
    let half = SLIP / range.span_s;
    let step = 1.0 / (FINE * most as f64 * range.span_s);
    let n = (half / step).ceil() as i32;
    let places = (-n..=n).map(|i| middle + f64::from(i) * step).filter(|f| *f > 0.0);
    let scored = places.map(|f| (f, search.gain(f, most)));
    let (near, _) = scored.max_by(|a, b| a.1.total_cmp(&b.1))?;
    if (near - middle).abs() > half - 1.5 * step {
        return None;
    }
    let near = search.refined(near, step, most);
    let harmonics = search.order(near);
    let f = search.refined(near, 0.4 / (harmonics as f64 * range.span_s), harmonics);
    let (channels, samples) = search.independence(f);
    let independent = channels * samples;
    let degrees = (2 * harmonics * used.len()) as f64 * independent;
    let looks = 2.0 * SLIP * FINE * most as f64;
    let chance = looks * chi2_survival(search.gain(f, harmonics) * independent, degrees);
    let estimate = search.estimate(f, harmonics, independent);
    let is_sure = chance < CHANCE && estimate.sigma_s.is_finite() && estimate.sigma_s > 0.0;
    is_sure.then_some(estimate)
}

/// Compares the periods of tracks with that of all, where the verdict has one. Where they differ, the uncertainties of the verdict become so wide that they hold the period of every track. `None` with fewer than two tracks
/// that have a period of their own.
pub fn compared(
    tracks: &[Vec<Series>],
    options: &Options,
    verdict: &mut Verdict,
) -> Option<Tracks> {
    let best = verdict.best?;
    if !matches!(verdict.outcome, Outcome::One(_) | Outcome::Family(_)) {
        return None;
    }
    let mut periods = Vec::new();
    for track in tracks {
        let Some(estimate) = own(track, best.period_s, options) else { continue };
        let from =
            track.iter().filter_map(|s| s.time_s.first()).fold(f64::INFINITY, |a, t| a.min(*t));
        let to =
            track.iter().filter_map(|s| s.time_s.last()).fold(f64::NEG_INFINITY, |a, t| a.max(*t));
        let name = track.first().map(|s| s.name.clone()).unwrap_or_default();
        periods.push(TrackPeriod { name, middle_s: 0.5 * (from + to), estimate });
    }
    if periods.len() < 2 {
        return None;
    }
    let weight = |p: &TrackPeriod| p.estimate.sigma_s.powi(-2);
    let total: f64 = periods.iter().map(weight).sum();
    let mean = periods.iter().map(|p| weight(p) * p.estimate.period_s).sum::<f64>() / total;
    let chi2: f64 = periods.iter().map(|p| weight(p) * (p.estimate.period_s - mean).powi(2)).sum();
    let found = Tracks { chance: chi2_survival(chi2, periods.len() as f64 - 1.0), periods };
    if found.differ() {
        let (from, to) = found.from_to_s();
        let spread = (best.period_s - from).max(to - best.period_s);
        let wider = |e: &mut Estimate| {
            e.sigma_s = e.sigma_s.max(spread * e.period_s / best.period_s);
        };
        verdict.best.iter_mut().for_each(wider);
        match &mut verdict.outcome {
            Outcome::One(e) => wider(e),
            Outcome::Family(members) => members.iter_mut().for_each(|m| wider(&mut m.estimate)),
            _ => {}
        }
    }
    Some(found)
}
