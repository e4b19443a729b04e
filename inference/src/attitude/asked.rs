//! Question of an attitude search, made from a scene and the options.

use super::analysis::{AnalysisError, AnalysisOptions, Sense};
use super::{Measured, Question, Turn};
use crate::scene::Scene;
use glam::DVec3;
use sunglint_formats::time::parse_utc;
use toml::Value;

/// The shortest period that is looked for, in steps of the data.
const LEAST_STEPS: f64 = 4.0;

/// Makes the question from the options, the scene and the curves.
pub(super) fn asked(
    options: &AnalysisOptions,
    scene: &Scene,
    curves: &[Measured],
) -> Result<Question, AnalysisError> {
    let path = || scene.path.clone();
    let law = scene.attitude_key("law").and_then(Value::as_str);
    if law != Some("spin") || scene.attitude_key("axis_body").is_none() {
        return Err(AnalysisError::Law {
            path: path(),
            law: law.unwrap_or("of nothing").to_owned(),
            spins: law == Some("spin"),
        });
    }
    let number = |name: &str| scene.get(&format!("attitude.{name}"));
    let body = ["axis_body.0", "axis_body.1", "axis_body.2"].map(number);
    let [Some(x), Some(y), Some(z)] = body else {
        return Err(AnalysisError::AxisBody { path: path() });
    };
    let epoch = scene.attitude_key("epoch_utc").map(|v| match v {
        Value::String(text) => text.clone(),
        other => other.to_string(),
    });
    let epoch = epoch.ok_or_else(|| AnalysisError::NoEpoch { path: path() })?;
    let epoch =
        parse_utc(&epoch).map_err(|e| e.in_file(&scene.path).in_field("attitude.epoch_utc"))?;
    let unknowns = options.unknowns;
    let place = (number("axis_ra_dec_deg.0"), number("axis_ra_dec_deg.1"));
    let axis_gcrs = match place {
        (Some(ra), Some(dec)) => direction(ra, dec),
        _ if !unknowns.axis => return Err(AnalysisError::NoAxis { path: path() }),
        _ => DVec3::Z,
    };
    let turns_per_s = match (number("period_s"), number("rate_deg_s"), number("rate_rpm")) {
        (Some(period), ..) => 1.0 / period,
        (_, Some(rate), _) => rate / 360.0,
        (.., Some(rate)) => rate / 60.0,
        _ => 0.0,
    };
    if unknowns.count() == 0 {
        return Err(AnalysisError::NothingUnknown);
    }
    if !unknowns.period && (options.period_s.is_some() || options.sense != Sense::Both) {
        return Err(AnalysisError::PeriodKnown);
    }
    if place.0.is_none() && !unknowns.phase {
        return Err(AnalysisError::NoPhase { path: path() });
    }
    Ok(Question {
        axis_body: DVec3::new(x, y, z),
        epoch,
        unknowns,
        known: Turn {
            axis_gcrs,
            turns_per_s,
            phase_rad: number("phase_deg").unwrap_or(0.0).to_radians(),
        },
        rates: rates(options, curves),
        scale: options.scale,
    })
}

fn direction(ra_deg: f64, dec_deg: f64) -> DVec3 {
    sunglint_radiometry::sky::Equatorial { ra_deg, dec_deg }.direction()
}

/// Turns a second that are looked for.
fn rates(options: &AnalysisOptions, curves: &[Measured]) -> Vec<(f64, f64)> {
    let (shortest, longest) = options.period_s.unwrap_or((shortest_s(curves), f64::INFINITY));
    let (low, high) = (1.0 / longest, 1.0 / shortest);
    match options.sense {
        Sense::Right => vec![(low, high)],
        Sense::Left => vec![(-high, -low)],
        Sense::Both if low == 0.0 => vec![(-high, high)],
        Sense::Both => vec![(-high, -low), (low, high)],
    }
}

/// Some steps of the data that count, or of the exposures where those are longer.
fn shortest_s(curves: &[Measured]) -> f64 {
    let mut steps = Vec::new();
    for curve in curves {
        let counts = |i: &usize| curve.data.used.row(*i).iter().any(|u| *u);
        let times: Vec<_> =
            (0..curve.data.epochs()).filter(counts).map(|i| curve.pass.times[i]).collect();
        steps.extend(
            times.windows(2).map(|w| (w[1] - w[0]).to_seconds().abs()).filter(|s| *s > 0.0),
        );
        steps.extend(curve.pass.exposure_s.iter().copied().take(1));
    }
    steps.sort_by(f64::total_cmp);
    LEAST_STEPS * steps.get(steps.len() / 2).copied().unwrap_or(1.0)
}
