//! A fit of measured passes: summary, tables, JSON, figures, page.

mod page;

use crate::numbers::{NO_WEIGHT, percent_with_sigma};
use crate::plot::{Axis, Figure, Panel, RGBColor, Series, colour_of_wavelength_nm};
use crate::{Product, json_of};
use serde::Serialize;
use std::fmt::Write as _;
use sunglint_formats::time::format_utc_shortest;
use sunglint_formats::{Column, Table};
use sunglint_inference::fit::{CurveFit, MagnitudeTrack, MaterialSpectrum, PassFit};
use sunglint_inference::solver::{Estimate, IntervalMethod, Side, Summary};
use sunglint_simulator::pass::{Averaged, Thinned};

/// Tables, figures, page, JSON.
///
/// # Errors
/// A result that JSON cannot hold.
pub fn product(answer: &PassFit) -> serde_json::Result<Product> {
    let mut others = Vec::new();
    for (k, curve) in answer.curves.iter().enumerate().skip(1) {
        others.push(Product {
            name: format!("{}_fit_{}", answer.name, k + 1),
            table: table(answer, curve),
            figure: Some(figure(answer, curve)),
            json: serde_json::to_value(curve)?,
            ..Product::default()
        });
    }
    for spectrum in answer.spectra.iter().filter(|s| s.upsampled) {
        others.push(Product {
            name: format!("{}_fit_spectrum_{}", answer.name, spectrum.material),
            table: spectrum_table(spectrum),
            figure: Some(spectrum_figure(spectrum)),
            json: serde_json::to_value(spectrum)?,
            ..Product::default()
        });
    }
    Ok(Product {
        name: format!("{}_fit", answer.name),
        table: answer.curves.first().map(|c| table(answer, c)).unwrap_or_default(),
        figure: answer.curves.first().map(|c| figure(answer, c)),
        html: Some(page::report(answer).html()),
        json: serde_json::to_value(answer)?,
        others,
        ..Product::default()
    })
}

/// The summary as text.
pub fn text(answer: &PassFit) -> String {
    let fit = &answer.fit;
    let mut text = format!(
        "{}, {} curve{}, {} samples, {} parameters; chi-square {:.1} for {} degrees of freedom (reduced {:.3}), {} loss\n",
        answer.scene_file.display(),
        answer.curves.len(),
        if answer.curves.len() == 1 { "" } else { "s" },
        fit.samples,
        fit.parameters.len(),
        fit.chi2,
        fit.degrees_of_freedom,
        fit.reduced_chi2,
        serde_json::to_value(fit.loss)
            .ok()
            .and_then(|v| v.as_str().map(str::to_owned))
            .unwrap_or_default(),
    );
    let _ = writeln!(
        text,
        "{} after {} simulations in {:.1} s; intervals: stated noise{}",
        if fit.converged { "converged" } else { "NOT CONVERGED" },
        fit.evaluations,
        answer.seconds,
        if fit.scaled_by > 1.0 {
            format!(", its variance times {:.3} as the residuals ask", fit.scaled_by)
        } else {
            String::new()
        }
    );
    let width = fit.parameters.iter().map(|p| p.name.chars().count()).max().unwrap_or(4).max(9);
    let _ = writeln!(
        text,
        "\n{:<width$}  {:>12}  {:>10}  95 % interval",
        "parameter", "value", "sigma"
    );
    for p in &fit.parameters {
        let _ = writeln!(text, "{}", row(p, width));
    }
    if !answer.doubtful_materials.is_empty() {
        let parts: Vec<String> = fit
            .parameters
            .iter()
            .filter_map(|p| Some(format!("{} {}", p.name, number(p.sigma_material?))))
            .collect();
        let _ = writeln!(
            text,
            "in sigma and intervals is the doubt of {}, all directions of a material off alike: {}",
            answer.doubtful_materials.join(", "),
            parts.join(", ")
        );
    }
    for (title, groups) in [
        ("channel", &answer.groups.by_channel),
        ("phase angle", &answer.groups.by_phase),
        ("airmass", &answer.groups.by_airmass),
    ] {
        if title == "channel" || groups.len() > 1 {
            let _ = writeln!(text, "\nmeasured less model, by {title}");
            groups.iter().for_each(|g| summary(&mut text, g));
        }
    }
    for curve in &answer.curves {
        let lost: Vec<String> =
            curve.left_out.iter().map(|l| format!("{} {}", l.samples, l.why)).collect();
        let left = if lost.is_empty() {
            String::new()
        } else {
            format!("; left out: {}", lost.join(", "))
        };
        let _ = writeln!(text, "\n{}: {} samples fitted{left}", curve.path.display(), curve.fitted);
        for track in of_tracks(&curve.tracks) {
            let _ = writeln!(text, "  {track}");
        }
    }
    for curve in &answer.curves {
        let _ = writeln!(text, "{}: {}", curve.name, of_averaged(&curve.averaged));
        if let Some(thinned) =
            curve.thinned.filter(|t| t.direct < t.epochs || t.indirect < t.epochs)
        {
            let _ = writeln!(text, "{}: {}", curve.name, of_thinned(&thinned));
        }
    }
    if let Some(bounces) = &answer.bounces {
        let _ = writeln!(
            text,
            "\nlight between the parts, up to {:.1} % of a sample's, computed for what was found in {} rounds; the last moved no parameter by more than {:.2} sigma",
            100.0 * bounces.share,
            bounces.rounds,
            bounces.moved_sigmas
        );
    }
    text += &predictions(answer);
    for spectrum in answer.spectra.iter().filter(|s| s.upsampled) {
        let range = constrained(spectrum);
        let _ = writeln!(
            text,
            "\n{}: a reflectance spectrum through its band albedos, one of many that have them; the bands say something from {:.0} to {:.0} nm (largest miss {:.2} sigma)",
            spectrum.material, range.0, range.1, spectrum.found.largest_pull
        );
    }
    text
}

/// Lines on curves that fits of the others predicted.
fn predictions(answer: &PassFit) -> String {
    let mut text = String::new();
    let all: Vec<_> = answer.predicted.iter().flat_map(|p| &p.curves).collect();
    if all.is_empty() {
        return text;
    }
    text.push_str("\npredicted by fits of the other curves, attitudes and zero points as the scenes have them\n");
    for fit in &answer.predicted {
        let open = if fit.converged { "" } else { ", the fit did NOT converge" };
        for curve in &fit.curves {
            let _ = writeln!(
                text,
                "  {}: rms {:.3} mag (mean {:+.3}), {} samples{open}",
                curve.name, curve.rms_mag, curve.mean_mag, curve.samples
            );
        }
    }
    let middle = sunglint_numerics::order::median(all.iter().map(|c| c.rms_mag));
    if let Some(middle) = middle {
        let _ = writeln!(text, "  median of {}: {middle:.3} mag", all.len());
    }
    text
}

fn row(p: &Estimate, width: usize) -> String {
    let or_dash = |v: Option<f64>| v.map_or("-".to_owned(), number);
    let [low, high] = p.interval_95;
    let mut line = format!(
        "{:<width$}  {:>12}  {:>10}  {} to {}",
        p.name,
        number(p.value),
        or_dash(p.sigma),
        or_dash(low),
        or_dash(high)
    );
    match (p.interval_method, p.at_bound) {
        (IntervalMethod::None, _) => line.push_str("  (not determined)"),
        (_, Some(Side::Low)) => line.push_str("  (at its lower bound)"),
        (_, Some(Side::High)) => line.push_str("  (at its upper bound)"),
        (IntervalMethod::Profile, None) => line.push_str("  (by profile)"),
        (IntervalMethod::Covariance, None) => {}
    }
    line
}

/// Returns the number of samples that are means over their exposures, in words.
fn of_averaged(a: &Averaged) -> String {
    let err = format!("by up to {:.1e} of the light", a.error);
    let beyond = match a.beyond {
        0 => String::new(),
        n => format!(
            "; the exposures of {n} reach beyond a table of positions or attitudes, and have their middles"
        ),
    };
    let averaged = match a.averaged {
        0 => {
            format!("the middle of each exposure stands for its mean, from which it differs {err}")
        }
        n if n == a.samples => {
            format!(
                "all samples are means over their exposures, {} moments in all, and err {err}",
                a.moments
            )
        }
        n => format!(
            "{n} of {} samples are means over their exposures ({} moments); the middles of their exposures stand for the others; either is off {err}",
            a.samples, a.moments
        ),
    };
    averaged + &beyond
}

/// At how many epochs light was computed, in words.
fn of_thinned(t: &Thinned) -> String {
    let indirect = match t.indirect {
        0 => String::new(),
        n => format!(", all other light at {n}"),
    };
    format!(
        "direct light was computed at {} of {} epochs{indirect}; the lines between err by up to {:.1e} of the light",
        t.direct, t.epochs, t.error
    )
}

/// A number in six digits.
fn number(value: f64) -> String {
    if value != 0.0 && !(1e-4..1e6).contains(&value.abs()) {
        return format!("{value:.4e}");
    }
    let digits = (5 - value.abs().max(1e-4).log10().floor() as i32).clamp(0, 7);
    format!("{value:.*}", digits as usize)
}

fn summary(text: &mut String, g: &Summary) {
    let mean = percent_with_sigma(g.mean_relative, g.sigma_relative)
        .map_or_else(|| NO_WEIGHT.to_owned(), |[mean, sigma]| format!("{mean} ± {sigma}"));
    let _ = writeln!(
        text,
        "  {:<14} {:>6} {}   mean {mean}   rms {:.2} of the noise",
        g.group,
        g.samples,
        if g.samples == 1 { "sample " } else { "samples" },
        g.rms_pull
    );
}

#[derive(Serialize)]
struct FitJson<'a> {
    scene: String,
    measured: String,
    converged: bool,
    reduced_chi2: f64,
    parameters: &'a [Estimate],
    in_the_scene: &'a [f64],
    doubtful_materials: &'a [String],
}

/// Measured, model and residual of every sample.
fn table(answer: &PassFit, curve: &CurveFit) -> Table {
    let mut table = Table::default();
    let unit = if curve.magnitudes { None } else { Some("Hz") };
    let (suffix, what) = if curve.magnitudes {
        ("flux", "flux over that of magnitude 0")
    } else {
        ("rate_hz", "rate at the detector")
    };
    let mut time =
        Column::text("time_utc", curve.times.iter().map(|t| format_utc_shortest(*t)).collect());
    time.description = Some("mid-exposure, ISO 8601".into());
    table.columns.push(time);
    table.columns.push(Column::f64("exposure_s", Some("s"), curve.exposure_s.clone()));
    for (c, name) in answer.channels.iter().enumerate() {
        let column = |suffix: String, unit: Option<&str>, values: Vec<f64>, description: &str| {
            let mut column = Column::f64(format!("{name}_{suffix}"), unit, values);
            column.description = Some(description.into());
            column
        };
        let used = curve.used.column(c).iter().map(|u| f64::from(u8::from(*u))).collect();
        let list = |values: &ndarray::Array2<f64>| values.column(c).to_vec();
        table.columns.push(column(
            suffix.into(),
            unit,
            list(&curve.rate),
            &format!("measured: {what}"),
        ));
        let sigma = suffix.replace("rate", "sigma").replace("flux", "sigma");
        table.columns.push(column(
            sigma,
            unit,
            list(&curve.sigma),
            "its standard uncertainty, no scintillation",
        ));
        let model = suffix.replace("rate", "model").replace("flux", "model");
        table.columns.push(column(model, unit, list(&curve.model.model), "fitted"));
        table.columns.push(column(
            "pull".into(),
            None,
            list(&curve.model.pull),
            "measured less fitted over the noise of one sample, scintillation in it",
        ));
        table.columns.push(column(
            "weight".into(),
            None,
            list(&curve.model.weight),
            "how much the loss let it count",
        ));
        table.columns.push(column("fitted".into(), None, used, "1 where it was fitted"));
    }
    for (name, unit, values) in [
        ("range_m", Some("m"), &curve.range_m),
        ("phase_deg", Some("deg"), &curve.phase_deg),
        ("zenith_deg", Some("deg"), &curve.zenith_deg),
        ("airmass", None, &curve.airmass),
    ] {
        table.columns.push(Column::f64(name, unit, values.clone()));
    }
    table.meta.insert(
        "fit".into(),
        json_of(&FitJson {
            scene: answer.scene_file.display().to_string(),
            measured: curve.path.display().to_string(),
            converged: answer.fit.converged,
            reduced_chi2: answer.fit.reduced_chi2,
            parameters: &answer.fit.parameters,
            in_the_scene: &answer.in_the_scene,
            doubtful_materials: &answer.doubtful_materials,
        }),
    );
    table
}

/// Measured and fitted against time, and what is left.
fn figure(answer: &PassFit, curve: &CurveFit) -> Figure {
    let first = curve.times[0];
    let seconds: Vec<f64> = curve.times.iter().map(|t| (*t - first).to_seconds()).collect();
    // Tracks of magnitudes may lie months apart: each has panels of its own.
    let mut starts = vec![0];
    starts.extend((1..seconds.len()).filter(|i| (seconds[*i] - seconds[*i - 1]).abs() > 1800.0));
    if starts.len() > 3 {
        starts.truncate(1);
    }
    let ends: Vec<usize> = starts.iter().skip(1).copied().chain([seconds.len()]).collect();
    let mut panels = Vec::new();
    for (from, to) in starts.into_iter().zip(ends) {
        panels.extend(track_panels(answer, curve, from..to));
    }
    let title = format!("{} and {} fitted to it", curve.name, answer.name);
    Figure { title, panels }
}

fn track_panels(answer: &PassFit, curve: &CurveFit, part: std::ops::Range<usize>) -> Vec<Panel> {
    let first = curve.times[part.start];
    let at: Vec<f64> = curve.times.iter().map(|t| (*t - first).to_seconds()).collect();
    let mut order: Vec<usize> = part.collect();
    order.sort_by(|a, b| at[*a].total_cmp(&at[*b]));
    let (mut dots, mut lines, mut left) = (Vec::new(), Vec::new(), Vec::new());
    for (c, name) in answer.channels.iter().enumerate() {
        let value = |v: f64| if curve.magnitudes { -2.5 * v.log10() } else { v };
        let used = order.iter().filter(|i| curve.used[[**i, c]]);
        let points: Vec<(f64, f64)> =
            used.clone().map(|i| (at[*i], value(curve.rate[[*i, c]]))).collect();
        if points.is_empty() {
            continue;
        }
        let pulls = used.map(|i| (at[*i], curve.model.pull[[*i, c]])).collect();
        let mut model: Vec<(f64, f64)> = Vec::new();
        for i in &order {
            // A gap is no line.
            if let Some((before, _)) = model.last()
                && at[*i] - before > 60.0
            {
                model.push((0.5 * (at[*i] + before), f64::NAN));
            }
            model.push((at[*i], value(curve.model.model[[*i, c]])));
        }
        let fitted = Series::line("", c, model);
        dots.push(Series { colour: pale(fitted.colour), ..Series::dots("", c, points) });
        lines.push(Series { label: name.clone(), ..fitted });
        left.push(Series { label: name.clone(), ..Series::dots("", c, pulls) });
    }
    let x = || Axis::linear(format!("s since {}", format_utc_shortest(first)));
    let y = match curve.magnitudes {
        true => Axis::linear("V above the air (mag); line: fitted").inverted(),
        false => Axis::log("calibrated rate (Hz); lines: fitted"),
    };
    dots.extend(lines);
    vec![
        Panel::new(x(), y, dots),
        Panel::new(x(), Axis::linear("measured less fitted / noise of a sample"), left),
    ]
}

/// Half way to white.
fn pale(colour: RGBColor) -> RGBColor {
    let half = |v: u8| 128 + v / 2;
    RGBColor(half(colour.0), half(colour.1), half(colour.2))
}

/// The wavelengths between which bands say something.
fn constrained(spectrum: &MaterialSpectrum) -> (f64, f64) {
    let found = &spectrum.found;
    let inside = || found.wavelength_nm.iter().zip(&found.constrained).filter(|(_, c)| **c);
    let first = inside().next().map_or(f64::NAN, |(nm, _)| *nm);
    (first, inside().next_back().map_or(f64::NAN, |(nm, _)| *nm))
}

#[derive(Serialize)]
struct BandJson<'a> {
    channel: &'a str,
    albedo: f64,
    of_spectrum: f64,
}

fn spectrum_table(spectrum: &MaterialSpectrum) -> Table {
    let found = &spectrum.found;
    let mut table = Table::default();
    let flags = found.constrained.iter().map(|c| f64::from(u8::from(*c))).collect();
    table.columns = vec![
        Column::f64("wavelength_nm", Some("nm"), found.wavelength_nm.clone()),
        Column::f64("reflectance", None, found.reflectance.clone()),
        Column::f64("sigma", None, found.sigma.clone()),
        Column::f64("constrained", None, flags),
    ];
    let note = "one of many spectra with these band albedos; where constrained is 0 no band says anything; wavelengths are in vacuum";
    let bands: Vec<_> = (found.bands.iter())
        .map(|(name, wanted, has)| BandJson { channel: name, albedo: *wanted, of_spectrum: *has })
        .collect();
    table.meta.insert("note".into(), json_of(&note));
    table.meta.insert("bands".into(), json_of(&bands));
    table
}

fn spectrum_figure(spectrum: &MaterialSpectrum) -> Figure {
    let found = &spectrum.found;
    let all = |k: f64| -> Vec<(f64, f64)> {
        (0..found.wavelength_nm.len())
            .filter(|a| found.constrained[*a])
            .map(|a| {
                // No surface has another reflectance, whatever the bands leave open.
                let value = (found.reflectance[a] + k * found.sigma[a]).clamp(0.0, 1.0);
                (found.wavelength_nm[a], value)
            })
            .collect()
    };
    let grey = RGBColor(170, 170, 170);
    let mut series = vec![
        Series::line("± 1 sigma", 6, all(1.0)).with_colour(grey),
        Series::line("", 6, all(-1.0)).with_colour(grey),
        Series::line("spectrum", 0, all(0.0)).with_colour(RGBColor(40, 40, 40)),
    ];
    for (k, (name, albedo, _)) in found.bands.iter().enumerate() {
        let nm = answer_nm(spectrum, k);
        series.push(
            Series::dots(name.clone(), k, vec![(nm, *albedo)])
                .with_colour(colour_of_wavelength_nm(nm)),
        );
    }
    let panel =
        Panel::new(Axis::linear("wavelength in vacuum (nm)"), Axis::linear("reflectance"), series);
    let title = format!("{}: one of many spectra with these band albedos", spectrum.material);
    Figure { title, panels: vec![panel] }
}

/// Where a band's albedo is drawn: the mean wavelength of its weights.
fn answer_nm(spectrum: &MaterialSpectrum, band: usize) -> f64 {
    spectrum.found.band_nm.get(band).copied().unwrap_or(f64::NAN)
}

/// Tracks of fewer samples are told together.
const LONG_TRACK: usize = 8;

/// Lines on the tracks of magnitudes: one for each long one, one for all others.
fn of_tracks(tracks: &[MagnitudeTrack]) -> Vec<String> {
    let (long, short): (Vec<_>, Vec<_>) = (tracks.iter().filter(|t| t.samples > 0))
        .partition(|t| t.samples >= LONG_TRACK || tracks.len() == 1);
    let mut lines: Vec<String> = long
        .iter()
        .map(|t| {
            format!(
                "track of {}: {} samples, rms {:.3} mag about the model (mean {:+.3}), white noise {:.3} mag",
                format_utc_shortest(t.from_utc),
                t.samples,
                t.rms_mag,
                t.mean_mag,
                t.white_noise_mag
            )
        })
        .collect();
    let samples: usize = short.iter().map(|t| t.samples).sum();
    if samples > 0 {
        let sum = |f: &dyn Fn(&MagnitudeTrack) -> f64| -> f64 {
            short.iter().map(|t| t.samples as f64 * f(t)).sum::<f64>() / samples as f64
        };
        lines.push(format!(
            "{} tracks of fewer than {LONG_TRACK} samples: {samples} samples, rms {:.3} mag about the model (mean {:+.3})",
            short.len(),
            sum(&|t| t.rms_mag * t.rms_mag).sqrt(),
            sum(&|t| t.mean_mag)
        ));
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: a group whose model has no light has a mean of 0/0 ± 1/0.
    #[test]
    fn a_mean_that_is_no_number_is_not_known() {
        let group = Summary {
            group: "V".into(),
            samples: 1,
            mean_relative: f64::NAN,
            sigma_relative: f64::INFINITY,
            rms_pull: 2.0,
        };
        let mut text = String::new();
        summary(&mut text, &group);
        assert!(text.contains("1 sample ") && text.contains("mean not known (none of"), "{text}");
        assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
    }
}
