//! A detector's dead time from steps of light: text, JSON, table, figure.

use crate::plot::{Axis, Figure, Panel, Series};
use crate::{Product, json_of, rounded};
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use sunglint_calibration::detector::fit::{Choice, Exposure, Fitted, Light, Region};
use sunglint_formats::text::counted;
use sunglint_formats::{Column, Table};

/// A light that was measured, and what a law says of it.
struct Row {
    lights: String,
    measured_hz: f64,
    sigma_hz: f64,
    true_hz: f64,
    counted_hz: f64,
    exposures: usize,
}

fn rows(choice: &Choice, exposures: &[Exposure]) -> Vec<Row> {
    let Some(fitted) = shown(choice) else { return vec![] };
    let mut sums: BTreeMap<&[Light], (f64, f64, usize)> = BTreeMap::new();
    for exposure in exposures {
        let sum = sums.entry(&exposure.lights[..]).or_default();
        sum.0 += exposure.counts as f64;
        sum.1 += exposure.exposure_s;
        sum.2 += 1;
    }
    let row = |(lights, (counts, time_s, exposures)): (&[Light], (f64, f64, usize))| {
        let rate = |light: &Light| fitted.level_hz[light.level] * fitted.transmission[light.step];
        let true_hz = fitted.dark_hz + lights.iter().map(rate).sum::<f64>();
        let names: Vec<String> =
            lights.iter().map(|l| format!("{}*{}", l.level + 1, l.step + 1)).collect();
        Row {
            lights: if names.is_empty() { "dark".into() } else { names.join("+") },
            measured_hz: counts / time_s,
            sigma_hz: (choice.scatter * counts.max(1.0)).sqrt() / time_s,
            true_hz,
            counted_hz: fitted.law.counted_hz(true_hz).unwrap_or(f64::NAN),
            exposures,
        }
    };
    let mut rows: Vec<Row> = sums.into_iter().map(row).collect();
    rows.sort_by(|a, b| a.true_hz.total_cmp(&b.true_hz));
    rows
}

/// The law that is shown: the one that is told, else the best that is left, else the best.
fn shown(choice: &Choice) -> Option<&Fitted> {
    let number = choice.left.first().copied().unwrap_or(0);
    choice.told().or_else(|| choice.fitted.get(number))
}

/// The result in all its forms.
pub fn product(name: &str, choice: &Choice, exposures: &[Exposure]) -> Product {
    let rows = rows(choice, exposures);
    let all = |value: fn(&Row) -> f64| rows.iter().map(value).collect::<Vec<f64>>();
    let hz = |name: &str, about: &str, value: fn(&Row) -> f64| {
        Column::f64(name, Some("Hz"), all(value)).described(about)
    };
    let count = |r: &Row| i64::try_from(r.exposures).unwrap_or(i64::MAX);
    let columns = vec![
        Column::text("lights", rows.iter().map(|r| r.lights.clone()).collect::<Vec<_>>())
            .described("level*step, those that were on together joined by +"),
        hz("true_hz", "by the law", |r| r.true_hz),
        hz("counted_hz", "what the law counts of it", |r| r.counted_hz),
        hz("measured_hz", "mean of the exposures", |r| r.measured_hz),
        hz("sigma_hz", "by photons, and by what exposures scatter more", |r| r.sigma_hz),
        Column::i64("exposures", None, rows.iter().map(count).collect()),
    ];
    let meta = [
        ("kind", "linearity".into()),
        ("detector", json_of(&name)),
        ("law", json_of(&shown(choice).map(|f| f.name))),
    ];
    let meta = meta.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
    Product {
        name: "linearity".into(),
        table: Table { meta, columns },
        figure: figure(name, choice, &rows),
        json: summary(name, choice),
        ..Product::default()
    }
}

#[derive(Serialize)]
struct RegionJson {
    counted_hz: [f64; 2],
    lights: usize,
    chi2: f64,
    worst: f64,
}

fn region(region: &Region) -> RegionJson {
    let (least, most) = region.counted_hz;
    RegionJson {
        counted_hz: [rounded(least), rounded(most)],
        lights: region.lights,
        chi2: rounded(region.chi2),
        worst: rounded(region.worst),
    }
}

#[derive(Serialize)]
struct ParameterJson<'a> {
    name: &'a str,
    value: f64,
    low: f64,
    high: f64,
}

#[derive(Serialize)]
struct LawJson<'a> {
    dead_time_model: &'a str,
    found: Vec<ParameterJson<'a>>,
    chi2: f64,
    freedom: usize,
    fits: bool,
    regions: Vec<RegionJson>,
    dark_hz: f64,
}

#[derive(Serialize)]
struct LinearityJson<'a> {
    detector: &'a str,
    told: Option<&'a str>,
    left: Vec<&'a str>,
    laws: Vec<LawJson<'a>>,
    scatter: f64,
    measured_hz: [f64; 2],
}

fn summary(name: &str, choice: &Choice) -> Value {
    let law = |fitted: &Fitted| {
        let found: Vec<_> = (fitted.found.iter())
            .map(|f| ParameterJson {
                name: f.name,
                value: rounded(f.value),
                low: rounded(f.low),
                high: rounded(f.high),
            })
            .collect();
        LawJson {
            dead_time_model: fitted.name,
            found,
            chi2: rounded(fitted.chi2),
            freedom: fitted.freedom,
            fits: fitted.fits,
            regions: fitted.regions.iter().map(region).collect(),
            dark_hz: rounded(fitted.dark_hz),
        }
    };
    json_of(&LinearityJson {
        detector: name,
        told: choice.told().map(|f| f.name),
        left: choice.left.iter().map(|k| choice.fitted[*k].name).collect(),
        laws: choice.fitted.iter().map(law).collect(),
        scatter: rounded(choice.scatter),
        measured_hz: [rounded(choice.measured_hz.0), rounded(choice.measured_hz.1)],
    })
}

/// The result as text.
pub fn text(choice: &Choice) -> String {
    let mut text = String::new();
    let names: Vec<&str> = choice.left.iter().map(|k| choice.fitted[*k].name).collect();
    let _ = match (choice.told(), names.is_empty()) {
        (Some(told), _) => writeln!(text, "law       {}", told.name),
        (None, true) => writeln!(text, "law       none of those that were tried fits the counts"),
        (None, false) => writeln!(
            text,
            "law       the counts cannot tell {} apart: brighter light, or longer",
            names.join(" and ")
        ),
    };
    for fitted in &choice.fitted {
        let fits = if fitted.fits { "" } else { ", does not fit" };
        let _ = writeln!(
            text,
            "{:<18} chi2 {:.1} of {}{fits}",
            fitted.name, fitted.chi2, fitted.freedom
        );
        for region in fitted.regions.iter().filter(|_| !fitted.fits) {
            let (least, most) = region.counted_hz;
            let _ = writeln!(
                text,
                "  {:>9} to {:>9} counts/s: chi2 {:.1} of {}, counts up to {:.2} % {} the law",
                format!("{least:.3e}"),
                format!("{most:.3e}"),
                region.chi2,
                counted(region.lights, "light"),
                100.0 * region.worst.abs(),
                if region.worst < 0.0 { "below" } else { "above" }
            );
        }
        for found in &fitted.found {
            // Two digits of the interval's half-width.
            let half = 0.5 * (found.high - found.low);
            let digits =
                if half.is_finite() && half > 0.0 { 1.0 - half.log10().floor() } else { 4.0 };
            let digits = digits.clamp(0.0, 12.0) as usize;
            let _ = writeln!(
                text,
                "  {} {:.digits$}, 95 % interval {:.digits$} to {:.digits$}",
                found.name, found.value, found.low, found.high
            );
        }
    }
    text
}

fn figure(name: &str, choice: &Choice, rows: &[Row]) -> Option<Figure> {
    let fitted = shown(choice)?;
    let lit: Vec<&Row> = rows.iter().filter(|r| r.true_hz > 0.0 && r.measured_hz > 0.0).collect();
    let (first, last) = (lit.first()?.true_hz, lit.last()?.true_hz);
    if last <= first {
        return None;
    }
    let along = |value: fn(&Row) -> f64| -> Vec<(f64, f64)> {
        lit.iter().map(|r| (r.true_hz, value(r))).collect()
    };
    let law: Vec<(f64, f64)> = (0..=100)
        .map(|k| first * (last / first).powf(f64::from(k) / 100.0))
        .filter_map(|n| Some((n, fitted.law.counted_hz(n)? / n)))
        .collect();
    let panels = vec![
        Panel::new(
            Axis::log("light (Hz without loss)"),
            Axis::linear("part that is counted"),
            vec![
                Series::line(fitted.name, 0, law),
                Series::dots("measured", 1, along(|r| r.measured_hz / r.true_hz)),
            ],
        ),
        Panel::new(
            Axis::log("light (Hz without loss)"),
            Axis::linear("measured over law, less 1"),
            vec![
                Series::dots("measured", 1, along(|r| r.measured_hz / r.counted_hz - 1.0)),
                Series::line("σ", 5, along(|r| r.sigma_hz / r.counted_hz)),
                Series::line("minus σ", 5, along(|r| -r.sigma_hz / r.counted_hz)),
            ],
        ),
    ];
    Some(Figure { title: format!("{name}: linearity"), panels })
}
