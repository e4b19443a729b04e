//! From calibrated rates to irradiances and magnitudes, by a spectrum that is stated: a rate says how much of it there is, not what it looks like.

use super::{ApplyError, PhaseLaw, is_valid};
use hifitime::Epoch;
use std::path::Path;
use sunglint_radiometry::air::{Air, AirError, Zenith};
use sunglint_radiometry::light::sun_at_1_au;
use sunglint_radiometry::light_curve::{Flags, LightCurve};
use sunglint_radiometry::passband::{Passband, ZeroPoint};
use sunglint_radiometry::spectrum::{Irradiance, Spectrum};
use sunglint_radiometry::star_light::{self, StarColours};
use sunglint_radiometry::station::Station;

/// Airmasses at which the rate of the stated spectrum is computed; between them its logarithm is a line.
const NODES: usize = 33;
/// Irradiances and magnitudes by one channel.
#[derive(Debug, Clone)]
pub struct ChannelPhotometry {
    /// Name of the channel.
    pub name: String,
    /// Mean over the band, above the air, W m⁻² nm⁻¹.
    pub irradiance: Vec<f64>,
    /// Standard uncertainty of the magnitude, without κ's.
    pub sigma_mag: Vec<f64>,
    /// Magnitude above the air.
    pub magnitude: Vec<f64>,
    /// Magnitude at 1,000 km and a phase angle of 90°; `None` of a curve without ranges or phase angles.
    pub standard: Option<Vec<f64>>,
    /// The samples' own: what they say of the rate they say of the magnitude.
    pub flags: Vec<Flags>,
}

impl ChannelPhotometry {
    /// Smallest and largest of the valid samples.
    pub fn range(&self, values: &[f64]) -> Option<(f64, f64)> {
        let valid = values.iter().zip(&self.flags).filter(|(_, f)| is_valid(**f));
        ends(&valid.map(|(v, _)| *v).collect::<Vec<_>>())
    }
}

/// Irradiances and magnitudes by a stated spectrum.
#[derive(Debug, Clone)]
pub struct Photometry {
    /// Middle of each sample's exposure.
    pub time: Vec<Epoch>,
    /// By channel of the curve.
    pub channels: Vec<ChannelPhotometry>,
    /// The spectrum in words.
    pub spectrum: String,
    /// The band's name.
    pub band: String,
    /// Zero point of the magnitudes.
    pub zero: ZeroPoint,
    /// The law of phase angle.
    pub law: PhaseLaw,
}

/// How rates become irradiances and magnitudes.
#[derive(Debug, Clone)]
pub struct PhotometryOptions {
    /// The light's spectrum above the air: `sun`, a star's type, or the path of a curve's file.
    pub spectrum: String,
    /// The band of magnitudes.
    pub band: String,
    /// Zero point of the magnitudes.
    pub zero_point: ZeroPoint,
    /// The law of phase angle.
    pub phase_law: PhaseLaw,
    /// Whether the air's aerosol holds even where one was fitted with κ.
    pub keep_aerosol: bool,
}

impl Default for PhotometryOptions {
    fn default() -> Self {
        Self {
            spectrum: "sun".into(),
            band: "V".into(),
            zero_point: ZeroPoint::default(),
            phase_law: PhaseLaw::default(),
            keep_aerosol: false,
        }
    }
}

/// A spectrum of any scale by its name: `sun`, a file, a star's type.
fn stated(name: &str) -> Result<(Spectrum<Irradiance>, String), ApplyError> {
    if name.eq_ignore_ascii_case("sun") {
        return Ok((sun_at_1_au().clone(), "the Sun's (ASTM G173-03)".into()));
    }
    let path = Path::new(name);
    if path.is_file() {
        let curve = sunglint_formats::curve::read(path, None)?;
        let spectrum = Spectrum::new(curve.x.clone(), curve.y.clone())
            .map_err(|source| ApplyError::SpectrumFile { path: path.to_path_buf(), source })?;
        return Ok((spectrum, path.display().to_string()));
    }
    let colours = StarColours {
        v_mag: 0.0,
        b_minus_v_mag: None,
        spectral_type: Some(name),
        zero: ZeroPoint::default(),
    };
    let light = star_light::of(colours)
        .map_err(|source| ApplyError::Spectrum { name: name.to_owned(), source })?;
    Ok((light.irradiance, light.origin.to_string()))
}

impl Photometry {
    /// Irradiances and magnitudes of a calibrated curve.
    ///
    /// # Errors
    /// A curve without zenith angles or samples, a spectrum or a band that is not known, a channel that the station has not.
    pub fn new(
        curve: &LightCurve,
        station: &Station,
        air: &Air,
        options: &PhotometryOptions,
    ) -> Result<Self, ApplyError> {
        let (zero, law) = (options.zero_point, options.phase_law);
        let Some(zenith) = &curve.samples.zenith_deg else { return Err(ApplyError::NoZenith) };
        let (light, words) = stated(&options.spectrum)?;
        let band = Passband::named(&options.band)?;
        let mean = band.mean(&light)?;
        let table = Rates::new(&light, station, air, zenith)?;
        let channels = curve
            .channels
            .iter()
            .map(|channel| {
                let place = station.channels.iter().position(|c| c.name == channel.name);
                let place = place.ok_or_else(|| ApplyError::UnknownChannel {
                    channel: channel.name.clone(),
                    station: station.name.clone(),
                })?;
                let expected = table.of(place);
                let scale = |i: usize| channel.rate_hz[i] / expected[i];
                let n = curve.len();
                let irradiance: Vec<f64> = (0..n).map(|i| mean * scale(i)).collect();
                let zero_irradiance = band.zero_irradiance(zero)?;
                // A rate that is not above 0 has no magnitude.
                let magnitude: Vec<f64> = irradiance
                    .iter()
                    .map(|e| if *e > 0.0 { -2.5 * (e / zero_irradiance).log10() } else { f64::NAN })
                    .collect();
                let sigma = |i: usize| {
                    let relative = channel.sigma_hz[i] / channel.rate_hz[i];
                    if channel.rate_hz[i] > 0.0 {
                        2.5 / std::f64::consts::LN_10 * relative
                    } else {
                        f64::NAN
                    }
                };
                let standard = standard(curve, &magnitude, law);
                Ok(ChannelPhotometry {
                    name: channel.name.clone(),
                    sigma_mag: (0..n).map(sigma).collect(),
                    irradiance,
                    magnitude,
                    standard,
                    flags: channel.flags.clone(),
                })
            })
            .collect::<Result<Vec<_>, ApplyError>>()?;
        Ok(Self {
            time: curve.samples.time.clone(),
            channels,
            spectrum: words,
            band: band.name.clone(),
            zero,
            law,
        })
    }
}

/// Smallest and largest number.
fn ends(values: &[f64]) -> Option<(f64, f64)> {
    let known = || values.iter().copied().filter(|v| v.is_finite());
    Some((known().reduce(f64::min)?, known().reduce(f64::max)?))
}

/// Magnitudes at 1,000 km and a phase angle of 90°; `None` without ranges or phase angles.
fn standard(curve: &LightCurve, magnitude: &[f64], law: PhaseLaw) -> Option<Vec<f64>> {
    let (range, phase) = (curve.samples.range_m.as_ref()?, curve.samples.phase_deg.as_ref()?);
    let at = |((m, r), p): ((&f64, &f64), &f64)| {
        let by_phase = law.at(p.to_radians());
        // At a phase angle of 180° the law has no light left.
        if by_phase > 1e-9 {
            m - 5.0 * (r / 1e6).log10() + 2.5 * by_phase.log10()
        } else {
            f64::NAN
        }
    };
    Some(magnitude.iter().zip(range).zip(phase).map(at).collect())
}

/// Rates of a spectrum in all channels through the air at many zenith angles.
struct Rates {
    /// Airmass of each sample.
    airmass: Vec<f64>,
    nodes: Vec<f64>,
    /// ln of the rate, by channel and node.
    ln_rate: Vec<Vec<f64>>,
}

impl Rates {
    fn new(
        light: &Spectrum<Irradiance>,
        station: &Station,
        air: &Air,
        zenith: &[f64],
    ) -> Result<Self, ApplyError> {
        let of = |z: f64| Ok::<_, AirError>(air.air_masses(&air.path(Zenith::True(z))?).rayleigh);
        let airmass = zenith
            .iter()
            .map(|z| of(*z))
            .collect::<Result<Vec<f64>, AirError>>()
            .map_err(ApplyError::Path)?;
        let (low, high) = ends(zenith).ok_or(ApplyError::NoSample)?;
        let (mut nodes, mut ln_rate) = (Vec::new(), vec![Vec::new(); station.channels.len()]);
        let (first, last) = (of(low)?, of(high)?);
        for k in 0..NODES {
            // Even in airmass as nearly as a plane air makes it.
            let x = first + (last - first) * k as f64 / (NODES - 1) as f64;
            let z = if k == 0 {
                low
            } else if k == NODES - 1 {
                high
            } else {
                (1.0 / x.max(1.0)).acos().to_degrees().clamp(low, high)
            };
            let node = of(z)?;
            if nodes.last().is_some_and(|previous| node <= *previous + 1e-9) {
                continue;
            }
            nodes.push(node);
            let transmission = air.spectrum(Zenith::True(z), light.range_nm())?;
            for (channel, ln_rate) in station.channels.iter().zip(&mut ln_rate) {
                ln_rate.push(station.rate_hz(channel, light, Some(&transmission)).value.ln());
            }
        }
        Ok(Self { airmass, nodes, ln_rate })
    }

    /// The rates of a channel in all samples, Hz.
    fn of(&self, channel: usize) -> Vec<f64> {
        let (nodes, values) = (&self.nodes, &self.ln_rate[channel]);
        let at = |x: &f64| {
            let upper = nodes.partition_point(|n| n < x).min(nodes.len() - 1);
            let lower = upper.saturating_sub(1);
            if upper == lower {
                return values[upper].exp();
            }
            let f = (x - nodes[lower]) / (nodes[upper] - nodes[lower]);
            (values[lower] + f * (values[upper] - values[lower])).exp()
        };
        self.airmass.iter().map(at).collect()
    }
}
