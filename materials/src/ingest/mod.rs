//! From a spectrometer's spectra, direction by direction, to BRDF values.
//!
//! For each detector f = (S − S_dark)/(R − R_dark) · what the reference is/(Ω_o cosθ_o): the light falls beside nothing (the spot lies on the sample), the detector collects the
//! solid angle Ω_o; the reference is the light itself by a mirror of known reflectance, or a Lambert standard (ρ/π cosθ_r Ω_o). Then detectors are joined: in the overlap
//! of two, the second is scaled to the first, once for each direction, and its uncertainty is what the overlap says.

pub mod file;
mod repeat;
pub mod spectra;
mod spectrum;

pub use repeat::once;
pub use spectrum::{AxisError, RawSpectrum};

use super::samples::{Sample, Samples, turned};
use glam::DVec3;
use serde::Serialize;
use serde_json::json;
use spectrum::Onto;
use sunglint_formats::Meta;

/// Kind of reference that the light is compared with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ReferenceKind {
    /// The beam itself, by a mirror of known reflectance (1 for the beam without one).
    Mirror,
    /// A Lambert surface of known reflectance, seen under the angle θ_r.
    Lambert,
}

/// The reference.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    /// Which kind.
    pub kind: ReferenceKind,
    /// Reflectance of the reference by wavelength (vacuum nm).
    pub reflectance: RawSpectrum,
    /// The angle under which a Lambert surface was seen, degrees.
    pub theta_o_deg: f64,
}

/// One detector's share of a measurement.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Name of the detector.
    pub name: String,
    /// The range that counts, vacuum nm.
    pub range_nm: (f64, f64),
    /// The reference, as this detector sees it.
    pub reference: RawSpectrum,
    /// Signal that the detector sees of the reference's setup without light.
    pub reference_dark: Option<RawSpectrum>,
}

/// Recording in one direction.
#[derive(Debug, Clone, PartialEq)]
pub struct Direction {
    /// θ_i, φ_i, θ_o, φ_o in degrees.
    pub angles_deg: [f64; 4],
    /// Factor that the signal is multiplied by (a filter in the reference's way, another exposure).
    pub scale: f64,
    /// For each channel, signal and dark; none where it was not recorded.
    pub signal: Vec<Option<(RawSpectrum, Option<RawSpectrum>)>>,
}

/// How spectra become values.
#[derive(Debug, Clone, PartialEq)]
pub struct IngestOptions {
    /// Wavelengths of the result, vacuum nm, increasing.
    pub wavelength_nm: Vec<f64>,
    /// Ω_o, sr.
    pub solid_angle_sr: f64,
    /// Relative standard deviation of what all values have in common (Ω_o, the reference).
    pub scale_sigma: f64,
    /// Whether detectors are scaled to the first one in their overlap.
    pub stitch: bool,
    /// Beyond this relative difference a scale is warned of.
    pub warn_scale: f64,
    /// Beyond this relative difference swapped directions are warned of.
    pub warn_reciprocity: f64,
}

/// Why there are no values.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum IngestError {
    /// An option out of its range.
    #[error("{name}: found {found}, expected {expected}")]
    Option {
        /// The option.
        name: &'static str,
        /// Value of the option.
        found: f64,
        /// Allowed values.
        expected: &'static str,
    },
    /// A detector that sees nothing at the horizon or beyond.
    #[error(
        "direction {number} (θ_i {theta_i_deg}°, θ_o {theta_o_deg}°): both have to be less than 90° from the normal"
    )]
    Horizon {
        /// Which, from 1.
        number: usize,
        /// Angle of the light from the normal, degrees.
        theta_i_deg: f64,
        /// Angle of the detector from the normal, degrees.
        theta_o_deg: f64,
    },
    /// A reference without light.
    #[error(
        "{channel}: the reference less its dark signal is {value:e} at {nm:.1} nm, expected light: narrow range_nm"
    )]
    Dark {
        /// Which detector.
        channel: String,
        /// At which wavelength.
        nm: f64,
        /// Light that is left of the reference less its dark signal.
        value: f64,
    },
    /// Detectors that do not meet.
    #[error(
        "direction {number}: {first} and {second} share fewer than two wavelengths of the result: nothing to scale by (stitch = false joins them as they are)"
    )]
    NoOverlap {
        /// Which direction, from 1.
        number: usize,
        /// A detector.
        first: String,
        /// The next.
        second: String,
    },
    /// An overlap without light.
    #[error(
        "direction {number}: {first} and {second} have no light in common in their overlap, from {from_nm:.1} to {to_nm:.1} nm"
    )]
    DarkOverlap {
        /// Which direction, from 1.
        number: usize,
        /// A detector.
        first: String,
        /// The next.
        second: String,
        /// Where the overlap begins.
        from_nm: f64,
        /// Where it ends.
        to_nm: f64,
    },
}

/// How one detector was scaled to the one before.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Seam {
    /// The direction, from 1.
    pub direction: usize,
    /// The detector that was scaled.
    pub channel: String,
    /// By which factor.
    pub scale: f64,
    /// Standard deviation of the factor.
    pub sigma: f64,
    /// Wavelengths in the overlap.
    pub wavelengths: usize,
}

/// Two directions with light and detector swapped.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Pair {
    /// Which directions, from 1.
    pub directions: [usize; 2],
    /// The median over the wavelengths of f(i, o)/f(o, i).
    pub ratio: f64,
    /// Standard deviation of the ratio by noise and seams.
    pub sigma: f64,
}

/// Directions that were measured more than once: one value is made of them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Repeat {
    /// Which directions, from 1.
    pub directions: Vec<usize>,
    /// The root mean square over the wavelengths of how far they lie about their mean, relative; a single value's, not the mean's.
    pub scatter: f64,
    /// Scatter to be expected from the noise of the values.
    pub expected: f64,
}

/// Values with what was found on the way.
#[derive(Debug, Clone, PartialEq)]
pub struct Ingested {
    /// The values.
    pub samples: Samples,
    /// Scales of detectors.
    pub seams: Vec<Seam>,
    /// Swapped directions.
    pub pairs: Vec<Pair>,
    /// Directions that were measured more than once.
    pub repeats: Vec<Repeat>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// Values of one channel on the result's wavelengths.
struct Piece {
    value: Vec<f64>,
    sigma: Vec<f64>,
}

/// Turns spectra into values.
///
/// # Errors
/// Options out of range, directions at the horizon, references without light, detectors without overlap.
pub fn ingest(
    channels: &[Channel],
    reference: &Reference,
    directions: &[Direction],
    options: &IngestOptions,
) -> Result<Ingested, IngestError> {
    check(reference, options)?;
    let nm = &options.wavelength_nm;
    let onto = Onto::new(nm);
    let standard: Vec<f64> = onto.values(&reference.reflectance).0;
    let mut beams = Vec::new();
    for channel in channels {
        beams.push(beam(channel, &onto, nm)?);
    }
    let (mut rows, mut seams) = (Vec::new(), Vec::new());
    let mut warnings = flat_tops(channels, directions);
    for (d, direction) in directions.iter().enumerate() {
        let [theta_i_deg, phi_i_deg, theta_o_deg, phi_o_deg] = direction.angles_deg;
        if theta_i_deg.abs() >= 90.0 || theta_o_deg.abs() >= 90.0 {
            return Err(IngestError::Horizon { number: d + 1, theta_i_deg, theta_o_deg });
        }
        let cos = theta_o_deg.to_radians().cos();
        let known = match reference.kind {
            ReferenceKind::Mirror => 1.0 / (options.solid_angle_sr * cos),
            ReferenceKind::Lambert => {
                reference.theta_o_deg.to_radians().cos() / (std::f64::consts::PI * cos)
            }
        };
        let mut pieces = Vec::new();
        for ((channel, beam), signal) in channels.iter().zip(&beams).zip(&direction.signal) {
            let Some((signal, dark)) = signal else { continue };
            let mut piece = onto_range(&onto, signal, channel.range_nm, nm);
            if let Some(dark) = dark {
                piece.subtract(&onto_range(&onto, dark, channel.range_nm, nm));
            }
            for (k, standard) in standard.iter().enumerate() {
                let factor = direction.scale * standard * known;
                let ratio = piece.value[k] / beam.value[k];
                let noise =
                    (piece.sigma[k] / beam.value[k]).hypot(ratio * beam.sigma[k] / beam.value[k]);
                (piece.value[k], piece.sigma[k]) = (factor * ratio, factor * noise);
            }
            let to_part = options.solid_angle_sr * cos;
            if let Some(excess) = excess(&piece, to_part, options) {
                let name = name_of(signal, || format!("direction {}, {}", d + 1, channel.name));
                warnings.push(format!("{name}: {excess}"));
            }
            pieces.push((channel.name.clone(), piece));
        }
        let (value, sigma) = join(d + 1, pieces, options, &mut seams)?;
        if let Some(k) = value.iter().position(|v| v.is_nan()) {
            let count = value.iter().filter(|v| v.is_nan()).count();
            warnings.push(format!(
                "direction {}: {count} of {} wavelengths have no data, the first {} nm",
                d + 1,
                nm.len(),
                nm[k]
            ));
        }
        rows.push(Sample {
            theta_i_deg,
            phi_i_deg,
            theta_o_deg,
            phi_o_deg,
            brdf_per_sr: value,
            sigma_per_sr: sigma,
        });
    }
    for seam in &seams {
        let off = (seam.scale - 1.0).abs();
        if off > options.warn_scale && off > 3.0 * seam.sigma {
            warnings.push(format!(
                "direction {}: {} was scaled by {:.4} ± {:.4} to meet the detector before it",
                seam.direction, seam.channel, seam.scale, seam.sigma
            ));
        }
    }
    let (rows, numbers, repeats) = repeat::merged(rows);
    for repeat in &repeats {
        warnings.push(repeat.to_string());
    }
    let samples = Samples { wavelength_nm: nm.clone(), rows, meta: Meta::new() };
    let pairs = pairs(&samples, &numbers);
    for pair in &pairs {
        let off = (pair.ratio - 1.0).abs();
        if off > options.warn_reciprocity && off > 3.0 * pair.sigma {
            warnings.push(format!(
                "directions {} and {} are swapped and differ by a factor of {:.4} ± {:.4}",
                pair.directions[0], pair.directions[1], pair.ratio, pair.sigma
            ));
        }
    }
    let mut meta = Meta::new();
    meta.insert("solid_angle_sr".into(), json!(options.solid_angle_sr));
    meta.insert("scale_sigma".into(), json!(options.scale_sigma));
    meta.insert("reference".into(), json!(reference.kind));
    meta.insert("seams".into(), json!(seams));
    meta.insert("reciprocity".into(), json!(pairs));
    meta.insert("repeats".into(), json!(repeats));
    let samples = Samples { meta, ..samples };
    Ok(Ingested { samples, seams, pairs, repeats, warnings })
}

/// The file of a spectrum, or what it is.
fn name_of(spectrum: &RawSpectrum, other: impl FnOnce() -> String) -> String {
    spectrum.file.clone().unwrap_or_else(other)
}

/// Warnings of spectra in which a detector was at its end, each once.
fn flat_tops(channels: &[Channel], directions: &[Direction]) -> Vec<String> {
    let mut said: Vec<String> = Vec::new();
    let mut look = |spectrum: &RawSpectrum, what: String| {
        if let Some(top) = spectrum.flat_top() {
            let warning = format!("{}: {top}", name_of(spectrum, || what));
            if !said.contains(&warning) {
                said.push(warning);
            }
        }
    };
    for channel in channels {
        look(&channel.reference, format!("reference, {}", channel.name));
    }
    for (d, direction) in directions.iter().enumerate() {
        for (channel, signal) in channels.iter().zip(&direction.signal) {
            if let Some((signal, _)) = signal {
                look(signal, format!("direction {}, {}", d + 1, channel.name));
            }
        }
    }
    said
}

/// The wavelength at which a direction has the most light beyond what came in, by more than its noise. `to_part` makes part of the incident light of f.
fn excess(piece: &Piece, to_part: f64, options: &IngestOptions) -> Option<String> {
    const SIGMAS: f64 = 3.0;
    let part = |k: usize| {
        let part = piece.value[k] * to_part;
        (part, SIGMAS * (piece.sigma[k] * to_part).hypot(options.scale_sigma * part))
    };
    let beyond = |k: &usize| part(*k).0 - part(*k).1 > 1.0 + 1e-9;
    let all: Vec<usize> = (0..piece.value.len()).filter(beyond).collect();
    let most = all.iter().copied().max_by(|j, k| part(*j).0.total_cmp(&part(*k).0))?;
    Some(format!(
        "{:.4} times the light of the whole beam at {} nm, and more than it at {} of {} wavelengths: look at saturation, exposures (scale), the dark signal and which file is the reference",
        part(most).0,
        options.wavelength_nm[most],
        all.len(),
        options.wavelength_nm.len()
    ))
}

fn check(reference: &Reference, options: &IngestOptions) -> Result<(), IngestError> {
    let wrong = |name, found, expected| Err(IngestError::Option { name, found, expected });
    let nm = &options.wavelength_nm;
    if nm.is_empty()
        || nm.windows(2).any(|w| w[0] >= w[1])
        || nm.iter().any(|v| *v <= 1.0 || !v.is_finite())
    {
        return wrong("wavelength_nm", nm.len() as f64, "wavelengths in nm that increase");
    }
    if !(options.solid_angle_sr > 0.0 && options.solid_angle_sr < 6.3) {
        return wrong("solid_angle_sr", options.solid_angle_sr, "above 0 and below 2π");
    }
    if !(0.0..1.0).contains(&options.scale_sigma) {
        return wrong("scale_sigma", options.scale_sigma, "from 0 to below 1");
    }
    let y = &reference.reflectance.y;
    if let Some(r) = y.iter().find(|r| !(**r > 0.0 && **r <= 1.1)) {
        return wrong("the reference's reflectance", *r, "above 0 and at most 1.1");
    }
    if !(0.0..90.0).contains(&reference.theta_o_deg) {
        return wrong("the reference's theta_o_deg", reference.theta_o_deg, "from 0 to below 90°");
    }
    Ok(())
}

impl Piece {
    fn subtract(&mut self, other: &Self) {
        for k in 0..self.value.len() {
            self.value[k] -= other.value[k];
            self.sigma[k] = self.sigma[k].hypot(other.sigma[k]);
        }
    }
}

fn onto_range(onto: &Onto<'_>, raw: &RawSpectrum, range: (f64, f64), nm: &[f64]) -> Piece {
    let (mut value, mut sigma) = onto.values(raw);
    for k in 0..nm.len() {
        if !(range.0..=range.1).contains(&nm[k]) {
            (value[k], sigma[k]) = (f64::NAN, f64::NAN);
        }
    }
    Piece { value, sigma }
}

/// The reference less its dark signal.
fn beam(channel: &Channel, onto: &Onto<'_>, nm: &[f64]) -> Result<Piece, IngestError> {
    let mut piece = onto_range(onto, &channel.reference, channel.range_nm, nm);
    if let Some(dark) = &channel.reference_dark {
        piece.subtract(&onto_range(onto, dark, channel.range_nm, nm));
    }
    match piece.value.iter().position(|v| *v <= 0.0) {
        Some(k) => Err(IngestError::Dark {
            channel: channel.name.clone(),
            nm: nm[k],
            value: piece.value[k],
        }),
        None => Ok(piece),
    }
}

/// Joins detectors: the next is scaled to those before in the overlap, where both are then mixed by their uncertainties.
fn join(
    number: usize,
    pieces: Vec<(String, Piece)>,
    options: &IngestOptions,
    seams: &mut Vec<Seam>,
) -> Result<(Vec<f64>, Vec<f64>), IngestError> {
    let nm = &options.wavelength_nm;
    let none = || vec![f64::NAN; nm.len()];
    let mut pieces = pieces.into_iter();
    let Some((mut first, mut all)) = pieces.next() else { return Ok((none(), none())) };
    for (second, mut piece) in pieces {
        let shared: Vec<usize> = (0..nm.len())
            .filter(|k| all.value[*k].is_finite() && piece.value[*k].is_finite())
            .collect();
        if options.stitch {
            if shared.len() < 2 {
                return Err(IngestError::NoOverlap { number, first, second });
            }
            let (scale, sigma) =
                ratio(&all, &piece, &shared).ok_or_else(|| IngestError::DarkOverlap {
                    number,
                    first: first.clone(),
                    second: second.clone(),
                    from_nm: nm[shared[0]],
                    to_nm: nm[shared[shared.len() - 1]],
                })?;
            for k in 0..nm.len() {
                piece.value[k] *= scale;
                piece.sigma[k] = (piece.sigma[k] * scale).hypot(piece.value[k] * sigma / scale);
            }
            let wavelengths = shared.len();
            seams.push(Seam {
                direction: number,
                channel: second.clone(),
                scale,
                sigma,
                wavelengths,
            });
        }
        let (from, to) = match (shared.first(), shared.last()) {
            (Some(a), Some(b)) => (nm[*a], nm[*b]),
            _ => (0.0, 0.0),
        };
        // Towards longer wavelengths the one that goes further takes over.
        let rising = last_finite(&piece.value) >= last_finite(&all.value);
        for (k, nm) in nm.iter().enumerate() {
            if all.value[k].is_nan() {
                (all.value[k], all.sigma[k]) = (piece.value[k], piece.sigma[k]);
            } else if piece.value[k].is_finite() {
                let t = if to > from { (nm - from) / (to - from) } else { 0.5 };
                let t = if rising { t } else { 1.0 - t };
                all.value[k] += t * (piece.value[k] - all.value[k]);
                all.sigma[k] = ((1.0 - t) * all.sigma[k]).hypot(t * piece.sigma[k]);
            }
        }
        first = second;
    }
    Ok((all.value, all.sigma))
}

fn last_finite(values: &[f64]) -> usize {
    values.iter().rposition(|v| v.is_finite()).unwrap_or(0)
}

/// Σ w a b/Σ w b² over the overlap, and its standard deviation from the scatter about it (or from the noise, where that is more).
fn ratio(a: &Piece, b: &Piece, shared: &[usize]) -> Option<(f64, f64)> {
    let weight = |k: usize, scale: f64| {
        let variance = a.sigma[k].powi(2) + (scale * b.sigma[k]).powi(2);
        if variance > 0.0 { 1.0 / variance } else { 1.0 }
    };
    let mut scale = 1.0;
    for _ in 0..4 {
        let (mut up, mut down) = (0.0, 0.0);
        for k in shared {
            let w = weight(*k, scale);
            up += w * a.value[*k] * b.value[*k];
            down += w * b.value[*k].powi(2);
        }
        scale = up / down;
        if !(scale.is_finite() && scale > 0.0) {
            return None;
        }
    }
    let (mut square, mut down) = (0.0, 0.0);
    for k in shared {
        let w = weight(*k, scale);
        square += w * (a.value[*k] - scale * b.value[*k]).powi(2);
        down += w * b.value[*k].powi(2);
    }
    let known = shared.iter().all(|k| a.sigma[*k] + b.sigma[*k] > 0.0);
    let scatter = square / (shared.len() - 1) as f64;
    let sigma = (if known { scatter.max(1.0) } else { scatter } / down).sqrt();
    Some((scale, sigma))
}

/// Finds pairs with light and detector swapped. If a sample was lit from one azimuth only, the azimuth between light and detector decides. `numbers` are those of the rows' directions.
fn pairs(samples: &Samples, numbers: &[usize]) -> Vec<Pair> {
    let rows = &samples.rows;
    let anisotropic = samples.has_azimuths();
    let place = |i: DVec3, o: DVec3| {
        let (i, o) = if anisotropic { (i, o) } else { turned(i, o) };
        (i, if anisotropic { o } else { DVec3::new(o.x, o.y.abs(), o.z) })
    };
    let mut found = Vec::new();
    for (a, row) in rows.iter().enumerate() {
        let (i, o) = row.directions();
        let swapped = place(o, i);
        for (b, other) in rows.iter().enumerate().skip(a + 1) {
            let (j, p) = other.directions();
            let (j, p) = place(j, p);
            if (swapped.0 - j).length() > 2e-3 || (swapped.1 - p).length() > 2e-3 {
                continue;
            }
            let mut ratios: Vec<(f64, f64)> = row
                .brdf_per_sr
                .iter()
                .zip(&other.brdf_per_sr)
                .zip(row.sigma_per_sr.iter().zip(&other.sigma_per_sr))
                .filter(|((x, y), _)| **x > 0.0 && **y > 0.0)
                .map(|((x, y), (s, t))| (x / y, (s / x).hypot(t / y)))
                .collect();
            ratios.sort_by(|x, y| x.0.total_cmp(&y.0));
            if let Some((ratio, _)) = ratios.get(ratios.len() / 2) {
                let n = ratios.len() as f64;
                // The median's, and what all wavelengths have in common is not less than the largest of them over √n.
                let mean = ratios.iter().map(|r| r.1 * r.1).sum::<f64>() / n;
                let sigma = ratio * 1.2533 * (mean / n).sqrt();
                found.push(Pair { directions: [numbers[a], numbers[b]], ratio: *ratio, sigma });
            }
        }
    }
    found
}
