//! The page of a comparison.

use super::figure::{drawn, palette, residual, residual_range, seconds};
use super::{averaging, not_modelled, with_error};
use crate::page::{Chart, Grid, Group, Kind, Line, Page, Parameter, Scale, Section};
use std::ops::Range;
use sunglint_calibration::comparison::{Axis, Numbers};
use sunglint_formats::time::{format_utc, format_utc_shortest};
use sunglint_inference::compare::{ComparedChannel, Comparison, Quantity, magnitude};
use sunglint_radiometry::air::Air;
use sunglint_simulator::light::percent;

fn or_dash(value: Option<f64>, write: impl Fn(f64) -> String) -> String {
    value.map_or("–".into(), write)
}

fn heads(names: &[&str]) -> Vec<String> {
    names.iter().map(|n| (*n).to_owned()).collect()
}

/// The page.
pub(super) fn report(compared: &Comparison<'_>) -> Page {
    let pass = compared.simulation.pass;
    let palette = palette(compared);
    let times = &compared.measured.times;
    let (first, last) = (times[compared.rows[0]], times[compared.rows[compared.rows.len() - 1]]);
    let site = pass.station.site.geodetic();
    let channels =
        compared.pairs.iter().zip(&palette).map(|(p, hue)| (p.measured.name.clone(), *hue));
    Page {
        title: compared.title(),
        subtitle: format!(
            "{} to {} · {} ({:.3}°, {:.3}°, {:.0} m) · {}",
            format_utc(first, 1),
            format_utc(last, 1),
            pass.station.name,
            site.latitude_deg,
            site.longitude_deg,
            site.height_m,
            compared.measured.path.display()
        ),
        verdict: verdict(compared),
        figures: figures(compared),
        parameters: (
            "Scales".into(),
            "All the light that was measured over all that was simulated, channel by channel. The uncertainty is the larger of what the samples' own say and what 20 blocks of time say by their differences, with κ's, which all samples have in common. Nothing else was fitted: size, materials and attitude are as the scene gives them.".into(),
            scales(compared),
        ),
        channels: channels.collect(),
        curves_title: "Measured and simulated".into(),
        curves_note: "Dots: measured. Lines: simulated, on the same epochs, not scaled.".into(),
        groups: compared.tracks().iter().map(|track| group(compared, track)).collect(),
        others_title: "Residuals by geometry".into(),
        others_note: "All light measured in a bin over all light simulated, over the channel's scale: 1 where the model has the course right. Bars: the data's own uncertainty.".into(),
        others: others(compared, &palette),
        sections: sections(compared),
        program: concat!("sunglint ", env!("CARGO_PKG_VERSION")).into(),
    }
}

fn numbers<'a>(
    compared: &'a Comparison<'_>,
) -> impl Iterator<Item = (&'a ComparedChannel, &'a Numbers)> {
    compared.pairs.iter().filter_map(|p| Some((p, p.channel.numbers.as_ref()?)))
}

/// Smallest and largest.
fn ends(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values.fold(None, |ends, v| match ends {
        None => Some((v, v)),
        Some((a, b)) => Some((a.min(v), b.max(v))),
    })
}

fn span((low, high): (f64, f64), write: impl Fn(f64) -> String) -> String {
    let (low, high) = (write(low), write(high));
    if low == high { low } else { format!("{low} to {high}") }
}

fn verdict(compared: &Comparison<'_>) -> String {
    let of =
        |f: &dyn Fn(&Numbers) -> Option<f64>| ends(numbers(compared).filter_map(|(_, n)| f(n)));
    let several = numbers(compared).count() > 1;
    let by = if several { ", by channel" } else { "" };
    let mut text = String::new();
    if let Some(scale) = of(&|n| Some(n.scale)) {
        text.push_str(&format!(
            "The measured light is {} times the simulated{by}. ",
            span(scale, |v| format!("{v:.3}"))
        ));
    }
    if let (Some(scatter), noise) = (of(&|n| Some(n.scatter)), of(&|n| n.noise)) {
        text.push_str(&format!("About that it scatters by {}", span(scatter, percent)));
        if let Some(noise) = noise {
            text.push_str(&format!("; the data's own uncertainties make {}", span(noise, percent)));
        }
        if let Some(twinkling) = of(&|n| n.twinkling) {
            text.push_str(&format!(", twinkling some {} more", span(twinkling, percent)));
        }
        text.push_str(". ");
    }
    if let Some(stated) = of(&|n| Some(n.stated.0).filter(|v| v.is_finite())) {
        text.push_str(&format!(
            "The simulation states an error of {} (median). ",
            span(stated, percent)
        ));
    }
    if let Some(material) = of(&|n| n.material.map(|m| m.median).filter(|v| v.is_finite())) {
        text.push_str(&format!(
            "The doubt of its materials may change the light by {} (median, 95 %). ",
            span(material, percent)
        ));
    }
    text.trim_end().to_owned()
}

fn figures(compared: &Comparison<'_>) -> Vec<[String; 3]> {
    let (used, all) = compared.numbers();
    let course = &compared.course;
    let good =
        |values: &[f64], per: f64| ends(values.iter().map(|v| v / per).filter(|v| v.is_finite()));
    let best = numbers(compared)
        .filter_map(|(p, n)| Some((p, n, n.scale_uncertainty()? / n.scale)))
        .min_by(|a, b| a.2.total_cmp(&b.2));
    let mut figures = Vec::new();
    if let Some((pair, n, _)) = best {
        figures.push([
            "Measured / simulated".into(),
            with_error(n.scale, n.scale_total()).replace(' ', "\u{a0}"),
            format!(
                "{}, the channel known best{}",
                pair.measured.name,
                n.common_sigma.map_or(String::new(), |s| format!("; κ alone ± {}", percent(s)))
            ),
        ]);
        if let Some(chi2) = n.chi2 {
            let more = chi2.with_twinkling.map(|v| format!("; with twinkling {v:.2}"));
            figures.push([
                "Reduced χ²".into(),
                format!("{:.2}", chi2.data),
                format!("{}, by the data's σ{}", pair.measured.name, more.unwrap_or_default()),
            ]);
        } else if let Some([_, rms, about]) = n.magnitudes {
            figures.push([
                "Scatter".into(),
                format!("{about:.3} mag"),
                format!("about the mean; rms {rms:.3} mag"),
            ]);
        }
    }
    figures.push([
        "Samples compared".into(),
        format!("{used}"),
        format!("of {all} in {} channels", compared.pairs.len()),
    ]);
    if let (Some(range), Some(phase), Some(zenith)) =
        (good(&course.range_m, 1e3), good(&course.phase_deg, 1.0), good(&course.zenith_deg, 1.0))
    {
        let whole = |v: f64| format!("{v:.0}");
        figures.push([
            "Range".into(),
            format!("{}\u{a0}km", span(range, whole).replace(" to ", "–")),
            format!("phase angle {}°, zenith angle {}°", span(phase, whole), span(zenith, whole)),
        ]);
    }
    figures
}

fn scales(compared: &Comparison<'_>) -> Vec<Parameter> {
    let one = |(pair, n): (&ComparedChannel, &Numbers)| Parameter {
        name: pair.measured.name.clone(),
        value: n.scale,
        unit: String::new(),
        sigma: n.scale_total(),
        interval: n.scale_interval(),
    };
    numbers(compared).map(one).collect()
}

fn group(compared: &Comparison<'_>, track: &Range<usize>) -> Group {
    let start = compared.measured.times[track.start];
    let since = format_utc_shortest(start);
    Group {
        title: format!(
            "{since} to {}",
            format_utc_shortest(compared.measured.times[track.end - 1])
        ),
        x_label: format!("seconds after {since}"),
        start_ms: start.to_unix_milliseconds(),
        from: 0.0,
        to: seconds(compared, track.start, track.end - 1),
        charts: charts(compared, track),
    }
}

fn charts(compared: &Comparison<'_>, track: &Range<usize>) -> Vec<Chart> {
    let palette = palette(compared);
    let at = |i: usize| seconds(compared, track.start, i);
    let shown = |v: f64| match compared.measured.quantity {
        Quantity::Rate => v,
        Quantity::Flux(_) => magnitude(v),
    };
    let to_mag = 2.5 / std::f64::consts::LN_10;
    let (mut values, mut residuals) = (Vec::new(), Vec::new());
    for (c, pair) in compared.pairs.iter().enumerate() {
        let used: Vec<usize> = drawn(pair, track).filter(|i| pair.channel.used[*i]).collect();
        let left_out: Vec<usize> = drawn(pair, track).filter(|i| !pair.channel.used[*i]).collect();
        let all: Vec<usize> = drawn(pair, track).collect();
        let line = |rows: &[usize], f: &dyn Fn(usize) -> f64| Line {
            hue: palette[c],
            ..Line::dots(
                &pair.measured.name,
                Some(c),
                rows.iter().map(|i| at(*i)).collect(),
                rows.iter().map(|i| f(*i)).collect(),
            )
        };
        let value = |i: usize| shown(pair.measured.value[i]);
        let sigma = |i: &usize| match compared.measured.quantity {
            Quantity::Rate => pair.measured.sigma[*i],
            Quantity::Flux(_) => to_mag * pair.measured.sigma[*i] / pair.measured.value[*i],
        };
        let known = used.iter().any(|i| pair.measured.sigma[*i].is_finite());
        let sigma = if known { used.iter().map(sigma).collect() } else { Vec::new() };
        values.push(Line { sigma, ..line(&used, &value) });
        if left_out.iter().any(|i| pair.measured.value[*i].is_finite()) {
            values.push(line(&left_out, &value).of_kind(Kind::Out));
        }
        let simulated = |i: usize| shown(pair.simulated[i]);
        values.push(line(&all, &simulated).of_kind(Kind::Line));
        residuals.push(line(&used, &|i| residual(compared, pair, i)));
    }
    let (scale, label, title) = match compared.measured.quantity {
        Quantity::Rate => (Scale::Log, "Hz".to_owned(), "Rates at the detector".to_owned()),
        Quantity::Flux(kind) => {
            (Scale::Inverted, "mag".into(), format!("Magnitudes: {}", kind.name()))
        }
    };
    let (of_residuals, rule, what) = if compared.is_rate() {
        (Scale::Linear, 1.0, "Measured over simulated")
    } else {
        (Scale::Inverted, 0.0, "Measured less simulated")
    };
    let unit = if compared.is_rate() { "ratio" } else { "mag" };
    let mut charts = vec![
        Chart::new("values", &title, &label, scale, values),
        Chart {
            rule: Some(rule),
            range: residual_range(compared, track),
            ..Chart::new("residuals", what, unit, of_residuals, residuals)
        },
    ];
    charts.extend(ratios(compared, track, &palette));
    let course = &compared.course;
    let rows: Vec<usize> = track.clone().filter(|i| course.range_m[*i].is_finite()).collect();
    let line = |name: &str, hue: usize, values: &[f64], per: f64| Line {
        hue,
        ..Line::dots(
            name,
            None,
            rows.iter().map(|i| at(*i)).collect(),
            rows.iter().map(|i| values[*i] / per).collect(),
        )
        .of_kind(Kind::Line)
    };
    let furthest = rows.iter().map(|i| course.range_m[*i]).fold(0.0, f64::max);
    let (per, unit) = if furthest > 1.8e7 { (1e6, "1,000 km") } else { (1e5, "100 km") };
    charts.push(Chart::new(
        "geometry",
        "Geometry",
        "degrees; range",
        Scale::Linear,
        vec![
            line("phase angle (°)", 1, &course.phase_deg, 1.0),
            line("zenith angle (°)", 0, &course.zenith_deg, 1.0),
            line(&format!("range ({unit})"), 2, &course.range_m, per),
        ],
    ));
    charts
}

fn ratios(compared: &Comparison<'_>, track: &Range<usize>, palette: &[usize]) -> Option<Chart> {
    let mut lines = Vec::new();
    for ratio in &compared.ratios {
        let place = compared.pairs.iter().position(|p| p.measured.name == ratio.channel)?;
        let own: Vec<_> = ratio.moments.iter().filter(|m| track.contains(&m.rows.start)).collect();
        let x: Vec<f64> = own
            .iter()
            .map(|m| {
                let at = |i: usize| seconds(compared, track.start, i);
                0.5 * (at(m.rows.start) + at(m.rows.end - 1))
            })
            .collect();
        let name = format!("{}/{}", ratio.channel, ratio.reference);
        let measured = own.iter().map(|m| m.measured).collect();
        let sigma = own.iter().map(|m| m.sigma.unwrap_or(f64::NAN)).collect();
        let hue = palette[place];
        let dots = Line { hue, sigma, ..Line::dots(&name, Some(place), x.clone(), measured) };
        let simulated = own.iter().map(|m| m.simulated).collect();
        let line = Line { hue, ..Line::dots(&name, Some(place), x, simulated) };
        lines.extend([dots, line.of_kind(Kind::Line)]);
    }
    let reference = &compared.ratios.first()?.reference;
    let title = format!("Channels over {reference}, means over stretches of time");
    Some(Chart::new("ratios", &title, "ratio", Scale::Log, lines))
}

/// Residuals against phase angle and airmass.
fn others(compared: &Comparison<'_>, palette: &[usize]) -> Vec<Chart> {
    let chart = |axis: Axis| {
        let mut lines = Vec::new();
        for (c, pair) in compared.pairs.iter().enumerate() {
            let own = pair.bins.iter().find(|(a, _)| *a == axis);
            let bins = own.map_or(&[][..], |(_, bins)| bins);
            if bins.is_empty() {
                continue;
            }
            let x: Vec<f64> = bins.iter().map(|b| 0.5 * (b.from + b.to)).collect();
            let dots = Line {
                hue: palette[c],
                sigma: bins.iter().map(|b| b.sigma.unwrap_or(f64::NAN)).collect(),
                ..Line::dots(
                    &pair.measured.name,
                    Some(c),
                    x,
                    bins.iter().map(|b| b.ratio).collect(),
                )
            };
            lines.push(dots.clone().of_kind(Kind::Line));
            lines.push(dots);
        }
        let (id, title, x_label) = match axis {
            Axis::Phase => ("by_phase", "By phase angle", "phase angle (°)"),
            Axis::Airmass => ("by_airmass", "By airmass", "airmass"),
        };
        let chart = Chart {
            rule: Some(1.0),
            x_label: x_label.into(),
            ..Chart::new(id, title, "ratio", Scale::Linear, lines)
        };
        (!chart.lines.is_empty()).then_some(chart)
    };
    [Axis::Phase, Axis::Airmass].into_iter().filter_map(chart).collect()
}

fn sections(compared: &Comparison<'_>) -> Vec<Section> {
    let mut sections = vec![agreement(compared), budget(compared)];
    if !compared.ratios.is_empty() {
        sections.push(of_ratios(compared));
    }
    sections.push(left_out(compared));
    sections.push(calibration(compared));
    sections.push(modelled(compared));
    sections.push(cost(compared));
    sections.push(inputs(compared));
    sections
}

fn agreement(compared: &Comparison<'_>) -> Section {
    let row = |(pair, n): (&ComparedChannel, &Numbers)| {
        let chi2 = |f: &dyn Fn(&sunglint_calibration::comparison::Chi2) -> Option<f64>| {
            or_dash(n.chi2.as_ref().and_then(f), |v| format!("{v:.2}"))
        };
        vec![
            pair.measured.name.clone(),
            n.samples.to_string(),
            format!("{:.4}", n.median),
            percent(n.scatter),
            percent(n.rms),
            chi2(&|c| Some(c.data)),
            chi2(&|c| c.with_twinkling),
            chi2(&|c| Some(c.past_stated)),
            chi2(&|c| c.past_materials),
            chi2(&|c| Some(c.unscaled)),
        ]
    };
    let mut text = vec![
        "Median and scatter (half of the central 68 %) of measured over simulated, each sample with the weight of its simulated light; the root mean square of all residuals over that of the light; reduced χ² about the scaled simulation by the data's σ, with twinkling added by Young's law (good to a factor of two or so), of what is left past the simulation's stated error, past that and the doubt of the materials (of which the scale has taken a part: it is the least that both allow), and without the scale.".to_owned(),
    ];
    for (pair, n) in numbers(compared) {
        if let Some([mean, rms, about]) = n.magnitudes.filter(|_| !compared.is_rate()) {
            text.push(format!(
                "{}: measured less simulated {mean:+.3} mag in the mean, rms {rms:.3} mag, scatter about the mean {about:.3} mag.",
                pair.measured.name
            ));
        }
    }
    Section {
        title: "Agreement".into(),
        text,
        grid: Grid {
            head: heads(&[
                "channel",
                "samples",
                "median",
                "scatter",
                "rms",
                "χ², data",
                "with twinkling",
                "past stated",
                "and materials",
                "unscaled",
            ]),
            rows: numbers(compared).map(row).collect(),
            words: 1,
        },
    }
}

fn budget(compared: &Comparison<'_>) -> Section {
    let row = |(pair, n): (&ComparedChannel, &Numbers)| {
        vec![
            pair.measured.name.clone(),
            or_dash(n.noise, percent),
            or_dash(n.twinkling, percent),
            or_dash(n.common_sigma, percent),
            percent(n.stated.0),
            percent(n.stated.1),
            percent(n.rms),
        ]
    };
    Section {
        title: "What is claimed of the errors".into(),
        text: vec![
            "The data claim noise (photons, detector, background: root mean square over that of the light) and the uncertainty of κ, the same in all samples. Twinkling, by Young's law with C = 1.5, is in neither. The simulation states a bound of what it leaves out and of its own arithmetic, not a standard deviation.".into(),
        ],
        grid: Grid {
            head: heads(&[
                "channel",
                "noise of a sample",
                "twinkling of a sample",
                "κ, common",
                "simulation, median",
                "simulation, largest",
                "found: rms",
            ]),
            rows: numbers(compared).map(row).collect(),
            words: 1,
        },
    }
}

fn of_ratios(compared: &Comparison<'_>) -> Section {
    let rows = compared.ratios.iter().map(|ratio| {
        let share = |s: Option<f64>| or_dash(s, |s| percent(s / ratio.scale));
        vec![
            format!("{}/{}", ratio.channel, ratio.reference),
            format!("{:.4}", ratio.scale),
            share(ratio.sigma),
            share(ratio.sigma_blocks),
            or_dash(ratio.common_sigma, percent),
        ]
    });
    Section {
        title: "Ratios of channels".into(),
        text: vec![
            "The measured ratio over the simulated one. Neither size nor distance of the target changes it, nor what dims all channels alike.".into(),
        ],
        grid: Grid {
            head: heads(&["channels", "measured / simulated", "± data", "± blocks of time", "± κ"]),
            rows: rows.collect(),
            words: 1,
        },
    }
}

fn left_out(compared: &Comparison<'_>) -> Section {
    let mut rows = Vec::new();
    for pair in &compared.pairs {
        let left = &pair.channel.left_out;
        let reasons: Vec<String> =
            left.reasons.iter().map(|(r, n)| format!("{n} {}", r.name())).collect();
        let used = pair.channel.samples - left.samples;
        rows.push(vec![
            pair.measured.name.clone(),
            if reasons.is_empty() { "nothing".into() } else { reasons.join(", ") },
            left.samples.to_string(),
            used.to_string(),
            pair.channel.samples.to_string(),
        ]);
    }
    Section {
        title: "What was left out".into(),
        text: vec!["A sample with several flags counts under each of them.".into()],
        grid: Grid {
            head: heads(&["channel", "by reason", "left out", "compared", "samples"]),
            rows,
            words: 2,
        },
    }
}

fn calibration(compared: &Comparison<'_>) -> Section {
    let mut section = Section { title: "Calibration".into(), ..Section::default() };
    match (&compared.measured.kappa, compared.is_rate()) {
        (Some(kappa), _) => {
            section.text = vec![format!(
                "κ of the night of {}, from {} ({}), found with the air: {}. Rates at the detector are κ times what was measured.",
                kappa.night, kappa.file, kappa.sha256, kappa.air
            )];
            let rows = compared.pairs.iter().filter_map(|p| kappa.row(&p.measured.name));
            section.grid = Grid {
                head: vec![
                    "channel".into(),
                    "κ".into(),
                    "relative uncertainty".into(),
                    format!("{} interval", percent(kappa.confidence)),
                ],
                rows: rows
                    .map(|row| {
                        vec![
                            row.channel.clone(),
                            format!("{:.4}", row.kappa),
                            percent(row.relative_sigma),
                            format!("{:.4} to {:.4}", row.interval.low, row.interval.high),
                        ]
                    })
                    .collect(),
                words: 1,
            };
        }
        (None, true) => {
            section.text = vec!["The measured curve does not say what calibrated it.".into()]
        }
        (None, false) => {
            section.text = vec![
                "Magnitudes as the table has them: it does not say how they were calibrated."
                    .into(),
            ];
        }
    }
    section
}

fn modelled(compared: &Comparison<'_>) -> Section {
    let simulation = &compared.simulation;
    let pass = simulation.pass;
    let air = pass.air.as_ref().map_or("none".into(), Air::describe);
    let materials: Vec<String> = pass.target.materials.iter().map(|m| m.describe()).collect();
    let mut text = vec![
        format!("Target: {}. Materials: {}.", pass.target.name, materials.join("; ")),
        format!("Air: {air}. Sunlight: {}.", pass.sun_name),
        format!(
            "Effects, at a tolerance of {}: the most that each could add, as a share of the light of the same surfaces in full sunlight.",
            percent(pass.tolerance)
        ),
    ];
    text.extend(pass.notes.iter().cloned());
    let row = |need: &sunglint_simulator::light::Need| {
        vec![
            need.effect.to_owned(),
            need.decision().to_lowercase(),
            need.why.clone(),
            or_dash(need.bound, percent),
        ]
    };
    Section {
        title: "What was modelled".into(),
        text,
        grid: Grid {
            head: heads(&["effect", "decision", "why", "could add"]),
            rows: simulation.needs.iter().map(row).collect(),
            words: 3,
        },
    }
}

fn cost(compared: &Comparison<'_>) -> Section {
    let effort = &compared.effort;
    let epochs = compared.rows.len();
    Section {
        title: "Exposures, speed and cost".into(),
        text: vec![
            format!("{}.", averaging(compared)),
            format!(
                "{:.2} s on {} threads for {epochs} epochs ({:.0} µs an epoch), {:.2} s for the means over their exposures ({} moments more).",
                effort.middles.total_s,
                effort.middles.threads,
                1e6 * effort.middles.total_s / epochs as f64,
                effort.means.total_s,
                compared.means.moments
            ),
            format!("Not in the simulation: {}.", not_modelled(compared).join("; ")),
        ],
        grid: Grid::default(),
    }
}

fn inputs(compared: &Comparison<'_>) -> Section {
    let row = |input: sunglint_radiometry::light_curve::Input| vec![input.file, input.sha256];
    let mut text = compared.warnings.clone();
    if !text.is_empty() {
        text.insert(0, "Warnings:".into());
    }
    text.extend(compared.measured.notes.iter().cloned());
    Section {
        title: "Inputs".into(),
        text,
        grid: Grid {
            head: heads(&["file", "SHA-256"]),
            rows: super::inputs(compared).into_iter().map(row).collect(),
            words: 2,
        },
    }
}
