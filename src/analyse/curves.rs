//! The light curves that are asked about: files of the schema, or plain columns.

use crate::air::AirModelArgs;
use crate::curve_file::Magnitudes;
use crate::station::StationArgs;
use anyhow::{Context as _, bail};
use clap::{Args, ValueEnum};
use hifitime::Epoch;
use serde_json::{Value, json};
use std::path::PathBuf;
use sunglint_analysis::series::Series;
use sunglint_analysis::trend::{self, Ways};
use sunglint_formats::nearest_names;
use sunglint_radiometry::air::Air;
use sunglint_radiometry::light::sun_at_1_au;
use sunglint_radiometry::light_curve::published::CurveFile;
use sunglint_radiometry::light_curve::{Input, LightCurve};
use sunglint_radiometry::station::Station;

/// Which curves, and which channels of them.
#[derive(Debug, Args)]
pub struct CurveArgs {
    /// Light curves (ECSV, as `simulate`, `reduce` and `apply` write them), or tables of magnitudes (MMT-9's text format, CSV with `time_utc` and `magnitude`).
    /// Several are taken together: each with brightnesses of its own, one period for all
    #[arg(required = true, value_name = "CURVE")]
    pub curves: Vec<PathBuf>,
    /// Of this channel alone; may be given several times [default: all]
    #[arg(long, value_name = "NAME")]
    pub channel: Vec<String>,
    /// Do not remove this from the light: `air`, `range`, `phase` (the slow change with phase angle); may be given several times [default: all is removed that the
    /// curve has columns for; the air if there is a station too]
    #[arg(long, value_name = "WHAT")]
    pub keep: Vec<Keep>,
    /// How a table of magnitudes is read.
    #[command(flatten)]
    pub magnitudes: Magnitudes,
    /// Which station: its channels and its air.
    #[command(flatten)]
    pub station: StationArgs,
    /// What is known of the air.
    #[command(flatten)]
    pub model: AirModelArgs,
}

/// What may stay in the light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Keep {
    /// The air's extinction
    Air,
    /// The square of the range
    Range,
    /// The slow change with phase angle
    Phase,
}

/// A curve and its file.
pub struct Curve {
    /// What the file held.
    pub curve: LightCurve,
    /// The file's name without folder and extension.
    pub stem: String,
    /// Whether these are published magnitudes, which are above the air.
    pub magnitudes: bool,
}

/// The curves of a question.
pub struct Curves {
    /// One for each file.
    pub curves: Vec<Curve>,
    /// The files.
    pub inputs: Vec<Input>,
    /// The moment from which seconds count: the first sample's.
    pub zero: Epoch,
    /// What was removed from the light, by word.
    pub removed: Vec<String>,
    /// What could not be removed, and why.
    pub warnings: Vec<String>,
    channels: Vec<String>,
}

impl CurveArgs {
    /// Reads them.
    ///
    /// # Errors
    /// A file that is no light curve, or has no sample; a channel that none of them has.
    pub fn read(&self) -> anyhow::Result<Curves> {
        let mut inputs = Vec::new();
        let mut curves = Vec::new();
        for path in &self.curves {
            let bytes = sunglint_formats::read::bytes(path)?;
            let sha256 = sunglint_formats::sha256(&bytes);
            inputs.push(Input { file: path.display().to_string(), sha256 });
            let text = sunglint_formats::read::decode(path, bytes)?;
            let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let (curve, magnitudes) = match self.magnitudes.read(path, &text)? {
                CurveFile::Rates(table) => (LightCurve::from_table(path, &table)?, false),
                CurveFile::Magnitudes(brightness) => (brightness.light_curve(&stem), true),
            };
            curves.push(Curve { curve, stem, magnitudes });
        }
        let first = curves.iter().flat_map(|c| &c.curve.samples.time).min().copied();
        let zero = first.with_context(|| {
            format!("{}: the light curve has no sample", self.curves[0].display())
        })?;
        let names: Vec<&str> =
            curves.iter().flat_map(|c| c.curve.channels.iter().map(|c| c.name.as_str())).collect();
        for wanted in &self.channel {
            if !names.contains(&wanted.as_str()) {
                let near = nearest_names(wanted, names.iter().copied(), 3).join(", ");
                bail!("--channel {wanted}: no curve has it; the nearest are {near}");
            }
        }
        let channels = self.channel.clone();
        let (removed, warnings) = (Vec::new(), Vec::new());
        let mut curves = Curves { curves, inputs, zero, removed, warnings, channels };
        self.remove_trends(&mut curves)?;
        Ok(curves)
    }

    /// Divides the rates by what the pass did to them.
    fn remove_trends(&self, curves: &mut Curves) -> anyhow::Result<()> {
        let keeps = |what| self.keep.contains(&what);
        let station = if keeps(Keep::Air) { None } else { self.station.find()? };
        let (mut removed, mut warnings) = (Vec::new(), Vec::new());
        let note = |list: &mut Vec<String>, text: String| {
            if !list.contains(&text) {
                list.push(text);
            }
        };
        let rates = curves.curves.iter().any(|c| !c.magnitudes);
        if !keeps(Keep::Air) && station.is_none() && rates {
            note(&mut warnings, "the air is not removed: no station says through which air and with which channels (--station; --keep air to say nothing)".into());
        }
        let air = match &station {
            Some(s) => Some(self.model.air(s.site.geodetic().height_m, Some(s))?),
            None => None,
        };
        for curve in &mut curves.curves {
            let name = curve.stem.clone();
            let above = curve.magnitudes;
            let curve = &mut curve.curve;
            let range = (!keeps(Keep::Range)).then(|| trend::range_factor(curve));
            for c in 0..curve.channels.len() {
                if let (Some(station), Some(air), false) = (&station, &air, above) {
                    match air_of(curve, c, station, air) {
                        Ok(factor) => {
                            trend::divide(&mut curve.channels[c], &factor);
                            note(&mut removed, format!("air ({})", air.describe()));
                        }
                        Err(error) => {
                            let channel = &curve.channels[c].name;
                            note(
                                &mut warnings,
                                format!("{name} {channel}: the air is not removed: {error:#}"),
                            );
                        }
                    }
                }
                match &range {
                    Some(Ok(factor)) => {
                        trend::divide(&mut curve.channels[c], factor);
                        note(&mut removed, "range (to 1,000 km)".into());
                    }
                    Some(Err(error)) => {
                        note(&mut warnings, format!("{name}: the range is not removed: {error}"))
                    }
                    None => {}
                }
                if !keeps(Keep::Phase) {
                    match trend::phase_trend(curve, &curve.channels[c]) {
                        Ok(found) => {
                            trend::divide(&mut curve.channels[c], &found.factor);
                            note(&mut removed, "phase trend".into());
                        }
                        Err(error) => note(
                            &mut warnings,
                            format!("{name}: the phase trend is not removed: {error}"),
                        ),
                    }
                }
            }
        }
        (curves.removed, curves.warnings) = (removed, warnings);
        Ok(())
    }
}

/// What the air leaves of sunlight in a channel. A sample at or below the horizon has no light to speak of: it has to be flagged, and is not looked at.
fn air_of(curve: &LightCurve, c: usize, station: &Station, air: &Air) -> anyhow::Result<Vec<f64>> {
    let channel = &curve.channels[c];
    let known = station.channel(&channel.name).with_context(|| {
        format!("the station {} has no channel `{}`", station.name, channel.name)
    })?;
    let zenith = curve.samples.zenith_deg.as_ref().context("the light curve has no zenith_deg")?;
    let above: Vec<f64> = zenith.iter().copied().filter(|z| *z <= 90.0).collect();
    let factors = trend::air_factor(station, known, sun_at_1_au(), air, &above, Ways::Once)?;
    let mut factors = factors.into_iter();
    let below = zenith.iter().zip(&channel.flags).find(|(z, flags)| **z > 90.0 && flags.is_empty());
    if let Some((z, _)) = below {
        bail!("a sample without a flag lies below the horizon, at a zenith angle of {z:.3} deg");
    }
    Ok(zenith
        .iter()
        .map(|z| if *z <= 90.0 { factors.next().unwrap_or(1.0) } else { 1.0 })
        .collect())
}

impl Curves {
    /// The series of all channels that are asked for, by file.
    ///
    /// # Errors
    /// A channel that is not as long as its curve.
    pub fn series(&self) -> anyhow::Result<Vec<Series>> {
        let all: anyhow::Result<Vec<_>> =
            (0..self.curves.len()).map(|k| self.series_of(k)).collect();
        Ok(all?.concat())
    }

    /// Those of one file.
    fn series_of(&self, file: usize) -> anyhow::Result<Vec<Series>> {
        let curve = &self.curves[file];
        let asked = |name: &String| self.channels.is_empty() || self.channels.contains(name);
        let channels = curve.curve.channels.iter().filter(|c| asked(&c.name));
        channels
            .map(|channel| {
                let name = match self.curves.len() {
                    1 => channel.name.clone(),
                    _ => format!("{} {}", curve.stem, channel.name),
                };
                Ok(Series::of_channel(name, &curve.curve, channel, self.zero)?)
            })
            .collect()
    }

    /// The same, parted where no channel of a file has a sample for longer than `gap_s`, and how many tracks a file has at most. Each track is a series of its own: turns in the gaps are not counted.
    ///
    /// # Errors
    /// As [`Curves::series`].
    pub fn tracks(&self, gap_s: f64) -> anyhow::Result<(Vec<Series>, usize)> {
        let mut all = Vec::new();
        let mut most = 1;
        for (k, curve) in self.curves.iter().enumerate() {
            let mut times: Vec<f64> =
                curve.curve.samples.time.iter().map(|t| (*t - self.zero).to_seconds()).collect();
            times.sort_by(f64::total_cmp);
            let gaps = times.windows(2).filter(|t| t[1] - t[0] > gap_s);
            let mut edges = vec![f64::NEG_INFINITY];
            edges.extend(gaps.map(|t| 0.5 * (t[0] + t[1])));
            edges.push(f64::INFINITY);
            let tracks = edges.len() - 1;
            most = most.max(tracks);
            for series in self.series_of(k)? {
                if tracks == 1 {
                    all.push(series);
                    continue;
                }
                let piece = |(i, edge): (usize, &[f64])| {
                    series.piece(format!("{} track {}", series.name, i + 1), edge[0], edge[1])
                };
                all.extend(edges.windows(2).enumerate().map(piece).filter(|s| !s.is_empty()));
            }
        }
        Ok((all, most))
    }

    /// The files as the result names them.
    pub fn inputs_json(&self) -> Value {
        self.inputs.iter().map(|i| json!({ "file": i.file, "sha256": i.sha256 })).collect()
    }

    /// The first file's name, for titles.
    pub fn title(&self) -> String {
        match self.curves.as_slice() {
            [only] => only.stem.clone(),
            [first, others @ ..] => format!("{} and {} more", first.stem, others.len()),
            [] => String::new(),
        }
    }
}
