//! Plan of a night (NIGHT.toml): station, devices, targets and their times.

use super::schedule::{Schedule, Slot};
use hifitime::Epoch;
use serde::Deserialize;
use std::collections::{BTreeMap, HashSet};
use std::error::Error;
use std::path::{Path, PathBuf};
use sunglint_drivers::catalogue::{Address, Kind};
use sunglint_drivers::clock::utc_now;
use sunglint_ephemeris::orbit::tle::{self, ChoiceError};
use sunglint_formats::session::{Device, DeviceKind, FileSum, Target, TargetKind, is_name};
use sunglint_formats::time::parse_utc;
use sunglint_formats::toml::{Document, Finite, Positive, Within};
use sunglint_formats::{FileError, ParseError};
use sunglint_radiometry::sky::Catalogue;
use sunglint_radiometry::station::Station;

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
    /// The files of the configuration: the virtual night adds its own.
    pub files: &'a mut Vec<(String, Vec<u8>)>,
}

/// Maker of virtual nights, for plans that ask for one.
pub type MakeVirtual<'a> =
    dyn FnMut(VirtualRequest<'_>) -> Result<(), Box<dyn Error + Send + Sync>> + 'a;

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
    #[serde(default, rename = "visit")]
    visits: Vec<Visit>,
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
    off: Option<Off>,
    #[serde(default)]
    from: Option<String>,
    #[serde(default)]
    to: Option<String>,
    #[serde(default)]
    for_s: Option<Positive>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Off {
    Sky,
    Dark,
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
    /// The cameras.
    pub cameras: Vec<CameraPlan>,
    /// The counters.
    pub counters: Vec<CounterPlan>,
    /// Where the telescope looks, and when.
    pub schedule: Schedule,
    /// Whether a virtual night stands in for the devices.
    pub is_virtual: bool,
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
        Self::of(&document, utc_now(), &mut |_| Err(refuse.clone().into()))
    }

    /// Reads NIGHT.toml. Where it names a virtual night `make_virtual` makes the devices.
    ///
    /// # Errors
    /// The errors of [`Plan::read`], and those of `make_virtual`.
    pub fn read_with(path: &Path, make_virtual: &mut MakeVirtual<'_>) -> Result<Self, PlanError> {
        Self::of(&Document::read(path)?, utc_now(), make_virtual)
    }

    /// The plan in a document; `now` stands for `now` in it.
    fn of(
        document: &Document,
        now: Epoch,
        make_virtual: &mut MakeVirtual<'_>,
    ) -> Result<Self, PlanError> {
        let written: PlanFile = document.parse()?;
        check_devices(document, &written)?;
        let mut files = vec![("night.toml".to_owned(), document.source().as_bytes().to_vec())];
        let station = station(document, &written.station)?;
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
            let target = target(document, i, visit, &mut files, from)?;
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
            let to = end(document, &key, begins, time(&key("to"), &visit.to)?, visit.for_s)?;
            slots.push(Slot { target, from: begins, to });
        }
        if let Some(file) = &written.virtual_night {
            let file = document.resolve(file);
            let (slots, files) = (&mut slots, &mut files);
            let request = VirtualRequest { file: &file, station: &station, from, slots, files };
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
        let to = to.or_else(|| slots.last().and_then(|last| last.to));
        let stem = document.path().file_stem().unwrap_or_default().to_string_lossy();
        Ok(Self {
            name: written.name.unwrap_or_else(|| stem.into_owned()),
            output: document.resolve(written.output.unwrap_or_default()),
            station,
            from,
            to,
            cameras: written.cameras,
            counters: written.counters,
            schedule: Schedule::new(slots),
            is_virtual: written.virtual_night.is_some(),
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
        cameras.chain(counters).collect()
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
    let mut index = BTreeMap::<&str, usize>::new();
    for (table, name, address, options) in cameras.chain(counters) {
        let i = index.entry(table).or_insert(0);
        let key = format!("{table}[{i}]");
        *i += 1;
        if !is_name(name) || !names.insert(name) {
            return Err(document.error_at(&format!("{key}.name"), NAMES));
        }
        if written.virtual_night.is_some() {
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
        let kind = if table == "camera" { Kind::Camera } else { Kind::PhotonCounter };
        if parsed.driver.kind != kind {
            let expected = format!("a {kind}; this is a {}", parsed.driver.kind);
            return Err(document.error_at(&format!("{key}.device"), expected));
        }
    }
    for (i, counter) in written.counters.iter().enumerate() {
        check_channels(document, i, counter)?;
    }
    for (i, camera) in written.cameras.iter().enumerate() {
        if camera.binning.is_some_and(|binning| binning == 0 || camera.window_px.is_none()) {
            let expected = "1 or more, beside a `window_px`";
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
        })
    } else if let Some(path) = &visit.tle {
        let path = document.resolve(path);
        let bytes = sunglint_formats::read::bytes(&path)?;
        let text = sunglint_formats::read::decode(&path, bytes.clone())?;
        let sets = tle::parse(&path, &text)?;
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
            tle: Some([chosen.line1.clone(), chosen.line2.clone()]),
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
    if target.tle.is_some() {
        target.target_kind = TargetKind::Satellite;
    }
    if let Some(name) = &visit.name {
        target.name.clone_from(name);
    }
    Ok(target)
}
