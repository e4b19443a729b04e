//! The sessions of the curves of some files, and their period.

use super::Session;
use super::verdict::{Options, SessionPeriods, SessionsError, search};
use crate::curves::Curves;
use serde::Serialize;
use std::collections::BTreeMap;
use sunglint_formats::text::counted;
use sunglint_numerics::progress::Progress;
use sunglint_radiometry::light_curve::TOLERATED;

/// Speed of light, m/s (exact).
const LIGHT_M_S: f64 = 299_792_458.0;

/// Curves that were searched over their sessions.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct Joined {
    /// The curves.
    #[serde(skip)]
    pub curves: Curves,
    /// The verdict.
    #[serde(flatten)]
    pub found: SessionPeriods,
    /// Moment from which seconds count, UTC.
    pub epoch_utc: String,
    /// Whether the light's way to the observer was taken off the times.
    pub light_time_removed: bool,
    /// Trends that were removed from the light, in words.
    pub removed: Vec<String>,
    /// Name for titles.
    pub title: String,
}

impl Curves {
    /// Whether these curves are sessions whose phase may be kept through the gaps: several files or a column `session`, of a body that is not near ([`Curves::is_near`]). A near
    /// body is seen from other directions pass by pass, so that its turns do not add up.
    pub fn are_sessions(&self) -> bool {
        let sessions: usize = self
            .curves
            .iter()
            .map(|c| match &c.labels {
                Some(labels) => {
                    let mut all: Vec<&str> = labels.iter().map(|l| l.session.as_str()).collect();
                    all.sort_unstable();
                    all.dedup();
                    all.len()
                }
                None => 1,
            })
            .sum();
        sessions > 1 && !self.is_near()
    }
}

/// The sessions of curves: one for each file, channel, session and filter. Rates become magnitudes, whose zero points are free; a rate of 0 or less has none and is left out. Where a curve
/// has ranges, the light's way is taken off its times. Returns whether it was, and how many rates were left out.
pub fn of_curves(curves: &Curves) -> (Vec<Session>, bool, usize) {
    let (mut all, mut lost) = (Vec::new(), 0);
    let has_ranges = |c: &crate::curves::NamedCurve| c.curve.samples.range_m.is_some();
    // Of some without it, the others' would part their phases.
    let removes = !curves.curves.is_empty() && curves.curves.iter().all(has_ranges);
    let several = curves.curves.len() > 1;
    for named in &curves.curves {
        let curve = &named.curve;
        let is_parted = !named.filters().is_empty();
        let asked: Vec<_> =
            curve.channels.iter().filter(|c| is_parted || curves.asks_for(&c.name)).collect();
        for channel in &asked {
            let mut by_label: BTreeMap<(String, String), Session> = BTreeMap::new();
            for i in 0..curve.len() {
                if !channel.flags[i].difference(TOLERATED).is_empty() {
                    continue;
                }
                if is_parted
                    && named.labels.as_ref().is_some_and(|l| !curves.asks_for(&l[i].filter))
                {
                    continue;
                }
                let rate = channel.rate_hz[i];
                if !(rate.is_finite() && rate > 0.0) {
                    lost += 1;
                    continue;
                }
                let label = named.labels.as_ref().map(|l| &l[i]);
                let session = label.map_or_else(String::new, |l| l.session.clone());
                let filter = label.map_or_else(|| channel.name.clone(), |l| l.filter.clone());
                let range_m =
                    curve.samples.range_m.as_ref().filter(|_| removes).map_or(0.0, |r| r[i]);
                let time_s =
                    (curve.samples.time[i] - curves.zero).to_seconds() - range_m / LIGHT_M_S;
                let own = by_label.entry((session, filter)).or_default();
                own.time_s.push(time_s);
                own.magnitude.push(-2.5 * rate.log10());
            }
            let filters: std::collections::BTreeSet<&String> =
                by_label.keys().map(|k| &k.1).collect();
            let names_filter = filters.len() > 1 || asked.len() > 1;
            let named_all: Vec<String> = by_label
                .keys()
                .map(|(session, filter)| {
                    let parts = [
                        if several || session.is_empty() { named.stem.as_str() } else { "" },
                        session.as_str(),
                        if names_filter { filter.as_str() } else { "" },
                    ];
                    let parts: Vec<&str> = parts.into_iter().filter(|p| !p.is_empty()).collect();
                    parts.join(" ")
                })
                .collect();
            all.extend(
                by_label.into_values().zip(named_all).map(|(s, name)| Session { name, ..s }),
            );
        }
    }
    all.sort_by(|a, b| {
        let first = |s: &Session| s.time_s.iter().copied().fold(f64::INFINITY, f64::min);
        first(a).total_cmp(&first(b)).then_with(|| a.name.cmp(&b.name))
    });
    (all, removes, lost)
}

/// Looks for the period of curves over their sessions.
///
/// # Errors
/// The errors of [`search`].
pub fn find_over_sessions(
    curves: Curves,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Joined, SessionsError> {
    let (sessions, light_time_removed, lost) = of_curves(&curves);
    let mut found = search(&sessions, options, progress)?;
    let mut warnings = curves.warnings.clone();
    if lost > 0 {
        warnings.push(format!(
            "{} without light above 0, and so without a magnitude: left out",
            counted(lost, "sample")
        ));
    }
    warnings.append(&mut found.warnings);
    found.warnings = warnings;
    Ok(Joined {
        epoch_utc: sunglint_formats::time::format_utc(curves.zero, 3),
        removed: curves.removed.clone(),
        title: curves.title(),
        light_time_removed,
        found,
        curves,
    })
}
