//! Passes of several files as one light curve, for programs and commands that read a curve.

use crate::file::{self, Kind};
use crate::query::{Pass, Query};
use crate::{ArchiveError, Found};
use hifitime::Epoch;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::Path;
use sunglint_formats::photometry::{self, ColumnNames, ObjectRows};
use sunglint_formats::time::{format_utc_shortest, tai_nanoseconds};
use sunglint_formats::{Column, Meta, Table, read, sha256, text_table};
use sunglint_radiometry::light_curve::{
    ChannelCurve, Flags, Input, LightCurve, Provenance, Samples,
};

fn apart(why: impl Into<String>) -> ArchiveError {
    ArchiveError::Apart { why: why.into() }
}

/// Passes of an archive as one table.
#[derive(Debug, Clone)]
pub struct Joined {
    /// A light curve, or a table of magnitudes.
    pub table: Table,
    /// Words for a person: samples that two files have.
    pub warnings: Vec<String>,
}

/// The light of passes as one table: a light curve of this program's schema where they are rates, a table of magnitudes where they are magnitudes. Samples whose
/// phase angle the question leaves out are not in it. A channel that a pass does not have is flagged `NOT_SAMPLED` there. A sample that two files have is taken
/// once, with a warning.
///
/// # Errors
/// [`ArchiveError::Apart`]: no pass; passes of several kinds, objects or stations; magnitudes without a zero point; two files with different light in one channel
/// at one time. [`ArchiveError::Changed`]; files that cannot be read.
pub fn join(found: &Found, query: &Query, archive: &Path) -> Result<Joined, ArchiveError> {
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
    one_object(&found.passes)?;
    match first.kind {
        Kind::Recorded => Err(apart("they are recorded, and not yet curves: reduce them first")),
        Kind::Magnitudes => magnitudes(found, query, archive),
        _ => {
            several("stations", |p| p.station.clone(), "ask for one station")?;
            rates(found, query, archive)
        }
    }
}

/// Refuses passes of several objects. Passes without a number are of the object that has one where they have its name, and no other number has.
fn one_object(passes: &[Pass]) -> Result<(), ArchiveError> {
    let numbers: BTreeSet<u32> = passes.iter().filter_map(|p| p.norad_id).collect();
    let names = |has_number: bool| -> BTreeSet<String> {
        let own = passes.iter().filter(|p| p.norad_id.is_some() == has_number);
        own.map(|p| p.target.to_lowercase()).collect()
    };
    let (numbered, named) = (names(true), names(false));
    let is_one = match numbers.len() {
        0 => named.len() == 1,
        1 => named.is_subset(&numbered),
        _ => false,
    };
    if is_one {
        return Ok(());
    }
    let mut all: Vec<String> = numbers.iter().map(ToString::to_string).collect();
    all.extend(named);
    let help = match numbers.is_empty() {
        true => "ask for one object",
        false => "ask for one by its number",
    };
    Err(apart(format!("they have several objects ({}): {help}", all.join(", "))))
}

/// Passes of a file by their numbers, and the channels that are wanted of each.
type Wanted<'a> = BTreeMap<u32, Vec<&'a str>>;

/// The files in the order of their first pass, and what is wanted of each.
fn wanted(found: &Found) -> Vec<(&str, Wanted<'_>)> {
    let mut files: Vec<(&str, Wanted<'_>)> = Vec::new();
    let mut places: HashMap<&str, usize> = HashMap::new();
    for pass in &found.passes {
        let place = *places.entry(&pass.file).or_insert_with(|| {
            files.push((&pass.file, Wanted::new()));
            files.len() - 1
        });
        files[place].1.entry(pass.pass).or_default().push(&pass.channel);
    }
    files
}

/// Samples of a file in passes, which [`file::passes`] parts.
struct Parted<'a> {
    path: &'a Path,
    passes: Vec<Vec<usize>>,
}

impl<'a> Parted<'a> {
    fn new(path: &'a Path, times: &[Epoch]) -> Self {
        Self { path, passes: file::passes(times) }
    }

    /// Places of a pass's samples in its file, in the order of time.
    fn places(&self, pass: u32) -> Result<&[usize], ArchiveError> {
        let place = (pass as usize).checked_sub(1);
        let part = place.and_then(|place| self.passes.get(place)).map(Vec::as_slice);
        part.ok_or_else(|| ArchiveError::Changed { path: self.path.to_path_buf(), pass })
    }
}

/// Samples that were taken, by channel and time, to see which of them another file has, too.
#[derive(Default)]
struct Taken {
    /// The file's place in `files`, and the bits of the sample's numbers; the channel by its place in `channels`.
    samples: HashMap<(usize, i128), (usize, [u64; 5])>,
    channels: Vec<String>,
    files: Vec<String>,
    /// Samples that two files have, by these files' places.
    twice: BTreeMap<(usize, usize), usize>,
}

impl Taken {
    /// The next file's samples follow.
    fn begin(&mut self, file: &str) {
        self.files.push(file.to_owned());
    }

    /// Whether a sample of the file that was begun last is new. Two of one time within one file are that file's own matter.
    ///
    /// # Errors
    /// Another file has other light at this time in this channel.
    fn is_new(
        &mut self,
        channel: &str,
        time: Epoch,
        numbers: [f64; 5],
    ) -> Result<bool, ArchiveError> {
        let file = self.files.len().saturating_sub(1);
        let bits = numbers.map(f64::to_bits);
        let place = self.channels.iter().position(|name| name == channel).unwrap_or_else(|| {
            self.channels.push(channel.to_owned());
            self.channels.len() - 1
        });
        let key = (place, tai_nanoseconds(time));
        let Some((other, known)) = self.samples.get(&key) else {
            self.samples.insert(key, (file, bits));
            return Ok(true);
        };
        if *other == file {
            return Ok(true);
        }
        if *known != bits {
            return Err(apart(format!(
                "{} and {} both have light of the channel `{channel}` at {}, and it differs: it would count twice; move one of them out of the archive, or ask for another time",
                self.files[*other],
                self.files[file],
                format_utc_shortest(time)
            )));
        }
        *self.twice.entry((*other, file)).or_default() += 1;
        Ok(false)
    }

    fn warnings(&self) -> Vec<String> {
        let text = |((one, other), count): (&(usize, usize), &usize)| {
            let (one, other) = (&self.files[*one], &self.files[*other]);
            format!("{one} and {other} have {count} samples in common: each counts once")
        };
        self.twice.iter().map(text).collect()
    }
}

/// Appends to a column that some files have: NaN for the rows of those that have none.
fn append(to: &mut Option<Vec<f64>>, from: Option<&Vec<f64>>, rows: &[usize], before: usize) {
    if to.is_none() && from.is_none() {
        return;
    }
    let column = to.get_or_insert_with(|| vec![f64::NAN; before]);
    column.extend(rows.iter().map(|i| from.map_or(f64::NAN, |v| v[*i])));
}

fn rates(found: &Found, query: &Query, archive: &Path) -> Result<Joined, ArchiveError> {
    let names: BTreeSet<&str> = found.passes.iter().map(|p| p.channel.as_str()).collect();
    let empty = |name: &&str| ChannelCurve {
        name: (*name).to_owned(),
        rate_hz: Vec::new(),
        sigma_hz: Vec::new(),
        flags: Vec::new(),
        model_error_hz: Some(Vec::new()),
        // Each pass has an error of its own, and a column has one for all.
        common_sigma_hz: None,
    };
    let mut all: Option<LightCurve> = None;
    let mut inputs = Vec::new();
    let mut taken = Taken::default();
    for (name, passes) in wanted(found) {
        let path = archive.join(name);
        let bytes = read::bytes_of_text(&path)?;
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
        taken.begin(name);
        let parted = Parted::new(&path, &curve.samples.time);
        for (pass, channels) in passes {
            let mut rows = parted.places(pass)?.to_vec();
            rows.retain(|i| {
                curve.samples.phase_deg.as_ref().is_none_or(|p| query.takes_phase(p[*i]))
            });
            add(joined, &curve, &rows, &channels, &mut taken)?;
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
    Ok(Joined { table: curve.to_table()?, warnings: taken.warnings() })
}

/// Number of passes, each counted once for all its channels.
fn count(found: &Found) -> usize {
    found.passes.iter().map(|p| (&p.file, p.pass)).collect::<BTreeSet<_>>().len()
}

/// Appends samples of a file to a curve, and those channels of each that no file before had. Where it had all, there is no row.
fn add(
    to: &mut LightCurve,
    from: &LightCurve,
    rows: &[usize],
    channels: &[&str],
    taken: &mut Taken,
) -> Result<(), ArchiveError> {
    let before = to.len();
    let sources: Vec<Option<&ChannelCurve>> = to
        .channels
        .iter()
        .map(|own| from.channel(&own.name).filter(|c| channels.contains(&c.name.as_str())))
        .collect();
    let mut kept = Vec::with_capacity(rows.len());
    for i in rows {
        let mut news: Vec<Option<&ChannelCurve>> = Vec::with_capacity(sources.len());
        let mut is_double = false;
        for source in &sources {
            let Some(channel) = source.filter(|c| !c.flags[*i].contains(Flags::NOT_SAMPLED)) else {
                news.push(*source);
                continue;
            };
            let numbers = [
                channel.rate_hz[*i],
                channel.sigma_hz[*i],
                f64::from(channel.flags[*i].bits()),
                channel.model_error_hz.as_ref().map_or(f64::NAN, |e| e[*i]),
                from.samples.exposure_s[*i],
            ];
            let is_new = taken.is_new(&channel.name, from.samples.time[*i], numbers)?;
            is_double |= !is_new;
            news.push(is_new.then_some(channel));
        }
        let is_sampled = |c: &Option<&ChannelCurve>| {
            c.is_some_and(|c| !c.flags[*i].contains(Flags::NOT_SAMPLED))
        };
        if is_double && !news.iter().any(is_sampled) {
            continue;
        }
        kept.push(*i);
        for (channel, source) in to.channels.iter_mut().zip(news) {
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
    let (own, other) = (&mut to.samples, &from.samples);
    own.time.extend(kept.iter().map(|i| other.time[*i]));
    own.exposure_s.extend(kept.iter().map(|i| other.exposure_s[*i]));
    append(&mut own.range_m, other.range_m.as_ref(), &kept, before);
    append(&mut own.phase_deg, other.phase_deg.as_ref(), &kept, before);
    append(&mut own.zenith_deg, other.zenith_deg.as_ref(), &kept, before);
    Ok(())
}

fn magnitudes(found: &Found, query: &Query, archive: &Path) -> Result<Joined, ArchiveError> {
    struct Sample {
        time: Epoch,
        numbers: [f64; 5],
        session: String,
        filter: String,
    }
    let mut samples: Vec<Sample> = Vec::new();
    let mut inputs = Vec::new();
    let mut taken = Taken::default();
    for (name, passes) in wanted(found) {
        let path = archive.join(name);
        let bytes = read::bytes_of_text(&path)?;
        inputs.push(Input { file: name.to_owned(), sha256: sha256(&bytes) });
        let import = photometry::import(&path, bytes, &ColumnNames::default(), &ObjectRows::One)?;
        let filters = file::filters(&import);
        let read = import.samples;
        if read.is_relative {
            let more = "its magnitudes have no zero point: give the file itself to `analyse`";
            return Err(apart(format!("{}: {more}", path.display())));
        }
        taken.begin(name);
        let parted = Parted::new(&path, &read.time);
        for (pass, channels) in passes {
            let rows = parted.places(pass)?;
            let takes = |i: &usize| {
                read.magnitude[*i].is_finite()
                    && channels.contains(&filters[*i].as_str())
                    && read.phase_deg.as_ref().is_none_or(|p| query.takes_phase(p[*i]))
            };
            for i in rows.iter().copied().filter(takes) {
                let of = |column: &Option<Vec<f64>>| column.as_ref().map_or(f64::NAN, |v| v[i]);
                let numbers = [
                    read.magnitude[i],
                    of(&read.sigma_mag),
                    of(&read.exposure_s),
                    of(&read.range_km),
                    of(&read.phase_deg),
                ];
                // Range and phase angle are no measurement: another program may have added them to one of the files.
                let light = [numbers[0], numbers[1], numbers[2], f64::NAN, f64::NAN];
                if !taken.is_new(&filters[i], read.time[i], light)? {
                    continue;
                }
                // Sessions of one name in two files are not one.
                let own = read.session.as_ref().map_or("", |s| s[i].as_str());
                let session =
                    if own.is_empty() { name.to_owned() } else { format!("{name}: {own}") };
                samples.push(Sample {
                    time: read.time[i],
                    numbers,
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
    Ok(Joined { table: Table { meta, columns }, warnings: taken.warnings() })
}
