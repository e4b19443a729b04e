//! Instruments and what they gave, as text, tables, FITS and JSON.
//!
//! Errors come in as text: whoever asks knows by which option or command a person can help.

mod lists;
mod readings;

pub use lists::{drivers, drivers_text, inventory, inventory_text};
pub use readings::{reading_text, readings, readings_text};

use crate::Product;
use serde_json::{Map, Value, json};
use std::fmt::Write as _;
use std::path::Path;
use sunglint_drivers::catalogue::Address;
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::device::{Device, DeviceError, Identity, Origin, Value as SettingValue};
use sunglint_drivers::recording::{Header, ReplayError};
use sunglint_drivers::session::{Check, CheckStep, Finding, Moves, SettingsDone};
use sunglint_formats::{Column, Table};

/// Who a device says it is, with all its settings, as JSON; each step has a deadline.
///
/// # Errors
/// Those of the device.
pub fn described(
    device: &mut dyn Device,
    within: &dyn Fn() -> Deadline,
) -> Result<Value, DeviceError> {
    let identity = device.identity(&within())?;
    let settings = device.settings(&within())?.into_iter().map(|setting| {
        let value = match setting.value {
            SettingValue::Number(number) => json!(number),
            SettingValue::Integer(number) => json!(number),
            SettingValue::Text(text) => json!(text),
            SettingValue::Flag(flag) => json!(flag),
        };
        (setting.name.to_owned(), value)
    });
    Ok(json!({
        "vendor": identity.vendor,
        "model": identity.model,
        "serial": identity.serial,
        "firmware": identity.firmware,
        "driver": identity.driver,
        "settings": settings.collect::<Map<_, _>>(),
    }))
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

/// Returns the keys that every document about a device begins with.
fn document(address: &Address, device: Option<&Identity>) -> Map<String, Value> {
    let driver = address.driver;
    let device = device.map(|about| {
        json!({
            "vendor": about.vendor,
            "model": about.model,
            "serial": about.serial,
            "firmware": about.firmware,
        })
    });
    [
        ("address", json!(address.to_string())),
        ("driver", json!(driver.name)),
        ("kind", json!(driver.kind.to_string())),
        ("simulated", json!(driver.simulated)),
        ("device", json!(device)),
    ]
    .map(|(key, value)| (key.to_owned(), value))
    .into_iter()
    .collect()
}

/// Returns a setting's value for a document.
fn setting_json(value: &SettingValue) -> Value {
    match value {
        SettingValue::Number(number) => json!(number),
        SettingValue::Integer(number) => json!(number),
        SettingValue::Flag(flag) => json!(flag),
        other => json!(other.to_string()),
    }
}

fn product(name: &str, columns: Vec<Column>, json: Map<String, Value>) -> Product {
    let table = Table { columns, ..Table::default() };
    Product { name: name.into(), table, json: Value::Object(json), ..Product::default() }
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
        };
        let _ = writeln!(text, "          {:<24} {} ({origin})", setting.name, setting.value);
    }
    text
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
    let mut json = document(&check.address, check.identity());
    let settings = check.settings().iter().map(|setting| {
        let origin = match setting.origin {
            Origin::ReadBack => "read_back",
            Origin::Configured => "configured",
        };
        json!({ "name": setting.name, "value": setting_json(&setting.value), "origin": origin })
    });
    json.insert("settings".into(), settings.collect());
    let steps = check.steps.iter().map(|step| {
        json!({ "step": step.name, "verdict": step.verdict().word(), "detail": detail(check, step, error) })
    });
    json.insert("steps".into(), steps.collect());
    json.insert("error".into(), json!(error));
    product("check", columns, json)
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

/// Returns changed settings as a table and as JSON; `error` says why they are not all.
pub fn settings(settings: &SettingsDone, error: Option<&str>) -> Product {
    let done = &settings.done;
    let mut json = document(&settings.address, Some(&settings.identity));
    let set = done.iter().map(
        |set| json!({ "name": set.name, "asked": set.asked, "value": setting_json(&set.value) }),
    );
    json.insert("settings".into(), set.collect());
    let takes = settings.settable.iter();
    let takes = takes.map(|(name, takes)| json!({ "name": name, "takes": takes }));
    json.insert("settable".into(), takes.collect());
    json.insert("complete".into(), json!(error.is_none()));
    json.insert("error".into(), json!(error));
    let columns = vec![
        Column::text("name", done.iter().map(|set| set.name.clone()).collect()),
        Column::text("asked", done.iter().map(|set| set.asked.clone()).collect()),
        Column::text("value", done.iter().map(|set| set.value.to_string()).collect()),
    ];
    product("settings", columns, json)
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

/// Returns moves as a table and as JSON; `error` says why they are not all.
pub fn moves(moves: &Moves, error: Option<&str>) -> Product {
    let mut json = document(&moves.address, Some(&moves.identity));
    let reached = moves.moves.iter().map(|one| {
        json!({
            "target": one.target,
            "angle_deg": one.at.angle_deg(),
            "slot": one.at.slot(),
            "position_steps": one.at.steps(),
            "took_s": one.took_s,
        })
    });
    json.insert("moves".into(), reached.collect());
    let at = json!({ "angle_deg": moves.at.angle_deg(), "slot": moves.at.slot(), "position_steps": moves.at.steps() });
    json.insert("at".into(), at);
    json.insert("complete".into(), json!(error.is_none()));
    json.insert("error".into(), json!(error));
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
    product("moves", columns, json)
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

/// Returns a replay as JSON.
pub fn replay(replayed: &Replayed<'_>) -> Product {
    let Replayed { file, header, command, result, mismatch, ended, .. } = replayed;
    let json = json!({
        "recording": file.display().to_string(),
        "recorded_device": header.device,
        "source": header.source,
        "synthetic": header.synthetic,
        "command": command,
        "agrees": mismatch.is_none(),
        "mismatch": mismatch.map(ToString::to_string),
        "ended": ended,
        "result": result,
    });
    Product { name: "replay".into(), json, ..Product::default() }
}
