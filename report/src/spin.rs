//! The spin of a body over passes: text, JSON, table, figure.

use crate::plot::{Axis, Figure, Panel, Series as Line};
use crate::{Product, json_of, rounded};
use hifitime::{Duration, Epoch};
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_analysis::curves::Curves;
use sunglint_analysis::map::longitude_latitude;
use sunglint_analysis::period::verdict::Outcome;
use sunglint_analysis::spin::{Body, Interval, Spin, SpinFound};
use sunglint_formats::time::format_utc;
use sunglint_formats::{Column, Table};
use sunglint_radiometry::light_curve::Input;

const DAY_S: f64 = 86_400.0;

/// Advice where the shape would choose between once and twice a turn.
const ADVICE: &str =
    "if the body is long and tumbles across its length (a rocket's stage), say --body long";

/// A spin with the curves that it was found in.
#[derive(Debug, Clone, Copy)]
pub struct SpinReport<'a> {
    /// The spin.
    pub found: &'a SpinFound,
    /// Knowledge of the body.
    pub body: Body,
    /// The curves.
    pub curves: &'a Curves,
    /// Warnings that the user should read first.
    pub warnings: &'a [String],
}

#[derive(Serialize)]
struct IntervalJson {
    value: f64,
    from: f64,
    to: f64,
}

impl IntervalJson {
    fn new(i: Interval) -> Self {
        Self { value: rounded(i.value), from: rounded(i.from), to: rounded(i.to) }
    }
}

#[derive(Serialize)]
struct AxisJson {
    ra_deg: f64,
    dec_deg: f64,
    within_deg: f64,
}

#[derive(Serialize)]
struct SpinJson {
    repeats: u32,
    share: f64,
    period_s: IntervalJson,
    drift_per_day: IntervalJson,
    axis: AxisJson,
    sense_share: f64,
    sense_known: bool,
    slip_turns: f64,
}

impl SpinJson {
    fn new(s: &Spin) -> Self {
        let (ra, dec) = axis_deg(s);
        Self {
            repeats: s.repeats,
            share: rounded(s.share),
            period_s: IntervalJson::new(s.period_s),
            drift_per_day: IntervalJson::new(s.drift_per_day),
            axis: AxisJson {
                ra_deg: rounded(ra),
                dec_deg: rounded(dec),
                within_deg: rounded(s.axis_within_deg),
            },
            sense_share: rounded(s.sense),
            sense_known: s.knows_sense(),
            slip_turns: rounded(s.slip_turns),
        }
    }
}

#[derive(Serialize)]
struct PassJson<'a> {
    name: &'a str,
    middle_utc: String,
    own_s: Option<f64>,
    apparent_s: Option<f64>,
    model_s: Option<f64>,
}

#[derive(Serialize)]
struct Document<'a> {
    verdict: &'static str,
    spins: Vec<SpinJson>,
    body: &'static str,
    even_share: Option<f64>,
    reason: Option<String>,
    epoch_utc: Option<String>,
    passes: Vec<PassJson<'a>>,
    removed: &'a [String],
    warnings: &'a [String],
    inputs: &'a [Input],
}

/// Right ascension (0 to 360°) and declination of an axis.
fn axis_deg(spin: &Spin) -> (f64, f64) {
    let (longitude, latitude) = longitude_latitude(spin.axis);
    (longitude.rem_euclid(360.0), latitude)
}

/// The odds of the likelier of two spins, in words.
fn odds(found: &SpinFound) -> Option<String> {
    let [first, second] = found.spins.as_slice() else { return None };
    let odds = first.share / second.share;
    let digits = usize::from(odds < 9.95);
    Some(format!("{odds:.digits$} to 1"))
}

/// The answer if it was known that the body is long.
fn as_long(found: &SpinFound) -> String {
    let long = found.clone().knowing(Body::Long);
    match (long.spins.first(), odds(&long)) {
        _ if long.spins == found.spins => "it would say nothing here".into(),
        (Some(spin), Some(odds)) => {
            format!("{} would have {odds}", period(spin.period_s))
        }
        (Some(spin), None) => format!("{} would be the only one", period(spin.period_s)),
        (None, _) => "it would say nothing here".into(),
    }
}

/// An interval to the second digit of its half width.
fn period(i: Interval) -> String {
    let half = 0.5 * (i.to - i.from);
    let digits = (1.0 - half.log10().floor()).clamp(0.0, 12.0);
    let digits = if digits.is_finite() { digits as usize } else { 6 };
    format!("{:.digits$} s ({:.digits$} to {:.digits$})", i.value, i.from, i.to)
}

impl SpinReport<'_> {
    /// All forms of the result.
    pub fn product(&self) -> Product {
        Product {
            name: "spin".into(),
            table: self.table(),
            figure: self.figure(),
            json: self.json(),
            ..Product::default()
        }
    }

    fn time(&self, s: f64) -> Epoch {
        self.curves.zero + Duration::from_seconds(s)
    }

    /// The text.
    pub fn text(&self) -> String {
        let mut text = String::new();
        let found = self.found;
        match (found.only(), found.refused) {
            (Some(_), _) => text.push_str("verdict   one spin; intervals are of 95 %\n"),
            (None, Some(reason)) => {
                let _ = writeln!(text, "verdict   no spin: {reason}");
            }
            (None, None) => {
                let _ = writeln!(
                    text,
                    "verdict   two spins{}: the passes do not choose; more passes, seen otherwise, would",
                    odds(found).map_or_else(String::new, |o| format!(", {o} for the first"))
                );
            }
        }
        for spin in &found.spins {
            self.say(spin, &mut text);
        }
        let _ = match (self.body, found.even_share) {
            (Body::Any, None) => Ok(()),
            (Body::Any, Some(even)) if found.only().is_some() => writeln!(
                text,
                "shape     even harmonics have {:.0} % of the variation",
                100.0 * even
            ),
            (Body::Long, None) => writeln!(
                text,
                "shape     a long body (--body long): no pass bears two harmonics, so that this says nothing here"
            ),
            (Body::Any, Some(even)) => writeln!(
                text,
                "shape     even harmonics have {:.0} % of the variation; {ADVICE}: {}",
                100.0 * even,
                as_long(found)
            ),
            (Body::Long, Some(even)) => writeln!(
                text,
                "shape     a long body (--body long): even harmonics have {:.0} % of the variation, which {}",
                100.0 * even,
                match (even > 0.5, found.odd_is_seen) {
                    (true, true) => "speaks for one repetition a turn",
                    (true, false) =>
                        "says nothing here: odd ones are not seen, so the light may repeat in half of the time",
                    (false, _) => "says nothing here",
                }
            ),
        };
        let agree = found.passes.iter().filter(|p| p.apparent_s.is_some()).count();
        let _ = writeln!(
            text,
            "passes    {agree} of {} agree; turns between them are not counted",
            found.passes.len()
        );
        for pass in &found.passes {
            let at = format_utc(self.time(pass.middle_s), 0);
            let own = match &pass.verdict.outcome {
                Outcome::One(e) => format!("one period, {:.4} s", e.period_s),
                Outcome::Family(members) => {
                    let all: Vec<String> =
                        members.iter().map(|m| format!("{:.4}", m.estimate.period_s)).collect();
                    format!("one of {} s", all.join(", "))
                }
                _ => "no period alone".into(),
            };
            let _ = match (pass.apparent_s, pass.model_s) {
                (Some(seen), Some(model)) => writeln!(
                    text,
                    "          {at}  {own}; repeats in {seen:.4} s, by the spin in {model:.4} s"
                ),
                (Some(seen), None) => {
                    writeln!(text, "          {at}  {own}; repeats in {seen:.4} s")
                }
                _ => writeln!(text, "          {at}  {own}; not used"),
            };
        }
        let removed = &self.curves.removed;
        let removed = if removed.is_empty() { "nothing".to_owned() } else { removed.join(", ") };
        let _ = writeln!(text, "removed   {removed}");
        text
    }

    fn say(&self, spin: &Spin, text: &mut String) {
        let often = match spin.repeats {
            1 => "once".to_owned(),
            2 => "twice".to_owned(),
            n => format!("{n} times"),
        };
        let _ = writeln!(
            text,
            "spin      {}, sidereal, at {}; {:.0} % of the likelihood; the light repeats {often} a turn",
            period(spin.period_s),
            format_utc(self.time(self.found.epoch_s), 0),
            100.0 * spin.share,
        );
        let d = spin.drift_per_day;
        let _ = writeln!(
            text,
            "drift     {:+.1e} of the period a day ({:+.1e} to {:+.1e})",
            d.value, d.from, d.to
        );
        let (ra, dec) = axis_deg(spin);
        let sense = if spin.knows_sense() {
            "right-handed about it".to_owned()
        } else {
            format!("sense not known, {:.0} % for right-handed about it", 100.0 * spin.sense)
        };
        let _ = writeln!(
            text,
            "axis      RA {ra:.0}°, Dec {dec:+.0}° (GCRS), 95 % within {:.0}° of it; {sense}",
            spin.axis_within_deg.ceil()
        );
        let _ = writeln!(
            text,
            "slip      the phase slips by some {:.3} of a turn over a pass beside the model (in the intervals)",
            spin.slip_turns
        );
    }

    /// The summary with its documented keys.
    pub fn json(&self) -> Value {
        let found = self.found;
        let passes = found.passes.iter().map(|p| PassJson {
            name: &p.name,
            middle_utc: format_utc(self.time(p.middle_s), 3),
            own_s: p.verdict.best.as_ref().map(|b| rounded(b.period_s)),
            apparent_s: p.apparent_s.map(rounded),
            model_s: p.model_s.map(rounded),
        });
        json_of(&Document {
            verdict: match (found.only(), found.refused) {
                (Some(_), _) => "one",
                (None, Some(_)) => "none",
                (None, None) => "several",
            },
            spins: found.spins.iter().map(SpinJson::new).collect(),
            body: match self.body {
                Body::Any => "any",
                Body::Long => "long",
            },
            even_share: found.even_share.map(rounded),
            reason: found.refused.map(|r| r.to_string()),
            epoch_utc: (!found.spins.is_empty()).then(|| format_utc(self.time(found.epoch_s), 3)),
            passes: passes.collect(),
            removed: &self.curves.removed,
            warnings: self.warnings,
            inputs: &self.curves.inputs,
        })
    }

    /// A row for each pass.
    fn table(&self) -> Table {
        let passes = &self.found.passes;
        let or_nan = |value: Option<f64>| value.unwrap_or(f64::NAN);
        let utc = passes.iter().map(|p| format_utc(self.time(p.middle_s), 3)).collect();
        let seen = passes.iter().map(|p| or_nan(p.apparent_s)).collect();
        let model = passes.iter().map(|p| or_nan(p.model_s)).collect();
        let mut table = Table {
            columns: vec![
                Column::text("middle_utc", utc).described("middle of the pass"),
                Column::f64("apparent_s", Some("s"), seen)
                    .described("the time in which its light repeats"),
                Column::f64("model_s", Some("s"), model)
                    .described("the same by the likeliest spin"),
            ],
            ..Table::default()
        };
        let summary = self.json();
        for key in
            ["verdict", "spins", "body", "even_share", "reason", "epoch_utc", "removed", "inputs"]
        {
            table.meta.insert(key.into(), summary[key].clone());
        }
        table
    }

    /// Apparent periods against time, as seen and by the spin.
    fn figure(&self) -> Option<Figure> {
        let first = self.found.passes.iter().map(|p| p.middle_s).reduce(f64::min)?;
        let points = |of: &dyn Fn(usize) -> Option<f64>| -> Vec<(f64, f64)> {
            let passes = self.found.passes.iter().enumerate();
            passes.filter_map(|(k, p)| Some(((p.middle_s - first) / DAY_S, of(k)?))).collect()
        };
        let seen = points(&|k| self.found.passes[k].apparent_s);
        if seen.is_empty() {
            return None;
        }
        let model = points(&|k| self.found.passes[k].model_s);
        let lines = vec![Line::dots("as seen", 0, seen), Line::dots("by the spin", 1, model)];
        let title = match self.found.only() {
            Some(s) => format!("{}: a turn of {:.4} s", self.curves.title(), s.period_s.value),
            None => format!("{}: several spins are possible", self.curves.title()),
        };
        let name = format!("days since {}", format_utc(self.time(first), 0));
        let panel = Panel::new(
            Axis::linear(name),
            Axis::linear("time in which the light repeats (s)"),
            lines,
        );
        Some(Figure { title, panels: vec![panel] })
    }
}
