//! A spectrometer's files as BRDF values: text, summary, figure.

use crate::plot::{Axis, Figure, Panel, Series};
use crate::{Product, json_of, rounded};
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use sunglint_formats::EncodeError;
use sunglint_formats::text::counted;
use sunglint_materials::exchange::{Exchange, Rgl};
use sunglint_materials::ingest::Ingested;
use sunglint_materials::ingest::file::IngestedFile;
use sunglint_materials::samples::Samples;
use sunglint_numerics::order::quantile;
use sunglint_radiometry::light_curve::Input;

/// More values than these go into a FITS file when a folder is written.
pub const MOST_IN_TEXT: usize = 2_000_000;

/// All forms of the result.
///
/// # Errors
/// Tables that FITS does not hold.
pub fn product(found: &IngestedFile) -> Result<Product, EncodeError> {
    let done = &found.ingested;
    let values = done.samples.rows.len() * done.samples.wavelength_nm.len();
    let mut product = Product {
        name: "samples".into(),
        figure: Some(figure(done)),
        json: summary(done, &found.inputs),
        fits: Some(done.samples.to_fits()?),
        ..Product::default()
    };
    if values <= MOST_IN_TEXT {
        product.table = done.samples.to_table();
    }
    Ok(product)
}

#[derive(Serialize)]
struct SamplesJson<'a> {
    format: Option<Exchange>,
    directions: usize,
    incidences_deg: Vec<f64>,
    wavelength_nm: &'a [f64],
    without_value: Option<&'a Value>,
    inputs: &'a [Input],
}

/// All forms of values that another program wrote.
///
/// # Errors
/// Tables that FITS does not hold.
pub fn table_product(
    samples: &Samples,
    format: Option<Exchange>,
    inputs: &[Input],
) -> Result<Product, EncodeError> {
    Ok(Product {
        name: "samples".into(),
        json: json_of(&SamplesJson {
            format,
            directions: samples.rows.len(),
            incidences_deg: incidences(samples),
            wavelength_nm: &samples.wavelength_nm,
            without_value: samples.meta.get("without_value"),
            inputs,
        }),
        fits: Some(samples.to_fits()?),
        table: samples.to_table(),
        ..Product::default()
    })
}

/// The text of values that another program wrote.
pub fn table_text(samples: &Samples, format: Option<Exchange>) -> String {
    let nm: Vec<String> = samples.wavelength_nm.iter().map(ToString::to_string).collect();
    let angles: Vec<String> =
        incidences(samples).iter().map(|v| format!("{}°", (v * 1e3).round() / 1e3)).collect();
    let mut text = format!(
        "{}: {} at {} nm, light from {}\n",
        format.map_or("a table", Exchange::name),
        counted(samples.rows.len(), "direction"),
        nm.join(", "),
        angles.join(", ")
    );
    if let Some(missing) = samples.meta.get("without_value") {
        let _ = writeln!(
            text,
            "{missing} directions above the horizon have no value (0 or negative) and are left out"
        );
    }
    text
}

/// A warning where a file of the RGL kind does not give the values from which it was made within 1 %.
#[must_use]
pub fn rgl_text(made: &Rgl) -> Option<String> {
    let percent = |ln: f64| (1e4 * ln.exp_m1()).round() / 100.0;
    (made.most_ln > 0.01).then(|| {
        format!(
            "a file of the RGL kind has directions of its own: half of the {} values above a thousandth of their peak are given within {} %, 95 of 100 within {} %",
            made.compared,
            percent(made.median_ln),
            percent(made.most_ln)
        )
    })
}

fn incidences(samples: &Samples) -> Vec<f64> {
    let mut all: Vec<f64> = samples.rows.iter().map(|r| r.theta_i_deg).collect();
    all.sort_by(f64::total_cmp);
    all.dedup();
    all
}

/// The text.
pub fn text(found: &IngestedFile) -> String {
    let done = &found.ingested;
    let nm = &done.samples.wavelength_nm;
    let mut text = format!(
        "{}, {} from {} to {} nm\n",
        counted(done.samples.rows.len(), "direction"),
        counted(nm.len(), "wavelength"),
        nm[0],
        nm[nm.len() - 1]
    );
    let mut by_channel: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for seam in &done.seams {
        by_channel.entry(&seam.channel).or_default().push(seam.scale);
    }
    for (channel, mut scales) in by_channel {
        scales.sort_by(f64::total_cmp);
        let _ = writeln!(
            text,
            "{channel} was scaled by {:.4} (median; {:.4} to {:.4}) to meet the detector before it",
            quantile(&scales, 0.5),
            scales[0],
            scales[scales.len() - 1]
        );
    }
    for pair in &done.pairs {
        let [a, b] = pair.directions;
        let _ = writeln!(
            text,
            "directions {a} and {b} are swapped: ratio {:.4} ± {:.4}",
            pair.ratio, pair.sigma
        );
    }
    if done.pairs.is_empty() {
        text.push_str("no two directions are swapped: reciprocity was not checked\n");
    }
    text
}

#[derive(Serialize)]
struct SeamJson<'a> {
    direction: usize,
    channel: &'a str,
    scale: f64,
    sigma: f64,
    wavelengths: usize,
}

#[derive(Serialize)]
struct PairJson {
    directions: [usize; 2],
    ratio: f64,
    sigma: f64,
}

#[derive(Serialize)]
struct RepeatJson<'a> {
    directions: &'a [usize],
    scatter: f64,
    expected: f64,
}

#[derive(Serialize)]
struct IngestedJson<'a> {
    directions: usize,
    wavelength_nm: &'a [f64],
    seams: Vec<SeamJson<'a>>,
    reciprocity: Vec<PairJson>,
    repeats: Vec<RepeatJson<'a>>,
    warnings: &'a [String],
    inputs: &'a [Input],
}

fn summary(done: &Ingested, inputs: &[Input]) -> Value {
    let seams: Vec<_> = done
        .seams
        .iter()
        .map(|s| SeamJson {
            direction: s.direction,
            channel: &s.channel,
            scale: rounded(s.scale),
            sigma: rounded(s.sigma),
            wavelengths: s.wavelengths,
        })
        .collect();
    let pairs: Vec<_> = done
        .pairs
        .iter()
        .map(|p| PairJson {
            directions: p.directions,
            ratio: rounded(p.ratio),
            sigma: rounded(p.sigma),
        })
        .collect();
    let repeats: Vec<_> = done
        .repeats
        .iter()
        .map(|r| RepeatJson {
            directions: &r.directions,
            scatter: rounded(r.scatter),
            expected: rounded(r.expected),
        })
        .collect();
    json_of(&IngestedJson {
        directions: done.samples.rows.len(),
        wavelength_nm: &done.samples.wavelength_nm,
        seams,
        reciprocity: pairs,
        repeats,
        warnings: &done.warnings,
        inputs,
    })
}

/// Spectra of some directions.
fn figure(done: &Ingested) -> Figure {
    const MOST: usize = 8;
    let rows = &done.samples.rows;
    let count = rows.len().min(MOST);
    let line = |j: usize| {
        let row = &rows[j * rows.len() / count];
        let points =
            done.samples.wavelength_nm.iter().copied().zip(row.brdf_per_sr.iter().copied());
        let label = format!("θᵢ {:.1}°, θₒ {:.1}°", row.theta_i_deg, row.theta_o_deg);
        Series::line(label, j, points.collect())
    };
    let shown = if count < rows.len() { format!(", {count} shown") } else { String::new() };
    Figure {
        title: format!("BRDF in {} directions{shown}", rows.len()),
        panels: vec![Panel::new(
            Axis::linear("wavelength (nm)"),
            Axis::log("f (sr⁻¹)"),
            (0..count).map(line).collect(),
        )],
    }
}
