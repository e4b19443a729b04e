//! The spectra that a curve is made of, nobody having said which.

use crate::lit_curve::{LitCurve, first_zenith, views};
use crate::unmix::Materials;
use hifitime::Epoch;
use ndarray::{Array2, s};
use sunglint_analysis::samples::SamplesError;
use sunglint_analysis::unmix::nnls::Constraint;
use sunglint_analysis::unmix::{
    AtgpError, AtgpOptions, Endmember, Targets, UnmixError, Unmixed, atgp, spectral_angle_rad,
    unmix,
};
use sunglint_radiometry::air::AirError;
use sunglint_radiometry::light_curve::Input;
use sunglint_radiometry::spectrum::SpectrumError;
use sunglint_simulator::surface::Material;

/// Length of the noise that remains of a sample, over its own standard uncertainty, as it occurs now and then among thousands of samples.
const NOISE: f64 = 1.5;
/// Samples with less light than this of the brightest have no colour to speak of.
const FAINT: f64 = 1e-3;
/// Nor have those that are so many times as noisy as most.
const NOISIER: f64 = 2.0;
/// Warning that a curve does not say how noisy it is.
pub const NO_UNCERTAINTIES: &str =
    "the curve has no uncertainties: every ripple counts as a material of its own";

/// Why no endmembers were found.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EndmembersError {
    /// A level of noise that is none.
    #[error("the noise is {0}, expected a share from 0 to below 1")]
    Noise(f64),
    /// The white material is not there.
    #[error("the built-in material white")]
    White,
    /// The white material has no colour.
    #[error(transparent)]
    Spectrum(#[from] SpectrumError),
    /// Samples that cannot be used.
    #[error(transparent)]
    Samples(#[from] SamplesError),
    /// A sample that has no reflection factors.
    #[error(transparent)]
    Unmix(#[from] UnmixError),
    /// An air without an answer.
    #[error(transparent)]
    Air(#[from] AirError),
    /// No sample has light in all bands.
    #[error("{file}: no sample has a valid value in each of its {bands} bands: nothing to search")]
    NoSample {
        /// The file.
        file: String,
        /// The bands.
        bands: usize,
    },
    /// Noise as large as the light.
    #[error(
        "{file}: the samples' own uncertainties are as large as their light: nothing stands out"
    )]
    Noisy {
        /// The file.
        file: String,
    },
    /// The search has no answer.
    #[error("{file}")]
    Search {
        /// The file.
        file: String,
        /// Why not.
        source: AtgpError,
    },
}

/// How endmembers are looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EndmemberOptions {
    /// Largest number of endmembers.
    pub most: usize,
    /// Part of a sample that is taken for noise, as a share of it; `None`: by the curve's own uncertainties.
    pub noise: Option<f64>,
}

impl Default for EndmemberOptions {
    fn default() -> Self {
        Self { most: AtgpOptions::default().most, noise: None }
    }
}

/// Endmembers of a curve.
#[derive(Debug, Clone)]
pub struct FoundEndmembers {
    /// The target's name.
    pub target: String,
    /// The curve's file.
    pub input: Input,
    /// Middle of each band, vacuum nm; bands in their order.
    pub middles_nm: Vec<f64>,
    /// Names of the bands.
    pub bands: Vec<String>,
    /// Samples that were found as endmembers.
    pub targets: Targets,
    /// Times of the samples that were searched, the rows that [`FoundEndmembers::targets`] counts.
    pub time: Vec<Epoch>,
    /// The part of a sample that was taken for noise.
    pub noise: f64,
    /// Names of the known materials.
    pub known: Vec<String>,
    /// Reflection factors of the known ones, bands × known.
    pub factors: Array2<f64>,
    /// Warnings about the result, for the user.
    pub warnings: Vec<String>,
}

/// Looks for the endmembers of a curve, and for each the nearest in colour of some known materials.
///
/// # Errors
/// A curve without a sample that has light in all bands; noise as large as the light.
pub fn find_endmembers(
    given: &LitCurve,
    known: &Materials,
    options: &EndmemberOptions,
) -> Result<FoundEndmembers, EndmembersError> {
    if let Some(noise) = options.noise.filter(|noise| !(0.0..1.0).contains(noise)) {
        return Err(EndmembersError::Noise(noise));
    }
    let mut warnings = known.warnings.clone();
    // A white one alone gives the reflection factors; known ones are only compared with.
    let white = Material::built_in("white").ok_or(EndmembersError::White)?;
    let white = Endmember { name: white.name.clone(), reflectance: white.normal_colour()?.0 };
    let all: Vec<Endmember> =
        std::iter::once(white).chain(known.endmembers.iter().cloned()).collect();
    let bands = given.bands(&all)?;
    let (lights, values) = given.samples(&mut warnings)?;
    let only_white = given.bands(&all[..1])?;
    let found = unmix(&only_white, &lights, views(&values), Constraint::Free)?;
    let count = bands.names.len();
    let file = || given.curve().input.file.clone();
    let whole = whole(&found, &mut warnings);
    if whole.is_empty() {
        return Err(EndmembersError::NoSample { file: file(), bands: count });
    }
    let samples = clear(&found, whole, &mut warnings);
    let by_sigmas = NOISE
        * samples
            .iter()
            .map(|k| noise_of(&found[*k]))
            .filter(|n| n.is_finite())
            .fold(0.0, f64::max);
    let noise = options.noise.unwrap_or(by_sigmas);
    if samples.is_empty() || noise >= 1.0 {
        return Err(EndmembersError::Noisy { file: file() });
    }
    // Each made as bright as any other: then all are means of the materials' own colours, with weights that add up to one, and the ones at the ends are pure if any are. As bright as it
    // was, a sample that shows much of several materials would come first.
    let sum = |k: usize| found[k].factors.iter().sum::<f64>();
    let searched = Array2::from_shape_fn((samples.len(), count), |(i, b)| {
        found[samples[i]].factors[b] / sum(samples[i])
    });
    let search = AtgpOptions { most: options.most, noise, ..AtgpOptions::default() };
    let targets = atgp(searched.view(), &search)
        .map_err(|source| EndmembersError::Search { file: file(), source })?;
    if by_sigmas == 0.0 && options.noise.is_none() {
        warnings.push(NO_UNCERTAINTIES.into());
    }
    let factors = bands.at(first_zenith(&bands, &lights))?.matrix;
    let time = &given.curve().samples().time;
    Ok(FoundEndmembers {
        target: given.curve().target().to_owned(),
        input: given.curve().input.clone(),
        middles_nm: given.middles_nm()?,
        bands: bands.names.clone(),
        targets,
        time: samples.iter().map(|k| time[*k]).collect(),
        noise,
        known: bands.endmembers[1..].to_vec(),
        factors: factors.slice(s![.., 1..]).to_owned(),
        warnings,
    })
}

fn length(values: &[f64]) -> f64 {
    values.iter().map(|v| v * v).sum::<f64>().sqrt()
}

/// The part of a sample that is noise.
fn noise_of(sample: &Unmixed) -> f64 {
    length(&sample.factor_sigma) / length(&sample.factors)
}

/// The samples with a value in each band.
fn whole(found: &[Unmixed], warnings: &mut Vec<String>) -> Vec<usize> {
    let whole = |k: &usize| found[*k].factors.iter().all(|f| f.is_finite());
    let samples: Vec<usize> = (0..found.len()).filter(whole).collect();
    if samples.len() < found.len() {
        let left = found.len() - samples.len();
        warnings.push(format!("{left} samples without a valid value in each band are left out"));
    }
    samples
}

/// The samples whose colour is known well enough: neither faint nor much noisier than most.
fn clear(found: &[Unmixed], samples: Vec<usize>, warnings: &mut Vec<String>) -> Vec<usize> {
    let brightest = samples.iter().map(|k| length(&found[*k].factors)).fold(0.0, f64::max);
    let mut parts: Vec<f64> =
        samples.iter().map(|k| noise_of(&found[*k])).filter(|n| n.is_finite()).collect();
    parts.sort_by(f64::total_cmp);
    let usual = parts.get(parts.len() / 2).copied().unwrap_or(0.0);
    let before = samples.len();
    let samples: Vec<usize> = samples
        .into_iter()
        .filter(|k| length(&found[*k].factors) > FAINT * brightest)
        .filter(|k| usual == 0.0 || noise_of(&found[*k]) <= NOISIER * usual)
        .collect();
    if samples.len() < before {
        warnings.push(format!(
            "{} samples are left out, fainter than {FAINT} of the brightest or more than {NOISIER} times as noisy as most",
            before - samples.len()
        ));
    }
    samples
}

impl FoundEndmembers {
    /// Number of endmembers.
    pub fn count(&self) -> usize {
        self.targets.targets.len()
    }

    /// The spectrum of an endmember, its largest value 1: how much of a sample it was, one curve cannot say.
    pub fn spectrum(&self, k: usize) -> Vec<f64> {
        let spectrum = &self.targets.targets[k].spectrum;
        let most = spectrum.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        spectrum.iter().map(|v| v / most).collect()
    }

    /// The known material that is nearest in colour, and by which angle, radians.
    pub fn nearest(&self, k: usize) -> Option<(&str, f64)> {
        let own = &self.targets.targets[k].spectrum;
        let angles =
            self.factors.columns().into_iter().map(|c| spectral_angle_rad(own, &c.to_vec()));
        let named = self.known.iter().zip(angles);
        named.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(name, angle)| (name.as_str(), angle))
    }

    /// Reflection factors of a known material in the scale of an endmember's spectrum, by least squares.
    pub fn scaled(&self, known: usize, k: usize) -> Vec<f64> {
        let own = self.spectrum(k);
        let known = self.factors.column(known).to_vec();
        let scale = known.iter().zip(&own).map(|(a, b)| a * b).sum::<f64>()
            / known.iter().map(|a| a * a).sum::<f64>();
        known.iter().map(|v| scale * v).collect()
    }

    /// The time of the sample that an endmember is; `None` for one that is no sample.
    pub fn time_of(&self, k: usize) -> Option<Epoch> {
        self.targets.targets[k].sample.map(|row| self.time[row])
    }

    /// The bands by wavelength.
    pub fn order(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.middles_nm.len()).collect();
        order.sort_by(|a, b| self.middles_nm[*a].total_cmp(&self.middles_nm[*b]));
        order
    }
}
