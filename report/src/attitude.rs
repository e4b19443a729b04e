//! The attitude of a body of known shape: summary, JSON, tables, figures.

use crate::plot::{Axis, Figure, Heat, Panel, RGBColor, Series, Style};
use crate::{Product, json_of, rounded};
use glam::DVec3;
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_formats::time::{format_utc, format_utc_shortest};
use sunglint_formats::{Column, Table};
use sunglint_inference::attitude::twins::ALIKE;
use sunglint_inference::attitude::{AttitudeAnalysis, Minimum, Verdict};

/// Step of the error surface, degrees.
const CELL_DEG: f64 = 2.0;
/// Radius of the ring about a minimum, degrees.
const RING_DEG: f64 = 4.0;
/// Channels that are drawn.
const DRAWN: usize = 3;

/// The summary as text.
pub fn text(analysis: &AttitudeAnalysis) -> String {
    let answer = &analysis.answer;
    let mut text = format!("attitude of {}: ", analysis.name);
    match &answer.verdict {
        Verdict::One => text.push_str("one\n"),
        Verdict::Several(n) => {
            let _ = writeln!(text, "{n} that the data do not tell apart");
        }
        Verdict::Undetermined(why) => {
            let _ = writeln!(text, "not determined: {why}");
        }
    }
    let _ = writeln!(
        text,
        "  {} samples at {} epochs over {:.1} s, {:.2} turns; noise beyond the stated {:.2} % of the light, reduced chi-square {:.2}",
        answer.samples,
        answer.epochs,
        answer.span_s,
        answer.turns,
        100.0 * answer.extra_noise,
        answer.reduced_chi2
    );
    let _ = writeln!(
        text,
        "\n      RA (deg)  Dec (deg)    ± (deg)        period (s)        ±     phase (deg)       ±    chi-square above  probability"
    );
    for (i, m) in answer.minima.iter().enumerate() {
        let _ = writeln!(text, "  {:>2}{}", i + 1, row(m));
        if let Some((twin, off)) = &m.twin {
            let alike = match twin.unlike() {
                u if u > 0.0 => {
                    format!("; the body's light is then unlike by {:.1} %", 100.0 * u)
                }
                _ => String::new(),
            };
            let _ =
                writeln!(text, "      = the first by {}, {off:.1}° from it{alike}", twin.name());
        }
    }
    for (name, (value, sigma)) in analysis.scale_names().iter().zip(&answer.minima[0].scales) {
        let _ = writeln!(text, "  brightness, {name:<16} {value:>9.4} ± {sigma:.4}");
    }
    let (median, most) = answer.other_light;
    let _ = writeln!(
        text,
        "\n  phases count at {}; light by other ways than straight from the Sun: {:.1} % of a sample in the middle, {:.0} % at most",
        format_utc_shortest(analysis.question.epoch),
        100.0 * median,
        100.0 * most
    );
    let _ = writeln!(
        text,
        "  {} axes{}, {} periods, {} epochs simulated in {:.1} s",
        answer.surface.len(),
        if answer.finer { " (searched twice: finer, and by the Earth's light too)" } else { "" },
        answer.periods,
        answer.simulated,
        analysis.seconds
    );
    text
}

/// The minima, the best attitude's curve, figures and JSON.
pub fn product(analysis: &AttitudeAnalysis) -> Product {
    Product {
        name: "attitude".into(),
        table: table(analysis),
        figure: surface(analysis),
        json: json(analysis),
        others: vec![Product {
            name: "attitude_curve".into(),
            table: curve(analysis),
            figure: curves(analysis),
            ..Product::default()
        }],
        ..Product::default()
    }
}

#[derive(Serialize)]
struct MinimumJson<'a> {
    ra_deg: f64,
    dec_deg: f64,
    axis_sigma_deg: Option<[f64; 2]>,
    axis_position_deg: Option<f64>,
    period_s: f64,
    period_sigma_s: Option<f64>,
    phase_deg: f64,
    phase_sigma_deg: Option<f64>,
    turn_sigma_deg: Option<f64>,
    attitude_sigma_deg: Option<f64>,
    covariance: Vec<Vec<f64>>,
    chi2: f64,
    delta_chi2: f64,
    probability: f64,
    from_best_deg: f64,
    twin: Option<TwinJson>,
    brightness: Vec<BrightnessJson<'a>>,
}

#[derive(Serialize)]
struct TwinJson {
    symmetry: String,
    exchanged: bool,
    unlike: f64,
    off_deg: f64,
}

#[derive(Serialize)]
struct BrightnessJson<'a> {
    name: &'a str,
    value: f64,
    sigma: f64,
}

#[derive(Serialize)]
struct AttitudeJson<'a> {
    name: &'a str,
    verdict: &'a str,
    reason: Option<String>,
    minima: Vec<MinimumJson<'a>>,
    epoch_utc: String,
    axis_body: [f64; 3],
    unknown: UnknownJson,
    channels: &'a [String],
    samples: usize,
    epochs: usize,
    epochs_taken: usize,
    span_s: f64,
    turns: f64,
    reduced_chi2: f64,
    extra_noise: f64,
    residual_correlation: f64,
    other_light: OtherLight,
    symmetries: Vec<SymmetryJson<'a>>,
    search: SearchJson,
    curves: Vec<CurveJson<'a>>,
    warnings: &'a [String],
}

#[derive(Serialize)]
struct UnknownJson {
    axis: bool,
    phase: bool,
    period: bool,
}

#[derive(Serialize)]
struct OtherLight {
    median_share: f64,
    largest_share: f64,
}

#[derive(Serialize)]
struct SymmetryJson<'a> {
    name: &'a str,
    unlike: f64,
    taken: bool,
}

#[derive(Serialize)]
struct SearchJson {
    axes: usize,
    periods: usize,
    simulated_epochs: usize,
    finer: bool,
    seconds: f64,
}

#[derive(Serialize)]
struct CurveJson<'a> {
    path: String,
    left_out: Vec<LostJson<'a>>,
}

#[derive(Serialize)]
struct LostJson<'a> {
    why: &'a str,
    samples: usize,
}

/// The analysis with documented keys.
pub fn json(analysis: &AttitudeAnalysis) -> Value {
    let answer = &analysis.answer;
    let scales = analysis.scale_names();
    let minimum = |m: &Minimum| MinimumJson {
        ra_deg: rounded(m.ra_deg),
        dec_deg: rounded(m.dec_deg),
        axis_sigma_deg: m.axis.map(|a| [rounded(a.major_deg), rounded(a.minor_deg)]),
        axis_position_deg: m.axis.map(|a| rounded(a.position_deg)),
        period_s: rounded(m.period_s),
        period_sigma_s: m.period_sigma_s.map(rounded),
        phase_deg: rounded(m.phase_deg),
        phase_sigma_deg: m.phase_sigma_deg.map(rounded),
        turn_sigma_deg: m.turn_sigma_deg.map(rounded),
        attitude_sigma_deg: m.attitude_sigma_deg.map(rounded),
        covariance: m.covariance.iter().map(|r| r.iter().map(|v| rounded(*v)).collect()).collect(),
        chi2: rounded(m.chi2),
        delta_chi2: rounded(m.delta_chi2),
        probability: rounded(m.probability),
        from_best_deg: rounded(m.from_best_deg),
        twin: m.twin.as_ref().map(|(twin, off)| TwinJson {
            symmetry: twin.name(),
            exchanged: twin.exchanged,
            unlike: rounded(twin.unlike()),
            off_deg: rounded(*off),
        }),
        brightness: scales
            .iter()
            .zip(&m.scales)
            .map(|(name, (value, sigma))| BrightnessJson {
                name,
                value: rounded(*value),
                sigma: rounded(*sigma),
            })
            .collect(),
    };
    json_of(&AttitudeJson {
        name: &analysis.name,
        verdict: analysis.answer.verdict.name(),
        reason: match &answer.verdict {
            Verdict::Undetermined(why) => Some(why.clone()),
            _ => None,
        },
        minima: answer.minima.iter().map(minimum).collect(),
        epoch_utc: format_utc_shortest(analysis.question.epoch),
        axis_body: analysis.question.axis_body.to_array().map(rounded),
        unknown: UnknownJson {
            axis: analysis.question.unknowns.axis,
            phase: analysis.question.unknowns.phase,
            period: analysis.question.unknowns.period,
        },
        channels: &analysis.channels,
        samples: answer.samples,
        epochs: answer.epochs,
        epochs_taken: answer.epochs_taken,
        span_s: rounded(answer.span_s),
        turns: rounded(answer.turns),
        reduced_chi2: rounded(answer.reduced_chi2),
        extra_noise: rounded(answer.extra_noise),
        residual_correlation: rounded(answer.correlation),
        other_light: OtherLight {
            median_share: rounded(answer.other_light.0),
            largest_share: rounded(answer.other_light.1),
        },
        symmetries: answer
            .symmetries
            .iter()
            .map(|s| SymmetryJson {
                name: s.name,
                unlike: rounded(s.unlike),
                taken: s.unlike < ALIKE,
            })
            .collect(),
        search: SearchJson {
            axes: answer.surface.len(),
            periods: answer.periods,
            simulated_epochs: answer.simulated,
            finer: answer.finer,
            seconds: rounded(analysis.seconds),
        },
        curves: analysis
            .curves
            .iter()
            .zip(&analysis.left_out)
            .map(|(curve, lost)| CurveJson {
                path: curve.measured.path.display().to_string(),
                left_out: lost.iter().map(|(why, n)| LostJson { why, samples: *n }).collect(),
            })
            .collect(),
        warnings: &analysis.warnings,
    })
}

/// A minimum a row.
fn table(analysis: &AttitudeAnalysis) -> Table {
    let minima = &analysis.answer.minima;
    let of = |f: &dyn Fn(&Minimum) -> f64| minima.iter().map(f).collect::<Vec<f64>>();
    let deg = Some("deg");
    let nan = f64::NAN;
    let mut table = Table::default();
    table.meta.insert("title".into(), format!("{}: minima of the attitude", analysis.name).into());
    table.meta.insert("epoch_utc".into(), format_utc_shortest(analysis.question.epoch).into());
    table.columns = vec![
        Column::f64("ra_deg", deg, of(&|m| m.ra_deg)).described("of the axis, GCRS"),
        Column::f64("dec_deg", deg, of(&|m| m.dec_deg)),
        Column::f64("axis_sigma_major_deg", deg, of(&|m| m.axis.map_or(nan, |a| a.major_deg))),
        Column::f64("axis_sigma_minor_deg", deg, of(&|m| m.axis.map_or(nan, |a| a.minor_deg))),
        Column::f64("axis_position_deg", deg, of(&|m| m.axis.map_or(nan, |a| a.position_deg)))
            .described("of the longer axis, from north through east"),
        Column::f64("period_s", Some("s"), of(&|m| m.period_s)).described("negative: left-handed"),
        Column::f64("period_sigma_s", Some("s"), of(&|m| m.period_sigma_s.unwrap_or(nan))),
        Column::f64("phase_deg", deg, of(&|m| m.phase_deg)).described("at epoch_utc"),
        Column::f64("phase_sigma_deg", deg, of(&|m| m.phase_sigma_deg.unwrap_or(nan))),
        Column::f64("delta_chi2", None, of(&|m| m.delta_chi2)),
        Column::f64("probability", None, of(&|m| m.probability)),
        Column::text(
            "twin",
            minima.iter().map(|m| m.twin.as_ref().map_or(String::new(), |t| t.0.name())).collect(),
        ),
    ];
    table
}

/// The error surface over the axis' sphere, with the minima.
fn surface(analysis: &AttitudeAnalysis) -> Option<Figure> {
    let surface = &analysis.answer.surface;
    if surface.len() < 12 {
        return curves(analysis);
    }
    let (columns, rows) = ((360.0 / CELL_DEG) as usize, (180.0 / CELL_DEG) as usize);
    let edges = |n: usize, from: f64| (0..=n).map(|i| from + CELL_DEG * i as f64).collect();
    let mut values = Vec::with_capacity(columns * rows);
    for i in 0..columns {
        for j in 0..rows {
            let ra = (CELL_DEG * (i as f64 + 0.5)).to_radians();
            let dec = (CELL_DEG * (j as f64 + 0.5) - 90.0).to_radians();
            let at = DVec3::new(dec.cos() * ra.cos(), dec.cos() * ra.sin(), dec.sin());
            let nearest = surface.iter().max_by(|a, b| a.0.dot(at).total_cmp(&b.0.dot(at)));
            values.push(nearest.map_or(f64::NAN, |n| n.1));
        }
    }
    // A ring is seen where a dot is not; the best one is drawn last.
    let drawn = analysis.answer.minima.iter().enumerate().rev();
    let marks = drawn.map(|(i, m)| {
        let ring = (0..=36).map(|k| {
            let (sin, cos) = (10.0 * f64::from(k)).to_radians().sin_cos();
            let (r, across) = (RING_DEG, m.dec_deg.to_radians().cos().max(0.1));
            let (ra, dec) = (m.ra_deg + r * cos / across, m.dec_deg + r * sin);
            let inside = (0.0..=360.0).contains(&ra) && dec.abs() <= 90.0;
            if inside { (ra, dec) } else { (f64::NAN, f64::NAN) }
        });
        // No names: the scale of colours stands where the legend would.
        let mut ring = Series::line("", 1, ring.collect());
        if i > 0 {
            ring.colour = RGBColor(255, 255, 255);
            ring.dash = 2;
        }
        ring
    });
    let mut panel = Panel::new(
        Axis::linear("right ascension of the axis (deg)").from_to(0.0, 360.0),
        Axis::linear("declination (deg)").from_to(-90.0, 90.0),
        marks.collect(),
    );
    panel.heat = Some(Heat {
        x_edges: edges(columns, 0.0),
        y_edges: edges(rows, -90.0),
        values,
        label: vec!["misfit of the".into(), "best phase and".into(), "period".into()],
        decades: None,
    });
    let title = format!(
        "{}: misfit over the axis' sphere; the best in a ring, other minima dotted",
        analysis.name
    );
    Some(Figure { title, panels: vec![panel] })
}

/// Every sample beside the best attitude's.
fn curve(analysis: &AttitudeAnalysis) -> Table {
    let samples = &analysis.answer.best;
    let time = |s: &sunglint_inference::attitude::Sample| {
        let at = &analysis.answer.moments[s.moment];
        let curve = &analysis.curves[at.0].measured;
        (curve.times[at.1], at.0)
    };
    let mut table = Table::default();
    table.meta.insert("title".into(), format!("{}: measured and simulated", analysis.name).into());
    let unit = if analysis.curves[0].measured.magnitudes { None } else { Some("Hz") };
    table.columns = vec![
        Column::text("time_utc", samples.iter().map(|s| format_utc(time(s).0, 6)).collect()),
        Column::i64("curve", None, samples.iter().map(|s| time(s).1 as i64 + 1).collect()),
        Column::text(
            "channel",
            samples.iter().map(|s| analysis.channels[s.channel].clone()).collect(),
        ),
        Column::f64("measured", unit, samples.iter().map(|s| s.rate).collect()),
        Column::f64("sigma", unit, samples.iter().map(|s| s.sigma).collect())
            .described("the stated one"),
        Column::f64("simulated", unit, samples.iter().map(|s| s.model).collect()),
    ];
    table
}

/// Some channels of the first curve, measured and simulated.
fn curves(analysis: &AttitudeAnalysis) -> Option<Figure> {
    let first = analysis.answer.best.first()?;
    let own = analysis.answer.moments[first.moment].0;
    let zero = analysis.curves[own].measured.times[analysis.answer.moments[first.moment].1];
    let x = || Axis::linear(format!("s since {}", format_utc(zero, 1)));
    let mut panels = Vec::new();
    for (c, name) in analysis.channels.iter().enumerate() {
        if panels.len() >= DRAWN {
            break;
        }
        let (mut measured, mut simulated) = (Vec::new(), Vec::new());
        for s in analysis.answer.best.iter().filter(|s| s.channel == c) {
            let at = analysis.answer.moments[s.moment];
            if at.0 != own {
                continue;
            }
            let t = (analysis.curves[own].measured.times[at.1] - zero).to_seconds();
            measured.push((t, s.rate));
            simulated.push((t, s.model));
        }
        if measured.is_empty() {
            continue;
        }
        let mut dots = Series::line("measured", 0, measured);
        dots.style = Style::Dots;
        let y = if analysis.curves[own].measured.magnitudes {
            Axis::log(format!("{name}: flux"))
        } else {
            Axis::log(format!("{name}: rate (Hz)"))
        };
        panels.push(Panel::new(x(), y, vec![dots, Series::line("simulated", 1, simulated)]));
    }
    let title = format!("{}: measured, and simulated with the best attitude", analysis.name);
    (!panels.is_empty()).then_some(Figure { title, panels })
}

/// A minimum in a line.
fn row(m: &Minimum) -> String {
    let known = "        -".to_owned();
    let axis = m
        .axis
        .map_or("      -      ".into(), |a| format!("{:>6.3}×{:<6.3}", a.major_deg, a.minor_deg));
    let sigma = |s: Option<f64>| s.map_or(known.clone(), |s| format!("{s:>9.2e}"));
    format!(
        "  {:>9.3} {:>+9.3}  {axis} {:>15.6} {} {:>11.3} {}  {:>14.1} {:>12.4}",
        m.ra_deg,
        m.dec_deg,
        m.period_s,
        sigma(m.period_sigma_s),
        m.phase_deg,
        sigma(m.phase_sigma_deg),
        m.delta_chi2,
        m.probability
    )
}
