//! A measured curve: calibrated rates of this program's schema, or published magnitudes.

use super::MeasuredError;
use crate::solver::CalibrationError;
use hifitime::Epoch;
use ndarray::Array2;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use sunglint_formats::text::counted;
use sunglint_radiometry::light_curve::TOLERATED;
use sunglint_radiometry::light_curve::published::{Brightness, CurveFile, MagnitudeOptions};
use sunglint_radiometry::light_curve::{Flags, LightCurve, RateKind};

/// Why a sample is left out whose uncertainty is 0.
pub(super) const NO_SIGMA: &str = "uncertainty 0";

/// A measured curve, ready to be fitted.
#[derive(Debug, Clone)]
pub struct MeasuredCurve {
    /// File of the curve.
    pub path: PathBuf,
    /// Times of its samples.
    pub times: Vec<Epoch>,
    /// Exposures, s.
    pub exposure_s: Vec<f64>,
    /// Names of its channels; the band of magnitudes.
    pub channels: Vec<String>,
    /// Rates, Hz, epochs × channels; of magnitudes fluxes over that of magnitude 0.
    pub rate: Array2<f64>,
    /// Their standard uncertainties.
    pub sigma: Array2<f64>,
    /// Part of the uncertainties that all samples of a channel have in common, where the file says it.
    pub level: Option<Array2<f64>>,
    /// Uncertainties as shares of the light, of magnitudes alone.
    pub share: Option<Array2<f64>>,
    /// Whether the file says the exposures; else they are the usual step.
    pub is_exposure_known: bool,
    /// Which count.
    pub used: Array2<bool>,
    /// How many were left out of each channel, and why.
    pub left_out: Vec<BTreeMap<String, usize>>,
    /// Error of the calibration, where it is known.
    pub calibration: Option<CalibrationError>,
    /// Whether these are magnitudes.
    pub magnitudes: bool,
    /// White noise of each track of magnitudes, mag: first moment, noise, samples.
    pub tracks: Vec<(Epoch, f64, usize)>,
    /// Camera of each sample, of an instrument that has several.
    pub cameras: Option<Vec<String>>,
    /// Place of each sample in its file, from 0: samples are in the order of time.
    pub file_rows: Vec<usize>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

impl MeasuredCurve {
    /// Reads a curve: rates of the schema, or magnitudes, read as `options` say.
    ///
    /// # Errors
    /// A file that is neither; rates that are not calibrated; no sample.
    pub fn read(path: &Path, options: &MagnitudeOptions) -> Result<Self, MeasuredError> {
        let bytes = sunglint_formats::read::bytes(path)?;
        match CurveFile::read(path, bytes, options)? {
            CurveFile::Rates(table) => {
                let mut curve = LightCurve::from_table(path, &table)?;
                // Of a channel that has none at all [`Self::silent`] tells.
                let all = |w: &String| {
                    !curve.channels.iter().any(|c| {
                        w.starts_with(&format!("{}_sigma_hz", c.name))
                            && c.sigma_hz.iter().all(|s| *s == 0.0)
                    })
                };
                let unsure = curve.without_sigma().into_iter().filter(all).collect::<Vec<_>>();
                let unsure =
                    unsure.into_iter().map(|w| format!("{}: {w} and is left out", path.display()));
                curve.sort();
                let doubled = curve.drop_doubled();
                let mut read = Self::of_curve(path, &curve, doubled)?;
                read.warnings.extend(unsure);
                Ok(read)
            }
            CurveFile::Magnitudes(brightness) if brightness.is_relative => {
                Err(MeasuredError::Relative { path: path.to_path_buf() })
            }
            CurveFile::Magnitudes(brightness) => Ok(Self::of_magnitudes(path, &brightness)),
        }
    }

    fn of_magnitudes(path: &Path, curve: &Brightness) -> Self {
        let shape = (curve.times.len(), 1);
        let of_v = super::of_v(curve.labels.as_deref());
        let in_v = |i: usize| of_v.used.get(i).copied().unwrap_or(true);
        let used = Array2::from_shape_fn(shape, |(i, _)| curve.is_used(i) && in_v(i));
        let mut left_out: BTreeMap<String, usize> = BTreeMap::new();
        for i in (0..curve.times.len()).filter(|i| !used[[*i, 0]]) {
            let why = if in_v(i) { "no number" } else { "another filter than V" };
            *left_out.entry(why.to_owned()).or_default() += 1;
        }
        Self {
            path: path.to_path_buf(),
            times: curve.times.clone(),
            exposure_s: curve.exposure_s.clone(),
            channels: vec!["V".into()],
            rate: Array2::from_shape_fn(shape, |(i, _)| curve.flux[i]),
            sigma: Array2::from_shape_fn(shape, |(i, _)| curve.sigma[i]),
            level: None,
            share: Some(Array2::from_shape_fn(shape, |(i, _)| curve.share[i])),
            is_exposure_known: curve.is_exposure_known,
            used,
            left_out: vec![left_out],
            calibration: None,
            magnitudes: true,
            tracks: curve.tracks.clone(),
            cameras: curve.cameras.clone(),
            file_rows: curve.file_rows.clone(),
            warnings: curve.notes.iter().cloned().chain(of_v.note).collect(),
        }
    }

    fn of_curve(path: &Path, curve: &LightCurve, doubled: usize) -> Result<Self, MeasuredError> {
        let mut warnings = Vec::new();
        if doubled > 0 {
            warnings.push(format!(
                "{doubled} samples stand there twice (time, light and flags are the same): each counts once"
            ));
        }
        match curve.kind {
            RateKind::Calibrated => {}
            RateKind::Predicted => warnings.push(format!(
                "{} is a prediction, not a measurement: what is found is what another simulation had",
                path.display()
            )),
            kind => {
                return Err(MeasuredError::NotCalibrated { path: path.to_path_buf(), kind });
            }
        }
        if curve.is_empty() {
            return Err(MeasuredError::NoSample { path: path.to_path_buf() });
        }
        let shape = (curve.len(), curve.channels.len());
        let at = |pick: &dyn Fn(&sunglint_radiometry::light_curve::ChannelCurve, usize) -> f64| {
            Array2::from_shape_fn(shape, |(i, c)| pick(&curve.channels[c], i))
        };
        let (rate, sigma) = (at(&|c, i| c.rate_hz[i]), at(&|c, i| c.sigma_hz[i]));
        let mut used = Array2::from_elem(shape, false);
        let mut left_out = vec![BTreeMap::<String, usize>::new(); curve.channels.len()];
        for (c, channel) in curve.channels.iter().enumerate() {
            for i in 0..curve.len() {
                let worse = channel.flags[i].difference(TOLERATED);
                // Another instrument's row is no sample that was lost.
                if worse.contains(Flags::NOT_SAMPLED) {
                    continue;
                }
                let known = rate[[i, c]].is_finite() && sigma[[i, c]].is_finite();
                if worse.is_empty() && known && sigma[[i, c]] > 0.0 {
                    used[[i, c]] = true;
                    continue;
                }
                let mut reasons: Vec<String> = worse
                    .iter_names()
                    .map(|(name, _)| format!("flag {}", name.to_lowercase()))
                    .collect();
                if reasons.is_empty() {
                    reasons.push(if known { NO_SIGMA.into() } else { "no number".into() });
                }
                *left_out[c].entry(reasons.join(" + ")).or_default() += 1;
            }
        }
        Ok(Self {
            path: path.to_path_buf(),
            times: curve.samples.time.clone(),
            exposure_s: curve.samples.exposure_s.clone(),
            channels: curve.channels.iter().map(|c| c.name.clone()).collect(),
            rate,
            sigma,
            used,
            left_out,
            calibration: calibration(curve, &mut warnings),
            level: curve
                .channels
                .iter()
                .any(|c| c.common_sigma_hz.is_some())
                .then(|| at(&|c, i| c.common_sigma_hz.as_ref().map_or(0.0, |common| common[i]))),
            share: None,
            is_exposure_known: true,
            magnitudes: false,
            tracks: Vec::new(),
            cameras: None,
            file_rows: (0..curve.len()).collect(),
            warnings,
        })
    }

    /// Warnings about those of these channels that are in the curve and have no sample that counts: why, and what helps.
    pub fn silent(&self, channels: &[String]) -> Vec<String> {
        let mut warnings = Vec::new();
        for (c, name) in self.channels.iter().enumerate() {
            let lost: usize = self.left_out[c].values().sum();
            if lost == 0 || self.used.column(c).iter().any(|u| *u) || !channels.contains(name) {
                continue;
            }
            let why: Vec<String> =
                self.left_out[c].iter().map(|(why, n)| format!("{n} {why}")).collect();
            let advice = match self.left_out[c].contains_key(NO_SIGMA) {
                true => format!(
                    "state the uncertainties in {name}_sigma_hz, since without one nobody knows how much a sample weighs"
                ),
                false => "its flags say what was wrong with it".to_owned(),
            };
            warnings.push(format!(
                "{}: the channel {name} does not count, none of its {} can be used ({}): {advice}",
                self.name(),
                counted(lost, "sample"),
                why.join(", ")
            ));
        }
        warnings
    }

    /// Whether two curves hold the same samples: times and light of every channel.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        let bits = |curve: &Self| curve.rate.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        (self.magnitudes, &self.channels) == (other.magnitudes, &other.channels)
            && self.times == other.times
            && bits(self) == bits(other)
    }

    /// The file's name without its folders.
    pub fn name(&self) -> String {
        self.path.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }

    /// First and last moment.
    pub fn ends(&self) -> (Epoch, Epoch) {
        let first = self.times[0];
        self.times.iter().fold((first, first), |(a, b), t| (a.min(*t), b.max(*t)))
    }
}

/// Covariance of ln κ, as `sunglint apply` left it.
fn calibration(curve: &LightCurve, warnings: &mut Vec<String>) -> Option<CalibrationError> {
    let kappa = curve.other.get("kappa")?;
    let names: Vec<&str> =
        kappa["channels"].as_array()?.iter().filter_map(|c| c["channel"].as_str()).collect();
    let rows: Vec<Vec<f64>> = serde_json::from_value(kappa["covariance_ln_kappa"].clone()).ok()?;
    let place: Vec<Option<usize>> =
        curve.channels.iter().map(|c| names.iter().position(|n| *n == c.name)).collect();
    let n = curve.channels.len();
    let good = rows.len() == names.len() && rows.iter().all(|r| r.len() == names.len());
    if !good || place.iter().any(Option::is_none) {
        warnings.push("the metadata `kappa` do not fit the channels: errors of the calibration are not counted".into());
        return None;
    }
    let covariance = Array2::from_shape_fn((n, n), |(i, j)| match (place[i], place[j]) {
        (Some(a), Some(b)) => rows[a][b],
        _ => 0.0,
    });
    let text = |key: &str| kappa[key].as_str().unwrap_or_default().to_owned();
    Some(CalibrationError { key: format!("{} {}", text("sha256"), text("night")), covariance })
}
