//! A recorded visit reduced again, with other choices: the same call as `sunglint reduce --recipe`.

use crate::magnitudes::Scale;
use crate::request::Answer;
use hifitime::Epoch;
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;
use sunglint_calibration::reduction::frames::FrameLook;
use sunglint_calibration::reduction::held::HeldFrames;
use sunglint_calibration::reduction::recipe::Recipe;
use sunglint_calibration::reduction::wings::Wings;
use sunglint_calibration::reduction::{ReduceError, ReduceOptions, Reduced, Visited, reduce};
use sunglint_calibration::timing::Timings;
use sunglint_formats::atomic::{Overwrite, write_file};
use sunglint_formats::ecsv;
use sunglint_formats::session::Session;
use sunglint_numerics::progress::{Cancelled, Progress};
use sunglint_radiometry::light_curve::Flags;
use sunglint_radiometry::station::{Detector, Station};

/// Samples of each channel in an answer at most: of more the lowest and the highest of each few are shown.
const SAMPLES: usize = 50_000;
/// Pixels of the visit's frames that stay in memory from one curve to the next, bytes at most.
const HELD: usize = 256 << 20;

/// Reductions of one session, one at a time; a newer wish ends the older one.
#[derive(Debug, Default)]
pub(crate) struct Rework {
    wishes: AtomicU64,
    one: Mutex<()>,
    /// Frames of the visit that was reduced last.
    held: Mutex<Option<(String, u32, Arc<HeldFrames>)>>,
    /// When the cameras expose: is taken off the frames' times.
    pub timings: Option<Timings>,
}

/// Recipe to be saved.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Saved {
    name: String,
    recipe: Recipe,
    /// Whether a recipe of this name may be replaced.
    #[serde(default)]
    replace: bool,
}

#[derive(Serialize)]
struct SavedView<'a> {
    name: &'a str,
    file: String,
    repeat: String,
}

#[derive(Serialize)]
struct NamesView {
    names: Vec<String>,
}

#[derive(Serialize)]
struct CancelledView {
    done: &'static str,
}

/// Light curve of a visit.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct CurveView {
    channels: Vec<ChannelView>,
    /// Names of the bits of the flags.
    flag_names: Vec<(u32, String)>,
    /// Middle of each exposure with a place, s after the session's start.
    track_s: Vec<f64>,
    /// Columns and rows of the target from the sensor's middle, unbinned px.
    track_px: Vec<[f64; 2]>,
    /// Radius of the aperture, inner and outer radius of the annulus, px, of the first camera.
    aperture_px: Option<[f64; 3]>,
    smallest_aperture_px: Option<f64>,
    /// Width of a point that was expected, px.
    fwhm_px: Option<f64>,
    /// Frames that were measured, and those without a target.
    frames: [u64; 2],
    /// Sources that each filter removed.
    removed: Vec<(&'static str, u64)>,
    warnings: Vec<String>,
    /// Sentences about how the curve was made.
    notes: Vec<String>,
    took_s: f64,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct ChannelView {
    name: String,
    unit: &'static str,
    time_s: Vec<f64>,
    rate: Vec<Option<f64>>,
    sigma: Vec<Option<f64>>,
    /// Magnitude and its σ, where there is a calibration; else empty.
    magnitude: Vec<Option<f64>>,
    sigma_mag: Vec<Option<f64>>,
    flags: Vec<u32>,
}

/// A reduction that somebody waits for.
struct Wish<'a> {
    number: u64,
    wishes: &'a AtomicU64,
}

impl Progress for Wish<'_> {
    fn is_cancelled(&self) -> bool {
        self.wishes.load(Ordering::Relaxed) != self.number
    }
}

fn refused(error: &dyn std::fmt::Display) -> Answer {
    Answer::error(422, &error.to_string())
}

fn parsed<'a, T: Deserialize<'a>>(body: &'a [u8]) -> Result<T, Answer> {
    serde_json::from_slice(body).map_err(|error| Answer::error(400, &error.to_string()))
}

impl Rework {
    /// Reduces the visit that a recipe names.
    fn visited(
        &self,
        session: &Session,
        station: &Station,
        recipe: &Recipe,
    ) -> Result<(Reduced, Visited), Answer> {
        recipe.check().map_err(|error| refused(&error))?;
        let Some((target, visit)) = recipe.target.as_deref().zip(recipe.visit) else {
            return Err(Answer::error(422, "the recipe names no target and visit"));
        };
        let wish =
            Wish { number: self.wishes.fetch_add(1, Ordering::Relaxed) + 1, wishes: &self.wishes };
        let _one = self.one.lock().unwrap_or_else(PoisonError::into_inner);
        let said = |error: ReduceError| match deepest(&error) {
            ReduceError::Cancelled(_) => {
                Answer::error(409, "cancelled, or a newer reduction was asked for")
            }
            _ => Answer::error(422, &whole(&error)),
        };
        if wish.is_cancelled() {
            return Err(said(ReduceError::Cancelled(Cancelled)));
        }
        let mut options = ReduceOptions::for_station(station);
        recipe.apply(&mut options);
        if let Some(frames) = &mut options.frames {
            frames.timings.clone_from(&self.timings);
            frames.held = Some(self.held(target, visit));
        }
        let mut night = reduce(session, station, &options, &wish).map_err(said)?;
        let visited = night.take(session, station).map_err(said)?;
        let nothing = || {
            let why = night.warnings.join("; ");
            Answer::error(422, &format!("nothing was recorded of this visit: {why}"))
        };
        let visited = visited.ok_or_else(nothing)?;
        Ok((night, visited))
    }

    /// The frames of a visit that stay in memory; those of another one go.
    fn held(&self, target: &str, visit: u32) -> Arc<HeldFrames> {
        let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        match &*held {
            Some((of, number, frames)) if of == target && *number == visit => frames.clone(),
            _ => {
                let frames = Arc::new(HeldFrames::new(HELD));
                *held = Some((target.to_owned(), visit, frames.clone()));
                frames
            }
        }
    }

    /// The curve of a visit, for the screen.
    pub fn curve(
        &self,
        session: &Session,
        station: &Station,
        scale: Option<&Scale>,
        body: &[u8],
    ) -> Result<Answer, Answer> {
        let begun = Instant::now();
        let recipe: Recipe = parsed(body)?;
        let (night, visited) = self.visited(session, station, &recipe)?;
        let start = session.manifest().start_utc;
        let mut view = CurveView::of(&night, &visited, station, scale, start);
        view.took_s = begun.elapsed().as_secs_f64();
        Ok(Answer::json(&view))
    }

    /// The curve of a visit as the file that `sunglint reduce` writes, byte for byte.
    pub fn file(
        &self,
        session: &Session,
        station: &Station,
        body: &[u8],
    ) -> Result<Answer, Answer> {
        let recipe: Recipe = parsed(body)?;
        let (_, visited) = self.visited(session, station, &recipe)?;
        let table = visited.linear.to_table().map_err(|error| refused(&error))?;
        let text = ecsv::to_string(&table).map_err(|error| refused(&error))?;
        Ok(Answer { status: 200, kind: "text/plain; charset=utf-8", body: text.into_bytes() })
    }

    /// Ends the reduction that is under way.
    pub fn cancel(&self) -> Answer {
        self.wishes.fetch_add(1, Ordering::Relaxed);
        Answer::json(&CancelledView { done: "the reduction ends" })
    }

    /// Writes a recipe into the session's folder.
    pub fn save(&self, session: &Session, body: &[u8]) -> Result<Answer, Answer> {
        let Saved { name, recipe, replace } = parsed(body)?;
        recipe.check().map_err(|error| refused(&error))?;
        let path = Recipe::path(session, &name).ok_or_else(|| {
            Answer::error(422, "a name has 1 to 64 letters (a to z), digits, `_` or `-`")
        })?;
        if let Some(folder) = path.parent() {
            let made = std::fs::create_dir_all(folder);
            made.map_err(|e| refused(&format!("cannot make {}: {e}", folder.display())))?;
        }
        let overwrite = if replace { Overwrite::Allow } else { Overwrite::Refuse };
        write_file(&path, recipe.toml().as_bytes(), overwrite).map_err(|error| match error {
            sunglint_formats::FileError::Exists { .. } => {
                Answer::error(409, &format!("there is a reduction `{name}` already"))
            }
            error => refused(&error),
        })?;
        let root = session.root().display();
        let timings = self.timings.as_ref();
        let timing =
            timings.map_or_else(String::new, |of| format!(" --timing {}", of.path.display()));
        Ok(Answer::json(&SavedView {
            name: &name,
            file: path.display().to_string(),
            repeat: format!("sunglint reduce {root} --recipe {name}{timing} -o {name}/"),
        }))
    }

    /// Names of the session's recipes.
    pub fn names(session: &Session) -> Answer {
        Answer::json(&NamesView { names: Recipe::names(session) })
    }

    /// A recipe of the session.
    pub fn recipe(session: &Session, name: &str) -> Result<Answer, Answer> {
        let path = Recipe::path(session, name).filter(|path| path.exists());
        let path = path.ok_or_else(Answer::missing)?;
        let recipe = Recipe::read(&path).map_err(|error| refused(&error))?;
        Ok(Answer::json(&recipe))
    }
}

/// The error at the bottom.
fn deepest(error: &ReduceError) -> &ReduceError {
    match error {
        ReduceError::Within { source, .. } => deepest(source),
        error => error,
    }
}

/// An error with all that it came from.
fn whole(error: &dyn std::error::Error) -> String {
    match error.source() {
        Some(source) => format!("{error}: {}", whole(source)),
        None => error.to_string(),
    }
}

/// The samples that are drawn: all, or of each bunch of neighbours the lowest and the highest rate, so that no flash is lost. A bunch without a rate keeps its first.
fn thinned(sampled: &[usize], rates: &[f64]) -> Vec<usize> {
    if sampled.len() <= SAMPLES {
        return sampled.to_vec();
    }
    let mut shown = Vec::with_capacity(SAMPLES);
    for bunch in sampled.chunks(sampled.len().div_ceil(SAMPLES / 2)) {
        let known = || bunch.iter().copied().filter(|i| rates[*i].is_finite());
        let low = known().min_by(|a, b| rates[*a].total_cmp(&rates[*b]));
        let high = known().max_by(|a, b| rates[*a].total_cmp(&rates[*b]));
        match (low, high) {
            (Some(low), Some(high)) if low != high => shown.extend([low.min(high), low.max(high)]),
            (found, _) => shown.extend(found.or(bunch.first().copied())),
        }
    }
    shown
}

impl CurveView {
    fn of(
        night: &Reduced,
        visited: &Visited,
        station: &Station,
        scale: Option<&Scale>,
        start: Epoch,
    ) -> Self {
        let seconds = |time: Epoch| (time - start).to_seconds();
        let samples = &visited.linear.samples;
        let mut notes = Vec::new();
        let channels = visited.linear.channels.iter().map(|channel| {
            let detector = station.channel(&channel.name).map(|channel| &channel.detector);
            let mut view = ChannelView {
                name: channel.name.clone(),
                unit: match detector {
                    Some(Detector::CameraPlane(_)) => "ADU/s",
                    _ => "Hz",
                },
                time_s: Vec::new(),
                rate: Vec::new(),
                sigma: Vec::new(),
                magnitude: Vec::new(),
                sigma_mag: Vec::new(),
                flags: Vec::new(),
            };
            let finite = |value: f64| value.is_finite().then_some(value);
            let sampled: Vec<usize> = (0..channel.flags.len())
                .filter(|i| !channel.flags[*i].contains(Flags::NOT_SAMPLED))
                .collect();
            let shown = thinned(&sampled, &channel.rate_hz);
            if shown.len() < sampled.len() {
                notes.push(format!(
                    "{}: {} of {} samples are drawn, the lowest and the highest of each few; the file has all",
                    channel.name,
                    shown.len(),
                    sampled.len()
                ));
            }
            for i in shown {
                view.time_s.push(seconds(samples.time[i]));
                view.rate.push(finite(channel.rate_hz[i]));
                view.sigma.push(finite(channel.sigma_hz[i]));
                view.flags.push(channel.flags[i].bits());
                if let Some((scale, zenith_deg)) = scale.zip(samples.zenith_deg.as_ref()) {
                    let (rate, sigma) = (channel.rate_hz[i], channel.sigma_hz[i]);
                    let found = scale.magnitude(&channel.name, zenith_deg[i], rate, sigma);
                    view.magnitude.push(found.map(|(magnitude, _)| magnitude));
                    view.sigma_mag.push(found.map(|(_, sigma)| sigma));
                }
            }
            view
        });
        let mut channels: Vec<ChannelView> = channels.collect();
        let found = visited.track.points.iter();
        let found = found
            .filter_map(|point| Some((seconds(point.time), point.place?.offset_px.to_array())));
        let (track_s, track_px) = found.unzip();
        let camera = night.cameras.first();
        let number = night.stays.iter().position(|stay| stay.target.on);
        let looks = camera.zip(number).and_then(|(camera, number)| camera.looks.get(number));
        if let Some(looks) = looks.filter(|looks| !looks.is_empty()) {
            let finite = |value: f64| value.is_finite().then_some(value);
            let of = |name: &str, unit, value: &dyn Fn(&FrameLook) -> Option<f64>| ChannelView {
                name: name.to_owned(),
                unit,
                time_s: looks.iter().map(|look| seconds(look.time)).collect(),
                rate: looks.iter().map(value).collect(),
                sigma: vec![None; looks.len()],
                magnitude: Vec::new(),
                sigma_mag: Vec::new(),
                flags: vec![0; looks.len()],
            };
            channels.push(of("focus (width of the target)", "px", &|look| look.fwhm_px));
            channels.push(of("background", "ADU", &|look| finite(look.background_adu)));
        }
        let wings = camera.zip(number).and_then(|(camera, number)| camera.wings.get(number));
        // What the frames do not tell is a warning already.
        let told = wings.into_iter().flatten().filter(|wings| !wings.factors.is_empty());
        notes.extend(told.map(Wings::note));
        if let Some(number) = number {
            let seen = night.cameras.iter().filter(|camera| !camera.looks[number].is_empty());
            notes.extend(seen.filter_map(|camera| camera.times[number].note(&camera.camera)));
        }
        let tally = camera.map(|camera| camera.tally).unwrap_or_default();
        Self {
            channels,
            flag_names: Flags::all()
                .iter_names()
                .map(|(name, flag)| (flag.bits(), name.to_lowercase()))
                .collect(),
            track_s,
            track_px,
            aperture_px: camera.map(|camera| camera.aperture_px),
            smallest_aperture_px: camera.map(|camera| camera.smallest_aperture_px),
            fwhm_px: camera.and_then(|camera| camera.fwhm_px.get(number?).copied()),
            frames: [tally.frames, tally.undetected],
            removed: vec![
                ("size", tally.rejected_area),
                ("fill", tally.rejected_fill),
                ("aspect", tally.rejected_aspect),
                ("sharp", tally.rejected_sharp),
                ("wide", tally.rejected_wide),
                ("edge", tally.rejected_edge),
                ("streak", tally.rejected_streak),
                ("offset", tally.rejected_offset),
            ],
            warnings: night.warnings.clone(),
            notes,
            took_s: 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: by hand: of 120,000 samples every fifth bunch's lowest and highest are drawn: a flash of one sample and an eclipse of one are among them, in the order of time;
    /// a stretch without a rate keeps its place.
    #[test]
    fn a_long_curve_keeps_its_flashes() {
        let mut rates: Vec<f64> = (0..120_000).map(|i| 100.0 + f64::from(i % 7)).collect();
        (rates[70_001], rates[90_002]) = (1e6, 0.0);
        rates[10_000..10_050].fill(f64::NAN);
        let sampled: Vec<usize> = (0..rates.len()).collect();
        let shown = thinned(&sampled, &rates);
        assert!(shown.len() <= SAMPLES && shown.len() > SAMPLES - 5000, "{}", shown.len());
        assert!(shown.is_sorted() && shown.windows(2).all(|pair| pair[0] < pair[1]));
        assert!(shown.contains(&70_001) && shown.contains(&90_002));
        assert_eq!(shown.iter().filter(|i| rates[**i].is_nan()).count(), 10);
        assert_eq!(thinned(&sampled[..SAMPLES], &rates).len(), SAMPLES);
    }
}
