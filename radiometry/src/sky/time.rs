//! From [`hifitime::Epoch`] to the Julian dates that astronomy wants, through leap seconds.
//!
//! Why not by `hifitime` alone: a UTC-scale `Epoch` of version 4.3.1 has no second 60 (`23:59:60.5` becomes
//! `23:59:59.5`), and its TAI → UTC conversion switches 37 s too early at the leap second of 2016 (23:59:59.5 there and
//! back is 23:59:58.5). So here an instant is a count of TAI nanoseconds, ΔAT comes from SOFA's table by the calendar day, and
//! [`Utc`] goes between calendar and epoch. An `Epoch` that must be able to lie in a leap second is
//! of scale TAI, as [`Utc::to_epoch`] makes it.

use hifitime::{Duration, Epoch, TimeScale};
use std::fmt;
use std::str::FromStr;

/// Modified Julian date of 1900-01-01, where `hifitime` counts from.
const MJD_1900: i64 = 15_020;
/// Modified Julian date of 1972-01-01, the first day of UTC with leap seconds.
const MJD_1972: i64 = 41_317;
/// Modified Julian date of 3000-01-01, where the calendar here ends.
const MJD_3000: i64 = 816_788;
/// TT − TAI, s.
const TT_MINUS_TAI_S: f64 = 32.184;
const DAY_S: f64 = 86_400.0;
const DAY_NS: i128 = 86_400_000_000_000;
const SECOND_NS: i128 = 1_000_000_000;

/// What is wrong with a time.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TimeError {
    /// Before UTC had leap seconds, or too far ahead for a calendar to make sense.
    #[error(
        "{epoch} is outside 1972-01-01 to 2999-12-31, where UTC with leap seconds is defined here"
    )]
    OutsideUtc {
        /// The epoch, as text.
        epoch: String,
    },
    /// No such calendar date or time of day.
    #[error("there is no UTC time {text}: {why}")]
    NoSuchTime {
        /// The time as it was given.
        text: String,
        /// What is impossible about it.
        why: &'static str,
    },
    /// Not written as ISO 8601.
    #[error(
        "`{text}` is not a UTC time as ISO 8601 writes it: expected like 2016-12-31T23:59:60.5Z"
    )]
    NotIso {
        /// The text.
        text: String,
    },
}

/// A Julian date in two parts, so that it holds nanoseconds: `midnight` ends in .5, `fraction` is the part of
/// the day since, in [0, 1).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JulianDate {
    /// The Julian date of the last midnight, days.
    pub midnight: f64,
    /// The part of the day since midnight; in UTC a day with a leap second has 86 401 s (SOFA's quasi-JD).
    pub fraction: f64,
}

impl JulianDate {
    /// From a whole modified Julian date and the seconds since its midnight, which may lie outside the day.
    fn from_mjd_seconds(mjd: i64, seconds: f64) -> Self {
        let days = (seconds / DAY_S).floor();
        Self {
            midnight: 2_400_000.5 + mjd as f64 + days,
            fraction: (seconds - days * DAY_S) / DAY_S,
        }
    }

    /// The date as one number, days, good to about 40 µs.
    pub fn days(self) -> f64 {
        self.midnight + self.fraction
    }

    /// The modified Julian date as one number, days, good to about 1 µs.
    pub fn mjd(self) -> f64 {
        (self.midnight - 2_400_000.5) + self.fraction
    }

    /// `self − earlier` in seconds, on a scale whose days all have 86 400 s (not UTC).
    pub fn seconds_since(self, earlier: Self) -> f64 {
        ((self.midnight - earlier.midnight) + (self.fraction - earlier.fraction)) * DAY_S
    }
}

/// One instant on the time scales of astronomy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimeScales {
    /// UTC as SOFA's quasi-Julian date: the fraction of a day that may have 86 401 s.
    pub utc: JulianDate,
    /// International atomic time.
    pub tai: JulianDate,
    /// Terrestrial time, TAI + 32.184 s. It also stands for TDB, which differs by at most 1.7 ms.
    pub tt: JulianDate,
    /// Universal time, the Earth's rotation angle as a clock.
    pub ut1: JulianDate,
    /// ΔAT = TAI − UTC, s.
    pub tai_minus_utc_s: f64,
}

impl TimeScales {
    /// The scales at an epoch, UT1 from `ut1_minus_tai_s` (which, unlike UT1−UTC, does not jump; see
    /// [`Orientation`](super::Orientation)). Right to better than 1 ns.
    ///
    /// # Errors
    /// [`TimeError::OutsideUtc`] before 1972 or after 2999.
    pub fn at(epoch: Epoch, ut1_minus_tai_s: f64) -> Result<Self, TimeError> {
        let tai_ns = tai_nanoseconds(epoch)?;
        let day = UtcDay::containing(tai_ns).ok_or_else(|| outside(epoch))?;
        let tai_mjd = MJD_1900 + tai_ns.div_euclid(DAY_NS) as i64;
        let tai_s = tai_ns.rem_euclid(DAY_NS) as f64 / SECOND_NS as f64;
        Ok(Self {
            utc: JulianDate {
                midnight: 2_400_000.5 + day.mjd as f64,
                fraction: (tai_ns - day.start_tai_ns) as f64 / day.length_ns as f64,
            },
            tai: JulianDate::from_mjd_seconds(tai_mjd, tai_s),
            tt: JulianDate::from_mjd_seconds(tai_mjd, tai_s + TT_MINUS_TAI_S),
            ut1: JulianDate::from_mjd_seconds(tai_mjd, tai_s + ut1_minus_tai_s),
            tai_minus_utc_s: day.tai_minus_utc_s as f64,
        })
    }
}

/// ΔAT = TAI − UTC in s at an epoch: 37 s since 2017-01-01.
///
/// # Errors
/// [`TimeError::OutsideUtc`] before 1972 or after 2999.
pub fn tai_minus_utc_s(epoch: Epoch) -> Result<f64, TimeError> {
    let day = UtcDay::containing(tai_nanoseconds(epoch)?).ok_or_else(|| outside(epoch))?;
    Ok(day.tai_minus_utc_s as f64)
}

/// TAI seconds since 1900-01-01T00:00:00 TAI of a modified Julian date of UTC, good to 1 µs.
pub(super) fn tai_seconds_of_mjd_utc(mjd_utc: f64) -> Option<f64> {
    let whole = mjd_utc.floor();
    let day = UtcDay::of_mjd(whole as i64)?;
    Some((day.start_tai_ns as f64 + (mjd_utc - whole) * day.length_ns as f64) / SECOND_NS as f64)
}

/// TAI seconds since 1900-01-01T00:00:00 TAI of an epoch, good to 1 µs.
pub(super) fn tai_seconds(epoch: Epoch) -> Result<f64, TimeError> {
    Ok(tai_nanoseconds(epoch)? as f64 / SECOND_NS as f64)
}

fn outside(epoch: Epoch) -> TimeError {
    TimeError::OutsideUtc { epoch: epoch.to_string() }
}

/// TAI nanoseconds since 1900-01-01T00:00:00 TAI.
fn tai_nanoseconds(epoch: Epoch) -> Result<i128, TimeError> {
    if epoch.time_scale != TimeScale::UTC {
        return Ok(epoch.to_tai_duration().total_nanoseconds());
    }
    // hifitime picks ΔAT by a rounded f64, wrong within 0.3 µs before a leap second; by the day it is exact.
    let utc_ns = epoch.duration.total_nanoseconds();
    let day = UtcDay::of_mjd(MJD_1900 + utc_ns.div_euclid(DAY_NS) as i64)
        .ok_or_else(|| outside(epoch))?;
    Ok(day.start_tai_ns + utc_ns.rem_euclid(DAY_NS))
}

/// One day of UTC.
struct UtcDay {
    mjd: i64,
    tai_minus_utc_s: i64,
    start_tai_ns: i128,
    length_ns: i128,
}

impl UtcDay {
    fn of_mjd(mjd: i64) -> Option<Self> {
        let (today, tomorrow) = (delta_at_s(mjd)?, delta_at_s(mjd + 1)?);
        Some(Self {
            mjd,
            tai_minus_utc_s: today,
            start_tai_ns: i128::from(mjd - MJD_1900) * DAY_NS + i128::from(today) * SECOND_NS,
            length_ns: DAY_NS + i128::from(tomorrow - today) * SECOND_NS,
        })
    }

    fn containing(tai_ns: i128) -> Option<Self> {
        let guess = i64::try_from(tai_ns.div_euclid(DAY_NS)).ok()? + MJD_1900;
        let day = Self::of_mjd(guess)?;
        // TAI is ahead of UTC, so the guess is right or one day late.
        if tai_ns >= day.start_tai_ns { Some(day) } else { Self::of_mjd(guess - 1) }
    }
}

/// ΔAT of a UTC day, whole seconds since 1972 (SOFA `dat`).
fn delta_at_s(mjd: i64) -> Option<i64> {
    if !(MJD_1972..=MJD_3000).contains(&mjd) {
        return None;
    }
    let (year, month, day, _) = sofars::cal::jd2cal(2_400_000.5, mjd as f64).ok()?;
    sofars::ts::dat(year, month, day, 0.0).ok().map(|s| s.round() as i64)
}

/// A UTC calendar date and time of day, in which second 60 exists where there was a leap second.
///
/// Reads and writes ISO 8601 (`2016-12-31T23:59:60.5Z`; the `Z` may be missing, a space may stand for the `T`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Utc {
    /// Year, 1972 to 2999.
    pub year: i32,
    /// Month, 1 to 12.
    pub month: u8,
    /// Day of the month, from 1.
    pub day: u8,
    /// Hour, 0 to 23.
    pub hour: u8,
    /// Minute, 0 to 59.
    pub minute: u8,
    /// Second, 0 to 59, and 60 in a leap second.
    pub second: u8,
    /// Nanosecond, 0 to 999 999 999.
    pub nanosecond: u32,
}

impl Utc {
    /// The calendar time of an epoch, exact to the nanosecond.
    ///
    /// # Errors
    /// [`TimeError::OutsideUtc`] before 1972 or after 2999.
    pub fn from_epoch(epoch: Epoch) -> Result<Self, TimeError> {
        let tai_ns = tai_nanoseconds(epoch)?;
        let utc_day = UtcDay::containing(tai_ns).ok_or_else(|| outside(epoch))?;
        let (year, month, day, _) =
            sofars::cal::jd2cal(2_400_000.5, utc_day.mjd as f64).map_err(|_| outside(epoch))?;
        let of_day_ns = tai_ns - utc_day.start_tai_ns;
        // The leap second belongs to the last minute.
        let minutes = (of_day_ns / (60 * SECOND_NS)).min(1439);
        let of_minute_ns = of_day_ns - minutes * 60 * SECOND_NS;
        Ok(Self {
            year,
            month: month as u8,
            day: day as u8,
            hour: (minutes / 60) as u8,
            minute: (minutes % 60) as u8,
            second: (of_minute_ns / SECOND_NS) as u8,
            nanosecond: (of_minute_ns % SECOND_NS) as u32,
        })
    }

    /// The epoch, of scale TAI, so that a leap second stays what it is.
    ///
    /// # Errors
    /// [`TimeError::NoSuchTime`] for a date that is not in the calendar, or a second 60 where no leap second was;
    /// [`TimeError::OutsideUtc`] before 1972 or after 2999.
    pub fn to_epoch(self) -> Result<Epoch, TimeError> {
        let no_such = |why| TimeError::NoSuchTime { text: self.to_string(), why };
        if self.hour > 23 || self.minute > 59 || self.second > 60 || self.nanosecond > 999_999_999 {
            return Err(no_such("the time of day ends at 23:59:59.999999999 (or in second 60)"));
        }
        let (_, mjd) = sofars::cal::cal2jd(self.year, i32::from(self.month), i32::from(self.day))
            .map_err(|_| no_such("that day is not in the calendar"))?;
        let day = UtcDay::of_mjd(mjd as i64)
            .ok_or_else(|| TimeError::OutsideUtc { epoch: self.to_string() })?;
        let of_day_s =
            (i64::from(self.hour) * 60 + i64::from(self.minute)) * 60 + i64::from(self.second);
        let of_day_ns = i128::from(of_day_s) * SECOND_NS + i128::from(self.nanosecond);
        let last_minute = self.hour == 23 && self.minute == 59;
        if self.second == 60 && !(last_minute && of_day_ns < day.length_ns) {
            return Err(no_such("no leap second was there"));
        }
        let tai = Duration::from_total_nanoseconds(day.start_tai_ns + of_day_ns);
        Ok(Epoch::from_tai_duration(tai))
    }
}

impl fmt::Display for Utc {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { year, month, day, hour, minute, second, nanosecond } = self;
        write!(f, "{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}")?;
        if *nanosecond != 0 {
            let digits = format!("{nanosecond:09}");
            write!(f, ".{}", digits.trim_end_matches('0'))?;
        }
        f.write_str("Z")
    }
}

impl FromStr for Utc {
    type Err = TimeError;

    fn from_str(text: &str) -> Result<Self, TimeError> {
        let utc =
            read_iso(text.trim()).ok_or_else(|| TimeError::NotIso { text: text.to_owned() })?;
        utc.to_epoch().map(|_| utc)
    }
}

fn read_iso(text: &str) -> Option<Utc> {
    let text = text.strip_suffix('Z').unwrap_or(text);
    let (date, time) = text.split_once(['T', ' '])?;
    let [year, month, day] = fields(date, '-')?;
    let (whole, decimals) = time.split_once('.').unwrap_or((time, "0"));
    let [hour, minute, second] = fields(whole, ':')?;
    if decimals.is_empty() || decimals.len() > 9 || !decimals.bytes().all(|b| b.is_ascii_digit()) {
        return None;
    }
    Some(Utc {
        year: (year.len() == 4).then(|| year.parse().ok())??,
        month: two_digits(month)?,
        day: two_digits(day)?,
        hour: two_digits(hour)?,
        minute: two_digits(minute)?,
        second: two_digits(second)?,
        nanosecond: format!("{decimals:0<9}").parse().ok()?,
    })
}

fn fields(text: &str, separator: char) -> Option<[&str; 3]> {
    let mut parts = text.split(separator);
    let three = [parts.next()?, parts.next()?, parts.next()?];
    let all_digits = three.iter().all(|p| p.bytes().all(|b| b.is_ascii_digit()));
    (parts.next().is_none() && all_digits).then_some(three)
}

fn two_digits(text: &str) -> Option<u8> {
    (text.len() == 2).then(|| text.parse().ok())?
}
