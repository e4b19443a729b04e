//! Instruments and what they gave, as text, tables, FITS and JSON.
//!
//! Errors come in as text: whoever asks knows by which option or command a person can help.

mod lists;
mod readings;

pub use lists::{drivers, drivers_text, inventory, inventory_text};
pub use readings::{reading_text, readings, readings_text};

use crate::{Product, json_of};
use serde::Serialize;
use serde_json::{Map, Value};
use std::fmt::Write as _;
use std::path::Path;
use sunglint_drivers::catalogue::Address;
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::device::{Device, DeviceError, Identity, Origin, Value as SettingValue};
use sunglint_drivers::recording::{Header, ReplayError};
use sunglint_drivers::session::{Check, CheckStep, Finding, Moves, Position, SettingsDone};
use sunglint_formats::{Column, Table};

#[derive(Serialize)]
struct Described {
    #[serde(flatten)]
    identity: Identity,
    settings: Map<String, Value>,
}

/// Who a device says it is, with all its settings, as JSON; each step has a deadline.
///
/// # Errors
/// Those of the device.
pub fn described(
    device: &mut dyn Device,
    within: &dyn Fn() -> Deadline,
) -> Result<Value, DeviceError> {
    let identity = device.identity(&within())?;
    let settings = device.settings(&within())?;
    let settings = settings.iter().map(|s| (s.name.to_owned(), json_of(&s.value))).collect();
    Ok(json_of(&Described { identity, settings }))
}

/// Returns the device in a line.
pub fn title(address: &Address, about: &Identity) -> String {
    let serial = about.serial.as_ref().map(|serial| format!(", serial number {serial}"));
    let firmware = about.firmware.as_ref().map(|version| format!(", firmware {version}"));
    let simulated = if address.driver.simulated { " (simulated)" } else { "" };
    format!(
        "{} {}{}{} at {}{simulated}",
        about.vendor,
        about.model,
        serial.unwrap_or_default(),
        firmware.unwrap_or_default(),
        address,
    )
}

#[derive(Serialize)]
struct DeviceJson<'a> {
    vendor: &'a str,
    model: &'a str,
    serial: Option<&'a str>,
    firmware: Option<&'a str>,
}

/// The keys that every document about a device begins with.
#[derive(Serialize)]
struct AboutJson<'a> {
    address: String,
    driver: &'static str,
    kind: String,
    simulated: bool,
    device: Option<DeviceJson<'a>>,
}

fn about<'a>(address: &Address, device: Option<&'a Identity>) -> AboutJson<'a> {
    let driver = address.driver;
    AboutJson {
        address: address.to_string(),
        driver: driver.name,
        kind: driver.kind.to_string(),
        simulated: driver.simulated,
        device: device.map(|about| DeviceJson {
            vendor: &about.vendor,
            model: &about.model,
            serial: about.serial.as_deref(),
            firmware: about.firmware.as_deref(),
        }),
    }
}

fn product(name: &str, columns: Vec<Column>, json: &impl Serialize) -> Product {
    let table = Table { columns, ..Table::default() };
    Product { name: name.into(), table, json: json_of(json), ..Product::default() }
}

/// Returns what a step of a self-test found, in words; `error` says why the last step failed.
fn detail(check: &Check, step: &CheckStep, error: Option<&str>) -> String {
    match &step.finding {
        Finding::Opened(kind) => format!("it answers as a {kind}"),
        Finding::Identity(identity) => title(&check.address, identity),
        Finding::Settings(settings) => format!("{} read", settings.len()),
        Finding::Reading(reading) => reading_text(reading),
        Finding::NotReady(error) => error.to_string(),
        _ => error.unwrap_or_default().to_owned(),
    }
}

/// Returns a self-test as text; `error` says why it failed.
pub fn check_text(check: &Check, error: Option<&str>) -> String {
    let mut text = format!("{} ({})\n", check.address, check.address.driver.title);
    for step in &check.steps {
        let (verdict, detail) = (step.verdict().word(), detail(check, step, error));
        let _ = writeln!(text, "  {verdict:<7} {:<9} {detail}", step.name);
    }
    for setting in check.settings() {
        let origin = match setting.origin {
            Origin::ReadBack => "read back",
            Origin::Configured => "as told",
            Origin::Assumed => "assumed",
        };
        let _ = writeln!(text, "          {:<24} {} ({origin})", setting.name, setting.value);
    }
    text
}

#[derive(Serialize)]
struct SettingJson<'a> {
    name: &'a str,
    value: &'a SettingValue,
    origin: &'a str,
}

#[derive(Serialize)]
struct StepJson<'a> {
    step: &'a str,
    verdict: &'a str,
    detail: String,
}

#[derive(Serialize)]
struct CheckJson<'a> {
    #[serde(flatten)]
    about: AboutJson<'a>,
    settings: Vec<SettingJson<'a>>,
    steps: Vec<StepJson<'a>>,
    error: Option<&'a str>,
}

/// Returns a self-test as a table of its steps and as JSON; `error` says why it failed.
pub fn check(check: &Check, error: Option<&str>) -> Product {
    let column = |name, of: &dyn Fn(&CheckStep) -> String| {
        Column::text(name, check.steps.iter().map(of).collect())
    };
    let columns = vec![
        column("step", &|step| step.name.to_owned()),
        column("verdict", &|step| step.verdict().word().to_owned()),
        column("detail", &|step| detail(check, step, error)),
    ];
    let settings = check.settings().iter().map(|setting| {
        let origin = match setting.origin {
            Origin::ReadBack => "read_back",
            Origin::Configured => "configured",
            Origin::Assumed => "assumed",
        };
        SettingJson { name: setting.name, value: &setting.value, origin }
    });
    let steps = check.steps.iter().map(|step| StepJson {
        step: step.name,
        verdict: step.verdict().word(),
        detail: detail(check, step, error),
    });
    let about = about(&check.address, check.identity());
    let (settings, steps) = (settings.collect(), steps.collect());
    product("check", columns, &CheckJson { about, settings, steps, error })
}

/// Returns changed settings as text, and what can be changed where nothing was asked for.
pub fn settings_text(settings: &SettingsDone, asked: bool) -> String {
    let mut text = title(&settings.address, &settings.identity) + "\n";
    for set in &settings.done {
        let _ = writeln!(text, "  {:<24} {}", set.name, set.value);
    }
    if !asked {
        for (name, takes) in &settings.settable {
            let _ = writeln!(text, "  {name:<24} {takes}");
        }
        if settings.settable.is_empty() {
            let _ = writeln!(text, "  it has no settings to change");
        }
    }
    text
}

#[derive(Serialize)]
struct SetJson<'a> {
    name: &'a str,
    asked: &'a str,
    value: &'a SettingValue,
}

#[derive(Serialize)]
struct TakesJson<'a> {
    name: &'a str,
    takes: &'a str,
}

#[derive(Serialize)]
struct SettingsJson<'a> {
    #[serde(flatten)]
    about: AboutJson<'a>,
    settings: Vec<SetJson<'a>>,
    settable: Vec<TakesJson<'a>>,
    complete: bool,
    error: Option<&'a str>,
}

/// Returns changed settings as a table and as JSON; `error` says why they are not all.
pub fn settings(settings: &SettingsDone, error: Option<&str>) -> Product {
    let done = &settings.done;
    let set =
        done.iter().map(|set| SetJson { name: &set.name, asked: &set.asked, value: &set.value });
    let json = SettingsJson {
        about: about(&settings.address, Some(&settings.identity)),
        settings: set.collect(),
        settable: settings.settable.iter().map(|(name, takes)| TakesJson { name, takes }).collect(),
        complete: error.is_none(),
        error,
    };
    let columns = vec![
        Column::text("name", done.iter().map(|set| set.name.clone()).collect()),
        Column::text("asked", done.iter().map(|set| set.asked.clone()).collect()),
        Column::text("value", done.iter().map(|set| set.value.to_string()).collect()),
    ];
    product("settings", columns, &json)
}

/// Returns moves as text.
pub fn moves_text(moves: &Moves) -> String {
    let mut text = title(&moves.address, &moves.identity) + "\n";
    for one in &moves.moves {
        let _ = writeln!(text, "  {:<8} -> {} after {:.1} s", one.target, one.at, one.took_s);
    }
    if let Some(failed) = &moves.failed {
        let name = &failed.target;
        let _ = writeln!(text, "  {name:<8} -> not reached; it stands at {}", moves.at);
    }
    text
}

#[derive(Serialize)]
struct PlaceJson {
    angle_deg: Option<f64>,
    slot: Option<u32>,
    position_steps: Option<i64>,
}

#[derive(Serialize)]
struct MoveJson<'a> {
    target: &'a str,
    #[serde(flatten)]
    at: PlaceJson,
    took_s: f64,
}

#[derive(Serialize)]
struct MovesJson<'a> {
    #[serde(flatten)]
    about: AboutJson<'a>,
    moves: Vec<MoveJson<'a>>,
    at: PlaceJson,
    complete: bool,
    error: Option<&'a str>,
}

/// Returns moves as a table and as JSON; `error` says why they are not all.
pub fn moves(moves: &Moves, error: Option<&str>) -> Product {
    let place = |at: Position| PlaceJson {
        angle_deg: at.angle_deg(),
        slot: at.slot(),
        position_steps: at.steps(),
    };
    let reached = moves.moves.iter().map(|one| MoveJson {
        target: &one.target,
        at: place(one.at),
        took_s: one.took_s,
    });
    let json = MovesJson {
        about: about(&moves.address, Some(&moves.identity)),
        moves: reached.collect(),
        at: place(moves.at),
        complete: error.is_none(),
        error,
    };
    let all = &moves.moves;
    let angle = all.iter().map(|one| one.at.angle_deg().unwrap_or(f64::NAN)).collect();
    let slot = all.iter().map(|one| one.at.slot().map_or(f64::NAN, f64::from)).collect();
    // Steps are far below 2^53.
    let steps = all.iter().map(|one| one.at.steps().map_or(f64::NAN, |n| n as f64)).collect();
    let columns = vec![
        Column::text("target", all.iter().map(|one| one.target.clone()).collect()),
        Column::f64("angle_deg", Some("deg"), angle),
        Column::f64("slot", None, slot),
        Column::f64("position_steps", None, steps),
        Column::f64("took_s", Some("s"), all.iter().map(|one| one.took_s).collect()),
    ];
    product("moves", columns, &json)
}

/// A recording that was replayed.
#[derive(Debug, Clone, Copy)]
pub struct Replayed<'a> {
    /// The recording's file.
    pub file: &'a Path,
    /// Header.
    pub header: &'a Header,
    /// The command that was replayed.
    pub command: &'a [String],
    /// Text of the command's result; empty where there is none.
    pub text: &'a str,
    /// JSON of the command's result.
    pub result: &'a Value,
    /// Difference between the driver's words and the recording.
    pub mismatch: Option<&'a ReplayError>,
    /// Error that the command ended with, if there was one.
    pub ended: Option<&'a str>,
}

/// Returns a replay as text.
pub fn replay_text(replayed: &Replayed<'_>) -> String {
    let Replayed { file, header, text, .. } = replayed;
    let made = if header.synthetic { "synthetic" } else { "not synthetic" };
    let mut text = format!("{} ({made}): {}\n{text}", file.display(), header.device);
    match (replayed.ended, replayed.mismatch) {
        (_, Some(_)) => text.push_str("the driver and the recording differ\n"),
        (Some(ended), None) => text.push_str(&format!("as recorded, it ended with: {ended}\n")),
        (None, None) => text.push_str("as recorded, to the last byte\n"),
    }
    text
}

#[derive(Serialize)]
struct ReplayJson<'a> {
    recording: String,
    recorded_device: &'a str,
    source: &'a str,
    synthetic: bool,
    command: &'a [String],
    agrees: bool,
    mismatch: Option<String>,
    ended: Option<&'a str>,
    result: &'a Value,
}

/// Returns a replay as JSON.
pub fn replay(replayed: &Replayed<'_>) -> Product {
    let Replayed { file, header, command, result, mismatch, ended, .. } = replayed;
    let json = json_of(&ReplayJson {
        recording: file.display().to_string(),
        recorded_device: &header.device,
        source: &header.source,
        synthetic: header.synthetic,
        command,
        agrees: mismatch.is_none(),
        mismatch: mismatch.map(ToString::to_string),
        ended: *ended,
        result,
    });
    Product { name: "replay".into(), json, ..Product::default() }
}
