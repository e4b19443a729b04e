//! `sunglint brdf ingest`: a spectrometer's files, direction by direction, as BRDF values.

use super::spectra;
use crate::output::{Console, OutputArgs};
use anyhow::Context as _;
use clap::Args;
use serde::Deserialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;
use sunglint_formats::toml::{Document, Finite};
use sunglint_materials::ingest::{
    Channel, Direction, IngestOptions, Ingested, RawSpectrum, Reference, ReferenceKind, ingest,
};
use sunglint_report::plot::{Axis, Figure, Panel, Series};
use sunglint_report::{Product, rounded};

/// More values than these go into a FITS file when a folder is written.
const MOST_IN_TEXT: usize = 2_000_000;

/// Arguments of `sunglint brdf ingest`.
#[derive(Debug, Args)]
pub struct IngestArgs {
    /// Which file is which direction and role
    #[arg(value_name = "INGEST.toml")]
    pub file: PathBuf,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct IngestFile {
    solid_angle_sr: Finite,
    #[serde(default)]
    scale_sigma: Option<Finite>,
    wavelength_nm: Wavelengths,
    #[serde(default)]
    polarisation: Option<String>,
    #[serde(default)]
    sample: Option<String>,
    #[serde(default)]
    note: Option<String>,
    #[serde(default)]
    stitch: Option<bool>,
    #[serde(default)]
    warn_scale: Option<Finite>,
    #[serde(default)]
    warn_reciprocity: Option<Finite>,
    reference: ReferenceFile,
    detector: Vec<DetectorFile>,
    direction: Vec<DirectionFile>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Wavelengths {
    from: Finite,
    to: Finite,
    step: Finite,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ReferenceFile {
    kind: Kind,
    #[serde(default)]
    reflectance: Option<Finite>,
    #[serde(default)]
    reflectance_file: Option<String>,
    #[serde(default)]
    theta_o_deg: Option<Finite>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Kind {
    Mirror,
    Lambert,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct DetectorFile {
    name: String,
    range_nm: [Finite; 2],
    reference: String,
    #[serde(default)]
    reference_dark: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct DirectionFile {
    theta_i_deg: Finite,
    phi_i_deg: Finite,
    theta_o_deg: Finite,
    phi_o_deg: Finite,
    #[serde(default)]
    scale: Option<Finite>,
    files: BTreeMap<String, String>,
    #[serde(default)]
    dark: BTreeMap<String, String>,
}

pub(super) fn run(args: &IngestArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    let document = Document::read(&args.file)?;
    let file: IngestFile = document.parse()?;
    let (channels, reference) = setup(&document, &file)?;
    let bar = crate::brdf::progress(file.direction.len() as u64, "spectra", console);
    let mut directions = Vec::with_capacity(file.direction.len());
    for (k, direction) in file.direction.iter().enumerate() {
        directions.push(read(&document, &channels, k, direction)?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    let options = IngestOptions {
        wavelength_nm: wavelengths(&document, &file.wavelength_nm)?,
        solid_angle_sr: file.solid_angle_sr.get(),
        scale_sigma: file.scale_sigma.map_or(0.0, Finite::get),
        stitch: file.stitch.unwrap_or(true),
        warn_scale: file.warn_scale.map_or(0.05, Finite::get),
        warn_reciprocity: file.warn_reciprocity.map_or(0.05, Finite::get),
    };
    let context = || args.file.display().to_string();
    let mut done = ingest(&channels, &reference, &directions, &options).with_context(context)?;
    for warning in &done.warnings {
        console.warn(warning);
    }
    let rows = &done.samples.rows;
    let dark = |v: &&[f64]| !v.iter().any(|v| *v > 0.0);
    let none: Vec<&[f64]> = rows.iter().map(|r| &r.brdf_per_sr[..]).filter(dark).collect();
    if none.len() == rows.len() {
        let no_data = none.iter().all(|v| v.iter().all(|v| v.is_nan()));
        let why = if no_data {
            "no file has data at the wavelengths asked for: look at wavelength_nm and range_nm, and whether a column named wavelength_nm holds wavenumbers (cm⁻¹) or the other way round"
        } else {
            "no value is above 0: no light came (a shutter, a dark scan as the signal, the dark subtracted twice?)"
        };
        anyhow::bail!("{}: {why}", args.file.display());
    }
    if !none.is_empty() {
        console.warn(&format!("{} of {} directions have no value above 0", none.len(), rows.len()));
    }
    let meta = &mut done.samples.meta;
    for (key, text) in
        [("polarisation", &file.polarisation), ("sample", &file.sample), ("note", &file.note)]
    {
        meta.insert(key.into(), json!(text));
    }
    let sha256 = sunglint_formats::sha256(document.source().as_bytes());
    let inputs = json!([{ "file": args.file.display().to_string(), "sha256": sha256 }]);
    meta.insert("inputs".into(), inputs.clone());
    let values = done.samples.rows.len() * done.samples.wavelength_nm.len();
    let fits = Some(done.samples.to_fits()?);
    let mut product = Product {
        name: "samples".into(),
        figure: Some(figure(&done)),
        json: summary(&done, &inputs),
        fits,
        ..Product::default()
    };
    if values <= MOST_IN_TEXT {
        product.table = done.samples.to_table();
    } else {
        console.warn(&format!("{values} values: too many for a text, a folder gets samples.fits"));
    }
    args.out.finish(&product, &text(&done), console)
}

fn wavelengths(document: &Document, given: &Wavelengths) -> anyhow::Result<Vec<f64>> {
    let (from, to, step) = (given.from.get(), given.to.get(), given.step.get());
    let count = (to - from) / step;
    if !(from > 1.0 && step > 0.0 && (0.0..1e5).contains(&count)) {
        let expected =
            "from above 1 nm, a step above 0, to at or above from, at most 100000 of them";
        return Err(document.error_at("wavelength_nm", expected).into());
    }
    Ok((0..=(count + 1e-9) as usize).map(|k| from + step * k as f64).collect())
}

fn setup(document: &Document, file: &IngestFile) -> anyhow::Result<(Vec<Channel>, Reference)> {
    let reflectance = match (&file.reference.reflectance, &file.reference.reflectance_file) {
        (Some(one), None) => RawSpectrum::constant(one.get()),
        (None, Some(name)) => spectra::named(document, "reference.reflectance_file", name)?,
        _ => {
            let expected = "either reflectance or reflectance_file";
            return Err(document.error_at("reference", expected).into());
        }
    };
    let lambert = file.reference.kind == Kind::Lambert;
    if file.reference.theta_o_deg.is_some() != lambert {
        let expected = "theta_o_deg with kind = \"lambert\", and only there";
        return Err(document.error_at("reference", expected).into());
    }
    let reference = Reference {
        kind: if lambert { ReferenceKind::Lambert } else { ReferenceKind::Mirror },
        reflectance,
        theta_o_deg: file.reference.theta_o_deg.map_or(0.0, Finite::get),
    };
    let mut channels: Vec<Channel> = Vec::new();
    for (k, detector) in file.detector.iter().enumerate() {
        let key = |name: &str| format!("detector[{k}].{name}");
        if channels.iter().any(|c| c.name == detector.name) {
            return Err(document.error_at(&key("name"), "a name of its own").into());
        }
        let range_nm = (detector.range_nm[0].get(), detector.range_nm[1].get());
        if range_nm.0 >= range_nm.1 {
            return Err(document.error_at(&key("range_nm"), "[from, to], increasing").into());
        }
        let dark = detector.reference_dark.as_deref();
        channels.push(Channel {
            name: detector.name.clone(),
            range_nm,
            reference: spectra::named(document, &key("reference"), &detector.reference)?,
            reference_dark: dark
                .map(|name| spectra::named(document, &key("reference_dark"), name))
                .transpose()?,
        });
    }
    if channels.is_empty() || file.direction.is_empty() {
        return Err(document.error_at("detector", "a detector and a direction, or more").into());
    }
    Ok((channels, reference))
}

fn read(
    document: &Document,
    channels: &[Channel],
    k: usize,
    direction: &DirectionFile,
) -> anyhow::Result<Direction> {
    for (table, names) in [("files", &direction.files), ("dark", &direction.dark)] {
        if let Some(name) = names.keys().find(|n| !channels.iter().any(|c| c.name == **n)) {
            let known: Vec<&str> = channels.iter().map(|c| c.name.as_str()).collect();
            let key = format!("direction[{k}].{table}.{name}");
            let expected = format!("a detector: {}", known.join(", "));
            return Err(document.error_at(&key, expected).into());
        }
    }
    if direction.files.is_empty() {
        let key = format!("direction[{k}].files");
        return Err(document.error_at(&key, "a file for one detector or more").into());
    }
    let mut signal = Vec::new();
    for channel in channels {
        let of = |table: &str, names: &BTreeMap<String, String>| {
            let key = format!("direction[{k}].{table}.{}", channel.name);
            let name = names.get(&channel.name);
            name.map(|name| spectra::named(document, &key, name)).transpose()
        };
        let dark = of("dark", &direction.dark)?;
        signal.push(of("files", &direction.files)?.map(|light| (light, dark)));
    }
    let [theta_i, phi_i] = [direction.theta_i_deg, direction.phi_i_deg].map(Finite::get);
    let [theta_o, phi_o] = [direction.theta_o_deg, direction.phi_o_deg].map(Finite::get);
    let scale = direction.scale.map_or(1.0, Finite::get);
    if scale <= 0.0 {
        return Err(document.error_at(&format!("direction[{k}].scale"), "above 0").into());
    }
    Ok(Direction { angles_deg: [theta_i, phi_i, theta_o, phi_o], scale, signal })
}

fn text(done: &Ingested) -> String {
    let nm = &done.samples.wavelength_nm;
    let mut text = format!(
        "{} directions, {} wavelengths from {} to {} nm\n",
        done.samples.rows.len(),
        nm.len(),
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
            scales[scales.len() / 2],
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

fn summary(done: &Ingested, inputs: &Value) -> Value {
    let seams: Vec<Value> = done
        .seams
        .iter()
        .map(|s| json!({ "direction": s.direction, "channel": s.channel, "scale": rounded(s.scale), "sigma": rounded(s.sigma), "wavelengths": s.wavelengths }))
        .collect();
    let pairs: Vec<Value> = done
        .pairs
        .iter()
        .map(|p| json!({ "directions": p.directions, "ratio": rounded(p.ratio), "sigma": rounded(p.sigma) }))
        .collect();
    let repeats: Vec<Value> = done
        .repeats
        .iter()
        .map(|r| json!({ "directions": r.directions, "scatter": rounded(r.scatter), "expected": rounded(r.expected) }))
        .collect();
    json!({
        "directions": done.samples.rows.len(),
        "wavelength_nm": done.samples.wavelength_nm,
        "seams": seams,
        "reciprocity": pairs,
        "repeats": repeats,
        "warnings": done.warnings,
        "inputs": inputs,
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
