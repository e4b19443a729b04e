//! Calibration of nights from visits to stars: measured, predicted through the air, fitted night by night.

use super::recorded::{MeasuredVisit, StarVisit};
use super::scintillation::{Aperture, USUAL_COEFFICIENT};
use super::{
    Night, NightFile, Nights, Options, StarsError, Variation, Visit, calibrate, variation,
};
use crate::reduction::ReduceError;
use std::error::Error;
use std::path::PathBuf;
use sunglint_formats::FileError;
use sunglint_numerics::measured::Measured;
use sunglint_radiometry::air::{Aerosol, Air, AirError, AirOptions};
use sunglint_radiometry::light_curve::{Input, Provenance};
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::sky::{SkyError, StarError};
use sunglint_radiometry::star_light::StarLightError;
use sunglint_radiometry::station::Station;

/// How nights are calibrated.
#[derive(Debug, Clone)]
pub struct NightsOptions {
    /// The fit of each night.
    pub fit: Options,
    /// Young's coefficient of the scintillation.
    pub scintillation: f64,
    /// Zero point of the magnitudes.
    pub zero_point: ZeroPoint,
}

impl Default for NightsOptions {
    fn default() -> Self {
        Self {
            fit: Options::default(),
            scintillation: USUAL_COEFFICIENT,
            zero_point: ZeroPoint::default(),
        }
    }
}

/// Why a visit cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum VisitError {
    /// A star that is not in the catalogue, and not described by the file.
    #[error(
        "{0}. A star that the catalogue lacks needs ra_deg, dec_deg and v_mag in the file's target"
    )]
    UnknownStar(StarError),
    /// A place that no star can have.
    #[error(transparent)]
    Star(#[from] StarError),
    /// A star without a magnitude.
    #[error("no magnitude of {star} is known")]
    NoMagnitude {
        /// The star.
        star: String,
    },
    /// A star whose spectrum cannot be told.
    #[error(transparent)]
    Light(#[from] StarLightError),
    /// An epoch for which the sky is not known.
    #[error(transparent)]
    Sky(#[from] SkyError),
    /// An angle that has no way through the air.
    #[error("the way of the star's light through the air")]
    Path(#[source] AirError),
    /// A channel that the station has not.
    #[error("its channel `{channel}` is none of the station {station}")]
    UnknownChannel {
        /// The channel.
        channel: String,
        /// The station's name.
        station: String,
    },
    /// No sample without a flag.
    #[error("no sample of any channel is valid")]
    NothingValid,
}

/// Why a night cannot be calibrated.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NightError {
    /// The fit found nothing.
    #[error(transparent)]
    Stars(#[from] StarsError),
    /// An air that cannot be.
    #[error(transparent)]
    Air(#[from] AirError),
    /// A depth is to be fitted to an aerosol that has none of its own.
    #[error(
        "--fit-aerosol fits Ångström's law: give --aerosol none or TAU,ALPHA instead of the model {model}"
    )]
    AerosolModel {
        /// The model.
        model: String,
    },
    /// The fit gave no depth.
    #[error("the aerosol's depth was not fitted")]
    NoDepth,
}

/// Why no night is calibrated.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NightsError {
    /// A file that cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// A session that cannot be reduced.
    #[error(transparent)]
    Reduce(#[from] ReduceError),
    /// A file that is no linear light curve of a star.
    #[error("{}: {why}", path.display())]
    NotOfAStar {
        /// The file.
        path: PathBuf,
        /// The reason.
        why: String,
    },
    /// No visit to a star.
    #[error(
        "no visit to a star in {}: wanted are linear light curves whose `target` is a star",
        inputs.iter().map(|p| p.display().to_string()).collect::<Vec<_>>().join(", ")
    )]
    NoVisit {
        /// Where none was found.
        inputs: Vec<PathBuf>,
    },
    /// No night has a calibration.
    #[error("{}", if failures.is_empty() { "no visit is left".to_owned() } else { failures.join("\n") })]
    NoNight {
        /// The nights, each with its reason; none where all visits were left out.
        failures: Vec<String>,
        /// Visits that were left out, each with its reason.
        warnings: Vec<String>,
    },
}

impl From<sunglint_formats::ParseError> for NightsError {
    fn from(error: sunglint_formats::ParseError) -> Self {
        Self::File(error.into())
    }
}

/// A night that is calibrated.
#[derive(Debug, Clone)]
pub struct CalibratedNight {
    /// Calibration of the night as it goes into a file.
    pub file: NightFile,
    /// The fit.
    pub found: Night,
    /// Input of the fit: the visits, predicted beside measured.
    pub input: Vec<Visit>,
    /// The same visits as they were measured.
    pub visits: Vec<MeasuredVisit>,
}

/// A slope is worth a warning from here on, in standard uncertainties.
const WORTH_A_WARNING: f64 = 3.0;

impl CalibratedNight {
    /// κ of a channel of the station; `None` where there is none.
    pub fn kappa(&self, channel: usize) -> Option<f64> {
        self.found.channels[channel].as_ref().ok().map(|k| k.kappa)
    }

    /// Returns warnings that the user should read before using κ.
    pub fn warnings(&self) -> Vec<String> {
        let night = &self.file.night;
        let mut warnings = Vec::new();
        let slopes = self.file.channels.iter().filter_map(|c| Some((&c.channel, c.per_airmass?)));
        let steep: Vec<String> = slopes
            .filter(|(_, s)| s.significance() > WORTH_A_WARNING)
            .map(|(name, s)| format!("{name} {}", s.percent()))
            .collect();
        if !steep.is_empty() {
            let [_, mean, _] = self.found.airmass;
            warnings.push(format!(
                "{night}: kappa changes with airmass ({} per airmass): extinction that the air model lacks, an aerosol most likely. It is that of airmass {mean:.2}; --fit-aerosol, or --aerosol TAU,ALPHA",
                steep.join(", ")
            ));
        }
        for [channel, why] in &self.file.facts.without_kappa {
            warnings.push(format!("{night}: no kappa of {channel}: {why}"));
        }
        warnings
    }
}

/// Calibrated nights.
#[derive(Debug, Clone)]
pub struct CalibratedNights {
    /// Content of the file.
    pub file: Nights,
    /// The nights, in the order of time.
    pub nights: Vec<CalibratedNight>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

impl CalibratedNights {
    /// Spread of κ over the nights, by channel of the station; none of a channel with a κ on fewer than two nights.
    pub fn variations(&self) -> Vec<(usize, Variation)> {
        let channels = self.nights.first().map_or(0, |night| night.found.channels.len());
        let of = |c: usize| {
            let kappas: Vec<f64> = self.nights.iter().filter_map(|n| n.kappa(c)).collect();
            Some((c, variation(&kappas)?))
        };
        (0..channels).filter_map(of).collect()
    }
}

/// Calibrates the nights of visits.
///
/// # Errors
/// [`NightsError::NoNight`] where no night has a calibration. Visits and nights that fail beside others become warnings.
pub fn calibrate_nights(
    read: &[StarVisit],
    station: &Station,
    air: &Air,
    options: &NightsOptions,
) -> Result<CalibratedNights, NightsError> {
    let aperture = Aperture {
        diameter_m: station.telescope.primary_diameter_m,
        height_m: station.site.geodetic().height_m,
        coefficient: options.scintillation,
    };
    let (mut visits, mut warnings) = (Vec::new(), Vec::new());
    for visit in read {
        match MeasuredVisit::new(visit, station, air, &aperture, options.zero_point) {
            Ok(visit) => visits.push(visit),
            Err(error) => warnings.push(format!("{} is left out: {}", visit.file, chain(&error))),
        }
    }
    visits.sort_by(|a, b| a.night.cmp(&b.night).then(a.middle.total_cmp_utc(&b.middle)));
    let work = Work { options, station, air };
    let mut nights = Vec::new();
    let mut failures = Vec::new();
    for group in visits.chunk_by(|a, b| a.night == b.night) {
        match work.night(group) {
            Ok(night) => nights.push(night),
            Err(error) => {
                failures.push(format!("the night of {}: {}", group[0].night, chain(&error)));
            }
        }
    }
    if nights.is_empty() {
        return Err(NightsError::NoNight { failures, warnings });
    }
    warnings.extend(failures);
    warnings.extend(nights.iter().flat_map(CalibratedNight::warnings));
    Ok(CalibratedNights { file: work.file(&nights, read), nights, warnings })
}

/// An error and its causes.
fn chain(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text.push_str(": ");
        text.push_str(&error.to_string());
        cause = error.source();
    }
    text
}

/// A night's result, what went in, and the aerosol's depth with its uncertainty where it was fitted.
type Fit = (Night, Vec<Visit>, Option<(f64, f64)>);

/// Inputs that are the same for all nights.
struct Work<'a> {
    options: &'a NightsOptions,
    station: &'a Station,
    air: &'a Air,
}

/// Ångström's exponent where nothing is said.
pub const USUAL_EXPONENT: f64 = 1.3;
/// A step of the aerosol's depth by which its effect is found.
const DEPTH_STEP: f64 = 0.02;
/// Rounds of the aerosol's fit: the effect of a depth on a wide channel bends a little.
const AEROSOL_ROUNDS: usize = 6;

impl Work<'_> {
    fn night(&self, visits: &[MeasuredVisit]) -> Result<CalibratedNight, NightError> {
        let (found, input, depth) = if self.options.fit.fit_aerosol {
            self.with_aerosol(visits)?
        } else {
            let input = visits
                .iter()
                .map(|v| v.visit(self.station, self.air, None))
                .collect::<Result<Vec<_>, AirError>>()?;
            (calibrate(&input, &self.options.fit)?, input, None)
        };
        let names: Vec<String> = self.station.channels.iter().map(|c| c.name.clone()).collect();
        let mut file = NightFile::new(&visits[0].night, &names, &found);
        if let Some((depth, sigma)) = depth {
            file.facts.aerosol_depth = Some(Measured::new(depth, sigma));
            file.facts.aerosol_exponent = Some(self.exponent());
        }
        Ok(CalibratedNight { file, found, input, visits: visits.to_vec() })
    }

    /// Predicts with a depth, fits what is missing of it, and predicts again until nothing is.
    fn with_aerosol(&self, visits: &[MeasuredVisit]) -> Result<Fit, NightError> {
        let mut depth = self.air.columns().aerosol_550;
        let mut last = None;
        for _ in 0..AEROSOL_ROUNDS {
            let air = self.air_with(depth)?;
            let thicker = self.air_with(depth + DEPTH_STEP)?;
            let input = visits
                .iter()
                .map(|v| v.visit(self.station, &air, Some((&thicker, DEPTH_STEP))))
                .collect::<Result<Vec<_>, AirError>>()?;
            let found = calibrate(&input, &self.options.fit)?;
            let Some(super::Aerosol { depth: more, sigma }) = found.aerosol else { break };
            if depth + more < 0.0 {
                let why =
                    format!("it would be {:.3} ± {sigma:.3}, below none at all", depth + more);
                return Err(StarsError::Aerosol { why }.into());
            }
            depth += more;
            last = Some((found, input, Some((depth, sigma))));
            if more.abs() < 0.01 * sigma {
                break;
            }
        }
        last.ok_or(NightError::NoDepth)
    }

    /// The exponent of Ångström's law that a fitted aerosol has.
    fn exponent(&self) -> f64 {
        match self.air.options().aerosol {
            Aerosol::Angstrom { exponent, .. } => exponent,
            _ => USUAL_EXPONENT,
        }
    }

    /// The air with an aerosol of that depth at 550 nm.
    fn air_with(&self, depth: f64) -> Result<Air, NightError> {
        let options = self.air.options();
        let aerosol = match options.aerosol {
            Aerosol::Angstrom { wavelength_nm, exponent, scale_height_m, .. } => {
                Aerosol::Angstrom {
                    optical_depth: depth * (wavelength_nm / 550.0).powf(-exponent),
                    wavelength_nm,
                    exponent,
                    scale_height_m,
                }
            }
            Aerosol::Model(model) => {
                return Err(NightError::AerosolModel { model: model.to_string() });
            }
            _ => Aerosol::Angstrom {
                optical_depth: depth,
                wavelength_nm: 550.0,
                exponent: USUAL_EXPONENT,
                scale_height_m: 1800.0,
            },
        };
        Ok(Air::new(&AirOptions { aerosol, ..options.clone() })?)
    }

    fn file(&self, nights: &[CalibratedNight], read: &[StarVisit]) -> Nights {
        let input = |v: &StarVisit| Input { file: v.file.clone(), sha256: v.sha256.clone() };
        let station_files = self.station.sources.iter().map(|(path, sha256)| Input {
            file: path.display().to_string(),
            sha256: sha256.clone(),
        });
        Nights {
            nights: nights.iter().map(|n| n.file.clone()).collect(),
            station: self.station.name.clone(),
            station_files: station_files.collect(),
            air: self.air.describe(),
            zero_point: self.options.zero_point.to_string(),
            confidence: self.options.fit.confidence,
            provenance: Provenance {
                program: concat!("sunglint ", env!("CARGO_PKG_VERSION")).into(),
                command: "sunglint calibrate".into(),
                station: self.station.name.clone(),
                target: "stars".into(),
                inputs: read.iter().map(input).collect(),
                notes: vec![format!(
                    "floor {}, outliers beyond {} sigma, scintillation by Young's law with C = {}, seed {}",
                    self.options.fit.floor,
                    self.options.fit.clip_sigma,
                    self.options.scintillation,
                    self.options.fit.seed
                )],
                ..Provenance::default()
            },
        }
    }
}

/// Times in the order of time.
trait Ordered {
    fn total_cmp_utc(&self, other: &Self) -> std::cmp::Ordering;
}

impl Ordered for hifitime::Epoch {
    fn total_cmp_utc(&self, other: &Self) -> std::cmp::Ordering {
        self.partial_cmp(other).unwrap_or(std::cmp::Ordering::Equal)
    }
}
