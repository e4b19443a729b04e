//! Samples of a curve as numbers: values, uncertainties, which of them count, and under what light they were taken.

use crate::unmix::{Bands, BandsError, Endmember, Light};
use hifitime::Epoch;
use ndarray::Array2;
use std::path::Path;
use sunglint_formats::{FileError, ParseError, ecsv};
use sunglint_radiometry::air::{Air, Zenith};
use sunglint_radiometry::light_curve::{
    Flags, Input, LightCurve, Provenance, RateKind, Samples, SpectralLightCurve, SpectralQuantity,
    TOLERATED,
};
use sunglint_radiometry::sky::{EarthOrientation, SkyError, SkyFrames};
use sunglint_radiometry::spectrum::{Irradiance, Spectrum};
use sunglint_radiometry::station::{Channel, Station};

/// Warning that a curve does not say how far its target was.
pub const NO_RANGE: &str = "the curve has no column range_m: weights are those at a distance of 1 m, and only their ratios mean something";

/// Why a curve's samples cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SamplesError {
    /// A file that cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// A file that is no light curve.
    #[error(transparent)]
    Parse(#[from] ParseError),
    /// Rates that are not comparable with a prediction.
    #[error("{file}: its rates are {kind}, expected calibrated or predicted ones")]
    Kind {
        /// The file.
        file: String,
        /// State of its rates.
        kind: RateKind,
    },
    /// A curve without a sample.
    #[error("{file}: the light curve has no sample")]
    Empty {
        /// The file.
        file: String,
    },
    /// A channel that the station does not have.
    #[error(
        "the station {station} has no channel `{channel}` (it has {}): give the curve's own station",
        known.join(", ")
    )]
    Channel {
        /// The station's name.
        station: String,
        /// The channel of the curve.
        channel: String,
        /// The channels of the station.
        known: Vec<String>,
    },
    /// Rates without a station.
    #[error("rates need the station that counted them")]
    Station,
    /// Spectra of a quantity that is none of those that are known.
    #[error(
        "{file}: its values are `{quantity}` in {unit}, expected `{}` in {} or `{}` in {}",
        SpectralQuantity::Intensity.name(),
        SpectralQuantity::Intensity.unit(),
        SpectralQuantity::Irradiance.name(),
        SpectralQuantity::Irradiance.unit()
    )]
    Quantity {
        /// The file.
        file: String,
        /// The quantity that it holds.
        quantity: String,
        /// Unit.
        unit: String,
    },
    /// No band can be made of the curve's channels or bins.
    #[error(transparent)]
    Bands(#[from] BandsError),
    /// Light that came through air of unknown length.
    #[error("{file}: no column zenith_deg, so that nobody knows through how much air it was seen")]
    Zenith {
        /// The file.
        file: String,
    },
    /// A time at which the Sun has no place.
    #[error(transparent)]
    Sky(#[from] SkyError),
}

/// Values of a measured or simulated curve.
#[derive(Debug, Clone)]
pub enum CurveSource {
    /// Rates of channels.
    Rates(LightCurve),
    /// Spectra.
    Spectra(SpectralLightCurve),
}

/// A curve of rates or spectra and the file that it was.
#[derive(Debug, Clone)]
pub struct SampledCurve {
    /// Light curve that the file held.
    pub source: CurveSource,
    /// The file.
    pub input: Input,
}

/// Numbers of a curve, samples × bands.
#[derive(Debug, Clone)]
pub struct SampleValues {
    /// Rates, Hz, or spectral values.
    pub value: Array2<f64>,
    /// Their standard uncertainties, where the curve has them.
    pub sigma: Option<Array2<f64>>,
    /// True for those that count.
    pub valid: Array2<bool>,
}

/// Surroundings of a curve: the Sun that lit its target, the air and the station.
#[derive(Debug, Clone, Copy)]
pub struct Surroundings<'a> {
    /// Spectral irradiance of the Sun at 1 au.
    pub sun: &'a Spectrum<Irradiance>,
    /// The station that counted the rates.
    pub station: Option<&'a Station>,
    /// The air between, where there is any.
    pub air: Option<&'a Air>,
    /// Relative error that the table of its transmission may have.
    pub air_tolerance: f64,
}

impl SampledCurve {
    /// Reads an ECSV light curve or a FITS file of spectra.
    ///
    /// # Errors
    /// A file that is neither, or has no sample; rates that are neither calibrated nor predicted.
    pub fn read(path: &Path) -> Result<Self, SamplesError> {
        let bytes = sunglint_formats::read::bytes(path)?;
        let input =
            Input { file: path.display().to_string(), sha256: sunglint_formats::sha256(&bytes) };
        let source = if bytes.starts_with(b"SIMPLE") {
            CurveSource::Spectra(SpectralLightCurve::from_fits(path, bytes)?)
        } else {
            let text = sunglint_formats::read::decode(path, bytes)?;
            let mut curve = LightCurve::from_table(path, &ecsv::read_str(path, &text)?)?;
            curve.sort();
            if !matches!(curve.kind, RateKind::Calibrated | RateKind::Predicted) {
                return Err(SamplesError::Kind { file: input.file, kind: curve.kind });
            }
            CurveSource::Rates(curve)
        };
        let curve = Self { source, input };
        if curve.samples().time.is_empty() {
            return Err(SamplesError::Empty { file: curve.input.file });
        }
        Ok(curve)
    }

    /// Times, exposures and geometry of the samples.
    pub fn samples(&self) -> &Samples {
        match &self.source {
            CurveSource::Rates(curve) => &curve.samples,
            CurveSource::Spectra(curve) => &curve.samples,
        }
    }

    /// Origin of the curve.
    pub fn provenance(&self) -> &Provenance {
        match &self.source {
            CurveSource::Rates(curve) => &curve.provenance,
            CurveSource::Spectra(curve) => &curve.provenance,
        }
    }

    /// The target's name.
    pub fn target(&self) -> &str {
        let provenance = self.provenance();
        if provenance.target.is_empty() { "a target without a name" } else { &provenance.target }
    }

    /// Whether the values are intensities of the target: no air, no distance.
    pub fn is_intensity(&self) -> bool {
        let CurveSource::Spectra(curve) = &self.source else { return false };
        curve.quantity == SpectralQuantity::Intensity.name()
    }

    /// Whether it has to be known which station took it, where no scene says: for rates, and for spectra through the air unless they are `above_air`.
    pub fn needs_station(&self, above_air: bool) -> bool {
        matches!(self.source, CurveSource::Rates(_)) || !self.is_intensity() && !above_air
    }

    /// The channels of the station that the curve has.
    fn channels<'s>(&self, station: &'s Station) -> Result<Vec<&'s Channel>, SamplesError> {
        let CurveSource::Rates(curve) = &self.source else { return Ok(Vec::new()) };
        let channel = |name: &str| {
            station.channel(name).ok_or_else(|| SamplesError::Channel {
                station: station.name.clone(),
                channel: name.to_owned(),
                known: station.channels.iter().map(|c| c.name.clone()).collect(),
            })
        };
        curve.channels.iter().map(|c| channel(&c.name)).collect()
    }

    /// The bands of the curve with some endmembers.
    ///
    /// # Errors
    /// Rates without a station, or with a channel that it does not have; spectra of another quantity than is known; no light in a band.
    pub fn bands(
        &self,
        around: &Surroundings<'_>,
        endmembers: &[Endmember],
    ) -> Result<Bands, SamplesError> {
        let air = around.air.map(|air| (air, around.air_tolerance));
        Ok(match &self.source {
            CurveSource::Rates(_) => {
                let station = around.station.ok_or(SamplesError::Station)?;
                let channels = self.channels(station)?;
                let area_m2 = station.telescope.area_m2();
                Bands::channels(around.sun, &channels, area_m2, endmembers, air)?
            }
            CurveSource::Spectra(curve) => {
                let known = [SpectralQuantity::Intensity, SpectralQuantity::Irradiance];
                let quantity =
                    known.iter().find(|q| q.name() == curve.quantity && q.unit() == curve.unit);
                let Some(quantity) = quantity else {
                    return Err(SamplesError::Quantity {
                        file: self.input.file.clone(),
                        quantity: curve.quantity.clone(),
                        unit: curve.unit.clone(),
                    });
                };
                let air = air.filter(|_| *quantity == SpectralQuantity::Irradiance);
                Bands::bins(around.sun, &curve.edges_nm, endmembers, air)?
            }
        })
    }

    /// The middle of each band, vacuum nm: of a channel the mean by its sensitivity.
    ///
    /// # Errors
    /// Rates without a station, or with a channel that it does not have.
    pub fn middles_nm(&self, around: &Surroundings<'_>) -> Result<Vec<f64>, SamplesError> {
        Ok(match &self.source {
            CurveSource::Rates(_) => {
                let station = around.station.ok_or(SamplesError::Station)?;
                self.channels(station)?.iter().map(|c| c.mean_wavelength_nm()).collect()
            }
            CurveSource::Spectra(curve) => {
                curve.edges_nm.windows(2).map(|e| 0.5 * (e[0] + e[1])).collect()
            }
        })
    }

    /// The numbers, and which of them count: no flag that says that a value is another's or none.
    pub fn values(&self) -> SampleValues {
        match &self.source {
            CurveSource::Rates(curve) => {
                let dim = (curve.len(), curve.channels.len());
                let table = |of: &dyn Fn(usize, usize) -> f64| {
                    Array2::from_shape_fn(dim, |(i, c)| of(i, c))
                };
                let good = |(i, c): (usize, usize)| {
                    let channel = &curve.channels[c];
                    channel.flags[i].difference(TOLERATED).is_empty()
                        && channel.rate_hz[i].is_finite()
                };
                SampleValues {
                    value: table(&|i, c| curve.channels[c].rate_hz[i]),
                    sigma: Some(table(&|i, c| curve.channels[c].sigma_hz[i])),
                    valid: Array2::from_shape_fn(dim, good),
                }
            }
            CurveSource::Spectra(curve) => {
                // An intensity is the target's own, whoever sees it.
                let above = if self.is_intensity() { Flags::HIDDEN } else { Flags::empty() };
                let tolerated = TOLERATED.union(above);
                let valid = Array2::from_shape_fn(curve.values.dim(), |(i, b)| {
                    curve.flags[i].difference(tolerated).is_empty()
                        && curve.values[(i, b)].is_finite()
                });
                SampleValues { value: curve.values.clone(), sigma: None, valid }
            }
        }
    }

    /// Under what light each sample was taken, by the curve's own columns and times. A curve without ranges gets the warning [`NO_RANGE`].
    ///
    /// # Errors
    /// Light through air without zenith angles; a time at which the Sun has no place.
    pub fn lights(
        &self,
        around: &Surroundings<'_>,
        warnings: &mut Vec<String>,
    ) -> Result<Vec<Light>, SamplesError> {
        let intensity = self.is_intensity();
        let samples = self.samples();
        if !intensity && around.air.is_some() && samples.zenith_deg.is_none() {
            return Err(SamplesError::Zenith { file: self.input.file.clone() });
        }
        if !intensity && samples.range_m.is_none() {
            warnings.push(NO_RANGE.into());
        }
        let au = distances_au(&samples.time)?;
        Ok((0..samples.time.len())
            .map(|i| {
                let true_deg = samples.zenith_deg.as_ref().map_or(0.0, |z| z[i]);
                let range_m = samples.range_m.as_ref().map(|r| r[i]);
                let zenith = match range_m {
                    Some(range_m) => Zenith::Near { true_deg, range_m },
                    None => Zenith::True(true_deg),
                };
                let range_m = range_m.filter(|_| !intensity).unwrap_or(1.0);
                Light { zenith, range_m, sunlight: au[i].powi(-2) }
            })
            .collect())
    }
}

/// The distance of the Sun from the Earth's centre at some times, au: that from a target in orbit to 3e-4.
fn distances_au(times: &[Epoch]) -> Result<Vec<f64>, SkyError> {
    let (Some(first), Some(last)) = (times.iter().min(), times.iter().max()) else {
        return Ok(Vec::new());
    };
    let frames = SkyFrames::over(*first, *last, EarthOrientation::embedded())?;
    times.iter().map(|t| Ok(frames.at(*t)?.sun().distance_au())).collect()
}
