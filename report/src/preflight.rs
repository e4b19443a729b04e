//! Pre-flight of a night as a table.

use std::fmt::Write as _;
use sunglint_formats::text::plain;
use sunglint_observatory::planner::NightPlan;
use sunglint_observatory::{Level, Preflight};

/// Returns the findings, one a line, the worst first, and how many there are of each kind.
pub fn text(found: &Preflight) -> String {
    let width = found.findings.iter().map(|f| f.about.chars().count()).max().unwrap_or(0);
    let mut text = String::new();
    let mut counts = Vec::new();
    for (level, word) in
        [(Level::Error, "ERROR"), (Level::Warning, "warning"), (Level::Fine, "fine")]
    {
        for finding in found.of(level) {
            let (about, said) = (plain(&finding.about), plain(&finding.text));
            let _ = writeln!(text, "{word:<8}{about:<width$}  {said}");
        }
        counts.push(format!("{} {}", found.of(level).count(), word.to_lowercase()));
    }
    text + &counts.join(", ")
}

/// Returns the visits of a planned night, one a line, and what is not in it.
pub fn plan_text(plan: &NightPlan) -> String {
    let width = plan.visits.iter().map(|v| plain(&v.name).chars().count()).max().unwrap_or(0);
    let mut text = format!("{:<20}  {:>6}  {:<width$}    V  altitude\n", "from (UTC)", "s", "what");
    for visit in &plan.visits {
        let number = |value: Option<f64>, digits: usize| {
            value.map_or("-".to_owned(), |value| format!("{value:.digits$}"))
        };
        let (from, for_s) = (&visit.from_utc, visit.for_s);
        let (v, altitude) = (number(visit.v_mag, 1), number(visit.altitude_deg, 0));
        let what = plain(&visit.name);
        let _ = writeln!(text, "{from:<20}  {for_s:>6.0}  {what:<width$}  {v:>4}  {altitude:>8}");
    }
    const MOST: usize = 8;
    for left_out in plan.left_out.iter().take(MOST) {
        let _ = writeln!(text, "left out: {}", plain(left_out));
    }
    if let Some(more) = plan.left_out.len().checked_sub(MOST).filter(|more| *more > 0) {
        let _ = writeln!(text, "left out: {more} more passes");
    }
    text
}
