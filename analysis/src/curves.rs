//! Light curves of several files on one clock, and what their passes did to the light removed.

use crate::series::{Series, SeriesError};
use crate::trend::{self, TrendError, Ways};
use hifitime::Epoch;
use std::error::Error;
use std::path::{Path, PathBuf};
use sunglint_formats::{FileError, ParseError, nearest_names};
use sunglint_radiometry::air::Air;
use sunglint_radiometry::light::sun_at_1_au;
use sunglint_radiometry::light_curve::published::{
    CurveFile, Label, MagnitudeOptions, PublishedError,
};
use sunglint_radiometry::light_curve::{Input, LightCurve};
use sunglint_radiometry::station::Station;

/// Why curves cannot be taken together.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CurvesError {
    /// A file that cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// A table that is no light curve.
    #[error(transparent)]
    Parse(#[from] ParseError),
    /// A file that holds neither rates nor magnitudes.
    #[error(transparent)]
    Published(#[from] PublishedError),
    /// No file is given.
    #[error("no light curve is given")]
    NoFile,
    /// No file holds a sample.
    #[error("{}: the light curve has no sample", path.display())]
    Empty {
        /// The first file.
        path: PathBuf,
    },
    /// A channel that no curve has.
    #[error("no curve has the channel {wanted}; the nearest are {}", nearest.join(", "))]
    Channel {
        /// The channel that was asked for.
        wanted: String,
        /// Channels with similar names.
        nearest: Vec<String>,
    },
}

/// A curve and its file.
#[derive(Debug, Clone)]
pub struct NamedCurve {
    /// Light curve that the file held.
    pub curve: LightCurve,
    /// The file's name without folder and extension.
    pub stem: String,
    /// Whether these are published magnitudes, which are above the air.
    pub is_above_air: bool,
    /// Session and filter of each sample, where the file says them.
    pub labels: Option<Vec<Label>>,
}

/// Curves of one or several files, whose times count from one moment.
#[derive(Debug, Clone)]
pub struct Curves {
    /// One for each file.
    pub curves: Vec<NamedCurve>,
    /// The files.
    pub inputs: Vec<Input>,
    /// The moment from which seconds count: the first sample's.
    pub zero: Epoch,
    /// Trends that were removed from the light, in words.
    pub removed: Vec<String>,
    /// Trends that could not be removed, and why.
    pub warnings: Vec<String>,
    channels: Vec<String>,
}

/// Trends of a pass that are removed from the light.
#[derive(Debug, Clone, Copy, Default)]
pub struct Trends<'a> {
    /// The extinction of this air in the channels of this station.
    pub air: Option<(&'a Station, &'a Air)>,
    /// The square of the range.
    pub range: bool,
    /// The slow change with phase angle.
    pub phase: bool,
}

/// Why the air cannot be removed from a channel.
#[derive(Debug, thiserror::Error)]
enum AirUnknown {
    #[error("the station {station} has no channel `{channel}`")]
    Channel { station: String, channel: String },
    #[error("the light curve has no zenith_deg")]
    Zenith,
    #[error(transparent)]
    Trend(#[from] TrendError),
    #[error("a sample without a flag lies below the horizon, at a zenith angle of {0:.3} deg")]
    Below(f64),
}

/// Adds a text that is not yet in the list.
fn note(list: &mut Vec<String>, text: String) {
    if !list.contains(&text) {
        list.push(text);
    }
}

/// An error with its causes, separated by colons.
fn with_causes(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text = format!("{text}: {error}");
        cause = error.source();
    }
    text
}

/// Returns the share of sunlight that the air lets through in a channel. A sample at or below the horizon has no light to speak of: it has to be flagged, and is not looked at.
fn air_of(
    curve: &LightCurve,
    c: usize,
    station: &Station,
    air: &Air,
) -> Result<Vec<f64>, AirUnknown> {
    let channel = &curve.channels[c];
    let known = station.channel(&channel.name).ok_or_else(|| AirUnknown::Channel {
        station: station.name.clone(),
        channel: channel.name.clone(),
    })?;
    let zenith = curve.samples.zenith_deg.as_ref().ok_or(AirUnknown::Zenith)?;
    let above: Vec<f64> = zenith.iter().copied().filter(|z| *z <= 90.0).collect();
    let factors = trend::air_factor(station, known, sun_at_1_au(), air, &above, Ways::Once)?;
    let mut factors = factors.into_iter();
    let below = zenith.iter().zip(&channel.flags).find(|(z, flags)| **z > 90.0 && flags.is_empty());
    if let Some((z, _)) = below {
        return Err(AirUnknown::Below(*z));
    }
    Ok(zenith
        .iter()
        .map(|z| if *z <= 90.0 { factors.next().unwrap_or(1.0) } else { 1.0 })
        .collect())
}

/// One curve of a file.
fn read_curve(
    path: &Path,
    magnitudes: &MagnitudeOptions,
) -> Result<(NamedCurve, Input), CurvesError> {
    let bytes = sunglint_formats::read::bytes(path)?;
    let sha256 = sunglint_formats::sha256(&bytes);
    let input = Input { file: path.display().to_string(), sha256 };
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let (mut curve, is_above_air, labels) = match CurveFile::read(path, bytes, magnitudes)? {
        CurveFile::Rates(table) => (LightCurve::from_table(path, &table)?, false, None),
        CurveFile::Magnitudes(b) => (b.light_curve(&stem), true, b.used_labels()),
    };
    curve.sort();
    Ok((NamedCurve { curve, stem, is_above_air, labels }, input))
}

impl Curves {
    /// Reads light curves (ECSV) and tables of magnitudes, which `magnitudes` says how to read. `channels` are those that are looked at; none stands for all.
    ///
    /// # Errors
    /// A file that is no light curve; no sample in any file; a channel that none of them has.
    pub fn read(
        paths: &[PathBuf],
        magnitudes: &MagnitudeOptions,
        channels: &[String],
    ) -> Result<Self, CurvesError> {
        let mut inputs = Vec::new();
        let mut curves = Vec::new();
        for path in paths {
            let (curve, input) = read_curve(path, magnitudes)?;
            curves.push(curve);
            inputs.push(input);
        }
        let path = paths.first().ok_or(CurvesError::NoFile)?;
        let first = curves.iter().flat_map(|c| &c.curve.samples.time).min().copied();
        let zero = first.ok_or_else(|| CurvesError::Empty { path: path.clone() })?;
        let names: Vec<&str> =
            curves.iter().flat_map(|c| c.curve.channels.iter().map(|c| c.name.as_str())).collect();
        for wanted in channels {
            if !names.contains(&wanted.as_str()) {
                let nearest = nearest_names(wanted, names.iter().copied(), 3);
                let nearest = nearest.into_iter().map(str::to_owned).collect();
                return Err(CurvesError::Channel { wanted: wanted.clone(), nearest });
            }
        }
        let channels = channels.to_vec();
        Ok(Self { curves, inputs, zero, removed: Vec::new(), warnings: Vec::new(), channels })
    }

    /// Whether any of them holds counted rates, from which the air can be removed.
    pub fn has_rates(&self) -> bool {
        self.curves.iter().any(|c| !c.is_above_air)
    }

    /// Divides the rates by what the pass did to them. What was removed, and what could not be, is added to [`Curves::removed`] and [`Curves::warnings`].
    pub fn remove(&mut self, trends: &Trends<'_>) {
        let Self { curves, removed, warnings, .. } = self;
        for NamedCurve { curve, stem, is_above_air, .. } in curves {
            let range = trends.range.then(|| trend::range_factor(curve));
            for c in 0..curve.channels.len() {
                if let (Some((station, air)), false) = (trends.air, *is_above_air) {
                    match air_of(curve, c, station, air) {
                        Ok(factor) => {
                            trend::divide(&mut curve.channels[c], &factor);
                            note(removed, format!("air ({})", air.describe()));
                        }
                        Err(error) => {
                            let channel = &curve.channels[c].name;
                            let why = with_causes(&error);
                            note(
                                warnings,
                                format!("{stem} {channel}: the air is not removed: {why}"),
                            );
                        }
                    }
                }
                match &range {
                    Some(Ok(factor)) => {
                        trend::divide(&mut curve.channels[c], factor);
                        note(removed, "range (to 1,000 km)".into());
                    }
                    Some(Err(error)) => {
                        note(warnings, format!("{stem}: the range is not removed: {error}"));
                    }
                    None => {}
                }
                if trends.phase {
                    match trend::phase_trend(curve, &curve.channels[c]) {
                        Ok(found) => {
                            trend::divide(&mut curve.channels[c], &found.factor);
                            note(removed, "phase trend".into());
                        }
                        Err(error) => note(
                            warnings,
                            format!("{stem}: the phase trend is not removed: {error}"),
                        ),
                    }
                }
            }
        }
    }

    /// The series of all channels that are asked for, by file.
    ///
    /// # Errors
    /// A channel that is not as long as its curve.
    pub fn series(&self) -> Result<Vec<Series>, SeriesError> {
        let all: Result<Vec<_>, SeriesError> =
            (0..self.curves.len()).map(|k| self.series_of(k)).collect();
        Ok(all?.concat())
    }

    /// Those of one file.
    fn series_of(&self, file: usize) -> Result<Vec<Series>, SeriesError> {
        let curve = &self.curves[file];
        let channels = curve.curve.channels.iter().filter(|c| self.asks_for(&c.name));
        channels
            .map(|channel| {
                let name = match self.curves.len() {
                    1 => channel.name.clone(),
                    _ => format!("{} {}", curve.stem, channel.name),
                };
                Series::of_channel(name, &curve.curve, channel, self.zero)
            })
            .collect()
    }

    /// The same, parted where no channel of a file has a sample for longer than `gap_s`, and how many tracks a file has at most. Each track is a series of its own: turns in the gaps are not counted.
    ///
    /// # Errors
    /// The errors of [`Curves::series`].
    pub fn tracks(&self, gap_s: f64) -> Result<(Vec<Series>, usize), SeriesError> {
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

    /// Whether a channel of this name is asked for.
    pub fn asks_for(&self, channel: &str) -> bool {
        self.channels.is_empty() || self.channels.iter().any(|c| c == channel)
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
