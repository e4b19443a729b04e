//! How much of the light of a curve comes from which material.

mod confusion;
mod materials;

pub use confusion::{MaterialConfusion, MaterialConfusionError};
pub use materials::{Materials, MaterialsError};

use crate::lit_curve::{LitCurve, first_zenith, views};
use hifitime::Epoch;
use sunglint_analysis::samples::SamplesError;
use sunglint_analysis::unmix::nnls::Constraint;
use sunglint_analysis::unmix::{
    Bands, Mixing, MixingError, UnmixError, Unmixed, concerns, reasons, unmix,
};
use sunglint_radiometry::air::AirError;
use sunglint_radiometry::light_curve::Input;

/// Light of materials that are no endmembers is warned of above this share.
const MOST_OTHERS: f64 = 1e-3;

/// Why a curve cannot be unmixed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UnmixCurveError {
    /// Samples that cannot be used.
    #[error(transparent)]
    Samples(#[from] SamplesError),
    /// An air without an answer.
    #[error(transparent)]
    Air(#[from] AirError),
    /// Endmembers that tell nothing.
    #[error(transparent)]
    Mixing(#[from] MixingError),
    /// A sample that cannot be unmixed.
    #[error(transparent)]
    Unmix(#[from] UnmixError),
    /// A scene that the shares cannot be held against.
    #[error(transparent)]
    Confusion(#[from] MaterialConfusionError),
    /// No sample has weights.
    #[error("{file}: no sample can be unmixed: {reasons}")]
    NoSample {
        /// The file.
        file: String,
        /// Why not, with numbers of samples.
        reasons: String,
        /// Warnings about the curve and the materials, for the user.
        warnings: Vec<String>,
    },
}

/// How a curve is unmixed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnmixOptions {
    /// Constraint on the sum of the weights.
    pub constraint: Constraint,
    /// All bands count alike, whatever their uncertainties.
    pub unweighted: bool,
    /// The shares are held against those of the scene's own light; the endmembers have to be materials of its target.
    pub confusion: bool,
}

impl Default for UnmixOptions {
    fn default() -> Self {
        Self { constraint: Constraint::Free, unweighted: false, confusion: false }
    }
}

/// A curve, unmixed.
#[derive(Debug, Clone)]
pub struct UnmixedCurve {
    /// The target's name.
    pub target: String,
    /// Times of the samples.
    pub time: Vec<Epoch>,
    /// The bands of the curve with the endmembers.
    pub bands: Bands,
    /// Mixing matrix of all bands together, and what it can tell apart, at the zenith angle of the first sample.
    pub mixing: Mixing,
    /// The weights, sample by sample.
    pub found: Vec<Unmixed>,
    /// Whether weights are in m² sr⁻¹.
    pub is_absolute: bool,
    /// How the materials are taken for one another, where that was asked.
    pub confusion: Option<MaterialConfusion>,
    /// Warnings about the result, for the user.
    pub warnings: Vec<String>,
    /// The files of the curve and of the materials.
    pub inputs: Vec<Input>,
}

/// Takes the light of a curve apart into that of some materials.
///
/// # Errors
/// A curve or materials that tell nothing; no sample with weights.
pub fn unmix_curve(
    given: &LitCurve,
    materials: &Materials,
    options: &UnmixOptions,
) -> Result<UnmixedCurve, UnmixCurveError> {
    let mut warnings = materials.warnings.clone();
    let bands = given.bands(&materials.endmembers)?;
    let (lights, mut values) = given.samples(&mut warnings)?;
    if options.unweighted {
        values.sigma = None;
    }
    // What all bands together can tell, before any sample: at the zenith angle of the first.
    let zenith = first_zenith(&bands, &lights);
    let mixing = Mixing::new(bands.at(zenith)?.matrix, &bands.endmembers)?;
    warnings.extend(concerns(&mixing, &bands.names, &bands.endmembers));
    warnings.extend(uncovered(&bands));
    let found = unmix(&bands, &lights, views(&values), options.constraint)?;
    let curve = given.curve();
    let confusion = match given.pass() {
        Some(pass) if options.confusion => {
            let told = MaterialConfusion::of(pass, curve, &bands.endmembers, &found)?;
            if told.others > MOST_OTHERS {
                warnings.push(format!(
                    "{:.1} % of the scene's light is of materials that are not among the endmembers: it is in no row of the confusion, and what unmixing made of it is in its columns",
                    100.0 * told.others
                ));
            }
            Some(told)
        }
        _ => None,
    };
    if found.iter().all(|u| u.mixture.is_none()) {
        let file = curve.input.file.clone();
        return Err(UnmixCurveError::NoSample { file, reasons: reasons(&found), warnings });
    }
    let mut inputs = vec![curve.input.clone()];
    inputs.extend(materials.inputs.iter().cloned());
    Ok(UnmixedCurve {
        target: curve.target().to_owned(),
        time: curve.samples().time.clone(),
        bands,
        mixing,
        found,
        is_absolute: given.is_absolute(),
        confusion,
        warnings,
        inputs,
    })
}

/// Warnings of endmembers whose tables do not cover the bands.
fn uncovered(bands: &Bands) -> Vec<String> {
    let uncovered = bands.uncovered_nm();
    let mut warnings = Vec::new();
    for (e, name) in bands.endmembers.iter().enumerate() {
        let most = uncovered.column(e).iter().copied().fold(0.0, f64::max);
        if most > 0.0 {
            warnings.push(format!(
                "{name}: for up to {most:.0} nm of a band its spectrum, sunlight or the air is not tabulated and its end was held"
            ));
        }
    }
    warnings
}
