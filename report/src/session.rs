//! Report of a recorded night: what is there, and what is missing.

use crate::json_of;
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_formats::session::{Report, Session, Severity};
use sunglint_formats::time::format_utc;

/// Text of what is there and what is missing.
pub fn text(session: &Session, report: &Report) -> String {
    let manifest = session.manifest();
    let mut text = format!(
        "{}: {}, from {}, written by {}\n",
        session.root().display(),
        manifest.station,
        format_utc(manifest.start_utc, 3),
        manifest.program
    );
    for counter in &report.counters {
        let _ = write!(text, "  {}: {} bins", counter.name, counter.rows);
        if let Some([from, to]) = counter.from_to {
            let _ = write!(text, " from {} to {}", format_utc(from, 3), format_utc(to, 3));
        }
        let _ = writeln!(text, ", {} of them below the last mark", counter.marked_rows);
        if let Some(tags) = counter.tags {
            let (name, marked) = (&counter.name, counter.marked_tags);
            let _ = writeln!(text, "  {name}: {tags} raw tags, {marked} below the last mark");
        }
    }
    for camera in &report.cameras {
        let _ = writeln!(
            text,
            "  {}: {} frames, {} of them below the last mark, {} missing",
            camera.name, camera.frames, camera.marked_frames, camera.missing_frames
        );
    }
    let _ = writeln!(text, "  {} events", report.events);
    for finding in &report.findings {
        let word = if finding.severity == Severity::Missing { "MISSING" } else { "note" };
        let _ = writeln!(text, "  {word}: {}: {}", finding.file, finding.text);
    }
    text.push_str(if report.is_whole() { "all of it is there" } else { "not all of it is there" });
    text
}

#[derive(Serialize)]
struct CounterJson<'a> {
    name: &'a str,
    rows: u64,
    marked_rows: u64,
    tags: Option<u64>,
    marked_tags: u64,
    flagged_gaps: u64,
    unflagged_gaps: u64,
    from_utc: Option<String>,
    to_utc: Option<String>,
}

#[derive(Serialize)]
struct CameraJson<'a> {
    name: &'a str,
    frames: u64,
    marked_frames: u64,
    missing_frames: u64,
    unfinished_frames: u64,
}

#[derive(Serialize)]
struct FindingJson<'a> {
    severity: &'a str,
    file: &'a str,
    text: &'a str,
}

#[derive(Serialize)]
struct SessionJson<'a> {
    session: String,
    station: &'a str,
    program: &'a str,
    start_utc: String,
    safe_until_utc: Option<String>,
    ended: bool,
    whole: bool,
    events: u64,
    counters: Vec<CounterJson<'a>>,
    cameras: Vec<CameraJson<'a>>,
    findings: Vec<FindingJson<'a>>,
}

/// Summary with its documented keys.
pub fn json(session: &Session, report: &Report) -> Value {
    let manifest = session.manifest();
    let utc = |epoch| format_utc(epoch, 6);
    let counters: Vec<_> = report
        .counters
        .iter()
        .map(|counter| CounterJson {
            name: &counter.name,
            rows: counter.rows,
            marked_rows: counter.marked_rows,
            tags: counter.tags,
            marked_tags: counter.marked_tags,
            flagged_gaps: counter.flagged_gaps,
            unflagged_gaps: counter.unflagged_gaps,
            from_utc: counter.from_to.map(|[from, _]| utc(from)),
            to_utc: counter.from_to.map(|[_, to]| utc(to)),
        })
        .collect();
    let cameras: Vec<_> = report
        .cameras
        .iter()
        .map(|camera| CameraJson {
            name: &camera.name,
            frames: camera.frames,
            marked_frames: camera.marked_frames,
            missing_frames: camera.missing_frames,
            unfinished_frames: camera.unfinished,
        })
        .collect();
    let findings: Vec<_> = report
        .findings
        .iter()
        .map(|finding| {
            let severity = if finding.severity == Severity::Missing { "missing" } else { "note" };
            FindingJson { severity, file: &finding.file, text: &finding.text }
        })
        .collect();
    json_of(&SessionJson {
        session: session.root().display().to_string(),
        station: &manifest.station,
        program: &manifest.program,
        start_utc: utc(manifest.start_utc),
        safe_until_utc: report.safe_until.map(utc),
        ended: report.ended,
        whole: report.is_whole(),
        events: report.events,
        counters,
        cameras,
        findings,
    })
}
