//! Magnitudes with their times as other programs write them: MMT-9's text, ALCDEF, CCSDS TDM (KVN and XML), EOSSA's FITS tables, DAMIT's light curves; and tables of named columns (ECSV, CSV, words between blanks,
//! FITS, VOTable) with their times as UTC, as Julian dates with their scale, or since an origin that the file states.
//!
//! A reader here knows the grammar of a format and keeps what it says: nothing is corrected, no time scale is guessed.
//!
//! - [`open`]: the samples or the table of a file, by its content; [`recognise`], [`read_str`]: the same of texts alone;
//! - [`import`]: what a file says, as far as it is understood;
//! - [`column_times`], [`ColumnNames`]: times and values of a table with named columns.
//!
//! MMT-9: [`Format::Mmt9`], as the catalogue of Mini-MegaTORTORA exports tracks. ALCDEF: *Asteroid Lightcurve Data Exchange Format* 2.1.1 (Stephens and Warner, 2015). TDM: CCSDS 503.0-B-2,
//! *Tracking Data Message*, of which magnitudes (`MAG`) are read.

mod columns;
mod damit;
mod import;
mod missing;
mod objects;
mod tables;
mod votable_binary;
mod words;
pub mod write;
mod xml;

pub use crate::time::{Scale, moment};
pub use columns::{
    ColumnNames, ColumnTimes, Exposures, TIME_COLUMNS, TimeFormat, UNKNOWN, ZERO_POINT,
    column_times, exposures, filter_column, without_signs_of_fluxes,
};
pub use import::{Import, ImportError, import};
pub use missing::{without_false_uncertainties, without_words_for_none};
pub use objects::{ObjectRows, ObjectsError, TakenRows};

use crate::kind::{self, Kind};
use crate::text::{counted, listed};
use crate::time::{parse_in, parse_utc};
use crate::{ParseError, Table, Values};
use hifitime::{Duration, Epoch};
use std::collections::BTreeMap;
use std::path::Path;

const DAY_S: f64 = 86_400.0;
/// JD of MJD 0, whole days and the half that is left.
const MJD_OFFSET: i64 = 2_400_000;

/// A format that is known by its text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Format {
    /// Text of the catalogue of Mini-MegaTORTORA.
    Mmt9,
    /// Asteroid light curves.
    Alcdef,
    /// Tracking data message, keyword = value.
    TdmKvn,
    /// Tracking data message, XML.
    TdmXml,
    /// Electro-optical space situational awareness: a FITS table.
    Eossa,
}

impl Format {
    /// Name for people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mmt9 => "MMT-9 text",
            Self::Alcdef => "ALCDEF",
            Self::TdmKvn => "CCSDS TDM (KVN)",
            Self::TdmXml => "CCSDS TDM (XML)",
            Self::Eossa => "EOSSA (FITS)",
        }
    }
}

/// Samples of one file, in its order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Photometry {
    /// Times, mid-exposure.
    pub time: Vec<Epoch>,
    /// Magnitudes, apparent where the file does not say otherwise.
    pub magnitude: Vec<f64>,
    /// Magnitudes at 1000 km and a phase angle of 90°, where the file has them.
    pub standard: Option<Vec<f64>>,
    /// Standard uncertainties, mag; NaN where a row has none.
    pub sigma_mag: Option<Vec<f64>>,
    /// Fluxes in the file's unit, where it has them in place of magnitudes. Those of 0 or below are data, too, and have no magnitude.
    pub flux: Option<Vec<f64>>,
    /// Standard uncertainties of the fluxes; NaN where a row has none.
    pub sigma_flux: Option<Vec<f64>>,
    /// Ranges, km.
    pub range_km: Option<Vec<f64>>,
    /// Phase angles, degrees.
    pub phase_deg: Option<Vec<f64>>,
    /// Exposures, s.
    pub exposure_s: Option<Vec<f64>>,
    /// Sessions: magnitudes of one share a zero point.
    pub session: Option<Vec<String>>,
    /// Filters.
    pub filter: Option<Vec<String>>,
    /// Cameras of an instrument that has several: each may have a zero point of its own.
    pub camera: Option<Vec<String>>,
    /// Whether the target was in the Earth's shadow or penumbra, where the file says it.
    pub eclipsed: Option<Vec<bool>>,
    /// Whether the zero point is unknown: differences alone mean something.
    pub is_relative: bool,
    /// Name of the target; may be empty.
    pub target: String,
    /// Statements of the file that change what its numbers mean, in words.
    pub notes: Vec<String>,
    /// Numbers of the file that cannot be what they stand for, and what became of them.
    pub warnings: Vec<String>,
}

impl Photometry {
    /// Keeps the rows for which `keep` is true.
    fn retain(&mut self, keep: &[bool]) {
        fn pick<T>(keep: &[bool], values: &mut Vec<T>) {
            let mut row = keep.iter();
            values.retain(|_| row.next().copied().unwrap_or(false));
        }
        pick(keep, &mut self.time);
        pick(keep, &mut self.magnitude);
        let numbers = [
            &mut self.standard,
            &mut self.sigma_mag,
            &mut self.flux,
            &mut self.sigma_flux,
            &mut self.range_km,
            &mut self.phase_deg,
            &mut self.exposure_s,
        ];
        numbers.into_iter().flatten().for_each(|values| pick(keep, values));
        let texts = [&mut self.session, &mut self.filter, &mut self.camera];
        texts.into_iter().flatten().for_each(|values| pick(keep, values));
        self.eclipsed.iter_mut().for_each(|values| pick(keep, values));
    }

    /// Number of samples that another one is the same as: time, magnitude, range, phase angle, session, filter and camera.
    fn repeated(&self) -> usize {
        let number = |c: &Option<Vec<f64>>, i: usize| c.as_ref().map(|c| c[i].to_bits());
        let mut seen = std::collections::HashSet::new();
        let is_again = |i: &usize| {
            let text = |c: &Option<Vec<String>>| c.as_ref().map(|c| c[*i].clone());
            let numbers = [&self.range_km, &self.phase_deg, &self.flux].map(|c| number(c, *i));
            let texts = [text(&self.session), text(&self.filter), text(&self.camera)];
            let time = crate::time::tai_nanoseconds(self.time[*i]);
            !seen.insert((time, self.magnitude[*i].to_bits(), numbers, texts))
        };
        (0..self.time.len()).filter(is_again).count()
    }
}

/// Texts of a column of a table, whatever kind it is of; `None` where there is no such column, or one of vectors or truth values.
pub fn texts(table: &Table, name: &str) -> Option<Vec<String>> {
    Some(match &table.column(name).ok()?.values {
        Values::Text(texts) => texts.iter().map(|t| t.clone().unwrap_or_default()).collect(),
        Values::F64(numbers) => numbers.iter().map(f64::to_string).collect(),
        Values::I64(numbers) => {
            numbers.iter().map(|n| n.map(|n| n.to_string()).unwrap_or_default()).collect()
        }
        _ => return None,
    })
}

/// Content of a file of photometry.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// Samples of a format that says what they are.
    Samples(Format, Box<Photometry>),
    /// A table of named columns, and the words for what it came from.
    Table(&'static str, Box<Table>),
}

/// Opens a file of photometry by its content, never by its name: a known format, or a table in ECSV, CSV, FITS (first binary table) or VOTable, or DAMIT's light curves. Files packed with gzip are unpacked.
///
/// # Errors
/// Bytes that are none of these; what a format does not allow, with its place; a table without a row.
pub fn open(path: impl AsRef<Path>, bytes: Vec<u8>) -> Result<Source, ParseError> {
    open_named(path, bytes, &[])
}

/// The same with names for the columns of a text without a line of names; none: such a text is refused.
///
/// # Errors
/// The errors of [`open`]; another number of names than the rows have values; names for a file that has its own.
pub fn open_named(
    path: impl AsRef<Path>,
    bytes: Vec<u8>,
    columns: &[String],
) -> Result<Source, ParseError> {
    open_named_at(path.as_ref(), bytes, columns)
}

fn open_named_at(path: &Path, bytes: Vec<u8>, columns: &[String]) -> Result<Source, ParseError> {
    let source = opened(path, bytes, columns)?;
    if !columns.is_empty() && !matches!(source, Source::Table(words::CSV | words::TEXT, _)) {
        let found = "a format whose columns have names";
        let error = ParseError::new(path, found, "a text without a line of names");
        return Err(error.with_hint("leave out --columns"));
    }
    match &source {
        // A light curve of our own without samples is refused by those who need some.
        Source::Table(name, table) if table.rows() == 0 && !table.meta.contains_key("quantity") => {
            let names: Vec<&str> = table.columns.iter().map(|c| c.name.as_str()).collect();
            let found = format!("{name} with 0 rows below the names {}", listed(names));
            Err(ParseError::new(path, found, "a row for each sample"))
        }
        _ => Ok(source),
    }
}

fn opened(path: &Path, bytes: Vec<u8>, columns: &[String]) -> Result<Source, ParseError> {
    let most = (64_u64 << 20).max(bytes.len() as u64 * 256);
    let bytes = crate::fits::inflate(path, bytes, most)?;
    let another =
        |kind: Kind| Err(kind.in_place_of(path, "a light curve: a table of rates or magnitudes"));
    match kind::of_bytes(&bytes) {
        Some(Kind::FitsTable) => return tables::of_fits(path, bytes),
        Some(kind) => return another(kind),
        None => {}
    }
    let (text, note) = words::decode(path, bytes)?;
    if let Some(format) = recognise(&text) {
        let mut read = read_str(path, &text, format)?;
        read.notes.extend(note);
        return Ok(Source::Samples(format, Box::new(read)));
    }
    if let Some(kind) = kind::of(text.as_bytes())
        && !matches!(kind, Kind::LightCurve | Kind::Table)
    {
        return another(kind);
    }
    if xml::is_votable(&text) {
        let mut table = xml::votable(path, &text)?;
        tables::without_untimed_rows(&mut table);
        return Ok(Source::Table("VOTable", Box::new(table)));
    }
    if xml::is_xml(&text) {
        let expected = "a VOTable or a tracking data message, if it is XML";
        return Err(ParseError::new(path, "XML of another kind", expected));
    }
    if text.starts_with("# %ECSV") {
        let mut table = crate::text_table::read_str(path, &text)?;
        // Our own curves are whole, or damaged.
        if table.meta_text("quantity").is_none() {
            tables::without_untimed_rows(&mut table);
        }
        return Ok(Source::Table("ECSV", Box::new(table)));
    }
    // Names that are given say what numbers are.
    let known = if columns.is_empty() { damit::read(path, &text) } else { None };
    let (name, mut table) = match known {
        Some(table) => ("DAMIT's light curves", table?),
        None => words::read(path, &text, columns)?,
    };
    if let Some(note) = note {
        let notes =
            table.meta.entry(words::READING_NOTES).or_insert_with(|| Vec::<String>::new().into());
        notes.as_array_mut().into_iter().for_each(|notes| notes.push(note.clone().into()));
    }
    Ok(Source::Table(name, Box::new(table)))
}

/// Returns the format of a text, where it is one of these.
pub fn recognise(text: &str) -> Option<Format> {
    let head = || text.lines().take(60).map(str::trim);
    if head().any(|l| l.starts_with('#') && l.contains("StdMag Mag")) {
        return Some(Format::Mmt9);
    }
    if head().any(|l| l.eq_ignore_ascii_case("STARTMETADATA")) {
        return Some(Format::Alcdef);
    }
    if xml::is_tdm(text) {
        return Some(Format::TdmXml);
    }
    let is_tdm = |l: &str| l.split_once('=').is_some_and(|(key, _)| key.trim() == "CCSDS_TDM_VERS");
    head().any(is_tdm).then_some(Format::TdmKvn)
}

/// Reads a text of a format.
///
/// # Errors
/// A line that the format does not know, a value that is none, a time scale that is not known; no magnitude.
///
/// ```
/// use sunglint_formats::photometry::{Format, read_str, recognise};
///
/// let text = "STARTMETADATA\nDELIMITER=PIPE\nFILTER=C\nMAGBAND=V\nLTCAPP=NONE\nENDMETADATA\nDATA=2457000.5|14.25|0.01\nENDDATA\n";
/// assert_eq!(recognise(text), Some(Format::Alcdef));
/// let read = read_str("curve.txt", text, Format::Alcdef)?;
/// assert_eq!((read.magnitude[0], read.time[0].to_string().as_str()), (14.25, "2014-12-09T00:00:35 TAI"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn read_str(
    path: impl AsRef<Path>,
    text: &str,
    format: Format,
) -> Result<Photometry, ParseError> {
    read_str_at(path.as_ref(), text, format)
}

fn read_str_at(path: &Path, text: &str, format: Format) -> Result<Photometry, ParseError> {
    let read = match format {
        Format::Mmt9 => mmt9(path, text)?,
        Format::Alcdef => alcdef(path, text)?,
        Format::TdmKvn => tdm(path, text)?,
        Format::TdmXml => xml::tdm(path, text)?,
        Format::Eossa => {
            return Err(ParseError::new(path, "a text", "a FITS file"));
        }
    };
    if read.time.is_empty() {
        return Err(ParseError::new(path, "no magnitude", format!("samples of {}", format.name())));
    }
    Ok(read)
}

/// The moment of a Julian date as a text, all digits of which count.
fn of_julian_text(text: &str, scale: Scale) -> Option<Epoch> {
    let (whole, part) = text.split_once('.').unwrap_or((text, "0"));
    if whole.is_empty() || ![whole, part].iter().all(|d| d.bytes().all(|b| b.is_ascii_digit())) {
        return None;
    }
    let part: f64 = format!("0.{part}").parse().ok()?;
    moment(whole.parse::<i64>().ok()?.checked_sub(MJD_OFFSET + 1)?, part + 0.5, scale)
}

/// Text of MMT-9: notes after `#`, then date, time, standard magnitude, magnitude, filter, penumbra, distance (km), phase (degrees), channel, track.
fn mmt9(path: &Path, text: &str) -> Result<Photometry, ParseError> {
    let (mut standard, mut ranges, mut phases, mut filter) = (vec![], vec![], vec![], vec![]);
    let (mut camera, mut eclipsed) = (Vec::new(), Vec::new());
    let mut read = Photometry::default();
    for (number, line) in text.lines().enumerate() {
        if line.starts_with('#') || line.trim().is_empty() {
            continue;
        }
        let fields: Vec<&str> = line.split_whitespace().collect();
        let wrong = |found: String, expected: &str| {
            ParseError::new(path, found, expected).at_line(number as u64 + 1)
        };
        // Files of one track have no number of it.
        if fields.len() < 9 {
            let expected = "date, time, StdMag, Mag, filter, penumbra, distance, phase, channel, and the track where there are several";
            return Err(wrong(format!("{} fields", fields.len()), expected));
        }
        let value = |k: usize, what: &str| {
            fields[k].parse::<f64>().map_err(|_| wrong(format!("`{}`", fields[k]), what))
        };
        let time = parse_utc(&format!("{}T{}", fields[0], fields[1]))
            .map_err(|e| e.in_file(path).at_line(number as u64 + 1))?;
        read.time.push(time);
        standard.push(value(2, "a magnitude")?);
        read.magnitude.push(value(3, "a magnitude")?);
        ranges.push(value(6, "a distance, km")?);
        phases.push(value(7, "a phase angle, degrees")?);
        filter.push(fields[4].to_owned());
        eclipsed.push(value(5, "a number of the penumbra, 0 for sunlight")? != 0.0);
        camera.push(fields[8].to_owned());
    }
    read.standard = Some(standard);
    read.range_km = Some(ranges);
    read.phase_deg = Some(phases);
    read.filter = Some(filter);
    read.camera = Some(camera);
    read.eclipsed = Some(eclipsed);
    Ok(read)
}

/// Blocks of metadata and data lines.
fn alcdef(path: &Path, text: &str) -> Result<Photometry, ParseError> {
    enum Part {
        Between,
        Metadata,
        Data,
    }
    let mut read = Photometry::default();
    let (mut sessions, mut filters, mut sigma) = (Vec::new(), Vec::new(), Vec::new());
    let mut part = Part::Between;
    let mut meta: BTreeMap<String, String> = BTreeMap::new();
    let mut number_of_session = 0;
    let mut to_middle_s = 0.0;
    let mut numbered: Option<String> = None;
    // Samples without a magnitude, and the line of the first.
    let mut lost: (usize, usize) = (0, 0);
    for (number, line) in text.lines().enumerate() {
        let line = line.trim();
        let wrong = |found: String, expected: &str| {
            ParseError::new(path, found, expected).at_line(number as u64 + 1)
        };
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let upper = line.to_ascii_uppercase();
        match (&part, upper.as_str()) {
            (_, "STARTMETADATA") => {
                meta.clear();
                to_middle_s = 0.0;
                number_of_session += 1;
                part = Part::Metadata;
                continue;
            }
            (Part::Metadata, "ENDMETADATA") => {
                let light_time = meta.get("LTCAPP").map(|v| v.to_ascii_uppercase());
                let mut note = |text: &str| {
                    if !read.notes.iter().any(|n| n == text) {
                        read.notes.push(text.to_owned());
                    }
                };
                match light_time.as_deref() {
                    Some("AVERAGE" | "POINT") => {
                        note("LTCAPP: the light's way to the observer is taken off the times")
                    }
                    Some("NONE") | None => {}
                    Some(other) => {
                        return Err(wrong(format!("LTCAPP={other}"), "NONE, AVERAGE or POINT"));
                    }
                }
                if meta.get("REDUCEDMAGS").is_some_and(|v| !v.eq_ignore_ascii_case("NONE")) {
                    note(
                        "REDUCEDMAGS: the distances to Sun and observer are taken off the magnitudes",
                    );
                }
                if meta.get("DIFFERMAGS").is_some_and(|v| v.eq_ignore_ascii_case("TRUE")) {
                    read.is_relative = true;
                    note(
                        "DIFFERMAGS: magnitudes are differences from comparison stars: zero points are unknown",
                    );
                }
                let at = meta.get("EXPJD").map(|v| v.to_ascii_uppercase());
                to_middle_s = match at.as_deref() {
                    Some("MID") | None | Some("") => 0.0,
                    Some(at @ ("START" | "END")) => {
                        let stated = meta.get("EXPOSURE").and_then(|e| e.parse::<f64>().ok());
                        match stated.filter(|s| s.is_finite() && *s > 0.0) {
                            Some(exposure) if at == "START" => 0.5 * exposure,
                            Some(exposure) => -0.5 * exposure,
                            None => {
                                note(
                                    "EXPJD: times are not those of mid-exposure, and no EXPOSURE says by how much",
                                );
                                0.0
                            }
                        }
                    }
                    // Other words stand in files that real programs write (`NONE`).
                    Some(other) => {
                        let other = shortened(other);
                        note(&format!(
                            "EXPJD={other}: which moment of the exposure the times are is not known; they are taken for the middle"
                        ));
                        0.0
                    }
                };
                if to_middle_s != 0.0 {
                    note("EXPJD: half of the exposure makes the times those of mid-exposure");
                }
                let named = meta.get("OBJECTNAME").filter(|n| !n.is_empty());
                let number = meta.get("OBJECTNUMBER").filter(|n| !n.is_empty() && *n != "0");
                if let Some(name) = named.filter(|name| {
                    let same_number = number.is_some() && numbered == number.cloned();
                    !read.target.is_empty() && **name != read.target && !same_number
                }) {
                    let found =
                        format!("OBJECTNAME={} after {}", shortened(name), shortened(&read.target));
                    let error = wrong(found, "blocks of one object");
                    return Err(error.with_hint("give each object a file of its own"));
                }
                if numbered.is_none() {
                    numbered = number.cloned();
                }
                if let (true, Some(name)) = (read.target.is_empty(), named) {
                    read.target.clone_from(name);
                }
                part = Part::Between;
                continue;
            }
            (_, "ENDDATA") => {
                part = Part::Between;
                continue;
            }
            _ => {}
        }
        let Some((key, value)) = line.split_once('=') else {
            return Err(wrong(format!("`{}`", shortened(line)), "KEY=VALUE"));
        };
        let (key, value) = (key.trim().to_ascii_uppercase(), value.trim());
        if let Part::Metadata = part {
            meta.insert(key, value.to_owned());
            continue;
        }
        if key != "DATA" {
            // Standard 2.1: comments may stand between the blocks.
            if key.starts_with("COMMENT") {
                continue;
            }
            return Err(wrong(
                format!("`{}`", shortened(&key)),
                "STARTMETADATA, DATA=… or ENDDATA",
            ));
        }
        if number_of_session == 0 {
            return Err(wrong("DATA before any STARTMETADATA".into(), "metadata first"));
        }
        part = Part::Data;
        let delimiter = match meta.get("DELIMITER").map(|d| d.to_ascii_uppercase()).as_deref() {
            Some("PIPE") => '|',
            Some("TAB") => '\t',
            Some(other) => {
                return Err(wrong(format!("DELIMITER={}", shortened(other)), "PIPE or TAB"));
            }
            None => {
                return Err(wrong("no DELIMITER in the metadata".into(), "DELIMITER=PIPE or TAB"));
            }
        };
        let fields: Vec<&str> = value.split(delimiter).map(str::trim).collect();
        let [day, magnitude, others @ ..] = fields.as_slice() else {
            return Err(wrong(
                format!("{} field", fields.len()),
                "JD, magnitude and perhaps error and airmass",
            ));
        };
        let time = of_julian_text(day, Scale::Utc).ok_or_else(|| {
            wrong(format!("`{}`", shortened(day)), "a Julian date (UT) from 1972 to 2100")
        })?;
        let finite = |text: &str, what: &str| match text.parse::<f64>() {
            Ok(v) if v.is_finite() => Ok(v),
            _ => Err(wrong(format!("`{}`", shortened(text)), what)),
        };
        let adjust = match meta.get("MAGADJUST").filter(|a| !a.is_empty()) {
            Some(text) => finite(text, "MAGADJUST, mag")?,
            None => 0.0,
        };
        if words::is_missing(magnitude) {
            lost = (lost.0 + 1, if lost.0 == 0 { number + 1 } else { lost.1 });
            continue;
        }
        read.time.push(time + Duration::from_seconds(to_middle_s));
        read.magnitude.push(finite(magnitude, "a magnitude")? + adjust);
        sigma.push(match others.first().filter(|e| !e.is_empty()) {
            Some(text) if words::is_missing(text) => f64::NAN,
            Some(text) => finite(text, "an uncertainty, mag")?,
            None => f64::NAN,
        });
        let date = meta.get("SESSIONDATE").map_or("", String::as_str);
        sessions.push(format!("{number_of_session} {date}").trim_end().to_owned());
        let band = meta.get("MAGBAND").or_else(|| meta.get("FILTER"));
        filters.push(band.cloned().unwrap_or_default());
    }
    if lost.0 > 0 {
        let words = format!("{} without a magnitude", counted(lost.0, "sample"));
        if lost.0 > read.time.len() {
            let error = ParseError::new(path, words, "magnitudes in most of its lines");
            return Err(error.at_line(lost.1 as u64));
        }
        read.notes.push(format!("{words} left out (the first in line {})", lost.1));
    }
    if matches!(part, Part::Data) && !text.ends_with(['\n', '\r']) {
        let line = text.lines().count();
        let note = format!(
            "line {line} has no end, and no ENDDATA follows: where the file was cut there, its last magnitude is wrong"
        );
        read.notes.push(note);
    }
    if sigma.iter().any(|s: &f64| *s > 0.0) {
        read.sigma_mag = Some(sigma);
    }
    read.session = Some(sessions);
    read.filter = Some(filters);
    Ok(read)
}

fn shortened(text: &str) -> String {
    text.chars().take(40).collect()
}

/// Magnitudes of the segments of a tracking data message.
fn tdm(path: &Path, text: &str) -> Result<Photometry, ParseError> {
    #[derive(PartialEq)]
    enum Part {
        Header,
        Metadata,
        Data,
    }
    let mut message = Message::default();
    let mut part = Part::Header;
    for (number, line) in text.lines().enumerate() {
        let line = line.trim();
        let wrong = |found: String, expected: &str| {
            ParseError::new(path, found, expected).at_line(number as u64 + 1)
        };
        if line.is_empty() || line.split_whitespace().next() == Some("COMMENT") {
            continue;
        }
        match line {
            "META_START" => {
                message.meta.clear();
                part = Part::Metadata;
                continue;
            }
            "META_STOP" | "DATA_STOP" => {
                part = Part::Header;
                continue;
            }
            "DATA_START" => {
                part = Part::Data;
                continue;
            }
            _ => {}
        }
        let Some((key, value)) = line.split_once('=') else {
            return Err(wrong(format!("`{}`", shortened(line)), "KEY = VALUE"));
        };
        let (key, value) = (key.trim(), value.trim());
        if part != Part::Data {
            message.meta.insert(key.to_owned(), value.to_owned());
            continue;
        }
        let mut words = value.split_whitespace();
        let (Some(epoch), Some(number), None) = (words.next(), words.next(), words.next()) else {
            if key != "MAG" {
                message.skip(key);
                continue;
            }
            return Err(wrong(format!("`{}`", shortened(value)), "an epoch and a magnitude"));
        };
        message.datum(key, epoch, number).map_err(|(found, expected)| wrong(found, expected))?;
    }
    Ok(message.finish())
}

/// A tracking data message as it is read.
#[derive(Default)]
struct Message {
    /// Metadata of the segment.
    meta: BTreeMap<String, String>,
    read: Photometry,
    exposures: Vec<Option<f64>>,
    /// Values of other keys, and how many.
    beside: BTreeMap<String, usize>,
}

impl Message {
    fn skip(&mut self, key: &str) {
        *self.beside.entry(shortened(key)).or_default() += 1;
    }

    /// Takes a value of the segment's data; else gives what was found and what was expected.
    fn datum(&mut self, key: &str, epoch: &str, value: &str) -> Result<(), (String, &'static str)> {
        if key != "MAG" {
            self.skip(key);
            return Ok(());
        }
        let meta = &self.meta;
        let name = meta.get("TIME_SYSTEM").map_or("", String::as_str);
        // What the message says besides its numbers.
        let mut said: Vec<String> = Vec::new();
        let scale = match name {
            "UT1" => {
                said.push("TIME_SYSTEM = UT1: taken as UTC, from which it is up to 0.9 s".into());
                Scale::Utc
            }
            _ => Scale::named(name).ok_or_else(|| {
                let found = format!("TIME_SYSTEM `{}`", shortened(name));
                (found, "UTC, UT1, TAI, TT, TDB or GPS")
            })?,
        };
        let time = parse_in(epoch, scale).map_err(|_| {
            (
                format!("`{}`", shortened(epoch)),
                "an epoch such as 2005-06-30T12:00:00.5 or 2005-181T12:00:00.5, 1972 to 2100",
            )
        })?;
        let exposure = match meta.get("INTEGRATION_INTERVAL") {
            Some(text) => text.parse::<f64>().ok().filter(|s| s.is_finite() && *s > 0.0),
            None => None,
        };
        let shift_s = match (meta.get("INTEGRATION_REF").map(String::as_str), exposure) {
            (Some("START"), Some(s)) => 0.5 * s,
            (Some("END"), Some(s)) => -0.5 * s,
            (Some("START" | "END"), None) => {
                let found = "INTEGRATION_REF without INTEGRATION_INTERVAL".to_owned();
                return Err((found, "how long a sample took, s"));
            }
            _ => 0.0,
        };
        let magnitude: f64 = match value.parse::<f64>() {
            Ok(m) if m.is_finite() => m,
            _ => return Err((format!("`{}`", shortened(value)), "a magnitude")),
        };
        // What CORRECTION_MAG says is in the values already, or has to be added.
        let correction = match meta.get("CORRECTION_MAG").map(|c| (c, c.parse::<f64>())) {
            None => 0.0,
            Some((_, Ok(c))) if c.is_finite() => {
                match meta.get("CORRECTIONS_APPLIED") {
                    _ if c == 0.0 => 0.0,
                    Some(applied) if applied == "YES" => 0.0,
                    Some(applied) if applied == "NO" => {
                        said.push(format!("CORRECTION_MAG: {c} mag are added, as CORRECTIONS_APPLIED = NO asks for"));
                        c
                    }
                    _ => {
                        let found = "CORRECTION_MAG without CORRECTIONS_APPLIED".to_owned();
                        return Err((found, "CORRECTIONS_APPLIED = YES or NO"));
                    }
                }
            }
            Some((text, _)) => {
                return Err((format!("CORRECTION_MAG = `{}`", shortened(text)), "a number, mag"));
            }
        };
        if let Some(quality @ ("DEGRADED" | "INVALID")) =
            meta.get("DATA_QUALITY").map(String::as_str)
        {
            said.push(format!(
                "DATA_QUALITY = {quality}: the file does not trust some of its values"
            ));
        }
        // Light comes from the first participant of the path.
        let from = meta.get("PATH").and_then(|p| p.split(',').next()).map_or("2", str::trim);
        let name = meta.get(&format!("PARTICIPANT_{from}")).or_else(|| meta.get("PARTICIPANT_2"));
        if let Some(name) = name {
            if self.read.target.is_empty() {
                self.read.target.clone_from(name);
            } else if self.read.target != *name {
                let found = format!(
                    "magnitudes of {} after those of {}",
                    shortened(name),
                    shortened(&self.read.target)
                );
                return Err((found, "those of one target: give each a message of its own"));
            }
        }
        self.read.time.push(time + Duration::from_seconds(shift_s));
        self.read.magnitude.push(magnitude + correction);
        self.exposures.push(exposure);
        for words in said {
            if !self.read.notes.contains(&words) {
                self.read.notes.push(words);
            }
        }
        Ok(())
    }

    fn finish(self) -> Photometry {
        let mut read = self.read;
        // Either all say how long they took, or nobody knows it.
        read.exposure_s = self.exposures.into_iter().collect();
        for (key, n) in self.beside {
            read.notes.push(format!("{n} values of {key} are not read: magnitudes alone are"));
        }
        read
    }
}
