//! When a camera's frames were exposed: how much later than they say, and how evenly.
//!
//! A driver stamps a frame when it asks for the exposure; the shutter or the sensor follows some time later, and no program is told how much. A lamp that flashes
//! into the telescope shows it: a counter of single photons knows when each flash was, to a bin. [`measure`] shifts the frames against the counter's light until
//! their light is a straight line of its counts:
//!
//! y_i = a + b ∫ r(t) dt from s_i + L to s_i + L + T_i,
//!
//! where y_i is the light of frame i, s_i the begin that it says, T_i its exposure, r the counter's rate, and L the latency. Each frame is weighted by its noise,
//! of which the jitter of L is the part that grows with r(s_i + L + T_i) − r(s_i + L). A rolling shutter shows in bands of rows: each has a latency of its own.
//!
//! [`Timings`] keeps what was found, by camera, binning and clock, and [`Timings::correct`] takes it off a frame's begin.

mod file;
mod fit;

pub use file::timing_file;

use crate::reduction::sensor::said_kind;
use fit::{FrameLight, NoShift, Reference, Shift};
use hifitime::{Epoch, Unit};
use ndarray::Array2;
use std::path::{Path, PathBuf};
use sunglint_formats::session::{FrameFile, Session, TargetKind};
use sunglint_formats::{CountFlags, FileError, Frame};
use sunglint_numerics::measured::Measured;
use sunglint_numerics::progress::{Cancelled, Progress};

/// Whose clock a frame's begin is of.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "lowercase")]
pub enum FrameClock {
    /// The driver's, or its server's.
    Driver,
    /// The host's: when it asked, because the driver told no time that could be used.
    Host,
}

impl FrameClock {
    /// The clock of a frame.
    pub fn of(frame: &Frame) -> Self {
        // A driver without a usable time leaves the standard deviation of the host's.
        if frame.header.get(JITTER).is_some() { Self::Host } else { Self::Driver }
    }

    /// The name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Driver => "driver",
            Self::Host => "host",
        }
    }
}

/// Keyword of the systematic uncertainty of a frame's times, s (FITS 4.0, table 27).
pub const SYSTEMATIC: &str = "TIMSYER";
/// Keyword of their random uncertainty, s.
pub const JITTER: &str = "TIMRDER";

/// Times of a camera's frames, in one binning and window.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraTiming {
    /// The camera's name in sessions.
    pub camera: String,
    /// The name that the camera has for itself, where its frames say one.
    pub instrument: Option<String>,
    /// Columns and rows of the sensor in one pixel.
    pub binning: [u32; 2],
    /// Columns and rows of the frame, px; any without them.
    pub window_px: Option<[usize; 2]>,
    /// Whose clock its frames' begins are of.
    pub clock: FrameClock,
    /// Time by which the exposure of the first row begins later than the frame says, s.
    pub latency_s: Measured,
    /// Standard deviation of that time from frame to frame, s.
    pub jitter_s: f64,
    /// Time by which each row of the frame begins after the one before, s: a rolling shutter.
    pub row_time_s: Option<Measured>,
    /// Frames that it was measured with.
    pub frames: usize,
}

/// Times of cameras.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Timings {
    /// The file that they came from.
    pub path: PathBuf,
    /// Each camera and binning.
    pub cameras: Vec<CameraTiming>,
}

impl Timings {
    /// The times of a camera's frame; `None` where it was not measured so.
    pub fn of(&self, camera: &str, frame: &Frame) -> Option<&CameraTiming> {
        let (clock, instrument) = (FrameClock::of(frame), instrument(frame));
        let (rows, columns) = frame.pixels.dim();
        self.cameras.iter().find(|timing| {
            timing.camera == camera
                && (timing.instrument.is_none() || timing.instrument == instrument)
                && timing.binning == frame.binning
                && timing.window_px.is_none_or(|window| window == [columns, rows])
                && timing.clock == clock
        })
    }

    /// Takes the latency off a frame's begin, and says the uncertainties that are left. Returns the times that were taken; `None`, and the frame as it was, where this
    /// camera was not measured in this binning with this clock.
    pub fn correct(&self, camera: &str, frame: &mut Frame) -> Option<&CameraTiming> {
        let timing = self.of(camera, frame)?;
        frame.start += hifitime::Duration::from_seconds(timing.latency_s.value);
        let header = &mut frame.header;
        header.set(
            SYSTEMATIC,
            timing.latency_s.sigma,
            "s, uncertainty of the latency that was taken off",
        );
        header.set(JITTER, timing.jitter_s, "s, standard deviation of a frame's own latency");
        Some(timing)
    }
}

impl CameraTiming {
    /// Camera, binning, window and clock, for messages.
    pub fn name(&self) -> String {
        let [x, y] = self.binning;
        let window = self.window_px.map_or_else(String::new, |[x, y]| format!(", {x} × {y} px"));
        format!("{} in binning {x} × {y}{window}, {}'s clock", self.camera, self.clock.name())
    }

    /// Standard uncertainty of a frame's times, s.
    pub fn sigma_s(&self) -> f64 {
        self.latency_s.sigma.hypot(self.jitter_s)
    }
}

/// A camera's own name, where its frame says one.
fn instrument(frame: &Frame) -> Option<String> {
    let name = frame.header.text("INSTRUME")?.trim().to_owned();
    (!name.is_empty()).then_some(name)
}

/// Options of a measurement.
#[derive(Debug, Clone, Default)]
pub struct TimingOptions {
    /// The camera; all of the sessions without one.
    pub camera: Option<String>,
    /// The counter's channel whose light is compared; all of the sessions without one, the surest is taken.
    pub channel: Option<String>,
    /// Largest latency that is looked for, either way, s; as large as the frames say that it may be without one.
    pub most_s: Option<f64>,
}

/// Largest latency that is looked for where frames do not say what it may be, s.
pub const MOST_S: f64 = 2.0;
/// Bands of rows whose latencies are measured apart.
const BANDS: usize = 16;
/// Bands that must show light for the time of a row.
const LEAST_BANDS: usize = 4;
/// Frames from which the pixels that see the light are taken.
const LOOKED_AT: usize = 64;
/// A pixel sees the light of a lamp on a part of the sensor where it varies so many times as much as the middle one.
const VARIES: f64 = 9.0;
/// Standard deviations from 0 at which rows have times of their own.
const ROLLS_SIGMAS: f64 = 4.0;

/// A frame's own latency.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FramePoint {
    /// Begin of its exposure as it says it.
    pub said: Epoch,
    /// Mean light of its pixels, ADU.
    pub light_adu: f64,
    /// Counts of the counter within its exposure, at the latency that was found.
    pub counts: f64,
}

/// Times that were measured, with what they came from.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredTiming {
    /// The times.
    pub timing: CameraTiming,
    /// The counter's channel.
    pub channel: String,
    /// Length of its bins, s.
    pub bin_s: f64,
    /// Number of frames that tell the latency: those that an edge of the light falls into.
    pub telling: f64,
    /// Largest latency that was looked for, s.
    pub most_s: f64,
    /// Latency of each band of rows that saw the light: its middle row, s later than the frame says.
    pub bands: Vec<(f64, Measured)>,
    /// The frames.
    pub points: Vec<FramePoint>,
}

/// Result of a measurement.
#[derive(Debug, Clone, Default)]
pub struct Measurement {
    /// Times that were found.
    pub found: Vec<MeasuredTiming>,
    /// Cameras without, and why.
    pub warnings: Vec<String>,
}

/// Why no times are found.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TimingError {
    /// A session that cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// No camera or channel of this name.
    #[error("there is no {kind} {asked} in the sessions: there are {known}")]
    Unknown {
        /// Camera or channel.
        kind: &'static str,
        /// The name that was asked for.
        asked: String,
        /// Names that there are.
        known: String,
    },
    /// A session without a camera or without a counter.
    #[error("session {} has no {missing}: a lamp must flash into a camera and a counter of one session", path.display())]
    Missing {
        /// The session.
        path: PathBuf,
        /// The instrument that it lacks.
        missing: &'static str,
    },
    /// Nothing could be measured.
    #[error("no latency could be measured{}", reasons(warnings))]
    Nothing {
        /// The reasons.
        warnings: Vec<String>,
    },
    /// It was stopped.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

fn reasons(warnings: &[String]) -> String {
    warnings.iter().map(|warning| format!("; {warning}")).collect()
}

/// Frames that were taken alike.
#[derive(Debug)]
struct Group {
    instrument: Option<String>,
    binning: [u32; 2],
    size: [usize; 2],
    clock: FrameClock,
    files: Vec<FrameFile>,
    /// Uncertainties that the frames say, s.
    doubts_s: Vec<f64>,
}

/// Measures when the frames of the cameras of sessions were exposed, by light that counters of the same sessions saw.
///
/// # Errors
/// Sessions that cannot be read or lack an instrument, unknown names, and [`TimingError::Nothing`] with the reasons.
pub fn measure(
    sessions: &[PathBuf],
    options: &TimingOptions,
    progress: &dyn Progress,
) -> Result<Measurement, TimingError> {
    let mut opened: Vec<Session> =
        sessions.iter().map(Session::open).collect::<Result<_, FileError>>()?;
    opened.sort_by_key(|session| session.manifest().start_utc);
    let cameras = names(&opened, "camera", options.camera.as_deref(), &|session| {
        Ok(session.cameras().map(str::to_owned).collect())
    })?;
    let channels = names(&opened, "counter", options.channel.as_deref(), &channels_of)?;
    let Some(zero) = opened.first().map(|session| session.manifest().start_utc) else {
        return Ok(Measurement::default());
    };
    let references: Vec<(String, Reference)> = channels
        .into_iter()
        .map(|channel| {
            let reference = reference(&opened, &channel, zero)?;
            Ok((channel, reference))
        })
        .collect::<Result<_, FileError>>()?;
    let mut measurement = Measurement::default();
    for camera in cameras {
        let (groups, unread) = groups(&opened, &camera, progress)?;
        if unread > 0 {
            let warning = format!("camera {camera}: {unread} frames cannot be read");
            measurement.warnings.push(warning);
        }
        for group in groups {
            let [x, y] = group.binning;
            let name = format!(
                "camera {camera}, binning {x} × {y}, {} × {} px, {}'s clock",
                group.size[0],
                group.size[1],
                group.clock.name()
            );
            match of_group(&camera, &group, &references, zero, options, progress)? {
                Ok(found) => measurement.found.push(found),
                Err(reason) => measurement.warnings.push(format!("{name}: {reason}")),
            }
        }
    }
    if measurement.found.is_empty() {
        return Err(TimingError::Nothing { warnings: measurement.warnings });
    }
    Ok(measurement)
}

/// The names of one kind in all sessions, or the one that was asked for.
fn names(
    sessions: &[Session],
    kind: &'static str,
    asked: Option<&str>,
    of: &dyn Fn(&Session) -> Result<Vec<String>, FileError>,
) -> Result<Vec<String>, TimingError> {
    let mut known: Vec<String> = Vec::new();
    for session in sessions {
        let names = of(session)?;
        if names.is_empty() {
            let path = session.root().to_path_buf();
            return Err(TimingError::Missing { path, missing: kind });
        }
        known.extend(names);
    }
    known.sort();
    known.dedup();
    match asked {
        None => Ok(known),
        Some(asked) if known.iter().any(|name| name == asked) => Ok(vec![asked.to_owned()]),
        Some(asked) => Err(TimingError::Unknown {
            kind: if kind == "counter" { "channel" } else { kind },
            asked: asked.to_owned(),
            known: known.join(", "),
        }),
    }
}

/// Names of all counters' channels in a session.
fn channels_of(session: &Session) -> Result<Vec<String>, FileError> {
    let mut names = Vec::new();
    for counter in session.counters() {
        names.extend_from_slice(session.counts(counter)?.channels());
    }
    Ok(names)
}

/// Bins whose counts are not the light's.
const BAD: CountFlags = CountFlags::OVERFLOW
    .union(CountFlags::MISSED)
    .union(CountFlags::ERROR)
    .union(CountFlags::SATURATED);

/// The light of a channel in all sessions.
fn reference(sessions: &[Session], channel: &str, zero: Epoch) -> Result<Reference, FileError> {
    let mut reference = Reference::default();
    for session in sessions {
        for counter in session.counters() {
            let counts = session.counts(counter)?;
            let Some(column) = counts.channels().iter().position(|name| name == channel) else {
                continue;
            };
            for record in counts {
                let record = record?;
                if record.flags.intersects(BAD) {
                    continue;
                }
                let from_s = (record.start - zero).to_seconds();
                let counts = record.counts.get(column).copied().unwrap_or(0);
                reference.push(from_s..from_s + record.length_ps as f64 / 1e12, counts as f64);
            }
        }
    }
    Ok(reference)
}

/// The frames of a camera in all sessions, those that were taken alike together, and the number of those that cannot be read. Dark and bias frames see no lamp.
fn groups(
    sessions: &[Session],
    camera: &str,
    progress: &dyn Progress,
) -> Result<(Vec<Group>, usize), TimingError> {
    let (mut groups, mut unread): (Vec<Group>, usize) = (Vec::new(), 0);
    for session in sessions {
        if !session.cameras().any(|name| name == camera) {
            continue;
        }
        for file in session.frames(camera)?.files {
            step(progress)?;
            let Ok(frame) = file.read() else {
                unread += 1;
                continue;
            };
            if matches!(said_kind(&frame), Some(TargetKind::Dark | TargetKind::Bias)) {
                continue;
            }
            let (rows, columns) = frame.pixels.dim();
            let key = (instrument(&frame), frame.binning, [columns, rows], FrameClock::of(&frame));
            let place = groups.iter().position(|group| {
                (&group.instrument, group.binning, group.size, group.clock)
                    == (&key.0, key.1, key.2, key.3)
            });
            let place = place.unwrap_or_else(|| {
                let (instrument, binning, size, clock) = key;
                let (files, doubts_s) = (Vec::new(), Vec::new());
                groups.push(Group { instrument, binning, size, clock, files, doubts_s });
                groups.len() - 1
            });
            groups[place].doubts_s.extend(frame.header.real(SYSTEMATIC));
            groups[place].files.push(file);
        }
    }
    Ok((groups, unread))
}

fn step(progress: &dyn Progress) -> Result<(), Cancelled> {
    progress.advance(1);
    if progress.is_cancelled() { Err(Cancelled) } else { Ok(()) }
}

/// Measures a group by each channel, and gives the surest.
fn of_group(
    camera: &str,
    group: &Group,
    references: &[(String, Reference)],
    zero: Epoch,
    options: &TimingOptions,
    progress: &dyn Progress,
) -> Result<Result<MeasuredTiming, String>, TimingError> {
    let seen = seen(group);
    let rows = seen.as_ref().map_or(group.size[1], |seen| seen.nrows());
    let bands = BANDS.min(rows.max(1));
    let mut frames = Vec::with_capacity(group.files.len());
    for file in &group.files {
        step(progress)?;
        let Ok(frame) = file.read() else { continue };
        let start_s = (frame.start - zero).to_seconds();
        let bands = light(&frame, seen.as_ref(), bands);
        frames.push(FrameLight { start_s, exposure_s: frame.exposure_s, bands });
    }
    let most_s = options.most_s.unwrap_or_else(|| most_s(&group.doubts_s));
    let mut best: Option<MeasuredTiming> = None;
    let mut reasons = Vec::new();
    for (channel, reference) in references {
        match of_channel(&frames, seen.as_ref(), group, reference, most_s) {
            Ok((shift, row_time_s, bands, used)) => {
                let timing = CameraTiming {
                    camera: camera.to_owned(),
                    instrument: group.instrument.clone(),
                    binning: group.binning,
                    window_px: Some(group.size),
                    clock: group.clock,
                    latency_s: Measured::new(shift.later_s, shift.sigma_s),
                    jitter_s: shift.jitter_s,
                    row_time_s,
                    frames: used.len(),
                };
                let points = used.iter().map(|frame| {
                    let from_s = frame.start_s + shift.later_s;
                    FramePoint {
                        said: zero + frame.start_s * Unit::Second,
                        light_adu: mean_light(frame),
                        counts: reference
                            .within(from_s..from_s + frame.exposure_s)
                            .unwrap_or(f64::NAN),
                    }
                });
                let found = MeasuredTiming {
                    timing,
                    channel: channel.clone(),
                    bin_s: reference.bin_s().unwrap_or(f64::NAN),
                    telling: shift.telling,
                    most_s,
                    bands,
                    points: points.collect(),
                };
                let surer =
                    best.as_ref().is_none_or(|best| best.timing.latency_s.sigma > shift.sigma_s);
                if surer {
                    best = Some(found);
                }
            }
            Err(reason) => reasons.push(format!("{channel}: {}", words(&reason, most_s))),
        }
    }
    Ok(best.ok_or_else(|| reasons.join("; ")))
}

/// Largest latency that frames of these uncertainties may have, s: twice the middle one.
fn most_s(doubts_s: &[f64]) -> f64 {
    let mut doubts: Vec<f64> = doubts_s.iter().copied().filter(|d| d.is_finite()).collect();
    doubts.sort_by(f64::total_cmp);
    // A little more: the jitter of the longest one.
    doubts.get(doubts.len() / 2).map_or(MOST_S, |middle| 2.2 * middle + 0.05).min(60.0)
}

type OfChannel<'a> = (Shift, Option<Measured>, Vec<(f64, Measured)>, Vec<&'a FrameLight>);

/// The latency by a channel's light: of the first row where rows have times of their own.
fn of_channel<'a>(
    frames: &'a [FrameLight],
    seen: Option<&Array2<bool>>,
    group: &Group,
    reference: &Reference,
    most_s: f64,
) -> Result<OfChannel<'a>, NoShift> {
    let used = fit::covered(frames, reference, most_s);
    let whole = fit::search(&used, &mean_light, reference, most_s)?;
    let count = frames.first().map_or(0, |frame| frame.bands.len());
    let mut bands = Vec::new();
    for band in 0..count {
        let light: Vec<f64> = used.iter().map(|frame| frame.bands[band]).collect();
        if light.iter().any(|light| !light.is_finite()) {
            continue;
        }
        let Some(row) = middle_row(seen, group.size[1], count, band) else { continue };
        // Rows are read within an exposure's time of one another, or nearly.
        if let Ok(shift) = fit::near(&used, &light, reference, whole.later_s) {
            bands.push((row, shift));
        }
    }
    let rolling = rolling(&bands).filter(|(_, time)| time.value.abs() > ROLLS_SIGMAS * time.sigma);
    let (shift, row_time_s) = match rolling {
        Some((first, time)) => {
            (Shift { later_s: first.value, sigma_s: first.sigma, ..whole }, Some(time))
        }
        None => (whole, None),
    };
    let bands = bands.into_iter().map(|(row, s)| (row, Measured::new(s.later_s, s.sigma_s)));
    Ok((shift, row_time_s, bands.collect(), used))
}

/// Straight line through the bands' latencies: that of row 0, and the time of a row; `None` of too few bands.
///
/// A frame's jitter moves all bands together: what is left of it in the line is added up frame by frame.
fn rolling(bands: &[(f64, Shift)]) -> Option<(Measured, Measured)> {
    if bands.len() < LEAST_BANDS {
        return None;
    }
    let n = bands.len() as f64;
    let mean = bands.iter().map(|(row, _)| row).sum::<f64>() / n;
    let spread = bands.iter().map(|(row, _)| (row - mean).powi(2)).sum::<f64>();
    if spread <= 0.0 {
        return None;
    }
    let frames = bands[0].1.influence_s.len();
    let of = |weight: &dyn Fn(f64) -> f64| {
        let value = bands.iter().map(|(row, s)| weight(*row) * s.later_s).sum::<f64>();
        let of_frame =
            |i: usize| bands.iter().map(|(row, s)| weight(*row) * s.influence_s[i]).sum::<f64>();
        let variance = (0..frames).map(|i| of_frame(i).powi(2)).sum::<f64>();
        Measured::new(value, variance.sqrt())
    };
    let time = of(&|row| (row - mean) / spread);
    let first = of(&|row| 1.0 / n - mean * (row - mean) / spread);
    // Where the counter's bins are coarse the line is scattered about by them, too.
    let scatter = bands
        .iter()
        .map(|(row, s)| (s.later_s - first.value - time.value * row).powi(2))
        .sum::<f64>()
        / (n - 2.0);
    let time = Measured::new(time.value, time.sigma.hypot((scatter / spread).sqrt()));
    Some((first, time))
}

/// Mean light of a frame's bands.
fn mean_light(frame: &FrameLight) -> f64 {
    let light = frame.bands.iter().filter(|light| light.is_finite());
    let (sum, count) = light.fold((0.0, 0.0), |(sum, count), light| (sum + light, count + 1.0));
    sum / count
}

/// Pixels that see the lamp, where it lights a part of the sensor only: they vary more than the others. `None` where none stands out.
fn seen(group: &Group) -> Option<Array2<bool>> {
    let every = group.files.len().div_ceil(LOOKED_AT).max(1);
    let [columns, rows] = group.size;
    let (mut sum, mut squares) =
        (Array2::<f64>::zeros((rows, columns)), Array2::<f64>::zeros((rows, columns)));
    let mut count = 0.0;
    for file in group.files.iter().step_by(every) {
        let Ok(frame) = file.read() else { continue };
        if frame.pixels.dim() != (rows, columns) {
            continue;
        }
        ndarray::Zip::from(&mut sum).and(&mut squares).and(&frame.pixels).for_each(
            |sum, squares, &pixel| {
                let pixel = f64::from(pixel);
                *sum += pixel;
                *squares += pixel * pixel;
            },
        );
        count += 1.0;
    }
    if count < 8.0 {
        return None;
    }
    let variance = (squares - &sum * &sum / count) / (count - 1.0);
    let mut sorted: Vec<f64> = variance.iter().copied().collect();
    let middle = sorted.len() / 2;
    let (_, median, _) = sorted.select_nth_unstable_by(middle, f64::total_cmp);
    // Rounding alone varies by a twelfth.
    let least = VARIES * median.max(1.0 / 12.0);
    let seen = variance.mapv(|variance| variance > least);
    seen.iter().any(|seen| *seen).then_some(seen)
}

/// First row of a band and the one behind its last.
fn band_rows(rows: usize, bands: usize, band: usize) -> std::ops::Range<usize> {
    rows * band / bands..rows * (band + 1) / bands
}

/// Mean of each band's pixels that see the lamp; NaN where none does.
fn light(frame: &Frame, seen: Option<&Array2<bool>>, bands: usize) -> Vec<f64> {
    let rows = frame.pixels.nrows();
    let mean = |band: usize| {
        let (mut sum, mut count) = (0_u64, 0_u64);
        for row in band_rows(rows, bands, band) {
            for (column, pixel) in frame.pixels.row(row).iter().enumerate() {
                if seen.is_none_or(|seen| seen[(row, column)]) {
                    sum += u64::from(*pixel);
                    count += 1;
                }
            }
        }
        if count > 0 { sum as f64 / count as f64 } else { f64::NAN }
    };
    (0..bands).map(mean).collect()
}

/// Mean row of a band's pixels that see the lamp.
fn middle_row(seen: Option<&Array2<bool>>, rows: usize, bands: usize, band: usize) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0.0);
    for row in band_rows(rows, bands, band) {
        let pixels = seen.map_or(1, |seen| seen.row(row).iter().filter(|seen| **seen).count());
        sum += row as f64 * pixels as f64;
        count += pixels as f64;
    }
    (count > 0.0).then(|| sum / count)
}

/// A reason in words, with what to do.
fn words(reason: &NoShift, most_s: f64) -> String {
    match reason {
        NoShift::Few(frames) => format!(
            "{frames} frames lie within its bins with {most_s:.2} s on either side, at least 10 are needed"
        ),
        NoShift::Unlike => format!(
            "the frames' light does not follow its counts at any latency up to {most_s:.2} s: both must see the same flashes"
        ),
        NoShift::NoEdges(frames) => format!(
            "{frames:.1} frames have a flash's begin or end in their exposure, at least 5 are needed: take more frames, at a cadence that is no multiple of the flashes'"
        ),
        NoShift::Ambiguous(shifts) => {
            let mut shifts = shifts.clone();
            shifts.sort_by(f64::total_cmp);
            let some: Vec<String> = shifts.iter().take(5).map(|s| format!("{s:.3}")).collect();
            format!(
                "several latencies fit as well ({} s): let the lamp flash at unequal intervals, or give a smaller range (--most-s)",
                some.join(", ")
            )
        }
        NoShift::AtEnd(shift) => format!(
            "the best latency, {shift:.3} s, is at the end of the range: give a larger one (--most-s)"
        ),
    }
}

/// Reads times that [`timing_file`] wrote.
///
/// # Errors
/// A file that cannot be read, or holds something else.
pub fn read_timings(path: &Path) -> Result<Timings, FileError> {
    file::read(path)
}
