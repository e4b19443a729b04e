//! A measured pass beside the simulated one: summary, table, JSON, figures, page.

mod figure;
mod page;

use crate::explain;
use crate::{Product, json_of, rounded};
use serde::Serialize;
use serde_json::Map;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_calibration::comparison::{Axis, Bin, Numbers, Ratio};
use sunglint_formats::flag_bits::bit_names;
use sunglint_formats::time::{format_utc, format_utc_shortest};
use sunglint_formats::{Column, Table};
use sunglint_inference::compare::{ComparedChannel, Comparison, Quantity, magnitude};
use sunglint_radiometry::light_curve::{Flags, Input};
use sunglint_simulator::light::percent;
use sunglint_simulator::pass::WITHIN_AN_EXPOSURE;

const COMMAND: &str = "sunglint compare";

/// Writes a value and its uncertainty: digits of the value down to the second of the uncertainty.
fn with_error(value: f64, sigma: Option<f64>) -> String {
    match sigma.filter(|s| *s > 0.0 && s.is_finite()) {
        None => format!("{value:.4}"),
        Some(sigma) => {
            let places = (1.0 - sigma.log10().floor()).clamp(0.0, 9.0) as usize;
            format!("{value:.places$} ± {sigma:.places$}")
        }
    }
}

fn or_dash(value: Option<f64>, write: impl Fn(f64) -> String) -> String {
    value.map_or("-".into(), write)
}

/// Table, figures, page and summary.
pub fn product(compared: &Comparison<'_>) -> Product {
    let good = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
    let name = format!("{}_compared", compared.simulation.pass.name.replace(|c| !good(c), "_"));
    let residuals = Product {
        name: format!("{name}_residuals"),
        figure: figure::residuals(compared),
        ..Product::default()
    };
    let others = residuals.figure.is_some().then_some(residuals);
    Product {
        name,
        table: table(compared),
        figure: Some(figure::curves(compared)),
        html: Some(page::report(compared).html()),
        json: json(compared),
        others: others.into_iter().collect(),
        ..Product::default()
    }
}

/// The files that went in: the measurement, what that was made of, the scene and its files.
fn inputs(compared: &Comparison<'_>) -> Vec<Input> {
    let mut inputs = vec![compared.measured.input.clone()];
    for input in compared.measured.inputs.iter().chain(&compared.simulation.pass.inputs) {
        if !inputs.contains(input) {
            inputs.push(input.clone());
        }
    }
    inputs
}

/// Effects that are not in the simulation; change within an exposure is, here.
fn not_modelled(compared: &Comparison<'_>) -> Vec<String> {
    let all = compared.simulation.not_modelled();
    all.into_iter().filter(|what| what != WITHIN_AN_EXPOSURE).collect()
}

/// Returns the averaging over exposures, in words.
fn averaging(compared: &Comparison<'_>) -> String {
    let cut = compared.means.pieces.iter().filter(|p| **p > 1).count();
    format!(
        "means over the exposures, {cut} of {} cut into pieces; the middle would be off by up to {}{}",
        compared.means.pieces.len(),
        percent(compared.means.largest_change),
        if compared.measured.exposure_s.is_none() {
            " (the file names no exposures: the scene's were taken)"
        } else {
            ""
        }
    )
}

/// The summary as text.
pub fn text(compared: &Comparison<'_>) -> String {
    let mut text = format!("{}\n", compared.title());
    let times = &compared.measured.times;
    let (first, last) = (times[compared.rows[0]], times[compared.rows[compared.rows.len() - 1]]);
    let (used, all) = compared.numbers();
    let _ = writeln!(text, "  measured   {}", compared.measured.path.display());
    let _ = writeln!(
        text,
        "  compared   {used} of {all} samples, {} to {}",
        format_utc(first, 1),
        format_utc(last, 1)
    );
    if let Quantity::Flux(kind) = compared.measured.quantity {
        let _ = writeln!(text, "  magnitudes {}", kind.name());
    }
    let _ = writeln!(text, "  exposures  {}\n", averaging(compared));
    say_channels(compared, &mut text);
    say_left_out(compared, &mut text);
    say_budget(compared, &mut text);
    say_ratios(compared, &mut text);
    let _ = writeln!(
        text,
        "cost: {:.3} s on {} threads for {} epochs, {:.3} s for the means over their exposures ({} moments more)",
        compared.effort.middles.total_s,
        compared.effort.middles.threads,
        compared.rows.len(),
        compared.effort.means.total_s,
        compared.means.moments,
    );
    text.push_str("nothing was fitted but the scales: size, materials and attitude are as the scene gives them\n");
    text
}

fn say_channels(compared: &Comparison<'_>, text: &mut String) {
    let _ = writeln!(
        text,
        "  {:<10} {:>7}  {:<22} {:>9} {:>9} {:>9} {:>10} {:>11} {:>11}{}",
        "channel",
        "samples",
        "measured/simulated",
        "median",
        "scatter",
        "noise",
        "red. chi2",
        "w. twinkl.",
        "past stated",
        if compared.material.is_some() { " and material" } else { "" }
    );
    for pair in &compared.pairs {
        let Some(n) = &pair.channel.numbers else {
            let _ = writeln!(text, "  {:<10} {:>7}", pair.channel.name, "none");
            continue;
        };
        let chi2 = |f: &dyn Fn(&sunglint_calibration::comparison::Chi2) -> Option<f64>| {
            or_dash(n.chi2.as_ref().and_then(f), |v| format!("{v:.2}"))
        };
        let _ = writeln!(
            text,
            "  {:<10} {:>7}  {:<22} {:>9.4} {:>9} {:>9} {:>10} {:>11} {:>11}{}",
            pair.channel.name,
            n.samples,
            with_error(n.scale, n.scale_total()),
            n.median,
            percent(n.scatter),
            or_dash(n.noise, percent),
            chi2(&|c| Some(c.data)),
            chi2(&|c| c.with_twinkling),
            chi2(&|c| Some(c.past_stated)),
            n.chi2.and_then(|c| c.past_materials).map_or(String::new(), |v| format!(" {v:>12.2}")),
        );
        if let Some([mean, rms, about]) = n.magnitudes.filter(|_| !compared.is_rate()) {
            let _ = writeln!(
                text,
                "  {:<10} measured less simulated: mean {mean:+.3} mag, rms {rms:.3} mag, scatter about the mean {about:.3} mag",
                ""
            );
        }
    }
}

fn say_left_out(compared: &Comparison<'_>, text: &mut String) {
    for pair in compared.pairs.iter().filter(|p| p.channel.left_out.samples > 0) {
        let _ = writeln!(text, "  {:<10} {}", pair.channel.name, pair.channel.left_out);
    }
    text.push('\n');
}

fn say_budget(compared: &Comparison<'_>, text: &mut String) {
    text.push_str("  what is claimed   data's noise   twinkling   common to all (kappa)   simulation, median / largest\n");
    for pair in &compared.pairs {
        let Some(n) = &pair.channel.numbers else { continue };
        let _ = writeln!(
            text,
            "  {:<17} {:>12} {:>11} {:>23} {:>13} / {}",
            pair.channel.name,
            or_dash(n.noise, percent),
            or_dash(n.twinkling, percent),
            or_dash(n.common_sigma, percent),
            percent(n.stated.0),
            percent(n.stated.1),
        );
    }
    if let Some(doubt) = &compared.material {
        let _ = writeln!(
            text,
            "  doubt of materials (95 %, of {}): median / largest; of the scale, if all is off alike",
            doubt.names()
        );
        for pair in &compared.pairs {
            let Some(m) = pair.channel.numbers.as_ref().and_then(|n| n.material) else { continue };
            let _ = writeln!(
                text,
                "  {:<17} {:>12} / {}; ± {}",
                pair.channel.name,
                percent(m.median),
                percent(m.largest),
                percent(m.of_scale)
            );
        }
    }
    text.push('\n');
}

fn say_ratios(compared: &Comparison<'_>, text: &mut String) {
    if compared.ratios.is_empty() {
        return;
    }
    text.push_str("  ratios of channels, measured over simulated\n");
    for ratio in &compared.ratios {
        let own = ratio.sigma_blocks.into_iter().chain(ratio.sigma).reduce(f64::max);
        let _ = writeln!(
            text,
            "  {:<17} {:<22} kappa {}",
            format!("{}/{}", ratio.channel, ratio.reference),
            with_error(ratio.scale, own),
            or_dash(ratio.common_sigma, |s| format!("± {}", percent(s))),
        );
    }
    text.push('\n');
}

/// The table: a row for each of the measured file.
pub fn table(compared: &Comparison<'_>) -> Table {
    let mut table = Table::default();
    let mut meta = |key: &str, value: Value| table.meta.insert(key.into(), value);
    meta("title", compared.title().into());
    meta("flag_bits", bit_names::<Flags>());
    let mut provenance = compared.simulation.provenance(COMMAND);
    provenance.inputs = inputs(compared);
    meta("provenance", provenance.to_json());
    meta("channels", json_of(&json_channels(compared)));
    let times = compared.measured.times.iter().map(|t| format_utc_shortest(*t)).collect();
    table.columns.push(Column::text("time_utc", times));
    let mut number = |name: String, unit: Option<&str>, what: &str, values: Vec<f64>| {
        table.columns.push(Column::f64(name, unit, values).described(what));
    };
    number("exposure_s".into(), Some("s"), "", compared.exposure_s.clone());
    let as_read = |values: &[f64]| match compared.measured.quantity {
        Quantity::Rate => values.to_vec(),
        Quantity::Flux(_) => values.iter().map(|v| magnitude(*v)).collect(),
    };
    let relative = |errors: &[f64], values: &[f64]| match compared.measured.quantity {
        Quantity::Rate => errors.to_vec(),
        Quantity::Flux(_) => {
            let to_mag = 2.5 / std::f64::consts::LN_10;
            errors.iter().zip(values).map(|(e, v)| to_mag * e / v).collect()
        }
    };
    let (end, unit) = match compared.measured.quantity {
        Quantity::Rate => ("hz", "Hz"),
        Quantity::Flux(_) => ("mag", "mag"),
    };
    let mut flags = Vec::new();
    for ComparedChannel { measured, simulated, model_error, material, channel, .. } in
        &compared.pairs
    {
        let name = &measured.name;
        number(
            format!("{name}_measured_{end}"),
            Some(unit),
            "as the file has it",
            as_read(&measured.value),
        );
        number(
            format!("{name}_sigma_{end}"),
            Some(unit),
            "its standard uncertainty",
            relative(&measured.sigma, &measured.value),
        );
        number(
            format!("{name}_simulated_{end}"),
            Some(unit),
            "mean over the exposure, not scaled",
            as_read(simulated),
        );
        number(
            format!("{name}_model_error_{end}"),
            Some(unit),
            "its stated error, a bound",
            relative(model_error, simulated),
        );
        if let Some(material) = material {
            number(
                format!("{name}_material_{end}"),
                Some(unit),
                "half-width of its 95 % interval by the doubt of the materials",
                relative(material, simulated),
            );
        }
        flags.push((name.clone(), &measured.flags, &channel.used));
    }
    for (name, unit, values) in [
        ("range_m", "m", &compared.course.range_m),
        ("phase_deg", "deg", &compared.course.phase_deg),
        ("zenith_deg", "deg", &compared.course.zenith_deg),
    ] {
        number(name.into(), Some(unit), "", values.clone());
    }
    number("airmass".into(), None, "", compared.course.airmass.clone());
    for (name, flags, used) in flags {
        let bits = flags.iter().map(|f| i64::from(f.bits())).collect();
        table.columns.push(Column::i64(format!("{name}_flags"), None, bits));
        let used = used.iter().map(|u| i64::from(*u)).collect();
        let column = Column::i64(format!("{name}_used"), None, used);
        table.columns.push(column.described("1: the sample counts"));
    }
    for column in &mut table.columns {
        column.description = column.description.take().filter(|text| !text.is_empty());
    }
    table
}

fn json_channels<'a>(compared: &'a Comparison<'_>) -> Vec<ChannelJson<'a>> {
    compared.pairs.iter().map(json_channel).collect()
}

#[derive(Serialize)]
struct ComparisonJson<'a> {
    measured: String,
    quantity: &'a str,
    pass: &'a str,
    target: TargetJson<'a>,
    station: StationJson<'a>,
    night: Option<&'a String>,
    from_utc: String,
    to_utc: String,
    samples: usize,
    used: usize,
    channels: Vec<ChannelJson<'a>>,
    ratios: Vec<RatioJson<'a>>,
    exposures: ExposuresJson,
    tolerance: f64,
    doubtful_materials: Option<Vec<&'a String>>,
    needs: Vec<explain::NeedJson<'a>>,
    not_modelled: Vec<String>,
    cost: CostJson,
    inputs: Vec<Input>,
    warnings: &'a [String],
}

#[derive(Serialize)]
struct TargetJson<'a> {
    name: &'a str,
    simulated_as: &'a str,
}

#[derive(Serialize)]
struct StationJson<'a> {
    name: &'a str,
}

#[derive(Serialize)]
struct ExposuresJson {
    cut: usize,
    coarse: usize,
    largest_change: f64,
    moments: usize,
}

#[derive(Serialize)]
struct CostJson {
    total_s: f64,
    threads: usize,
}

/// The comparison with documented keys.
pub fn json(compared: &Comparison<'_>) -> Value {
    let pass = compared.simulation.pass;
    let times = &compared.measured.times;
    let (first, last) = (times[compared.rows[0]], times[compared.rows[compared.rows.len() - 1]]);
    let (used, all) = compared.numbers();
    let inputs = inputs(compared);
    json_of(&ComparisonJson {
        measured: compared.measured.path.display().to_string(),
        quantity: match compared.measured.quantity {
            Quantity::Rate => "calibrated",
            Quantity::Flux(kind) => kind.name(),
        },
        pass: &pass.name,
        target: TargetJson { name: &compared.measured.target, simulated_as: &pass.target.name },
        station: StationJson { name: &pass.station.name },
        night: compared.measured.kappa.as_ref().map(|k| &k.night),
        from_utc: format_utc(first, 3),
        to_utc: format_utc(last, 3),
        samples: all,
        used,
        channels: json_channels(compared),
        ratios: compared.ratios.iter().map(json_ratio).collect(),
        exposures: ExposuresJson {
            cut: compared.means.pieces.iter().filter(|p| **p > 1).count(),
            coarse: compared.means.coarse,
            largest_change: rounded(compared.means.largest_change),
            moments: compared.means.moments,
        },
        tolerance: pass.tolerance,
        doubtful_materials: compared
            .material
            .as_ref()
            .map(|d| d.each.iter().map(|m| &m.material).collect::<Vec<_>>()),
        needs: explain::json(&compared.simulation.needs),
        not_modelled: not_modelled(compared),
        cost: CostJson {
            total_s: rounded(compared.effort.middles.total_s + compared.effort.means.total_s),
            threads: compared.effort.middles.threads,
        },
        inputs,
        warnings: &compared.warnings,
    })
}

#[derive(Serialize)]
struct ChannelJson<'a> {
    name: &'a str,
    samples: usize,
    used: usize,
    left_out: Map<String, Value>,
    numbers: Option<NumbersJson>,
    by_phase: Option<Vec<BinJson>>,
    by_airmass: Option<Vec<BinJson>>,
}

fn json_channel(pair: &ComparedChannel) -> ChannelJson<'_> {
    let channel = &pair.channel;
    let left_out = &channel.left_out;
    let reasons: serde_json::Map<_, _> =
        left_out.reasons.iter().map(|(reason, n)| (reason.name(), Value::from(*n))).collect();
    let bins = |axis: Axis| {
        let own = pair.bins.iter().find(|(a, _)| *a == axis);
        own.map(|(_, bins)| bins.iter().map(json_bin).collect::<Vec<_>>())
    };
    ChannelJson {
        name: &channel.name,
        samples: channel.samples,
        used: channel.samples - left_out.samples,
        left_out: reasons,
        numbers: channel.numbers.as_ref().map(json_numbers),
        by_phase: bins(Axis::Phase),
        by_airmass: bins(Axis::Airmass),
    }
}

#[derive(Serialize)]
struct NumbersJson {
    scale: f64,
    scale_sigma: Option<f64>,
    scale_sigma_blocks: Option<f64>,
    kappa_sigma: Option<f64>,
    scale_interval: Option<[f64; 2]>,
    median: Option<f64>,
    scatter: Option<f64>,
    rms: Option<f64>,
    noise: Option<f64>,
    twinkling: Option<f64>,
    stated_error: StatedError,
    material: Option<MaterialJson>,
    mean_mag: Option<f64>,
    rms_mag: Option<f64>,
    scatter_mag: Option<f64>,
    chi2: Option<Chi2Json>,
}

#[derive(Serialize)]
struct StatedError {
    median_relative: Option<f64>,
    largest_relative: Option<f64>,
}

#[derive(Serialize)]
struct MaterialJson {
    median_relative: Option<f64>,
    largest_relative: Option<f64>,
    of_scale: Option<f64>,
}

#[derive(Serialize)]
struct Chi2Json {
    data: f64,
    with_twinkling: Option<f64>,
    past_stated: f64,
    past_materials: Option<f64>,
    unscaled: f64,
}

fn json_numbers(n: &Numbers) -> NumbersJson {
    let number = |v: Option<f64>| v.filter(|v| v.is_finite()).map(rounded);
    NumbersJson {
        scale: rounded(n.scale),
        scale_sigma: number(n.scale_sigma),
        scale_sigma_blocks: number(n.scale_sigma_blocks),
        kappa_sigma: number(n.common_sigma),
        scale_interval: n.scale_interval().map(|(a, b)| [rounded(a), rounded(b)]),
        median: number(Some(n.median)),
        scatter: number(Some(n.scatter)),
        rms: number(Some(n.rms)),
        noise: number(n.noise),
        twinkling: number(n.twinkling),
        stated_error: StatedError {
            median_relative: number(Some(n.stated.0)),
            largest_relative: number(Some(n.stated.1)),
        },
        material: n.material.map(|m| MaterialJson {
            median_relative: number(Some(m.median)),
            largest_relative: number(Some(m.largest)),
            of_scale: number(Some(m.of_scale)),
        }),
        mean_mag: n.magnitudes.map(|m| rounded(m[0])),
        rms_mag: n.magnitudes.map(|m| rounded(m[1])),
        scatter_mag: n.magnitudes.map(|m| rounded(m[2])),
        chi2: n.chi2.map(|c| Chi2Json {
            data: rounded(c.data),
            with_twinkling: number(c.with_twinkling),
            past_stated: rounded(c.past_stated),
            past_materials: number(c.past_materials),
            unscaled: rounded(c.unscaled),
        }),
    }
}

#[derive(Serialize)]
struct BinJson {
    from: f64,
    to: f64,
    samples: usize,
    ratio: f64,
    sigma: Option<f64>,
}

fn json_bin(bin: &Bin) -> BinJson {
    BinJson {
        from: rounded(bin.from),
        to: rounded(bin.to),
        samples: bin.samples,
        ratio: rounded(bin.ratio),
        sigma: bin.sigma.map(rounded),
    }
}

#[derive(Serialize)]
struct RatioJson<'a> {
    channel: &'a str,
    reference: &'a str,
    scale: f64,
    scale_sigma: Option<f64>,
    scale_sigma_blocks: Option<f64>,
    kappa_sigma: Option<f64>,
}

fn json_ratio(ratio: &Ratio) -> RatioJson<'_> {
    RatioJson {
        channel: &ratio.channel,
        reference: &ratio.reference,
        scale: rounded(ratio.scale),
        scale_sigma: ratio.sigma.map(rounded),
        scale_sigma_blocks: ratio.sigma_blocks.map(rounded),
        kappa_sigma: ratio.common_sigma.map(rounded),
    }
}
