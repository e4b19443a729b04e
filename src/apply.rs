//! `sunglint apply`: a linear light curve times κ; magnitudes and irradiances by a stated spectrum.

mod photometry;

use crate::air::AirModelArgs;
use crate::output::{Console, OutputArgs};
use crate::station::StationArgs;
use anyhow::{Context as _, bail};
use clap::{Args, ValueEnum};
use photometry::Photometry;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::PathBuf;
use sunglint_calibration::stars::{NightFile, Nights, USUAL_EXPONENT, night_of};
use sunglint_radiometry::air::{Aerosol, Air, AirOptions};
use sunglint_radiometry::light_curve::TOLERATED;
use sunglint_radiometry::light_curve::{ChannelCurve, Flags, Input, LightCurve, RateKind};
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::station::Station;
use sunglint_report::plot::{Axis, Figure, Panel, Series};
use sunglint_report::{Product, rounded};

/// Arguments of `sunglint apply`.
#[derive(Debug, Args)]
pub struct ApplyArgs {
    /// What `sunglint calibrate` wrote
    pub calibration: PathBuf,
    /// A linear light curve
    pub curve: PathBuf,
    /// The night whose kappa to use, as 2020-11-18 [default: the curve's own]
    #[arg(long, value_name = "DATE")]
    pub night: Option<String>,
    /// The light's spectrum above the air, by which rates become irradiances: `sun`, a star's type (`G2V`), or a curve's file
    #[arg(long, value_name = "SPECTRUM")]
    pub spectrum: Option<String>,
    /// Magnitudes in a band (`V`, `Gaia_G`; see `sunglint tables`); of sunlight unless --spectrum says otherwise
    #[arg(long, value_name = "BAND")]
    pub magnitudes: Option<String>,
    /// How the brightness goes with phase angle, for magnitudes at 1,000 km and a phase angle of 90°
    #[arg(long, value_enum, default_value_t)]
    pub phase_law: PhaseLaw,
    /// Also write magnitudes and irradiances, as a table
    #[arg(long, value_name = "FILE")]
    pub photometry_out: Vec<PathBuf>,
    /// Magnitude of Vega that magnitudes count from, or `ab`
    #[arg(long, value_name = "ZERO", default_value = "vega=0.03")]
    pub zero_point: ZeroPoint,
    /// Which station.
    #[command(flatten)]
    pub station: StationArgs,
    /// What is known of the air.
    #[command(flatten)]
    pub model: AirModelArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// A law of phase angle, 1 at 90°.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum PhaseLaw {
    /// As a Lambert sphere: sin γ + (π − γ) cos γ
    #[default]
    Lambert,
    /// As the illuminated fraction of the disc: 1 + cos γ
    Illuminated,
}

impl PhaseLaw {
    fn name(self) -> &'static str {
        match self {
            PhaseLaw::Lambert => "Lambert sphere",
            PhaseLaw::Illuminated => "illuminated fraction",
        }
    }

    fn at(self, phase_rad: f64) -> f64 {
        match self {
            PhaseLaw::Lambert => {
                phase_rad.sin() + (std::f64::consts::PI - phase_rad) * phase_rad.cos()
            }
            PhaseLaw::Illuminated => 1.0 + phase_rad.cos(),
        }
    }
}

/// Applies.
pub fn run(args: &ApplyArgs, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    let others = OutputArgs { output: args.photometry_out.clone(), force: args.out.force };
    others.check()?;
    if !args.photometry_out.is_empty() && args.magnitudes.is_none() && args.spectrum.is_none() {
        bail!(
            "--photometry-out needs --magnitudes BAND or --spectrum SPECTRUM: nothing else is photometry"
        );
    }
    let (table, calibration_input) = read(&args.calibration)?;
    let nights = Nights::from_table(&args.calibration, &table)?;
    let (table, curve_input) = read(&args.curve)?;
    let linear = LightCurve::from_table(&args.curve, &table)?;
    if linear.kind != RateKind::Linear {
        bail!("{}: its rates are {}, expected linear", args.curve.display(), linear.kind);
    }
    let station = args.station.get()?;
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
    let night = args.night(&nights, &linear, &station, &mut warnings)?;
    let curve =
        calibrated(&linear, night, &nights, [calibration_input, curve_input], &mut warnings)?;
    let photometry = args.photometry(&curve, &station, (&nights, night), &mut warnings)?;
    for warning in &warnings {
        console.warn(warning);
    }
    let answer =
        Answer { curve: &curve, night, photometry, station: &station, warnings: &warnings };
    let product = answer.product()?;
    let files = match &answer.photometry {
        Some(photometry) => others.files_of(&photometry.product())?,
        None => Vec::new(),
    };
    args.out.finish_with(&product, files, &answer.text(), console)
}

/// Whether nothing that a sample's flags say changes its rate.
fn is_valid(flags: Flags) -> bool {
    flags.difference(TOLERATED).is_empty()
}

/// A table, and the file that it was.
fn read(path: &std::path::Path) -> anyhow::Result<(sunglint_formats::Table, Input)> {
    let bytes = sunglint_formats::read::bytes(path)?;
    let input =
        Input { file: path.display().to_string(), sha256: sunglint_formats::sha256(&bytes) };
    let text = sunglint_formats::read::decode(path, bytes)?;
    Ok((sunglint_formats::ecsv::read_str(path, &text)?, input))
}

impl ApplyArgs {
    fn night<'a>(
        &self,
        nights: &'a Nights,
        curve: &LightCurve,
        station: &Station,
        warnings: &mut Vec<String>,
    ) -> anyhow::Result<&'a NightFile> {
        let first = curve.samples.time.first().context("the light curve has no sample")?;
        let own = night_of(*first, station.site.geodetic().longitude_deg);
        let wanted = self.night.as_ref().unwrap_or(&own);
        if *wanted != own {
            warnings.push(format!(
                "the curve is of the night of {own}, kappa of that of {wanted}: kappa changes from night to night, by more than its uncertainty"
            ));
        }
        let known =
            || nights.nights.iter().map(|n| n.night.as_str()).collect::<Vec<_>>().join(", ");
        nights.nights.iter().find(|n| n.night == *wanted).with_context(|| {
            format!("no calibration of the night of {wanted}: the file has {}; kappa changes from night to night, --night takes another's all the same", known())
        })
    }

    fn photometry(
        &self,
        curve: &LightCurve,
        station: &Station,
        (nights, night): (&Nights, &NightFile),
        warnings: &mut Vec<String>,
    ) -> anyhow::Result<Option<Photometry>> {
        if self.magnitudes.is_none() && self.spectrum.is_none() {
            return Ok(None);
        }
        let height_m = station.site.geodetic().height_m;
        let mut air = self.model.air(height_m, Some(station))?;
        if air.describe() != nights.air {
            warnings.push(format!(
                "kappa was found with the air `{}`, magnitudes and irradiances are now with `{}`",
                nights.air,
                air.describe()
            ));
        }
        // What was fitted with κ belongs to it.
        if let (None, Some([depth, _])) = (self.model.aerosol, night.facts.aerosol_depth) {
            let aerosol = Aerosol::Angstrom {
                optical_depth: depth,
                wavelength_nm: 550.0,
                exponent: night.facts.aerosol_exponent.unwrap_or(USUAL_EXPONENT),
                scale_height_m: 1800.0,
            };
            air = Air::new(&AirOptions { aerosol, ..air.options().clone() })?;
        }
        let spectrum = self.spectrum.as_deref().unwrap_or("sun");
        let band = self.magnitudes.as_deref().unwrap_or("V");
        let found = Photometry::new(
            curve,
            station,
            &air,
            (spectrum, band),
            self.zero_point,
            self.phase_law,
        )?;
        Ok(Some(found))
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
) -> anyhow::Result<LightCurve> {
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
        let names = |all: &mut dyn Iterator<Item = &str>| all.collect::<Vec<_>>().join(", ");
        bail!(
            "the calibration has none of the curve's channels: there are {}, here {}",
            names(&mut night.channels.iter().map(|c| c.channel.as_str())),
            names(&mut linear.channels.iter().map(|c| c.name.as_str()))
        );
    }
    for channel in &mut curve.channels {
        let Some(row) = night.channel(&channel.name) else { continue };
        channel.rate_hz.iter_mut().for_each(|v| *v *= row.kappa);
        channel.sigma_hz.iter_mut().for_each(|v| *v *= row.kappa);
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

/// What came out.
struct Answer<'a> {
    curve: &'a LightCurve,
    night: &'a NightFile,
    photometry: Option<Photometry>,
    station: &'a Station,
    warnings: &'a [String],
}

impl Answer<'_> {
    fn product(&self) -> anyhow::Result<Product> {
        Ok(Product {
            name: "calibrated".into(),
            table: self.curve.to_table()?,
            figure: Some(self.figure()),
            json: self.json(),
            others: self.photometry.iter().map(Photometry::product).collect(),
            ..Product::default()
        })
    }

    fn figure(&self) -> Figure {
        let first = self.curve.samples.time[0];
        let seconds: Vec<f64> =
            self.curve.samples.time.iter().map(|t| (*t - first).to_seconds()).collect();
        let colours = sunglint_report::calibrate::colours(self.station);
        let mut series = Vec::new();
        for (i, channel) in self.curve.channels.iter().enumerate() {
            let all = seconds.iter().copied().zip(channel.rate_hz.iter().copied());
            let valid = all.zip(&channel.flags).filter(|(_, flags)| is_valid(**flags));
            let dots = Series::dots(channel.name.clone(), i, valid.map(|(p, _)| p).collect());
            let place = self.station.channels.iter().position(|c| c.name == channel.name);
            series.push(match place {
                Some(place) => dots.with_colour(colours[place]),
                None => dots,
            });
        }
        let since = sunglint_formats::time::format_utc_shortest(first);
        let x = Axis::linear(format!("s since {since}"));
        let panel = Panel::new(x, Axis::log("calibrated rate (Hz)"), series);
        Figure {
            title: format!("{}, calibrated, night of {}", self.target(), self.night.night),
            panels: vec![panel],
        }
    }

    /// The target's name: of the provenance, else of the metadata `target`.
    fn target(&self) -> &str {
        let own = self.curve.provenance.target.as_str();
        let named = || self.curve.other.get("target")?.get("name")?.as_str();
        if own.is_empty() { named().unwrap_or("a target without a name") } else { own }
    }

    /// Each channel's mean over the valid samples, and their number.
    fn means(&self) -> Vec<(&str, usize, f64)> {
        let mean = |c: &ChannelCurve| {
            let all = c.rate_hz.iter().zip(&c.flags);
            let known: Vec<f64> =
                all.filter(|(v, f)| v.is_finite() && is_valid(**f)).map(|(v, _)| *v).collect();
            (known.len(), known.iter().sum::<f64>() / known.len() as f64)
        };
        let channels = self.curve.channels.iter();
        channels.map(|c| (c.name.as_str(), mean(c))).map(|(n, (k, m))| (n, k, m)).collect()
    }

    fn text(&self) -> String {
        let mut text = format!(
            "{}: {} samples, kappa of the night of {}\n",
            self.target(),
            self.curve.len(),
            self.night.night
        );
        for (name, samples, mean) in self.means() {
            let row = self.night.channel(name);
            let (kappa, sigma) = row.map_or((f64::NAN, f64::NAN), |r| (r.kappa, r.relative_sigma));
            let _ = writeln!(
                text,
                "  {name:<10} kappa {kappa:>10.4} ± {:.2} %   {samples} valid samples, mean {mean:.4e} Hz",
                100.0 * sigma
            );
        }
        if let Some(photometry) = &self.photometry {
            text.push_str(&photometry.text());
        }
        text
    }

    fn json(&self) -> Value {
        let number = |v: f64| if v.is_finite() { json!(rounded(v)) } else { Value::Null };
        let channel = |(name, samples, mean): (&str, usize, f64)| {
            let row = self.night.channel(name);
            json!({
                "channel": name, "samples": samples, "mean_rate_hz": number(mean),
                "kappa": row.map(|r| rounded(r.kappa)), "relative_sigma": row.map(|r| rounded(r.relative_sigma)),
            })
        };
        json!({
            "target": self.target(),
            "night": self.night.night,
            "channels": self.means().into_iter().map(channel).collect::<Vec<_>>(),
            "photometry": self.photometry.as_ref().map(Photometry::json),
            "warnings": self.warnings,
        })
    }
}
