//! The page of a fit.

use super::{number, of_averaged, of_thinned};
use crate::numbers::{NO_WEIGHT, percent_with_sigma};
use crate::page::{Chart, Grid, Group, Kind, Line, Page, Scale, Section};
use sunglint_formats::time::format_utc_shortest;
use sunglint_inference::fit::{CurveFit, PassFit};
use sunglint_inference::solver::{Estimate, IntervalMethod, Side, Summary, Warning};

/// Correlations below this are not named on the page.
const NAMED: f64 = 0.5;
/// Correlations that are named at most.
const MOST_NAMED: usize = 40;
/// A gap between samples, s, past which charts begin anew.
const GAP_S: f64 = 1800.0;

fn heads(names: &[&str]) -> Vec<String> {
    names.iter().map(|n| (*n).to_owned()).collect()
}

/// The page.
pub(super) fn report(answer: &PassFit) -> Page {
    let files: Vec<String> = answer.curves.iter().map(|c| c.path.display().to_string()).collect();
    let names = answer.curves.iter().map(|c| c.name.as_str()).collect::<Vec<_>>();
    let (first, last) = answer.ends();
    Page {
        title: format!("{} fitted to {}", answer.name, names.join(", ")),
        subtitle: format!(
            "{} to {} · {} · {}",
            format_utc_shortest(first),
            format_utc_shortest(last),
            answer.station,
            files.join(", ")
        ),
        verdict: verdict(answer),
        figures: figures(answer),
        channels: answer.channels.iter().enumerate().map(|(c, n)| (n.clone(), c)).collect(),
        curves_title: "Measured and fitted".into(),
        curves_note: "Dots: measured. Lines: what was found, on the same epochs.".into(),
        groups: answer
            .curves
            .iter()
            .flat_map(|c| stretches(c).into_iter().map(|s| group(answer, c, &s)))
            .collect(),
        sections: sections(answer),
        program: concat!("sunglint ", env!("CARGO_PKG_VERSION")).into(),
        ..Page::default()
    }
}

fn verdict(answer: &PassFit) -> String {
    let fit = &answer.fit;
    let mut text = if fit.converged {
        format!(
            "The fit converged: {} parameters from {} samples. ",
            fit.parameters.len(),
            fit.samples
        )
    } else {
        "The fit did NOT converge: what it reached is below, and its intervals mean nothing. "
            .into()
    };
    text += &format!(
        "What is left is {:.2} times the stated noise (reduced χ² {:.2}). ",
        fit.reduced_chi2.sqrt(),
        fit.reduced_chi2
    );
    let open = |p: &&Estimate| p.interval_method == IntervalMethod::None;
    let open: Vec<&str> = fit.parameters.iter().filter(open).map(|p| p.name.as_str()).collect();
    if !open.is_empty() {
        text += &format!("The data do not determine {}. ", open.join(", "));
    }
    let bound: Vec<&str> =
        fit.parameters.iter().filter(|p| p.at_bound.is_some()).map(|p| p.name.as_str()).collect();
    if !bound.is_empty() {
        text += &format!("At a bound: {}. ", bound.join(", "));
    }
    let others = fit.minima.len().saturating_sub(1);
    if others > 0 {
        text += &format!("Other minima that the data do not firmly exclude: {others}. ");
    }
    text.trim_end().to_owned()
}

fn figures(answer: &PassFit) -> Vec<[String; 3]> {
    let fit = &answer.fit;
    let mut figures = vec![
        [
            "Reduced χ²".into(),
            format!("{:.2}", fit.reduced_chi2),
            format!("χ² {:.1} of {} degrees of freedom", fit.chi2, fit.degrees_of_freedom),
        ],
        [
            "Samples".into(),
            fit.samples.to_string(),
            format!("channels: {}, curves: {}", answer.channels.len(), answer.curves.len()),
        ],
    ];
    if let Some(bounces) = &answer.bounces {
        figures.push([
            "Between the parts".into(),
            format!("{:.1}\u{a0}%", 100.0 * bounces.share),
            format!("of a sample's light at most; {} rounds", bounces.rounds),
        ]);
    }
    figures.push([
        "Cost".into(),
        format!("{:.1}\u{a0}s", answer.seconds),
        format!("{} simulations", fit.evaluations),
    ]);
    figures
}

/// Stretches without a gap, in the order of time.
fn stretches(curve: &CurveFit) -> Vec<Vec<usize>> {
    let at = |i: usize| (curve.times[i] - curve.times[0]).to_seconds();
    let mut order: Vec<usize> = (0..curve.times.len()).collect();
    order.sort_by(|a, b| at(*a).total_cmp(&at(*b)));
    let mut all: Vec<Vec<usize>> = Vec::new();
    for i in order {
        match all.last_mut() {
            Some(own) if at(i) - own.last().map_or(0.0, |k| at(*k)) <= GAP_S => own.push(i),
            _ => all.push(vec![i]),
        }
    }
    all
}

fn group(answer: &PassFit, curve: &CurveFit, rows: &[usize]) -> Group {
    let start = curve.times[rows[0]];
    let at = |i: usize| (curve.times[i] - start).to_seconds();
    let shown = |v: f64| if curve.magnitudes { -2.5 * v.log10() } else { v };
    let to_mag = 2.5 / std::f64::consts::LN_10;
    let (mut values, mut left) = (Vec::new(), Vec::new());
    for (c, name) in answer.channels.iter().enumerate() {
        let measured = |i: &&usize| curve.rate[[**i, c]].is_finite();
        let (used, out): (Vec<usize>, Vec<usize>) =
            rows.iter().filter(measured).partition(|i| curve.used[[**i, c]]);
        let line = |rows: &[usize], f: &dyn Fn(usize) -> f64| Line {
            hue: c,
            ..Line::dots(
                name,
                Some(c),
                rows.iter().map(|i| at(*i)).collect(),
                rows.iter().map(|i| f(*i)).collect(),
            )
        };
        if used.is_empty() {
            continue;
        }
        let value = |i: usize| shown(curve.rate[[i, c]]);
        let sigma = |i: &usize| match curve.magnitudes {
            true => to_mag * curve.sigma[[*i, c]] / curve.rate[[*i, c]],
            false => curve.sigma[[*i, c]],
        };
        values.push(Line { sigma: used.iter().map(sigma).collect(), ..line(&used, &value) });
        if !out.is_empty() {
            values.push(line(&out, &value).of_kind(Kind::Out));
        }
        let fitted = |i: usize| shown(curve.model.model[[i, c]]);
        values.push(line(rows, &fitted).of_kind(Kind::Line));
        left.push(line(&used, &|i| curve.model.pull[[i, c]]));
    }
    let (scale, label, title) = match curve.magnitudes {
        true => (Scale::Inverted, "mag", "V above the air"),
        false => (Scale::Log, "Hz", "Rates at the detector"),
    };
    let end = rows.last().map_or(0.0, |i| at(*i));
    let geometry = |name: &str, hue: usize, values: &[f64]| Line {
        hue,
        ..Line::dots(
            name,
            None,
            rows.iter().map(|i| at(*i)).collect(),
            rows.iter().map(|i| values[*i]).collect(),
        )
        .of_kind(Kind::Line)
    };
    Group {
        title: format!("{}, from {}", curve.name, format_utc_shortest(start)),
        x_label: format!("seconds after {}", format_utc_shortest(start)),
        start_ms: start.to_unix_milliseconds(),
        from: 0.0,
        to: end.max(1e-3),
        charts: vec![
            Chart::new("values", title, label, scale, values),
            Chart {
                rule: Some(0.0),
                ..Chart::new(
                    "residuals",
                    "Measured less fitted over the noise of a sample",
                    "σ",
                    Scale::Linear,
                    left,
                )
            },
            Chart::new(
                "geometry",
                "Geometry",
                "degrees",
                Scale::Linear,
                vec![
                    geometry("phase angle (°)", 1, &curve.phase_deg),
                    geometry("zenith angle (°)", 0, &curve.zenith_deg),
                ],
            ),
        ],
    }
}

fn sections(answer: &PassFit) -> Vec<Section> {
    let mut all = vec![found(answer), correlations(answer), open(answer), residuals(answer)];
    all.extend(bounces(answer));
    all.extend([left_out(answer), cost(answer), inputs(answer)]);
    all
}

/// Section of the free parameters and the values found.
fn found(answer: &PassFit) -> Section {
    let how = |p: &Estimate| {
        let method = match p.interval_method {
            IntervalMethod::Covariance => "covariance",
            IntervalMethod::Profile => "profile of χ²",
            IntervalMethod::None => "not determined",
        };
        match p.at_bound {
            Some(Side::Low) => format!("{method}; at its lower bound"),
            Some(Side::High) => format!("{method}; at its upper bound"),
            None => method.to_owned(),
        }
    };
    let or_dash = |v: Option<f64>| v.map_or("–".to_owned(), number);
    let row = |(p, before): (&Estimate, &f64)| {
        vec![
            p.name.clone(),
            how(p),
            number(*before),
            number(p.value),
            or_dash(p.sigma),
            or_dash(p.sigma_calibration.filter(|s| *s > 0.0)),
            or_dash(p.sigma_material.filter(|s| *s > 0.0)),
            or_dash(p.interval_95[0]),
            or_dash(p.interval_95[1]),
        ]
    };
    let fit = &answer.fit;
    let widened = if fit.scaled_by > 1.0 {
        format!("the stated noise, its variance times {:.3} as the residuals ask", fit.scaled_by)
    } else {
        "the stated noise".into()
    };
    Section {
        title: "What was free, and what was found".into(),
        text: vec![format!(
            "Intervals of 95 % by {widened}. The part of κ is the calibration's error, the same in all samples of a night: it does not average out. The part of materials is the doubt of measured and fitted ones, all directions of one off alike. What stands under “in the scene” is what the scene's file said before. Light between the parts, where there is any, is held at what was found: the intervals do not know how it follows the albedos."
        )],
        grid: Grid {
            head: heads(&[
                "parameter",
                "interval by",
                "in the scene",
                "value",
                "σ",
                "of it κ",
                "of it materials",
                "from",
                "to",
            ]),
            rows: fit.parameters.iter().zip(&answer.in_the_scene).map(row).collect(),
            words: 2,
        },
    }
}

fn correlations(answer: &PassFit) -> Section {
    let fit = &answer.fit;
    let mut rows: Vec<(f64, Vec<String>)> = Vec::new();
    for i in 0..fit.parameters.len() {
        for j in 0..i {
            if let Some(r) = fit.correlation(i, j).filter(|r| r.abs() >= NAMED) {
                let names = [j, i].map(|k| fit.parameters[k].name.clone());
                rows.push((r, vec![names[0].clone(), names[1].clone(), format!("{r:+.3}")]));
            }
        }
    }
    rows.sort_by(|a, b| b.0.abs().total_cmp(&a.0.abs()));
    let more = rows.len().saturating_sub(MOST_NAMED);
    let text = match rows.len() {
        0 => format!("No two parameters are correlated by more than {NAMED}."),
        n => format!(
            "Pairs correlated by more than {NAMED}: {n}{}.",
            if more > 0 {
                format!(", the {MOST_NAMED} strongest of them here")
            } else {
                String::new()
            }
        ),
    };
    Section {
        title: "Correlations".into(),
        text: vec![text],
        grid: Grid {
            head: heads(&["parameter", "and", "correlation"]),
            rows: rows.into_iter().take(MOST_NAMED).map(|(_, row)| row).collect(),
            words: 2,
        },
    }
}

/// Section of what the data leave open.
fn open(answer: &PassFit) -> Section {
    let told = |w: &&Warning| !matches!(w, Warning::Correlated { .. });
    let mut text: Vec<String> =
        answer.fit.warnings.iter().filter(told).map(|w| format!("{w}.")).collect();
    if text.is_empty() {
        text.push("Everything that was free is determined, and no other minimum was met.".into());
    }
    Section { title: "What is not determined".into(), text, grid: Grid::default() }
}

fn residuals(answer: &PassFit) -> Section {
    let mut rows = Vec::new();
    let mut add = |by: &str, all: &[Summary]| {
        rows.extend(all.iter().map(|g| {
            let [mean, sigma] = percent_with_sigma(g.mean_relative, g.sigma_relative).map_or_else(
                || [NO_WEIGHT.to_owned(), String::new()],
                |[mean, sigma]| [format!("{mean} %"), sigma],
            );
            vec![
                by.to_owned(),
                g.group.clone(),
                g.samples.to_string(),
                mean,
                sigma,
                format!("{:.2}", g.rms_pull),
            ]
        }));
    };
    add("channel", &answer.groups.by_channel);
    add("phase angle", &answer.groups.by_phase);
    add("airmass", &answer.groups.by_airmass);
    let tracks = answer.curves.iter().flat_map(|c| super::of_tracks(&c.tracks)).map(|line| {
        let mut line = format!("{line}.");
        line[..1].make_ascii_uppercase();
        line
    });
    let text = "Measured less fitted over fitted: the mean with the uncertainty that the samples' noise makes, and the root mean square over the noise of a sample, 1 where noise and model are as stated.";
    Section {
        title: "What is left".into(),
        text: std::iter::once(text.to_owned()).chain(tracks).collect(),
        grid: Grid {
            head: heads(&["by", "", "samples", "mean", "±", "rms / noise"]),
            rows,
            words: 2,
        },
    }
}

fn bounces(answer: &PassFit) -> Option<Section> {
    let bounces = answer.bounces.as_ref()?;
    let mut text = vec![format!(
        "Up to {:.1} % of a sample's light came by way of another part. It was computed for what was found, held, and the rest fitted again, in {} rounds; the last moved no parameter by more than {:.2} of its σ{}.",
        100.0 * bounces.share,
        bounces.rounds,
        bounces.moved_sigmas,
        if bounces.settled { "" } else { ", which is more than it should" }
    )];
    text.extend(bounces.thinned.iter().map(of_thinned));
    Some(Section { title: "Light between the parts".into(), text, grid: Grid::default() })
}

fn left_out(answer: &PassFit) -> Section {
    let row = |c: &CurveFit| {
        let reasons: Vec<String> =
            c.left_out.iter().map(|l| format!("{} {}", l.samples, l.why)).collect();
        let reasons = if reasons.is_empty() { "nothing".into() } else { reasons.join(", ") };
        let lost: usize = c.left_out.iter().map(|l| l.samples).sum();
        vec![c.name.clone(), reasons, lost.to_string(), c.fitted.to_string()]
    };
    Section {
        title: "What was left out".into(),
        text: Vec::new(),
        grid: Grid {
            head: heads(&["curve", "by reason", "left out", "fitted"]),
            rows: answer.curves.iter().map(row).collect(),
            words: 2,
        },
    }
}

fn cost(answer: &PassFit) -> Section {
    let mut text =
        vec![format!("{} simulations in {:.1} s.", answer.fit.evaluations, answer.seconds)];
    text.extend(answer.curves.iter().map(|c| format!("{}: {}.", c.name, of_averaged(&c.averaged))));
    text.extend(answer.curves.iter().filter_map(|c| c.thinned.as_ref()).map(of_thinned));
    Section { title: "Cost".into(), text, grid: Grid::default() }
}

fn inputs(answer: &PassFit) -> Section {
    let mut text = answer.warnings.clone();
    if !text.is_empty() {
        text.insert(0, "Warnings:".into());
    }
    Section {
        title: "Inputs".into(),
        text,
        grid: Grid {
            head: heads(&["file", "SHA-256"]),
            rows: answer.inputs.iter().map(|i| vec![i.file.clone(), i.sha256.clone()]).collect(),
            words: 2,
        },
    }
}
