//! What is asked, by the scene and the options.

use super::{AttitudeArgs, Known, Sense};
use crate::fit::scene::Scene;
use crate::output::Usage;
use anyhow::{Context as _, bail};
use glam::DVec3;
use sunglint_formats::time::parse_utc;
use sunglint_inference::attitude::{Measured, Question, Turn, Unknowns};
use toml::Value;

/// The shortest period that is looked for, in steps of the data.
const LEAST_STEPS: f64 = 4.0;

/// What is asked.
pub(super) fn asked(
    args: &AttitudeArgs,
    scene: &Scene,
    curves: &[Measured],
) -> anyhow::Result<Question> {
    let path = scene.path.display();
    let law = scene.attitude_key("law").and_then(Value::as_str);
    if law != Some("spin") || scene.attitude_key("axis_body").is_none() {
        bail!(
            "{path}: [attitude] has the law {}{}: what is looked for is a spin about a known axis of the body: law = \"spin\", axis_body = [x, y, z], and any axis_ra_dec_deg, period_s and epoch_utc",
            law.unwrap_or("of nothing"),
            if law == Some("spin") { " without axis_body" } else { "" },
        );
    }
    let number = |name: &str| scene.get(&format!("attitude.{name}"));
    let body = ["axis_body.0", "axis_body.1", "axis_body.2"].map(number);
    let [Some(x), Some(y), Some(z)] = body else {
        bail!("{path}: attitude.axis_body: expected three numbers");
    };
    let epoch = scene.attitude_key("epoch_utc").map(|v| match v {
        Value::String(text) => text.clone(),
        other => other.to_string(),
    });
    let epoch = epoch.with_context(|| format!("{path}: attitude.epoch_utc is missing"))?;
    let epoch =
        parse_utc(&epoch).map_err(|e| e.in_file(&scene.path).in_field("attitude.epoch_utc"))?;
    let known = |what: Known| args.known.contains(&what);
    let place = (number("axis_ra_dec_deg.0"), number("axis_ra_dec_deg.1"));
    let axis_gcrs = match place {
        (Some(ra), Some(dec)) => direction(ra, dec),
        _ if known(Known::Axis) => {
            bail!("{path}: --known axis, but [attitude] has neither axis_ra_dec_deg nor axis_gcrs")
        }
        _ => DVec3::Z,
    };
    let turns_per_s = match (number("period_s"), number("rate_deg_s"), number("rate_rpm")) {
        (Some(period), ..) => 1.0 / period,
        (_, Some(rate), _) => rate / 360.0,
        (.., Some(rate)) => rate / 60.0,
        _ => 0.0,
    };
    let unknowns = Unknowns {
        axis: !known(Known::Axis),
        phase: !known(Known::Phase),
        period: !known(Known::Period),
    };
    if unknowns.count() == 0 {
        return Err(Usage("--known axis,phase,period leaves nothing to look for: `sunglint compare` compares a scene with a curve".into()).into());
    }
    if !unknowns.period && (args.period.is_some() || args.sense != Sense::Both) {
        return Err(Usage(
            "--known period takes the scene's: neither --period nor --sense beside it".into(),
        )
        .into());
    }
    if place.0.is_none() && known(Known::Phase) {
        bail!(
            "{path}: --known phase, but [attitude] has no axis_ra_dec_deg from which a phase counts"
        );
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
        rates: rates(args, curves)?,
        scale: args.scale.into(),
    })
}

fn direction(ra_deg: f64, dec_deg: f64) -> DVec3 {
    sunglint_radiometry::sky::Equatorial { ra_deg, dec_deg }.direction()
}

/// Turns a second that are looked for.
fn rates(args: &AttitudeArgs, curves: &[Measured]) -> anyhow::Result<Vec<(f64, f64)>> {
    let (shortest, longest) = match &args.period {
        Some(text) => bounds(text)?,
        None => (shortest_s(curves), f64::INFINITY),
    };
    let (low, high) = (1.0 / longest, 1.0 / shortest);
    Ok(match args.sense {
        Sense::Right => vec![(low, high)],
        Sense::Left => vec![(-high, -low)],
        Sense::Both if low == 0.0 => vec![(-high, high)],
        Sense::Both => vec![(-high, -low), (low, high)],
    })
}

/// `LO..HI` in seconds.
fn bounds(text: &str) -> anyhow::Result<(f64, f64)> {
    let wrong = || {
        Usage(format!(
            "--period {text}: expected LO..HI in seconds, above 0 and the first below the second (LO.. without an upper bound)"
        ))
    };
    let (low, high) = text.split_once("..").ok_or_else(wrong)?;
    let low: f64 = low.trim().parse().map_err(|_| wrong())?;
    let high: f64 = match high.trim() {
        "" => f64::INFINITY,
        high => high.parse().map_err(|_| wrong())?,
    };
    if low > 0.0 && low.is_finite() && low < high { Ok((low, high)) } else { Err(wrong().into()) }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_of_periods_are_read() {
        assert_eq!(bounds("5..200").unwrap(), (5.0, 200.0));
        assert_eq!(bounds("2.5..").unwrap(), (2.5, f64::INFINITY));
        for wrong in ["", "5", "0..3", "9..2", "..7", "a..b", "nan..5", "-3..5"] {
            assert!(bounds(wrong).unwrap_err().to_string().contains("LO..HI"), "{wrong}");
        }
    }
}
