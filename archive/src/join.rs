//! Passes of several files as one light curve, for programs and commands that read a curve.

use crate::file::{self, Kind};
use crate::query::{Pass, Query};
use crate::{ArchiveError, Found};
use hifitime::Epoch;
use std::collections::BTreeSet;
use std::path::Path;
use sunglint_formats::photometry::{self, ColumnNames};
use sunglint_formats::time::{format_utc_shortest, tai_nanoseconds};
use sunglint_formats::{Column, Meta, Table, read, sha256, text_table};
use sunglint_radiometry::light_curve::{
    ChannelCurve, Flags, Input, LightCurve, Provenance, Samples,
};

fn apart(why: impl Into<String>) -> ArchiveError {
    ArchiveError::Apart { why: why.into() }
}

/// The light of passes as one table: a light curve of this program's schema where they are rates, a table of magnitudes where they are magnitudes. Samples whose
/// phase angle the question leaves out are not in it. A channel that a pass does not have is flagged `NOT_SAMPLED` there.
///
/// # Errors
/// [`ArchiveError::Apart`]: no pass; passes of several kinds, targets or stations; magnitudes without a zero point. [`ArchiveError::Changed`]; files that cannot be
/// read.
pub fn join(found: &Found, query: &Query, archive: &Path) -> Result<Table, ArchiveError> {
    let Some(first) = found.passes.first() else {
        return Err(apart("no pass meets the conditions"));
    };
    let several = |what: &str, of: fn(&Pass) -> String, help: &str| {
        let all: BTreeSet<String> = found.passes.iter().map(of).collect();
        match all.len() {
            1 => Ok(()),
            _ => {
                let names: Vec<String> = all.into_iter().collect();
                Err(apart(format!("they have several {what} ({}): {help}", names.join(", "))))
            }
        }
    };
    several("kinds of light", |p| p.kind.name().into(), "ask for one kind")?;
    several(
        "objects",
        |p| p.norad_id.map_or_else(|| p.target.clone(), |n| n.to_string()),
        "ask for one object",
    )?;
    match first.kind {
        Kind::Recorded => Err(apart("they are recorded, and not yet curves: reduce them first")),
        Kind::Magnitudes => magnitudes(found, query, archive),
        _ => {
            several("stations", |p| p.station.clone(), "ask for one station")?;
            rates(found, query, archive)
        }
    }
}

/// Passes of a file, and the channels that are wanted of each.
fn wanted<'a>(found: &'a Found, file: &str) -> Vec<(u32, Vec<&'a str>)> {
    let mut passes: Vec<(u32, Vec<&str>)> = Vec::new();
    for pass in found.passes.iter().filter(|p| p.file == file) {
        match passes.iter_mut().find(|(number, _)| *number == pass.pass) {
            Some((_, channels)) => channels.push(&pass.channel),
            None => passes.push((pass.pass, vec![&pass.channel])),
        }
    }
    passes
}

/// Places of a pass's samples in its file, in the order of time.
fn places(path: &Path, times: &[Epoch], pass: u32) -> Result<Vec<usize>, ArchiveError> {
    let place = (pass as usize).checked_sub(1);
    let part = place.and_then(|place| file::passes(times).into_iter().nth(place));
    part.ok_or_else(|| ArchiveError::Changed { path: path.to_path_buf(), pass })
}

/// Appends to a column that some files have: NaN for the rows of those that have none.
fn append(to: &mut Option<Vec<f64>>, from: Option<&Vec<f64>>, rows: &[usize], before: usize) {
    if to.is_none() && from.is_none() {
        return;
    }
    let column = to.get_or_insert_with(|| vec![f64::NAN; before]);
    column.extend(rows.iter().map(|i| from.map_or(f64::NAN, |v| v[*i])));
}

fn rates(found: &Found, query: &Query, archive: &Path) -> Result<Table, ArchiveError> {
    let names: BTreeSet<&str> = found.passes.iter().map(|p| p.channel.as_str()).collect();
    let empty = |name: &&str| ChannelCurve {
        name: (*name).to_owned(),
        rate_hz: Vec::new(),
        sigma_hz: Vec::new(),
        flags: Vec::new(),
        model_error_hz: Some(Vec::new()),
    };
    let mut all: Option<LightCurve> = None;
    let mut inputs = Vec::new();
    for name in found.files() {
        let path = archive.join(name);
        let bytes = read::bytes(&path)?;
        inputs.push(Input { file: name.to_owned(), sha256: sha256(&bytes) });
        let text = read::decode(&path, bytes)?;
        let curve = LightCurve::from_table(&path, &text_table::read_str(&path, &text)?)?;
        let joined = all.get_or_insert_with(|| LightCurve {
            kind: curve.kind,
            samples: Samples::default(),
            channels: names.iter().map(empty).collect(),
            provenance: Provenance::default(),
            other: curve.other.clone(),
        });
        // What only some of the files say is not said of all.
        joined.other.retain(|key, value| curve.other.get(key) == Some(value));
        for (pass, channels) in wanted(found, name) {
            let mut rows = places(&path, &curve.samples.time, pass)?;
            rows.retain(|i| {
                curve.samples.phase_deg.as_ref().is_none_or(|p| query.takes_phase(p[*i]))
            });
            add(joined, &curve, &rows, &channels);
        }
    }
    let Some(mut curve) = all else { return Err(apart("no pass meets the conditions")) };
    let first = &found.passes[0];
    curve.provenance = Provenance {
        program: concat!("sunglint ", env!("CARGO_PKG_VERSION")).into(),
        command: format!("archive {}", found.archive),
        station: first.station.clone(),
        target: first.target.clone(),
        inputs,
        notes: vec![format!("{} passes of an archive as one curve", count(found))],
        ..Provenance::default()
    };
    // No bound is known where one of the files states none.
    for channel in &mut curve.channels {
        let is_stated = |(e, flags): (&f64, &Flags)| e.is_finite() || !flags.is_empty();
        let errors = channel.model_error_hz.as_ref();
        if errors.is_some_and(|e| !e.iter().zip(&channel.flags).all(is_stated)) {
            channel.model_error_hz = None;
        }
    }
    // NaN in the geometry has no flag that says why: what only some files have is left out.
    let samples = &mut curve.samples;
    for column in [&mut samples.range_m, &mut samples.phase_deg, &mut samples.zenith_deg] {
        if column.as_ref().is_some_and(|c| c.iter().any(|v| v.is_nan())) {
            *column = None;
        }
    }
    if curve.is_empty() {
        return Err(apart("no sample of the passes is at such a phase angle"));
    }
    curve.sort();
    Ok(curve.to_table()?)
}

/// Number of passes, each counted once for all its channels.
fn count(found: &Found) -> usize {
    found.passes.iter().map(|p| (&p.file, p.pass)).collect::<BTreeSet<_>>().len()
}

fn add(to: &mut LightCurve, from: &LightCurve, rows: &[usize], channels: &[&str]) {
    let before = to.len();
    let (own, other) = (&mut to.samples, &from.samples);
    own.time.extend(rows.iter().map(|i| other.time[*i]));
    own.exposure_s.extend(rows.iter().map(|i| other.exposure_s[*i]));
    append(&mut own.range_m, other.range_m.as_ref(), rows, before);
    append(&mut own.phase_deg, other.phase_deg.as_ref(), rows, before);
    append(&mut own.zenith_deg, other.zenith_deg.as_ref(), rows, before);
    for channel in &mut to.channels {
        let source = from.channel(&channel.name).filter(|c| channels.contains(&c.name.as_str()));
        for i in rows {
            let (rate, sigma, flags) = source
                .map_or((f64::NAN, f64::NAN, Flags::NOT_SAMPLED), |c| {
                    (c.rate_hz[*i], c.sigma_hz[*i], c.flags[*i])
                });
            channel.rate_hz.push(rate);
            channel.sigma_hz.push(sigma);
            channel.flags.push(flags);
            if let Some(errors) = &mut channel.model_error_hz {
                let stated = source.and_then(|c| c.model_error_hz.as_ref());
                errors.push(stated.map_or(f64::NAN, |e| e[*i]));
            }
        }
    }
}

fn magnitudes(found: &Found, query: &Query, archive: &Path) -> Result<Table, ArchiveError> {
    struct Sample {
        time: Epoch,
        numbers: [f64; 5],
        session: String,
        filter: String,
    }
    let mut samples: Vec<Sample> = Vec::new();
    let mut inputs = Vec::new();
    for name in found.files() {
        let path = archive.join(name);
        let bytes = read::bytes(&path)?;
        inputs.push(Input { file: name.to_owned(), sha256: sha256(&bytes) });
        let import = photometry::import(&path, bytes, &ColumnNames::default())?;
        let filters = file::filters(&import);
        let read = import.samples;
        if read.is_relative {
            let more = "its magnitudes have no zero point: give the file itself to `analyse`";
            return Err(apart(format!("{}: {more}", path.display())));
        }
        for (pass, channels) in wanted(found, name) {
            let rows = places(&path, &read.time, pass)?;
            let takes = |i: &usize| {
                read.magnitude[*i].is_finite()
                    && channels.contains(&filters[*i].as_str())
                    && read.phase_deg.as_ref().is_none_or(|p| query.takes_phase(p[*i]))
            };
            for i in rows.into_iter().filter(takes) {
                let of = |column: &Option<Vec<f64>>| column.as_ref().map_or(f64::NAN, |v| v[i]);
                // Sessions of one name in two files are not one.
                let own = read.session.as_ref().map_or("", |s| s[i].as_str());
                let session =
                    if own.is_empty() { name.to_owned() } else { format!("{name}: {own}") };
                samples.push(Sample {
                    time: read.time[i],
                    numbers: [
                        read.magnitude[i],
                        of(&read.sigma_mag),
                        of(&read.exposure_s),
                        of(&read.range_km),
                        of(&read.phase_deg),
                    ],
                    session,
                    filter: filters[i].clone(),
                });
            }
        }
    }
    if samples.is_empty() {
        return Err(apart("no sample of the passes is at such a phase angle"));
    }
    samples.sort_by_key(|s| tai_nanoseconds(s.time));
    let mut columns = vec![Column::text(
        "time_utc",
        samples.iter().map(|s| format_utc_shortest(s.time)).collect(),
    )];
    let names = [
        ("magnitude", "mag"),
        ("sigma_mag", "mag"),
        ("exposure_s", "s"),
        ("range_km", "km"),
        ("phase_deg", "deg"),
    ];
    for (k, (name, unit)) in names.into_iter().enumerate() {
        let values: Vec<f64> = samples.iter().map(|s| s.numbers[k]).collect();
        // A column that only some files have would make the rows of the others useless.
        if values.iter().all(|v| v.is_finite()) {
            columns.push(Column::f64(name, Some(unit), values));
        }
    }
    columns.push(Column::text("session", samples.iter().map(|s| s.session.clone()).collect()));
    columns.push(Column::text("filter", samples.iter().map(|s| s.filter.clone()).collect()));
    let mut meta = Meta::default();
    let first = &found.passes[0];
    meta.insert("target".into(), first.target.clone().into());
    let provenance = Provenance {
        program: concat!("sunglint ", env!("CARGO_PKG_VERSION")).into(),
        command: format!("archive {}", found.archive),
        target: first.target.clone(),
        inputs,
        notes: vec![format!("{} passes of an archive as one table", count(found))],
        ..Provenance::default()
    };
    meta.insert("provenance".into(), provenance.to_json());
    Ok(Table { meta, columns })
}
