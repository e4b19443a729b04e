//! What a curve's samples are in numbers: values, uncertainties, which of them count, and under what light they were taken.

use anyhow::{Context as _, bail};
use hifitime::Epoch;
use ndarray::Array2;
use std::path::Path;
use sunglint_analysis::unmix::{Bands, Endmember, Light};
use sunglint_radiometry::air::{Air, AirTable, Zenith};
use sunglint_radiometry::light::sun_at_1_au;
use sunglint_radiometry::light_curve::TOLERATED;
use sunglint_radiometry::light_curve::{
    Flags, Input, LightCurve, RateKind, Samples, SpectralLightCurve,
};
use sunglint_radiometry::sky::{EarthOrientation, SkyFrames};
use sunglint_radiometry::spectrum::{Irradiance, Spectrum};
use sunglint_radiometry::station::{Channel, Station};
use sunglint_simulator::pass::{Pass, Place, SpectralQuantity};

/// A measured or simulated curve.
pub enum Source {
    /// Rates of channels.
    Rates(LightCurve),
    /// Spectra.
    Spectra(SpectralLightCurve),
}

/// A curve and the file that it was.
pub struct Curve {
    pub source: Source,
    pub input: Input,
}

/// Numbers of a curve, samples × bands.
pub struct Numbers {
    pub value: Array2<f64>,
    pub sigma: Option<Array2<f64>>,
    pub valid: Array2<bool>,
}

/// What is known of the surroundings of a curve: a scene, or a station and its air.
pub struct Surroundings<'a> {
    pub pass: Option<&'a Pass>,
    pub station: Option<&'a Station>,
    pub air: Option<&'a Air>,
}

impl Curve {
    /// Reads an ECSV light curve or a FITS file of spectra.
    pub fn read(path: &Path) -> anyhow::Result<Self> {
        let bytes = sunglint_formats::read::bytes(path)?;
        let input =
            Input { file: path.display().to_string(), sha256: sunglint_formats::sha256(&bytes) };
        let source = if bytes.starts_with(b"SIMPLE") {
            Source::Spectra(SpectralLightCurve::from_fits(path, bytes)?)
        } else {
            let text = sunglint_formats::read::decode(path, bytes)?;
            let curve =
                LightCurve::from_table(path, &sunglint_formats::ecsv::read_str(path, &text)?)?;
            if !matches!(curve.kind, RateKind::Calibrated | RateKind::Predicted) {
                bail!(
                    "{}: its rates are {}, expected calibrated or predicted ones: `sunglint apply` makes calibrated rates of linear ones",
                    path.display(),
                    curve.kind
                );
            }
            Source::Rates(curve)
        };
        let curve = Self { source, input };
        if curve.samples().time.is_empty() {
            bail!("{}: the light curve has no sample", path.display());
        }
        Ok(curve)
    }

    pub fn samples(&self) -> &Samples {
        match &self.source {
            Source::Rates(curve) => &curve.samples,
            Source::Spectra(curve) => &curve.samples,
        }
    }

    pub fn target(&self) -> &str {
        let provenance = match &self.source {
            Source::Rates(curve) => &curve.provenance,
            Source::Spectra(curve) => &curve.provenance,
        };
        if provenance.target.is_empty() { "a target without a name" } else { &provenance.target }
    }

    /// Whether the values are intensities of the target: no air, no distance.
    pub fn is_intensity(&self) -> bool {
        let Source::Spectra(curve) = &self.source else { return false };
        curve.quantity == SpectralQuantity::Intensity.name()
    }

    /// The channels of the station that the curve has.
    fn channels<'s>(&self, station: &'s Station) -> anyhow::Result<Vec<&'s Channel>> {
        let Source::Rates(curve) = &self.source else { return Ok(Vec::new()) };
        let channel = |name: &str| {
            station.channel(name).with_context(|| {
                let known: Vec<&str> = station.channels.iter().map(|c| c.name.as_str()).collect();
                format!(
                    "the station {} has no channel `{name}` (it has {}): give the curve's own station with --station",
                    station.name,
                    known.join(", ")
                )
            })
        };
        curve.channels.iter().map(|c| channel(&c.name)).collect()
    }

    /// The bands of the curve with some endmembers.
    pub fn bands(
        &self,
        around: &Surroundings<'_>,
        endmembers: &[Endmember],
    ) -> anyhow::Result<Bands> {
        let sun: &Spectrum<Irradiance> = match around.pass {
            Some(pass) => &pass.sun,
            None => sun_at_1_au(),
        };
        let tolerance = around.pass.map_or(AirTable::TOLERANCE, |p| p.air_tolerance);
        let air = around.air.map(|air| (air, tolerance));
        Ok(match &self.source {
            Source::Rates(_) => {
                let station = around.station.context("rates need the station that counted them")?;
                let channels = self.channels(station)?;
                Bands::channels(sun, &channels, station.telescope.area_m2(), endmembers, air)?
            }
            Source::Spectra(curve) => {
                let known = [SpectralQuantity::Intensity, SpectralQuantity::Irradiance];
                let quantity =
                    known.iter().find(|q| q.name() == curve.quantity && q.unit() == curve.unit);
                let Some(quantity) = quantity else {
                    bail!(
                        "{}: its values are `{}` in {}, expected `{}` in {} or `{}` in {}",
                        self.input.file,
                        curve.quantity,
                        curve.unit,
                        known[0].name(),
                        known[0].unit(),
                        known[1].name(),
                        known[1].unit()
                    );
                };
                let air = air.filter(|_| *quantity == SpectralQuantity::Irradiance);
                Bands::bins(sun, &curve.edges_nm, endmembers, air)?
            }
        })
    }

    /// The middle of each band, vacuum nm: of a channel the mean by its sensitivity.
    pub fn middles_nm(&self, around: &Surroundings<'_>) -> anyhow::Result<Vec<f64>> {
        Ok(match &self.source {
            Source::Rates(_) => {
                let station = around.station.context("rates need the station that counted them")?;
                self.channels(station)?.iter().map(|c| c.mean_wavelength_nm()).collect()
            }
            Source::Spectra(curve) => {
                curve.edges_nm.windows(2).map(|e| 0.5 * (e[0] + e[1])).collect()
            }
        })
    }

    /// The numbers, and which of them count: no flag that says that a value is another's or none.
    pub fn numbers(&self) -> Numbers {
        match &self.source {
            Source::Rates(curve) => {
                let dim = (curve.len(), curve.channels.len());
                let table = |of: &dyn Fn(usize, usize) -> f64| {
                    Array2::from_shape_fn(dim, |(i, c)| of(i, c))
                };
                let good = |(i, c): (usize, usize)| {
                    let channel = &curve.channels[c];
                    channel.flags[i].difference(TOLERATED).is_empty()
                        && channel.rate_hz[i].is_finite()
                };
                Numbers {
                    value: table(&|i, c| curve.channels[c].rate_hz[i]),
                    sigma: Some(table(&|i, c| curve.channels[c].sigma_hz[i])),
                    valid: Array2::from_shape_fn(dim, good),
                }
            }
            Source::Spectra(curve) => {
                // An intensity is the target's own, whoever sees it.
                let above = if self.is_intensity() { Flags::HIDDEN } else { Flags::empty() };
                let tolerated = TOLERATED.union(above);
                let valid = Array2::from_shape_fn(curve.values.dim(), |(i, b)| {
                    curve.flags[i].difference(tolerated).is_empty()
                        && curve.values[(i, b)].is_finite()
                });
                Numbers { value: curve.values.clone(), sigma: None, valid }
            }
        }
    }

    /// Under what light each sample was taken: of the scene's places, else of the curve's own columns.
    pub fn lights(
        &self,
        around: &Surroundings<'_>,
        places: Option<&[Place]>,
        warnings: &mut Vec<String>,
    ) -> anyhow::Result<Vec<Light>> {
        let intensity = self.is_intensity();
        if let Some(places) = places {
            let light = |p: &Place| Light {
                zenith: p.geometry.air_zenith(),
                range_m: if intensity { 1.0 } else { p.geometry.range_m },
                sunlight: p.sunlit / p.geometry.sun.distance_au().powi(2),
            };
            return Ok(places.iter().map(light).collect());
        }
        let samples = self.samples();
        if !intensity && around.air.is_some() && samples.zenith_deg.is_none() {
            bail!(
                "{}: no column zenith_deg, so that nobody knows through how much air it was seen: give --pass PASS.toml, which knows where the target stood, or --no-air",
                self.input.file
            );
        }
        if !intensity && samples.range_m.is_none() {
            warnings.push(
                "the curve has no column range_m: weights are those at a distance of 1 m, and only their ratios mean something (--pass PASS.toml knows the range)".into(),
            );
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
fn distances_au(times: &[Epoch]) -> anyhow::Result<Vec<f64>> {
    let (Some(first), Some(last)) = (times.iter().min(), times.iter().max()) else {
        return Ok(Vec::new());
    };
    let frames = SkyFrames::over(*first, *last, EarthOrientation::embedded())?;
    times.iter().map(|t| Ok(frames.at(*t)?.sun().distance_au())).collect()
}

/// Where all stood at a curve's times, by a scene.
pub fn places(pass: &Pass, samples: &Samples) -> anyhow::Result<Vec<Place>> {
    let mut pass = pass.clone();
    pass.times.clone_from(&samples.time);
    pass.exposure_s.clone_from(&samples.exposure_s);
    Ok(pass.moments()?)
}
