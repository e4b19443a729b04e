//! Several curves: which come first, and how the turns between them are counted.

use super::AttitudeError;
use super::descent::{Found, Space};
use super::first::{CARRIED, FIRST, SECOND};
use super::hunt::{Hunt, spread_out};
use super::state::{Law, State};
use rayon::prelude::*;

impl Hunt<'_> {
    /// Curves by their number of epochs, the longest first.
    pub(super) fn order(&self) -> Vec<usize> {
        let mut count: Vec<(usize, usize)> = Vec::new();
        for m in &self.forward.moments {
            match count.get_mut(m.curve) {
                Some(own) => own.1 += 1,
                None => {
                    (count.len()..=m.curve).for_each(|c| count.push((c, 0)));
                    count[m.curve].1 += 1;
                }
            }
        }
        count.retain(|c| c.1 > 0);
        count.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
        count.into_iter().map(|c| c.0).collect()
    }

    /// The moments of some curves.
    pub(super) fn moments_of(&self, curves: &[usize]) -> Vec<usize> {
        let all = 0..self.forward.moments.len();
        all.filter(|m| curves.contains(&self.forward.moments[*m].curve)).collect()
    }

    /// The law about the middle of some moments.
    pub(super) fn law_about(&self, law: &Law, moments: &[usize]) -> Law {
        let times = moments.iter().map(|m| self.forward.moments[*m].time_s);
        let (first, last) =
            times.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| (a.min(t), b.max(t)));
        law.about(0.5 * (first + last), 0.5 * (last - first))
    }

    /// Minima of some curves, given those of all but the last: the period is known by the span of the former, and its error lets the turns of the last be counted in several ways.
    pub(super) fn extended(
        &self,
        curves: &[usize],
        minima: Vec<Found>,
        before: &Law,
        warnings: &mut Vec<String>,
    ) -> Result<(Vec<Found>, Law), AttitudeError> {
        const MOST_WAYS: usize = 4000;
        const KEPT_WAYS: usize = 6;
        let own = self.moments_of(curves);
        let law = self.law_about(before, &own);
        let added = self.moments_of(&curves[curves.len() - 1..]);
        let few = spread_out(&added, FIRST, self.options.seed);
        let more = spread_out(&own, SECOND * curves.len().min(4), self.options.seed + 2);
        let space = Space::Logarithms { spread: 0.15 };
        let unknowns = self.question.unknowns;
        let mut starts = Vec::new();
        for found in &minima {
            let mut ways = vec![found.state];
            if unknowns.period {
                let covariance = found.normal.clone().try_inverse();
                let last = unknowns.count() - 1;
                let sigma = covariance.map_or(f64::INFINITY, |c| c[(last, last)].max(0.0).sqrt());
                // Four standard uncertainties, and what a model that is not perfect adds.
                let reach = (4.0 * sigma + 0.02) / (std::f64::consts::TAU * before.half_span_s);
                let furthest = added
                    .iter()
                    .map(|m| (self.forward.moments[*m].time_s - before.middle_s).abs())
                    .fold(0.0, f64::max);
                let step = 0.03 / furthest.max(1e-3);
                let count = (reach / step).ceil() as usize;
                if count > MOST_WAYS {
                    let text = format!(
                        "{} turns more or less fit between the passes: only the nearest {MOST_WAYS} to each side were tried",
                        count as f64 * 0.03
                    );
                    if !warnings.contains(&text) {
                        warnings.push(text);
                    }
                }
                let count = count.min(MOST_WAYS) as i64;
                let descent = self.descent(before, &few, space);
                let tried: Result<Vec<(f64, State)>, AttitudeError> = (-count..=count)
                    .into_par_iter()
                    .map_init(
                        || self.forward.eye(),
                        |eye, k| {
                            let turns_per_s = found.state.turns_per_s + k as f64 * step;
                            let state = State { turns_per_s, ..found.state };
                            Ok((descent.cost(eye, &state)?, state))
                        },
                    )
                    .collect();
                let mut tried = tried?;
                tried.sort_by(|a, b| a.0.total_cmp(&b.0));
                ways = tried.into_iter().take(KEPT_WAYS).map(|t| t.1).collect();
            }
            starts.extend(ways.iter().map(|s| before.carried(s, &law)));
        }
        let space = Space::Logarithms { spread: 0.05 };
        let mut minima = self.descend(&law, &more, space, &starts, 25, "further passes")?;
        minima.truncate(CARRIED);
        Ok((minima, law))
    }
}
