//! A linear light curve times the night's coefficient κ; magnitudes and irradiances by a stated spectrum.
//!
//! [`read`] takes the files, [`apply`] multiplies, [`Applied::add_photometry`] adds irradiances and magnitudes where they are wanted.

mod photometry;

pub use photometry::{ChannelPhotometry, Photometry, PhotometryOptions};

use crate::stars::{NightFile, Nights, USUAL_EXPONENT, night_of};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use sunglint_formats::{FileError, ParseError, Table};
use sunglint_numerics::measured::Measured;
use sunglint_radiometry::air::{Aerosol, Air, AirError, AirOptions};
use sunglint_radiometry::light_curve::{
    ChannelCurve, Flags, Input, LightCurve, RateKind, TOLERATED,
};
use sunglint_radiometry::passband::PhotometryError;
use sunglint_radiometry::spectrum::SpectrumError;
use sunglint_radiometry::star_light::StarLightError;
use sunglint_radiometry::station::Station;

/// Why a calibration cannot be applied.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ApplyError {
    /// A file that cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// A curve that is not linear.
    #[error("{}: its rates are {kind}, expected linear", path.display())]
    NotLinear {
        /// The file.
        path: PathBuf,
        /// Kind of the curve's rates.
        kind: RateKind,
    },
    /// No sample.
    #[error("the light curve has no sample")]
    NoSample,
    /// Samples, none of which has a rate.
    #[error(
        "none of the {samples} samples has a valid rate in a channel with a kappa (flags: {flags}): nothing can be calibrated"
    )]
    NoneValid {
        /// Samples of the curve.
        samples: usize,
        /// Flags of the samples over all channels, with their numbers.
        flags: String,
    },
    /// The night has no calibration.
    #[error(
        "no calibration of the night of {wanted}: the file has {}; kappa changes from night to night",
        known.join(", ")
    )]
    NoNight {
        /// The night.
        wanted: String,
        /// The nights that there are.
        known: Vec<String>,
    },
    /// None of the curve's channels has a κ.
    #[error(
        "the calibration has none of the curve's channels: there are {}, here {}",
        known.join(", "), asked.join(", ")
    )]
    NoChannel {
        /// The calibration's channels.
        known: Vec<String>,
        /// The curve's channels.
        asked: Vec<String>,
    },
    /// No zenith angles.
    #[error(
        "magnitudes and irradiances above the air need the curve's zenith_deg, which is not there"
    )]
    NoZenith,
    /// A spectrum that is not known.
    #[error("the spectrum `{name}` is neither `sun`, nor a file, nor a star's type")]
    Spectrum {
        /// Name of the spectrum.
        name: String,
        /// Why it is no star's type.
        #[source]
        source: StarLightError,
    },
    /// A file that holds no spectrum.
    #[error("{}", path.display())]
    SpectrumFile {
        /// The file.
        path: PathBuf,
        /// Error in the file.
        #[source]
        source: SpectrumError,
    },
    /// A band that is not known, or that the spectrum does not cover.
    #[error(transparent)]
    Band(#[from] PhotometryError),
    /// A channel that the station has not.
    #[error("the station {station} has no channel `{channel}`")]
    UnknownChannel {
        /// The channel.
        channel: String,
        /// The station's name.
        station: String,
    },
    /// An angle that has no way through the air.
    #[error("the way of the light through the air")]
    Path(#[source] AirError),
    /// An air that cannot be.
    #[error(transparent)]
    Air(#[from] AirError),
}

impl From<ParseError> for ApplyError {
    fn from(error: ParseError) -> Self {
        Self::File(error.into())
    }
}

/// Law of phase angle, 1 at 90°.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum PhaseLaw {
    /// Lambert sphere: sin γ + (π − γ) cos γ
    #[default]
    Lambert,
    /// Illuminated fraction of the disc: 1 + cos γ
    Illuminated,
}

impl PhaseLaw {
    /// Name of the law.
    pub fn name(self) -> &'static str {
        match self {
            PhaseLaw::Lambert => "Lambert sphere",
            PhaseLaw::Illuminated => "illuminated fraction",
        }
    }

    /// Brightness at a phase angle over that at 90°.
    pub fn at(self, phase_rad: f64) -> f64 {
        match self {
            PhaseLaw::Lambert => {
                phase_rad.sin() + (std::f64::consts::PI - phase_rad) * phase_rad.cos()
            }
            PhaseLaw::Illuminated => 1.0 + phase_rad.cos(),
        }
    }
}

/// Whether nothing that a sample's flags say changes its rate.
pub fn is_valid(flags: Flags) -> bool {
    flags.difference(TOLERATED).is_empty()
}

/// A table, and the file that it was.
fn read_table(path: &Path) -> Result<(Table, Input), FileError> {
    let bytes = sunglint_formats::read::bytes(path)?;
    let input =
        Input { file: path.display().to_string(), sha256: sunglint_formats::sha256(&bytes) };
    let text = sunglint_formats::read::decode(path, bytes)?;
    Ok((sunglint_formats::ecsv::read_str(path, &text)?, input))
}

/// A calibration and a linear light curve, with the files that they came from.
#[derive(Debug, Clone)]
pub struct ApplyInput {
    /// The calibration.
    pub nights: Nights,
    /// The linear light curve.
    pub curve: LightCurve,
    /// Files of the calibration and of the curve.
    pub files: [Input; 2],
}

/// Reads a calibration and a linear light curve.
///
/// # Errors
/// Files that cannot be read, a curve that is not linear.
pub fn read(calibration: &Path, curve: &Path) -> Result<ApplyInput, ApplyError> {
    let (table, calibration_input) = read_table(calibration)?;
    let nights = Nights::from_table(calibration, &table)?;
    let (table, curve_input) = read_table(curve)?;
    let mut linear = LightCurve::from_table(curve, &table)?;
    if linear.kind != RateKind::Linear {
        return Err(ApplyError::NotLinear { path: curve.to_path_buf(), kind: linear.kind });
    }
    linear.sort();
    Ok(ApplyInput { nights, curve: linear, files: [calibration_input, curve_input] })
}

/// A calibrated light curve.
#[derive(Debug, Clone)]
pub struct Applied {
    /// The curve, Hz at the detector.
    pub curve: LightCurve,
    /// The night whose κ it has.
    pub night: NightFile,
    /// The air that κ was found with, in words.
    pub air: String,
    /// Irradiances and magnitudes, where they were added.
    pub photometry: Option<Photometry>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// Multiplies a linear light curve by κ of its night, or of the `night` that is given (as 2020-11-18).
///
/// # Errors
/// A curve without samples, a night without a calibration, a calibration without the curve's channels.
pub fn apply(
    input: &ApplyInput,
    station: &Station,
    night: Option<&str>,
) -> Result<Applied, ApplyError> {
    let ApplyInput { nights, curve: linear, files } = input;
    let mut warnings = Vec::new();
    if station.name != nights.station {
        warnings.push(format!(
            "the calibration is of the station {}, this is {}",
            nights.station, station.name
        ));
    }
    let stated = |hash: &str| nights.station_files.iter().any(|f| f.sha256 == hash);
    if station.sources.iter().any(|(_, hash)| !stated(hash)) {
        warnings.push("the station's files are not those of the calibration".into());
    }
    let night = night_in(nights, linear, station, night, &mut warnings)?.clone();
    let curve = calibrated(linear, &night, nights, files.clone(), &mut warnings)?;
    Ok(Applied { curve, night, air: nights.air.clone(), photometry: None, warnings })
}

/// The night of a calibration that a curve needs.
fn night_in<'a>(
    nights: &'a Nights,
    curve: &LightCurve,
    station: &Station,
    asked: Option<&str>,
    warnings: &mut Vec<String>,
) -> Result<&'a NightFile, ApplyError> {
    let first = curve.samples.time.first().ok_or(ApplyError::NoSample)?;
    let own = night_of(*first, station.site.geodetic().longitude_deg);
    let wanted = asked.unwrap_or(&own);
    if wanted != own {
        warnings.push(format!(
            "the curve is of the night of {own}, kappa of that of {wanted}: kappa changes from night to night, by more than its uncertainty"
        ));
    }
    nights.nights.iter().find(|n| n.night == *wanted).ok_or_else(|| ApplyError::NoNight {
        wanted: wanted.to_owned(),
        known: nights.nights.iter().map(|n| n.night.clone()).collect(),
    })
}

impl Applied {
    /// Adds irradiances and magnitudes above an air. An aerosol that was fitted with κ belongs to it, unless the options keep the air's own.
    ///
    /// # Errors
    /// The errors of [`Photometry::new`].
    pub fn add_photometry(
        &mut self,
        station: &Station,
        air: &Air,
        options: &PhotometryOptions,
    ) -> Result<(), ApplyError> {
        if air.describe() != self.air {
            self.warnings.push(format!(
                "kappa was found with the air `{}`, magnitudes and irradiances are now with `{}`",
                self.air,
                air.describe()
            ));
        }
        let fitted = match self.night.facts.aerosol_depth {
            Some(Measured { value: depth, .. }) if !options.keep_aerosol => {
                let aerosol = Aerosol::Angstrom {
                    optical_depth: depth,
                    wavelength_nm: 550.0,
                    exponent: self.night.facts.aerosol_exponent.unwrap_or(USUAL_EXPONENT),
                    scale_height_m: 1800.0,
                };
                Some(Air::new(&AirOptions { aerosol, ..air.options().clone() })?)
            }
            _ => None,
        };
        let air = fitted.as_ref().unwrap_or(air);
        self.photometry = Some(Photometry::new(&self.curve, station, air, options)?);
        Ok(())
    }
}

/// The curve times κ. κ's own uncertainty is the same in all samples: it stays apart, in the metadata, with its covariance between the channels. A channel
/// without a κ is left out, and said.
fn calibrated(
    linear: &LightCurve,
    night: &NightFile,
    nights: &Nights,
    inputs: [Input; 2],
    warnings: &mut Vec<String>,
) -> Result<LightCurve, ApplyError> {
    let mut curve = linear.clone();
    curve.kind = RateKind::Calibrated;
    curve.channels.retain(|c| {
        let known = night.channel(&c.name).is_some();
        if !known {
            warnings
                .push(format!("no kappa of {} on the night of {}: left out", c.name, night.night));
        }
        known
    });
    if curve.channels.is_empty() {
        return Err(ApplyError::NoChannel {
            known: night.channels.iter().map(|c| c.channel.clone()).collect(),
            asked: linear.channels.iter().map(|c| c.name.clone()).collect(),
        });
    }
    let valid = |c: &ChannelCurve, i: usize| {
        let good = c.rate_hz[i].is_finite() && c.sigma_hz[i].is_finite();
        good && c.flags[i].difference(TOLERATED).is_empty()
    };
    let any = curve.channels.iter().any(|c| (0..c.flags.len()).any(|i| valid(c, i)));
    if !any {
        let mut flags = std::collections::BTreeMap::<&str, usize>::new();
        for (name, _) in curve.channels.iter().flat_map(|c| &c.flags).flat_map(|f| f.iter_names()) {
            *flags.entry(name).or_default() += 1;
        }
        let flags: Vec<String> =
            flags.iter().map(|(f, n)| format!("{n} {}", f.to_lowercase())).collect();
        let flags = if flags.is_empty() { "none".into() } else { flags.join(", ") };
        return Err(ApplyError::NoneValid { samples: curve.len(), flags });
    }
    for channel in &mut curve.channels {
        let Some(row) = night.channel(&channel.name) else { continue };
        channel.rate_hz.iter_mut().for_each(|v| *v *= row.kappa);
        let sigma = channel.sigma_hz.iter_mut().chain(channel.common_sigma_hz.iter_mut().flatten());
        sigma.for_each(|v| *v *= row.kappa);
    }
    let place = |name: &str| night.channels.iter().position(|c| c.channel == name);
    let order: Vec<usize> = curve.channels.iter().filter_map(|c| place(&c.name)).collect();
    let covariance: Vec<Vec<f64>> =
        order.iter().map(|i| order.iter().map(|j| night.covariance[*i][*j]).collect()).collect();
    let rows: Vec<Value> = order
        .iter()
        .map(|i| {
            let row = &night.channels[*i];
            json!({"channel": row.channel, "kappa": row.kappa, "relative_sigma": row.relative_sigma, "interval": [row.interval.0, row.interval.1]})
        })
        .collect();
    let [calibration, _] = &inputs;
    let kappa = json!({
        "file": calibration.file, "sha256": calibration.sha256, "night": night.night, "station": nights.station,
        "air": nights.air, "confidence": nights.confidence, "channels": rows, "covariance_ln_kappa": covariance,
        "note": "common to all samples: not in the columns of sigma",
    });
    curve.other.insert("kappa".into(), kappa);
    curve.provenance.program = concat!("sunglint ", env!("CARGO_PKG_VERSION")).into();
    curve.provenance.command = "sunglint apply".into();
    curve.provenance.inputs.extend(inputs);
    Ok(curve)
}
