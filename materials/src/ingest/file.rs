//! INGEST.toml: which file of a spectrometer is which direction and role.

use super::spectra::{self, NamedSpectrumError};
use super::{
    Channel, Direction, IngestError, IngestOptions, Ingested, RawSpectrum, Reference,
    ReferenceKind, ingest,
};
use serde::Deserialize;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::Path;
use sunglint_formats::toml::{Document, Finite};
use sunglint_formats::{FileError, ParseError};
use sunglint_numerics::progress::Progress;
use sunglint_radiometry::light_curve::Input;

/// Why the files are no measurement.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum IngestFileError {
    /// A file that cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// A key that is not what it should be, with its line.
    #[error(transparent)]
    Parse(#[from] ParseError),
    /// A spectrum that cannot be read.
    #[error(transparent)]
    Spectrum(#[from] NamedSpectrumError),
    /// Spectra that are no BRDF.
    #[error("{file}")]
    Ingest {
        /// INGEST.toml.
        file: String,
        /// Why.
        source: IngestError,
    },
    /// No value above 0.
    #[error("{file}: {why}")]
    Dark {
        /// INGEST.toml.
        file: String,
        /// Advice on what to look at.
        why: &'static str,
    },
}

/// Result of reading the files.
#[derive(Debug, Clone)]
pub struct IngestedFile {
    /// The values, with what the file says of them.
    pub ingested: Ingested,
    /// INGEST.toml as the result names it.
    pub inputs: Vec<Input>,
    /// Directions without a value above 0.
    pub dark: usize,
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

/// Reads the files that INGEST.toml names, direction by direction, and makes BRDF values of them.
///
/// # Errors
/// A file that cannot be read or is none, spectra that are no BRDF, no value above 0.
pub fn ingest_file(path: &Path, progress: &dyn Progress) -> Result<IngestedFile, IngestFileError> {
    let document = Document::read(path)?;
    let file: IngestFile = document.parse()?;
    let (channels, reference) = setup(&document, &file)?;
    progress.begin("spectra", Some(file.direction.len() as u64));
    let mut directions = Vec::with_capacity(file.direction.len());
    for (k, direction) in file.direction.iter().enumerate() {
        directions.push(read(&document, &channels, k, direction)?);
        progress.advance(1);
    }
    let options = IngestOptions {
        wavelength_nm: wavelengths(&document, &file.wavelength_nm)?,
        solid_angle_sr: file.solid_angle_sr.get(),
        scale_sigma: file.scale_sigma.map_or(0.0, Finite::get),
        stitch: file.stitch.unwrap_or(true),
        warn_scale: file.warn_scale.map_or(0.05, Finite::get),
        warn_reciprocity: file.warn_reciprocity.map_or(0.05, Finite::get),
    };
    let name = || path.display().to_string();
    let mut done = ingest(&channels, &reference, &directions, &options)
        .map_err(|source| IngestFileError::Ingest { file: name(), source })?;
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
        // What was noticed on the way may say why.
        done.warnings.iter().for_each(|warning| progress.warn(warning));
        return Err(IngestFileError::Dark { file: name(), why });
    }
    let dark = none.len();
    let meta = &mut done.samples.meta;
    for (key, text) in
        [("polarisation", &file.polarisation), ("sample", &file.sample), ("note", &file.note)]
    {
        meta.insert(key.into(), json!(text));
    }
    let sha256 = sunglint_formats::sha256(document.source().as_bytes());
    let inputs = vec![Input { file: name(), sha256 }];
    meta.insert("inputs".into(), json!(inputs));
    Ok(IngestedFile { ingested: done, inputs, dark })
}

fn wavelengths(document: &Document, given: &Wavelengths) -> Result<Vec<f64>, IngestFileError> {
    let (from, to, step) = (given.from.get(), given.to.get(), given.step.get());
    let count = (to - from) / step;
    if !(from > 1.0 && step > 0.0 && (0.0..1e5).contains(&count)) {
        let expected =
            "from above 1 nm, a step above 0, to at or above from, at most 100000 of them";
        return Err(document.error_at("wavelength_nm", expected).into());
    }
    Ok((0..=(count + 1e-9) as usize).map(|k| from + step * k as f64).collect())
}

fn setup(
    document: &Document,
    file: &IngestFile,
) -> Result<(Vec<Channel>, Reference), IngestFileError> {
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
) -> Result<Direction, IngestFileError> {
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
