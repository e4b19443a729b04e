//! The period that passes share: each shows an apparent one, or a family.

use super::{LEAST_PASSES, NoSpin, PassFound, SpinFound, SpinOptions, SpinPass};
use crate::period::verdict::{Estimate, Membership, Outcome};
use crate::period::{PeriodError, verdict};
use rayon::prelude::*;

/// Beyond the bound of an axis across the bisector: others see it turn faster.
const STEEP: f64 = 1.5;
/// Standard deviations of a period, and of the drift.
const WITHIN: f64 = 3.0;
/// Two periods further apart than this share are never the same.
const MOST: f64 = 0.2;
/// A pass that shows half of a period speaks for it by this much: its halves may look alike there.
const OF_HALF: f64 = 0.5;
/// A pass whose best period is no answer speaks for a period by this much.
const OF_REFUSED: f64 = 0.5;
/// Share of the passes with a period that must agree.
const AGREE: f64 = 0.6;
const DAY_S: f64 = 86_400.0;

/// A period that a pass may have.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    period_s: f64,
    sigma_s: f64,
    /// Weight with which it speaks for its period.
    weight: f64,
}

/// The passes that show the shared period, with the apparent frequency, Hz.
type Shown = Vec<(usize, f64)>;

/// Asks each pass, and finds what they share: the passes that show it, and why they are no answer where they are none. The passes that are found hold what they show.
pub fn of_passes(
    passes: &[SpinPass],
    options: &SpinOptions,
) -> Result<(SpinFound, Shown, Option<NoSpin>), PeriodError> {
    let asked = passes.par_iter().map(|pass| {
        let verdict = verdict(&pass.series, &options.search)?;
        let (first, last) = pass.ends_s();
        let middle_s = 0.5 * (first + last);
        Ok(PassFound {
            name: pass.name.clone(),
            verdict,
            apparent_s: None,
            model_s: None,
            middle_s,
        })
    });
    let mut found: Vec<PassFound> = asked.collect::<Result<_, PeriodError>>()?;
    let candidates: Vec<Vec<Candidate>> = found.iter().map(of_pass).collect();
    let (shown, refused) = shared(passes, &found, &candidates, options);
    for (k, hz) in &shown {
        found[*k].apparent_s = Some(1.0 / hz);
    }
    let all = SpinFound {
        spins: Vec::new(),
        all: Vec::new(),
        even_share: None,
        odd_is_seen: false,
        refused,
        epoch_s: 0.0,
        passes: found,
    };
    Ok((all, shown, refused))
}

fn of_pass(found: &PassFound) -> Vec<Candidate> {
    let one = |e: &Estimate, weight: f64| Candidate {
        period_s: e.period_s,
        sigma_s: if e.sigma_s.is_finite() { e.sigma_s } else { 0.0 },
        weight,
    };
    match &found.verdict.outcome {
        Outcome::One(e) => vec![one(e, 1.0)],
        // Folded periods are those of a sampling, not of a body: passes of one sampling all have them.
        Outcome::Family(members) => members
            .iter()
            .filter(|m| !matches!(m.membership, Membership::Folded(_)))
            .map(|m| one(&m.estimate, 1.0))
            .collect(),
        Outcome::NotEnough(_) | Outcome::Two(..) => {
            found.verdict.best.iter().map(|e| one(e, OF_REFUSED)).collect()
        }
    }
}

/// The period on which most passes agree.
fn shared(
    passes: &[SpinPass],
    found: &[PassFound],
    candidates: &[Vec<Candidate>],
    options: &SpinOptions,
) -> (Shown, Option<NoSpin>) {
    // How far the period of another pass may be from one, relative.
    let room = |period_s: f64, from: usize, k: usize, sigma_s: f64| {
        let bound = passes[k].path.bounds(period_s).fastest_deg_s / 360.0
            + passes[from].path.bounds(period_s).fastest_deg_s / 360.0;
        let days = (found[k].middle_s - found[from].middle_s).abs() / DAY_S;
        (STEEP * bound * period_s
            + WITHIN * (sigma_s / period_s).hypot(options.drift_per_day * days))
        .min(MOST)
    };
    let near = |c: &Candidate, from: usize, k: usize, times: f64| {
        candidates[k]
            .iter()
            .filter(|m| {
                let off = (times * m.period_s / c.period_s - 1.0).abs();
                off <= room(c.period_s, from, k, c.sigma_s.hypot(times * m.sigma_s))
            })
            .min_by(|a, b| {
                let off = |m: &Candidate| (times * m.period_s / c.period_s - 1.0).abs();
                off(a).total_cmp(&off(b))
            })
            .copied()
    };
    let mut best: Option<(f64, usize, Candidate)> = None;
    for (from, of_pass) in candidates.iter().enumerate() {
        for c in of_pass.iter().filter(|c| c.weight >= 1.0) {
            let score: f64 = (0..passes.len())
                .map(|k| match near(c, from, k, 1.0) {
                    Some(m) => m.weight,
                    None => near(c, from, k, 2.0).map_or(0.0, |m| OF_HALF * m.weight),
                })
                .sum();
            // As many passes for a shorter one: the longer is its multiple.
            let better = best.is_none_or(|(most, _, b)| {
                score > most + 1e-9 || (score > most - 1e-9 && c.period_s < 0.75 * b.period_s)
            });
            if better {
                best = Some((score, from, *c));
            }
        }
    }
    let answers = |c: &Vec<Candidate>| c.iter().any(|c| c.weight >= 1.0);
    let with = candidates.iter().filter(|c| answers(c)).count();
    let Some((score, from, c)) = best.filter(|_| passes.len() >= LEAST_PASSES) else {
        return (Vec::new(), Some(NoSpin::Passes { with, of: passes.len() }));
    };
    let shown: Shown = (0..passes.len())
        .filter_map(|k| {
            let whole = near(&c, from, k, 1.0).map(|m| m.period_s);
            let period_s = whole.or_else(|| near(&c, from, k, 2.0).map(|m| 2.0 * m.period_s))?;
            Some((k, 1.0 / period_s))
        })
        .collect();
    let of = passes.len();
    let refused = if with < 2 {
        Some(NoSpin::Passes { with, of })
    } else if score < AGREE * with as f64 || shown.len() < LEAST_PASSES {
        Some(NoSpin::Apart { agree: shown.len(), of })
    } else {
        None
    };
    (shown, refused)
}
