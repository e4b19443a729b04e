//! From calibrated rates to irradiances and magnitudes, by a spectrum that is stated: a rate says how much of it there is, not what it looks like.

use super::{PhaseLaw, is_valid};
use anyhow::{Context as _, bail};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::Path;
use sunglint_formats::flag_bits::bit_names;
use sunglint_formats::time::format_utc_shortest;
use sunglint_formats::{Column, Table};
use sunglint_radiometry::air::{Air, Zenith};
use sunglint_radiometry::light::sun_at_1_au;
use sunglint_radiometry::light_curve::{Flags, LightCurve};
use sunglint_radiometry::passband::{Passband, ZeroPoint};
use sunglint_radiometry::spectrum::{Irradiance, Spectrum};
use sunglint_radiometry::star_light::{self, StarColours};
use sunglint_radiometry::station::Station;
use sunglint_report::{Product, rounded};

/// Airmasses at which the rate of the stated spectrum is computed; between them its logarithm is a line.
const NODES: usize = 33;
/// Why there is no standard magnitude.
const NO_STANDARD: &str = "the curve has no range_m or no phase_deg";

/// What one channel makes of it.
struct ChannelPhotometry {
    name: String,
    /// Mean over the band, above the air, W m⁻² nm⁻¹.
    irradiance: Vec<f64>,
    /// Standard uncertainty of the magnitude, without κ's.
    sigma_mag: Vec<f64>,
    magnitude: Vec<f64>,
    standard: Option<Vec<f64>>,
    /// The samples' own: what they say of the rate they say of the magnitude.
    flags: Vec<Flags>,
}

impl ChannelPhotometry {
    /// Smallest and largest of the valid samples.
    fn range(&self, values: &[f64]) -> Option<(f64, f64)> {
        let valid = values.iter().zip(&self.flags).filter(|(_, f)| is_valid(**f));
        ends(&valid.map(|(v, _)| *v).collect::<Vec<_>>())
    }
}

/// Irradiances and magnitudes by a stated spectrum.
pub(super) struct Photometry {
    time: Vec<String>,
    channels: Vec<ChannelPhotometry>,
    spectrum: String,
    band: String,
    zero: ZeroPoint,
    law: PhaseLaw,
}

/// A spectrum of any scale by its name: `sun`, a file, a star's type.
fn stated(name: &str) -> anyhow::Result<(Spectrum<Irradiance>, String)> {
    if name.eq_ignore_ascii_case("sun") {
        return Ok((sun_at_1_au().clone(), "the Sun's (ASTM G173-03)".into()));
    }
    let path = Path::new(name);
    if path.is_file() {
        let curve = sunglint_formats::curve::read(path, None)?;
        let spectrum = Spectrum::new(curve.x.clone(), curve.y.clone())
            .with_context(|| path.display().to_string())?;
        return Ok((spectrum, path.display().to_string()));
    }
    let colours = StarColours {
        v_mag: 0.0,
        b_minus_v_mag: None,
        spectral_type: Some(name),
        zero: ZeroPoint::default(),
    };
    let light = star_light::of(colours).with_context(|| {
        format!("--spectrum `{name}` is neither `sun`, nor a file, nor a star's type")
    })?;
    Ok((light.irradiance, light.origin.to_string()))
}

impl Photometry {
    pub fn new(
        curve: &LightCurve,
        station: &Station,
        air: &Air,
        (spectrum, band): (&str, &str),
        zero: ZeroPoint,
        law: PhaseLaw,
    ) -> anyhow::Result<Self> {
        let Some(zenith) = &curve.samples.zenith_deg else {
            bail!(
                "magnitudes and irradiances above the air need the curve's zenith_deg, which is not there"
            );
        };
        let (light, words) = stated(spectrum)?;
        let band = Passband::named(band)?;
        let mean = band.mean(&light)?;
        let table = Rates::new(&light, station, air, zenith)?;
        let channels = curve
            .channels
            .iter()
            .map(|channel| {
                let place = station.channels.iter().position(|c| c.name == channel.name);
                let place = place.with_context(|| {
                    format!("the station {} has no channel `{}`", station.name, channel.name)
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
            .collect::<anyhow::Result<Vec<_>>>()?;
        Ok(Self {
            time: curve.samples.time.iter().map(|t| format_utc_shortest(*t)).collect(),
            channels,
            spectrum: words,
            band: band.name.clone(),
            zero,
            law,
        })
    }

    pub fn product(&self) -> Product {
        let mut table = Table {
            columns: vec![Column::text("time_utc", self.time.clone())],
            ..Table::default()
        };
        let facts = [
            ("band", self.band.clone()),
            ("spectrum", self.spectrum.clone()),
            ("zero_point", self.zero.to_string()),
            (
                "standard_magnitude",
                if self.channels.iter().any(|c| c.standard.is_some()) {
                    format!(
                        "at 1000 km and a phase angle of 90 deg, phase law: {}",
                        self.law.name()
                    )
                } else {
                    format!("none: {NO_STANDARD}")
                },
            ),
            (
                "note",
                "above the air; sigma without that of kappa, which is common to all samples".into(),
            ),
        ];
        facts
            .into_iter()
            .for_each(|(key, value)| drop(table.meta.insert(key.into(), json!(value))));
        table.meta.insert("flag_bits".into(), bit_names::<Flags>());
        for c in &self.channels {
            let mut push = |suffix: &str, unit: &str, values: &[f64]| {
                table.columns.push(Column::f64(
                    format!("{}_{suffix}", c.name),
                    Some(unit),
                    values.to_vec(),
                ));
            };
            push("irradiance_w_m2_nm", "W / (m2 nm)", &c.irradiance);
            push("mag", "mag", &c.magnitude);
            push("sigma_mag", "mag", &c.sigma_mag);
            if let Some(standard) = &c.standard {
                push("standard_mag", "mag", standard);
            }
            let bits = c.flags.iter().map(|f| i64::from(f.bits())).collect();
            table.columns.push(Column::i64(format!("{}_flags", c.name), None, bits));
        }
        Product { name: "photometry".into(), table, json: self.json(), ..Product::default() }
    }

    pub fn text(&self) -> String {
        let mut text = format!(
            "{} above the air, {}, by the spectrum {}\n",
            self.band, self.zero, self.spectrum,
        );
        let known = self.channels.iter().any(|c| c.standard.is_some());
        text.push_str(&if known {
            format!("standard magnitudes at 1,000 km and 90°, phase law: {}\n", self.law.name())
        } else {
            format!("no standard magnitudes: {NO_STANDARD}\n")
        });
        for c in &self.channels {
            let range = |values: &Vec<f64>| c.range(values);
            let (Some((least, most)), Some((dim, bright))) =
                (range(&c.magnitude), range(&c.irradiance))
            else {
                let _ = writeln!(text, "  {:<10} no valid sample with light", c.name);
                continue;
            };
            let standard = c.standard.as_ref().and_then(range);
            let standard =
                standard.map_or(String::new(), |(a, b)| format!("; standard {a:.3} to {b:.3} mag"));
            let _ = writeln!(
                text,
                "  {:<10} {least:.3} to {most:.3} mag; {dim:.4e} to {bright:.4e} W/m2/nm{standard}",
                c.name
            );
        }
        text
    }

    pub fn json(&self) -> Value {
        let channel = |c: &ChannelPhotometry| {
            let range =
                |values: &[f64]| c.range(values).map(|(a, b)| json!([rounded(a), rounded(b)]));
            json!({
                "channel": c.name, "magnitude_range": range(&c.magnitude), "irradiance_range_w_m2_nm": range(&c.irradiance),
                "standard_magnitude_range": c.standard.as_deref().and_then(range),
            })
        };
        json!({
            "band": self.band, "zero_point": self.zero.to_string(), "spectrum": self.spectrum, "phase_law": self.law.name(),
            "channels": self.channels.iter().map(channel).collect::<Vec<_>>(),
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
    ) -> anyhow::Result<Self> {
        let of =
            |z: f64| Ok::<_, anyhow::Error>(air.air_masses(&air.path(Zenith::True(z))?).rayleigh);
        let airmass = zenith
            .iter()
            .map(|z| of(*z))
            .collect::<anyhow::Result<Vec<f64>>>()
            .context("the way of the light through the air")?;
        let (low, high) = ends(zenith).context("the light curve has no sample")?;
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
