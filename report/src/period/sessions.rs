//! The period of several sessions with a zero point each: text, JSON, table, figure.

use crate::plot::{Axis, Figure, Panel, Series as Line, Span};
use crate::{Product, inputs};
use plotters::style::RGBColor;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_analysis::sessions::{Joined, Member, Outcome};
use sunglint_formats::text::counted;
use sunglint_formats::{Column, Table};
use sunglint_numerics::measured::Interval;

/// Δ from which on a period is ruled out, drawn as a line.
const RULED_OUT: f64 = 25.0;
/// The stretch around a period of the verdict, relative.
const MARK: f64 = 0.004;
/// Sessions that have a name of their own in the figure.
const NAMED: usize = 12;

/// All forms of the result.
pub fn product(joined: &Joined) -> Product {
    Product {
        name: "period".into(),
        table: table(joined),
        figure: figure(joined),
        json: json(joined),
        ..Product::default()
    }
}

/// A time in the unit that suits it, with so many digits as its uncertainty has.
fn time(s: f64, sigma_s: f64) -> String {
    let (value, sigma, unit) = match s {
        s if s >= 2.0 * 3600.0 => (s / 3600.0, sigma_s / 3600.0, "h"),
        s => (s, sigma_s, "s"),
    };
    let digits = if sigma.is_finite() && sigma > 0.0 {
        (1.0 - sigma.log10().floor()).clamp(0.0, 9.0) as usize
    } else {
        4
    };
    format!("{value:.digits$} {unit}")
}

fn period(m: &Member) -> String {
    let within = format!(
        "95 %: {} to {}",
        time(m.interval_s.low, m.sigma_s),
        time(m.interval_s.high, m.sigma_s)
    );
    let cycles = if m.cycles_counted {
        format!("{:.1} turns", m.turns)
    } else {
        format!("cycles not counted, {} counts fit", m.cycle_counts)
    };
    format!("{} ({within}; {cycles})", time(m.period_s, m.sigma_s))
}

/// Text of the verdict.
pub fn text(joined: &Joined) -> String {
    let mut text = String::new();
    let found = &joined.found;
    match found.verdict {
        Outcome::Single => {
            for m in &found.members {
                let _ = writeln!(text, "verdict   one period (synodic: as seen): {}", period(m));
            }
        }
        Outcome::Family => {
            let _ = writeln!(
                text,
                "verdict   a family of periods, the likeliest first: the data do not choose"
            );
            for m in &found.members {
                let _ = writeln!(
                    text,
                    "          {}; Δ {:.0}, {:.0}, {:.0} by 4, 6, 8 harmonics",
                    period(m),
                    m.gaps[0],
                    m.gaps[1],
                    m.gaps[2]
                );
            }
        }
        Outcome::NotDecided => {
            let _ = writeln!(
                text,
                "verdict   not decided: {}",
                found.reason.as_deref().unwrap_or("nothing fits")
            );
        }
    }
    if let Some(best) = found.best_s {
        let [four, six, eight] = best.map(|b| time(b, 1e-4 * b));
        let _ = writeln!(text, "best      {four}, {six}, {eight} by 4, 6, 8 harmonics");
        let [four, six, eight] =
            found.smallest_gap.map(|g| g.map_or("none".to_owned(), |g| format!("Δ {g:.0}")));
        let _ = writeln!(
            text,
            "rivals    the nearest other period (more than 1 % away): {four}, {six}, {eight} by 4, 6, 8 harmonics; up to Δ {RULED_OUT} it is not ruled out"
        );
    }
    if let Some(best) = found.members.first() {
        let _ = writeln!(
            text,
            "light     {:.3} mag from the brightest to the faintest, {:.0} % of a turn seen",
            best.amplitude_mag,
            100.0 * best.phase_seen
        );
    }
    if let Some(scatter) = found.scatter_mag {
        let _ = writeln!(
            text,
            "scatter   {scatter:.4} mag about it; neighbouring residuals share {:.2} (counted)",
            found.correlation[1]
        );
    }
    if let Some(Interval { low: shortest, high: longest }) = found.searched_s {
        let _ = writeln!(
            text,
            "searched  periods from {} to {}, {} frequencies",
            time(shortest, 1e-3 * shortest),
            time(longest, 1e-3 * longest),
            found.frequencies
        );
    }
    let used = found.sessions.iter().filter(|s| s.zero_mag.is_some()).count();
    let _ = writeln!(
        text,
        "sessions  {} with {}, a zero point each{}; {} with the best period",
        found.sessions.len(),
        counted(found.samples, "sample"),
        if found.rows < found.samples && found.rows > 0 {
            format!(", put together in {}", counted(found.rows, "row"))
        } else {
            String::new()
        },
        used
    );
    let mut removed = joined.removed.clone();
    if joined.light_time_removed {
        removed.push("light time".into());
    }
    let removed = if removed.is_empty() { "nothing".to_owned() } else { removed.join(", ") };
    let _ = writeln!(text, "removed   {removed}");
    text
}

/// The result itself, and the files that went into it.
pub fn json(joined: &Joined) -> Value {
    let mut value = serde_json::to_value(joined).unwrap_or(Value::Null);
    if let Value::Object(map) = &mut value {
        map.insert("inputs".into(), inputs::json(&joined.curves.inputs));
    }
    value
}

/// Table with a row for each frequency that is drawn.
pub fn table(joined: &Joined) -> Table {
    let (period, delta): (Vec<f64>, Vec<f64>) = joined.found.drawn.iter().copied().unzip();
    if period.is_empty() {
        return Table::default();
    }
    let columns =
        vec![Column::f64("period_s", Some("s"), period), Column::f64("delta", None, delta)];
    let mut table = Table { columns, ..Table::default() };
    let summary = json(joined);
    for key in
        ["verdict", "members", "reason", "searched_s", "light_time_removed", "removed", "inputs"]
    {
        table.meta.insert(key.into(), summary[key].clone());
    }
    table.meta.insert("title".into(), headline(joined).into());
    table
}

fn headline(joined: &Joined) -> String {
    let title = &joined.title;
    match (joined.found.verdict, joined.found.members.as_slice()) {
        (Outcome::Single, [m, ..]) => {
            format!("{title}: one period, {}", time(m.period_s, m.sigma_s))
        }
        (Outcome::Family, all @ [m, ..]) => {
            format!(
                "{title}: {} periods are possible, the likeliest {}",
                all.len(),
                time(m.period_s, m.sigma_s)
            )
        }
        _ => format!("{title}: the period is not decided"),
    }
}

/// Figure of Δ over the periods and of the sessions folded on the best.
pub fn figure(joined: &Joined) -> Option<Figure> {
    let found = &joined.found;
    let best = found.members.first()?;
    let [shortest, longest] = found.searched_s?.to_array();
    let (unit, scale): (&str, fn(f64) -> f64) =
        if best.period_s >= 7200.0 { ("h", |s| s / 3600.0) } else { ("s", |s| s) };
    // The lowest have to be seen beside the highest.
    let points = found.drawn.iter().map(|(p, d)| (scale(*p), d.max(0.1))).collect();
    let mut periodogram = Panel::new(
        Axis::log(format!("period ({unit})")).from_to(scale(shortest), scale(longest)),
        Axis::log("Δ above the best, 6 harmonics").inverted(),
        vec![
            Line::line("Δ", 0, points),
            Line::line(
                "ruled out beyond",
                6,
                vec![(scale(shortest), RULED_OUT), (scale(longest), RULED_OUT)],
            )
            .with_colour_and_dash(RGBColor(150, 150, 150), 2),
        ],
    );
    if found.verdict != Outcome::NotDecided {
        let label = if found.verdict == Outcome::Single { "verdict" } else { "family" };
        periodogram.spans = found
            .members
            .iter()
            .map(|m| Span {
                label: label.into(),
                range: (scale(m.period_s * (1.0 - MARK)), scale(m.period_s * (1.0 + MARK))),
                colour: RGBColor(250, 210, 140),
            })
            .collect();
    }
    let mut lines: Vec<Line> = found
        .folded
        .iter()
        .enumerate()
        .map(|(k, (name, points))| {
            let name = if k < NAMED { name.clone() } else { String::new() };
            Line::dots(name, k, points.clone())
        })
        .collect();
    let model = (0..=200).filter_map(|i| {
        let phase = f64::from(i) / 200.0;
        Some((phase, found.light_mag(found.middle_s + phase * best.period_s)?))
    });
    lines.push(
        Line::line("6 harmonics", 0, model.collect()).with_colour_and_dash(RGBColor(0, 0, 0), 0),
    );
    let folded = Panel::new(
        Axis::linear(format!("phase in {}", time(best.period_s, best.sigma_s))).from_to(0.0, 1.0),
        Axis::linear("magnitude above the zero point").inverted(),
        lines,
    );
    Some(Figure { title: headline(joined), panels: vec![periodogram, folded] })
}
