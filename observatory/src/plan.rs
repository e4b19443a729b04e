//! Plan of a night (NIGHT.toml): station, devices, targets and their times.

use super::focus::run::{Approach, RunError, RunOptions};
use super::mount::{MountPlan, needs_mount};
use super::schedule::{Schedule, Slot};
use super::sequence::{CameraSetup, Exposing, Step};
use hifitime::Epoch;
use serde::Deserialize;
use std::collections::{BTreeMap, HashSet};
use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use sunglint_drivers::catalogue::{Address, Kind};
use sunglint_drivers::clock::utc_now;
use sunglint_ephemeris::orbit::elements;
use sunglint_ephemeris::orbit::tle::{self, ChoiceError};
use sunglint_formats::session::{
    Device, DeviceKind, FileSum, Session, Target, TargetKind, is_name,
};
use sunglint_formats::time::parse_utc;
use sunglint_formats::toml::{Document, Finite, Positive, Within};
use sunglint_formats::{FileError, ParseError};
use sunglint_radiometry::sky::Catalogue;
use sunglint_radiometry::station::{RecordedError, Station};

/// Address of the devices of a virtual night in NIGHT.toml.
pub const VIRTUAL_ADDRESS: &str = "virtual";

/// Why a plan cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlanError {
    /// A file that cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// A value that no plan can have, with its line and key.
    #[error(transparent)]
    Value(#[from] ParseError),
    /// Elements of several objects, or of none that is asked for.
    #[error("{at}")]
    Object {
        /// The key, with its line.
        at: ParseError,
        /// Why.
        #[source]
        source: ChoiceError,
    },
    /// The virtual night that stands in for the devices cannot be made.
    #[error(transparent)]
    Virtual(Box<dyn Error + Send + Sync>),
    /// The night of a session is over by its plan.
    #[error("{}: nothing is left to go on with: by its plan the night ended at {at}", session.display())]
    Over {
        /// The session's folder.
        session: PathBuf,
        /// When it ended, UTC.
        at: String,
    },
    /// A night of recordings is over with them.
    #[error("{}: nothing is left to go on with: its cameras are recordings", session.display())]
    Recorded {
        /// The session's folder.
        session: PathBuf,
    },
    /// The station of a recorded session is not known.
    #[error(transparent)]
    Station(#[from] RecordedError),
}

/// A plan's request for a virtual night: what is known when the file that `virtual` names is to be read.
#[derive(Debug)]
pub struct VirtualRequest<'a> {
    /// The file.
    pub file: &'a Path,
    /// The station.
    pub station: &'a Station,
    /// When the night begins.
    pub from: Epoch,
    /// The stays of the plan, in time. Where there are none the virtual night's own go here.
    pub slots: &'a mut Vec<Slot>,
    /// Whether the plan has a mount, which then decides where the telescope points.
    pub mounted: bool,
    /// The files of the configuration: the virtual night adds its own.
    pub files: &'a mut Vec<(String, Vec<u8>)>,
}

/// Maker of virtual nights, for plans that ask for one.
pub type MakeVirtual<'a> =
    dyn FnMut(VirtualRequest<'_>) -> Result<(), Box<dyn Error + Send + Sync>> + 'a;

/// Clock that a night runs on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum NightClock {
    /// The computer's.
    Computer,
    /// A virtual night's own, which is UTC.
    Virtual,
    /// That of the recordings that are its cameras, as far as it is known.
    Recording,
}

/// The file as it is written.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlanFile {
    station: String,
    #[serde(default)]
    name: Option<String>,
    #[serde(default)]
    output: Option<PathBuf>,
    #[serde(default)]
    from: Option<String>,
    #[serde(default)]
    to: Option<String>,
    #[serde(default)]
    for_s: Option<Positive>,
    #[serde(default, rename = "virtual")]
    virtual_night: Option<PathBuf>,
    #[serde(default, rename = "camera")]
    cameras: Vec<CameraPlan>,
    #[serde(default, rename = "counter")]
    counters: Vec<CounterPlan>,
    #[serde(default, rename = "wheel")]
    wheels: Vec<WheelPlan>,
    #[serde(default, rename = "rotator")]
    rotators: Vec<RotatorPlan>,
    #[serde(default)]
    mount: Option<MountPlan>,
    #[serde(default, rename = "visit")]
    visits: Vec<Visit>,
}

/// A filter wheel in the plan.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct WheelPlan {
    /// Name of the wheel.
    pub name: String,
    /// Address of the device in the catalogue of drivers.
    pub device: String,
    /// Options for its driver, `NAME=VALUE` each.
    #[serde(default)]
    pub with: Vec<String>,
    /// Names of its filters, that of slot 1 first; those that its driver has without.
    #[serde(default)]
    pub filters: Vec<String>,
    /// The cameras behind it; all without.
    #[serde(default)]
    pub cameras: Vec<String>,
}

/// A rotator in the plan.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct RotatorPlan {
    /// Name of the rotator.
    pub name: String,
    /// Address of the device in the catalogue of drivers.
    pub device: String,
    /// Options for its driver, `NAME=VALUE` each.
    #[serde(default)]
    pub with: Vec<String>,
    /// The cameras that it turns; all without.
    #[serde(default)]
    pub cameras: Vec<String>,
}

/// A camera in the plan.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraPlan {
    /// Name of the camera: of its folder.
    pub name: String,
    /// Address of the device in the catalogue of drivers.
    pub device: String,
    /// Options for its driver, `NAME=VALUE` each.
    #[serde(default)]
    pub with: Vec<String>,
    /// Exposure, s.
    pub exposure_s: Positive,
    /// Time from the start of one exposure to that of the next, s; as fast as it can without.
    #[serde(default)]
    pub interval_s: Option<Positive>,
    /// First column and row, columns and rows of the sensor, unbinned px; as the camera stands without.
    #[serde(default)]
    pub window_px: Option<[u32; 4]>,
    /// Sensor pixels in one of the frame, along each side; taken with `window_px`.
    #[serde(default)]
    pub binning: Option<u32>,
    /// Gain in the camera's own steps.
    #[serde(default)]
    pub gain: Option<Finite>,
    /// Temperature that the cooler is asked for, °C.
    #[serde(default)]
    pub temperature_c: Option<Finite>,
    /// The filter before it.
    #[serde(default)]
    pub filter: Option<String>,
    /// Whether it takes no frames before a visit and between two.
    #[serde(default)]
    pub rests_between_visits: bool,
    /// The focuser before it, which a person may run during the night.
    #[serde(default)]
    pub focuser: Option<FocuserPlan>,
}

/// A camera's focuser in the plan, and how it is run through the focus.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct FocuserPlan {
    /// Address of the device in the catalogue of drivers.
    pub device: String,
    /// Options for its driver, `NAME=VALUE` each.
    #[serde(default)]
    pub with: Vec<String>,
    /// Distance of two positions, steps.
    pub step: i64,
    /// Positions: nine without.
    #[serde(default)]
    pub points: Option<usize>,
    /// Frames at each position: one without.
    #[serde(default)]
    pub frames: Option<usize>,
    /// Exposure of a frame, s: the visit's without.
    #[serde(default)]
    pub exposure_s: Option<Positive>,
    /// Steps by which a position is passed before it is approached: two steps without.
    #[serde(default)]
    pub overshoot: Option<i64>,
    /// Side from which positions are approached: from lower ones without.
    #[serde(default)]
    pub approach: Option<Approach>,
}

impl FocuserPlan {
    /// Returns the options of a run, with this exposure where it has none of its own.
    pub fn options(&self, exposure_s: f64) -> RunOptions {
        let exposure_s = self.exposure_s.map_or(exposure_s, Positive::get);
        RunOptions::new(self.step, exposure_s).with(|options| {
            options.points = self.points.unwrap_or(options.points);
            options.frames = self.frames.unwrap_or(options.frames);
            options.overshoot = self.overshoot.unwrap_or(options.overshoot);
            options.approach = self.approach.unwrap_or(options.approach);
        })
    }
}

/// A counter in the plan.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CounterPlan {
    /// Name of the counter: of its table.
    pub name: String,
    /// Address of the device in the catalogue of drivers.
    pub device: String,
    /// Options for its driver, `NAME=VALUE` each.
    #[serde(default)]
    pub with: Vec<String>,
    /// The channels' names, each with its input (from 1 on).
    pub channels: BTreeMap<String, u32>,
    /// Length of a bin, s.
    pub bin_s: Positive,
    /// Whether its raw tags are recorded; bins are then made of them.
    #[serde(default)]
    pub raw_tags: bool,
    /// Level at which a pulse counts, V, by channel.
    #[serde(default)]
    pub trigger_level_v: BTreeMap<String, Finite>,
    /// Delay of the input, ps, by channel.
    #[serde(default)]
    pub input_delay_ps: BTreeMap<String, i64>,
    /// Time after a pulse in which the counter does not count, ps, by channel.
    #[serde(default)]
    pub dead_time_ps: BTreeMap<String, i64>,
}

impl CameraPlan {
    /// A camera that is left as it stands.
    pub fn plain(name: String, device: String, exposure_s: Positive) -> Self {
        Self {
            name,
            device,
            with: vec![],
            exposure_s,
            interval_s: None,
            window_px: None,
            binning: None,
            gain: None,
            temperature_c: None,
            filter: None,
            rests_between_visits: false,
            focuser: None,
        }
    }
}

impl CounterPlan {
    /// A counter that is left as it stands, without channels.
    pub fn plain(name: String, device: String, bin_s: Positive) -> Self {
        Self {
            name,
            device,
            with: vec![],
            channels: BTreeMap::new(),
            bin_s,
            raw_tags: false,
            trigger_level_v: BTreeMap::new(),
            input_delay_ps: BTreeMap::new(),
            dead_time_ps: BTreeMap::new(),
        }
    }

    /// Names of the channels, by their inputs.
    pub fn channel_names(&self) -> Vec<String> {
        self.by_input().into_iter().map(|(_, name)| name.clone()).collect()
    }

    /// The channels' inputs, in the order of [`channel_names`](Self::channel_names).
    pub fn inputs(&self) -> Vec<i32> {
        let input = |(input, _): (u32, _)| i32::try_from(input).unwrap_or(i32::MAX);
        self.by_input().into_iter().map(input).collect()
    }

    fn by_input(&self) -> Vec<(u32, &String)> {
        let mut names: Vec<_> = self.channels.iter().map(|(name, i)| (*i, name)).collect();
        names.sort();
        names
    }
}

/// A stay at a target.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Visit {
    #[serde(default)]
    name: Option<String>,
    #[serde(default)]
    star: Option<String>,
    #[serde(default)]
    ra_deg: Option<Within<0, 360>>,
    #[serde(default)]
    dec_deg: Option<Within<-90, 90>>,
    #[serde(default)]
    tle: Option<PathBuf>,
    #[serde(default)]
    object: Option<String>,
    #[serde(default)]
    standard_magnitude: Option<Within<-30, 40>>,
    #[serde(default)]
    off: Option<Off>,
    #[serde(default)]
    from: Option<String>,
    #[serde(default)]
    to: Option<String>,
    #[serde(default)]
    for_s: Option<Positive>,
    #[serde(default)]
    exposure_s: Option<Positive>,
    #[serde(default)]
    interval_s: Option<Positive>,
    #[serde(default)]
    window_px: Option<[u32; 4]>,
    #[serde(default)]
    binning: Option<u32>,
    #[serde(default)]
    gain: Option<Finite>,
    #[serde(default)]
    filter: Option<String>,
    #[serde(default)]
    frames: Option<u32>,
    #[serde(default)]
    level_adu: Option<Positive>,
    #[serde(default)]
    filters: Vec<String>,
    #[serde(default)]
    repeat: Option<u32>,
    #[serde(default)]
    rotator_deg: Option<Within<-360, 360>>,
    /// Settings of one camera, by its name.
    #[serde(default)]
    camera: BTreeMap<String, CameraSetup>,
}

impl Visit {
    /// Settings of all cameras in a step with one of its filters.
    fn setup(&self, filter: Option<&String>) -> CameraSetup {
        CameraSetup {
            exposure_s: self.exposure_s,
            interval_s: self.interval_s,
            window_px: self.window_px,
            binning: self.binning,
            gain: self.gain,
            filter: filter.or(self.filter.as_ref()).cloned(),
            frames: self.frames,
            level_adu: self.level_adu,
        }
    }

    /// How many steps it has.
    fn steps(&self) -> u32 {
        let filters = u32::try_from(self.filters.len().max(1)).unwrap_or(u32::MAX);
        self.repeat.unwrap_or(1).saturating_mul(filters)
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Off {
    Sky,
    Dark,
    Bias,
    Flat,
}

/// More steps than any visit has.
const MOST_STEPS: u32 = 10_000;
/// Time for the readout of a frame, and for a wheel or rotator before a step, that a number of frames is planned with, s. In a night with live devices a step
/// ends as soon as its frames are there.
const READOUT_S: f64 = 2.0;
const TURN_S: f64 = 10.0;

/// Where the files come from that a plan names.
#[derive(Clone, Copy)]
struct Source<'a> {
    /// A session has the station and the elements as they were recorded.
    session: Option<&'a Session>,
    /// Files that are not written yet.
    beside: &'a [(PathBuf, Vec<u8>)],
}

/// A night as it is planned.
#[derive(Debug, Clone)]
pub struct Plan {
    /// The station.
    pub station: Station,
    /// Name of the session's folder, after its date.
    pub name: String,
    /// The folder in which that is made.
    pub output: PathBuf,
    /// When it begins.
    pub from: Epoch,
    /// When it ends; `None`: until it is stopped.
    pub to: Option<Epoch>,
    /// Whether it ends with its last visit, also where that is over early.
    pub ends_with_visits: bool,
    /// The cameras.
    pub cameras: Vec<CameraPlan>,
    /// The counters.
    pub counters: Vec<CounterPlan>,
    /// The filter wheels.
    pub wheels: Vec<WheelPlan>,
    /// The rotators.
    pub rotators: Vec<RotatorPlan>,
    /// The mount, where one points the telescope.
    pub mount: Option<MountPlan>,
    /// Where the telescope looks, and when.
    pub schedule: Schedule,
    /// Clock that the night runs on.
    pub clock: NightClock,
    /// Whether it names times in UTC, not only `now` and durations.
    pub in_utc: bool,
    /// The files of the configuration: names within the session's folder, and bytes.
    pub files: Vec<(String, Vec<u8>)>,
}

impl Plan {
    /// Reads NIGHT.toml for a night with real devices, or with simulated ones behind their protocols.
    ///
    /// # Errors
    /// A file that cannot be read, or says what no night can be, with line and key; a virtual night.
    pub fn read(path: &Path) -> Result<Self, PlanError> {
        let document = Document::read(path)?;
        let expected = "no such key: this program makes no virtual nights";
        let refuse = document.error_at("virtual", expected);
        let source = Source { session: None, beside: &[] };
        Self::of(&document, utc_now(), source, &mut |_| Err(refuse.clone().into()))
    }

    /// Reads the text of a NIGHT.toml that is not written yet, and will lie at `path`; `beside` has files that will lie there, too.
    ///
    /// # Errors
    /// The errors of [`Plan::read`].
    pub fn of_text(
        path: &Path,
        text: &str,
        beside: &[(PathBuf, Vec<u8>)],
    ) -> Result<Self, PlanError> {
        let document = Document::new(path, text)?;
        let refuse = document.error_at("virtual", "no such key: a plan that is made has none");
        let source = Source { session: None, beside };
        Self::of(&document, utc_now(), source, &mut |_| Err(refuse.clone().into()))
    }

    /// The plan of a session as it was recorded: its own files, and `now` is when it began.
    ///
    /// # Errors
    /// The errors of [`Plan::read`]; a session of a virtual night, or whose station is not known.
    pub fn of_session(session: &Session) -> Result<Self, PlanError> {
        let document = Document::read(session.file("night.toml"))?;
        let expected = "no virtual night: those are made anew, not gone on with";
        let refuse = document.error_at("virtual", expected);
        let begun = session.manifest().start_utc;
        let source = Source { session: Some(session), beside: &[] };
        Self::of(&document, begun, source, &mut |_| Err(refuse.clone().into()))
    }

    /// Reads NIGHT.toml. Where it names a virtual night `make_virtual` makes the devices.
    ///
    /// # Errors
    /// The errors of [`Plan::read`], and those of `make_virtual`.
    pub fn read_with(path: &Path, make_virtual: &mut MakeVirtual<'_>) -> Result<Self, PlanError> {
        let source = Source { session: None, beside: &[] };
        Self::of(&Document::read(path)?, utc_now(), source, make_virtual)
    }

    /// The plan in a document; `now` stands for `now` in it. Of a `session` the station and the elements are those that were recorded.
    fn of(
        document: &Document,
        now: Epoch,
        source: Source<'_>,
        make_virtual: &mut MakeVirtual<'_>,
    ) -> Result<Self, PlanError> {
        let session = source.session;
        let mut written: PlanFile = document.parse()?;
        check_name(document, &written)?;
        check_devices(document, &written)?;
        let clock = clock_of(document, &mut written)?;
        let mut files = vec![("night.toml".to_owned(), document.source().as_bytes().to_vec())];
        let station = match session {
            Some(session) => Station::of_session(session)?,
            None => station(document, &written.station)?,
        };
        let names: Vec<String> = written.cameras.iter().map(|camera| camera.name.clone()).collect();
        let others: Vec<&String> = written
            .counters
            .iter()
            .map(|counter| &counter.name)
            .chain(written.wheels.iter().map(|wheel| &wheel.name))
            .chain(written.rotators.iter().map(|rotator| &rotator.name))
            .collect();
        if let Some(mount) = &mut written.mount {
            if clock == NightClock::Recording {
                let expected = "no mount: the cameras are recordings";
                return Err(document.error_at("mount", expected).into());
            }
            let is_virtual = written.virtual_night.is_some();
            if others.contains(&&mount.name) {
                let expected = "a name of its own: another device has this one";
                return Err(document.error_at("mount.name", expected).into());
            }
            mount.check(document, &names, is_virtual, station.camera.is_some())?;
            mount.find_files(document, session)?;
        }
        for (path, _) in &station.sources {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            files.push((format!("station/{name}"), sunglint_formats::read::bytes(path)?));
        }
        let time = |key: &str, text: &Option<String>| -> Result<Option<Epoch>, ParseError> {
            match text.as_deref() {
                None => Ok(None),
                Some(text) if text.eq_ignore_ascii_case("now") => Ok(Some(now)),
                Some(text) => parse_utc(text).map(Some).map_err(|error| {
                    document.error_at(key, format!("{}, or `now`", error.expected))
                }),
            }
        };
        let from = time("from", &written.from)?.unwrap_or(now);
        let mut slots: Vec<Slot> = Vec::new();
        for (i, visit) in written.visits.iter().enumerate() {
            let key = |name: &str| format!("visit[{i}].{name}");
            let target = target(document, i, visit, &mut files, from, source)?;
            let begins = match time(&key("from"), &visit.from)? {
                Some(begins) => begins,
                None => match slots.last() {
                    None => from,
                    Some(before) => before.to.ok_or_else(|| {
                        let expected = "a time: the visit before has no end (`to`, `for_s`)";
                        document.error_at(&key("from"), expected)
                    })?,
                },
            };
            if let Some(before) = slots.last_mut() {
                let ends = *before.to.get_or_insert(begins);
                if begins < ends {
                    let expected = "a time that is not before the end of the visit before";
                    return Err(document.error_at(&key("from"), expected).into());
                }
            }
            let to = time(&key("to"), &visit.to)?;
            let way_s = way_s(&written, &target, slots.last());
            let length_s = match (to, visit.for_s) {
                (None, None) => {
                    let length = length_s(&written, visit).map(|length| way_s + length);
                    length.and_then(Positive::new)
                }
                _ => visit.for_s,
            };
            let way_s = if to.is_none() && visit.for_s.is_none() { way_s } else { 0.0 };
            let to = end(document, &key, begins, to, length_s)?;
            let first =
                slots.last().and_then(|last| last.step.as_ref()).map_or(1, |s| s.number + 1);
            let stay = Slot::new(target, begins, to);
            slots.extend(steps(document, i, visit, first, way_s, stay)?);
        }
        check_settings(document, &written, &slots)?;
        if let Some(file) = &written.virtual_night {
            let file = document.resolve(file);
            let (slots, files) = (&mut slots, &mut files);
            let mounted = written.mount.is_some();
            let station = &station;
            let request = VirtualRequest { file: &file, station, from, slots, mounted, files };
            make_virtual(request).map_err(PlanError::Virtual)?;
        }
        let visits = written.visits.iter().flat_map(|visit| [&visit.from, &visit.to]);
        let in_utc = [&written.from, &written.to]
            .into_iter()
            .chain(visits)
            .flatten()
            .any(|text| !text.eq_ignore_ascii_case("now"));
        let top = |name: &str| name.to_owned();
        let to = end(document, &top, from, time("to", &written.to)?, written.for_s)?;
        let ends_with_visits = to.is_none();
        let to = to.or_else(|| slots.last().and_then(|last| last.to));
        let stem = document.path().file_stem().unwrap_or_default().to_string_lossy();
        Ok(Self {
            name: written.name.unwrap_or_else(|| stem.into_owned()),
            output: document.resolve(written.output.unwrap_or_default()),
            station,
            from,
            to,
            ends_with_visits,
            cameras: written.cameras,
            counters: written.counters,
            wheels: written.wheels,
            rotators: written.rotators,
            mount: written.mount,
            schedule: Schedule::new(slots),
            clock,
            in_utc,
            files,
        })
    }

    /// The devices for the manifest.
    pub fn devices(&self) -> Vec<Device> {
        let cameras = self.cameras.iter().map(|camera| Device {
            name: camera.name.clone(),
            kind: DeviceKind::Camera,
            address: camera.device.clone(),
            options: camera.with.clone(),
            channels: vec![],
            inputs: vec![],
            raw_tags: false,
            exposure_s: camera.exposure_s.get(),
            interval_s: camera.interval_s.map(Positive::get),
            filter: camera.filter.clone(),
        });
        let counters = self.counters.iter().map(|counter| Device {
            name: counter.name.clone(),
            kind: DeviceKind::Counter,
            address: counter.device.clone(),
            options: counter.with.clone(),
            channels: counter.channel_names(),
            inputs: counter.inputs(),
            raw_tags: counter.raw_tags,
            exposure_s: counter.bin_s.get(),
            interval_s: None,
            filter: None,
        });
        let own = |with: &Vec<String>| with.clone();
        let wheels =
            self.wheels.iter().map(|w| (DeviceKind::Wheel, &w.name, &w.device, own(&w.with)));
        let rotators =
            self.rotators.iter().map(|r| (DeviceKind::Rotator, &r.name, &r.device, own(&r.with)));
        let mounts =
            self.mount.iter().map(|m| (DeviceKind::Mount, &m.name, &m.device, m.recorded()));
        let movers =
            wheels.chain(rotators).chain(mounts).map(|(kind, name, address, options)| Device {
                name: name.clone(),
                kind,
                address: address.clone(),
                options,
                channels: vec![],
                inputs: vec![],
                raw_tags: false,
                exposure_s: 0.0,
                interval_s: None,
                filter: None,
            });
        cameras.chain(counters).chain(movers).collect()
    }

    /// The sums of the configuration for the manifest.
    pub fn sums(&self) -> Vec<FileSum> {
        self.files.iter().map(|(name, bytes)| FileSum::of(name, bytes)).collect()
    }
}

/// A built-in name, or a file or folder beside the document.
fn station(document: &Document, name: &str) -> Result<Station, PlanError> {
    if let Some(station) = Station::built_in(name) {
        return Ok(station?);
    }
    let path = document.resolve(name);
    if !path.exists() {
        let names = Station::built_in_names().join(", ");
        let expected = format!("a built-in station ({names}), a station.toml or its folder");
        return Err(document.error_at("station", expected).into());
    }
    Ok(Station::read(path)?)
}

fn end(
    document: &Document,
    key: &dyn Fn(&str) -> String,
    from: Epoch,
    to: Option<Epoch>,
    for_s: Option<Positive>,
) -> Result<Option<Epoch>, ParseError> {
    let to = match (to, for_s) {
        (Some(_), Some(_)) => {
            return Err(document.error_at(&key("for_s"), "either `to` or `for_s`, not both"));
        }
        (None, Some(s)) => Some(from + hifitime::Duration::from_seconds(s.get())),
        (to, None) => to,
    };
    match to {
        Some(to) if to <= from => {
            Err(document.error_at(&key("to"), "a time after that at which it begins"))
        }
        to => Ok(to),
    }
}

/// The name of a night becomes that of a folder.
fn check_name(document: &Document, written: &PlanFile) -> Result<(), ParseError> {
    let Some(name) = &written.name else { return Ok(()) };
    let bad = |c: char| matches!(c, '/' | '\\' | ':') || c.is_control();
    if name.trim().is_empty() || name.starts_with('.') || name.chars().any(bad) {
        let expected = "a name for the session's folder, without / \\ : and no dot before it; where it is made is `output`";
        return Err(document.error_at("name", expected));
    }
    Ok(())
}

/// Names that become files, addresses of the right kind, channels that are there.
fn check_devices(document: &Document, written: &PlanFile) -> Result<(), ParseError> {
    const NAMES: &str = "a name of its own out of letters, digits, - and _";
    let mut names = HashSet::new();
    let cameras = written.cameras.iter().map(|d| ("camera", &d.name, &d.device, &d.with));
    let counters = written.counters.iter().map(|d| ("counter", &d.name, &d.device, &d.with));
    if written.cameras.is_empty() && written.counters.is_empty() {
        let expected = "a device: [[camera]] or [[counter]]";
        return Err(document.error_at("camera", expected));
    }
    let wheels = written.wheels.iter().map(|d| ("wheel", &d.name, &d.device, &d.with));
    let rotators = written.rotators.iter().map(|d| ("rotator", &d.name, &d.device, &d.with));
    let mut index = BTreeMap::<&str, usize>::new();
    let mut known: Vec<(&str, Address)> = Vec::new();
    for (table, name, address, options) in cameras.chain(counters).chain(wheels).chain(rotators) {
        let i = index.entry(table).or_insert(0);
        let key = format!("{table}[{i}]");
        *i += 1;
        if !is_name(name) || !names.insert(name) {
            return Err(document.error_at(&format!("{key}.name"), NAMES));
        }
        let moves = matches!(table, "wheel" | "rotator");
        if written.virtual_night.is_some() {
            if moves {
                let expected = "no wheel or rotator: a virtual night has none";
                return Err(document.error_at(&key, expected));
            }
            if address != VIRTUAL_ADDRESS {
                let expected = format!("{VIRTUAL_ADDRESS}, as the night is");
                return Err(document.error_at(&format!("{key}.device"), expected));
            }
            continue;
        }
        let parsed = Address::parse(address, options).map_err(|error| {
            let field = if error.field.starts_with("option") { "with" } else { "device" };
            document.error_at(&format!("{key}.{field}"), error.expected)
        })?;
        let kind = match table {
            "camera" => Kind::Camera,
            "counter" => Kind::PhotonCounter,
            "wheel" => Kind::FilterWheel,
            _ => Kind::RotationStage,
        };
        if parsed.driver.kind != kind {
            let expected = format!("a {kind}; this is a {}", parsed.driver.kind);
            return Err(document.error_at(&format!("{key}.device"), expected));
        }
        if let Some((first, _)) = known.iter().find(|(_, other)| parsed.is_same_device(other)) {
            let expected = format!("a device of its own: {table} `{first}` is this one already");
            return Err(document.error_at(&format!("{key}.device"), expected));
        }
        known.push((name, parsed));
    }
    for (i, camera) in written.cameras.iter().enumerate() {
        let Some(focuser) = &camera.focuser else { continue };
        let key = format!("camera[{i}].focuser");
        if written.virtual_night.is_some() {
            let expected = "no focuser: a virtual night has none";
            return Err(document.error_at(&key, expected));
        }
        let parsed = Address::parse(&focuser.device, &focuser.with)
            .map_err(|error| document.error_at(&format!("{key}.device"), error.expected))?;
        if parsed.driver.kind != Kind::Focuser {
            let expected = format!("a {}; this is a {}", Kind::Focuser, parsed.driver.kind);
            return Err(document.error_at(&format!("{key}.device"), expected));
        }
        let options = focuser.options(camera.exposure_s.get());
        options.check().map_err(|error| match error {
            // By the names of the command's options, which the keys have, too.
            RunError::Option { what, expected, .. } => {
                let name = what.trim_start_matches('-').replace('-', "_");
                document.error_at(&format!("{key}.{name}"), expected)
            }
            other => document.error_at(&key, other.to_string()),
        })?;
    }
    for (i, wheel) in written.wheels.iter().enumerate() {
        let mut filters = HashSet::new();
        if let Some(twice) = wheel.filters.iter().find(|filter| !filters.insert(*filter)) {
            let expected = format!("each name once: which slot is `{twice}`?");
            return Err(document.error_at(&format!("wheel[{i}].filters"), expected));
        }
    }
    for (i, counter) in written.counters.iter().enumerate() {
        check_channels(document, i, counter)?;
    }
    let before = written.wheels.iter().map(|wheel| ("wheel", &wheel.cameras));
    let behind = written.rotators.iter().map(|rotator| ("rotator", &rotator.cameras));
    let mut index = BTreeMap::<&str, usize>::new();
    for (table, cameras) in before.chain(behind) {
        let i = index.entry(table).or_insert(0);
        if let Some(name) = cameras.iter().find(|name| !has_camera(written, name)) {
            let error = document.error_at(&format!("{table}[{i}].cameras"), CAMERAS);
            return Err(error.with_hint(format!("there is no camera `{name}`")));
        }
        *i += 1;
    }
    for (i, camera) in written.cameras.iter().enumerate() {
        if camera.binning.is_some_and(|binning| binning == 0 || camera.window_px.is_none()) {
            let expected = match camera.binning {
                Some(0) => "1 or more",
                _ => {
                    "a `window_px` beside it: a binning is set together with the window ([0, 0, columns, rows] of the sensor is the whole)"
                }
            };
            return Err(document.error_at(&format!("camera[{i}].binning"), expected));
        }
        if let Some(interval) = camera.interval_s.filter(|i| i.get() < camera.exposure_s.get()) {
            let expected = format!("the exposure or more, {} s", camera.exposure_s.get());
            let error = document.error_at(&format!("camera[{i}].interval_s"), expected);
            return Err(error.with_hint(format!("{} s from start to start", interval.get())));
        }
    }
    Ok(())
}

/// Clock of a night: recordings and live devices do not go together. The paths of recordings are as seen from the plan.
fn clock_of(document: &Document, written: &mut PlanFile) -> Result<NightClock, ParseError> {
    if written.virtual_night.is_some() {
        return Ok(NightClock::Virtual);
    }
    let address = |camera: &CameraPlan| Address::parse(&camera.device, &camera.with).ok();
    let is_recording =
        |camera: &CameraPlan| address(camera).is_some_and(|address| address.is_recording());
    let Some(first) = written.cameras.iter().position(is_recording) else {
        return Ok(NightClock::Computer);
    };
    let others = [
        written.cameras.iter().position(|camera| !is_recording(camera)).map(|i| ("camera", i)),
        (!written.counters.is_empty()).then_some(("counter", 0)),
        (!written.wheels.is_empty()).then_some(("wheel", 0)),
        (!written.rotators.is_empty()).then_some(("rotator", 0)),
    ];
    if let Some((table, i)) = others.into_iter().flatten().next() {
        let expected = "a recording, as the other cameras are: those have times of their own";
        let error = document.error_at(&format!("{table}[{i}].device"), expected);
        return Err(error.with_hint(format!("camera {} is one", written.cameras[first].name)));
    }
    if written.from.is_none() {
        let expected = "the time of the recording's first frame, or a little before it";
        return Err(document.error_at("from", expected));
    }
    for (i, camera) in written.cameras.iter_mut().enumerate() {
        if camera.interval_s.is_some() {
            let expected = "none: the frames of a recording come when they were taken";
            return Err(document.error_at(&format!("camera[{i}].interval_s"), expected));
        }
        if let Some((driver, place)) = camera.device.split_once(':') {
            let place = document.resolve(place.trim());
            camera.device = format!("{driver}:{}", place.display());
        }
    }
    Ok(NightClock::Recording)
}

const CAMERAS: &str = "names of cameras of the plan";

fn has_camera(written: &PlanFile, name: &str) -> bool {
    written.cameras.iter().any(|camera| camera.name == name)
}

/// The length that the frames of a visit take, s, where it has a number of them.
fn length_s(written: &PlanFile, visit: &Visit) -> Option<f64> {
    let step = Step { all: visit.setup(None), cameras: visit.camera.clone(), ..Step::default() };
    let of_camera = |camera: &CameraPlan| {
        let exposing = Exposing::of(camera, None, Some(&step));
        let frame_s = exposing.plan.exposure_s.get() + READOUT_S;
        let every_s = exposing.plan.interval_s.map_or(frame_s, |i| i.get().max(frame_s));
        Some(every_s * f64::from(exposing.frames?))
    };
    let longest = written.cameras.iter().map(of_camera).collect::<Option<Vec<_>>>()?;
    let longest = longest.into_iter().reduce(f64::max)?;
    Some((longest + TURN_S) * f64::from(visit.steps()))
}

/// The time that the mount may need to a visit's target, s: half a turn of an axis, as it is not known where it stands. None where it is on that target.
fn way_s(written: &PlanFile, target: &Target, before: Option<&Slot>) -> f64 {
    let Some(mount) = written.mount.as_ref().filter(|_| needs_mount(target.target_kind)) else {
        return 0.0;
    };
    match before {
        Some(before) if before.target == *target => 0.0,
        _ => mount.farthest_s(),
    }
}

/// The steps of a visit: each filter, so often as it is repeated, all of one length.
fn steps(
    document: &Document,
    i: usize,
    visit: &Visit,
    first: u32,
    way_s: f64,
    stay: Slot,
) -> Result<Vec<Slot>, ParseError> {
    let wrong =
        |key: &str, expected: &str| document.error_at(&format!("visit[{i}].{key}"), expected);
    if visit.repeat == Some(0) {
        return Err(wrong("repeat", "1 or more"));
    }
    let steps = visit.steps();
    if steps > MOST_STEPS {
        return Err(wrong(
            "repeat",
            &format!("at most {MOST_STEPS} steps (repeats times filters)"),
        ));
    }
    if visit.filter.is_some() && !visit.filters.is_empty() {
        return Err(wrong("filters", "either `filter` or `filters`, not both"));
    }
    let length = stay.to.map(|to| ((to - stay.from).to_seconds() - way_s) / f64::from(steps));
    if length.is_none() && steps > 1 {
        return Err(wrong("repeat", "`for_s`, `to` or `frames` beside it"));
    }
    let step = |number: u32| {
        let at = |part: u32| {
            // The first step has the way to the target, too.
            let way_s = if part > 0 { way_s } else { 0.0 };
            let after_s = |s: f64| way_s + s * f64::from(part);
            length.map(|s| stay.from + hifitime::Duration::from_seconds(after_s(s)))
        };
        let filter = visit.filters.get(number as usize % visit.filters.len().max(1));
        Slot {
            target: stay.target.clone(),
            from: at(number).unwrap_or(stay.from),
            to: if number + 1 == steps { stay.to } else { at(number + 1) },
            keeps: {
                let [begins, ends] = stay.keeps;
                [number == 0 && (begins || visit.from.is_some()), ends || visit.to.is_some()]
            },
            step: Some(Arc::new(Step {
                number: first + number,
                continues: number > 0,
                all: visit.setup(filter),
                cameras: visit.camera.clone(),
                rotator_deg: visit.rotator_deg.map(Within::get),
                standard_magnitude: visit.standard_magnitude.map(Within::get),
            })),
        }
    };
    Ok((0..steps).map(step).collect())
}

/// Settings of visits that the plan's devices cannot follow.
fn check_settings(
    document: &Document,
    written: &PlanFile,
    slots: &[Slot],
) -> Result<(), ParseError> {
    for (i, visit) in written.visits.iter().enumerate() {
        let wrong = |key: &str, expected: &str| {
            Err(document.error_at(&format!("visit[{i}].{key}"), expected))
        };
        if let Some(name) = visit.camera.keys().find(|name| !has_camera(written, name)) {
            return wrong(&format!("camera.{name}"), CAMERAS);
        }
        if written.cameras.is_empty() && visit.setup(None) != CameraSetup::default() {
            return wrong("exposure_s", "a [[camera]] that takes it: the plan has none");
        }
        if visit.rotator_deg.is_some() && written.rotators.is_empty() {
            return wrong("rotator_deg", "a [[rotator]] that turns: the plan has none");
        }
        let flat = visit.off == Some(Off::Flat);
        let own = visit.camera.values().any(|camera| camera.level_adu.is_some());
        if (visit.level_adu.is_some() || own) && !flat {
            return wrong(
                "level_adu",
                "`off = \"flat\"` beside it: only exposures of flats follow the light",
            );
        }
        if visit.off == Some(Off::Bias) && visit.exposure_s.is_none() {
            return wrong("exposure_s", "the shortest exposure of the camera, for bias frames");
        }
        for camera in &written.cameras {
            let step = Step {
                all: visit.setup(visit.filters.first()),
                cameras: visit.camera.clone(),
                ..Step::default()
            };
            let set = Exposing::of(camera, None, Some(&step));
            if set.plan.gain.is_some() && camera.gain.is_none() {
                let expected =
                    format!("a `gain` of camera `{}` itself, to which it returns", camera.name);
                return wrong("gain", &expected);
            }
            if set.plan.filter != camera.filter && wheel_of(written, &camera.name).is_none() {
                let expected = format!(
                    "a [[wheel]] before camera `{}`: without one nothing turns the filter",
                    camera.name
                );
                return wrong("filter", &expected);
            }
            if set.plan.binning == Some(0) || set.frames == Some(0) {
                return wrong(
                    if set.frames == Some(0) { "frames" } else { "binning" },
                    "1 or more",
                );
            }
            let asked = visit.interval_s.filter(|i| i.get() < set.plan.exposure_s.get());
            if asked.is_some() {
                let expected = format!("the exposure or more, {} s", set.plan.exposure_s.get());
                return wrong("interval_s", &expected);
            }
        }
    }
    for (i, wheel) in written.wheels.iter().enumerate() {
        let behind =
            |camera: &&CameraPlan| wheel.cameras.is_empty() || wheel.cameras.contains(&camera.name);
        for slot in slots {
            let wanted =
                |camera: &CameraPlan| Exposing::of(camera, None, slot.step.as_deref()).plan.filter;
            let mut filters: Vec<String> =
                written.cameras.iter().filter(behind).filter_map(wanted).collect();
            filters.sort();
            filters.dedup();
            if filters.len() > 1 {
                let error = document
                    .error_at(&format!("wheel[{i}]"), "one filter at a time before its cameras");
                return Err(error.with_hint(format!(
                    "{} asks for {}",
                    slot.target.name,
                    filters.join(" and ")
                )));
            }
            if let Some(filter) =
                filters.first().filter(|f| !wheel.filters.is_empty() && !wheel.filters.contains(f))
            {
                let error = document.error_at(
                    &format!("wheel[{i}].filters"),
                    format!("`{filter}` among them, which {} asks for", slot.target.name),
                );
                return Err(error.with_hint(format!("it has {}", wheel.filters.join(", "))));
            }
        }
    }
    Ok(())
}

/// The wheel before a camera.
fn wheel_of<'a>(written: &'a PlanFile, camera: &str) -> Option<&'a WheelPlan> {
    let before = |wheel: &&WheelPlan| {
        wheel.cameras.is_empty() || wheel.cameras.iter().any(|name| name == camera)
    };
    written.wheels.iter().find(before)
}

fn check_channels(document: &Document, i: usize, counter: &CounterPlan) -> Result<(), ParseError> {
    let key = format!("counter[{i}]");
    let mut inputs = HashSet::new();
    for (name, input) in &counter.channels {
        if !is_name(name) || *input == 0 || !inputs.insert(input) {
            let expected = "an input of its own, from 1, for a name of letters, digits, - and _";
            return Err(document.error_at(&format!("{key}.channels.{name}"), expected));
        }
    }
    if counter.channels.is_empty() {
        return Err(document.error_at(&format!("{key}.channels"), "one channel or more"));
    }
    let settings = [
        ("trigger_level_v", counter.trigger_level_v.keys().collect::<Vec<_>>()),
        ("input_delay_ps", counter.input_delay_ps.keys().collect()),
        ("dead_time_ps", counter.dead_time_ps.keys().collect()),
    ];
    for (setting, names) in settings {
        if let Some(name) = names.into_iter().find(|name| !counter.channels.contains_key(*name)) {
            let known = counter.channel_names().join(", ");
            let error = document.error_at(&format!("{key}.{setting}.{name}"), "a channel");
            return Err(error.with_hint(format!("the channels are {known}")));
        }
    }
    Ok(())
}

/// The target of a visit; elements are copied into the session.
fn target(
    document: &Document,
    i: usize,
    visit: &Visit,
    files: &mut Vec<(String, Vec<u8>)>,
    near: Epoch,
    source: Source<'_>,
) -> Result<Target, PlanError> {
    let error =
        |key: &str, expected: String| document.error_at(&format!("visit[{i}]{key}"), expected);
    let place = visit.ra_deg.is_some() || visit.dec_deg.is_some();
    let given = [visit.star.is_some(), place, visit.tle.is_some(), visit.off.is_some()];
    if given.iter().filter(|given| **given).count() != 1 {
        let expected =
            "one target: `star`, `ra_deg` and `dec_deg`, `tle` (with `object`), or `off`";
        return Err(error("", expected.into()).into());
    }
    if visit.object.is_some() && visit.tle.is_none() {
        return Err(error(".object", "a `tle` beside it".into()).into());
    }
    if visit.standard_magnitude.is_some() && visit.tle.is_none() {
        let expected = "a `tle` beside it: only satellites have one";
        return Err(error(".standard_magnitude", expected.into()).into());
    }
    let star = |name: String, ra_deg, dec_deg| Target {
        name,
        ra_deg: Some(ra_deg),
        dec_deg: Some(dec_deg),
        ..Target { on: true, target_kind: TargetKind::Star, ..Target::off(TargetKind::None) }
    };
    let mut target = if let Some(name) = &visit.star {
        let found = Catalogue::embedded().find(name);
        let found = found.map_err(|e| {
            error(".star", "a star of the catalogue".into()).with_hint(e.to_string())
        })?;
        star(name.clone(), found.icrs.ra_deg, found.icrs.dec_deg)
    } else if let Some(off) = visit.off {
        Target::off(match off {
            Off::Sky => TargetKind::Sky,
            Off::Dark => TargetKind::Dark,
            Off::Bias => TargetKind::Bias,
            Off::Flat => TargetKind::Flat,
        })
    } else if let Some(path) = &visit.tle {
        let path = match source.session {
            Some(session) => {
                let name = path.file_name().unwrap_or_default().to_string_lossy();
                session.file(&format!("tle/{name}"))
            }
            None => document.resolve(path),
        };
        let bytes = match source.beside.iter().find(|(beside, _)| *beside == path) {
            Some((_, bytes)) => bytes.clone(),
            None => sunglint_formats::read::bytes(&path)?,
        };
        let text = sunglint_formats::read::decode(&path, bytes.clone())?;
        let sets = elements::parse(&path, &text)?;
        let chosen = tle::choose(&sets, visit.object.as_deref(), Some(near)).map_err(|source| {
            PlanError::Object { at: error(".object", "one object".into()), source }
        })?;
        let name = format!("tle/{}", path.file_name().unwrap_or_default().to_string_lossy());
        match files.iter().find(|(known, _)| *known == name) {
            Some((_, known)) if *known != bytes => {
                let expected = format!("files with names of their own: {name} is there already");
                return Err(error(".tle", expected).into());
            }
            Some(_) => {}
            None => files.push((name, bytes)),
        }
        Target {
            name: chosen.name.clone().unwrap_or_else(|| chosen.norad_id.to_string()),
            on: true,
            tle: chosen.lines().map(|lines| lines.map(str::to_owned)),
            omm: chosen.lines().is_none().then(|| chosen.kvn()),
            ..Target::off(TargetKind::None)
        }
    } else {
        let (Some(ra), Some(dec)) = (visit.ra_deg, visit.dec_deg) else {
            return Err(error("", "both `ra_deg` and `dec_deg`".into()).into());
        };
        let Some(name) = visit.name.clone() else {
            return Err(error("", "a `name` for the star".into()).into());
        };
        star(name, ra.get(), dec.get())
    };
    if target.elements().is_some() {
        target.target_kind = TargetKind::Satellite;
    }
    if let Some(name) = &visit.name {
        target.name.clone_from(name);
    }
    Ok(target)
}
