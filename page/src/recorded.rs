//! A recorded session, to be looked at like a film: an index of its frames, bins and events in memory, all else read when it is asked for.

use crate::clip::ClipWish;
use crate::corrected::{Corrected, Predicted};
use crate::frame;
use crate::magnitudes::{Calibration, MagnitudesView, Off, PointMagnitudes, Points, Scale, sky_of};
use crate::marks::{More, marks};
use crate::request::{Answer, Request, Source};
use crate::rework::Rework;
use crate::sky::{Sky, SkyTrack};
use glam::DVec2;
use hifitime::{Duration, Epoch};
use serde::Serialize;
use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError, TryLockError};
use sunglint_calibration::timing::Timings;
use sunglint_formats::session::{
    ClockState, CountBlock, CountIndex, DeviceKind, FrameFile, Session, Target, TargetKind, Visit,
    What,
};
use sunglint_formats::time::format_utc;
use sunglint_formats::{CountRecord, FileError, Frame};
use sunglint_observatory::Pointing;
use sunglint_observatory::live::LiveEvent;
use sunglint_radiometry::light_curve::LightCurve;
use sunglint_radiometry::station::{Detector, Station};

/// Points of a plot at most.
const POINTS: u64 = 4000;
/// Bins that are read from the file for one plot at most.
const BINS: u64 = 40_000;
/// Bins of a visit to the sky that are read at most.
const SKY_BINS: usize = 6000;
/// Events in an answer at most.
const EVENTS: usize = 5000;

/// A device, as the page shows it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DeviceView {
    /// Name in the session.
    pub name: String,
    /// Camera or counter.
    pub kind: DeviceKind,
    /// Channels of a counter.
    pub channels: Vec<String>,
    /// Exposure or length of a bin, s.
    pub exposure_s: f64,
    /// Frames or bins.
    pub taken: u64,
}

/// A visit, as the page shows it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct VisitView {
    /// Name of the target.
    pub name: String,
    /// Kind of the target.
    pub kind: TargetKind,
    /// Which visit of this target it is.
    pub number: u32,
    /// When it began, s after the session's start.
    pub from_s: f64,
    /// When it ended.
    pub to_s: f64,
}

/// Field of a fibre on the camera: from the middle of its sensor.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FibreView {
    /// Channel.
    pub channel: String,
    /// Middle, columns and rows, px.
    pub offset_px: DVec2,
    /// Half widths, px.
    pub sigma_px: DVec2,
}

/// Stretch of the sky in which a German mount still hangs on the side that it has east of the meridian.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FlipView {
    /// Latitude of the station, deg.
    pub latitude_deg: f64,
    /// Hour angle up to which it follows before it is turned over, deg.
    pub past_deg: f64,
}

/// Description of a session, live or recorded.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct About {
    /// `recorded` or `live`.
    pub mode: &'static str,
    /// Name of the session's folder.
    pub name: String,
    /// Name of the station.
    pub station: String,
    /// Program that recorded it.
    pub program: String,
    /// When it began, UTC.
    pub start_utc: String,
    /// The same in milliseconds of Unix time, for clocks.
    pub start_unix_ms: f64,
    /// How long it is, s.
    pub length_s: Option<f64>,
    /// Whether it ended in good order.
    pub ended: bool,
    /// Devices.
    pub devices: Vec<DeviceView>,
    /// Visits.
    pub visits: Vec<VisitView>,
    /// Fields of fibres.
    pub fibres: Vec<FibreView>,
    /// Name of the camera that the station describes, on which the fibres lie and the reduction has its place: the first one.
    pub station_camera: Option<String>,
    /// Size of the camera's sensor, px.
    pub sensor_px: Option<[u32; 2]>,
    /// How far the computer's clock was from UTC at the start.
    pub clock: Option<ClockState>,
    /// Names of the bits of the counts' flags.
    pub flag_names: Vec<(u32, String)>,
    /// Least distance of the mount from the Sun, deg; `None` without a mount.
    pub sun_limit_deg: Option<f64>,
    /// Cameras of a running night that have a focuser.
    pub focusers: Vec<String>,
    /// Where the mount turns over; `None` without a mount that may.
    pub flip: Option<FlipView>,
    /// What is wrong, for the person who looks.
    pub warnings: Vec<String>,
    /// Where magnitudes come from; `None` without a calibration.
    pub magnitudes: Option<MagnitudesView>,
}

/// Milliseconds of Unix time.
pub(crate) fn unix_ms(epoch: Epoch) -> f64 {
    epoch.to_unix_milliseconds()
}

/// Fields of the fibres of a station.
pub(crate) fn fibres(station: &Station) -> Vec<FibreView> {
    let of = |channel: &sunglint_radiometry::station::Channel| match &channel.detector {
        Detector::Counter(counter) => counter.fibre.map(|fibre| FibreView {
            channel: channel.name.clone(),
            offset_px: fibre.offset_px,
            sigma_px: fibre.sigma_px,
        }),
        Detector::CameraPlane(_) => None,
    };
    station.channels.iter().filter_map(of).collect()
}

/// Names of the bits of the counts' flags.
pub(crate) fn flag_names() -> Vec<(u32, String)> {
    let all = sunglint_formats::CountFlags::all();
    all.iter_names().map(|(name, flag)| (flag.bits(), name.to_lowercase())).collect()
}

#[derive(Debug)]
struct CameraFilm {
    name: String,
    files: Vec<FrameFile>,
    start_s: Vec<f64>,
}

/// Frames of a camera: when, and which number.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct FilmView<'a> {
    start_s: &'a [f64],
    number: Vec<u64>,
}

/// Rates over a stretch of time.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct CountsView {
    /// Channels, in the order of the rates.
    pub channels: Vec<String>,
    /// Bins in each point: 1 where all are shown.
    pub bins: u64,
    /// Start of each point, s after the session's start.
    pub start_s: Vec<f64>,
    /// Length of each point, s.
    pub length_s: Vec<f64>,
    /// Mean rate of each channel, Hz.
    pub rate_hz: Vec<Vec<f64>>,
    /// Lowest rate of a bin.
    pub low_hz: Vec<Vec<f64>>,
    /// Highest rate of a bin.
    pub high_hz: Vec<Vec<f64>>,
    /// Flags of any of the bins.
    pub flags: Vec<u32>,
    /// Mean rate without dead time and dark counts, Hz; `None` where the station does not tell, or the counter was saturated.
    pub corrected_hz: Vec<Vec<Option<f64>>>,
    /// Magnitudes of the target, where there is a calibration.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) magnitudes: Option<PointMagnitudes>,
}

#[derive(Serialize)]
struct EventsView<'a> {
    events: &'a [LiveEvent],
    /// Whether there are more after them.
    more: bool,
}

/// Rates of the sky by channel, for a counter and the number of a visit.
type SkyRates = HashMap<(String, usize), Vec<Option<Off>>>;
type LastFrame = Option<(String, usize, Arc<Frame>)>;

/// A recorded session with its index.
#[derive(Debug)]
pub struct Recording {
    session: Session,
    name: String,
    start: Epoch,
    end: Epoch,
    ended: bool,
    visits: Vec<Visit>,
    events: Vec<LiveEvent>,
    cameras: Vec<CameraFilm>,
    counters: Vec<(String, CountIndex)>,
    station: Result<Station, String>,
    tracks: Mutex<Option<Arc<Vec<SkyTrack>>>>,
    last: Mutex<LastFrame>,
    rework: Rework,
    /// One clip at a time.
    clip: Mutex<()>,
    corrected: Corrected,
    predicted: Vec<Predicted>,
    scale: Option<Scale>,
    /// Rates of the sky by counter and visit, as they are asked for.
    sky: Mutex<SkyRates>,
    warnings: Vec<String>,
}

impl Recording {
    /// Opens a session: reads its log and its counts once, and the names of its frames.
    ///
    /// # Errors
    /// A folder that is no session; a file that cannot be read. What is wrong within the log or the counts is a warning on the page.
    pub fn open(folder: impl AsRef<Path>) -> Result<Self, FileError> {
        Self::open_at(folder.as_ref())
    }

    fn open_at(folder: &Path) -> Result<Self, FileError> {
        let session = Session::open(folder)?;
        let start = session.manifest().start_utc;
        let mut warnings = Vec::new();
        let (mut events, mut visits, mut end, mut ended) = (Vec::new(), Vec::new(), start, false);
        for event in session.events()?.without_marks() {
            let event = match event {
                Ok(event) => event,
                Err(error) => {
                    warnings.push(error.to_string());
                    continue;
                }
            };
            end = end.max(event.utc);
            ended |= matches!(event.what, What::End { .. });
            follow(&mut visits, &event.what, event.utc);
            events.push(LiveEvent::of(events.len() as u64 + 1, &event, start));
        }
        let mut cameras = Vec::new();
        for name in session.cameras() {
            let mut files = session.frames(name)?.files;
            files.retain(|file| file.start().is_some());
            let seconds = |file: &FrameFile| file.start().map(|at| (at - start).to_seconds());
            let start_s: Vec<f64> = files.iter().filter_map(seconds).collect();
            let exposure =
                session.manifest().devices_of(DeviceKind::Camera).find(|d| d.name == name);
            let exposure_s = exposure.map_or(0.0, |device| device.exposure_s);
            if let Some(last) = files.last().and_then(FrameFile::start) {
                end = end.max(last + Duration::from_seconds(exposure_s));
            }
            cameras.push(CameraFilm { name: name.to_owned(), files, start_s });
        }
        let mut counters = Vec::new();
        for name in session.counters() {
            match session.count_index(name) {
                Ok(index) => {
                    if let Some(fault) = index.fault() {
                        warnings.push(format!("counts of {name} end at {fault}"));
                    }
                    if let Some([_, last]) = index.span() {
                        end = end.max(last);
                    }
                    counters.push((name.to_owned(), index));
                }
                Err(error) => warnings.push(error.to_string()),
            }
        }
        if !ended {
            warnings
                .push("this session did not end in good order, or is still being written".into());
        }
        let station = Station::of_session(&session).map_err(|error| error.to_string());
        if let Err(error) = &station {
            warnings.push(format!("no sky and no aperture: {error}"));
        }
        let corrected = station.as_ref().map(Corrected::of).unwrap_or_default();
        visits.retain(|visit: &Visit| visit.target.target_kind != TargetKind::None);
        let name = session.root().canonicalize().unwrap_or_else(|_| session.root().to_path_buf());
        let name = name.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Self {
            session,
            name,
            start,
            end,
            ended,
            visits,
            events,
            cameras,
            counters,
            station,
            tracks: Mutex::default(),
            last: Mutex::default(),
            rework: Rework::default(),
            clip: Mutex::default(),
            corrected,
            predicted: Vec::new(),
            scale: None,
            sky: Mutex::default(),
            warnings,
        })
    }

    /// Shows these curves beneath the counts, such as what `sunglint simulate` predicts.
    #[must_use]
    pub fn beside(mut self, curves: &[LightCurve]) -> Self {
        self.predicted = curves.iter().map(|curve| Predicted::of(curve, self.start)).collect();
        self
    }

    /// Gives magnitudes by this calibration; what it lacks is a warning on the page.
    #[must_use]
    pub fn calibrated(mut self, calibration: Option<&Calibration>) -> Self {
        let Some((calibration, station)) = calibration.zip(self.station.as_ref().ok()) else {
            return self;
        };
        match Scale::new(calibration, station, self.start) {
            Ok(scale) => self.scale = Some(scale),
            Err(error) => self.warnings.push(error),
        }
        self
    }

    /// Takes what was measured of the cameras' times off those of the frames when a visit is reduced again, as `sunglint reduce --timing` does.
    #[must_use]
    pub fn timed(mut self, timings: Option<Timings>) -> Self {
        self.rework.timings = timings;
        self
    }

    /// Rate of the sky in each channel of a counter: of the last visit to it before a time, or else of the first after it.
    fn sky_rate(&self, counter: &str, index: &CountIndex, utc: Epoch) -> Vec<Option<Off>> {
        let of_sky = |visit: &&(usize, &Visit)| visit.1.target.target_kind == TargetKind::Sky;
        let visits: Vec<(usize, &Visit)> = self.visits.iter().enumerate().collect();
        let before = visits.iter().rev().filter(of_sky).find(|(_, visit)| visit.from <= utc);
        let Some((number, visit)) = before.or_else(|| visits.iter().find(of_sky)) else {
            return Vec::new();
        };
        let mut known = self.sky.lock().unwrap_or_else(PoisonError::into_inner);
        let made = known.entry((counter.to_owned(), *number)).or_insert_with(|| {
            let to = visit.to.unwrap_or(self.end);
            let records = index.records(visit.from, to, SKY_BINS).unwrap_or_default();
            let length_s = |record: &CountRecord| record.length_ps as f64 * 1e-12;
            let within = |record: &&CountRecord| {
                record.start >= visit.from
                    && record.start + Duration::from_seconds(length_s(record)) <= to
            };
            let points: Vec<(&[u64], f64, u32)> = records
                .iter()
                .filter(within)
                .map(|record| (record.counts.as_slice(), length_s(record), record.flags.bits()))
                .collect();
            sky_of(&self.corrected, index.channels(), &points)
        });
        made.clone()
    }

    /// Magnitudes of the points of a view.
    fn magnitudes(
        &self,
        view: &CountsView,
        counter: &str,
        index: &CountIndex,
    ) -> Option<PointMagnitudes> {
        let (scale, station) = (self.scale.as_ref()?, self.station.as_ref().ok()?);
        let points = Points {
            channels: &view.channels,
            start_s: &view.start_s,
            length_s: &view.length_s,
            rate_hz: &view.rate_hz,
        };
        let target = |utc| self.target_at(utc).cloned();
        let off = |utc| self.sky_rate(counter, index, utc);
        let mut pointing = Pointing::new(station.clone());
        Some(scale.points(points, &self.corrected, &mut pointing, self.start, &target, &off))
    }

    fn seconds(&self, epoch: Epoch) -> f64 {
        (epoch - self.start).to_seconds()
    }

    /// A time that a request names; the session's start for nonsense.
    fn time(&self, seconds: f64) -> Epoch {
        self.start + Duration::from_seconds(seconds.clamp(-1e9, 1e9))
    }

    /// Description of the session.
    pub fn about(&self) -> About {
        let manifest = self.session.manifest();
        let taken = |name: &str| {
            let frames = self.cameras.iter().find(|c| c.name == name).map(|c| c.files.len() as u64);
            let bins = self.counters.iter().find(|c| c.0 == name).map(|c| c.1.rows());
            frames.or(bins).unwrap_or(0)
        };
        let device = |device: &sunglint_formats::session::Device| DeviceView {
            name: device.name.clone(),
            kind: device.kind,
            channels: device.channels.clone(),
            exposure_s: device.exposure_s,
            taken: taken(&device.name),
        };
        let visit = |visit: &Visit| VisitView {
            name: visit.target.name.clone(),
            kind: visit.target.target_kind,
            number: visit.number,
            from_s: self.seconds(visit.from),
            to_s: self.seconds(visit.to.unwrap_or(self.end)),
        };
        let station = self.station.as_ref().ok();
        About {
            mode: "recorded",
            name: self.name.clone(),
            station: manifest.station.clone(),
            program: manifest.program.clone(),
            start_utc: format_utc(self.start, 3),
            start_unix_ms: unix_ms(self.start),
            length_s: Some(self.seconds(self.end)),
            ended: self.ended,
            devices: manifest.devices.iter().map(device).collect(),
            visits: self.visits.iter().map(visit).collect(),
            fibres: station.map(fibres).unwrap_or_default(),
            station_camera: self.session.cameras().next().map(str::to_owned),
            sensor_px: station.and_then(|s| s.camera.as_ref()).map(|camera| camera.size_px),
            clock: Some(manifest.clock.clone()),
            flag_names: flag_names(),
            sun_limit_deg: None,
            focusers: Vec::new(),
            flip: None,
            warnings: self.warnings.clone(),
            magnitudes: self.scale.as_ref().map(|scale| scale.view.clone()),
        }
    }

    fn film(&self, camera: &str) -> Option<&CameraFilm> {
        self.cameras.iter().find(|film| film.name == camera)
    }

    /// A frame, read unless it was the last one.
    fn read(&self, film: &CameraFilm, index: usize) -> Result<Arc<Frame>, Answer> {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((name, at, frame)) = &*last
            && *name == film.name
            && *at == index
        {
            return Ok(frame.clone());
        }
        let file = film.files.get(index).ok_or_else(Answer::missing)?;
        let frame = file.read().map_err(|error| Answer::error(500, &error.to_string()))?;
        let frame = Arc::new(frame);
        *last = Some((film.name.clone(), index, frame.clone()));
        Ok(frame)
    }

    fn frame(&self, request: &Request, camera: &str, index: &str) -> Result<Answer, Answer> {
        let film = self.film(camera).ok_or_else(Answer::missing)?;
        let index = index.parse().map_err(|_| Answer::missing())?;
        let frame = self.read(film, index)?;
        Ok(frame::encode(&frame, film.files[index].sequence, self.start, request))
    }

    fn marks(&self, request: &Request, camera: &str, index: &str) -> Result<Answer, Answer> {
        let film = self.film(camera).ok_or_else(Answer::missing)?;
        let frame = self.read(film, index.parse().map_err(|_| Answer::missing())?)?;
        let station = self.station.as_ref().map_err(|error| Answer::error(422, error))?;
        let more = More { sharpness: true, sources: request.whole("sources") == Some(1) };
        marks(&frame, station, self.start, more).map(|marks| Answer::json(&marks))
    }

    fn counts(&self, request: &Request, counter: &str) -> Result<Answer, Answer> {
        let (_, index) =
            self.counters.iter().find(|c| c.0 == counter).ok_or_else(Answer::missing)?;
        let from = self.time(request.number("from_s").unwrap_or(0.0));
        let to = self.time(request.number("to_s").unwrap_or(1e9));
        let points = request.whole("points").unwrap_or(1000).clamp(1, POINTS);
        let blocks = index.within(from, to);
        let rows: u64 = blocks.iter().map(|block| block.rows).sum();
        let mut view = CountsView::new(index.channels());
        if rows <= points.saturating_mul(2).min(BINS) {
            let most = usize::try_from(BINS).unwrap_or(usize::MAX);
            let records = index.records(from, to, most);
            let records = records.map_err(|error| Answer::error(500, &error.to_string()))?;
            view.bins = 1;
            for record in &records {
                view.bin(record, self.seconds(record.start));
            }
        } else {
            let step = (blocks.len() as u64).div_ceil(points).max(1) as usize;
            view.bins = blocks.first().map_or(1, |block| block.rows * step as u64);
            for part in blocks.chunks(step) {
                view.block(part, self.seconds(part[0].start));
            }
        }
        view.corrected_hz = self.corrected.all(&view.channels, &view.rate_hz, &view.length_s);
        view.magnitudes = self.magnitudes(&view, counter, index);
        Ok(Answer::json(&view))
    }

    fn target_at(&self, utc: Epoch) -> Option<&Target> {
        let visit = self.visits.iter().rev().find(|visit| visit.from <= utc)?;
        visit.to.is_none_or(|to| utc < to).then_some(&visit.target)
    }

    fn sky(&self, request: &Request) -> Result<Answer, Answer> {
        let station = self.station.as_ref().map_err(|error| Answer::error(422, error))?;
        let utc = self.time(request.number("at_s").unwrap_or(0.0));
        Sky::at(station, self.start, utc, self.target_at(utc))
            .map(|sky| Answer::json(&sky))
            .ok_or_else(|| Answer::error(422, "no sky is known for that time"))
    }

    fn tracks(&self) -> Result<Answer, Answer> {
        let station = self.station.as_ref().map_err(|error| Answer::error(422, error))?;
        let mut tracks = self.tracks.lock().unwrap_or_else(PoisonError::into_inner);
        let made = tracks.get_or_insert_with(|| {
            let of = |visit: &Visit| {
                let to = visit.to.unwrap_or(self.end);
                SkyTrack::over(station, self.start, &visit.target, visit.from, to)
            };
            Arc::new(self.visits.iter().filter_map(of).collect())
        });
        Ok(Answer::json(&**made))
    }

    /// A visit reduced again, or a recipe saved.
    fn reworked(&self, what: &str, body: &[u8]) -> Result<Answer, Answer> {
        let station = self.station.as_ref().map_err(|error| Answer::error(422, error))?;
        match what {
            "reduction" => self.rework.curve(&self.session, station, self.scale.as_ref(), body),
            "reduction.ecsv" => self.rework.file(&self.session, station, body),
            _ => self.rework.save(&self.session, body),
        }
    }

    /// A stretch of frames as an animated PNG.
    fn clip(&self, body: &[u8]) -> Result<Answer, Answer> {
        let wish: ClipWish = serde_json::from_slice(body)
            .map_err(|error| Answer::error(400, &format!("no clip: {error}")))?;
        wish.check()?;
        let film = self.film(&wish.camera).ok_or_else(Answer::missing)?;
        let chosen = wish.chosen(film.files.iter().map(|file| file.sequence))?;
        let _one = match self.clip.try_lock() {
            // It guards nothing that a panic could leave half done.
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(TryLockError::WouldBlock) => {
                let busy = "another clip is being made: try again when it is done";
                return Err(Answer::error(503, busy));
            }
            Ok(one) => one,
        };
        wish.made(&chosen, |index| {
            let file = film.files.get(index).ok_or_else(Answer::missing)?;
            let frame = file.read().map_err(|error| Answer::error(500, &error.to_string()))?;
            Ok((file.sequence, frame))
        })
    }

    /// The events after a number, the oldest first: whoever wants all asks until there are no more.
    fn events_after(&self, request: &Request) -> Answer {
        let after = request.whole("after").unwrap_or(0);
        let rest = &self.events[self.events.partition_point(|event| event.number <= after)..];
        let events = &rest[..rest.len().min(EVENTS)];
        Answer::json(&EventsView { events, more: events.len() < rest.len() })
    }
}

/// Follows the log from visit to visit, as [`Session::visits`] does.
fn follow(visits: &mut Vec<Visit>, what: &What, utc: Epoch) {
    let ends = matches!(what, What::Target(_) | What::End { .. });
    if let Some(last) = visits.last_mut().filter(|last| ends && last.to.is_none()) {
        last.to = Some(utc);
    }
    if let What::Target(target) = what {
        let number = 1 + visits.iter().filter(|visit| visit.target.name == target.name).count();
        let number = u32::try_from(number).unwrap_or(u32::MAX);
        visits.push(Visit { target: target.clone(), number, from: utc, to: None });
    }
}

impl CountsView {
    fn new(channels: &[String]) -> Self {
        let each = || vec![Vec::new(); channels.len()];
        Self {
            channels: channels.to_vec(),
            rate_hz: each(),
            low_hz: each(),
            high_hz: each(),
            ..Self::default()
        }
    }

    fn bin(&mut self, record: &CountRecord, start_s: f64) {
        let length_s = record.length_ps as f64 * 1e-12;
        self.start_s.push(start_s);
        self.length_s.push(length_s);
        self.flags.push(record.flags.bits());
        for (i, counts) in record.counts.iter().enumerate() {
            let rate_hz = *counts as f64 / length_s;
            for column in [&mut self.rate_hz, &mut self.low_hz, &mut self.high_hz] {
                column[i].push(rate_hz);
            }
        }
    }

    fn block(&mut self, blocks: &[CountBlock], start_s: f64) {
        let exposure_s: f64 = blocks.iter().map(|block| block.exposure_s).sum();
        self.start_s.push(start_s);
        self.length_s.push(exposure_s);
        self.flags.push(blocks.iter().fold(0, |flags, block| flags | block.flags.bits()));
        for i in 0..self.channels.len() {
            let counts: u64 = blocks.iter().map(|block| block.counts[i]).sum();
            self.rate_hz[i].push(counts as f64 / exposure_s);
            let low = blocks.iter().map(|block| block.range_hz[i][0]);
            self.low_hz[i].push(low.fold(f64::INFINITY, f64::min));
            let high = blocks.iter().map(|block| block.range_hz[i][1]);
            self.high_hz[i].push(high.fold(f64::NEG_INFINITY, f64::max));
        }
    }
}

impl Source for Recording {
    fn answer(&self, request: &Request) -> Answer {
        let answer = match request.parts().as_slice() {
            [what @ ("reduction" | "reduction.ecsv" | "recipes")] if request.post => {
                self.reworked(what, &request.body)
            }
            ["clip"] if request.post => self.clip(&request.body),
            ["reduction", "cancel"] if request.post => Ok(self.rework.cancel()),
            _ if request.post => Err(Answer::error(405, "a recorded session cannot be steered")),
            ["recipes"] => Ok(Rework::names(&self.session)),
            ["recipes", name] => Rework::recipe(&self.session, name),
            ["about"] => Ok(Answer::json(&self.about())),
            ["events"] => Ok(self.events_after(request)),
            ["frames", camera] => self.film(camera).ok_or_else(Answer::missing).map(|film| {
                let number = film.files.iter().map(|file| file.sequence).collect();
                Answer::json(&FilmView { start_s: &film.start_s, number })
            }),
            ["frame", camera, index] => self.frame(request, camera, index),
            ["marks", camera, index] => self.marks(request, camera, index),
            ["counts", counter] => self.counts(request, counter),
            ["sky"] => self.sky(request),
            ["tracks"] => self.tracks(),
            ["predicted"] => Ok(Answer::json(&self.predicted)),
            _ => Err(Answer::missing()),
        };
        answer.unwrap_or_else(|answer| answer)
    }
}
