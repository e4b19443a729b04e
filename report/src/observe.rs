//! A night as it is observed: its status, its clock, how it ended.

use crate::json_of;
use glam::DVec2;
use serde::Serialize;
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use sunglint_formats::session::ClockState;
use sunglint_formats::time::format_utc;
use sunglint_observatory::{Snapshot, State, Summary, clock};

/// Returns the state of a night on one line.
pub fn status_text(snapshot: &Snapshot) -> String {
    let mut text = format_utc(snapshot.utc, 1);
    if let Some(target) = &snapshot.target {
        let _ = write!(text, "  {target}");
    }
    for (name, device) in &snapshot.devices {
        let _ = write!(text, "  | {name}");
        if device.state != State::Running {
            let _ = write!(text, " {}", device.state.word());
        }
        for (channel, rate_hz) in &device.rates_hz {
            let _ = write!(text, " {channel} {}", short_hz(*rate_hz));
        }
        if let Some(frame) = &device.frame {
            let _ =
                write!(text, " #{} {:.0}..{} ADU", frame.number, frame.mean_adu, frame.most_adu);
            if let Some(glam::DVec2 { x, y }) = frame.brightest_px {
                let _ = write!(text, " at {x:+.1} {y:+.1} px");
            }
        }
        if let Some(mount) = &device.mount {
            let _ = write!(text, " {}", mount.state);
            if let Some(error) = mount.seen_arcsec.or(mount.error_arcsec) {
                let _ = write!(text, " {error:.1}″");
            }
        }
    }
    if let Some(free) = snapshot.free_bytes {
        let _ = write!(text, "  | {:.1} GB free", free as f64 * 1e-9);
    }
    if let Some(error) = &snapshot.disk_error {
        let _ = write!(text, "  | {error}");
    }
    if snapshot.missing > 0 {
        let _ = write!(text, "  | {} NOT WRITTEN", snapshot.missing);
    }
    text
}

#[derive(Serialize)]
struct FrameJson {
    start_utc: String,
    number: u64,
    mean_adu: f64,
    most_adu: u16,
    brightest_px: Option<DVec2>,
}

#[derive(Serialize)]
struct MountJson<'a> {
    state: &'a str,
    error_arcsec: Option<f64>,
    seen_arcsec: Option<f64>,
}

#[derive(Serialize)]
struct DeviceJson<'a> {
    state: &'a str,
    error: Option<&'a String>,
    taken: u64,
    losses: u64,
    refused: u64,
    rates_hz: Map<String, Value>,
    frame: Option<FrameJson>,
    mount: Option<MountJson<'a>>,
}

#[derive(Serialize)]
struct StatusJson<'a> {
    kind: &'a str,
    utc: String,
    target: Option<&'a str>,
    devices: Map<String, Value>,
    disk_free_bytes: Option<u64>,
    disk_error: Option<&'a str>,
    not_written: u64,
    messages: &'a [String],
}

/// Returns the state of a night as a JSON line of the kind `status`.
pub fn status_json(snapshot: &Snapshot) -> Value {
    let devices = snapshot.devices.iter().map(|(name, device)| {
        let rates: Map<_, _> =
            device.rates_hz.iter().map(|(c, rate)| (c.clone(), Value::from(*rate))).collect();
        let error = match &device.state {
            State::Lost { error } | State::Failed { error } => Some(error),
            _ => None,
        };
        let frame = device.frame.as_ref().map(|frame| FrameJson {
            start_utc: format_utc(frame.start, 6),
            number: frame.number,
            mean_adu: frame.mean_adu,
            most_adu: frame.most_adu,
            brightest_px: frame.brightest_px,
        });
        let mount = device.mount.as_ref().map(|mount| MountJson {
            state: &mount.state,
            error_arcsec: mount.error_arcsec,
            seen_arcsec: mount.seen_arcsec,
        });
        let value = json_of(&DeviceJson {
            state: device.state.word(),
            error,
            taken: device.taken,
            losses: device.losses,
            refused: device.refused,
            rates_hz: rates,
            frame,
            mount,
        });
        (name.clone(), value)
    });
    json_of(&StatusJson {
        kind: "status",
        utc: format_utc(snapshot.utc, 3),
        target: snapshot.target.as_deref(),
        devices: devices.collect(),
        disk_free_bytes: snapshot.free_bytes,
        disk_error: snapshot.disk_error.as_deref(),
        not_written: snapshot.missing,
        messages: &snapshot.messages,
    })
}

/// Returns how a night went, on one line.
pub fn summary_text(summary: &Summary) -> String {
    let taken = summary.taken.iter().map(|(name, n)| match summary.on_disk.get(name) {
        Some(written) if written != n => format!("{name} {n}, of which {written} are on the disk"),
        _ => format!("{name} {n}"),
    });
    let taken: Vec<String> = taken.collect();
    let mut text = format!("{}: {}", summary.root.display(), taken.join(", "));
    for (name, refused) in summary.refused.iter().filter(|(_, refused)| **refused > 0) {
        let _ = write!(text, "; {refused} frames of {name} refused (events.jsonl says why)");
    }
    text
}

#[derive(Serialize)]
struct SummaryJson<'a> {
    kind: &'a str,
    session: String,
    utc: String,
    reason: &'a str,
    taken: &'a BTreeMap<String, u64>,
    on_disk: &'a BTreeMap<String, u64>,
    empty_steps: &'a [String],
    losses: &'a BTreeMap<String, u64>,
    refused: &'a BTreeMap<String, u64>,
    failed: &'a [(String, String)],
    not_written: u64,
}

/// Returns how a night went as a JSON line of the kind `end`.
pub fn summary_json(summary: &Summary) -> Value {
    json_of(&SummaryJson {
        kind: "end",
        session: summary.root.display().to_string(),
        utc: format_utc(summary.utc, 3),
        reason: if summary.stopped { "stopped" } else { "done" },
        taken: &summary.taken,
        on_disk: &summary.on_disk,
        empty_steps: &summary.empty,
        losses: &summary.losses,
        refused: &summary.refused,
        failed: &summary.failed,
        not_written: summary.not_written,
    })
}

/// Returns the state of the computer's clock in a sentence.
pub fn clock_text(state: &ClockState) -> String {
    let who = &state.method;
    if *state == clock::exact() {
        return "a virtual night: its clock is UTC".into();
    }
    if who == "recording" {
        return "a night of recordings: its times are theirs".into();
    }
    match (state.synchronised, state.offset_s, state.error_s) {
        (None, ..) => "nobody here knows how far the computer's clock is from UTC (neither chrony nor systemd-timesyncd)".into(),
        (Some(false), ..) => format!("{who} says that the computer's clock does not follow UTC"),
        (Some(true), Some(offset), Some(error)) => format!(
            "the computer's clock is {:+.3} ms from UTC, at most {:.3} ms ({who})",
            offset * 1e3,
            error * 1e3
        ),
        (Some(true), ..) => format!("{who} keeps the computer's clock; it tells no offset"),
    }
}

/// A rate in three figures.
fn short_hz(rate_hz: f64) -> String {
    match rate_hz {
        rate if rate >= 1e6 => format!("{:.2} MHz", rate * 1e-6),
        rate if rate >= 1e3 => format!("{:.2} kHz", rate * 1e-3),
        rate => format!("{rate:.0} Hz"),
    }
}
