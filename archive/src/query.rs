//! Passes of an archive that meet conditions.

use crate::ArchiveError;
use crate::file::{Kind, number_in};
use crate::index::{Damaged, Index, Known, Row, Updated};
use hifitime::Epoch;
use serde::Serialize;
use std::collections::HashSet;
use std::fmt::Write as _;
use sunglint_formats::time::format_utc;
use sunglint_formats::{Column, Table, Values, nearest_names};

/// Conditions that a pass must meet, all of them.
#[derive(Debug, Clone, Default)]
pub struct Query {
    /// Object: its number in the catalogue, or its target's name.
    pub object: Option<String>,
    /// Channels or filters: one of these.
    pub channels: Vec<String>,
    /// Kinds of light: one of these; all but what is only recorded and what is simulated unless given.
    pub kinds: Vec<Kind>,
    /// Station.
    pub station: Option<String>,
    /// Passes that end at this moment or later,
    pub from: Option<Epoch>,
    /// and begin at this one or before.
    pub to: Option<Epoch>,
    /// Passes with a sample whose phase angle is below this, deg,
    pub phase_below_deg: Option<f64>,
    /// and one whose phase angle is above this.
    pub phase_above_deg: Option<f64>,
    /// Fewest samples with a rate or a magnitude.
    pub min_samples: Option<u32>,
}

/// One channel of a pass that was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Pass {
    /// The file, relative to the archive; of a session its `session.toml`.
    pub file: String,
    /// Number of the pass in the file, from 1.
    pub pass: u32,
    /// Kind of light.
    pub kind: Kind,
    /// Name of the target.
    pub target: String,
    /// Number in the catalogue.
    pub norad_id: Option<u32>,
    /// Where that number is from.
    pub norad_id_from: Known,
    /// Station.
    pub station: String,
    /// Channel or filter.
    pub channel: String,
    /// First sample.
    pub from_utc: String,
    /// Last sample.
    pub to_utc: String,
    /// Samples with a rate or a magnitude.
    pub samples: u32,
    /// Smallest and largest phase angle.
    pub phase_deg: Option<(f64, f64)>,
    /// Smallest and largest range.
    pub range_m: Option<(f64, f64)>,
    /// Largest rate, Hz, or smallest magnitude.
    pub brightest: Option<f64>,
}

/// Answer to a question: the JSON document.
#[derive(Debug, Clone, Serialize)]
pub struct Found {
    /// The archive's folder.
    pub archive: String,
    /// Work that bringing the index up to date was.
    pub index: Updated,
    /// Files that hold light.
    pub with_light: usize,
    /// Files that are damaged and left out.
    pub damaged: Vec<Damaged>,
    /// Channels of passes that meet all conditions but those on the phase angle, of which nothing is known.
    pub without_phase: usize,
    /// Channels of passes, by time.
    pub passes: Vec<Pass>,
    /// Words for a person.
    pub warnings: Vec<String>,
}

/// Passes that the text lists at most.
const LISTED: usize = 200;

impl Query {
    fn is_met(&self, row: &Row<'_>) -> bool {
        let light = row.light;
        let usual = !matches!(light.kind, Kind::Recorded | Kind::Predicted);
        let kind = if self.kinds.is_empty() { usual } else { self.kinds.contains(&light.kind) };
        kind && self.object.as_deref().is_none_or(|object| is_object(object, row))
            && (self.channels.is_empty() || self.channels.contains(&light.channel))
            && self.station.as_deref().is_none_or(|s| s == light.station)
            && self.from.is_none_or(|from| light.to >= from)
            && self.to.is_none_or(|to| light.from <= to)
            && self.min_samples.is_none_or(|least| light.samples >= least)
    }

    /// Refuses conditions that no pass could meet.
    ///
    /// # Errors
    /// [`ArchiveError::Phase`]: a phase angle that is not within 0° to 180°.
    pub fn check(&self) -> Result<(), ArchiveError> {
        for (field, deg) in
            [("phase_below_deg", self.phase_below_deg), ("phase_above_deg", self.phase_above_deg)]
        {
            if let Some(deg) = deg.filter(|deg| !(0.0..=180.0).contains(deg)) {
                return Err(ArchiveError::Phase { field, deg });
            }
        }
        Ok(())
    }

    fn asks_phase(&self) -> bool {
        self.phase_below_deg.is_some() || self.phase_above_deg.is_some()
    }

    /// Whether a sample of this phase angle is wanted.
    pub fn takes_phase(&self, deg: f64) -> bool {
        self.phase_below_deg.is_none_or(|below| deg < below)
            && self.phase_above_deg.is_none_or(|above| deg > above)
    }

    /// Asks an index.
    pub fn ask(&self, index: &Index) -> Found {
        let rows = index.rows();
        let mut without_phase = 0;
        let mut met: Vec<&Row<'_>> = Vec::new();
        for row in rows.iter().filter(|row| self.is_met(row)) {
            match row.light.phase_deg {
                None if self.asks_phase() => without_phase += 1,
                Some((least, most))
                    if self.phase_below_deg.is_some_and(|below| least >= below)
                        || self.phase_above_deg.is_some_and(|above| most <= above) => {}
                _ => met.push(row),
            }
        }
        met.sort_by_key(|row| {
            let from = sunglint_formats::time::tai_nanoseconds(row.light.from);
            (from, row.path, row.light.pass)
        });
        let mut warnings = index.warnings.clone();
        warnings.extend(self.unknown(&rows));
        Found {
            archive: index.root().display().to_string(),
            index: index.updated,
            with_light: index.with_light(),
            damaged: index.damaged(),
            without_phase,
            passes: met.into_iter().map(pass).collect(),
            warnings,
        }
    }

    /// Names in the question that no file of the archive has, with the nearest.
    fn unknown(&self, rows: &[Row<'_>]) -> Vec<String> {
        let mut said = Vec::new();
        let mut ask = |what: &str, wanted: &str, known: Vec<&str>| {
            let mut known: Vec<&str> = known.into_iter().filter(|n| !n.is_empty()).collect();
            known.sort_unstable();
            known.dedup();
            if !known.contains(&wanted) {
                let near = nearest_names(wanted, known.iter().copied(), 3).join(", ");
                let hint = if near.is_empty() {
                    String::new()
                } else {
                    format!("; the nearest are {near}")
                };
                said.push(format!("no pass of the archive has the {what} `{wanted}`{hint}"));
            }
        };
        for channel in &self.channels {
            ask("channel", channel, rows.iter().map(|r| r.light.channel.as_str()).collect());
        }
        if let Some(station) = &self.station {
            ask("station", station, rows.iter().map(|r| r.light.station.as_str()).collect());
        }
        if let Some(object) = &self.object
            && !rows.iter().any(|row| is_object(object, row))
        {
            ask("object", object, rows.iter().map(|r| r.light.target.as_str()).collect());
        }
        said
    }
}

fn is_object(object: &str, row: &Row<'_>) -> bool {
    row.light.target.eq_ignore_ascii_case(object)
        || row.norad_id.is_some() && number_in(object) == row.norad_id
}

fn pass(row: &Row<'_>) -> Pass {
    let light = row.light;
    Pass {
        file: row.path.to_owned(),
        pass: light.pass,
        kind: light.kind,
        target: light.target.clone(),
        norad_id: row.norad_id,
        norad_id_from: row.known,
        station: light.station.clone(),
        channel: light.channel.clone(),
        from_utc: format_utc(light.from, 3),
        to_utc: format_utc(light.to, 3),
        samples: light.samples,
        phase_deg: light.phase_deg,
        range_m: light.range_m,
        brightest: light.brightest,
    }
}

impl Found {
    /// The files of the passes, each once, in the order of time.
    pub fn files(&self) -> Vec<&str> {
        let mut seen = HashSet::new();
        let files = self.passes.iter().map(|pass| pass.file.as_str());
        files.filter(|file| seen.insert(*file)).collect()
    }

    /// The passes as a table.
    pub fn table(&self) -> Table {
        let all = &self.passes;
        let text =
            |name: &str, of: fn(&Pass) -> String| Column::text(name, all.iter().map(of).collect());
        let real = |name: &str, unit: &str, of: fn(&Pass) -> Option<f64>| {
            let values = all.iter().map(|p| of(p).unwrap_or(f64::NAN)).collect();
            Column::f64(name, (!unit.is_empty()).then_some(unit), values)
        };
        let numbers = all.iter().map(|p| p.norad_id.map(i64::from)).collect();
        let norad_id =
            Column { values: Values::I64(numbers), ..Column::i64("norad_id", None, Vec::new()) };
        Table {
            columns: vec![
                text("file", |p| p.file.clone()),
                Column::i64("pass", None, all.iter().map(|p| p.pass.into()).collect()),
                text("kind", |p| p.kind.name().to_owned()),
                text("target", |p| p.target.clone()),
                norad_id,
                text("station", |p| p.station.clone()),
                text("channel", |p| p.channel.clone()),
                text("from_utc", |p| p.from_utc.clone()),
                text("to_utc", |p| p.to_utc.clone()),
                Column::i64("samples", None, all.iter().map(|p| p.samples.into()).collect()),
                real("phase_min_deg", "deg", |p| Some(p.phase_deg?.0)),
                real("phase_max_deg", "deg", |p| Some(p.phase_deg?.1)),
                real("range_min_m", "m", |p| Some(p.range_m?.0)),
                real("range_max_m", "m", |p| Some(p.range_m?.1)),
                real("brightest", "", |p| p.brightest),
            ],
            ..Table::default()
        }
    }

    /// Text for a person.
    pub fn text(&self) -> String {
        let mut text = String::new();
        let Updated { files, read, gone } = self.index;
        let _ = write!(
            text,
            "{}: {files} files, {} with light ({read} read now",
            self.archive, self.with_light
        );
        if gone > 0 {
            let _ = write!(text, ", {gone} gone");
        }
        text.push_str(")\n");
        if self.passes.is_empty() {
            text.push_str("no pass meets the conditions\n");
        } else {
            let _ = writeln!(
                text,
                "{:<20}  {:>6}  {:>7}  {:<20} {:<11} {:<10} {:>7}  {:>13}  {:>10}  file",
                "from (UTC)",
                "s",
                "number",
                "target",
                "kind",
                "channel",
                "samples",
                "phase, deg",
                "brightest"
            );
        }
        for pass in self.passes.iter().take(LISTED) {
            let short = |name: &str, most: usize| name.chars().take(most).collect::<String>();
            let dash = || "-".to_owned();
            let number = pass.norad_id.map_or_else(dash, |n| n.to_string());
            let phase = pass.phase_deg.map_or_else(dash, |(a, b)| format!("{a:.1} to {b:.1}"));
            let brightest = match (pass.brightest, pass.kind) {
                (None, _) => dash(),
                (Some(mag), Kind::Magnitudes) => format!("{mag:.2} mag"),
                (Some(hz), _) => format!("{hz:.4e}"),
            };
            let seconds = seconds(&pass.from_utc, &pass.to_utc);
            let _ = writeln!(
                text,
                "{:<20}  {seconds:>6.0}  {number:>7}  {:<20} {:<11} {:<10} {:>7}  {phase:>13}  {brightest:>10}  {}",
                pass.from_utc.split('.').next().unwrap_or(""),
                short(&pass.target, 20),
                pass.kind.name(),
                short(&pass.channel, 10),
                pass.samples,
                pass.file
            );
        }
        if let Some(more) = self.passes.len().checked_sub(LISTED).filter(|more| *more > 0) {
            let _ = writeln!(text, "… and {more} more (-o FILE has all)");
        }
        if self.without_phase > 0 {
            let _ = writeln!(
                text,
                "{} more meet the other conditions and have no phase angle: they are left out",
                self.without_phase
            );
        }
        text
    }
}

/// Seconds between two moments that were written by this program.
fn seconds(from: &str, to: &str) -> f64 {
    let parse = sunglint_formats::time::parse_utc;
    match (parse(from), parse(to)) {
        (Ok(from), Ok(to)) => (to - from).to_seconds(),
        _ => f64::NAN,
    }
}
