//! Result of a fit, with everything that somebody might show of it.

use crate::measured::MeasuredCurve;
use crate::solver::spectrum::Upsampled;
use crate::solver::{Data, Fit, FittedCurve, StudyModel, Summary, airmasses, summaries};
use hifitime::Epoch;
use ndarray::Array2;
use serde::Serialize;
use serde::ser::Serializer;
use std::path::PathBuf;
use sunglint_formats::time::format_utc_shortest;
use sunglint_radiometry::light_curve::Input;
use sunglint_simulator::pass::{Averaged, Study, Thinned};

/// Edges of groups of phase angles, degrees.
const PHASE_EDGES: [f64; 7] = [0.0, 30.0, 60.0, 90.0, 120.0, 150.0, 180.0];
/// Edges of groups of airmasses.
const AIRMASS_EDGES: [f64; 6] = [1.0, 1.25, 1.6, 2.1, 3.0, 40.0];

/// Result of the fit of passes.
#[derive(Debug, Clone, Serialize)]
pub struct PassFit {
    /// The name of the first scene's file, without its extension.
    pub name: String,
    /// The first scene's file.
    pub scene_file: PathBuf,
    /// The station's name.
    pub station: String,
    /// The channels that were compared.
    pub channels: Vec<String>,
    /// The fit.
    pub fit: Fit,
    /// Value of each parameter in the scene before the fit.
    pub in_the_scene: Vec<f64>,
    /// Materials whose doubt is in the parameters' uncertainties: those that say how well they are known.
    pub doubtful_materials: Vec<String>,
    /// Residuals in groups.
    pub groups: ResidualGroups,
    /// The curves.
    pub curves: Vec<CurveFit>,
    /// Reflectance spectra of materials whose albedos were found.
    pub spectra: Vec<MaterialSpectrum>,
    /// The files that it was made of.
    pub inputs: Vec<Input>,
    /// Young's coefficient of the scintillation.
    pub scintillation: f64,
    /// Light that came by way of another part; `None` where there was none, or it is switched.
    pub bounces: Option<Bounces>,
    /// How long it took, s.
    pub seconds: f64,
    /// Warnings for the user.
    pub warnings: Vec<String>,
    /// The scenes with what was found: one for each scene, one for each curve where curves have values of their own.
    pub scenes: Vec<FittedScene>,
    /// Curves predicted by a fit of the others.
    pub predicted: Vec<Prediction>,
}

/// Curves that were left out, beside what a fit of the others says of them. What each curve has of its own (attitude, zero points) is as its scene has it.
#[derive(Debug, Clone, Serialize)]
pub struct Prediction {
    /// Curves that were left out.
    pub curves: Vec<PredictedCurve>,
    /// Whether the fit of the others converged.
    pub converged: bool,
    /// Reduced χ² of the others.
    pub reduced_chi2: f64,
    /// How long it took, s.
    pub seconds: f64,
}

/// Curve beside its prediction.
#[derive(Debug, Clone, Serialize)]
pub struct PredictedCurve {
    /// The file's name.
    pub name: String,
    /// Samples that were compared.
    pub samples: usize,
    /// Root of the mean square of measured less predicted, mag (2.5 times the decimal logarithm of rates too).
    pub rms_mag: f64,
    /// Mean of measured less predicted, mag.
    pub mean_mag: f64,
}

impl PredictedCurve {
    /// Compares measured and predicted rates of the samples that count.
    pub(super) fn new(curve: &CurveFit) -> Self {
        let pairs = curve.rate.iter().zip(&curve.model.model).zip(&curve.used);
        let apart: Vec<f64> = pairs
            .filter(|(_, used)| **used)
            .map(|((rate, model), _)| -2.5 * (rate / model).log10())
            .filter(|d| d.is_finite())
            .collect();
        let n = apart.len() as f64;
        Self {
            name: curve.name.clone(),
            samples: apart.len(),
            rms_mag: (apart.iter().map(|d| d * d).sum::<f64>() / n).sqrt(),
            mean_mag: apart.iter().sum::<f64>() / n,
        }
    }
}

/// A scene with what was found. It was read again and simulated at the measured times, and set beside the fit.
#[derive(Debug, Clone, Serialize)]
pub struct FittedScene {
    /// Name of its file, before `.fitted.toml`.
    pub name: String,
    /// The curves that it is of.
    pub curves: Vec<String>,
    /// Root of the mean square difference of its light from the fitted light, at the fitted samples: mag for magnitudes, else a part of the root mean square rate.
    pub difference: f64,
    /// Whether that is at most 1e-3: the scene is the fit.
    pub same: bool,
    /// Parameters that no key of a scene holds.
    pub incomplete: Vec<String>,
    /// The scene as text.
    #[serde(skip)]
    pub text: String,
}

/// Light that came by way of another part: computed for what was found, held, the rest fitted again, until nothing moved.
#[derive(Debug, Clone, Serialize)]
pub struct Bounces {
    /// The largest share of a sample's light, beside the light of single materials in the first round.
    pub share: f64,
    /// How often it was computed.
    pub rounds: usize,
    /// How far the last round moved a parameter, in its standard uncertainty.
    pub moved_sigmas: f64,
    /// Whether that was little enough.
    pub settled: bool,
    /// At how many epochs of each curve it was computed, and what the lines between them err by.
    pub thinned: Vec<Thinned>,
}

/// Residuals in groups.
#[derive(Debug, Clone, Serialize)]
pub struct ResidualGroups {
    /// By channel.
    pub by_channel: Vec<Summary>,
    /// By phase angle.
    pub by_phase: Vec<Summary>,
    /// By airmass.
    pub by_airmass: Vec<Summary>,
}

/// A measured curve beside the fitted one. Arrays are epochs × channels of the fit.
#[derive(Debug, Clone, Serialize)]
pub struct CurveFit {
    /// The file's name.
    pub name: String,
    /// The file.
    pub path: PathBuf,
    /// Samples that were fitted.
    pub fitted: usize,
    /// Samples that were not, and why.
    pub left_out: Vec<LeftOut>,
    /// Whether these are magnitudes: rates are then fluxes in V over that of magnitude 0, above the air.
    pub magnitudes: bool,
    /// How many samples are means over their exposures, and what the middles of the others err by.
    pub averaged: Averaged,
    /// At how many epochs light was computed, and what the lines between them err by; `None` where at all.
    pub thinned: Option<Thinned>,
    /// Tracks of magnitudes: their white noise beside what is left.
    pub tracks: Vec<MagnitudeTrack>,
    /// Times of the samples.
    #[serde(skip)]
    pub times: Vec<Epoch>,
    /// Exposures, s.
    #[serde(skip)]
    pub exposure_s: Vec<f64>,
    /// Phase angles, degrees.
    #[serde(skip)]
    pub phase_deg: Vec<f64>,
    /// True zenith angles, degrees.
    #[serde(skip)]
    pub zenith_deg: Vec<f64>,
    /// Distances, m.
    #[serde(skip)]
    pub range_m: Vec<f64>,
    /// Airmasses.
    #[serde(skip)]
    pub airmass: Vec<f64>,
    /// Measured rates.
    #[serde(skip)]
    pub rate: Array2<f64>,
    /// Their uncertainties.
    #[serde(skip)]
    pub sigma: Array2<f64>,
    /// Which were fitted.
    #[serde(skip)]
    pub used: Array2<bool>,
    /// The model's rates, their pulls, their weights.
    #[serde(skip)]
    pub model: FittedCurve,
}

/// Samples that were not fitted.
#[derive(Debug, Clone, Serialize)]
pub struct LeftOut {
    /// Why.
    pub why: String,
    /// How many.
    pub samples: usize,
}

/// A track of magnitudes.
#[derive(Debug, Clone, Serialize)]
pub struct MagnitudeTrack {
    /// First moment of the track.
    #[serde(serialize_with = "utc")]
    pub from_utc: Epoch,
    /// Samples.
    pub samples: usize,
    /// The noise of single samples by the differences between neighbours, mag.
    pub white_noise_mag: f64,
    /// Root of the mean square of measured less model, mag.
    pub rms_mag: f64,
    /// Mean of measured less model, mag.
    pub mean_mag: f64,
}

fn utc<S: Serializer>(epoch: &Epoch, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&format_utc_shortest(*epoch))
}

/// The reflectance spectrum of a material.
#[derive(Debug, Clone, Serialize)]
pub struct MaterialSpectrum {
    /// The material.
    pub material: String,
    /// Whether it was made of band albedos: one of many that have them. Else it is the file's, scaled.
    pub upsampled: bool,
    /// The spectrum.
    pub found: Upsampled,
}

impl MaterialSpectrum {
    /// A spectrum of the file's form.
    pub(super) fn scaled(material: &str, nm: &[f64], reflectance: &[f64]) -> Self {
        let n = nm.len();
        let found = Upsampled {
            wavelength_nm: nm.to_vec(),
            reflectance: reflectance.to_vec(),
            sigma: vec![f64::NAN; n],
            constrained: vec![false; n],
            bands: Vec::new(),
            band_nm: Vec::new(),
            largest_pull: 0.0,
        };
        Self { material: material.to_owned(), upsampled: false, found }
    }
}

impl PassFit {
    /// The first and the last sample's moment.
    pub fn ends(&self) -> (Epoch, Epoch) {
        let mut all = self.curves.iter().flat_map(|c| &c.times).copied();
        let first = all.next().unwrap_or_else(|| Epoch::from_tai_seconds(0.0));
        all.fold((first, first), |(a, b), t| (a.min(t), b.max(t)))
    }
}

impl CurveFit {
    pub(super) fn new(
        measured: &MeasuredCurve,
        study: &Study,
        data: &Data,
        model: &FittedCurve,
        left_out: Vec<(String, usize)>,
        averaged: Averaged,
        thinned: Option<Thinned>,
    ) -> Self {
        let places = study.places();
        // Of magnitudes the data are what their noise leaves in the mean; people look at what was measured.
        let rate = if measured.magnitudes { &measured.rate } else { &data.rate };
        let tracks = measured.tracks.iter().map(|(from, noise, samples)| {
            let start = measured.times.iter().position(|t| t == from).unwrap_or(0);
            let within = start..(start + samples).min(measured.times.len());
            let left: Vec<f64> = within
                .filter(|i| data.used[[*i, 0]] && rate[[*i, 0]] > 0.0)
                .map(|i| -2.5 * (rate[[i, 0]] / model.model[[i, 0]]).log10())
                .filter(|d| d.is_finite())
                .collect();
            let n = left.len() as f64;
            MagnitudeTrack {
                from_utc: *from,
                samples: left.len(),
                white_noise_mag: *noise,
                rms_mag: (left.iter().map(|d| d * d).sum::<f64>() / n).sqrt(),
                mean_mag: left.iter().sum::<f64>() / n,
            }
        });
        Self {
            name: measured.name(),
            path: measured.path.clone(),
            fitted: data.count(),
            left_out: left_out.into_iter().map(|(why, samples)| LeftOut { why, samples }).collect(),
            magnitudes: measured.magnitudes,
            averaged,
            thinned,
            tracks: tracks.collect(),
            times: measured.times.clone(),
            exposure_s: measured.exposure_s.clone(),
            phase_deg: places.iter().map(|p| p.geometry.phase_rad.to_degrees()).collect(),
            zenith_deg: places.iter().map(|p| p.geometry.zenith_deg()).collect(),
            range_m: places.iter().map(|p| p.geometry.range_m).collect(),
            airmass: airmasses(study),
            rate: rate.clone(),
            sigma: data.sigma.clone(),
            used: data.used.clone(),
            model: model.clone(),
        }
    }
}

/// Residuals by channel, phase angle and airmass.
pub(super) fn groups(
    data: &[Data],
    fit: &Fit,
    model: &StudyModel,
    channels: &[String],
) -> ResidualGroups {
    let of = |edges: &[f64], value: f64| {
        let k = edges.partition_point(|e| *e <= value);
        (k > 0 && k < edges.len()).then(|| k - 1)
    };
    let names = |edges: &[f64], unit: &str| -> Vec<String> {
        edges.windows(2).map(|e| format!("{} to {}{unit}", e[0], e[1])).collect()
    };
    let phases: Vec<Vec<f64>> = (0..data.len())
        .map(|k| {
            let places = model.study(k).map(Study::places).unwrap_or_default();
            places.iter().map(|p| p.geometry.phase_rad.to_degrees()).collect()
        })
        .collect();
    let air: Vec<Vec<f64>> =
        (0..data.len()).map(|k| model.study(k).map(airmasses).unwrap_or_default()).collect();
    ResidualGroups {
        by_channel: summaries(data, fit, channels, &|_, _, c| Some(c)),
        by_phase: summaries(data, fit, &names(&PHASE_EDGES, "°"), &|p, i, _| {
            of(&PHASE_EDGES, *phases.get(p)?.get(i)?)
        }),
        by_airmass: summaries(data, fit, &names(&AIRMASS_EDGES, ""), &|p, i, _| {
            of(&AIRMASS_EDGES, air.get(p)?.get(i)?.max(1.0))
        }),
    }
}
