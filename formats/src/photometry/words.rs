//! Tables as texts: values between commas, semicolons, tabs or blanks, with the names in the first line or in the last comment before the rows.
//!
//! What cannot be read of a row is said with its number and its first line, never passed over: [`READING_NOTES`] in the table's metadata. A file most of whose rows cannot be read is refused.

use super::columns::usual_time;
use super::shortened;
use super::tables::retain;
use crate::text::counted;
use crate::time::parse_zoned;
use crate::{Column, ParseError, Table, Values};
use std::path::Path;

/// Metadata of a table: notes on rows and cells that could not be read.
pub(super) const READING_NOTES: &str = "reading_notes";
/// Metadata of a table: the zone of its times, as a comment says.
pub(super) const TIME_ZONE: &str = "time_zone";
/// Words for tables between blanks or tabs, and between other characters.
pub(super) const TEXT: &str = "text";
pub(super) const CSV: &str = "CSV";
/// Begins of lines that are notes.
const NOTES: [char; 3] = ['#', '%', '!'];
/// Columns of names: numbers among them make them no column of numbers.
const NAMES: [&str; 10] =
    ["object", "name", "id", "filter", "filt", "band", "session", "camera", "channel", "flag"];

/// The text of a file: UTF-8, UTF-16 with its mark, or Latin-1, which the note says.
///
/// # Errors
/// Bytes that are no text.
pub(super) fn decode(path: &Path, bytes: Vec<u8>) -> Result<(String, Option<String>), ParseError> {
    let wide = match bytes.as_slice() {
        [0xff, 0xfe, rest @ ..] => Some((rest, u16::from_le_bytes as fn([u8; 2]) -> u16)),
        [0xfe, 0xff, rest @ ..] => Some((rest, u16::from_be_bytes as fn([u8; 2]) -> u16)),
        _ => None,
    };
    if let Some((rest, of)) = wide {
        let (units, odd) = rest.as_chunks::<2>();
        let units: Vec<u16> = units.iter().map(|unit| of(*unit)).collect();
        let text = String::from_utf16(&units).ok().filter(|_| odd.is_empty());
        let broken = || ParseError::new(path, "UTF-16 that is broken", "text in UTF-8 or UTF-16");
        return Ok((text.ok_or_else(broken)?, None));
    }
    let is_text = |b: &u8| *b >= 0x20 && *b != 0x7f || matches!(b, b'\t' | b'\n' | b'\r' | 0x0c);
    if std::str::from_utf8(&bytes).is_ok() || !bytes.iter().all(is_text) {
        return Ok((crate::read::decode(path, bytes)?, None));
    }
    let note = "the text is not UTF-8: its letters beyond ASCII are read as Latin-1";
    Ok((bytes.iter().map(|b| char::from(*b)).collect(), Some(note.to_owned())))
}

/// Whether a cell says that there is no value.
pub(super) fn is_missing(text: &str) -> bool {
    let lower = text.trim().to_ascii_lowercase();
    matches!(
        lower.as_str(),
        "" | "-" | "--" | "---" | "nan" | "na" | "n/a" | "null" | "none" | "indef" | "..." | "?"
    )
}

/// Whether a cell is a limit, such as `>16.9`.
fn is_limit(text: &str) -> bool {
    let rest = text.trim().strip_prefix(['<', '>']);
    rest.is_some_and(|rest| rest.trim_start_matches('=').trim().parse::<f64>().is_ok())
}

/// The sign between two values.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Between {
    Character(char),
    Blanks,
}

impl Between {
    fn of(line: &str) -> Self {
        [';', '\t', ',']
            .into_iter()
            .find(|c| line.contains(*c))
            .map_or(Self::Blanks, Self::Character)
    }

    fn words(self, line: &str) -> Vec<String> {
        match self {
            Self::Blanks => {
                line.split_whitespace().map(|w| w.trim_matches('"').to_owned()).collect()
            }
            Self::Character(c) => quoted(line, c),
        }
    }

    /// Whether a comma may be a decimal one.
    fn has_decimal_commas(self) -> bool {
        self != Self::Character(',')
    }
}

/// The fields of a line; what stands in quotes is one, and two quotes in it are a quote.
fn quoted(line: &str, between: char) -> Vec<String> {
    let mut fields = Vec::new();
    let mut field = String::new();
    let mut is_quoted = false;
    let mut characters = line.chars().peekable();
    while let Some(c) = characters.next() {
        match c {
            '"' if is_quoted && characters.peek() == Some(&'"') => {
                characters.next();
                field.push('"');
            }
            '"' if is_quoted => is_quoted = false,
            '"' if field.trim().is_empty() => {
                field.clear();
                is_quoted = true;
            }
            c if c == between && !is_quoted => {
                fields.push(field.trim().to_owned());
                field.clear();
            }
            c => field.push(c),
        }
    }
    fields.push(field.trim().to_owned());
    fields
}

/// The number of a cell; with `commas` a comma may stand for the point.
fn number(text: &str, commas: bool) -> Option<f64> {
    let plain = text.parse::<f64>().ok();
    if plain.is_some() || !commas {
        return plain;
    }
    let (whole, part) = text.split_once(',')?;
    let digits = |t: &str| !t.is_empty() && t.bytes().all(|b| b.is_ascii_digit());
    let is_part = part.bytes().next().is_some_and(|b| b.is_ascii_digit());
    let is_one =
        digits(whole.trim_start_matches(['-', '+'])) && is_part && !part.contains(['.', ',']);
    is_one.then(|| format!("{whole}.{part}").parse().ok())?
}

/// The keys of AAVSO's formats: `#TYPE=EXTENDED`.
struct Aavso<'a> {
    delimiter: Between,
    date: &'a str,
}

impl<'a> Aavso<'a> {
    fn of(text: &'a str) -> Option<Self> {
        let key = |name: &str| {
            let lines = text.lines().take(60).filter_map(|l| l.trim().strip_prefix('#'));
            let mut pairs = lines.filter_map(|l| l.split_once('='));
            pairs
                .find(|(key, _)| key.trim().eq_ignore_ascii_case(name))
                .map(|(_, value)| value.trim())
        };
        let kind = key("TYPE")?.to_ascii_uppercase();
        if !matches!(kind.as_str(), "EXTENDED" | "VISUAL") {
            return None;
        }
        let delimiter = match key("DELIM").unwrap_or(",").to_ascii_lowercase().as_str() {
            "tab" => Between::Character('\t'),
            "comma" | "" => Between::Character(','),
            "space" => Between::Blanks,
            other => Between::Character(other.chars().next()?),
        };
        Some(Self { delimiter, date: key("DATE").unwrap_or("JD") })
    }

    /// Our name of a column of theirs.
    fn name(&self, path: &Path, name: &str) -> Result<String, ParseError> {
        Ok(match name.to_ascii_uppercase().as_str() {
            "NAME" | "STARID" => "object".into(),
            "FILT" => "filter".into(),
            "MERR" | "MAGERR" => "mag_err".into(),
            // Their times are UT.
            "DATE" => match self.date.to_ascii_uppercase().as_str() {
                "JD" => "jd_utc".into(),
                "HJD" => "hjd_utc".into(),
                "BJD" => "bjd".into(),
                other => {
                    let error = ParseError::new(path, format!("DATE={other}"), "JD, HJD or BJD");
                    return Err(error.in_field("#DATE"));
                }
            },
            _ => name.to_owned(),
        })
    }
}

/// A table of a text.
///
/// # Errors
/// Rows of numbers without names, unless some are given; names that are given beside those of the file; most rows with another number of words than there are names.
pub(super) fn read(
    path: &Path,
    text: &str,
    given: &[String],
) -> Result<(&'static str, Table), ParseError> {
    let lines = || {
        text.lines().enumerate().map(|(i, l)| (i, trimmed(l))).filter(|(_, l)| !l.trim().is_empty())
    };
    let Some((first, row)) = lines().find(|(_, l)| !l.starts_with(NOTES)) else {
        return Err(ParseError::new(path, "no line", "names of columns, then rows"));
    };
    let aavso = Aavso::of(text);
    let mut between = aavso.as_ref().map_or_else(|| Between::of(row), |a| a.delimiter);
    let commas = between.has_decimal_commas();
    let is_number = |word: &String| number(word, commas).is_some();
    let mut first_words = between.words(row);
    // Names are no numbers: a first line with one is a row.
    let has_names = aavso.is_none() && !first_words.iter().any(is_number);
    if has_names {
        // Tabs beside blanks only put the columns in line.
        let below = lines().find(|(i, l)| *i > first && !l.starts_with(NOTES));
        let count = below.map_or(first_words.len(), |(_, row)| between.words(row).len());
        if between == Between::Character('\t') && count != first_words.len() {
            between = Between::Blanks;
            first_words = between.words(row);
        }
    }
    if !given.is_empty() && (has_names || aavso.is_some() || given.len() != first_words.len()) {
        let found = match has_names || aavso.is_some() {
            true => format!("the names `{}`", shortened(row)),
            false => counted(first_words.len(), "value"),
        };
        let expected =
            format!("rows of {}, without a line of names", counted(given.len(), "value"));
        let error = ParseError::new(path, found, expected).at_line(first as u64 + 1);
        return Err(error.with_hint(
            "--columns gives a name for each column of a text that has no line of names",
        ));
    }
    let names = if !given.is_empty() {
        given.to_vec()
    } else if has_names {
        first_words
    } else {
        let comment =
            text.lines().take(first).map(str::trim).filter(|l| l.starts_with(NOTES)).last();
        let named = comment.map(|l| between.words(l.trim_start_matches(NOTES).trim()));
        match named.filter(|names| names.len() == first_words.len() && !names.iter().any(is_number))
        {
            Some(names) => names,
            None => {
                let found = format!("`{}`", shortened(row));
                let error = ParseError::new(path, found, "names of the columns in the first line");
                return Err(error.at_line(first as u64 + 1).with_hint(
                    "--columns jd_utc,magnitude,sigma_mag gives the names, as many as columns, or such a line before the numbers does",
                ));
            }
        }
    };
    let names: Vec<String> = match &aavso {
        Some(aavso) => names.iter().map(|n| aavso.name(path, n)).collect::<Result<_, _>>()?,
        None => names,
    };
    let twice = names.iter().enumerate().find(|(i, n)| !n.is_empty() && names[..*i].contains(n));
    if let Some((_, name)) = twice {
        let found = format!("the name `{}` twice", shortened(name));
        return Err(ParseError::new(path, found, "each name once").at_line(first as u64 + 1));
    }
    let mut cells = Cells {
        columns: vec![Vec::new(); names.len()],
        lines: Vec::new(),
        commas,
        notes: Vec::new(),
    };
    let from = if has_names { first + 1 } else { first };
    let mut odd: Vec<(usize, usize)> = Vec::new();
    for (line, row) in lines().filter(|(i, l)| *i >= from && !l.starts_with(NOTES)) {
        let fields = fitted(between.words(row), names.len());
        if fields.len() == names.len() {
            cells.lines.push(line + 1);
            cells.columns.iter_mut().zip(fields).for_each(|(column, field)| column.push(field));
        } else {
            odd.push((line + 1, fields.len()));
        }
    }
    if let Some((line, n)) = odd.first() {
        if 2 * odd.len() > cells.lines.len() + odd.len() {
            let kind = if between == Between::Blanks { "words" } else { "fields" };
            let expected = format!("{}, as many as names", names.len());
            let error = ParseError::new(path, format!("{n} {kind}"), expected);
            let hint = match between {
                Between::Blanks => {
                    "a date and a time of day are one word: 2020-11-18T16:38:30; what is missing is nan"
                }
                Between::Character(',') => {
                    "is there a decimal comma in a number? Decimals are separated by points, or columns by semicolons"
                }
                Between::Character(_) => "every row has a value for each name, which may be empty",
            };
            return Err(error.at_line(*line as u64).with_hint(hint));
        }
        cells.notes.push(format!(
            "{} left out: without {}, as many as names (the first in line {line}: {n})",
            counted(odd.len(), "row"),
            counted(names.len(), "value")
        ));
    }
    let mut columns = Vec::with_capacity(names.len());
    for (i, name) in names.into_iter().enumerate() {
        columns.push(cells.column(i, name));
    }
    let mut table = Table { columns, ..Table::default() };
    cells.without_untimed(&mut table);
    let zone = text.lines().map(str::trim).filter(|l| l.starts_with(NOTES)).find_map(zone_of);
    if let Some(zone) = zone {
        table.meta.insert(TIME_ZONE.into(), zone.into());
    }
    if aavso.is_some()
        && let Ok(Values::Text(kinds)) = table.column("MTYPE").map(|c| &c.values)
        && kinds.iter().flatten().any(|k| k.eq_ignore_ascii_case("DIF"))
    {
        cells.notes.push("MTYPE is DIF: magnitudes are differences from a comparison star".into());
    }
    if !cells.notes.is_empty() {
        table.meta.insert(READING_NOTES.into(), cells.notes.into());
    }
    let name = match (&aavso, between) {
        (Some(_), _) => "AAVSO",
        (None, Between::Blanks | Between::Character('\t')) => TEXT,
        (None, Between::Character(_)) => CSV,
    };
    Ok((name, table))
}

/// A line without blanks at its ends. A tab there stands beside an empty field.
fn trimmed(line: &str) -> &str {
    match line.trim().contains('\t') {
        true => line.trim_matches(|c: char| c.is_whitespace() && c != '\t'),
        false => line.trim(),
    }
}

/// The zone that a comment says: `# Time zone: CET`.
fn zone_of(comment: &str) -> Option<String> {
    let lower = comment.to_ascii_lowercase();
    let at = ["time zone", "timezone", "time_zone"]
        .iter()
        .find_map(|key| lower.find(key).map(|at| at + key.len()))?;
    let value = comment.get(at..)?.trim_start().strip_prefix([':', '='])?.trim();
    (!value.is_empty() && value.len() < 40).then(|| value.to_owned())
}

/// Whether a word is a date without a time of day.
pub(super) fn is_date(word: &str) -> bool {
    !word.contains([':', 'T', ' ']) && word.len() <= 10 && parse_zoned(word).is_ok()
}

/// Whether a word is a time of day. Two days, that second 60 is one, in clocks ahead of UTC too.
pub(super) fn is_clock(word: &str) -> bool {
    let on = |day: &str| parse_zoned(&format!("{day}T{}", word.replace(',', "."))).is_ok();
    word.contains(':') && ["2016-12-31", "2017-01-01"].into_iter().any(on)
}

/// Fields that became more than the names: a separator at the end, or a date and a time of day with a blank between.
fn fitted(mut fields: Vec<String>, names: usize) -> Vec<String> {
    if fields.len() != names + 1 {
        return fields;
    }
    if fields.last().is_some_and(String::is_empty) {
        fields.pop();
    } else if fields.first().is_some_and(String::is_empty) {
        fields.remove(0);
    } else if let Some(i) = (0..names).find(|&i| is_date(&fields[i]) && is_clock(&fields[i + 1])) {
        let clock = fields.remove(i + 1);
        fields[i] = format!("{}T{clock}", fields[i]);
    }
    fields
}

/// Cells of a table as texts.
struct Cells {
    columns: Vec<Vec<String>>,
    /// Lines of the rows, from 1.
    lines: Vec<usize>,
    commas: bool,
    notes: Vec<String>,
}

impl Cells {
    /// A column: of numbers where most of what it says are such, else of texts.
    fn column(&mut self, index: usize, name: String) -> Column {
        let texts = std::mem::take(&mut self.columns[index]);
        let said = texts.iter().filter(|t| !is_missing(t) && !is_limit(t)).count();
        let numbers: Vec<Option<f64>> = texts.iter().map(|t| number(t, self.commas)).collect();
        let found = numbers.iter().flatten().filter(|n| !n.is_nan()).count();
        let is_name = NAMES.iter().any(|n| name.eq_ignore_ascii_case(n));
        let is_empty = texts.iter().all(|t| t.is_empty() || t.eq_ignore_ascii_case("nan"));
        let is_number = if is_name { found == texts.len() } else { 2 * found > said };
        if !is_empty && (found == 0 || !is_number) {
            let values = Values::Text(texts.into_iter().map(Some).collect());
            return Column { name, unit: None, description: None, values };
        }
        type Kind<'a> = (&'a str, &'a dyn Fn(&str) -> bool);
        let kinds: [Kind; 3] = [
            ("with a limit, no value", &is_limit),
            ("without a value", &|t| is_missing(t) && !is_empty),
            ("with no number", &|t| !is_missing(t) && !is_limit(t)),
        ];
        for (what, is) in kinds {
            let is_none = |i: usize| numbers[i].is_none_or(f64::is_nan);
            let lost = || (0..texts.len()).filter(|&i| is_none(i) && is(&texts[i]));
            if let Some(i) = lost().next() {
                let first = match texts[i].as_str() {
                    "" => "empty".to_owned(),
                    text => format!("`{}`", shortened(text)),
                };
                self.notes.push(format!(
                    "{name}: {} {what} (the first in line {}: {first})",
                    counted(lost().count(), "cell"),
                    self.lines[i],
                ));
            }
        }
        let values = numbers.into_iter().map(|n| n.unwrap_or(f64::NAN)).collect();
        Column { name, unit: None, description: None, values: Values::F64(values) }
    }

    /// Takes out the rows without a time, where most have one.
    fn without_untimed(&mut self, table: &mut Table) {
        let Some(name) = usual_time(table).map(str::to_owned) else { return };
        let keep: Vec<bool> = match table.column(&name).map(|c| &c.values) {
            Ok(Values::F64(numbers)) => numbers.iter().map(|n| !n.is_nan()).collect(),
            Ok(Values::Text(texts)) => texts.iter().map(|t| has_time(t.as_deref())).collect(),
            _ => return,
        };
        let lost = keep.iter().filter(|k| !**k).count();
        let Some(first) = keep.iter().position(|k| !k).filter(|_| 2 * lost <= keep.len()) else {
            return;
        };
        table.columns.iter_mut().for_each(|c| retain(&mut c.values, &keep, 1));
        self.notes.push(format!(
            "{} without a time left out (the first in line {})",
            counted(lost, "row"),
            self.lines[first]
        ));
    }
}

/// Whether a text is a time of some form.
fn has_time(text: Option<&str>) -> bool {
    let Some(text) = text.map(|t| t.trim().replace(',', ".")) else { return false };
    is_clock(&text) || parse_zoned(&text).is_ok()
}
