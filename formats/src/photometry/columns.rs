//! Tables of named columns, whoever named them.

use super::words::{READING_NOTES, TIME_ZONE, is_clock, is_date};
use super::{DAY_S, MJD_OFFSET, Scale, moment};
use crate::text::counted;
use crate::time::{UtcDay, parse_utc, parse_zoned};
use crate::{ParseError, Table, Values};
use hifitime::{Duration, Epoch};
use std::path::Path;

/// Names of columns of times that are known, for messages.
pub const TIME_COLUMNS: &str = "time_utc (ISO 8601), jd_utc, mjd_utc, or jd_ and mjd_ with tai, tt or tdb; bjd_tdb; or --time-column NAME, with --time-format jd, mjd, unix, s or d";

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
const FLUXES: [&str; 8] = [
    "flux",
    "pdcsap_flux",
    // TESS's quick-look pipeline: beside SAP_FLUX, as the mission's own.
    "kspsap_flux",
    "sap_flux",
    "counts",
    "adu",
    "rate",
    "intensity",
];
/// Words in the name of a column, or in its unit, that say that its values are fluxes.
const OF_FLUX: [&str; 13] = [
    "flux",
    "fluxes",
    "rate",
    "counts",
    "count",
    "adu",
    "jy",
    "mjy",
    "ujy",
    "electron",
    "electrons",
    "intensity",
    "photons",
];
/// Names that others give to filters.
const FILTERS: [&str; 9] = [
    "filter",
    "filt",
    "band",
    "filters",
    "filtercode",
    "fid",
    "passband",
    "bandpass",
    "filter_name",
];
/// Names that others give to standard uncertainties of magnitudes.
const SIGMAS: [&str; 18] = [
    "sigma_mag",
    "mag_err",
    "magerr",
    "e_mag",
    "mag_error",
    "err_mag",
    "magnitude_err",
    "magnitude_error",
    "mag_sigma",
    "mag_unc",
    "mag_uncertainty",
    "magnitude_uncertainty",
    "merr",
    "sigmamag",
    "sigma",
    "uncertainty",
    "error",
    "err",
];
/// Names that others give to standard uncertainties of fluxes.
const FLUX_SIGMAS: [&str; 9] = [
    "flux_err",
    "fluxerr",
    "flux_error",
    "e_flux",
    "sigma_flux",
    "flux_unc",
    "counts_err",
    "err",
    "error",
];
/// Names that others give to exposures, the usual first, and the unit of each in seconds where the table has none.
const EXPOSURES: [(&str, f64); 13] = [
    ("exposure_s", 1.0),
    ("exptime", 1.0),
    ("exp_time", 1.0),
    ("exposure", 1.0),
    ("exposure_time", 1.0),
    ("exp", 1.0),
    ("t_exp", 1.0),
    ("texp", 1.0),
    ("itime", 1.0),
    ("exp_s", 1.0),
    ("exptime_s", 1.0),
    ("exposure_ms", 1e-3),
    ("exptime_ms", 1e-3),
];
/// Those of the names above that others also give to flags: whole numbers in them are no uncertainties.
const OF_FLAGS: [&str; 2] = ["err", "error"];

/// Meaning of the numbers in a column of times.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TimeFormat {
    /// Julian dates.
    Jd,
    /// Modified Julian dates.
    Mjd,
    /// Seconds since 1970-01-01 in UTC, leap seconds left out.
    Unix,
    /// Seconds from a moment that is not known.
    Seconds,
    /// Days from a moment that is not known.
    Days,
    /// Texts by ISO 8601.
    Iso,
}

/// Kind of times that a column's name says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Jd,
    Mjd,
    Bjd,
    Hjd,
    Unix,
}

/// Words in names of times that say that they are those of a place's clock.
const LOCAL: [&str; 31] = [
    "local", "lt", "loc", "lmt", "dst", "cet", "cest", "eet", "eest", "wet", "west", "bst", "msk",
    "ist", "jst", "kst", "hkt", "aest", "aedt", "acst", "awst", "nzst", "nzdt", "est", "edt",
    "cst", "cdt", "mst", "mdt", "pst", "pdt",
];

/// The word in a name of times, or of a zone, by which they are not UTC: `local`, `CET`, `UTC+2`.
fn local_word(name: &str) -> Option<String> {
    let lower = name.to_ascii_lowercase();
    let mut words = lower.split(|c: char| !c.is_ascii_alphanumeric());
    if let Some(word) = words.find(|word| LOCAL.contains(word)) {
        return Some(word.to_owned());
    }
    let offset = ["utc", "gmt", "ut"].iter().find_map(|zone| {
        let (_, rest) = lower.split_once(zone)?;
        let rest = rest.trim_start();
        let digits = rest.strip_prefix(['+', '-', '−'])?.trim_start();
        let hours: String = digits.chars().take_while(char::is_ascii_digit).collect();
        (hours.parse::<u32>().ok()? > 0).then(|| format!("{zone}{rest}"))
    });
    offset.map(|text| text.trim_end_matches([')', ']']).to_owned())
}

/// Days that a name takes off Julian dates (`HJD-2450000`), whole ones and the rest; those of the missions' own dates.
fn taken_off(name: &str) -> Option<(i64, f64)> {
    let lower = name.to_ascii_lowercase();
    // Kepler Archive Manual, section 2.3.2; TESS Science Data Products Description, section 2.3.
    match lower.as_str() {
        "bkjd" => return Some((2_454_833, 0.0)),
        "rjd" => return Some((2_400_000, 0.0)),
        "btjd" => return Some((2_457_000, 0.0)),
        _ => {}
    }
    lower.match_indices(['-', '−']).find_map(|(at, sign)| {
        let rest = lower[at + sign.len()..].trim_start();
        let end = rest.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(rest.len());
        let number = rest[..end].trim_end_matches('.').parse::<f64>().ok()?;
        (2_300_000.0..2_500_000.0)
            .contains(&number)
            .then(|| (number.floor() as i64, number.fract()))
    })
}

impl Kind {
    /// The kind that a name says: `JD_UTC`, `obsmjd`, `unix_time`.
    fn of_name(name: &str) -> Option<Self> {
        // AstroImageJ writes `J.D.-2400000`.
        let name = name.to_ascii_lowercase().replace("j.d.", "jd");
        let mut words = name.split(|c: char| !c.is_ascii_alphanumeric()).filter(|w| !w.is_empty());
        let first = words.clone().next()?;
        let whole = |word: &str| match word {
            "jd" => Some(Self::Jd),
            "mjd" => Some(Self::Mjd),
            "bjd" | "btjd" | "bkjd" => Some(Self::Bjd),
            "hjd" => Some(Self::Hjd),
            "unix" | "unixtime" | "posix" => Some(Self::Unix),
            _ => None,
        };
        let ending = |word: &str| match word {
            w if w.ends_with("mjd") => Some(Self::Mjd),
            w if w.ends_with("bjd") => Some(Self::Bjd),
            w if w.ends_with("hjd") => Some(Self::Hjd),
            w if w.ends_with("jd") => Some(Self::Jd),
            _ => None,
        };
        whole(first).or_else(|| words.clone().find_map(whole)).or_else(|| words.find_map(ending))
    }

    /// The kind by the size of numbers: those of 1972 to 2100 tell dates and Unix time apart.
    fn of_size(numbers: &[f64]) -> Option<Self> {
        let finite = || numbers.iter().filter(|n| n.is_finite());
        let within = |low: f64, high: f64| finite().all(|n| (low..high).contains(n));
        match finite().next() {
            None => None,
            Some(_) if within(2_441_317.5, 2_488_434.5) => Some(Self::Jd),
            Some(_) if within(41_317.0, 88_434.0) => Some(Self::Mjd),
            Some(_) if within(63_072_000.0, 4_133_980_800.0) => Some(Self::Unix),
            Some(_) => None,
        }
    }
}

/// Which columns of a table hold what; those that are not named are looked for under the names that others use.
#[derive(Debug, Clone, Default, PartialEq)]
#[non_exhaustive]
pub struct ColumnNames {
    /// Names of the columns of a text that has no line of names, in order; empty for one that has.
    pub all: Vec<String>,
    /// The column of times.
    pub time: Option<String>,
    /// The scale of times whose column does not name it; it also says of times called local which they really are.
    pub scale: Option<Scale>,
    /// Meaning of the times' numbers, where the column's name does not say it.
    pub format: Option<TimeFormat>,
    /// The column of magnitudes, or of fluxes.
    pub magnitude: Option<String>,
    /// That of their standard uncertainties.
    pub sigma: Option<String>,
}

/// Metadata of a table whose magnitudes are those of the fluxes beside them: [`UNKNOWN`].
pub const ZERO_POINT: &str = "zero_point";
/// Value of [`ZERO_POINT`]: the fluxes are what was measured.
pub const UNKNOWN: &str = "unknown";

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
        let is_of_flux = table.meta_text(ZERO_POINT) == Some(UNKNOWN);
        if self.magnitude.is_none() && is_of_flux && self.flux_of(table).is_some() {
            return None;
        }
        let found = Self::of(table, self.magnitude.as_deref(), &MAGNITUDES)?;
        // A flux that was asked for is one.
        (self.magnitude.is_none() || !is_flux(table, found)).then_some(found)
    }

    /// Name of the table's column of fluxes, where it has no magnitudes, or where it was asked for.
    pub fn flux_of<'a>(&self, table: &'a Table) -> Option<&'a str> {
        match self.magnitude.as_deref() {
            Some(asked) => find(table, asked).filter(|name| is_flux(table, name)),
            None => Self::of(table, None, &FLUXES),
        }
    }

    /// Name of the table's column of standard uncertainties: of magnitudes, or of fluxes.
    pub fn sigma_of<'a>(&self, table: &'a Table, of_flux: bool) -> Option<&'a str> {
        // The column that is named after the values comes first: of two fluxes each has its own.
        let values = if of_flux { self.flux_of(table) } else { self.magnitude_of(table) };
        let own = values.filter(|_| self.sigma.is_none()).and_then(|name| {
            let forms = [
                format!("{name}_err"),
                format!("{name}_error"),
                format!("e_{name}"),
                format!("{name}err"),
                format!("sigma_{name}"),
                format!("{name}_sigma"),
                format!("{name}_unc"),
                format!("{name}_uncertainty"),
                format!("{name} error"),
                format!("{name} err"),
                // AstroImageJ: rel_flux_err_T1 of rel_flux_T1.
                name.replacen("flux_", "flux_err_", 1),
                // ATLAS.
                format!("d{name}"),
            ];
            forms.iter().filter(|form| *form != name).find_map(|form| find(table, form))
        });
        if own.is_some() || self.sigma.is_some() {
            return own.or_else(|| Self::of(table, self.sigma.as_deref(), &[]));
        }
        let usual: &[&str] = if of_flux { &FLUX_SIGMAS } else { &SIGMAS };
        let found = usual.iter().filter_map(|name| find(table, name));
        let is_flag = |name: &str| {
            let is_doubtful = OF_FLAGS.iter().any(|n| name.eq_ignore_ascii_case(n));
            let whole = |v: &f64| v.is_nan() || v.fract() == 0.0;
            is_doubtful && table.f64(name).is_ok_and(|values| values.iter().all(whole))
        };
        found.into_iter().find(|name| !is_flag(name))
    }
}

/// Whether a column's name or unit says that its values are fluxes.
fn is_flux(table: &Table, name: &str) -> bool {
    let unit = table.column(name).ok().and_then(|column| column.unit.as_deref()).unwrap_or("");
    let said = format!("{name} {unit}").to_ascii_lowercase();
    if said.contains("mag") {
        return false;
    }
    let mut words = said.split(|c: char| !c.is_ascii_alphabetic());
    let has_unit = !matches!(unit.trim(), "" | "1" | "dex");
    has_unit || words.any(|word| OF_FLUX.contains(&word) || word.ends_with("flux"))
}

/// The name of a table's column of filters.
pub fn filter_column(table: &Table) -> Option<&str> {
    let usual = FILTERS.iter().find_map(|name| find(table, name));
    // The forced photometry of ATLAS has one letter for nearly everything.
    usual.or_else(|| find(table, "F").filter(|_| find(table, "uJy").is_some()))
}

/// Takes out magnitudes that stand for a flux below 0: the forced photometry of ATLAS gives a faint source's magnitude the sign of its flux. Returns the note on it.
pub fn without_signs_of_fluxes(
    table: &Table,
    name: &str,
    magnitudes: &mut [f64],
) -> Option<String> {
    let flux = find(table, "uJy").filter(|_| name.eq_ignore_ascii_case("m"))?;
    let fluxes = table.f64(flux).ok()?;
    let mut lost = 0;
    for (m, flux) in magnitudes.iter_mut().zip(fluxes.iter()) {
        if *flux <= 0.0 && m.is_finite() {
            *m = f64::NAN;
            lost += 1;
        }
    }
    (lost > 0).then(|| {
        format!("{lost} magnitudes left out: their flux ({flux}) is not above 0 (--magnitude-column {flux} reads fluxes)")
    })
}

/// Exposures of a table.
#[derive(Debug, Clone, PartialEq)]
pub struct Exposures {
    /// The column that has them.
    pub column: String,
    /// Exposures, s; else the note on why they are not known.
    pub seconds: Result<Vec<f64>, String>,
}

/// Exposures of a table under any of the names that others use; `None` where there is no such column. The unit of a column comes before that of its name. All are above 0, or none is known.
pub fn exposures(table: &Table) -> Option<Exposures> {
    let (column, factor) =
        EXPOSURES.iter().find_map(|(name, factor)| Some((find(table, name)?, *factor)))?;
    let unknown = |why: String| Err(format!("{column}: {why}: exposures count as not known"));
    let unit = table.column(column).ok()?.unit.as_deref().map(str::trim).filter(|u| !u.is_empty());
    let seconds = match (unit, unit.and_then(seconds_of), table.f64(column)) {
        (Some(unit), None, _) => unknown(format!("its unit, `{unit}`, is none of time")),
        (_, _, Err(_)) => unknown("it does not hold numbers".into()),
        (_, own, Ok(values)) => {
            let factor = own.map_or(factor, |(_, seconds)| seconds);
            let seconds: Vec<f64> = values.iter().map(|v| factor * v).collect();
            match seconds.iter().position(|s| !(s.is_finite() && *s > 0.0)) {
                None => Ok(seconds),
                Some(row) => {
                    let n = seconds.iter().filter(|s| !(s.is_finite() && **s > 0.0)).count();
                    unknown(format!(
                        "{n} of its {} values are not above 0 (the first in row {}: {})",
                        seconds.len(),
                        row + 1,
                        values[row]
                    ))
                }
            }
        }
    };
    Some(Exposures { column: column.to_owned(), seconds })
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
    let missing = |asked: &str, what: &str| {
        let all: Vec<&str> = table.columns.iter().map(|c| c.name.as_str()).collect();
        let found = format!("the columns {}", crate::text::listed(all));
        ParseError::new(path, found, format!("a column `{asked}` of {what}"))
    };
    // A name that was asked for is never passed over.
    if let Some(asked) = names.sigma.as_deref().filter(|name| find(table, name).is_none()) {
        return Err(missing(asked, "uncertainties"));
    }
    let name = match &names.time {
        Some(asked) => Some(find(table, asked).ok_or_else(|| missing(asked, "times"))?),
        None => usual_time(table),
    };
    let Some(name) = name else { return Ok(None) };
    // The system that the column itself refers to (VOTable), else that of the table.
    let own = table.meta.get("timesys_of").and_then(|of| of.get(name));
    let said = |key: &str| match own {
        Some(own) => own.get(key)?.as_str(),
        None => table.meta_text(key),
    };
    let system = said("timesys").or_else(|| table.meta_text("TIMESYS"));
    let system = system.or_else(|| table.meta_text("time_scale")).map(str::trim);
    let origin = Origin::of_votable(table, name, &said).or_else(|| Origin::of_fits(table, name));
    let mut read = times(path, table, name, names, system, origin)?;
    if let Some(rows) = table.meta.get("untimed_rows").and_then(serde_json::Value::as_u64) {
        read.notes.push(format!("{} without a time left out", counted(rows as usize, "row")));
    }
    let notes = table.meta.get(READING_NOTES).and_then(|notes| notes.as_array());
    read.notes.extend(notes.into_iter().flatten().filter_map(|n| n.as_str()).map(str::to_owned));
    Ok(Some((name, read)))
}

/// The column that is one of times by its name, where none is asked for.
pub(super) fn usual_time(table: &Table) -> Option<&str> {
    let names = || table.columns.iter().map(|c| c.name.as_str());
    let of_observer = |n: &str| matches!(Kind::of_name(n), Some(Kind::Jd | Kind::Mjd));
    let of_kind = |is: &dyn Fn(Kind) -> bool| names().find(|n| Kind::of_name(n).is_some_and(is));
    find(table, TEXT_TIMES[0])
        // Times of the observer before those of the Sun or of the barycentre, and of those one that names its scale.
        .or_else(|| names().find(|n| of_observer(n) && scale_of_name(n).is_some()))
        .or_else(|| names().find(|n| of_observer(n)))
        .or_else(|| of_kind(&|kind| kind != Kind::Unix))
        .or_else(|| TEXT_TIMES.iter().find_map(|name| find(table, name)))
        .or_else(|| of_kind(&|kind| kind == Kind::Unix))
        .or_else(|| {
            let of_columns = table.meta.get("timesys_of")?.as_object()?;
            find(table, of_columns.keys().next()?)
        })
}

/// The scale that a column's name says.
fn scale_of_name(name: &str) -> Option<Scale> {
    let lower = name.to_ascii_lowercase();
    lower.split(|c: char| !c.is_ascii_alphanumeric()).find_map(Scale::named)
}

/// The other half of a time whose date and time of day stand in two columns: its name, and whether it is the date.
fn other_half<'a>(table: &'a Table, name: &str) -> Option<(&'a str, bool)> {
    let texts = |name: &str| match &table.column(name).ok()?.values {
        Values::Text(texts) => Some(texts),
        _ => None,
    };
    let all = |name: &str, is: fn(&str) -> bool| {
        texts(name).is_some_and(|t| !t.is_empty() && t.iter().flatten().all(|t| is(t.trim())))
    };
    let (wants_date, is): (bool, fn(&str) -> bool) = if all(name, is_date) {
        (false, is_clock)
    } else if all(name, is_clock) {
        (true, is_date)
    } else {
        return None;
    };
    let mut others = table.columns.iter().map(|c| c.name.as_str()).filter(|n| *n != name);
    others.find(|n| all(n, is)).map(|n| (n, wants_date))
}

/// The moment that times given as numbers are counted from.
struct Origin {
    /// Modified Julian date of the origin, whole days and the rest.
    day: i64,
    part: f64,
    /// Unit of the numbers, in words, and its length in days.
    unit: &'static str,
    unit_days: f64,
    /// Added to each number before all else, in the unit.
    add: f64,
    /// Statements on the times, in words.
    notes: Vec<String>,
}

/// A unit of time in words and its length, s.
fn seconds_of(text: &str) -> Option<(&'static str, f64)> {
    Some(match text.trim().to_ascii_lowercase().as_str() {
        "d" | "day" | "days" => ("days", DAY_S),
        "h" | "hr" | "hour" | "hours" => ("hours", 3600.0),
        "min" | "minute" | "minutes" => ("minutes", 60.0),
        "s" | "sec" | "second" | "seconds" => ("seconds", 1.0),
        "ms" | "msec" | "millisecond" | "milliseconds" => ("milliseconds", 1e-3),
        "us" | "µs" | "μs" | "usec" | "microsecond" | "microseconds" => ("microseconds", 1e-6),
        _ => return None,
    })
}

/// A unit of time in words and its length, days.
fn unit_of(text: &str) -> Option<(&'static str, f64)> {
    seconds_of(text).map(|(words, seconds)| (words, seconds / DAY_S))
}

impl Origin {
    /// The origin that the header of a FITS table states (FITS 4.0, section 9.2.3; the missions' BJDREF and TIMEZERO).
    fn of_fits(table: &Table, name: &str) -> Option<Self> {
        let number = |key: &str| table.meta.get(key).and_then(serde_json::Value::as_f64);
        let (key, day, mut part) = ["MJDREF", "JDREF", "BJDREF"].iter().find_map(|key| {
            let (whole, part) = match number(&format!("{key}I")) {
                Some(whole) => (whole, number(&format!("{key}F")).unwrap_or(0.0)),
                None => (number(key)?, 0.0),
            };
            let whole_days = Some(whole.floor()).filter(|d| d.abs() < 1e7)?;
            Some((*key, whole_days as i64, part + (whole - whole_days)))
        })?;
        let mut days = day;
        if key != "MJDREF" {
            // astropy writes JDREF = 0 beside pairs of Julian dates, which are read as such.
            (days, part) = (days - MJD_OFFSET, part - 0.5);
        }
        let own = table.column(name).ok()?.unit.as_deref();
        let stated = table.meta_text("TIMEUNIT");
        // The column's unit counts before TIMEUNIT; seconds are the standard's default.
        let (unit, unit_days) = match (own.and_then(unit_of), stated.map(unit_of)) {
            (Some(unit), _) => unit,
            (None, Some(unit)) => unit?,
            (None, None) if own.is_none() => unit_of("s")?,
            (None, None) => return None,
        };
        let stated_days = stated.and_then(unit_of).map_or(unit_days, |(_, days)| days);
        let zero = number("TIMEZERO")
            .or_else(|| Some(number("TIMEZERI")? + number("TIMEZERF").unwrap_or(0.0)));
        let mut add = zero.or_else(|| number("TIMEOFFS")).unwrap_or(0.0);
        let mut notes = Vec::new();
        match (number("TIMEPIXR"), number("TIMEDEL")) {
            (Some(place), Some(bin)) if place != 0.5 && bin > 0.0 => {
                add += (0.5 - place) * bin;
                notes.push(format!("TIMEPIXR is {place}: times are moved to the middle of their bins"));
            }
            (Some(place), None) if place != 0.5 => notes.push(format!(
                "TIMEPIXR is {place}: times are not those of the middle of their bins, whose length (TIMEDEL) is not stated"
            )),
            _ => {}
        }
        add *= stated_days / unit_days;
        if key == "BJDREF" {
            notes.push(format!(
                "{name}: the light's way is counted to the barycentre of the solar system"
            ));
        } else if let Some(place) = table.meta_text("TIMEREF")
            && !matches!(place.trim().to_ascii_uppercase().as_str(), "LOCAL" | "TOPOCENTER" | "")
        {
            notes.push(format!(
                "{name}: TIMEREF says {}: times are not those of the observer",
                place.trim()
            ));
        }
        Some(Self { day: days, part, unit, unit_days, add, notes })
    }

    /// The origin of a VOTable's TIMESYS (VOTable 1.4, section 3.4): a Julian date, or the words for 0 of either kind.
    fn of_votable<'a>(
        table: &Table,
        name: &str,
        said: &impl Fn(&str) -> Option<&'a str>,
    ) -> Option<Self> {
        let origin = match said("timeorigin")?.trim() {
            "MJD-origin" => 2_400_000.5,
            "JD-origin" => 0.0,
            number => number.parse::<f64>().ok().filter(|n| n.abs() < 1e7)?,
        };
        let (unit, unit_days) = unit_of(table.column(name).ok()?.unit.as_deref()?)?;
        let (day, part) = (origin.floor(), origin - origin.floor() - 0.5);
        let mut notes = Vec::new();
        if let Some(place) = said("refposition").map(str::trim)
            && !matches!(place, "TOPOCENTER" | "UNKNOWN" | "")
        {
            notes.push(format!("{name}: times are those at the reference position {place}"));
        }
        Some(Self { day: day as i64 - MJD_OFFSET, part, unit, unit_days, add: 0.0, notes })
    }

    fn moment(&self, number: f64, scale: Scale) -> Option<Epoch> {
        let days = Some((number + self.add) * self.unit_days).filter(|d| d.abs() < 1e7)?;
        moment(self.day.checked_add(days.floor() as i64)?, self.part + (days - days.floor()), scale)
    }

    fn notes(&self, name: &str, scale: Scale) -> Vec<String> {
        let mut notes =
            vec![format!("{name}: {} since MJD {}", self.unit, self.day as f64 + self.part)];
        if scale == Scale::Utc && self.unit_days < 1.0 {
            notes.push(format!(
                "{name}: every day of UTC is counted as 86400 s, so that leap seconds are not in it"
            ));
        }
        notes.extend(self.notes.iter().cloned());
        notes
    }
}

/// Times of one column.
fn times(
    path: &Path,
    table: &Table,
    name: &str,
    names: &ColumnNames,
    system: Option<&str>,
    origin: Option<Origin>,
) -> Result<ColumnTimes, ParseError> {
    let in_row = |error: ParseError, row: usize| error.in_field(format!("{name}, row {}", row + 1));
    let half = other_half(table, name);
    // As astropy notes a column of Time in ECSV.
    let kept = || {
        let column = table.meta.get("__serialized_columns__")?.get(name)?;
        Scale::named(column.get("scale")?.as_str()?)
    };
    let is_mission = matches!(name.to_ascii_lowercase().as_str(), "bkjd" | "btjd");
    let mission = is_mission.then_some(Scale::Tdb);
    let named = scale_of_name(name).or_else(|| scale_of_name(half?.0)).or(mission).or_else(kept);
    let scale = names.scale.or(named).or_else(|| Scale::named(system?));
    let unknown = |kind: &str| {
        if let Some(system) = system.filter(|s| !s.is_empty()) {
            let error = ParseError::new(
                path,
                format!("the time system `{system}`"),
                "UTC, TAI, TT, TDB or GPS",
            );
            return error.in_field(name.to_owned()).with_hint("--time-scale sets another one");
        }
        let error = ParseError::new(path, format!("`{name}`"), "a time whose scale is named");
        error.in_field(name.to_owned()).with_hint(format!(
            "call the column {kind}_utc, {kind}_tai, {kind}_tt or {kind}_tdb, or give --time-scale: scales differ by more than a minute"
        ))
    };
    let Ok(column) = table.column(name) else {
        return Err(ParseError::new(path, "no such column", "times").in_field(name.to_owned()));
    };
    if let Values::Text(texts) = &column.values {
        let whole = |row: usize, text: &str| {
            let text = text.trim().replace(',', ".");
            let other = half.and_then(|(other, is_date)| {
                let Ok(Values::Text(others)) = table.column(other).map(|c| &c.values) else {
                    return None;
                };
                Some((others.get(row)?.as_deref()?.trim().replace(',', "."), is_date))
            });
            match other {
                Some((date, true)) => format!("{date}T{text}"),
                Some((clock, false)) => format!("{text}T{clock}"),
                None => text,
            }
        };
        let mut time = Vec::with_capacity(texts.len());
        // A text that ends with Z or an offset says itself what it is.
        let mut all_zoned = true;
        for (row, text) in texts.iter().enumerate() {
            let text = whole(row, text.as_deref().unwrap_or(""));
            match parse_zoned(&text) {
                Ok((epoch, is_zoned)) => {
                    all_zoned &= is_zoned;
                    time.push(epoch);
                }
                Err(error) => return Err(in_row(error.in_file(path), row)),
            }
        }
        let zone = table.meta_text(TIME_ZONE);
        let local = [Some(name), half.map(|(other, _)| other), zone].into_iter().flatten();
        let local = local.filter_map(|text| Some((text, local_word(text)?))).next();
        if let Some((text, word)) = local.filter(|_| !all_zoned && names.scale.is_none()) {
            let zone = match word.as_str() {
                "local" | "lt" | "loc" | "lmt" => "local time".to_owned(),
                word => word.to_uppercase(),
            };
            let expected = format!("times in UTC, not in {zone}");
            let error = ParseError::new(path, format!("`{text}`"), expected);
            return Err(error.in_field(name.to_owned()).with_hint(
                "take off the zone's offset and call the column time_utc, or write it behind each time (20:00:00+02:00); --time-scale utc says that they are UTC all the same",
            ));
        }
        let mut notes: Vec<String> =
            half.map(|(other, _)| format!("{name} and {other} are one time")).into_iter().collect();
        match scale {
            Some(Scale::Utc) => {}
            None if all_zoned => {}
            // A system that is not known is no UTC.
            None if system.is_some_and(|s| !s.is_empty()) => return Err(unknown("time")),
            None => notes.push(format!("{name}: times without a scale or an offset are UTC")),
            Some(_) => {
                let error =
                    ParseError::new(path, format!("times as text in {name}"), "UTC as text");
                return Err(error
                    .in_field(name.to_owned())
                    .with_hint("give other scales as Julian dates"));
            }
        }
        return Ok(ColumnTimes { time, notes });
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
    let named = Kind::of_name(name);
    if let (Some(origin), Ok(numbers), None, None) =
        (&origin, table.f64(name), names.format, named.filter(|kind| *kind != Kind::Unix))
    {
        let Some(scale) = scale else { return Err(unknown("time")) };
        let time = numbers.iter().enumerate().map(|(row, number)| {
            origin.moment(*number, scale).ok_or_else(|| {
                let expected = format!("{} that give a date from 1972 to 2100", origin.unit);
                in_row(ParseError::new(path, number.to_string(), expected), row)
            })
        });
        let time = time.collect::<Result<_, _>>()?;
        return Ok(ColumnTimes { time, notes: origin.notes(name, scale) });
    }
    let not_numbers = |expected: &str| {
        ParseError::new(path, column.values.kind(), expected).in_field(name.to_owned())
    };
    let Ok(numbers) = table.f64(name) else { return Err(not_numbers("numbers")) };
    let mut notes = Vec::new();
    let kind = match names.format {
        Some(TimeFormat::Seconds) => return from_any(path, name, &numbers, ("seconds", 1.0)),
        Some(TimeFormat::Days) => return from_any(path, name, &numbers, ("days", DAY_S)),
        Some(TimeFormat::Iso) => return Err(not_numbers("texts by ISO 8601")),
        // What a name says of the light's way stays.
        Some(TimeFormat::Jd) => {
            named.filter(|k| matches!(k, Kind::Bjd | Kind::Hjd)).unwrap_or(Kind::Jd)
        }
        Some(TimeFormat::Mjd) => Kind::Mjd,
        Some(TimeFormat::Unix) => Kind::Unix,
        None => match (named, Kind::of_size(&numbers)) {
            (Some(kind), _) => kind,
            (None, Some(kind)) => {
                let words = match kind {
                    Kind::Unix => "Unix time",
                    Kind::Mjd => "modified Julian dates",
                    _ => "Julian dates",
                };
                notes.push(format!("{name}: taken for {words}, by the size of its numbers"));
                kind
            }
            (None, None) => {
                let error = not_numbers("ISO 8601, or a column called jd_… or mjd_…");
                return Err(error.with_hint(
                    "--time-format jd, mjd, unix, s or d (seconds or days from any moment) says what its numbers are",
                ));
            }
        },
    };
    let (words, scale) = match kind {
        Kind::Unix => ("unix", Some(Scale::Utc)),
        Kind::Mjd => ("mjd", scale),
        Kind::Bjd => ("bjd", scale),
        Kind::Hjd => ("hjd", scale),
        Kind::Jd => ("jd", scale),
    };
    let Some(scale) = scale else { return Err(unknown(words)) };
    // Whole dates stand in columns with such names, too.
    let off = taken_off(name).filter(|_| !matches!(kind, Kind::Unix | Kind::Mjd));
    let off = off.filter(|_| Kind::of_size(&numbers) != Some(Kind::Jd));
    let time = numbers.iter().enumerate().map(|(row, number)| {
        let time = match (kind, off) {
            (Kind::Unix, _) => of_unix(*number),
            (_, Some((days, part))) => {
                let rest = number + part - 0.5;
                let whole = Some(rest.floor()).filter(|d| d.abs() < 1e7);
                whole.and_then(|whole| {
                    moment(days + whole as i64 - MJD_OFFSET, rest - whole, scale)
                })
            }
            _ => of_julian(*number, kind == Kind::Mjd, scale),
        };
        time.ok_or_else(|| {
            let error = ParseError::new(path, number.to_string(), "a date from 1972 to 2100");
            let error = in_row(error, row);
            match kind {
                Kind::Unix => error,
                _ => error.with_hint(
                    "where days are taken off, the column's name says which: JD-2450000, btjd, bkjd; --time-format d reads days from any moment",
                ),
            }
        })
    });
    let time = time.collect::<Result<_, _>>()?;
    match kind {
        _ if off.is_some() => {
            let (days, part) = off.unwrap_or_default();
            notes.push(format!("{name}: days since the Julian date {}", days as f64 + part));
        }
        Kind::Mjd => {}
        Kind::Unix => notes.push(format!("{name}: Unix time, in which leap seconds are left out")),
        _ => notes.push(format!("{name}: a Julian date in a double is good to 40 µs")),
    }
    match kind {
        Kind::Bjd => notes.push(format!(
            "{name}: the light's way is counted to the barycentre of the solar system"
        )),
        Kind::Hjd => notes.push(format!("{name}: the light's way is counted to the Sun")),
        _ => {}
    }
    Ok(ColumnTimes { time, notes })
}

/// A moment of Unix time: every day of UTC has 86,400 s in it.
fn of_unix(seconds: f64) -> Option<Epoch> {
    const MJD_1970: i64 = 40_587;
    let days = Some((seconds / DAY_S).floor()).filter(|d| d.abs() < 1e7)?;
    moment(MJD_1970 + days as i64, (seconds - days * DAY_S) / DAY_S, Scale::Utc)
}

/// Seconds or days from a moment that nobody knows: dates from 2000 on stand for it.
fn from_any(
    path: &Path,
    name: &str,
    numbers: &[f64],
    (unit, unit_s): (&str, f64),
) -> Result<ColumnTimes, ParseError> {
    const FROM: &str = "2000-01-01T00:00:00Z";
    let first = parse_utc(FROM).map_err(|e| e.in_file(path))?;
    let time = numbers.iter().enumerate().map(|(row, number)| {
        let s = number * unit_s;
        if s.abs() < 8e8 {
            return Ok(first + Duration::from_seconds(s));
        }
        let expected = format!("{unit}, less than 25 years of them");
        let error = ParseError::new(path, number.to_string(), expected);
        Err(error.in_field(format!("{name}, row {}", row + 1)))
    });
    let notes = vec![format!(
        "{name}: {unit} from a moment that is not known: the dates, from {FROM} on, are made up"
    )];
    Ok(ColumnTimes { time: time.collect::<Result<_, _>>()?, notes })
}
