//! A detector's efficiency: text, JSON, table, figure.

use crate::plot::{Axis, Figure, Panel, Series};
use crate::{Product, json_of, rounded};
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use sunglint_calibration::efficiency::Components;
use sunglint_calibration::efficiency::{Efficiency, EfficiencyFlags, EfficiencyRun, Row, to_table};
use sunglint_formats::text::counted;
use sunglint_radiometry::light_curve::Input;

/// The efficiency in all its forms.
pub fn product(run: &EfficiencyRun) -> Product {
    let mut table = to_table(&run.efficiency);
    table.meta.insert("sensor".into(), json_of(&run.name));
    table.meta.insert("plan".into(), json_of(&run.plan));
    table.meta.insert("inputs".into(), json_of(&run.inputs));
    Product {
        name: "efficiency".into(),
        figure: figure(&run.efficiency, &run.name),
        json: summary(run),
        table,
        ..Product::default()
    }
}

fn peak(found: &Efficiency) -> Option<&Row> {
    let finite = found.rows.iter().filter(|row| row.efficiency.is_finite());
    finite.max_by(|a, b| a.efficiency.total_cmp(&b.efficiency))
}

/// The efficiency as text.
pub fn text(run: &EfficiencyRun) -> String {
    let found = &run.efficiency;
    let mut text = String::new();
    let finite = found.rows.iter().filter(|row| row.efficiency.is_finite()).count();
    let all = counted(found.rows.len(), "wavelength");
    let have = if finite == 1 { "has" } else { "have" };
    let _ = writeln!(text, "{finite} of {all} {have} an efficiency");
    if let Some(row) = peak(found) {
        let _ = writeln!(
            text,
            "largest   {:.5} ± {:.5} at {} nm",
            row.efficiency,
            row.components.total(),
            row.wavelength_nm
        );
        let c = &row.components;
        let _ = writeln!(
            text,
            "of that   counts {:.5}, photodiode {:.5}, wavelength {:.5}, linearity {:.5}, responsivity {:.5}, load {:.5}, geometry {:.5}, transmissions {:.5}, drift {:.5}",
            c.counts,
            c.photodiode,
            c.wavelength,
            c.linearity,
            c.responsivity,
            c.load,
            c.geometry,
            c.transmissions,
            c.drift
        );
    }
    text
}

#[derive(Serialize)]
struct LargestJson<'a> {
    wavelength_nm: f64,
    efficiency: f64,
    sigma_efficiency: f64,
    sigma_by: &'a Components,
}

#[derive(Serialize)]
struct EfficiencyJson<'a> {
    sensor: &'a str,
    wavelengths: usize,
    with_efficiency: usize,
    largest: Option<LargestJson<'a>>,
    left_out_nm: &'a [f64],
    flagged: BTreeMap<String, usize>,
    warnings: &'a [String],
    inputs: &'a [Input],
}

fn summary(run: &EfficiencyRun) -> Value {
    let found = &run.efficiency;
    let mut flagged: BTreeMap<String, usize> = BTreeMap::new();
    for row in &found.rows {
        for (name, _) in row.flags.iter_names() {
            *flagged.entry(name.to_lowercase()).or_default() += 1;
        }
    }
    let largest = peak(found).map(|row| LargestJson {
        wavelength_nm: rounded(row.wavelength_nm),
        efficiency: rounded(row.efficiency),
        sigma_efficiency: rounded(row.components.total()),
        sigma_by: &row.components,
    });
    json_of(&EfficiencyJson {
        sensor: &run.name,
        wavelengths: found.rows.len(),
        with_efficiency: found.rows.iter().filter(|row| row.efficiency.is_finite()).count(),
        largest,
        left_out_nm: &run.left_out_nm,
        flagged,
        warnings: &run.warnings,
        inputs: &run.inputs,
    })
}

/// Adds to a figure how the efficiency at a reference changed in a run: its readings (time s, natural logarithm, standard uncertainty) over the first of them, and the relative change that is undone at a time.
pub fn draw_reference(
    figure: &mut Figure,
    readings: &[(f64, f64, f64)],
    undone: &dyn Fn(f64) -> f64,
) {
    let (Some(first), Some(last)) = (readings.first(), readings.last()) else { return };
    let along = |sigmas: f64| -> Vec<(f64, f64)> {
        let change = |(s, ln, sigma): &(f64, f64, f64)| {
            (s / 60.0, 100.0 * (ln + sigmas * sigma - first.1).exp_m1())
        };
        readings.iter().map(change).collect()
    };
    let line = (0..=300).map(|k| {
        let time_s = first.0 + (last.0 - first.0) * f64::from(k) / 300.0;
        (time_s / 60.0, 100.0 * undone(time_s))
    });
    let curves = vec![
        Series::line("undone", 0, line.collect()),
        Series::dots("reference", 1, along(0.0)),
        Series::dots("with its σ", 5, along(1.0).into_iter().chain(along(-1.0)).collect()),
    ];
    let change = Axis::linear("change at the reference (%)");
    figure.panels.push(Panel::new(Axis::linear("time (min)"), change, curves));
}

fn figure(found: &Efficiency, name: &str) -> Option<Figure> {
    let along = |value: &dyn Fn(&Row) -> f64| -> Vec<(f64, f64)> {
        found.rows.iter().map(|row| (row.wavelength_nm, value(row))).collect()
    };
    let at = |k: f64| along(&|row| row.efficiency + k * row.components.total());
    let serious = |row: &Row| !(row.flags - EfficiencyFlags::BELOW_DETECTION).is_empty();
    let mut curves = vec![
        Series::line("η", 0, along(&|row| row.efficiency)),
        Series::line("η plus its σ", 5, at(1.0)),
        Series::line("η minus its σ", 5, at(-1.0)),
    ];
    if found.rows.iter().any(|row| serious(row) && row.efficiency.is_finite()) {
        let flagged = along(&|row| if serious(row) { row.efficiency } else { f64::NAN });
        curves.push(Series::dots("flagged", 1, flagged));
    }
    let part = |value: fn(&Row) -> f64| along(&|row| value(row) / row.efficiency.abs());
    let parts = vec![
        Series::line("counts", 0, part(|r| r.components.counts)),
        Series::line("photodiode", 1, part(|r| r.components.photodiode)),
        Series::line("wavelength", 2, part(|r| r.components.wavelength)),
        Series::line("linearity", 3, part(|r| r.components.linearity)),
        Series::line("responsivity", 4, part(|r| r.components.responsivity)),
        Series::line("load", 5, part(|r| r.components.load)),
        Series::line("geometry", 6, part(|r| r.components.geometry)),
        Series::line("transmissions", 7, part(|r| r.components.transmissions)),
        Series::line("drift", 8, part(|r| r.components.drift)),
    ];
    let nm = || Axis::linear("vacuum wavelength (nm)");
    let drawn = |series: &[Series], least: f64| {
        series.iter().any(|s| s.points.iter().any(|p| p.1.is_finite() && p.1 > least))
    };
    // Nothing to draw where no wavelength has an efficiency.
    let mut panels = vec![];
    if drawn(&curves, f64::NEG_INFINITY) {
        panels.push(Panel::new(nm(), Axis::linear("efficiency η"), curves));
    }
    if drawn(&parts, 0.0) {
        panels.push(Panel::new(nm(), Axis::log("relative uncertainty"), parts));
    }
    let title = format!("{name}: counts per photon");
    (!panels.is_empty()).then_some(Figure { title, panels })
}
