//! A running night on the page: its live state, and the commands to it.

use crate::corrected::{Corrected, Predicted};
use crate::frame;
use crate::magnitudes::{Calibration, Off, PointMagnitudes, Points, Scale, sky_of};
use crate::marks::{Look, More, marks};
use crate::predicted::{StayCurves, brighten};
use crate::recorded::{About, DeviceView, FlipView, VisitView, fibres, flag_names, unix_ms};
use crate::request::{Answer, Request, Source};
use crate::sky::{Skies, SkyTrack};
use hifitime::{Duration, Epoch};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap, VecDeque};
use std::sync::{Arc, Mutex, OnceLock, PoisonError, TryLockError};
use std::time::Duration as Wait;
use sunglint_formats::session::DeviceKind;
use sunglint_formats::time::format_utc;
use sunglint_formats::toml::{Finite, Positive};
use sunglint_observatory::live::{
    Click, Control, ControlError, LiveCounts, LiveHistory, LiveState, LiveView, OffPoints, Seen,
};
use sunglint_observatory::{Pointing, Schedule, Slot};
use sunglint_radiometry::light_curve::LightCurve;
use sunglint_radiometry::station::{Mount, Station};

/// The words of a page's commands.
const ACTIONS: &str = "expected the action start, pause, resume, skip, repeat, stop, note, expose, focus, lock, keep, jog, halt, park or follow";
/// Frames whose focus and background are kept for each camera: those of an hour or more.
const LOOKS: usize = 7200;
/// Time that a command may take.
const COMMAND: Wait = Wait::from_secs(2);

/// A running night as a source of the page.
#[derive(Debug)]
pub struct LiveNight {
    state: Arc<LiveState>,
    program: String,
    /// Marks of the last frame that somebody asked for: one measurement for all pages.
    marked: Mutex<Option<Marked>>,
    /// Focus and background of the frames that were measured, by camera.
    looks: Mutex<HashMap<String, VecDeque<Look>>>,
    skies: Skies,
    corrected: OnceLock<Corrected>,
    predicted: Vec<LightCurve>,
    /// Curves of the plan's stars and satellites.
    stays: Mutex<StayCurves>,
    calibration: Option<Calibration>,
    scale: OnceLock<Result<Scale, String>>,
}

/// Marks that were measured last.
#[derive(Debug)]
struct Marked {
    camera: String,
    start: Epoch,
    /// Whether all sources are among them.
    sources: bool,
    answer: Answer,
}

/// State of the night, with the counts that came without dead time and dark counts.
#[derive(Serialize)]
struct Shown<'a> {
    #[serde(flatten)]
    view: &'a LiveView,
    corrected_hz: BTreeMap<&'a str, Vec<Vec<Option<f64>>>>,
    /// Magnitudes of the same points, where there is a calibration.
    magnitudes: BTreeMap<&'a str, PointMagnitudes>,
}

/// Counts of the whole night, and without dead time and dark counts.
#[derive(Serialize)]
struct HistoryView {
    #[serde(flatten)]
    view: LiveHistory,
    corrected_hz: Vec<Vec<Option<f64>>>,
}

/// Focus and background of frames, in the order in which they were measured.
#[derive(Serialize)]
struct LooksView {
    start_s: Vec<f64>,
    fwhm_px: Vec<Option<f64>>,
    hfr_px: Vec<Option<f64>>,
    background_adu: Vec<Option<f64>>,
}

/// Command of a page.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Asked {
    action: String,
    #[serde(default)]
    text: String,
    camera: Option<String>,
    exposure_s: Option<f64>,
    gain: Option<f64>,
    /// Start of the frame that was clicked on, s after the session's start, and the place in it.
    start_s: Option<f64>,
    place_px: Option<[f64; 2]>,
    /// Way beside, arcsec: to the right and up in the frame.
    arcsec: Option<[f64; 2]>,
}

#[derive(Serialize)]
struct Done<'a> {
    done: &'a str,
}

/// Rates of the sky in a visit to it, by channel.
fn sky_rate(corrected: &Corrected, off: &OffPoints) -> Vec<Option<Off>> {
    let each = off.counts.iter().zip(&off.length_s).zip(&off.flags);
    let points: Vec<(&[u64], f64, u32)> =
        each.map(|((counts, s), flags)| (counts.as_slice(), *s, *flags)).collect();
    sky_of(corrected, &off.channels, &points)
}

/// The sky at a time, s after the night's start: that of the last visit before it that has been measured, or else of the first after it. `skies` has when each visit began and its rates.
fn sky_at(skies: &[(f64, Vec<Option<Off>>)], at_s: f64) -> Vec<Option<Off>> {
    let known = || skies.iter().filter(|(_, rates)| rates.iter().any(Option::is_some));
    let found = known().rev().find(|(from_s, _)| *from_s <= at_s).or_else(|| known().next());
    found.map(|(_, rates)| rates.clone()).unwrap_or_default()
}

impl LiveNight {
    /// Shows a night's live state; `program` is the name and version of the program that runs it.
    pub fn new(state: Arc<LiveState>, program: &str) -> Self {
        Self {
            state,
            program: program.to_owned(),
            marked: Mutex::default(),
            looks: Mutex::default(),
            corrected: OnceLock::new(),
            predicted: Vec::new(),
            skies: Skies::default(),
            stays: Mutex::default(),
            calibration: None,
            scale: OnceLock::new(),
        }
    }

    /// Shows these curves beneath the counts, such as what `sunglint simulate` predicts.
    #[must_use]
    pub fn beside(mut self, curves: Vec<LightCurve>) -> Self {
        self.predicted = curves;
        self
    }

    /// Gives magnitudes by this calibration.
    #[must_use]
    pub fn calibrated(mut self, calibration: Option<Calibration>) -> Self {
        self.calibration = calibration;
        self
    }

    /// The scale of magnitudes; `None` without a calibration.
    fn scale(&self, station: &Station, start: Epoch) -> Option<&Result<Scale, String>> {
        let calibration = self.calibration.as_ref()?;
        Some(self.scale.get_or_init(|| Scale::new(calibration, station, start)))
    }

    /// Magnitudes of the counts in a view.
    fn magnitudes<'a>(
        &self,
        view: &'a LiveView,
        station: &Station,
        corrected: &Corrected,
    ) -> BTreeMap<&'a str, PointMagnitudes> {
        let Some(start) = self.state.start() else { return BTreeMap::new() };
        let Some(Ok(scale)) = self.scale(station, start) else { return BTreeMap::new() };
        let schedule = Schedule::new(self.state.slots());
        let mut pointing = Pointing::new(station.clone());
        let of = |(name, counts): (&'a String, &'a LiveCounts)| {
            let visits = self.state.off(name);
            let skies: Vec<(f64, Vec<Option<Off>>)> =
                visits.iter().map(|off| (off.from_s, sky_rate(corrected, off))).collect();
            let points = Points {
                channels: &counts.channels,
                start_s: &counts.start_s,
                length_s: &counts.length_s,
                rate_hz: &counts.rate_hz,
            };
            let target = |utc| schedule.at(utc).cloned();
            let off = |utc: Epoch| sky_at(&skies, (utc - start).to_seconds());
            let found = scale.points(points, corrected, &mut pointing, start, &target, &off);
            (name.as_str(), found)
        };
        view.counts.iter().map(of).collect()
    }

    fn predicted(&self) -> Result<Answer, Answer> {
        let start = self.start()?;
        let mut curves: Vec<Predicted> =
            self.predicted.iter().map(|curve| Predicted::of(curve, start)).collect();
        // What somebody gave goes before what the catalogue has.
        if curves.is_empty() {
            let mut stays = self.stays.lock().unwrap_or_else(PoisonError::into_inner);
            curves = stays.of(&self.state.slots(), &self.station()?, start);
        }
        Ok(Answer::json(&curves))
    }

    fn start(&self) -> Result<Epoch, Answer> {
        self.state.start().ok_or_else(|| Answer::error(503, "the night has not begun"))
    }

    fn station(&self) -> Result<Station, Answer> {
        self.state.station().ok_or_else(|| Answer::error(503, "the night has not begun"))
    }

    fn about(&self) -> Result<Answer, Answer> {
        let (start, station) = (self.start()?, self.station()?);
        let mut numbers: HashMap<String, u32> = HashMap::new();
        let slots = Schedule::new(self.state.slots()).visits();
        let visit = |slot: &Slot| {
            let number = numbers.entry(slot.target.name.clone()).or_default();
            *number += 1;
            let to = slot.to.unwrap_or(slot.from + Duration::from_hours(24.0));
            VisitView {
                name: slot.target.name.clone(),
                kind: slot.target.target_kind,
                number: *number,
                from_s: (slot.from - start).to_seconds(),
                to_s: (to - start).to_seconds(),
            }
        };
        let devices = self.state.devices();
        let camera = devices.iter().find(|device| device.kind == "camera");
        let station_camera = camera.map(|device| device.name.clone());
        let devices = devices.into_iter().map(|device| DeviceView {
            kind: if device.kind == "camera" { DeviceKind::Camera } else { DeviceKind::Counter },
            name: device.name,
            channels: device.channels,
            exposure_s: 0.0,
            taken: 0,
        });
        let mut warnings = station.warnings.clone();
        let magnitudes = match self.scale(&station, start) {
            Some(Ok(scale)) => Some(scale.view.clone()),
            Some(Err(error)) => {
                warnings.push(error.clone());
                None
            }
            None => None,
        };
        Ok(Answer::json(&About {
            mode: "live",
            name: self.state.name(),
            station: station.name.clone(),
            program: self.program.clone(),
            start_utc: format_utc(start, 3),
            start_unix_ms: unix_ms(start),
            length_s: None,
            ended: false,
            devices: devices.collect(),
            visits: slots.iter().map(visit).collect(),
            fibres: fibres(&station),
            station_camera,
            sensor_px: station.camera.as_ref().map(|camera| camera.size_px),
            // The state has it as it is now.
            clock: None,
            flag_names: flag_names(),
            sun_limit_deg: self.state.sun_limit_deg(),
            focusers: self.state.focusers(),
            flip: self.flip(&station),
            warnings,
            magnitudes,
        }))
    }

    /// Where the mount turns over: an equatorial one that is not known to be a fork.
    fn flip(&self, station: &Station) -> Option<FlipView> {
        let past_deg = self.state.past_meridian_deg()?;
        let latitude_deg = station.site.geodetic().latitude_deg;
        (station.telescope.mount == Mount::Equatorial)
            .then_some(FlipView { latitude_deg, past_deg })
    }

    fn live(&self, request: &Request) -> Result<Answer, Answer> {
        let counts =
            request.prefixed("c.").filter_map(|(name, n)| Some((name.to_owned(), n.parse().ok()?)));
        let seen = Seen { events: request.whole("events").unwrap_or(0), counts: counts.collect() };
        let view = self.state.since(&seen);
        let view = view.ok_or_else(|| Answer::error(503, "the night has not begun"))?;
        let station = self.station()?;
        let corrected = self.corrected.get_or_init(|| Corrected::of(&station));
        let counts = view.counts.iter().map(|(name, counts)| {
            let rates = corrected.all(&counts.channels, &counts.rate_hz, &counts.length_s);
            (name.as_str(), rates)
        });
        let magnitudes = self.magnitudes(&view, &station, corrected);
        Ok(Answer::json(&Shown { corrected_hz: counts.collect(), magnitudes, view: &view }))
    }

    fn frame(&self, request: &Request, camera: &str) -> Result<Answer, Answer> {
        let (number, frame) = self.state.last_frame(camera).ok_or_else(Answer::missing)?;
        Ok(frame::encode(&frame, number, self.start()?, request))
    }

    fn marks(&self, request: &Request, camera: &str) -> Result<Answer, Answer> {
        let (_, frame) = self.state.last_frame(camera).ok_or_else(Answer::missing)?;
        // One measurement at a time: several pages that ask for it must not hold all workers.
        let mut marked = match self.marked.try_lock() {
            Ok(marked) => marked,
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(TryLockError::WouldBlock) => {
                return Err(Answer::error(503, "a frame is being measured: ask again"));
            }
        };
        let sources = request.whole("sources") == Some(1);
        let known = marked.as_ref().filter(|of| of.camera == camera && of.start == frame.start);
        if let Some(of) = known.filter(|of| of.sources || !sources) {
            return Ok(of.answer.clone());
        }
        let (station, start) = (self.station()?, self.start()?);
        let sharpness =
            known.is_none() && self.wants_sharpness(camera, (frame.start - start).to_seconds());
        let view = marks(&frame, &station, start, More { sharpness, sources })?;
        if known.is_none() {
            self.note_look(camera, view.look());
        }
        let answer = Answer::json(&view);
        let (camera, start) = (camera.to_owned(), frame.start);
        *marked = Some(Marked { camera, start, sources, answer: answer.clone() });
        Ok(answer)
    }

    /// Whether the half-flux radius is due: once in a second is enough.
    fn wants_sharpness(&self, camera: &str, start_s: f64) -> bool {
        let looks = self.looks.lock().unwrap_or_else(PoisonError::into_inner);
        let of = looks.get(camera).into_iter().flatten().rev();
        !of.take_while(|look| look.start_s > start_s - 1.0).any(|look| look.sharp)
    }

    fn note_look(&self, camera: &str, look: Look) {
        let mut looks = self.looks.lock().unwrap_or_else(PoisonError::into_inner);
        let of = looks.entry(camera.to_owned()).or_default();
        of.push_back(look);
        while of.len() > LOOKS {
            of.pop_front();
        }
    }

    /// Focus and background of the frames that were measured since a time.
    fn looks(&self, request: &Request, camera: &str) -> Answer {
        let after_s = request.number("after_s").unwrap_or(f64::NEG_INFINITY);
        let looks = self.looks.lock().unwrap_or_else(PoisonError::into_inner);
        let of = || looks.get(camera).into_iter().flatten().filter(|look| look.start_s > after_s);
        Answer::json(&LooksView {
            start_s: of().map(|look| look.start_s).collect(),
            fwhm_px: of().map(|look| look.fwhm_px).collect(),
            hfr_px: of().map(|look| look.hfr_px).collect(),
            background_adu: of().map(|look| look.background_adu).collect(),
        })
    }

    /// The counts of the whole night in points of some seconds.
    fn history(&self, request: &Request, counter: &str) -> Result<Answer, Answer> {
        let from = request.whole("from").unwrap_or(0);
        let view = self.state.history(counter, from).ok_or_else(Answer::missing)?;
        let station = self.station()?;
        let corrected = self.corrected.get_or_init(|| Corrected::of(&station));
        let corrected_hz = corrected.all(&view.channels, &view.rate_hz, &view.length_s);
        Ok(Answer::json(&HistoryView { view, corrected_hz }))
    }

    fn sky(&self, request: &Request) -> Result<Answer, Answer> {
        let (start, station) = (self.start()?, self.station()?);
        let at_s = request.number("at_s").unwrap_or(0.0).clamp(-1e9, 1e9);
        let utc = start + Duration::from_seconds(at_s);
        let schedule = Schedule::new(self.state.slots());
        self.skies
            .at(&station, start, utc, schedule.at(utc))
            .map(|sky| Answer::json(&sky))
            .ok_or_else(|| Answer::error(422, "no sky is known for that time"))
    }

    fn tracks(&self) -> Result<Answer, Answer> {
        let (start, station) = (self.start()?, self.station()?);
        let slots = self.state.slots();
        let mut tracks: Vec<(SkyTrack, &Slot)> = Vec::new();
        for slot in &slots {
            let to = slot.to.unwrap_or(slot.from + Duration::from_hours(1.0));
            let track = SkyTrack::over(&station, start, &slot.target, slot.from, to);
            tracks.extend(track.map(|track| (track, slot)));
        }
        brighten(&mut tracks, &station, start);
        Ok(Answer::json(&tracks.iter().map(|(track, _)| track).collect::<Vec<_>>()))
    }

    /// The place in a frame that a person pointed at.
    fn click(&self, asked: &Asked) -> Result<Click, Answer> {
        let wrong = |text: &str| Answer::error(422, text);
        let camera = asked.camera.clone().ok_or_else(|| wrong("expected the name of a camera"))?;
        let seconds = asked.start_s.filter(|s| s.abs() < 1e7);
        let seconds = seconds.ok_or_else(|| wrong("expected the start of a frame, s"))?;
        let place_px = asked.place_px.filter(|place| place.iter().all(|x| x.is_finite()));
        let place_px = place_px.ok_or_else(|| wrong("expected a place, column and row"))?;
        Ok(Click {
            camera,
            start: self.start()? + Duration::from_seconds(seconds),
            place_px: place_px.into(),
        })
    }

    fn control(&self, request: &Request) -> Result<Answer, Answer> {
        let asked: Asked = serde_json::from_slice(&request.body)
            .map_err(|error| Answer::error(400, &format!("no command: {error}")))?;
        let control = match asked.action.as_str() {
            "start" => Control::Start,
            "pause" => Control::Pause,
            "resume" => Control::Resume,
            "skip" => Control::Skip,
            "stop" => Control::Stop,
            "note" => Control::Note(asked.text),
            "expose" => expose(&asked)?,
            "focus" => {
                let none = || Answer::error(422, "expected the name of a camera");
                Control::Focus { camera: asked.camera.ok_or_else(none)? }
            }
            "repeat" => Control::Repeat,
            "lock" => Control::Lock(self.click(&asked)?),
            "keep" => Control::Keep(self.click(&asked)?),
            "jog" => {
                let wrong = || Answer::error(422, "a jog is two numbers, arcsec");
                let arcsec = asked.arcsec.filter(|way| way.iter().all(|x| x.is_finite()));
                Control::Jog(arcsec.ok_or_else(wrong)?.into())
            }
            "halt" => Control::Halt,
            "park" => Control::Park,
            "follow" => Control::Follow,
            _ => return Err(Answer::error(400, ACTIONS)),
        };
        let said = |error: ControlError| match error {
            ControlError::Busy => Answer::error(503, &error.to_string()),
            _ => Answer::error(409, &error.to_string()),
        };
        let answer = self.state.ask(control).map_err(said)?.recv_timeout(COMMAND);
        let answer = answer
            .map_err(|_| Answer::error(503, "the night did not answer: look at its state"))?;
        answer.map(|done| Answer::json(&Done { done: &done })).map_err(said)
    }
}

/// Exposure and gain of a camera's next frames.
fn expose(asked: &Asked) -> Result<Control, Answer> {
    let wrong = |text: &str| Answer::error(422, text);
    let exposure = |exposure_s| {
        Positive::new(exposure_s).ok_or_else(|| wrong("an exposure is a number above 0, s"))
    };
    let gain = |gain| Finite::new(gain).ok_or_else(|| wrong("a gain is a number"));
    Ok(Control::Expose {
        camera: asked.camera.clone().ok_or_else(|| wrong("expected the name of a camera"))?,
        exposure_s: asked.exposure_s.map(exposure).transpose()?,
        gain: asked.gain.map(gain).transpose()?,
    })
}

impl Source for LiveNight {
    fn answer(&self, request: &Request) -> Answer {
        let parts = request.parts();
        let answer = match (request.post, parts.as_slice()) {
            (true, ["control"]) => self.control(request),
            (true, _) => Err(Answer::error(405, "only `control` takes a POST")),
            (false, ["about"]) => self.about(),
            (false, ["live"]) => self.live(request),
            (false, ["frame", camera]) => self.frame(request, camera),
            (false, ["marks", camera, "last"]) => self.marks(request, camera),
            (false, ["looks", camera]) => Ok(self.looks(request, camera)),
            (false, ["history", counter]) => self.history(request, counter),
            (false, ["sky"]) => self.sky(request),
            (false, ["tracks"]) => self.tracks(),
            (false, ["predicted"]) => self.predicted(),
            _ => Err(Answer::missing()),
        };
        answer.unwrap_or_else(|answer| answer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: by hand: the last visit before a time that has been measured, else the first after it.
    #[test]
    fn each_point_has_the_sky_of_its_time() {
        let skies = [
            (10.0, vec![Some((1.0, 0.1)), None]),
            (50.0, vec![Some((2.0, 0.1)), None]),
            (90.0, vec![None, None]),
        ];
        let rate = |at_s| sky_at(&skies, at_s).first().copied().flatten().map(|(rate, _)| rate);
        for (at_s, expected) in [(5.0, 1.0), (10.0, 1.0), (49.9, 1.0), (60.0, 2.0), (95.0, 2.0)] {
            assert_eq!(rate(at_s), Some(expected), "{at_s}");
        }
        assert!(sky_at(&skies[2..], 95.0).is_empty());
    }
}
