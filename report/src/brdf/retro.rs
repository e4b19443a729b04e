//! Retro-reflection against angle: figure, words, document.

use crate::plot::{Axis, Figure, Panel, Series};
use crate::{Product, json_of, rounded};
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use sunglint_materials::ndf::ZeroOrigin;
use sunglint_materials::retro::Scale;
use sunglint_materials::retro::measure::{Line, Phase, State};
use sunglint_materials::retro::plan::RunPlan;
use sunglint_materials::retro::{Retro, Row, smallest_alpha, to_table};
use sunglint_materials::table::RetroFlags;

/// Powers as eight heights of blocks, from the logarithm of the least to that of the largest; what is no light is a blank.
pub fn curve(powers: &[f64]) -> String {
    const BLOCKS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let good = || powers.iter().copied().filter(|p| p.is_finite() && *p > 0.0);
    let (low, high) = (good().fold(f64::INFINITY, f64::min), good().fold(0.0, f64::max));
    let width = (high / low).ln();
    let block = |power: &f64| {
        if *power == f64::INFINITY {
            return '^';
        }
        if !power.is_finite() || *power <= 0.0 {
            return ' ';
        }
        let part = if width > 0.0 { (power / low).ln() / width } else { 0.0 };
        BLOCKS[((part * 8.0) as usize).min(7)]
    };
    powers.iter().map(block).collect()
}

/// Angles of a plan that its lines do not have yet.
pub fn left(plan: &RunPlan, lines: &[Line]) -> usize {
    let kept = lines.iter().filter(|l| l.state == State::Kept && l.phase == Phase::Sample);
    let asked: std::collections::HashSet<u64> = kept.map(|l| l.asked_deg.to_bits()).collect();
    let missing = |angle: &&f64| !asked.contains(&angle.to_bits());
    plan.measuring.scan.angles().iter().filter(missing).count()
}

/// A reduced run in all its forms; `devices` are what its devices said of themselves.
pub fn product(
    retro: &Retro,
    plan: &RunPlan,
    lines: &[Line],
    devices: &Value,
    folder: &Path,
) -> Product {
    let mut table = to_table(retro);
    table.meta.insert("sample".into(), json_of(&plan.name));
    table.meta.insert("devices".into(), devices.clone());
    table.meta.insert("program".into(), format!("sunglint {}", env!("CARGO_PKG_VERSION")).into());
    table.meta.insert("plan".into(), json_of(&plan.source));
    Product {
        name: "retro".into(),
        figure: Some(figure(retro, &plan.name)),
        json: document(retro, &folder.display().to_string(), left(plan, lines)),
        table,
        ..Product::default()
    }
}

/// f against the angle, its uncertainties by component, the powers behind it.
pub fn figure(retro: &Retro, name: &str) -> Figure {
    let along = |value: &dyn Fn(&Row) -> f64| -> Vec<(f64, f64)> {
        let mut points: Vec<(f64, f64)> =
            retro.rows.iter().map(|r| (r.angle_deg, value(r))).collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    };
    let angle = || Axis::linear("angle of the stage (deg)");
    let bad = |r: &Row| !(r.flags - RetroFlags::OUTLIERS).is_empty();
    let good = along(&|r| if bad(r) { f64::NAN } else { r.f_per_sr });
    let mut f = vec![Series::dots("measured", 0, good)];
    if retro.rows.iter().any(bad) {
        f.push(Series::dots("flagged", 1, along(&|r| if bad(r) { r.f_per_sr } else { f64::NAN })));
    }
    let part = |value: fn(&Row) -> f64| along(&|r| value(r) / r.f_per_sr.abs());
    let scale = retro.scale.total();
    let mut sigma = vec![
        Series::line("readings", 0, part(|r| r.components.readout_per_sr)),
        Series::line("no sample", 1, part(|r| r.components.signature_per_sr)),
        Series::line("drift", 2, part(|r| r.components.drift_per_sr)),
        Series::line("angle", 3, part(|r| r.components.angle_per_sr)),
    ];
    if scale > 0.0 {
        sigma.push(Series::line("in common", 4, along(&|_| scale)));
    }
    let power = vec![
        Series::line("sample", 0, along(&|r| r.power.power_w)),
        Series::line("no sample", 1, along(&|r| r.signature_w)),
    ];
    let drawn = |series: &[Series]| series.iter().any(|s| s.points.iter().any(|p| p.1 > 0.0));
    let mut panels = vec![];
    for (axis, series) in [
        (Axis::log("retro-reflection f (sr⁻¹)"), f),
        (Axis::log("relative uncertainty"), sigma),
        (Axis::log("power at the meter (W)"), power),
    ] {
        if drawn(&series) {
            panels.push(Panel::new(angle(), axis, series));
        }
    }
    let title = format!("{name}: retro-reflection at {} nm", retro.wavelength_nm);
    Figure { title, panels }
}

/// The words.
pub fn text(retro: &Retro, left: usize) -> String {
    let mut text = String::new();
    let (zero, sigma, origin) = retro.zero;
    let of = match origin {
        ZeroOrigin::Fitted => "from both sides",
        ZeroOrigin::Given => "given",
        ZeroOrigin::Law => "by a law",
        ZeroOrigin::Assumed => "not known",
    };
    let _ = writeln!(text, "angles    {}, {left} not measured", retro.rows.len());
    let peak = retro.rows.iter().filter(|r| r.flags.is_empty());
    if let Some(row) = peak.max_by(|a, b| a.f_per_sr.total_cmp(&b.f_per_sr)) {
        let _ = writeln!(
            text,
            "peak      {:.5} ± {:.5} sr⁻¹ at {:.3}°",
            row.f_per_sr,
            row.components.total_per_sr(),
            row.angle_deg
        );
    }
    let s = &retro.scale;
    let percent = |x: f64| 100.0 * x;
    let _ = writeln!(
        text,
        "scale     ± {:.2} % of all f (incident {:.2}, splitter {:.2}, lens {:.2}, solid angle {:.2}, standard {:.2})",
        percent(s.total()),
        percent(s.incident),
        percent(s.splitter),
        percent(s.lens),
        percent(s.solid_angle),
        percent(s.standard)
    );
    let _ = writeln!(text, "normal    at {zero:.4}° ± {sigma:.4}° ({of})");
    let _ = writeln!(
        text,
        "cone      {:.4e} sr, ± {:.4}°: no α below {:.5} is seen",
        retro.solid_angle_sr,
        retro.cone_half_angle_deg,
        smallest_alpha(retro.cone_half_angle_deg)
    );
    text
}

#[derive(Serialize)]
struct IncidentJson {
    time_s: f64,
    power_w: f64,
    sigma_w: f64,
}

#[derive(Serialize)]
struct RetroJson<'a> {
    run: &'a str,
    angles: usize,
    angles_left: usize,
    wavelength_nm: f64,
    incident: Vec<IncidentJson>,
    solid_angle_sr: f64,
    cone_half_angle_deg: f64,
    smallest_alpha: f64,
    scale_sigma: f64,
    scale_sigma_by: &'a Scale,
    zero: ZeroJson,
    flagged: BTreeMap<String, usize>,
    warnings: Vec<String>,
}

#[derive(Serialize)]
struct ZeroJson {
    angle_deg: f64,
    sigma_deg: f64,
    origin: ZeroOrigin,
}

/// The document.
pub fn document(retro: &Retro, folder: &str, left: usize) -> Value {
    let mut flags: BTreeMap<String, usize> = BTreeMap::new();
    for row in &retro.rows {
        for (name, _) in row.flags.iter_names() {
            *flags.entry(name.to_lowercase()).or_default() += 1;
        }
    }
    let incident = |(time_s, power_w, sigma_w): &(f64, f64, f64)| IncidentJson {
        time_s: rounded(*time_s),
        power_w: rounded(*power_w),
        sigma_w: rounded(*sigma_w),
    };
    let warnings: Vec<String> = retro.notes.iter().map(ToString::to_string).collect();
    let (angle_deg, sigma_deg, origin) = retro.zero;
    json_of(&RetroJson {
        run: folder,
        angles: retro.rows.len(),
        angles_left: left,
        wavelength_nm: retro.wavelength_nm,
        incident: retro.incident.iter().map(incident).collect(),
        solid_angle_sr: rounded(retro.solid_angle_sr),
        cone_half_angle_deg: rounded(retro.cone_half_angle_deg),
        smallest_alpha: rounded(smallest_alpha(retro.cone_half_angle_deg)),
        scale_sigma: rounded(retro.scale.total()),
        scale_sigma_by: &retro.scale,
        zero: ZeroJson { angle_deg: rounded(angle_deg), sigma_deg: rounded(sigma_deg), origin },
        flagged: flags,
        warnings,
    })
}
