//! UTC as text, leap seconds included: ISO 8601 ↔ [`hifitime::Epoch`].
//!
//! hifitime 4.3 cannot be used for this by itself: it parses `2016-12-31T23:59:60.5` to the same instant as
//! `…23:59:59.5` and never prints a second 60. Here a UTC text becomes a **TAI** epoch, which holds a leap second as
//! any other, and all arithmetic is in whole nanoseconds. Print an epoch with [`format_utc`] or [`format_utc_shortest`], not with
//! its `Display`, which would show TAI.
//!
//! Between 1972 and 2100; after the last leap second known (2016-12-31) TAI − UTC stays 37 s.

mod scale;

pub use scale::{Scale, moment, parse_in};

use crate::error::ParseError;
use hifitime::{Duration, Epoch, TimeScale};
use std::borrow::Cow;
use std::fmt;
use std::path::Path;

/// TAI − UTC in seconds from 0 h UTC of a day on (day as Modified Julian Date): the day after each leap second.
/// Source: IERS Bulletin C (<https://hpiers.obspm.fr/iers/bul/bulc/Leap_Second.dat>), Bulletins C 1 to 70.
const TAI_MINUS_UTC: [(i64, i64); 28] = [
    (41317, 10),
    (41499, 11),
    (41683, 12),
    (42048, 13),
    (42413, 14),
    (42778, 15),
    (43144, 16),
    (43509, 17),
    (43874, 18),
    (44239, 19),
    (44786, 20),
    (45151, 21),
    (45516, 22),
    (46247, 23),
    (47161, 24),
    (47892, 25),
    (48257, 26),
    (48804, 27),
    (49169, 28),
    (49534, 29),
    (50083, 30),
    (50630, 31),
    (51179, 32),
    (53736, 33),
    (54832, 34),
    (56109, 35),
    (57204, 36),
    (57754, 37),
];

/// Modified Julian Date of hifitime's TAI reference, 1900-01-01.
const MJD_1900: i64 = 15020;
/// Modified Julian Date of 2100-12-31, the last day that is read.
const MJD_2100_LAST: i64 = 88433;
const SECONDS_A_DAY: i64 = 86_400;
const NANOSECONDS: i128 = 1_000_000_000;
const DAY_NS: i128 = 86_400 * NANOSECONDS;
const FORM: &str = "UTC as 2026-03-04T05:06:07.89Z";

/// A text that is not a UTC time.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UtcError {
    /// Text that was found.
    pub found: String,
    /// Form that was expected in its place.
    pub expected: &'static str,
    /// Advice on how to correct it.
    pub hint: Option<&'static str>,
}

impl UtcError {
    /// The same as an error of a file; add the line and the field.
    pub fn in_file(self, path: impl AsRef<Path>) -> ParseError {
        self.in_file_at(path.as_ref())
    }

    fn in_file_at(self, path: &Path) -> ParseError {
        let error = ParseError::new(path, self.found, self.expected);
        match self.hint {
            Some(hint) => error.with_hint(hint),
            None => error,
        }
    }
}

impl fmt::Display for UtcError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "found {}, expected {}", self.found, self.expected)?;
        self.hint.map_or(Ok(()), |hint| write!(f, " ({hint})"))
    }
}

impl std::error::Error for UtcError {}

/// The instant of a UTC text such as `2016-12-31T23:59:60.5Z`.
///
/// The `Z` may be left out, a blank may stand for the `T`, a date alone is its midnight, seconds may be left out and
/// have up to nine decimals. Second 60 is accepted where the IERS put a leap second, and is an instant of its own. An
/// offset such as `+01:00` is refused: times in files are UTC. Years 1972 to 2100. The epoch is in TAI.
///
/// # Errors
/// [`UtcError`] says what stands there and what should.
pub fn parse_utc(text: &str) -> Result<Epoch, UtcError> {
    let (date, time) = split(text.strip_suffix(['Z', 'z']).unwrap_or(text));
    Digits::read(text, date, time, 0, true)?.utc(text)
}

/// The instant of a text as other programs write it: [`parse_utc`]'s forms, with an offset from UTC such as `+02:00`, `-0500` or `+00`; with strokes in a date that
/// begins with the year (`2024/03/05`), with the day of the year (`2024-065`), or with dots and the day first (`05.03.2024`). Decimals of a second beyond the ninth are left
/// out. Also whether the text says itself that it is UTC: an offset, or a `Z`.
///
/// Dates with strokes that end with the year are refused: some write the day first, some the month. With dots it is the day everywhere (Unicode CLDR).
///
/// # Errors
/// [`UtcError`] says what stands there and what should.
///
/// ```
/// use sunglint_formats::time::{format_utc, parse_zoned};
///
/// let (time, is_zoned) = parse_zoned("2024/03/05 20:00:00.5+02:00")?;
/// assert_eq!((format_utc(time, 1).as_str(), is_zoned), ("2024-03-05T18:00:00.5Z", true));
/// assert_eq!(parse_zoned("05.03.2024 18:00:00.5")?, (time, false));
/// assert_eq!(parse_zoned("2024-065T18:00:00.5")?, (time, false));
/// # Ok::<(), sunglint_formats::time::UtcError>(())
/// ```
pub fn parse_zoned(text: &str) -> Result<(Epoch, bool), UtcError> {
    let text = text.trim();
    let body = text.strip_suffix(['Z', 'z']).unwrap_or(text);
    let mut is_zoned = body.len() < text.len();
    let (date, clock) = split(body);
    let date = calendar(text, date)?;
    let sign_at = clock.and_then(|clock| clock.rfind(['+', '-'])).filter(|_| !is_zoned);
    let (clock, ahead_min) = match (clock, sign_at) {
        (Some(clock), Some(at)) => {
            let offset = offset_min(&clock[at..]).ok_or_else(|| UtcError {
                found: crate::error::excerpt(text),
                expected: FORM,
                hint: None,
            })?;
            is_zoned = true;
            (Some(clock[..at].trim_end()), offset)
        }
        _ => (clock, 0),
    };
    let at = Digits::read(text, &date, clock.map(nine_decimals), ahead_min, true)?;
    Ok((at.utc(text)?, is_zoned))
}

/// Minutes ahead of UTC of `+02:00`, `-0500` or `+00`.
fn offset_min(text: &str) -> Option<i64> {
    let digits = text.get(1..)?;
    let sign = if text.starts_with('-') { -1 } else { 1 };
    let [hours, minutes] = match digits.len() {
        2 => numbers(digits, ':', [2]).map(|[h]| [h, 0])?,
        4 if digits.is_ascii() => [number(&digits[..2])?, number(&digits[2..])?],
        _ => numbers(digits, ':', [2, 2])?,
    };
    (hours <= 15 && minutes < 60).then_some(sign * (hours * 60 + minutes))
}

/// The date and the time of day of a text.
fn split(body: &str) -> (&str, Option<&str>) {
    match body.split_once(['T', 't', ' ']) {
        Some((date, clock)) => (date, Some(clock)),
        None => (body, None),
    }
}

/// A time of day with nine decimals of its seconds at most.
fn nine_decimals(clock: &str) -> &str {
    match clock.split_once('.') {
        Some((whole, digits)) if digits.len() > 9 && digits.bytes().all(|b| b.is_ascii_digit()) => {
            &clock[..whole.len() + 10]
        }
        _ => clock,
    }
}

/// A date of another form as year-month-day; one that is none of these as it is. `text` is what errors show.
fn calendar<'a>(text: &str, date: &'a str) -> Result<Cow<'a, str>, UtcError> {
    let bad = |expected, hint| UtcError { found: crate::error::excerpt(text), expected, hint };
    if let Some([year, day]) = numbers(date, '-', [4, 3]) {
        let days = if days_in_month(year, 2) == 29 { 366 } else { 365 };
        if !(1..=days).contains(&day) {
            return Err(bad("a day of the year, 001 to 365, or 366 in a leap year", None));
        }
        let (year, month, day) = date_of(mjd_of(year, 1, 1) + day - 1);
        return Ok(format!("{year:04}-{month:02}-{day:02}").into());
    }
    if date.as_bytes().get(4) == Some(&b'/') {
        return Ok(date.replacen('/', "-", 2).into());
    }
    let parts: Vec<&str> = date.split(['.', '/', '-']).collect();
    let [first, second, year] = parts.as_slice() else { return Ok(date.into()) };
    let is_short = |part: &str| matches!(part.len(), 1 | 2);
    let all_digits = parts.iter().all(|part| part.bytes().all(|b| b.is_ascii_digit()));
    if !all_digits || !is_short(first) || !is_short(second) {
        return Ok(date.into());
    }
    if year.len() == 4 && !date.contains(['/', '-']) {
        return Ok(format!("{year}-{second:0>2}-{first:0>2}").into());
    }
    let hint = "the day or the month may be the first of them: write 2021-04-03, or 03.04.2021 with the day first";
    Err(bad(FORM, Some(hint)))
}

/// A day and the time on it, as their digits say.
struct Digits {
    mjd: i64,
    /// Since the begin of the day.
    nanoseconds: i128,
}

impl Digits {
    /// The digits of a date and a time of day so many minutes ahead; second 60 where `has_leap_seconds` and there was one. `text` is what errors show.
    fn read(
        text: &str,
        date: &str,
        time: Option<&str>,
        ahead_min: i64,
        has_leap_seconds: bool,
    ) -> Result<Self, UtcError> {
        let bad = |expected, hint| UtcError { found: crate::error::excerpt(text), expected, hint };
        let expected =
            if has_leap_seconds { FORM } else { "a time such as 2026-03-04T05:06:07.89" };
        let form = || bad(expected, None);
        if let Some(time) = time
            && time.contains(['+', '-'])
        {
            let hint =
                has_leap_seconds.then_some("times are UTC: subtract the offset and end with Z");
            return Err(bad(expected, hint));
        }
        let [year, month, day] = numbers(date, '-', [4, 2, 2]).ok_or_else(form)?;
        let (clock, nanoseconds) = match time {
            None => ([0, 0, 0], 0),
            Some(time) => clock(time).ok_or_else(form)?,
        };
        let [hour, minute, second] = clock;
        if !(1972..=2100).contains(&year) {
            return Err(bad(
                "a year from 1972 to 2100",
                Some("UTC has whole leap seconds since 1972"),
            ));
        }
        if !(1..=12).contains(&month) || !(1..=days_in_month(year, month)).contains(&day) {
            return Err(bad("a day of the calendar", None));
        }
        // The minute of UTC: a leap second is at the end of a day of UTC, whatever the clock's offset.
        let minutes = mjd_of(year, month, day) * 1440 + hour * 60 + minute - ahead_min;
        let (mjd, minute_of_day) = (minutes.div_euclid(1440), minutes.rem_euclid(1440));
        let leap = has_leap_seconds && minute_of_day == 1439 && ends_with_leap_second(mjd);
        if second == 60 && !leap && hour < 24 && minute < 60 {
            let hint = "a second 60 is only at the end of a day for which the IERS announced one";
            let other = "only UTC has a second 60";
            return Err(bad(
                "a second from 0 to 59",
                Some(if has_leap_seconds { hint } else { other }),
            ));
        }
        if hour > 23 || minute > 59 || second > 60 {
            return Err(bad("a time of day from 00:00:00 to 23:59:59", None));
        }
        let seconds = minute_of_day * 60 + second;
        Ok(Self { mjd, nanoseconds: i128::from(seconds) * NANOSECONDS + i128::from(nanoseconds) })
    }

    fn outside(&self, text: &str) -> UtcError {
        let found = crate::error::excerpt(text);
        UtcError { found, expected: "a year from 1972 to 2100", hint: None }
    }

    /// The instant, where they are digits of UTC.
    fn utc(&self, text: &str) -> Result<Epoch, UtcError> {
        let day = UtcDay::of_mjd(self.mjd).ok_or_else(|| self.outside(text))?;
        let tai = day.start_tai_ns + self.nanoseconds;
        Ok(Epoch::from_tai_duration(Duration::from_total_nanoseconds(tai)))
    }
}

/// An instant as UTC text with `digits` decimals of a second (at most 9, which lose nothing) and a `Z`:
/// `2016-12-31T23:59:60.5Z`. Rounded to the nearest, half away from zero; second 60 is only printed in a leap second.
///
/// Works for every epoch; before 1972, where UTC had no whole leap seconds, it takes TAI − UTC = 10 s.
pub fn format_utc(epoch: Epoch, digits: u8) -> String {
    let digits = digits.min(9);
    let grid = 10_i128.pow(u32::from(9 - digits));
    // Seconds of UTC and of TAI begin together since 1972, so rounding TAI rounds UTC.
    let tai = (tai_nanoseconds(epoch) + grid / 2).div_euclid(grid) * grid;
    let (tai_seconds, nanoseconds) = (tai.div_euclid(NANOSECONDS), tai.rem_euclid(NANOSECONDS));
    let tai_seconds = tai_seconds as i64; // hifitime's range is 1e14 s
    let (days, second_of_day) = utc_of(tai_seconds);
    let (year, month, day) = date_of(days + MJD_1900);
    let second_60 = (second_of_day - (SECONDS_A_DAY - 1)).max(0); // 1 in a leap second
    let s = second_of_day - second_60;
    let mut text = format!(
        "{year:04}-{month:02}-{day:02}T{:02}:{:02}:{:02}",
        s / 3600,
        s / 60 % 60,
        s % 60 + second_60
    );
    if digits > 0 {
        let fraction = nanoseconds / grid;
        text.push_str(&format!(".{fraction:0width$}", width = usize::from(digits)));
    }
    text.push('Z');
    text
}

/// An instant as UTC text to the nanosecond, without zeros at the end of the fraction: `2026-03-04T05:06:00Z`,
/// `2026-03-04T05:06:00.1Z`. It loses nothing; see [`format_utc`].
pub fn format_utc_shortest(epoch: Epoch) -> String {
    let text = format_utc(epoch, 9);
    // With nine decimals there is a point, so no zero of the seconds goes.
    let digits = text.trim_end_matches('Z').trim_end_matches('0').trim_end_matches('.');
    format!("{digits}Z")
}

/// Nanoseconds of TAI since 1900-01-01, exact. An epoch in hifitime's UTC cannot hold a leap second.
pub fn tai_nanoseconds(epoch: Epoch) -> i128 {
    if epoch.time_scale != TimeScale::UTC {
        return epoch.to_tai_duration().total_nanoseconds();
    }
    // hifitime looks its leap seconds up by a rounded f64; this does it in whole numbers.
    let utc = epoch.duration.total_nanoseconds();
    let days = utc.div_euclid(NANOSECONDS * i128::from(SECONDS_A_DAY)) as i64;
    utc + i128::from(tai_minus_utc(days + MJD_1900)) * NANOSECONDS
}

/// One day of UTC, 1972 to 2100, which a leap second makes longer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UtcDay {
    /// Modified Julian Date of the day.
    pub mjd: i64,
    /// TAI − UTC on it, s.
    pub tai_minus_utc_s: i64,
    /// First instant of the day, nanoseconds of TAI since 1900-01-01.
    pub start_tai_ns: i128,
    /// Length of the day, nanoseconds: of 86,400 s or 86,401 s.
    pub length_ns: i128,
}

impl UtcDay {
    /// The day of a Modified Julian Date; `None` before 1972 or after 2100.
    pub fn of_mjd(mjd: i64) -> Option<Self> {
        if !(TAI_MINUS_UTC[0].0..=MJD_2100_LAST).contains(&mjd) {
            return None;
        }
        let (today, tomorrow) = (tai_minus_utc(mjd), tai_minus_utc(mjd + 1));
        Some(Self {
            mjd,
            tai_minus_utc_s: today,
            start_tai_ns: i128::from((mjd - MJD_1900) * SECONDS_A_DAY + today) * NANOSECONDS,
            length_ns: i128::from(SECONDS_A_DAY + tomorrow - today) * NANOSECONDS,
        })
    }

    /// The day in which an epoch lies; `None` before 1972 or after 2100.
    pub fn containing(epoch: Epoch) -> Option<Self> {
        let tai_ns = tai_nanoseconds(epoch);
        let day_ns = i128::from(SECONDS_A_DAY) * NANOSECONDS;
        let guess = i64::try_from(tai_ns.div_euclid(day_ns)).ok()? + MJD_1900;
        // TAI is ahead of UTC, so the guess is right or one day late.
        let day = Self::of_mjd(guess).filter(|day| tai_ns >= day.start_tai_ns);
        day.or_else(|| {
            Self::of_mjd(guess - 1).filter(|day| tai_ns < day.start_tai_ns + day.length_ns)
        })
    }
}

/// Days since 1900-01-01 and second of the day (86400 in a leap second) of a second of TAI since 1900.
fn utc_of(tai_seconds: i64) -> (i64, i64) {
    let start = |mjd: i64, offset: i64| (mjd - MJD_1900) * SECONDS_A_DAY + offset;
    let next = TAI_MINUS_UTC.iter().position(|&(mjd, offset)| start(mjd, offset) > tai_seconds);
    let offset = match next {
        None => TAI_MINUS_UTC[TAI_MINUS_UTC.len() - 1].1,
        Some(0) => TAI_MINUS_UTC[0].1,
        Some(next) => {
            let (mjd, offset) = TAI_MINUS_UTC[next];
            if tai_seconds == start(mjd, offset) - 1 {
                return (mjd - 1 - MJD_1900, SECONDS_A_DAY);
            }
            TAI_MINUS_UTC[next - 1].1
        }
    };
    let utc = tai_seconds - offset;
    (utc.div_euclid(SECONDS_A_DAY), utc.rem_euclid(SECONDS_A_DAY))
}

fn tai_minus_utc(mjd: i64) -> i64 {
    let after = TAI_MINUS_UTC.partition_point(|&(from, _)| from <= mjd);
    TAI_MINUS_UTC[after.saturating_sub(1)].1
}

fn ends_with_leap_second(mjd: i64) -> bool {
    TAI_MINUS_UTC[1..].iter().any(|&(from, _)| from == mjd + 1)
}

/// `HH:MM`, `HH:MM:SS` or `HH:MM:SS.fff`: hour, minute, second and nanoseconds, not yet checked for range.
fn clock(time: &str) -> Option<([i64; 3], i64)> {
    let (whole, fraction) = match time.split_once('.') {
        Some((whole, fraction)) => (whole, Some(fraction)),
        None => (time, None),
    };
    let nanoseconds = match fraction {
        None => 0,
        Some(digits) if (1..=9).contains(&digits.len()) => {
            number(digits)? * 10_i64.pow(9 - digits.len() as u32)
        }
        Some(_) => return None,
    };
    if whole.len() == 5 && fraction.is_none() {
        let [hour, minute] = numbers(whole, ':', [2, 2])?;
        return Some(([hour, minute, 0], 0));
    }
    Some((numbers(whole, ':', [2, 2, 2])?, nanoseconds))
}

/// The numbers between separators, each with exactly so many digits.
fn numbers<const N: usize>(text: &str, separator: char, widths: [usize; N]) -> Option<[i64; N]> {
    let mut parts = text.split(separator);
    let mut values = [0; N];
    for (value, width) in values.iter_mut().zip(widths) {
        *value = number(parts.next().filter(|part| part.len() == width)?)?;
    }
    parts.next().is_none().then_some(values)
}

fn number(digits: &str) -> Option<i64> {
    digits.bytes().all(|b| b.is_ascii_digit()).then(|| digits.parse().ok())?
}

fn days_in_month(year: i64, month: i64) -> i64 {
    let leap_year = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    match month {
        2 if leap_year => 29,
        2 => 28,
        4 | 6 | 9 | 11 => 30,
        _ => 31,
    }
}

/// Modified Julian Date of a day of the Gregorian calendar (Fliegel and Van Flandern's reckoning from 1 March).
fn mjd_of(year: i64, month: i64, day: i64) -> i64 {
    let (y, m) = if month <= 2 { (year - 1, month + 9) } else { (year, month - 3) };
    365 * y + y.div_euclid(4) - y.div_euclid(100) + y.div_euclid(400) + (153 * m + 2) / 5 + day
        - 678_882
}

/// The day of the Gregorian calendar of a Modified Julian Date.
fn date_of(mjd: i64) -> (i64, i64, i64) {
    const DAYS_IN_400_YEARS: i64 = 146_097;
    let days = mjd + 678_881; // since 0000-03-01
    let (era, day_of_era) =
        (days.div_euclid(DAYS_IN_400_YEARS), days.rem_euclid(DAYS_IN_400_YEARS));
    let year_of_era =
        (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let m = (5 * day_of_year + 2) / 153; // March is 0
    let (year, month) = if m < 10 { (0, m + 3) } else { (1, m - 9) };
    (year + year_of_era + 400 * era, month, day_of_year - (153 * m + 2) / 5 + 1)
}

/// A UTC time as a value of a TOML file: text, or TOML's own date and time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Utc(pub Epoch);

impl<'de> serde::Deserialize<'de> for Utc {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Text;
        impl serde::de::Visitor<'_> for Text {
            type Value = Utc;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(FORM)
            }
            fn visit_str<E: serde::de::Error>(self, text: &str) -> Result<Utc, E> {
                parse_utc(text).map(Utc).map_err(|error| {
                    E::invalid_value(serde::de::Unexpected::Str(text), &error.expected)
                })
            }
        }
        deserializer.deserialize_str(Text)
    }
}

impl serde::Serialize for Utc {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&format_utc(self.0, 9))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tai_seconds(text: &str) -> f64 {
        tai_nanoseconds(parse_utc(text).unwrap()) as f64 * 1e-9
    }

    #[test]
    fn a_leap_second_is_an_instant_of_its_own() {
        // IERS Bulletin C 52: 2016 December 31, 23h 59m 60s; TAI - UTC = 36 s before, 37 s after.
        let before = parse_utc("2016-12-31T23:59:59.5Z").unwrap();
        let within = parse_utc("2016-12-31T23:59:60.5Z").unwrap();
        let after = parse_utc("2017-01-01T00:00:00.5Z").unwrap();
        assert_eq!((within - before).total_nanoseconds(), 1_000_000_000);
        assert_eq!((after - within).total_nanoseconds(), 1_000_000_000);
        assert_eq!(format_utc(before, 1), "2016-12-31T23:59:59.5Z");
        assert_eq!(format_utc(within, 1), "2016-12-31T23:59:60.5Z");
        assert_eq!(format_utc(after, 1), "2017-01-01T00:00:00.5Z");
    }

    /// Truth: by hand; the leap second of 2016 fell at 01:59:60 of the next day in a clock two hours ahead.
    #[test]
    fn offsets_are_taken_off() {
        let zoned = |text: &str| parse_zoned(text).map(|(time, is)| (format_utc(time, 1), is));
        for (text, utc, is_zoned) in [
            ("2024-03-05T20:00:00.5+02:00", "2024-03-05T18:00:00.5Z", true),
            ("2024-03-05T20:00:00+0200", "2024-03-05T18:00:00.0Z", true),
            ("2024-03-05 12:30:00-05:30", "2024-03-05T18:00:00.0Z", true),
            ("2024-01-01T00:30:00+01", "2023-12-31T23:30:00.0Z", true),
            ("2017-01-01T01:59:60.5+02:00", "2016-12-31T23:59:60.5Z", true),
            ("2024/03/05T18:00:00Z", "2024-03-05T18:00:00.0Z", true),
            ("2024/03/05 18:00:00", "2024-03-05T18:00:00.0Z", false),
            ("2024-03-05", "2024-03-05T00:00:00.0Z", false),
        ] {
            assert_eq!(zoned(text).unwrap(), (utc.to_owned(), is_zoned), "{text}");
        }
        for text in [
            "2016-12-31T23:59:60+02:00",
            "2024-03-05T20:00:00+99:00",
            "2024-03-05T20:00:00+2",
            "05/03/2024",
            "2024-03-05T20:00:00+02:00Z",
            "1972-01-01T00:30:00+01:00",
            "+",
            "ä+é",
        ] {
            assert!(parse_zoned(text).is_err(), "{text}");
        }
    }

    #[test]
    fn known_instants() {
        // astropy 8.0.2: (Time(text, scale='utc').tai - Time('1900-01-01', scale='tai')).sec
        assert_eq!(tai_seconds("1972-01-01"), 2_272_060_810.0);
        assert_eq!(tai_seconds("2000-01-01T12:00:00Z"), 3_155_716_832.0);
        assert_eq!(tai_seconds("2016-12-31T23:59:60.5"), 3_692_217_636.5);
        assert_eq!(tai_seconds("2100-12-31 23:59"), 6_342_969_577.0);
    }

    #[test]
    fn rounding_carries_into_and_out_of_the_leap_second() {
        let at = |text| parse_utc(text).unwrap();
        assert_eq!(format_utc(at("2016-12-31T23:59:59.96"), 1), "2016-12-31T23:59:60.0Z");
        assert_eq!(format_utc(at("2016-12-31T23:59:60.96"), 1), "2017-01-01T00:00:00.0Z");
        assert_eq!(format_utc(at("2016-12-30T23:59:59.96"), 1), "2016-12-31T00:00:00.0Z");
        assert_eq!(
            format_utc(at("2026-02-28T23:59:59.999999999"), 6),
            "2026-03-01T00:00:00.000000Z"
        );
        assert_eq!(
            format_utc(at("2026-03-04T05:06:07.123456789"), 9),
            "2026-03-04T05:06:07.123456789Z"
        );
        assert_eq!(format_utc(at("2026-03-04T05:06:07.5"), 0), "2026-03-04T05:06:08Z");
    }

    #[test]
    fn the_shortest_text_ends_where_the_zeros_begin() {
        for text in [
            "2026-03-04T05:06:00Z",
            "2026-03-04T00:00:00Z",
            "2026-03-04T05:06:10.1Z",
            "2026-03-04T05:06:10.01Z",
            "2026-03-04T05:06:10.000000001Z",
            "2016-12-31T23:59:60Z",
            "2016-12-31T23:59:60.999999999Z",
        ] {
            assert_eq!(format_utc_shortest(parse_utc(text).unwrap()), text);
        }
        let midnight = parse_utc("2000-01-10").unwrap();
        assert_eq!(format_utc_shortest(midnight), "2000-01-10T00:00:00Z");
    }

    #[test]
    fn an_epoch_in_utc_is_placed_to_the_nanosecond() {
        // Ten nanoseconds before a leap second ended the day: an f64 of seconds cannot tell.
        let epoch = Epoch::from_gregorian_utc(2015, 6, 30, 23, 59, 59, 999_999_990);
        assert_eq!(format_utc(epoch, 9), "2015-06-30T23:59:59.999999990Z");
        let epoch = Epoch::from_gregorian_utc(2026, 3, 4, 5, 6, 7, 0);
        assert_eq!(epoch, parse_utc("2026-03-04T05:06:07").unwrap());
    }

    #[test]
    fn what_is_not_utc_is_refused_with_a_reason() {
        for (text, message) in [
            (
                "2015-03-03T23:59:60",
                "found `2015-03-03T23:59:60`, expected a second from 0 to 59 (a second 60 is only at the end of a day for which the IERS announced one)",
            ),
            (
                "2016-12-31T22:59:60Z",
                "found `2016-12-31T22:59:60Z`, expected a second from 0 to 59 (a second 60 is only at the end of a day for which the IERS announced one)",
            ),
            (
                "2016-12-31T23:59:61Z",
                "found `2016-12-31T23:59:61Z`, expected a time of day from 00:00:00 to 23:59:59",
            ),
            (
                "2026-03-04T24:00:00",
                "found `2026-03-04T24:00:00`, expected a time of day from 00:00:00 to 23:59:59",
            ),
            ("2026-02-29", "found `2026-02-29`, expected a day of the calendar"),
            (
                "1969-07-20T20:17:40Z",
                "found `1969-07-20T20:17:40Z`, expected a year from 1972 to 2100 (UTC has whole leap seconds since 1972)",
            ),
            (
                "2026-03-04T05:06:07+01:00",
                "found `2026-03-04T05:06:07+01:00`, expected UTC as 2026-03-04T05:06:07.89Z (times are UTC: subtract the offset and end with Z)",
            ),
            (
                "2026-03-04T05:06:07.",
                "found `2026-03-04T05:06:07.`, expected UTC as 2026-03-04T05:06:07.89Z",
            ),
            (
                "2026-03-04T05:06:07.1234567890",
                "found `2026-03-04T05:06:07.1234567890`, expected UTC as 2026-03-04T05:06:07.89Z",
            ),
            ("4 March 2026", "found `4 March 2026`, expected UTC as 2026-03-04T05:06:07.89Z"),
            ("", "found ``, expected UTC as 2026-03-04T05:06:07.89Z"),
        ] {
            assert_eq!(parse_utc(text).unwrap_err().to_string(), message);
        }
    }

    #[test]
    fn every_day_from_1900_to_2200_comes_back() {
        // Truth: the calendar itself, counted day by day.
        let (mut year, mut month, mut day) = (1900, 1, 1);
        for mjd in MJD_1900..MJD_1900 + 110_000 {
            assert_eq!(mjd_of(year, month, day), mjd);
            assert_eq!(date_of(mjd), (year, month, day));
            day += 1;
            if day > days_in_month(year, month) {
                (day, month) = (1, month + 1);
            }
            if month > 12 {
                (month, year) = (1, year + 1);
            }
        }
    }

    #[test]
    fn epochs_far_away_print_without_panic() {
        for epoch in
            [Epoch::from_tai_duration(Duration::MIN), Epoch::from_tai_duration(Duration::MAX)]
        {
            assert!(format_utc(epoch, 9).ends_with('Z'));
            assert!(format_utc_shortest(epoch).ends_with('Z'));
        }
    }
}
