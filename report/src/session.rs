//! Report of a recorded night: what is there, and what is missing.

use serde_json::{Value, json};
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

/// Summary with its documented keys.
pub fn json(session: &Session, report: &Report) -> Value {
    let manifest = session.manifest();
    let utc = |epoch| format_utc(epoch, 6);
    let counters: Vec<Value> = report
        .counters
        .iter()
        .map(|counter| {
            json!({
                "name": counter.name,
                "rows": counter.rows,
                "marked_rows": counter.marked_rows,
                "tags": counter.tags,
                "marked_tags": counter.marked_tags,
                "flagged_gaps": counter.flagged_gaps,
                "unflagged_gaps": counter.unflagged_gaps,
                "from_utc": counter.from_to.map(|[from, _]| utc(from)),
                "to_utc": counter.from_to.map(|[_, to]| utc(to)),
            })
        })
        .collect();
    let cameras: Vec<Value> = report
        .cameras
        .iter()
        .map(|camera| {
            json!({
                "name": camera.name,
                "frames": camera.frames,
                "marked_frames": camera.marked_frames,
                "missing_frames": camera.missing_frames,
                "unfinished_frames": camera.unfinished,
            })
        })
        .collect();
    let findings: Vec<Value> = report
        .findings
        .iter()
        .map(|finding| {
            let severity = if finding.severity == Severity::Missing { "missing" } else { "note" };
            json!({ "severity": severity, "file": finding.file, "text": finding.text })
        })
        .collect();
    json!({
        "session": session.root().display().to_string(),
        "station": manifest.station,
        "program": manifest.program,
        "start_utc": utc(manifest.start_utc),
        "safe_until_utc": report.safe_until.map(utc),
        "ended": report.ended,
        "whole": report.is_whole(),
        "events": report.events,
        "counters": counters,
        "cameras": cameras,
        "findings": findings,
    })
}
