//! The period of light curves: the verdict as text, JSON and table, and the periodograms as a figure.

mod figure;
pub mod sessions;

pub use figure::figure;

use crate::{Product, json_of, rounded};
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_analysis::map::longitude_latitude;
use sunglint_analysis::period::verdict::{
    Along, Estimate, Member, Membership, Outcome, Question, Verdict,
};
use sunglint_analysis::period::{FlashTrain, FoundPeriod};
use sunglint_formats::text::counted;
use sunglint_formats::{Column, Table};
use sunglint_radiometry::light_curve::Input;

/// A period to the second digit of its uncertainty.
fn with_sigma(e: &Estimate) -> String {
    if !(e.sigma_s.is_finite() && e.sigma_s > 0.0) {
        return format!("{:.6} s (uncertainty not known)", e.period_s);
    }
    let digits = (1.0 - e.sigma_s.log10().floor()).clamp(0.0, 12.0) as usize;
    format!("{:.digits$} ± {:.digits$} s", e.period_s, e.sigma_s)
}

fn percent(share: f64) -> String {
    if share < 0.1 { format!("{:.1} %", 100.0 * share) } else { format!("{:.0} %", 100.0 * share) }
}

/// All forms of the result.
pub fn product(found: &FoundPeriod) -> Product {
    Product {
        name: "period".into(),
        table: table(found),
        figure: figure(found),
        json: json(found),
        ..Product::default()
    }
}

/// Text of the verdict.
pub fn text(found: &FoundPeriod) -> String {
    let mut text = String::new();
    let v = &found.verdict;
    match &v.outcome {
        Outcome::One(e) => {
            let _ = writeln!(text, "verdict   one period: {}", with_sigma(e));
        }
        Outcome::Family(members) => {
            let _ = writeln!(text, "verdict   a family of periods: the data do not choose");
            for member in members {
                let _ = writeln!(
                    text,
                    "          {}, {:.1} turns: {}",
                    with_sigma(&member.estimate),
                    member.turns,
                    why(found, member)
                );
            }
        }
        Outcome::Two(first, second) => {
            let _ = writeln!(
                text,
                "verdict   two periods at once: {} and {} (a body that tumbles, or the light of two)",
                with_sigma(first),
                with_sigma(second)
            );
        }
        Outcome::NotEnough(reason) => {
            let _ = writeln!(text, "verdict   not enough data: {reason}");
        }
        _ => {}
    }
    if let Some(words) = folding(v) {
        let _ = writeln!(text, "sampling  {words}");
    }
    if let Some(best) = v.best.as_ref().filter(|_| !matches!(v.outcome, Outcome::Two(..))) {
        let span = found.series.iter().map(|s| s.span_s()).fold(0.0, f64::max);
        let by = match found.flashes.as_ref().filter(|f| f.decides) {
            Some(f) => format!("by {} phases at which it flashes", f.phases.len()),
            None if v.harmonics == 1 => "1 harmonic stands out".to_owned(),
            None => format!("{} harmonics stand out", v.harmonics),
        };
        let turns = span / best.period_s;
        let _ = writeln!(text, "best      {}: {turns:.2} turns, {by}", with_sigma(best));
    }
    if let (Some(alarm), beside) = (v.false_alarm, v.beside) {
        let beside = beside.map_or("not known, too few turns".to_owned(), small);
        let _ = writeln!(
            text,
            "chance    that noise does as well: {} (white noise, correlation counted), {beside} (noise as beside its harmonics)",
            bound(alarm)
        );
    }
    if let Some(f) = &found.flashes {
        let _ = writeln!(text, "flashes   {}", flashes(f));
    }
    let by_flashes = found.flashes.as_ref().is_some_and(|f| f.decides);
    for q in &v.questions {
        let told = if by_flashes { of_flashes(q) } else { words(q) };
        let _ = writeln!(text, "question  {told}");
    }
    if let Some((shortest, longest)) = v.searched_s {
        let _ = writeln!(text, "searched  periods from {shortest:.5} s to {longest:.5} s");
    }
    for (harmonics, period, gain) in &v.peaks {
        let of = counted(*harmonics, "harmonic");
        let _ = writeln!(
            text,
            "peak      of {of}, all channels: {period:.6} s, gains {gain:.1} in 2 ln L"
        );
    }
    for (frequency, height) in v.window_peaks.iter().take(3) {
        let _ = writeln!(
            text,
            "sampling  repeats every {:.5} s ({} of its spectrum at 0): f and {frequency:.5} Hz ± f look alike",
            1.0 / frequency,
            percent(*height)
        );
    }
    if v.drift_turns > 0.0 {
        let _ = writeln!(
            text,
            "changing  parts of a turn go ahead of others, or light comes and goes: the phase may drift by {:.2} of a turn from the first sample to the last (one standard deviation), which is in the uncertainty",
            v.drift_turns
        );
    }
    let _ = writeln!(
        text,
        "channels  {} with {}, worth {:.1} independent ones; {} of the samples are independent",
        found.drawn.len(),
        counted(found.series.iter().map(|s| s.len()).sum::<usize>(), "sample"),
        v.independent_channels / found.along.as_ref().map_or(1.0, |a| a.stretches as f64),
        percent(v.independent_samples)
    );
    if let Some(tracks) = &found.tracks {
        let (from, to) = tracks.from_to_s();
        let (n, alike) = (tracks.periods.len(), if tracks.differ() { "differ" } else { "agree" });
        let _ = writeln!(
            text,
            "tracks    {n} with a period of their own, from {from:.5} s to {to:.5} s: they {alike} (chance {})",
            small(tracks.chance)
        );
    }
    let removed = if found.curves.removed.is_empty() {
        "nothing".to_owned()
    } else {
        found.curves.removed.join(", ")
    };
    let _ = writeln!(text, "removed   {removed}");
    if let Some(a) = &found.along {
        let (axis, c) = (axis_deg(a), a.clock);
        let _ = writeln!(
            text,
            "along     {}; a clock that goes with the body (axis at RA {:.0}°, Dec {:+.0}°) bends by up to {:.3} of a turn; on even time {} more is left",
            stretches(a.stretches, a.way_deg),
            axis.0,
            axis.1,
            c.bend_turns,
            percent(a.even_share)
        );
        let _ = writeln!(
            text,
            "spin      the periods above are the spin's own (sidereal): the best from {:.5} s to {:.5} s, about axes whose clocks fit as well ({} of the sky)",
            a.sidereal_s.0,
            a.sidereal_s.1,
            percent(a.alike)
        );
    }
    if let (Some(s), None) = (&found.sidereal, &found.along) {
        let _ = writeln!(
            text,
            "sidereal  the bisector of Sun and station moves by up to {:.4} deg/s, {:.1} deg in all: the spin's period is between {:.5} s and {:.5} s (axis across the bisector; further apart near the axis)",
            s.fastest_deg_s, s.moved_deg, s.from_to_s.0, s.from_to_s.1
        );
    }
    text
}

/// Flashes, and how they fall together.
fn flashes(f: &FlashTrain) -> String {
    let mut text = format!(
        "{} in {} of the samples",
        if f.flashes == 1 { "1 flash".to_owned() } else { format!("{} flashes", f.flashes) },
        percent(f.lit)
    );
    if let Some(refusal) = f.refusal {
        return format!("{text}: {refusal}");
    }
    let Some(best) = f.best else { return text };
    let phases: Vec<String> = f
        .phases
        .iter()
        .map(|p| format!("{:.3} ({} of {} turns)", p.phase, p.flashed, p.seen))
        .collect();
    let _ = write!(
        text,
        "; {} of them fall together within {:.4} s on {} at phases {}",
        percent(f.held),
        f.width_s,
        with_sigma(&best),
        phases.join(", ")
    );
    if let Some(chance) = f.chance {
        let _ =
            write!(text, "; displaced at random they would with a chance {}", chance_words(chance));
    }
    text
}

/// Chances below this are no numbers to read: the floats end there.
const LEAST_CHANCE: f64 = 1e-300;

/// A chance in words.
fn small(chance: f64) -> String {
    if chance < LEAST_CHANCE { "below 1e-300".into() } else { format!("{chance:.1e}") }
}

/// The bound of a chance in words.
fn bound(chance: f64) -> String {
    if chance < LEAST_CHANCE { small(chance) } else { format!("at most {chance:.1e}") }
}

/// A chance that is not read below one in a million.
fn chance_words(chance: f64) -> String {
    if chance <= 1e-6 { "below 1e-6".into() } else { format!("of {chance:.1e}") }
}

/// A question that flashes answered.
fn of_flashes(q: &Question) -> String {
    let answer = match (q.chance, q.unlike) {
        (Some(c), _) if c < 1e-6 => "the flashes differ (chance below 1e-6)".into(),
        (Some(c), Some(u)) => {
            format!("no sure difference (chance {c:.1e}), turns alike within {}", percent(u))
        }
        _ => "too few turns to tell".into(),
    };
    format!("do flashes ask for {:.5} s more than for {:.5} s? {answer}", q.longer_s, q.shorter_s)
}

fn why(found: &FoundPeriod, member: &Member) -> String {
    let train = found.flashes.as_ref().filter(|f| f.decides);
    if let (Some(_), Membership::Multiple(n)) = (train, member.membership) {
        return format!(
            "{n} times the best: flashes that are alike do not say how many like mirrors the body has; stronger flashes or more turns may"
        );
    }
    let question = |longer: f64, shorter: f64| {
        let near = |a: f64, b: f64| (a - b).abs() < 0.05 * b;
        found
            .verdict
            .questions
            .iter()
            .find(|q| near(q.longer_s, longer) && near(q.shorter_s, shorter))
    };
    let best = found.verdict.best.map_or(f64::NAN, |b| b.period_s);
    let period = member.estimate.period_s;
    match member.membership {
        Membership::Best if has_shorter(found) => "fits best".into(),
        Membership::Best => "the smallest that fits".into(),
        Membership::Folded(n) => {
            let folding = found.verdict.folding;
            let (step, exposure) = folding.map_or((f64::NAN, None), |f| (f.step_s, f.exposure_s));
            format!(
                "samples every {step:.4} s show it as the best ({n} turns more or less from sample to sample), and exposures of {:.4} s do not rule it out: uneven or shorter steps would",
                exposure.unwrap_or(0.0)
            )
        }
        // Four times the best stand against twice.
        Membership::Multiple(n) => match question(period, if n == 4 { 2.0 * best } else { best }) {
            Some(Question { chance: None, .. }) => {
                format!(
                    "{n} times the best: too few turns to tell; data over {:.0} s would",
                    8.0 * period
                )
            }
            Some(Question { unlike: Some(u), .. }) => format!(
                "{n} times the best: successive turns may differ by up to {} of the light; less noise or more turns would tell",
                percent(*u)
            ),
            _ => format!("{n} times the best: neither there nor ruled out; more turns would tell"),
        },
        Membership::Part(q) => {
            format!(
                "1/{q} of the best: may be enough; more turns would show whether its turns differ"
            )
        }
        Membership::Flashes => "asked for by the flashes, not by the harmonics".into(),
        Membership::Second => "or one of two periods at once, which explain the light as well as one period of light that changes: more turns would tell".into(),
        Membership::Alias => "another peak, nearly as high; samples in the gaps would tell".into(),
        _ => String::new(),
    }
}

/// Whether a family has a period below its best one.
fn has_shorter(found: &FoundPeriod) -> bool {
    let Outcome::Family(members) = &found.verdict.outcome else { return false };
    let best = found.verdict.best.map_or(0.0, |b| b.period_s);
    members.iter().any(|m| m.estimate.period_s < 0.99 * best)
}

/// What even sampling leaves open beside the members, or what is presumed of the exposures.
fn folding(v: &Verdict) -> Option<String> {
    if !matches!(v.outcome, Outcome::One(_) | Outcome::Family(_)) {
        return None;
    }
    let f = v.folding?;
    match f.exposure_s {
        None => Some(format!(
            "every {:.5} s, of exposures that are not known: they are presumed to fill that time, so that nothing faster is possible",
            f.step_s
        )),
        Some(exposure) if f.unnamed > 0 => Some(format!(
            "every {:.5} s with exposures of {exposure:.5} s: {} more periods down to {:.5} s are possible by it",
            f.step_s, f.unnamed, f.shortest_s
        )),
        Some(_) => None,
    }
}

#[derive(Serialize)]
struct EstimateJson {
    period_s: f64,
    sigma_s: f64,
}

#[derive(Serialize)]
struct MemberJson {
    period_s: f64,
    sigma_s: f64,
    turns: Option<f64>,
    why: String,
}

#[derive(Serialize)]
struct PeriodJson<'a> {
    verdict: &'a str,
    periods: Vec<MemberJson>,
    reason: Option<String>,
    best: Option<EstimateJson>,
    harmonics: usize,
    false_alarm: Option<f64>,
    chance_beside: Option<f64>,
    questions: Vec<QuestionJson>,
    peaks: Vec<PeakJson>,
    searched_s: Option<[f64; 2]>,
    window_peaks: Vec<WindowPeak>,
    independent_channels: f64,
    independent_samples: f64,
    sidereal: Option<SiderealJson>,
    along: Option<AlongJson>,
    changing: bool,
    drift_turns: f64,
    folding: Option<FoldingJson>,
    tracks: Option<TracksJson<'a>>,
    flashes: Option<FlashesJson>,
    channels: Vec<ChannelJson<'a>>,
    removed: &'a [String],
    warnings: &'a [String],
    inputs: &'a [Input],
}

#[derive(Serialize)]
struct QuestionJson {
    longer_s: f64,
    shorter_s: f64,
    chance: Option<f64>,
    unlike: Option<f64>,
    dispersion_chance: Option<f64>,
}

#[derive(Serialize)]
struct PeakJson {
    harmonics: usize,
    period_s: f64,
    gain: f64,
}

#[derive(Serialize)]
struct WindowPeak {
    frequency_hz: f64,
    height: f64,
}

#[derive(Serialize)]
struct SiderealJson {
    fastest_deg_s: f64,
    moved_deg: f64,
    from_to_s: [f64; 2],
}

#[derive(Serialize)]
struct AlongJson {
    stretches: usize,
    way_deg: f64,
    ra_deg: f64,
    dec_deg: f64,
    synodic_s: f64,
    bend_turns: f64,
    even_share: f64,
    sidereal_s: [f64; 2],
    sky_share: f64,
}

#[derive(Serialize)]
struct FoldingJson {
    step_s: f64,
    exposure_s: Option<f64>,
    presumes_full_exposures: bool,
    unnamed: usize,
    shortest_s: f64,
}

#[derive(Serialize)]
struct TracksJson<'a> {
    chance: f64,
    periods: Vec<TrackPeriod<'a>>,
}

#[derive(Serialize)]
struct TrackPeriod<'a> {
    name: &'a str,
    middle_s: f64,
    period_s: f64,
    sigma_s: f64,
}

#[derive(Serialize)]
struct FlashesJson {
    flashes: usize,
    lit: f64,
    held: f64,
    width_s: f64,
    decides: bool,
    best: Option<EstimateJson>,
    chance: Option<f64>,
    periods: Vec<FlashPeriod>,
    phases: Vec<PhaseJson>,
}

#[derive(Serialize)]
struct FlashPeriod {
    period_s: f64,
    sigma_s: f64,
    turns: f64,
}

#[derive(Serialize)]
struct PhaseJson {
    phase: f64,
    seen: usize,
    flashed: usize,
    strength: f64,
}

#[derive(Serialize)]
struct ChannelJson<'a> {
    name: &'a str,
    samples: usize,
    flagged: usize,
    not_finite: usize,
    same_time: usize,
    alone: usize,
}

/// Summary with its documented keys.
pub fn json(found: &FoundPeriod) -> Value {
    let v = &found.verdict;
    let estimate =
        |e: &Estimate| EstimateJson { period_s: rounded(e.period_s), sigma_s: rounded(e.sigma_s) };
    let outcome = match &v.outcome {
        Outcome::One(_) => "one",
        Outcome::Family(_) => "family",
        Outcome::Two(..) => "two",
        _ => "not_enough",
    };
    let members: Vec<_> = match &v.outcome {
        Outcome::One(e) => vec![MemberJson {
            period_s: rounded(e.period_s),
            sigma_s: rounded(e.sigma_s),
            turns: None,
            why: "the only one".into(),
        }],
        Outcome::Two(first, second) => [first, second]
            .iter()
            .map(|e| MemberJson {
                period_s: rounded(e.period_s),
                sigma_s: rounded(e.sigma_s),
                turns: None,
                why: "one of two periods at once".into(),
            })
            .collect(),
        Outcome::Family(members) => members
            .iter()
            .map(|m| MemberJson {
                period_s: rounded(m.estimate.period_s),
                sigma_s: rounded(m.estimate.sigma_s),
                turns: Some(rounded(m.turns)),
                why: why(found, m),
            })
            .collect(),
        _ => Vec::new(),
    };
    let reason = match &v.outcome {
        Outcome::NotEnough(reason) => Some(reason.to_string()),
        _ => None,
    };
    json_of(&PeriodJson {
        verdict: outcome,
        periods: members,
        reason,
        best: v.best.as_ref().map(estimate),
        harmonics: v.harmonics,
        false_alarm: v.false_alarm,
        chance_beside: v.beside,
        questions: v
            .questions
            .iter()
            .map(|q| QuestionJson {
                longer_s: rounded(q.longer_s),
                shorter_s: rounded(q.shorter_s),
                chance: q.chance,
                unlike: q.unlike.map(rounded),
                dispersion_chance: q.dispersion_chance,
            })
            .collect(),
        peaks: v
            .peaks
            .iter()
            .map(|(k, p, g)| PeakJson { harmonics: *k, period_s: rounded(*p), gain: rounded(*g) })
            .collect(),
        searched_s: v.searched_s.map(|(a, b)| [rounded(a), rounded(b)]),
        window_peaks: v
            .window_peaks
            .iter()
            .map(|(f, h)| WindowPeak { frequency_hz: rounded(*f), height: rounded(*h) })
            .collect(),
        independent_channels: rounded(v.independent_channels),
        independent_samples: rounded(v.independent_samples),
        sidereal: found.sidereal.map(|s| SiderealJson {
            fastest_deg_s: rounded(s.fastest_deg_s),
            moved_deg: rounded(s.moved_deg),
            from_to_s: [rounded(s.from_to_s.0), rounded(s.from_to_s.1)],
        }),
        along: found.along.as_ref().map(|a| AlongJson {
            stretches: a.stretches,
            way_deg: rounded(a.way_deg),
            ra_deg: rounded(axis_deg(a).0),
            dec_deg: rounded(axis_deg(a).1),
            synodic_s: rounded(a.clock.synodic_s),
            bend_turns: rounded(a.clock.bend_turns),
            even_share: rounded(a.even_share),
            sidereal_s: [rounded(a.sidereal_s.0), rounded(a.sidereal_s.1)],
            sky_share: rounded(a.alike),
        }),
        changing: v.drift_turns > 0.0,
        drift_turns: v.drift_turns,
        folding: v.folding.map(|f| FoldingJson {
            step_s: rounded(f.step_s),
            exposure_s: f.exposure_s.map(rounded),
            presumes_full_exposures: f.exposure_s.is_none(),
            unnamed: f.unnamed,
            shortest_s: rounded(f.shortest_s),
        }),
        tracks: found.tracks.as_ref().map(|t| TracksJson {
            chance: t.chance,
            periods: t
                .periods
                .iter()
                .map(|p| TrackPeriod {
                    name: &p.name,
                    middle_s: rounded(p.middle_s),
                    period_s: rounded(p.estimate.period_s),
                    sigma_s: rounded(p.estimate.sigma_s),
                })
                .collect(),
        }),
        flashes: found.flashes.as_ref().map(|f| FlashesJson {
            flashes: f.flashes,
            lit: rounded(f.lit),
            held: rounded(f.held),
            width_s: rounded(f.width_s),
            decides: f.decides,
            best: f.best.as_ref().map(estimate),
            chance: f.chance,
            periods: f
                .periods
                .iter()
                .map(|m| FlashPeriod {
                    period_s: rounded(m.estimate.period_s),
                    sigma_s: rounded(m.estimate.sigma_s),
                    turns: rounded(m.turns),
                })
                .collect(),
            phases: f
                .phases
                .iter()
                .map(|p| PhaseJson {
                    phase: rounded(p.phase),
                    seen: p.seen,
                    flashed: p.flashed,
                    strength: rounded(p.strength),
                })
                .collect(),
        }),
        channels: found
            .series
            .iter()
            .map(|s| ChannelJson {
                name: &s.name,
                samples: s.len(),
                flagged: s.left_out.flagged,
                not_finite: s.left_out.not_finite,
                same_time: s.left_out.same_time,
                alone: s.left_out.alone,
            })
            .collect(),
        removed: &found.curves.removed,
        warnings: &found.warnings,
        inputs: &found.curves.inputs,
    })
}

/// Table with a row for each frequency: the window, and by channel power and dispersion.
pub fn table(found: &FoundPeriod) -> Table {
    let Some(grid) = found.grid else { return Table::default() };
    let frequency: Vec<f64> = (0..grid.n).map(|i| grid.frequency_hz(i)).collect();
    let mut columns = vec![
        Column::f64("frequency_hz", Some("Hz"), frequency.clone()),
        Column::f64("period_s", Some("s"), frequency.iter().map(|f| 1.0 / f).collect()),
        Column::f64("window", None, found.window.clone()),
    ];
    for d in &found.drawn {
        let name = d.name.replace(' ', "_");
        columns.push(Column::f64(format!("{name}_power"), None, d.power.clone()));
        columns.push(Column::f64(format!("{name}_theta"), None, d.theta.clone()));
    }
    let mut table = Table { columns, ..Table::default() };
    let summary = json(found);
    for key in ["verdict", "periods", "reason", "best", "searched_s", "removed", "inputs"] {
        table.meta.insert(key.into(), summary[key].clone());
    }
    table.meta.insert("harmonics".into(), json_of(&found.harmonics));
    table
}

/// Right ascension (0 to 360°) and declination of the clock's axis.
fn axis_deg(along: &Along) -> (f64, f64) {
    let (longitude, latitude) = longitude_latitude(along.clock.axis);
    (longitude.rem_euclid(360.0), latitude)
}

fn stretches(n: usize, way_deg: f64) -> String {
    match n {
        1 => format!("in one piece, in which the bisector of Sun and station goes {way_deg:.0}°"),
        n => format!(
            "in {n} stretches, each with a curve of its own; the bisector of Sun and station goes {way_deg:.0}° in all"
        ),
    }
}

fn words(q: &Question) -> String {
    let Question { longer_s, shorter_s, chance, unlike, dispersion_chance, .. } = q;
    let lines = match (chance, unlike) {
        (None, _) => "lines do not tell (too few turns, or harmonics folded onto them)".to_owned(),
        (Some(p), Some(u)) if *p > 1e-4 => {
            format!("by lines not seen (chance {}), turns alike within {}", small(*p), percent(*u))
        }
        (Some(p), None) if *p > 1e-4 => format!("by lines not seen (chance {})", small(*p)),
        (Some(p), _) => format!("by lines seen (chance {})", small(*p)),
    };
    let dispersion = dispersion_chance
        .map_or(String::new(), |p| format!("; by dispersion, chance {}", small(p)));
    format!("does {longer_s:.5} s explain more than {shorter_s:.5} s? {lines}{dispersion}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: floats end at 2.2e-308 with all their digits: below 1e-300 no digits are told, and 0 is no chance.
    #[test]
    fn a_chance_is_never_0() {
        assert_eq!(
            [bound(0.0), bound(1e-311), bound(2e-300)],
            ["below 1e-300", "below 1e-300", "at most 2.0e-300"]
        );
        assert_eq!([small(0.0), small(0.031)], ["below 1e-300", "3.1e-2"]);
    }
}
