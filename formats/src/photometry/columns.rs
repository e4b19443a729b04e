//! Tables of named columns, whoever named them.

use super::{MJD_OFFSET, Scale, moment};
use crate::time::{UtcDay, parse_utc};
use crate::{ParseError, Table, Values};
use hifitime::{Duration, Epoch};
use std::path::Path;

/// Names of columns of times that are known, for messages.
pub const TIME_COLUMNS: &str =
    "time_utc (ISO 8601), jd_utc, mjd_utc, or jd_ and mjd_ with tai, tt or tdb; bjd_tdb";

/// Names that others give to times in words.
const TEXT_TIMES: [&str; 9] = [
    "time_utc",
    "utc",
    "date_utc",
    "datetime_utc",
    "utc_time",
    "time",
    "date",
    "datetime",
    "date-obs",
];
/// Names that others give to magnitudes, the usual first.
const MAGNITUDES: [&str; 8] =
    ["magnitude", "mag", "vmag", "v_mag", "mag_v", "v", "m", "apparent_mag"];
/// Names that others give to fluxes.
const FLUXES: [&str; 5] = ["flux", "counts", "adu", "rate", "intensity"];
/// Names that others give to standard uncertainties of magnitudes.
const SIGMAS: [&str; 9] = [
    "sigma_mag",
    "mag_err",
    "magerr",
    "e_mag",
    "mag_error",
    "err_mag",
    "magnitude_err",
    "magnitude_error",
    "mag_sigma",
];
/// Names that others give to standard uncertainties of fluxes.
const FLUX_SIGMAS: [&str; 6] =
    ["flux_err", "fluxerr", "flux_error", "e_flux", "sigma_flux", "counts_err"];

/// Which columns of a table hold what; those that are not named are looked for under the names that others use.
#[derive(Debug, Clone, Default, PartialEq)]
#[non_exhaustive]
pub struct ColumnNames {
    /// The column of times.
    pub time: Option<String>,
    /// The scale of times whose column does not name it.
    pub scale: Option<Scale>,
    /// The column of magnitudes, or of fluxes.
    pub magnitude: Option<String>,
    /// That of their standard uncertainties.
    pub sigma: Option<String>,
}

/// A column by its name, letter case aside; an exact one first.
pub(super) fn find<'a>(table: &'a Table, name: &str) -> Option<&'a str> {
    let names = || table.columns.iter().map(|c| c.name.as_str());
    names().find(|n| *n == name).or_else(|| names().find(|n| n.eq_ignore_ascii_case(name)))
}

impl ColumnNames {
    fn of<'a>(table: &'a Table, asked: Option<&str>, usual: &[&str]) -> Option<&'a str> {
        match asked {
            Some(name) => find(table, name),
            None => usual.iter().find_map(|name| find(table, name)),
        }
    }

    /// Name of the table's column of magnitudes.
    pub fn magnitude_of<'a>(&self, table: &'a Table) -> Option<&'a str> {
        Self::of(table, self.magnitude.as_deref(), &MAGNITUDES)
    }

    /// Name of the table's column of fluxes, where it has no magnitudes.
    pub fn flux_of<'a>(&self, table: &'a Table) -> Option<&'a str> {
        match &self.magnitude {
            Some(_) => None,
            None => Self::of(table, None, &FLUXES),
        }
    }

    /// Name of the table's column of standard uncertainties: of magnitudes, or of fluxes.
    pub fn sigma_of<'a>(&self, table: &'a Table, of_flux: bool) -> Option<&'a str> {
        Self::of(table, self.sigma.as_deref(), if of_flux { &FLUX_SIGMAS } else { &SIGMAS })
    }
}

/// Times of a table, and what has to be known of them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ColumnTimes {
    /// Times, row by row.
    pub time: Vec<Epoch>,
    /// Limits and meaning of the times, in words.
    pub notes: Vec<String>,
}

/// A Julian date, or a modified one, in a double; `None` outside 1972 to 2100.
pub(super) fn of_julian(number: f64, is_modified: bool, scale: Scale) -> Option<Epoch> {
    let (offset, half) = if is_modified { (0, 0.0) } else { (MJD_OFFSET, 0.5) };
    // Whole days beyond any of these are no date.
    let day = Some(number.floor()).filter(|d| d.abs() < 1e7)?;
    moment(day as i64 - offset, number - day - half, scale)
}

/// A Julian date in two doubles as ERFA has it: a day of UTC with a leap second is one day long in it.
fn of_pair(first: f64, second: f64, scale: Scale) -> Option<Epoch> {
    let whole = Some(first.floor()).filter(|d| d.abs() < 1e7)?;
    let part = (first - whole) + second - 0.5;
    let (day, part) = (whole as i64 - MJD_OFFSET + part.floor() as i64, part - part.floor());
    if scale != Scale::Utc {
        return moment(day, part, scale);
    }
    let day = UtcDay::of_mjd(day)?;
    let ns = day.start_tai_ns + (day.length_ns as f64 * part).round() as i128;
    Some(Epoch::from_tai_duration(Duration::from_total_nanoseconds(ns)))
}

/// Times of a table with named columns; `None` where no column is one of times.
///
/// The scale of a Julian date stands in its column's name (`jd_utc`), in the table's metadata (`TIMESYS` of FITS and VOTable), or in `names`; it is never guessed.
///
/// # Errors
/// A value that is no time; a time of which nothing names the scale.
pub fn column_times(
    path: &Path,
    table: &Table,
    names: &ColumnNames,
) -> Result<Option<ColumnTimes>, ParseError> {
    Ok(named_times(path, table, names)?.map(|(_, times)| times))
}

/// The same with the name of the column.
pub(super) fn named_times<'a>(
    path: &Path,
    table: &'a Table,
    names: &ColumnNames,
) -> Result<Option<(&'a str, ColumnTimes)>, ParseError> {
    let stated = || {
        let keys = ["timesys", "TIMESYS", "time_scale"];
        keys.iter().find_map(|key| Scale::of(table.meta_text(key)?.trim()))
    };
    let is_date = |name: &str| {
        let name = name.to_ascii_lowercase();
        matches!(name.split(['_', ' ', '(']).next(), Some("jd" | "mjd" | "bjd" | "hjd"))
    };
    let name = if let Some(asked) = &names.time {
        let Some(name) = find(table, asked) else {
            let all: Vec<&str> = table.columns.iter().map(|c| c.name.as_str()).collect();
            let found = format!("the columns {}", all.join(", "));
            return Err(ParseError::new(path, found, format!("a column `{asked}` of times")));
        };
        Some(name)
    } else {
        find(table, TEXT_TIMES[0])
            .or_else(|| table.columns.iter().map(|c| c.name.as_str()).find(|n| is_date(n)))
            .or_else(|| TEXT_TIMES.iter().find_map(|name| find(table, name)))
    };
    let Some(name) = name else { return Ok(None) };
    Ok(Some((name, times(path, table, name, names.scale, stated())?)))
}

/// Times of one column.
fn times(
    path: &Path,
    table: &Table,
    name: &str,
    asked: Option<Scale>,
    stated: Option<Scale>,
) -> Result<ColumnTimes, ParseError> {
    let in_row = |error: ParseError, row: usize| error.in_field(format!("{name}, row {}", row + 1));
    let lower = name.to_ascii_lowercase();
    let words: Vec<&str> =
        lower.split(|c: char| !c.is_ascii_alphanumeric()).filter(|w| !w.is_empty()).collect();
    // As astropy notes a column of Time in ECSV.
    let kept = || {
        let column = table.meta.get("__serialized_columns__")?.get(name)?;
        Scale::of(column.get("scale")?.as_str()?)
    };
    let named = words.iter().find_map(|w| Scale::of(w)).or_else(kept);
    let scale = asked.or(named).or(stated);
    let unknown = |kind: &str| {
        let error = ParseError::new(path, format!("`{name}`"), "a time whose scale is named");
        error.in_field(name.to_owned()).with_hint(format!(
            "call the column {kind}_utc, {kind}_tai, {kind}_tt or {kind}_tdb, or give --time-scale: scales differ by more than a minute"
        ))
    };
    let Ok(column) = table.column(name) else {
        return Err(ParseError::new(path, "no such column", "times").in_field(name.to_owned()));
    };
    if let Values::Text(texts) = &column.values {
        // A text that ends with Z says it is UTC.
        let all_zulu = texts.iter().flatten().all(|t| t.trim_end().ends_with(['Z', 'z']));
        match scale {
            Some(Scale::Utc) => {}
            None if all_zulu => {}
            Some(_) => {
                let error =
                    ParseError::new(path, format!("times as text in {name}"), "UTC as text");
                return Err(error
                    .in_field(name.to_owned())
                    .with_hint("give other scales as Julian dates"));
            }
            None => return Err(unknown("time")),
        }
        let time = |(i, text): (usize, &Option<String>)| {
            let text = text.as_deref().unwrap_or("").trim();
            parse_utc(text).map_err(|e| in_row(e.in_file(path), i))
        };
        let time = texts.iter().enumerate().map(time).collect::<Result<_, _>>()?;
        return Ok(ColumnTimes { time, notes: Vec::new() });
    }
    // As astropy writes a column of Time into FITS: two doubles whose sum is the Julian date.
    if let Ok((2, pairs)) = table.f64_vectors(name)
        && table.meta.get("JDREF").and_then(serde_json::Value::as_f64) == Some(0.0)
    {
        let Some(scale) = scale else { return Err(unknown("jd")) };
        let time = pairs.chunks_exact(2).enumerate().map(|(row, pair)| {
            let time = of_pair(pair[0], pair[1], scale);
            time.ok_or_else(|| {
                let found = format!("{} + {}", pair[0], pair[1]);
                in_row(ParseError::new(path, found, "a date from 1972 to 2100"), row)
            })
        });
        return Ok(ColumnTimes { time: time.collect::<Result<_, _>>()?, notes: Vec::new() });
    }
    let kind = words.first().copied().unwrap_or_default();
    if !matches!(kind, "jd" | "mjd" | "bjd" | "hjd") {
        let found = column.values.kind();
        let error = ParseError::new(path, found, "ISO 8601, or a column called jd_… or mjd_…");
        return Err(error.in_field(name.to_owned()));
    }
    let Some(scale) = scale else { return Err(unknown(kind)) };
    let Ok(numbers) = table.f64(name) else {
        return Err(
            ParseError::new(path, column.values.kind(), "numbers").in_field(name.to_owned())
        );
    };
    let time = numbers.iter().enumerate().map(|(row, number)| {
        of_julian(*number, kind == "mjd", scale).ok_or_else(|| {
            let error = ParseError::new(path, number.to_string(), "a date from 1972 to 2100");
            in_row(error, row)
        })
    });
    let time = time.collect::<Result<_, _>>()?;
    let mut notes = Vec::new();
    if kind != "mjd" {
        notes.push(format!("{name}: a Julian date in a double is good to 40 µs"));
    }
    match kind {
        "bjd" => notes.push(format!(
            "{name}: the light's way is counted to the barycentre of the solar system"
        )),
        "hjd" => notes.push(format!("{name}: the light's way is counted to the Sun")),
        _ => {}
    }
    Ok(ColumnTimes { time, notes })
}
