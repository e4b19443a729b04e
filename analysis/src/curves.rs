//! Light curves of several files on one clock, and what their passes did to the light removed.

use crate::rounding::felt_rounding_s;
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
use sunglint_radiometry::light_curve::{ChannelCurve, Input, LightCurve, given_twice};
use sunglint_radiometry::station::Station;

/// A gap that parts the passes of a near body, s: turns over it are counted by nobody.
pub(crate) const GAP_S: f64 = 3600.0;
/// Bodies beyond it are seen from all of a night's directions alike: neither an orbit's turn nor a pass is in their light, m.
const FAR_M: f64 = 1e9;
/// Longest pass over a station of a body in a low orbit, s. Where no range is known, curves that last no longer are taken for passes.
const PASS_S: f64 = 1800.0;
/// Fewer samples are no pass but a look at a far body, as surveys take them.
const PASS_SAMPLES: usize = 30;

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
    /// Whether the file's format is one of bodies far beyond the Moon.
    pub is_far: bool,
    /// Whether the file says the exposures.
    pub is_exposure_known: bool,
    /// Step to which the file's magnitudes are rounded, mag; `None` of rates and fluxes.
    pub step_mag: Option<f64>,
}

impl NamedCurve {
    /// The filters of the samples where there are several, in the order of their names; each has a light curve of its own.
    pub fn filters(&self) -> Vec<&str> {
        let mut all: Vec<&str> = self.labels.iter().flatten().map(|l| l.filter.as_str()).collect();
        all.sort_unstable();
        all.dedup();
        if all.len() > 1 { all } else { Vec::new() }
    }

    /// The samples of one filter.
    fn of_filter(&self, filter: &str) -> LightCurve {
        let mut curve = self.curve.clone();
        let keep: Vec<bool> = self.labels.iter().flatten().map(|l| l.filter == filter).collect();
        curve.retain(&keep);
        curve
    }
}

/// A name for a filter, which may have none.
fn named(filter: &str) -> &str {
    if filter.is_empty() { "no filter" } else { filter }
}

/// The slow change of a channel's light with phase angle: what its rates are to be divided by. Filters have a change of their own.
fn phase_factor(named: &NamedCurve, c: usize) -> Result<Vec<f64>, TrendError> {
    let filters = named.filters();
    if filters.is_empty() {
        return Ok(trend::phase_trend(&named.curve, &named.curve.channels[c])?.factor);
    }
    let mut all = vec![1.0; named.curve.len()];
    for filter in filters {
        let own = named.of_filter(filter);
        let found = trend::phase_trend(&own, &own.channels[c])?;
        let places = named.labels.iter().flatten().enumerate().filter(|(_, l)| l.filter == filter);
        places.zip(found.factor).for_each(|((i, _), f)| all[i] = f);
    }
    Ok(all)
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

/// One curve of a file, and what was left out of it.
fn read_curve(
    path: &Path,
    magnitudes: &MagnitudeOptions,
) -> Result<(NamedCurve, Input, Vec<String>), CurvesError> {
    let bytes = sunglint_formats::read::bytes(path)?;
    let sha256 = sunglint_formats::sha256(&bytes);
    let input = Input { file: path.display().to_string(), sha256 };
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let (named, notes) = match CurveFile::read(path, bytes, magnitudes)? {
        CurveFile::Rates(table) => {
            let mut curve = LightCurve::from_table(path, &table)?;
            let unsure = curve.without_sigma().into_iter();
            let unsure: Vec<String> =
                unsure.map(|w| format!("{w}: all samples of its channel weigh alike")).collect();
            curve.sort();
            let mut named = NamedCurve {
                curve,
                stem,
                is_above_air: false,
                labels: None,
                is_far: false,
                is_exposure_known: true,
                step_mag: None,
            };
            let doubled = named.curve.drop_doubled();
            let note = (doubled > 0).then(|| given_twice(doubled, "flags"));
            (named, note.into_iter().chain(unsure).collect())
        }
        // In the order of time already, and the labels with it.
        CurveFile::Magnitudes(mut b) => {
            let named = NamedCurve {
                curve: b.light_curve(&stem),
                stem,
                is_above_air: true,
                labels: b.used_labels(),
                is_far: b.is_far,
                is_exposure_known: b.is_exposure_known,
                step_mag: b.step_mag,
            };
            (named, std::mem::take(&mut b.notes))
        }
    };
    let mut notes: Vec<String> = notes;
    if let Some(first) = named.curve.samples.time.first() {
        let times: Vec<f64> =
            named.curve.samples.time.iter().map(|t| (*t - *first).to_seconds()).collect();
        if let Some(step_s) = felt_rounding_s(&times) {
            notes.push(format!(
                "times are rounded to {step_s} s, which is more than a twentieth of the step between samples: they are no better than that"
            ));
        }
    }
    let notes = notes.into_iter().map(|note| format!("{}: {note}", named.stem)).collect();
    Ok((named, input, notes))
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
        let (mut curves, mut warnings) = (Vec::new(), Vec::new());
        for path in paths {
            let (curve, input, notes) = read_curve(path, magnitudes)?;
            warnings.extend(notes);
            curves.push(curve);
            inputs.push(input);
        }
        let path = paths.first().ok_or(CurvesError::NoFile)?;
        let first = curves.iter().flat_map(|c| &c.curve.samples.time).min().copied();
        let zero = first.ok_or_else(|| CurvesError::Empty { path: path.clone() })?;
        let channels_of = |c: &'_ NamedCurve| -> Vec<String> {
            match c.filters().as_slice() {
                [] => c.curve.channels.iter().map(|c| c.name.clone()).collect(),
                filters => filters.iter().map(|f| named(f).to_owned()).collect(),
            }
        };
        let names: Vec<String> = curves.iter().flat_map(channels_of).collect();
        for wanted in channels {
            if !names.contains(wanted) {
                let nearest = nearest_names(wanted, names.iter().map(String::as_str), 3);
                let nearest = nearest.into_iter().map(str::to_owned).collect();
                return Err(CurvesError::Channel { wanted: wanted.clone(), nearest });
            }
        }
        let channels = channels.to_vec();
        Ok(Self { curves, inputs, zero, removed: Vec::new(), warnings, channels })
    }

    /// Whether any of them holds counted rates, from which the air can be removed.
    pub fn has_rates(&self) -> bool {
        self.curves.iter().any(|c| !c.is_above_air)
    }

    /// Divides the rates by what the pass did to them. What was removed, and what could not be, is added to [`Curves::removed`] and [`Curves::warnings`].
    pub fn remove(&mut self, trends: &Trends<'_>) {
        let Self { curves, removed, warnings, .. } = self;
        for own in curves {
            let stem = own.stem.clone();
            let range = trends.range.then(|| trend::range_factor(&own.curve));
            for c in 0..own.curve.channels.len() {
                if let (Some((station, air)), false) = (trends.air, own.is_above_air) {
                    match air_of(&own.curve, c, station, air) {
                        Ok(factor) => {
                            trend::divide(&mut own.curve.channels[c], &factor);
                            note(removed, format!("air ({})", air.describe()));
                        }
                        Err(error) => {
                            let channel = &own.curve.channels[c].name;
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
                        trend::divide(&mut own.curve.channels[c], factor);
                        note(removed, "range (to 1,000 km)".into());
                    }
                    Some(Err(error)) => {
                        note(warnings, format!("{stem}: the range is not removed: {error}"));
                    }
                    None => {}
                }
                if trends.phase {
                    match phase_factor(own, c) {
                        Ok(factor) => {
                            trend::divide(&mut own.curve.channels[c], &factor);
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
        let called = |name: &str| match self.curves.len() {
            1 => name.to_owned(),
            _ => format!("{} {name}", curve.stem),
        };
        let series = |name: &str, of: &LightCurve, channel: &ChannelCurve| {
            let mut series = Series::of_channel(called(name), of, channel, self.zero)?;
            if !curve.is_exposure_known {
                series.exposure_s = 0.0;
            }
            series.rounding_mag = curve.step_mag;
            Ok(series)
        };
        let filters = curve.filters();
        if filters.is_empty() {
            let channels = curve.curve.channels.iter().filter(|c| self.asks_for(&c.name));
            return channels.map(|c| series(&c.name, &curve.curve, c)).collect();
        }
        let mut all = Vec::new();
        for filter in filters.into_iter().filter(|f| self.asks_for(named(f))) {
            let own = curve.of_filter(filter);
            for channel in &own.channels {
                all.push(series(named(filter), &own, channel)?);
            }
        }
        Ok(all)
    }

    /// First moment, last moment and samples of the stretches of a file without a gap above `gap_s`, s.
    fn stretches(&self, file: usize, gap_s: f64) -> Vec<(f64, f64, usize)> {
        let times = self.curves[file].curve.samples.time.iter();
        let mut times: Vec<f64> = times.map(|t| (*t - self.zero).to_seconds()).collect();
        times.sort_by(f64::total_cmp);
        let mut all: Vec<(f64, f64, usize)> = Vec::new();
        for t in times {
            match all.last_mut() {
                Some((_, to, n)) if t - *to <= gap_s => (*to, *n) = (t, *n + 1),
                _ => all.push((t, t, 1)),
            }
        }
        all
    }

    /// Whether the body is near, so that every pass sees it from other directions and its turns do not add up: rates (which this program counts of satellites), ranges below a million kilometres, or, where no
    /// file says a range, several stretches that last minutes.
    pub fn is_near(&self) -> bool {
        if self.curves.iter().any(|c| c.is_far) {
            return false;
        }
        let ranges = || self.curves.iter().filter_map(|c| c.curve.samples.range_m.as_ref());
        if self.curves.iter().any(|c| !c.is_above_air) || ranges().flatten().any(|r| *r < FAR_M) {
            return true;
        }
        if ranges().next().is_some() {
            return false;
        }
        let all: Vec<_> = (0..self.curves.len()).flat_map(|k| self.stretches(k, GAP_S)).collect();
        let samples =
            |least: usize| -> usize { all.iter().filter(|s| s.2 >= least).map(|s| s.2).sum() };
        all.len() > 1
            && all.iter().all(|(from, to, _)| to - from <= PASS_S)
            && 2 * samples(PASS_SAMPLES) >= samples(0)
    }

    /// The same, parted where no channel of a file has a sample for longer than `gap_s`, and how many tracks a file has at most. Each track is a series of its own: turns in the gaps are not counted.
    ///
    /// # Errors
    /// The errors of [`Curves::series`].
    pub fn tracks(&self, gap_s: f64) -> Result<(Vec<Series>, usize), SeriesError> {
        let mut all = Vec::new();
        let mut most = 1;
        for k in 0..self.curves.len() {
            let stretches = self.stretches(k, gap_s);
            let mut edges = vec![f64::NEG_INFINITY];
            edges.extend(stretches.windows(2).map(|s| 0.5 * (s[0].1 + s[1].0)));
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
