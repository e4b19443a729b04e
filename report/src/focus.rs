//! A run through the focus, and the drift of several.

use crate::plot::{Axis, Figure, Panel, Series};
use crate::{Product, json_of};
use serde::Serialize;
use std::fmt::Write as _;
use sunglint_formats::{Column, Table};
use sunglint_observatory::focus::curve::{Curve, Shape};
use sunglint_observatory::focus::drift::{At, Drift};
use sunglint_observatory::focus::run::{Approach, FocusRun, Seen};

/// A position in a line.
pub fn point_text(seen: &Seen) -> String {
    match seen.sharpness {
        Some(s) => format!(
            "position {:7}  radius {:6.3} ± {:.3} px  {} stars",
            seen.position, s.hfr_px, s.sigma_px, s.stars
        ),
        None => format!("position {:7}  no star", seen.position),
    }
}

/// A run as text.
pub fn text(run: &FocusRun) -> String {
    let mut text = String::new();
    for seen in &run.points {
        let _ = writeln!(text, "  {}", point_text(seen));
    }
    if let Some(curve) = &run.curve {
        let shape = match curve.shape {
            Shape::Hyperbola => "hyperbola",
            Shape::Parabola => "parabola",
        };
        let _ = writeln!(
            text,
            "best position {:.0} ± {:.0} (95 %: ± {:.0}), radius {:.2} px, by a {shape} through {} points that scatter by {:.1} % beyond the noise of their light",
            curve.best,
            curve.sigma,
            curve.half_width_95,
            curve.least_px,
            curve.fitted,
            100.0 * curve.scatter
        );
    }
    if let Some(there) = &run.there {
        let _ = writeln!(
            text,
            "a frame at {} has {:.2} ± {:.2} px",
            run.curve.map_or(f64::NAN, |curve| curve.best.round()),
            there.hfr_px,
            there.sigma_px
        );
    }
    if let Some(temperature) = run.temperature_c {
        let _ = writeln!(text, "temperature {temperature:.1} °C");
    }
    let stands = run.stands_at.map_or("an unknown position".to_owned(), |at| at.to_string());
    let _ = writeln!(text, "the focuser stands at {stands} (before: {})", run.started_at);
    text
}

/// Picture of the V-curve.
fn figure(run: &FocusRun) -> Figure {
    let seen = |seen: &Seen| Some((seen.position as f64, seen.sharpness?.hfr_px));
    let points: Vec<(f64, f64)> = run.points.iter().filter_map(seen).collect();
    let mut series = Vec::new();
    if let Some(curve) = &run.curve {
        let of = |fold: fn(f64, f64) -> f64, start| points.iter().map(|p| p.0).fold(start, fold);
        let (from, to) = (of(f64::min, f64::INFINITY), of(f64::max, f64::NEG_INFINITY));
        let at = |i: i32| from + (to - from) * f64::from(i) / 200.0;
        let line = (0..=200).map(at).map(|x| (x, curve.at(x))).collect();
        series.push(Series::line("curve", 1, line));
        series.push(Series::dots("best", 2, vec![(curve.best, curve.least_px)]));
    }
    series.push(Series::dots("frames", 0, points));
    let title = match &run.curve {
        Some(curve) => format!("Focus: {:.0} ± {:.0} steps", curve.best, curve.sigma),
        None => "Focus: no best position".to_owned(),
    };
    let (x, y) = (Axis::linear("position in steps"), Axis::linear("half-flux radius in px"));
    Figure { title, panels: vec![Panel::new(x, y, series)] }
}

#[derive(Serialize)]
struct PointJson {
    position: i64,
    hfr_px: Option<f64>,
    sigma_px: Option<f64>,
    stars: usize,
}

#[derive(Serialize)]
struct ThereJson {
    hfr_px: f64,
    sigma_px: f64,
    stars: usize,
}

#[derive(Serialize)]
struct RunJson<'a> {
    begin_utc: &'a str,
    approach: &'a Approach,
    started_at: i64,
    stands_at: Option<i64>,
    temperature_c: Option<f64>,
    points: Vec<PointJson>,
    curve: &'a Option<Curve>,
    there: Option<ThereJson>,
    error: Option<&'a str>,
}

/// A run in all its forms; `error` says why it did not end in focus.
pub fn product(run: &FocusRun, error: Option<&str>) -> Product {
    let number = |of: fn(&Seen) -> f64| run.points.iter().map(of).collect::<Vec<f64>>();
    let positions = run.points.iter().map(|seen| seen.position).collect();
    let columns = vec![
        Column::i64("position_steps", None, positions),
        Column::f64("hfr_px", Some("pix"), number(|s| s.sharpness.map_or(f64::NAN, |s| s.hfr_px))),
        Column::f64(
            "sigma_px",
            Some("pix"),
            number(|s| s.sharpness.map_or(f64::NAN, |s| s.sigma_px)),
        ),
        Column::i64(
            "stars",
            None,
            run.points.iter().map(|s| s.sharpness.map_or(0, |s| s.stars as i64)).collect(),
        ),
    ];
    let points = run.points.iter().map(|seen| PointJson {
        position: seen.position,
        hfr_px: seen.sharpness.map(|s| s.hfr_px),
        sigma_px: seen.sharpness.map(|s| s.sigma_px),
        stars: seen.sharpness.map_or(0, |s| s.stars),
    });
    let there =
        run.there.map(|s| ThereJson { hfr_px: s.hfr_px, sigma_px: s.sigma_px, stars: s.stars });
    let json = json_of(&RunJson {
        begin_utc: &run.begin_utc,
        approach: &run.approach,
        started_at: run.started_at,
        stands_at: run.stands_at,
        temperature_c: run.temperature_c,
        points: points.collect(),
        curve: &run.curve,
        there,
        error,
    });
    Product {
        name: "focus".into(),
        table: Table { columns, ..Table::default() },
        figure: Some(figure(run)),
        json,
        ..Product::default()
    }
}

/// A drift as text; `at` is a temperature, °C, whose position is asked for.
pub fn drift_text(drift: &Drift, at: Option<f64>) -> String {
    let mut text = format!(
        "{:+.1} ± {:.1} steps/K from {} runs (χ² {:.1}); best position {:.0} at {:.1} °C\n",
        drift.steps_per_k,
        drift.sigma_steps_per_k,
        drift.runs,
        drift.chi2,
        drift.position,
        drift.temperature_c
    );
    if let Some(celsius) = at {
        let _ = writeln!(text, "at {celsius:.1} °C: {:.0}", drift.at(celsius));
    }
    text
}

#[derive(Serialize)]
struct RunsJson {
    runs: usize,
    steps_per_k: f64,
    sigma_steps_per_k: f64,
    position: f64,
    temperature_c: f64,
    chi2: f64,
    at_c: Option<f64>,
    position_there: Option<f64>,
}

/// A drift in all its forms.
pub fn drift(drift: &Drift, runs: &[At], at: Option<f64>) -> Product {
    let number = |of: fn(&At) -> f64| runs.iter().map(of).collect::<Vec<f64>>();
    let columns = vec![
        Column::f64("temperature_c", Some("deg_C"), number(|run| run.temperature_c)),
        Column::f64("position", None, number(|run| run.position)),
        Column::f64("sigma", None, number(|run| run.sigma)),
    ];
    let json = json_of(&RunsJson {
        runs: drift.runs,
        steps_per_k: drift.steps_per_k,
        sigma_steps_per_k: drift.sigma_steps_per_k,
        position: drift.position,
        temperature_c: drift.temperature_c,
        chi2: drift.chi2,
        at_c: at,
        position_there: at.map(|celsius| drift.at(celsius)),
    });
    let table = Table { columns, ..Table::default() };
    Product { name: "drift".into(), table, json, ..Product::default() }
}
