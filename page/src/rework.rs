//! A recorded visit reduced again, with other choices: the same call as `sunglint reduce --recipe`.

use crate::request::Answer;
use hifitime::Epoch;
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;
use sunglint_calibration::reduction::frames::FrameLook;
use sunglint_calibration::reduction::recipe::Recipe;
use sunglint_calibration::reduction::{ReduceError, ReduceOptions, Reduced, Visited, reduce};
use sunglint_formats::atomic::{Overwrite, write_file};
use sunglint_formats::ecsv;
use sunglint_formats::session::Session;
use sunglint_numerics::progress::Progress;
use sunglint_radiometry::light_curve::Flags;
use sunglint_radiometry::station::{Detector, Station};

/// Samples of each channel in an answer at most: more are left out and counted.
const SAMPLES: usize = 50_000;

/// Reductions of one session, one at a time; a newer wish ends the older one.
#[derive(Debug, Default)]
pub(crate) struct Rework {
    wishes: AtomicU64,
    one: Mutex<()>,
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
    /// Width of a point that was expected, px.
    fwhm_px: Option<f64>,
    /// Frames that were measured, and those without a target.
    frames: [u64; 2],
    /// Sources that each filter removed.
    removed: Vec<(&'static str, u64)>,
    warnings: Vec<String>,
    /// Samples that did not fit into the answer.
    left_out: usize,
    took_s: f64,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct ChannelView {
    name: String,
    unit: &'static str,
    time_s: Vec<f64>,
    rate: Vec<Option<f64>>,
    sigma: Vec<Option<f64>>,
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
        if recipe.target.is_none() || recipe.visit.is_none() {
            return Err(Answer::error(422, "the recipe names no target and visit"));
        }
        let wish =
            Wish { number: self.wishes.fetch_add(1, Ordering::Relaxed) + 1, wishes: &self.wishes };
        let _one = self.one.lock().unwrap_or_else(PoisonError::into_inner);
        let said = |error: ReduceError| match deepest(&error) {
            ReduceError::Cancelled(_) => Answer::error(409, "a newer reduction was asked for"),
            _ => Answer::error(422, &whole(&error)),
        };
        let mut options = ReduceOptions::for_station(station);
        recipe.apply(&mut options);
        let mut night = reduce(session, station, &options, &wish).map_err(said)?;
        let visited = night.take(session, station).map_err(said)?;
        let nothing = || {
            let why = night.warnings.join("; ");
            Answer::error(422, &format!("nothing was recorded of this visit: {why}"))
        };
        let visited = visited.ok_or_else(nothing)?;
        Ok((night, visited))
    }

    /// The curve of a visit, for the screen.
    pub fn curve(
        &self,
        session: &Session,
        station: &Station,
        body: &[u8],
    ) -> Result<Answer, Answer> {
        let begun = Instant::now();
        let recipe: Recipe = parsed(body)?;
        let (night, visited) = self.visited(session, station, &recipe)?;
        let start = session.manifest().start_utc;
        let mut view = CurveView::of(&night, &visited, station, start);
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

    /// Writes a recipe into the session's folder.
    pub fn save(session: &Session, body: &[u8]) -> Result<Answer, Answer> {
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
        Ok(Answer::json(&SavedView {
            name: &name,
            file: path.display().to_string(),
            repeat: format!("sunglint reduce {root} --recipe {name} -o {name}/"),
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

impl CurveView {
    fn of(night: &Reduced, visited: &Visited, station: &Station, start: Epoch) -> Self {
        let seconds = |time: Epoch| (time - start).to_seconds();
        let samples = &visited.linear.samples;
        let mut left_out = 0;
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
                flags: Vec::new(),
            };
            let finite = |value: f64| value.is_finite().then_some(value);
            for (i, flags) in channel.flags.iter().enumerate() {
                if flags.contains(Flags::NOT_SAMPLED) {
                    continue;
                }
                if view.time_s.len() >= SAMPLES {
                    left_out += 1;
                    continue;
                }
                view.time_s.push(seconds(samples.time[i]));
                view.rate.push(finite(channel.rate_hz[i]));
                view.sigma.push(finite(channel.sigma_hz[i]));
                view.flags.push(flags.bits());
            }
            view
        });
        let mut channels: Vec<ChannelView> = channels.collect();
        let found = visited.track.points.iter();
        let found = found.filter_map(|point| Some((seconds(point.time), point.place?.offset_px)));
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
                flags: vec![0; looks.len()],
            };
            channels.push(of("focus (width of the target)", "px", &|look| look.fwhm_px));
            channels.push(of("background", "ADU", &|look| finite(look.background_adu)));
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
            left_out,
            took_s: 0.0,
        }
    }
}
